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

Termination: changes of the set are counted. After `ROUNDS` of them, or where conjugate gradients fail, the
problem goes to `bounded.safeguard`, where each step lowers the energy, and which ends on every
convex problem.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from math import prod
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.active_set.loop import (
    ContactSet,
    LoopArrays,
    begin,
    iterate,
    make_contact,
    make_work,
    set_guess,
)
from gfmdlayer.contact.active_set.windows import (
    WholeSurface,
    WindowResult,
    WindowsOfSurface,
    make_kernel,
    make_windows,
    solve_in_windows,
)
from gfmdlayer.contact.bounded import safeguard
from gfmdlayer.contact.pressure_form import (
    AIM,
    CLOSE,
    FLAT,
    Iterate,
    SurfaceState,
    System,
    compile_failure,
    feasible_solution,
    has_room,
    is_clear,
    trivial_solution,
    unconverged,
    write_state,
)
from gfmdlayer.contact.problem import Problem, Solution, make_solution
from gfmdlayer.contact.residual import ResidualFloor, assess, residual_scales
from gfmdlayer.grid.transforms import Plans, Transforms
from gfmdlayer.kernels import address_of, by_address, kernel, record_type
from gfmdlayer.resumable import State

ROUNDS = 100  # a stiff film on a soft base takes some fifty, cycles are rare
_LIMIT = 1000  # iterations of conjugate gradients
# Between two looks at signals: points times iterations of conjugate gradients, and these at least, since the
# next portion begins without the directions of the last.
WORK, FEWEST = 1 << 29, 30


KNOWN = record_type(
    [
        ("stiffness", np.bool_),  # whether there is one
        ("load_given", np.bool_),
        ("half_pair", np.float64),  # of a transform that is counted with the next step
    ]
)


class SolverCalls(NamedTuple):
    """Addresses of kernels."""

    begin: int
    iterate: int
    in_windows: int
    write_state: int
    scales: int
    assess: int


# Kernels with sums are called as they are from Python: a part of another one may have other bits.
_begin, _iterate, _in_windows, _write_state, residual_scales_at, assess_at = (
    by_address(called) for called in (begin, iterate, solve_in_windows, write_state, residual_scales, assess)
)


class SolverArrays(NamedTuple):
    """The arrays of the solver of one run."""

    plans: Plans
    stiffness: FloatArray  # of the last step
    compliance: FloatArray  # per point, as in `System`
    shared: FloatArray  # the stiffness per point
    gap0: FloatArray
    free: ComplexArray  # transform of the surface without pressure, per point
    at: Iterate
    contact: ContactSet
    work: LoopArrays
    windows: WindowsOfSurface
    known: npt.NDArray[Any]  # one record of `KNOWN`
    calls: SolverCalls


@kernel(borrows=True)
def set_stiffness(arrays: SolverArrays, stiffness: FloatArray, load_given: bool) -> None:
    """Take over the stiffness of a step; compliance and windows are made anew only where it has changed."""
    known, size = arrays.known[0], arrays.at.p.size
    same = known.stiffness and known.load_given == load_given
    if same:
        for k in range(stiffness.size):
            same = same and stiffness[k] == arrays.stiffness[k]
    if same:
        return
    known.stiffness, known.load_given = True, load_given
    arrays.windows.known[0].kernel, arrays.windows.known[0].windows = False, 0
    for k in range(stiffness.size):
        arrays.stiffness[k] = stiffness[k]
        arrays.compliance[k] = 1.0 / (size * stiffness[k]) if stiffness[k] != 0.0 else 0.0
        arrays.shared[k] = stiffness[k] / size


class StepResult(NamedTuple):
    """A step that is solved, or left to `ActiveSet.solve`."""

    solved: bool
    pairs: int  # of transforms
    iterations: int
    assessment: tuple[float, float, float, float]  # of `assess`


_LEFT = np.nan, 0.0, 0.0, 0.0  # assessment of a step that is left


