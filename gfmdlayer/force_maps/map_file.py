"""The file of a force map, DIR/sweep.h5: each parameter and its error over the curves.

    G0, G0_error, G0_low, G0_high, ... (y, x)      where the positions of the curves are a grid
                                       (curve)     else
    noise, aic, bic, case, name                    of each curve

A parameter is named by the last part of its key, or by the whole key where two share it. A curve that failed
is NaN, and is named in the attribute `failed`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.execution.folder import Folder
from gfmdlayer.force_maps.case_file import SCALARS, MapCase, read_estimates
from gfmdlayer.results.netcdf import add_variable, new_file, set_attributes

SAME_PLACE = 1e-3  # of the spacing: positions closer than this are the same coordinate
_SUFFIXES = ("", "_error", "_low", "_high")
_MEANINGS = (
    "",
    "standard error of ",
    "lower end of the 95 % interval of ",
    "upper end of the 95 % interval of ",
)


class _Layout(NamedTuple):
    """Coordinates of the dimensions, and the place of each case along them."""

    coordinates: dict[str, FloatArray]
    places: Sequence[tuple[int, ...]]


def collect(
    folder: Folder, cases: Sequence[MapCase], keys: Sequence[str], reasons: Mapping[int, str],
    attributes: Mapping[str, str],
) -> Path:  # fmt: skip
    """Write the map from the files of its curves.

    Parameters
    ----------
    folder : Folder
        The results folder.
    cases : sequence of MapCase
        All curves.
    keys : sequence of str
        Free parameters.
    reasons : mapping of int to str
        Why curves failed.
    attributes : mapping
        Attributes of the file.

    Returns
    -------
    Path
        The file.
    """
    layout = _layout([case.entry.position for case in cases])
    shape = tuple(values.size for values in layout.coordinates.values())
    names = parameter_names(keys)
    tables = np.full((len(keys), len(_SUFFIXES), *shape), np.nan)
    scalars = np.full((len(SCALARS), *shape), np.nan)
    numbers, labels = np.full(shape, -1), np.full(shape, "", dtype=object)
    failed = dict(reasons)
    for case, place in zip(cases, layout.places, strict=True):
        numbers[place], labels[place] = case.index, case.entry.name
        if case.index in failed:
            continue
        found = read_estimates(folder.case(case.index))
        if found is None:
            failed[case.index] = f"curve {case.entry.name}: its file cannot be read"
            continue
        order = [found.keys.index(key) for key in keys]
        np.moveaxis(tables, (0, 1), (-2, -1))[place] = found.columns[:, order].T
        np.moveaxis(scalars, 0, -1)[place] = found.scalars
    with new_file(folder.sweep) as file:
        h5 = file.begin()
        for name, values in layout.coordinates.items():
            add_variable(h5, name, (name,), {}, data=values)
        _add(h5, tuple(layout.coordinates), dict(zip(names, keys, strict=True)), tables)
        for name, table in zip(SCALARS, scalars, strict=True):
            add_variable(h5, name, tuple(layout.coordinates), {}, data=table)
        add_variable(h5, "case", tuple(layout.coordinates), {}, data=numbers)
        text: dict[str, Any] = {"data": labels, "dtype": h5py.string_dtype()}
        add_variable(h5, "name", tuple(layout.coordinates), {}, **text)
        report = "\n".join(f"{index:04d}: {reason}" for index, reason in sorted(failed.items()))
        own = {"fitted": " ".join(names), "swept": " ".join(layout.coordinates), "failed": report}
        set_attributes(h5, {**attributes, **own, "complete": 1})
    return folder.sweep


def parameter_names(keys: Sequence[str]) -> list[str]:
    """Name parameters by the last parts of their keys, or by the keys where two share it."""
    last = [key.rpartition(".")[2] for key in keys]
    taken = Counter([*last, *SCALARS, "x", "y", "curve", "case", "name"])
    return [key if taken[part] > 1 else part for key, part in zip(keys, last, strict=True)]


def _add(h5: h5py.File, dimensions: tuple[str, ...], names: Mapping[str, str], tables: FloatArray) -> None:
    for (name, key), parts in zip(names.items(), tables, strict=True):
        for suffix, meaning, table in zip(_SUFFIXES, _MEANINGS, parts, strict=True):
            described = {"long_name": f"{meaning}{key}", "key": key}
            add_variable(h5, f"{name}{suffix}", dimensions, described, data=table)


def _layout(positions: Sequence[tuple[float, ...]]) -> _Layout:
    """Place curves on the grid of their positions, if they are one; else in a row."""
    if all(len(position) == 2 for position in positions):
        x, y = np.array(positions).T
        (columns, across), (rows, up) = _levels(x), _levels(y)
        places = list(zip(rows.tolist(), columns.tolist(), strict=True))
        full = len(set(places)) == len(places) and 2 * len(places) > across.size * up.size
        if full and min(across.size, up.size) > 1:
            return _Layout({"y": up, "x": across}, places)
    return _Layout({"curve": np.arange(len(positions), dtype=float)}, [(i,) for i in range(len(positions))])


def _levels(values: FloatArray) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.int64]], FloatArray]:
    """Return the number of the level of each value, and the levels, ascending."""
    order = np.sort(values)
    steps = np.diff(order)
    spread = float(np.ptp(values))
    large = steps[steps > 1e-6 * spread] if spread > 0 else steps[:0]
    apart = SAME_PLACE * float(np.median(large)) if large.size else np.inf
    levels = order[np.concatenate(([True], steps > apart))]
    return np.abs(values[:, np.newaxis] - levels).argmin(axis=1), levels
