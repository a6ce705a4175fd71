"""A stiffness as a stencil of 13 points in real space, which takes no transform: for preconditioners.

The stencil's symbol s(q) = sum_ij w_ij cos(i q_x dx + j q_y dy), i^2 + j^2 <= 4, approximates the stiffness
by least squares of s/max(kappa, `_LEAST` of the largest) - 1 over the modes of the grid.
"""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.grid.grid import Grid
from gfmdlayer.kernels import kernel

REACH = 2  # rows and columns on either side
# Rows and columns of the taps, one of each set that the symmetry of kappa in q_x and q_y makes equal.
_TAPS = ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (2, 0))
_LEAST = 0.02
_WAVES, _WAVES_OF_LINE = 64, 512  # along each axis, for the fit


def stencil(grid: Grid, stiffness: FloatArray) -> FloatArray:
    """Fit the stencil to a stiffness; return the weights of `_TAPS`, shape (6,)."""
    modes = sample(grid)
    stiffest = grid.ranks.maximum(float(stiffness.max()))
    inverse = 1.0 / np.maximum(stiffness[modes], _LEAST * stiffest)
    used = [k for k, (row, _) in enumerate(_TAPS) if row == 0 or len(grid.points) > 1]
    columns = _symbols(grid, modes)[used] * inverse
    normal = grid.ranks.total(np.hstack((columns @ columns.T, columns.sum(axis=1)[:, np.newaxis])))
    weights = np.zeros(len(_TAPS))
    weights[used] = np.linalg.lstsq(normal[:, :-1], normal[:, -1], rcond=None)[0]
    return weights


def symbol(grid: Grid, weights: FloatArray, modes: IntArray) -> FloatArray:
    """The symbol of a stencil at some modes."""
    return np.asarray(weights @ _symbols(grid, modes))


def sample(grid: Grid) -> IntArray:
    """Modes for the fit that this process holds, spread evenly over all of the grid."""
    number = _WAVES if len(grid.points) > 1 else _WAVES_OF_LINE
    rows = _spread(grid.points[0], number, 0.0) if len(grid.points) > 1 else np.zeros(1, dtype=int)
    # The last axis has the waves from 0 to the largest: each that is taken is in the middle of its part.
    own, columns = grid.waves_y, _spread(grid.points[-1] // 2 + 1, number, 0.5)
    columns = columns[(columns >= own.start) & (columns < own.stop)] - own.start
    return np.asarray((rows[:, np.newaxis] * len(own) + columns).ravel())


def _spread(points: int, number: int, place: float) -> IntArray:
    """Return so many of the points, or all, each at a place in its part of them."""
    number = min(points, number)
    return np.asarray((np.arange(number) + place) * points // number, dtype=np.int64)


def _symbols(grid: Grid, modes: IntArray) -> FloatArray:
    """The sums of the cosines of each tap at +-row and +-column, of shape (taps, modes)."""
    phases = [
        axis.ravel() * (length / points)
        for axis, length, points in zip(grid.wavevectors, grid.period, grid.points, strict=True)
    ]
    across, along = (np.zeros(1), *phases) if len(phases) == 1 else phases
    y, x = np.divmod(modes, along.size)
    cosines = np.cos(across)[y], np.cos(along)[x]
    rows, columns = ([np.ones_like(c), 2.0 * c, 4.0 * c**2 - 2.0] for c in cosines)
    return np.array([rows[row] * columns[column] for row, column in _TAPS])


@nb.njit(inline="always")
def _row(k: int, rows: Any, before: Any, after: Any) -> Any:
    """A row of a field, or one of those beside it."""
    if k < 0:
        return before[k + REACH]
    return rows[k] if k < rows.shape[0] else after[k - rows.shape[0]]


@kernel(reorder=True, inner=True, borrows=True)
def apply_to_row(weights: Any, i: int, field: Any, before: Any, after: Any, result: Any, work: Any) -> None:
    """Write row i of the stencil applied to a periodic field, shape (rows, columns)."""
    # `before` and `after` are the two rows on either side of those of this process (`Grid.halo`); `work` is
    # space for a row.
    here, n = field[i], field.shape[1]
    up, down = _row(i - 1, field, before, after), _row(i + 1, field, before, after)
    top, bottom = _row(i - 2, field, before, after), _row(i + 2, field, before, after)
    w0, w1, w2, w3, w4, w5 = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    for j in range(n):
        beside = up[j] + down[j]
        result[j] = w0 * here[j] + w3 * beside + w5 * (top[j] + bottom[j])
        work[j] = w1 * here[j] + w4 * beside
    # Arrays that begin where they are read need no checks of indices, and the loop is vectorised.
    inner, left, right, last = result[2:], work[1:], work[3:], here[4:]
    for j in range(n - 4):
        inner[j] += left[j] + right[j] + w2 * (here[j] + last[j])
    for k in range(min(n, 4)):
        j = k if k < 2 else n + 1 - k
        result[j] += work[(j - 1) % n] + work[(j + 1) % n] + w2 * (here[(j - 2) % n] + here[(j + 2) % n])
