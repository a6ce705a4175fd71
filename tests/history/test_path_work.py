"""The work of a step, from pressure and gap at its rows."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

from gfmdlayer.history.path_work import work_of_step


def rows_of(times, depths, pressures, gaps, prescribed=None):
    """Return the rows of a way, and what each sweeps since the row two before."""
    prescribed = depths if prescribed is None else prescribed

    def swept(i, j):
        return np.mean((pressures[i] + pressures[j]) * (gaps[j] - gaps[i]), axis=-1)

    count = len(times)
    one = [0.0, *(swept(i, i + 1) for i in range(count - 1))]
    two = [0.0, 0.0, *(swept(i, i + 2) for i in range(count - 2))]
    return np.column_stack((times, depths, np.mean(pressures, axis=-1), prescribed, one)), np.array(two)


def works(*way, known=2, prescribed=None):
    """Return the work of each step of a way from its second row on."""
    rows, two = rows_of(*way, prescribed=prescribed)
    return np.array([work_of_step(rows[i - 2 : i], known, rows[i], two[i]) for i in range(2, len(rows))])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("known", [1, 2])
def test_an_elastic_body_stores_the_work_whatever_the_contact_and_the_step(seed, known):
    # Any states of a symmetric body: p = K v, with the gap g = v - d, here also where p is not zero.
    rng = np.random.default_rng(seed)
    K = rng.normal(size=(6, 6))
    K += K.T
    v, depths, times = rng.normal(size=(5, 6)), rng.normal(size=5), np.cumsum(rng.uniform(0.1, 3.0, 5))
    stored = np.einsum("ni,ij,nj->n", v, K, v) / 2 / 6
    found = works(times, depths, v @ K, v - depths[:, np.newaxis], known=known)
    np.testing.assert_allclose(found, np.diff(stored)[1:], rtol=1e-12, atol=1e-12)


def smooth(count):
    """A way of two points with smooth pressures and displacements, in steps of unequal length."""
    times = np.linspace(0.0, 1.0, count + 1) ** 1.5 + 1.0
    v = np.column_stack((np.sin(times), times**2))
    p = np.column_stack((np.exp(-times) * times**2, np.cos(times)))
    depths = times**1.5
    return times, depths, p, v - depths[:, np.newaxis]


def test_relaxation_in_the_steps_is_integrated_to_third_order():
    def exact(start):
        t = np.linspace(start, 2.0, 20_001)
        power = np.exp(-t) * t**2 * np.cos(t) + np.cos(t) * 2 * t
        return trapezoid(power, t) / 2

    counts = [8, 16, 32]
    errors = [abs(works(*smooth(count)).sum() - exact(smooth(count)[0][1])) for count in counts]
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert order == pytest.approx(3.0, abs=0.3)


def test_while_the_drive_rests_the_work_is_that_of_force_and_depth_alone():
    times, depths, p, gaps = smooth(4)
    means = p.mean(axis=1)
    found = works(times, depths, p, gaps, prescribed=np.ones(5))
    np.testing.assert_allclose(found, (np.diff(depths) * (means[:-1] + means[1:]) / 2)[1:], rtol=1e-15)
    assert works(times, np.ones(5), p, gaps).tolist() == [0.0] * 3


def test_there_and_back_cancel_without_a_row_before():
    way = smooth(4)
    there, back = works(*way, known=1), works(*(values[::-1] for values in way), known=1)
    np.testing.assert_allclose(there[:2], -back[1::-1], rtol=1e-12)
