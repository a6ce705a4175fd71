"""YAML text to plain data that knows its places, and back.

YAML 1.2: ``1e-3`` is a number and ``no`` is a word. Duplicate keys, anchors, aliases and tags are refused,
and dates are words. Nothing here knows which keys a configuration has.
"""

from __future__ import annotations

import json
import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLWarning
from ruamel.yaml.nodes import Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError

from gfmdlayer.validation.problems import Location, colon_without_space, dotted
from gfmdlayer.validation.quantities import Written

_TOO_DEEP = "nested too deeply for a configuration"
_MOST_OPEN = 1000  # brackets: the parser takes a time that grows with the square of their number
_NO_LISTS: Mapping[str, NumberList] = {}
_TAG = "the tag {} is not allowed; remove it"
_COLLECTIONS = {"tag:yaml.org,2002:map", "tag:yaml.org,2002:seq"}
_NUMBERS = {"tag:yaml.org,2002:int", "tag:yaml.org,2002:float"}
_PLAIN = re.compile(r"[A-Za-z/][A-Za-z0-9_./-]*")  # words that need no quotes
_RESERVED = {"true", "false", "null", "yes", "no", "on", "off"}
_WORDS = {f"tag:yaml.org,2002:{kind}" for kind in ("str", "timestamp", "merge", "value")}


@dataclass(frozen=True, order=True)
class Place:
    """Where something was written: line and column of a file, counted from 1, or an option (line 0)."""

    source: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f"{self.source}:{self.line}:{self.column}" if self.line else self.source


@dataclass
class Document:
    """Plain data with the places of its keys and values, and the errors in the text.

    The places of the numbers in `lists` are found when they are asked for.
    """

    data: Any = None
    keys: dict[Location, Place] = field(default_factory=dict)
    values: dict[Location, Place] = field(default_factory=dict)
    problems: list[tuple[Place, str]] = field(default_factory=list)
    lists: dict[Location, Callable[[int], Place]] = field(default_factory=dict)

    def place(self, location: Location) -> Place:
        """Return the place of a value; where there is none, of the section or key that should hold it."""
        while location not in self.values:
            *above, last = location
            if (find := self.lists.get(tuple(above))) is not None and isinstance(last, int):
                return find(last)
            location = tuple(above)
            if location in self.values:
                return self.keys.get(location, self.values[location])
        return self.values[location]


def read(content: str | bytes, source: str, at: Location = ()) -> Document:
    """Return the data in a text; errors in the text are collected, never raised."""
    if isinstance(content, bytes):
        try:
            content = content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            place = _place(source, error.object[: error.start].decode("utf-8", errors="replace"))
            message = f"the byte 0x{error.object[error.start]:02x} is not UTF-8; must be a text file in UTF-8"
            return Document(problems=[(place, message)])
    short, lists = shortened(content)
    if lists:
        document = _parsed(short, source, at, lists)
        if not document.problems and len(document.lists) == len(lists):
            return document
    return _parsed(content, source, at)


def _parsed(content: str, source: str, at: Location, lists: Mapping[str, NumberList] = _NO_LISTS) -> Document:
    """Return the data in a text, in which words may stand for lists of numbers."""
    document = Document()
    start = Place(source, 1, 1)
    opened = 0
    for bracket in re.finditer(r"[\[{\]}]", content):
        opened += 1 if bracket[0] in "[{" else -1
        if opened > _MOST_OPEN:
            document.problems.append((_place(source, content[: bracket.start()]), _TOO_DEEP))
            return document
    yaml = YAML(typ="safe", pure=True)
    try:
        with warnings.catch_warnings():  # anchors are refused, however often they are given
            warnings.simplefilter("ignore", YAMLWarning)
            node = yaml.compose(content)
        if node is not None:
            document.data = _Builder(document, source, yaml, lists).build(node, at)
    except MarkedYAMLError as error:
        document.problems.append(_refusal(error, content, source))
    except ReaderError as error:
        place = _place(source, content[: error.position])
        document.problems.append((place, f"not YAML: the character {error.character!r} is not allowed"))
    except RecursionError:
        document.problems.append((start, _TOO_DEEP))
    except Exception as error:  # the parser lets errors of many kinds through on odd escapes and directives
        document.problems.append((start, f"not YAML: {error or type(error).__name__}"))
    return document


