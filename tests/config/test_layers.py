"""Stacks of layers in a configuration: what is refused, and entries of lists in dotted keys."""

import math

import pytest

from gfmdlayer.body.layers import LayerStack
from gfmdlayer.body.materials import Zener
from gfmdlayer.case.case import Case
from gfmdlayer.config import Config, ConfigError
from gfmdlayer.config.sweeps import leaves
from gfmdlayer.results.names import parameter
from gfmdlayer.study.cases import cases
from tests.config.reading import problems, read

STACK = """\
name: stack
grid: {points: 64}
layers:
  - {thickness: 0.01, poisson: 0.4, material: {model: prony, G0: 2.0, branches: [{G: 1, tau: 0.1}]}}
  - {thickness: 0.2, material: {G0: 1.0, Ginf: 3.0}}
halfspace: {poisson: 0.3, material: {G0: 20.0, Ginf: 30.0}}
"""


def test_the_stack_is_the_body(tmp_path):
    config = read(tmp_path, STACK)
    assert "\nlayer:" not in config.dump()
    body = Case(config).body
    assert isinstance(body, LayerStack)
    assert [layer.thickness for layer in body.layers] == [0.01, 0.2, math.inf]
    assert [layer.poisson for layer in body.layers] == [0.4, 0.5, 0.3]
    assert body.layers[2].material == Zener(20.0, 30.0, 1.0)
    assert body.accuracy == config.solver.tolerance
    assert not body.rigid
    assert config.solid.unit == 2.0
    rigid = Case(config.with_values({"halfspace": {"shear_modulus": math.inf}})).body
    assert isinstance(rigid, LayerStack)
    assert (rigid.rigid, len(rigid.layers)) == (True, 2)


def test_one_layer_is_the_same_in_either_form():
    """The special formulas of one layer stand for the stack of one, on an elastic base in either form."""
    material = {"model": "zener", "G0": 1.0, "Ginf": 4.0}
    alone = Config.model_validate({"name": "a", "layer": {"thickness": 0.1, "material": material}})
    listed = Config.model_validate({"name": "a", "layers": [{"thickness": 0.1, "material": material}]})
    based = listed.with_values({"halfspace": {"material": {"model": "elastic", "G": 1.0}}})
    body = Case(alone).body
    assert body.closed_form is not None
    assert Case(listed).body == body
    assert Case(based).body == body


def test_defaults_have_one_layer_and_no_list():
    config = Config(name="x")
    assert config.layers is None
    assert "layers" not in config.model_dump(exclude_none=True)
    assert not any(key.startswith("layers") for key in leaves(config))


REFUSED = {
    "both": (STACK + "layer: {thickness: 1}\n", "3:1: layers: given beside layer", "one of the two"),
    "none": ("name: x\nlayers: []\n", "2:9: layers: got an empty list", "{thickness: ...}"),
    "no thickness": ("name: x\nlayers: [{poisson: 0.3}]\n", "2:10: layers[0].thickness: missing", "or .inf"),
    "infinite above another": ("name: x\nlayers: [{thickness: .inf}, {thickness: 1}]\n",
     "2:22: layers[0].thickness: got .inf above another layer", "only the last"),
    "nothing on a rigid base": (
     "name: x\nlayers: [{thickness: 0}, {thickness: 0}]\nhalfspace: {shear_modulus: .inf}\n",
     "2:22: layers[0].thickness: got 0 on a rigid halfspace", "must be > 0"),
    "floating": ("name: x\nlayers: [{thickness: 0}]\nhalfspace: {shear_modulus: 0}\n",
     "2:22: layers[0].thickness: got 0 on a halfspace without stiffness", "must be > 0"),
    "two moduli of the base": ("name: x\nhalfspace: {shear_modulus: 2, material: {G0: 1}}\n",
     "2:28: halfspace.shear_modulus: given beside material", "remove one"),
    "unknown law": ("name: x\nlayers: [{thickness: 1, material: {model: zenner}}]\n",
     "2:43: layers[0].material.model: got the text 'zenner'", "did you mean 'zener'?"),
    "relaxation that stiffens": ("name: x\nlayers: [{thickness: 1}, {thickness: 1, material: {Ginf: 0.5}}]\n",
     "2:58: layers[1].material.Ginf: got 0.5, below G0", "G0"),
    "swept beyond the list": (STACK + "sweep: {layers.2.thickness: [1, 2]}\n",
     "7:9: sweep.layers.2.thickness: layers has 2 entries, and 2 is not one of them", "layers.0 or layers.1"),
    "no place": (STACK + "sweep: {layers.top.thickness: [1, 2]}\n",
     "sweep.layers.top.thickness: layers has 2 entries, and top is not one of them", "layers.0 or layers.1"),
    "swept key misspelt": (STACK + "sweep: {layers.1.material.Gin: [4, 5]}\n",
     "sweep.layers.1.material.Gin: unknown key", "did you mean 'layers.1.material.Ginf'?"),
    "swept value": (STACK + "sweep: {layers.1.thickness: [0.1, -1]}\n",
     "7:35: sweep.layers.1.thickness[1]: got -1", "number >= 0"),
    "swept out of order": (STACK + "sweep: {layers.0.thickness: [0.1, .inf]}\n",
     "7:35: sweep.layers.0.thickness[1]: got .inf above another layer", "only the last"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "place", "allowed"), REFUSED.values(), ids=REFUSED)
