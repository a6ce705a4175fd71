"""The V-cycle of adhesive steps: close to the inverse on any grid, and the solution does not know of it."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from gfmdlayer.contact import cycle
from gfmdlayer.contact.cycle import cycle_of
from gfmdlayer.contact.newton import solver
from gfmdlayer.contact.newton.solver import Newton
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.interface.adhesion import Exponential, LennardJones
from gfmdlayer.kernels import kernel


@kernel
def _answers(given, free, stiffness, forces):
    """Compile into one what the loop of the solver calls."""
    D = given.D[: free.size]
    for i in range(free.size):
        D[i] = stiffness[i] / given.unit if free[i] > 0 else cycle.PRESSED
    cycle.set_cycle(given)
    found = np.empty_like(forces)
    for k in range(len(forces)):
        cycle.run_cycle(given, forces[k], found[k])
    return found


def dense(kappa, shape):
    """K as a matrix over the points; a line is one row."""
    shape = (1, *shape)[-2:]
    row, n = np.fft.irfft2(kappa.reshape(shape[0], -1), shape), shape[0] * shape[1]
    i, j = np.divmod(np.arange(n), shape[1])
    return np.asarray(row[(i[:, None] - i) % shape[0], (j[:, None] - j) % shape[1]])


def rough(shape, seed):
    """Heights with random phases, spectrum q^-4, and the lowest point at zero."""
    q = np.maximum(Grid(shape, (1.0, 1.0)).wavenumbers, 2 * np.pi)
    noise = np.fft.rfft2(np.random.default_rng(seed).normal(size=shape))
    heights = np.fft.irfft2(noise * (q / (2 * np.pi)) ** -1.8, shape).ravel()
    return np.asarray(0.02 * (heights - heights.min()) / np.ptp(heights))


@pytest.mark.parametrize("shape", [(32, 32), (40, 24), (33, 27), (600,), (511,)])
def test_a_cycle_is_close_to_the_inverse_on_the_free_points(shape):
    """The eigenvalues of M (K + D) are within 1/2 and 2: a CG iteration leaves at most a third of the error.

    sqrt(c - 1)/(sqrt(c) + 1) with the condition c = 4. By K alone, without the coarser grids, c grows with n,
    and by D alone with its range, here 1e4. M is symmetric up to sums in single precision.
    """
    grid, rng = Grid(shape, (1.0,) * len(shape)), np.random.default_rng(1)
    kappa, n = 2.0 * np.ravel(grid.wavenumbers), grid.size
    given = cycle_of(grid, kappa, 4 * np.pi)
    for free, D in (
        (np.arange(n) < n // 2, np.full(n, 1.0)),
        (rng.random(n) < 0.8, 10 ** rng.uniform(0, 4, n)),
    ):
        moves = np.flatnonzero(free)
        forces = np.eye(n, dtype=np.float32)[moves]
        M = _answers(given, free.astype(np.float32), D.astype(np.float32), forces)[:, moves].astype(float)
        H = (dense(kappa, shape) + np.diag(D))[np.ix_(moves, moves)] / given.unit
        assert np.abs(M - M.T).max() < 1e-5 * np.abs(M).max()
        found = scipy.linalg.eigvals(M @ H).real
        assert found.min() > 0.5
        assert found.max() < 2.0


def test_cycles_are_for_stiffnesses_that_rise():
    """A thin incompressible layer, K ~ 1 + 1e4/q^4, is stiffest where waves are long."""
    grid = Grid((64, 64), (1.0, 1.0))
    q = np.ravel(grid.wavenumbers) / (2 * np.pi)
    layer = np.where(q > 0, 1.0 + 1e4 / np.maximum(q, 1.0) ** 4, 0.0)
    assert cycle.is_local(grid, 2.0 * q)
    assert not cycle.is_local(grid, layer)
    assert cycle_of(grid, 2.0 * q, 2.0).grids.size > 0


def followed(shape, monkeypatch, *, cycles):
    """Approach and retreat, with another stiffness in each step, then a given load."""
    monkeypatch.setattr(solver, "WORTH_CYCLE", 0 if cycles else 1 << 30)
    newton, height = Newton(Transforms(shape)), rough(shape, 3)
    law = Exponential(work=1e-3, range=1e-2).interaction()
    waves = np.ravel(Grid(shape, (1.0, 1.0)).wavenumbers)
    found, start = [], np.full(height.size, np.inf)
    drives = [(0.004, None), (0.006, None), (0.004, None), (0.0, 0.01)]
    for k, (depth, load) in enumerate(drives):
        kappa = (2.0 + 0.3 * k) * waves
        problem = Problem(kappa, np.zeros(kappa.size, complex), height - depth, load, interface=law)
        found.append(newton.solve(problem, start, 1e-6, 2000))
        start = found[-1].gap
    return found


@pytest.mark.parametrize("shape", [(48, 48), (45, 32)])
def test_the_cycle_changes_pairs_and_no_solution(shape, monkeypatch):
    """A law so weak that there is one minimum, w'' < kappa_1: both find it."""
    # The residual 1e-6 is a traction over the strength. It is an error of the displacement of at most 1e-6
    # strength/(margin kappa_1/2), here 1e-6 of the range over the margin; either may have it.
    by_transform = followed(shape, monkeypatch, cycles=False)
    by_cycle = followed(shape, monkeypatch, cycles=True)
    for one, other in zip(by_transform, by_cycle, strict=True):
        assert one.converged
        assert other.converged
        assert np.abs(one.gap - other.gap).max() < 2e-6 * 1e-2 * 2 / min(one.margin, other.margin)
    assert sum(each.transforms for each in by_cycle) < sum(each.transforms for each in by_transform)


def test_the_margin_is_the_least_curvature_of_a_stiff_law(monkeypatch):
    """Lennard-Jones: that of a dense eigenvalue problem on the free points with a fixed mean."""
    # The search ends where a turn lowers the margin by less than 1 % and .0015. Where the error falls by half
    # in a turn, what is left is less than that. Of 24 such states it was up to 8 % in 23, and a third in one,
    # where the mode that was followed had become the second. By transforms it ended at .86 to .91.
    monkeypatch.setattr(solver, "WORTH_CYCLE", 0)
    shape, work, reach = (32, 32), 1e-3, 2e-3
    law, height = LennardJones(work=work, separation=reach).interaction(), rough(shape, 7)
    kappa = 2.0 * np.ravel(Grid(shape, (1.0, 1.0)).wavenumbers)
    newton, start = Newton(Transforms(shape)), np.full(height.size, np.inf)
    K = dense(kappa, shape)
    for depth in (0.001, 0.002, 0.004, 0.006):
        problem = Problem(kappa, np.zeros(kappa.size, complex), height - depth, interface=law)
        found = newton.solve(problem, start, 1e-6, 2000)
        start = found.gap
        gap = found.gap
        curvature = law.curvature(gap)
        moves = np.flatnonzero((gap > 0) | (found.pressure + law.traction(gap) <= 0))
        basis = scipy.linalg.null_space(np.ones((1, moves.size)))
        half = 0.5 * problem.residual_floor.stiffness
        free, half = K[np.ix_(moves, moves)], 0.5 * problem.residual_floor.stiffness * np.eye(moves.size)
        H, B = (basis.T @ (free + D) @ basis for D in (np.diag(curvature[moves]), half))
        exact = float(scipy.linalg.eigh(H, B, subset_by_index=[0, 0], eigvals_only=True)[0])
        assert exact - 1e-3 <= found.margin <= 1.04 * exact + 0.006


OVER_RANKS = """
import numpy as np
from mpi4py import MPI
from gfmdlayer.contact.cycle import cycle_of
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import MpiRanks
from gfmdlayer.grid.slabs import SlabGrid
from test_cycle import _answers

