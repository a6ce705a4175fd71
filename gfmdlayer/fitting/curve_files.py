"""Measured force curves in files: columns of text, HDF5, and the formats of AFMs.

Text (.csv, .txt, .dat, .tsv): one curve in columns of time, depth and force, in this order or in the order
of the headings. A column `base`, the position of the cantilever's base, may replace the depth. The columns
`segment` and `prescribed` have words. Units are in the headings, as in ``depth (nm)``, or given separately.

HDF5 (.h5, .hdf5): variables time, depth (or base) and force at the root, (rows,) for one curve or
(curves, rows) for many, which may share a time of (rows,) and have x and y of (curves,); or one group for
each curve with these variables and the attributes x, y and stiffness. `segment` and `prescribed` are
variables of words. Units are the attribute `units`; the stiffness has those of force over depth. Rows of NaN
after the end of a short curve are left out.

afmformats (the extra `afm`) reads other files, in SI units, with their segments: the base is prescribed, and
the force in the pause of a creep curve.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.files.hdf5 import open_hdf5, refuse_other_files
from gfmdlayer.files.tables import TableError, is_number, read_lines
from gfmdlayer.fitting.estimates import FitOptions
from gfmdlayer.fitting.force_curve import (
    BASE,
    COLUMNS,
    FORCE,
    WORDS,
    ForceCurve,
    Sizes,
    allowed,
    parse_heading,
    size_of,
)

TEXT = {".csv", ".txt", ".dat", ".tsv"}
HDF5 = {".h5", ".hdf5"}
Units = Sequence[str]


@dataclass(frozen=True)
class Entry:
    """A curve in a file."""

    path: Path  # the file
    key: str  # the curve in it: a group, a number, or nothing for the only one
    name: str  # names the curve in messages and results
    position: tuple[float, ...] = ()  # place (x, y) on the sample, or nothing


def entries(paths: Sequence[Path]) -> list[Entry]:
    """Return the curves in files and folders, in the order of their names."""
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            files += sorted(file for file in path.iterdir() if file.is_file() and file.name[0] != ".")
        elif path.exists():
            files.append(path)
        else:
            raise TableError(f"{path}: no such file; give a file of curves or a folder")
    read = [entry for path in files for entry in _entries(path)]
    if not read:
        raise TableError(f"{', '.join(map(str, paths))}: no curve found")
    names: dict[str, int] = {}
    for entry in read:
        names[entry.name] = names.get(entry.name, 0) + 1
    every = [
        entry if names[entry.name] == 1 else replace(entry, name=f"{entry.path}:{entry.key}".rstrip(":"))
        for entry in read
    ]
    # Bytes of a file's name that are not UTF-8 become escape codes.
    return [replace(each, name=os.fsencode(each.name).decode(errors="backslashreplace")) for each in every]


def read_curve(
    entry: Entry,
    units: Units | None = None,
    into: Sizes = (1.0, 1.0, 1.0),
    options: FitOptions = FitOptions(),  # noqa: B008
) -> ForceCurve:
    """Read a curve; with known units, convert it to the units of the model.

    `units` are those of time, depth and force for columns without a unit; `into` are the sizes in SI of the
    model's units of time, length and force. The options have facts that are not in the file.
    """
    origin = {"file": entry.path.name, "sha256": contents(entry.path), "curve": entry.key}
    suffix = entry.path.suffix.lower()
    if suffix not in TEXT | HDF5:
        data = _afm_group(entry.path)[int(entry.key)]
        return afm_curve(data, entry.name, into, options, position=entry.position, origin=origin)
    columns, units_read, words, stiffness = (
        _text_columns(entry.path) if suffix in TEXT else _hdf5_columns(entry)
    )
    sizes = _sizes(entry.path, units_read, units, into, columns)
    columns = {key: values * sizes[key] for key, values in columns.items()}
    length = sizes["depth" if "depth" in columns else "base"]
    own = options.stiffness if stiffness is None else stiffness * sizes["force"] / length
    if "depth" not in columns:
        if own is None:
            raise TableError(
                f"{entry.path}: curve {entry.name} has the base but no depth, which is base - "
                "force/stiffness; give the stiffness of the cantilever"
            )
        columns["depth"] = columns.pop("base") - columns["force"] / own
    return ForceCurve(
        entry.name, columns["time"], columns["depth"], columns["force"], position=entry.position,
        origin=origin, **curve_facts(words, own, options),
    )  # fmt: skip


def curve_facts(
    words: Mapping[str, str | Sequence[str]], stiffness: float | None, options: FitOptions
) -> dict[str, Any]:
    """Return the facts of a curve that are in its file, or else in the options."""
    return {
        "segment": words.get("segment"),
        "prescribed": words.get("prescribed", options.prescribed),
        "stiffness": stiffness,
        "stiffness_error": None if stiffness is None else options.stiffness_error,
    }


def contents(path: Path) -> str:
    """Return a hash of the contents of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _entries(path: Path) -> Iterator[Entry]:
    suffix = path.suffix.lower()
    if suffix in TEXT:
        yield Entry(path, "", path.stem)
    elif suffix in HDF5:
        yield from _hdf5_entries(path)
    else:
        for number, data in enumerate(_afm_group(path)):
            meta = data.metadata
            place = tuple(float(meta[key]) for key in ("position x", "position y") if key in meta)
            number_of_curve = meta.get("enum", number)
            yield Entry(path, str(number), f"{path.stem}-{number_of_curve}", place if len(place) == 2 else ())


