"""Newton's method for interfaces that attract, along the path that the surface takes.

The energy E(u) = elastic energy + sum of w(h - u) is to be least over u <= h. Where w is concave E has many
minima. The surface is in the one to which the state before leads:

branch
    A step begins with the last gap, at the new punch, history and load. Traction r_0 holds it there; the mean
    of u differs by m_0 from that prescribed. Both are taken away, (1 - s) r_0 and (1 - s) m_0 with s from 0
    to 1: of an elastic body this is the motion of the punch. Newton steps in which the traction differs
    little from its tangent follow the minimum (Davidenko's path), in most steps all the way at once. Points
    at the wall stay there.
descent
    Where the energy is not convex along the free points, or that path stops, a branch ends.
    The punch stops (s is kept) and the surface descends overdamped, each point at a speed in proportion to
    the pressure p_c that is out of balance on it, eta du/dt = p_c with one eta for all points, and u <= h.
    Steps are linearly implicit (pseudo-transient continuation: Kelley and Keyes, SIAM J. Numer. Anal. 35
    (1998) 508), (K + w'' + c) d = p_c with c = eta/dt. c is chosen for the change of the traction, whose
    difference from the tangent is the error, and large enough that the matrix is positive and the energy
    falls; it vanishes as a minimum comes near, and Newton's method ends there. Then s grows again.

Where a hardness ends the pressures, points whose pressure exceeds it leave the wall on its other side. Beyond
h their energy grows in proportion to the overlap, see `passes`. So the energy is one of the displacement
alone, and all of the above holds; the overlap is the flow of the step.

So a landing depends neither on the time step nor on a start or tolerance, so long as there is one instability
on the way of a step at most. A descent with a concave stretch is an instability. A Newton step may also run
past the end of a branch: then the energy is concave along the deviation of the step from the tangent at its
beginning (`_lost`). `Solution.released_energy` is the work less the gain of the energies, by the
trapezoidal rule, as if a jump were in the middle of the step. Its error is of first order in the step; it is
at most what the descents have lost at a fixed s, past the end of the branch; from rest, and with a hardness,
it is that. Elsewhere it is zero.

Linear systems are solved on the free points by conjugate gradients in single precision. On surfaces the
preconditioner is a V-cycle of stencils (`cycle`), and an iteration takes one FFT pair, in single precision;
states on the way are in single precision too, by K d of the linear system, and those near balance are
evaluated in double. On lines, on less than 64^2 points, and where stencils do not describe the stiffness, it
is 1/(K + c + kappa_1/2), scaled where the interface is stiffer than the body (`passes.precondition`); an
iteration takes two pairs, and all states are evaluated in double. The stiffness decides which. A direction
of negative curvature ends them and begins a descent. Points that a step drives through the wall are put onto
it; if that turns the step uphill, a shorter one of the descent takes its place. In balance `find_margin`
looks for a deformation of negative curvature, which no symmetry hides.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.cycle import cycle_of, is_local, no_cycle, unit_of
from gfmdlayer.contact.newton.passes import (
    AdhesiveState,
    AdhesiveSystem,
    FreeSystem,
    Origin,
    along_deviation,
    apply,
    balance,
    begin,
    compare,
    detaches,
    keep_tangent,
    lifted,
    minimise,
    move,
    precondition,
    released_over,
    set_interaction,
    set_stress,
    set_stress_after,
    shorten,
)
from gfmdlayer.contact.pressure_form import trivial_solution
from gfmdlayer.contact.problem import Problem, Solution, make_solution, project
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.sums import Completion, greatest, pairwise_sum, summed
from gfmdlayer.grid.transforms import Plans, Transforms
from gfmdlayer.kernels import address_of, by_address, kernel, types_of
from gfmdlayer.resumable import State

# Part of the force that the conjugate gradients may leave, at most, and while damping follows the descent.
_INEXACT, _INEXACT_DAMPED = 0.1, 0.3
_WELL_WITHIN = 0.3  # part of the tolerance that they aim at in the end
_SHORTEST = 1 / 16  # part of the motion of the punch, at least, between two states of a branch
# Largest error of the traction in a step along a branch, over the strength: long steps stay on the branch.
_CHANGE = 0.5
_RESOLVED = 0.5  # likewise down the energy
# Growth of the steps down the energy, at most, and after one that was refused; and their cut.
_LONGER, _LONGER_AFTER, _SHORTER = 3.0, 2.0, 2.0
_ESCAPE = 0.3  # damping after a negative curvature, over the largest pressure out of balance per range
_TOO_FAR = 0.1  # part of such a step that is taken at least
_AT_REST = 0.1  # damping, over kappa_1, below which there is none
_SETTLED = 0.1  # error of the traction in a step without damping at which the descent ends
_OVERSHOT = 0.3  # slope of the energy at the end of a step, over that at its beginning, that shortens it
_HOPELESS = 1e6  # damping, over the largest stiffness of a point, at which only rounding is left to descend
_NOTHING = 0.03  # energy lost, over the work of adhesion of a point, that is no instability
_ON_THE_WAY = 0.0, 0.25, 0.5, 0.75, 1.0  # parts of a step at which its deviation from the tangent is tried
_SOFT = 0.1  # curvature along it, over the elastic part, below which there was an instability
WORTH_CYCLE = 1 << 12  # points
_FAR = 1e300  # range of the hard wall
_LIFTED = 1e-6  # lack of the mean, over its change in the step, that the punch has yet to make up
_OF_SUMS = 1e-12  # likewise over the largest displacement: what rounding leaves of a mean
_ROUNDING = 1e-13  # of energies, over their parts
_OF_SINGLE = 1e-6  # likewise of states in single precision, over the elastic part
IN_SINGLE = 0.5  # a pair of transforms in single precision counts as this part of one


class NewtonFields(NamedTuple):
    """Work arrays."""

    at: AdhesiveState
    to: AdhesiveState
    held: FloatArray
    step: FreeSystem
    spectrum: ComplexArray  # of u
    origin: Origin


class NewtonCalls(NamedTuple):
    """Addresses of kernels."""

    hold: int
    iterate: int
    find_margin: int
    along_deviation: int
    released_over: int


class NewtonState(NamedTuple):
    """State of the path between two calls of the loop."""

    done: float  # part of the motion of the punch, 1 where the traction that held the surface is gone
    mean: float  # mean displacement at the beginning of that motion
    damping: float
    descends: bool
    refused: bool  # whether the last step of the descent was refused
    unstable: bool  # whether the descent has met an energy that is not convex
    drop: float  # sum over the points of the energy lost in this descent
    released: float  # likewise in those that have ended
    pulled_off: bool
    multiplier: float
    residual: float
    energy: float  # of the interface, sum over the points; NaN where the state has to be evaluated anew
    exact: bool  # whether the stress of the state is in double precision
    tangent: bool  # whether that of the branch at its beginning is known
    pairs: float
    iterations: int


# From the last gap, at which the energy is not known yet, and from rest.
_FROM_GAP, _FROM_REST = (
    NewtonState(
        done, mean=0.0, damping=0.0, descends=False, refused=False, unstable=False, drop=0.0, released=0.0,
        pulled_off=False, multiplier=0.0, residual=math.inf, energy=math.nan, exact=True, tangent=False,
        pairs=1.0 - done, iterations=0,
    )
    for done in (0.0, 1.0)
)  # fmt: skip


@kernel(inner=True)
def is_instability(system: AdhesiveSystem, drop: float, unstable: bool) -> bool:
    """Whether the energy lost in a descent is that of an instability.

    The descent may also set right a step along the branch that has gone astray, by much less than the work of
    adhesion of one point.
    """
    return unstable and drop > _NOTHING * system.strength * system.range


@kernel(reorder=True, inner=True)
def iterate(  # noqa: C901  # compiled as one, for its many results
    plans: Plans,
    single: Plans,
    system: AdhesiveSystem,
    fields: NewtonFields,
    begun: NewtonState,
    tolerance: float,
    limit: int,
    cap: Any,
) -> NewtonState:
    """Iterate until the residual is within the tolerance, or to the limit; the state is `fields.at`.

    Where the residual is within the tolerance and the energy known, the spectrum belongs to the state.
    """
    held, step = fields.held, fields.step
    at, to, swapped = fields.at, fields.to, False
    (
        done, mean0, damping, descends, refused, unstable, drop, released, pulled_off, multiplier, residual,
        energy, exact, tangent, pairs, _,
    ) = begun  # fmt: skip
    iterations, settled, evaluated = 0, False, np.isnan(energy)
    if evaluated:
        set_stress(plans, system, at, fields.spectrum, step.spectrum)
        energy = set_interaction(system, at, cap)
        pairs, exact = pairs + 1.0, True
    in_single = _in_single(step)
    while True:
        target = done if descends else 1.0
        residual, multiplier, largest, of_u, depth = balance(system, at, held, 1.0 - target, step, cap)
        mean = (1.0 - target) * mean0
        lack = (mean - of_u) * system.size
        lack = lack if abs(mean - of_u) > _LIFTED * abs(mean0) + _OF_SUMS * depth and mean0 != 0.0 else 0.0
        # A flat surface is in balance at any mean: the residual does not tell whether it has moved.
        if (done == 1.0 and residual <= tolerance and lack == 0.0) or pulled_off:
            break
        (strongest,) = greatest(system.over, (step.pressure.max(),))
        aim = tolerance * max(system.strength, strongest)
        if descends and done < 1.0 and lack == 0.0 and (largest <= aim or settled):
            released += drop if is_instability(system, drop, unstable) else 0.0
            descends, unstable, drop, damping = False, False, 0.0, 0.0
            continue
        if iterations == limit:
            break
        iterations += 1
        inexact = _INEXACT_DAMPED if damping > 0.0 else _INEXACT
        inexact = min(inexact, np.sqrt(residual)) if done == 1.0 else inexact
        unit = max(largest, 1e-30)
        spent = begin(single, system, at.curvature, step, damping, lack, unit)
        more, least = minimise(single, system, step, _WELL_WITHIN * aim / unit, inexact)
        spent, least = spent + more, least * unit_of(system.kappa_1)
        pairs += IN_SINGLE * spent
        if least < 0.0:
            done = done if descends else min(1.0, done + _SHORTEST)
            descends, settled, refused, unstable = True, False, True, True
            # Where there is no curvature at all, as of a punch that is pulled off, a step by some ranges.
            escape = _ESCAPE * largest / min(system.range, _FAR)
            damping = max(2.0 * damping, damping - 2.0 * least, escape)
            continue
        if done == 0.0 and not descends and not tangent:
            keep_tangent(fields.origin, step, unit, unit / unit_of(system.kappa_1))
            tangent = True
        move(system, at, step, unit / unit_of(system.kappa_1), mean, to, cap)
        # In double precision once the step aims at the tolerance.
        now = not in_single or (done == 1.0 and inexact * largest <= _WELL_WITHIN * aim)
        if now:
            set_stress(plans, system, to, fields.spectrum, step.spectrum)
            pairs += 1.0
        else:
            pairs += IN_SINGLE * set_stress_after(single, system, at, step, unit, to)
        after = set_interaction(system, to, cap)
        evaluated = False
        first, last, elastic, error = compare(
            system, at, step.pressure, held, 1.0 - target, multiplier, to, step, cap
        )
        most, way = (_RESOLVED if descends else _CHANGE), 1.0
        if error > most:
            way = 0.9 * np.sqrt(most / error)
        if done == target and lack == 0.0 and last > _OVERSHOT * abs(first):
            way = min(way, first / (first - last))
        if way < 1.0:
            if done < target and way < _TOO_FAR and way * (target - done) < _SHORTEST:
                descends, settled, done, damping = True, False, min(1.0, done + _SHORTEST), system.kappa_1
                continue
            shorten(at, way, to)
            after = set_interaction(system, to, cap)
            _, _, elastic, error = compare(
                system, at, step.pressure, held, 1.0 - target, multiplier, to, step, cap
            )
        change = elastic + after - energy
        rounding = _ROUNDING * (abs(energy) + abs(elastic)) + (
            0.0 if now and exact else _OF_SINGLE * abs(elastic)
        )
        uphill = not first < 0.0 or change > rounding
        hidden = way < _TOO_FAR and abs(change) <= _OF_SINGLE * abs(elastic)
        if done == target and lack == 0.0 and (uphill or hidden) and not exact:
            # First rule out that single precision hides the descent, as it does on a body so stiff that it
            # deforms by 1e-7 of what it moves.
            set_stress(plans, system, at, fields.spectrum, step.spectrum)
            energy = set_interaction(system, at, cap)
            _, multiplier, _, _, _ = balance(system, at, held, 1.0 - target, step, cap)
            set_stress(plans, system, to, fields.spectrum, step.spectrum)
            first, _, elastic, error = compare(
                system, at, step.pressure, held, 1.0 - target, multiplier, to, step, cap
            )
            pairs, now, exact = pairs + 2.0, True, True
            change = elastic + after - energy
            uphill = not first < 0.0 or change > _ROUNDING * (abs(energy) + abs(elastic))
            if hidden:  # the step is taken once more, from the state in double precision
                evaluated = True
                continue
        if done == target and lack == 0.0 and (uphill or way < _TOO_FAR):
            # Uphill, where the wall has bent the step or the energy is far from a parabola, or too far.
            descends, settled, refused = True, False, True
            damping = max(_SHORTER * damping, _AT_REST * system.kappa_1)
            stiffest, concave = greatest(system.over, (at.curvature.max(), -at.curvature.min()))
            if damping > _HOPELESS * (system.kappa_1 + max(stiffest, concave)):
                break
            continue
        at, to, swapped, energy = to, at, not swapped, after
        evaluated, exact = now and way == 1.0, now and (exact or way == 1.0)
        if not descends:
            done += way * (target - done)
            continue
        if lack == 0.0:
            drop -= change
            unstable = unstable or last < first  # the energy falls ever more steeply
        settled = damping == 0.0 and way == 1.0 and error < _SETTLED
        # The error grows as the square of the step, and the step as the inverse of the damping.
        longer = _LONGER_AFTER if refused else _LONGER
        damping *= min(max(np.sqrt(error / _RESOLVED), 1.0 / longer), 1.0) / way
        refused = False
        damping = 0.0 if damping < _AT_REST * system.kappa_1 else damping
        if system.load < 0.0 and not system.mean_is_fixed:
            pulled_off = detaches(system, at)
    if swapped:
        _copy(at, to)
    iterations += begun.iterations
    residual = np.inf if lack != 0.0 else residual
    return NewtonState(
        done,
        mean0,
        damping,
        descends,
        refused,
        unstable,
        drop,
        released,
        pulled_off,
        multiplier,
        residual,
        energy if evaluated or residual > tolerance else np.nan,
        exact,
        tangent,
        pairs,
        iterations,
    )


@kernel(inner=True)
def _in_single(step: FreeSystem) -> bool:
    """Whether states on the way are in single precision."""
    return bool(step.cycle.grids.size > 0)


@kernel(inner=True)
def _copy(source: AdhesiveState, target: AdhesiveState) -> None:
    for i in range(source.u.size):
        target.u[i] = source.u[i]
        target.stress[i] = source.stress[i]
        target.traction[i] = source.traction[i]
        target.curvature[i] = source.curvature[i]


@kernel(reorder=True, inner=True)
def hold(plans: Plans, system: AdhesiveSystem, fields: NewtonFields, cap: Any) -> tuple[float, float]:
    """Find the traction that holds a surface where it is; return the interface's energy, and lambda."""
    at, held, step = fields.at, fields.held, fields.step
    set_stress(plans, system, at, fields.spectrum, step.spectrum)
    energy = set_interaction(system, at, cap)
    held[:] = 0.0
    _, multiplier, _, _, _ = balance(system, at, held, 0.0, step, cap)
    total, count = 0.0, 0.0
    for i in range(held.size):
        held[i] = step.free[i] * step.pressure[i]
        total += held[i]
        count += step.free[i]
    total, count = summed(system.over, (total, count))
    if system.mean_is_fixed and count > 0.0:
        for i in range(held.size):
            held[i] -= step.free[i] * total / count
    for i in range(held.size):
        fields.origin.stress[i] = at.stress[i]
    return energy, multiplier


