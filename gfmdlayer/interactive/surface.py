"""Surfaces for `gfmdlayer.solve`: heights with the points, the period and the unit that they have.

A file, `gfmdlayer.Topography`, the object of that name of the package SurfaceTopography, and an
xarray.DataArray say their points and their size; an array its points; a function and other shapes neither.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.files.tables import TableError
from gfmdlayer.interactive.one_contact import numbers_in
from gfmdlayer.punch.measured import Topography
from gfmdlayer.punch.scan import length_unit
from gfmdlayer.punch.scan_files import read_scan
from gfmdlayer.punch.shape import Cell, Shape
from gfmdlayer.punch.topography import numbers
from gfmdlayer.validation.problems import ConfigError, shown

Punch = Any  # see `surface_of`
POINTS = 1024  # of a line, where neither `points` nor the surface says how many
_SAME = 1e-6  # relative: spacings of the same grid
_AGREE = 1e-3  # relative: a period and a size, which headers round
_FORMS = (
    "must be heights as an array, a DataArray or a function of x[, y], the file of a surface, or a shape "
    "such as Sphere(radius=1.0), or its keys"
)


class GivenSurface(NamedTuple):
    """Heights of a punch with the grid that they have."""

    heights: ArrayLike | Callable[..., ArrayLike] | Shape | Mapping[str, Any]  # arrays outward from the punch
    points: Any  # as a user gives them
    period: Any
    unit: str = ""  # of length, where the surface has one
    account: str = ""  # how its file was read
    notes: tuple[str, ...] = ()  # changes of a measured surface, and seams


def surface_of(punch: Any, points: Any, period: Any) -> GivenSurface:
    """Return a punch with its grid; ConfigError for what is none, or a grid that is not the surface's."""
    if isinstance(punch, Mapping) and punch.get("shape") == "topography":
        try:
            punch = Topography(**punch)
        except ConfigError as error:
            raise ConfigError(f"punch.{problem}" for problem in error.problems) from None
    if isinstance(punch, str | os.PathLike):
        punch = _named(punch)
    if isinstance(punch, Topography):
        return _of_file(punch, points, period)
    if isinstance(punch, Shape | Mapping) or callable(punch):
        return GivenSurface(punch, POINTS if points is None else points, 1.0 if period is None else period)
    if hasattr(punch, "physical_sizes") and hasattr(punch, "heights"):
        unit = str(getattr(punch, "unit", None) or "")
        return _sized(punch.heights(), punch.physical_sizes, unit, points, period)
    if hasattr(punch, "dims") and hasattr(punch, "coords"):
        return _of_array(punch, points, period)
    heights = numbers(punch)
    if heights.ndim not in {1, 2} or not heights.size:
        raise ConfigError([f"punch: got {_shown(punch, heights)}; {_FORMS}"])
    return GivenSurface(
        heights, heights.shape if points is None else points, 1.0 if period is None else period
    )


def _shown(punch: object, heights: Any) -> str:
    return f"an array of {heights.ndim} dimensions" if heights.ndim else shown(punch)


def _named(name: str | os.PathLike[str]) -> Topography:
    """Return the surface in a file."""
    path = Path(name)
    if not path.is_file():
        message = "which is no file; a shape is an object such as Sphere(radius=1.0), or its keys"
        raise ConfigError([f"punch: got {shown(str(name))}, {message}, {{shape: sphere, radius: 1.0}}"])
    return Topography(file=path.absolute())


def _of_file(shape: Topography, points: Any, period: Any) -> GivenSurface:
    """Return a measured surface, whose file says points and size; a line only where `points` has one axis."""
    axes = 1 if np.size(points) == 1 and points is not None else 2
    try:
        scan = read_scan(shape.file, axes, shape._keys)
        units = [axis.unit for axis in scan.axes] + [scan.unit]
        word = shape.unit if isinstance(shape.unit, str) else ""
        unit = next(filter(None, units), length_unit(word) if word else None)
        scale = shape.unit if isinstance(shape.unit, float | int) else 1.0  # of lengths without a unit
        own = [
            axis.length * (axis.unit.size / unit.size if axis.unit and unit else scale)
            for axis in scan.axes
            if axis.length is not None
        ]
        sizes = [*shape.size] * (1 if len(shape.size) == axes else axes) if shape.size else own
        if len(sizes) < axes:
            if period is None:
                lacks = f"{shape.file} does not say the size of the surface"
                raise ConfigError([f"period: missing; give it, as {lacks}"])
            sizes = []
        sized = _sized(shape, sizes, unit.symbol if unit else "", points or scan.shape, period)
        lengths = tuple(numbers_in(sized.period).tolist())
        cell = Cell(tuple(np.atleast_1d(sized.points).tolist()), lengths * (axes // len(lengths)))
        shape = cast("Topography", shape.with_length(sized.unit or None))
        return sized._replace(heights=shape, account=shape.account(cell), notes=tuple(shape.notes(cell)))
    except TableError as error:
        raise ConfigError([f"punch: {error}"]) from None


def _sized(heights: Any, sizes: Any, unit: str, points: Any, period: Any) -> GivenSurface:
    """Return heights on a surface of known size; ConfigError for another period."""
    sizes = tuple(float(each) for each in sizes or ())
    given = sizes if period is None else numbers_in(period)
    if sizes and (len(given) not in {1, len(sizes)} or not np.allclose(given, sizes, rtol=_AGREE, atol=0.0)):
        words = f"{' x '.join(f'{each:g}' for each in sizes)} {unit}".rstrip()
        raise ConfigError([f"period: got {shown(period)}, but the surface has {words}; remove it"])
    values = heights if isinstance(heights, Shape) else numbers(heights)
    return GivenSurface(values, points if points is not None else values.shape, sizes or period, unit)


def _of_array(heights: Any, points: Any, period: Any) -> GivenSurface:
    """Return heights over the coordinates of a DataArray, which are equally spaced."""
    dims = [str(name) for name in heights.dims]
    if len(dims) not in {1, 2}:
        raise ConfigError(
            [f"punch: got a DataArray over {', '.join(dims) or 'nothing'}; must be over x, or x and y"]
        )
    dims = [name for name in ("x", "y") if name in dims] if {*dims} <= {"x", "y"} else dims
    if not {*dims} <= heights.coords.keys():
        return surface_of(heights.transpose(*dims).to_numpy(), points, period)
    heights, sizes = heights.sortby(dims), []
    units = [str(each.attrs.get("units", "")) for each in (heights, *(heights[name] for name in dims))]
    for name in dims:
        steps = np.diff(heights[name].to_numpy().astype(float))
        if not (steps.size and np.allclose(steps, steps[0], rtol=_SAME, atol=0.0) and steps[0] > 0):
            raise ConfigError([f"punch: got unequal steps of {name}; must be equal, as those of the grid"])
        sizes.append(float(steps[0]) * (steps.size + 1))
    known = [length_unit(unit) for unit in units]
    if any(units) and not (all(known) and len({*units[1:]}) == 1):
        words = ", ".join(
            f"{name} in {unit or 'no unit'}" for name, unit in zip(("heights", *dims), units, strict=True)
        )
        raise ConfigError([f"punch: got {words}; must be lengths, x and y in one unit, or all without units"])
    factor = known[0].size / known[1].size if known[0] and known[1] else 1.0
    return _sized(factor * heights.transpose(*dims).to_numpy(), sizes, units[1], points, period)
