"""Steps as long as a tolerance allows.

The error of a step is known after it is solved (`ErrorControl`). It grows with the third power of the step
and does not accumulate in the history, so the next step is the last one times (tolerance/error)^(1/3). A step
with an error above the tolerance is rejected and repeated with a shorter step.

Steps land on the breakpoints of the programme, on the snapshots and on the output times. The displacement
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
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.modes import Modes
from gfmdlayer.history.side_by_side import SideBySide
from gfmdlayer.history.time_points import SAME_TIME, Course, FixedSteps, Instant, fingerprint
from gfmdlayer.interface.law import Interaction
from gfmdlayer.kernels import LANES, filled, kernel, maximum
from gfmdlayer.resumable import Saving, State

# The error of a step, and the curvature of u(t) from which it follows.
#
# The exponential scheme of `modes` takes u as linear over the step. The curvature that it neglects,
# c = dt^2 u''/2, follows after the step is solved from the divided difference of the last three accepted
# displacements. It has two uses:
#
# * The history is advanced with it, to third order, so that errors do not accumulate.
# * The truncation error of the step remains: at its end the stress -sigma is too small by
#   delta f = sum_j w_j curvature_gain_j c.
#
# At given depth a small delta f changes the mean pressure by -<v, delta f>, where v is the derivative of the
# displacement with respect to the depth: -1 all over the contact, free of stress outside it, and zero in the
# mean. While the punch moves, the change of u over the step is proportional to v. While it rests, the contact
# grows beyond the contact of the last step in which it moved. The displacement u itself, in place of v, is in
# error to the other side. (u is not used where the punch is all but withdrawn: the dent that is left does not
# follow the punch.) Divided by <v, f>, which is proportional to the mean pressure, either gives a relative
# error, and the larger one counts.
#
# At given load the depth changes, by less in one step; but it creeps for longer than the pressure relaxes,
# and earlier errors add to that, so that the same number serves (measured: half of it is reached). The part
# of delta f that changes neither pressure nor depth moves the free surface: with r the quotient above, by
# (delta f - r f)/kappa.
#
# Under an interface that attracts, the mean pressure is a difference and goes through zero. There the part of
# delta f along v, <v, delta f>/|v|, counts relative to the largest stress so far, and r as zero. And the edge
# of the contact moves by the tractions around it: if all steps have the same error delta f there, they change
# the work that it takes to open the contact. So c is then a part of the stress of a step, as of the history:
#
#     c = rho (u - u_0 - dt v_0),        rho = dt/(dt + dt_0),        sum_j w_j (y_j + curvature_gain_j c)
#
# with the displacement u_0 and the velocity v_0 before, over the last step dt_0. c is linear in u, and kappa
# grows by rho sum_j w_j curvature_gain_j. The estimate of the error is not changed: it is then an upper
# bound.
#
# Under a punch that moves along the surface the tangential force counts too: the mean of the slope of the
# surface times delta f, relative to the largest tangential force so far.

# Part of the change over a step that may be curvature, where no earlier displacement is known:
# measured, it is 0.1 where contact begins and less elsewhere.
_UNKNOWN_CURVATURE = 0.25

# A force below this part of the stresses of which it is the difference is rounding: no contact.
_NO_CONTACT = 1e-10
_TINY = 1e-300  # in place of a division by zero

# Smallest scale of a tangential force, as a part of the product of the norms of slopes and stresses.
_SMALLEST_FORCE = 1e-4


# The history of one body or two: -kappa u + b is the stress at the end of a step.
Integrator = Modes | SideBySide


class ErrorControl(Saving):
    """Controls the error of an integrator with the exponential scheme and steps that vary in length."""

    KEPT = ("contact_motion", "velocity", "last_step", "largest_stress", "largest_force")

    def __init__(self, integrator: Integrator, sums: Sums, tolerance: float, *, curved: bool = False) -> None:
        # The tolerance is the largest error of the mean pressure relative to its largest value so far (of the
        # depth, in load control), and of the displacement relative to the largest depth so far. `curved`: the
        # stress of a step includes the curvature, see above.
        self._integrator, self._sums, self._curved = integrator, sums, curved
        self.tolerance = tolerance
        self._contact_motion: ComplexArray | None = None  # change of u over the last step of a moving punch
        self._velocity: ComplexArray | None = None
        self._last_step = self._largest_stress = self._largest_force = 0.0
        self._known: tuple[ComplexArray, ComplexArray] | None = None  # displacement and curvature of a step

    @property
    def shortest_time(self) -> float:
        """Shortest relevant relaxation time of the body."""
        return self._integrator.shortest_time

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b at the end of a step, with the curvature where it counts."""
        integrator, self._known = self._integrator, None
        stiffness, b = integrator.terms(step)
        if not self._curved or self._velocity is None:
            return stiffness, b
        return integrator.curved(self._ratio, self._velocity)

    def advance(self, spectrum: ComplexArray) -> None:
        """Advance the history over the step of the last `terms`, with the curvature that is now known."""
        integrator, velocity = self._integrator, None
        if integrator.step > 0:
            velocity = (integrator.parts(spectrum) - integrator.past) * (1 / integrator.step)
        integrator.advance(spectrum, self._curvature(spectrum))
        self._known = None
        if velocity is not None:
            self._velocity, self._last_step = velocity, integrator.step

    def discard_velocity(self) -> None:
        """Discard the velocity of the surface, which does not predict its displacement after a breakpoint."""
        self._velocity = None

    def deforms(self, spectrum: ComplexArray) -> bool:
        """Return whether a displacement is not zero."""
        return bool(self._sums.maximum(int(spectrum.any())))

    def error(
        self, spectrum: ComplexArray, *, moving: bool, deep: bool, attracted: bool = False
    ) -> tuple[float, float]:
        """Estimate the error of the step of the last `terms`, which ends with this transform of u."""
        # `moving`: the punch moves over the step; `deep`: its depth is comparable to the largest so far.
        # Returns the relative error of the mean pressure (at given load, of the depth; of the stress, where
        # the interface attracts) or of the tangential force; and the root mean square error of the
        # displacement.
        integrator, curvature = self._integrator, self._curvature(spectrum)
        if curvature is None:
            curvature = _UNKNOWN_CURVATURE * (integrator.parts(spectrum) - integrator.past)
        force, error = integrator.force(spectrum), integrator.missing_stress(spectrum, curvature)
        if moving:  # the change over a step that is then rejected serves as well
            self._contact_motion = spectrum - integrator.u
        weights, kappa = self._sums.weights, integrator.stiffness
        norm = self._sums.total(_stress_norm(weights, kappa, spectrum.view(np.float64)))
        self._largest_stress = max(self._largest_stress, math.sqrt(norm)) if attracted else 0.0
        ratio = part = 0.0
        for v in (spectrum if deep else None, self._contact_motion):
            if v is None:
                continue
            work, error_work, squares = self._sums.spectral_means(v, force, error)
            if attracted:
                part = max(part, abs(error_work) / (math.sqrt(squares) * self._largest_stress + _TINY))
            elif work**2 > _NO_CONTACT**2 * squares * norm:
                ratio = max(ratio, error_work / work, key=abs)
        square = _displacement_error(weights, kappa, error.view(np.float64), ratio, force.view(np.float64))
        relative = part if attracted else abs(ratio)
        if integrator.slope is not None:
            relative = max(relative, self._tangential_error(integrator.slope * spectrum, force, error))
        return relative, math.sqrt(self._sums.total(square))

    def _tangential_error(self, slope: ComplexArray, force: ComplexArray, error: ComplexArray) -> float:
        """Error of the tangential force, relative to the largest so far."""
        mean = self._sums.spectral_mean
        smallest = _SMALLEST_FORCE * math.sqrt(mean(slope, slope) * mean(force, force))
        self._largest_force = max(self._largest_force, smallest, abs(mean(slope, force)))
        off = abs(mean(slope, error))
        return off / self._largest_force if off > 0 else 0.0

    def state(self) -> State:
        """Return the history and the last motion of the surface."""
        return {**self._integrator.state(), **super().state()}

    def restore(self, state: State) -> None:
        """Continue from a state."""
        self._integrator.restore(state)
        super().restore(state)

    def _curvature(self, spectrum: ComplexArray) -> ComplexArray | None:
        """dt^2 u''/2 from the divided difference of the last three displacements, this one included."""
        if self._velocity is None:
            return None
        if self._known is not None and self._known[0] is spectrum:
            return self._known[1]
        now, past = self._integrator.parts(spectrum), self._integrator.past
        numbers = (each.view(np.float64) for each in (now, past, self._velocity))
        found = _curvature(self._ratio, self._integrator.step, *numbers).view(np.complex128)
        self._known = spectrum, found
        return found

    @property
    def _ratio(self) -> float:
        """Length of the step over the length of the last two."""
        return self._integrator.step / (self._integrator.step + self._last_step)


