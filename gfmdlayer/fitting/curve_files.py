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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.files.hdf5 import is_hdf5, open_hdf5, refuse_other_files
from gfmdlayer.files.headings import WORDS, meaning, quantities_named
from gfmdlayer.files.tables import Answers, TableError, converted, is_text, read_table
from gfmdlayer.files.units import unit_of
from gfmdlayer.fitting.force_curve import BASE, COLUMNS, FORCE, CurveError, ForceCurve, column
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.fitting.result import FitOptions
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
    unit: str = ""  # of the position, where it is known


@dataclass(frozen=True)
class CurveSource:
    """A curve that is not read yet: in a file, or held in memory in a form that `fit_indentation` takes."""

    held: Any  # Entry, ForceCurve, curve of afmformats or nanite, mapping, frame or dataset
    name: str
    position: tuple[float, ...] = ()  # place (x, y) on the sample, or nothing
    unit: str = ""  # of the position, where it is known

    def place(self, into: Into) -> tuple[float, ...]:
        """Return the position in the unit of length of a model, where its own is known."""
        if not self.unit:
            return self.position
        known, metre = unit_of(self.unit), unit_of("m")
        if known is None or metre is None or known.dimension != metre.dimension:
            raise CurveError(f"curve {self.name}: x, y: got the unit {self.unit!r}; must be one of length")
        factor = float(known.size) / _sizes(into)[1]
        return tuple(factor * each for each in self.position)

    def curve(self, answers: Answers, into: Into, options: FitOptions, *, timeless: bool) -> ForceCurve:
        """Read the curve; CurveError or TableError if it cannot be used."""
        if isinstance(self.held, Entry):
            return read_curve(self.held, answers, into, options, timeless=timeless)
        if isinstance(self.held, ForceCurve):
            return given_curve(self.held, answers, into, options)
        if _is_afm(self.held):
            return afm_curve(self.held, self.name, into, options, timeless=timeless, position=self.position)
        return held_curve(self.held, self.name, answers, into, options, timeless=timeless)

    @property
    def digest(self) -> str:
        """A hash of a curve in memory."""
        if isinstance(self.held, ForceCurve):
            known = vars(self.held)
        else:
            names = self.held.columns if _is_afm(self.held) else self.held.keys()
            known = {str(name): self.held[name] for name in (*names, *getattr(self.held, "coords", ()))}
        told = {key: np.asarray(known[key]).tolist() for key in sorted(known)}
        return hashlib.sha256(repr((told, self.position)).encode()).hexdigest()


_FORMS = "a ForceCurve, a path, or a mapping, a frame or a dataset with the columns time, depth and force"


def sources(curves: Any) -> Iterator[CurveSource]:
    """Yield the curves in any form that `fit_indentation` takes, one or an iterable of them."""
    single = isinstance(curves, (ForceCurve, str, Path)) or hasattr(curves, "keys") or _is_afm(curves)
    if not (single or isinstance(curves, Iterable)):
        raise FitError(f"curves: got {type(curves).__name__}; must be one or several of {_FORMS}")
    for number, curve in enumerate([curves] if single else curves):
        if isinstance(curve, ForceCurve):
            yield CurveSource(curve, curve.name, curve.position)
        elif isinstance(curve, (str, Path)):
            for entry in entries([Path(curve)]):
                yield CurveSource(entry, entry.name, entry.position, entry.unit)
        elif _is_afm(curve):
            yield CurveSource(curve, f"{Path(curve.path).stem}-{curve.enum}", _afm_place(curve.metadata), "m")
        elif hasattr(curve, "keys"):
            yield CurveSource(curve, str(number), _place(getattr(curve, "attrs", curve)))
        else:
            raise FitError(f"curve {number}: got {type(curve).__name__}; must be {_FORMS}")


def _is_afm(curve: Any) -> bool:
    """Whether it is a curve of afmformats or nanite."""
    return hasattr(curve, "metadata") and hasattr(curve, "columns")


