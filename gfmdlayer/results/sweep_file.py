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
from typing import TYPE_CHECKING, Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from gfmdlayer.config.sweeps import as_label
from gfmdlayer.observables import known_numbers
from gfmdlayer.observables.contact import TIME
from gfmdlayer.results.case_metadata import (
    INCOMPLETE,
    OF_ONE_CASE,
    CaseMetadata,
    CaseRecord,
    CommonTimes,
    SweepColumn,
    at_rows,
    equal,
    notes_on,
    rows_at,
)
from gfmdlayer.results.netcdf import add_variable, new_file, write_at
from gfmdlayer.results.reader import attribute, column, opened, sweep_path
from gfmdlayer.results.schema import FIELDS, VARIABLES, parameter

if TYPE_CHECKING:
    import xarray


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


# A sweep in memory: the datasets of its cases as one, labelled by the swept keys as in the sweep file.


def labelled(
    cases: Sequence[xarray.Dataset | None],
    values: Sequence[Mapping[str, object]],
    keys: Sequence[str],
    attributes: Mapping[str, str | int | float],
    listed: bool = False,
    unit: Callable[[str], str] = str,
) -> xarray.Dataset:
    """Return the cases of a sweep as one dataset.

    Parameters
    ----------
    cases : sequence of Dataset or None
        The cases in their order; None for one that failed, which is NaN.
    values : sequence of mapping
        The swept values of each case, by dotted key.
    keys : sequence of str
        The swept keys, dotted, in the order of the dimensions.
    attributes : mapping
        Attributes, in addition to those that all cases share.
    listed : bool
        Whether the cases are a list, along the one dimension `case`.
    unit : callable
        Label of a unit, from its words.

    Returns
    -------
    Dataset
        As `open_results` gives it: columns along the swept keys and the common times, and displacement,
        pressure and gap where the cases have the same grid and snapshots.
    """
    import xarray

    complete = [case for case in cases if case is not None]
    times = CommonTimes()
    for case in complete:
        times.add(case["time"].to_numpy(), early=bool(case.attrs.get("settled") or case.attrs.get("ended")))
    layout = lay_out(values, keys, listed)
    numbers = _gathered(layout, np.arange(len(cases)), (), np.int64)
    coords: dict[str, Any] = {"time": ("time", times.times, complete[0]["time"].attrs)}
    coords["case"] = (tuple(layout.lengths), numbers, VARIABLES["case"].described)
    for name, (key, dimension, labels) in layout.labels.items():
        coords[name] = (dimension, labels, described_key(key, unit))
    held: dict[str, Any] = {}
    lacking: dict[str, frozenset[int]] = {}
    for name, example in _columns(complete).items():
        curves = [None if case is None else _curve(case, name, example, times.times) for case in cases]
        found = _gathered(layout, curves, (times.times.size, *example.shape[1:]))
        own = f"{name}_over_time" if name in layout.labels else name
        held[own] = ((*layout.lengths, *example.dims), found, example.attrs)
        coords |= {str(end): x.variable for end, x in example.coords.items() if "time" not in x.dims}
        if without := {i for i, case in enumerate(cases) if case is not None and curves[i] is None}:
            lacking[name] = frozenset(without)
    for name, declared in known_numbers().items():
        if any(name in case.attrs for case in complete):
            values_of = [np.nan if case is None else case.attrs.get(name, np.nan) for case in cases]
            held[name] = (
                tuple(layout.lengths),
                _gathered(layout, values_of, ()),
                declared.in_units(unit).described,
            )
    same = all(_surface(case) == _surface(complete[0]) for case in complete)
    if same and complete[0].sizes["snapshot"]:
        for name in (each for each in FIELDS if all(each in case for case in complete)):
            example = complete[0][name]
            fields = [None if case is None else case[name].to_numpy() for case in cases]
            found = _gathered(layout, fields, example.shape)
            held[name] = ((*layout.lengths, *example.dims), found, example.attrs)
        coords |= {str(name): complete[0][name].variable for name in complete[0][FIELDS[0]].dims}
    notes = "\n".join(notes_on(lacking, len(complete)))
    described = {**_shared(complete), **attributes, "swept": " ".join(keys), "notes": notes}
    return xarray.Dataset(held, coords, described)


def _columns(complete: Sequence[xarray.Dataset]) -> dict[str, xarray.DataArray]:
    """Return an example of each column that any case has."""
    return {
        str(name): values
        for case in reversed(complete)
        for name, values in case.data_vars.items()
        if values.dims[:1] == ("time",)
    }


def _gathered(
    layout: Layout, parts: Iterable[Any], shape: tuple[int, ...], dtype: type = np.float64
) -> np.ndarray[Any, Any]:
    """Return the parts of all cases in their places, NaN where there is none."""
    found: np.ndarray[Any, Any] = np.full(
        (*layout.lengths.values(), *shape), np.nan if dtype is np.float64 else 0, dtype
    )
    for place, part in zip(layout.places, parts, strict=True):
        if part is not None:
            found[place] = part
    return found


def _curve(case: xarray.Dataset, name: str, example: xarray.DataArray, times: np.ndarray[Any, Any]) -> Any:
    """Return a column of a case at the common times; None where it has none, or one over other bins."""
    if name not in case:
        return None
    bins = [end for end, x in example.coords.items() if "time" not in x.dims]
    if case[name].dims != example.dims or not all(case[end].equals(example[end]) for end in bins):
        return None
    rows = rows_at(case["time"].to_numpy(), times, steady=bool(case.attrs.get("settled")))
    return at_rows(case[name].to_numpy(), rows)


def _surface(case: xarray.Dataset) -> list[Any]:
    """Return the coordinates of the snapshots, for a comparison."""
    return [case[name].to_numpy().tolist() for name in ("snapshot", "x", "y") if name in case.coords]


def _shared(complete: Sequence[xarray.Dataset]) -> dict[str, Any]:
    """Return the attributes that all cases share."""
    first, *others = complete
    return {
        name: value
        for name, value in first.attrs.items()
        if name not in OF_ONE_CASE and all(equal(case.attrs.get(name), value) for case in others)
    }
