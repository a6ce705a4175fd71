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
from numba.cpython.unsafe.tuple import tuple_setitem

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.grid.transforms import execute
from gfmdlayer.kernels import kernel


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
    execute(function, work.size, work, work)  # type: ignore[call-arg]
    for i in range(len(values)):
        values = tuple_setitem(values, i, work[i])
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
        numbers = (spectrum.view(np.float64) for spectrum in (v, f, g))
        return tuple(self.total(np.array(products(self.weights_twice, *numbers))).tolist())

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