def is_map(curves: Iterable[CurveSource]) -> bool:
    """Whether the curves lie at several places, each known."""
    places = [curve.position for curve in curves]
    return all(places) and len(set(places)) > 1


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
    path = entry.path
    origin = {"file": path.name, "sha256": contents(path), "curve": entry.key}
    stiffness = None
    if _for_afmformats(path):
        curves, missing = _afm_curves(path, *_calibration(options, into))
        if missing:
            lacking = " and ".join(f"the {key} (--{_OPTIONS[key]})" for key in missing)
            raise TableError(f"{path}: the file does not have {lacking}; give it")
        data = curves[int(entry.key)]
        return afm_curve(
            data, entry.name, into, options, timeless=timeless, position=entry.position, origin=origin
        )
    words: dict[str, list[str]]
    if _in_hdf5(path):
        columns, words, stiffness, account = _hdf5_columns(entry, dict(answers.units), into)
    else:
        columns, words, account = _text_columns(path, answers, into, timeless=timeless)
    read = columns, words, stiffness, account
    return _made(entry.name, read, options, timeless, f"{path}: ", position=entry.position, origin=origin)


Columns = tuple[dict[str, FloatArray], dict[str, list[str]], float | None, str]


def _made(
    name: str, read: Columns, options: FitOptions, timeless: bool, where: str = "", **more: Any
) -> ForceCurve:
    """Return the curve of columns, words, a stiffness, and how they were read."""
    columns, words, stiffness, account = read
    facts = curve_facts(name, words, stiffness, options)
    if "depth" not in columns:
        if facts["stiffness"] is None:
            raise TableError(
                f"{where}curve {name} has the base but no depth, which is base - force/stiffness; "
                "give the stiffness of the cantilever (--stiffness)"
            )
        columns["depth"] = columns.pop("base") - columns["force"] / facts["stiffness"]
    time, note = _time(f"{where}curve {name}", columns, options, timeless=timeless)
    more["origin"] = more.get("origin", {}) | {"account": "; ".join(filter(None, (account, note)))}
    return ForceCurve(name, time, columns["depth"], columns["force"], **facts, **more)


_DIMENSIONS = ("", "time", "length", "force")  # in place of units, as in the results of `indent`


def held_curve(
    held: Any, name: str, answers: Answers, into: Into, options: FitOptions, *, timeless: bool
) -> ForceCurve:
    """Return the curve in a mapping, a frame or a dataset, whose keys are headings, see `files.headings`."""
    wanted = (*COLUMNS, "base", *WORDS)
    columns, units, words, keys = {}, {}, dict[str, list[str]](), dict[str, str]()
    pairs = dict(answers.units)
    pairs |= {"base": pairs["depth"]} if "depth" in pairs and "base" not in pairs else {}
    every = {str(key): held[key] for key in (*held.keys(), *getattr(held, "coords", ()))}
    for key in sorted(every, key=lambda each: each not in wanted):  # their own names first
        values, unit = every[key], str(getattr(every[key], "attrs", {}).get("units", ""))
        if np.ndim(values) != 1 and not isinstance(values, str):
            continue
        means = meaning(key, "" if unit in _DIMENSIONS else unit, wanted, pairs)
        asked = [quantity for quantity in means.options if quantity in wanted]
        quantity = means.quantity
        if not asked or keys.get(asked[0]) == asked[0]:
            continue
        if means.reason:
            raise TableError(f"curve {name}: {key!r} {means.reason}")
        assert quantity is not None
        if quantity in keys:
            raise TableError(f"curve {name}: {keys[quantity]!r} and {key!r} are both {quantity}; name one so")
        keys[quantity] = key
        if quantity in WORDS:
            words[quantity] = [values] if isinstance(values, str) else np.asarray(values).astype(str).tolist()
        else:
            columns[quantity], units[quantity] = column(name, quantity, values), means.symbol
    missing = [key for key in ("force",) if key not in columns]
    missing += [] if {"depth", "base"} & {*columns} else ["depth"]
    if missing:
        listed = ", ".join(every)
        raise TableError(f"curve {name}: has no {' and no '.join(missing)}; its columns are {listed}")
    if "depth" in columns and "base" in columns:  # follows from depth, force and stiffness
        del columns["base"], units["base"]
    words = {key: each * (columns["force"].size if len(each) == 1 else 1) for key, each in words.items()}
    spring = getattr(held, "attrs", {}).get("stiffness")
    stiffness = None if spring is None else float(spring)
    account = _account(f"curve {name}", columns["force"].size, units, _targets(into))
    columns, stiffness = _in_units(f"curve {name}", columns, units, stiffness, into)
    return _made(name, (columns, words, stiffness, account), options, timeless)


