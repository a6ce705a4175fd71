"""Scheduling cases on a pool of workers.

The cases are submitted to the pool's executor in the given order, the longest first, so that short ones are
left for the end (Graham 1966). Each is asked for when the executor holds too few, so that very many need not
exist at the same time. The submitting process computes too where the pool says so: it takes pending cases by
cancelling their futures. A request to stop, to any process, reaches all of them through the folder's stop
file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue
from threading import RLock
from typing import Any, Literal, Protocol, TypeAlias

from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.interrupts import request_stop, stop_requested
from gfmdlayer.execution.status import Running, duration
from gfmdlayer.execution.workers import WorkerPool
from gfmdlayer.files.locks import write_new

POLL = 0.2  # seconds between two checks for a request to stop while workers compute
AHEAD = 4  # cases a worker that the executor holds, with the running one


# Of a case: complete; or failed, stopped or waiting, which the next run computes.
State: TypeAlias = Literal["complete", "failed", "stopped", "waiting"]


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case."""

    index: int  # the case
    state: State
    reason: str = ""  # why it failed
    seconds: float = 0.0  # its duration
    note: str = ""  # a remark on a complete case


@dataclass(frozen=True)
class Progress:
    """Progress of a run."""

    total: int  # numbers of cases; those complete before the run are counted
    complete: int
    failed: int = 0
    at_work: tuple[Running, ...] = ()  # the running cases
    seconds_left: float | None = None  # time left at the pace so far; None before any progress
    slowest: Outcome | None = None  # the case of this run that took longest so far

    @property
    def done(self) -> float:
        """Number of cases done, fractions of running ones included."""
        parts = sum(case.fraction for case in self.at_work)
        return min(self.complete + self.failed + parts, self.total)

    @property
    def fraction(self) -> float:
        """The part of all cases that is done."""
        return self.done / self.total

    @property
    def words(self) -> str:
        """A line on the whole run."""
        slowest = self.slowest and f"slowest {self.slowest.index:04d} in {duration(self.slowest.seconds)}"
        parts = (
            f"{self.complete} of {self.total} complete",
            f"{len(self.at_work)} running" if self.at_work else "",
            f"{self.failed} failed" if self.failed else "",
            f"{duration(self.seconds_left)} left" if self.seconds_left else "",
            slowest or "",
        )
        return ", ".join(filter(None, parts))


class Numbered(Protocol):
    """An item that can be scheduled."""

    @property
    def index(self) -> int:
        """Number of the case."""


class Schedule:
    """Runs cases by a pool.

    `task` runs one case and never raises. `ended` gets each outcome at once, possibly from another thread.
    """

    def __init__(
        self,
        pool: WorkerPool,
        task: Callable[[Any], Outcome],
        folder: Folder,
        ended: Callable[[Outcome], None],
        outcomes: SimpleQueue[Outcome] | None = None,
    ) -> None:
        self._pool, self._task, self._folder, self._ended = pool, task, folder, ended
        self._items: Iterator[Numbered] = iter(())
        self._open = 0  # cases asked for, whose outcomes are not yielded yet
        self._pending: dict[int, tuple[Numbered, Future[Outcome]]] = {}  # in the executor, by number
        self._here: int | None = None  # the case that this process computes
        self._outcomes = SimpleQueue() if outcomes is None else outcomes
        self._returned: SimpleQueue[Numbered] = SimpleQueue()
        self._filling = RLock()  # the executor's thread asks for cases too

    def run(self, items: Iterable[Numbered]) -> Iterator[Outcome]:
        """Run cases, each asked for in its turn; yields their outcomes in the order in which they end.

        An item may be the outcome of a case that cannot be run.
        """
        self._items = iter(items)
        if stop_requested():  # before the first case begins: no workers are started
            self._stop()
        self._fill()
        while self._open:
            if self._pool.joins and self._compute():
                while not self._outcomes.empty():
                    yield self._taken(self._outcomes.get())
            else:
                yield self._taken(self._next())
            self._fill()

    def at_work(self) -> list[int]:
        """Return the numbers of the cases that are being computed; some others may have just ended."""
        here = [] if self._here is None else [self._here]
        return here + [index for index, (_, future) in list(self._pending.items()) if future.running()]

    def _taken(self, outcome: Outcome) -> Outcome:
        with self._filling:
            self._open -= 1
        return outcome

    def _fill(self) -> None:
        """Submit cases until the executor holds enough."""
        with self._filling:
            for _ in range(AHEAD * self._pool.size - len(self._pending)):
                try:
                    item = self._returned.get_nowait()
                except Empty:
                    if (following := next(self._items, None)) is None:
                        return
                    item = following
                    self._open += 1
                if isinstance(item, Outcome):
                    self._end(item)
                else:
                    self._submit(item)

    def _submit(self, item: Numbered) -> None:
        try:
            with self._pool.starting():
                future = self._pool.executor.submit(self._task, item)
        except BrokenExecutor:
            self._end(self._task(item))  # no workers are left
            return
        self._pending[item.index] = item, future
        future.add_done_callback(partial(self._when_done, item))

    def _compute(self) -> bool:
        """Compute a pending case here: the first when alone, else the last, as workers take the first."""
        found = list(self._pending)
        for index in found if self._pool.alone else reversed(found):
            item, future = self._pending.get(index, (None, None))
            if item is not None and future is not None and future.cancel():
                self._here = index
                self._fill()
                self._end(self._task(item))
                self._here = None
                return True
        return False

    def _next(self) -> Outcome:
        while True:
            if stop_requested():
                self._stop()
            with suppress(Empty):
                return self._outcomes.get(timeout=POLL)
            self._pool.check()
            self._fill()

    def _stop(self) -> None:
        """End the cases that have not begun, and ask all processes to end the others."""
        if self._pending:
            with suppress(OSError):  # there is one, or signals must do
                write_new(self._folder.stop, b"")
        while self._compute():  # it ends at once
            pass
        with self._filling:
            for item in self._items:
                self._open += 1
                self._end(Outcome(item.index, "stopped"))

    def _when_done(self, item: Numbered, future: Future[Outcome]) -> None:
        self._pending.pop(item.index, None)
        if future.cancelled():
            return  # taken over by this process
        error = future.exception()
        if error is None:
            self._end(future.result())
        elif isinstance(error, BrokenExecutor) and not self._folder.case(item.index, "running").exists():
            self._returned.put(item)  # its worker died with another case
        else:
            reason = f"its process ended: {type(error).__name__}: {error}"
            self._end(Outcome(item.index, "failed", reason))
        if self._pool.joins:  # the submitting thread may compute for long
            self._fill()

    def _end(self, outcome: Outcome) -> None:
        if outcome.state == "stopped":
            request_stop()  # a signal may have reached one process of many
        self._ended(outcome)
        self._outcomes.put(outcome)
