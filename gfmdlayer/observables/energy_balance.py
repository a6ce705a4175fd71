"""Energy balance: work = stored + dissipated + interface + lost, each per area of the surface.

The work is the integral of the mean pressure over the depth, plus that of the mean tangential stress over the
position of a punch that moves along the surface. It does not use the modes, from which stored and dissipated
energy follow; the energy of the interface is the mean of its law over the gap, zero for the hard wall. The
residual of the balance is an error of the time integration: of second order in dt with the
exponential scheme and of first order with backward Euler.

An instability leads from an equilibrium that ends to another one at the same position of the punch. The
difference of their energies, elastic and of the interface, has gone into waves and heat: it is lost.

A voltage that changes does work too. The energy of the interface is that of the field and of its source,
w(g, t) = -C(g) V(t)^2/2 per area (`interface.electrostatic`), and at a fixed gap it changes by -C V dV: a
rising voltage takes energy out of this balance, into the source. Over a step this is the mean of the change
of w at the gap before and at the gap after it; what is left of the change of w is then, to rounding, the mean
of its change at the law before and at the law after, which the traction does.

A load that has pulled the punch off does work on a punch that flies. It is not followed: what counts as work
is the change of the energies, there and where the punch comes back.

A punch that is pressed in at once, in the first step, has done the work that is stored after it: without
friction at the interface the energy of an elastic contact does not depend on the path to it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING

from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts
from gfmdlayer.resumable import State

if TYPE_CHECKING:
    from gfmdlayer.arrays import Attribute, FloatArray
    from gfmdlayer.config import Config

_UNITS, _SINCE = "pressure length", "from the beginning of the run"

# Instabilities that are listed with a case, those that lose the most; `lost` has all of them.
MOST_LISTED = 1000

Point = tuple[float, float]


class Instabilities(Observable):
    """Energy lost in instabilities so far, and a list of them in the attributes."""

    COLUMNS = (Column("lost", "energy lost in instabilities per area", _UNITS, origin=_SINCE),)

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns of a case whose interface attracts."""
        return cls.COLUMNS if config.interfaces else None

    def __init__(self, _case: Parts) -> None:
        self._lost, self._count = 0.0, 0
        self._found: list[tuple[float, float, float]] = []  # times, depths, energies
        self._begun = False

    @property
    def attributes(self) -> Mapping[str, Attribute]:  # type: ignore[override]
        """The instabilities: their number, and times, depths and energies in the order of time."""
        import numpy as np

        if not self._found:
            return {"instabilities": 0}
        time, depth, energy = np.array(self._found).reshape(-1, 3).T
        listed = {"time": time, "depth": depth, "energy": energy}
        return {"instabilities": self._count} | {f"instability_{name}": each for name, each in listed.items()}

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Add the energy that was released in a step; the first finds its equilibrium for nothing."""
        released = step.solution.released_energy if self._begun else 0.0
        self._begun = True
        if released > 0:
            self._lost, self._count = self._lost + released, self._count + 1
            self._found.append((step.time, step.surface.depth, released))
            if len(self._found) > MOST_LISTED:
                self._found.remove(min(self._found, key=lambda each: each[2]))
        return {"lost": self._lost}

    def state(self) -> State:
        """Return what was found."""
        return {"lost": self._lost, "count": self._count, "found": self._found, "begun": self._begun}

    def restore(self, state: State) -> None:
        """Continue with the instabilities of another run."""
        self._lost, self._count, self._begun = float(state["lost"]), int(state["count"]), bool(state["begun"])
        self._found = [
            (time, depth, energy) for time, depth, energy in state["found"].reshape(-1, 3).tolist()
        ]


class EnergyBalance(Observable):
    """Work, stored and dissipated energy, and what the balance lacks."""

    COLUMNS = (
        Column("work", "work done by the punch, and by a changing voltage, per area", _UNITS, origin=_SINCE),
        Column("stored", "elastic energy stored per area", _UNITS, origin="from the body at rest"),
        Column("dissipated", "energy dissipated per area", _UNITS, origin=_SINCE),
        Column(
            "energy_residual",
            "work - stored - dissipated - energy of the interface - lost in instabilities, per area",
            _UNITS,
            origin=_SINCE,
        ),
    )

    def __init__(self, case: Parts) -> None:
        self._work, self._sums = 0.0, case.grid.sums
        self._interface = case.interface
        self._torn, self._energies = False, 0.0  # whether a load has pulled the punch off; of the last row
        self._field: tuple[float, FloatArray] | None = None  # time and gap, where the interface changes
        self._normal: deque[Point] = deque(maxlen=2)  # depths and mean pressures
        self._tangential: deque[Point] = deque(maxlen=2)  # positions and tangential stresses

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Return the balance; position and tangential force are read from the row, if it has them."""
        stored, dissipated = step.energy.stored, step.energy.dissipated
        interface = step.problem.interface
        attraction = float(step.row.get("interface_energy", 0.0))
        if interface.attracts and "interface_energy" not in step.row:  # an interface beside the configuration
            attraction = self._sums.mean(interface.energy(step.solution.gap))
        normal = step.surface.depth, step.solution.mean_pressure
        tangential = float(step.row.get("position", 0.0)), float(step.row.get("tangential_force", 0.0))
        from gfmdlayer.interface.law import HARD_WALL  # columns are known without numpy

        torn = self._interface.attracts and interface is HARD_WALL
        if torn != self._torn:  # the punch was pulled off, or has come back: its flight is not followed
            self._work += stored + dissipated + attraction - self._energies
            self._normal.clear()
        elif self._normal:
            self._work += _area(*self._normal, normal) + _area(*self._tangential, tangential)
            if self._field is not None:
                self._work += self._work_of_the_field(*self._field, step)
        else:
            self._work = stored + dissipated + attraction
        self._torn, self._energies = torn, stored + dissipated + attraction
        if "lost" in step.row and step.solution.released_energy > 0:
            self._normal.clear()  # no parabola goes through a jump
        self._normal.append(normal)
        self._tangential.append(tangential)
        if self._interface.kinks:  # it depends on time
            self._field = step.time, step.solution.gap
        lost = float(step.row.get("lost", 0.0))
        return {
            "work": self._work,
            "stored": stored,
            "dissipated": dissipated,
            "energy_residual": self._work - stored - dissipated - attraction - lost,
        }

    def _work_of_the_field(self, time: float, before: FloatArray, step: AcceptedStep) -> float:
        """Change of the energy of the interface since a time that is due to the time alone."""
        law, last = step.problem.interface, self._interface.at(time)
        gaps = before, step.solution.gap
        return sum(self._sums.mean(law.energy(gap) - last.energy(gap)) for gap in gaps) / 2

    def state(self) -> State:
        """Return the work, and the last two points of both curves."""
        curves = {"normal": list(self._normal), "tangential": list(self._tangential)}
        field = {} if self._field is None else {"field_time": self._field[0], "field_gap": self._field[1]}
        flight = {"torn": True} if self._torn else {}
        return {"work": self._work, "energies": self._energies, **curves, **field, **flight}

    def restore(self, state: State) -> None:
        """Continue from the work and the points of another run."""
        self._work, self._energies = float(state["work"]), float(state.get("energies", 0.0))
        self._torn = "torn" in state
        self._normal.extend((x, y) for x, y in state["normal"].tolist())
        self._tangential.extend((x, y) for x, y in state["tangential"].tolist())
        if "field_time" in state:
            self._field = float(state["field_time"]), state["field_gap"]


def _area(*points: Point) -> float:
    """Area under y(x) between the last two points, by a parabola if the third lies in the same direction."""
    *earlier, (x0, y0), (x1, y1) = points
    width, slope = x1 - x0, 0.0
    area = width * (y0 + y1) / 2
    for x, y in earlier:
        if (x0 - x) * width > 0:
            slope = ((y1 - y0) / width - (y0 - y) / (x0 - x)) / (x1 - x)
    return area - slope * width**3 / 6
