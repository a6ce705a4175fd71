"""Tables of numbers in text files of users, in any dialect, with errors that name the line."""

from __future__ import annotations

import csv
import re
import shlex
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.errors import GfmdlayerError
from gfmdlayer.files.headings import (
    ANGULAR,
    BY_MODULUS,
    ORDINARY,
    WORDS,
    Meaning,
    alternatives,
    dimension_of,
    is_known,
    meaning,
    names_of,
    quantities_named,
    split,
    unit_in,
)
from gfmdlayer.files.units import Unit, unit_of

LARGEST = 1e30  # results computed from larger numbers may leave the range of double precision


class TableError(GfmdlayerError, ValueError):
    """A file of numbers cannot be used; the message names file, line if any, and allowed values."""


# Tables that people bring: text in any dialect.
#
# Each separator, decimal mark and mark of thousands is tried. A dialect stands only if the columns of
# numbers are numbers throughout, in rows of one width. If another dialect stands with other numbers, the
# file is refused. Columns have their meaning by name (`files.headings`), by position only without headings.


@dataclass(frozen=True)
class Answers:
    """What a user says about a file that does not say it itself, or not certainly."""

    decimal: str | None = None  # decimal mark, "." or ","
    units: tuple[tuple[str, str], ...] = ()  # by quantity or heading
    columns: tuple[str, ...] = ()  # names in place of the headings, with or without units; "-" for none
    modulus: str | None = None  # G: moduli and compliances are in shear; E: in tension
    table: int | None = None  # of several, counted from 1
    key: str = field(default="reading", compare=False)  # of the section with these answers; "" for options

    def to_give(self, key: str, value: str, of: str = "") -> str:
        """Write an answer, `of` a quantity, for a message that asks for it: as a key, or as an option."""
        if not self.key:
            return f"--{key} {shlex.quote(f'{of}={value}' if of else value)}"
        plain = value if value.isalnum() or of else repr(value)
        return f"{self.key}: {{{key}: {f'{{{of}: {plain}}}' if of else plain}}}"


