"""Progress of a run, told to a terminal or a log."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from typing import Protocol, Self, TextIO

from gfmdlayer.running.folder import Folder
from gfmdlayer.running.interrupts import stop_requested
from gfmdlayer.running.schedule import Outcome
from gfmdlayer.running.status_file import running

READ_INTERVAL = 0.5  # seconds between two looks at the status files
LOG_INTERVAL = 5.0  # seconds between two lines in a log, more in a long run


class Report(Protocol):
    """Where progress is told."""

    def note(self, line: str) -> None:
        """Tell one event."""

    def advance(self, done: float, total: int, running: int, seconds_left: float | None) -> None:
        """Tell how many cases are done (parts of running ones included) of how many, and the time left."""

    def close(self) -> None:
        """Nothing more will be told."""


class Log:
    """Plain lines with the time, for a file."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._begun = self._last = time.monotonic()

    def note(self, line: str) -> None:
        """Write one line."""
        with suppress(OSError):  # nobody reads the log any more; the run goes on
            self._stream.write(f"{time.strftime('%Y-%m-%d %H:%M:%S')}  {line}\n")
            self._stream.flush()

    def advance(self, done: float, total: int, running: int, seconds_left: float | None) -> None:
        """Write a line, unless there was one just before."""
        now = time.monotonic()
        if now - self._last >= max(LOG_INTERVAL, (now - self._begun) / 50):
            self._last = now
            left = "" if seconds_left is None else f", {duration(seconds_left)} left"
            self.note(f"{done / total:.0%}, {running} running{left}")

    def close(self) -> None:
        """Do nothing: every line is written already."""


class Bar:
    """A bar with the time left, for a terminal."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

        columns = (BarColumn(), TaskProgressColumn(), TextColumn("{task.fields[state]}"))
        self._progress = Progress(*columns, console=Console(stderr=True))
        self._task = self._progress.add_task("", state="")
        self._progress.start()

    def note(self, line: str) -> None:
        """Write one line above the bar."""
        self._progress.console.print(line, markup=False, highlight=False)

    def advance(self, done: float, total: int, running: int, seconds_left: float | None) -> None:
        """Move the bar."""
        left = "" if seconds_left is None else f", {duration(seconds_left)} left"
        state = f"{int(done)} of {total} complete, {running} running{left}"
        self._progress.update(self._task, completed=done, total=total, state=state)

    def close(self) -> None:
        """Leave the bar as it is."""
        self._progress.stop()


class Reporter:
    """Watches a run and tells a report; a context manager around it, with a thread of its own.

    Parameters
    ----------
    folder : Folder
        The results folder.
    own : collection of int
        The cases of the run; other runs in the folder tell of theirs.
    complete : int
        Number of those complete before the run.
    report : callable, optional
        Makes the report to tell; nothing is told without.
    """

    def __init__(
        self, folder: Folder, own: Collection[int], complete: int, report: Callable[[], Report] | None
    ) -> None:
        self._folder, self._own, self._total = folder, own, len(own)
        self._report = report() if report else None
        self._before = self._ended = complete
        self._begun = time.monotonic()
        self._over = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        if self._report is not None:
            self._thread.start()
        return self

    def __exit__(self, *details: object) -> None:
        if self._report is not None:
            self._over.set()
            self._thread.join()
            self._advance()
            self._report.close()

    def note(self, line: str) -> None:
        """Tell one event."""
        if self._report is not None:
            with self._lock:
                self._report.note(line)

    def ended(self, outcome: Outcome) -> None:
        """Tell what became of a case."""
        if outcome.state == "stopped":
            return
        with self._lock:
            self._ended += 1
            place = f"{self._ended} of {self._total}"
        if outcome.state == "complete":
            remark = outcome.remark and f": {outcome.remark}"
            self.note(f"case {outcome.index:04d} complete in {duration(outcome.seconds)} ({place}){remark}")
        else:
            self.note(f"case {outcome.index:04d} FAILED ({place}): {outcome.reason}")

    def _watch(self) -> None:
        stopping = False
        while not self._over.wait(READ_INTERVAL):
            self._advance()
            if stop_requested() and not stopping:
                stopping = True
                self.note("stopping after the current time step")

    def _advance(self) -> None:
        try:
            at_work = [case for case in running(self._folder) if case.index in self._own]
        except OSError:  # the folder cannot be read for a while
            return
        done = min(self._ended + sum(case.fraction for case in at_work), self._total)
        rate = (done - self._before) / (time.monotonic() - self._begun)
        left = (self._total - done) / rate if rate > 0 else None
        if self._report is not None:
            with self._lock:
                self._report.advance(done, self._total, len(at_work), left)


def report_to(stream: TextIO = sys.stderr) -> Report:
    """Return a bar where the stream is a terminal, else a log."""
    return Bar() if stream.isatty() else Log(stream)


def duration(seconds: float) -> str:
    """Write a duration for people: 0.4 s, 12 s, 3 min 20 s, 5 h 10 min, 3 d 4 h."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    for unit, name, part, part_name in ((86400, "d", 3600, "h"), (3600, "h", 60, "min"), (60, "min", 1, "s")):
        if whole >= unit:
            return f"{whole // unit} {name} {whole % unit // part} {part_name}"
    return f"{whole} s"
