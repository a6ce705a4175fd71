"""Checks that need more than one value: what is possible in physics, and what contradicts itself.

Each check yields a `Problem` that names every key it rests on, so that a value already refused for itself
is not blamed a second time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from gfmdlayer.config.input_errors import Location, Problem, shown
from gfmdlayer.config.punch_checks import punch_conflicts
from gfmdlayer.config.sections import MANY

if TYPE_CHECKING:
    from gfmdlayer.config.model import Config

_MOST_ROWS = 1_000_000  # of a case


def conflicts(config: Config) -> Iterator[Problem]:
    """Yield what is wrong between the values of one case."""
    for check in (_grid, _solid, punch_conflicts, _trajectory, _motion, _time, _solver, _output):
        yield from check(config)


def _problem(key: str, message: str, *others: str) -> Problem:
    return Problem(tuple(key.split(".")), message, others)


def _grid(config: Config) -> Iterator[Problem]:
    points, period = config.grid.points, config.grid.period
    if len(period) != len(points):
        yield _problem(
            "grid.period",
            f"got {len(period)} lengths for {len(points)} direction{'s' * (len(points) > 1)} of points; "
            "must be one number, or one for each direction",
            "grid.points",
        )
    if math.prod(points) >= MANY:
        message = f"got {shown(points)}, {math.prod(points):.3g} points; must be fewer than 2^31 in all"
        yield _problem("grid.points", message)


def _solid(config: Config) -> Iterator[Problem]:
    layer, bulk, material = config.layer, config.halfspace.shear_modulus, config.layer.material
    if material.model == "zener" and material.Ginf < material.G0:
        yield _problem(
            "layer.material.Ginf",
            f"got {material.Ginf!r}, below G0 = {material.G0!r}; must be a number >= G0 (relaxation softens)",
            "layer.material.G0",
        )
    if layer.thickness == 0 and bulk in {0, math.inf}:
        kind = (
            "rigid halfspace: nothing is left to deform"
            if bulk
            else "halfspace without stiffness: nothing carries a load"
        )
        yield _problem(
            "layer.thickness",
            f"got 0 on a {kind}; must be > 0, or halfspace.shear_modulus a number > 0 and finite",
            "halfspace.shear_modulus",
        )


def _trajectory(config: Config) -> Iterator[Problem]:
    given = config.trajectory
    table, other = given.kind == "table", "load" if given.control == "depth" else "depth"
    switches = ("trajectory.control", "trajectory.kind")
    if table and given.file is None:
        yield _problem("trajectory.file", "missing; kind: table must be given the name of a file", *switches)
    if not table and given.file is not None:
        yield _problem(
            "trajectory.file", "given, but kind is ramp_hold; must be left out, or kind be table", *switches
        )
    if table and given.ramp_time is not None:
        yield _problem(
            "trajectory.ramp_time", "given, but the table sets the times; must be left out", *switches
        )
    if table and getattr(given, given.control) is not None:
        yield _problem(
            f"trajectory.{given.control}", "given, but the table sets it; must be left out", *switches
        )
    if getattr(given, other) is not None:
        message = f"given, but control is {given.control}; must be left out, or control be {other}"
        yield _problem(f"trajectory.{other}", message, *switches)
    if not table and given.control == "load" and given.load is None:
        yield _problem(
            "trajectory.load",
            "missing; control: load must be given a number >= 0, the mean pressure",
            *switches,
        )


def _motion(config: Config) -> Iterator[Problem]:
    given, time = config.trajectory, config.time
    moves = [key for key in ("velocity", "velocity_file") if getattr(given, key) is not None]
    if len(moves) == 2:
        message = "given, but velocity is a number; must be left out, or velocity be left out"
        yield _problem("trajectory.velocity_file", message, "trajectory.velocity")
    if moves and time.integrator == "backward_euler":
        message = "got backward_euler with a moving punch; must be exponential, which follows it"
        yield _problem("time.integrator", message, f"trajectory.{moves[0]}")
    if time.steady is not None and (not moves or given.velocity == 0):
        message = "given, but the punch does not move; must be left out, or trajectory.velocity be a number"
        yield _problem("time.steady", message, "trajectory.velocity", "trajectory.velocity_file")


def _time(config: Config) -> Iterator[Problem]:
    time = config.time
    if time.step == "adaptive":
        if time.integrator == "backward_euler":
            yield _problem(
                "time.integrator",
                "got backward_euler with step: adaptive; must be exponential, which estimates its error",
                "time.step",
            )
        return
    if time.tolerance is not None:
        message = "given, but a fixed step has no use for it; must be left out, or time.step be adaptive"
        yield _problem("time.tolerance", message, "time.step")
    if time.step > time.end:
        message = f"got {time.step!r}, beyond time.end = {time.end!r}; must be a number <= time.end"
        yield _problem("time.step", message, "time.end")
    elif time.integrator == "backward_euler":
        # Its steps are equal, as the paper's; the exponential integrator shortens a step to land.
        allowed = f"must be a whole number of steps of {time.step!r}, or time.integrator be exponential"
        if not whole_steps(time.end, time.step):
            yield _problem("time.end", f"got {time.end!r}; {allowed}", "time.step", "time.integrator")
        for i, snapshot in enumerate(config.output.snapshots):
            if not whole_steps(snapshot, time.step):
                location: Location = ("output", "snapshots", i)
                others = ("time.step", "time.integrator")
                yield Problem(location, f"got {snapshot!r}; {allowed}", others)


def plainly_possible(config: Config) -> bool:
    """Whether a case needs no look at numbers or files: a parabola that stays well above its mean height.

    L^2/(24 R).
    """
    punch, given = config.punch, config.trajectory
    if given.file is not None or given.velocity_file is not None:
        return False
    if punch.shape != "parabola" or isinstance(punch.radius, tuple):
        return False
    room = sum(length**2 for length in config.grid.period) / (24 * punch.radius)
    return given.control == "load" or (given.depth is not None and given.depth < room / 2)


def whole_steps(time: float, step: float) -> bool:
    """Whether a time is a whole number of steps, within a millionth of one."""
    return abs(time / step - round(time / step)) <= 1e-6


def _solver(config: Config) -> Iterator[Problem]:
    solver = config.solver
    if solver.inertia is not None and solver.method != "fire":
        message = f"given, but method is {solver.method}; must be left out, or method be fire"
        yield _problem("solver.inertia", message, "solver.method")


def _output(config: Config) -> Iterator[Problem]:
    end, output = config.time.end, config.output
    yield from _sequence("output.snapshots", output.snapshots, end)
    if isinstance(output.times, tuple):
        yield from _sequence("output.times", output.times, end)
    elif output.times is not None and not 0 < output.times <= end:
        message = f"got a spacing of {output.times!r}; must be a number > 0 and <= time.end = {end!r}"
        yield _problem("output.times", message, "time.end")
    elif output.times is not None and end / output.times > _MOST_ROWS:
        message = f"got {output.times!r}, {end / output.times:.3g} rows; must be >= {end / _MOST_ROWS!r}"
        yield _problem("output.times", message, "time.end")
    if output.times is not None and config.time.step != "adaptive":
        message = "given, but a fixed step records every step; must be left out, or time.step be adaptive"
        yield _problem("output.times", message, "time.step")


def _sequence(key: str, times: tuple[float, ...], end: float) -> Iterator[Problem]:
    for i, time in enumerate(times):
        location: Location = (*key.split("."), i)
        if time > end:
            message = f"got {time!r}, past the end; must be a number <= time.end = {end!r}"
            yield Problem(location, message, ("time.end",))
        if i and time <= times[i - 1]:
            yield Problem(
                location, f"got {time!r} after {times[i - 1]!r}; must be larger, times increase", (key,)
            )