def decoded(path: Path) -> tuple[str, str]:
    """Return the text of a file and its encoding: UTF-16 with or without a mark, UTF-8, or Windows-1252."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise TableError(f"{path}: cannot be read ({error.strerror or error})") from error
    wide = _utf_16(data)
    kinds = [wide] if wide else ["utf-8-sig", "cp1252", "latin-1"]
    for kind in kinds:
        try:
            text = data.decode(kind)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text, _ENCODINGS[kind]
    raise TableError(f"{path}: is not text")


def _utf_16(data: bytes) -> str:
    """Return the encoding UTF-16 by its mark, or by zeros in every second byte of an ASCII text, else ""."""
    if data[:2] in {b"\xff\xfe", b"\xfe\xff"}:
        return "utf-16"
    zeros = [data[odd:400:2].count(0) for odd in (0, 1)]
    if max(zeros) > 0.4 * len(data[:400:2]):
        return "utf-16-be" if zeros[0] > zeros[1] else "utf-16-le"
    return ""


def is_text(head: bytes) -> bool:
    """Whether the first bytes of a file are of a text."""
    wide = _utf_16(head)
    plain = head.replace(b"\0", b"") if wide else head
    return wide == "utf-16" or not re.search(rb"[\x00-\x08\x0e-\x19\x7f]", plain)


_ENCODINGS = {
    "utf-8-sig": "UTF-8", "utf-16": "UTF-16", "utf-16-be": "UTF-16", "utf-16-le": "UTF-16",
    "cp1252": "Windows-1252", "latin-1": "Latin-1",
}  # fmt: skip


class _Dialect(NamedTuple):
    """How a table is written."""

    separator: str
    decimal: str
    thousands: str = ""

    def __str__(self) -> str:
        marks = f"separator {_SEPARATORS[self.separator]}, decimal mark {self.decimal!r}"
        return f"{marks}, mark of thousands {self.thousands!r}" if self.thousands else marks

    @property
    def by_space(self) -> bool:
        """Whether white space separates the columns."""
        return self.separator in {" ", "  "}


_SEPARATORS = {"\t": "tab", ";": "';'", "|": "'|'", ",": "','", "  ": "two spaces", " ": "space"}
_PLAIN = (".", ""), (",", "")  # decimal mark, mark of thousands
_WITH_THOUSANDS = (".", ","), (",", "."), (".", "'"), (",", "'"), (".", " "), (",", " ")
_USUAL = _Dialect(",", "."), _Dialect("\t", "."), _Dialect("  ", "."), _Dialect(" ", ".")
_GROUPS = {",": ",", ".": r"\.", "'": "['’]", " ": "[ \xa0\u202f\u2009]"}  # marks of thousands as patterns
_IN_GROUPS = " \xa0\u202f\u2009’'"
_HOLES = {
    "", "nan", "n/a", "na", "n.a.", "-", "--", "---", "----", "–", "—", "*", "**", "***", "****", "bad",
    "#nv", "#n/a",
    "#na", "none", "null", "#wert!", "#value!", "#div/0!", "#zahl!", "#num!", "?", "missing", "invalid",
    "void",
    "1.#qnan", "-1.#ind", "1,#qnan", "-1,#ind", "-nan", "nan(ind)", "-nan(ind)", "nodata", "no data",
}  # fmt: skip
_COMMENT = re.compile(r"\s*(?:#|%|//|;|!|\*|\"#)+ *(?!\S*\d*[*]{2})")
_REMARK = re.compile(
    r"(?:(?<=\s)|^)#(?!(?:n/?a|nv|wert|value|div|zahl|num|null|bezug|ref)\b).*", re.IGNORECASE
)
# Cells of digits and marks, which are no words; but dates and times of the day are.
_JUNK = re.compile(
    r"[-+−<>~\d.,;:|'’\s\xa0\u202fEeDd]*\d[-+−<>~\d.,;:|'’\s\xa0\u202fEeDd]*|[-+]?inf(?:inity)?",
    re.IGNORECASE,
)
_CLOCK = re.compile(
    r"\d{1,4}([-./])\d{1,2}\1\d{1,4}(?:[ T]\d{1,2}:\d{2}(?::\d{2})?(?:[.,]\d+)?)?"
    r"|\d{1,2}:\d{2}(?::\d{2})?(?:[.,]\d+)?"
)
# Parts of numbers and another separator in one cell: the dialect is wrong.
_BETWEEN = re.compile(
    r"^[-+]?[\d.,]+(?:[eE][-+]?\d+)?\s*[;|\t]|[;|\t]\s*[-+]?[\d.,]+(?:[eE][-+]?\d+)?$|^\d[\d.,eE+-]*\s.*\s[-+]?\d[\d.,eE+-]*$"
)
_LOOKALIKE = str.maketrans("OolI", "0011")
_ABOVE = 8  # lines above the numbers in which headings are looked for


@cache
def _number(dialect: _Dialect) -> re.Pattern[str]:
    """Return the pattern of a number."""
    decimal = re.escape(dialect.decimal)
    whole = r"\d+"
    if dialect.thousands:
        group = _GROUPS[dialect.thousands]
        whole = rf"(?:[1-9]\d{{0,2}}(?:{group}\d{{3}})+|\d+)"
    fraction = rf"{decimal}\d*" if dialect.decimal == "." else rf"{decimal}\d+"
    return re.compile(rf"[-+−]?(?:{whole}(?:{fraction})?|{decimal}\d+)(?:[eEdD][-+−]?\d{{1,3}})?")


class _DialectError(TableError):
    """A dialect does not stand; `rows` tells how far it came."""

    def __init__(self, message: str, rows: float = 0) -> None:
        super().__init__(message)
        self.rows = rows


def _cells(line: str, separator: str) -> list[str]:
    """Split a line into cells without the white space around them."""
    if separator in {" ", "  "}:
        line = line.strip()
        if separator == "  ":
            return re.split(r"\t| {2,}", line)
        if '"' not in line:
            return re.split(r"[ \t]+", line)
        line = re.sub(r"[ \t]+", " ", line)
    if '"' in line:
        return [
            cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
        ]
    return [cell.strip() for cell in line.split(separator)]


def _kind(cell: str, number: re.Pattern[str]) -> str:
    """Return N for a number, H for a hole, T for other text."""
    return "N" if number.fullmatch(cell) else "H" if cell.lower() in _HOLES else "T"


@dataclass
class _Rows:
    """The rows of numbers of a file in one dialect."""

    path: Path
    lines: list[str]
    dialect: _Dialect
    at: Sequence[int]  # the line of each row, from 0
    values: FloatArray  # shape (rows, columns); NaN for holes and words
    kinds: str  # of each column: N, T, or H if it has nothing but holes
    holes: dict[int, list[tuple[int, str]]] = field(default_factory=dict)  # by column: rows and words
    words: dict[int, list[str]] = field(default_factory=dict)
    encoding: str = ""  # where it is not UTF-8
    sure: bool = True  # whether a mark that may separate thousands is certain

    @property
    def width(self) -> int:
        """Number of columns, without empty ones at the end."""
        return int(self.values.shape[1])

    def place(self, row: int) -> str:
        """Return file and line of a row."""
        return f"{self.path}:{self.at[row] + 1}"


def _rows_in(path: Path, lines: list[str], dialect: _Dialect, answers: Answers) -> _Rows:
    """Find the rows of numbers in a dialect; a _DialectError where it does not stand."""
    if (
        answers.table is None
        and not dialect.thousands
        and (rows := _at_once(path, lines, dialect)) is not None
    ):
        return rows
    number = _number(dialect)
    blocks: list[list[tuple[int, list[str], str]]] = []
    gap = True  # whether something else than rows, blank lines and comments came since the last row
    for i, line in enumerate(lines):
        if "#" in line and re.match(r"\s*[-+.]?\d", line):
            line = _REMARK.sub("", line)
        cells = _cells(line, dialect.separator)
        if not any(cells):
            continue
        kinds = "".join([_kind(cell, number) for cell in cells])
        last = blocks[-1][-1] if blocks and not gap else None
        comment = kinds[0] == "T" and _is_comment(line, dialect)
        last = blocks[-1][-1] if blocks and not gap else None
        same = not comment and last is not None and len(kinds) == len(last[2])
        same = same and _agree(kinds, blocks[-1][0][2]) and ("N" in kinds or "T" not in kinds)
        full = not comment and "N" in kinds and len(kinds) - kinds.count("T") > 1
        if same or (full and not _is_units(cells)) or (not comment and _is_empty_row(cells, kinds)):
            if last is None or len(last[2]) != len(kinds):
                if last is not None and len(blocks[-1]) > 1:
                    message = f"holds {len(kinds)} columns; must be {len(last[2])}, as above"
                    raise _DialectError(f"{path}:{i + 1}: {_shown(line, '')} {message}", len(blocks[-1]))
                blocks.append([])
            blocks[-1].append((i, cells, kinds))
            gap = False
        elif comment:
            gap = gap or _names_columns(line, dialect)
        else:
            words = [cell for cell, k in zip(cells, kinds, strict=True) if k == "T"]
            damaged = any(map(_is_junk, words))
            damaged = damaged or (last is not None and ("N" in kinds or _has_numbers(line, number)))
            if (blocks and damaged) or all(map(_is_marks, words or [""])):
                message = f"{_shown(line, ''.join(words[:1]))} is not a row of numbers like those above"
                raise _DialectError(f"{path}:{i + 1}: {message}", len(blocks[-1]) if blocks else 0)
            gap = True
    return _chosen_block(path, lines, dialect, blocks, answers)


def _is_empty_row(cells: list[str], kinds: str) -> bool:
    """Whether a row has nothing but words for holes, and is no rule of dashes or stars."""
    return len(cells) > 1 and {*kinds} == {"H"} and all(cells) and not all(map(_is_rule, cells))


def _is_rule(cell: str) -> bool:
    return set(cell) <= {*"-–—*"}


def _agree(kinds: str, first: str) -> bool:
    """Whether words are only where the first row has words."""
    return all(k != "T" or f == "T" for k, f in zip(kinds, first, strict=True))


def _chosen_block(
    path: Path,
    lines: list[str],
    dialect: _Dialect,
    blocks: list[list[tuple[int, list[str], str]]],
    answers: Answers,
) -> _Rows:
    """Return the rows of the only table, or of the one with a number."""
    table = answers.table
    first = next((i for i, block in enumerate(blocks) if len(block) > 1), len(blocks))
    long = blocks[first:]  # single rows above are remarks with numbers
    if not long:
        line = blocks[-1][0][0] if blocks else 0
        count = "1 row" if blocks else "no rows"
        raise _DialectError(f"{path}:{line + 1}: holds {count} of numbers; must be at least 2", len(blocks))
    for block in blocks:
        later = next((each for each in long if each[0][0] > block[-1][0]), None)
        if len(block) == 1 and later is not None:
            between = range(block[0][0] + 1, later[0][0])
            if (
                all(not lines[i].strip() or _is_comment(lines[i], dialect) for i in between)
                and "T" not in block[0][2]
            ):
                message = f"holds {len(block[0][1])} columns; must be {len(later[0][1])}, as below"
                raise _DialectError(
                    f"{path}:{block[0][0] + 1}: {_shown(lines[block[0][0]], '')} {message}", 1
                )
    if (len(long) > 1 and table is None) or not 1 <= (table or 1) <= len(long):
        ends = ", ".join(f"{block[0][0] + 1} to {block[-1][0] + 1}" for block in long)
        asked = " or ".join(answers.to_give("table", str(i)) for i in (1, len(long)))
        message = f"holds {len(long)} tables, in lines {ends}; give the number of one, {asked}"
        raise _DialectError(f"{path}: {message}", max(map(len, long)))
    block = long[(table or 1) - 1]
    return _columns_of(path, lines, dialect, block)


def _columns_of(
    path: Path, lines: list[str], dialect: _Dialect, block: list[tuple[int, list[str], str]]
) -> _Rows:
    """Convert the cells of rows to numbers; a _DialectError where a column has numbers and words."""
    width = len(block[0][1])
    values = np.full((len(block), width), np.nan)
    found = _Rows(path, lines, dialect, [i for i, _, _ in block], values, "")
    plain = str.maketrans(
        {"−": "-", "d": "e", "D": "e", dialect.decimal: "."} | dict.fromkeys(_IN_GROUPS, "")
    )
    marks, both = [], not dialect.thousands
    kinds = ""
    for c in range(width):
        cells = [row[1][c] for row in block]
        seen = "".join([row[2][c] for row in block])
        if "N" not in seen:
            junk = next((r for r, cell in enumerate(cells) if _is_junk(cell)), None)
            if junk is not None and seen[junk] == "T":
                raise _DialectError(_not_a_number(found, junk, cells[junk]), 1)
            kinds += "T" if "T" in seen else "H"
            found.words[c] = cells
            continue
        if "T" in seen:
            # The word is wrong, or the number where words are the rule.
            raise _DialectError(_not_a_number(found, seen.index("T"), cells[seen.index("T")]), len(block))
        kinds += "N"
        if "H" in seen:
            found.holes[c] = [(r, cells[r]) for r, kind in enumerate(seen) if kind == "H"]
            cells = ["nan" if kind == "H" else cell for cell, kind in zip(cells, seen, strict=True)]
        if dialect.thousands:
            groups = [len(re.findall(_GROUPS[dialect.thousands], cell)) for cell in cells]
            marked = [dialect.decimal in cell for cell in cells]
            both = both or any(count and mark for count, mark in zip(groups, marked, strict=True))
            both = both or any(count > 1 for count in groups)
            for r, count in enumerate(groups if any(marked) else ()):
                if count and not marked[r]:  # beside 1,234.5 there may be 1.234 with the wrong mark
                    raise _DialectError(_not_a_number(found, r, cells[r]), len(block))
            cells = [cell.replace(dialect.thousands, "") for cell in cells]
        marks += [cell for cell in cells if dialect.decimal in cell]
        values[:, c] = np.array([cell.translate(plain) for cell in cells], dtype=float)
    found.kinds = kinds
    while found.kinds.endswith("H") and not any(
        found.words[len(found.kinds) - 1]
    ):  # separators at the end of lines
        del found.words[len(found.kinds) - 1]
        found.kinds = found.kinds[:-1]
    found.values = values[:, : len(found.kinds)]
    found.sure = both and not _may_be_thousands(" ".join(marks), dialect)
    return found


def _not_a_number(rows: _Rows, row: int, cell: str) -> str:
    return f"{rows.place(row)}: {cell[:40]!r} in {_shown(rows.lines[rows.at[row]], cell)} is not a number"


def _is_marks(cell: str) -> bool:
    """Whether a cell has digits and marks only, and is no time or date: a number, written otherwise."""
    looks = _JUNK.fullmatch(cell.translate(_LOOKALIKE)) is not None and re.search(r"\d|inf", cell.lower())
    return bool(looks) and not _CLOCK.fullmatch(cell)


def _has_numbers(line: str, number: re.Pattern[str]) -> bool:
    """Whether half the words of a line, or more, are numbers."""
    words = re.split(r"[\s;|]+", line.strip())
    return 2 * sum(number.fullmatch(word) is not None for word in words) >= len(words)


def _is_junk(cell: str) -> bool:
    """Whether a cell is a number, written otherwise, or has numbers beside another separator."""
    return _is_marks(cell) or _BETWEEN.search(cell) is not None


def _may_be_thousands(text: str, dialect: _Dialect) -> bool:
    """Whether each decimal mark in a text of numbers may as well be a mark of thousands: 1,234."""
    if dialect.thousands or (dialect.decimal == "." and dialect.separator != ";"):
        return False  # a point is a decimal mark, but beside the separator of lands with a comma
    mark = re.escape(dialect.decimal)
    before = rf"(?<!\d)0\d*{mark}|(?<!\d){mark}\d|\d{{4}}{mark}"
    certain = rf"{before}|{mark}\d{{1,2}}(?!\d)|{mark}\d{{4}}|{mark}\d*[eEdD]"
    return dialect.decimal in text and re.search(certain, text) is None


def _at_once(path: Path, lines: list[str], dialect: _Dialect) -> _Rows | None:
    """Read plain rows by NumPy's reader, ten times as fast; None where it finds anything else."""
    number, first = _number(dialect), None
    for i, line in enumerate(lines[:200]):
        kinds = "".join([_kind(cell, number) for cell in _cells(line, dialect.separator)])
        if set(kinds) <= {"N", "H"} and len(kinds) > 1 and (line.strip() or "N" in kinds):
            first = None if "H" in kinds else i
            break
    if first is None:
        return None
    body = lines[first:]
    text = "\n".join(body)
    if not text.isascii() or "n" in text or "N" in text:  # nan, inf, words
        return None
    if "#" in text:
        if any(line.lstrip()[:1] == "#" and _names_columns(line, dialect) for line in body):
            return None
        body = [_REMARK.sub("", line) for line in body]
    if dialect.decimal == ",":
        if dialect.separator == "," or "." in text or _may_be_thousands(text, dialect):
            return None
        body = [line.replace(",", ".") for line in body]
    elif dialect.separator == ";" and _may_be_thousands(text, dialect):
        return None
    delimiter, quote = None if dialect.by_space else dialect.separator, '"' if '"' in text else None
    try:
        values = np.loadtxt(body, delimiter=delimiter, comments=None, ndmin=2, quotechar=quote)
    except ValueError:
        return None
    if len(values) < 2 or not np.isfinite(values).all():
        return None
    at: Sequence[int] = range(first, first + len(values))
    if any(line.strip() for line in body[len(values) :]):
        at = [first + i for i, line in enumerate(body) if line.strip()]
    return _Rows(path, lines, dialect, at, values, "N" * values.shape[1])


