"""Friction of two bodies by the body that turns it into heat, against the loss compliance of each."""

import numpy as np
import pytest

import gfmdlayer

SPEED = 0.1
COATINGS = (
    {"thickness": 0.05, "poisson": 0.45, "material": {"model": "zener", "G0": 1.0, "Ginf": 10.0, "tau": 1.0}},
    {"thickness": 0.03, "poisson": 0.4, "material": {"model": "zener", "G0": 2.0, "Ginf": 8.0, "tau": 0.3}},
)
RIGID = {"shear_modulus": float("inf")}


def steady(ratio, **more):
    return gfmdlayer.run(
        {
            "grid": {"points": 256},
            "layer": COATINGS[0],
            "halfspace": RIGID,
            "counterbody": {"layer": COATINGS[1], "halfspace": RIGID, "velocity_ratio": ratio},
            "punch": {"shape": "parabola", "radius": 0.5},
            "trajectory": {"control": "load", "load": 0.05, "ramp_time": 0.5, "velocity": SPEED},
            "time": {"end": 200.0, "step": 0.5},
            "output": {"snapshots": [200.0]},
        }
        | more
    )


@pytest.mark.parametrize("ratio", [1.0, 0.5, 0.0])
def test_each_body_has_the_friction_of_its_loss_compliance(ratio):
    """A wave q of the pressure p passes body i at v_i: q v_i/v |p|^2 Im(-1/K(q, i q v_i))."""
    data = steady(ratio)
    last, pressure = data.isel(time=-1), data.pressure.isel(snapshot=-1).to_numpy()
    waves = np.fft.rfft(pressure)[1:-1] / pressure.size
    q = 2 * np.pi * np.arange(1, waves.size + 1)
    for name, coating, part in zip(("body", "counterbody"), COATINGS, (1.0, ratio), strict=True):
        material = gfmdlayer.Zener(**{k: v for k, v in coating["material"].items() if k != "model"})
        body = gfmdlayer.bonded_layer(coating["thickness"], material, poisson=coating["poisson"])
        lost = -np.imag(1 / body.stiffness(q, 1j * q * SPEED * part))
        expected = 2 * np.sum(q * part * abs(waves) ** 2 * lost) / pressure.mean()
        # Compliances relax within 10: the rest of the beginning is exp(-20).
        assert float(last[f"friction_{name}"]) == pytest.approx(expected, rel=1e-5, abs=1e-9)
    parts = float(last.friction_body + last.friction_counterbody)
    assert parts == pytest.approx(float(last.friction), rel=1e-5)


def test_the_parts_times_load_and_way_are_the_heat():
    data = steady(1.0, time={"end": 4.0, "step": 0.5}, output={})
    way = np.diff(data.position)
    for name in ("body", "counterbody"):
        heat = np.cumsum(data[f"friction_{name}"][1:] * data.mean_stress[1:] * way)
        np.testing.assert_allclose(heat, data[f"dissipated_{name}"][1:] - data[f"dissipated_{name}"][0])
        assert np.isnan(data[f"friction_{name}"][0])


def test_bodies_at_rest_and_states_found_at_once_have_no_such_columns():
    resting = steady(
        0.0, trajectory={"control": "load", "load": 0.05}, time={"end": 1.0, "step": 0.5}, output={}
    )
    assert "friction_body" not in resting
