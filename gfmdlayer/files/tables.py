"""Numbers in files of users: columns of text, with errors that name the line."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray


LARGEST = 1e30  # results computed from larger numbers may leave the range of double precision

_SEPARATORS = str.maketrans(",;", "  ")

RowError = Callable[[Sequence[float]], str | None]
Line = tuple[int, str, list[str]]  # number, text and words


class TableError(ValueError):
    """A file of numbers cannot be used; the message names file, line if any, and allowed values."""


def read_columns(
    path: Path,
    names: tuple[str, ...],
    *,
    increasing: bool = False,
    at_least: int = 2,
    row_error: RowError | None = None,
) -> FloatArray:
    """Read columns of numbers separated by commas, semicolons or white space.

    Empty lines, lines that start with ``#``, and lines of words before the numbers are passed over.
    `names` are the columns in messages; `increasing` asks for a first column that grows from row to row;
    `row_error` gives the reason why the numbers of a row cannot be used. TableError names file and line.
    """
    import numpy as np

    table = _read_at_once(path)
    if table is not None and row_error is None and table.shape[1] == len(names) and len(table) >= at_least:
        grows = not increasing or bool((np.diff(table[:, 0]) > 0).all())
        if grows and bool((np.abs(table) <= LARGEST).all()):
            return table
    wanted = f"{len(names)} numbers ({', '.join(names)})"
    lines = read_lines(path)
    rows: list[list[float]] = []
    for place, text, row in _rows(path, lines, wanted):
        if len(row) != len(names):
            raise TableError(f"{place}: holds {len(row)} numbers; must be {wanted}")
        if not np.isfinite(row).all():
            raise TableError(f"{place}: {text!r} is not finite; must be {wanted}")
        if max(map(abs, row)) > LARGEST:
            raise TableError(f"{place}: {text!r} is too large; must be {wanted}, up to {LARGEST:g}")
        if increasing and rows and row[0] <= rows[-1][0]:
            order = f"{names[0]} = {row[0]:g} after {rows[-1][0]:g}"
            raise TableError(f"{place}: {order}; must increase from row to row")
        if row_error is not None and (wrong := row_error(row)):
            raise TableError(f"{place}: {wrong}")
        rows.append(row)
    if len(rows) < at_least:
        end = lines[-1][0] if lines else 1
        raise TableError(f"{path}:{end}: holds {len(rows)} rows of numbers; must be at least {at_least}")
    return np.array(rows)


def read_matrix(path: Path) -> FloatArray:
    """Read rows of equally many numbers, separated as in `read_columns`; a number may be nan."""
    import numpy as np

    if (matrix := _read_at_once(path)) is not None:
        return matrix
    rows: list[list[float]] = []
    for place, _, row in _rows(path, read_lines(path), "numbers"):
        if rows and len(row) != len(rows[0]):
            raise TableError(f"{place}: holds {len(row)} numbers; must be {len(rows[0])}, as above")
        rows.append(row)
    if not rows:
        raise TableError(f"{path}: holds no numbers")
    return np.array(rows)


def _read_at_once(path: Path) -> FloatArray | None:
    """Return equal rows by NumPy's reader, ten times as fast; None where it finds anything else."""
    import numpy as np

    try:
        text = path.read_text(encoding="utf-8-sig")
        if text.isascii():
            lines = text.translate(_SEPARATORS).splitlines()
            words = (line.partition("#")[0].split() for line in lines)
            first = next((i for i, each in enumerate(words) if any(map(is_number, each))), None)
            return None if first is None else np.loadtxt(lines[first:], ndmin=2)
    except (OSError, ValueError):
        pass
    return None


def _rows(path: Path, lines: Sequence[Line], wanted: str) -> Iterator[tuple[str, str, list[float]]]:
    """Yield place, text and numbers of the lines of numbers."""
    begun = False
    for number, text, words in lines:
        try:
            row = [float(word) for word in words]
        except ValueError:
            if begun or any(map(is_number, words)):
                raise TableError(f"{path}:{number}: cannot read {text[:60]!r}; must be {wanted}") from None
            if any(is_number(word.strip("\"'")) for word in words):
                raise TableError(
                    f"{path}:{number}: has numbers in quotes, {text[:60]!r}; remove the quotes"
                ) from None
            continue  # the names of the columns
        begun = True
        yield f"{path}:{number}", text, row


