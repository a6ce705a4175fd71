"""Grid, body, punch and trajectory of a case, checked before any work starts; imports no compiled kernel."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.layer import LayeredHalfspace
from gfmdlayer.config import Config
from gfmdlayer.files.tables import TableError
from gfmdlayer.grid.grid import Grid
from gfmdlayer.history import time_points
from gfmdlayer.history.time_points import Instant
from gfmdlayer.punch.height_files import fitting
from gfmdlayer.punch.trajectory import Constant, RampHold, Table, Trajectory
from gfmdlayer.validation.sections import files_named


def make_grid(config: Config) -> Grid:
    """Return the grid of a case."""
    return Grid(config.grid.points, config.grid.period)


def make_body(config: Config) -> LayeredHalfspace:
    """Return the layer on its halfspace."""
    layer, halfspace = config.layer, config.halfspace
    return LayeredHalfspace(layer.thickness, layer.poisson, halfspace.shear_modulus, halfspace.poisson)


def make_punch(config: Config, grid: Grid) -> FloatArray:
    """Return the height of the punch above its lowest point, flat, one value a grid point.

    Raises
    ------
    TableError
        If the heights come from a file that cannot be used, or are not finite.
    """
    return np.ravel(fitting("the punch", config.punch.heights(grid), grid.shape))


def make_trajectory(config: Config) -> Trajectory:
    """Return the depth or the mean pressure over time, as `trajectory.control` says.

    A force is divided by the area of the cell, or by the length of a line's.

    Raises
    ------
    TableError
        If it comes from a file that cannot be used.
    """
    given = config.trajectory
    unit = math.prod(config.grid.period) if given.control == "force" else 1.0
    if given.file is not None:
        table = Table.read(given.file, given.control)
        return Table(table.times, table.values / unit)
    target = getattr(given, given.control)
    assert target is not None and given.ramp_time is not None  # noqa: PT018
    return RampHold(target / unit, given.ramp_time)


def make_velocity(config: Config) -> Constant | Table | None:
    """Return the velocity of the punch along x over time; None where it stays.

    Raises
    ------
    TableError
        If it comes from a file that cannot be used.
    """
    given = config.trajectory
    if given.velocity_file is not None:
        return Table.read(given.velocity_file, "velocity")
    return None if given.velocity is None else Constant(given.velocity)


def kinks(trajectory: Trajectory, velocity: Constant | Table | None) -> tuple[float, ...]:
    """Return the times at which the slope of a prescribed quantity jumps."""
    return (*trajectory.kinks, *(velocity.kinks if velocity is not None else ()))


def stops(config: Config, kinks: Iterable[float]) -> list[Instant]:
    """Return the times that the steps of a case land on, with the lengths of fixed steps to each.

    Parameters
    ----------
    config : Config
        The case.
    kinks : iterable of float
        Times at which the slope of a prescribed quantity jumps.

    Returns
    -------
    list of Instant
    """
    time, snapshots = config.time, config.output.snapshots
    if isinstance(time.step, str):
        return time_points.stops(time.end, snapshots, kinks, output_times(config))
    equal = time.integrator == "backward_euler"
    fixed = time_points.equal_stops if equal else time_points.landing_stops
    return fixed(time.end, time.step, snapshots, kinks)


def output_times(config: Config) -> tuple[float, ...]:
    """Return the times of the rows that adaptive steps are asked to land on."""
    times = config.output.times
    if isinstance(times, float):
        return tuple(times * i for i in range(1, math.floor(config.time.end / times + 1e-9) + 1))
    return times or ()


def input_errors(configs: Iterable[Config]) -> Iterator[tuple[str, str]]:
    """Read the files of the cases and check that the cases are possible.

    Yields
    ------
    key, message : str
        The key that cannot be used, and why: a file with wrong contents, a negative load, or a depth for
        which an incompressible body would have to leave the cell. With a mean displacement of zero the punch
        cannot go deeper than the mean height of its surface.
    """
    seen = set()
    for config in configs:
        inputs = (config.grid, config.punch, config.trajectory, config.time.steady, make_body(config))
        if inputs not in seen:
            seen.add(inputs)
            yield from _input_errors(config)


def _input_errors(config: Config) -> Iterator[tuple[str, str]]:
    given, names = config.trajectory, files_named(config)
    key = next((name for name in names if name.startswith("punch.")), "punch")
    try:
        heights = make_punch(config, make_grid(config))
        key = "trajectory.file"
        trajectory = make_trajectory(config)
        key = "trajectory.velocity_file"
        velocity = make_velocity(config)
    except TableError as error:
        yield key, str(error)
        return
    except MemoryError:
        message = f"got {math.prod(config.grid.points):,}, more points than this machine's memory holds"
        yield "grid.points", f"{message}; must be fewer"
        return
    if config.time.steady is not None and velocity is not None and velocity(math.inf) == 0:
        message = f"{given.velocity_file}: ends at rest, where nothing is steady but rest"
        yield "trajectory.velocity_file", f"{message}; must end with a velocity, or time.steady be left out"
    values = trajectory.values if isinstance(trajectory, Table) else np.array([trajectory(math.inf)])
    if given.control != "depth":
        if (values < 0).any():
            message = f"{given.file}: holds a negative {given.control}; must be >= 0, there is no adhesion"
            yield "trajectory.file", message
        return
    if message := too_deep(float(values.max()), heights, make_body(config).mean_stiffness):
        yield "trajectory.depth" if given.file is None else "trajectory.file", message


def too_deep(depth: float, heights: FloatArray, mean_stiffness: float) -> str:
    """Return why a punch cannot go so deep, if so: the mean displacement of most bodies is zero.

    Parameters
    ----------
    depth : float
        The largest depth.
    heights : ndarray, one value a point
        Height of the punch above its lowest point.
    mean_stiffness : float
        Of the body; see `body.body.Body`.
    """
    mean_height = float(heights.mean())
    if mean_stiffness > 0 or depth < mean_height:
        return ""
    return (
        f"got {depth:.6g} with this punch and a body whose mean height cannot change; "
        f"must be below the mean height of the punch, {mean_height:.6g}"
    )
