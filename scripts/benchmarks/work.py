"""Error against work: what an accuracy of ptilde costs, by integrator, solver and step length."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.common import METHODS, STEP, Trace, default_case, run
from benchmarks.tables import Cell, Effort, Table
from scipy.interpolate import CubicSpline

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import Config
from gfmdlayer.figures.plot_style import colours, line_style, new_figure, save, styled
from gfmdlayer.inputs import make_trajectory

EFFORT = Effort(points=(1 << 14,), steps=1600)
QUICK = Effort(points=(1 << 10,), steps=400)

STEPS = (0.1, 0.05, 0.02, 0.01, 0.005)
TOLERANCES = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5)

_TITLES = {
    "active_set": "active set",
    "conjugate_gradient": "conjugate gradients",
    "fire": "FIRE",
    "backward_euler": "backward Euler",
    "exponential": "exponential",
    "adaptive": "adaptive",
}
_FINE = {"step": 0.001, "integrator": "exponential"}


@dataclass(frozen=True)
class Reference:
    """ptilde over time, known finely; smooth between the breaks."""

    times: FloatArray
    mean_pressure: FloatArray
    breaks: tuple[float, ...]

    def error(self, trace: Trace) -> float:
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
    tables = []
    for points in effort.points:
        end = effort.steps * STEP
        title = f"Error of ptilde against work to {end:g} tau, n = {points}"
        note = (
            "Error: the largest at the ends of the steps, relative to the largest ptilde; residual 1e-6.  "
            "Target at n = 16384: 5e-4 in 450 pairs."
        )
        tables.append(Table(f"work-{points}", title, list(_rows(points, end)), note))
    if effort.plot:
        _plot(tables[-1], effort.plot)
    return tables


def reference(config: Config) -> Reference:
    """Return a case solved with steps of 0.001 tau, of second order, to a residual of 1e-9."""
    solver = {"method": "active_set", "tolerance": 1e-9}
    trace = run(config.with_values({"time": {"end": config.time.end, **_FINE}, "solver": solver}))
    kinks = [kink for kink in make_trajectory(config).kinks if kink < config.time.end]
    return Reference(trace["time"], trace["mean_pressure"], (0.0, *kinks, config.time.end))


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


def _plot(table: Table, file: Path) -> None:
    """Draw a line for each solver (colour) and integrator (line style)."""
    from matplotlib.lines import Line2D

    integrators = list(dict.fromkeys(str(row["integrator"]) for row in table.rows))
    looks: dict[str, dict[str, Any]] = {
        name: {"linestyle": line_style(i), "marker": "os^"[i]} for i, name in enumerate(integrators)
    }
    colour = dict(zip(METHODS, colours(len(METHODS)), strict=True))
    with styled():
        figure = new_figure(1, 75.0)
        axes = figure.add_subplot()
        for method, integrator in product(METHODS, integrators):
            curve = [row for row in table.rows if (row["solver"], row["integrator"]) == (method, integrator)]
            work, error = ([row[column] for row in curve] for column in ("pairs", "error"))
            axes.loglog(work, error, color=colour[method], markersize=3, **looks[integrator])
        axes.set_xlabel("FFT pairs")
        axes.set_ylabel(r"error of $\tilde p$ / largest $\tilde p$")
        entries = [Line2D([], [], color=colour[method], label=_TITLES[method]) for method in METHODS]
        entries += [
            Line2D([], [], color="black", markersize=3, label=_TITLES[name], **looks[name])
            for name in integrators
        ]
        figure.legend(handles=entries, loc="outside upper center", ncols=2, fontsize=8)
    save(figure, file)
