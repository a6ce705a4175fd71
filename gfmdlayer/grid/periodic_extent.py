"""Where on a periodic surface something is: the shortest stretches of its axes that hold all of it."""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.kernels import kernel

Stretch = tuple[int, int]  # first, which may be late on the periodic axis, and number

_BLOCK = 256  # points that are passed over at once

NOWHERE: tuple[Stretch, Stretch] = ((0, 0), (0, 0))


@kernel
def periodic_extent(pressure: FloatArray, shape: tuple[int, int]) -> tuple[Stretch, Stretch]:
    """First and number of the lines where there is pressure, then of the points along them."""
    rows, line = shape
    if rows == 1:
        around = _span(pressure)
        return (0, min(around[1], 1)), around
    in_row, in_line = np.zeros(rows), np.zeros(line)
    for row in range(rows):
        in_row[row] = _mark(pressure[row * line : (row + 1) * line], in_line)
    return _span(in_row), _span(in_line)


@kernel(reorder=True)
def _mark(pressure: FloatArray, occupied: FloatArray) -> float:
    """Count the points with pressure, and mark them."""
    total = 0.0
    for i in range(pressure.size):
        pressed = 1.0 if pressure[i] > 0.0 else 0.0
        total += pressed
        occupied[i] += pressed
    return total


@kernel
def _span(occupied: FloatArray) -> Stretch:
    """The shortest stretch of a periodic line that holds all that is occupied."""
    size, first, last, longest, after = occupied.size, -1, -1, -1, 0
    for start in range(0, size, _BLOCK):
        end = min(start + _BLOCK, size)
        for i in range(start, end if _any(occupied[start:end]) else start):
            if occupied[i] > 0.0:
                if first < 0:
                    first = i
                elif i - last > longest:
                    longest, after = i - last, i
                last = i
    if first < 0:
        return 0, 0
    if first + size - last >= longest:
        longest, after = first + size - last, first
    return after, size - longest + 1


@kernel(reorder=True)
def _any(occupied: FloatArray) -> bool:
    total = 0.0
    for i in range(occupied.size):
        total += 1.0 if occupied[i] > 0.0 else 0.0
    return total > 0.0
