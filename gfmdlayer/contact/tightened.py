"""Contact solved as far as adaptive steps of a body need that is much stiffer glassy than relaxed.

What a solver leaves open in the displacement comes back in the stress of the next steps times the glassy over
the relaxed modulus. Above the tolerance of the steps it looks like curvature of u(t): steps are rejected, and
repeated shorter, for errors that no shorter step lowers. So each problem is solved to that tolerance over
the contrast of the moduli (`choice.finer`). Where rounding or its iterations do not let the solver get
there, the problem is solved to the given tolerance, from its state if that is within it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.problem import Problem, Solution, Solver
from gfmdlayer.resumable import CompositeState

_MOST = 1000  # iterations of a solve that may fail


def tightened(
    made: Callable[[float, int], Solver], tolerance: float, iterations: int, finer: float
) -> Solver:
    """Return a solver to the finer of two tolerances, where that is to be reached.

    Parameters
    ----------
    made : callable
        Makes a solver for a tolerance and a maximum of iterations.
    tolerance : float
        Residual at which a step is accepted.
    iterations : int
        After which it counts as not converged.
    finer : float
        Residual that is aimed at.
    """
    given = made(tolerance, iterations)
    return Tightened(made(finer, min(_MOST, iterations)), given, tolerance) if finer < tolerance else given


class Tightened(CompositeState):
    """Two solvers of the same kind, of which the second is for what the first leaves.

    Parameters
    ----------
    tight, given : Solver
        To the tolerance that the steps need, and to that of the configuration.
    tolerance : float
        The latter.
    """

    def __init__(self, tight: Solver, given: Solver, tolerance: float) -> None:
        super().__init__(tight=tight, given=given)
        self._tight, self._given, self._tolerance = tight, given, tolerance

    @property
    def starts_from(self) -> Literal["displacement", "pressure", "gap"]:
        """The field that a first guess is of."""
        return self._tight.starts_from

    def solve(self, problem: Problem, start: FloatArray) -> Solution:
        """Solve from a first guess."""
        tight = self._tight.solve(problem, start.copy())
        if tight.converged:
            return tight
        if tight.residual <= self._tolerance:  # the other one confirms that it keeps the constraints too
            start = getattr(tight, self.starts_from)
        given = self._given.solve(problem, start)
        pairs, iterations = tight.transforms + given.transforms, tight.iterations + given.iterations
        return replace(given, transforms=pairs, iterations=iterations)

    def compile(self) -> None:
        """Compile the kernels of the solvers, which are the same."""
        if hasattr(self._tight, "compile"):
            self._tight.compile()
