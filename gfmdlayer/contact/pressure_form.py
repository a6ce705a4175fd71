"""The contact problem in pressures: how a solver that works in them begins and ends.

With A = 1/kappa mode by mode (0 where kappa is), the displacement is u = u0 - A p, with u0 that without
pressure, and the gap is gap0 + A p. Find p >= 0 with gap >= 0 and p gap = 0; see `active_set.solver`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import BoolArray, ComplexArray, FloatArray
from gfmdlayer.contact.problem import Problem, Solution, make_solution, project
from gfmdlayer.contact.residual import ResidualFloor, residual_scales, scales_of, violation
from gfmdlayer.grid.ranks import Ranks
from gfmdlayer.grid.transforms import Plans, Transforms, backward, forward
from gfmdlayer.kernels import LANES, filled, kernel, minimum

_ROUNDING = 1e-12  # part of the height of the punch
# Heights, as part of the depth at which the lowest mode carries the load, that no tolerance above 1e-8 tells
# from the rounding of the gap, 1e-16 of that depth.
FLAT = 1e-8
CLAMPED = 1e-14  # overlap, as part of the depth, that is rounding and may be cut off
HEIGHT_ROUNDING = 0.01  # likewise, of the least depth that counts, which is 1e-14 of the heights
# Part of the tolerance within which a solve ends; lifting the surface clear of the punch may add the rest.
CLOSE = 0.8
AIM = 0.25  # likewise where a gap in the contact is aimed at instead, and that gap, as part of the depth
_LARGEST_LIFT = 1e-3  # beyond it scaling the pressure is no small correction


class System(NamedTuple):
    """The problem in pressures, per grid point: gap = gap0 + A p."""

    compliance: FloatArray  # A: 1/kappa, and 0 at q = 0 where the mean of u is fixed or the load is given
    stiffness: FloatArray  # kappa
    gap0: FloatArray  # gap without pressure
    h: FloatArray
    floor: ResidualFloor
    load_given: bool  # whether the mean of p is given, and the gap known up to a rigid shift
    mean_compliance: float  # mean displacement of the surface per total pressure


class Iterate(NamedTuple):
    """A pressure and its gap."""

    p: FloatArray
    gap: FloatArray
    spectrum: ComplexArray  # transform of the pressure


class SurfaceState(NamedTuple):
    """A state of the surface: the arrays of a `Solution`."""

    u: FloatArray
    p: FloatArray
    gap: FloatArray
    spectrum: ComplexArray  # of u, unnormalised


@kernel(reorder=True, inner=True, borrows=True)
def apply_to(
    plans: Plans,
    factors: FloatArray,
    field: FloatArray,
    spectrum: ComplexArray,
    work: ComplexArray,
    result: FloatArray,
) -> None:
    """Write A or kappa times a field, by the factors of the modes, and its transform; two transforms."""
    # The transform may be the work array: then it is not kept.
    forward(plans, field, spectrum)
    for k in range(work.size):
        work[k] = factors[k] * spectrum[k]
    backward(plans, work, result)


def per_point(stiffness: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    """Compliance and stiffness of the modes per point, as unnormalised transforms need them."""
    compliance = np.zeros(stiffness.size)
    np.divide(1.0, size * stiffness, out=compliance, where=stiffness != 0.0)
    return compliance, stiffness / size


def in_pressures(problem: Problem, transforms: Transforms) -> tuple[System, ComplexArray]:
    """Return the problem in pressures and the transform of u0, both per point; one transform."""
    compliance, stiffness = per_point(problem.stiffness, problem.obstacle.size)
    free = problem.intercept * compliance
    gap0 = problem.obstacle - transforms.backward(free)
    load_given = problem.mean_pressure is not None
    floor = problem.residual_floor
    return System(compliance, stiffness, gap0, problem.obstacle, floor, load_given, compliance[0]), free


def set_pressure(at: Iterate, system: System, problem: Problem, start: FloatArray) -> None:
    """Make a first guess of the pressure admissible: not negative (nor NaN), and of the given mean."""
    np.fmax(start, 0.0, out=at.p)
    if system.load_given:
        mean, guessed = problem.applied_pressure, float(at.p.mean())
        if not (0.0 < guessed < np.inf and mean / guessed < np.inf):
            at.p[:] = 0.0
            at.p[np.argmin(system.gap0)] = at.p.size
            guessed = 1.0
        at.p[:] *= mean / guessed
    elif system.gap0.min() >= 0.0:
        at.p[:] = 0.0  # no contact: start from zero


def trivial_solution(problem: Problem, transforms: Transforms) -> Solution | None:
    """Return the solution for no load, a flat punch, or no room in the cell; None elsewhere."""
    # ValueError if the punch displaces more than the cell holds, mean(h) < 0 for a body of fixed mean.
    h = problem.obstacle
    if problem.mean_pressure == 0.0 and not problem.interface.attracts:
        return _free_surface(problem, transforms)
    load = problem.applied_pressure
    if load > 0.0 and problem.height * problem.kappa_1 < FLAT * load and not problem.interface.attracts:
        return _full_contact(problem, transforms)
    if not problem.mean_is_fixed or _has_room(h, problem.ranks):
        return None
    project(h.copy(), h, mean_is_fixed=True, ranks=problem.ranks)
    # u = h is the only admissible state; its pressure is that at which contact becomes full.
    return _solution_of(problem, transforms, h.copy(), None, transforms_spent=1, iterations=0, converged=True)


def _full_contact(problem: Problem, transforms: Transforms) -> Solution | None:
    """The state that touches the punch everywhere, where the load presses everywhere."""
    u, ranks = problem.obstacle.copy(), problem.ranks
    spectrum = transforms.forward(u)
    pressure = transforms.backward((problem.intercept - problem.stiffness * spectrum) / transforms.size)
    pressure += problem.applied_pressure
    presses = ranks.minimum(float(pressure.min())) >= 0.0
    if not presses or not ranks.maximum(float(pressure.max())) <= problem.hardness:
        return None
    return make_solution(problem, u, pressure, spectrum, spent=(1, 0), within=0.0)


def _has_room(h: FloatArray, ranks: Ranks) -> bool:
    """Whether the punch displaces less than the cell holds: the mean of h is positive, beyond rounding."""
    total, size = ranks.total(np.array(_height(h))).tolist()
    return not total <= _ROUNDING * size  # NaN is for the solver to find


@kernel(inner=True, borrows=True)
def has_room(h: FloatArray) -> bool:
    """`_has_room` for kernels."""
    total, size = _height(h)
    return not total <= _ROUNDING * size


@kernel(reorder=True, borrows=True)
def _height(h: FloatArray) -> tuple[float, float]:
    """Sums of the heights and of their magnitudes."""
    total, size = 0.0, 0.0
    for i in range(h.size):
        total += h[i]
        size += abs(h[i])
    return total, size


def _free_surface(problem: Problem, transforms: Transforms) -> Solution:
    """The surface without pressure, at the depth at which the punch touches it."""
    h, n, ranks = problem.obstacle, transforms.size, problem.ranks
    spectrum = np.zeros_like(problem.intercept)
    np.divide(problem.intercept, problem.stiffness, out=spectrum, where=problem.stiffness > 0)
    u = transforms.backward(spectrum) / n
    shift = ranks.maximum(float((u - h).max()))
    if ranks.first:
        spectrum[0] -= n * shift
    u = np.minimum(u - shift, h)
    none, assessment = np.zeros(h.size), (0.0, 0.0, 0.0, ranks.mean(h - u))
    return make_solution(problem, u, none, spectrum, spent=(1, 0), within=0.0, assessment=assessment)


def feasible_solution(
    problem: Problem,
    system: System,
    free: ComplexArray,
    at: Iterate,
    tolerance: float,
    *,
    transforms: int,
    iterations: int,
) -> Solution:
    """Raise the pressure until the surface overlaps the punch nowhere, and assess that state."""
    # Pressure and gap of `at` are an exact pair; `free` is the transform of u0, per point. Not converged
    # where overlap remains.
    n = at.p.size
    u, pressure, spectrum = np.empty(n), np.empty(n), np.empty_like(free)
    overlap = write_state(system, at, free, u, pressure, spectrum)
    depth = residual_scales(pressure, u, system.floor)[1]
    spent = transforms, iterations
    within = tolerance if is_clear(overlap, depth, system.floor) else -1.0
    return make_solution(problem, u, pressure, spectrum, spent=spent, within=within)


def unconverged(
    problem: Problem, system: System, at: Iterate, transforms: Transforms, failed: Solution
) -> Solution:
    """Return a consistent state that is no solution: the surface clear of the punch, and its pressure."""
    if system.load_given and np.isfinite(at.gap).all():
        return replace(failed, converged=False)  # the rigid shift has cleared it, which is exact
    u = problem.obstacle - at.gap
    if np.isfinite(u).all():
        project(u, problem.obstacle, problem.mean_is_fixed)
    pairs, iterations = failed.transforms + 1, failed.iterations
    return _solution_of(
        problem, transforms, u, at.p, transforms_spent=pairs, iterations=iterations, converged=False
    )


def compile_failure(at: Iterate, transforms: Transforms) -> System:
    """Compile the kernels of a failed solve, with a flat punch above the surface; return its system."""
    stiffness, size = np.ones(at.spectrum.size), at.p.size
    stiffness[0] = 0.0
    problem = Problem(stiffness, np.zeros_like(at.spectrum), np.ones(size))
    system, free = in_pressures(problem, transforms)
    for array in at:
        array[:] = 0.0
    residual_scales(at.p, at.gap, system.floor)
    failed = feasible_solution(problem, system, free, at, 1.0, transforms=0, iterations=0)
    unconverged(problem, system, at, transforms, failed)
    return system


def _mean_over(chosen: BoolArray, field: FloatArray, ranks: Ranks) -> float:
    """Mean over the chosen points; NaN without any."""
    if ranks.count == 1:
        return float(field[chosen].mean()) if chosen.any() else np.nan
    total, count = ranks.total(np.array([field[chosen].sum(), np.count_nonzero(chosen)])).tolist()
    return float(total / count) if count else np.nan


def _solution_of(
    problem: Problem,
    transforms: Transforms,
    u: FloatArray,
    guide: FloatArray | None,
    *,
    transforms_spent: int,
    iterations: int,
    converged: bool,
) -> Solution:
    """State of a displacement, with no force in the mean where the guiding pressure is zero."""
    spectrum, ranks = transforms.forward(u), problem.ranks
    pressure = transforms.backward((problem.intercept - problem.stiffness * spectrum) / transforms.size)
    if problem.mean_is_fixed:
        if guide is None or ranks.minimum(int(guide.all())):
            bare = np.asarray(pressure == ranks.minimum(float(pressure.min())))
        else:
            bare = np.asarray(guide <= 0)
        pressure -= _mean_over(bare, pressure, ranks)
    within = 0.0 if converged else -1.0
    return make_solution(problem, u, pressure, spectrum, spent=(transforms_spent, iterations), within=within)


@kernel(reorder=True, inner=True, borrows=True)
def _raise_clear(system: System, at: Iterate, u: FloatArray, pressure: FloatArray) -> tuple[float, float]:
    """Write pressure and displacement of a state that overlaps nowhere; return lift and clamped overlap."""
    # Under a given load the punch is shifted, elsewhere the pressure grows by the factor 1 + lift.
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
    if system.load_given:
        lift, shift = 0.0, -lowest
    elif lift > _LARGEST_LIFT:
        lift = 0.0
    clamped = filled(LANES, 0.0)
    for first in range(0, n, LANES):
        gap, gap0, h = (
            at.gap[first : first + LANES],
            system.gap0[first : first + LANES],
            system.h[first : first + LANES],
        )
        us = u[first : first + LANES]
        for i in range(gap.size):
            opening = gap[i] + shift + lift * (gap[i] - gap0[i])
            clamped[i] = opening if opening < clamped[i] else clamped[i]
            us[i] = h[i] - (0.0 if opening < 0.0 else opening)  # NaN stays
    for i in range(n):
        pressure[i] = (1.0 + lift) * at.p[i]
    return lift, -minimum(clamped)


@kernel(reorder=True)
def satisfies_kkt(system: System, p: FloatArray, gap: FloatArray, shift: float, tolerance: float) -> bool:
    """Whether no point violates the conditions for a gap of ``shift`` in the contact; NaN does."""
    pressure_scale, depth = scales_of(p, system.h - gap, system.floor)
    off, per_pressure, per_gap = 0.0, 1.0 / pressure_scale, 1.0 / depth
    for i in range(p.size):
        known = p[i] == p[i]  # where the pressure is not a number, the gap gives the violation
        holds = violation(p[i], gap[i] - shift, per_pressure, per_gap) <= tolerance
        off += 0.0 if known and holds else 1.0
    return off == 0.0


@kernel(borrows=True)
def is_clear(overlap: float, depth: float, floor: ResidualFloor) -> bool:
    """Whether the overlap that was clamped is rounding."""
    return overlap == 0.0 or overlap <= max(CLAMPED * depth, HEIGHT_ROUNDING * floor.depth)


@kernel(reorder=True, borrows=True)
def write_state(
    system: System,
    at: Iterate,
    free: ComplexArray,
    u: FloatArray,
    pressure: FloatArray,
    spectrum: ComplexArray,
) -> float:
    """Write a state without overlap; return what was clamped."""
    lift, overlap = _raise_clear(system, at, u, pressure)
    n = at.p.size
    for k in range(free.size):
        spectrum[k] = n * (free[k] - (1.0 + lift) * system.compliance[k] * at.spectrum[k])
    if system.load_given:
        total = 0.0
        for i in range(n):
            total += u[i]
        spectrum[0] = total
    return overlap
