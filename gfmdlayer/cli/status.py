"""`gfmdlayer status`: tell what is done, running, failed and waiting."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from gfmdlayer.cli.terminal import COMPLETE, LISTED, Verbs, count_cases, refuse, some

if TYPE_CHECKING:
    from gfmdlayer.execution.folder import Folder
    from gfmdlayer.execution.status import Overview, Running

WATCH_INTERVAL = 2.0  # seconds between two looks


def register(verbs: Verbs) -> None:
    """Add the verb to the command line."""
    added = verbs.add(
        status,
        "tell what is done, running, failed and waiting",
        "gfmdlayer status results/figure2-quick",
    )
    added.add_argument("directory", metavar="DIR", help="results folder")
    added.add_argument("--watch", action="store_true", help="look again until all is done, or Ctrl-C")


def status(options: argparse.Namespace) -> int:
    """Tell what is done, running, failed and waiting."""
    from gfmdlayer.execution.folder import Folder, FolderError
    from gfmdlayer.execution.status import overview

    folder = Folder(Path(options.directory))
    try:
        if options.watch:
            _watch(folder)
        else:
            print("\n".join(_lines(overview(folder))))
    except FolderError as error:
        return refuse(str(error))
    except KeyboardInterrupt:
        pass  # how a watch is left
    return COMPLETE


def _watch(folder: Folder) -> None:
    """Look again and again; on a terminal in place, elsewhere a line whenever something has changed."""
    if sys.stdout.isatty():
        from rich.console import Console
        from rich.live import Live
        from rich.text import Text

        with Live(console=Console(), auto_refresh=False) as live:
            for seen in _looks(folder):
                live.update(Text("\n".join(_lines(seen))), refresh=True)
        return
    told = ""
    for seen in _looks(folder):
        if told != (told := _counts(seen)):
            print(f"{time.strftime('%Y-%m-%d %H:%M:%S')}  {told}", flush=True)


def _looks(folder: Folder) -> Iterator[Overview]:
    from gfmdlayer.execution.status import overview

    interrupted = False

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True  # for where the exception strikes code that drops it: a destructor, a callback
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        while not interrupted:
            seen = overview(folder)
            yield seen
            if seen.over:
                return
            time.sleep(WATCH_INTERVAL)
    finally:
        signal.signal(signal.SIGINT, before)


def _lines(seen: Overview) -> list[str]:
    return [_counts(seen), *some([_at_work(case) for case in seen.running]), *_failures(seen)]


def _counts(seen: Overview) -> str:
    return (
        f"{count_cases(seen.total)}: {seen.complete} complete, {len(seen.running)} running, "
        f"{seen.failed} failed, {seen.waiting} waiting"
    )


def _at_work(case: Running) -> str:
    from gfmdlayer.execution.status import duration

    left = "" if case.seconds_left is None else f", {duration(case.seconds_left)} left"
    return (
        f"  {case.index:04d} running on {case.host} (process {case.pid}): step {case.steps}, "
        f"time {case.simulated_time:g} of {case.end:g}{left}  {case.label}"
    ).rstrip()


def _failures(seen: Overview) -> list[str]:
    """Tell each of a few failures, and of many how many are alike."""
    from gfmdlayer.execution.status import group_by_reason
    from gfmdlayer.execution.sweep import label

    if seen.failed <= LISTED:
        return [
            f"  {f.index:04d} failed: {f.reason}  {label(dict(f.values))}".rstrip() for f in seen.failures
        ]
    groups = group_by_reason(seen.failures)
    lines = some([f"  {len(group)} failed like {group[0].index:04d}: {group[0].reason}" for group in groups])
    unread = seen.failed - len(seen.failures)
    return [*lines, f"  {unread} more failed; see cases/*.failed"] if unread else lines
