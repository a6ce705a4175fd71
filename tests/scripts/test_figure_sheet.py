"""The contact sheet of docs/figures.png: its runs, pictures and layout, at small size."""

import runpy
import shlex
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gfmdlayer.cli import command_line
from gfmdlayer.config import Config

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(ROOT / "scripts" / "figure_sheet.py"))


def test_each_picture_has_a_run_and_options_of_the_command_line(script, tmp_path):
    pictures, runs = script["PICTURES"], script["runs"](script["SMALL"], tmp_path)
    assert len(pictures) == 12
    assert {picture.run for picture in pictures} == set(runs)
    for name, values in runs.items():
        Config(name=name, **values)
    for picture in pictures:
        command_line().parse_args(["plot", "DIR", *shlex.split(picture.options)])


def test_pictures_keep_their_shape_below_their_captions(script, tmp_path):
    dots = round(175.0 / 25.4 * 300)  # two columns of a journal
    for i, (width, height) in enumerate([(dots, dots), (dots // 2, dots)]):
        Image.new("RGB", (width, height), "blue").save(tmp_path / f"{i}.png")
    found = script["sheet"]([("--one", tmp_path / "0.png"), ("--two", tmp_path / "1.png")]).convert("RGB")
    size = script["WIDTH"]
    blue = np.all(np.asarray(found) == (0, 0, 255), axis=-1)
    assert blue.sum() == pytest.approx(1.5 * size**2, rel=2 / size)
    assert found.width == script["GAP"] + script["COLUMNS"] * (size + script["GAP"])


def test_it_is_drawn(script, tmp_path):
    assert script["main"](["--small", "--only", "cycles", "--out", str(tmp_path / "sheet.png")]) == 0
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.height > 200


def test_the_sheet_in_docs_is_small():
    assert (ROOT / "docs" / "figures.png").stat().st_size < 600_000