def given_curve(curve: ForceCurve, answers: Answers, into: Into, options: FitOptions) -> ForceCurve:
    """Return a curve with what the answers and the options say of it; CurveError if it says otherwise."""
    if answers.units:
        symbols = dict.fromkeys(COLUMNS, "") | {
            quantity: symbol
            for key, symbol in answers.units
            for quantity in quantities_named(key)
            if quantity in COLUMNS
        }
        ones = dict.fromkeys(COLUMNS, np.ones(1))
        sizes, _ = _in_units(f"curve {curve.name}", ones, symbols, None, into)
        curve = curve.in_units(*(float(sizes[key][0]) for key in COLUMNS))
    words = {} if curve.prescribed is None else {"prescribed": curve.prescribed}
    facts = curve_facts(curve.name, words, curve.stiffness, options)
    errors = curve.stiffness_error, options.stiffness_error
    facts["stiffness_error"] = _agreed(curve.name, "stiffness_error", *errors)
    del facts["segment"]
    unchanged = all(getattr(curve, key) is value for key, value in facts.items())
    return curve if unchanged else replace(curve, **facts)


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
    needs = "the model relaxes, or the fit has a drift; give the sampling rate, rows per time (--sampling)"
    raise TableError(f"{name} has no time, but {needs}")


def curve_facts(
    name: str, words: Mapping[str, str | Sequence[str]], stiffness: float | None, options: FitOptions
) -> dict[str, Any]:
    """Return the facts of a curve that are in its file, or else in the options; CurveError if they differ."""
    named, asked = words.get("prescribed"), options.prescribed
    kinds = {named} if isinstance(named, str) else {*(named or ())} - {""}
    if asked is not None and (other := kinds - {asked}):
        message = f"got prescribed = {asked!r}, but the curve says {', '.join(sorted(other))}; remove one"
        raise CurveError(f"curve {name}: {message}")
    own = _agreed(name, "stiffness", stiffness, options.stiffness)
    return {
        "segment": words.get("segment"),
        "prescribed": named if asked is None else asked,
        "stiffness": own,
        "stiffness_error": None if own is None else options.stiffness_error,
    }


_ROUNDED = 1e-6  # relative difference of numbers that agree


def _agreed(name: str, key: str, own: float | None, given: float | None) -> float | None:
    """Return a number of a curve, or the given one where it has none; CurveError if they differ."""
    if own is None or given is None:
        return given if own is None else own
    if not abs(given - own) <= _ROUNDED * abs(own):
        raise CurveError(f"curve {name}: got {key} = {given:.6g}, but the curve says {own:.6g}; remove one")
    return own


