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
from gfmdlayer.history.modes import Modes, exponential, shortest_time
from gfmdlayer.kernels import kernel
from gfmdlayer.time_functions import TimeFunction

# phi_5 by its series where |z| < 1: the first term left out is below rounding.
_SERIES = [(-1) ** k / math.factorial(k + 5) for k in range(18)]


class Waves(NamedTuple):
    """Pairs of a mode and one of its waves, and their factors for the length of a step."""

    position: IntArray  # (pairs,), of the wavenumber
    energy_weights: FloatArray  # (pairs,), w_j times Parseval's weights
    stretch: ComplexArray  # (pairs,), the internal variables Y_j
    steady: ComplexArray  # (pairs,), r_j
    phase: FloatArray  # (pairs,), q v dt
    phi: ComplexArray  # (6, pairs), phi_n(z)


class SlidingModes(Modes):
    """The relaxing modes of a surface in the frame of a moving punch, by the exponential scheme."""

    KEPT = (*Modes.KEPT, "waves.stretch", "time")

    loss_stiffness: FloatArray  # (nq,), imaginary part of the stiffness at the end of the step
    slope: ComplexArray  # (nq,), i q, with the mean q of the two waves of a mode

    def __init__(
        self, spectrum: Spectrum, sums: Sums, *, wavenumbers_x: FloatArray, velocity: TimeFunction
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
        self._q = np.append(first[index], second[index[repeated]])
        self._weights = weights[mode, at] * self._modes[2]
        self._theta = times[mode, at]
        count = at.size
        self._waves = Waves(
            position=at,
            energy_weights=self._weights * sums.weights[at],
            stretch=np.zeros(count, dtype=np.complex128),
            steady=np.zeros(count, dtype=np.complex128),
            phase=np.zeros(count),
            phi=np.zeros((6, count), dtype=np.complex128),
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
        super().prepare(step)
        before, after = self._velocity_at(self._time), self._velocity_at(self._time + step)
        if (step, before, after) == self._prepared_for:
            return
        self._prepared_for, velocity = (step, before, after), (before + after) / 2
        cycles = -1j * self._q * velocity * self._theta
        steady, phase = cycles / (1 + cycles), self._q * velocity * step
        phi = phi_functions(step / self._theta - 1j * phase)
        self._waves = self._waves._replace(steady=steady, phase=phase, phi=phi)
        gain = (1 - steady) * phi[1]
        self._acceleration = -1j * self._q * (after - before) * step * (phi[2] - phi[1] / 2)
        stiffness = self.relaxed + self._sum_modes(self._weights * (steady + gain))
        self.stiffness, self.loss_stiffness = stiffness.real.copy(), stiffness.imag.copy()
        self._gain = self._sum_modes(self._weights * (gain + steady * phi[0]))
        self._decay = self._weights * phi[0]

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b, sigma = -(kappa + i loss_stiffness) U + b, at the end of a step."""
        self.prepare(step)
        self._b = self._gain * self.u
        _subtract(self._waves.position, self._decay, self._waves.stretch, self._b)
        return self.stiffness, self._b

    def advance(self, spectrum: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Advance the history over the step of the last `terms`; arguments as in `Modes.advance`."""
        c = np.zeros_like(spectrum) if curvature is None else curvature
        change = self._change_of_velocity()
        twice, heat = _advance(self._waves, self.u, spectrum, c)
        self._waves.stretch[:] += change
        super().advance(spectrum)  # the springs K_0
        self.stored += self._sums.total(twice) / 2
        self.dissipated += max(self._sums.total(heat), 0.0)  # rounding can make a heat of zero negative
        self._time += self.step

    def force(self, spectrum: ComplexArray) -> ComplexArray:
        """Return -sigma at the end of the step of the last `terms` for this displacement."""
        return np.asarray(super().force(spectrum) + 1j * self.loss_stiffness * spectrum)

    def curvature_stress(self, curvature: ComplexArray) -> ComplexArray:
        """Part of -sigma at the end of the step that is due to dt^2 U''/2."""
        steady, phi = self._waves.steady, self._waves.phi
        gain = self._sum_modes(self._weights * ((1 - steady) * (2 * phi[2] - phi[1])))
        return np.asarray(gain * curvature)

    def missing_stress(self, spectrum: ComplexArray, curvature: ComplexArray) -> ComplexArray:
        """Part of -sigma due to dt^2 U''/2 and to the change of the velocity over the step."""
        change = self._sum_modes(self._weights * self._change_of_velocity())
        return np.asarray(super().missing_stress(spectrum, curvature) + change)

    def slowest(self, tolerance: float) -> float:
        """Return the longest time on the way to the steady state, at the last velocity."""
        # It is the time of one passage over the period, after which the punch meets its own track, or the
        # longest relevant relaxation time. A branch that is much slower than the passage does not relax under
        # the punch: its part in the loss is small, and so is its memory of the start of the contact.
        # Relaxation times with at most the part `tolerance` of the loss of the longest waves are not
        # relevant.
        velocity = abs(self._velocity_at(math.inf))
        longest = np.abs(self._q) < 1.5 * self._longest_wave
        cycles = (np.abs(self._q) * velocity * self._theta)[longest]
        loss = self._waves.energy_weights[longest] * cycles / (1 + cycles**2)
        relevant = loss > tolerance * self._sums.total(float(loss.sum()))
        passage = 2 * math.pi / (self._longest_wave * velocity)
        return max(passage, self._sums.maximum(float(self._theta[longest][relevant].max(initial=0.0))))

    def _change_of_velocity(self) -> ComplexArray:
        """Change of the stretches because the velocity changes over the step."""
        return np.asarray(self._acceleration * (self.u[self._waves.position] - self._waves.stretch))

    def _sum_modes(self, values: ComplexArray) -> ComplexArray:
        """Sum over the modes at each wavenumber."""
        index, size = self._waves.position, self.relaxed.size
        real, imaginary = (np.bincount(index, part, size) for part in (values.real, values.imag))
        return np.asarray(real + 1j * imaginary)


def phi_functions(z: ComplexArray) -> ComplexArray:
    """phi_n(z) = sum_k (-z)^k/(k + n)! for n = 0 ... 5 along the first axis; Re z >= 0."""
    # phi_0 is exp(-z), and phi_n = 1/n! - z phi_(n+1): upwards where |z| >= 1, else downwards from a series.
    small, large = np.abs(z) < 1, np.where(np.abs(z) < 1, 1.0, z)
    near = np.where(small, z, 0.0)
    up, down = [np.exp(-large)], [np.polynomial.polynomial.polyval(near, _SERIES)]
    for n in range(5):
        up.append((1 / math.factorial(n) - up[-1]) / large)
        down.append(1 / math.factorial(4 - n) - near * down[-1])
    return np.where(small, np.stack(down[::-1]), np.stack(up))


@kernel(reorder=True)
def _subtract(at: IntArray, factors: ComplexArray, y: ComplexArray, b: ComplexArray) -> None:
    for i in range(at.size):
        b[at[i]] -= factors[i] * y[i]


@kernel(reorder=True)
def _advance(
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


@nb.njit(nogil=True, inline="always")
def _square(y: complex) -> float:
    return y.real * y.real + y.imag * y.imag
