"""Primal-dual active set with preconditioned conjugate gradients on the contact points.

In pressures the problem of `problem` reads p >= 0, gap = gap0 + A p >= 0, p gap = 0, with the compliance A =
1/kappa mode by mode and gap0 the gap of the surface without pressure. (A is 0 at q = 0 where the mean of u is
fixed; where the load is given the mean of p is fixed, and the gap is known up to a shift, the depth.) On a
given contact set C the pressure solves the linear system A_CC p = -gap0_C.

Inner
    Conjugate gradients on C, preconditioned by kappa restricted to C, nearly the inverse of A_CC: a few
    iterations of two FFT pairs each on any grid. They run conjugate to the pressure itself, whose scaling is
    what the preconditioner serves worst, and, as long as kappa stays the same, to the directions of the last
    steps. All of this touches the contact and its neighbourhood only; the gap elsewhere comes with the pair
    that closes the solve, and shows what else overlaps.
Outer
    Points that pull leave C, points that overlap join it (Hintermueller, Ito and Kunisch, SIAM J. Optim. 13
    (2002) 865), those near the contact as soon as they show; on a line the set moves to where the edges then
    are, see `edges`.
Window
    Where the contact takes a small part of the surface, the step is solved in a window around it first; see
    `windows`. What follows is then for what the window could not do.
Start
    `prediction` extrapolates the pressure in time; C is where it is positive. Where that is the contact set
    of the last step and kappa is the same, the solve goes on from the last pressure, whose gap is known, with
    the last increments among the directions: no extrapolation in their span is better, or cheaper.

Pressure and displacement are on return an exact pair, so that p = 0 to rounding where there is no contact,
and the residual of an accepted state is the gap left open under the punch. That no point overlaps costs no
further solve: the smallest factor 1 + eta on the pressure, eta of the order of the tolerance, that lifts the
surface nowhere above the punch; or, where scaling the pressure does not do that, a gap of a quarter of the
tolerance that is aimed at.

Why it ends: changes of the set are counted. After `_ROUNDS` of them, or where conjugate gradients fail, the
problem is handed to `safeguard`, whose last resort decreases the energy monotonically and converges for every
convex problem.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact import conjugate_gradient
from gfmdlayer.contact.active_set.descent import descend
from gfmdlayer.contact.active_set.loop import attempt, evaluate, iterate
from gfmdlayer.contact.active_set.safeguard import safeguard
from gfmdlayer.contact.active_set.start import begin
from gfmdlayer.contact.active_set.state import Past, make_bank, make_contact, make_work
from gfmdlayer.contact.active_set.windows import Windows
from gfmdlayer.contact.conjugate_gradient import make_search
from gfmdlayer.contact.pressure_form import (
    AIM,
    CLOSE,
    Iterate,
    System,
    compile_failure,
    feasible_solution,
    per_point,
    trivial_solution,
    unconverged,
)
from gfmdlayer.contact.problem import Problem, ResidualFloor, Solution, scales_of
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.resumable import State

_ROUNDS = 100  # a stiff film on a soft base takes some fifty, cycles are rare
_LIMIT = 1000  # iterations of conjugate gradients
# Between two looks at signals: points times iterations of conjugate gradients, and these at least, since what
# a portion leaves to the next is not all that it knew.
_WORK, _FEWEST = 1 << 29, 30


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
        self._least = ResidualFloor(0.0, 0.0)
        self._load = False
        field, spectrum = transforms.empty_field, transforms.empty_spectrum
        self._at = Iterate(field(), field(), spectrum())
        self._contact, self._bank = make_contact(transforms.shape), make_bank(self._at.p.size)
        self._free, self._gap0 = spectrum(), field()
        self._work = make_work(self._bank, field(), spectrum())
        self._windows = Windows(transforms, self._work)
        for array in (self._at.p, self._at.gap, self._gap0):
            array[:] = 0.0
        self._past = Past(field(), field(), np.ones(1), np.full(1, -1))
        self._state = (self._at, self._contact, self._bank, self._work)
        self._settled, self._odd = False, 0.0

    def solve(self, problem: Problem, start: FloatArray) -> Solution:
        """Solve from a first guess of the pressure; see `Solution` for what is returned.

        Raises
        ------
        ValueError
            If the punch displaces more than the cell holds (mean(h) < 0 for a body of fixed mean).
        """
        if trivial := trivial_solution(problem, self._transforms):
            return trivial
        keep, system = self._keep_directions(problem), self._system(problem)
        plans, tolerance, state = self._transforms.plans, self._tolerance, self._state
        limit = min(_LIMIT, self._max_iterations)
        near = self._windows.solve(problem, start, tolerance, _ROUNDS, limit)
        if near.within:
            self._settled = False
            pairs, self._odd = divmod(near.transforms + self._odd, 2)
            return near.solution(problem, tolerance, int(pairs))
        shift, within, clear, limit = 0.0, CLOSE * tolerance, False, max(limit - near.iterations, 1)
        portion = min(limit, self._portion)
        found, more, done = attempt(
            plans, system, problem.intercept, self._free, *state, self._past, near.guess(start),
            problem.applied_pressure, keep, within, _ROUNDS, portion,
        )  # fmt: skip
        transforms, iterations = near.transforms + more, near.iterations + done
        if not found and done + 1 == portion < limit:
            found, more, done = self._iterate(system, shift, within, limit - done)
            transforms, iterations = transforms + more, iterations + done
        while True:
            if not found:
                more, done = self._save(system, problem, shift, within, self._max_iterations - iterations)
                transforms, iterations = transforms + more, iterations + done
            pairs, odd = divmod(transforms + self._odd, 2)
            solution = feasible_solution(
                problem, system, self._free, self._at, tolerance, int(pairs), iterations
            )
            if solution.converged:
                self._settled, self._odd = found, odd
                return solution
            if clear:
                self._settled = False
                return unconverged(problem, system, self._at, self._transforms, solution)
            clear, within = True, AIM * tolerance
            shift = within * scales_of(solution.pressure, solution.displacement, problem.least)[1]
            limit = min(_LIMIT, self._max_iterations - iterations)
            self._work.exact[0] = found  # the safeguard does not keep the level from which depths count
            found, more, done = self._iterate(system, shift, within, limit)
            transforms, iterations = transforms + more, iterations + done

    def state(self) -> State:
        """Return the last pressure, contact and increment, and the directions with their stiffness."""
        if self._stiffness is None:
            return {}
        bank, kept = self._bank, self._bank.age > 0
        return {
            "stiffness": self._stiffness,
            "least": np.array(self._least),
            "load": self._load,
            "settled": self._settled,
            "odd": self._odd,
            "kernel": self._windows.kernel_is_known,
            "age": bank.age,
            "direction": bank.direction[kept, : self._at.p.size],
            "change": bank.change[kept, : self._at.p.size],
            **self._carried(),
        }

    def restore(self, state: State) -> None:
        """Go on from there."""
        if "stiffness" not in state:
            return
        self._load, self._settled, self._odd = (
            bool(state["load"]), bool(state["settled"]), float(state["odd"]),
        )  # fmt: skip
        self._take_stiffness(state["stiffness"], ResidualFloor(*state["least"].tolist()))
        if state["kernel"]:  # which the step that made it has paid for
            self._windows.make_kernel()
        bank, kept, size = self._bank, state["age"] > 0, self._at.p.size
        bank.age[:], bank.direction[kept, :size], bank.change[kept, :size] = (
            state[name] for name in ("age", "direction", "change")
        )
        for name, array in self._carried().items():
            array[:] = state[name]

    def compile(self) -> None:
        """Compile the kernels that only difficult problems come to, by calls that end at once.

        An ordinary solve compiles the others. The state is of no use afterwards.
        """
        at, plans = self._at, self._transforms.plans
        system = compile_failure(at, self._transforms)
        self._iterate(system, 0.0, 0.0, 0)
        conjugate_gradient.iterate(plans, system, at, make_search(self._transforms), 0.0, 0.0, 0)
        descend(plans, system, at, self._work.spectrum, 1.0, 0.0, 0.0, 0.0, 0)
        begin(at, self._contact, self._bank, at.p, False)
        evaluate(plans, system, at, self._work)

    def _carried(self) -> dict[str, npt.NDArray[Any]]:
        """Arrays that one step hands to the next, but for the directions."""
        contact, work = self._contact, {"scales": self._work.scales, "level": self._work.level}
        listed = {"member": contact.member, "runs": contact.runs, "near": contact.near}
        past = {f"past.{name}": array for name, array in self._past._asdict().items()}
        counts = {"counts": contact.counts, "gap0": self._gap0}
        return {**self._at._asdict(), **listed, **counts, **past, **work}

    @property
    def _portion(self) -> int:
        return max(_WORK // self._at.p.size, _FEWEST)

    def _iterate(self, system: System, shift: float, within: float, limit: int) -> tuple[bool, int, int]:
        """`iterate` in portions, between which a signal is noticed."""
        transforms = iterations = 0
        while True:
            portion = min(self._portion, limit - iterations)
            found, more, done = iterate(
                self._transforms.plans, system, *self._state, shift, within, _ROUNDS, portion
            )
            transforms, iterations = transforms + more, iterations + done
            if found or done + 1 < portion or limit - iterations <= 1:
                return found, transforms, iterations

    def _save(
        self, system: System, problem: Problem, shift: float, within: float, limit: int
    ) -> tuple[int, int]:
        """Leave the problem to `safeguard`; return the transforms and iterations that it takes."""
        found, transforms, done = safeguard(self._transforms, system, problem, self._at, shift, within, limit)
        if found:
            begin(self._at, self._contact, self._bank, self._at.p, False)
        else:  # the last step may have been taken back
            evaluate(self._transforms.plans, system, self._at, self._work)
        return transforms, done

    def _keep_directions(self, problem: Problem) -> bool:
        """Directions are worth keeping as long as the stiffness is the same; return whether it is.

        And as long as what is prescribed is: under a given load directions have no mean, and gaps a shift.
        """
        stiffness, load = problem.stiffness, problem.mean_pressure is not None
        alike = load == self._load and problem.least_depth == self._least.depth
        if alike and stiffness is self._stiffness:
            return self._settled
        self._load = load
        if alike and self._stiffness is not None and np.array_equal(stiffness, self._stiffness):
            self._stiffness = stiffness
            return self._settled
        self._bank.age[:], self._past.listed[0] = 0, -1
        self._take_stiffness(stiffness, problem.least)
        return False

    def _take_stiffness(self, stiffness: FloatArray, least: ResidualFloor) -> None:
        self._stiffness, self._least, n = stiffness, least, self._at.p.size
        self._compliance, self._per_point = per_point(stiffness, n)
        self._windows.renew(self._compliance, self._per_point, least, load=self._load)

    def _system(self, problem: Problem) -> System:
        """The problem in pressures."""
        load = problem.mean_pressure is not None
        compliance, yielding = self._compliance, float(self._compliance[0])
        return System(compliance, self._per_point, self._gap0, problem.obstacle, self._least, load, yielding)
