"""What the active-set solver works on: the contact set, and the directions that it keeps."""

from __future__ import annotations

from math import prod
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.kernels import kernel

_LINES = 2  # on either side that are close to a contact on a surface
_BLOCK = 256  # points that are passed over at once where nothing is in contact


class ContactSet(NamedTuple):
    """The points in contact, as stretches of them: what is done with them is then done to contiguous memory.

    On a surface in two directions stretches lie along the last axis.
    """

    member: FloatArray  # 1 in the contact set C, 0 elsewhere
    runs: IntArray  # first point of each stretch, and the point after its last
    near: IntArray  # likewise for the points in C or close to it
    counts: IntArray  # of runs, near and points in C; and how often the set was listed
    reach: tuple[int, int]  # points on either side that are close; points of a line
    close: FloatArray  # work array; empty on a line


class Bank(NamedTuple):
    """Directions and what they do; the rows but the first are kept from one step to the next.

    Row 0 is the pressure with which the present contact set was begun; of this row only the entries in the
    contact are written, and near it those of what it does. Rows are longer than the fields, so that each
    begins where FFTW wants it.
    """

    direction: FloatArray  # 0 outside C
    change: FloatArray  # A direction
    age: IntArray  # order in which they came, 0 for none
    deflating: npt.NDArray[np.bool_]  # whether the solve is kept conjugate to it
    gram: FloatArray  # direction_i A direction_j, factored


class Past(NamedTuple):
    """The state one step earlier, and the contact set that it had."""

    pressure: FloatArray  # in the contact
    change: FloatArray  # A pressure
    mean: FloatArray  # of the pressure, where the load is given; else 1
    listed: IntArray  # how often the set had been listed; one entry


class Work(NamedTuple):
    """Work arrays."""

    z: FloatArray
    spectrum: ComplexArray
    coefficients: FloatArray
    scales: FloatArray  # of pressure and gap in the residual
    exact: npt.NDArray[np.bool_]  # whether the gap is known at every point, or near the contact; one entry
    level: FloatArray  # mean of -u; mean of u without pressure; depth given way to: gap = gap0 + A p - depth


_KEPT = 8  # directions kept from one step to the next, where memory allows
_REACH = 16  # points at least on either side of the contact where the gap is kept up to date
_MEMORY = 1 << 26  # numbers in all directions and what they do


def make_contact(shape: tuple[int, ...]) -> ContactSet:
    """No contact on a surface of a shape."""
    size, line = prod(shape), shape[-1]
    return ContactSet(
        member=np.zeros(size),
        runs=np.zeros((size // 2 + 1, 2), dtype=np.int64),
        near=np.zeros((size // 2 + 1, 2), dtype=np.int64),
        counts=np.zeros(4, dtype=np.int64),
        reach=(max(_REACH, line // 64), line),
        close=np.empty(0 if line == size else size),
    )


def make_work(bank: Bank, z: FloatArray, spectrum: ComplexArray) -> Work:
    """Work arrays, of which two are given."""
    return Work(z, spectrum, np.zeros(bank.age.size), np.zeros(2), np.zeros(1, dtype=np.bool_), np.zeros(3))


def make_bank(size: int) -> Bank:
    """An empty bank for a number of points."""
    rows = 2 + 2 * min(_KEPT, _MEMORY // (4 * size))
    return Bank(
        direction=_rows(rows, size),
        change=_rows(rows, size),
        age=np.zeros(rows, dtype=np.int64),
        deflating=np.zeros(rows, dtype=np.bool_),
        gram=np.zeros((rows, rows)),
    )


def _rows(count: int, length: int) -> FloatArray:
    # Not filled: a row is cleared before its first use, and most are never used.
    line, padded = 8, -(-length // 8) * 8
    block = np.empty(count * padded + line)
    first = -(block.ctypes.data // block.itemsize) % line
    return block[first : first + count * padded].reshape(count, padded)


@kernel
def list_runs(contact: ContactSet) -> None:
    """Write down the stretches of the contact set."""
    contact.counts[0], contact.counts[2] = _stretches(contact.member, contact.runs)
    contact.counts[3] += 1


@kernel
def list_near(contact: ContactSet) -> None:
    """Write down the stretches close to the contact set; the gap must be known at all of them."""
    runs, near, close, size = contact.runs, contact.near, contact.close, contact.member.size
    count, (reach, row) = 0, contact.reach
    if row < size:
        # On a surface the contact also spreads to the next lines.
        close[:] = 0.0
        for k in range(contact.counts[0]):
            for line in range(-_LINES, _LINES + 1):
                first, end = runs[k, 0] - reach + line * row, runs[k, 1] + reach + line * row
                for i in range(max(first, 0), min(end, size)):
                    close[i] = 1.0
                for i in range(max(first + size, 0) if first < 0 else size, min(end + size, size)):
                    close[i] = 1.0
                for i in range(min(end - size, size)):
                    close[i] = 1.0
        contact.counts[1], _ = _stretches(close, near)
        return
    for k in range(contact.counts[0]):
        first, end = max(runs[k, 0] - reach, 0), min(runs[k, 1] + reach, size)
        if count > 0 and first <= near[count - 1, 1]:
            near[count - 1, 1] = end
        else:
            near[count, 0], near[count, 1] = first, end
            count += 1
    contact.counts[1] = count


@kernel
def _stretches(member: FloatArray, runs: IntArray) -> tuple[int, int]:
    """Write down the stretches of ones; return how many they are, and their points."""
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


@kernel(reorder=True)
def dot(contact: ContactSet, x: FloatArray, y: FloatArray) -> float:
    """Sum of x y over the contact."""
    total = 0.0
    for k in range(contact.counts[0]):
        xs = x[contact.runs[k, 0] : contact.runs[k, 1]]
        ys = y[contact.runs[k, 0] : contact.runs[k, 1]]
        for i in range(xs.size):
            total += xs[i] * ys[i]
    return total


@kernel(reorder=True)
def mean(contact: ContactSet, x: FloatArray) -> float:
    """Mean of x over the contact."""
    total = 0.0
    for k in range(contact.counts[0]):
        xs = x[contact.runs[k, 0] : contact.runs[k, 1]]
        for i in range(xs.size):
            total += xs[i]
    return float(total / contact.counts[2])


@kernel(reorder=True)
def add(runs: IntArray, count: int, factor: float, x: FloatArray, y: FloatArray) -> None:
    """Add a multiple of x to y, over the contact or near it."""
    for k in range(count):
        xs, ys = x[runs[k, 0] : runs[k, 1]], y[runs[k, 0] : runs[k, 1]]
        for i in range(xs.size):
            ys[i] += factor * xs[i]


@kernel
def let_go(contact: ContactSet, bank: Bank, p: FloatArray, i: int) -> None:
    """Take a point out of the contact, and with it the directions that move it."""
    contact.member[i] = 0.0
    p[i] = 0.0
    for j in range(1, bank.age.size):
        if bank.age[j] > 0 and bank.direction[j, i] != 0.0:
            bank.age[j] = 0
