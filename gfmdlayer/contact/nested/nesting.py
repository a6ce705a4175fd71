"""First guess from coarser grids: the problem solved on the coarsest, then on each finer one from there.

Problems come from truncated Fourier series of the gap and of the stiffness, pressures by interpolation. Near
the edge of the contact the pressure falls like xi^(1/2) and the gap opens like xi^(3/2) with the distance xi
(see `prediction`), so s = p^2 inside and s = -mu gap^(2/3) outside is smooth there and interpolated linearly.
Where all points around are in contact, the pressure itself is, by cubic polynomials.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.nested import passes
from gfmdlayer.contact.nested.iteration import Fields, Level, Search
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.kernels import kernel

_BEFORE, _AFTER = 3, 4  # rows of the coarse grid that rows of the fine one may need beside their own


def prolong(coarse: Level, at: Fields, fine: Level, target: FloatArray) -> None:
    """Write the pressure of a finer grid, from the state of the coarse one."""
    shape = (-1, coarse.grid.shape[-1])
    p, gap = at.p.reshape(shape), np.maximum(at.gap - at.level, 0.0).reshape(shape)
    (inside, pressed, outside, apart), _ = coarse.parallel(_at_edges, p, *coarse.grid.halo(p, 1, 1), gap)
    squares, openings = inside / max(pressed, 1.0), apart / max(outside, 1.0)
    mu = squares / openings if openings > 0 else 0.0
    smooth, deep = np.empty_like(p), np.empty_like(p)
    coarse.parallel.only(_smooth, p, *coarse.grid.halo(p, 1, 1), gap, mu, smooth, deep)
    fields = [_extended(coarse.grid, field) for field in (p, smooth, deep)]
    place = fine.grid.first_row, _BEFORE - coarse.grid.first_row
    rows = (1, 1) if len(fine.grid.points) == 1 else (fine.grid.points[0], coarse.grid.points[0])
    fine.parallel.only(_interpolate, fine.grid.shape[-1], place, rows, *fields, target)


def _extended(grid: Grid, field: FloatArray) -> FloatArray:
    """The rows of a field and those beside it."""
    before, after = grid.halo(field, _BEFORE, _AFTER)
    return np.vstack((before, field, after))


@kernel(reorder=True)
def _at_edges(
    first: int, end: int, p: FloatArray, before: FloatArray, after: FloatArray, gap: FloatArray
) -> tuple[tuple[float, float, float, float], tuple[float]]:
    """Return sums over the two sides of the edge: p^2 and points inside, points and gap^(2/3) outside."""
    rows, n = p.shape
    squares, pressed, outside, apart = 0.0, 0.0, 0.0, 0.0
    for i in range(first // n, end // n):
        up = p[i - 1] if i > 0 else before[0]
        down = p[i + 1] if i < rows - 1 else after[0]
        for j in range(n):
            left, right = p[i, j - 1], p[i, j + 1 if j < n - 1 else 0]
            if p[i, j] > 0.0:
                if min(min(up[j], down[j]), min(left, right)) <= 0.0:
                    squares += p[i, j] ** 2
                    pressed += 1.0
            elif max(max(up[j], down[j]), max(left, right)) > 0.0:
                apart += np.cbrt(gap[i, j] ** 2)
                outside += 1.0
    return (squares, pressed, outside, apart), (0.0,)


@kernel
def _smooth(
    first: int, end: int, p: FloatArray, before: FloatArray, after: FloatArray, gap: FloatArray, mu: float,
    smooth: FloatArray, deep: FloatArray,
) -> tuple[tuple[float], tuple[float]]:  # fmt: skip
    """Write the field that is smooth across the edge, and 1 where all neighbours are in contact too.

    Far from the contact any negative value does.
    """
    rows, n = p.shape
    for i in range(first // n, end // n):
        up = p[i - 1] if i > 0 else before[0]
        down = p[i + 1] if i < rows - 1 else after[0]
        here = p[i]
        for j in range(n):
            east = j + 1 if j < n - 1 else 0
            west = j - 1 if j > 0 else n - 1
            deep[i, j] = 0.0
            if here[j] > 0.0:
                smooth[i, j] = here[j] ** 2
                if up[j] > 0.0 and down[j] > 0.0 and here[east] > 0.0 and here[west] > 0.0:
                    deep[i, j] = 1.0
                continue
            around = here[east] + here[west] + up[west] + up[j] + up[east] + down[west] + down[j] + down[east]
            smooth[i, j] = -mu * np.cbrt(gap[i, j] ** 2) if around > 0.0 else -1.0
    return (0.0,), (0.0,)


@kernel(inner=True)
def _weights(part: float) -> Any:
    """Lagrange's weights of the cubic polynomial through -1, 0, 1, 2 at a point between 0 and 1."""
    return (
        -part * (part - 1.0) * (part - 2.0) / 6.0,
        (part + 1.0) * (part - 1.0) * (part - 2.0) / 2.0,
        -(part + 1.0) * part * (part - 2.0) / 2.0,
        (part + 1.0) * part * (part - 1.0) / 6.0,
    )


