"""The error of a number from its values on other grids, against sequences whose limit is known."""

import math

import pytest

from gfmdlayer.convergence.estimates import estimate

SIZES = (1.0, 1.6, 2.0, 8 / 3)


@pytest.mark.parametrize("order", [1.0, 1.5, 2.0])
def test_the_error_of_a_clean_sequence_is_its_own_and_richardson_finds_the_limit(order):
    found = estimate({x: 3.0 + 0.1 * x**order for x in SIZES}, order)
    assert found.verdict == "order"
    assert found.seen == pytest.approx(order, abs=0.05)  # the spacing of the orders that are tried
    assert found.error == pytest.approx(0.1, rel=0.06)
    assert found.limit == pytest.approx(3.0, abs=0.01)


def test_a_lower_order_than_expected_counts():
    found = estimate({x: 3.0 + 0.1 * x for x in SIZES}, 2.0)
    assert found.verdict == "off"
    assert math.isnan(found.limit)
    assert found.error == pytest.approx(0.1, rel=0.1)


def test_a_higher_order_than_expected_is_not_believed():
    values = {x: 3.0 + 0.1 * x**3 for x in SIZES}
    assert (
        estimate(values, 2.0).error > 0.1
    )  # the differences over x^2 - 1 are larger than those over x^3 - 1


def test_differences_that_do_not_grow_with_the_size_are_of_first_order_at_most():
    """On the coarsest grid the edge lies by chance as on the case's own."""
    values = {1.0: 0.0, 1.6: 0.3, 2.0: 0.2, 8 / 3: 0.0}
    found = estimate(values, 2.0)
    assert found.verdict == "scattered"
    assert found.error == pytest.approx(0.3 / 0.6)


def test_three_tolerances_show_their_order():
    found = estimate({x: 1.0 + 1e-3 * x ** (2 / 3) for x in (10.0, 1.0, 0.1)}, 2 / 3)
    assert found.verdict == "order"
    assert found.error == pytest.approx(1e-3)
    assert found.limit == pytest.approx(1.0, abs=1e-12)


def test_equal_values_have_no_error():
    assert estimate({1.0: 2.0, 2.0: 2.0}, 2.0).error == 0.0
