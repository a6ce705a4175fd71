"""Fourier transforms of a surface over ranks: along the rows, exchange, along the columns.

Compiled kernels call them as those of one process: the functions whose addresses they get come back to
Python for the exchange, which takes some microseconds beside the milliseconds of a transform.
"""

from __future__ import annotations

import ctypes
import math
import sys
import traceback
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.grid.fftw import DOUBLE, SINGLE, SlabPlans, address, plan_pair
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import wait
from gfmdlayer.grid.slabs import SlabGrid
from gfmdlayer.grid.transforms import Plans, Transforms
from gfmdlayer.grid.transposition import edges, transposition

_FUNCTION = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)


class SlabTransforms(Transforms):
    """Transforms of the fields of a grid over ranks, which all ranks have to call together.

    Each rank gives and gets its parts. `shared`: ranks on one computer may share memory.
    """

    def __init__(
        self,
        grid: SlabGrid,
        wisdom: str | None = None,
        time_limit: float = 10.0,
        threads: int = 1,
        single: bool = False,
        *,
        shared: bool = True,
    ) -> None:
        self._grid, self._shared, self._fftw = grid, shared, SINGLE if single else DOUBLE
        self.size, self.ranks = grid.size, grid.ranks
        self._kind = np.dtype(np.complex64 if single else np.complex128)
        whole = grid.points[0], grid.points[1] // 2 + 1
        self._exchange = transposition(grid.ranks, whole, self._kind, shared)
        self._functions = [_FUNCTION(self._called(each)) for each in (self._forward, self._backward)]
        self.shape, self.spectral_shape = grid.shape, grid.spectral_shape
        self.threads, self.single, self._wisdom, self._time_limit = threads, single, wisdom, time_limit
        self._plan()

    def _plan(self) -> None:
        shape = *self.shape, *self.spectral_shape
        made = self._wisdom, self._time_limit, self.threads, self.single
        self._pair = self._slab = plan_pair(SlabPlans, shape, *made)
        self.plans = Plans(0, 0, *map(address, self._functions))

    def of_shape(self, shape: tuple[int, ...], *, single: bool = False) -> Transforms:
        """Transforms of another grid over the same ranks, or in another precision."""
        grid = replace(self._grid, points=shape)
        made = self._wisdom, self._time_limit, self.threads, single
        return SlabTransforms(grid, *made, shared=self._shared)

    def transform(self, field: Any, spectrum: Any) -> None:
        """Write the transform of a field; both flat, from `empty_field` and `empty_spectrum`."""
        self._forward(field.ctypes.data, spectrum.ctypes.data)

    def transform_back(self, spectrum: Any, field: Any) -> None:
        """Write the inverse transform of a spectrum, which is destroyed; both flat."""
        self._backward(spectrum.ctypes.data, field.ctypes.data)

    def truncated(self, spectrum: NDArray[Any], coarser: Transforms) -> NDArray[Any]:
        """Return the modes that a coarser grid of the same cell has too, see `Transforms.truncated`."""
        assert isinstance(coarser, SlabTransforms)
        ranks, grid = self._grid.ranks, coarser._grid
        modes = np.ascontiguousarray(self._rows_of_coarser(spectrum, grid.points[0]).T)  # a row a column
        fine, coarse = (edges(each.points[1] // 2 + 1, ranks.count) for each in (self._grid, grid))
        found = np.empty((grid.spectral_shape[1], grid.points[0]), modes.dtype)

        def common(finer: int, coarser: int, begin: int) -> slice:
            first, end = max(fine[finer], coarse[coarser]), min(fine[finer + 1], coarse[coarser + 1])
            return slice(first - begin, max(first, end) - begin)

        own, requests = ranks.number, []
        for rank in range(ranks.count):
            part = found[common(rank, own, coarse[own])]
            requests += [ranks.communicator.Irecv(part, rank)] if part.size else []
        for rank in range(ranks.count):
            part = modes[common(own, rank, fine[own])]
            requests += [ranks.communicator.Isend(part, rank)] if part.size else []
        for request in requests:
            wait(request)
        return np.ascontiguousarray(found.T).ravel()

    def _rows_of_coarser(self, spectrum: NDArray[Any], points: int) -> NDArray[Any]:
        positive, negative = np.arange((points + 1) // 2), np.arange(-(points // 2), 0)
        return spectrum.reshape(self.spectral_shape)[np.concatenate((positive, negative))]

    def _forward(self, source: int, target: int) -> None:
        """Transform the rows at an address into columns at another."""
        rows = self._exchange.rows
        self._fftw.execute_dft_r2c(self._slab.forward, source, rows.ctypes.data)
        self._exchange.to_columns(self._columns(target))
        self._fftw.execute_dft(self._slab.columns_forward, target, target)

    def _backward(self, source: int, target: int) -> None:
        """Transform the columns at an address, which are destroyed, into rows at another."""
        rows = self._exchange.rows
        self._fftw.execute_dft(self._slab.columns_backward, source, source)
        self._exchange.to_rows(self._columns(source))
        self._fftw.execute_dft_c2r(self._slab.backward, rows.ctypes.data, target)

    def _columns(self, place: int) -> NDArray[Any]:
        kind = self._kind
        memory = (ctypes.c_byte * (kind.itemsize * math.prod(self.spectral_shape))).from_address(place)
        return np.asarray(np.ctypeslib.as_array(memory).view(kind).reshape(self.spectral_shape))

    def _called(self, transform: Callable[[int, int], None]) -> Callable[[Any, int, int], None]:
        """Return a function for compiled code, which cannot pass on an exception."""

        def call(_plan: Any, source: int, target: int) -> None:
            try:
                transform(source, target)
            except BaseException:  # the other ranks would wait for ever
                traceback.print_exc()
                sys.stderr.flush()
                self._grid.ranks.communicator.Abort(1)

        return call


def transforms_of(grid: Grid, wisdom: str | None = None, threads: int = 1) -> Transforms:
    """Return the transforms of a grid, of one process or over ranks; see `Transforms`."""
    if isinstance(grid, SlabGrid):
        return SlabTransforms(grid, wisdom, threads=threads)
    return Transforms(grid.shape, wisdom, threads=threads)
