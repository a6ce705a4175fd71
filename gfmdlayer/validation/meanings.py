"""What the keys of a section mean, and in which dimension: the strings below its fields.

A string ends with the dimension of a number, if it has one: "radius of curvature: length".

They are read from the source when something is to be explained: no run needs them, and reading them takes
about as long as making all of the sections.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from functools import cache
from itertools import pairwise

from pydantic import BaseModel

_DIMENSION = re.compile(
    r": ((?:length|pressure|time|force|drive|V|J|mol|kelvin|degrees|Celsius|or|\d|[/^ ])+)$", re.MULTILINE
)


def dimension(words: str) -> tuple[str, str]:
    """Split the words of a key into its meaning and its dimension, which is empty where it has none."""
    found = _DIMENSION.search(words)
    return (words[: found.start()], found[1]) if found else (words, "")


@cache
def meanings(section: type[BaseModel]) -> dict[str, str]:
    """Return what the fields of a section mean, by the names that users write."""
    found: dict[str, str] = {}
    for base in reversed(section.__mro__):
        own = set(vars(base).get("__annotations__", ())) & set(section.model_fields)
        found = {name: words for name, words in found.items() if name not in own}
        found |= {name: words for name, words in (_written(base) if own else {}).items() if name in own}
    return {section.model_fields[name].alias or name: words for name, words in found.items()}


def _written(section: type) -> dict[str, str]:
    """Return the strings below the annotated names of a class, where its source is at hand."""
    try:
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(section))).body
    except OSError:  # typed into a session
        return {}
    return {
        field.target.id: inspect.cleandoc(below.value.value)
        for field, below in pairwise(tree.body if isinstance(tree, ast.ClassDef) else ())
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
        if isinstance(below.value.value, str)
    }
