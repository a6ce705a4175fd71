"""Heights from files and arrays, and the steps that make a measured surface periodic and complete.

Files are NumPy arrays, text, HDF5 and netCDF, and the formats of SurfaceTopography. The first axis of an
array is x, the second y. In text each line is one value of x. Points that were not measured are NaN.

A measurement neither joins up with itself at the edges nor is it free of holes. The steps that the user asks
for are taken in this order, and each describes its change:

fill        points that were not measured take the heights of a membrane spanned between their neighbours
detrend     the plane, or the paraboloid, of least squares is subtracted
taper       deviations from the mean height fade out towards the edges (Tukey's window; 1 is Hann's)
resample    to the points of the grid, by the Fourier series

Each returns the heights and a note, which is empty where nothing changed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.files.tables import LARGEST, TableError, open_group, read_columns
from gfmdlayer.files.tables import read_matrix_plain as read_matrix
from gfmdlayer.grid.grid import Grid
from gfmdlayer.validation.problems import ConfigError

_SEAM = 3.0  # a step across the seam beyond so many times the usual one is no part of the surface


class Heights(NamedTuple):
    """Heights, and the lengths of the cell that they fill along each axis if the file holds them.

    Where a process reads some rows, values has these only; shape counts all.
    """

    values: FloatArray
    lengths: tuple[float, ...] | None = None
    shape: tuple[int, ...] = ()


def read_heights(file: Path, axes: int, dataset: str | None = None, grid: Grid | None = None) -> Heights:
    """Read heights on so many axes by the ending of a file's name; TableError if there are none."""
    # `dataset` is the name in an HDF5 or netCDF file with several, behind those of its groups and /. Where
    # several processes hold the grid, the rows of this one are read.
    rows = slice(None)
    if grid is not None and not grid.is_whole:
        rows = slice(grid.first_row, grid.first_row + grid.shape[0])
    reader = _READERS.get(file.suffix.lower(), _by_surface_topography)
    if dataset is not None and reader is not _labelled:
        raise TableError(f"{file}: is no HDF5 or netCDF file; dataset must be left out")
    heights = reader(file, axes, dataset, rows)
    shape = heights.shape or heights.values.shape
    if grid is not None and not grid.is_whole and shape != grid.points:
        raise TableError(f"{file}: holds {times(shape)} heights; must be {times(grid.points)}, as the grid")
    if len(shape) != axes:
        wanted = "one axis" if axes == 1 else "two axes"
        raise TableError(f"{file}: holds {times(shape)} heights; must have {wanted}, as the grid")
    if min(shape) < 2:
        row = "a single height" if max(shape) < 2 else f"a single row of {max(shape)} heights"
        raise TableError(f"{file}: holds {row}; must be at least two along each axis")
    _refuse(file, heights.values, np.abs(heights.values) > LARGEST)
    return heights


def read_profile(file: Path, grid: Grid, *, outward: bool = False) -> FloatArray:
    """Read one height for each grid point, above the first touch; TableError unless they fit the grid."""
    # The file is .npy of the grid's shape, or text with a row, x and height, for each point of a line, spaced
    # by L/n. The lowest height touches first, or the highest where heights are counted outward.
    if grid.is_whole:
        npy = file.suffix == ".npy"
        heights = _array(file, 0, None, slice(None)).values if npy else _read_line(file, grid)
    else:
        heights = read_heights(file, len(grid.points), None, grid).values
    heights = fitting(file, heights, grid.shape) * (-1.0 if outward else 1.0)
    return np.asarray(heights - grid.ranks.minimum(float(heights.min())))


