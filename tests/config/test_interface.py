"""The key `interface`: what it takes and refuses, its digest, and the solver that goes with it."""

import re

import pytest

from gfmdlayer.config import Config, ConfigError, digest, load
from gfmdlayer.config.model import stem
from gfmdlayer.contact.solvers import SOLVERS
from gfmdlayer.interface.adhesion import Electrostatic, Exponential
from gfmdlayer.study.cases import cases, input_errors
from gfmdlayer.validation.units import Units

LAW = {"law": "exponential", "work": 1e-3, "range": 4e-3}
VOLTAGE = {"law": "electrostatic", "voltage": 100.0, "insulation": 1e-6}
VACUUM = {"permittivity": 1.0}
HARD = {"law": "hard_wall", "hardness": 0.5}
AXISYMMETRIC = {"grid": {"geometry": "axisymmetric"}}


def test_the_hard_wall_is_the_default_and_has_its_digest():
    plain, named = Config(name="a"), Config(name="a", interface={"law": "hard_wall"})
    assert digest(plain) == digest(named)
    assert stem(plain) == stem(named)
    assert plain.interfaces == named.interfaces == ()
    assert "interface" not in plain.dump()
    adhesive = Config(name="a", interface=LAW)
    assert len({digest(plain), digest(adhesive), digest(adhesive.with_values({"interface.work": 2.0}))}) == 3
    assert stem(adhesive) != stem(plain)


def test_a_law_is_a_section_and_a_python_object():
    assert Config(name="a", interface=Exponential(work=1e-3, range=4e-3)).interfaces == (Exponential(**LAW),)
    both = Config(name="a", interface=[Exponential(work=1, range=1), LAW, {"law": "hard_wall"}])
    assert [law.work for law in both.interfaces] == [1, 1e-3]


@pytest.mark.parametrize(
    ("interface", "message"),
    [
        ({"law": "har_wall"}, "interface.law: got the text 'har_wall'; must be one of"),
        ({"law": "exponential", "work": -1, "range": 1}, "interface.work: got -1; must be a number > 0"),
        ({"law": "dugdale", "work": 1}, "interface.stress: missing; must be a number > 0"),
        ([LAW, {"law": "dugdale", "work": 1, "stress": 1, "smoothing": 0}], "interface[1].smoothing: got 0;"),
        ([LAW, LAW | {"wrk": 1}], "interface[1].wrk: unknown key; allowed: law, work, range"),
        ({"work": 1, "range": 1, "stress": 3.0}, "interface.stress: unknown key; allowed: law, work, range"),
        ([], "interface: got an empty list; must have at least one"),
        (3, "interface: got 3; must be a mapping"),
        (VOLTAGE, "interface.permittivity: missing; must be given in units of pressure length^2/V^2"),
        (VOLTAGE | VACUUM | {"insulation": 0}, "interface.insulation: got 0; must be a number > 0"),
        (VOLTAGE | VACUUM | {"insulation": []}, "interface.insulation: got an empty list"),
        (VOLTAGE | VACUUM | {"insulation": [{"thickness": 1, "permittivity": 0.5}]},
         "interface.insulation[0].permittivity: got 0.5; must be a number >= 1, finite: relative"),
        (VOLTAGE | VACUUM | {"voltage": "none.txt"}, "none.txt does not exist"),
    ],
)  # fmt: skip
def test_impossible_laws_are_refused(interface, message):
    with pytest.raises(ConfigError) as caught:
        Config(name="a", interface=interface)
    (found,) = caught.value.problems  # a key of another law is not taken for one of another section
    assert message in found


@pytest.mark.parametrize(
    ("units", "permittivity"),
    [
        (("m", "Pa"), 8.8541878128e-12),
        (("mm", "MPa"), 8.8541878128e-12),
        (("um", "kPa"), 8.8541878128e-3),
        # A pound of force is 4.4482216152605 N.
        (("in", "psi"), 8.8541878128e-12 / 4.4482216152605),
    ],
)
def test_the_permittivity_of_vacuum_follows_from_units(units, permittivity):
    # eps0 V^2/d^2 is a stress: 1 Pa m^2 = 1e12 Pa um^2 = 1e9 kPa um^2; psi in^2 is a pound of force.
    given = {"length": units[0], "stress": units[1], "time": "s"}
    law = Config(name="a", units=given, interface=VOLTAGE).interfaces[0]
    assert isinstance(law, Electrostatic)
    assert law.permittivity_of_vacuum(Units(**given)) == pytest.approx(permittivity, rel=1e-15)
    with pytest.raises(ConfigError, match=r"interface.permittivity: missing"):
        Config(name="a", interface=VOLTAGE)


