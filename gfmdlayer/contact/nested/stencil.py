"""The preconditioner: kappa as a stencil of 13 points in real space, which takes no transform.

The stencil's symbol s(q) = sum_ij w_ij cos(i q_x dx + j q_y dy), i^2 + j^2 <= 4, approximates the stiffness
by least squares of s/max(kappa, `_SOFTEST` of the largest) - 1 over the modes of the grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.grid.grid import Grid
from gfmdlayer.kernels import kernel

REACH = 2  # rows and columns on either side
# Rows and columns of the taps, one of each set that the symmetry of kappa in q_x and q_y makes equal.
_TAPS = ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (2, 0))
_SOFTEST = 0.02
_MODES = 1 << 14  # of this many of each process, or some more, the fit is made


def stencil(grid: Grid, stiffness: FloatArray) -> Any:
    """Fit the stencil to a stiffness.

    Parameters
    ----------
    grid : Grid
        A line or a surface.
    stiffness : ndarray, one value a mode
        kappa.

    Returns
    -------
    ndarray of float32, shape (6,)
        Weights of `_TAPS`.
    """
    on_line = len(grid.points) == 1
    symbols = _symbols(grid)
    every = max(1, stiffness.size // _MODES)
    stiffest = grid.sums.maximum(float(stiffness.max()))
    inverse = 1.0 / np.maximum(stiffness[::every], _SOFTEST * stiffest)
    used = [k for k, (row, _) in enumerate(_TAPS) if row == 0 or not on_line]
    columns = np.array([symbols[k][::every] * inverse for k in used])
    normal = grid.sums.total(
        np.concatenate([columns @ columns.T, columns.sum(axis=1)[:, np.newaxis]], axis=1)
    )
    weights = np.zeros(len(_TAPS), dtype=np.float32)
    weights[used] = np.linalg.lstsq(normal[:, :-1], normal[:, -1], rcond=None)[0]
    return weights


def _symbols(grid: Grid) -> Sequence[FloatArray]:
    """Sum of the cosines of each set of taps, one value a mode."""
    phases = [
        axis * (length / points)
        for axis, length, points in zip(grid.wavevectors, grid.period, grid.points, strict=True)
    ]
    across, along = (np.zeros_like(phases[0]), phases[0]) if len(phases) == 1 else phases
    found = []
    for row, column in _TAPS:
        copies = (2 if row else 1) * (2 if column else 1)
        symbol = copies * np.cos(row * across) * np.cos(column * along)
        found.append(np.broadcast_to(symbol, grid.spectral_shape).ravel())
    return found


@kernel(inner=True)
def _row(k: int, rows: Any, before: Any, after: Any) -> Any:
    """A row of a field, or one of those beside it."""
    if k < 0:
        return before[k + REACH]
    return rows[k] if k < rows.shape[0] else after[k - rows.shape[0]]


@kernel(reorder=True, inner=True)
def apply_to_row(weights: Any, i: int, field: Any, before: Any, after: Any, result: Any) -> None:
    """Write one row of the stencil applied to a periodic field.

    Parameters
    ----------
    weights : ndarray
        From `stencil`.
    i : int
        The row.
    field, before, after : ndarray, shapes (rows, columns), (2, columns), (2, columns)
        The rows of this process and those beside them (`Grid.halo`).
    result : ndarray, shape (columns,)
        Where the row is written.
    """
    here, n = field[i], field.shape[1]
    up, down = _row(i - 1, field, before, after), _row(i + 1, field, before, after)
    top, bottom = _row(i - 2, field, before, after), _row(i + 2, field, before, after)
    w = weights
    for j in range(2, n - 2):
        result[j] = (
            w[0] * here[j]
            + w[1] * (here[j - 1] + here[j + 1])
            + w[2] * (here[j - 2] + here[j + 2])
            + w[3] * (up[j] + down[j])
            + w[4] * (up[j - 1] + up[j + 1] + down[j - 1] + down[j + 1])
            + w[5] * (top[j] + bottom[j])
        )
    for k in range(min(n, 4)):
        j = k if k < 2 else n + 1 - k
        before_j, after_j = (j - 1) % n, (j + 1) % n
        result[j] = (
            w[0] * here[j]
            + w[1] * (here[before_j] + here[after_j])
            + w[2] * (here[(j - 2) % n] + here[(j + 2) % n])
            + w[3] * (up[j] + down[j])
            + w[4] * (up[before_j] + up[after_j] + down[before_j] + down[after_j])
            + w[5] * (top[j] + bottom[j])
        )
