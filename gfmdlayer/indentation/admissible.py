"""What a configuration may ask of punch and geometry, periodic or isolated; imports no numerics."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from gfmdlayer.punch.shapes import SHAPES
from gfmdlayer.validation.problems import Problem, shown
from gfmdlayer.validation.sections import files_named

if TYPE_CHECKING:
    from gfmdlayer.validation.sections import Section

# Keys that describe a periodic cell, its contact solver, or observables of its surface.
_PERIODIC = {
    "grid": ("period",),
    "solver": None,
    "trajectory": ("velocity", "velocity_file"),
    "time": ("integrator", "steady"),
    "output": ("patches", "histograms", "keep_state"),
}
_GEOMETRY = ("grid.geometry",)


def problems(config: Any) -> Iterator[Problem]:
    """Yield why a punch does not fit into its cell, or cannot be an isolated one of revolution.

    Parameters
    ----------
    config : Config
        A configuration.
    """
    if not config.grid.axisymmetric:
        fit = config.punch.misfits(config.grid.cell)
        yield from (each.within(("punch",), "grid.points", "grid.period", "punch.shape") for each in fit)
        return
    yield from _periodic_keys(config)
    if config.temperature is not None:
        message = "given with grid.geometry: axisymmetric, which has no temperature; must be left out"
        yield Problem(("temperature",), message, _GEOMETRY)
    if config.trajectory.control == "load":
        message = (
            "got 'load', a mean pressure, which an isolated contact does not have; must be depth or force"
        )
        yield Problem(("trajectory", "control"), message, _GEOMETRY)
    if config.output.snapshots == "every":
        message = "got 'every', without meaning for grid.geometry: axisymmetric; must be a list of times"
        yield Problem(("output", "snapshots"), message, _GEOMETRY)
    yield from _of_the_punch(config.punch)
    yield from _of_the_base(config)


def _periodic_keys(config: Any) -> Iterator[Problem]:
    """Refuse values, other than the defaults, that describe something periodic."""
    for name, keys in _PERIODIC.items():
        section: Section = getattr(config, name)
        plain = type(section)()
        for key in keys or type(section).model_fields:
            value = getattr(section, key, None)
            if value is not None and value != getattr(plain, key):
                message = (
                    f"got {shown(value)}, without meaning for grid.geometry: axisymmetric; must be left out"
                )
                yield Problem((name, key), message, _GEOMETRY)


def _of_the_punch(punch: Any) -> Iterator[Problem]:
    if not hasattr(punch, "revolution"):
        allowed = ", ".join(word for word, shape in SHAPES.items() if hasattr(shape, "revolution"))
        message = f"got {punch.shape!r}, which is no convex body of revolution; must be one of {allowed}"
        yield Problem(("punch", "shape"), message, _GEOMETRY, chooses=True)
        return
    for key, value in vars(punch).items():
        if isinstance(value, tuple):
            message = f"got {shown(value)}; must be one number for a body of revolution"
            yield Problem(("punch", key), message, _GEOMETRY)


def _of_the_base(config: Any) -> Iterator[Problem]:
    yield from (problem.within((), *_GEOMETRY) for problem in config.solid.problems_isolated())
    depth, thickness = config.trajectory.depth, config.solid.rigid_below
    if depth is not None and depth >= thickness:
        message = f"got {depth!r}, beyond the rigid base; must be below the thickness above it, {thickness!r}"
        yield Problem(("trajectory", "depth"), message, ("layer.thickness", "layers", "halfspace"))


def table_errors(config: Any, trajectory: Any) -> Iterator[tuple[str, str]]:
    """Yield key and message of depths or forces of a table that are not possible.

    Parameters
    ----------
    config : Config
        A configuration with grid.geometry: axisymmetric.
    trajectory : Trajectory
        Its trajectory.
    """
    file, control = config.trajectory.file, config.trajectory.control
    if file is None:
        return
    least, most = float(trajectory.values.min()), float(trajectory.values.max())
    thickness = config.solid.rigid_below
    if control == "force" and least < 0:
        yield "trajectory.file", f"{file}: holds a negative force; must be >= 0, there is no adhesion"
    if control == "depth" and most >= thickness:
        message = f"{file}: holds a depth of {most:.6g}, beyond the rigid base"
        yield "trajectory.file", f"{message}; must be below the thickness above it, {thickness!r}"


def plainly_possible(config: Any) -> bool:
    """Whether no table has to be read, and the depth is well below a mean height in closed form.

    Parameters
    ----------
    config : Config
        A configuration.
    """
    given = config.trajectory
    if config.grid.axisymmetric:
        return given.file is None and not hasattr(config.punch, "file")
    if config.body is not None:  # which is computed once before the run
        return False
    mean_height = config.punch.mean_height(config.grid.cell)
    if files_named(config) or mean_height is None:
        return False
    return given.control != "depth" or (given.depth is not None and given.depth < mean_height / 2)
