"""The time points of a run: equal steps, or steps that land where something happens."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

from gfmdlayer.arrays import ComplexArray
from gfmdlayer.resumable import State

# Times closer than this part of the run are the same: asked times are written and counted up with rounding.
SAME_TIME = 1e-10


@dataclass(frozen=True)
class Instant:
    """One time point: when, how long after the one before, and what is special about it."""

    time: float
    step: float
    snapshot: bool = False
    kink: bool = False


class FixedSteps:
    """Steps that are known beforehand, each of which is accepted."""

    def __init__(self, instants: Iterable[Instant]) -> None:
        self._instants = instants
        self._given = 0

    def __iter__(self) -> Iterator[Instant]:
        """Give the time points in order."""
        for instant in islice(self._instants, self._given, None):
            self._given += 1
            yield instant

    def accepts(self, _spectrum: ComplexArray, _found: float, _depth: float) -> bool:
        """Say yes."""
        return True

    def state(self) -> State:
        """Return how many steps were given out."""
        return {"given": self._given}

    def restore(self, state: State) -> None:
        """Go on from there."""
        self._given = int(state["given"])


def equal_steps(
    end: float, step: float, snapshots: Iterable[float], kinks: Iterable[float]
) -> Iterator[Instant]:
    """Every whole number of steps from 0 to the end, as in the paper; the first is a step from rest as well.

    Snapshots are the steps within a millionth of a step of an asked time; the configuration is refused unless
    there are such.
    """
    asked = {round(time / step) for time in snapshots}
    turns = {math.floor(time / step + 1e-6) for time in kinks}
    for i in range(round(end / step) + 1):
        yield Instant(i * step, step, i in asked, i in turns)


def landing_steps(
    end: float, step: float, snapshots: Iterable[float], kinks: Iterable[float]
) -> Iterator[Instant]:
    """Steps of at most the given length that land on every snapshot and kink; that to t = 0 has none."""
    first, *rest = stops(end, snapshots, kinks)
    yield Instant(0.0, 0.0, first.snapshot)
    begin = 0.0
    for stop in rest:
        count = max(1, math.ceil((stop.time - begin) / step - 1e-6))
        length = (stop.time - begin) / count
        for i in range(1, count):
            yield Instant(begin + i * length, length)
        yield Instant(stop.time, length, stop.snapshot, stop.kink)
        begin = stop.time


@dataclass(frozen=True)
class Stop:
    """A time that a step must end at, and why."""

    time: float
    snapshot: bool
    kink: bool


def stops(
    end: float, snapshots: Iterable[float], kinks: Iterable[float], times: Iterable[float] = ()
) -> list[Stop]:
    """The start, the end, and every snapshot, kink and other asked time between them, in order.

    Times that differ by rounding are one. The end of the run is no kink.
    """
    same = SAME_TIME * end
    kept = [0.0]
    reasons: list[set[str]] = [set()]
    asked = [(time, "snapshot") for time in snapshots] + [(time, "kink") for time in kinks if time < end]
    for time, reason in sorted([*asked, *((time, "row") for time in (*times, end))]):
        # What comes right after the start is moved away from it, and not into it.
        if time > 0 and max(time, 2 * same) - kept[-1] > same:
            kept.append(max(time, 2 * same))
            reasons.append(set())
        reasons[-1].add(reason)
    return [Stop(t, "snapshot" in why, "kink" in why) for t, why in zip(kept, reasons, strict=True)]
