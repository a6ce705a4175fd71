"""Passes over the points of a grid, between the transforms of the iteration.

Each kernel acts on the points ``first`` to ``end``, a whole number of rows, and returns a tuple of sums and a
tuple of maxima over them, which `ParallelPasses` completes. Pressures and gaps are in single or in double
precision, their changes in single. Outside of the set C of points that press or overlap, r = 0.

Sums over a block of points are in the precision of the fields, those over the blocks in double. Largest
values are kept side by side, and written from one array into another: stores under a condition are slow.
Both arrays count at the end, as the last block may be a short one.

`cap` is the largest pressure, the hardness, or None without one: kernels are compiled for either, and those
without a cap have no trace of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from itertools import pairwise
from math import prod
from typing import Any, NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.stencil import apply_to_row
from gfmdlayer.grid.fftw import WORTH_THREADS
from gfmdlayer.grid.grid import Grid
from gfmdlayer.kernels import LANES, filled, kernel, maximum

_GONE = 1e-6  # part of a pressure that is left by rounding in single precision where it was to vanish
_MEMBER = np.float32(1e-37)  # r of a point of C whose gap is exactly right
_NONE, _ONE = np.float32(0.0), np.float32(1.0)


class Move(NamedTuple):
    """A step, and how it is assessed."""

    length: float  # of the step
    scale: float  # of the pressure and its deformation after it
    load_given: bool  # whether the gap is known up to a shift, and that without pressure is not needed
    level: float  # gap in contact after it, which then counts from there, or gap that is aimed at
    per_pressure: float  # inverse scales of the residual
    per_gap: float


@kernel(reorder=True)
def advance(
    first: int, end: int, move: Move, cap: Any, p: Any, gap: Any, gap0: Any, step: Any, change: Any, r: Any
) -> tuple[tuple[float, float, float, float], tuple[float, float]]:
    """Take a step, and write r = level - gap on the new C; with a given load gaps count from the level."""
    # Returns sums of p, of p gap and, unless the load is given, of p gap0, and of p again; largest violation
    # by an open gap or tension, and overlap, both in the residual's scales. With a cap, the sum of p gap and
    # the last sum are over the pressures below it.
    real = p.dtype.type
    length, gone, none = real(move.length), real(_GONE), real(0.0)
    shift, aim = real(move.level if move.load_given else 0.0), real(0.0 if move.load_given else move.level)
    per_pressure, per_r = np.float32(move.per_pressure), np.float32(-move.per_gap)
    most = real(0.0 if cap is None else cap)
    load, weighted, free, inner = 0.0, 0.0, 0.0, 0.0
    opened, below = np.zeros(LANES, np.float32), np.zeros(LANES, np.float32)
    wider, deeper = opened.copy(), below.copy()
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        ps, gaps, rs = p[begin:stop], gap[begin:stop], r[begin:stop]
        steps, changes = step[begin:stop], change[begin:stop]
        for i in range(ps.size):
            now = ps[i] + length * steps[i]
            if cap is not None:
                now = now if most - now > gone * (most - ps[i]) else most
            ps[i] = now if now > gone * ps[i] else none
            gaps[i] += length * changes[i] - shift
        if not move.load_given:
            free += _scale(real(move.scale), ps, gaps, gap0[begin:stop])
        total, product, part = none, none, none
        for i in range(ps.size):
            pull = np.float32(aim - gaps[i])
            inside = pull if pull != _NONE else _MEMBER
            rs[i] = inside if (ps[i] > none) | (pull > _NONE) else _NONE
            total += ps[i]
            if cap is None:
                product += ps[i] * gaps[i]
            else:
                rs[i] = rs[i] if (ps[i] < most) | (pull < _NONE) else _NONE
                between = ps[i] if ps[i] < most else none
                part += between
                product += between * gaps[i]
        load += total
        weighted += product
        inner += part
        for i in range(ps.size):
            press, apart = np.float32(ps[i]) * per_pressure, rs[i] * per_r
            off = press if press < apart else apart
            wider[i] = off if off > opened[i] else opened[i]
            deeper[i] = rs[i] if rs[i] > below[i] else below[i]
        opened, below, wider, deeper = wider, deeper, opened, below
    return (load, weighted, free, load if cap is None else inner), (
        float(max(maximum(opened), maximum(wider))),
        max(maximum(below), maximum(deeper)) * move.per_gap,
    )


@kernel(reorder=True, inner=True)
def _scale(factor: Any, p: Any, gap: Any, gap0: Any) -> Any:
    """Multiply a pressure and its deformation gap - gap0; return the sum of p gap0."""
    free, rest = p.dtype.type(0.0), p.dtype.type(1.0) - factor
    for i in range(p.size):
        gap[i] = factor * gap[i] + rest * gap0[i]
        p[i] *= factor
        free += p[i] * gap0[i]
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
        for k, some in enumerate((count, total, pull, along, across, last, memory, mean)):
            sums[k] += some
    return (sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6], sums[7]), (0.0,)


@kernel(reorder=True)
def direct(
    first: int, end: int, excess: float, memory: float, length: float, shift: float, cap: Any, p: Any, r: Any,
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
            ds[i] = along if rs[i] != _NONE else _NONE
        found = _project(length, shift, cap, p[begin:stop], rs, ds, step[begin:stop])
        total, count, slope, ended = total + found[0], count + found[1], slope + found[2], ended + found[3]
    return (total, count, slope, ended), (0.0,)


@kernel(reorder=True)
def project(
    first: int, end: int, length: float, shift: float, cap: Any, p: Any, r: Any, d: Any, step: Any
) -> tuple[tuple[float, float, float, float], tuple[float]]:
    """Write the step to max(p + length d - shift, 0) on C, and to 0 outside; with a cap, up to the cap."""
    # Returns the sum of the new pressures, the number of those that depend on the shift, the sum of r step,
    # and the number of pressures that it ends at 0 or at the cap.
    total, count, slope, ended = 0.0, 0.0, 0.0, 0.0
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        found = _project(length, shift, cap, p[begin:stop], r[begin:stop], d[begin:stop], step[begin:stop])
        total, count, slope, ended = total + found[0], count + found[1], slope + found[2], ended + found[3]
    return (total, count, slope, ended), (0.0,)


@kernel(reorder=True, inner=True)
def _project(
    length: float, shift: float, cap: Any, p: Any, r: Any, d: Any, step: Any
) -> tuple[Any, Any, Any, Any]:
    real = p.dtype.type
    some, less, none, most = real(length), real(shift), real(0.0), real(0.0 if cap is None else cap)
    total, count, slope, ended = none, _NONE, _NONE, _NONE
    for i in range(p.size):
        now = p[i] + some * d[i] - less
        now = now if (r[i] != _NONE) & (now > none) else none
        if cap is None:
            count += _ONE if now > none else _NONE
        else:
            now = now if now < most else most
            now = most if (r[i] == _NONE) & (p[i] >= most) else now
            count += _ONE if (now > none) & (now < most) else _NONE
            ended += _ONE if (now >= most) & (p[i] < most) else _NONE
        total += now
        ended += _ONE if (now <= none) & (p[i] > none) else _NONE
        step[i] = np.float32(now - p[i])
        slope += r[i] * step[i]
    return total, count, slope, ended


@kernel(reorder=True)
def respond(
    first: int, end: int, cap: Any, p: Any, step: Any, change: Any
) -> tuple[tuple[float, float], tuple[float]]:
    """Return the sums of step A step and p A step; the fastest relative fall of a pressure along the step."""
    # With a cap, a pressure's distance from the cap falls too.
    none, one = p.dtype.type(0.0), p.dtype.type(1.0)
    most = p.dtype.type(0.0 if cap is None else cap)
    curvature, across, falls, faster = 0.0, 0.0, np.zeros(LANES, p.dtype), np.zeros(LANES, p.dtype)
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        ps, steps, changes = p[begin:stop], step[begin:stop], change[begin:stop]
        along, aside = _NONE, none
        for i in range(ps.size):
            along += steps[i] * changes[i]
            aside += ps[i] * changes[i]
            fall = -steps[i] / (ps[i] if ps[i] > none else one)
            if cap is not None:
                rise = steps[i] / (most - ps[i] if ps[i] < most else one)
                fall = fall if fall > rise else rise
            faster[i] = fall if fall > falls[i] else falls[i]
        curvature, across = curvature + float(along), across + float(aside)
        falls, faster = faster, falls
    return (curvature, across), (float(max(maximum(falls), maximum(faster))),)


@kernel(reorder=True)
def extent(
    first: int, end: int, per_point: float, cap: Any, h: Any, p: Any, gap: Any
) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """Write the gap h - u in the place of an unnormalised u, unless ``per_point`` is zero."""
    # Returns the sums of p, of p gap and of u = h - gap; the largest pressure, -u, -gap and gap. With a cap,
    # the first two sums and the largest -gap are over the pressures below it.
    load, weighted, total = 0.0, 0.0, 0.0
    largest, depth, overlap = filled(LANES, 0.0), filled(LANES, -np.inf), filled(LANES, -np.inf)
    larger, deeper, lower = largest.copy(), depth.copy(), overlap.copy()
    widest, wider = overlap.copy(), overlap.copy()
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
            if cap is not None:
                above = above if ps[i] < cap else -np.inf
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


@kernel(reorder=True)
def comply(first: int, end: int, compliance: Any, spectrum: Any) -> tuple[tuple[float], tuple[float]]:
    """Multiply a spectrum by the compliance."""
    factors, modes = compliance[first:end], spectrum[first:end]
    for k in range(modes.size):
        modes[k] *= factors[k]
    return (0.0,), (0.0,)


@kernel(reorder=True)
def displace(
    first: int, end: int, stiffness: FloatArray, intercept: FloatArray, pressure: FloatArray, u: FloatArray
) -> tuple[tuple[float], tuple[float]]:
    """Write u = (b - p)/kappa mode by mode, and 0 where kappa is, in the place of p too."""
    # Spectra are given as real numbers, real and imaginary parts in turn.
    for k in range(first, end):
        per = 1.0 / stiffness[k] if stiffness[k] > 0.0 else 0.0
        for i in range(2 * k, 2 * k + 2):
            u[i] = per * (intercept[i] - pressure[i])
            pressure[i] = u[i]
    return (0.0,), (0.0,)


@kernel(reorder=True)
def settle(
    first: int, end: int, per_pressure: float, per_gap: float, shift: float, cap: Any, h: FloatArray,
    p: FloatArray, gap: FloatArray, u: FloatArray, flow: Any,
) -> tuple[tuple[float, float, float, float], tuple[float, float]]:  # fmt: skip
    """Shift the gap by -``shift``, cut off overlap, and write u = h - gap."""
    # With a cap, overlap at the cap is no error: `flow` gets it, and u has it. Returns number of points in
    # contact, sums of p, gap and u; the residual and the overlap.
    touching, load, gaps, mean = 0.0, 0.0, 0.0, 0.0
    worst, overlap = filled(LANES, 0.0), filled(LANES, 0.0)
    worse, deeper = worst.copy(), overlap.copy()
    for begin in range(first, end, LANES):
        stop = min(begin + LANES, end)
        hs, ps, apart, us = h[begin:stop], p[begin:stop], gap[begin:stop], u[begin:stop]
        for i in range(ps.size):
            opening = apart[i] - shift
            if cap is not None:
                flow[begin + i] = -opening if (ps[i] >= cap) & (opening < 0.0) else 0.0
                opening += flow[begin + i]
            deeper[i] = -opening if -opening > overlap[i] else overlap[i]
            apart[i] = 0.0 if opening < 0.0 else opening  # NaN stays
        for i in range(ps.size):
            us[i] = hs[i] - apart[i]
            if cap is not None:
                us[i] += flow[begin + i]
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
            sums, maxima = (np.array(each) for each in zip(*parts, strict=True))
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
