"""Electrostatic attraction of conducting punch and base across an air gap and insulating layers.

Locally parallel plates: with the relative permittivities eps_i and thicknesses t_i of the insulators, and
h0 = sum of t_i/eps_i, a voltage V stores the charge eps0 V/(g + h0) per area, and at a constant voltage the
energy of field and source together is

    w = -(eps0/2) V^2/(g + h0),        tau = dw/dg = (eps0/2) V^2/(g + h0)^2

which attracts for either sign of V. See `docs/theory/adhesion.md`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Discriminator, Field, Tag

from gfmdlayer.interface.interface import Interface
from gfmdlayer.validation.fields import File, Finite, MustBe, Optional, Positive, strict
from gfmdlayer.validation.problems import ConfigError, Problem
from gfmdlayer.validation.sections import Section
from gfmdlayer.validation.units import Units

if TYPE_CHECKING:
    from gfmdlayer.interface.law import Interaction

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
_volts = MustBe("a number, finite, or the name of a file")
Voltage = Annotated[
    Annotated[Finite, _volts, Tag("<number>")] | Annotated[File, Tag("<file>")],
    Discriminator(lambda value: "<file>" if isinstance(value, (str, Path)) else "<number>"),
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

    @property
    def h0(self) -> float:
        """Thickness of the insulators over their relative permittivities, in all."""
        if isinstance(self.insulation, tuple):
            return math.fsum(each.thickness / each.permittivity for each in self.insulation)
        return self.insulation

    def problems(self) -> Iterator[Problem]:
        """Refuse a list without insulators: the traction in contact would be infinite."""
        if not self.h0:
            yield Problem(("insulation",), f"got an empty list; must be {_thickness.allowed}")

    def permittivity_of_vacuum(self, units: Units | None) -> float | None:
        """Return the given permittivity, or that in the units; None where these do not tell."""
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
            return Driven.by(one, Table.read(self.voltage, "voltage"))
        return one.times(self.voltage**2)


NO_PERMITTIVITY = (
    "missing; must be given in units of pressure length^2/V^2 (8.854e-12 with Pa and m), or units be given"
)
