"""Runs on a surface that is isolated along one axis and periodic along the other."""

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.config import Config
from gfmdlayer.observables import columns

ZENER = {"model": "zener", "G0": 1.0, "Ginf": 10.0, "tau": 0.5}
LENGTH, ACROSS = 0.5, 0.125  # of the isolated axis, and of the other
GIVEN = {
    "name": "a",
    "layer": {"thickness": 0.1, "poisson": 0.45, "material": ZENER},
    "halfspace": {"shear_modulus": 5.0},
    "trajectory": {"depth": 0.01, "ramp_time": 1.0},
    "time": {"end": 2.0, "step": 0.0625},
}
COULOMB = {"law": "coulomb", "coefficient": 0.3}
SLIDE = {"depth": 0.01, "ramp_time": 1.0, "velocity": LENGTH / 64 / 0.0625}


def line(**keys):
    """A cylinder on a line."""
    grid = {"points": 64, "period": LENGTH, "boundary": "isolated", "datum": 1.0}
    return gfmdlayer.run(GIVEN | {"grid": grid, "punch": {"shape": "cylinder", "radius": 1.0}} | keys)


def roller(axis, **keys):
    """The same along one axis of a surface, which is uniform along the other."""
    turn = slice(None, None, 1 - 2 * axis)
    grid = {
        "points": [64, 16][turn], "period": [LENGTH, ACROSS][turn], "datum": 1.0,
        "boundary": ["isolated", "periodic"][turn],
    }  # fmt: skip
    punch = {"shape": "cylinder", "radius": 1.0, "along": "yx"[axis]}
    return gfmdlayer.run(GIVEN | {"grid": grid, "punch": punch} | keys)


# Both responses are fits, within 1e-5 of the one without images in these cells; those of friction are not.
RUNS = {
    "ramp and hold": ({}, ("force", "area", "work", "stored")),
    "adaptive steps": ({"time": {"end": 2.0, "step": "adaptive"}}, ("force", "area")),
    "hardness": ({"interface": {"law": "hard_wall", "hardness": 1.0}}, ("force", "area", "plastic_work")),
    "two bodies": (
        {"counterbody": {"layer": {"material": ZENER}, "halfspace": {"shear_modulus": 3.0}}},
        ("force", "area"),
    ),
    "adhesion": (
        {"interface": {"law": "exponential", "work": 1e-4, "range": 4e-4},
         "trajectory": {"depth": 0.002, "ramp_time": 1.0}},
        ("force", "area"),
    ),
    "resistance and stiffness": (
        {"output": {"conductance": {"body": {"resistivity": 1.0}}, "stiffness": {"frequencies": [1.0]}}},
        ("storage_stiffness",),
    ),
    "friction": (
        {"interface": COULOMB,
         "trajectory": {"depth": 0.01, "ramp_time": 1.0, "tangential": {"displacement": 0.005}}},
        ("force", "area", "stored", "tangential_force", "slip_heat"),
    ),
    "sliding": ({"trajectory": SLIDE}, ("force", "area", "drag_force")),
    "sliding with friction": ({"trajectory": SLIDE, "interface": COULOMB}, ("force", "tangential_force")),
}  # fmt: skip


@pytest.mark.parametrize("name", RUNS)
def test_a_roller_is_a_line_contact_times_the_period(name):
    keys, names = RUNS[name]
    one, whole = line(**keys), roller(0, **keys)
    for column in names:
        value, expected = whole[column].values.ravel() / ACROSS, one[column].values.ravel()
        assert value == pytest.approx(expected, rel=5e-5, abs=5e-5 * np.abs(expected).max()), column
    if "resistance" in one:
        assert whole.resistance.values[-1] * ACROSS == pytest.approx(one.resistance.values[-1], rel=1e-6)


def test_either_axis_may_be_isolated():
    """The same problem turned: to rounding, and the tolerance of the solver."""
    one, other = roller(0), roller(1)
    assert other.force.values == pytest.approx(one.force.values, rel=1e-6)
    assert (other.area == one.area).all()


def test_material_that_moves_along_the_periodic_axis_comes_back():
    """Along a surface that is uniform in this direction a sliding roller relaxes like one at rest."""
    slides = {"trajectory": {"depth": 0.01, "ramp_time": 1.0, "velocity": 0.1}}
    still, moving = roller(1), roller(1, **slides)
    # The memory of tractions, with exact kernels, against relaxing modes that are a fit within 1e-5.
    assert moving.force.values == pytest.approx(still.force.values, abs=1e-4 * float(still.force.max()))
    assert np.abs(moving.drag_force).max() < 1e-9 * still.force.max()


def test_words_of_a_surface_that_goes_on():
    grid = {"points": [16, 16], "boundary": ["isolated", "periodic"], "datum": 2.0}
    found = {each.name: each for each in columns(Config(name="a", grid=grid))}
    assert found["area"].origin.startswith("of one period")
    assert found["area"].units == "length^2"
    assert "mean_pressure" not in found


def test_two_equal_words_are_one():
    one, two = (
        Config(name="a", grid={"points": [16, 16], "boundary": boundary})
        for boundary in ("isolated", ["isolated", "isolated"])
    )
    assert one == two
    assert two.grid.model_dump()["boundary"] == "isolated"
    both = Config(name="a", grid={"points": [16, 16], "boundary": ["periodic", "isolated"], "datum": 2.0})
    assert both.grid.model_dump()["boundary"] == ("periodic", "isolated")


def test_the_cell_grows_along_the_isolated_axis_alone():
    """A cylinder that is 0.7 windows wide under the largest depth."""
    grid = {"points": [32, 16], "period": [0.2, 0.1], "boundary": ["isolated", "periodic"], "datum": 1.0}
    keys = {"punch": {"shape": "cylinder", "radius": 1.0}, "time": {"end": 1.0, "step": 0.25}}
    small = gfmdlayer.run(GIVEN | {"grid": grid} | keys)
    grid |= {"points": [64, 16], "period": [0.4, 0.1]}
    large = gfmdlayer.run(GIVEN | {"grid": grid} | keys)
    assert "x 16 points" in small.attrs["cell"]
    assert "cell" not in large.attrs
    assert small.force.values == pytest.approx(large.force.values, rel=1e-4)
