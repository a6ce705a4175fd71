"""What docs/reference/promised.txt lists is there: a name goes only after one version with a FutureWarning.

`python -m tests.test_interfaces` writes the list anew when a version is made.
"""

from __future__ import annotations

import argparse
import inspect
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

import gfmdlayer
from gfmdlayer import figures
from gfmdlayer.cli import command_line
from gfmdlayer.config import Config
from gfmdlayer.config.json_schema import json_schema
from gfmdlayer.observables import INDENTATION, OBSERVABLES, TOTALS, known_columns
from gfmdlayer.results.names import VARIABLES

PROMISED = Path(__file__).parents[1] / "docs/reference/promised.txt"
LINE = re.compile(r"(?P<owner>[^:]+):(?P<names>.*)")


def keys() -> Iterator[tuple[str, str]]:
    """Yield the keys of each section of a configuration; a section with several kinds has a line for each."""
    schema = json_schema()
    yield from (("configuration", key) for key in schema["properties"])
    for section, found in schema["$defs"].items():
        yield from ((f"section {section}", key) for key in found.get("properties", {}) if "." not in key)


def columns() -> Iterator[tuple[str, str]]:
    """Yield the columns and numbers of each kind of case, and the fields of snapshots."""
    histogram = {"pressure": {"max": 1.0}, "gap": {"max": 1.0}}
    output = {"patches": True, "histograms": histogram, "stiffness": {"frequencies": [1.0]}}
    everything = Config(name="all", grid={"points": [8, 8]}, output=output)
    for observable in OBSERVABLES.values():
        declared = (*(observable.columns(everything) or observable.COLUMNS), *observable.FURTHER)
        yield from (("columns", each.name) for each in (*declared, *observable.NUMBERS))
    yield from (("fields", each.name) for each in VARIABLES.values())
    yield from (("columns without images", each.name) for each in TOTALS.values() if each is not None)
    yield from (("columns of an indentation", each.name) for each in INDENTATION)


def python() -> Iterator[tuple[str, str]]:
    """Yield the public functions and classes with their parameters."""
    public = {f"gfmdlayer.{name}": getattr(gfmdlayer, name) for name in gfmdlayer.__all__}
    public |= {f"gfmdlayer.figures.{name}": getattr(figures, name) for name in figures.__all__}
    for name, found in public.items():
        yield from ((name, each) for each in parameters(found))


def parameters(found: object) -> list[str]:
    """Return the names of the parameters, or an empty name where there are none."""
    # Not the signature of a class, which Pydantic hands on from a base class once that has been looked at.
    function = found.__init__ if inspect.isclass(found) else found  # type: ignore[misc]
    of = inspect.signature(function).parameters.values()  # type: ignore[arg-type]
    several = {inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL}
    return [each.name for each in of if each.name != "self" and each.kind not in several] or [""]


def commands() -> Iterator[tuple[str, str]]:
    """Yield the verbs with their arguments and options."""
    parser = command_line()
    (verbs,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    for verb, options in verbs.choices.items():
        for action in options._actions:
            yield from ((f"gfmdlayer {verb}", name) for name in action.option_strings or [action.dest])


def layout(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield the files of a finished sweep, and the attributes of its cases."""
    keys = {"grid": {"points": 16}, "time": {"end": 0.1, "step": 0.1}, "output": {"snapshots": [0.1]}}
    gfmdlayer.run({**keys, "sweep": {"layer.thickness": [0.1, 0.2]}}, out=folder / "sweep")
    made = [path.relative_to(folder / "sweep") for path in (folder / "sweep").rglob("*.*")]
    yield from (("files", str(path)) for path in made if path.suffix in {".h5", ".yaml"})
    with gfmdlayer.open_case(folder / "sweep/cases/0000.h5") as case:
        yield from (("attributes of a case", str(name)) for name in case.attrs if name != "warnings")


def present(folder: Path) -> dict[str, set[str]]:
    """Return all names that are there, by their owner."""
    found = defaultdict(set)
    for owner, name in (*keys(), *columns(), *python(), *commands(), *layout(folder)):
        found[owner].add(name)
    return {owner: names - {""} for owner, names in found.items()}


def promised() -> dict[str, set[str]]:
    """Return the list of the documentation."""
    lines = [line for line in PROMISED.read_text(encoding="utf-8").splitlines() if line]
    matches = [LINE.fullmatch(line) for line in lines]
    return {found["owner"]: set(found["names"].split()) for found in matches if found}


@pytest.mark.filterwarnings("ignore::UserWarning")  # the case is coarse
def test_nothing_that_is_promised_is_gone(tmp_path: Path) -> None:
    there = present(tmp_path)
    gone = {owner: names - there.get(owner, set()) for owner, names in promised().items()}
    assert not {owner: names for owner, names in gone.items() if names or owner not in there}


def test_the_list_has_every_kind_of_name() -> None:
    """A list that cannot be read, or that lacks a kind, would promise nothing."""
    listed = promised()
    assert {f"gfmdlayer.{name}" for name in gfmdlayer.__all__} <= listed.keys()
    assert {"thickness", "poisson", "material"} <= listed["section Layer"]
    assert {"contact_area", "mean_pressure", "lost", *known_columns()} <= listed["columns"]
    assert "--jobs" in listed["gfmdlayer run"]
    assert {"config.yaml", "sweep.h5", "cases/0000.h5"} <= listed["files"]


def test_public_names_are_public() -> None:
    assert not [name for name in (*gfmdlayer.__all__, *dir(gfmdlayer)) if name.startswith("_")]


if __name__ == "__main__":
    with TemporaryDirectory() as name:
        found = present(Path(name))
    lines = (f"{owner}: {' '.join(sorted(names))}".rstrip() for owner, names in sorted(found.items()))
    PROMISED.write_text("\n".join(lines) + "\n", encoding="utf-8")
