"""Projected conjugate gradients with nested grids, on random rough problems and beside the active set."""

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate
from gfmdlayer.config import Config
from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.contact.nested.iteration import SearchForm, extent, form_of, settle
from gfmdlayer.contact.nested.solver import NestedGradient
from gfmdlayer.contact.problem import Problem
from gfmdlayer.contact.residual import assess, residual_scales
from gfmdlayer.contact.stencil import stencil
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.punch.self_affine import SelfAffine
from tests.recordings import Kept

TOLERANCE = 1e-6
MPIRUN = Path(sys.executable).parent / "mpirun"
SIZES = (64, 65, 67, 81, 90, 96, 97, 100, 101, 127, 128, 131, 144, 150, 180, 191, 192, 200, 243, 251, 256)


def problem_of(seed, sizes=SIZES, *, line=False):
    """A rough surface or line on a halfspace, or on a layer on a base up to 1000 times softer or stiffer."""
    # Loads go from one point in contact to full contact, or to the depths that these give.
    draw = np.random.default_rng(seed)
    nx = int(draw.choice(sizes))
    ny = nx if draw.random() < 0.7 else int(draw.choice(sizes))
    points = [nx] if line else [nx, ny]
    contrast = 10.0 ** draw.uniform(-3, 3) if draw.random() < 0.8 else math.inf
    layered = draw.random() < 0.8 or math.isinf(contrast)
    config = Config(name="rough").with_values(
        {
            "grid": {"points": points, "period": [1.0, float(draw.choice([1.0, ny / nx]))][: len(points)]},
            "layer.thickness": float(10 ** draw.uniform(-2.5, 0.5)) if layered else 0.0,
            "layer.poisson": float(draw.choice([0.5, 0.45, 0.3, 0.0])),
            "halfspace.shear_modulus": contrast,
            "punch": {
                "shape": "self_affine",
                "hurst": float(draw.uniform(0.3, 0.95)),
                "roll_off": float(draw.uniform(0.15, 0.6)),
                "short_cutoff": float(draw.uniform(4, 10) / min(points)),
                "rms_slope": float(10 ** draw.uniform(-3, 0)),
                "seed": seed,
            },
            "trajectory.control": "load",
            "trajectory.load": 1.0,
        }
    )
    case = Case(config)
    stiffness = np.array(case.contact.history.terms(1e9)[0])
    given_load = draw.random() < 0.6
    mean, stiffness[0] = float(stiffness[0]), 0.0
    nothing = np.zeros(stiffness.size, complex)
    transforms = case.transforms
    full = transforms.backward(stiffness * transforms.forward(case.punch)) / case.punch.size
    load = -float(full.min()) * 10 ** draw.uniform(-6, 0.3)
    problem = Problem(stiffness, nothing, case.punch, load)
    if given_load:
        return case, problem
    # The depth to which the load presses; the layer's own mean stiffness then counts.
    found = solved(case, problem)
    stiffness = stiffness.copy()
    stiffness[0] = mean
    lift = load / mean if mean > 0 else 0.0
    obstacle = case.punch - found.displacement.mean() - lift
    if mean == 0 and obstacle.mean() < 1e-3 * np.ptp(obstacle):
        return case, problem  # the punch all but fills the cell: there the depth says nothing about the load
    return case, Problem(stiffness, nothing, obstacle)


def solved(case, problem, start=None):
    solver = NestedGradient(case.transforms, case.grid)
    return solver.solve(problem, np.zeros(case.punch.size) if start is None else start, TOLERANCE)


def check(case, problem):
    """Check the solution in double precision; return its iterations.

    The unknown is exact, what follows from it within the tolerance: the displacement of a pressure, or the
    stress of a displacement.
    """
    found = solved(case, problem)
    assert found.converged
    kappa, p, u = problem.stiffness, found.pressure, found.displacement
    load = problem.mean_pressure
    assert load is None or p.mean() == pytest.approx(load, rel=1e-12)
    if form_of(case.grid, kappa).gaps:
        balance = p + case.transforms.backward(kappa * case.transforms.forward(u)) / u.size
        level = balance[found.gap > 0.0].mean() if problem.mean_is_fixed else load or 0.0
        assert np.abs(balance - level).max() <= TOLERANCE * p.max() + 1e-13 * np.abs(balance).max()
        rounding = 0.0
    else:
        waves = np.zeros(kappa.size, complex)
        np.divide(-case.transforms.forward(p), kappa, out=waves, where=kappa > 0)
        u = case.transforms.backward(waves) / u.size
        u += 0.0 if load is None else found.displacement.mean()
        depth = max(u.mean(), 0.0) - u.min()
        rounding = 1e-13 * (np.ptp(case.punch) + np.abs(u).max()) / depth * u.size**0.5
    residual, *_ = assess(p, u, problem.obstacle, problem.residual_floor)
    assert residual <= TOLERANCE + rounding
    assert p.min() >= 0.0
    assert (found.displacement <= problem.obstacle).all()
    return found.iterations


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(k, marks=pytest.mark.slow) for k in range(4, 8))])
def test_random_rough_problems_are_solved(seed):
    check(*problem_of(seed, sizes=(64, 65, 67, 90, 128, 131)))


