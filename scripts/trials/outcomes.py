"""How a trial ended, and limits of the time that it takes."""

from __future__ import annotations

import signal
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

GOOD = ("converged", "refused", "taken", "equal", "too long")


class Outcome(NamedTuple):
    """How a trial ended: a kind, the particulars, and what happened in it, counted."""

    kind: str
    text: str = ""
    events: Counter[str] = Counter()  # noqa: RUF012

    @property
    def good(self) -> bool:
        """Whether it ended as it must."""
        return self.kind in GOOD


class Wrong(Exception):  # noqa: N818
    """What must not happen: its kind and the particulars."""


class Hangs(Exception):  # noqa: N818
    """A trial takes longer than it may."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise `Hangs` in a block that takes longer than this of the processor's time."""

    def stop(*_: object) -> None:
        raise Hangs

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


class Patience:
    """A clock that does not count pauses of the machine: no look at it adds more than `TICK`."""

    TICK = 0.2

    def __init__(self, seconds: float) -> None:
        self.spent, self._most, self._last = 0.0, seconds, time.monotonic()

    def __bool__(self) -> bool:
        """Whether there is time left; waits for a moment."""
        time.sleep(0.01)
        now = time.monotonic()
        self.spent += min(now - self._last, self.TICK)
        self._last = now
        return self.spent < self._most
