"""The iteration on one grid: projected conjugate gradients at one pair of transforms an iteration.

The pressure p >= 0 minimises p.A p/2 + gap0.p, whose gradient is the gap, under a given sum or, at a given
depth, under none. C holds the points that press or overlap, and r = level - gap there, the level being the
mean of the gap weighted by the pressure, or the gap that is aimed at. An iteration

    z = M r on C                                  M: a stencil that approximates kappa
    d = z + beta d on C                           beta of Polak and Ribiere, at least 0
    D = Proj(p + alpha d) - p                     Proj: nearest pressure >= 0 on C of the given sum
    p += theta D,  gap += theta A D               theta: lowest energy on the way

needs a transform for A D alone: the projection comes before it, and all pressures between p and p + D are
admissible. alpha is the length that the last step should have had. At a given depth the whole pressure is
scaled too, to the lowest energy, which the stencil, blind to the mean of the pressure, would leave to many
iterations.

A step that ends pressures is taken as a whole if the lowest energy is near its end: else points would
only come close to leaving. A preconditioned step that was clipped need not descend: it is then tried without
the points that it lets go, and at last along r.

With gaps as unknowns pressures may end at a hardness H too: the energy has H max(-gap, 0) beside it, and the
gap is negative where the surfaces yield. C then holds the open points, those that yield and those with a gap
of zero whose pressure is below 0 or above H. r counts from H where a point yields, or is about to. No step
takes a gap beyond zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import prod
from typing import Any, NamedTuple

import numba as nb
import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.cycle import (
    FALL,
    PRESSED,
    RISE,
    Cycle,
    Fits,
    cycle_of,
    rise_and_fall,
    run_cycle,
    set_cycle,
    set_one,
)
from gfmdlayer.contact.problem import Problem
from gfmdlayer.contact.residual import scales, violation
from gfmdlayer.contact.stencil import REACH, apply_to_row, stencil
from gfmdlayer.grid.fftw import WORTH_THREADS
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.kernels import LANES, filled, in_python, kernel, maximum

# Passes over the points of a grid, between the transforms of the iteration.
#
# Each kernel acts on the points `first` to `end`, a whole number of rows, and returns a tuple of sums and a
# tuple of maxima over them, which `ParallelPasses` completes. Pressures and gaps are in single or in double
# precision, their changes in single. Outside of the set C of points that press or overlap, r = 0.
#
# Sums over a block of points are in the precision of the fields, those over the blocks in double. Largest
# values are kept side by side, and written from one array into another: stores under a condition are slow.
# Both arrays count at the end, as the last block may be a short one.
#
# A kernel cuts its stretch out of the arrays: an index that may be negative, as far as the compiler knows,
# counts from the end, which makes a pass of copies 2 to 4 times as long.
#
# `limit` is the largest y, the hardness where gaps are the unknowns, or None: kernels are compiled for
# either, and those without a limit have no trace of it.

_GONE = 1e-6  # part of a pressure that is left by rounding in single precision where it was to vanish
_MEMBER = np.float32(1e-37)  # r of a point of C whose gap is exactly right
_NONE, _ONE = np.float32(0.0), np.float32(1.0)


class Move(NamedTuple):
    """A step, and how it is assessed."""

    length: float  # of the step
    scale: float  # of x, and of y - y0 with it, after the step
    centred: bool  # whether the sum of x is given, and y known up to a shift
    level: float  # of y where x > 0 after it, from which y then counts, or the y that is aimed at
    per_x: float  # inverse scales of the residual
    per_y: float


@kernel(reorder=True, borrows=True)
def advance(
    first: int, end: int, move: Move, limit: Any, x: Any, y: Any, y0: Any, step: Any, change: Any, r: Any
) -> tuple[tuple[float, float, float], tuple[float, float]]:
    """Take a step, and write r = level - y on the new C; under a given sum of x, y counts from the level."""
    # Returns sums of x, of x y and of x y0 or, without a y0, of r; the largest x and y together, and the
    # largest -y, both in the residual's scales. Where x < 0, y counts from the limit, and any difference is
    # an error, as the limit is what the solution has there.
    real = x.dtype.type
    length, gone, none = real(move.length), real(_GONE), real(0.0)
    shift, aim = real(move.level if move.centred else 0.0), real(0.0 if move.centred else move.level)
    per_x, per_r = np.float32(move.per_x), np.float32(-move.per_y)
    most = real(0.0 if limit is None else limit)
    load, weighted, free = 0.0, 0.0, 0.0
    opened, below = filled(LANES, _NONE), filled(LANES, _NONE)
    wider, deeper = filled(LANES, _NONE), filled(LANES, _NONE)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        xs, ys, rs = x[begin:stop], y[begin:stop], r[begin:stop]
        steps, changes = step[begin:stop], change[begin:stop]
        for i in range(xs.size):
            now = xs[i] + length * steps[i]
            if limit is None:
                xs[i] = now if now > gone * xs[i] else none
            else:
                xs[i] = now if abs(now) > gone * abs(xs[i]) else none
            ys[i] += length * changes[i] - shift
        if y0 is not None:
            free += _scale(real(move.scale), xs, ys, y0[begin:stop])
        total, product = none, none
        for i in range(xs.size):
            pull = np.float32(aim - ys[i])
            if limit is not None:
                pull = np.float32(aim + most - ys[i]) if _yields(xs[i], ys[i] - aim, most) else pull
            inside = pull if pull != _NONE else _MEMBER
            total += xs[i]
            if limit is None:
                rs[i] = inside if (xs[i] > none) | (pull > _NONE) else _NONE
                product += xs[i] * ys[i]
            else:
                member = (xs[i] != none) | (pull > _NONE) | (ys[i] - aim > most)
                rs[i] = inside if member else _NONE
                product += xs[i] * (ys[i] - most if xs[i] < none else ys[i])
        load += total
        weighted += product
        if y0 is None:
            pulls = _NONE
            for i in range(rs.size):
                pulls += rs[i]
            free += float(pulls)
        for i in range(xs.size):
            press, apart, under = np.float32(xs[i]) * per_x, rs[i] * per_r, rs[i]
            if limit is not None:
                under = abs(under) if (xs[i] < none) | ((xs[i] == none) & (under < _NONE)) else under
            off = press if press < apart else apart
            wider[i] = off if off > opened[i] else opened[i]
            deeper[i] = under if under > below[i] else below[i]
        opened, below, wider, deeper = wider, deeper, opened, below
    return (load, weighted, free), (
        float(max(maximum(opened), maximum(wider))),
        max(maximum(below), maximum(deeper)) * move.per_y,
    )


@nb.njit(inline="always")
def _yields(x: Any, y: Any, most: Any) -> Any:
    """Whether a point yields, or is about to."""
    return (x < 0) | ((x == 0) & (y > most))


@kernel(reorder=True, inner=True, borrows=True)
def _scale(factor: Any, x: Any, y: Any, y0: Any) -> Any:
    """Multiply x and its effect y - y0; return the sum of x y0."""
    free, rest = x.dtype.type(0.0), x.dtype.type(1.0) - factor
    for i in range(x.size):
        y[i] = factor * y[i] + rest * y0[i]
        x[i] *= factor
        free += x[i] * y0[i]
    return free


@kernel(reorder=True)
def precondition(
    first: int, end: int, weights: Any, r: Any, before: Any, after: Any, z: Any, d: Any
) -> tuple[tuple[float, ...], tuple[float]]:
    """Apply the stencil M to r, shape (rows, columns), and write z = M r on C in the place of the last r."""
    # `d` is the last direction. Returns the sums over C of 1, z, r, z r, z r_last, r_last, r d and d.
    columns = r.shape[1]
    row, work = np.empty(columns, np.float32), np.empty(columns, np.float32)
    sums = np.zeros(8)
    for i in range(first // columns, end // columns):
        of_row = _precondition_row(weights, i, r, before, after, z, d, row, work)
        for k, some in enumerate(of_row):
            sums[k] += some
    return (sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6], sums[7]), (0.0,)


@kernel(reorder=True, inner=True, borrows=True)
def _precondition_row(
    weights: Any, i: int, r: Any, before: Any, after: Any, z: Any, d: Any, row: Any, work: Any
) -> Any:
    """Write z of a row; return its sums."""
    columns = r.shape[1]
    apply_to_row(weights, i, r, before, after, row, work)
    rs, zs, ds = r[i], z[i * columns : (i + 1) * columns], d[i * columns : (i + 1) * columns]
    count, total, pull, along = _NONE, _NONE, _NONE, _NONE
    for j in range(columns):
        inside = _ONE if rs[j] != _NONE else _NONE
        row[j] *= inside
        count += inside
        total += row[j]
        pull += rs[j]
        along += row[j] * rs[j]
    across, last, memory, mean = _NONE, _NONE, _NONE, _NONE
    for j in range(columns):
        across += row[j] * zs[j]
        last += zs[j] if rs[j] != _NONE else _NONE
        memory += rs[j] * ds[j]
        mean += ds[j] if rs[j] != _NONE else _NONE
        zs[j] = row[j]
    return count, total, pull, along, across, last, memory, mean


@kernel(reorder=True, borrows=True)
def hold(first: int, end: int, r: Any, D: Any) -> tuple[tuple[float, float], tuple[float]]:
    """Take the points outside of C out of a cycle; return how many have changed, and how many are outside."""
    changed, outside = 0.0, 0.0
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        rs, Ds, others, out = r[begin:stop], D[begin:stop], _NONE, _NONE
        for i in range(rs.size):
            now = _NONE if rs[i] != _NONE else PRESSED
            others += _ONE if now != Ds[i] else _NONE
            out += _NONE if rs[i] != _NONE else _ONE
            Ds[i] = now
        changed, outside = changed + float(others), outside + float(out)
    return (changed, outside), (0.0,)


@kernel
def set_held(cycle: Cycle, work: Any) -> None:
    """Take C to all grids of a cycle; find M 1, unless the work space is empty."""
    set_cycle(cycle)
    if work.size > 0:
        set_one(cycle, work)


@kernel
def answer(cycle: Cycle, r: Any, z: Any) -> None:
    """Write z = M r by a cycle, in its unit."""
    run_cycle(cycle, r, z)


@kernel(reorder=True)
def correlate(
    first: int, end: int, per_unit: float, one: Any, r: Any, last: Any, z: Any, d: Any
) -> tuple[tuple[float, ...], tuple[float]]:
    """Take an answer z out of its unit; return the sums that `precondition` returns, `last` is the last r."""
    # And with a field `one` those of one r and one r_last.
    sums, per = np.zeros(10), np.float32(per_unit)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        rs, zs, ds, lasts = r[begin:stop], z[begin:stop], d[begin:stop], last[begin:stop]
        count, total, pull, along = _NONE, _NONE, _NONE, _NONE
        across, before, memory, mean = _NONE, _NONE, _NONE, _NONE
        now, then = _NONE, _NONE
        if one is not None:
            ones = one[begin:stop]
            for i in range(rs.size):
                now += ones[i] * rs[i]
                then += ones[i] * lasts[i]
        for i in range(rs.size):
            zs[i] *= per
        for i in range(rs.size):
            inside = _ONE if rs[i] != _NONE else _NONE
            count += inside
            total += zs[i]
            pull += rs[i]
            along += zs[i] * rs[i]
            across += zs[i] * lasts[i]
            before += inside * lasts[i]
            memory += rs[i] * ds[i]
            mean += inside * ds[i]
        for k, some in enumerate((count, total, pull, along, across, before, memory, mean)):
            sums[k] += float(some)
        sums[8], sums[9] = sums[8] + float(now), sums[9] + float(then)
    most = (sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6], sums[7])
    return (*most, sums[8], sums[9]), (0.0,)


@kernel(reorder=True, borrows=True)
def direct(
    first: int, end: int, excess: float, memory: float, length: float, shift: float, limit: Any, x: Any,
    r: Any, z: Any, one: Any, d: Any, step: Any,
) -> tuple[tuple[float, float, float, float], tuple[float]]:  # fmt: skip
    """Write the direction d = z - excess + memory d on C, and do what `project` does."""
    # With a field `one`, so many times of it are in excess.
    total, count, slope, ended = 0.0, 0.0, 0.0, 0.0
    less, part = np.float32(excess), np.float32(memory)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        rs, zs, ds = r[begin:stop], z[begin:stop], d[begin:stop]
        if one is None:
            for i in range(ds.size):
                along = zs[i] - less + part * ds[i]
                ds[i] = along if rs[i] != _NONE else _NONE
        else:
            ones = one[begin:stop]
            for i in range(ds.size):
                along = zs[i] - less * ones[i] + part * ds[i]
                ds[i] = along if rs[i] != _NONE else _NONE
        sums = _project(length, shift, limit, x[begin:stop], rs, ds, step[begin:stop])
        total, count, slope, ended = total + sums[0], count + sums[1], slope + sums[2], ended + sums[3]
    return (total, count, slope, ended), (0.0,)


@kernel(reorder=True, borrows=True)
def project(
    first: int, end: int, length: float, shift: float, limit: Any, x: Any, r: Any, d: Any, step: Any
) -> tuple[tuple[float, float, float, float], tuple[float]]:
    """Write the step to max(x + length d - shift, 0) on C, and to 0 outside; to min where x is below 0."""
    # Returns the sum of the new x, the number of those that depend on the shift, the sum of r step, and the
    # number of x that it ends at 0.
    total, count, slope, ended = 0.0, 0.0, 0.0, 0.0
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        sums = _project(length, shift, limit, x[begin:stop], r[begin:stop], d[begin:stop], step[begin:stop])
        total, count, slope, ended = total + sums[0], count + sums[1], slope + sums[2], ended + sums[3]
    return (total, count, slope, ended), (0.0,)


@kernel(reorder=True, inner=True, borrows=True)
def _project(
    length: float, shift: float, limit: Any, x: Any, r: Any, d: Any, step: Any
) -> tuple[Any, Any, Any, Any]:
    real = x.dtype.type
    some, less, none = real(length), real(shift), real(0.0)
    total, count, slope, ended = none, _NONE, _NONE, _NONE
    for i in range(x.size):
        now = x[i] + some * d[i] - less
        kept = now > none
        if limit is not None:
            kept = now < none if (x[i] < none) | ((x[i] == none) & (r[i] < _NONE)) else kept
        now = now if (r[i] != _NONE) & kept else none
        count += _ONE if now != none else _NONE
        total += now
        ended += _ONE if (now == none) & (x[i] != none) else _NONE
        step[i] = np.float32(now - x[i])
        slope += r[i] * step[i]
    return total, count, slope, ended


@kernel(reorder=True, borrows=True)
def respond(first: int, end: int, x: Any, step: Any, change: Any) -> tuple[tuple[float, float], tuple[float]]:
    """Return the sums of step B step and x B step; the fastest relative fall of an x along the step."""
    none, one = x.dtype.type(0.0), x.dtype.type(1.0)
    curvature, across, falls, faster = 0.0, 0.0, filled(LANES, none), filled(LANES, none)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        xs, steps, changes = x[begin:stop], step[begin:stop], change[begin:stop]
        along, aside = _NONE, none
        for i in range(xs.size):
            along += steps[i] * changes[i]
            aside += xs[i] * changes[i]
            fall = -steps[i] / (xs[i] if xs[i] != none else one)
            fall = fall if xs[i] != none else none
            faster[i] = fall if fall > falls[i] else falls[i]
        curvature, across = curvature + float(along), across + float(aside)
        falls, faster = faster, falls
    return (curvature, across), (float(max(maximum(falls), maximum(faster))),)


@kernel(reorder=True, borrows=True)
def extent(
    first: int, end: int, per_point: float, cap: Any, h: Any, p: Any, gap: Any
) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """Write the gap h - u in the place of an unnormalised u, unless ``per_point`` is zero."""
    # Returns the sums of p, of p gap and of u = h - gap; the largest pressure, -u, -gap and gap. With a cap,
    # the first two sums are over the pressures below it.
    load, weighted, total = 0.0, 0.0, 0.0
    largest, depth, overlap = filled(LANES, 0.0), filled(LANES, -np.inf), filled(LANES, -np.inf)
    larger, deeper, lower = filled(LANES, 0.0), filled(LANES, -np.inf), filled(LANES, -np.inf)
    widest, wider = filled(LANES, -np.inf), filled(LANES, -np.inf)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        hs, ps, gaps = h[begin:stop], p[begin:stop], gap[begin:stop]
        if per_point > 0.0:
            for i in range(hs.size):
                gaps[i] = hs[i] - per_point * gaps[i]
        for i in range(hs.size):
            if cap is None:
                load += ps[i]
                weighted += ps[i] * gaps[i]
            else:
                between = ps[i] if ps[i] < cap else 0.0
                load += between
                weighted += between * gaps[i]
            total += hs[i] - gaps[i]
        for i in range(hs.size):
            press, below, above = ps[i], gaps[i] - hs[i], -gaps[i]
            larger[i] = press if press > largest[i] else largest[i]
            deeper[i] = below if below > depth[i] else depth[i]
            lower[i] = above if above > overlap[i] else overlap[i]
            wider[i] = gaps[i] if gaps[i] > widest[i] else widest[i]
        largest, depth, overlap, larger, deeper, lower = larger, deeper, lower, largest, depth, overlap
        widest, wider = wider, widest
    return (load, weighted, total), (
        max(maximum(largest), maximum(larger)),
        max(maximum(depth), maximum(deeper)),
        max(maximum(overlap), maximum(lower)),
        max(maximum(widest), maximum(wider)),
    )


@kernel(reorder=True, borrows=True)
def displace(
    first: int, end: int, stiffness: FloatArray, intercept: FloatArray, pressure: FloatArray, u: FloatArray
) -> None:
    """Write u = (b - p)/kappa mode by mode, and 0 where kappa is, in the place of p too."""
    # Spectra are given as real numbers, real and imaginary parts in turn.
    numbers = slice(2 * first, 2 * end)
    stiff, b, p, us = stiffness[first:end], intercept[numbers], pressure[numbers], u[numbers]
    for k in range(stiff.size):
        per = 1.0 / stiff[k] if stiff[k] > 0.0 else 0.0
        for i in range(2 * k, 2 * k + 2):
            us[i] = per * (b[i] - p[i])
            p[i] = us[i]


@kernel(reorder=True, borrows=True)
def press(
    first: int, end: int, per_point: float, stiffness: FloatArray, intercept: FloatArray, u: FloatArray,
    stress: FloatArray,
) -> None:  # fmt: skip
    """Write the stress (b - kappa u) per point, mode by mode; spectra as in `displace`."""
    numbers = slice(2 * first, 2 * end)
    stiff, b, us, found = stiffness[first:end], intercept[numbers], u[numbers], stress[numbers]
    for k in range(stiff.size):
        for i in range(2 * k, 2 * k + 2):
            found[i] = per_point * (b[i] - stiff[k] * us[i])


@kernel(reorder=True, borrows=True)
def open_up(
    first: int, end: int, level: float, most: float, least: float, p: FloatArray, gap: FloatArray
) -> tuple[tuple[float, float], tuple[float]]:
    """Return the sums of the gap, and of the part of it that is admissible: see `_admissible`."""
    total, admissible = 0.0, 0.0
    ps, gaps = p[first:end], gap[first:end]
    for i in range(ps.size):
        total += gaps[i]
        admissible += _admissible(ps[i], gaps[i] - level, most, least)
    return (total, admissible), (0.0,)


@nb.njit(inline="always")
def _admissible(p: float, gap: float, most: float, least: float) -> float:
    """The gap where it is open and has no pressure, or below -`least` at the largest pressure."""
    return gap if ((gap > 0.0) & (p <= 0.0)) | ((gap < -least) & (p >= most)) else 0.0


@kernel(reorder=True, borrows=True)
def depart(
    first: int, end: int, level: float, factor: float, most: float, least: float, p: FloatArray,
    gap: FloatArray, step: Any,
) -> None:  # fmt: skip
    """Write the admissible part of the gap, times a factor, and what it adds to the gap."""
    ps, gaps, steps = p[first:end], gap[first:end], step[first:end]
    for i in range(ps.size):
        opening = gaps[i] - level
        now = factor * _admissible(ps[i], opening, most, least)
        steps[i] = np.float32(now - opening)
        gaps[i] = now


@kernel(borrows=True)
def press_closed(first: int, end: int, level: float, most: float, gap: FloatArray, p: FloatArray) -> None:
    """Write an admissible pressure: where the gap is closed, from zero to the largest, where it yields."""
    gaps, ps = gap[first:end], p[first:end]
    for i in range(ps.size):
        pressure = most if gaps[i] < 0.0 else min(ps[i] - level, most)
        ps[i] = pressure if (gaps[i] <= 0.0) & (pressure > 0.0) else 0.0


@kernel(reorder=True, borrows=True)
def settle(
    first: int, end: int, per_pressure: float, per_gap: float, shift: float, h: FloatArray, p: FloatArray,
    gap: FloatArray, u: FloatArray,
) -> tuple[tuple[float, float, float, float], tuple[float, float]]:  # fmt: skip
    """Shift the gap by -``shift``, cut off overlap, and write u = h - gap."""
    # Returns number of points in contact, sums of p, gap and u; the residual and the overlap.
    touching, load, gaps, mean = 0.0, 0.0, 0.0, 0.0
    worst, overlap = filled(LANES, 0.0), filled(LANES, 0.0)
    worse, deeper = filled(LANES, 0.0), filled(LANES, 0.0)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        hs, ps, apart, us = h[begin:stop], p[begin:stop], gap[begin:stop], u[begin:stop]
        for i in range(ps.size):
            opening = apart[i] - shift
            deeper[i] = -opening if -opening > overlap[i] else overlap[i]
            apart[i] = 0.0 if opening < 0.0 else opening  # NaN stays
        for i in range(ps.size):
            us[i] = hs[i] - apart[i]
        for i in range(ps.size):  # see `kernels.FASTMATH`: sums beside what is written may change their bits
            gaps += apart[i]
            mean += us[i]
            load += ps[i]
        for i in range(ps.size):
            press, opening = ps[i] * per_pressure, apart[i] * per_gap
            off = press if press < opening else opening
            worse[i] = off if off > worst[i] else worst[i]
            touching += 1.0 if press > opening else 0.0
        worst, overlap, worse, deeper = worse, deeper, worst, overlap
    return (touching, load, gaps, mean), (
        max(maximum(worst), maximum(worse)),
        max(maximum(overlap), maximum(deeper)),
    )


@kernel(reorder=True, borrows=True)
def settle_gap(
    first: int, end: int, per_pressure: float, per_gap: float, level: float, most: float, h: FloatArray,
    gap: FloatArray, pressure: FloatArray, u: FloatArray, p: FloatArray,
) -> tuple[tuple[float, float, float, float], tuple[float]]:  # fmt: skip
    """Write u = h - gap, and the pressure less the level in contact alone; returns as `settle`."""
    # Where the gap is negative the pressure is the largest.
    touching, load, gaps, mean, worst = 0.0, 0.0, 0.0, 0.0, filled(LANES, 0.0)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        hs, apart, found = h[begin:stop], gap[begin:stop], pressure[begin:stop]
        us, ps = u[begin:stop], p[begin:stop]
        for i in range(ps.size):
            us[i] = hs[i] - apart[i]
            pressing = found[i] - level
            pressing = most if (pressing > most) | (apart[i] < 0.0) else pressing
            ps[i] = 0.0 if pressing * per_pressure <= apart[i] * per_gap else pressing  # NaN stays
        for i in range(ps.size):  # see `kernels.FASTMATH`: sums beside what is written may change their bits
            pressing, over = found[i] - level, (found[i] - level - most) * per_pressure
            off = violation(pressing, apart[i], per_pressure, per_gap)
            off = abs(over) if (over > 0.0) | (apart[i] < 0.0) else off
            worst[i] = off if off > worst[i] else worst[i]
        for i in range(ps.size):
            gaps += apart[i] if apart[i] > 0.0 else 0.0
            mean += us[i]
            load += ps[i]
            touching += 1.0 if ps[i] * per_pressure > apart[i] * per_gap else 0.0
    return (touching, load, gaps, mean), (maximum(worst),)


@kernel(borrows=True)
def narrow(first: int, end: int, less: float, field: FloatArray, narrowed: Any) -> None:
    """Write a field less a number in single precision."""
    wide, single = field[first:end], narrowed[first:end]
    for i in range(wide.size):
        single[i] = np.float32(wide[i] - less)


class ParallelPasses:
    """Calls kernels with stretches of the points, and completes their results over all points."""

    def __init__(self, grid: Grid, threads: int, shape: tuple[int, ...] | None = None) -> None:
        # Kernels release the interpreter's lock, so threads of Python do. Each takes a stretch of whole rows,
        # always the same one: sums have the same bits from run to run. `shape` takes the place of the grid's,
        # as for modes.
        self._sums, self._whole, shape = grid.sums, grid.is_whole, shape or grid.shape
        size, columns = prod(shape), max(shape[-1], 1)
        threads = min(threads, size // columns) if size >= WORTH_THREADS else 1
        rows = np.linspace(0, size // columns, threads + 1).astype(int) * columns
        self._stretches = [*pairwise(rows.tolist())]

    def __call__(
        self, kernel: Callable[..., Any], *arguments: Any
    ) -> tuple[Sequence[float], Sequence[float]]:
        """Return the completed sums and maxima of a kernel over all points."""
        if len(self._stretches) == 1:
            sums, maxima = kernel(*self._stretches[0], *arguments)
            if self._whole:
                return sums, maxima
        else:
            parts = self._all(kernel, arguments)
            sums, maxima = (np.array(values) for values in zip(*parts, strict=True))
            sums, maxima = sums.sum(axis=0), maxima.max(axis=0)
        total, largest = self._sums.total(np.array(sums)), self._sums.maximum(np.array(maxima))
        return total.tolist(), largest.tolist()

    def only(self, kernel: Callable[..., Any], *arguments: Any) -> None:
        """Call a kernel whose results are not needed: nothing is communicated."""
        if len(self._stretches) == 1:
            kernel(*self._stretches[0], *arguments)
        else:
            list(self._all(kernel, arguments))

    def _all(self, kernel: Callable[..., Any], arguments: tuple[Any, ...]) -> Iterable[Any]:
        return self._pool.map(lambda stretch: kernel(*stretch, *arguments), self._stretches)

    @cached_property
    def _pool(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(len(self._stretches))


_STALE = 0.01  # part of C, or of the rest, that may change before coarser grids of a cycle know of it
_SHORTEST = 0.05  # of the lengths that are tried
_LONGEST, _LONGEST_CYCLED = 2.0, 4.0  # likewise, by a stencil and by a cycle
# Beyond this part of a step that ends pressures it is taken as a whole, for thin compressible layers.
_LET_GO = 0.8
_LOAD = 1e-2  # relative error of the load that a projection may leave; the next one corrects it
_PROJECTIONS = 60  # rounds of Newton's method at most
_PATIENCE, _PROGRESS = 40, 0.7  # iterations in which the residual has to fall below this part


class FieldExtent(NamedTuple):
    """How far the fields of a state reach."""

    mean: float  # of u
    pressure: float  # the largest
    depth: float  # the largest -u
    overlap: float  # the largest -gap
    gap: float  # the largest


@dataclass
class NestedFields:
    """A problem and its state, one value a point.

    `gap0` is not needed where the load is given; the gap is then known up to a rigid shift.
    """

    h: FloatArray  # surface of the punch
    gap0: FloatArray  # gap without pressure
    p: FloatArray
    gap: FloatArray
    load: float | None  # sum of the pressure, where it is given
    cap: float | None = None  # largest pressure, where there is one
    aim: float = 0.0  # gap that is aimed at in contact, as part of the scale of depth, where no load is given
    scales: tuple[float, float] = (1.0, 1.0)  # of pressure and depth in the residual
    level: float = 0.0  # gap in contact, weighted by the pressure, or the gap that is aimed at

    def unknowns(self) -> Complements:
        """The pressure as unknown."""
        gap0 = self.gap0 if self.load is None else None
        return Complements(self.p, self.gap, self.load, self.scales, self.level, gap0)


@dataclass
class Complements:
    """What a search changes, x, and y = B x + c; pressure and gap, or gap and pressure."""

    x: Any
    y: Any
    total: float | None  # sum of x, where it is given; y is then known up to a shift
    scales: tuple[float, float]  # of x and y in the residual
    level: float = 0.0  # of y where x > 0, weighted by x, or the y that is aimed at
    y0: Any = None  # y without x, where the whole of x is scaled
    limit: float | None = None  # of y, beyond which x is below zero; without it x is not
    load: float = np.inf  # sum of y where x is zero, beside which that of its errors elsewhere is small


class SearchForm(NamedTuple):
    """The unknowns, and what preconditions them."""

    gaps: bool = False  # else pressures
    cycle: bool = False  # of stencils for the operator; else one stencil for its inverse


# Of kappa over a surface. A cycle costs as much as a pair, and saves iterations where kappa rises nearly as
# fast as the wavenumber, by this part of that, or faster; and that of 1/kappa where kappa falls by so much.
# Along a line it saves many more wherever stencils describe kappa, and that of 1/kappa none.
_RISE, _FALL = 0.5, 100.0


def form_of(grid: Grid, stiffness: FloatArray, *, yields: bool = False) -> SearchForm:
    """Return the form of a search for a stiffness, one value a mode; pressures that end need gaps."""
    rise, fall = rise_and_fall(grid, stiffness)
    line = len(grid.points) == 1
    enough = 0.0 if yields else max(RISE, 0.0 if line else _RISE * min(grid.points) / 2)
    gaps = rise >= enough and fall <= FALL
    return SearchForm(gaps, cycle=gaps or (fall > _FALL and not line))


class GridLevel:
    """Operators and work arrays of one grid; transforms are in single precision."""

    def __init__(
        self,
        grid: Grid,
        transforms: Transforms,
        problem: Problem,
        stiffness: FloatArray,
        form: SearchForm,
        fits: Fits | None = None,
    ) -> None:
        # `fits` are those of a finer grid.
        self.grid, self.transforms = grid, transforms
        self.parallel = ParallelPasses(grid, transforms.threads)
        self._modes = ParallelPasses(grid, transforms.threads, grid.spectral_shape)
        self.r, self.z, self.d, self.step, self.change = (transforms.empty_field() for _ in range(5))
        self.one: Any = None
        self.fits: Fits = {}
        self.set_operator(problem, stiffness, form, fits)
        self.pairs = 0  # spent, in single precision

    def set_operator(
        self, problem: Problem, stiffness: FloatArray, form: SearchForm, fits: Fits | None = None
    ) -> None:
        """Make the operator of the unknowns and its preconditioner from kappa."""
        grid, stiff = self.grid, stiffness > 0
        self.form, self.floor = form, problem.residual_floor
        operator = stiffness.copy()
        if not form.gaps:
            np.divide(1.0, stiffness, out=operator, where=stiff)
        if form.gaps and problem.mean_pressure is not None:  # which knows no mean gap
            grid.ranks.set_mean_wave(operator, 0.0)
        self._filter = self.transforms.filter((operator / grid.size).astype(np.float32))
        self.stiffest = grid.sums.maximum(float(stiffness.max()))
        if not form.cycle:
            self._weights = stencil(grid, stiffness).astype(np.float32)
            return
        least = grid.sums.minimum(float(operator.min(initial=np.inf, where=operator > 0)))
        self.fits = {} if fits is None else fits
        # A single point in contact, of radius dx/2, holds a rigid motion on a halfspace by 0.3/n of kappa_1.
        # Where surfaces yield no point need hold it, but others take the place of those that open.
        mean = 0.5 if problem.hardness < np.inf else 0.3 / max(grid.points)
        self._cycle = cycle_of(grid, operator, least, self.fits, mean)
        self._held, self._answer = self._cycle.D[: self.r.size], self.transforms.empty_field()
        self._held[:] = -1.0  # not known
        self._changed = np.inf  # points of C since the coarser grids of the cycle know it
        centred = problem.mean_is_fixed if form.gaps else problem.mean_pressure is not None
        self.one = self._cycle.one if centred else None

    def respond(self) -> None:
        """Write the change of y under the step, B step: one pair of transforms."""
        self._filter(self.step, self.change)
        self.pairs += 1

    def displace(self, problem: Problem, spectrum: ComplexArray, work: ComplexArray) -> None:
        """Replace the transform of the pressure by the displacement's; write it in `work` too."""
        numbers = (modes.view(np.float64) for modes in (problem.intercept, spectrum, work))
        self._modes.only(displace, problem.stiffness, *numbers)

    def press(self, problem: Problem, spectrum: ComplexArray, stress: ComplexArray) -> None:
        """Write the transform of the stress of a displacement, per point."""
        numbers = (modes.view(np.float64) for modes in (problem.intercept, spectrum, stress))
        self._modes.only(press, 1.0 / self.grid.size, problem.stiffness, *numbers)

    @property
    def shortest(self) -> float:
        """A length along r by which any direction falls."""
        return 0.5 / self.stiffest if self.form.gaps else 0.5 * self.stiffest

    def lifted(self, count: float) -> float:
        """Sum over C of the answer to 1, where it has so many points and the stencil leaves their mean."""
        return count if self.one is None else self._lifted

    def precondition(self) -> Sequence[float]:
        """Write z = M r in the place of the last r; see the kernel of this name for the sums."""
        if self.form.cycle:
            changed, outside = self.parallel(hold, self.r, self._held)[0]
            self._changed += changed
            few = _STALE * min(outside, self.grid.size - outside) if self.one is None else 0.0
            if self._changed > few:
                self._changed = 0.0
                set_held(self._cycle, self.step[: 0 if self.one is None else self.step.size])
                if self.one is not None:
                    self._lifted = self.grid.sums.total(float(self.one.sum()))
            answer(self._cycle, self.r, self._answer)
            self.z, self._answer = self._answer, self.z
            fields = self.one, self.r, self._answer, self.z, self.d
            return self.parallel(correlate, 1.0 / self._cycle.unit, *fields)[0]
        r = self.r.reshape(-1, self.grid.shape[-1])
        beside = self.grid.halo(r, REACH, REACH)
        return self.parallel(precondition, self._weights, r, *beside, self.z, self.d)[0]

    def set_scales(self, at: NestedFields, per_point: float = 0.0) -> FieldExtent:
        """Set the level of a state and the scales of its residual."""
        # Where `per_point` is not zero, u times its inverse stands in the place of the gap.
        arrays = at.h, at.p, at.gap
        (load, weighted, total), extrema = self.parallel(extent, per_point, at.cap, *arrays)
        reached = FieldExtent(total / self.grid.size, *extrema)
        if at.load is not None:
            at.level = weighted / load if load > 0 else 0.0
        at.scales = self.scales(reached, at.level)
        at.level = at.aim * at.scales[1] if at.load is None else at.level
        return reached

    def scales(self, extent: FieldExtent, level: float) -> tuple[float, float]:
        """Scales of pressure and depth, where the gap counts from a level."""
        depth = max(extent.mean + level, 0.0) + extent.depth - level
        return in_python(scales)(extent.pressure, depth, self.floor)

    def set_load(self, at: NestedFields) -> bool:
        """Scale the pressure to the given load, but no further than the cap; return whether there is any."""
        total = self.grid.sums.total(float(at.p.sum()))
        if not 0.0 < total < np.inf:
            return False
        if at.load is not None and total != at.load:
            at.p *= at.load / total
        if at.cap is not None:
            np.minimum(at.p, at.cap, out=at.p)
        return True

    def set_sum(self, at: NestedFields) -> bool:
        """Scale the gap to the sum of a fixed mean displacement; return whether there is any gap."""
        total, punch = self.grid.sums.total(np.array([at.gap.sum(), at.h.sum()])).tolist()
        if not 0.0 < total < np.inf:
            return False
        if self.one is not None and total != punch:
            at.gap *= punch / total
        return True

    def gaps_of(self, at: NestedFields) -> Complements:
        """The gap as unknown, of a state whose pressure belongs to it and may be negative."""
        (_, weighted, total), extrema = self.parallel(extent, 0.0, None, at.h, at.p, at.gap)
        reached = FieldExtent(total / self.grid.size, *extrema)
        opened = None
        at.level = 0.0
        if self.one is not None:
            opened, yields = self.grid.sums.total(np.array([at.gap.sum(), np.minimum(at.gap, 0.0).sum()]))
            at.level = (weighted - (at.cap or 0.0) * yields) / opened
        largest = min(reached.pressure - at.level, np.inf if at.cap is None else at.cap)
        scales = self.scales(reached._replace(pressure=largest), 0.0)
        load = np.inf if at.load is None else at.load
        if at.load is not None and at.cap is not None:  # of which those that yield bear a known part
            borne = at.cap * self.grid.sums.total(int(np.count_nonzero(at.gap < 0.0)))
            load = load - borne if borne < load else load
        return Complements(at.gap, at.p, opened, scales[::-1], at.level, limit=at.cap, load=load)

    def add_response(self, at: NestedFields) -> None:
        """Write the gap of the pressure, from the gap without it, in single precision."""
        np.copyto(self.step, at.p, casting="same_kind")
        self.respond()
        np.add(at.gap0, self.change, out=at.gap)