def contents(path: Path) -> str:
    """Return a hash of the contents of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _entries(path: Path) -> Iterator[Entry]:
    if _for_afmformats(path):
        for number, data in enumerate(_afm_curves(path)[0]):
            meta = data.metadata
            number_of_curve = meta.get("enum", number)
            yield Entry(path, str(number), f"{path.stem}-{number_of_curve}", _afm_place(meta), "m")
    elif _in_hdf5(path):
        yield from _hdf5_entries(path)
    else:
        yield Entry(path, "", path.stem)


def _afm_place(meta: Mapping[str, Any]) -> tuple[float, ...]:
    place = tuple(float(meta[key]) for key in ("position x", "position y") if key in meta)
    return place if len(place) == 2 else ()


def _text_columns(
    path: Path, answers: Answers, into: Into, *, timeless: bool
) -> tuple[dict[str, FloatArray], dict[str, list[str]], str]:
    """Return the columns of a text file, its words, and how it was read."""
    orders = (COLUMNS, COLUMNS[1:]) if timeless else (COLUMNS,)
    table = read_table(path, (*COLUMNS, "base", *WORDS), answers, orders=orders)
    names: list[str] = [name for name in ("time", "depth", "base", "force") if name in table.columns]
    if "depth" in names and "base" in names:  # the base follows from depth, force and stiffness
        names.remove("base")
    needed = ("force",) if "base" in names else ("force", "depth")
    missing = [name for name in needed if name not in names]
    if refused := [name for name in ("time", *missing) if name in table.refused] + missing:
        table.take(refused[0])  # says why not
    target = _targets(into)
    columns = {
        name: table.take(name, target[name] if table.columns[name].unit is not None else None)
        for name in names
    }
    return columns, dict(table.words), table.account


def _hdf5_entries(path: Path) -> Iterator[Entry]:
    with _hdf5(path) as file:
        if file.attrs.get("software") == "afmformats":
            raise TableError(f"{path}: is of afmformats; first run pip install 'gfmdlayer[afm]'")
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
        unit = "" if places is None else str(file["x"].attrs.get("units", ""))
        digits = len(str(shape[0] - 1))
        for i in range(shape[0]):
            place = () if places is None else tuple(places[i].tolist())
            yield Entry(path, str(i), f"{path.stem}-{i:0{digits}d}", place, unit)


def _targets(into: Into) -> dict[str, str]:
    """Return the unit of each column of a model."""
    return dict(zip(COLUMNS, into, strict=True)) | {"base": into[1]}


def _hdf5_columns(entry: Entry, given: Mapping[str, str], into: Into) -> Columns:
    """Return the columns of a curve, its words, its stiffness, and how it was read."""
    with _hdf5(entry.path) as file:
        row = int(entry.key) if "force" in file and entry.key else None
        place = file if "force" in file else file[entry.key]
        refuse_other_files(entry.path, place)
        columns, units, words = {}, {}, {}
        position = "depth" if "depth" in place or "base" not in place else "base"
        for key in (*(["time"] if "time" in place else []), position, "force"):
            if key not in place:
                raise TableError(f"{entry.path}: curve {entry.name} has no variable {key}")
            data = place[key]
            columns[key] = np.asarray(data[:] if data.ndim == 1 or row is None else data[row], dtype=float)
            unit = data.attrs.get("units") or ""
            own = unit.decode() if isinstance(unit, bytes) else str(unit)
            other = given.get("depth" if key == "base" else key, own)
            if own and unit_of(own) != unit_of(other):
                raise TableError(f"{entry.path}: {key} is in {own!r}, but {other!r} is given for it")
            units[key] = other
        for key in WORDS:
            if key in place:
                values, whole = place[key].asstr(), place[key].ndim == 1 or row is None
                words[key] = list(map(str, values[:] if whole else values[row]))
        stiffness = place.attrs.get("stiffness")
    sizes = {values.size for values in columns.values()}
    if len(sizes) == 1:
        missing = np.isnan(columns["force"]) & np.isnan(columns[position])
        end = int(np.flatnonzero(~missing)[-1]) + 1 if not missing.all() else missing.size
        columns = {key: values[:end] for key, values in columns.items()}
        words = {key: values[:end] for key, values in words.items()}
    title = f"{entry.path.name}, curve {entry.key}" if entry.key else entry.path.name
    account = _account(title, columns["force"].size, units, _targets(into))
    spring = None if stiffness is None else float(stiffness)
    columns, spring = _in_units(str(entry.path), columns, units, spring, into)
    return columns, words, spring, account


def _in_units(
    where: str,
    columns: Mapping[str, FloatArray],
    units: Mapping[str, str],
    stiffness: float | None,
    into: Into,
) -> tuple[dict[str, FloatArray], float | None]:
    """Return columns, and a stiffness in their units, in the units of the model; all or none have a unit."""
    if not any(units.values()):
        return dict(columns), stiffness
    if lacking := [key for key, unit in units.items() if not unit]:
        having = " and ".join(key for key, unit in units.items() if unit)
        missing = " and ".join(lacking)
        raise TableError(
            f"{where}: {having} with a unit, but {missing} without; give all units, in the "
            "attribute units or with --units"
        )
    target, found, ones = _targets(into), {}, {}
    for key, symbol in units.items():
        if (unit := unit_of(symbol)) is None:
            raise TableError(f"{where}: got the unit {symbol!r} for {key}, which is not known")
        one = unit, target[key], f"{where}: {key}", symbol
        found[key] = converted(columns[key], *one)
        ones[key] = converted(np.ones(1), *one).item()
    if stiffness is not None:
        stiffness *= ones["force"] / ones["depth" if "depth" in ones else "base"]
    return found, stiffness


def _account(title: str, rows: int, units: Mapping[str, str], into: Mapping[str, str]) -> str:
    """Say in one line how a curve was read: its columns, and their units, which all or none have."""
    parts = [
        f"{name} [{unit}] -> {name} [{into[name]}]" if unit else f"{name} [no unit] -> {name}"
        for name, unit in units.items()
    ]
    return f"{title}: {', '.join([f'{rows} rows', *parts])}"


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
    """Return the numbers x and y, or nothing where they are not numbers."""
    if not {"x", "y"} <= set(attributes) or np.ndim(attributes["x"]) or np.ndim(attributes["y"]):
        return ()
    return float(attributes["x"]), float(attributes["y"])


def _for_afmformats(path: Path) -> bool:
    """Whether a file is one of an AFM: of a format that afmformats knows, or neither HDF5 nor text."""
    if known_to_afmformats(path):
        return True
    with path.open("rb") as file:
        head = file.read(1 << 16)
    return not (_in_hdf5(path) or is_text(head) or path.suffix.lower() in TEXT)


def _in_hdf5(path: Path) -> bool:
    """Whether a file is HDF5, or should be by its name."""
    return is_hdf5(path) or path.suffix.lower() in HDF5


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
        raise TableError(
            f"{path}: is neither text nor HDF5; for AFM formats first run pip install 'gfmdlayer[afm]'"
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
            "spring constant: give the stiffness of the cantilever (--stiffness)"
        )
    words: dict[str, list[str]] = {}
    mode = str(data.metadata.get("imaging mode", "force-distance"))
    if "segment" in data.columns and mode in _PARTS:
        numbers = np.asarray(data["segment"]).astype(int)
        words["segment"] = [_PARTS[mode][min(k, len(_PARTS[mode]) - 1)] for k in numbers]
        if stiffness:
            creep = mode == "creep-compliance"
            # An instrument moves the base: that the depth is prescribed is an approximation of users.
            moved = options.prescribed if options.prescribed and not creep else BASE
            words["prescribed"] = [FORCE if creep and word == "hold" else moved for word in words["segment"]]
    columns = {"depth": -tip / sizes[1], "force": force / sizes[2]}
    if "time" in data.columns:
        columns["time"] = np.asarray(data["time"]) / sizes[0]
    units = {column: unit for column, unit in zip(COLUMNS, SI, strict=True) if column in columns}
    account = _account(f"{name} by afmformats", force.size, units, dict(zip(COLUMNS, into, strict=True)))
    own = None if not stiffness else float(stiffness) * sizes[1] / sizes[2]
    return _made(name, (columns, words, own, account), options, timeless, **more)
