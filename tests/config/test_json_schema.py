"""The schema for editors against the loader: what one takes and refuses, the other does too."""

import copy
import json
import math
import pickle
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from gfmdlayer.cli import main
from gfmdlayer.config import digest, load
from gfmdlayer.config.json_schema import json_schema
from gfmdlayer.config.model import problems
from gfmdlayer.config.sweeps import unswept
from gfmdlayer.validation import text

ROOT = Path(__file__).parents[2]
LINE = "name: line\ngrid: {points: 64, period: 2.0}\n"
AXISYMMETRIC = "name: tip\ngrid:\n  geometry: axisymmetric\n  points: 64\n"
SURFACE = "name: surface\ngrid: {points: [64, 32], period: [2.0, 1.0]}\n"
BED = """\
from gfmdlayer import Solid

class Bed(Solid):
    k: float = 1.0

    def stiffness(self, waves, s): ...

    def spectrum(self, waves): ...
"""
READING = (
    'reading: {decimal: ",", units: {depth: nm, K: MPa/um}, columns: [time, "depth [nm]", "-"], table: 2}'
)
# Sound configurations that have every key between them.
SOUND = [
    LINE + """\
layer: {thickness: .inf, poisson: 0.3, material: {model: zener, G0: 1, Ginf: 10.0, tau: 2.0}}
halfspace: {shear_modulus: 0, poisson: -0.2}
punch: {shape: parabola, radius: 0.25}
trajectory: {control: depth, kind: ramp_hold, depth: 0.01, ramp_time: 1.0}
time: {end: 2.0, step: 0.25, integrator: backward_euler}
solver: {method: fire, tolerance: 1.0e-5, inertia: uniform, max_iterations: 100}
output:
  snapshots: [0.5, 1.0]
  patches: true
  keep_state: true
  histograms:
    pressure: {max: 1.0, bins: 5, scale: log, min: 0.1}
    gap: {max: 1.0, bins: 5, scale: log, min: 0.1}
sweep: {layer.thickness: [0.1, .inf], layer.material.Ginf: [2, 3]}
""",
    LINE + """\
layer: {material: {model: prony, G0: 1.0, branches: [{G: 1.0, tau: 1.0}, {G: 2.0, tau: 0.1}]}}
punch: {shape: cylinder, radius: 3.0, along: y}
trajectory: {control: load, load: 0.1, velocity: 0.1}
time: {step: adaptive, tolerance: 1.0e-3, steady: 0.1}
output: {times: 0.1}
""",
    """\
name: surface
grid: {points: [16, 16]}
output:
  observables: [critical_gap_x, critical_gap_y, flow_bruggeman, spot_radius]
  leakage: {every: 5}
  conductance:
    body: {resistivity: .inf, films: [{thickness: 0.1, resistivity: 2.0}]}
    punch: {resistivity: 1.0, films: [{thickness: 0.2, resistivity: 1.0}]}
    every: 2
  stiffness: {frequencies: [0, 1.0, .inf], every: 3}
""",
    LINE + "output: {snapshots: [1.0], inside: {depths: [0, 0.1], times: [1.0], every: 2}}\n",
    LINE + "output: {inside: {points: 5, every: 1}}\n",
    LINE + """\
units: {length: mm, stress: MPa, time: s}
layer: {thickness: 200 um, material: {G0: 1 MPa, Ginf: 10 N/mm^2, tau: 100 ms}}
punch: {shape: parabola, radius: 5 cm}
trajectory: {depth: 10 um, ramp_time: 0.1 min}
time: {end: 30 s, step: adaptive}
output:
  snapshots: {from: start, to: peak, points: 3, spacing: linear}
  times: {from: 10 ms, to: end, points: 9, spacing: log}
sweep: {trajectory.depth: {from: 1 um, to: 0.1 mm, points: 3}, layer.thickness: [0.1 mm, 0.2]}
""",
    LINE + "output: {snapshots: peak}\n",
    LINE + "output: {snapshots: [start, 1, end]}\ntime: {step: adaptive}\n",
    LINE + f"trajectory: {{kind: table, file: heights.txt, {READING}}}\ntime: {{step: adaptive}}\n"
    "output: {times: [1, 2]}\n",
    LINE + """\
layer:
  material:
    model: fractional_zener
    G0: 1
    Ginf: 10
    tau: 1.0
    exponent: 0.4
    tolerance: 1.0e-3
    shift: {law: wlf, C1: 17.4, C2: 51.6, reference: 25}
temperature: {value: 20}
""",
    LINE + """\
layer: {material: {model: power_law, G: 1, G0: 0.1, exponent: 0.4, shift: {law: arrhenius,
  activation_energy: 8.0e+4, reference: 25}}}
temperature: {file: degrees.txt, READING}
""".replace("READING", READING),
    LINE + "layer: {material: {model: havriliak_negami, Ginf: 10, alpha: 0.4, gamma: 1.5}}\n",
    LINE + "layer: {material: {model: kohlrausch, exponent: 1}}\n",
    LINE + "layer: {material: {model: elastic, G: 2}}\n",
    LINE + "layer: {poisson: 0.3, material: {model: elastic, young: 2, bulk: 1.6666666667}}\n",
    LINE + "layer: {material: {model: zener, moduli: young, Ginf: 10}}\nhalfspace: {young_modulus: 3}\n",
    LINE + "halfspace: {poisson: 0.3, bulk_modulus: .inf}\ncounterbody: {halfspace: {young_modulus: 3}}\n",
    LINE + "counterbody: {halfspace: {bulk_modulus: 3, poisson: 0.3}}\n",
    LINE + "layers: [{thickness: 1, poisson: 0.3, material: {model: elastic, bulk: 2}},\n"
    "  {thickness: 1, poisson: 0.3, material: {model: elastic, young: 2}},\n"
    "  {thickness: 1, material: {model: prony, moduli: young, G0: 0, branches: [{G: 1, tau: 1}]}}]\n",
    LINE + """\
layers:
  - {thickness: 0.01, poisson: 0.4, material: {model: prony, branches: [{G: 1, tau: 0.1}]}}
  - {thickness: .inf}
halfspace: {poisson: 0.3, material: {Ginf: 20}}
sweep:
  layers.0.thickness: [0.01, 0.02]
  layers.0.material.branches.0.G: [1, 2]
  layers.1.material: [{Ginf: 3}, {model: elastic, G: 2}]
""",
    LINE + "layer: {material: {file: fitted.yaml}}\n",
    LINE + "body: {kind: layers}\n",
    LINE + "body: {file: bed.py}\n",
    LINE + "body: {kind: anisotropic, C11: 3, C12: -1.0, C44: 1, C13: 0.5, C33: 2, C66: 1, angle: 30,\n"
    "  material: {model: elastic, G: 1}}\n",
    LINE + "body: {kind: lattice, crystal: simple_cubic, nearest: 1, next_nearest: 2, spacing: 0.03125,\n"
    "  layers: 4}\n",
    LINE + "body: {kind: anisotropic, normal: [1, 1, 1], along: [1, -1, 0], C: [[4, 1, 1, 0, 0, 0],\n"
    "  [1, 4, 1, 0, 0, 0], [1, 1, 4, 0, 0, 0],\n"
    "  [0, 0, 0, 2, 0, 0], [0, 0, 0, 0, 2, 0], [0, 0, 0, 0, 0, 2]]}\n",
    LINE + "body: {kind: lattice, nearest: 1, spacing: 0.03125}\n",
    LINE + f"body: {{kind: table, table: heights.txt, mean: 0.5, {READING}}}\n",
    LINE + "body: {kind: table, table: stiffness.npy, period: 2.0}\n",
    LINE
    + "counterbody: {layer: {thickness: 0.1, poisson: 0.4, material: {}}, halfspace: {shear_modulus: 3}}\n",
    LINE + "counterbody: {body: {file: bed.py}}\n",
    LINE + "counterbody: {velocity_ratio: 1}\ntrajectory: {velocity: 2}\n",
    LINE + "counterbody: {body: {kind: layers}}\n",
    LINE + """\
counterbody:
  layers: [{thickness: 0.1, poisson: 0.4, material: {Ginf: 3}}]
  halfspace: {poisson: 0.3, material: {model: zener}}
sweep: {counterbody.layers.0.thickness: [0.1, 0.2]}
""",
    "name: one\ngrid: {points: 64, boundary: isolated, datum: 2.0}\n",
    LINE + "interface: {law: exponential, work: 0.1, range: 0.01}\nsweep: {interface.work: [0.1, 0.2]}\n",
    LINE + "interface: {law: hard_wall, hardness: 0.5}\nsweep: {interface.hardness: [0.1, 0.2]}\n",
    LINE + """\
interface: [{law: coulomb, coefficient: 0.3}, {law: shear_strength, stress: 0.1}]
trajectory:
  tangential: {control: force, kind: oscillation, force: 0.1, start: 1, period: 2, cycles: 1.5, direction: 0}
sweep: {interface.0.coefficient: [0.1, heights.txt], interface.1.stress: [0, 0.1]}
""",
    SURFACE + """\
interface: {law: coulomb, coefficient: heights.txt}
trajectory: {tangential: {kind: ramp, displacement: 0.1, ramp_time: 1.0, direction: 45}}
sweep: {trajectory.tangential.displacement: [0.1, 0.2]}
""",
    LINE + """\
interface: {law: shear_strength, stress: 0}
trajectory: {tangential: {kind: table, file: heights.txt}}
""",
    LINE + "interface: {law: electrostatic, voltage: heights.txt, permittivity: 1, insulation: 1,\n"
    f"  {READING}}}\n",
    LINE + f"interface: {{law: coulomb, coefficient: heights.txt, {READING}}}\n"
    f"trajectory: {{tangential: {{kind: table, file: heights.txt, {READING}}}}}\n",
    LINE + "interface: {law: coulomb, coefficient: 1}\ntrajectory: {velocity: 1.0, creepage: -0.1}\n",
    """\
name: spin
grid: {points: [16, 16]}
interface: {law: coulomb, coefficient: 1}
trajectory: {velocity: 1.0, creepage: {x: 0.1, y: -0.1, spin: 1}}
time: {steady: at_once}
""",
    LINE + "interface: {law: hard_wall}\nsweep: {interface: [{work: 1, range: 1}, {law: hard_wall}]}\n",
    LINE + """\
interface:
  - {law: dugdale, work: 0.1, stress: 2, smoothing: 0.3}
  - {law: lennard_jones, work: 0.1, separation: 0.01}
  - {law: electrostatic, voltage: heights.txt, permittivity: 1.0, insulation: 0.1}
  - {law: hard_wall, hardness: 1.0e+6}
sweep: {interface.0.work: [0.1, 0.2], interface.2.voltage: [5, heights.txt]}
""",
    LINE + """\
units: {length: mm, stress: MPa, time: s}
interface: {law: electrostatic, voltage: -100, insulation: [{thickness: 0.01, permittivity: 3}]}
sweep: {interface.insulation.0.thickness: [0.1, 0.2]}
""",
    LINE + "punch: {shape: cone, slope: 0.1}\n"
    f"trajectory: {{velocity_file: heights.txt, velocity_{READING}}}\n",
    LINE + "punch: {shape: wedge, slope: 0.1, along: y}\n",
    LINE + "punch: {shape: profile, file: heights.txt, touches_first: highest}\n",
    LINE + "punch: {shape: profile, file: heights.txt}\nsweep: {solver.method: [fire, active_set]}\n",
    SURFACE + "punch: {radius: [0.5, .inf]}\nunits: {length: um, stress: MPa, time: s}\n",
    LINE + "trajectory: {control: force, force: 1.0}\n",
    LINE + "trajectory: {control: gap, gap: 0.1}\n",
    """\
name: jkr
grid: {geometry: axisymmetric}
interface: {law: short_range, work: 1, edge_speed: 2, healing_work: 0, edge_exponent: 0.5}
""",
    LINE + """\
trajectory: {kind: approach_retract, start: -0.1, depth: 0.01, approach_speed: 0.1, dwell: 1,
  retract_speed: 1, final: -0.2, cycles: 2}
sweep: {trajectory.retract_speed: [0.1, 1]}
""",
    LINE + "sweep: {zip: {layer.thickness: [0.1, 0.1], punch.radius: [0.2, 0.3]}, solver.method: [fire]}\n",
    LINE
    + "sweep: {latin_hypercube: {samples: 4, seed: 7, layer.thickness: {from: 0.1, to: 1, scale: log}}}\n",
    LINE + "sweep: {latin_hypercube: {samples: 2, layer.poisson: {from: -1, to: 0.5}}}\n",
    LINE + "sweep: {trajectory.velocity: {from: 1, to: 2, points: 3, spacing: log}, grid.points: [8, 9]}\n",
    LINE + "sweep: {zip: {trajectory.velocity: {from: 1, to: 2, points: 2}, punch.radius: [0.1, 0.2]}}\n",
    LINE + "sweep: {sobol: {samples: 4, layer.material.Ginf: {from: 2, to: 3}}}\n",
    LINE + "sweep: {punch: [{shape: wedge, slope: 0.1}, {radius: 0.1}], output.snapshots: [[1], [1, 2]]}\n",
    SURFACE + "punch: {shape: sphere, radius: 3}\n",
    SURFACE + "punch: {shape: pyramid, angle: 70.3, faces: 4}\nsweep: {punch.faces: [3, 4]}\n",
    SURFACE + "punch: {shape: flat, width: [0.1, 0.2], edge_radius: 0.1}\n",
    SURFACE + "punch: {shape: sinusoid, amplitude: [0.1, 0], wavelength: [1.0, .inf]}\n",
    SURFACE + "punch: {shape: array, counts: [2, 1], element: {shape: flat, width: 0.1, edge_radius: 0.1}}\n",
    SURFACE + "punch: {shape: array, counts: 1, element: {radius: 0.1}}\n",
    *(
        SURFACE + f"punch: {{shape: array, counts: 1, element: {{shape: {element}}}}}\n"
        for element in (
            *("cylinder, radius: 3, along: x", "wedge, slope: 0.1", "pyramid, angle: 70, faces: 3"),
            "blunted_cone, slope: 0.1, tip_radius: 0.1",
        )
    ),
    SURFACE + """\
punch:
  {shape: self_affine, hurst: 0.8, short_cutoff: 0.2, roll_off: 0.4, long_cutoff: 1, rms_slope: 0.1, seed: 1}
""",
    SURFACE + "punch: {shape: self_affine, hurst: 0.8, short_cutoff: 0.2, rms_height: 0.1, seed: 0}\n",
    LINE + "punch: {shape: blunted_cone, slope: 0.1, tip_radius: 0.3}\n",
    AXISYMMETRIC + "  extent: 2.0\npunch: {shape: flat_punch, radius: 0.1}\n",
    AXISYMMETRIC + f"punch: {{shape: radial_profile, file: heights.txt, {READING}}}\n",
    SURFACE + """\
punch:
  {shape: topography, file: heights.txt, dataset: a, unit: 2.0, fill: membrane, detrend: plane, taper: 0.1,
   resample: fourier, size: [1, 2], transpose: true, hole: -9999, reading: {decimal: ","}}
""",
    SURFACE + "punch: {shape: topography, file: heights.txt, unit: nm, size: 3.0, hole: none}\n",
    LINE + "punch: {shape: profile, file: heights.txt, hole: -1, reading: {decimal: \",\"}}\n",
]  # fmt: skip
# Types and ranges that most keys refuse. What a problem rests on besides its own key, the schema cannot know.
ODD = (None, True, "adaptif", {}, [[]], -1, math.inf)


