"""A first guess of the next step from the accepted ones."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class Extrapolation:
    """The parabola in time through the last three accepted fields (fewer where there are fewer).

    Against starting from the last field, it halves the work of a step or better; see
    ``scripts/benchmark.py``.

    Parameters
    ----------
    shape : tuple of int
        Shape of the fields; before anything is remembered the guess is zero.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self._past: deque[tuple[float, FloatArray]] = deque(maxlen=3)

    def remember(self, time: float, field: FloatArray, *, kink: bool = False) -> None:
        """Add an accepted field.

        At a kink of the trajectory what came before says nothing about what follows.
        """
        if kink:
            self._past.clear()
        self._past.append((time, field))

    def at(self, time: float) -> FloatArray:
        """Return the guess for a later time, as a new array."""
        guess = np.zeros(self._shape)
        for i, (t, field) in enumerate(self._past):
            others = [s for j, (s, _) in enumerate(self._past) if j != i]
            guess += np.prod([(time - s) / (t - s) for s in others]) * field
        return guess
