"""A measured surface as its file has it, and as heights on a grid in the configuration's unit of length.

A `Scan` has what a file says of heights, lengths, units and holes. `on_grid` converts it. The keys of the
punch, `Keys`, go before the file. What neither says is refused, as is a size that is not that of the cell,
and a unit that a configuration without units cannot convert.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.files.tables import LARGEST, Answers, TableError, counted
from gfmdlayer.files.units import unit_of
from gfmdlayer.grid.grid import Grid

ROUNDING = 1e-3  # relative; sizes in headers have some three digits
_WIDEST = 4.0  # spacings of the grid between neighbours of a line; more needs fill
_LENGTH = (0, 1, 0, 0, 0, 0, 0)


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
    answers: Answers = Answers()  # on a text
    hole: float | str | None = None  # number that stands for a point without a height, or "none"
    dataset: str | None = None  # of several


@dataclass(frozen=True)
class ScanAxis:
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
    axes: tuple[ScanAxis, ...]
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

    A line with unequal distances is interpolated onto the grid; `gaps` permits wide ones. TableError where
    units or the size of the scan are not known, and where the size is not that of the cell.
    """
    values, holes = without_holes(scan, keys)
    refuse_heights(scan.file, values, np.abs(values) > LARGEST)
    vertical, lateral, taken = _factors(scan, keys, grid, length)
    unit = f" {length}" if length else ""
    size = keys.size and (keys.size * len(grid.points) if len(keys.size) == 1 else keys.size)
    own = tuple(
        None if axis.length is None else factor * axis.length
        for axis, factor in zip(scan.axes, lateral, strict=True)
    )
    heights = vertical * values
    said = [f"{times(scan.shape)} points", scan.layout, _units_said(scan, keys, length), taken]
    given = size or (None if None in own else own)
    if scan.axes[0].positions is None:
        if given is not None:
            _check_size(scan, keys, given, grid, unit)
            said.append(f"size {lengths_in_words(given)}{unit}" + _beside(own, size, unit))
        else:
            said.append(f"no size in the file: it fills the cell, {lengths_in_words(grid.period)}{unit}")
    else:
        if size:
            _check_size(scan, keys, size, grid, unit)
        position = lateral[0] * scan.axes[0].positions
        heights, words = _interpolated(scan, position, heights, grid, unit, gaps=gaps)
        said.append(words)
    said += scan.notes
    if holes or np.isnan(values).any():
        said.append(counted(int(np.isnan(values).sum()), "hole") + holes)
    return Measured(heights, f"{scan.file.name}: " + "; ".join(filter(None, said)))


def times(shape: tuple[int, ...]) -> str:
    """Write a shape for people: 512 x 512."""
    return " x ".join(map(str, shape)) or "no"


def lengths_in_words(lengths: Sequence[float | None]) -> str:
    """Write lengths for people: 10 x 8."""
    return " x ".join(f"{length:.6g}" for length in lengths)


def _beside(own: Sequence[float | None], size: tuple[float, ...] | None, unit: str) -> str:
    """Say that a given size is not the file's."""
    if size is None or None in own or np.allclose(np.array(own, float), size, rtol=ROUNDING, atol=0):
        return ""
    return f" (punch.size; the file says {lengths_in_words(own)}{unit})"


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
        return other is not None and bool(np.isclose(other.size, unit.size, rtol=ROUNDING))
    known = length_unit(length) if length else None
    return known is None or bool(np.isclose(given * known.size, unit.size, rtol=ROUNDING))


def _factors(scan: Scan, keys: Keys, grid: Grid, length: str | None) -> tuple[float, tuple[float, ...], str]:
    """Return the factors from heights, and from lengths along each axis, to the configuration's unit.

    And words on that unit, where it is the file's.
    """
    own = length_unit(length) if length else None
    needed = [
        axis
        for axis in scan.axes
        if axis.positions is not None or (axis.length is not None and not keys.size)
    ]
    _refuse_open(scan, keys, own, needed)
    if own is None:
        own = _own_unit(scan, keys, grid, needed)
    taken = "" if length or own is None or not own.symbol else f"the cell is in {own}, for it has this size"
    unit = length_unit(keys.unit) if isinstance(keys.unit, str) else scan.unit
    vertical = 1.0 if unit is None or own is None else _ratio(unit, own)
    if isinstance(keys.unit, float):
        vertical = keys.unit
    plain = 1.0 if keys.unit is None else vertical  # of lengths without a unit
    lateral = (plain if axis.unit is None or own is None else _ratio(axis.unit, own) for axis in scan.axes)
    return vertical, tuple(lateral), taken


