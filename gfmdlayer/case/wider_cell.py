"""The cell inside of a contact without images: the period is the window that the user wants to see.

A cell answers without images up to a part of its width (`body.isolated`, `friction.isolated`). Where the
contact of a case will be wider, its cell is larger, with the same spacing and the user's points in its
middle. The punch ends with the window: outside it is above the surface.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.body.isolated import IsolatedBody, isolated
from gfmdlayer.body.solid import HALF, WIDEST, Boundary
from gfmdlayer.case.parts import Parts
from gfmdlayer.config import Config
from gfmdlayer.contact.loading import Loading
from gfmdlayer.contact.reach import Reach
from gfmdlayer.contact.solvers import AUTO, SOLVERS, choose
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.grid.wider import WiderCell
from gfmdlayer.interface.law import HARD_WALL, Interaction
from gfmdlayer.time_functions import Constant

# Cells that are tried, over the window; with friction twice the window holds every contact in it.
_FACTORS, _FRICTIONAL = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0), (1.0, 2.0)
_COARSE = 64  # points along an axis of the window, of an estimate
_EDGE = 1  # spacings of that grid by which a contact with friction may be wider
_OF_A_GRID = "grid", "transforms", "punch", "loading", "history", "solver", "guess"  # parts that are given
_SMALL_FACTOR = 7  # of the points of a cell, which has a fast transform


def in_its_cell(parts: Parts) -> Parts:
    """Return the parts of a case in the cell that its contact needs, perhaps a wider one."""
    if not parts.config.grid.isolated or parts.given(*_OF_A_GRID):
        return parts
    if (wider := _wider(parts)) is None:
        return parts
    return parts.inside(wider, within(parts.config, wider))


def within(config: Config, wider: WiderCell) -> Config:
    """Return a configuration with a wider cell."""
    cell = {"points": wider.whole.points, "period": wider.whole.period}
    return config.model_copy(update={"grid": config.grid.model_copy(update=cell)})


def _wider(parts: Parts) -> WiderCell | None:
    """Return the cell of a case whose contact needs a wider one; None for others.

    The contact is elastic, without friction, on a coarse grid, at the largest depth or force, with the
    attraction and the stiffness K(q, 1/t) of the time at which it is reached, and of the end of the run; at
    another temperature with the glassy and the relaxed one.
    """
    config, drive = parts.config, parts.drives.drive
    grid = parts.grid
    if not (config.grid.isolated and grid.is_whole and grid.ranks.count == 1):
        return None
    times = [*(time for time in drive.breakpoints if time < config.time.end), config.time.end]
    most = max(map(drive, times))
    first = min(time for time in times if drive(time) >= most - 1e-9 * abs(most))
    rates = math.inf if first == 0 else 1 / first, 1 / config.time.end
    if any(parts.drives.reduced_times):  # a temperature has other times
        rates = math.inf, 0.0
    return wider_cell(
        parts.body, grid, parts.punch, most, config.grid.without_images,
        rates=rates, by_depth=config.trajectory.control == "depth", friction=bool(config.friction),
        larger=bool(config.friction and config.interfaces), interface=parts.drives.interface.at(first),
    )  # fmt: skip


def wider_cell(
    body: Body,
    grid: Grid,
    heights: FloatArray,
    most: float,
    boundary: Boundary,
    *,
    rates: tuple[float, ...],
    by_depth: bool,
    friction: bool,
    larger: bool = False,
    interface: Interaction = HARD_WALL,
) -> WiderCell | None:
    """Return the smallest wider cell that a contact at a depth, or a mean pressure, needs.

    The body is relaxed at a rate, a Laplace variable, of zero, and glassy at an infinite one. None: the grid
    itself is such a cell, or none is. A `larger` one is asked for where the grid is known not to do.
    """
    width, given = math.nan, most if by_depth else most * math.prod(grid.period)
    deepest = float(np.ptp(heights))
    if by_depth:
        deepest = max(deepest, most)
    else:  # under a flat punch; the mean of a cell without images is four times as soft as its longest wave
        deepest += 4 * most / float(np.real(body.stiffness(2 * math.pi / max(grid.period), 0.0)))

    def around(whole: Grid) -> WiderCell:
        return WiderCell(grid.points, grid.period, whole, width, float(heights.max()) + 2 * deepest)

    for factor in (_FRICTIONAL if friction else _FACTORS)[larger:]:
        if factor * (HALF if friction else WIDEST) < width:
            continue
        whole = _larger(grid, factor, boundary)
        if friction and factor == _FRICTIONAL[-1]:
            return around(whole)
        try:
            alone = isolated(body, whole.period, boundary)
        except ValueError:  # its response needs a larger cell
            continue
        reach = partial(Reach, boundary=boundary, body=None if friction else alone)
        width = _estimate(alone, reach, around(whole), heights, given, rates, interface, by_depth=by_depth)
        fewest = min(_COARSE, *(grid.points[axis] for axis in boundary.axes))
        most_wide = HALF - _EDGE / fewest if friction else alone.reach
        if width <= factor * most_wide:
            return None if factor == 1 else around(whole)
    return None


def _larger(grid: Grid, factor: float, boundary: Boundary) -> Grid:
    """Return a grid of the same spacing with so many times the points, or some more that transform well."""
    every_axis = zip(grid.points, boundary.isolated, strict=True)
    points = tuple(_next(n, factor) if alone else n for n, alone in every_axis)
    every = zip(points, grid.points, grid.period, strict=True)
    return Grid(points, tuple(period * (many / n) for many, n, period in every))


def _next(points: int, factor: float) -> int:
    """Return so many times the points, or some more of the same parity and no larger prime factors."""
    if factor == 1:
        return points
    many, largest = math.ceil(factor * points), max(_largest_factor(points), _SMALL_FACTOR)
    while (many - points) % 2 or _largest_factor(many) > largest:
        many += 1
    return many


def _largest_factor(number: int) -> int:
    factor = 2
    while factor * factor <= number:
        if number % factor == 0:
            number //= factor
        else:
            factor += 1
    return number


def _estimate(
    body: IsolatedBody,
    reach: Callable[[Grid], Reach],
    wider: WiderCell,
    heights: FloatArray,
    most: float,
    rates: tuple[float, ...],
    interface: Interaction,
    *,
    by_depth: bool,
) -> float:
    """Return the width of the contact at a depth or a force, in periods of the wider."""
    ratio = wider.factor
    touching = replace(wider, above=0.0).extended(np.where(heights > 0, 0.0, 1.0))
    width = reach(wider.whole).width(touching)
    if most <= 0 and not interface.attracts:
        return width * ratio
    each = [k if n % (k := max(1, n // _COARSE)) == 0 else 1 for n in wider.points]
    some = heights.reshape(wider.points)[tuple(slice(None, None, k) for k in each)]
    whole = Grid(tuple(-(-n // k) for n, k in zip(wider.whole.points, each, strict=True)), wider.whole.period)
    coarse = replace(wider, points=some.shape, whole=whole)
    drive = Constant(most if by_depth else most / math.prod(whole.period))
    loading = Loading(coarse.extended(some), drive, interface, by_depth=by_depth)
    method = choose(AUTO, axes=2, rough=True, attracts=interface.attracts).method
    solver, spectrum = (
        SOLVERS[method].load()(Transforms(whole.points), grid=whole),
        body.spectrum(whole.waves),
    )
    start = math.inf if interface.attracts else 0.0  # of a gap, or of a pressure
    for rate in rates:
        kappa = np.ravel(spectrum.stiffness(rate) if math.isfinite(rate) else spectrum.glassy)
        nothing = np.zeros(kappa.shape, dtype=np.complex128)
        found = solver.solve(loading.problem(kappa, nothing, 0.0), np.full(whole.size, start), 1e-3)
        if found.converged:
            width = max(width, reach(whole).width(found.pressure))
    return width * ratio
