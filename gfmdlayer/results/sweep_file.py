"""The sweep file: curves of all cases, labelled by the swept values.

    contact_area, mean_pressure (swept key, ..., time)      case (swept key, ...)
    friction, tangential_force of punches that move, and other columns that are declared `in_sweep`

A case that ended at its steady state is continued with its last row.

A sweep over the product of its keys has one dimension for each key, named by the key's last part (thickness,
shear_modulus, Ginf), or by the whole key where two keys share it. Any other list of cases (zip, samples) has
one dimension, `case`, with the swept values along it. Numbers are numbers; names, and values that are lists
or mappings, are text.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.config.sweeps import as_label
from gfmdlayer.observables import Column
from gfmdlayer.observables.contact_means import TIME
from gfmdlayer.results import scan
from gfmdlayer.results.case_metadata import LOST, CaseRecord, Survey, rows_at, sweep_columns
from gfmdlayer.results.netcdf import add_values, add_variable, new_file
from gfmdlayer.results.reader import sweep_path
from gfmdlayer.results.schema import PARAMETERS, VARIABLES, ResultsError

__all__ = ["CaseRecord", "collect", "dimension_names"]

CHUNK = 1 << 16  # values: half a megabyte, which fits the cache of HDF5


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
    listed: bool = False,
) -> Path:
    """Write DIR/sweep.h5 from the files of the cases, in a memory that does not grow with their number.

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
    listed
        Whether the cases are a list, along the one dimension `case` even where they happen to be a product.

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
    survey = Survey(records)
    rows = survey.common if times is None or survey.same_steps else np.asarray(times, dtype=float)
    layout = _layout(records, keys, listed)
    with new_file(path) as file:
        names = [column.name for column in survey.columns]
        _add_coordinates(file.begin(), layout, records, rows, survey.columns)
        for block in _blocks(layout.places, rows.size):
            curves = _curves(records[block], survey.failed, rows, names)
            _write(file.h5, layout.places[block], dict(zip(names, curves, strict=True)))
            file.check()
        own = {"swept": " ".join(keys), "complete": 1, "failed": survey.report()}
        file.h5.attrs.update({**survey.shared, **(attributes or {}), **own})
    return path


def dimension_names(keys: Sequence[str]) -> list[str]:
    """Name the swept keys by their last parts, or by the whole key where that is taken."""
    last = [key.rpartition(".")[2] for key in keys]
    taken = Counter([*last, "time", "case", *(column.name for column in sweep_columns())])
    return [key if taken[part] > 1 else part for key, part in zip(keys, last, strict=True)]


def _layout(records: Sequence[CaseRecord], keys: Sequence[str], listed: bool) -> _Layout:
    names = dimension_names(keys)
    values = {key: [record.values[key] for record in records] for key in keys}
    columns = [_labels(key, values[key]) for key in keys]
    axes = [list(dict.fromkeys(column)) for column in columns]
    cells = list(zip(*columns, strict=True)) if keys else [()]
    is_product = len(set(cells)) == len(records) == math.prod(len(axis) for axis in axes)
    if is_product and not listed:
        labels = {
            name: (key, name, np.array(axis)) for name, key, axis in zip(names, keys, axes, strict=True)
        }
        positions = [{label: place for place, label in enumerate(axis)} for axis in axes]
        places = [tuple(found[label] for found, label in zip(positions, cell, strict=True)) for cell in cells]
        return _Layout(dict(zip(names, map(len, axes), strict=True)), labels, places)
    along = {name: (key, "case", np.array(c)) for name, key, c in zip(names, keys, columns, strict=True)}
    return _Layout({"case": len(records)}, along, [(place,) for place in range(len(records))])


def _labels(key: str, values: Sequence[object]) -> list[int] | list[float] | list[str]:
    """Labels of one kind for the values of one key: numbers if all are numbers, else text."""
    if all(isinstance(value, int) and not isinstance(value, bool) for value in values):
        return [int(str(value)) for value in values]
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return [float(str(value)) for value in values]
    return [as_label(key, value) for value in values]


