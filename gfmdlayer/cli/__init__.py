"""The command line: verbs of a few lines each that call the library.

A verb imports heavy modules only when it needs them, so that help and `check` answer at once. `main` catches
errors in the input and prints each on a line of standard error, with exit status 2.

Exit status: 0 all cases complete; 1 some case failed; 2 bad input; 75 stopped by a signal, resumable.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from typing import Any

from gfmdlayer.cli import editing, fits, folders, results, run, verify
from gfmdlayer.cli.terminal import COMPLETE, FAILED, RESUMABLE, STATUSES, Verb, input_problems, refuse

VERBS: tuple[Verb, ...] = (
    editing.new, run.run, run.check, run.converge, folders.status, folders.clean,
    results.plot, results.report, results.leak,
    fits.fit_material, fits.fit_indentation, verify.verify, editing.schema, editing.completion,
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    _open_closed_streams()
    threads = os.environ.get("NUMBA_NUM_THREADS", "1")
    if not (threads.isdecimal() and int(threads) >= 1):  # Numba raises an error, or prints one, when imported
        return refuse(f"NUMBA_NUM_THREADS={threads}: must be 1 or more, or unset")
    # More threads of the linear algebra gain nothing here; OpenBLAS sends a SIGINT if it cannot start them.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Pydantic reads the metadata of every installed package in search of plugins, which nothing here uses.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    try:
        options = command_line().parse_args(arguments)
        status: int = options.verb(options)
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader of our output has closed it; Python must not write the rest at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return COMPLETE
    except KeyboardInterrupt:  # before the verb listens to signals, or in one that does not
        print("gfmdlayer: stopped", file=sys.stderr, flush=True)
        _end_ranks()
        return RESUMABLE
    except Exception as error:
        if problems := input_problems(error):
            return refuse(*problems)
        from gfmdlayer.study.preflight import machine_problem

        if not (problem := machine_problem(error)):
            raise
        print(f"gfmdlayer: {problem}", file=sys.stderr)
        return FAILED
    return status


def _open_closed_streams() -> None:
    """Open the null device for streams that are closed: the next file opened would get their numbers."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_RDWR)
            if null != number:
                try:
                    os.fstat(number)  # another file has taken the number before
                except OSError:
                    os.dup2(null, number)
            setattr(sys, name, os.fdopen(null, "w" if number else "r", encoding="utf-8"))


def _end_ranks() -> None:
    """End by a signal under an MPI launcher: after a plain exit the other ranks would wait for ever."""
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)  # another one may follow
    from gfmdlayer.study.preflight import launched_size

    if launched_size(os.environ):
        os.kill(os.getpid(), signal.SIGINT)
    signal.signal(signal.SIGINT, before)


class _Version(argparse.Action):
    """Print the version; it is looked up only here."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any, **__: Any) -> None:
        from importlib.metadata import version

        print(f"gfmdlayer {version('gfmdlayer')}")
        parser.exit()


def command_line() -> argparse.ArgumentParser:
    """Return the parser of all verbs and their options."""
    example = "example:\n  gfmdlayer run configs/figure2-quick.yaml && gfmdlayer plot results/figure2-quick"
    parser = argparse.ArgumentParser(
        prog="gfmdlayer",
        description="Contact with a viscoelastic layer, by Green's function molecular dynamics.",
        epilog=f"{STATUSES}\n\n{example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    for verb in VERBS:
        words = verb.meaning.partition("\n")[0].rstrip(".")
        summary = words[:1].lower() + words[1:]  # python -OO has no docstrings
        added = verbs.add_parser(
            verb.name,
            help=summary,
            description=summary,
            epilog=f"example:\n  {verb.example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        verb.add_options(added)
        added.set_defaults(verb=verb.run)
    return parser
