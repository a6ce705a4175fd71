"""The history of a surface under tractions in all directions: relaxing modes of several components.

With K(s) = K_0 + sum_j v_j v_j^H s theta_j/(1 + s theta_j) of `VectorSpectrum` each mode j is a unit spring
in series with a dashpot theta_j, and the displacements x of the surface stretch both by v_j^H x. The stretch
y_j of the spring is the internal variable, one number a mode and wave:

    d y_j/dt + y_j/theta_j = v_j^H dx/dt,        traction = K_0 x + sum_j v_j y_j.

Each stretch changes and each dashpot heats in a step as in `modes`, with v_j^H x in place of u and w_j = 1.
At the end of the step traction = kappa x - b, with the matrix and the vector

    kappa = K_0 + sum_j gain_j v_j v_j^H,        b = sum_j v_j (gain_j v_j^H x_0 - decay_j y_j).

Per wavevector of unit vector n the surface moves by W into the body, by i U n along n and by V across it:
(W, U) have modes of two components, V of one. On a line there is no V.

At the largest wavenumber of an even axis +q and -q share a mode of the grid. Each has its own history, and
half of the traction; the displacement of the grid is the sum of both. So fields that are odd along the axis
vanish at the points, as in `friction.response`, and yet relax.

The displacements x of all waves stand in one array, (W, U) of each wave and then V of each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.relaxation import TractionSpectrum, VectorSpectrum
from gfmdlayer.friction.response import Response
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.history.modes import RELEVANT, Factors, Scheme, exponential
from gfmdlayer.kernels import kernel
from gfmdlayer.resumable import CompositeState, Saving

_NYQUIST = 1 - 1e-9  # part of the largest wavenumber of an axis, for rounding


class VectorModes(Saving):
    """Relaxing modes of n components at waves; `weights` of these in a mean over the surface.

    Energies and times are those of the waves of all `ranks`.
    """

    KEPT = ("x", "stretch", "stored", "dissipated")

    def __init__(
        self,
        spectrum: VectorSpectrum,
        scheme: Scheme = exponential,
        weights: FloatArray | None = None,
        ranks: Ranks = ALONE,
    ) -> None:
        self.spectrum, self._scheme, self._ranks = spectrum, scheme, ranks
        count, components = spectrum.relaxed.shape[:2]
        self._weights = np.ones(count) if weights is None else weights
        self.step = math.nan
        self.x = np.zeros((count, components), dtype=np.complex128)
        self._stretch = np.zeros(spectrum.times.shape, dtype=np.complex128)
        self._phases = np.ones(count, dtype=np.complex128)
        self.stored = self.dissipated = 0.0

    @property
    def shortest_time(self) -> float:
        """Shortest relevant relaxation time; infinite for an elastic body."""
        glassy = np.trace(self.spectrum.glassy, axis1=-2, axis2=-1).real
        relevant = (np.abs(self.spectrum.vectors) ** 2).sum(axis=-1) > RELEVANT * glassy
        return self._ranks.minimum(float(self.spectrum.times[relevant].min(initial=math.inf)))

    def terms(self, step: float) -> tuple[NDArray[Any], ComplexArray]:
        """Return kappa, (nq, n, n), and b, (nq, n), at the end of a step."""
        self._prepare(step)
        return self.stiffness, self._pull(self._factors.gain, self.begun, self._factors.decay)

    def settled(self, step: float) -> ComplexArray:
        """Return the stiffness, (nq, n, n), of waves that each step turns by the phases of `turn`."""
        # A stretch is then y = decay phase y + gain (1 - phase) v^H x.
        self._prepare(step)
        phase, f = self._phases, self._factors
        self._settled = f.gain * (1 - phase) / (1 - f.decay * phase)
        stiffness = self.spectrum.relaxed.astype(np.complex128)
        _stiffen(self.spectrum.vectors, self._settled, stiffness)
        return stiffness

    def settle(self, x: ComplexArray) -> None:
        """Begin the next step in the state that the last `settled` repeats, with displacements x."""
        self.x = x.copy()
        self._stretch = self._settled * np.einsum("jqa,qa->jq", self.spectrum.vectors.conj(), x)

    def slowest(self, tolerance: float) -> float:
        """Return a bound on the time in which a body at rest creeps, see `Modes.slowest`."""
        relaxed, glassy = self.spectrum.relaxed, self.spectrum.glassy
        of_modes = (np.abs(self.spectrum.vectors) ** 2).sum(axis=-1)
        relevant = of_modes > tolerance * np.trace(glassy, axis1=-2, axis2=-1).real
        longest = self.spectrum.times[relevant].max(initial=0.0)
        some = np.linalg.det(relaxed).real > 0
        contrast = np.linalg.eigvals(np.linalg.solve(relaxed[some], glassy[some])).real.max(initial=1.0)
        return float(self._ranks.maximum(np.array([contrast, longest])).prod())

    def curvature_stress(self, curvature: ComplexArray) -> ComplexArray:
        """Return the part of the traction at the end of the step that is due to dt^2 x''/2."""
        return self._pull(self._factors.curvature_gain, curvature, None)

    def advance(self, x: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Advance the history over the step of the last `terms` to the displacements x, (nq, n)."""
        bent = np.zeros_like(x) if curvature is None else curvature
        stored, heat = _advance(
            self.spectrum.vectors, self._factors, x - self.begun, bent, self._phases, self._stretch
        )
        self.x, self._phases = x.copy(), np.ones_like(self._phases)
        elastic = np.einsum("qa,qab,qb->q", x.conj(), self.spectrum.relaxed, x).real
        of_waves = np.array([self._weights @ (elastic + stored), self._weights @ heat])
        twice, more = self._ranks.total(of_waves).tolist()
        self.stored, self.dissipated = twice / 2, self.dissipated + more

    def turn(self, phases: ComplexArray | None) -> None:
        """Multiply displacements and stretches by phases of the waves: the material moves in the step."""
        self._phases = np.ones_like(self._phases) if phases is None else phases

    @property
    def stretches(self) -> ComplexArray:
        """Stretches of the modes after the last step, (modes, nq)."""
        return self._stretch

    @property
    def begun(self) -> ComplexArray:
        """Displacements at the beginning of the next step."""
        return self.x * self._phases[:, np.newaxis]

    def _prepare(self, step: float) -> None:
        """Compute the stiffness and the factors for the length of a step."""
        if step == self.step:
            return
        self.step, times, v = step, self.spectrum.times, self.spectrum.vectors
        self._factors = Factors(
            *(factor.reshape(times.shape) for factor in self._scheme(step / times.ravel()))
        )
        self.stiffness = self.spectrum.relaxed.copy()
        _stiffen(v, self._factors.gain, self.stiffness)

    def _pull(self, gain: FloatArray, x: ComplexArray, decay: FloatArray | None) -> ComplexArray:
        """Return sum_j v_j (gain_j v_j^H x - decay_j y_j), (nq, n); the second term with a decay."""
        total, past = np.zeros_like(self.x), decay is not None
        factors = gain, gain if decay is None else decay
        _pull(self.spectrum.vectors, *factors, x, self._stretch, self._phases, past, total)
        return total


