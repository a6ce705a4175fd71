"""A V-cycle of stencils: M, close to the inverse of K + D on the free points, without a transform.

D = w'' + damping is a stiffness of each point by itself. Each grid has about half of the points per axis of
the one above it, the 13 taps of kappa truncated to its modes (`stencil`), and its own D. A point of a grid
yields with the compliance c by the modes that the next grid lacks, in series with D:

    share = 1/(1 + c D)                 of a motion of the next grid that the point follows; 0 where pressed
    D below = mean of D share           1/c where pressed, by the weights of linear interpolation

so that contact, stiff repulsion and attraction reach all grids by one formula. With r the force and
B = smoothing/max(s_0 + D, s_0/2), s_0 the tap in the middle, 0 where pressed, a cycle is

    x = B r;  x += share P x_below, x_below from P^T share (r - (S + D) x);  x += B (r - (S + D) x).

The last grid is solved directly, with the magnitudes of its eigenvalues. M is symmetric, and positive where
B (S + D) < 2, even if K + D is not: conjugate gradients still meet negative curvature.

Of several ranks each holds its rows of the finest grid, and all of the others, a third of its points. Each
adds up the rows of the next grid that its own reach, and all bring these together.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numba as nb
import numpy as np

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.contact.stencil import REACH, sample, stencil, symbol
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.slabs import SlabGrid
from gfmdlayer.grid.transforms import execute, truncated
from gfmdlayer.kernels import kernel

_FEWEST = 4  # points of an axis at least: the last grid has 4 to 7 along each
_SAME = 0.7  # stiffness of the shortest wave along an axis, over the other's, at which both are halved
_SMOOTHING, _POSITIVE = 0.75, 1.4  # B s_0, and bound on B times the largest symbol
_SOFT = -0.5  # c D at least
_MISFIT = 0.5  # of a stencil, relative, from which on there is no cycle
_LOWEST = 0.25  # eigenvalue of the last grid at least, over kappa_1
_NONE, _ONE = np.float32(0.0), np.float32(1.0)


class Cycle(NamedTuple):
    """All grids in one array each, the finest first; no grid where there is no cycle."""

    grids: IntArray  # rows and columns held, first point, first row, and all rows of each
    unit: float  # of all stiffness here
    weights: Any  # of the stencils
    point: FloatArray  # c of each grid
    smoothing: FloatArray  # B s_0
    lowest: float  # eigenvalue of the last grid, at least
    matrix: FloatArray  # K of the last grid
    inverse: Any  # of K + D there
    D: Any
    share: Any
    B: Any
    r: Any  # forces, of all but the finest
    x: Any
    result: Any  # of all but the finest
    one: Any  # M 1 on the free points
    beside: Any  # rows of the finest grid beside those held, (4, columns)
    reached: Any  # rows of the next grid that these reach
    exchange: int  # address of the function that writes `beside`; 0 on one process
    join: int  # of the one that brings the rows reached together


def no_cycle() -> Cycle:
    """Return a cycle without a grid."""
    return _cycle(Grid((1, 1), (1.0, 1.0)), [], 1.0, [], [], 0.0)


def cycle_of(whole: Grid, stiffness: FloatArray, kappa_1: float) -> Cycle:
    """Return the cycle on a grid for a stiffness, one value a mode.

    It has no grid for lines, small surfaces, and where the stencils do not describe the stiffness.
    """
    shape, stiffness = whole.points, whole.every_mode(stiffness)
    unit = 2.0 ** np.floor(np.log2(max(kappa_1, 1e-300)))
    shapes = _shapes(shape, stiffness)
    if len(shapes) < 2:
        return no_cycle()
    kappa, weights, constants = stiffness / unit, [], []
    for points, below in pairwise(shapes):
        grid = Grid(points, (1.0,) * len(points))
        modes, taps = sample(grid), stencil(grid, kappa)
        rows, columns = np.divmod(modes, points[1] // 2 + 1)
        waves = np.minimum(rows, points[0] - rows), columns
        lacking = np.zeros(modes.size, dtype=bool)
        for axis, wave in enumerate(waves):
            lacking |= (2 * wave >= below[axis]) & (below[axis] < points[axis])
        exact, found = np.maximum(kappa[modes], kappa_1 / unit), symbol(grid, taps, modes)
        if not (taps[0] > 0 and (np.abs(found / exact - 1)[lacking] < _MISFIT).all()):
            return no_cycle()
        weights.append(taps)
        constants.append(
            ((lacking / exact).mean(), min(_SMOOTHING, _POSITIVE * float(taps[0]) / found.max()))
        )
        kappa = truncated(kappa, points, below)
    cycle = _cycle(whole, shapes, unit, weights, constants, _LOWEST * kappa_1 / unit)
    height, width = shapes[-1]
    kappa = np.where(kappa > 0, kappa, 0.5 * kappa_1 / unit)
    response = np.fft.irfft2(kappa.reshape(height, -1), (height, width))
    i, j = np.divmod(np.arange(height * width), width)
    cycle.matrix[:] = response[(i[:, np.newaxis] - i) % height, (j[:, np.newaxis] - j) % width]
    return cycle


def _shapes(shape: tuple[int, ...], stiffness: FloatArray) -> list[tuple[int, ...]]:
    """The grids: the axis along which the shortest wave is stiffest is halved, or both, to the last grid."""
    shapes = [shape]
    if len(shape) < 2 or min(shape) < _FEWEST:
        return shapes
    kappa = stiffness
    while max(shape) >= 2 * _FEWEST:
        modes = kappa.reshape(shape[0], -1)
        stiffest = [
            k if n >= 2 * _FEWEST else 0.0
            for n, k in zip(shape, (modes[shape[0] // 2, 0], modes[0, -1]), strict=True)
        ]
        below = tuple(
            (n + 1) // 2 if n >= 2 * _FEWEST and k >= _SAME * max(stiffest) else n
            for n, k in zip(shape, stiffest, strict=True)
        )
        kappa, shape = truncated(kappa, shape, below), below
        shapes.append(shape)
    return shapes


def _cycle(
    whole: Grid,
    shapes: list[tuple[int, ...]],
    unit: float,
    weights: list[Any],
    constants: list[tuple[float, float]],
    lowest: float,
) -> Cycle:
    held = [whole.shape, *shapes[1:]] if shapes else []
    points = np.array([np.prod(shape) for shape in held], dtype=np.int64)
    grids = np.array(held, dtype=np.int64).reshape(-1, 2)
    rows, first = [shape[0] for shape in shapes], np.zeros(len(shapes), np.int64)
    first[:1] = whole.first_row
    grids = np.column_stack((grids, np.cumsum(points) - points, first, np.array(rows, dtype=np.int64)))
    size, last = int(points.sum()), int(points[-1]) if shapes else 0
    finest = int(points[0]) if shapes else 0
    D, share, B, x = (np.zeros(size, np.float32) for _ in range(4))
    r, result = (np.zeros(size - finest, np.float32) for _ in range(2))
    point, smoothing = np.array(constants).reshape(-1, 2).T.copy()
    beside, reached, exchange, join = np.empty((0, 0), np.float32), np.empty((0, 0), np.float32), 0, 0
    if shapes and isinstance(whole, SlabGrid):
        beside, below = np.empty((2 * REACH, shapes[0][1]), np.float32), shapes[1]
        begin, end = (row * below[0] // shapes[0][0] for row in (whole.rows.start, whole.rows.stop - 1))
        reached = np.empty((end + 2 - begin, below[1]), np.float32)
        exchange = whole.exchange_of_rows(REACH, np.float32)
        join = whole.sum_of_rows(below, begin, len(reached), np.float32)
    return Cycle(
        grids, unit, np.array(weights, np.float32).reshape(-1, 6), point, smoothing, lowest,
        np.zeros((last, last)), np.zeros((last, last), np.float32),
        D, share, B, r, x, result, np.zeros(finest, np.float32), beside, reached, exchange, join,
    )  # fmt: skip


@kernel(reorder=True, inner=True)
def set_cycle(cycle: Cycle, free: Any, stiffness: Any, unit: float) -> None:
    """Take the free points, 1 where one moves, and their D, in a unit; find M 1."""
    per, last = np.float32(unit / cycle.unit), cycle.grids.shape[0] - 1
    _scale(per, stiffness, cycle.D)
    for level in range(last):
        first, end = cycle.grids[level, 2], cycle.grids[level, 2] + _points(cycle, level)
        middle, point = cycle.weights[level, 0], np.float32(cycle.point[level])
        D, share, B, mean = cycle.D[first:end], cycle.share[first:end], cycle.B[first:end], cycle.x[first:end]
        _yield(np.float32(cycle.smoothing[level]), middle, point, D, share, B, mean)
        if level == 0:
            _press(point, free, share, B, mean)
        _restrict(cycle, level, mean, cycle.D[end : end + _points(cycle, level + 1)])
    first, size = cycle.grids[last, 2], cycle.matrix.shape[0]
    whole = cycle.matrix.copy()
    for i in range(size):
        whole[i, i] += cycle.D[first + i]
    values, vectors = np.linalg.eigh(whole)
    for k in range(size):
        values[k] = 1.0 / max(abs(values[k]), cycle.lowest)
    cycle.inverse[:] = ((vectors * values) @ vectors.T).astype(np.float32)
    run_cycle(cycle, free, cycle.one)
    for i in range(free.size):
        cycle.one[i] *= free[i]


@kernel(reorder=True, inner=True)
def _scale(factor: Any, source: Any, target: Any) -> None:
    for i in range(source.size):
        target[i] = factor * source[i]


@kernel(reorder=True, inner=True)
def _yield(smoothing: Any, middle: Any, c: Any, D: Any, share: Any, B: Any, mean: Any) -> None:
    """Write share, B, and D share of free points."""
    softest, least = np.float32(_SOFT) / c, np.float32(0.5) * middle
    for i in range(D.size):
        yields, stiff = D[i], middle + D[i]
        yields = yields if yields > softest else softest
        part = _ONE / (_ONE + c * yields)
        share[i], mean[i] = part, D[i] * part
        B[i] = smoothing / (stiff if stiff > least else least)


@kernel(reorder=True, inner=True)
def _press(c: Any, free: Any, share: Any, B: Any, mean: Any) -> None:
    """Write the same of pressed points."""
    for i in range(free.size):
        share[i], B[i] = free[i] * share[i], free[i] * B[i]
        mean[i] = free[i] * mean[i] + (_ONE - free[i]) / c


@kernel(inner=True)
def _points(cycle: Cycle, level: int) -> Any:
    return cycle.grids[level, 0] * cycle.grids[level, 1]


@kernel(reorder=True, inner=True)
def run_cycle(cycle: Cycle, force: Any, target: Any) -> None:
    """Write M r of a force r that is zero where points are pressed."""
    last, finest = cycle.grids.shape[0] - 1, cycle.grids[0, 0] * cycle.grids[0, 1]
    for level in range(last):
        first, end = cycle.grids[level, 2], cycle.grids[level, 2] + _points(cycle, level)
        r = force if level == 0 else cycle.r[first - finest : end - finest]
        x, B = cycle.x[first:end], cycle.B[first:end]
        for i in range(x.size):
            x[i] = B[i] * r[i]
        _coarsen(cycle, level, r, x, cycle.r[end - finest : end - finest + _points(cycle, level + 1)])
    first, size = cycle.grids[last, 2] - finest, cycle.matrix.shape[0]
    r, x = cycle.r[first : first + size], cycle.result[first : first + size]
    for i in range(size):
        total, line = _NONE, cycle.inverse[i]
        for j in range(size):
            total += line[j] * r[j]
        x[i] = total
    for level in range(last - 1, -1, -1):
        first, end = cycle.grids[level, 2], cycle.grids[level, 2] + _points(cycle, level)
        r = force if level == 0 else cycle.r[first - finest : end - finest]
        result = target if level == 0 else cycle.result[first - finest : end - finest]
        x = cycle.x[first:end]
        _prolong(cycle, level, cycle.result[end - finest : end - finest + _points(cycle, level + 1)], x)
        _smooth(cycle, level, r, x, result)


# Rows are short, and a call for each would cost as much as its points: what acts on a row is inlined.


@kernel(inner=True)
def _beside(cycle: Cycle, level: int, x: Any) -> Any:
    """The two rows before those of a field, which is periodic, and the two after."""
    if level > 0 or cycle.exchange == 0:
        return x[x.shape[0] - 2 :], x[:2]
    execute(cycle.exchange, 0, x, cycle.beside)  # type: ignore[call-arg]
    return cycle.beside[:2], cycle.beside[2:]


@nb.njit(inline="always")
def _residual(
    weights: Any, i: int, r: Any, x: Any, D: Any, ends: Any, row: Any, beside: Any, along: Any
) -> None:
    """Write row i of r - (S + D) x; `beside` and `along` are space for a row and 4 points."""
    rows, columns = x.shape
    here, rs, Ds, (before, after) = x[i], r[i], D[i], ends
    up, top = x[i - 1] if i > 0 else before[1], x[i - 2] if i > 1 else before[i]
    down = x[i + 1] if i + 1 < rows else after[0]
    bottom = x[i + 2] if i + 2 < rows else after[i + 2 - rows]
    w0, w1, w2, w3, w4, w5 = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    for j in range(columns):
        pair = up[j] + down[j]
        row[j] = rs[j] - (w0 + Ds[j]) * here[j] - w3 * pair - w5 * (top[j] + bottom[j])
        beside[j + 2] = w1 * here[j] + w4 * pair
        along[j + 2] = w2 * here[j]
    for k in range(2):
        beside[k], beside[columns + 2 + k] = beside[columns + k], beside[2 + k]
        along[k], along[columns + 2 + k] = along[columns + k], along[2 + k]
    # Arrays that begin where they are read need no checks of indices, and the loop is vectorised.
    left, right, farther = beside[1:], beside[3:], along[4:]
    for j in range(columns):
        row[j] -= left[j] + right[j] + along[j] + farther[j]


@kernel(reorder=True, inner=True)
def _smooth(cycle: Cycle, level: int, force: Any, field: Any, target: Any) -> None:
    """Write x + B (r - (S + D) x)."""
    rows, columns, first = cycle.grids[level, 0], cycle.grids[level, 1], cycle.grids[level, 2]
    end, weights = first + rows * columns, cycle.weights[level]
    r, x = force.reshape(rows, columns), field.reshape(rows, columns)
    D, B = cycle.D[first:end].reshape(rows, columns), cycle.B[first:end].reshape(rows, columns)
    found, row, ends = target.reshape(rows, columns), np.empty(columns, np.float32), _beside(cycle, level, x)
    beside, along = np.empty(columns + 4, np.float32), np.empty(columns + 4, np.float32)
    for i in range(rows):
        _residual(weights, i, r, x, D, ends, row, beside, along)
        xs, Bs, result = x[i], B[i], found[i]
        for j in range(columns):
            result[j] = xs[j] + Bs[j] * row[j]


# Points of a grid lie between two of the next one: linear interpolation down, its transpose up.


@kernel(inner=True)
def _places(fine: int, coarse: int, first: int, number: int) -> tuple[Any, Any]:
    """Point of the coarse axis to the left of each of the fine one, and the part of the way to the next."""
    left, part = np.empty(number, np.int64), np.empty(number, np.float32)
    for i in range(number):
        j = first + i
        left[i] = j * coarse // fine
        part[i] = np.float32((j * coarse - left[i] * fine) / fine)
    return left, part


@kernel(inner=True)
def _shares(fine: int, coarse: int) -> tuple[Any, Any]:
    """The transpose: the first of up to four fine points, counted from the last but one, and their shares."""
    begin, shares = np.empty(coarse, np.int64), np.zeros((4, coarse), np.float32)
    for k in range(coarse):
        start = (k - 1) * fine // coarse + 1
        start = min(start, fine - 2)  # as where both axes have the same points
        begin[k] = start + 2
        for step in range(4):
            away = abs((start + step) * coarse - k * fine)
            shares[step, k] = np.float32(max(fine - away, 0) * coarse / (fine * fine))
    return begin, shares


@kernel(reorder=True, inner=True)
def _coarsen(cycle: Cycle, level: int, force: Any, field: Any, target: Any) -> None:
    """Write the force of the next grid, P^T share (r - (S + D) x)."""
    rows, columns, first = cycle.grids[level, 0], cycle.grids[level, 1], cycle.grids[level, 2]
    end, weights = first + rows * columns, cycle.weights[level]
    r, x = force.reshape(rows, columns), field.reshape(rows, columns)
    D, share = cycle.D[first:end].reshape(rows, columns), cycle.share[first:end].reshape(rows, columns)
    found, left, part, per = _rows_below(cycle, level, target)
    (begin, shares), ends = _shares(columns, cycle.grids[level + 1, 1]), _beside(cycle, level, x)
    row = np.empty(columns, np.float32)
    beside, along = np.empty(columns + 4, np.float32), np.empty(columns + 4, np.float32)
    here, after = np.zeros(columns + 4, np.float32), np.zeros(columns + 4, np.float32)
    found[0] = _NONE
    for i in range(rows):
        _residual(weights, i, r, x, D, ends, row, beside, along)
        factor = share[i]
        for j in range(columns):
            row[j] *= factor[j]
        _add_row(i, left, part, per, row, here, after, begin, shares, found)
    _join(cycle, level, target)


@kernel(reorder=True, inner=True)
def _restrict(cycle: Cycle, level: int, field: Any, target: Any) -> None:
    """Write P^T of a field."""
    rows, columns = cycle.grids[level, 0], cycle.grids[level, 1]
    values, (found, left, part, per) = field.reshape(rows, columns), _rows_below(cycle, level, target)
    begin, shares = _shares(columns, cycle.grids[level + 1, 1])
    here, after = np.zeros(columns + 4, np.float32), np.zeros(columns + 4, np.float32)
    found[0] = _NONE
    for i in range(rows):
        _add_row(i, left, part, per, values[i], here, after, begin, shares, found)
    _join(cycle, level, target)


@kernel(inner=True)
def _rows_below(cycle: Cycle, level: int, target: Any) -> Any:
    """Rows of the next grid that those of this one reach; `_places` of these among them; points per point."""
    rows, below_rows = cycle.grids[level, 4], cycle.grids[level + 1, 0]
    left, part = _places(rows, below_rows, cycle.grids[level, 3], cycle.grids[level, 0])
    per = np.float32(below_rows / rows)
    if level > 0 or cycle.join == 0:
        return target.reshape(below_rows, cycle.grids[level + 1, 1]), left, part, per
    return cycle.reached, left - left[0], part, per


@kernel(inner=True)
def _join(cycle: Cycle, level: int, target: Any) -> None:
    """Bring the rows that all ranks reach together."""
    if level == 0 and cycle.join != 0:
        execute(cycle.join, 0, cycle.reached, target)  # type: ignore[call-arg]


@nb.njit(inline="always")
def _add_row(
    i: int, left: Any, part: Any, per: Any, row: Any, here: Any, after: Any, begin: Any, shares: Any,
    found: Any,
) -> None:  # fmt: skip
    """Add row i to those of the next grid on either side, `here` and `after`; write the first when full.

    Both have two more points on either side. The first row of the next grid is the last to be full.
    """
    columns, (rows, (below_rows, below)) = row.size, (left.size, found.shape)
    here_inner, after_inner, m = here[2:], after[2:], left[i]
    for j in range(columns):
        here_inner[j] += (_ONE - part[i]) * row[j]
    if part[i] != _NONE:
        for j in range(columns):
            after_inner[j] += part[i] * row[j]
    full = i == rows - 1 or left[i + 1] != m
    for _ in range(2 if i == rows - 1 else 1 if full else 0):
        for k in range(2):
            here[k], here[columns + 2 + k] = here[columns + k], here[2 + k]
        whole, begun = found[m], m > 0
        for k in range(below):
            j = begin[k]
            total = shares[0, k] * here[j] + shares[1, k] * here[j + 1]
            total += shares[2, k] * here[j + 2] + shares[3, k] * here[j + 3]
            whole[k] = per * total if begun else whole[k] + per * total
        for j in range(columns + 4):
            here[j], after[j] = after[j], _NONE
        m = (m + 1) % below_rows


@kernel(reorder=True, inner=True)
def _prolong(cycle: Cycle, level: int, coarse: Any, field: Any) -> None:
    """Add share P x of the next grid."""
    rows, columns, first = cycle.grids[level, 0], cycle.grids[level, 1], cycle.grids[level, 2]
    share = cycle.share[first : first + rows * columns].reshape(rows, columns)
    below_rows, below = cycle.grids[level + 1, 0], cycle.grids[level + 1, 1]
    x, values = field.reshape(rows, columns), coarse.reshape(below_rows, below)
    left, part = _places(columns, below, 0, columns)
    up, parts = _places(cycle.grids[level, 4], below_rows, cycle.grids[level, 3], rows)
    line, whole = np.empty(below + 1, np.float32), np.empty(columns, np.float32)
    for i in range(rows):
        here, after, y = values[up[i]], values[(up[i] + 1) % below_rows], parts[i]
        for k in range(below):
            line[k] = here[k] + y * (after[k] - here[k])
        line[below] = line[0]
        for j in range(columns):
            m = left[j]
            whole[j] = line[m] + part[j] * (line[m + 1] - line[m])
        xs, shares = x[i], share[i]
        for j in range(columns):
            xs[j] += shares[j] * whole[j]
