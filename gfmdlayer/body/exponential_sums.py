"""The Prony series of few branches that responds like a continuous law, with a bound on its error.

    P(t) = P0 + sum_k G_k exp(-t/tau_k),    P0 > 0, G_k > 0,    shortest <= t <= longest

A completely monotone function has one best sum of n exponentials, and its coefficients are positive (Braess,
Nonlinear Approximation Theory (1986), ch. VII). Here the largest of the relative errors of G(t) and of
G(omega), over the reciprocal frequencies, is reduced: by least squares over moduli and times together, with
weights that grow where the error is large (Lawson's iteration) and moduli that follow the times by
non-negative least squares. Branches are added until the error keeps to the tolerance, and taken away while
it does.

The bound. Between samples at a distance h in ln t an error e exceeds that at the samples by at most
h^2/8 max |e''|. With y = t/tau, |d^2 exp(-y)/d(ln y)^2| = |y (y - 1)| exp(-y) <= 1.67 exp(-y/2), so that for
every law with a positive spectrum |G''| <= 1.67 [G(t/2) - G(inf)]; and |d^2/d(ln y)^2 (iy/(1 + iy))| =
y/(1 + y^2), so that in frequency it is at most the loss modulus. Nothing else is assumed of law or series.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import nnls

from gfmdlayer.arrays import BoolArray, ComplexArray, FloatArray
from gfmdlayer.body.materials import Prony, PronySeries

if TYPE_CHECKING:
    from gfmdlayer.body.materials import Law

AIM = 0.93  # part of the tolerance at the samples of the fit, which leaves room for the error between them
REMAINDER = 0.02  # part of the tolerance that may lie between the samples of the bound
CURVATURE = 1.67  # of an exponential, see above
FLOOR = 0.1  # part of the tolerance that the relaxed modulus of a series has at least
NARROWEST = 10.0  # range of times
MOST_BRANCHES = 100
FEWER = 4  # attempts with one branch less
# Measured over all laws, exponents from 0.2 to 0.97 and 3 to 12 decades. The branches are those for each unit
# of the range in ln t and of the logarithm of 10/tolerance times d ln G/d ln t.
PER_DECADE, BRANCHES = 12, 0.095  # samples of the fit
MORE = math.log(1.5)  # logarithm of the factor by which a branch reduces the error
ITERATIONS, UNWEIGHTED = 100, 8
LONGEST_STEP = 1.0  # of ln tau
_CHUNK = 1024  # samples of the bound at once


@lru_cache(maxsize=256)
def prony_series(law: Law, shortest: float, longest: float, tolerance: float) -> PronySeries:
    """Return the series of few branches that keeps to a tolerance, relative, of G(t) and G(omega)."""
    # The range of t and 1/omega is widened to `NARROWEST`; a modulus that is finite at t = 0 is kept to there
    # too. The law's spectrum must not be negative. Raises ValueError if the range is empty, ArithmeticError
    # if `MOST_BRANCHES` do not suffice.
    if not 0 < shortest <= longest < math.inf:
        raise ValueError(f"times from {shortest!r} to {longest!r}: must be positive and increase")
    longest = max(longest, NARROWEST * shortest)
    fit = _ExponentialSum(law, shortest, longest, tolerance)
    count = fit.expected
    while True:
        found, error = fit.of(min(count, MOST_BRANCHES))
        if found is not None:
            break
        if count >= MOST_BRANCHES:
            raise ArithmeticError(
                f"{law.model}: {MOST_BRANCHES} branches are not enough for an error of {tolerance:g} from "
                f"t = {shortest:g} to {longest:g}"
            )
        count += max(1, round(math.log(error / (AIM * tolerance)) / MORE))
    for _ in range(FEWER):
        spare = math.floor(math.log(tolerance / max(error, 1e-3 * tolerance)) / MORE)
        count = len(found.material.maxwell_branches) - max(1, spare)
        fewer, error = fit.of(count) if count > 0 else (None, error)
        if fewer is None:
            break
        found = fewer
    return found


class _ExponentialSum:
    """Sums of exponentials with a small largest error at samples of a range of times."""

    def __init__(self, law: Law, shortest: float, longest: float, tolerance: float) -> None:
        # The rows are the errors of G(t), G'(omega) and G''(omega) relative to |G|. The branches are measured
        # by the law's modulus at their relaxation times.
        self._law, self._tolerance, self._range = law, tolerance, (shortest, longest)
        self._samples = np.geomspace(*self._range, math.ceil(PER_DECADE * math.log10(longest / shortest)) + 2)
        self._times = np.append(0.0, self._samples) if math.isfinite(law.glassy) else self._samples
        self._modulus = law.relaxation_modulus(self._times)
        self._complex = law.complex_modulus(1 / self._samples)
        self._last = float(self._modulus[-1])
        self._floor = max(law.relaxed, FLOOR * tolerance * self._last)
        one = np.ones((self._samples.size, 1))
        self._spring = self._rows(np.ones((self._times.size, 1)), one)
        wanted = self._rows(self._modulus[:, np.newaxis], self._complex[:, np.newaxis])
        self._wanted = (wanted - self._floor * self._spring)[:, 0]

        # The density of branches, and its integral from the shortest time.
        logarithms = np.log(self._samples)
        slope = -np.gradient(np.log(self._modulus[-logarithms.size :]), logarithms)
        density = np.log(np.maximum(10 * slope / tolerance, 1.1))
        parts = (density[1:] + density[:-1]) / 2 * np.diff(logarithms)
        self._density = logarithms, np.append(0.0, np.cumsum(parts))

    @property
    def expected(self) -> int:
        """Number of branches to begin with."""
        return max(1, round(BRANCHES * float(self._density[1][-1])))

    def of(self, count: int) -> tuple[PronySeries | None, float]:
        """Return the series of at most this many branches, if it keeps to the tolerance, and its error."""
        logarithms, weights, damping = self._spread(count), np.ones(self._wanted.size), 1e-2
        columns, slopes = self._columns(logarithms)
        moduli = self._moduli(columns, weights)
        for iteration in range(ITERATIONS):
            residual = columns @ moduli - self._wanted
            size = self._magnitudes(residual)
            error = float(size.max())
            if error <= AIM * self._tolerance:
                series = self._bounded(self._series(logarithms, moduli))
                within = max(series.error_in_time, series.error_in_frequency) <= self._tolerance
                return (series if within else None), error
            if iteration >= UNWEIGHTED:
                weights = weights * (size / error + 1e-3) ** 0.35
                weights /= weights.max()
            step = _step(columns, slopes * moduli[1:], moduli > 0, weights, residual, damping)
            moved = logarithms + step
            new_columns, new_slopes = self._columns(moved)
            new_moduli = self._moduli(new_columns, weights)
            new_residual = new_columns @ new_moduli - self._wanted
            if np.linalg.norm(weights * new_residual) < np.linalg.norm(weights * residual):
                logarithms, columns, slopes, moduli = moved, new_columns, new_slopes, new_moduli
                damping = max(damping / 4, 1e-8)
            else:
                damping = min(damping * 5, 1e2)
        return None, error

    def _spread(self, count: int) -> FloatArray:
        """Logarithms of relaxation times to begin with, closer where the law relaxes more."""
        logarithms, integral = self._density
        parts = np.linspace(0, 1, count) if count > 2 else (np.arange(count) + 0.5) / count
        return np.asarray(np.interp(parts * integral[-1], integral, logarithms))

    def _columns(self, logarithms: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Responses of the relaxed spring and the branches, and the derivatives of these by ln tau."""
        tau = np.exp(logarithms)
        y, z = np.divide.outer(self._times, tau), 1j / np.divide.outer(self._samples, tau)
        scales, decay = self._scales(logarithms), np.exp(-y)
        responses = scales * self._rows(decay, z / (1 + z))
        slopes = scales * self._rows(y * decay, z / (1 + z) ** 2)
        return np.hstack([self._last * self._spring, responses]), slopes

    def _moduli(self, columns: FloatArray, weights: FloatArray) -> FloatArray:
        """Moduli >= 0 of the least weighted squares, the relaxed one first."""
        basis, triangle = np.linalg.qr(columns * weights[:, np.newaxis])
        return np.asarray(nnls(triangle, basis.T @ (weights * self._wanted), maxiter=1000)[0])

    def _scales(self, logarithms: FloatArray) -> FloatArray:
        modulus = self._modulus[-self._samples.size :]
        return np.asarray(np.exp(np.interp(logarithms, np.log(self._samples), np.log(modulus))))

    def _rows(self, in_time: FloatArray, in_frequency: FloatArray | ComplexArray) -> FloatArray:
        relative = in_frequency / np.abs(self._complex)[:, np.newaxis]
        return np.concatenate([in_time / self._modulus[:, np.newaxis], relative.real, relative.imag])

    def _magnitudes(self, residual: FloatArray) -> FloatArray:
        """Sizes of the errors, those in frequency as complex numbers."""
        real, imaginary = np.split(residual[self._times.size :], 2)
        size = np.hypot(real, imaginary)
        return np.concatenate([np.abs(residual[: self._times.size]), size, size])

    def _series(self, logarithms: FloatArray, moduli: FloatArray) -> Prony:
        order = np.argsort(logarithms)
        order = order[moduli[1:][order] > 0]
        branches = zip(
            (moduli[1:] * self._scales(logarithms))[order].tolist(),
            np.exp(logarithms[order]).tolist(),
            strict=True,
        )
        return Prony(self._floor + float(moduli[0]) * self._last, tuple(branches))

    def _bounded(self, series: Prony) -> PronySeries:
        """Return a series with bounds on its errors over the whole range, see the head of the module."""
        law, (shortest, longest) = self._law, self._range
        ratios = law.relaxation_modulus(self._samples / 2) / self._modulus[-self._samples.size :]
        steepest = float(ratios.max())
        spacing = math.sqrt(8 * REMAINDER * self._tolerance / (2 * CURVATURE * steepest))
        samples = np.geomspace(shortest, longest, math.ceil(math.log(longest / shortest) / spacing) + 1)
        square = (math.log(longest / shortest) / (samples.size - 1)) ** 2 / 8
        in_time = abs(series.glassy / law.glassy - 1) if math.isfinite(law.glassy) else 0.0
        in_frequency = 0.0
        for start in range(0, samples.size, _CHUNK):
            t = samples[start : start + _CHUNK]
            G, P = law.relaxation_modulus(t), series.relaxation_modulus(t)
            early = law.relaxation_modulus(t / 2) + series.relaxation_modulus(t / 2)
            early -= law.relaxed + series.relaxed
            in_time = max(in_time, float(((np.abs(P - G) + square * CURVATURE * early) / G).max()))
            wanted, found = law.complex_modulus(1 / t), series.complex_modulus(1 / t)
            loss = square * (found.imag + wanted.imag)
            in_frequency = max(in_frequency, float(((np.abs(found - wanted) + loss) / np.abs(wanted)).max()))
        return PronySeries(series, shortest, longest, in_time, in_frequency)


def _step(
    columns: FloatArray,
    slopes: FloatArray,
    used: BoolArray,
    weights: FloatArray,
    residual: FloatArray,
    damping: float,
) -> FloatArray:
    """Change of the times, shape (n,), by a damped step of Gauss and Newton over used moduli and times."""
    # `columns` (rows, n + 1) and `slopes` (rows, n) are derivatives by the moduli and the times, `residual`
    # (rows,) the errors; `damping` of the times is relative to the length of their derivatives.
    moving = used[1:]
    matrix = np.hstack([columns[:, used], slopes[:, moving]]) * weights[:, np.newaxis]
    lengths = np.linalg.norm(matrix, axis=0)
    penalty = math.sqrt(damping) * np.eye(lengths.size)[np.count_nonzero(used) :]
    target = np.append(-weights * residual, np.zeros(len(penalty)))
    change = np.linalg.lstsq(np.vstack([matrix / lengths, penalty]), target, rcond=1e-13)[0] / lengths
    step = np.zeros(moving.size)
    step[moving] = change[np.count_nonzero(used) :].clip(-LONGEST_STEP, LONGEST_STEP)
    return step