@kernel(inner=True, borrows=True)
def solve_step(
    arrays: SolverArrays,
    stiffness: FloatArray,
    surface: WholeSurface,
    floor: ResidualFloor,
    load_given: bool,
    load: float,
    height: float,
    start: FloatArray,
    tolerance: float,
    limit: int,
    state: SurfaceState,
) -> StepResult:
    """`ActiveSet.solve` for compiled loops; leaves rare problems: windows and counts are then as before."""
    if _is_rare(stiffness, surface.h, floor, load_given, load, height):
        return StepResult(False, 0, 0, _LEFT)
    set_stiffness(arrays, stiffness, load_given)
    known, windows, left = arrays.known[0], arrays.windows.known[0], min(_LIMIT, limit)
    kernel_before, windows_before = windows.kernel, windows.windows
    near = _in_windows(
        arrays.calls.in_windows,
        (arrays.windows, surface, arrays.shared, floor, load_given, load, start, tolerance, ROUNDS, left,
         state),
    )  # fmt: skip
    transforms, iterations, assessment, solved = (
        near.transforms,
        near.iterations,
        near.assessment,
        near.within,
    )
    if not solved:
        system = System(
            arrays.compliance, arrays.shared, arrays.gap0, surface.h, floor, load_given, arrays.compliance[0]
        )
        at, contact, work = arrays.at, arrays.contact, arrays.work
        guess = arrays.windows.trial if near.guess_known else start
        begun = arrays.plans, system, surface.b, arrays.free, at, contact, work, guess, load
        _begin(arrays.calls.begin, begun)
        transforms += 1.0
        shift, within, left = 0.0, CLOSE * tolerance, max(left - iterations, 1)
        for _ in range(2):
            settled, more, done = _iterate(
                arrays.calls.iterate,
                (arrays.plans, system, at, contact, work, shift, within, ROUNDS, left, False),
            )
            transforms, iterations = transforms + more, iterations + done
            if not settled:
                break
            written = system, at, arrays.free, state.u, state.p, state.spectrum
            overlap = _write_state(arrays.calls.write_state, written)
            for i in range(state.gap.size):
                state.gap[i] = surface.h[i] - state.u[i]
            depth = residual_scales_at(arrays.calls.scales, (state.p, state.u, floor))[1]
            assessment = assess_at(arrays.calls.assess, (state.p, state.u, surface.h, floor))
            solved = is_clear(overlap, depth, floor) and assessment[0] <= tolerance
            left = min(_LIMIT, limit - iterations)
            if solved or left <= 0:
                break
            within = AIM * tolerance
            shift = within * depth
    if not solved:
        windows.kernel, windows.windows = kernel_before, windows_before
        return StepResult(False, 0, 0, _LEFT)
    pairs = math.floor((transforms + known.half_pair) / 2.0)
    known.half_pair = transforms + known.half_pair - 2.0 * pairs
    return StepResult(True, int(pairs), iterations, assessment)


@kernel(inner=True, borrows=True)
def _is_rare(
    stiffness: FloatArray, h: FloatArray, floor: ResidualFloor, load_given: bool, load: float, height: float
) -> bool:
    """Whether a problem may have one of the `trivial_solution`s."""
    if load_given:
        return load == 0.0 or height * floor.stiffness < FLAT * load
    return stiffness[0] == 0.0 and not has_room(h)


