"""The layout of the package: which room may import which, no circles, no crowded rooms."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "gfmdlayer"
FILES = sorted(PACKAGE.rglob("*.py"))

# Bottom first: a room, or a module beside the rooms, imports only what stands before it.
ORDER = (
    "arrays", "resumable", "files", "kernels", "validation", "body", "grid", "punch", "time_functions",
    "interface", "contact", "history", "config", "programme", "notes", "observables",
    "results", "figures", "model", "footprint", "indentation", "periodic", "execution", "fitting",
    "interactive", "verification", "cli", "__main__", "__init__",
)  # fmt: skip


def room(path: Path) -> str:
    """Return the room, or the module of the hall, to which a file belongs."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imported(tree: ast.AST, package: str) -> Iterator[str]:
    """Yield the dotted names of everything imported anywhere in a module, inside functions too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")[: len(package.split(".")) - node.level + 1]
            base = (
                ".".join([*parents, *([node.module] if node.module else [])]) if node.level else node.module
            )
            yield from (f"{base}.{alias.name}" for alias in node.names)


def rooms_imported(path: Path) -> set[str]:
    """Return the rooms of the package that a file imports, its own left out."""
    package = ".".join(("gfmdlayer", *path.relative_to(PACKAGE).parts[:-1]))
    names = [name.split(".") for name in imported(ast.parse(path.read_text(encoding="utf-8")), package)]
    return {name[1] for name in names if name[0] == "gfmdlayer" and len(name) > 1} - {room(path)}


def files_imported(path: Path) -> set[Path]:
    """Return the files of the package that a file imports."""
    package = ".".join(("gfmdlayer", *path.relative_to(PACKAGE).parts[:-1]))
    found = set()
    for name in imported(ast.parse(path.read_text(encoding="utf-8")), package):
        parts = name.split(".")[1:]
        for end in range(len(parts), 0, -1):
            if (module := PACKAGE.joinpath(*parts[:end]).with_suffix(".py")).exists():
                found.add(module)
                break
    return found - {path}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_follow_the_arrows(path: Path) -> None:
    below = ORDER[: ORDER.index(room(path))]
    assert rooms_imported(path) <= set(below)


def test_no_files_import_each_other_in_a_circle() -> None:
    TopologicalSorter({path: files_imported(path) for path in FILES}).prepare()


def test_only_the_case_knows_all_of_the_numerics() -> None:
    numerics = {"body", "grid", "contact", "history", "observables"}
    assert [path.name for path in FILES if rooms_imported(path) >= numerics] == ["periodic.py"]


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("import gfmdlayer.results.writer", {"gfmdlayer.results.writer"}),
        ("def f():\n    from gfmdlayer import contact", {"gfmdlayer.contact"}),
        ("from ..contact import grid", {"gfmdlayer.contact.grid"}),
        ("from . import layer", {"gfmdlayer.body.layer"}),
    ],
)
def test_no_way_of_importing_escapes_the_search(source: str, names: set[str]) -> None:
    assert set(imported(ast.parse(source), "gfmdlayer.body")) == names
