"""What the active-set solver works on: the contact set, work arrays, and scalars that kernels share."""

from __future__ import annotations

from math import prod
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.kernels import kernel

_LINES = 2  # on either side that are close to a contact on a surface
_REACH = 16  # points at least on either side of the contact where the gap is kept up to date
_BLOCK = 256  # points that are passed over at once where nothing is in contact


class ContactSet(NamedTuple):
    """The points in contact, as stretches of contiguous memory.

    On a surface in two directions stretches lie along the last axis.
    """

    member: FloatArray  # 1 in the contact set C, 0 elsewhere
    runs: IntArray  # first point of each stretch, and the point after its last; shape (stretches, 2)
    near: IntArray  # likewise for the points in C or close to it
    counts: npt.NDArray[Any]  # one record: runs, near, points
    reach: tuple[int, int]  # points on either side that are close; points of a line
    close: FloatArray  # work array; empty on a line


class Work(NamedTuple):
    """Work arrays, and the scalars of the present state."""

    z: FloatArray
    spectrum: ComplexArray
    direction: FloatArray  # of conjugate gradients; 0 outside C
    change: FloatArray  # A direction
    pressure: FloatArray  # with which the present contact set was begun, in C
    pressure_change: FloatArray  # A pressure, near C
    now: npt.NDArray[Any]  # one record of `SCALARS`


COUNTS = np.dtype([("runs", np.int64), ("near", np.int64), ("points", np.int64)])
SCALARS = np.dtype(
    [
        ("exact", np.bool_),  # whether the gap is known at every point, or near the contact only
        ("pressure_scale", np.float64),  # of the residual
        ("depth_scale", np.float64),
        ("mean", np.float64),  # mean of u
        ("free_mean", np.float64),  # mean of u without pressure
        ("rigid_shift", np.float64),  # of the punch under load control: gap = gap0 + A p - rigid_shift
        ("energy", np.float64),  # p A p of `Work.pressure`; 0 where directions are not conjugate to it
    ]
)


def make_contact(shape: tuple[int, ...]) -> ContactSet:
    """An empty contact set on a surface of a shape."""
    size, line = prod(shape), shape[-1]
    return ContactSet(
        member=np.zeros(size),
        runs=np.zeros((size // 2 + 1, 2), dtype=np.int64),
        near=np.zeros((size // 2 + 1, 2), dtype=np.int64),
        counts=np.zeros(1, dtype=COUNTS),
        reach=(max(_REACH, line // 64), line),
        close=np.empty(0 if line == size else size),
    )


def make_work(transforms: Transforms) -> Work:
    """Work arrays for the shape of some transforms."""
    z, direction, change, pressure, pressure_change = (transforms.empty_field() for _ in range(5))
    now = np.zeros(1, dtype=SCALARS)
    return Work(z, transforms.empty_spectrum(), direction, change, pressure, pressure_change, now)


@kernel(inner=True)
def list_runs(contact: ContactSet) -> None:
    """Write down the stretches of the contact set."""
    counts = contact.counts[0]
    counts.runs, counts.points = _stretches(contact.member, contact.runs)


@kernel(inner=True)
def list_near(contact: ContactSet) -> None:
    """Write down the stretches close to the contact set; the gap must be known at all of them."""
    runs, near, close, size = contact.runs, contact.near, contact.close, contact.member.size
    counts, count, (reach, row) = contact.counts[0], 0, contact.reach
    if row < size:
        # On a surface the contact also spreads to the next lines.
        close[:] = 0.0
        for k in range(counts.runs):
            for line in range(-_LINES, _LINES + 1):
                first, end = runs[k, 0] - reach + line * row, runs[k, 1] + reach + line * row
                for i in range(max(first, 0), min(end, size)):
                    close[i] = 1.0
                for i in range(max(first + size, 0) if first < 0 else size, min(end + size, size)):
                    close[i] = 1.0
                for i in range(min(end - size, size)):
                    close[i] = 1.0
        counts.near, _ = _stretches(close, near)
        return
    for k in range(counts.runs):
        first, end = max(runs[k, 0] - reach, 0), min(runs[k, 1] + reach, size)
        if count > 0 and first <= near[count - 1, 1]:
            near[count - 1, 1] = end
        else:
            near[count, 0], near[count, 1] = first, end
            count += 1
    counts.near = count


@kernel(inner=True)
def _stretches(member: FloatArray, runs: IntArray) -> tuple[int, int]:
    """Write down the stretches of ones; return their number, and that of their points."""
    count, points, inside = 0, 0, False
    for first in range(0, member.size, _BLOCK):
        block = member[first : first + _BLOCK]
        total = block.sum()
        points += int(total)
        if total == (block.size if inside else 0.0):
            continue
        for i in range(block.size):
            if (block[i] > 0.0) != inside:
                if inside:
                    runs[count, 1] = first + i
                    count += 1
                else:
                    runs[count, 0] = first + i
                inside = not inside
    if inside:
        runs[count, 1] = member.size
        count += 1
    return count, points


@kernel(reorder=True, inner=True)
def dot(contact: ContactSet, x: FloatArray, y: FloatArray) -> float:
    """Sum of x y over the contact."""
    total = 0.0
    for k in range(contact.counts[0].runs):
        xs = x[contact.runs[k, 0] : contact.runs[k, 1]]
        ys = y[contact.runs[k, 0] : contact.runs[k, 1]]
        for i in range(xs.size):
            total += xs[i] * ys[i]
    return total


@kernel(reorder=True, inner=True)
def mean(contact: ContactSet, x: FloatArray) -> float:
    """Mean of x over the contact."""
    total = 0.0
    for k in range(contact.counts[0].runs):
        xs = x[contact.runs[k, 0] : contact.runs[k, 1]]
        for i in range(xs.size):
            total += xs[i]
    return float(total / contact.counts[0].points)


@kernel(reorder=True, inner=True)
def add(runs: IntArray, count: int, factor: float, x: FloatArray, y: FloatArray) -> None:
    """Add a multiple of x to y, over the contact or near it."""
    for k in range(count):
        xs, ys = x[runs[k, 0] : runs[k, 1]], y[runs[k, 0] : runs[k, 1]]
        for i in range(xs.size):
            ys[i] += factor * xs[i]
