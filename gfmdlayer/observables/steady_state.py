"""Steady state of a moving punch, at which the run ends.

It is reached when mean pressure, depth and friction have each stayed within a tolerance, relative to their
largest value, over a whole window of time: the time of the slowest process (`SlidingModes.slowest`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts

if TYPE_CHECKING:
    from gfmdlayer.config import Config

_ROUNDING = 1e-12  # of friction, where the body is elastic


class SteadyState(Observable):
    """Compares the accepted steps of a window of time; attributes `settled`, 0 or 1, and `steady_time`.

    The first window begins with the last breakpoint of the programme, another one after each that was not
    steady.
    """

    KEPT = "begun", "least", "most"  # no run is resumed from a steady state, which ends it

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return no columns, in a case with a steady state."""
        return None if config.time.steady is None else ()

    def __init__(self, case: Parts) -> None:
        time = case.config.time
        assert time.steady is not None
        self._tolerance = time.steady
        slowdown = 1.0 if case.reduced_time is None else case.reduced_time.factor(math.inf)
        self._window = case.integrator.slowest(self._tolerance) * slowdown
        self._since = max(case.breakpoints, default=0.0)
        self._begun = math.inf
        self._least: tuple[float, ...] = ()
        self._most: tuple[float, ...] = ()
        self.attributes = {"settled": 0}
        self.warning = f"NOT STEADY within {time.steady:g} at time.end = {time.end:g}"

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Compare the step with the others of its window."""
        values = step.solution.mean_pressure, step.surface.depth, float(step.row["friction"])
        if step.time < self._since or math.isnan(values[-1]):
            return {}
        if self._begun == math.inf:
            self._begin(step.time, values)
            return {}
        self._least = tuple(map(min, self._least, values))
        self._most = tuple(map(max, self._most, values))
        if step.time - self._begun >= self._window * (1 - 1e-9):
            if all(map(self._is_steady, self._least, self._most)):
                self.finished, self.warning = True, ""
                self.attributes = {"settled": 1, "steady_time": step.time}
            self._begin(step.time, values)
        return {}

    def _is_steady(self, least: float, most: float) -> bool:
        return most - least <= self._tolerance * max(abs(least), abs(most)) + _ROUNDING

    def _begin(self, time: float, values: tuple[float, ...]) -> None:
        self._begun, self._least, self._most = time, values, values
