"""Files of measured surfaces: what they say of heights, lengths, units and holes, and what that is on a grid.

Files are NumPy arrays, HDF5 and netCDF, text, and the formats of SurfaceTopography; the content decides which,
not the ending of the name. Arrays have x along their first axis. In text the rows are y, the columns x, as
instruments and their programs write them; or there are columns x, y and height, or x and height of a line.

A `Scan` is what a file says. `Scan.on` makes it heights in the unit of length of a configuration. Lengths and
units come from the file, or from the keys of the punch, which `Keys` has; keys go first. What neither says, or
what does not fit the cell, is refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.files.headings import is_known, meaning
from gfmdlayer.files.tables import LARGEST, Matrix, TableError, open_group, read_matrix
from gfmdlayer.files.units import unit_of
from gfmdlayer.grid.grid import Grid

_ROUNDING = 1e-3  # relative; sizes in headers have some three digits
_WIDEST = (
    4.0  # spacings of the grid between neighbours of a line, over which it is interpolated without asking
)
_LENGTH = (0, 1, 0, 0, 0, 0)


class Length(NamedTuple):
    """A unit of length."""

    size: float  # in m
    symbol: str  # as written in the file

    def __str__(self) -> str:
        return self.symbol


def length_unit(text: str) -> Length | None:
    """Return the unit of length that a text names; None if it names none."""
    unit = unit_of(text)
    if unit is None or unit.dimension != _LENGTH:
        return None
    return Length(float(unit.size), text.strip())


class Keys(NamedTuple):
    """Keys of the punch that settle what a file does not say, or says wrongly."""

    unit: float | str | None = (
        None  # of heights, and of lengths without a unit: in the configuration's, or a name
    )
    size: tuple[float, ...] | None = None  # lengths of the cell, in the configuration's unit
    transpose: bool = False  # exchange x and y of the file
    decimal: str | None = None  # mark of text
    hole: float | str | None = None  # number that stands for a point without a height, or "none"
    dataset: str | None = None  # of several


@dataclass(frozen=True)
class Axis:
    """What a file says of a direction."""

    length: float | None = None  # of the cell, spacing times points, in `unit`
    unit: Length | None = None
    positions: FloatArray | None = None  # of the points of a line that are not equally spaced


@dataclass(frozen=True)
class Scan:
    """Heights as a file has them; x along the first axis."""

    file: Path
    heights: FloatArray  # NaN where none was measured; on several processes the rows of this one
    unit: Length | None  # of heights
    axes: tuple[Axis, ...]
    layout: str = ""  # what rows and columns are, in words
    notes: tuple[str, ...] = ()  # on the file, for its account
    doubt: str = ""  # a line of the header that may say a length or a unit, but is not understood
    shape: tuple[int, ...] = ()  # of all processes

    def __post_init__(self) -> None:
        if not self.shape:
            object.__setattr__(self, "shape", self.heights.shape)

    def transposed(self) -> Scan:
        """Return the scan with x and y exchanged."""
        swap = "x and y exchanged (transpose)"
        return replace(
            self, heights=self.heights.T, axes=self.axes[::-1], shape=self.shape[::-1],
            layout=f"{self.layout}; {swap}" if self.layout else swap,
        )  # fmt: skip


class Measured(NamedTuple):
    """Heights in the configuration's unit of length, and the account of their file in one line."""

    heights: FloatArray
    account: str


# What a scan is in the lengths of a configuration.


def on_grid(scan: Scan, keys: Keys, grid: Grid, length: str | None, *, gaps: bool = False) -> Measured:
    """Return the heights in the configuration's unit of length `length`, None for one without units.

    A line with unequal distances is interpolated onto the grid; `gaps` permits wide ones. TableError where the
    units or the size of the scan are not known, and where the size is not that of the cell.
    """
    values, holes = _without_holes(scan, keys)
    vertical, lateral = _factors(scan, keys, grid, length)
    unit = f" {length}" if length else ""
    size = keys.size and (keys.size * len(grid.points) if len(keys.size) == 1 else keys.size)
    own = tuple(
        None if axis.length is None else factor * axis.length
        for axis, factor in zip(scan.axes, lateral, strict=True)
    )
    heights = vertical * values
    said = [f"{times(scan.shape)} points", scan.layout, _units_said(scan, keys, length)]
    given = size or (None if None in own else own)
    if scan.axes[0].positions is None:
        if given is not None:
            _check_size(scan, keys, given, grid, unit)
            said.append(f"size {_lengths(given)}{unit}" + _beside(own, size, unit))
        else:
            said.append(f"no size in the file: it fills the cell, {_lengths(grid.period)}{unit}")
    else:
        if size:
            _check_size(scan, keys, size, grid, unit)
        position = lateral[0] * scan.axes[0].positions
        heights, words = _interpolated(scan, position, heights, grid, unit, gaps=gaps)
        said.append(words)
    said += scan.notes
    if holes or np.isnan(values).any():
        said.append(f"{int(np.isnan(values).sum())} holes" + holes)
    return Measured(heights, f"{scan.file.name}: " + "; ".join(filter(None, said)))


def times(shape: tuple[int, ...]) -> str:
    """Write a shape for people: 512 x 512."""
    return " x ".join(map(str, shape)) or "no"


def _lengths(lengths: Sequence[float | None]) -> str:
    return " x ".join(f"{length:.6g}" for length in lengths)


def _beside(own: tuple[float | None, ...], size: tuple[float, ...] | None, unit: str) -> str:
    """Say that a given size is not the file's."""
    if size is None or None in own or np.allclose(own, size, rtol=_ROUNDING, atol=0):
        return ""
    return f" (punch.size; the file says {_lengths(own)}{unit})"


