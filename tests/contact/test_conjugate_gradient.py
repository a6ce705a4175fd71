"""What is particular to the method of Polonsky and Keer; its answers are tested with the active set's."""

import numpy as np
import pytest

from gfmdlayer.body.layer import LayeredHalfspace
from gfmdlayer.contact.bounded import ConjugateGradient
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms


def hertz(n, *, load=None, mean_stiffness=0.0):
    """Return a parabola on a halfspace."""
    grid = Grid((n,), (1.0,))
    kappa = 2 * grid.wavenumbers
    kappa[0] = mean_stiffness
    return Problem(kappa, np.zeros(kappa.size, complex), 2 * grid.coordinates[0] ** 2 - 0.01, load)


def energy(problem, pressure):
    """p.A p/2 + h.p a point."""
    compliance = np.divide(
        1, problem.stiffness, out=np.zeros_like(problem.stiffness), where=problem.stiffness > 0
    )
    effect = np.fft.irfft(compliance * np.fft.rfft(pressure), n=pressure.size)
    return float((pressure * (0.5 * effect + problem.obstacle)).mean())


CASES = [{}, {"load": 0.05}, {"mean_stiffness": 3.0}]


@pytest.mark.parametrize("case", CASES, ids=["depth", "load", "free mean"])
@pytest.mark.parametrize("n", [500, 1024, 4096])
def test_an_iteration_takes_one_pair_of_transforms(n, case):
    problem = hertz(n, **case)
    found = ConjugateGradient(Transforms((n,))).solve(problem, np.zeros(n))
    assert found.converged
    # Beside the iterations: the gap of the start, of the end, and both once more where a gap is aimed at.
    assert found.iterations < found.transforms <= found.iterations + 5


def test_the_energy_never_rises():
    # Under a given load what is returned after too few iterations is the pressure itself.
    n = 200
    problem = hertz(n, load=0.05)
    start = np.random.default_rng(0).uniform(0, 1, n)
    solver = ConjugateGradient(Transforms((n,)))
    course = [solver.solve(problem, start, 1e-9)]
    for limit in range(1, 60):
        course.insert(-1, solver.solve(problem, start, 1e-9, limit))
    energies = np.array([energy(problem, found.pressure) for found in course])
    assert (np.diff(energies) <= 1e-14 * np.abs(energies).max()).all()
    assert energies[-1] < energies[0]


def test_the_number_of_iterations_grows_less_than_the_grid():
    # A_CC has eigenvalues from 1/kappa_1 down to 1/kappa_(n/2): conjugate gradients need the square root of
    # their ratio in the worst case, a factor of 4 here, on a contact set that is known; finding it from
    # nothing is given a factor of 1.5.
    taken = [ConjugateGradient(Transforms((n,))).solve(hertz(n), np.zeros(n)).iterations for n in (512, 8192)]
    assert taken[1] <= 1.5 * 4 * taken[0]


def test_it_stops_where_only_rounding_is_left():
    found = ConjugateGradient(Transforms((128,))).solve(hertz(128), np.zeros(128), 1e-18)
    assert found.residual < 1e-12
    assert (found.displacement <= hertz(128).obstacle).all()


@pytest.mark.parametrize("modulus", [1e3, 1e4])
def test_steps_carry_the_load_of_the_last_one_however_long_they_become(modulus):
    # A stiff film on a soft base in full contact: some steps are a hundred times as long as tried, which made
    # of rounding in the load a hundredth of it, and 6 of these 200 solves ended short of the tolerance.
    grid = Grid((128,), (1.0,))
    kappa = LayeredHalfspace(thickness=0.05, poisson=0.5, bulk_modulus=1.0).stiffness(
        grid.wavenumbers, modulus
    )
    kappa[0] = 0.0
    h, solver = 1 - np.cos(4 * np.pi * grid.coordinates[0]), ConjugateGradient(Transforms((128,)))
    problem = Problem(kappa, np.zeros(kappa.size, complex), h, 1.5 * kappa[2])
    for seed in range(100):
        found = solver.solve(problem, kappa[2] * np.random.default_rng(seed).uniform(0, 3, 128), 1e-3)
        assert found.converged
        np.testing.assert_allclose(found.mean_pressure, 1.5 * kappa[2], rtol=1e-12)