def _refuse_open(scan: Scan, keys: Keys, own: Length | None, needed: Sequence[ScanAxis]) -> None:
    """Refuse what neither the file nor the keys say."""
    lateral = [axis.unit for axis in needed if axis.unit]
    said = next((axis.unit for axis in scan.axes if axis.unit), None)
    if isinstance(keys.unit, str) and own is None:
        raise TableError(
            f"{scan.file}: punch.unit is {keys.unit}, but the configuration has no units; {_ADD_UNITS}, or "
            "give unit as a number, its length in the configuration's"
        )
    known = scan.unit or keys.unit is not None
    sized = keys.size or all(axis.length is not None or axis.positions is not None for axis in scan.axes)
    of_heights = keys.unit is None and bool(_OF_HEIGHTS.search(scan.doubt))
    if scan.doubt and (of_heights or not (known and sized)):
        missing = " and ".join(["punch.unit"] * (of_heights or not known) + ["punch.size"] * (not sized))
        raise TableError(
            f"{scan.file}: {scan.doubt} may say a length or a unit, but is not understood; give {missing}"
        )
    if scan.unit is None and keys.unit is None and said:
        raise TableError(
            f"{scan.file}: says lengths in {said}, but no unit of heights; give punch.unit, {said} or another"
        )
    if 0 < len(lateral) < len(needed):
        raise TableError(f"{scan.file}: says the unit of one direction only; give punch.size")
    if scan.unit and keys.unit is None and needed and not lateral:
        raise TableError(
            f"{scan.file}: says heights in {scan.unit}, but x and y have no unit; give punch.size, the "
            "lengths of the scan, or punch.unit for all"
        )


_OF_HEIGHTS = re.compile(r"scale|factor|mult|bit|gain|unit", re.IGNORECASE)  # what heights are times
_ADD_UNITS = "add units: {length: ..., stress: ..., time: ...}"


def _own_unit(scan: Scan, keys: Keys, grid: Grid, needed: Sequence[ScanAxis]) -> Length | None:
    """Return the unit of length of a configuration without units, where the file has units."""
    lateral = [axis.unit for axis in needed if axis.unit]
    if isinstance(keys.unit, float) and (scan.unit or not lateral):
        return Length(scan.unit.size / keys.unit, "") if scan.unit else None
    if not (scan.unit or lateral):
        return None
    lengths = [_ratio(axis.unit, lateral[0]) * (axis.length or 0.0) for axis in needed if axis.unit]
    if len(lengths) == len(grid.period) and np.allclose(lengths, grid.period, rtol=ROUNDING, atol=0):
        return lateral[0]  # the cell has the size of the scan in this unit
    unit = scan.unit or lateral[0]
    raise TableError(
        f"{scan.file}: says {'heights' if scan.unit else 'lengths'} in {unit}, but the configuration has no "
        f"units; {_ADD_UNITS}, or give punch.unit, the length of 1 {unit} in the configuration's"
    )


def _ratio(unit: Length, into: Length) -> float:
    """Return a unit in another one; exact powers of ten."""
    ratio = unit.size / into.size
    return float(f"{ratio:.15g}")


def _check_size(scan: Scan, keys: Keys, size: Sequence[float | None], grid: Grid, unit: str) -> None:
    """Refuse a size that is not the cell's."""
    if not np.allclose(np.array(size, dtype=float), grid.period, rtol=ROUNDING, atol=0):
        which = "punch.size is" if keys.size else f"{scan.file}: is"
        given = f" (with unit = {keys.unit})" if keys.unit is not None and not keys.size else ""
        swapped = len(size) == 2 and np.allclose(np.array(size[::-1], float), grid.period, rtol=ROUNDING)
        hint = "; transpose: true exchanges x and y" if swapped and not keys.size else ""
        raise TableError(
            f"{which} {lengths_in_words(size)}{unit} long{given}, but grid.period is "
            f"{lengths_in_words(grid.period)}{unit}; must agree within a thousandth: change grid.period, or "
            f"give punch.size (lengths of the scan){_or_unit(scan)}{hint}"
        )


