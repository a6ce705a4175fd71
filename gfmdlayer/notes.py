"""Notes on cases that are possible, but perhaps not meant: for the log, `check` and the result files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any

from gfmdlayer.body.solid import Relaxation
from gfmdlayer.config import Config
from gfmdlayer.interface.interface import Interface
from gfmdlayer.validation.problems import Location, dotted
from gfmdlayer.validation.sections import files_named, sections_in

# Keys whose defaults are numbers of the paper's dimensionless case.
DIMENSIONS = {
    **dict.fromkeys(("period", "thickness", "radius", "depth", "unit"), "length"),
    **dict.fromkeys(("G", "G0", "Ginf", "shear_modulus", "load"), "pressure"),
    **dict.fromkeys(("tau", "ramp_time", "end", "step"), "time"),
    "approach_speed": "drive / time",
}
_PLURALS = {"length": "lengths", "pressure": "moduli and pressures", "time": "times"}
# Errors of the solver, of the surface that a step finds, come back in its pressure by the glassy over the
# relaxed modulus. So much above the tolerance of adaptive steps they were seen to decide these.
_NOISE = 10
_PASSED_OVER = 0.05  # of the range of a trajectory, by which equal steps may miss a point of it
_FACTOR = 1e3  # from the paper's case, beyond which a number has another unit
_SHORT = 1e-2  # of the paper's times: where all that are given are shorter they have another unit
# Error of the force at the end of a ramp, of which a note is given, and a part of it that is small enough.
_COARSE, _ENOUGH = 0.02, 0.1
_POINTS_PASSED = 2.0  # of the grid, by which material may move in a step through a contact with friction


def notes(configs: Iterable[Config], *, surfaces: bool = True) -> list[str]:
    """Return notes on the cases, each once; without `surfaces` no measured surface is read.

    TableError if a file cannot be used.
    """
    every = list(configs)
    measured = dict.fromkeys(
        (config.grid.cell, config.punch) for config in every if surfaces and config.geometry.on_grid
    )
    found = [note for cell, punch in measured for note in punch.notes(cell)]
    found += [*_between_steps(every), *_coarse_steps(every)]
    if any(map(files_named, every)):
        found += _short_tables(every)
    found += [
        note
        for config in every
        for note in (*_on_values(config), *_unresolved_zones(config), *_on_friction(config))
    ]
    return list(dict.fromkeys(found))


def _short_tables(configs: Sequence[Config]) -> Iterator[str]:
    """Yield notes on the tables of cases that end before their runs do."""
    from gfmdlayer.programme import Programme

    every = (
        (file, quantity, last, config.time.end)
        for config in configs
        for file, quantity, last in Programme(config).tables()
    )
    for file, quantity, last, end in dict.fromkeys(every):
        if last < end:
            yield f"{file}: ends at time {last:g}, before time.end = {end:g}; the last {quantity} stays"


def _between_steps(configs: Sequence[Config]) -> Iterator[str]:
    """Yield notes on trajectories of which the equal steps of backward Euler pass over a part."""
    seen = set()
    for config in configs:
        given, time = config.trajectory, config.time
        if time.integrator != "backward_euler" or given.ramp_time is not None:
            continue
        if (parts := (given, time.end, time.step, config.grid.period)) in seen:
            continue
        seen.add(parts)
        import numpy as np

        from gfmdlayer.programme import Programme

        drive: Any = Programme(config).drive
        at = drive.times <= time.end
        times, values = drive.times[at], drive.values[at]
        steps = np.arange(round(time.end / float(time.step)) + 1) * float(time.step)
        taken = np.interp(times, steps, np.interp(steps, drive.times, drive.values))
        worst = int(np.abs(values - taken).argmax())
        if abs(values[worst] - taken[worst]) > _PASSED_OVER * float(np.ptp(values)):
            yield (
                f"time.step = {time.step:g}: the steps of backward Euler miss the {given.control} "
                f"{values[worst]:.6g} at t = {times[worst]:.6g} and use {taken[worst]:.6g} there; "
                "use a shorter step, or time.integrator: exponential, which stops at this time"
            )


def _on_values(config: Config) -> Iterator[str]:
    """Yield notes on defaults beside numbers in other units, and on a ramp that does not end."""
    left, given = _defaults(config)
    if config.units is not None:
        listed = [f"{key} = {value:g} {config.unit(_dimension(key))}" for key, value in left.items()]
        if listed:
            yield f"left at defaults, in the units given: {', '.join(listed)}"
    else:
        for dimension, plural in _PLURALS.items():
            own = [key for key in left if _dimension(key) == dimension]
            ratios = {key: each for key, each in given.items() if _dimension(key) == dimension}
            if dimension == "time":  # long relaxation times and runs are common
                foreign = list(ratios) if max(ratios.values(), default=1.0) < _SHORT else []
            else:
                foreign = [key for key, each in ratios.items() if not 1 / _FACTOR <= each <= _FACTOR]
            beside = next(iter(foreign), None)
            if own and beside is not None:
                listed = [f"{key} = {left[key]:g}" for key in own]
                yield f"left at defaults beside {beside}: {', '.join(listed)}; give all {plural} in one unit"
    ramp, end = config.trajectory.ramp_time, config.time.end
    if ramp is not None and ramp > end:
        yield f"trajectory.ramp_time = {ramp:g} is beyond time.end = {end:g}: the ramp is not completed"
    time = config.time
    if ramp is not None and time.integrator == "backward_euler" and float(time.step) >= ramp:
        yield (
            f"time.step = {time.step:g}: the indentation, up to trajectory.ramp_time = {ramp:g}, is one "
            "step, for which backward Euler is coarse; take a shorter one, or time.integrator: exponential"
        )
    if time.tolerance is not None and config.geometry.on_grid:
        stiffened, tolerance, aim = config.contrast, config.solver.tolerance, config.finer_tolerance
        enough = time.tolerance / stiffened
        if tolerance > _NOISE * enough:
            many = f"the run may need very many steps; use solver.tolerance: {enough:.1g}"
            yield (
                f"solver.tolerance = {tolerance:g} times the ratio of the glassy to the relaxed modulus, "
                f"{stiffened:.3g}, is above time.tolerance = {time.tolerance:g}: "
                + (f"the solver uses {aim:.1g}" if aim < tolerance else many)
            )
    if (duration := config.trajectory.duration) is not None and duration > end:
        yield f"the trajectory ends at {duration:g}, beyond time.end = {end:g}: it is not completed"


def _coarse_steps(configs: Sequence[Config]) -> Iterator[str]:
    """Yield notes on fixed steps that are too long for the relaxation in a ramp, see `_error_of_steps`."""
    seen = set()
    for config in configs:
        time, drive = config.time, config.trajectory
        known = config.geometry.on_grid and config.temperature is None and drive.file is None
        if not known or not config.laws or isinstance(time.step, str) or time.integrator != "exponential":
            continue
        if (parts := (drive, time, config.laws)) in seen:
            continue
        seen.add(parts)
        ramps = {t - t0 for (t0, v0), (t, v) in pairwise(drive.corners) if v != v0 and t0 < time.end}
        found = [
            (_error_of_steps(time.step, ramp, material), ramp, material)
            for ramp in ramps
            for material in config.solid.roughly(time.end)
        ]
        (error, tau), ramp, material = max(found, default=((0.0, 0.0), 0.0, (0.0, ())))
        if error <= _COARSE:
            continue
        shorter = (m * 10.0**k for k in range(math.floor(math.log10(time.step)), -31, -1) for m in (5, 2, 1))
        small = _ENOUGH * _COARSE
        enough = next(each for each in shorter if _error_of_steps(each, ramp, material)[0] <= small)
        default = "" if "step" in time.model_fields_set else ", the default,"
        yield (
            f"time.step = {time.step:g}{default} is long beside a ramp of {ramp:.3g} and the relaxation time "
            f"{tau:.3g}: the force at the end of the ramp may be {error:.1g} of itself too small; use "
            f"time.step: {enough:g}, or adaptive"
        )


def _error_of_steps(step: float, ramp: float, material: Relaxation) -> tuple[float, float]:
    """Estimate the relative error of the force at the end of a ramp, and the relaxation time behind it.

    A branch (G, tau) carries the part v of the force, G tau/T (1 - exp(-T/tau)) of the modulus after a ramp
    of duration T. Steps of length h that are exact for displacements linear in time err by v h/T times
    0.11 h/tau, at most by v h/(2 T). Measured on a parabola on a layer on a stiff base, for T from tau to
    30 tau and h up to 10 tau: within a fifth for h < tau and a third beyond. On a soft base it is less.
    """
    relaxed, branches = material
    length = min(step, ramp)
    viscous = [(-G * tau / ramp * math.expm1(-ramp / tau), tau) for G, tau in branches]
    if (whole := relaxed + sum(part for part, _ in viscous)) <= 0:
        return 0.0, 0.0
    of_each = [(part / whole * length / ramp * min(0.11 * length / tau, 0.5), tau) for part, tau in viscous]
    return sum(error for error, _ in of_each), max(of_each, default=(0.0, 0.0))[1]


def _unresolved_zones(config: Config) -> Iterator[str]:
    """Yield notes on interface laws whose cohesive zone is too narrow for the grid.

    At the edge of a contact the traction acts over l = (pi/4) E* range^2/work (D. Maugis, J. Colloid
    Interface Sci. 150 (1992) 243-269), with range = work/strength and the relaxed E* = 2 G0/(1 - nu).
    """
    for at, law in sections_in(config):
        if not isinstance(law, Interface) or not (found := law.interaction(config.units)).attracts:
            continue
        if (modulus := config.solid.contact_modulus) is None:
            continue
        zone = math.pi / 4 * modulus * found.range**2 / found.work
        cell = list(zip(config.grid.points, config.grid.period, strict=True))
        in_zone = min(zone * points / period for points, period in cell)
        if in_zone < (wanted := law.points_in_zone):
            enough = [max(points, 1 << math.ceil(math.log2(wanted * x / zone))) for points, x in cell]
            yield (
                f"{dotted(at)}: its cohesive zone, (pi/4) E* range^2/work = {zone:.3g} with the relaxed "
                f"modulus, is {in_zone:.2g} points wide; at least {wanted} are needed: "
                f"use grid.points: {enough[0] if len(enough) == 1 else enough}"
            )


def _on_friction(config: Config) -> Iterator[str]:
    """Yield notes on a tangential force that friction does not hold, and on steps that pass over slip."""
    if not config.friction:
        return
    given, drive, time = config.trajectory, config.trajectory.tangential, config.time
    coefficients = (getattr(law, "coefficient", math.inf) for law in config.friction)
    most = min((each for each in coefficients if isinstance(each, float)), default=math.inf)
    pressed = None if config.interfaces else given.load if given.control == "load" else given.force
    if drive is not None and drive.force is not None and pressed is not None:
        most *= pressed * (math.prod(config.grid.period) if given.control == "load" else 1.0)
        if most * (1 - 1e-9) <= abs(drive.force):
            yield (
                f"trajectory.tangential.force = {drive.force:g}: friction holds at most {most:g}; the punch "
                "slides away, and the run ends there"
            )
    if given.velocity and not isinstance(time.step, str):
        spacing = config.grid.period[0] / config.grid.points[0]
        if (passed := abs(given.velocity) * time.step / spacing) > _POINTS_PASSED:
            yield (
                f"time.step = {time.step:g}: the material moves by {passed:.3g} grid points in a step; "
                f"with friction use time.step: {spacing / abs(given.velocity):.4g}, or adaptive"
            )


def _defaults(config: Config) -> tuple[dict[str, float], dict[str, float]]:
    """Return the dimensional keys left out, with their defaults, and those given, over the paper's values."""
    left: dict[str, float] = {}
    given: dict[str, float] = {}
    thicknesses = {
        getattr(part, "thickness", None)
        for at, part in sections_in(config)
        if at[:1] in {("layer",), ("layers",)}
    }
    unused: dict[Location, bool] = {
        ("halfspace",): math.inf in thicknesses,
        ("layer",): 0.0 in thicknesses,
        ("grid",): not config.geometry.on_grid,
    }
    follows = {("time", "end")} if config.trajectory.duration is not None else set()
    for at, section in sections_in(config):
        if unused.get(at[:1]):
            continue
        for key in type(section).model_fields:
            value = _number(getattr(section, key)) if key in DIMENSIONS else 0.0
            if value in {0.0, math.inf} or (*at, key) in follows:
                continue
            default = type(section).model_fields[key].default
            if key not in section.model_fields_set:
                left[dotted((*at, key))] = value
            else:
                given[dotted((*at, key))] = abs(value / (_number(default) or 1.0))
    return left, given


def _number(value: object) -> float:
    """Return a number, the largest of several; 0 for anything else."""
    if isinstance(value, tuple):
        return max(map(_number, value), default=0.0)
    return float(value) if isinstance(value, int | float) else 0.0


def _dimension(key: str) -> str:
    """Return the dimension of a dotted key; the period of an oscillation is a time."""
    *_, section, last = f".{key}".split(".")
    return "time" if (section, last) == ("tangential", "period") else DIMENSIONS[last]
