"""Primal-dual active set with preconditioned conjugate gradients on the contact points.

In pressures the problem of `problem` reads p >= 0, gap = gap0 + A p >= 0, p gap = 0, with the compliance A =
1/kappa mode by mode and gap0 the gap of the surface without pressure. (A is 0 at q = 0 where the mean of u is
fixed; where the load is given the mean of p is fixed, and the gap is known up to a rigid shift of the punch.)
On a given contact set C the pressure solves the linear system A_CC p = -gap0_C.

Inner
    Conjugate gradients on C, preconditioned by kappa restricted to C, nearly the inverse of A_CC: a few
    iterations of two FFT pairs each on any grid. They run conjugate to the pressure itself, whose scaling is
    what the preconditioner serves worst. Only the contact and its neighbourhood are touched; the gap
    elsewhere comes with the pair that closes the solve, and shows what else overlaps.
Outer
    Points under tension leave C, points that overlap join it (Hintermueller, Ito and Kunisch, SIAM J. Optim.
    13 (2002) 865), those near the contact as soon as they show.
Window
    Where the contact takes a small part of the surface, the step is solved in a window around it first; see
    `windows`. The whole surface follows where the window does not suffice.
Start
    `prediction` extrapolates the pressure in time; C is where it is positive.

Pressure and displacement are on return an exact pair, so that p = 0 to rounding out of contact, and the
residual of an accepted state is the gap left open under the punch. That no point overlaps costs no further
solve: the smallest factor 1 + eta on the pressure, eta of the order of the tolerance, lifts the surface
nowhere above the punch; or, where scaling the pressure does not do that, a gap of a quarter of the tolerance
is aimed at.

Termination: changes of the set are counted. After `_ROUNDS` of them, or where conjugate gradients fail, the
problem goes to `bounded.safeguard`, where each step lowers the energy, and which ends on every
convex problem.
"""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.active_set.loop import begin, iterate, make_contact, make_work, set_guess
from gfmdlayer.contact.active_set.windows import Windows
from gfmdlayer.contact.bounded import safeguard
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
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.contact.residual import ResidualFloor, residual_scales
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.resumable import State

_ROUNDS = 100  # a stiff film on a soft base takes some fifty, cycles are rare
_LIMIT = 1000  # iterations of conjugate gradients
# Between two looks at signals: points times iterations of conjugate gradients, and these at least, since the
# next portion begins without the directions of the last.
_WORK, _FEWEST = 1 << 29, 30


