"""Fallback of the active set: the same with steps that each lower the energy, so that it cannot cycle.

Where distant points of the contact push each other out, as under a stiff film that bends on a soft base,
changes of the whole set at once may return to where they began.

The energy E(p) = p.A p/2 + gap0.p over p >= 0, under a given load over those of the given mean, has the gap
as its gradient. Conjugate gradients on the contact C, preconditioned by kappa restricted to it, go to the
least energy on C, or until the first pressure vanishes, whose point leaves. Before they stop there, a step is
tried to its end and cut off at zero, and kept if that lowers the energy: many points leave at once. Points
that overlap join when they violate the conditions by more than the gaps in C do, with pressures in proportion
to their overlap, by a step to the least energy. As C has finitely many subsets, each with one least energy,
this ends (J. J. More and G. Toraldo, SIAM J. Optim. 1 (1991) 93; Z. Dostal, Optimal Quadratic Programming
Algorithms, 2009, ch. 5).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.conjugate_gradient import comply, evaluate, restore_load
from gfmdlayer.contact.pressure_form import Iterate, System, set_pressure
from gfmdlayer.contact.problem import Problem
from gfmdlayer.contact.residual import residual_scales
from gfmdlayer.grid.transforms import Plans, Transforms, backward, forward
from gfmdlayer.kernels import compiling, kernel

_PORTION = 200  # iterations between two looks at signals
_ROUNDING = 1e-14  # part of a pressure that is left where it was to vanish


class Search(NamedTuple):
    """Work arrays."""

    member: FloatArray  # 1 in the contact C, 0 elsewhere
    direction: FloatArray  # zero outside C
    change: FloatArray  # A direction
    z: FloatArray
    response: FloatArray  # A z
    work: ComplexArray


def make_search(transforms: Transforms) -> Search:
    """Arrays for `descend`."""
    member, direction, change, z, response = (transforms.empty_field() for _ in range(5))
    return Search(member, direction, change, z, response, transforms.empty_spectrum())


def safeguard(
    transforms: Transforms,
    system: System,
    problem: Problem,
    at: Iterate,
    shift: float,
    tolerance: float,
    limit: int,
) -> tuple[bool, int, int]:
    """Improve an iterate until no point violates the conditions for a gap of ``shift`` in the contact.

    Parameters
    ----------
    transforms : Transforms
        Of the surface.
    system, problem : System, Problem
        The problem, in pressures and in displacements.
    at : Iterate
        Pressure and gap to begin with, and on return.
    shift : float
        Gap in the contact that is aimed at; length.
    tolerance : float
        On the violation at each point.
    limit : int
        Most iterations.

    Returns
    -------
    Whether the tolerance was reached, the transforms and the iterations.
    """
    found, taken, done, search = False, 0, 0, make_search(transforms)
    if not descend.signatures:  # type: ignore[attr-defined]
        with compiling():  # rarely needed, and thus not compiled beforehand
            descend(transforms.plans, system, at, search, shift, tolerance, 0)
    set_pressure(at, system, problem, at.p)
    while not found and done < limit:
        portion = min(_PORTION, limit - done)
        found, more, ended = descend(transforms.plans, system, at, search, shift, tolerance, portion)
        taken, done = taken + more, done + ended
        if ended < portion:
            break
    return found, taken, done


@kernel(reorder=True)
def descend(
    plans: Plans, system: System, at: Iterate, search: Search, shift: float, tolerance: float, limit: int
) -> tuple[bool, int, int]:
    """Improve the iterate until no point violates the conditions for a gap of ``shift`` in the contact.

    Parameters
    ----------
    plans : Plans
        Transforms of the surface.
    system : System
        The problem.
    at : Iterate
        Pressure, admissible, to begin with; pressure and gap, an exact pair, on return.
    search : Search
        Work arrays.
    shift : float
        Gap in the contact that is aimed at; length.
    tolerance : float
        On the violation at each point, scaled as in the residual.
    limit : int
        Most iterations.

    Returns
    -------
    Whether the tolerance was reached, the transforms and the iterations.
    """
    p, gap, (member, d, change, z, _, work) = at.p, at.gap, search
    load, transforms, last, exact, found, iteration = p.sum(), 2, 0.0, True, False, 0
    for i in range(p.size):
        member[i] = 1.0 if p[i] > 0.0 else 0.0
    evaluate(plans, system, at, work)
    while iteration < limit:
        opened, overlap = _violations(system, at, member, shift)
        if max(opened, overlap) <= tolerance:
            if exact:
                found = True
                break
            restore_load(system, p, load)
            evaluate(plans, system, at, work)
            transforms, exact, last = transforms + 2, True, 0.0
            continue
        iteration += 1
        joins = overlap > opened
        if joins:
            last = 0.0
            _join(system, at, search, shift)
        else:
            product = _precondition(plans, system, at, search, shift)
            transforms += 2
            for i in range(p.size):
                d[i] = z[i] + (product / last * member[i] * d[i] if last > 0.0 else 0.0)
        comply(plans, system, d, work, work, change)
        transforms += 2
        slope, curvature = 0.0, 0.0
        for i in range(p.size):
            slope += (shift - gap[i]) * d[i]
            curvature += d[i] * change[i]
        if not (slope > 0.0 and curvature > 0.0):
            if exact and last == 0.0:
                break  # rounding
            restore_load(system, p, load)
            evaluate(plans, system, at, work)
            transforms, exact, last = transforms + 2, True, 0.0
            continue
        length, reach = slope / curvature, _reach(search, p)
        if length > reach and not joins:
            last, exact, transforms = 0.0, False, transforms + 2
            if _cut(plans, system, at, search, shift, length):
                continue
        else:
            last, exact = 0.0 if joins else product, False
        way = min(length, reach)
        for i in range(p.size):
            moved = p[i] + way * d[i]
            moved = moved if moved > _ROUNDING * p[i] else 0.0
            gap[i] += way * change[i]
            member[i] = 0.0 if moved == 0.0 else member[i]
            p[i] = moved
        exact = False
    if not exact:
        restore_load(system, p, load)
        evaluate(plans, system, at, work)
        transforms += 2
    _violations(system, at, member, shift)
    return found, transforms, iteration


@kernel(reorder=True, inner=True)
def _violations(system: System, at: Iterate, member: FloatArray, shift: float) -> tuple[float, float]:
    """Largest gap in the contact and overlap outside, in the residual's scale.

    Under a given load the punch is shifted first, so that the gap in the contact is right in the mean.
    """
    p, gap = at.p, at.gap
    if system.load_given:
        total, count = 0.0, 0.0
        for i in range(p.size):
            total += member[i] * gap[i]
            count += member[i]
        excess = total / count - shift
        for i in range(p.size):
            gap[i] -= excess
    _, depth = residual_scales(p, system.h - gap, system.floor)
    opened, overlap = 0.0, 0.0
    for i in range(p.size):
        off = gap[i] - shift
        if member[i] > 0.0:
            opened = max(opened, abs(off))
        else:
            overlap = max(overlap, -off)
    return opened / depth, overlap / depth


@kernel(reorder=True, inner=True)
def _join(system: System, at: Iterate, search: Search, shift: float) -> None:
    """Let overlapping points join; the direction is their overlap, under a given load taken from the rest."""
    gap, (member, d, _, _, _, _) = at.gap, search
    total, load = 0.0, 0.0
    for i in range(gap.size):
        joins = member[i] == 0.0 and gap[i] < shift
        d[i] = shift - gap[i] if joins else 0.0
        member[i] = 1.0 if joins else member[i]
        total += d[i]
        load += at.p[i]
    if system.load_given:
        for i in range(gap.size):
            d[i] -= total / load * at.p[i]


@kernel(reorder=True, inner=True)
def _precondition(plans: Plans, system: System, at: Iterate, search: Search, shift: float) -> float:
    """Write z = kappa r restricted to the contact, without mean under a given load; return r.z."""
    gap, (member, _, _, z, _, work) = at.gap, search
    for i in range(gap.size):
        z[i] = member[i] * (shift - gap[i])
    forward(plans, z, work)
    for k in range(work.size):
        work[k] *= system.stiffness[k]
    backward(plans, work, z)
    excess, count, product = 0.0, 0.0, 0.0
    for i in range(gap.size):
        excess += member[i] * z[i]
        count += member[i]
    excess = excess / count if system.load_given else 0.0
    for i in range(gap.size):
        z[i] = member[i] * (z[i] - excess)
        product += (shift - gap[i]) * z[i]
    return product


@kernel(inner=True)
def _cut(plans: Plans, system: System, at: Iterate, search: Search, shift: float, length: float) -> bool:
    """Go a step to its end, cut off at zero, if that lowers the energy; return whether it does.

    Two transforms.
    """
    p, gap, (member, d, _, z, response, work) = at.p, at.gap, search
    load, total = p.sum(), 0.0
    for i in range(p.size):
        z[i] = max(p[i] + length * d[i], 0.0)
        total += z[i]
    if not total > 0.0:
        return False
    scale = load / total if system.load_given else 1.0
    for i in range(p.size):
        z[i] = scale * z[i] - p[i]
    comply(plans, system, z, work, work, response)
    difference = 0.0  # of the energy
    for i in range(p.size):
        difference += z[i] * (gap[i] - shift + 0.5 * response[i])
    if not difference < 0.0:
        return False
    for i in range(p.size):
        p[i] += z[i]
        gap[i] += response[i]
        p[i] = max(p[i], 0.0)
        member[i] = 1.0 if p[i] > 0.0 else 0.0
    return True


@kernel(inner=True)
def _reach(search: Search, p: FloatArray) -> float:
    """Part of the direction up to which no pressure becomes negative."""
    fastest = 0.0  # relative fall of a pressure
    for i in range(p.size):
        if search.direction[i] < 0.0:
            fastest = max(fastest, -search.direction[i] / p[i] if p[i] > 0.0 else np.inf)
    return 1.0 / fastest if fastest > 0.0 else np.inf
