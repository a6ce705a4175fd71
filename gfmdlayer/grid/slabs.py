"""A surface over the ranks of an MPI job: each holds some of its rows, and some columns of its transform.

Rank r of R holds the rows from n r/R to n (r+1)/R of every field, and of a spectrum, n rows of m modes, all
rows of the columns from m r/R to m (r+1)/R: the transform along the first axis is the last one of a forward
transform, and its result stays in place. The first rank holds the wave q = 0.

Between the two transforms each rank hands every other one a block of its rows (`transposition`):

    rows (n/R, m)        <->        columns (n, m/R)

On one computer the ranks read each other's rows in shared memory, in a third of the time that messages take;
on several they send them by Alltoallv.
"""

from __future__ import annotations

import ctypes
import math
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.grid.fftw import DOUBLE, FUNCTION, SINGLE, address, call, row_plans, threads_for
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import MpiRanks, wait
from gfmdlayer.grid.sums import Completion
from gfmdlayer.grid.transforms import Columns, Filter, Plans, Transforms, by_blocks, shared_transforms

_SHARED = Path("/dev/shm")  # the memory that processes share, on Linux
_ALIGNED = 64  # bytes

Array = npt.NDArray[Any]


def edges(number: int, count: int) -> list[int]:
    """Return where the parts of a number of rows or columns begin and end, one for each of `count` ranks."""
    return [number * i // count for i in range(count + 1)]


def transposition(
    ranks: MpiRanks, shape: tuple[int, int], dtype: npt.DTypeLike = np.complex128, shared: bool = True
) -> _SharedMemory | _Messages:
    """Return the exchange for arrays of a shape, always the same one."""
    # Exchanges share one memory: rows are valid until the next exchange of any shape. `shared`: ranks on one
    # computer may share memory.
    kind = np.dtype(dtype)
    key = shape, kind, shared
    if key not in ranks.exchanges:
        sharing = shared and _can_share(ranks, shape[0] * shape[1] * kind.itemsize)
        ranks.exchanges[key] = (_SharedMemory if sharing else _Messages)(ranks, shape, kind)
    exchange: _SharedMemory | _Messages = ranks.exchanges[key]
    return exchange


class _Blocks:
    """Which rows and columns each rank has; `rows`, (rows of this rank, columns), are whole rows."""

    rows: Array

    def __init__(self, ranks: MpiRanks, shape: tuple[int, int], dtype: np.dtype[Any]) -> None:
        self._ranks, self._dtype = ranks, dtype
        self._row_edges, self._column_edges = (edges(number, ranks.count) for number in shape)
        self._width = shape[1]
        self._own_columns = slice(*self._column_edges[ranks.number : ranks.number + 2])

    def _rows_of(self, rank: int) -> slice:
        return slice(*self._row_edges[rank : rank + 2])

    def _height(self, rank: int) -> int:
        return self._row_edges[rank + 1] - self._row_edges[rank]


class _SharedMemory(_Blocks):
    """Ranks of one computer, which read and write each other's rows."""

    def __init__(self, ranks: MpiRanks, shape: tuple[int, int], dtype: np.dtype[Any]) -> None:
        super().__init__(ranks, shape, dtype)
        most = max(map(self._height, range(ranks.count)))
        self._window = _shared_window(ranks, most * self._width * dtype.itemsize)
        self._all = [self._view(rank) for rank in range(ranks.count)]
        self.rows = self._all[ranks.number]

    def _view(self, rank: int) -> Array:
        memory: Array = np.asarray(self._window.Shared_query(rank)[0])
        start, count = -memory.ctypes.data % _ALIGNED, self._height(rank) * self._width
        return np.frombuffer(memory, self._dtype, count, start).reshape(-1, self._width)

    def to_columns(self, columns: Array) -> None:
        """Read each rank's part of the columns."""
        self._meet()
        for rank, rows in enumerate(self._all):
            columns[self._rows_of(rank)] = rows[:, self._own_columns]
        self._meet()  # before a rank changes its rows

    def to_rows(self, columns: Array) -> None:
        """Write the columns into each rank's rows."""
        self._meet()  # a rank may still read what it was given before
        for rank, rows in enumerate(self._all):
            rows[:, self._own_columns] = columns[self._rows_of(rank)]
        self._meet()

    def _meet(self) -> None:
        self._window.Sync()
        wait(self._ranks.communicator.Ibarrier())
        self._window.Sync()


class _Messages(_Blocks):
    """Ranks anywhere, which send blocks of their rows."""

    def __init__(self, ranks: MpiRanks, shape: tuple[int, int], dtype: np.dtype[Any]) -> None:
        super().__init__(ranks, shape, dtype)
        height = self._height(ranks.number)
        self.rows = np.empty((height, shape[1]), dtype)
        self._packed = np.empty(height * shape[1], dtype)
        own = self._own_columns.stop - self._own_columns.start
        self._by_columns = self._counts(np.diff(self._column_edges) * height)
        self._by_rows = self._counts(np.diff(self._row_edges) * own)

    @staticmethod
    def _counts(counts: Array) -> tuple[list[int], list[int]]:
        return counts.tolist(), [0, *np.cumsum(counts).tolist()[:-1]]

    def to_columns(self, columns: Array) -> None:
        """Pack a block for each rank and send it."""
        for rank, block in enumerate(self._blocks()):
            block[:] = self.rows[:, slice(*self._column_edges[rank : rank + 2])]
        send, receive = [self._packed, self._by_columns], [columns, self._by_rows]
        wait(self._ranks.communicator.Ialltoallv(send, receive))

    def to_rows(self, columns: Array) -> None:
        """Send each rank its rows of the columns, which lie together, and unpack those received."""
        send, receive = [columns, self._by_rows], [self._packed, self._by_columns]
        wait(self._ranks.communicator.Ialltoallv(send, receive))
        for rank, block in enumerate(self._blocks()):
            self.rows[:, slice(*self._column_edges[rank : rank + 2])] = block

    def _blocks(self) -> list[Array]:
        height = len(self.rows)
        parts = np.split(self._packed, self._by_columns[1][1:])
        return [part.reshape(height, -1) for part in parts]


def _shared_window(ranks: MpiRanks, size: int) -> Any:
    """Return a window in which each rank has room for this many bytes, and all read and write all of it."""
    # The last one is returned again where it is large enough: MPI does not give such memory back, and nested
    # grids and both precisions then need no more of it than the finest grid.
    from mpi4py import MPI

    room, window = ranks.window
    if room < size:
        window = MPI.Win.Allocate_shared(size + _ALIGNED, 1, comm=ranks.communicator)
        window.Lock_all()
        ranks.window = size, window
    return window


def _can_share(ranks: MpiRanks, size: int) -> bool:
    """Whether all ranks are on one computer, with room for this many bytes in its shared memory."""
    from mpi4py import MPI

    here = ranks.communicator.Split_type(MPI.COMM_TYPE_SHARED)
    together, room = here.Get_size() == ranks.count, 0
    here.Free()
    with suppress(OSError):
        status = os.statvfs(_SHARED)
        room = status.f_bavail * status.f_frsize
    return bool(ranks.minimum(int(together and room > 2 * size)))


Places = dict[int, IntArray]  # by rank

FEWEST = 2  # rows and columns of a rank, at least


@dataclass(frozen=True)
class SlabGrid(Grid):
    """A grid in two dimensions over several ranks; ValueError for a line, or too few rows for so many."""

    members: MpiRanks = field(kw_only=True)
    _functions: dict[Any, Any] = field(default_factory=dict, init=False, repr=False, compare=False)
    _halos: dict[Any, tuple[Places, Places]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if reason := refused(self.points, self.members.count):
            raise ValueError(reason)

    @property
    def ranks(self) -> MpiRanks:
        """The processes that hold the grid."""
        return self.members

    @cached_property
    def rows(self) -> slice:
        """Rows of the grid that this rank holds."""
        return self._part(self.points[0])

    @cached_property
    def columns(self) -> slice:
        """Columns of a transform that this rank holds."""
        return self._part(self.points[1] // 2 + 1)

    def blocks(self, field: NDArray[Any], rows: int) -> Iterator[tuple[int, NDArray[Any]]]:
        """Bring a field together, see `Grid.blocks`."""
        communicator, bounds = self.ranks.communicator, edges(self.points[0], self.ranks.count)
        for first in range(0, self.points[0], rows):
            end = min(first + rows, self.points[0])
            if not self.ranks.first:
                own = slice(max(self.rows.start, first), min(self.rows.stop, end))
                if own.start < own.stop:
                    part = field[own.start - self.rows.start : own.stop - self.rows.start]
                    communicator.Send(np.ascontiguousarray(part), 0)
                continue
            block = np.empty((end - first, *field.shape[1:]), field.dtype)
            for rank, (begin, stop) in enumerate(pairwise(bounds)):
                part = block[max(begin, first) - first : max(min(stop, end) - first, 0)]
                if rank == 0 and part.size:
                    part[:] = field[first : min(stop, end)]
                elif part.size:
                    communicator.Recv(part, rank)
            yield first, block

    def from_waves(self, spectrum: ComplexArray) -> FloatArray:
        """Return the field of a transform, both of the shapes that this rank holds."""
        import scipy.fft

        exchange = transposition(self.ranks, (self.points[0], self.points[1] // 2 + 1))
        exchange.to_rows(scipy.fft.ifft(spectrum, axis=0, overwrite_x=True))
        return np.asarray(scipy.fft.irfft(exchange.rows, self.points[1], axis=1))

    def halo(self, rows: NDArray[Any], before: int, after: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return the rows beside those that this rank holds, see `Grid.halo`."""
        if (before, after) not in self._halos:
            bounds = pairwise(edges(self.points[0], self.ranks.count))
            wanted = [np.r_[first - before : first, end : end + after] for first, end in bounds]
            self._halos[before, after] = self._places(wanted)
        beside = self._exchanged(rows, before + after, *self._halos[before, after])
        return beside[:before], beside[before:]

    def rows_from(self, field: NDArray[Any], first: int, count: int) -> NDArray[Any]:
        """Return rows of the periodic surface, see `Grid.rows_from`."""
        every = self.ranks.every(np.array([first, count])).tolist()
        wanted = [np.arange(begin, begin + number) for begin, number in every]
        return self._exchanged(field, count, *self._places(wanted))

    def everywhere(self, field: NDArray[Any]) -> NDArray[Any]:
        """Return all points of a field, see `Grid.everywhere`."""
        return np.concatenate(self.ranks.all_of(field.reshape(self.shape)))

    def _exchanged(self, rows: NDArray[Any], count: int, receive: Places, send: Places) -> NDArray[Any]:
        """Return so many rows, each rank's in their places, for those of this rank that others want."""
        communicator = self.ranks.communicator
        found = np.empty((count, *rows.shape[1:]), rows.dtype)
        parts = {
            rank: np.empty((places.size, *rows.shape[1:]), rows.dtype) for rank, places in receive.items()
        }
        requests = [communicator.Irecv(part, rank) for rank, part in parts.items()]
        requests += [communicator.Isend(rows[places], rank) for rank, places in send.items()]
        for request in requests:
            wait(request)
        for rank, places in receive.items():
            found[places] = parts[rank]
        return found

    def every_mode(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of all modes, from those of the modes that this rank holds, one a mode."""
        parts = self.ranks.all_of(values.reshape(self.spectral_shape))
        return np.ravel(np.concatenate(parts, axis=1))

    @cached_property
    def completion(self) -> Completion:
        """Functions that complete results in nopython code."""

        def completed(ours: Callable[[Array], Array]) -> Callable[[int, int, int], None]:
            def complete(size: int, source: int, target: int) -> None:
                array_at(target, (size,), np.float64)[:] = ours(array_at(source, (size,), np.float64))

            return complete

        reductions = self.ranks.total, self.ranks.maximum
        return Completion(*(self._address((ours.__name__,), completed(ours)) for ours in reductions))

    def exchange_of_rows(self, number: int, dtype: npt.DTypeLike) -> int:
        """Return the address of a function that writes the rows beside those of a field."""
        # So many before and after, into an array of shape (2 number, columns).

        def exchange(_: int, source: int, target: int) -> None:
            beside = array_at(target, (2, number, self.points[1]), dtype)
            beside[0], beside[1] = self.halo(array_at(source, self.shape, dtype), number, number)

        return self._address(("exchange", number, dtype), exchange)

    def sum_of_rows(self, points: tuple[int, ...], first: int, count: int, dtype: npt.DTypeLike) -> int:
        """Return the address of a function that makes a whole field of so many points of the ranks' parts."""
        # A part has `count` rows, which begin with the row `first` of the periodic field. Where parts have
        # the same rows, these are added.
        every = self.ranks.all_of((first, count))
        counts, parts = [rows * points[1] for _, rows in every], list[Array]()

        def join(_: int, source: int, target: int) -> None:
            own, field = array_at(source, (count, points[1]), dtype), array_at(target, points, dtype)
            parts[:] = parts or [np.empty((sum(counts) // points[1], points[1]), dtype)]
            wait(self.ranks.communicator.Iallgatherv(own, [parts[0], counts]))
            field[:], end = 0, 0
            for begin, rows in every:
                part, end = parts[0][end : end + rows], end + rows
                inside = min(rows, points[0] - begin)
                field[begin : begin + inside] += part[:inside]
                field[: rows - inside] += part[inside:]

        return self._address(("sum", points, dtype), join)

    def _address(self, key: Any, called: Callable[[int, int, int], None]) -> int:
        """Return the address of a function, always the same one, that lives as long as the grid."""
        if key not in self._functions:
            self._functions[key] = callable_by_address(self.ranks, called)
        return address(self._functions[key])

    def _places(self, wanted: Sequence[IntArray]) -> tuple[Places, Places]:
        """Places of the rows from each rank among those this one wants, and among its own those for each."""
        bounds = np.array(edges(self.points[0], self.ranks.count))
        rows = [each % bounds[-1] for each in wanted]
        owners = np.searchsorted(bounds, rows[self.ranks.number], side="right") - 1
        receive = {rank: np.flatnonzero(owners == rank) for rank in np.unique(owners).tolist()}
        own = [each[(each >= self.rows.start) & (each < self.rows.stop)] for each in rows]
        send = {rank: each - self.rows.start for rank, each in enumerate(own) if each.size}
        return receive, send

    def of_points(self, points: tuple[int, ...]) -> Grid | None:
        """Return the grid with other points over the same ranks; None where it has too few rows."""
        return None if refused(points, self.ranks.count) else super().of_points(points)

    def _part(self, number: int) -> slice:
        return slice(*edges(number, self.ranks.count)[self.ranks.number : self.ranks.number + 2])


def refused(points: tuple[int, ...], ranks: int) -> str:
    """Return why a grid cannot be held by so many ranks, if so."""
    if len(points) == 1:
        return "a line; must be a surface in two dimensions where a case has several ranks"
    most = min(points[0], points[1] // 2 + 1) // FEWEST
    allowed = f"must be for at most {most} ranks a case"
    return f"{points[0]} x {points[1]} points; {allowed}" if ranks > most else ""


def callable_by_address(ranks: MpiRanks, function: Callable[[int, int, int], None]) -> Any:
    """Return a function of a number and two addresses for `transforms.execute`, which cannot raise."""

    def called(number: int | None, source: int, target: int) -> None:
        try:
            function(number or 0, source, target)
        except BaseException:  # the other ranks would wait for ever
            traceback.print_exc()
            sys.stderr.flush()
            ranks.communicator.Abort(1)

    return FUNCTION(called)


def array_at(place: int, shape: tuple[int, ...], dtype: npt.DTypeLike) -> Array:
    """Return the array at an address."""
    kind = np.dtype(dtype)
    memory = (ctypes.c_byte * (kind.itemsize * math.prod(shape))).from_address(place)
    return np.asarray(np.ctypeslib.as_array(memory).view(kind).reshape(shape))


class SlabTransforms(Transforms):
    """Transforms of the fields of a grid over ranks: along the rows, exchange, along the columns."""

    def __init__(
        self,
        grid: SlabGrid,
        *,
        threads: int = 1,
        single: bool = False,
        shared: bool = True,
    ) -> None:
        # All ranks call them together; each gives and gets its parts. Compiled kernels call them like those
        # of one process: the functions at their addresses return to Python for the exchange, which takes some
        # microseconds beside the milliseconds of a transform. `shared`: ranks on one computer may share
        # memory.
        self._grid, self._shared, self._fftw = grid, shared, SINGLE if single else DOUBLE
        self.size, self.ranks = grid.size, grid.ranks
        self._kind = np.dtype(np.complex64 if single else np.complex128)
        whole = grid.points[0], grid.points[1] // 2 + 1
        self._exchange = transposition(grid.ranks, whole, self._kind, shared)
        self._functions = [
            callable_by_address(grid.ranks, lambda _, *places, each=each: each(*places))
            for each in (self._forward, self._backward)
        ]
        self.points, self.shape, self.spectral_shape = grid.points, grid.shape, grid.spectral_shape
        self.threads, self.single = threads, single
        self._rows = row_plans(self.shape, threads, single)
        self._columns = Columns(self.spectral_shape, threads, single)
        self.plans = Plans(0, 0, *map(address, self._functions))

    def of_shape(self, shape: tuple[int, ...], *, single: bool = False) -> Transforms:
        """Transforms of another grid over the same ranks, or in another precision."""
        grid = replace(self._grid, points=shape)
        return SlabTransforms(grid, threads=self.threads, single=single, shared=self._shared)

    def transform(self, field: Any, spectrum: Any) -> None:
        """Write the transform of a field; both flat, from `empty_field` and `empty_spectrum`."""
        self._forward(field.ctypes.data, spectrum.ctypes.data)

    def transform_back(self, spectrum: Any, field: Any) -> None:
        """Write the inverse transform of a spectrum, which is destroyed; both flat."""
        self._backward(spectrum.ctypes.data, field.ctypes.data)

    def filter(self, factors: NDArray[Any]) -> Filter:
        """Return what multiplies the modes of a field by factors, see `Transforms.filter`."""
        return Filter(self, factors)

    def truncated(self, spectrum: NDArray[Any], coarser: Transforms) -> NDArray[Any]:
        """Return the modes that a coarser grid of the same cell has too, see `Transforms.truncated`."""
        assert isinstance(coarser, SlabTransforms)
        ranks, grid = self._grid.ranks, coarser._grid
        n = grid.points[0]
        rows = np.concatenate((np.arange((n + 1) // 2), np.arange(-(n // 2), 0)))
        modes = np.ascontiguousarray(spectrum.reshape(self.spectral_shape)[rows].T)  # a row a column
        fine, coarse = (edges(each.points[1] // 2 + 1, ranks.count) for each in (self._grid, grid))
        kept = np.empty((grid.spectral_shape[1], grid.points[0]), modes.dtype)

        def common(finer: int, coarser: int, begin: int) -> slice:
            first, end = max(fine[finer], coarse[coarser]), min(fine[finer + 1], coarse[coarser + 1])
            return slice(first - begin, max(first, end) - begin)

        own, requests = ranks.number, []
        for rank in range(ranks.count):
            part = kept[common(rank, own, coarse[own])]
            requests += [ranks.communicator.Irecv(part, rank)] if part.size else []
        for rank in range(ranks.count):
            part = modes[common(own, rank, fine[own])]
            requests += [ranks.communicator.Isend(part, rank)] if part.size else []
        for request in requests:
            wait(request)
        return np.ascontiguousarray(kept.T).ravel()

    def _forward(self, source: int, target: int) -> None:
        """Transform the rows at an address into columns at another."""
        rows = self._exchange.rows
        self._fftw.execute_dft_r2c(self._rows[0], source, rows.ctypes.data)
        self._exchange.to_columns(self._columns_at(target))
        call(by_blocks()[0], self._columns.forward, 0, target)

    def _backward(self, source: int, target: int) -> None:
        """Transform the columns at an address, which are destroyed, into rows at another."""
        rows = self._exchange.rows
        call(by_blocks()[1], self._columns.backward, source, 0)
        self._exchange.to_rows(self._columns_at(source))
        self._fftw.execute_dft_c2r(self._rows[1], rows.ctypes.data, target)

    def _columns_at(self, place: int) -> NDArray[Any]:
        return array_at(place, self.spectral_shape, self._kind)


def transforms_of(grid: Grid, threads: int | None = 1) -> Transforms:
    """Return the transforms of a grid, of one process or over ranks; see `Transforms`.

    Without a number of threads, ranks take one each, and a process `fftw.threads_for` the grid.
    """
    if isinstance(grid, SlabGrid):
        return SlabTransforms(grid, threads=threads or 1)
    return shared_transforms(grid.shape, threads_for(grid.shape, threads))