def _units_said(scan: Scan, keys: Keys, length: str | None) -> str:
    """Say in which units the file is, and where the unit of heights comes from."""
    into = f" -> {length}" if length else ""
    lateral = next((axis.unit for axis in scan.axes if axis.unit), None)
    across = f", {'x and y' if len(scan.axes) > 1 else 'x'} [{lateral}]" if lateral and not keys.size else ""
    if keys.unit is None:
        return f"heights [{scan.unit}]{across}{into}" if scan.unit else f"no unit in the file{across}"
    given = f"{keys.unit:g}{f' {length}' if length else ''}" if isinstance(keys.unit, float) else keys.unit
    beside = f"; the file says {scan.unit}" if scan.unit and not _agrees(scan.unit, keys.unit, length) else ""
    return f"heights [{given}, punch.unit{beside}]{across}{into}"


def _agrees(unit: Length, given: float | str, length: str | None) -> bool:
    """Whether a given unit is the file's, as far as that is known."""
    if isinstance(given, str):
        other = length_unit(given)
        return other is not None and bool(np.isclose(other.size, unit.size, rtol=_ROUNDING))
    known = length_unit(length) if length else None
    return known is None or bool(np.isclose(given * known.size, unit.size, rtol=_ROUNDING))


def _factors(scan: Scan, keys: Keys, grid: Grid, length: str | None) -> tuple[float, tuple[float, ...]]:
    """Return the factors from heights, and from lengths along each axis, to the configuration's unit."""
    own = length_unit(length) if length else None
    needed = [
        axis
        for axis in scan.axes
        if axis.positions is not None or (axis.length is not None and not keys.size)
    ]
    _refuse_open(scan, keys, own, needed)
    if own is None:
        own = _own_unit(scan, keys, grid, needed)
    unit = length_unit(keys.unit) if isinstance(keys.unit, str) else scan.unit
    vertical = 1.0 if unit is None or own is None else _ratio(unit, own)
    if isinstance(keys.unit, float):
        vertical = keys.unit
    plain = 1.0 if keys.unit is None else vertical  # of lengths without a unit
    return vertical, tuple(
        plain if axis.unit is None or own is None else _ratio(axis.unit, own) for axis in scan.axes
    )


def _refuse_open(scan: Scan, keys: Keys, own: Length | None, needed: Sequence[Axis]) -> None:
    """Refuse what neither the file nor the keys say."""
    lateral = [axis.unit for axis in needed if axis.unit]
    said = next((axis.unit for axis in scan.axes if axis.unit), None)
    if isinstance(keys.unit, str) and own is None:
        raise TableError(
            f"{scan.file}: punch.unit is {keys.unit}, but the configuration has no units; {_ADD_UNITS}, or give "
            "unit as a number, its length in the configuration's"
        )
    if scan.unit is None and keys.unit is None and said:
        raise TableError(
            f"{scan.file}: says lengths in {said}, but no unit of heights; give punch.unit, {said} or another"
        )
    if 0 < len(lateral) < len(needed):
        raise TableError(f"{scan.file}: says the unit of one direction only; give punch.size")
    if scan.unit and keys.unit is None and needed and not lateral:
        raise TableError(
            f"{scan.file}: says heights in {scan.unit}, but x and y have no unit; give punch.size, the lengths of "
            "the scan, or punch.unit for all"
        )
    known = scan.unit or keys.unit is not None
    sized = keys.size or all(axis.length is not None or axis.positions is not None for axis in scan.axes)
    if scan.doubt and not (known and sized):
        missing = " and ".join(["punch.unit"] * (not known) + ["punch.size"] * (not sized))
        raise TableError(
            f"{scan.file}: {scan.doubt} may say a length or a unit, but is not understood; give {missing}"
        )


_ADD_UNITS = "add units: {length: ..., stress: ..., time: ...}"


def _own_unit(scan: Scan, keys: Keys, grid: Grid, needed: Sequence[Axis]) -> Length | None:
    """Return the unit of length of a configuration without units, where the file has units."""
    lateral = [axis.unit for axis in needed if axis.unit]
    if isinstance(keys.unit, float) and (scan.unit or not lateral):
        return Length(scan.unit.size / keys.unit, "") if scan.unit else None
    if not (scan.unit or lateral):
        return None
    lengths = [_ratio(axis.unit, lateral[0]) * (axis.length or 0.0) for axis in needed if axis.unit]
    if len(lengths) == len(grid.period) and np.allclose(lengths, grid.period, rtol=_ROUNDING, atol=0):
        return lateral[0]  # the cell has the size of the scan in this unit
    unit = scan.unit or lateral[0]
    raise TableError(
        f"{scan.file}: says {'heights' if scan.unit else 'lengths'} in {unit}, but the configuration has no units; "
        f"{_ADD_UNITS}, or give punch.unit, the length of 1 {unit} in the configuration's"
    )


def _ratio(unit: Length, into: Length) -> float:
    """Return a unit in another one; exact powers of ten."""
    ratio = unit.size / into.size
    return float(f"{ratio:.15g}")


def _check_size(scan: Scan, keys: Keys, size: Sequence[float | None], grid: Grid, unit: str) -> None:
    """Refuse a size that is not the cell's."""
    if not np.allclose(np.array(size, dtype=float), grid.period, rtol=_ROUNDING, atol=0):
        which = "punch.size is" if keys.size else f"{scan.file}: is"
        given = f" (with unit = {keys.unit})" if keys.unit is not None and not keys.size else ""
        swapped = len(size) == 2 and np.allclose(np.array(size[::-1], float), grid.period, rtol=_ROUNDING)
        hint = "; transpose: true exchanges x and y" if swapped and not keys.size else ""
        raise TableError(
            f"{which} {_lengths(size)}{unit} long{given}, but grid.period is {_lengths(grid.period)}{unit}; must "
            f"agree within a thousandth: change grid.period, or give punch.size (lengths of the scan) or punch.unit{hint}"
        )


