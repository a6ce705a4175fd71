"""The relaxing modes under a punch that moves along the surface, seen from the punch.

In coordinates X = x - x0(t) that move with the punch, at the velocity v = dx0/dt along the first axis, a mode
u(q) exp(i q x) of the displacement turns into U = u exp(i q x0), with q the wavenumber along x, and the
stretches of `modes` into Y_j:

    dY_j/dt + (1/theta_j - i q v) Y_j = dU/dt - i q v U,       sigma = -(K_0 U + sum_j w_j Y_j)

The punch stands still, the contact hardly moves, and what is steady for the punch is steady here. There Y_j
is r_j U, with r_j = s theta_j/(1 + s theta_j) at s = -i q v, so that sigma = -K(q, -i q v) U: the kernel of
steady sliding, whatever the step. With U linear over a step of length dt at a constant v, and with
z = dt (1/theta_j - i q v), what differs from the steady state is carried on exactly:

    D_j = Y_j - r_j U,        D_j <- exp(-z) D_j + (1 - r_j) phi_1(z) (U_1 - U_0)

phi_n(z) = sum_k (-z)^k/(k + n)!. Where the curvature c = dt^2 U''/2 is known afterwards, U is c (s^2 - s)
more at the part s of the step, and D_j ends with (1 - r_j) (2 phi_2 - phi_1) c more. At v = 0 all of this is
the exponential scheme of `modes`. A velocity that changes by dv over the step counts by its mean; what that
leaves out at the end, -i q dv dt (phi_2 - phi_1/2) (U - Y_j), is put right in the history as c is.

The stiffness at the end of the step, K_0 + sum_j w_j (r_j + (1 - r_j) phi_1), is complex: pressure and slope
of the surface are correlated, which is friction. Its imaginary part, `drag`, is odd in q.

The heat is what the motion of the surface, dU/dt - i q v U, does on each spring and dashpot, less what the
spring stores of it. For a polynomial motion both follow from the moments of Y_j over the step,

    int_0^1 (1 - s)^m/m! D_j ds = phi_(m+1) D_j + (1 - r_j) [phi_(m+2) (U_1 - U_0 - c) + 2 phi_(m+3) c]

A mode at the grid's largest wavenumber along x stands for two waves, +q and -q; it is the mean of both.
"""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.history.error_control import ErrorControlledModes
from gfmdlayer.history.modes import Modes, Scheme
from gfmdlayer.kernels import kernel
from gfmdlayer.punch.trajectory import Trajectory
from gfmdlayer.resumable import State

# A tangential force counts against at least this part of what the stresses could pull along the slopes.
_FAINT = 1e-4

# phi_5 by its series where |z| < 1: the first term left out is below rounding.
_TERMS = [(-1) ** k / math.factorial(k + 5) for k in range(18)]


