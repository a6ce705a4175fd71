"""The parts of a simulation, as a configuration asks for them; the only module that knows all numerics."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import TYPE_CHECKING, TypedDict, Unpack

from gfmdlayer import inputs
from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.body import Body, internal_variables
from gfmdlayer.body.materials import PronySeries
from gfmdlayer.config import Config
from gfmdlayer.config.stops import output_times, stops
from gfmdlayer.contact.loading import CONTROLS, Loading, pulled_off
from gfmdlayer.contact.loss_stiffness import LossStiffnessSolver
from gfmdlayer.contact.prediction import PREDICTIONS, DisplacementPrediction
from gfmdlayer.contact.problem import Solver, solve_finer, why_not_converged
from gfmdlayer.contact.solvers import SOLVERS
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.grid.slab_transforms import transforms_of
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.history.adaptive_steps import AdaptiveSteps
from gfmdlayer.history.error_control import ErrorControl, Integrator
from gfmdlayer.history.instabilities import Changes
from gfmdlayer.history.modes import SCHEMES, Modes
from gfmdlayer.history.reduced_time import ReducedTime
from gfmdlayer.history.sliding_modes import SlidingModes
from gfmdlayer.history.stack_modes import StackModes
from gfmdlayer.history.time_points import FixedSteps, Instant, Steps, equal_steps, landing_steps
from gfmdlayer.interface.law import InterfaceLaw
from gfmdlayer.observables import AcceptedStep, Observable, observables
from gfmdlayer.observables.contact_statistics import closed_gap
from gfmdlayer.results.journal import Recorder
from gfmdlayer.resumable import CompositeState
from gfmdlayer.time_functions import Constant, Table, Trajectory

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.contact.problem import Problem, Solution
    from gfmdlayer.indentation.isolated import IsolatedIndentation


class Parts(TypedDict, total=False):
    """Parts that may be given in place of those of the configuration."""

    grid: Grid
    transforms: Transforms
    body: Body
    reduced_time: ReducedTime | None
    punch: FloatArray
    trajectory: Trajectory
    velocity: Constant | Table | None
    interface: InterfaceLaw
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
    >>> case.body.stiffness(case.grid.waves, 0.0).shape
    (5,)
    """

    def __init__(
        self,
        config: Config,
        wisdom: str | None = None,
        threads: int = 1,
        ranks: Ranks = ALONE,
        **parts: Unpack[Parts],
    ) -> None:
        if unknown := parts.keys() - Parts.__annotations__.keys():
            raise TypeError(f"a case has no part {', '.join(sorted(unknown))}")
        self.config, self._wisdom, self._threads, self._ranks = config, wisdom, threads, ranks
        vars(self).update(parts)  # where the cached properties look first

    @cached_property
    def grid(self) -> Grid:
        """The periodic grid."""
        return inputs.make_grid(self.config, self._ranks)

    @property
    def coordinates(self) -> dict[str, FloatArray]:
        """Coordinates of the snapshots by name: x, and y of a surface in two directions.

        Those of an isolated, axisymmetric contact lie along x from its axis.
        """
        whole = Grid(self.grid.points, self.grid.period)  # also where this process holds a part
        axes = (self.indentation.radii,) if self.config.grid.axisymmetric else whole.coordinates
        return dict(zip("xy", axes, strict=False))

    @cached_property
    def indentation(self) -> IsolatedIndentation:
        """The isolated contact of an indenter of revolution."""
        from gfmdlayer.indentation.isolated import IsolatedIndentation

        return IsolatedIndentation.of(self.config, self.body, self.trajectory, output_times(self.config))

    @cached_property
    def transforms(self) -> Transforms:
        """Fourier transforms of the grid."""
        return transforms_of(self.grid, self._wisdom, self._threads)

    @cached_property
    def body(self) -> Body:
        """The body under the surface."""
        return inputs.make_body(self.config, [series.material for series in self.series])

    @cached_property
    def series(self) -> tuple[PronySeries, ...]:
        """The laws of layers and halfspace as series of Maxwell branches, over the times of the run."""
        grid, every = self.grid, zip(self.config.laws, self.clocks, strict=True)
        times = partial(inputs.times_of_response, self.config, grid, self.velocity, self.kinks)
        return tuple(law.prony(*times(clock)) for law, clock in every)

    @cached_property
    def reduced_time(self) -> ReducedTime | None:
        """The reduced time in which the whole body relaxes; None where it has none."""
        return inputs.make_reduced_time(self.config)

    @cached_property
    def clocks(self) -> tuple[ReducedTime | None, ...]:
        """The reduced time of each of the laws; None for one whose times do not change."""
        common = self.reduced_time
        return inputs.make_clocks(self.config) if common is None else (common,) * len(self.config.laws)

    def elapsed(self, instant: Instant) -> float:
        """Return the length of the step to a time point, in the reduced time of the body where it has one."""
        reduced = self.reduced_time
        return instant.step if reduced is None else reduced.step(instant.time - instant.step, instant.step)

    @cached_property
    def punch(self) -> FloatArray:
        """Height of the punch above its lowest point, one value a point."""
        return inputs.make_punch(self.config, self.grid)

    @cached_property
    def trajectory(self) -> Trajectory:
        """Prescribed depth or mean pressure over time."""
        return inputs.make_trajectory(self.config)

    @cached_property
    def velocity(self) -> Constant | Table | None:
        """Velocity of the punch along x over time; None where it stays."""
        return inputs.make_velocity(self.config)

    @cached_property
    def interface(self) -> InterfaceLaw:
        """Interaction of surface and punch across the gap, beside the hard wall."""
        return inputs.make_interface(self.config)

    @cached_property
    def kinks(self) -> tuple[float, ...]:
        """Times at which the slope of a prescribed quantity jumps."""
        trajectory = self.trajectory if self.config.grid.axisymmetric else self.loading.trajectory
        return inputs.kinks(self.clocks, trajectory, self.velocity, self.interface)

    @cached_property
    def loading(self) -> Loading:
        """The punch under its prescribed depth or load."""
        return CONTROLS[self.config.trajectory.control](
            self.punch, self.trajectory, self.interface, self.grid.ranks
        )

    @cached_property
    def integrator(self) -> Integrator:
        """The time integrator over the relaxing modes of the body.

        Backward Euler over them is the paper's Eq. (24) by backward differences, to rounding and for any
        material; see `verification.third_order` for the equation itself.
        """
        given, waves, sums = self.config.time, self.grid.waves, self.grid.sums
        scheme, reduced = SCHEMES[given.integrator], self.reduced_time
        if reduced is None and any(self.clocks):
            internal = internal_variables(self.body, waves)
            adaptive = given.step == "adaptive"
            return StackModes(internal, scheme, sums, reduced_times=self.clocks, halved=adaptive)
        spectrum = self.body.spectrum(waves)
        if self.velocity is None:
            return Modes(spectrum, scheme, sums)
        velocity = self.velocity if reduced is None else self.velocity.in_time(reduced.factor(0.0))
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
        """The time points; backward Euler takes the paper's equal steps, others land on the kinks."""
        time, snapshots = self.config.time, self.config.output.snapshot_times
        if self.error_control is None:
            step, points = float(time.step), stops(self.config, self.kinks)
            steps = equal_steps if time.integrator == "backward_euler" else landing_steps
            return FixedSteps(steps(time.end, step, snapshots, self.kinks), points, step)
        slowdown = 1.0 if self.reduced_time is None else self.reduced_time.factor(0.0)
        reach = self.interface.range if self.interface.attracts else 0.0
        least = reach if self.config.trajectory.control != "depth" else 0.0, reach
        return AdaptiveSteps(
            self.error_control, stops(self.config, self.kinks), slowdown=slowdown, least=least
        )

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
    def observables(self) -> dict[str, Observable]:
        """Observables of each accepted step, by name."""
        return observables(self)

    @property
    def resumable(self) -> CompositeState:
        """All parts with a state."""
        # The transforms first: the solver uses their plans when it is restored.
        return CompositeState(
            transforms=self.transforms,
            solver=self.solver,
            integrator=self.history,
            steps=self.steps,
            guess=self.guess,
            changes=self.changes,
            loading=self.loading,
            observables=CompositeState(**self.observables),
        )


