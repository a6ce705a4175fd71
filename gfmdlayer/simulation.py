"""A rigid punch pressed into a periodic viscoelastic surface: the parts of a case and the time loop.

The only module that knows all numerics. The time loop, `Case.run`, follows the pseudocode of Petrenko et al.
(2024); the numbers in its comments are their lines.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.body import Body, check_body, internal_variables
from gfmdlayer.body.inside import stack_of
from gfmdlayer.body.isolated import Isolated, isolated
from gfmdlayer.body.materials import PronySeries
from gfmdlayer.body.pair import Pair
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.config import Config
from gfmdlayer.contact.loading import Imprint, Loading, pulled_off
from gfmdlayer.contact.loss_stiffness import LossStiffnessSolver
from gfmdlayer.contact.prediction import PREDICTIONS, DisplacementPrediction
from gfmdlayer.contact.problem import Solver, solve_finer, why_not_converged
from gfmdlayer.contact.reach import Reach
from gfmdlayer.contact.solvers import SOLVERS
from gfmdlayer.files.tables import TableError
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import ALONE, MpiRanks, Ranks
from gfmdlayer.grid.slabs import SlabGrid, transforms_of
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.history.adaptive_steps import AdaptiveSteps, Changes, ErrorControl, Integrator, Steps
from gfmdlayer.history.inside import Interior, Springs
from gfmdlayer.history.modes import SCHEMES, Modes
from gfmdlayer.history.reduced_time import ReducedTime
from gfmdlayer.history.side_by_side import SideBySide
from gfmdlayer.history.sliding_modes import SlidingModes
from gfmdlayer.history.stack_modes import StackModes
from gfmdlayer.interface.law import Interaction
from gfmdlayer.model import ConvergenceError, make_body, series_of
from gfmdlayer.observables import AcceptedStep, Observable, observables, totals
from gfmdlayer.observables.contact_statistics import closed_gap
from gfmdlayer.programme import Programme
from gfmdlayer.punch.topography import fitting
from gfmdlayer.results.journal import Recorder
from gfmdlayer.results.schema import in_order
from gfmdlayer.resumable import CompositeState
from gfmdlayer.time_functions import Constant, Table, Trajectory

if TYPE_CHECKING:
    from gfmdlayer.contact.problem import Problem, Solution
    from gfmdlayer.model import Progress, Resume


class Parts(TypedDict, total=False):
    """Parts that may replace those from the configuration."""

    grid: Grid
    transforms: Transforms
    body: Body
    programme: Programme
    reduced_time: ReducedTime | None
    punch: FloatArray
    trajectory: Trajectory
    velocity: Constant | Table | None
    interface: Interaction
    loading: Loading
    integrator: Integrator
    steps: Steps
    solver: Solver
    guess: DisplacementPrediction
    observables: dict[str, Observable]


class Case:
    """The parts of one simulation, each made when it is first used; for one run.

    Parameters
    ----------
    config : Config
        The configuration.
    wisdom : str, optional
        FFTW wisdom, where the bits of another run are to be reproduced.
    threads : int
        Threads that the transforms of a large grid may use.
    ranks : Ranks
        The processes that compute the case together.
    **parts
        Parts in place of those that the configuration describes, see `Parts`: `Case(config, body=mine)`.
        The other parts are made to fit.

    Raises
    ------
    TypeError
        If there is no such part.
    TableError
        In the use of a part that comes from a file that cannot be used.

    Examples
    --------
    >>> case = gfmdlayer.Case(gfmdlayer.Config(name="a", grid={"points": 8}))
    >>> case.body.stiffness(case.grid.wavenumbers, 0.0).shape
    (5,)
    """

    def __init__(
        self,
        config: Config,
        wisdom: str | None = None,
        threads: int = 1,
        ranks: Ranks | None = None,
        **parts: Unpack[Parts],
    ) -> None:
        if unknown := parts.keys() - Parts.__annotations__.keys():
            raise TypeError(f"a case has no part {', '.join(sorted(unknown))}")
        if "body" in parts:
            check_body(parts["body"], "mean_stiffness")
        if config.friction and type(self) is Case:
            raise TypeError("a case with friction at the interface has other parts; use gfmdlayer.simulate")
        self.config, self._wisdom, self._threads, self._ranks = config, wisdom, threads, ranks or ALONE
        vars(self).update(parts)  # where the cached properties look first

    @cached_property
    def programme(self) -> Programme:
        """The imposed quantities over time; given parts replace those of the configuration."""
        given = vars(self)
        own = {name: given[name] for name in ("velocity", "interface", "reduced_time") if name in given}
        loading: Loading | None = given.get("loading")
        return Programme(self.config, given.get("trajectory", loading and loading.trajectory), **own)

    @cached_property
    def grid(self) -> Grid:
        """The periodic grid; of several ranks, this process holds a part of it."""
        points, period = self.config.grid.points, self.config.grid.period
        if isinstance(self._ranks, MpiRanks):
            return SlabGrid(points, period, members=self._ranks)
        return Grid(points, period)

    @cached_property
    def transforms(self) -> Transforms:
        """Fourier transforms of the grid."""
        return transforms_of(self.grid, self._wisdom, self._threads)

    @cached_property
    def body(self) -> Body:
        """The body under the surface."""
        return make_body(self.config, self.series)

    @cached_property
    def isolated(self) -> Isolated | None:
        """The body as it answers in the cell of an isolated contact; None in a periodic one."""
        given = self.config.grid
        return isolated(self.body, given.period, given.datum) if given.isolated else None

    @cached_property
    def reach(self) -> Reach | None:
        """The pressed part of the surface in an isolated contact; None in a periodic one."""
        return None if self.isolated is None else Reach(self.grid, self.isolated)

    @cached_property
    def series(self) -> tuple[PronySeries, ...]:
        """The laws of layers and halfspace as series of Maxwell branches, over the times of the run."""
        return series_of(self.programme, float(np.abs(self.grid.wavevectors[0]).max()))

    @property
    def reduced_time(self) -> ReducedTime | None:
        """The reduced time in which the whole body relaxes; None where it has none."""
        return self.programme.reduced_time

    @property
    def reduced_times(self) -> tuple[ReducedTime | None, ...]:
        """The reduced time of each of the laws; None for one whose times do not change."""
        return self.programme.reduced_times

    @cached_property
    def punch(self) -> FloatArray:
        """Height of the punch above its lowest point, one value a point; TableError from an unusable file."""
        with self.grid.ranks.agreeing(TableError):
            return np.ravel(fitting("the punch", self.config.punch.heights(self.grid), self.grid.shape))

    @property
    def trajectory(self) -> Trajectory:
        """Prescribed depth or mean pressure over time."""
        return self.programme.drive

    @property
    def velocity(self) -> Constant | Table | None:
        """Velocity of the punch along x over time; None where it rests."""
        return self.programme.velocity

    @property
    def interface(self) -> Interaction:
        """Interaction of surface and punch across the gap, beside the hard wall."""
        return self.programme.interface

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times at which the slope of an imposed quantity jumps."""
        return self.programme.breakpoints

    @cached_property
    def loading(self) -> Loading:
        """The punch under its prescribed depth or load."""
        by_depth = self.config.trajectory.control == "depth"
        return Loading(self.punch, self.trajectory, self.interface, self.grid.ranks, by_depth)

    @cached_property
    def imprint(self) -> Imprint:
        """The height that the surfaces have lost."""
        return Imprint(math.prod(self.grid.shape), self.config.hardness or math.inf)

    @cached_property
    def integrator(self) -> Integrator:
        """The time integrator over the relaxing modes of the body.

        Backward Euler over them is the paper's Eq. (24) by backward differences, to rounding and for any
        material; see `verification.crosschecks` for the equation itself.
        """
        given, waves, sums = self.config.time, self.grid.waves, self.grid.sums
        scheme, reduced = SCHEMES[given.integrator], self.reduced_time
        if reduced is None and any(self.reduced_times):
            internal = internal_variables(self.body, waves)
            adaptive = given.step == "adaptive"
            return StackModes(internal, scheme, sums, reduced_times=self.reduced_times, halved=adaptive)
        check_body(self.body, "spectrum")
        if isinstance(self.body, Pair) and self.isolated is None:
            second = self.config.counterbody
            ratio = 0.0 if second is None else second.velocity_ratio or 0.0
            one, two = (each.spectrum(waves) for each in (self.body.first, self.body.second))
            return SideBySide((self._modes(one), self._modes(two, ratio)), sums, ratio)
        return self._modes((self.isolated or self.body).spectrum(waves))

    def _modes(self, spectrum: Spectrum, ratio: float = 1.0) -> Modes:
        """Return the history of one body, along which the contact moves at `ratio` times the velocity."""
        scheme, sums, reduced = SCHEMES[self.config.time.integrator], self.grid.sums, self.reduced_time
        if self.velocity is None or ratio == 0:
            return Modes(spectrum, scheme, sums)
        velocity = self.velocity if reduced is None else self.velocity.in_time(reduced.factor(0.0))
        if ratio != 1:
            velocity = velocity.scaled(ratio)
        return SlidingModes(spectrum, sums, wavenumbers_x=self.grid.wavenumbers_x, velocity=velocity)

    @cached_property
    def error_control(self) -> ErrorControl | None:
        """The control of the integrator's error; None with fixed steps."""
        tolerance, curved = self.config.time.tolerance, self.interface.attracts and self.velocity is None
        if tolerance is None:
            return None
        return ErrorControl(self.integrator, self.grid.sums, tolerance, curved=curved)

    @property
    def history(self) -> Integrator | ErrorControl:
        """The integrator, under its error control where the steps are adaptive."""
        return self.error_control or self.integrator

    @cached_property
    def steps(self) -> Steps:
        """The time points; backward Euler takes the paper's equal steps, others land on the breakpoints."""
        if self.error_control is None:
            return self.programme.fixed_steps()
        slowdown = 1.0 if self.reduced_time is None else self.reduced_time.factor(0.0)
        reach = self.interface.range if self.interface.attracts else 0.0
        least = reach if self.config.trajectory.control != "depth" else 0.0, reach
        return AdaptiveSteps(self.error_control, self.programme.landings, slowdown=slowdown, least=least)

    @cached_property
    def changes(self) -> Changes:
        """Change of gap and drive over a step, where the interface attracts."""
        return Changes(self.interface, self.grid.sums)

    @cached_property
    def solver(self) -> Solver:
        """Solver of the contact problem, within the iterations for a loss stiffness."""
        inertia, attracts = self.config.solver.inertia, self.interface.attracts
        declared = SOLVERS[self.config.solver_where(attracts).method]
        options: dict[str, object] = {"grid": self.grid} if declared.distributed else {}
        if inertia is not None:
            start = "gap" if attracts else "displacement"
            options |= {"mass_weighted": inertia == "mass_weighted", "starts_from": start}
        solver: Solver = declared.load()(self.transforms, **options)
        if self.velocity is None or declared.nonsymmetric:
            return solver
        return LossStiffnessSolver(solver, self.transforms, self.grid.parseval_weights)

    @cached_property
    def finer_tolerance(self) -> float:
        """Residual that the solver aims at."""
        given = self.config.solver.tolerance
        return given if self.interface.attracts else self.config.finer_tolerance

    def solve(self, problem: Problem, time: float) -> Solution:
        """Solve a contact problem from the guess for its time."""
        given, start = self.config.solver, self.guess.at(time)
        finer = self.finer_tolerance
        return solve_finer(self.solver, problem, start, finer, given.tolerance, given.max_iterations)

    @cached_property
    def guess(self) -> DisplacementPrediction:
        """Extrapolation in time from which the solver starts."""
        return PREDICTIONS[self.solver.starts_from](math.prod(self.grid.shape), self.grid.ranks)

    @cached_property
    def interior(self) -> Interior | None:
        """The fields below the surface, where the configuration asks for them."""
        given = self.config.output.inside
        if given is None:
            return None
        if (stack := stack_of(self.body)) is None:
            kind = type(self.body).__name__
            raise TypeError(f"output.inside: a {kind} has no layers; must be a LayerStack")
        places = given.places(self.config.solid, self.config.grid.period)
        return Interior(stack, self.grid, places, self.body.spectrum)

    def springs(self, step: AcceptedStep) -> Springs:
        """Return strains and forces below the surface of the step that was accepted last."""
        if self._springs is None or self._springs[0] is not step:
            assert self.interior is not None
            pressure = self.transforms.forward(step.solution.pressure)
            self._springs = step, self.interior.springs(self.integrator, pressure)
        return self._springs[1]

    _springs: tuple[AcceptedStep, Springs] | None = None

    @cached_property
    def observables(self) -> dict[str, Observable]:
        """Observables of each accepted step, by name."""
        return observables(self)

    @property
    def resumable(self) -> CompositeState:
        """All parts with a state."""
        # The transforms first: the solver uses their plans when it is restored.
        of_isolated = {} if self.reach is None else {"reach": self.reach}
        return CompositeState(
            transforms=self.transforms,
            solver=self.solver,
            integrator=self.history,
            steps=self.steps,
            guess=self.guess,
            changes=self.changes,
            loading=self.loading,
            imprint=self.imprint,
            observables=CompositeState(**self.observables),
            **of_isolated,
        )

    def run(self, recorder: Recorder, progress: Progress = None, resume: Resume = None) -> list[str]:
        """Press the punch into the surface, one time step after the other; see `gfmdlayer.simulate`."""
        loading, history, steps, solver, guess = (
            self.loading, self.history, self.steps, self.solver, self.guess,
        )  # fmt: skip
        observables, ended = tuple(self.observables.values()), ""
        if resume is not None:
            resume(self.resumable)

        for instant in steps:  # 4, 10
            kappa, b = history.terms(self.programme.elapsed(instant))  # 5, 6
            problem, solution = self._solved(kappa, b, instant.time)  # 0, 7
            lost = pulled_off(problem, solution)
            for observable in observables:
                observable.attempt(solution)
            surface = loading.surface(solution, kappa, b, instant.time)
            prescribed = loading.trajectory(instant.time)
            change = self.changes.over(prescribed, problem, solution, lost=lost)
            if steps.accepts(surface.spectrum, surface.response, surface.depth, change):
                if lost:
                    if not loading.detach(instant.time, self.config.time.end):
                        ended = self._pulled_off(recorder, instant.time, prescribed)
                        break
                    problem, solution = self._solved(kappa, b, instant.time)
                    surface = loading.surface(solution, kappa, b, instant.time)
                history.advance(surface.spectrum)  # 8, 9
                guess.remember(
                    instant.time,
                    getattr(solution, solver.starts_from),
                    solution.gap,
                    at_breakpoint=instant.breakpoint,
                )
                self.changes.remember(prescribed, problem, solution)
                self.imprint.remember(solution)
                if self.reach is not None:
                    self.reach.remember(solution.pressure)
                step = AcceptedStep(instant.time, problem, solution, surface, self.integrator, {})
                if self._record(recorder, step, with_fields=instant.snapshot):
                    break
                del step
            del kappa, b, problem, solution, surface  # the next step needs their memory
            if progress is not None:
                progress(instant.time)
        return self._end(recorder, ended)

    def _record(self, recorder: Recorder, step: AcceptedStep, *, with_fields: bool) -> bool:
        """Record row and perhaps fields of an accepted step; return whether the run has settled."""
        settled = False
        for observable in self.observables.values():
            step.row |= observable.measure(step)
            settled = settled or observable.finished
        recorder.row(**self._recorded(step.row))
        if with_fields or settled or self.config.output.snapshots == "every":
            self._snapshot(recorder, step)
        return settled

    def _pulled_off(self, recorder: Recorder, time: float, load: float) -> str:
        """Note that the run ends since a load has pulled the punch off, and return the words."""
        ended = f"PULLED OFF at t = {time:.6g}: no contact carries the load of {load:.6g}"
        recorder.note(ended=ended, pull_off_time=time)
        return ended

    def _end(self, recorder: Recorder, ended: str) -> list[str]:
        """Note the attributes of the observables; return why the run ended early, and their warnings."""
        observables = self.observables.values()
        for observable in observables:
            if observable.attributes:
                recorder.note(**self._recorded(observable.attributes))
        return [*filter(None, [ended]), *(each.warning for each in observables if each.warning)]

    def _snapshot(self, recorder: Recorder, step: AcceptedStep) -> None:
        """Record the fields of a step, some only with attraction, a hardness or a counterbody."""
        gap, displacement = closed_gap(step.problem, step.solution), step.surface.displacement
        pressure = step.solution.pressure
        fields: dict[str, Any] = {"displacement": displacement, "pressure": pressure, "gap": gap}
        if self.interface.attracts:
            fields["traction"] = step.problem.interface.traction(gap)
        if self.imprint.yields:
            fields["imprint"] = self.imprint.depth
        if self.config.two_bodies:
            assert isinstance(self.integrator, SideBySide)
            for name, each in zip(("body", "counterbody"), self.integrator.bodies, strict=True):
                fields[f"displacement_{name}"] = self.transforms.backward(each.u) / self.grid.size
        if self.reach is not None:
            fields |= {name: self.reach.masked(fields[name]) for name in ("displacement", "gap")}
        fields = {name: field.reshape(self.grid.shape) for name, field in fields.items()}
        given = self.config.output.inside
        if self.interior is not None and given is not None and given.wants(step.time):
            fields |= self.interior.recorded(self.springs(step))
        recorder.snapshot(step.time, *in_order(fields))

    def _recorded(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return columns or attributes of the observables, those of an isolated contact as totals."""
        return dict(values) if self.isolated is None else totals(values, math.prod(self.grid.period))

    def _solved(self, kappa: FloatArray, b: ComplexArray, time: float) -> tuple[Problem, Solution]:
        """Solve the contact problem of a step; ConvergenceError unless solved within reach, or pulled off."""
        problem = self.loading.problem(kappa, b, time, loss_stiffness=self.integrator.loss_stiffness)
        problem = self.imprint.under(problem)
        before, given = self.solver.state(), self.config.solver
        solution = self.solve(problem, time)
        if not solution.converged and not pulled_off(problem, solution):
            self.solver.restore(before)  # the state as a whole is then that before the step
            reason = why_not_converged(problem, solution, self.config.contact_solver.method, given.tolerance)
            raise ConvergenceError(f"t = {time:.6g}: {reason}", problem, solution, time)
        beyond = self.reach and solution.converged and self.reach.refusal(solution.pressure)
        if beyond:
            self.solver.restore(before)
            raise ConvergenceError(f"t = {time:.6g}: {beyond}", problem, solution, time)
        return problem, solution