def _refusal(error: MarkedYAMLError, content: str, source: str) -> tuple[Place, str]:
    """Return where a text is not YAML, and why: also for two slips that YAML explains badly."""
    mark = error.problem_mark or error.context_mark
    if mark is None:
        return Place(source, 1, 1), f"not YAML: {error.problem}"
    lines = content.splitlines()
    for number in range(mark.line, max(mark.line - 3, -1), -1):  # a value may seem to go on over some lines
        line = lines[number] if number < len(lines) else ""
        if number == mark.line and line[mark.column : mark.column + 1] == "\t":
            return Place(source, number + 1, mark.column + 1), "not YAML: a tab; use spaces"
        if hint := colon_without_space(line):
            column = len(line) - len(line.lstrip()) + 1
            return Place(source, number + 1, column), f"not YAML: no value{hint}"
    wrong = " ".join(filter(None, (error.context, error.problem)))
    return Place(source, mark.line + 1, mark.column + 1), f"not YAML: {wrong}"


def _place(source: str, before: str) -> Place:
    """Return the place after a text."""
    return Place(source, before.count("\n") + 1, len(before) - (before.rfind("\n") + 1) + 1)


@dataclass
class _Builder:
    """Turns the parser's nodes into data, noting the places."""

    document: Document
    source: str
    yaml: YAML
    lists: Mapping[str, NumberList]
    seen: set[int] = field(default_factory=set)

    def build(self, node: Node, at: Location) -> Any:
        self.document.values[at] = self.place(node)
        if id(node) in self.seen or node.anchor:
            return self.complain(node, at, "anchors and aliases are not allowed; write the value out")
        self.seen.add(id(node))
        if isinstance(node, ScalarNode):
            return self.scalar(node, at)
        if str(node.tag) not in _COLLECTIONS:
            return self.complain(node, at, _TAG.format(node.tag))
        if isinstance(node, SequenceNode):
            if (numbers := self.numbers(node, at)) is not None:
                return numbers
            return [self.build(item, (*at, i)) for i, item in enumerate(node.value)]
        return self.mapping(node, at)

    def numbers(self, node: SequenceNode, at: Location) -> list[int | float] | None:
        """Return the list of numbers whose word is the only entry of a list."""
        entry = node.value[0] if len(node.value) == 1 else None
        plain = isinstance(entry, ScalarNode) and entry.style is None and not entry.anchor
        known = self.lists.get(entry.value) if plain and entry is not None else None
        if known is None:
            return None
        self.document.lists[at] = lambda i: Place(self.source, *known.places[i])
        return known.numbers

    def mapping(self, node: Node, at: Location) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key, value in node.value:
            if not isinstance(key, ScalarNode):
                self.complain(key, at, "the key is a list or a mapping; it must be a word")
            elif key.value in result:
                first = self.document.keys[*at, key.value]
                message = f"duplicate key, first given at line {first.line}; give it once"
                self.complain(key, (*at, key.value), message)
            else:
                self.document.keys[*at, key.value] = self.place(key)
                result[key.value] = self.build(value, (*at, key.value))
        return result

    def scalar(self, node: Node, at: Location) -> Any:
        tag = str(node.tag)
        if tag in _WORDS:
            return node.value
        if tag == "tag:yaml.org,2002:null":
            return None
        if tag == "tag:yaml.org,2002:bool":
            return node.value.lower() in {"true", "yes", "on"}
        if tag not in _NUMBERS:
            return self.complain(node, at, _TAG.format(tag))
        try:
            value = self.yaml.constructor.construct_object(node)
        except (ValueError, OverflowError):
            return self.complain(node, at, f"{node.value[:40]!r} cannot be read as a number")
        if isinstance(value, float) and math.isinf(value) and "inf" not in node.value.lower():
            return self.complain(node, at, f"{node.value[:40]} is too large; infinity is written .inf")
        return value

    def place(self, node: Node) -> Place:
        return Place(self.source, node.start_mark.line + 1, node.start_mark.column + 1)

    def complain(self, node: Node, at: Location, message: str) -> None:
        self.document.problems.append((self.place(node), f"{dotted(at)}: {message}" if at else message))


# The text of a configuration is part of each result. For a case, YAML's general writer would take a
# millisecond and a half.

_UNPRINTABLE = re.compile(r"[\x7f-\x9f\u2028\u2029\ufeff\ufffe\uffff\ud800-\udfff]")


def written(data: Mapping[str, Any]) -> str:
    """Return nested mappings as YAML: a line for each key, and for each mapping in a list."""
    return "".join(_lines(data, "")) or "{}\n"


