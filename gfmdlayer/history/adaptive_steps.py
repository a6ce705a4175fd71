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

Where u(t) is a straight line the error vanishes: an elastic body, or a flat punch, would be solved at the
stops only. Two more bounds follow from the rows:

* With a hard wall, a curve can be drawn through them (an attraction has its own bound, above). The second
  divided difference of the last three responses gives the deviation of the response from a straight line over
  the step, |bend| dt^2/4. It stays within a hundredth of the largest response, or the step is rejected. Where
  a stretch begins, the deviation is unknown: at most 4/27 of the change, as that of a power 2/3 or 3/2 from
  zero. While the drive grows, the largest response is expected from its largest value, as the response of a
  Hertzian contact grows.
* The energy balance closes. What a step leaves open is the error of its work (`path_work`), of third order
  in the step at most like the error above, and bounds the next step in the same way: to the tolerance times
  the largest work, which is expected as the largest response is. Most steps leave much less; a free layer
  that an attraction bends leaves more, since its mean stress is a small part of its stresses.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.time_points import SAME_TIME, Course, FixedSteps, fingerprint
from gfmdlayer.interface.law import Interaction
from gfmdlayer.kernels import LANES, filled, kernel, maximum, record_type
from gfmdlayer.resumable import Saving, State
from gfmdlayer.step import Change, Instant, Step

# Of a contact: the relative error of the response in a step, and the error of the displacement.
Error = Callable[..., tuple[float, float]]

# Measured over materials from Ginf/G0 = 2 to 100 and Prony series over five decades.
_SAFETY = 0.9  # part of the tolerance that a step aims at
_OF_ATTRACTED = 0.2  # the same of the balance under an attraction, whose errors have one sign over many steps
_GROWTH = 2.0  # largest growth of a step; a steady state is found in windows shorter than fast growing steps
_FIRST_GROWTH, _FIRST_STEPS = 4.0, 3  # the same for the first steps after the start or a breakpoint
_SHRINK = (0.2, 0.8)  # range of the factor on a rejected step
_ROUNDING = 4 * sys.float_info.epsilon  # of a time: steps shorter than this part of it are not divided
_AFTER_BREAKPOINT = 0.3  # first step after a breakpoint, in steps before it
RETRACTED = 0.01  # part of the largest depth below which the dent is no longer an image of the punch
_FROM_REST = 30.0  # first step without contact, in units of tolerance times the shortest relaxation time
# Separation up to which a step is resolved at a tolerance of 1e-4 (measured: the pull-off of a cylinder, at
# rates from relaxed to glassy), and the largest at any tolerance.
_SEPARATION, _WIDEST_SEPARATION = 0.3, 0.5
_AFTER_JUMP = 1e-6  # first step after a punch is pressed in at t = 0, in shortest relaxation times

# Rows between which the response is drawn as a straight line.
_DEVIATION = 0.01  # of the response from it, relative to the largest response, while the drive changes
_DEVIATION_AT_REST = 0.05
_UNKNOWN_DEVIATION = 4 / 27  # part of the change of the response: the most for a power 2/3 or 3/2 from zero


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


# Position of the run in time, and the quantities that set the length of the next step.
STEP_STATE = record_type(
    [
        ("time", np.float64),
        ("next_stop", np.int64),
        ("next_step", np.float64),
        ("after_breakpoint", np.bool_),
        ("steps_since_breakpoint", np.int64),
        ("largest_response", np.float64),
        ("largest_depth", np.float64),
        ("depth", np.float64),
        ("reach", np.float64),  # a next stop before this time would have shortened a step since the last stop
        ("bound", np.bool_),  # whether a step was shortened because the run ends
        ("response", np.float64),
        ("after_jump", np.bool_),
        ("last_step", np.float64),  # length of the last step, 0 after a breakpoint
        ("jump_by", np.float64),  # a step to this time was rejected for an instability
        ("over_jump", np.float64),  # length of a step over the instability that will be accepted
        ("earlier", np.float64),  # response one step before the last
        ("prescribed", np.float64),
        ("largest_work", np.float64),  # or energy
        ("imbalance", np.float64),  # of the energies, of the last row
    ]
)