def read_lines(path: Path) -> list[Line]:
    """Return number, text and words of the lines of a file that hold more than a comment."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise TableError(f"{path}: cannot be read as text ({error})") from error
    texts = ((number, line.partition("#")[0].strip()) for number, line in enumerate(lines, start=1))
    return [
        (number, text, [word for word in re.split(r"[,;\s]+", text) if word])
        for number, text in texts
        if text
    ]


def is_number(word: str) -> bool:
    """Whether a word can be read as a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


# Long lists of plain numbers in YAML, which are read a hundred times faster than by a parser of YAML.
#
# One word replaces each of these lists before the text is parsed. It is the list again where it is the
# only entry of a list. Lines and columns stay those of the file. A list that a parser of YAML would not
# take for just these numbers, as inside of a quoted text, is left to that parser with all the others.

_FEWEST = 500  # characters of a list in brackets, and half the lines of one with a line for each entry
_FLOW = re.compile(rf"(?<=\[)[-+0-9.eE, \n]{{{_FEWEST},}}(?=\])")
_BLOCK = re.compile(rf"^ *- [-+0-9.eE]+ *\n(?: *- [-+0-9.eE]+ *\n){{{_FEWEST // 2},}}", re.MULTILINE)
_NUMBER = re.compile(r"[-+]?(?:0|[1-9][0-9]{0,99})(\.[0-9]*)?([eE][-+]?[0-9]+)?")
_LAST = re.compile(r" *(?:\n|$)")  # after the bracket
_MARK = "\ue000"  # of private use


@dataclass(frozen=True)
class NumberList:
    """The numbers of a list, its text, and line and column of the file, from 1, at which that begins."""

    numbers: list[int | float]
    text: str
    line: int
    column: int
    in_lines: bool

    @cached_property
    def places(self) -> list[tuple[int, int]]:
        """Line and column of each number in the file."""
        places = []
        pattern = re.compile(r"(?<=- )[^\s]+" if self.in_lines else r"[^,\s]+")
        for number, line in enumerate(self.text.split("\n")):
            before = 1 if number else self.column
            places += [(self.line + number, before + item.start()) for item in pattern.finditer(line)]
        return places


def shortened(content: str) -> tuple[str, dict[str, NumberList]]:
    """Replace long lists of numbers in YAML by words; return the text, and the list of each word."""
    lists: dict[str, NumberList] = {}
    if _MARK in content:
        return content, lists
    parts, end = [], 0
    candidates = [(match, False) for match in _FLOW.finditer(content)]
    candidates += [(match, True) for match in _BLOCK.finditer(content)]
    for match, in_lines in sorted(candidates, key=lambda each: each[0].start()):
        written = match[0]
        items = [line.strip()[2:] for line in written.splitlines()] if in_lines else written.split(",")
        if match.start() < end or (numbers := _numbers(items)) is None:
            continue
        indents = {line.index("-") for line in written.splitlines()} if in_lines else {0}
        if len(indents) > 1:
            continue
        word = f"{_MARK}{len(lists)}{_MARK}"
        line = content.count("\n", 0, match.start()) + 1
        column = match.start() - content.rfind("\n", 0, match.start())
        lists[word] = NumberList(numbers, written, line, column, in_lines)
        dash = " " * indents.pop() + "- " if in_lines else ""
        blank = "\n" * written.count("\n")
        if not in_lines and not _LAST.match(content, match.end() + 1):  # the rest keeps its column
            last = written.rpartition("\n")[2]
            blank += " " * (len(last) if blank else len(last) - len(word))
        parts += [content[end : match.start()], dash, word, blank]
        end = match.end()
    return "".join([*parts, content[end:]]), lists


def _numbers(items: list[str]) -> list[int | float] | None:
    """Return the numbers of a list; None where one of its items is something else, or infinite."""
    numbers: list[int | float] = []
    for item in items:
        if (match := _NUMBER.fullmatch(item.strip(" \n"))) is None:
            return None
        numbers.append(int(match[0]) if match[1] is None and match[2] is None else float(match[0]))
    return numbers if all(map(math.isfinite, numbers)) else None
