"""The compiled loop of the active-set solver; see `active_set` for the method and its symbols."""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.active_set.deflation import deflate, direct, free_slot, step
from gfmdlayer.contact.active_set.edges import motion, update
from gfmdlayer.contact.active_set.start import start
from gfmdlayer.contact.active_set.state import Bank, ContactSet, Past, Work, dot, list_near, mean
from gfmdlayer.contact.pressure_form import Iterate, System
from gfmdlayer.contact.problem import scales
from gfmdlayer.grid.transforms import Plans, backward, forward
from gfmdlayer.kernels import LANES, kernel

# Points that pull are let go once the gaps in the contact are this part of what is wrong with the set.
_WELL_UNDER = 0.1
_SETTLED = 0.3  # and once this part of the tension, at most, came with the last iteration
_PATIENCE = 20  # iterations after which conjugate gradients go on without deflation
_FAR = 1e300  # added to the gaps in the contact where only the others count


@kernel
def attempt(
    plans: Plans,
    system: System,
    b: ComplexArray,
    free: ComplexArray,
    at: Iterate,
    contact: ContactSet,
    bank: Bank,
    work: Work,
    past: Past,
    guess: FloatArray,
    load: float,
    keep: bool,
    tolerance: float,
    rounds: int,
    limit: int,
) -> tuple[bool, int, int]:
    """`start`, then `iterate`: in one call, since to hand all of this over takes its time."""
    start(plans, system, b, free, at, contact, bank, work, past, guess, load, keep)
    found, transforms, iterations = iterate(
        plans, system, at, contact, bank, work, 0.0, tolerance, rounds, limit
    )
    return found, transforms + 1, iterations


@kernel
def iterate(
    plans: Plans,
    system: System,
    at: Iterate,
    contact: ContactSet,
    bank: Bank,
    work: Work,
    shift: float,
    tolerance: float,
    rounds: int,
    limit: int,
    checked: bool = False,
) -> tuple[bool, int, int]:
    """Find the contact set and its pressure; return whether they were found, the transforms, the iterations.

    The gap in the contact is brought to ``shift``. Ends without success after ``rounds`` changes of the set
    or ``limit`` iterations. Gap and pressure are an exact pair on return; at the beginning they need not be,
    and a guess that is good enough is left as it is. Where the caller has what is found ``checked`` on a
    larger surface, a single stretch need not be evaluated: the gap is known near it.
    """
    transforms, carried, exact = 0, at.p.sum(), work.exact
    guessed = not exact[0]
    if guessed:
        evaluate(plans, system, at, work)
        transforms += 2
    restart, last, slot, iteration = True, 0.0, free_slot(bank), 0
    plain, since = False, 0  # without deflation; iterations since the last restart
    done = 0  # changes of the set
    moved = 0.0  # largest change of the pressure in the last iteration, where edges are gone by
    list_near(contact)
    for iteration in range(limit):
        opened, tension, overlap = _judge(system, at, contact, work, shift)
        good, guessed = guessed and max(opened, tension, overlap) <= tolerance, False
        if restart and not plain and not good and deflate(system, at, contact, bank, work, shift):
            exact[0] = False
            opened, tension, overlap = _judge(system, at, contact, work, shift)
        known = exact[0] or (checked and contact.counts[0] == 1)
        if max(opened, tension, overlap) <= tolerance and not known:
            _carry(system, at, contact, carried)
            evaluate(plans, system, at, work)
            transforms, last = transforms + 2, 0.0
            opened, tension, overlap = _judge(system, at, contact, work, shift)
        if max(opened, tension, overlap) <= tolerance:
            return True, transforms, iteration
        # What overlaps joins at once; what pulls leaves when the pressure is known well enough.
        takes = overlap > max(opened, tolerance)
        settled = opened <= _WELL_UNDER * tension and moved <= _SETTLED * tension * work.scales[0]
        leaves = tension > 0.0 and (settled or opened <= tolerance)
        restart = takes or leaves
        if restart:
            if done == rounds:
                break
            changed = update(at.p, at.gap, contact, bank, shift, bool(exact[0]), leaves, done)
            done += 1
            if changed:
                _carry(system, at, contact, carried)
                evaluate(plans, system, at, work)
                transforms += 2
            if exact[0]:
                list_near(contact)
            last, since, moved = 0.0, 0, 0.0
            continue
        if since == _PATIENCE and not plain:
            # Rounding in the span of the directions is what is left to blame.
            plain, last = True, 0.0
            bank.deflating[:] = False
        since += 1
        # z = kappa r, the pressure that would close the gaps, were there no end to the contact.
        _precondition(plans, system, at, contact, work, shift)
        previous, slot = slot, free_slot(bank)
        product, slope = direct(
            system, at, contact, bank, work, shift, slot, previous, 1.0 / last if last > 0.0 else 0.0
        )
        _apply(plans, system, bank, work, slot)
        transforms += 4
        curvature = dot(contact, bank.direction[slot], bank.change[slot])
        if not (curvature > 0.0 and slope > 0.0):
            if plain:
                break
            since = _PATIENCE
            continue
        bank.age[slot] = bank.age.max() + 1
        step(at, contact, bank, slot, slope / curvature)
        moved = motion(contact, bank.direction[slot]) * slope / curvature
        exact[0], last = False, product
    if not exact[0]:
        _carry(system, at, contact, carried)
        evaluate(plans, system, at, work)
        transforms += 2
        _judge(system, at, contact, work, shift)
    return False, transforms, iteration


