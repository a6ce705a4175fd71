"""Axisymmetric cases: temperature over time against Lee & Radok, adhesion against JKR."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

import gfmdlayer
from gfmdlayer.body.shifts import WLF
from gfmdlayer.history.reduced_time import ReducedTime
from gfmdlayer.time_functions import Table

RADIUS, WORK = 0.5, 1e-4


def sphere(**material):
    """Return body and indenter."""
    return {
        "name": "a",
        "grid": {"geometry": "axisymmetric", "points": 16},
        "layer": {"thickness": math.inf, "poisson": 0.5, "material": material},
        "punch": {"radius": RADIUS},
    }


SHIFT = {"law": "wlf", "C1": 17.44, "C2": 51.6, "reference": 20.0}


def test_the_force_on_a_sphere_follows_the_temperature_as_lee_and_radok_have_it(tmp_path):
    """While contact grows, F(t) = 4/3 R^(1/2)/(1 - nu) 2 int G(xi(t) - xi(s)) d(depth^(3/2)), xi reduced."""
    tau, depth, tolerance = 0.5, 0.02, 1e-4
    (tmp_path / "rise.txt").write_text("0 18\n0.5 18\n1.5 26\n2 26\n")
    found = gfmdlayer.run(
        {
            **sphere(model="zener", G0=1.0, Ginf=6.0, tau=tau, shift=SHIFT),
            "trajectory": {"depth": depth, "ramp_time": 2.0},
            "temperature": {"file": str(tmp_path / "rise.txt")},
            "time": {"end": 2.0, "step": "adaptive", "tolerance": tolerance},
            "output": {"times": [0.4, 1.0, 1.6, 2.0], "snapshots": [1.0]},
        }
    )
    rise = Table(np.array([0.0, 0.5, 1.5, 2.0]), np.array([18.0, 18.0, 26.0, 26.0]))
    xi = ReducedTime(WLF(**SHIFT), rise)

    def force(t):
        def rate(s):
            modulus = 1.0 + 5.0 * math.exp(-(xi.step(0.0, t) - xi.step(0.0, s)) / tau)
            return modulus * 1.5 * (depth / 2) ** 1.5 * s**0.5

        return (
            4 / 3 * RADIUS**0.5 * 4 * quad(rate, 0.0, t, points=[each for each in (0.5, 1.5) if each < t])[0]
        )

    expected = [force(t) for t in (0.4, 1.0, 1.6, 2.0)]
    assert found.force.sel(time=[0.4, 1.0, 1.6, 2.0]).values == pytest.approx(
        expected, abs=2 * tolerance * max(expected)
    )
    assert found.snapshot.values.tolist() == pytest.approx([1.0], rel=1e-14)


def test_a_sphere_with_adhesion_without_a_range_is_torn_off_by_the_force_of_jkr():
    law = {"law": "short_range", "work": WORK}
    config = {
        **sphere(model="elastic", G=1.0),
        "interface": law,
        "trajectory": {"kind": "approach_retract", "depth": 0.005, "final": -0.01, "approach_speed": 0.01},
        "time": {"step": "adaptive", "tolerance": 1e-4},
    }
    found = gfmdlayer.run(config)
    assert -float(found.force.min()) == pytest.approx(1.5 * math.pi * WORK * RADIUS, rel=1e-3)
    times, depths = [0.0, 0.5, 2.0], [0.0, 0.005, -0.01]
    body = gfmdlayer.halfspace(1.0, poisson=0.5)
    alone = gfmdlayer.indent(body, gfmdlayer.Parabola(radius=RADIUS), times, depth=depths, work=WORK)
    np.testing.assert_array_equal(found.force, alone.force)


def test_a_grid_refuses_adhesion_without_a_range():
    with pytest.raises(gfmdlayer.ConfigError, match="must have a range that the grid resolves"):
        gfmdlayer.Config(name="a", interface={"law": "short_range", "work": WORK})


def test_two_bodies_deform_like_one_whose_compliance_is_their_sum():
    """Halfspaces against Hertz, 1/E* = 1/E*_1 + 1/E*_2; a layer and a halfspace in either order."""
    depth = {"trajectory": {"depth": 0.01}, "time": {"end": 2.0, "step": "adaptive", "tolerance": 1e-5}}
    half = {"halfspace": {"shear_modulus": 3.0, "poisson": 0.3}}
    found = gfmdlayer.run({**sphere(model="elastic", G=1.0), **depth, "counterbody": half})
    modulus = 1 / (0.5 / 2 + 0.7 / (2 * 3.0))
    assert float(found.force[-1]) == pytest.approx(4 / 3 * modulus * RADIUS**0.5 * 0.01**1.5, rel=1e-6)
    layer = {"layer": {"thickness": 0.1, "poisson": 0.4}, "halfspace": {"shear_modulus": 8.0}}
    rubber = sphere(model="zener", G0=2.0, Ginf=6.0, tau=0.3)
    soft = {key: rubber[key] for key in ("layer",)}
    one = gfmdlayer.run({**rubber, **depth, "counterbody": layer})
    other = gfmdlayer.run({**rubber, **layer, **depth, "counterbody": soft})
    assert float(other.force[-1]) == pytest.approx(float(one.force[-1]), rel=2e-5)
    with pytest.raises(gfmdlayer.ConfigError, match=r"counterbody\.halfspace\.shear_modulus: got 0"):
        gfmdlayer.Config(**rubber, counterbody={**layer, "halfspace": {"shear_modulus": 0}})
