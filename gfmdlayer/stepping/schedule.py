"""The time points of a run with fixed steps."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Instant:
    """One time point: when, how long after the one before, and what is special about it."""

    time: float
    step: float
    snapshot: bool = False
    kink: bool = False


def equal_steps(
    end: float, step: float, snapshots: Iterable[float], kinks: Iterable[float]
) -> Iterator[Instant]:
    """Every whole number of steps from 0 to the end, as the paper's pseudocode.

    The first is a step from rest as well.

    Snapshots are the steps within a millionth of a step of an asked time (`whole_steps` says whether there
    are such).
    """
    asked = {round(time / step) for time in snapshots}
    turns = {math.floor(time / step + 1e-6) for time in kinks}
    for i in range(round(end / step) + 1):
        yield Instant(i * step, step, i in asked, i in turns)


def whole_steps(time: float, step: float) -> bool:
    """Whether a time is a whole number of steps, within a millionth of one."""
    return abs(time / step - round(time / step)) <= 1e-6


def landing_steps(
    end: float, step: float, snapshots: Iterable[float], kinks: Iterable[float]
) -> Iterator[Instant]:
    """Steps of at most the given length that land on every snapshot and kink; the first, at t = 0.

    Has no length.
    """
    asked, turns = set(snapshots), {time for time in kinks if time < end}
    yield Instant(0.0, 0.0, 0.0 in asked, kink=False)
    begin = 0.0
    for stop in sorted((asked | turns | {end}) - {0.0}):
        count = math.ceil((stop - begin) / step - 1e-6)
        length = (stop - begin) / count
        for i in range(1, count):
            yield Instant(begin + i * length, length)
        yield Instant(stop, length, stop in asked, stop in turns)
        begin = stop