@kernel(reorder=True)
def _interpolate(
    first: int, end: int, columns: int, place: tuple[int, int], whole: tuple[int, int], p: FloatArray,
    smooth: FloatArray, deep: FloatArray, target: FloatArray,
) -> tuple[tuple[float], tuple[float]]:  # fmt: skip
    """Interpolate rows of the fine grid from coarse fields, with rows beside those of this process.

    `place` is the row of the whole fine grid that is the first here, and the row of the coarse fields that is
    the first of the grid; `whole` the rows of the whole grids, fine and coarse.
    """
    n = p.shape[1]
    for i in range(first // columns, end // columns):
        y = (i + place[0]) * whole[1] / whole[0]
        row = int(y)
        y -= row
        row, wy = row + place[1], _weights(y)
        for j in range(columns):
            x = j * n / columns
            m = int(x)
            x -= m
            right = m + 1 if m + 1 < n else 0
            if max(max(p[row, m], p[row, right]), max(p[row + 1, m], p[row + 1, right])) <= 0.0:
                target[i * columns + j] = 0.0
                continue
            inner = deep[row, m] + deep[row, right] + deep[row + 1, m] + deep[row + 1, right]
            if inner == 4.0:
                wx, found = _weights(x), 0.0
                for a in range(4):
                    line = 0.0
                    for b in range(4):
                        line += wx[b] * p[row + a - 1, (m + b - 1) % n]
                    found += wy[a] * line
                target[i * columns + j] = max(found, 0.0)
            else:
                s = (1.0 - y) * ((1.0 - x) * smooth[row, m] + x * smooth[row, right])
                s += y * ((1.0 - x) * smooth[row + 1, m] + x * smooth[row + 1, right])
                target[i * columns + j] = np.sqrt(s) if s > 0.0 else 0.0
    return (0.0,), (0.0,)


_TOLERANCE = 1e-3
_LIMIT = 60  # iterations on a coarser grid


def nest(fine: Level, transforms: Transforms, problem: Problem, at: Fields) -> float:
    """Write the pressure of a first guess; return the pairs in single precision, as parts of fine ones."""
    surface = transforms.forward(problem.obstacle)
    free = np.zeros_like(surface)
    fine.displace(problem, free, np.empty_like(free))
    last, pairs = None, 0.0
    for grid in reversed(fine.grid.nested[1:]):
        level, state = _coarse(fine, grid, transforms, problem, (surface, free))
        state.load = None if at.load is None else at.load * grid.size / fine.grid.size
        if not _prolonged(last, level, state):
            _press(level, state)
        level.add_response(state)
        level.set_scales(state)
        Search(level, state).run(_TOLERANCE, _LIMIT)
        pairs += (level.pairs + 1) * grid.size / fine.grid.size
        last = level, state
    if not _prolonged(last, fine, at):
        if at.load is not None:  # its place holds the gap of a guess, if anything
            at.gap0[:] = problem.obstacle - transforms.backward(free) / fine.grid.size
        _press(fine, at)
    return pairs


def _coarse(
    fine: Level,
    grid: Grid,
    transforms: Transforms,
    problem: Problem,
    spectra: tuple[ComplexArray, ComplexArray],
) -> tuple[Level, Fields]:
    """The problem on a coarser grid: punch, gap without pressure, and stiffness."""
    coarse = transforms.of_shape(grid.points, single=True)
    level = Level(grid, coarse, transforms.truncated(problem.stiffness, coarse), fine.floor)
    h, free = (
        coarse.backward(transforms.truncated(each, coarse)).astype(np.float64) / fine.grid.size
        for each in spectra
    )
    return level, Fields(h, h - free, np.zeros_like(h), np.zeros_like(h), None)


def _prolonged(last: tuple[Level, Fields] | None, level: Level, at: Fields) -> bool:
    """Write the pressure of a coarser grid, of the given load; return whether there is any."""
    if last is None:
        return False
    prolong(*last, level, at.p)
    return level.set_load(at)


def _press(level: Level, at: Fields) -> None:
    """Write a first pressure where the punch lies lowest, of the given load."""
    sums = level.grid.sums
    lowest, mean = sums.minimum(float(at.gap0.min())), sums.mean(at.gap0)
    # Where the load is given, half way up to the mean height.
    height = 0.0 if at.load is None else 0.5 * (lowest + mean)
    level.parallel.only(passes.press, height, level.stiffest, at.gap0, at.p)
    if not level.set_load(at) and at.load is not None:
        at.p[:] = at.load / level.grid.size  # the punch lies equally low everywhere