# The time loop: indentation of a viscoelastic body by a rigid punch, after Petrenko et al. (2024).
#
# The numbers in the comments of `simulate` are the lines of their pseudocode.


class ConvergenceError(RuntimeError):
    """A contact problem was not solved to the solver's tolerance.

    Attributes
    ----------
    problem : Problem or None
        The contact problem.
    solution : Solution or None
        The last state of the solver, whose residual is too large.
    time : float
        Simulated time of the step.
    data : xarray.Dataset or None
        From `gfmdlayer.run`: the steps before.

    Examples
    --------
    >>> try:
    ...     gfmdlayer.run({"grid": {"points": 256}, "solver": {"method": "fire", "max_iterations": 20}})
    ... except gfmdlayer.ConvergenceError as error:
    ...     print(error.solution.residual > 1e-6, error.data.sizes["time"])
    True 1
    """

    def __init__(
        self,
        message: str,
        problem: Problem | None = None,
        solution: Solution | None = None,
        time: float = math.nan,
    ) -> None:
        super().__init__(message)
        self.problem, self.solution, self.time = problem, solution, time
        self.data: xarray.Dataset | None = None


def simulate(
    config: Config | Case,
    recorder: Recorder,
    progress: Callable[[float], None] | None = None,
    wisdom: str | None = None,
    threads: int = 1,
    resume: Callable[[CompositeState], None] | None = None,
) -> list[str]:
    """Run one case.

    Parameters
    ----------
    config : Config or Case
        The configuration, or the parts of one simulation, where some are one's own; a `Case` runs once and
        has wisdom and threads of its own.
    recorder : Recorder
        Records a row for each time step, the first at t = 0, and the snapshots.
    progress : callable, optional
        Called with the simulated time after each attempt at a step; may raise to stop.
    wisdom : str, optional
        FFTW wisdom, where the bits of another run are to be reproduced.
    threads : int
        Threads that the transforms of a large grid may use.
    resume : callable, optional
        Called once before the first step with all resumable state: may restore the state of a run of the
        same case, which then goes on bit for bit, and may save the state whenever `progress` is called.

    Returns
    -------
    list of str
        Why the run ended early, if so, and warnings of the observables, such as that no steady state was
        reached.

    Raises
    ------
    ConvergenceError
        If a step does not reach the solver's tolerance; the state to save is then that before the step.
    TableError
        If the file of a punch or a trajectory cannot be used.

    Examples
    --------
    A recorder is called with each row:

    >>> class Printer:
    ...     def row(self, **values):
    ...         print(values["time"], values["depth"])
    ...
    ...     def snapshot(self, time, displacement, pressure, gap): ...
    ...
    ...     def note(self, **attributes): ...
    >>> config = gfmdlayer.Config(name="a", grid={"points": 1024}, time={"end": 1.0, "step": 0.5})
    >>> gfmdlayer.simulate(config, Printer())
    0.0 0.0
    0.5 0.005
    1.0 0.01
    []
    """
    case = config if isinstance(config, Case) else Case(config, wisdom, threads)
    if case.config.grid.axisymmetric:
        return _indent(case, recorder, progress, resume)
    loading, history, steps, solver, guess = (
        case.loading, case.history, case.steps, case.solver, case.guess,
    )  # fmt: skip
    shape, observables = case.grid.shape, tuple(case.observables.values())
    keeps_all, ended = case.config.output.snapshots == "every", ""
    if resume is not None:
        resume(case.resumable)

    for instant in steps:  # 4, 10
        kappa, b = history.terms(case.elapsed(instant))  # 5, 6
        problem, solution = _solved(case, kappa, b, instant.time)  # 0, 7
        lost = pulled_off(problem, solution)
        for observable in observables:
            observable.attempt(solution)
        surface = loading.surface(solution, kappa, b, instant.time)
        prescribed = loading.trajectory(instant.time)
        change = case.changes.over(prescribed, problem, solution, lost=lost)
        if steps.accepts(surface.spectrum, surface.response, surface.depth, change):
            if lost:
                if not loading.detach(instant.time, case.config.time.end):
                    ended = (
                        f"PULLED OFF at t = {instant.time:.6g}: nothing holds the load of {prescribed:.6g}"
                    )
                    recorder.note(ended=ended, pull_off_time=instant.time)
                    break
                problem, solution = _solved(case, kappa, b, instant.time)
                surface = loading.surface(solution, kappa, b, instant.time)
            history.advance(surface.spectrum)  # 8, 9
            guess.remember(
                instant.time, getattr(solution, solver.starts_from), solution.gap, kink=instant.kink
            )
            case.changes.remember(prescribed, problem, solution)
            row: dict[str, float | FloatArray] = {}
            step = AcceptedStep(instant.time, problem, solution, surface, case.integrator, row)
            finished = False
            for observable in observables:
                row |= observable.measure(step)
                finished = finished or observable.finished
            recorder.row(**row)
            if instant.snapshot or finished or keeps_all:
                fields = [surface.displacement, solution.pressure, closed_gap(problem, solution)]
                fields += [problem.interface.traction(fields[-1])] if case.interface.attracts else []
                recorder.snapshot(instant.time, *(field.reshape(shape) for field in fields))
            if finished:
                break
            del step, row
        del kappa, b, problem, solution, surface  # the next step needs their memory
        if progress is not None:
            progress(instant.time)
    for observable in observables:
        if observable.attributes:
            recorder.note(**observable.attributes)
    return [*filter(None, [ended]), *(each.warning for each in observables if each.warning)]


