"""Bodies of a user's own, from YAML: the examples of the page of additions beside the configuration."""

import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import (
    Case,
    Config,
    ConfigError,
    Layer,
    LayeredHalfspace,
    LayerStack,
    ViscoelasticLayer,
    Wavevectors,
    Zener,
    load,
    simulate,
)
from gfmdlayer.body.solid import fault
from gfmdlayer.config import digest
from gfmdlayer.grid.grid import Grid
from gfmdlayer.results.recording import Recording
from gfmdlayer.study.cases import cases, input_errors

ROOT = Path(__file__).parents[2]
EXAMPLES = re.findall(
    r"^```python\n# gfmdlayer/body/(\w+\.py)\n(.*?)^```$",
    (ROOT / "docs/reference/additions.md").read_text(encoding="utf-8"),
    re.DOTALL | re.MULTILINE,
)
CODE = {name: text for name, text in EXAMPLES if "(Solid)" in text}
BED = "name: bed\ngrid: {points: 256}\nbody: {file: winkler.py, k: 2.0}\n"


@pytest.fixture
def here(tmp_path, monkeypatch):
    for name, text in CODE.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def configured(text, **keys):
    Path("case.yaml").write_text(text)
    return load("case.yaml", keys, input_errors)


@pytest.mark.usefixtures("here")
def test_springs_press_in_proportion_to_the_overlap(recorder):
    # One branch as stiff as the spring: after a sudden step the pressure halves as it relaxes.
    values = {"time.end": 0.5, "time.step": 0.1, "output.snapshots": [0.5], "trajectory.ramp_time": 1e-6}
    case, found = Case(configured(BED, **values)), recorder()
    simulate(case, found)
    _, _, p = found.snapshots[0]
    overlap = np.maximum(found["depth"][-1] - case.punch, 0)
    assert 0 < np.count_nonzero(overlap) < 256
    close = 1e-5 * overlap.max()  # the solver's tolerance, and the ramp
    np.testing.assert_allclose(p, 2.0 * (1 + np.exp(-0.5)) * overlap, rtol=0, atol=2.0 * close)


@pytest.mark.usefixtures("here")
def test_two_beds_of_springs_face_to_face_are_one_of_half_the_stiffness():
    pair = gfmdlayer.run(configured(BED + "counterbody: {body: {file: winkler.py, k: 2.0}}\n"))
    one = gfmdlayer.run(configured(BED.replace("k: 2.0", "k: 1.0")))
    np.testing.assert_allclose(pair["mean_pressure"], one["mean_pressure"], rtol=1e-5)  # to 1e-6 each
    np.testing.assert_array_equal(pair["contact_area"], one["contact_area"])


@pytest.mark.usefixtures("here")
def test_body_and_punch_turned_by_a_right_angle_turn_the_pressure(recorder):
    found = []
    for points, period, radius, a, b in (
        ([48, 64], [1.0, 1.5], [0.5, 1.0], 4.0, 0.5),
        ([64, 48], [1.5, 1.0], [1.0, 0.5], 0.5, 4.0),
    ):
        config = {
            "name": "turned",
            "grid": {"points": points, "period": period},
            "body": {"file": "orthotropic.py", "a": a, "b": b, "material": {"model": "zener"}},
            "punch": {"shape": "parabola", "radius": radius},
            "time": {"end": 1.0, "step": 0.25},
            "output": {"snapshots": [1.0]},
        }
        kept = recorder()
        simulate(Config.model_validate(config), kept)
        found.append((kept["contact_area"][-1], np.reshape(kept.snapshots[0][2], points)))
    (area, p), (turned_area, turned_p) = found
    assert area == turned_area
    # Pressures are found to the solver's tolerance times the contrast of 10 of the moduli.
    np.testing.assert_allclose(turned_p, p.T, rtol=0, atol=2e-5 * p.max())
    np.testing.assert_allclose(p[1:], p[1:][::-1], rtol=0, atol=2e-5 * p.max())  # a mirror, about x = 0
    assert abs(p - np.roll(p, 1, 0)).max() > 0.01 * p.max()


