"""The geometries of a contact, as a configuration sees them. Imports no numerics.

`GEOMETRIES` is the one table of `grid.geometry`. Each geometry names its `Model` (`gfmdlayer/case/model.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gfmdlayer.interface.adhesion import ShortRange
from gfmdlayer.punch.shapes import SHAPES
from gfmdlayer.validation.problems import Location, Mistake, Reason, shown
from gfmdlayer.validation.sections import files_named, plain

if TYPE_CHECKING:
    from gfmdlayer.validation.sections import Section

_GEOMETRY = ("grid.geometry",)
WHOLE_SPACINGS = "without images the material moves by whole spacings of the grid in a step"
_BOUNDARY = ("grid.boundary",)
# Keys that describe a periodic cell, its contact solver, or observables of its surface.
_PERIODIC = {
    "grid": ("period", "boundary", "datum"),
    "solver": None,
    "trajectory": ("velocity", "velocity_file"),
    "time": ("integrator", "steady"),
    "output": ("patches", "histograms", "observables", "leakage", "conductance", "stiffness", "inside",
               "keep_state"),
}  # fmt: skip
_NOT_YET = {"conductance", "stiffness", "inside"}  # which an indenter of revolution has too
FINEST = 1e-9  # least tolerance of an isolated indenter: far below it nodes fill the memory (1e-20: 238 GiB)
_REVOLUTION = "grid.geometry: axisymmetric"
_OF_A_CELL = {"load": "a mean pressure", "gap": "a mean gap"}


@dataclass(frozen=True)
class Geometry:
    """A value of `grid.geometry`."""

    model: str  # module and class of its `Model`, "package.module:Class"
    points: int = 256  # default of `grid.points`
    on_grid: bool = False  # whether the surface has a periodic grid: a cell, transforms and a contact solver
    # From a `Config` to its contradictions with this geometry, which have a place in the YAML file.
    problems: Callable[[Any], Iterator[Mistake]] = lambda _config: iter(())
    # From a `Config` to whether `Model.problems` need not look at it before the run.
    plainly_possible: Callable[[Any], bool] = lambda _config: False


def _problems_in_a_cell(config: Any) -> Iterator[Mistake]:
    """Yield why a punch does not fit into the periodic cell."""
    if config.grid.extent is not None:
        message = "only for geometry: axisymmetric; remove it or change the geometry"
        yield Mistake(("grid", "extent"), message, _GEOMETRY)
    for at, law in config.interface_laws.items():
        if isinstance(law, ShortRange):
            message = f"got {law.law!r}; must have a range that the grid resolves, such as exponential"
            yield Mistake((*at, "law"), message, _GEOMETRY, chooses=True, because="physics")
    fit = config.punch.misfits(config.grid.cell)
    yield from (mistake.within(("punch",), "grid.points", "grid.period", "punch.shape") for mistake in fit)
    if config.grid.isolated:
        yield from _problems_without_images(config)
    elif config.grid.datum is not None:
        message = "only for boundary: isolated; remove it or set grid.boundary: isolated"
        yield Mistake(("grid", "datum"), message, _BOUNDARY)


def _problems_of_the_control(control: str, others: tuple[str, ...]) -> Iterator[Mistake]:
    """Refuse means over a cell."""
    if control in _OF_A_CELL:
        found = f"got {control!r}, {_OF_A_CELL[control]}"
        message = f"{found}, which an isolated contact does not have; must be depth or force"
        yield Mistake(("trajectory", "control"), message, others, because="physics")


def _problems_without_images(config: Any) -> Iterator[Mistake]:
    """Yield keys that need a periodic surface, and bodies and punches without an isolated contact."""
    yield from _problems_of_the_control(config.trajectory.control, _BOUNDARY)
    track = "not available with grid.boundary: isolated; must be a constant velocity"
    cell = "describes a cell, which an isolated contact does not have; remove it"
    flow, seals = cell, not all(config.grid.without_images.isolated)
    if seals:
        flow = "needs the gap out of the contact, where it is not known; must be periodic along both axes"
    unused: Sequence[tuple[Any, Location, Sequence[str], str, Reason]] = (
        (config.trajectory, ("trajectory",), ("velocity_file",), track, "open"),
        (config.output, ("output",), ("observables", "leakage"), flow, "open" if seals else "physics"),
        (config.output.histograms, ("output", "histograms"), ("pressure", "gap"), cell, "physics"),
    )
    for section, at, keys, message, because in unused:
        for key in keys:
            if getattr(section, key) is not None:
                yield Mistake((*at, key), message, _BOUNDARY, because=because)
    for side in ("body", "punch"):
        if getattr(getattr(config.output.conductance, side, None), "resistivity", 0.0) == math.inf:
            message = (
                "got .inf: without images the current has no way out of an insulated back; must be finite"
            )
            at = ("output", "conductance", side, "resistivity")
            yield Mistake(at, message, _BOUNDARY, because="physics")
    steps = config.time.step == "adaptive" and not config.time.at_once
    if config.trajectory.moves and config.grid.ends_along_x and steps:
        spacing = config.grid.period[0] / config.grid.points[0]
        message = f"got adaptive; {WHOLE_SPACINGS}, {spacing:.6g}: give time.step"
        yield Mistake(("time", "step"), message, ("trajectory.velocity", *_BOUNDARY))
    if config.solid.isolated:  # other bodies are asked for their stiffness before the run
        yield from (problem.within((), *_BOUNDARY) for problem in config.solid.problems_isolated())
        yield from _problems_of_the_datum(config)


def _problems_of_the_datum(config: Any) -> Iterator[Mistake]:
    """Require the distance from which the depth of a line on a halfspace is counted, and refuse others."""
    axes = config.grid.without_images.axes
    datum, period = config.grid.datum, config.grid.period[axes[0]]
    others = (*_BOUNDARY, "grid.points", "halfspace", "layers", "layer")
    if len(axes) == 2 or math.isfinite(config.solid.rigid_below):
        if datum is not None:
            message = (
                "only for one isolated axis on a halfspace; here the depth has an origin already; remove it"
            )
            yield Mistake(("grid", "datum"), message, others)
    elif datum is None:
        message = (
            "missing; the depth of a line on a halfspace has no natural origin: give the distance at which "
            f"the surface counts as at rest, at least the period, {period!r}"
        )
        yield Mistake(("grid", "datum"), message, others)
    elif datum < period:
        message = f"got {datum!r}; must be at least the period, {period!r}"
        yield Mistake(("grid", "datum"), message, ("grid.period",))


def _plainly_possible_in_a_cell(config: Any) -> bool:
    """Whether no file has to be read, and the depth is well below a mean height in closed form.

    A hardness and an attraction have to be compared.
    """
    if config.body is not None or config.grid.isolated:
        return False
    if config.hardness is not None and config.interfaces:
        return False
    trajectory, mean_height = config.trajectory, config.punch.mean_height(config.grid.cell)
    if files_named(config) or mean_height is None:
        return False
    depth = trajectory.depth
    return trajectory.control != "depth" or (depth is not None and depth < mean_height / 2)


def _problems_of_revolution(config: Any) -> Iterator[Mistake]:
    """Yield keys that need a periodic cell, and punches that are no convex body of revolution."""
    if len(config.grid.points) > 1:
        message = f"got {shown(config.grid.points)}; must be one number with geometry: axisymmetric"
        yield Mistake(("grid", "points"), message, _GEOMETRY, because="physics")
    for name, keys in _PERIODIC.items():  # values, other than the defaults, that describe something periodic
        section: Section = getattr(config, name)
        default = type(section)()
        for key in keys or type(section).model_fields:
            value = getattr(section, key, None)
            if value is not None and value != getattr(default, key):
                used = "available" if key in _NOT_YET else "used"
                value = value[0] if isinstance(value, tuple) and len(value) == 1 else value
                message = f"got {shown(plain(value))}, not {used} with {_REVOLUTION}; remove it"
                because: Reason = "open" if key in _NOT_YET else "physics"
                yield Mistake((name, key), message, _GEOMETRY, because=because)
    if (
        config.temperature is not None
        and config.temperature.file is not None
        and config.time.step != "adaptive"
    ):
        message = (
            f"got {config.time.step!r} while the temperature changes; must be adaptive with {_REVOLUTION}"
        )
        yield Mistake(("time", "step"), message, ("temperature", *_GEOMETRY))
    attracting = [(at, law) for at, law in config.interface_laws.items() if law.attracts]
    for i, (at, law) in enumerate(attracting):
        if i or not isinstance(law, ShortRange):
            message = f"got {law.law!r}; an attraction over a range is not available with {_REVOLUTION}"
            message = f"{message}: must be short_range" if not i else f"must be one law with {_REVOLUTION}"
            yield Mistake((*at, "law"), message, _GEOMETRY, chooses=True, because="open")
    if config.hardness is not None:
        allowed = "remove it, or take geometry: periodic, and boundary: isolated for one punch"
        message = f"its hardness is not available with {_REVOLUTION}; {allowed}"
        yield Mistake(("interface",), message, _GEOMETRY, because="open")
    yield from _problems_of_the_control(config.trajectory.control, _GEOMETRY)
    if config.time.tolerance is not None and config.time.tolerance < FINEST:
        message = f"got {config.time.tolerance!r}; must be >= {FINEST:g} with grid.geometry: axisymmetric"
        yield Mistake(("time", "tolerance"), message, _GEOMETRY)
    if config.output.snapshots == "every":
        message = "got 'every'; must be a list of times with grid.geometry: axisymmetric"
        yield Mistake(("output", "snapshots"), message, _GEOMETRY)
    yield from _of_the_punch(config.punch)
    yield from (problem.within((), *_GEOMETRY) for problem in config.solid.problems_isolated())
    depth, thickness = config.trajectory.depth, config.solid.rigid_below
    if depth is not None and depth >= thickness:
        message = f"got {depth!r}, beyond the rigid base; must be below the thickness above it, {thickness!r}"
        yield Mistake(("trajectory", "depth"), message, ("layer.thickness", "layers", "halfspace"))


def _of_the_punch(punch: Any) -> Iterator[Mistake]:
    if not hasattr(punch, "revolution"):
        allowed = ", ".join(word for word, shape in SHAPES.items() if hasattr(shape, "revolution"))
        message = f"got {punch.shape!r}, which is no convex body of revolution; must be one of {allowed}"
        yield Mistake(("punch", "shape"), message, _GEOMETRY, chooses=True, because="physics")
        return
    for key, value in vars(punch).items():
        if isinstance(value, tuple):
            message = f"got {shown(value)}; must be one number for a body of revolution"
            yield Mistake(("punch", key), message, _GEOMETRY)


GEOMETRIES: Mapping[str, Geometry] = {  # the first is the default
    "periodic": Geometry(
        "gfmdlayer.case.case:Case", 1024, True, _problems_in_a_cell, _plainly_possible_in_a_cell
    ),
    "axisymmetric": Geometry(
        "gfmdlayer.indentation.model:IsolatedContact",
        problems=_problems_of_revolution,
        plainly_possible=lambda config: config.trajectory.file is None and not hasattr(config.punch, "file"),
    ),
}
