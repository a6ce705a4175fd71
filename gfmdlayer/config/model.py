"""The whole configuration: its sections, the cases made from it, and what it is written back as.

A `Config` that exists is sound: every value allowed, no two in contradiction, every case of its sweep as good
as itself. See `gfmdlayer.config.sections` for the keys.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from textwrap import indent
from typing import Annotated, Any, Self

from pydantic import Field, ValidationError, model_validator

from gfmdlayer.config import checks, punches, sections, sweep_checks, sweeps, text
from gfmdlayer.config import output as outputs
from gfmdlayer.config.input_errors import ConfigError, InconsistentError, Location, Problem, problems_of
from gfmdlayer.config.sections import Section


class Config(Section):
    """A whole configuration; every key but `name` has a default, the paper's own value.

    Attributes
    ----------
    name : str
        Names the folder of the results.
    grid, layer, halfspace, punch, trajectory, time, solver, output : Section
        See their classes.
    sweep : dict
        Dotted key -> its values, and lists of combinations; see `gfmdlayer.config.sweeps`. A configuration
        with a sweep is sound when its cases are: its own value of a swept key is not run.
    """

    name: sections.Name
    """names the folder of the results"""
    grid: sections.Grid = Field(default_factory=sections.Grid)
    """the periodic cell and its points"""
    layer: sections.Layer = Field(default_factory=sections.Layer)
    """the viscoelastic layer"""
    halfspace: sections.Halfspace = Field(default_factory=sections.Halfspace)
    """the elastic base under the layer"""
    punch: punches.Punch = Field(default_factory=punches.Parabola)
    """the rigid punch; its shape"""
    trajectory: sections.Trajectory = Field(default_factory=sections.Trajectory)
    """what is prescribed over time"""
    time: sections.Time = Field(default_factory=sections.Time)
    """time axis and steps"""
    solver: sections.Solver = Field(default_factory=sections.Solver)
    """the contact problem of each step"""
    output: outputs.Output = Field(default_factory=outputs.Output)
    """what is kept besides the curves"""
    sweep: Annotated[dict[str, Any], sweeps.PlainSweep()] = Field(default_factory=dict)
    """dotted keys and their values; the cases are their product"""

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if self.sweep:
            given = self._given()
            found = sweep_checks.conflicts(
                self, sweepable(self), lambda values: problems(assigned(given, values))
            )
        else:
            found = checks.conflicts(self)
        if listed := list(found):
            raise InconsistentError(listed)
        return self

    def with_values(self, values: Mapping[str, object]) -> Config:
        """Return the case in which the dotted keys have these values; it has no sweep.

        Parameters
        ----------
        values : mapping
            Dotted key -> value, such as ``{"layer.thickness": 0.1}``.

        Raises
        ------
        ConfigError
            A key does not exist, or a value is not possible.
        """
        try:
            return Config.model_validate(assigned(self._given(), values))
        except ValidationError as error:
            raise ConfigError(map(str, explained(error))) from None

    def dump(self) -> str:
        """Return the configuration as YAML with every default written out, which `load` reads back.

        A default that follows from a swept key of its section differs between the cases and is left out.
        """
        if not self.sweep:
            return _yaml(self)
        data = self.model_dump(exclude_none=True)
        for head in {key.partition(".")[0] for key in sweeps.swept_keys(self.sweep)}:
            section = getattr(self, head)
            for key, field in type(section).model_fields.items():
                if field.default_factory_takes_validated_data and key not in section.model_fields_set:
                    data[head].pop(key, None)
        return text.written(data)

    def _given(self) -> dict[str, Any]:
        """Return what was given, without defaults: these follow from the other values."""
        return self.model_dump(exclude_unset=True, exclude={"sweep"})


def _yaml(section: Section) -> str:
    """Return a section's keys as YAML; what was written last is kept, as the cases of a sweep share most."""
    parts = []
    for key, plain in section.model_dump(exclude_none=True, exclude={"sweep"}).items():
        value = getattr(section, key)
        if isinstance(value, Section) and plain:
            parts.append(f"{key}:\n" + indent(_kept_yaml(value), "  "))
        else:
            parts.append(_entry(key, plain) if isinstance(plain, str | float) else text.written({key: plain}))
    return "".join(parts)


