"""The first guess of the pressure: exact wherever the law that it extrapolates by is what happens."""

import numpy as np
import pytest

from gfmdlayer.contact.prediction import PressurePrediction

X = np.linspace(-1, 1, 400, endpoint=False) + 1 / 811  # no two points as far from the centre
SLOPE = 3.0  # c in p^2 = c (a^2 - x^2)
OPENING = 0.7  # of gap = OPENING (x^2 - a^2)^(3/2)


def edge_law(squared_width):
    """Pressure and gap whose edge is at x^2 = a^2."""
    inside = squared_width - X**2
    return np.sqrt(SLOPE * np.maximum(inside, 0)), OPENING * np.maximum(-inside, 0) ** 1.5


@pytest.mark.parametrize("degree", [0, 1])
def test_pressures_of_a_fixed_contact_are_extrapolated_exactly(degree):
    # As many steps as a polynomial of the degree needs, at uneven times.
    rng = np.random.default_rng(degree)
    coefficients = rng.uniform(0.1, 1, (degree + 1, 50))
    coefficients[:, 30:] = 0.0
    gap = np.where(np.arange(50) < 30, 0.0, 1.0)
    prediction = PressurePrediction(50)
    for time in (0.1, 0.4)[: degree + 1]:
        pressure = np.asarray(np.polynomial.polynomial.polyval(time, coefficients))
        prediction.remember(time, pressure, gap)
    # The two weights add up to less than 5 in magnitude here.
    expected = np.polynomial.polynomial.polyval(0.9, coefficients)
    np.testing.assert_allclose(prediction.at(0.9), expected, rtol=5 * 2.3e-16 * 4)


def test_only_the_last_two_steps_count():
    gap, prediction = np.zeros(4), PressurePrediction(4)
    prediction.remember(-7.0, np.full(4, 1e6), gap)
    for time in (1.0, 2.0):
        prediction.remember(time, np.full(4, 5 + 3 * time), gap)
    np.testing.assert_allclose(prediction.at(3.0), 14.0, rtol=1e-14)


@pytest.mark.parametrize("rate", [0.05, -0.05])
def test_the_contact_is_right_to_the_point_where_its_edge_obeys_the_square_root(rate):
    prediction = PressurePrediction(X.size)

    def squared_width(time):
        return 0.3 + rate * time

    # The contact has to grow for mu to be learned, before it may shrink.
    for time in (-7.0, -6.0, -5.0, -4.0):
        pressure, gap = edge_law(0.3 + 0.05 * time)
        prediction.remember(time, pressure, gap, at_breakpoint=time == -4.0)
    for step in range(1, 5):
        prediction.remember(step, *edge_law(squared_width(step)))
    last, _ = edge_law(squared_width(4))
    for ahead in (0.3, 1.0):
        expected, _ = edge_law(squared_width(4 + ahead))
        guess = prediction.at(4 + ahead)
        np.testing.assert_array_equal(guess > 0, expected > 0)
        # Squares are extrapolated, and rounding in them is largest, next to nothing, at the edge.
        np.testing.assert_allclose(guess**2, expected**2, atol=1e-14 * SLOPE)
    assert ((last > 0) != (expected > 0)).any()


def test_a_contact_that_has_not_moved_yet_is_kept():
    # Without mu, unknown until the edge has passed a point, nothing may join.
    prediction = PressurePrediction(X.size)
    for step, width in enumerate((0.3, 0.3, 0.3)):
        prediction.remember(step, *edge_law(width))
    np.testing.assert_array_equal(prediction.at(3) > 0, edge_law(0.3)[0] > 0)


def test_steps_before_a_breakpoint_do_not_count():
    prediction = PressurePrediction(X.size)
    for step in range(6):
        prediction.remember(step, *edge_law(0.3 + 0.01 * step), at_breakpoint=step == 5)
    np.testing.assert_array_equal(prediction.at(5.7), edge_law(0.35)[0])
    prediction.remember(6, *edge_law(0.37))
    expected, _ = edge_law(0.39)  # two steps make a straight line
    np.testing.assert_array_equal(prediction.at(7) > 0, expected > 0)
    np.testing.assert_allclose(prediction.at(7) ** 2, expected**2, atol=1e-14 * SLOPE)


def test_nothing_is_guessed_from_nothing_and_a_guess_belongs_to_whoever_asked_for_it():
    prediction = PressurePrediction(3)
    for expected in (np.zeros(3), np.ones(3)):
        np.testing.assert_array_equal(prediction.at(1.0), expected)
        prediction.at(1.0)[:] = 9.0
        np.testing.assert_array_equal(prediction.at(1.0), expected)
        prediction.remember(0.0, np.ones(3), np.zeros(3))


def test_a_contact_that_vanishes_far_from_one_that_stays_is_seen():
    # Where there is no contact now nor was any before, nothing is looked at.
    prediction = PressurePrediction(4096)
    stays, vanishes = np.zeros(4096), np.zeros(4096)
    stays[100:150] = 1.0
    vanishes[3000:3050] = 1.0
    for time, pressure in enumerate((stays + vanishes, stays + vanishes, stays, stays)):
        prediction.remember(time, pressure, 1.0 - pressure)
        assert prediction.state()["moves"] == (1 if time == 2 else 0)
