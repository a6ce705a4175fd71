"""The compiled loop of the active-set solver; see `active_set` for the method and its symbols."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

from gfmdlayer.contact.grid import FloatArray
from gfmdlayer.contact.problem import FASTMATH, scales
from gfmdlayer.contact.transforms import ComplexArray, Plans, backward, forward

IndexArray = npt.NDArray[np.int64]

# Points that pull are let go once the gaps in the contact are this part of what is wrong with the set.
_WELL_UNDER = 0.1
_INDEPENDENT = 1e-8  # part of a direction, in energy, that those before it do not hold already
_NEAR = 30.0  # multiple of the tolerance below which the gaps outside the contact are looked at
_LARGEST_LIFT = 1e-3  # beyond it scaling the pressure is no small correction
_BLOCK = 2048  # points that stay in the first cache while the directions are added up
_FAR = 1e300  # added to the gaps in the contact where only the others count


class System(NamedTuple):
    """The problem in pressures, in units of one grid point: gap = gap0 + A p."""

    compliance: FloatArray  # A: 1/kappa, and 0 at q = 0 where the mean of u is fixed or the load is given
    stiffness: FloatArray  # kappa, the preconditioner
    gap0: FloatArray  # gap without pressure
    h: FloatArray
    softest: float  # kappa_1
    load: bool  # whether the mean of p is given, and the gap known up to a shift only


class Iterate(NamedTuple):
    """Pressure, gap and contact set."""

    p: FloatArray
    gap: FloatArray  # kept up in the contact, elsewhere as of the last `spread`
    base: FloatArray  # gap of the pressure with which the present contact set was begun
    spectrum: ComplexArray  # transform of that pressure
    contact: FloatArray  # 1 in the contact set C, 0 elsewhere
    points: IndexArray  # the points of C; the first ``size[0]`` entries count
    size: IndexArray


class Bank(NamedTuple):
    """Directions and what they do; row 0 is the pressure itself, the others are kept from one step to the next.

    Rows are longer than the fields, so that each begins where FFTW wants it.
    """

    direction: FloatArray
    change: FloatArray  # A direction
    spectrum: ComplexArray  # transform of the direction
    age: IndexArray  # order in which they came, 0 for none
    deflating: npt.NDArray[np.bool_]  # whether the solve is kept conjugate to it
    length: FloatArray  # how far the pressure has gone along it since the present contact set was begun
    gram: FloatArray  # direction_i A direction_j, factored


class Work(NamedTuple):
    """Work arrays."""

    z: FloatArray
    spectrum: ComplexArray
    coefficients: FloatArray
    scales: FloatArray  # of pressure and gap in the residual
    offset: FloatArray  # shift of the gaps under a given load; one entry


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
    """Find the contact set and its pressure; return whether they were found, the transforms and the iterations.

    The gap in the contact is brought to ``shift``. Ends without success after ``rounds`` changes of the set or
    ``limit`` iterations.
    """
    transforms = 2
    _evaluate(plans, system, at, bank, work)
    restart, last, slot = True, 1.0, 0
    for iteration in range(limit):
        if restart:
            _deflate(system, at, bank, work, shift)
        opened, tension = _judge(system, at, work, shift)
        overlap = 0.0
        if restart or opened <= _NEAR * tolerance:
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
            if _update(at, bank, shift):
                transforms += 2
                _evaluate(plans, system, at, bank, work)
            else:
                begin_set(at, bank, work)
            restart = True
            continue
        # z = M r, the pressure that would close the gaps, were there no end to the contact.
        _precondition(plans, system, at, work, shift)
        previous, slot = slot, _free_slot(bank)
        if slot == 0:
            # All rows are in use: add up what they have done.
            spread(system, at, bank, work, shift)
            begin_set(at, bank, work)
            slot = _free_slot(bank)
        product, slope = _direct(system, at, bank, work, shift, slot, previous, 0.0 if restart else 1.0 / last)
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
        _step(at, bank, slot, slope / curvature)
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
        at.gap[i] = at.base[i]
    bank.length[:] = 0.0
    work.offset[0] = 0.0


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def begin_set(at: Iterate, bank: Bank, work: Work) -> None:
    """Count the steps along the directions from here."""
    for j in range(bank.length.size):
        if bank.length[j] != 0.0:
            for k in range(at.spectrum.size):
                at.spectrum[k] += bank.length[j] * bank.spectrum[j, k]
    for i in range(at.gap.size):
        at.base[i] = at.gap[i]
    bank.length[:] = 0.0
    work.offset[0] = 0.0


@nb.njit(nogil=True, cache=True, fastmath={*FASTMATH, "nnan", "nsz"})
def spread(system: System, at: Iterate, bank: Bank, work: Work, shift: float) -> float:
    """Bring the gaps outside the contact up to date; return the overlap there, and set the scale of the gaps."""
    n = at.gap.size
    for first in range(0, n, _BLOCK):
        end = min(first + _BLOCK, n)
        for i in range(first, end):
            at.gap[i] = at.base[i] + work.offset[0]
        for j in range(bank.length.size):
            length = bank.length[j]
            if length != 0.0:
                for i in range(first, end):
                    at.gap[i] += length * bank.change[j, i]
    overlap, deepest = 0.0, 0.0
    for i in range(n):
        outside = at.gap[i] - shift + _FAR * at.contact[i]
        overlap = outside if outside < overlap else overlap
        below = at.gap[i] - system.h[i]
        deepest = below if below > deepest else deepest
    work.scales[1] = max(deepest, 1e-300)
    return -overlap / work.scales[1]


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
def _update(at: Iterate, bank: Bank, shift: float) -> bool:
    """The primal-dual step: let go what pulls, take in what overlaps; return whether the pressure changed."""
    changed = False
    for i in range(at.p.size):
        if at.contact[i] > 0.0:
            if at.p[i] < 0.0:
                let_go(at, bank, i)
                changed = True
        elif at.gap[i] < shift:
            at.contact[i] = 1.0
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


@nb.njit(nogil=True, cache=True)
def _free_slot(bank: Bank) -> int:
    """The row of the oldest direction that the solve does not need."""
    best = 0
    for j in range(1, bank.age.size):
        if not bank.deflating[j] and bank.length[j] == 0.0 and (best == 0 or bank.age[j] < bank.age[best]):
            best = j
    return best


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def _deflate(system: System, at: Iterate, bank: Bank, work: Work, shift: float) -> None:
    """Minimise over the span of the pressure and the newest directions, which needs no transform."""
    rows = bank.age.size
    bank.deflating[:] = False
    # Under a given load the pressure cannot be scaled.
    if not system.load and at.size[0] > 0:
        for i in range(at.p.size):
            bank.direction[0, i] = at.p[i]
            bank.change[0, i] = at.base[i] - system.gap0[i]
        for k in range(at.spectrum.size):
            bank.spectrum[0, k] = at.spectrum[k]
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
            _step(at, bank, j, c[j])


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def _step(at: Iterate, bank: Bank, j: int, length: float) -> None:
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
def _direct(
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


@nb.njit(nogil=True, cache=True, fastmath=FASTMATH)
def raise_clear(system: System, at: Iterate, u: FloatArray, pressure: FloatArray) -> tuple[float, float]:
    """Write pressure and displacement of a state that overlaps nowhere; return what the pressure was raised by.

    Under a given load the depth gives way, elsewhere the pressure grows by the factor 1 + lift. The overlap that this leaves is
    clamped, and returned.
    """
    n = at.gap.size
    lift, lowest = 0.0, 0.0
    for i in range(n):
        if at.gap[i] < 0.0:
            lowest = min(lowest, at.gap[i])
            effect = at.gap[i] - system.gap0[i]
            if effect > 0.0:
                lift = max(lift, -at.gap[i] / effect)
    shift = 0.0
    if system.load:
        lift, shift = 0.0, -lowest
    elif lift > _LARGEST_LIFT:
        lift = 0.0
    left = 0.0
    for i in range(n):
        gap = at.gap[i] + shift + lift * (at.gap[i] - system.gap0[i])
        left = max(left, -gap)
        u[i] = system.h[i] - max(gap, 0.0)
        pressure[i] = (1.0 + lift) * at.p[i]
    return lift, left
