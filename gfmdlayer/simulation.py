"""The time loop: indentation of a viscoelastic layer by a rigid punch.

As in the pseudocode of Petrenko et al. (2024).

The numbers in the comments of `simulate` are the lines of that pseudocode.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from gfmdlayer.config import Config
from gfmdlayer.contact.fire import Fire
from gfmdlayer.contact.grid import FloatArray, Grid
from gfmdlayer.contact.problem import Problem, Solver
from gfmdlayer.contact.transforms import ComplexArray, Transforms
from gfmdlayer.contact.wisdom import planned
from gfmdlayer.inputs import make_grid, make_punch, make_trajectory
from gfmdlayer.solid.layer import LayeredHalfspace
from gfmdlayer.solid.materials import Material, Prony, Zener
from gfmdlayer.solid.relaxation import relaxation_spectrum
from gfmdlayer.stepping.extrapolation import Extrapolation
from gfmdlayer.stepping.modes import SCHEMES, Modes
from gfmdlayer.stepping.schedule import Instant, equal_steps, landing_steps
from gfmdlayer.stepping.third_order import ThirdOrder


class ConvergenceError(RuntimeError):
    """A time step did not reach the solver's tolerance."""


class Recorder(Protocol):
    """Takes what a simulation finds."""

    def row(self, **values: float) -> None:
        """Take the observables of an accepted step."""
        ...

    def snapshot(self, time: float, displacement: FloatArray, pressure: FloatArray) -> None:
        """Take the surface at an asked time; arrays of the grid's shape."""
        ...


class Integrator(Protocol):
    """From the history to the slopes and intercepts of the stress."""

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b at the end of a step of this length."""
        ...

    def advance(self, spectrum: ComplexArray) -> None:
        """Carry the history on with the accepted displacement."""
        ...


def simulate(
    config: Config,
    recorder: Recorder,
    progress: Callable[[float], None] | None = None,
    wisdom: str | None = None,
) -> None:
    """Run one case.

    Parameters
    ----------
    config : Config
        The case.
    recorder : Recorder
        Takes a row for each time step, the first at t = 0, and the snapshots.
    progress : callable, optional
        Called with the simulated time after each step; may raise to stop.
    wisdom : str, optional
        FFTW wisdom, where the bits of another run are to be reproduced.

    Raises
    ------
    ConvergenceError
        If a step does not reach the solver's tolerance.
    TableError
        If the file of a punch or a trajectory cannot be used.
    """
    grid = make_grid(config)
    transforms = Transforms(grid.shape, wisdom)
    solver = make_solver(config, transforms)
    integrator = make_integrator(config, grid)
    punch, trajectory = make_punch(config, grid), make_trajectory(config)
    guess = Extrapolation((grid.size,))

    for instant in instants(config, trajectory.kinks):  # 4, 10
        kappa, b = integrator.terms(instant.step)  # 5, 6
        h = punch - trajectory(instant.time)  # 0
        solution = solver.solve(Problem(kappa, b, h), guess.at(instant.time))  # 7
        if not solution.converged:
            raise ConvergenceError(
                f"t = {instant.time:.6g}: residual {solution.residual:.2e} after {solution.iterations} iterations "
                f"of {config.solver.method}; the tolerance is {config.solver.tolerance:.2e}"
            )
        integrator.advance(solution.spectrum)  # 8, 9
        guess.remember(instant.time, solution.displacement, kink=instant.kink)
        recorder.row(
            time=instant.time,
            contact_area=solution.contact_area,
            mean_pressure=solution.mean_pressure / (2 * config.layer.material.G0),
            depth=trajectory(instant.time),
            transforms=solution.transforms,
            iterations=solution.iterations,
            residual=solution.residual,
        )
        if instant.snapshot:
            recorder.snapshot(
                instant.time,
                solution.displacement.reshape(grid.shape),
                solution.pressure.reshape(grid.shape),
            )
        if progress is not None:
            progress(instant.time)


def warm_up(config: Config, wisdom_folder: Path | None = None) -> str:
    """Compile the kernels that a case needs and plan its transforms; return FFTW's wisdom for `simulate`.

    Plans are kept in the wisdom folder, by default the user's cache: runs with the same plans agree in every
    bit.
    """
    small = config.with_values({"grid.points": 16, "grid.period": 1.0, "punch": {"shape": "parabola"}})
    solver = make_solver(small, Transforms((16,)))
    integrator = make_integrator(small, make_grid(small))
    zero = np.zeros(16)
    integrator.advance(solver.solve(Problem(*integrator.terms(fixed_step(small)), zero + 1.0), zero).spectrum)
    return planned(config.grid.points, wisdom_folder or user_cache())


def make_solver(config: Config, transforms: Transforms) -> Solver:
    """The solver of the contact problem."""
    given = config.solver
    return Fire(
        transforms, given.tolerance, given.max_iterations, mass_weighted=given.inertia == "mass_weighted"
    )


def make_integrator(config: Config, grid: Grid) -> Integrator:
    """The time integrator; backward Euler is the paper's own where its equation holds."""
    body = LayeredHalfspace(
        config.layer.thickness, config.layer.poisson, config.halfspace.shear_modulus, config.halfspace.poisson
    )
    material = make_material(config)
    incompressible = body.poisson == 0.5 and body.bulk_poisson == 0.5
    if config.time.integrator == "backward_euler" and isinstance(material, Zener) and incompressible:
        return ThirdOrder(body, material, grid.wavenumbers, fixed_step(config))
    return Modes(relaxation_spectrum(body, material, grid.wavenumbers), SCHEMES[config.time.integrator])


def make_material(config: Config) -> Material:
    """The material of the layer."""
    given = config.layer.material
    if given.model == "zener":
        return Zener(given.G0, given.Ginf, given.tau)
    return Prony(given.G0, tuple((branch.G, branch.tau) for branch in given.branches))


def instants(config: Config, kinks: tuple[float, ...]) -> Iterator[Instant]:
    """The time points; backward Euler takes the paper's equal steps.

    The exponential integrator lands on the kinks.
    """
    steps = equal_steps if config.time.integrator == "backward_euler" else landing_steps
    return steps(config.time.end, fixed_step(config), config.output.snapshots, kinks)


def fixed_step(config: Config) -> float:
    """The length of a time step."""
    assert not isinstance(config.time.step, str)
    return config.time.step


def user_cache() -> Path:
    """Where a user's caches lie."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gfmdlayer"
