"""The shapes of the punch: their keys. Where a value is given for each direction, .inf is a flat one."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, Tag

from gfmdlayer.config.input_errors import MustBe, one_of
from gfmdlayer.config.sections import (
    Count,
    File,
    NotNegative,
    Positive,
    Section,
    given,
    number_or_list,
    sequence,
    strict,
    tagged,
)


def two(values: tuple[float, ...]) -> tuple[float, ...]:
    """Take one value for each of two directions."""
    if len(values) != 2:
        raise ValueError(f"got {len(values)} values; must be one number, or two, one for each direction")
    return values


_length = MustBe("a number > 0, or two of them, one for each direction")
_extent = MustBe("a number > 0 or .inf")
Lengths = Annotated[
    Annotated[float, strict, Field(gt=0), _length, Tag("number")]
    | Annotated[
        tuple[Annotated[float, Field(strict=True, gt=0), _extent], ...], AfterValidator(two), Tag("list")
    ],
    number_or_list,
]
Amplitudes = Annotated[
    Annotated[float, strict, Field(gt=0), _length, Tag("number")]
    | Annotated[tuple[NotNegative, ...], AfterValidator(two), Tag("list")],
    number_or_list,
]
Along = Annotated[Literal["x", "y"], one_of("x", "y")]
Seed = Annotated[int, Field(strict=True, ge=0), MustBe("a whole number >= 0")]
Part = Annotated[float, strict, Field(ge=0, le=1), MustBe("a number from 0 to 1")]
Hurst = Annotated[float, strict, Field(gt=0, le=1), MustBe("a number > 0 and <= 1")]
Angle = Annotated[float, strict, Field(gt=0, lt=90), MustBe("a number > 0 and < 90, in degrees")]
Faces = Annotated[int, Field(strict=True, ge=3), MustBe("a whole number >= 3")]
Optional = Annotated[Positive | None, given]


class Parabola(Section):
    """Height x^2/(2 radius) above the apex, Eq. (30); with two radii x^2/(2 Rx) + y^2/(2 Ry)."""

    shape: Literal["parabola"] = "parabola"
    """height r^2/(2 radius)"""
    radius: Lengths = 0.25
    """radius of curvature: length, or one for each direction"""


class Sphere(Section):
    """Sphere; `radius` >= half the period."""

    shape: Literal["sphere"] = "sphere"
    """a sphere"""
    radius: Positive
    """radius: length; at least half the period"""


class Cylinder(Section):
    """Circular cylinder that lies along an axis; `radius` >= half the period."""

    shape: Literal["cylinder"] = "cylinder"
    """a cylinder that lies along an axis"""
    radius: Positive
    """radius: length; at least half the period"""
    along: Along = "y"
    """direction along which it is constant: y or x"""


class Cone(Section):
    """Height slope r."""

    shape: Literal["cone"] = "cone"
    """height slope r"""
    slope: Positive
    """slope of its side"""


class Wedge(Section):
    """Height slope |x|; its edge lies along an axis."""

    shape: Literal["wedge"] = "wedge"
    """height slope |x|"""
    slope: Positive
    """slope of its sides"""
    along: Along = "y"
    """direction along which it is constant: y or x"""


class Pyramid(Section):
    """Pyramid; `angle` between its axis and its faces, in degrees. The defaults are Berkovich's."""

    shape: Literal["pyramid"] = "pyramid"
    """equal faces; a Berkovich indenter by default"""
    angle: Angle = 65.27
    """angle of the faces to the axis, in degrees"""
    faces: Faces = 3
    """number of faces"""


class Flat(Section):
    """Flat over `width`, outside it a parabola of `edge_radius` that begins with zero slope.

    One width is that of a line or a disc, two are those of a rectangle.
    """

    shape: Literal["flat"] = "flat"
    """flat in the middle, a parabola outside"""
    width: Lengths
    """width of the flat part: length, or one for each direction"""
    edge_radius: Positive
    """radius of curvature outside: length"""


class Sinusoid(Section):
    """Height amplitude (1 - cos(2 pi x/wavelength)), summed over the directions.

    A whole number of waves fills the period.
    """

    shape: Literal["sinusoid"] = "sinusoid"
    """height amplitude (1 - cos(2 pi x/wavelength))"""
    amplitude: Amplitudes
    """amplitude: length, or one for each direction"""
    wavelength: Lengths
    """wavelength: length, or one for each direction; a whole number fill the period"""


