"""The sweep file: contact area and mean pressure of all cases, labelled by what was swept.

    contact_area, mean_pressure (swept key, ..., time)      case (swept key, ...)
    friction, tangential_force of punches that move

A case that ended when it was steady goes on with its last row.

A sweep over the product of its keys has one dimension for each key, named by the key's last part (thickness,
shear_modulus, Ginf), or by the whole key where two keys share it. Any other list of cases has one dimension,
`case`, with the swept values along it. Numbers are numbers; names, and values that are lists, are text.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.results.netcdf import add_values, add_variable, new_file
from gfmdlayer.results.reader import attributes as attributes_of
from gfmdlayer.results.reader import is_complete, sweep_path
from gfmdlayer.results.schema import PARAMETERS, VARIABLES, ResultsError

OBSERVABLES = ("contact_area", "mean_pressure")
OF_MOTION = ("friction", "tangential_force")

# Rows of two cases are at the same time if they differ by less than this part of the whole; steps that are
# counted up in different ways differ by rounding.
SAME_TIME = 1e-9

_OF_ONE_CASE = {
    *("config", "digest", "hostname", "started", "finished", "wall_seconds", "rows", "snapshots", "complete"),
}


@dataclass(frozen=True)
class CaseRecord:
    """One case of a sweep: its number, file, swept values, and why it failed if it did."""

    index: int
    path: Path
    values: Mapping[str, object]
    failed: str | None = None


@dataclass(frozen=True)
class _Layout:
    """Where each record goes: dimensions with their lengths, and labels along some of these dimensions."""

    lengths: dict[str, int]
    labels: dict[str, tuple[str, str, NDArray[np.generic]]]  # name -> (key, dimension, labels)
    places: list[tuple[int, ...]]


def collect(
    directory: str | Path,
    records: Sequence[CaseRecord],
    keys: Sequence[str],
    times: ArrayLike | None = None,
    attributes: Mapping[str, str | int | float] | None = None,
) -> Path:
    """Write DIR/sweep.h5 from the files of the cases, one at a time.

    Parameters
    ----------
    directory
        The folder of results.
    records
        The cases, in the order of their numbers.
    keys
        The swept keys, dotted, in the order of the dimensions.
    times
        Times for the rows where the cases' steps differ; every case must have them. Without it, the times
        common to all cases. Where all cases have the same steps, these are the times.
    attributes
        Attributes of the file, beside those that all cases share (name, tau, versions).

    Returns
    -------
    Path
        The file. A case that failed, or whose file is not complete, is NaN in it and named in its attribute
        `failed`, one line a case: number and reason.

    Raises
    ------
    ResultsError
        If the file cannot be written, or a complete case lacks one of `times`.
    """
    path = sweep_path(directory)
    failed = _failures(records)
    done = [record for record in records if record.index not in failed]
    layout = _layout(records, keys)
    rows = _common_times([record.path for record in done], times)
    shared = _shared_attributes(record.path for record in done)
    with new_file(path) as file:
        h5 = file.h5
        moves = any(_moves(record.path) for record in done)
        _add_coordinates(h5, layout, records, rows, OBSERVABLES + OF_MOTION * moves)
        for record, place in zip(records, layout.places, strict=True):
            if record.index not in failed:
                _copy_rows(record.path, h5, place, rows)
                file.check()
        h5.attrs.update({**shared, **(attributes or {}), "swept": " ".join(keys), "complete": 1})
        h5.attrs["failed"] = "\n".join(f"{index:04d}: {reason}" for index, reason in failed.items())
    return path


def dimension_names(keys: Sequence[str]) -> list[str]:
    """Name the swept keys by their last parts, or by the whole key where that is taken."""
    last = [key.rpartition(".")[2] for key in keys]
    taken = Counter([*last, "time", "case", *OBSERVABLES, *OF_MOTION])
    return [key if taken[part] > 1 else part for key, part in zip(keys, last, strict=True)]


def _failures(records: Sequence[CaseRecord]) -> dict[int, str]:
    failed = {record.index: record.failed for record in records if record.failed is not None}
    missing = [record for record in records if record.failed is None and not is_complete(record.path)]
    lost = {record.index: "no complete result file" for record in missing}
    return dict(sorted({**failed, **lost}.items()))


def _layout(records: Sequence[CaseRecord], keys: Sequence[str]) -> _Layout:
    names = dimension_names(keys)
    values = {key: [record.values[key] for record in records] for key in keys}
    columns = [_labels(values[key]) for key in keys]
    axes = [list(dict.fromkeys(column)) for column in columns]
    cells = list(zip(*columns, strict=True)) if keys else [()]
    if len(set(cells)) == len(records) == math.prod(len(axis) for axis in axes):
        labels = {
            name: (key, name, np.array(axis)) for name, key, axis in zip(names, keys, axes, strict=True)
        }
        positions = [{label: place for place, label in enumerate(axis)} for axis in axes]
        places = [tuple(found[label] for found, label in zip(positions, cell, strict=True)) for cell in cells]
        return _Layout(dict(zip(names, map(len, axes), strict=True)), labels, places)
    along = {name: (key, "case", np.array(c)) for name, key, c in zip(names, keys, columns, strict=True)}
    return _Layout({"case": len(records)}, along, [(place,) for place in range(len(records))])


def _labels(values: Sequence[object]) -> list[int] | list[float] | list[str]:
    """Labels of one kind for the values of one key: numbers if all are numbers, else text."""
    if all(isinstance(value, int) and not isinstance(value, bool) for value in values):
        return [int(str(value)) for value in values]
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return [float(str(value)) for value in values]
    return [_text(value) for value in values]


def _text(value: object) -> str:
    """Write a value as a label: fire, 64x128 for a pair of numbers, model=zener, G0=1.0 for a mapping."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key}={_text(entry)}" for key, entry in value.items())
    if isinstance(value, list | tuple):
        is_pair = len(value) == 2 and all(isinstance(entry, int | float) for entry in value)
        return "x".join(map(str, value)) if is_pair else f"[{', '.join(map(_text, value))}]"
    return str(value).lower() if isinstance(value, bool) else str(value)


