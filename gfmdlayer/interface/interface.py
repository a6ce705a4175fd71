"""Interface laws as sections of the configuration and as Python objects at once: the hard wall, and friction.

Configurations are read without numpy, which is imported inside of methods.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Tag

from gfmdlayer.validation.fields import File, MustBe, NotNegative, Optional, given
from gfmdlayer.validation.problems import Mistake
from gfmdlayer.validation.reading import Reading, unread
from gfmdlayer.validation.sections import Kind
from gfmdlayer.validation.units import Units

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.interface.law import Interaction


class Interface(Kind):
    """A law of the interaction of surface and punch across the gap."""

    attracts: ClassVar[bool] = True
    points_in_zone: ClassVar[int] = 3  # of a cohesive zone, with which edges of the contact are resolved

    law: str
    """word that chooses the law"""

    @abstractmethod
    def interaction(self, units: Units | None = None) -> Interaction:
        """Return the law as solvers take it.

        Parameters
        ----------
        units : Units, optional
            Of the numbers, where a constant of nature depends on them.

        Raises
        ------
        ConfigError
            If the law rests on units that are not given.
        TableError
            If it comes from a file that cannot be used.
        """

    def energy(self, gap: ArrayLike) -> FloatArray:
        """Energy w(g) per area, in the shape of the gap g >= 0; zero far away.

        Parameters
        ----------
        gap : array_like
            Gap g >= 0: length.

        Returns
        -------
        ndarray
            Energy per area: pressure length.
        """
        return self.interaction().energy(_numbers(gap))

    def traction(self, gap: ArrayLike) -> FloatArray:
        """Traction tau = dw/dg, positive where it attracts, in the shape of the gap.

        Parameters
        ----------
        gap : array_like
            Gap g >= 0: length.

        Returns
        -------
        ndarray
            Traction: pressure.
        """
        return self.interaction().traction(_numbers(gap))

    def curvature(self, gap: ArrayLike) -> FloatArray:
        """Curvature d^2w/dg^2, in the shape of the gap.

        Parameters
        ----------
        gap : array_like
            Gap g >= 0: length.

        Returns
        -------
        ndarray
            Stiffness per area: pressure/length.
        """
        return self.interaction().curvature(_numbers(gap))


def _numbers(gap: ArrayLike) -> Any:
    import numpy as np

    return np.asarray(gap, dtype=np.float64)


class WithoutAttraction(Interface):
    """A law without traction across the gap."""

    attracts: ClassVar[bool] = False

    def interaction(self, units: Units | None = None) -> Interaction:  # noqa: ARG002
        """Return no terms."""
        from gfmdlayer.interface.law import HARD_WALL

        return HARD_WALL


class HardWall(WithoutAttraction):
    """The paper's contact: no attraction; where the pressure reaches a hardness, an imprint stays."""

    law: Literal["hard_wall"] = "hard_wall"
    """a hard wall without attraction"""
    hardness: Optional = None
    """largest contact pressure, at which the surfaces yield: pressure"""


_number_or_file = MustBe("a number >= 0, finite, or the name of a file")
Coefficient = Annotated[
    Annotated[NotNegative, _number_or_file, Tag("<number>")] | Annotated[File, Tag("<file>")],
    Discriminator(lambda value: "<file>" if isinstance(value, (str, Path)) else "<number>"),
]


class FrictionLaw(WithoutAttraction):
    """A law of friction: the largest shear traction that the surfaces carry where they touch."""


class Coulomb(FrictionLaw):
    """Coulomb's law: the shear traction is at most the coefficient times the pressure."""

    law: Literal["coulomb"] = "coulomb"
    """friction: shear traction up to coefficient times pressure"""
    coefficient: Coefficient
    """coefficient of friction, or a file with two columns, slip speed and coefficient"""
    reading: Annotated[Reading | None, given] = None
    """how the file is read, where it does not say so"""

    def problems(self) -> Iterator[Mistake]:
        """Refuse a reading without a file."""
        yield from unread(self, "coefficient")


class ShearStrength(FrictionLaw):
    """A constant shear strength of the contact, as of adhesive friction."""

    law: Literal["shear_strength"] = "shear_strength"
    """friction: shear traction up to a constant stress in contact"""
    stress: NotNegative
    """shear strength of the contact: pressure"""
