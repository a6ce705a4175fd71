"""Directions of conjugate gradients that stay useful, and the span that the solve is kept conjugate to.

The pressure itself and the newest directions of earlier contact sets and time steps span a space over which
the energy is minimised at no cost in transforms; new directions are made conjugate to it (deflation: Saad,
Yeung, Erhel and Guyomarc'h, SIAM J. Sci. Comput. 21 (2000) 1909).
"""

from __future__ import annotations

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.active_set.state import Bank, ContactSet, Work, add, dot, mean
from gfmdlayer.contact.pressure_form import Iterate, System
from gfmdlayer.kernels import kernel

_INDEPENDENT = 1e-6  # part of a direction, in energy, that those before it do not hold already
_STRETCH = 30  # points that cost as much as going from one stretch of the contact to the next
_PASSES = 4.0  # over the whole surface, that all directions together may cost


@kernel
def free_slot(bank: Bank) -> int:
    """The row of the oldest direction that the solve does not need."""
    best = 0
    for j in range(1, bank.age.size):
        if not bank.deflating[j] and (best == 0 or bank.age[j] < bank.age[best]):
            best = j
    return best


@kernel
def deflate(system: System, at: Iterate, contact: ContactSet, bank: Bank, work: Work, shift: float) -> bool:
    """Minimise over the span of the pressure and the newest directions; return whether there were any.

    This needs no transform.
    """
    rows, points = bank.age.size, contact.counts[2]
    bank.deflating[:] = False
    if points == 0:
        return False
    # Under a given load the pressure cannot be scaled.
    if not system.load:
        _hold_pressure(system, at, contact, bank)
        bank.deflating[0] = True
    worth = int(_PASSES * at.p.size / (points + _STRETCH * contact.counts[0]))
    for _ in range(min((rows - 1) // 2, worth)):
        newest = 0
        for j in range(1, rows):
            if not bank.deflating[j] and bank.age[j] > 0 and (newest == 0 or bank.age[j] > bank.age[newest]):
                newest = j
        if newest > 0:
            bank.deflating[newest] = True
    _factor(contact, bank)
    c = work.coefficients
    for _ in range(2):  # the second time for what the factors, of rows that are nearly dependent, got wrong
        _residual(at, contact, work.z, shift)
        for j in range(rows):
            c[j] = dot(contact, bank.direction[j], work.z) if bank.deflating[j] else 0.0
        _solve_factored(bank, c)
        for j in range(rows):
            if bank.deflating[j]:
                step(at, contact, bank, j, c[j])
    return bool(bank.deflating.any())


@kernel(reorder=True)
def _hold_pressure(system: System, at: Iterate, contact: ContactSet, bank: Bank) -> None:
    """Take the pressure as row 0."""
    direction, change = bank.direction[0], bank.change[0]
    for k in range(contact.counts[0]):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            direction[i] = at.p[i]
    for k in range(contact.counts[1]):
        for i in range(contact.near[k, 0], contact.near[k, 1]):
            change[i] = at.gap[i] - system.gap0[i]


@kernel
def step(at: Iterate, contact: ContactSet, bank: Bank, j: int, length: float) -> None:
    """Go along a direction; the gap follows in the contact and near it."""
    add(contact.runs, contact.counts[0], length, bank.direction[j], at.p)
    add(contact.near, contact.counts[1], length, bank.change[j], at.gap)


@kernel
def _factor(contact: ContactSet, bank: Bank) -> None:
    """Factor the Gram matrix of the deflation as L D L^T, leaving out what depends on what came before."""
    gram, used = bank.gram, bank.deflating
    for j in range(used.size):
        if not used[j]:
            continue
        for i in range(j + 1):
            gram[j, i] = dot(contact, bank.direction[j], bank.change[i]) if used[i] else 0.0
        alone = gram[j, j]
        for i in range(j):
            if used[i]:
                for k in range(i):
                    if used[k]:
                        gram[j, i] -= gram[j, k] * gram[i, k] * gram[k, k]
                gram[j, i] /= gram[i, i]
        for i in range(j):
            if used[i]:
                gram[j, j] -= gram[j, i] ** 2 * gram[i, i]
        used[j] = gram[j, j] > _INDEPENDENT * alone


@kernel
def _solve_factored(bank: Bank, c: FloatArray) -> None:
    """Solve with the factors, in place; entries of what was left out are not touched."""
    gram, used = bank.gram, bank.deflating
    for j in range(c.size):
        for i in range(j):
            if used[i] and used[j]:
                c[j] -= gram[j, i] * c[i]
    for j in range(c.size):
        if used[j]:
            c[j] /= gram[j, j]
    for j in range(c.size - 1, -1, -1):
        for i in range(j):
            if used[i] and used[j]:
                c[i] -= gram[j, i] * c[j]


@kernel(reorder=True)
def _residual(at: Iterate, contact: ContactSet, z: FloatArray, shift: float) -> None:
    """Write how far the gaps in the contact are from the one that is aimed at."""
    for k in range(contact.counts[0]):
        zs = z[contact.runs[k, 0] : contact.runs[k, 1]]
        gaps = at.gap[contact.runs[k, 0] : contact.runs[k, 1]]
        for i in range(zs.size):
            zs[i] = shift - gaps[i]


@kernel(reorder=True)
def direct(
    system: System,
    at: Iterate,
    contact: ContactSet,
    bank: Bank,
    work: Work,
    shift: float,
    slot: int,
    previous: int,
    memory: float,
) -> tuple[float, float]:
    """Put the next direction of deflated conjugate gradients into a row of the bank; return r.z and r.d.

    Under a given load directions have no mean.
    """
    z, c, d = work.z, work.coefficients, bank.direction[slot]
    runs, count = contact.runs, contact.counts[0]
    if system.load:
        excess = mean(contact, z)
        for k in range(count):
            for i in range(runs[k, 0], runs[k, 1]):
                z[i] -= excess
    for j in range(c.size):
        c[j] = dot(contact, bank.change[j], z) if bank.deflating[j] else 0.0
    _solve_factored(bank, c)
    product = _against_residual(at, contact, z, shift)
    memory *= product
    if bank.age[slot] == 0:
        d[:] = 0.0  # it moves points that have left the contact
    if memory > 0.0:
        before = bank.direction[previous]
        for k in range(count):
            for i in range(runs[k, 0], runs[k, 1]):
                d[i] = z[i] + memory * before[i]
    else:
        for k in range(count):
            for i in range(runs[k, 0], runs[k, 1]):
                d[i] = z[i]
    for j in range(c.size):
        if bank.deflating[j]:
            add(runs, count, -c[j], bank.direction[j], d)
    return product, _against_residual(at, contact, d, shift)


@kernel(reorder=True)
def _against_residual(at: Iterate, contact: ContactSet, x: FloatArray, shift: float) -> float:
    total = 0.0
    for k in range(contact.counts[0]):
        xs = x[contact.runs[k, 0] : contact.runs[k, 1]]
        gaps = at.gap[contact.runs[k, 0] : contact.runs[k, 1]]
        for i in range(xs.size):
            total += (shift - gaps[i]) * xs[i]
    return total