def fitting(source: Path | str, heights: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return heights that are finite numbers of the grid's shape, or raise a TableError with their source."""
    if heights.shape != shape:
        raise TableError(
            f"{source}: holds {times(heights.shape)} heights; must be {times(shape)}, as the grid"
        )
    _refuse(source, heights, ~(np.abs(heights) <= LARGEST))
    return heights


def _refuse(file: Path | str, heights: FloatArray, bad: BoolArray) -> None:
    """Raise TableError at the first bad height, if there is one."""
    if bad.any():
        where, first = np.argwhere(bad)[0].tolist(), heights[bad][0]
        size = "not a finite number" if np.isnan(first) else "infinite" if np.isinf(first) else "too large"
        allowed = f"; must be up to {LARGEST:g}" * bool(np.isfinite(first))
        raise TableError(f"{file}: the height at index {where} is {size}{allowed}")


def times(shape: tuple[int, ...]) -> str:
    """Write a shape for people: 512 x 512."""
    return " x ".join(map(str, shape)) or "no"


def _array(file: Path, _axes: int, _dataset: str | None, rows: slice) -> Heights:
    mapped: Literal["r"] | None = None if rows == slice(None) else "r"
    try:
        if mapped is None:
            with file.open("rb") as stream:
                array = np.load(stream, allow_pickle=False)
        else:
            array = np.load(file, mapped, allow_pickle=False)
    except (ValueError, OSError, EOFError, OverflowError) as error:
        raise TableError(f"{file}: is not a NumPy array file ({error})") from error
    except MemoryError as error:
        raise TableError(f"{file}: its header names more numbers than memory holds ({error})") from error
    if not (isinstance(array, np.ndarray) and array.dtype.kind in "fiu"):
        raise TableError(f"{file}: must hold one array of real numbers")
    values = array[rows] if array.ndim else array
    return Heights(values.astype(np.float64), None, array.shape)


def _text(file: Path, axes: int, _dataset: str | None, _rows: slice) -> Heights:
    matrix = read_matrix(file)
    if axes == 2:
        return Heights(matrix)
    if matrix.shape[1] != 2:
        raise TableError(f"{file}: holds {matrix.shape[1]} columns; must be two, x and height, on a line")
    x, heights = matrix.T
    return Heights(np.ascontiguousarray(heights), (_length(file, "x", x),))


def _read_line(file: Path, grid: Grid) -> FloatArray:
    if len(grid.shape) != 1:
        raise TableError(
            f"{file}: two columns describe a line; a surface in two dimensions needs an array (.npy)"
        )
    x, heights = read_columns(file, ("x", "height")).T
    spacing = grid.period[0] / grid.points[0]
    if x.size == grid.size and not np.allclose(np.diff(x), spacing, rtol=1e-6, atol=0):
        row = int(np.argmax(np.abs(np.diff(x) - spacing))) + 1
        raise TableError(
            f"{file}: x is not spaced by period/points = {spacing:.6g} (worst at data row {row + 1})"
        )
    return np.ascontiguousarray(heights)


def _labelled(file: Path, axes: int, dataset: str | None, rows: slice) -> Heights:
    import h5py
    import xarray

    group, _, name = (dataset or "").strip("/").rpartition("/")
    hdf5 = bool(h5py.is_hdf5(file))
    options: dict[str, Any] = {"engine": "h5netcdf", "phony_dims": "sort"} if hdf5 else {"engine": "scipy"}
    try:
        if hdf5:
            with h5py.File(file, locking=False) as h5:
                open_group(file, h5, group)
            options["driver_kwds"] = {"locking": False}
        with xarray.open_dataset(file, group=group or None, decode_times=False, **options) as opened:
            chosen = _chosen(file, opened, axes, name)
            if set(chosen.dims) == {"x", "y"}:
                chosen = chosen.transpose("x", "y")
            values = chosen[rows].to_numpy().astype(np.float64)
            coordinates = {str(dim): opened[dim].to_numpy() for dim in chosen.dims if dim in opened.coords}
    except TableError:
        raise
    except Exception as error:  # a damaged file can fail anywhere in its libraries, with any exception
        raise TableError(f"{file}: cannot be read as HDF5 or netCDF ({error})") from error
    if len(coordinates) < values.ndim:
        return Heights(values, None, chosen.shape)
    lengths = tuple(_length(file, name, x) for name, x in coordinates.items())
    return Heights(values, lengths, chosen.shape)


def _chosen(file: Path, data: Any, axes: int, name: str) -> Any:
    """Return the variable of an xarray.Dataset by name, or the only one of numbers on these axes."""
    if name:
        if name not in data:
            known = ", ".join(map(str, data.data_vars)) or "none"
            raise TableError(f"{file}: has no dataset {name!r} there; known: {known}")
        return data[name]
    fit = [
        key
        for key, variable in data.data_vars.items()
        if variable.ndim == axes and variable.dtype.kind in "fiu"
    ]
    if len(fit) != 1:
        listed = f": {', '.join(map(str, fit))}" if fit else ""
        raise TableError(
            f"{file}: holds {len(fit)} datasets of numbers on {axes} axes{listed}; dataset must name one"
        )
    return data[fit[0]]


def _by_surface_topography(file: Path, _axes: int, _dataset: str | None, _rows: slice) -> Heights:
    try:
        from SurfaceTopography import open_topography
    except ImportError:
        known = ", ".join(sorted(_READERS))
        raise TableError(
            f"{file}: must be one of {known}; for the formats of instruments install the extra `topography`"
        ) from None
    try:
        with open_topography(str(file)) as reader:
            topography = reader.topography()
            values = np.ma.filled(np.ma.asarray(topography.heights(), dtype=np.float64), np.nan)
            return Heights(values, tuple(map(float, topography.physical_sizes)))
    except Exception as error:  # its readers raise exceptions of any kind
        raise TableError(f"{file}: SurfaceTopography cannot read it ({error})") from error


def _length(file: Path, name: str, x: FloatArray) -> float:
    """Length of the cell that equally spaced coordinates fill."""
    steps = np.diff(x)
    spacing = float(x[-1] - x[0]) / max(x.size - 1, 1)
    if not (spacing > 0 and np.allclose(steps, spacing, rtol=1e-3, atol=0)):
        raise TableError(f"{file}: {name} is not equally spaced, increasing")
    return spacing * x.size


IN_PARTS = (".npy", ".h5", ".hdf5", ".nc")  # endings of files of which a process may read some rows

_READERS: dict[str, Callable[[Path, int, str | None, slice], Heights]] = {
    ".npy": _array,
    ".txt": _text,
    ".dat": _text,
    ".csv": _text,
    ".h5": _labelled,
    ".hdf5": _labelled,
    ".nc": _labelled,
}


def check_lengths(
    file: Path, lengths: tuple[float, ...] | None, unit: float, period: tuple[float, ...]
) -> None:
    """Raise a TableError if the measured cell and the period differ by more than a thousandth."""
    own = tuple(unit * length for length in lengths or ())
    if own and not np.allclose(own, period, rtol=1e-3, atol=0):
        raise TableError(
            f"{file}: is {_lengths(own)} long (with unit = {unit:g}), but grid.period is "
            f"{_lengths(period)}; must agree within a thousandth"
        )


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
        raise TableError(
            f"{file}: holds {times(heights.shape)} heights; must be {times(shape)}, as the grid, or "
            "resample: fourier"
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


def _lengths(lengths: tuple[float, ...]) -> str:
    return " x ".join(f"{length:.6g}" for length in lengths)


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
        values = np.asarray(heights)
    except ValueError as error:  # rows of different lengths
        raise ConfigError([f"punch: {error}; must be an array of real numbers"]) from None
    if values.dtype.kind not in "fiu":
        raise ConfigError([f"punch: got an array of type {values.dtype}; must be real numbers"])
    return values.astype(np.float64)
