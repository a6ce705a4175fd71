"""Contact area below the resolution of the grid, and whether the grid resolves the contact."""

from __future__ import annotations

from collections.abc import Mapping

from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts
from gfmdlayer.resumable import State

FEWEST = 30  # points of the largest contact below which a run is told to be coarse


class Resolution(Observable):
    """Contact area by edges between the points, and the largest number of points in contact.

    The latter is an attribute of the result file, `most_contact_points`.
    """

    COLUMNS = (
        Column(
            "contact_area_interpolated",
            "relative contact area, the edge located between the points",
            origin="over the cell; the edge from pressure and gap beside it",
        ),
    )

    def __init__(self, case: Parts) -> None:
        self._grid, self._most = case.grid, 0
        self.attributes = {"most_contact_points": 0}

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Return the area, and take note of the number of points."""
        from gfmdlayer.observables.contact_edges import interpolated_area
        from gfmdlayer.observables.distributions import in_contact

        solution, shape = step.solution, self._grid.shape
        touching = in_contact(step.problem, solution)
        pressure = step.problem.wall_pressure(solution.pressure, solution.gap)
        self._count(self._grid.ranks.total(int(touching.sum())))
        shaped = touching.reshape(shape), pressure.reshape(shape), solution.gap.reshape(shape)
        area = interpolated_area(*shaped, self._grid)
        return {"contact_area_interpolated": area}

    def state(self) -> State:
        """Return the largest number of points."""
        return {"most": self._most}

    def restore(self, state: State) -> None:
        """Continue from that of another run."""
        self._count(int(state["most"]))

    def _count(self, points: int) -> None:
        self._most = max(self._most, points)
        self.attributes = {"most_contact_points": self._most}
        few = 0 < self._most < FEWEST
        touching = f"{self._most} point{'s' * (self._most != 1)}"
        self.warning = f"COARSE: at most {touching} in contact; take more grid.points" if few else ""