@pytest.mark.usefixtures("here")
def test_the_halfspace_is_a_body_that_is_the_same_in_all_directions():
    text = "name: a\ngrid: {points: [16, 24]}\nbody: {file: orthotropic.py, a: 1, b: 1, material: {}}\n"
    case = Case(configured(text))
    halfspace, waves = gfmdlayer.halfspace(Zener()), case.grid.waves
    for s in (0.0, 1.0, 2j):
        np.testing.assert_allclose(case.body.stiffness(waves, s), halfspace.stiffness(waves, s), rtol=1e-14)


@pytest.mark.usefixtures("here")
def test_a_law_of_the_body_is_replaced_by_its_series():
    law = "{model: fractional_zener, exponent: 0.5}"
    text = f"name: a\ngrid: {{points: 32}}\nbody: {{file: orthotropic.py, a: 1, b: 1, material: {law}}}\n"
    config = configured(text)
    case, law_itself = Case(config), config.laws[0]
    assert len(case.series) == 1
    K, s = case.body.stiffness([3.0], 2.0), 2.0
    assert K[0] == pytest.approx(6.0 * law_itself.laplace(s), rel=3e-4)
    np.testing.assert_allclose(case.body.spectrum([3.0]).stiffness(s), K, rtol=1e-12)
    assert config.solid.unit == law_itself.unit
    assert config.solid.characteristic_time == law_itself.characteristic_time


def test_digests_follow_the_contents_of_the_file_and_not_its_name(here):
    first = digest(configured(BED))
    (here / "other.py").write_text(CODE["winkler.py"])
    assert digest(configured(BED.replace("winkler", "other"))) == first
    (here / "winkler.py").write_text(CODE["winkler.py"] + "\n")
    assert digest(configured(BED)) != first
    assert digest(configured(BED, **{"body.k": 3.0})) != digest(configured(BED))


def test_layers_by_name_are_the_default():
    keys = {"name": "a", "layer": {"thickness": 0.1}}
    assert digest(Config(**keys, body={"kind": "layers"})) == digest(Config(**keys))
    assert Config(**keys, body={"kind": "layers"}).solid == Config(**keys).solid


def test_a_configuration_reaches_other_processes_when_the_file_is_gone(here):
    config = configured(BED, sweep={"body.k": [1.0, 2.0]})
    every = pickle.dumps([case.config for case in cases(config)])
    (here / "winkler.py").unlink()
    code = f"import pickle; every = pickle.loads({every!r}); "
    code += "print([float(config.body.spectrum([1.0]).relaxed[0]) for config in every])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[1.0, 2.0]\n"


FILE = "{file: winkler.py, k: 1}"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{k: 2.0}", "case.yaml:3:8: body.k: unknown key; allowed: kind"),
        ("{file: winkler.py}", "case.yaml:3:1: body.k: missing; must be a number > 0, finite"),
        ("{file: winkler.py, k: -1}", "case.yaml:3:29: body.k: got -1; must be a number > 0, finite"),
        ("{file: winkler.py, k: 1, kk: 1}", "body.kk: unknown key; allowed: kind, k, tau, file; did"),
        ("{file: nothing.py, k: 1}", "nothing.py does not exist; must be the name of a readable file,"),
        (FILE + "\nlayer: {}", "case.yaml:4:1: layer: not available with body: {kind: winkler}; remove it"),
        (FILE + "\nhalfspace: {}", "case.yaml:4:1: halfspace: not available with body: {kind: winkler}"),
        (FILE + "\ngrid: {geometry: axisymmetric}", "axisymmetric, for which its compliance is missing"),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("here")
