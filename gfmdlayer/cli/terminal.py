"""Shared by the verbs: exit statuses, options, messages about bad input, long lists."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from textwrap import dedent
from typing import TYPE_CHECKING, Any, NamedTuple

from gfmdlayer.files.locks import printable

if TYPE_CHECKING:
    from gfmdlayer.study.cases import Cases
    from gfmdlayer.study.run import Summary

COMPLETE, FAILED, REFUSED, RESUMABLE = 0, 1, 2, 75
STATUSES = (
    "exit status: 0 all cases complete; 1 some case failed; 2 bad input; 75 stopped by a signal, resumable"
)
LISTED = 20  # entries of a list before it is cut short
REPORTED = 100  # problems of a configuration before the list is cut short


class Verb(NamedTuple):
    """A verb: a function that returns the exit status; the first line of its docstring is its help."""

    run: Callable[[argparse.Namespace], int]
    add_options: Callable[[argparse.ArgumentParser], None]
    example: str

    @property
    def name(self) -> str:
        """Word on the command line."""
        return self.run.__name__.replace("_", "-")

    @property
    def meaning(self) -> str:
        """The docstring, which begins with the help."""
        first, _, rest = (self.run.__doc__ or "").partition("\n")
        return f"{first}\n{dedent(rest)}".strip()


def verb(
    options: str | Callable[[argparse.ArgumentParser], None], example: str
) -> Callable[[Callable[[argparse.Namespace], int]], Verb]:
    """Make a function a verb; a text describes its options as `arguments` takes them."""
    if isinstance(options, str):
        return partial(Verb, add_options=partial(arguments, described=options), example=example)
    return partial(Verb, add_options=options, example=example)


def folder_name(name: str) -> str:
    """Parse the name of a folder."""
    if not name:
        raise argparse.ArgumentTypeError("got an empty name; must be the name of a folder")
    return name


def interval(text: str) -> float:
    """Parse a number of seconds."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not seconds >= 0:
        raise argparse.ArgumentTypeError(f"got {text}; must be a number of seconds >= 0, or inf")
    return seconds


def arguments(parser: argparse._ActionsContainer, described: str, **types: Any) -> None:
    """Add arguments that a text describes as the help shows them: `--jobs N = 1  processes (default: 1)`.

    A meaning begins after two spaces and goes on in lines that begin with a space. Metavars give the types.
    """
    for line in filter(None, re.sub(r"\n +", " ", dedent(described).strip()).splitlines()):
        form, meaning = re.split(r" {2,}", line, maxsplit=1)
        form, _, default = form.partition(" = ")
        name, *values = form.split()
        read = (_TYPES | types).get(values[0] if values else "", str)
        kind: dict[str, Any] = {"help": meaning} | ({"default": read(default)} if default else {})
        match values:
            case []:
                kind["action"] = "store_true"
            case [word] if word.startswith("{"):
                kind["choices"] = word.strip("{}").split(",")
            case [word]:
                kind |= {"metavar": word, "type": read}
            case [word, "..."]:
                kind |= {"metavar": word, "type": read, "nargs": "+"}
                kind |= {"action": "extend", "default": []} if name.startswith("-") else {}
            case _:
                kind |= {"metavar": tuple(values), "type": read, "nargs": len(values)}
        parser.add_argument(name, **kind)


