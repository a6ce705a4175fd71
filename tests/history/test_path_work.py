"""The work of a step along the curve of mean pressure over depth."""

import numpy as np
import pytest

from gfmdlayer.history.path_work import work_along


def work(depths, curve):
    """Sum the work of all steps from the second point on; the first one is the point before."""
    rows = np.column_stack((0 * depths, depths, curve(depths)))
    steps = zip(rows[:-2], rows[1:-1], rows[2:], strict=True)
    return sum(work_along(np.array([one, two]), 2, new[1], new[2]) for one, two, new in steps)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])  # of a line, of Hertz's paraboloid, of a cone
@pytest.mark.parametrize("depths", [[0.1, 0.3, 1.0], [0.2, 0.21, 5.0, 5.5], [2.0, 1.5, 0.1]])
def test_power_laws_are_integrated_exactly_over_steps_of_any_length(exponent, depths):
    depths = np.array(depths)
    exact = (depths[-1] ** (exponent + 1) - depths[1] ** (exponent + 1)) / (exponent + 1)
    assert work(depths, lambda d: d**exponent) == pytest.approx(exact, rel=1e-12)


def test_the_first_step_of_a_paraboloid_does_two_fifths_of_force_times_depth():
    touched = np.array([[0.0, 0.0, 0.0], [0.0, 1e-3, 1e-3**1.5]])
    small = work_along(touched, 1, 4.0, 8.0)
    assert small + 0.4 * 1e-3**2.5 == pytest.approx(2 / 5 * 8.0 * 4.0, rel=1e-12)


def test_other_curves_are_integrated_to_third_order():
    def curve(depth):
        return depth**1.5 * (1.3 + np.sin(depth))

    def error(count):
        depths = np.linspace(1.0, 2.0, count + 1)
        fine = np.linspace(depths[1], depths[-1], 100_001)
        return abs(work(depths, curve) - np.trapezoid(curve(fine), fine))

    counts = [16, 32, 64]
    order = -np.polyfit(np.log(counts), np.log([error(count) for count in counts]), 1)[0]
    assert order >= 2.8  # the bend of the last two steps is that of this one to first order


def test_a_punch_that_rests_does_no_work_and_a_free_one_none():
    rows = np.array([[0.0, 0.5, 1.0], [1.0, 1.0, 2.0]])
    assert work_along(rows, 2, 1.0, 1.2) == 0.0
    assert work_along(rows * (1, 1, 0), 2, 1.5, 0.0) == 0.0


def test_there_and_back_cancel():
    depths = np.array([0.3, 0.5, 0.8, 1.1])
    there = work(depths, np.sqrt)
    rows = np.column_stack((0 * depths, depths, np.sqrt(depths)))[::-1]
    back = work_along(rows[:1].repeat(2, axis=0), 1, *rows[1, 1:])
    back += work_along(rows[:2], 2, *rows[2, 1:])
    assert there + back == pytest.approx(0.0, abs=1e-12)
