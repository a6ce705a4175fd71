"""The layout of the package: which room may import which, and no circles."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "gfmdlayer"
FILES = sorted(PACKAGE.rglob("*.py"))

# Bottom first: a room, or a module beside the rooms, imports only what stands before it.
ORDER = (
    "errors", "arrays", "resumable", "made_once", "files", "kernels", "validation", "body", "grid", "punch",
    "time_functions", "interface", "step", "contact", "friction", "history", "transport", "config", "drives",
    "observables", "results", "figures", "case", "indentation",
    "study", "fitting", "nanite", "interactive", "convergence", "verification", "cli", "__main__", "__init__",
)  # fmt: skip


def room(path: Path) -> str:
    """Return the room, or the module of the hall, to which a file belongs."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


@cache
def parsed(path: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def files_imported(path: Path) -> set[Path]:
    """Return the files of the package that a file imports anywhere, inside functions too."""
    package = ("gfmdlayer", *path.relative_to(PACKAGE).parts[:-1])
    names: list[list[str]] = []
    for node in statements(parsed(path)):
        if isinstance(node, ast.Import):
            names += (alias.name.split(".") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = [*above, *(node.module or "").split(".")] if node.module else [*above]
            names += ([*base, alias.name] for alias in node.names)
    return {found for name in names if name[0] == "gfmdlayer" and (found := file_of(name))} - {path}


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield all statements in a module, those in functions and branches too."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
            yield child
            yield from statements(child)


def file_of(name: Sequence[str]) -> Path | None:
    """Return the file of a dotted name: the module, or the package, that is or defines it."""
    for end in range(len(name), 1, -1):
        place = PACKAGE.joinpath(*name[1:end])
        for file in (place.with_suffix(".py"), place / "__init__.py"):
            if file.exists():
                return file
    return PACKAGE / "__init__.py"


def rooms_imported(path: Path) -> set[str]:
    """Return the rooms that a file imports, without its own."""
    return {room(file) for file in files_imported(path)} - {room(path)}


def test_a_room_imports_only_rooms_above_it_in_the_table() -> None:
    wrong = {
        f"{path.relative_to(PACKAGE)} imports {name}"
        for path in FILES
        for name in rooms_imported(path)
        if ORDER.index(name) >= ORDER.index(room(path))
    }
    assert not wrong


def test_no_modules_import_each_other_in_a_circle() -> None:
    """A package's __init__.py does not count: its modules may import it inside a function."""
    modules = {path: {file for file in files_imported(path) if file.stem != "__init__"} for path in FILES}
    TopologicalSorter(modules).prepare()


def test_only_a_case_and_single_contacts_know_all_of_the_numerics() -> None:
    known: dict[str, set[str]] = {}
    for path in FILES:
        known.setdefault(room(path), set()).update(rooms_imported(path))
    numerics = {"body", "grid", "contact", "friction", "history", "observables"}
    assert {name for name, rooms in known.items() if rooms >= numerics} == {"case", "interactive"}


def test_contact_friction_and_history_do_not_read_the_configuration() -> None:
    below = {"body", "grid", "interface", "contact", "friction", "history", "transport"}
    assert not [path for path in FILES if room(path) in below and "config" in rooms_imported(path)]


def test_observables_read_a_step_and_no_problem() -> None:
    of_contact = {file.name for path in FILES if room(path) == "observables" for file in files_imported(path)
                  if room(file) == "contact"}  # fmt: skip
    assert of_contact <= {"residual.py"}


def test_there_is_one_time_loop() -> None:
    loops = [path.name for path in FILES for line in path.read_text(encoding="utf-8").splitlines()
             if line.strip().startswith("for instant in")]  # fmt: skip
    assert loops == ["case.py"]


def test_a_class_name_has_one_home() -> None:
    """A leading underscore makes no other name: a stranger reads `_Step` as a kind of `Step`."""
    homes = defaultdict(list)
    for path in FILES:
        for node in statements(parsed(path)):
            if isinstance(node, ast.ClassDef):
                homes[node.name.lstrip("_")].append(f"{path.relative_to(PACKAGE)}:{node.lineno}")
    assert not {name: places for name, places in homes.items() if len(places) > 1}
