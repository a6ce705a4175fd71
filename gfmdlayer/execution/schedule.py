"""Which case runs when, and by whom: the order, the hand-over, the stop.

The cases are given to a pool's executor in the order in which they come, the longest first: what is left at
the end is short.  A member with hands free takes pending ones over by cancelling their futures and running
them itself.  A request to stop, to whichever process it came, reaches all of them
through the folder's stop file.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue
from typing import Generic, Literal, Protocol, TypeVar

from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.interrupts import request_stop, stop_requested
from gfmdlayer.execution.workers import WorkerPool

POLL = 0.2  # seconds between two looks at the request to stop while others compute
AHEAD = 4  # cases a member given to those who do not keep a queue of any length


@dataclass(frozen=True)
class Outcome:
    """What became of a case.

    Attributes
    ----------
    index : int
        The case.
    state : str
        complete, failed (tried again by the next run), stopped or waiting (left to the next run).
    reason : str
        Why it failed.
    seconds : float
        How long it took.
    note : str
        What there is to know of a complete one.
    """

    index: int
    state: Literal["complete", "failed", "stopped", "waiting"]
    reason: str = ""
    seconds: float = 0.0
    note: str = ""


class Numbered(Protocol):
    """What can be scheduled."""

    @property
    def index(self) -> int:
        """Its number."""


Item = TypeVar("Item", bound=Numbered)


class Schedule(Generic[Item]):
    """Runs cases by a pool.

    Parameters
    ----------
    pool : WorkerPool
        Who runs them.
    task : callable
        Runs one case and returns its outcome; never raises, and returns at once after a request to stop.
    folder : Folder
        The results folder, through which processes elsewhere are told to stop.
    ended : callable
        Told each outcome at once, possibly from another thread.
    settled : queue, optional
        Where outcomes wait for the submitting thread; a simulation of the schedule brings its own.
    """

    def __init__(
        self,
        pool: WorkerPool,
        task: Callable[[Item], Outcome],
        folder: Folder,
        ended: Callable[[Outcome], None],
        settled: SimpleQueue[Outcome] | None = None,
    ) -> None:
        self._team, self._task, self._folder, self._ended = pool, task, folder, ended
        self._waiting: deque[Item] = deque()
        self._pending: deque[tuple[Item, Future[Outcome]]] = deque()
        self._settled = SimpleQueue() if settled is None else settled
        self._left: SimpleQueue[Item] = SimpleQueue()

    def run(self, items: Sequence[Item]) -> Iterator[Outcome]:
        """Run cases; yields their outcomes in the order in which they end."""
        self._waiting.extend(items)
        # Who joins in has no time to submit more; a pool of processes chokes on very many at once.
        self._submit(len(items) if self._team.joins else AHEAD * self._team.size)
        if self._team.joins:
            self._take_over()
        for _ in items:
            yield self._next()

    def _submit(self, number: int) -> None:
        for _ in range(min(number, len(self._waiting))):
            item = self._waiting.popleft()
            try:
                with self._team.starting():
                    future = self._team.executor.submit(self._task, item)
            except BrokenExecutor:
                self._settle(self._task(item))  # there is nobody else any more
                continue
            self._pending.append((item, future))
            future.add_done_callback(partial(self._when_done, item))

    def _take_over(self) -> None:
        """Take what is pending: in order when alone, off the tail beside others, who take it off the head."""
        while self._pending:
            item, future = self._pending.popleft() if self._team.alone else self._pending.pop()
            if future.cancel():
                self._settle(self._task(item))

    def _next(self) -> Outcome:
        while True:
            with suppress(Empty):
                self._waiting.appendleft(self._left.get_nowait())
                self._submit(1)
            if stop_requested():
                with suppress(OSError):  # signals alone must do then
                    self._folder.stop.touch()
                self._submit(len(self._waiting))
                self._take_over()  # no case is begun after a request to stop: this only settles them
            with suppress(Empty):
                outcome = self._settled.get(timeout=POLL)
                self._submit(1)
                return outcome

    def _when_done(self, item: Item, future: Future[Outcome]) -> None:
        if future.cancelled():
            return  # whoever cancelled it runs it
        error = future.exception()
        if error is None:
            self._settle(future.result())
        elif isinstance(error, BrokenExecutor) and not self._folder.case(item.index, "running").exists():
            self._left.put(item)  # a worker died over another case, and the others with it
        else:
            reason = f"the process that ran it ended: {type(error).__name__}: {error}"
            self._settle(Outcome(item.index, "failed", reason))

    def _settle(self, outcome: Outcome) -> None:
        if outcome.state == "stopped":
            request_stop()  # a signal may reach one process of many
        self._ended(outcome)
        self._settled.put(outcome)
