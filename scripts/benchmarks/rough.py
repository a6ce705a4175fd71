"""A rough surface in two directions: a viscoelastic run, and an elastic halfspace beside Tamaas.

`points` counts along each of the two axes. The surface is that of configs/rough-layer.yaml, the same on any
grid that resolves it.
"""

from __future__ import annotations

import math
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from benchmarks.common import METHODS, bare_pairs, seconds
from benchmarks.tables import Cell, Effort, Table
from benchmarks.whole_run import run_to_file

from gfmdlayer.case import Case
from gfmdlayer.config import Config, load
from gfmdlayer.contact.problem import Problem, Solution, Solver
from gfmdlayer.contact.residual import assess
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.preparation import warm_up
from gfmdlayer.punch.self_affine import SelfAffine

EFFORT = Effort(points=(512,), steps=100, repetitions=3)
QUICK = Effort(points=(128,), steps=20, repetitions=1)

_CASE = Path(__file__).parents[2] / "configs" / "rough-layer.yaml"
_RESIDUAL = 1e-6
_OWN_TOLERANCES = [10.0**-k for k in range(4, 13)]  # of Tamaas, on its own error
_PART = 0.05  # of E* g', the mean pressure on the halfspace
_E_STAR, _SLOPE = 4.0, 0.1
_MEASURE = 0.2  # seconds of bare pairs in one measurement


def measure(effort: Effort) -> list[Table]:
    """Run the layer on each grid; then the halfspace, by Tamaas too where it is installed."""
    found = [_layer(effort)]
    if find_spec("tamaas") is None:
        print("Tamaas is not installed; the extra bench installs it", file=sys.stderr)
        return found
    return [*found, *(_compare(points, effort.repetitions) for points in effort.points)]


def _layer(effort: Effort) -> Table:
    rows: list[dict[str, Cell]] = []
    for points in effort.points:
        config = _rough(points)
        config = config.with_values({"time.end": effort.steps * float(config.time.step)})
        wisdom = warm_up(config)
        bare = _bare(Transforms(config.grid.points, wisdom))
        taken = math.inf
        for _ in range(effort.repetitions):
            begun = time.perf_counter()
            pairs = run_to_file(config, wisdom)
            taken = min(taken, time.perf_counter() - begun)
        rows.append(
            {
                "grid": f"{points} x {points}",
                "FFT pairs a step": pairs / effort.steps,
                "run / bare pairs": taken / (pairs * bare),
                "bare pair [ms]": 1e3 * bare,
            }
        )
    title = f"A rough surface on a viscoelastic layer, {effort.steps} steps, active_set, residual 1e-6"
    return Table("rough-layer", title, rows, "History, observables and HDF5 output included.")


def _compare(points: int, repetitions: int) -> Table:
    import tamaas

    config = _rough(points, halfspace=True)
    case, mean_pressure = Case(config, warm_up(config)), _PART * _E_STAR * _SLOPE
    grid, transforms, punch = case.grid, case.transforms, case.punch
    zero = np.zeros(math.prod(grid.spectral_shape), dtype=np.complex128)
    problem = Problem(_E_STAR / 2 * np.ravel(grid.wavenumbers), zero, punch, mean_pressure)

    tamaas.set_log_level(tamaas.LogLevel.error)
    tamaas.initialize(1)
    model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_2d, list(grid.period), list(grid.points))
    model.E, model.nu = _E_STAR, 0.0  # E* is E
    surface = -punch.reshape(grid.shape)
    for tolerance in _OWN_TOLERANCES:
        peer = tamaas.PolonskyKeerRey(model, surface, tolerance)
        peer.max_iter = 100_000
        theirs = math.inf
        for _ in range(repetitions):
            model.traction[:] = 0.0  # or it starts from the last solution
            theirs = min(theirs, seconds(lambda: peer.solve(mean_pressure)))  # noqa: B023
        pressure, displacement = np.ravel(model.traction), -np.ravel(model.displacement)
        residual, area, *_ = assess(pressure, displacement, punch, problem.residual_floor)
        if residual <= _RESIDUAL:
            break
    gap = float(np.mean(punch - displacement))

    rows: list[dict[str, Cell]] = [
        {
            "": f"Tamaas {tamaas.__version__}",
            "contact area": f"{area:.7f}",
            "its difference": None,
            "mean gap": f"{gap:.9f}",
            "its difference ": None,
            "residual": residual,
            "FFT pairs": None,
            "time [s]": theirs,
            "Tamaas / this": None,
        }
    ]
    for method in METHODS:
        solver = Case(config.with_values({"solver": {"method": method}}), transforms=transforms).solver
        taken, solution = _solved(solver, problem, repetitions)
        own_gap = float(np.mean(punch - solution.displacement))
        rows.append(
            {
                "": method,
                "contact area": f"{solution.contact_area:.7f}",
                "its difference": abs(solution.contact_area / area - 1),
                "mean gap": f"{own_gap:.9f}",
                "its difference ": abs(own_gap / gap - 1),
                "residual": solution.residual,
                "FFT pairs": solution.transforms,
                "time [s]": taken,
                "Tamaas / this": theirs / taken,
            }
        )
    title = f"A rough elastic halfspace of {points} x {points} points, pbar = {_PART} E* g'"
    note = (
        f"Tamaas's own tolerance, {tolerance:g}, is the loosest power of ten at which its residual is within "
        f"{_RESIDUAL:g}. Targets: differences ≤ 1e-3."
    )
    return Table(f"rough-halfspace-{points}", title, rows, note)


def _solved(solver: Solver, problem: Problem, repetitions: int) -> tuple[float, Solution]:
    start = np.zeros_like(problem.obstacle)
    solution = solver.solve(problem, start)
    if not solution.converged:
        raise RuntimeError(f"a residual of {solution.residual:g} after {solution.iterations} iterations")
    return min(seconds(lambda: solver.solve(problem, start)) for _ in range(repetitions)), solution


def _bare(transforms: Transforms) -> float:
    """Time of an FFT pair."""
    once = seconds(bare_pairs(transforms, 3)) / 3
    count = max(3, math.ceil(_MEASURE / once))
    return min(seconds(bare_pairs(transforms, count)) / count for _ in range(5))


def _rough(points: int, *, halfspace: bool = False) -> Config:
    """The case on another grid; the surface keeps its waves as long as four spacings carry the shortest."""
    given = load(_CASE)
    values: dict[str, object] = {"grid.points": [points, points], "output.snapshots": []}
    assert isinstance(given.punch, SelfAffine)
    values["punch.short_cutoff"] = max(given.punch.short_cutoff, 4 / points)
    if halfspace:
        values |= {"layer.thickness": 0.0, "halfspace.shear_modulus": 1.0, "solver.tolerance": _RESIDUAL}
    return given.with_values(values)