def _is_damage(cell: str) -> bool:
    """Whether a cell stands for a number: one with a wrong letter, or a hole that is no rule of dashes."""
    return _is_marks(cell) or (cell.lower() in _HOLES and not _is_rule(cell))


def _is_comment(line: str, dialect: _Dialect) -> bool:
    """Whether a line begins with the mark of a comment, and not with an empty cell or a hole."""
    match = _COMMENT.match(line)
    if match is None or match[0].strip().startswith(dialect.separator):
        return False
    return _cells(line, dialect.separator)[0].lower() not in _HOLES


def _is_units(cells: Iterable[str]) -> bool:
    """Whether most cells are units, with brackets or without, and none is a number but 1."""
    filled = [cell for cell in cells if cell]
    units = [cell for cell in filled if _is_unit(cell)]
    return len(units) > len(filled) / 2 and any(not re.fullmatch(r"1|-+|%", unit) for unit in units)


def _is_unit(cell: str) -> bool:
    return unit_of(cell.strip("[]() ")) is not None


def _names_columns(line: str, dialect: _Dialect) -> bool:
    """Whether a comment has the headings of another table: several cells, half of them known names."""
    cells = [cell for cell in _cells(_COMMENT.sub("", line, count=1), dialect.separator) if cell]
    return len(cells) > 1 and 2 * sum(map(is_known, cells)) >= len(cells)


