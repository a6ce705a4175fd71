"""Stacks whose layers have reduced times of their own: temperature with different shifts.

The internal vector xi of `body.network` is the state. In a step the reduced time of each layer elapses
(`reduced_time`), and their ratios are taken as constant over it: the layers' times over these ratios are the
times of the step, in reduced time of the uppermost layer, in which u is linear over the step as well. The
modes of the step have the columns of U (`Network.axes`), and each mode is one of `modes`, of the weight
l^2 with l = U^T (0; g), and the stretch y:

    l y = U^T (-xi; g u - B xi),        xi = U_xi (l u - l y)                    U_xi: the first rows of U

so that terms, energies and heat of the step are those of `modes`, exact for the ratios of the step. Where
the layers have the same shift they are those in reduced time, and at constant temperature those of the stack
of shifted times. While the ratios change, the error of a step is of third order in its length, like the error
of taking u as linear over it. Only the uppermost layer, parallel to the network, has one reduced time and
needs no change.

For steps of varying length the error of the ratios is estimated from two halves of the step, 4/3 of the
difference between them and the whole; the history is corrected by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.body.network import InternalVariables
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.modes import RELEVANT, LocalModes, Modes, Scheme, exponential
from gfmdlayer.history.reduced_time import ReducedTime
from gfmdlayer.resumable import State

# Digits of the ratios of the layers' reduced times: rounding of the times does not make new modes.
_DIGITS = 12

# Least weight of a mode, relative to the relaxed stiffness: it does not change the stress, and its stretch is
# finite in a step in which the surface does not drive it.
_LEAST = 1e-60


class _Axes(NamedTuple):
    """The modes of a step at each wavenumber that has a network; times in those of the uppermost layer."""

    times: FloatArray  # (wavenumbers, modes)
    levers: FloatArray  # (wavenumbers, modes), l > 0
    to_modes: FloatArray  # (wavenumbers, modes, internal), U^T (1; B)
    to_internal: FloatArray  # (wavenumbers, internal, modes), U_xi


class StackModes(Modes):
    """The relaxing modes of a stack whose layers have reduced times of their own.

    `reduced_times` has one for each law of the body, None where the times do not change; elastic layers below
    need none. `halved`: each step is corrected for ratios that change within it, for steps of varying length.
    """

    def __init__(
        self,
        internal: InternalVariables,
        scheme: Scheme,
        sums: Sums,
        *,
        reduced_times: Sequence[ReducedTime | None],
        halved: bool = False,
    ) -> None:
        super().__init__(internal.uppermost, scheme, sums)
        self._network, at, self._halved = internal.network, internal.number, halved
        known = dict(enumerate(reduced_times))
        self._reduced_times = [known.get(law) for law in internal.laws]
        self._position = np.argsort(at, kind="stable")[np.count_nonzero(at < 0) :]
        self._wave: IntArray = at[self._position]
        self._edges = np.searchsorted(self._wave, np.arange(self._network.free.size + 1))
        size = self._network.times.size
        self._xi = np.zeros((self._position.size, size, 2))
        self._uppermost_times, self._time = self._times, 0.0
        self._ratios: tuple[float, ...] = ()
        index = np.repeat(self._position, size)
        none = np.zeros(index.size)
        self._local = LocalModes(index, none, none, np.zeros((index.size, 2)))
        self._found: tuple[ComplexArray, FloatArray, float] | None = None
        self.prepare(0.0)
        self.shortest_time = self._shortest_time(np.asarray(internal.uppermost.glassy))

    def _shortest_time(self, glassy: FloatArray) -> float:
        """Shortest relevant relaxation time at t = 0; `glassy` is the stiffness without the network."""
        glassy = glassy[self._position] + (self._network.force**2).sum(axis=1)[self._wave]
        weights, times = self._axes.levers[self._wave] ** 2, self._axes.times[self._wave]
        fastest = float(times[weights > RELEVANT * glassy[:, np.newaxis]].min(initial=np.inf))
        return min(self.shortest_time, self._sums.minimum(fastest)) / float(self._rates(0.0, 0.0)[0])

    def prepare(self, step: float) -> None:
        """Find the modes of a step of this length in time, and the history in them."""
        self._found, rates = None, self._rates(self._time, step)
        if (ratios := _rounded(rates)) != self._ratios:
            self._ratios, self._axes = ratios, self._find(ratios)
            levers, times = (np.ravel(each[self._wave]) for each in (self._axes.levers, self._axes.times))
            energy_weights = levers**2 * self._sums.weights[self._local.position]
            self._local = LocalModes(
                self._local.position, levers**2, energy_weights, np.zeros((levers.size, 2))
            )
            self._times, self.step = np.concatenate((self._uppermost_times, times)), np.nan
        stretch = self._at(self.u) - self._each(self._axes.to_modes, self._xi) / self._levers(self._axes)
        self._local.stretch[:] = stretch.reshape(-1, 2)
        self._length = step
        super().prepare(float(rates[0]) * step)

    def missing_stress(self, spectrum: ComplexArray, curvature: ComplexArray) -> ComplexArray:
        """Part of -sigma due to dt^2 u''/2 and to ratios that change within the step."""
        found = super().missing_stress(spectrum, curvature)
        if self._halved:
            network = self._network
            of_waves = network.force[self._wave], network.coupling[self._wave]
            stress = np.einsum("ki,kij,kjp->kp", *of_waves, self._missing(spectrum)[0])
            found[self._position] -= np.ascontiguousarray(stress).view(np.complex128)[:, 0]
        return found

    def advance(self, spectrum: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Advance the history over the step of the last `terms`, see `Modes`."""
        missing, heat = self._missing(spectrum) if self._halved else (None, 0.0)
        super().advance(spectrum, curvature)
        levers, y = self._levers(self._axes), self._local.stretch.reshape(self._xi.shape)
        self._xi = self._each(self._axes.to_internal, levers * (self._at(self.u) - y))
        self._time += self._length
        if missing is not None:
            weights = self._sums.weights[self._position][:, np.newaxis, np.newaxis]
            before, change = y * levers, -self._each(self._axes.to_modes, missing)
            self.stored += self._sums.total(float((weights * change * (before + change / 2)).sum()))
            self.dissipated += heat
            self._xi += missing

    def state(self) -> State:
        """Return the history, with the internal vectors in place of the modes of a step."""
        kept = {name: value for name, value in super().state().items() if name != "local_stretch"}
        return {**kept, "internal": self._xi, "time": self._time}

    def restore(self, state: State) -> None:
        """Continue from a state."""
        super().restore({**state, "local_stretch": self._local.stretch})
        self._xi, self._time = np.array(state["internal"]), float(state["time"])

    def _rates(self, begin: float, length: float) -> FloatArray:
        """Mean rate at which the reduced time of each layer elapses in a step."""
        if length == 0:
            return np.array([1.0 if each is None else 1 / each.factor(begin) for each in self._reduced_times])
        return np.array(
            [1.0 if each is None else each.step(begin, length) / length for each in self._reduced_times]
        )

    def _find(self, ratios: tuple[float, ...]) -> _Axes:
        """Return the modes for these ratios of the layers' reduced times."""
        known, count = self._network, self._network.free.size
        size = known.times.size
        times, levers = np.empty((2, count, size))
        to_modes, to_internal = np.empty((2, count, size, size))
        of_step = known.times / np.array(ratios)[known.layer]
        for i in range(count):
            times[i], U = known.axes(i, of_step)
            lever = known.force[i] @ U[size:]
            U *= np.where(lever < 0, -1.0, 1.0)
            levers[i] = np.abs(lever)
            to_modes[i], to_internal[i] = U[:size].T + U[size:].T @ known.coupling[i], U[:size]
        stiffness = np.zeros(count)
        stiffness[self._wave] = self.relaxed[self._position]
        return _Axes(times, np.maximum(levers, np.sqrt(_LEAST * stiffness)[:, None]), to_modes, to_internal)

    def _levers(self, axes: _Axes) -> FloatArray:
        return axes.levers[self._wave][:, :, np.newaxis]

    def _at(self, spectrum: ComplexArray) -> FloatArray:
        """Real and imaginary parts where there is a network, shape (positions, 1, 2)."""
        return spectrum[self._position].view(np.float64).reshape(-1, 1, 2)

    def _each(self, matrices: FloatArray, vectors: FloatArray) -> FloatArray:
        """Product of the matrix of each wavenumber with the vectors that belong to it."""
        found = np.empty_like(vectors)
        for k, matrix in enumerate(matrices):
            some = slice(self._edges[k], self._edges[k + 1])
            found[some] = matrix @ vectors[some]
        return found

    def _missing(self, spectrum: ComplexArray) -> tuple[FloatArray, float]:
        """Change of xi and of the heat because the ratios change within the step."""
        if self._found is None or self._found[0] is not spectrum:
            self._found = (spectrum, *self._by_halves(spectrum))
        return self._found[1:]

    def _by_halves(self, spectrum: ComplexArray) -> tuple[FloatArray, float]:
        half = self._length / 2
        rates = [self._rates(self._time, half), self._rates(self._time + half, half)]
        ratios = [_rounded(each) for each in rates]
        if set(ratios) == {self._ratios}:
            return np.zeros_like(self._xi), 0.0
        begin, end = self._at(self.u), self._at(spectrum)
        middle = begin + (end - begin) * (rates[0][0] / (rates[0][0] + rates[1][0]))
        whole, heat = self._carried(self._axes, self.step, self._xi, begin, end)
        xi, heats = self._carried(self._find(ratios[0]), half * rates[0][0], self._xi, begin, middle)
        xi, more = self._carried(self._find(ratios[1]), half * rates[1][0], xi, middle, end)
        return (xi - whole) * (4 / 3), self._sums.total(heats + more - heat) * (4 / 3)

    def _carried(
        self, axes: _Axes, step: float, xi: FloatArray, begin: FloatArray, end: FloatArray
    ) -> tuple[FloatArray, float]:
        """Return xi after a step in which u is linear, and the heat."""
        x = step / axes.times[self._wave]
        f = exponential(np.ravel(x))
        decay, gain, loss, lead, remainder = (each.reshape(*x.shape, 1) for each in f[:5])
        levers = self._levers(axes)
        y, moved = levers * begin - self._each(axes.to_modes, xi), levers * (end - begin)
        heat = loss * (y + lead * moved) ** 2 + remainder * moved**2
        after = decay * y + gain * moved
        weights = self._sums.weights[self._position][:, np.newaxis, np.newaxis]
        return self._each(axes.to_internal, levers * end - after), float((weights * heat).sum())


def _rounded(rates: FloatArray) -> tuple[float, ...]:
    """Rates of the layers' reduced times, relative to the uppermost layer."""
    return tuple(float(f"{ratio:.{_DIGITS}g}") for ratio in rates / rates[0])