def _add_coordinates(
    h5: h5py.File,
    layout: _Layout,
    records: Sequence[CaseRecord],
    rows: NDArray[np.float64],
    columns: Sequence[Column],
) -> None:
    add_variable(h5, "time", ("time",), TIME.described, data=rows)
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
    for column in columns:
        shape = (*numbers.shape, rows.size)
        chunks = _chunks(shape)
        packed: dict[str, Any] = {
            "chunks": chunks,
            "compression": "gzip",
            "compression_opts": 1,
            "shuffle": True,
        }
        options = packed if chunks else {}
        dataset = add_variable(
            h5, column.name, (*dimensions, "time"), column.described,
            shape=shape, dtype="f8", fillvalue=np.nan, **options,
        )  # fmt: skip
        dataset.attrs["coordinates"] = beside


def _add_labels(h5: h5py.File, name: str, dimension: str, key: str, labels: NDArray[np.generic]) -> None:
    described = {"key": key}
    if key in PARAMETERS:
        meaning = PARAMETERS[key]
        described |= {"long_name": meaning.long_name, "symbol": meaning.symbol, "units": meaning.units}
    is_text = labels.dtype.kind == "U"
    data = {"data": labels.astype(object), "dtype": h5py.string_dtype()} if is_text else {"data": labels}
    add_variable(h5, name, (dimension,), described, **data)


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...] | None:
    """Whole curves of neighbouring cases, up to CHUNK values together."""
    if 0 in shape or not shape:
        return None
    chunks: list[int] = []
    for length in reversed(shape):
        chunks.insert(0, max(1, min(length, CHUNK // math.prod(chunks))))
    return tuple(chunks)


def _blocks(places: Sequence[tuple[int, ...]], rows: int) -> Iterator[slice]:
    """Yield runs of cases that are neighbours along the last swept dimension, not too many to be held."""
    begin, most = 0, max(1, CHUNK // max(1, rows))
    for i in range(1, len(places) + 1):
        ended = i == len(places) or i - begin == most or not places[i]
        if ended or places[i] != (*places[begin][:-1], places[begin][-1] + i - begin):
            yield slice(begin, i)
            begin = i


def _curves(
    records: Sequence[CaseRecord],
    failed: dict[int, str],
    times: NDArray[np.float64],
    names: Sequence[str],
) -> NDArray[np.float64]:
    """Read the curves of neighbours; one that turns out to be damaged joins the failed ones."""
    curves = np.full((len(names), len(records), times.size), np.nan)
    for i, record in enumerate(records):
        if record.index not in failed:
            try:
                _read(record.path, times, names, curves[:, i])
            except ResultsError:
                raise
            except Exception:  # a damaged file can fail anywhere in HDF5, with any exception
                curves[:, i], failed[record.index] = np.nan, LOST
    return curves


def _read(path: Path, times: NDArray[np.float64], names: Sequence[str], curves: NDArray[np.float64]) -> None:
    with scan.opened(path) as case:
        rows = rows_at(scan.column(case, "time"), times, goes_on=bool(scan.attribute(case, "settled")))
        if np.any(rows < 0):
            raise ResultsError(f"{path}: no row at time {times[rows < 0][0]:g}, which the sweep file needs")
        for curve, name in zip(curves, names, strict=True):
            if scan.holds(case, name):
                curve[:] = scan.column(case, name)[rows]


def _write(
    h5: h5py.File, places: Sequence[tuple[int, ...]], curves: Mapping[str, NDArray[np.float64]]
) -> None:
    for name, values in curves.items():
        if places[0]:
            *others, first = places[0]
            h5[name][(*others, slice(first, first + len(places)))] = values
        else:
            h5[name][()] = values[0]
