"""Punch and trajectory of a case, read and checked before any work starts; imports no compiled kernel."""

from __future__ import annotations

import math

import numpy as np

from gfmdlayer.config import Config
from gfmdlayer.contact.grid import FloatArray, Grid
from gfmdlayer.contact.punch import SHAPES
from gfmdlayer.tables import TableError
from gfmdlayer.trajectory import RampHold, Table, Trajectory


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
    heights = SHAPES[config.punch.shape](**config.punch.model_dump(exclude={"shape"}))(grid)
    return np.ravel(heights)


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


def check_inputs(config: Config) -> None:
    """Read what a case reads, and see that it can be done.

    Raises
    ------
    TableError
        If a file cannot be used, or an incompressible body would have to leave the cell: with a mean
        displacement of zero the punch cannot go deeper than the mean height of its surface.
    """
    trajectory = make_trajectory(config)
    if config.trajectory.control == "load":
        if isinstance(trajectory, Table) and (trajectory.values < 0).any():
            raise TableError(
                f"{config.trajectory.file}: holds a negative load; must be >= 0, there is no adhesion"
            )
        return
    room = float(make_punch(config, make_grid(config)).mean())
    deepest = float(trajectory.values.max()) if isinstance(trajectory, Table) else trajectory(math.inf)
    if mean_is_fixed(config) and deepest >= room:
        where = f"{config.trajectory.file}" if config.trajectory.file else "trajectory.depth"
        raise TableError(
            f"{where}: the depth reaches {deepest:.6g}, but a body whose mean height cannot change has room for less "
            f"than {room:.6g}, the mean height of this punch; must be less deep, or the punch be steeper"
        )


def mean_is_fixed(config: Config) -> bool:
    """Whether the mean displacement is zero: always, but for a compressible layer on a rigid base."""
    return config.layer.poisson == 0.5 or math.isfinite(config.halfspace.shear_modulus)
