"""The reference is whole: keys have meaning, unit, values, default and example; columns have their origin."""

import re
import runpy
import sys
import tomllib
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import h5py
import numpy as np
import pytest
from packaging.specifiers import SpecifierSet

from gfmdlayer.config import Config, load
from gfmdlayer.config.json_schema import json_schema
from gfmdlayer.results.names import SYMBOLS, parameter
from gfmdlayer.validation.fields import dimension
from gfmdlayer.validation.sections import described

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs/extensions"))  # where Sphinx finds them too
PAGES = runpy.run_path(str(ROOT / "docs/extensions/reference_pages.py"))
EXAMPLES = PAGES["EXAMPLES"]
# Pure numbers. A new key with a number belongs here, or its meaning ends with its dimension.
PURE = {
    *(
        "alpha",
        "edge_exponent",
        "exponent",
        "gamma",
        "hurst",
        "poisson",
        "rms_slope",
        "slope",
        "smoothing",
        "taper",
    ),
    *("C1", "steady", "tolerance", "Insulator.permittivity", "Range.from", "Range.to", "Spaced.from"),
    *(
        "Creepages.x",
        "Creepages.y",
        "Spaced.to",
        "coefficient",
        "creepage",
        "cycles",
        "velocity_ratio",
        "normal",
        "along",
        "hole",
    ),
}


@cache
def sections():
    """Return the schema of each section."""
    return json_schema()["$defs"]


def keys():
    """Yield section, key and schema of each key."""
    for section, found in sections().items():
        for key, value in found.get("properties", {}).items():
            if "." not in key:  # those of samples and sweeps are the others' again
                yield section, key, value


def has_fractions(value):
    members = [*value.get("anyOf", ()), *value.get("oneOf", ()), value.get("items", {})]
    return value.get("type") == "number" or any(has_fractions(each) for each in members if each)


def test_each_section_has_an_example():
    assert sections().keys() == EXAMPLES.keys()


def test_numbers_say_their_dimension():
    for section, key, value in keys():
        if has_fractions(value):
            meaning, unit = dimension(value["description"].partition("; must be ")[0])
            assert meaning, (section, key)
            assert bool(unit) != bool({key, f"{section}.{key}"} & PURE), (section, key)


def test_every_symbol_belongs_to_a_key_and_swept_keys_have_its_dimension():
    for key in SYMBOLS:
        assert described(Config, key)[0], key
    assert parameter("grid.extent").units == "length"
    assert parameter("trajectory.velocity").units == "length / time"
    assert parameter("solver.method") is None


@pytest.mark.parametrize("page", ["configuration", "columns"])
def test_no_cell_is_empty(page):
    rows = [line for part in PAGES[page]() for line in part.splitlines() if line.startswith("| ")]
    assert len(rows) > 40
    for row in rows:
        cells = re.split(r"(?<!\\)\|", row)[1:-1]
        assert all(cell.strip() for cell in cells), row


@pytest.fixture
def files(tmp_path, monkeypatch):
    """The files that examples name, in the working directory."""
    monkeypatch.chdir(tmp_path)
    (bed,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/guides/own-body.md").read_text(), re.DOTALL)
    Path("bed.py").write_text(bed)
    Path("rubber.yaml").write_text("material: {model: prony, G0: 0.5, branches: [{G: 2.0, tau: 0.01}]}\n")
    Path("stiffness.txt").write_text("1 1\n1e6 1e6\n")
    np.save("stiffness.npy", np.ones(8))
    for name in ("celsius.txt", "velocity.txt", "depth.txt", "displacement.txt", "friction.txt"):
        Path(name).write_text("0 0\n8 0.01\n")
    x = np.arange(512) / 512 - 0.5
    np.savetxt("heights.txt", np.stack([x, x**2], axis=1), fmt="%.17g")
    np.savetxt("profile.txt", np.stack([x[256:] + 0.5, x[256:] ** 2], axis=1) - [0.5, 0], fmt="%.17g")
    np.savetxt("scan.txt", np.zeros((256, 256)), fmt="%g")
    with h5py.File("surface.h5", "w") as h5:
        h5["scan/height"] = np.zeros((64, 64))


@pytest.mark.usefixtures("files")
@pytest.mark.parametrize("section", EXAMPLES)
def test_the_examples_of_a_section_are_valid_and_have_all_its_keys(section):
    """A key that is a section has its own examples; the keys of sweeps are the other sections'."""
    for example in EXAMPLES[section].split("\n---\n"):
        Path("example.yaml").write_text(f"name: example\n{example}\n")
        load("example.yaml")
    for key, value in sections()[section].get("properties", {}).items():
        if section not in {"Sweep", "Zip"} and "." not in key and not PAGES["_sections"](value):
            assert re.search(rf"\b{key}: ", EXAMPLES[section]), (section, key)


def test_each_dependency_has_a_line_with_its_bound():
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    page = (ROOT / "docs/reference/dependencies.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| ([\w.]+) \| ([\d.]+) \| \S", page, re.MULTILINE)
    assert sorted(map(">=".join, listed)) == sorted(needed)


def test_the_pinned_versions_install_on_the_first_python_that_is_supported():
    """Debian's Python is 3.11.2; a release of 3.11.5 and later would stop the installation there."""
    pins = [line.split("==") for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line]
    found = {name: distribution.metadata for name, _ in pins for distribution in installed(name)}
    assert len(found) > 20  # of the extras that are installed here
    refused = [
        f"{name} {version}: {found[name]['Requires-Python']}"
        for name, version in pins
        if name in found and found[name]["Version"] == version
        if not SpecifierSet(found[name]["Requires-Python"] or "").contains("3.11.0")
    ]
    assert refused == []


def installed(name):
    """Return the distribution of a name, if there is one."""
    try:
        return [distribution(name)]
    except PackageNotFoundError:
        return []
