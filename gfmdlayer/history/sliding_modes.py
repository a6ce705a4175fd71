"""The relaxing modes under a punch that moves along the surface, in the frame of the punch.

In coordinates X = x - x0(t) that move with the punch, at the velocity v = dx0/dt along the first axis, a mode
u(q) exp(i q x) of the displacement becomes U = u exp(i q x0), with q the wavenumber along x, and the
stretches of `modes` become Y_j:

    dY_j/dt + (1/theta_j - i q v) Y_j = dU/dt - i q v U,       sigma = -(K_0 U + sum_j w_j Y_j)

In this frame the contact hardly moves, and steady sliding is a steady state. There Y_j = r_j U, with
r_j = s theta_j/(1 + s theta_j) at s = -i q v, so that sigma = -K(q, -i q v) U: the kernel of steady sliding,
for any step. With U linear over a step of length dt at a constant v, and with z = dt (1/theta_j - i q v), the
difference from the steady state is integrated exactly:

    D_j = Y_j - r_j U,        D_j <- exp(-z) D_j + (1 - r_j) phi_1(z) (U_1 - U_0)

phi_n(z) = sum_k (-z)^k/(k + n)!. Where the curvature c = dt^2 U''/2 is known after the step, U is larger by
c (s^2 - s) at the fraction s of the step, and D_j by (1 - r_j) (2 phi_2 - phi_1) c at its end. At v = 0 all
of this is the exponential scheme of `modes`. A velocity that changes by dv over the step enters by its mean;
the term that this neglects, -i q dv dt (phi_2 - phi_1/2) (U - Y_j) at the end, is added like the term of c.

The stiffness at the end of the step, K_0 + sum_j w_j (r_j + (1 - r_j) phi_1), is complex: pressure and slope
of the surface are correlated, which is friction. Its imaginary part, the loss stiffness, is odd in q.

The heat is the work of the motion of the surface, dU/dt - i q v U, on each spring and dashpot, less the
energy that the spring stores. For a polynomial motion both follow from the moments of Y_j over the step,

    int_0^1 (1 - s)^m/m! D_j ds = phi_(m+1) D_j + (1 - r_j) [phi_(m+2) (U_1 - U_0 - c) + 2 phi_(m+3) c]

A mode at the grid's largest wavenumber along x stands for two waves, +q and -q; it is the mean of both.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba as nb
import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.modes import Modes, exponential, set_force, shortest_time
from gfmdlayer.history.reduced_time import MotionInReducedTime
from gfmdlayer.kernels import address_of, by_address, kernel, product, quotient
from gfmdlayer.time_functions import Constant, Table

# phi_5 by its series where |z| < 1: the first term left out is below rounding.
_SERIES = tuple((-1) ** k / math.factorial(k + 5) for k in range(18))
_FACTORIALS = tuple(float(math.factorial(n)) for n in range(5))


class Waves(NamedTuple):
    """Pairs of a mode and one of its waves, and what belongs to the length of a step."""

    position: IntArray  # (pairs,), of the wavenumber
    wavenumbers: FloatArray  # (pairs,), q along x
    times: FloatArray  # (pairs,), theta_j
    weights: FloatArray  # (pairs,), w_j, of two waves of a mode a half each
    energy_weights: FloatArray  # (pairs,), the weights times Parseval's
    stretch: ComplexArray  # (pairs,), the internal variables Y_j
    steady: ComplexArray  # (pairs,), r_j
    phase: FloatArray  # (pairs,), q v dt
    phi: ComplexArray  # (6, pairs), phi_n(z)
    decay: ComplexArray  # (pairs,), w_j exp(-z)
    acceleration: ComplexArray  # (pairs,), -i q dv dt (phi_2 - phi_1/2)
    change: ComplexArray  # (pairs,), of the stretches because the velocity changes; work array
    gain: ComplexArray  # (nq,), sum_j w_j ((1 - r_j) phi_1 + r_j exp(-z))
    curvature_gain: ComplexArray  # (nq,), sum_j w_j (1 - r_j) (2 phi_2 - phi_1)


class SlidingArrays(NamedTuple):
    """The modes for a compiled loop at a constant velocity."""

    waves: Waves
    loss_stiffness: FloatArray  # (nq,)
    slope: ComplexArray  # (nq,), i q
    still: ComplexArray  # (nq,), no curvature
    of_u: FloatArray  # (2 nq,), work array
    velocity: float
    advance: int  # address of `advance`
    time: FloatArray  # of the history, one number


class SlidingModes(Modes):
    """The relaxing modes of a surface in the frame of a moving punch, by the exponential scheme."""

    KEPT = (*Modes.KEPT, "waves.stretch", "time")

    loss_stiffness: FloatArray  # (nq,), imaginary part of the stiffness at the end of the step
    slope: ComplexArray  # (nq,), i q, with the mean q of the two waves of a mode

    def __init__(
        self,
        spectrum: Spectrum,
        sums: Sums,
        *,
        wavenumbers_x: FloatArray,
        velocity: Constant | Table | MotionInReducedTime,
    ) -> None:
        # `wavenumbers_x`, shape (2, *q.shape): wavenumbers along x of the two waves whose mean is the mode;
        # mostly they are the same. `velocity`: v at a time, linear in time over each step.
        # The base class has the springs K_0 but no dashpots.
        springs = Spectrum(spectrum.relaxed, spectrum.weights[:0], spectrum.times[:0], spectrum.error)
        super().__init__(springs, exponential, sums)
        self.shortest_time = shortest_time(spectrum, sums)
        self.slope = 1j * np.ravel(wavenumbers_x.mean(axis=0))
        self._velocity_at, self._time, self._prepared_for = velocity, 0.0, (np.nan, np.nan, np.nan)
        size = self.relaxed.size
        weights, times = spectrum.weights.reshape(-1, size), spectrum.times.reshape(-1, size)
        first, second = wavenumbers_x.reshape(2, size)
        self._longest_wave = sums.minimum(float(np.abs(first[first != 0]).min(initial=math.inf)))
        mode, index = np.nonzero(weights)
        two_waves = first != second
        repeated = two_waves[index]
        mode, at = np.append(mode, mode[repeated]), np.append(index, index[repeated])
        self._modes = len(weights), mode, np.where(two_waves[at], 0.5, 1.0)
        count, own = at.size, weights[mode, at] * self._modes[2]
        self._waves = Waves(
            position=at,
            wavenumbers=np.append(first[index], second[index[repeated]]),
            times=times[mode, at],
            weights=own,
            energy_weights=own * sums.weights[at],
            stretch=np.zeros(count, dtype=np.complex128),
            steady=np.zeros(count, dtype=np.complex128),
            phase=np.zeros(count),
            phi=np.zeros((6, count), dtype=np.complex128),
            decay=np.zeros(count, dtype=np.complex128),
            acceleration=np.zeros(count, dtype=np.complex128),
            change=np.zeros(count, dtype=np.complex128),
            gain=np.zeros(size, dtype=np.complex128),
            curvature_gain=np.zeros(size, dtype=np.complex128),
        )

    @property
    def stretches(self) -> ComplexArray:
        """The stretches Y_j of the modes of the spectrum, (modes, nq): the mean of the waves of a mode."""
        (count, mode, share), waves = self._modes, self._waves
        stretches = np.zeros((count, self.relaxed.size), dtype=np.complex128)
        np.add.at(stretches, (mode, waves.position), waves.stretch * share)
        return stretches

    def prepare(self, step: float) -> None:
        """Compute the stiffness and the factors for the length of a step and for the velocity."""
        before, after = self._velocity_at.over(self._time, step)
        if (step, before, after) == self._prepared_for:
            return
        # New arrays of the stiffness, as in `Modes.prepare`.
        self.step, self._prepared_for = step, (step, before, after)
        self.stiffness, self.loss_stiffness = np.empty_like(self.relaxed), np.empty_like(self.relaxed)
        prepare(self._waves, step, before, after, self.relaxed, self.stiffness, self.loss_stiffness)

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b, sigma = -(kappa + i loss_stiffness) U + b, at the end of a step."""
        self.prepare(step)
        self._b = np.empty_like(self.u)
        intercepts(self._waves, self.u, self._b)
        return self.stiffness, self._b

    def advance(self, spectrum: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Advance the history over the step of the last `terms`; arguments as in `Modes.advance`."""
        c = np.zeros_like(spectrum) if curvature is None else curvature
        set_change(self._waves, self.u)
        twice, heat = advance(self._waves, self.u, spectrum, c)
        self._waves.stretch[:] += self._waves.change
        super().advance(spectrum)  # the springs K_0
        self.stored += self._sums.total(twice) / 2
        self.dissipated += max(self._sums.total(heat), 0.0)  # rounding can make a heat of zero negative
        self._time += self.step

    def force(self, spectrum: ComplexArray) -> ComplexArray:
        """Return -sigma at the end of the step of the last `terms` for this displacement."""
        force = np.empty_like(spectrum)
        assert self.loss_stiffness is not None
        set_force_with_loss(self.stiffness, self.loss_stiffness, spectrum, self._b, force)
        return force

    def curvature_stress(self, curvature: ComplexArray) -> ComplexArray:
        """Part of -sigma at the end of the step that is due to dt^2 U''/2."""
        stress = np.zeros_like(self.u)
        add_products(self._waves.curvature_gain, curvature, stress)
        return stress

    def missing_stress(self, spectrum: ComplexArray, curvature: ComplexArray) -> ComplexArray:  # noqa: ARG002
        """Part of -sigma due to dt^2 U''/2 and to the change of the velocity over the step."""
        stress = np.empty_like(self.u)
        set_missing_stress(self._waves, self.u, curvature, stress)
        return stress

    def arrays_of_loop(self) -> SlidingArrays:
        """Return the arrays for a compiled loop."""
        still = np.zeros_like(self.u)
        return SlidingArrays(
            waves=self._waves,
            loss_stiffness=np.empty(still.size),
            slope=self.slope,
            still=still,
            of_u=np.empty(2 * still.size),
            velocity=float(self._velocity_at(0.0)),
            advance=address_of(advance, self._waves, still, still, still),
            time=np.zeros(1),
        )

    def into(self, arrays: SlidingArrays) -> None:
        """Write the time of the history into the arrays of a compiled loop."""
        arrays.time[0] = self._time

    def out_of(self, arrays: SlidingArrays) -> None:
        """Take over the time of a compiled loop; the factors are those of another step."""
        self._time, self._prepared_for = float(arrays.time[0]), (np.nan, np.nan, np.nan)

    def slowest(self, tolerance: float) -> float:
        """Return the longest time on the way to the steady state, at the last velocity."""
        # It is the time of one passage over the period, after which the punch meets its own track, or the
        # longest relevant relaxation time. A branch that is much slower than the passage does not relax under
        # the punch: its part in the loss is small, and so is its memory of the start of the contact.
        # Relaxation times with at most the part `tolerance` of the loss of the longest waves are not
        # relevant.
        velocity = abs(self._velocity_at(math.inf))
        waves = self._waves
        longest = np.abs(waves.wavenumbers) < 1.5 * self._longest_wave
        cycles = (np.abs(waves.wavenumbers) * velocity * waves.times)[longest]
        loss = waves.energy_weights[longest] * cycles / (1 + cycles**2)
        relevant = loss > tolerance * self._sums.total(float(loss.sum()))
        passage = 2 * math.pi / (self._longest_wave * velocity)
        return max(passage, self._sums.maximum(float(waves.times[longest][relevant].max(initial=0.0))))


def phi_functions(z: ComplexArray) -> ComplexArray:
    """phi_n(z) = sum_k (-z)^k/(k + n)! for n = 0 ... 5 along the first axis; Re z >= 0."""
    phi = np.empty((6, z.size), dtype=np.complex128)
    for i in range(z.size):
        set_phi(z[i], phi, i)
    return phi


# The kernels have the bits of the same expressions of numpy's arrays.


@kernel(borrows=True)
def set_phi(z: complex, phi: ComplexArray, i: int) -> None:
    """Write phi_n(z) to a column."""
    # phi_0 is exp(-z), and phi_n = 1/n! - z phi_(n+1): upwards where |z| >= 1, else downwards from a series.
    if math.hypot(z.real, z.imag) < 1.0:
        value = complex(_SERIES[-1], 0.0)
        for k in range(2, len(_SERIES) + 1):
            value = _SERIES[-k] + product(value, z)
        phi[5, i] = value
        for n in range(4, -1, -1):
            value = 1.0 / _FACTORIALS[n] - product(z, value)
            phi[n, i] = value
    else:
        size = math.exp(-z.real)
        value = complex(size * math.cos(-z.imag), size * math.sin(-z.imag))
        phi[0, i] = value
        for n in range(5):
            value = quotient(1.0 / _FACTORIALS[n] - value, z)
            phi[n + 1, i] = value


@kernel(borrows=True)
def prepare(
    waves: Waves,
    step: float,
    before: float,
    after: float,
    relaxed: FloatArray,
    stiffness: FloatArray,
    loss_stiffness: FloatArray,
) -> None:
    """Write factors and stiffness for the length of a step and the velocities before and after it."""
    velocity, phi, gain, curvature_gain = (before + after) / 2, waves.phi, waves.gain, waves.curvature_gain
    for k in range(relaxed.size):
        stiffness[k] = loss_stiffness[k] = 0.0
        gain[k] = curvature_gain[k] = 0.0
    for i in range(waves.position.size):
        k, q, w = waves.position[i], waves.wavenumbers[i], waves.weights[i]
        cycles, phase = -q * velocity * waves.times[i], q * velocity * step
        r = quotient(complex(0.0, cycles), complex(1.0, cycles))
        set_phi(complex(step / waves.times[i], 0.0 - phase), phi, i)
        of_change, of_curvature = product(1.0 - r, phi[1, i]), product(1.0 - r, 2.0 * phi[2, i] - phi[1, i])
        at_end, of_last = r + of_change, of_change + product(r, phi[0, i])
        lag, factor = phi[2, i] - 0.5 * phi[1, i], -q * (after - before) * step
        waves.steady[i], waves.phase[i], waves.decay[i] = r, phase, w * phi[0, i]
        waves.acceleration[i] = complex(-(factor * lag.imag), factor * lag.real)
        stiffness[k] += w * at_end.real
        loss_stiffness[k] += w * at_end.imag
        gain[k] += w * of_last
        curvature_gain[k] += w * of_curvature
    for k in range(relaxed.size):
        stiffness[k] = relaxed[k] + stiffness[k]


@kernel(borrows=True)
def intercepts(waves: Waves, u: ComplexArray, b: ComplexArray) -> None:
    """Set b to sum_j w_j (((1 - r_j) phi_1 + r_j exp(-z)) U - exp(-z) Y_j)."""
    for k in range(b.size):
        b[k] = product(waves.gain[k], u[k])
    _subtract(waves.position, waves.decay, waves.stretch, b)


@kernel(borrows=True)
def set_force_with_loss(
    stiffness: FloatArray, loss_stiffness: FloatArray, u: ComplexArray, b: ComplexArray, force: ComplexArray
) -> None:
    """Write -sigma = (stiffness + i loss_stiffness) u - b."""
    set_force(stiffness, u.view(np.float64), b.view(np.float64), force.view(np.float64))
    for k in range(force.size):
        force[k] += complex(-(loss_stiffness[k] * u[k].imag), loss_stiffness[k] * u[k].real)


@kernel(borrows=True)
def set_missing_stress(waves: Waves, u: ComplexArray, curvature: ComplexArray, stress: ComplexArray) -> None:
    """Write the part of -sigma due to the curvature and to the change of the velocity."""
    for k in range(stress.size):
        stress[k] = 0.0
    set_change(waves, u)
    for i in range(waves.position.size):
        stress[waves.position[i]] += waves.weights[i] * waves.change[i]
    add_products(waves.curvature_gain, curvature, stress)


@kernel(borrows=True)
def add_products(factors: ComplexArray, values: ComplexArray, total: ComplexArray) -> None:
    """Add the product of two arrays."""
    for k in range(total.size):
        total[k] += product(factors[k], values[k])


@kernel(borrows=True)
def set_change(waves: Waves, u: ComplexArray) -> None:
    """Write the change of the stretches because the velocity changes over the step."""
    for i in range(waves.change.size):
        waves.change[i] = product(waves.acceleration[i], u[waves.position[i]] - waves.stretch[i])


@kernel(reorder=True, inner=True, borrows=True)
def _subtract(at: IntArray, factors: ComplexArray, y: ComplexArray, b: ComplexArray) -> None:
    for i in range(at.size):
        b[at[i]] -= factors[i] * y[i]


@kernel(reorder=True)
def advance(
    waves: Waves, u: ComplexArray, new_u: ComplexArray, curvature: ComplexArray
) -> tuple[float, float]:
    """Advance the stretches; return twice the energy that they store, and the heat of the step."""
    r, phi, y = waves.steady, waves.phi, waves.stretch
    twice, heat = 0.0, 0.0
    for i in range(waves.position.size):
        k = waves.position[i]
        new, c, iq = new_u[k], curvature[k], 1j * waves.phase[i]
        change = new - u[k]
        difference, straight, curved = y[i] - r[i] * u[k], (1 - r[i]) * (change - c), 2 * (1 - r[i]) * c
        after = phi[0, i] * difference + phi[1, i] * straight + phi[2, i] * curved + r[i] * new
        # U = new - slope (1 - s) + c (1 - s)^2; dU/dt - i q v U in powers of 1 - s, divided by factorials.
        slope = change + c
        motion = (slope - iq * new, iq * slope - 2 * c, -2 * iq * c)
        work, factorial = 0.0, 1.0
        for m in range(3):
            steady = r[i] * (new / (m + 1) - slope / (m + 2) + c / (m + 3)) / factorial
            moment = phi[m + 1, i] * difference + phi[m + 2, i] * straight + phi[m + 3, i] * curved + steady
            work += (np.conj(motion[m]) * moment).real
            factorial *= m + 1
        energy = _square(after)
        heat += waves.energy_weights[i] * (work - (energy - _square(y[i])) / 2)
        twice += waves.energy_weights[i] * energy
        y[i] = after
    return twice, heat


advance_by_address = by_address(advance, nb.float64, nb.float64)


@nb.njit(nogil=True, inline="always")
def _square(y: complex) -> float:
    return y.real * y.real + y.imag * y.imag
