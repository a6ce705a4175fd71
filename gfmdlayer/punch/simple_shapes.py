"""Punches whose height is a function of the coordinates, and indenters of revolution with a rim."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, PrivateAttr

from gfmdlayer.punch.shape import Analytic, Axes, Cell, Extent, Shape, across, along_axis, distance, single
from gfmdlayer.validation.fields import Amplitudes, File, Lengths, MustBe, Positive, Word, given, strict
from gfmdlayer.validation.problems import Mistake
from gfmdlayer.validation.reading import Reading

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.grid.grid import Grid
    from gfmdlayer.punch.revolution import Revolution


Along = Annotated[str, Word("x", "y")]


class Parabola(Analytic):
    """Height x^2/(2 radius) above the apex, Eq. (30); with two radii x^2/(2 Rx) + y^2/(2 Ry).

    Examples
    --------
    >>> found = gfmdlayer.solve(gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=0.25), depth=0.01)
    >>> float(found.pressure.idxmax("x"))
    0.0
    """

    shape: Literal["parabola"] = "parabola"
    """height r^2/(2 radius)"""
    radius: Lengths = 0.25
    """radius of curvature, or one for each direction: length"""

    def height(self, axes: Axes) -> FloatArray:
        """r^2/(2 R), or the sum over the directions."""
        import numpy as np

        if isinstance(self.radius, tuple):
            return np.asarray(sum(x**2 / (2 * R) for x, R in zip(axes, self.radius, strict=True)))
        return distance(axes) ** 2 / (2 * self.radius)

    def mean_height(self, cell: Cell) -> float | None:
        """L^2/(24 R), summed over the directions."""
        if isinstance(self.radius, tuple):
            return None
        return sum(length**2 for length in cell.period) / (24 * self.radius)

    def revolution(self) -> Revolution:
        """The paraboloid; ValueError if it has two radii."""
        from gfmdlayer.punch.revolution import paraboloid

        return paraboloid(single("radius", self.radius))


class Sphere(Analytic):
    """Sphere; `radius` >= half the period.

    Examples
    --------
    >>> body = gfmdlayer.halfspace(1.0)
    >>> found = gfmdlayer.solve(body, gfmdlayer.Sphere(radius=1.0), force=0.01, points=(64, 64))
    >>> round(float(found.force), 4)
    0.01
    """

    shape: Literal["sphere"] = "sphere"
    """a sphere"""
    radius: Positive
    """radius, at least half the period: length"""

    def height(self, axes: Axes) -> FloatArray:
        """R - (R^2 - r^2)^(1/2), and R beyond the radius."""
        return _circle(distance(axes), self.radius)

    def misfit(self, extent: Extent) -> Mistake | None:
        """Refuse a circle that ends inside the cell."""
        return _short(self.radius, extent)

    def revolution(self) -> Revolution:
        """The sphere."""
        from gfmdlayer.punch.revolution import sphere

        return sphere(self.radius)


class Cylinder(Analytic):
    """Circular cylinder that lies along an axis; `radius` >= half the period.

    Examples
    --------
    >>> gfmdlayer.Config(name="a", punch=gfmdlayer.Cylinder(radius=1.0)).punch.along
    'y'
    """

    shape: Literal["cylinder"] = "cylinder"
    """a cylinder that lies along an axis"""
    radius: Positive
    """radius, at least half the period: length"""
    along: Along = "y"
    """direction along which it is constant: y or x"""

    def height(self, axes: Axes) -> FloatArray:
        """R - (R^2 - x^2)^(1/2), and R beyond the radius, constant along one axis."""
        return _circle(abs(across(axes, self.along)), self.radius)

    def misfit(self, extent: Extent) -> Mistake | None:
        """Refuse a circle that ends inside the cell."""
        return None if "xy"[extent.axis] == self.along else _short(self.radius, extent)


class Flat(Analytic):
    """Flat over `width`, outside it a parabola of `edge_radius` that begins with zero slope.

    One width belongs to a line or a disc, two belong to a rectangle.

    Examples
    --------
    >>> punch = gfmdlayer.Flat(width=0.25, edge_radius=0.1)
    >>> found = gfmdlayer.solve(gfmdlayer.halfspace(1.0), punch, depth=0.01)
    >>> bool(found.contact_area > 0.25)
    True
    """

    shape: Literal["flat"] = "flat"
    """flat in the middle, a parabola outside"""
    width: Lengths
    """width of the flat part, or one for each direction: length"""
    edge_radius: Positive
    """radius of curvature outside: length"""

    def height(self, axes: Axes) -> FloatArray:
        """s^2/(2 R_edge) at a distance s outside the flat part."""
        import numpy as np

        if isinstance(self.width, tuple):
            widths = zip(axes, self.width, strict=True)
            outside = distance([np.maximum(np.abs(x) - width / 2, 0.0) for x, width in widths])
        else:
            outside = np.maximum(distance(axes) - self.width / 2, 0.0)
        return outside**2 / (2 * self.edge_radius)

    def misfit(self, extent: Extent) -> Mistake | None:
        """Refuse a flat part that fills the cell with its edges."""
        width = along_axis(self.width, extent.axis)
        if not math.isfinite(width) or width + 2 * self.edge_radius < extent.length:
            return None
        allowed = f"width + 2 edge_radius must be below {extent.words}"
        message = f"got {width!r} with edge_radius {self.edge_radius!r}; {allowed}"
        return Mistake(("width",), message, ("edge_radius",))

    def revolution(self) -> Revolution:
        """The flat disc and the parabola outside; ValueError for a rectangle."""
        from gfmdlayer.punch.revolution import of_pieces

        face, slope = single("width", self.width) / 2, 1 / self.edge_radius
        return of_pieces([0.0, face], [0.0, -slope * face], [0.0, slope])


class Sinusoid(Analytic):
    """Height amplitude (1 - cos(2 pi x/wavelength)), summed over the directions.

    A whole number of waves fills the period.

    Examples
    --------
    >>> punch = gfmdlayer.Sinusoid(amplitude=0.01, wavelength=0.5)
    >>> gfmdlayer.run({"time": {"end": 1.0, "step": 0.5}, "grid": {"points": 64}}, punch=punch).sizes["time"]
    3
    """

    shape: Literal["sinusoid"] = "sinusoid"
    """height amplitude (1 - cos(2 pi x/wavelength))"""
    amplitude: Amplitudes
    """amplitude, or one for each direction: length"""
    wavelength: Lengths
    """wavelength, or [x, y]; whole numbers fill the period: length"""

    def height(self, axes: Axes) -> FloatArray:
        """Amplitude times (1 - cos(2 pi x/wavelength)), summed over the axes."""
        import numpy as np

        waves = (
            (x, along_axis(self.amplitude, i), along_axis(self.wavelength, i)) for i, x in enumerate(axes)
        )
        return np.asarray(sum(a * (1 - np.cos(2 * np.pi * x / length)) for x, a, length in waves))

    def misfit(self, extent: Extent) -> Mistake | None:
        """Refuse waves that do not join up with themselves."""
        wavelength = along_axis(self.wavelength, extent.axis)
        waves = extent.length / wavelength
        fits = waves >= 1 - 1e-9 and abs(waves - round(waves)) <= 1e-9 * waves
        if fits or math.isinf(wavelength) or along_axis(self.amplitude, extent.axis) == 0:
            return None
        allowed = "must be the period divided by a whole number"
        message = f"got {wavelength!r}, which does not divide {extent.words}; {allowed}"
        return Mistake(("wavelength",), message, ("amplitude",))


def _circle(r: FloatArray, radius: float) -> FloatArray:
    import numpy as np

    r = np.minimum(r, radius)
    return np.asarray(r * r / (radius + np.sqrt(radius * radius - r * r)))


def _short(radius: float, extent: Extent) -> Mistake | None:
    if radius >= extent.length / 2:
        return None
    found = f"got {radius!r}: the circle ends inside the cell and has no height beyond"
    allowed = f"must be a number >= half {extent.words} (a parabola takes any radius)"
    return Mistake(("radius",), f"{found}; {allowed}")


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

    def misfits(self, cell: Cell, counts: tuple[int, ...] = (1, 1)) -> Iterator[Mistake]:
        """Refuse a pyramid on a line."""
        if len(cell.points) == 1:
            message = "got the text 'pyramid'; must be another shape, or grid.points two numbers"
            yield Mistake(("shape",), message, chooses=True)
        else:
            yield from super().misfits(cell, counts)


class BluntedCone(Analytic):
    """A cone with a paraboloid as its tip; the slope is continuous.

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


