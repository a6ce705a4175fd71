"""Configurations that are accepted, and the messages for all others."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gfmdlayer.body.materials import Prony, Zener
from gfmdlayer.config import Config, ConfigError, digest, load
from gfmdlayer.study.cases import input_errors
from gfmdlayer.validation import text
from gfmdlayer.validation.units import Units
from tests.config.reading import problems, read

CONFIGS = Path(__file__).parents[2] / "configs"


# Rejected configurations: the text after "name: x", then place and key, then further words of the message.
REJECTED = {
    "tab behind a colon": ("layer:\n  thickness:\t1", "3:13: not YAML: a tab", "use spaces"),
    "tab": ("grid:\n\tpoints: 8", "3:1: not YAML: a tab", "use spaces"),
    "control character": ("grid: \x01", "2:7: not YAML: the character", "not allowed"),
    "huge number": (
        f"grid: {{period: {'9' * 400}}}",
        "2:16: grid.period: got a number of many digits",
        "finite",
    ),
    "number beyond reading": (f"grid: {{points: {'9' * 5000}}}", "2:16: grid.points: '9999", "as a number"),
}
for block in Path(__file__).with_name("rejected.txt").read_text("utf-8").split("## ")[1:]:
    content, *words = block.strip().split("\n=> ")
    title, _, content = content.partition("\n")
    REJECTED[title] = (content, *words)


@pytest.mark.parametrize(
    "content",
    [
        "punch: {shape: wegde, slope: 1, radius: 2}",
        "layer: {material: {model: pronny, G0: 1, branches: []}}",
        "punch: {shape: array, counts: 4, element: {shape: spher, slope: 3}}",
        "punch: {shape: pyramd, angle: 80}",
        "grid: {geometry: axisymmetric}\npunch: {shape: pyramd, angle: 80}",
    ],
)
def test_a_misspelt_kind_is_one_error_without_the_keys_of_another(tmp_path, content):
    (found,) = problems(tmp_path, f"name: x\n{content}\n")
    assert "did you mean" in found


@pytest.mark.parametrize(
    ("content", "key"),
    [
        (
            "grid: {geometry: axisymmetric}\noutput: {leakage: {every: 2}}\n"
            "sweep: {output.leakage.every: [2, 3]}",
            "output.leakage: got",
        ),
        (
            "trajectory: {tangential: {displacement: 0.01}}\n"
            "sweep: {zip: {trajectory.tangential.displacement: [0.1, 0.2], punch.radius: [1, 2]}}",
            "trajectory.tangential: needs friction",
        ),
    ],
)
def test_swept_keys_of_a_refused_section_are_no_further_errors(tmp_path, content, key):
    (found,) = problems(tmp_path, f"name: x\n{content}\n")
    assert key in found


@pytest.mark.parametrize(
    ("sweep", "meant"),
    [
        ("thicknes: [1]", "'layer.thickness'"),
        ("zip: {laier.poisson: [1]}", "'layer.poisson'"),
        ("layer.poisson: {a: [1], b: [2]}", None),
    ],
)
def test_a_sweep_is_rejected_with_the_nearest_keys_only(tmp_path, sweep, meant):
    (found,) = problems(tmp_path, f"name: x\nsweep: {{{sweep}}}\n")
    if meant is None:  # a dotted key is suggested once
        assert found.count("layer.poisson") == 1
    else:
        assert found.endswith(f"others (all: gfmdlayer schema); did you mean {meant}?")
        assert len(found) < 250


def test_tabs_within_braces_and_texts_are_spaces(tmp_path):
    config = read(tmp_path, "name: x\nlayer: {\n\tthickness: 0.5}\n")
    assert config.layer.thickness == 0.5


@pytest.mark.parametrize(
    ("content", "begins", "holds"), [(v[0], v[1], v[2:]) for v in REJECTED.values()], ids=REJECTED
)
def test_an_error_names_place_key_and_allowed_values(tmp_path, content, begins, holds):
    found = problems(tmp_path, "name: x\n" + content)
    assert len(found) == 1, found
    assert found[0].startswith("case.yaml:")
    assert begins in found[0]
    for words in holds:
        assert words in found[0]


@pytest.mark.parametrize(
    "name",
    ["3", "a/b", "''", "..", ".hidden", "-x", "null", "[a]", "'a b'", "é", "x" * 129, "true", '"a\\n"'],
)
def test_a_name_that_is_no_folder_name_is_rejected(tmp_path, name):
    (problem,) = problems(tmp_path, f"name: {name}")
    assert problem.startswith("case.yaml:1:7: name: got ")
    assert "letters, digits and . _ -" in problem


def test_a_missing_name_is_an_error(tmp_path):
    (problem,) = problems(tmp_path, "grid: {points: 64}")
    assert problem.startswith("case.yaml:1:1: name: missing; must be text of at most 128 letters")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "1:1: is empty; must be a mapping"),
        (b"# only a comment\n", "1:1: is empty; must be a mapping"),
        (b"- 1\n- 2\n", "1:1: has no keys; must be a mapping"),
        (b"figure2\n", "1:1: has no keys; must be a mapping"),
        (b"name: x\n# caf\xe9\n", "2:6: the byte 0xe9 is not UTF-8; must be a text file in UTF-8"),
        (b"[" * 5000, "1:1001: nested too deeply"),
    ],
)
def test_a_file_without_a_configuration_is_rejected(tmp_path, content, message):
    path = tmp_path / "case.yaml"
    path.write_bytes(content)
    (problem,) = problems(path)
    assert problem.startswith(f"case.yaml:{message}")


def test_an_unreadable_file_is_rejected(tmp_path):
    assert "cannot be read (No such file or directory)" in problems(tmp_path / "nowhere.yaml")[0]
    assert "cannot be read (Is a directory); must be the name of a YAML file" in problems(tmp_path)[0]


def test_all_errors_are_reported_together_in_the_order_of_the_file(tmp_path):
    content = """\