def _solved(case: Case, kappa: FloatArray, b: ComplexArray, time: float) -> tuple[Problem, Solution]:
    """Solve the contact problem of a step.

    Raises
    ------
    ConvergenceError
        If the solver's tolerance is not reached, and not for want of an equilibrium.
    """
    problem = case.loading.problem(kappa, b, time, loss_stiffness=case.integrator.loss_stiffness)
    before, given = case.solver.state(), case.config.solver
    solution = case.solve(problem, time)
    if not solution.converged and not pulled_off(problem, solution):
        case.solver.restore(before)  # the state as a whole is then that before the step
        reason = why_not_converged(problem, solution, case.config.contact_solver.method, given.tolerance)
        raise ConvergenceError(f"t = {time:.6g}: {reason}", problem, solution, time)
    return problem, solution


def _indent(
    case: Case,
    recorder: Recorder,
    progress: Callable[[float], None] | None,
    resume: Callable[[CompositeState], None] | None,
) -> list[str]:
    """Run a case of one isolated indenter: as a whole, in less time than a checkpoint takes.

    Parameters
    ----------
    case : Case
        With grid.geometry: axisymmetric.
    recorder, progress, resume
        As in `simulate`. `progress` is called before the first row alone: a run that is stopped has none.

    Raises
    ------
    ConvergenceError
        If the tolerance is not reached.
    """
    if resume is not None:
        resume(CompositeState())
    if progress is not None:
        progress(0.0)
    run = case.indentation
    try:
        solved = run.solved
    except ArithmeticError as error:
        raise ConvergenceError(str(error)) from error
    for row in run.rows():
        recorder.row(**row)
    if run.snapshots:
        kept = run.profiles()
        for snapshot in zip(kept.time.tolist(), kept.displacement, kept.pressure, kept.gap, strict=True):
            recorder.snapshot(*snapshot)
    recorder.note(error=solved.error, solutions=solved.solutions)
    return run.warnings
