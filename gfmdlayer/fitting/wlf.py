"""Time-temperature superposition after Williams, Landel & Ferry, J. Am. Chem. Soc. 77 (1955) 3701-3707.

    log10 aT = -C1 (T - T0)/(C2 + T - T0)

All relaxation times at the temperature T are aT times those at the reference temperature T0. Moduli do not
change: the factor rho T/(rho0 T0), close to one, is neglected. Temperatures enter by their difference
alone, in kelvin or degrees Celsius.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

from gfmdlayer.fitting.measurement import FitError


@dataclass(frozen=True)
class WLF:
    """A change of temperature of a material that follows the equation of Williams, Landel and Ferry.

    Parameters
    ----------
    temperature, reference : float
        T, and T0 at which the material was measured or to which its master curve was reduced.
    C1, C2 : float
        The material's constants at T0, both positive; C2 is a difference of temperatures.

    Raises
    ------
    FitError
        A number is not finite, a constant is not positive, T - T0 <= -C2, where the equation has its pole,
        or aT leaves the range of a double.
    """

    temperature: float
    reference: float
    C1: float
    C2: float

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, astuple(self))):
            raise FitError(f"{self}: must be finite numbers")
        if self.C1 <= 0 or self.C2 <= 0:
            raise FitError(f"WLF constants C1 = {self.C1:g} and C2 = {self.C2:g}: must both be > 0")
        if self.temperature - self.reference <= -self.C2:
            raise FitError(
                f"temperature {self.temperature:g} is {self.reference - self.temperature:g} below the "
                f"reference {self.reference:g}; must be less than C2 = {self.C2:g} below it, where the WLF "
                "equation ends"
            )
        if abs(self.decades) > 100:
            raise FitError(
                f"the WLF equation shifts by {self.decades:.3g} decades at temperature {self.temperature:g}; "
                "must be at most 100"
            )

    @property
    def decades(self) -> float:
        """log10 aT, negative above the reference temperature."""
        above = self.temperature - self.reference
        return -self.C1 * above / (self.C2 + above)

    @property
    def factor(self) -> float:
        """The factor aT by which relaxation times are multiplied."""
        return float(10.0**self.decades)