_Columns = tuple[dict[str, FloatArray], dict[str, str], dict[str, list[str]], float | None]


def _text_columns(path: Path) -> _Columns:
    """Return the columns of a text file, the units in its headings, its words; it has no stiffness."""
    lines = read_lines(path)
    first = next((i for i, line in enumerate(lines) if sum(map(is_number, line[2])) >= len(COLUMNS)), None)
    if first is None:
        raise TableError(f"{path}:1: no rows of numbers; the file must have columns of time, depth and force")
    order = {column: i for i, column in enumerate(COLUMNS)}
    units: dict[str, str] = {}
    if first:
        order, units = _headings(path, *lines[first - 1][:2])
    width, numbers = len(lines[first][2]), [i for column, i in order.items() if column not in WORDS]
    if max(order.values()) >= width:
        raise TableError(f"{path}:{lines[first][0]}: got {width} columns; must be time, depth and force")
    wrong = set(range(width)) - set(numbers) if first else set()
    for number, shown, words in lines[first:]:
        must_be_numbers = [word for i, word in enumerate(words) if i not in wrong]
        if len(words) != width or not all(map(is_number, must_be_numbers)):
            raise TableError(
                f"{path}:{number}: got {shown[:60]!r}; must be {width} numbers, as in the rows above"
            )
    rows = [words for _, _, words in lines[first:]]
    columns = {
        column: np.array([float(words[i]) for words in rows]) for column, i in order.items() if i in numbers
    }
    text = {column: [words[i] for words in rows] for column, i in order.items() if column in WORDS}
    return columns, units, text, None


def _headings(path: Path, number: int, line: str) -> tuple[dict[str, int], dict[str, str]]:
    """Return the positions and units of the columns in a line of headings."""
    separator = next((mark for mark in ",;\t" if mark in line), None)
    order: dict[str, int] = {}
    units: dict[str, str] = {}
    for i, heading in enumerate(line.split(separator)):
        column, unit = parse_heading(heading)
        if column is None:
            continue
        if column in order:
            raise TableError(f"{path}:{number}: two columns are named {column}; name only one so")
        order[column] = i
        if unit:
            units[column] = unit
    if "depth" in order:  # the base follows from depth, force and stiffness
        order.pop("base", None)
        units.pop("base", None)
    if missing := [
        column for column in COLUMNS if column not in order and not (column == "depth" and "base" in order)
    ]:
        raise TableError(
            f"{path}:{number}: no column is named {' or '.join(missing)}; name time, depth and force, as in "
            "time (s), depth (nm), force (nN)"
        )
    return order, units


def _sizes(
    path: Path, of_file: dict[str, str], of_user: Units | None, into: Sizes, columns: Iterable[str]
) -> dict[str, float]:
    """Return the sizes of the columns' units over the sizes of the model's; 1 if no column has a unit."""
    units = dict(zip(COLUMNS, of_user or (), strict=False))
    units = ({"base": units["depth"]} if units else {}) | units | of_file
    if not units:
        return dict.fromkeys(columns, 1.0)
    if missing := [column for column in columns if column not in units]:
        raise TableError(
            f"{path}: {' and '.join(units)} with a unit, but {' and '.join(missing)} without; give "
            "all units, in the headings or with --units"
        )
    own = dict(zip(COLUMNS, into, strict=True)) | {"base": into[1]}
    sizes = {}
    for column in columns:
        size = size_of(units[column], column)
        if size is None:
            raise TableError(
                f"{path}: got the unit {units[column]!r} for {column}; must be {allowed(column)}"
            )
        sizes[column] = size / own[column]
    return sizes


def _hdf5_entries(path: Path) -> Iterator[Entry]:
    with _hdf5(path) as file:
        if "force" not in file:
            for name, group in file.items():
                if hasattr(group, "keys") and "force" in group:
                    yield Entry(path, name, name, _place(group.attrs))
            return
        shape = file["force"].shape
        if len(shape) == 1:
            yield Entry(path, "", path.stem)
            return
        places = np.stack([file[key][:] for key in "xy"], axis=1) if {"x", "y"} <= set(file) else None
        digits = len(str(shape[0] - 1))
        for i in range(shape[0]):
            place = () if places is None else tuple(places[i].tolist())
            yield Entry(path, str(i), f"{path.stem}-{i:0{digits}d}", place)


