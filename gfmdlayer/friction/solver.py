"""The solver of `Problem`: Newton's method from a guess or from nothing, by coarser grids."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import FloatArray
from gfmdlayer.friction.newton import Newton
from gfmdlayer.friction.problem import Law, Problem, Solution, State, norms
from gfmdlayer.friction.response import Operator, Response, Spent
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms

_COARSEST = 16  # points of an axis
_COARSE_TOLERANCE = 1e-4
_LIMIT = 60  # Newton steps


class FrictionSolver:
    """Frictional contact of the steps of a run on one grid; keeps plans and what the last step left.

    Parameters
    ----------
    grid : Grid
        Of one or two axes.
    transforms : Transforms
        Plans for its shape, in double precision.
    """

    def __init__(self, grid: Grid, transforms: Transforms) -> None:
        self._levels = [_Level(grid, transforms)]
        while (coarser := self._levels[-1].coarser()) is not None:
            self._levels.append(coarser)

    def solve(
        self, problem: Problem, start: FloatArray | None = None, *, tolerance: float = 1e-7, limit: int = _LIMIT
    ) -> Solution:
        """Solve from a guess of the tractions (p, t_x[, t_y]), or from nothing."""
        spent = Spent()
        if reason := problem.why_not_solvable():
            raise ValueError(reason)
        newton = self._levels[0].newton(problem.response, spent, 1.0)
        if start is None:
            at, steps = self._from_nothing(problem, 0, tolerance, spent, limit)
        else:
            at, steps = newton.solve(problem, start, tolerance, limit)
        return _solution(problem, at, steps, spent, tolerance)

    def _from_nothing(
        self, problem: Problem, number: int, tolerance: float, spent: Spent, limit: int
    ) -> tuple[State, int]:
        """Solve on a grid, with a guess from the next coarser one."""
        level = self._levels[number]
        newton = level.newton(problem.response, spent, level.grid.size / self._levels[0].grid.size)
        if number + 1 == len(self._levels):
            return newton.solve(problem, _rough_guess(problem), tolerance, limit)
        coarser = self._levels[number + 1]
        below, steps = self._from_nothing(
            _coarser(problem, level, coarser), number + 1, _COARSE_TOLERANCE, spent, limit
        )
        guess = _finer(below.x, coarser.grid.points, level.grid.points)
        at, more = newton.solve(problem, guess, tolerance, limit)
        return at, more


class _Level:
    """One of the nested grids."""

    def __init__(self, grid: Grid, transforms: Transforms) -> None:
        self.grid, self.transforms = grid, transforms
        self._plans = {False: transforms, True: transforms.of_shape(grid.points, single=True)}
        self._newton: Newton | None = None
        self._response: Response | None = None

    def newton(self, response: Response, spent: Spent, share: float) -> Newton:
        """Return Newton's method for a response, with what it kept of the last one."""
        C = Operator(self.grid, response, self._plans, spent, share)
        K = Operator(self.grid, response.inverse(self.grid), self._plans, spent, share)
        kept = self._newton._ones if self._newton is not None else None
        self._newton = Newton(C, K)
        self._newton._ones = kept
        return self._newton

    def coarser(self) -> _Level | None:
        """Return the level with half of the points of each long axis."""
        points = tuple(n // 2 if n > _COARSEST and n % 2 == 0 else n for n in self.grid.points)
        if points == self.grid.points:
            return None
        return _Level(replace(self.grid, points=points), self.transforms.of_shape(points))


def _rough_guess(problem: Problem) -> FloatArray:
    """Return a pressure in proportion to the overlap with the lowest third, and shear in proportion to it."""
    h = problem.gap_at_rest
    p = np.maximum(np.quantile(h, 0.3) - h, 0.0) + 1e-12 * (np.ptp(h) + 1e-300)
    axes = problem.response.normal.ndim
    softest = float(problem.response.normal.max())
    p *= (problem.load if problem.load is not None else 1e-3 * max(problem.depth - h.min(), 0) / softest) / p.mean()
    x = np.zeros((1 + axes, h.size))
    x[0] = p
    if problem.force_is_given and problem.load:
        x[1:] = (problem.force / problem.load)[:, np.newaxis] * p  # type: ignore[operator]
    return x


def _halved(field: FloatArray, fine: tuple[int, ...], coarse: tuple[int, ...]) -> FloatArray:
    """Return a field on a coarser grid, with weights 1/4, 1/2, 1/4 along each axis that is halved."""
    found = field.reshape(*field.shape[:-1], *fine)
    first = found.ndim - len(fine)
    for axis, (many, few) in enumerate(zip(fine, coarse, strict=True), first):
        if many != few:
            found = 0.5 * found + 0.25 * (np.roll(found, 1, axis) + np.roll(found, -1, axis))
            found = np.take(found, np.arange(0, many, 2), axis)
    return np.ascontiguousarray(found).reshape(*field.shape[:-1], -1)


def _finer(field: FloatArray, coarse: tuple[int, ...], fine: tuple[int, ...]) -> FloatArray:
    """Return a field on a finer grid, interpolated linearly along each axis that is doubled."""
    found = field.reshape(*field.shape[:-1], *coarse)
    first = found.ndim - len(coarse)
    for axis, (few, many) in enumerate(zip(coarse, fine, strict=True), first):
        if many != few:
            doubled = np.repeat(found, 2, axis)
            between: list[Any] = [slice(None)] * found.ndim
            between[axis] = slice(1, None, 2)
            doubled[tuple(between)] = 0.5 * (found + np.roll(found, -1, axis))
            found = doubled
    return found.reshape(*field.shape[:-1], -1)


def _coarser(problem: Problem, fine: _Level, coarse: _Level) -> Problem:
    """Return the problem on a coarser grid."""

    def on(field: NDArray[Any] | None) -> FloatArray | None:
        return None if field is None else _halved(field, fine.grid.points, coarse.grid.points)

    law = problem.law
    if np.ndim(law.coefficient):
        law = Law(on(law.coefficient), law.strength)  # type: ignore[arg-type]
    return replace(
        problem,
        response=problem.response.on(fine.transforms, coarse.transforms),
        heights=on(problem.heights),  # type: ignore[arg-type]
        law=law,
        offset=on(problem.offset),
        before=on(problem.before),
    )


def _solution(problem: Problem, at: State, steps: int, spent: Spent, tolerance: float) -> Solution:
    """Return a state as a solution."""
    Cx = at.Cx if problem.offset is None else at.Cx + problem.offset
    slip = problem.slip_at_rest + at.Cx[1:] - at.path[:, np.newaxis]
    traction = at.x[1:]
    stick = (at.x[0] > 0) & (norms(traction) < problem.law.bound(at.x[0]) * (1 - 1e-9))
    converged = at.residual < tolerance
    reason = "" if converged else f"residual {at.residual:.2e} after {steps} steps; the tolerance is {tolerance:.2e}"
    return Solution(
        pressure=at.x[0],
        traction=traction,
        displacement=Cx,
        gap=problem.gap_at_rest + at.Cx[0] - at.depth,
        slip=slip,
        depth=at.depth,
        path=at.path,
        stick=stick,
        residual=at.residual,
        pairs=spent.pairs,
        iterations=steps,
        converged=converged,
        reason=reason,
    )