@kernel(reorder=True)
def _curvature(
    ratio: float, step: float, new_u: FloatArray, u: FloatArray, velocity: FloatArray
) -> FloatArray:
    """Return dt^2 u''/2 from the last velocity; the ratio is this step over the sum of the last two."""
    found = np.empty(u.size)
    for i in range(u.size):
        found[i] = ratio * (new_u[i] - u[i] - step * velocity[i])
    return found


@kernel(reorder=True)
def _stress_norm(weights: FloatArray, stiffness: FloatArray, u: FloatArray) -> float:
    """Mean square of stiffness u over the surface."""
    total = 0.0
    for k in range(stiffness.size):
        total += weights[k] * stiffness[k] ** 2 * (u[2 * k] ** 2 + u[2 * k + 1] ** 2)
    return total


@kernel(reorder=True)
def _displacement_error(
    weights: FloatArray, stiffness: FloatArray, error: FloatArray, ratio: float, force: FloatArray
) -> float:
    """Mean square of (error - ratio force)/stiffness over the surface, where the stiffness is not zero."""
    total = 0.0
    for k in range(stiffness.size):
        if stiffness[k] > 0.0:
            real, imaginary = error[2 * k] - ratio * force[2 * k], error[2 * k + 1] - ratio * force[2 * k + 1]
            total += weights[k] * (real * real + imaginary * imaginary) / stiffness[k] ** 2
    return total


