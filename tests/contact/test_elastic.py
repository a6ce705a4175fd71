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


@pytest.mark.parametrize(("n", "m"), [(256, 16), (512, 200)])
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


def test_a_parabola_all_the_way_down(run, parabola_on_halfspace):
    n = 2048
    settings = {"grid.points": n, "time": {"end": 1.0, "step": 0.05}, "layer.thickness": 0.0}
    found = run(settings | {"solver.tolerance": 1e-8, "trajectory.depth": 0.1})
    areas, pressures = parabola_on_halfspace(found["depth"][1:])
    assert areas[-1] > 0.35
    assert (np.abs(found["contact_area"][1:] - areas) < 2 / n).all()
    for a, exact, p in zip(areas / 2, pressures, found["mean_pressure"][1:], strict=True):
        off = parabola_grid_error(n, a) / 2 + 1e-8 * exact / a  # p_max is less than pbar/a
        assert abs(p - exact) < off


def test_the_pressure_of_a_small_contact_is_hertzs(run):
    n = 2**12
    settings = {"grid.points": n, "layer.thickness": 0.0, "time": {"end": 1.0, "step": 1.0}}
    found = run(settings | {"solver.tolerance": 1e-8, "trajectory.depth": 1e-3, "output.snapshots": [1.0]})
    a = math.sqrt(4 * 2 * found["mean_pressure"][-1] * RADIUS / (np.pi * E_STAR))
    # The neighbours, a period away, matter by psi^2/6, ln cos psi being what it is.
    neighbours, m = (np.pi * a) ** 2 / 6, a * n
    assert neighbours < 1e-3
    x, pressure = Grid((n,), (1.0,)).coordinates[0], found.snapshots[-1][2]
    profile = E_STAR * a / (2 * RADIUS) * np.sqrt(np.maximum(1 - (x / a) ** 2, 0))
    inside = np.abs(x) < 0.9 * a
    # Away from the edge the grid's error is that of the mean, but for a factor.
    np.testing.assert_allclose(pressure[inside], profile[inside], rtol=2 * neighbours + 10 / m**2)
    assert (pressure[np.abs(x) > a + 1 / n] < 1e-8 * pressure.max()).all()
