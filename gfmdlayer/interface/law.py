"""Interface laws: the interaction of surface and punch across the gap g, beside the hard wall.

An interface law gives an energy w(g) per area; tau(g) = dw/dg is the traction that pulls surface and punch
together where it is positive. No law lets the surface pass through the punch: g >= 0 holds for each, and the
pressure of the wall, p_c >= 0 with p_c g = 0, is the compressive stress of the surface plus tau.

Every law is a sum of `terms`, a record of arrays that compiled code takes as an argument. Any kernel
evaluates any law or sum of laws at a point of its loop by `interact(gap, terms)` (`forms`), without being
compiled anew for another law; `energy`, `traction` and `curvature` are the same over arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.interface.forms import Terms, add_curvature, add_energy, add_traction
from gfmdlayer.time_functions import Table


@dataclass(frozen=True, eq=False)
class Interaction:
    """An interface law, which does not depend on time; in `Driven` and `Total` it may.

    A law that depends on time has these values at its largest strength, except `at` and `breakpoints`.
    """

    terms: Terms  # as compiled code takes them, see `forms.interact`
    work: float  # work of adhesion, -w(0): energy per area
    strength: float  # largest traction, or a bound on it in a sum of laws: pressure

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times t > 0 at which the law or its slope in time jumps."""
        return ()

    def at(self, time: float) -> Interaction:  # noqa: ARG002
        """Return the law at a time; the same object for one that does not depend on time."""
        return self

    @property
    def attracts(self) -> bool:
        """Whether there is a traction at all."""
        return self.strength > 0

    @property
    def range(self) -> float:
        """Gap over which the traction falls, work over strength; infinite for the hard wall: length."""
        return self.work / self.strength if self.attracts else float("inf")

    @property
    def traction_in_contact(self) -> float:
        """Traction at a gap of zero: pressure."""
        return float(self.traction(np.zeros(1))[0])

    def flow_stress(self, hardness: float) -> float:
        """Stress of a surface that yields: the hardness less the traction in contact."""
        return hardness - (self.traction_in_contact if self.attracts else 0.0)

    def energy(self, gap: FloatArray) -> FloatArray:
        """Energy w(g) per area, in the shape of the gap; it falls as the gap closes."""
        return self._sum(add_energy, gap)

    def traction(self, gap: FloatArray) -> FloatArray:
        """Traction dw/dg, positive where it attracts."""
        return self._sum(add_traction, gap)

    def curvature(self, gap: FloatArray) -> FloatArray:
        """Curvature d^2w/dg^2, a stiffness per area."""
        return self._sum(add_curvature, gap)

    def times(self, factor: float) -> Interaction:
        """Return the law with all of its tractions multiplied by a factor >= 0."""
        terms = self.terms._replace(stress=factor * self.terms.stress)
        return Interaction(terms, factor * self.work, factor * self.strength)

    def _sum(self, add: Callable[[FloatArray, Terms, FloatArray], None], gap: FloatArray) -> FloatArray:
        sums = np.zeros(gap.shape)
        if self.attracts:
            add(gap.reshape(-1), self.terms, sums.reshape(-1))
        return sums


def of_terms(*terms: tuple[int, float, float, float], work: float, strength: float) -> Interaction:
    """Return a law from form, stress, length and width of its terms, its work and its largest traction."""
    columns = zip(*terms, strict=True) if terms else ((),) * len(Terms._fields)
    form, *others = (np.array(column, dtype=np.float64) for column in columns)
    return Interaction(Terms(form.astype(np.int64), *others), work, strength)


HARD_WALL = of_terms(work=0.0, strength=0.0)


@dataclass(frozen=True, eq=False)
class Driven(Interaction):
    """A law whose tractions are those at one volt times the square of a voltage over time.

    Terms, work and strength are those at the largest voltage.
    """

    one: Interaction
    voltage: Table

    @classmethod
    def by(cls, one: Interaction, voltage: Table) -> Driven:
        """Return the law at one volt driven by a voltage over time."""
        most = one.times(float(np.abs(voltage.values).max()) ** 2)
        return cls(most.terms, most.work, most.strength, one, voltage)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times at which the slope of the voltage jumps."""
        return self.voltage.breakpoints

    def at(self, time: float) -> Interaction:
        """Return the law at the voltage of a time."""
        return self.one.times(self.voltage(time) ** 2)


@dataclass(frozen=True, eq=False)
class Total(Interaction):
    """The sum of several laws; its strength is a bound."""

    parts: Sequence[Interaction]

    @classmethod
    def of(cls, parts: Sequence[Interaction]) -> Total:
        """Return the sum of laws."""
        every = [part.terms for part in parts]
        joined = (np.concatenate(columns) for columns in zip(*every, strict=True))
        work = sum(part.work for part in parts)
        return cls(Terms(*joined), work, sum(part.strength for part in parts), parts)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Breakpoints of all parts."""
        return tuple(sorted({time for part in self.parts for time in part.breakpoints}))

    def at(self, time: float) -> Interaction:
        """Return the sum at a time."""
        return Total.of([part.at(time) for part in self.parts]) if self.breakpoints else self


def total(parts: Iterable[Interaction]) -> Interaction:
    """Return the sum of laws; the hard wall where none attracts."""
    attracting = [part for part in parts if part.attracts]
    return Total.of(attracting) if len(attracting) > 1 else next(iter(attracting), HARD_WALL)
