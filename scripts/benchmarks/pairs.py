"""FFT pairs per time step: of each solver on growing grids; of FIRE by inertia and guess; with friction."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from benchmarks.common import METHODS, STEP, Cell, Effort, Table, default_case, run

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.layers import halfspace
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate
from gfmdlayer.contact.prediction import DisplacementPrediction
from gfmdlayer.friction.problem import FrictionProblem
from gfmdlayer.friction.response import Response
from gfmdlayer.friction.solver import FrictionSolver
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.interface.friction import ShearBound
from gfmdlayer.punch.self_affine import SelfAffine
from gfmdlayer.results.recording import Recording
from gfmdlayer.resumable import Stateless

EFFORT = Effort(points=(1 << 12, 1 << 14, 1 << 16))
QUICK = Effort(points=(1 << 10, 1 << 12), steps=100)
LARGE = 1 << 20  # only for the active set

_INGREDIENTS_AT = 1 << 14
_STARTS = {1: "last step", 2: "straight line"}  # by the number of past steps
# Frictional contacts on a halfspace of nu = 0.3: points, axes, pairs that a first solve and a step may take.
_FRICTIONAL = {
    "cylinder": (1 << 12, 1, 80, 40),
    "rolling cylinder": (1 << 10, 1, None, 30),
    "sphere": (256, 2, 150, 60),
    "rough surface": (256, 2, 200, 100),
    "rough line": (1 << 14, 1, 250, None),
}
_FRICTION, _LOAD, _COURSE = 0.4, 0.01, 20
# Steady rolling: points, axes, and creepage along x and spin, over those with which all slips, some mu a/R.
_ROLLING = {
    "cylinder": (1 << 10, 1, 0.3, 0.0),
    "sphere": (64, 2, 0.5, 0.0),
    "sphere, finer": (256, 2, 0.5, 0.0),
    "sphere with spin": (64, 2, 0.2, 0.5),
    "sphere with spin, finer": (256, 2, 0.2, 0.5),
}
_LENGTHS = 3  # of the contact, which marching takes to the state


def measure(effort: Effort) -> Iterator[Table]:
    """Count the pairs of all steps after t = 0."""
    rows = [
        _row(method, points, effort.steps)
        for method in METHODS
        for points in effort.points
        if points < LARGE or method == "active_set"
    ]
    title = f"FFT pairs per step, {effort.steps} steps of {STEP} tau, residual 1e-6"
    note = (
        "Targets at n = 16384: active_set ≤ 8 in the ramp and ≤ 5 in the hold; "
        "fire ≤ 120 over all steps, at n = 65536 at most 1.5 times as many. FIRE is mass-weighted here."
    )
    yield Table("pairs", title, rows, note)
    at = max((points for points in effort.points if points <= _INGREDIENTS_AT), default=effort.points[0])
    ingredients: list[dict[str, Cell]] = [
        {"inertia": inertia, "start": start, **_counts(_fire(at, effort.steps, inertia, past))}
        for inertia in ("uniform", "mass_weighted")
        for past, start in _STARTS.items()
    ]
    yield Table("ingredients", f"FIRE by inertia and first guess: FFT pairs per step, n = {at}", ingredients)
    note = (
        "Steps: twentieths of the tangential force up to 0.95 of the largest, or rolling by a spacing with "
        "a creepage of 0.005. Each component counts; pairs in single precision count half."
    )
    rows = [
        _frictional(name, *of) for name, of in _FRICTIONAL.items() if of[0] ** of[1] <= max(effort.points)
    ]
    if rows:
        yield Table("friction", "FFT pairs with friction, mu = 0.4, residual 1e-7", rows, note)
    note = (
        f"Marching by a spacing from the contact without shear over {_LENGTHS} lengths of it; its last force "
        "along x over that of the state found at once. Counted as above."
    )
    rows = [_steady(name, *of) for name, of in _ROLLING.items() if of[0] ** of[1] <= max(effort.points)]
    if rows:
        yield Table("rolling", "Steady rolling at once and by marching: FFT pairs", rows, note)


def _row(method: str, points: int, steps: int) -> dict[str, Cell]:
    config = default_case(
        grid__points=points, time__end=steps * STEP, solver={"method": method, "tolerance": 1e-6}
    )
    trace = run(config)
    return {
        "solver": method,
        "n": points,
        **_counts(trace),
        "most": int(trace["transforms"][1:].max()),
        "largest residual": float(trace["residual"].max()),
    }


def _counts(trace: Recording) -> dict[str, Cell]:
    """Mean FFT pairs of a step in the ramp, in the hold, and in both."""
    times, pairs = trace["time"][1:], trace["transforms"][1:]
    in_ramp = times <= 1 + STEP / 2
    return {"ramp": _mean(pairs[in_ramp]), "hold": _mean(pairs[~in_ramp]), "all": _mean(pairs)}


def _mean(values: FloatArray) -> float | None:
    return float(values.mean()) if values.size else None


def _frictional(
    name: str, points: int, axes: int, first_target: int | None, step_target: int | None
) -> dict[str, Cell]:
    """Count the pairs of a first solve and of the steps from it."""
    grid, rolls = Grid((points,) * axes, (1.0,) * axes), name.startswith("rolling")
    solver, most = FrictionSolver(grid, Transforms(grid.points)), 0.95 * _FRICTION * _LOAD
    problem = _pressed(grid, rough=name.startswith("rough"))
    first = found = solver.solve(replace(problem, force=np.zeros(axes)))
    pairs, done = [], first.converged
    for i in range(1, 1 + _COURSE):
        u = found.displacement[1:]
        if rolls:
            step = replace(problem, path=np.array([0.005 / points]), before=np.roll(u, -1, axis=-1))
        else:
            force = np.eye(axes)[0] * most * i / _COURSE
            step = replace(problem, force=force, before=u)
        found = solver.solve(step, found.tractions)
        pairs.append(found.pairs)
        done &= found.converged
    return {
        "contact": name,
        "grid": "×".join(map(str, grid.points)),
        "in contact": float(first.contact.mean()),
        "first solve": first.pairs,
        "target": first_target,
        "step": float(np.mean(pairs)),
        "most": max(pairs),
        "step's target": step_target,
        "converged": str(done),
    }


def _pressed(grid: Grid, *, rough: bool = False) -> FrictionProblem:
    """A parabola, or a rough surface, pressed on the halfspace."""
    if rough:
        shape = SelfAffine(hurst=0.8, short_cutoff=2.5 / grid.points[0], rms_height=0.003, seed=1)
        h = np.ravel(shape.heights(grid))
    else:
        h = np.ravel(sum(x**2 for x in np.meshgrid(*grid.coordinates, indexing="ij"))) / 0.5
    stiffness = halfspace(1.0, poisson=0.3).traction_spectrum(grid.waves)
    response = Response.of_stiffness(stiffness.in_plane.relaxed, stiffness.across.relaxed)
    return FrictionProblem(response, h - h.min(), ShearBound(_FRICTION), load=_LOAD)


def _steady(name: str, points: int, axes: int, creepage: float, spin: float) -> dict[str, Cell]:
    """Count the pairs of the state of steady rolling, at once and by steps."""
    grid, way = Grid((points,) * axes, (1.0,) * axes), 1 / points
    solver, problem = FrictionSolver(grid, Transforms(grid.points)), _pressed(grid)
    last = solver.solve(replace(problem, force=np.zeros(axes), law=ShearBound(0.0)))
    length = int(np.count_nonzero(last.contact.reshape(grid.points).any(axis=tuple(range(1, axes)))))
    a, radius = 0.5 * length * way, 0.25
    path = np.array([creepage * _FRICTION * a / radius * way, 0.0][:axes])
    before = np.zeros((axes, grid.size))
    if spin:
        x, y = (each.ravel() for each in np.meshgrid(*grid.coordinates, indexing="ij"))
        before = spin * _FRICTION / radius * way * np.stack((-y, x + way / 4))
    state = solver.solve(replace(problem, path=path, before=before, way=way))
    pairs, done = [], state.converged
    for _ in range(_LENGTHS * length):
        u = np.roll(last.displacement[1:].reshape(axes, *grid.points), -1, axis=1).reshape(axes, -1)
        last = solver.solve(replace(problem, path=path, before=before + u), last.tractions)
        pairs.append(last.pairs)
        done &= last.converged
    return {
        "contact": name,
        "grid": "×".join(map(str, grid.points)),
        "points along it": length,
        "sticks": float(state.stick.sum() / state.contact.sum()),
        "at once": state.pairs,
        "a step": float(np.mean(pairs)),
        "marching": float(np.sum(pairs)),
        "marching / at once": float(np.sum(pairs) / state.pairs),
        "force": float(last.traction[0].mean() / state.traction[0].mean()),
        "converged": str(done),
    }


class _Extrapolation(Stateless):
    """Extrapolation of the displacement from the last `past` steps."""

    def __init__(self, points: int, past: int) -> None:
        self._size, self._fields = points, deque[tuple[float, FloatArray]](maxlen=past)

    def at(self, time: float) -> FloatArray:
        """Return the displacement at a time."""
        guess = DisplacementPrediction(self._size)
        for each, field in self._fields:
            guess.remember(each, field, field)
        return guess.at(time)

    def remember(self, time: float, field: FloatArray, _gap: FloatArray, at_breakpoint: bool = False) -> None:
        """Keep an accepted step; steps before a breakpoint are forgotten."""
        if at_breakpoint:
            self._fields.clear()
        self._fields.append((time, field))


def _fire(points: int, steps: int, inertia: str, past: int) -> Recording:
    """Run FIRE, started from the last `past` fields."""
    config = default_case(
        grid__points=points, time__end=steps * STEP, solver={"method": "fire", "inertia": inertia}
    )
    recording = Recording()
    simulate(Case(config, guess=_Extrapolation(points, past)), recording)
    return recording
