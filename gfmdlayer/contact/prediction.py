"""The pressure of the next step, extrapolated from the accepted ones.

As a first guess and a first contact set.

Where a smooth surface leaves the punch, the pressure falls to zero like xi^(1/2) and the gap opens like
xi^(3/2) with the distance xi from the edge (Johnson, Contact Mechanics, 1985, ch. 4). Neither can be
extrapolated at a point that the edge passes, but

    s = p^2 inside,    s = -mu gap^(2/3) outside

is smooth across the edge, and so along time. mu is learned from the points that the edge has just passed.
Where the edge does not move, the pressure itself is extrapolated, which carries less noise.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numba as nb
import numpy as np

from gfmdlayer.contact.grid import FloatArray


class DisplacementPrediction:
    """The parabola in time through the last three accepted displacements (fewer where there are fewer).

    Parameters
    ----------
    size : int
        Number of grid points; before anything is remembered the guess is zero.
    """

    def __init__(self, size: int) -> None:
        self._past: deque[tuple[float, FloatArray]] = deque(maxlen=3)
        self._nothing = np.zeros(size)

    def remember(self, time: float, displacement: FloatArray, _: FloatArray, *, kink: bool = False) -> None:
        """Add an accepted step.

        At a kink of the trajectory what came before says nothing about what follows.
        """
        if kink:
            self._past.clear()
        self._past.append((time, displacement))

    def at(self, time: float) -> FloatArray:
        """Return the guess for a later time, as a new array."""
        weights, fields = _weighted(
            [t for t, _ in self._past], [u for _, u in self._past], time, self._nothing
        )
        return _combined(weights, fields)


def _weighted(
    times: list[float], fields: list[FloatArray], time: float, nothing: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, ...]]:
    """Lagrange's weights for a time, and three fields; without weight where there are fewer."""
    missing = 3 - len(times)
    weights = [math.prod((time - s) / (t - s) for s in times if s != t) for t in times]
    return np.array([0.0] * missing + weights), (nothing,) * missing + tuple(fields)


class _Past(NamedTuple):
    time: float
    pressure: FloatArray
    gap: FloatArray


class PressurePrediction:
    """Extrapolates with the parabola through the last three accepted steps (fewer where there are fewer).

    Parameters
    ----------
    size : int
        Number of grid points; before anything is remembered the guess is zero.
    """

    def __init__(self, size: int) -> None:
        self._past: deque[_Past] = deque(maxlen=3)
        self._nothing = np.zeros(size)
        self._mu = 0.0
        self._moves = 0

    def remember(self, time: float, pressure: FloatArray, gap: FloatArray, *, kink: bool = False) -> None:
        """Add an accepted step.

        At a kink of the trajectory what came before says nothing about what follows.
        """
        if self._past:
            last = self._past[-1]
            weights, _, gaps = self._stacked(time)
            self._mu, moved = _learn(weights, gaps, last.pressure, pressure, self._mu)
            self._moves = self._moves + 1 if moved else 0
        if kink:
            self._past.clear()
        self._past.append(_Past(time, pressure, gap))

    def at(self, time: float) -> FloatArray:
        """Return the guess for a later time, as a new array."""
        if not self._past:
            return self._nothing.copy()
        weights, pressures, gaps = self._stacked(time)
        return _extrapolate(weights, pressures, gaps, self._mu, self._moves > 1)

    def _stacked(self, time: float) -> tuple[FloatArray, tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        times = [past.time for past in self._past]
        first = self._past[0]
        weights, pressures = _weighted(times, [past.pressure for past in self._past], time, first.pressure)
        _, gaps = _weighted(times, [past.gap for past in self._past], time, first.gap)
        return weights, pressures, gaps


@nb.njit(nogil=True, cache=True)
def _learn(
    w: FloatArray, gaps: tuple[FloatArray, ...], last: FloatArray, now: FloatArray, mu: float
) -> tuple[float, bool]:
    """Mu from the points that came into contact, and whether the contact changed at all."""
    squares, predicted, moved = 0.0, 0.0, False
    for i in range(now.size):
        if (now[i] > 0.0) != (last[i] > 0.0):
            moved = True
            if now[i] > 0.0:
                s = -(
                    w[0] * _two_thirds(gaps[0][i])
                    + w[1] * _two_thirds(gaps[1][i])
                    + w[2] * _two_thirds(gaps[2][i])
                )
                if s > 0.0:
                    squares += now[i] ** 2
                    predicted += s
    return (squares / predicted if predicted > 0.0 else mu), moved


@nb.njit(nogil=True, cache=True)
def _extrapolate(
    w: FloatArray, p: tuple[FloatArray, ...], gaps: tuple[FloatArray, ...], mu: float, moving: bool
) -> FloatArray:
    guess = np.empty(p[0].size)
    for i in range(guess.size):
        if (p[0][i] > 0.0 and p[1][i] > 0.0 and p[2][i] > 0.0) or (not moving and p[2][i] > 0.0):
            if moving:
                s = w[0] * p[0][i] ** 2 + w[1] * p[1][i] ** 2 + w[2] * p[2][i] ** 2
                guess[i] = np.sqrt(s) if s > 0.0 else 0.0
            else:
                linear = _combine(w, p, i)
                guess[i] = linear if linear > 0.0 else 0.0
        elif p[2][i] <= 0.0 and 2.0 * _combine(w, gaps, i) > gaps[2][i]:
            guess[i] = 0.0  # far from closing
        else:
            s = 0.0
            for j in range(3):
                s += w[j] * (p[j][i] ** 2 if p[j][i] > 0.0 else -mu * _two_thirds(gaps[j][i]))
            guess[i] = np.sqrt(s) if s > 0.0 else 0.0
    return guess


@nb.njit(nogil=True, cache=True)
def _combined(w: FloatArray, fields: tuple[FloatArray, ...]) -> FloatArray:
    field = np.empty(fields[0].size)
    for i in range(field.size):
        field[i] = _combine(w, fields, i)
    return field


@nb.njit(nogil=True)
def _combine(w: FloatArray, fields: tuple[FloatArray, ...], i: int) -> float:
    return float(w[0] * fields[0][i] + w[1] * fields[1][i] + w[2] * fields[2][i])


@nb.njit(nogil=True)
def _two_thirds(gap: float) -> float:
    return float(np.cbrt(gap * gap))


PREDICTIONS: dict[str, type[DisplacementPrediction | PressurePrediction]] = {
    "displacement": DisplacementPrediction,
    "pressure": PressurePrediction,
}
