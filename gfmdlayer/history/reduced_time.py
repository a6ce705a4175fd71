"""Reduced time of a body whose relaxation times are all multiplied by one factor aT(T(t)).

    xi(t) = int_0^t dt'/aT(T(t'))

In reduced time the body relaxes as at the reference temperature, exactly: Morland & Lee, Trans. Soc. Rheol. 4
(1960) 233-263. So the history takes steps of reduced time; its heat, energy and errors do not change. Time
points, drives and results keep to real time.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from gfmdlayer.body.shifts import Shift
from gfmdlayer.time_functions import Constant, Table, distance

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

    def time(self, elapsed: float) -> float:
        """Return the time at which a reduced time has elapsed, to rounding."""
        times, reduced = self._knots
        at = bisect_right(reduced, elapsed) - 1
        begin, rest = times[at], elapsed - reduced[at]
        if at + 1 == len(times):
            return begin + rest * self.factor(begin)
        found = brentq(lambda end: self.step(begin, end - begin) - rest, begin, times[at + 1], xtol=1e-300)
        return float(found)

    @cached_property
    def _knots(self) -> tuple[list[float], list[float]]:
        """Times between which the temperature is linear, and their reduced times."""
        times = [0.0, *self.temperature.breakpoints]
        lengths = (self.step(a, b - a) for a, b in itertools.pairwise(times))
        return times, list(itertools.accumulate(lengths, initial=0.0))

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


@dataclass(frozen=True)
class MotionInReducedTime:
    """Velocity of the punch over reduced time: its way is that in time, v aT is its rate."""

    velocity: Constant | Table
    reduced: ReducedTime

    def __call__(self, elapsed: float, /) -> float:
        """Rate at a reduced time."""
        time = elapsed if math.isinf(elapsed) else self.reduced.time(elapsed)
        return self.velocity(time) * self.reduced.factor(time)

    def over(self, begin: float, length: float) -> tuple[float, float]:
        """Rates at the ends of a step, with the change over it and the mean that the way has."""
        ends = self.reduced.time(begin), self.reduced.time(begin + length)
        first, last = (self.velocity(time) * self.reduced.factor(time) for time in ends)
        if not length:
            return first, last
        mean = (distance(self.velocity, ends[1]) - distance(self.velocity, ends[0])) / length
        return mean - (last - first) / 2, mean + (last - first) / 2
