"""The bound of friction: the largest shear traction that the surfaces carry where they touch.

The laws of friction of a configuration make one bound, min(mu p, tau_0). The coefficient mu of a file depends
on the slip speed: a step then finds speeds and coefficients that agree (`friction.slip_speed`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.files.tables import TableError, read_table
from gfmdlayer.interface.interface import Coulomb, FrictionLaw, ShearStrength
from gfmdlayer.validation.reading import Reading, answers
from gfmdlayer.validation.units import Units, label_of


@dataclass(frozen=True, eq=False)
class SpeedTable:
    """Coefficient of friction over the slip speed, linear between the rows of a table and constant beyond."""

    speeds: FloatArray  # increasing, >= 0; length / time
    values: FloatArray  # coefficients >= 0
    account: str = ""  # how the file was read

    @classmethod
    def read(cls, file: Path, units: Units | None = None, reading: Reading | None = None) -> SpeedTable:
        """Read a table of two columns, in any order of the speeds; TableError if it cannot be used."""
        table = read_table(file, ("speed", "coefficient"), answers(reading))
        speeds = table.take("speed", label_of(units, "length / time"))
        values = table.take("coefficient", "1")
        smaller = np.minimum(speeds, values)
        if smaller[row := int(smaller.argmin())] < 0:
            found = f"holds {smaller[row]:g}; speed and coefficient must be >= 0"
            raise TableError(f"{table.place(row)}: {found}")
        order = table.ascending(speeds, "speed")
        return cls(speeds[order], values[order], table.account)

    def at(self, speed: Any) -> FloatArray:
        """Coefficient at a slip speed, or at an array of them."""
        return np.asarray(np.interp(speed, self.speeds, self.values))

    def slope(self, speed: FloatArray) -> FloatArray:
        """Rise of the coefficient over the speed, at speeds; at a row, that of the speeds above it."""
        rises = np.append(np.diff(self.values) / np.diff(self.speeds), 0.0)
        at = np.searchsorted(self.speeds, speed, side="right") - 1
        return np.where(at < 0, 0.0, rises[at])

    @property
    def range(self) -> tuple[float, float]:
        """The least and the largest coefficient."""
        return float(self.values.min()), float(self.values.max())

    @property
    def steepest_rise(self) -> float:
        """The largest rise of the coefficient over a rise of the speed; 0 where it never rises."""
        return float((np.diff(self.values) / np.diff(self.speeds)).max(initial=0.0))

    @property
    def steepest_fall(self) -> float:
        """The largest fall of the coefficient over a rise of the speed; 0 where it never falls."""
        return float((-np.diff(self.values) / np.diff(self.speeds)).max(initial=0.0))


@dataclass(frozen=True)
class ShearBound:
    """Largest shear traction min(mu p, tau_0) of a point in contact.

    Both infinite: the surfaces stick where they touch. The coefficient may differ from point to point.
    """

    coefficient: float | FloatArray = math.inf  # mu >= 0; that at rest, if it depends on the slip speed
    strength: float = math.inf  # tau_0 >= 0, pressure
    over_speed: SpeedTable | None = field(default=None, compare=False)  # mu as a function of the slip speed

    def __post_init__(self) -> None:
        lowest = float(np.min(self.coefficient))
        if not lowest >= 0:
            raise ValueError(f"coefficient of friction: got {lowest!r}; must be >= 0")
        if not self.strength >= 0:
            raise ValueError(f"shear strength: got {self.strength!r}; must be >= 0")

    @classmethod
    def of(cls, laws: Iterable[FrictionLaw], units: Units | None = None) -> ShearBound | None:
        """Return the bound of laws of friction together; None without any, TableError from a bad file."""
        bound: ShearBound | None = None
        for law in laws:
            bound = bound or cls()
            if isinstance(law, ShearStrength):
                bound = replace(bound, strength=law.stress)
            elif isinstance(law, Coulomb):
                mu, table = law.coefficient, None
                if isinstance(mu, Path):
                    table = SpeedTable.read(mu, units, law.reading)
                    mu = float(table.at(0.0))
                bound = replace(bound, coefficient=mu, over_speed=table)
        return bound

    @property
    def is_frictionless(self) -> bool:
        """Whether the bound is zero everywhere, at the present slip speeds."""
        mu = self.coefficient
        return self.strength == 0 or not (mu if isinstance(mu, float) else np.any(mu))

    @property
    def sticks(self) -> bool:
        """Whether no traction is too large."""
        return math.isinf(self.strength) and bool(np.isinf(self.coefficient).all())

    @property
    def _is_cone(self) -> bool:
        """Whether it is Coulomb's law with one coefficient, which takes less time."""
        return isinstance(self.coefficient, float) and self.coefficient < math.inf == self.strength

    def at(self, points: NDArray[Any]) -> ShearBound:
        """Bound at some points."""
        mu = self.coefficient
        return self if isinstance(mu, float) or np.ndim(mu) == 0 else replace(self, coefficient=mu[points])

    def bound(self, pressure: FloatArray, touching: BoolArray | None = None) -> FloatArray:
        """Largest traction under a pressure, at points that touch: by default where it is positive."""
        touching = pressure > 0 if touching is None else touching
        if self._is_cone:
            return np.where(touching, self.coefficient * pressure, 0.0)
        with np.errstate(invalid="ignore"):
            cone = np.where(touching, self.coefficient * pressure, 0.0)
        if np.isinf(self.coefficient).any():
            cone = np.where(touching & np.isinf(self.coefficient), np.inf, cone)
        return np.minimum(cone, np.where(touching, self.strength, 0.0))

    def slope(self, pressure: FloatArray) -> FloatArray:
        """Derivative of the bound in the pressure, at points that touch."""
        if self._is_cone:
            return np.full(pressure.shape, self.coefficient)
        with np.errstate(invalid="ignore"):
            on_cone = np.isfinite(self.coefficient) & (self.coefficient * pressure < self.strength)
        return np.where(on_cone, self.coefficient, 0.0)

    def scaled(self, part: float) -> ShearBound:
        """Bound of the same shape with a part of the size."""
        finite = np.isfinite(self.coefficient)
        coefficient = np.where(finite, np.where(finite, self.coefficient, 0.0) * part, np.inf)
        strength = self.strength * part if math.isfinite(self.strength) else math.inf
        scaled = coefficient if np.ndim(self.coefficient) else float(coefficient)
        return replace(self, coefficient=scaled, strength=strength)
