"""Moduli of other kinds than shear, liquids, and the units of material files."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import Config, ConfigError, Elastic, Kohlrausch, Prony, Zener, load
from gfmdlayer.config.model import digest

POISSON = 0.3
# G = E/(2 (1 + nu)) = 3 K (1 - 2 nu)/(2 (1 + nu))
PER_YOUNG, PER_BULK = 1 / (2 * (1 + POISSON)), 3 * (1 - 2 * POISSON) / (2 * (1 + POISSON))
LAWS = [
    {"model": "elastic", "G": 2.0},
    {"model": "zener", "G0": 1.0, "Ginf": 10.0, "tau": 2.0},
    {"model": "prony", "G0": 1.0, "branches": [{"G": 3.0, "tau": 0.1}, {"G": 2.0, "tau": 4.0}]},
    {"model": "fractional_zener", "G0": 1.0, "Ginf": 10.0, "tau": 2.0, "exponent": 0.4},
    {"model": "kohlrausch", "G0": 1.0, "Ginf": 10.0, "tau": 2.0, "exponent": 0.4},
    {"model": "havriliak_negami", "G0": 1.0, "Ginf": 10.0, "tau": 2.0, "alpha": 0.4, "gamma": 1.5},
    {"model": "power_law", "G": 3.0, "tau": 2.0, "exponent": 0.3, "G0": 0.5},
]


def config(**sections):
    return Config(name="case", **sections)


@pytest.mark.parametrize(("kind", "ratio"), [("young", PER_YOUNG), ("bulk", PER_BULK)])
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law["model"])
@pytest.mark.parametrize("where", ["layer", "halfspace"])
def test_every_law_takes_moduli_of_another_kind_with_the_poisson_beside_it(where, law, kind, ratio):
    given = config(**{where: {"poisson": POISSON, "material": law | {"moduli": kind}}})
    plain = config(**{where: {"poisson": POISSON, "material": law}})
    own, shear = (each.laws[-1] for each in (given, plain))
    t = [0.01, 1.0, 100.0]
    np.testing.assert_allclose(own.relaxation_modulus(t), ratio * shear.relaxation_modulus(t), rtol=1e-13)
    assert own.moduli is None
    again = load("again.yaml", content=given.dump())
    assert again.dump() == given.dump()
    assert digest(again) == digest(given) != digest(plain)


@pytest.mark.parametrize(("key", "ratio"), [("young", PER_YOUNG), ("bulk", PER_BULK)])
def test_an_elastic_solid_and_a_base_take_one_modulus_of_any_kind(key, ratio):
    law = {"model": "elastic", key: 6.0}
    made = config(
        layer={"poisson": POISSON, "material": law}, halfspace={"poisson": POISSON, f"{key}_modulus": 8.0}
    )
    assert pytest.approx(6 * ratio, rel=1e-14) == made.laws[0].G
    assert made.solid.base.shear_modulus == pytest.approx(8 * ratio, rel=1e-14)
    rigid = config(halfspace={"poisson": POISSON, f"{key}_modulus": math.inf})
    assert rigid.solid.base.shear_modulus == math.inf
    in_python = gfmdlayer.Layer(0.1, POISSON, Elastic(**{key: 6.0}))
    assert in_python.in_shear.material == Elastic(made.laws[0].G)


def test_a_sweep_of_the_poisson_keeps_the_given_modulus():
    swept = config(
        layer={"material": {"model": "elastic", "young": 6.0}}, sweep={"layer.poisson": [0.0, 0.3, 0.5]}
    )
    cases = [swept.with_values({"layer.poisson": nu}) for nu in (0.0, 0.3, 0.5)]
    assert [case.laws[0].G for case in cases] == pytest.approx([3.0, 6 / 2.6, 2.0], rel=1e-14)


def test_a_sweep_of_the_modulus_reads_its_own_configuration_again():
    swept = config(layer={"material": {"model": "elastic"}}, sweep={"layer.material.young": [3.0, 6.0]})
    again = load("again.yaml", content=swept.dump())
    cases = [again.with_values({"layer.material.young": young}) for young in (3.0, 6.0)]
    assert [case.laws[0].G for case in cases] == pytest.approx([1.0, 2.0], rel=1e-14)


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"layer": {"material": {"model": "elastic", "G": 1.0, "young": 2.5}}},
         "layer.material.young: got 2.5, but G = 1.0 and poisson = 0.5 make it 3; remove one of the two"),
        ({"layer": {"poisson": 0.3, "material": {"model": "elastic", "young": 3.0, "bulk": 2.0}}},
         "layer.material.bulk: got 2.0, but young = 3.0 and poisson = 0.3 make it 2.5"),
        ({"layer": {"material": {"model": "elastic", "bulk": 2.0}}},
         "layer.material.bulk: bulk says nothing of shear where poisson is 0.5; give poisson below 0.5"),
        ({"halfspace": {"material": {"model": "prony", "moduli": "bulk"}}},
         "halfspace.material.moduli: a bulk modulus says nothing of shear where poisson is 0.5"),
        ({"halfspace": {"bulk_modulus": 2.0}}, "halfspace.bulk_modulus: bulk_modulus says nothing of shear"),
        ({"halfspace": {"young_modulus": 3.0, "shear_modulus": 1.1}},
         "halfspace.young_modulus: got 3.0, but shear_modulus = 1.1 and poisson = 0.5 make it 3.3"),
        ({"halfspace": {"young_modulus": 3.0, "material": {"model": "prony"}}},
         "halfspace.young_modulus: given beside material; remove one of the two"),
        ({"layer": {"material": {"model": "elastic", "young": 3.0, "moduli": "young"}}},
         "layer.material.moduli: given beside young or bulk; remove it"),
        ({"layer": {"material": {"model": "zener", "moduli": "tensile"}}}, "one of shear, young, bulk"),
        ({"layer": {"material": {"model": "prony", "G0": 0.0}}}, "got 0 without a branch"),
    ],
)  # fmt: skip
def test_moduli_that_contradict_each_other_are_refused_with_the_numbers(sections, message):
    with pytest.raises(ConfigError) as refused:
        config(**sections)
    assert message in str(refused.value)
    if "layer" in sections and "tensile" not in str(sections):
        with pytest.raises(ConfigError):
            gfmdlayer.Layer(thickness=0.1, **sections["layer"])


def test_moduli_that_agree_are_taken():
    one = config(layer={"poisson": POISSON, "material": {"model": "elastic", "G": 1.0, "young": 2.6}})
    assert one.laws[0].relaxed == 1


# Liquids: G0 = 0. Under a prescribed depth, or above something solid, each time has an equilibrium.

MAXWELL = {"model": "zener", "G0": 0.0, "Ginf": 5.0, "tau": 0.5}
LIQUIDS = [
    MAXWELL,
    {"model": "prony", "G0": 0.0, "branches": [{"G": 3.0, "tau": 0.1}, {"G": 2.0, "tau": 1.0}]},
    *(
        {"model": model, "G0": 0.0, "Ginf": 5.0}
        for model in ("fractional_zener", "kohlrausch", "havriliak_negami")
    ),
    {"model": "power_law", "G": 3.0},
]
LIQUID = pytest.mark.parametrize("law", LIQUIDS, ids=lambda law: law["model"])


@LIQUID
def test_a_liquid_runs_wherever_something_holds_it_and_is_refused_elsewhere(law):
    load_control = {"trajectory": {"control": "load", "load": 0.01}}
    halfspace = {"layer": {"thickness": math.inf, "material": law}}
    config(**halfspace)
    config(layer={"material": law}, **load_control)
    for alone in (halfspace, {"halfspace": {"material": law}},
                  {"layer": {"material": law}, "halfspace": {"shear_modulus": 0.0}}):  # fmt: skip
        config(**alone)
        with pytest.raises(
            ConfigError, match=r"trajectory.control: got 'load': a liquid .* sinks without end"
        ):
            config(**alone, **load_control)


@pytest.mark.parametrize(
    ("law", "geometry"),
    # A springpot has no modulus at short times, in which the depth is sudden here.
    [
        (law, each)
        for law in LIQUIDS
        for each in ("line", "axisymmetric")[: 1 + (law["model"] != "power_law")]
    ],
    ids=lambda each: each if isinstance(each, str) else each["model"],
)
def test_the_pressure_on_a_liquid_layer_relaxes_as_its_modulus(law, geometry):
    """On a rigid base K(q, t) = K(q) G(t): after a sudden depth the force falls as G(t)."""
    depth, ramp, end = 0.002, 1e-4, 2.0
    sections = {
        "layer": {"thickness": 0.05, "poisson": 0.4, "material": law},
        "halfspace": {"shear_modulus": math.inf},
        "trajectory": {"depth": depth, "ramp_time": ramp}, "time": {"end": end, "step": "adaptive"},
        "grid": {"points": 256} if geometry == "line" else {"geometry": "axisymmetric"},
        "output": {"times": [0.1, 0.5, 1.0, end]},
    }  # fmt: skip
    found = gfmdlayer.run(sections)
    force = found["mean_pressure" if geometry == "line" else "force"]
    made = config(**sections).laws[0]
    late = found.time.values > 0.05
    t = found.time.values[late]
    ratio = force.values[late] / force.values[late][0]
    # The ramp is a part 1e-4/0.05 of the first time, and moves the step by half of itself;
    # steps and series keep to 1e-4, of the largest pressure.
    expected = made.relaxation_modulus(t - ramp / 2) / made.relaxation_modulus(t[0] - ramp / 2)
    np.testing.assert_allclose(ratio, expected, rtol=2e-3, atol=1e-4)


def test_a_liquid_that_has_relaxed_carries_nothing():
    found = gfmdlayer.run(config(
        layer={"thickness": 0.05, "material": MAXWELL}, halfspace={"shear_modulus": math.inf},
        grid={"points": 256},
        trajectory={"depth": 0.002, "ramp_time": 0.01}, time={"end": 15.0, "step": "adaptive"},
    ))  # fmt: skip
    p = found.mean_pressure.values
    # exp(-30) = 1e-13, and the spring beside the liquid carries 1e-10 of its slowest modulus, tau/end.
    assert abs(p[-1]) < 1e-10 * p.max()


def test_a_maxwell_layer_sinks_under_a_load_as_its_compliance_grows():
    """In full contact with a cosine the pressure is p K(q, t): the amplitude under a load follows J(t)."""
    found = gfmdlayer.run(config(
        layer={"thickness": 1.0, "material": {"model": "zener", "G0": 0.0, "Ginf": 5.0, "tau": 0.5}},
        halfspace={"shear_modulus": math.inf}, grid={"geometry": "axisymmetric"},
        punch={"shape": "parabola", "radius": 0.1},
        trajectory={"control": "force", "force": 1e-6, "ramp_time": 1e-4},
        time={"end": 1.0, "step": "adaptive"}, output={"times": [0.1, 0.5, 1.0]},
    ))  # fmt: skip
    late = found.time.values > 0.05
    a, t = found.contact_radius.values[late], found.time.values[late] - 5e-5
    J = Zener(G0=0.0, Ginf=5.0, tau=0.5).creep_compliance(t)
    # Lee & Radok: a^3 = 3 (1 - nu) R F J(t)/8; the base, at 100 radii, stiffens by 1e-2 at most.
    np.testing.assert_allclose(a**3, 3 * 0.5 * 0.1 * 1e-6 * J / 8, rtol=2e-2)


def test_functions_take_liquids_over_time_and_refuse_them_at_rest():
    """Of a halfspace the force falls as exp(-t/tau) after a sudden depth; a^3 grows as J(t) under a force."""
    body, punch, times = (
        gfmdlayer.halfspace(Zener(0.0, 5.0, 0.5)),
        gfmdlayer.Parabola(radius=1.0),
        [0, 1e-4, 1.0],
    )
    held = gfmdlayer.indent(body, punch, times, depth=[0, 0.1, 0.1])
    late = held.time.values > 0.05
    ratio = held.force.values[late] / held.force.values[late][0]
    # The ramp is sudden to its half, 1e-4 of tau; the tolerance is 1e-4 of the largest force.
    np.testing.assert_allclose(
        ratio, np.exp(-(held.time.values[late] - held.time.values[late][0]) / 0.5), atol=1e-3
    )
    loaded = gfmdlayer.indent(body, punch, times, force=[0, 0.01, 0.01])
    late = loaded.time.values > 0.05
    J = 0.2 + (loaded.time.values[late] - 5e-5) / 2.5
    np.testing.assert_allclose(loaded.contact_radius.values[late] ** 3, 3 / 16 * 0.01 * J, rtol=2e-3)
    with pytest.raises(ConfigError, match="relaxed modulus of Zener is 0; give instantaneous=True"):
        gfmdlayer.solve(body, punch, depth=0.005, points=64)


def test_a_liquid_that_only_flows_has_the_compliance_of_a_dashpot():
    t = np.geomspace(1e-3, 1e3, 13)
    np.testing.assert_allclose(Zener(0.0, 5.0, 0.5).creep_compliance(t), 0.2 + t / 2.5, rtol=1e-12)


@pytest.mark.parametrize(
    "law",
    [Zener(1.0, 10.0, 2.0), pytest.param(Kohlrausch(1.0, 10.0, 2.0, 0.5), marks=pytest.mark.slow)],
    ids=lambda law: law.model,
)
def test_creep_and_relaxation_are_inverse(law):
    """The integral of G(t - x) J(x) over x is t: for all t, here by Gauss's rule in parts."""
    x, w = np.polynomial.legendre.leggauss(40)
    for t in (0.01, 1.0, 20.0):
        edges = np.concatenate(([0.0], t * np.geomspace(1e-10, 0.5, 40)))
        total = 0.0
        for first, last in pairwise(edges):
            at, weight = first + (last - first) * (x + 1) / 2, (last - first) * w / 2
            for one, other in ((at, t - at), (t - at, at)):
                total += float(weight @ (law.relaxation_modulus(one) * law.creep_compliance(other)))
        assert total == pytest.approx(t, rel=1e-8)  # the first part, 1e-10 of t, has no rule


