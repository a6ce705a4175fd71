"""The compliance in creep form, from the relaxing modes of a body."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfmdlayer import LayeredHalfspace, Prony, Zener
from gfmdlayer.body.layers import ViscoelasticLayer
from gfmdlayer.body.relaxation import SAME_BRANCH, retardation
from gfmdlayer.indentation.compliance import Features, find_features
from gfmdlayer.indentation.solve import make_space

WIDE = Prony(1.0, [(1, 0.01), (2, 0.1), (3, 1.0), (1, 1.0), (4, 100.0)])


@pytest.mark.parametrize("material", [Zener(1.0, 10.0, 1.0), WIDE], ids=["Zener", "five branches"])
@pytest.mark.parametrize(
    "layer",
    [
        LayeredHalfspace(1.0, 0.5, 0.1, 0.3),
        LayeredHalfspace(1.0, 0.5, math.inf),
        LayeredHalfspace(1.0, 0.5, 1.0, 0.5),
        LayeredHalfspace(1.0, 0.3, 1e-6, 0.3),
        LayeredHalfspace(1.0, 0.45, 1e6),
    ],
    ids=str,
)
def test_modes_sum_to_the_direct_compliance(layer, material):
    """To the rounding of q/K, of which C is the small difference from (1 - nu)/G."""
    body = ViscoelasticLayer(layer, material)
    found = make_space(find_features(body, 1.0), 1.0).compliance(body)
    s = np.array([0.0, 0.1, 1 + 2j, 100.0])[:, np.newaxis]
    modes = found.instant + (found.modes / (1 + s[..., np.newaxis] * found.times)).sum(axis=1)
    D = (1 - layer.poisson) / material.laplace(s[:, 0])[:, np.newaxis]
    np.testing.assert_allclose(
        modes, found.q / body.stiffness(found.q, s) - D, rtol=0, atol=1e-14 * np.abs(modes).max()
    )
    # What is left out beyond the last node is negligible.
    assert np.abs(modes[:, -1]).max() < 1e-7 * max(found.local, np.abs(modes).max())


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6)), min_size=1, max_size=8),
    st.floats(1e-6, 1e6),
)
def test_retardation_inverts_any_relaxing_stiffness(branches, relaxed):
    """K(s) times its compliance is 1, for branches of any weights and times, equal ones too."""
    weights, times = np.array(branches).T[:, :, np.newaxis]
    J, T, *_ = retardation(weights, times, np.array([relaxed]), SAME_BRANCH)
    s = np.geomspace(1e-8, 1e8, 33)
    cycles = s * times
    K = relaxed + (weights * cycles / (1 + cycles)).sum(axis=0)
    compliance = 1 / (relaxed + weights.sum()) + (J / (1 + s * T)).sum(axis=0)
    np.testing.assert_allclose(K * compliance, 1.0, rtol=1e-11)
    assert (J >= 0).all()
    assert (T > 0).all()


def test_a_contact_too_wide_beside_a_layer_is_refused_before_its_nodes_are_made():
    features = Features(surface=1e14, first=1e3, last=2e6)  # of a film of some micrometres
    assert make_space(features, 1e-6).nodes.cosines.size < 1e6
    with pytest.raises(
        ValueError, match=r"radius 0\.25 is too large for the thinnest layer: beyond a radius of 0\.002"
    ):
        make_space(features, 0.25)
