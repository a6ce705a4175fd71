"""A V-cycle of stencils: M, close to the inverse of K + D on the free points, without a transform.

D = w'' + damping is a stiffness of each point by itself. Each grid has about half of the points per axis of
the one above it, the 13 taps of kappa truncated to its modes (`stencil`), and its own D. A point of a grid
yields with the compliance c by the modes that the next grid lacks, in series with D:

    share = 1/(1 + c D)                 of a motion of the next grid that the point follows
    D below = mean of D share           by the weights of linear interpolation

so that contact, stiff repulsion and attraction reach all grids by one formula. A pressed point has a D so
large (`PRESSED`) that it does not move. With r the force and B = smoothing/max(s_0 + D, s_0/2), s_0 the tap
in the middle, a cycle is

    x = B r;  x += share P x_below, x_below from P^T share (r - (S + D) x);  x += B (r - (S + D) x).

A grid is read once on the way down and once on the way up: x, B and share live for five rows.

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
from gfmdlayer.grid.fftw import aligned
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.slabs import SlabGrid
from gfmdlayer.grid.transforms import execute, truncated
from gfmdlayer.kernels import kernel

_FEWEST = 4  # points of an axis at least: the last grid has 4 to 7 along each
_SAME = 0.7  # stiffness of the shortest wave along an axis, over the other's, at which both are halved
_SMOOTHING, _POSITIVE = 0.9, 1.7  # B s_0, and bound on B times the largest symbol
_SOFT = -0.5  # c D at least
_LOWEST = 0.25  # eigenvalue of the last grid at least, over kappa_1
RISE, FALL = 10.0, 3.0  # at least, and at most, of a stiffness over a grid that stencils describe
PRESSED = np.float32(1e15)  # D of a pressed point, over the unit
_NONE, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
_ROOM = 16  # numbers before a row in the work space, two of which are its neighbours: loops begin aligned


class Cycle(NamedTuple):
    """All grids in one array each, the finest first; no grid where there is no cycle."""

    grids: IntArray  # rows and columns held, first point, where their places begin, first row, all rows
    unit: float  # of all stiffness here
    weights: Any  # of the stencils
    point: FloatArray  # c of each grid
    smoothing: FloatArray  # B s_0
    lowest: float  # eigenvalue of the last grid, at least
    matrix: FloatArray  # K of the last grid
    inverse: Any  # of K + D there
    D: Any
    r: Any  # forces, of all but the finest
    result: Any  # of all but the finest
    one: Any  # M 1
    place: IntArray  # of rows and columns: the one of the next grid before each, then their number there
    part: Any  # of the way to the next one
    rows: Any  # work space
    beside: Any  # forces of the rows of the finest grid beside those held, (4, columns)
    stiff_beside: Any
    reached: Any  # rows of the next grid that these reach
    exchange: int  # address of the function that writes `beside`; 0 on one process
    join: int  # of the one that brings the rows reached together


@kernel
def unit_of(kappa_1: float) -> float:
    """Return a power of two near kappa_1, to which no digit is lost: the unit of stiffness."""
    return float(2.0 ** np.floor(np.log2(max(kappa_1, 1e-300))))


def rise_and_fall(grid: Grid, stiffness: FloatArray) -> tuple[float, float]:
    """Factors by which a stiffness rises with the wavenumber, along each axis, and falls, along any."""
    rows = _in_two(grid.points)[0]
    modes = grid.every_mode(stiffness).reshape(rows, -1)
    axes = [modes[0, 1:], modes[1 : rows // 2 + 1, 0]][: len(grid.points)]
    rise = min(float((each / np.minimum.accumulate(each)).max()) for each in axes)
    fall = max(float((np.maximum.accumulate(each) / each).max()) for each in axes)
    return rise, fall


def _in_two(points: tuple[int, ...]) -> tuple[int, ...]:
    """Rows and columns; a line is one row."""
    return points if len(points) == 2 else (1, *points)


def is_local(grid: Grid, stiffness: FloatArray) -> bool:
    """Whether a stiffness rises with the wavenumber, so that stencils describe it."""
    rise, fall = rise_and_fall(grid, stiffness)
    return rise >= RISE and fall <= FALL


def no_cycle() -> Cycle:
    """Return a cycle without a grid."""
    return _cycle(Grid((1, 1), (1.0, 1.0)), [], 1.0, [], [], 0.0)


class FittedStencil(NamedTuple):
    """What a stiffness is on a grid of a cycle, in physical units."""

    weights: FloatArray  # of the stencil
    compliance: float  # c, the inverse of a stiffness
    smoothing: float  # B s_0


Fits = dict[tuple[tuple[int, ...], ...], FittedStencil]  # by the points of a grid and of the next one


def cycle_of(
    whole: Grid, stiffness: FloatArray, kappa_1: float, fits: Fits | None = None, mean: float = 0.5
) -> Cycle:
    """Return the cycle on a grid for a stiffness that rises with the wavenumber, one value a mode.

    It has no grid for a few points. `fits` are those found for the stiffness on the grids of other cycles;
    those found here are added. `mean` is the stiffness of the mean over kappa_1, where it has none.
    """
    shape, kappa, unit = _in_two(whole.points), whole.every_mode(stiffness), unit_of(kappa_1)
    shapes, fits = _shapes(shape, kappa), {} if fits is None else fits
    if len(shapes) < 2:
        return no_cycle()
    found = []
    for points, below in pairwise(shapes):
        if (points, below) not in fits:
            fits[points, below] = _fit(points[-len(whole.points) :], below, kappa, kappa_1)
        found.append(fits[points, below])
        kappa = truncated(kappa, points, below)
    weights = [fit.weights / unit for fit in found]
    constants = [(fit.compliance * unit, fit.smoothing) for fit in found]
    cycle = _cycle(whole, shapes, unit, weights, constants, _LOWEST * kappa_1 / unit)
    kappa = kappa / unit
    height, width = shapes[-1]
    kappa = np.where(kappa > 0, kappa, mean * kappa_1 / unit)
    response = np.fft.irfft2(kappa.reshape(height, -1), (height, width))
    i, j = np.divmod(np.arange(height * width), width)
    cycle.matrix[:] = response[(i[:, np.newaxis] - i) % height, (j[:, np.newaxis] - j) % width]
    return cycle


def _fit(points: tuple[int, ...], below: tuple[int, ...], kappa: FloatArray, kappa_1: float) -> FittedStencil:
    """Fit a stiffness on a grid above another one."""
    grid, below = Grid(points, (1.0,) * len(points)), below[-len(points) :]
    modes = sample(grid)
    taps = stencil(grid, kappa)
    *rows, columns = np.unravel_index(modes, grid.spectral_shape)
    lacking = np.zeros(modes.size, dtype=bool)
    for wave, more, fewer in zip((*rows, columns), points, below, strict=True):
        lacking |= (2 * np.minimum(wave, more - wave) >= fewer) & (fewer < more)
    exact, fitted = np.maximum(kappa[modes], kappa_1), symbol(grid, taps, modes)
    return FittedStencil(
        taps, (lacking / exact).mean(), min(_SMOOTHING, _POSITIVE * float(taps[0] / fitted.max()))
    )


def _shapes(shape: tuple[int, ...], stiffness: FloatArray) -> list[tuple[int, ...]]:
    """The grids: the axis along which the shortest wave is stiffest is halved, or both, to the last grid."""
    shapes = [shape]
    if 1 < min(shape) < _FEWEST:
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
    held = [_in_two(whole.shape), *shapes[1:]] if shapes else []
    points = np.array([np.prod(shape) for shape in held], dtype=np.int64)
    size, last, finest, width = (
        (int(points.sum()), int(points[-1]), int(points[0]), shapes[0][1]) if shapes else (0, 0, 0, 0)
    )
    # Rows, then columns, of each grid and of the next one.
    axes = [axis for pair in pairwise(shapes) for axis in zip(*pair, strict=True)]
    begin = np.cumsum([0] + [n + 1 for n, _ in axes])[: len(axes)]
    grids = np.zeros((len(shapes), 7), dtype=np.int64)
    grids[:, :2], grids[:1, 5] = np.array(held).reshape(-1, 2), whole.first_row
    grids[:, 2], grids[:-1, 3:5] = np.cumsum(points) - points, begin.reshape(-1, 2)
    grids[:, 6] = [shape[0] for shape in shapes]
    grids[:-1, 3] += grids[:-1, 5]
    spaced = [np.divmod(np.arange(n + 1) * m, n) for n, m in axes]
    place = np.concatenate([np.zeros(0, np.int64), *(before for before, _ in spaced)])
    part = np.concatenate(
        [np.zeros(0, np.float32), *(after / n for (_, after), (n, _) in zip(spaced, axes, strict=True))]
    ).astype(np.float32)
    beside, stiff_beside, reached = (np.empty((0, 0), np.float32) for _ in range(3))
    exchange, join = 0, 0
    if shapes and isinstance(whole, SlabGrid):
        beside, stiff_beside = (np.empty((2 * REACH, width), np.float32) for _ in range(2))
        first, end = (int(place[row]) for row in (whole.rows.start, whole.rows.stop - 1))
        reached = np.empty((end + 2 - first, shapes[1][1]), np.float32)
        exchange = whole.exchange_of_rows(REACH, np.float32)
        join = whole.sum_of_rows(shapes[1], first, len(reached), np.float32)
    length = -(-(width + 2 * _ROOM) // _ROOM) * _ROOM
    point, smoothing = np.array(constants).reshape(-1, 2).T.copy()
    return Cycle(
        grids, unit, np.array(weights, np.float32).reshape(-1, 6), point, smoothing, lowest,
        np.zeros((last, last)), np.zeros((last, last), np.float32), _space(size), _space(size - finest),
        _space(size - finest), _space(finest), place, part, _space(9 * length).reshape(9, length),
        beside, stiff_beside, reached, exchange, join,
    )  # fmt: skip


def _space(size: int) -> Any:
    space = aligned(size, single=True)
    space[:] = 0.0
    return space


@kernel(reorder=True, inner=True)
def set_cycle(cycle: Cycle) -> None:
    """Take the D of the finest grid, `PRESSED` where points are pressed, to all grids."""
    last = cycle.grids.shape[0] - 1
    if cycle.exchange != 0:
        execute(cycle.exchange, 0, cycle.D, cycle.stiff_beside)
    for level in range(last):
        first = cycle.grids[level, 2]
        fine = _field(cycle, level, cycle.D, first)
        below = _field(cycle, level + 1, cycle.D, first + fine.size)
        if _is_shared(cycle, level):
            _set_below(cycle, level, fine, cycle.reached)
            execute(cycle.join, 0, cycle.reached, below)
        else:
            _set_below(cycle, level, fine, below)
    first, size = cycle.grids[last, 2], cycle.matrix.shape[0]
    whole, least = cycle.matrix.copy(), 0.0
    for i in range(size):
        whole[i, i] += cycle.D[first + i]
        least = min(least, cycle.D[first + i])
    if least == 0.0:  # no eigenvalue is as low
        cycle.inverse[:] = np.linalg.inv(whole).astype(np.float32)
        return
    values, vectors = np.linalg.eigh(whole)
    for k in range(size):
        values[k] = 1.0 / max(abs(values[k]), cycle.lowest)
    cycle.inverse[:] = ((vectors * values) @ vectors.T).astype(np.float32)


@kernel(reorder=True, inner=True)
def set_one(cycle: Cycle, work: Any) -> None:
    """Find M 1."""
    work[:] = _ONE
    run_cycle(cycle, work, cycle.one)


@kernel(reorder=True, inner=True)
def _set_below(cycle: Cycle, level: int, stiffness: Any, below: Any) -> None:
    """Write the D of the next grid."""
    c, row = np.float32(cycle.point[level]), cycle.rows[5]
    lowest = np.float32(_SOFT) / c
    for i in range(stiffness.shape[0]):
        D = stiffness[i]
        for j in range(D.size):
            yields = D[j] if D[j] > lowest else lowest
            row[j] = D[j] / (_ONE + c * yields)
        _add_row(cycle, level, i, row, below)


@kernel(inner=True)
def _is_shared(cycle: Cycle, level: int) -> bool:
    """Whether ranks hold parts of a grid."""
    return level == 0 and cycle.exchange != 0


@kernel(inner=True)
def _field(cycle: Cycle, level: int, values: Any, first: int) -> Any:
    """The rows of a grid whose points begin there in the values of all grids."""
    rows, columns = cycle.grids[level, 0], cycle.grids[level, 1]
    return values[first : first + rows * columns].reshape(rows, columns)


@kernel(reorder=True, inner=True)
def run_cycle(cycle: Cycle, force: Any, target: Any) -> tuple[float, float]:
    """Write M r of a force r, zero where points are pressed; return the sums of M r and r M r."""
    last, finest = cycle.grids.shape[0] - 1, cycle.grids[0, 0] * cycle.grids[0, 1]
    for level in range(last):
        first = cycle.grids[level, 2] - finest
        r = _field(cycle, level, force, 0) if level == 0 else _field(cycle, level, cycle.r, first)
        below = _field(cycle, level + 1, cycle.r, first + r.size)
        if _is_shared(cycle, level):
            execute(cycle.exchange, 0, force, cycle.beside)
            _descend(cycle, level, r, cycle.reached)
            execute(cycle.join, 0, cycle.reached, below)
        else:
            _descend(cycle, level, r, below)
    first, size = cycle.grids[last, 2] - finest, cycle.matrix.shape[0]
    forces, x = cycle.r[first : first + size], cycle.result[first : first + size]
    for i in range(size):
        moved, line = _NONE, cycle.inverse[i]
        for j in range(size):
            moved += line[j] * forces[j]
        x[i] = moved
    total, across = 0.0, 0.0
    for level in range(last - 1, -1, -1):
        first = cycle.grids[level, 2] - finest
        r = _field(cycle, level, force, 0) if level == 0 else _field(cycle, level, cycle.r, first)
        result = _field(cycle, level, target, 0) if level == 0 else _field(cycle, level, cycle.result, first)
        below = _field(cycle, level + 1, cycle.result, first + r.size)
        total, across = _ascend(cycle, level, r, below, result)
    return total, across


# Rows are short, and a call for each would cost as much as its points: what acts on a row is inlined. Arrays
# that begin where they are read need no checks of indices, and the loops are vectorised.


@nb.njit(inline="always")
def _close(row: Any, columns: int) -> None:
    """Write the neighbours of a periodic row beside it."""
    for k in range(2):
        row[_ROOM - 2 + k], row[_ROOM + columns + k] = row[_ROOM + columns - 2 + k], row[_ROOM + k]


@nb.njit(inline="always")
def _beside(cycle: Cycle, level: int) -> tuple[Any, Any]:
    """Forces and D of the rows beside those held; none of a whole grid, which is periodic."""
    number = cycle.beside.shape[0] if level == 0 else 0
    return cycle.beside[:number], cycle.stiff_beside[:number]


@nb.njit(inline="always")
def _reach(cycle: Cycle, level: int) -> int:
    """Rows before and after one that its stencil reaches: none of a line."""
    return 2 if cycle.grids[level, 6] > 1 else 0


@nb.njit(inline="always")
def _row(values: Any, i: int, ends: Any) -> Any:
    """A row, or one of two before or after."""
    rows = values.shape[0]
    if 0 <= i < rows:
        return values[i]
    if ends.shape[0] > 0:
        return ends[i + 2 if i < 0 else 2 + i - rows]
    return values[i + rows if i < 0 else i - rows]


@nb.njit(inline="always")
def _apply_beside(weights: Any, i: int, ring: Any, r: Any, D: Any, row: Any, beside: Any) -> None:
    """Write r - (S + D) x of row i but for the taps to the left and right, and what these act on."""
    w0, w1, w3, w4, w5 = weights[0], weights[1], weights[3], weights[4], weights[5]
    here, up, down = ring[i % 5][_ROOM:], ring[(i + 4) % 5][_ROOM:], ring[(i + 1) % 5][_ROOM:]
    top, bottom, inner = ring[(i + 3) % 5][_ROOM:], ring[(i + 2) % 5][_ROOM:], beside[_ROOM:]
    for j in range(r.size):
        pair = up[j] + down[j]
        row[j] = r[j] - (w0 + D[j]) * here[j] - w3 * pair - w5 * (top[j] + bottom[j])
        inner[j] = w1 * here[j] + w4 * pair
    _close(beside, r.size)


@kernel(reorder=True, inner=True)
def _descend(cycle: Cycle, level: int, force: Any, below: Any) -> None:
    """Write the force of the next grid, P^T share (r - (S + D) x)."""
    rows, columns = force.shape
    weights, c = cycle.weights[level], np.float32(cycle.point[level])
    smoothing = np.float32(cycle.smoothing[level])
    stiffness = _field(cycle, level, cycle.D, cycle.grids[level, 2])
    w0, w2, least, lowest = weights[0], weights[2], _HALF * weights[0], np.float32(_SOFT) / c
    ring, row, beside = cycle.rows, cycle.rows[5], cycle.rows[6]
    left, right = beside[_ROOM - 1 :], beside[_ROOM + 1 :]
    ends, ends_D = _beside(cycle, level)
    reach = _reach(cycle, level)
    for k in range(-reach, rows + reach):
        x, r, D = ring[(k + 5) % 5], _row(force, k, ends), _row(stiffness, k, ends_D)
        inner = x[_ROOM:]
        for j in range(columns):
            stiff = w0 + D[j]
            inner[j] = smoothing * r[j] / (stiff if stiff > least else least)
        _close(x, columns)
        i = k - reach
        if i < 0:
            continue
        r, D = force[i], stiffness[i]
        _apply_beside(weights, i, ring, r, D, row, beside)
        before, after = ring[i % 5][_ROOM - 2 :], ring[i % 5][_ROOM + 2 :]
        for j in range(columns):
            yields = D[j] if D[j] > lowest else lowest
            row[j] = (row[j] - left[j] - right[j] - w2 * (before[j] + after[j])) / (_ONE + c * yields)
        _add_row(cycle, level, i, row, below)


@kernel(reorder=True, inner=True)
def _ascend(cycle: Cycle, level: int, force: Any, below: Any, target: Any) -> tuple[float, float]:
    """Write x + B (r - (S + D) x) for x = B r + share P x of the next grid, and return its sums."""
    total, across = 0.0, 0.0
    (rows, columns), (rows_below, columns_below) = force.shape, below.shape
    weights, c = cycle.weights[level], np.float32(cycle.point[level])
    smoothing = np.float32(cycle.smoothing[level])
    stiffness = _field(cycle, level, cycle.D, cycle.grids[level, 2])
    w0, w2, least, lowest = weights[0], weights[2], _HALF * weights[0], np.float32(_SOFT) / c
    ring, row, beside, line, motion = cycle.rows, cycle.rows[5], cycle.rows[6], cycle.rows[7], cycle.rows[8]
    left, right = beside[_ROOM - 1 :], beside[_ROOM + 1 :]
    ends, ends_D = _beside(cycle, level)
    first, begin, first_row, all_rows = cycle.grids[level, 3:]
    first -= first_row
    reach = _reach(cycle, level)
    for k in range(-reach, rows + reach):
        i = first_row + k
        i = first + (i + all_rows if i < 0 else i - all_rows if i >= all_rows else i)
        m, part = cycle.place[i], cycle.part[i]
        one, other = below[m], below[m + 1 if m + 1 < rows_below else 0]
        for j in range(columns_below):
            line[j] = one[j] + part * (other[j] - one[j])
        line[columns_below] = line[0]
        if columns == 2 * columns_below:
            after = line[1:]
            for j in range(columns_below):
                motion[2 * j], motion[2 * j + 1] = line[j], _HALF * (line[j] + after[j])
        else:
            for j in range(columns):
                m = cycle.place[begin + j]
                motion[j] = line[m] + cycle.part[begin + j] * (line[m + 1] - line[m])
        x, r, D = ring[(k + 5) % 5], _row(force, k, ends), _row(stiffness, k, ends_D)
        inner = x[_ROOM:]
        for j in range(columns):
            stiff, yields = w0 + D[j], D[j] if D[j] > lowest else lowest
            stiff, yields = stiff if stiff > least else least, _ONE + c * yields
            inner[j] = (smoothing * yields * r[j] + stiff * motion[j]) / (stiff * yields)
        _close(x, columns)
        i = k - reach
        if i < 0:
            continue
        r, D, result = force[i], stiffness[i], target[i]
        _apply_beside(weights, i, ring, r, D, row, beside)
        before, here, after = ring[i % 5][_ROOM - 2 :], ring[i % 5][_ROOM:], ring[i % 5][_ROOM + 2 :]
        for j in range(columns):
            stiff = w0 + D[j]
            rest = row[j] - left[j] - right[j] - w2 * (before[j] + after[j])
            value = here[j] + smoothing * rest / (stiff if stiff > least else least)
            result[j] = value if D[j] < PRESSED else _NONE
        moved: Any = _NONE  # in single precision over few points only
        along: Any = _NONE
        for j in range(columns):
            moved += result[j]
            along += r[j] * result[j]
        total += moved
        across += along
    return total, across


# Points of a grid lie between two of the next one: linear interpolation up, its transpose down.


@nb.njit(inline="always")
def _add_row(cycle: Cycle, level: int, i: int, row: Any, below: Any) -> None:
    """Add row i, times P^T, to the next grid.

    Two rows of the work space gather for the two rows of it on either side, and are added when full.
    """
    rows, columns, _, first, begin, _, all_rows = cycle.grids[level]
    columns_below, shared = below.shape[1], level == 0 and cycle.exchange != 0
    rows_below, before = cycle.grids[level + 1, 0], cycle.place[first] if shared else 0
    per = np.float32(rows_below * columns_below / (all_rows * columns))
    m, end, part = cycle.place[first + i], cycle.place[first + i + 1], cycle.part[first + i]
    if i == 0:
        below[:], cycle.rows[7:] = _NONE, _NONE
    here, after = cycle.rows[7 + m % 2][_ROOM:], cycle.rows[8 - m % 2][_ROOM:]
    for j in range(columns):
        here[j] += (_ONE - part) * row[j]
        after[j] += part * row[j]
    for k in range(m, m + 2 if i == rows - 1 else end):
        row_below, full = below[0 if k == rows_below and not shared else k - before], cycle.rows[7 + k % 2]
        if columns == 2 * columns_below:
            full[_ROOM - 1] = full[_ROOM - 1 + columns]
            values = full[_ROOM - 1 :]
            for j in range(columns_below):
                row_below[j] += per * (values[2 * j + 1] + _HALF * (values[2 * j] + values[2 * j + 2]))
        else:
            for j in range(columns):
                left, value = cycle.place[begin + j], per * full[_ROOM + j]
                share = cycle.part[begin + j] * value
                row_below[left] += value - share
                row_below[left + 1 if left + 1 < columns_below else 0] += share
        full[_ROOM : _ROOM + columns] = _NONE
