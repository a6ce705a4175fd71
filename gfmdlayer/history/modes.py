"""Integrators over the exact relaxation spectrum: a sum of relaxing modes, each integrated by itself.

With K(q, s) = K_0(q) + sum_j w_j(q) s theta_j/(1 + s theta_j) of `relaxation` each mode j is a spring w_j in
series with a dashpot w_j theta_j, all of them parallel to the spring K_0. Its internal variable is the
stretch y_j of its spring,

    d y_j/dt + y_j/theta_j = du/dt,        sigma = -(K_0 u + sum_j w_j y_j).

A step of length dt from u_0 to u_1 changes the stretch and dissipates heat by

    y_j <- decay_j y_j + gain_j (u_1 - u_0)
    heat = w_j [loss_j |y_j + lead_j (u_1 - u_0)|^2 + remainder_j |u_1 - u_0|^2]

with y_j before the step on the right, and factors that depend on x = dt/theta_j and on the scheme alone. At
the end of the step sigma = -kappa u_1 + b, with

    kappa = K_0 + sum_j w_j gain_j,        b = sum_j w_j (gain_j u_0 - decay_j y_j)

which are lines 5 and 6 of the pseudocode of Petrenko et al., Materials Physics and Mechanics 52 (2024) 60-68;
lines 8 and 9 are the change of the stretches. The schemes are

exponential
    u linear over the step, y_j and the heat w_j/theta_j int |y_j|^2 dt exact: of second order in dt, stable
    for any step, and for dt = 0 the glassy response.
backward Euler
    Of first order, heat w_j |y_j|^2 x. The substitution s -> (1 - 1/z)/dt commutes with partial fractions,
    so it is the paper's Eq. (24) with backward differences, to rounding and for any material.

The stored energy is half of K_0 |u|^2 + sum_j w_j |y_j|^2. Neither it nor the heat can be negative.

The exponential scheme neglects the curvature of u(t). Where c = dt^2 u''/2 is known after the step, the exact
stretch is larger by curvature_gain_j c, and with y_j' the stretch after the step without it the heat by

    w_j [curvature_loss_j |c|^2 - curvature_gain_j Re (y_j + y_j') c*]

The modes are of two kinds, which are stored differently:

branch modes
    The Maxwell branches of the layer itself (a G(s) of `relaxation`): one relaxation time at all q, and
    weights w_j(q) = G_j shape(q). A row of stretches for each, and one factor for the row.
local modes
    Relaxation times that depend on q, and weights that vanish where the layer is deep, qd >> 1, which is at
    most q. A list of the pairs (mode, q) with a weight.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from gfmdlayer.arrays import BoolArray, ComplexArray, FloatArray
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history import mode_kernels as kernels
from gfmdlayer.history.mode_kernels import BranchModes, Factors, LocalModes, StepTerms, exponential
from gfmdlayer.resumable import State

# Relative to the relaxed stiffness, the rounding up to which weights are products of a modulus and a shape.
_ROUNDING = 1e-14

# Part of the glassy stiffness from which on the first step has to resolve the relaxation time of a mode.
RELEVANT = 1e-3

_NO_CURVATURE = np.empty(0, dtype=np.complex128)

Scheme = Callable[[FloatArray], Factors]


def backward_euler(x: FloatArray) -> Factors:
    """Factors of the backward Euler step, x = dt/theta >= 0."""
    decay, one, zero = 1 / (1 + x), np.ones_like(x), np.zeros_like(x)
    return Factors(decay, decay, x * decay**2, one, zero, zero, zero)


SCHEMES: dict[str, Scheme] = {"backward_euler": backward_euler, "exponential": exponential}


class Modes:
    """The relaxing modes of a surface: their history, stiffness and energy; see `error_control.Integrator`.

    Parameters
    ----------
    spectrum : Spectrum
        Relaxing modes at the grid's wavevectors.
    scheme : callable
        `exponential` or `backward_euler`.
    sums : Sums, optional
        Sums over the grid; energies are means over its surface. By default every wave has weight one.
    """

    stiffness: FloatArray
    loss_stiffness: FloatArray | None = None
    slope: ComplexArray | None = None

    def __init__(self, spectrum: Spectrum, scheme: Scheme, sums: Sums | None = None) -> None:
        self.relaxed = np.ravel(spectrum.relaxed)
        size = self.relaxed.size
        self._sums = Sums(np.ones(size)) if sums is None else sums
        self.spectrum_error = self._sums.maximum(spectrum.error)
        self.shortest_time = shortest_time(spectrum, self._sums)
        weights, times = spectrum.weights.reshape(-1, size), spectrum.times.reshape(-1, size)
        missing = self._sums.maximum(len(weights)) - len(weights)  # modes without weight on this rank
        weights = np.concatenate((weights, np.zeros((missing, size)))) if missing else weights
        times = np.concatenate((times, np.ones((missing, size)))) if missing else times
        self._scheme = scheme
        self.step = np.nan
        self.u = np.zeros(size, dtype=np.complex128)
        self.stored = self.dissipated = 0.0
        self._springs = np.repeat(self.relaxed * self._sums.weights, 2)

        of_branch = _branch_modes(weights, times, self.relaxed, self._sums)
        total = self._sums.total(float(weights[of_branch].sum()))
        shape = weights[of_branch].sum(axis=0) / max(total, np.finfo(float).tiny)
        held = np.where(weights[of_branch] > 0, times[of_branch], 0.0)
        branch_times = self._sums.maximum(held.max(axis=1, initial=0.0))
        self._branches = BranchModes(
            moduli=self._sums.total(weights[of_branch].sum(axis=1)),
            shape=np.repeat(shape, 2),
            energy_shape=np.repeat(shape * self._sums.weights, 2),
            stretch=np.zeros((branch_times.size, 2 * size)),
        )
        local = np.where(of_branch[:, np.newaxis], 0.0, weights)
        index, local_weights = np.ascontiguousarray(np.nonzero(local)[1]), local[local > 0]
        energy_weights = local_weights * self._sums.weights[index]
        self._local = LocalModes(index, local_weights, energy_weights, np.zeros((index.size, 2)))
        self._times = np.concatenate((branch_times, times[local > 0]))

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b, each of shape (nq,), at the end of a step (lines 5 and 6)."""
        self.prepare(step)
        self._b = np.empty_like(self.u)
        kernels.intercepts(self._branches, self._local, self._terms, _numbers(self.u), _numbers(self._b))
        return self.stiffness, self._b

    def advance(self, spectrum: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Advance the history over the step of the last `terms` (lines 8 and 9)."""
        c = _NO_CURVATURE if curvature is None else curvature
        twice, heat = kernels.advance(
            self._branches,
            self._factors,
            self._local,
            self._local_factors,
            self._springs,
            *(_numbers(values) for values in (self.u, spectrum, c)),
        )
        self.stored = self._sums.total(twice) / 2
        self.dissipated += self._sums.total(heat)

    def state(self) -> State:
        """Return displacement, stretches and energies."""
        return {
            "u": self.u,
            "branch_stretch": self._branches.stretch,
            "local_stretch": self._local.stretch,
            "stored": self.stored,
            "dissipated": self.dissipated,
        }

    def restore(self, state: State) -> None:
        """Continue from a state."""
        self.u[:] = state["u"]
        self._branches.stretch[:] = state["branch_stretch"]
        self._local.stretch[:] = state["local_stretch"]
        self.stored, self.dissipated = float(state["stored"]), float(state["dissipated"])

    def force(self, spectrum: ComplexArray) -> ComplexArray:
        """Return -sigma at the end of the step of the last `terms` for this displacement."""
        return kernels.force(self.stiffness, _numbers(spectrum), _numbers(self._b)).view(np.complex128)

    def curvature_stress(self, curvature: ComplexArray) -> ComplexArray:
        """Part of the stress -sigma at the end of the step that is due to dt^2 u''/2."""
        gain = float(self._branches.moduli @ self._factors.curvature_gain)
        local_gains = self._local.weights * self._local_factors.curvature_gain
        shape, index = self._branches.shape, self._local.position
        stress = kernels.curvature_stress(gain, shape, index, local_gains, _numbers(curvature))
        return np.asarray(stress.view(np.complex128))

    def missing_stress(self, spectrum: ComplexArray, curvature: ComplexArray) -> ComplexArray:  # noqa: ARG002
        """Part of -sigma that `force` leaves out: for modes at rest only the curvature of u(t)."""
        return self.curvature_stress(curvature)

    def prepare(self, step: float) -> None:
        """Compute the stiffness and the factors for the length of a step."""
        if step == self.step:
            return
        self.step = step
        factors, count = self._scheme(step / self._times), self._branches.moduli.size
        self._factors = Factors(*(factor[:count] for factor in factors))
        self._local_factors = Factors(*(factor[count:] for factor in factors))
        gain = self._branches.shape[::2] * float(self._branches.moduli @ self._factors.gain)
        np.add.at(gain, self._local.position, self._local.weights * self._local_factors.gain)
        self.stiffness = self.relaxed + gain
        branch_decay = self._branches.moduli * self._factors.decay
        local_decay = self._local.weights * self._local_factors.decay
        self._terms = StepTerms(np.repeat(gain, 2), branch_decay, local_decay)


def shortest_time(spectrum: Spectrum, sums: Sums) -> float:
    """Return the shortest relevant relaxation time on all ranks; infinite for an elastic body."""
    relevant = spectrum.weights > RELEVANT * spectrum.glassy
    return sums.minimum(float(spectrum.times[relevant].min(initial=math.inf)))


def _branch_modes(weights: FloatArray, times: FloatArray, relaxed: FloatArray, sums: Sums) -> BoolArray:
    """Find the modes with one time at all q and weights proportional to those of the heaviest of them."""
    total = sums.total(weights.sum(axis=1))
    longest = sums.maximum(np.where(weights > 0, times, 0.0).max(axis=1, initial=0.0))
    differ = (weights > 0) & (times != longest[:, np.newaxis])
    found = (sums.total(differ.sum(axis=1)) == 0) & (total > 0)
    if found.any():
        heaviest = np.argmax(np.where(found, total, 0.0))
        shape = weights[heaviest] / total[heaviest]
        scale = _ROUNDING * (relaxed + weights.sum(axis=0))
        differ = np.abs(weights - total[:, np.newaxis] * shape) > scale
        found &= sums.total(differ.sum(axis=1)) == 0
    return np.asarray(found)


def _numbers(spectrum: ComplexArray) -> FloatArray:
    """Alternating real and imaginary parts, as the kernels take them."""
    return spectrum.view(np.float64)