def _shown(line: str, word: str) -> str:
    """Quote a line, around the word that matters."""
    line = line.strip()
    start = max(line.find(word) - 30, 0) if word and len(line) > 60 else 0
    part = line[start : start + 60]
    return repr("…" * (start > 0) + part + "…" * (start + 60 < len(line)))


class _Head(NamedTuple):
    """The headings above the rows of numbers."""

    line: int  # from 0
    cells: list[str]
    units: list[str]  # the row of units below the headings, or empty texts
    known: int  # headings with the name of a quantity


def _head(rows: _Rows) -> _Head | None:
    """Find headings above the numbers: the row with most known names; None without headings.

    A _DialectError for damaged rows above the first, and for headings that are not those of these columns.
    """
    first, width = rows.at[0], rows.width
    found: list[_Head] = []
    for i in range(first - 1, max(first - _ABOVE, 0) - 1, -1):
        line = rows.lines[i]
        if not line.strip():
            continue
        splittings = list(_splittings(line, rows.dialect))
        fitting = [cells for cells in splittings if len(cells) == width and cells[0][-1:] not in {":", "="}]
        if fitting:
            cells = max(fitting, key=lambda row: sum(is_known(cell) or _is_unit(cell) for cell in row))
            found.append(_Head(i, cells, [""] * width, sum(map(is_known, cells))))
        elif i == first - 1:
            _refuse_other_headings(rows, i, splittings)
    named = [head for head in found if not _is_units(head.cells)] or found
    best = max(named, key=lambda head: head.known, default=None)
    if best is None or not best.known:
        nearest = next((head for head in found if head.line == first - 1), None)
        _refuse_numbers(rows, None)
        return nearest if nearest is not None and _may_be_headings(rows, nearest) else None
    # Units stand below the headings, or in the line above.
    units = next((head for head in found if head.line >= best.line - 1 and _is_units(head.cells)), None)
    _refuse_numbers(rows, best.line)
    return best if units is None else best._replace(units=units.cells)


