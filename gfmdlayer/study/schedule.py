"""Scheduling cases on a pool of workers.

The cases are submitted to the pool's executor in the given order, the longest first, so that short ones are
left for the end (Graham 1966). Each is asked for when the executor holds too few, so that very many need not
exist at the same time. The submitting process computes too: it takes pending cases by cancelling their
futures. For the first `HEAD_START` it computes alone where workers take seconds to start, so that few small
cases are as fast as in one process. A request to stop, to any process, reaches all of them through the
folder's stop file.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue
from threading import RLock, Timer
from typing import Any, Literal, Protocol, TypeAlias

from gfmdlayer.files.locks import write_new
from gfmdlayer.study.claims import read_claim
from gfmdlayer.study.folder import Folder
from gfmdlayer.study.interrupts import request_stop, stop_requested
from gfmdlayer.study.workers import WorkerPool

POLL = 0.2  # seconds between two checks for a request to stop while workers compute
AHEAD = 4  # cases a worker that the executor holds, with the running one
HEAD_START = 1.0  # seconds before processes are started for the cases that are left


# Of a case: complete; or failed, stopped or waiting, which the next run computes; or at work in another run.
State: TypeAlias = Literal["complete", "failed", "stopped", "waiting", "elsewhere"]


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case."""

    index: int  # the case
    state: State
    reason: str = ""  # why it failed
    seconds: float = 0.0  # its duration
    note: str = ""  # a remark on a complete case
    here: bool = True  # whether this run has ended it, and not another one
    result: Any = None  # of a run in memory


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
        self._filling = RLock()  # other threads ask for cases too
        self._alone = pool.starts_late
        self._error: Exception | None = None  # of the items, or of the start of workers

    def run(self, items: Iterable[Numbered]) -> Iterator[Outcome]:
        """Run cases, each asked for in its turn; yields their outcomes in the order in which they end.

        An item may be the outcome of a case that cannot be run.
        """
        self._items = iter(items)
        if stop_requested():  # before the first case begins: no workers are started
            self._stop()
        start = Timer(HEAD_START, self._join)
        start.daemon = True
        if self._alone:
            start.start()
        try:
            self._fill()
            while self._open and self._error is None:
                if self._compute():
                    while not self._outcomes.empty():
                        yield self._taken(self._outcomes.get())
                else:
                    yield self._taken(self._next())
                self._pool.check()
                self._fill()
            if self._error is not None:
                raise self._error
        finally:
            start.cancel()

    def _join(self) -> None:
        """Let the workers in; the longest cases that this process has not begun are theirs."""
        with self._filling:
            self._alone = False
            for item, future in list(self._pending.values()):
                future.cancel()
                self._returned.put(item)
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
            for _ in range((1 if self._alone else AHEAD * self._pool.size) - len(self._pending)):
                try:
                    item = self._returned.get_nowait()
                except Empty:
                    try:
                        following = next(self._items, None)
                    except Exception as error:  # this may not be the thread of the run
                        self._error, following = error, None
                    if following is None:
                        return
                    item = following
                    self._open += 1
                if isinstance(item, Outcome):
                    self._end(item)
                else:
                    self._submit(item)

    def _submit(self, item: Numbered) -> None:
        future: Future[Outcome] = Future()  # until this process takes it
        if not self._alone:
            try:
                with suppress(BrokenExecutor), self._pool.starting():  # no workers are left
                    future = self._pool.executor.submit(self._task, item)
            except Exception as error:  # of the machine
                self._error = error
        self._pending[item.index] = item, future
        future.add_done_callback(partial(self._when_done, item))

    def _compute(self) -> bool:
        """Compute a pending case here: the first when alone, else the last, as workers take the first."""
        item = self._pick()
        if item is None:
            return False
        self._here = item.index
        self._fill()
        self._end(self._task(item))
        self._here = None
        return True

    def _pick(self) -> Numbered | None:
        with self._filling:
            pending = list(self._pending.values())
            for item, future in pending if self._pool.alone else reversed(pending):
                if future.cancel():
                    return item
        return None

    def _next(self) -> Outcome:
        while True:
            if stop_requested():
                self._stop()
            if self._error is not None:
                raise self._error
            with suppress(Empty):
                return self._outcomes.get(timeout=POLL)
            self._pool.check()
            self._fill()
            self._compute()  # what no worker takes any more

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
        elif isinstance(error, BrokenExecutor) and not self._has_died(item.index):
            self._returned.put(item)  # its worker died with another case
        else:
            self._end(Outcome(item.index, "failed", f"its process ended: {type(error).__name__}: {error}"))
        # The thread of the run may compute for long; that of a broken executor must not submit to it.
        if error is None:
            self._fill()
        else:
            Timer(0.0, self._fill).start()

    def _has_died(self, index: int) -> bool:
        """Whether the process of a case has ended without giving its claim back."""
        claim = read_claim(self._folder.case(index, "running"))
        end = time.monotonic() + POLL  # it may still be ending
        while claim is not None and claim.alive(0.0) and time.monotonic() < end:
            time.sleep(POLL / 10)
        return claim is not None and not claim.alive(0.0)

    def _end(self, outcome: Outcome) -> None:
        if outcome.state == "stopped":
            request_stop()  # a signal may have reached one process of many
        self._ended(outcome)
        self._outcomes.put(outcome)
