"""The compiled loops over the relaxing modes; see `modes` for the equations and the two kinds of modes.

Spectra are real arrays of twice the length, alternating real and imaginary parts, and their factors are
repeated for both, as vector units need it. The loops take the wavenumbers in blocks, and in a block the
modes. They act on the wavenumbers that this process holds and return partial sums (`gfmdlayer.grid.sums`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.kernels import kernel

# Numbers of a block: the sums of a block stay in the innermost cache while the modes stream by.
_BLOCK = 2048

_SMALL = 0.1  # dt/theta below which differences of closed forms lose digits


class BranchModes(NamedTuple):
    """Modes with one relaxation time at all q, and weights w_j(q) = moduli_j shape(q)."""

    moduli: FloatArray  # (modes,)
    shape: FloatArray  # (2 nq,)
    energy_shape: FloatArray  # (2 nq,), the shape times Parseval's weights
    stretch: FloatArray  # (modes, 2 nq), the internal variables y_j


class LocalModes(NamedTuple):
    """Pairs of a mode and a wavenumber, each with its own relaxation time and weight."""

    position: IntArray  # (pairs,), of the wavenumber
    weights: FloatArray  # (pairs,)
    energy_weights: FloatArray  # (pairs,), the weights times Parseval's
    stretch: FloatArray  # (pairs, 2)


class StepTerms(NamedTuple):
    """Products of weights and factors for the length of a step."""

    gain: FloatArray  # (2 nq,), sum_j w_j gain_j
    branch_decay: FloatArray  # (modes,), moduli_j decay_j
    local_decay: FloatArray  # (pairs,), w_j decay_j


class Factors(NamedTuple):
    """Factors of a step of the modes, each an array over x = dt/theta; their equations are in `modes`."""

    decay: FloatArray
    gain: FloatArray
    loss: FloatArray
    lead: FloatArray
    remainder: FloatArray
    curvature_gain: FloatArray
    curvature_loss: FloatArray


@kernel
def exponential(x: FloatArray) -> Factors:
    """Factors of the exponential step, u linear in time, for x = dt/theta >= 0."""
    f = np.empty((7, x.size))
    for i in range(x.size):
        some = x[i]
        decay, gain, lead = math.exp(-some), 1.0, 0.5
        if some > 0.0:
            gain, lead = -math.expm1(-some) / some, math.tanh(some / 2) / some
        # By series where two of the closed forms lose more to rounding than the series to truncation.
        if some < _SMALL:
            square = some * some
            remainder = some * (1 / 12 + square * (-1 / 120 + square * (17 / 20160 - square * 31 / 362880)))
            curvature_gain = (1 + decay) * remainder
            higher = 11 / 630 + some * (-1 / 120 + some * (283 / 90720 - some * 289 / 302400))
            curvature_loss = some * (1 / 30 + some * (-1 / 36 + some * higher))
        else:
            remainder = (some - 2 * math.tanh(some / 2)) / some**2
            curvature_gain = (1 + decay) * remainder
            curvature_loss = 1 / (3 * some) - curvature_gain * ((some + 2) / some**2 + curvature_gain / 2)
        f[0, i], f[1, i], f[2, i], f[3, i] = decay, gain, -math.expm1(-2 * some) / 2, lead
        f[4, i], f[5, i], f[6, i] = remainder, curvature_gain, curvature_loss
    return Factors(f[0], f[1], f[2], f[3], f[4], f[5], f[6])


@kernel(reorder=True)
def intercepts(
    branches: BranchModes, local: LocalModes, terms: StepTerms, u: FloatArray, b: FloatArray
) -> None:
    """Set b to sum_j w_j (gain_j u - decay_j y_j)."""
    for start in range(0, b.size, _BLOCK):
        part = slice(start, min(start + _BLOCK, b.size))
        total = b[part]
        total[:] = 0.0
        for j in range(terms.branch_decay.size):
            decay, y = terms.branch_decay[j], branches.stretch[j, part]
            for i in range(y.size):
                total[i] -= decay * y[i]
        gain, shape, u_ = terms.gain[part], branches.shape[part], u[part]
        for i in range(total.size):
            total[i] = gain[i] * u_[i] + shape[i] * total[i]
    for i in range(local.position.size):
        for part_ in range(2):
            b[2 * local.position[i] + part_] -= terms.local_decay[i] * local.stretch[i, part_]


@kernel(reorder=True)
def advance(
    branches: BranchModes,
    branch_factors: Factors,
    local: LocalModes,
    local_factors: Factors,
    springs: FloatArray,
    u: FloatArray,
    new_u: FloatArray,
    curvature: FloatArray,
) -> tuple[float, float]:
    """Advance stretches and displacement by a step; return twice the stored energy, and the heat of the step.

    `springs` is K_0 times Parseval's weights; the array `curvature` is empty where u is linear.
    """
    index, stretch, f, weights = local.position, local.stretch, local_factors, local.energy_weights
    moduli, factors = branches.moduli, branch_factors
    twice, heat, remainder, curvature_loss = 0.0, 0.0, 0.0, 0.0
    for i in range(index.size):
        for part in range(2):
            k = 2 * index[i] + part
            before, moved, c = (
                stretch[i, part],
                new_u[k] - u[k],
                curvature[k] if curvature.size else 0.0,
            )
            after, ahead = f.decay[i] * before + f.gain[i] * moved, before + f.lead[i] * moved
            corrected = after + f.curvature_gain[i] * c
            stretch[i, part] = corrected
            twice += weights[i] * corrected * corrected
            heat += weights[i] * (f.loss[i] * ahead * ahead + f.remainder[i] * moved * moved)
            heat += weights[i] * c * (f.curvature_loss[i] * c - f.curvature_gain[i] * (before + after))
    for j in range(moduli.size):
        remainder += moduli[j] * factors.remainder[j]
        curvature_loss += moduli[j] * factors.curvature_loss[j]
    change, curved = np.empty(_BLOCK), np.zeros(_BLOCK)
    for start in range(0, u.size, _BLOCK):
        part_ = slice(start, min(start + _BLOCK, u.size))
        spring, shape, new, old = springs[part_], branches.energy_shape[part_], new_u[part_], u[part_]
        for i in range(min(curvature.size, new.size)):  # to assign the slice takes seconds to compile
            curved[i] = curvature[start + i]
        of_u, of_change, of_c = 0.0, 0.0, 0.0
        # In small loops, which the compiler can give to the vector units.
        for i in range(new.size):
            change[i] = new[i] - old[i]
        for i in range(new.size):
            of_u += spring[i] * new[i] * new[i]
            old[i] = new[i]
        for i in range(new.size):
            of_change += shape[i] * change[i] * change[i]
            of_c += shape[i] * curved[i] * curved[i]
        twice += of_u
        heat += remainder * of_change + curvature_loss * of_c
        for j in range(moduli.size):
            y, decay, gain, lead = (
                branches.stretch[j, part_],
                factors.decay[j],
                factors.gain[j],
                factors.lead[j],
            )
            correction, of_y, of_ahead, of_correction = factors.curvature_gain[j], 0.0, 0.0, 0.0
            for i in range(y.size):
                before, moved, c = y[i], change[i], curved[i]
                after, ahead = decay * before + gain * moved, before + lead * moved
                corrected = after + correction * c
                y[i] = corrected
                of_y += shape[i] * corrected * corrected
                of_ahead += shape[i] * ahead * ahead
                of_correction += shape[i] * c * (before + after)
            twice += moduli[j] * of_y
            heat += moduli[j] * (factors.loss[j] * of_ahead - correction * of_correction)
    return twice, heat


@kernel(reorder=True)
def curvature_stress(
    gain: float, shape: FloatArray, index: IntArray, local_gains: FloatArray, curvature: FloatArray
) -> FloatArray:
    """Return sum_j w_j curvature_gain_j c; `gain` is summed over the branch modes."""
    total = np.empty(curvature.size)
    for i in range(total.size):
        total[i] = gain * shape[i] * curvature[i]
    for i in range(index.size):
        for k in range(2 * index[i], 2 * index[i] + 2):
            total[k] += local_gains[i] * curvature[k]
    return total


@kernel(reorder=True)
def curvature(
    ratio: float, step: float, new_u: FloatArray, u: FloatArray, velocity: FloatArray
) -> FloatArray:
    """Return dt^2 u''/2 from the last velocity; the ratio is that of this step to the sum of the last two."""
    found = np.empty(u.size)
    for i in range(u.size):
        found[i] = ratio * (new_u[i] - u[i] - step * velocity[i])
    return found


@kernel(reorder=True)
def force(stiffness: FloatArray, u: FloatArray, b: FloatArray) -> FloatArray:
    """Return -sigma = stiffness u - b."""
    total = np.empty(b.size)
    for k in range(stiffness.size):
        total[2 * k] = stiffness[k] * u[2 * k] - b[2 * k]
        total[2 * k + 1] = stiffness[k] * u[2 * k + 1] - b[2 * k + 1]
    return total


@kernel(reorder=True)
def stress_norm(weights: FloatArray, stiffness: FloatArray, u: FloatArray) -> float:
    """Mean square of stiffness u over the surface."""
    total = 0.0
    for k in range(stiffness.size):
        total += weights[k] * stiffness[k] ** 2 * (u[2 * k] ** 2 + u[2 * k + 1] ** 2)
    return total


@kernel(reorder=True)
def displacement_error(
    weights: FloatArray, stiffness: FloatArray, error: FloatArray, ratio: float, force: FloatArray
) -> float:
    """Mean square of (error - ratio force)/stiffness over the surface, where the stiffness is not zero."""
    total = 0.0
    for k in range(stiffness.size):
        if stiffness[k] > 0.0:
            real, imaginary = error[2 * k] - ratio * force[2 * k], error[2 * k + 1] - ratio * force[2 * k + 1]
            total += weights[k] * (real * real + imaginary * imaginary) / stiffness[k] ** 2
    return total
