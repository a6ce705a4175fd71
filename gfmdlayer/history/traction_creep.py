"""The history of a surface by its tractions, where no relaxing modes exist: contacts without images.

With C(s) = c_0 + sum_k c_k/(1 + s T_k) of `friction.isolated` the displacements under tractions x are

    (W, u) = (c_0 + sum_k c_k) x - sum_k c_k y_k,        d y_k/dt + y_k/T_k = dx/dt,

with the lag y_k of the tractions. It is the stretch of a relaxing mode with x in place of the displacement
(`modes`): so a step has the same factors, and at its end

    C = c_0 + sum_k (1 - gain_k) c_k,        offset = sum_k c_k (gain_k x_0 - decay_k y_k).

The elements are in series. Of the tractions z_k = x - y_k that have come through, the stored energy is half
of x c_0 x + sum_k z_k c_k z_k, and the heat that of `modes` with c_k in place of w_j. Coefficients c_k of any
sign have right sums of both, as these depend on the creep function alone (Staverman and Schwarzl, Proc.
Kon. Ned. Akad. Wet. B 55 (1952) 474).

Under a contact that moves along x the tractions of the past, their lags and the displacements move with the
material, by whole spacings: beyond half of the cell the displacements are not those of the surface, and have
a jump, which no phase moves by less. A lag that has left this half acts on the contact from a wrong distance
until it has decayed.

All are transforms (p, t_x[, t_y]), of shape (1 + axes, modes). `ErrorControl` sees tractions here in place of
displacements, and displacements in place of tractions: the work of the one on the other is the same.
"""

from __future__ import annotations

import math

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.friction.isolated import IsolatedResponse
from gfmdlayer.friction.response import CroppedResponse
from gfmdlayer.grid.grid import Grid
from gfmdlayer.history.modes import Factors, Scheme, exponential
from gfmdlayer.resumable import Saving