# The lowest mode of the free points: whether a state is a minimum, and how far from an instability.
#
# The margin of a state is the least of
#
#     x.(K + w'')x / x.(K + kappa_1/2)x
#
# over all displacements x of the free points. Without attraction it is 1 or more; where a branch ends it
# falls to zero as the square root of the distance to that point. A state in balance may be no minimum: an
# even film stays flat, and a symmetric contact symmetric, without a force that tells. So x is found by
# itself, by preconditioned conjugate gradients on this ratio (Knyazev, SIAM J. Sci. Comput. 23 (2001) 517),
# and kept from step to step, so that one turn of one or two FFT pairs follows it. Single precision knows the
# ratio to 1e-6. With the preconditioner by transforms a law much stiffer than the body, as Lennard-Jones'
# repulsion, leaves the margin far above the least; the cycle finds it.

_MOST = 30  # turns
_STEADY = 0.01, 0.0015  # fall of the margin in a turn, over itself and in all, at which it is known
_KICK = 0.3  # change of the traction, over the strength, by which a state that is no minimum is left
_KICKS = 8  # trials, each with a quarter of the last change


class LowestMode(NamedTuple):
    """The lowest mode x, and work arrays of the search for it, in single precision."""

    x: Any
    before: Any
    d: Any
    Kd: Any
    first: Any  # with which the search begins


