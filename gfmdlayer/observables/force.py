"""Mean stress and force of the contact, in the units of the configuration."""

from __future__ import annotations

import math
from collections.abc import Mapping

from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts


class Force(Observable):
    """Mean pressure over the cell, and the force over the cell: of a line contact, per length of the line."""

    COLUMNS = (
        Column("mean_stress", "mean contact pressure pbar", "pressure"),
        Column("force", "force on the punch over the cell", "force"),
    )

    def __init__(self, case: Parts) -> None:
        self._cell = math.prod(case.grid.period)

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Return pbar, and pbar times the area of the cell or its length."""
        mean = step.solution.mean_pressure
        return {"mean_stress": mean, "force": mean * self._cell}