class ActiveSet:
    """The active-set solver for the steps of one run."""

    starts_from: ClassVar[Literal["displacement", "pressure"]] = "pressure"

    def __init__(self, transforms: Transforms, *, windows: bool = True, rounds: int = _ROUNDS) -> None:
        # With `windows`, small contacts are solved in windows; after `rounds` changes of the contact set
        # `bounded.safeguard` takes over.
        self._transforms, self._rounds = transforms, rounds
        field, spectrum = transforms.empty_field, transforms.empty_spectrum
        self._at, self._free, self._gap0 = Iterate(field(), field(), spectrum()), spectrum(), field()
        self._contact, self._work = make_contact(transforms.shape), make_work(transforms)
        self._windows = Windows(transforms, self._work, used=windows)
        self._stiffness: FloatArray | None = None
        self._half_pair = 0.0  # of a transform that is counted with the next step

    def solve(
        self, problem: Problem, start: FloatArray, tolerance: float = 1e-6, limit: int = 20_000
    ) -> Solution:
        """Solve from a first guess of the pressure, one value a point."""
        if trivial := trivial_solution(problem, self._transforms):
            return trivial
        system = self._system_of(problem)
        left = min(_LIMIT, limit)
        near = self._windows.solve(problem, start, tolerance, self._rounds, left)
        if near.within:
            pairs, self._half_pair = divmod(near.transforms + self._half_pair, 2)
            return near.solution(problem, tolerance, int(pairs))
        begin(
            self._transforms.plans, system, problem.intercept, self._free, self._at, self._contact,
            self._work, near.guess(start), problem.applied_pressure,
        )  # fmt: skip
        transforms, iterations = near.transforms + 1, near.iterations
        shift, within = 0.0, CLOSE * tolerance
        left = max(left - iterations, 1)
        for _ in range(2):
            solved, more, done = self._iterate(system, shift, within, left)
            transforms, iterations = transforms + more, iterations + done
            if not solved:
                more, done = self._save(system, problem, shift, within, limit - iterations)
                transforms, iterations = transforms + more, iterations + done
            pairs, half = divmod(transforms + self._half_pair, 2)
            solution = feasible_solution(
                problem, system, self._free, self._at, tolerance, transforms=int(pairs), iterations=iterations
            )
            if solution.converged:
                self._half_pair = half
                return solution
            within, left = AIM * tolerance, min(_LIMIT, limit - iterations)
            shift = within * residual_scales(solution.pressure, solution.displacement, system.floor)[1]
            if left <= 0:
                break
        return unconverged(problem, system, self._at, self._transforms, solution)

    def state(self) -> State:
        """Return the stiffness whose kernel is known, and the count of half a pair."""
        if self._stiffness is None:
            return {}
        return {
            "stiffness": self._stiffness,
            "floor": np.array(self._system.floor),
            "load_given": self._system.load_given,
            "kernel": self._windows.kernel_is_known,
            "half_pair": self._half_pair,
        }

    def restore(self, state: State) -> None:
        """Continue from a state."""
        if "stiffness" not in state:
            return
        self._half_pair = float(state["half_pair"])
        floor = ResidualFloor(*state["floor"].tolist())
        self._set_stiffness(state["stiffness"], floor, load_given=bool(state["load_given"]))
        if state["kernel"]:  # whose transform is counted already
            self._windows.make_kernel()

    def compile(self) -> None:
        """Compile the kernels of the whole surface and of failed solves, rare in ordinary steps."""
        plans, at = self._transforms.plans, self._at
        system = compile_failure(at, self._transforms)
        begin(plans, system, self._free, self._free, at, self._contact, self._work, at.gap, 0.0)
        self._iterate(system, 0.0, 0.0, 1)

    def _iterate(self, system: System, shift: float, within: float, limit: int) -> tuple[bool, int, int]:
        """`iterate` in portions, between which a signal is noticed."""
        portion_size, transforms, iterations = max(_WORK // self._at.p.size, _FEWEST), 0, 0
        while True:
            portion = min(portion_size, limit - iterations)
            solved, more, done = iterate(
                self._transforms.plans, system, self._at, self._contact, self._work, shift, within,
                self._rounds, portion, False,
            )  # fmt: skip
            transforms, iterations = transforms + more, iterations + done
            if solved or done + 1 < portion or limit - iterations <= 1:
                return solved, transforms, iterations

    def _save(
        self, system: System, problem: Problem, shift: float, within: float, limit: int
    ) -> tuple[int, int]:
        """Leave the problem to `safeguard`; return the transforms and iterations that it takes."""
        _, transforms, done = safeguard(self._transforms, system, problem, self._at, shift, within, limit)
        set_guess(system, self._at, self._contact, self._at.p, problem.applied_pressure)
        self._work.now["exact"] = False  # the safeguard does not keep the mean from which depths count
        return transforms, done

    def _system_of(self, problem: Problem) -> System:
        """The problem in pressures; stiffness and compliance are made anew only where they have changed."""
        load_given = problem.mean_pressure is not None
        same = (
            self._stiffness is not None
            and load_given == self._system.load_given
            and problem.least_depth == self._system.floor.depth
            and (problem.stiffness is self._stiffness or np.array_equal(problem.stiffness, self._stiffness))
        )
        if not same:
            self._set_stiffness(problem.stiffness, problem.residual_floor, load_given=load_given)
        self._stiffness = problem.stiffness
        return self._system._replace(h=problem.obstacle)

    def _set_stiffness(self, stiffness: FloatArray, floor: ResidualFloor, *, load_given: bool) -> None:
        self._stiffness = stiffness
        compliance, shared = per_point(stiffness, self._at.p.size)
        mean = float(compliance[0])
        self._system = System(compliance, shared, self._gap0, self._gap0, floor, load_given, mean)
        self._windows.set_system(self._system)
