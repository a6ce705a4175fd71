"""Measured surfaces as punches: what is missing is filled in, and the cell continued periodically.

A measurement neither joins up with itself at the edges nor is it free of holes. What is done about that is
what the user asks for, in this order, and each step says what it did:

fill        points that were not measured take the heights of a membrane spanned between their neighbours
detrend     the plane, or the paraboloid, of least squares is subtracted
taper       deviations from the mean height fade out towards the edges (Tukey's window; 1 is Hann's)
resample    to the points of the grid, by the Fourier series
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import FloatArray
from gfmdlayer.files.tables import TableError
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.height_files import read_heights, times

_SEAM = 3.0  # a step across the seam beyond so many times the usual one is no part of the surface


@dataclass(frozen=True)
class Topography:
    """A measured surface, upside down: its summits touch first.

    Parameters
    ----------
    file : Path
        See `height_files`.
    dataset : str, optional
        The name of the heights in an HDF5 or netCDF file.
    unit : float
        Length of the file's unit.
    fill : str
        ``none`` or ``membrane``.
    detrend : str
        ``none``, ``plane`` or ``paraboloid``.
    taper : float
        Part of the cell, from 0 to 1, over which the heights fade out along each axis.
    resample : str
        ``none`` or ``fourier``.
    """

    file: Path
    dataset: str | None = None
    unit: float = 1.0
    fill: str = "none"
    detrend: str = "none"
    taper: float = 0.0
    resample: str = "none"

    def __call__(self, grid: Grid) -> FloatArray:
        """Heights of the punch above its lowest point, of the grid's shape.

        Raises
        ------
        TableError
            If the file cannot be used.
        """
        return self.continued(grid)[0]

    def continued(self, grid: Grid) -> tuple[FloatArray, list[str]]:
        """Heights as `__call__` returns them, and what was done to the measured ones."""
        measured = read_heights(self.file, len(grid.shape), self.dataset)
        heights, done = self.unit * measured.values, list[str]()
        self._check_lengths(measured.lengths, grid)
        for step in (self._filled, self._detrended, self._tapered):
            heights, note = step(heights)
            done += [note] if note else []
        done += [note for note in map(self._seam, range(heights.ndim), [heights] * 2) if note]
        heights, note = self._resampled(heights, grid)
        done += [note] if note else []
        return heights.max() - heights, [f"{self.file}: {note}" for note in done]

    def _check_lengths(self, lengths: tuple[float, ...] | None, grid: Grid) -> None:
        if lengths is None:
            return
        found = tuple(self.unit * length for length in lengths)
        if not np.allclose(found, grid.period, rtol=1e-3, atol=0):
            raise TableError(
                f"{self.file}: is {_lengths(found)} long (with unit = {self.unit:g}), but grid.period is "
                f"{_lengths(grid.period)}; must agree within a thousandth"
            )

    def _filled(self, heights: FloatArray) -> tuple[FloatArray, str]:
        holes = np.isnan(heights)
        if not holes.any():
            return heights, ""
        count = f"{holes.sum()} of {holes.size} points have no height"
        if holes.all():
            raise TableError(f"{self.file}: {count}")
        if self.fill == "none":
            first = np.argwhere(holes)[0].tolist()
            raise TableError(
                f"{self.file}: {count}, the first at index {first}; must be none, or fill: membrane"
            )
        return membrane(heights, holes), f"{count}; a membrane between their neighbours fills them in"

    def _detrended(self, heights: FloatArray) -> tuple[FloatArray, str]:
        if self.detrend == "none":
            return heights, ""
        rest = without_trend(heights, curved=self.detrend == "paraboloid")
        return rest, f"the {self.detrend} of least squares was subtracted; {_change(heights, rest)}"

    def _tapered(self, heights: FloatArray) -> tuple[FloatArray, str]:
        if self.taper == 0:
            return heights, ""
        from scipy.signal.windows import tukey

        windows = np.meshgrid(
            *(tukey(n, self.taper, sym=False) for n in heights.shape), indexing="ij", sparse=True
        )
        faded = heights - heights.mean()
        for window in windows:
            faded = faded * window
        return faded, f"heights fade out over {self.taper:g} of the cell; {_change(heights, faded)}"

    def _seam(self, axis: int, heights: FloatArray) -> str:
        usual = _rms(np.diff(heights, axis=axis))
        seam = _rms(np.take(heights, 0, axis) - np.take(heights, -1, axis))
        if seam <= _SEAM * usual:
            return ""
        times_usual = f"{seam / usual:.3g} times the usual one" if usual > 0 else "the only one"
        advice = "" if self.taper else "; taper makes it join up"
        where = f"does not join up with itself along {'xy'[axis]}"
        return f"{where}: the step across the seam is {times_usual}{advice}"

    def _resampled(self, heights: FloatArray, grid: Grid) -> tuple[FloatArray, str]:
        if heights.shape == grid.shape:
            return heights, ""
        if self.resample == "none":
            raise TableError(
                f"{self.file}: holds {times(heights.shape)} heights; must be {times(grid.shape)}, as the "
                "grid, or resample: fourier"
            )
        from scipy.signal import resample

        found = heights
        for axis, n in enumerate(grid.shape):
            found = resample(found, n, axis=axis)
        done = f"resampled from {times(heights.shape)} to {times(grid.shape)} points by the Fourier series"
        return found, f"{done}; {_change(heights, found)}"


def without_trend(heights: FloatArray, *, curved: bool) -> FloatArray:
    """Subtract the mean and the plane, or the paraboloid, of least squares.

    On a whole grid the mean, the slopes, the squares without their means and the product of centred
    coordinates are orthogonal, so each is taken off by itself.
    """
    axes = np.meshgrid(*(np.arange(n) - (n - 1) / 2 for n in heights.shape), indexing="ij", sparse=True)
    shapes = list(axes)
    if curved:
        shapes += [x**2 - np.mean(x**2) for x in axes] + [axes[0] * y for y in axes[1:]]
    rest = heights - heights.mean()
    for shape in shapes:
        rest -= shape * (np.mean(rest * shape) / np.mean(shape**2))
    return np.asarray(rest)


def membrane(heights: FloatArray, holes: npt.NDArray[np.bool_]) -> FloatArray:
    """Give each hole the mean height of its neighbours, up to four on two axes: a membrane at rest."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import spsolve

    count = int(holes.sum())
    index = np.full(heights.shape, -1)
    index[holes] = np.arange(count)
    rows, columns, weights, forces = [], [], [], np.zeros(count)
    for axis in range(heights.ndim):
        i, h = np.moveaxis(index, axis, 0), np.moveaxis(heights, axis, 0)
        for here, there, beside in ((i[:-1], i[1:], h[1:]), (i[1:], i[:-1], h[:-1])):
            hole = here >= 0
            both = hole & (there >= 0)
            rows += [here[hole], here[both]]
            columns += [here[hole], there[both]]
            weights += [np.ones(hole.sum()), -np.ones(both.sum())]
            rim = hole & (there < 0)
            forces += np.bincount(here[rim], beside[rim], count)
    entries = np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))
    filled = heights.copy()
    filled[holes] = spsolve(coo_array(entries, shape=(count, count)).tocsc(), forces)
    return filled


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _change(before: FloatArray, after: FloatArray) -> str:
    return f"rms height from {before.std():.4g} to {after.std():.4g}"


def _lengths(lengths: tuple[float, ...]) -> str:
    return " x ".join(f"{length:.6g}" for length in lengths)
