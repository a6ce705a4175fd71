"""Passes of compiled kernels over the points of a grid, by several threads, and completed over all points.

Kernels release the interpreter's lock, so threads of Python do. Each takes a stretch of whole rows, always
the same one: sums have the same bits from run to run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from itertools import pairwise
from math import prod
from typing import Any

import numpy as np

from gfmdlayer.grid.fftw import WORTH_THREADS
from gfmdlayer.grid.grid import Grid


class Sweep:
    """Calls kernels with stretches of the points, first and end, and adds up what they return.

    Parameters
    ----------
    grid : Grid
        The points; its `sums` complete the results.
    threads : int
        Threads that share the points of a large grid.
    shape : tuple of int, optional
        Of what is swept in place of the points, such as the modes.
    """

    def __init__(self, grid: Grid, threads: int, shape: tuple[int, ...] | None = None) -> None:
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