@kernel(reorder=True, inner=True)
def find_margin(
    single: Plans, system: AdhesiveSystem, at: AdhesiveState, step: FreeSystem, lowest: LowestMode
) -> tuple[float, float, float, int]:
    """Improve the lowest mode.

    Returns the margin, an upper bound which more turns lower; the curvature x.(K + w'')x and the attraction
    -x.w''x over the sum of x^2; and the FFT pairs.
    """
    free, D, n, stiff = step.free, step.stiffness, at.u.size, unit_of(system.kappa_1)
    half = 0.5 * system.kappa_1 / stiff
    Kx, slope, w, Kw = step.direction, step.force, step.z, step.applied
    x, before, d, Kd, _ = lowest
    begin(single, system, at.curvature, step, 0.0, 0.0, 1.0)  # the preconditioner
    d[:], Kd[:] = 0.0, 0.0
    _admit(system, free, x, free)
    apply(single, step.kappa, x, step.work, Kx)
    pairs, margin, last, across = 1, np.inf, np.inf, 1.0
    for turn in range(_MOST + 1):
        xHx, xBx = 0.0, 0.0
        for i in range(n):
            xHx += x[i] * (Kx[i] + D[i] * x[i])
            xBx += x[i] * (Kx[i] + half * x[i])
        xHx, xBx = summed(system.over, (xHx, xBx))
        if not xBx > 0.0:
            return 1.0, 1.0, 0.0, pairs
        last, margin = margin, xHx / xBx
        if turn == _MOST or (turn > 0 and last - margin < _STEADY[0] * abs(margin) + _STEADY[1]):
            break
        for i in range(n):
            before[i] = slope[i]
            slope[i] = free[i] * ((1.0 - margin) * Kx[i] + (D[i] - margin * half) * x[i])
        _admit(system, free, slope, free)
        pairs += 1 + precondition(single, step, slope, w)[0]
        _admit(system, free, w, lifted(step))
        apply(single, step.kappa, w, step.work, Kw)
        previous, across, change = across, 0.0, 0.0
        for i in range(n):
            across += slope[i] * w[i]
            change += (slope[i] - before[i]) * w[i]
        across, change = summed(system.over, (across, change))
        beta = max(change / previous, 0.0) if turn > 0 else 0.0
        xHd, dHd, xBd, dBd = 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            d[i], Kd[i] = beta * d[i] - w[i], beta * Kd[i] - Kw[i]
            xHd += d[i] * (Kx[i] + D[i] * x[i])
            dHd += d[i] * (Kd[i] + D[i] * d[i])
            xBd += d[i] * (Kx[i] + half * x[i])
            dBd += d[i] * (Kd[i] + half * d[i])
        xHd, dHd, xBd, dBd = summed(system.over, (xHd, dHd, xBd, dBd))
        share = _lowest(xHx, xHd, dHd, xBx, xBd, dBd)
        size = xBx + 2.0 * share * xBd + share * share * dBd
        if not size > 0.0:
            break
        scale = 1.0 / np.sqrt(size)
        for i in range(n):
            x[i] = scale * (x[i] + share * d[i])
            Kx[i] = scale * (Kx[i] + share * Kd[i])
    square, attraction = 0.0, 0.0
    for i in range(n):
        square += x[i] * x[i]
        attraction -= D[i] * x[i] * x[i]
    square, attraction = summed(system.over, (square, attraction))
    return margin, stiff * xHx / square, stiff * attraction / square, pairs