@pytest.mark.parametrize("first", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(10, 200, 10))])
def test_random_rough_lines_are_solved(first):
    for seed in range(first, first + 10):
        check(*problem_of(seed, sizes=(256, 501, 1000, 1024, 2048), line=True))


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 200, 50))
def test_two_hundred_random_rough_problems_are_solved(first):
    """`scripts/soak.py` makes more."""
    for seed in range(first, first + 50):
        check(*problem_of(seed))


@pytest.mark.parametrize("line", [False, True])
@pytest.mark.parametrize("first", range(0, 60, 20))
def test_it_agrees_with_the_active_set(first, line):
    """The difference of two pressures is bounded by the tolerance."""
    # With the gap = gap0 + A p, p and gap >= 0, and gap <= tolerance D wherever p > 0, the differences dp and
    # dg = A dp of two solutions obey dp.A dp = dp.dg <= tolerance D sum |dp|: where both press, both gaps are
    # within tolerance D, and where one does, dp dg is at most its p times its gap. No value of A is below
    # 1/max kappa, so that the norm of dp is at most max kappa tolerance D sqrt(points that press). Under a
    # given load dg may have a shift too, which does no work on dp, whose sum is zero.
    for seed in range(first, first + 20):
        case, problem = problem_of(seed, sizes=(512, 501) if line else (64, 65, 67), line=line)
        found = solved(case, problem)
        other = ActiveSet(case.transforms, windows=False).solve(problem, np.zeros(case.punch.size), TOLERANCE)
        assert found.converged
        assert other.converged
        _, depth = residual_scales(other.pressure, other.displacement, problem.residual_floor)
        pressing = np.count_nonzero((found.pressure > 0) | (other.pressure > 0))
        bound = problem.stiffness.max() * TOLERANCE * depth * pressing**0.5
        assert np.linalg.norm(found.pressure - other.pressure) <= bound
        assert abs(found.contact_area - other.contact_area) * case.punch.size <= 2


@pytest.mark.parametrize("place", [0, 100, 255, 300, 520])
def test_a_residual_counts_wherever_it_is(place):
    """Also beside a last block of points that is a short one."""
    p, gap, h = np.zeros(530), np.ones(530), np.ones(530)
    p[place], gap[place] = 2.0, 0.5
    assert extent(0, 530, 0.0, None, h, p, gap)[1][0] == 2.0
    assert settle(0, 530, 1.0, 1.0, 0.0, h, p, gap, h.copy())[1][0] == 0.5


def film(points=(1024,), base=0.002):
    """A film on a base five hundred times softer: stiffness over wavenumber varies by 430."""
    config = Config(name="film").with_values(
        {
            "grid.points": points,
            "layer.thickness": 0.02,
            "halfspace.shear_modulus": base,
            "punch": {"shape": "self_affine", "hurst": 0.8, "roll_off": 0.5,
                      "short_cutoff": 0.02 if len(points) == 1 else 0.1, "rms_slope": 0.1, "seed": 2},
            "trajectory": {"control": "load", "load": 1.0},
        }
    )  # fmt: skip
    case = Case(config)
    stiffness = np.array(case.contact.history.terms(1e9)[0])
    stiffness[0] = 0.0
    full = case.transforms.backward(stiffness * case.transforms.forward(case.punch)) / case.punch.size
    return case, Problem(stiffness, np.zeros(stiffness.size, complex), case.punch, -0.3 * full.min())


