"""Passes over the points of a grid: what the iteration does to its fields between transforms.

Each kernel acts on the points ``first`` to ``end``, a whole number of rows, and returns a tuple of sums and a
tuple of maxima over them, which `Sweep` completes. Pressures and gaps are in double precision, what is added
to them in single. Outside of the set C of points that press or overlap, r = 0.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.nested.stencil import apply_to_row
from gfmdlayer.kernels import LANES, kernel

_GONE = 1e-6  # part of a pressure that is left by rounding in single precision where it was to vanish
_MEMBER = np.float32(1e-37)  # r of a point of C whose gap is exactly right


class Move(NamedTuple):
    """A step, and how it is assessed."""

    length: float  # of the step
    scale: float  # of the pressure and its deformation after it
    load_given: bool  # whether the gap without pressure is not needed
    level: float  # gap that is aimed at in contact
    per_pressure: float  # inverse scales of the residual
    per_gap: float


@kernel(reorder=True)
def advance(
    first: int, end: int, move: Move, p: FloatArray, gap: FloatArray, gap0: FloatArray, step: Any, change:
    Any, r: Any,
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:  # fmt: skip
    """Take a step, and write r = level - gap on the new C.

    Returns
    -------
    Sums of p, of p gap and, unless the load is given, of p gap0; largest violation by an open gap or tension,
    overlap (both in the residual's scales), and largest pressure.
    """
    load, weighted, free = 0.0, 0.0, 0.0
    opened, below, largest = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    length, level = move.length, move.level
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        ps, gaps, rs = p[begin:stop], gap[begin:stop], r[begin:stop]
        steps, changes = step[begin:stop], change[begin:stop]
        if length != 0.0:
            for i in range(ps.size):
                now = ps[i] + length * steps[i]
                ps[i] = now if now > _GONE * ps[i] else 0.0
            for i in range(ps.size):
                gaps[i] += length * changes[i]
        if not move.load_given:
            free += _scale(move.scale, ps, gaps, gap0[begin:stop])
        for i in range(ps.size):
            pull = level - gaps[i]
            inside = np.float32(pull) if pull != 0.0 else _MEMBER
            rs[i] = inside if ps[i] > 0.0 or pull > 0.0 else np.float32(0.0)
        for i in range(ps.size):
            load += ps[i]
            weighted += ps[i] * gaps[i]
        for i in range(ps.size):
            press, apart = ps[i] * move.per_pressure, (gaps[i] - level) * move.per_gap
            off = press if press < apart else apart
            opened[i] = off if off > opened[i] else opened[i]
            below[i] = -off if -off > below[i] else below[i]
            largest[i] = ps[i] if ps[i] > largest[i] else largest[i]
    return (load, weighted, free), (opened.max(), below.max(), largest.max())


@kernel(reorder=True, inner=True)
def _scale(factor: float, p: FloatArray, gap: FloatArray, gap0: FloatArray) -> float:
    """Multiply a pressure and its deformation gap - gap0; return the sum of p gap0."""
    free = 0.0
    if factor != 1.0:
        for i in range(p.size):
            gap[i] = gap0[i] + factor * (gap[i] - gap0[i])
            p[i] *= factor
    for i in range(p.size):
        free += p[i] * gap0[i]
    return free


@kernel(reorder=True)
def precondition(
    first: int, end: int, weights: Any, r: Any, before: Any, after: Any, z: Any, d: Any
) -> tuple[tuple[float, ...], tuple[float]]:
    """Apply the stencil M to r, and write z = M r on C in the place of the last r.

    Parameters
    ----------
    weights, r, before, after
        As in `apply_to_row`; r of shape (rows, columns).
    z : ndarray, one value a point
        The r of the last iteration.
    d : ndarray, one value a point
        The last direction.

    Returns
    -------
    Over C, sums of 1, z, r, z r, z r_last, r_last, r d and d; no maximum.
    """
    columns = r.shape[1]
    row = np.empty(columns, np.float32)
    count, total, pull, along, across, last, memory, mean = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(first // columns, end // columns):
        apply_to_row(weights, i, r, before, after, row)
        rs, zs, ds = r[i], z[i * columns : (i + 1) * columns], d[i * columns : (i + 1) * columns]
        for j in range(columns):
            row[j] = row[j] if rs[j] != 0.0 else np.float32(0.0)
        for j in range(columns):
            inside = 1.0 if rs[j] != 0.0 else 0.0
            count += inside
            total += row[j]
            pull += rs[j]
            along += np.float64(row[j]) * rs[j]
            across += np.float64(row[j]) * zs[j]
            last += inside * zs[j]
            memory += np.float64(rs[j]) * ds[j]
            mean += inside * ds[j]
        for j in range(columns):
            zs[j] = row[j]
    return (count, total, pull, along, across, last, memory, mean), (0.0,)


@kernel(reorder=True)
def direct(
    first: int, end: int, excess: float, memory: float, length: float, shift: float, p: FloatArray, r: Any,
    z: Any, d: Any,
) -> tuple[tuple[float, float], tuple[float]]:  # fmt: skip
    """Write the direction d = z - excess + memory d on C.

    Returns
    -------
    Sum and number of the positive p + length d - shift; no maximum.
    """
    total, count = 0.0, 0.0
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        ps, rs, zs, ds = p[begin:stop], r[begin:stop], z[begin:stop], d[begin:stop]
        for i in range(ps.size):
            along = zs[i] - excess + memory * ds[i]
            ds[i] = np.float32(along) if rs[i] != 0.0 else np.float32(0.0)
        for i in range(ps.size):
            now = ps[i] + length * ds[i] - shift
            inside = 1.0 if now > 0.0 and rs[i] != 0.0 else 0.0
            count += inside
            total += inside * now
    return (total, count), (0.0,)


@kernel(reorder=True)
def project(
    first: int, end: int, length: float, shift: float, p: FloatArray, r: Any, d: Any, step: Any
) -> tuple[tuple[float, float, float, float], tuple[float]]:
    """Write the step to max(p + length d - shift, 0) on C, and to 0 outside.

    Returns
    -------
    Sum and number of the positive pressures that it leads to, sum of r step, number of the pressures that it
    ends; the fastest relative fall of a pressure.
    """
    total, count, slope, ended, fall = 0.0, 0.0, 0.0, 0.0, np.zeros(LANES)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        ps, rs, ds, steps = p[begin:stop], r[begin:stop], d[begin:stop], step[begin:stop]
        for i in range(ps.size):
            now = ps[i] + length * ds[i] - shift
            inside = 1.0 if now > 0.0 and rs[i] != 0.0 else 0.0
            count += inside
            total += inside * now
            ended += 1.0 if ps[i] > 0.0 and inside == 0.0 else 0.0
            steps[i] = np.float32(inside * now - ps[i])
        for i in range(ps.size):
            slope += np.float64(rs[i]) * steps[i]
            falls = -steps[i] / ps[i] if ps[i] > 0.0 else 0.0
            fall[i] = falls if falls > fall[i] else fall[i]
    return (total, count, slope, ended), (fall.max(),)


@kernel(reorder=True)
def respond(
    first: int, end: int, p: FloatArray, step: Any, change: Any
) -> tuple[tuple[float, float], tuple[float]]:
    """Return the sums of step A step and p A step; no maximum."""
    curvature, across = 0.0, 0.0
    for i in range(first, end):
        curvature += np.float64(step[i]) * change[i]
        across += p[i] * change[i]
    return (curvature, across), (0.0,)


@kernel(reorder=True)
def release(
    first: int, end: int, length: float, p: FloatArray, r: Any, d: Any
) -> tuple[tuple[float], tuple[float]]:
    """Drop from C the points whose pressure a step would end and whose gap is open."""
    for i in range(first, end):
        if p[i] + length * d[i] <= 0.0 and r[i] < 0.0:
            r[i] = 0.0
    return (0.0,), (0.0,)


@kernel(reorder=True)
def extent(
    first: int, end: int, h: FloatArray, p: FloatArray, gap: FloatArray
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return the sums of p, of p gap and of u = h - gap; the largest pressure, -u and -gap."""
    load, weighted, total = 0.0, 0.0, 0.0
    largest, depth, overlap = np.zeros(LANES), np.full(LANES, -np.inf), np.full(LANES, -np.inf)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        hs, ps, apart = h[begin:stop], p[begin:stop], gap[begin:stop]
        for i in range(hs.size):
            load += ps[i]
            weighted += ps[i] * apart[i]
            total += hs[i] - apart[i]
        for i in range(hs.size):
            below = apart[i] - hs[i]
            depth[i] = below if below > depth[i] else depth[i]
            largest[i] = ps[i] if ps[i] > largest[i] else largest[i]
            overlap[i] = -apart[i] if -apart[i] > overlap[i] else overlap[i]
    return (load, weighted, total), (largest.max(), depth.max(), overlap.max())


@kernel(reorder=True)
def press(
    first: int, end: int, level: float, stiffness: float, gap0: FloatArray, p: FloatArray
) -> tuple[tuple[float], tuple[float]]:
    """Write a first guess of the pressure: where the punch overlaps, lowered by a level."""
    total = 0.0
    for i in range(first, end):
        pull = level - gap0[i]
        p[i] = stiffness * pull if pull > 0.0 else 0.0
        total += p[i]
    return (total,), (0.0,)


@kernel(reorder=True)
def times(first: int, end: int, factor: float, field: FloatArray) -> tuple[tuple[float], tuple[float]]:
    """Multiply a field."""
    for i in range(first, end):
        field[i] *= factor
    return (0.0,), (0.0,)


@kernel(reorder=True)
def open_gap(
    first: int, end: int, per_point: float, h: FloatArray, gap: FloatArray
) -> tuple[tuple[float], tuple[float]]:
    """Write the gap h - u in the place of an unnormalised u."""
    for i in range(first, end):
        gap[i] = h[i] - per_point * gap[i]
    return (0.0,), (0.0,)


@kernel(reorder=True)
def add_response(
    first: int, end: int, gap0: FloatArray, change: Any, gap: FloatArray
) -> tuple[tuple[float], tuple[float]]:
    """Write the gap gap0 + A p."""
    for i in range(first, end):
        gap[i] = gap0[i] + change[i]
    return (0.0,), (0.0,)


@kernel(reorder=True)
def comply(compliance: Any, spectrum: Any) -> None:
    """Multiply a spectrum by the compliance."""
    for k in range(spectrum.size):
        spectrum[k] *= compliance[k]


@kernel(reorder=True)
def displace(stiffness: FloatArray, intercept: ComplexArray, pressure: ComplexArray, u: ComplexArray) -> None:
    """Write u = (b - p)/kappa mode by mode, and 0 where kappa is, in the place of p too."""
    for k in range(u.size):
        kappa = stiffness[k]
        found = (intercept[k] - pressure[k]) / kappa if kappa > 0.0 else 0.0j
        u[k] = found
        pressure[k] = found


@kernel(reorder=True)
def settle(
    first: int, end: int, per_pressure: float, per_gap: float, shift: float, h: FloatArray, p: FloatArray,
    gap: FloatArray, u: FloatArray,
) -> tuple[tuple[float, float, float, float], tuple[float, float]]:  # fmt: skip
    """Shift the gap by -``shift``, cut off overlap, and write u = h - gap.

    Returns
    -------
    Number of points in contact, sums of p, gap and u; the residual and the overlap.
    """
    touching, load, gaps, mean, worst, overlap = 0.0, 0.0, 0.0, 0.0, np.zeros(LANES), np.zeros(LANES)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        hs, ps, apart, us = h[begin:stop], p[begin:stop], gap[begin:stop], u[begin:stop]
        for i in range(ps.size):
            opening = apart[i] - shift
            overlap[i] = -opening if -opening > overlap[i] else overlap[i]
            apart[i] = 0.0 if opening < 0.0 else opening  # NaN stays
        for i in range(ps.size):
            us[i] = hs[i] - apart[i]
        for i in range(ps.size):
            press, opening = ps[i] * per_pressure, apart[i] * per_gap
            off = press if press < opening else opening
            worst[i] = off if off > worst[i] else worst[i]
            touching += 1.0 if press > opening else 0.0
            load += ps[i]
            gaps += apart[i]
            mean += us[i]
    return (touching, load, gaps, mean), (worst.max(), overlap.max())
