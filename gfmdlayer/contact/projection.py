"""Projection onto the constraints: no overlap, u <= h, and a mean displacement of zero."""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.kernels import kernel

_ROUNDING = 2.3e-16


def project(u: FloatArray, h: FloatArray, mean_is_fixed: bool, ranks: Ranks = ALONE) -> None:
    """Project u in place onto u <= h and, where the mean is fixed, onto mean(u) = 0 as well.

    Parameters
    ----------
    u, h : ndarray, one value a point
        Displacement and surface of the punch.
    mean_is_fixed : bool
        Whether the mean of u is zero.
    ranks : Ranks
        The processes that hold the points.

    Raises
    ------
    ValueError
        If both cannot hold: the punch displaces more than the cell holds, mean(h) < 0.
    """
    np.minimum(u, h, out=u)
    if mean_is_fixed and not _zero_mean(u, h, ranks):
        raise ValueError(
            "the punch displaces more than the cell holds: its surface lies below zero in the mean"
        )


def _zero_mean(u: FloatArray, h: FloatArray, ranks: Ranks) -> bool:
    """Shift the points below h by the one distance m that gives min(u + m, h) a mean of zero.

    Points at h stay there, so that a solver that tells contact by u = h does not lose it over a rounding
    error of the mean; where every point is at h they all move. The sum of min(u + m, h) is concave and
    piecewise linear in m and lies below the sum of u + m, so Newton's iteration started from the latter's
    root comes from the left and ends after finitely many rounds. Each round moves u itself, so that its
    rounding is seen by the next.

    Returns
    -------
    bool
        False if there is no such m.
    """
    begun = False
    while True:
        *sums, largest = _excess(u, h)
        total, free, size = ranks.total(np.array([*sums, u.size])).tolist()
        all_move, begun = free == 0 and not begun, True
        if abs(total) <= _ROUNDING * ranks.maximum(float(largest)) * size:
            return True
        if (free == 0 and not all_move) or not np.isfinite(total):
            return False
        _shift(u, h, -total / (size if all_move else free), all_move)


@kernel
def _excess(u: FloatArray, h: FloatArray) -> tuple[float, float, float]:
    """Sum of u, number of points below h, and largest magnitude of u."""
    total, carry, free, largest = 0.0, 0.0, 0.0, 0.0
    for i in range(u.size):
        value = u[i]
        free += 1.0 if value < h[i] else 0.0
        largest = max(largest, abs(value))
        summed = total + value
        carry += (total - summed) + value if abs(total) >= abs(value) else (value - summed) + total
        total = summed
    return total + carry, free, largest


@kernel
def _shift(u: FloatArray, h: FloatArray, shift: float, all_move: bool) -> None:
    for i in range(u.size):
        if u[i] < h[i] or all_move:
            u[i] = min(u[i] + shift, h[i])
