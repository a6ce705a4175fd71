"""A sweep in memory: the datasets of its cases as one, labelled by the swept keys as in the sweep file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gfmdlayer.observables import known_numbers
from gfmdlayer.results.case_metadata import OF_ONE_CASE, CommonTimes, at_rows, equal, notes_on, rows_at
from gfmdlayer.results.schema import FIELDS, VARIABLES
from gfmdlayer.results.sweep_file import Layout, described_key, lay_out

if TYPE_CHECKING:
    import xarray


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
