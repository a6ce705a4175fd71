"""The start of the active-set solver: a guess, or what is known from the last step; see `active_set`."""

from __future__ import annotations

import numba as nb

from gfmdlayer.contact.active_set_state import Bank, ContactSet, Work, let_go, list_runs
from gfmdlayer.contact.deflation import free_slot
from gfmdlayer.contact.dual import Iterate, System
from gfmdlayer.contact.grid import FloatArray
from gfmdlayer.contact.problem import FASTMATH
from gfmdlayer.contact.transforms import ComplexArray, Plans, backward

_SMALLEST = 1e-5  # increment, as part of the pressure, that is more than the rounding of a difference


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def begin(at: Iterate, contact: ContactSet, bank: Bank, guess: FloatArray, keep: bool) -> bool:
    """Take a guess of the pressure over, and the contact set that it shows.

    Where the set is the one of the last step and ``keep`` allows it, the pressure of the last step stays
    instead, whose gap is known; returns whether it does.
    """
    joined, left = 0.0, 0.0
    for i in range(guess.size):
        touches = 1.0 if guess[i] > 0.0 else 0.0
        joined += touches * (1.0 - contact.member[i])
        left += (1.0 - touches) * contact.member[i]
    if keep and joined + left == 0.0:
        return True
    if left > 0.0:
        for k in range(contact.counts[0]):
            for i in range(contact.runs[k, 0], contact.runs[k, 1]):
                if not guess[i] > 0.0:
                    let_go(contact, bank, at.p, i)
    for i in range(guess.size):
        at.p[i] = guess[i] if guess[i] > 0.0 else 0.0
        contact.member[i] = 1.0 if guess[i] > 0.0 else 0.0
    if joined + left > 0.0:
        list_runs(contact)
    return False


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def keep_increment(
    system: System,
    at: Iterate,
    contact: ContactSet,
    bank: Bank,
    work: Work,
    past: FloatArray,
    past_change: FloatArray,
    known: bool,
    scale: float,
) -> None:
    """Keep what the last step added to the pressure as a direction, with the contact set as it was.

    Parameters
    ----------
    past, past_change
        The pressure one step earlier, in the contact, and A times it; brought up to date.
    known
        Whether they are of the same contact set.
    scale
        The last mean pressure over the one before, where the load is given; else 1.
    """
    if known:
        bank.deflating[:] = False
        slot = free_slot(bank)
        direction, change = bank.direction[slot], bank.change[slot]
        if bank.age[slot] == 0:
            direction[:] = 0.0
        largest, moved = 0.0, 0.0
        for k in range(contact.counts[0]):
            for i in range(contact.runs[k, 0], contact.runs[k, 1]):
                direction[i] = at.p[i] - scale * past[i]
                largest, moved = max(largest, at.p[i]), max(moved, abs(direction[i]))
        for i in range(past.size):
            change[i] = at.gap[i] - system.gap0[i] + work.level[2] - scale * past_change[i]
        bank.age[slot] = bank.age.max() + 1 if moved > _SMALLEST * largest else 0
    for i in range(past.size):
        past_change[i] = at.gap[i] - system.gap0[i] + work.level[2]
    for k in range(contact.counts[0]):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            past[i] = at.p[i]


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def rescale(system: System, at: Iterate, work: Work, factor: float) -> None:
    """Multiply the pressure; gap and transform follow."""
    for i in range(at.p.size):
        at.p[i] *= factor
        at.gap[i] = system.gap0[i] + factor * (at.gap[i] - system.gap0[i] + work.level[2])
    for k in range(at.spectrum.size):
        at.spectrum[k] *= factor
    work.level[2] = 0.0


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def release(
    plans: Plans,
    compliance: FloatArray,
    b: ComplexArray,
    h: FloatArray,
    free: ComplexArray,
    work: Work,
    gap: FloatArray,
    gap0: FloatArray,
) -> None:
    """The surface without pressure: its transform per point, and its gap; the gap under pressure follows."""
    for k in range(free.size):
        free[k] = compliance[k] * b[k]
        work.spectrum[k] = free[k]
    work.level[1] = free[0].real
    backward(plans, work.spectrum, work.z)
    for i in range(gap0.size):
        now = h[i] - work.z[i]
        gap[i] += now - gap0[i]
        gap0[i] = now
