"""The time points of a run: equal steps, or steps that land on snapshots and kinks of the trajectory."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

from gfmdlayer.arrays import ComplexArray
from gfmdlayer.resumable import State

# Times closer than this part of the run are the same: output times carry the rounding of decimals and sums.
SAME_TIME = 1e-10


@dataclass(frozen=True)
class Instant:
    """A time point: its time, the length of the step to it, and whether it is a snapshot or a kink."""

    time: float
    step: float
    snapshot: bool = False
    kink: bool = False


class FixedSteps:
    """Steps that are known before the run; each is accepted."""

    def __init__(self, instants: Iterable[Instant]) -> None:
        self._instants = instants
        self._count = 0

    def __iter__(self) -> Iterator[Instant]:
        """Yield the time points in order."""
        yield from islice(self._instants, self._count, None)

    def accepts(self, _spectrum: ComplexArray, _response: float, _depth: float) -> bool:
        """Accept every step."""
        self._count += 1
        return True

    def state(self) -> State:
        """Return the number of accepted steps."""
        return {"count": self._count}

    def restore(self, state: State) -> None:
        """Continue after that number of steps."""
        self._count = int(state["count"])


def equal_steps(
    end: float, step: float, snapshots: Iterable[float], kinks: Iterable[float]
) -> Iterator[Instant]:
    """Every whole number of steps from 0 to the end, as in the paper; the first is a step from rest to t = 0.

    Parameters
    ----------
    end, step : float
        Last time and length of a step.
    snapshots : iterable of float
        Each a whole number of steps to a millionth of one, which the configuration checks.
    kinks : iterable of float
        The last time point at or before each is marked.
    """
    at_snapshot = {round(time / step) for time in snapshots}
    at_kink = {math.floor(time / step + 1e-6) for time in kinks}
    for i in range(round(end / step) + 1):
        yield Instant(i * step, step, i in at_snapshot, i in at_kink)


def landing_steps(
    end: float, step: float, snapshots: Iterable[float], kinks: Iterable[float]
) -> Iterator[Instant]:
    """Steps of at most a given length that land on every snapshot and kink; that to t = 0 has no length.

    Parameters
    ----------
    end, step : float
        Last time and largest length of a step.
    snapshots, kinks : iterable of float
        Times to land on.
    """
    first, *rest = stops(end, snapshots, kinks)
    yield first
    begin = 0.0
    for stop in rest:
        count = max(1, math.ceil((stop.time - begin) / step - 1e-6))
        length = (stop.time - begin) / count
        for i in range(1, count):
            yield Instant(begin + i * length, length)
        yield replace(stop, step=length)
        begin = stop.time


def stops(
    end: float, snapshots: Iterable[float], kinks: Iterable[float], times: Iterable[float] = ()
) -> list[Instant]:
    """Start, end and all times to land on between them, in order; times that differ by rounding are one.

    Parameters
    ----------
    end : float
        Last time, which is not a kink; neither is the start.
    snapshots, kinks, times : iterable of float
        Times to land on.

    Returns
    -------
    list of Instant
        Their steps have no length yet.
    """
    same = SAME_TIME * end
    found = [0.0]
    reasons: list[set[str]] = [set()]
    marked = [(time, "snapshot") for time in snapshots] + [(time, "kink") for time in kinks if 0 < time < end]
    for time, reason in sorted([*marked, *((time, "row") for time in (*times, end))]):
        # A time right after the start is moved away from it: the step to the start has no length.
        if time > 0 and max(time, 2 * same) - found[-1] > same:
            found.append(max(time, 2 * same))
            reasons.append(set())
        reasons[-1].add(reason)
    return [Instant(t, 0.0, "snapshot" in why, "kink" in why) for t, why in zip(found, reasons, strict=True)]
