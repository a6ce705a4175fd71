"""Primal-dual active set with preconditioned conjugate gradients on the contact points.

In pressures the problem of `problem` reads p >= 0, gap = gap0 + A p >= 0, p gap = 0, with the compliance A =
1/kappa mode by mode and gap0 the gap of the surface without pressure. (A is 0 at q = 0 where the mean of u is
fixed; where the load is given the mean of p is fixed, and the gap is known up to a shift, the depth.) On a
given contact set C the pressure solves the linear system A_CC p = -gap0_C.

Inner
    Conjugate gradients on C, preconditioned by kappa restricted to C, nearly the inverse of A_CC: a few
    iterations of two FFT pairs each on any grid. They run conjugate to the pressure itself, whose scaling is
    what the preconditioner serves worst, and, as long as kappa stays the same, to the directions of the last
    steps.
Outer
    Points that pull leave C, points that overlap join it (Hintermueller, Ito and Kunisch, SIAM J. Optim. 13
    (2002) 865), the latter as soon as they show.
Start
    `prediction` extrapolates the pressure in time; C is where it is positive.

Pressure and displacement are at each moment an exact pair, so that p = 0 to rounding where there is no
contact, and the residual of an accepted state is the gap left open under the punch. That no point overlaps
costs no further solve: the smallest factor 1 + eta on the pressure, eta of the order of the tolerance, that
lifts the surface nowhere above the punch; or, where scaling the pressure does not do that, a gap of a quarter
of the tolerance that is aimed at.

Why it ends: changes of the set are counted. After `_ROUNDS` of them, or where conjugate gradients fail, the
problem is handed to `descent`, which decreases the energy monotonically and converges for every convex
problem.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
import pyfftw

from gfmdlayer.contact.active_set_loop import begin, begin_set, iterate, release
from gfmdlayer.contact.active_set_state import Bank, Iterate, System, Work
from gfmdlayer.contact.descent import descend
from gfmdlayer.contact.dual import accept, admit, known
from gfmdlayer.contact.grid import FloatArray
from gfmdlayer.contact.problem import Problem, Solution, extent
from gfmdlayer.contact.transforms import Transforms

_ROUNDS = 30
_LIMIT = 200  # iterations of conjugate gradients
_KEPT = 4  # directions kept from one step to the next


class ActiveSet:
    """The active-set solver for the steps of one run.

    Parameters
    ----------
    transforms : Transforms
        Plans for the grid's shape.
    tolerance : float
        Residual at which a step is accepted.
    max_iterations : int
        Iterations after which the step counts as not converged.
    """

    starts_from: ClassVar[Literal["displacement", "pressure"]] = "pressure"

    def __init__(self, transforms: Transforms, tolerance: float = 1e-6, max_iterations: int = 20_000) -> None:
        self._transforms = transforms
        self._tolerance = tolerance
        self._max_iterations = max_iterations
        self._stiffness: FloatArray | None = None
        field, spectrum = transforms.empty_field, transforms.empty_spectrum
        size, modes, rows = field().size, spectrum().size, 1 + 2 * _KEPT
        self._at = Iterate(
            p=field(),
            gap=field(),
            base=field(),
            spectrum=spectrum(),
            contact=np.zeros(size),
            points=np.zeros(size, dtype=np.int64),
            size=np.zeros(1, dtype=np.int64),
        )
        self._bank = Bank(
            direction=_rows(rows, size, np.float64),
            change=_rows(rows, size, np.float64),
            spectrum=_rows(rows, modes, np.complex128),
            age=np.zeros(rows, dtype=np.int64),
            deflating=np.zeros(rows, dtype=np.bool_),
            length=np.zeros(rows),
            gram=np.zeros((rows, rows)),
        )
        self._free, self._gap0 = spectrum(), field()
        self._work = Work(field(), spectrum(), np.zeros(rows), np.zeros(2), np.zeros(1))

    def solve(self, problem: Problem, start: FloatArray) -> Solution:
        """Solve from a first guess of the pressure; see `Solution` for what is returned.

        Raises
        ------
        ValueError
            If the punch displaces more than the cell holds (mean(h) < 0 for a body of fixed mean).
        """
        if trivial := known(problem, self._transforms):
            return trivial
        self._keep_directions(problem.stiffness)
        system = self._system(problem)
        self._begin(system, problem, start)
        plans, tolerance = self._transforms.plans, self._tolerance
        transforms, iterations, depth = 1, 0, 0.0
        for aim, within in ((0.0, 0.8 * tolerance), (0.25 * tolerance, 0.25 * tolerance)):
            shift, left = aim * depth, self._max_iterations - iterations
            found, more, done = iterate(
                plans, system, self._at, self._bank, self._work, shift, within, _ROUNDS, min(_LIMIT, left)
            )
            transforms, iterations = transforms + more, iterations + done
            if not found:
                _, done = descend(
                    plans, system, self._at, self._work.spectrum, self._longest_step(problem),
                    problem.applied_pressure, shift, within, self._max_iterations - iterations,
                )  # fmt: skip
                self._bank.length[:] = 0.0  # the pressure has come another way
                transforms, iterations = transforms + 2 * done, iterations + done
            begin_set(self._at, self._bank, self._work)
            solution = accept(problem, system, self._free, self._at, tolerance, transforms, iterations)
            if solution.converged:
                return solution
            _, depth = extent(solution.pressure, solution.displacement)
        return admit(problem, system, self._at, self._transforms, solution)

    @staticmethod
    def _longest_step(problem: Problem) -> float:
        """The smallest stiffness that A inverts."""
        return float(problem.stiffness[problem.stiffness > 0].min())

    def _keep_directions(self, stiffness: FloatArray) -> None:
        """Directions are worth keeping as long as the stiffness is the same."""
        if self._stiffness is not None and np.array_equal(stiffness, self._stiffness):
            return
        n = self._at.p.size
        self._bank.age[:] = 0
        self._stiffness = stiffness.copy()
        self._per_point = stiffness / n
        self._compliance = np.divide(1.0, stiffness * n, out=np.zeros_like(stiffness), where=stiffness != 0)

    def _system(self, problem: Problem) -> System:
        """The problem in pressures."""
        release(
            self._transforms.plans,
            self._compliance,
            problem.intercept,
            problem.obstacle,
            self._free,
            self._work.spectrum,
            self._gap0,
        )
        load = problem.mean_pressure is not None
        return System(self._compliance, self._per_point, self._gap0, problem.obstacle, problem.softest, load)

    def _begin(self, system: System, problem: Problem, start: FloatArray) -> None:
        if system.load:
            start = np.fmax(start, 0.0)
            if not start.any():
                start[np.argmin(system.gap0)] = 1.0
            start *= problem.applied_pressure / start.mean()
        begin(self._at, self._bank, start)


def _rows(count: int, length: int, kind: type) -> npt.NDArray[Any]:
    return np.asarray(pyfftw.zeros_aligned((count, -(-length // 8) * 8), kind, n=64))
