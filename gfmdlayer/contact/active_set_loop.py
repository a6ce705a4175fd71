"""The compiled loop of the active-set solver; see `active_set` for the method and its symbols."""

from __future__ import annotations

import numba as nb

from gfmdlayer.contact.active_set_state import Bank, Iterate, System, Work
from gfmdlayer.contact.deflation import deflate, direct, free_slot, step
from gfmdlayer.contact.grid import FloatArray
from gfmdlayer.contact.problem import FASTMATH, scales
from gfmdlayer.contact.transforms import ComplexArray, Plans, backward, forward

# Points that pull are let go once the gaps in the contact are this part of what is wrong with the set.
_WELL_UNDER = 0.1
_NEAR = 30.0  # multiple of the tolerance below which the gaps outside the contact are looked at
_BLOCK = 2048  # points that stay in the first cache while the directions are added up
_FAR = 1e300  # added to the gaps in the contact where only the others count


@nb.njit(nogil=True, cache=True)
def iterate(
    plans: Plans,
    system: System,
    at: Iterate,
    bank: Bank,
    work: Work,
    shift: float,
    tolerance: float,
    rounds: int,
    limit: int,
) -> tuple[bool, int, int]:
    """Find the contact set and its pressure; return whether they were found, the transforms, the iterations.

    The gap in the contact is brought to ``shift``. Ends without success after ``rounds`` changes of the set
    or ``limit`` iterations.
    """
    transforms = 2
    _evaluate(plans, system, at, bank, work)
    restart, last, slot = True, 1.0, 0
    for iteration in range(limit):
        if restart:
            deflate(system, at, bank, work, shift)
        opened, tension = _judge(system, at, work, shift)
        overlap = 0.0
        if opened <= _NEAR * tolerance or (restart and _lowest_outside(at) < shift):
            overlap = spread(system, at, bank, work, shift)
        if max(opened, overlap, tension) <= tolerance:
            return True, transforms, iteration
        # What overlaps joins at once; what pulls leaves when the pressure is known well enough.
        takes = overlap > max(opened, tolerance)
        leaves = tension > 0.0 and opened <= max(_WELL_UNDER * tension, tolerance)
        if takes or leaves:
            if rounds == 0:
                return False, transforms, iteration
            rounds -= 1
            spread(system, at, bank, work, shift)
            if _update(system, at, bank, shift):
                transforms += 2
                _evaluate(plans, system, at, bank, work)
            else:
                begin_set(at, bank, work)
            restart = True
            continue
        # z = M r, the pressure that would close the gaps, were there no end to the contact.
        _precondition(plans, system, at, work, shift)
        previous, slot = slot, free_slot(bank)
        if slot == 0:
            # All rows are in use: add up what they have done.
            spread(system, at, bank, work, shift)
            begin_set(at, bank, work)
            slot = free_slot(bank)
        product, slope = direct(system, at, bank, work, shift, slot, previous, 0.0 if restart else 1.0 / last)
        _apply(plans, system, bank, work, slot)
        transforms += 4
        curvature = 0.0
        for m in range(at.size[0]):
            i = at.points[m]
            curvature += bank.direction[slot, i] * bank.change[slot, i]
        if not (curvature > 0.0 and slope > 0.0):
            spread(system, at, bank, work, shift)
            return False, transforms, iteration
        bank.age[slot] = bank.age.max() + 1
        step(at, bank, slot, slope / curvature)
        restart, last = False, product
    spread(system, at, bank, work, shift)
    return False, transforms, limit


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def _evaluate(plans: Plans, system: System, at: Iterate, bank: Bank, work: Work) -> None:
    """Gap of the pressures, from which the contact set is begun."""
    forward(plans, at.p, at.spectrum)
    for k in range(work.spectrum.size):
        work.spectrum[k] = system.compliance[k] * at.spectrum[k]
    backward(plans, work.spectrum, at.base)
    for i in range(at.gap.size):
        at.base[i] += system.gap0[i]
    for m in range(at.size[0]):
        at.gap[at.points[m]] = at.base[at.points[m]]
    bank.length[:] = 0.0
    work.offset[0] = 0.0


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def begin_set(at: Iterate, bank: Bank, work: Work) -> None:
    """Count the steps along the directions from here."""
    if bank.length[0] != 0.0:
        for k in range(at.spectrum.size):
            at.spectrum[k] *= 1.0 + bank.length[0]
    for j in range(1, bank.length.size):
        if bank.length[j] != 0.0:
            for k in range(at.spectrum.size):
                at.spectrum[k] += bank.length[j] * bank.spectrum[j, k]
    for i in range(at.gap.size):
        at.base[i] = at.gap[i]
    bank.length[:] = 0.0
    work.offset[0] = 0.0


@nb.njit(nogil=True, cache=True, fastmath={*FASTMATH, "nnan", "nsz"})
def _lowest_outside(at: Iterate) -> float:
    """Lowest gap outside the contact with which the contact set was begun."""
    lowest = _FAR
    for i in range(at.base.size):
        outside = at.base[i] + _FAR * at.contact[i]
        lowest = outside if outside < lowest else lowest
    return lowest


