"""`gfmdlayer.indent`: ways to give an indenter, and what is refused."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

import gfmdlayer

BODY = gfmdlayer.bonded_layer(1.0, gfmdlayer.Zener(1.0, 10.0, 1.0))


def test_an_indenter_is_a_shape_its_keys_or_a_table():
    r = np.linspace(0.0, 1.5, 301)
    given = (gfmdlayer.Parabola(radius=2.0), {"shape": "parabola", "radius": 2.0}, (r, r**2 / 4))
    forces = [float(gfmdlayer.indent(BODY, each, [0, 1], depth=[0, 0.1]).force[-1]) for each in given]
    np.testing.assert_allclose(forces, forces[0], rtol=1e-9)


def test_every_variable_has_a_meaning_and_units():
    found = gfmdlayer.indent(BODY, {"radius": 2.0}, [0, 1], depth=[0, 0.1], snapshots=[1.0])
    assert all(each.attrs.keys() == {"long_name", "units"} for each in found.variables.values())
    assert {name: found[name].attrs["units"] for name in ("force", "r", "pressure", "snapshot")} == {
        "force": "force",
        "r": "length",
        "pressure": "pressure",
        "snapshot": "time",
    }


@pytest.mark.parametrize(
    ("indenter", "time", "values", "said"),
    [
        ({"shape": "wedge", "slope": 0.1}, [0, 1], {"depth": [0, 0.1]}, "must be a shape of revolution"),
        ({"shape": "ball"}, [0, 1], {"depth": [0, 0.1]}, "shape: got 'ball'; must be one of parabola"),
        ({"radius": [1.0, 2.0]}, [0, 1], {"depth": [0, 0.1]}, "radius: got .*one number"),
        ({"radius": 1.0}, [0, 1], {}, "depth, force: got neither; must be one of the two"),
        ({"radius": 1.0}, [0, 1], {"depth": [0, 0.1], "force": [0, 1]}, "got both; must be one of the two"),
        ({"radius": 1.0}, [0, 1], {"depth": [0, 0.1], "work": "0.1"},
         "got '0.1'; must be a number"),
        ({"radius": 1.0}, [0, 1], {"depth": [0, 0.1], "edge_speed": 0.1}, "must have a work > 0"),
        ({"radius": 1.0}, [0, 1], {"depth": [0, 0.1], "tolerance": 1e-20}, "tolerance: got 1e-20; must be"),
        ({"radius": 1.0}, [0, 0], {"depth": [0, 0.1]}, "time: got 0 after 0; must ascend"),
        ({"radius": 1.0}, [0, 1], {"depth": [0, 0.1, 0.2]}, "depth: got shape"),
        ({"radius": 1.0}, [0, 1], {"depth": [0, np.nan]}, "must be finite"),
        ({"radius": 1.0}, [0, 1], {"depth": [0, 1.2]}, "must be above the rigid base, < 1.0"),
        ({"radius": 1.0}, [0, 1], {"force": [0, -1]}, "must be >= 0 without adhesion"),
        ({"radius": 1.0}, [0, 1], {"depth": [0, 0.1], "snapshots": [2.0]}, "between the first and the last"),
    ],
)  # fmt: skip
def test_impossible_input_is_refused(indenter, time, values, said):
    with pytest.raises((TypeError, ValueError), match=said):
        gfmdlayer.indent(BODY, indenter, time, **values)


def test_straight_lines_between_rows_are_right_and_rows_fall_at_further_times():
    """Zener, tau a tenth of the ramp: the force falls between long steps."""
    body = gfmdlayer.halfspace(gfmdlayer.Zener(1.0, 4.0, 0.05), poisson=0.5)
    fine = np.linspace(0.5, 1.0, 101)
    arguments = body, {"radius": 1.0}, [0, 0.5, 10]
    found = gfmdlayer.indent(*arguments, depth=[0, 0.1, 0.1], times=fine)
    assert set(fine) <= set(found["time"].values)
    assert found["depth"].sel(time=fine).values == pytest.approx(0.1, abs=1e-12)
    # Lee and Radok: the branch relaxes from the end of the ramp on.
    hertz, tau = 8 / 3 * 0.1**1.5 / 0.5, 0.05
    grid = np.linspace(0, 1, 200001)
    branch = hertz * trapezoid(1.5 * grid**0.5 * np.exp((grid - 1) * 0.5 / tau), grid)
    exact = hertz + 3.0 * branch * np.exp(-(fine - 0.5) / tau)
    assert np.abs(found["force"].sel(time=fine) - exact).max() < 2e-4 * exact.max()
    steps = gfmdlayer.indent(*arguments, depth=[0, 0.1, 0.1])
    assert np.abs(steps["force"].interp(time=fine) - exact).max() < 1.2e-3 * exact.max()
    assert steps.sizes["time"] < 150
    loaded = gfmdlayer.indent(*arguments, force=[0, 0.1, 0.1])
    middles = (loaded["time"].values[1:] + loaded["time"].values[:-1]) / 2
    between = gfmdlayer.indent(*arguments, force=[0, 0.1, 0.1], times=middles)["depth"].sel(time=middles)
    assert float(abs(loaded["depth"].interp(time=middles) - between).max()) < 1.2e-3 * float(between.max())
    with pytest.raises(ValueError, match="times: got"):
        gfmdlayer.indent(*arguments, depth=[0, 0.1, 0.1], times=[11.0])
