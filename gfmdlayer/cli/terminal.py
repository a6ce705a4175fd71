"""What the verbs share: exit statuses, options, and how they talk."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gfmdlayer.config import Config

COMPLETE, FAILED, REFUSED, RESUMABLE = 0, 1, 2, 75
STATUSES = (
    "exit status: 0 all cases complete; 1 some case failed; 2 bad input; 75 stopped by a signal, resumable"
)
LISTED = 20  # entries of a list before it is cut short


class Verbs:
    """The verbs of the command line; each is named by its function and shows an example."""

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        self._subparsers: Any = parser.add_subparsers(metavar="VERB", required=True)

    def add(
        self, function: Callable[[argparse.Namespace], int], summary: str, example: str
    ) -> argparse.ArgumentParser:
        """Add a verb; the example is what a user may paste, and text that follows it."""
        added: argparse.ArgumentParser = self._subparsers.add_parser(
            function.__name__.replace("_", "-"),
            help=summary,
            description=summary,
            epilog=f"example:\n  {example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        added.set_defaults(verb=function)
        return added


def folder_name(name: str) -> str:
    """Take the name of a folder from the command line."""
    if not name:
        raise argparse.ArgumentTypeError("got an empty name; must be the name of a folder")
    return name


def interval(text: str) -> float:
    """Take a number of seconds from the command line."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not seconds >= 0:
        raise argparse.ArgumentTypeError(f"got {text}; must be a number of seconds >= 0, or inf")
    return seconds


def add_config(parser: argparse.ArgumentParser) -> None:
    """Let a verb take a configuration."""
    parser.add_argument("config", metavar="CONFIG", help="YAML file, or the file of a case, to run it again")
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="set a key, such as layer.thickness=0.1; may be given several times",
    )


def add_team(parser: argparse.ArgumentParser) -> None:
    """Let a verb take where the results go, and how many processes compute them."""
    parser.add_argument(
        "--out", metavar="DIR", type=folder_name, help="results folder (default: results/NAME)"
    )
    parser.add_argument("--jobs", metavar="N", type=int, default=1, help="processes (default: 1)")


def refuse(*problems: str) -> int:
    """Say what is wrong with the input; the exit status."""
    for problem in problems:
        print(f"gfmdlayer: {problem}", file=sys.stderr)
    return REFUSED


def read_config(options: argparse.Namespace) -> Config:
    """Read the configuration that a verb was given.

    Raises
    ------
    ConfigError
        With everything that is wrong with it.
    """
    from gfmdlayer.config import load
    from gfmdlayer.execution.rerun import is_result, stored_config
    from gfmdlayer.execution.sweep import input_errors

    if is_result(options.config):
        return stored_config(options.config, options.set)
    return load(options.config, options.set, input_errors)


def default_directory(config: Config, path: str) -> Path:
    """Where the results go unless told otherwise; those of a case that is run again are kept apart."""
    from gfmdlayer.execution.rerun import is_result

    return Path("results") / (f"{config.name}-{Path(path).stem}" if is_result(path) else config.name)


def count_cases(number: int) -> str:
    """Write a number of cases."""
    return "1 case" if number == 1 else f"{number} cases"


def print_some(lines: Iterable[str]) -> None:
    """Print the first lines of a list, and how many more there are."""
    for line in some(list(lines)):
        print(line)


def some(lines: Sequence[str]) -> list[str]:
    """Return the first lines of a list, and how many more there are."""
    more = [f"  ... and {len(lines) - LISTED} more"] if len(lines) > LISTED else []
    return [*lines[:LISTED], *more]
