"""Where on a periodic surface the pressure is: the shortest intervals of its axes that hold all of it."""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray

Stretch = tuple[int, int]  # first point, which may be late on the periodic axis, and number of points

NOWHERE: tuple[Stretch, Stretch] = ((0, 0), (0, 0))


def periodic_extent(pressure: FloatArray, shape: tuple[int, int]) -> tuple[Stretch, Stretch]:
    """Shortest periodic intervals of the two axes that hold all points with pressure.

    Parameters
    ----------
    pressure : ndarray, shape (rows * columns,)
        Pressure p >= 0.
    shape : tuple of int
        Rows and columns of the surface; a line has one row.

    Returns
    -------
    tuple of two (int, int)
        First row and number of rows, first column and number of columns; `NOWHERE` without pressure.
    """
    pressed = pressure.reshape(shape) > 0.0
    rows, columns = (np.asarray(pressed.any(axis=axis)) for axis in (1, 0))
    return _shortest_interval(rows), _shortest_interval(columns)


def _shortest_interval(occupied: BoolArray) -> Stretch:
    points = np.flatnonzero(occupied)
    if points.size == 0:
        return 0, 0
    steps = np.diff(points, prepend=points[-1] - occupied.size)
    longest = int(np.argmax(steps))  # the interval is the rest of the period
    return int(points[longest]), int(occupied.size - steps[longest] + 1)
