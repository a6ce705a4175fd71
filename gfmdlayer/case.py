"""The parts of a simulation, as a configuration asks for them: what alone knows all of the numerics."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Protocol

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.relaxation import relaxation_spectrum
from gfmdlayer.config import Config
from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.contact.conjugate_gradient import ConjugateGradient
from gfmdlayer.contact.fire import Fire
from gfmdlayer.contact.loading import CONTROLS, Loading
from gfmdlayer.contact.loss_stiffness import SHARE, LossStiffnessSolver
from gfmdlayer.contact.problem import Solver
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.history.adaptive_steps import AdaptiveSteps
from gfmdlayer.history.error_control import ErrorControlledModes
from gfmdlayer.history.modes import SCHEMES, Modes
from gfmdlayer.history.sliding_modes import ErrorControlledSlidingModes, SlidingModes
from gfmdlayer.history.time_points import FixedSteps, Instant, equal_steps, landing_steps
from gfmdlayer.inputs import make_body, make_grid, make_punch, make_trajectory, make_velocity
from gfmdlayer.observables.energy_balance import Energy
from gfmdlayer.observables.steady_state import SteadyState
from gfmdlayer.resumable import Resumable

SOLVERS: dict[str, type[ActiveSet | ConjugateGradient]] = {
    "active_set": ActiveSet,
    "conjugate_gradient": ConjugateGradient,
}


class Integrator(Energy, Resumable, Protocol):
    """From the history to the slopes and intercepts of the stress."""

    @property
    def loss_stiffness(self) -> FloatArray | None:
        """Imaginary part of the slopes at the end of a step; none where the punch does not move."""
        ...

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b at the end of a step of this length."""
        ...

    def advance(self, spectrum: ComplexArray) -> None:
        """Carry the history on with the accepted displacement."""
        ...


class Steps(Resumable, Protocol):
    """The time points of a run."""

    def __iter__(self) -> Iterator[Instant]:
        """Give them in order; one that was not accepted is followed by an earlier one."""
        ...

    def accepts(self, spectrum: ComplexArray, found: float, depth: float) -> bool:
        """Judge the step by the displacement, by what the contact problem was solved for, and the depth."""
        ...


def make_solver(
    config: Config, transforms: Transforms, tolerance: float | None = None, max_iterations: int | None = None
) -> Solver:
    """The solver of the contact problem; under a moving punch, one that knows of drag.

    Other limits than the configuration's may be given.
    """
    given, moves = config.solver, make_velocity(config) is not None
    within = given.tolerance if tolerance is None else tolerance
    iterations = given.max_iterations if max_iterations is None else max_iterations
    limits = SHARE * within if moves else within, iterations
    solver: Solver
    if given.method == "fire":
        solver = Fire(transforms, *limits, mass_weighted=given.inertia == "mass_weighted")
    else:
        solver = SOLVERS[given.method](transforms, *limits)
    return (
        LossStiffnessSolver(solver, transforms, within, make_grid(config).parseval_weights)
        if moves
        else solver
    )


def make_integrator(config: Config, grid: Grid) -> Integrator:
    """The time integrator, over the body's relaxing modes.

    Backward Euler over them is the paper's Eq. (24) by backward differences, to rounding and for any
    material; see `stepping.third_order` for the equation itself.
    """
    q, measure = grid.wavenumbers, grid.parseval_weights
    spectrum = relaxation_spectrum(make_body(config), config.layer.material, q)
    velocity = make_velocity(config)
    if velocity is not None:
        if config.time.step == "adaptive":
            return ErrorControlledSlidingModes(
                spectrum, measure, wavenumbers_x=grid.wavenumbers_x, velocity=velocity
            )
        return SlidingModes(
            spectrum, SCHEMES["exponential"], measure, wavenumbers_x=grid.wavenumbers_x, velocity=velocity
        )
    if config.time.step == "adaptive":
        return ErrorControlledModes(spectrum, measure)
    return Modes(spectrum, SCHEMES[config.time.integrator], measure)


def make_settling(config: Config, integrator: Integrator, kinks: tuple[float, ...]) -> SteadyState | None:
    """The judge of the steady state, where one is asked for."""
    tolerance = config.time.steady
    if tolerance is None or not isinstance(integrator, SlidingModes):
        return None
    return SteadyState(integrator.slowest(tolerance), tolerance, max(kinks, default=0.0))


def make_loading(config: Config, grid: Grid) -> Loading:
    """The punch and what is prescribed of it."""
    return CONTROLS[config.trajectory.control](make_punch(config, grid), make_trajectory(config))


def make_steps(config: Config, integrator: Integrator, kinks: tuple[float, ...]) -> Steps:
    """The time points; backward Euler takes the paper's equal steps, others land on the kinks."""
    end, snapshots = config.time.end, config.output.snapshots
    if isinstance(integrator, ErrorControlledModes):
        tolerance = config.time.tolerance
        assert tolerance is not None  # adaptive steps have one
        return AdaptiveSteps(integrator, tolerance, end, snapshots, kinks, output_times(config))
    steps = equal_steps if config.time.integrator == "backward_euler" else landing_steps
    return FixedSteps(steps(end, fixed_step(config), snapshots, kinks))


def output_times(config: Config) -> tuple[float, ...]:
    """The times that adaptive steps land on because rows were asked for there."""
    times = config.output.times
    if isinstance(times, float):
        return tuple(times * i for i in range(1, math.floor(config.time.end / times + 1e-9) + 1))
    return times or ()


def fixed_step(config: Config) -> float:
    """The length of a time step."""
    assert not isinstance(config.time.step, str)
    return config.time.step
