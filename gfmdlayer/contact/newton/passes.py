"""The compiled passes of `newton`: states of the surface, the linear system of a step, and its effects.

Stiffness and intercept are those per point, K/n and b/n, as unnormalised transforms need them. States are in
double precision, linear systems, whose solutions are corrections, in single.

`cap` is the hardness, the largest pressure of the wall, or None without one: kernels are compiled for either,
and those without a cap have no trace of it. Points that yield have u > h, or u = h and p_c > cap. They are
free, and p_c - cap is out of balance on them: beyond h their energy grows by cap - tau(0) per length.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.cycle import PRESSED, Cycle, run_cycle, set_cycle, set_one, unit_of
from gfmdlayer.contact.residual import ResidualFloor, scales, violation
from gfmdlayer.grid.sums import Completion, greatest, summed
from gfmdlayer.grid.transforms import Plans, backward, forward
from gfmdlayer.interface.forms import Terms, term
from gfmdlayer.kernels import LANES, filled, kernel

_NO_CURVATURE = 1e-6  # part of the elastic stiffness along a direction below which its curvature is rounding
_STIFF = 0.3  # curvature, over the stiffness of a point, from which on it outweighs the body's
_ROUNDING = 1e-15
_OF_SINGLE = 2e-7  # likewise in single precision


class AdhesiveSystem(NamedTuple):
    """The contact problem of a step."""

    kappa: FloatArray
    b: ComplexArray
    h: FloatArray
    terms: Terms
    strength: float  # largest traction of the interface
    range: float  # of the interface; the traction falls beyond it
    mean_is_fixed: bool
    load: float
    kappa_1: float  # kappa_1
    floor: ResidualFloor
    size: float  # number of points, of all ranks
    over: Completion


class AdhesiveState(NamedTuple):
    """A state: displacement, stress f without the multiplier, traction and curvature of the interface."""

    u: FloatArray
    stress: FloatArray
    traction: FloatArray
    curvature: FloatArray


class Origin(NamedTuple):
    """Where a step begins: the stress, and the tangent of the branch there with its elastic stress K d."""

    stress: FloatArray
    tangent: Any  # in single precision
    response: Any
    balance: FloatArray  # energy of the interface, and multiplier; NaN from rest


class FreeSystem(NamedTuple):
    """The linear system of a step, on the free points, and its solution.

    All but the first two are in single precision: forces in a unit of stress of the step, stiffnesses in
    that of `unit_of`, d in their ratio. Without a cycle the preconditioner takes a transform. With one the
    stiffness of the points is the D of its finest grid.
    """

    pressure: FloatArray  # p_c, which is out of balance on the free points
    spectrum: ComplexArray  # work
    free: Any  # 1 where the point moves, 0 where it is pressed
    d: Any
    force: Any  # stress out of balance after the step, to first order
    direction: Any
    applied: Any  # K times the direction
    z: Any  # preconditioned force
    share: Any  # root of the share of the body in the stiffness of a point; the interface has the rest
    point: Any  # compliance of the body at a point
    stiffness: Any  # curvature and damping, PRESSED of points that do not move
    kappa: Any
    softening: Any  # preconditioner, one value a mode
    work: Any  # spectrum
    response: Any  # K d
    cycle: Cycle


@kernel(reorder=True, inner=True)
def apply(plans: Plans, factor: Any, field: Any, work: Any, out: Any) -> None:
    """Multiply the modes of a field; one FFT pair, in single precision."""
    forward(plans, field, work)
    for k in range(work.size):
        work[k] *= factor[k]
    backward(plans, work, out)


@kernel(reorder=True, inner=True)
def set_stress(
    plans: Plans, system: AdhesiveSystem, at: AdhesiveState, spectrum: ComplexArray, work: ComplexArray
) -> None:
    """Write the transform of u, and the stress f = b - K u; one FFT pair, in double precision."""
    forward(plans, at.u, spectrum)
    kappa, b = system.kappa, system.b
    for k in range(work.size):
        real, imaginary = kappa[k] * spectrum[k].real, kappa[k] * spectrum[k].imag
        work[k] = complex(b[k].real - real, b[k].imag - imaginary)
    backward(plans, work, at.stress)


@kernel(reorder=True, inner=True)
def set_interaction(system: AdhesiveSystem, at: AdhesiveState, cap: Any) -> float:
    """Write traction and curvature of the interface; return the sum of its energy over the points.

    The energy is that of the gap, and of the flow where points yield.
    """
    total, terms = 0.0, system.terms
    for first in range(0, at.u.size, LANES):
        end = first + LANES
        h, u, traction, curvature = (
            system.h[first:end], at.u[first:end], at.traction[first:end], at.curvature[first:end],
        )  # fmt: skip
        traction[:], curvature[:] = 0.0, 0.0
        # The points are the inner loop, for the vector units.
        for k in range(terms.form.size):
            form, stress, length, width = terms.form[k], terms.stress[k], terms.length[k], terms.width[k]
            for i in range(u.size):
                gap = h[i] - u[i]
                if cap is not None:
                    gap = max(gap, 0.0)
                energy, pull, change = term(gap, form, stress, length, width)
                total += energy
                traction[i] += pull
                curvature[i] += change
        if cap is not None:
            for i in range(u.size):
                if u[i] > h[i]:
                    total += (cap - traction[i]) * (u[i] - h[i])
                    curvature[i] = 0.0
    return float(summed(system.over, (total,))[0])


@kernel(reorder=True, inner=True)
def balance(
    system: AdhesiveSystem, at: AdhesiveState, held: FloatArray, part: float, step: FreeSystem, cap: Any
) -> tuple[float, float, float, float, float]:
    """Find the free points, and the pressure of the wall, less the cap on points that yield.

    It is out of balance on the free points. `held` is a traction that holds the surface, of which a part is
    left. Returns the residual, lambda, the largest pressure out of balance, and of u the mean and the largest
    magnitude.
    """
    total, count, strongest, weakest, deepest, mean_u, largest_u = _open_pressure(
        system, at, held, part, step, cap
    )
    multiplier = system.load
    if system.mean_is_fixed:
        # In full contact any lambda that keeps the pressure positive will do.
        multiplier = -total / count if count > 0.0 else -weakest
    pressure_scale, depth = scales(strongest + multiplier, deepest, system.floor)
    per_pressure, per_gap, total, count = 1.0 / pressure_scale, 1.0 / depth, 0.0, 0.0
    worst, most, least = filled(LANES, 0.0), filled(LANES, -np.inf), filled(LANES, np.inf)
    for first in range(0, at.u.size, LANES):
        end = first + LANES
        h, u, ps, free = system.h[first:end], at.u[first:end], step.pressure[first:end], step.free[first:end]
        for i in range(u.size):
            value, gap = ps[i] + multiplier, h[i] - u[i]
            ps[i] = value
            off = violation(value, gap, per_pressure, per_gap)
            moves = 0.0 if (gap <= 0.0) & (value > 0.0) else 1.0
            if cap is not None and (gap < 0.0 or (gap <= 0.0 and value > cap)):
                value -= cap
                ps[i], off, moves = value, abs(value) * per_pressure, 1.0
                at.curvature[first + i] = 0.0  # as the point moves on to where it is
            worst[i] = off if off > worst[i] else worst[i]
            free[i] = moves
            up, down = (value, value) if moves > 0.0 else (-np.inf, np.inf)
            most[i] = up if up > most[i] else most[i]
            least[i] = down if down < least[i] else least[i]
            total += moves * value
            count += moves
    total, count = summed(system.over, (total, count))
    mean = total / count if system.mean_is_fixed and count > 0.0 else 0.0
    off, high, low = greatest(system.over, (worst.max(), most.max(), -least.min()))
    largest = max(high - mean, mean + low, 0.0)
    return off if np.isfinite(total) else np.nan, multiplier, largest, mean_u, largest_u


@kernel(reorder=True, inner=True)
def _open_pressure(
    system: AdhesiveSystem, at: AdhesiveState, held: FloatArray, part: float, step: FreeSystem, cap: Any
) -> tuple[float, float, float, float, float, float, float]:
    """Write the pressure but for the multiplier.

    Returns its sum over the points out of contact, their number, its extrema, the depth of the surface, and
    of u the mean and the largest magnitude. Points beyond h, whose pressure counts from the cap, belong to
    the sum and the number too.
    """
    total, count, mean = 0.0, 0.0, 0.0
    most, least = filled(LANES, -np.inf), filled(LANES, np.inf)
    highest, lowest = most.copy(), least.copy()
    for first in range(0, at.u.size, LANES):
        end = first + LANES
        h, u, ps, hold = system.h[first:end], at.u[first:end], step.pressure[first:end], held[first:end]
        stress, traction = at.stress[first:end], at.traction[first:end]
        for i in range(u.size):
            value = stress[i] + traction[i] - part * hold[i]
            ps[i] = value
            most[i] = value if value > most[i] else most[i]
            least[i] = value if value < least[i] else least[i]
            lowest[i] = u[i] if u[i] < lowest[i] else lowest[i]
            highest[i] = u[i] if u[i] > highest[i] else highest[i]
            mean += u[i]
            is_open = 1.0 if u[i] < h[i] else 0.0
            total += is_open * value
            count += is_open
            if cap is not None and u[i] > h[i]:
                total += value - cap
                count += 1.0
    total, count, mean = summed(system.over, (total, count, mean / system.size))
    strongest, weakest, top, bottom = greatest(
        system.over, (most.max(), -least.min(), highest.max(), -lowest.min())
    )
    return total, count, strongest, -weakest, max(mean, 0.0) + bottom, mean, max(top, bottom)


@kernel(reorder=True, inner=True)
def begin(
    single: Plans,
    system: AdhesiveSystem,
    curvature: FloatArray,
    step: FreeSystem,
    damping: float,
    lack: float,
    unit: float,
) -> int:
    """Begin with no step, or with one that lifts all free points by the lack; return the FFT pairs.

    `unit` is that of stress.
    """
    d, force, free, pressure = step.d, step.force, step.free, step.pressure
    stiffness, response = step.stiffness, step.response
    stiff = unit_of(system.kappa_1)
    # In SI units squares would underflow in single precision.
    per_unit, per_stiff = 1.0 / unit, 1.0 / stiff
    for i in range(d.size):
        d[i], response[i], force[i] = 0.0, 0.0, free[i] * pressure[i] * per_unit
        stiffness[i] = (curvature[i] + damping) * per_stiff if free[i] > 0.0 else PRESSED
    if step.cycle.grids.size > 0:
        set_cycle(step.cycle)
        set_one(step.cycle, step.direction)
    else:
        _set_softening(system, curvature, step, damping)
    if lack == 0.0:
        return 0
    pairs, lifts = 1, step.cycle.one
    if step.cycle.grids.size == 0:
        pairs, lifts = 1 + precondition(single, step, free, step.z)[0], step.z
    total = 0.0
    for i in range(d.size):
        total += lifts[i]
    (total,) = summed(system.over, (total,))
    far = lack * stiff / (unit * total)
    for i in range(d.size):
        d[i] = far * lifts[i]
    apply(single, step.kappa, d, step.work, response)
    for i in range(d.size):
        force[i] -= free[i] * (response[i] + stiffness[i] * d[i])
    return pairs


@kernel(reorder=True, inner=True)
def _set_softening(system: AdhesiveSystem, curvature: FloatArray, step: FreeSystem, damping: float) -> None:
    """Set the preconditioner that takes a transform."""
    n, total, stiff = system.size, 0.0, unit_of(system.kappa_1)
    (stiffest,) = greatest(system.over, (curvature.max(),))
    for k in range(step.softening.size):
        # The factor n^2 turns the stiffness per point into that for a backward transform.
        softening = stiff / (n * (n * system.kappa[k] + damping + 0.5 * system.kappa_1))
        step.softening[k] = softening
        total += softening
    total, count = summed(system.over, (total, float(step.softening.size)))
    step.point[0] = n * total / (_STIFF * count)
    step.share[:] = 1.0
    if stiffest > 0.0:
        compliance = step.point[0] / stiff
        for i in range(step.d.size):
            step.share[i] = 1.0 / np.sqrt(1.0 + compliance * max(curvature[i], 0.0))


@kernel(reorder=True, inner=True)
def precondition(single: Plans, step: FreeSystem, r: Any, z: Any) -> tuple[int, float, float]:
    """Write z = M r, M close to the inverse of K + w'' + damping, zero where points are pressed.

    Returns the FFT pairs, and the sums of z and r z. M is the cycle if there is one. Else
    M = S C S + (1 - S^2)/(k + w'') with C the inverse of K + damping + kappa_1/2, the stiffness k of the
    body at a point by itself, and S^2 = k/(k + w''), 1 where w'' < 0: points that the interface holds more
    stiffly than only the body answer.
    """
    if step.cycle.grids.size > 0:
        whole, along = run_cycle(step.cycle, r, z)
        return 0, whole, along
    share, free = step.share, step.free
    for i in range(z.size):
        z[i] = share[i] * r[i]
    apply(single, step.softening, z, step.work, z)
    for i in range(z.size):
        square = share[i] * share[i]
        z[i] = free[i] * (share[i] * z[i] + step.point[0] * square * (np.float32(1.0) - square) * r[i])
    total, across = 0.0, 0.0
    for i in range(z.size):
        total += z[i]
        across += z[i] * r[i]
    return 1, total, across


@kernel(inner=True)
def lifted(step: FreeSystem) -> Any:
    """Return the answer of M, as far as it knows the free points, to a pressure that is even on them."""
    return step.cycle.one if step.cycle.grids.size > 0 else step.free


@kernel(reorder=True, inner=True)
def minimise(
    single: Plans, system: AdhesiveSystem, step: FreeSystem, floor: float, inexact: float
) -> tuple[int, float]:
    """Solve (K + w'' + damping) d = p_c on the free points by preconditioned conjugate gradients.

    They go on from the given d and force, with the mean of the change of d zero where the mean is fixed.
    `floor` and `inexact` are the largest force that may be left on a point, and as a part of the first one.
    Returns the FFT pairs, and the curvature along the last direction, per area, where it is negative, else 0.
    All are in the units of the step.
    """
    direction, applied, z = step.direction, step.applied, step.z
    n, over, stiff = direction.size, system.over, unit_of(system.kappa_1)
    kappa_1, one, centred = system.kappa_1 / stiff, lifted(step), system.mean_is_fixed
    count, whole, pairs, last = 0.0, 0.0, 0, 1.0
    for i in range(n):
        count += step.free[i]
        whole += one[i]
    count, whole = summed(over, (count, whole))
    if count == 0.0:
        return 0, 0.0
    aim = max(floor, inexact * _centre(system, step, count))
    direction[:] = 0.0
    for iteration in range(_MOST):
        spent, total, across = precondition(single, step, step.force, z)
        pairs += 1 + spent
        total, across = summed(over, (total, across))
        mean = np.float32(total / whole if centred else 0.0)
        if centred and step.cycle.grids.size > 0:
            # The sum of force M 1 is that of M force. By transforms it is the sum of the forces, zero.
            across -= total * total / whole
        beta = np.float32(across / last if iteration > 0 else 0.0)
        last = across
        for i in range(n):
            direction[i] = z[i] - mean * one[i] + beta * direction[i]
        apply(single, step.kappa, direction, step.work, applied)
        elastic, along, square, total = summed(over, _curvatures(step))
        if square == 0.0:
            return pairs, 0.0
        if not along > _NO_CURVATURE * (elastic + kappa_1 * square):
            return pairs, min(along / square, -1e-300)
        (left,) = greatest(over, (_advance(across / along, total / count if centred else 0.0, step),))
        if left <= aim:
            return pairs, 0.0
    return pairs, 0.0


@kernel(reorder=True, inner=True)
def _curvatures(step: FreeSystem) -> tuple[float, float, float, float]:
    """Sums of s K s, s H s and s^2 for a direction s, and of H s over the free points.

    In single precision over few points only.
    """
    elastic, along, square, total = 0.0, 0.0, 0.0, 0.0
    for first in range(0, step.d.size, LANES):
        end = first + LANES
        none: Any = np.float32(0.0)
        ss, Ks, Ds = step.direction[first:end], step.applied[first:end], step.stiffness[first:end]
        sKs, sHs, s2, Hs = none, none, none, none
        for i in range(ss.size):
            s = ss[i]
            response = Ks[i] + Ds[i] * s
            sKs += s * Ks[i]
            sHs += s * response
            s2 += s * s
            Hs += response if Ds[i] < PRESSED else none
        elastic += sKs
        along += sHs
        square += s2
        total += Hs
    return elastic, along, square, total


@kernel(reorder=True, inner=True)
def _advance(way: float, mean: float, step: FreeSystem) -> float:
    """Go along the direction; return the largest force that is left."""
    largest, part, even, none = np.zeros(LANES, np.float32), np.float32(way), np.float32(mean), np.float32(0)
    for first in range(0, step.d.size, LANES):
        end = first + LANES
        ds, fs, ss = step.d[first:end], step.force[first:end], step.direction[first:end]
        Ks, Ds, Kds = step.applied[first:end], step.stiffness[first:end], step.response[first:end]
        for i in range(ds.size):
            ds[i] += part * ss[i]
            Kds[i] += part * Ks[i]
            off = Ks[i] + Ds[i] * ss[i] - even
            left = fs[i] - part * (off if Ds[i] < PRESSED else none)
            fs[i] = left
            largest[i] = abs(left) if abs(left) > largest[i] else largest[i]
    return float(largest.max())


_MOST = 400  # iterations


@kernel(reorder=True, inner=True)
def _centre(system: AdhesiveSystem, step: FreeSystem, count: float) -> float:
    """Take the mean, which belongs to the multiplier, from the forces; return the largest."""
    total, largest = 0.0, np.zeros(LANES, np.float32)
    for i in range(step.d.size):
        total += step.force[i]
    (total,) = summed(system.over, (total,))
    mean: Any = np.float32(total / count if system.mean_is_fixed else 0.0)
    for first in range(0, step.d.size, LANES):
        force, free = step.force[first : first + LANES], step.free[first : first + LANES]
        for i in range(force.size):
            left = force[i] - mean * free[i]
            force[i] = left
            largest[i] = abs(left) if abs(left) > largest[i] else largest[i]
    return float(greatest(system.over, (float(largest.max()),))[0])


@kernel(reorder=True, inner=True)
def move(
    system: AdhesiveSystem,
    at: AdhesiveState,
    step: FreeSystem,
    far: float,
    mean: float,
    to: AdhesiveState,
    cap: Any,
) -> None:
    """Write the displacement after a step, `far` d, kept below the punch, and of points that yield above it.

    Where the mean is fixed it is restored by a shift of the points that do not touch.
    """
    shift, n = 0.0, system.size
    for turn in range(60):
        total, free = 0.0, 0.0
        most, least = filled(LANES, -np.inf), filled(LANES, np.inf)
        for first in range(0, to.u.size, LANES):
            end = first + LANES
            h, u, v, d = system.h[first:end], at.u[first:end], to.u[first:end], step.d[first:end]
            if turn == 0:
                for i in range(v.size):
                    moved = u[i] + far * d[i]
                    v[i] = min(moved, h[i])
                    if cap is not None:
                        pressure, moves = step.pressure[first + i], step.free[first + i]
                        v[i] = max(moved, h[i]) if is_yielding(u[i] - h[i], pressure, moves) else v[i]
            else:
                for i in range(v.size):
                    moved = v[i] + shift
                    above = cap is not None and v[i] > h[i]
                    v[i] = max(moved, h[i]) if above else min(moved, h[i]) if v[i] < h[i] else h[i]
            for i in range(v.size):
                total += v[i]
                is_free = v[i] < h[i] if cap is None else v[i] != h[i]
                free += 1.0 if is_free else 0.0
                most[i] = v[i] if v[i] > most[i] else most[i]
                least[i] = v[i] if v[i] < least[i] else least[i]
        total, free = summed(system.over, (total, free))
        top, bottom = greatest(system.over, (most.max(), -least.min()))
        lack, largest = mean * n - total, max(top, bottom)
        if not system.mean_is_fixed or abs(lack) <= _ROUNDING * largest * n or free == 0.0:
            break
        shift = lack / free


@kernel(inner=True)
def is_yielding(overlap: float, pressure: float, free: float) -> bool:
    """Whether a point of a state that `balance` has assessed yields."""
    return overlap > 0.0 or (overlap >= 0.0 and pressure > 0.0 and free > 0.0)


@kernel(reorder=True, inner=True)
def set_stress_after(
    single: Plans, system: AdhesiveSystem, at: AdhesiveState, step: FreeSystem, unit: float, to: AdhesiveState
) -> int:
    """Write the stress after a step from K d, in single precision; return the FFT pairs.

    What the wall has cut off, or the mean has shifted, takes a pair. `unit` is that of stress.
    """
    largest, farthest = np.zeros(LANES, np.float32), np.zeros(LANES, np.float32)
    per = unit_of(system.kappa_1) / unit
    for first in range(0, at.u.size, LANES):
        end = first + LANES
        u, v, d, cut = at.u[first:end], to.u[first:end], step.d[first:end], step.direction[first:end]
        before, after, response = at.stress[first:end], to.stress[first:end], step.response[first:end]
        for i in range(d.size):
            cut[i] = per * (v[i] - u[i]) - d[i]
            after[i] = before[i] - unit * response[i]
        for i in range(d.size):
            largest[i] = abs(cut[i]) if abs(cut[i]) > largest[i] else largest[i]
            farthest[i] = abs(d[i]) if abs(d[i]) > farthest[i] else farthest[i]
    off, far = greatest(system.over, (float(largest.max()), float(farthest.max())))
    if off <= _OF_SINGLE * far:
        return 0
    apply(single, step.kappa, step.direction, step.work, step.applied)
    for i in range(at.u.size):
        to.stress[i] -= unit * step.applied[i]
    return 1


@kernel(reorder=True, inner=True)
def compare(
    system: AdhesiveSystem,
    at: AdhesiveState,
    pressure: FloatArray,
    held: FloatArray,
    part: float,
    multiplier: float,
    to: AdhesiveState,
    step: FreeSystem,
    cap: Any,
) -> tuple[float, float, float, float]:
    """Compare two states, with the arguments of `balance` and its results for the first.

    Returns the slope of the energy along the straight way from one to the other, at its beginning and at its
    end; the change of the energy without the interface's, exact by the mean of both stresses; and the
    largest difference of the traction from that which the curvature predicts, over the strength.
    """
    first, last, elastic, most = 0.0, 0.0, 0.0, filled(LANES, 0.0)
    for begun in range(0, at.u.size, LANES):
        end = begun + LANES
        u, v, hold = at.u[begun:end], to.u[begun:end], held[begun:end]
        stress0, stress1 = at.stress[begun:end], to.stress[begun:end]
        traction0, traction1 = at.traction[begun:end], to.traction[begun:end]
        curvature, ps = at.curvature[begun:end], pressure[begun:end]
        for i in range(u.size):
            way, dead = v[i] - u[i], multiplier - part * hold[i]
            first -= ps[i] * way
            force = stress1[i] + dead + traction1[i]
            if cap is not None and is_yielding(u[i] - system.h[begun + i], ps[i], step.free[begun + i]):
                force -= cap
            last -= force * way
            elastic -= (0.5 * (stress0[i] + stress1[i]) + dead) * way
            off = abs(traction1[i] - traction0[i] + curvature[i] * way)
            most[i] = off if off > most[i] else most[i]
    first, last, elastic = summed(system.over, (first, last, elastic))
    (largest,) = greatest(system.over, (most.max(),))
    return first, last, elastic, largest / system.strength


@kernel(inner=True)
def keep_tangent(origin: Origin, step: FreeSystem, unit: float, far: float) -> None:
    """Keep the first step of a branch, which leads along its tangent to the end of the time step."""
    for i in range(step.d.size):
        origin.tangent[i], origin.response[i] = far * step.d[i], unit * step.response[i]


@kernel(reorder=True, inner=True)
def along_deviation(
    system: AdhesiveSystem, gap: FloatArray, at: AdhesiveState, origin: Origin, part: float
) -> tuple[float, float]:
    """Return v.Kv and v.w''v for the deviation v of a step from its tangent, sums over the points.

    v = u - u_0 - tangent, where `gap` is that at u_0. w'' is taken at a part of the straight way.
    """
    elastic, interface, terms = 0.0, 0.0, system.terms
    for first in range(0, at.u.size, LANES):
        end = first + LANES
        h, u, before, stress = system.h[first:end], at.u[first:end], gap[first:end], at.stress[first:end]
        stress0, tangent = origin.stress[first:end], origin.tangent[first:end]
        response = origin.response[first:end]
        for i in range(u.size):
            off = before[i] - (h[i] - u[i]) - tangent[i]
            elastic += off * (stress0[i] - stress[i] - response[i])
        for k in range(terms.form.size):
            form, scale, length, width = terms.form[k], terms.stress[k], terms.length[k], terms.width[k]
            for i in range(u.size):
                after = h[i] - u[i]
                way = before[i] - after
                off = way - tangent[i] if (before[i] > 0.0) | (after > 0.0) else 0.0
                interface += off * off * term(before[i] - part * way, form, scale, length, width)[2]
    elastic, interface = summed(system.over, (elastic, interface))
    return elastic, interface


@kernel(reorder=True, inner=True)
def released_over(
    system: AdhesiveSystem,
    gap: FloatArray,
    at: AdhesiveState,
    held: FloatArray,
    origin: Origin,
    energies: tuple[float, float],
    multipliers: tuple[float, float],
) -> float:
    """Return the energy lost over a step by the trapezoidal rule, sum over the points.

    Energies of the interface and multipliers are those at the beginning and at the end.
    """
    work, dead = 0.0, 0.5 * (multipliers[0] + multipliers[1])
    for i in range(at.u.size):
        way = gap[i] - (system.h[i] - at.u[i])
        work += (0.5 * (origin.stress[i] + at.stress[i] - held[i]) + dead) * way
    return float(summed(system.over, (work,))[0] + energies[0] - energies[1])


@kernel(reorder=True, inner=True)
def shorten(at: AdhesiveState, part: float, to: AdhesiveState) -> None:
    """Go back to a part of the way."""
    for i in range(at.u.size):
        to.u[i] = at.u[i] + part * (to.u[i] - at.u[i])
        to.stress[i] = at.stress[i] + part * (to.stress[i] - at.stress[i])


@kernel(reorder=True, inner=True)
def detaches(system: AdhesiveSystem, at: AdhesiveState) -> bool:
    """Whether no traction at these gaps, or at larger ones, bears the pull of a given load."""
    overlap, traction = greatest(system.over, (-(system.h - at.u).min(), at.traction.max()))
    return bool(-overlap > system.range and traction < -system.load)
