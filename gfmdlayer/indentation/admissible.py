"""What a configuration may ask of an isolated, axisymmetric contact; imports no numerics."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from gfmdlayer.punch.shapes import SHAPES
from gfmdlayer.validation.problems import Problem, shown

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
    """Yield why the contact of a configuration cannot be an isolated, axisymmetric one.

    Parameters
    ----------
    config : Config
        A configuration with grid.geometry: axisymmetric.
    """
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
        message = "got 'every' with grid.geometry: axisymmetric; must be a list of times"
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
        yield Problem(("punch", "shape"), message, _GEOMETRY)
        return
    for key, value in vars(punch).items():
        if isinstance(value, tuple):
            message = f"got {shown(value)}; must be one number for a body of revolution"
            yield Problem(("punch", key), message, _GEOMETRY)


def _of_the_base(config: Any) -> Iterator[Problem]:
    thickness, modulus = sum(layer.thickness for layer in config.stacked), config.halfspace.shear_modulus
    if modulus == 0 and math.isfinite(thickness):
        message = "got 0: a layer without a base does not support an isolated load; must be > 0"
        yield Problem(("halfspace", "shear_modulus"), message, ("layer.thickness", *_GEOMETRY))
    depth = config.trajectory.depth
    if depth is not None and modulus == math.inf and depth >= thickness:
        message = f"got {depth!r}, beyond the rigid base; must be below layer.thickness = {thickness!r}"
        yield Problem(("trajectory", "depth"), message, ("layer.thickness", "halfspace.shear_modulus"))
