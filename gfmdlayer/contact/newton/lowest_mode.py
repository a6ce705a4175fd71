"""The lowest mode of the free points: whether a state is a minimum, and how far from an instability.

The margin of a state is the least of

    x.(K + w'')x / x.(K + kappa_1/2)x

over all displacements x of the free points. Without attraction it is 1 or more; where a branch ends it falls
to zero as the square root of the distance to that point. A state in balance may be no minimum: an even film
stays flat, and a symmetric contact symmetric, without a force that tells. So x is found by itself, by
preconditioned conjugate gradients on this ratio (Knyazev, SIAM J. Sci. Comput. 23 (2001) 517), and kept from
step to step, so that one turn of two FFT pairs follows it. Single precision knows the ratio to 1e-6.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.newton.passes import (
    AdhesiveState,
    AdhesiveSystem,
    Step,
    apply,
    begin,
    move,
    precondition,
    set_interaction,
    set_stress,
)
from gfmdlayer.grid.transforms import Plans
from gfmdlayer.kernels import kernel

_MOST = 30  # turns
_STEADY = 0.02, 0.003  # fall of the margin in a turn, over itself and in all, at which it is known
_SHORTER = 8  # times that this is tried with a quarter of it
_KICK = 0.3  # change of the traction, over the strength, by which a state that is no minimum is left


class LowestMode(NamedTuple):
    """The lowest mode x, and work arrays of the search for it, in single precision."""

    x: Any
    before: Any
    d: Any
    Kd: Any


@kernel(reorder=True)
def find_margin(
    single: Plans, system: AdhesiveSystem, at: AdhesiveState, step: Step, lowest: LowestMode
) -> tuple[float, float, float, int]:
    """Improve the lowest mode.

    Returns the margin, an upper bound which more turns lower; the curvature x.(K + w'')x and the attraction
    -x.w''x over the sum of x^2; and the FFT pairs.
    """
    free, curvature, half, n = step.free, at.curvature, 0.5 * system.kappa_1, at.u.size
    Kx, slope, w, Kw = step.direction, step.force, step.z, step.applied
    x, before, d, Kd = lowest
    begin(single, system, curvature, step, 0.0, 0.0)  # the preconditioner
    d[:], Kd[:] = 0.0, 0.0
    _admit(system, free, x)
    apply(single, step.kappa, x, step.work, Kx)
    pairs, margin, last, across = 1, np.inf, np.inf, 1.0
    for turn in range(_MOST + 1):
        xHx, xBx = 0.0, 0.0
        for i in range(n):
            xHx += x[i] * (Kx[i] + curvature[i] * x[i])
            xBx += x[i] * (Kx[i] + half * x[i])
        if not xBx > 0.0:
            return 1.0, 1.0, 0.0, pairs
        last, margin = margin, xHx / xBx
        if turn == _MOST or (turn > 0 and last - margin < _STEADY[0] * abs(margin) + _STEADY[1]):
            break
        for i in range(n):
            before[i] = slope[i]
            slope[i] = free[i] * ((1.0 - margin) * Kx[i] + (curvature[i] - margin * half) * x[i])
        _admit(system, free, slope)
        precondition(single, step, slope, w)
        _admit(system, free, w)
        apply(single, step.kappa, w, step.work, Kw)
        pairs += 2
        previous, across, change = across, 0.0, 0.0
        for i in range(n):
            across += slope[i] * w[i]
            change += (slope[i] - before[i]) * w[i]
        beta = max(change / previous, 0.0) if turn > 0 else 0.0
        xHd, dHd, xBd, dBd = 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            d[i], Kd[i] = beta * d[i] - w[i], beta * Kd[i] - Kw[i]
            xHd += d[i] * (Kx[i] + curvature[i] * x[i])
            dHd += d[i] * (Kd[i] + curvature[i] * d[i])
            xBd += d[i] * (Kx[i] + half * x[i])
            dBd += d[i] * (Kd[i] + half * d[i])
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
        attraction -= curvature[i] * x[i] * x[i]
    return margin, xHx / square, attraction / square, pairs


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
def _admit(system: AdhesiveSystem, free: FloatArray, x: Any) -> None:
    """Take away what the constraints do not let move."""
    total, count = 0.0, 0.0
    for i in range(x.size):
        x[i] *= free[i]
        total += x[i]
        count += free[i]
    mean = total / count if system.mean_is_fixed and count > 0.0 else 0.0
    for i in range(x.size):
        x[i] -= mean * free[i]


@kernel(reorder=True)
def leave(
    plans: Plans, system: AdhesiveSystem, at: AdhesiveState, to: AdhesiveState, step: Step, x: Any
) -> tuple[float, int]:
    """Leave a state that is no minimum along x, to the side where the energy is lower.

    Returns the change of the energy, sum over the points, and the FFT pairs.
    """
    n, strongest = x.size, 1e-300
    for i in range(n):
        strongest = max(strongest, abs(at.curvature[i] * x[i]))
    far, energy, pairs = _KICK * system.strength / strongest, set_interaction(system, at), 0
    mean = at.u.mean() if system.mean_is_fixed else 0.0
    for _ in range(_SHORTER):
        best, side = 0.0, 0.0
        for sign in (1.0, -1.0, 0.0):
            if sign == 0.0 and (side == 0.0 or side == -1.0):
                break  # neither is lower, or the last is
            for i in range(n):
                step.d[i] = (sign if sign != 0.0 else side) * far * x[i]
            move(system, at, step, mean, to)
            set_stress(plans, system, to, step.spectrum, step.spectrum)
            pairs += 1
            change = set_interaction(system, to) - energy
            for i in range(n):
                change -= (0.5 * (at.stress[i] + to.stress[i]) + system.load) * (to.u[i] - at.u[i])
            if change < best:
                best, side = change, sign
        if best < 0.0:
            for i in range(n):
                at.u[i] = to.u[i]
            return best, pairs
        far *= 0.25
    return 0.0, pairs
