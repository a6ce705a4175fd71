"""Passes over the points of a grid: what the iteration does to its fields between transforms.

Each kernel acts on the points ``first`` to ``end``, a whole number of rows, and returns a tuple of sums and a
tuple of maxima over them, which `Sweep` completes. Pressures and gaps are in double precision, what is added
to them in single. Outside of the set C of points that press or overlap, r = 0.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
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
    first: int, end: int, move: Move, p: FloatArray, gap: FloatArray, gap0: FloatArray, step: Any,
    change: Any, r: Any,
) -> tuple[tuple[float, float, float], tuple[float, float]]:  # fmt: skip
    """Take a step, and write r = level - gap on the new C.

    Returns
    -------
    Sums of p, of p gap and, unless the load is given, of p gap0; largest violation by an open gap or tension,
    and overlap, both in the residual's scales.
    """
    load, weighted, free = 0.0, 0.0, 0.0
    opened, below = np.zeros(LANES, np.float32), np.zeros(LANES, np.float32)
    length, level, per_pressure, per_gap = move.length, move.level, move.per_pressure, move.per_gap
    none, per_r = np.float32(0.0), np.float32(-per_gap)
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
            rs[i] = inside if ps[i] > 0.0 or pull > 0.0 else none
        for i in range(ps.size):
            load += ps[i]
            weighted += ps[i] * gaps[i]
        for i in range(ps.size):
            press, apart = np.float32(ps[i] * per_pressure), rs[i] * per_r
            off = press if press < apart else apart
            opened[i] = off if off > opened[i] else opened[i]
        for i in range(ps.size):
            below[i] = rs[i] if rs[i] > below[i] else below[i]
    return (load, weighted, free), (float(opened.max()), below.max() * per_gap)


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
            count += 1.0 if rs[j] != 0.0 else 0.0
            total += row[j]
            pull += rs[j]
            along += np.float64(row[j]) * rs[j]
        for j in range(columns):
            across += np.float64(row[j]) * zs[j]
            last += zs[j] if rs[j] != 0.0 else 0.0
        for j in range(columns):
            memory += np.float64(rs[j]) * ds[j]
            mean += ds[j] if rs[j] != 0.0 else 0.0
        for j in range(columns):
            zs[j] = row[j]
    return (count, total, pull, along, across, last, memory, mean), (0.0,)


@kernel(reorder=True)
def direct(
    first: int, end: int, excess: float, memory: float, length: float, shift: float, p: FloatArray, r: Any,
    z: Any, d: Any, step: Any,
) -> tuple[tuple[float, float, float, float], tuple[float]]:  # fmt: skip
    """Write the direction d = z - excess + memory d on C, and do what `project` does."""
    total, count, slope, ended = 0.0, 0.0, 0.0, 0.0
    less, part = np.float32(excess), np.float32(memory)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        rs, zs, ds = r[begin:stop], z[begin:stop], d[begin:stop]
        for i in range(ds.size):
            along = zs[i] - less + part * ds[i]
            ds[i] = along if rs[i] != 0.0 else np.float32(0.0)
        found = _project(length, shift, p[begin:stop], rs, ds, step[begin:stop])
        total, count, slope, ended = total + found[0], count + found[1], slope + found[2], ended + found[3]
    return (total, count, slope, ended), (0.0,)


@kernel(reorder=True)
def project(
    first: int, end: int, length: float, shift: float, p: FloatArray, r: Any, d: Any, step: Any
) -> tuple[tuple[float, float, float, float], tuple[float]]:
    """Write the step to max(p + length d - shift, 0) on C, and to 0 outside.

    Returns
    -------
    Sum and number of the pressures that it leads to, sum of r step, and number of the pressures that it ends;
    no maximum.
    """
    total, count, slope, ended = 0.0, 0.0, 0.0, 0.0
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        found = _project(length, shift, p[begin:stop], r[begin:stop], d[begin:stop], step[begin:stop])
        total, count, slope, ended = total + found[0], count + found[1], slope + found[2], ended + found[3]
    return (total, count, slope, ended), (0.0,)


@kernel(reorder=True, inner=True)
def _project(
    length: float, shift: float, p: FloatArray, r: Any, d: Any, step: Any
) -> tuple[float, float, float, float]:
    total, count, slope, ended = 0.0, 0.0, 0.0, 0.0
    for i in range(p.size):
        now = p[i] + length * d[i] - shift
        now = now if r[i] != 0.0 else 0.0
        now = now if now > 0.0 else 0.0
        total += now
        count += 1.0 if now > 0.0 else 0.0
        ended += 1.0 if now <= 0.0 and p[i] > 0.0 else 0.0
        step[i] = np.float32(now - p[i])
    for i in range(p.size):
        slope += np.float64(r[i]) * step[i]
    return total, count, slope, ended


@kernel(reorder=True)
def fastest(first: int, end: int, p: FloatArray, step: Any) -> tuple[tuple[float], tuple[float]]:
    """Return no sum; the fastest relative fall of a pressure along the step."""
    fall = np.zeros(LANES)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        ps, steps = p[begin:stop], step[begin:stop]
        for i in range(ps.size):
            falls = -steps[i] / (ps[i] if ps[i] > 0.0 else 1.0)
            fall[i] = falls if falls > fall[i] else fall[i]
    return (0.0,), (fall.max(),)


@kernel(reorder=True)
def respond(
    first: int, end: int, p: FloatArray, step: Any, change: Any
) -> tuple[tuple[float, float], tuple[float]]:
    """Return the sums of step A step and p A step; no maximum."""
    ps, steps, changes = p[first:end], step[first:end], change[first:end]
    curvature, across = 0.0, 0.0
    for i in range(ps.size):
        curvature += np.float64(steps[i]) * changes[i]
        across += ps[i] * changes[i]
    return (curvature, across), (0.0,)


@kernel(reorder=True)
def release(
    first: int, end: int, length: float, p: FloatArray, r: Any, d: Any
) -> tuple[tuple[float], tuple[float]]:
    """Drop from C the points whose pressure a step would end and whose gap is open."""
    ps, rs, ds = p[first:end], r[first:end], d[first:end]
    for i in range(ps.size):
        rs[i] = np.float32(0.0) if ps[i] + length * ds[i] <= 0.0 and rs[i] < 0.0 else rs[i]
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
        for i in range(hs.size):
            largest[i] = ps[i] if ps[i] > largest[i] else largest[i]
        for i in range(hs.size):
            overlap[i] = -apart[i] if -apart[i] > overlap[i] else overlap[i]
    return (load, weighted, total), (largest.max(), depth.max(), overlap.max())


@kernel(reorder=True)
def press(
    first: int, end: int, level: float, stiffness: float, gap0: FloatArray, p: FloatArray
) -> tuple[tuple[float], tuple[float]]:
    """Write a first guess of the pressure: where the punch overlaps, lowered by a level."""
    total, ps, gaps = 0.0, p[first:end], gap0[first:end]
    for i in range(ps.size):
        pull = level - gaps[i]
        ps[i] = stiffness * pull if pull > 0.0 else 0.0
        total += ps[i]
    return (total,), (0.0,)


@kernel(reorder=True)
def times(first: int, end: int, factor: float, field: FloatArray) -> tuple[tuple[float], tuple[float]]:
    """Multiply a field."""
    part = field[first:end]
    for i in range(part.size):
        part[i] *= factor
    return (0.0,), (0.0,)


@kernel(reorder=True)
def open_gap(
    first: int, end: int, per_point: float, h: FloatArray, gap: FloatArray
) -> tuple[tuple[float], tuple[float]]:
    """Write the gap h - u in the place of an unnormalised u."""
    hs, gaps = h[first:end], gap[first:end]
    for i in range(hs.size):
        gaps[i] = hs[i] - per_point * gaps[i]
    return (0.0,), (0.0,)


@kernel(reorder=True)
def add_response(
    first: int, end: int, gap0: FloatArray, change: Any, gap: FloatArray
) -> tuple[tuple[float], tuple[float]]:
    """Write the gap gap0 + A p."""
    free, changes, gaps = gap0[first:end], change[first:end], gap[first:end]
    for i in range(gaps.size):
        gaps[i] = free[i] + changes[i]
    return (0.0,), (0.0,)


@kernel(reorder=True)
def comply(compliance: Any, spectrum: Any) -> None:
    """Multiply a spectrum by the compliance."""
    for k in range(spectrum.size):
        spectrum[k] *= compliance[k]


@kernel(reorder=True)
def displace(stiffness: FloatArray, intercept: FloatArray, pressure: FloatArray, u: FloatArray) -> None:
    """Write u = (b - p)/kappa mode by mode, and 0 where kappa is, in the place of p too.

    Spectra are given as real numbers, real and imaginary parts in turn.
    """
    for k in range(stiffness.size):
        per = 1.0 / stiffness[k] if stiffness[k] > 0.0 else 0.0
        pressure[2 * k] = per * (intercept[2 * k] - pressure[2 * k])
        pressure[2 * k + 1] = per * (intercept[2 * k + 1] - pressure[2 * k + 1])
    for k in range(u.size):
        u[k] = pressure[k]


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
        for i in range(ps.size):
            opening = apart[i] - shift
            apart[i] = 0.0 if opening < 0.0 else opening  # NaN stays
            gaps += apart[i]
        for i in range(ps.size):
            us[i] = hs[i] - apart[i]
            mean += us[i]
        for i in range(ps.size):
            press, opening = ps[i] * per_pressure, apart[i] * per_gap
            off = press if press < opening else opening
            worst[i] = off if off > worst[i] else worst[i]
        for i in range(ps.size):
            touching += 1.0 if ps[i] * per_pressure > apart[i] * per_gap else 0.0
            load += ps[i]
    return (touching, load, gaps, mean), (worst.max(), overlap.max())
