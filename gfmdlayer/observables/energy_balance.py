"""Where the work of the punch goes: work = stored + dissipated, each an energy per area of the surface.

The work is the integral of the mean pressure over the depth, and of the mean tangential stress over the way
along the surface, and owes nothing to the modes that know what is
stored and what is dissipated. What the balance lacks is an error of the integration in time: of second order
in dt with the exponential scheme and of first with backward Euler.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from gfmdlayer.resumable import State


class Energy(Protocol):
    """An integrator that knows the energy of its modes."""

    @property
    def stored(self) -> float:
        """Elastic energy per area after the last step."""
        ...

    @property
    def dissipated(self) -> float:
        """Energy per area that became heat since the beginning."""
        ...


class EnergyBalance:
    """The balance, entered step by step."""

    def __init__(self) -> None:
        self._work = 0.0
        self._past: deque[tuple[float, float]] = deque(maxlen=2)  # depths and pressures
        self._way: deque[tuple[float, float]] = deque(maxlen=2)  # positions and tangential stresses

    def entry(
        self, pressure: float, depth: float, energy: Energy, resistance: Mapping[str, float] | None = None
    ) -> dict[str, float]:
        """Enter an accepted step, which `energy` has been carried over; return the columns of its row.

        Of a punch that moves along the surface, `resistance` has position and tangential_force.

        A punch that is pressed in at once, in the first step, does the work that is there after it: without
        friction the energy of an elastic contact does not depend on the way to it.
        """
        way = (resistance["position"], resistance["tangential_force"]) if resistance else (0.0, 0.0)
        if not self._past:
            self._work = energy.stored + energy.dissipated
        else:
            self._work += _area(*self._past, (depth, pressure)) + _area(*self._way, way)
        self._past.append((depth, pressure))
        self._way.append(way)
        return {
            "work": self._work,
            "stored": energy.stored,
            "dissipated": energy.dissipated,
            "energy_residual": self._work - energy.stored - energy.dissipated,
        }

    def state(self) -> State:
        """Return the work, and the last two points of each curve under which it is the area."""
        return {"work": self._work, "past": np.reshape([*self._past, *self._way], (2, -1, 2))}

    def restore(self, state: State) -> None:
        """Go on from there."""
        self._work = float(state["work"])
        for curve, points in zip((self._past, self._way), state["past"].tolist(), strict=True):
            curve.extend((x, y) for x, y in points)


def _area(*points: tuple[float, float]) -> float:
    """Area under a curve (x, y) between the last two points, by a parabola if the third goes the same way."""
    *earlier, (x0, y0), (x1, y1) = points
    width, slope = x1 - x0, 0.0
    area = width * (y0 + y1) / 2
    for x, y in earlier:
        if (x0 - x) * width > 0:
            slope = ((y1 - y0) / width - (y0 - y) / (x0 - x)) / (x1 - x)
    return area - slope * width**3 / 6
