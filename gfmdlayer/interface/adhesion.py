"""Attraction across the gap: adhesion by a work and a range or a stress, and by a voltage.

A law of adhesion is given by its work w: the energy is -w in contact and 0 far away; tau is the traction. See
`docs/theory/adhesion.md`.

A conducting punch and base attract each other electrostatically across an air gap and insulating layers. They
are locally parallel plates: with the relative permittivities eps_i and thicknesses t_i of the insulators, and
h0 = sum of t_i/eps_i, a voltage V stores the charge eps0 V/(g + h0) per area, and at a constant voltage the
energy of field and source together is

    w = -(eps0/2) V^2/(g + h0),        tau = dw/dg = (eps0/2) V^2/(g + h0)^2

which attracts for either sign of V.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Discriminator, Field, Tag

from gfmdlayer.interface.interface import Interface
from gfmdlayer.validation.fields import File, Finite, MustBe, NotNegative, Optional, Positive, given, strict
from gfmdlayer.validation.problems import ConfigError, Mistake
from gfmdlayer.validation.quantities import is_quantity
from gfmdlayer.validation.reading import Reading, unread
from gfmdlayer.validation.sections import Section
from gfmdlayer.validation.units import Units, label_of

if TYPE_CHECKING:
    from gfmdlayer.interface.law import Interaction

Smoothing = Annotated[float, strict, Field(ge=0.01, le=1), MustBe("a number from 0.01 to 1")]


class Exponential(Interface):
    """Adhesion that decays exponentially with the gap: w = -work exp(-g/range).

    Examples
    --------
    >>> law = gfmdlayer.Exponential(work=1e-3, range=4e-3)
    >>> law.traction([0.0, 4e-3]).round(4)
    array([0.25 , 0.092])
    """

    law: Literal["exponential"] = "exponential"
    """w = -work exp(-g/range)"""
    work: Positive
    """work of adhesion: pressure length"""
    range: Positive
    """gap over which the traction falls by a factor e: length"""

    def interaction(self, units: Units | None = None) -> Interaction:  # noqa: ARG002
        """Return the law as solvers take it."""
        from gfmdlayer.interface import forms
        from gfmdlayer.interface.law import of_terms

        stress = self.work / self.range
        return of_terms((forms.EXPONENTIAL, stress, self.range, 0.0), work=self.work, strength=stress)


class Dugdale(Interface):
    """A constant traction up to the range work/stress, with a smooth end.

    The traction falls from `stress` to zero over `smoothing` times the range, around the range, as a cubic
    with zero slope at both ends, so that the work is as given.

    Examples
    --------
    >>> law = gfmdlayer.Dugdale(work=1e-3, stress=0.25, smoothing=0.5)
    >>> law.traction([0.0, 4e-3, 6e-3])
    array([0.25 , 0.125, 0.   ])
    """

    points_in_zone: ClassVar[int] = 8

    law: Literal["dugdale"] = "dugdale"
    """constant traction up to the range work/stress"""
    work: Positive
    """work of adhesion: pressure length"""
    stress: Positive
    """traction: pressure"""
    smoothing: Smoothing = 0.2
    """part of the range over which the traction falls to zero"""

    def interaction(self, units: Units | None = None) -> Interaction:  # noqa: ARG002
        """Return the law as solvers take it."""
        from gfmdlayer.interface import forms
        from gfmdlayer.interface.law import of_terms

        reach = self.work / self.stress
        term = (forms.COHESIVE_ZONE, self.stress, reach, self.smoothing * reach)
        return of_terms(term, work=self.work, strength=self.stress)


class LennardJones(Interface):
    """The 9-3 law between half spaces, with a hard wall at the equilibrium separation z0.

    With z = g + z0, tau = (8 work/(3 z0)) ((z0/z)^3 - (z0/z)^9): zero in contact, largest at g = 0.201 z0,
    where it is 1.026 work/z0.

    Examples
    --------
    >>> law = gfmdlayer.LennardJones(work=1e-3, separation=4e-3)
    >>> law.energy(0.0), law.traction([0.0, 8.04e-4]).round(4)
    (array(-0.001), array([0.    , 0.2566]))
    """

    law: Literal["lennard_jones"] = "lennard_jones"
    """9-3 law, with the wall at the equilibrium separation"""
    work: Positive
    """work of adhesion: pressure length"""
    separation: Positive
    """equilibrium separation of the surfaces: length"""

    def interaction(self, units: Units | None = None) -> Interaction:  # noqa: ARG002
        """Return the law as solvers take it."""
        from gfmdlayer.interface import forms
        from gfmdlayer.interface.law import of_terms

        stress = 8 / 3 * self.work / self.separation
        # x^3 - x^9 is largest at x^6 = 1/3.
        strength = stress * 2 / 3 / math.sqrt(3)
        return of_terms(
            (forms.LENNARD_JONES, stress, self.separation, 0.0), work=self.work, strength=strength
        )


Relative = Annotated[float, strict, Field(ge=1), MustBe("a number >= 1, finite: relative to vacuum")]


class Insulator(Section):
    """An insulating layer between the conductors."""

    thickness: Positive
    """thickness: length"""
    permittivity: Relative
    """relative permittivity"""


_thickness = MustBe("a number > 0, finite, or a list of {thickness: ..., permittivity: ...}")
Insulation = Annotated[
    Annotated[float, strict, Field(gt=0), _thickness, Tag("<number>")]
    | Annotated[tuple[Insulator, ...], Field(json_schema_extra={"minItems": 1}), Tag("<list>")],
    Discriminator(lambda value: "<list>" if isinstance(value, (list, tuple)) else "<number>"),
]


def _is_file(value: object) -> bool:
    """Whether a value names a file, and is no number with a unit."""
    return isinstance(value, Path) or (isinstance(value, str) and not is_quantity(value))


_volts = MustBe("a number, finite, or the name of a file")
Voltage = Annotated[
    Annotated[Finite, _volts, Tag("<number>")] | Annotated[File, Tag("<file>")],
    Discriminator(lambda value: "<file>" if _is_file(value) else "<number>"),
]


class Electrostatic(Interface):
    """Attraction by a voltage: w = -(eps0/2) V^2/(g + h0).

    Examples
    --------
    >>> law = gfmdlayer.Electrostatic(voltage=2.0, insulation=0.1, permittivity=1e-3)
    >>> law.traction([0.0, 0.1])
    array([0.2 , 0.05])
    >>> layers = [{"thickness": 0.2, "permittivity": 4.0}, {"thickness": 0.1, "permittivity": 2.0}]
    >>> gfmdlayer.Electrostatic(voltage=2.0, insulation=layers, permittivity=1e-3).h0
    0.1
    """

    law: Literal["electrostatic"] = "electrostatic"
    """attraction by a voltage: w = -(permittivity/2) voltage^2/(g + h0)"""
    voltage: Voltage
    """between punch and base, or a file with two columns, time and voltage: V"""
    insulation: Insulation
    """h0, thickness/relative permittivity, or a list of insulators: length"""
    permittivity: Optional = None
    """permittivity of vacuum; known from units: pressure length^2/V^2"""
    reading: Annotated[Reading | None, given] = None
    """how the file of the voltage is read, where it does not say so"""

    @property
    def h0(self) -> float:
        """Thickness of the insulators over their relative permittivities, in all."""
        if isinstance(self.insulation, tuple):
            return math.fsum(each.thickness / each.permittivity for each in self.insulation)
        return self.insulation

    def problems(self) -> Iterator[Mistake]:
        """Refuse a list without insulators: the traction in contact would be infinite."""
        if not self.h0:
            yield Mistake(("insulation",), f"got an empty list; must be {_thickness.allowed}")
        yield from unread(self, "voltage")

    def permittivity_of_vacuum(self, units: Units | None) -> float | None:
        """Return the given permittivity, or that in the units; None without either.

        Parameters
        ----------
        units : Units or None
            Units of the numbers.

        Returns
        -------
        float or None
            In pressure length^2/volt^2.
        """
        if self.permittivity is not None or units is None:
            return self.permittivity
        return units.permittivity_of_vacuum

    def interaction(self, units: Units | None = None) -> Interaction:
        """Return the law as solvers take it, driven by the voltage over time where it is a table."""
        from gfmdlayer.interface import forms
        from gfmdlayer.interface.law import Driven, of_terms
        from gfmdlayer.time_functions import Table

        permittivity = self.permittivity_of_vacuum(units)
        if permittivity is None:
            raise ConfigError([f"permittivity: {NO_PERMITTIVITY}"])
        stress = 0.5 * permittivity / self.h0**2
        one = of_terms((forms.INVERSE_SQUARE, stress, self.h0, 0.0), work=stress * self.h0, strength=stress)
        if isinstance(self.voltage, Path):
            into = label_of(units, "time"), "V"
            return Driven.by(one, Table.read(self.voltage, "voltage", into, self.reading))
        return one.times(self.voltage**2)


NO_PERMITTIVITY = (
    "missing; must be given in units of pressure length^2/V^2 (8.854e-12 with Pa and m), or units be given"
)


class ShortRange(Interface):
    """Adhesion without a range: the edge of the contact takes energy (Johnson, Kendall & Roberts).

    For an axisymmetric indenter. A periodic grid resolves no edge without a range. At a temperature with one
    shift of all materials, aT v takes the place of the speed v.
    """

    law: Literal["short_range"] = "short_range"
    """axisymmetric: energy that the edge of the contact takes, after JKR"""
    work: Positive
    """energy per area that a slowly receding edge takes, with the relaxed modulus: pressure length"""
    edge_speed: Optional = None
    """speed at which a receding edge takes twice the work; default: it takes the same at any: length/time"""
    edge_exponent: Positive = 0.6
    """exponent n of the work (1 + (v/edge_speed)^n) at a speed v"""
    healing_work: Annotated[NotNegative | None, given] = None
    """energy per area that a slowly advancing edge gains; default: most possible: pressure length"""

    def interaction(self, units: Units | None = None) -> Interaction:  # noqa: ARG002
        """Return no terms: nothing acts across the gap."""
        from gfmdlayer.interface.law import HARD_WALL

        return HARD_WALL
