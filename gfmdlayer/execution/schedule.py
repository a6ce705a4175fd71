"""Scheduling cases on a pool of workers.

The cases are submitted to the pool's executor in the given order, the longest first, so that short ones are
left for the end (Graham 1966). The submitting process computes too where the pool says so: it takes pending
cases by cancelling their futures. A request to stop, to any process, reaches all of them through the folder's
stop file.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, Literal, Protocol

from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.interrupts import request_stop, stop_requested
from gfmdlayer.execution.status import Running, duration
from gfmdlayer.execution.workers import WorkerPool
from gfmdlayer.files.locks import write_new

POLL = 0.2  # seconds between two checks for a request to stop while workers compute
AHEAD = 4  # cases a worker submitted ahead, where the submitting process only waits


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case."""

    index: int  # the case
    # complete; or failed, stopped or waiting, which the next run computes
    state: Literal["complete", "failed", "stopped", "waiting"]
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


class Labelled(Numbered, Protocol):
    """An item with values that distinguish it from the others."""

    @property
    def values(self) -> dict[str, object]:
        """Values by their names."""


class Schedule:
    """Runs cases by a pool.

    `task` runs one case; it never raises, and returns at once after a request to stop. `ended` gets each
    outcome at once, possibly from another thread. A simulated clock brings its own queue of `outcomes`.
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
        self._waiting: deque[Numbered] = deque()
        self._pending: deque[tuple[Numbered, Future[Outcome]]] = deque()
        self._outcomes = SimpleQueue() if outcomes is None else outcomes
        self._returned: SimpleQueue[Numbered] = SimpleQueue()

    def run(self, items: Sequence[Numbered]) -> Iterator[Outcome]:
        """Run cases; yields their outcomes in the order in which they end."""
        if stop_requested():  # before the first case begins: no workers are started
            for item in items:
                self._end(Outcome(item.index, "stopped"))
                yield self._outcomes.get()
            return
        self._waiting.extend(items)
        # A submitting thread that computes has no time to submit more; a pool of processes is slow with many.
        self._submit(len(items) if self._pool.joins else AHEAD * self._pool.size)
        if self._pool.joins:
            self._take_over()
        for _ in items:
            yield self._next()

    def _submit(self, number: int) -> None:
        for _ in range(min(number, len(self._waiting))):
            item = self._waiting.popleft()
            try:
                with self._pool.starting():
                    future = self._pool.executor.submit(self._task, item)
            except BrokenExecutor:
                self._end(self._task(item))  # no workers are left
                continue
            self._pending.append((item, future))
            future.add_done_callback(partial(self._when_done, item))

    def _take_over(self) -> None:
        """Compute pending cases here: in order when alone, else from the tail, as workers take the head."""
        while self._pending:
            item, future = self._pending.popleft() if self._pool.alone else self._pending.pop()
            if future.cancel():
                self._end(self._task(item))

    def _next(self) -> Outcome:
        while True:
            with suppress(Empty):
                self._waiting.appendleft(self._returned.get_nowait())
                self._submit(1)
            if stop_requested():
                with suppress(OSError):  # there is one, or signals must do
                    write_new(self._folder.stop, b"")
                self._submit(len(self._waiting))
                self._take_over()  # no case begins after a request to stop: they end at once
            with suppress(Empty):
                outcome = self._outcomes.get(timeout=POLL)
                self._submit(1)
                return outcome
            self._pool.check()

    def _when_done(self, item: Numbered, future: Future[Outcome]) -> None:
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

    def _end(self, outcome: Outcome) -> None:
        if outcome.state == "stopped":
            request_stop()  # a signal may have reached one process of many
        self._ended(outcome)
        self._outcomes.put(outcome)
