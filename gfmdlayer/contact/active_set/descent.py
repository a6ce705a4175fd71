"""Projected gradient descent in the pressures: slow, but it ends on every convex problem.

The energy E(p) = p.A p/2 + gap0.p over p >= 0, under a given load over those of the given mean, has the gap
as its gradient, and no eigenvalue of A exceeds 1/kappa_1. A projected step of length kappa_1 therefore never
raises E, and converges linearly (Beck, First-Order Methods in Optimization, 2017, Theorems 10.15 and 10.29).
Steps are extrapolated (Nesterov), and an extrapolation that raised the energy is taken back and followed by a
plain step, which keeps the descent monotone. One FFT pair an iteration.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.pressure_form import Iterate, System, satisfies_kkt
from gfmdlayer.grid.transforms import Plans, backward, forward
from gfmdlayer.kernels import kernel


@kernel(reorder=True)
def descend(  # groups of arrays, and the limits of one call
    plans: Plans,
    system: System,
    at: Iterate,
    work: ComplexArray,
    length: float,
    mean: float,
    shift: float,
    tolerance: float,
    limit: int,
) -> tuple[bool, int]:
    """Improve the iterate until no point violates the conditions for a gap of ``shift`` in the contact.

    Parameters
    ----------
    plans : Plans
        Transforms of the surface.
    system : System
        The problem.
    at : Iterate
        Pressure and gap to begin with, and on return.
    work : ndarray of complex
        Work array, a spectrum.
    length : float
        Of a step, at most the smallest stiffness of a mode.
    mean : float
        Mean of the pressure, where the load is given.
    shift : float
        Gap in the contact that is aimed at.
    tolerance : float
        On the violation at each point.
    limit : int
        Most iterations, of one FFT pair each.

    Returns
    -------
    Whether the tolerance was reached, and the iterations.
    """
    n = at.p.size
    p, gap = at.p, at.gap
    before, gap_before, trial = p.copy(), gap.copy(), p.copy()
    momentum, energy = 0.0, np.inf
    for iteration in range(limit):
        _set(p, trial)
        forward(plans, p, at.spectrum)
        for k in range(work.size):
            work[k] = system.compliance[k] * at.spectrum[k]
        backward(plans, work, gap)
        now = 0.0
        for i in range(n):
            gap[i] += system.gap0[i]
            now += 0.5 * p[i] * (gap[i] + system.gap0[i] - 2.0 * shift)
        if system.load_given:
            _set_depth(p, gap, shift)
        if satisfies_kkt(system, p, gap, shift, tolerance):
            return True, iteration + 1
        if momentum > 0.0 and now > energy:
            # Take the extrapolated step back.
            _set(p, before)
            _set(gap, gap_before)
            momentum = 0.0
            beta = 0.0
        else:
            energy = now
            following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * momentum * momentum))
            beta = (momentum - 1.0) / following if momentum > 1.0 else 0.0
            momentum = following
        for i in range(n):
            old, old_gap = before[i], gap_before[i]
            before[i], gap_before[i] = p[i], gap[i]
            trial[i] = p[i] + beta * (p[i] - old) - length * (gap[i] + beta * (gap[i] - old_gap) - shift)
        _project(trial, mean, system.load_given)
    return False, limit


@nb.njit(nogil=True)
def _set(target: FloatArray, source: FloatArray) -> None:
    for i in range(target.size):
        target[i] = source[i]


@nb.njit(nogil=True)
def _set_depth(p: FloatArray, gap: FloatArray, shift: float) -> None:
    """The depth at which the gap, weighted with the pressure, is right."""
    total, weighted = 0.0, 0.0
    for i in range(p.size):
        total += p[i]
        weighted += p[i] * gap[i]
    for i in range(p.size):
        gap[i] += shift - weighted / total


@nb.njit(nogil=True)
def _project(p: FloatArray, mean: float, load: bool) -> None:
    """Onto p >= 0, and under a given load onto its mean: max(p - m, 0), m by Newton from the left."""
    shift = 0.0
    if load:
        shift = p.mean() - mean
        while True:
            total, count = 0.0, 0
            for i in range(p.size):
                if p[i] > shift:
                    total += p[i] - shift
                    count += 1
            excess = total - mean * p.size
            if count == 0 or excess <= 1e-15 * mean * p.size:
                break
            shift += excess / count
    for i in range(p.size):
        p[i] = max(p[i] - shift, 0.0)