def test_impossible_keys_are_refused_with_their_place(text, expected):
    grid = "" if "grid:" in text else "grid: {points: 16}"
    with pytest.raises(ConfigError) as refused:
        configured(f"name: bed\n{grid}\nbody: {text}\n")
    assert expected in str(refused.value)
    assert len(refused.value.problems) == 1


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("{kind: table, file: K.txt}", "body.table: missing; must be the name of a file"),
        (
            "{file: K.txt}",
            "K.txt, which is no code; must be a .py file; a table of stiffness is body: {kind:",
        ),
    ],
)
@pytest.mark.usefixtures("here")
def test_a_file_of_data_is_not_run(body, expected):
    Path("K.txt").write_text('open("EXECUTED", "w").write("this file is data")\n')
    with pytest.raises(ConfigError) as refused:
        configured(f"name: kt\ngrid: {{points: 64}}\nbody: {body}\n")
    assert expected in str(refused.value)
    assert not Path("EXECUTED").exists()


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("WinklerBed(Solid)", "WinklerBed(Solids)", "winkler.py:17: NameError: name 'Solids' is not"),
        ("(Solid):", "(Solid:", "winkler.py:17: SyntaxError: invalid syntax; must be Python that defines a"),
        ("(Solid):", "(object):", "classes that derive from gfmdlayer.Solid: none; must be one"),
        ("def spectrum", "def spectra", "winkler.py:17: WinklerBed lacks spectrum; must define"),
        ("np.full((1,", "np.ful((1,", "winkler.py:46: AttributeError: module"),
        ("weights=k[np", "weights=-k[np", "a weight < 0 or a time <= 0; must be"),
        ("weights=k[np", "weights=2*k[np", "stiffness(waves, s) is not the sum of the modes of spectrum"),
        ("return self.k\n", "return 0.0\n", "relaxed is 1 at q = 0; must be mean_stiffness, 0"),
        ("np.full(np.shape(waves), self.k)", "np.array([self.k])", "relaxed has the shape (1,); must be ("),
    ],
)  # fmt: skip
def test_impossible_code_is_refused_with_file_and_line(here, old, new, expected):
    assert old in CODE["winkler.py"]
    (here / "winkler.py").write_text(CODE["winkler.py"].replace(old, new, 1))
    with pytest.raises(ConfigError) as refused:
        configured(f"name: bed\ngrid: {{points: 16}}\nbody: {FILE}\n")
    assert str(refused.value).startswith("case.yaml:3:14: body.file: ")
    assert expected in str(refused.value)
    assert len(refused.value.problems) == 1


def test_a_body_that_differs_between_q_and_its_opposite_is_refused(here):
    text = CODE["orthotropic.py"].replace("q.qy**2)", "q.qy**2 + 0.1 * q.qx)")
    (here / "orthotropic.py").write_text(text)
    with pytest.raises(ConfigError, match="differs between q and -q; must be equal"):
        configured("name: a\nbody: {file: orthotropic.py, a: 1, b: 1, material: {model: elastic}}\n")


def test_the_modes_of_every_body_of_the_package_keep_the_promises():
    waves = Wavevectors.of_components([0.0, 1.0, 0.0, -3.0], [0.0, 2.0, 50.0, 4.0])
    for keys in ({}, {"halfspace": {"shear_modulus": np.inf}, "layer": {"poisson": 0.3}}):
        assert fault(Config(name="a", **keys).solid, waves) == ""


@pytest.mark.parametrize("points", [32, [32, 16]])
@pytest.mark.usefixtures("here")
def test_the_figure_shows_stiffness_and_relaxation(points):
    from gfmdlayer.figures.body_plot import body_figure  # loads Matplotlib

    text = "name: a\nunits: {length: m, stress: Pa, time: s}\n"
    body = "body: {file: orthotropic.py, a: 4, b: 1, material: {}}\n"
    figure = body_figure(configured(text + body, **{"grid.points": points}))
    stiffness, relaxation = figure.axes
    assert [stiffness.get_xlabel(), stiffness.get_ylabel()] == ["$q$ (1/m)", "$K$ (kPa/m)"]
    relaxed, sudden = (np.asarray(line.get_ydata(), dtype=float) for line in stiffness.lines[:2])
    np.testing.assert_allclose(sudden, 10 * relaxed)
    kept = np.asarray(relaxation.lines[0].get_ydata(), dtype=float)
    assert kept[0] == pytest.approx(sudden[0], rel=1e-4)
    assert len(stiffness.lines) == (2 if points == 32 else 4)


class Bare:
    """Independent springs of 2, without modes."""

    mean_stiffness = 2.0

    def stiffness(self, waves, s):  # noqa: ARG002
        return np.full(np.shape(waves), 2.0)


def test_a_body_names_what_it_lacks():
    punch, lacks = gfmdlayer.Parabola(radius=1.0), "Bare has no spectrum"
    with pytest.raises(ConfigError, match=lacks):
        gfmdlayer.solve(Bare(), punch, depth=0.01)
    with pytest.raises(ConfigError, match=lacks):
        gfmdlayer.indent(Bare(), punch, [0.0, 1.0], depth=[0.0, 0.01])
    case = Case(Config(name="a", grid={"points": 32}), body=Bare())
    with pytest.raises(ConfigError, match=lacks):
        simulate(case, Recording())
    with pytest.raises(ConfigError, match=r"float has no .*; no spectrum.*must be a body, such as halfspace"):
        gfmdlayer.solve(1.0, punch, depth=0.01)