def test_refused_with_place_and_what_is_allowed(tmp_path, content, place, allowed):
    (message,) = problems(tmp_path, content)
    assert place in message
    assert allowed in message


def test_all_errors_of_a_list_are_reported_at_once(tmp_path):
    wrong = "[{thickness: -1}, {thickness: 1, poisson: 2, material: {tau: 0}}]"
    found = problems(tmp_path, f"name: x\nlayers: {wrong}\nsolver: {{tol: 1}}\n")
    for key in ("layers[0].thickness", "layers[1].poisson", "layers[1].material.tau", "solver.tol"):
        assert key in " ".join(found)
    assert len(found) == 4


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("layers.2.thickness=1", "--set: layers.2.thickness: layers has 2 entries, and 2 is not one"),
        ("layers.x.thickness=1", "--set: layers.x.thickness: layers has 2 entries, and x is not one"),
        ("layers.0.material.branches.1.G=2", "has 1 entry, and 1 is not one of them"),
        ("layers.0.thicknes=1", "--set: layers[0].thicknes: unknown key"),
        ("grid.0=1", "--set: grid.0: grid is not a list"),
    ],
)
def test_options_name_entries_that_exist(tmp_path, override, message):
    (found,) = problems(tmp_path, STACK, override)
    assert message in found


def test_options_and_sweeps_set_entries(tmp_path):
    swept = "sweep: {layers.1.thickness: [0.3, 0.4], layers.0.material.branches.0.G: [5, 6]}\n"
    config = read(tmp_path, STACK + swept, "layers.0.thickness=0.05", "halfspace.material.Ginf=40")
    found = [case.config for case in cases(config)]
    assert [case.solid.thicknesses[1] for case in found] == [0.3, 0.3, 0.4, 0.4]
    assert [case.laws[0].branches[0].G for case in found] == [5, 6, 5, 6]
    assert {case.solid.thicknesses[0] for case in found} == {0.05}
    assert found[0].laws[2].glassy == 40
    law = {"model": "prony", "branches": [{"G": 1, "tau": 1}]}
    single = Config(name="x").with_values({"layer.material": law})
    assert single.with_values({"layer.material.branches.0.tau": 3}).laws[0].branches[0].tau == 3
    with pytest.raises(ConfigError, match=r"branches has 1 entry, and 4 is not one"):
        single.with_values({"layer.material.branches.4.tau": 3})


def test_samples_are_drawn_of_entries(tmp_path):
    drawn = "sweep: {sobol: {samples: 4, layers.1.thickness: {from: 0.1, to: 1}}}\n"
    depths = [case.config.solid.thicknesses[1] for case in cases(read(tmp_path, STACK + drawn))]
    assert len(set(depths)) == 4
    assert all(0.1 <= depth <= 1 for depth in depths)


def test_symbols_count_layers_from_one():
    for key, symbol, name in (
        ("layers.0.thickness", "d_1", "thickness of layer 1"),
        ("layers.1.material.Ginf", "G_inf,2", "glassy modulus of layer 2"),
        ("halfspace.material.G0", "G_0,bulk", "relaxed modulus of the halfspace"),
    ):
        found = parameter(key)
        assert found is not None
        assert (found.symbol, found.long_name) == (symbol, name)
    assert parameter("layers.0.material.shift") is None
