"""The parts of a simulation, as a configuration asks for them; the only module that knows all numerics."""

from __future__ import annotations

import math
from functools import cached_property, partial
from typing import TYPE_CHECKING, Protocol, TypedDict, Unpack

from gfmdlayer import inputs
from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.body.materials import PronySeries
from gfmdlayer.config import Config
from gfmdlayer.config.stops import output_times, stops
from gfmdlayer.contact.choice import choose, contrast, finer
from gfmdlayer.contact.loading import CONTROLS, Loading
from gfmdlayer.contact.loss_stiffness import with_loss
from gfmdlayer.contact.prediction import PREDICTIONS, DisplacementPrediction
from gfmdlayer.contact.problem import Solver
from gfmdlayer.contact.solvers import SOLVERS
from gfmdlayer.contact.tightened import tightened
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.grid.slab_transforms import transforms_of
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.history.adaptive_steps import AdaptiveSteps
from gfmdlayer.history.error_control import ErrorControlledModes
from gfmdlayer.history.instabilities import Changes
from gfmdlayer.history.mode_kernels import exponential
from gfmdlayer.history.modes import SCHEMES, Modes
from gfmdlayer.history.reduced_time import ReducedTime
from gfmdlayer.history.sliding_modes import ErrorControlledSlidingModes, SlidingModes
from gfmdlayer.history.stack_modes import stack_modes
from gfmdlayer.history.time_points import FixedSteps, Instant, Steps, equal_steps, landing_steps
from gfmdlayer.interface.law import InterfaceLaw
from gfmdlayer.observables import Observable, observables
from gfmdlayer.observables.observable import Energy
from gfmdlayer.punch.trajectory import Constant, Table, Trajectory
from gfmdlayer.resumable import CompositeState, Resumable

if TYPE_CHECKING:
    from gfmdlayer.indentation.isolated import IsolatedIndentation


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
    >>> case.body.stiffness(case.grid.wavenumbers, 0.0).shape
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
        adaptive, waves, sums = self.config.time.step == "adaptive", self.grid.wavenumbers, self.grid.sums
        reduced, curved = self.reduced_time, self.interface.attracts
        if reduced is None and any(self.clocks):
            scheme = None if adaptive else SCHEMES[self.config.time.integrator]
            return stack_modes(self.body, waves, self.clocks, scheme, sums, curved=curved)
        spectrum = self.body.spectrum(waves)
        if self.velocity is not None:
            along = self.grid.wavenumbers_x
            velocity = self.velocity if reduced is None else self.velocity.in_time(reduced.factor(0.0))
            if adaptive:
                return ErrorControlledSlidingModes(spectrum, sums, wavenumbers_x=along, velocity=velocity)
            return SlidingModes(spectrum, exponential, sums, wavenumbers_x=along, velocity=velocity)
        if adaptive:
            return ErrorControlledModes(spectrum, sums, curved=curved)
        return Modes(spectrum, SCHEMES[self.config.time.integrator], sums)

    @cached_property
    def steps(self) -> Steps:
        """The time points; backward Euler takes the paper's equal steps, others land on the kinks."""
        time, snapshots = self.config.time, self.config.output.snapshot_times
        if isinstance(time.step, str):
            assert isinstance(self.integrator, ErrorControlledModes)
            assert time.tolerance is not None
            landings = snapshots, self.kinks, output_times(self.config)
            slowdown = 1.0 if self.reduced_time is None else self.reduced_time.factor(0.0)
            reach = self.interface.range if self.interface.attracts else 0.0
            least = reach if self.config.trajectory.control != "depth" else 0.0, reach
            return AdaptiveSteps(
                self.integrator, time.tolerance, time.end, *landings, slowdown=slowdown, least=least
            )
        steps = equal_steps if time.integrator == "backward_euler" else landing_steps
        instants = steps(time.end, time.step, snapshots, self.kinks)
        return FixedSteps(instants, stops(self.config, self.kinks), time.step)

    @cached_property
    def changes(self) -> Changes:
        """Change of gap and drive over a step, where the interface attracts."""
        return Changes(self.interface, self.grid.sums)

    @cached_property
    def solver(self) -> Solver:
        """Solver of the contact problem, within the iterations for a loss stiffness."""
        given, transforms = self.config.solver, self.transforms
        rough, attracts, time = self.config.punch.rough, self.interface.attracts, self.config.time
        chosen = choose(given.method, axes=len(self.grid.points), rough=rough, attracts=attracts)
        declared = SOLVERS[chosen.method]
        options: dict[str, object] = {"grid": self.grid} if declared.distributed else {}
        if given.inertia is not None:
            start = "gap" if attracts else "displacement"
            options |= {"mass_weighted": given.inertia == "mass_weighted", "starts_from": start}
        made = partial(declared.load(), transforms, **options)
        if self.velocity is not None and not declared.nonsymmetric:
            made = partial(with_loss, made, transforms, self.grid.parseval_weights)
        stiffened = contrast(self.config.laws, time.end)
        aim = finer(given.tolerance, time.tolerance, stiffened, attracts=attracts)
        return tightened(made, given.tolerance, given.max_iterations, aim)

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
            integrator=self.integrator,
            steps=self.steps,
            guess=self.guess,
            changes=self.changes,
            loading=self.loading,
            observables=CompositeState(**self.observables),
        )
