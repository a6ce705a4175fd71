"""The sections of a configuration besides punch, trajectory and material, the paper's case as defaults.

Lengths are in units of the period, moduli in units of G0 and times in units of tau, unless a configuration
gives all three in other units consistently. Symbols and defaults follow Petrenko et al., Mater. Phys. Mech.
52 (2024), Eq. (5) for the Zener material and Eq. (30) for the time axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import (
    BeforeValidator,
    Field,
    FieldSerializationInfo,
    ValidationInfo,
    field_serializer,
    field_validator,
)

from gfmdlayer.config.geometries import GEOMETRIES
from gfmdlayer.contact.solvers import AUTO, SOLVERS
from gfmdlayer.punch.shape import Cell
from gfmdlayer.validation.fields import (
    MANY,
    Count,
    MustBe,
    Optional,
    Positive,
    Word,
    given,
    sequence,
    strict,
)
from gfmdlayer.validation.problems import Problem, shown
from gfmdlayer.validation.sections import Section

Points = Annotated[
    int,
    Field(strict=True, ge=8, lt=MANY),
    MustBe("a whole number >= 8 and < 2^31, or two of them, [nx, ny]"),
]
Length = Annotated[float, strict, Field(gt=0), MustBe("a number > 0, finite, or two of them, [Lx, Ly]")]
Tolerance = Annotated[float, strict, Field(ge=1e-13, lt=1), MustBe("a number >= 1e-13 and < 1")]
Step = Annotated[
    Annotated[float, strict, Field(gt=0)] | Literal["adaptive"],
    MustBe("a number > 0, finite, or the word adaptive", ("adaptive",)),
]


class Grid(Section):
    """The periodic cell: `points` n or (nx, ny), `period` L or (Lx, Ly); or an isolated contact.

    Attributes
    ----------
    geometry
        None for a periodic surface.
    extent
        Of an isolated contact: radius up to which profiles are kept.
    """

    geometry: Annotated[Annotated[str, Word(*GEOMETRIES)] | None, given] = None
    """periodic, unless axisymmetric: an isolated contact of revolution"""
    points: Annotated[tuple[Points, ...], BeforeValidator(sequence)] = Field(
        default_factory=lambda data: (GEOMETRIES[data.get("geometry") or "periodic"].points,)
    )
    """points n, or [nx, ny] of a surface; axisymmetric: of the profiles"""
    period: Annotated[tuple[Length, ...], BeforeValidator(sequence), Field(validate_default=True)] = (1.0,)
    """period L of the cell, or [Lx, Ly]: length"""
    extent: Optional = None
    """axisymmetric: radius up to which profiles are kept: length"""

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
        same = len(values) == 1 or (info.field_name == "period" and len(set(values)) == 1)
        return values[0] if same else values

    @property
    def cell(self) -> Cell:
        """The cell as shapes of the punch see it."""
        return Cell(self.points, self.period)

    def problems(self) -> Iterator[Problem]:
        """Refuse periods that do not match the directions, and more points than FFTW counts."""
        if len(self.period) != len(self.points):
            message = (
                f"got {len(self.period)} lengths for {len(self.points)} "
                f"direction{'s' * (len(self.points) > 1)} of points; must be one number, or one for each "
                "direction"
            )
            yield Problem(("period",), message, ("points",))
        if math.prod(self.points) >= MANY:
            total = f"{math.prod(self.points):.3g} points"
            yield Problem(("points",), f"got {shown(self.points)}, {total}; must be fewer than 2^31 in all")


class Time(Section):
    """The time axis from 0 to `end`; `tolerance` is the relative error allowed to adaptive steps.

    A trajectory with an end of its own (`kind: approach_retract`) sets the default of `end`. With `steady`
    the run of a moving punch ends when it changes by less than this, relative to itself.
    """

    end: Positive = 8.0
    """end of the simulation; by default that of an approach_retract: time"""
    step: Step = 0.005
    """time step, or adaptive, steps to the tolerance below: time"""
    integrator: Annotated[str, Word("backward_euler", "exponential")] = "exponential"
    """exponential, of second order, or backward_euler, the paper's"""
    tolerance: Optional = Field(default_factory=lambda data: 1e-4 if data.get("step") == "adaptive" else None)
    """relative error of adaptive steps, 1e-4 by default"""
    steady: Optional = None
    """relative change below which the run of a moving punch ends"""

    def problems(self) -> Iterator[Problem]:
        """Refuse an integrator that cannot adapt its steps, and steps that do not end at `end`."""
        if self.step == "adaptive":
            if self.integrator == "backward_euler":
                message = (
                    "got backward_euler with step: adaptive; must be exponential, which estimates its error"
                )
                yield Problem(("integrator",), message, ("step",))
            return
        if self.tolerance is not None:
            message = "given, but a fixed step has no use for it; must be left out, or time.step be adaptive"
            yield Problem(("tolerance",), message, ("step",))
        if self.step > self.end:
            message = f"got {self.step!r}, beyond time.end = {self.end!r}; must be a number <= time.end"
            yield Problem(("step",), message, ("end",))
        elif message := self.misses(self.end):
            yield Problem(("end",), message, ("step", "integrator"))

    def misses(self, time: float) -> str:
        """Return why no step ends at a time, if so: the steps of backward Euler are equal, as the paper's."""
        if self.integrator != "backward_euler" or self.step == "adaptive" or whole_steps(time, self.step):
            return ""
        allowed = f"must be a whole number of steps of {self.step!r}, or time.integrator be exponential"
        return f"got {time!r}; {allowed}"


class Solver(Section):
    """How one step's contact problem is solved; `inertia` is None for every method but fire."""

    method: Annotated[str, Word(AUTO, *SOLVERS)] = AUTO
    """auto, or a solver; with adhesion newton or fire, the paper's"""
    tolerance: Tolerance = 1e-6
    """residual at which a step is accepted, relative to pressure and depth"""
    inertia: Annotated[Annotated[str, Word("mass_weighted", "uniform")] | None, given] = Field(
        default_factory=lambda data: "mass_weighted" if data.get("method") == "fire" else None
    )
    """of the modes, mass_weighted by default, or uniform; for method: fire"""
    max_iterations: Count = 20000
    """iterations of a step after which its case fails"""

    def problems(self) -> Iterator[Problem]:
        """Refuse the inertia of modes where they have none."""
        if self.inertia is not None and self.method != "fire":
            message = f"given, but method is {self.method}; must be left out, or method be fire"
            yield Problem(("inertia",), message, ("method",))


def whole_steps(time: float, step: float) -> bool:
    """Whether a time is a whole number of steps, within a millionth of one."""
    return abs(time / step - round(time / step)) <= 1e-6
