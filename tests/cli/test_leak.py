"""`gfmdlayer leak`: a table of the flow, a picture, a file of the fields, messages for bad input."""

import numpy as np
import pytest
import xarray as xr

from gfmdlayer.cli import main
from gfmdlayer.results.reader import open_case

CONFIG = """\
name: seal
grid: {points: [32, 32]}
layer: {thickness: .inf}
punch: {shape: sinusoid, amplitude: 0.01, wavelength: 1.0}
trajectory: {control: load, load: 0.02, ramp_time: 0.1}
time: {end: 1.0, step: 0.1}
output: {snapshots: [0.1, 1.0]}
sweep: {trajectory.load: [0.02, 0.03]}
"""
LINE = """\
name: line
grid: {points: 64}
time: {end: 1.0, step: 0.5}
output: {snapshots: [1.0]}
"""


@pytest.fixture(autouse=True, scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("leak")
    for name, text in {"seal": CONFIG, "line": LINE, "without": LINE.replace("[1.0]", "[]")}.items():
        (folder / f"{name}.yaml").write_text(text)
        assert main(["run", str(folder / f"{name}.yaml"), "--out", str(folder / name)]) == 0
    return folder


def test_each_snapshot_has_a_line_and_the_first_case_a_picture(results, capsys):
    fields = results / "fields.h5"
    seal = ["--viscosity", "1e-3", "--pressure-drop", "1e-4", "--fields", str(fields)]
    assert main(["leak", str(results / "seal"), *seal]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in shown if line.split()[0] in {"0.1", "1"}] == ["0.1", "1"] * 2
    picture = results / "seal" / "seal-leak.png"
    assert str(picture) in shown
    assert picture.read_bytes().startswith(b"\x89PNG")
    with (
        xr.open_dataset(fields, engine="h5netcdf") as found,
        open_case(results / "seal/cases/0000.h5") as case,
    ):
        assert found.fluid_pressure.dims == ("snapshot", "x", "y")
        np.testing.assert_array_equal(found.x, case.x)
        np.testing.assert_allclose(found.flow_x.mean(("x", "y")), found.flow_xx, rtol=1e-8)
        np.testing.assert_allclose(found.leak_rate, found.flow_xx * 1e-4 / 12e-3)


def test_a_line_has_a_table_and_no_picture(results, capsys):
    assert main(["leak", str(results / "line" / "cases" / "0000.h5"), "--along", "y"]) == 0
    assert "flow_yy" in capsys.readouterr().out
    assert not list(results.glob("line/**/*.png"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["seal", "--viscosity", "0", "--pressure-drop", "1"], "viscosity: got 0.0; must be a number > 0"),
        (["seal", "--viscosity", "1"], "pressure_drop: missing"),
        (["without"], "no snapshots; set output.snapshots"),
        (["seal", "--case", "7"], "there is no case 7"),
        (["seal", "--out", "leak.txt"], "cannot be drawn as '.txt'"),
        (["nothing"], "no such folder"),
    ],
)
def test_input_that_cannot_be_used_is_refused(arguments, message, results, capsys):
    name, *options = arguments
    assert main(["leak", str(results / name), *options]) == 2
    assert message in capsys.readouterr().err


def test_a_curve_of_the_leak_is_drawn_over_time_and_pressure(results, capsys):
    """A line for each snapshot and drop, in one picture of all cases; the fluid lifts the surface."""
    fluid = ["--viscosity", "1e-3", "--pressure-drop", "1e-4", "1e-3", "--diameter", "2.0", "--length", "3.0"]
    case = str(results / "seal")
    assert main(["leak", case, *fluid, "--coupled", "--plot"]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in shown if line.split()[0] in {"0.1", "1"}] == [
        "0.1",
        "0.1",
        "1",
        "1",
    ] * 2
    heading = next(line.split() for line in shown if "leak_rate" in line)
    row = dict(zip(heading, next(line.split() for line in shown if line.split()[0] == "0.1"), strict=True))
    assert float(row["pressure_drop"]) == 1e-4
    assert float(row["leak_rate_low"]) <= float(row["leak_rate"]) <= float(row["leak_rate_high"])
    width = 2 * np.pi / 3.0
    assert float(row["leak_rate"]) == pytest.approx(float(row["flow_xx"]) / 12e-3 * 1e-4 * width, rel=0.02)
    assert (results / "seal" / "seal-leak-curve.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("case", "options", "message"),
    [
        ("seal", [], "--plot: a curve of the leak needs --viscosity and --pressure-drop"),
        (
            "line",
            ["--viscosity", "1", "--pressure-drop", "1"],
            "--plot: one snapshot and one drop make no curve",
        ),
    ],
)
def test_a_curve_of_one_point_is_refused(results, capsys, case, options, message):
    assert main(["leak", str(results / case), *options, "--plot"]) == 2
    assert message in capsys.readouterr().err
