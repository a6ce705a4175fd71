"""The parts of a simulation, as a configuration asks for them; the only module that knows all numerics."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Protocol, TypedDict, Unpack

from gfmdlayer import inputs
from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.body import Body, ViscoelasticLayer
from gfmdlayer.config import Config
from gfmdlayer.contact.attraction import AttractionSolver
from gfmdlayer.contact.loading import CONTROLS, Loading
from gfmdlayer.contact.loss_stiffness import SHARE, LossStiffnessSolver
from gfmdlayer.contact.prediction import PREDICTIONS, DisplacementPrediction, PressurePrediction
from gfmdlayer.contact.problem import Solver
from gfmdlayer.contact.solvers import SOLVERS
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.history.adaptive_steps import AdaptiveSteps
from gfmdlayer.history.error_control import ErrorControlledModes
from gfmdlayer.history.modes import SCHEMES, Modes
from gfmdlayer.history.sliding_modes import ErrorControlledSlidingModes, SlidingModes
from gfmdlayer.history.time_points import FixedSteps, Instant, equal_steps, landing_steps
from gfmdlayer.interface.law import HARD_WALL, InterfaceLaw
from gfmdlayer.observables import Observable, observables
from gfmdlayer.observables.observable import Energy
from gfmdlayer.punch.trajectory import Constant, Table, Trajectory
from gfmdlayer.resumable import CompositeState, Resumable


class Integrator(Energy, Resumable, Protocol):
    """Time integration of the history: slopes and intercepts of the stress at the end of a step."""

    @property
    def loss_stiffness(self) -> FloatArray | None:
        """Imaginary part of the slopes at the end of the last step; None where the punch does not move."""
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
        """Return the time points in order; a rejected one is followed by an earlier one."""
        ...

    def accepts(self, spectrum: ComplexArray, found: float, depth: float) -> bool:
        """Return whether the last step is accurate enough.

        Parameters
        ----------
        spectrum : ndarray of complex
            Displacement at its end.
        found : float
            Mean pressure at a prescribed depth, depth under a prescribed load.
        depth : float
            Depth of the punch.
        """
        ...


class Parts(TypedDict, total=False):
    """Parts that may be given in place of those of the configuration."""

    grid: Grid
    transforms: Transforms
    body: Body
    punch: FloatArray
    trajectory: Trajectory
    velocity: Constant | Table | None
    interface: InterfaceLaw
    loading: Loading
    integrator: Integrator
    steps: Steps
    solver: Solver
    guess: DisplacementPrediction | PressurePrediction
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
    **parts
        Parts in place of those that the configuration describes, see `Parts`: `Case(config, body=mine)`.
        The other parts are made to fit.

    Raises
    ------
    TypeError
        If there is no such part.
    TableError
        In the use of a part that comes from a file that cannot be used.
    """

    def __init__(
        self, config: Config, wisdom: str | None = None, threads: int = 1, **parts: Unpack[Parts]
    ) -> None:
        if unknown := parts.keys() - Parts.__annotations__.keys():
            raise TypeError(f"a case has no part {', '.join(sorted(unknown))}")
        self.config, self._wisdom, self._threads = config, wisdom, threads
        vars(self).update(parts)  # where the cached properties look first

    @cached_property
    def grid(self) -> Grid:
        """The periodic grid."""
        return inputs.make_grid(self.config)

    @cached_property
    def transforms(self) -> Transforms:
        """Fourier transforms of the grid."""
        return Transforms(self.grid.shape, self._wisdom, threads=self._threads)

    @cached_property
    def body(self) -> Body:
        """The body under the surface."""
        return ViscoelasticLayer(inputs.make_body(self.config), self.config.layer.material)

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
        """Interaction of surface and punch across the gap: the paper's hard wall."""
        return HARD_WALL

    @cached_property
    def kinks(self) -> tuple[float, ...]:
        """Times at which the slope of a prescribed quantity jumps."""
        return (*self.loading.trajectory.kinks, *(self.velocity.kinks if self.velocity is not None else ()))

    @cached_property
    def loading(self) -> Loading:
        """The punch under its prescribed depth or load."""
        return CONTROLS[self.config.trajectory.control](self.punch, self.trajectory, self.interface)

    @cached_property
    def integrator(self) -> Integrator:
        """The time integrator over the relaxing modes of the body.

        Backward Euler over them is the paper's Eq. (24) by backward differences, to rounding and for any
        material; see `verification.third_order` for the equation itself.
        """
        spectrum, sums = self.body.spectrum(self.grid.wavenumbers), self.grid.sums
        adaptive = self.config.time.step == "adaptive"
        if self.velocity is not None:
            waves = self.grid.wavenumbers_x
            if adaptive:
                return ErrorControlledSlidingModes(
                    spectrum, sums, wavenumbers_x=waves, velocity=self.velocity
                )
            scheme = SCHEMES["exponential"]
            return SlidingModes(spectrum, scheme, sums, wavenumbers_x=waves, velocity=self.velocity)
        if adaptive:
            return ErrorControlledModes(spectrum, sums)
        return Modes(spectrum, SCHEMES[self.config.time.integrator], sums)

    @cached_property
    def steps(self) -> Steps:
        """The time points; backward Euler takes the paper's equal steps, others land on the kinks."""
        time, snapshots = self.config.time, self.config.output.snapshot_times
        if isinstance(time.step, str):
            assert isinstance(self.integrator, ErrorControlledModes)
            assert time.tolerance is not None
            times = output_times(self.config)
            return AdaptiveSteps(self.integrator, time.tolerance, time.end, snapshots, self.kinks, times)
        steps = equal_steps if time.integrator == "backward_euler" else landing_steps
        return FixedSteps(steps(time.end, time.step, snapshots, self.kinks))

    @cached_property
    def solver(self) -> Solver:
        """Solver of the contact problem, within the iterations for an attraction and for a loss stiffness."""
        given, transforms = self.config.solver, self.transforms
        declared, tolerance = SOLVERS[given.method], given.tolerance
        options = {} if given.inertia is None else {"mass_weighted": given.inertia == "mass_weighted"}
        attracted = self.interface.attracts and not declared.adhesive
        moved = self.velocity is not None and not declared.nonsymmetric
        # Each iteration around a solver leaves a part of the tolerance to it.
        inner = tolerance * (AttractionSolver.SHARE if attracted else 1.0) * (SHARE if moved else 1.0)
        solver: Solver = declared.load()(transforms, inner, given.max_iterations, **options)
        if attracted:
            within = tolerance * (SHARE if moved else 1.0)
            solver = AttractionSolver(solver, transforms, within, given.max_iterations)
        if moved:
            solver = LossStiffnessSolver(solver, transforms, tolerance, self.grid.parseval_weights)
        return solver

    @cached_property
    def guess(self) -> DisplacementPrediction | PressurePrediction:
        """Extrapolation in time from which the solver starts."""
        return PREDICTIONS[self.solver.starts_from](self.grid.size)

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
            integrator=self.integrator,
            steps=self.steps,
            guess=self.guess,
            observables=CompositeState(**self.observables),
        )


def output_times(config: Config) -> tuple[float, ...]:
    """Return the times of the rows that adaptive steps are asked to land on."""
    times = config.output.times
    if isinstance(times, float):
        return tuple(times * i for i in range(1, math.floor(config.time.end / times + 1e-9) + 1))
    return times or ()
