"""The compiled passes over the relaxing modes; see `modes` for the equations.

Spectra come as real arrays of twice the length, real and imaginary parts in turn, and what multiplies them is
repeated alike: so the vector units take them. Each pass goes through the wavenumbers in blocks, and within a
block through the modes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.kernels import kernel

# Numbers of a block: what is summed into stays in the innermost cache while the modes stream by.
_BLOCK = 2048

_SMALL = 0.1  # dt/theta


class Factors(NamedTuple):
    """What a step of x = dt/theta does to a mode; one value for each x."""

    decay: FloatArray
    gain: FloatArray
    loss: FloatArray
    lead: FloatArray
    rest: FloatArray
    bend: FloatArray
    bend_heat: FloatArray


@kernel
def exponential(x: FloatArray) -> Factors:
    """Factors of the exponential step with u linear in time, x = dt/theta >= 0."""
    f = np.empty((7, x.size))
    for i in range(x.size):
        some = x[i]
        decay, gain, lead = math.exp(-some), 1.0, 0.5
        if some > 0.0:
            gain, lead = -math.expm1(-some) / some, math.tanh(some / 2) / some
        # By series where two of the closed forms lose more to rounding than those to truncation.
        if some < _SMALL:
            square = some * some
            rest = some * (1 / 12 + square * (-1 / 120 + square * (17 / 20160 - square * 31 / 362880)))
            bend = (1 + decay) * rest
            higher = 11 / 630 + some * (-1 / 120 + some * (283 / 90720 - some * 289 / 302400))
            bend_heat = some * (1 / 30 + some * (-1 / 36 + some * higher))
        else:
            rest = (some - 2 * math.tanh(some / 2)) / some**2
            bend = (1 + decay) * rest
            bend_heat = 1 / (3 * some) - bend * ((some + 2) / some**2 + bend / 2)
        f[0, i], f[1, i], f[2, i], f[3, i] = decay, gain, -math.expm1(-2 * some) / 2, lead
        f[4, i], f[5, i], f[6, i] = rest, bend, bend_heat
    return Factors(f[0], f[1], f[2], f[3], f[4], f[5], f[6])


@kernel(reorder=True)
def intercepts(
    pulls: FloatArray,
    shape: FloatArray,
    stretches: FloatArray,
    index: IntArray,
    own_pulls: FloatArray,
    own_stretches: FloatArray,
    slope: FloatArray,
    u: FloatArray,
    b: FloatArray,
) -> None:
    """Return in b what is slope u - sum_j w_j decay_j y_j."""
    for start in range(0, b.size, _BLOCK):
        part = slice(start, min(start + _BLOCK, b.size))
        total = b[part]
        total[:] = 0.0
        for j in range(pulls.size):
            pull, y = pulls[j], stretches[j, part]
            for i in range(y.size):
                total[i] -= pull * y[i]
        pull_, shape_, u_ = slope[part], shape[part], u[part]
        for i in range(total.size):
            total[i] = pull_[i] * u_[i] + shape_[i] * total[i]
    for i in range(index.size):
        for part_ in range(2):
            b[2 * index[i] + part_] -= own_pulls[i] * own_stretches[i, part_]


@kernel(reorder=True)
def advance(
    moduli: FloatArray,
    factors: Factors,
    shares: FloatArray,
    stretches: FloatArray,
    index: IntArray,
    own_weights: FloatArray,
    own: Factors,
    own_stretches: FloatArray,
    springs: FloatArray,
    u: FloatArray,
    found: FloatArray,
    curvature: FloatArray,
) -> tuple[float, float]:
    """Carry stretches and displacement on; return twice the stored energy and the heat of the step.

    Without curvature its array is empty.
    """
    twice, heat, rest, bend_heat = 0.0, 0.0, 0.0, 0.0
    for i in range(index.size):
        for part in range(2):
            k = 2 * index[i] + part
            before, moved, c = (
                own_stretches[i, part],
                found[k] - u[k],
                curvature[k] if curvature.size else 0.0,
            )
            after, ahead = own.decay[i] * before + own.gain[i] * moved, before + own.lead[i] * moved
            bent = after + own.bend[i] * c
            own_stretches[i, part] = bent
            twice += own_weights[i] * bent * bent
            heat += own_weights[i] * (own.loss[i] * ahead * ahead + own.rest[i] * moved * moved)
            heat += own_weights[i] * c * (own.bend_heat[i] * c - own.bend[i] * (before + after))
    for j in range(moduli.size):
        rest += moduli[j] * factors.rest[j]
        bend_heat += moduli[j] * factors.bend_heat[j]
    change, curved = np.empty(_BLOCK), np.zeros(_BLOCK)
    for start in range(0, u.size, _BLOCK):
        part_ = slice(start, min(start + _BLOCK, u.size))
        spring, share, new, old = springs[part_], shares[part_], found[part_], u[part_]
        for i in range(min(curvature.size, new.size)):  # to assign the slice takes seconds to compile
            curved[i] = curvature[start + i]
        of_u, of_change, of_c = 0.0, 0.0, 0.0
        # In small loops, of which the compiler can tell that the vector units may take them.
        for i in range(new.size):
            change[i] = new[i] - old[i]
        for i in range(new.size):
            of_u += spring[i] * new[i] * new[i]
            old[i] = new[i]
        for i in range(new.size):
            of_change += share[i] * change[i] * change[i]
            of_c += share[i] * curved[i] * curved[i]
        twice += of_u
        heat += rest * of_change + bend_heat * of_c
        for j in range(moduli.size):
            y, decay, gain, lead = stretches[j, part_], factors.decay[j], factors.gain[j], factors.lead[j]
            bend, of_y, of_ahead, of_bend = factors.bend[j], 0.0, 0.0, 0.0
            for i in range(y.size):
                before, moved, c = y[i], change[i], curved[i]
                after, ahead = decay * before + gain * moved, before + lead * moved
                bent = after + bend * c
                y[i] = bent
                of_y += share[i] * bent * bent
                of_ahead += share[i] * ahead * ahead
                of_bend += share[i] * c * (before + after)
            twice += moduli[j] * of_y
            heat += moduli[j] * (factors.loss[j] * of_ahead - bend * of_bend)
    return twice, heat


@kernel(reorder=True)
def slopes(
    gain: float,
    shape: FloatArray,
    index: IntArray,
    own_gains: FloatArray,
    relaxed: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return sum_j w_j gain_j, repeated, and with it the stiffness at the end of a step."""
    pull, stiffness = np.empty(shape.size), relaxed.copy()
    for i in range(pull.size):
        pull[i] = gain * shape[i]
    for i in range(index.size):
        pull[2 * index[i]] += own_gains[i]
        pull[2 * index[i] + 1] += own_gains[i]
    for k in range(stiffness.size):
        stiffness[k] += pull[2 * k]
    return pull, stiffness


