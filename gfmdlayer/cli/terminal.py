"""Parts that the verbs share: exit statuses, options, the refusal of bad input, lists cut short."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.files.locks import printable

if TYPE_CHECKING:
    from gfmdlayer.config import Config

COMPLETE, FAILED, REFUSED, RESUMABLE = 0, 1, 2, 75
STATUSES = (
    "exit status: 0 all cases complete; 1 some case failed; 2 bad input; 75 stopped by a signal, resumable"
)
LISTED = 20  # entries of a list before it is cut short
REPORTED = 100  # problems of a configuration, likewise


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


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add the configuration, and --set, to a verb."""
    parser.add_argument("config", metavar="CONFIG", help="YAML file, or a case's result file to run it again")
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="set a key, such as layer.thickness=0.1; may be given several times",
    )


def add_out(parser: argparse.ArgumentParser) -> None:
    """Add the results folder and the number of processes to a verb."""
    parser.add_argument(
        "--out", metavar="DIR", type=folder_name, help="results folder (default: results/NAME)"
    )
    parser.add_argument("--jobs", metavar="N", type=int, default=1, help="processes (default: 1)")


def refuse(*problems: str) -> int:
    """Print what is wrong with the input, a line each, and return the exit status."""
    for problem in problems[:REPORTED]:
        print(f"gfmdlayer: {printable(problem)}", file=sys.stderr)
    if (further := len(problems) - REPORTED) > 0:
        print(f"gfmdlayer: ... and {further} more of these", file=sys.stderr)
    return REFUSED


def input_problems(error: Exception) -> Sequence[str]:
    """Return the messages of an error in the input or the results, and nothing for an error of the program.

    The error classes are imported only here, after an error, so that a verb loads no module for them.
    """
    from gfmdlayer.config import ConfigError
    from gfmdlayer.execution.folder import FolderError
    from gfmdlayer.execution.workers import LauncherError
    from gfmdlayer.files.tables import TableError
    from gfmdlayer.results.schema import ResultsError

    if isinstance(error, ConfigError):
        return error.problems
    if isinstance(error, PermissionError):
        return [f"{error}; this user must be allowed to read it, or to write there"]
    return [str(error)] if isinstance(error, FolderError | LauncherError | TableError | ResultsError) else []


def read_config(options: argparse.Namespace, ranks_per_case: int = 1) -> Config:
    """Read the configuration named on the command line, or that of a case's result file.

    Parameters
    ----------
    options : argparse.Namespace
        The command line.
    ranks_per_case : int
        Ranks that are to compute a case together.

    Raises
    ------
    ConfigError
        With every error in it.
    """
    from gfmdlayer.config import ConfigError
    from gfmdlayer.execution import folder

    try:
        if ranks_per_case == 1:
            return folder.read_config(options.config, options.set)
        from gfmdlayer.execution.groups import input_errors_together

        inspect = partial(input_errors_together, ranks_per_case=ranks_per_case)
        return folder.read_config(options.config, options.set, inspect)
    except PermissionError as error:
        raise ConfigError(list(input_problems(error))) from None


def results_folder(options: argparse.Namespace, config: Config) -> Path:
    """Return --out, or results/NAME; results/NAME-NNNN for a case that is run again."""
    from gfmdlayer.execution.folder import is_result

    rerun = f"-{Path(options.config).stem}" if is_result(options.config) else ""
    return Path(options.out or Path("results") / f"{config.name}{rerun}")


def count_cases(number: int) -> str:
    """Write a number of cases."""
    return "1 case" if number == 1 else f"{number} cases"


def cut_short(lines: Iterable[str], number: int | None = None) -> list[str]:
    """Return the first lines of a list, and the number of further ones; of `number` lines if given."""
    every = list(map(printable, lines))
    further = (len(every) if number is None else number) - LISTED
    return [*every[:LISTED], *([f"  ... and {further} more"] if further > 0 else [])]