name: a/b
layer: {thicknes: 1, material: {G0: 5, Ginf: 2}}
time: {end: 4, step: true}
output: {snapshots: [1, 9]}
sweep: {halfspace.poisson: [0.9, 0.5, x], layer.ticknes: [1]}
"""
    found = problems(tmp_path, content)
    keys = [problem.split(" ")[0] + problem.split(" ")[1] for problem in found]
    assert keys == [
        "case.yaml:1:7:name:",
        "case.yaml:2:9:layer.thicknes:",
        "case.yaml:2:46:layer.material.Ginf:",
        "case.yaml:3:22:time.step:",
        "case.yaml:4:25:output.snapshots[1]:",
        "case.yaml:5:29:sweep.halfspace.poisson[0]:",
        "case.yaml:5:39:sweep.halfspace.poisson[2]:",
        "case.yaml:5:43:sweep.layer.ticknes:",
    ]


def test_a_refused_value_of_a_required_key_hides_no_error_elsewhere(tmp_path):
    content = "name: x\npunch: {shape: wedge, slope: steep}\noutput: {snapshots: [9]}"
    found = problems(tmp_path, content)
    assert [problem.split(" ")[1] for problem in found] == ["punch.slope:", "output.snapshots[0]:"]


def test_a_rejected_value_causes_no_further_errors(tmp_path):
    content = "name: x\ntime: {end: ten}\noutput: {snapshots: [9]}"
    (problem,) = problems(tmp_path, content)
    assert problem.startswith("case.yaml:2:13: time.end:")


def test_a_wrong_key_of_a_sweep_hides_no_error_of_its_other_keys_and_of_the_sections(tmp_path):
    content = """\
