"""Heights from files: NumPy arrays, text, HDF5 and netCDF, and the formats of SurfaceTopography.

The first axis of an array is x, the second y. In text each line is one value of x. Points that were not
measured are NaN.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.files.tables import LARGEST, TableError, open_group, read_columns, read_matrix
from gfmdlayer.grid.grid import Grid


class Heights(NamedTuple):
    """Heights, perhaps of some rows; lengths of their cell, where known; the shape of all rows."""

    values: FloatArray
    lengths: tuple[float, ...] | None = None
    shape: tuple[int, ...] = ()


def read_heights(file: Path, axes: int, dataset: str | None = None, grid: Grid | None = None) -> Heights:
    """Read heights, a process its own rows, by the ending of a file's name; TableError if there are none."""
    rows = slice(None)
    if grid is not None and not grid.is_whole:
        rows = slice(grid.first_row, grid.first_row + grid.shape[0])
    reader = _READERS.get(file.suffix.lower(), _by_surface_topography)
    if dataset is not None and reader is not _labelled:
        raise TableError(f"{file}: is no HDF5 or netCDF file; dataset must be left out")
    found = reader(file, axes, dataset, rows)
    shape = found.shape or found.values.shape
    if grid is not None and not grid.is_whole and shape != grid.points:
        raise TableError(f"{file}: holds {times(shape)} heights; must be {times(grid.points)}, as the grid")
    if len(shape) != axes:
        wanted = "one axis" if axes == 1 else "two axes"
        raise TableError(f"{file}: holds {times(shape)} heights; must have {wanted}, as the grid")
    if min(shape) < 2:
        row = "a single height" if max(shape) < 2 else f"a single row of {max(shape)} heights"
        raise TableError(f"{file}: holds {row}; must be at least two along each axis")
    _refuse(file, found.values, np.abs(found.values) > LARGEST)
    return found


def read_profile(file: Path, grid: Grid, *, outward: bool = False) -> FloatArray:
    """Read a height for each grid point, above the first touch; TableError unless they fit."""
    if grid.is_whole:
        found = load_array(file) if file.suffix == ".npy" else _read_line(file, grid)
    else:
        found = read_heights(file, len(grid.points), None, grid).values
    found = fitting(file, found, grid.shape) * (-1.0 if outward else 1.0)
    return np.asarray(found - grid.ranks.minimum(float(found.min())))


def fitting(source: Path | str, heights: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return heights that are finite numbers of the grid's shape, or raise a TableError with their source."""
    if heights.shape != shape:
        raise TableError(
            f"{source}: holds {times(heights.shape)} heights; must be {times(shape)}, as the grid"
        )
    _refuse(source, heights, ~(np.abs(heights) <= LARGEST))
    return heights


def load_array(file: Path) -> FloatArray:
    """Read one array of real numbers from a .npy file; TableError if there is none."""
    return _array(file, 0, None, slice(None)).values


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
                found = np.load(stream, allow_pickle=False)
        else:
            found = np.load(file, mapped, allow_pickle=False)
    except (ValueError, OSError, EOFError, OverflowError) as error:
        raise TableError(f"{file}: is not a NumPy array file ({error})") from error
    except MemoryError as error:
        raise TableError(f"{file}: its header names more numbers than memory holds ({error})") from error
    if not (isinstance(found, np.ndarray) and found.dtype.kind in "fiu"):
        raise TableError(f"{file}: must hold one array of real numbers")
    values = found[rows] if found.ndim else found
    return Heights(values.astype(np.float64), None, found.shape)


def _text(file: Path, axes: int, _dataset: str | None, _rows: slice) -> Heights:
    found = read_matrix(file)
    if axes == 2:
        return Heights(found)
    if found.shape[1] != 2:
        raise TableError(f"{file}: holds {found.shape[1]} columns; must be two, x and height, on a line")
    x, heights = found.T
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
        with xarray.open_dataset(file, group=group or None, decode_times=False, **options) as found:
            chosen = _chosen(file, found, axes, name)
            if set(chosen.dims) == {"x", "y"}:
                chosen = chosen.transpose("x", "y")
            values = chosen[rows].to_numpy().astype(np.float64)
            coordinates = {str(dim): found[dim].to_numpy() for dim in chosen.dims if dim in found.coords}
    except TableError:
        raise
    except Exception as error:  # a damaged file can fail anywhere in its libraries, with any exception
        raise TableError(f"{file}: cannot be read as HDF5 or netCDF ({error})") from error
    if len(coordinates) < values.ndim:
        return Heights(values, None, chosen.shape)
    lengths = tuple(_length(file, name, x) for name, x in coordinates.items())
    return Heights(values, lengths, chosen.shape)


def _chosen(file: Path, found: Any, axes: int, name: str) -> Any:
    """Return the variable of an xarray.Dataset by name, or the only one of numbers on these axes."""
    if name:
        if name not in found:
            known = ", ".join(map(str, found.data_vars)) or "none"
            raise TableError(f"{file}: has no dataset {name!r} there; known: {known}")
        return found[name]
    fit = [key for key, each in found.data_vars.items() if each.ndim == axes and each.dtype.kind in "fiu"]
    if len(fit) != 1:
        listed = f": {', '.join(map(str, fit))}" if fit else ""
        raise TableError(
            f"{file}: holds {len(fit)} datasets of numbers on {axes} axes{listed}; dataset must name one"
        )
    return found[fit[0]]


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
            found = reader.topography()
            values = np.ma.filled(np.ma.asarray(found.heights(), dtype=np.float64), np.nan)
            return Heights(values, tuple(map(float, found.physical_sizes)))
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