_NAME_AND_UNIT = re.compile(r"[^\s\[(]+(?:\s*(?:\[[^\]]*\]|\([^)]*\)))?")


def _splittings(line: str, dialect: _Dialect) -> Iterator[list[str]]:
    """Yield the cells of a line above the numbers: in their dialect, and with another separator."""
    bare = _COMMENT.sub("", line, count=1) if _is_comment(line, dialect) else line
    texts = dict.fromkeys((line, bare))
    separators = ("  ", " ") if dialect.by_space else (dialect.separator,)
    for separator in (*separators, *_SEPARATORS):
        for text in texts:
            cells = _cells(text, separator)
            if separator in separators or (len(cells) > 1 and all(map(is_known, cells))):
                yield list(cells)
                while len(cells) > 1 and not cells[-1]:
                    cells.pop()
                    yield list(cells)
    if dialect.by_space:  # single spaces, also before units: omega [rad/s] G' [Pa]
        for text in texts:
            cells = _NAME_AND_UNIT.findall(text)
            if all(map(is_known, cells)):
                yield cells


def _refuse_numbers(rows: _Rows, head: int | None) -> None:
    """Refuse a damaged row above the numbers: below the headings a line with numbers that are no units.

    Without headings it is the line right above, if it has nothing but numbers, or as many cells.
    """
    number, first = _number(rows.dialect), rows.at[0]
    for i in range(max(first - 1, 0) if head is None else head + 1, first):
        line = rows.lines[i]
        cells = _cells(line, rows.dialect.separator)
        are = [number.fullmatch(cell) is not None for cell in cells]
        damaged = any(are) and (head is not None or all(are) or len(cells) == rows.width)
        damaged = damaged or (head is not None and any(map(_is_damage, cells)))
        labelled = len(cells) != rows.width and re.match(r"\s*[^\W\d_]{2}", line) is not None  # NODATA -9999
        damaged = damaged or (_has_numbers(line, number) and not labelled)
        if not damaged or _is_units(cells) or _is_comment(line, rows.dialect):
            continue
        wrong = cells[are.index(False)] if False in are else ""
        message = f"{_shown(line, wrong)} is not a row of numbers like those below"
        raise _DialectError(f"{rows.path}:{i + 1}: {message}", 1)


def _refuse_other_headings(rows: _Rows, i: int, splittings: list[list[str]]) -> None:
    """Refuse headings right above the numbers that are more or fewer than the columns."""
    for cells in splittings:
        if len(cells) > 1 and all(is_known(cell) for cell in cells if cell):
            message = f"names {len(cells)} columns; the rows below have {rows.width}"
            raise _DialectError(f"{rows.path}:{i + 1}: {_shown(rows.lines[i], '')} {message}", len(rows.at))


def _may_be_headings(rows: _Rows, head: _Head) -> bool:
    """Whether a row of unknown words right above the numbers has headings, and is no remark."""
    line = rows.lines[head.line]
    if _is_comment(line, rows.dialect):
        by_space = rows.dialect.by_space or rows.dialect.separator not in line
        return not by_space or any(re.search(r"\[.*\]|\(.*\)", cell) for cell in head.cells)
    return True


@dataclass(frozen=True)
class TextColumn:
    """A column of numbers as written; NaN where there is a hole."""

    heading: str  # "" without headings
    unit: Unit | None
    symbol: str  # the unit as written
    values: FloatArray
    holes: tuple[tuple[int, str], ...] = ()  # rows and words in place of numbers


