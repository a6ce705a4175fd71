"""Integrators over the exact relaxation spectrum: a sum of relaxing modes, each integrated by itself.

With K(q, s) = K_0(q) + sum_j w_j(q) s theta_j/(1 + s theta_j) of `relaxation` each mode j is a spring w_j in
series with a dashpot w_j theta_j, all of them parallel to the spring K_0. Its internal variable is the
stretch y_j of its spring,

    d y_j/dt + y_j/theta_j = du/dt,        sigma = -(K_0 u + sum_j w_j y_j).

A step of length dt from u_0 to u_1 changes the stretch and dissipates heat by

    y_j <- decay_j y_j + gain_j (u_1 - u_0)
    heat = w_j [loss_j |y_j + lead_j (u_1 - u_0)|^2 + remainder_j |u_1 - u_0|^2]

with y_j before the step on the right, and factors that depend only on x = dt/theta_j and on the scheme. At
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
from typing import ClassVar, NamedTuple

import numpy as np

from gfmdlayer.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.grid.sums import Sums
from gfmdlayer.kernels import filled, kernel
from gfmdlayer.resumable import Saving

# In the compiled loops spectra are real arrays of twice the length, alternating real and imaginary parts, and
# their factors are repeated for both, as vector units need it. The loops take the wavenumbers in blocks, and
# in a block the modes. They act on the wavenumbers of this process and return partial sums (`grid.sums`).

# Numbers of a block: the sums of a block stay in the innermost cache while the modes stream by.
_BLOCK = 2048

_SMALL = 0.1  # dt/theta below which differences of closed forms lose digits


class BranchModes(NamedTuple):
    """Modes with one relaxation time at all q, and weights w_j(q) = moduli_j shape(q)."""

    moduli: FloatArray  # (modes,)
    shape: FloatArray  # (2 nq,)
    energy_shape: FloatArray  # (2 nq,), the shape times Parseval's weights
    stretch: FloatArray  # (modes, 2 nq), the internal variables y_j


class LocalModes(NamedTuple):
    """Pairs of a mode and a wavenumber, each with its own relaxation time and weight."""

    position: IntArray  # (pairs,), of the wavenumber
    weights: FloatArray  # (pairs,)
    energy_weights: FloatArray  # (pairs,), the weights times Parseval's
    stretch: FloatArray  # (pairs, 2)


class StepTerms(NamedTuple):
    """Products of weights and factors for the length of a step."""

    gain: FloatArray  # (2 nq,), sum_j w_j gain_j
    branch_decay: FloatArray  # (modes,), moduli_j decay_j
    local_decay: FloatArray  # (pairs,), w_j decay_j


class Factors(NamedTuple):
    """Factors of a step of the modes, each an array over x = dt/theta."""

    decay: FloatArray
    gain: FloatArray
    loss: FloatArray
    lead: FloatArray
    remainder: FloatArray
    curvature_gain: FloatArray
    curvature_loss: FloatArray


class ModeArrays(NamedTuple):
    """The modes of a body with their state, and what belongs to the length of a step."""

    branches: BranchModes
    local: LocalModes
    times: FloatArray  # relaxation times, of the branch modes and of the local ones
    relaxed: FloatArray  # (nq,), K_0
    springs: FloatArray  # (2 nq,), K_0 times Parseval's weights
    u: FloatArray  # (2 nq,), the displacement after the last step
    factors: FloatArray  # (7, modes), in the order of `Factors`
    terms: StepTerms
    stiffness: FloatArray  # (nq,), kappa
    implicit: bool  # whether the scheme is backward Euler


@kernel(borrows=True)
def set_exponential(x: FloatArray, f: FloatArray) -> None:
    """Write factors of the exponential step, u linear in time, for x = dt/theta >= 0, see `Factors`."""
    for i in range(x.size):
        some = x[i]
        decay, gain, lead = math.exp(-some), 1.0, 0.5
        if some > 0.0:
            gain, lead = -math.expm1(-some) / some, math.tanh(some / 2) / some
        # By series where two of the closed forms lose more to rounding than the series to truncation.
        if some < _SMALL:
            square = some * some
            remainder = some * (1 / 12 + square * (-1 / 120 + square * (17 / 20160 - square * 31 / 362880)))
            curvature_gain = (1 + decay) * remainder
            higher = 11 / 630 + some * (-1 / 120 + some * (283 / 90720 - some * 289 / 302400))
            curvature_loss = some * (1 / 30 + some * (-1 / 36 + some * higher))
        else:
            remainder = (some - 2 * math.tanh(some / 2)) / some**2
            curvature_gain = (1 + decay) * remainder
            curvature_loss = 1 / (3 * some) - curvature_gain * ((some + 2) / some**2 + curvature_gain / 2)
        f[0, i], f[1, i], f[2, i], f[3, i] = decay, gain, -math.expm1(-2 * some) / 2, lead
        f[4, i], f[5, i], f[6, i] = remainder, curvature_gain, curvature_loss


@kernel(borrows=True)
def set_backward_euler(x: FloatArray, f: FloatArray) -> None:
    """Write factors of the backward Euler step, for x = dt/theta >= 0, see `Factors`."""
    for i in range(x.size):
        some = x[i]
        decay = 1.0 / (1.0 + some)
        f[0, i], f[1, i], f[2, i], f[3, i] = decay, decay, some * (decay * decay), 1.0
        f[4, i] = f[5, i] = f[6, i] = 0.0


@kernel(borrows=True)
def prepare(modes: ModeArrays, step: float) -> None:
    """Write factors, terms and stiffness for the length of a step."""
    branches, local, terms, factors = modes.branches, modes.local, modes.terms, modes.factors
    count = branches.moduli.size
    x = factors[6]  # of each mode it is read before it is written
    for i in range(x.size):
        x[i] = step / modes.times[i]
    if modes.implicit:
        set_backward_euler(x, factors)
    else:
        set_exponential(x, factors)
    total = weighted(branches.moduli, factors[1])
    for j in range(count):
        terms.branch_decay[j] = branches.moduli[j] * factors[0, j]
    for k in range(modes.relaxed.size):
        terms.gain[2 * k] = branches.shape[2 * k] * total
    for i in range(local.position.size):
        terms.gain[2 * local.position[i]] += local.weights[i] * factors[1, count + i]
        terms.local_decay[i] = local.weights[i] * factors[0, count + i]
    for k in range(modes.relaxed.size):
        terms.gain[2 * k + 1] = terms.gain[2 * k]
        modes.stiffness[k] = modes.relaxed[k] + terms.gain[2 * k]


@kernel(borrows=True)
def weighted(moduli: FloatArray, factors: FloatArray) -> float:
    """Sum of moduli times factors over the branch modes, in their order on any processor."""
    total = 0.0
    for j in range(moduli.size):
        total += moduli[j] * factors[j]
    return total


@kernel(inner=True, borrows=True)
def rows(f: FloatArray, first: int, end: int) -> Factors:
    """Factors of some modes."""
    return Factors(
        f[0][first:end], f[1][first:end], f[2][first:end], f[3][first:end], f[4][first:end],
        f[5][first:end], f[6][first:end],
    )  # fmt: skip


@kernel(reorder=True, borrows=True)
def intercepts(modes: ModeArrays, b: FloatArray) -> None:
    """Set b to sum_j w_j (gain_j u - decay_j y_j)."""
    branches, local, terms, u = modes.branches, modes.local, modes.terms, modes.u
    for start in range(0, b.size, _BLOCK):
        part = slice(start, min(start + _BLOCK, b.size))
        total = b[part]
        total[:] = 0.0
        for j in range(terms.branch_decay.size):
            decay, y = terms.branch_decay[j], branches.stretch[j, part]
            for i in range(y.size):
                total[i] -= decay * y[i]
        gain, shape, u_ = terms.gain[part], branches.shape[part], u[part]
        for i in range(total.size):
            total[i] = gain[i] * u_[i] + shape[i] * total[i]
    for i in range(local.position.size):
        for part_ in range(2):
            b[2 * local.position[i] + part_] -= terms.local_decay[i] * local.stretch[i, part_]


@kernel(reorder=True, borrows=True)
def advance(modes: ModeArrays, new_u: FloatArray, curvature: FloatArray) -> tuple[float, float]:
    """Advance stretches and displacement by a step; return twice the stored energy, and the heat."""
    # The array `curvature` is empty where u is linear.
    branches, local, springs, u = modes.branches, modes.local, modes.springs, modes.u
    index, stretch, weights = local.position, local.stretch, local.energy_weights
    moduli, count = branches.moduli, branches.moduli.size
    factors, f = rows(modes.factors, 0, count), rows(modes.factors, count, modes.times.size)
    twice, heat, remainder, curvature_loss = 0.0, 0.0, 0.0, 0.0
    for i in range(index.size):
        for part in range(2):
            k = 2 * index[i] + part
            before, moved, c = (
                stretch[i, part],
                new_u[k] - u[k],
                curvature[k] if curvature.size else 0.0,
            )
            after, ahead = f.decay[i] * before + f.gain[i] * moved, before + f.lead[i] * moved
            corrected = after + f.curvature_gain[i] * c
            stretch[i, part] = corrected
            twice += weights[i] * corrected * corrected
            heat += weights[i] * (f.loss[i] * ahead * ahead + f.remainder[i] * moved * moved)
            heat += weights[i] * c * (f.curvature_loss[i] * c - f.curvature_gain[i] * (before + after))
    for j in range(moduli.size):
        remainder += moduli[j] * factors.remainder[j]
        curvature_loss += moduli[j] * factors.curvature_loss[j]
    change, curved = filled(_BLOCK, 0.0), filled(_BLOCK, 0.0)
    for start in range(0, u.size, _BLOCK):
        part_ = slice(start, min(start + _BLOCK, u.size))
        spring, shape, new, old = springs[part_], branches.energy_shape[part_], new_u[part_], u[part_]
        for i in range(min(curvature.size, new.size)):  # to assign the slice takes seconds to compile
            curved[i] = curvature[start + i]
        of_u, of_change, of_c = 0.0, 0.0, 0.0
        # In small loops, which the compiler can give to the vector units.
        for i in range(new.size):
            change[i] = new[i] - old[i]
        for i in range(new.size):
            of_u += spring[i] * new[i] * new[i]
            old[i] = new[i]
        for i in range(new.size):
            of_change += shape[i] * change[i] * change[i]
            of_c += shape[i] * curved[i] * curved[i]
        twice += of_u
        heat += remainder * of_change + curvature_loss * of_c
        for j in range(moduli.size):
            y, decay, gain, lead = (
                branches.stretch[j, part_],
                factors.decay[j],
                factors.gain[j],
                factors.lead[j],
            )
            correction, of_y, of_ahead, of_correction = factors.curvature_gain[j], 0.0, 0.0, 0.0
            for i in range(y.size):
                before, moved, c = y[i], change[i], curved[i]
                after, ahead = decay * before + gain * moved, before + lead * moved
                corrected = after + correction * c
                y[i] = corrected
                of_y += shape[i] * corrected * corrected
                of_ahead += shape[i] * ahead * ahead
                of_correction += shape[i] * c * (before + after)
            twice += moduli[j] * of_y
            heat += moduli[j] * (factors.loss[j] * of_ahead - correction * of_correction)
    return twice, heat


@kernel(reorder=True, borrows=True)
def set_curvature_stress(modes: ModeArrays, gain: float, curvature: FloatArray, stress: FloatArray) -> None:
    """Write sum_j w_j curvature_gain_j c; `gain` is summed over the branch modes."""
    shape, index, count = modes.branches.shape, modes.local.position, modes.branches.moduli.size
    for i in range(stress.size):
        stress[i] = gain * shape[i] * curvature[i]
    for i in range(index.size):
        local_gain = modes.local.weights[i] * modes.factors[5, count + i]
        for k in range(2 * index[i], 2 * index[i] + 2):
            stress[k] += local_gain * curvature[k]


@kernel(borrows=True)
def set_curved_terms(
    gain: FloatArray,
    step: float,
    stiffness: FloatArray,
    new_stiffness: FloatArray,
    u: FloatArray,
    velocity: FloatArray,
    b: FloatArray,
    new_b: FloatArray,
) -> None:
    """Write stiffness + gain, and b + gain (u + step velocity), with that of `set_curvature_stress`."""
    for k in range(stiffness.size):
        some = gain[2 * k]
        new_stiffness[k] = stiffness[k] + some
        for i in range(2 * k, 2 * k + 2):
            new_b[i] = b[i] + some * (u[i] + step * velocity[i])


@kernel(reorder=True, borrows=True)
def set_force(stiffness: FloatArray, u: FloatArray, b: FloatArray, force: FloatArray) -> None:
    """Write -sigma = stiffness u - b."""
    for k in range(stiffness.size):
        force[2 * k] = stiffness[k] * u[2 * k] - b[2 * k]
        force[2 * k + 1] = stiffness[k] * u[2 * k + 1] - b[2 * k + 1]


# Relative to the relaxed stiffness, the rounding up to which weights are products of a modulus and a shape.
_ROUNDING = 1e-14

# Part of the glassy stiffness from which on the first step has to resolve the relaxation time of a mode.
RELEVANT = 1e-3

_NO_CURVATURE = np.empty(0, dtype=np.complex128)

Scheme = Callable[[FloatArray], Factors]


def exponential(x: FloatArray) -> Factors:
    """Factors of the exponential step, u linear in time, for x = dt/theta >= 0."""
    factors = np.empty((7, x.size))
    set_exponential(x, factors)
    return Factors(*factors)


def backward_euler(x: FloatArray) -> Factors:
    """Factors of the backward Euler step, x = dt/theta >= 0."""
    factors = np.empty((7, x.size))
    set_backward_euler(x, factors)
    return Factors(*factors)


SCHEMES: dict[str, Scheme] = {"backward_euler": backward_euler, "exponential": exponential}


class Modes(Saving):
    """The relaxing modes of a surface: their history, stiffness and energy; an `Integrator`."""

    KEPT: ClassVar[tuple[str, ...]] = ("u", "branches.stretch", "local.stretch", "stored", "dissipated")

    stiffness: FloatArray  # kappa of the last `terms`, (nq,)
    loss_stiffness: FloatArray | None = None  # its imaginary part under a moving punch
    slope: ComplexArray | None = None  # factors i q of the slope along the motion of the punch, (nq,)

    def __init__(self, spectrum: Spectrum, scheme: Scheme, sums: Sums | None = None) -> None:
        # Energies are means over the surface of the grid. Without `sums` every wave has weight one.
        self.relaxed = np.ravel(spectrum.relaxed)
        size = self.relaxed.size
        self._sums = Sums(np.ones(size)) if sums is None else sums
        self.spectrum_error = self._sums.maximum(spectrum.error)
        self.shortest_time = shortest_time(spectrum, self._sums)
        weights, times = spectrum.weights.reshape(-1, size), spectrum.times.reshape(-1, size)
        missing = self._sums.maximum(len(weights)) - len(weights)  # modes without weight on this rank
        weights = np.concatenate((weights, np.zeros((missing, size)))) if missing else weights
        times = np.concatenate((times, np.ones((missing, size)))) if missing else times
        self.step = np.nan
        self._u = np.zeros(size, dtype=np.complex128)
        self.stored = self.dissipated = 0.0

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
        number, index = (np.ascontiguousarray(each) for each in np.nonzero(local))
        local_weights = local[local > 0]
        self._rows = len(weights), np.flatnonzero(of_branch), number  # of the stretches in the spectrum
        energy_weights = local_weights * self._sums.weights[index]
        self._local = LocalModes(index, local_weights, energy_weights, np.zeros((index.size, 2)))
        self._times = np.concatenate((branch_times, times[local > 0]))
        self.arrays = ModeArrays(
            branches=self._branches,
            local=self._local,
            times=self._times,
            relaxed=self.relaxed,
            springs=np.repeat(self.relaxed * self._sums.weights, 2),
            u=_numbers(self.u),
            factors=np.empty((7, self._times.size)),
            terms=StepTerms(np.empty(2 * size), np.empty(branch_times.size), np.empty(index.size)),
            stiffness=np.empty(size),
            implicit=scheme is backward_euler,
        )

    @property
    def u(self) -> ComplexArray:
        """The displacement after the last step, which changes in place."""
        return self._u

    @u.setter
    def u(self, array: ComplexArray) -> None:
        self._u, self.arrays = array, self.arrays._replace(u=_numbers(array))

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b, each of shape (nq,), at the end of a step (lines 5 and 6)."""
        self.prepare(step)
        self._b = np.empty_like(self.u)
        intercepts(self.arrays, _numbers(self._b))
        return self.stiffness, self._b

    def advance(self, spectrum: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Advance the history over the step of the last `terms` (lines 8 and 9)."""
        c = _NO_CURVATURE if curvature is None else curvature
        twice, heat = advance(self.arrays, _numbers(spectrum), _numbers(c))
        self.stored = self._sums.total(twice) / 2
        self.dissipated += self._sums.total(heat)

    @property
    def stretches(self) -> ComplexArray:
        """The stretches y_j of the modes of the spectrum, (modes, nq); zero where a mode has no weight."""
        count, of_branch, number = self._rows
        stretches = np.zeros((count, self.u.size), dtype=np.complex128)
        stretches[of_branch] = self._branches.stretch.view(np.complex128)
        stretches[number, self._local.position] = self._local.stretch.view(np.complex128)[:, 0]
        return stretches

    def curved(self, ratio: float, velocity: ComplexArray) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b of the last `terms` with the curvature, which is linear in u."""
        # `ratio` is the step over the last two; `velocity` belongs to the last step.
        gain = self.curvature_stress(np.full(self.u.shape, ratio, dtype=np.complex128))
        kappa, b = np.empty_like(self.stiffness), np.empty_like(self._b)
        spectra = (_numbers(each) for each in (self.u, velocity, self._b, b))
        set_curved_terms(_numbers(gain), self.step, self.stiffness, kappa, *spectra)
        return kappa, b

    def parts(self, spectrum: ComplexArray) -> ComplexArray:
        """Return the displacement itself: there is one body."""
        return spectrum

    @property
    def past(self) -> ComplexArray:
        """The displacement after the last step."""
        return self._u

    def slowest(self, tolerance: float) -> float:
        """Return a bound on the time in which a body that rests in the frame of the contact creeps."""
        # It is the longest relaxation time with more than the part `tolerance` of the stiffness, times the
        # largest ratio of glassy and relaxed stiffness.
        branches, local = self._branches, self._local
        glassy = self.relaxed + branches.shape[::2] * float(branches.moduli.sum())
        np.add.at(glassy, local.position, local.weights)
        some = self.relaxed > 0
        contrast = (glassy[some] / self.relaxed[some]).max(initial=1.0)
        shares = np.outer(branches.moduli, branches.shape[::2][some] / glassy[some])
        heaviest = shares.max(axis=1, initial=0.0)
        parts = np.concatenate((heaviest, local.weights / glassy[local.position]))
        longest = self._times[parts > tolerance].max(initial=0.0)
        return self._sums.maximum(float(contrast)) * self._sums.maximum(float(longest))

    def force(self, spectrum: ComplexArray) -> ComplexArray:
        """Return -sigma at the end of the step of the last `terms` for this displacement."""
        total = np.empty_like(self._b)
        set_force(self.stiffness, _numbers(spectrum), _numbers(self._b), _numbers(total))
        return total

    def curvature_stress(self, curvature: ComplexArray) -> ComplexArray:
        """Part of the stress -sigma at the end of the step that is due to dt^2 u''/2."""
        stress, gain = np.empty_like(curvature), weighted(self._branches.moduli, self.arrays.factors[5])
        set_curvature_stress(self.arrays, gain, _numbers(curvature), _numbers(stress))
        return stress

    def missing_stress(self, spectrum: ComplexArray, curvature: ComplexArray) -> ComplexArray:  # noqa: ARG002
        """Part of -sigma that `force` leaves out: for modes at rest only the curvature of u(t)."""
        return self.curvature_stress(curvature)

    def prepare(self, step: float) -> None:
        """Compute the stiffness and the factors for the length of a step."""
        if step == self.step:
            return
        # A new array of the stiffness: who has that of the last length may compare.
        self.step, self.arrays = step, self.arrays._replace(stiffness=np.empty_like(self.relaxed))
        prepare(self.arrays, step)
        self.stiffness = self.arrays.stiffness


def shortest_time(spectrum: Spectrum, sums: Sums) -> float:
    """Return the shortest relevant relaxation time on all ranks; infinite for an elastic body."""
    relevant = spectrum.weights > RELEVANT * spectrum.glassy
    return sums.minimum(float(spectrum.times[relevant].min(initial=math.inf)))


def _branch_modes(weights: FloatArray, times: FloatArray, relaxed: FloatArray, sums: Sums) -> BoolArray:
    """Find the modes with one time at all q and weights proportional to those of the heaviest of them."""
    total = sums.total(weights.sum(axis=1))
    longest = sums.maximum(np.where(weights > 0, times, 0.0).max(axis=1, initial=0.0))
    differ = (weights > 0) & (times != longest[:, np.newaxis])
    of_branch = (sums.total(differ.sum(axis=1)) == 0) & (total > 0)
    if of_branch.any():
        heaviest = np.argmax(np.where(of_branch, total, 0.0))
        shape = weights[heaviest] / total[heaviest]
        scale = _ROUNDING * (relaxed + weights.sum(axis=0))
        differ = np.abs(weights - total[:, np.newaxis] * shape) > scale
        of_branch &= sums.total(differ.sum(axis=1)) == 0
    return np.asarray(of_branch)


def _numbers(spectrum: ComplexArray) -> FloatArray:
    """Alternating real and imaginary parts, as the kernels take them."""
    return spectrum.view(np.float64)
