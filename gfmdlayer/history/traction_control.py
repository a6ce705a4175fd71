"""Error control of steps under tractions in all directions: `error_control` for modes of several components.

The history takes the displacements x = (W, u) as linear over a step. The curvature c = dt^2 x''/2 follows
from the last three accepted displacements, which are carried with the material. The history advances with it,
and the traction at the end of the step is too small by delta f = sum_j v_j curvature_gain_j v_j^H c.

Where the punch moves by the depth d and the path D, the change v of x over the step does the work

    <v, f> = p d + t.D        (means over the surface; and the heat of slip)

on the tractions f = (p, t), so that <v, delta f> over |d| p + |D| |t|, with the largest means so far, is the
relative error of pressure or tangential force. While the punch rests, v is the displacement itself, or the
last change in which the punch moved. The rest of delta f moves the free surface. Under an interface that
attracts, where the mean pressure goes through zero, <v, delta f>/|v| counts relative to the largest stress.

Slip makes the tractions depend on the path too. That error has nothing to do with relaxation, and is not
estimated: the programme bounds the steps where surfaces slip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.history.traction_modes import TractionModes
from gfmdlayer.resumable import State

_UNKNOWN_CURVATURE = 0.25  # part of a change that may be curvature, where no earlier displacement is known
_NO_CONTACT = 1e-10  # part of the product of norms below which a work is rounding


class TractionControl:
    """Controls the error of `TractionModes` with the exponential scheme and steps that vary in length.

    The tolerance is the largest error of pressure and tangential force relative to their largest values so
    far (of the depth, where the load is given), and of the displacement relative to the largest depth.
    """

    def __init__(self, modes: TractionModes, tolerance: float) -> None:
        self._modes, self.tolerance = modes, tolerance
        self._velocities: list[ComplexArray] | None = None  # of the waves over the last step
        self._motion: list[ComplexArray] | None = None  # change of them over the last step of a moving punch
        self._last_step = 0.0
        self._largest = np.zeros(2)  # mean pressure and mean shear traction
        self._largest_stress = 0.0
        self._moved = np.zeros(2)

    @property
    def shortest_time(self) -> float:
        """Shortest relevant relaxation time of the body."""
        return self._modes.shortest_time

    def moves(self, depth: float, path: float) -> None:
        """Take note of how far the punch moves in the step that is to be judged."""
        self._moved = np.abs(np.array([depth, path]))

    def advance(self, tractions: ComplexArray) -> None:
        """Advance the history over the step of the last `terms`, with the curvature that is now known."""
        modes, step = self._modes, self._modes.parts[0].step
        now, before = modes.under(modes.loads(tractions)), [part.begun for part in modes.parts]
        curvatures = self._curvatures(now)
        modes.advance(tractions, curvatures)
        if step > 0:
            self._velocities = [(x - x_0) / step for x, x_0 in zip(now, before, strict=True)]
            self._last_step = step
        self._largest = np.maximum(self._largest, self._sizes(tractions))

    def discard_velocity(self) -> None:
        """Discard the velocity of the surface, which does not predict its displacement after a breakpoint."""
        self._velocities = None

    def deforms(self, tractions: ComplexArray) -> bool:
        """Return whether there are tractions."""
        return bool(tractions.any())

    def error(
        self,
        tractions: ComplexArray,
        *,
        moving: bool,  # noqa: ARG002
        deep: bool,
        attracted: bool = False,
    ) -> tuple[float, float]:
        """Estimate the errors of forces and of the displacement, see `ErrorControl.error`."""
        modes, loads = self._modes, self._modes.loads(tractions)
        now = modes.under(loads)
        change = [x - part.begun for x, part in zip(now, modes.parts, strict=True)]
        curvatures = self._curvatures(now) or [_UNKNOWN_CURVATURE * each for each in change]
        missing = [part.curvature_stress(c) for part, c in zip(modes.parts, curvatures, strict=True)]
        largest = np.maximum(self._largest, self._sizes(tractions))
        if self._moved.any():
            self._motion = change
        squares = self._mean(loads, loads)
        self._largest_stress = max(self._largest_stress, math.sqrt(squares)) if attracted else 0.0
        ratio = part = 0.0
        for v, least in ((now if deep else None, 0.0), (self._motion, float(self._moved @ largest))):
            if v is None:
                continue
            if attracted:
                norm = math.sqrt(self._mean(v, v)) * self._largest_stress
                part = max(part, abs(self._mean(v, missing)) / norm if norm > 0 else 0.0)
                continue
            work = max(abs(self._mean(v, loads)), least)
            if work**2 > _NO_CONTACT**2 * self._mean(v, v) * squares:
                ratio = max(ratio, self._mean(v, missing) / work, key=abs)
        off = modes.moved([m - ratio * f for m, f in zip(missing, loads, strict=True)])
        return part if attracted else abs(ratio), math.sqrt(self._mean(off, off))

    def _sizes(self, tractions: ComplexArray) -> FloatArray:
        """Return the means of pressure and shear traction."""
        p, *shear = np.abs(tractions[:, 0]) / self._modes.size
        return np.array([p, math.hypot(*shear)])

    def _mean(self, one: Sequence[ComplexArray], other: Sequence[ComplexArray]) -> float:
        """Return the mean over the surface of the product of two fields of the waves."""
        products = sum((a.conj() * b).real.sum(axis=1) for a, b in zip(one, other, strict=True))
        return float(self._modes.weights @ products)

    def _curvatures(self, now: Sequence[ComplexArray]) -> list[ComplexArray] | None:
        """dt^2 x''/2 from the divided difference of the last three displacements, these included."""
        if self._velocities is None:
            return None
        modes, step = self._modes, self._modes.parts[0].step
        ratio, found = step / (step + self._last_step), []
        for x, v, part in zip(now, self._velocities, modes.parts, strict=True):
            carried = v if modes.phases is None else v * modes.phases[:, np.newaxis]
            found.append(ratio * (x - part.begun - step * carried))
        return found

    def state(self) -> State:
        """Return the history and the last motion of the surface."""
        held: dict[str, ComplexArray] = {}
        for name, parts in (("velocity", self._velocities), ("motion", self._motion)):
            held |= {f"{name}_{i}": each for i, each in enumerate(parts or ())}
        largest = {"largest": self._largest, "largest_stress": self._largest_stress}
        return {**self._modes.state(), **held, "last_step": self._last_step, **largest}

    def restore(self, state: State) -> None:
        """Continue from a state."""
        self._modes.restore({name: value for name, value in state.items() if "." in name})
        every = range(len(self._modes.parts))
        velocities, motion = (
            [state[f"{name}_{i}"] for i in every] if f"{name}_0" in state else None
            for name in ("velocity", "motion")
        )
        self._velocities, self._motion = velocities, motion
        self._last_step, self._largest = float(state["last_step"]), np.asarray(state["largest"])
        self._largest_stress = float(state["largest_stress"])
