"""The time points of a run: equal steps, or steps that land on snapshots and breakpoints of the drives."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise, repeat
from typing import Any

from gfmdlayer.made_once import made_once
from gfmdlayer.resumable import Saving
from gfmdlayer.step import Instant

# Times closer than this part of the run are the same: output times are rounded decimals and sums.
SAME_TIME = 1e-10

_BYTES = 200  # of a stop, with the times from which it is found


@dataclass(frozen=True)
class Course:
    """Steps up to a time that do not depend on the end of the run: a longer run may begin with them."""

    time: float
    passed: int  # number of stops up to the time
    stops: str  # their fingerprint
    reach: float = 0.0  # a next stop before this time would have changed the steps since the last stop
    step: float = 0.0  # length of the steps since the last stop, if it is fixed and there are any; else 0

    def begins(self, stops: Sequence[Instant]) -> bool:
        """Return whether a run with these stops takes the same steps up to the time."""
        if len(stops) <= self.passed or fingerprint(stops[: self.passed]) != self.stops:
            return False
        following = stops[self.passed]
        # A margin for rounding: a step is compared with half of the rest, and the rest is a difference.
        is_free = following.time > self.time and following.time >= self.reach * (1 + SAME_TIME)
        return is_free and self.step in {0.0, following.step}


def fingerprint(stops: Iterable[Instant]) -> str:
    """Return a hash of the stops, exact to the last bit."""
    every = [(stop.time, stop.step, stop.snapshot, stop.breakpoint) for stop in stops]
    return hashlib.sha256(repr(every).encode()).hexdigest()


class FixedSteps(Saving):
    """Steps that are known before the run; each is accepted."""

    KEPT = ("count",)  # of accepted steps

    def __init__(self, instants: Iterable[Instant], stops: Sequence[Instant], step: float) -> None:
        # Between two of the `stops` all steps have the length of the later one, at most `step`.
        self._instants, self._stops = instants, stops
        self._count = 0
        # Steps of the largest length suit a later end too; others were fitted to this end.
        whole = stops[-1].step == step
        self._parting = number_of_steps(stops if whole else stops[:-1]) + (not whole)

    def __iter__(self) -> Iterator[Instant]:
        """Yield the time points in order."""
        for point in islice(self._instants, self._count, None):
            self._time = point.time
            yield point

    def accepts(self, *_: Any) -> bool:
        """Accept every step."""
        return True

    def weigh(self, _row: Mapping[str, float]) -> None:
        """Take the step as it is."""

    def advance(self, steps: int = 1) -> None:
        """Go on behind the last steps."""
        self._count += steps

    def course(self) -> Course | None:
        """Return the course, see `AdaptiveSteps.course`, before the last step at the latest."""
        time = self._time
        if self._count != self._parting or time == 0:
            return None
        passed = sum(stop.time <= time for stop in self._stops)
        begun = passed == 0 or self._stops[passed - 1].time < time
        step = self._stops[passed].step if begun else 0.0
        return Course(time, passed, fingerprint(self._stops[:passed]), step=step)


def equal_steps(
    end: float, step: float, snapshots: Iterable[float], breakpoints: Iterable[float]
) -> Iterator[Instant]:
    """Yield every whole number of steps from 0 to the end, as in the paper; the first is a step from rest."""
    # Snapshots are whole numbers of steps, to a millionth of one, as the configuration makes sure. The last
    # time point at or before each breakpoint is marked.
    marked = {round(stop.time / step): stop for stop in equal_stops(end, step, snapshots, breakpoints)}
    for i in range(round(end / step) + 1):
        yield marked.get(i) or Instant(i * step, step)


def equal_stops(
    end: float, step: float, snapshots: Iterable[float], breakpoints: Iterable[float]
) -> list[Instant]:
    """Return start, end and marked time points of `equal_steps`, in order."""
    at_snapshot = {round(time / step) for time in snapshots}
    at_breakpoint = {math.floor(time / step + 1e-6) for time in breakpoints}
    last = round(end / step)
    places = sorted({0, last, *(i for i in at_snapshot | at_breakpoint if i <= last)})
    return [Instant(i * step, step, i in at_snapshot, i in at_breakpoint) for i in places]


def landing_steps(
    end: float, step: float, snapshots: Iterable[float], breakpoints: Iterable[float]
) -> Iterator[Instant]:
    """Yield steps of at most a given length that land on snapshots and breakpoints; the first has none."""
    first, *rest = landing_stops(end, step, snapshots, breakpoints)
    yield first
    begin = 0.0
    for stop in rest:
        for i in range(1, round((stop.time - begin) / stop.step)):
            yield Instant(begin + i * stop.step, stop.step)
        yield stop
        begin = stop.time


def landing_stops(
    end: float, step: float, snapshots: Iterable[float], breakpoints: Iterable[float]
) -> list[Instant]:
    """Return start, end and the times to land on, with the length of the steps of `landing_steps` to each."""
    first, *rest = stops(end, snapshots, breakpoints)
    landings = [first]
    for stop in rest:
        span = stop.time - landings[-1].time
        length = span / max(1, math.ceil(span / step - 1e-6))
        landings.append(Instant(stop.time, length, stop.snapshot, stop.breakpoint))
    return landings


def number_of_steps(stops: Sequence[Instant]) -> int:
    """Count the equal steps between stops, without the step to the start."""
    return sum(round((stop.time - before.time) / stop.step) for before, stop in pairwise(stops))


def stops(
    end: float, snapshots: Iterable[float], breakpoints: Iterable[float], times: Iterable[float] = ()
) -> Sequence[Instant]:
    """Return start, end and all times to land on between them, in order, without the lengths of the steps."""
    return _stops(end, *map(tuple, (snapshots, breakpoints, times)))


@made_once(lambda stops: _BYTES * len(stops))
def _stops(
    end: float, snapshots: Sequence[float], breakpoints: Sequence[float], times: Sequence[float]
) -> Sequence[Instant]:
    # Times that differ by rounding are one. Start and end are no breakpoints.
    same = SAME_TIME * end
    landings = [0.0]
    at_snapshot, at_breakpoint = [False], [False]
    marked = [(time, "snapshot") for time in snapshots] + [
        (time, "breakpoint") for time in breakpoints if 0 < time < end
    ]
    for time, reason in sorted([*marked, *((time, "row") for time in (*times, end))]):
        # A time right after the start is moved away from it: only the step to the start has no length.
        if time > 0 and max(time, 2 * same) - landings[-1] > same:
            landings.append(max(time, 2 * same))
            at_snapshot.append(False)
            at_breakpoint.append(False)
        at_snapshot[-1] |= reason == "snapshot"
        at_breakpoint[-1] |= reason == "breakpoint"
    return tuple(map(Instant, landings, repeat(0.0), at_snapshot, at_breakpoint))
