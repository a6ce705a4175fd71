"""`gfmdlayer.solve` with friction: labelled fields, steps one after the other, and bad input."""

import numpy as np
import pytest

from gfmdlayer import ConfigError, Lattice, Pair, Parabola, Zener, bonded_layer, halfspace, solve

PRESS = {"punch": Parabola(radius=0.25), "force": 0.002, "points": 256, "friction": 0.4}


def test_a_step_back_is_mindlins_superposition():
    """From Q_1 back to Q_2: t = mu (p(P) - p(P - Q_1/mu) - 2 (p(P) - p(P - (Q_1 - Q_2)/(2 mu)))).

    Mindlin and Deresiewicz; both responses are equal. Residuals are 1e-7, pressures amplify them by 10.
    """
    body, mu, P, Q1, Q2 = halfspace(1.0), 0.4, 0.002, 0.0006, 0.0002
    there = solve(body, **PRESS, tangential_force=Q1)
    back = solve(body, **PRESS, tangential_force=Q2, previous=there)
    p, after_1, after_2 = (
        solve(body, **(PRESS | {"force": part, "friction": 0.0})).pressure
        for part in (P, P - Q1 / mu, P - 0.5 * (Q1 - Q2) / mu)
    )
    expected = mu * ((p - after_1) - 2 * (p - after_2))
    np.testing.assert_allclose(back.shear_x, expected, atol=3e-6 * mu * float(p.max()))
    assert float(back.tangential_force_x) == pytest.approx(Q2, rel=1e-6)
    assert 0 < float(back.tangential_displacement_x) < float(there.tangential_displacement_x)
    again = solve(
        body, **PRESS, tangential_displacement=float(back.tangential_displacement_x), previous=there
    )
    np.testing.assert_allclose(again.shear_x, back.shear_x, atol=3e-6 * mu * float(p.max()))


def test_fields_are_labelled_and_frictionless_contact_is_that_without_friction():
    body = halfspace(1.0, poisson=0.2)
    given = PRESS | {"points": (64, 64), "force": 0.01}
    found = solve(body, **(given | {"friction": 0.0}))
    plain = solve(
        body, **{name: value for name, value in given.items() if name != "friction"}, tolerance=1e-7
    )
    np.testing.assert_allclose(found.pressure, plain.pressure, atol=1e-5 * float(plain.pressure.max()))
    np.testing.assert_allclose(found.displacement, plain.displacement, atol=1e-6 * float(plain.depth))
    assert float(found.depth) == pytest.approx(float(plain.depth), rel=1e-6)
    sheared = solve(body, **given, tangential_force=(0.0, 0.002))
    assert sheared.shear_y.dims == ("x", "y")
    assert sheared.shear_y.attrs["units"] == "pressure"
    assert sheared.slip_x.attrs["units"] == "length"
    assert float(sheared.tangential_force_y) == pytest.approx(0.002, rel=1e-6)
    assert 0 < float(sheared.stick_area) < float(sheared.contact_area)
    assert not (set(sheared.variables) - {"x", "y"}) & {
        n for n in sheared if not sheared[n].attrs["long_name"]
    }


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"friction": -0.1}, r"friction\.coefficient: got -0\.1; must be a number >= 0"),
        ({"friction": [[0.3]]}, r"friction\.coefficient: got a list of 1; must be a number >= 0"),
        ({"friction": {"mu": 0.1}},
         "friction: got mu; must be a number, or a mapping of coefficient, strength"),
        ({"tangential_force": 0.0009}, "tangential_force: .* the punch slides away"),
        ({"tangential_force": (0.0, 1.0)}, r"tangential_force: got .*; must be a number, finite"),
        ({"tangential_force": 0.0, "tangential_displacement": 0.0}, "must be one of the two"),
        ({"isolated": True}, "isolated: a line on a halfspace has no depth of its own"),
        ({"isolated": True, "force": None, "mean_pressure": 0.002}, "must be depth or force"),
        ({"method": "fire"}, "method: not with friction"),
        ({"previous": "without friction"}, "has no displ"),
    ],
)  # fmt: skip
def test_bad_input_is_named(given, message):
    if "previous" in given:
        given = {"previous": solve(halfspace(1.0), Parabola(radius=0.25), force=0.002, points=256)}
    with pytest.raises(ConfigError, match=message):
        solve(halfspace(1.0), **(PRESS | given))


def test_a_layer_like_the_halfspace_below_it_vanishes():
    """The two responses are equal to 1e-11, so the solutions differ by the residual 1e-7 times the points."""
    given = PRESS | {"tangential_force": 0.0006}
    for poisson in (0.5, 0.3):
        bare = solve(halfspace(1.0, poisson=poisson), **given)
        layered = solve(
            bonded_layer(0.05, 1.0, poisson=poisson, halfspace=1.0, halfspace_poisson=poisson), **given
        )
        for name in ("pressure", "shear_x", "displacement", "displacement_x"):
            np.testing.assert_allclose(layered[name], bare[name], atol=2e-5 * float(abs(bare[name]).max()))


def test_a_thin_layer_that_sticks_is_sheared_evenly():
    """Q = G D 2a/d; the edges add a length of the order of d to the contact, here less than 2 d to 80 d."""
    G, d, D = 2.0, 0.005, 1e-4
    body = bonded_layer(d, Zener(G0=G, Ginf=10 * G, tau=1.0), poisson=0.4)
    given = {"friction": np.inf, "tangential_displacement": D, "points": 2048}

    def flat(x):
        return np.where(np.abs(x) < 0.2, 0.0, -1.0)

    found = solve(body, flat, depth=1e-4, **given)
    width = float(found.contact.mean())
    assert width == pytest.approx(0.4, abs=1 / 1024)
    assert float(found.tangential_force_x) == pytest.approx(G * D * width / d, rel=2 * d / width)
    middle = abs(found.x) < 0.1
    mean = float(found.shear_x.where(middle).mean())  # points alternate by 2e-3, because of the edges
    assert mean == pytest.approx(G * D / d, rel=1e-4)
    sudden = solve(body, flat, depth=1e-4, instantaneous=True, **given)
    assert float(sudden.tangential_force_x) == pytest.approx(10 * float(found.tangential_force_x), rel=1e-5)


def test_friction_needs_its_coefficient_and_a_body_that_responds_to_shear():
    alone = {name: value for name, value in PRESS.items() if name != "friction"}
    with pytest.raises(ConfigError, match="tangential_force: only with friction"):
        solve(halfspace(1.0), **alone, tangential_force=0.1)
    pair = Pair(halfspace(1.0), Lattice(nearest=1.0, spacing=1 / 256))
    with pytest.raises(
        ConfigError, match="body: Lattice has no response to shear; must be a halfspace or layers"
    ):
        solve(pair, **PRESS)
