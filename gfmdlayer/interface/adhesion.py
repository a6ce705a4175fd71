"""Hard wall, and adhesion by a work and a range or a stress.

Every law but the hard wall is stated by its work of adhesion w, so that -w is the energy in contact and 0
that far away; tau is the traction. See `docs/theory/adhesion.md`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from gfmdlayer.interface.interface import Interface
from gfmdlayer.validation.fields import MustBe, Optional, Positive, strict
from gfmdlayer.validation.units import Units

if TYPE_CHECKING:
    from gfmdlayer.interface.law import Interaction

Smoothing = Annotated[float, strict, Field(ge=0.01, le=1), MustBe("a number from 0.01 to 1")]


class HardWall(Interface):
    """The paper's contact, without attraction; a hardness ends pressures, and leaves an imprint."""

    attracts: ClassVar[bool] = False

    law: Literal["hard_wall"] = "hard_wall"
    """a hard wall without attraction"""
    hardness: Optional = None
    """largest contact pressure, at which the surfaces yield: pressure"""

    def interaction(self, units: Units | None = None) -> Interaction:  # noqa: ARG002
        """Return no terms."""
        from gfmdlayer.interface.law import HARD_WALL

        return HARD_WALL


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
