"""Projection onto no overlap and a mean of zero."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from gfmdlayer.contact.problem import project

EPS = np.finfo(float).eps
Floats = NDArray[np.float64]

values = st.floats(-1, 1, allow_subnormal=False)


@st.composite
def surfaces(draw: st.DrawFn) -> tuple[Floats, Floats]:
    """A displacement and an obstacle with some room below it, of any scale."""
    n = draw(st.integers(1, 60))
    scale = 10.0 ** draw(st.integers(-6, 6))
    u, h = draw(arrays(np.float64, n, elements=values)), draw(arrays(np.float64, n, elements=values))
    h = h - h.mean() + draw(st.floats(0.01, 1))
    touching = draw(arrays(np.bool_, n))
    return scale * np.where(touching, h, u), scale * h


def mean_of(u: Floats) -> float:
    return math.fsum(u) / u.size


@given(surfaces())
@settings(deadline=None)  # the first call compiles
def test_no_point_overlaps_and_the_mean_is_zero_to_rounding(surface: tuple[Floats, Floats]) -> None:
    u, h = surface
    project(u, h, mean_is_fixed=True)
    assert (u <= h).all()
    # Each value is rounded once after the shift that makes their compensated sum zero; so is the shift.
    assert abs(mean_of(u)) <= 4 * EPS * np.abs(np.append(u, h)).max()


@given(surfaces())
@settings(deadline=None)  # the first call compiles
def test_free_points_share_one_shift_and_the_others_would_overlap_with_it(
    surface: tuple[Floats, Floats],
) -> None:
    start, h = surface
    u = start.copy()
    project(u, h, mean_is_fixed=True)
    start = np.minimum(start, h)
    if (start < h).any():  # otherwise all of them move
        np.testing.assert_array_equal(u[start == h], h[start == h])
    shifts = (u - start)[u < h]
    if shifts.size:
        rounding = 4 * EPS * max(np.abs(start).max(), np.abs(u).max())
        assert np.ptp(shifts) <= rounding
        stopped = (u == h) & (start < h)
        assert ((h - start)[stopped] <= shifts.max() + rounding).all()


@given(surfaces())
@settings(deadline=None)  # the first call compiles
def test_projecting_twice_changes_nothing_but_rounding(surface: tuple[Floats, Floats]) -> None:
    u, h = surface
    project(u, h, mean_is_fixed=True)
    again = u.copy()
    project(again, h, mean_is_fixed=True)
    assert np.abs(again - u).max() <= 8 * EPS * max(np.abs(u).max(), np.abs(h).max()) * u.size


@given(surfaces())
@settings(deadline=None)  # the first call compiles
def test_a_free_mean_is_left_alone(surface: tuple[Floats, Floats]) -> None:
    u, h = surface
    expected = np.minimum(u, h)
    project(u, h, mean_is_fixed=False)
    np.testing.assert_array_equal(u, expected)


@given(surfaces())
@settings(deadline=None)  # the first call compiles
def test_a_punch_that_displaces_more_than_the_cell_holds_is_refused(surface: tuple[Floats, Floats]) -> None:
    u, h = surface
    with pytest.raises(ValueError, match="more than the cell holds"):
        project(u, h - 2 * np.abs(h).max(), mean_is_fixed=True)


def test_a_punch_that_fills_the_cell_exactly_is_followed() -> None:
    h = np.array([0.5, -0.25, 0.25, -0.5])
    u = np.zeros(4)
    project(u, h, mean_is_fixed=True)
    np.testing.assert_array_equal(u, h)


def test_the_mean_stays_at_rounding_with_many_points_of_very_different_height() -> None:
    rng = np.random.default_rng(1)
    h = np.exp(rng.uniform(-12, 0, 2**18))
    u = rng.standard_normal(h.size)
    project(u, h, mean_is_fixed=True)
    assert abs(mean_of(u)) <= 4 * EPS * np.abs(u).max()
