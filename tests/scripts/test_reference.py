"""The reference of keys and columns is whole: each has its meaning, unit, values and default, or origin."""

from __future__ import annotations

import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gfmdlayer.config import Config
from gfmdlayer.config.json_schema import json_schema
from gfmdlayer.results.schema import SYMBOLS, parameter
from gfmdlayer.validation.fields import dimension
from gfmdlayer.validation.sections import described

PAGES = runpy.run_path(str(Path(__file__).parents[2] / "docs/extensions/reference_pages.py"))
SCHEMA = json_schema()
# Pure numbers. A new key with a number belongs here, or its meaning ends with its dimension.
PURE = {
    *("alpha", "exponent", "gamma", "hurst", "poisson", "rms_slope", "slope", "smoothing", "taper"),
    *(
        "C1",
        "steady",
        "tolerance",
        "Insulator.permittivity",
        "Range.from",
        "Range.to",
        "Spaced.from",
        "Spaced.to",
    ),
}


def keys() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield section, key and schema of each key."""
    for section, found in SCHEMA["$defs"].items():
        for key, value in found.get("properties", {}).items():
            if "." not in key:  # those of samples and sweeps are the others' again
                yield section, key, value


def has_fractions(value: dict[str, Any]) -> bool:
    members = [*value.get("anyOf", ()), *value.get("oneOf", ()), value.get("items", {})]
    return value.get("type") == "number" or any(has_fractions(each) for each in members if each)


def test_numbers_say_their_dimension() -> None:
    for section, key, value in keys():
        if has_fractions(value):
            meaning, unit = dimension(value["description"].partition("; must be ")[0])
            assert meaning, (section, key)
            assert bool(unit) != bool({key, f"{section}.{key}"} & PURE), (section, key)


def test_every_symbol_belongs_to_a_key_and_swept_keys_have_its_dimension() -> None:
    for key in SYMBOLS:
        assert described(Config, key)[0], key
    assert parameter("grid.extent").units == "length"
    assert parameter("trajectory.velocity").units == "length / time"
    assert parameter("solver.method") is None


@pytest.mark.parametrize("page", ["configuration", "columns"])
def test_no_cell_is_empty(page: str) -> None:
    rows = [line for part in PAGES[page]() for line in part.splitlines() if line.startswith("| ")]
    assert len(rows) > 40
    for row in rows:
        cells = re.split(r"(?<!\\)\|", row)[1:-1]
        assert all(cell.strip() for cell in cells), row