@cache
def schema():
    return json_schema()


@cache
def validator():
    return Draft202012Validator(schema())


@cache
def plain(content):
    """Return the data of a text, which no test changes."""
    return text.read(content, "").data


@pytest.fixture(autouse=True)
def in_a_folder_with_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("heights.txt").write_text("0 0\n1 1\n")
    Path("degrees.txt").write_text("0 20\n8 30\n")
    np.save("stiffness.npy", np.ones(64))
    Path("bed.py").write_text(BED)
    Path("fitted.yaml").write_text("layer: {material: {model: prony, branches: [{G: 1.0, tau: 2.0}]}}\n")


def is_refused(data):
    """Whether the loader refuses data, asked without the detour over a file."""
    return data.get("sweep") == {} or bool(problems(data))


def is_of_one_value(problem):
    """Whether no other value, key or file has a part in a problem."""
    own = unswept(problem.key)
    related = ("does not exist", "> from", "log with from", "lists of the same length", "row by row")
    related += (
        "positive definite",
        "must be perpendicular",
        "is not a unit of it",
        "is not the name of a quantity",
    )
    return (
        all(f"{other}.".startswith(f"{own}.") for other in problem.others)
        and not problem.at_key
        and not any(words in problem.message for words in related)
    )


def places(data, at=()):
    """Yield the way to each value."""
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in inner:
        yield (*at, key)
        yield from places(value, (*at, key))


