"""Errors in a configuration: the key, the value found, and the values allowed."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from os import PathLike
from typing import Any, Literal

from gfmdlayer.errors import GfmdlayerError

Location = tuple[str | int, ...]
Reason = Literal["", "physics", "open"]


A_NUMBER = "numbers have a decimal point, no quotes and no unit"
_YOUNGS = {"E", "E0", "Einf", "youngs_modulus"}  # near to the names of shear moduli, and another value
_ALIKE = 0.75  # a key elsewhere in the configuration is suggested from this similarity on
_MOST_LISTED = 20  # keys in a message; only sweeps have more, since they take the keys of all sections


class ConfigError(GfmdlayerError, ValueError):
    """A configuration that cannot be used, with all of its errors.

    Parameters
    ----------
    problems : iterable of str
        One line each: place in a file, key, value found, values allowed.

    Examples
    --------
    >>> import gfmdlayer
    >>> try:
    ...     gfmdlayer.Config(name="a", layer={"thicknes": 1}, grid={"points": 7})
    ... except gfmdlayer.ConfigError as error:
    ...     print(error)
    grid.points: got 7; must be a whole number >= 8 and < 2^31, or two of them, [nx, ny]
    layer.thicknes: unknown key; allowed: thickness, poisson, material; did you mean 'thickness'?
    """

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = list(problems)
        super().__init__("\n".join(self.problems))

    def __reduce__(self) -> tuple[type[ConfigError], tuple[list[str]]]:
        """Keep the list of problems when the error travels between processes."""
        return ConfigError, (self.problems,)


@dataclass(frozen=True)
class Mistake:
    """One error in a configuration."""

    location: Location  # path of the key, such as ("layer", "thickness")
    message: str  # value found and values allowed
    others: tuple[str, ...] = ()  # further dotted keys on whose values the message depends
    at_key: bool = False  # whether the key is wrong instead of its value
    chooses: bool = False  # whether its section has no meaning without the key: it chooses it, or is required
    # Why two abilities do not go together: physics, or open where only the package lacks something.
    because: Reason = ""

    @property
    def key(self) -> str:
        """Dotted key, without a place in a list at its end: ``layers.1.thickness``."""
        return dotted_key(without_last_places(self.location))

    def within(self, location: Location, *others: str) -> Mistake:
        """Return the problem of a section as one of the configuration, which depends on `others` too."""
        prefix = "".join(f"{part}." for part in location)
        keys = (*(prefix + other for other in self.others), *others)
        return replace(self, location=(*location, *self.location), others=keys)

    def __str__(self) -> str:
        return f"{dotted(self.location)}: {self.message}"


Problem = Mistake  # the former name, which bodies of users import; until version 0.5


class InconsistentError(GfmdlayerError, ValueError):
    """Values that are each allowed but contradict one another."""

    def __init__(self, problems: Sequence[Mistake]) -> None:
        self.problems = tuple(problems)
        super().__init__("; ".join(map(str, problems)))


def dotted(location: Location) -> str:
    """Return a location as the user would write it: ``output.snapshots[2]``."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def dotted_key(location: Location) -> str:
    """Return a location as it is swept and set: ``layers.1.thickness``."""
    return ".".join(map(str, location))


def location_of_key(key: str) -> Location:
    """Return the location that a dotted key names; numbers are places in lists."""
    return tuple(int(part) if part.isascii() and part.isdigit() else part for part in key.split("."))


def without_last_places(location: Location) -> Location:
    """Return the location of the key that holds a value, which may be in a list."""
    while location and isinstance(location[-1], int):
        location = location[:-1]
    return location


def set_aside(data: Any, location: Location) -> str:
    """Remove the value at a location of plain data, or the section that should hold it; return its key."""
    path = without_last_places(location)
    holder = data
    for depth, part in enumerate(path):
        if isinstance(part, int) and isinstance(holder, list) and part < len(holder):
            holder = holder[part]
            continue
        if not isinstance(holder, dict) or part not in holder:
            return set_aside(data, path[:depth]) if depth else str(part)
        if depth == len(path) - 1 or not isinstance(holder[part], dict | list):
            del holder[part]
            return dotted_key(path[: depth + 1])
        holder = holder[part]
    return ""