@kernel(reorder=True)
def missing(
    bend: float, shape: FloatArray, index: IntArray, own_bends: FloatArray, curvature: FloatArray
) -> FloatArray:
    """Return sum_j w_j bend_j curvature."""
    total = np.empty(curvature.size)
    for i in range(total.size):
        total[i] = bend * shape[i] * curvature[i]
    for i in range(index.size):
        for k in range(2 * index[i], 2 * index[i] + 2):
            total[k] += own_bends[i] * curvature[k]
    return total


@kernel(reorder=True)
def curvature(
    share: float, step: float, found: FloatArray, u: FloatArray, velocity: FloatArray
) -> FloatArray:
    """Return what, with its share, the displacement has beyond that of a steady velocity."""
    bent = np.empty(u.size)
    for i in range(u.size):
        bent[i] = share * (found[i] - u[i] - step * velocity[i])
    return bent


@kernel(reorder=True)
def force(stiffness: FloatArray, found: FloatArray, b: FloatArray) -> FloatArray:
    """Return stiffness u - b."""
    total = np.empty(b.size)
    for k in range(stiffness.size):
        total[2 * k] = stiffness[k] * found[2 * k] - b[2 * k]
        total[2 * k + 1] = stiffness[k] * found[2 * k + 1] - b[2 * k + 1]
    return total


@kernel(reorder=True)
def means(measure: FloatArray, v: FloatArray, f: FloatArray, g: FloatArray) -> tuple[float, float, float]:
    """Sums of measure v f, measure v g and measure v v; not left to BLAS, whose threads cost more here."""
    with_f, with_g, squares = 0.0, 0.0, 0.0
    for i in range(measure.size):
        part = measure[i] * v[i]
        with_f += part * f[i]
        with_g += part * g[i]
        squares += part * v[i]
    return with_f, with_g, squares


@kernel(reorder=True)
def loudness(measure: FloatArray, stiffness: FloatArray, u: FloatArray) -> float:
    """Sum of measure (stiffness u)^2."""
    total = 0.0
    for k in range(stiffness.size):
        total += measure[k] * stiffness[k] ** 2 * (u[2 * k] ** 2 + u[2 * k + 1] ** 2)
    return total


@kernel(reorder=True)
def yielding(
    measure: FloatArray, stiffness: FloatArray, lack: FloatArray, part: float, force: FloatArray
) -> float:
    """Sum of measure ((lack - part force)/stiffness)^2 over what has a stiffness."""
    total = 0.0
    for k in range(stiffness.size):
        if stiffness[k] > 0.0:
            one, other = lack[2 * k] - part * force[2 * k], lack[2 * k + 1] - part * force[2 * k + 1]
            total += measure[k] * (one * one + other * other) / stiffness[k] ** 2
    return total
