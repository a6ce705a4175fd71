"""`gfmdlayer.solve`: one elastic contact against closed forms, and as the first step of a run."""

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import (
    ConfigError,
    ConvergenceError,
    Elastic,
    Exponential,
    Layer,
    LayerStack,
    Parabola,
    Sphere,
    Zener,
    bonded_layer,
    halfspace,
    solve,
)


@pytest.mark.parametrize("poisson", [0.5, 0.3, 0.0])
def test_a_sphere_on_a_halfspace_is_hertz(poisson):
    """Radius, largest pressure and approach; the cell of 12 contact widths adds (a/L)^3 at most.

    The radius is known to half a spacing, L/256/2 = 0.023 a.
    """
    G, R, F = 2.0, 8.0, 8e-4
    modulus = 2 * G / (1 - poisson)
    a = (3 * F * R / (4 * modulus)) ** (1 / 3)
    found = solve(halfspace(G, poisson=poisson), Parabola(radius=R), force=F, points=(256, 256))
    assert float(found.force) == pytest.approx(F, rel=1e-12)
    assert np.sqrt(found.contact_area / np.pi) == pytest.approx(a, abs=1 / 512)
    assert found.pressure.max() == pytest.approx(3 * F / (2 * np.pi * a**2), rel=5e-3)
    x, y = np.meshgrid(found.x, found.y, indexing="ij")
    inside = np.sqrt(np.maximum(1 - (x**2 + y**2) / a**2, 0)) * 3 * F / (2 * np.pi * a**2)
    assert np.abs(found.pressure - inside).mean() < 0.01 * float(found.mean_pressure)


@pytest.mark.parametrize("area", [0.1, 0.5, 0.9])
def test_a_wave_on_a_halfspace_is_westergaards(area):
    """Johnson, Contact Mechanics, section 13.2, with psi = pi x/L.

    The pressure is 2 p cos(psi) (sin^2 psi_a - sin^2 psi)^(1/2) / sin^2 psi_a; at its edge, the root of a
    spacing.
    """
    h, modulus, n = 0.01, 4.0, 2048
    edge = np.sin(np.pi * area / 2) ** 2
    mean = np.pi * modulus * h * edge
    found = solve(halfspace(1.0), lambda x: h * np.cos(2 * np.pi * x), mean_pressure=mean, points=n)
    assert float(found.contact_area) == pytest.approx(area, abs=2 / n)
    psi = np.pi * found.x.to_numpy()
    exact = 2 * mean / edge * np.cos(psi) * np.sqrt(np.maximum(edge - np.sin(psi) ** 2, 0))
    np.testing.assert_allclose(found.pressure, exact, rtol=0, atol=mean / edge * n**-0.5)
    # The surface keeps its mean: the mean gap is the mean height of the punch less its depth.
    assert float(found.depth) == pytest.approx(
        float((h - h * np.cos(2 * np.pi * found.x)).mean() - found.gap.mean())
    )


def test_a_parabola_on_a_thin_bonded_layer_presses_springs():
    """Each point carries its own spring, 2 G (1 - nu)/((1 - 2 nu) d), but for terms in (d/a)^2."""
    G, nu, d, R, depth = 3.0, 0.3, 0.0005, 1.0, 0.005
    spring, a = 2 * G * (1 - nu) / ((1 - 2 * nu) * d), np.sqrt(2 * R * depth)
    found = solve(bonded_layer(d, G, poisson=nu), lambda x: -(x**2) / (2 * R), depth=depth, points=4096)
    assert float(found.force) == pytest.approx(4 / 3 * spring * depth * a, rel=(d / a) ** 2)
    assert float(found.contact_area) == pytest.approx(2 * a, abs=2 / 4096)
    middle = abs(found.x) < a / 2
    exact = spring * (depth - found.x**2 / (2 * R))
    np.testing.assert_allclose(found.pressure[middle], exact[middle], rtol=(d / a) ** 2)


def test_a_free_layer_is_softer_than_a_halfspace_and_a_bonded_one_stiffer():
    forces = [
        float(solve(bonded_layer(0.05, 1.0, halfspace=base), Parabola(radius=0.25), depth=0.005).force)
        for base in (0.0, 0.5, 1.0, 2.0, np.inf)
    ]
    assert forces == sorted(forces)
    same = float(solve(halfspace(1.0), Parabola(radius=0.25), depth=0.005).force)
    assert forces[2] == pytest.approx(same, rel=1e-5)  # ten times the solver's tolerance


def test_depth_mean_pressure_and_force_give_the_same_contact():
    body, punch = bonded_layer(0.1, 2.0, poisson=0.4), Sphere(radius=2.0)
    by_depth = solve(body, punch, depth=0.01, period=(2.0, 1.0), points=(64, 32))
    for name in ("mean_pressure", "force"):
        value = {name: by_depth[name]}
        found = solve(body, punch, **value, period=(2.0, 1.0), points=(64, 32), tolerance=1e-9)
        np.testing.assert_allclose(
            found.pressure, by_depth.pressure, atol=1e-4 * float(by_depth.pressure.max())
        )
        assert float(found.depth) == pytest.approx(0.01, rel=1e-4)
    assert float(by_depth.force) == pytest.approx(2 * float(by_depth.mean_pressure))
    assert float(by_depth.contact.mean()) == float(by_depth.contact_area)
    assert (by_depth.gap.to_numpy()[~by_depth.contact.to_numpy()] > 0).all()


