"""The time loop: indentation of a viscoelastic body by a rigid punch, after Petrenko et al. (2024).

The numbers in the comments of `simulate` are the lines of their pseudocode.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.case import Case
from gfmdlayer.config import Config
from gfmdlayer.contact.loading import pulled_off
from gfmdlayer.contact.problem import why_not_converged
from gfmdlayer.observables import AcceptedStep
from gfmdlayer.observables.distributions import closed_gap
from gfmdlayer.results.journal import Recorder
from gfmdlayer.resumable import CompositeState

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.contact.problem import Problem, Solution


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
    loading, integrator, steps, solver, guess = (
        case.loading, case.integrator, case.steps, case.solver, case.guess,
    )  # fmt: skip
    shape, observables = case.grid.shape, tuple(case.observables.values())
    keeps_all, ended = case.config.output.snapshots == "every", ""
    if resume is not None:
        resume(case.resumable)

    for instant in steps:  # 4, 10
        kappa, b = integrator.terms(case.elapsed(instant))  # 5, 6
        problem, solution = _solved(case, kappa, b, instant.time)  # 0, 7
        lost = pulled_off(problem, solution)
        for observable in observables:
            observable.attempt(solution)
        surface = loading.surface(solution, kappa, b, instant.time)
        prescribed = loading.trajectory(instant.time)
        change = case.changes.over(prescribed, problem, solution, lost=lost)
        if steps.accepts(surface.spectrum, surface.response, surface.depth, change):
            if lost:
                if not loading.lose(instant.time, case.config.time.end):
                    ended = (
                        f"PULLED OFF at t = {instant.time:.6g}: nothing holds the load of {prescribed:.6g}"
                    )
                    recorder.note(ended=ended, pull_off_time=instant.time)
                    break
                problem, solution = _solved(case, kappa, b, instant.time)
                surface = loading.surface(solution, kappa, b, instant.time)
            integrator.advance(surface.spectrum)  # 8, 9
            guess.remember(
                instant.time, getattr(solution, solver.starts_from), solution.gap, kink=instant.kink
            )
            case.changes.remember(prescribed, problem, solution)
            row: dict[str, float | FloatArray] = {}
            step, finished = AcceptedStep(instant.time, problem, solution, surface, integrator, row), False
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
    solution = case.solver.solve(problem, case.guess.at(time))
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
