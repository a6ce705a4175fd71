"""Reference pages that follow from the code: configuration keys, columns, command line, public names, pairs.

They are written into reference/ when a build begins, and are never edited or committed.
"""

from __future__ import annotations

import argparse
import inspect
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import abilities
from key_examples import EXAMPLES

import gfmdlayer
from gfmdlayer import figures
from gfmdlayer.cli import VERBS, command_line
from gfmdlayer.config import Config
from gfmdlayer.config.json_schema import json_schema
from gfmdlayer.observables import INDENTATION, OBSERVABLES, TOTALS
from gfmdlayer.observables.observable import Column
from gfmdlayer.results.names import VARIABLES
from gfmdlayer.validation import text
from gfmdlayer.validation.fields import dimension

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.config import Config as Settings

_KINDS = "oneOf", "anyOf"
_KEYS = """\
# Configuration keys

Every key except `name` has a default. Outside its section a key has a dotted name, such as
`layer.thickness` in `--set`, in a sweep and in messages. Entries of a list are numbered from 0:
`layers.0.thickness`. You can sweep most keys. Each section begins with an example; a configuration also
needs a `name`.

Use any units, but the same everywhere; see [units](../guides/si-units.md). The column "unit" has the
dimension: 1 for a pure number, – for a word, a file or a section. "drive" is the dimension of
`trajectory.control`: a length, a pressure or a force. The default "none" means that the key is absent. If
a default depends on other keys, the meaning explains it.
"""
_WORD = "–"  # in place of a unit
_COLUMNS = """\
# Output columns

A case file has a row for each accepted step; row 0 is at t = 0. Snapshots are fields at the times of
`output.snapshots`. This page has dimensions; the files have the `units` of the configuration, if it has them.
1 is a pure number.
"""
_HISTOGRAMS = {"pressure": {"max": 1.0}, "gap": {"max": 1.0}}


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before the sources are read."""
    app.connect("config-inited", _write_pages)  # before Sphinx looks for sources
    app.connect("autodoc-process-docstring", _with_inherited_table, priority=100)  # before numpydoc reads it
    app.connect("autodoc-process-docstring", _keep_bars)
    return {"parallel_read_safe": True}


def _write_pages(app: Sphinx, _settings: Settings) -> None:
    folder = Path(app.srcdir) / "reference"
    pages = {
        "configuration.md": configuration(),
        "columns.md": columns(),
        "command-line.md": command_line_page(),
        "python.rst": python(),
        "together.md": abilities.page(),
    }
    for name, lines in pages.items():
        text, path = "\n".join(lines) + "\n", folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:  # an equal page is not read again
            path.write_text(text, encoding="utf-8")


def _with_inherited_table(_app: Sphinx, what: str, name: str, *documented: Any) -> None:
    """Give a method without a table of its arguments the one of the method that it overrides."""
    lines: list[str] = documented[-1]
    if what != "method" or "Parameters" in lines:
        return
    owner, _, method = name.rpartition(".")
    found = getattr(gfmdlayer, owner.removeprefix("gfmdlayer."), None)
    for base in found.__mro__[1:] if inspect.isclass(found) else ():
        words = inspect.cleandoc(getattr(vars(base).get(method), "__doc__", None) or "")
        if (begin := words.find("Parameters\n---")) >= 0:
            lines += ["", *words[begin:].splitlines(), ""]
            return


def _keep_bars(_app: Sphinx, *documented: Any) -> None:
    """Mark magnitudes such as |x| as code, which reStructuredText would take for substitutions."""
    lines: list[str] = documented[-1]
    lines[:] = [re.sub(r"(?<!`)\|([^|`]+)\|", r"``|\1|``", line) for line in lines]


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    names = list(head)
    yield f"| {' | '.join(names)} |"
    yield f"|{'---|' * len(names)}"
    for row in rows:
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"
    yield ""


def configuration() -> Iterator[str]:
    """Yield the page of all keys, section by section, as the schema for editors has them."""
    schema = json_schema()
    sections = schema["$defs"]
    yield _KEYS
    named = set()
    for key, section in schema["properties"].items():
        yield f"## {key}\n"
        yield f"{_sentence(section['description'])}\n"
        pending = [(key, name) for name in _sections(section)]
        alone = len(pending) == 1
        while pending:
            path, name = pending.pop(0)
            if name in named:
                continue
            named.add(name)
            yield from _section(path, name, sections[name], headed=not (alone and path == key))
            for each, inner in sections[name].get("properties", {}).items():
                pending += [(each, found) for found in _sections(inner)]


def _section(key: str, name: str, section: Mapping[str, Any], *, headed: bool) -> Iterator[str]:
    keys = section.get("properties", {})
    if headed:
        words = [v["const"] for v in keys.values() if "const" in v]
        yield f"### {': '.join([name.lower() if '.' in key else key, *words])}\n"
    if summary := section.get("description"):
        yield f"{_sentence(summary)}\n"
    for example in EXAMPLES[name].split("\n---\n") if name in EXAMPLES else ():
        yield f"```yaml\n{example}\n```\n"
    if key in {"sweep", "zip"}:  # the keys are those of the other sections
        return
    defaults = _defaults(key, keys)
    required = section.get("required", ())
    rows = (
        (
            f"`{each}`",
            *_meaning(value),
            "required" if each in required and "const" not in value else _default(value, defaults.get(each)),
        )
        for each, value in keys.items()
        if "." not in each  # samples have all keys that may be swept
    )
    yield from _table(("key", "meaning", "unit", "allowed", "default"), rows)


def _defaults(key: str, keys: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the values that a section with these keys has in a configuration without it."""
    found = Config(name="defaults").model_dump().get("layer" if key == "layers" else key)
    return found if isinstance(found, dict) and found.keys() <= keys.keys() else {}


