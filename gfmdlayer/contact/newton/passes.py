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
from gfmdlayer.contact.newton.cycle import Cycle, run_cycle, set_cycle
from gfmdlayer.contact.residual import ResidualFloor, scales, violation
from gfmdlayer.grid.sums import Completion, greatest, summed
from gfmdlayer.grid.transforms import Plans, backward, forward
from gfmdlayer.interface.forms import Terms, term
from gfmdlayer.kernels import LANES, kernel

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


class Step(NamedTuple):
    """The linear system of a step, on the free points, and its solution.

    All but the first four are in single precision. Without a cycle the preconditioner takes a transform.
    """

    free: FloatArray  # 1 where the point moves, 0 where it is pressed
    pressure: FloatArray  # p_c, which is out of balance on the free points
    d: FloatArray
    spectrum: ComplexArray  # work
    force: Any  # stress out of balance after the step, to first order
    direction: Any
    applied: Any  # K times the direction
    z: Any  # preconditioned force
    share: Any  # root of the share of the body in the stiffness of a point; the interface has the rest
    point: Any  # compliance of the body at a point
    moves: Any  # `free` again
    stiffness: Any  # curvature and damping
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
    h, u, traction, curvature, total, terms = system.h, at.u, at.traction, at.curvature, 0.0, system.terms
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
    system: AdhesiveSystem, at: AdhesiveState, held: FloatArray, part: float, step: Step, cap: Any
) -> tuple[float, float, float]:
    """Find the free points, and the pressure of the wall, less the cap on points that yield.

    It is out of balance on the free points. `held` is a traction that holds the surface, of which a part is
    left. Returns the residual, lambda, and the largest pressure out of balance.
    """
    total, count, strongest, weakest, deepest = _open_pressure(system, at, held, part, step, cap)
    multiplier = system.load
    if system.mean_is_fixed:
        # In full contact any lambda that keeps the pressure positive will do.
        multiplier = -total / count if count > 0.0 else -weakest
    pressure_scale, depth = scales(strongest + multiplier, deepest, system.floor)
    per_pressure, per_gap, worst, total, count = 1.0 / pressure_scale, 1.0 / depth, np.zeros(LANES), 0.0, 0.0
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
            total += moves * value
            count += moves
    total, count = summed(system.over, (total, count))
    mean = total / count if system.mean_is_fixed and count > 0.0 else 0.0
    largest = np.zeros(LANES)
    for first in range(0, at.u.size, LANES):
        ps, free = step.pressure[first : first + LANES], step.free[first : first + LANES]
        for i in range(ps.size):
            size = abs(ps[i] - mean) * free[i]
            largest[i] = size if size > largest[i] else largest[i]
    off, out_of_balance = greatest(system.over, (worst.max(), largest.max()))
    return off if np.isfinite(total) else np.nan, multiplier, out_of_balance


@kernel(reorder=True, inner=True)
def _open_pressure(
    system: AdhesiveSystem, at: AdhesiveState, held: FloatArray, part: float, step: Step, cap: Any
) -> tuple[float, float, float, float, float]:
    """Write the pressure but for the multiplier.

    Returns its sum over the points out of contact, their number, its extrema, and the depth of the surface.
    Points beyond h, whose pressure counts from the cap, belong to the sum and the number too.
    """
    total, count, mean = 0.0, 0.0, 0.0
    most, least, lowest = np.full(LANES, -np.inf), np.full(LANES, np.inf), np.full(LANES, np.inf)
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
            mean += u[i]
            is_open = 1.0 if u[i] < h[i] else 0.0
            total += is_open * value
            count += is_open
            if cap is not None and u[i] > h[i]:
                total += value - cap
                count += 1.0
    total, count, mean = summed(system.over, (total, count, mean))
    strongest, weakest, deepest = greatest(system.over, (most.max(), -least.min(), -lowest.min()))
    return total, count, strongest, -weakest, max(mean / system.size, 0.0) + deepest


