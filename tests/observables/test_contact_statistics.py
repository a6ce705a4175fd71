"""Statistics of a rough contact: distributions, patches and the mean gap."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gfmdlayer.grid.grid import Grid
from gfmdlayer.observables import contact_statistics
from gfmdlayer.observables.contact_statistics import histogram

BUMPS = {
    "punch": {"shape": "sinusoid", "amplitude": 0.01, "wavelength": 0.25}, "solver": {"method": "active_set"},
    "trajectory.depth": 0.005, "time.end": 2.0, "time.step": 0.5, "output.patches": True,
    "output.histograms.pressure": {"max": 8.0, "bins": 40},
    "output.histograms.gap": {"scale": "log", "min": 1e-5, "max": 0.1, "bins": 40},
}  # fmt: skip


def count_patches(touching):
    return contact_statistics.count_patches(touching, Grid(touching.shape, (1.0,) * touching.ndim))


def flooded(touching):
    """Count patches by walking from point to point around the cell."""
    left, count = {tuple(place) for place in np.argwhere(touching).tolist()}, 0
    while left:
        reached, count = [left.pop()], count + 1
        while reached:
            place = reached.pop()
            for step in (*np.eye(touching.ndim, dtype=int), *-np.eye(touching.ndim, dtype=int)):
                near = tuple(((place + step) % touching.shape).tolist())
                if near in left:
                    left.remove(near)
                    reached.append(near)
    return count


@settings(deadline=None, max_examples=100)
@given(
    hnp.arrays(np.bool_, st.one_of(st.tuples(st.integers(8, 20)), st.tuples(st.just(8), st.integers(8, 9))))
)
def test_a_walk_around_the_cell_finds_the_same_patches(touching):
    assert count_patches(touching) == flooded(touching)


def test_patches_are_whole_across_the_edges_of_the_cell():
    corner = np.zeros((8, 8), bool)
    corner[[0, 0, -1, -1], [0, -1, 0, -1]] = True
    assert count_patches(corner) == 1
    assert count_patches(np.eye(8, dtype=bool)) == 8  # points that share a corner are not neighbours
    assert count_patches(np.ones((8, 8), bool)) == 1
    assert count_patches(np.zeros(8, bool)) == 0


def test_histogram_counts_every_chosen_value_once():
    values = np.random.default_rng(1).exponential(1.0, 10_000)
    values[:3] = (-1e-18, 0.5, 2.0)  # rounding below zero, and edges, which belong to the bin above them
    edges = np.array([0.0, 0.5, 1.0, 2.0, np.inf])
    chosen = np.arange(values.size) % 3 > 0
    expected = np.histogram(np.maximum(values[chosen], 0), edges)[0] / values.size
    np.testing.assert_array_equal(histogram(values, chosen, edges), expected)
    assert histogram(values, chosen, edges).sum() == pytest.approx(chosen.mean(), rel=1e-14)


@pytest.mark.parametrize(("points", "waves"), [(512, 4), ([64, 48], 16)])
def test_each_wave_makes_a_patch_and_distributions_carry_the_means(run, points, waves):
    found = run(BUMPS | {"grid.points": points, "grid.period": 1.0})
    assert found["patches"].tolist() == [0, *[waves] * 4]
    if waves == 4:  # the mean height of A (1 - cos) is A; an incompressible layer keeps its mean height
        np.testing.assert_allclose(found["mean_gap"], 0.01 - found["depth"], atol=1e-15)
    pressure, gap = found["pressure_histogram"], found["gap_histogram"]
    # 42 bins share out all points: sums of multiples of 1/n round by less than 1e-14.
    np.testing.assert_allclose(pressure.sum(axis=1), found["contact_area"], atol=1e-14)
    np.testing.assert_allclose(gap.sum(axis=1), 1 - found["contact_area"], atol=1e-14)
    assert found["contact_area"][-1] > 0.04
    # Every pressure and every gap lies within its bin, so their means lie between those of the edges; what is
    # counted in neither distribution is below the solver's tolerance of the largest value.
    gaps = np.concatenate(([0.0], np.geomspace(1e-5, 0.1, 41)))
    for counts, edges, mean, slack in (
        (
            pressure,
            np.linspace(0, 8, 41),
            2 * found["mean_pressure"],
            1e-6 * 8,
        ),  # ptilde = pbar/(2 G0), G0 = 1
        (gap, gaps, found["mean_gap"], 1e-8),
    ):
        assert (counts[:, -1] == 0).all()
        assert (counts[:, :-1] @ edges[:-1] <= mean + slack).all()
        assert (mean - slack <= counts[:, :-1] @ edges[1:]).all()


def test_pressures_of_full_contact_with_a_wave_follow_the_arcsine_law(run):
    n, amplitude = 4096, 0.01
    star = 4.0 * np.pi * amplitude  # p* = E* q A/2 with E* = 4 G, on a punch A (1 - cos q x), q = 2 pi
    load = 1.5 * star
    found = run({
        "grid.points": n, "layer.thickness": 0,
        "punch": {"shape": "sinusoid", "amplitude": amplitude, "wavelength": 1.0},
        "trajectory": {"control": "load", "load": load},
        "solver": {"method": "active_set", "tolerance": 1e-9}, "time.end": 2.0, "time.step": 1.0,
        "output.histograms.pressure": {"max": 3 * star, "bins": 30},
    })  # fmt: skip
    assert found["contact_area"][-1] == 1
    edges = np.append(np.linspace(0, 3 * star, 31), np.inf)
    law = 0.5 + np.arcsin(np.clip((edges - load) / star, -1, 1)) / np.pi
    # p = load + p* cos(q x) crosses an edge twice in the cell, each time by at most one point off; where it
    # touches its extremes, at edges of bins, rounding may move the two or three points there.
    np.testing.assert_allclose(found["pressure_histogram"][-1], np.diff(law), atol=4.5 / n)
