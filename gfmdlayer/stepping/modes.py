"""Integrators over the exact relaxation spectrum: the stress is a sum of relaxing modes.

Each stepped by itself.

With K(q, s) = K_0(q) + sum_j w_j(q) s theta_j/(1 + s theta_j) every mode j keeps a low-passed copy xi_j of
the displacement,

    theta_j d xi_j/dt + xi_j = u,        sigma = -(K_0 u + sum_j w_j (u - xi_j)),

a spring w_j in series with a dashpot w_j theta_j, beside the spring K_0.  One step of length dt from u_0 to
u_1 carries xi_j on by

    xi_j <- decay_j xi_j + old_j u_0 + new_j u_1,

whose factors depend on dt/theta_j and on the scheme alone:

exponential
    u linear over the step, xi_j integrated exactly: of second order in dt, stable for any step, exact for dt
    = 0 (the glassy response).
backward Euler
    Of first order.  The substitution s -> (1 - 1/z)/dt commutes with partial fractions, so it is the paper's
    Eq. (24) with backward differences (`third_order`), to rounding and for any material.

With x = dt/theta_j the factors are written so that small and large x keep their digits.
"""

from __future__ import annotations

from collections.abc import Callable

import numba as nb
import numpy as np
import numpy.typing as npt

from gfmdlayer.solid.relaxation import Spectrum

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
Factors = tuple[FloatArray, FloatArray, FloatArray]  # decay, old, new
Scheme = Callable[[FloatArray], Factors]

# Below this dt/theta the differences that make up the exponential factors cancel; their series is exact to
# rounding there.
_SMALL = 0.02


def backward_euler(x: FloatArray) -> Factors:
    """Factors of the backward Euler step, x = dt/theta."""
    return 1 / (1 + x), np.zeros_like(x), x / (1 + x)


def exponential(x: FloatArray) -> Factors:
    """Factors of the exponential step with u linear in time, x = dt/theta."""
    decay = np.exp(-x)
    safe = np.where(x < _SMALL, 1.0, x)
    mean_decay = -np.expm1(-safe) / safe
    series_old = x * (1 / 2 - x * (1 / 3 - x * (1 / 8 - x * (1 / 30 - x * (1 / 144 - x / 840)))))
    series_new = x * (1 / 2 - x * (1 / 6 - x * (1 / 24 - x * (1 / 120 - x * (1 / 720 - x / 5040)))))
    return (
        decay,
        np.where(x < _SMALL, series_old, mean_decay - decay),
        np.where(x < _SMALL, series_new, 1 - mean_decay),
    )


SCHEMES: dict[str, Scheme] = {"backward_euler": backward_euler, "exponential": exponential}


class Modes:
    """The relaxing modes of a surface and their history.

    Parameters
    ----------
    spectrum : Spectrum
        Of the wavenumbers of the grid's modes.
    scheme : callable
        `exponential` or `backward_euler`.
    """

    def __init__(self, spectrum: Spectrum, scheme: Scheme) -> None:
        modes = spectrum.weights.shape[0]
        self.relaxed = np.ravel(spectrum.relaxed)
        self.weights = spectrum.weights.reshape(modes, -1)
        # A mode without weight at some q has no time there; any will do.
        self.times = np.where(self.weights > 0, spectrum.times.reshape(modes, -1), 1.0)
        self._scheme = scheme
        self.step = np.nan
        self.u = np.zeros(self.relaxed.size, dtype=np.complex128)
        self.xi = np.zeros(self.weights.shape, dtype=np.complex128)

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b, sigma = -kappa u + b, at the end of a step of this length (lines 5 and 6)."""
        if step != self.step:
            self.step = step
            self._factors = self._scheme(step / self.times)
            self._stiffness = self.relaxed + np.einsum("jq,jq->q", self.weights, 1 - self._factors[2])
        b = np.empty_like(self.u)
        _intercepts(self.weights, self._factors[0], self._factors[1], self.xi, self.u, b)
        return self._stiffness, b

    def advance(self, spectrum: ComplexArray) -> None:
        """Carry the history on over the step of the last `terms` (lines 8 and 9)."""
        _advance(*self._factors, self.xi, self.u, spectrum)
        self.u[:] = spectrum


@nb.njit(nogil=True, cache=True)
def _intercepts(
    weights: FloatArray,
    decay: FloatArray,
    old: FloatArray,
    xi: ComplexArray,
    u: ComplexArray,
    b: ComplexArray,
) -> None:
    b[:] = 0.0
    for j in range(weights.shape[0]):
        for q in range(b.size):
            b[q] += weights[j, q] * (decay[j, q] * xi[j, q] + old[j, q] * u[q])


@nb.njit(nogil=True, cache=True)
def _advance(
    decay: FloatArray,
    old: FloatArray,
    new: FloatArray,
    xi: ComplexArray,
    u: ComplexArray,
    found: ComplexArray,
) -> None:
    for j in range(xi.shape[0]):
        for q in range(u.size):
            xi[j, q] = decay[j, q] * xi[j, q] + old[j, q] * u[q] + new[j, q] * found[q]
