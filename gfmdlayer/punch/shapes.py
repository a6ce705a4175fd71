"""Shapes of the rigid punch: the height of its surface above its lowest point, on the grid.

x is the coordinate of a line contact; on a surface in two dimensions round shapes depend on r = (x^2 +
y^2)^(1/2) in its place. A shape is either `Analytic`, a function of the coordinates that can be evaluated
with its apex anywhere, or one that gives heights on the grid: from a file, or by random numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.files.tables import LARGEST, TableError, read_columns
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.height_files import load_array, times
from gfmdlayer.punch.roughness import self_affine
from gfmdlayer.punch.topography import Topography

Shape = Callable[[Grid], FloatArray]
Axes = list[FloatArray]  # coordinates along each axis, from the apex, which broadcast to the grid's shape
PerAxis = float | tuple[float, float]


@dataclass(frozen=True)
class Analytic:
    """A shape that is a function of the coordinates, repeated with the period of the grid.

    Attributes
    ----------
    height : callable
        From the coordinates along each axis, counted from the apex.
    counts : tuple of int
        How many of them fill the cell along each axis, one after the other; the last number stands for the
        axes that follow, too.
    """

    height: Callable[[Axes], FloatArray]
    counts: tuple[int, ...] = (1,)

    def __call__(self, grid: Grid, shift: float = 0.0) -> FloatArray:
        """Heights on the grid, of the grid's shape, with the punch moved along x by any length."""
        counts = self.counts + self.counts[-1:] * (len(grid.shape) - len(self.counts))
        axes = [
            _from_apex(x - moved, length, count)
            for x, moved, length, count in zip(
                grid.coordinates, (shift, 0.0), grid.period, counts, strict=False
            )
        ]
        sparse = np.meshgrid(*axes, indexing="ij", sparse=True)
        return np.array(np.broadcast_to(self.height(list(sparse)), grid.shape))


def parabola(radius: PerAxis) -> Analytic:
    """r^2/(2 R), the paper's Eq. (30); with two radii x^2/(2 Rx) + y^2/(2 Ry)."""

    def height(axes: Axes) -> FloatArray:
        if isinstance(radius, tuple):
            return np.asarray(sum(x**2 / (2 * R) for x, R in zip(axes, radius, strict=True)))
        return distance(axes) ** 2 / (2 * radius)

    return Analytic(height)


def sphere(radius: float) -> Analytic:
    """R - (R^2 - r^2)^(1/2), and R beyond the radius."""
    return Analytic(lambda axes: _circle(distance(axes), radius))


def cylinder(radius: float, along: str = "y") -> Analytic:
    """R - (R^2 - x^2)^(1/2), and R beyond the radius, constant along one axis."""
    return Analytic(lambda axes: _circle(np.abs(_across(axes, along)), radius))


def cone(slope: float) -> Analytic:
    """Slope times r."""
    return Analytic(lambda axes: slope * distance(axes))


def wedge(slope: float, along: str = "y") -> Analytic:
    """Slope times |x|, constant along one axis."""
    return Analytic(lambda axes: slope * np.abs(_across(axes, along)))


def pyramid(angle: float, faces: int) -> Analytic:
    """A pyramid with equal faces, at an angle (in degrees) to its axis, the first of them towards +x.

    Three faces at 65.27 degrees are Berkovich's, as modified to have the area of Vickers's, which has four at
    68 (ISO 14577-2).
    """
    turns = 2 * np.pi * np.arange(faces) / faces
    slope = 1 / np.tan(np.radians(angle))

    def height(axes: Axes) -> FloatArray:
        x, y = axes
        return np.asarray(slope * np.max([np.cos(t) * x + np.sin(t) * y for t in turns], axis=0))

    return Analytic(height)


def flat(width: PerAxis, edge_radius: float) -> Analytic:
    """Flat over a line or a disc as wide, or a rectangle; s^2/(2 R_edge) a distance s outside."""

    def height(axes: Axes) -> FloatArray:
        if isinstance(width, tuple):
            outside = distance([np.maximum(np.abs(x) - w / 2, 0.0) for x, w in zip(axes, width, strict=True)])
        else:
            outside = np.maximum(distance(axes) - width / 2, 0.0)
        return outside**2 / (2 * edge_radius)

    return Analytic(height)


