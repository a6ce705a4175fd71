"""Instabilities of an interface that attracts: when the surface jumped, at which depth, and the energy lost.

A jump leads from an equilibrium that ends to another one at the same position of the punch. The difference of
their energies, elastic and of the interface, does not appear in either: it has gone into waves and heat.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts
from gfmdlayer.resumable import State

if TYPE_CHECKING:
    from gfmdlayer.config import Config

# Instabilities that are listed with a case, those that lose the most; `lost` has all of them.
MOST_LISTED = 1000


class Instabilities(Observable):
    """Energy lost in instabilities so far, and a list of them in the attributes."""

    COLUMNS = (Column("lost", "energy lost in instabilities per area", "pressure length"),)

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns of a case whose interface attracts."""
        return cls.COLUMNS if config.interfaces else None

    def __init__(self, _case: Parts) -> None:
        self._lost, self._count = 0.0, 0
        self._found: list[tuple[float, float, float]] = []  # times, depths, energies
        self._begun = False

    @property
    def attributes(self) -> Mapping[str, Any]:  # type: ignore[override]
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