@kernel(reorder=True, inner=True)
def begin(
    single: Plans, system: AdhesiveSystem, curvature: FloatArray, step: Step, damping: float, lack: float
) -> int:
    """Begin with no step, or with one that lifts all free points by the lack; return the FFT pairs."""
    n, d, force, free, pressure = step.d.size, step.d, step.force, step.free, step.pressure
    moves, stiffness, response, direction = step.moves, step.stiffness, step.response, step.direction
    for i in range(n):
        d[i], force[i], response[i] = 0.0, free[i] * pressure[i], 0.0
        moves[i], stiffness[i] = free[i], curvature[i] + damping
    step.kappa[:] = system.kappa
    if step.cycle.grids.size > 0:
        set_cycle(step.cycle, moves, stiffness, 1.0)
    else:
        _set_softening(system, curvature, step, damping)
    if lack == 0.0:
        return 0
    for i in range(n):
        direction[i] = free[i]
    pairs = 1 + precondition(single, step, direction, step.z)
    total = 0.0
    for i in range(n):
        d[i] = step.free[i] * step.z[i]
        total += d[i]
    (total,) = summed(system.over, (total,))
    for i in range(n):
        d[i] *= lack / total
        step.direction[i] = d[i]
    apply(single, step.kappa, step.direction, step.work, step.applied)
    for i in range(n):
        step.response[i] = step.applied[i]
        off = step.applied[i] + (curvature[i] + damping) * d[i]
        force[i] = step.free[i] * (step.pressure[i] - off)
    return pairs


@kernel(reorder=True, inner=True)
def _set_softening(system: AdhesiveSystem, curvature: FloatArray, step: Step, damping: float) -> None:
    """Set the preconditioner that takes a transform."""
    n, total = system.size, 0.0
    (stiffest,) = greatest(system.over, (curvature.max(),))
    for k in range(step.softening.size):
        # The factor n^2 turns the stiffness per point into that for a backward transform.
        softening = 1.0 / (n * (n * system.kappa[k] + damping + 0.5 * system.kappa_1))
        step.softening[k] = softening
        total += softening
    total, count = summed(system.over, (total, float(step.softening.size)))
    step.point[0] = n * total / (_STIFF * count)
    step.share[:] = 1.0
    if stiffest > 0.0:
        for i in range(step.d.size):
            step.share[i] = 1.0 / np.sqrt(1.0 + step.point[0] * max(curvature[i], 0.0))


@kernel(reorder=True, inner=True)
def precondition(single: Plans, step: Step, r: Any, z: Any) -> int:
    """Write z = M r, M close to the inverse of K + w'' + damping; return the FFT pairs.

    It is the cycle if there is one. Else M = S C S + (1 - S^2)/(k + w'') with C the inverse of
    K + damping + kappa_1/2, the stiffness k of the body at a point by itself, and S^2 = k/(k + w''), 1 where
    w'' < 0: points that the interface holds more stiffly than only the body answer.
    """
    if step.cycle.grids.size > 0:
        run_cycle(step.cycle, r, z)
        return 0
    share = step.share
    for i in range(z.size):
        z[i] = share[i] * r[i]
    apply(single, step.softening, z, step.work, z)
    for i in range(z.size):
        square = share[i] * share[i]
        z[i] = share[i] * z[i] + step.point[0] * square * (np.float32(1.0) - square) * r[i]
    return 1


@kernel(inner=True)
def lifted(step: Step) -> Any:
    """Return the answer of M, as far as it knows the free points, to a pressure that is even on them."""
    return step.cycle.one if step.cycle.grids.size > 0 else step.moves


