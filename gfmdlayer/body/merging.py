"""Fewer relaxing modes, with a bound on the error of K that holds for all s: balanced truncation.

With c_j = sqrt(w_j theta_j) the relaxing part of the stiffness is K - K_0 = s c.(1 + s theta)^-1 c, a
symmetric system in 1/s. Its Gramian P_ij = c_i c_j/(theta_i + theta_j) has eigenvalues sigma_1 >= sigma_2
>= ... that fall exponentially, the faster the more the times crowd. In the space U of the first r
eigenvectors the system U^T theta U, U^T c is again symmetric and positive, so that its r modes have w >= 0,
theta > 0; K_0 is unchanged; and (Glover, Int. J. Control 39 (1984) 1115-1193; Enns's bound)

    |K(s) - K_r(s)| <= 2 (sigma_(r+1) + ... + sigma_n)            for all s of Re s >= 0.

The bound is reached at s = inf (Liu and Anderson, Int. J. Control 50 (1989) 1379-1405).
"""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.network import singular_values


def merged(weights: FloatArray, times: FloatArray, bound: float) -> tuple[FloatArray, FloatArray, float]:
    """Return fewer modes of the same relaxed stiffness.

    Parameters
    ----------
    weights, times : ndarray, shape (modes,)
        w_j > 0 and theta_j > 0.
    bound : float
        Largest change of K at any s of Re s >= 0.

    Returns
    -------
    ndarray, ndarray, float
        Weights and times of the modes that stay, and the bound on the change that they reach.
    """
    strengths = np.sqrt(weights * times)
    gramian = np.multiply.outer(strengths, strengths) / np.add.outer(times, times)
    values, vectors = np.linalg.eigh(gramian)  # ascending
    changes = 2 * np.cumsum(np.maximum(values, 0.0))
    left = int(np.searchsorted(changes, bound, side="right"))
    reached = float(changes[left - 1]) if left else 0.0
    if left in (0, weights.size):
        return (weights, times, 0.0) if left == 0 else (weights[:0], times[:0], reached)
    basis = vectors[:, left:]
    roots, directions = singular_values(np.sqrt(times)[:, np.newaxis] * basis)
    return ((strengths @ basis) @ directions) ** 2 / roots**2, roots**2, reached
