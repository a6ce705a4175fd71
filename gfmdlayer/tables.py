"""Numbers in columns of a text file, with errors that name the line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt


class TableError(ValueError):
    """A file of numbers cannot be used; the message names the file, the line where there is one.

    And what is allowed.
    """


def read_columns(
    path: Path, names: tuple[str, ...], *, increasing: bool = False, at_least: int = 2
) -> npt.NDArray[np.float64]:
    """Read columns of numbers separated by commas, semicolons or white space.

    Lines that are empty or start with ``#`` are passed over, and so is a first line of column names.

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

    Returns
    -------
    ndarray, shape (rows, columns)

    Raises
    ------
    TableError
        Naming file and line.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise TableError(f"{path}: cannot be read as text ({error})") from error
    wanted = f"{len(names)} numbers ({', '.join(names)})"
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        text = line.partition("#")[0].strip()
        if not text:
            continue
        words = [word for word in re.split(r"[,;\s]+", text) if word]
        try:
            row = [float(word) for word in words]
        except ValueError:
            if not rows and not any(_is_number(word) for word in words):
                continue  # the names of the columns
            raise TableError(f"{path}:{number}: cannot read {text!r}; must be {wanted}") from None
        if len(row) != len(names):
            raise TableError(f"{path}:{number}: holds {len(row)} numbers; must be {wanted}")
        if not np.isfinite(row).all():
            raise TableError(f"{path}:{number}: {text!r} is not finite; must be {wanted}")
        if increasing and rows and row[0] <= rows[-1][0]:
            found = f"{names[0]} = {row[0]:g} after {rows[-1][0]:g}"
            raise TableError(f"{path}:{number}: {found}; must increase from row to row")
        rows.append(row)
    if len(rows) < at_least:
        raise TableError(f"{path}: holds {len(rows)} rows of numbers; must be at least {at_least}")
    return np.array(rows)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
