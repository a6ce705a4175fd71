"""The sections of a configuration: plain validated data, with the paper's case as defaults.

Lengths are in units of the period, moduli in units of G0 and times in units of tau, unless a configuration
gives all three in other units consistently. Symbols and defaults follow Petrenko et al., Mater. Phys. Mech.
52 (2024), Eq. (5) for the Zener material and Eq. (30) for the punch and its trajectory.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    FieldSerializationInfo,
    Tag,
    ValidationInfo,
    field_serializer,
    field_validator,
)

from gfmdlayer.config.input_errors import MustBe, one_of


def sequence(value: object) -> object:
    """Take a single value for a list of one."""
    return tuple(value) if isinstance(value, (list, tuple)) else (value,)


def _readable(path: Path) -> Path:
    """Refuse early what a run could only refuse late; what the file holds is looked at by its reader."""
    path = path.absolute()
    try:
        if not path.exists():
            wrong = "does not exist"
        elif not path.is_file():
            wrong = "is not a regular file"
        else:
            path.open("rb").close()
            return path
    except OSError as error:
        wrong = f"cannot be read ({error.strerror})"
    raise ValueError(
        f"{path} {wrong}; must be the name of a readable file, relative to the configuration's folder"
    )


def _not_null(value: object) -> object:
    # None says in the model that a key has no meaning here; a user says so by leaving the key out.
    if value is None:
        raise ValueError("got nothing (null); must have a value, or be left out")
    return value


MANY = 2**31  # points that FFTW, which counts in 32 bits, cannot transform any more

given = AfterValidator(_not_null)
strict = Field(strict=True, allow_inf_nan=False)
Finite = Annotated[float, strict, MustBe("a number, finite")]
Positive = Annotated[float, strict, Field(gt=0), MustBe("a number > 0, finite")]
NotNegative = Annotated[float, strict, Field(ge=0), MustBe("a number >= 0, finite")]
Extended = Annotated[float, Field(strict=True, ge=0), MustBe("a number >= 0 or .inf")]
Poisson = Annotated[float, strict, Field(gt=-1, le=0.5), MustBe("a number > -1 and <= 0.5")]
Count = Annotated[int, Field(strict=True, ge=1, lt=MANY), MustBe("a whole number >= 1 and < 2^31")]
Points = Annotated[
    int,
    Field(strict=True, ge=8, lt=MANY),
    MustBe("a whole number >= 8 and < 2^31, or two of them, [nx, ny]"),
]
Length = Annotated[float, strict, Field(gt=0), MustBe("a number > 0, finite, or two of them, [Lx, Ly]")]
Spacing = Annotated[float, strict, Field(gt=0), MustBe("a number > 0, finite, or a list of times")]
File = Annotated[Path, MustBe("the name of a file"), AfterValidator(_readable)]
Name = Annotated[
    str,
    Field(strict=True, pattern=r"^[A-Za-z0-9_][A-Za-z0-9._-]{0,127}$"),
    MustBe("text of at most 128 letters, digits and . _ -, not beginning with . or - (it names a folder)"),
]


class Section(BaseModel):
    """A part of the configuration: immutable, and without any key that is not listed."""

    # Built when first used: the whole configuration holds a copy of most of them.
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True, use_attribute_docstrings=True)


class Grid(Section):
    """The periodic cell: `points` n or (nx, ny), `period` L or (Lx, Ly)."""

    points: Annotated[tuple[Points, ...], BeforeValidator(sequence)] = (16384,)
    """grid points n, or [nx, ny]: a surface in two directions"""
    period: Annotated[tuple[Length, ...], BeforeValidator(sequence), Field(validate_default=True)] = (1.0,)
    """length L of the periodic cell, or [Lx, Ly]"""

    @field_validator("points", "period")
    @classmethod
    def _one_or_two(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        if len(values) not in {1, 2}:
            raise ValueError(f"got {len(values)} values; must be one, or two for a surface in two directions")
        return values

    @field_validator("period")
    @classmethod
    def _for_each_direction(cls, period: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        return period * len(info.data.get("points", period)) if len(period) == 1 else period

    @field_serializer("points", "period")
    def _number_where_one_will_do(self, values: tuple[float, ...], info: FieldSerializationInfo) -> object:
        return (
            values[0]
            if len(values) == 1 or (info.field_name == "period" and len(set(values)) == 1)
            else values
        )


class Zener(Section):
    """Standard linear solid, Eq. (5): G(t) = G0 + (Ginf - G0) exp(-t/tau)."""

    model: Literal["zener"] = "zener"
    """G(t) = G0 + (Ginf - G0) exp(-t/tau)"""
    G0: Positive = 1.0
    """relaxed shear modulus: for slow loads"""
    Ginf: Positive = 10.0
    """instantaneous shear modulus: for fast loads"""
    tau: Positive = 1.0
    """relaxation time at constant strain"""


class Branch(Section):
    """One term G exp(-t/tau) of a Prony series."""

    G: Positive
    """shear modulus of the branch"""
    tau: Positive
    """relaxation time of the branch"""


class Prony(Section):
    """Prony series G(t) = G0 + sum of G exp(-t/tau) over the branches; G0 is the relaxed modulus."""

    model: Literal["prony"] = "prony"
    """G(t) = G0 + sum of G exp(-t/tau) over the branches"""
    G0: Positive = 1.0
    """relaxed shear modulus"""
    branches: tuple[Branch, ...] = Field(
        description="a list of {G: ..., tau: ...}, each a number > 0", json_schema_extra={"minItems": 1}
    )

    @field_validator("branches")
    @classmethod
    def _at_least_one(cls, branches: tuple[Branch, ...]) -> tuple[Branch, ...]:
        if not branches:
            raise ValueError("got an empty list; must be at least one {G: ..., tau: ...}")
        return branches


def tagged(key: str, default: str) -> Discriminator:
    """Return the rule that picks a member of a union by its `key`, which may be left out for the default."""

    def tag(value: object) -> str:
        if isinstance(value, Section):
            return str(getattr(value, key))
        return str(value.get(key, default)) if isinstance(value, Mapping) else default

    return Discriminator(tag)


def _form(value: object) -> str:
    return "list" if isinstance(value, (list, tuple)) else "number"


number_or_list = Discriminator(_form)
Material = Annotated[
    Annotated[Zener, Tag("zener")] | Annotated[Prony, Tag("prony")],
    tagged("model", "zener"),
]


class Layer(Section):
    """The viscoelastic layer; thickness 0 leaves the halfspace alone, .inf the material alone."""

    thickness: Extended = 0.05
    """thickness d: length; 0: the halfspace alone, .inf: the layer alone"""
    poisson: Poisson = 0.5
    """Poisson's ratio of the layer; 0.5 is incompressible"""
    material: Material = Field(default_factory=Zener)
    """viscoelastic law of the layer: model zener or prony"""


