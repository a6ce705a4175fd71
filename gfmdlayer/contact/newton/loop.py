"""The loop of Newton's method: along the branch while there is one, down the energy where it ends."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.newton.passes import (
    AdhesiveState,
    AdhesiveSystem,
    Step,
    balance,
    begin,
    compare,
    lost,
    minimise,
    move,
    set_interaction,
    set_stress,
    shorten,
)
from gfmdlayer.grid.transforms import Plans
from gfmdlayer.kernels import kernel

_INEXACT = 0.1  # part of the force that the conjugate gradients may leave, at most
_WELL_WITHIN = 0.3  # part of the tolerance that they aim at in the end
_SHORTEST = 1 / 16  # part of the motion of the punch, at least, between two states of a branch
_CHANGE = 0.5  # largest error of the traction in a step along a branch, over the strength
_RESOLVED = 0.3  # likewise down the energy
_LONGER, _SHORTER = 8.0, 4.0  # growth and cut of the steps down the energy, at most
_TOO_FAR = 0.25  # part of such a step that is taken at least
_AT_REST = 0.1  # damping, over kappa_1, below which there is none
_SETTLED = 0.1  # error of the traction in a step without damping at which the descent ends
_OVERSHOT = 0.3  # slope of the energy at the end of a step, over that at its beginning, that shortens it
_HOPELESS = 1e6  # damping, over the largest stiffness of a point, at which only rounding is left to descend
_NOTHING = 0.03  # energy lost, over the work of adhesion of a point, that is no instability
_FAR = 1e300  # range of the hard wall
_LIFTED = 1e-6  # lack of the mean, over its change in the step, that the punch has yet to make up
_OF_SUMS = 1e-12  # likewise over the largest displacement: what rounding leaves of a mean
_ROUNDING = 1e-13  # of energies, over their parts
IN_SINGLE = 0.5  # a pair of transforms in single precision counts as this part of one


class NewtonFields(NamedTuple):
    """Work arrays."""

    at: AdhesiveState
    to: AdhesiveState
    held: FloatArray
    step: Step
    spectrum: ComplexArray  # of u


class Progress(NamedTuple):
    """What one call of the loop hands to the next."""

    done: float  # part of the motion of the punch, 1 where the traction that held the surface is gone
    mean: float  # mean displacement at the beginning of that motion
    damping: float
    descends: bool
    unstable: bool  # whether the descent has met an energy that is not convex
    drop: float  # sum over the points of the energy lost in this descent
    released: float  # likewise in those that have ended
    pulled_off: bool
    multiplier: float
    residual: float
    energy: float  # of the interface, sum over the points; NaN where the state has to be evaluated anew
    pairs: float
    iterations: int


@kernel
def is_lost(system: AdhesiveSystem, drop: float, unstable: bool) -> bool:
    """Whether the energy lost in a descent is that of an instability.

    The descent may also set right a step along the branch that has gone astray, by much less than the work of
    adhesion of one point.
    """
    return unstable and drop > _NOTHING * system.strength * system.range


@kernel(reorder=True)
def iterate(  # noqa: C901  # compiled as one, for its many results
    plans: Plans,
    single: Plans,
    system: AdhesiveSystem,
    fields: NewtonFields,
    given: Progress,
    tolerance: float,
    limit: int,
) -> Progress:
    """Iterate until the residual is within the tolerance, or to the limit; the state is `fields.at`.

    Where the residual is within the tolerance and the energy known, the spectrum is that of the state.
    """
    held, step = fields.held, fields.step
    at, to, swapped = fields.at, fields.to, False
    (
        done, mean0, damping, descends, unstable, drop, released, pulled_off, multiplier, residual, energy,
        pairs, _,
    ) = given  # fmt: skip
    iterations, settled, evaluated = 0, False, np.isnan(energy)
    if evaluated:
        set_stress(plans, system, at, fields.spectrum, step.spectrum)
        energy = set_interaction(system, at)
        pairs += 1.0
    while True:
        target = done if descends else 1.0
        residual, multiplier, largest = balance(system, at, held, 1.0 - target, step)
        mean = (1.0 - target) * mean0
        lack = _lack(at.u, mean, mean0) if mean0 != 0.0 else 0.0
        # A flat surface is in balance at any mean: the residual does not tell whether it has moved.
        if (done == 1.0 and residual <= tolerance and lack == 0.0) or iterations == limit or pulled_off:
            break
        aim = tolerance * max(system.strength, step.pressure.max())
        if descends and done < 1.0 and lack == 0.0 and (largest <= aim or settled):
            released += drop if is_lost(system, drop, unstable) else 0.0
            descends, unstable, drop, damping = False, False, 0.0, 0.0
            continue
        iterations += 1
        inexact = min(_INEXACT, np.sqrt(residual)) if done == 1.0 else _INEXACT
        spent, least = _find_step(single, system, at, step, damping, lack, _WELL_WITHIN * aim, inexact)
        pairs += IN_SINGLE * spent
        if least < 0.0:
            done = done if descends else min(1.0, done + _SHORTEST)
            descends, settled, unstable = True, False, True
            # Where there is no curvature at all, as of a punch that is pulled off, a step by the range.
            damping = max(2.0 * damping, damping - 2.0 * least, largest / min(system.range, _FAR))
            continue
        move(system, at, step, mean, to)
        set_stress(plans, system, to, fields.spectrum, step.spectrum)
        after = set_interaction(system, to)
        pairs, evaluated = pairs + 1.0, False
        first, last, elastic, error = compare(system, at, step.pressure, held, 1.0 - target, multiplier, to)
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
            after = set_interaction(system, to)
            _, _, elastic, error = compare(system, at, step.pressure, held, 1.0 - target, multiplier, to)
        change = elastic + after - energy
        uphill = not first < 0.0 or change > _ROUNDING * (abs(energy) + abs(elastic))
        if done == target and lack == 0.0 and (uphill or way < _TOO_FAR):
            # Uphill, where the wall has bent the step or the energy is far from a parabola, or too far.
            descends, settled = True, False
            damping = max(_SHORTER * damping, _AT_REST * system.kappa_1)
            if damping > _HOPELESS * (system.kappa_1 + max(at.curvature.max(), -at.curvature.min())):
                break
            continue
        at, to, swapped, energy, evaluated = to, at, not swapped, after, way == 1.0
        if not descends:
            done += way * (target - done)
            continue
        if lack == 0.0:
            drop -= change
            unstable = unstable or last < first  # the energy falls ever more steeply
        settled = damping == 0.0 and way == 1.0 and error < _SETTLED
        # The error grows as the square of the step, and the step as the inverse of the damping.
        damping *= min(max(np.sqrt(error / _RESOLVED), 1.0 / _LONGER), 1.0) / way
        damping = 0.0 if damping < _AT_REST * system.kappa_1 else damping
        if system.load < 0.0 and not system.mean_is_fixed:
            pulled_off = lost(system, at)
    if swapped:
        _copy(at, to)
    iterations += given.iterations
    residual = np.inf if lack != 0.0 else residual
    return Progress(
        done,
        mean0,
        damping,
        descends,
        unstable,
        drop,
        released,
        pulled_off,
        multiplier,
        residual,
        energy if evaluated or residual > tolerance else np.nan,
        pairs,
        iterations,
    )


@kernel(reorder=True, inner=True)
def _lack(u: FloatArray, mean: float, mean0: float) -> float:
    """Find what the mean has yet to make up of its change in the step, as a sum over the points."""
    total, largest = 0.0, 0.0
    for i in range(u.size):
        total += u[i]
        largest = max(largest, abs(u[i]))
    lack = mean * u.size - total
    return lack if abs(lack) > (_LIFTED * abs(mean0) + _OF_SUMS * largest) * u.size else 0.0


@kernel(reorder=True, inner=True)
def _find_step(
    single: Plans,
    system: AdhesiveSystem,
    at: AdhesiveState,
    step: Step,
    damping: float,
    lack: float,
    floor: float,
    inexact: float,
) -> tuple[int, float]:
    """Solve for a step; return the FFT pairs and the least curvature, as `minimise`."""
    pairs = begin(single, system, at.curvature, step, damping, lack)
    # Stresses and stiffnesses of order one: in SI units squares would underflow in single precision.
    unit, d, force = max(np.abs(step.force).max(), 1e-30), step.d, step.force
    stiff = 2.0 ** np.floor(np.log2(max(system.kappa_1, 1e-300)))  # to which no digit is lost
    for i in range(d.size):
        d[i], force[i] = d[i] * (stiff / unit), force[i] / unit
        step.stiffness[i] /= stiff
    for k in range(step.kappa.size):
        step.kappa[k], step.softening[k] = step.kappa[k] / stiff, step.softening[k] * stiff
    step.point[0] *= stiff
    turns, least = minimise(single, system, system.kappa_1 / stiff, step, floor / unit, inexact)
    for i in range(d.size):
        d[i] *= unit / stiff
    return pairs + 2 * turns, least * stiff


@kernel(inner=True)
def _copy(source: AdhesiveState, target: AdhesiveState) -> None:
    for i in range(source.u.size):
        target.u[i] = source.u[i]
        target.stress[i] = source.stress[i]
        target.traction[i] = source.traction[i]
        target.curvature[i] = source.curvature[i]


@kernel(reorder=True)
def hold(plans: Plans, system: AdhesiveSystem, fields: NewtonFields) -> float:
    """Find the traction that holds a surface where it is; return its energy as `set_interaction`."""
    at, held, step = fields.at, fields.held, fields.step
    set_stress(plans, system, at, fields.spectrum, step.spectrum)
    energy = set_interaction(system, at)
    held[:] = 0.0
    balance(system, at, held, 0.0, step)
    total, count = 0.0, 0.0
    for i in range(held.size):
        held[i] = step.free[i] * step.pressure[i]
        total += held[i]
        count += step.free[i]
    if system.mean_is_fixed and count > 0.0:
        for i in range(held.size):
            held[i] -= step.free[i] * total / count
    return energy
