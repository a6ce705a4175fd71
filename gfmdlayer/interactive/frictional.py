"""`gfmdlayer.solve` with friction: one step of a punch that sticks and slips, as labelled data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.friction.problem import Law, Problem, Solution
from gfmdlayer.friction.response import Response
from gfmdlayer.friction.solver import FrictionSolver
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.interactive.one_contact import MEANINGS, dataset, meaning, numbers_in
from gfmdlayer.interface.law import Interaction
from gfmdlayer.model import ConvergenceError
from gfmdlayer.observables.contact_statistics import area_error, interpolated_area
from gfmdlayer.validation.problems import ConfigError, shown

if TYPE_CHECKING:
    import xarray

FRICTIONAL = "friction", "tangential_force", "tangential_displacement", "previous"  # options of `solve`

_TOLERANCE, _LIMIT = 1e-7, 60  # residual and Newton steps, where nothing is given


def with_friction(
    body: Body,
    grid: Grid,
    heights: FloatArray,
    target: tuple[str, float],
    *,
    glassy: bool,
    solver: Mapping[str, Any],
    interface: Interaction,
    friction: float | Mapping[str, float],
    tangential_force: float | Sequence[float] | None = None,
    tangential_displacement: float | Sequence[float] | None = None,
    previous: xarray.Dataset | None = None,
) -> xarray.Dataset:
    """Return the contact under a load or at a depth, `target`, and under shear."""
    if "method" in solver:
        raise ConfigError(["method: not with friction, which has one solver; remove it"])
    if tangential_force is not None and tangential_displacement is not None:
        raise ConfigError(["tangential_force: given with tangential_displacement; must be one of the two"])
    response, axes = _response(body, grid, glassy), len(grid.points)
    moved, before, start, gap = _taken_from(previous, grid)
    force, at = None, moved
    if tangential_force is not None:
        force = _components("tangential_force", tangential_force, axes) / math.prod(grid.period)
    if tangential_displacement is not None:
        at = _components("tangential_displacement", tangential_displacement, axes)
    control, value = target
    problem = Problem(
        response,
        heights,
        _law(friction),
        load=value if control == "load" else None,
        depth=value if control == "depth" else 0.0,
        force=force,
        path=None if force is not None else at - moved,
        before=before,
        interface=interface,
    )
    if reason := problem.why_not_solvable():
        raise ConfigError([f"tangential_force: {reason}"])
    tolerance, limit = solver.get("tolerance", _TOLERANCE), solver.get("max_iterations", _LIMIT)
    method = FrictionSolver(grid, Transforms(grid.points), attracts=interface.attracts)
    found = method.solve(problem, start, gap=gap, tolerance=tolerance, limit=limit)
    if not found.converged:
        raise ConvergenceError(found.reason)
    return _dataset(grid, found, moved + found.path)


def _response(body: Body, grid: Grid, glassy: bool) -> Response:
    """Return the response of a body in all directions, relaxed or to a sudden load."""
    offered = getattr(body, "traction_spectrum", None)
    if offered is None:
        needed = "must be a halfspace or layers, with the method traction_spectrum"
        raise ConfigError([f"body: {type(body).__name__} has no response to shear; {needed}"])
    spectrum = offered(grid.waves)
    plane, across = spectrum.in_plane, spectrum.across
    if glassy:
        return Response.of_stiffness(plane.glassy, across.glassy)
    return Response.of_stiffness(plane.relaxed, across.relaxed)


def _law(friction: float | Mapping[str, float]) -> Law:
    """Return the bound of the shear traction."""
    given = dict(friction) if isinstance(friction, Mapping) else {"coefficient": friction}
    if not given or set(given) - {"coefficient", "strength"}:
        keys = ", ".join(map(str, given)) or "nothing"
        raise ConfigError([f"friction: got {keys}; must be a number, or a mapping of coefficient, strength"])
    for name, value in given.items():
        number = numbers_in(value)
        if number.size != 1 or not number[0] >= 0:
            raise ConfigError([f"friction.{name}: got {shown(value)}; must be a number >= 0"])
        given[name] = float(number[0])
    return Law(**given)


def _components(name: str, value: float | Sequence[float], axes: int) -> FloatArray:
    """Return the components along the axes; of a number, that along x."""
    given = numbers_in(value)
    if given.ndim > 1 or given.size > axes or not np.isfinite(given).all():
        allowed = "a number" if axes == 1 else "a number, or a pair along x and y"
        raise ConfigError([f"{name}: got {shown(value)}; must be {allowed}, finite"])
    return np.concatenate((given, np.zeros(axes - given.size)))


def _taken_from(
    previous: xarray.Dataset | None, grid: Grid
) -> tuple[FloatArray, FloatArray | None, FloatArray | None, FloatArray | None]:
    """Return place of the punch, tangential displacements, tractions and gap of a result."""
    axes = "xy"[: len(grid.points)]
    if previous is None:
        return np.zeros(len(axes)), None, None, None
    for name in ("displacement", "shear", "tangential_displacement"):
        for axis in axes:
            if f"{name}_{axis}" not in previous:
                must = "must be a result of solve with friction"
                raise ConfigError([f"previous: has no {name}_{axis}; {must}"])
    if previous["pressure"].shape != grid.shape:
        shapes = f"{previous['pressure'].shape}; must be {grid.shape}"
        raise ConfigError([f"previous: has the shape {shapes}"])

    def fields(name: str) -> list[FloatArray]:
        return [np.ravel(previous[f"{name}_{axis}"].to_numpy()) for axis in axes]

    moved = np.array([float(previous[f"tangential_displacement_{axis}"]) for axis in axes])
    pressure, gap = (np.ravel(previous[name].to_numpy()) for name in ("pressure", "gap"))
    return moved, np.array(fields("displacement")), np.array([pressure, *fields("shear")]), gap


def _dataset(grid: Grid, found: Solution, moved: FloatArray) -> xarray.Dataset:
    """Return fields and scalars of a solution."""
    area, touching = math.prod(grid.period), found.contact
    pressed, gap = found.pressure.reshape(grid.shape), np.where(touching, 0.0, np.maximum(found.gap, 0.0))
    interpolated = interpolated_area(touching.reshape(grid.shape), pressed, gap.reshape(grid.shape), grid)
    fields = {
        "pressure": found.stress,
        "displacement": -found.displacement[0],
        "gap": gap,
        "contact": touching,
        "stick": found.stick,
    }
    scalars = {
        "contact_area": touching.mean(),
        "contact_area_interpolated": interpolated,
        "contact_area_error": area_error(touching.reshape(grid.shape), interpolated, grid),
        "stick_area": found.stick.mean(),
        "mean_pressure": found.stress.mean(),
        "force": found.stress.mean() * area,
        "depth": found.depth,
        "residual": found.residual,
        "transforms": found.pairs,
        "iterations": found.iterations,
    }
    for i, axis in enumerate("xy"[: len(grid.points)]):
        fields[f"shear_{axis}"] = found.traction[i]
        fields[f"slip_{axis}"] = np.where(touching, found.slip[i], np.nan)
        fields[f"displacement_{axis}"] = found.displacement[1 + i]
        scalars[f"tangential_force_{axis}"] = found.traction[i].mean() * area
        scalars[f"tangential_displacement_{axis}"] = moved[i]
    return dataset(grid, fields, scalars, _MEANINGS)


def _along(axis: str) -> dict[str, dict[str, str]]:
    """Meanings of components along an axis."""
    return {
        f"shear_{axis}": meaning(f"shear traction of the punch on the surface along {axis}", "pressure"),
        f"slip_{axis}": meaning(f"slip of the surface against the punch in the step along {axis}", "length"),
        f"displacement_{axis}": meaning(f"displacement of the surface along {axis}", "length"),
        f"tangential_force_{axis}": meaning(
            f"force of the punch along {axis}, of a line per length", "pressure area"
        ),
        f"tangential_displacement_{axis}": meaning(f"displacement of the punch along {axis}", "length"),
    }


_MEANINGS = {
    **MEANINGS,
    **_along("x"),
    **_along("y"),
    "stick": meaning("whether the point is in contact and below the bound of friction"),
    "stick_area": meaning("relative area of the points that stick"),
    "residual": meaning("residual of the frictional contact"),
    "transforms": meaning("pairs of Fourier transforms of one component; half for single precision"),
    "iterations": meaning("Newton steps"),
}
