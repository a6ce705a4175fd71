"""A shape of the rigid punch: its keys in a configuration, its heights, and whether it fits into the cell.

x is the coordinate of a line contact; on a surface in two directions round shapes depend on r = (x^2 +
y^2)^(1/2) in its place. Where a key takes a value for each direction, .inf is a flat one. Modules of shapes
import numpy only inside of methods, as configurations are read without it.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from gfmdlayer.made_once import made_once
from gfmdlayer.validation.problems import Mistake, shown
from gfmdlayer.validation.sections import Kind

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.grid.grid import Grid

Axes = list["FloatArray"]  # coordinates along each axis, from the apex, which broadcast to the grid's shape


class Cell(NamedTuple):
    """The periodic cell: points and length along each axis."""

    points: tuple[int, ...]
    period: tuple[float, ...]


class Extent(NamedTuple):
    """Length along an axis that is one punch's own: the period, or its part of an array."""

    axis: int
    length: float
    words: str  # "the period over 4 in x, 0.25"


class Shape(Kind):
    """A shape of the punch."""

    rough: ClassVar[bool] = False  # touches in many patches

    shape: str
    """word that chooses the shape"""

    @property
    def whole_only(self) -> str:
        """Key and value that keep this shape from being distributed over ranks; else empty."""
        return ""

    def with_length(self, length: str | None) -> Shape:  # noqa: ARG002
        """Return the shape whose file, if it has one, is converted into a unit of length.

        Parameters
        ----------
        length : str or None
            Unit of length of the configuration, such as mm; None where it has none.
        """
        return self

    @abstractmethod
    def heights(self, grid: Grid) -> FloatArray:
        """Heights above the lowest point, of the grid's shape.

        Parameters
        ----------
        grid : Grid
            The grid of the surface.

        Returns
        -------
        ndarray
            Heights of the grid's shape: length.

        Raises
        ------
        TableError
            If the heights come from a file that cannot be used on this grid.
        """

    def misfits(self, cell: Cell) -> Iterator[Mistake]:  # noqa: ARG002
        """Yield why the punch does not fit into the cell or onto its grid, in keys of the punch.

        Parameters
        ----------
        cell : Cell
            Points and period (length) along each axis.
        """
        return iter(())

    def notes(self, cell: Cell) -> list[str]:  # noqa: ARG002
        """Describe the changes made to a measured surface.

        Parameters
        ----------
        cell : Cell
            Points and period (length) along each axis.
        """
        return []

    def account(self, cell: Cell) -> str:  # noqa: ARG002
        """Say in one line how its file was read, if it has one.

        Parameters
        ----------
        cell : Cell
            Points and period (length) along each axis.
        """
        return ""

    def mean_height(self, cell: Cell) -> float | None:  # noqa: ARG002
        """Mean height in closed form, where there is one.

        Parameters
        ----------
        cell : Cell
            Points and period (length) along each axis.

        Returns
        -------
        float or None
            Mean over the cell, counted from the apex: length.
        """
        return None


class Analytic(Shape):
    """A shape that is a function of the coordinates, repeated with the period of the grid."""

    @abstractmethod
    def height(self, axes: Axes) -> FloatArray:
        """Height at coordinates along each axis, counted from the apex.

        Parameters
        ----------
        axes : list of ndarray
            Coordinates along each axis, from the apex, which broadcast to the grid's shape: length.

        Returns
        -------
        ndarray
            Heights: length.
        """

    def misfit(self, extent: Extent) -> Mistake | None:  # noqa: ARG002
        """Return why the punch does not fit into its length along an axis, if so.

        Parameters
        ----------
        extent : Extent
            Axis, and the length that is one punch's own.
        """
        return None

    def heights(self, grid: Grid, counts: tuple[int, ...] = (1,)) -> FloatArray:
        """Heights of the grid's shape; `counts` copies fill the cell along each axis.

        Parameters
        ----------
        grid : Grid
            The grid of the surface.
        counts : tuple of int
            Copies along each axis, 1 by default; the last also stands for the axes that follow.

        Returns
        -------
        ndarray
            Heights of the grid's shape: length.
        """
        # The last number also stands for the axes that follow.
        return _heights(self, grid, counts + counts[-1:] * (len(grid.shape) - len(counts)))

    def misfits(self, cell: Cell, counts: tuple[int, ...] = (1, 1)) -> Iterator[Mistake]:
        """Yield the first reason for which the punch does not fit, as one of `counts` along each axis.

        Parameters
        ----------
        cell : Cell
            Points and period (length) along each axis.
        counts : tuple of int
            Copies along each axis, 1 by default.
        """
        misfit = self._misplaced(len(cell.points))
        for axis, (length, count) in enumerate(zip(cell.period, counts, strict=False)):
            part = "the period" if count == 1 else f"the period over {count}"
            words = f"{part} in {'xy'[axis]}, {length / count!r}"
            misfit = misfit or self.misfit(Extent(axis, length / count, words))
        if misfit:
            yield misfit

    def _misplaced(self, axes: int) -> Mistake | None:
        """Refuse values for two directions on a line, and a shape that is flat in both directions."""
        if axes == 1 and getattr(self, "along", "y") == "x":
            message = "got 'x', the direction of the line itself; must be y, or grid.points two numbers"
            return Mistake(("along",), message)
        for key, value in vars(self).items():
            if isinstance(value, tuple) and axes == 1:
                message = f"got {shown(value)}; must be one number, or grid.points two numbers"
                return Mistake((key,), message)
            if isinstance(value, tuple) and all(part in {0, math.inf} for part in value):
                message = f"got {shown(value)}, which makes the punch flat; one must be > 0 and finite"
                return Mistake((key,), message)
        return None


@made_once(lambda heights: heights.nbytes)
def _heights(shape: Analytic, grid: Grid, counts: tuple[int, ...]) -> FloatArray:
    import numpy as np

    axes = map(_from_apex, grid.coordinates, grid.period, counts)
    sparse = np.meshgrid(*axes, indexing="ij", sparse=True)
    heights = np.array(np.broadcast_to(shape.height(list(sparse)), grid.shape))
    heights.flags.writeable = False
    return heights


def distance(axes: Axes) -> FloatArray:
    """Distance r from the apex."""
    import numpy as np

    return np.asarray(np.sqrt(sum(np.square(x) for x in axes)))


def along_axis(values: float | tuple[float, ...], axis: int) -> float:
    """Return the value for a direction of one value for both or one for each."""
    return values[axis] if isinstance(values, tuple) else values


def single(key: str, values: float | tuple[float, ...]) -> float:
    """Return the one value of a shape of revolution; ValueError if there are two, one for each direction."""
    if not isinstance(values, tuple):
        return values
    raise ValueError(f"{key}: got {shown(values)}; must be one number for a body of revolution")


def _from_apex(x: FloatArray, length: float, count: int) -> FloatArray:
    """Coordinate from the middle of the nearest of `count` copies in a period around the origin."""
    import numpy as np

    copies = np.floor((x / length + 0.5) * count)
    return np.asarray(x - ((copies + 0.5) / count - 0.5) * length)


def across(axes: Axes, along: str) -> FloatArray:
    """Return the coordinate across a punch that is long along an axis."""
    return axes[1] if along == "x" else axes[0]
