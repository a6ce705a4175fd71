"""Steps as long as a tolerance allows.

The error of a step is known after it is solved (`history.errors`). It grows with the third power of the step
and does not accumulate in the history, so the next step is the last one times (tolerance/error)^(1/3). A step
with an error above the tolerance is rejected and repeated with a shorter step.

Steps land on the breakpoints of the drives, on the snapshots and on the output times. The displacement
before a breakpoint does not predict the displacement after it: there the steps start short, and grow fast.

Under an interface that attracts, the surface may jump into contact or out of it while the punch hardly
moves. The solver finds the energy of a jump (`Solution.released_energy`). Separation may also be fast without
a jump: a gap g changes over one step by a large part of the range of the interface, or of itself where it is
wider,

    separation = max |change of g| / max(range, g)        over the points

A fast separation takes several steps. Over a jump, the drive has gone on by

    drive = (change of depth, load or strength of the interface) / (range, largest load, largest strength)

Two errors follow. The history takes the surface as moving evenly over the step, which is an error
proportional to the step. And the jump is placed at the end of the step: this misplaces the response, and the
energy that is lost, by at most the drive times the jump of the response. A step over an instability is
accepted if both errors are within the tolerance. Else it is repeated by halves towards the jump, down to the
length at which the errors, which are proportional to it, will be within the tolerance. Behind the jump the
steps start as after a breakpoint.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace

from gfmdlayer.arrays import FloatArray
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.time_points import SAME_TIME, Course, FixedSteps, fingerprint
from gfmdlayer.interface.law import Interaction
from gfmdlayer.kernels import LANES, filled, kernel, maximum
from gfmdlayer.resumable import Saving, State
from gfmdlayer.step import Change, Instant, Step

# Of a contact: the relative error of the response in a step, and the error of the displacement.
Error = Callable[..., tuple[float, float]]

# Measured over materials from Ginf/G0 = 2 to 100 and Prony series over five decades.
_SAFETY = 0.9  # part of the tolerance that a step aims at
_GROWTH = 2.0  # largest growth of a step; a steady state is found in windows shorter than fast growing steps
_FIRST_GROWTH, _FIRST_STEPS = 4.0, 3  # the same for the first steps after the start or a breakpoint
_SHRINK = (0.2, 0.8)  # range of the factor on a rejected step
_ROUNDING = 4 * sys.float_info.epsilon  # of a time: steps shorter than this part of it are not divided
_AFTER_BREAKPOINT = 0.3  # first step after a breakpoint, in steps before it
_RETRACTED = 0.01  # part of the largest depth below which the dent is no longer an image of the punch
_FROM_REST = 30.0  # first step without contact, in units of tolerance times the shortest relaxation time
# Separation up to which a step is resolved at a tolerance of 1e-4 (measured: the pull-off of a cylinder, at
# rates from relaxed to glassy), and the largest at any tolerance.
_SEPARATION, _WIDEST_SEPARATION = 0.3, 0.5
_AFTER_JUMP = 1e-6  # first step after a punch is pressed in at t = 0, in shortest relaxation times


class Changes(Saving):
    """Compares each step with the last accepted one, if the interface attracts at any time."""

    KEPT = ("gap", "drive", "largest")

    def __init__(self, interface: Interaction, sums: Sums, *, by_depth: bool) -> None:
        self._interface, self._sums, self._by_depth = interface, sums, by_depth
        self._gap: FloatArray | None = None
        self._drive = 0.0, 0.0  # prescribed depth or load, and strength of the interface
        self._largest = 0.0, 0.0

    def over(self, step: Step) -> Change | None:
        """Return the change since the last accepted step; None under a hard wall, and at the first step."""
        if self._gap is None:
            return None
        drive, reach = (step.prescribed, step.interface.strength), self._interface.range
        load, strength = (max(most, abs(now)) for most, now in zip(self._largest, drive, strict=True))
        scale = reach if self._by_depth else load, strength
        parts = zip(drive, self._drive, scale, strict=True)
        moved = max(abs(now - before) / most if most else 0.0 for now, before, most in parts)
        separation = self._sums.maximum(_separation(self._gap, step.fields["distance"], reach))
        return Change(step.pulled_off or step.released_energy > 0, separation, moved)

    def remember(self, step: Step) -> None:
        """Remember an accepted step."""
        if self._interface.attracts:
            now, (load, strength) = step.interface.strength, self._largest
            self._drive, self._gap = (step.prescribed, now), step.fields["distance"]
            self._largest = max(load, abs(step.prescribed)), max(strength, now)


@kernel(reorder=True)
def _separation(before: FloatArray, after: FloatArray, reach: float) -> float:
    """Largest change of a gap, over the larger of the reach and the lesser of the gaps before and after."""
    most = filled(LANES, 0.0)
    for first in range(0, before.size, LANES):
        old, new = before[first : first + LANES], after[first : first + LANES]
        for i in range(old.size):
            change, gap = abs(new[i] - old[i]), min(old[i], new[i])
            change /= gap if gap > reach else reach
            most[i] = change if change > most[i] else most[i]
    return maximum(most)  # type: ignore[no-any-return]


@dataclass
class StepState:
    """Position of the run in time, and the quantities that set the length of the next step."""

    time: float = 0.0
    next_stop: int = 0
    next_step: float = 0.0
    after_breakpoint: bool = False
    steps_since_breakpoint: int = 0
    largest_response: float = 0.0
    largest_depth: float = 0.0
    depth: float = 0.0
    reach: float = 0.0  # a next stop before this time would have shortened a step since the last stop
    bound: bool = False  # whether a step was shortened because the run ends
    response: float = 0.0
    after_jump: bool = False
    last_step: float = 0.0  # length of the last step, 0 after a breakpoint
    jump_by: float = 0.0  # a step to this time was rejected for an instability
    over_jump: float = 0.0  # length of a step over the instability that will be accepted


class AdaptiveSteps:
    """Steps chosen during the run: `accepts` judges each, and `advance` goes on behind an accepted one."""

    def __init__(
        self,
        tolerance: float,
        stops: Sequence[Instant],
        shortest_time: float,
        least: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        # The tolerance is the largest error of the response relative to its largest value so far, and of the
        # displacement relative to the largest depth so far. Steps land on the `stops`, from the start to the
        # end. `shortest_time` is the shortest relevant relaxation time at the start. `least` has the smallest
        # scales of response and depth; the scale of the depth is the range of an interface that attracts, and
        # zero for a hard wall.
        self._tolerance, self._stops, self._shortest_time = tolerance, stops, shortest_time
        self._attracted = least[1] > 0
        self._separation = min(_SEPARATION * (tolerance / 1e-4) ** (1 / 3), _WIDEST_SEPARATION)
        self._position = StepState(largest_response=least[0], largest_depth=least[1])
        self._behind = self._position  # the last step, if it is accepted

    def __iter__(self) -> Iterator[Instant]:
        """Yield the time points in order; a shorter step follows a rejected one."""
        while self._position.next_stop < len(self._stops):
            now = self._position
            fresh = now.after_breakpoint or now.after_jump
            if now.after_breakpoint:
                now.next_step, now.last_step = _AFTER_BREAKPOINT * now.next_step, 0.0
                now.steps_since_breakpoint, now.after_breakpoint = 0, False
            if now.after_jump:
                now.steps_since_breakpoint, now.after_jump = 0, False
            if now.jump_by - now.time > self._shortest:
                now.next_step = min(now.next_step, self._towards_jump())
            stop = self._stops[now.next_stop]
            left = stop.time - now.time
            now.bound = now.bound or self._ends(now.next_step)
            now.reach = max(now.reach, now.time + 2 * now.next_step)
            # Two halves rather than a step and a much shorter one before the stop.
            step = left if now.next_step >= left else min(now.next_step, left / 2)
            self._lands = step == left
            time = stop.time if self._lands else now.time + step
            marks = self._lands and stop.snapshot, self._lands and stop.breakpoint
            self._given = Instant(time, step, *marks, fresh)
            yield self._given

    def accepts(self, step: Step, error: Error) -> bool:
        """Accept the last step if its error is within the tolerance; set the length of the next one."""
        now, change = replace(self._position), step.change
        response_scale = max(now.largest_response, abs(step.response))
        depth_scale = max(now.largest_depth, step.depth)
        if self._given.step == 0:
            accepted = True
            # The depth at rest may differ from zero: it counts from the lowest point of the grid.
            first = _AFTER_JUMP if depth_scale > 0 and step.deforms else _FROM_REST * self._tolerance
            now.next_step = self._shortest_time * first
        else:
            estimate = self._error(step, error, (response_scale, depth_scale))
            if change is not None and (change.jumps or change.separation > self._separation):
                jump = change.drive * _ratio(abs(step.response - now.response), response_scale)
                accepted = self._accepts_abrupt(now, max(estimate, jump), change)
            else:
                accepted = estimate <= self._tolerance
                if not accepted and self._given.step <= _ROUNDING * self._given.time:
                    accepted, estimate = True, self._tolerance  # there is no shorter step
                widest = math.inf
                if change is not None and change.separation > 0:
                    widest = _SAFETY * self._separation / change.separation
                self._set_next_step(now, _SAFETY * self._tolerance / max(estimate, 1e-300), accepted, widest)
        if accepted:
            self._behind = now
            now.largest_response, now.largest_depth, now.depth = response_scale, depth_scale, step.depth
            now.response, now.last_step = step.response, self._given.step
            now.time = self._given.time
            now.after_breakpoint = self._given.breakpoint
            now.next_stop += self._lands
            now.reach = 0.0 if self._lands else now.reach
        else:
            self._position = now
        return accepted

    def advance(self) -> None:
        """Go on behind the last step, which was accepted."""
        self._position = self._behind

    def course(self) -> Course | None:
        """Return the course if the next step is the first that depends on the end."""
        now = self._position
        following = now.next_step * (_AFTER_BREAKPOINT if now.after_breakpoint else 1.0)
        if now.bound or now.time == 0 or not self._ends(following):
            return None
        return Course(now.time, now.next_stop, fingerprint(self._stops[: now.next_stop]), now.reach)

    def _ends(self, step: float) -> bool:
        """Whether the end shortens a step."""
        now = self._position
        return now.next_stop == len(self._stops) - 1 and step > (self._stops[-1].time - now.time) / 2

    def state(self) -> State:
        """Return the position."""
        return asdict(self._position)

    def restore(self, state: State) -> None:
        """Continue from a position."""
        self._position = StepState(**{name: state[name].item() for name in asdict(self._position)})

    @property
    def _shortest(self) -> float:
        """Shortest step: times closer than this are the same."""
        return SAME_TIME * self._stops[-1].time

    def _error(self, step: Step, error: Error, scales: tuple[float, float]) -> float:
        """Estimate the error of a step, relative to the scales of response and depth."""
        moving, deep = step.depth != self._position.depth, step.depth >= _RETRACTED * scales[1]
        relative, displacement = error(step, moving=moving, deep=deep)
        if self._attracted:
            return max(relative, displacement / scales[1])
        return max(_ratio(relative * abs(step.response), scales[0]), _ratio(displacement, scales[1]))

    def _accepts_abrupt(self, now: StepState, error: float, change: Change) -> bool:
        """Accept or reject a step over an instability or a fast separation, and set the next."""
        step = self._given.step
        accepted = error <= self._tolerance or step <= self._shortest
        room = _SAFETY * self._tolerance / max(error, 1e-300)
        if accepted:
            now.after_jump, now.next_step = True, min(max(room, 1.0), _FIRST_GROWTH) * step
        elif change.jumps and step <= _FIRST_GROWTH * now.last_step:
            now.jump_by, now.over_jump, now.next_step = self._given.time, min(room, 0.5) * step, step
        else:  # a step much longer than the last one may end on a branch that shorter steps do not reach
            now.next_step = min(max(_SAFETY * self._separation / change.separation, _SHRINK[0]), 0.5) * step
        return accepted

    def _towards_jump(self) -> float:
        """Half of the way to an instability, or the whole way if a step over it will be accepted."""
        now = self._position
        left = now.jump_by - now.time
        return left if left <= now.over_jump else max(left / 2, now.over_jump)

    def _set_next_step(self, now: StepState, room: float, accepted: bool, widest: float) -> None:
        """Set the next step: `room` is the largest factor on its error, `widest` on its length."""
        factor, step = min(room ** (1 / 3), widest), self._given.step
        if accepted:
            growth = _FIRST_GROWTH if now.steps_since_breakpoint < _FIRST_STEPS else _GROWTH
            # A step that was cut to land on a stop does not shorten the next ones.
            now.next_step = max(min(now.next_step, factor * step), min(growth, factor) * step)
            now.steps_since_breakpoint += 1
        else:
            now.next_step = min(max(factor, _SHRINK[0]), _SHRINK[1]) * step


def _ratio(value: float, scale: float) -> float:
    return value / scale if scale > 0 else 0.0


Steps = FixedSteps | AdaptiveSteps
