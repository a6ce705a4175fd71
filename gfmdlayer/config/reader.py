"""From a file and the command line's overrides to a `Config`, or to a list of everything that is wrong.

A value that is refused is removed and the rest validated once more, so that errors hidden by the first are in
the same report; errors that depend on a removed value are left out.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gfmdlayer.config import text
from gfmdlayer.config.model import Config, explain, problems
from gfmdlayer.config.sweeps import LISTS, location_of, unswept
from gfmdlayer.config.text import Document, Place
from gfmdlayer.validation.problems import ConfigError, Location, Problem
from gfmdlayer.validation.sections import keys_of_files

_FILES = frozenset(keys_of_files(Config))
Inspection = Callable[[Config], Iterable[tuple[str, str]]]


def load(
    path: str | Path,
    overrides: Iterable[str] = (),
    inspect: Inspection | None = None,
    content: str | None = None,
) -> Config:
    """Read a configuration.

    Parameters
    ----------
    path : str or Path
        YAML file. File names in it are relative to its folder.
    overrides : iterable of str
        ``dotted.key=value`` with the value in YAML, each replacing the value in the file, in this order.
    inspect : callable, optional
        Checks the numbers and files of a sound configuration: yields dotted keys and why they are refused.
    content : str, optional
        The YAML, where the file holds it in another form.

    Returns
    -------
    Config
        Validated, as are all cases of its sweep.

    Raises
    ------
    ConfigError
        With every problem, each ``file:line:column: key: value found; values allowed``; those of overrides
        begin with ``--set`` instead.
    """
    document = _document(path) if content is None else text.read(content, str(path))
    if document.data is None or not isinstance(document.data, dict):
        raise _error(document.problems)
    for override in overrides:
        _override(document, override)
    if document.data.get("sweep") == {}:
        message = "sweep: got an empty mapping; must hold a dotted key with a list of values, or be left out"
        document.problems.append((document.values["sweep",], message))
    document.data = _with_absolute_paths(document.data, Path(path).absolute().parent)
    try:
        config = Config.model_validate(document.data)
    except ValidationError as error:
        # A value that could not be read has been reported as such; do not report it as missing, too.
        unreadable = {place for place, _ in document.problems if place.line}
        found = [(_place(document, p), str(p)) for p in _all_problems(document.data, error)]
        raise _error(document.problems + [each for each in found if each[0] not in unreadable]) from None
    if not document.problems and inspect is not None:
        for key, message in inspect(config):
            problem = Problem(location_of(config.sweep, key), message)
            document.problems.append((_place(document, problem), str(problem)))
    if document.problems:
        raise _error(document.problems)
    return config


def _error(problems: Iterable[tuple[Place, str]]) -> ConfigError:
    # Keys may hold line breaks, and so may messages of libraries.
    lines = (f"{place}: {message}" for place, message in sorted(problems))
    return ConfigError(dict.fromkeys(" ".join(map(str.strip, line.splitlines())) for line in lines))


def _document(path: str | Path) -> Document:
    start = Place(str(path), 1, 1)
    try:
        content = Path(path).read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        return Document(problems=[(start, f"cannot be read ({reason}); must be the name of a YAML file")])
    document = text.read(content, str(path))
    wanted = "must be a mapping of keys to values, with at least name: ..."
    if document.data is None and not document.problems:
        document.problems.append((start, f"is empty; {wanted}"))
    elif not isinstance(document.data, dict) and not document.problems:
        document.problems.append((document.values[()], f"holds no keys; {wanted}"))
        document.data = None
    return document


def _override(document: Document, override: str) -> None:
    """Put one ``dotted.key=value`` into the document."""
    option = Place("--set")
    key, equals, value = override.partition("=")
    location: tuple[str, ...] = tuple(key.strip().split("."))
    if location[0] == "sweep" and len(location) > 1:
        whole = 2 if location[1] in LISTS else 1  # the rest is one key with dots
        location = (*location[:whole], ".".join(location[whole:])) if location[whole:] else location
    if not equals or not all(location):
        document.problems.append((option, f"got {override!r}; must be dotted.key=value"))
        return
    new = text.read(value, "--set", location)
    if new.problems:
        document.problems += [(option, m if m.startswith(key) else f"{key}: {m}") for _, m in new.problems]
        return
    inner: Any = document.data
    for i, part in enumerate(location[:-1]):
        inner = inner.setdefault(part, {})
        if not isinstance(inner, dict):
            section = ".".join(location[: i + 1])
            document.problems.append(
                (option, f"{key}: {section} is not a mapping, so no key of it can be set")
            )
            return
        document.keys.setdefault(location[: i + 1], option)
    for places in (document.keys, document.values):
        for old in [place for place in places if place[: len(location)] == location]:
            del places[old]
    inner[location[-1]] = new.data
    document.keys.update(dict.fromkeys([*new.keys, location], option))
    document.values.update(dict.fromkeys([*new.values, location], option))


def _with_absolute_paths(data: Any, folder: Path, key: str = "") -> Any:
    """Return plain data with file names made absolute, in the sections and in the sweep."""
    if isinstance(data, dict):
        return {
            name: _with_absolute_paths(value, folder, f"{key}.{name}".lstrip("."))
            for name, value in data.items()
        }
    if isinstance(data, list):
        return [_with_absolute_paths(value, folder, key) for value in data]
    return str(folder / data) if isinstance(data, str) and data and unswept(key) in _FILES else data


def _all_problems(data: dict[str, Any], error: ValidationError) -> list[Problem]:
    """Return the problems that pydantic found first, and those hidden by them."""
    rest = copy.deepcopy(data)
    found = new = explain(error)
    aside: list[str] = []
    while new:
        removed = [_set_aside(rest, problem.location) for problem in new]
        aside += removed + [unswept(key) for key in removed]
        new = [p for p in problems({"name": "unnamed"} | rest) if not any(_rests_on(p, key) for key in aside)]
        found = found + new
    return [_as_written(data, problem) for problem in found]


def _set_aside(data: Any, location: Location) -> str:
    """Remove the value at a location, or the section that should hold it; return its dotted key."""
    keys = [part for part in location if isinstance(part, str)]
    holder = data
    for depth, key in enumerate(keys):
        if key not in holder:
            return _set_aside(data, location[:depth]) if depth else key
        if depth == len(keys) - 1 or not isinstance(holder[key], dict):
            del holder[key]
            return ".".join(keys[: depth + 1])
        holder = holder[key]
    return ""


def _rests_on(problem: Problem, key: str) -> bool:
    own = problem.key if problem.at_key else unswept(problem.key)
    names = (own, problem.key, *problem.others)
    return any(f"{name}.".startswith(f"{key}.") or f"{key}.".startswith(f"{name}.") for name in names)


def _as_written(data: Any, problem: Problem) -> Problem:
    """Return the problem without the index that pydantic counts where the user wrote a single value."""
    *path, last = problem.location
    if isinstance(last, int):
        for part in path:
            data = data.get(part) if isinstance(data, dict) else data
        if not isinstance(data, list):
            return replace(problem, location=tuple(path))
    return problem


def _place(document: Document, problem: Problem) -> Place:
    """Return the place of the value or key; where there is none, of the section that should hold it."""
    location = problem.location
    if problem.at_key and location in document.keys:
        return document.keys[location]
    while location and location not in document.values:
        location = location[:-1]
    exact = location == problem.location
    return document.values[location] if exact else document.keys.get(location, document.values[location])
