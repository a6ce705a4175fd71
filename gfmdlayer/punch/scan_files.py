"""Files of measured surfaces: NumPy arrays, HDF5 and netCDF, text, and the formats of instruments.

The content decides on the reader, not the ending of the name. Arrays and text are read here and in
`punch/scan_text.py`, with or without SurfaceTopography, so that a file means the same on every machine.
SurfaceTopography reads the formats of instruments. Arrays have x along their first axis.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gfmdlayer.files.hdf5 import READING, is_hdf5, open_group, open_hdf5
from gfmdlayer.files.tables import Answers, TableError, is_text
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.scan import Keys, Length, Scan, ScanAxis, axis_of, length_unit, lengths_in_words, times
from gfmdlayer.punch.scan_text import read_text

_NO_KEYS = Keys()


def read_scan(file: Path, axes: int, keys: Keys = _NO_KEYS, grid: Grid | None = None) -> Scan:
    """Read a file of heights on so many axes; TableError if there are none, or more than one reading."""
    # Where several processes hold the grid, the rows of this one are read.
    rows = slice(None)
    if grid is not None and not grid.is_whole:
        rows = slice(grid.first_row, grid.first_row + grid.shape[0])
    scan = _reader_of(file)(file, axes, keys, rows)
    if keys.transpose and axes == 2 and len(scan.shape) == 2:
        scan = scan.transposed()
    _check_shape(scan, axes, grid)
    return scan


def _check_shape(scan: Scan, axes: int, grid: Grid | None) -> None:
    shape, file = scan.shape, scan.file
    if grid is not None and not grid.is_whole and shape != grid.points:
        raise TableError(f"{file}: holds {times(shape)} heights; must be {times(grid.points)}, as the grid")
    if len(shape) != axes:
        wanted = "one axis" if axes == 1 else "two axes"
        raise TableError(f"{file}: holds {times(shape)} heights; must have {wanted}, as the grid")
    if min(shape) < 2:
        row = "a single height" if max(shape) < 2 else f"a single row of {max(shape)} heights"
        raise TableError(f"{file}: holds {row}; must be at least two along each axis")


Reader = Callable[[Path, int, Keys, slice], Scan]


IN_PARTS = (".npy", ".h5", ".hdf5", ".nc")  # endings of files of which a process may read some rows


def _reader_of(file: Path) -> Reader:
    """Return the reader for the first bytes of a file; headers of instruments may be long and in text."""
    try:
        with file.open("rb") as stream:
            head = stream.read(1 << 18)
    except OSError as error:
        raise TableError(f"{file}: cannot be read ({error.strerror or error})") from error
    ending = file.suffix.lower()
    if head.startswith(b"\x93NUMPY") or ending == ".npy":
        return _array
    text = is_text(head)
    if head.startswith((b"\x89HDF", b"CDF")) or (ending in {".h5", ".hdf5", ".nc"} and not text):
        return _labelled
    return _text if text and not head.startswith(_INSTRUMENTS) else _instrument


_INSTRUMENTS = (b"aISO-1.", b"aBCR-1.", b"Wyko ASCII")  # in text, but with scales that a table does not have


# NumPy arrays, HDF5 and netCDF.


def _array(file: Path, _axes: int, keys: Keys, rows: slice) -> Scan:
    _refuse_keys(file, keys, dataset="HDF5, netCDF or instrument's file", reading="text")
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
    layout = "first axis x, second y" if array.ndim == 2 else ""
    return Scan(file, values.astype(np.float64), None, (ScanAxis(),) * array.ndim, layout, shape=array.shape)


def _refuse_keys(file: Path, keys: Keys, **kinds: str) -> None:
    """Refuse keys that are for files of other kinds."""
    for key, kind in kinds.items():
        if (keys.dataset is not None) if key == "dataset" else keys.answers != Answers():
            raise TableError(f"{file}: is no {kind}; {key} must be left out")


def _labelled(file: Path, axes: int, keys: Keys, rows: slice) -> Scan:
    _refuse_keys(file, keys, reading="text")
    try:
        return _own_labelled(file, axes, keys, rows)
    except TableError as error:  # a format in HDF5 or netCDF that has an order of its own
        scan = _by_surface_topography(file, keys)
        if isinstance(scan, Scan):
            return scan
        if "cannot read it" in scan:
            raise TableError(f"{error}; {scan}") from None
        raise error from None


def _text(file: Path, axes: int, keys: Keys, _rows: slice) -> Scan:
    _refuse_keys(file, keys, dataset="HDF5, netCDF or instrument's file")
    return read_text(file, axes, keys.answers)


def _own_labelled(file: Path, axes: int, keys: Keys, rows: slice) -> Scan:
    import xarray

    group, _, name = (keys.dataset or "").strip("/").rpartition("/")
    hdf5 = is_hdf5(file)
    options: dict[str, Any] = {"engine": "h5netcdf", "phony_dims": "sort"} if hdf5 else {"engine": "scipy"}
    try:
        if hdf5:
            with open_hdf5(file) as h5:
                open_group(file, h5, group)
            options["driver_kwds"] = READING
        with xarray.open_dataset(file, group=group or None, decode_times=False, **options) as opened:
            chosen = _chosen(file, opened, axes, name)
            layout = "first axis x, second y" if chosen.ndim == 2 else ""
            by_name = {str(dim).lower(): dim for dim in chosen.dims}
            if set(by_name) == {"x", "y"}:
                chosen, layout = chosen.transpose(by_name["x"], by_name["y"]), "dimensions x and y"
            found = [_coordinate(file, opened, str(dim)) for dim in chosen.dims]
            backwards = {
                dim: slice(None, None, -1) for dim, (_, down) in zip(chosen.dims, found, strict=True) if down
            }
            values = chosen.isel(backwards)[rows].to_numpy().astype(np.float64)
            unit = _unit_of_attributes(file, str(chosen.name), chosen.attrs, known=keys.unit is not None)
    except TableError:
        raise
    except Exception as error:  # a damaged file can fail anywhere in its libraries, with any exception
        raise TableError(f"{file}: cannot be read as HDF5 or netCDF ({error})") from error
    dims, doubt = tuple(axis for axis, _ in found), ""
    if any(axis.length is None and axis.positions is None for axis in dims):
        if any(axis.length is not None or axis.positions is not None for axis in dims):
            doubt = "the file, which has a coordinate in one direction only,"
        dims = tuple(replace(axis, length=None) for axis in dims)
    uneven = [str(dim) for dim, axis in zip(chosen.dims, dims, strict=True) if axis.positions is not None]
    if uneven and len(dims) > 1:
        raise TableError(f"{file}: {uneven[0]} is not equally spaced")
    return Scan(file, values, unit, dims, layout, doubt=doubt, shape=chosen.shape)


def _coordinate(file: Path, opened: Any, dim: str) -> tuple[ScanAxis, bool]:
    """Return what a file says of a dimension, and whether its coordinate decreases."""
    if dim not in opened.variables:
        return ScanAxis(), False
    variable = opened[dim]
    unit = _unit_of_attributes(file, dim, variable.attrs, known=False)
    if "length" in variable.attrs:  # SurfaceTopography's netCDF
        return ScanAxis(float(variable.attrs["length"]), unit), False
    if dim not in opened.coords:
        return ScanAxis(), False
    x = variable.to_numpy().astype(np.float64)
    down = bool(x.size > 1 and x[-1] < x[0])
    return axis_of(file, dim, x[::-1] if down else x, unit), down


def _unit_of_attributes(file: Path, name: str, attributes: Any, *, known: bool) -> Length | None:
    """Return the unit of length that attributes of a variable say; TableError for another one."""
    text = str(attributes.get("units", attributes.get("unit", ""))).strip()
    if text in {"", "1", "-"}:
        return None
    unit = length_unit(text)
    if unit is None and not known:
        raise TableError(f"{file}: {name} is in {text!r}, which is no known unit of length")
    return unit


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


# SurfaceTopography, for the formats of instruments.

# Its readers of tables take unequal x for equal, and drop units and decimals; of HDF5 they take any array.
_NOT_BELIEVED = frozenset({"asc", "xyz", "matrix", "h5", "npy"})
_WITHOUT_MARK = frozenset({"nms", "hgt"})  # formats that a file of any kind may seem to have


def _instrument(file: Path, _axes: int, keys: Keys, _rows: slice) -> Scan:
    _refuse_keys(file, keys, reading="text")
    scan = _by_surface_topography(file, keys)
    if isinstance(scan, Scan):
        return scan
    with file.open("rb") as opened:
        packed = opened.read(2) == b"\x1f\x8b"
    raise TableError(f"{file}: {'is packed; must be unpacked' if packed else scan}")


def _by_surface_topography(file: Path, keys: Keys) -> Scan | str:
    """Return what SurfaceTopography reads in a format of its own, or the reason why it does not."""
    try:
        from SurfaceTopography import open_topography
        from SurfaceTopography.Exceptions import CannotDetectFileFormat
    except ImportError:
        return (
            "is no NumPy array, HDF5, netCDF or plain text; for the formats of instruments install the extra "
            "`topography`"
        )
    try:
        with warnings.catch_warnings(action="ignore"), open_topography(str(file)) as reader:
            kind, wyko = reader.format(), "wyko" in str(getattr(reader, "_metadata", ""))
            named = file.suffix.lower() == f".{kind}"
            if (kind in _NOT_BELIEVED and not wyko) or (kind in _WITHOUT_MARK and not named):
                return f"SurfaceTopography takes it for {kind}, which it does not read with certainty"
            return _checked(file, reader, keys)
    except TableError:
        raise
    except CannotDetectFileFormat:
        return "SurfaceTopography does not know its format"
    except Exception as error:  # its readers raise exceptions of any kind
        return f"SurfaceTopography cannot read it ({' '.join(str(error).split())[:300]})"


def _checked(file: Path, reader: Any, keys: Keys) -> Scan:
    """Read the channel `dataset`, by default that of the format, and check it."""
    names = [str(channel.name) for channel in reader.channels]
    if keys.dataset is not None and names.count(keys.dataset) != 1:
        raise TableError(f"{file}: has no dataset {keys.dataset!r}, or several; known: {', '.join(names)}")
    index = (
        reader.channels.index(reader.default_channel) if keys.dataset is None else names.index(keys.dataset)
    )
    channel = reader.channels[index]
    others = f" of {', '.join(names)} (dataset chooses)" if len(names) > 1 else ""
    notes = f"{reader.format()}, read by SurfaceTopography", f"channel {names[index]!r}{others}"
    sized = channel.physical_sizes is not None
    given = {} if sized else {"physical_sizes": (1.0,) * channel.dim}
    topography = reader.topography(channel_index=index, **given)
    symbol = "Å" if topography.unit == "A" else topography.unit or ""
    unit = length_unit(symbol)
    if symbol and unit is None:
        raise TableError(f"{file}: channel {names[index]!r} is in {symbol!r}; must be a length")
    heights = np.ma.filled(np.ma.asarray(topography.heights(), dtype=np.float64), np.nan)
    if heights.ndim == 1 and not topography.is_uniform:
        x = np.asarray(topography.positions(), dtype=np.float64)
        order = np.argsort(x, kind="stable")
        return Scan(file, heights[order], unit, (axis_of(file, "x", x[order], unit),), "", notes)
    sizes = tuple(map(float, topography.physical_sizes))
    if not all(0 < size < np.inf for size in sizes):
        raise TableError(f"{file}: SurfaceTopography says a size of {lengths_in_words(sizes)}; must be > 0")
    return Scan(
        file, heights, unit, tuple(ScanAxis(size if sized else None, unit) for size in sizes), "", notes
    )
