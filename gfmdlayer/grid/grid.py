"""The periodic grid of the surface, and its wavenumbers.

Points are at x_j = j L/n - L/2, j = 0 ... n-1, along each of one or two axes. Fields are real arrays of the
grid's shape; their transforms are real-to-complex, so the last axis of a spectrum has n//2 + 1 entries.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import ceil, gcd, log2, prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.wavevectors import Wavevectors
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.grid.sums import Completion, Sums
from gfmdlayer.made_once import made_once

COARSEST = 64  # points of an axis of the coarsest of nested grids, at least
_SHORTEST = 64  # points of an axis of the smallest windows
_FIELDS = 3  # that a grid may make of its waves and their weights


def finer(points: Sequence[int], factor: float) -> str:
    """Write the powers of two that are at least so many times as many points along each axis."""
    enough = [1 << ceil(log2(factor * count)) for count in points]
    return str(enough[0] if len(enough) == 1 else enough)


@dataclass(frozen=True)
class Grid:
    """A periodic grid in one or two dimensions."""

    points: tuple[int, ...]  # along each axis
    period: tuple[float, ...]  # L along each axis

    @property
    def ranks(self) -> Ranks:
        """The processes that hold the grid."""
        return ALONE

    @cached_property
    def rows(self) -> slice:
        """Points along the first axis that this process holds."""
        return slice(0, self.points[0])

    @cached_property
    def columns(self) -> slice:
        """Waves along the last axis of the modes that this process holds."""
        return slice(0, self.points[-1] // 2 + 1)

    @property
    def first_row(self) -> int:
        """Number of the first row that this process holds."""
        return int(self.rows.start)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of a field on the grid, or of the part of it that this process holds."""
        return (self.rows.stop - self.rows.start, *self.points[1:])

    @property
    def size(self) -> int:
        """Number of grid points, of all processes."""
        return prod(self.points)

    @property
    def spectral_shape(self) -> tuple[int, ...]:
        """Shape of the real-to-complex transform of a field."""
        return (*self.points[:-1], self.columns.stop - self.columns.start)

    @property
    def waves_y(self) -> range:
        """Numbers of waves along the last axis of the modes that this process holds."""
        return range(self.columns.start, self.columns.stop)

    def own_rows(self, axes: Sequence[FloatArray]) -> list[FloatArray]:
        """Return the part of arrays along each axis that belongs to the points of this process."""
        return [axes[0][self.rows], *axes[1:]]

    @property
    def coordinates(self) -> tuple[FloatArray, ...]:
        """Coordinates x_j = j L/n - L/2 along each axis of the points that this process holds."""
        every = zip(self.points, self.period, strict=True)
        axes = [np.arange(n, dtype=np.float64) * (length / n) - length / 2 for n, length in every]
        return tuple(self.own_rows(axes))

    @property
    def waves(self) -> Wavevectors:
        """Wavevector of each mode that this process holds, of shape ``spectral_shape``."""
        return _waves(self)

    @property
    def wavenumbers(self) -> FloatArray:
        """Magnitude q = |q| of the wavevector of each mode, of shape ``spectral_shape``."""
        return self.waves.magnitude

    @cached_property
    def largest_wavenumber_x(self) -> float:
        """Largest wavenumber along x."""
        return float(np.abs(self.wavevectors[0]).max())

    @cached_property
    def wavenumbers_x(self) -> FloatArray:
        """Wavenumbers along x of the two waves that each mode is the mean of, shape (2, *spectral_shape)."""
        # The two are equal, but for the largest wavenumber of an even grid, where +q and -q share one mode.
        q = np.broadcast_to(self.wavevectors[0], self.spectral_shape)
        largest = np.pi * self.points[0] / self.period[0]
        return np.stack((q, np.where(np.abs(q) > (1 - 1e-9) * largest, -q, q)))

    @cached_property
    def parseval_weights(self) -> FloatArray:
        """Weight of each mode in a mean over the surface (Parseval): most modes stand for two waves."""
        waves = np.full(self.points[-1] // 2 + 1, 2.0)
        waves[0] = 1.0
        if self.points[-1] % 2 == 0:
            waves[-1] = 1.0
        weights = np.broadcast_to(waves[self.columns] / self.size**2, self.spectral_shape).copy()
        weights.flags.writeable = False
        return weights

    @cached_property
    def sums(self) -> Sums:
        """Sums, means and extrema over the points and the waves of the grid."""
        return Sums(self.parseval_weights, self.ranks)

    @property
    def completion(self) -> Completion:
        """Functions that complete results in nopython code."""
        return Completion()

    def every_mode(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of all modes, from those of the modes that this process holds, one a mode."""
        return values

    @property
    def is_whole(self) -> bool:
        """Whether this process holds all points."""
        return self.shape == self.points

    def halo(self, rows: NDArray[Any], before: int, after: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return rows of the periodic surface before and after those held, of shape (rows, columns)."""
        held = len(rows)
        if max(before, after) <= held:
            return rows[held - before :], rows[:after]
        return rows[np.arange(-before, 0) % held], rows[np.arange(after) % held]

    def rows_from(self, field: NDArray[Any], first: int, count: int) -> NDArray[Any]:
        """Return so many rows of the periodic surface from one on, of those held; all processes together."""
        return field[np.arange(first, first + count) % self.points[0]]

    def everywhere(self, field: NDArray[Any]) -> NDArray[Any]:
        """Return all points of a field, one value a point, on every process, in the shape of the grid."""
        return field.reshape(self.points)

    def of_points(self, points: tuple[int, ...]) -> Grid | None:
        """Return the grid of the same cell with other points; None where the processes cannot hold it."""
        return replace(self, points=points)

    def coarser(self, fewest: int) -> Grid | None:
        """Return the grid with half of the points of each axis that has twice the fewest; else None."""
        points = tuple(n // 2 if n >= 2 * fewest else n for n in self.points)
        return None if points == self.points else self.of_points(points)

    @property
    def nested(self) -> list[Grid]:
        """The grid and ever coarser ones, to the last with no axis of twice `COARSEST` points."""
        grids = [self]
        while coarser := grids[-1].coarser(COARSEST):
            grids.append(coarser)
        return grids

    def blocks(self, field: NDArray[Any], rows: int) -> Iterator[tuple[int, NDArray[Any]]]:  # noqa: ARG002
        """Bring a field together on the first process: yield a first row's number, and rows from it on."""
        yield 0, field

    def from_waves(self, spectrum: ComplexArray) -> FloatArray:
        """Return the field of a transform; the transform is overwritten."""
        import scipy.fft

        return np.asarray(scipy.fft.irfftn(spectrum, s=self.shape, overwrite_x=True))

    @property
    def wavevectors(self) -> list[FloatArray]:
        """Components of the wavevector of each mode, one array an axis, which broadcast together."""
        every = zip(self.points[:-1], self.period[:-1], strict=True)
        axes = [2 * np.pi * np.fft.fftfreq(n, length / n) for n, length in every]
        along = 2 * np.pi * np.fft.rfftfreq(self.points[-1], self.period[-1] / self.points[-1])
        axes.append(along[self.columns])
        return list(np.meshgrid(*axes, indexing="ij", sparse=True))


@made_once(lambda grid: _FIELDS * 8 * grid.size)
def shared_grid(points: tuple[int, ...], period: tuple[float, ...]) -> Grid:
    """Return a grid of one process with what it has made of its points, its waves and their weights."""
    return Grid(points, period)


@made_once(lambda waves: 3 * waves.magnitude.nbytes)
def _waves(grid: Grid) -> Wavevectors:
    waves = Wavevectors.of_components(*grid.wavevectors)
    for values in (waves.qx, waves.qy, waves.magnitude):
        values.flags.writeable = False
    return waves


@cache
def parts(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Divisors m for which a window of 1/m of the points of each axis has a transform, ascending."""
    divisors: list[int] = []
    common, part = gcd(*shape), 1
    while common > 1:
        factor = next(f for f in range(2, common + 1) if common % f == 0)
        common, part = common // factor, part * factor
        if min(shape) // part < _SHORTEST:
            break
        divisors.append(part)
    return tuple(divisors)
