"""Rough two-dimensional surfaces: a run, first solves, error over work, other codes, threads and ranks.

`points` is the number along each axis. configs/rough-layer.yaml describes the surface; it is the same on any
grid that resolves it. A pair in single precision counts as half a pair in double precision. The
section `slabs` compares threads and ranks.

The other codes, Tamaas and ASPHER, solve to an equal residual on one thread; times are CPU times. The extra
`bench` installs both. The build of ASPHER needs a C++ compiler, FFTW's headers and Eigen;
`CMAKE_ARGS=-DFETCHCONTENT_SOURCE_DIR_EIGEN3_SRC=/usr/include/eigen3` gives the place of Eigen.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version
from importlib.util import find_spec
from itertools import product
from pathlib import Path

import numpy as np
import numpy.typing as npt
from benchmarks import slabs
from benchmarks.common import METHODS, Cell, Effort, Table, cpu_of_a_pair, cpu_seconds
from benchmarks.whole_run import effort_of_run

from gfmdlayer import bonded_layer, halfspace
from gfmdlayer.body.body import Body
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import warm_up
from gfmdlayer.config import Config, load
from gfmdlayer.contact.nested.solver import NestedGradient
from gfmdlayer.contact.problem import Problem, Solution, Solver
from gfmdlayer.contact.residual import assess
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.punch.self_affine import SelfAffine

EFFORT = Effort(points=(512,), steps=100, repetitions=3)
QUICK = Effort(points=(128,), steps=20, repetitions=1)

RESIDUAL = 1e-6
PART = 0.05  # of E* g', the mean pressure on the halfspace
E_STAR, SLOPE = 4.0, 0.1

_CASE = Path(__file__).parents[2] / "configs" / "rough-layer.yaml"
_OWN_TOLERANCES = [10.0**-k for k in range(4, 13)]  # of Tamaas and ASPHER, on their own errors
_LOOSER = (1e-4, 1e-5)  # tolerances here, beside RESIDUAL
_EXACT = 1e-9
_MEASURE = 0.2  # seconds of bare pairs in one measurement
_FEWEST = 128  # points of an axis of the finest of three grids that are compared, and of one over ranks
_AREAS = (0.05, 0.15, 0.40, 0.80)  # parts of the surface in contact
_WITHIN = 0.02  # of them, relative
_LIGHT = 1e-6  # of the pressure of full contact at the lowest point, the first load
_ROUGHLY, _ROUNDS = 1e-4, 40  # residual and most solves of the search for a load
_CUTOFF, _ROLL_OFF = 4, 1 / 8  # spacings, periods
_THICKNESSES = (0.005, 0.02, 0.1, 0.3)  # periods
_FILMS = (0.01, 0.05, 0.2, 5.0, 20.0, 100.0)  # shear modulus over that of the base


def bodies() -> Iterator[tuple[str, Body]]:
    """Yield names and bodies: a halfspace; films on a soft, a stiff, a rigid and no base."""
    yield "halfspace", halfspace(1.0)
    kinds = [(f"{shear:g} on 1", shear, 0.5, 1.0) for shear in _FILMS]
    kinds += [(f"on a rigid base, nu {poisson:g}", 1.0, poisson, math.inf) for poisson in (0.5, 0.3)]
    for (kind, shear, poisson, base), thickness in product((*kinds, ("free", 1.0, 0.5, 0.0)), _THICKNESSES):
        body = bonded_layer(thickness, shear, poisson=poisson, halfspace=base)
        yield f"{kind}, d {thickness:g}", body


def measure(effort: Effort) -> Iterator[Table]:
    """Run the layer on each grid; solve from rest; compare with other codes, threads and ranks."""
    yield _layer(effort)
    for points in effort.points:
        yield _cold(points, effort.repetitions)
        yield from compare(points, effort.repetitions)
    if (largest := max(effort.points)) >= _FEWEST:
        yield _accuracy(largest)
        yield from slabs.measure(replace(effort, points=(largest,)))


def _cold(points: int, repetitions: int) -> Table:
    """Solve from rest on bodies of all kinds."""
    rows: list[dict[str, Cell]] = []
    grid, transforms = Grid((points, points), (1.0, 1.0)), Transforms((points, points))
    surface = SelfAffine(
        hurst=0.8, rms_slope=SLOPE, short_cutoff=_CUTOFF / points, roll_off=_ROLL_OFF, seed=1
    )
    punch, q = np.ravel(surface.heights(grid)), np.ravel(grid.wavenumbers)
    zero = np.zeros(q.size, dtype=np.complex128)
    for name, body in bodies():
        stiffness = np.zeros(q.size)
        stiffness[1:] = body.stiffness(q[1:], 0.0)
        closing = transforms.backward(stiffness * transforms.forward(punch)) / punch.size
        problem = Problem(stiffness, zero, punch, -_LIGHT * float(closing.min()))
        row: dict[str, Cell] = {"body": name}
        for area in _AREAS:
            problem = _of_area(NestedGradient(transforms, grid), problem, area)
            solver = NestedGradient(transforms, grid)
            taken, solution = _solved(solver, problem, RESIDUAL, repetitions)
            double, single = solver.spent
            solved = f"{solution.iterations}/{double + single / 2:.1f}/{1e3 * taken:.0f}"
            row[f"{area:.0%}"] = solved if solution.converged else f"{solved} not solved"
        rows.append(row)
    title = f"First solves by nested_gradient, {points} x {points} points, residual {RESIDUAL:g}"
    note = (
        "Iterations/FFT pairs/ms of CPU time by the part of the surface in contact. Pairs on coarser grids "
        "count by their points, pairs in single precision count half."
    )
    return Table(f"rough-cold-{points}", title, rows, note)


def _of_area(solver: NestedGradient, problem: Problem, area: float) -> Problem:
    """Find the load of a contact area, to `_WITHIN`, by bisection; `problem` has less contact."""
    lower, upper, pressure = problem, None, np.zeros(problem.obstacle.size)
    for _ in range(_ROUNDS):
        least, most = (float(each.mean_pressure or 0.0) if each else math.inf for each in (lower, upper))
        tried = replace(problem, mean_pressure=math.sqrt(least * most) if upper else 4.0 * least)
        found = solver.solve(tried, pressure, _ROUGHLY)
        pressure = found.pressure
        if abs(found.contact_area - area) <= _WITHIN * area:
            return tried
        lower, upper = (tried, upper) if found.contact_area < area else (lower, tried)
    raise RuntimeError(f"no load presses {area:.0%} of the surface into contact")


def _accuracy(points: int) -> Table:
    """Error of the contact area on coarser grids, and their work."""
    rows: list[dict[str, Cell]] = []
    for each in (points // 4, points // 2, points):
        case = Case(rough(each, halfspace=True, cutoff=16 / points))
        zero = np.zeros(math.prod(case.grid.spectral_shape), dtype=np.complex128)
        load = PART * E_STAR * SLOPE
        problem = Problem(E_STAR / 2 * np.ravel(case.grid.wavenumbers), zero, case.punch, load)
        solver = NestedGradient(case.transforms, case.grid)
        solution = solver.solve(problem, np.zeros(case.punch.size), RESIDUAL)
        work = (solver.spent[0] + solver.spent[1] / 2) * each**2 / 1e6
        rows.append({"grid": f"{each} x {each}", "contact area": solution.contact_area, "work [1e6]": work})
    for row in rows:
        row["error of the area"] = abs(
            float(row["contact area"] or 0) / float(rows[-1]["contact area"] or 1) - 1
        )
    title = f"Error of the contact area over work, {points // 16} of the shortest waves in the cell's width"
    note = "Errors relative to the finest grid; work is FFT pairs times points. The residual is 1e-6."
    return Table("rough-accuracy", title, rows, note)


def _layer(effort: Effort) -> Table:
    rows: list[dict[str, Cell]] = []
    for points in effort.points:
        config = rough(points)
        config = config.with_values({"time.end": effort.steps * float(config.time.step)})
        warm_up(config)
        transforms = Transforms(config.grid.points)
        single = transforms.of_shape(config.grid.points, single=True)
        taken = of_double = of_single = math.inf
        for _ in range(effort.repetitions):
            of_double = min(of_double, cpu_of_a_pair(transforms, _MEASURE))
            of_single = min(of_single, cpu_of_a_pair(single, _MEASURE))
            begun = time.process_time()
            pairs, iterations = effort_of_run(config)
            taken = min(taken, time.process_time() - begun)
        true = (pairs - iterations / 2) * of_double + iterations * of_single
        rows.append(
            {
                "grid": f"{points} x {points}",
                "FFT pairs a step": pairs / effort.steps,
                "run / bare pairs": taken / (pairs * of_double),
                "by the time of single pairs": taken / true,
                "bare pair [ms]": 1e3 * of_double,
                "single [ms]": 1e3 * of_single,
            }
        )
    title = f"A rough surface on a viscoelastic layer, {effort.steps} steps, auto, residual 1e-6"
    note = (
        "CPU times with history, observables and HDF5 output. A pair in single precision counts half, "
        "then by its time; there is one in each iteration."
    )
    return Table("rough-layer", title, rows, note)


# Other codes.


def compare(points: int, repetitions: int) -> list[Table]:
    """Solve with other codes, at decreasing tolerances down to a residual, and with our solvers."""
    config = rough(points, halfspace=True)
    case, mean_pressure = Case(config), PART * E_STAR * SLOPE
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
            solver = Case(config.with_values(given), transforms=case.transforms).contact.solver
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