class StepControl(NamedTuple):
    """The stops, the limits of the steps and the state of their control."""

    stops: FloatArray  # times on which steps land, from the start to the end
    marks: IntArray  # of the stops: `BREAKPOINT` and `SNAPSHOT`
    tolerance: float
    separation: float  # largest one that is resolved
    shortest_time: float  # relaxation time
    shortest: float  # step: times closer than this are the same
    attracted: bool
    largest_drive: float  # prescribed depth or load
    growth_of_response: float  # exponent over the drive
    first_step: float  # at most
    now: npt.NDArray[Any]  # one record of `STEP_STATE`
    behind: npt.NDArray[Any]  # the same behind the last step, if it is accepted


BREAKPOINT, SNAPSHOT = 1, 2


class Point(NamedTuple):
    """The end of a step."""

    time: float
    step: float
    marks: int  # of the stop on which it lands
    lands: bool
    fresh: bool


@kernel(borrows=True)
def next_point(control: StepControl) -> Point:
    """Return the end of the next step."""
    now, stops = control.now[0], control.stops
    fresh = now.after_breakpoint or now.after_jump
    if now.after_breakpoint:
        now.next_step, now.last_step = _AFTER_BREAKPOINT * now.next_step, 0.0
        now.steps_since_breakpoint, now.after_breakpoint = 0, False
    if now.after_jump:
        now.steps_since_breakpoint, now.after_jump = 0, False
    if now.jump_by - now.time > control.shortest:
        # Half of the way to an instability, or the whole way if a step over it will be accepted.
        left = now.jump_by - now.time
        now.next_step = min(now.next_step, left if left <= now.over_jump else max(left / 2.0, now.over_jump))
    now.bound = now.bound or _ends(control, now.next_step)
    now.reach = max(now.reach, now.time + 2.0 * now.next_step)
    left = stops[now.next_stop] - now.time
    # Two halves rather than a step and a much shorter one before the stop.
    step = left if now.next_step >= left else min(now.next_step, left / 2.0)
    lands = step == left
    time = stops[now.next_stop] if lands else now.time + step
    return Point(time, step, control.marks[now.next_stop] if lands else 0, lands, fresh)


@kernel(borrows=True)
def _ends(control: StepControl, step: float) -> bool:
    """Whether the end shortens a step."""
    now, last = control.now[0], control.stops.size - 1
    return bool(now.next_stop == last and step > (control.stops[last] - now.time) / 2.0)


@kernel(borrows=True)
def scales(control: StepControl, response: float, depth: float) -> tuple[float, float]:
    """Scales of the errors of response and displacement."""
    now = control.now[0]
    return max(now.largest_response, abs(response)), max(now.largest_depth, depth)


@kernel(borrows=True)
def relative_error(
    control: StepControl, response: float, depth: float, relative: float, displacement: float
) -> float:
    """Error of a step relative to the scales, from that of the response and of the displacement."""
    response_scale, depth_scale = scales(control, response, depth)
    if control.attracted:
        return max(relative, displacement / depth_scale)
    of_response = relative * abs(response) / response_scale if response_scale > 0.0 else 0.0
    return max(of_response, displacement / depth_scale if depth_scale > 0.0 else 0.0)


@kernel(borrows=True)
def judge(
    control: StepControl,
    point: Point,
    prescribed: float,
    response: float,
    depth: float,
    deforms: bool,
    estimate: float,
    changes: tuple[bool, float, float],
) -> bool:
    """Accept a step if its error is within the tolerance; set the length of the next one."""
    # `changes` are those of a `Change`, zero under a hard wall. An accepted position is `behind`.
    control.behind[0] = control.now[0]
    now, before, step, tolerance = control.behind[0], control.now[0], point.step, control.tolerance
    response_scale, depth_scale = scales(control, response, depth)
    jumps, separation, drive = changes
    accepted = True
    if step == 0.0:
        # The depth at rest may differ from zero: it counts from the lowest point of the grid.
        first = _AFTER_JUMP if depth_scale > 0.0 and deforms else _FROM_REST * tolerance
        now.next_step = min(control.shortest_time * first, control.first_step)
    elif jumps or separation > control.separation:
        jump = abs(response - before.response) / response_scale if response_scale > 0.0 else 0.0
        accepted = _accepts_abrupt(control, point, max(estimate, drive * jump), jumps, separation)
    else:
        deviation = 0.0 if control.attracted else _deviation(control, step, prescribed, response)
        accepted = estimate <= tolerance and deviation <= 1.0
        if not accepted and step <= _ROUNDING * point.time:
            accepted, estimate, deviation = True, tolerance, 1.0  # there is no shorter step
        widest = _SAFETY * control.separation / separation if separation > 0.0 else np.inf
        widest = min(widest, math.sqrt(_SAFETY / max(deviation, 1e-300)))
        _set_next_step(control, step, _SAFETY * tolerance / max(estimate, 1e-300), accepted, widest)
    if accepted:
        now.largest_response, now.largest_depth, now.depth = response_scale, depth_scale, depth
        now.prescribed = prescribed
        now.earlier, now.response, now.last_step, now.time = now.response, response, step, point.time
        now.after_breakpoint = (point.marks & BREAKPOINT) != 0
        if point.lands:
            now.next_stop, now.reach = now.next_stop + 1, 0.0
    else:
        control.now[0] = control.behind[0]
    return accepted


