"""Fields and numbers of one contact as labelled data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike, NDArray

from gfmdlayer.grid.grid import Grid
from gfmdlayer.results.provenance import provenance
from gfmdlayer.results.schema import VARIABLES

if TYPE_CHECKING:
    import xarray


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


def dataset(
    grid: Grid,
    fields: Mapping[str, NDArray[Any]],
    scalars: Mapping[str, ArrayLike],
    meanings: Mapping[str, Mapping[str, str]] = MEANINGS,
) -> xarray.Dataset:
    """Return fields on the grid, of any shape with its points in order, and numbers of the contact."""
    import xarray

    axes = dict(zip("xy", grid.coordinates, strict=False))
    held: dict[str, Any] = {
        name: (tuple(axes), values.reshape(grid.shape), meanings[name]) for name, values in fields.items()
    }
    held |= {name: ((), value, meanings[name]) for name, value in scalars.items()}
    coords = {name: ((name,), x, meanings[name]) for name, x in axes.items()}
    return xarray.Dataset(held, coords, provenance())
