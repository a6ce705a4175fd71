"""The sweep file: curves of all cases, labelled by the swept keys.

    contact_area and the other columns of the cases (swept key, ..., time[, bin])      case (swept key, ...)
    pull_off_force and other numbers of a whole case (swept key, ...)

A column whose name a swept key has taken is called NAME_over_time: depth_over_time in a sweep of
trajectory.depth. A case without a column that others have is NaN there, and named in the attribute `notes`.
A case that ended in a steady state keeps its last row at all later times, and one whose punch was pulled off
is NaN there.

A sweep over the product of its keys has one dimension for each key, named by the key's last part (thickness,
shear_modulus, Ginf), or by the whole key where two keys share it. Any other list of cases (zip, samples) has
one dimension, `case`, with the swept values along it. Labels are numbers if all values of the key are, else
text. Arguments of xarray's `sel` do not name a dimension: that of solver.method has the whole key, and
`sel({"solver.method": "fire"})` selects from it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from gfmdlayer.config.sweeps import as_label
from gfmdlayer.observables import known_numbers
from gfmdlayer.observables.contact_means import TIME
from gfmdlayer.results.case_metadata import (
    INCOMPLETE,
    CaseMetadata,
    CaseRecord,
    SweepColumn,
    at_rows,
    rows_at,
)
from gfmdlayer.results.netcdf import add_variable, new_file, write_at
from gfmdlayer.results.reader import attribute, column, opened, sweep_path
from gfmdlayer.results.schema import VARIABLES, parameter

CHUNK = 1 << 16  # values: half a megabyte, which fits the chunk cache of HDF5


# These dimensions cannot be selected by keyword: sel(tolerance=1e-6) selects nothing, without an error.
_ARGUMENTS_OF_SEL = ("indexers", "method", "tolerance", "drop")


class Labels(NamedTuple):
    """Labels along a dimension: the swept key that they are values of, numbers or texts."""

    key: str
    dimension: str
    values: NDArray[np.generic]


class Layout(NamedTuple):
    """Lengths of the dimensions, labels by coordinate, and the place of each case along the dimensions."""

    lengths: dict[str, int]
    labels: dict[str, Labels]
    places: list[tuple[int, ...]]


def collect(
    directory: str | Path,
    records: Sequence[CaseRecord],
    keys: Sequence[str],
    attributes: Mapping[str, str | int | float] | None = None,
    listed: bool = False,
    unit: Callable[[str], str] = str,
) -> Path:
    """Write DIR/sweep.h5 from the files of the cases, one of which is in memory at a time.

    A case that failed or whose file is not complete is NaN, and is named in the attribute `failed`, which has
    one line per such case: number and reason. The attribute `notes` has a line for each column that some of
    the cases lack.

    Parameters
    ----------
    directory : str or Path
        The folder of results.
    records : sequence of CaseRecord
        The cases, in the order of their numbers.
    keys : sequence of str
        The swept keys, dotted, in the order of the dimensions.
    attributes : mapping, optional
        Attributes of the file, in addition to those that all cases share (name, tau, versions).
    listed : bool
        Whether the cases are a list, along the one dimension `case` even where they happen to be a product.
    unit : callable
        Label of a unit, from its words.

    Returns
    -------
    Path
        The sweep file.

    Raises
    ------
    ResultsError
        If the file cannot be written.
    """
    path = sweep_path(directory)
    cases = CaseMetadata(records)
    failed, rows = cases.failed, cases.common_times
    layout = lay_out([record.values for record in records], keys, listed)
    with new_file(path) as file:
        h5 = file.begin()
        numbers = np.empty(tuple(layout.lengths.values()), dtype=VARIABLES["case"].dtype)
        for record, place in zip(records, layout.places, strict=True):
            numbers[place] = record.index
        _add_coordinates(h5, layout, numbers, rows, unit)
        _add_numbers(h5, layout, numbers, cases.numbers, unit)
        columns = _add_columns(h5, layout, (*numbers.shape, rows.size), cases.columns)
        for record, place in zip(records, layout.places, strict=True):
            if record.index not in failed:
                held = [name for name in columns if record.index not in cases.lacking.get(name, ())]
                try:
                    curves = _read(record.path, rows, held)
                except Exception:  # a damaged file can fail anywhere in HDF5, with any exception
                    failed[record.index] = INCOMPLETE
                    continue
                for name, values in curves.items():
                    if values.size:
                        start = (*place, *(0 for _ in values.shape))
                        write_at(columns[name].id, start, values.reshape(*(1 for _ in place), *values.shape))
                file.check()
        report = "\n".join(f"{index:04d}: {reason}" for index, reason in sorted(failed.items()))
        notes = "\n".join(cases.notes)
        own = {"swept": " ".join(keys), "complete": 1, "failed": report, "notes": notes}
        h5.attrs.update({**cases.shared, **(attributes or {}), **own})
    return path


def dimension_names(keys: Sequence[str]) -> list[str]:
    """Name the swept keys by their last parts, or by the whole key where that is taken."""
    last = [key.rpartition(".")[2] for key in keys]
    taken = Counter([*last, "time", "case", *VARIABLES, *_ARGUMENTS_OF_SEL])
    return [key if taken[part] > 1 else part for key, part in zip(keys, last, strict=True)]


def lay_out(values: Sequence[Mapping[str, object]], keys: Sequence[str], listed: bool) -> Layout:
    """Return the dimensions of a sweep and the places of its cases.

    Parameters
    ----------
    values : sequence of mapping
        The swept values of each case, by dotted key.
    keys : sequence of str
        The swept keys, dotted, in the order of the dimensions.
    listed : bool
        Whether the cases are a list, along the one dimension `case`.

    Returns
    -------
    Layout
    """
    columns = [_labels(key, [each[key] for each in values]) for key in keys]
    named = list(zip(dimension_names(keys), keys, columns, strict=True))
    axes = [{label: i for i, label in enumerate(dict.fromkeys(column))} for column in columns]
    cells = list(zip(*columns, strict=True)) if keys else [()]
    is_product = len(set(cells)) == len(values) == math.prod(map(len, axes))
    if listed or not is_product:
        along = {name: Labels(key, "case", np.array(column)) for name, key, column in named}
        return Layout({"case": len(values)}, along, [(i,) for i in range(len(values))])
    lengths = {name: len(axis) for (name, *_), axis in zip(named, axes, strict=True)}
    labels = {
        name: Labels(key, name, np.array(list(axis)))
        for (name, key, _), axis in zip(named, axes, strict=True)
    }
    places = [tuple(axis[label] for axis, label in zip(axes, cell, strict=True)) for cell in cells]
    return Layout(lengths, labels, places)


def _labels(key: str, values: Sequence[object]) -> list[int] | list[float] | list[str]:
    """Return labels of one type for the values of one key: numbers if all are numbers, else text."""
    if all(isinstance(value, int) and not isinstance(value, bool) for value in values):
        return [int(str(value)) for value in values]
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return [float(str(value)) for value in values]
    return [as_label(key, value) for value in values]


def _add_coordinates(
    h5: h5py.File,
    layout: Layout,
    numbers: NDArray[np.generic],
    rows: NDArray[np.float64],
    unit: Callable[[str], str],
) -> None:
    """Add time, the labels and the numbers of the cases; a dimension comes before what lies along it."""
    add_variable(h5, "time", ("time",), TIME.described | {"units": unit(TIME.units)}, data=rows)
    if "case" in layout.lengths:
        add_variable(h5, "case", ("case",), data=numbers)
    for name, (key, dimension, labels) in layout.labels.items():
        described = described_key(key, unit)
        text: dict[str, Any] = {"data": labels.astype(object), "dtype": h5py.string_dtype()}
        add_variable(
            h5, name, (dimension,), described, **text if labels.dtype.kind == "U" else {"data": labels}
        )
    if "case" not in layout.lengths:
        add_variable(h5, "case", tuple(layout.lengths), data=numbers)


def described_key(key: str, unit: Callable[[str], str]) -> dict[str, str]:
    """Return the attributes of the labels of a swept key, with the label of a unit from its words."""
    if (known := parameter(key)) is None:
        return {"key": key}
    return {"key": key, "long_name": known.long_name, "symbol": known.symbol, "units": unit(known.units)}


def _add_columns(
    h5: h5py.File, layout: Layout, shape: tuple[int, ...], declared: Mapping[str, SweepColumn]
) -> dict[str, h5py.Dataset]:
    """Add the columns, NaN until they are written, in chunks of whole curves of neighbouring cases."""
    beside = {"case", *layout.labels} - layout.lengths.keys()
    columns = {}
    for name, each in declared.items():
        own = f"{name}_over_time" if name in layout.labels else name
        along, lengths, others = [*layout.lengths, "time"], shape, beside
        if each.bins:
            for end, (described, edges) in each.edges.items():
                if end not in h5:
                    add_variable(h5, end, (each.bins,), described, data=edges)
            along, lengths, others = [*along, each.bins], (*shape, edges.size), beside | {end}
        columns[name] = add_variable(h5, own, along, each.described, **_options(lengths))
        columns[name].attrs["coordinates"] = " ".join(sorted(others))
    return columns


def _add_numbers(
    h5: h5py.File,
    layout: Layout,
    numbers: NDArray[np.generic],
    found: Mapping[str, Mapping[int, float]],
    unit: Callable[[str], str],
) -> None:
    """Add the numbers of whole cases, NaN where a case has none."""
    for name, values in found.items():
        described = known_numbers()[name].in_units(unit).described
        held = np.array([values.get(int(index), np.nan) for index in numbers.ravel()])
        variable = add_variable(h5, name, tuple(layout.lengths), described, data=held.reshape(numbers.shape))
        variable.attrs["coordinates"] = " ".join(sorted({"case", *layout.labels} - layout.lengths.keys()))


def _options(shape: tuple[int, ...]) -> dict[str, Any]:
    """Options of a column."""
    options: dict[str, Any] = {"shape": shape, "dtype": "f8", "fillvalue": np.nan}
    if math.prod(shape):
        chunks: list[int] = []
        for length in reversed(shape):
            chunks.insert(0, max(1, min(length, CHUNK // math.prod(chunks))))
        options |= {"chunks": tuple(chunks), "compression": "gzip", "compression_opts": 1, "shuffle": True}
    return options


def _read(path: Path, times: NDArray[np.float64], names: Iterable[str]) -> dict[str, NDArray[np.float64]]:
    """Read the curves of a case at the times of the sweep file."""
    with opened(path) as case:
        rows = rows_at(column(case, "time"), times, steady=bool(attribute(case, "settled")))
        if np.any(rows < 0) and not attribute(case, "ended"):
            raise ValueError(f"{path}: has been changed")
        return {name: at_rows(column(case, name), rows) for name in names}