@kernel(inner=True, borrows=True)
def _deviation(control: StepControl, step: float, prescribed: float, response: float) -> float:
    """Deviation of the response from a straight line over a step, relative to the largest deviation."""
    now = control.now[0]
    change, last = response - now.response, now.last_step
    off = _UNKNOWN_DEVIATION * abs(change)
    if last > 0.0:
        bend = (change / step - (now.response - now.earlier) / last) / (step + last)
        off = abs(bend) * step**2 / 4.0
    largest = max(now.largest_response, abs(response) * _growth(control, prescribed))
    part = _DEVIATION if prescribed != now.prescribed else _DEVIATION_AT_REST
    return float(off / (max(part, control.tolerance) * largest)) if off > 0.0 else 0.0


@kernel(inner=True, borrows=True)
def _growth(control: StepControl, prescribed: float) -> float:
    """Factor by which the response is expected to grow up to the largest drive."""
    if 0.0 < prescribed < control.largest_drive:
        return float((control.largest_drive / prescribed) ** control.growth_of_response)
    return 1.0


@kernel(borrows=True)
def weigh(control: StepControl, work: float, imbalance: float) -> None:
    """Bound the next step by what the last one, which was accepted, has left open in the energy balance."""
    now = control.now[0]
    expected, left_open = abs(work) * _growth(control, now.prescribed), abs(imbalance - now.imbalance)
    if 0.0 < now.prescribed < control.largest_drive:
        expected *= control.largest_drive / now.prescribed
    now.largest_work, now.imbalance = max(now.largest_work, abs(work)), imbalance
    if left_open > 0.0 and now.last_step > 0.0:
        part = _OF_ATTRACTED if control.attracted else _SAFETY
        room = part * control.tolerance * max(now.largest_work, expected) / left_open
        now.next_step = min(now.next_step, max(room ** (1 / 3), _SHRINK[0]) * now.last_step)


@kernel(inner=True, borrows=True)
def _accepts_abrupt(control: StepControl, point: Point, error: float, jumps: bool, separation: float) -> bool:
    """Accept or reject a step over an instability or a fast separation, and set the next."""
    now, step = control.behind[0], point.step
    accepted = error <= control.tolerance or step <= control.shortest
    room = _SAFETY * control.tolerance / max(error, 1e-300)
    if accepted:
        now.after_jump, now.next_step = True, min(max(room, 1.0), _FIRST_GROWTH) * step
    elif jumps and step <= _FIRST_GROWTH * now.last_step:
        now.jump_by, now.over_jump, now.next_step = point.time, min(room, 0.5) * step, step
    else:  # a step much longer than the last one may end on a branch that shorter steps do not reach
        now.next_step = min(max(_SAFETY * control.separation / separation, _SHRINK[0]), 0.5) * step
    return accepted


@kernel(inner=True, borrows=True)
def _set_next_step(control: StepControl, step: float, room: float, accepted: bool, widest: float) -> None:
    """Set the next step: `room` is the largest factor on its error, `widest` on its length."""
    now, factor = control.behind[0], min(room ** (1 / 3), widest)
    if accepted:
        growth = _FIRST_GROWTH if now.steps_since_breakpoint < _FIRST_STEPS else _GROWTH
        # A step that was cut to land on a stop does not shorten the next ones.
        now.next_step = max(min(now.next_step, factor * step), min(growth, factor) * step)
        now.steps_since_breakpoint += 1
    else:
        now.next_step = min(max(factor, _SHRINK[0]), _SHRINK[1]) * step


class DrawnDrive(NamedTuple):
    """The drive over which the response is drawn."""

    largest: float  # value
    growth: float  # exponent of the response over the drive, in a Hertzian contact
    first: float  # length of the first stretch