@cache
def sections():
    """Return the sections of each sound configuration that none before it has."""
    found, seen = {}, set()
    for content in SOUND:
        given = {key: (key, repr(value)) for key, value in plain(content).items()}
        found[content] = {key for key, section in given.items() if section not in seen}
        seen |= {*given.values()}
    return found


def changed(data, at, value):
    result = copy.deepcopy(data)
    inner = result
    for key in at[:-1]:
        inner = inner[key]
    inner[at[-1]] = value
    return result


def test_it_is_a_schema_of_the_latest_draft():
    assert schema()["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    Draft202012Validator.check_schema(schema())
    of_a_section = {"properties", "additionalProperties", "required"}
    assert schema().keys() <= of_a_section | {"$schema", "$defs", "title", "description", "type"}


def test_the_command_prints_it(capsys):
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == schema()


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda path: path.stem)
def test_the_configurations_that_come_along_are_valid_and_have_a_quick_version(path):
    assert not list(validator().iter_errors(plain(path.read_text())))
    assert load(path).name == path.stem
    assert path.with_stem(path.stem.removesuffix("-quick") + "-quick").exists()


@pytest.mark.parametrize("content", SOUND)
def test_both_take_what_is_sound_and_what_is_dumped_is_the_same(content):
    Path("case.yaml").write_text(content)
    config = load("case.yaml")
    assert not list(validator().iter_errors(plain(content)))
    again = load("again.yaml", content=config.dump()), pickle.loads(pickle.dumps(config))
    assert {each.dump() for each in again} == {config.dump()}
    assert {digest(each) for each in again} == {digest(config)}


