"""Exchange between the two ways in which ranks hold a surface: by rows, and by columns of its transform.

A transform along the rows needs whole rows, one along the columns whole columns. Each rank therefore hands
every other one a block of its rows:

    rows (n/R, m)        <->        columns (n, m/R)

On one computer the ranks read each other's rows in shared memory, in a third of the time that messages take;
on several they send them by Alltoallv.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from gfmdlayer.grid.ranks import MpiRanks, wait

_SHARED = Path("/dev/shm")  # the memory that processes share, on Linux
_ALIGNED = 64  # bytes

Array = npt.NDArray[Any]


class Transposition(Protocol):
    """The exchange for one shape and type; `rows`, (rows of this rank, columns), are whole rows."""

    rows: Array

    def to_columns(self, columns: Array) -> None:
        """Fill an array of this rank's columns, shape (rows, columns of this rank), from the rows."""
        ...

    def to_rows(self, columns: Array) -> None:
        """Fill the rows from each rank's columns."""
        ...


def edges(number: int, count: int) -> list[int]:
    """Return where the parts of a number of rows or columns begin and end, one for each of `count` ranks."""
    return [number * i // count for i in range(count + 1)]


def transposition(
    ranks: MpiRanks, shape: tuple[int, int], dtype: npt.DTypeLike = np.complex128, shared: bool = True
) -> Transposition:
    """Return the exchange for arrays of a shape, always the same one.

    Exchanges share one memory: rows are valid until the next exchange of any shape. `shared`: ranks on one
    computer may share memory.
    """
    kind = np.dtype(dtype)
    key = shape, kind, shared
    if key not in ranks.exchanges:
        sharing = shared and _can_share(ranks, shape[0] * shape[1] * kind.itemsize)
        ranks.exchanges[key] = (_SharedMemory if sharing else _Messages)(ranks, shape, kind)
    found: Transposition = ranks.exchanges[key]
    return found


class _Blocks:
    """Which rows and columns each rank has."""

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
    """Return a window in which each rank has room for this many bytes, and all read and write all of it.

    The last one is returned again where it is large enough: MPI does not give such memory back, and nested
    grids and both precisions then need no more of it than the finest grid alone.
    """
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
        found = os.statvfs(_SHARED)
        room = found.f_bavail * found.f_frsize
    return bool(ranks.minimum(int(together and room > 2 * size)))