# Material files carry their units.

FILE = """\
units: {length: m, stress: MPa, time: min}
layer: {material: {model: prony, G0: 0.5, branches: [{G: 2, tau: 3}]}}
"""
UNITS = {"length": "mm", "stress": "kPa", "time": "s"}


@pytest.fixture
def material(tmp_path):
    path = tmp_path / "rubber.yaml"
    path.write_text(FILE)
    return {"file": str(path)}


@pytest.mark.parametrize("where", ["layer", "halfspace", "layers", "counterbody"])
def test_a_material_file_is_converted_into_the_units_of_the_configuration(material, where):
    sections = {
        "layer": {"layer": {"material": material}}, "halfspace": {"halfspace": {"material": material}},
        "layers": {"layers": [{"thickness": 1.0, "material": material}]},
        "counterbody": {"counterbody": {"layer": {"thickness": 1.0, "material": material}}},
    }[where]  # fmt: skip
    found = next(law for law in config(units=UNITS, **sections).laws if isinstance(law, Prony))
    assert found == Prony(500.0, [(2000.0, 180.0)])


def test_a_material_file_with_units_is_refused_without_units_of_the_configuration(material):
    with pytest.raises(ConfigError, match="moduli in MPa and times in min, the configuration has no units"):
        config(layer={"material": material})
    Path(material["file"]).write_text(FILE.partition("\n")[2])
    assert config(layer={"material": material}).laws[0] == Prony(0.5, [(2.0, 3.0)])


