"""The solvers in pressures: against dense linear algebra, against each other, and where contact is hard.

What holds for the active set holds for constrained conjugate gradients, so most tests run both, and some
FIRE with either inertia.
"""

from dataclasses import replace
from functools import partial
from math import inf

import numpy as np
import pytest

from gfmdlayer import Exponential
from gfmdlayer.body.closed_form import LayeredHalfspace
from gfmdlayer.contact.active_set import solver as active_set
from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.contact.bounded import ConjugateGradient
from gfmdlayer.contact.fire import Fire
from gfmdlayer.contact.nested.solver import NestedGradient
from gfmdlayer.contact.newton.solver import Newton
from gfmdlayer.contact.prediction import PressurePrediction
from gfmdlayer.contact.pressure_form import in_pressures, satisfies_kkt
from gfmdlayer.contact.problem import Problem
from gfmdlayer.contact.residual import assess
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms

TOLERANCE = 1e-11
CONDITIONS = ["fixed mean", "free mean", "load"]
SHAPES = [(16,), (27,), (33,), (50,), (64,), (6, 8), (5, 7), (7, 4)]
each_method = pytest.mark.parametrize("method", [ActiveSet, ConjugateGradient])
each_solver = pytest.mark.parametrize(
    "method",
    [ActiveSet, ConjugateGradient, *(partial(Fire, mass_weighted=weighted) for weighted in (True, False))],
    ids=["active set", "conjugate gradients", "FIRE", "FIRE, uniform inertia"],
)
each_condition = pytest.mark.parametrize("condition", CONDITIONS)

PAPER = LayeredHalfspace(thickness=0.05, poisson=0.5, bulk_modulus=1.0)
THIN = LayeredHalfspace(thickness=0.001, poisson=0.5, bulk_modulus=inf)
YIELDING = LayeredHalfspace(thickness=0.05, poisson=0.4, bulk_modulus=inf)


def elastic(layer, h, modulus=1.0, load=None):
    """Return the contact problem of a layer without a history, on a line of period 1."""
    q = Grid((h.size,), (1.0,)).wavenumbers
    kappa = layer.stiffness(q, modulus)
    if load is not None:
        kappa[0] = 0.0
    return Problem(kappa, np.zeros(q.size, complex), h, load)


def parabola(n, depth):
    return np.asarray(2 * Grid((n,), (1.0,)).coordinates[0] ** 2 - depth)


def solve(method, problem, shape=None, tolerance=1e-6, limit=20_000, start=None):
    size = problem.obstacle.size
    solver = method(Transforms(shape or (size,)))
    return solver.solve(problem, np.zeros(size) if start is None else start, tolerance, limit)


def assert_consistent(found, problem, shape=None, within=0.0):
    """Everything in a solution, converged or not, follows from its displacement; pressures within a part."""
    u, h, size = found.displacement, problem.obstacle, problem.obstacle.size
    gap, shape, kappa, largest = h - u, shape or (size,), problem.stiffness, np.abs(found.pressure).max()
    spectrum = np.fft.rfftn(u.reshape(shape))
    # Solvers in pressures divide by kappa and this multiplies by it: rounding is that of the stiffest mode.
    rounding = 1e-12 * max(np.abs(kappa * spectrum.ravel()).max(), largest)
    rounding += 1e-15 * kappa.max() * np.abs(h).max()
    lowest = kappa[kappa > 0].min()
    assert (gap >= 0).all()
    scale = rounding / lowest + 1e-15 * size * max(np.abs(u).max(), np.abs(h).max())
    np.testing.assert_allclose(found.spectrum, spectrum.ravel(), atol=scale)
    stress = problem.intercept - kappa * spectrum.ravel()
    force = np.fft.irfftn(stress.reshape(spectrum.shape), s=shape, axes=tuple(range(spectrum.ndim))).ravel()
    multiplier = found.pressure - force
    assert np.ptp(multiplier) <= rounding * kappa.max() / lowest + 2.0 * within * largest
    if problem.mean_is_fixed:
        assert abs(u.mean()) <= 1e-14 * max(np.abs(u).max(), np.abs(h).max())
    elif problem.mean_pressure is None:
        np.testing.assert_allclose(multiplier, 0, atol=rounding + within * largest)
    else:
        np.testing.assert_allclose(found.pressure.mean(), problem.mean_pressure, rtol=1e-12)
    np.testing.assert_allclose(found.mean_pressure, found.pressure.mean(), atol=1e-15 * size * largest)
    depth = max(u.mean(), 0.0) - u.min()
    pressure_scale = max(found.pressure.max(), 1e-3 * problem.kappa_1 * depth)
    worst = np.abs(np.minimum(found.pressure / pressure_scale, gap / depth)).max()
    np.testing.assert_allclose(found.residual, worst, rtol=1e-6, atol=max(within, 1e-15))


