"""A case has one body: made once from the keys of the configuration, and handed on to the run."""

import pytest

import gfmdlayer
from gfmdlayer import Case, Config, LayerStack, Pair

STEPS = {"grid": {"points": 64}, "time": {"end": 3.0, "step": 1.0}}
MAXWELL = {"model": "prony", "G0": 1.0, "branches": [{"G": 2.0, "tau": 0.5}]}
SPREAD = {"model": "fractional_zener", "exponent": 0.5}


@pytest.fixture
def made(monkeypatch):
    """The layered bodies that are made, in their order."""
    every, make = [], LayerStack.__init__

    def counted(body, *values, **keys):
        make(body, *values, **keys)
        every.append(body)

    monkeypatch.setattr(LayerStack, "__init__", counted)
    return every


@pytest.mark.parametrize("halfspace", [{"shear_modulus": 0.7}, {"material": {"model": "elastic", "G": 0.7}}])
def test_three_steps_on_a_layer_make_one_body(made, halfspace):
    layer = {"thickness": 0.0517, "material": MAXWELL}
    assert gfmdlayer.run(STEPS | {"layer": layer, "halfspace": halfspace}).sizes["time"] == 4
    assert len(made) == 1


@pytest.mark.parametrize(
    "keys",
    [
        {"layer": {"thickness": 0.0518, "material": SPREAD}},
        {"layers": [{"thickness": 0.0518, "material": MAXWELL}, {"thickness": 0.1, "material": {}}]},
    ],
)
def test_series_of_laws_and_merged_modes_make_one_more(made, keys):
    gfmdlayer.run(STEPS | keys)
    assert len(made) == 2


def test_each_of_two_bodies_is_made_once(made):
    own = {"layer": {"thickness": 0.0519, "material": MAXWELL}}
    gfmdlayer.run(STEPS | own | {"counterbody": {"layer": {"thickness": 0.0521, "material": MAXWELL}}})
    assert len(made) == 2


def test_the_body_of_a_run_is_that_of_the_configuration():
    config = Config(name="a", layer={"thickness": 0.0522, "material": MAXWELL})
    assert Case(config).body is config.solid
    both = Config(name="a", counterbody={"layer": {"thickness": 0.0523}})
    body = Case(both).body
    assert isinstance(body, Pair)
    assert body.first is both.solid.first
    assert body.second is both.solid.second
