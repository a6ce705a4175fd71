"""A sweep: its keys, and the cases that it stands for.

    layer.thickness: [0.1, 0.2]                          each value of a key with each of the other keys
    zip: {layer.thickness: [...], punch.radius: [...]}   first with first, second with second, ...
    latin_hypercube: {samples: 100, seed: 7, layer.thickness: {from: 0.01, to: 1, scale: log}, ...}
    sobol: {samples: 128, seed: 7, ...}                  likewise, by a scrambled Sobol sequence

At most one of the last three makes a list of combinations; each of these meets every product of the keys
beside it.  Samples are those of scipy.stats.qmc; scipy is imported only where there are any.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, product
from typing import Annotated, Any

from pydantic import ConfigDict, Field, GetCoreSchemaHandler, ValidationInfo, field_validator
from pydantic_core import CoreSchema, core_schema

from gfmdlayer.body.materials import Law
from gfmdlayer.interface.interface import Interface
from gfmdlayer.punch.shape import Shape
from gfmdlayer.validation.fields import Count, Finite, Seed, Word, given
from gfmdlayer.validation.problems import (
    ConfigError,
    Location,
    dotted_key,
    location_of_key,
    not_in_list,
    shown,
)
from gfmdlayer.validation.sections import Section, sections_in

SAMPLED = ("latin_hypercube", "sobol")
LISTS = ("zip", *SAMPLED)
UNSWEPT = frozenset({"name", "units", "sweep"})  # keys and sections that are the same in all cases

# Samples are rounded to so many digits: the last ones differ between the mathematical libraries of machines,
# and a sweep that is taken up elsewhere must find its own cases again.
_DIGITS = 12

Row = dict[str, object]


class Range(Section):
    """Where samples of a key lie: from one number to a larger one, spread evenly, or so in the logarithm."""

    from_: Finite = Field(alias="from")
    """beginning of the range"""
    to: Finite
    """end of the range"""
    scale: Annotated[str, Word("linear", "log")] = "linear"
    """spread evenly, or evenly in the logarithm"""

    @field_validator("to")
    @classmethod
    def _beyond(cls, to: float, info: ValidationInfo) -> float:
        if "from_" in info.data and to <= info.data["from_"]:
            raise ValueError(f"got {shown(to)}; must be a number > from = {shown(info.data['from_'])}")
        return to

    @field_validator("scale")
    @classmethod
    def _has_logarithm(cls, scale: str, info: ValidationInfo) -> str:
        if scale == "log" and info.data.get("from_", 1.0) <= 0:
            raise ValueError(
                f"got log from {shown(info.data['from_'])}; must be linear, or from a number > 0"
            )
        return scale

    def at(self, part: float) -> float:
        """Return the value at a part of the way, in [0, 1]."""
        if self.scale == "log":
            value = self.from_ * math.exp(part * math.log(self.to / self.from_))
        else:
            value = self.from_ + part * (self.to - self.from_)
        return min(max(float(f"{value:.{_DIGITS}g}"), self.from_), self.to)


class Samples(Section):
    """How many samples are drawn, by which seed, of which keys."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Range]
    entries = Range

    samples: Count
    """number of samples"""
    seed: Seed = 0
    """of the random numbers: the same samples every time"""


_Samples = Annotated[Samples | None, given]


class Sweep(Section):
    """The shape of a sweep; `gfmdlayer.config.sweep_checks` looks at its keys and values."""

    model_config = ConfigDict(extra="allow")

    zip: Annotated[dict[str, Any] | None, given] = None
    """dotted keys and values that belong together: first with first, second with second"""
    latin_hypercube: _Samples = None
    """number of samples, and dotted keys with their ranges"""
    sobol: _Samples = None
    """number of samples, a power of two, and dotted keys with their ranges"""


class PlainSweep:
    """Annotation of a mapping that has the shape of a `Sweep` and stays plain data."""

    section = Sweep

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate the shape, then write it back with its defaults."""
        as_it_is = core_schema.simple_ser_schema("any")
        shape = handler.generate_schema(Sweep)
        return core_schema.no_info_after_validator_function(_plain, shape, serialization=as_it_is)


def _plain(sweep: Sweep) -> dict[str, Any]:
    dumped = sweep.model_dump(by_alias=True)
    return {key: value for key, value in dumped.items() if value is not None or key not in LISTS}


@dataclass(frozen=True, eq=False)
class Axis:
    """One factor of the product: a swept key with its values, or a list of combinations.

    Attributes
    ----------
    rows : sequence of dict
        Dotted keys and their values, in each place of the axis.
    location : tuple of str
        Where the keys are in the configuration.
    sampled : bool
        Whether the values were drawn, and stand nowhere in the configuration.
    """

    rows: Sequence[Row]
    location: Location
    sampled: bool = False

    def place(self, key: str, index: int) -> Location:
        """Where the value of a key in a row was written."""
        return (*self.location, key) if self.sampled else (*self.location, key, index)


def axes(sweep: Mapping[str, Any]) -> list[Axis]:
    """Return the factors of a sweep, the list of combinations first."""
    found: list[Axis] = []
    for name, entry in sweep.items():
        if name == "zip":
            rows = [dict(zip(entry, values, strict=True)) for values in zip(*entry.values(), strict=True)]
            found.insert(0, Axis(rows, ("sweep", name)))
        elif name in SAMPLED:
            found.insert(0, Axis(_samples(name, entry), ("sweep", name), sampled=True))
        else:
            found.append(Axis([{name: value} for value in entry], ("sweep",)))
    return found


def combinations(sweep: Mapping[str, Any]) -> list[Row]:
    """Return the swept keys and their values in each case, the last key running fastest."""
    return [dict(chain(*(row.items() for row in rows))) for rows in product(*(a.rows for a in axes(sweep)))]


def swept_keys(sweep: Mapping[str, Any]) -> list[str]:
    """Return the swept keys in the order of the cases' values."""
    listed = [key for name in LISTS for key in keys_of(sweep.get(name, {}))]
    return listed + [key for key in sweep if key not in LISTS]