def _hdf5_columns(entry: Entry) -> _Columns:
    with _hdf5(entry.path) as file:
        row = int(entry.key) if "force" in file and entry.key else None
        place = file if "force" in file else file[entry.key]
        refuse_other_files(entry.path, place)
        columns, units, words = {}, {}, {}
        for column in ("time", "depth" if "depth" in place or "base" not in place else "base", "force"):
            if column not in place:
                raise TableError(f"{entry.path}: curve {entry.name} has no variable {column}")
            data = place[column]
            columns[column] = np.asarray(data[:] if data.ndim == 1 or row is None else data[row], dtype=float)
            if unit := data.attrs.get("units"):
                units[column] = unit.decode() if isinstance(unit, bytes) else str(unit)
        for column in WORDS:
            if column in place:
                values = place[column].asstr()
                words[column] = list(map(str, values[:] if values.ndim == 1 or row is None else values[row]))
        stiffness = place.attrs.get("stiffness")
    sizes = {values.size for values in columns.values()}
    if len(sizes) == 1:
        position = columns["depth" if "depth" in columns else "base"]
        missing = np.isnan(columns["force"]) & np.isnan(position)
        end = int(np.flatnonzero(~missing)[-1]) + 1 if not missing.all() else missing.size
        columns = {column: values[:end] for column, values in columns.items()}
        words = {column: values[:end] for column, values in words.items()}
    return columns, units, words, None if stiffness is None else float(stiffness)


@contextmanager
def _hdf5(path: Path) -> Iterator[Any]:
    try:
        with open_hdf5(path) as file:
            refuse_other_files(path, file)
            yield file
    except TableError:
        raise
    except Exception as error:  # a damaged file can fail anywhere in HDF5, with any exception
        raise TableError(f"{path}: cannot be read as HDF5 ({error})") from None


def _place(attributes: Any) -> tuple[float, ...]:
    return tuple(float(attributes[key]) for key in "xy") if {"x", "y"} <= set(attributes) else ()


@lru_cache(maxsize=2)
def _afm_group(path: Path) -> Any:
    try:
        import afmformats
    except ImportError:
        known = ", ".join(sorted(TEXT | HDF5))
        raise TableError(
            f"{path}: must be {known}; for AFM formats first run pip install 'gfmdlayer[afm]'"
        ) from None
    try:
        return afmformats.load_data(path)
    except Exception as error:  # each format fails with exceptions of its own
        raise TableError(f"{path}: cannot be read by afmformats ({error})") from error


# Names of the segments of afmformats by number.
_PARTS = {
    "force-distance": ("approach", "retract"),
    "creep-compliance": ("approach", "hold", "retract"),
    "stress-relaxation": ("before", "approach", "hold", "retract"),
}


def afm_curve(
    data: Any,
    name: str,
    into: Sizes = (1.0, 1.0, 1.0),
    options: FitOptions = FitOptions(),  # noqa: B008
    **more: Any,
) -> ForceCurve:
    """Return a curve of afmformats; the position of the tip is the measured height plus the deflection."""
    stiffness = data.metadata.get("spring constant")
    if stiffness is None and options.stiffness is not None:
        stiffness = options.stiffness * into[2] / into[1]
    if "time" not in data.columns or "force" not in data.columns:
        raise TableError(f"curve {name} has no time or no force; it needs both")
    force = np.asarray(data["force"])
    if "tip position" in data.columns:
        tip = np.asarray(data["tip position"])
    elif "height (measured)" in data.columns and stiffness:
        tip = np.asarray(data["height (measured)"]) + force / stiffness
    else:
        raise TableError(
            f"curve {name} has no tip position; it needs the tip position, or the measured height and the "
            "spring constant"
        )
    words: dict[str, list[str]] = {}
    mode = str(data.metadata.get("imaging mode", "force-distance"))
    if "segment" in data.columns and mode in _PARTS:
        numbers = np.asarray(data["segment"]).astype(int)
        words["segment"] = [_PARTS[mode][min(k, len(_PARTS[mode]) - 1)] for k in numbers]
        if stiffness:
            creep = mode == "creep-compliance"
            words["prescribed"] = [FORCE if creep and word == "hold" else BASE for word in words["segment"]]
    facts = curve_facts(words, stiffness and float(stiffness), options)
    curve = ForceCurve(name, data["time"], -tip, force, **facts, **more)
    return curve.in_units(*(1 / size for size in into))
