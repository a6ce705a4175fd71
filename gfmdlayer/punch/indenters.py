"""Indenters of revolution for isolated contacts: a flat cylinder, a blunted cone, a profile from a table."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from gfmdlayer.punch.shape import Analytic, Axes, Cell, Shape, distance
from gfmdlayer.validation.fields import File, Positive
from gfmdlayer.validation.problems import Problem

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.grid.grid import Grid
    from gfmdlayer.punch.revolution import Revolution


class BluntedCone(Analytic):
    """A cone whose tip is a paraboloid that goes over into it without a kink.

    Examples
    --------
    >>> tip = gfmdlayer.BluntedCone(slope=1.0, tip_radius=0.1)
    >>> found = gfmdlayer.indent(gfmdlayer.halfspace(1.0), tip, [0, 1], depth=[0, 0.2])
    >>> float(found.contact_radius[-1]) > 0.1
    True
    """

    shape: Literal["blunted_cone"] = "blunted_cone"
    """a cone with a rounded tip"""
    slope: Positive
    """slope of its side"""
    tip_radius: Positive
    """radius of curvature of the tip: length"""

    def height(self, axes: Axes) -> FloatArray:
        """r^2/(2 R) up to r = slope R, from there on the tangent."""
        import numpy as np

        r, R = distance(axes), self.tip_radius
        tip = np.minimum(r, self.slope * R)
        return np.asarray(tip**2 / (2 * R) + self.slope * (r - tip))

    def revolution(self) -> Revolution:
        """The tip and the cone."""
        from gfmdlayer.punch.revolution import of_pieces

        R = self.tip_radius
        return of_pieces([0.0, self.slope * R], [0.0, self.slope], [1 / R, 0.0])


class _Isolated(Shape):
    """An indenter that ends at a rim, beyond which it has no height."""

    def heights(self, grid: Grid) -> FloatArray:
        """Heights on a periodic grid: refused by `misfits`, and here."""
        raise ValueError(f"{self.shape}: has no height beyond its rim, as a periodic surface of {grid} needs")

    def misfits(self, cell: Cell) -> Iterator[Problem]:  # noqa: ARG002
        """Refuse every periodic cell."""
        message = f"got {self.shape!r}, which has a rim; must be another shape, or grid.geometry axisymmetric"
        yield Problem(("shape",), message, ("grid.geometry",), chooses=True)


class FlatPunch(_Isolated):
    """The flat end of a cylinder; for grid.geometry: axisymmetric.

    Examples
    --------
    >>> body, punch = gfmdlayer.halfspace(1.0), gfmdlayer.FlatPunch(radius=0.5)
    >>> found = gfmdlayer.indent(body, punch, [0, 1], depth=[0, 0.1])  # F = 8 G a depth, nu = 1/2
    >>> round(float(found.force[-1]), 9)
    0.4
    """

    shape: Literal["flat_punch"] = "flat_punch"
    """the flat end of a cylinder; for grid.geometry: axisymmetric"""
    radius: Positive
    """radius of the cylinder: length"""

    def revolution(self) -> Revolution:
        """The flat end."""
        from gfmdlayer.punch.revolution import flat

        return flat(self.radius)


class RadialProfile(_Isolated):
    """A convex profile of revolution from a table; for grid.geometry: axisymmetric.

    Examples
    --------
    >>> r = np.linspace(0.0, 1.0, 101)
    >>> np.savetxt("tip.txt", np.column_stack((r, r**2)))
    >>> tip = gfmdlayer.RadialProfile(file="tip.txt")
    >>> found = gfmdlayer.indent(gfmdlayer.halfspace(1.0), tip, [0, 1], depth=[0, 0.1])
    >>> round(float(found.contact_radius[-1]) ** 2, 9)  # a^2 = R depth, R = 1/2
    0.05
    """

    shape: Literal["radial_profile"] = "radial_profile"
    """a convex profile from a table; for grid.geometry: axisymmetric"""
    file: File
    """two columns, radius from 0 and height"""

    def revolution(self) -> Revolution:
        """The profile, which ends at the last radius; TableError if the file has no convex one."""
        from gfmdlayer.punch.revolution import read_table

        return read_table(self.file)
