"""The compiled loop of the active-set solver; see `active_set` for the method and its symbols."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

from gfmdlayer.contact.grid import FloatArray
from gfmdlayer.contact.problem import FASTMATH, scales
from gfmdlayer.contact.transforms import ComplexArray, Plans, backward, forward

BoolArray = npt.NDArray[np.bool_]

# An inner solve ends when its residual is this part of what is wrong with the contact set.
_WELL_UNDER = 0.1


class System(NamedTuple):
    """The problem in pressures, per point: gap = gap0 + A p."""

    compliance: FloatArray  # A: 1/kappa, 0 for a mean that is fixed or free
    stiffness: FloatArray  # kappa, the preconditioner
    gap0: FloatArray  # gap without pressure
    softest: float  # kappa_1
    load: bool  # whether the mean of p is kept and the gap is known up to a shift, the depth


class Iterate(NamedTuple):
    """State of the iteration; ``spectrum`` is the transform of p."""

    p: FloatArray
    gap: FloatArray
    touching: BoolArray
    spectrum: ComplexArray


class Work(NamedTuple):
    """Work arrays."""

    direction: FloatArray
    change: FloatArray  # of the gap along the direction
    z: FloatArray
    direction_spectrum: ComplexArray
    work: ComplexArray


class Errors(NamedTuple):
    """What is wrong with an iterate, in the scales of the residual."""

    open: float  # largest gap, of either sign, where there is contact
    overlap: float  # largest overlap elsewhere
    tension: float  # largest tension in the contact
    depth: float  # scale of the gaps


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def iterate(
    plans: Plans, system: System, at: Iterate, work: Work, tolerance: float, rounds: int, limit: int
) -> tuple[bool, int, int]:
    """Find contact set and pressure; return whether they were found, the transforms and the iterations it took.

    Ends without success after ``rounds`` changes of the contact set or ``limit`` iterations.
    """
    p, gap, touching = at.p, at.gap, at.touching
    transforms = 2
    evaluate(plans, system, at, work)
    restart, last = True, 0.0
    for iteration in range(limit):
        errors = judge(system, at)
        if max(errors.open, errors.overlap, errors.tension) <= tolerance:
            return True, transforms, iteration
        wrong_set = max(errors.overlap, errors.tension)
        if wrong_set > 0.0 and errors.open <= max(_WELL_UNDER * wrong_set, tolerance):
            if rounds == 0:
                return False, transforms, iteration
            rounds -= 1
            restart = True
            if _update_contact(p, gap, touching):
                transforms += 2
                evaluate(plans, system, at, work)
            errors = judge(system, at)
            if errors.open <= 0.0:
                continue
        # z = M r: the pressure that would close the gaps, were there no contact set.
        for i in range(p.size):
            work.z[i] = -gap[i] if touching[i] else 0.0
        forward(plans, work.z, work.work)
        for k in range(work.work.size):
            work.work[k] *= system.stiffness[k]
        backward(plans, work.work, work.z)
        product, slope = _direct(system.load, at, work, restart, last)
        forward(plans, work.direction, work.direction_spectrum)
        for k in range(work.work.size):
            work.work[k] = system.compliance[k] * work.direction_spectrum[k]
        backward(plans, work.work, work.change)
        transforms += 4
        curvature = 0.0
        for i in range(p.size):
            curvature += work.direction[i] * work.change[i]
        if not curvature > 0.0:
            return False, transforms, iteration
        step = slope / curvature
        for i in range(p.size):
            p[i] += step * work.direction[i]
            gap[i] += step * work.change[i]
        for k in range(work.work.size):
            at.spectrum[k] += step * work.direction_spectrum[k]
        restart, last = False, product
    return False, transforms, limit


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def evaluate(plans: Plans, system: System, at: Iterate, work: Work) -> None:
    """Gap of the pressures, with two transforms."""
    forward(plans, at.p, at.spectrum)
    for k in range(work.work.size):
        work.work[k] = system.compliance[k] * at.spectrum[k]
    backward(plans, work.work, at.gap)
    for i in range(at.p.size):
        at.gap[i] += system.gap0[i]


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def judge(system: System, at: Iterate) -> Errors:
    """Errors of an iterate; under a given load, the depth is first set so that the gap vanishes in the mean of the contact."""
    p, gap, touching = at.p, at.gap, at.touching
    if system.load:
        total, count = 0.0, 0
        for i in range(p.size):
            if touching[i]:
                total += gap[i]
                count += 1
        for i in range(p.size):
            gap[i] -= total / count
    largest, lowest, deepest = 0.0, 0.0, 0.0
    open_, overlap = 0.0, 0.0
    for i in range(p.size):
        if touching[i]:
            largest = max(largest, p[i])
            lowest = min(lowest, p[i])
            open_ = max(open_, abs(gap[i]))
        else:
            overlap = max(overlap, -gap[i])
        deepest = max(deepest, gap[i] - system.h[i])
    pressure_scale, depth = scales(largest, deepest, system.softest)
    return Errors(open_ / depth, overlap / depth, -lowest / pressure_scale, depth)


@nb.njit(nogil=True, cache=True)
def _update_contact(p: FloatArray, gap: FloatArray, touching: BoolArray) -> bool:
    """The primal-dual step: let go what pulls, take in what overlaps; return whether p changed."""
    changed = False
    for i in range(p.size):
        if touching[i] and p[i] < 0.0:
            touching[i] = False
            p[i] = 0.0
            changed = True
        elif not touching[i] and gap[i] < 0.0:
            touching[i] = True
    return changed
