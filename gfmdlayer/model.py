"""The interface of a case to execution and results: a `Model`, chosen by the geometry of the contact.

A model turns the configuration of one case into rows and snapshots. The commands, the processes of a sweep
and the result files use this protocol only; a further geometry is one class with it, and one line in
`config.geometries.GEOMETRIES`.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from gfmdlayer.config import Config
from gfmdlayer.config.bodies import place_of
from gfmdlayer.config.layers import Layers
from gfmdlayer.programme import Programme

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.body.body import Body
    from gfmdlayer.body.materials import PronySeries
    from gfmdlayer.body.solid import Place
    from gfmdlayer.contact.problem import Problem, Solution
    from gfmdlayer.grid.grid import Grid
    from gfmdlayer.grid.ranks import Ranks
    from gfmdlayer.observables.observable import Column
    from gfmdlayer.results.journal import Recorder
    from gfmdlayer.resumable import CompositeState

    Progress: TypeAlias = Callable[[float], None] | None  # called with the simulated time
    Resume: TypeAlias = Callable[[CompositeState], None] | None  # called with all resumable state

FEW_WAVES = 6  # along an axis, at which a body of the user's own is computed before a run
PROGRAM = 230e6  # bytes of a process with its libraries and compiled kernels


class ConvergenceError(RuntimeError):
    """A contact problem was not solved to the solver's tolerance, or an isolated contact is too wide.

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
        time: float = float("nan"),
    ) -> None:
        super().__init__(message)
        self.problem, self.solution, self.time = problem, solution, time
        self.data: Any = None


@dataclass(frozen=True)
class Footprint:
    """Estimated cost of one case."""

    steps: int  # time steps
    pairs: float  # FFT pairs, each one forward and one backward transform of the grid
    work: float  # points times FFT pairs, or as much work of another kind; dealt out evenly over shards
    memory: float  # bytes, with the program
    storage: float  # bytes of the result file
    seconds: float = 0.0  # beside the FFT pairs


class Model(ABC):
    """One case of a geometry: its columns, its cost, its checks and its run.

    A subclass makes its parts when they are first used, so that `columns`, `footprint` and `problems` are
    cheap.

    Parameters
    ----------
    config : Config
        The configuration of one case.
    wisdom : str, optional
        FFTW wisdom, where the bits of another run are to be reproduced.
    threads : int
        Threads that the transforms of a large grid may use.
    ranks : Ranks, optional
        The processes that compute the case together.
    """

    def __init__(
        self,
        config: Config,
        wisdom: str | None = None,  # noqa: ARG002
        threads: int = 1,  # noqa: ARG002
        ranks: Ranks | None = None,  # noqa: ARG002
    ) -> None:
        self.config = config

    @cached_property
    def programme(self) -> Programme:
        """The imposed quantities over time."""
        return Programme(self.config)

    @property
    @abstractmethod
    def columns(self) -> tuple[Column, ...]:
        """The columns of a row, in their order; the first is the time."""

    @property
    @abstractmethod
    def coordinates(self) -> Mapping[str, FloatArray]:
        """Coordinates of the whole snapshots by name: x, and y of a surface in two directions."""

    @property
    def places(self) -> Sequence[Place]:
        """Depths and layers of the fields below the surface, in the snapshots; empty without any."""
        return ()

    @property
    def grid(self) -> Grid | None:
        """The periodic grid of the snapshots, of which each rank has a part; None where there is none."""
        return None

    @property
    def wisdom(self) -> str:
        """FFTW's wisdom after the run; empty without transforms."""
        return ""

    @property
    def attributes(self) -> Mapping[str, str | float]:
        """Attributes of the result file that this geometry adds."""
        return {}

    @property
    @abstractmethod
    def footprint(self) -> Footprint:
        """Estimated steps, FFT pairs, memory and disk."""

    def methods(self) -> Iterator[str]:
        """Yield lines for `gfmdlayer check` on the numerical methods and the reasons for them."""
        yield from ()

    def problems(self) -> Iterator[tuple[str, str]]:
        """Read the input files; yield each key that cannot be used, and why."""
        yield from ()

    def warm_up(
        self,
        folder: Path | None = None,  # noqa: ARG002
        results: Path | None = None,  # noqa: ARG002
        *,
        plan: bool = True,  # noqa: ARG002
    ) -> str:
        """Compile the kernels and `plan` the transforms; return FFTW's wisdom.

        Plans of some `results` come first, then those of a `folder`, by default the user's cache.
        """
        return ""

    @abstractmethod
    def run(self, recorder: Recorder, progress: Progress = None, resume: Resume = None) -> list[str]:
        """Compute the case into a recorder; arguments and result like `gfmdlayer.simulate`."""