@lru_cache(maxsize=256, typed=True)
def _entry(key: str, value: str | float) -> str:
    return text.written({key: value})


_kept_yaml = lru_cache(maxsize=256)(_yaml)


def digest(config: Config) -> str:
    """Return a hash of everything that determines a case's results, and of nothing else.

    The name and the sweep do not enter; files enter by what they hold, not by where they are.

    Raises
    ------
    OSError
        A file named by the configuration cannot be read any more.
    """
    data = config.model_dump(exclude={"name", "sweep"}, exclude_none=True)

    def contents(value: object) -> str:
        if isinstance(value, Path):
            return hashlib.sha256(value.read_bytes()).hexdigest()
        raise TypeError(f"{type(value).__name__} does not belong in a configuration")

    canonical = json.dumps(data, sort_keys=True, separators=(",", ":"), default=contents)
    return hashlib.sha256(canonical.encode()).hexdigest()


def leaves(section: Section, prefix: str = "") -> list[str]:
    """Return the dotted keys below a section that hold a value of their own, in the order of the model."""
    found = []
    for key in type(section).model_fields:
        value = getattr(section, key)
        if isinstance(value, Section):
            found += leaves(value, f"{prefix}{key}.")
        elif prefix:
            found.append(prefix + key)
    return found


def sweepable(config: Config) -> list[str]:
    """Return the dotted keys that may be swept: the leaves, and sections of which there are several kinds."""
    kinds = [".".join(map(str, at)) for at, tag in _TAGS.items() if tag]
    keys = leaves(config)
    return keys + [kind for kind in kinds if any(key.startswith(f"{kind}.") for key in keys)]


def assigned(data: Mapping[str, Any], values: Mapping[str, object]) -> dict[str, Any]:
    """Return nested `data` with values at dotted keys; `data` itself is left as it is."""
    result = dict(data)
    for key, value in values.items():
        head, _, tail = key.partition(".")
        inner = result.get(head)
        result[head] = assigned(inner if isinstance(inner, Mapping) else {}, {tail: value}) if tail else value
    return result


def problems(data: Mapping[str, Any]) -> list[Problem]:
    """Return what is wrong with plain nested data as a configuration."""
    try:
        Config.model_validate(data)
    except ValidationError as error:
        return explained(error)
    return []


def explained(error: ValidationError) -> list[Problem]:
    """Return what pydantic found wrong with a configuration, as problems."""
    known = ["name", *leaves(Config(name="defaults"))]
    return problems_of(error, _section, _TAGS, known)


def _section(location: Location) -> type[Section] | None:
    if location[0:1] == ("sweep",):
        return (sweeps.Sweep, sweeps.Samples, sweeps.Range)[len(location) - 1]
    return _SECTIONS.get(location)


def _by_shape(members: Iterable[type[Section]]) -> dict[str, type[Section]]:
    return {str(member.model_fields["shape"].default): member for member in members}


_TAGS: dict[Location, str] = {
    ("layer", "material"): "model",
    ("punch",): "shape",
    ("punch", "element"): "shape",
    **{("punch", key): "" for key in punches.EITHER_WAY},
    **{("punch", "element", key): "" for key in punches.EITHER_WAY},
    ("output", "times"): "",
}
_SECTIONS: dict[Location, type[Section]] = {
    (): Config,
    ("grid",): sections.Grid,
    ("layer",): sections.Layer,
    ("layer", "material", "zener"): sections.Zener,
    ("layer", "material", "prony"): sections.Prony,
    ("layer", "material", "prony", "branches"): sections.Branch,
    ("halfspace",): sections.Halfspace,
    **{("punch", shape): each for shape, each in _by_shape(punches.PUNCHES).items()},
    **{("punch", "array", "element", shape): each for shape, each in _by_shape(punches.ELEMENTS).items()},
    ("trajectory",): sections.Trajectory,
    ("time",): sections.Time,
    ("solver",): sections.Solver,
    ("output",): outputs.Output,
    ("output", "histograms"): outputs.Histograms,
    ("output", "histograms", "pressure"): outputs.Histogram,
    ("output", "histograms", "gap"): outputs.Histogram,
}
