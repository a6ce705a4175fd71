"""Messages say what is wrong in the words of the configuration, with the remedy."""

import re
from typing import Any

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.body.bodies import place_of
from gfmdlayer.case.notes import notes
from gfmdlayer.cli import main
from gfmdlayer.config.sections import Inside
from gfmdlayer.files.tables import read_table
from gfmdlayer.friction.slip_speed import _why_not_settled
from gfmdlayer.interface.friction import SpeedTable
from gfmdlayer.validation.problems import shown

GIVEN: dict[str, Any] = {"name": "a", "grid": {"points": 64}, "time": {"end": 2.0, "step": 0.1}}


def refused(**keys):
    with pytest.raises(gfmdlayer.ConfigError) as error:
        gfmdlayer.Config(**GIVEN | keys)
    return str(error.value)


def test_an_object_in_place_of_a_value_is_named_by_its_type():
    assert shown(Inside(points=3)) == "an object of the type Inside"
    assert "thickness: got an object of the type object; must be a" in refused(layer={"thickness": object()})


def test_an_error_without_a_file_has_no_empty_place():
    assert place_of(ValueError("no such wave"), "") == "ValueError: no such wave"
    assert place_of(ValueError("no such wave"), "mine.py") == "mine.py: ValueError: no such wave"


def test_names_tell_which_letters_they_take():
    assert refused(name="näme") == (
        "name: got the text 'näme'; must be text of at most 128 letters, digits and . _ -, with letters "
        "from a to z or A to Z, not beginning with . or - (it names a folder)"
    )


@pytest.mark.parametrize(
    ("last", "said"), [("1.9999999999", []), ("1.9999999", ["1.9999999"]), ("1.5", ["1.5"])]
)
def test_a_table_ends_before_the_run_only_where_the_numbers_say_so(last, said, tmp_path):
    (tmp_path / "depth.txt").write_text(f"0 0\n{last} 0.01\n")
    trajectory = {"kind": "table", "file": str(tmp_path / "depth.txt")}
    found = [note for note in notes([gfmdlayer.Config(**GIVEN, trajectory=trajectory)]) if "ends at" in note]
    assert [re.search(r"ends at time (\S+), before time.end = 2;", note)[1] for note in found] == said


@pytest.mark.parametrize(
    "lines",
    ['"0" "0.5"\n"1" "1.5"\n', 'time,depth\n"0","0,5"\n"1","1,5"\n', '"time","depth"\n0,0.5\n1,1.5\n'],
)
def test_quotes_around_numbers_and_names_are_no_part_of_them(lines, tmp_path):
    path = tmp_path / "quoted.csv"
    path.write_text(lines)
    table = read_table(path, ("time", "depth"))
    np.testing.assert_array_equal([table.take("time"), table.take("depth")], [[0, 1], [0.5, 1.5]])


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_leak_of_a_line_has_no_picture_to_write(tmp_path, capsys):
    gfmdlayer.run(GIVEN | {"output": {"snapshots": [1.0]}}, out=tmp_path / "line")
    picture = tmp_path / "leak.png"
    assert main(["leak", str(tmp_path / "line"), "--out", str(picture)]) == 2
    assert "--out: the flow along a line has no map to draw" in capsys.readouterr().err
    assert not picture.exists()
    assert main(["leak", str(tmp_path / "line")]) == 0
    assert "flow_yy" in capsys.readouterr().out


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_interfaces_are_swept_without_one_of_the_configuration():
    laws = [{"law": "hard_wall"}, {"law": "exponential", "work": 1e-4, "range": 0.01}]
    data = gfmdlayer.run(GIVEN, sweep={"interface": laws})
    alone = gfmdlayer.run(GIVEN, interface=laws[1])
    np.testing.assert_array_equal(data["mean_stress"].isel(interface=1), alone["mean_stress"])
    assert "did you mean 'interface'?" in refused(sweep={"interface.work": [1e-4]})


@pytest.mark.parametrize(
    ("values", "said"),
    [([0.1, 0.2, 0.6], "it rises 8 times as fast"), ([0.6, 0.2, 0.1], "it falls 8 times faster")],
)
def test_a_coefficient_that_does_not_settle_is_told_its_steepness(values, said):
    table = SpeedTable(np.array([0.0, 0.05, 0.1]), np.array(values))
    message = _why_not_settled(table, 1.0, 0.5)
    assert said in message
    assert ("fixed steps of 0.4 or more" in message) if "rises" in said else ("longer steps" in message)


def test_a_bare_halfspace_has_no_relaxation_to_warn_of():
    """The layer of no thickness keeps its material, which takes no part."""
    one_step = {**GIVEN, "time": {"end": 1.0, "step": 1.0}}
    bare, under = ({"layer": {"thickness": each}} for each in (0.0, 0.1))
    assert notes([gfmdlayer.Config(**one_step, **bare)]) == []
    assert "relaxation time" in " ".join(notes([gfmdlayer.Config(**one_step, **under)]))
    material = {"model": "zener", "G0": 1.0, "Ginf": 10.0, "tau": 1.0}
    relaxing = {"layer": {"thickness": 0.0}, "halfspace": {"poisson": 0.5, "material": material}}
    assert "relaxation time" in " ".join(notes([gfmdlayer.Config(**one_step, **relaxing)]))


def test_time_with_friction_is_not_estimated_before_a_case_is_complete(tmp_path, capsys):
    path = tmp_path / "f.yaml"
    path.write_text(
        "name: f\ngrid: {points: 64}\ntime: {end: 1.0, step: 0.5}\n"
        "interface: {law: coulomb, coefficient: 0.3}\n"
        "trajectory: {tangential: {displacement: 0.001}}\n"
    )
    assert main(["check", str(path), "--out", str(tmp_path / "results")]) == 0
    out = capsys.readouterr().out
    assert "time       not known before a case with friction is complete" in out
    assert re.search(r"^steps +2$", out, re.MULTILINE)
    assert main(["check", str(path), "--out", str(tmp_path / "results"), "--set", "time.step=adaptive"]) == 0
    assert re.search(r"^steps +about \d+$", capsys.readouterr().out, re.MULTILINE)
