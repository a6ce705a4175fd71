"""The softest deformation of the free points: whether a state is a minimum, and how far from an instability.

The margin of a state is the least of

    x.(K + w'')x / x.(K + kappa_1/2)x

over all displacements x of the free points. It is 1 or more without attraction and falls to zero where a branch
ends, as the square root of the distance to that point. A state in balance may be no minimum: an even film
stays flat, and a symmetric contact symmetric, without a force that tells. So x is found by itself, by
preconditioned steepest descent of this ratio (Knyazev, SIAM J. Sci. Comput. 23 (2001) 517), and kept from step
to step, so that one turn of two FFT pairs follows it.
"""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.newton.passes import Step, Surface, System, apply, begin, move, set_interaction, set_stress
from gfmdlayer.grid.transforms import Plans
from gfmdlayer.kernels import kernel

_MOST = 30  # turns
_STEADY = 0.1, 0.01  # fall of the margin in a turn, over itself and in all, at which it is known
_KICK = 0.3  # change of the traction, over the strength, by which a state that is no minimum is left


@kernel(reorder=True)
def find_margin(
    plans: Plans, system: System, at: Surface, step: Step, x: FloatArray
) -> tuple[float, float, float, int]:
    """Improve the softest deformation x.

    Returns
    -------
    margin : float
        An upper bound of it, which more turns lower.
    curvature, attraction : float
        x.(K + w'')x and -x.w''x over the sum of x^2.
    pairs : int
        FFT pairs.
    """
    free, Kx, w, Kw, n = step.free, step.direction, step.z, step.applied, x.size
    half, curvature = 0.5 * system.softest, at.curvature
    begin(plans, system, step, 0.0, 0.0)  # the preconditioner
    _admit(system, free, x)
    apply(plans, system.kappa, x, step.work, Kx)
    pairs, before = 1, np.inf
    for turn in range(_MOST + 1):
        xHx, xBx = 0.0, 0.0
        for i in range(n):
            xHx += x[i] * (Kx[i] + curvature[i] * x[i])
            xBx += x[i] * (Kx[i] + half * x[i])
        if not xBx > 0.0:
            return 1.0, 1.0, 0.0, pairs
        margin = xHx / xBx
        known = before - margin < _STEADY[0] * abs(margin) + _STEADY[1]
        if turn == _MOST or (turn > 0 and known):
            break
        before = margin
        for i in range(n):
            step.force[i] = free[i] * ((1.0 - margin) * Kx[i] + (curvature[i] - margin * half) * x[i])
        _admit(system, free, step.force)
        apply(plans, step.softening, step.force, step.work, w)
        _admit(system, free, w)
        apply(plans, system.kappa, w, step.work, Kw)
        pairs += 2
        xHw, wHw, xBw, wBw = 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            xHw += w[i] * (Kx[i] + curvature[i] * x[i])
            wHw += w[i] * (Kw[i] + curvature[i] * w[i])
            xBw += w[i] * (Kx[i] + half * x[i])
            wBw += w[i] * (Kw[i] + half * w[i])
        share = _lowest(xHx, xHw, wHw, xBx, xBw, wBw)
        size = xBx + 2.0 * share * xBw + share * share * wBw
        if not size > 0.0:
            break
        scale = 1.0 / np.sqrt(size)
        for i in range(n):
            x[i] = scale * (x[i] + share * w[i])
            Kx[i] = scale * (Kx[i] + share * Kw[i])
    square, attraction = 0.0, 0.0
    for i in range(n):
        square += x[i] * x[i]
        attraction -= curvature[i] * x[i] * x[i]
    return margin, xHx / square, attraction / square, pairs


@kernel(inner=True)
def _lowest(xHx: float, xHw: float, wHw: float, xBx: float, xBw: float, wBw: float) -> float:
    """Share s at which x + s w has the lowest ratio of H to B."""
    # The derivative of the ratio vanishes: a s^2 + b s + c = 0.
    a, b, c = wHw * xBw - xHw * wBw, wHw * xBx - xHx * wBw, xHw * xBx - xHx * xBw
    root = np.sqrt(max(b * b - 4.0 * a * c, 0.0))
    # Of both roots the one at which it rises afterwards: 2 a s + b > 0.
    if b >= 0.0:
        return -2.0 * c / (b + root) if b + root > 0.0 else 0.0
    return (root - b) / (2.0 * a) if a != 0.0 else 0.0


@kernel(reorder=True, inner=True)
def _admit(system: System, free: FloatArray, x: FloatArray) -> None:
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
    plans: Plans, system: System, at: Surface, to: Surface, step: Step, x: FloatArray
) -> tuple[float, int]:
    """Leave a state that is no minimum along x, to the side where the energy is lower.

    Returns
    -------
    change : float
        Of the energy, sum over the points.
    pairs : int
        FFT pairs.
    """
    n, strongest = x.size, 0.0
    for i in range(n):
        strongest = max(strongest, abs(at.curvature[i] * x[i]))
    far, energy, best, side = _KICK * system.strength / strongest, set_interaction(system, at), np.inf, 0.0
    for trial in range(3):
        if trial < 2:
            sign = 1.0 - 2.0 * trial
        elif side == sign:
            break
        else:
            sign = side
        for i in range(n):
            step.d[i] = sign * far * x[i]
        move(system, at, step, at.u.mean() if system.mean_is_fixed else 0.0, to)
        set_stress(plans, system, to, step.work, step.work)
        change = set_interaction(system, to) - energy
        for i in range(n):
            change -= (0.5 * (at.stress[i] + to.stress[i]) + system.load) * (to.u[i] - at.u[i])
        if change < best:
            best, side = change, sign
    for i in range(n):
        at.u[i] = to.u[i] if best < 0.0 else at.u[i]
    return min(best, 0.0), 3
