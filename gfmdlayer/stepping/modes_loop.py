"""The compiled passes over the relaxing modes; see `modes` for the equations.

Spectra come as real arrays of twice the length, real and imaginary parts in turn, and what multiplies them is
repeated alike: so the vector units take them. Each pass goes through the wavenumbers in blocks, and within a
block through the modes.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# Sums may be reordered and products contracted, which the vector units need; NaN and inf keep their meaning.
_FASTMATH = {"reassoc", "contract"}

# Numbers of a block: what is summed into stays in the innermost cache while the modes stream by.
_BLOCK = 2048


class Factors(NamedTuple):
    """What a step of x = dt/theta does to a mode; each in the shape of x."""

    decay: FloatArray
    gain: FloatArray
    loss: FloatArray
    lead: FloatArray
    rest: FloatArray
    bend: FloatArray
    bend_heat: FloatArray


@nb.njit(nogil=True, cache=True, fastmath=_FASTMATH)
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


@nb.njit(nogil=True, cache=True, fastmath=_FASTMATH)
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
        if curvature.size:
            curved[: new.size] = curvature[part_]
        of_u, of_change, of_c = 0.0, 0.0, 0.0
        for i in range(new.size):
            moved = new[i] - old[i]
            change[i] = moved
            old[i] = new[i]
            of_u += spring[i] * new[i] * new[i]
            of_change += share[i] * moved * moved
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


@nb.njit(nogil=True, cache=True, fastmath=_FASTMATH)
def mean(measure: FloatArray, f: FloatArray, g: FloatArray) -> float:
    """Sum of measure f g; not left to BLAS, whose threads cost more here than they save."""
    total = 0.0
    for i in range(measure.size):
        total += measure[i] * f[i] * g[i]
    return total