name: a/b
halfspace: {material: {G0: 1}, shear_modulus: 1}
trajectory: {control: load}
sweep: {layer.ticknes: [1], trajectory.load: 3, layer.poisson: [0.3, 0.6]}
"""
    found = problems(tmp_path, content)  # a load is missing only for want of a list in the sweep
    assert [problem.split(" ")[0] for problem in found] == [
        "case.yaml:1:7:",
        "case.yaml:2:47:",
        "case.yaml:4:9:",
        "case.yaml:4:46:",
        "case.yaml:4:70:",
    ]


def test_more_than_a_million_cases_are_rejected(tmp_path):
    values = [0.1 + i / 1000 for i in range(101)]
    keys = ("layer.thickness", "halfspace.shear_modulus", "time.end")
    content = "name: x\nsweep: {" + ", ".join(f"{key}: {values}" for key in keys) + "}"
    (problem,) = problems(tmp_path, content)
    assert problem.startswith("case.yaml:2:8: sweep: got a product of 1030301 cases; must be at most 1000000")


# --- valid configurations ---


def test_defaults_are_the_papers_values_on_fewer_points_in_adaptive_steps():
    config = Config(name="paper")
    assert config.grid.points == (2**10,)
    assert config.grid.period == (1.0,)
    assert (config.layer.thickness, config.layer.poisson) == (0.05, 0.5)
    assert config.layer.material == Zener(G0=1.0, Ginf=10.0, tau=1.0)
    assert (config.halfspace.shear_modulus, config.halfspace.poisson) == (1.0, 0.5)
    assert config.punch.shape == "parabola"
    assert config.punch.radius == 0.25
    given = config.trajectory
    assert (given.control, given.kind, given.depth, given.ramp_time) == ("depth", "ramp_hold", 0.01, 1.0)
    assert (given.load, given.file) == (None, None)
    assert (config.time.end, config.time.step, config.time.integrator) == (8.0, "adaptive", "exponential")
    assert config.time.tolerance == 1e-4
    assert Config(name="paper", time={"step": 0.005}).time.tolerance is None
    assert (config.solver.method, config.solver.tolerance) == ("auto", 1e-6)
    assert (config.solver.inertia, config.solver.max_iterations) == (None, 20000)
    assert config.output.snapshots == ()
    assert config.output.times is None
    assert config.output.patches is False
    assert (config.output.histograms.pressure, config.output.histograms.gap) == (None, None)
    assert config.sweep == {}


FIGURES = {
    "indentation": ({}, 10.0, 1.0),
    "figure2": ({"layer.thickness": [0, 1 / 32, 1 / 16, 1 / 8, 1 / 4, math.inf]}, 10.0, 10.0),
    "figure3": ({"halfspace.shear_modulus": [4, 16, 64, 256, math.inf]}, 10.0, 4.0),
    "figure4": ({"layer.material.Ginf": [2, 3, 5, 9, 17]}, 2.0, 1.0),
}


@pytest.mark.parametrize("quick", [False, True])
@pytest.mark.parametrize("name", FIGURES)
def test_shipped_configurations_contain_the_papers_cases(name, quick):
    sweep, Ginf, bulk = FIGURES[name]
    config = load(CONFIGS / f"{name}{'-quick' if quick else ''}.yaml")
    quick_step = 0.025 if name in {"figure2", "figure3"} else 0.05  # at which the balance closes to .01
    expected = Config(name=config.name).with_values({
        "layer.material.Ginf": Ginf, "halfspace.shear_modulus": bulk, "grid.points": 1024 if quick else 2**14,
        "time.step": quick_step if quick else 0.005,
        "time.integrator": "backward_euler", "solver.method": "fire",
        "output.snapshots": [] if name == "indentation" else [0.5, 1.0, 2.0, 8.0],
    })  # fmt: skip
    assert config.name == name + ("-quick" if quick else "")
    assert config.sweep == sweep
    assert config.with_values({}) == expected


def test_the_rolling_cylinder_moves_in_each_case():
    cases = load(CONFIGS / "cylinder-rolling.yaml")
    assert min(cases.sweep["trajectory.velocity"]) > 0
    assert cases.time.steady is not None


def test_a_punch_at_rest_has_no_velocity_in_its_digest():
    config = Config(name="x")
    assert "velocity" not in config.dump()
    assert digest(config.with_values({"trajectory.velocity": 0.0})) != digest(config)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0 1\n1 fast\n", r"v\.txt:2: '1 fast' is not a row of numbers like those above"),
        ("1 1\n2 1\n", r"v\.txt: the first time is 1; must be 0"),
        ("0 1\n1 0\n", r"v\.txt: ends at rest; .* remove time\.steady"),
    ],
)
def test_an_unusable_table_of_velocities_is_rejected(tmp_path, rows, message):
    (tmp_path / "v.txt").write_text(rows)
    (tmp_path / "case.yaml").write_text(
        "name: x\ntrajectory: {velocity_file: v.txt}\ntime: {steady: 1.0e-3}", encoding="utf-8"
    )
    with pytest.raises(ConfigError, match=rf"trajectory\.velocity_file: .*{message}"):
        load(tmp_path / "case.yaml", (), input_errors)


@pytest.mark.parametrize(
    ("period", "found"), [("", (1.0, 1.0)), (", period: 2", (2.0, 2.0)), (", period: [2, 1]", (2.0, 1.0))]
)
def test_two_directions_share_one_period_or_have_two(tmp_path, period, found):
    assert read(tmp_path, f"name: x\ngrid: {{points: [64, 32]{period}}}").grid.period == found


def test_yaml_is_read_as_version_1_2(tmp_path):
    content = "name: 2024-01-02\nlayer: {thickness: 1e-3}\nhalfspace: {shear_modulus: 1_0}"
    config = read(tmp_path, content)
    assert config.name == "2024-01-02"
    assert config.layer.thickness == 1e-3


def test_files_are_relative_to_the_configurations_folder(tmp_path, monkeypatch):
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "heights.txt").write_text("0 0\n")
    read(folder, "name: x\npunch: {shape: profile, file: heights.txt}")
    monkeypatch.chdir(tmp_path)
    punch = load("in/case.yaml").punch
    assert (punch.shape, punch.file) == ("profile", folder / "heights.txt")


def test_a_sweep_is_valid_when_its_cases_are(tmp_path):
    # None of these is possible with the configuration's own value of the other keys.
    swept = "{trajectory.load: [0.1, 0.2], layer.material.G0: [15, 20], layer.material.Ginf: [30, 40]}"
    config = read(tmp_path, f"name: x\ntrajectory: {{control: load}}\nsweep: {swept}\n")
    case = config.with_values({"trajectory.load": 0.2, "layer.material.G0": 20, "layer.material.Ginf": 30})
    assert case.trajectory.load == 0.2
    assert case.sweep == {}


# --- overrides ---


def test_overrides_replace_and_add(tmp_path):
    content = "name: x\ngrid: {points: 64}\nsweep: {layer.thickness: [1, 2]}"
    given = "grid.points=[32, 16]", "layer.material.tau=2", "sweep.layer.thickness=[0, .inf]"
    config = read(tmp_path, content, *given, "punch={radius: 3}")
    assert config.grid.points == (32, 16)
    assert config.layer.material == Zener(tau=2.0)
    assert config.sweep == {"layer.thickness": [0, math.inf]}
    assert config.punch.shape == "parabola"
    assert config.punch.radius == 3.0
    assert read(tmp_path, content, "grid.points=32", "grid.points=16").grid.points == (16,)


@pytest.mark.parametrize(
    ("override", "begins"),
    [
        ("grid.points", "--set: got 'grid.points'; must be dotted.key=value"),
        ("=3", "--set: got '=3'; must be dotted.key=value"),
        ("grid..points=3", "--set: got 'grid..points=3'; must be dotted.key=value"),
        ("grid.points=", "--set: grid.points: got nothing (null); must be a whole number"),
        ("grid.points=4", "--set: grid.points: got 4; must be a whole number >= 8"),
        ("grid.point=4", "--set: grid.point: unknown key; allowed: geometry, points, period, boundary, "
         "datum, extent; did you mean 'points'?"),
        ("grid.points.x=4", "--set: grid.points.x: grid.points is not a mapping"),
        ("grid.points=[4", "--set: grid.points: not YAML:"),
        ("time.end=1", "case.yaml:3:22: output.snapshots[0]: got 2.0, past the end"),
        ("sweep.layer.thickness=[1, -1]", "--set: sweep.layer.thickness[1]: got -1; must be a number >= 0"),
        ("sweep.layer.thicknes=[1]", "--set: sweep.layer.thicknes: unknown key"),
        ("sweep=", "--set: sweep: got nothing (null)"),
        ("name=a/b", "--set: name: got the text 'a/b'"),
    ],
)  # fmt: skip
def test_errors_of_overrides_name_the_option(tmp_path, override, begins):
    (problem,) = problems(tmp_path, "name: x\ngrid: {points: 64}\noutput: {snapshots: [2]}", override)
    assert problem.startswith(begins)


# --- round trip, cases, digest ---


@given(number=st.floats(1e-30, 1e30))
def test_numbers_are_dumped_to_the_last_digit(number):
    config = Config(name="x").with_values({"layer.thickness": number})
    assert load("", content=config.dump()).layer.thickness == number


def test_dump_writes_out_every_default_readably():
    text = Config(name="x", sweep={"layer.thickness": [0, math.inf]}).dump()
    assert "material:\n    model: zener\n    G0: 1.0\n" in text
    assert "  points: 1024\n" in text
    assert "  layer.thickness: [0, .inf]\n" in text
    assert "method: auto\n" in text


def test_a_case_has_its_values_and_no_sweep():
    config = Config(name="x", sweep={"solver.method": ["fire", "active_set"]})
    law = {"model": "prony", "branches": [{"G": 1, "tau": 2}]}
    case = config.with_values({"solver.method": "active_set", "layer.material": law})
    assert case.solver.inertia is None  # a default follows the method of the case
    assert isinstance(case.layer.material, Prony)
    assert case.sweep == {}
    with pytest.raises(ConfigError, match=r"^layer\.poisson: got 2; must be a number > -1 and <= 0\.5$"):
        config.with_values({"layer.poisson": 2})
    with pytest.raises(ConfigError, match=r"^layer\.x: unknown key"):
        config.with_values({"layer.x": 2})


def test_a_case_ends_with_its_own_trajectory():
    path = {"kind": "approach_retract", "depth": 0.1, "approach_speed": 0.1}
    config = Config(name="x", trajectory=path, time={"step": "adaptive"})
    assert config.time.end == 2.0
    assert config.with_values({"trajectory.approach_speed": 0.05}).time.end == 4.0  # retract_speed follows
    assert config.with_values({"trajectory": {"depth": 0.1}}).time.end == 8.0
    assert config.with_values({"time.end": 1.0, "trajectory.depth": 0.2}).time.end == 1.0


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("grid.points", 64),
        ("grid.period", 2),
        ("layer.thickness", math.inf),
        ("layer.material.tau", 2),
        ("halfspace.poisson", 0.3),
        ("punch.radius", 0.3),
        ("trajectory.depth", 0.02),
        ("time.step", 0.01),
        ("solver.tolerance", 1e-5),
        ("trajectory.velocity", 0.5),
        ("output.snapshots", [1.0]),
        ("output.histograms.gap.max", 0.1),
    ],
)
def test_the_digest_changes_with_every_input_of_the_results(key, value):
    config = Config(name="x")
    assert digest(config.with_values({key: value})) != digest(config)


def test_digest_does_not_depend_on_name_sweep_or_how_values_are_written():
    config = Config(name="x")
    assert digest(Config(name="y", sweep={"layer.thickness": [1]})) == digest(config)
    assert digest(config.with_values({"grid.period": [1], "layer.thickness": 0.05})) == digest(config)


def test_the_digest_depends_on_the_contents_of_files_not_on_their_paths(tmp_path):
    files = [tmp_path / "a.txt", tmp_path / "b.txt"]
    for file in files:
        file.write_text("0 1\n")
    configs = [Config(name="x", punch={"shape": "profile", "file": str(file)}) for file in files]
    assert digest(configs[0]) == digest(configs[1])
    files[1].write_text("0 2\n")
    assert digest(configs[0]) != digest(configs[1])


def test_a_configuration_cannot_be_changed():
    with pytest.raises(ValueError, match="frozen"):
        Config(name="x").layer.thickness = 1.0


ROUGH = {"shape": "self_affine", "hurst": 0.8, "short_cutoff": 0.1, "rms_slope": 0.1, "seed": 1}


@pytest.mark.parametrize(
    ("values", "method"),
    [
        ({}, "active_set"),
        ({"grid.points": [64, 64]}, "active_set"),
        ({"punch": ROUGH}, "active_set"),
        ({"punch": ROUGH, "grid.points": [64, 64]}, "nested_gradient"),
        ({"interface": {"law": "exponential", "work": 1e-3, "range": 1e-2}}, "newton"),
    ],
)
def test_the_digest_contains_the_solver_that_auto_chooses(values, method):
    """Results of the active set, the former default, keep their digest."""
    config = Config(name="x").with_values(values)
    assert config.contact_solver.method == method
    assert digest(config) == digest(config.with_values({"solver.method": method}))


LONG = ", ".join(f"{1 + 0.01 * i:.6g}" for i in range(600))  # more than are left to the parser of YAML


@pytest.mark.parametrize(
    "content",
    [
        f"a: [{LONG}]\nb: 1\n",
        f"a: {{c: [{LONG}], d: [1, {LONG}, -2e-3, +5, 1., 007]}}\n",
        f"a: [[{LONG}], [{LONG},\n {LONG}], 3]  # and so on\n",
        "a:\n" + "".join(f"  - {i}\n" for i in range(600)) + "b: 1\n",
        "a:\n- " + LONG.replace(", ", "\n- ") + "\nb: [x]\n",
        "a: x\n" + "".join(f"  - {i}\n" for i in range(600)),  # one long text
        "a:\n  - 1\n" + "".join(f"    - {i}\n" for i in range(600)) + "  - 2\n",
        f"a: '[{LONG}]'\n",
        f"a: |\n  x: [{LONG}]\n",
        f"a: 1  # [{LONG}]\n",
        f"a: [{LONG},]\nb: [{LONG}, , 1]\n",
        f"a: [{LONG}] 3\n",
        f"a: [{LONG}, 1e999]\nb: !!seq [{LONG}]\nc: &x [{LONG}]\n",
        f"[{LONG}]: 1\n",
        f"? [{LONG}]\n: 1\n",
        f"a: [{LONG}]\na: [{LONG}]\nb: \ue000\n",
    ],
)
def test_long_lists_of_numbers_are_read_like_short_ones(content, monkeypatch):
    found = text.read(content, "x.yaml")
    monkeypatch.setattr(text, "shortened", lambda content: (content, {}))
    whole = text.read(content, "x.yaml")
    assert repr(found.data) == repr(whole.data)
    assert found.problems == whole.problems
    assert found.keys == whole.keys
    assert {at: found.place(at) for at in whole.values} == whole.values


def test_a_wrong_number_in_a_long_list_is_reported_at_its_place(tmp_path):
    assert problems(tmp_path, f"name: long\nsweep:\n  punch.radius: [{LONG},\n    -2, 0.5]\n") == [
        "case.yaml:4:5: sweep.punch.radius[600]: got -2; must be a number > 0, or two of them, "
        "one for each direction"
    ]


# --- units are labels ---


@pytest.mark.parametrize(
    ("length", "stress", "force", "per_length"),
    [
        ("m", "Pa", "N", "N/m"),
        ("mm", "MPa", "N", "N/mm"),
        ("um", "Pa", "pN", "pN/um"),
        ("um", "GPa", "mN", "mN/um"),
        ("mm", "GPa", "kN", "kN/mm"),
        ("cm", "Pa", "Pa cm^2", "Pa cm"),  # 1e-4 N, for which there is no prefix
        ("in", "psi", "psi in^2", "psi in"),
    ],
)
def test_a_force_is_in_newtons_where_a_prefix_is_its_size(length, stress, force, per_length):
    units = Units(length=length, stress=stress, time="s")
    assert units.label("force") == force
    assert units.label("force / length") == units.label("pressure length") == per_length


def test_words_become_labels_and_stay_without_units():
    line = Config(name="line")
    surface = line.with_values(
        {"grid.points": [16, 16], "units": {"length": "mm", "stress": "MPa", "time": "h"}}
    )
    words = ("length", "pressure", "time", "length / time", "1", "force")
    assert [surface.unit(each) for each in words] == ["mm", "MPa", "h", "mm/h", "1", "N"]
    assert [line.unit(each) for each in words] == [*words[:-1], "force / length"]
    assert surface.unit("pressure length^2/V^2") == "N/V^2"
    force = {"control": "force", "force": 1.0}
    assert line.with_values({"trajectory": force}).unit("drive/time") == "force / length/time"


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ("{length: m, stress: Pa}", "units.time: missing; must be a unit of time, such as s, ms, min or h"),
        ("{length: Pa, stress: Pa, time: s}", "units.length: got the text 'Pa'; must be a unit of length"),
        ("{length: m, stress: mpa, time: s}", "units.stress: got the text 'mpa'; must be a unit of stress"),
        ("{length: m, stress: MPA, time: s}", "did you mean 'MPa'?"),
        ("{length: 1.0, stress: Pa, time: s}",
         "units.length: got 1.0; must be a unit of length, such as m, mm"),
        ("{lenght: m, stress: Pa, time: s}", "units.lenght: unknown key; allowed: length, stress, time"),
        ("SI", "units: got the text 'SI'; must be a mapping"),
        ("{length: m, stress: Pa, time: s}\nsweep: {units.length: [m, mm]}",
         "sweep.units.length: cannot be swept"),
    ],
)  # fmt: skip
def test_other_names_and_sweeps_of_labels_are_refused(tmp_path, units, message):
    assert message in "\n".join(problems(tmp_path, f"name: a\nunits: {units}\n"))
