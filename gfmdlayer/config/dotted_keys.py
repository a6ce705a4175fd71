"""The dotted keys of a configuration: layer.thickness, layers.1.material.G0; numbers are places in lists."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gfmdlayer.body.materials import Law
from gfmdlayer.config import sweeps
from gfmdlayer.punch.shape import Shape
from gfmdlayer.validation.problems import ConfigError, dotted_key, location_of_key, not_in_list
from gfmdlayer.validation.sections import Section, sections_in


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
    kinds = [at for at, section in sections_in(config) if isinstance(section, (Law, Shape))]
    swept = (key for key in leaves(config) if key.partition(".")[0] not in sweeps.UNSWEPT)
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