@pytest.mark.parametrize("points", [(64, 64), (1024,)])
@pytest.mark.parametrize("depth_given", [False, True])
def test_a_stiff_film_takes_few_iterations(points, depth_given):
    """Of gaps, with a cycle that bends as the film does: by pressures it takes hundreds, or never ends."""
    # The eigenvalues of M K on the open points are within .16 and 1.06 (dense, on 32 x 32 points): the error
    # falls by .43 an iteration, in 12 from 1e-2 to .8e-6. From 1 to 1e-2 points join and leave most times.
    case, problem = film(points)
    assert form_of(case.grid, problem.stiffness) == SearchForm(gaps=True, cycle=True)
    if depth_given:
        found = solved(case, problem)
        problem = replace(problem, obstacle=case.punch - found.displacement.mean(), mean_pressure=None)
    assert check(case, problem) <= 24


def test_a_single_point_in_contact_takes_few_iterations():
    """It alone holds the mean, which has no stiffness of its own: the last grid of a cycle has to know it."""
    # With half of kappa_1 there, 50 times too much, it takes 173. No grid is coarser: from 8e3 to .8e-6 the
    # condition 4 of test_cycle takes 21, and points join in some of them.
    case, problem = problem_of(9)
    assert case.grid.points == (101, 101)
    found = solved(case, problem)
    assert found.contact_area * case.punch.size == pytest.approx(1.0)
    assert check(case, problem) <= 32


def test_directions_on_a_thin_incompressible_layer_are_conjugate():
    """Under a given load, where the answers of a cycle lose their mean by M 1: 22 iterations."""
    # Steepest descent, which is left where the products of centred answers are wrong, takes 44.
    grid, transforms = Grid((512, 512), (1.0, 1.0)), Transforms((512, 512))
    q = np.ravel(grid.wavenumbers)
    kappa, layer = np.zeros(q.size), gfmdlayer.bonded_layer(0.005, 1.0, poisson=0.5, halfspace=math.inf)
    kappa[q > 0] = layer.stiffness(q[q > 0], 0.0)
    assert form_of(grid, kappa) == SearchForm(gaps=False, cycle=True)
    punch = SelfAffine(hurst=0.8, rms_slope=0.1, short_cutoff=1 / 128, roll_off=1 / 8, seed=1)
    h = np.ravel(punch.heights(grid))
    full = -float(transforms.backward(kappa * transforms.forward(h)).min()) / h.size
    problem = Problem(kappa, 0j * kappa, h, 0.2 * full)
    found = NestedGradient(transforms, grid).solve(problem, np.zeros(grid.size), TOLERANCE)
    assert found.converged
    assert found.iterations <= 30


def test_the_form_follows_the_stiffness():
    """A halfspace and what is stiffer at short waves: gaps. A thin layer: pressures, by one stencil."""
    grid = Grid((128, 128), (1.0, 1.0))
    q = np.ravel(grid.wavenumbers)
    thin = np.where(q > 0, 1e6 / np.maximum(q, 1.0) ** 2 + q, 0.0)
    assert form_of(grid, q) == form_of(grid, q + 0.01 * q**3) == SearchForm(gaps=True, cycle=True)
    assert form_of(grid, np.where(q > 0, 100 + q, 0.0)) == SearchForm()
    assert form_of(grid, thin) == SearchForm(gaps=False, cycle=True)
    line = Grid((4096,), (1.0,))
    q = np.ravel(line.wavenumbers)
    for stiffness in (q, np.where(q > 0, 100 + q, 0.0)):
        assert form_of(line, stiffness) == SearchForm(gaps=True, cycle=True)
    thin = np.where(q > 0, 1e6 / np.maximum(q, 1.0) ** 2 + q, 0.0)
    assert form_of(line, thin) == SearchForm()


@pytest.mark.parametrize("contrast", [1.0, 0.2, 0.002])
def test_a_rough_line_takes_as_few_iterations_as_a_surface(contrast):
    """As conjugate gradients in the last contact: of condition 4 (`test_cycle`), a third a step."""
    # From the tolerance of coarser grids, 1e-2, to .8e-6 these are ln(1e-2/.8e-6)/ln 3 = 9; points that join
    # or leave restart them now and then.
    case, problem = film((4096,), contrast)
    assert check(case, problem) <= 12


def test_a_step_that_fails_leaves_the_state_as_it_was():
    case, problem = film()
    solver = NestedGradient(case.transforms, case.grid)
    before = solver.state()
    assert not solver.solve(problem, np.zeros(case.punch.size), TOLERANCE, 3).converged
    assert solver.state() == before