def _or_unit(scan: Scan) -> str:
    """Offer the key for the unit where the file has none of its lengths."""
    said = any(axis.unit for axis in scan.axes)
    return "; punch.unit is for lengths without a unit" if said else ", or punch.unit"


def without_holes(scan: Scan, keys: Keys) -> tuple[FloatArray, str]:
    """Return heights with NaN for the number that marks a hole, and words; TableError for a probable one."""
    values = scan.heights
    if isinstance(keys.hole, float):
        mark = np.isclose(values, keys.hole, rtol=1e-6, atol=0) | (values == keys.hole)
        return np.where(mark, np.nan, values), f", marked by {keys.hole:g}" if mark.any() else ""
    if keys.hole is None and (found := _probable_hole(values)) is not None:
        mark, count = found
        raise TableError(
            f"{scan.file}: {count} of {values.size} heights are {mark:.9g}, far from all others: probably "
            f"points without a height; give punch.hole: {mark:.9g}, or hole: none if they are heights"
        )
    return values, ""


def refuse_heights(file: Path | str, heights: FloatArray, bad: BoolArray) -> None:
    """Raise TableError at the first bad height, if there is one."""
    if bad.any():
        where, first = np.argwhere(bad)[0].tolist(), heights[bad][0]
        size = "not a finite number" if np.isnan(first) else "infinite" if np.isinf(first) else "too large"
        allowed = f"; must be up to {LARGEST:g}" * bool(np.isfinite(first))
        raise TableError(f"{file}: the height at index {where} is {size}{allowed}")


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
    if span > period * (1 + ROUNDING):
        raise TableError(
            f"{scan.file}: is {span:.6g}{unit} long, but grid.period is {period:.6g}{unit}; must not be "
            f"longer: change grid.period{_or_unit(scan)}"
        )
    if seam > max(widest, period / n) * (1 + ROUNDING):
        raise TableError(
            f"{scan.file}: x goes over {span:.6g}{unit}, but grid.period is {period:.6g}{unit}; the rest "
            f"must not be longer than the distance of neighbours, {widest:.6g}{unit}: change grid.period, to "
            f"at most {span + widest:.6g}{_or_unit(scan)}"
        )
    if widest > _WIDEST * period / n and not gaps:
        raise TableError(
            f"{scan.file}: neighbours are up to {widest:.6g}{unit} apart, from x = {x[where]:.6g} to "
            f"{x[where + 1]:.6g}; must be at most {_WIDEST:g} spacings of the grid, "
            f"{_WIDEST * period / n:.6g}: use fewer grid.points, or fill: membrane for straight lines across"
        )
    points = x[0] + np.arange(n) * (period / n)
    joined = (np.append(x, x[0] + period), np.append(heights, heights[0])) if seam > 0 else (x, heights)
    words = (
        f"x from {x[0]:.6g} to {x[-1]:.6g}{unit}, not equally spaced, neighbours at most {widest:.3g}{unit} "
        f"apart; interpolated linearly onto {n} points"
    )
    return np.interp(points, *joined), words


def axis_of(file: Path, name: str, x: FloatArray, unit: Length | None) -> ScanAxis:
    """Return the axis of increasing positions."""
    steps = np.diff(x)
    if not (np.isfinite(x).all() and x.size > 1 and steps.min() > 0):
        order = (
            "decreases in places"
            if x.size and np.isfinite(x).all() and steps.size and steps.min() < 0
            else ""
        )
        same = f"is {x[np.argmin(steps)]:g} twice" if not order and steps.size and steps.min() == 0 else ""
        wrong = order or same or "is no row of numbers"
        raise TableError(f"{file}: {name} is not equally spaced, increasing: it {wrong}")
    spacing = float(x[-1] - x[0]) / (x.size - 1)
    drift = np.abs(x - x[0] - spacing * np.arange(x.size)).max()
    if np.abs(steps - spacing).max() <= ROUNDING * spacing and drift < 0.05 * spacing:
        return ScanAxis(spacing * x.size, unit)
    return ScanAxis(None, unit, x)
