"""Progress of a run, told to a terminal or a log."""

from __future__ import annotations

import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Protocol, Self, TextIO

from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.interrupts import stop_requested
from gfmdlayer.execution.schedule import Outcome
from gfmdlayer.execution.status_file import Running, running

READ_INTERVAL = 0.5  # seconds between two looks at the status files
LOG_INTERVAL = 5.0  # seconds between two lines in a log, more in a long run


TOLD = 20  # cases whose end is told one by one, complete ones and failed ones each


@dataclass(frozen=True)
class Progress:
    """How far a run is.

    Attributes
    ----------
    total, complete, failed : int
        Numbers of cases; those complete before the run are counted.
    at_work : tuple of Running
        The cases that some process is at.
    begun : bool
        Whether any case of the run was begun.
    seconds_left : float or None
        Time left by the pace so far; None where there is none yet.
    slowest : Outcome or None
        The case of this run that took longest, of those that have ended.
    """

    total: int
    complete: int
    failed: int = 0
    at_work: tuple[Running, ...] = ()
    begun: bool = True
    seconds_left: float | None = None
    slowest: Outcome | None = None

    @property
    def done(self) -> float:
        """How many cases are done, parts of those at work included."""
        parts = sum(case.fraction for case in self.at_work)
        return min(self.complete + self.failed + parts, self.total)

    @property
    def fraction(self) -> float:
        """The part of all cases that is done."""
        return self.done / self.total

    @property
    def words(self) -> str:
        """All of this but the cases at work one by one, in a line."""
        if not self.begun:
            return "making ready; kernels are compiled where they were not before"
        slowest = self.slowest and f"slowest {self.slowest.index:04d} in {duration(self.slowest.seconds)}"
        parts = (
            f"{self.complete} of {self.total} complete",
            f"{len(self.at_work)} running" if self.at_work else "",
            f"{self.failed} failed" if self.failed else "",
            f"{duration(self.seconds_left)} left" if self.seconds_left else "",
            slowest or "",
        )
        return ", ".join(filter(None, parts))


class Report(Protocol):
    """Where progress is told."""

    def note(self, line: str) -> None:
        """Tell one event."""

    def ended(self, line: str, *, failed: bool) -> None:
        """Tell the end of a case."""

    def advance(self, progress: Progress) -> None:
        """Tell how far the run is."""

    def close(self) -> None:
        """Nothing more will be told."""


class Log:
    """Plain lines with the time, for a file: so few that a run of any size and length can be read."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._begun = self._last = time.monotonic()
        self._ended = Counter[bool]()

    def note(self, line: str) -> None:
        """Write one line."""
        with suppress(OSError):  # nobody reads the log any more; the run goes on
            self._stream.write(f"{time.strftime('%Y-%m-%d %H:%M:%S')}  {line}\n")
            self._stream.flush()

    def ended(self, line: str, *, failed: bool) -> None:
        """Write of the first cases how they ended; the lines of `advance` count the rest."""
        self._ended[failed] += 1
        if self._ended[failed] <= TOLD:
            self.note(line)
        elif self._ended[failed] == TOLD + 1:
            self.note(f"further cases that {'fail' if failed else 'are complete'} are only counted")

    def advance(self, progress: Progress) -> None:
        """Write a line, unless there was one just before."""
        now = time.monotonic()
        if now - self._last >= max(LOG_INTERVAL, (now - self._begun) / 50):
            self._last = now
            self.note(f"{progress.fraction:.0%}: {progress.words}")

    def close(self) -> None:
        """Do nothing: every line is written already."""


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
        self._before = self._complete = complete
        self._failed = 0
        self._slowest: Outcome | None = None
        self._seen = False  # whether any case was begun
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
            if self._slowest is not None:
                self._report.note(self._summary(self._slowest))

    def note(self, line: str) -> None:
        """Tell one event."""
        if self._report is not None:
            with self._lock:
                self._report.note(line)

    def ended(self, outcome: Outcome) -> None:
        """Tell what became of a case."""
        if outcome.state == "stopped" or self._report is None:
            return
        failed = outcome.state == "failed"
        with self._lock:
            self._complete += not failed
            self._failed += failed
            if self._slowest is None or outcome.seconds > self._slowest.seconds:
                self._slowest = outcome
            place = f"{self._complete + self._failed} of {self._total}"
            if failed:
                line = f"case {outcome.index:04d} FAILED ({place}): {outcome.reason}"
            else:
                note = outcome.note and f": {outcome.note}"
                line = f"case {outcome.index:04d} complete in {duration(outcome.seconds)} ({place}){note}"
            self._report.ended(line, failed=failed)

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
        if self._report is not None:
            with self._lock:
                self._report.advance(self._progress(tuple(at_work)))

    def _progress(self, at_work: tuple[Running, ...]) -> Progress:
        self._seen = self._seen or bool(at_work) or self._slowest is not None
        begun = self._seen or self._complete == self._total
        now = Progress(self._total, self._complete, self._failed, at_work, begun, slowest=self._slowest)
        rate = (now.done - self._before) / (time.monotonic() - self._begun)
        return replace(now, seconds_left=(self._total - now.done) / rate) if rate > 0 else now

    def _summary(self, slowest: Outcome) -> str:
        ended = self._complete + self._failed - self._before
        failed = f", {self._failed} of them FAILED" if self._failed else ""
        took = duration(time.monotonic() - self._begun)
        longest = f"slowest {slowest.index:04d} in {duration(slowest.seconds)}"
        return f"{ended} case{'s' * (ended > 1)} ended in {took}{failed}; {longest}"


def report_to(stream: TextIO = sys.stderr) -> Report:
    """Return lines that move where the stream is a terminal, else a log."""
    if not stream.isatty():
        return Log(stream)
    from gfmdlayer.execution.screen import Screen

    return Screen()


def duration(seconds: float) -> str:
    """Write a duration for people: 0.4 s, 12 s, 3 min 20 s, 5 h 10 min, 3 d 4 h."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    for unit, name, part, part_name in ((86400, "d", 3600, "h"), (3600, "h", 60, "min"), (60, "min", 1, "s")):
        if whole >= unit:
            return f"{whole // unit} {name} {whole % unit // part} {part_name}"
    return f"{whole} s"
