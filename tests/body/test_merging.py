"""Fewer modes: the bound on K over the right half-plane, positive weights, the relaxed stiffness."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gfmdlayer.body.materials import Prony
from gfmdlayer.body.stack import Layer, LayerStack, merged

S = np.concatenate([np.logspace(-8, 8, 65) * factor for factor in (1, 1j, 1 + 0.1j)])


def relaxing(weights: Any, times: Any) -> NDArray[Any]:
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
def test_the_bound_holds_in_the_right_half_plane(given: list[tuple[float, float]], exponent: float) -> None:
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


def test_modes_of_one_time_are_one() -> None:
    weights, times, reached = merged(np.array([1.0, 2.0, 3.0]), np.array([2.0, 2.0, 2.0]), 1e-12)
    assert weights == pytest.approx([6.0])
    assert times == pytest.approx([2.0])
    assert reached < 1e-14


def test_a_stack_reports_the_error_of_its_spectrum() -> None:
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
