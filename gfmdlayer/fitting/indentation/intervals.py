"""Confidence intervals: linear ones from the curvature of the sum of squares, and profiles of it.

Linear: with the derivatives J of the residuals and their variance s^2, the covariance of u is
s^2 (J^T J)^-1. A robust loss rho changes the factor to mean(psi^2)/mean(psi')^2, psi = r rho'(r^2) (Huber,
Robust Statistics, 1981, Sec. 7.6). Intervals of the parameters follow on their scales with Student's t.

Profile: a parameter is held where all others are fitted again, and the sum of squares grows by s^2 t^2 (Bates
& Watts, Nonlinear Regression Analysis, 1988, Sec. 6.1). It is held by a stiff further residual.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares
from scipy.special import stdtrit

from gfmdlayer.arrays import FloatArray
from gfmdlayer.fitting.indentation.problem import LeastSquares

Loss = str
LOSSES = ("linear", "soft_l1", "huber", "cauchy")
STIFF = 1e3  # of the further residual, over its standard error
ROUNDS = 5  # of the search for an end of a profile
CLOSE = 0.02  # of the growth of its root, at which it is found
FAR = 4.0  # linear half-widths beyond which no end is looked for


def loss_derivatives(residuals: FloatArray, loss: Loss) -> tuple[FloatArray, FloatArray]:
    """Return psi = r rho'(r^2) and its derivative to r, for the losses of `scipy.optimize.least_squares`."""
    z = residuals**2
    match loss:
        case "soft_l1":
            first, second = (1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5
        case "huber":
            outside = np.maximum(z, 1.0)
            first = outside**-0.5
            second = np.where(z > 1, -0.5 * outside**-1.5, 0.0)
        case "cauchy":
            first, second = 1 / (1 + z), -1 / (1 + z) ** 2
        case _:
            first, second = np.ones_like(z), np.zeros_like(z)
    return residuals * first, first + 2 * z * second


def variance(residuals: FloatArray, parameters: int, loss: Loss, known: bool) -> float:
    """Return the factor of (J^T J)^-1 in the covariance."""
    psi, slope = loss_derivatives(residuals, loss)
    found = float(np.sum(psi**2) / (residuals.size - parameters) / np.mean(slope) ** 2)
    return max(found, 1.0) if known else found


def covariance(jacobian: FloatArray, factor: float) -> FloatArray:
    """Return factor (J^T J)^-1; directions of which the data know nothing have a huge variance, not none."""
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = np.finfo(float).tiny ** 0.5
    _, singular, directions = np.linalg.svd(jacobian / scale, full_matrices=False)
    inverse = np.maximum(singular, 1e-12 * singular.max()) ** -2.0
    return np.asarray(factor * (directions.T * inverse) @ directions / np.outer(scale, scale))


def quantile(level: float, freedom: int) -> float:
    """Student's t for a two-sided interval."""
    return float(stdtrit(freedom, 0.5 + level / 2))


class Profile:
    """Ends of the profile intervals."""

    def __init__(
        self,
        problem: LeastSquares,
        best: FloatArray,
        spread: FloatArray,
        factor: float,
        refit: Callable[..., FloatArray],
    ) -> None:
        self._problem, self._best, self._spread, self._factor = problem, best, spread, factor
        self._refit = refit
        self._least = float(np.sum(problem.residuals(best) ** 2))

    def interval(self, i: int, t: float) -> tuple[float, float]:
        """Return both ends for parameter i on its scale; infinite where none is found."""
        low, high = self._end(i, t, -1.0), self._end(i, t, 1.0)
        return low, high

    def _end(self, i: int, t: float, side: float) -> float:
        found, slopes = self._problem.reported(self._best)
        error = float(np.sqrt(slopes[i] @ self._spread @ slopes[i]))
        direction = self._spread @ slopes[i] / error**2
        reach, u = t * error, self._best
        known = [(0.0, 0.0)]  # distances from the estimate, and the roots there
        for _ in range(ROUNDS):
            moved = side * (reach - known[-1][0])
            u = self._held(i, found[i] + side * reach, error, u + moved * direction)
            known.append((reach, self._root(u)))
            (near, low), (far, root) = known[-2:]
            if abs(root - t) < CLOSE * t:
                break
            pace = max((root - low) / (far - near), 0.1 * t / reach)
            reach = float(np.clip(far + (t - root) / pace, 0.3 * far, 2 * far))
            if reach > FAR * t * error:
                return side * np.inf
        return float(found[i] + side * reach)

    def _root(self, u: FloatArray) -> float:
        grown = float(np.sum(self._problem.residuals(u) ** 2)) - self._least
        return float(np.sqrt(max(grown, 0.0) / self._factor))

    def _held(self, i: int, value: float, error: float, start: FloatArray) -> FloatArray:
        """Fit the others with parameter i held."""
        stiffness = STIFF * self._factor**0.5 / error

        def residuals(u: FloatArray) -> FloatArray:
            return np.append(
                self._problem.residuals(u), stiffness * (self._problem.reported(u)[0][i] - value)
            )

        def jacobian(u: FloatArray) -> FloatArray:
            return np.vstack([self._problem.jacobian(u), stiffness * self._problem.reported(u)[1][i]])

        return self._refit(residuals, jacobian, start)


def minimised(
    residuals: Callable[[FloatArray], FloatArray],
    jacobian: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    loss: Loss = "linear",
    precision: float = 1e-7,
) -> FloatArray:
    """Return the u of the least loss within bounds."""
    room = 1e-9 * (bounds[1] - bounds[0])
    inside = np.clip(start, bounds[0] + room, bounds[1] - room)
    found = least_squares(
        residuals, inside, jac=jacobian, bounds=bounds, x_scale="jac", loss=loss,
        ftol=precision, xtol=precision, gtol=1e-12, max_nfev=60,
    )  # fmt: skip
    return np.asarray(found.x)
