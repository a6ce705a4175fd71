"""Punch and trajectory of a case, read and checked before any work starts; imports no compiled kernel."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import Config
from gfmdlayer.files.tables import TableError
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.shapes import Shape, make_shape
from gfmdlayer.punch.topography import Topography
from gfmdlayer.punch.trajectory import Constant, RampHold, Table, Trajectory


def make_grid(config: Config) -> Grid:
    """The grid of a case."""
    return Grid(config.grid.points, config.grid.period)


def make_punch(config: Config, grid: Grid) -> FloatArray:
    """Height of the punch above its lowest point, flat, one value a grid point.

    Raises
    ------
    TableError
        If the heights come from a file that cannot be used.
    """
    return np.ravel(_shape(config)(grid))


def _shape(config: Config) -> Shape:
    return make_shape(config.punch.model_dump())


def notes(configs: Iterable[Config]) -> list[str]:
    """Tell what is done to the measured surfaces of the cases before they are used.

    Raises
    ------
    TableError
        If a file cannot be used.
    """
    found = dict[str, None]()
    for config in {(config.grid, config.punch): config for config in configs}.values():
        shape = _shape(config)
        if isinstance(shape, Topography):
            found |= dict.fromkeys(shape.continued(make_grid(config))[1])
    return list(found)


def make_trajectory(config: Config) -> Trajectory:
    """What is prescribed over time, `trajectory.control` says of what.

    Raises
    ------
    TableError
        If it comes from a file that cannot be used.
    """
    given = config.trajectory
    if given.file is not None:
        return Table.read(given.file, given.control)
    target = given.depth if given.control == "depth" else given.load
    assert target is not None and given.ramp_time is not None  # noqa: PT018
    return RampHold(target, given.ramp_time)


def make_velocity(config: Config) -> Constant | Table | None:
    """Velocity of the punch along x over time; none where it stays.

    Raises
    ------
    TableError
        If it comes from a file that cannot be used.
    """
    given = config.trajectory
    if given.velocity_file is not None:
        return Table.read(given.velocity_file, "velocity")
    return None if given.velocity is None else Constant(given.velocity)


def input_errors(configs: Iterable[Config]) -> Iterator[tuple[str, str]]:
    """Read what the cases read, and see that they can be done.

    Yields
    ------
    key, message : str
        The key that cannot be used, and why: a file that does not hold what it should, a negative load, or a
        depth for which an incompressible body would have to leave the cell. With a mean displacement of zero
        the punch cannot go deeper than the mean height of its surface.
    """
    seen = set()
    for config in configs:
        matter = (config.grid, config.punch, config.trajectory, config.time.steady, mean_is_fixed(config))
        if matter not in seen:
            seen.add(matter)
            yield from _input_errors(config)


def _input_errors(config: Config) -> Iterator[tuple[str, str]]:
    given = config.trajectory
    try:
        heights = make_punch(config, make_grid(config))
    except TableError as error:
        yield ("punch.file" if hasattr(config.punch, "file") else "punch"), str(error)
        return
    except MemoryError:
        message = f"got {math.prod(config.grid.points):,}, more points than this machine's memory holds"
        yield "grid.points", f"{message}; must be fewer"
        return
    try:
        trajectory = make_trajectory(config)
    except TableError as error:
        yield "trajectory.file", str(error)
        return
    try:
        velocity = make_velocity(config)
    except TableError as error:
        yield "trajectory.velocity_file", str(error)
        return
    if config.time.steady is not None and velocity is not None and velocity(math.inf) == 0:
        message = f"{given.velocity_file}: ends at rest, where nothing is steady but rest"
        yield "trajectory.velocity_file", f"{message}; must end with a velocity, or time.steady be left out"
    table = trajectory if isinstance(trajectory, Table) else None
    if given.control == "load":
        if table is not None and (table.values < 0).any():
            yield (
                "trajectory.file",
                f"{given.file}: holds a negative load; must be >= 0, there is no adhesion",
            )
        return
    room = float(heights.mean())
    deepest = float(table.values.max()) if table is not None else trajectory(math.inf)
    if mean_is_fixed(config) and deepest >= room:
        yield (
            "trajectory.depth" if table is None else "trajectory.file",
            f"got {deepest:.6g} with this punch and a body whose mean height cannot change; "
            f"must be below the mean height of the punch, {room:.6g}",
        )


def mean_is_fixed(config: Config) -> bool:
    """Whether the mean displacement is zero: always, but for a compressible layer on a rigid base."""
    return config.layer.poisson == 0.5 or math.isfinite(config.halfspace.shear_modulus)
