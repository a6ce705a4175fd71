"""A periodic contact whose surfaces stick and slip: the parts of such a case and its time loop.

In the frame of the contact the material moves by V dt a step, and with it displacements and memory; the punch
moves by D along the surface. One rule serves all motions:

    presliding      V = 0, D the path of the punch, or the tangential force is given
    sliding         V the velocity, D = V dt
    rolling         V the velocity, D = xi V dt with the creepage xi, or the tangential force is given
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from gfmdlayer.arrays import BoolArray, ComplexArray, FloatArray
from gfmdlayer.contact.loading import Surface, pulled_off
from gfmdlayer.contact.loss_stiffness import Mixing
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.friction import problem as frictional
from gfmdlayer.friction.problem import Law
from gfmdlayer.friction.solver import LIMIT, MIXED, FrictionSolver
from gfmdlayer.history.modes import SCHEMES
from gfmdlayer.history.time_points import Instant
from gfmdlayer.history.traction_modes import TractionControl, TractionModes
from gfmdlayer.interface.law import HARD_WALL, Interaction
from gfmdlayer.model import ConvergenceError
from gfmdlayer.observables import AcceptedStep
from gfmdlayer.observables.friction import direction
from gfmdlayer.observables.observable import Shear
from gfmdlayer.resumable import CompositeState, Saving
from gfmdlayer.simulation import Case
from gfmdlayer.time_functions import distance

if TYPE_CHECKING:
    from gfmdlayer.model import Progress, Resume
    from gfmdlayer.results.journal import Recorder

_ROUNDS = 80  # solves of a step for a coefficient that depends on the slip speed
_HALVINGS = 40  # of the interval of a coefficient
_SETTLED = 10  # tolerances of the solver, within which a coefficient and its bound count as reached
_SLIDES = 1e-3  # part of the largest tangential force within which a step without a solution slides away


class Motion(Saving):
    """What a run carries beside the history of the body: place of the punch, last tractions, gap and slip.

    A point that comes into contact in a step has slipped before it touched. Where the edge of the contact
    sticks, surface and punch move past each other in proportion to the closing of the gap, both like the
    3/2 power of the distance from the edge. So the slip until the point touches follows from the last step,
    and the slip of this one counts from there: without this, the error is of the first order in the step.
    """

    KEPT = (
        "time", "step", "depth", "moved", "tractions", "before", "gap", "closing", "slip", "stick",
    )  # fmt: skip

    def __init__(self, shape: tuple[int, ...]) -> None:
        axes, points = len(shape), math.prod(shape)
        self._shape = shape
        self.time, self.step = 0.0, 0.0  # of the last accepted step
        self.depth = 0.0
        self.moved = np.zeros(axes)  # displacement of the punch along the surface
        self.tractions = np.zeros((1 + axes, points))
        self.before: FloatArray | None = None  # tractions a step earlier; None behind a breakpoint
        self.gap, self._closing = np.full(points, np.inf), np.zeros(points)  # after the last step; its change
        self._slip = np.zeros((axes, points))  # in the last step
        self._untouched = np.zeros((axes, points))  # in this one, see above
        self._stick = np.zeros(points, dtype=bool)

    def guess(self, step: float) -> FloatArray | None:
        """Return tractions at the end of a step by extrapolation; None where there are none yet."""
        if not self.tractions[0].any():
            return None
        if self.before is None or not self.step > 0 or not self.before[0].any():
            return self.tractions
        return self.tractions + (self.tractions - self.before) * min(step / self.step, 1.0)

    def slip_until_touch(self, step: float) -> FloatArray:
        """Return the slip in a step until points touch that are apart."""
        self._untouched = np.zeros_like(self._slip)
        touching = self.tractions[0] > 0
        if self.before is None or not self.step > 0 or not self._stick.any():
            return self._untouched
        from scipy.ndimage import distance_transform_edt

        nearest = distance_transform_edt(
            ~touching.reshape(self._shape), return_distances=False, return_indices=True
        )
        sticks = self._stick[np.ravel_multi_index(tuple(nearest), self._shape).ravel()]
        comes = sticks & (self.gap > 0) & (self._closing < 0)
        part = np.minimum(self.gap[comes] / -self._closing[comes], step / self.step)
        self._untouched[:, comes] = self._slip[:, comes] * part
        return self._untouched

    def remember(self, instant: Instant, found: frictional.Solution) -> None:
        """Take an accepted step as the beginning of the next one."""
        self.before = None if instant.breakpoint else self.tractions
        self.time, self.step, self.depth = instant.time, instant.step, found.depth
        self.moved, self.tractions = self.moved + found.path, found.tractions
        gap = np.maximum(found.gap, 0.0)
        self._closing = np.where(np.isfinite(self.gap), gap - self.gap, 0.0)
        self.gap, self._stick = gap, found.stick
        self._slip = found.slip + self._untouched


class SlidesAwayError(Exception):
    """The tangential force is larger than the friction; the message says by how much."""


class FrictionalCase(Case):
    """The parts of one simulation with friction at the interface, see `Case`."""

    @cached_property
    def integrator(self) -> Any:
        """The history of the surface under tractions in all directions."""
        spectrum = self.body.traction_spectrum(self.grid.waves)  # type: ignore[attr-defined]
        last = 0.0 if self.velocity is None else self.velocity(math.inf)
        return TractionModes(self.grid, spectrum, SCHEMES[self.config.time.integrator], last)

    @cached_property
    def error_control(self) -> Any:
        """The control of the error of adaptive steps; None with fixed steps."""
        tolerance = self.config.time.tolerance
        return None if tolerance is None else TractionControl(self.integrator, tolerance)

    @cached_property
    def solver(self) -> Any:
        """Newton's method for pressure and shear traction."""
        rough, attracts = self.config.punch.rough, self.interface.attracts
        return FrictionSolver(self.grid, self.transforms, rough=rough, attracts=attracts)

    @cached_property
    def motion(self) -> Motion:
        """Place of the punch, and the last tractions."""
        return Motion(self.grid.shape)

    @cached_property
    def _direction(self) -> FloatArray:
        return direction(self.config)

    @property
    def _is_frictionless(self) -> bool:
        """Whether the coefficient is zero: then the pressure is predicted as without friction."""
        law = self.programme.friction
        smooth = law is not None and law.is_frictionless and not self.programme.depends_on_speed
        return smooth and not self.interface.attracts

    @property
    def resumable(self) -> CompositeState:
        """All parts with a state."""
        return CompositeState(
            transforms=self.transforms,
            solver=self.solver,
            integrator=self.history,
            steps=self.steps,
            motion=self.motion,
            changes=self.changes,
            loading=self.loading,
            **({"guess": self.guess} if self._is_frictionless else {}),
            observables=CompositeState(**self.observables),
        )

    def run(self, recorder: Recorder, progress: Progress = None, resume: Resume = None) -> list[str]:
        """Press and shear, one time step after the other; see `gfmdlayer.simulate`."""
        history, control, observables = self.history, self.error_control, tuple(self.observables.values())
        ended = ""
        if resume is not None:
            resume(self.resumable)
        for instant in self.steps:
            try:
                found = self._attempt(instant)
            except SlidesAwayError as reason:
                ended = f"SLIDES AWAY at t = {instant.time:.6g}: {reason}"
                recorder.note(ended=ended, slide_time=instant.time)
                break
            problem, solution = self._as_contact(found, instant.time)
            lost = pulled_off(problem, solution)
            for observable in observables:
                observable.attempt(solution)
            surface = Surface(solution.displacement, solution.spectrum, found.depth, self._response(found))
            tractions = np.array([self.transforms.forward(field) for field in found.loads])
            if control is not None:
                control.moves(found.depth - self.motion.depth, float(np.linalg.norm(found.path)))
            prescribed = self.trajectory(instant.time)
            change = self.changes.over(prescribed, problem, solution, lost=lost)
            if self.steps.accepts(tractions, surface.response, found.depth, change):
                if lost:
                    force, _ = self._drive(instant.time, 0.0)
                    pushed = force is not None and bool(force.any())  # what no force moves may come back
                    if pushed or not self.loading.detach(instant.time, self.config.time.end):
                        ended = self._pulled_off(recorder, instant.time, prescribed)
                        break
                    found = self._attempt(instant)
                    problem, solution = self._as_contact(found, instant.time)
                    surface = Surface(solution.displacement, solution.spectrum, found.depth, found.depth)
                    tractions = np.zeros_like(tractions)
                shear = self._shear(found, instant)
                history.advance(tractions)
                self.motion.remember(instant, found)
                self.changes.remember(prescribed, problem, solution)
                if self._is_frictionless:
                    self.guess.remember(
                        instant.time, solution.pressure, solution.gap, at_breakpoint=instant.breakpoint
                    )
                step = AcceptedStep(instant.time, problem, solution, surface, self.integrator, {}, shear)
                if self._record(recorder, step, with_fields=instant.snapshot):
                    break
            if progress is not None:
                progress(instant.time)
        return self._end(recorder, ended)

    def _attempt(self, instant: Instant) -> frictional.Solution:
        """Solve a step; SlidesAwayError where the force is too large, ConvergenceError without a solution."""
        modes: TractionModes = self.integrator
        travelled = 0.0
        if self.velocity is not None:
            travelled = distance(self.velocity, instant.time) - distance(self.velocity, self.motion.time)
        modes.carry(travelled, *[0.0] * (len(self.grid.points) - 1))
        response, offset = modes.terms(self.programme.elapsed(instant))
        prescribed, by_depth = self.trajectory(instant.time), self.config.trajectory.control == "depth"
        interface = self._interface(instant.time)
        if self.loading.detached.covers(instant.time):
            prescribed = 0.0
        force, path = self._drive(instant.time, travelled)
        law, before = self.programme.friction, self._fields(modes.displacement[1:])
        assert law is not None
        if self.velocity is None:  # else the material moves through the edge
            before += self.motion.slip_until_touch(instant.step)
        problem = frictional.Problem(
            response,
            self.punch,
            law,
            load=None if by_depth else prescribed,
            depth=prescribed if by_depth else 0.0,
            force=force,
            path=path,
            offset=self._fields(offset),
            before=before,
            interface=interface,
        )
        lowest = float(problem.gap_at_rest.min())
        if not interface.attracts and (prescribed <= lowest if by_depth else prescribed <= 0):
            if force is not None and force.any():
                raise SlidesAwayError("a tangential force acts on a punch that does not touch")
            return _apart(problem, prescribed if by_depth else lowest)
        return self._slipped(problem, instant)

    def _interface(self, time: float) -> Interaction:
        """Return the interaction across the gap; none while a load has pulled the punch out of reach."""
        return HARD_WALL if self.loading.detached.covers(time) else self.interface.at(time)

    def _drive(self, time: float, travelled: float) -> tuple[FloatArray | None, FloatArray | None]:
        """Return the mean shear traction that is given, or the path of the punch in the step."""
        drive, given = self.programme.tangential, self.config.trajectory
        if drive is not None and given.tangential is not None:
            value = self._direction * drive(time)
            return (value, None) if given.tangential.control == "force" else (None, value - self.motion.moved)
        path = np.zeros(len(self.grid.points))
        path[0] = travelled * (1.0 if given.creepage is None else given.creepage)
        return None, path

    def _slipped(self, problem: frictional.Problem, instant: Instant) -> frictional.Solution:
        """Solve a step; a coefficient that depends on the slip speed is the one of the slip that is found."""
        start, tolerance = self.motion.guess(instant.step), self.config.solver.tolerance
        if self._is_frictionless:
            start = np.zeros_like(self.motion.tractions)
            start[0] = self.guess.at(instant.time)
        limit = min(LIMIT, self.config.solver.max_iterations)
        pairs, steps, before, mixing = 0.0, 0, self.solver.state(), Mixing(MIXED)
        for _ in range(_ROUNDS if self.programme.depends_on_speed else 1):
            if reason := problem.why_not_solvable():
                raise SlidesAwayError(reason.partition(": the punch")[0])
            found: frictional.Solution = self.solver.solve(
                problem, start, gap=self.motion.gap, tolerance=tolerance, limit=limit
            )
            pairs, steps = pairs + found.pairs, steps + found.iterations
            if not found.converged:
                break
            if not self.programme.depends_on_speed or not instant.step > 0:
                return replace(found, pairs=pairs, iterations=steps)
            least = (1 - _SETTLED * tolerance) * problem.law.bound(found.pressure)
            sticks = frictional.norms(found.traction) < least
            speed = np.where(sticks, 0.0, frictional.norms(found.slip)) / instant.step
            last, W = np.broadcast_to(problem.law.coefficient, speed.shape), _largest(problem, found)
            if self._settled(speed, last, _SETTLED * tolerance, W / instant.step, found.contact):
                return replace(found, pairs=pairs, iterations=steps)
            now = mixing.next(last, self._coefficients(found.pressure, speed, last, W / instant.step))
            law = Law(np.clip(now, *self.programme.coefficients), problem.law.strength)
            problem, start = replace(problem, law=law), found.tractions
        if found.converged:
            reason = self._why_not_settled(_largest(problem, found) / instant.step)
        elif pulled_off(*self._as_contact(found, instant.time)):
            return replace(found, pairs=pairs, iterations=steps)
        elif problem.force is not None and _at_the_limit(problem, found):
            raise SlidesAwayError("the tangential force is the largest one or above")
        else:
            reason = found.reason
        self.solver.restore(before)  # the state as a whole is then that before the step
        raise ConvergenceError(
            f"t = {instant.time:.6g}: {reason}", *self._as_contact(found, instant.time), instant.time
        )

    def _settled(
        self, speed: FloatArray, last: FloatArray, tolerance: float, unit: float, touching: BoolArray
    ) -> bool:
        """Whether the last coefficients are those of speeds within an error, tolerance times a unit."""
        errors = np.maximum(speed - tolerance * unit, 0.0), speed + tolerance * unit
        ends = np.array([self.programme.coefficient(each) for each in errors])
        off = np.maximum(last - ends.max(axis=0), ends.min(axis=0) - last)
        return bool((off[touching] <= tolerance * self.programme.coefficients[1]).all())

    def _why_not_settled(self, unit: float) -> str:
        """Return why a coefficient does not settle; the unit is the largest displacement over the step."""
        found = f"the coefficient of friction does not settle on the slip speed in {_ROUNDS} rounds"
        if (steep := self.programme.steepest_fall * unit) < 1:
            return found
        return (
            f"{found}: it falls {steep:.3g} times faster than the surface recoils in the step. From 1 on a "
            "step can have several states, as in stick-slip, between which inertia decides. Take a flatter "
            "table or longer steps"
        )

    def _coefficients(
        self, pressure: FloatArray, speed: FloatArray, last: FloatArray, unit: float
    ) -> FloatArray:
        """Return coefficients of speeds that yield: mu = f(speed - unit p/p_s (mu - last)) at each point."""
        # The unit is the largest displacement in the step. There is one mu if f does not fall steeply.
        per = pressure * (unit / max(float(pressure.max()), 1e-300))
        low, high = (np.full(speed.shape, each) for each in self.programme.coefficients)
        for _ in range(_HALVINGS):
            mu = 0.5 * (low + high)
            above = mu > self.programme.coefficient(np.maximum(speed - per * (mu - last), 0.0))
            low, high = np.where(above, low, mu), np.where(above, mu, high)
        return np.asarray(high)

    def _response(self, found: frictional.Solution) -> float:
        """Return what is not prescribed: the mean pressure, or the depth."""
        return float(found.stress.mean()) if self.config.trajectory.control == "depth" else found.depth

    def _as_contact(self, found: frictional.Solution, time: float) -> tuple[Problem, Solution]:
        """Return the normal contact of a step, with displacements upward, for the observables."""
        touching = found.contact
        gap = np.where(touching, 0.0, np.maximum(found.gap, 0.0))
        load = None if self.config.trajectory.control == "depth" else self.trajectory(time)
        count = math.prod(self.grid.spectral_shape)
        rest = np.zeros(count), np.zeros(count, dtype=np.complex128)
        height, interface = self.loading.height, self._interface(time)
        problem = Problem(*rest, self.punch - found.depth, load, height=height, interface=interface)
        up = -found.displacement[0]
        solution = Solution(
            displacement=up,
            pressure=found.stress,
            gap=gap,
            spectrum=self.transforms.forward(up),
            mean_pressure=float(found.stress.mean()),
            mean_gap=float(gap.mean()),
            contact_area=float(touching.mean()),
            residual=found.residual,
            transforms=round(found.pairs),
            iterations=found.iterations,
            converged=found.converged,
            released_energy=found.released_energy,
            margin=found.margin,
        )
        return problem, solution

    def _shear(self, found: frictional.Solution, instant: Instant) -> Shear:
        """Return shear tractions and slip of a step that has been accepted."""
        before = self.motion.tractions[1:]
        if self.integrator.phases is not None:
            spectra = (self.integrator.carried(self.transforms.forward(field)) for field in before)
            before = self._fields(np.array(list(spectra)))
        return Shear(
            traction=found.traction,
            force=float(self._direction @ found.traction.mean(axis=1)),
            mean_traction=0.5 * (before + found.traction),
            slip=found.slip,
            stick=found.stick,
            touching=found.contact,
            path=found.path,
            moved=self.motion.moved + found.path,
            duration=instant.step,
            stretch=0.0 if self.velocity is None else self._stretch(found),
        )

    def _stretch(self, found: frictional.Solution) -> float:
        """Return the mean of the shear traction times the derivative along x of the displacement."""
        one, other = (np.ravel(q) for q in self.grid.wavenumbers_x)
        # Of the shortest wave and its opposite, which the grid does not distinguish.
        slope = 0.5j * (one + other)
        spectra = [slope * self.transforms.forward(u) for u in found.displacement[1:]]
        return float((found.traction * self._fields(np.array(spectra))).sum(axis=0).mean())

    def _fields(self, spectra: ComplexArray) -> FloatArray:
        """Return the fields of unnormalised transforms."""
        return np.array([self.transforms.backward(each) for each in spectra]) / self.grid.size

    def _snapshot(self, recorder: Recorder, step: AcceptedStep) -> None:
        """Record the fields of a step, with shear traction and slip velocity, which is NaN apart."""
        shear, law = step.shear, step.problem.interface
        assert shear is not None
        slips = np.where(shear.stick, 0.0, shear.slip) / (shear.duration or math.inf)
        speeds = np.where(shear.touching, slips, np.nan)
        fields = [step.surface.displacement, step.solution.pressure, step.solution.gap]
        normal = [each.reshape(self.grid.shape) for each in fields]
        along = [
            [each.reshape(self.grid.shape) for each in fields] + [None] * (2 - len(fields))
            for fields in (shear.traction, speeds)
        ]
        traction = None
        if self.interface.attracts:
            traction = law.traction(step.solution.gap).reshape(self.grid.shape)
        recorder.snapshot(step.time, *normal, traction, None, *along[0], *along[1])