class _Rimmed(Shape):
    """An indenter that ends at a rim, beyond which it has no height."""

    def heights(self, grid: Grid) -> FloatArray:
        """Heights on a periodic grid: refused by `misfits`, and here."""
        raise ValueError(f"{self.shape}: has no height beyond its rim, as a periodic surface of {grid} needs")

    def misfits(self, cell: Cell) -> Iterator[Mistake]:  # noqa: ARG002
        """Refuse every periodic cell."""
        message = f"got {self.shape!r}, which has a rim; must be another shape, or grid.geometry axisymmetric"
        yield Mistake(("shape",), message, ("grid.geometry",), chooses=True)


class FlatPunch(_Rimmed):
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


class RadialProfile(_Rimmed):
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
    reading: Annotated[Reading | None, given] = None
    """how the file is read, where it does not say so"""

    _length: str | None = PrivateAttr(default=None)  # unit of length of the configuration

    def with_length(self, length: str | None) -> RadialProfile:
        """Return the shape that converts lengths of its file into a unit."""
        shape = self.model_copy()
        shape._length = length
        return shape

    def revolution(self) -> Revolution:
        """The profile, which ends at the last radius; TableError if the file has no convex one."""
        from gfmdlayer.punch.revolution import read_profile

        return read_profile(self.file, self._length, self.reading)[0]

    def account(self, cell: Cell) -> str:  # noqa: ARG002
        """Say how the file was read; TableError if it cannot be used."""
        from gfmdlayer.punch.revolution import read_profile

        return read_profile(self.file, self._length, self.reading)[1]
