"""Rough surfaces in two directions: a run, first solves, error against work, and Tamaas and ASPHER beside.

`points` counts along each of the two axes. The surface is that of configs/rough-layer.yaml, the same on any
grid that resolves it. A pair in single precision counts half of one in double. Both peers are compared at
equal residual and on one thread; times are CPU times.

The extra `bench` installs both. ASPHER is built on the way, by a C++ compiler, with FFTW's headers and with
Eigen, which it looks for where `CMAKE_ARGS=-DFETCHCONTENT_SOURCE_DIR_EIGEN3_SRC=/usr/include/eigen3` says.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import numpy.typing as npt
from benchmarks.common import METHODS, bare_pairs, seconds
from benchmarks.tables import Cell, Effort, Table
from benchmarks.whole_run import run_to_file

from gfmdlayer.case import Case
from gfmdlayer.config import Config, load
from gfmdlayer.contact.nested.solver import NestedGradient
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


_FEWEST = 128  # points of an axis of the finest of three grids that are compared
_LOADS = (0.01, 0.04, 0.2, 0.6)  # parts of the pressure of full contact at the lowest point
_BODIES: dict[str, dict[str, object]] = {
    "halfspace": {"layer.thickness": 0.0, "halfspace.shear_modulus": 1.0},
    "thin layer, nu = 0.3": {"layer.thickness": 0.03, "layer.poisson": 0.3},
    "incompressible layer": {"layer.thickness": 0.2},
    "layer on a base of a fifth": {"layer.thickness": 0.03, "halfspace.shear_modulus": 2.0},
}


def measure(effort: Effort) -> list[Table]:
    """Run the layer on each grid, solve from nothing, and compare with the peers that are installed."""
    found = [_layer(effort)]
    for points in effort.points:
        found += [_cold(points), _compare(points, effort.repetitions)]
    largest = max(effort.points)
    return [*found, _accuracy(largest)] if largest >= _FEWEST else found


def _cold(points: int) -> Table:
    rows: list[dict[str, Cell]] = []
    for name, values in _BODIES.items():
        case = Case(_rough(points).with_values(values))
        stiffness = np.array(case.integrator.terms(1e-9)[0])
        stiffness[0] = 0.0
        zero, transforms = np.zeros(stiffness.size, dtype=np.complex128), case.transforms
        closing = transforms.backward(stiffness * transforms.forward(case.punch)) / case.punch.size
        for part in _LOADS:
            problem = Problem(stiffness, zero, case.punch, -part * float(closing.min()))
            solver = NestedGradient(transforms, _RESIDUAL, grid=case.grid)
            solution = solver.solve(problem, np.zeros(case.punch.size))
            double, single = solver.spent
            rows.append(
                {
                    "body": name,
                    "contact area": f"{solution.contact_area:.3f}",
                    "iterations": solution.iterations,
                    "FFT pairs": double + single / 2,
                    "all counted as double": double + single,
                    "residual": solution.residual,
                }
            )
    title = f"First solves by nested_gradient, {points} x {points} points, residual {_RESIDUAL:g}"
    note = "Pairs on coarser grids are counted as parts of one, pairs in single precision as halves."
    return Table(f"rough-cold-{points}", title, rows, note)


def _accuracy(points: int) -> Table:
    """Error of the contact area on coarser grids, beside the work there."""
    rows: list[dict[str, Cell]] = []
    for each in (points // 4, points // 2, points):
        case = Case(_rough(each, halfspace=True, cutoff=16 / points))
        zero = np.zeros(math.prod(case.grid.spectral_shape), dtype=np.complex128)
        load = _PART * _E_STAR * _SLOPE
        problem = Problem(_E_STAR / 2 * np.ravel(case.grid.wavenumbers), zero, case.punch, load)
        solver = NestedGradient(case.transforms, _RESIDUAL, grid=case.grid)
        solution = solver.solve(problem, np.zeros(case.punch.size))
        work = (solver.spent[0] + solver.spent[1] / 2) * each**2 / 1e6
        rows.append({"grid": f"{each} x {each}", "contact area": solution.contact_area, "work [1e6]": work})
    for row in rows:
        row["error of the area"] = abs(
            float(row["contact area"] or 0) / float(rows[-1]["contact area"] or 1) - 1
        )
    title = (
        f"Error of the contact area against work, {points // 16} of the shortest waves in the cell's width"
    )
    note = "Against the finest grid; work is FFT pairs times points. The residual is 1e-6 on each."
    return Table("rough-accuracy", title, rows, note)


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
    title = f"A rough surface on a viscoelastic layer, {effort.steps} steps, auto, residual 1e-6"
    return Table("rough-layer", title, rows, "History, observables and HDF5 output included.")


def _compare(points: int, repetitions: int) -> Table:
    config = _rough(points, halfspace=True)
    case, mean_pressure = Case(config, warm_up(config)), _PART * _E_STAR * _SLOPE
    zero = np.zeros(math.prod(case.grid.spectral_shape), dtype=np.complex128)
    problem = Problem(_E_STAR / 2 * np.ravel(case.grid.wavenumbers), zero, case.punch, mean_pressure)
    rows: list[dict[str, Cell]] = []
    for name, peer in (("tamaas", _tamaas), ("aspher", _aspher)):
        if find_spec(name) is None:
            print(f"{name} is not installed; the extra bench installs it", file=sys.stderr)
            continue
        for tolerance in _OWN_TOLERANCES:
            taken, pressure = peer(case, mean_pressure, tolerance, repetitions)
            residual, area = _assessed(case, problem, pressure)
            if residual <= _RESIDUAL:
                break
        rows.append(_row(f"{name} {version(name)}", (area, residual, None), taken, tolerance))
    for method in ("nested_gradient", *METHODS[:2]):
        solver = Case(config.with_values({"solver": {"method": method}}), transforms=case.transforms).solver
        taken, solution = _solved(solver, problem, repetitions)
        found = solution.contact_area, solution.residual, solution.transforms
        rows.append(_row(method, found, taken, _RESIDUAL))
    own = next(row["time [s]"] for row in rows if row[""] == "nested_gradient")
    for row in rows:
        row["over nested_gradient"] = float(row["time [s]"] or 0) / float(own or 1)
    title = f"A rough elastic halfspace of {points} x {points} points, pbar = {_PART} E* g', one thread"
    note = (
        f"A peer's own tolerance is the loosest power of ten at which its residual, computed here from its "
        f"pressure, is within {_RESIDUAL:g}. Targets: contact areas within 1e-3 of each other."
    )
    return Table(f"rough-halfspace-{points}", title, rows, note)


def _row(
    name: str, found: tuple[float, float, int | None], taken: float, tolerance: float
) -> dict[str, Cell]:
    area, residual, pairs = found
    return {
        "": name,
        "own tolerance": f"{tolerance:g}",
        "contact area": f"{area:.7f}",
        "residual": residual,
        "FFT pairs": pairs,
        "time [s]": taken,
    }


def _tamaas(
    case: Case, mean_pressure: float, tolerance: float, repetitions: int
) -> tuple[float, npt.NDArray[np.float64]]:
    import tamaas

    tamaas.set_log_level(tamaas.LogLevel.error)
    tamaas.initialize(1)
    grid = case.grid
    model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_2d, list(grid.period), list(grid.points))
    model.E, model.nu = _E_STAR, 0.0  # E* is E
    peer = tamaas.PolonskyKeerRey(model, -case.punch.reshape(grid.shape), tolerance)
    peer.max_iter = 100_000

    def solve() -> None:
        model.traction[:] = 0.0  # or it starts from the last solution
        peer.solve(mean_pressure)

    taken = min(_cpu_seconds(solve) for _ in range(repetitions))
    return taken, np.ravel(model.traction).copy()


def _aspher(
    case: Case, mean_pressure: float, tolerance: float, repetitions: int
) -> tuple[float, npt.NDArray[np.float64]]:
    import aspher

    heights, found = case.punch.reshape(case.grid.shape), []

    def solve() -> None:
        found[:] = [
            aspher.solve_nested(
                case.grid.points[0], heights, mean_pressure, 1.0, _E_STAR,
                backend="periodic", tol=tolerance, precision="float_then_double",
            )
        ]  # fmt: skip

    taken = min(_cpu_seconds(solve) for _ in range(repetitions))
    return taken, np.ravel(np.asarray(found[0].pressure, dtype=np.float64))


def _assessed(case: Case, problem: Problem, pressure: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Residual and contact area of a peer's pressure, the punch shifted clear of the surface."""
    stiff = problem.stiffness > 0
    waves = -case.transforms.forward(pressure) * stiff / np.where(stiff, problem.stiffness, 1.0)
    gap = case.punch - case.transforms.backward(waves) / pressure.size
    gap -= gap.min()
    residual, area, *_ = assess(pressure, case.punch - gap, case.punch, problem.residual_floor)
    return residual, area


