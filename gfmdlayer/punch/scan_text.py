"""Measured surfaces in text: matrices of heights with their headers, and columns x, y and height.

The rows of a matrix are y, its columns x, and the first row is y = 0. A size is the spacing times the number
of points. Columns go by their headings; without headings they are x, height on a line and x, y, height on a
surface, where each point of an equally spaced grid must occur once. Headers are those of Gwyddion in its
languages, SPIP, Nova, WSxM, ESRI and others. Keys must settle a line of a header that may say a length or a
unit, but is not understood.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.files.headings import is_known, meaning
from gfmdlayer.files.tables import Answers, Matrix, TableError, read_matrix
from gfmdlayer.punch.scan import ROUNDING, Length, Scan, ScanAxis, axis_of, length_unit

_COLUMNS = {1: ("x", "height"), 2: ("x", "y", "height")}


def read_text(file: Path, axes: int, answers: Answers) -> Scan:
    """Read a text of heights on so many axes; TableError where it has no certain meaning."""
    matrix = read_matrix(file, answers)
    if sum(map(is_known, matrix.headings)) > 1:
        return _of_points(matrix, _named(axes, matrix, answers), "")
    matrix = _with_axis_in_headings(matrix)
    header = _Header.of(matrix)
    rows, width = matrix.shape
    if width == axes + 1 and any(matrix.headings) and not any(map(_SAYS.search, matrix.headings)):
        raise TableError(
            f"{file}: the headings are {', '.join(map(repr, matrix.headings))}; must be {_in_words(axes)}"
        )
    if axes == 1 and width != 2:
        raise TableError(f"{file}: holds {width} columns; must be two, x and height, on a line")
    if axes == 2 and width == 2:
        raise TableError(
            f"{file}: holds two columns, as x and height of a line, but grid.points is of a surface"
        )
    if axes == 1 or (width == 3 and rows > 3 and not header.of_matrix):
        names = _COLUMNS[axes]
        columns = (_PointColumn(matrix.values[:, c], header.units.get(name)) for c, name in enumerate(names))
        return _of_points(matrix, dict(zip(names, columns, strict=True)), header.doubt)
    return _of_matrix(matrix, header)


_SAYS = re.compile(r"[:=]$|^[#%]$")  # a cell of a remark or of a line of a header


def _in_words(axes: int) -> str:
    return "x and height" if axes == 1 else "x, y and height (or z)"


def _marks(matrix: Matrix) -> tuple[str, ...]:
    """Return what is unusual in how a text is written."""
    parts = matrix.account.split("; ")[1:]
    return tuple(part for part in parts if not part.endswith(("not read", "hole", "holes")))


# Points in columns.


class _PointColumn(NamedTuple):
    """A column of a table of points."""

    values: FloatArray
    unit: Length | None


def _named(axes: int, matrix: Matrix, answers: Answers) -> dict[str, _PointColumn]:
    """Return the columns x, (y) and height by their headings."""
    file, wanted = matrix.path, _COLUMNS[axes]
    found: dict[str, tuple[str, _PointColumn]] = {}
    for heading, below, values in zip(matrix.headings, matrix.units, matrix.values.T, strict=True):
        means = meaning(heading, below, wanted, answers.units)
        if axes == 2 and "y" in means.options:  # which on a line is a height
            means = meaning(heading, below, ("x", "y"), answers.units)
        asked = [each for each in means.options if each in wanted]
        if not asked:
            continue
        if means.reason:
            raise TableError(f"{file}: the heading {heading!r} {means.reason}")
        if (name := asked[0]) in found:
            raise TableError(
                f"{file}: two columns are {name}, {found[name][0]!r} and {heading!r}; must be one"
            )
        unit = Length(float(means.unit.size), means.symbol) if means.unit is not None else None
        found[name] = heading, _PointColumn(values, unit)
    if missing := [name for name in wanted if name not in found]:
        headings = ", ".join(map(repr, matrix.headings))
        raise TableError(
            f"{file}: no heading is {' or '.join(missing)} among {headings}; must be {_in_words(axes)}"
        )
    columns = {name: found[name][1] for name in wanted}
    for heading, flags in zip(matrix.headings, matrix.values.T, strict=True):
        if heading.strip().lower() == "valid":  # 1 or 0
            height = columns["height"]
            columns["height"] = height._replace(values=np.where(flags == 0, np.nan, height.values))
    return columns


def _of_points(matrix: Matrix, columns: dict[str, _PointColumn], doubt: str) -> Scan:
    """Return the scan of points, which may have any order."""
    file, height, written = matrix.path, columns["height"], _marks(matrix)
    across = {name: column for name, column in columns.items() if name != "height"}
    for name, column in across.items():
        if not np.isfinite(column.values).all():
            row = int(np.argmin(np.isfinite(column.values))) + 1
            raise TableError(f"{file}: {name} is no number in row {row} of the table")
    layout = (
        f"columns {', '.join(columns)}" if any(matrix.headings) else f"columns {', '.join(columns)} by order"
    )
    if len(across) == 1:
        order = np.argsort(across["x"].values, kind="stable")
        axis = axis_of(file, "x", across["x"].values[order], across["x"].unit)
        return Scan(file, height.values[order], height.unit, (axis,), layout, written, doubt)
    (ix, nx, dx), (iy, ny, dy) = (_levels(file, name, column.values) for name, column in across.items())
    counts = np.bincount(ix * ny + iy, minlength=nx * ny)
    if (counts != 1).any():
        at = int(np.argmax(counts != 1))
        state = "missing" if counts[at] == 0 else f"there {counts[at]} times"
        raise TableError(
            f"{file}: holds {ix.size} points x, y, z with {nx} values of x and {ny} of y; each point must "
            f"occur once, but value {at // ny + 1} of x with value {at % ny + 1} of y is {state}"
            f"{'; give it the height nan' if counts[at] == 0 else ''}"
        )
    heights = np.empty((nx, ny))
    heights[ix, iy] = height.values
    axes = ScanAxis(nx * dx, across["x"].unit), ScanAxis(ny * dy, across["y"].unit)
    return Scan(file, heights, height.unit, axes, layout, written, doubt)


def _levels(file: Path, name: str, values: FloatArray) -> tuple[IntArray, int, float]:
    """Return the number of each position on an equally spaced axis, their count and spacing."""
    order = np.sort(values)
    steps = np.diff(order)
    widest = float(steps.max(initial=0.0))
    count = 1 + int((steps > 0.5 * widest).sum())  # positions of one value differ by rounding
    if not widest > 0:
        raise TableError(
            f"{file}: {name} of the points x, y, z is always {order[0]:g}; must be two values or more"
        )
    spacing = float(order[-1] - order[0]) / (count - 1)
    # Positions may be rounded to the digits that are written.
    shifted = (values * 10.0**k for k in range(16))
    digits = next((k for k, x in enumerate(shifted) if np.allclose(x, np.rint(x), rtol=0, atol=1e-6)), 16)
    allowed = max(ROUNDING, min(0.05, 0.501 * 10.0**-digits / spacing)) * spacing
    index = np.rint((values - order[0]) / spacing).astype(np.int64)
    wrong = np.abs(values - order[0] - index * spacing)
    if wrong.max() > allowed:
        row = int(np.argmax(wrong))
        raise TableError(
            f"{file}: three columns are x, y and height of points, but {name} is not equally spaced: {count} "
            f"values, {spacing:.6g} apart in the mean, and {values[row]:.6g} in row {row + 1}; a matrix of "
            "heights with three columns needs a header with its size"
        )
    return index, count, spacing


# Matrices of heights.


def _of_matrix(matrix: Matrix, header: _Header) -> Scan:
    """Return the scan of rows of heights: each row is a y, each column an x."""
    file, values, layout = matrix.path, matrix.values, "rows are y, columns x"
    x, y = (ScanAxis(header.sizes.get(name), header.units.get(name)) for name in "xy")
    if _has_axes(values):
        layout += ", with x in the first row and y in the first column"
        x, y = axis_of(file, "x", values[0, 1:], x.unit), axis_of(file, "y", values[1:, 0], y.unit)
        values = values[1:, 1:]
    elif _counts_columns(values):
        raise TableError(f"{file}: the first row of the matrix counts its columns; remove it")
    rows, columns = values.shape
    for name, found, words in (("x", columns, "columns"), ("y", rows, "rows")):
        if (said := header.counts.get(name, found)) != found:
            raise TableError(f"{file}: holds {found} {words} of heights; its header says {said}")
    if spacing := header.spacings:
        x = replace(x, length=spacing["x"] * columns) if "x" in spacing else x
        y = replace(y, length=spacing["y"] * rows) if "y" in spacing else y
    if header.hole is not None:
        values = np.where(values == header.hole, np.nan, values)
    doubt = header.doubt
    if (x.length is None) is not (y.length is None):
        doubt = doubt or "the header, which has a length in one direction only,"
        x, y = replace(x, length=None), replace(y, length=None)
    heights = np.ascontiguousarray(values.T) * header.factor
    return Scan(file, heights, header.units.get("height"), (x, y), layout, _marks(matrix), doubt)


def _with_axis_in_headings(matrix: Matrix) -> Matrix:
    """Return a matrix whose headings are a word and numbers with these numbers, x, in its first row."""
    numbers = [heading.replace(matrix.decimal, ".") for heading in matrix.headings[1:]]
    if len(numbers) < 2 or not all(
        re.fullmatch(r"[-+]?\d*\.?\d+(?:[eE][-+]?\d+)?", each) for each in numbers
    ):
        return matrix
    first = np.array([np.nan, *map(float, numbers)])
    return replace(matrix, values=np.vstack((first, matrix.values)), headings=[])


def _has_axes(values: FloatArray) -> bool:
    """Whether the first row is x and the first column y: equally spaced, unlike the heights beside them."""
    if min(values.shape) < 4 or not (np.isnan(values[0, 0]) or values[0, 0] == 0):
        return False
    return _evenly(values[0, 1:]) and _evenly(values[1:, 0]) and not _evenly(values[1, 1:])


def _counts_columns(values: FloatArray) -> bool:
    """Whether the first row is 0, 1, 2, ... or 1, 2, 3, ..., and the second is not alike."""
    first = values[0] - np.arange(values.shape[1])
    return len(first) > 3 and first[0] in {0.0, 1.0} and not np.ptp(first) and not _evenly(values[1])


def _evenly(values: FloatArray) -> bool:
    """Whether values increase in equal steps."""
    steps = np.diff(values)
    return bool(steps[0] > 0 and np.allclose(steps, steps[0], rtol=0.01, atol=0))


# Headers, in the words of the programs that write them.

_SEVERAL = re.compile(r"([^\W\d][\w -]*?)\s*=\s*(\d+)(?=\s|$)")  # h=650 w=650
_ENTRY = re.compile(
    r"(?P<label>[^\W\d].*?)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^()]*)\))?"
    r"\s*(?:[:=：;,\t]\s*|\s+(?=[-+.\d]))(?P<value>[^\s:=].*)"
)
_VALUE = re.compile(
    r"(?P<number>[-+]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][-+]?\d+)?)\s*[;,\t]?\s*[\[(]?(?P<unit>[^\])]*)[\])]?[\s;,]*"
)
_FACTOR = re.compile(
    r"height conversion factor \(->\s*(?P<unit>[^)]+)\)\s*[=:]\s*(?P<number>[-+.\deE]+)", re.IGNORECASE
)
_LABELS = {
    "x": "width|šířka|breite|anchura|largeur|larghezza|幅|폭|largura|ширина|x-length|x length|length x|"
    "xlength|x size|size x|xsize|x range|range x|scan size x|x scan size|scan width|x amplitude|länge x|"
    "x dimension",
    "y": "height|výška|höhe|altura|hauteur|altezza|高さ|높이|высота|y-length|y length|length y|ylength|"
    "y size|size y|ysize|y range|range y|scan size y|y scan size|scan height|y amplitude|länge y|y dimension",
    "xy": "scan size|scan range|scan area|image size|size|field of view",
    "unit": "value units|value unit|jednotky hodnot|einheiten|unités|unità valore|値の単位|값 단위|"
    "unidades de valor|единицы измерения|z-unit|z unit|z units|unit z|unit data|data unit|height unit|"
    "height units|zunit",
    "unit of xy": "lateral units|lateral unit|x-y units|xy unit|xy units|xy-units",
    "unit of x": "x-unit|x unit|unit x|xunit",
    "unit of y": "y-unit|y unit|unit y|yunit",
    "spacing of xy": "pixel size|pixelsize|cellsize|cell size|grid spacing|pixel spacing|point spacing|"
    "spacing",
    "spacing of x": "scale x|x spacing|spacing x|x step|dx|x increment|x pixel size|pixel size x",
    "spacing of y": "scale y|y spacing|spacing y|y step|dy|y increment|y pixel size|pixel size y",
    "count of x": "w|x-pixels|x pixels|nx|ncols|columns|number of columns|pixels x|points x|x points|cols",
    "count of y": "h|y-pixels|y pixels|ny|nrows|rows|number of rows|pixels y|points y|y points|lines|"
    "number of lines",
    "hole": "nodata value|nodata|no data value",
}  # fmt: skip
_LABEL = {name: label for label, names in _LABELS.items() for name in names.split("|")}
_DOUBTFUL = re.compile(
    r"scale|factor|unit|size|length|width|height|pixel|spacing|pitch|increment|range|amplitude|resolution|"
    r"mult|bit2nm|wavelength|einheit|größe|länge|breite|höhe|abstand|schritt|faktor|taille|largeur|hauteur|"
    r"échelle|unité|facteur",
    re.IGNORECASE,
)


class _UnknownUnitError(Exception):
    """A line of a header has a unit that is no known length."""


@dataclass
class _Header:
    """What the lines above a matrix say."""

    matrix: Matrix
    sizes: dict[str, float] = field(default_factory=dict)  # lengths along x and y
    spacings: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)  # of columns, x, and rows, y
    units: dict[str, Length] = field(default_factory=dict)  # of x, y and height
    factor: float = 1.0  # of heights
    hole: float | None = None
    doubt: str = ""  # a line that may say more
    of_factor: bool = False  # whether the unit of heights is that of a conversion factor

    @classmethod
    def of(cls, matrix: Matrix) -> _Header:
        """Read the lines above a matrix; TableError for ambiguous numbers."""
        header = cls(matrix)
        for line in matrix.header:
            plain = re.sub(r"^[\s#%;!*/\"]+|[\s;,\"]+$", "", line)
            try:
                doubtful = not header._take_line(line.strip(), plain) and _is_doubtful(plain)
            except _UnknownUnitError:
                doubtful = True
            if doubtful and not header.doubt:
                header.doubt = f"the line {line.strip()[:60]!r}"
        for one, other in ("xy", "yx"):
            if (
                one in header.units
                and other not in header.units
                and other not in header.sizes | header.spacings
            ):
                header.units[other] = header.units[one]
        return header

    @property
    def of_matrix(self) -> bool:
        """Whether the size or the number of rows and columns are said."""
        return bool(self.sizes or self.counts or self.spacings)

    def _take_line(self, line: str, plain: str) -> bool:
        """Take a line; whether it is understood."""
        if match := _FACTOR.search(plain):
            self.factor, self.of_factor = self._number(line, match["number"]), True
            self.units["height"] = self._unit(match["unit"])
            return True
        cells = re.split(r"[\s;,|]+", plain)
        units = [unit for unit in map(length_unit, cells) if unit]
        names = {2: ("x", "height"), 3: ("x", "y", "height")}.get(self.matrix.shape[1], ())
        if len(units) == len(cells) == len(names):  # a row of units
            self.units |= dict(zip(names, units, strict=True))
            return True
        several = _SEVERAL.findall(plain)
        entries = [(*each, "") for each in several] if len(several) > 1 else _entries(plain)
        taken = [self._take(line, *entry) for entry in entries]
        return any(taken)

    def _take(self, line: str, label: str, value: str, bracket: str) -> bool:
        """Take a value with its label, and the unit in brackets behind that; whether it is understood."""
        kind, _, axes = _LABEL.get(re.sub(r"[\s_]+", " ", label).strip().lower(), "").partition(" of ")
        if kind == "unit":
            if axes:
                self._agree(self.units, axes, unit := self._unit(value))
                self.units = dict.fromkeys("xy", unit) | self.units  # a single one is for both
            elif not self.of_factor and value.strip() not in {"1", "-"}:
                self._agree(self.units, ("height",), self._unit(value, factor=True))
            return True
        values = [_VALUE.fullmatch(part.strip()) for part in re.split(r"\s+[x×*]\s+", value)]
        numbers = [match for match in values if match]
        if not kind or not numbers or len(numbers) < len(values):
            return False
        if kind == "xy":
            return len(numbers) == 2 and all(
                self._length(line, self.sizes, name, match, numbers[1]["unit"] or bracket)
                for name, match in zip("xy", numbers, strict=True)
            )
        if len(numbers) > 1:
            return False
        if kind in {"x", "y"}:
            return self._length(line, self.sizes, kind, numbers[0], bracket)
        if kind == "spacing":
            return self._length(line, self.spacings, axes, numbers[0], bracket)
        number = self._number(line, numbers[0]["number"])
        if numbers[0]["unit"].strip() or (kind == "count" and not number.is_integer()):
            return False
        if kind == "hole":
            self.hole = number
        else:
            self.counts[axes] = int(number)
        return True

    def _length(
        self, line: str, into: dict[str, float], axes: str, match: re.Match[str], bracket: str
    ) -> bool:
        """Take a length along axes, with its unit if there is one."""
        number, symbol = self._number(line, match["number"]), match["unit"].strip() or bracket.strip()
        if not number > 0:
            raise TableError(f"{self.matrix.path}: {line!r}: must be > 0")
        if symbol:
            self._agree(self.units, axes, self._unit(symbol))
        self._agree(into, axes, number)
        return True

    def _agree(self, into: dict[str, Any], axes: Iterable[str], value: Any) -> None:
        """Keep a value for axes; TableError where the header says another one."""
        for axis in axes:
            if (earlier := into.setdefault(axis, value)) != value:
                said = f"its header says {earlier} and {value} for {axis}"
                raise TableError(f"{self.matrix.path}: {said}; remove one of the two")

    def _unit(self, text: str, *, factor: bool = False) -> Length:
        """Return a unit of length; a factor that follows may convert heights in another unit."""
        text = text.strip(" ;,\t[]()")
        if unit := length_unit(text):
            return unit
        if factor and any(map(_FACTOR.search, self.matrix.header)):
            return Length(1.0, text)
        raise _UnknownUnitError

    def _number(self, line: str, text: str) -> float:
        """Return a number of a header, whose decimal mark need not be that of the matrix."""
        marks = re.findall("[.,]", text)
        whole, _, digits = re.split("[eE]", text)[0].replace(",", ".").partition(".")
        if len(marks) == 1 and marks[0] != self.matrix.decimal and len(digits) == 3 and whole.strip("+-0"):
            raise TableError(
                f"{self.matrix.path}: {line!r}: {text} has a decimal mark or a mark of thousands; remove the "
                "line and give punch.size"
            )
        if len(marks) > 1 and marks[-1] in marks[:-1]:
            raise TableError(f"{self.matrix.path}: {line!r}: cannot read the number {text}")
        if len(marks) > 1:
            text = text.replace(marks[0], "")
        return float(text.replace(",", "."))


def _entries(line: str) -> Iterator[tuple[str, str, str]]:
    """Yield label, value and the unit in brackets behind the label."""
    if match := _ENTRY.fullmatch(line):
        yield match["label"], match["value"], match["square"] or match["round"] or ""


def _is_doubtful(line: str) -> bool:
    """Whether a line may say a length or a unit of the data."""
    if _DOUBTFUL.search(line) and re.search(r"[:=：;,\t]|\d", line):
        return True
    words = re.split(r"[\s,;|:=()\[\]]+", line)
    return any(len(word) > 1 and length_unit(word) is not None for word in words)