@nb.njit(nogil=True, cache=True)
def begin(at: Iterate, bank: Bank, guess: FloatArray) -> None:
    """Take a guess of the pressure over, and the contact set that it shows."""
    for i in range(guess.size):
        touches = guess[i] > 0.0
        if at.contact[i] > 0.0 and not touches:
            let_go(at, bank, i)
        at.p[i] = guess[i] if touches else 0.0
        at.contact[i] = 1.0 if touches else 0.0
    list_points(at)


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def release(
    plans: Plans,
    compliance: FloatArray,
    b: ComplexArray,
    h: FloatArray,
    free: ComplexArray,
    work: ComplexArray,
    gap0: FloatArray,
) -> None:
    """The surface without pressure: its transform per point, and its gap."""
    for k in range(free.size):
        free[k] = compliance[k] * b[k]
        work[k] = free[k]
    backward(plans, work, gap0)
    for i in range(gap0.size):
        gap0[i] = h[i] - gap0[i]


@nb.njit(nogil=True, cache=True, fastmath={*FASTMATH, "nnan", "nsz"})
def spread(system: System, at: Iterate, bank: Bank, work: Work, shift: float) -> float:
    """Bring the gaps outside the contact up to date, and their scale; return the overlap there."""
    n = at.gap.size
    for first in range(0, n, _BLOCK):
        end = min(first + _BLOCK, n)
        for i in range(first, end):
            at.gap[i] = at.base[i] + work.offset[0] + bank.length[0] * (at.base[i] - system.gap0[i])
        for j in range(1, bank.length.size):
            length = bank.length[j]
            if length != 0.0:
                for i in range(first, end):
                    at.gap[i] += length * bank.change[j, i]
    overlap, deepest, total = 0.0, -_FAR, 0.0
    for i in range(n):
        outside = at.gap[i] - shift + _FAR * at.contact[i]
        overlap = outside if outside < overlap else overlap
        below = at.gap[i] - system.h[i]
        deepest = below if below > deepest else deepest
        total += below
    work.scales[1] = max(deepest - min(total / n, 0.0), 1e-300)
    return float(-overlap / work.scales[1])


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def _precondition(plans: Plans, system: System, at: Iterate, work: Work, shift: float) -> None:
    """Work.z = kappa r, everywhere."""
    for i in range(work.z.size):
        work.z[i] = (shift - at.gap[i]) * at.contact[i]
    forward(plans, work.z, work.spectrum)
    for k in range(work.spectrum.size):
        work.spectrum[k] *= system.stiffness[k]
    backward(plans, work.spectrum, work.z)


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def _apply(plans: Plans, system: System, bank: Bank, work: Work, slot: int) -> None:
    """What the direction does to the gaps."""
    forward(plans, bank.direction[slot], bank.spectrum[slot])
    for k in range(work.spectrum.size):
        work.spectrum[k] = system.compliance[k] * bank.spectrum[slot, k]
    backward(plans, work.spectrum, bank.change[slot])


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def _judge(system: System, at: Iterate, work: Work, shift: float) -> tuple[float, float]:
    """Span of the gaps in the contact and the tension there, in the scales of the residual.

    Under a given load the depth is set first, so that the gap in the contact is right in the mean.
    """
    gap, p = at.gap, at.p
    if system.load and at.size[0] > 0:
        mean = 0.0
        for m in range(at.size[0]):
            mean += gap[at.points[m]]
        mean = mean / at.size[0] - shift
        for m in range(at.size[0]):
            gap[at.points[m]] -= mean
        work.offset[0] -= mean
    highest, deepest, lowest, largest = 0.0, 0.0, 0.0, 0.0
    for m in range(at.size[0]):
        i = at.points[m]
        highest = max(highest, gap[i] - shift)
        deepest = min(deepest, gap[i] - shift)
        lowest = min(lowest, p[i])
        largest = max(largest, p[i])
        if gap[i] - system.h[i] > work.scales[1]:
            work.scales[1] = gap[i] - system.h[i]
    work.scales[0], depth = scales(largest, work.scales[1], system.softest)
    return (highest - deepest) / depth, -lowest / work.scales[0]


@nb.njit(nogil=True, cache=True)
def _update(system: System, at: Iterate, bank: Bank, shift: float) -> bool:
    """The primal-dual step: let go what pulls, take in what overlaps; return whether the pressure changed.

    A given load is carried by the points that stay.
    """
    changed, load = False, at.p.sum()
    for i in range(at.p.size):
        if at.contact[i] > 0.0:
            if at.p[i] < 0.0:
                let_go(at, bank, i)
                changed = True
        elif at.gap[i] < shift:
            at.contact[i] = 1.0
    if changed and system.load:
        share = load / at.p.sum()
        for i in range(at.p.size):
            at.p[i] *= share
    list_points(at)
    return changed


@nb.njit(nogil=True, cache=True)
def let_go(at: Iterate, bank: Bank, i: int) -> None:
    """Take a point out of the contact, and with it the directions that move it."""
    at.contact[i] = 0.0
    at.p[i] = 0.0
    for j in range(1, bank.age.size):
        if bank.direction[j, i] != 0.0:
            bank.age[j] = 0


@nb.njit(nogil=True, cache=True)
def list_points(at: Iterate) -> None:
    """Write down the points of the contact set."""
    count = 0
    for i in range(at.contact.size):
        if at.contact[i] > 0.0:
            at.points[count] = i
            count += 1
    at.size[0] = count
