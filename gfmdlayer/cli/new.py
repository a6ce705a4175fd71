"""`gfmdlayer new`: write a configuration to start from, with the meaning of every key."""

from __future__ import annotations

import argparse
from pathlib import Path

from gfmdlayer.cli.terminal import COMPLETE, refuse

LIKE = ("indentation", "sweep", "prony", "stack", "sliding", "adhesion", "sphere", "rough")

EXAMPLE = "gfmdlayer new first.yaml && gfmdlayer run first.yaml && gfmdlayer plot results/first"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument("file", metavar="FILE", nargs="?", help="YAML file to write (default: KIND.yaml)")
    parser.add_argument(
        "--like",
        metavar="KIND",
        choices=LIKE,
        default=LIKE[0],
        help=f"{', '.join(LIKE)} (default: {LIKE[0]})",
    )
    parser.add_argument("--force", action="store_true", help="overwrite FILE")


def new(options: argparse.Namespace) -> int:
    """Write a configuration to start from."""
    from gfmdlayer.cli.templates import commented
    from gfmdlayer.config import ConfigError
    from gfmdlayer.files.whole import write_text

    path = Path(options.file or f"{options.like}.yaml")
    try:
        content = commented(path.stem, options.like)
        write_text(path, content, replace=options.force)
    except ConfigError as error:
        return refuse(*(f"{path}: {problem}" for problem in error.problems))
    except FileExistsError:
        return refuse(f"{path}: exists; choose another name, or --force to overwrite it")
    except OSError as error:
        return refuse(f"{path}: cannot be written ({error.strerror})")
    print(f"{path}: explains each key; run it with  gfmdlayer run {path}")
    return COMPLETE
