"""Directions of conjugate gradients that stay useful, and the span that the solve is kept conjugate to.

The pressure itself and the newest directions of earlier contact sets and time steps span a space over which
the energy is minimised at no cost in transforms; new directions are made conjugate to it (deflation: Saad,
Yeung, Erhel and Guyomarc'h, SIAM J. Sci. Comput. 21 (2000) 1909).
"""

from __future__ import annotations

import numba as nb

from gfmdlayer.contact.active_set_state import Bank, Iterate, System, Work
from gfmdlayer.contact.grid import FloatArray
from gfmdlayer.contact.problem import FASTMATH

_INDEPENDENT = 1e-8  # part of a direction, in energy, that those before it do not hold already


@nb.njit(nogil=True, cache=True)
def free_slot(bank: Bank) -> int:
    """The row of the oldest direction that the solve does not need."""
    best = 0
    for j in range(1, bank.age.size):
        if not bank.deflating[j] and bank.length[j] == 0.0 and (best == 0 or bank.age[j] < bank.age[best]):
            best = j
    return best


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def deflate(system: System, at: Iterate, bank: Bank, work: Work, shift: float) -> None:
    """Minimise over the span of the pressure and the newest directions, which needs no transform."""
    rows = bank.age.size
    bank.deflating[:] = False
    # Under a given load the pressure cannot be scaled.
    if not system.load and at.size[0] > 0:
        for m in range(at.size[0]):
            i = at.points[m]
            bank.direction[0, i] = at.p[i]
            bank.change[0, i] = at.base[i] - system.gap0[i]
        bank.deflating[0] = True
    for _ in range((rows - 1) // 2):
        newest = 0
        for j in range(1, rows):
            if not bank.deflating[j] and bank.age[j] > 0 and (newest == 0 or bank.age[j] > bank.age[newest]):
                newest = j
        if newest > 0:
            bank.deflating[newest] = True
    _factor(at, bank)
    c = work.coefficients
    for j in range(rows):
        c[j] = 0.0
        if bank.deflating[j]:
            for m in range(at.size[0]):
                i = at.points[m]
                c[j] += bank.direction[j, i] * (shift - at.gap[i])
    _solve_factored(bank, c)
    for j in range(rows):
        if bank.deflating[j]:
            step(at, bank, j, c[j])


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def step(at: Iterate, bank: Bank, j: int, length: float) -> None:
    """Go along a direction, in the contact."""
    bank.length[j] += length
    for m in range(at.size[0]):
        i = at.points[m]
        at.p[i] += length * bank.direction[j, i]
        at.gap[i] += length * bank.change[j, i]


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def _factor(at: Iterate, bank: Bank) -> None:
    """Factor the Gram matrix of the deflation as L D L^T, leaving out what depends on what came before."""
    gram, used = bank.gram, bank.deflating
    for j in range(used.size):
        if not used[j]:
            continue
        for i in range(j + 1):
            gram[j, i] = 0.0
            if used[i]:
                for m in range(at.size[0]):
                    n = at.points[m]
                    gram[j, i] += bank.direction[j, n] * bank.change[i, n]
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


@nb.njit(nogil=True, cache=True)
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


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def direct(
    system: System,
    at: Iterate,
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
    z, c = work.z, work.coefficients
    mean = 0.0
    if system.load:
        for m in range(at.size[0]):
            mean += z[at.points[m]]
        mean /= at.size[0]
    product = 0.0
    for m in range(at.size[0]):
        i = at.points[m]
        z[i] -= mean
        product += (shift - at.gap[i]) * z[i]
    for j in range(c.size):
        c[j] = 0.0
        if bank.deflating[j]:
            for m in range(at.size[0]):
                i = at.points[m]
                c[j] += bank.change[j, i] * z[i]
    _solve_factored(bank, c)
    memory *= product
    if slot != previous or memory == 0.0:
        bank.direction[slot, :] = 0.0
    for m in range(at.size[0]):
        i = at.points[m]
        d = z[i] + (memory * bank.direction[previous, i] if memory > 0.0 else 0.0)
        for j in range(c.size):
            if bank.deflating[j]:
                d -= c[j] * bank.direction[j, i]
        bank.direction[slot, i] = d
    slope = 0.0
    for m in range(at.size[0]):
        i = at.points[m]
        slope += (shift - at.gap[i]) * bank.direction[slot, i]
    return product, slope