def _without_holes(scan: Scan, keys: Keys) -> tuple[FloatArray, str]:
    """Return the heights with NaN for the number that marks a hole, and words; TableError for a probable one."""
    values = scan.heights
    if isinstance(keys.hole, float):
        mark = np.isclose(values, keys.hole, rtol=1e-6, atol=0) | (values == keys.hole)
        return np.where(mark, np.nan, values), f", marked by {keys.hole:g}" if mark.any() else ""
    if keys.hole is None and (found := _probable_hole(values)) is not None:
        mark, count = found
        raise TableError(
            f"{scan.file}: {count} of {values.size} heights are {mark:g}, far from all others: probably points "
            f"without a height; give punch.hole: {mark:g}, or hole: none if they are heights"
        )
    return values, ""


def _probable_hole(values: FloatArray) -> tuple[float, int] | None:
    """Return a number that programs write for a missing height, and stands far from the others."""
    finite = values[np.isfinite(values)]
    for extreme in (finite.min(), finite.max()) if finite.size else ():
        mark = float(extreme)
        rest = finite[finite != extreme]
        if rest.size and _marks_holes(mark):
            low, high = float(rest.min()), float(rest.max())
            if min(abs(low - mark), abs(high - mark)) > high - low:
                return mark, finite.size - rest.size
    return None


def _marks_holes(number: float) -> bool:
    """Whether programs write a number for a missing height: -9999, -32768, 1e38 and their like."""
    size = abs(number)
    nines = (
        re.fullmatch(r"9{3,}(?:\.(?:0|9+))?", repr(float(f"{size:.6g}")) if size < 1e15 else "") is not None
    )
    return nines or size in {32767.0, 32768.0, 65535.0, 2147483647.0, 2147483648.0} or size >= 1e10


def _interpolated(
    scan: Scan, x: FloatArray, heights: FloatArray, grid: Grid, unit: str, *, gaps: bool
) -> tuple[FloatArray, str]:
    """Interpolate a line with unequal distances onto the grid; TableError where it is too coarse or short."""
    measured = np.isfinite(heights)
    x, heights = x[measured], heights[measured]
    (n,), (period,) = grid.points, grid.period
    if x.size < 2:
        raise TableError(f"{scan.file}: holds {x.size} heights; must be at least two")
    steps, span = np.diff(x), float(x[-1] - x[0])
    where = int(np.argmax(steps))
    widest, seam = float(steps[where]), period - span
    if span > period * (1 + _ROUNDING):
        raise TableError(
            f"{scan.file}: is {span:.6g}{unit} long, but grid.period is {period:.6g}{unit}; must not be longer: "
            "change grid.period, or give punch.unit"
        )
    if seam > max(widest, period / n) * (1 + _ROUNDING):
        raise TableError(
            f"{scan.file}: x goes over {span:.6g}{unit}, but grid.period is {period:.6g}{unit}; the rest must not be "
            f"longer than the distance of neighbours, {widest:.6g}{unit}: change grid.period, or give punch.unit"
        )
    if widest > _WIDEST * period / n and not gaps:
        raise TableError(
            f"{scan.file}: neighbours are up to {widest:.6g}{unit} apart, from x = {x[where]:.6g} to {x[where + 1]:.6g}; "
            f"must be at most {_WIDEST:g} spacings of the grid, {_WIDEST * period / n:.6g}: use fewer grid.points, or "
            "fill: membrane for straight lines across"
        )
    points = x[0] + np.arange(n) * (period / n)
    joined = (np.append(x, x[0] + period), np.append(heights, heights[0])) if seam > 0 else (x, heights)
    words = (
        f"x from {x[0]:.6g} to {x[-1]:.6g}{unit}, not equally spaced, neighbours at most {widest:.3g}{unit} apart; "
        f"interpolated linearly onto {n} points"
    )
    return np.interp(points, *joined), words


# Files.


def read_scan(file: Path, axes: int, keys: Keys = Keys(), grid: Grid | None = None) -> Scan:
    """Read a file of heights on so many axes; TableError if there are none, or more than one reading."""
    # Where several processes hold the grid, the rows of this one are read.
    rows = slice(None)
    if grid is not None and not grid.is_whole:
        rows = slice(grid.first_row, grid.first_row + grid.shape[0])
    scan = _reader_of(file)(file, axes, keys, rows)
    if keys.transpose and axes == 2 and len(scan.shape) == 2:
        scan = scan.transposed()
    _check_shape(scan, axes, grid)
    _refuse_larger(file, scan.heights)
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


def _refuse_larger(file: Path, heights: FloatArray) -> None:
    if (large := np.abs(heights) > LARGEST).any():
        where, first = np.argwhere(large)[0].tolist(), heights[large][0]
        size = "infinite" if np.isinf(first) else f"too large; must be up to {LARGEST:g}"
        raise TableError(f"{file}: the height at index {where} is {size}")


Reader = Callable[[Path, int, Keys, slice], Scan]


IN_PARTS = (".npy", ".h5", ".hdf5", ".nc")  # endings of files of which a process may read some rows


def _reader_of(file: Path) -> Reader:
    """Return the reader for the first bytes of a file."""
    try:
        with file.open("rb") as stream:
            head = stream.read(4096)
    except OSError as error:
        raise TableError(f"{file}: cannot be read ({error.strerror or error})") from error
    if head.startswith(b"\x93NUMPY") or file.suffix.lower() == ".npy":
        return _array
    if head.startswith((b"\x89HDF", b"CDF\x01", b"CDF\x02", b"CDF\x05")):
        return _labelled
    if file.suffix.lower() in {".h5", ".hdf5", ".nc"} and not _is_text(head):
        return _labelled
    return _text if _is_text(head) else _by_surface_topography


