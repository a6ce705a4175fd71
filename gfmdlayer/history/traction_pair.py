"""Two deformable bodies in contact with friction: histories side by side, under tractions that they share.

The body feels the pressure p and the shear traction t, the counterbody above it, mirrored, p and -t. The gap
follows from the sum of both normal displacements, slip from the difference of those along the surface:

    W = W_1 + W_2,    u = u_1 - u_2,    C = C_1 + J C_2 J,    J = diag(1, -1, -1) on (p, t) and (W, u),

so that the coupling of equal bodies vanishes (K. L. Johnson, Contact Mechanics (1985), Sec. 5.4 and 7.2).
Each history has its own tractions and displacements, and is carried with its own material: `ratio` is the
velocity of the contact along the counterbody over the one along the body.

The waves of both bodies stand in one array, those of the body first: `ErrorControl` sees a surface with twice
as many, whose tractions do the work of both.
"""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import ComplexArray
from gfmdlayer.friction.response import Response
from gfmdlayer.history.traction_modes import TractionModes
from gfmdlayer.resumable import CompositeState, State


class TractionPair:
    """The histories of a body and its counterbody as one: (W, u_x[, u_y]) = C tractions + offset."""

    slope = None  # of the surface: the tangential force follows from tractions

    def __init__(self, bodies: tuple[TractionModes, TractionModes], ratio: float) -> None:
        self.bodies, self.ratio, self.ranks = bodies, ratio, bodies[0].ranks
        self.weights = np.concatenate([body.weights for body in bodies])
        self._known: tuple[Response, Response, Response] | None = None
        self._history = CompositeState(body=bodies[0], counterbody=bodies[1])

    @property
    def stored(self) -> float:
        """Elastic energy per area of both bodies after the last step."""
        return sum(body.stored for body in self.bodies)

    @property
    def dissipated(self) -> float:
        """Heat of relaxation per area of both bodies since the start."""
        return sum(body.dissipated for body in self.bodies)

    @property
    def shortest_time(self) -> float:
        """Shortest relevant relaxation time; infinite for elastic bodies."""
        return min(body.shortest_time for body in self.bodies)

    @property
    def step(self) -> float:
        """Length of the last step."""
        return self.bodies[0].step

    @property
    def past(self) -> ComplexArray:
        """Displacements of the waves at the beginning of the next step, each carried with its material."""
        return np.concatenate([body.past for body in self.bodies])

    u = past

    def parts(self, x: ComplexArray) -> ComplexArray:
        """Return the displacements themselves: they are those of both bodies."""
        return x

    @property
    def displacement(self) -> ComplexArray:
        """Transforms of W, u_x[, u_y] at the beginning of the next step, each carried with its material."""
        return _between(*(body.displacement for body in self.bodies))

    def moving(self) -> ComplexArray:
        """Return the transforms of W, u_x[, u_y] on whose slopes tractions do work as the contact moves."""
        one, two = (body.displacement for body in self.bodies)
        return _between(one, self.ratio * two)

    def displacements(self) -> list[ComplexArray]:
        """Return the transforms of the normal displacement of each body after the last step."""
        return [body.displacement[0] for body in self.bodies]

    def carry(self, distance: float, *across: float) -> None:
        """Move the contact along both surfaces in the next step, see `TractionModes.carry`."""
        one, two = self.bodies
        one.carry(distance, *across)
        two.carry(self.ratio * distance, *across)

    def terms(self, step: float) -> tuple[Response, ComplexArray]:
        """Return the response to tractions at the end of a step, and the displacements without tractions."""
        (one, first), (two, second) = (body.terms(step) for body in self.bodies)
        return self._together(one, two), _between(first, second)

    def settled(self, step: float, way: float) -> Response:
        """Return the response in the steady state, which each step carries over a way along x."""
        one, two = self.bodies
        return self._together(one.settled(step, way), two.settled(step, self.ratio * way))

    def under_settled(self, tractions: ComplexArray) -> ComplexArray:
        """Return the displacements of the waves in that state."""
        return self._each("under_settled", _on_each(tractions))

    def settle(self, x: ComplexArray) -> None:
        """Begin the next step in that state, with displacements of the waves."""
        for body, u in zip(self.bodies, self._split(x), strict=True):
            body.settle(u)

    def seen(self, x: ComplexArray) -> ComplexArray:
        """Return the transforms of W, u_x[, u_y] of displacements of the waves."""
        one, two = (body.seen(u) for body, u in zip(self.bodies, self._split(x), strict=True))
        return _between(one, two)

    def under(self, tractions: ComplexArray) -> ComplexArray:
        """Return the displacements of the waves at the end of the step of the last `terms`."""
        return self._each("under", _on_each(tractions))

    def force(self, x: ComplexArray) -> ComplexArray:
        """Return the tractions on the waves at the end of the step of the last `terms`."""
        return self._each("force", self._split(x))

    def resistance(self, x: ComplexArray) -> ComplexArray:
        """Return the tractions on surfaces without a past."""
        return self._each("resistance", self._split(x))

    def missing_stress(self, x: ComplexArray, curvature: ComplexArray) -> ComplexArray:
        """Return the part of the tractions that is due to the curvature dt^2 x''/2."""
        return self._each("missing_stress", self._split(x), self._split(curvature))

    def response_to(self, loads: ComplexArray) -> ComplexArray:
        """Return the displacements of the waves under tractions on them."""
        return self._each("response_to", self._split(loads))

    def carried_waves(self, x: ComplexArray) -> ComplexArray:
        """Return values of the waves as they are carried with the materials in the next step."""
        return self._each("carried_waves", self._split(x))

    def advance(self, x: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Advance both histories over the step of the last `terms` to displacements of the waves."""
        bent = (None, None) if curvature is None else self._split(curvature)
        for body, u, c in zip(self.bodies, self._split(x), bent, strict=True):
            body.advance(u, c)

    def slowest(self, tolerance: float) -> float:
        """Return the longest time on the way to the steady state, see `SlidingModes.slowest`."""
        return max(body.slowest(tolerance) for body in self.bodies)

    def state(self) -> State:
        """Return both histories."""
        return self._history.state()

    def restore(self, state: State) -> None:
        """Continue from a state."""
        self._history.restore(state)

    def _together(self, one: Response, two: Response) -> Response:
        """Return the response of both bodies: the same object for the same two."""
        if self._known is None or self._known[0] is not one or self._known[1] is not two:
            self._known = one, two, one.beside(two)
        return self._known[2]

    def _split(self, x: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return the values of the waves of each body."""
        count = self.bodies[0].weights.size
        return x[:count], x[count:]

    def _each(self, method: str, *values: tuple[ComplexArray, ComplexArray]) -> ComplexArray:
        """Return what a method of both histories returns for the values of each."""
        own = zip(self.bodies, *values, strict=True)
        return np.concatenate([getattr(body, method)(*each) for body, *each in own])


def _between(one: ComplexArray, two: ComplexArray) -> ComplexArray:
    """Return W_1 + W_2 and u_1 - u_2."""
    return np.concatenate((one[:1] + two[:1], one[1:] - two[1:]))


def _on_each(tractions: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the tractions on the body and on the counterbody."""
    return tractions, np.concatenate((tractions[:1], -tractions[1:]))
