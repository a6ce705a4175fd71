"""Shapes of the rigid punch: the height of its surface above its lowest point, on the grid.

x is the coordinate of a line contact; on a surface in two dimensions round shapes depend on r = (x^2 +
y^2)^(1/2) in its place.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from gfmdlayer.contact.grid import FloatArray, Grid
from gfmdlayer.tables import TableError, read_columns

Shape = Callable[[Grid], FloatArray]


def parabola(radius: float) -> Shape:
    """r^2/(2 R), the paper's Eq. (30)."""
    return lambda grid: distance(grid) ** 2 / (2 * radius)


def cylinder(radius: float) -> Shape:
    """R - (R^2 - r^2)^(1/2): a circular cylinder, or a sphere; outside its radius, no punch lower than R."""

    def heights(grid: Grid) -> FloatArray:
        r = np.minimum(distance(grid), radius)
        return np.asarray(r * r / (radius + np.sqrt(radius * radius - r * r)))

    return heights


def wedge(slope: float) -> Shape:
    """Slope times r: a wedge, or a cone."""
    return lambda grid: slope * distance(grid)


def flat(width: float, edge_radius: float) -> Shape:
    """Flat over the width, outside it (|r| - width/2)^2/(2 R_edge)."""
    return lambda grid: np.maximum(distance(grid) - width / 2, 0.0) ** 2 / (2 * edge_radius)


def sinusoid(amplitude: float, wavelength: float) -> Shape:
    """Amplitude times (1 - cos(2 pi x/wavelength)), summed over the axes."""

    def heights(grid: Grid) -> FloatArray:
        waves = (amplitude * (1 - np.cos(2 * np.pi * x / wavelength)) for x in _axes(grid))
        return np.asarray(sum(np.broadcast_to(wave, grid.shape) for wave in waves))

    return heights


def profile(file: Path) -> Shape:
    """Heights from a file: .npy of the grid's shape, or text with a row, x and height, for each grid point.

    Raises
    ------
    TableError
        When called with a grid, if the file does not hold finite heights for exactly its points; x must be
        spaced by L/n.
    """

    def heights(grid: Grid) -> FloatArray:
        found = _load_array(file) if file.suffix == ".npy" else _load_text(file, grid)
        if found.shape != grid.shape:
            raise TableError(
                f"{file}: holds {_times(found.shape)} heights; must be {_times(grid.shape)}, as the grid"
            )
        if not np.isfinite(found).all():
            where = np.argwhere(~np.isfinite(found))[0].tolist()
            raise TableError(f"{file}: the height at index {where} is not a finite number")
        return np.asarray(found - found.min())

    return heights


SHAPES: dict[str, Callable[..., Shape]] = {
    "parabola": parabola,
    "cylinder": cylinder,
    "wedge": wedge,
    "flat": flat,
    "sinusoid": sinusoid,
    "profile": profile,
}


def distance(grid: Grid) -> FloatArray:
    """Distance r of the grid points from the middle of the cell."""
    return np.asarray(np.sqrt(sum(np.square(x) for x in _axes(grid))))


def _axes(grid: Grid) -> list[FloatArray]:
    return list(np.meshgrid(*grid.coordinates, indexing="ij", sparse=True))


def _load_array(file: Path) -> FloatArray:
    try:
        found = np.load(file, allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise TableError(f"{file}: is not a NumPy array file ({error})") from error
    if not (isinstance(found, np.ndarray) and found.dtype.kind in "fiu"):
        raise TableError(f"{file}: must hold one array of real numbers")
    return found.astype(np.float64)


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


def _times(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))