@dataclass
class TextTable:
    """The columns of a file by quantity, and an account of how it was read."""

    path: Path
    columns: dict[str, TextColumn]
    words: dict[str, list[str]]  # columns of words
    refused: dict[str, str]  # why a quantity is not certain
    unread: dict[str, str]  # headings of other columns, and why they are not read
    lines: list[str]
    at: Sequence[int]  # the line of each row, from 0
    notes: list[str]  # on the dialect
    taken: dict[str, str] = field(default_factory=dict)  # what became of the quantities that were asked for

    def place(self, row: int) -> str:
        """Return file and line of a row."""
        return f"{self.path}:{self.at[row] + 1}"

    def take(self, quantity: str, into: str | None = None, *, holes: bool = False) -> FloatArray:
        """Return a column in a unit, that of the configuration.

        Without a unit in its heading, a column is taken in that unit. `into` is None where the configuration
        has no units. `holes` may be NaN; TableError for them otherwise, for numbers that are too large, and
        for a unit that cannot be converted.
        """
        if quantity not in self.columns:
            raise TableError(self._missing(quantity))
        column = self.columns[quantity]
        if column.holes and not holes:
            row, word = column.holes[0]
            shown = _shown(self.lines[self.at[row]], word)
            raise TableError(
                f"{self.place(row)}: {quantity} is {word or 'empty'!r} in {shown}; must be a number"
            )
        values, name = column.values, f"{column.heading or quantity!r}"
        if column.unit is None:
            self.taken[quantity] = f"{quantity} [{into}]" if into else quantity
        elif into is None and column.unit.dimension != _DIMENSIONLESS:
            raise TableError(
                f"{self.path}: {name} is in {column.symbol}, but the configuration has no units; add units: "
                "{length: ..., stress: ..., time: ...} to it, or leave the unit out of the heading"
            )
        else:
            values = converted(values, column.unit, into or "1", f"{self.path}: {name}", column.symbol)
            self.taken[quantity] = f"{quantity} [{into}]" if into else quantity
        wrong = np.flatnonzero(~(np.abs(values) <= LARGEST) & ~np.isnan(values))
        if wrong.size:
            raise TableError(
                f"{self.place(int(wrong[0]))}: {quantity} is too large; must be up to {LARGEST:g}"
            )
        return values

    def ascending(self, values: FloatArray, quantity: str) -> IntArray:
        """Return the order in which values ascend, where that of the rows has no meaning.

        TableError for equal values.
        """
        order = np.argsort(values, kind="stable")
        if (same := np.flatnonzero(np.diff(values[order]) == 0)).size:
            row, other = sorted((int(order[same[0]]), int(order[same[0] + 1])))
            message = f"{quantity} = {values[row]:g} again, as in line {self.at[row] + 1}; must differ"
            raise TableError(f"{self.place(other)}: {message}")
        return order

    def _missing(self, quantity: str) -> str:
        if quantity in self.refused:
            return f"{self.path}: {self.refused[quantity]}"
        known = ", ".join(names_of(quantity)[:8])
        heads = [column.heading for column in self.columns.values()] + list(self.unread)
        listed = ", ".join(map(repr, heads))
        return f"{self.path}: no column is named {quantity}; headings are {listed}; names are {known}"

    @property
    def account(self) -> str:
        """One line: rows, columns and their units, an unusual dialect, and what is not read."""
        parts = [f"{len(self.at)} rows"]
        for quantity, column in self.columns.items():
            unit = f" [{column.symbol}]" if column.unit is not None else " [no unit]"
            name = split(column.heading)[0]
            heading = f"{name}: " if name.lower() not in {"", quantity} else ""
            into = f" -> {self.taken[quantity]}" if quantity in self.taken else ""
            parts.append(f"{heading}{quantity}{unit}{into}")
        account = f"{self.path.name}: {', '.join(parts)}"
        holes = [
            f"{counted(len(column.holes), 'hole')} in {quantity}"
            for quantity, column in self.columns.items()
            if column.holes
        ]
        unread = [f"{heading!r} ({why})" for heading, why in self.unread.items()]
        return "; ".join(
            [account, *self.notes, *holes, *(["not read: " + ", ".join(unread)] if unread else [])]
        )


_DIMENSIONLESS = (0, 0, 0, 0, 0, 0, 0)


def converted(values: FloatArray, unit: Unit, into: str, where: str, symbol: str) -> FloatArray:
    """Convert numbers from a unit into another; TableError for a unit of another dimension."""
    target = unit_of(into)
    if target is None or target.dimension != unit.dimension:
        raise TableError(f"{where} is in {symbol}, which cannot be converted into {into}")
    ratio, shift = unit.size / target.size, (unit.offset - target.offset) / target.size
    if ratio.denominator == 1:
        scaled = values * float(ratio)
    elif ratio.numerator == 1:
        scaled = values / float(ratio.denominator)  # rounded once
    else:
        scaled = values * float(ratio)
    return scaled + float(shift) if shift else scaled


def read_table(
    path: Path,
    wanted: Sequence[str],
    answers: Answers | None = None,
    *,
    orders: Sequence[Sequence[str]] | None = None,
    apart: Collection[str] = (),
) -> TextTable:
    """Read the wanted quantities of a table in text.

    With headings the columns go by their names, in any order. Without headings they have one of the `orders`,
    by default that of `wanted`. Units of the quantities `apart` ask for none of the others. TableError where
    the file cannot be read with certainty.
    """
    answers = answers or Answers()
    rows, head = _only_reading(path, answers)
    heads, units = _headings(rows, head, answers)
    table = TextTable(path, {}, {}, {}, {}, rows.lines, rows.at, _notes(rows, head))
    if heads is None:
        order = next((each for each in orders or (wanted,) if len(each) == rows.width), None)
        if order is None:
            allowed = alternatives(f"{len(each)} numbers ({', '.join(each)})" for each in orders or (wanted,))
            raise TableError(
                f"{rows.place(0)}: holds {rows.width} numbers; must be {allowed}, or headings above"
            )
        heads, units = [""] * rows.width, [""] * rows.width
    else:
        order = ()
    for c, (heading, below) in enumerate(zip(heads, units, strict=True)):
        if order:
            means = _of_position(order[c], answers)
        elif heading in {"", "-"}:
            continue
        else:
            means = meaning(heading, below, wanted, answers.units, answers.modulus)
        _add_column(table, rows, c, heading, means, wanted, answers)
    if head is not None and not answers.columns and not (table.columns or table.words or table.refused):
        known = "; ".join(f"{quantity}: {', '.join(names_of(quantity)[:6])}" for quantity in wanted)
        shown = ", ".join(repr(cell) for cell in head.cells if cell)
        raise TableError(
            f"{path}:{head.line + 1}: no heading is known among {shown}; known names are {known}"
        )
    _refuse_mixture(table, apart, answers)
    return table


