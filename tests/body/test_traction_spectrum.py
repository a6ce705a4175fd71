"""Tractions in all directions: closed forms, the equations of elasticity, the normal response."""

import math

import numpy as np
import pytest
from mpmath import mp

from gfmdlayer.body.layer import Layer
from gfmdlayer.body.layers import LayerStack, bonded_layer
from gfmdlayer.body.materials import Prony, Zener
from tests.body.printed import layer_matrix, surface_stiffness

# Of K: some tens of roundings in each of the layers, times the condition of the modes, (Ginf/G0)^(1/2).
ROUNDING = 1e-11

LAYERS = (
    Layer(0.1, 0.45, Prony(1.0, [(4.0, 0.1), (20.0, 2.0)])),
    Layer(0.03, 0.2, Prony(30.0, [(10.0, 0.5)])),
    Layer(0.2, 0.5, Zener()),
)
BASE = Layer(math.inf, 0.3, Prony(5.0, [(2.0, 0.05)]))
STACKS = {
    "halfspace": LayerStack((*LAYERS, BASE)), "rigid": LayerStack(LAYERS, rigid=True),
    "free": LayerStack(LAYERS), "bare": LayerStack((BASE,)), "one": LayerStack(LAYERS[:1], rigid=True),
}  # fmt: skip
Q = np.array([0.4, 3.0, 12.0, 60.0, 239.0, 241.0, 5e3])
FREQUENCIES = (0.0, 1e-3, 0.3, 10.0, 1e4)


@pytest.mark.parametrize("q", [0.5, 4.0, 15.0])
@pytest.mark.parametrize("s", [0.0, 0.7, 1e3])
def test_shear_across_the_wave_passes_through_two_layers_to_a_rigid_base(q, s):
    G, d = zip(*((float(each.material.laplace(s)), each.thickness) for each in LAYERS[:2]), strict=True)
    below, top, t = G[1] * q / math.tanh(q * d[1]), G[0] * q, math.tanh(q * d[0])
    found = LayerStack(LAYERS[:2], rigid=True).traction_spectrum([q]).across.stiffness(s)[0]
    assert found == pytest.approx(top * (below + top * t) / (top + below * t))


@pytest.mark.parametrize("stack", STACKS.values(), ids=STACKS)
def test_without_shear_it_is_the_normal_response(stack):
    spectrum = stack.traction_spectrum(Q).in_plane
    for s in FREQUENCIES:
        K = spectrum.stiffness(s)
        normal = K[:, 0, 0] - K[:, 0, 1] ** 2 / K[:, 1, 1]
        np.testing.assert_allclose(normal, stack.stiffness(Q, s), rtol=ROUNDING)


def test_a_halfspace_has_the_closed_form():
    found, (nu, q, s) = STACKS["bare"].traction_spectrum(Q), (0.3, Q, 3.0)
    G = float(BASE.material.laplace(s))
    C = np.array([[2 * (1 - nu), 1 - 2 * nu], [1 - 2 * nu, 2 * (1 - nu)]]) / 2
    expected = np.multiply.outer(1 / (G * q), C)
    np.testing.assert_allclose(np.linalg.inv(found.in_plane.stiffness(s)), expected, rtol=1e-13)
    np.testing.assert_allclose(found.across.stiffness(s), G * q, rtol=1e-13)


def test_a_layer_like_the_halfspace_below_it_vanishes():
    found = LayerStack((Layer(0.07, 0.3, BASE.material), BASE)).traction_spectrum(Q)
    bare = STACKS["bare"].traction_spectrum(Q)
    for s in FREQUENCIES:
        for one, other in ((found.in_plane, bare.in_plane), (found.across, bare.across)):
            expected = other.stiffness(s)
            np.testing.assert_allclose(one.stiffness(s), expected, rtol=0, atol=ROUNDING * expected.max())


def test_a_deep_wave_feels_the_uppermost_layer_alone_and_continuously():
    """The modes are found in another way from q d = 24 on."""
    d = LAYERS[0].thickness
    q = np.array([24 - 1e-9, 24 + 1e-9]) / d
    for stack in (STACKS["halfspace"], STACKS["one"]):
        found = stack.traction_spectrum(q)
        for s in FREQUENCIES:
            for K in (found.in_plane.stiffness(s), found.across.stiffness(s)):
                np.testing.assert_allclose(K[0], K[1], rtol=1e-9)


