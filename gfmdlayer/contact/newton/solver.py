"""Newton's method for interfaces that attract, along the path that the surface takes.

The energy E(u) = elastic energy + sum of w(h - u) is to be least over u <= h. Where w is concave E has many
minima. The surface is in the one to which the state before leads:

branch
    A step begins with the last gap, at the new punch, history and load. Traction r_0 holds it there; the mean
    of u differs by m_0 from that prescribed. Both are taken away, (1 - s) r_0 and (1 - s) m_0 with s from 0
    to 1: of an elastic body this is the motion of the punch. Newton steps in which the traction differs
    little from its tangent follow the minimum (Davidenko's path), in most steps all the way at once. Points
    at the wall stay there.
descent
    Where the energy is not convex along the free points, or that path comes to a standstill, a branch ends.
    The punch stops (s is kept) and the surface descends overdamped, each point at a speed in proportion to
    the pressure p_c that is out of balance on it, eta du/dt = p_c with one eta for all points, and u <= h.
    Steps are linearly implicit (pseudo-transient continuation: Kelley and Keyes, SIAM J. Numer. Anal. 35
    (1998) 508), (K + w'' + c) d = p_c with c = eta/dt. c is chosen for the change of the traction, whose
    difference from the tangent is the error, and large enough that the matrix is positive and the energy
    falls; it vanishes as a minimum comes near, and Newton's method ends there. Then s grows again.

So a landing depends neither on the time step nor on a start or tolerance, so long as there is one instability
on the way of a step at most. `Solution.released_energy` is the energy that a descent with a concave stretch
has lost, at a fixed s: exact for the state from which it started, which lies past the end of the branch by a
part of the step, so that its error is of first order in the step. Elsewhere it is zero.

Linear systems are solved on the free points by conjugate gradients in single precision: what they correct is
evaluated in double. The preconditioner is 1/(K + c + kappa_1/2), scaled where the interface is stiffer than
the body (`passes.precondition`); an iteration takes two FFT pairs. A direction of negative curvature ends
them and begins a descent. Points that a step drives through the wall are put onto it; if that turns the step
uphill, a shorter one of the descent takes its place. In balance `lowest_mode` looks for a deformation of
negative curvature, which no symmetry hides.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.newton.loop import IN_SINGLE, NewtonFields, Progress, hold, is_lost, iterate
from gfmdlayer.contact.newton.lowest_mode import LowestMode, find_margin, leave
from gfmdlayer.contact.newton.passes import AdhesiveState, AdhesiveSystem, Step
from gfmdlayer.contact.pressure_form import trivial_solution
from gfmdlayer.contact.problem import Problem, Solution, make_solution, project
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.resumable import State

_CHUNK = 1 << 18  # points moved between two looks at signals, some 20 ms with the transforms of an iteration


class Newton:
    """Newton's method with truncated conjugate gradients, for the steps of one run."""

    starts_from: ClassVar[Literal["gap"]] = "gap"

    def __init__(self, transforms: Transforms) -> None:
        self._transforms = transforms
        self._mode = _any_deformation(transforms.size)
        self._margin, self._part = math.nan, 0.0  # of a pair that is counted with the next step

    @cached_property
    def _single(self) -> Transforms:
        """Transforms in single precision; from the wisdom of a run that is restored before its first step."""
        return self._transforms.of_shape(self._transforms.shape, single=True)

    @cached_property
    def _fields(self) -> NewtonFields:
        field, spectrum, small = self._transforms.empty_field, self._transforms.empty_spectrum, self._single
        at, to = (AdhesiveState(field(), field(), field(), field()) for _ in range(2))
        force, direction, applied, z, share, moves, stiffness = (small.empty_field() for _ in range(7))
        work = small.empty_spectrum()
        kappa, softening, point = (np.empty(size, np.float32) for size in (work.size, work.size, 1))
        step = Step(
            field(), field(), field(), spectrum(),
            force, direction, applied, z, share, point, moves, stiffness, kappa, softening, work,
        )  # fmt: skip
        return NewtonFields(at, to, field(), step, spectrum())

    @cached_property
    def _lowest(self) -> LowestMode:
        return LowestMode(*(self._single.empty_field() for _ in range(4)))

    def solve(
        self, problem: Problem, start: FloatArray, tolerance: float = 1e-6, limit: int = 20_000
    ) -> Solution:
        """Solve from the gap of the last step; infinite where there is none, and the surface at rest."""
        if trivial := trivial_solution(problem, self._transforms):
            return trivial
        system, fields = _system(problem), self._fields
        plans, single = self._transforms.plans, self._single.plans
        progress, u = self._begin(system, start), fields.at.u
        chunk, converged = max(4, _CHUNK // u.size), False
        self._lowest.x[:] = self._mode
        while not converged and progress.iterations < limit and not progress.pulled_off:
            before, most = progress.iterations, min(chunk, limit - progress.iterations)
            progress = iterate(plans, single, system, fields, progress, tolerance, most)
            within = progress.done == 1.0 and progress.residual <= tolerance
            if within and not math.isnan(progress.energy):
                progress, converged = self._check(system, progress, tolerance)
            elif not within and progress.iterations < before + most:
                break
        pairs, part = divmod(progress.pairs + self._part, 1.0)
        if converged:
            self._mode[:], self._part = self._lowest.x, part
        lost = is_lost(system, progress.drop, progress.unstable)
        released = progress.released + (progress.drop if lost else 0.0)
        solution = make_solution(
            problem,
            u.copy(),
            fields.at.stress + progress.multiplier,
            fields.spectrum.copy() if converged else self._transforms.forward(u),
            spent=(int(pairs), progress.iterations),
            within=np.inf if converged else -1.0,
        )
        return replace(solution, released_energy=released / u.size, margin=self._margin)

    def _check(self, system: AdhesiveSystem, progress: Progress, tolerance: float) -> tuple[Progress, bool]:
        """Leave a state in balance that is no minimum; return whether it is one."""
        fields, plans, lowest = self._fields, self._transforms.plans, self._lowest
        margin, curvature, attraction, turns = self._find_margin(system)
        self._margin, progress = margin, progress._replace(pairs=progress.pairs + IN_SINGLE * turns)
        # Near the end of a branch u is known to the root of the tolerance, and so is the curvature.
        if curvature >= -math.sqrt(2 * tolerance) * abs(attraction):
            return progress, True
        change, pairs = leave(plans, system, fields.at, fields.to, fields.step, lowest.x)
        return progress._replace(
            energy=math.nan,
            pairs=progress.pairs + pairs,
            iterations=progress.iterations + 1,
            descends=True,
            unstable=True,
            drop=progress.drop - change,
            damping=-2 * curvature,
        ), change == 0.0

    def _find_margin(self, system: AdhesiveSystem) -> tuple[float, float, float, int]:
        """Follow the lowest mode; begin anew where none of the points that it moved is free."""
        fields, lowest = self._fields, self._lowest
        given = self._single.plans, system, fields.at, fields.step, lowest
        found: tuple[float, float, float, int] = find_margin(*given)
        if lowest.x.any() or not fields.step.free.any():
            return found
        lowest.x[:] = _any_deformation(lowest.x.size)
        margin, curvature, attraction, pairs = find_margin(*given)
        return margin, curvature, attraction, found[-1] + pairs

    def compile(self) -> None:
        """Compile the kernel that only a balance that is no minimum comes to."""
        fields, size = self._fields, self._mode.size
        stiffness = np.ones(fields.spectrum.size)
        system = _system(Problem(stiffness, np.zeros_like(fields.spectrum), np.ones(size)))
        for array in (*fields.at, *fields.to, *fields.step, self._lowest.x):
            array[:] = 0.0
        leave(self._transforms.plans, system, fields.at, fields.to, fields.step, self._lowest.x)

    def state(self) -> State:
        """Return the lowest mode, and the count of a part of a pair."""
        return {"mode": self._mode, "part": self._part}

    def restore(self, state: State) -> None:
        """Continue from a state."""
        self._mode[:], self._part = state["mode"], float(state["part"])

    def _begin(self, system: AdhesiveSystem, start: FloatArray) -> Progress:
        """Set the surface where it begins; return where the path is."""
        fields, done, mean, energy = self._fields, 1.0, 0.0, math.nan
        u = fields.at.u
        np.subtract(system.h, start, out=u)
        fields.held[:] = 0.0
        if np.isfinite(u).all():
            done, mean = 0.0, float(u.mean()) if system.mean_is_fixed else 0.0
            energy = hold(self._transforms.plans, system, fields)
        else:
            u[:] = 0.0
            project(u, system.h, system.mean_is_fixed)
        return Progress(
            done, mean, damping=0.0, descends=False, unstable=False, drop=0.0, released=0.0, pulled_off=False,
            multiplier=0.0, residual=np.inf, energy=energy, pairs=float(done == 0.0), iterations=0,
        )  # fmt: skip


def _any_deformation(size: int) -> FloatArray:
    """One that no symmetry rules out; always the same."""
    return np.random.default_rng(0).normal(size=size)


def _system(problem: Problem) -> AdhesiveSystem:
    n, law, floor = problem.obstacle.size, problem.interface, problem.residual_floor
    return AdhesiveSystem(
        problem.stiffness / n,
        problem.intercept / n,
        problem.obstacle,
        law.terms,
        max(law.strength, 1e-300),
        floor.range,
        problem.mean_is_fixed,
        problem.applied_pressure,
        floor.stiffness,
        floor,
    )
