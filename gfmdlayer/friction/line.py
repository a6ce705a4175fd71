"""The linear system of a Newton step on a line, compiled: see `newton`, whose equations these are."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.friction.response import LineWindow, respond_on_line
from gfmdlayer.kernels import kernel


class LineIntervals(NamedTuple):
    """Intervals of points, and the inverse of their compliance; none without it."""

    first: IntArray  # where each begins
    length: IntArray
    place: IntArray  # where its inverse begins
    inverses: Any  # without a load, one after the other; in single precision
    shape: FloatArray  # of a load, one value a point
    among: FloatArray  # inverse of the compliance among the loads


class LineSystem(NamedTuple):
    """The free unknowns are the pressures of all points, then the shear of those that stick."""

    stick: IntArray  # places of points among those in contact
    slip: IntArray
    follows: Any  # shear that follows the pressure where they slip
    share: Any  # weights of pressure and shear in the preconditioner
    unit: float
    damping: float
    load_given: bool
    force_given: bool
    C: LineWindow
    K: LineWindow
    touching: LineIntervals
    sticking: LineIntervals
    ones: Any  # answers of the preconditioner to ones, a row for each multiplier
    multipliers: FloatArray  # of the sums that are lacking


@kernel(reorder=True)
def invert(intervals: LineIntervals, v: Any, tractions: Any) -> None:
    """Write the tractions that give displacements."""
    count, shape = intervals.first.size, intervals.shape
    loads = np.zeros(count)
    for j in range(count):
        first, length = intervals.first[j], intervals.length[j]
        some, weights, load = v[first : first + length], shape[first : first + length], 0.0
        for k in range(length):
            load += weights[k] * some[k]
        loads[j] = load
        for i in range(length):
            row = intervals.inverses[intervals.place[j] + i * length :][:length]
            total: Any = np.float32(0.0)
            for k in range(length):
                total += row[k] * some[k]
            tractions[first + i] = total
    for j in range(count):
        load = 0.0
        for k in range(count):
            load += intervals.among[j, k] * loads[k]
        for i in range(intervals.first[j], intervals.first[j] + intervals.length[j]):
            tractions[i] = np.float32(tractions[i] + shape[i] * load)


@kernel(reorder=True, inner=True)
def _soften(system: LineSystem, v: Any, fields: Any, z: Any) -> None:
    """Write the preconditioner without multipliers."""
    size, stick, share = fields.shape[1], system.stick, system.share
    unit: Any = np.float32(system.unit)
    if system.touching.first.size > 0:
        invert(system.touching, v[:size], z[:size])
        invert(system.sticking, v[size:], z[size:])
        for i in range(z.size):
            z[i] *= unit
        return
    for i in range(size):
        fields[0, i], fields[1, i] = share[0, i] * v[i], np.float32(0.0)
    for j in range(stick.size):
        fields[1, stick[j]] = share[1, stick[j]] * v[size + j]
    respond_on_line(system.K, fields)
    for i in range(size):
        z[i] = unit * share[0, i] * fields[0, i]
    for j in range(stick.size):
        z[size + j] = unit * share[1, stick[j]] * fields[1, stick[j]]


@kernel(reorder=True, inner=True)
def _sums(system: LineSystem, size: int, v: Any) -> tuple[float, float]:
    """Sums of pressure and shear of free unknowns."""
    pressure, shear = 0.0, 0.0
    for i in range(size):
        pressure += v[i]
    for j in range(system.stick.size):
        shear += v[size + j]
    for j in range(system.slip.size):
        shear += system.follows[j] * v[system.slip[j]]
    return pressure, shear


@kernel(reorder=True, inner=True)
def _precondition(system: LineSystem, v: Any, fields: Any, z: Any) -> None:
    """Write tractions, and multipliers from the sums of forces, for the right side v."""
    size, ones = fields.shape[1], system.ones
    count, free = ones.shape[0], size + system.stick.size
    _soften(system, v[:free], fields, z[:free])
    pressure, shear = _sums(system, size, z)
    root = math.sqrt(size)
    for i in range(count):
        z[free + i] = np.float32(0.0)
    for i in range(count):
        some = 0.0
        for k in range(count):
            found = pressure if system.load_given and k == 0 else shear
            some += system.multipliers[i, k] * (v[free + k] * root - found)
        part: Any = np.float32(some)
        for k in range(free):
            z[k] += part * ones[i, k]
        z[free + i] = part


@kernel(reorder=True, inner=True)
def _apply(system: LineSystem, z: Any, fields: Any, w: Any) -> None:
    """Write the left side: displacements less the multipliers, and the sums of forces."""
    size, stick, slip = fields.shape[1], system.stick, system.slip
    at = size + stick.size
    none: Any = np.float32(0.0)
    for i in range(size):
        fields[0, i], fields[1, i] = z[i], none
    for j in range(stick.size):
        fields[1, stick[j]] = z[size + j]
    for j in range(slip.size):
        fields[1, slip[j]] = system.follows[j] * z[slip[j]]
    respond_on_line(system.C, fields)
    per_unit: Any = np.float32(1.0 / system.unit)
    damping: Any = np.float32(system.damping)
    pressure, shear = _sums(system, size, z)
    of_load, of_force, root = none, none, 1.0 / math.sqrt(size)
    if system.load_given:
        of_load, w[at] = z[at], np.float32(pressure * root)
        at += 1
    if system.force_given:
        of_force, w[at] = z[at], np.float32(shear * root)
    for i in range(size):
        w[i] = fields[0, i] * per_unit + damping * z[i] - of_load
    for j in range(stick.size):
        w[size + j] = fields[1, stick[j]] * per_unit + damping * z[size + j] - of_force


@kernel(reorder=True, inner=True)
def _dot(a: Any, b: Any) -> Any:
    total: Any = np.float32(0.0)
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@kernel(reorder=True, inner=True)
def _orthogonalise(V: Any, count: int, w: Any, column: FloatArray) -> float:
    """Take the parts along some vectors from w, and write them; return its length, NaN if not finite."""
    parts, largest = np.zeros(count), 0.0
    column[:] = 0.0
    for _ in range(2 if count > 1 else 1):  # twice is enough for orthogonality to rounding
        for j in range(count):
            parts[j] = _dot(V[j], w)
        for j in range(count):
            column[j] += parts[j]
            part: Any = np.float32(parts[j])
            row = V[j]
            for i in range(w.size):
                w[i] -= part * row[i]
    for j in range(count):
        largest = max(largest, abs(column[j]))
    length = math.sqrt(_dot(w, w))
    return length if largest + length < np.inf else np.nan


@kernel(inner=True)
def _rotate(R: FloatArray, rotations: FloatArray, left: FloatArray, k: int, below: float) -> float:
    """Rotate column k of the Hessenberg matrix, and `below` it, into that of R; return what is left."""
    column = R[k]
    for j in range(k):
        cosine, sine, above = rotations[j, 0], rotations[j, 1], column[j]
        column[j], column[j + 1] = (
            cosine * above + sine * column[j + 1],
            cosine * column[j + 1] - sine * above,
        )
    length = math.sqrt(column[k] * column[k] + below * below)
    if length > 0.0:
        rotations[k, 0], rotations[k, 1] = column[k] / length, below / length
        left[k + 1], left[k] = -rotations[k, 1] * left[k], rotations[k, 0] * left[k]
        column[k] = length
    return float(abs(left[k + 1]))


@kernel(inner=True)
def _combine(R: FloatArray, left: FloatArray, Z: Any, size: float, solution: FloatArray) -> None:
    """Write the solution, from R by its columns."""
    count = Z.shape[0]
    parts = np.zeros(count)
    for k in range(count - 1, -1, -1):
        some = left[k]
        for j in range(k + 1, count):
            some -= R[j, k] * parts[j]
        parts[k] = some / R[k, k]
    for k in range(count):
        for i in range(solution.size):
            solution[i] += size * parts[k] * Z[k, i]


@kernel(reorder=True)
def solve_on_line(system: LineSystem, b: FloatArray, inexact: float, most: int, solution: FloatArray) -> int:
    """Solve by flexible, right-preconditioned GMRES in single precision; return the iterations."""
    n, square = b.size, 0.0
    for i in range(n):
        square += b[i] * b[i]
    size = math.sqrt(square)
    solution[:] = 0.0
    if not (size > 0.0 and size < np.inf):
        return 0
    V, Z = np.empty((most + 1, n), np.float32), np.empty((most, n), np.float32)
    w, fields = np.empty(n, np.float32), np.empty((2, system.share.shape[1]), np.float32)
    # Rotations make the Hessenberg matrix triangular: R, whose rows here are its columns.
    R, rotations, left = np.zeros((most, most + 1)), np.zeros((most, 2)), np.zeros(most + 1)
    for i in range(n):
        V[0, i] = b[i] / size
    left[0], count = 1.0, 0
    for k in range(most):
        _precondition(system, V[k], fields, Z[k])
        _apply(system, Z[k], fields, w)
        length = _orthogonalise(V, k + 1, w, R[k])
        if np.isnan(length):
            solution[:] = np.nan
            return k + 1
        largest = 0.0
        for j in range(k + 1):
            largest = max(largest, abs(R[k, j]))
        rest = _rotate(R, rotations, left, k, length)
        count = k + 1 if R[k, k] != 0.0 else k
        if rest <= inexact or not length > 1e-6 * largest:
            break
        per: Any = np.float32(length)
        for i in range(n):
            V[k + 1, i] = w[i] / per
    _combine(R, left, Z[:count], size, solution)
    return k + 1
