"""Rough surfaces by Tamaas, ASPHER and gfmdlayer at equal residual.

All use one thread; times are CPU times. The extra `bench` installs both codes. The build of ASPHER needs a
C++ compiler, FFTW's headers and Eigen; `CMAKE_ARGS=-DFETCHCONTENT_SOURCE_DIR_EIGEN3_SRC=/usr/include/eigen3`
gives the place of Eigen.
"""

from __future__ import annotations

import math
import os
import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import numpy.typing as npt
from benchmarks.common import METHODS, Cell, Table, cpu_seconds

from gfmdlayer.config import Config, load
from gfmdlayer.contact.nested.solver import NestedGradient
from gfmdlayer.contact.problem import Problem, Solution, Solver
from gfmdlayer.contact.residual import assess
from gfmdlayer.model import warm_up
from gfmdlayer.punch.self_affine import SelfAffine
from gfmdlayer.simulation import Case

RESIDUAL = 1e-6
PART = 0.05  # of E* g', the mean pressure on the halfspace
E_STAR, SLOPE = 4.0, 0.1

_CASE = Path(__file__).parents[2] / "configs" / "rough-layer.yaml"
_OWN_TOLERANCES = [10.0**-k for k in range(4, 13)]  # of Tamaas and ASPHER, on their own errors
_LOOSER = (1e-4, 1e-5)  # tolerances here, beside RESIDUAL
_EXACT = 1e-9


def compare(points: int, repetitions: int) -> list[Table]:
    """Solve with other codes, at decreasing tolerances down to a residual, and with our solvers."""
    config = rough(points, halfspace=True)
    case, mean_pressure = Case(config, warm_up(config)), PART * E_STAR * SLOPE
    zero = np.zeros(math.prod(case.grid.spectral_shape), dtype=np.complex128)
    problem = Problem(E_STAR / 2 * np.ravel(case.grid.wavenumbers), zero, case.punch, mean_pressure)
    exact = NestedGradient(case.transforms, case.grid).solve(problem, np.zeros_like(case.punch), _EXACT)
    rows, every = [], []
    for name, peer in (("tamaas", _tamaas), ("aspher", _aspher)):
        if find_spec(name) is None:
            print(f"{name} is not installed; install gfmdlayer[bench]", file=sys.stderr)
            continue
        for tolerance in _OWN_TOLERANCES:
            taken, pressure = peer(case, mean_pressure, tolerance, repetitions)
            residual, area = _assessed(case, problem, pressure)
            row = _row(f"{name} {version(name)}", (area, residual, None), taken, tolerance)
            every.append(row)
            if residual <= RESIDUAL:
                break
        rows.append(row)
    for method in ("nested_gradient", *METHODS[:2]):
        for tolerance in (*_LOOSER, RESIDUAL):
            given = {"solver": {"method": method, "tolerance": tolerance}}
            solver = Case(config.with_values(given), transforms=case.transforms).solver
            taken, solution = _solved(solver, problem, tolerance, repetitions)
            found = solution.contact_area, solution.residual, solution.transforms
            row = _row(method, found, taken, tolerance)
            every.append(row)
        rows.append(row)
    own = next(row["time [s]"] for row in rows if row[""] == "nested_gradient")
    over = [row | {"over nested_gradient": float(row["time [s]"] or 0) / float(own or 1)} for row in rows]
    errors = [
        row | {"error of the area": abs(float(row["contact area"] or 0) / exact.contact_area - 1)}
        for row in every
    ]
    title = f"A rough elastic halfspace of {points} x {points} points, pbar = {PART} E* g', one thread"
    note = (
        f"A peer's tolerance is the loosest power of ten with a residual within {RESIDUAL:g}; our formula "
        "computes the residual from its pressure. Target: contact areas agree within 1e-3."
    )
    return [
        Table(f"rough-halfspace-{points}", title, over, note),
        Table(
            f"rough-error-{points}",
            "The same at looser tolerances: error of the contact area",
            errors,
            f"Against nested_gradient to a residual of {_EXACT:g}; a point is {1 / points**2:.1e}.",
        ),
    ]


def _row(
    name: str, found: tuple[float, float, int | None], taken: float, tolerance: float
) -> dict[str, Cell]:
    area, residual, pairs = found
    return {
        "": name,
        "own tolerance": f"{tolerance:g}",
        "contact area": f"{area:.9f}",
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
    model.E, model.nu = E_STAR, 0.0  # E* is E
    peer = tamaas.PolonskyKeerRey(model, -case.punch.reshape(grid.shape), tolerance)
    peer.max_iter = 100_000

    def solve() -> None:
        model.traction[:] = 0.0  # or it starts from the last solution
        peer.solve(mean_pressure)

    taken = min(cpu_seconds(solve) for _ in range(repetitions))
    return taken, np.ravel(model.traction).copy()


def _aspher(
    case: Case, mean_pressure: float, tolerance: float, repetitions: int
) -> tuple[float, npt.NDArray[np.float64]]:
    os.environ["OMP_NUM_THREADS"] = "1"  # read as the library is loaded; else it takes all cores
    import aspher

    heights, found = case.punch.reshape(case.grid.shape), []

    def solve() -> None:
        found[:] = [
            aspher.solve_nested(
                case.grid.points[0], heights, mean_pressure, 1.0, E_STAR,
                backend="periodic", tol=tolerance, precision="float_then_double",
            )
        ]  # fmt: skip

    taken = min(cpu_seconds(solve) for _ in range(repetitions))
    return taken, np.ravel(np.asarray(found[0].pressure, dtype=np.float64))


def _assessed(case: Case, problem: Problem, pressure: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Residual and contact area of a peer's pressure; the punch is shifted until nothing overlaps."""
    stiff = problem.stiffness > 0
    waves = -case.transforms.forward(pressure) * stiff / np.where(stiff, problem.stiffness, 1.0)
    gap = case.punch - case.transforms.backward(waves) / pressure.size
    gap -= gap.min()
    residual, area, *_ = assess(pressure, case.punch - gap, case.punch, problem.residual_floor)
    return residual, area


def _solved(solver: Solver, problem: Problem, tolerance: float, repetitions: int) -> tuple[float, Solution]:
    start = np.zeros_like(problem.obstacle)

    def solve() -> Solution:
        return solver.solve(problem, start, tolerance, 20_000)

    solution = solve()
    if not solution.converged:
        raise RuntimeError(f"a residual of {solution.residual:g} after {solution.iterations} iterations")
    return min(cpu_seconds(solve) for _ in range(repetitions)), solution


def rough(points: int, *, halfspace: bool = False, cutoff: float = 0.0) -> Config:
    """The case on another grid; the surface keeps its waves while the shortest has four spacings."""
    given = load(_CASE)
    values: dict[str, object] = {"grid.points": [points, points], "output.snapshots": []}
    assert isinstance(given.punch, SelfAffine)
    values["punch.short_cutoff"] = cutoff or max(given.punch.short_cutoff, 4 / points)
    if halfspace:
        values |= {"layer.thickness": 0.0, "halfspace.shear_modulus": 1.0, "solver.tolerance": RESIDUAL}
    return given.with_values(values)
