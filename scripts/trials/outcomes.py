"""The outcome of a trial, and limits of its time."""

from __future__ import annotations

import signal
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

GOOD = ("converged", "failed in words", "refused", "taken", "equal", "too long")


class Outcome(NamedTuple):
    """The outcome of a trial: its kind, details, and counts of events."""

    kind: str
    text: str = ""
    events: Counter[str] = Counter()  # noqa: RUF012

    @property
    def good(self) -> bool:
        """Whether this outcome is allowed."""
        return self.kind in GOOD


class Wrong(Exception):  # noqa: N818
    """A forbidden outcome: its kind and details."""


class Hangs(Exception):  # noqa: N818
    """A trial takes too long."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise `Hangs` in a block that needs more than this processor time."""

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
    """A clock that ignores pauses of the machine: each reading adds at most `TICK`."""

    TICK = 0.2

    def __init__(self, seconds: float) -> None:
        self.spent, self._most, self._last = 0.0, seconds, time.monotonic()

    def __bool__(self) -> bool:
        """Wait for a moment; return whether time is left."""
        time.sleep(0.01)
        now = time.monotonic()
        self.spent += min(now - self._last, self.TICK)
        self._last = now
        return self.spent < self._most
