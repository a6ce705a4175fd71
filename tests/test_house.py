"""The house stays as it was drawn: who may import whom, and how long a file may be."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "gfmdlayer"
FILES = sorted(PACKAGE.rglob("*.py"))

NUMERICS = {"solid", "contact", "stepping"}
RUNNING = {"sweep", "running", "cli", "__main__"}
ABOVE = {"assembly", "simulation", "fitting", "verification"} | RUNNING  # what no room may know
FORBIDDEN = {
    "config": NUMERICS | {"results", "inputs", "tables", "trajectory"} | ABOVE,
    "solid": {"contact", "stepping", "results"} | ABOVE,
    "contact": {"solid", "stepping", "results"} | ABOVE,
    "stepping": {"contact", "results"} | ABOVE,
    "results": NUMERICS | ABOVE,
    "fitting": {"contact", "stepping", "assembly", "simulation", "verification"} | RUNNING,
    "verification": RUNNING | {"fitting"},
    "inputs": {"solid", "stepping", "results"} | ABOVE,
    "tables": NUMERICS | {"results"} | ABOVE,
    "trajectory": NUMERICS | {"results"} | ABOVE,
    "resumable": NUMERICS | {"config", "results", "inputs", "tables", "trajectory"} | ABOVE,
    "assembly": {"results", "simulation", "verification"} | RUNNING,
    "simulation": {"solid", "results", "verification"} | RUNNING,
    "sweep": NUMERICS | {"results", "assembly", "simulation", "verification", "running", "cli", "__main__"},
    "running": {"solid", "stepping", "assembly", "verification", "cli", "__main__"},
    "cli": NUMERICS | {"assembly", "simulation", "__main__"},
    "__main__": (NUMERICS | ABOVE | {"results"}) - {"cli"},
    "__init__": set[str](),
}


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


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_follow_the_arrows(path: Path) -> None:
    assert room(path) in FORBIDDEN, "a new room needs its arrows"
    assert not rooms_imported(path) & FORBIDDEN[room(path)]


def test_only_the_assembly_knows_all_of_the_numerics() -> None:
    assert [path.name for path in FILES if rooms_imported(path) >= NUMERICS] == ["assembly.py"]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_files_are_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 300


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("import gfmdlayer.results.writer", {"gfmdlayer.results.writer"}),
        ("def f():\n    from gfmdlayer import contact", {"gfmdlayer.contact"}),
        ("from ..contact import grid", {"gfmdlayer.contact.grid"}),
        ("from . import layer", {"gfmdlayer.solid.layer"}),
    ],
)
def test_no_way_of_importing_escapes_the_search(source: str, names: set[str]) -> None:
    assert set(imported(ast.parse(source), "gfmdlayer.solid")) == names