def _apart(problem: frictional.Problem, depth: float) -> frictional.Solution:
    """Return the state of a punch that does not touch."""
    axes, points = problem.response.normal.ndim, problem.heights.size
    offset = np.zeros((1 + axes, points)) if problem.offset is None else problem.offset
    path = np.zeros(axes) if problem.path is None else problem.path
    return frictional.Solution(
        pressure=np.zeros(points),
        traction=np.zeros((axes, points)),
        displacement=offset,
        gap=problem.gap_at_rest - depth,
        slip=problem.slip_at_rest - path[:, np.newaxis],
        depth=depth,
        path=path,
        stick=np.zeros(points, dtype=bool),
        residual=0.0,
        pairs=0.0,
        iterations=0,
        converged=True,
    )


def _largest(problem: frictional.Problem, found: frictional.Solution) -> float:
    """Return the largest displacement into the body under the tractions."""
    W = found.displacement[0] if problem.offset is None else found.displacement[0] - problem.offset[0]
    return float(W.max())


def _at_the_limit(problem: frictional.Problem, found: frictional.Solution) -> bool:
    """Whether the given force is the largest that the pressure of a state carries, or more."""
    assert problem.force is not None
    largest = float(problem.law.bound(found.pressure).mean())
    return float(np.linalg.norm(problem.force)) >= (1 - _SLIDES) * largest
