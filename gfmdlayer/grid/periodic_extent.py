"""Where on a periodic surface the pressure is: the shortest intervals of its axes that hold all of it."""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.kernels import kernel

Stretch = tuple[int, int]  # first point, which may be late on the periodic axis, and number of points

NOWHERE: tuple[Stretch, Stretch] = ((0, 0), (0, 0))


@kernel
def periodic_extent(pressure: FloatArray, shape: tuple[int, int]) -> tuple[Stretch, Stretch]:
    """Shortest periodic intervals of the two axes that hold all points with pressure.

    Parameters
    ----------
    pressure : ndarray, shape (rows * columns,)
        Pressure; what is not positive, or NaN, counts as none.
    shape : tuple of int
        Rows and columns of the surface; a line has one row.

    Returns
    -------
    tuple of two (int, int)
        First row and number of rows, first column and number of columns; `NOWHERE` without pressure.
    """
    rows, columns = shape
    in_row, in_column = np.zeros(rows), np.zeros(columns)
    for row in range(rows):
        in_row[row] = _count(pressure[row * columns : (row + 1) * columns], in_column)
    return _shortest_interval(in_row), _shortest_interval(in_column)


@kernel(reorder=True, inner=True)
def _count(pressure: FloatArray, occupied: FloatArray) -> float:
    """Count the points with pressure in a row, and add them to those of the columns."""
    total = 0.0
    for i in range(pressure.size):
        pressed = 1.0 if pressure[i] > 0.0 else 0.0
        total += pressed
        occupied[i] += pressed
    return total


@kernel(inner=True)
def _shortest_interval(occupied: FloatArray) -> Stretch:
    first, last, longest, after = -1, -1, 0, 0
    for i in range(occupied.size):
        if occupied[i] > 0.0:
            if first < 0:
                first = i
            elif i - last > longest:
                longest, after = i - last, i
            last = i
    if first < 0:
        return 0, 0
    if first + occupied.size - last >= longest:
        longest, after = first + occupied.size - last, first
    return after, occupied.size - longest + 1
