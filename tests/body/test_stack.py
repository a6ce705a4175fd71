"""Stacks of layers: stiffness and relaxing modes against the elastic solution in 50 digits, and limits."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfmdlayer.body import stack
from gfmdlayer.body.closed_form import LayeredHalfspace
from gfmdlayer.body.layer import Layer
from gfmdlayer.body.layers import LayerStack, ViscoelasticLayer
from gfmdlayer.body.materials import Elastic, Prony, Zener
from gfmdlayer.body.stack import merged
from gfmdlayer.history.modes import SCHEMES, Modes
from tests.body.printed import surface_stiffness

# Of the stiffness: some tens of roundings of 2^-53 in each of at most seven layers.
ROUNDING = 1e-13
# Of the spectrum: some hundred internal variables, of a condition of (Ginf/G0)^(1/2) < 1e3 at most.
SPECTRUM = 1e-11

FREQUENCIES = np.array([0, 1e-4j, 0.1 + 0.03j, 1j, 30j, 1e4 + 1e4j, 1e9])


def assert_exact(body, q):
    """Assert the stiffness and that of the spectrum of the network, and that no weight is negative."""
    exact = np.array([surface_stiffness(body, q, s, shear=False) for s in FREQUENCIES])
    np.testing.assert_allclose(stack.stiffness(body, q, FREQUENCIES), exact, rtol=ROUNDING)
    spectrum = stack.spectrum(body, q)
    assert (spectrum.weights >= 0).all()
    assert (spectrum.times > 0).all()
    found = [spectrum.stiffness(s) for s in FREQUENCIES]
    np.testing.assert_allclose(found, exact, rtol=SPECTRUM)


def powers(low, high):
    """Numbers spread over decades."""
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


poissons = st.sampled_from([0.0, 0.3, 0.5]) | st.floats(1e-30, 0.5)
materials = st.builds(
    lambda G, branches: Prony(G, [(G * ratio, tau) for ratio, tau in branches]),
    powers(-2, 2),
    st.lists(st.tuples(powers(-2, 2), powers(-4, 4)), max_size=4),
)
layers = st.builds(Layer, powers(-6, 6) | powers(-1, 1), poissons, materials)


@st.composite
def stacks(draw):
    """One to six layers on each kind of base."""
    above = draw(st.lists(layers, min_size=1, max_size=6))
    base = draw(st.sampled_from(["rigid", "free", "halfspace"]))
    if base == "halfspace":
        above.append(Layer(math.inf, draw(poissons), draw(materials)))
    return LayerStack(tuple(above), rigid=base == "rigid")


@settings(deadline=None, max_examples=10)
@given(stacks(), st.just(1.0) | powers(-3, 3))
def test_stiffness_and_spectrum_are_exact(body, q):
    assert_exact(body, q)


SOFT = Prony(1.0, [(3.0, 0.1), (6.0, 4.0)])
HARD = Prony(300.0, [(2000.0, 1e-3), (100.0, 1.0), (5.0, 80.0)])
BASE = Layer(math.inf, 0.3, Prony(20.0, [(7.0, 2.0)]))


def test_modes_over_twelve_decades_of_times_keep_all_digits():
    """The bound is ten roundings of 2^-53 for each of the 144 internal variables, and what is negligible."""
    law = Prony(1.0, [(1.0, 10.0**k) for k in range(-9, 3)])
    other = Prony(2.0, [(0.5, 3 * 10.0**k) for k in range(-9, 3)])
    depths = ((0.02, 0.4, law), (0.05, 0.45, other), (0.1, 0.3, law), (math.inf, 0.3, other))
    body, q = LayerStack([Layer(*each) for each in depths]), np.array([0.3, 3.0, 30.0])
    found = body.spectrum(q)
    for s in np.logspace(-5, 11, 17):
        np.testing.assert_allclose(found.stiffness(s), body.stiffness(q, s), rtol=1e-12)


@pytest.mark.parametrize("x", [1e-6, 1e-3, 1.0, 30.0, 1e6])
@pytest.mark.parametrize("bottom", ["rigid", "free", "halfspace"])
def test_thin_and_thick_layers_keep_their_digits(bottom, x):
    """Also a stiff film on a soft one, incompressible ones, and twenty branches."""
    many = Prony(1.0, [(10.0 ** (-k / 10), 10.0 ** (k / 2 - 5)) for k in range(20)])
    above = (Layer(0.5, 0.5, HARD), Layer(1.0, 0.5, many), Layer(2.0, 0.0, SOFT))
    assert_exact(LayerStack((*above, BASE) if bottom == "halfspace" else above, rigid=bottom == "rigid"), x)


Q = np.geomspace(1e-6, 1e6, 25)


def assert_same(one, other, within=SPECTRUM):
    """Assert equal stiffness, and that of the spectra, over twelve decades of q and eight of s."""
    spectra = one.spectrum(Q), other.spectrum(Q)
    for s in (0.0, 1e-4, 1e-2 + 1e-1j, 1.0, 1e3j, 1e8):
        np.testing.assert_allclose(other.stiffness(Q, s), one.stiffness(Q, s), rtol=ROUNDING)
        np.testing.assert_allclose(spectra[1].stiffness(s), spectra[0].stiffness(s), rtol=within)


def test_a_layer_without_thickness_vanishes():
    above = (Layer(1.0, 0.4, SOFT), Layer(0.3, 0.5, HARD))
    assert_same(
        LayerStack((*above, BASE)),
        LayerStack((Layer(0.0, 0.2, HARD), above[0], Layer(0.0, 0.2, SOFT), above[1], BASE)),
    )


@pytest.mark.parametrize("bulk", [0.0, 0.7, math.inf])
@pytest.mark.parametrize("nu", [0.2, 0.5])
def test_a_stack_of_one_is_the_layer_of_the_paper(bulk, nu):
    """The network has the same modes as the closed form, by the roots of quadratic equations."""
    single = ViscoelasticLayer(LayeredHalfspace(0.05, nu, bulk, 0.3), SOFT)
    assert single.closed_form is not None
    q = np.append(0.0, Q)
    mean = stack.stiffness(single, 0.0, 0.0).item()
    assert mean == pytest.approx(single.mean_stiffness, rel=ROUNDING)
    known, found = single.spectrum(q), stack.spectrum(single, q)
    for s in FREQUENCIES:
        np.testing.assert_allclose(stack.stiffness(single, q, s), single.stiffness(q, s), rtol=ROUNDING)
        np.testing.assert_allclose(found.stiffness(s), known.stiffness(s), rtol=SPECTRUM)


def test_mean_stiffness_is_that_of_layers_in_series():
    """1/K(0, s) = sum of d (1 - 2 nu)/(2 (1 - nu) G(s)); an incompressible layer does not yield."""
    body = LayerStack((Layer(0.3, 0.2, SOFT), Layer(0.1, 0.5, HARD), Layer(0.6, 0.45, HARD)), rigid=True)
    spectrum = body.spectrum(np.array([0.0, 1e-9]))
    for s in FREQUENCIES:
        series = 1 / sum(
            d * (1 - 2 * nu) / (2 * (1 - nu) * G.laplace(s))
            for d, nu, G in ((0.3, 0.2, SOFT), (0.6, 0.45, HARD))
        )
        assert body.stiffness(0.0, s) == pytest.approx(series, rel=ROUNDING)
        assert spectrum.stiffness(s)[0] == pytest.approx(series, rel=SPECTRUM)
    assert body.mean_stiffness == pytest.approx(body.stiffness(0.0, 0.0).item())
    assert LayerStack((Layer(0.3, 0.2, SOFT), BASE)).mean_stiffness == 0
    assert LayerStack((Layer(0.3, 0.5, SOFT),), rigid=True).mean_stiffness == 0


def test_internal_variables_give_the_stiffness():
    """K = free G_1 + g.g - g.B (1 + B^T B + s theta)^-1 B^T g at any s, whatever the times of the layers."""
    body = LayerStack((Layer(0.3, 0.2, SOFT), Layer(0.1, 0.5, HARD), BASE))
    q, s, shifts, slower = np.array([0.1, 3.0]), 0.3 + 2j, np.array([0.1, 10.0, 3.0]), []
    for each, shift in zip(body.layers, shifts.tolist(), strict=True):
        law = Prony(each.material.relaxed, [(G, shift * t) for G, t in each.material.maxwell_branches])
        slower.append(Layer(each.thickness, each.poisson, law))
    shifted, network = LayerStack(slower), body.network(q)
    theta = network.times * shifts[network.layer]
    for i in range(q.size):
        g, B = network.force[i], network.coupling[i]
        relaxing = g @ B @ np.linalg.solve(np.diag(1 + s * theta) + B.T @ B, B.T @ g)
        found = network.free[i] * shifted.layers[0].material.laplace(s) + g @ g - relaxing
        assert found == pytest.approx(shifted.stiffness(q[i], s).item(), rel=SPECTRUM)


@pytest.mark.parametrize(
    ("layers", "rigid"),
    [((), False), ((Layer(0.0, 0.3, SOFT),), True), ((BASE, Layer(1.0, 0.3, SOFT)), False), ((BASE,), True)],
)
def test_impossible_stacks_are_refused(layers, rigid):
    with pytest.raises(ValueError, match="layer"):
        LayerStack(layers, rigid)


@pytest.mark.parametrize(("thickness", "poisson"), [(-1.0, 0.3), (math.nan, 0.3), (1.0, 0.6), (1.0, -1.0)])
def test_impossible_layers_are_refused(thickness, poisson):
    with pytest.raises(ValueError, match="must be"):
        Layer(thickness, poisson, SOFT)


def test_steps_with_merged_modes_keep_to_the_bound():
    # Modes that only one wavenumber has are rows of the spectrum too, padded at the other wavenumbers.
    layers = (
        Layer(0.01, 0.5, Elastic(5.0)),
        Layer(0.1, 0.5, Zener(1.0, 10.0, 0.01525)),
        Layer(0.2, 0.5, Zener(1.0, 4.0, 0.2589)),
        Layer(math.inf, 0.3, Elastic(20.0)),
    )
    q, accuracy = 2 * np.pi * np.arange(65), 1e-10
    found, exact = LayerStack(layers, accuracy=accuracy).spectrum(q), LayerStack(layers).spectrum(q)
    assert ((found.weights > 0).sum(axis=1) == 1).any()
    assert found.error <= accuracy
    for dt in (0.01, 0.25, 10.0):
        # Backward Euler's kappa is K at s = 1/dt.
        kappa, expected = (Modes(each, SCHEMES["backward_euler"]).terms(dt)[0] for each in (found, exact))
        np.testing.assert_allclose(kappa[1:], expected[1:], rtol=accuracy + 1e-13)


# --- fewer modes ---

S = np.concatenate([np.logspace(-8, 8, 65) * factor for factor in (1, 1j, 1 + 0.1j)])


def relaxing(weights, times):
    """K(s) - K_0 over S."""
    cycles = np.multiply.outer(S, times)
    return np.asarray((weights * (cycles / (1 + cycles))).sum(axis=-1))


modes = st.lists(
    st.tuples(st.floats(-6, 0), st.floats(-4, 4)).map(lambda each: (10 ** each[0], 10 ** each[1])),
    min_size=1,
    max_size=30,
)


@settings(deadline=None, max_examples=60)
@given(modes, st.floats(-10, -1))
def test_the_bound_holds_in_the_right_half_plane(given, exponent):
    """It is reached at s = inf, so that it is not a loose one either."""
    weights, times = np.array(given).T
    bound = 10**exponent
    few, theirs, reached = merged(weights, times, bound)
    assert reached <= bound
    assert few.size <= weights.size
    assert (few >= 0).all()
    assert (theirs > 0).all()
    error = np.abs(relaxing(few, theirs) - relaxing(weights, times)).max()
    rounding = 1e-12 * weights.sum()
    assert error <= reached + rounding
    assert weights.sum() - few.sum() >= 0.99 * reached - rounding


def test_modes_of_one_time_are_one():
    weights, times, reached = merged(np.array([1.0, 2.0, 3.0]), np.array([2.0, 2.0, 2.0]), 1e-12)
    assert weights == pytest.approx([6.0])
    assert times == pytest.approx([2.0])
    assert reached < 1e-14


def test_a_stack_reports_the_error_of_its_spectrum():
    """The modes of a body of three layers of five branches, on a rigid base, go from 50 to about 20."""
    law = [(2.0, 10.0**k) for k in range(-2, 3)]
    layers = tuple(Layer(0.05, 0.45, Prony(G, law)) for G in (3.0, 0.5, 10.0))
    q = 2 * np.pi * np.arange(1, 9)
    exact = LayerStack(layers, rigid=True).spectrum(q)
    found = LayerStack(layers, rigid=True, accuracy=1e-6).spectrum(q)
    assert exact.error == 0
    assert 1e-9 < found.error <= 1e-6
    assert np.count_nonzero(found.weights) < 0.6 * np.count_nonzero(exact.weights)
    np.testing.assert_array_equal(found.relaxed, exact.relaxed)
    for s in S:
        np.testing.assert_allclose(found.stiffness(s), exact.stiffness(s), rtol=found.error + 1e-12)


@pytest.mark.parametrize("rigid", [True, False])
@pytest.mark.parametrize("nu", [0.5, 0.45])
@pytest.mark.parametrize("liquid_on_top", [True, False])
def test_a_layer_that_relaxes_to_nothing_is_a_free_surface_in_the_end(liquid_on_top, nu, rigid):
    """K(q, s) goes to K(q, 0) as the modulus, which is s/(1 + s)."""
    liquid = Layer(thickness=0.05, poisson=nu, material=Zener(G0=0.0, Ginf=1.0, tau=1.0))
    solid = Layer(thickness=0.3, poisson=0.4, material=Elastic(0.3))
    body = LayerStack(layers=(liquid, solid) if liquid_on_top else (solid, liquid), rigid=rigid)
    q = np.array([0.0, 1.0, 10.0, 100.0])
    # The mean of two layers on a rigid base is limited by the solid one, if the liquid cannot yield.
    last, limit = (body.stiffness(q, s).real for s in (1e-15, 0.0))
    assert np.isfinite(limit).all()
    np.testing.assert_allclose(last, limit, rtol=1e-9, atol=1e-9)
    assert (limit[1:] > 0).all() != liquid_on_top