# Measured over materials from Ginf/G0 = 2 to 100 and Prony series over five decades.
_SAFETY = 0.9  # part of the tolerance that a step aims at
_GROWTH = 2.0  # largest growth of a step
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


@dataclass(frozen=True)
class Change:
    """Change over a step under an interface that attracts; the module's docstring has the ratios."""

    jumps: bool  # whether an instability released energy
    separation: float
    drive: float


class Changes(Saving):
    """Compares each step with the last accepted one, if the interface attracts at any time."""

    KEPT = ("gap", "drive", "largest")

    def __init__(self, interface: Interaction, sums: Sums) -> None:
        self._interface, self._sums = interface, sums
        self._gap: FloatArray | None = None
        self._drive = 0.0, 0.0  # prescribed depth or load, and strength of the interface
        self._largest = 0.0, 0.0

    def over(
        self, prescribed: float, problem: Problem, solution: Solution, *, lost: bool = False
    ) -> Change | None:
        """Return the change since the last accepted step; None under a hard wall, and at the first step."""
        # `prescribed` is the depth or load at the end of the step; `lost` says whether the punch is pulled
        # off.
        if self._gap is None:
            return None
        drive, reach = (prescribed, problem.interface.strength), self._interface.range
        load, strength = (max(most, abs(now)) for most, now in zip(self._largest, drive, strict=True))
        scale = reach if problem.mean_pressure is None else load, strength
        parts = zip(drive, self._drive, scale, strict=True)
        moved = max(abs(now - before) / most if most else 0.0 for now, before, most in parts)
        separation = self._sums.maximum(_separation(self._gap, solution.gap, reach))
        return Change(lost or solution.released_energy > 0, separation, moved)

    def remember(self, prescribed: float, problem: Problem, solution: Solution) -> None:
        """Remember an accepted step, see `over`."""
        if self._interface.attracts:
            now, (load, strength) = problem.interface.strength, self._largest
            self._drive, self._gap = (prescribed, now), solution.gap
            self._largest = max(load, abs(prescribed)), max(strength, now)


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
class _Position:
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
    """Steps chosen during the run: `accepts` judges each before the next is yielded."""

    def __init__(
        self,
        control: ErrorControl,
        stops: Sequence[Instant],
        slowdown: float = 1.0,
        least: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        # They land on the `stops`, from the start to the end. `slowdown` is the factor by which relaxation
        # times are longer at the start than `control.shortest_time`. `least` has the smallest scales of
        # response and depth; the scale of the depth is the range of an interface that attracts, and zero for
        # a hard wall.
        self._control, self._stops, self._slowdown = control, stops, slowdown
        self._tolerance = tolerance = control.tolerance
        self._attracted = least[1] > 0
        self._separation = min(_SEPARATION * (tolerance / 1e-4) ** (1 / 3), _WIDEST_SEPARATION)
        self._position = _Position(largest_response=least[0], largest_depth=least[1])

    def __iter__(self) -> Iterator[Instant]:
        """Yield the time points in order; a shorter step follows a rejected one."""
        while self._position.next_stop < len(self._stops):
            now = self._position
            if now.after_breakpoint:
                self._control.discard_velocity()
                now.next_step, now.last_step = _AFTER_BREAKPOINT * now.next_step, 0.0
                now.steps_since_breakpoint, now.after_breakpoint = 0, False
            if now.after_jump:
                self._control.discard_velocity()
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
            self._given = Instant(time, step, self._lands and stop.snapshot, self._lands and stop.breakpoint)
            yield self._given

    def accepts(
        self, spectrum: ComplexArray, response: float, depth: float, change: Change | None = None
    ) -> bool:
        """Accept the last step if its error is within the tolerance, and set the next one."""
        # The response is the mean pressure at a prescribed depth, the depth under a prescribed load; `change`
        # is given where the interface attracts.
        now = self._position
        response_scale, depth_scale = max(now.largest_response, abs(response)), max(now.largest_depth, depth)
        if self._given.step == 0:
            accepted = True
            # The depth at rest may differ from zero: it counts from the lowest point of the grid.
            pressed = depth_scale > 0 and self._control.deforms(spectrum)
            first = _AFTER_JUMP if pressed else _FROM_REST * self._tolerance
            now.next_step = self._control.shortest_time * self._slowdown * first
        else:
            error = self._error(spectrum, response, depth, (response_scale, depth_scale))
            if change is not None and (change.jumps or change.separation > self._separation):
                jump = change.drive * _ratio(abs(response - now.response), response_scale)
                accepted = self._accepts_abrupt(max(error, jump), change)
            else:
                accepted = error <= self._tolerance
                if not accepted and self._given.step <= _ROUNDING * self._given.time:
                    accepted, error = True, self._tolerance  # there is no shorter step
                widest = math.inf
                if change is not None and change.separation > 0:
                    widest = _SAFETY * self._separation / change.separation
                self._set_next_step(_SAFETY * self._tolerance / max(error, 1e-300), accepted, widest)
        if accepted:
            now.largest_response, now.largest_depth, now.depth = response_scale, depth_scale, depth
            now.response, now.last_step = response, self._given.step
            now.time = self._given.time
            now.after_breakpoint = self._given.breakpoint
            now.next_stop += self._lands
            now.reach = 0.0 if self._lands else now.reach
        return accepted

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
        self._position = _Position(**{name: state[name].item() for name in asdict(self._position)})

    @property
    def _shortest(self) -> float:
        """Shortest step: times closer than this are the same."""
        return SAME_TIME * self._stops[-1].time

    def _error(
        self, spectrum: ComplexArray, response: float, depth: float, scales: tuple[float, float]
    ) -> float:
        """Estimate the error of the last step, relative to the scales."""
        moving, deep = depth != self._position.depth, depth >= _RETRACTED * scales[1]
        if self._attracted:
            relative, displacement = self._control.error(spectrum, moving=moving, deep=True, attracted=True)
            return max(relative, displacement / scales[1])
        relative, displacement = self._control.error(spectrum, moving=moving, deep=deep)
        return max(_ratio(relative * abs(response), scales[0]), _ratio(displacement, scales[1]))

    def _accepts_abrupt(self, error: float, change: Change) -> bool:
        """Accept or reject a step over an instability or a fast separation, and set the next."""
        now, step = self._position, self._given.step
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

    def _set_next_step(self, room: float, accepted: bool, widest: float) -> None:
        """Set the next step: `room` is the largest factor on its error, `widest` on its length."""
        now, factor, step = self._position, min(room ** (1 / 3), widest), self._given.step
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
