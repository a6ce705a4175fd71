"""The contact problem in pressures: how a solver that works in them begins, and what it hands back.

With A = 1/kappa mode by mode (0 where kappa is), u = u0 - A p, where u0 is the displacement without pressure,
and gap = gap0 + A p; see `active_set`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.problem import (
    Assessment,
    Problem,
    ResidualFloor,
    Solution,
    assess,
    make_solution,
    scales_of,
    violation,
)
from gfmdlayer.contact.projection import project
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.kernels import LANES, kernel

_ROUNDING = 1e-12  # part of the height of the punch
CLAMPED = 1e-14  # overlap, as part of the depth, that is rounding and may be cut off
# Part of the tolerance within which a solve ends; the rest is for what lifting the surface clear adds.
CLOSE = 0.8
AIM = 0.25  # likewise where a gap in the contact is aimed at instead, and that gap, as part of the depth
_LARGEST_LIFT = 1e-3  # beyond it scaling the pressure is no small correction


class System(NamedTuple):
    """The problem in pressures, in units of one grid point: gap = gap0 + A p."""

    compliance: FloatArray  # A: 1/kappa, and 0 at q = 0 where the mean of u is fixed or the load is given
    stiffness: FloatArray  # kappa
    gap0: FloatArray  # gap without pressure
    h: FloatArray
    least: ResidualFloor
    load: bool  # whether the mean of p is given, and the gap known up to a shift only
    yielding: float  # mean displacement of the surface per total pressure


class Iterate(NamedTuple):
    """A pressure and its gap."""

    p: FloatArray
    gap: FloatArray
    spectrum: ComplexArray  # transform of the pressure


@kernel
def per_point(stiffness: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    """Compliance and stiffness of the modes, for transforms of so many points that nothing divides."""
    compliance, shared = np.empty(stiffness.size), np.empty(stiffness.size)
    for k in range(stiffness.size):
        compliance[k] = 1.0 / (size * stiffness[k]) if stiffness[k] != 0.0 else 0.0
        shared[k] = stiffness[k] / size
    return compliance, shared


def in_pressures(problem: Problem, transforms: Transforms) -> tuple[System, ComplexArray]:
    """Return the problem in pressures and the transform of u0, both per point; one transform."""
    n = problem.obstacle.size
    compliance, stiffness = per_point(problem.stiffness, n)
    free = problem.intercept * compliance
    gap0 = problem.obstacle - transforms.backward(free)
    load = problem.mean_pressure is not None
    return System(compliance, stiffness, gap0, problem.obstacle, problem.least, load, compliance[0]), free


def set_pressure(at: Iterate, system: System, problem: Problem, start: FloatArray) -> None:
    """Make the first guess of the pressure admissible: not negative, and of the given mean."""
    np.fmax(start, 0.0, out=at.p)  # a guess may be anything
    if system.load:
        mean, guessed = problem.applied_pressure, float(at.p.mean())
        if not (0.0 < guessed < np.inf and mean / guessed < np.inf):
            at.p[:] = 0.0
            at.p[np.argmin(system.gap0)] = at.p.size
            guessed = 1.0
        at.p[:] *= mean / guessed
    elif system.gap0.min() >= 0.0:
        at.p[:] = 0.0  # nothing presses; a pressure could only fade, and be compared with itself


def feasible_solution(
    problem: Problem,
    system: System,
    free: ComplexArray,
    at: Iterate,
    tolerance: float,
    pairs: int,
    iterations: int,
) -> Solution:
    """Raise the pressure until nothing overlaps, and judge the state that this gives."""
    n = at.p.size
    u, pressure, spectrum = np.empty(n), np.empty(n), np.empty_like(free)
    overlap, judgement = _hand_back(system, at, free, u, pressure, spectrum)
    clear = overlap == 0.0 or overlap <= CLAMPED * scales_of(pressure, u, system.least)[1]
    return make_solution(
        problem,
        u,
        pressure,
        spectrum,
        transforms=pairs,
        iterations=iterations,
        within=tolerance if clear else -1.0,
        judgement=judgement,
    )


def trivial_solution(problem: Problem, transforms: Transforms) -> Solution | None:
    """Return the solution where it needs no solver: the cell is filled, or nothing presses.

    Raises
    ------
    ValueError
        If the punch displaces more than the cell holds, mean(h) < 0 for a body of fixed mean.
    """
    h = problem.obstacle
    if problem.mean_pressure == 0.0:
        return _resting(problem, transforms)
    if not problem.mean_is_fixed or has_room(h):
        return None
    project(h.copy(), h, mean_is_fixed=True)
    # u = h is all that is admissible; its pressure is that at which contact becomes full.
    return _state(problem, transforms, h.copy(), None, 1, 0, converged=True)


@kernel(reorder=True)
def has_room(h: FloatArray) -> bool:
    """Whether the punch displaces less than the cell holds: the mean of h is positive, beyond rounding."""
    total, size = 0.0, 0.0
    for i in range(h.size):
        total += h[i]
        size += abs(h[i])
    return not total <= _ROUNDING * size  # NaN is for the solver to find


def _resting(problem: Problem, transforms: Transforms) -> Solution:
    """The surface without pressure, at the depth at which the punch touches it."""
    h, n = problem.obstacle, problem.obstacle.size
    spectrum = np.zeros_like(problem.intercept)
    np.divide(problem.intercept, problem.stiffness, out=spectrum, where=problem.stiffness > 0)
    u = transforms.backward(spectrum) / n
    shift = (u - h).max()
    spectrum[0] -= n * shift
    u = np.minimum(u - shift, h)
    return Solution(
        displacement=u,
        pressure=np.zeros(n),
        gap=h - u,
        spectrum=spectrum,
        mean_pressure=0.0,
        mean_gap=float((h - u).mean()),
        contact_area=0.0,
        residual=0.0,
        transforms=1,
        iterations=0,
        converged=True,
    )


def unconverged(
    problem: Problem, system: System, at: Iterate, transforms: Transforms, failed: Solution
) -> Solution:
    """Return what belongs together although it is no solution: the surface pushed clear, and its pressure."""
    if system.load and np.isfinite(at.gap).all():
        return replace(failed, converged=False)  # the depth has given way, which is exact
    u = problem.obstacle - at.gap
    if np.isfinite(u).all():
        project(u, problem.obstacle, problem.mean_is_fixed)
    pairs, iterations = failed.transforms + 1, failed.iterations
    return _state(problem, transforms, u, at.p, pairs, iterations, converged=False)


def compile_failure(at: Iterate, transforms: Transforms) -> System:
    """Compile what hands back a failed solve: of a flat punch above the surface, whose system is returned."""
    stiffness, size = np.ones_like(at.spectrum, dtype=float), at.p.size
    stiffness[0] = 0.0
    problem = Problem(stiffness, np.zeros_like(at.spectrum), np.ones(size))
    system, free = in_pressures(problem, transforms)
    for array in at:
        array[:] = 0.0
    scales_of(at.p, at.gap, problem.least)
    failed = feasible_solution(problem, system, free, at, 1.0, 0, 0)
    unconverged(problem, system, at, transforms, failed)
    return system


def _state(
    problem: Problem,
    transforms: Transforms,
    u: FloatArray,
    guide: FloatArray | None,
    pairs: int,
    iterations: int,
    *,
    converged: bool,
) -> Solution:
    """Pressure of a displacement, with no force in the mean where the guiding pressure is zero."""
    spectrum = transforms.forward(u)
    pressure = transforms.backward((problem.intercept - problem.stiffness * spectrum) / u.size)
    if problem.mean_is_fixed:
        bare = pressure == pressure.min() if guide is None or guide.all() else guide <= 0
        pressure -= pressure[bare].mean() if bare.any() else np.nan
    within = 0.0 if converged else -1.0
    return make_solution(
        problem, u, pressure, spectrum, transforms=pairs, iterations=iterations, within=within
    )


@kernel(reorder=True)
def raise_clear(system: System, at: Iterate, u: FloatArray, pressure: FloatArray) -> tuple[float, float]:
    """Write pressure and displacement of a state that overlaps nowhere; return the lift of the pressure.

    Under a given load the depth gives way, elsewhere the pressure grows by the factor 1 + lift. The overlap
    that this leaves is clamped, and returned.
    """
    n = at.gap.size
    lift, lowest = 0.0, 0.0
    for first in range(0, n, LANES):
        gap, gap0, below = at.gap[first : first + LANES], system.gap0[first : first + LANES], 0.0
        for i in range(gap.size):
            below += 1.0 if gap[i] < 0.0 else 0.0
        if below > 0.0:
            for i in range(gap.size):
                lowest = min(lowest, gap[i])
                effect = gap[i] - gap0[i]
                if gap[i] < 0.0 and effect > 0.0:
                    lift = max(lift, -gap[i] / effect)
    shift = 0.0
    if system.load:
        lift, shift = 0.0, -lowest
    elif lift > _LARGEST_LIFT:
        lift = 0.0
    left = np.zeros(LANES)
    for first in range(0, n, LANES):
        gap, gap0, h = (
            at.gap[first : first + LANES],
            system.gap0[first : first + LANES],
            system.h[first : first + LANES],
        )
        us = u[first : first + LANES]
        for i in range(gap.size):
            opening = gap[i] + shift + lift * (gap[i] - gap0[i])
            left[i] = opening if opening < left[i] else left[i]
            us[i] = h[i] - (0.0 if opening < 0.0 else opening)  # NaN stays
    for i in range(n):
        pressure[i] = (1.0 + lift) * at.p[i]
    return lift, -left.min()


@kernel(reorder=True)
def satisfies_kkt(system: System, p: FloatArray, gap: FloatArray, shift: float, tolerance: float) -> bool:
    """Whether no point violates the conditions for a gap of ``shift`` in the contact; NaN does."""
    pressure_scale, depth = scales_of(p, system.h - gap, system.least)
    off, per_pressure, per_gap = 0.0, 1.0 / pressure_scale, 1.0 / depth
    for i in range(p.size):
        known = p[i] == p[i]  # of a pressure that is not a number the violation is that of the gap
        holds = violation(p[i], gap[i] - shift, per_pressure, per_gap) <= tolerance
        off += 0.0 if known and holds else 1.0
    return off == 0.0


@kernel(reorder=True)
def _hand_back(
    system: System,
    at: Iterate,
    free: ComplexArray,
    u: FloatArray,
    pressure: FloatArray,
    spectrum: ComplexArray,
) -> tuple[float, Assessment]:
    """Write what is handed back of a state, clear of overlap; return what was clamped, and the judgement."""
    lift, overlap = raise_clear(system, at, u, pressure)
    n = at.p.size
    for k in range(free.size):
        spectrum[k] = n * (free[k] - (1.0 + lift) * system.compliance[k] * at.spectrum[k])
    if system.load:
        spectrum[0] = u.sum()
    return overlap, assess(pressure, u, system.h, system.least)