Element = Annotated[
    Annotated[Parabola, Tag("parabola")]
    | Annotated[Sphere, Tag("sphere")]
    | Annotated[Cylinder, Tag("cylinder")]
    | Annotated[Cone, Tag("cone")]
    | Annotated[Wedge, Tag("wedge")]
    | Annotated[Pyramid, Tag("pyramid")]
    | Annotated[Flat, Tag("flat")],
    tagged("shape", "parabola"),
]


class Array(Section):
    """`counts` copies of a shape along each direction, as many as fill the period."""

    shape: Literal["array"] = "array"
    """copies of another shape side by side"""
    element: Element = Field(description="a mapping with the keys of a shape")
    counts: Annotated[tuple[Count, ...], BeforeValidator(sequence)]
    """number of copies, or [nx, ny]"""


class SelfAffine(Section):
    """Rough surface by random phases; cut-offs and roll-off are wavelengths.

    Attributes
    ----------
    roll_off, long_cutoff
        None where there is no plateau in the spectrum, or none but that of the period.
    rms_slope, rms_height
        One of them is given.
    """

    shape: Literal["self_affine"] = "self_affine"
    """a rough surface of random phases"""
    hurst: Hurst
    """Hurst exponent H: the power falls as q^(-2 (H + 1))"""
    short_cutoff: Positive
    """shortest wavelength: length; longer than two grid spacings"""
    seed: Seed
    """of the phases: the same surface on any grid"""
    roll_off: Optional = None
    """wavelength above which the spectrum is flat: length; none without it"""
    long_cutoff: Optional = None
    """longest wavelength: length; the longest that fits without it"""
    rms_slope: Optional = None
    """root-mean-square slope; this or rms_height"""
    rms_height: Optional = None
    """root-mean-square height: length; this or rms_slope"""


class Profile(Section):
    """Heights read from a file, one for each grid point."""

    shape: Literal["profile"] = "profile"
    """heights from a file, one for each grid point"""
    file: File
    """.npy, or text with columns x and height"""


class Topography(Section):
    """A measured surface, whose summits touch first; what is done to make it periodic.

    Attributes
    ----------
    unit
        Length of the file's unit.
    taper
        Part of the period over which the heights fade out.
    """

    shape: Literal["topography"] = "topography"
    """a measured surface; its summits touch first"""
    file: File
    """.npy; .txt, .dat, .csv; .h5, .hdf5, .nc; or an instrument's format"""
    dataset: Annotated[
        Annotated[str, Field(strict=True, min_length=1), MustBe("the name of a dataset")] | None, given
    ] = None
    """where the file holds several"""
    unit: Positive = 1.0
    """length of the file's unit"""
    fill: Annotated[Literal["none", "membrane"], one_of("none", "membrane")] = "none"
    """membrane: points without a height are filled in from around them"""
    detrend: Annotated[Literal["none", "plane", "paraboloid"], one_of("none", "plane", "paraboloid")] = "none"
    """plane or paraboloid: of least squares, subtracted"""
    taper: Part = 0.0
    """part of the period over which heights fade out to their mean"""
    resample: Annotated[Literal["none", "fourier"], one_of("none", "fourier")] = "none"
    """fourier: to the points of the grid"""


Punch = Annotated[
    Annotated[Parabola, Tag("parabola")]
    | Annotated[Sphere, Tag("sphere")]
    | Annotated[Cylinder, Tag("cylinder")]
    | Annotated[Cone, Tag("cone")]
    | Annotated[Wedge, Tag("wedge")]
    | Annotated[Pyramid, Tag("pyramid")]
    | Annotated[Flat, Tag("flat")]
    | Annotated[Sinusoid, Tag("sinusoid")]
    | Annotated[Array, Tag("array")]
    | Annotated[SelfAffine, Tag("self_affine")]
    | Annotated[Profile, Tag("profile")]
    | Annotated[Topography, Tag("topography")],
    tagged("shape", "parabola"),
]
PUNCHES: tuple[type[Section], ...] = (
    Parabola, Sphere, Cylinder, Cone, Wedge, Pyramid, Flat, Sinusoid, Array, SelfAffine, Profile, Topography,
)  # fmt: skip
ELEMENTS = (Parabola, Sphere, Cylinder, Cone, Wedge, Pyramid, Flat)
EITHER_WAY = ("radius", "width", "amplitude", "wavelength")  # keys that take one number or one a direction