def not_in_list(part: str | int, length: int, key: str) -> str:
    """Return a message if `part` is not the place of an entry in the list at `key`, else nothing."""
    if isinstance(part, int) and part < length:
        return ""
    places = [f"{key}.{i}" for i in range(length)]
    allowed = f"{places[0]} to {places[-1]}" if length > 2 else " or ".join(places)
    entries = "1 entry" if length == 1 else f"{length} entries"
    return f"{key} has {entries}, and {part} is not one of them; must be {allowed}"


def not_increasing(at: Location, values: Iterable[float], noun: str, *others: str) -> Iterator[Mistake]:
    """Yield the values of a list that are not above the one before."""
    for i, (before, value) in enumerate(pairwise(values), start=1):
        if value <= before:
            yield Mistake((*at, i), f"got {value!r} after {before!r}; {noun} must increase", others)


def shown(value: object) -> str:
    """Return a value as in YAML, shortened to fit a line of text."""
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
            text = getattr(value, "text", "")  # as written, with a unit
            return f"{value!r} ({text})" if text else repr(value)
        case Mapping():
            return "a mapping" if value else "an empty mapping"
        case list() | tuple():
            brief = len(value) <= 4 and not any(isinstance(item, (list, tuple, Mapping)) for item in value)
            return f"[{', '.join(map(shown, value))}]" if brief else f"a list of {len(value)}"
        case str() | PathLike():
            text = str(value)
            return f"the text {text if len(text) <= 60 else text[:57] + '...'!r}"
        case _:
            return f"an object of the type {type(value).__name__}"


def nearest(word: str, allowed: Iterable[str]) -> str:
    """Return "; did you mean ...?" for the nearest of the allowed words, or nothing."""
    # Regardless of letter case: ginf is a misspelt Ginf.
    spelt = {candidate.lower(): candidate for candidate in allowed}
    near = difflib.get_close_matches(word.lower(), spelt, n=1)
    return f"; did you mean '{spelt[near[0]]}'?" if near else ""


def colon_without_space(text: str) -> str:
    """Return "; did you mean ...?" for a key and its value that YAML reads as one word, or nothing."""
    slip = re.match(r"\s*(?:- )?([A-Za-z_][\w.]*):(?![\s/\\:])(.+)", text)
    return f"; did you mean '{slip[1]}: {slip[2].strip()}', with a space after the colon?" if slip else ""


def unknown_key(key: str, siblings: Iterable[str], everywhere: Iterable[str]) -> str:
    """Return the message for an unknown key beside `siblings`, with the nearest one known `everywhere`."""
    siblings, everywhere = list(siblings), list(everywhere)
    hint = colon_without_space(key) or nearest(key, siblings)
    if key in everywhere and key not in siblings and "." in key:
        hint = f"; did you mean {key.replace('.', ': {')}: ...{'}' * key.count('.')}?"
    elif key in _YOUNGS:
        hint = "; moduli are shear moduli, G = E/(2 (1 + nu))"
        hint += ", but Young's with moduli: young" if "moduli" in siblings else ""
    elif key.isdecimal():
        hint = f"; {A_NUMBER}"
    elif not hint:
        same_ending = {name.rpartition(".")[2]: name for name in everywhere}
        near = difflib.get_close_matches(key.rpartition(".")[2], same_ending, n=1, cutoff=_ALIKE)
        hint = f"; did you mean '{same_ending[near[0]]}'?" if near else ""
    allowed = ", ".join(siblings)
    if len(siblings) > _MOST_LISTED:
        near = difflib.get_close_matches(key, siblings, n=3, cutoff=0.0)
        allowed = f"{', '.join(near)} and {len(siblings) - len(near)} others (all: gfmdlayer schema)"
    return f"unknown key; allowed: {allowed}{hint}"
