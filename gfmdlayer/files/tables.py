"""Numbers in columns of a text file, with errors that name the line."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from gfmdlayer.arrays import FloatArray

LARGEST = 1e30  # results computed from larger numbers may leave the range of double precision

_SEPARATORS = str.maketrans(",;", "  ")

RowError = Callable[[Sequence[float]], str | None]
Line = tuple[int, str, list[str]]  # number, text and words


class TableError(ValueError):
    """A file of numbers cannot be used; the message names file, line if any, and what is allowed."""


def read_columns(
    path: Path,
    names: tuple[str, ...],
    *,
    increasing: bool = False,
    at_least: int = 2,
    row_error: RowError | None = None,
) -> FloatArray:
    """Read columns of numbers separated by commas, semicolons or white space.

    Lines that are empty or start with ``#`` are passed over, and so are lines of words before the numbers.

    Parameters
    ----------
    path : Path
        The file.
    names : tuple of str
        The columns that the file must hold, for the messages.
    increasing : bool
        Whether the first column must grow from row to row.
    at_least : int
        The fewest rows allowed.
    row_error : callable, optional
        From the numbers of a row to the reason why they cannot be used, if any.

    Returns
    -------
    ndarray, shape (rows, columns)

    Raises
    ------
    TableError
        Naming file and line.
    """
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
            found = f"{names[0]} = {row[0]:g} after {rows[-1][0]:g}"
            raise TableError(f"{place}: {found}; must increase from row to row")
        if row_error is not None and (wrong := row_error(row)):
            raise TableError(f"{place}: {wrong}")
        rows.append(row)
    if len(rows) < at_least:
        end = lines[-1][0] if lines else 1
        raise TableError(f"{path}:{end}: holds {len(rows)} rows of numbers; must be at least {at_least}")
    return np.array(rows)


def read_matrix(path: Path) -> FloatArray:
    """Read rows of equally many numbers, separated as in `read_columns`; a number may be nan.

    Raises
    ------
    TableError
        Naming file and line.
    """
    if (found := _read_at_once(path)) is not None:
        return found
    rows: list[list[float]] = []
    for place, _, row in _rows(path, read_lines(path), "numbers"):
        if rows and len(row) != len(rows[0]):
            raise TableError(f"{place}: holds {len(row)} numbers; must be {len(rows[0])}, as above")
        rows.append(row)
    if not rows:
        raise TableError(f"{path}: holds no numbers")
    return np.array(rows)


def _read_at_once(path: Path) -> FloatArray | None:
    """Return rows of equally many numbers by NumPy's reader; None where it finds anything else.

    It takes a tenth of the time of the readers here, which then say what is wrong, and where.
    """
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
            continue  # the names of the columns
        begun = True
        yield f"{path}:{number}", text, row


def read_lines(path: Path) -> list[Line]:
    """Return number, text and words of the lines of a file that hold more than a comment.

    Raises
    ------
    TableError
        If the file cannot be read as text.
    """
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