def test_the_mean_is_sheared_in_series_on_a_rigid_base_and_fixed_elsewhere():
    """A uniform pressure and a uniform shear do not couple."""
    stack, s = LayerStack((LAYERS[0], LAYERS[1]), rigid=True), 0.7
    found = stack.traction_spectrum([0.0])
    shear = 1 / sum(each.thickness / float(each.material.laplace(s)) for each in stack.layers)
    K = found.in_plane.stiffness(s)[0]
    expected = np.diag([float(stack.stiffness(0.0, s)), shear])
    np.testing.assert_allclose(K, expected, rtol=ROUNDING, atol=ROUNDING)
    assert found.across.stiffness(s)[0] == pytest.approx(shear, rel=ROUNDING)
    for fixed in (STACKS["halfspace"], STACKS["free"], STACKS["bare"]):
        mean = fixed.traction_spectrum([0.0])
        assert not mean.in_plane.stiffness(s).any()
        assert not mean.across.stiffness(s).any()


def test_modes_are_positive_and_one_for_each_wave_of_any_shape():
    q = np.array([[3.0, 60.0], [3.0, 1e3]])
    found = STACKS["halfspace"].traction_spectrum(q)
    assert np.linalg.eigvalsh(found.in_plane.relaxed).min() > 0
    assert (found.in_plane.times > 0).all()
    assert (found.across.weights >= 0).all()
    assert found.in_plane.relaxed.shape == (2, 2, 2, 2)
    np.testing.assert_array_equal(found.in_plane.vectors[:, 0, 0], found.in_plane.vectors[:, 1, 0])
    assert (np.linalg.eigvalsh(found.in_plane.glassy) > np.linalg.eigvalsh(found.in_plane.relaxed)).all()
    assert np.shape(found.across.times)[1:] == (2, 2)


@pytest.mark.parametrize(("base", "thickness"), [(2.0, 0.05), (math.inf, 0.05), (0.0, math.inf)])
def test_the_layer_of_the_paper_is_a_stack(base, thickness):
    body = bonded_layer(thickness, Zener(), poisson=0.4, halfspace=base, halfspace_poisson=0.3)
    K = body.traction_spectrum(Q).in_plane.stiffness(0.5)
    normal = K[:, 0, 0] - K[:, 0, 1] ** 2 / K[:, 1, 1]
    np.testing.assert_allclose(normal, body.stiffness(Q, 0.5), rtol=ROUNDING)


def random_stack(random):
    """Return one to five layers whose moduli, times and thicknesses differ by orders of magnitude."""

    def layer(thickness):
        branches = [tuple(10 ** random.uniform(-3, 3, 2)) for _ in range(random.integers(3))]
        poisson = random.choice([0.5, 0.4999, random.uniform(-0.5, 0.5)])
        return Layer(thickness, float(poisson), Prony(10 ** random.uniform(-3, 3), branches))

    layers = [layer(10 ** random.uniform(-2.5, 0.5)) for _ in range(random.integers(1, 6))]
    base = random.integers(3)
    return LayerStack((*layers, layer(math.inf)) if base == 0 else tuple(layers), rigid=bool(base == 1))


@pytest.mark.parametrize("nu", [-0.5, 0.3, 0.5])
def test_a_layer_in_fifty_digits_obeys_the_equations_of_elasticity(nu):
    """Displacements W, U and tractions over the depth, by the series of the matrix exponential; q = G = 1."""
    with mp.workdps(60):
        x, nu = mp.mpf(1.7), mp.mpf(nu)
        ratio, give = nu / (1 - nu), (1 - 2 * nu) / (2 - 2 * nu)
        equations = [[0, ratio, give, 0], [-1, 0, 0, 1], [0, 0, 0, 1], [0, 2 / (1 - nu), -ratio, 0]]
        through = mp.expm(x * mp.matrix(equations), method="taylor")
        # Of both faces; tractions are outward, and so minus those of the equations on the upper one.
        displacements, tractions = mp.zeros(4), mp.zeros(4)
        displacements[:2, :2], displacements[2:, :] = mp.eye(2), through[:2, :]
        tractions[:2, 2:], tractions[2:, :] = -mp.eye(2), through[2:, :]
        assert mp.mnorm(layer_matrix(x, nu) * displacements - tractions) < 1e-50


@pytest.mark.parametrize("seed", range(6))
def test_random_stacks_obey_the_equations_of_elasticity(seed):
    """Incompressible layers and complex frequencies too, at any ratio of moduli."""
    random = np.random.default_rng(seed)
    stack = random_stack(random)
    depth = sum(layer.thickness for layer in stack.layers if math.isfinite(layer.thickness))
    q = np.array([0.02, 0.5, 10.0]) / depth
    for s in (0.0, 10 ** random.uniform(-3, 3) * 1j):
        found = stack.traction_spectrum(q).in_plane.stiffness(s)
        for K, one in zip(found, q, strict=True):
            expected = surface_stiffness(stack, one, s)
            np.testing.assert_allclose(K, expected, rtol=0, atol=ROUNDING * np.abs(expected).max())