def solved(method, problem, **given):
    """Solve; what is found has converged and is consistent."""
    found = solve(method, problem, **given)
    assert found.converged
    assert_consistent(found, problem)
    return found


def assert_solved(dense, method, condition, seed):
    """From a random start, to the dense solution."""
    # Stray gaps of TOLERANCE in the contact, times at most sqrt(n) for their sum and 64 x 1.6 for the
    # stiffest mode: under 1e3 TOLERANCE = 1e-8 for the worst, and 1e-9 for any that do not conspire.
    problem = dense.problem(seed, condition)
    u, pressure = dense.solution(problem)
    rng, largest = np.random.default_rng(seed), pressure.max()
    start = rng.choice([0.0, 0.1, 1.0, 100.0]) * largest * rng.uniform(-1, 1, u.size)
    found = solve(method, problem, dense.grid.shape, TOLERANCE, start=start)
    assert found.converged, seed
    assert found.residual <= TOLERANCE
    assert np.abs(found.displacement - u).max() <= 1e-9 * -u.min(), seed
    assert np.abs(found.pressure - pressure).max() <= 1e-9 * largest, seed
    assert found.contact_area == np.count_nonzero(pressure > 1e-8 * largest) / u.size
    assert abs(found.mean_pressure - pressure.mean()) <= 1e-9 * largest


@each_method
@each_condition
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_rough_contact_of_a_body_with_a_history(dense_contact, shape, condition, method):
    dense = dense_contact(shape)
    for seed in range(8):
        assert_solved(dense, method, condition, seed)


@each_condition
@pytest.mark.parametrize("size", [16, 17, 20, 27, 32, 33, 48, 50, 63, 64])
@pytest.mark.parametrize("number", [34, pytest.param(334, marks=pytest.mark.slow)])
def test_small_problems_need_no_safeguard(dense_contact, number, size, condition, monkeypatch):
    monkeypatch.setattr(active_set, "safeguard", None)
    dense = dense_contact((size,))
    for seed in range(1000, 1000 + number):
        assert_solved(dense, ActiveSet, condition, seed)


def assert_to_rounding(found, problem, dense):
    """FIRE divides by no stiffness: stress, mean and residual follow from the displacement to rounding."""
    u, gap = found.displacement, problem.obstacle - found.displacement
    rounding = 1e-14 * np.abs(problem.stiffness * dense.transform(u)).max()
    np.testing.assert_allclose(found.spectrum, dense.transform(u), atol=rounding)
    multiplier = found.pressure - dense.force(problem, u)
    assert np.ptp(multiplier) <= rounding
    np.testing.assert_allclose(found.mean_pressure, found.pressure.mean(), rtol=1e-13)
    if problem.mean_is_fixed:
        assert abs(u.mean()) <= 1e-15 * np.abs(u).max()
    else:
        np.testing.assert_allclose(multiplier, problem.mean_pressure or 0.0, atol=rounding)
    violations = np.minimum(found.pressure / found.pressure.max(), gap / -u.min())
    np.testing.assert_allclose(found.residual, np.abs(violations).max(), rtol=1e-9)


@each_solver
@each_condition
@pytest.mark.parametrize("shape", [(64,), (45,), (6, 7)], ids=str)
def test_what_is_returned_belongs_together_and_admits_too_few_iterations(
    dense_contact, shape, condition, method
):
    dense = dense_contact(shape)
    problem = dense.problem(1, condition)
    for limit in (1, 2, 7, 40, 20_000):
        found = solve(method, problem, shape, TOLERANCE, limit)
        assert_consistent(found, problem, shape)
        assert found.iterations <= min(limit, found.transforms)
        assert found.converged == (found.residual <= TOLERANCE)
        assert not (found.converged and limit == 1)
        if isinstance(method, partial):
            assert_to_rounding(found, problem, dense)
    assert found.converged


