"""Long lists of plain numbers in YAML, which are read a hundred times faster than by a parser of YAML.

Each such list is replaced by one word before the text is parsed, and stands in for it where the word is the
only entry of a list again. Lines and columns stay those of the file. A list that a parser of YAML would not
take for just these numbers, as inside of a quoted text, is left to that parser with all the others.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

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
        found = []
        pattern = re.compile(r"(?<=- )[^\s]+" if self.in_lines else r"[^,\s]+")
        for number, line in enumerate(self.text.split("\n")):
            before = 1 if number else self.column
            found += [(self.line + number, before + item.start()) for item in pattern.finditer(line)]
        return found


def shortened(content: str) -> tuple[str, dict[str, NumberList]]:
    """Replace long lists of numbers by words.

    Parameters
    ----------
    content : str
        YAML.

    Returns
    -------
    str, dict
        The text with as many lines, and the list that each of its words means.
    """
    lists: dict[str, NumberList] = {}
    if _MARK in content:
        return content, lists
    parts, end = [], 0
    for match, in_lines in _candidates(content):
        found = match[0]
        items = [line.strip()[2:] for line in found.splitlines()] if in_lines else found.split(",")
        if match.start() < end or (numbers := _numbers(items)) is None:
            continue
        indents = {line.index("-") for line in found.splitlines()} if in_lines else {0}
        if len(indents) > 1:
            continue
        word = f"{_MARK}{len(lists)}{_MARK}"
        line = content.count("\n", 0, match.start()) + 1
        column = match.start() - content.rfind("\n", 0, match.start())
        lists[word] = NumberList(numbers, found, line, column, in_lines)
        dash = " " * indents.pop() + "- " if in_lines else ""
        blank = "\n" * found.count("\n")
        if not in_lines and not _LAST.match(content, match.end() + 1):  # what follows keeps its column
            last = found.rpartition("\n")[2]
            blank += " " * (len(last) if blank else len(last) - len(word))
        parts += [content[end : match.start()], dash, word, blank]
        end = match.end()
    return "".join([*parts, content[end:]]), lists


def _candidates(content: str) -> Iterator[tuple[re.Match[str], bool]]:
    """Yield what may be lists of numbers, in their order."""
    flow, block = _FLOW.finditer(content), _BLOCK.finditer(content)
    every = [(match, False) for match in flow] + [(match, True) for match in block]
    yield from sorted(every, key=lambda each: each[0].start())


def _numbers(items: list[str]) -> list[int | float] | None:
    """Return the numbers of a list; None where one of its items is something else, or infinite."""
    found: list[int | float] = []
    for item in items:
        if (match := _NUMBER.fullmatch(item.strip(" \n"))) is None:
            return None
        found.append(int(match[0]) if match[1] is None and match[2] is None else float(match[0]))
    return found if all(map(math.isfinite, found)) else None