def is_listed(sweep: Mapping[str, Any]) -> bool:
    """Whether the cases are a list of combinations rather than a product of values."""
    return any(name in sweep for name in LISTS)


def sampling(sweep: Mapping[str, Any]) -> dict[str, str | int | float]:
    """Return how samples were drawn, if any were: method, samples and seed."""
    name = next((name for name in SAMPLED if name in sweep), "")
    return {"sampling": name} | {key: sweep[name][key] for key in Samples.model_fields} if name else {}


def count(sweep: Mapping[str, Any]) -> int:
    """Return the number of cases, without making any."""
    return math.prod(
        entry["samples"]
        if name in SAMPLED
        else len(next(iter(entry.values()), ()) if name == "zip" else entry)
        for name, entry in sweep.items()
    )


def location_of(sweep: Mapping[str, Any], key: str) -> Location:
    """Return where a key, swept by itself or with its section or not at all, is given."""
    swept = next((name for name in swept_keys(sweep) if f"{key}.".startswith(f"{name}.")), None)
    if swept is None:
        return location_of_key(key)
    return next((("sweep", name, swept) for name in LISTS if swept in sweep.get(name, ())), ("sweep", swept))


def unswept(key: str) -> str:
    """Return the key that is meant by one with the sweep's own names before it: sweep.zip.punch.radius."""
    for head in ("sweep", *LISTS):
        key = key.removeprefix(f"{head}.")
    return key


def as_label(key: str, value: object) -> str:
    """Write a value for people: fire, 64x128 for a grid, model=zener, G0=1.0 for a mapping."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name}={as_label('', entry)}" for name, entry in value.items())
    if isinstance(value, list | tuple):
        parts = [as_label("", entry) for entry in value]
        return "x".join(parts) if key.startswith("grid.") else f"[{', '.join(parts)}]"
    return str(value).lower() if isinstance(value, bool) else str(value)


def keys_of(listed: Iterable[str]) -> list[str]:
    """Return the swept keys of a list of combinations."""
    return [key for key in listed if key not in Samples.model_fields]


def _samples(method: str, design: Mapping[str, Any]) -> list[Row]:
    ranges = {key: Range.model_validate(design[key]) for key in keys_of(design)}
    points = _points(method, len(ranges), design["samples"], design["seed"])
    return [
        {key: r.at(part) for (key, r), part in zip(ranges.items(), point, strict=True)} for point in points
    ]


@lru_cache(maxsize=4)
def _points(method: str, dimensions: int, samples: int, seed: int) -> list[list[float]]:
    """Return points of the unit cube, one a sample: the same for the same seed."""
    import numpy as np
    from scipy.stats import qmc

    engine = {"latin_hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol}[method]
    points: list[list[float]] = engine(dimensions, seed=np.random.default_rng(seed)).random(samples).tolist()
    return points


def leaves(config: Section) -> list[str]:
    """Return the dotted keys of all sections that hold a value of their own, in the order of the model."""
    return [
        dotted_key((*at, key))
        for at, section in sections_in(config)
        if at
        for key, value in vars(section).items()
        if not isinstance(value, Section)
    ]


def sweepable(config: Section) -> list[str]:
    """Return the dotted keys that may be swept: the leaves, and sections of which there are several kinds."""
    kinds = [at for at, section in sections_in(config) if isinstance(section, (Law, Shape, Interface))]
    swept = (key for key in leaves(config) if key.partition(".")[0] not in UNSWEPT)
    return [*swept, *(dotted_key(at) for at in kinds)]


def assigned(data: Mapping[str, Any], values: Mapping[str, object]) -> dict[str, Any]:
    """Return nested `data` with values at dotted keys; `data` itself is left as it is."""
    result = dict(data)
    for key, value in values.items():
        head, _, tail = key.partition(".")
        inner = result.get(head)
        if not tail:
            result[head] = value
        elif isinstance(inner, list | tuple):
            if wrong := not_in_list(location_of_key(tail)[0], len(inner), head):
                raise ConfigError([f"{key}: {wrong}"])
            entries = {str(i): entry for i, entry in enumerate(inner)}
            result[head] = [*assigned(entries, {tail: value}).values()]
        else:
            result[head] = assigned(inner if isinstance(inner, Mapping) else {}, {tail: value})
    return result