def test_keys_of_a_body_of_ones_own_may_have_any_name_and_be_swept():
    content = LINE + "body: {file: bed.py, k: 2.0}\nsweep: {body.k: [1, 2.5]}\n"
    test_both_take_what_is_sound_and_what_is_dumped_is_the_same(content)


def test_the_sound_ones_have_every_key_and_every_key_says_what_it_is():
    used = {
        ".".join(key for key in place if isinstance(key, str))
        for content in SOUND
        for place in places(plain(content))
    }
    used |= {key.replace("layer.", "halfspace.", 1) for key in used if key.startswith("layer.material.")}
    used |= {
        f"counterbody.{key}" for key in used if key.startswith(("layer.material.", "halfspace.material."))
    }
    used |= {key.replace("layer.", "body.", 1) for key in used if key.startswith("layer.material.")}
    used |= {f"counterbody.{key}" for key in used if key.startswith("body.")}
    swept = {key for key in schema()["$defs"]["Sweep"]["properties"] if "." in key}
    known = schema()["properties"].keys() | swept
    assert known <= used
    for section in (schema(), *schema()["$defs"].values()):
        for key, value in section["properties"].items():
            assert "." in key or key in {"body", "punch", "interface"} or value.get("description"), key


@pytest.mark.parametrize("content", SOUND)
def test_both_refuse_the_same_types_and_ranges(content):
    data = plain(content)
    for place in (each for each in places(data) if each[0] in sections()[content]):
        for value in ODD:
            mutated = changed(data, place, value)
            found = problems(mutated)
            refused = any(map(is_of_one_value, found)) or mutated.get("sweep") == {}
            # The other sections are sound, and the schema has no condition on two of them.
            asked = {key: mutated[key] for key in {"name", place[0]}}
            assert validator().is_valid(asked) == (not refused), (place, value, found)