def _meaning(value: Mapping[str, Any]) -> tuple[str, str, str]:
    """Split the words of a key into its meaning, its unit and the values allowed."""
    meaning, _, allowed = value.get("description", "").partition("must be ")
    meaning, unit = dimension(meaning.rstrip("; "))
    unit = unit or ("1" if _takes_numbers(value) else _WORD)
    return _sentence(meaning), _sentence(unit), _sentence(allowed or _allowed(value))


def _allowed(value: Mapping[str, Any]) -> str:
    """Say what a key takes whose own declaration has no words for it."""
    if "const" in value:
        return "this word"
    found = [each.get("description", "").partition("must be ")[2] for each in _members(value)]
    found += ["any word"] * (value.get("type") == "string" and not any(found))
    found += ["keys of their own"] * bool(_sections(value))
    return "; or ".join(dict.fromkeys(filter(None, found)))


def _takes_numbers(value: Mapping[str, Any]) -> bool:
    return value.get("type") in {"number", "integer"} or any(map(_takes_numbers, _members(value)))


def _members(value: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the schemas of the kinds of value that a key takes, and of the entries of a list."""
    inner = [*(each for kind in _KINDS for each in value.get(kind, ())), *filter(None, [value.get("items")])]
    return [each for each in inner if isinstance(each, dict)]


def _sections(node: Mapping[str, Any]) -> list[str]:
    """Return the names of the sections that a value may be, or hold."""
    if "$ref" in node:
        return [node["$ref"].rpartition("/")[2]]
    return [name for each in _members(node) for name in _sections(each)]


def _default(value: Mapping[str, Any], found: object = None) -> str:
    """Write the default as YAML has it."""
    match value.get("const", value.get("default", found)):
        case None if "by default" in value.get("description", ""):
            return "rests on others"
        case None:
            return "none"
        case dict(section):
            return f"`{next(iter(section.values()))}`" if section else "none"
        case [single] | single:
            found = single
    return f"`{text.written({'_': found}).partition(': ')[2].strip()}`"


# Symbols in words, as HTML; minus signs first, as powers have them too.
_SYMBOLS = {
    r"(?<=[( ^])(?<!or )-(?=[\w( ])": "−",
    r"\b([GzhR])0\b": r"<i>\1</i><sub>0</sub>",
    r"\bGinf\b": "<i>G</i><sub>∞</sub>",
    r"\bC([12])\b": r"<i>C</i><sub>\1</sub>",
    r"\beps0\b": "<i>ε</i><sub>0</sub>",
    r"\baT\b": "<i>a</i><sub>T</sub>",
    r"\b([RLn])([xy])\b": r"<i>\1</i><sub>\2</sub>",
    r"\blog10\b": "log<sub>10</sub>",
    r"\btau\b": "<i>τ</i>",
    r"\bomega\b": "<i>ω</i>",
    r"\bpi\b": "π",
    r"\b([ap])tilde\b": "<i>\\1\u0303</i>",
    r"\bpbar\b": "<i>p\u0304</i>",
    r"\^\(([^()]*\([^()]*\))\)": r"<sup>\1</sup>",
    r"\^(−?\w+)": r"<sup>\1</sup>",
}


def _sentence(words: str) -> str:
    """Return words as Markdown: braces and brackets are code, and symbols elsewhere are typeset."""
    parts = re.sub(r"(?<!`)(\{[^{}`]*\}|\[[^][`]*\])", r"`\1`", words).split("`")
    for i in range(0, len(parts), 2):
        parts[i] = re.sub(r"([*_<>])", r"\\\1", parts[i])
        for written, typeset in _SYMBOLS.items():
            parts[i] = re.sub(written, typeset, parts[i])
    return "`".join(parts)


def columns() -> Iterator[str]:
    """Yield the page of the columns, from the declarations that the files are written by."""
    yield _COLUMNS
    output = {"patches": True, "histograms": _HISTOGRAMS, "stiffness": {"frequencies": [1.0]}}
    everything = Config(name="all", grid={"points": [8, 8]}, output=output)
    for observable in OBSERVABLES.values():
        declared = (*(observable.columns(everything) or observable.COLUMNS), *observable.FURTHER)
        if not declared:
            continue
        title = re.sub("(?<=[a-z])([A-Z])", " \\1", observable.__name__).capitalize()
        yield f"## {title}\n"
        yield f"{_sentence(inspect.getdoc(observable) or '')}\n"
        yield from _columns(declared)
        if observable.NUMBERS:
            yield "Numbers of a whole case, in the attributes of its file and columns of the sweep file:\n"
            yield from _columns(observable.NUMBERS)
    yield "## Snapshots\n"
    yield "Coordinates, and fields of the surface at the times of `output.snapshots`.\n"
    yield from _columns(VARIABLES.values())
    yield "## Isolated contact\n"
    yield "With an isolated `grid.boundary` these columns replace means over the cell.\n"
    replaced = {name: each for name, each in TOTALS.items() if each is not None}
    yield from _table(
        ("in place of", "column", "unit", "meaning", "measured"),
        (
            (f"`{name}`", f"`{each.name}`", each.units, _sentence(each.long_name), _sentence(each.origin))
            for name, each in replaced.items()
        ),
    )
    absent = ", ".join(f"`{name}`" for name, each in TOTALS.items() if each is None)
    yield f"Not there: {absent}. On a line areas are widths, and energies are per length of the line.\n"
    yield "## Isolated indentation\n"
    yield "With `grid.geometry: axisymmetric` a case has these columns in place of the above.\n"
    yield from _columns(INDENTATION)


def _columns(declared: Iterable[Column]) -> Iterator[str]:
    rows = (
        (f"`{each.name}`", each.units, _sentence(each.long_name), _sentence(each.origin)) for each in declared
    )
    yield from _table(("column", "unit", "meaning", "measured"), rows)


def command_line_page() -> Iterator[str]:
    """Yield the page of the verbs, as their help has them."""
    parser = command_line()
    (verbs,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    yield "# Command line\n"
    yield f"```text\n{parser.format_help().rstrip()}\n```\n"
    for name, verb in zip(verbs.choices, VERBS, strict=True):
        yield f"## gfmdlayer {name}\n"
        yield f"{_sentence(verb.meaning)}\n"
        yield f"```text\n{verbs.choices[name].format_help().rstrip()}\n```\n"


def python() -> Iterator[str]:
    """Yield the page of the public names; autosummary makes a page of each."""
    title = "Python interface"
    yield f"{title}\n{'=' * len(title)}\n"
    yield ".. currentmodule:: gfmdlayer\n"
    yield ".. autosummary::\n   :toctree: names\n"
    yield from (f"   {name}" for name in sorted(gfmdlayer.__all__, key=str.lower))
    yield "\nPictures\n--------\n"
    yield ".. currentmodule:: gfmdlayer.figures\n"
    yield ".. autosummary::\n   :toctree: names\n"
    yield from (f"   {name}" for name in figures.__all__)
