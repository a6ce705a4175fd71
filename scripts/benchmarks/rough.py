"""Rough two-dimensional surfaces: a run, first solves, error over work, other codes, threads and ranks.

`points` is the number along each axis. configs/rough-layer.yaml describes the surface; it is the same on any
grid that resolves it. A pair in single precision counts as half a pair in double precision. `rough_peers` has
the other codes; the section `slabs` compares threads and ranks.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from benchmarks import slabs
from benchmarks.common import Cell, Effort, Table, cpu_of_a_pair
from benchmarks.rough_peers import E_STAR, PART, RESIDUAL, SLOPE, compare, rough
from benchmarks.whole_run import effort_of_run

from gfmdlayer.contact.nested.solver import NestedGradient
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.model import warm_up
from gfmdlayer.simulation import Case

EFFORT = Effort(points=(512,), steps=100, repetitions=3)
QUICK = Effort(points=(128,), steps=20, repetitions=1)

_MEASURE = 0.2  # seconds of bare pairs in one measurement
_FEWEST = 128  # points of an axis of the finest of three grids that are compared, and of one over ranks
_AREAS = (0.03, 0.10, 0.39, 0.85)  # parts of the surface in contact
_WITHIN = 0.005  # of them
_LIGHT = 1e-3  # of the pressure of full contact at the lowest point, the first load
_ROUGHLY, _ROUNDS = 1e-4, 40  # residual and most solves of the search for a load
_BODIES: dict[str, dict[str, object]] = {
    "halfspace": {"layer.thickness": 0.0, "halfspace.shear_modulus": 1.0},
    "thin layer, nu = 0.3": {"layer.thickness": 0.03, "layer.poisson": 0.3},
    "incompressible layer": {"layer.thickness": 0.2},
    "layer on a base of a fifth": {"layer.thickness": 0.03, "halfspace.shear_modulus": 2.0},
}


def measure(effort: Effort) -> Iterator[Table]:
    """Run the layer on each grid; solve from rest; compare with other codes, threads and ranks."""
    yield _layer(effort)
    for points in effort.points:
        yield _cold(points)
        yield from compare(points, effort.repetitions)
    if (largest := max(effort.points)) >= _FEWEST:
        yield _accuracy(largest)
        yield from slabs.measure(replace(effort, points=(largest,)))


def _cold(points: int) -> Table:
    rows: list[dict[str, Cell]] = []
    for name, values in _BODIES.items():
        case = Case(rough(points).with_values(values))
        stiffness = np.array(case.integrator.terms(1e-9)[0])
        stiffness[0] = 0.0
        zero, transforms = np.zeros(stiffness.size, dtype=np.complex128), case.transforms
        closing = transforms.backward(stiffness * transforms.forward(case.punch)) / case.punch.size
        problem = Problem(stiffness, zero, case.punch, -_LIGHT * float(closing.min()))
        for area in _AREAS:
            problem = _of_area(case, problem, area)
            solver = NestedGradient(transforms, case.grid)
            solution = solver.solve(problem, np.zeros(case.punch.size), RESIDUAL)
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
    title = f"First solves by nested_gradient, {points} x {points} points, residual {RESIDUAL:g}"
    note = "Pairs on coarser grids count by their points, pairs in single precision count half."
    return Table(f"rough-cold-{points}", title, rows, note)


def _of_area(case: Case, problem: Problem, area: float) -> Problem:
    """Find the load of a contact area, to `_WITHIN`, by bisection; `problem` has less contact."""
    solver, lower, upper = NestedGradient(case.transforms, case.grid), problem, None
    pressure = np.zeros(case.punch.size)
    for _ in range(_ROUNDS):
        least, most = (float(each.mean_pressure or 0.0) if each else math.inf for each in (lower, upper))
        tried = replace(problem, mean_pressure=math.sqrt(least * most) if upper else 2.0 * least)
        found = solver.solve(tried, pressure, _ROUGHLY)
        pressure = found.pressure
        if abs(found.contact_area - area) <= _WITHIN:
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
        wisdom = warm_up(config)
        transforms = Transforms(config.grid.points, wisdom)
        single = transforms.of_shape(config.grid.points, single=True)
        taken = of_double = of_single = math.inf
        for _ in range(effort.repetitions):
            of_double = min(of_double, cpu_of_a_pair(transforms, _MEASURE))
            of_single = min(of_single, cpu_of_a_pair(single, _MEASURE))
            begun = time.process_time()
            pairs, iterations = effort_of_run(config, wisdom)
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