@kernel(reorder=True)
def evaluate(plans: Plans, system: System, at: Iterate, work: Work) -> None:
    """Gap of the pressure, at every point, and the level from which depths count."""
    forward(plans, at.p, at.spectrum)
    for k in range(work.spectrum.size):
        work.spectrum[k] = system.compliance[k] * at.spectrum[k]
    backward(plans, work.spectrum, at.gap)
    for i in range(at.gap.size):
        at.gap[i] += system.gap0[i]
    work.level[0] = system.yielding * at.spectrum[0].real - work.level[1]
    work.level[2], work.exact[0] = 0.0, True


@kernel
def _carry(system: System, at: Iterate, contact: ContactSet, carried: float) -> None:
    """Let the contact carry a given load.

    Points that pulled have left it, and steps much larger than the load have by rounding a mean of their own.
    """
    if system.load:
        total = at.p.sum()
        factor = carried / total if total > 0.0 else 1.0
        for k in range(contact.counts[0]):
            for i in range(contact.runs[k, 0], contact.runs[k, 1]):
                at.p[i] *= factor


@kernel(reorder=True)
def _precondition(
    plans: Plans, system: System, at: Iterate, contact: ContactSet, work: Work, shift: float
) -> None:
    """Work.z = kappa r, everywhere."""
    work.z[:] = 0.0
    for k in range(contact.counts[0]):
        z = work.z[contact.runs[k, 0] : contact.runs[k, 1]]
        gap = at.gap[contact.runs[k, 0] : contact.runs[k, 1]]
        for i in range(z.size):
            z[i] = shift - gap[i]
    forward(plans, work.z, work.spectrum)
    for k in range(work.spectrum.size):
        work.spectrum[k] *= system.stiffness[k]
    backward(plans, work.spectrum, work.z)


@kernel(reorder=True)
def _apply(plans: Plans, system: System, bank: Bank, work: Work, slot: int) -> None:
    """What the direction does to the gaps."""
    forward(plans, bank.direction[slot], work.spectrum)
    for k in range(work.spectrum.size):
        work.spectrum[k] *= system.compliance[k]
    backward(plans, work.spectrum, bank.change[slot])


@kernel(reorder=True)
def _judge(
    system: System, at: Iterate, contact: ContactSet, work: Work, shift: float
) -> tuple[float, float, float]:
    """Span of the gaps in the contact, tension there, and overlap where the gap is known, each scaled.

    Under a given load the depth is set first, so that the gap in the contact is right in the mean.
    """
    if system.load and contact.counts[2] > 0:
        excess = mean(contact, at.gap) - shift
        work.level[0] -= excess
        work.level[2] += excess
        if work.exact[0]:
            for i in range(at.gap.size):
                at.gap[i] -= excess
        else:
            for k in range(contact.counts[1]):
                for i in range(contact.near[k, 0], contact.near[k, 1]):
                    at.gap[i] -= excess
    highest, deepest, lowest, largest = 0.0, 0.0, 0.0, 0.0
    for k in range(contact.counts[0]):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            highest = max(highest, at.gap[i] - shift)
            deepest = min(deepest, at.gap[i] - shift)
            lowest = min(lowest, at.p[i])
            largest = max(largest, at.p[i])
    overlap, below = 0.0, work.scales[1] + min(work.level[0], 0.0)
    if work.exact[0]:
        overlap, below = _outside(system, at, contact, shift)
    else:
        for k in range(contact.counts[1]):
            for i in range(contact.near[k, 0], contact.near[k, 1]):
                overlap = min(overlap, at.gap[i] - shift + _FAR * contact.member[i])
                below = max(below, at.gap[i] - system.h[i])
    work.scales[0], work.scales[1] = scales(largest, below - min(work.level[0], 0.0), system.least)
    return (highest - deepest) / work.scales[1], -lowest / work.scales[0], -overlap / work.scales[1]


@kernel(reorder=True)
def _outside(system: System, at: Iterate, contact: ContactSet, shift: float) -> tuple[float, float]:
    """Overlap outside the contact, as a gap, and deepest point."""
    overlap, below = np.zeros(LANES), np.full(LANES, -_FAR)
    for first in range(0, at.gap.size, LANES):
        gap, h = at.gap[first : first + LANES], system.h[first : first + LANES]
        member = contact.member[first : first + LANES]
        for i in range(gap.size):
            outside = gap[i] - shift + _FAR * member[i]
            overlap[i] = outside if outside < overlap[i] else overlap[i]
            depth = gap[i] - h[i]
            below[i] = depth if depth > below[i] else below[i]
    return overlap.min(), below.max()
