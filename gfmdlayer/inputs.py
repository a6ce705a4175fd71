"""Grid, body, punch and trajectory of a case, checked before any work starts; imports no compiled kernel."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.body.materials import Material, PronySeries
from gfmdlayer.body.solid import fault
from gfmdlayer.body.temperature import shifts
from gfmdlayer.body.wavevectors import Wavevectors
from gfmdlayer.config import Config
from gfmdlayer.config.bodies import place_of
from gfmdlayer.config.layers import Layers
from gfmdlayer.files.tables import TableError
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import ALONE, MpiRanks, Ranks
from gfmdlayer.grid.slabs import SlabGrid
from gfmdlayer.grid.sums import mean
from gfmdlayer.history.reduced_time import ReducedTime
from gfmdlayer.indentation import admissible
from gfmdlayer.interface.law import Interaction, InterfaceLaw, total
from gfmdlayer.punch.height_files import fitting
from gfmdlayer.time_functions import Constant, RampHold, Table, Trajectory
from gfmdlayer.validation.sections import files_named

FEW_WAVES = 6  # along an axis, at which a body of the user's own is computed before a run


def make_grid(config: Config, ranks: Ranks = ALONE) -> Grid:
    """Return the grid of a case, over the ranks that compute it."""
    if isinstance(ranks, MpiRanks):
        return SlabGrid(config.grid.points, config.grid.period, members=ranks)
    return Grid(config.grid.points, config.grid.period)


def make_body(config: Config, materials: Sequence[Material]) -> Body:
    """Return the body with a material for each of `config.laws`; modes merge to the solver's tolerance."""
    return config.solid.with_series(materials, config.solver.tolerance)


def make_punch(config: Config, grid: Grid) -> FloatArray:
    """Return the height of the punch above its lowest point, flat, one value a grid point.

    Raises
    ------
    TableError
        If the heights come from a file that cannot be used, or are not finite.
    """
    with grid.ranks.agreeing(TableError):
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
    unit = math.prod(config.grid.period) if given.control == "force" else 1.0  # 1 of an isolated contact
    if given.file is not None:
        table = Table.read(given.file, given.control)
        return Table(table.times, table.values / unit)
    if given.ramp_time is not None:
        return RampHold(getattr(given, given.control) / unit, given.ramp_time)
    times, values = np.array(given.corners).T
    return Table(times, values / unit)


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


def make_clocks(config: Config) -> tuple[ReducedTime | None, ...]:
    """Return the reduced time of each of `config.laws`; None for one that has no shift or does not relax.

    Raises
    ------
    TableError
        If the temperature comes from a file that cannot be used: outside of the range of a shift, or ending
        before the run does.
    """
    given, relaxing = config.temperature, shifts(config).values()
    if given is None:
        return (None,) * len(config.laws)
    temperature: Constant | Table
    if given.file is None:
        assert given.value is not None
        temperature = Constant(given.value)
    else:
        every = list(filter(None, relaxing))
        temperature = Table.read(
            given.file, "temperature", lambda row: next(filter(None, (s.refused(row[1]) for s in every)), "")
        )
        last, end = float(temperature.times[-1]), config.time.end
        if last < end:
            raise TableError(f"{given.file}: ends at time {last:g}; must reach time.end = {end:g}")
    felt = (None if isinstance(law, Material) and law.elastic else law.shift for law in config.laws)
    return tuple(None if shift is None else ReducedTime(shift, temperature) for shift in felt)


def make_reduced_time(config: Config) -> ReducedTime | None:
    """Return the reduced time of the whole body; None without a temperature, and where shifts differ.

    Raises
    ------
    TableError
        As of `make_clocks`.
    """
    found = list(filter(None, make_clocks(config)))
    return found[0] if len({each.shift for each in found}) == 1 else None


def make_interface(config: Config) -> Interaction:
    """Return the interaction of surface and punch; TableError if a voltage's file cannot be used."""
    return total(law.interaction(config.units) for law in config.interfaces)


def kinks(
    clocks: Iterable[ReducedTime | None], *prescribed: Trajectory | InterfaceLaw | None
) -> tuple[float, ...]:
    """Return the times at which the slope of a prescribed quantity jumps, that of the temperature too."""
    temperature = next((clock.temperature for clock in clocks if clock is not None), None)
    every = (*prescribed, temperature)
    return tuple(time for each in every if each is not None for time in each.kinks)


