"""The steps that make a measured surface periodic and complete, and heights of a punch given in Python.

A measurement neither joins up with itself at the edges nor is it free of holes. The steps that the user asks
for are taken in this order, and each describes its change:

fill        points without a height, NaN, take those of a membrane spanned between their neighbours
detrend     the plane, or the paraboloid, of least squares is subtracted
taper       deviations from the mean height fade out towards the edges (Tukey's window; 1 is Hann's)
resample    to the points of the grid, by the Fourier series

Each returns the heights and a note, which is empty where nothing changed. The files: `punch/scan_files.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.arrays import BoolArray, FloatArray, unmasked
from gfmdlayer.files.tables import LARGEST, TableError, read_table
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.scan import Keys, Measured, Scan, ScanAxis, on_grid, refuse_heights, times, without_holes
from gfmdlayer.punch.scan_files import read_scan
from gfmdlayer.validation.problems import ConfigError

_SEAM = 3.0  # a step across the seam beyond so many times the usual one is no part of the surface


def read_profile(
    file: Path, grid: Grid, keys: Keys, length: str | None, *, outward: bool = False
) -> Measured:
    """Read one height for each grid point, above the first touch; TableError unless they fit the grid."""
    # The file is .npy of the grid's shape, or text with a row, x and height, for each point of a line, spaced
    # by L/n. The lowest height touches first, or the highest where heights are counted outward.
    if file.suffix == ".npy":
        found = on_grid(read_scan(file, len(grid.points), keys, grid), keys, grid, length)
    else:
        found = _read_line(file, grid, keys, length)
    heights = fitting(file, found.heights, grid.shape) * (-1.0 if outward else 1.0)
    return found._replace(heights=np.asarray(heights - grid.ranks.minimum(float(heights.min()))))


def _read_line(file: Path, grid: Grid, keys: Keys, length: str | None) -> Measured:
    if len(grid.shape) != 1:
        raise TableError(
            f"{file}: two columns describe a line; a surface in two dimensions needs an array (.npy)"
        )
    table = read_table(file, ("x", "height"), keys.answers)
    x = table.take("x", length)
    heights, _ = without_holes(Scan(file, table.take("height", length), None, (ScanAxis(),)), keys)
    spacing = grid.period[0] / grid.points[0]
    if x.size == grid.size and not np.allclose(np.diff(x), spacing, rtol=1e-6, atol=0):
        row = int(np.argmax(np.abs(np.diff(x) - spacing))) + 1
        raise TableError(
            f"{file}: x is not spaced by period/points = {spacing:.6g} (worst at data row {row + 1}); "
            "shape: topography interpolates"
        )
    return Measured(np.ascontiguousarray(heights), table.account)


def fitting(source: Path | str, heights: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return heights that are finite numbers of the grid's shape, or raise a TableError with their source."""
    if heights.shape != shape:
        raise TableError(
            f"{source}: holds {times(heights.shape)} heights; must be {times(shape)}, as the grid"
        )
    refuse_heights(source, heights, ~(np.abs(heights) <= LARGEST))
    return heights


def filled(file: Path, heights: FloatArray, method: str) -> tuple[FloatArray, str]:
    """Fill points without a height, NaN, by the method `none` or `membrane`; TableError if that cannot be."""
    holes = np.isnan(heights)
    if not holes.any():
        return heights, ""
    count = f"{holes.sum()} of {holes.size} points have no height"
    if holes.all():
        raise TableError(f"{file}: {count}")
    if method == "none":
        first = np.argwhere(holes)[0].tolist()
        raise TableError(f"{file}: {count}, the first at index {first}; must be none, or fill: membrane")
    return membrane(heights, holes), f"{count}; a membrane between their neighbours fills them in"


def detrended(heights: FloatArray, trend: str, grid: Grid) -> tuple[FloatArray, str]:
    """Subtract the trend of least squares: `none`, `plane` or `paraboloid`."""
    if trend == "none":
        return heights, ""
    rest = without_trend(heights, grid, curved=trend == "paraboloid")
    return rest, f"the {trend} of least squares was subtracted; {_change(heights, rest)}"


