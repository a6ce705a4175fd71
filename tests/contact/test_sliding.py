"""Steps under a moving punch that need more than the iteration over problems without loss."""

import numpy as np
import pytest

from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.contact.loss_stiffness import LossStiffnessSolver
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms

N, TOLERANCE = 128, 1e-6
GRID = Grid((N,), (1.0,))
LOSS = 5.0  # over the stiffness: sin delta is 0.98


def solve(stiffness, load):
    """Solve under a parabola on a rippled surface, whose waves have all a large loss."""
    x, q = GRID.coordinates[0], GRID.wavenumbers
    ripples = np.fft.rfft(0.01 * np.sin(6 * np.pi * x) + 0.003 * np.cos(22 * np.pi * x))
    problem = Problem(
        stiffness, stiffness * ripples, 2 * x**2, load, LOSS * stiffness * np.minimum(q / 10, 1), 0.5
    )
    transforms = Transforms((N,))
    solver = LossStiffnessSolver(ActiveSet(transforms), transforms, GRID.parseval_weights)
    return problem, solver.solve(problem, np.zeros(N), TOLERANCE)


def test_without_load_the_surface_is_the_free_one():
    q = GRID.wavenumbers
    problem, found = solve(q.copy(), 0.0)
    assert found.converged
    assert not found.pressure.any()
    assert problem.loss_stiffness is not None
    free = np.zeros(q.size, complex)
    free[1:] = problem.intercept[1:] / (problem.stiffness + 1j * problem.loss_stiffness)[1:]
    u = np.fft.irfft(free, N)
    np.testing.assert_allclose(found.gap, problem.obstacle - u - (problem.obstacle - u).min(), atol=1e-12)


@pytest.mark.parametrize("base", [1e-2, 1e-5, 1e-8])
def test_a_stiff_film_on_a_soft_base(base):
    q = GRID.wavenumbers
    stiffness = base * q + (0.01 * q) ** 3 / (1 + (0.01 * q) ** 2)
    load = 0.05 * float(stiffness[1])
    problem, found = solve(stiffness, load)
    assert found.converged
    assert found.mean_pressure == pytest.approx(load, rel=1e-9)
    assert problem.loss_stiffness is not None
    # What is returned obeys the equation of the moving surface: the gap is that of the pressure.
    force = np.fft.rfft(found.pressure)
    stiff = (problem.stiffness + 1j * problem.loss_stiffness)[1:]
    spectrum = np.append(0, (problem.intercept[1:] - force[1:]) / stiff)
    gap = problem.obstacle - np.fft.irfft(spectrum, N)
    depth = -found.displacement.min() + found.displacement.mean()
    np.testing.assert_allclose(found.gap - found.gap.mean(), gap - gap.mean(), atol=10 * TOLERANCE * depth)