def times_of_response(
    config: Config,
    grid: Grid,
    velocity: Constant | Table | None,
    kinks: Iterable[float],
    reduced_time: ReducedTime | None,
) -> tuple[float, float]:
    """Return the shortest and the longest time over which the body's response matters.

    The longest is the end of the run. The shortest is the time step; with adaptive steps it is the part of
    the shortest ramp, between kinks of the trajectory, that their tolerance is: what relaxes within it
    changes the pressure by no more than that. A punch that moves along the surface also drives the grid's
    shortest waves. With a temperature these are reduced times, at any time of the run.

    Parameters
    ----------
    config : Config
        The configuration.
    grid : Grid
        Its grid.
    velocity : Constant or Table, optional
        Of the punch along x.
    kinks : iterable of float
        Times at which the slope of a prescribed quantity jumps.
    reduced_time : ReducedTime, optional
        In which the law relaxes.

    Returns
    -------
    float, float
    """
    time = config.time
    if isinstance(time.step, str):
        stops = [0.0, *sorted(kink for kink in set(kinks) if 0 < kink < time.end), time.end]
        assert time.tolerance is not None
        shortest = time.tolerance * min(map(float, np.diff(stops)))
    else:
        shortest = time.step
    fastest = 0.0
    if velocity is not None:
        values = velocity.values if isinstance(velocity, Table) else velocity.value
        fastest = float(np.abs(values).max()) * float(np.abs(grid.wavevectors[0]).max())
    shortest = min(shortest, 1 / fastest) if fastest else shortest
    least, most = (1.0, 1.0) if reduced_time is None else reduced_time.extremes
    return shortest / most, time.end / least


def make_series(config: Config) -> tuple[PronySeries, ...]:
    """Return the laws of layers and halfspace as series of Maxwell branches, over the times of a case.

    Raises
    ------
    TableError
        If a file that the times follow from cannot be used.
    """
    velocity, clocks = make_velocity(config), make_clocks(config)
    every = kinks(clocks, make_trajectory(config), velocity, make_interface(config))
    grid = make_grid(config)
    times = (times_of_response(config, grid, velocity, every, clock) for clock in clocks)
    return tuple(law.prony(*each) for law, each in zip(config.laws, times, strict=True))


def input_errors(configs: Iterable[Config], ranks: Ranks = ALONE) -> Iterator[tuple[str, str]]:
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
        held = config.solid.mean_stiffness
        inputs = (
            *(config.grid, config.body, held),
            *(config.punch, config.trajectory, config.time.steady, config.interface),
            *(config.temperature, config.temperature and config.time.end, *shifts(config).values()),
        )
        if inputs not in seen:
            seen.add(inputs)
            yield from _input_errors(config, ranks)


def _input_errors(config: Config, ranks: Ranks) -> Iterator[tuple[str, str]]:
    given, names = config.trajectory, files_named(config)
    key = next((name for name in names if name.startswith("punch.")), "punch")
    if config.grid.axisymmetric:
        try:
            config.punch.revolution()  # type: ignore[attr-defined]  # which the configuration has checked
            key = "trajectory.file"
            yield from admissible.table_errors(config, make_trajectory(config))
        except TableError as error:
            yield key, str(error)
        return
    if message := _fault_of_the_body(config):
        yield "body.file" if "body.file" in names else "body", message
        return
    try:
        heights = make_punch(config, make_grid(config, ranks))
        key = "trajectory.file"
        trajectory = make_trajectory(config)
        key = "trajectory.velocity_file"
        velocity = make_velocity(config)
        key = "temperature.file"
        make_clocks(config)
        key = "interface"
        make_interface(config)
    except TableError as error:
        blamed = (name for name, path in names.items() if name.startswith(key) and str(path) in str(error))
        yield next(blamed, key).replace("[", ".").replace("]", ""), str(error)
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
        if (values < 0).any() and not config.interfaces:
            message = f"{given.file}: holds a negative {given.control}; must be >= 0, there is no adhesion"
            yield "trajectory.file", message
        return
    if message := too_deep(float(values.max()), mean(heights, ranks), config.solid.mean_stiffness):
        yield "trajectory.depth" if given.file is None else "trajectory.file", message


def _fault_of_the_body(config: Config) -> str:
    """Compute a body that is not made of layers at some waves of the grid; return why it cannot be used."""
    if config.body is None or isinstance(config.body, Layers):
        return ""
    every = (np.ravel(axis) for axis in make_grid(config).wavevectors)
    axes = [q[np.argsort(np.abs(q))][:: max(1, q.size // FEW_WAVES)] for q in every]  # q = 0 first
    waves = Wavevectors.of_components(*(np.ravel(q) for q in np.meshgrid(*axes, indexing="ij")))
    try:
        return fault(make_body(config, [series.material for series in make_series(config)]), waves)
    except TableError:
        return ""  # which is reported for the file that it is in
    except Exception as error:
        return f"{place_of(error, str(getattr(config.body, 'file', '')))}; must be computed without an error"


def too_deep(depth: float, mean_height: float, mean_stiffness: float) -> str:
    """Return why a punch cannot go so deep, if so: the mean displacement of most bodies is zero.

    Parameters
    ----------
    depth : float
        The largest depth.
    mean_height : float
        Of the punch, above its lowest point.
    mean_stiffness : float
        Of the body; see `body.body.Body`.
    """
    if mean_stiffness > 0 or depth < mean_height:
        return ""
    found = f"got {depth:.6g} with this punch and a body whose mean height cannot change"
    return f"{found}; must be below the mean height of the punch, {mean_height:.6g}"