class TractionModes:
    """The history of a surface: displacements (W, u_x[, u_y]) = C tractions (p, t_x[, t_y]) + offset."""

    slope = None  # of the surface: the tangential force follows from tractions

    def __init__(
        self,
        grid: Grid,
        spectrum: TractionSpectrum,
        scheme: Scheme = exponential,
        velocity: float = 0.0,
    ) -> None:
        # All are transforms, (1 + axes, modes). stored + dissipated is the work per area. `velocity` of the
        # contact along x at the end of the run serves `slowest`.
        self._velocity = velocity
        self._grid, self._axes, self.ranks = grid, len(grid.points), grid.ranks
        self._waves = TractionWaves(grid)
        self._vectors, self._mode = self._waves.vectors, self._waves.mode
        self._share, self._along = self._waves.share, self._waves.along
        weights = np.ravel(grid.parseval_weights)[self._mode] / self._share
        parts = [spectrum.in_plane, VectorSpectrum.of(spectrum.across)]
        every = [_at(each, self._mode) for each in parts[: self._axes]]
        self.components = [VectorModes(each, scheme, weights, grid.ranks) for each in every]
        self.weights = np.concatenate([np.repeat(weights, n) for n in (2, 1)[: self._axes]])
        self.phases: ComplexArray | None = None
        self._response: Response | None = None
        history = CompositeState(**dict(zip(("in_plane", "across"), self.components, strict=False)))
        self.state, self.restore = history.state, history.restore

    @property
    def stored(self) -> float:
        """Elastic energy per area after the last step."""
        return sum(part.stored for part in self.components)

    @property
    def dissipated(self) -> float:
        """Heat of relaxation per area since the start."""
        return sum(part.dissipated for part in self.components)

    @property
    def shortest_time(self) -> float:
        """Shortest relevant relaxation time; infinite for an elastic body."""
        return min(part.shortest_time for part in self.components)

    @property
    def step(self) -> float:
        """Length of the last step."""
        return self.components[0].step

    @property
    def past(self) -> ComplexArray:
        """Displacements of the waves at the beginning of the next step, carried with the material."""
        return _joined([part.begun for part in self.components])

    u = past  # there is one body

    def parts(self, x: ComplexArray) -> ComplexArray:
        """Return the displacements themselves: there is one body."""
        return x

    @property
    def displacement(self) -> ComplexArray:
        """Transforms of W, u_x[, u_y] at the beginning of the next step, carried with the material."""
        return self._seen([part.begun for part in self.components])

    def terms(self, step: float) -> tuple[Response, ComplexArray]:
        """Return the response to tractions at the end of a step, and the displacements without tractions."""
        # The response is the same object for steps of equal length.
        known = self._response is not None and step == self.components[0].step
        terms = [part.terms(step) for part in self.components]
        if not known:
            count, shape = math.prod(self._grid.spectral_shape), self._grid.spectral_shape
            in_plane, across = (kappa[:count] for kappa, _ in (terms[0], terms[-1]))
            self._response = Response.of_stiffness(
                in_plane.reshape(*shape, 2, 2), across[:, -1, -1].reshape(shape), self._grid.ranks
            )
        self._b = [b for _, b in terms]
        assert self._response is not None
        return self._response, self._seen(self.moved(self._b))

    def settled(self, step: float, way: float) -> Response:
        """Return the response in the steady state, which each step carries over a way along x."""
        self.carry(way, *[0.0] * (self._axes - 1))
        stiffness = [part.settled(step) for part in self.components]
        ranks = self._grid.ranks
        self._of_waves = Response.of_stiffness(stiffness[0], stiffness[-1][:, -1, -1], ranks)
        count, shape = math.prod(self._grid.spectral_shape), self._grid.spectral_shape
        of = self._of_waves
        parts = of.normal, of.coupling, of.along, of.across
        return Response(*(part[:count].reshape(shape) for part in parts), ranks=ranks)

    def under_settled(self, tractions: ComplexArray) -> ComplexArray:
        """Return the displacements of the waves in that state."""
        return _joined(self._respond(self._of_waves, self.loads(tractions)))

    def settle(self, x: ComplexArray) -> None:
        """Begin the next step in that state, with displacements of the waves."""
        for part, u in zip(self.components, self._split(x), strict=True):
            part.settle(u)

    def seen(self, x: ComplexArray) -> ComplexArray:
        """Return the transforms of W, u_x[, u_y] of displacements of the waves."""
        return self._seen(self._split(x))

    def loads(self, tractions: ComplexArray) -> list[ComplexArray]:
        """Return the tractions on the waves, (p, T) and S."""
        return self._waves.components(tractions)

    def under(self, tractions: ComplexArray) -> ComplexArray:
        """Return the displacements of the waves at the end of the step of the last `terms`."""
        loads = self.loads(tractions)
        return _joined(self.moved([b + load for b, load in zip(self._b, loads, strict=True)]))

    def force(self, x: ComplexArray) -> ComplexArray:
        """Return the tractions on the waves at the end of the step of the last `terms`, kappa x - b."""
        return self.resistance(x) - _joined(self._b)

    def resistance(self, x: ComplexArray) -> ComplexArray:
        """Return kappa x, the tractions on a surface without a past."""
        every = zip(self.components, self._split(x), strict=True)
        return _joined([np.einsum("qab,qb->qa", part.stiffness, u) for part, u in every])

    def missing_stress(self, x: ComplexArray, curvature: ComplexArray) -> ComplexArray:  # noqa: ARG002
        """Return the part of the tractions that is due to the curvature dt^2 x''/2."""
        own = zip(self.components, self._split(curvature), strict=True)
        return _joined([part.curvature_stress(c) for part, c in own])

    def response_to(self, loads: ComplexArray) -> ComplexArray:
        """Return the displacements of the waves under tractions on them."""
        return _joined(self.moved(self._split(loads)))

    def advance(self, x: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Advance the history over the step of the last `terms` to displacements of the waves."""
        bent = [None] * self._axes if curvature is None else self._split(curvature)
        for part, u, c in zip(self.components, self._split(x), bent, strict=True):
            part.advance(u, c)
        self.phases = None

    def _split(self, x: ComplexArray) -> list[ComplexArray]:
        """Return (W, U) and V of the waves."""
        count = self._mode.size
        in_plane = x[: 2 * count].reshape(count, 2)
        return [in_plane] if self._axes == 1 else [in_plane, x[2 * count :].reshape(count, 1)]

    def carry(self, *distance: float) -> None:
        """Move the contact along the surface in the next step: a point at x + distance is then at x."""
        self.phases = None
        if any(distance):
            shifts = np.array(distance)[:, np.newaxis] * self._vectors
            self.phases = np.exp(1j * shifts.sum(axis=0))
        for part in self.components:
            part.turn(self.phases)

    def carried_waves(self, x: ComplexArray) -> ComplexArray:
        """Return values of the waves as they are carried with the material in the next step."""
        if self.phases is None:
            return x
        return _joined([part * self.phases[:, np.newaxis] for part in self._split(x)])

    def slowest(self, tolerance: float) -> float:
        """Return the longest time on the way to the steady state, see `SlidingModes.slowest`."""
        q, speed = np.abs(self._vectors[0]), abs(self._velocity)
        if speed == 0:  # a counterbody that rests in the frame of the contact
            return max(part.slowest(tolerance) for part in self.components)
        longest = q[q > 0].min()
        chosen = (q > 0) & (q < 1.5 * longest)
        times, vectors = self.components[0].spectrum.times, self.components[0].spectrum.vectors
        cycles = q[chosen] * speed * times[:, chosen]
        loss = (np.abs(vectors[:, chosen]) ** 2).sum(axis=-1) * cycles / (1 + cycles**2)
        relevant = loss > tolerance * self._grid.ranks.total(float(loss.sum()))
        slow = self._grid.ranks.maximum(float(times[:, chosen][relevant].max(initial=0.0)))
        return max(2 * math.pi / (float(longest) * speed), slow)

    def moved(self, loads: list[ComplexArray]) -> list[ComplexArray]:
        """Return the response of the waves to loads, (W, U) and V."""
        of = self._response
        assert of is not None
        parts = of.normal, of.coupling, of.along, of.across
        return self._respond(Response(*(np.ravel(part)[self._mode] for part in parts)), loads)

    def _respond(self, of: Response, loads: list[ComplexArray]) -> list[ComplexArray]:
        """Return the displacements of waves, each with its response, under loads."""
        normal, coupling, along, across = of.normal, of.coupling, of.along, of.across
        p, T = loads[0].T
        in_plane = np.stack((normal * p + coupling * T, coupling * p + along * T), axis=1)
        return [in_plane] if self._axes == 1 else [in_plane, across[:, np.newaxis] * loads[1]]

    def _seen(self, parts: list[ComplexArray]) -> ComplexArray:
        """Return transforms of W, u_x[, u_y] at the modes of the grid, sums over the waves of each."""
        W, U = parts[0].T
        n = self._along
        waves = np.concatenate((W[np.newaxis], 1j * n * U))
        if self._axes == 2:
            waves[1:] += np.stack((-n[1], n[0])) * parts[1][:, 0]
        count = math.prod(self._grid.spectral_shape)
        transforms = waves[:, :count].copy()
        for component, of_waves in zip(transforms, waves, strict=True):
            np.add.at(component, self._mode[count:], of_waves[count:])
        return transforms


def _joined(parts: Sequence[ComplexArray]) -> ComplexArray:
    """Return the values of all waves in one array."""
    return np.concatenate([part.ravel() for part in parts])


class TractionWaves:
    """The waves of a grid: wavevectors, (axes, waves), with the mode of the grid and the share in it of each.

    The first waves are the modes in their order, and `order` is that of the waves of all processes.
    """

    def __init__(self, grid: Grid) -> None:
        vectors = np.array([np.broadcast_to(q, grid.spectral_shape).ravel() for q in grid.wavevectors])
        mode, share = np.arange(vectors.shape[1]), np.ones(vectors.shape[1])
        width, own = grid.points[-1] // 2 + 1, grid.spectral_shape[-1]
        order = mode // own * width + mode % own + grid.columns.start
        every = math.prod(grid.points[:-1]) * width
        for axis, (points, period) in enumerate(zip(grid.points, grid.period, strict=True)):
            if points % 2:
                continue
            shared = np.flatnonzero(np.abs(vectors[axis]) > _NYQUIST * np.pi * points / period)
            share[shared] /= 2
            others = vectors[:, shared]
            others[axis] *= -1
            vectors = np.concatenate((vectors, others), axis=1)
            mode, share = np.append(mode, mode[shared]), np.append(share, share[shared])
            order = np.append(order, order[shared] + (1 + axis) * every)
        self.vectors, self.mode, self.share, self.order = vectors, mode, share, order
        length = np.sqrt((vectors**2).sum(axis=0))
        still = length == 0  # the mean has no direction
        self.along = np.where(still, 0.0, vectors / np.where(still, 1.0, length))
        self.along[0, still] = 1.0

    def components(self, transforms: ComplexArray) -> list[ComplexArray]:
        """Return normal and along, and across, on the waves: (p, T) and S of (p, t_x[, t_y])."""
        of_modes, n = transforms[:, self.mode] * self.share, self.along
        along = -1j * (n * of_modes[1:]).sum(axis=0)
        parts = [np.stack((of_modes[0], along), axis=1)]
        if len(n) == 2:
            parts.append((n[0] * of_modes[2] - n[1] * of_modes[1])[:, np.newaxis])
        return parts


def _at(spectrum: VectorSpectrum, mode: NDArray[np.intp]) -> VectorSpectrum:
    """Return the modes at waves, by the flat number of the wavevector of each."""
    n, modes = spectrum.relaxed.shape[-1], len(spectrum.times)  # none of an elastic body
    relaxed = spectrum.relaxed.reshape(-1, n, n)
    vectors, times = (
        spectrum.vectors.reshape(modes, len(relaxed), n),
        spectrum.times.reshape(modes, len(relaxed)),
    )
    return VectorSpectrum(relaxed[mode], vectors[:, mode], times[:, mode])


@kernel(reorder=True)
def _stiffen(v: NDArray[Any], gain: NDArray[Any], stiffness: NDArray[Any]) -> None:
    """Add sum_j gain_j v_j v_j^H, of shape (nq, n, n)."""
    modes, count, n = v.shape
    for j in range(modes):
        for q in range(count):
            for a in range(n):
                for b in range(n):
                    stiffness[q, a, b] += gain[j, q] * v[j, q, a] * np.conj(v[j, q, b])


@kernel(reorder=True)
def _pull(
    v: NDArray[Any],
    gain: FloatArray,
    decay: FloatArray,
    x: ComplexArray,
    stretch: ComplexArray,
    phases: ComplexArray,
    past: bool,
    total: ComplexArray,
) -> None:
    """Add sum_j v_j (gain_j v_j^H x - decay_j y_j); the last term if `past` counts."""
    modes, count, n = v.shape
    for j in range(modes):
        for q in range(count):
            driven = 0.0j
            for a in range(n):
                driven += np.conj(v[j, q, a]) * x[q, a]
            driven *= gain[j, q]
            if past:
                driven -= decay[j, q] * (stretch[j, q] * phases[q])
            for a in range(n):
                total[q, a] += v[j, q, a] * driven


@kernel(reorder=True)
def _advance(
    v: NDArray[Any],
    f: Factors,
    moved: ComplexArray,
    bent: ComplexArray,
    phases: ComplexArray,
    stretch: ComplexArray,
) -> tuple[FloatArray, FloatArray]:
    """Advance the stretches in place; return their squares and the heat at each wave."""
    modes, count, n = v.shape
    squares, heat = np.zeros(count), np.zeros(count)
    for j in range(modes):
        for q in range(count):
            d, c, before = 0.0j, 0.0j, stretch[j, q] * phases[q]
            for a in range(n):
                d += np.conj(v[j, q, a]) * moved[q, a]
                c += np.conj(v[j, q, a]) * bent[q, a]
            after, middle = f.decay[j, q] * before + f.gain[j, q] * d, before + f.lead[j, q] * d
            both = before + after
            heat[q] += (
                f.loss[j, q] * (middle.real**2 + middle.imag**2)
                + f.remainder[j, q] * (d.real**2 + d.imag**2)
                + f.curvature_loss[j, q] * (c.real**2 + c.imag**2)
                - f.curvature_gain[j, q] * (both.real * c.real + both.imag * c.imag)
            )
            after += f.curvature_gain[j, q] * c
            stretch[j, q] = after
            squares[q] += after.real**2 + after.imag**2
    return squares, heat