@pytest.mark.parametrize("mass_weighted", [True, False])
@each_condition
@pytest.mark.parametrize("shape", [(16,), (33,), (64,), (6, 8)], ids=str)
@pytest.mark.parametrize("seed", range(6))
def test_fire_on_rough_contact(dense_contact, seed, shape, condition, mass_weighted):
    problem = dense_contact(shape).problem(seed, condition)
    u, pressure = dense_contact(shape).solution(problem)
    # Strict complementarity: the reference is far from another contact set.
    assert np.maximum((problem.obstacle - u) / -u.min(), pressure / pressure.max()).min() > 1e-5
    found = solve(partial(Fire, mass_weighted=mass_weighted), problem, shape, TOLERANCE)
    assert found.converged
    assert found.residual <= TOLERANCE
    # With the contact set right, a stray pressure of TOLERANCE p_max at the free points or a stray gap of
    # TOLERANCE depth at the others is all that is wrong: the lowest mode turns the one into a displacement,
    # the stiffest the other into a pressure.
    lowest, stiffest = problem.kappa_1, problem.stiffness.max()
    scale = max(pressure.max(), lowest * -u.min())
    off = 2 * np.sqrt(u.size) * TOLERANCE * scale / lowest * (stiffest / lowest)
    assert np.abs(found.displacement - u).max() <= off
    assert np.abs(found.pressure - pressure).max() <= off * stiffest
    np.testing.assert_allclose(found.mean_pressure, pressure.mean(), rtol=1e-7)
    assert found.contact_area == np.count_nonzero(pressure > 1e-9 * pressure.max()) / u.size


@pytest.mark.parametrize("mass_weighted", [True, False])
def test_fire_leaves_the_surface_flat_under_a_punch_out_of_reach(mass_weighted):
    grid = Grid((128,), (1.0,))
    problem = Problem(2 * grid.wavenumbers, np.zeros(65, complex), 0.1 + grid.coordinates[0] ** 2)
    found = solve(partial(Fire, mass_weighted=mass_weighted), problem)
    assert found.converged
    assert found.contact_area == 0
    np.testing.assert_allclose(found.displacement, 0, atol=1e-15)
    np.testing.assert_allclose(found.pressure, 0, atol=1e-12)


@each_condition
def test_the_safeguard_alone_ends_at_the_solution(dense_contact, condition):
    dense = dense_contact((24,))
    for seed in range(5):
        problem = dense.problem(seed, condition)
        u, pressure = dense.solution(problem)
        solver = ActiveSet(Transforms((24,)), rounds=0)
        found = solver.solve(problem, np.zeros(24), TOLERANCE)
        assert found.converged
        assert_consistent(found, problem)
        np.testing.assert_allclose(found.displacement, u, atol=1e-9 * -u.min())
        np.testing.assert_allclose(found.pressure, pressure, atol=1e-9 * pressure.max())


@pytest.mark.parametrize("method", [*each_solver.args[1], NestedGradient, Newton, "Newton, attracted"])
@pytest.mark.parametrize("load", [None, 1.0])
@pytest.mark.parametrize("where", ["stiffness", "intercept", "obstacle", "start"])
def test_what_is_not_a_number_is_never_an_answer(where, load, method):
    problem, start = elastic(PAPER, parabola(32, 0.01), load=load), np.ones(32)
    if isinstance(method, str):
        method, law = Newton, Exponential(work=1e-4, range=0.01)
        problem = replace(problem, interface=law.interaction())
    spoilt = {name: getattr(problem, name).copy() for name in ("stiffness", "intercept", "obstacle")}
    spoilt["start"] = start
    spoilt[where][3] = np.nan
    start, is_fire = spoilt.pop("start"), isinstance(method, partial)
    try:
        found = solve(method, replace(problem, **spoilt), limit=50, start=start)
    except ValueError:
        assert method not in {ActiveSet, ConjugateGradient}
        return
    if where == "start" and not is_fire:  # a guess of pressures or gaps decides nothing
        assert found.converged
        if not problem.interface.attracts:
            assert_consistent(found, problem, within=1e-6 if method is NestedGradient else 0.0)
    else:
        assert not found.converged
        assert not found.residual <= 1e-6


@each_solver
@pytest.mark.parametrize("depth", [0.0, -0.1])
@pytest.mark.parametrize("layer", [PAPER, YIELDING])
def test_a_punch_at_depth_zero_or_above_presses_on_nothing(layer, depth, method):
    problem = elastic(layer, parabola(128, depth))
    starts = (np.zeros(128), np.ones(128))
    for start in starts[:1] if isinstance(method, partial) else starts:  # FIRE's is a displacement
        found = solve(method, problem, start=start)
        assert found.converged
        np.testing.assert_allclose(found.displacement, 0, atol=1e-14)
        np.testing.assert_allclose(found.pressure, 0, atol=1e-12)
        assert found.contact_area == 0 or depth == 0


