"""Two deformable bodies in contact without friction: their compliances add, 1/K = 1/K_1 + 1/K_2.

Both surfaces feel the same pressure, and u = u_1 + u_2 for displacements out of each body, so that two bodies
of shapes h_1 and h_2 touch like one body of the stiffness K under a rigid punch of shape h_1 + h_2. With

    K_i(s) = K0_i + sum_j w_ij s t_j/(1 + s t_j),       g_j = (w_1j + w_2j) t_j,       A = K0_1 + K0_2

the poles of K = K_1 K_2/(K_1 + K_2) are those of 1/(K_1 + K_2), at the retardation times of the two bodies in
parallel, sum_j g_j/(theta_k - t_j) = A. With 1/J_k = theta_k sum_j g_j/(theta_k - t_j)^2 and

    kappa_k = K_2(-1/theta_k) = -K_1(-1/theta_k),       K_i(-1/theta) = K0_i - sum_j w_ij t_j/(theta - t_j)

the modes of the pair are (J_k kappa_k^2, theta_k), and for each time t_j of both bodies one more, two springs
in series, (g_1j g_2j/(t_j (g_1j + g_2j)), t_j). All weights are positive by construction.

The compliances add at one s: both materials move alike relative to the contact, or one does not relax.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.relaxation import NEGLIGIBLE, Spectrum, retardation

# Relative: stiffnesses that differ by less between waves, but for one factor, are the same modes.
_ALIKE = 1e-13


def stiffness_in_series(one: ArrayLike, two: ArrayLike) -> NDArray[Any]:
    """Return K_1 K_2/(K_1 + K_2); a body with K = 0 holds its displacement."""
    a, b = np.broadcast_arrays(np.asarray(one), np.asarray(two))
    with np.errstate(divide="ignore", invalid="ignore"):
        both = np.where(np.abs(a) < np.abs(b), a * (b / (a + b)), b * (a / (a + b)))
    return np.where(a == 0, b, np.where(b == 0, a, both))


def in_series(one: Spectrum, two: Spectrum) -> Spectrum:
    """Return the modes of two bodies in series, given at the same waves."""
    shape = one.relaxed.shape
    relaxed = np.stack((one.relaxed.ravel(), two.relaxed.ravel()))
    times, strengths = _poles(one, two, relaxed[0].size)
    size, whole = len(times), relaxed.sum(axis=0)
    weights, thetas = np.zeros((4 * size, whole.size)), np.ones((4 * size, whole.size))
    alone = (relaxed == 0).any(axis=0)
    deep = int(np.argmax(np.where(alone, 0.0, whole)))
    alike = _alike(times, strengths, relaxed, deep) & ~alone
    # Rows of their own for the waves that share times: all of a pair of halfspaces, most of a thick layer.
    for rows, columns in ((slice(0, 2 * size), alike), (slice(2 * size, None), ~alike & ~alone)):
        chosen = np.flatnonzero(columns)
        if not chosen.size:
            continue
        solved = np.array([deep]) if columns is alike else chosen
        w, t = _modes(times[:, solved], strengths[:, :, solved], relaxed[:, solved])
        weights[rows, chosen], thetas[rows, chosen] = w * (whole[chosen] / whole[solved]), t
    held = np.flatnonzero(alone)  # the modes of the body that has a stiffness
    finite, own = np.isfinite(times[:, held]), slice(2 * size, 3 * size)
    weights[own, held] = np.where(finite, strengths[:, :, held].sum(axis=0) / times[:, held], 0.0)
    thetas[own, held] = np.where(finite, times[:, held], 1.0)
    K = stiffness_in_series(relaxed[0], relaxed[1])
    weights[weights * size <= NEGLIGIBLE * K] = 0.0
    kept = weights.any(axis=1)
    weights, thetas = (rows[kept].reshape(-1, *shape) for rows in (weights, thetas))
    return Spectrum(K.reshape(shape), weights, thetas, max(one.error, two.error))


def _poles(one: Spectrum, two: Spectrum, waves: int) -> tuple[FloatArray, FloatArray]:
    """Return the distinct times of both bodies, ascending, (n, nq), and w_ij t_ij at them, (2, n, nq)."""
    # Modes without weight have the time inf, and strength 0.
    every = [(each.weights.reshape(-1, waves), each.times.reshape(-1, waves)) for each in (one, two)]
    count = len(every[0][0])
    weights, times = (np.concatenate(each) for each in zip(*every, strict=True))
    times = np.where(weights > 0, times, np.inf)
    strengths = np.zeros((2, *times.shape))
    finite = np.where(weights > 0, times, 0.0) * weights
    strengths[0, :count], strengths[1, count:] = finite[:count], finite[count:]
    for _ in range(2):  # sorted, merged, and sorted again
        order = np.argsort(times, axis=0, kind="stable")
        times = np.take_along_axis(times, order, axis=0)
        strengths = np.take_along_axis(strengths, order[np.newaxis], axis=1)
        for k in range(len(times) - 1, 0, -1):
            same = (times[k] == times[k - 1]) & np.isfinite(times[k])
            strengths[:, k - 1] += np.where(same, strengths[:, k], 0.0)
            strengths[:, k], times[k] = np.where(same, 0.0, strengths[:, k]), np.where(same, np.inf, times[k])
    used = np.isfinite(times).any(axis=1)
    return times[used], strengths[:, used]


def _alike(times: FloatArray, strengths: FloatArray, relaxed: FloatArray, deep: int) -> NDArray[np.bool_]:
    """Return which waves have the modes of the wave `deep` but for a factor: those that feel no base."""
    whole = relaxed.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = np.concatenate((relaxed, strengths.reshape(-1, whole.size))) / whole
    own = parts[:, deep, np.newaxis]
    near = (np.abs(parts - own) <= _ALIKE * own).all(axis=0)
    return np.asarray(near & (times == times[:, deep, np.newaxis]).all(axis=0))


def _modes(times: FloatArray, strengths: FloatArray, relaxed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return weights and times of the modes of the pair: roots, then shared times, (2 n, nq)."""
    size, waves = times.shape
    weights, thetas = np.zeros((2 * size, waves)), np.ones((2 * size, waves))
    shared = np.nonzero((strengths > 0).all(axis=0))
    one, two, of_both = strengths[0][shared], strengths[1][shared], times[shared]
    weights[size:][shared], thetas[size:][shared] = one * (two / (one + two)) / of_both, of_both
    modes = retardation(strengths.sum(axis=0) / times, times, relaxed.sum(axis=0), 0.0)
    for k, (J, theta, origin, distance) in enumerate(zip(*modes, strict=True)):
        at = J > 0
        terms = strengths[:, :, at] / ((origin - times)[:, at] + distance[at])  # (2, times, waves)
        stiffness, size_of = relaxed[:, at] - terms.sum(axis=1), relaxed[:, at] + np.abs(terms).sum(axis=1)
        kappa = np.where(size_of[0] < size_of[1], -stiffness[0], stiffness[1])
        weights[k, at], thetas[k, at] = J[at] * kappa**2, theta[at]
    return weights, thetas