def _of_position(quantity: str, answers: Answers) -> Meaning:
    """Return the meaning of a column without a heading."""
    if answers.modulus == "E":
        quantity = next((tension for shear, tension in BY_MODULUS.values() if shear == quantity), quantity)
    given = (unit for name, unit in answers.units if quantity in quantities_named(name))
    if (symbol := next(given, None)) is None:
        return Meaning((quantity,))
    return meaning(names_of(quantity)[0], symbol, (quantity,))


def _add_column(
    table: TextTable,
    rows: _Rows,
    c: int,
    heading: str,
    means: Meaning,
    wanted: Sequence[str],
    answers: Answers,
) -> None:
    """Put a column into a table, or the reason why it is not read."""
    quantity = means.quantity
    asked = [each for each in means.options if each in wanted]
    if not means.options:
        table.unread[heading] = "not a known name"
    elif not asked:
        table.unread[heading] = "not asked for" if quantity else means.reason
    elif means.reason:
        reason = f"heading {heading!r} {means.reason}"
        if {ANGULAR, ORDINARY} <= {*means.options}:
            either = (answers.to_give("units", unit, "frequency") for unit in ("Hz", "rad/s"))
            reason += f", {' or '.join(either)}"
        table.refused.update(dict.fromkeys(asked, reason))
        table.unread[heading] = means.reason
    elif quantity in table.columns or quantity in table.words:
        assert quantity is not None
        other = table.columns[quantity].heading if quantity in table.columns else quantity
        table.refused[quantity] = (
            f"two columns are named {quantity}, {other!r} and {heading!r}; name only one so, "
            f"or all columns by {answers.to_give('columns', 'NAMES')}"
        )
        table.columns.pop(quantity, None)
        table.words.pop(quantity, None)
    elif quantity is not None and quantity in table.refused:
        table.unread[heading] = f"another {quantity}"
    elif quantity in WORDS:
        table.words[quantity] = rows.words.get(c) or [
            _cells(rows.lines[i], rows.dialect.separator)[c] for i in rows.at
        ]
    elif rows.kinds[c] != "N":
        table.refused[str(quantity)] = f"the column {heading!r} holds no numbers"
    else:
        holes = tuple(rows.holes.get(c, ()))
        table.columns[str(quantity)] = TextColumn(
            heading, means.unit, means.symbol, rows.values[:, c].copy(), holes
        )


def _refuse_mixture(table: TextTable, apart: Collection[str], answers: Answers) -> None:
    """Refuse quantities without a unit beside others with one."""
    having = [name for name, column in table.columns.items() if column.unit is not None and name not in apart]
    for name, column in list(table.columns.items()):
        if having and column.unit is None and dimension_of(name).dimension != _DIMENSIONLESS:
            table.refused[name] = f"{having[0]} has a unit, but {name} has none; give both, or neither"
            table.refused[name] += f", as by {answers.to_give('units', 'UNIT', names_of(name)[0])}"
            table.unread[column.heading] = "no unit"
            del table.columns[name]


def _headings(rows: _Rows, head: _Head | None, answers: Answers) -> tuple[list[str] | None, list[str]]:
    """Return the headings, with the names that are given in their place, and the units below them."""
    if not answers.columns:
        return (None, []) if head is None else (head.cells, head.units)
    given = list(answers.columns)
    if len(given) != rows.width:
        raise TableError(f"{rows.place(0)}: holds {rows.width} columns; columns names {len(given)}")
    for name in given:
        if name not in {"", "-"} and not is_known(name):
            raise TableError(f"{rows.path}: columns: {name!r} is not a known name")
    units = [""] * rows.width
    if head is not None:
        units = [
            below.strip("[]() ") or unit_in(cell) for cell, below in zip(head.cells, head.units, strict=True)
        ]
    for name, unit in zip(given, units, strict=True):
        if (own := split(name)[1]) and unit and unit_of(own) != unit_of(unit):
            raise TableError(
                f"{rows.path}: columns: {name!r}, but the file says {unit}; leave one of them out"
            )
    return given, units


def _only_reading(path: Path, answers: Answers) -> tuple[_Rows, _Head | None]:
    """Return the rows and headings of the only dialect that stands, or of several with the same numbers."""
    text, encoding = decoded(path)
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    found: list[tuple[_Rows, _Head | None]] = []
    reasons: list[_DialectError] = []
    for marks in (_PLAIN, _WITH_THOUSANDS):  # a reading without marks of thousands needs no other
        for dialect in [] if found else _plausible(text, lines, marks, answers.decimal):
            if dialect.by_space and any(rows.dialect.separator == "\t" for rows, _ in found):
                continue  # tabs are white space too
            try:
                rows = _rows_in(path, lines, dialect, answers)
                found.append((rows, _head(rows)))
            except _DialectError as error:
                reasons.append(error)
    found = [each for each in found if each[1] is not None and each[1].known] or found
    if not found:
        raise TableError(
            str(max(reasons, key=lambda each: each.rows, default=f"{path}:1: holds no rows of numbers"))
        )
    rows, head = found[0]
    asked = " or ".join(answers.to_give("decimal", mark) for mark in ".,")
    others = [other for other, _ in found[1:] if not _same_numbers(rows, other)]
    if others:
        ways = f"{rows.dialect}; or {others[0].dialect}"
        raise TableError(
            f"{path}: has two readings with other numbers: {ways}; say which is the decimal mark, {asked}"
        )
    if not rows.sure and answers.decimal is None:
        example = next(
            (word for i in rows.at for word in re.findall(r"\d+[.,]\d{3}(?!\d)", lines[i])), "1,234"
        )
        raise TableError(
            f"{path}: may have decimal marks or marks of thousands, as in {example}; say which is the "
            f"decimal mark, {asked}"
        )
    if encoding != "UTF-8":
        rows.encoding = encoding
    return rows, head