class SlidingModes(Modes):
    """The relaxing modes of a surface in the frame of a punch that moves along it.

    Parameters
    ----------
    spectrum : Spectrum
        Of the wavenumbers of the grid's modes.
    scheme : callable
        Of the springs without dashpots, which need none; `exponential`.
    measure : ndarray
        Weight of each wavenumber in the mean over the surface.
    wavenumbers_x : ndarray, shape (2, *q.shape)
        Wavenumbers along x of the two waves that each mode is the mean of, mostly the same.
    velocity : callable
        v at a time, linear in time over each step.

    Attributes
    ----------
    drag : ndarray
        Imaginary part of the stiffness at the end of the step of the last `terms`.
    """

    loss_stiffness: FloatArray

    def __init__(
        self,
        spectrum: Spectrum,
        scheme: Scheme,
        measure: FloatArray,
        *,
        wavenumbers_x: FloatArray,
        velocity: Trajectory,
    ) -> None:
        springs = Spectrum(spectrum.relaxed, spectrum.weights[:0], spectrum.times[:0])
        super().__init__(springs, scheme, measure)
        self._velocity_at, self._time, self._made_for = velocity, 0.0, (np.nan, np.nan, np.nan)
        size = self.relaxed.size
        weights, times = spectrum.weights.reshape(-1, size), spectrum.times.reshape(-1, size)
        one, other = wavenumbers_x.reshape(2, size)
        self._q_1 = float(np.abs(one[one != 0]).min(initial=math.inf))
        both = one != other
        mode, index = np.nonzero(weights)
        twice = both[index]
        mode, self._at = np.append(mode, mode[twice]), np.append(index, index[twice])
        self._q = np.append(one[index], other[index[twice]])
        self._w = weights[mode, self._at] * np.where(both[self._at], 0.5, 1.0)
        self._theta = times[mode, self._at]
        self._measured = self._w * np.ravel(measure)[self._at]
        self._y = np.zeros(self._w.size, dtype=np.complex128)

    def prepare(self, step: float) -> None:
        """Make what depends on the length of the step and on the velocity."""
        super().prepare(step)
        before, after = self._velocity_at(self._time), self._velocity_at(self._time + step)
        if (step, before, after) == self._made_for:
            return
        self._made_for, velocity = (step, before, after), (before + after) / 2
        cycles = -1j * self._q * velocity * self._theta
        self._r = cycles / (1 + cycles)
        self._turned = self._q * velocity * step
        self._phi = phi_functions(step / self._theta - 1j * self._turned)
        gain = (1 - self._r) * self._phi[1]
        self._swerve = -1j * self._q * (after - before) * step * (self._phi[2] - self._phi[1] / 2)
        stiffness = self.relaxed + self._gathered(self._w * (self._r + gain))
        self._stiffness, self.loss_stiffness = stiffness.real.copy(), stiffness.imag.copy()
        self._of_u = self._gathered(self._w * (gain + self._r * self._phi[0]))
        self._of_y = self._w * self._phi[0]

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b, sigma = -(kappa + i drag) U + b, at the end of a step of this length."""
        self.prepare(step)
        b = self._of_u * self.u
        _subtract(self._at, self._of_y, self._y, b)
        return self._stiffness, b

    def advance(self, spectrum: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Carry the history on over the step of the last `terms`.

        Parameters
        ----------
        spectrum : ndarray
            The displacement at the end of the step.
        curvature : ndarray, optional
            dt^2 U''/2 over the step, where it is known; else U is linear.
        """
        curved = np.zeros_like(spectrum) if curvature is None else curvature
        swerved = self._swerve * (self.u[self._at] - self._y)
        twice, heat = _advance(
            self._at, self._measured, self._r, self._turned, self._phi, self._y, self.u, spectrum, curved
        )
        self._y += swerved
        super().advance(spectrum)  # the springs
        self.stored += twice / 2
        self.dissipated += max(heat, 0.0)  # which rounding can make negative where there is none
        self._time += self.step

    def state(self) -> State:
        """Return the history, the stretches and the time."""
        return {**super().state(), "y": self._y, "time": self._time}

    def restore(self, state: State) -> None:
        """Go on from there."""
        super().restore(state)
        self._y[:], self._time = state["y"], float(state["time"])

    def missing(self, curvature: ComplexArray) -> ComplexArray:
        """What the stress -sigma lacks at the end of the step if dt^2 U''/2 of it was not zero but this."""
        bend = (1 - self._r) * (2 * self._phi[2] - self._phi[1])
        swerved = self._swerve * (self.u[self._at] - self._y)
        return np.asarray(self._gathered(self._w * bend) * curvature + self._gathered(self._w * swerved))

    def slowest(self, tolerance: float) -> float:
        """Return the time of the slowest thing on the way to the steady state, at the last velocity.

        It is one passage over the cell, after which the punch meets its own track, or the longest relaxation
        time that matters. A branch much slower than the passage does not relax under the punch: what it adds
        to the loss is small, and what is left there of how the contact began is of the same size. So times
        whose part in the loss of the longest waves is within the tolerance do not matter.
        """
        velocity = abs(self._velocity_at(math.inf))
        longest = np.abs(self._q) < 1.5 * self._q_1
        cycles = (np.abs(self._q) * velocity * self._theta)[longest]
        loss = self._measured[longest] * cycles / (1 + cycles**2)
        matter = loss > tolerance * loss.sum()
        passage = 2 * math.pi / (self._q_1 * velocity)
        return max(passage, float(self._theta[longest][matter].max(initial=0.0)))

    def _gathered(self, values: ComplexArray) -> ComplexArray:
        """Sum at each wavenumber what the relaxing modes contribute."""
        size = self.relaxed.size
        real, imaginary = (np.bincount(self._at, part, size) for part in (values.real, values.imag))
        return np.asarray(real + 1j * imaginary)


