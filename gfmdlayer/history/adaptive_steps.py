"""Steps as long as a tolerance allows.

The error of a step is known when it is solved (`corrected`). It grows with the third power of the step, and
the history does not pass it on, so the next step is the last one times (tolerance/error)^(1/3). A step whose
error is above the tolerance is tried again, shorter.

Steps land on the kinks of the trajectory, on the snapshots and on the asked output times. Nothing that was
known before a kink helps after it: there the steps begin again short, and grow fast at first.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from gfmdlayer.arrays import ComplexArray
from gfmdlayer.history.error_control import ErrorControlledModes
from gfmdlayer.history.time_points import Instant, stops
from gfmdlayer.resumable import State

# Measured over materials from Ginf/G0 = 2 to 100 and Prony series over five decades.
_SAFETY = 0.9  # of the tolerance is aimed at
_GROWTH = 2.0  # of a step at most
_FIRST_GROWTH, _FIRST_STEPS = 4.0, 3  # where the steps begin short
_SHRINK = (0.2, 0.8)  # of a step that is tried again
_AFTER_KINK = 0.3  # of the last step
_DRAWN_BACK = 0.01  # of the largest depth, below which the dent is no image of the punch any more
_AT_REST = 30.0  # times the tolerance and the shortest relaxation time: the first step of a punch at rest
_AFTER_JUMP = 1e-6  # of that time: the first step where the punch is pressed in at t = 0

_MEMORY = ("time", "next_stop", "turns", "next", "since_kink", "largest", "deepest", "depth")


class AdaptiveSteps:
    """Steps chosen as the run goes on: each is given out, and make_solution before the next.

    Parameters
    ----------
    integrator : ErrorControlledModes
        Knows the error of a step.
    tolerance : float
        Error allowed, relative to the largest mean pressure so far (depth, in load control), and of the
        displacement relative to the largest depth so far.
    end : float
        Last time.
    snapshots, kinks, times : iterable of float
        Times to land on.
    """

    def __init__(
        self,
        integrator: ErrorControlledModes,
        tolerance: float,
        end: float,
        snapshots: Iterable[float],
        kinks: Iterable[float],
        times: Iterable[float] = (),
    ) -> None:
        self._integrator, self._tolerance = integrator, tolerance
        self._stops = stops(end, snapshots, kinks, times)
        self._next_stop, self._turns = 0, False
        self._time = self._step = self._next = 0.0
        self._since_kink = 0
        self._largest = self._deepest = self._depth = 0.0

    def __iter__(self) -> Iterator[Instant]:
        """Give the time points in order; a step that was not accepted is followed by a shorter one."""
        while self._next_stop < len(self._stops):
            if self._turns:
                self._integrator.turn()
                self._next, self._since_kink, self._turns = _AFTER_KINK * self._next, 0, False
            stop = self._stops[self._next_stop]
            left = stop.time - self._time
            self._step = self._shortened(left)
            self._lands = self._step == left
            self._then = stop.time if self._lands else self._time + self._step
            kink = self._lands and stop.kink and left > 0
            yield Instant(self._then, self._step, self._lands and stop.snapshot, kink)

    def accepts(self, spectrum: ComplexArray, found: float, depth: float) -> bool:
        """Judge the step that was given out last.

        Parameters
        ----------
        spectrum : ndarray
            The displacement at its end.
        found : float
            What the contact problem was solved for: the mean pressure, or the depth in load control.
        depth : float
            Of the punch.
        """
        largest, deepest = max(self._largest, abs(found)), max(self._deepest, depth)
        if self._step == 0:
            accepted = True
            # A punch may rest at a depth: that of the lowest of the grid's points, which miss its apex.
            pressed = deepest > 0 and bool(spectrum.any())
            self._next = self._integrator.fastest * (_AFTER_JUMP if pressed else _AT_REST * self._tolerance)
        else:
            relative, displacement = self._integrator.error(
                spectrum, moving=depth != self._depth, deep=depth >= _DRAWN_BACK * deepest
            )
            error = max(_part(relative * abs(found), largest), _part(displacement, deepest))
            accepted = error <= self._tolerance
            self._choose(_SAFETY * self._tolerance / max(error, 1e-300), accepted)
        if accepted:
            self._largest, self._deepest, self._depth = largest, deepest, depth
            self._time = self._then
            if self._lands:
                self._turns = self._step > 0 and self._stops[self._next_stop].kink
                self._next_stop += 1
        return accepted

    def state(self) -> State:
        """Return where the run is, and what the length of the next step depends on."""
        return {name: getattr(self, f"_{name}") for name in _MEMORY}

    def restore(self, state: State) -> None:
        """Go on from there."""
        for name in _MEMORY:
            setattr(self, f"_{name}", state[name].item())

    def _choose(self, room: float, accepted: bool) -> None:
        """Set the length of the next step, when the error of this one may grow by the factor `room`."""
        factor = room ** (1 / 3)
        if accepted:
            growth = _FIRST_GROWTH if self._since_kink < _FIRST_STEPS else _GROWTH
            # A step that was cut to land somewhere does not shorten those that follow.
            self._next = max(min(self._next, factor * self._step), min(growth, factor) * self._step)
            self._since_kink += 1
        else:
            self._next = min(max(factor, _SHRINK[0]), _SHRINK[1]) * self._step

    def _shortened(self, left: float) -> float:
        """Step that does not pass the next stop, nor leaves a splinter of a step before it."""
        if self._next >= left:
            return left
        return min(self._next, left / 2)


def _part(value: float, whole: float) -> float:
    return value / whole if whole > 0 else 0.0
