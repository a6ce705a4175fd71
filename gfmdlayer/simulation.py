"""The time loop: indentation of a viscoelastic layer by a rigid punch, after Petrenko et al. (2024).

The numbers in the comments of `simulate` are the lines of their pseudocode.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.case import (
    fixed_step,
    make_integrator,
    make_loading,
    make_settling,
    make_solver,
    make_steps,
)
from gfmdlayer.config import Config
from gfmdlayer.contact.prediction import PREDICTIONS
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.grid.wisdom import planned
from gfmdlayer.inputs import histogram_edges, make_grid, make_velocity
from gfmdlayer.observables.contact_statistics import Statistics
from gfmdlayer.observables.effort import Effort
from gfmdlayer.observables.energy_balance import EnergyBalance
from gfmdlayer.observables.friction import make_travel
from gfmdlayer.resumable import CompositeState, Resumable, Stateless


class ConvergenceError(RuntimeError):
    """A time step did not reach the solver's tolerance."""


class Recorder(Protocol):
    """Takes what a simulation finds."""

    def row(self, **values: float | FloatArray) -> None:
        """Take the observables of an accepted step: numbers, and histograms."""
        ...

    def snapshot(
        self, time: float, displacement: FloatArray, pressure: FloatArray, gap: FloatArray, /
    ) -> None:
        """Take the surface at an asked time; arrays of the grid's shape."""
        ...

    def note(self, **attributes: float) -> None:
        """Take what became known of the run as a whole."""
        ...


def simulate(
    config: Config,
    recorder: Recorder,
    progress: Callable[[float], None] | None = None,
    wisdom: str | None = None,
    threads: int = 1,
    resume: Callable[[Resumable], None] | None = None,
) -> None:
    """Run one case.

    Parameters
    ----------
    config : Config
        The case.
    recorder : Recorder
        Takes a row for each time step, the first at t = 0, and the snapshots.
    progress : callable, optional
        Called with the simulated time after each attempt at a step; may raise to stop.
    wisdom : str, optional
        FFTW wisdom, where the bits of another run are to be reproduced.
    threads : int
        Threads that the transforms of a large grid may use.
    resume : callable, optional
        Handed everything that has a memory, before the first step: may put back a state of such a run, which
        then goes on to the last bit, and may take out the state whenever `progress` is called.

    Raises
    ------
    ConvergenceError
        If a step does not reach the solver's tolerance.
    TableError
        If the file of a punch or a trajectory cannot be used.
    """
    grid = make_grid(config)
    transforms = Transforms(grid.shape, wisdom, threads=threads)
    solver = make_solver(config, transforms)
    travel = make_travel(make_velocity(config), grid, transforms)
    integrator = make_integrator(config, grid)
    loading = make_loading(config, grid)
    kinks = (*loading.trajectory.kinks, *travel.kinks)
    steps = make_steps(config, integrator, kinks)
    statistics = Statistics(grid.shape, histogram_edges(config), patches=config.output.patches)
    guess, ledger, attempts = PREDICTIONS[solver.starts_from](grid.size), EnergyBalance(), Effort()
    settling = make_settling(config, integrator, kinks)
    if resume is not None:
        judge = Stateless() if settling is None else settling
        memory = {"integrator": integrator, "steps": steps, "guess": guess, "settling": judge}
        # The transforms first: the solver makes use of them when it is put back.
        resume(
            CompositeState(transforms=transforms, solver=solver, **memory, ledger=ledger, attempts=attempts)
        )

    for instant in steps:  # 4, 10
        kappa, b = integrator.terms(instant.step)  # 5, 6
        problem = loading.problem(kappa, b, instant.time)  # 0
        if integrator.loss_stiffness is not None:
            problem = replace(problem, loss_stiffness=integrator.loss_stiffness)
        solution = solver.solve(problem, guess.at(instant.time))  # 7
        attempts.add(solution)
        if not solution.converged:
            raise ConvergenceError(
                f"t = {instant.time:.6g}: residual {solution.residual:.2e} after {solution.iterations} "
                f"iterations of {config.solver.method}; the tolerance is {config.solver.tolerance:.2e}"
            )
        surface = loading.surface(solution, kappa, b, instant.time)
        if steps.accepts(surface.spectrum, surface.found, surface.depth):
            integrator.advance(surface.spectrum)  # 8, 9
            remembered = getattr(solution, solver.starts_from)
            guess.remember(instant.time, remembered, solution.gap, kink=instant.kink)
            resistance = travel.columns(instant.time, solution.pressure, surface)
            settled = settling is not None and settling.reached(
                instant.time, solution.mean_pressure, surface.depth, **resistance
            )
            recorder.row(
                time=instant.time,
                contact_area=solution.contact_area,
                mean_pressure=solution.mean_pressure / (2 * config.layer.material.relaxed),
                depth=surface.depth,
                residual=solution.residual,
                **attempts.taken(),
                **resistance,
                **ledger.entry(solution.mean_pressure, surface.depth, integrator, resistance),
                **statistics.of(problem, solution),
            )
            if instant.snapshot or settled:
                recorder.snapshot(
                    instant.time,
                    surface.displacement.reshape(grid.shape),
                    solution.pressure.reshape(grid.shape),
                    solution.gap.reshape(grid.shape),
                )
            if settled:
                break
        if progress is not None:
            progress(instant.time)
    if settling is not None:
        recorder.note(**settling.verdict)


def warm_up(config: Config, wisdom_folder: Path | None = None, threads: int = 1) -> str:
    """Compile the kernels that a case needs and plan its transforms; return FFTW's wisdom for `simulate`.

    Plans are kept in the wisdom folder, by default the user's cache: runs with the same plans agree in every
    bit.
    """
    small = _in_small(config)
    simulate(small, _Nobody())
    # What only a solver that fails comes to must not be compiled by all ranks at once either.
    grid = make_grid(small)
    loading, integrator = make_loading(small, grid), make_integrator(small, grid)
    kappa, b = integrator.terms(1.0 if config.time.step == "adaptive" else fixed_step(small))
    hopeless = make_solver(small, Transforms(grid.shape), tolerance=0.0, max_iterations=300)
    hopeless.solve(loading.problem(kappa, b, small.time.end), np.zeros(grid.size))
    return planned(config.grid.points, wisdom_folder or user_cache(), threads)


def _in_small(config: Config) -> Config:
    """The same kind of case over a ramp and a hold of few steps, on as few points as a window takes."""
    control, adaptive = config.trajectory.control, config.time.step == "adaptive"
    ramp_time = 1.0 if adaptive else 2 * fixed_step(config)
    moves = {} if make_velocity(config) is None else {"velocity": 1.0}
    return config.with_values(
        {
            "grid": {"points": 256},
            "punch": {"shape": "parabola"},
            "trajectory": {"control": control, control: 0.01, "ramp_time": ramp_time, **moves},
            "time.end": 3 * ramp_time,
            "output": {"times": ramp_time} if adaptive else {},
        }
    )


class _Nobody:
    """Takes what a simulation finds and forgets it."""

    def row(self, **values: object) -> None:
        """Forget an accepted step."""

    def note(self, **values: object) -> None:
        """Forget a verdict."""

    def snapshot(self, *fields: object) -> None:
        """Forget a surface."""


def user_cache() -> Path:
    """Where a user's caches lie."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gfmdlayer"
