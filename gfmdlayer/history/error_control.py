"""Error control for steps of varying length: the curvature of u(t), and the error of a step.

The exponential scheme of `modes` takes u as linear over the step. The curvature that it neglects,
c = dt^2 u''/2, follows after the step is solved from the divided difference of the last three accepted
displacements. It has two uses:

* The history is advanced with it, to third order, so that errors do not accumulate.
* The truncation error of the step remains: at its end the stress -sigma is too small by
  delta f = sum_j w_j curvature_gain_j c.

At given depth a small delta f changes the mean pressure by -<v, delta f>, where v is the derivative of the
displacement with respect to the depth: -1 all over the contact, free of stress outside it, and zero in the
mean. While the punch moves, the change of u over the step is proportional to v. While it rests, the contact
grows beyond the contact of the last step in which it moved. The displacement u itself, in place of v, is in
error to the other side. (u is not used where the punch is all but withdrawn: the dent that is left does not
follow the punch.) Divided by <v, f>, which is proportional to the mean pressure, either gives a relative
error, and the larger one counts.

At given load the depth changes, by less in one step; but it creeps for longer than the pressure relaxes, and
earlier errors add to that, so that the same number serves (measured: half of it is reached). The part of
delta f that changes neither pressure nor depth moves the free surface: with r the quotient above, by
(delta f - r f)/kappa.

Under an interface that attracts, the mean pressure is a difference and goes through zero. There the part of
delta f along v, <v, delta f>/|v|, counts relative to the largest stress so far, and r as zero. And the edge
of the contact moves by the tractions around it: if all steps have the same error delta f there, they change
the work that it takes to open the contact. So c is then a part of the stress of a step, as of the history:

    c = rho (u - u_0 - dt v_0),        rho = dt/(dt + dt_0),        sum_j w_j (y_j + curvature_gain_j c)

with the displacement u_0 and the velocity v_0 before, over the last step dt_0. c is linear in u, and kappa
grows by rho sum_j w_j curvature_gain_j. The estimate of the error is not changed: it is then an upper bound.

Under a punch that moves along the surface the tangential force counts too: the mean of the slope of the
surface times delta f, relative to the largest tangential force so far.
"""

from __future__ import annotations

import math

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.modes import Modes
from gfmdlayer.history.side_by_side import SideBySide
from gfmdlayer.kernels import kernel
from gfmdlayer.resumable import State

# Part of the change over a step that may be curvature, where no earlier displacement is known:
# measured, it is 0.1 where contact begins and less elsewhere.
_UNKNOWN_CURVATURE = 0.25

# A force below this part of the stresses of which it is the difference is rounding: no contact.
_NO_CONTACT = 1e-10
_TINY = 1e-300  # in place of a division by zero

# Smallest scale of a tangential force, as a part of the product of the norms of slopes and stresses.
_SMALLEST_FORCE = 1e-4


# The history of one body or two: -kappa u + b is the stress at the end of a step.
Integrator = Modes | SideBySide


