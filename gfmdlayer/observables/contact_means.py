"""Time, contact area, mean pressure, force and depth of the punch, and the residual of the problem."""

from __future__ import annotations

import math
from collections.abc import Mapping

from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts

TIME = Column("time", "time", "time", origin="from the beginning of the run")
AREA = Column("contact_area", "relative contact area atilde, contact points / all points",
              symbol=r"\tilde{a}", origin="over the cell")  # fmt: skip
PRESSURE = Column("mean_pressure", "mean contact pressure ptilde = pbar / (2 G0)", symbol=r"\tilde{p}",
                  origin="mean over the whole cell; G0 of the uppermost layer")  # fmt: skip
DEPTH = Column("depth", "indentation depth of the punch", "length",
               origin="from the height at which the punch touches the surface at rest")  # fmt: skip
RESIDUAL = Column("residual", "residual of the contact problem when the step was accepted",
                  origin="relative to the largest pressure and the depth")  # fmt: skip


class ContactMeans(Observable):
    """Time, contact area, mean pressure in units of twice the relaxed modulus, depth, and residual."""

    COLUMNS = (
        TIME,
        AREA,
        PRESSURE,
        DEPTH,
        RESIDUAL,
    )

    def __init__(self, case: Parts) -> None:
        self._unit = 2 * case.config.surface.material.unit

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Return the columns of the solution."""
        return {
            "time": step.time,
            "contact_area": step.solution.contact_area,
            "mean_pressure": step.solution.mean_pressure / self._unit,
            "depth": step.surface.depth,
            "residual": step.solution.residual,
        }


class Force(Observable):
    """Mean pressure over the cell, and the force over the cell: of a line contact, per length of the line."""

    COLUMNS = (
        Column("mean_stress", "mean contact pressure pbar", "pressure", origin="mean over the whole cell"),
        Column(
            "force",
            "force on the punch over the cell",
            "force",
            origin="mean_stress times the area of the cell; of a line, its period",
        ),
    )

    def __init__(self, case: Parts) -> None:
        self._cell = math.prod(case.grid.period)

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Return pbar, and pbar times the area of the cell or its length."""
        mean = step.solution.mean_pressure
        return {"mean_stress": mean, "force": mean * self._cell}