def test_a_viscoelastic_body_is_relaxed_or_glassy():
    """As a run that ends late, or that begins at once."""
    body, punch = bonded_layer(0.1, Zener(1.0, 5.0, 1.0), halfspace=1.0), Parabola(radius=0.25)
    slow, fast = (
        float(solve(body, punch, depth=0.005, points=256, instantaneous=now).force) for now in (False, True)
    )
    same = {
        "layer": {"thickness": 0.1, "material": {"Ginf": 5.0}},
        "grid": {"points": 256},
        "trajectory": {"depth": 0.005},
    }
    late = gfmdlayer.run(same, time__end=1e4, time__step=1e4, trajectory__ramp_time=5e3)
    once = gfmdlayer.run(same, time__end=1e-6, time__step=1e-6, trajectory__ramp_time=1e-6)
    assert slow == pytest.approx(2 * float(late.mean_pressure[-1]), rel=1e-3)
    assert fast == pytest.approx(2 * float(once.mean_pressure[-1]), rel=1e-5)


def test_the_punch_is_an_array_a_function_or_a_shape():
    x = np.arange(128) / 128 - 0.5
    found = [
        solve(halfspace(1.0), punch, depth=0.005, points=points)
        for punch, points in ((-2 * x**2, None), (lambda x: -2 * x**2, 128), (Parabola(radius=0.25), 128))
    ]
    for each in found[1:]:
        np.testing.assert_allclose(each.pressure, found[0].pressure, rtol=0, atol=1e-9)
    assert solve(halfspace(1.0), lambda x: -2 * x**2, depth=0.0).sizes == {"x": 1024}


REFUSED = {
    "nothing prescribed": ({}, "solve: got nothing; must be one of depth, mean_pressure and force"),
    "two prescribed": ({"depth": 1, "force": 1}, "solve: got depth and force; must be one of"),
    "a negative force": ({"force": -1}, "force: got -1; must be a number >= 0, finite"),
    "no number": ({"mean_pressure": np.nan}, "mean_pressure: got .nan; must be a number >= 0"),
    "no load of several": ({"depth": []}, "depth: got []; must be a number >= 0, finite, or several"),
    "rows of two lengths": ({"depth": [[1], [1, 2]]}, "depth: got a list of 2; must be a number >= 0"),
    "too deep": ({"depth": 1.0}, "depth: got 1 with this punch and a body whose mean height cannot change"),
    "few points": ({"depth": 0.01, "points": 4}, "points: got 4; must be a whole number >= 8"),
    "one period of two": (
        {"depth": 0.01, "points": (8, 8), "period": (1.0, -1.0)},
        "period[1]: got -1.0; must be a number > 0",
    ),
    "an unknown option": (
        {"depth": 0.01, "tolerence": 1},
        "tolerence: unknown argument; solve takes body, punch, depth, mean_pressure, force, period, ",
    ),
    "an unknown method": ({"depth": 0.01, "method": "fir"}, "method: got the text 'fir'; must be one of"),
    "a punch that does not fit": (
        {"depth": 0.01, "punch": Sphere(radius=0.2)},
        "punch.radius: got 0.2: the circle ends inside the cell",
    ),
    "holes": ({"depth": 0.01, "punch": [0.0, np.nan] * 8}, "punch: the height at index [1] is not a finite"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_impossible_arguments_are_refused_in_words(name):
    values, words = REFUSED[name]
    with pytest.raises(ConfigError) as caught:
        solve(halfspace(1.0), **({"punch": Parabola(radius=0.25)} | values))
    assert str(caught.value).startswith(words)


def test_a_body_without_a_modulus_is_refused():
    with pytest.raises(ConfigError, match=r"LayeredHalfspace has no spectrum.*must be a body"):
        solve(gfmdlayer.LayeredHalfspace(0.1, 0.5, 1.0), Parabola(), depth=0.01)
    with pytest.raises(ConfigError, match=r"poisson: got 0\.6; must be above -1 and at most 0\.5"):
        bonded_layer(0.1, 1.0, poisson=0.6)


def test_a_contact_that_does_not_converge_raises_with_its_state():
    with pytest.raises(
        ConvergenceError, match=r"after 3 iterations of fire; the tolerance is 1\.00e-06"
    ) as caught:
        solve(halfspace(1.0), Parabola(), depth=0.01, method="fire", max_iterations=3)
    assert caught.value.solution is not None
    assert caught.value.solution.residual > 1e-6


def test_an_attraction_pulls_the_surface_up():
    punch = Parabola(radius=0.25)
    alone, pulled = (
        solve(halfspace(1.0), punch, depth=0.005, points=256, **given)
        for given in ({}, {"interface": Exponential(work=1e-3, range=0.01)})
    )
    assert float(pulled.force) < float(alone.force)
    assert float(pulled.gap.min()) >= 0
    assert float(pulled.contact_area) >= float(alone.contact_area)


@pytest.mark.parametrize("friction", [{}, {"friction": 0.3}])
def test_a_stack_with_a_liquid_layer_answers_a_sudden_load_as_its_glassy_moduli(friction):
    """Its modes were taken without an end: the pressure was a thirtieth."""
    solid = Layer(thickness=0.4, poisson=0.4, material=Elastic(0.3))

    def on(law):
        return LayerStack(layers=[Layer(thickness=0.05, material=law), solid], rigid=True)

    liquid, glass = on(Zener(G0=0.0, Ginf=1.0, tau=1.0)), on(Elastic(1.0))
    given = {"punch": Parabola(radius=1.0), "depth": 0.01, "points": 64, **friction}
    sudden, elastic = solve(liquid, **given, instantaneous=True), solve(glass, **given)
    np.testing.assert_allclose(sudden.pressure, elastic.pressure, rtol=1e-9)
    with pytest.raises(ConfigError, match="relaxed modulus of Zener is 0; give instantaneous=True"):
        solve(liquid, **given)
    with pytest.raises(ConfigError, match="a layer of a stack has G0 = 0"):
        liquid.spectrum([1.0, 10.0])