class ErrorControl:
    """Controls the error of an integrator with the exponential scheme and steps that vary in length."""

    def __init__(self, integrator: Integrator, sums: Sums, tolerance: float, *, curved: bool = False) -> None:
        # The tolerance is the largest error of the mean pressure relative to its largest value so far (of the
        # depth, in load control), and of the displacement relative to the largest depth so far. `curved`: the
        # stress of a step includes the curvature, see above.
        self._integrator, self._sums, self._curved = integrator, sums, curved
        self.tolerance = tolerance
        self._contact_motion: ComplexArray | None = None  # change of u over the last step of a moving punch
        self._velocity: ComplexArray | None = None
        self._last_step = self._largest_stress = self._largest_force = 0.0
        self._known: tuple[ComplexArray, ComplexArray] | None = None  # displacement and curvature of a step

    @property
    def shortest_time(self) -> float:
        """Shortest relevant relaxation time of the body."""
        return self._integrator.shortest_time

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b at the end of a step, with the curvature where it counts."""
        integrator, self._known = self._integrator, None
        stiffness, b = integrator.terms(step)
        if not self._curved or self._velocity is None:
            return stiffness, b
        return integrator.curved(self._ratio, self._velocity)

    def advance(self, spectrum: ComplexArray) -> None:
        """Advance the history over the step of the last `terms`, with the curvature that is now known."""
        integrator, velocity = self._integrator, None
        if integrator.step > 0:
            velocity = (integrator.parts(spectrum) - integrator.past) * (1 / integrator.step)
        integrator.advance(spectrum, self._curvature(spectrum))
        self._known = None
        if velocity is not None:
            self._velocity, self._last_step = velocity, integrator.step

    def discard_velocity(self) -> None:
        """Discard the velocity of the surface, which does not predict its displacement after a breakpoint."""
        self._velocity = None

    def deforms(self, spectrum: ComplexArray) -> bool:
        """Return whether a displacement is not zero."""
        return bool(self._sums.maximum(int(spectrum.any())))

    def error(
        self, spectrum: ComplexArray, *, moving: bool, deep: bool, attracted: bool = False
    ) -> tuple[float, float]:
        """Estimate the error of the step of the last `terms`, which ends with this transform of u."""
        # `moving`: the punch moves over the step; `deep`: its depth is comparable to the largest so far.
        # Returns the relative error of the mean pressure (at given load, of the depth; of the stress, where
        # the interface attracts) or of the tangential force; and the root mean square error of the
        # displacement.
        integrator, curvature = self._integrator, self._curvature(spectrum)
        if curvature is None:
            curvature = _UNKNOWN_CURVATURE * (integrator.parts(spectrum) - integrator.past)
        force, error = integrator.force(spectrum), integrator.missing_stress(spectrum, curvature)
        if moving:  # the change over a step that is then rejected serves as well
            self._contact_motion = spectrum - integrator.u
        weights, kappa = self._sums.weights, integrator.stiffness
        norm = self._sums.total(_stress_norm(weights, kappa, spectrum.view(np.float64)))
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
        square = _displacement_error(weights, kappa, error.view(np.float64), ratio, force.view(np.float64))
        relative = part if attracted else abs(ratio)
        if integrator.slope is not None:
            relative = max(relative, self._tangential_error(integrator.slope * spectrum, force, error))
        return relative, math.sqrt(self._sums.total(square))

    def _tangential_error(self, slope: ComplexArray, force: ComplexArray, error: ComplexArray) -> float:
        """Error of the tangential force, relative to the largest so far."""
        mean = self._sums.spectral_mean
        smallest = _SMALLEST_FORCE * math.sqrt(mean(slope, slope) * mean(force, force))
        self._largest_force = max(self._largest_force, smallest, abs(mean(slope, force)))
        off = abs(mean(slope, error))
        return off / self._largest_force if off > 0 else 0.0

    def state(self) -> State:
        """Return the history and the last motion of the surface."""
        motion = {"contact_motion": self._contact_motion, "velocity": self._velocity}
        scales = {"largest_stress": self._largest_stress, "largest_force": self._largest_force}
        return {
            **self._integrator.state(),
            **{name: value for name, value in motion.items() if value is not None},
            **{name: value for name, value in scales.items() if value},
            "last_step": self._last_step,
        }

    def restore(self, state: State) -> None:
        """Continue from a state."""
        self._integrator.restore(state)
        self._contact_motion, self._velocity = state.get("contact_motion"), state.get("velocity")
        self._last_step = float(state["last_step"])
        self._largest_stress = float(state.get("largest_stress", 0.0))
        self._largest_force = float(state.get("largest_force", 0.0))

    def _curvature(self, spectrum: ComplexArray) -> ComplexArray | None:
        """dt^2 u''/2 from the divided difference of the last three displacements, this one included."""
        if self._velocity is None:
            return None
        if self._known is not None and self._known[0] is spectrum:
            return self._known[1]
        now, past = self._integrator.parts(spectrum), self._integrator.past
        numbers = (each.view(np.float64) for each in (now, past, self._velocity))
        found = _curvature(self._ratio, self._integrator.step, *numbers).view(np.complex128)
        self._known = spectrum, found
        return found

    @property
    def _ratio(self) -> float:
        """Length of the step over the length of the last two."""
        return self._integrator.step / (self._integrator.step + self._last_step)


@kernel(reorder=True)
def _curvature(
    ratio: float, step: float, new_u: FloatArray, u: FloatArray, velocity: FloatArray
) -> FloatArray:
    """Return dt^2 u''/2 from the last velocity; the ratio is this step over the sum of the last two."""
    found = np.empty(u.size)
    for i in range(u.size):
        found[i] = ratio * (new_u[i] - u[i] - step * velocity[i])
    return found


@kernel(reorder=True)
def _stress_norm(weights: FloatArray, stiffness: FloatArray, u: FloatArray) -> float:
    """Mean square of stiffness u over the surface."""
    total = 0.0
    for k in range(stiffness.size):
        total += weights[k] * stiffness[k] ** 2 * (u[2 * k] ** 2 + u[2 * k + 1] ** 2)
    return total


@kernel(reorder=True)
def _displacement_error(
    weights: FloatArray, stiffness: FloatArray, error: FloatArray, ratio: float, force: FloatArray
) -> float:
    """Mean square of (error - ratio force)/stiffness over the surface, where the stiffness is not zero."""
    total = 0.0
    for k in range(stiffness.size):
        if stiffness[k] > 0.0:
            real, imaginary = error[2 * k] - ratio * force[2 * k], error[2 * k + 1] - ratio * force[2 * k + 1]
            total += weights[k] * (real * real + imaginary * imaginary) / stiffness[k] ** 2
    return total