@kernel(inner=True)
def _lowest(xHx: float, xHd: float, dHd: float, xBx: float, xBd: float, dBd: float) -> float:
    """Share s at which x + s d has the lowest ratio of H to B."""
    # The derivative of the ratio vanishes: a s^2 + b s + c = 0.
    a, b, c = dHd * xBd - xHd * dBd, dHd * xBx - xHx * dBd, xHd * xBx - xHx * xBd
    root = np.sqrt(max(b * b - 4.0 * a * c, 0.0))
    # Of both roots the one at which it rises afterwards: 2 a s + b > 0.
    if b >= 0.0:
        return -2.0 * c / (b + root) if b + root > 0.0 else 0.0
    return (root - b) / (2.0 * a) if a != 0.0 else 0.0


@kernel(reorder=True, inner=True)
def _admit(system: AdhesiveSystem, free: Any, x: Any, one: Any) -> None:
    """Remove motions that the constraints do not allow; a mean by a part of `one`."""
    total, whole = 0.0, 0.0
    for i in range(x.size):
        x[i] *= free[i]
        total += x[i]
        whole += free[i] * one[i]
    total, whole = summed(system.over, (total, whole))
    mean = total / whole if system.mean_is_fixed and whole > 0.0 else 0.0
    for i in range(x.size):
        x[i] -= mean * free[i] * one[i]


