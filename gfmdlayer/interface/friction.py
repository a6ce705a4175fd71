"""Friction at the interface: the largest shear traction that the surfaces carry where they touch."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Discriminator, Tag

from gfmdlayer.interface.interface import Interface
from gfmdlayer.validation.fields import File, MustBe, NotNegative
from gfmdlayer.validation.units import Units

if TYPE_CHECKING:
    from gfmdlayer.interface.law import Interaction

_number_or_file = MustBe("a number >= 0, finite, or the name of a file")
Coefficient = Annotated[
    Annotated[NotNegative, _number_or_file, Tag("<number>")] | Annotated[File, Tag("<file>")],
    Discriminator(lambda value: "<file>" if isinstance(value, (str, Path)) else "<number>"),
]


class Friction(Interface):
    """A law of friction; it has no traction across the gap."""

    attracts: ClassVar[bool] = False

    def interaction(self, units: Units | None = None) -> Interaction:  # noqa: ARG002
        """Return the hard wall."""
        from gfmdlayer.interface.law import HARD_WALL

        return HARD_WALL


class Coulomb(Friction):
    """Coulomb's law: the shear traction is at most the coefficient times the pressure."""

    law: Literal["coulomb"] = "coulomb"
    """friction: shear traction up to coefficient times pressure"""
    coefficient: Coefficient
    """coefficient of friction, or a file with two columns, slip speed and coefficient"""


class ShearStrength(Friction):
    """A constant shear strength of the contact, as of adhesive friction."""

    law: Literal["shear_strength"] = "shear_strength"
    """friction: shear traction up to a constant stress in contact"""
    stress: NotNegative
    """shear strength of the contact: pressure"""