def test_units_of_a_material_file_that_are_unknown_are_refused_at_their_place(material):
    Path(material["file"]).write_text(FILE.replace("MPa", "MPascal"))
    with pytest.raises(ConfigError, match=r"rubber.yaml:1:\d+: units.stress: got the text 'MPascal'"):
        config(units=UNITS, layer={"material": material})


def test_a_young_modulus_of_a_material_file_is_converted(tmp_path):
    path = tmp_path / "rubber.yaml"
    path.write_text(
        "units: {length: m, stress: MPa, time: s}\nlayer: {material: {model: elastic, young: 3.0}}\n"
    )
    own = config(units=UNITS, layer={"poisson": 0.5, "material": {"file": str(path)}})
    in_pascal = config(units=UNITS, layer={"poisson": 0.5, "material": {"model": "elastic", "young": 3.0e3}})
    assert own.laws[0].relaxed == pytest.approx(in_pascal.laws[0].relaxed, rel=1e-14)


def test_a_layer_in_python_takes_no_units_of_a_file(material):
    with pytest.raises(ConfigError, match="its file has units, which a configuration converts"):
        gfmdlayer.Layer(1.0, 0.4, {"file": material["file"]})


def test_a_body_whose_moduli_relax_alike_is_no_liquid():
    body = {"kind": "anisotropic", "C11": 3.0, "C12": 1.0, "C44": 1.0}
    with pytest.raises(ConfigError, match=r"body.material.G0: got 0: all moduli of this body relax relative"):
        config(body=body | {"material": {"model": "zener", "G0": 0.0, "Ginf": 2.0, "tau": 1.0}})
