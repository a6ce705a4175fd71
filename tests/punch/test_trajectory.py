"""What is prescribed over time, and the tables that it is read from."""

import math

import numpy as np
import pytest

from gfmdlayer.config import Config, ConfigError
from gfmdlayer.drives import Drives
from gfmdlayer.files.tables import TableError, read_columns
from gfmdlayer.study.cases import cases
from gfmdlayer.time_functions import RampHold, Table


def written(tmp_path, text):
    file = tmp_path / "path.csv"
    file.write_text(text)
    return file


def test_the_punch_of_eq_30_goes_down_and_stays_and_its_slope_jumps_at_the_end_of_the_ramp():
    at = (0.0, 0.25, 0.5, 1.0, 1.5, 1e9, math.inf)
    expected = [0.0, 0.0025, 0.005, 0.01, 0.01, 0.01, 0.01]
    assert [RampHold(0.01, 1.0)(time) for time in at] == pytest.approx(expected, rel=1e-15)
    assert RampHold(0.02, 0.5).breakpoints == (0.5,)
    assert RampHold(0.02, 0.5)(0.25) == pytest.approx(0.01, rel=1e-15)


def test_a_table_is_linear_between_its_rows_and_constant_after_them(tmp_path):
    file = written(tmp_path, "time,depth\n0,0\n1, 0.01 # down\n\n3,0.004\n")
    trajectory = Table.read(file, "depth")
    assert trajectory.breakpoints == (1.0, 3.0)
    expected = [0, 0.005, 0.01, 0.007, 0.004, 0.004]
    np.testing.assert_allclose([trajectory(t) for t in (0, 0.5, 1, 2, 3, 99)], expected, rtol=1e-14)


def test_the_ramp_as_a_table_is_the_ramp(tmp_path):
    table, ramp = Table.read(written(tmp_path, "0 0\n1 0.01"), "depth"), RampHold(0.01, 1.0)
    assert table.breakpoints == ramp.breakpoints
    for time in np.linspace(0, 2, 21).tolist():
        assert table(time) == pytest.approx(ramp(time), rel=1e-15)


BACK = {
    "kind": "approach_retract", "start": -0.01, "approach_speed": 0.02, "dwell": 0.5, "retract_speed": 0.1,
}  # fmt: skip


def test_a_punch_approaches_dwells_and_retracts():
    config = Config(name="back", trajectory=BACK | {"depth": 0.01, "final": -0.03})
    trajectory = Drives(config).drive
    # Way over speed: 0.02/0.02, a dwell of 0.5, 0.04/0.1.
    np.testing.assert_allclose(trajectory.breakpoints, [1.0, 1.5, 1.9], rtol=1e-14)
    assert config.time.end == trajectory.breakpoints[-1]
    expected = [-0.01, 0.0, 0.01, 0.01, 0.0, -0.03, -0.03]
    at = (0, 0.5, 1.0, 1.5, 1.6, 1.9, 9.0)
    np.testing.assert_allclose([trajectory(t) for t in at], expected, atol=1e-16)


def test_cycles_begin_where_the_one_before_ends():
    config = Config(name="cycles", trajectory=BACK | {"dwell": 0.0, "final": 0.0, "cycles": 3})
    trajectory = Drives(config).drive
    np.testing.assert_allclose(
        np.diff([0.0, *trajectory.breakpoints]), [1.0, 0.1, 0.5, 0.1, 0.5, 0.1], rtol=1e-13
    )
    values = [trajectory(t) for t in (0.0, *trajectory.breakpoints)]
    np.testing.assert_allclose(values, [-0.01, *[0.01, 0.0] * 3], atol=1e-16)


def test_a_force_is_one_over_the_cell_with_rates_of_its_own():
    there = {"control": "force", "kind": "approach_retract", "force": 3.0, "retract_speed": 6.0}
    config = Config(name="force", grid={"points": 8, "period": 2.0}, trajectory=there)
    trajectory = Drives(config).drive
    assert trajectory.breakpoints == (1.0, 1.5)  # without a speed the peak is reached in a time of one
    assert trajectory(1.0) == 1.5