@each_method
def test_no_load_makes_no_contact(method):
    found = solve(method, elastic(PAPER, parabola(128, 0.0), load=0.0))
    assert found.converged
    assert found.mean_pressure == 0.0
    np.testing.assert_allclose(found.displacement - found.displacement[0], 0, atol=1e-15)


@each_method
@pytest.mark.parametrize("load", [None, 1e-9])
def test_the_first_touch_is_one_point(load, method):
    # The neighbours are 2/n^2 = 1.2e-4 higher, a hundred times what is asked for.
    problem = elastic(PAPER, parabola(128, 1e-6), load=load)
    found = solved(method, problem)
    assert np.count_nonzero(found.pressure) == 1


@each_solver
def test_a_large_load_makes_contact_full(method):
    x = Grid((64,), (1.0,)).coordinates[0]
    problem = elastic(PAPER, 0.01 * (1 - np.cos(2 * np.pi * x)))
    stress = float(problem.stiffness[1]) * 0.01
    problem = replace(problem, mean_pressure=1.5 * stress)
    found = solved(method, problem, tolerance=TOLERANCE)
    assert found.contact_area == 1
    # Stray gaps of TOLERANCE depth, through the stiffest mode.
    off = 64 * TOLERANCE * problem.stiffness.max() * 0.02
    np.testing.assert_allclose(found.pressure, stress * (1.5 + np.cos(2 * np.pi * x)), atol=off)


@pytest.mark.parametrize("load", [None, 1e-3])
def test_portions_after_which_signals_are_noticed_lead_to_the_same(load, monkeypatch):
    """Where a solve is cut into portions of few iterations it takes more of them, and ends where it would."""
    n = 1 << 12
    waves = 2e-4 * np.cos(80 * np.pi * Grid((n,), (1.0,)).coordinates[0])
    problem = elastic(PAPER, parabola(n, 0.01 if load is None else 0.0) + waves, load=load)
    whole = ActiveSet(Transforms((n,)), windows=False).solve(problem, np.zeros(n), TOLERANCE)
    monkeypatch.setattr(active_set, "WORK", 0)
    monkeypatch.setattr(active_set, "FEWEST", 5)
    monkeypatch.setattr(active_set, "safeguard", None)  # which would help out
    calls, solver = [], ActiveSet(Transforms((n,)), windows=False)
    iterate = active_set.iterate
    monkeypatch.setattr(active_set, "iterate", lambda *given: calls.append(given[-2]) or iterate(*given))
    parts = solver.solve(problem, np.zeros(n), TOLERANCE)
    assert len(calls) > 2
    assert max(calls) == 5
    assert parts.converged
    assert whole.iterations > 5
    # Gaps in the contact, of either, are within the tolerance of the depth, 0.01 and a little more.
    gaps = 2 * TOLERANCE * 0.02
    np.testing.assert_allclose(parts.pressure, whole.pressure, rtol=0, atol=gaps * problem.stiffness.max())
    assert parts.mean_pressure == pytest.approx(whole.mean_pressure, rel=20 * TOLERANCE)


@each_solver
def test_a_cell_that_the_punch_fills_is_in_full_contact(method):
    h = -0.01 * np.cos(2 * np.pi * Grid((64,), (1.0,)).coordinates[0])
    h += abs(h.mean())
    problem = elastic(PAPER, h)
    found = solved(method, problem)
    np.testing.assert_array_equal(found.displacement, h)
    assert (found.pressure >= 0).all()


@each_method
def test_a_punch_below_the_mean_height_of_a_body_of_fixed_mean_is_refused(method):
    with pytest.raises(ValueError, match="the punch is too deep"):
        solve(method, elastic(PAPER, parabola(64, 1.0)))


@each_method
@pytest.mark.parametrize(
    ("layer", "modulus", "depth"),
    [(THIN, 1.0, 1e-3), (PAPER, 1e5, 0.01), (PAPER, 1e-5, 0.01), (YIELDING, 1.0, 0.01)],
)
@pytest.mark.parametrize("n", [1000, 1024, 777])
def test_layers_of_extreme_stiffness(n, layer, modulus, depth, method):
    problem = elastic(layer, parabola(n, depth), modulus)
    found = solved(method, problem)
    assert found.residual <= 1e-6
    if n % 2 == 0:  # the parabola is symmetric about x = 0, and so is its contact
        p, largest = found.pressure[1:], found.pressure.max()
        off = n * 1e-6 * problem.stiffness.max() / problem.stiffness[1] * largest
        np.testing.assert_allclose(p, p[::-1], atol=min(off, 0.1 * largest))