class Search:
    """Conjugate directions from a state, in single or in double precision, whose y belongs to its x.

    `residual` is the larger of the largest x and y together, and the largest -y; of pressures it is their
    sum, as the gap is shifted until there is no overlap, or twice the larger of them where no load is given.
    """

    def __init__(self, level: GridLevel, at: Complements) -> None:
        self._on, self.at = level, at
        for field in (
            level.d,
            level.step,
            level.change,
        ):  # r is written before it is read, z not used at first
            field.fill(0.0)
        self._alpha, self._shift = 1.0, 0.0
        self._product = 0.0  # z.r of the last iteration; 0 where directions begin anew
        self._move(0.0, 1.0)

    def run(self, tolerance: float, limit: int) -> int:
        """Bring the residual within a tolerance, or to where it falls no more; return the iterations."""
        best, since, iteration = np.inf, 0, 0
        while self.residual > tolerance and iteration < limit and iteration - since <= _PATIENCE:
            if self.residual < _PROGRESS * best:
                best, since = self.residual, iteration
            self._advance()
            iteration += 1
        return iteration

    def _advance(self) -> None:
        """Take one iteration."""
        self._direct()
        self._project()
        if not self._slope > 0:
            on, x = self._on, self.at.x
            ends = x * (x + np.float64(self._alpha) * on.d) <= 0.0
            on.r[ends & (x * on.r < 0.0)] = 0.0  # points whose x it would end and whose y holds them leave
            self._alpha, self._product = min(self._alpha, 1.0), 0.0
            self._direct()
            self._project()
        along_r = not self._slope > 0
        if along_r:
            self._move(0.0, 1.0)
            np.copyto(self._on.d, self._on.r)
            self._alpha, self._shift = self._on.shortest, 0.0
            self._write_step()
            self._project()
        self._on.respond()
        optimum, length, scale = self._lengths()
        self._move(length, scale)
        longest = _LONGEST_CYCLED if self._on.form.cycle else _LONGEST
        self._alpha = _SHORTEST if along_r else min(max(optimum * self._alpha, _SHORTEST), longest)
        self._product = 0.0 if along_r else self._product

    def _direct(self) -> None:
        """Write the next direction."""
        on, at = self._on, self.at
        count, total, pull, along, across, last, memory, mean, *by_one = on.precondition()
        # Under a given sum z has no mean, or no sum by M 1, and r no mean that counts.
        centred = at.total is not None and count
        excess, common = (total / on.lifted(count), pull / count) if centred else (0.0, 0.0)
        now, then = by_one if on.one is not None else (pull, last)
        product, change = along - excess * now, across - excess * then
        beta = max((product - change) / self._product, 0.0) if self._product > 0 else 0.0
        if product + beta * (memory - common * mean) <= 0:
            beta = 0.0
        self._product = product
        self._shift = (self._sum - at.total) / count if at.total is not None and count else 0.0
        step = self._alpha, self._shift
        fields = at.x, on.r, on.z, on.one, on.d, on.step
        self._note(on.parallel(direct, excess, beta, *step, at.limit, *fields)[0])

    def _project(self) -> None:
        """Write the step of the given sum."""
        at, begin, low, high = self.at, self._shift, -np.inf, np.inf
        for _ in range(_PROJECTIONS):
            if at.total is None or abs(self._above) <= _LOAD * at.total:
                break
            if at.limit is None:
                self._shift += self._above / self._count if self._count else min(self._above, 0.0)
            else:  # the sum is no convex function of the shift: between two that enclose it
                low, high = (self._shift, high) if self._above > 0 else (low, self._shift)
                self._shift = self._between(low, high, at.scales[0] + 2.0 * abs(self._shift - begin))
            self._write_step()

    def _between(self, low: float, high: float, reach: float) -> float:
        """Shift for the given sum, by Newton's method within bounds; `reach` away where one is not known."""
        newton = self._shift + self._above / self._count if self._count else np.nan
        if low < newton < high:
            return newton
        if np.isinf(high - low):
            return low + reach if np.isinf(high) else high - reach
        return (low + high) / 2

    def _write_step(self) -> None:
        on, x = self._on, self.at.x
        step = self._alpha, self._shift, self.at.limit
        self._note(on.parallel(project, *step, x, on.r, on.d, on.step)[0])

    def _note(self, sums: Sequence[float]) -> None:
        """Note the sum beyond the given one, the number of x, and how the energy falls."""
        total, self._count, self._slope, self._ended = sums
        self._above = total - (self.at.total or 0.0)

    def _lengths(self) -> tuple[float, float, float]:
        """Return the length of the step of the lowest energy, the one to take, and the scale after it."""
        on, at, slope = self._on, self.at, self._slope
        (curvature, across), (fall,) = on.parallel(respond, at.x, on.step, on.change)
        optimum = slope / curvature if curvature > 0 else 1.0
        # The energy of a p + b D is a parabola of a and b.
        stiff, free, push = self._weighted - self._free, self._free - at.level * self._sum, slope + across
        if at.y0 is not None:
            whole, part = -across * push - curvature * free, across * free + stiff * push
            if stiff * curvature > across**2 and whole > 0:
                optimum = part / whole
        length = optimum
        if optimum > 1.0:
            length = min(optimum, 1.0 / fall) if fall > 0 else optimum
        elif optimum > _LET_GO and self._ended > 0:
            length = 1.0
        if at.total is None and at.y0 is None:
            return optimum, length, 1.0
        if at.total is None:
            energy, push = stiff + length * (2.0 * across + length * curvature), length * push - free
            return optimum, length, push / energy if push > 0 and energy > 0 else 1.0
        # The step sets x.y, and so the level.
        at.level = (self._weighted + length * (across - slope + length * curvature)) / self._sum
        return optimum, length, 1.0

    def _move(self, length: float, scale: float) -> None:
        """Take a step and assess the state."""
        on, at = self._on, self.at
        fields = at.x, at.y, at.y0, on.step, on.change, on.z
        move = Move(length, scale, at.total is not None, at.level, 1.0 / at.scales[0], 1.0 / at.scales[1])
        sums, (most, below) = on.parallel(advance, move, at.limit, *fields)
        self._sum, self._weighted, self._free = sums
        on.r, on.z = on.z, on.r
        at.level = at.level if at.total is None else 0.0
        # A gap may be shifted under a given load; elsewhere the aim is the middle of the allowed range.
        worst = most + below if at.total is not None else 2.0 * max(most, below)
        worst = max(most, below, abs(self._free) / at.load) if on.form.gaps else worst
        self.residual = worst if np.isfinite(self._sum + self._weighted) else np.nan
