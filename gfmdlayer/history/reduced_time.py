"""Reduced time of a body whose relaxation times are all multiplied by one factor aT(T(t)).

    xi(t) = int_0^t dt'/aT(T(t'))

In reduced time the body relaxes as at the reference temperature, exactly: Morland & Lee, Trans. Soc. Rheol. 4
(1960) 233-263. So the history takes steps of reduced time; its heat, energy and errors do not change. Time
points, drives and results keep to real time.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from gfmdlayer.body.shifts import Shift
from gfmdlayer.time_functions import Constant, Table

# Gauss-Legendre rule for exp(x) over a range of 4 in x: its error is 1e-17 of the integral.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_RANGE = 4.0


@dataclass(frozen=True)
class ReducedTime:
    """Steps of reduced time, by the law of aT and the temperature over time in degrees Celsius."""

    shift: Shift
    temperature: Constant | Table

    def factor(self, time: float) -> float:
        """Return aT at a time."""
        return self.shift.factor(self.temperature(time))

    @property
    def extremes(self) -> tuple[float, float]:
        """Smallest and largest aT, at the highest and the lowest temperature."""
        temperature = self.temperature
        values = temperature.values if isinstance(temperature, Table) else np.array([temperature.value])
        return self.shift.factor(float(values.max())), self.shift.factor(float(values.min()))

    def step(self, begin: float, length: float) -> float:
        """Return the reduced time of a step, exact to rounding; before t = 0 the temperature is that at 0."""
        end = begin + length
        inside = [time for time in self.temperature.breakpoints if begin < time < end]
        if not inside and self.temperature(begin) == self.temperature(end):
            return length / self.factor(end)
        edges = [begin, *inside, end] if begin >= 0 or end <= 0 else [begin, 0.0, *inside, end]
        return math.fsum(self._between(a, b) for a, b in itertools.pairwise(edges))

    def _between(self, begin: float, end: float) -> float:
        """Integral of 1/aT where the temperature is linear in time."""
        first, last = self.temperature(begin), self.temperature(end)
        change = abs(self.shift.logarithm(last) - self.shift.logarithm(first))
        parts = max(1, math.ceil(change / _RANGE))
        total = 0.0
        for k in range(parts):  # equal ones of ln aT
            low, high = (self._at(first, last, j / parts) for j in (k, k + 1))
            middle, half = (low + high) / 2, (high - low) / 2
            rates = [math.exp(-self.shift.logarithm(middle + half * x)) for x in _NODES]
            width = (end - begin) * (2 * half / (last - first) if last != first else 1.0)
            total += width / 2 * float(_WEIGHTS @ rates)
        return total

    def _at(self, first: float, last: float, part: float) -> float:
        """Temperature at which a part of the change of ln aT between two temperatures is reached."""
        a, b = 1 / (first - self.shift.pole), 1 / (last - self.shift.pole)
        return first if part == 0 else last if part == 1 else self.shift.pole + 1 / (a + part * (b - a))
