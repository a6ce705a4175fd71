"""Progress of a run, shown on a terminal or written to a log."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Self, TextIO

from gfmdlayer.files.locks import printable
from gfmdlayer.results.provenance import duration
from gfmdlayer.study.claims import Running, running
from gfmdlayer.study.folder import Folder
from gfmdlayer.study.interrupts import stop_requested
from gfmdlayer.study.schedule import Outcome

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

READ_INTERVAL = 0.5  # seconds between two readings of the status files
LOG_INTERVAL = 5.0  # seconds between two lines in a log, more in a long run
PREPARATION = 2.0  # seconds of preparation that pass in silence: most kernels are compiled already
MEASURED = 0.05  # of the first cases, before the time that is left is known
SHOWN_ENDS = 20  # ends of cases that get a line of their own, of complete and of failed ones each

_BAR_WIDTH = 24
_CASE_LINES = 12  # running cases on a terminal, at most
_OTHER_LINES = 6  # of the terminal, left free


@dataclass(frozen=True)
class Progress:
    """Progress of a run."""

    total: int  # numbers of cases; those complete before the run are counted
    complete: int
    failed: int = 0
    at_work: tuple[Running, ...] = ()  # the running cases
    seconds_left: float | None = None  # time left at the pace so far; None before any progress
    slowest: Outcome | None = None  # the case of this run that took longest so far
    least: float = 0.0  # part that was done before: a case that has just ended may not be counted yet

    @property
    def done(self) -> float:
        """Number of cases done, fractions of running ones included."""
        parts = sum(case.effort for case in self.at_work)
        return min(self.complete + self.failed + parts, self.total)

    @property
    def fraction(self) -> float:
        """The part of all cases that is done."""
        return max(self.done / self.total, self.least)

    @property
    def words(self) -> str:
        """A line on the whole run."""
        slowest = ""
        if self.slowest is not None and self.complete + self.failed > 1:
            slowest = f"slowest {self.slowest.index:04d} in {duration(self.slowest.seconds)}"
        parts = (
            f"{self.complete} of {self.total} complete",
            f"{len(self.at_work)} running" if self.at_work else "",
            f"{self.failed} failed" if self.failed else "",
            f"{duration(self.seconds_left)} left" if self.seconds_left else "",
            slowest,
        )
        return ", ".join(filter(None, parts))


class Display:
    """Shows progress; this base shows nothing. Complete cases get a line where `lists_complete`."""

    lists_complete = False

    def note(self, line: str) -> None:
        """Show an event."""

    def advance(self, progress: Progress) -> None:
        """Show the progress of the run."""

    def close(self) -> None:
        """Stop moving lines; notes may follow."""


class Log(Display):
    """Plain lines with the time, for a file: so few that the log of any run can be read."""

    lists_complete = True

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._begun = self._last = time.monotonic()

    def note(self, line: str) -> None:
        """Write one line."""
        with suppress(OSError):  # the reader of a pipe may have gone; the run continues
            self._stream.write(f"{time.strftime('%Y-%m-%d %H:%M:%S')}  {printable(line)}\n")
            self._stream.flush()

    def advance(self, progress: Progress) -> None:
        """Write a line if the last one is some time ago."""
        now = time.monotonic()
        if now - self._last >= max(LOG_INTERVAL, (now - self._begun) / 50):
            self._last = now
            self.note(f"{progress.fraction:.0%}: {progress.words}")


class Screen(Display):
    """Moving lines on a terminal: one for each running case, one for all cases; failures above them."""

    def __init__(self, console: Console | None = None) -> None:
        from rich.console import Console
        from rich.live import Live

        self._live = Live(console=console or Console(stderr=True), auto_refresh=False)
        self._live.start()

    def note(self, line: str) -> None:
        """Write one line above the moving ones."""
        self._live.console.print(printable(line), markup=False, highlight=False)

    def advance(self, progress: Progress) -> None:
        """Update the moving lines."""
        self._live.update(self._lines(progress), refresh=True)

    def close(self) -> None:
        """Leave the lines as they are."""
        self._live.stop()

    def _lines(self, progress: Progress) -> RenderableType:
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        def row(name: str, fraction: float, *texts: str) -> tuple[RenderableType, ...]:
            bar = ProgressBar(total=1.0, completed=fraction, width=_BAR_WIDTH)
            cells = [Text(printable(text), no_wrap=True, overflow="ellipsis") for text in texts]
            return Text(name), bar, Text(f"{fraction:4.0%}"), *cells

        room = max(min(_CASE_LINES, self._live.console.height - _OTHER_LINES), 1)
        shown = sorted(progress.at_work, key=lambda case: case.effort)[:room]
        cases, total = Table.grid(padding=(0, 2)), Table.grid(padding=(0, 2))
        for case in sorted(shown, key=lambda case: case.index):
            left = "" if case.seconds_left is None else f"{duration(case.seconds_left)} left"
            reached = f"time {case.simulated_time:.3g} of {case.end:g}"
            cases.add_row(*row(f"{case.index:04d}", case.effort, reached, left, case.label))
        others = len(progress.at_work) - len(shown)
        more = [Text(f"      and {others} more at work")] if others else []
        total.add_row(*row(" all", progress.fraction), Text(progress.words))
        return Group(cases, *more, total)


class Reporter:
    """Watches a run and updates a display; a context manager around the run, with a thread of its own.

    `own` are the cases of this run, `complete` were so before; `seconds` are expected for each case, `whole`
    for all; `workers` run at a time. `at_work` returns the numbers of the cases whose status is shown, and
    `claims` the status of these, or of all.
    """

    def __init__(
        self,
        folder: Folder,
        own: Collection[int],
        complete: int,
        display: Callable[[], Display] | None = None,
        seconds: Mapping[int, float] | None = None,
        workers: int = 1,
        whole: float | None = None,
    ) -> None:
        self.at_work: Callable[[], Iterable[int]] = lambda: folder.numbers()["running"]
        self.claims: Callable[[Iterable[int] | None], list[Running]] = partial(running, folder)
        self._whole = sum((seconds or {}).values()) if whole is None else whole
        self._own, self._total = own, len(own)
        self._seconds, self._workers, self._ended = seconds, workers, 0.0
        self._display = Display() if display is None else display()
        self._before = self._complete = complete
        self._failed = 0
        self._slowest: Outcome | None = None
        self._least = 0.0
        self._begun = self._ready = time.monotonic()
        self._over = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *details: object) -> None:
        self._over.set()
        self._thread.join()
        self._advance()
        self._display.close()
        if self._slowest is not None:
            ended = self._complete + self._failed - self._before
            failed = f", {self._failed} of them FAILED" if self._failed else ""
            took = duration(time.monotonic() - self._begun)
            longest = f"slowest {self._slowest.index:04d} in {duration(self._slowest.seconds)}"
            self._display.note(f"{ended} case{'s' * (ended > 1)} ended in {took}{failed}; {longest}")

    def note(self, line: str) -> None:
        """Show an event."""
        with self._lock:
            self._display.note(line)

    @contextmanager
    def preparing(self, work: str) -> Iterator[None]:
        """Show that `work` goes on in the block, and how long it took, unless it takes less than 2 s."""
        begun, start = time.monotonic(), threading.Timer(PREPARATION, self.note, [work])
        start.start()
        try:
            yield
        finally:
            start.cancel()
        self._ready = time.monotonic()
        if (taken := time.monotonic() - begun) > PREPARATION and not stop_requested():
            self.note(f"kernels and transforms are ready after {duration(taken)}")

    def ended(self, outcome: Outcome) -> None:
        """Show the outcome of a case."""
        if outcome.state in {"stopped", "elsewhere"}:
            return
        failed = outcome.state == "failed"
        with self._lock:
            self._complete += not failed
            self._failed += failed
            self._ended += (self._seconds or {}).get(outcome.index, 0.0)
            if self._slowest is None or outcome.seconds > self._slowest.seconds:
                self._slowest = outcome
            number = self._failed if failed else self._complete - self._before
            if outcome.here and number <= SHOWN_ENDS + 1 and (failed or self._display.lists_complete):
                rest = f"further cases that {'fail' if failed else 'are complete'} are only counted"
                self._display.note(self._end(outcome) if number <= SHOWN_ENDS else rest)

    def complete_no_more(self, number: int) -> None:
        """Take note of cases that were taken to be complete before, and are not."""
        with self._lock:
            self._complete -= number
            self._before -= number

    def _end(self, outcome: Outcome) -> str:
        place = f"{self._complete + self._failed} of {self._total}"
        if outcome.state == "failed":
            return f"case {outcome.index:04d} FAILED ({place}): {outcome.reason}"
        note = outcome.note and f": {outcome.note}"
        return f"case {outcome.index:04d} complete in {duration(outcome.seconds)} ({place}){note}"

    def _watch(self) -> None:
        stopping = False
        while not self._over.wait(READ_INTERVAL):
            self._advance()
            if stop_requested() and not stopping:
                stopping = True
                self.note("stopping after the current time step")

    def _advance(self) -> None:
        try:
            shown = [number for number in self.at_work() if number in self._own]
            at_work = self.claims(shown)
        except OSError:  # the folder may be unreadable for a while
            return
        with self._lock:
            progress = self._progress(tuple(at_work))
            self._display.advance(progress)
            self._least = progress.fraction

    def _progress(self, at_work: tuple[Running, ...]) -> Progress:
        now = Progress(self._total, self._complete, self._failed, at_work, None, self._slowest, self._least)
        spent = time.monotonic() - self._ready
        if self._seconds is None:
            rate = (now.done - self._before) / spent if spent > 0 else 0.0
            return replace(now, seconds_left=(self._total - now.done) / rate) if rate > 0 else now
        # The expected seconds weigh the cases against each other; the pace is only what was measured.
        done = self._ended + sum(case.effort * self._seconds.get(case.index, 0.0) for case in at_work)
        under_way = sum(self._seconds.get(case.index, 0.0) for case in at_work)
        if done <= 0 or (not self._ended and done < MEASURED * under_way):
            return now  # adaptive steps begin with short ones
        ratio = self._workers * spent / done
        workers = max(1, min(self._workers, self._total - now.complete - now.failed))
        return replace(now, seconds_left=max(self._whole - done, 0.0) * ratio / workers)


def make_display(stream: TextIO = sys.stderr) -> Display:
    """Return moving lines where the stream is a terminal, else a log."""
    return Screen() if stream.isatty() else Log(stream)