def _is_text(head: bytes) -> bool:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return True
    odd, even = head[1::2].count(0), head[::2].count(0)
    if max(odd, even) > 0.9 * (len(head) // 2) and min(odd, even) == 0:  # UTF-16 without its mark
        head = head.replace(b"\0", b"")
    return not re.search(rb"[\x00-\x08\x0e-\x19\x7f]", head)


# NumPy arrays, HDF5 and netCDF.


def _array(file: Path, _axes: int, keys: Keys, rows: slice) -> Scan:
    _refuse_dataset(file, keys)
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
    return Scan(file, values.astype(np.float64), None, (Axis(),) * array.ndim, layout, shape=array.shape)


def _refuse_dataset(file: Path, keys: Keys) -> None:
    if keys.dataset is not None:
        raise TableError(f"{file}: is no HDF5 or netCDF file; dataset must be left out")


def _labelled(file: Path, axes: int, keys: Keys, rows: slice) -> Scan:
    try:
        return _own_labelled(file, axes, keys, rows)
    except TableError as error:
        if keys.dataset is not None:
            raise
        with suppress(_Unknown):
            return _believed(file, keys, error)
        raise


def _own_labelled(file: Path, axes: int, keys: Keys, rows: slice) -> Scan:
    import h5py
    import xarray

    group, _, name = (keys.dataset or "").strip("/").rpartition("/")
    hdf5 = bool(h5py.is_hdf5(file))
    options: dict[str, Any] = {"engine": "h5netcdf", "phony_dims": "sort"} if hdf5 else {"engine": "scipy"}
    try:
        if hdf5:
            with h5py.File(file, locking=False) as h5:
                open_group(file, h5, group)
            options["driver_kwds"] = {"locking": False}
        with xarray.open_dataset(file, group=group or None, decode_times=False, **options) as opened:
            chosen = _chosen(file, opened, axes, name)
            layout = "first axis x, second y" if chosen.ndim == 2 else ""
            if set(chosen.dims) == {"x", "y"}:
                chosen, layout = chosen.transpose("x", "y"), "dimensions x and y"
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
    dims = tuple(axis for axis, _ in found)
    if any(axis.length is None and axis.positions is None for axis in dims):
        dims = tuple(replace(axis, length=None) for axis in dims)
    uneven = [str(dim) for dim, axis in zip(chosen.dims, dims, strict=True) if axis.positions is not None]
    if uneven and len(dims) > 1:
        raise TableError(f"{file}: {uneven[0]} is not equally spaced")
    return Scan(file, values, unit, dims, layout, shape=chosen.shape)


def _coordinate(file: Path, opened: Any, dim: str) -> tuple[Axis, bool]:
    """Return what a file says of a dimension, and whether its coordinate decreases."""
    if dim not in opened.variables:
        return Axis(), False
    variable = opened[dim]
    unit = _unit_of_attributes(file, dim, variable.attrs, known=False)
    if "length" in variable.attrs:  # SurfaceTopography's netCDF
        return Axis(float(variable.attrs["length"]), unit), False
    if dim not in opened.coords:
        return Axis(), False
    x = variable.to_numpy().astype(np.float64)
    down = bool(x.size > 1 and x[-1] < x[0])
    return _axis(file, dim, x[::-1] if down else x, unit), down


def _unit_of_attributes(file: Path, name: str, attributes: Any, *, known: bool) -> Length | None:
    """Return the unit of length that attributes of a variable say; TableError for another one."""
    text = str(attributes.get("units", attributes.get("unit", ""))).strip()
    if text in {"", "1", "-"}:
        return None
    unit = length_unit(text)
    if unit is None and not known:
        raise TableError(f"{file}: {name} is in {text!r}, which is no known unit of length")
    return unit


def _axis(file: Path, name: str, x: FloatArray, unit: Length | None) -> Axis:
    """Return the axis of increasing positions."""
    steps = np.diff(x)
    if not (np.isfinite(x).all() and x.size > 1 and steps.min() > 0):
        order = (
            "decreases in places"
            if x.size and np.isfinite(x).all() and steps.size and steps.min() < 0
            else ""
        )
        same = "has a value twice" if not order and steps.size and steps.min() == 0 else ""
        wrong = order or same or "is no row of numbers"
        raise TableError(f"{file}: {name} is not equally spaced, increasing: it {wrong}")
    spacing = float(x[-1] - x[0]) / (x.size - 1)
    drift = np.abs(x - x[0] - spacing * np.arange(x.size)).max()
    if np.abs(steps - spacing).max() <= _ROUNDING * spacing and drift < 0.05 * spacing:
        return Axis(spacing * x.size, unit)
    return Axis(None, unit, x)


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


# Text: matrices of heights, and columns of x, y and height.


def _text(file: Path, axes: int, keys: Keys, _rows: slice) -> Scan:
    _refuse_dataset(file, keys)
    try:
        return _own_text(file, axes, keys)
    except TableError as error:
        with suppress(_Unknown):
            return _believed(file, keys, error)
        raise


def _own_text(file: Path, axes: int, keys: Keys) -> Scan:
    matrix = read_matrix(file, keys.decimal)
    if any(map(is_known, matrix.headings)):
        return _of_columns(file, axes, matrix, _named(file, axes, matrix, keys), _Header({}, {}, ""))
    header = _header(file, matrix)
    rows, width = matrix.shape
    headings = [heading for heading in matrix.headings if heading]
    if width == axes + 1 and headings:
        raise TableError(f"{file}: has the headings {', '.join(headings)}; known are {_NAMES[axes]}")
    if axes == 1:
        if width != 2:
            raise TableError(f"{file}: holds {width} columns; must be two, x and height, on a line")
        return _of_columns(file, 1, matrix, _placed(file, axes, matrix, header), header)
    if width == 2:
        raise TableError(
            f"{file}: holds two columns, as x and height of a line; grid.points has two directions"
        )
    if width == 3 and not header.is_matrix and rows > 3:
        return _of_columns(file, 2, matrix, _placed(file, axes, matrix, header), header)
    return _of_matrix(file, matrix, header)


_NAMES = {1: "x and height", 2: "x, y and height (z)"}


class _Column(NamedTuple):
    """A column of a table of points."""

    values: FloatArray
    unit: Length | None


def _named(file: Path, axes: int, matrix: Matrix, keys: Keys) -> dict[str, _Column]:
    """Return the columns x, (y) and height by their headings."""
    wanted = ("x", "height") if axes == 1 else ("x", "y", "height")
    found: dict[str, tuple[int, _Column]] = {}
    for c, (heading, below) in enumerate(zip(matrix.headings, matrix.units, strict=True)):
        means = meaning(heading, below, wanted)
        asked = [each for each in means.options if each in wanted]
        if (
            means.reason
            and asked
            and not (keys.unit is not None and asked == ["height"] and means.unit is None)
        ):
            raise TableError(f"{file}: the heading {heading!r} {means.reason}")
        if not asked:
            continue
        if (name := asked[0]) in found:
            other = matrix.headings[found[name][0]]
            raise TableError(f"{file}: two columns are {name}, {other!r} and {heading!r}; must be one")
        unit = Length(float(means.unit.size), means.symbol) if means.unit is not None else None
        found[name] = c, _Column(matrix.values[:, c], unit)
    if missing := [name for name in wanted if name not in found]:
        headings = ", ".join(map(repr, matrix.headings))
        raise TableError(
            f"{file}: no heading names {' and '.join(missing)} among {headings}; give {_NAMES[axes]}"
        )
    columns = {name: column for name, (_, column) in found.items()}
    for heading, flags in zip(matrix.headings, matrix.values.T, strict=True):
        if heading.strip().lower() == "valid":  # 1 or 0
            measured = columns["height"]
            columns["height"] = measured._replace(values=np.where(flags == 0, np.nan, measured.values))
    return columns


def _placed(file: Path, axes: int, matrix: Matrix, header: _Header) -> dict[str, _Column]:
    """Return the columns x, (y) and height by their order."""
    names = ("x", "height") if axes == 1 else ("x", "y", "height")
    across, up = header.units.get("x"), header.units.get("height")
    units = dict(zip(names, (across, header.units.get("y", across))[:axes] + (up,), strict=True))
    return {name: _Column(matrix.values[:, c], units[name]) for c, name in enumerate(names)}


def _of_columns(file: Path, axes: int, matrix: Matrix, columns: dict[str, _Column], header: _Header) -> Scan:
    """Return the scan of points in columns."""
    positions = [columns["xy"[axis]] for axis in range(axes)]
    for name, column in zip("xy", positions, strict=False):
        if not np.isfinite(column.values).all():
            row = int(np.argmin(np.isfinite(column.values))) + 1
            raise TableError(f"{file}: {name} is no number in row {row} of the table")
    height = columns["height"]
    written = _marks(matrix)
    if axes == 1:
        (x,) = positions
        order = np.argsort(x.values, kind="stable")
        axis = _axis(file, "x", x.values[order], x.unit)
        return Scan(
            file, height.values[order], height.unit, (axis,), "columns x, height", written, header.doubt
        )
    levels = [_levels(file, name, column.values) for name, column in zip("xy", positions, strict=True)]
    (ix, nx, dx), (iy, ny, dy) = levels
    counts = np.bincount(ix * ny + iy, minlength=nx * ny)
    if (counts != 1).any():
        at = int(np.argmax(counts != 1))
        state = "missing" if counts[at] == 0 else f"given {counts[at]} times"
        raise TableError(
            f"{file}: holds {ix.size} points x, y, z, on {nx} x {ny} values of x and y; each must occur once, but number "
            f"{at // ny + 1} of x with number {at % ny + 1} of y is {state}"
        )
    heights = np.empty((nx, ny))
    heights[ix, iy] = height.values
    sizes = (Axis(nx * dx, positions[0].unit), Axis(ny * dy, positions[1].unit))
    return Scan(file, heights, height.unit, sizes, "columns x, y, height", written, header.doubt)


def _levels(file: Path, name: str, values: FloatArray) -> tuple[np.ndarray[Any, Any], int, float]:
    """Return the number of each position on an equally spaced axis, their count and spacing."""
    order = np.sort(values)
    steps = np.diff(order)
    widest = float(steps.max(initial=0.0))
    first = np.append(True, steps > 0.5 * widest)  # of each level; positions of one level differ by rounding
    count = int(first.sum())
    if not widest > 0 or count < 2:
        raise TableError(
            f"{file}: {name} of the points x, y, z is everywhere {order[0]:g}; must be two values or more"
        )
    spacing = float(order[-1] - order[0]) / (count - 1)
    digits = next(
        (k for k in range(16) if np.allclose(values * 10.0**k, np.rint(values * 10.0**k), rtol=0, atol=1e-6)),
        16,
    )
    allowed = max(_ROUNDING, min(0.05, 0.501 * 10.0**-digits / spacing)) * spacing  # digits written
    index = np.rint((values - order[0]) / spacing).astype(np.int64)
    wrong = np.abs(values - order[0] - index * spacing)
    if wrong.max() > allowed:
        row = int(np.argmax(wrong))
        raise TableError(
            f"{file}: three columns are x, y and height of points, but {name} is not equally spaced: {count} values, "
            f"spacing {spacing:.6g}, and {values[row]:.6g} in row {row + 1}; or a matrix of heights needs its size above"
        )
    return index, count, spacing


def _marks(matrix: Matrix) -> tuple[str, ...]:
    """Return what is unusual in how a text is written."""
    return tuple(part for part in matrix.account.split("; ")[1:] if not part.endswith(("not read", "holes")))


def _of_matrix(file: Path, matrix: Matrix, header: _Header) -> Scan:
    """Return the scan of rows of heights: each row is a y, each column an x."""
    values, layout = matrix.values, "rows are y, columns x"
    x, y = (Axis(header.sizes.get(name), header.units.get(name)) for name in "xy")
    if (inner := _with_axes(values)) is not None:
        across, down, values = inner
        layout = "rows are y, columns x, with x in the first row and y in the first column"
        x, y = _axis(file, "x", across, x.unit), _axis(file, "y", down, y.unit)
        if x.positions is not None or y.positions is not None:
            raise TableError(f"{file}: x or y is not equally spaced")
    elif _counts_columns(values):
        raise TableError(f"{file}: the first row of the matrix counts the columns; remove it")
    rows, columns = values.shape
    for name, found in (("x", columns), ("y", rows)):
        if (said := header.counts.get(name, found)) != found:
            line = "columns" if name == "x" else "rows"
            raise TableError(f"{file}: holds {found} {line}; its header says {said}")
    if header.spacings:
        x, y = (
            replace(axis, length=header.spacings.get(name, axis.length and axis.length / n) * n)
            if name in header.spacings else axis
            for axis, name, n in ((x, "x", columns), (y, "y", rows))
        )  # fmt: skip
    if header.factor is not None:
        values = values * header.factor
    if header.hole is not None:
        values = np.where(values == header.hole, np.nan, values)
    heights = np.ascontiguousarray(values.T)
    sizes = (x, y) if x.length is not None and y.length is not None else (Axis(), Axis())
    doubt = header.doubt
    if (x.length is None) is not (y.length is None):
        doubt = doubt or "its header, with a length in one direction only,"
    return Scan(file, heights, header.units.get("height"), sizes, layout, _marks(matrix), doubt)


def _with_axes(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return x, y and heights of a matrix with x in its first row and y in its first column, else None."""
    if min(values.shape) < 4:
        return None
    across, down = values[0, 1:], values[1:, 0]
    if (
        not (_evenly(across) and _evenly(down))
        or np.isnan(values[0, 0]) is np.False_
        and _evenly(values[1, 1:])
    ):
        return None  # a tilted plane
    if np.isfinite(values[0, 0]) and values[0, 0] != 0:
        return None
    return across, down, values[1:, 1:]


def _evenly(values: FloatArray) -> bool:
    steps = np.diff(values)
    return bool(
        np.isfinite(steps).all() and steps[0] != 0 and np.allclose(steps, steps[0], rtol=0.05, atol=0)
    )


def _counts_columns(values: FloatArray) -> bool:
    """Whether the first row is 0, 1, 2, ... and the others are not."""
    first = values[0] - np.arange(values.shape[1])
    return bool(values.shape[1] > 3 and len(values) > 1 and (first == first[0]).all() and first[0] in {0.0, 1.0}
                and not _evenly(values[1]))  # fmt: skip


# Headers of text, in the words of Gwyddion, SPIP, Nova, WSxM, ESRI and others.

_SEVERAL = re.compile(r"([^\W\d][\w -]*?)\s*=\s*(\d+)(?=\s|$)")
_ENTRY = re.compile(
    r"(?P<label>[^\W\d].*?)\s*(?:\[(?P<a>[^\]]*)\]|\((?P<b>[^()]*)\))?\s*(?:[:=：;,\t]\s*|\s+(?=[-+.\d]))"
    r"(?P<value>[^\s:=].*)"
)
_VALUE = re.compile(r"(?P<number>[-+]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][-+]?\d+)?)\s*[;,\t]?\s*(?P<unit>.*)")
_LABELS = {
    "x": "width|šířka|breite|anchura|largeur|larghezza|幅|폭|largura|ширина|x-length|x length|x size|size x|x range|"
    "range x|scan size x|x scan size|scan width|x amplitude|length x|xlength|xsize|länge x|x dimension",
    "y": "height|výška|höhe|altura|hauteur|altezza|高さ|높이|высота|y-length|y length|y size|size y|y range|range y|"
    "scan size y|y scan size|scan height|y amplitude|length y|ylength|ysize|länge y|y dimension",
    "both": "scan size|scan range|scan area|image size|size|field of view",
    "unit": "value units|value unit|jednotky hodnot|einheiten|unités|unità valore|値の単位|값 단위|unidades de valor|"
    "единицы измерения|z-unit|z unit|z units|unit z|unit data|data unit|height unit|height units|zunit",
    "lateral": "lateral units|lateral unit|x-y units|xy unit|xy units|xy-units",
    "unit of x": "x-unit|x unit|unit x|xunit",
    "unit of y": "y-unit|y unit|unit y|yunit",
    "spacing": "pixel size|pixelsize|cellsize|cell size|grid spacing|pixel spacing|point spacing|spacing",
    "spacing of x": "scale x|x spacing|spacing x|x step|dx|x increment|x pixel size|pixel size x",
    "spacing of y": "scale y|y spacing|spacing y|y step|dy|y increment|y pixel size|pixel size y",
    "columns": "w|x-pixels|x pixels|nx|ncols|columns|number of columns|pixels x|points x|x points|cols",
    "rows": "h|y-pixels|y pixels|ny|nrows|rows|number of rows|pixels y|points y|y points|lines|number of lines",
    "hole": "nodata value|nodata|no data value",
}  # fmt: skip
_LABEL = {name: label for label, names in _LABELS.items() for name in names.split("|")}
_FACTOR = re.compile(
    r"height conversion factor \(->\s*(?P<unit>[^)]+)\)\s*[=:]\s*(?P<number>[-+.\deE]+)", re.IGNORECASE
)
_DOUBTFUL = re.compile(
    r"scale|factor|unit|size|length|width|height|pixel|spacing|pitch|increment|range|amplitude|resolution|mult|bit2nm|"
    r"einheit|größe|länge|breite|höhe|abstand|schritt|taille|largeur|hauteur|échelle|unité|wavelength|faktor|facteur",
    re.IGNORECASE,
)


class _Header(NamedTuple):
    """What the lines above a matrix say."""

    sizes: dict[str, float]  # lengths of x and y
    units: dict[str, Length]  # of x, y and height
    doubt: str  # a line that may say more
    spacings: dict[str, float] = {}
    counts: dict[str, int] = {}  # columns are x, rows are y
    factor: float | None = None  # of heights
    hole: float | None = None

    @property
    def is_matrix(self) -> bool:
        """Whether rows and columns, or their lengths, are named."""
        return bool(self.sizes or self.counts or self.spacings)


def _header(file: Path, matrix: Matrix) -> _Header:
    """Read the lines above a matrix; TableError for a unit that is no length."""
    sizes: dict[str, float] = {}
    units: dict[str, Length] = {}
    spacings: dict[str, float] = {}
    counts: dict[str, int] = {}
    found: dict[str, float] = {}
    of_data, doubt = "", ""
    for line in matrix.header:
        plain = re.sub(r"^[\s#%;!*/\"]+|[\s;,\"]+$", "", line)
        if match := _FACTOR.search(plain):
            found["factor"], of_data = float(match["number"]), match["unit"].strip()
            continue
        cells = re.split(r"[\s;,|]+", plain)
        if len(cells) == matrix.shape[1] and all(map(length_unit, cells)):  # a row of units
            names = ("x", "y", "height") if len(cells) == 3 else ("x", "height")
            units |= {
                name: unit for name, cell in zip(names, cells, strict=False) if (unit := length_unit(cell))
            }
            continue
        several = _SEVERAL.findall(plain)
        entries = several if len(several) > 1 else list(_entries(plain))
        understood = False
        for label, value, *bracket in entries:
            key = _LABEL.get(re.sub(r"[\s_]+", " ", label).strip().lower())
            if key in {"unit", "lateral", "unit of x", "unit of y"}:
                understood = True
                if key == "unit":
                    of_data = "" if found.get("factor") else value.strip()
                elif unit := length_unit(value):
                    names = {"lateral": "xy", "unit of x": "x", "unit of y": "y"}[key]
                    units |= dict.fromkeys(names, unit)
                else:
                    raise TableError(f"{file}: {line.strip()!r}: {value!r} is no known unit of length")
                continue
            if key is None:
                continue
            understood = _take(file, line, key, value, bracket, matrix, sizes, units, spacings, counts, found)
        if not understood and not doubt and _is_doubtful(plain):
            doubt = f"the line {line.strip()[:60]!r}"
    if of_data and of_data not in {"1", "-"}:
        unit = length_unit(of_data)
        if unit is None and "factor" not in found:
            raise TableError(
                f"{file}: its header says that the values are in {of_data!r}, which is no known length"
            )
        if unit:
            units["height"] = unit
    for one, other in ("xy", "yx"):
        if one in units and other not in units and other not in sizes | spacings:
            units[other] = units[one]
    return _Header(sizes, units, doubt, spacings, counts, found.get("factor"), found.get("hole"))


def _entries(line: str) -> Iterator[tuple[str, ...]]:
    """Yield label, value and the unit in brackets behind the label."""
    if match := _ENTRY.fullmatch(line):
        yield match["label"], match["value"], match["a"] or match["b"] or ""


def _take(
    file: Path, line: str, key: str, value: str, bracket: list[str], matrix: Matrix, sizes: dict[str, float],
    units: dict[str, Length], spacings: dict[str, float], counts: dict[str, int], found: dict[str, float],
) -> bool:  # fmt: skip
    """Take a number of a header into what it says; whether it is understood."""
    match = _VALUE.fullmatch(value.strip())
    if match is None:
        return False
    if key == "both":
        parts = re.split(r"\s*[x×*]\s*", value)
        values = [_VALUE.fullmatch(part.strip()) for part in parts]
        if len(values) != 2 or not all(values):
            return False
        last = values[1]
        assert last is not None
        for name, each in zip("xy", values, strict=True):
            assert each is not None
            unit = length_unit(each["unit"]) or length_unit(last["unit"])
            if unit is None:
                return False
            sizes[name], units[name] = _number(file, line, each["number"], matrix), unit
        return True
    symbol = match["unit"].strip(" ;,\t[]()") or "".join(bracket).strip()
    unit = length_unit(symbol) if symbol else None
    if key in {"columns", "rows", "hole"}:
        if symbol:
            return False
        number = _number(file, line, match["number"], matrix)
        if key == "hole":
            found["hole"] = number
        elif number != int(number):
            return False
        else:
            counts["x" if key == "columns" else "y"] = int(number)
        return True
    if symbol and unit is None:
        raise TableError(f"{file}: {line.strip()!r}: {symbol!r} is no known unit of length")
    names = key[-1] if key[-1] in "xy" and key != "both" else "xy"
    number = _number(file, line, match["number"], matrix)
    into = spacings if key.startswith("spacing") else sizes
    if not number > 0:
        raise TableError(f"{file}: {line.strip()!r}: must be > 0")
    into |= dict.fromkeys(names, number)
    if unit is not None:
        units |= dict.fromkeys(names, unit)
    return True


def _number(file: Path, line: str, text: str, matrix: Matrix) -> float:
    """Return a number of a header, whose decimal mark need not be that of the matrix."""
    marks = re.findall("[.,]", text)
    whole, _, digits = re.split("[eE]", text)[0].replace(",", ".").partition(".")
    if (
        len(marks) == 1
        and marks[0] != matrix.decimal
        and len(digits) == 3
        and whole.strip("+-") not in {"", "0"}
    ):
        raise TableError(
            f"{file}: {line.strip()!r}: is {marks[0]!r} a decimal mark or a mark of thousands in {text}? give punch.size"
        )
    if len(marks) > 1:
        *groups, last = marks
        if last in groups:
            raise TableError(f"{file}: {line.strip()!r}: cannot read the number {text}")
        text = text.replace(groups[0], "")
    return float(text.replace(",", "."))


def _is_doubtful(line: str) -> bool:
    """Whether a line may say a length or a unit of the data."""
    if _DOUBTFUL.search(line) and re.search(r"[:=：;,\t]|\d", line):
        return True
    words = re.split(r"[\s,;|:=()\[\]]+", line)
    return any(len(word) > 1 and length_unit(word) is not None for word in words)


# SurfaceTopography, for the formats of instruments.


class _Unknown(Exception):
    """SurfaceTopography is not installed, or not to be believed on this file."""


# Its readers of tables take unequal x for equal, and drop units and decimals; of HDF5 they take the first array.
_NOT_BELIEVED = frozenset({"asc", "xyz", "matrix", "h5", "npy"})


def _by_surface_topography(file: Path, _axes: int, keys: Keys, _rows: slice) -> Scan:
    try:
        return _believed(file, keys, None)
    except _Unknown:
        known = ".npy, .h5, .hdf5, .nc, text"
        raise TableError(
            f"{file}: must be one of {known}; for the formats of instruments install the extra `topography`"
        ) from None


def _believed(file: Path, keys: Keys, refusal: TableError | None) -> Scan:
    """Return what SurfaceTopography reads in a format of its own; _Unknown in others, if we have a `refusal`."""
    try:
        from SurfaceTopography import open_topography
    except ImportError:
        raise _Unknown from None
    before = f"{refusal}; " if refusal else f"{file}: "
    try:
        with open_topography(str(file)) as reader:
            wyko = "wyko" in str(getattr(reader, "_metadata", ""))
            if reader.format() in _NOT_BELIEVED and not wyko:
                if refusal:
                    raise _Unknown
                raise TableError(
                    f"{file}: SurfaceTopography takes it for a table ({reader.format()}); unpack it into text"
                )
            index = _channel(file, reader, keys)
            channel = reader.channels[index]
            given = {} if channel.physical_sizes is not None else {"physical_sizes": (1.0,) * channel.dim}
            topography = reader.topography(channel_index=index, **given)
            return _of_topography(file, topography, given, _said_of(reader, index))
    except (TableError, _Unknown):
        raise
    except Exception as error:  # its readers raise exceptions of any kind
        if refusal and type(error).__name__ in {"CannotDetectFileFormat", "UnknownFileFormat"}:
            raise _Unknown from error
        message = " ".join(str(error).split())[:300]
        raise TableError(f"{before}SurfaceTopography cannot read it ({message})") from error


def _channel(file: Path, reader: Any, keys: Keys) -> int:
    """Return the number of the channel with the name `dataset`, or of the first one of heights."""
    names = [str(channel.name) for channel in reader.channels]
    if keys.dataset is None:
        return int(getattr(reader, "_default_channel_index", 0))
    if names.count(keys.dataset) != 1:
        raise TableError(f"{file}: has no dataset {keys.dataset!r}; known: {', '.join(names)}")
    return names.index(keys.dataset)


def _said_of(reader: Any, index: int) -> tuple[str, ...]:
    names = [str(channel.name) for channel in reader.channels]
    chosen = f"channel {names[index]!r}"
    if len(names) > 1:
        chosen += f" of {', '.join(names)} (dataset chooses)"
    return f"{reader.format()}, read by SurfaceTopography", chosen


def _of_topography(file: Path, topography: Any, given: Any, notes: tuple[str, ...]) -> Scan:
    """Check what SurfaceTopography found, and return it."""
    unit = length_unit(topography.unit.replace("A", "Å") if topography.unit == "A" else topography.unit or "")
    if topography.unit and unit is None:
        raise TableError(f"{file}: SurfaceTopography says heights in {topography.unit!r}; must be lengths")
    heights = np.ma.filled(np.ma.asarray(topography.heights(), dtype=np.float64), np.nan)
    sizes = tuple(map(float, topography.physical_sizes))
    if not given and not all(0 < size < np.inf for size in sizes):
        raise TableError(f"{file}: SurfaceTopography says a size of {_lengths(sizes)}; must be > 0")
    if heights.ndim == 1 and not topography.is_uniform:
        x = np.asarray(topography.positions(), dtype=np.float64)
        order = np.argsort(x, kind="stable")
        return Scan(file, heights[order], unit, (_axis(file, "x", x[order], unit),), "x, height", notes)
    axes = tuple(Axis(None if given else size, unit) for size in sizes)
    return Scan(file, heights, unit, axes, "", notes)
