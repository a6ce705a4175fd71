"""The files that a configuration names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from gfmdlayer.validation.problems import dotted
from gfmdlayer.validation.sections import OneOf, Section, held_by, sections_in, types_in


def files_named(section: Section) -> dict[str, Path]:
    """Return the files that a configuration names, by dotted key."""
    return {
        dotted((*at, key)): value
        for at, part in sections_in(section)
        for key, value in vars(part).items()
        if isinstance(value, Path)
    }


def keys_of_files(section: type[Section], prefix: str = "") -> Iterator[str]:
    """Yield the dotted keys below a section that may name a file."""
    for key, field in section.fields().items():
        held = held_by(field)
        for member in held.members.values() if isinstance(held, OneOf) else filter(None, [held]):
            yield from keys_of_files(member, f"{prefix}{key}.")
        if Path in types_in(field.annotation):
            yield prefix + key
