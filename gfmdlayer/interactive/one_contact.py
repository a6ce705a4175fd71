"""Labelled data of one contact and of quantities derived from snapshots; numbers that a user gives."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.config import Config, ConfigError
from gfmdlayer.grid.grid import Grid
from gfmdlayer.results.case_file import Labelled, labelled
from gfmdlayer.results.names import VARIABLES
from gfmdlayer.results.provenance import provenance
from gfmdlayer.results.reader import config_in
from gfmdlayer.validation.problems import shown
from gfmdlayer.validation.units import Units

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.arrays import FloatArray


def meaning(long_name: str, units: str = "1") -> dict[str, str]:
    """Return the attributes of a variable."""
    return {"long_name": long_name, "units": units}


MEANINGS = {
    **{name: meaning(entry.long_name, entry.units) for name, entry in VARIABLES.items()},
    "contact": meaning("whether the point is in contact"),
    "contact_area": meaning("relative contact area, contact points / all points"),
    "area": meaning("contact area, of a line the width", "area"),
    "area_interpolated": meaning("contact area, of a line the width, the edge between the points", "area"),
    "area_error": meaning("estimated error of area_interpolated", "area"),
    "contact_area_interpolated": meaning("relative contact area, the edge located between the points"),
    "contact_area_error": meaning("estimated error of contact_area_interpolated"),
    "mean_pressure": meaning("mean pressure over the cell", "pressure"),
    "force": meaning("force over the cell, of a line per length", "pressure area"),
    "depth": meaning("depth of the punch below its first touch", "length"),
    "residual": meaning("residual of the contact problem"),
    "transforms": meaning("pairs of Fourier transforms, forward and backward"),
    "iterations": meaning("iterations of the contact solver"),
}


def numbers_in(value: Any) -> FloatArray:
    """Return the numbers that a user gives as an array of one axis or more; NaN for anything else."""
    try:
        return np.atleast_1d(np.asarray(value, dtype=float))
    except (TypeError, ValueError):
        return np.array([math.nan])


def number_in(value: Any) -> float:
    """Return the number that a user gives; NaN for anything else, as for a list of one number."""
    try:
        return float(value) if np.ndim(value) == 0 else math.nan
    except (TypeError, ValueError):
        return math.nan


def check_data(data: object) -> None:
    """Raise a ConfigError for what is no dataset."""
    if not hasattr(data, "data_vars"):
        allowed = "must be an xarray.Dataset of run, solve, open_case or open_results"
        raise ConfigError([f"data: got {shown(data)}; {allowed}"])


def config_of(data: xarray.Dataset, *, trust: bool) -> Config | None:
    """Return the configuration of a case; None where the data have none. Code is run only with `trust`."""
    return config_in(data.attrs, Path("case"), trust=trust) if "config" in data.attrs else None


def derived(
    data: xarray.Dataset,
    values: Mapping[str, tuple[list[str], NDArray[Any]]],
    meanings: Mapping[str, tuple[str, str]],
    kept: Collection[str],
    coords: Mapping[str, tuple[str, NDArray[Any]]] | None = None,
) -> xarray.Dataset:
    """Return derived quantities as a dataset; `values` has the dimensions and the array of each.

    The coordinates of the data along `kept` stay. `meanings` are long names and units in words; the units of
    the data replace the words.
    """
    import xarray

    labels = str(data.attrs.get("units", ""))
    label = Units(**dict(part.split(": ") for part in labels.split(", "))).label if labels else str
    known = {name: meaning(words, label(units)) for name, (words, units) in meanings.items()}
    every: dict[Any, Any] = {
        name: variable for name, variable in data.coords.items() if {*map(str, variable.dims)} <= {*kept}
    }
    every |= {name: (*variable, known[name]) for name, variable in (coords or {}).items()}
    scales = {name: data.attrs[name] for name in ("name", "L", "G0", "tau", "units") if name in data.attrs}
    held = {name: (*variable, known[name]) for name, variable in values.items()}
    return xarray.Dataset(held, every, {**provenance(), **scales})


def dataset(
    grid: Grid,
    fields: Mapping[str, NDArray[Any]],
    scalars: Mapping[str, ArrayLike],
    meanings: Mapping[str, Mapping[str, str]] = MEANINGS,
) -> xarray.Dataset:
    """Return fields on the grid, of any shape with its points in order, and numbers of the contact."""
    axes = dict(zip("xy", grid.coordinates, strict=False))
    about = {name: tuple(entry.items()) for name, entry in meanings.items()}
    held: dict[str, Labelled] = {name: ((name,), x, about[name]) for name, x in axes.items()}
    held |= {name: (tuple(axes), field.reshape(grid.shape), about[name]) for name, field in fields.items()}
    held |= {name: ((), np.asarray(value), about[name]) for name, value in scalars.items()}
    return labelled(held, axes, provenance())
