"""Energy balance: work of the punch = stored + dissipated + interface, each per area of the surface.

The work is the integral of the mean pressure over the depth, plus that of the mean tangential stress over the
position of a punch that moves along the surface. It does not use the modes, from which stored and dissipated
energy follow; the energy of the interface is the mean of its law over the gap, zero for the hard wall. The
residual of the balance is an error of the time integration: of second order in dt with the
exponential scheme and of first order with backward Euler.

A punch that is pressed in at once, in the first step, has done the work that is stored after it: without
friction at the interface the energy of an elastic contact does not depend on the path to it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts
from gfmdlayer.resumable import State

_UNITS = "pressure length"

Point = tuple[float, float]


class EnergyBalance(Observable):
    """Work, stored and dissipated energy, and what the balance lacks."""

    COLUMNS = (
        Column("work", "work done by the punch per area", _UNITS),
        Column("stored", "elastic energy stored per area", _UNITS),
        Column("dissipated", "energy dissipated per area", _UNITS),
        Column("energy_residual", "work - stored - dissipated - energy of the interface, per area", _UNITS),
    )

    def __init__(self, case: Parts) -> None:
        self._work, self._sums = 0.0, case.grid.sums
        self._normal: deque[Point] = deque(maxlen=2)  # depths and mean pressures
        self._tangential: deque[Point] = deque(maxlen=2)  # positions and tangential stresses

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Return the balance; position and tangential force are read from the row, if it has them."""
        stored, dissipated = step.energy.stored, step.energy.dissipated
        interface = step.problem.interface
        attraction = self._sums.mean(interface.energy(step.solution.gap)) if interface.attracts else 0.0
        normal = step.surface.depth, step.solution.mean_pressure
        tangential = float(step.row.get("position", 0.0)), float(step.row.get("tangential_force", 0.0))
        if self._normal:
            self._work += _area(*self._normal, normal) + _area(*self._tangential, tangential)
        else:
            self._work = stored + dissipated + attraction
        self._normal.append(normal)
        self._tangential.append(tangential)
        return {
            "work": self._work,
            "stored": stored,
            "dissipated": dissipated,
            "energy_residual": self._work - stored - dissipated - attraction,
        }

    def state(self) -> State:
        """Return the work, and the last two points of both curves."""
        curves = {"normal": list(self._normal), "tangential": list(self._tangential)}
        return {"work": self._work, **curves}

    def restore(self, state: State) -> None:
        """Continue from the work and the points of another run."""
        self._work = float(state["work"])
        self._normal.extend((x, y) for x, y in state["normal"].tolist())
        self._tangential.extend((x, y) for x, y in state["tangential"].tolist())


def _area(*points: Point) -> float:
    """Area under y(x) between the last two points, by a parabola if the third lies in the same direction."""
    *earlier, (x0, y0), (x1, y1) = points
    width, slope = x1 - x0, 0.0
    area = width * (y0 + y1) / 2
    for x, y in earlier:
        if (x0 - x) * width > 0:
            slope = ((y1 - y0) / width - (y0 - y) / (x0 - x)) / (x1 - x)
    return area - slope * width**3 / 6