def test_the_solver_is_one_for_attraction_unless_another_is_named():
    chosen = Config(name="a", interface=LAW)
    assert SOLVERS[chosen.contact_solver.method].adhesive
    assert not SOLVERS[Config(name="a").contact_solver.method].adhesive
    # The configuration that is stored with the results is the same.
    assert Config(**Config(name="a", interface=LAW).model_dump(exclude_none=True)) == chosen
    for method, declared in SOLVERS.items():
        if declared.adhesive:
            assert Config(name="a", interface=LAW, solver={"method": method}).solver.method == method
        else:
            with pytest.raises(
                ConfigError, match=r"solver.method: .*cannot solve for attraction; must be fire or newton"
            ):
                Config(name="a", interface=LAW, solver={"method": method})
    sticky = {"name": "a", "interface": [LAW, {"law": "coulomb", "coefficient": 0.4}]}
    for method in SOLVERS:  # with friction no word is right, so that none is named
        with pytest.raises(ConfigError) as refused:
            Config(**sticky | {"solver": {"method": method}})
        assert str(refused.value).count("must be") == 1, refused.value
    swept = Config(name="a", interface=LAW, sweep={"interface": [LAW, {"law": "hard_wall"}]})
    assert [case.config.contact_solver.method for case in cases(swept)] == ["newton", "active_set"]


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        (AXISYMMETRIC | {"interface": LAW},
         "interface.law: got 'exponential'; an attraction over a range is not available with grid.geometry"),
        (AXISYMMETRIC,
         "interface: its hardness is not available with grid.geometry: axisymmetric; remove it, or take"),
        ({"interface": HARD | {"hardness": 0}}, "interface.hardness: got 0; must be a number > 0"),
        ({"trajectory": {"control": "load", "load": 0.5}},
         "trajectory.load: got 0.5; must be below 0.5, the interface.hardness over the whole cell"),
        ({"trajectory": {"control": "force", "force": 1.5}, "grid": {"points": 64, "period": 2.0}},
         "trajectory.force: got 1.5; must be below 1, the interface.hardness over the whole cell"),
        ({"solver": {"method": "newton"}},
         "solver.method: got newton, which is slow for a hardness; must be nested_gradient"),
        ({"interface": [LAW, HARD], "solver": {"method": "fire"}},
         "solver.method: got fire, which cannot solve for a hardness; must be newton"),
        ({"solver": {"method": "active_set"}},
         "solver.method: got active_set, which cannot solve for a hardness; must be nested_gradient"),
    ],
)  # fmt: skip
def test_a_law_or_hardness_that_cannot_be_is_refused(sections, said):
    with pytest.raises(ConfigError) as refused:
        Config(name="a", **({"interface": HARD} | sections))
    (line,) = refused.value.problems
    assert line.startswith(said)


def test_a_hardness_has_a_digest_and_the_solver_that_can():
    soft, plain = Config(name="a", interface=HARD), Config(name="a")
    assert len({digest(plain), digest(soft), digest(soft.with_values({"interface.hardness": 0.4}))}) == 3
    assert soft.contact_solver.method == "nested_gradient"
    assert soft.hardness == 0.5
    assert plain.hardness is None


EXPONENTIAL = "{law: exponential, work: 0.02, range: 0.01}, "  # its traction in contact is 2


@pytest.mark.parametrize(
    ("law", "hardness", "loads", "said"),
    [
        ("", 0.5, "kind: table, file: load.txt",
         "case.yaml:4:.*holds the load 0.6; must be below 0.5, the hardness"),
        (EXPONENTIAL, 1.5, "load: 1.0",
         "interface: got the hardness 1.5, which the attraction in contact exceeds; must be above 2"),
        (EXPONENTIAL, 3.0, "load: 1.0",
         "trajectory.load: got 1; must be below 1, the hardness over the whole cell, less the attr"),
        (EXPONENTIAL, 3.0, "load: 0.9", ""),
    ],
)  # fmt: skip
def test_a_hardness_has_to_bear_the_attraction_and_the_load(tmp_path, law, hardness, loads, said):
    (tmp_path / "load.txt").write_text("0 0\n1 0.6\n")
    given = tmp_path / "case.yaml"
    given.write_text(
        f"name: a\ngrid: {{points: 64}}\ninterface: [{law}{{law: hard_wall, hardness: {hardness}}}]\n"
        f"trajectory: {{control: load, {loads}}}\n"
    )
    if not said:
        assert load(given, inspect=input_errors).contact_solver.method == "newton"
        return
    with pytest.raises(ConfigError) as refused:
        load(given, inspect=input_errors)
    (line,) = refused.value.problems
    assert re.search(said, line)


def test_files_of_voltages_are_found_in_lists_and_sweeps(tmp_path):
    (tmp_path / "volts.txt").write_text("0 0\n1 10\n")
    (tmp_path / "case.yaml").write_text(
        "name: a\ngrid: {points: 64}\ninterface:\n"
        "  - {work: 1.0, range: 1.0}\n"
        "  - {law: electrostatic, voltage: volts.txt, permittivity: 1.0, insulation: 1}\n"
        "sweep: {interface.1.voltage: [5, volts.txt]}\n"
    )
    config = load(tmp_path / "case.yaml")
    named = [case.config.interfaces[1].voltage for case in cases(config)]
    assert named == [5.0, tmp_path / "volts.txt"]
    before = digest(cases(config)[1].config)
    (tmp_path / "volts.txt").write_text("0 0\n1 11\n")
    assert digest(cases(config)[1].config) != before


def test_of_several_files_the_one_that_cannot_be_used_is_named_where_it_is_given(tmp_path):
    (tmp_path / "good.txt").write_text("0 1\n1 2\n")
    (tmp_path / "bad.txt").write_text("0 1\n2 3\n1 4\n")
    law = "  - {{law: electrostatic, voltage: {}.txt, insulation: 0.1, permittivity: 1.0}}\n"
    given = tmp_path / "case.yaml"
    given.write_text("name: a\ninterface:\n" + law.format("good") + law.format("bad"))
    with pytest.raises(ConfigError) as refused:
        load(given, inspect=input_errors)
    (said,) = refused.value.problems
    assert said.startswith(f"{given}:4:35: interface[1].voltage: {tmp_path / 'bad.txt'}:3: time = 1 after 2")
