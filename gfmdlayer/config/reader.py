"""From a file and the command line's overrides to a `Config`, or to a list of all errors.

Python passes the same data as a mapping; its errors have the same words, without a place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gfmdlayer.body.body import Body, check_body
from gfmdlayer.config.bodies import in_keys
from gfmdlayer.config.model import Config
from gfmdlayer.config.sweeps import LISTS, location_of, unswept
from gfmdlayer.validation import text
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import (
    ConfigError,
    Location,
    Mistake,
    colon_without_space,
    dotted_key,
    location_of_key,
    not_in_list,
    shown,
    unknown_key,
)
from gfmdlayer.validation.quantities import is_quantity
from gfmdlayer.validation.sections import keys_of_files, plain
from gfmdlayer.validation.text import Document, Place

_FILES = frozenset(keys_of_files(Config))
_PYTHON = Place("")  # objects of Python have no place but their key
Inspection = Callable[[Config], Iterable[tuple[str, str]]]


@entry()
def load(
    path: str | Path,
    overrides: Iterable[str] | Mapping[str, object] = (),
    inspect: Inspection | None = None,
    content: str | None = None,
) -> Config:
    r"""Read a configuration from a file.

    Parameters
    ----------
    path : str or Path
        YAML file. File names in it are relative to its folder.
    overrides : iterable of str, or mapping
        ``dotted.key=value`` with the value in YAML, or dotted keys and their values in Python, each replacing
        the value in the file, in this order.
    inspect : callable, optional
        Checks the numbers and files of a valid configuration: yields dotted keys with messages.
    content : str, optional
        The YAML, if the file stores it in another form.

    Returns
    -------
    Config
        Validated, as are all cases of its sweep.

    Raises
    ------
    ConfigError
        With every problem, each ``file:line:column: key: value found; values allowed``; those of overrides
        begin with ``--set`` instead, or with the key.

    Examples
    --------
    >>> from pathlib import Path
    >>> _ = Path("case.yaml").write_text("name: case\nlayer: {thickness: 0.1}\n")
    >>> gfmdlayer.load("case.yaml", ["time.end=2"]).time.end
    2.0
    """
    if not isinstance(path, str | PathLike):
        raise ConfigError([f"path: got {shown(path)}; must be the name of a YAML file"])
    document = _document(path) if content is None else text.read(content, str(path))
    if document.data is None or not isinstance(document.data, dict):
        raise _error(document.problems)
    config = _validated(document, overrides, Path(path).absolute().parent)
    return _inspected(config, document, inspect)


def from_python(
    given: Mapping[str, Any] | Config,
    values: Mapping[str, object] | None = None,
    inspect: Inspection | None = None,
) -> Config:
    """Return the configuration from Python data; dotted `values` replace keys, None removes one."""
    if isinstance(given, Mapping):
        given = in_keys(given)
    if values is not None and values.get("body") is not None:
        values = dict.fromkeys(("layer", "layers")) | in_keys({"counterbody": None, **values})
    document = Document(data=plain(given), values={(): _PYTHON})
    if isinstance(given, Config) and not values:
        return _inspected(given, document, inspect)
    config = _validated(document, values or {}, Path.cwd())  # where file names begin
    return _inspected(config, document, inspect)


_OF_A_BODY = ("units", "body", "layer", "layers", "halfspace", "counterbody")


def body_of(given: Body | Mapping[str, Any], *needed: str) -> Body:
    """Return a body, or the one of its keys in a configuration; ConfigError for what is none.

    The keys are those beside `body`, such as layer and halfspace, or those below it, with a kind or a file.
    `needed` are members of a `Body`.
    """
    if isinstance(given, Mapping):
        keys = {"body": given} if {"kind", "file"} & given.keys() else given
        if unknown := [key for key in keys if key not in _OF_A_BODY]:
            raise ConfigError(f"body: {key}: {unknown_key(key, _OF_A_BODY, ())}" for key in unknown)
        return from_python({"name": "body", **keys}).solid
    check_body(given, *needed)
    return given


def gives(config: str | Path | Mapping[str, Any] | Config, key: str) -> bool:
    """Whether a configuration itself, a file's, a mapping's or a checked one, has a dotted key."""
    data = _document(config).data if isinstance(config, str | Path) else plain(config)
    for part in location_of_key(key):
        if not isinstance(data, dict) or part not in data:
            return False
        data = data[part]
    return True


def _validated(document: Document, overrides: Iterable[str] | Mapping[str, object], folder: Path) -> Config:
    """Return the configuration in a document, which is a mapping, or raise all of its problems."""
    if isinstance(overrides, Mapping):
        for key, value in overrides.items():
            _assign(document, key, Document(data=plain(value)), _PYTHON)
    else:
        for override in overrides:
            _override(document, override)
    if document.data.get("sweep") == {}:
        message = "sweep: got an empty mapping; give dotted keys with lists of values, or remove it"
        document.problems.append((document.values.get(("sweep",), _PYTHON), message))
    document.data = _with_absolute_paths(document.data, folder)
    try:
        config = Config.model_validate(document.data)
    except ValidationError as error:
        # A value that could not be read is reported already; do not report it as missing too.
        unreadable = {place for place, _ in document.problems if place.line}
        mistakes = ((_place(document, p), str(p)) for p in Config.all_problems(document.data, error))
        further = [(place, message) for place, message in mistakes if place not in unreadable]
        raise _error(document.problems + further) from None
    if document.problems:
        raise _error(document.problems)
    return config


def _inspected(config: Config, document: Document, inspect: Inspection | None) -> Config:
    """Return a configuration whose numbers and files are checked, or raise all problems at their places."""
    keys = () if inspect is None else inspect(config)
    mistakes = [Mistake(location_of(config.sweep, key), message) for key, message in keys]
    if mistakes:
        raise _error((_place(document, mistake), str(mistake)) for mistake in mistakes)
    return config


def _error(problems: Iterable[tuple[Place, str]]) -> ConfigError:
    # Keys may hold line breaks, and so may messages of libraries.
    lines = (f"{place}: {message}" if str(place) else message for place, message in sorted(problems))
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
        hint = colon_without_space(document.data) if isinstance(document.data, str) else ""
        document.problems.append((document.values[()], f"has no keys; {wanted}{hint}"))
        document.data = None
    return document


def _override(document: Document, override: str) -> None:
    """Put one ``dotted.key=value`` of the command line into the document."""
    option = Place("--set")
    key, equals, value = override.partition("=")
    if not equals or "" in _location(key):
        document.problems.append((option, f"got {override!r}; must be dotted.key=value"))
        return
    new = text.read(value, "--set", _location(key))
    if new.problems:
        document.problems += [(option, m if m.startswith(key) else f"{key}: {m}") for _, m in new.problems]
    else:
        _assign(document, key, new, option)


def _location(key: str) -> Location:
    """Return the location that a dotted key names."""
    location = location_of_key(key.strip())
    if location[0] == "sweep" and len(location) > 1:
        whole = 2 if location[1] in LISTS else 1  # the rest is one key with dots
        location = (*location[:whole], dotted_key(location[whole:])) if location[whole:] else location
    return location


def _assign(document: Document, key: str, new: Document, option: Place) -> None:
    """Put a value at a dotted key; its place is the option's."""
    location = _location(key)
    inner: Any = document.data
    for i, part in enumerate(location):
        section, wrong = dotted_key(location[:i]), ""
        if isinstance(inner, list):
            wrong = not_in_list(part, len(inner), section)
        elif not isinstance(inner, dict):
            wrong = f"{section} is not a mapping and has no keys to set"
        elif isinstance(part, int):
            wrong = f"{section} is not a list"
        if wrong:
            document.problems.append((option, f"{key}: {wrong}"))
            return
        if i < len(location) - 1:
            inner = inner.setdefault(part, {}) if isinstance(inner, dict) else inner[part]
            document.keys.setdefault(location[: i + 1], option)
    places: dict[Location, Any]
    for places in (document.keys, document.values, document.lists):
        for old in [place for place in places if place[: len(location)] == location]:
            del places[old]
    if new.data is None and option == _PYTHON:
        inner.pop(location[-1], None)
        return
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
    if not isinstance(data, str) or not data or is_quantity(data):
        return data
    meant = ".".join(part for part in unswept(key).split(".") if not part.isdigit())  # in any place of a list
    return str(folder / data) if meant in _FILES else data


def _place(document: Document, problem: Mistake) -> Place:
    """Return the place of the value or key, or of the section where it is missing."""
    if problem.at_key and problem.location in document.keys:
        return document.keys[problem.location]
    return document.place(problem.location)