SOFT = [  # thickness, shear modulus of the base, load or depth, points, end
    (0.01, 0.0, {"control": "load", "load": 0.00035}, 256, 1.0),
    (0.01, 0.001, {"control": "load", "load": 0.0012}, 1024, 1.7),
    (0.001, 0.01, {"control": "load", "load": 0.0084}, 1024, 1.0),
    (0.001, 0.001, {"control": "depth", "depth": 0.03}, 512, 1.0),
]


@pytest.mark.parametrize(("thickness", "base", "trajectory", "n", "end"), SOFT)
def test_a_film_on_a_soft_base_is_solved_at_every_step(run, thickness, base, trajectory, n, end):
    body = {"layer.thickness": thickness, "halfspace.shear_modulus": base, "trajectory": trajectory}
    found = run({"grid.points": n, "time.step": 0.1, "time.end": end, **body})
    assert (found["residual"] <= 1e-6).all()
    assert found["contact_area"][-1] > 0


@pytest.mark.parametrize("n", [81, 128, 256])
def test_a_hard_film_on_a_soft_base_is_solved(n):
    # It bends, so that contact points far apart push each other out; descent would take 1e5 iterations, which
    # is the range of the stiffness.
    film = LayeredHalfspace(thickness=0.01, poisson=0.5, bulk_modulus=1.0)
    problem = elastic(film, parabola(n, 0.1), modulus=1e5)
    found = solved(ActiveSet, problem)
    # Without the safeguard on the coarser grids; at 256 points the set cycles, and the safeguard ends it.
    assert found.iterations < (1000 if n < 256 else 10_000)
    other = solve(ConjugateGradient, problem, tolerance=1e-9)
    # Gaps of TOLERANCE in the contact bend the film as much: the pressure works on them, and nowhere else.
    np.testing.assert_allclose(found.displacement, other.displacement, atol=1e-4 * -other.displacement.min())


def test_a_film_that_bends_back_is_solved_by_any_solver(run, tmp_path):
    (tmp_path / "back.txt").write_text("time depth\n0 0.0297\n1 0.0099\n")
    branch = {"model": "prony", "G0": 1.0, "branches": [{"G": 1e4, "tau": 1.0}]}
    values = {"grid.points": 76, "layer": {"thickness": 0.01, "poisson": 0.5}, "layer.material": branch}
    values |= {"halfspace.shear_modulus": 0.1, "punch.radius": 1.0, "time.end": 1.0, "time.step": 0.5}
    values |= {"trajectory": {"kind": "table", "file": str(tmp_path / "back.txt")}}
    methods = ("active_set", "conjugate_gradient")
    found = [run(values | {"solver": {"method": method, "tolerance": 1e-7}}) for method in methods]
    # A gap of 1e-7 of the depth changes the mean pressure by up to 5.2e-6 of it: 52 is the sum of |p| that a
    # unit of depth makes, times depth over mean pressure. So it does in either run, and in the step before.
    np.testing.assert_allclose(*(each["mean_pressure"] for each in found), rtol=4 * 5.2e-6)


@each_method
@pytest.mark.parametrize("load", [None, 0.5])
def test_a_flat_punch_touches_with_all_of_its_face(load, method):
    x = Grid((256,), (1.0,)).coordinates[0]
    face = np.abs(x) <= 0.1
    problem = elastic(PAPER, np.where(face, 0.0, 1.0) - 0.01, load=load)
    found = solved(method, problem)
    np.testing.assert_array_equal(found.pressure > 0, face)


@pytest.mark.parametrize("method", [ActiveSet, ConjugateGradient, Fire])
@pytest.mark.parametrize("shape", [(8, 8), (256,)])
@pytest.mark.parametrize("size", 10.0 ** -np.arange(3, 25, 3))
def test_what_rounding_leaves_under_a_flat_punch_is_rest(size, shape, method):
    # A dent that heals under a punch at depth zero becomes smaller than what heights can tell.
    grid = Grid(shape, (1.0,) * len(shape))
    radius = np.sqrt(sum(x**2 for x in np.meshgrid(*grid.coordinates, indexing="ij"))).ravel()
    h = np.maximum(radius - 0.15, 0.0) ** 2
    kappa = PAPER.stiffness(grid.wavenumbers.ravel(), 1.0)
    transforms = Transforms(shape)
    left = np.random.default_rng(7).normal(0, size, grid.size)
    problem = Problem(kappa, kappa * transforms.forward(left), h, height=float(np.ptp(h)))
    found = method(transforms).solve(problem, np.zeros(grid.size), 1e-6)
    assert found.converged
    # Of a contact the pressure is known to a part of 1e-6 of the largest; of less than one, to that part of
    # what the least depth leaves.
    largest = max(found.pressure.max(), problem.residual_floor.stiffness * problem.least_depth)
    assert found.pressure.min() >= -1e-6 * largest
    assert found.pressure.max() <= 10 * kappa.max() * max(size, 1e-6 * problem.least_depth)


