"""First guesses of a step, extrapolated in time from the accepted ones.

Where a smooth surface leaves the punch, the pressure falls to zero like xi^(1/2) and the gap opens like
xi^(3/2) with the distance xi from the edge (Johnson, Contact Mechanics, 1985, ch. 4). Neither can be
extrapolated at a point that the edge passes, but

    s = p^2 inside,    s = -mu gap^(2/3) outside

is smooth across the edge, and so along time. mu is found from the points that the edge has just passed.
Where the contact does not change, the pressure itself is extrapolated.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import FloatArray
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.kernels import kernel, record_type
from gfmdlayer.resumable import Saving

_REACH = 32  # part of the surface, at least, on either side of the contact where the next may be
_BLOCK = 256  # points that are passed over together where nothing is in contact

Weights = tuple[float, float]
LastTwo = tuple[FloatArray, FloatArray]


class DisplacementPrediction(Saving):
    """The straight line in time through the last two accepted displacements; the last one where it is alone.

    A parabola through the last three takes more iterations: docs/theory/ablation.md.
    """

    KEPT: ClassVar[tuple[str, ...]] = ("times", "fields")

    def __init__(self, size: int, ranks: Ranks = ALONE) -> None:
        # `size` is the number of points of this process; before the first step the guess is zero.
        self._ranks = ranks
        self._times: deque[float] = deque(maxlen=2)
        self._fields: deque[FloatArray] = deque(maxlen=2)
        self._size = size

    def remember(
        self, time: float, displacement: FloatArray, _: FloatArray, *, at_breakpoint: bool = False
    ) -> None:
        """Add an accepted step; after a breakpoint of the drives earlier steps are forgotten."""
        if at_breakpoint:
            self._times.clear()
            self._fields.clear()
        self._times.append(time)
        self._fields.append(displacement)

    def at(self, time: float) -> FloatArray:
        """Return the guess for a later time, as a new array."""
        if not self._times:
            return np.zeros(self._size)
        return _combined(_weights(self._times, time), _last_two(self._fields))


class PressurePrediction(DisplacementPrediction):
    """Pressures extrapolated across moving edges of the contact, from the last two accepted steps."""

    KEPT = (*DisplacementPrediction.KEPT, "gaps", "mu", "moves", "contact")

    def __init__(self, size: int, ranks: Ranks = ALONE) -> None:
        super().__init__(size, ranks)
        self._gaps: deque[FloatArray] = deque(maxlen=2)
        self._mu = 0.0
        self._moves = 0  # steps in a row in which the contact changed
        self._contact = 0, size  # points between which it was in the last step

    def remember(
        self, time: float, pressure: FloatArray, gap: FloatArray, *, at_breakpoint: bool = False
    ) -> None:
        """Add an accepted step: the pressure and the gap, one value a point; see the base class."""
        if self._times:
            weights, gaps = _weights(self._times, time), _last_two(self._gaps)
            last = self._fields[-1]
            *sums, first, end = _learn(weights, gaps, last, pressure, self._contact)
            squares, predicted, moved = self._ranks.total(np.array(sums)).tolist()
            self._mu = squares / predicted if predicted > 0.0 else self._mu
            self._contact = first, end
            self._moves = self._moves + 1 if moved else 0
        if at_breakpoint:
            self._gaps.clear()
        super().remember(time, pressure, gap, at_breakpoint=at_breakpoint)
        self._gaps.append(gap)

    def __iter__(self) -> Iterator[LastTwo]:
        """Yield pressure and gap of the last steps, the last one last."""
        return zip(self._fields, self._gaps, strict=True)

    def into(self, ring: Ring) -> None:
        """Write the state into a ring."""
        now, count = ring.now[0], len(self._times)
        now["count"], now["last"], now["mu"] = count, max(count - 1, 0), self._mu
        now["moves"], now["contact"] = self._moves, self._contact
        for place in range(count):
            now["times"][place] = self._times[place]
            ring.p[place], ring.gap[place] = self._fields[place], self._gaps[place]

    def out_of(self, ring: Ring) -> None:
        """Take over the state of a ring."""
        now = ring.now[0]
        last, count = int(now["last"]), int(now["count"])
        places = [(last + 2) % 3, last][2 - count :]
        for kept, values in ((self._times, now["times"]), (self._fields, ring.p), (self._gaps, ring.gap)):
            kept.clear()
            kept.extend(values[place].copy() for place in places)
        self._mu, self._moves = float(now["mu"]), int(now["moves"])
        self._contact = int(now["contact"][0]), int(now["contact"][1])

    def at(self, time: float) -> FloatArray:
        """Return the guess for a later time, as a new array."""
        if not self._times:
            return np.zeros(self._size)
        pressures, gaps = _last_two(self._fields), _last_two(self._gaps)
        first, end = self._contact
        reach, size = max(self._size // _REACH, (end - first) // 2), self._size
        near = (first - reach, end + reach) if first >= reach and end + reach <= size else (0, size)
        weights, guess = _weights(self._times, time), np.zeros(size)
        _extrapolate(weights, pressures, gaps, self._mu, self._moves > 1, near, guess)
        return guess


# The same for compiled loops, which keep pressures and gaps in a ring of three.

RING = record_type(
    [
        ("count", np.int64),  # of accepted steps that are kept, at most two
        ("last", np.int64),  # place of the last one
        ("times", np.float64, 3),
        ("mu", np.float64),
        ("moves", np.int64),
        ("contact", np.int64, 2),
    ]
)


class Ring(NamedTuple):
    """The last two accepted steps, and room for the next one."""

    p: FloatArray  # (3, points)
    gap: FloatArray  # (3, points)
    now: npt.NDArray[Any]  # one record of `RING`


@kernel(inner=True, borrows=True)
def predict(ring: Ring, time: float, guess: FloatArray) -> None:
    """`PressurePrediction.at`."""
    now, size = ring.now[0], guess.size
    guess[:] = 0.0
    if now.count == 0:
        return
    first, end = now.contact[0], now.contact[1]
    reach, near = max(size // _REACH, (end - first) // 2), (0, size)
    if first >= reach and end + reach <= size:
        near = (first - reach, end + reach)
    one, last = _places(ring)
    pressures, gaps = (ring.p[one], ring.p[last]), (ring.gap[one], ring.gap[last])
    _extrapolate(_weights_at(ring, time), pressures, gaps, now.mu, now.moves > 1, near, guess)


@kernel(inner=True, borrows=True)
def remember(ring: Ring, place: int, time: float, at_breakpoint: bool) -> None:
    """`PressurePrediction.remember` for the step that is at a place of the ring."""
    now = ring.now[0]
    if now.count > 0:
        one, last = _places(ring)
        squares, predicted, moved, first, end = _learn(
            _weights_at(ring, time), (ring.gap[one], ring.gap[last]), ring.p[last], ring.p[place],
            (now.contact[0], now.contact[1]),
        )  # fmt: skip
        now.mu = squares / predicted if predicted > 0.0 else now.mu
        now.contact[0], now.contact[1] = first, end
        now.moves = now.moves + 1 if moved != 0.0 else 0
    now.count = 1 if at_breakpoint else min(now.count + 1, 2)
    now.last, now.times[place] = place, time


@kernel(inner=True, borrows=True)
def _places(ring: Ring) -> tuple[int, int]:
    last = ring.now[0].last
    return (last + 2) % 3 if ring.now[0].count > 1 else last, last


@kernel(inner=True, borrows=True)
def _weights_at(ring: Ring, time: float) -> Weights:
    if ring.now[0].count == 1:
        return 0.0, 1.0
    one, last = _places(ring)
    times = ring.now[0].times
    part = (time - times[one]) / (times[last] - times[one])
    return 1.0 - part, part


def _weights(times: Sequence[float], time: float) -> Weights:
    """Weights of the last two steps in the straight line through them, at a time."""
    if len(times) == 1:
        return 0.0, 1.0
    part = (time - times[0]) / (times[1] - times[0])
    return 1.0 - part, part


def _last_two(fields: Sequence[FloatArray]) -> LastTwo:
    """The last two fields; one that is alone is repeated, without a weight."""
    return fields[0], fields[-1]


@kernel(reorder=True, borrows=True)
def _learn(
    w: Weights, gaps: LastTwo, last: FloatArray, now: FloatArray, contact: tuple[int, int]
) -> tuple[float, float, float, int, int]:
    """Compare points that came into contact with their prediction."""
    # `contact` are the points, multiples of a block apart, between which the last contact is. Returns two
    # sums over the points, whose ratio is mu; how many changed; and the points between which contact is now.
    squares, predicted, moved, before, after = 0.0, 0.0, 0.0, now.size, 0
    for first in range(0, now.size, _BLOCK):
        new, old, others, touching = now[first : first + _BLOCK], last[first : first + _BLOCK], 0.0, 0.0
        for i in range(new.size):
            touching += new[i]  # tension within the tolerance has neighbours under pressure
        if touching > 0.0:
            before, after = min(before, first), first + new.size
        elif not contact[0] <= first < contact[1]:
            continue
        for i in range(new.size):
            others += abs((1.0 if new[i] > 0.0 else 0.0) - (1.0 if old[i] > 0.0 else 0.0))
        if others == 0.0:
            continue
        moved += others
        for i in range(first, first + new.size):
            if now[i] > 0.0 >= last[i]:
                s = 0.0
                for j in range(2):
                    s -= w[j] * _two_thirds(gaps[j][i])
                if s > 0.0:
                    squares += now[i] ** 2
                    predicted += s
    return squares, predicted, moved, min(before, after), after


@kernel(reorder=True, borrows=True)
def _extrapolate(
    w: Weights, p: LastTwo, gaps: LastTwo, mu: float, moving: bool, near: tuple[int, int],
    guess: FloatArray,
) -> None:  # fmt: skip
    """Extrapolate point by point near the contact; most points are far from it."""
    for first in range(near[0], near[1], _BLOCK):
        end, possible = min(first + _BLOCK, near[1]), 0.0
        p0, p1, gap0, gap1 = p[0][first:end], p[1][first:end], gaps[0][first:end], gaps[1][first:end]
        for i in range(p0.size):
            opening = 2.0 * (w[0] * gap0[i] + w[1] * gap1[i]) - gap1[i]
            possible += (1.0 if opening <= 0.0 else 0.0) + p0[i] + p1[i]
        if possible > 0.0:
            for i in range(p0.size):
                guess[first + i] = _extrapolated(w, (p0[i], p1[i]), (gap0[i], gap1[i]), mu, moving)


@kernel(inner=True, borrows=True)
def _extrapolated(w: Weights, p: Weights, gap: Weights, mu: float, moving: bool) -> float:
    """Pressure at one point, from those of two steps and the gaps."""
    pressed = p[0] > 0.0 and p[1] > 0.0
    if p[1] > 0.0 and not moving:
        return max(w[0] * p[0] + w[1] * p[1], 0.0)
    if p[1] <= 0.0 and 2.0 * (w[0] * gap[0] + w[1] * gap[1]) > gap[1]:
        return 0.0  # far from closing
    s = 0.0
    for j in range(2):
        s += w[j] * (p[j] ** 2 if pressed or p[j] > 0.0 else -mu * _two_thirds(gap[j]))
    return np.sqrt(s) if s > 0.0 else 0.0


@kernel
def _combined(w: Weights, fields: LastTwo) -> FloatArray:
    field = np.empty(fields[0].size)
    for i in range(field.size):
        field[i] = w[0] * fields[0][i] + w[1] * fields[1][i]
    return field


@kernel(inner=True, borrows=True)
def _two_thirds(gap: float) -> float:
    return float(np.cbrt(gap * gap))


class LastGap(DisplacementPrediction):
    """The gap of the last accepted step, infinite before the first.

    An interface that attracts has instabilities, which no extrapolation may run past.
    """

    def __init__(self, size: int, ranks: Ranks = ALONE) -> None:
        super().__init__(size, ranks)
        self._times, self._fields = deque(maxlen=1), deque(maxlen=1)

    def at(self, _time: float) -> FloatArray:
        """Return the guess, as a new array."""
        return self._fields[-1].copy() if self._fields else np.full(self._size, np.inf)


PREDICTIONS: dict[str, type[DisplacementPrediction]] = {
    "displacement": DisplacementPrediction,
    "pressure": PressurePrediction,
    "gap": LastGap,
}