@kernel(reorder=True)
def leave(
    plans: Plans,
    system: AdhesiveSystem,
    at: AdhesiveState,
    to: AdhesiveState,
    step: FreeSystem,
    x: Any,
    cap: Any,
) -> tuple[float, int]:
    """Leave a state that is no minimum along x, to the side where the energy is lower.

    Returns the change of the energy, sum over the points, and the FFT pairs.
    """
    n, strongest = x.size, 1e-300
    for i in range(n):
        strongest = max(strongest, abs(at.curvature[i] * x[i]))
    (strongest,) = greatest(system.over, (strongest,))
    far, energy, pairs = _KICK * system.strength / strongest, set_interaction(system, at, cap), 0
    mean = summed(system.over, (at.u.sum(),))[0] / system.size if system.mean_is_fixed else 0.0
    for _ in range(_KICKS):
        best, side = 0.0, 0.0
        for sign in (1.0, -1.0, 0.0):
            if sign == 0.0 and (side == 0.0 or side == -1.0):
                break  # neither is lower, or the last is
            for i in range(n):
                step.d[i] = x[i]
            move(system, at, step, (sign if sign != 0.0 else side) * far, mean, to, cap)
            set_stress(plans, system, to, step.spectrum, step.spectrum)
            pairs += 1
            after, change = set_interaction(system, to, cap), 0.0
            for i in range(n):
                change -= (0.5 * (at.stress[i] + to.stress[i]) + system.load) * (to.u[i] - at.u[i])
            change = (after - energy) + summed(system.over, (change,))[0]
            if change < best:
                best, side = change, sign
        if best < 0.0:
            for i in range(n):
                at.u[i] = to.u[i]
            return best, pairs
        far *= 0.25
    return 0.0, pairs