def counted(count: int, noun: str) -> str:
    """Write a number of things: 1 hole, 2 holes."""
    return f"{count} {noun}{'s' * (count != 1)}"


def _same_numbers(one: _Rows, other: _Rows) -> bool:
    """Whether two readings have the same columns of numbers."""
    a, b = (rows.values[:, [kind == "N" for kind in rows.kinds]] for rows in (one, other))
    return a.shape == b.shape and np.array_equal(a, b, equal_nan=True)


def _plausible(
    text: str, lines: list[str], all_marks: Iterable[tuple[str, str]], decimal: str | None
) -> Iterator[_Dialect]:
    """Yield dialects in which some lines are rows of numbers."""
    most = min(200, max(20, 50_000 * len(lines) // (len(text) + 1)))  # lines of a sample; few of long ones
    filled = [line for line in lines if line.strip()] if len(lines) < 2 * most else lines
    sample = [line for line in filled[:: max(1, len(filled) // most)] if line.strip()]
    for separator in _SEPARATORS:
        if not any(separator in line for line in sample):
            continue
        rows = [_cells(line, separator) for line in sample]
        for mark, thousands in all_marks:
            dialect = _Dialect(separator, mark, thousands)
            if (
                (decimal or mark) != mark
                or (separator == thousands and '"' not in text)
                or (mark == "," and "," not in text)
            ):
                continue
            if thousands and not re.search(rf"\d{_GROUPS[thousands]}\d{{3}}", text):
                continue
            good = sum(_is_plausible(cells, _number(dialect)) for cells in rows)
            if good >= max(1, len(sample) // 50):
                yield dialect


def _is_plausible(cells: list[str], number: re.Pattern[str]) -> bool:
    """Whether a line has numbers, and no other cells of digits and marks."""
    words = [cell for cell in cells if not number.fullmatch(cell)]
    return 1 < len(cells) > len(words) and not any(map(_is_junk, words))


def _notes(rows: _Rows, head: _Head | None) -> list[str]:
    """Return what is unusual in the way a file is written, for its account."""
    notes = [str(rows.dialect)] if rows.dialect not in _USUAL else []
    if rows.encoding:
        notes.append(rows.encoding)
    top = rows.at[0] if head is None else head.line
    above = [i + 1 for i in range(top) if rows.lines[i].strip()]
    below = [i + 1 for i in range(rows.at[-1] + 1, len(rows.lines)) if rows.lines[i].strip()]
    for kind, unread in (("above", above), ("below", below)):
        if unread:
            notes.append(f"{counted(len(unread), 'line')} {kind} not read")
    return notes


@dataclass(frozen=True)
class Matrix:
    """Rows of numbers of one width, and what stands above them."""

    path: Path
    values: FloatArray  # NaN where a number is missing
    header: list[str]  # lines above the numbers, as they are written
    headings: list[str]  # of the columns; none if no line above has as many cells
    units: list[str]  # a row of units below the headings, or empty texts
    account: str  # rows, columns, and how the file is written
    decimal: str = "."  # decimal mark

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        rows, columns = self.values.shape
        return rows, columns


def read_matrix(path: Path, answers: Answers = Answers()) -> Matrix:
    """Read rows of numbers of one width; holes are NaN. TableError where they are not certain."""
    rows, head = _only_reading(path, answers)
    if "T" in rows.kinds:
        c = rows.kinds.index("T")
        raise TableError(_not_a_number(rows, 0, rows.words[c][0]))
    if head is None or not head.known:  # below headings a rule is no row
        _refuse_empty_rows(rows)
    header = [line for line in rows.lines[: rows.at[0]] if line.strip()]
    count = f"{path.name}: {rows.values.shape[0]} rows of {rows.width} numbers"
    holes = int(np.isnan(rows.values).sum())
    account = "; ".join([count, *_notes(rows, head), *([counted(holes, "hole")] if holes else [])])
    headings, units = _headings(rows, head, answers)
    return Matrix(path, rows.values, header, headings or [], units, account, rows.dialect.decimal)


def _refuse_empty_rows(rows: _Rows) -> None:
    """Refuse rows of empty cells, and rules above the numbers: rows of a matrix without a height, or none."""
    taken = {*rows.at}
    for i in range(max(rows.at[0] - 1, 0), min(rows.at[-1] + 2, len(rows.lines))):
        line = rows.lines[i]
        cells = [] if i in taken or not line.strip(" ") else _cells(line, rows.dialect.separator)
        if len(cells) >= rows.width and all(map(_is_rule, cells)):
            message = "a row without a number; write nan where a height is missing, or remove the line"
            raise TableError(f"{rows.path}:{i + 1}: {message}")
