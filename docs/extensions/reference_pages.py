"""Reference pages that follow from the code: configuration keys, output columns, command line, public names.

They are written into reference/ when a build begins, and are never edited or committed.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.config import Config as Settings

import gfmdlayer
from gfmdlayer.cli import VERBS, command_line
from gfmdlayer.config import Config
from gfmdlayer.config.json_schema import json_schema
from gfmdlayer.observables import INDENTATION, OBSERVABLES
from gfmdlayer.observables.observable import Column

_KINDS = "oneOf", "anyOf"
_KEYS = """\
# Configuration keys

Every key but `name` has a default. Keys are written dotted where they are named outside their section, as
`layer.thickness` in `--set`, in a sweep and in messages; an entry of a list has its place, from 0:
`layers.0.thickness`. Most keys can be swept. Meanings give the physical dimension; numbers are in any units
that are used throughout, see [units](../guides/si-units.md).
"""
_COLUMNS = """\
# Output columns

A case file has a row for each accepted step; row 0 is at t = 0. Snapshots are fields at the times of
`output.snapshots`. Dimensions are those of the configuration's `units` where it has them.
"""


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before the sources are read."""
    app.connect("config-inited", _write_pages)  # before Sphinx looks for sources
    app.connect("autodoc-process-docstring", _keep_bars)
    return {"parallel_read_safe": True}


def _write_pages(app: Sphinx, _settings: Settings) -> None:
    folder = Path(app.srcdir) / "reference"
    pages = {
        "configuration.md": configuration(),
        "columns.md": columns(),
        "command-line.md": command_line_page(),
        "python.rst": python(),
    }
    for name, lines in pages.items():
        text, path = "\n".join(lines) + "\n", folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:  # an equal page is not read again
            path.write_text(text, encoding="utf-8")


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
        pending = [name for name in _sections(section) if name not in named]
        choice = len(pending) > 1
        while pending:
            name = pending.pop(0)
            if name in named:
                continue
            named.add(name)
            yield from _section(key, name, sections[name], choice=choice or name not in _sections(section))
            for inner in sections[name].get("properties", {}).values():
                pending += [each for each in _sections(inner) if each not in named]


def _section(key: str, name: str, section: Mapping[str, Any], *, choice: bool) -> Iterator[str]:
    if choice:
        word = next((v["const"] for v in section.get("properties", {}).values() if "const" in v), None)
        yield f"### {key}: {word or name.lower()}\n"
    if summary := section.get("description"):
        yield f"{_sentence(summary)}\n"
    if key == "sweep":  # its keys are those of the other sections
        return
    defaults = Config(name="defaults").model_dump().get(key)
    defaults = defaults if isinstance(defaults, dict) else {}
    rows = (
        (f"`{each}`", *_meaning(value.get("description", "")), _default(value, defaults.get(each)))
        for each, value in section.get("properties", {}).items()
    )
    yield from _table(("key", "meaning", "allowed", "default"), rows)


def _meaning(words: str) -> tuple[str, str]:
    """Split the words of a key into its meaning and what is allowed."""
    meaning, _, allowed = words.partition("must be ")
    return _sentence(meaning.rstrip("; ")), _sentence(allowed)


def _sections(node: Mapping[str, Any]) -> list[str]:
    """Return the names of the sections that a value may be, or hold."""
    if "$ref" in node:
        return [node["$ref"].rpartition("/")[2]]
    inner = [*(each for kind in _KINDS for each in node.get(kind, ())), *filter(None, [node.get("items")])]
    return [name for each in inner if isinstance(each, dict) for name in _sections(each)]


def _default(value: Mapping[str, Any], found: object = None) -> str:
    found = value.get("const", value.get("default", found))
    match found:
        case None | {}:
            return ""
        case [single]:
            found = single
    return f"`{found}`"


def _sentence(words: str) -> str:
    """Return words as Markdown that keeps brackets and angles as they are."""
    for sign in "*_<>[]":
        words = words.replace(sign, f"\\{sign}")
    return words


def columns() -> Iterator[str]:
    """Yield the page of the columns, from the declarations that the files are written by."""
    yield _COLUMNS
    for observable in OBSERVABLES.values():
        declared = observable.COLUMNS
        if not declared:
            continue
        yield f"## {observable.__name__}\n"
        yield f"{_sentence((observable.__doc__ or '').strip())}\n"
        yield from _columns(declared)
        if observable.NUMBERS:
            yield "Numbers of a whole case, in the attributes of its file and columns of the sweep file:\n"
            yield from _columns(observable.NUMBERS)
    yield "## Isolated indentation\n"
    yield "With `grid.geometry: axisymmetric` a case has these columns in place of the above.\n"
    yield from _columns(INDENTATION)


def _columns(declared: Iterable[Column]) -> Iterator[str]:
    rows = ((f"`{each.name}`", each.units, _sentence(each.long_name)) for each in declared)
    yield from _table(("column", "dimension", "meaning"), rows)


def command_line_page() -> Iterator[str]:
    """Yield the page of the verbs, as their help has them."""
    parser = command_line()
    (verbs,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    yield "# Command line\n"
    yield f"```text\n{parser.format_help().rstrip()}\n```\n"
    for name, verb in zip(verbs.choices, VERBS, strict=True):
        yield f"## gfmdlayer {name}\n"
        yield f"{_sentence((verb.__doc__ or '').partition(': ')[2].strip().capitalize())}\n"
        yield f"```text\n{verbs.choices[name].format_help().rstrip()}\n```\n"


def python() -> Iterator[str]:
    """Yield the page of the public names; autosummary makes a page of each."""
    title = "Python interface"
    yield f"{title}\n{'=' * len(title)}\n"
    yield ".. currentmodule:: gfmdlayer\n"
    yield ".. autosummary::\n   :toctree: names\n"
    yield from (f"   {name}" for name in sorted(gfmdlayer.__all__, key=str.lower))