def _cpu_seconds(task: Callable[[], object]) -> float:
    begun = time.process_time()
    task()
    return time.process_time() - begun


def _solved(solver: Solver, problem: Problem, repetitions: int) -> tuple[float, Solution]:
    start = np.zeros_like(problem.obstacle)
    solution = solver.solve(problem, start)
    if not solution.converged:
        raise RuntimeError(f"a residual of {solution.residual:g} after {solution.iterations} iterations")
    return min(_cpu_seconds(lambda: solver.solve(problem, start)) for _ in range(repetitions)), solution


def _bare(transforms: Transforms) -> float:
    """Time of an FFT pair."""
    once = seconds(bare_pairs(transforms, 3)) / 3
    count = max(3, math.ceil(_MEASURE / once))
    return min(seconds(bare_pairs(transforms, count)) / count for _ in range(5))


def _rough(points: int, *, halfspace: bool = False, cutoff: float = 0.0) -> Config:
    """The case on another grid; the surface keeps its waves as long as four spacings carry the shortest."""
    given = load(_CASE)
    values: dict[str, object] = {"grid.points": [points, points], "output.snapshots": []}
    assert isinstance(given.punch, SelfAffine)
    values["punch.short_cutoff"] = cutoff or max(given.punch.short_cutoff, 4 / points)
    if halfspace:
        values |= {"layer.thickness": 0.0, "halfspace.shear_modulus": 1.0, "solver.tolerance": _RESIDUAL}
    return given.with_values(values)
