"""Numbers in files of users: columns of text, with errors that name the line, and groups of HDF5 files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import h5py

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
    """Read rows of equally many numbers, separated as in `read_columns`; a number may be nan."""
    import numpy as np

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


# HDF5 files of users: their contents must be in the file itself, because only they enter the digest.


def refuse_other_files(path: Path, group: h5py.Group) -> None:
    """Refuse a group with links to other files, or data that are stored in them; not the groups in it."""
    import h5py

    for name in group:
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise TableError(f"{path}: {name} is a link to {link.filename}; must be in the file itself")
        kind = group.get(name, getclass=True)
        if kind is h5py.Dataset and (group[name].external or group[name].is_virtual):
            raise TableError(f"{path}: {name} is stored in another file; must be in the file itself")


def open_group(path: Path, file: h5py.File, name: str) -> h5py.Group:
    """Return a group of a file, refusing other files on the way to it and in it."""
    import h5py

    group: h5py.Group = file
    refuse_other_files(path, group)
    for part in filter(None, name.split("/")):
        if group.get(part, getclass=True) is not h5py.Group:
            raise TableError(f"{path}: has no group {name!r}")
        group = group[part]
        refuse_other_files(path, group)
    return group
