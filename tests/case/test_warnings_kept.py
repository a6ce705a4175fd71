"""Warnings are part of the results: in files and data, in the overview, with the number that would do."""

import re

import h5py
import pytest

import gfmdlayer
from gfmdlayer.cli import main

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

COARSE = {"name": "coarse", "grid": {"points": 64}, "time": {"end": 1.0, "step": 0.5}}


def enough(said):
    """The points that a warning asks for, along one axis."""
    return int(re.search(r"take more grid.points: \[?(\d+)", said)[1])


def test_the_points_of_the_warning_are_enough():
    data = gfmdlayer.run(COARSE)
    line, coarse = data.attrs["warnings"].splitlines()
    assert line.startswith("time.step = 0.5 is long beside a ramp")
    assert coarse.startswith("COARSE: at most 3 points in contact")
    finer = gfmdlayer.run(COARSE, grid={"points": enough(coarse)})
    assert finer.attrs["most_contact_points"] >= 30
    assert "COARSE" not in finer.attrs["warnings"]
    half = gfmdlayer.run(COARSE, grid={"points": enough(coarse) // 4})
    assert "COARSE" in half.attrs["warnings"]


def test_warnings_of_a_sweep_name_the_cases_that_have_them(tmp_path, capsys):
    data = gfmdlayer.run(COARSE, sweep={"grid.points": [64, 1024, 128]}, out=tmp_path)
    steps, coarse = data.attrs["warnings"].splitlines()
    assert steps.startswith("time.step = 0.5 is long")  # of all cases
    assert coarse.startswith("cases 0000, 0002: COARSE: at most 3 points")  # words with other numbers are one
    held = gfmdlayer.run(COARSE, sweep={"grid.points": [64, 1024, 128]})
    assert held.attrs["warnings"] == data.attrs["warnings"]
    with h5py.File(tmp_path / "cases" / "0001.h5") as h5:
        assert "COARSE" not in h5.attrs["warnings"]
    assert main(["status", str(tmp_path)]) == 0
    assert f"warning: {coarse}" in capsys.readouterr().out
    fine = {"sweep": {"grid.points": [1024, 2048]}, "out": tmp_path / "fine", "time__step": 0.05}
    assert "warnings" not in gfmdlayer.run(COARSE, **fine).attrs
    assert main(["status", str(tmp_path / "fine")]) == 0
    assert "warning" not in capsys.readouterr().out


@pytest.mark.filterwarnings("ignore")
def test_doubts_about_a_leak_are_kept_with_the_points_that_would_do():
    punch = {
        "shape": "self_affine", "hurst": 0.8, "roll_off": 0.5, "short_cutoff": 0.0625, "rms_slope": 0.1,
        "seed": 1,
    }  # fmt: skip
    given = {
        "name": "seal", "grid": {"points": [64, 64]}, "punch": punch, "layer": {"thickness": float("inf")},
        "trajectory": {"control": "load", "load": 0.03, "ramp_time": 0.1},
        "time": {"end": 10.0, "step": "adaptive", "tolerance": 1e-2},
        "output": {"snapshots": [10.0], "leakage": {"every": 1}},
    }  # fmt: skip
    data = gfmdlayer.run(given)
    said = data.attrs["warnings"]
    throat = re.search(r"has ([\d.]+) points across it, below 6: .*? grid.points: \[(\d+), \d+\]", said)
    assert int(throat[2]) >= 64 * 6 / float(throat[1]) > int(throat[2]) / 2  # the next power of two
    flow = gfmdlayer.leakage(data)
    assert "right only to an order of magnitude; take more grid.points: [" in flow.attrs["warnings"]


def test_a_run_without_doubts_has_no_warnings():
    given = {"grid": {"points": 1024}, "time": {"end": 1.0, "step": 0.05}}
    assert "warnings" not in gfmdlayer.run(given).attrs
