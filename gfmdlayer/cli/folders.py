"""`status` and `clean`: the cases of a results folder, and the files that killed runs left in it."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from gfmdlayer.cli.terminal import COMPLETE, LISTED, count_cases, cut_short, refuse, verb
from gfmdlayer.files.locks import printable

if TYPE_CHECKING:
    from gfmdlayer.study.folder import Folder
    from gfmdlayer.study.status import Overview, Record

WATCH_INTERVAL = 2.0  # seconds

_STATUS = """
directory DIR  results folder
--watch  update until no case is left; Ctrl-C ends it
"""


@verb(_STATUS, "gfmdlayer status results/figure2-quick")
def status(options: argparse.Namespace) -> int:
    """Count the complete, running, failed and waiting cases."""
    from gfmdlayer.study.folder import Folder
    from gfmdlayer.study.status import overview

    folder = Folder(Path(options.directory))
    try:
        if options.watch:
            _watch(folder)
        else:
            print("\n".join(_lines(overview(folder, verify=True))))
    except KeyboardInterrupt:
        pass  # ends --watch
    return COMPLETE


def _watch(folder: Folder) -> None:
    """Show the overview until no case is left: in place on a terminal, else a line at each change."""
    if sys.stdout.isatty():
        from rich.console import Console
        from rich.live import Live
        from rich.text import Text

        with Live(console=Console(), auto_refresh=False) as live:
            for seen in _overviews(folder):
                live.update(Text("\n".join(_lines(seen))), refresh=True)
        return
    last = ""
    for seen in _overviews(folder):
        if last != (last := _counts(seen)):
            print(f"{time.strftime('%Y-%m-%d %H:%M:%S')}  {last}", flush=True)


def _overviews(folder: Folder) -> Iterator[Overview]:
    from gfmdlayer.study.status import overview

    interrupted = False

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True  # the exception is lost if it is raised in a destructor or a callback
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        while not interrupted:
            seen = overview(folder, verify=True)
            yield seen
            if seen.over:
                return
            time.sleep(WATCH_INTERVAL)
    finally:
        signal.signal(signal.SIGINT, before)


def _lines(seen: Overview) -> list[str]:
    from gfmdlayer.results.provenance import duration

    running = []
    for case in seen.running:
        left = "" if case.seconds_left is None else f", {duration(case.seconds_left)} left"
        reached = f"step {case.steps}, time {case.simulated_time:g} of {case.end:g}{left}"
        place = f"running on {case.host} (process {case.pid})"
        running.append(f"  {case.index:04d} {place}: {reached}  {case.label}".rstrip())
    lines = [_counts(seen), *cut_short(running)]
    lines += _records(seen.failures, seen.failed, "failed")
    lines += _records(seen.ended, len(seen.ended), "complete")
    words = "holds other bytes than were written; the same run sets it aside and computes it again"
    lines += cut_short(f"  {index:04d} damaged: {words}" for index in seen.damaged)
    lines += [f"accuracy, the worst: {seen.accuracy}"] if seen.accuracy else []
    lines += cut_short([f"warning: {text}" for text in seen.warnings])
    return [printable(line).replace("\n", " ") for line in lines]


def _counts(seen: Overview) -> str:
    damaged = f", {len(seen.damaged)} damaged" * bool(seen.damaged)
    return (
        f"{count_cases(seen.total)}: {seen.complete} complete, {len(seen.running)} running, "
        f"{seen.failed} failed, {seen.waiting} waiting{damaged}"
    )


def _records(records: list[Record], number: int, state: str) -> list[str]:
    """List a few cases one by one, and many in groups with the same reason."""
    from gfmdlayer.study.cases import label
    from gfmdlayer.study.status import group_by_reason

    if number <= LISTED:
        return [f"  {r.index:04d} {state}: {r.reason}  {label(dict(r.values))}".rstrip() for r in records]
    groups = group_by_reason(records)
    firsts = ((len(group), group[0]) for group in groups)
    lines = cut_short(f"  {number} {state} like {r.index:04d}: {r.reason}" for number, r in firsts)
    unread = number - len(records)
    return [*lines, f"  {unread} more {state}; see cases/*.{state}"] if unread else lines


@verb("directory DIR  results folder\n--yes  remove without asking", "gfmdlayer clean results/figure2-quick")
def clean(options: argparse.Namespace) -> int:
    """Remove unfinished files of killed runs, after listing them and asking; results stay."""
    from gfmdlayer.study.claims import leftovers
    from gfmdlayer.study.folder import Folder

    folder = Folder(Path(options.directory))
    try:
        with leftovers(folder) as files:
            if not files:
                print("no unfinished files of killed runs")
                return COMPLETE
            size = sum(path.stat().st_size for path in files)
            print(f"{len(files)} unfinished files of killed runs, {size:,} bytes:")
            print("\n".join(cut_short(f"  {path.relative_to(folder.path)}" for path in files)))
            if not options.yes and not sys.stdin.isatty():
                return refuse("clean: cannot ask without a terminal; --yes removes these files")
            if not options.yes and input("remove them? [y/N] ").strip().lower() not in {"y", "yes"}:
                print("nothing was removed")
                return COMPLETE
            for path in files:
                path.unlink(missing_ok=True)
            print(f"removed {len(files)} files")
    except OSError as error:
        return refuse(f"{error.filename}: cannot be removed ({error.strerror})")
    except (EOFError, KeyboardInterrupt):
        print("\nnothing was removed")
    return COMPLETE