def test_the_given_pressure_of_a_solution_is_a_good_guess():
    case, problem = problem_of(1, sizes=(128,))
    first = solved(case, problem)
    again = solved(case, problem, first.pressure)
    assert again.iterations <= 1
    assert again.transforms <= 4


def test_without_contact_there_is_no_pressure():
    case, problem = problem_of(1, sizes=(64,))
    above = Problem(problem.stiffness, problem.intercept, case.punch + 1e-3)
    found = solved(case, above, np.ones(case.punch.size))
    assert found.converged
    assert found.pressure.max() == 0.0
    assert found.contact_area == 0.0


@pytest.mark.parametrize("method", ["nested_gradient", "active_set", "conjugate_gradient"])
def test_a_ridge_at_depth_zero_touches_nowhere(method):
    """Whichever solver the number of ranks chooses: a pressure of nothing but rounding is no contact."""
    config = Config(
        name="ridge",
        grid={"points": [32, 32]},
        punch={"shape": "wedge", "slope": 0.1},
        solver={"method": method},
    )
    recording = Kept()
    simulate(config.with_values({"time": {"end": 0.1, "step": 0.05}}), recording)
    assert recording.rows[0]["contact_area"] == 0.0
    assert recording.rows[0]["force"] == 0.0
    assert recording.rows[1]["contact_area"] > 0.0


def test_a_depth_may_follow_a_load():
    case, problem = problem_of(1, sizes=(64,))
    start = np.zeros(case.punch.size)
    pressed = Problem(problem.stiffness, problem.intercept, case.punch - 0.3 * case.punch.mean())
    loaded = Problem(problem.stiffness, problem.intercept, case.punch, solved(case, pressed).mean_pressure)
    solver = NestedGradient(case.transforms, case.grid)
    assert solver.solve(loaded, start, TOLERANCE).converged
    found = solver.solve(pressed, start, TOLERANCE)
    np.testing.assert_array_equal(found.pressure, solved(case, pressed).pressure)


# Under a coating only the long waves, which the first rank holds, feel that the base has become stiffer.
CHANGED = """
import numpy as np
from mpi4py import MPI
from gfmdlayer.contact.nested.solver import NestedGradient
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.ranks import MpiRanks
from gfmdlayer.grid.slabs import SlabTransforms
from gfmdlayer.grid.slabs import SlabGrid

ranks = MpiRanks(MPI.COMM_WORLD)
grid = SlabGrid((64, 64), (1.0, 1.0), members=ranks)
x, y = np.meshgrid(*grid.coordinates, indexing="ij")
h, q = np.ravel(2.0 - np.cos(6 * np.pi * x) - np.cos(4 * np.pi * y)), np.ravel(grid.wavenumbers)
solver, none = NestedGradient(SlabTransforms(grid), grid), np.zeros(q.size, complex)
for stiffness in (q, np.where(q < 50, 1.5 * q, q)):
    assert np.array_equal(stiffness, q) or ranks.first
    assert solver.solve(Problem(stiffness, none, h, 0.1, ranks=ranks), np.zeros(h.size), 1e-6, 100).converged
"""


def test_the_stiffness_may_change_on_one_rank_alone():
    command = [str(MPIRUN), "-n", "2", sys.executable, "-m", "mpi4py", "-c", CHANGED]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr


def test_more_threads_give_the_same_solution(monkeypatch):
    monkeypatch.setattr("gfmdlayer.contact.nested.iteration.WORTH_THREADS", 1)
    case, problem = problem_of(1, sizes=(90,))
    one = solved(case, problem)
    solver = NestedGradient(Transforms(case.grid.shape, threads=2), case.grid)
    two = solver.solve(problem, np.zeros(case.punch.size), TOLERANCE)
    assert two.converged
    np.testing.assert_allclose(two.pressure, one.pressure, atol=100 * TOLERANCE * one.pressure.max())


def test_the_preconditioner_depends_on_the_spacing_alone():
    """The stencil of a halfspace, scaled by the spacing, is the same on a long cell and on a square."""
    # Both are fitted to samples of 64 waves along an axis, whose errors are of the order of 1/64^2.
    found = []
    for points in ((128, 128), (4096, 128), (2000, 128)):
        grid = Grid(points, (points[0] / 128, 1.0))
        found.append(stencil(grid, grid.wavenumbers.ravel()) / 128)
    np.testing.assert_allclose(found[1:], [found[0]] * 2, atol=found[0].max() / 64**2)
