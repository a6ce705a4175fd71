"""A sweep in memory: the datasets of its cases as one, labelled by the swept keys as in the sweep file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gfmdlayer.results.case_metadata import OF_ONE_CASE, CommonTimes, rows_at, sweep_columns
from gfmdlayer.results.schema import FIELDS, variable
from gfmdlayer.results.sweep_file import Layout, described_key, lay_out

if TYPE_CHECKING:
    import xarray


def labelled(
    cases: Sequence[xarray.Dataset | None],
    values: Sequence[Mapping[str, object]],
    keys: Sequence[str],
    attributes: Mapping[str, str | int | float],
    listed: bool = False,
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
        times.add(case["time"].to_numpy(), steady=bool(case.attrs.get("settled")))
    layout = lay_out(values, keys, listed)
    numbers = _gathered(layout, np.arange(len(cases)), (), np.int64)
    held: dict[str, Any] = {}
    for column in sweep_columns():
        if any(column.name in case for case in complete):
            curves = [None if case is None else _curve(case, column.name, times.times) for case in cases]
            found = _gathered(layout, curves, times.times.shape)
            held[column.name] = ((*layout.lengths, "time"), found, column.described)
    coords: dict[str, Any] = {"time": ("time", times.times, complete[0]["time"].attrs)}
    coords["case"] = (tuple(layout.lengths), numbers, _described("case"))
    for name, (key, dimension, labels) in layout.labels.items():
        coords[name] = (dimension, labels, described_key(key))
    same = all(_surface(case) == _surface(complete[0]) for case in complete)
    if same and complete[0].sizes["snapshot"]:
        for name in FIELDS:
            example = complete[0][name]
            fields = [None if case is None else case[name].to_numpy() for case in cases]
            found = _gathered(layout, fields, example.shape)
            held[name] = ((*layout.lengths, *example.dims), found, example.attrs)
        coords |= {str(name): complete[0][name].variable for name in complete[0][FIELDS[0]].dims}
    return xarray.Dataset(held, coords, _shared(complete) | {**attributes, "swept": " ".join(keys)})


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


def _curve(case: xarray.Dataset, name: str, times: np.ndarray[Any, Any]) -> Any:
    """Return a column of a case at the common times; None where the case does not have it."""
    if name not in case:
        return None
    rows = rows_at(case["time"].to_numpy(), times, steady=bool(case.attrs.get("settled")))
    return case[name].to_numpy()[rows]


def _surface(case: xarray.Dataset) -> list[Any]:
    """Return the coordinates of the snapshots, for a comparison."""
    return [case[name].to_numpy().tolist() for name in ("snapshot", "x", "y") if name in case.coords]


def _shared(complete: Sequence[xarray.Dataset]) -> dict[str, Any]:
    """Return the attributes that all cases share."""
    first, *others = complete
    return {
        name: value
        for name, value in first.attrs.items()
        if name not in OF_ONE_CASE and all(case.attrs.get(name) == value for case in others)
    }


def _described(name: str) -> dict[str, str]:
    entry = variable(name)
    return {"long_name": entry.long_name, "units": entry.units}