class Halfspace(Section):
    """The elastic halfspace below; shear modulus .inf is rigid, 0 is a free layer."""

    shear_modulus: Extended = 1.0
    """shear modulus of the base; 0: a free layer, .inf: a rigid base"""
    poisson: Poisson = 0.5
    """Poisson's ratio of the base"""


class Trajectory(Section):
    """What is prescribed over time: the depth of Eq. (30), a mean pressure likewise, or either by a table.

    Attributes
    ----------
    depth, load, ramp_time, file
        None where `control` and `kind` give them no meaning.
    velocity, velocity_file
        Of the punch along x, constant or from a table; None where it stays.
    """

    control: Annotated[Literal["depth", "load"], one_of("depth", "load")] = "depth"
    """what is prescribed: depth or load"""
    kind: Annotated[Literal["ramp_hold", "table"], one_of("ramp_hold", "table")] = "ramp_hold"
    """ramp_hold, or table: from a file"""
    depth: Annotated[NotNegative | None, given] = Field(
        default_factory=lambda data: (
            0.01 if (data.get("control"), data.get("kind")) == ("depth", "ramp_hold") else None
        )
    )
    """depth that is reached and held: length; for control: depth"""
    load: Annotated[NotNegative | None, given] = None
    """mean pressure that is reached and held; for control: load"""
    ramp_time: Annotated[Positive | None, given] = Field(
        default_factory=lambda data: 1.0 if data.get("kind") == "ramp_hold" else None
    )
    """duration of the ramp: time"""
    file: Annotated[File | None, given] = None
    """two columns, time and depth or mean pressure; for kind: table"""
    velocity: Annotated[Finite | None, given] = None
    """velocity of the punch along x: length/time"""
    velocity_file: Annotated[File | None, given] = None
    """two columns, time and velocity; in place of velocity"""

    @property
    def moves(self) -> bool:
        """Whether the punch moves along the surface."""
        return self.velocity is not None or self.velocity_file is not None


class Time(Section):
    """The time axis from 0 to `end`; `tolerance` is the relative error allowed to adaptive steps.

    With `steady` the run of a moving punch ends when it changes by less than this, relative to itself.
    """

    end: Positive = 8.0
    """end of the simulation: time"""
    step: Annotated[
        Annotated[float, strict, Field(gt=0)] | Literal["adaptive"],
        MustBe("a number > 0, finite, or the word adaptive", ("adaptive",)),
    ] = 0.005
    """time step, or adaptive: steps to the tolerance below"""
    integrator: Annotated[
        Literal["backward_euler", "exponential"], one_of("backward_euler", "exponential")
    ] = "exponential"
    """exponential, of second order, or backward_euler, the paper's"""
    tolerance: Annotated[Positive | None, given] = Field(
        default_factory=lambda data: 1e-4 if data.get("step") == "adaptive" else None
    )
    """relative error of pressure and displacement; for step: adaptive"""
    steady: Annotated[Positive | None, given] = None
    """relative change below which the run of a moving punch ends"""


class Solver(Section):
    """How one step's contact problem is solved; `inertia` is None for every method but fire."""

    method: Annotated[
        Literal["fire", "active_set", "conjugate_gradient"],
        one_of("fire", "active_set", "conjugate_gradient"),
    ] = "active_set"
    """active_set, conjugate_gradient, or fire, the paper's"""
    tolerance: Annotated[float, strict, Field(ge=1e-13, lt=1), MustBe("a number >= 1e-13 and < 1")] = 1e-6
    """residual at which a step is accepted, relative to pressure and depth"""
    inertia: Annotated[
        Annotated[Literal["mass_weighted", "uniform"], one_of("mass_weighted", "uniform")] | None, given
    ] = Field(default_factory=lambda data: "mass_weighted" if data.get("method") == "fire" else None)
    """of the modes: mass_weighted or uniform; for method: fire"""
    max_iterations: Count = 20000
    """iterations of a step after which its case fails"""
