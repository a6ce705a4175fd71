"""`gfmdlayer completion`: print the script for a shell to complete verbs, options and file names."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from gfmdlayer.cli.terminal import COMPLETE

SHELLS = ("bash", "zsh", "fish")
PATHS = {"CONFIG", "DATA", "DIR", "FILE", "PATH"}  # metavars of files and folders

EXAMPLE = 'eval "$(gfmdlayer completion bash)"'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument("shell", choices=SHELLS, help="name of the shell")


def completion(options: argparse.Namespace) -> int:
    """Print the script for a shell to complete verbs, options and file names."""
    import shtab

    from gfmdlayer.cli import command_line

    parser = command_line()
    for action in _actions(parser):
        if action.metavar in PATHS:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(parser, options.shell))
    return COMPLETE


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for verb in action.choices.values():
                yield from _actions(verb)
