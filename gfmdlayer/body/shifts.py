"""Time-temperature superposition: the factor aT by which all relaxation times of a material are multiplied.

WLF, Williams, Landel & Ferry, J. Am. Chem. Soc. 77 (1955) 3701-3707, with T0 the reference temperature:

    log10 aT = -C1 (T - T0)/(C2 + T - T0)

Arrhenius, with the activation energy E per mole, the gas constant R and absolute temperatures:

    ln aT = E/R (1/T - 1/T0)

Moduli do not change: the factor rho T/(rho0 T0), close to one, is neglected, and so is thermal expansion.
Temperatures are in degrees Celsius.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Annotated, Literal

from pydantic import Field

from gfmdlayer.validation.fields import MustBe, Positive, strict
from gfmdlayer.validation.sections import Kind

GAS_CONSTANT = 8.31446261815324  # J/(mol K), CODATA 2018, exact
ZERO_CELSIUS = 273.15  # K
MOST_DECADES = 100  # of a shift; times multiplied by more leave the range of double precision

Celsius = Annotated[
    float, strict, Field(gt=-ZERO_CELSIUS), MustBe(f"a number > -{ZERO_CELSIUS}, finite: degrees Celsius")
]


class Shift(Kind):
    """The factor aT of the temperature in Celsius: ln aT = slope/(T - pole) + constant, T above the pole."""

    law: str
    """word that chooses the law"""
    reference: Celsius
    """temperature at which the relaxation times are given: degrees Celsius"""

    @property
    @abstractmethod
    def pole(self) -> float:
        """Temperature at and below which the law has no meaning."""

    @property
    @abstractmethod
    def slope(self) -> float:
        """Limit of (T - pole) ln aT at low temperatures, in kelvin."""

    def logarithm(self, temperature: float) -> float:
        """Return ln aT at a temperature above the pole.

        Parameters
        ----------
        temperature : float
            Degrees Celsius.
        """
        above, at_reference = temperature - self.pole, self.reference - self.pole
        return self.slope * (self.reference - temperature) / (above * at_reference)

    def factor(self, temperature: float) -> float:
        """Return aT at a temperature that is not `refused`.

        Parameters
        ----------
        temperature : float
            Degrees Celsius.
        """
        return math.exp(self.logarithm(temperature))

    def refused(self, temperature: float) -> str:
        """Return why the law has no value at a temperature, or nothing.

        Parameters
        ----------
        temperature : float
            Degrees Celsius.
        """
        if not temperature > self.pole:  # nor for NaN
            return (
                f"got {temperature:g}, where the {self.law} law has no value; must be above {self.pole:g} "
                "degrees Celsius"
            )
        decades = self.logarithm(temperature) / math.log(10)
        if not abs(decades) <= MOST_DECADES:
            found = f"got {temperature:g}, where the {self.law} law shifts times by {decades:.3g} decades"
            return f"{found}; must be a temperature with at most {MOST_DECADES}"
        return ""


class WLF(Shift):
    """Williams, Landel and Ferry, above the glass transition; C1 and C2 belong to the reference.

    Examples
    --------
    >>> shift = gfmdlayer.WLF(C1=17.44, C2=51.6, reference=20.0)
    >>> round(shift.factor(30.0), 6)
    0.001475
    >>> shift.refused(-40.0)
    'got -40, where the wlf law has no value; must be above -31.6 degrees Celsius'
    """

    law: Literal["wlf"] = "wlf"
    """log10 aT = -C1 (T - reference)/(C2 + T - reference)"""
    C1: Positive
    """constant of the law, 17.44 where the reference is the glass transition"""
    C2: Positive
    """constant, 51.6 where the reference is the glass transition: kelvin"""

    @property
    def pole(self) -> float:
        """C2 below the reference."""
        return self.reference - self.C2

    @property
    def slope(self) -> float:
        """C1 C2 ln 10."""
        return self.C1 * self.C2 * math.log(10)


class Arrhenius(Shift):
    """A thermally activated process.

    Examples
    --------
    >>> round(gfmdlayer.Arrhenius(activation_energy=8e4, reference=20.0).factor(30.0), 6)
    0.33868
    """

    law: Literal["arrhenius"] = "arrhenius"
    """ln aT = E/R (1/T - 1/reference), with absolute temperatures"""
    activation_energy: Positive
    """activation energy E: J/mol"""

    @property
    def pole(self) -> float:
        """The absolute zero."""
        return -ZERO_CELSIUS

    @property
    def slope(self) -> float:
        """E/R."""
        return self.activation_energy / GAS_CONSTANT


SHIFTS: dict[str, type[Shift]] = {"wlf": WLF, "arrhenius": Arrhenius}
