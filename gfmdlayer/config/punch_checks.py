"""Whether a punch fits into the cell and onto its grid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from gfmdlayer.config.input_errors import Problem, shown
from gfmdlayer.config.punches import EITHER_WAY, Array, Cylinder, Flat, SelfAffine, Sinusoid, Sphere

if TYPE_CHECKING:
    from gfmdlayer.config.model import Config

_GRID = ("grid.period", "punch.shape")


def punch_conflicts(config: Config) -> Iterator[Problem]:
    """Yield what is wrong between the keys of the punch, and between them and the grid."""
    punch, axes = config.punch, len(config.grid.points)
    if isinstance(punch, SelfAffine):
        yield from _self_affine(punch, config)
        return
    counts, element, section = (1,) * axes, punch, "punch"
    if isinstance(punch, Array):
        if len(punch.counts) not in {1, axes}:
            wanted = f"one number, or one for each of the {axes} directions" if axes > 1 else "one number"
            message = f"got {len(punch.counts)} numbers; must be {wanted}"
            yield Problem(("punch", "counts"), message, ("grid.points",))
            return
        counts = punch.counts * (axes // len(punch.counts))
        element, section = punch.element, "punch.element"
    found = _on_axes(element, axes)
    for axis, length, count in zip("xy", config.grid.period, counts, strict=False):
        whole = "the period" if count == 1 else f"the period over {count}"
        found = found or _in_cell(element, axis, f"{whole} in {axis}, {length / count!r}", length / count)
    if found is not None:
        key, message, *others = found
        location = (*section.split("."), key)
        yield Problem(location, message, (*(f"{section}.{other}" for other in others), *_GRID))


def _on_axes(punch: object, axes: int) -> tuple[str, ...] | None:
    """Whether the punch can be on that many axes: its key, what is wrong, and others that this rests on."""
    if axes == 1:
        if getattr(punch, "along", "y") == "x":
            return "along", "got 'x', the direction of the line itself; must be y, or grid.points two numbers"
        if hasattr(punch, "faces"):
            return "shape", "got the text 'pyramid'; must be another shape, or grid.points two numbers"
        for key in EITHER_WAY:
            if isinstance(value := getattr(punch, key, None), tuple):
                return key, f"got {shown(value)}; must be one number, or grid.points two numbers"
    for key in EITHER_WAY:
        value = getattr(punch, key, None)
        if isinstance(value, tuple) and all(each in {0, math.inf} for each in value):
            return (
                key,
                f"got {shown(value)}, which is flat all over; must not be, along one direction",
            )
    return None


def _in_cell(punch: object, axis: str, period: str, length: float) -> tuple[str, ...] | None:
    """Whether the punch fits into the cell along an axis; answers as `_on_axes`."""
    at = "xy".index(axis)
    match punch:
        case Sphere(radius=radius) | Cylinder(radius=radius) if radius < length / 2:
            if getattr(punch, "along", "") == axis:
                return None
            return (
                "radius",
                f"got {radius!r}: the circle ends inside the cell and has no height beyond; must be a "
                f"number >= half {period} (a parabola takes any radius)",
            )
        case Flat():
            width = _along(punch.width, at)
            if math.isfinite(width) and width + 2 * punch.edge_radius >= length:
                return (
                    "width",
                    f"got {width!r} with edge_radius {punch.edge_radius!r}; width + 2 edge_radius must be "
                    f"below {period}",
                    "edge_radius",
                )
        case Sinusoid():
            wavelength = _along(punch.wavelength, at)
            waves = length / wavelength
            fits = waves >= 1 - 1e-9 and abs(waves - round(waves)) <= 1e-9 * waves
            if _along(punch.amplitude, at) > 0 and math.isfinite(wavelength) and not fits:
                return (
                    "wavelength",
                    f"got {wavelength!r}, which does not divide {period}; must be the period divided "
                    "by a whole number",
                    "amplitude",
                )
    return None


def _along(values: float | tuple[float, ...], at: int) -> float:
    return values[at] if isinstance(values, tuple) else values


def _self_affine(punch: SelfAffine, config: Config) -> Iterator[Problem]:
    one_rms = "one of rms_slope and rms_height must be given"
    if punch.rms_slope is None and punch.rms_height is None:
        yield Problem(("punch", "rms_slope"), f"missing; {one_rms}", ("punch.shape",))
    if punch.rms_slope is not None and punch.rms_height is not None:
        yield Problem(("punch", "rms_height"), f"given beside rms_slope; {one_rms}", ("punch.rms_slope",))
    spacing = max(length / n for length, n in zip(config.grid.period, config.grid.points, strict=False))
    if punch.short_cutoff <= 2 * spacing:
        message = f"got {punch.short_cutoff!r}; must be > {2 * spacing!r}, two spacings of the grid"
        yield Problem(("punch", "short_cutoff"), message, ("grid.points", "grid.period"))
    waves = [(key, getattr(punch, key)) for key in ("short_cutoff", "roll_off", "long_cutoff")]
    given = [(key, value) for key, value in waves if value is not None]
    longest = max(config.grid.period)
    for (below, least), (key, value) in zip(given, [*given[1:], ("", longest)], strict=True):
        if value < least:
            message = f"got {value!r}, below {below} = {least!r}; must be a longer wave"
            if not key:
                message = f"got {least!r}; must be <= the period, {longest!r}"
            yield Problem(("punch", key or below), message, (f"punch.{below}", "grid.period"))
