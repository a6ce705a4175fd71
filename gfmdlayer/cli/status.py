"""`gfmdlayer status`: tell what is done, running, failed and waiting."""

from __future__ import annotations

import argparse
from pathlib import Path

from gfmdlayer.cli.terminal import COMPLETE, Verbs, count_cases, print_some, refuse


def register(verbs: Verbs) -> None:
    """Add the verb to the command line."""
    added = verbs.add(
        status,
        "tell what is done, running, failed and waiting",
        "gfmdlayer status results/figure2-quick",
    )
    added.add_argument("directory", metavar="DIR", help="results folder")


def status(options: argparse.Namespace) -> int:
    """Tell what is done, running, failed and waiting."""
    from gfmdlayer.running.folder import Folder, FolderError, read_json
    from gfmdlayer.running.status_file import running
    from gfmdlayer.sweep import combinations, label

    folder = Folder(Path(options.directory))
    try:
        values = combinations(folder.stored_sweep())
    except FolderError as error:
        return refuse(str(error))
    at_work = running(folder)
    busy = {case.index for case in at_work}
    complete = {int(path.stem) for path in folder.cases.glob("[0-9]*.h5")} - busy
    failed = {int(path.stem) for path in folder.cases.glob("[0-9]*.failed")} - busy - complete
    waiting = len(values) - len(complete) - len(failed) - len(busy)
    print(f"{count_cases(len(values))}: {len(complete)} complete, {len(busy)} running, ", end="")
    print(f"{len(failed)} failed, {waiting} waiting")
    print_some(
        f"  {case.index:04d} running on {case.host} (process {case.pid}): "
        f"time {case.simulated_time:g} of {case.end:g}  {label(values[case.index])}"
        for case in at_work
    )
    reasons = {
        index: (read_json(folder.case(index, "failed")) or {}).get("reason") for index in sorted(failed)
    }
    print_some(f"  {index:04d} failed: {reason}  {label(values[index])}" for index, reason in reasons.items())
    return COMPLETE