class TractionCreep(Saving):
    """The history of a surface without images: displacements (W, u_x[, u_y]) = C tractions + offset."""

    KEPT = ("past", "lag", "shift", "stored", "dissipated")
    slope = None  # of the surface: the tangential force follows from tractions

    def __init__(
        self,
        grid: Grid,
        response: IsolatedResponse,
        scheme: Scheme = exponential,
        velocity: float = 0.0,
    ) -> None:
        # `velocity` of the contact along x at the end of the run serves `slowest`.
        self._passage = grid.period[0] / abs(velocity) if velocity else 0.0
        self._of, self._scheme, self.step, self.ranks = response, scheme, math.nan, grid.ranks
        self._shape = 1 + len(grid.points), math.prod(grid.spectral_shape)
        self.past = np.zeros(self._shape, dtype=np.complex128).ravel()  # tractions at the beginning of a step
        self._shift = np.zeros(self._shape, dtype=np.complex128)  # displacements then
        self._q = np.broadcast_to(grid.wavevectors[0], grid.spectral_shape).ravel()
        self.phases: ComplexArray | None = None
        self._lag = np.zeros((response.times.size, *self._shape), dtype=np.complex128)
        self._parts = np.stack([part.reshape(len(part), -1) for part in response.parts])
        self.weights = np.tile(np.ravel(grid.parseval_weights), self._shape[0])
        self._response: CroppedResponse | None = None
        self.stored = self.dissipated = 0.0

    @property
    def u(self) -> ComplexArray:
        """Tractions at the beginning of the next step, in the words of `ErrorControl`."""
        return self.past

    @property
    def displacement(self) -> ComplexArray:
        """Transforms of W, u_x[, u_y] at the beginning of the next step, carried with the material."""
        return self.carried(self._shift)

    @property
    def shortest_time(self) -> float:
        """Shortest time of creep; infinite for an elastic body."""
        return float(self._of.times.min(initial=math.inf))

    def terms(self, step: float) -> tuple[CroppedResponse, ComplexArray]:
        """Return the response to tractions at the end of a step, and the displacements without tractions."""
        if self._response is None or step != self.step:
            # The response is the same object for steps of equal length.
            self.step, self._factors = step, self._scheme(step / self._of.times)
            self._response = self._of.with_weights(1 - self._factors.gain)
        f, past, self._offset = self._factors, self._begun, np.zeros_like(self._shift)
        for k, lag in enumerate(map(self.carried, self._lag)):
            self._offset += self._moved(self._parts[:, 1 + k], f.gain[k] * past - f.decay[k] * lag)
        return self._response, self._offset

    def carry(self, distance: float, *across: float) -> None:
        """Move the contact along x in the next step: a point at x + distance is then at x."""
        assert not any(across)
        self.phases = np.exp(1j * distance * self._q) if distance else None

    def carried(self, spectrum: ComplexArray) -> ComplexArray:
        """Return a transform as it is carried with the material in the next step."""
        return spectrum if self.phases is None else spectrum * self.phases

    @property
    def _begun(self) -> ComplexArray:
        """Tractions at the beginning of the next step, carried with the material."""
        return self.carried(self.past.reshape(self._shape))

    def slowest(self, tolerance: float) -> float:
        """Return the longest time on the way to the steady state: of a passage of the cell, or of creep."""
        size = self.ranks.maximum(np.abs(self._parts).max(axis=(0, 2)))
        size = size[1:] / size.max()
        return max(self._passage, float(self._of.times[size > tolerance].max(initial=0.0)))

    def settled(self, step: float, way: float) -> CroppedResponse:
        """Return the response in the steady state, which each step carries over a way along x."""
        # A lag is then y = decay phase y + gain (1 - phase) x.
        self.step, self._factors, self._response = step, self._scheme(step / self._of.times), None
        self.carry(way)
        f, phase = self._factors, np.exp(1j * way * self._q)
        self._settled = f.gain[:, np.newaxis] * (1 - phase) / (1 - f.decay[:, np.newaxis] * phase)
        return self._of.with_weights(1 - self._settled)

    def under_settled(self, tractions: ComplexArray) -> ComplexArray:
        """Return the tractions of that state as one array."""
        return tractions.ravel()

    def settle(self, x: ComplexArray) -> None:
        """Begin the next step in that state, with these tractions."""
        self.past[:] = x
        self._lag[:] = self._settled[:, np.newaxis] * x.reshape(self._shape)
        self._shift[:] = self.seen(x)
        self.terms(self.step)

    def seen(self, x: ComplexArray) -> ComplexArray:
        """Return the transforms of W, u_x[, u_y] under the tractions of that state."""
        own = x.reshape(self._shape)
        moved = self._moved(self._parts[:, 0], own)
        for k, weights in enumerate(1 - self._settled):
            moved += self._moved(self._parts[:, 1 + k], weights * own)
        return moved

    def under(self, tractions: ComplexArray) -> ComplexArray:
        """Return the tractions of a step as one array."""
        return tractions.ravel()

    def parts(self, x: ComplexArray) -> ComplexArray:
        """Return the tractions themselves: there is one body."""
        return x

    carried_waves = parts

    def resistance(self, x: ComplexArray) -> ComplexArray:
        """Return C x, the displacements of a surface without a past."""
        assert self._response is not None
        own = np.stack([np.ravel(part) for part in self._response.parts])
        return self._moved(own, x.reshape(self._shape)).ravel()

    def force(self, x: ComplexArray) -> ComplexArray:
        """Return the displacements at the end of the step of the last `terms`."""
        return self.resistance(x) + self._offset.ravel()

    def missing_stress(self, x: ComplexArray, curvature: ComplexArray) -> ComplexArray:  # noqa: ARG002
        """Return the part of the displacements that is due to the curvature dt^2 x''/2."""
        weights, bent = self._factors.curvature_gain, curvature.reshape(self._shape)
        return -self._moved(np.tensordot(self._parts[:, 1:], weights, (1, 0)), bent).ravel()

    def response_to(self, displacements: ComplexArray) -> ComplexArray:
        """Return displacements themselves: the free surface is in error by what is missing."""
        return displacements

    def advance(self, x: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Advance the history over the step of the last `terms` to the tractions x."""
        self._shift[:] = self.force(x).reshape(self._shape)
        f, new = self._factors, x.reshape(self._shape)
        change = new - self._begun
        bent = np.zeros_like(new) if curvature is None else curvature.reshape(self._shape)
        twice = self._product(0, new, new)
        for k, lag in enumerate(self._lag):
            before = self.carried(lag.copy())
            after = f.decay[k] * before + f.gain[k] * change
            lag[:] = after + f.curvature_gain[k] * bent
            twice += self._product(1 + k, new - lag, new - lag)
            self.dissipated += self._heat(k, f, before, after, change, bent)
        self.stored = twice / 2
        self.past[:], self.phases = x, None

    def _heat(
        self,
        k: int,
        f: Factors,
        before: ComplexArray,
        after: ComplexArray,
        change: ComplexArray,
        bent: ComplexArray,
    ) -> float:
        """Return the heat of an element in a step, see `modes`."""
        ahead = before + f.lead[k] * change
        heat = float(f.loss[k]) * self._product(1 + k, ahead, ahead)
        heat += float(f.remainder[k]) * self._product(1 + k, change, change)
        if bent.any():
            heat += float(f.curvature_loss[k]) * self._product(1 + k, bent, bent)
            heat -= float(f.curvature_gain[k]) * self._product(1 + k, before + after, bent)
        return heat

    def _product(self, k: int, x: ComplexArray, y: ComplexArray) -> float:
        """Return the mean of x c_k y over the surface."""
        of_waves = (self._moved(self._parts[:, k], x).ravel() * y.ravel().conj()).real
        return self.ranks.total(float(self.weights @ of_waves))

    def _moved(self, parts: FloatArray, x: ComplexArray) -> ComplexArray:
        """Return the displacements under tractions, by the parts of a response, (components, modes)."""
        if len(x) == 2:
            normal, coupling, along = parts
            p, t = x
            return np.stack((normal * p - 1j * (coupling * t), 1j * (coupling * p) + along * t))
        normal, of_x, of_y, xx, xy, yy = parts
        p, tx, ty = x
        W = normal * p - 1j * (of_x * tx + of_y * ty)
        return np.stack((W, 1j * (of_x * p) + xx * tx + xy * ty, 1j * (of_y * p) + xy * tx + yy * ty))
