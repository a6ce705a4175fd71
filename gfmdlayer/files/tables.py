"""Numbers in columns of a text file, with errors that name the line."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

LARGEST = 1e30  # that is taken: what is computed from larger numbers may leave the range of double precision


class TableError(ValueError):
    """A file of numbers cannot be used; the message names file, line if any, and what is allowed."""


def read_columns(
    path: Path,
    names: tuple[str, ...],
    *,
    increasing: bool = False,
    at_least: int = 2,
    row_error: Callable[[Sequence[float]], str | None] = lambda _: None,
) -> npt.NDArray[np.float64]:
    """Read columns of numbers separated by commas, semicolons or white space.

    Lines that are empty or start with ``#`` are passed over, and so are lines of words before the numbers.

    Parameters
    ----------
    path : Path
        The file.
    names : tuple of str
        What the columns hold, for the messages; as many as there must be.
    increasing : bool
        Whether the first column must grow from row to row.
    at_least : int
        The fewest rows that will do.
    row_error : callable
        Says what is wrong with the numbers of a row, and what is allowed; nothing if they will do.

    Returns
    -------
    ndarray, shape (rows, columns)

    Raises
    ------
    TableError
        Naming file and line.
    """
    number = 1
    wanted = f"{len(names)} numbers ({', '.join(names)})"
    rows: list[list[float]] = []
    for number, text, words in read_lines(path):
        try:
            row = [float(word) for word in words]
        except ValueError:
            if not rows and not any(is_number(word) for word in words):
                continue  # the names of the columns
            raise TableError(f"{path}:{number}: cannot read {text!r}; must be {wanted}") from None
        if len(row) != len(names):
            raise TableError(f"{path}:{number}: holds {len(row)} numbers; must be {wanted}")
        if not np.isfinite(row).all():
            raise TableError(f"{path}:{number}: {text!r} is not finite; must be {wanted}")
        if max(map(abs, row)) > LARGEST:
            raise TableError(f"{path}:{number}: {text!r} is too large; must be {wanted}, up to {LARGEST:g}")
        if increasing and rows and row[0] <= rows[-1][0]:
            found = f"{names[0]} = {row[0]:g} after {rows[-1][0]:g}"
            raise TableError(f"{path}:{number}: {found}; must increase from row to row")
        if wrong := row_error(row):
            raise TableError(f"{path}:{number}: {wrong}")
        rows.append(row)
    if len(rows) < at_least:
        raise TableError(f"{path}:{number}: holds {len(rows)} rows of numbers; must be at least {at_least}")
    return np.array(rows)


def read_matrix(path: Path) -> npt.NDArray[np.float64]:
    """Read rows of equally many numbers, separated as in `read_columns`; a number may be nan.

    Raises
    ------
    TableError
        Naming file and line.
    """
    rows: list[list[float]] = []
    for number, text, words in read_lines(path):
        try:
            row = [float(word) for word in words]
        except ValueError:
            if not rows and not any(is_number(word) for word in words):
                continue  # the names of the columns
            raise TableError(f"{path}:{number}: cannot read {text[:60]!r}; must be numbers") from None
        if rows and len(row) != len(rows[0]):
            raise TableError(f"{path}:{number}: holds {len(row)} numbers; must be {len(rows[0])}, as above")
        rows.append(row)
    if not rows:
        raise TableError(f"{path}: holds no numbers")
    return np.array(rows)


def read_lines(path: Path) -> list[tuple[int, str, list[str]]]:
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
