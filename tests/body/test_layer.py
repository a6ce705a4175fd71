"""S(q) and K(q, G) of the layered halfspace against the paper's printed equations in 50-digit arithmetic."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfmdlayer.body.closed_form import LayeredHalfspace
from tests.body.printed import relative_error

# About forty operations of half an ulp each, none of which cancels, lose at most 40 * 2^-53 = 4e-15.
ROUNDING = 4e-15

DEPTHS = [*(10.0**k for k in range(-8, 7)), 0.3, 0.99, 1.01, 1.99, 2.01, 20.0, 186.0, 373.0]
POISSON = [-0.99, 0.0, 0.3, 0.499, 0.5 - 1e-9, 0.5]
CONTRASTS = [0.0, 1e-6, 1e-2, 0.5, 1.0, 7.0, 1e3, 1e6, math.inf]  # G_bulk / |G|


@pytest.mark.parametrize(
    "G", [1.0, 1.0 + 1.0j, *(pytest.param(G, marks=pytest.mark.slow) for G in (1.0 + 0.001j, 0.01 + 1.0j))]
)
@pytest.mark.parametrize("nu", POISSON)
def test_stiffness_is_the_printed_one_from_thin_to_thick_and_soft_to_stiff(nu, G):
    for x, bulk, nu_bulk in itertools.product(DEPTHS, CONTRASTS, (-0.9, 0.25, 0.5)):
        body = LayeredHalfspace(x, nu, bulk, nu_bulk)
        K = body.stiffness(1.0, G)
        assert relative_error(K, 1.0, body, G) < ROUNDING
        assert K * body.layer_factor(1.0, G) == pytest.approx(G / (1 - nu), rel=ROUNDING)


poisson_ratios = st.floats(-1, 0.5, exclude_min=True) | st.sampled_from([0.5, 0.5 - 1e-9, 0.499])
moduli = st.floats(-6, 6).map(lambda k: 10**k)


@settings(max_examples=300, deadline=None)
@given(
    x=st.floats(-8, 6).map(lambda k: 10**k),
    q=st.floats(-3, 3).map(lambda k: 10**k),
    nu=poisson_ratios,
    nu_bulk=poisson_ratios,
    bulk=moduli | st.sampled_from([0.0, math.inf]),
    loss=st.floats(0, 1e3),
)
def test_stiffness_is_the_printed_one_for_any_body(x, q, nu, nu_bulk, bulk, loss):
    body = LayeredHalfspace(x / q, nu, bulk, nu_bulk)
    for G in (1.0, complex(1.0, loss)):
        assert relative_error(body.stiffness(q, G), q, body, G) < ROUNDING


@pytest.mark.parametrize("bulk", [0.0, 1e-3, 1.0, 1e3])
def test_mean_height_is_free_on_a_deformable_base(bulk):
    assert LayeredHalfspace(0.1, 0.3, bulk).stiffness(0.0, 1.0) == 0
    assert LayeredHalfspace(math.inf, 0.3, bulk).stiffness(0.0, 1.0) == 0


@pytest.mark.parametrize("nu", [-0.99, 0.0, 0.3, 0.5 - 1e-9])
def test_mean_of_a_compressible_layer_on_a_rigid_base_is_stiff(nu):
    body = LayeredHalfspace(0.1, nu, math.inf)
    confined = 2 * 3.0 * (1 - nu) / (1 - 2 * nu)
    assert body.stiffness(0.0, 3.0) == pytest.approx(confined / 0.1, rel=ROUNDING)
    # Long waves tend to it, the correction being of second order in qd over 1 - 2 nu.
    assert body.stiffness(1e-9, 3.0) == pytest.approx(confined / 0.1, rel=1e-10)
    assert LayeredHalfspace(0.1, 0.5, math.inf).stiffness(0.0, 3.0) == 0


@settings(max_examples=200, deadline=None)
@given(
    x=st.floats(-8, 3).map(lambda k: 10**k),
    nu=poisson_ratios,
    nu_bulk=poisson_ratios,
    bulk=moduli,
    G=moduli,
    factor=st.floats(1, 1e4),
)
def test_stiffness_grows_with_the_moduli_and_scales_with_them(x, nu, nu_bulk, bulk, G, factor):
    stiffness = LayeredHalfspace(x, nu, bulk, nu_bulk).stiffness(1.0, G)
    harder_layer = LayeredHalfspace(x, nu, bulk, nu_bulk).stiffness(1.0, factor * G)
    harder_base = LayeredHalfspace(x, nu, factor * bulk, nu_bulk).stiffness(1.0, G)
    both = LayeredHalfspace(x, nu, factor * bulk, nu_bulk).stiffness(1.0, factor * G)
    assert both == pytest.approx(factor * stiffness, rel=2 * ROUNDING)
    for harder in (harder_layer, harder_base):
        assert stiffness * (1 - 2 * ROUNDING) <= harder <= both * (1 + 2 * ROUNDING)


def test_wavenumbers_and_moduli_broadcast():
    body = LayeredHalfspace(0.05, 0.5, 1.0)
    q, G = np.linspace(0, 100, 6).reshape(2, 3), np.array([1.0, 2.0 + 1.0j]).reshape(2, 1, 1)
    stiffness = body.stiffness(q, G)
    assert stiffness.shape == (2, 2, 3)
    assert stiffness[1, 1, 2] == body.stiffness(q[1, 2], G[1, 0, 0])
    assert body.stiffness(q, 1.0).dtype == np.float64


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-0.1, 0.5, 1.0, 0.5), "thickness: got -0.1; must be 0, positive"),
        ((math.nan, 0.5, 1.0, 0.5), "thickness: got nan"),
        ((0.1, 0.51, 1.0, 0.5), "poisson: got 0.51; must be above -1 and at most 0.5"),
        ((0.1, 0.5, 1.0, -1.0), "bulk_poisson: got -1.0"),
        ((0.1, math.nan, 1.0, 0.5), "poisson: got nan"),
        ((0.1, 0.5, -1.0, 0.5), "bulk_modulus: got -1.0"),
        ((0.1, 0.5, math.nan, 0.5), "bulk_modulus: got nan"),
        ((0.0, 0.5, 0.0, 0.5), "got 0 with bulk_modulus 0.0"),
        ((0.0, 0.5, math.inf, 0.5), "got 0 with bulk_modulus inf"),
    ],
)
def test_impossible_bodies_raise(arguments, message):
    with pytest.raises(ValueError, match=message):
        LayeredHalfspace(*arguments)