def model_of(
    config: Config, wisdom: str | None = None, threads: int = 1, ranks: Ranks | None = None
) -> Model:
    """Return the model of a case; `Model` takes the same arguments."""
    module, _, name = config.geometry.model.partition(":")
    made: Model = getattr(import_module(module), name)(config, wisdom, threads, ranks)
    return made


def warm_up(config: Config, folder: Path | None = None, threads: int = 1) -> str:
    """Compile the kernels and plan the transforms of a case, see `Model.warm_up`; return FFTW's wisdom."""
    return model_of(config, threads=threads).warm_up(folder)


class Runs(Protocol):
    """A `Model`, or the parts of a periodic contact (`gfmdlayer.Case`)."""

    def run(self, recorder: Recorder, progress: Progress = None, resume: Resume = None) -> list[str]:
        """Compute the case into a recorder."""
        ...


def simulate(
    config: Config | Runs,
    recorder: Recorder,
    progress: Progress = None,
    wisdom: str | None = None,
    threads: int = 1,
    resume: Resume = None,
) -> list[str]:
    """Run one case.

    Parameters
    ----------
    config : Config or Case
        The configuration, or the parts of one simulation, where some are your own; a `Case` runs once, with
        its own wisdom and threads.
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
    model = model_of(config, wisdom, threads) if isinstance(config, Config) else config
    return model.run(recorder, progress, resume)


def series_of(programme: Programme, wavenumber: float = 0.0) -> tuple[PronySeries, ...]:
    """Return the laws of a case as series of Maxwell branches over the times of its run.

    `wavenumber` [1/length] is the largest one along x that a moving punch drives.
    """
    every = zip(programme.config.laws, programme.reduced_times, strict=True)
    return tuple(law.prony(*programme.times_of_response(reduced, wavenumber)) for law, reduced in every)


def make_body(config: Config, series: Sequence[PronySeries]) -> Body:
    """Return the body with a series for each law; modes merge, but not for stresses below the surface."""
    accuracy = 0.0 if config.output.inside else config.solver.tolerance
    return config.solid.with_series([each.material for each in series], accuracy)


def fault_of_the_body(model: Model, grid: Grid) -> str:
    """Compute a body that is not made of layers at some waves; return why it cannot be used."""
    second = model.config.counterbody
    both = model.config.body, None if second is None else second.body
    if not (own := [body for body in both if not isinstance(body, Layers | None)]):
        return ""
    import numpy as np

    from gfmdlayer.body.solid import fault
    from gfmdlayer.body.wavevectors import Wavevectors
    from gfmdlayer.files.tables import TableError

    every = (np.ravel(axis) for axis in grid.wavevectors)
    axes = [q[np.argsort(np.abs(q))][:: max(1, q.size // FEW_WAVES)] for q in every]  # q = 0 first
    waves = Wavevectors.of_components(*(np.ravel(q) for q in np.meshgrid(*axes, indexing="ij")))
    try:
        return fault(make_body(model.config, series_of(model.programme)), waves)
    except TableError:
        return ""  # reported for the file that it is in
    except Exception as error:
        return f"{place_of(error, str(getattr(own[0], 'file', '')))}; must be computed without an error"


def compile_by(run: Callable[[], object]) -> None:
    """Compile kernels by running a small case; an error is a warning, since the case itself will meet it."""
    try:
        run()
    except Exception as error:
        warnings.warn(
            f"the cases compile their kernels themselves: {type(error).__name__}: {error}", stacklevel=3
        )