def _first_part(tolerance: float, growth: float) -> float:
    """Return the first step as a part of the first stretch of the drive."""
    # The response deviates from a straight line, and the work of the second step is off, by a power of it.
    of_response = (_SAFETY * _DEVIATION / _UNKNOWN_DEVIATION) ** (1 / growth)
    return float(of_response * min(1.0, tolerance / 1e-3) ** (1 / (1 + growth)))


class AdaptiveSteps:
    """Steps chosen during the run: `accepts` judges each, and `advance` goes on behind an accepted one."""

    def __init__(
        self,
        tolerance: float,
        stops: Sequence[Instant],
        shortest_time: float,
        least: tuple[float, float, float] = (0.0, 0.0, 0.0),
        drawn: DrawnDrive | None = None,
    ) -> None:
        # The tolerance is the largest error of the response relative to its largest value so far, and of the
        # displacement relative to the largest depth so far. Steps land on the `stops`, from the start to the
        # end. `shortest_time` is the shortest relevant relaxation time at the start. `least` has the smallest
        # scales of response, depth and work; the scale of the depth is the range of an interface that
        # attracts, and zero for a hard wall. `drawn` is the drive as far as a curve is drawn over it.
        drawn = drawn or DrawnDrive(0.0, 1.0, math.inf)
        self._stops = stops
        self.control = StepControl(
            stops=np.array([stop.time for stop in stops]),
            marks=np.array([BREAKPOINT * stop.breakpoint + SNAPSHOT * stop.snapshot for stop in stops]),
            tolerance=tolerance,
            separation=min(_SEPARATION * (tolerance / 1e-4) ** (1 / 3), _WIDEST_SEPARATION),
            shortest_time=shortest_time,
            shortest=SAME_TIME * stops[-1].time,
            attracted=least[1] > 0,
            largest_drive=drawn.largest,
            growth_of_response=drawn.growth,
            first_step=math.inf if least[1] > 0 else _first_part(tolerance, drawn.growth) * drawn.first,
            now=np.zeros(1, STEP_STATE),
            behind=np.zeros(1, STEP_STATE),
        )
        now = self.control.now[0]
        now["largest_response"], now["largest_depth"], now["largest_work"] = least

    def __iter__(self) -> Iterator[Instant]:
        """Yield the time points in order; a shorter step follows a rejected one."""
        while self.control.now["next_stop"][0] < len(self._stops):
            self._point = point = next_point(self.control)
            marks = point.marks
            yield Instant(
                point.time, point.step, bool(marks & SNAPSHOT), bool(marks & BREAKPOINT), point.fresh
            )

    def accepts(self, step: Step, error: Error) -> bool:
        """Accept the last step if its error is within the tolerance; set the length of the next one."""
        control, change, estimate = self.control, step.change, 0.0
        if self._point.step:
            _, depth_scale = scales(control, step.response, step.depth)
            moving = bool(step.depth != control.now["depth"][0])
            errors = error(step, moving=moving, deep=step.depth >= RETRACTED * depth_scale)
            estimate = relative_error(control, step.response, step.depth, *errors)
        changes = (False, 0.0, 0.0) if change is None else (change.jumps, change.separation, change.drive)
        of_step = step.prescribed, step.response, step.depth, step.deforms
        return bool(judge(control, self._point, *of_step, estimate, changes))

    def advance(self) -> None:
        """Go on behind the last step, which was accepted."""
        self.control.now[0] = self.control.behind[0]

    def weigh(self, row: Mapping[str, float]) -> None:
        """Look at the energy balance of the last step, in its row."""
        if "work" in row:
            weigh(self.control, float(row["work"]), float(row["energy_residual"]))

    def course(self) -> Course | None:
        """Return the course if the next step is the first that depends on the end."""
        now = self.control.now[0]
        following = now["next_step"] * (_AFTER_BREAKPOINT if now["after_breakpoint"] else 1.0)
        if now["bound"] or now["time"] == 0 or not _ends(self.control, following):
            return None
        passed = int(now["next_stop"])
        return Course(float(now["time"]), passed, fingerprint(self._stops[:passed]), float(now["reach"]))

    def state(self) -> State:
        """Return the position."""
        return {name: self.control.now[name][0] for name in STEP_STATE.names or ()}

    def restore(self, state: State) -> None:
        """Continue from a position."""
        for name in STEP_STATE.names or ():
            self.control.now[name] = state[name]


Steps = FixedSteps | AdaptiveSteps
