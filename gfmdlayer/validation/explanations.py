"""The errors that pydantic finds in a section, as problems whose messages a user can act on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pydantic import ValidationError

from gfmdlayer.validation.fields import MustBe, Word
from gfmdlayer.validation.problems import Location, Problem, nearest, shown, unknown_key
from gfmdlayer.validation.sections import OneOf, Section, held_by

_SHAPES = {
    "model_type": "a mapping of keys to values",
    "dict_type": "a mapping of keys to values",
    "tuple_type": "a list",
    "list_type": "a list",
}


def explained(error: ValidationError, root: type[Section], everywhere: Iterable[str]) -> list[Problem]:
    """Return the errors that pydantic found, as problems.

    Parameters
    ----------
    error : pydantic.ValidationError
        Raised by the model `root`.
    root : type of Section
        The whole configuration.
    everywhere : iterable of str
        Its dotted keys, for suggestions.
    """
    found: list[Problem] = []
    for entry in error.errors(include_url=False):
        location, section, chosen_by = _resolved(entry["loc"], root)
        match entry["type"]:
            case "default_factory_not_called":
                pass  # the value that the default follows from is reported itself
            case "value_error" if hasattr(entry["ctx"]["error"], "problems"):
                found += [problem.within(location) for problem in entry["ctx"]["error"].problems]
            case "extra_forbidden":
                message = unknown_key(str(location[-1]), section.fields(), everywhere)
                found.append(Problem(location, message, at_key=True))
            case "missing":
                found.append(Problem(location, f"missing; must be {_allowed(section, str(location[-1]))}"))
            case "union_tag_invalid":
                words = Word(*entry["ctx"]["expected_tags"].replace("'", "").split(", "))
                word = entry["ctx"]["tag"]
                message = f"got {shown(word)}; must be {words.allowed}{nearest(word, words.words)}"
                found.append(Problem((*location, chosen_by), message))
            case "must_be" | "value_error":
                found.append(Problem(location, entry["msg"].removeprefix("Value error, ")))
            case kind:
                allowed = _SHAPES.get(kind, entry["msg"])
                found.append(Problem(location, f"got {shown(entry['input'])}; must be {allowed}"))
    return list(dict.fromkeys(found))


def _resolved(raw: Location, root: type[Section]) -> tuple[Location, type[Section], str]:
    """Return a location without pydantic's names for the members of unions.

    Also the section that has the last key, and the key that chooses the section there, if there are several.
    """
    location: list[str | int] = []
    holder: type[Section] = root
    held: OneOf[Any] | type[Section] | None = root
    for part in raw:
        if isinstance(part, int):
            location.append(part)
        elif isinstance(held, OneOf):
            held = held.members[part]
        elif held is not None:  # below a value there is the name of its form: number or list
            location.append(part)
            holder, field = held, held.fields().get(part)
            held = held.entries if field is None else held_by(field)
    return tuple(location), holder, held.key if isinstance(held, OneOf) else ""


def _allowed(section: type[Section], key: str) -> str:
    field = section.fields()[key]
    notes: Iterable[Any] = field.metadata
    return next((note.allowed for note in notes if isinstance(note, MustBe)), field.description or "given")
