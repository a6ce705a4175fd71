"""The free parameters of a fit: keys of the model and values of a curve, their bounds and scales.

A modulus, a time or a length is fitted by its logarithm; Poisson's ratios, exponents and the values of a
curve as they are. An instantaneous modulus Ginf is fitted by the logarithm of Ginf - G0 of the same material:
no step of the fit makes a material that stiffens.

Values of a curve are taken from its columns: depth = measured depth - contact_point - drift (t - t_first),
force = measured force - force_offset.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from pydantic import ValidationError

from gfmdlayer.config import Config, ConfigError
from gfmdlayer.config.model import explain
from gfmdlayer.validation.problems import shown, unknown_key

OF_A_CURVE = ("contact_point", "drift", "force_offset")
SECTIONS = ("name", "units", "grid", "layer", "layers", "halfspace", "punch", "temperature", "shift")
LINEAR: Mapping[str, tuple[float, float]] = {
    "poisson": (-0.99, 0.5),
    "exponent": (0.01, 1.0),
    "alpha": (0.01, 1.0),
}
WIDE = 1e4  # default bounds of other parameters, as a factor from where they start
_PART = re.compile(r"([^.\[\]]+)|\[(\d+)\]")

Bounds = tuple[float, float]
Free = Sequence[str] | Mapping[str, Sequence[float] | None]


class Model:
    """The body and the indenter: a configuration whose numbers may be set by dotted keys."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        if foreign := [key for key in data if key not in SECTIONS]:
            raise ConfigError([f"{key}: {unknown_key(key, SECTIONS, ())}" for key in foreign])
        grid = {"geometry": "axisymmetric"} | dict(data.get("grid") or {})
        # The curves say what is prescribed; the default depth need not fit this body.
        given = {"name": "indentation"} | dict(data) | {"grid": grid, "trajectory": {"depth": 0.0}}
        try:
            self.config = Config.model_validate(given)
        except ValidationError as error:
            raise ConfigError(map(str, explain(error))) from None
        self._data = self.config.model_dump(exclude_none=True)
        self.keys = dict(_numbers(self._data))

    def with_values(self, values: Mapping[str, float]) -> Config:
        """Return the configuration in which the dotted keys have these values."""
        data = self._data
        elastic = {
            f"{key[:-2]}Ginf": value for key, value in values.items() if f"{key[:-2]}Ginf" in self._elastic
        }
        for key, value in {**elastic, **values}.items():
            data = _assigned(data, path_of(key), value)
        return Config.model_validate(data)

    @cached_property
    def _elastic(self) -> set[str]:
        """Instantaneous moduli that equal G0: their materials stay elastic where G0 alone is free."""
        ends = {key: f"{key[:-4]}G0" for key in self.keys if key.endswith(".Ginf")}
        return {key for key, other in ends.items() if self.keys[key] == self.keys[other]}


@dataclass(frozen=True)
class Parameter:
    """A free parameter."""

    key: str  # dotted key of the model, or one of `OF_A_CURVE`
    start: float  # where the fit starts
    bounds: Bounds  # smallest and largest value
    curve: str = ""  # the curve to which it belongs; empty for a parameter that all curves share
    above: str = ""  # key of the modulus above which its logarithm counts, for Ginf

    @property
    def name(self) -> str:
        """Key, with the curve to which it belongs."""
        return f"{self.key}[{self.curve}]" if self.curve else self.key

    @property
    def scale(self) -> Literal["logarithmic", "linear"]:
        """Whether its logarithm is fitted."""
        own = self.key in OF_A_CURVE or self.key.rpartition(".")[2] in LINEAR
        return "linear" if own else "logarithmic"


def path_of(key: str) -> tuple[str | int, ...]:
    """Split a dotted key with indices: ``layers[0].material.G0``."""
    return tuple(int(index) if index else word for word, index in _PART.findall(key))


def free_parameters(
    model: Model, free: Free, curves: Sequence[str], spans: Mapping[str, Bounds]
) -> list[Parameter]:
    """Return the free parameters of a fit."""
    asked = dict(free) if isinstance(free, Mapping) else dict.fromkeys(free)
    wrong, found = [], []
    if not asked:
        raise ConfigError(["free: names no parameter; must be at least one key, such as layer.material.G0"])
    for key, bounds in asked.items():
        if key in OF_A_CURVE:
            owners = list(curves) if len(curves) > 1 else [""]
            found += [Parameter(key, 0.0, _bounds(bounds, spans[key]), owner) for owner in owners]
        elif key not in model.keys:
            wrong.append(f"free: {key}: {unknown_key(key, [*model.keys, *OF_A_CURVE], model.keys)}")
        else:
            start, last = model.keys[key], key.rpartition(".")[2]
            default = LINEAR.get(last, (start / WIDE, start * WIDE))
            glassy = f"{key[:-2]}Ginf"
            if last == "G0" and glassy in model.keys and glassy not in asked and start < model.keys[glassy]:
                default = (default[0], model.keys[glassy])
            if last not in LINEAR and not 0 < start < math.inf:
                wrong.append(f"free: {key}: starts at {shown(start)}; must start at a number > 0 and finite")
                continue
            above = f"{key[:-4]}G0" if last == "Ginf" else ""
            found.append(Parameter(key, start, _bounds(bounds, default), "", above))
    for each in found:
        low, high = each.bounds
        if not low < high or (each.scale == "logarithmic" and low <= 0):
            wrong.append(f"free: {each.key}: bounds {low:g} and {high:g}; must grow, and be > 0")
        elif each.key not in OF_A_CURVE and not low <= each.start <= high:
            wrong.append(
                f"free: {each.key}: starts at {each.start:g}; must start between {low:g} and {high:g}"
            )
    if wrong:
        raise ConfigError(wrong)
    return found


def _bounds(given: Sequence[float] | None, default: Bounds) -> Bounds:
    return default if given is None else (float(given[0]), float(given[1]))


def _numbers(data: Any, at: str = "") -> Iterator[tuple[str, float]]:
    """Yield the dotted keys of all numbers of the layers, the halfspace and the punch."""
    items: Any = enumerate(data) if isinstance(data, (list, tuple)) else data.items()
    for key, value in items:
        place = f"{at}[{key}]" if isinstance(key, int) else f"{at}.{key}".lstrip(".")
        if isinstance(value, (Mapping, list, tuple)):
            if at or key in {"layer", "layers", "halfspace", "punch"}:
                yield from _numbers(value, place)
        elif at and isinstance(value, (int, float)) and not isinstance(value, bool):
            yield place, float(value)


def _assigned(data: Any, path: tuple[str | int, ...], value: float) -> Any:
    """Return nested data with a value at a path; `data` itself is left as it is."""
    if not path:
        return value
    head, *tail = path
    if isinstance(head, int):
        return [_assigned(part, tuple(tail), value) if i == head else part for i, part in enumerate(data)]
    return {**data, head: _assigned(data.get(head, {}), tuple(tail), value)}
