"""A surface over the ranks of an MPI job: each holds some of its rows, and some columns of its transform.

Rank r of R holds the rows from n r/R to n (r+1)/R of every field, and of a spectrum, n rows of m modes, all
rows of the columns from m r/R to m (r+1)/R: the transform along the first axis is the last one of a forward
transform, and its result stays where it is (`transposition`). The first rank holds the wave q = 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import MpiRanks, wait
from gfmdlayer.grid.transposition import edges, transposition

Places = dict[int, IntArray]  # by rank

FEWEST = 2  # rows and columns of a rank, at least


@dataclass(frozen=True)
class SlabGrid(Grid):
    """A grid in two dimensions over several ranks; ValueError for a line, or too few rows for so many."""

    members: MpiRanks = field(kw_only=True)

    def __post_init__(self) -> None:
        if reason := refused(self.points, self.members.count):
            raise ValueError(reason)

    @property
    def ranks(self) -> MpiRanks:
        """The processes that hold the grid."""
        return self.members

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the part of a field that this rank holds."""
        return self.rows.stop - self.rows.start, self.points[1]

    @property
    def spectral_shape(self) -> tuple[int, ...]:
        """Shape of the part of a transform that this rank holds."""
        return self.points[0], self.columns.stop - self.columns.start

    @property
    def first_row(self) -> int:
        """Number of the first row that this rank holds."""
        return int(self.rows.start)

    @cached_property
    def rows(self) -> slice:
        """Rows of the grid that this rank holds."""
        return self._part(self.points[0])

    @cached_property
    def columns(self) -> slice:
        """Columns of a transform that this rank holds."""
        return self._part(self.points[1] // 2 + 1)

    @property
    def waves_y(self) -> range:
        """Numbers of waves along the last axis of the modes that this rank holds."""
        return range(self.columns.start, self.columns.stop)

    @property
    def coordinates(self) -> tuple[FloatArray, ...]:
        """Coordinates along each axis of the points that this rank holds."""
        return tuple(self.own_rows(super().coordinates))

    def own_rows(self, axes: Sequence[FloatArray]) -> list[FloatArray]:
        """Return the part of arrays along each axis that belongs to the points of this rank."""
        return [axes[0][self.rows], axes[1]]

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
        receive, send = self._neighbours(before, after)
        communicator, requests = self.ranks.communicator, []
        found = np.empty((before + after, *rows.shape[1:]), rows.dtype)
        parts = {
            rank: np.empty((places.size, *rows.shape[1:]), rows.dtype) for rank, places in receive.items()
        }
        requests = [communicator.Irecv(part, rank) for rank, part in parts.items()]
        requests += [communicator.Isend(rows[places], rank) for rank, places in send.items()]
        for request in requests:
            wait(request)
        for rank, places in receive.items():
            found[places] = parts[rank]
        return found[:before], found[before:]

    def _neighbours(self, before: int, after: int) -> tuple[Places, Places]:
        """Places in the halo of the rows from each rank, and among the own rows of those for each rank."""
        if (before, after) not in self._halos:
            bounds = np.array(edges(self.points[0], self.ranks.count))
            wanted = [
                np.concatenate((np.arange(first - before, first), np.arange(end, end + after))) % bounds[-1]
                for first, end in pairwise(bounds.tolist())
            ]
            owners = np.searchsorted(bounds, wanted[self.ranks.number], side="right") - 1
            receive = {rank: np.flatnonzero(owners == rank) for rank in np.unique(owners).tolist()}
            own = [each[(each >= self.rows.start) & (each < self.rows.stop)] for each in wanted]
            send = {rank: each - self.rows.start for rank, each in enumerate(own) if each.size}
            self._halos[before, after] = receive, send
        return self._halos[before, after]

    @cached_property
    def _halos(self) -> dict[tuple[int, int], tuple[Places, Places]]:
        return {}

    def coarser(self, fewest: int) -> Grid | None:
        """Return a coarser grid over the same ranks, see `Grid.coarser`; None where it has too few rows."""
        points = tuple(n // 2 if n >= 2 * fewest else n for n in self.points)
        return None if refused(points, self.ranks.count) else super().coarser(fewest)

    @property
    def wavevectors(self) -> list[FloatArray]:
        """Components of the wavevector of each mode that this rank holds."""
        along_x, along_y = super().wavevectors
        return [along_x, along_y[:, self.columns]]

    def _waves_of_modes(self) -> FloatArray:
        return super()._waves_of_modes()[self.columns]

    def _part(self, number: int) -> slice:
        return slice(*edges(number, self.ranks.count)[self.ranks.number : self.ranks.number + 2])


def refused(points: tuple[int, ...], ranks: int) -> str:
    """Return why a grid cannot be held by so many ranks, if so."""
    if len(points) == 1:
        return "a line; must be a surface in two dimensions where a case has several ranks"
    most = min(points[0], points[1] // 2 + 1) // FEWEST
    return (
        f"{points[0]} x {points[1]} points; must be for at most {most} ranks a case" if ranks > most else ""
    )
