"""The exponential integrator for steps of varying length: the curvature of u(t), and the error of a step.

The exponential scheme of `modes` takes u as linear over the step. The curvature that it neglects,
c = dt^2 u''/2, follows after the step is solved from the divided difference of the last three accepted
displacements. It has two uses:

* The history is advanced with it (`Modes.advance`), to third order, so that errors do not accumulate.
* The truncation error of the step remains: at its end the stress -sigma is too small by
  delta f = sum_j w_j curvature_gain_j c.

At given depth a small delta f changes the mean pressure by -<v, delta f>, where v is the derivative of the
displacement with respect to the depth: -1 all over the contact, free of stress outside it, and zero in the
mean. While the punch moves, the change of u over the step is proportional to v. While it rests, the contact
grows beyond that of the last step in which it moved, and the displacement u itself, in place of v, is in
error to the other side. (It is not used where the punch is all but withdrawn: the dent that is left does not
follow the punch.) Divided by <v, f>, which is proportional to the mean pressure, either gives a relative
error, and the larger one counts.

At given load the depth changes, by less in one step; but it creeps for longer than the pressure relaxes, and
earlier errors add to that, so that the same number serves (measured: half of it is reached). The part of
delta f that changes neither pressure nor depth moves the free surface: with r the quotient above, by
(delta f - r f)/kappa.

Under an interface that attracts the mean pressure is a difference, and goes through zero. There the part of
delta f along v, <v, delta f>/|v|, counts relative to the largest stress so far, and r as zero. And the edge
of the contact moves by the tractions around it: an error delta f there, alike in all steps, is one of the
work that it takes to open the contact. So c is a part of the stress of a step there, as it is of the history:

    c = rho (u - u_0 - dt v_0),        rho = dt/(dt + dt_0),        sum_j w_j (y_j + curvature_gain_j c)

with the displacement u_0 and the velocity v_0 before, over the last step dt_0. c is linear in u, and kappa
grows by rho sum_j w_j curvature_gain_j. The estimate of the error stays, and is then on the safe side.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history import mode_kernels as kernels
from gfmdlayer.history.mode_kernels import exponential
from gfmdlayer.history.modes import Modes
from gfmdlayer.resumable import State

# Part of the change over a step after a kink, without an earlier displacement, that may be curvature:
# measured, it is 0.1 where contact begins and less elsewhere.
_UNKNOWN_CURVATURE = 0.25

# A force below this part of the stresses of which it is the difference is rounding: no contact.
_NO_CONTACT = 1e-10
_TINY = 1e-300  # in place of a division by zero

# Part of the glassy stiffness from which on the first step has to resolve the relaxation time of a mode.
RELEVANT = 1e-3


class ErrorControlledModes(Modes):
    """The relaxing modes of a surface for steps of varying length.

    Parameters
    ----------
    spectrum : Spectrum
        Relaxing modes at the grid's wavenumbers.
    sums : Sums
        Sums over the grid.
    curved : bool
        Whether the stress of a step takes u as a parabola through the last steps, where these predict it.

    Attributes
    ----------
    shortest_time : float
        Shortest relevant relaxation time; infinite for an elastic body.
    """

    def __init__(self, spectrum: Spectrum, sums: Sums, *, curved: bool = False, **motion: Any) -> None:
        super().__init__(spectrum, exponential, sums, **motion)
        self._curved = curved
        relevant = spectrum.weights > RELEVANT * spectrum.glassy
        self.shortest_time = sums.minimum(float(spectrum.times[relevant].min(initial=math.inf)))
        self._contact_motion: ComplexArray | None = None  # change of u over the last step of a moving punch
        self._velocity: ComplexArray | None = None
        self._last_step = self._largest_stress = 0.0

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b at the end of a step, see `Modes`; with the curvature where it counts."""
        stiffness, b = super().terms(step)
        if not self._curved or self._velocity is None:
            return stiffness, b
        gain = self.curvature_stress(np.full(self.u.shape, self._ratio, dtype=np.complex128)).real
        return stiffness + gain, b + gain * (self.u + self.step * self._velocity)

    def advance(self, spectrum: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Advance the history over the step of the last `terms`, with the curvature that is now known."""
        velocity = (spectrum - self.u) * (1 / self.step) if self.step > 0 else None
        super().advance(spectrum, self._curvature(spectrum) if curvature is None else curvature)
        if velocity is not None:
            self._velocity, self._last_step = velocity, self.step

    def discard_velocity(self) -> None:
        """Discard the velocity of the surface, which does not predict its displacement after a kink."""
        self._velocity = None

    def deforms(self, spectrum: ComplexArray) -> bool:
        """Return whether a displacement is not zero."""
        return bool(self._sums.maximum(int(spectrum.any())))

    def force(self, spectrum: ComplexArray) -> ComplexArray:
        """Return -sigma at the end of the step of the last `terms` for this displacement, for a linear u."""
        b = self._b.view(np.float64)
        return kernels.force(self._stiffness, spectrum.view(np.float64), b).view(np.complex128)

    def truncation_error(self, spectrum: ComplexArray) -> ComplexArray:
        """Return delta f, by which that force is too small because u is not linear over the step."""
        curvature = self._curvature(spectrum)
        return self.curvature_stress(
            _UNKNOWN_CURVATURE * (spectrum - self.u) if curvature is None else curvature
        )

    def error(
        self, spectrum: ComplexArray, *, moving: bool, deep: bool, attracted: bool = False
    ) -> tuple[float, float]:
        """Estimate the error of the step of the last `terms`.

        Parameters
        ----------
        spectrum : ndarray of complex, shape (nq,)
            Transform of the displacement at the end of the step.
        moving : bool
            Whether the punch moves over the step.
        deep : bool
            Whether the depth of the punch is still comparable to its largest value.
        attracted : bool
            Whether the interface attracts.

        Returns
        -------
        float, float
            Relative error of the mean pressure (at given load, of the depth; of the stress, where the
            interface attracts), and root mean square error of the displacement, a length.
        """
        error, force = self.truncation_error(spectrum), self.force(spectrum)
        if moving:  # the change over a step that is then rejected serves as well
            self._contact_motion = spectrum - self.u
        weights, kappa = self._sums.weights, self._stiffness
        norm = self._sums.total(kernels.stress_norm(weights, kappa, spectrum.view(np.float64)))
        self._largest_stress = max(self._largest_stress, math.sqrt(norm)) if attracted else 0.0
        ratio = part = 0.0
        for v in (spectrum if deep else None, self._contact_motion):
            if v is None:
                continue
            work, error_work, squares = self._sums.spectral_means(v, force, error)
            if attracted:
                part = max(part, abs(error_work) / (math.sqrt(squares) * self._largest_stress + _TINY))
            elif work**2 > _NO_CONTACT**2 * squares * norm:
                ratio = max(ratio, error_work / work, key=abs)
        square = kernels.displacement_error(
            weights, kappa, error.view(np.float64), ratio, force.view(np.float64)
        )
        return part if attracted else abs(ratio), math.sqrt(self._sums.total(square))

    def state(self) -> State:
        """Return the history and the last motion of the surface."""
        motion = {"contact_motion": self._contact_motion, "velocity": self._velocity}
        known = {name: value for name, value in motion.items() if value is not None}
        stress = {"largest_stress": self._largest_stress} if self._largest_stress else {}
        return {**super().state(), **known, **stress, "last_step": self._last_step}

    def restore(self, state: State) -> None:
        """Continue from there."""
        super().restore(state)
        self._contact_motion, self._velocity = state.get("contact_motion"), state.get("velocity")
        self._last_step = float(state["last_step"])
        self._largest_stress = float(state.get("largest_stress", 0.0))

    def _curvature(self, spectrum: ComplexArray) -> ComplexArray | None:
        """dt^2 u''/2 from the divided difference of the last three displacements, this one included."""
        if self._velocity is None:
            return None
        numbers = (each.view(np.float64) for each in (spectrum, self.u, self._velocity))
        return kernels.curvature(self._ratio, self.step, *numbers).view(np.complex128)

    @property
    def _ratio(self) -> float:
        """Length of the step over that of the last two."""
        return self.step / (self.step + self._last_step)