def _common_times(paths: Sequence[Path], times: ArrayLike | None) -> NDArray[np.float64]:
    common: NDArray[np.float64] | None = None
    same_steps = goes_on = True
    for path in paths:
        own, settled = _times(path)
        if common is None or np.array_equal(own, common):
            common = own
        else:
            same_steps = False
            later = own[own > common.max(initial=0.0)] if goes_on else own[:0]
            common = np.append(common[_rows_at(own, common, goes_on=settled) >= 0], later)
        goes_on &= settled
    if times is not None and not same_steps:
        return np.asarray(times, dtype=float)
    return np.empty(0) if common is None else common


def _times(path: Path) -> tuple[NDArray[np.float64], bool]:
    """Read the times of a case, and whether it ended because nothing changed any more."""
    with h5py.File(path, locking="best-effort") as h5:
        return np.asarray(h5["time"][()], dtype=float), bool(h5.attrs.get("settled", 0))


def _rows_at(times: NDArray[np.float64], wanted: NDArray[np.float64], *, goes_on: bool) -> NDArray[np.int64]:
    """Find the rows that are at the wanted times; -1 where there is none, and no last row that goes on."""
    if times.size == 0 or wanted.size == 0:
        return np.full(wanted.shape, -1)
    tolerance = SAME_TIME * max(abs(times[-1]), abs(wanted[-1]))
    after = np.searchsorted(times, wanted - tolerance).clip(max=times.size - 1)
    found = (np.abs(times[after] - wanted) <= tolerance) | (goes_on & (wanted > times[-1]))
    return np.where(found, after, -1)


def _shared_attributes(paths: Iterable[Path]) -> dict[str, object]:
    shared: dict[str, object] | None = None
    for path in paths:
        own = {name: value for name, value in attributes_of(path).items() if name not in _OF_ONE_CASE}
        shared = own if shared is None else {n: v for n, v in shared.items() if n in own and own[n] == v}
    return shared or {}


def _add_coordinates(
    h5: h5py.File,
    layout: _Layout,
    records: Sequence[CaseRecord],
    rows: NDArray[np.float64],
    observables: tuple[str, ...],
) -> None:
    add_values(h5, "time", ("time",), rows)
    dimensions = tuple(layout.lengths)
    numbers = np.empty(tuple(layout.lengths.values()), dtype=VARIABLES["case"].dtype)
    for record, place in zip(records, layout.places, strict=True):
        numbers[place] = record.index
    if "case" in dimensions:
        add_values(h5, "case", ("case",), numbers)
    for name, (key, dimension, labels) in layout.labels.items():
        _add_labels(h5, name, dimension, key, labels)
    if "case" not in dimensions:
        add_values(h5, "case", dimensions, numbers)
    beside = " ".join(sorted({"case", *layout.labels} - set(dimensions)))
    for name in observables:
        dataset = add_variable(
            h5, name, (*dimensions, "time"), shape=(*numbers.shape, rows.size), fillvalue=np.nan
        )
        dataset.attrs["coordinates"] = beside


def _add_labels(h5: h5py.File, name: str, dimension: str, key: str, labels: NDArray[np.generic]) -> None:
    described = {"key": key}
    if key in PARAMETERS:
        meaning = PARAMETERS[key]
        described |= {"long_name": meaning.long_name, "symbol": meaning.symbol, "units": meaning.units}
    is_text = labels.dtype.kind == "U"
    data = {"data": labels.astype(object), "dtype": h5py.string_dtype()} if is_text else {"data": labels}
    add_variable(h5, name, (dimension,), described, **data)


def _moves(path: Path) -> bool:
    with h5py.File(path, locking="best-effort") as case:
        return "friction" in case


def _copy_rows(path: Path, h5: h5py.File, place: tuple[int, ...], times: NDArray[np.float64]) -> None:
    own, settled = _times(path)
    rows = _rows_at(own, times, goes_on=settled)
    if np.any(rows < 0):
        raise ResultsError(f"{path}: no row at time {times[rows < 0][0]:g}, which the sweep file needs")
    with h5py.File(path, locking="best-effort") as case:
        for name in (*OBSERVABLES, *OF_MOTION):
            if name in h5:
                h5[name][place] = case[name][()][rows] if name in case else np.nan
