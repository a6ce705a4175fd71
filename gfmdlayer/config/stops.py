"""The times that the steps of a case land on, from its configuration alone."""

from __future__ import annotations

import math
from collections.abc import Iterable

from gfmdlayer.config.model import Config
from gfmdlayer.history import time_points
from gfmdlayer.history.time_points import Instant


def stops(config: Config, kinks: Iterable[float]) -> list[Instant]:
    """Return the times that the steps of a case land on, with the lengths of fixed steps to each."""
    time, snapshots = config.time, config.output.snapshot_times
    if isinstance(time.step, str):
        return time_points.stops(time.end, snapshots, kinks, output_times(config))
    equal = time.integrator == "backward_euler"
    fixed = time_points.equal_stops if equal else time_points.landing_stops
    return fixed(time.end, time.step, snapshots, kinks)


def output_times(config: Config) -> tuple[float, ...]:
    """Return the times of the rows that adaptive steps are asked to land on."""
    times = config.output.times
    if isinstance(times, float):
        return tuple(times * i for i in range(1, math.floor(config.time.end / times + 1e-9) + 1))
    return times or ()