def sinusoid(amplitude: PerAxis, wavelength: PerAxis) -> Analytic:
    """Amplitude times (1 - cos(2 pi x/wavelength)), summed over the axes."""

    def height(axes: Axes) -> FloatArray:
        waves = zip(axes, _pair(amplitude), _pair(wavelength), strict=False)
        return np.asarray(sum(a * (1 - np.cos(2 * np.pi * x / length)) for x, a, length in waves))

    return Analytic(height)


def array(element: Mapping[str, object], counts: tuple[int, ...]) -> Analytic:
    """Copies of a shape side by side, as many as fill the cell along each axis."""
    one = make_shape(element)
    assert isinstance(one, Analytic)
    return Analytic(one.height, counts)


def profile(file: Path) -> Shape:
    """Heights from a file: .npy of the grid's shape, or text with a row, x and height, for each grid point.

    Raises
    ------
    TableError
        When called with a grid, if the file does not hold finite heights for exactly its points; x must be
        spaced by L/n.
    """

    def heights(grid: Grid) -> FloatArray:
        found = load_array(file) if file.suffix == ".npy" else _load_text(file, grid)
        if found.shape != grid.shape:
            raise TableError(
                f"{file}: holds {times(found.shape)} heights; must be {times(grid.shape)}, as the grid"
            )
        if not np.isfinite(found).all():
            where = np.argwhere(~np.isfinite(found))[0].tolist()
            raise TableError(f"{file}: the height at index {where} is not a finite number")
        if np.abs(found).max() > LARGEST:
            where = list(map(int, np.unravel_index(np.abs(found).argmax(), found.shape)))
            raise TableError(f"{file}: the height at index {where} is too large; must be up to {LARGEST:g}")
        return np.asarray(found - found.min())

    return heights


def make_shape(punch: Mapping[str, object]) -> Shape:
    """The shape that a section of a configuration describes, its keys as plain data."""
    keys = dict(punch)
    return SHAPES[str(keys.pop("shape"))](**keys)


SHAPES: dict[str, Callable[..., Shape]] = {
    "parabola": parabola,
    "sphere": sphere,
    "cylinder": cylinder,
    "cone": cone,
    "wedge": wedge,
    "pyramid": pyramid,
    "flat": flat,
    "sinusoid": sinusoid,
    "array": array,
    "self_affine": self_affine,
    "profile": profile,
    "topography": Topography,
}


def distance(axes: Axes) -> FloatArray:
    """Distance r from the apex."""
    return np.asarray(np.sqrt(sum(np.square(x) for x in axes)))


def _circle(r: FloatArray, radius: float) -> FloatArray:
    r = np.minimum(r, radius)
    return np.asarray(r * r / (radius + np.sqrt(radius * radius - r * r)))


def _across(axes: Axes, along: str) -> FloatArray:
    return axes[1] if along == "x" else axes[0]


def _pair(values: PerAxis) -> tuple[float, float]:
    return values if isinstance(values, tuple) else (values, values)


def _from_apex(x: FloatArray, length: float, count: int) -> FloatArray:
    """Coordinate from the middle of the nearest of `count` copies in a period around the origin."""
    copies = np.floor((x / length + 0.5) * count)
    return np.asarray(x - ((copies + 0.5) / count - 0.5) * length)


def _load_text(file: Path, grid: Grid) -> FloatArray:
    if len(grid.shape) != 1:
        raise TableError(
            f"{file}: two columns describe a line; a surface in two dimensions needs an array (.npy)"
        )
    x, height = read_columns(file, ("x", "height")).T
    spacing = grid.period[0] / grid.points[0]
    if x.size == grid.size and not np.allclose(np.diff(x), spacing, rtol=1e-6, atol=0):
        row = int(np.argmax(np.abs(np.diff(x) - spacing))) + 1
        raise TableError(
            f"{file}: x is not spaced by period/points = {spacing:.6g} (worst at data row {row + 1})"
        )
    return np.ascontiguousarray(height)
