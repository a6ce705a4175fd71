"""Measured force curves in files: the formats of AFMs, columns of text, HDF5.

afmformats (the extra `afm`) reads the formats that it knows, whatever their ending, in SI units and with
their segments: the base is prescribed, and the force in the pause of a creep curve.

Text (.csv, .txt, .dat, .tsv): one curve in columns of time, depth and force, by their headings or in this
order (`files.tables`). A column `base`, the position of the cantilever's base, may replace the depth. The
columns `segment` and `prescribed` have words.

HDF5 (.h5, .hdf5): variables time, depth (or base) and force at the root, (rows,) for one curve or
(curves, rows) for many, which may share a time of (rows,) and have x and y of (curves,); or one group for
each curve with these variables and the attributes x, y and stiffness. `segment` and `prescribed` are
variables of words. Units are the attribute `units`; the stiffness has those of force over depth. Rows of NaN
after the end of a short curve are left out.

Without a time the rows are equally spaced, where nothing relaxes or the sampling rate is given.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.files.hdf5 import open_hdf5, refuse_other_files
from gfmdlayer.files.headings import WORDS
from gfmdlayer.files.tables import Answers, TableError, converted, read_table
from gfmdlayer.files.units import unit_of
from gfmdlayer.fitting.estimates import FitOptions
from gfmdlayer.fitting.force_curve import BASE, COLUMNS, FORCE, ForceCurve
from gfmdlayer.validation.units import Units

TEXT = {".csv", ".txt", ".dat", ".tsv"}
HDF5 = {".h5", ".hdf5"}
Into = tuple[str, str, str]
SI: Into = ("s", "m", "N")  # units of time, depth and force


def units_of(units: Units | None) -> Into:
    """Return the units of time, depth and force of a model; SI without units."""
    return SI if units is None else (units.time, units.length, units.label("force"))


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
    answers: Answers = Answers(),  # noqa: B008
    into: Into = SI,
    options: FitOptions = FitOptions(),  # noqa: B008
    *,
    timeless: bool = False,
) -> ForceCurve:
    """Read a curve; columns with a unit are converted to the units of the model, `into`.

    The answers and the options have facts that are not in the file. `timeless`: nothing relaxes, and the
    curve needs no time.
    """
    path, suffix = entry.path, entry.path.suffix.lower()
    origin = {"file": path.name, "sha256": contents(path), "curve": entry.key}
    own, account = options.stiffness, ""
    if suffix not in TEXT | HDF5 or known_to_afmformats(path):
        curves, missing = _afm_curves(path, *_calibration(options, into))
        if missing:
            lacking = " and ".join(f"the {key} (--{_OPTIONS[key]})" for key in missing)
            raise TableError(f"{path}: the file does not have {lacking}; give it")
        data = curves[int(entry.key)]
        return afm_curve(
            data, entry.name, into, options, timeless=timeless, position=entry.position, origin=origin
        )
    words: dict[str, list[str]]
    if suffix in TEXT:
        columns, words, account = _text_columns(path, answers, into)
    else:
        columns, words, stiffness = _hdf5_columns(entry, dict(answers.units), into)
        own = stiffness or own
    if "depth" not in columns:
        if own is None:
            raise TableError(
                f"{path}: curve {entry.name} has the base but no depth, which is base - force/stiffness; "
                "give the stiffness of the cantilever"
            )
        columns["depth"] = columns.pop("base") - columns["force"] / own
    time, note = _time(f"{path}: curve {entry.name}", columns, options, timeless=timeless)
    more = {"account": "; ".join(filter(None, (account, note)))} if account or note else {}
    return ForceCurve(
        entry.name, time, columns["depth"], columns["force"], position=entry.position,
        origin=origin | more, **curve_facts(words, own, options),
    )  # fmt: skip


def _time(
    name: str, columns: Mapping[str, FloatArray], options: FitOptions, *, timeless: bool
) -> tuple[FloatArray, str]:
    """Return the time of a curve, or equal steps where it has none, and a note on them."""
    if "time" in columns:
        return columns["time"], ""
    rows = np.arange(columns["force"].size, dtype=float)
    if options.sampling is not None:
        return rows / options.sampling, f"no time: {options.sampling:g} rows in a unit of time"
    if timeless:
        return rows, "no time: rows count as times, as nothing relaxes"
    needs = "the model relaxes, or the fit has a drift; give the sampling rate, rows per time"
    raise TableError(f"{name} has no time, but {needs}")


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
    if suffix not in TEXT | HDF5 or known_to_afmformats(path):
        for number, data in enumerate(_afm_curves(path)[0]):
            meta = data.metadata
            place = tuple(float(meta[key]) for key in ("position x", "position y") if key in meta)
            number_of_curve = meta.get("enum", number)
            yield Entry(path, str(number), f"{path.stem}-{number_of_curve}", place if len(place) == 2 else ())
    elif suffix in TEXT:
        yield Entry(path, "", path.stem)
    else:
        yield from _hdf5_entries(path)


def _text_columns(
    path: Path, answers: Answers, into: Into
) -> tuple[dict[str, FloatArray], dict[str, list[str]], str]:
    """Return the columns of a text file, its words, and how it was read."""
    table = read_table(path, (*COLUMNS, "base", *WORDS), answers, orders=(COLUMNS,))
    names: list[str] = [name for name in ("time", "depth", "base", "force") if name in table.columns]
    if "depth" in names and "base" in names:  # the base follows from depth, force and stiffness
        names.remove("base")
    needed = ("force",) if "base" in names else ("force", "depth")
    missing = [name for name in needed if name not in names]
    if refused := [name for name in ("time", *missing) if name in table.refused] + missing:
        table.take(refused[0])  # says why not
    target = dict(zip(COLUMNS, into, strict=True)) | {"base": into[1]}
    columns = {
        name: table.take(name, target[name] if table.columns[name].unit is not None else None)
        for name in names
    }
    return columns, dict(table.words), table.account


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


def _hdf5_columns(
    entry: Entry, given: Mapping[str, str], into: Into
) -> tuple[dict[str, FloatArray], dict[str, list[str]], float | None]:
    with _hdf5(entry.path) as file:
        row = int(entry.key) if "force" in file and entry.key else None
        place = file if "force" in file else file[entry.key]
        refuse_other_files(entry.path, place)
        columns, units, words = {}, {}, {}
        position = "depth" if "depth" in place or "base" not in place else "base"
        for column in (*(["time"] if "time" in place else []), position, "force"):
            if column not in place:
                raise TableError(f"{entry.path}: curve {entry.name} has no variable {column}")
            data = place[column]
            columns[column] = np.asarray(data[:] if data.ndim == 1 or row is None else data[row], dtype=float)
            unit = data.attrs.get("units") or given.get("depth" if column == "base" else column, "")
            units[column] = unit.decode() if isinstance(unit, bytes) else str(unit)
        for column in WORDS:
            if column in place:
                values = place[column].asstr()
                words[column] = list(map(str, values[:] if values.ndim == 1 or row is None else values[row]))
        stiffness = place.attrs.get("stiffness")
    sizes = {values.size for values in columns.values()}
    if len(sizes) == 1:
        missing = np.isnan(columns["force"]) & np.isnan(columns[position])
        end = int(np.flatnonzero(~missing)[-1]) + 1 if not missing.all() else missing.size
        columns = {column: values[:end] for column, values in columns.items()}
        words = {column: values[:end] for column, values in words.items()}
    if any(units.values()):
        if lacking := [column for column, unit in units.items() if not unit]:
            having = " and ".join(column for column, unit in units.items() if unit)
            missing_ones = " and ".join(lacking)
            raise TableError(
                f"{entry.path}: {having} with a unit, but {missing_ones} without; give all units, in the "
                "attribute units or with --units"
            )
        target = dict(zip(COLUMNS, into, strict=True)) | {"base": into[1]}
        ones = {}
        for column, symbol in units.items():
            if (unit := unit_of(symbol)) is None:
                raise TableError(f"{entry.path}: got the unit {symbol!r} for {column}, which is not known")
            where = f"{entry.path}: {column}"
            columns[column] = converted(columns[column], unit, target[column], where, symbol)
            ones[column] = converted(np.ones(1), unit, target[column], where, symbol).item()
        if stiffness is not None:
            stiffness *= ones["force"] / ones[position]
    return columns, words, None if stiffness is None else float(stiffness)


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


def known_to_afmformats(path: Path) -> bool:
    """Whether afmformats is installed and knows the format of a file."""
    try:
        import afmformats.formats
    except ImportError:
        return False
    try:
        afmformats.formats.get_recipe(path)
    except BaseException as error:
        _pass_on(error)
        return False
    return True


def _calibration(options: FitOptions, into: Into) -> tuple[float | None, float | None]:
    """Return the stiffness of the cantilever and its deflection per volt in SI, where they are given."""
    length, newton = _sizes(into)[1:]
    stiffness, sensitivity = options.stiffness, options.sensitivity
    return (
        None if stiffness is None else stiffness * newton / length,
        None if sensitivity is None else sensitivity * length,
    )


def _sizes(into: Into) -> tuple[float, float, float]:
    """Return the sizes of the units of time, depth and force in SI."""
    time, length, force = (unit_of(symbol) for symbol in into)
    assert time  # all of a checked configuration
    assert length
    assert force
    return float(time.size), float(length.size), float(force.size)


_OPTIONS = {"spring constant": "stiffness", "sensitivity": "sensitivity"}


@lru_cache(maxsize=2)
def _afm_curves(
    path: Path, stiffness: float | None = None, sensitivity: float | None = None
) -> tuple[Any, list[str]]:
    """Return the curves of a file by afmformats, and the calibration that they lack: it is one in them."""
    try:
        import afmformats
    except ImportError:
        known = ", ".join(sorted(TEXT | HDF5))
        raise TableError(
            f"{path}: must be {known}; for AFM formats first run pip install 'gfmdlayer[afm]'"
        ) from None
    logging.getLogger("afmformats").setLevel(logging.CRITICAL)  # its errors become ours
    given = {"spring constant": stiffness, "sensitivity": sensitivity}
    try:
        try:
            return afmformats.load_data(path), []
        except afmformats.errors.MissingMetaDataError as error:
            if not {*error.meta_keys} <= given.keys():
                raise
            override = {key: given[key] or 1.0 for key in error.meta_keys}
            missing = [key for key in error.meta_keys if given[key] is None]
            return afmformats.load_data(path, meta_override=override), missing
    except BaseException as error:  # each format fails with exceptions of its own, some not of Exception
        _pass_on(error)
        raise TableError(f"{path}: cannot be read by afmformats ({type(error).__name__}: {error})") from error


def _pass_on(error: BaseException) -> None:
    """Raise what ends the program."""
    if isinstance(error, (KeyboardInterrupt, SystemExit, GeneratorExit)):
        raise error


# Names of the segments of afmformats by number.
_PARTS = {
    "force-distance": ("approach", "retract"),
    "creep-compliance": ("approach", "hold", "retract"),
    "stress-relaxation": ("before", "approach", "hold", "retract"),
}


def afm_curve(
    data: Any,
    name: str,
    into: Into = SI,
    options: FitOptions = FitOptions(),  # noqa: B008
    *,
    timeless: bool = False,
    **more: Any,
) -> ForceCurve:
    """Return a curve of afmformats; the position of the tip is the measured height plus the deflection."""
    sizes = _sizes(into)
    stiffness = data.metadata.get("spring constant")
    if stiffness is None or not np.isfinite(stiffness):
        stiffness = _calibration(options, into)[0]
    if "force" not in data.columns:
        raise TableError(f"curve {name} has no force")
    force = np.asarray(data["force"])
    if "tip position" in data.columns:
        tip = np.asarray(data["tip position"])
    elif "height (measured)" in data.columns and stiffness:
        tip = np.asarray(data["height (measured)"]) + force / stiffness
    else:
        raise TableError(
            f"curve {name} has no tip position; it needs the tip position, or the measured height and the "
            "spring constant: give the stiffness of the cantilever"
        )
    words: dict[str, list[str]] = {}
    mode = str(data.metadata.get("imaging mode", "force-distance"))
    if "segment" in data.columns and mode in _PARTS:
        numbers = np.asarray(data["segment"]).astype(int)
        words["segment"] = [_PARTS[mode][min(k, len(_PARTS[mode]) - 1)] for k in numbers]
        if stiffness:
            creep = mode == "creep-compliance"
            words["prescribed"] = [FORCE if creep and word == "hold" else BASE for word in words["segment"]]
    columns = {"depth": -tip / sizes[1], "force": force / sizes[2]}
    if "time" in data.columns:
        columns["time"] = np.asarray(data["time"]) / sizes[0]
    time, note = _time(f"curve {name}", columns, options, timeless=timeless)
    if note:
        more["origin"] = more.get("origin", {}) | {"account": note}
    own = None if not stiffness else float(stiffness) * sizes[1] / sizes[2]
    return ForceCurve(
        name, time, columns["depth"], columns["force"], **curve_facts(words, own, options), **more
    )