def _lines(data: Mapping[str, Any], indent: str) -> Iterator[str]:
    for key, value in data.items():
        head = f"{indent}{_word(key)}:"
        if isinstance(value, Mapping) and value:
            yield f"{head}\n"
            yield from _lines(value, f"{indent}  ")
        elif isinstance(value, list | tuple) and any(isinstance(item, Mapping) for item in value):
            yield f"{head}\n"
            yield from (f"{indent}  - {_in_line(item)}\n" for item in value)
        else:
            yield f"{head} {_in_line(value)}\n"


def _in_line(value: object) -> str:
    """Return a value in one line."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, Written):
        return _word(value.text)
    if isinstance(value, float):
        return repr(float(value)).replace("inf", ".inf").replace("nan", ".nan")
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_word(key)}: {_in_line(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_in_line, value))}]"
    return _word(value)


def _word(value: object) -> str:
    """Return a word, in double quotes where it is no plain name."""
    text = str(value)
    if _PLAIN.fullmatch(text) and text.lower() not in _RESERVED:
        return text
    return _UNPRINTABLE.sub(lambda found: f"\\u{ord(found[0]):04x}", json.dumps(text, ensure_ascii=False))


# Long lists of plain numbers in YAML, which are read a hundred times faster than by a parser of YAML.
#
# One word replaces each of these lists before the text is parsed. It is the list again where it is the
# only entry of a list. Lines and columns stay those of the file. A list that a parser of YAML would not
# take for just these numbers, as inside of a quoted text, is left to that parser with all the others.

_FEWEST = 500  # characters of a list in brackets, and half the lines of one with a line for each entry
_FLOW = re.compile(rf"(?<=\[)[-+0-9.eE, \n]{{{_FEWEST},}}(?=\])")
_BLOCK = re.compile(rf"^ *- [-+0-9.eE]+ *\n(?: *- [-+0-9.eE]+ *\n){{{_FEWEST // 2},}}", re.MULTILINE)
_NUMBER = re.compile(r"[-+]?(?:0|[1-9][0-9]{0,99})(\.[0-9]*)?([eE][-+]?[0-9]+)?")
_LAST = re.compile(r" *(?:\n|$)")  # after the bracket
_MARK = "\ue000"  # of private use


@dataclass(frozen=True)
class NumberList:
    """The numbers of a list, its text, and line and column of the file, from 1, at which that begins."""

    numbers: list[int | float]
    text: str
    line: int
    column: int
    in_lines: bool

    @cached_property
    def places(self) -> list[tuple[int, int]]:
        """Line and column of each number in the file."""
        places = []
        pattern = re.compile(r"(?<=- )[^\s]+" if self.in_lines else r"[^,\s]+")
        for number, line in enumerate(self.text.split("\n")):
            before = 1 if number else self.column
            places += [(self.line + number, before + item.start()) for item in pattern.finditer(line)]
        return places


def shortened(content: str) -> tuple[str, dict[str, NumberList]]:
    """Replace long lists of numbers in YAML by words; return the text, and the list of each word."""
    lists: dict[str, NumberList] = {}
    if _MARK in content:
        return content, lists
    parts, end = [], 0
    candidates = [(match, False) for match in _FLOW.finditer(content)]
    candidates += [(match, True) for match in _BLOCK.finditer(content)]
    for match, in_lines in sorted(candidates, key=lambda each: each[0].start()):
        written = match[0]
        items = [line.strip()[2:] for line in written.splitlines()] if in_lines else written.split(",")
        if match.start() < end or (numbers := _numbers(items)) is None:
            continue
        indents = {line.index("-") for line in written.splitlines()} if in_lines else {0}
        if len(indents) > 1:
            continue
        word = f"{_MARK}{len(lists)}{_MARK}"
        line = content.count("\n", 0, match.start()) + 1
        column = match.start() - content.rfind("\n", 0, match.start())
        lists[word] = NumberList(numbers, written, line, column, in_lines)
        dash = " " * indents.pop() + "- " if in_lines else ""
        blank = "\n" * written.count("\n")
        if not in_lines and not _LAST.match(content, match.end() + 1):  # the rest keeps its column
            last = written.rpartition("\n")[2]
            blank += " " * (len(last) if blank else len(last) - len(word))
        parts += [content[end : match.start()], dash, word, blank]
        end = match.end()
    return "".join([*parts, content[end:]]), lists


def _numbers(items: list[str]) -> list[int | float] | None:
    """Return the numbers of a list; None where one of its items is something else, or infinite."""
    numbers: list[int | float] = []
    for item in items:
        if (match := _NUMBER.fullmatch(item.strip(" \n"))) is None:
            return None
        numbers.append(int(match[0]) if match[1] is None and match[2] is None else float(match[0]))
    return numbers if all(map(math.isfinite, numbers)) else None
