"""Sums over the grid: the one place where values at different points and waves are combined.

The rule: a compiled kernel acts on the points and waves that this process holds and returns partial results;
Python code completes them by a method of `Sums`, and a kernel that goes on with them by `summed` and
`greatest`. One process holds the whole grid, and partial results are complete; on a grid over several ranks
these communicate, and no caller changes.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.grid.transforms import execute
from gfmdlayer.kernels import filled, kernel, with_item


class Completion(NamedTuple):
    """Addresses of functions that complete results over the ranks, for nopython code; 0 on one process."""

    total: int = 0
    maximum: int = 0


@kernel(inner=True)
def summed(over: Completion, sums: Any) -> Any:
    """Complete sums, a tuple of float64, in nopython code."""
    return sums if over.total == 0 else _completed(over.total, sums)


@kernel(inner=True)
def greatest(over: Completion, maxima: Any) -> Any:
    """Complete maxima, a tuple of float64, in nopython code."""
    return maxima if over.maximum == 0 else _completed(over.maximum, maxima)


@kernel(inner=True)
def _completed(function: int, values: Any) -> Any:
    work = np.empty(len(values))
    for i in range(len(values)):
        work[i] = values[i]
    execute(function, work.size, work, work)
    for i in range(len(values)):
        values = with_item(values, i, work[i])
    return values


class Sums:
    """Sums, means and extrema over a grid; weights of waves give means, <f g> = sum weight Re(f conj g)."""

    def __init__(self, weights: FloatArray, ranks: Ranks = ALONE) -> None:
        self.weights, self.ranks = np.ravel(weights), ranks
        self.total, self.maximum, self.minimum = ranks.total, ranks.maximum, ranks.minimum
        self.mean = ranks.mean

    def spectral_mean(self, f: ComplexArray, g: ComplexArray) -> float:
        """Mean <f g> over the surface, from the transforms."""
        return self.spectral_means(f, g, g)[0]

    def spectral_means(self, v: ComplexArray, f: ComplexArray, g: ComplexArray) -> tuple[float, ...]:
        """Means <v f>, <v g> and <v v> over the surface, from the transforms."""
        real = np.float64
        means: tuple[float, ...] = products(self.weights_twice, v.view(real), f.view(real), g.view(real))
        return means if self.ranks.count == 1 else tuple(self.total(np.array(means)).tolist())

    @cached_property
    def weights_twice(self) -> FloatArray:
        """Weights of alternating real and imaginary parts."""
        return np.repeat(self.weights, 2)


@kernel(reorder=True, borrows=True)
def products(weights: FloatArray, v: FloatArray, f: FloatArray, g: FloatArray) -> tuple[float, float, float]:
    """Sums of weights v f, weights v g and weights v v; not left to BLAS, whose threads cost more here."""
    with_f, with_g, squares = 0.0, 0.0, 0.0
    for i in range(weights.size):
        part = weights[i] * v[i]
        with_f += part * f[i]
        with_g += part * g[i]
        squares += part * v[i]
    return with_f, with_g, squares


# Sums with the bits of numpy's.

_BLOCK = 128  # numbers that numpy sums one after the other, in eight lanes
_LEVELS = 64


@kernel(inner=True, borrows=True)
def pairwise_sum(x: FloatArray, start: int = 0, stride: int = 1) -> float:
    """Sum of an array as `numpy.sum` has it, to the bit: by halves down to blocks.

    Of the real or the imaginary parts of complex numbers every second number counts: the stride is two.
    """
    # Of each level the second half, and the sum of the first once it is known.
    firsts, counts, sums = filled(_LEVELS, 0.0), filled(_LEVELS, 0.0), filled(_LEVELS, 0.0)
    level, first, count = 0, 0, x.size // stride
    while True:
        while count > _BLOCK // stride:
            half = count // 2
            half -= half % (8 // stride)
            firsts[level], counts[level] = first + half, count - half
            level, count = level + 1, half
        total = _sum_of_block(x, first, count) if stride == 1 else _sum_of_parts(x, start, first, count)
        while level > 0 and counts[level - 1] == 0.0:
            level -= 1
            total = sums[level] + total
        if level == 0:
            return total
        first, count = int(firsts[level - 1]), int(counts[level - 1])
        sums[level - 1], counts[level - 1] = total, 0.0


@kernel(inner=True, borrows=True)
def _sum_of_parts(x: FloatArray, start: int, first: int, count: int) -> float:
    total, whole = 0.0, count - count % 4
    if whole:
        at = 2 * first + start
        a, b, c, d = x[at], x[at + 2], x[at + 4], x[at + 6]
        for i in range(at + 8, at + 2 * whole, 8):
            a, b, c, d = a + x[i], b + x[i + 2], c + x[i + 4], d + x[i + 6]
        total = (a + b) + (c + d)
    for i in range(first + whole, first + count):
        total += x[2 * i + start]
    return float(total)


@kernel(inner=True, borrows=True)
def _sum_of_block(x: FloatArray, first: int, count: int) -> float:
    total, whole = 0.0, count - count % 8
    if whole:
        a, b, c, d, e, f, g, h = (
            x[first], x[first + 1], x[first + 2], x[first + 3],
            x[first + 4], x[first + 5], x[first + 6], x[first + 7],
        )  # fmt: skip
        for i in range(first + 8, first + whole, 8):
            a, b, c, d = a + x[i], b + x[i + 1], c + x[i + 2], d + x[i + 3]
            e, f, g, h = e + x[i + 4], f + x[i + 5], g + x[i + 6], h + x[i + 7]
        total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for i in range(first + whole, first + count):
        total += x[i]
    return total
