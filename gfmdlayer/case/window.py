"""The cell inside of a contact without images: the period is the window that the user wants to see.

A cell answers without images up to a part of its width (`body.isolated`, `friction.isolated`). Where the
contact of a case will be wider, its cell is larger, with the same spacing and the user's points in its
middle. The punch ends with the window: outside it is above the surface.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.body.isolated import IsolatedBody, isolated
from gfmdlayer.body.solid import HALF, WIDEST
from gfmdlayer.case.parts import Parts
from gfmdlayer.config import Config
from gfmdlayer.contact.loading import Loading
from gfmdlayer.contact.nested.solver import NestedGradient
from gfmdlayer.contact.reach import Reach
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.time_functions import Constant

# Cells that are tried, over the window; with friction twice the window holds every contact in it.
_FACTORS, _FRICTIONAL = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0), (1.0, 2.0)
_COARSE = 64  # points along an axis of the window, of an estimate
_EDGE = 1  # spacings of that grid by which a contact with friction may be wider
_SMALL_FACTORS = (2, 3, 5, 7)  # of the points of a cell


@dataclass(frozen=True)
class Window:
    """The points of a user in the middle of a larger grid of the same spacing."""

    points: tuple[int, ...]
    period: tuple[float, ...]
    whole: Grid
    width: float  # of the contact as it was estimated, in periods of the window; NaN where it is not known
    above: float  # height of the punch outside, over its lowest point

    def config(self, config: Config) -> Config:
        """Return the configuration with the larger cell."""
        cell = {"points": self.whole.points, "period": self.whole.period}
        return config.model_copy(update={"grid": config.grid.model_copy(update=cell)})

    def extended(self, heights: FloatArray) -> FloatArray:
        """Return heights of the punch on the larger grid, one value a point."""
        everywhere = np.full(self.whole.points, self.above)
        everywhere[self._inside] = heights.reshape(self.points)
        return everywhere.ravel()

    def seen(self, field: NDArray[np.generic]) -> NDArray[np.generic]:
        """Return the part of a field on the larger grid that the user sees."""
        return np.ascontiguousarray(field[self._inside])

    @property
    def account(self) -> str:
        """Say what the larger cell costs."""
        points, periods = " x ".join(map(str, self.whole.points)), self.whole.period[0] / self.period[0]
        wide = "" if math.isnan(self.width) else f", for a contact some {self.width:.2g} periods wide"
        times = self.whole.size / math.prod(self.points)
        return f"a cell of {periods:.3g} periods inside{wide}: {points} points, {times:.3g} times as many"

    @property
    def _inside(self) -> tuple[slice, ...]:
        first = [(most - n) // 2 for most, n in zip(self.whole.points, self.points, strict=True)]
        return tuple(slice(at, at + n) for at, n in zip(first, self.points, strict=True))


def window_of(parts: Parts) -> Window | None:
    """Return the window of a case whose contact needs a larger cell; None for others.

    The contact is elastic, without attraction and friction, on a coarse grid, at the largest depth or force,
    both glassy and relaxed. Between these two is a body of which one material relaxes.
    """
    config, drive = parts.config, parts.drives.drive
    grid = parts.grid
    if not (config.grid.isolated and grid.is_whole and grid.ranks.count == 1):
        return None
    times = [*(time for time in drive.breakpoints if time < config.time.end), config.time.end]
    most = max(map(drive, times))
    return fitting_window(
        parts.body, grid, parts.punch, most, config.grid.datum,
        by_depth=config.trajectory.control == "depth", friction=bool(config.friction),
        larger=bool(config.friction and config.interfaces),
    )  # fmt: skip


def fitting_window(
    body: Body,
    grid: Grid,
    heights: FloatArray,
    most: float,
    datum: float | None,
    *,
    by_depth: bool,
    friction: bool,
    larger: bool = False,
) -> Window | None:
    """Return the window in the smallest cell that a contact at a depth, or a mean pressure, needs.

    None: the grid itself is such a cell, or none is. A `larger` one is needed where the grid is known not to do.
    """
    width, deepest = math.nan, float(np.ptp(heights))
    given = most if by_depth else most * math.prod(grid.period)

    def window(whole: Grid) -> Window:
        return Window(grid.points, grid.period, whole, width, float(heights.max()) + 2 * deepest)

    for factor in (_FRICTIONAL if friction else _FACTORS)[larger:]:
        if factor * (HALF if friction else WIDEST) < width:
            continue
        whole = _larger(grid, factor)
        if friction and factor == _FRICTIONAL[-1]:
            return window(whole)
        try:
            alone = isolated(body, whole.period, datum)
        except ValueError:  # its response needs a larger cell
            continue
        reach = partial(Reach, body=None if friction else alone)
        width, deepest = _estimate(alone, reach, window(whole), heights, given, by_depth=by_depth)
        most_wide = HALF - _EDGE / min(*grid.points, _COARSE) if friction else alone.reach
        if width <= factor * most_wide:
            return None if factor == 1 else window(whole)
    return None


def _larger(grid: Grid, factor: float) -> Grid:
    """Return a grid of the same spacing with so many times the points, or some more that transform well."""
    points = tuple(_next(n, factor) for n in grid.points)
    every = zip(points, grid.points, grid.period, strict=True)
    return Grid(points, tuple(period * (many / n) for many, n, period in every))


def _next(points: int, factor: float) -> int:
    if factor == 1:
        return points
    many = math.ceil(factor * points)
    while (many - points) % 2 or not _transforms_well(many):
        many += 1
    return many


def _transforms_well(points: int) -> bool:
    for factor in _SMALL_FACTORS:
        while points % factor == 0:
            points //= factor
    return points == 1


def _estimate(
    body: IsolatedBody,
    reach: Callable[[Grid], Reach],
    window: Window,
    heights: FloatArray,
    most: float,
    *,
    by_depth: bool,
) -> tuple[float, float]:
    """Return the width of the contact at a depth or a force, in periods of the window, and its depth."""
    ratio = window.whole.period[0] / window.period[0]
    touching = replace(window, above=0.0).extended(np.where(heights > 0, 0.0, 1.0))
    width, deepest = reach(window.whole).width(touching), float(np.ptp(heights))
    if most <= 0:
        return width * ratio, deepest
    each = [k if n % (k := max(1, n // _COARSE)) == 0 else 1 for n in window.points]
    some = heights.reshape(window.points)[tuple(slice(None, None, k) for k in each)]
    whole = Grid(tuple(-(-n // k) for n, k in zip(window.whole.points, each, strict=True)), window.whole.period)
    coarse = replace(window, points=some.shape, whole=whole, above=window.above + max(window.period))
    drive = Constant(most if by_depth else most / math.prod(whole.period))
    loading = Loading(coarse.extended(some), drive, by_depth=by_depth)
    solver, spectrum = NestedGradient(Transforms(whole.points), whole), body.spectrum(whole.waves)
    for kappa in map(np.ravel, (spectrum.glassy, spectrum.relaxed)):
        nothing = np.zeros(kappa.shape, dtype=np.complex128)
        found = solver.solve(loading.problem(kappa, nothing, 0.0), np.zeros(whole.size), 1e-3)
        if found.converged:
            width = max(width, reach(whole).width(found.pressure))
            deepest = max(deepest, loading.surface(found, kappa, nothing, 0.0).depth)
    return width * ratio, deepest