@kernel(reorder=True, inner=True)
def minimise(
    single: Plans, system: AdhesiveSystem, kappa_1: float, step: Step, floor: float, inexact: float
) -> tuple[int, float]:
    """Solve (K + w'' + damping) d = p_c on the free points by preconditioned conjugate gradients.

    They go on from the given d and force, with the mean of the change of d zero where the mean is fixed.
    `floor` and `inexact` are the largest force that may be left on a point, and as a part of the first one.
    Returns the FFT pairs, and the curvature along the last direction, per area, where it is negative, else 0.
    """
    d, force, direction, applied, z, moves, stiffness = (
        step.d, step.force, step.direction, step.applied, step.z, step.moves, step.stiffness,
    )  # fmt: skip
    n, over = d.size, system.over
    (count,) = summed(over, (step.free.sum(),))
    if count == 0.0:
        return 0, 0.0
    aim, last, centred = (
        max(floor, inexact * _centre(system, force, step.free, count)),
        1.0,
        system.mean_is_fixed,
    )
    direction[:] = 0.0
    one, whole, pairs = lifted(step), 0.0, 0
    for i in range(n):
        whole += one[i]
    (whole,) = summed(over, (whole,))
    for iteration in range(_MOST):
        pairs += 1 + precondition(single, step, force, z)
        # Forces are zero where points are pressed, and in the mean where that is fixed.
        total, across, lift = summed(over, _sums(z, moves, force, one))
        mean = np.float32(total / whole if centred else 0.0)
        across -= float(mean) * lift
        beta = np.float32(across / last)
        beta, last = beta if iteration > 0 else np.float32(0.0), across
        for i in range(n):
            direction[i] = moves[i] * (z[i] - mean * one[i]) + beta * direction[i]
        apply(single, step.kappa, direction, step.work, applied)
        elastic, along, square, total = summed(over, _curvatures(direction, applied, stiffness, moves))
        if square == 0.0:
            return pairs, 0.0
        if not along > _NO_CURVATURE * (elastic + kappa_1 * square):
            return pairs, min(along / square, -1e-300)
        way, mean = across / along, np.float32(total / count if centred else 0.0)
        (left,) = greatest(over, (_advance(way, mean, step),))
        if left <= aim:
            return pairs, 0.0
    return pairs, 0.0


@kernel(reorder=True, inner=True)
def _sums(z: Any, moves: Any, force: Any, one: Any) -> tuple[float, float, float]:
    """Sums of z over the free points, of force z and force one; in single precision over few points only."""
    total, across, lift = 0.0, 0.0, 0.0
    for first in range(0, z.size, LANES):
        end = first + LANES
        zs, frees, fs, ones = z[first:end], moves[first:end], force[first:end], one[first:end]
        some: Any = np.float32(0.0)
        others: Any = np.float32(0.0)
        mean: Any = np.float32(0.0)
        for i in range(zs.size):
            some += zs[i] * frees[i]
            others += fs[i] * zs[i]
            mean += fs[i] * ones[i]
        total += some
        across += others
        lift += mean
    return total, across, lift


@kernel(reorder=True, inner=True)
def _curvatures(
    direction: Any, applied: Any, stiffness: Any, moves: Any
) -> tuple[float, float, float, float]:
    """Sums of s K s, s H s and s^2 for a direction s, and of H s over the free points."""
    elastic, along, square, total = 0.0, 0.0, 0.0, 0.0
    for first in range(0, direction.size, LANES):
        end = first + LANES
        none: Any = np.float32(0.0)
        ss, Ks, hs, frees = direction[first:end], applied[first:end], stiffness[first:end], moves[first:end]
        sKs, sHs, s2, Hs = none, none, none, none
        for i in range(ss.size):
            s = ss[i]
            response = Ks[i] + hs[i] * s
            sKs += s * Ks[i]
            sHs += s * response
            s2 += s * s
            Hs += frees[i] * response
        elastic += sKs
        along += sHs
        square += s2
        total += Hs
    return elastic, along, square, total


@kernel(reorder=True, inner=True)
def _advance(way: float, mean: Any, step: Step) -> float:
    """Go along the direction; return the largest force that is left."""
    largest, part = np.zeros(LANES, np.float32), np.float32(way)
    for first in range(0, step.d.size, LANES):
        end = first + LANES
        ds, fs, frees, ss = (
            step.d[first:end],
            step.force[first:end],
            step.moves[first:end],
            step.direction[first:end],
        )
        Ks, hs, Kds = step.applied[first:end], step.stiffness[first:end], step.response[first:end]
        for i in range(ds.size):
            ds[i] += part * ss[i]
            Kds[i] += part * Ks[i]
            left = fs[i] - part * frees[i] * (Ks[i] + hs[i] * ss[i] - mean)
            fs[i] = left
            largest[i] = abs(left) if abs(left) > largest[i] else largest[i]
    return float(largest.max())


_MOST = 400  # iterations


@kernel(reorder=True, inner=True)
def _centre(system: AdhesiveSystem, force: Any, free: FloatArray, count: float) -> float:
    """Take the mean, which belongs to the multiplier, from the forces; return the largest."""
    total, largest = summed(system.over, (float(force.sum()),))[0], 0.0
    mean = total / count if system.mean_is_fixed else 0.0
    for i in range(force.size):
        force[i] -= mean * free[i]
        largest = max(largest, abs(force[i]))
    return float(greatest(system.over, (largest,))[0])