class Springs(gfmdlayer.Solid):
    """Independent springs, of a class that no file defines."""

    k: float

    @property
    def mean_stiffness(self):
        return self.k

    def stiffness(self, waves, s):
        return self.k + 0 * np.asarray(waves) * np.asarray(s)

    def spectrum(self, waves):
        return gfmdlayer.Spectrum.of_material(self.k + 0 * waves.magnitude, gfmdlayer.Elastic(1.0))


def test_a_body_of_this_session_runs_without_a_file(tmp_path):
    """The force per length on springs is k times the area under a parabola, 4/3 depth^(3/2) (2 R)^(1/2)."""
    short = {"time": {"end": 1.0, "step": 0.5}, "grid": {"points": 1024}}
    found = gfmdlayer.run(short, body=Springs(k=5.0), sweep={"body.k": [5.0, 10.0]})
    exact = 4 / 3 * 0.01**1.5 * 0.5**0.5
    assert found.force.isel(time=-1).values / [5.0, 10.0] == pytest.approx(
        exact, rel=1e-3
    )  # 1/145 of the contact: h^2
    alone = gfmdlayer.run(short, body=Springs(k=5.0))
    assert np.array_equal(alone.force, found.force.isel(k=0))
    for where in ({"out": tmp_path / "results"}, {"jobs": 2}):
        with pytest.raises(ConfigError, match=r"body: got a class of this session.*must be in a file"):
            gfmdlayer.run(short, body=Springs(k=5.0), **where)
    assert not (tmp_path / "results").exists()
    with pytest.raises(ConfigError, match=r"body\.kk: unknown key"):
        gfmdlayer.run(short, body=Springs(k=5.0), body__kk=3)


# --- wavevectors ---

LAYER = ViscoelasticLayer(LayeredHalfspace(0.1, 0.4, 2.0), Zener())
STACK = LayerStack((Layer(0.1, 0.4, Zener()), Layer(0.2, 0.5, Zener(tau=3.0))), rigid=True)


@pytest.mark.parametrize("grid", [Grid((9,), (2.0,)), Grid((8, 6), (1.0, 3.0))])
def test_the_grid_gives_the_wavevector_of_each_mode(grid):
    waves = grid.waves
    assert waves.qx.shape == waves.qy.shape == waves.magnitude.shape == waves.shape == grid.spectral_shape
    np.testing.assert_array_equal(waves.magnitude, grid.wavenumbers)
    np.testing.assert_allclose(np.hypot(waves.qx, waves.qy), waves.magnitude, rtol=1e-15)
    # A wave exp(i q.x) on the grid has its transform at its own mode.
    wave = np.unravel_index(3, grid.spectral_shape)
    points = np.meshgrid(*grid.coordinates, indexing="ij")
    phase = sum(q[wave] * x for q, x in zip((waves.qx, waves.qy), points, strict=False))
    assert np.unravel_index(np.abs(np.fft.rfftn(np.cos(phase))).argmax(), grid.spectral_shape) == wave


def test_plain_magnitudes_are_waves_along_x():
    waves = Wavevectors.of([[0.0, 1.0], [2.0, 3.0]])
    np.testing.assert_array_equal(waves.qx, [[0.0, 1.0], [2.0, 3.0]])
    np.testing.assert_array_equal(waves.qy, 0.0)
    assert Wavevectors.of(waves) is waves
    assert np.shape(waves) == (2, 2)
    np.testing.assert_array_equal(2 * np.asarray(waves), 2 * waves.magnitude)


@pytest.mark.parametrize("body", [LAYER, STACK])
def test_isotropic_bodies_answer_to_the_magnitude(body):
    grid = Grid((8, 6), (1.0, 3.0))
    found, expected = body.spectrum(grid.waves), body.spectrum(grid.wavenumbers)
    for name in ("relaxed", "weights", "times"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    np.testing.assert_array_equal(body.stiffness(grid.waves, 1j), body.stiffness(grid.wavenumbers, 1j))
