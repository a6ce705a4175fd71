"""The processes that hold a grid together, and the completion of partial results over them.

One process holds the whole grid (`ALONE`), or the ranks of an MPI job hold the rows of a surface in slabs
(`slabs`). Every rank computes with the completed results, so that all take the same decisions.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

_PATIENCE, _PAUSE = 2e-4, 2e-5  # seconds

Partial = TypeVar("Partial", int, float, NDArray[Any])


class Ranks:
    """One process, which holds the whole grid; `number` of this rank, from 0, and `count` of the ranks."""

    number: int = 0
    count: int = 1

    @property
    def first(self) -> bool:
        """Whether this is the rank that holds the first row, the wave q = 0, and the files."""
        return self.number == 0

    def total(self, partial: Partial) -> Partial:
        """Complete a sum; an array is completed element by element."""
        return partial

    def maximum(self, partial: Partial) -> Partial:
        """Complete a maximum; an array is completed element by element."""
        return partial

    def minimum(self, partial: Partial) -> Partial:
        """Complete a minimum; an array is completed element by element."""
        return partial

    def mean(self, field: NDArray[Any]) -> float:
        """Mean of a field over the surface."""
        return float(field.sum() / field.size)  # that of numpy takes twice the time

    def mean_wave(self, values: NDArray[Any]) -> Any:
        """Return the value at the wave q = 0, of one value a mode."""
        return values[0]

    def set_mean_wave(self, values: NDArray[Any], value: complex) -> None:
        """Set the value at the wave q = 0, of one value a mode."""
        values[0] = value

    def shared(self, value: Any) -> Any:
        """Return the value of the first rank."""
        return value

    def all_of(self, value: Any) -> list[Any]:
        """Return the values of all ranks."""
        return [value]

    @contextmanager
    def agreeing(self, kind: type[Exception]) -> Iterator[None]:
        """Raise an exception of this kind on all ranks where one raises it in the block."""
        failure = ""
        try:
            yield
        except kind as error:
            failure = str(error) or type(error).__name__
        if failure := next(filter(None, self.all_of(failure)), ""):
            raise kind(failure)

    def counted(self, number: int) -> tuple[int, int]:
        """Return the sum of a number over the ranks before this one, and over all."""
        return 0, number

    def gathered(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Return the rows of all ranks, one after the other, on the first; none on the others."""
        return rows

    def brought(self, arrays: Sequence[NDArray[Any]]) -> Iterator[NDArray[Any]]:
        """Yield the arrays of all ranks, one after the other, on the first; send them there on the others."""
        yield from arrays

    def handed_out(self, arrays: Iterator[NDArray[Any]], numbers: Sequence[int]) -> list[NDArray[Any]]:
        """Return this rank's part of the arrays that the first rank has: so many of them for each rank."""
        return list(islice(arrays, numbers[0]))


def wait(request: Any) -> None:
    """Wait for a message between ranks, and leave the core to others where it takes long."""
    # MPI libraries wait without a pause: where there are more ranks than idle cores, each would then take its
    # share of time from the one that it waits for.
    begun = time.perf_counter()
    while not request.Test():
        if time.perf_counter() - begun > _PATIENCE:
            time.sleep(_PAUSE)


ALONE = Ranks()


class MpiRanks(Ranks):
    """The ranks of an MPI communicator."""

    def __init__(self, communicator: Any) -> None:
        # Sums are added up in the order of the ranks, whatever the MPI library does: their bits depend only
        # on the number of ranks, and are the same on all of them. `control` is a communicator of the same
        # ranks for other messages, `exchanges` has those of `slabs.transposition` by shape and type, `window`
        # the bytes of each rank in the memory that they share, with its `mpi4py.MPI.Win`.
        self.communicator, self.control = communicator, communicator.Dup()
        self.exchanges: dict[Any, Any] = {}
        self.window: tuple[int, Any] = (0, None)
        self.number, self.count = communicator.Get_rank(), communicator.Get_size()

    def every(self, partial: Any) -> NDArray[Any]:
        """Return the partial results of all ranks, shape (count, ...)."""
        own = np.ascontiguousarray(partial)
        partials = np.empty((self.count, *np.shape(partial)), own.dtype)
        wait(self.communicator.Iallgather(own, partials))
        return partials

    def total(self, partial: Partial) -> Partial:
        """Complete a sum; an array is completed element by element."""
        return _of_kind(partial, self.every(partial).sum(axis=0))

    def maximum(self, partial: Partial) -> Partial:
        """Complete a maximum; an array is completed element by element."""
        return _of_kind(partial, self.every(partial).max(axis=0))

    def minimum(self, partial: Partial) -> Partial:
        """Complete a minimum; an array is completed element by element."""
        return _of_kind(partial, self.every(partial).min(axis=0))

    def mean(self, field: NDArray[Any]) -> float:
        """Mean over the surface of a field, of which each rank holds its part."""
        total, size = self.total(np.array([field.sum(), field.size])).tolist()
        return float(total / size)

    def mean_wave(self, values: NDArray[Any]) -> Any:
        """Return the value at the wave q = 0, which the first rank holds."""
        return self.every(values[0])[0]

    def set_mean_wave(self, values: NDArray[Any], value: complex) -> None:
        """Set the value at the wave q = 0, on the first rank."""
        if self.first:
            values[0] = value

    def shared(self, value: Any) -> Any:
        """Return the value of the first rank."""
        return self.communicator.bcast(value)

    def all_of(self, value: Any) -> list[Any]:
        """Return the values of all ranks."""
        return list(self.communicator.allgather(value))

    def counted(self, number: int) -> tuple[int, int]:
        """Return the sum of a number over the ranks before this one, and over all."""
        every = self.every(number)
        return int(every[: self.number].sum()), int(every.sum())

    def gathered(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Return the rows of all ranks, one after the other, on the first; none on the others."""
        parts = self.communicator.gather(rows)
        return np.concatenate(parts) if self.first else rows[:0]

    def brought(self, arrays: Sequence[NDArray[Any]]) -> Iterator[NDArray[Any]]:
        """Yield the arrays of all ranks, one after the other, on the first; send them there on the others."""
        numbers = self.all_of(len(arrays))
        if not self.first:
            for values in arrays:
                self.communicator.send(values, 0)
            return
        yield from arrays
        for rank, number in enumerate(numbers[1:], start=1):
            for _ in range(number):
                yield self.communicator.recv(source=rank)

    def handed_out(self, arrays: Iterator[NDArray[Any]], numbers: Sequence[int]) -> list[NDArray[Any]]:
        """Return this rank's part of the arrays that the first rank has: so many of them for each rank."""
        if not self.first:
            return [self.communicator.recv(source=0) for _ in range(numbers[self.number])]
        own = list(islice(arrays, numbers[0]))
        for rank, number in enumerate(numbers[1:], start=1):
            for values in islice(arrays, number):
                self.communicator.send(values, rank)
        return own


def _of_kind(partial: Partial, result: NDArray[Any]) -> Partial:
    kind: Any = result if isinstance(partial, np.ndarray) else result.item()
    return cast(Partial, kind)
