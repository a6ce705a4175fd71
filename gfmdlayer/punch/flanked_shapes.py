"""Punches with straight flanks: cone, wedge and pyramid."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from gfmdlayer.punch.shape import Analytic, Axes, Cell, across, distance
from gfmdlayer.validation.fields import MustBe, Positive, Word, strict
from gfmdlayer.validation.problems import Problem

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.punch.revolution import Revolution

Along = Annotated[str, Word("x", "y")]
Angle = Annotated[float, strict, Field(gt=0, lt=90), MustBe("a number > 0 and < 90, in degrees")]
Faces = Annotated[int, Field(strict=True, ge=3), MustBe("a whole number >= 3")]


class Cone(Analytic):
    """Height slope r.

    Examples
    --------
    >>> found = gfmdlayer.solve(gfmdlayer.halfspace(1.0), gfmdlayer.Cone(slope=0.1), depth=0.01)
    >>> bool(found.pressure[512] > found.pressure[515] > 0)  # a peak at the tip
    True
    """

    shape: Literal["cone"] = "cone"
    """height slope r"""
    slope: Positive
    """slope of its side"""

    def height(self, axes: Axes) -> FloatArray:
        """Slope times r."""
        return self.slope * distance(axes)

    def revolution(self) -> Revolution:
        """The cone."""
        from gfmdlayer.punch.revolution import cone

        return cone(self.slope)


class Wedge(Analytic):
    """Height slope |x|; its edge lies along an axis.

    Examples
    --------
    >>> gfmdlayer.Wedge(slope=-1)
    Traceback (most recent call last):
    gfmdlayer.validation.problems.ConfigError: slope: got -1; must be a number > 0, finite
    """

    shape: Literal["wedge"] = "wedge"
    """height slope |x|"""
    slope: Positive
    """slope of its sides"""
    along: Along = "y"
    """direction along which it is constant: y or x"""

    def height(self, axes: Axes) -> FloatArray:
        """Slope times |x|, constant along one axis."""
        return self.slope * abs(across(axes, self.along))


class Pyramid(Analytic):
    """Pyramid; `angle` between its axis and its faces, in degrees. The defaults are Berkovich's.

    Three faces at 65.27 degrees are Berkovich's, as modified to have the area of Vickers's, which has four at
    68 (ISO 14577-2). The first face is towards +x.

    Examples
    --------
    >>> gfmdlayer.Pyramid().angle  # Berkovich's, in degrees
    65.27
    """

    shape: Literal["pyramid"] = "pyramid"
    """equal faces; a Berkovich indenter by default"""
    angle: Angle = 65.27
    """angle of the faces to the axis: degrees"""
    faces: Faces = 3
    """number of faces"""

    def height(self, axes: Axes) -> FloatArray:
        """Height of the plane of the highest face."""
        import numpy as np

        x, y = axes
        turns = 2 * np.pi * np.arange(self.faces) / self.faces
        slope = 1 / np.tan(np.radians(self.angle))
        return np.asarray(slope * np.max([np.cos(t) * x + np.sin(t) * y for t in turns], axis=0))

    def misfits(self, cell: Cell, counts: tuple[int, ...] = (1, 1)) -> Iterator[Problem]:
        """Refuse a pyramid on a line."""
        if len(cell.points) == 1:
            message = "got the text 'pyramid'; must be another shape, or grid.points two numbers"
            yield Problem(("shape",), message, chooses=True)
        else:
            yield from super().misfits(cell, counts)