class ActiveSet:
    """The active-set solver for the steps of one run."""

    starts_from: ClassVar[Literal["displacement", "pressure"]] = "pressure"

    def __init__(self, transforms: Transforms, *, windows: bool = True, rounds: int = ROUNDS) -> None:
        # With `windows`, small contacts are solved in windows; after `rounds` changes of the contact set
        # `bounded.safeguard` takes over.
        self._transforms, self.rounds = transforms, rounds
        self.arrays, self._kept = make_arrays(transforms, windows=windows)

    def solve(
        self, problem: Problem, start: FloatArray, tolerance: float = 1e-6, limit: int = 20_000
    ) -> Solution:
        """Solve from a first guess of the pressure, one value a point."""
        if trivial := trivial_solution(problem, self._transforms):
            return trivial
        system, left, arrays = self._system_of(problem), min(_LIMIT, limit), self.arrays
        u, p, gap = np.empty((3, start.size))
        state = SurfaceState(u, p, gap, np.empty_like(problem.intercept))
        near = self._in_windows(problem, system, start, tolerance, left, state)
        half_pair = arrays.known["half_pair"]
        if near.within:
            pairs, half_pair[0] = divmod(near.transforms + half_pair[0], 2)
            return make_solution(
                problem, state.u, state.p, state.spectrum, gap=state.gap,
                spent=(int(pairs), near.iterations), within=tolerance, assessment=near.assessment,
            )  # fmt: skip
        guess = arrays.windows.trial if near.guess_known else start
        begin(
            arrays.plans, system, problem.intercept, arrays.free, arrays.at, arrays.contact, arrays.work,
            guess, problem.applied_pressure,
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
            pairs, half = divmod(transforms + half_pair[0], 2)
            solution = feasible_solution(
                problem,
                system,
                arrays.free,
                arrays.at,
                tolerance,
                transforms=int(pairs),
                iterations=iterations,
            )
            if solution.converged:
                half_pair[0] = half
                return solution
            within, left = AIM * tolerance, min(_LIMIT, limit - iterations)
            shift = within * residual_scales(solution.pressure, solution.displacement, system.floor)[1]
            if left <= 0:
                break
        return unconverged(problem, system, arrays.at, self._transforms, solution)

    def _in_windows(
        self,
        problem: Problem,
        system: System,
        start: FloatArray,
        tolerance: float,
        limit: int,
        state: SurfaceState,
    ) -> WindowResult:
        """Solve in windows, if there are any for the contact."""
        arrays = self.arrays
        surface = WholeSurface(
            arrays.plans, arrays.compliance, problem.obstacle, problem.intercept, arrays.work.spectrum,
            arrays.work.z,
        )  # fmt: skip
        result: WindowResult = solve_in_windows(
            arrays.windows, surface, arrays.shared, system.floor, system.load_given, problem.applied_pressure,
            start, tolerance, self.rounds, limit, state,
        )  # fmt: skip
        return result

    def state(self) -> State:
        """Return the stiffness whose kernel is known, and the count of half a pair."""
        known = self.arrays.known[0]
        if not known["stiffness"]:
            return {}
        return {
            "stiffness": self.arrays.stiffness,
            "load_given": known["load_given"],
            "kernel": self.arrays.windows.known["kernel"][0],
            "half_pair": known["half_pair"],
        }

    def restore(self, state: State) -> None:
        """Continue from a state."""
        if "stiffness" not in state:
            return
        arrays = self.arrays
        arrays.known["half_pair"] = state["half_pair"]
        set_stiffness(arrays, np.ascontiguousarray(state["stiffness"]), bool(state["load_given"]))
        if state["kernel"]:
            make_kernel(arrays.windows, arrays.plans, arrays.compliance, arrays.work.spectrum)

    def compile(self) -> None:
        """Compile the kernels of the whole surface and of failed solves, rare in ordinary steps."""
        arrays = self.arrays
        at, free = arrays.at, arrays.free
        system = compile_failure(at, self._transforms)
        begin(arrays.plans, system, free, free, at, arrays.contact, arrays.work, at.gap, 0.0)
        self._iterate(system, 0.0, 0.0, 1)

    def _iterate(self, system: System, shift: float, within: float, limit: int) -> tuple[bool, int, int]:
        """`iterate` in portions, between which a signal is noticed."""
        arrays = self.arrays
        portion_size, transforms, iterations = max(WORK // self.arrays.at.p.size, FEWEST), 0, 0
        while True:
            portion = min(portion_size, limit - iterations)
            solved, more, done = iterate(
                arrays.plans, system, arrays.at, arrays.contact, arrays.work, shift, within, self.rounds,
                portion, False,
            )  # fmt: skip
            transforms, iterations = transforms + more, iterations + done
            if solved or done + 1 < portion or limit - iterations <= 1:
                return solved, transforms, iterations

    def _save(
        self, system: System, problem: Problem, shift: float, within: float, limit: int
    ) -> tuple[int, int]:
        """Leave the problem to `safeguard`; return the transforms and iterations that it takes."""
        at = self.arrays.at
        _, transforms, done = safeguard(self._transforms, system, problem, at, shift, within, limit)
        set_guess(system, at, self.arrays.contact, at.p, problem.applied_pressure)
        self.arrays.work.now["exact"] = False  # the safeguard does not keep the mean from which depths count
        return transforms, done

    def _system_of(self, problem: Problem) -> System:
        """The problem in pressures."""
        arrays, load_given = self.arrays, problem.mean_pressure is not None
        set_stiffness(arrays, problem.stiffness, load_given)
        mean = float(arrays.compliance[0])
        return System(
            arrays.compliance, arrays.shared, arrays.gap0, problem.obstacle, problem.residual_floor,
            load_given, mean,
        )  # fmt: skip


def make_arrays(transforms: Transforms, *, windows: bool = True) -> tuple[SolverArrays, Sequence[Transforms]]:
    """Return the arrays of a solver, with `windows` or without, and the transforms to keep with them."""
    reserve = transforms.reserved(8, 3)
    field, spectrum = reserve.empty_field, reserve.empty_spectrum
    modes, none = prod(transforms.spectral_shape), np.zeros(0)
    at, contact = Iterate(field(), field(), spectrum()), make_contact(transforms.shape)
    work, plans, free = make_work(reserve), transforms.plans, spectrum()
    # Arguments by whose types kernels are compiled.
    floor, state = ResidualFloor(1.0, 0.0), SurfaceState(none, none, none, at.spectrum)
    system = System(none, none, none, none, floor, False, 0.0)
    iterate_at = address_of(iterate, plans, system, at, contact, work, 0.0, 0.0, 0, 0, False)
    of_surface, kept = make_windows(transforms, iterate_at, used=windows)
    surface = WholeSurface(plans, none, none, free, at.spectrum, none)
    calls = SolverCalls(
        address_of(begin, plans, system, free, free, at, contact, work, none, 0.0),
        iterate_at,
        address_of(solve_in_windows, of_surface, surface, none, floor, False, 0.0, none, 0.0, 0, 0, state),
        address_of(write_state, system, at, free, none, none, free),
        address_of(residual_scales, none, none, floor),
        address_of(assess, none, none, none, floor),
    )
    arrays = SolverArrays(
        plans=plans,
        stiffness=np.zeros(modes),
        compliance=np.zeros(modes),
        shared=np.zeros(modes),
        gap0=field(),
        free=free,
        at=at,
        contact=contact,
        work=work,
        windows=of_surface,
        known=np.zeros(1, dtype=KNOWN),
        calls=calls,
    )
    return arrays, (transforms, *kept)
