"""What is prescribed over time, and the tables that it is read from."""

import math

import numpy as np
import pytest

from gfmdlayer.config import Config, ConfigError
from gfmdlayer.drives import Drives
from gfmdlayer.files.tables import TableError
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
        ("0,0\n", r"path\.csv:1: holds 1 row of numbers; must be at least 2"),
        ("", r"path\.csv:1: holds no rows of numbers"),
        ("0,0\n1,nan\n", r"path\.csv:2: depth is 'nan' in '1,nan'; must be a number"),
        ("0,0\ninf,1\n2,1\n", r"path\.csv:2: 'inf,1' is not a row of numbers"),
        ("0,0\n1,1e31\n", r"path\.csv:2: depth is too large; must be up to 1e\+30"),
        ("0,0\n1,deep\n2,1\n", r"path\.csv:2: '1,deep' is not a row of numbers like those above"),
        ("0,0\n1,2\n2\n", r"path\.csv:3: '2' is not a row of numbers like those above"),
        ("0,0\n1,2\n2,1,1\n", r"path\.csv:3: '2,1,1' holds 3 columns; must be 2, as above"),
        ("0,0,0\n1,1,1\n", r"path\.csv:1: holds 3 numbers; must be 2 numbers \(time, depth\)"),
        ("time,depth\n0,zero\n1,1\n2,2\n", r"path\.csv:2: '0,zero' is not a row of numbers like those below"),
        (
            "time,depth\n0,0\n1,1\nnought,nought\n2,2\n",
            "holds 2 tables, in lines 2 to 3, 5 to 5; give the number of one, reading: {table: 1} or ",
        ),
        ("time,deep\n0,0\n1,1\n", "no column is named depth; headings are 'time', 'deep'; names are depth"),
        ("then,deep\n0,0\n1,1\n", "no heading is known among 'then', 'deep'; known names are time: time"),
        (
            "time,depth,force\n0,0\n1,1\n",
            r"path\.csv:1: 'time,depth,force' names 3 columns; the rows below have 2",
        ),
        ("time,depth [s]\n0,0\n1,1\n", "'depth \\[s\\]' is in 's', which is no unit of depth"),
        (
            "time [s],depth [um]\n0,0\n1,1\n",
            "'time \\[s\\]' is in s, but the configuration has no units; add units",
        ),
        (
            "depth,displacement,time\n0,0,1\n1,1,2\n",
            "two columns are named depth, 'depth' and 'displacement'",
        ),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_by_its_line(text, said, tmp_path):
    with pytest.raises(TableError, match=said):
        Table.read(written(tmp_path, text), "depth")


def test_a_table_that_is_not_there_or_not_text_is_named(tmp_path):
    with pytest.raises(TableError, match=r"missing\.csv: cannot be read"):
        Table.read(tmp_path / "missing.csv", "depth")
    (tmp_path / "path.csv").write_bytes(b"\xff\xfe\x00\xd8")
    with pytest.raises(TableError, match=r"path\.csv: is not text"):
        Table.read(tmp_path / "path.csv", "depth")
    with pytest.raises(TableError, match="cannot be read"):
        Table.read(tmp_path, "depth")


def test_what_spreadsheets_write_is_read(tmp_path):
    file = tmp_path / "path.csv"
    file.write_bytes("\ufefftime;depth\r\n0;0\r\n1;1e-2\r\n".encode())
    np.testing.assert_array_equal(Table.read(file, "depth").values, [0, 0.01])


UNITS = {"length": "um", "stress": "MPa", "time": "s"}


def drives(tmp_path, text, **trajectory):
    """Return the drives of a case in um, MPa and s whose table is a text."""
    file = tmp_path / "path.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    keys = {"kind": "table", "file": str(file), **trajectory}
    return Drives(Config(name="x", units=UNITS, grid={"points": [64, 64]}, trajectory=keys))


@pytest.mark.parametrize(
    ("control", "text", "factor"),
    [
        ("depth", "time [ms],depth [nm]\n0,0\n1000,1\n", 1e-3),
        ("depth", "Zeit;Eindringtiefe\ns;nm\n0;0\n1;1,0\n2;1,0", 1e-3),
        ("depth", "depth_nm\ttime_ms\n0\t0\n1\t1000\n", 1e-3),
        ("depth", "Temps [s];Profondeur [mm]\n0;0\n1;1\n".encode("utf-16"), 1e3),
        ("depth", "Prüfzeit/min Weg/µm\n0 0\n0.0166666666666666666667 1\n".encode("cp1252"), 1.0),
        ("depth", "# t  d\n0 0\n1 1\n", 1.0),
        ("load", "load (kPa), time (s)\n0, 0\n1, 1\n", 1e-3),
        ("load", "time,p\ns,psi\n0,0\n1,1\n", 6894.757293168362e-6),
        # Over a cell of 1 um^2; a force of 1 uN is then 1 MPa.
        ("force", "time (s)|load (nN)\n0|0\n1|1\n", 1e-3),
        ("force", "F in uN;t in s\n0;0\n1;1\n", 1.0),
    ],
)
def test_a_history_is_converted_into_the_units_of_the_configuration(control, text, factor, tmp_path):
    assert drives(tmp_path, text, control=control).drive(1.0) == pytest.approx(factor, rel=1e-15)