class ErrorControlledSlidingModes(ErrorControlledModes, SlidingModes):
    """`SlidingModes` for steps of varying length: the history corrected, and the error known."""

    def __init__(
        self, spectrum: Spectrum, measure: FloatArray, *, wavenumbers_x: FloatArray, **motion: Any
    ) -> None:
        super().__init__(spectrum, measure, wavenumbers_x=wavenumbers_x, **motion)
        self._slope = 1j * np.ravel(wavenumbers_x.mean(axis=0))
        self._largest = 0.0

    def force(self, spectrum: ComplexArray) -> ComplexArray:
        """Return -sigma at the end of the step of the last `terms`."""
        return np.asarray(super().force(spectrum) + 1j * self.loss_stiffness * spectrum)

    def state(self) -> State:
        """Return the history, and the largest tangential force."""
        return {**super().state(), "largest": self._largest}

    def restore(self, state: State) -> None:
        """Go on from there."""
        super().restore(state)
        self._largest = float(state["largest"])

    def error(self, spectrum: ComplexArray, *, moving: bool, deep: bool) -> tuple[float, float]:
        """Error of the step, that of the tangential force among it, relative to its largest value so far."""
        relative, displacement = super().error(spectrum, moving=moving, deep=deep)
        slope, force = self._slope * spectrum, self.force(spectrum)
        least = _FAINT * math.sqrt(self._mean(slope, slope) * self._mean(force, force))
        self._largest = max(self._largest, least, abs(self._mean(slope, force)))
        lack = abs(self._mean(slope, self.lack(spectrum)))
        return max(relative, lack / self._largest if lack > 0 else 0.0), displacement


def phi_functions(z: ComplexArray) -> ComplexArray:
    """phi_n(z) = sum_k (-z)^k/(k + n)! for n = 0 ... 5 along the first axis; Re z >= 0.

    phi_0 is exp(-z), and phi_n = 1/n! - z phi_(n+1): upwards where |z| >= 1, else downwards from a series.
    """
    small, large = np.abs(z) < 1, np.where(np.abs(z) < 1, 1.0, z)
    near = np.where(small, z, 0.0)
    up, down = [np.exp(-large)], [np.polynomial.polynomial.polyval(near, _TERMS)]
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
    at: IntArray,
    measured: FloatArray,
    r: ComplexArray,
    turned: FloatArray,
    phi: ComplexArray,
    y: ComplexArray,
    u: ComplexArray,
    found: ComplexArray,
    curvature: ComplexArray,
) -> tuple[float, float]:
    """Carry the stretches on; return twice the energy that they store and the heat of the step."""
    twice, heat = 0.0, 0.0
    for i in range(at.size):
        k = at[i]
        new, c, iq = found[k], curvature[k], 1j * turned[i]
        change = new - u[k]
        away, straight, bent = y[i] - r[i] * u[k], (1 - r[i]) * (change - c), 2 * (1 - r[i]) * c
        after = phi[0, i] * away + phi[1, i] * straight + phi[2, i] * bent + r[i] * new
        # U = new - slope (1 - s) + c (1 - s)^2; dU/dt - i q v U in powers of 1 - s, divided by factorials.
        slope = change + c
        motion = (slope - iq * new, iq * slope - 2 * c, -2 * iq * c)
        work, factorial = 0.0, 1.0
        for m in range(3):
            steady = r[i] * (new / (m + 1) - slope / (m + 2) + c / (m + 3)) / factorial
            moment = phi[m + 1, i] * away + phi[m + 2, i] * straight + phi[m + 3, i] * bent + steady
            work += (np.conj(motion[m]) * moment).real
            factorial *= m + 1
        energy = _square(after)
        heat += measured[i] * (work - (energy - _square(y[i])) / 2)
        twice += measured[i] * energy
        y[i] = after
    return twice, heat


@nb.njit(nogil=True, inline="always")
def _square(y: complex) -> float:
    return y.real * y.real + y.imag * y.imag
