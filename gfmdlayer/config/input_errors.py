"""What is wrong with a configuration, in words: which key, what was found there, what is allowed.

pydantic reports a location and a kind of error; here each becomes a `Problem` whose message a user can act
on. The place in a file (line and column) is known to the reader alone and is put in front there.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationError
from pydantic.fields import FieldInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

Location = tuple[str | int, ...]

# Products and quotients of a few numbers of this size do not leave the range of double precision.
_LEAST, _MOST = 1e-30, 1e30


class ConfigError(Exception):
    """A configuration that cannot be used, with everything that is wrong with it.

    Parameters
    ----------
    problems : list of str
        One line each: place, key, what was wrong, what is allowed.
    """

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = list(problems)
        super().__init__("\n".join(self.problems))

    def __reduce__(self) -> tuple[type[ConfigError], tuple[list[str]]]:
        """Keep the problems when the error travels between processes."""
        return ConfigError, (self.problems,)


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong.

    Attributes
    ----------
    location : tuple of str and int
        Path of the key, such as ``("layer", "thickness")``.
    message : str
        What was wrong and what is allowed.
    others : tuple of str
        Dotted keys whose values the message rests on besides the one at `location`.
    at_key : bool
        The fault lies with the key itself, not with its value.
    """

    location: Location
    message: str
    others: tuple[str, ...] = ()
    at_key: bool = False

    @property
    def key(self) -> str:
        """Dotted key without indices."""
        return ".".join(part for part in self.location if isinstance(part, str))

    def __str__(self) -> str:
        return f"{dotted(self.location)}: {self.message}"