@kernel(reorder=True, inner=True)
def move(
    system: AdhesiveSystem, at: AdhesiveState, step: Step, mean: float, to: AdhesiveState, cap: Any
) -> None:
    """Write the displacement after a step, kept below the punch, and of points that yield above it.

    Where the mean is fixed it is restored by a shift of the points that do not touch.
    """
    h, u, v = system.h, at.u, to.u
    for i in range(v.size):
        moved = u[i] + step.d[i]
        kept = h[i] if moved > h[i] else moved
        if cap is not None and is_yielding(u[i] - h[i], step.pressure[i], step.free[i]):
            kept = h[i] if moved < h[i] else moved
        v[i] = kept
    if system.mean_is_fixed:
        for _ in range(60):
            total, free, largest = 0.0, 0.0, 0.0
            for i in range(v.size):
                total += v[i]
                free += 1.0 if v[i] < h[i] else 0.0
                if cap is not None:
                    free += 1.0 if v[i] > h[i] else 0.0
                largest = max(largest, abs(v[i]))
            total, free = summed(system.over, (total, free))
            (largest,) = greatest(system.over, (largest,))
            lack = mean * system.size - total
            if abs(lack) <= _ROUNDING * largest * system.size or free == 0.0:
                break
            for i in range(v.size):
                shifted = min(v[i] + lack / free, h[i]) if v[i] < h[i] else h[i]
                if cap is not None and v[i] > h[i]:
                    shifted = max(v[i] + lack / free, h[i])
                v[i] = shifted


@kernel(inner=True)
def is_yielding(overlap: float, pressure: float, free: float) -> bool:
    """Whether a point of a state that `balance` has assessed yields."""
    return overlap > 0.0 or (overlap >= 0.0 and pressure > 0.0 and free > 0.0)


@kernel(reorder=True, inner=True)
def set_stress_after(
    single: Plans, system: AdhesiveSystem, at: AdhesiveState, step: Step, stiff: float, to: AdhesiveState
) -> int:
    """Write the stress after a step from K d, in single precision; return the FFT pairs.

    What the wall has cut off, or the mean has shifted, takes a pair. `step.kappa` is over `stiff`.
    """
    d, cut, largest, farthest = step.d, step.direction, 0.0, 0.0
    for i in range(d.size):
        off = to.u[i] - at.u[i] - d[i]
        cut[i] = stiff * off
        largest, farthest = max(largest, abs(off)), max(farthest, abs(d[i]))
    largest, farthest = greatest(system.over, (largest, farthest))
    for i in range(d.size):
        to.stress[i] = at.stress[i] - step.response[i]
    if largest <= _OF_SINGLE * farthest:
        return 0
    apply(single, step.kappa, cut, step.work, step.applied)
    for i in range(d.size):
        to.stress[i] -= step.applied[i]
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
    step: Step,
    cap: Any,
) -> tuple[float, float, float, float]:
    """Compare two states, with the arguments of `balance` and its results for the first.

    Returns the slope of the energy along the straight way from one to the other, at its beginning and at its
    end; the change of the energy without the interface's, exact by the mean of both stresses; and the
    largest difference of the traction from that which the curvature predicts, over the strength.
    """
    first, last, elastic, most = 0.0, 0.0, 0.0, np.zeros(LANES)
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


@kernel(reorder=True, inner=True)
def shorten(at: AdhesiveState, part: float, to: AdhesiveState) -> None:
    """Go back to a part of the way."""
    for i in range(at.u.size):
        to.u[i] = at.u[i] + part * (to.u[i] - at.u[i])
        to.stress[i] = at.stress[i] + part * (to.stress[i] - at.stress[i])


@kernel(reorder=True, inner=True)
def lost(system: AdhesiveSystem, at: AdhesiveState) -> bool:
    """Whether no traction at these gaps, or at larger ones, bears the pull of a given load."""
    overlap, traction = greatest(system.over, (-(system.h - at.u).min(), at.traction.max()))
    return bool(-overlap > system.range and traction < -system.load)
