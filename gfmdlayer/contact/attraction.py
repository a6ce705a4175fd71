"""Contact under an interface law, by any solver of the hard wall.

The energy of an interface that attracts is concave in the gap wherever its curvature is negative, so its
tangent at the last gap g_k lies above it. Minimising the elastic energy plus that tangent is a hard-wall
problem with the traction tau(g_k) added to the stress,

    f = IFFT(-kappa FFT(u) + b) + tau(g_k),        u <= h,

and its solution has no larger energy than the last state (majorisation: Lange, MM Optimization Algorithms,
SIAM 2016, ch. 4). At a fixed point the pressure of the wall is p_c = p + tau(g). The iteration stops on the
residual of p_c (`residual`), as every solver does.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.problem import Problem, Solution, Solver, make_solution
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.interface.law import HARD_WALL
from gfmdlayer.resumable import State


class AttractionSolver:
    """Solves problems whose interface attracts by a solver for the hard wall.

    Parameters
    ----------
    solver : Solver
        To `SHARE` of the tolerance.
    transforms : Transforms
        Of the grid.
    tolerance : float
        On the residual, with the traction of the interface.
    max_iterations : int
        Hard-wall problems after which the step counts as not converged.
    """

    SHARE: ClassVar[float] = 0.3  # of the tolerance is left to a hard-wall problem

    def __init__(self, solver: Solver, transforms: Transforms, tolerance: float, max_iterations: int) -> None:
        self.starts_from = solver.starts_from
        self._solver, self._transforms = solver, transforms
        self._tolerance, self._most = tolerance, max_iterations
        self._gap: FloatArray | None = None

    def solve(self, problem: Problem, start: FloatArray) -> Solution:
        """Solve from the gap of the last step, and a first guess of the field that the solver starts from."""
        if not problem.interface.attracts:
            return self._solver.solve(problem, start)
        wall, transforms, iterations = replace(problem, interface=HARD_WALL), 0, 0
        gap = np.full(start.size, np.inf) if self._gap is None else self._gap
        for _ in range(self._most):
            traction = problem.interface.traction(gap)
            # The mean of the traction belongs to the load, and to what holds the mean displacement.
            mean = float(traction.mean()) if problem.stiffness[0] == 0 else 0.0
            intercept = problem.intercept + self._transforms.forward(traction - mean)
            load = None if problem.mean_pressure is None else problem.mean_pressure + mean
            found = self._solver.solve(replace(wall, intercept=intercept, mean_pressure=load), start)
            gap, start = found.gap, getattr(found, self.starts_from)
            transforms, iterations = transforms + found.transforms + 1, iterations + found.iterations
            solution = make_solution(
                problem,
                found.displacement,
                found.pressure - traction,
                found.spectrum,
                spent=(transforms, iterations),
                within=self._tolerance if found.converged else -1.0,
                gap=gap,
            )
            if solution.converged:
                self._gap = gap
                break
            if not found.converged:
                break
        return solution

    def state(self) -> State:
        """Return the gap of the last step, and the state of the solver."""
        gap = {} if self._gap is None else {"gap": self._gap}
        return {**gap, **{f"solver.{name}": value for name, value in self._solver.state().items()}}

    def restore(self, state: State) -> None:
        """Continue from a state."""
        self._gap = state.get("gap")
        own = {name: value for name, value in state.items() if name.startswith("solver.")}
        self._solver.restore({name.removeprefix("solver."): value for name, value in own.items()})
