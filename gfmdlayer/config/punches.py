"""The shapes of the punch: their keys. Where a value is given for each direction, .inf is a flat one."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, Tag

from gfmdlayer.config.problems import MustBe, one_of
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


def _two(values: tuple[float, ...]) -> tuple[float, ...]:
    if len(values) != 2:
        raise ValueError(f"got {len(values)} values; must be one number, or two, one for each direction")
    return values


_length = MustBe("a number > 0, or two of them, one for each direction")
_extent = MustBe("a number > 0 or .inf")
Lengths = Annotated[
    Annotated[float, strict, Field(gt=0), _length, Tag("number")]
    | Annotated[
        tuple[Annotated[float, Field(strict=True, gt=0), _extent], ...], AfterValidator(_two), Tag("list")
    ],
    number_or_list,
]
Amplitudes = Annotated[
    Annotated[float, strict, Field(gt=0), _length, Tag("number")]
    | Annotated[tuple[NotNegative, ...], AfterValidator(_two), Tag("list")],
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
    radius: Lengths = 0.25


class Sphere(Section):
    """Sphere; `radius` >= half the period."""

    shape: Literal["sphere"] = "sphere"
    radius: Positive


class Cylinder(Section):
    """Circular cylinder that lies along an axis; `radius` >= half the period."""

    shape: Literal["cylinder"] = "cylinder"
    radius: Positive
    along: Along = "y"


class Cone(Section):
    """Height slope r."""

    shape: Literal["cone"] = "cone"
    slope: Positive


class Wedge(Section):
    """Height slope |x|; its edge lies along an axis."""

    shape: Literal["wedge"] = "wedge"
    slope: Positive
    along: Along = "y"


class Pyramid(Section):
    """Pyramid; `angle` between its axis and its faces, in degrees. The defaults are Berkovich's."""

    shape: Literal["pyramid"] = "pyramid"
    angle: Angle = 65.27
    faces: Faces = 3


class Flat(Section):
    """Flat over `width`, outside it a parabola of `edge_radius` that begins with zero slope.

    One width is that of a line or a disc, two are those of a rectangle.
    """

    shape: Literal["flat"] = "flat"
    width: Lengths
    edge_radius: Positive


class Sinusoid(Section):
    """Height amplitude (1 - cos(2 pi x/wavelength)), summed over the directions.

    A whole number of waves fills the period.
    """

    shape: Literal["sinusoid"] = "sinusoid"
    amplitude: Amplitudes
    wavelength: Lengths


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
    element: Element = Field(description="a mapping with the keys of a shape")
    counts: Annotated[tuple[Count, ...], BeforeValidator(sequence)]


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
    hurst: Hurst
    short_cutoff: Positive
    seed: Seed
    roll_off: Optional = None
    long_cutoff: Optional = None
    rms_slope: Optional = None
    rms_height: Optional = None


class Profile(Section):
    """Heights read from a file, one for each grid point."""

    shape: Literal["profile"] = "profile"
    file: File


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
    file: File
    dataset: Annotated[
        Annotated[str, Field(strict=True, min_length=1), MustBe("the name of a dataset")] | None, given
    ] = None
    unit: Positive = 1.0
    fill: Annotated[Literal["none", "membrane"], one_of("none", "membrane")] = "none"
    detrend: Annotated[Literal["none", "plane", "paraboloid"], one_of("none", "plane", "paraboloid")] = "none"
    taper: Part = 0.0
    resample: Annotated[Literal["none", "fourier"], one_of("none", "fourier")] = "none"


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