_TYPES: dict[str, Any] = {
    "N": int, "DIR": folder_name, "SECONDS": interval,
    **dict.fromkeys(("NU", "G0", "T", "T0", "C1", "ETA", "P", "L", "W", "D", "LENGTH"), float),
}  # fmt: skip


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add the configuration, and --set, to a verb."""
    arguments(parser, "config CONFIG  YAML file, or the result file of a case to run it again")
    meaning = "set a key, such as layer.thickness=0.1; may be given several times"
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], help=meaning)
    arguments(parser, f"--trust  {TRUST}")


TRUST = "run the Python code that a result file names as its body; without it such a file is refused"
OUT = "--out DIR  results folder (default: results/NAME)\n--jobs N = 1  processes (default: 1)"


def refuse(*problems: str) -> int:
    """Print each problem of the input on a line and return the exit status."""
    for problem in problems[:REPORTED]:
        print(f"gfmdlayer: {printable(problem)}", file=sys.stderr)
    if (further := len(problems) - REPORTED) > 0:
        print(f"gfmdlayer: ... and {further} more", file=sys.stderr)
    return REFUSED


def input_problems(error: Exception) -> Sequence[str]:
    """Return the messages of an error in the input or the results; empty for any other error."""
    from gfmdlayer.config import ConfigError
    from gfmdlayer.files.tables import TableError
    from gfmdlayer.grid.library import FftwError
    from gfmdlayer.results.names import ResultsError
    from gfmdlayer.study.folder import FolderError
    from gfmdlayer.study.workers import LauncherError

    if isinstance(error, ConfigError):
        return error.problems
    if isinstance(error, PermissionError):
        return [f"{error}; you need permission to read it, or to write there"]
    told = FolderError | FftwError | LauncherError | TableError | ResultsError
    return [str(error)] if isinstance(error, told) else []


def read_cases(options: argparse.Namespace, ranks_per_case: int = 1) -> tuple[Cases, Path]:
    """Read the cases on the command line, or one of results; return them with the results folder."""
    # The folder is --out, or results/NAME; results/NAME-NNNN where a case is run again.
    from gfmdlayer.config import ConfigError
    from gfmdlayer.study.cases import Cases, checked
    from gfmdlayer.study.folder import is_result, read_config

    try:
        if ranks_per_case > 1:
            from gfmdlayer.study.groups import input_errors_together, with_shared_solver

            inspect = partial(input_errors_together, ranks_per_case=ranks_per_case)
            config = read_config(options.config, options.set, inspect, trust=options.trust)
            cases = Cases(with_shared_solver(config))
        else:
            cases = checked(partial(read_config, options.config, options.set, trust=options.trust))
    except PermissionError as error:
        raise ConfigError(list(input_problems(error))) from None
    rerun = f"-{Path(options.config).stem}" if is_result(options.config) else ""
    return cases, Path(options.out or Path("results") / f"{cases.config.name}{rerun}")


def count_cases(number: int) -> str:
    """Write a number of cases."""
    return "1 case" if number == 1 else f"{number} cases"


def cut_short(lines: Iterable[str], number: int | None = None) -> list[str]:
    """Return the first lines of a list, and how many of `number` lines (default: all) are left out."""
    every = list(map(printable, lines))
    further = (len(every) if number is None else number) - LISTED
    return [*every[:LISTED], *([f"  ... and {further} more"] if further > 0 else [])]


def note_incomplete(path: Path) -> None:
    """Name on standard error the cases of a results folder that are neither complete nor failed."""
    from gfmdlayer.study.folder import Folder

    folder = Folder(path)
    if folder.path.is_dir() and folder.is_results():
        numbers, found = folder.case_numbers(), folder.numbers()
        ended = found["h5"] | found["failed"]
        if waiting := [f"{number:04d}" for number in numbers if number not in ended]:
            named = ", ".join(waiting[:LISTED]) + " ..." * (len(waiting) > LISTED)
            cases = f"{len(waiting)} of {count_cases(len(numbers))}"
            print(f"note: {cases} not complete yet: {named}", file=sys.stderr)


def conclude(summary: Summary, directory: Path, noun: str) -> int:
    """Print the end of a run over cases or curves (`noun`), and return the exit status."""
    print("".join(f"note: {line}\n" for line in summary.notes), end="")
    if stopped := summary.count("stopped"):
        left = f"{stopped} {noun}s wait" if stopped > 1 else f"1 {noun} waits"
        print(f"stopped: {left}; the same command continues")
        return RESUMABLE
    if summary.failures:
        print(f"{len(summary.failures)} of {summary.total} {noun}s failed:")
        print("\n".join(cut_short(f"  {each.index:04d}: {each.reason}" for each in summary.failures)))
        complete = (
            f"complete {noun}s are in {directory}" if summary.count("complete") else f"no {noun} is complete"
        )
        print(f"{complete}; the same command retries the failed ones")
        return FAILED
    if waiting := summary.count("waiting"):
        print(f"no failed case is left; {count_cases(waiting)} wait: run again without --only-failed")
    elif elsewhere := summary.count("elsewhere"):
        others = "is at work in another run" if elsewhere == 1 else "are at work in other runs"
        print(
            f"complete but {count_cases(elsewhere)}, which {others}; sweep.h5 follows when all are complete"
        )
    else:
        print(f"complete: {directory / 'sweep.h5'}")
    return COMPLETE
