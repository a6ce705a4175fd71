"""Error against work: FFT pairs for an accuracy of ptilde, by integrator, solver and step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from benchmarks.common import METHODS, STEP, default_case, run
from benchmarks.tables import Cell, Effort, Table
from scipy.interpolate import CubicSpline

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import Config
from gfmdlayer.inputs import make_trajectory
from gfmdlayer.verification.runs import Recording

EFFORT = Effort(points=(1 << 14,), steps=1600)
QUICK = Effort(points=(1 << 10,), steps=400)

STEPS = (0.1, 0.05, 0.02, 0.01, 0.005)
TOLERANCES = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5)

_FINE = {"step": 0.001, "integrator": "exponential"}


@dataclass(frozen=True)
class Reference:
    """ptilde over time from fine steps.

    Parameters
    ----------
    times, mean_pressure : ndarray
        Times and ptilde.
    breaks : tuple of float
        Times between which ptilde is smooth.
    """

    times: FloatArray
    mean_pressure: FloatArray
    breaks: tuple[float, ...]

    def error(self, trace: Recording) -> float:
        """Return the largest error of ptilde over the steps of a run, relative to the largest ptilde."""
        times, found = trace["time"], trace["mean_pressure"]
        worst = 0.0
        for begin, end in pairwise(self.breaks):
            known = (self.times >= begin) & (self.times <= end)
            asked = (times >= begin) & (times <= end)
            exact = CubicSpline(self.times[known], self.mean_pressure[known])(times[asked])
            worst = max(worst, float(np.abs(found[asked] - exact).max(initial=0.0)))
        return worst / float(self.mean_pressure.max())


def measure(effort: Effort) -> list[Table]:
    """Run each combination to the end and compare it with one fine run."""
    end = effort.steps * STEP
    note = (
        "Error: the largest at the ends of the steps, relative to the largest ptilde; residual 1e-6. "
        "Target at n = 16384: 5e-4 in 450 pairs."
    )
    return [
        Table(
            f"work-{points}",
            f"Error of ptilde against work to {end:g} tau, n = {points}",
            list(_rows(points, end)),
            note,
        )
        for points in effort.points
    ]


def reference(config: Config) -> Reference:
    """Return a case solved with steps of 0.001 tau, of second order, to a residual of 1e-9."""
    solver = {"method": "active_set", "tolerance": 1e-9}
    fine = run(config.with_values({"time": {"end": config.time.end, **_FINE}, "solver": solver}))
    kinks = [kink for kink in make_trajectory(config).kinks if kink < config.time.end]
    return Reference(fine["time"], fine["mean_pressure"], (0.0, *kinks, config.time.end))


def _rows(points: int, end: float) -> Iterator[dict[str, Cell]]:
    exact = reference(default_case(grid__points=points, time__end=end))
    for integrator, time in _time_axes(end):
        for method in METHODS:
            trace = run(default_case(grid__points=points, time=time, solver={"method": method}))
            yield {
                "integrator": integrator,
                "solver": method,
                "step or tolerance": time["tolerance"] if integrator == "adaptive" else time["step"],
                "steps": trace["time"].size - 1,
                "pairs": int(trace["transforms"].sum()),
                "error": exact.error(trace),
            }


def _time_axes(end: float) -> Iterator[tuple[str, dict[str, Any]]]:
    for integrator in ("backward_euler", "exponential"):
        for step in STEPS:
            yield integrator, {"end": end, "integrator": integrator, "step": step}
    for tolerance in TOLERANCES:
        yield (
            "adaptive",
            {"end": end, "integrator": "exponential", "step": "adaptive", "tolerance": tolerance},
        )
