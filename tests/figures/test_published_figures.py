"""What the paper says about its Figures 2 to 4, on a smaller grid and with the exponential integrator.

A contact that changes by less than a point on either side is the same to the grid: 2/n.
"""

import math
from itertools import pairwise

import numpy as np
import pytest

POINT = 2 / 2048
THICKNESSES = [0.0, 1 / 32, 1 / 16, 1 / 8, 1 / 4, math.inf]
BULK_MODULI = [4.0, 16.0, 64.0, 256.0, math.inf]
GLASSY_MODULI = [2.0, 3.0, 5.0, 9.0, 17.0]


def sweep(run, key, values, **rest):
    common = {name.replace("__", "."): value for name, value in rest.items()}
    return [run(common | {key: value}) for value in values]


def zener(Ginf):
    return {"model": "zener", "G0": 1.0, "Ginf": Ginf, "tau": 1.0}


@pytest.fixture(scope="module")
def figure2(run):
    return sweep(run, "layer.thickness", THICKNESSES, halfspace__shear_modulus=10.0)


@pytest.fixture(scope="module")
def figure3(run):
    return sweep(run, "halfspace.shear_modulus", BULK_MODULI)


@pytest.fixture(scope="module")
def figure4(run):
    return sweep(run, "layer.material", [zener(Ginf) for Ginf in GLASSY_MODULI])


def held(found, name):
    """A column after the ramp."""
    return np.asarray(found[name][found["time"] >= 1 - 1e-9])


def test_at_first_the_responses_are_the_same_whatever_the_thickness(run):
    # The layer answers with Ginf = G_bulk and has relaxed by t/tau, no more: what the responses differ by
    # falls with time.  The contact has to cover some points, so the ramp is as short as the time.
    differences = []
    for time in (1e-2, 1e-3, 1e-4):
        fast = {"trajectory.ramp_time": time, "time.step": time, "time.end": time}
        cases = [run(fast | {"halfspace.shear_modulus": 10.0, "layer.thickness": d}) for d in THICKNESSES]
        pressures = np.array([found["mean_pressure"][-1] for found in cases])
        areas = np.array([found["contact_area"][-1] for found in cases])
        assert np.ptp(areas) <= POINT
        # G falls from 10 by 9 t/tau over the ramp, by half of it in the mean.
        differences.append(np.ptp(pressures) / pressures[0])
        assert differences[-1] < 0.45 * time * 1.1 + 1e-5
    assert differences[0] > 5 * differences[1] > 25 * differences[2]


def test_along_the_papers_own_ramp_they_begin_together(figure2):
    pressures = np.array([found["mean_pressure"][1] for found in figure2])  # t = 0.05 tau
    assert np.ptp(pressures) < 0.45 * 0.05 * 1.1 * pressures[0]
    assert np.ptp([found["contact_area"][1] for found in figure2]) <= POINT


def test_without_a_layer_and_with_nothing_but_the_contact_is_the_same_and_constant_in_the_hold(figure2):
    without, alone = figure2[0], figure2[-1]
    np.testing.assert_allclose(without["contact_area"], alone["contact_area"], atol=POINT, rtol=0)
    assert np.ptp(held(without, "contact_area")) == 0
    np.testing.assert_allclose(held(without, "mean_pressure"), without["mean_pressure"][-1], rtol=1e-4)
    assert np.ptp(held(alone, "contact_area")) <= POINT
    assert (np.diff(held(alone, "mean_pressure")) < 0).all()


def test_the_contact_rises_with_the_thickness_to_a_sixteenth_and_falls_again(figure2):
    areas = np.array([held(found, "contact_area") for found in figure2])
    late = figure2[0]["time"][figure2[0]["time"] >= 1 - 1e-9] >= 2
    for thinner, thicker in pairwise(range(3)):
        assert (areas[thicker] >= areas[thinner] - POINT).all()
        assert (areas[thicker] > areas[thinner] + POINT)[late].all()
    for thinner, thicker in pairwise(range(2, 6)):
        assert (areas[thicker] <= areas[thinner] + POINT).all()
        assert (areas[thicker] < areas[thinner] - POINT)[late].all()
    assert set(areas[:, late].argmax(axis=0)) == {2}


def test_the_contact_rises_with_the_bulk_modulus(figure3):
    for softer, harder in pairwise(figure3):
        assert (harder["contact_area"] >= softer["contact_area"] - POINT).all()
    ends = [found["contact_area"][-1] for found in figure3]
    for softer, harder in pairwise(ends[:4]):
        assert harder > softer + POINT
    assert ends[4] >= ends[3]  # 256 is nearly rigid already


def test_on_a_rigid_base_the_contact_is_constant_in_the_hold(figure3):
    assert np.ptp(held(figure3[-1], "contact_area")) <= POINT
    # Below it is not: the layer softens against its base.
    assert np.ptp(held(figure3[0], "contact_area")) > 20 * POINT


def test_a_higher_glassy_modulus_lowers_the_contact_and_raises_the_pressure(figure4):
    for softer, harder in pairwise(figure4):
        assert (harder["contact_area"] <= softer["contact_area"] + POINT).all()
        assert (harder["mean_pressure"] >= softer["mean_pressure"] - 1e-9).all()
    at_the_end_of_the_ramp = [held(found, "contact_area")[0] for found in figure4]
    assert all(harder < softer - POINT for softer, harder in pairwise(at_the_end_of_the_ramp))
    for softer, harder in pairwise(figure4):
        later = softer["time"] > 0
        assert (harder["mean_pressure"] > softer["mean_pressure"])[later].all()


def test_in_the_end_all_of_them_are_the_same_elastic_halfspace(figure4, run, parabola_on_halfspace):
    # The slowest mode relaxes by Ginf tau/G0, 17 tau; after 15 times that 3e-7 of the glassy pressure is
    # left.
    long = {"time.end": 260.0, "time.step": 0.5, "grid.points": 2048, "solver.tolerance": 1e-7}
    (area,), (pressure,) = parabola_on_halfspace(0.01)
    for found in figure4:  # on the way
        assert held(found, "mean_pressure")[0] > found["mean_pressure"][-1] > pressure
    for Ginf in GLASSY_MODULI:
        found = run(long | {"layer.material": zener(Ginf)})
        assert abs(found["contact_area"][-1] - area) <= POINT
        # The grid's error with 92 points on either side of the middle, at most 9e-6.
        assert found["mean_pressure"][-1] == pytest.approx(pressure, rel=1.5e-5)