# Kernels with sums are compiled once, by themselves; as parts of another one they may have other bits.
_hold, _iterate, _find_margin, _along_deviation, _released_over = (
    by_address(called) for called in (hold, iterate, find_margin, along_deviation, released_over)
)


@kernel
def set_surface(h: FloatArray, gap: FloatArray, u: FloatArray, over: Completion) -> bool:
    """Set the surface at a gap; return whether it is finite."""
    lacking = 0.0
    for i in range(u.size):
        u[i] = h[i] - gap[i]
        lacking = lacking if np.isfinite(u[i]) else 1.0
    return bool(greatest(over, (lacking,))[0] == 0.0)


class Reached(NamedTuple):
    """How far `follow` has come."""

    now: NewtonState
    converged: bool  # whether it is a minimum
    margin: float
    curvature: float  # along the lowest mode
    released: float  # energy lost in instabilities so far, sum over the points
    pairs: float  # of the search for the lowest mode


@kernel
def follow(
    calls: NewtonCalls,
    plans: Plans,
    single: Plans,
    system: AdhesiveSystem,
    fields: NewtonFields,
    lowest: LowestMode,
    start: FloatArray,
    now: NewtonState,
    tolerance: float,
    limit: int,
    cap: Any,
) -> Reached:
    """Follow the path from the gap `start`, or go on with it, for at most so many iterations."""
    at, step, origin, n = fields.at, fields.step, fields.origin, start.size
    if now.done == 0.0 and np.isnan(now.energy):
        mean = 0.0
        if system.mean_is_fixed:
            mean = summed(system.over, (pairwise_sum(at.u),))[0] / system.size
        energy, multiplier = _hold(calls.hold, (plans, system, fields, cap))
        origin.balance[0], origin.balance[1] = energy, multiplier
        now = NewtonState(
            now.done, mean, now.damping, now.descends, now.refused, now.unstable, now.drop, now.released,
            now.pulled_off, multiplier, now.residual, energy, now.exact, now.tangent, now.pairs,
            now.iterations,
        )  # fmt: skip
    now = _iterate(calls.iterate, (plans, single, system, fields, now, tolerance, limit, cap))
    converged, margin, curvature, pairs = False, np.nan, np.nan, 0.0
    if now.done == 1.0 and now.residual <= tolerance and not np.isnan(now.energy):
        arguments = single, system, at, step, lowest
        margin, curvature, attraction, turns = _find_margin(calls.find_margin, arguments)
        moved, free = 0.0, 0.0
        for i in range(n):
            moved = 1.0 if lowest.x[i] != 0.0 else moved
            free = 1.0 if step.free[i] != 0.0 else free
        moved, free = greatest(system.over, (moved, free))
        if moved == 0.0 and free > 0.0:  # none of the points that it moved is free: it begins anew
            for i in range(n):
                lowest.x[i] = lowest.first[i]
            margin, curvature, attraction, more = _find_margin(calls.find_margin, arguments)
            turns += more
        pairs = IN_SINGLE * turns
        # Near the end of a branch u is known to the root of the tolerance, and so is the curvature.
        converged = bool(curvature >= -math.sqrt(2 * tolerance) * abs(attraction))
    released = now.released
    if is_instability(system, now.drop, now.unstable):
        released += now.drop
    if converged and cap is None and not np.isnan(origin.balance[0]):
        released = _lost(calls, system, fields, start, now, released)
    return Reached(now, converged, margin, curvature, released, pairs)