class InconsistentError(ValueError):
    """Values that are each allowed but not together; raised inside a model, taken apart by `problems_of`."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("; ".join(map(str, problems)))


@dataclass(frozen=True)
class MustBe:
    """Annotation of a field: whatever its type finds wrong is reported in these words.

    A number with a fraction is refused, too, where it is too large or too small to be computed with.

    Attributes
    ----------
    what : str
        What is allowed, continuing "must be ...".
    words : tuple of str
        The allowed words, where the field takes words.
    """

    what: str
    words: tuple[str, ...] = ()

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Wrap the type's own validation."""
        return core_schema.no_info_wrap_validator_function(self._validate, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Leave the words for `gfmdlayer.config.json_schema`."""
        return handler(schema) | {"$comment": self.what}

    def _validate(self, value: Any, inner: core_schema.ValidatorFunctionWrapHandler) -> Any:
        try:
            taken = inner(value)
        except (ValidationError, OverflowError):
            hint = _hint(value, self)
            message = f"got {shown(value)}; must be {self.what}{hint}"
            raise PydanticCustomError("must_be", message) from None
        if isinstance(taken, float) and taken not in {0.0, math.inf} and not _LEAST <= abs(taken) <= _MOST:
            message = f"got {shown(value)}; must be from {_LEAST:g} to {_MOST:g} in size, in whatever units"
            raise PydanticCustomError("must_be", message)
        return taken


def one_of(*words: str) -> MustBe:
    """Return the annotation of a field that takes one of `words`."""
    return MustBe(" or ".join(words) if len(words) == 2 else "one of " + ", ".join(words), words)


def dotted(location: Location) -> str:
    """Return a location as the user would write it: ``output.snapshots[2]``."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def shown(value: object) -> str:
    """Return a value as it would stand in YAML, shortened to fit a line of text."""
    match value:
        case None:
            return "nothing (null)"
        case bool():
            return "true" if value else "false"
        case float() if math.isnan(value):
            return ".nan"
        case float() if math.isinf(value):
            return ".inf" if value > 0 else "-.inf"
        case int() if abs(value) > 10**18:
            return "a number of many digits"
        case int() | float():
            return repr(value)
        case Mapping():
            return "a mapping" if value else "an empty mapping"
        case list() | tuple():
            brief = len(value) <= 4 and not any(isinstance(item, (list, tuple, Mapping)) for item in value)
            return f"[{', '.join(map(shown, value))}]" if brief else f"a list of {len(value)}"
        case _:
            text = str(value)
            return f"the text {text if len(text) <= 60 else text[:57] + '...'!r}"


def nearest(word: str, allowed: Iterable[str]) -> str:
    """Return "; did you mean ...?" for the nearest of the allowed words, or nothing."""
    # Letter case is no part of a likeness: ginf is Ginf misspelt.
    spelt = {candidate.lower(): candidate for candidate in allowed}
    found = difflib.get_close_matches(word.lower(), spelt, n=1)
    return f"; did you mean '{spelt[found[0]]}'?" if found else ""


def unknown_key(key: str, siblings: Iterable[str], everywhere: Iterable[str]) -> str:
    """Return the message for a key that does not exist among its siblings.

    The nearest sibling is named or, where none is near, the nearest key `everywhere` in the configuration.
    """
    siblings = list(siblings)
    hint = nearest(key, siblings)
    if not hint:
        same_ending = {name.rpartition(".")[2]: name for name in everywhere}
        found = difflib.get_close_matches(key.rpartition(".")[2], same_ending, n=1)
        hint = f"; did you mean '{same_ending[found[0]]}'?" if found else ""
    return f"unknown key; allowed: {', '.join(siblings)}{hint}"


def problems_of(
    error: ValidationError,
    section_at: Callable[[Location], type[BaseModel] | None],
    tags: Mapping[Location, str],
    everywhere: Iterable[str],
) -> list[Problem]:
    """Return what pydantic found, as problems.

    Parameters
    ----------
    error : pydantic.ValidationError
        Raised by the configuration's model.
    section_at : callable
        From a location as pydantic spells it (with the tag of a union, without indices) to the model there.
    tags : mapping
        Location of a union -> the key that chooses its member; pydantic puts the member's name behind these.
    everywhere : iterable of str
        Dotted keys of the whole configuration, for suggestions.
    """
    found: list[Problem] = []
    for entry in error.errors(include_url=False):
        raw = entry["loc"]
        location = _untagged(raw, tags)
        section = section_at(tuple(part for part in raw[:-1] if isinstance(part, str)))
        cause = entry.get("ctx", {}).get("error")
        if entry["type"] == "default_factory_not_called":
            continue  # the value that it would follow from is reported itself
        if isinstance(cause, InconsistentError):
            found += [
                Problem((*location, *p.location), p.message, p.others, p.at_key) for p in cause.problems
            ]
        elif entry["type"] == "extra_forbidden" and section is not None:
            message = unknown_key(str(raw[-1]), _fields(section), everywhere)
            found.append(Problem(location, message, at_key=True))
        elif entry["type"] == "missing" and section is not None:
            found.append(Problem(location, f"missing; must be {_allowed(section, str(raw[-1]))}"))
        elif entry["type"] == "union_tag_invalid":
            words = one_of(*entry["ctx"]["expected_tags"].replace("'", "").split(", "))
            given = entry["ctx"]["tag"]
            message = f"got {shown(given)}; must be {words.what}{nearest(given, words.words)}"
            found.append(Problem((*location, tags[location]), message))
        elif entry["type"] in {"must_be", "value_error"}:
            found.append(Problem(location, entry["msg"].removeprefix("Value error, ")))
        else:
            what = _SHAPES.get(entry["type"], entry["msg"])
            found.append(Problem(location, f"got {shown(entry['input'])}; must be {what}"))
    return list(dict.fromkeys(found))


_SHAPES = {
    "model_type": "a mapping of keys to values",
    "dict_type": "a mapping of keys to values",
    "tuple_type": "a list",
    "list_type": "a list",
}


def _untagged(location: Location, tags: Iterable[Location]) -> Location:
    for prefix in tags:  # an inner union comes behind the outer
        n = len(prefix)
        if location[:n] == prefix and len(location) > n:
            location = location[:n] + location[n + 1 :]
    return location


def _fields(section: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a section by the names that users write."""
    return {field.alias or name: field for name, field in section.model_fields.items()}


def _allowed(section: type[BaseModel], key: str) -> str:
    field = _fields(section)[key]
    return next(
        (note.what for note in field.metadata if isinstance(note, MustBe)), field.description or "given"
    )


def _hint(value: object, field: MustBe) -> str:
    if not isinstance(value, str):
        return (
            " (true and false are no numbers)" if isinstance(value, bool) and "number" in field.what else ""
        )
    if field.words:
        return nearest(value, field.words)
    if "number" not in field.what:
        return ""
    if value.lower().lstrip("+").startswith("inf"):
        return "; infinity is written .inf" if ".inf" in field.what else ""
    try:
        float(value)
    except ValueError:
        return ""
    return f"; did you mean {value.strip()}, without quotes?"