def tapered(heights: FloatArray, part: float, grid: Grid) -> tuple[FloatArray, str]:
    """Fade the deviations from the mean out over a part of the cell along each axis."""
    if part == 0:
        return heights, ""
    from scipy.signal.windows import tukey

    by_axis = grid.own_rows([tukey(n, part, sym=False) for n in grid.points])
    windows = np.meshgrid(*by_axis, indexing="ij", sparse=True)
    faded = heights - grid.ranks.mean(heights)
    for window in windows:
        faded = faded * window
    return faded, f"heights fade out over {part:g} of the cell; {_change(heights, faded)}"


def seam(heights: FloatArray, axis: int, is_tapered: bool) -> str:
    """Describe the step from the last row of an axis to the first, where it is unusually large."""
    usual = _rms(np.diff(heights, axis=axis))
    step = _rms(np.take(heights, 0, axis) - np.take(heights, -1, axis))
    if step <= _SEAM * usual:
        return ""
    times_usual = f"{step / usual:.3g} times the usual one" if usual > 0 else "the only one"
    advice = "" if is_tapered else "; taper makes it join up"
    where = f"does not join up with itself along {'xy'[axis]}"
    return f"{where}: the step across the seam is {times_usual}{advice}"


def resampled(file: Path, heights: FloatArray, shape: tuple[int, ...], method: str) -> tuple[FloatArray, str]:
    """Resample to the shape of the grid, by the method `none` or `fourier`; TableError if that cannot be."""
    if heights.shape == shape:
        return heights, ""
    if method == "none":
        swapped = " or transpose: true" if heights.shape[::-1] == shape else ""
        raise TableError(
            f"{file}: holds {times(heights.shape)} heights; must be {times(shape)}, as the grid, or "
            f"resample: fourier{swapped}"
        )
    from scipy.signal import resample

    fine = heights
    for axis, n in enumerate(shape):
        fine = resample(fine, n, axis=axis)
    done = f"resampled from {times(heights.shape)} to {times(shape)} points by the Fourier series"
    return fine, f"{done}; {_change(heights, fine)}"


def without_trend(heights: FloatArray, grid: Grid, *, curved: bool) -> FloatArray:
    """Subtract the mean and the plane, or the paraboloid, of least squares."""
    # On a whole grid the mean, the slopes, the squares without their means and the product of centred
    # coordinates are orthogonal, so each is taken off by itself.
    by_axis = grid.own_rows([np.arange(n, dtype=np.float64) - (n - 1) / 2 for n in grid.points])
    axes = np.meshgrid(*by_axis, indexing="ij", sparse=True)
    shapes = list(axes)

    def average(values: FloatArray) -> float:
        """Mean over the surface; of values along the last axis alone every rank has all."""
        return float(np.mean(values)) if values.shape[0] == 1 else grid.ranks.mean(values)

    if curved:
        shapes += [x**2 - average(x**2) for x in axes] + [axes[0] * y for y in axes[1:]]
    rest = heights - grid.ranks.mean(heights)
    for shape in shapes:
        rest -= shape * (grid.ranks.mean(rest * shape) / average(shape**2))
    return np.asarray(rest)


def membrane(heights: FloatArray, holes: BoolArray) -> FloatArray:
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


# Heights of a punch given in Python, as an array or a function of the coordinates.
#
# They are counted outward from the punch, as those of a measured surface: the largest touches first, and a
# round punch is -x^2/(2 R). Only their differences count.


def outward_heights(punch: ArrayLike | Callable[..., ArrayLike], grid: Grid) -> FloatArray:
    """Return heights at the points of a grid, outward from the punch; ConfigError unless they fit it."""
    # `punch` has the heights, or is a function of x, or of x and y, which takes and returns arrays of the
    # grid's shape.
    if callable(punch):
        heights = numbers(punch(*np.meshgrid(*grid.coordinates, indexing="ij")))
        heights = np.broadcast_to(heights, grid.shape) if heights.ndim == 0 else heights  # flat
    else:
        heights = numbers(punch)
    try:
        return fitting("punch", heights, grid.shape)
    except TableError as error:
        raise ConfigError([str(error)]) from None


def numbers(heights: ArrayLike) -> FloatArray:
    """Return heights as an array of numbers; ConfigError if they are not real numbers."""
    try:
        values = unmasked(heights)
    except ValueError as error:  # rows of different lengths
        raise ConfigError([f"punch: {error}; must be an array of real numbers"]) from None
    if values.dtype.kind not in "fiu":
        raise ConfigError([f"punch: got an array of type {values.dtype}; must be real numbers"])
    return values.astype(np.float64)