@pytest.mark.parametrize("method", ["active_set", "conjugate_gradient"])
def test_a_dent_heals_to_nothing_under_a_flat_punch(method, run, tmp_path):
    # By t = 400 what is left of it is 1e-20 of the heights.
    (tmp_path / "back.txt").write_text("time depth\n0 0\n1 0.01\n2 0\n")
    values = {"trajectory": {"kind": "table", "file": str(tmp_path / "back.txt")}, "grid.points": 128}
    values |= {"punch": {"shape": "flat", "width": 0.3, "edge_radius": 0.2}, "time.end": 1000.0}
    found = run(values | {"time.step": 5.0, "solver": {"method": method, "tolerance": 1e-7}})
    assert abs(found["mean_pressure"][-1]) < 1e-20


@each_method
def test_a_solver_counts_depths_by_the_punch_that_it_is_given(method):
    # Beside a high punch this depth is nothing, and what was found there is no solution under the other.
    problem = elastic(PAPER, 1e-20 * parabola(64, 0.01))
    solver, start = method(Transforms((64,))), np.zeros(64)
    for height in (1.0, 0.0, 1.0):
        now = replace(problem, height=height)
        found = solver.solve(now, start, 1e-6)
        residual, *_ = assess(found.pressure, found.displacement, now.obstacle, now.residual_floor)
        assert residual <= 1e-6
        start = 1.1 * found.pressure


def test_a_pressure_that_is_not_a_number_is_no_solution():
    problem = elastic(PAPER, parabola(64, 0.01))
    system, _ = in_pressures(problem, Transforms((64,)))
    gap, p = np.ones(64), np.zeros(64)
    assert satisfies_kkt(system, p, gap, 0.0, 1e-6)
    gap[3] = 0.0
    assert satisfies_kkt(system, p, gap, 0.0, 1e-6)
    p[3] = np.nan
    assert not satisfies_kkt(system, p, gap, 0.0, 1e-6)


