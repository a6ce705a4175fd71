"""`gfmdlayer clean`: remove what killed runs left."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gfmdlayer.cli.terminal import COMPLETE, Verbs, print_some, refuse


def register(verbs: Verbs) -> None:
    """Add the verb to the command line."""
    added = verbs.add(
        clean,
        "remove what killed runs left: unfinished files, no results; lists it and asks first",
        "gfmdlayer clean results/figure2-quick",
    )
    added.add_argument("directory", metavar="DIR", help="results folder")
    added.add_argument("--yes", action="store_true", help="remove without asking")


def clean(options: argparse.Namespace) -> int:
    """Remove what killed runs left."""
    from gfmdlayer.execution.claim import leftovers
    from gfmdlayer.execution.folder import Folder, FolderError

    folder = Folder(Path(options.directory))
    try:
        with leftovers(folder) as found:
            if not found:
                print("nothing is left of dead runs")
                return COMPLETE
            size = sum(path.stat().st_size for path in found)
            print(f"left of dead runs, {len(found)} files of {size:,} bytes:")
            print_some(f"  {path.relative_to(folder.path)}" for path in found)
            if not options.yes and not sys.stdin.isatty():
                return refuse("clean: nobody is there to ask; say --yes to remove these files")
            if not options.yes and input("remove them? [y/N] ").strip().lower() not in {"y", "yes"}:
                print("nothing was removed")
                return COMPLETE
            for path in found:
                path.unlink(missing_ok=True)
            print(f"removed {len(found)} files")
    except FolderError as error:
        return refuse(str(error))
    except OSError as error:
        return refuse(f"{error.filename}: cannot be removed ({error.strerror})")
    except (EOFError, KeyboardInterrupt):
        print("\nnothing was removed")
    return COMPLETE
