"""Integrators over the exact relaxation spectrum: a sum of relaxing modes, each stepped by itself.

With K(q, s) = K_0(q) + sum_j w_j(q) s theta_j/(1 + s theta_j) each mode j is a spring w_j in series with a
dashpot w_j theta_j, all of them beside the spring K_0. Its state is the stretch y_j of its spring,

    d y_j/dt + y_j/theta_j = du/dt,        sigma = -(K_0 u + sum_j w_j y_j).

One step of length dt from u_0 to u_1 carries the stretch on, and turns work into heat, by

    y_j <- decay_j y_j + gain_j (u_1 - u_0)
    heat = w_j [loss_j |y_j + lead_j (u_1 - u_0)|^2 + rest_j |u_1 - u_0|^2]

with y_j as it was before the step, and factors that depend on x = dt/theta_j and on the scheme alone:

exponential
    u linear over the step, y_j and the heat w_j/theta_j int |y_j|^2 dt exact: of second order in dt, stable
    for any step, and for dt = 0 the glassy response.
backward Euler
    Of first order, heat w_j |y_j|^2 x. The substitution s -> (1 - 1/z)/dt commutes with partial fractions,
    so it is the paper's Eq. (24) with backward differences (`third_order`), to rounding and for any material.

The stored energy is half of K_0 |u|^2 + sum_j w_j |y_j|^2. Neither it nor the heat can be negative.

What the exponential scheme leaves out is the curvature of u(t). Where c = dt^2 u''/2 is known afterwards,
the exact history ends with bend_j c more, and the exact heat has w_j times

    bend_heat_j |c|^2 - bend_j Re (y_j + y_j') c*

more, where y_j and y_j' are the stretches before and after the step without it.

Most modes are of one of two kinds, and each kind is kept as suits it. The layer's own branches have the same
time at every q and weights that differ by a factor: one array of stretches, and numbers for the rest. The
others have their own time at each q, and weight at few of them: a list of the (mode, q) that have any.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.history import mode_kernels as modes_loop
from gfmdlayer.history.mode_kernels import Factors, exponential
from gfmdlayer.resumable import State

# Weights that are products of modulus and shape up to this part of the relaxed stiffness are taken for such.
_ROUNDING = 1e-14

_STRAIGHT = np.empty(0, dtype=np.complex128)  # no curvature

Scheme = Callable[[FloatArray], Factors]


def backward_euler(x: FloatArray) -> Factors:
    """Factors of the backward Euler step, x = dt/theta >= 0."""
    decay, one, zero = 1 / (1 + x), np.ones_like(x), np.zeros_like(x)
    return Factors(decay, decay, x * decay**2, one, zero, zero, zero)


SCHEMES: dict[str, Scheme] = {"backward_euler": backward_euler, "exponential": exponential}


class Modes:
    """The relaxing modes of a surface, their history and their energy.

    Parameters
    ----------
    spectrum : Spectrum
        Of the wavenumbers of the grid's modes.
    scheme : callable
        `exponential` or `backward_euler`.
    measure : ndarray, optional
        Weight of each wavenumber in the mean over the surface, <f g> = sum_q measure f conj(g), in the shape
        of the wavenumbers; energies are such means. By default one.

    Attributes
    ----------
    stored : float
        Elastic energy in all springs after the last step.
    dissipated : float
        Heat from all dashpots since the beginning.
    drag : ndarray, optional
        Imaginary part of the stiffness, which a punch at rest does not meet.
    """

    loss_stiffness: FloatArray | None = None

    def __init__(self, spectrum: Spectrum, scheme: Scheme, measure: FloatArray | None = None) -> None:
        self.relaxed = np.ravel(spectrum.relaxed)
        shape = (spectrum.weights.shape[0], self.relaxed.size)
        weights, times = spectrum.weights.reshape(shape), spectrum.times.reshape(shape)
        self._scheme = scheme
        self.step = np.nan
        self.u = np.zeros(self.relaxed.size, dtype=np.complex128)
        self.stored = self.dissipated = 0.0

        measure = np.ones(self.relaxed.size) if measure is None else np.ravel(measure)
        self._springs = np.repeat(self.relaxed * measure, 2)

        branches = _proportional(weights, times, self.relaxed)
        share = weights[branches].sum(axis=0) / max(weights[branches].sum(), np.finfo(float).tiny)
        self._moduli, self._times = weights[branches].sum(axis=1), times[branches].max(axis=1, initial=0.0)
        self._shape, self._shares = np.repeat(share, 2), np.repeat(share * measure, 2)
        self._stretches = np.zeros((self._times.size, 2 * self.relaxed.size))

        others = np.where(branches[:, np.newaxis], 0.0, weights)
        self._index = np.ascontiguousarray(np.nonzero(others)[1])
        self._own_weights, self._own_times = others[others > 0], times[others > 0]
        self._own_shares = self._own_weights * measure[self._index]
        self._own_stretches = np.zeros((self._index.size, 2))

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b, sigma = -kappa u + b, at the end of a step of this length (lines 5 and 6)."""
        self.prepare(step)
        b = np.empty_like(self.u)
        modes_loop.intercepts(
            self._pulls,
            self._shape,
            self._stretches,
            self._index,
            self._own_pulls,
            self._own_stretches,
            self._pull,
            self.u.view(np.float64),
            b.view(np.float64),
        )
        return self._stiffness, b

    def advance(self, spectrum: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Carry the history on over the step of the last `terms` (lines 8 and 9).

        Parameters
        ----------
        spectrum : ndarray
            The displacement at the end of the step.
        curvature : ndarray, optional
            dt^2 u''/2 over the step, where it is known; else u is linear.
        """
        curved = _STRAIGHT if curvature is None else curvature
        twice, heat = modes_loop.advance(
            self._moduli,
            self._factors,
            self._shares,
            self._stretches,
            self._index,
            self._own_shares,
            self._own_factors,
            self._own_stretches,
            self._springs,
            self.u.view(np.float64),
            spectrum.view(np.float64),
            curved.view(np.float64),
        )
        self.stored = twice / 2
        self.dissipated += heat

    def state(self) -> State:
        """Return displacement, stretches and energies."""
        return {
            "u": self.u,
            "stretches": self._stretches,
            "own_stretches": self._own_stretches,
            "stored": self.stored,
            "dissipated": self.dissipated,
        }

    def restore(self, state: State) -> None:
        """Go on from there."""
        self.u[:] = state["u"]
        self._stretches[:] = state["stretches"]
        self._own_stretches[:] = state["own_stretches"]
        self.stored, self.dissipated = float(state["stored"]), float(state["dissipated"])

    def missing(self, curvature: ComplexArray) -> ComplexArray:
        """What the stress -sigma lacks at the end of the step if dt^2 u''/2 of it was not zero but this."""
        bend, own = float(self._moduli @ self._factors.bend), self._own_weights * self._own_factors.bend
        bent = modes_loop.missing(bend, self._shape, self._index, own, curvature.view(np.float64))
        return np.asarray(bent.view(np.complex128))

    def prepare(self, step: float) -> None:
        """Make what depends on the length of the step."""
        if step == self.step:
            return
        self.step = step
        factors = self._scheme(step / np.concatenate((self._times, self._own_times)))
        self._factors = Factors(*(factor[: self._times.size] for factor in factors))
        self._own_factors = Factors(*(factor[self._times.size :] for factor in factors))
        self._pulls = self._moduli * self._factors.decay
        self._own_pulls = self._own_weights * self._own_factors.decay
        gain, own_gains = self._moduli @ self._factors.gain, self._own_weights * self._own_factors.gain
        self._pull, self._stiffness = modes_loop.slopes(
            float(gain), self._shape, self._index, own_gains, self.relaxed
        )


def _proportional(weights: FloatArray, times: FloatArray, relaxed: FloatArray) -> npt.NDArray[np.bool_]:
    """Find the modes with one time at all q whose weights are multiples of those of the heaviest of them."""
    total = weights.sum(axis=1)
    longest = np.where(weights > 0, times, 0.0).max(axis=1, initial=0.0)
    found = np.where(weights > 0, times == longest[:, np.newaxis], True).all(axis=1) & (total > 0)
    if found.any():
        heaviest = np.argmax(np.where(found, total, 0.0))
        shape = weights[heaviest] / total[heaviest]
        scale = _ROUNDING * (relaxed + weights.sum(axis=0))
        found &= (np.abs(weights - total[:, np.newaxis] * shape) <= scale).all(axis=1)
    return np.asarray(found)
