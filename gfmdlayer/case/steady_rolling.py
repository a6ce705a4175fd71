"""The contact with friction in its steady state, found at once."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.case.frictional import FrictionContact
from gfmdlayer.friction.problem import FrictionProblem, FrictionSolution
from gfmdlayer.step import Instant, Step


class SteadyRolling(FrictionContact):
    """Punch and surface in the state which a step carries over into itself.

    The state of marching: with fields that repeat themselves, the history of the body is a factor on each
    wave (`TractionModes.settled`), and slip is s = u(x) - u(x + V dt) - D, linear in the tractions. So the
    contact problem is that of a step, with this response. The run is one step, in which all
    quantities that add up over time have their values of this step.
    """

    def advance(self, step: Step) -> None:
        """Begin and end the step in the state."""
        self.history.settle(step.fields["waves"])
        self.motion.tractions = step.solution.tractions
        super().advance(step)

    def _problem(self, instant: Instant) -> FrictionProblem:
        """Return the contact problem of the state."""
        way = self._way(instant)
        response = self.history.settled(self.drives.elapsed(instant), way)
        turned = np.zeros((len(self.grid.points), math.prod(self.grid.shape))) + self._turned(way)
        return self._of_drives(response, instant.time, way, before=turned, way=way)

    def _one_solution(
        self, problem: FrictionProblem, start: FloatArray | None, time: float
    ) -> FrictionSolution:
        """Solve with a given bound of the shear traction; Ended where the force exceeds it."""
        solution = super()._one_solution(problem, start, time)
        return replace(solution, displacement=self._fields(self.history.seen(self._waves(solution))))

    def _waves(self, solution: FrictionSolution) -> ComplexArray:
        """Return the displacements of the waves under the tractions of a solution."""
        return self.history.under_settled(self._spectra(solution.loads))

    def _way(self, instant: Instant) -> float:
        """Return the way of the contact along x in the step."""
        assert self.drives.velocity is not None
        return self.drives.velocity(instant.time) * instant.step