ranks = MpiRanks(MPI.COMM_WORLD)
for points in ((40, 24), (33, 27), (16, 40)):
    whole, grid = Grid(points, (1.0, 1.0)), SlabGrid(points, (1.0, 1.0), members=ranks)
    rng = np.random.default_rng(1)
    free, D, force = rng.random(points) < 0.8, 10 ** rng.uniform(0, 4, points), rng.normal(size=points)
    free, D, force = (each.astype(np.float32) for each in (free, D, free * force))
    M = []
    for each, rows in ((whole, slice(None)), (grid, grid.rows)):
        given = cycle_of(each, 2.0 * np.ravel(each.wavenumbers), 4 * np.pi)
        M.append(_answers(given, free[rows].ravel(), D[rows].ravel(), force[rows].reshape(1, -1)))
    wrong = abs(M[1] - M[0].reshape(points)[grid.rows].ravel()).max()
    assert wrong < 1e-5 * abs(M[0]).max(), (points, ranks.number, wrong)
if ranks.first:
    print("all agree")
"""


@pytest.mark.slow
def test_a_cycle_over_ranks_is_that_of_one_process():
    """Sums of 13 terms and over the grids in single precision: some 1e-6 of the largest answer."""
    command = [str(Path(sys.executable).parent / "mpirun"), "-n", "3", sys.executable, "-c", OVER_RANKS]
    given = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, env=given)
    assert done.stdout == "all agree\n", done.stderr
