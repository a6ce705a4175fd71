"""The relaxation spectrum against K(q, G(s)) of the printed equations in 50-digit arithmetic."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfmdlayer.body.closed_form import LayeredHalfspace, relaxation_spectrum
from gfmdlayer.body.materials import Prony, Zener
from gfmdlayer.body.relaxation import NEGLIGIBLE, retardation_spectrum
from tests.body.printed import relative_error

# K(q, s) is a sum of terms in the right half-plane, each good to some tens of roundings of 2^-53.
ROUNDING = 1e-14

FREQUENCIES = [0, 1e-4j, 0.1 + 0.03j, 1j, 30j, 1e4 + 1e4j, 1e9]


def assert_exact(body, material, q, frequencies):
    spectrum = relaxation_spectrum(body, material, q)
    assert (spectrum.weights >= 0).all()
    assert (spectrum.times > 0).all()
    for s in frequencies:
        for one, K in zip(q.tolist(), spectrum.stiffness(s), strict=True):
            assert relative_error(K, one, body, material, s) < ROUNDING, (body, material, one, s)
    return spectrum


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.499, 0.5])
@pytest.mark.parametrize("contrast", [1.0, 1.01, 10.0, 1e4])
def test_zener_layer_relaxes_in_three_modes(nu, contrast):
    q, material = np.logspace(-6, 3, 10), Zener(1.0, contrast, 1.0)
    for bulk, nu_bulk in zip(
        [0.0, 1e-3, 0.1, 1.0, 10.0, 1e3, math.inf], [0.5, 0.5, 0.3, 0.5, -0.5, 0.5, 0.5], strict=True
    ):
        spectrum = assert_exact(LayeredHalfspace(1.0, nu, bulk, nu_bulk), material, q, FREQUENCIES)
        assert len(spectrum.weights) <= (0 if contrast == 1 else 3)
        # Between the relaxation time at constant strain and the retardation time at constant stress.
        assert (spectrum.times >= 1).all()
        assert (spectrum.times <= contrast * (1 + ROUNDING)).all()


poisson_ratios = st.floats(-1, 0.5, exclude_min=True) | st.sampled_from([0.5, 0.5 - 1e-9, 0.5 - 1e-4])
frequencies = st.builds(
    lambda size, angle: 10**size * complex(math.cos(angle), math.sin(angle)),
    st.floats(-8, 8),
    st.floats(-math.pi / 2, math.pi / 2),
)
bulks = st.floats(-4, 4).map(lambda k: 10**k) | st.sampled_from([0.0, 1.0, math.inf])


@st.composite
def series(draw):
    """Branches over twelve decades of time and of modulus, or crowded within rounding of each other."""
    spread = draw(st.sampled_from([6.0, 0.1, 1e-8, 1e-15]))
    branch = st.tuples(st.floats(-9, 3).map(lambda k: 10**k), st.floats(-spread, spread).map(lambda k: 10**k))
    return Prony(1.0, tuple(draw(st.lists(branch, min_size=1, max_size=6))))


@settings(max_examples=250, deadline=None)
@given(series(), poisson_ratios, poisson_ratios, bulks, st.floats(-6, 3).map(lambda k: 10**k), frequencies)
def test_any_layered_body_relaxes_in_modes(material, nu, nu_bulk, bulk, x, s):
    q = np.array([0.25, 4.0])
    body = LayeredHalfspace(x, nu, bulk, nu_bulk)
    spectrum = assert_exact(body, material, q, [0, s])
    assert len(spectrum.weights) <= 3 * len(material.branches)


@pytest.mark.parametrize("branches", [2, 5, 50])
def test_prony_layer_over_twelve_decades_of_time(branches):
    moduli, taus = (
        10 ** np.random.default_rng(branches).uniform(-1, 2, branches),
        np.logspace(-6, 6, branches),
    )
    material = Prony(1.0, tuple(zip(moduli.tolist(), taus.tolist(), strict=True)))
    q = np.array([1e-4, 0.1, 1.0, 3.0, 30.0])
    for bulk, nu in ((1.0, 0.5), (30.0, 0.3)):
        body = LayeredHalfspace(1.0, nu, bulk, 0.45)
        spectrum = assert_exact(body, material, q, [0, 1e-5j, 0.1 + 1j, 1e4j])
        np.testing.assert_allclose(spectrum.glassy, body.stiffness(q, material.glassy), rtol=ROUNDING)


def test_fifty_branches_sum_to_the_glassy_stiffness_at_all_wavenumbers():
    material = Prony(1.0, tuple((1.0 + k % 7, tau) for k, tau in enumerate(np.logspace(-6, 6, 50).tolist())))
    body, q = LayeredHalfspace(1e-4, 0.5, 1.0), 16 * np.pi * np.arange(1025)
    spectrum = relaxation_spectrum(body, material, q)
    assert spectrum.weights.shape == (150, 1025)
    np.testing.assert_allclose(spectrum.glassy, body.stiffness(q, material.glassy), rtol=ROUNDING)
    np.testing.assert_array_equal(spectrum.relaxed, body.stiffness(q, 1.0))


def test_branches_of_one_time_are_one_branch():
    body, q = LayeredHalfspace(0.05, 0.5, 1.0), np.array([1.0, 30.0])
    split = relaxation_spectrum(body, Prony(1.0, ((4.0, 2.0), (0.0, 3.0), (5.0, 2.0))), q)
    whole = relaxation_spectrum(body, Zener(1.0, 10.0, 2.0), q)
    np.testing.assert_array_equal(split.weights, whole.weights)
    np.testing.assert_array_equal(split.times, whole.times)


@pytest.mark.parametrize(("thickness", "bulk"), [(0.05, 0.0), (0.05, math.inf), (math.inf, 1.0)])
@pytest.mark.parametrize("nu", [0.3, 0.5])
def test_body_proportional_to_its_layer_has_the_times_of_the_material(thickness, bulk, nu):
    material = Prony(1.0, ((2.0, 0.1), (3.0, 10.0)))
    body, q = LayeredHalfspace(thickness, nu, bulk), np.array([1e-3, 1.0, 1e3])
    spectrum = relaxation_spectrum(body, material, q)
    np.testing.assert_array_equal(spectrum.times, [[0.1] * 3, [10.0] * 3])
    np.testing.assert_allclose(spectrum.weights, np.outer([2.0, 3.0], body.stiffness(q, 1.0)), rtol=ROUNDING)


@pytest.mark.parametrize(
    ("body", "material"),
    [
        (LayeredHalfspace(0.0, 0.5, 1.0), Zener(1.0, 10.0, 1.0)),
        (LayeredHalfspace(0.05, 0.5, 1.0), Zener(2.0, 2.0, 1.0)),
        (LayeredHalfspace(0.05, 0.5, 1.0), Prony(2.0)),
        (LayeredHalfspace(0.05, 0.5, math.inf), Prony(2.0, ((0.0, 1.0),))),
    ],
)
def test_elastic_body_has_no_modes(body, material):
    q = np.array([0.0, 1.0, 100.0])
    spectrum = relaxation_spectrum(body, material, q)
    assert spectrum.weights.shape == spectrum.times.shape == (0, 3)
    np.testing.assert_array_equal(spectrum.glassy, body.stiffness(q, material.relaxed))
    np.testing.assert_array_equal(spectrum.stiffness(1j), spectrum.relaxed)


def test_mean_height_relaxes_only_on_a_rigid_base():
    material, q = Zener(1.0, 10.0, 2.0), np.array([0.0, 1.0])
    rigid = LayeredHalfspace(0.1, 0.3, math.inf)
    confined = relaxation_spectrum(rigid, material, q)
    np.testing.assert_allclose(confined.weights[:, 0], 9 * rigid.mean_stiffness, rtol=ROUNDING)
    np.testing.assert_array_equal(confined.times, 2.0)
    for bulk, nu in ((1.0, 0.3), (0.0, 0.3), (math.inf, 0.5)):
        free = relaxation_spectrum(LayeredHalfspace(0.1, nu, bulk), material, q)
        assert free.relaxed[0] == 0
        assert not free.weights[:, 0].any()
        assert free.weights[:, 1].all()


def test_modes_without_weight_in_a_deep_layer_are_left_out():
    material = Prony(1.0, ((2.0, 0.1), (3.0, 10.0)))
    body = LayeredHalfspace(1.0, 0.3, 2.0)
    deep = relaxation_spectrum(body, material, np.array([25.0, 30.0, 1e3]))
    assert deep.weights.shape == (2, 3)
    # A wavenumber that does feel the base brings its modes back, with no weight at the others.
    mixed = relaxation_spectrum(body, material, np.array([1.0, 30.0, 1e3]))
    assert mixed.weights.shape == (6, 3)
    assert np.count_nonzero(mixed.weights[:, 1:].any(axis=1)) == 2


def test_weights_left_out_are_negligible():
    body, q, material = LayeredHalfspace(1.0, 0.5, 1.0), np.linspace(10, 25, 61), Zener(1.0, 10.0, 1.0)
    spectrum = relaxation_spectrum(body, material, q)
    kept = spectrum.weights > 0
    assert np.count_nonzero(kept) < kept.size
    assert (spectrum.weights / spectrum.relaxed)[kept].min() > NEGLIGIBLE / 3
    for one, K in zip(q[::6].tolist(), spectrum.glassy[::6], strict=True):
        assert relative_error(K, one, body, material, 1e30) < ROUNDING


@pytest.mark.parametrize("bulk", [1e12, 1e16, 1e18, 1e25, 1e30])
def test_a_halfspace_may_be_almost_rigid(bulk):
    q = np.geomspace(0.1, 1e3, 9)
    material = Prony(1.0, ((3.0, 0.1), (6.0, 1.0), (2.0, 50.0)))
    assert_exact(LayeredHalfspace(0.05, 0.5, bulk), material, q, [0, 0.1 + 0.03j, 30j])


def test_wavenumbers_may_have_any_shape():
    body, material = LayeredHalfspace(0.05, 0.5, 1.0), Zener(1.0, 10.0, 1.0)
    q = np.linspace(0.0, 100.0, 12)
    flat, shaped = (relaxation_spectrum(body, material, x) for x in (q, q.reshape(3, 4)))
    assert shaped.weights.shape == shaped.times.shape == (3, 3, 4)
    np.testing.assert_array_equal(shaped.weights.reshape(3, 12), flat.weights)
    np.testing.assert_array_equal(shaped.stiffness(1j).ravel(), flat.stiffness(1j))
    assert relaxation_spectrum(body, material, 6.0).weights.shape == (3,)


@settings(max_examples=100, deadline=None)
@given(series(), st.lists(st.floats(-6, 6).map(lambda k: 10**k), min_size=1, max_size=5))
def test_retardation_times_interlace_and_compliances_add_up(material, relaxed):
    taus, position = np.unique(material.branch_times, return_inverse=True)
    moduli, A = np.bincount(position, material.branch_moduli).astype(float), np.array(relaxed)
    compliances, times = retardation_spectrum(moduli, taus, A)
    assert (compliances > 0).all()
    assert (times >= taus[:, np.newaxis]).all()
    assert (times[:-1] <= taus[1:, np.newaxis]).all()
    creep = moduli.sum() / (A * (A + moduli.sum()))
    np.testing.assert_allclose(compliances.sum(axis=0), creep, rtol=1e-13)


@pytest.mark.parametrize(
    ("moduli", "relaxed"), [((1.0, 2.0), 1e-300), ((1.0, 2.0), 1e200), ((1e-320, 1.0), 1.0)]
)
def test_retardation_times_out_of_the_range_of_floats_are_refused(moduli, relaxed):
    # Squares of distances such as 2e300, 1e-200 and 1e-320 are no floats.
    with pytest.raises(ArithmeticError, match="no convergence to the retardation times"):
        retardation_spectrum(np.array(moduli), np.array([1.0, 2.0]), np.array([relaxed]))