@pytest.mark.parametrize("content", SOUND)
def test_both_refuse_a_key_that_does_not_exist_and_the_lack_of_one_that_must(content):
    data = plain(content)
    sections = {place[:-1] for place in places(data) if isinstance(place[-1], str)}
    for section in sections:
        mutated = changed(data, (*section, "colour"), 1)
        assert is_refused(mutated)
        # The keys of a body in a file are known to the loader only.
        of_a_file = section[-1:] == ("body",) and (*section, "file") in {*places(data)}
        assert validator().is_valid(mutated) == of_a_file
    assert not validator().is_valid({key: value for key, value in data.items() if key != "name"})


@pytest.mark.parametrize(
    "sweep",
    [
        "null",
        "{layer.thickness: null}",
        "{layer.thickness: [0.1, 0.1]}",
        "{punch: [{shape: star}]}",
        "{zip: null}",
        "{zip: {}}",
        "{zip: {layer.thickness: null}}",
        "{zip: {layer.thickness: 0.1}}",
        "{zip: {layer.thickness: [0.1]}, sobol: {samples: 2, punch.radius: {from: 0.1, to: 0.2}}}",
        "{sobol: null}",
        "{sobol: {samples: 6, punch.radius: {from: 0.1, to: 0.2}}}",
        "{sobol: {samples: 8, seed: 1}}",
        "{sobol: {samples: 8, punch.radius: null}}",
        "{sobol: {samples: 8, punch.radius: {from: 0.1}}}",
        "{latin_hypercube: {punch.radius: {from: 0.1, to: 0.2}}}",
        "{latin_hypercube: {samples: 4, solver.method: {from: 0.1, to: 0.2}}}",
        "{latin_hypercube: {samples: 4, grid.points: {from: 16, to: 64}}}",
    ],
)
def test_both_refuse_sweeps_of_no_known_form(sweep):
    data = plain(f"{LINE}sweep: {sweep}\n")
    assert is_refused(data)
    assert not validator().is_valid(data)


_values = st.recursive(
    st.one_of(
        st.none(), st.booleans(), st.integers(), st.floats(allow_nan=False), st.text("abc.xy", max_size=4),
        st.sampled_from(["fire", "adaptive", "prony", "sphere", "y", "log", "heights.txt", "layer.poisson"]),
    ),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.sampled_from(["shape", "radius", "slope", "model", "max", "G"]), inner, max_size=3),
    max_leaves=5,
)  # fmt: skip


@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(draws=st.data())
def test_what_the_schema_refuses_the_loader_refuses(draws):
    data = plain(draws.draw(st.sampled_from(SOUND)))
    for _ in range(draws.draw(st.integers(1, 3))):
        place = draws.draw(st.sampled_from(list(places(data))))
        data = changed(data, place, draws.draw(_values))
    if not validator().is_valid(data):
        assert is_refused(data)


def test_the_ends_of_a_formula_obey_the_bounds_of_their_key():
    swept = "name: x\nsweep: {layer.poisson: {from: 0, to: %s, points: 3}}\n"
    assert validator().is_valid(plain(swept % "0.5"))
    assert not validator().is_valid(plain(swept % "0.9"))
