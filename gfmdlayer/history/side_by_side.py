"""Two deformable bodies: their histories side by side, under the pressure that they share.

At the end of a step each body obeys sigma = -kappa_i u_i + b_i of its own modes, and u = u_1 + u_2. So

    sigma = -kappa u + b,    kappa = s_1 kappa_1 = s_2 kappa_2,    b = s_1 b_1 + s_2 b_2
    u_1 = s_1 u + d,    u_2 = s_2 u - d,    s_1 = kappa_2/(kappa_1 + kappa_2)
    d = (b_1 - b_2)/(kappa_1 + kappa_2)

and each history advances with its own u_i. It keeps its own modes, energies and velocity: where two bodies
that relax slide on each other, the compliances 1/K_1(s + i q v_1) + 1/K_2(s + i q v_2) have no positive modes
in common. With backward Euler the step is that of the modes of `body.pair`, to rounding. The exponential
scheme takes each u_i as linear over the step in place of u, which differs in the second order.

A body that holds its mean, kappa_i = 0 at q = 0, adds no compliance there: s_i = 0.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.modes import Modes
from gfmdlayer.kernels import kernel
from gfmdlayer.resumable import CompositeState, State


class Division(NamedTuple):
    """How two bodies divide the displacement: arrays over the waves, complex where a body has a loss."""

    one: Any  # s_1
    two: Any
    compliance: Any  # 1/(kappa_1 + kappa_2), 0 where a body holds its displacement
    stiffness: Any  # kappa


@kernel
def _divide(one: Any, two: Any) -> Division:
    """Divide between the stiffnesses of two bodies."""
    first, second, compliance, stiffness = (
        np.empty_like(one),
        np.empty_like(one),
        np.zeros_like(one),
        np.zeros_like(one),
    )
    for i in range(one.size):
        first[i], second[i] = 0.0 if one[i] == 0 else 1.0, 1.0 if one[i] == 0 else 0.0
        if one[i] != 0 and two[i] != 0:
            compliance[i] = 1.0 / (one[i] + two[i])
            first[i], second[i] = two[i] * compliance[i], one[i] * compliance[i]
        # The softer body has the larger part, and loses no digits.
        stiffness[i] = first[i] * one[i] if abs(first[i]) > abs(second[i]) else second[i] * two[i]
    return Division(first, second, compliance, stiffness)


@kernel(reorder=True)
def _shared(division: Division, one: ComplexArray, two: ComplexArray) -> ComplexArray:
    """Return s_1 one + s_2 two, of stresses that each body has at rest."""
    stress = np.empty_like(one)
    for i in range(one.size):
        stress[i] = division.one[i] * one[i] + division.two[i] * two[i]
    return stress


@kernel(reorder=True)
def _divided(division: Division, one: ComplexArray, two: ComplexArray, u: ComplexArray) -> ComplexArray:
    """Return u_1 and u_2, (2 nq,), from b_1, b_2 and u."""
    displacements = np.empty(2 * u.size, dtype=np.complex128)
    for i in range(u.size):
        apart = division.compliance[i] * (one[i] - two[i])
        displacements[i] = division.one[i] * u[i] + apart
        displacements[u.size + i] = division.two[i] * u[i] - apart
    return displacements


@kernel(reorder=True)
def _force(stiffness: FloatArray, u: ComplexArray, b: ComplexArray) -> ComplexArray:
    stress = np.empty_like(u)
    for i in range(u.size):
        stress[i] = stiffness[i] * u[i] - b[i]
    return stress


def _halves(both: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the arrays of both bodies."""
    return both[: both.size // 2], both[both.size // 2 :]


class SideBySide:
    """The histories of a body and its counterbody as one integrator; see `adaptive_steps.Integrator`."""

    def __init__(self, bodies: tuple[Modes, Modes], sums: Sums, ratio: float = 0.0) -> None:
        # `ratio` is the velocity of the contact along the counterbody over the one along the body.
        self.bodies, self._sums, self._ratio = bodies, sums, ratio
        self.spectrum_error = max(body.spectrum_error for body in bodies)
        self.shortest_time = min(body.shortest_time for body in bodies)
        self.slope = next((body.slope for body in bodies if body.slope is not None), None)
        self._history = CompositeState(body=bodies[0], counterbody=bodies[1])
        self.past = np.concatenate([body.u for body in bodies])  # displacements after the last step, (2 nq,)
        for body, part in zip(bodies, _halves(self.past), strict=True):
            body.u = part  # advances in place
        self._stiffness: tuple[FloatArray, ...] = ()
        self._split: tuple[ComplexArray, ComplexArray] | None = None
        self.step, self.loss_stiffness = np.nan, cast("FloatArray | None", None)
        self._add()

    def _add(self) -> None:
        """Add displacements and energies of both bodies."""
        one, two = self.bodies
        self.u = one.u + two.u
        self.stored, self.dissipated = one.stored + two.stored, one.dissipated + two.dissipated

    @property
    def carried(self) -> ComplexArray:
        """The displacement on whose slope the pressure does work as the contact moves along x."""
        one, two = self.bodies
        return np.asarray(one.u + self._ratio * two.u) if self._ratio else one.u

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b at the end of a step of this length."""
        terms = [body.terms(step) for body in self.bodies]
        self.step = self.bodies[0].step
        stiffness = tuple(kappa for kappa, _ in terms)
        if not self._stiffness or any(a is not b for a, b in zip(stiffness, self._stiffness, strict=True)):
            self._stiffness = stiffness
            lossy = [body.loss_stiffness for body in self.bodies]
            moves = any(loss is not None for loss in lossy)
            if moves:
                nothing = np.zeros(self.u.size)
                losses = [nothing if loss is None else loss for loss in lossy]
                stiffness = tuple(k + 1j * loss for k, loss in zip(stiffness, losses, strict=True))
            self._division = _divide(*stiffness)
            kappa = self._division.stiffness
            self.stiffness, self.loss_stiffness = (
                (kappa.real.copy(), kappa.imag.copy()) if moves else (kappa, None)
            )
        self._b = self._taken(self._division, *(b for _, b in terms))
        return self.stiffness, self._b

    def curved(self, ratio: float, velocity: ComplexArray) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b with the curvature of each displacement, see `Modes.curved`."""
        own = zip(self.bodies, _halves(velocity), strict=True)
        (one, b1), (two, b2) = (body.curved(ratio, part) for body, part in own)
        division = _divide(one, two)
        return division.stiffness, self._taken(division, b1, b2)

    def _taken(self, *terms: Any) -> ComplexArray:
        """Return b from division and intercepts, and keep these: they divide the displacement."""
        self._split, self._terms = None, terms
        b: ComplexArray = _shared(*terms)
        return b

    def parts(self, spectrum: ComplexArray) -> ComplexArray:
        """Return the displacements of both bodies at the end of the step, (2 nq,)."""
        if self._split is None or self._split[0] is not spectrum:
            division, b1, b2 = self._terms
            self._split = spectrum, _divided(division, b1, b2, spectrum)
        return self._split[1]

    def force(self, spectrum: ComplexArray) -> ComplexArray:
        """Return -sigma at the end of the step of the last `terms`, for a displacement."""
        stress: ComplexArray = _force(self._division.stiffness, spectrum, self._b)
        return stress

    def curvature_stress(self, curvature: ComplexArray) -> ComplexArray:
        """Return the part of -sigma that is due to the curvatures of both bodies, (2 nq,)."""
        own = zip(self.bodies, _halves(curvature), strict=True)
        stress: ComplexArray = _shared(self._division, *(body.curvature_stress(part) for body, part in own))
        return stress

    def missing_stress(self, spectrum: ComplexArray, curvature: ComplexArray) -> ComplexArray:
        """Return the part of -sigma that `force` leaves out; curvatures of both bodies, (2 nq,)."""
        own = zip(self.bodies, _halves(self.parts(spectrum)), _halves(curvature), strict=True)
        stress: ComplexArray = _shared(self._division, *(body.missing_stress(u, c) for body, u, c in own))
        return stress

    def advance(self, spectrum: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Advance both histories over the step of the last `terms`."""
        curvatures = (None, None) if curvature is None else _halves(curvature)
        own = zip(self.bodies, _halves(self.parts(spectrum)), curvatures, strict=True)
        for body, u, c in own:
            body.advance(u, c)
        self._split = None
        self._add()

    def slowest(self, tolerance: float) -> float:
        """Return the longest time on the way to the steady state, see `SlidingModes.slowest`."""
        return max(body.slowest(tolerance) for body in self.bodies)

    def state(self) -> State:
        """Return both histories."""
        return self._history.state()

    def restore(self, state: State) -> None:
        """Continue from a state."""
        self._history.restore(state)
        self._add()
