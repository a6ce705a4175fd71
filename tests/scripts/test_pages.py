"""The code of README.md and of the pages of docs/ works, in order of each.

A block is left out where the line before it is a comment that begins with "not run" and says why.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.config import load

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
GENERATED = {"columns.md", "command-line.md", "configuration.md", "together.md"}  # when the site is built
PAGES = [
    ROOT / "README.md",
    *sorted(DOCS.glob("*.md")),
    *(page for page in sorted(DOCS.glob("[grst]*/*.md")) if page.name not in GENERATED),
]
BLOCK = re.compile(r"^(<!-- not run[^\n]*-->\n)?```([{}\w]*)[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class Block:
    page: Path
    line: int
    language: str
    code: str
    runs: bool

    def __str__(self):
        return f"{self.page.relative_to(ROOT)}-{self.line}"


def blocks(page):
    text = page.read_text(encoding="utf-8")
    for found in BLOCK.finditer(text):
        line = text.count("\n", 0, found.start(2)) + 1
        yield Block(page, line, found[2], found[3], runs=found[1] is None)


BLOCKS = {page: list(blocks(page)) for page in PAGES}


def fill(folder):
    """Make a clone with small configurations, and with the files that a user brings along."""
    (folder / "configs").mkdir()
    for path in (ROOT / "configs").iterdir():
        quick = path.with_name(f"{path.stem}-quick.yaml")
        content = (quick if quick.exists() else path).read_text()
        content = content.replace(f"name: {quick.stem}", f"name: {path.stem}")
        content = re.sub(r"points: \d{3,}", "points: 256", content)
        content = re.sub(r"(layer.thickness): \[.*\]", r"\1: [0, 0.0625, .inf]", content)
        (folder / "configs" / path.name).write_text(content)
    (folder / "scripts").symlink_to(ROOT / "scripts")
    (folder / ".venv/bin").mkdir(parents=True)
    activate = f"export PATH={Path(sys.executable).parent}:$PATH\n"
    (folder / ".venv/bin/activate").write_text(activate)
    shutil.copy(ROOT / "configs/polymer.csv", folder / "master-curve.csv")
    np.save(folder / "surface.npy", np.zeros((8, 8)))
    (bed,) = (each.code for each in BLOCKS[DOCS / "guides/own-body.md"] if each.language == "python")
    (folder / "bed.py").write_text(bed)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results that several pages look at, of one run."""
    folder = tmp_path_factory.mktemp("clone")
    fill(folder)
    gfmdlayer.run(folder / "configs/figure2.yaml", out=folder / "results/figure2")
    return folder / "results"


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A clone in the working directory."""
    fill(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_each_block_is_in_a_known_language(page):
    languages = {block.language for block in BLOCKS[page] if not block.language.startswith("{")}
    assert languages <= {"", "bash", "math", "python", "text", "yaml"}
    assert page.read_text(encoding="utf-8").count("\n```") == 2 * len(BLOCKS[page])


@pytest.mark.slow  # the verbs are tested on small cases in tests/cli
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_and_scripts_work_one_after_the_other(page, clone, results):
    mpl.use("Agg")
    plt.close("all")  # the axes of another page are none of this one
    shutil.copytree(results, clone / "results")
    names = {}
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    for block in BLOCKS[page]:
        if block.runs and block.language == "bash":
            ran = subprocess.run(
                ["bash", "-e", "-c", block.code],
                capture_output=True, text=True, check=False, env=os.environ | {"PATH": path},
            )  # fmt: skip
            assert ran.returncode == 0, f"{block}:\n{block.code}\n{ran.stderr}"
        elif block.runs and block.language == "python":
            exec(compile(block.code, str(block), "exec"), names)


@pytest.mark.parametrize(
    "block", [b for page in PAGES for b in BLOCKS[page] if b.language == "yaml"], ids=str
)
def test_configurations_load(block, clone):
    whole = block.code if "name:" in block.code else f"name: part\n{block.code}"
    (clone / "case.yaml").write_text(whole)
    load("case.yaml")


def length_allowed(page):
    """Words that a page may have: what is looked up, and derivations, may be longer."""
    return 600 if page.parent.name == "guides" and page.name != "index.md" else 1500


@pytest.mark.parametrize(
    "page",
    [
        ROOT / "CONTRIBUTING.md", ROOT / "README.md",
        *(each for each in DOCS.rglob("*.md") if each.relative_to(DOCS).parts[0] not in
          {"reference", "theory", "verification", "examples", "_build"}),
    ],
    ids=lambda page: str(page.relative_to(ROOT)),
)  # fmt: skip
def test_a_page_is_short_enough_to_be_read(page):
    assert len(page.read_text(encoding="utf-8").split()) <= length_allowed(page)


def test_the_version_has_one_number_and_date_and_its_changes_fit_a_screen():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    citation = dict(
        re.findall(r"^(version|date-released): (\S+)$", (ROOT / "CITATION.cff").read_text(), re.M)
    )
    changes = re.split(r"^## \[(.*)\](?: - (.*))?\n", (ROOT / "CHANGELOG.md").read_text(), flags=re.M)
    assert version == citation["version"] == changes[1]
    assert citation["date-released"] == changes[2]
    assert all(text.count("\n") <= 55 for text in changes[3::3])