def test_the_run_ends_with_the_trajectory_unless_its_end_is_given():
    swept = Config(name="speeds", trajectory=BACK, sweep={"trajectory.retract_speed": [0.1, 1.0]})
    assert [case.config.time.end for case in cases(swept)] == [1.7, 1.52]
    assert "end:" not in swept.dump()
    assert Config(name="longer", trajectory=BACK, time={"end": 3.0}).time.end == 3.0


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"start": 0.01}, "trajectory.start: got 0.01; must be below depth = 0.01"),
        ({"final": 0.5}, "trajectory.final: got 0.5; must be below depth = 0.01"),
        ({"dwell": 1e-12}, "trajectory.dwell: got 1e-12: this part of the path lasts 1e-12 of"),
        ({"ramp_time": 1.0}, "trajectory.ramp_time: only for kind: ramp_hold"),
        ({"retract_speed": 0.0}, "trajectory.retract_speed: got 0.0; must be a number > 0"),
        ({"cycles": 0}, "trajectory.cycles: got 0; must be a whole number from 1"),
        ({"control": "load"}, "trajectory.load: missing"),
        ({"control": "load", "load": 1.0}, "trajectory.start: got -0.01, a pull on the punch; must be >= 0"),
        ({"kind": "ramp_hold"}, "trajectory.start: only for kind: approach_retract"),
    ],
)
def test_a_cycle_that_cannot_be_is_refused(wrong, said):
    with pytest.raises(ConfigError) as error:
        Config(name="wrong", trajectory=BACK | wrong)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0,0\n2,1\n1,2\n", r"path\.csv:3: time = 1 after 2; must increase from row to row"),
        ("time,depth\n0,0\n1,1\n1,2\n", r"path\.csv:4: time = 1 after 1; must increase"),
        ("1,0\n2,1\n", r"path\.csv: the first time is 1; must be 0"),
        ("-1,0\n2,1\n", r"path\.csv: the first time is -1; must be 0"),
        ("0,0\n", r"path\.csv(:\d+)?: holds 1 rows of numbers; must be at least 2"),
        ("", r"path\.csv(:\d+)?: holds 0 rows of numbers; must be at least 2"),
        ("0,0\n1,nan\n", r"path\.csv:2: '1,nan' is not finite; must be 2 numbers \(time, depth\)"),
        ("0,0\ninf,1\n", r"path\.csv:2: 'inf,1' is not finite"),
        ("0,0\n1,deep\n", r"path\.csv:2: cannot read '1,deep'; must be 2 numbers \(time, depth\)"),
        ("0,0\n1\n", r"path\.csv:2: holds 1 numbers; must be 2 numbers"),
        ("0,0\n1,1,1\n", r"path\.csv:2: holds 3 numbers; must be 2 numbers"),
        ("time,depth\nthen,deeper\n0,zero\n", r"path\.csv:3: cannot read '0,zero'"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_by_its_line(text, said, tmp_path):
    with pytest.raises(TableError, match=said):
        Table.read(written(tmp_path, text), "depth")


def test_words_are_passed_over_before_the_numbers_and_not_among_them(tmp_path):
    assert Table.read(written(tmp_path, "time,depth\ns,mm\n0,0\n1,1\n"), "depth")(0.5) == 0.5
    with pytest.raises(TableError, match=r"path\.csv:3: cannot read 'nought,nought'"):
        Table.read(written(tmp_path, "time,depth\n0,0\nnought,nought\n1,1\n"), "depth")


def test_a_table_that_is_not_there_or_not_text_is_named(tmp_path):
    with pytest.raises(TableError, match=r"missing\.csv: cannot be read"):
        Table.read(tmp_path / "missing.csv", "depth")
    (tmp_path / "path.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(TableError, match=r"path\.csv: cannot be read as text"):
        Table.read(tmp_path / "path.csv", "depth")
    with pytest.raises(TableError, match="cannot be read"):
        Table.read(tmp_path, "depth")


def test_what_spreadsheets_write_is_read(tmp_path):
    file = tmp_path / "path.csv"
    file.write_bytes("\ufefftime;depth\r\n0;0\r\n1;1e-2\r\n".encode())
    np.testing.assert_array_equal(read_columns(file, ("time", "depth")), [[0, 0], [1, 0.01]])
