"""`gfmdlayer clean`: remove unfinished files of killed runs, after listing them and asking; results stay."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gfmdlayer.cli.terminal import COMPLETE, arguments, cut_short, refuse

EXAMPLE = "gfmdlayer clean results/figure2-quick"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    arguments(parser, "directory DIR  results folder\n--yes  remove without asking")


def clean(options: argparse.Namespace) -> int:
    """Remove the unfinished files of killed runs."""
    from gfmdlayer.execution.folder import Folder
    from gfmdlayer.execution.growth import leftovers

    folder = Folder(Path(options.directory))
    try:
        with leftovers(folder) as found:
            if not found:
                print("no unfinished files of killed runs")
                return COMPLETE
            size = sum(path.stat().st_size for path in found)
            print(f"{len(found)} unfinished files of killed runs, {size:,} bytes:")
            print("\n".join(cut_short(f"  {path.relative_to(folder.path)}" for path in found)))
            if not options.yes and not sys.stdin.isatty():
                return refuse("clean: cannot ask without a terminal; --yes removes these files")
            if not options.yes and input("remove them? [y/N] ").strip().lower() not in {"y", "yes"}:
                print("nothing was removed")
                return COMPLETE
            for path in found:
                path.unlink(missing_ok=True)
            print(f"removed {len(found)} files")
    except OSError as error:
        return refuse(f"{error.filename}: cannot be removed ({error.strerror})")
    except (EOFError, KeyboardInterrupt):
        print("\nnothing was removed")
    return COMPLETE