def test_what_a_file_does_not_say_is_said_beside_it(tmp_path):
    text = "Zeit;Weg\n0,000;0,000\n1,000;1,234\n2,000;2,345\n".replace("0,000", "3,000", 2)
    with pytest.raises(TableError, match="may have decimal marks or marks of thousands"):
        _ = drives(tmp_path, text).drive
    text = "Zeit [s];Weg von links [x]\n0,0;0,0\n1,0;1,5\n"
    reading = {"columns": ["time", "depth [nm]"], "decimal": ","}
    assert drives(tmp_path, text, reading=reading).drive(1.0) == pytest.approx(1.5e-3, rel=1e-15)
    reading = {"columns": ["time", "depth [um]"]}
    with pytest.raises(TableError, match="columns: 'depth \\[um\\]', but the file says nm"):
        _ = drives(tmp_path, "Z;Weg von links\ns;nm\n0;0\n1;1\n", reading=reading).drive
    assert drives(tmp_path, "t;d\n0;0\n1;1\n", reading={"units": {"t": "ms", "d": "nm"}}).drive(1e-3) == 1e-3
    assert (
        drives(tmp_path, "time;depth\n0;0\n1;1\n", reading={"units": {"t": "ms", "d": "nm"}}).drive(1e-3)
        == 1e-3
    )
    assert drives(tmp_path, "0 0\n1 1\n", reading={"units": {"t": "ms", "depth": "nm"}}).drive(1e-3) == 1e-3
    two = "t d\n0 0\n1 1\n\nt d\n0 0\n1 2\n"
    assert drives(tmp_path, two, reading={"table": 2}).drive(1.0) == 2.0
    for wrong, said in [
        ({"units": {"depth": "s"}}, "depth: got the text 's'; is not a unit of it"),
        ({"units": {"deep": "nm"}}, "got the text 'deep'; must be the name of a quantity"),
        (
            {"columns": ["time", "deep"]},
            "reading.columns\\[1\\]: got the text 'deep'; is not the name of a quantity",
        ),
        ({"decimal": ";"}, "reading.decimal: got the text ';'; must be . or ,"),
        ({"table": 0}, "reading.table: got 0; must be a whole number >= 1"),
    ]:
        with pytest.raises(ConfigError, match=said):
            drives(tmp_path, two, reading=wrong)
    with pytest.raises(ConfigError, match="reading: only for a file"):
        Config(name="x", trajectory={"reading": {"table": 1}})


def test_how_a_table_was_read_is_said_in_one_line(tmp_path):
    text = "Sample A\n\nNr;Weg [nm];Zeit [ms]\n1;0,0;0\n2;1,5;10\n"
    (line,) = drives(tmp_path, text).accounts()
    assert line == (
        "path.csv: 2 rows, Weg: depth [nm] -> depth [um], Zeit: time [ms] -> time [s]; separator ';', "
        "decimal mark ','; 1 line above not read; not read: 'Nr' (not a known name)"
    )


def test_a_velocity_and_a_temperature_are_converted(tmp_path):
    (tmp_path / "v.csv").write_text("time [ms],velocity [mm/s]\n0,0\n1000,1\n")
    config = Config(name="x", units=UNITS, trajectory={"velocity_file": str(tmp_path / "v.csv")})
    assert Drives(config).velocity(1.0) == pytest.approx(1e3, rel=1e-15)
    (tmp_path / "T.csv").write_text("time [s],temperature [K]\n0,298.15\n9,303.15\n")
    config = Config(
        name="x", temperature={"file": str(tmp_path / "T.csv")}, units=UNITS,
        layer={"material": {"shift": {"law": "arrhenius", "activation_energy": 8e4, "reference": 25.0}}},
    )  # fmt: skip
    # Kelvins less 273.15: the last digit of 303.15 is 6e-14.
    assert Drives(config).temperature(9.0) == pytest.approx(30.0, abs=1.2e-13)


def test_columns_with_and_without_units_do_not_stand_beside_each_other(tmp_path):
    with pytest.raises(TableError, match="time has a unit, but depth has none; give both, or neither"):
        _ = drives(tmp_path, "time [s],depth\n0,0\n1,1\n").drive
    assert (
        drives(tmp_path, "time [s],depth\n0,0\n1,1\n", reading={"units": {"depth": "nm"}}).drive(1.0) == 1e-3
    )


def test_a_force_on_a_line_is_per_length(tmp_path):
    (tmp_path / "f.csv").write_text("time [s],force [N/m]\n0,0\n1,1\n")
    keys = {"kind": "table", "control": "force", "file": str(tmp_path / "f.csv")}
    # 1 N/m is 1 MPa um.
    config = Config(name="x", units=UNITS, trajectory=keys)
    assert Drives(config).drive(1.0) == pytest.approx(1.0, rel=1e-15)
    (tmp_path / "f.csv").write_text("time [s],force [N]\n0,0\n1,1\n")
    with pytest.raises(TableError, match="no column is named force per length; headings are"):
        _ = Drives(config).drive
