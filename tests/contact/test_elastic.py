"""A periodic parabola and Hertz's line on an elastic halfspace: the errors of the grid reach their bounds.

Near the edge of contact the pressure is k s^(1/2) a distance s inside, and the grid with spacing D changes
the mean pressure by C D^2 times a known function of the contact (`parabola_grid_error`). Only C is measured:
it is a periodic function of where between two points the edge lies.
"""

import math

import numpy as np
import pytest

from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.verification.theory import (
    E_STAR,
    RADIUS,
    parabola_depth,
    parabola_grid_error,
    parabola_pressure,
)

ELASTIC = {"model": "zener", "G0": 1.0, "Ginf": 1.0}
halfspaces = pytest.mark.parametrize(
    "body",
    [
        {"layer.thickness": 0.0, "halfspace.shear_modulus": 1.0},
        {"layer.material": ELASTIC, "halfspace.shear_modulus": 1.0},
        {"layer.material": ELASTIC, "layer.thickness": math.inf, "halfspace.shear_modulus": 7.0},
    ],
    ids=["no layer", "all alike", "layer alone"],
)


@pytest.mark.parametrize(("n", "m"), [(256, 16), (2048, 60), (512, 200), (8192, 60)])
def test_the_grids_error_is_of_second_order_and_reaches_its_bound(n, m):
    grid, errors = Grid((n,), (1.0,)), []
    solver, stiffness = ActiveSet(Transforms((n,))), E_STAR / 2 * grid.wavenumbers
    for place in np.linspace(0, 1, 21):  # of the edge of contact between two points
        a = (m + place) / n
        obstacle = grid.coordinates[0] ** 2 / (2 * RADIUS) - float(parabola_depth(a))
        problem = Problem(stiffness, np.zeros(stiffness.size, complex), obstacle)
        found = solver.solve(problem, np.zeros(n), 1e-9)
        errors.append((found.mean_pressure - float(parabola_pressure(a))) / parabola_grid_error(n, a))
        assert abs(found.contact_area / 2 - a) * n < 1
    # In units of the bound the error goes from -0.98 to 0.52 at any n and m.
    assert -1 < min(errors) < -0.95
    assert 0.49 < max(errors) < 0.55


@halfspaces
@pytest.mark.parametrize("integrator", ["backward_euler", "exponential"])
def test_a_parabola_on_a_halfspace(body, integrator, run, parabola_on_halfspace):
    n = 2**14
    settings = {"grid.points": n, "time": {"end": 1.0, "step": 1.0, "integrator": integrator}}
    found = run(settings | body | {"solver.tolerance": 1e-8}).rows[-1]
    (area,), (pressure,) = parabola_on_halfspace(0.01)
    # Closed form in thirty digits.
    assert (area, pressure) == pytest.approx((0.09008464725, 0.01279016487), rel=1e-9)
    # A solver that leaves 1e-8 p_max on the open surface is off by no more in the mean; p_max = 14 pbar.
    assert parabola_grid_error(n, area / 2) / 2 < 1.5e-7 * pressure
    assert found["mean_pressure"] == pytest.approx(pressure, rel=1.5e-7 + 1.4e-7)
    assert abs(found["contact_area"] - area) < 2 / n


@pytest.mark.parametrize(
    ("bulk", "n", "pressure"), [(4.0, 4096, 0.0376030), (0.4, 4096, 0.0058981), (0.1, 16384, 0.0019038)]
)
def test_an_elastic_layer_against_another_code(bulk, n, pressure, run):
    # Tamaas 2.9.0 with the layer's kernel, on the same grid: five digits and a half.
    elastic = {"layer.material": ELASTIC, "halfspace.shear_modulus": bulk, "grid.points": n}
    steps = {"time": {"end": 1.0, "step": 1.0}, "solver.tolerance": 1e-8}
    assert run(elastic | steps)["mean_pressure"][-1] == pytest.approx(pressure, rel=3e-5)


def test_a_parabola_all_the_way_down(run, parabola_on_halfspace):
    n = 4096
    settings = {"grid.points": n, "time": {"end": 1.0, "step": 0.05}, "layer.thickness": 0.0}
    found = run(settings | {"solver.tolerance": 1e-8, "trajectory.depth": 0.1})
    areas, pressures = parabola_on_halfspace(found["depth"][1:])
    assert areas[-1] > 0.35
    assert (np.abs(found["contact_area"][1:] - areas) < 2 / n).all()
    for a, exact, p in zip(areas / 2, pressures, found["mean_pressure"][1:], strict=True):
        off = parabola_grid_error(n, a) / 2 + 1e-8 * exact / a  # p_max is less than pbar/a
        assert abs(p - exact) < off


def test_the_pressure_of_a_small_contact_is_hertzs(run):
    n = 2**14
    settings = {"grid.points": n, "layer.thickness": 0.0, "time": {"end": 1.0, "step": 1.0}}
    found = run(settings | {"solver.tolerance": 1e-8, "trajectory.depth": 1e-3, "output.snapshots": [1.0]})
    a = math.sqrt(4 * 2 * found["mean_pressure"][-1] * RADIUS / (np.pi * E_STAR))
    # The neighbours, a period away, matter by psi^2/6, ln cos psi being what it is.
    neighbours, m = (np.pi * a) ** 2 / 6, a * n
    assert neighbours < 3e-4
    assert abs(found["contact_area"][-1] / 2 - a) < 1 / n + neighbours * a
    x, pressure = Grid((n,), (1.0,)).coordinates[0], found.snapshots[-1][2]
    profile = E_STAR * a / (2 * RADIUS) * np.sqrt(np.maximum(1 - (x / a) ** 2, 0))
    inside = np.abs(x) < 0.9 * a
    # Away from the edge the grid's error is that of the mean, but for a factor.
    np.testing.assert_allclose(pressure[inside], profile[inside], rtol=2 * neighbours + 10 / m**2)
    assert (pressure[np.abs(x) > a + 1 / n] < 1e-8 * pressure.max()).all()


@halfspaces
def test_an_elastic_body_forgets(body, run):
    found = run(body | {"time.end": 2.0, "time.step": 0.25, "grid.points": 512, "solver.tolerance": 1e-9})
    # The hold: what the ramp reached, to the solver's tolerance times p_max/pbar = 14.
    np.testing.assert_allclose(found["mean_pressure"][4:], found["mean_pressure"][4], rtol=1e-7)
    assert np.ptp(found["contact_area"][4:]) == 0
