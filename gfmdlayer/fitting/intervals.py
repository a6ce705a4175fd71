"""Confidence intervals of least squares whose residuals are correlated, by a mixture of spectra.

The noise of an instrument drifts and hums: neighbouring residuals are alike, and s^2 (J^T J)^-1 is too small.
The estimates stay those of least squares. In the cosine transform of a curve's residuals noise is nearly
independent, with the spectrum

    S_j = 1 + r/(1 + (j/c)^2)

of white noise, and of noise that is slower than the corner c. Of r and c the slowest cosines tell the
likelihood; the restricted one (Patterson & Thompson, Biometrika 58 (1971) 545), since the model takes slow
noise out of the residual. An interval averages over 43 spectra, so that its level holds whichever is true:

    se^2 = rho/nu diag(R^-1 X^T S X R^-T),   sum_S p(S) P(|t_nu| < h/se(S)) = level

for J = Q R, X the cosines of Q, and rho the residual's sum of squares over S.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.fft import dct
from scipy.special import stdtr

from gfmdlayer.arrays import FloatArray

_CORNERS, _GAINS = 2.0 ** np.array([-1, 1, 2, 3, 4, 5]), 10.0 ** np.arange(7)
_WHITE, _POWER = 0.3, -0.25  # prior of white noise; of the others the power of the gain
_SLOWEST = 64  # cosines that tell the spectrum
_HALVINGS = 50  # of the search for a half width
_SINGULAR = 1e-12  # of the largest singular value: directions that the data do not determine


class Mixture(NamedTuple):
    """Estimates under a mixture of spectra of the noise."""

    centers: FloatArray  # of generalised least squares less those of least squares, shape (directions,)
    half: FloatArray  # half widths around the estimates of least squares, or around the centers
    spread: FloatArray  # covariance of the parameters, shape (parameters, parameters)


def mixture(
    residuals: FloatArray,
    jacobian: FloatArray,
    blocks: Sequence[int],
    *,
    level: float,
    along: FloatArray | None = None,
    least: float = 0.0,
    generalised: bool = False,
) -> Mixture:
    """Return half widths of intervals for a linear least-squares problem with correlated noise.

    Parameters
    ----------
    residuals : ndarray, shape (rows,)
        Measured less predicted values, over the noise.
    jacobian : ndarray, shape (rows, parameters)
        Derivatives of the predicted values, over the noise.
    blocks : sequence of int
        Numbers of successive rows with a noise of their own: one for each curve. Rows after the last block
        are independent.
    level : float
        Probability that an interval contains the value.
    along : ndarray, shape (directions, parameters), optional
        Combinations of the parameters; by default the parameters.
    least : float
        Least variance of white noise: 1 where the noise is known.
    generalised : bool
        Whether the intervals are around the estimates of generalised least squares.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    Q, singular, directions = np.linalg.svd(jacobian / scale, full_matrices=False)
    singular = np.maximum(singular, _SINGULAR * (singular.max(initial=0.0) or 1.0))
    back = directions.T / singular / scale[:, np.newaxis]  # R^-1
    along = np.eye(back.shape[0]) if along is None else along
    ends = np.cumsum([0, *blocks])
    cosines = [_Cosines.of(residuals[i:j], Q[i:j]) for i, j in pairwise(ends)]
    rest, m = slice(ends[-1], None), Q.shape[1]
    z, X = residuals[rest], Q[rest]  # independent
    gram = X.T @ X + sum((each.gram for each in cosines), np.zeros((_SPECTRA, m, m)))
    slow = X.T @ X + sum((each.slow for each in cosines), np.zeros((_SPECTRA, m, m)))
    mixed = X.T @ z + sum((each.mixed for each in cosines), np.zeros((_SPECTRA, m)))
    square = z @ z + sum((each.square for each in cosines), np.zeros(_SPECTRA))
    size = z.size + sum(each.slowest for each in cosines)
    logarithm = sum((each.logarithm for each in cosines), np.zeros(_SPECTRA))

    freedom = max(size - m, 1)
    inverse = np.linalg.pinv(slow, hermitian=True)
    shift = np.einsum("gab,gb->ga", inverse, mixed)
    left = np.maximum(square - np.einsum("ga,ga->g", mixed, shift), 1e-300)
    determinant = np.linalg.slogdet(slow)[1]
    logs = -0.5 * (freedom * np.log(left) + logarithm + determinant)
    weight = _PRIOR * np.exp(logs - logs.max())
    weight /= weight.sum()
    variances = np.maximum(left / freedom, least)[:, np.newaxis, np.newaxis]
    covariance = variances * (back @ (inverse if generalised else gram) @ back.T)
    errors = np.sqrt(np.maximum(np.einsum("ia,gab,ib->gi", along, covariance, along), 1e-300))
    centers = shift @ (along @ back).T if generalised else np.zeros_like(errors)
    center = weight @ centers

    low, high = np.zeros(along.shape[0]), 60.0 * errors.max(axis=0)
    for _ in range(_HALVINGS):
        half = (low + high) / 2
        beyond = [stdtr(freedom, (center + side * half - centers) / errors) for side in (1, -1)]
        inside = weight @ (beyond[0] - beyond[1]) < level
        low, high = np.where(inside, half, low), np.where(inside, high, half)
    return Mixture(center, high, np.einsum("g,gab->ab", weight, covariance))


class _Cosines(NamedTuple):
    """Sums over the cosines of a block, for each spectrum."""

    gram: FloatArray  # X^T S X, over all cosines, shape (spectra, m, m)
    slow: FloatArray  # X^T S^-1 X, over the slowest
    mixed: FloatArray  # X^T S^-1 z
    square: FloatArray  # z^T S^-1 z
    logarithm: FloatArray  # sum of ln S
    slowest: int  # their number

    @classmethod
    def of(cls, residuals: FloatArray, Q: FloatArray) -> _Cosines:
        n, m = Q.shape
        count = min(_SLOWEST, n)
        z, X = dct(residuals, norm="ortho")[:count], dct(Q, norm="ortho", axis=0)
        j = 2 * n / np.pi * np.sin(np.pi * np.arange(n) / (2 * n))
        corner, gain = _GRID
        S = 1 + gain[:, np.newaxis] / (1 + (j / corner[:, np.newaxis]) ** 2)
        squares = (X[:, :, np.newaxis] * X[:, np.newaxis, :]).reshape(n, -1)
        slow = 1 / S[:, :count]
        return cls(
            (S @ squares).reshape(-1, m, m),
            (slow @ squares[:count]).reshape(-1, m, m),
            slow @ (X[:count] * z[:, np.newaxis]),
            slow @ z**2,
            np.log(S[:, :count]).sum(axis=1),
            count,
        )


def _grid() -> FloatArray:
    """Return corners and gains of the spectra; the first one is white."""
    corners, gains = (each.ravel() for each in np.meshgrid(_CORNERS, _GAINS, indexing="ij"))
    return np.stack((np.append(1.0, corners), np.append(0.0, gains)))


def _prior() -> FloatArray:
    prior = np.append(0.0, _GRID[1, 1:] ** _POWER)
    prior *= (1 - _WHITE) / prior.sum()
    prior[0] = _WHITE
    return prior


_GRID = _grid()
_SPECTRA = _GRID.shape[1]
_PRIOR = _prior()