@each_method
@pytest.mark.parametrize("load", [None, 0.2])
def test_hundreds_of_asperities(load, method):
    n = 4096
    rng = np.random.default_rng(5)
    q = np.arange(n // 2 + 1)
    rough = np.fft.irfft(np.where((q > 3) & (q < 800), np.exp(2j * np.pi * rng.random(q.size)), 0)) * 0.2
    h = rough - rough.min()  # its standard deviation is 0.002
    problem = elastic(PAPER, h - (0.006 if load is None else 0.0), load=load)
    found = solved(method, problem, start=rng.uniform(-1, 1, n))
    patches = np.count_nonzero(np.diff((found.pressure > 0).astype(int)) == 1)
    assert patches >= 100


@each_method
@pytest.mark.parametrize("loads", [False, True])
def test_an_elastic_contact_shrinks_as_it_grew(loads, method):
    n, steps = 512, 12
    solver, prediction = method(Transforms((n,))), PressurePrediction(n)
    course = np.concatenate([np.arange(1, steps + 1), np.arange(steps - 1, 0, -1)])
    areas = {}
    means = {}
    for time, step in enumerate(course):
        depth = 0.0 if loads else 0.01 * step / steps
        load = 0.1 * step / steps if loads else None
        problem = elastic(PAPER, parabola(n, depth), load=load)
        found = solver.solve(problem, prediction.at(time), 1e-9)
        assert found.converged
        assert_consistent(found, problem)
        prediction.remember(
            time, found.pressure, problem.obstacle - found.displacement, at_breakpoint=time == steps - 1
        )
        # No history: the way back is the way there, to the tolerance through the stiffest mode.
        assert areas.setdefault(step, found.contact_area) == found.contact_area
        assert abs(means.setdefault(step, found.mean_pressure) - found.mean_pressure) <= n * 1e-9
    assert areas[1] < areas[steps]


@pytest.mark.parametrize(("method", "most"), [(ActiveSet, 10), (ConjugateGradient, 40)])
def test_a_step_of_a_ramp_takes_few_transforms(method, most):
    n, steps = 4096, 100
    solver, prediction = method(Transforms((n,))), PressurePrediction(n)
    taken = []
    for step in range(1, steps + 1):
        problem = elastic(PAPER, parabola(n, 0.01 * step / steps))
        found = solver.solve(problem, prediction.at(step))
        assert found.converged
        prediction.remember(step, found.pressure, problem.obstacle - found.displacement)
        taken.append(found.transforms)
    assert np.mean(taken[10:]) < most


@each_solver
def test_one_solver_serves_step_after_step(dense_contact, method):
    dense = dense_contact((64,))
    first, second = (dense.problem(seed, "fixed mean") for seed in (4, 5))
    solver = method(Transforms((64,)))
    alone = solver.solve(first, np.zeros(64), TOLERANCE)
    kept = alone.displacement.copy(), alone.pressure.copy(), alone.spectrum.copy()
    solver.solve(second, np.zeros(64), TOLERANCE)
    for before, after in zip(kept, (alone.displacement, alone.pressure, alone.spectrum), strict=True):
        np.testing.assert_array_equal(after, before)
    again = solver.solve(first, np.zeros(64), TOLERANCE)
    # Nothing is left of other steps.
    np.testing.assert_array_equal(again.displacement, alone.displacement)


@each_method
@pytest.mark.parametrize("start", [np.inf, -np.inf, np.nan, 1e-320, 1e300, -1.0], ids=str)
def test_a_guess_of_any_size_carries_the_load(start, method):
    problem = elastic(PAPER, parabola(64, 0.0), load=0.1)
    guess = np.zeros(64)
    guess[[0, 9]] = start, 1e-3 * start
    found = solved(method, problem, start=guess)
    assert found.contact_area == solve(method, problem).contact_area


@pytest.mark.parametrize("load", [None, 1e-3])
def test_a_known_start_is_judged_by_the_depth_of_the_surface_as_it_is_now(load):
    # A flat face under a history that changes a little: the contact stays and the solve goes on from the last
    # pressure. Under a load the punch lies high above the surface; else the history lets the body sink.
    x = Grid((64,), (1.0,)).coordinates[0]
    problem = elastic(YIELDING, np.where(np.abs(x) <= 0.1, 0.0, 1.0) + (1.0 if load else -0.01), load=load)
    rng = np.random.default_rng(3)
    solver, start = ActiveSet(Transforms((64,))), np.zeros(64)
    for raised in (0.5, 0.4, 0.3, 0.1, 0.0):
        history = problem.stiffness * np.fft.rfft(1e-5 * rng.normal(size=64)) / (1 + np.arange(33.0)) ** 2
        history[0] = 0.0 if load else 64 * problem.stiffness[0] * raised
        problem = replace(problem, intercept=history)
        found = solver.solve(problem, start, 1e-10)
        assert found.converged
        assert_consistent(found, problem)
        start = found.pressure


def test_load_and_depth_may_take_turns():
    deep = elastic(PAPER, parabola(64, 0.01), load=None)
    solver, start = ActiveSet(Transforms((64,))), np.zeros(64)
    for load in (None, 0.05, None, None, 0.05, 0.05, None):
        problem = replace(deep, mean_pressure=load)
        found = solver.solve(problem, start, 1e-9)
        assert found.converged
        assert_consistent(found, problem)
        assert found.contact_area == solve(ActiveSet, problem, tolerance=1e-9).contact_area
        start = found.pressure


@each_method
def test_a_load_is_carried_to_rounding_however_fast_it_falls(method):
    problem = elastic(PAPER, np.abs(parabola(64, 0.0)) ** 0.5, load=1.0)
    solver, start = method(Transforms((64,))), np.zeros(64)
    for load in (1.0, 0.9, 0.8, 1e-6, 1.0, 1e-9):
        found = solver.solve(replace(problem, mean_pressure=load), start, 1e-6)
        assert found.converged
        assert found.pressure.mean() == pytest.approx(load, rel=1e-13)
        start = found.pressure


@each_method
def test_a_punch_that_is_lifted_off_leaves_nothing_behind(method):
    solver, start = method(Transforms((64,))), np.zeros(64)
    for depth in (0.01, 0.005, 0.0, -0.01):
        found = solver.solve(elastic(PAPER, parabola(64, depth)), start, 1e-9)
        assert found.converged
        start = found.pressure
        assert start.any() == (depth > 0)


def test_small_steps_at_a_tight_tolerance_need_no_safeguard(run, monkeypatch):
    """Directions of many small steps are nearly dependent; their rounding must not stop the solve."""

    def give_up(*_):
        raise AssertionError("the safeguard was called")

    monkeypatch.setattr(active_set, "safeguard", give_up)
    settings = {"grid.points": 4096, "time.end": 0.1, "time.step": 0.1 / 32, "solver.tolerance": 1e-9}
    found = run(settings)
    assert found["residual"].max() <= 1e-9


def test_cut_off_asperities_take_few_iterations():
    # Up to four asperities, cut off by a plateau, from any start.
    transforms = {n: Transforms((n,)) for n in (64, 128, 256, 512)}
    for seed in range(400):
        rng = np.random.default_rng(seed)
        n = int(rng.choice(list(transforms)))
        grid = Grid((n,), (1.0,))
        x, count = grid.coordinates[0], rng.integers(1, 5)
        centre, height = rng.uniform(-0.4, 0.4, count), rng.uniform(0, 0.01, count)
        bends = 10 ** rng.uniform(0, 4, count)
        h = np.min(bends[:, None] * (x - centre[:, None]) ** 2 + height[:, None], axis=0)
        h = np.minimum(h, h.min() + 10 ** rng.uniform(-2, 0)) - h.min()
        loads = rng.random() < 0.5
        h -= 0.0 if loads else 10 ** rng.uniform(-4, -1)
        start = (np.abs(x - rng.uniform(-0.2, 0.2)) < rng.uniform(0.05, 0.5)).astype(float)
        load = 10 ** rng.uniform(-4, -1) if loads else None
        if load is None and h.mean() <= 0:
            continue  # more than the cell holds
        problem = Problem(grid.wavenumbers.copy(), np.zeros(n // 2 + 1, complex), h, load)
        found = ActiveSet(transforms[n]).solve(problem, start, 1e-8)
        assert found.converged, seed
        assert found.iterations < 200, seed


# --- what is particular to the method of Polonsky and Keer ---


def hertz(n, *, load=None, mean_stiffness=0.0):
    """Return a parabola on a halfspace."""
    kappa = 2 * Grid((n,), (1.0,)).wavenumbers
    kappa[0] = mean_stiffness
    return Problem(kappa, np.zeros(kappa.size, complex), parabola(n, 0.01), load)


def energy(problem, pressure):
    """p.A p/2 + h.p a point."""
    compliance = np.divide(
        1, problem.stiffness, out=np.zeros_like(problem.stiffness), where=problem.stiffness > 0
    )
    effect = np.fft.irfft(compliance * np.fft.rfft(pressure), n=pressure.size)
    return float((pressure * (0.5 * effect + problem.obstacle)).mean())


@pytest.mark.parametrize("case", [{}, {"load": 0.05}, {"mean_stiffness": 3.0}], ids=str)
@pytest.mark.parametrize("n", [500, 1024, 4096])
def test_an_iteration_takes_one_pair_of_transforms(n, case):
    problem = hertz(n, **case)
    found = solve(ConjugateGradient, problem)
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
    taken = [solve(ConjugateGradient, hertz(n)).iterations for n in (512, 8192)]
    assert taken[1] <= 1.5 * 4 * taken[0]


def test_it_stops_where_only_rounding_is_left():
    found = solve(ConjugateGradient, hertz(128), tolerance=1e-18)
    assert found.residual < 1e-12
    assert (found.displacement <= hertz(128).obstacle).all()


@pytest.mark.parametrize("modulus", [1e3, 1e4])
def test_steps_carry_the_load_of_the_last_one_however_long_they_become(modulus):
    # A stiff film on a soft base in full contact: some steps are a hundred times as long as tried, which made
    # of rounding in the load a hundredth of it, and 6 of these 200 solves ended short of the tolerance.
    grid = Grid((128,), (1.0,))
    kappa = PAPER.stiffness(grid.wavenumbers, modulus)
    kappa[0] = 0.0
    h, solver = 1 - np.cos(4 * np.pi * grid.coordinates[0]), ConjugateGradient(Transforms((128,)))
    problem = Problem(kappa, np.zeros(kappa.size, complex), h, 1.5 * kappa[2])
    for seed in range(100):
        found = solver.solve(problem, kappa[2] * np.random.default_rng(seed).uniform(0, 3, 128), 1e-3)
        assert found.converged
        np.testing.assert_allclose(found.mean_pressure, 1.5 * kappa[2], rtol=1e-12)