@kernel(inner=True)
def _lost(
    calls: NewtonCalls,
    system: AdhesiveSystem,
    fields: NewtonFields,
    start: FloatArray,
    now: NewtonState,
    released: float,
) -> float:
    """Energy lost in instabilities, sum over the points, of which descents have met those `released`."""
    least, at, origin = _NOTHING * system.strength * system.range, fields.at, fields.origin
    if released == 0.0:
        # The energy may be concave along the deviation of the step from its tangent, see the module.
        unstable = False
        for part in _ON_THE_WAY:
            if now.tangent and not unstable:
                arguments = system, start, at, origin, part
                elastic, interface = _along_deviation(calls.along_deviation, arguments)
                unstable = 0.5 * elastic > least and interface < -(1.0 - _SOFT) * elastic
        if not unstable:
            return 0.0
        released = np.inf
    energies, multipliers = (origin.balance[0], now.energy), (origin.balance[1], now.multiplier)
    balanced = _released_over(
        calls.released_over, (system, start, at, fields.held, origin, energies, multipliers)
    )
    return float(min(max(balanced, least), released))


_CHUNK = 1 << 18  # points moved between two looks at signals, some 20 ms with the transforms of an iteration


class Newton:
    """Newton's method with truncated conjugate gradients, for the steps of one run."""

    starts_from: ClassVar[Literal["gap"]] = "gap"

    def __init__(self, transforms: Transforms, grid: Grid | None = None) -> None:
        self._transforms = transforms
        self._grid = grid or Grid(transforms.shape, (1.0,) * len(transforms.shape))
        self._mode = _any_deformation(self._grid)
        self._stiffness: FloatArray = np.empty(0)  # of the cycle
        self._margin, self._part = math.nan, 0.0  # of a pair that is counted with the next step
        self._calls: dict[bytes, NewtonCalls] = {}

    @cached_property
    def _single(self) -> Transforms:
        """Transforms in single precision."""
        return self._transforms.of_shape(self._grid.points, single=True)

    @cached_property
    def _fields(self) -> NewtonFields:
        field, spectrum, small = self._transforms.empty_field, self._transforms.empty_spectrum, self._single
        at, to = (AdhesiveState(field(), field(), field(), field()) for _ in range(2))
        free, d, force, direction, applied, z, share, stiffness, response = (
            small.empty_field() for _ in range(9)
        )
        work = small.empty_spectrum()
        kappa, softening, point = (np.empty(size, np.float32) for size in (work.size, work.size, 1))
        step = FreeSystem(
            field(), spectrum(), free, d, force, direction, applied, z, share, point, stiffness,
            kappa, softening, work, response, no_cycle(),
        )  # fmt: skip
        origin = Origin(field(), small.empty_field(), small.empty_field(), np.empty(2))
        return NewtonFields(at, to, field(), step, spectrum(), origin)

    @cached_property
    def _lowest(self) -> LowestMode:
        lowest = LowestMode(*(self._single.empty_field() for _ in range(5)))
        lowest.first[:] = _any_deformation(self._grid)
        return lowest

    def solve(
        self, problem: Problem, start: FloatArray, tolerance: float = 1e-6, limit: int = 20_000
    ) -> Solution:
        """Solve from the gap of the last step; infinite where there is none, and the surface at rest."""
        if trivial := trivial_solution(problem, self._transforms):
            return trivial
        system, fields, lowest = _system(problem, self._grid), self._prepared(problem), self._lowest
        cap = problem.hardness if problem.hardness < np.inf else None
        progress, u = self._begin(system, start), fields.at.u
        parts = self._transforms.plans, self._single.plans, system, fields, lowest, start
        calls = self._calls_for(system, start, cap)
        chunk, converged, released, part = max(4, _CHUNK // self._grid.size), False, 0.0, self._part
        lowest.x[:] = self._mode
        while not converged and progress.iterations < limit and not progress.pulled_off:
            before, most = progress.iterations, min(chunk, limit - progress.iterations)
            reached = follow(calls, *parts, progress, tolerance, most, cap)
            progress, converged, released = reached.now, reached.converged, reached.released
            if reached.pairs:
                self._margin, part = reached.margin, part + reached.pairs
                if not converged:
                    progress, converged = self._leave(system, progress, reached.curvature, cap)
                continue
            within = progress.done == 1.0 and progress.residual <= tolerance
            if not within and progress.iterations < before + most:
                break
        pairs, part = divmod(progress.pairs + part, 1.0)
        if converged:
            self._mode[:], self._part = lowest.x, part
        pressure, gap, flow, under = fields.at.stress + progress.multiplier, None, None, problem
        if cap is not None:
            gap, flow = np.maximum(system.h - u, 0.0), np.maximum(u - system.h, 0.0)
            pressure, under = (
                problem.capped(pressure, flow > 0),
                replace(problem, obstacle=system.h + flow),
            )
        return make_solution(
            under,
            u.copy(),
            pressure,
            fields.spectrum.copy() if converged else self._transforms.forward(u),
            spent=(int(pairs), progress.iterations),
            within=np.inf if converged else -1.0,
            gap=gap,
            flow=flow,
            least_residual=0.0 if cap is None else progress.residual,  # the pressures above it count too
            released_energy=released / self._grid.size,
            margin=self._margin,
        )

    def _prepared(self, problem: Problem) -> NewtonFields:
        """The work arrays, with the cycle for the stiffness of the step."""
        step, stiffness, n = self._fields.step, problem.stiffness, self._grid.size
        if not problem.ranks.minimum(int(np.array_equal(self._stiffness, stiffness))):
            self._stiffness = stiffness.copy()
            kappa_1 = problem.residual_floor.stiffness
            step.kappa[:] = stiffness / (n * unit_of(kappa_1))
            if n >= WORTH_CYCLE and len(self._grid.points) > 1:
                local = is_local(self._grid, stiffness)
                cycle = cycle_of(self._grid, stiffness, kappa_1) if local else no_cycle()
                D = cycle.D[: step.d.size] if cycle.grids.size else self._single.empty_field()
                self._fields = self._fields._replace(step=step._replace(cycle=cycle, stiffness=D))
        return self._fields

    def _begin(self, system: AdhesiveSystem, start: FloatArray) -> NewtonState:
        """Set the surface where it begins; return where the path is."""
        fields, u = self._fields, self._fields.at.u
        if set_surface(system.h, start, u, system.over):
            return _FROM_GAP
        fields.held[:], fields.origin.balance[:], u[:] = 0.0, math.nan, 0.0
        project(u, system.h, system.mean_is_fixed, self._grid.ranks)
        return _FROM_REST

    def _calls_for(self, system: AdhesiveSystem, start: FloatArray, cap: float | None) -> NewtonCalls:
        """The addresses of the kernels for the arrays of a problem."""
        kinds = types_of(system, start, cap)
        if kinds not in self._calls:
            fields, plans, single = self._fields, self._transforms.plans, self._single.plans
            at, origin, pair = fields.at, fields.origin, (0.0, 0.0)
            self._calls[kinds] = NewtonCalls(
                address_of(hold, plans, system, fields, cap),
                address_of(iterate, plans, single, system, fields, _FROM_GAP, 0.0, 0, cap),
                address_of(find_margin, single, system, at, fields.step, self._lowest),
                address_of(along_deviation, system, start, at, origin, 0.0),
                address_of(released_over, system, start, at, fields.held, origin, pair, pair),
            )
        return self._calls[kinds]

    def _leave(
        self, system: AdhesiveSystem, progress: NewtonState, curvature: float, cap: float | None
    ) -> tuple[NewtonState, bool]:
        """Leave a state in balance that is no minimum; return whether it cannot be left."""
        fields, plans = self._fields, self._transforms.plans
        change, pairs = leave(plans, system, fields.at, fields.to, fields.step, self._lowest.x, cap)
        return progress._replace(
            energy=math.nan,
            pairs=progress.pairs + pairs,
            iterations=progress.iterations + 1,
            descends=True,
            unstable=True,
            drop=progress.drop - change,
            damping=-2 * curvature,
        ), change == 0.0

    def compile(self) -> None:
        """Compile the kernel for a balance of forces that is no minimum."""
        fields, size = self._fields, self._mode.size
        stiffness = np.ones(fields.spectrum.size)
        system = _system(Problem(stiffness, np.zeros_like(fields.spectrum), np.ones(size)), self._grid)
        for array in (*fields.at, *fields.to, *fields.step[:-1], *fields.origin, self._lowest.x):
            array[:] = 0.0
        leave(self._transforms.plans, system, fields.at, fields.to, fields.step, self._lowest.x, None)

    def state(self) -> State:
        """Return the lowest mode, and the count of a part of a pair."""
        return {"mode": self._mode, "part": self._part}

    def restore(self, state: State) -> None:
        """Continue from a state."""
        self._mode[:], self._part = state["mode"], float(state["part"])


def _any_deformation(grid: Grid) -> FloatArray:
    """Return a deformation without symmetry, always the same; each rank has its rows of it."""
    numbers, row = np.random.default_rng(0), grid.size // grid.points[0]
    for _ in range(grid.first_row):
        numbers.normal(size=row)
    return numbers.normal(size=math.prod(grid.shape))


def _system(problem: Problem, grid: Grid) -> AdhesiveSystem:
    n, law, floor = grid.size, problem.interface, problem.residual_floor
    return AdhesiveSystem(
        problem.stiffness / n,
        problem.intercept / n,
        problem.obstacle,
        law.terms,
        max(law.strength, 1e-300),
        floor.range,
        problem.mean_is_fixed,
        float(problem.applied_pressure),
        floor.stiffness,
        floor,
        float(n),
        grid.completion,
    )
