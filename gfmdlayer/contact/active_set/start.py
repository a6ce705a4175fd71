"""The start of the active-set solver: a guess, or what is known from the last step; see `active_set`."""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.active_set.deflation import free_slot
from gfmdlayer.contact.active_set.state import Bank, ContactSet, Past, Work, let_go, list_runs
from gfmdlayer.contact.pressure_form import Iterate, System
from gfmdlayer.grid.transforms import Plans, backward
from gfmdlayer.kernels import kernel

_SMALLEST = 1e-5  # increment, as part of the pressure, that is more than the rounding of a difference


@kernel(reorder=True)
def start(
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
) -> None:
    """Begin with the guess or, where as good, the last pressure, whose gap is known.

    ``load`` is the mean pressure where it is given; ``keep`` tells whether the last pressure belongs to the
    same stiffness. Half a pair of transforms.
    """
    _release(plans, system, b, free, at, work)
    if system.load:
        _carry(system, guess, load, work.z)
        guess = work.z
    work.exact[0] = begin(at, contact, bank, guess, keep)
    if work.exact[0]:
        mean = at.p.mean() if system.load else 1.0
        _keep_increment(system, at, contact, bank, work, past, mean)
        if system.load:
            _rescale(system, at, work, load / mean)
        _set_level(system, at, work)


@kernel(reorder=True)
def _carry(system: System, guess: FloatArray, load: float, p: FloatArray) -> None:
    """Write the guess, which may be anything, as a pressure that carries the load."""
    total = 0.0
    for i in range(p.size):
        p[i] = guess[i] if guess[i] > 0.0 else 0.0
        total += p[i]
    if not (0.0 < total < np.inf and load * p.size / total < np.inf):
        p[:] = 0.0
        p[np.argmin(system.gap0)] = total = 1.0
    share = load * p.size / total
    for i in range(p.size):
        p[i] *= share


@kernel(reorder=True)
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


@kernel(reorder=True)
def _keep_increment(
    system: System, at: Iterate, contact: ContactSet, bank: Bank, work: Work, past: Past, mean: float
) -> None:
    """Keep what the last step added to the pressure as a direction, if the contact set stayed as it was.

    Under a given load it has no mean.
    """
    before, change_before, level = past.pressure, past.change, work.level[2]
    if past.listed[0] == contact.counts[3]:
        scale = mean / past.mean[0]
        bank.deflating[:] = False
        slot = free_slot(bank)
        direction, change = bank.direction[slot], bank.change[slot]
        if bank.age[slot] == 0:
            direction[:] = 0.0
        largest, moved = 0.0, 0.0
        for k in range(contact.counts[0]):
            for i in range(contact.runs[k, 0], contact.runs[k, 1]):
                direction[i] = at.p[i] - scale * before[i]
                largest, moved = max(largest, at.p[i]), max(moved, abs(direction[i]))
        for i in range(change_before.size):
            change[i] = at.gap[i] - system.gap0[i] + level - scale * change_before[i]
        bank.age[slot] = bank.age.max() + 1 if moved > _SMALLEST * largest else 0
    for i in range(change_before.size):
        change_before[i] = at.gap[i] - system.gap0[i] + level
    for k in range(contact.counts[0]):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            before[i] = at.p[i]
    past.mean[0], past.listed[0] = mean, contact.counts[3]


@kernel(reorder=True)
def _rescale(system: System, at: Iterate, work: Work, factor: float) -> None:
    """Multiply the pressure; gap and transform follow."""
    for i in range(at.p.size):
        at.p[i] *= factor
        at.gap[i] = system.gap0[i] + factor * (at.gap[i] - system.gap0[i] + work.level[2])
    for k in range(at.spectrum.size):
        at.spectrum[k] *= factor
    work.level[2] = 0.0


@kernel
def _set_level(system: System, at: Iterate, work: Work) -> None:
    """The level from which depths count, of a pressure that is known while the surface without it is new."""
    work.level[0] = system.yielding * at.spectrum[0].real - work.level[1]


@kernel(reorder=True)
def _release(
    plans: Plans, system: System, b: ComplexArray, free: ComplexArray, at: Iterate, work: Work
) -> None:
    """The surface without pressure: its transform per point, and its gap; the gap under pressure follows."""
    for k in range(free.size):
        free[k] = system.compliance[k] * b[k]
        work.spectrum[k] = free[k]
    work.level[1] = free[0].real
    backward(plans, work.spectrum, work.z)
    gap, gap0, h = at.gap, system.gap0, system.h
    for i in range(gap0.size):
        now = h[i] - work.z[i]
        gap[i] += now - gap0[i]
        gap0[i] = now
