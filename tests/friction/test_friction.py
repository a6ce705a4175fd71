"""Frictional contact of one step: closed forms, symmetries, limits, Coulomb's conditions at each point."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gfmdlayer import Case, Config, Dugdale, Electrostatic, Exponential, LennardJones
from gfmdlayer.friction.newton import INNER, LinearSystem, gmres
from gfmdlayer.friction.problem import FrictionProblem, in_disks, norms, path_in_plane
from gfmdlayer.friction.response import Operator, Response, SharedTransforms, Spent
from gfmdlayer.friction.solver import FrictionSolver
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.interface.friction import ShearBound
from gfmdlayer.interface.law import HARD_WALL
from tests.friction.cases import halfspace, random_problem, rough
from tests.friction.reference import solve_densely


def setting(points, period=1.0, poisson=0.5):
    grid = Grid(points, (period,) * len(points))
    return grid, halfspace(grid, 1.0, poisson), FrictionSolver(grid, Transforms(points))


def parabola(grid, radius):
    return np.asarray(sum(x**2 for x in np.meshgrid(*grid.coordinates, indexing="ij")) / (2 * radius)).ravel()


def obeys_coulomb(problem, found, tolerance):
    """Whether each point separates, sticks, or slips against its traction, to the residual's meaning."""
    # Inequalities of the tractions hold to rounding. Gaps and slips hold to the tolerance in the largest
    # displacement, or where the traction can make up for it: |slip| <= 2 tolerance on a point that sticks.
    p, t, bound = found.pressure, found.traction, problem.law.bound(found.pressure)
    softest = float(problem.response.normal.max())
    Cx = found.displacement - (0 if problem.offset is None else problem.offset)
    length = max(float(Cx[0].max()), 1e-3 * float(p.max()) * softest)
    touching, size = p > 0, norms(t)
    sure = touching & (p > 2 * tolerance * p.max())
    sticks = sure & (size < bound - 2 * tolerance * bound.max())
    slipping = found.slip * (norms(found.slip) > 2 * tolerance * length * max(bound.max() / p.max(), 1))
    return bool(
        (p >= 0).all()
        and (size <= bound * (1 + 1e-12)).all()
        and (found.gap >= -2 * tolerance * length).all()
        and (np.abs(found.gap[sure]) <= 2 * tolerance * length).all()
        and not slipping[:, sticks].any()
        and ((t * slipping).sum(axis=0)[sure] <= 0).all()
    )


@pytest.mark.parametrize("shape", ["parabola", "rough"])
def test_shear_of_a_line_is_the_difference_of_two_pressures(shape):
    """Cattaneo, Mindlin, Jaeger, Ciavarella: t = mu (p(P) - p(P - Q/mu)), where both responses are equal."""
    # Each solution has the residual 1e-9. The pressure between the points of a rough contact amplifies it by
    # some 100, since a displacement of the longest wave is n/2 times softer than one of the shortest.
    grid, response, solver = setting((1024,))
    h = parabola(grid, 0.25) if shape == "parabola" else rough(grid, np.random.default_rng(5), 0.8) * 0.003
    mu, load = 0.4, 0.002 if shape == "parabola" else 0.02
    whole = FrictionProblem(
        response, h - h.min(), ShearBound(mu), load=load, force=np.array([0.5 * mu * load])
    )
    found = solver.solve(whole, tolerance=1e-9)
    pressed = [
        solver.solve(
            replace(whole, law=ShearBound(0.0), load=part * load, force=None), tolerance=1e-9
        ).pressure
        for part in (1.0, 0.5)
    ]
    np.testing.assert_allclose(
        found.traction[0], mu * (pressed[0] - pressed[1]), rtol=0, atol=1e-6 * mu * pressed[0].max()
    )
    if shape == "parabola":  # c/a = (1 - Q/(mu P))^(1/2), but for a spacing at each edge, of 103
        assert found.stick.sum() / found.contact.sum() == pytest.approx(0.5**0.5, abs=2 / 103)


@pytest.mark.parametrize("points", [(512,), (256, 128)])
def test_a_window_responds_as_the_whole_surface(points):
    """Differences of a few points need no more transforms than twice their range; single precision."""
    grid = Grid(points, (1.0,) * len(points))
    r = np.random.default_rng(1)
    held = np.zeros(points)
    held[(slice(-20, None),) * len(points)] = held[(slice(0, 9),) * len(points)] = 1.0  # across the boundary
    near = np.flatnonzero(held.ravel() * (r.random(grid.size) < 0.7))
    spent = Spent()
    response = Operator(grid, halfspace(grid, 1.0, 0.1), SharedTransforms(Transforms(points), spent, 1.0))
    x = np.zeros((1 + len(points), grid.size))
    x[:, near] = r.standard_normal((1 + len(points), near.size))
    whole = response(x)[:, near]
    among = response.among(near)
    before = spent.pairs
    np.testing.assert_allclose(among(x[:, near]), whole, rtol=0, atol=2e-6 * np.abs(whole).max())
    part = 8 if len(points) == 1 else 2
    assert spent.pairs - before == pytest.approx(0.5 * (1 + len(points)) / part ** len(points))


@pytest.mark.parametrize("n", [512, 4096])
def test_the_work_of_a_step_does_not_grow_with_the_points(n):
    """A cylinder: 40 pairs a twentieth of the tangential course, 80 from nothing."""
    grid, response, solver = setting((n,), poisson=0.3)
    mu, load, state, pairs = 0.4, 0.02, None, []
    problem = FrictionProblem(response, parabola(grid, 0.25), ShearBound(mu), load=load, force=np.zeros(1))
    for part in (0.0, 0.25, 0.3, 0.35):
        before = None if state is None else state.displacement[1:]
        start = None if state is None else state.tractions
        step = replace(problem, force=np.array([part * mu * load]), before=before)
        state = solver.solve(step, start)
        pairs.append(state.pairs)
    assert pairs[0] < 80
    assert np.mean(pairs[2:]) < 40


def test_many_small_contacts_take_no_more_pairs_than_one():
    """A rough line with some 60 intervals of contact: as a cylinder, 80 pairs from nothing and 40 a step."""
    grid, response, solver = setting((4096,), poisson=0.3)
    h = rough(grid, np.random.default_rng(5), 0.8) * 0.003
    problem = FrictionProblem(
        response, h - h.min(), ShearBound(0.4), load=0.01, force=np.array([0.5 * 0.4 * 0.01])
    )
    found = solver.solve(problem)
    touching = found.contact
    assert found.converged
    assert np.count_nonzero(touching[1:] & ~touching[:-1]) > 30
    assert found.pairs < 80
    assert obeys_coulomb(problem, found, 1e-7)
    step = replace(problem, force=1.1 * problem.force, before=found.displacement[1:])
    assert solver.solve(step, found.tractions).pairs < 40


def test_a_sphere_has_the_numbers_of_contact():
    """Vollebregt's CONTACT: contact radius 1, stick radius 0.5, p_max 4.390, shift 8.172e-3."""
    # The two bodies are equal: their coupling cancels. The cell of 12 radii adds a uniform displacement,
    # 3.9003/(2 pi L) times the force and the mean of C_UU q and C_VV q; it is taken off. Its next term is
    # (a/L)^3, 0.06 %. Radii have half a spacing, 0.05.
    period, mu, radius, load = 12.0, 0.4, 50.0, 9.1954
    force = 7 / 8 * mu * load
    grid = Grid((128, 128), (period, period))
    one = halfspace(grid, 200.0, 0.42)
    both = Response(2 * one.normal, 0 * one.coupling, 2 * one.along, 2 * one.across)
    given = {"load": load / period**2, "force": np.array([force, 0.0]) / period**2}
    solver = FrictionSolver(grid, Transforms(grid.points))
    found = solver.solve(FrictionProblem(both, parabola(grid, radius), ShearBound(mu), **given))
    spacing = period / 128
    radii = [np.sqrt(points.sum() / np.pi) * spacing for points in (found.contact, found.stick)]
    assert radii == pytest.approx([1.0, 0.5], abs=spacing / 2)
    assert found.pressure.max() == pytest.approx(4.390, rel=0.002)
    images = 3.900265 / (2 * np.pi * period) * force * (2 - 0.42) / 200.0
    assert found.path[0] + images == pytest.approx(8.172e-3, rel=0.002)


def test_a_sliding_cylinder_moves_its_contact_back():
    """The edges are -a - x0 and a - x0, x0 = 2 gamma a, tan(pi gamma) = mu (1 - 2 nu)/(2 (1 - nu)); Johnson.

    The cell is 55 half-widths wide; a spacing is 0.12 x0.
    """
    nu, mu, period, n = 0.2, 0.5, 2.0, 4096
    grid, response, solver = setting((n,), period, nu)
    problem = FrictionProblem(
        response, parabola(grid, 0.25), ShearBound(mu), load=0.01 / period, path=np.array([0.5])
    )
    found = solver.solve(problem)
    np.testing.assert_allclose(found.traction[0], mu * found.pressure, rtol=0, atol=1e-9)
    x, spacing = grid.coordinates[0][found.contact], period / n
    a = 0.5 * (x[-1] - x[0] + spacing)
    expected = 2 * a * np.arctan(mu * (1 - 2 * nu) / (2 * (1 - nu))) / np.pi
    assert -0.5 * (x[0] + x[-1]) == pytest.approx(expected, abs=spacing)


@pytest.fixture(scope="module")
def on_a_surface():
    grid, response, solver = setting((64, 64), poisson=0.2)
    h = rough(grid, np.random.default_rng(1), 0.8) * 0.01
    problem = FrictionProblem(response, h - h.min(), ShearBound(0.6), load=0.02, force=np.array([0.006, 0.0]))
    return solver, problem, solver.solve(problem, tolerance=1e-9)


@pytest.mark.parametrize("symmetry", ["mirror", "quarter turn"])
def test_a_turned_surface_has_the_turned_solution(symmetry, on_a_surface):
    """Both solutions have the residual 1e-9, which the pressures between points amplify by some 30."""
    solver, problem, found = on_a_surface
    assert found.converged
    h = problem.heights.reshape(64, 64)
    if symmetry == "mirror":  # along x; the force is reversed
        turned, force, sign = h[::-1], np.array([-0.006, 0.0]), -1.0
        expected = [field.reshape(64, 64)[::-1] for field in (found.pressure, *found.traction)]
        expected[1] = sign * expected[1]
    else:  # x becomes y
        turned, force = h.T, np.array([0.0, 0.006])
        p, tx, ty = (field.reshape(64, 64).T for field in (found.pressure, *found.traction))
        expected = [p, ty, tx]
    other = solver.solve(replace(problem, heights=turned.ravel(), force=force), tolerance=1e-9)
    np.testing.assert_allclose(
        other.tractions, np.array(expected).reshape(3, -1), rtol=0, atol=1e-6 * found.pressure.max()
    )


def test_a_surface_that_is_a_line_has_the_solution_of_the_line():
    line, response, solver = setting((128,), poisson=0.1)
    h = rough(line, np.random.default_rng(3), 0.8) * 0.01
    problem = FrictionProblem(response, h - h.min(), ShearBound(0.7), load=0.03, path=np.array([0.002]))
    found = solver.solve(problem, tolerance=1e-9)
    _, response, solver = setting((128, 32), poisson=0.1)
    wide = np.repeat(problem.heights, 32)
    other = solver.solve(
        replace(problem, response=response, heights=wide, path=np.array([0.002, 0.0])), tolerance=1e-9
    )
    expected = np.repeat(np.vstack((found.tractions, np.zeros((1, 128)))), 32, axis=1)
    np.testing.assert_allclose(other.tractions, expected, rtol=0, atol=1e-6 * found.pressure.max())


def test_limits_of_the_coefficient(on_a_surface):
    """Without friction nothing depends on the path; with unlimited friction nothing slips."""
    # A step without slip need not have a solution if shear moves the surface up and down: here it does not.
    solver, problem, _ = on_a_surface
    response = replace(problem.response, coupling=0 * problem.response.coupling)
    moved = replace(problem, force=None, path=np.array([0.01, 0.0]), response=response)
    smooth, stuck = (solver.solve(replace(moved, law=law)) for law in (ShearBound(0.0), ShearBound()))
    assert not smooth.traction.any()
    assert smooth.pressure.mean() == pytest.approx(0.02, rel=1e-12)
    assert smooth.converged
    assert stuck.converged
    assert stuck.stick.sum() == stuck.contact.sum()
    assert np.abs(stuck.slip[:, stuck.contact]).max() < 1e-7 * stuck.displacement[0].max() * 2


def test_the_critical_coefficient_of_a_halfspace_is_that_of_its_poisson_ratio():
    grid, *_ = setting((16, 16))
    for poisson in (0.0, 0.3):
        critical = halfspace(grid, 2.0, poisson).critical_coefficient
        assert critical == pytest.approx((2 - 2 * poisson) / (1 - 2 * poisson), rel=1e-14)
    assert halfspace(grid, 2.0, 0.5).critical_coefficient == np.inf


def test_a_shear_strength_ends_the_traction(on_a_surface):
    """At full slip the traction is min(mu p, tau_0) in the direction of the path."""
    solver, problem, _ = on_a_surface
    law = ShearBound(0.6, 0.05)
    found = solver.solve(replace(problem, law=law, force=None, path=np.array([0.0, 0.5])))
    assert found.converged
    bound = law.bound(found.pressure)
    assert 0.1 < (bound[found.contact] == 0.05).mean() < 0.9
    np.testing.assert_allclose(norms(found.traction), bound, rtol=1e-12)
    assert obeys_coulomb(replace(problem, law=law), found, 1e-7)


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize("seed", [10, 27, 144])
def test_random_steps_obey_coulomb(axes, seed):
    """Rough, smooth and noisy punches, any past, coefficients up to 2, all four combinations of control."""
    # Case 10 of the surfaces is a point that carries nearly all of a light load.
    grid, problem = random_problem(seed, axes)
    found = FrictionSolver(grid, Transforms(grid.points)).solve(problem)
    assert found.converged
    assert found.residual < 1e-7
    assert obeys_coulomb(problem, found, 1e-7)
    if problem.force is not None:
        np.testing.assert_allclose(
            found.traction.mean(axis=1), problem.force, atol=1e-6 * found.pressure.mean()
        )


@pytest.mark.parametrize(
    ("axes", "seeds"),
    [
        (1, (4, 14, 17, 53)),
        (2, (16, 17, 21)),
        *(pytest.param(axes, range(60), marks=pytest.mark.slow) for axes in (1, 2)),
    ],
)
def test_points_stick_and_slip_as_a_dense_solution_tells(axes, seeds):
    """Coefficients up to 0.8, coupled; of 300 seeds 0 wrong of 5594 points on lines, of 25 630 on surfaces.

    |t| is below b(p) by rounding after p was scaled to the load, in these cases where points slip too.
    """
    points = 0
    for seed in seeds:
        grid, problem = random_problem(seed, axes)
        force = None if problem.force is None else 0.4 * problem.force
        problem = replace(problem, law=problem.law.scaled(0.4), force=force)
        found = FrictionSolver(grid, Transforms(grid.points)).solve(problem)
        p, _, sticks, margin = solve_densely(grid, problem, found.depth, found.path, found.tractions)
        assert np.abs(p - found.pressure).max() < 1e-5 * p.max()
        sure = found.contact & (margin > 1e-5)  # beside the tolerance, 1e-7
        np.testing.assert_array_equal(found.stick[sure], sticks[sure])
        bound = problem.law.bound(found.pressure)
        slips = found.contact & ~found.stick
        np.testing.assert_allclose(norms(found.traction)[slips], bound[slips], rtol=1e-12)
        points += np.count_nonzero(sure)
    assert points > 60


@pytest.mark.parametrize("seed", range(8))
def test_the_compiled_linear_systems_of_a_line_have_the_solutions_of_the_plain_ones(seed, monkeypatch):
    compiled, off = LinearSystem.solve_on_line, []

    def both(system, b, inexact):
        parts = system.apply, system.precondition, system.products, system.shared
        plain, iterations = gmres(*parts, b, inexact, INNER)
        found = compiled(system, b, inexact)
        if iterations < INNER:  # else neither has come to its end
            off.append(np.linalg.norm(found - plain) / np.linalg.norm(plain))
        return found

    monkeypatch.setattr(LinearSystem, "solve_on_line", both)
    grid, problem = random_problem(seed, 1)
    solver = FrictionSolver(grid, Transforms(grid.points))
    assert solver.solve(problem, tolerance=1e-6).converged
    # Both have the least residual in the same Krylov space, in single precision (6e-8), which the condition
    # of the preconditioned systems amplifies, some 1e2 at most.
    assert off
    assert max(off) < 1e-5


def test_a_stiff_film_on_a_soft_layer_is_reached_from_the_frictionless_contact():
    """A film of half a spacing, 300 times stiffer than the layer below: Newton's method alone wanders."""
    layers = [
        {"thickness": 0.0035, "poisson": 0.3, "material": {"model": "elastic", "G": 50.0}},
        {"thickness": 0.08, "poisson": 0.3, "material": {"model": "elastic", "G": 0.15}},
    ]
    body = Case(Config(name="film", layers=layers, halfspace={"shear_modulus": math.inf})).body
    grid, _, solver = setting((128,))
    spectrum = body.traction_spectrum(grid.waves)
    response = Response.of_stiffness(spectrum.in_plane.relaxed, spectrum.across.relaxed)
    h = rough(grid, np.random.default_rng(3), 0.8) * 0.01
    problem = FrictionProblem(response, h - h.min(), ShearBound(0.25), load=0.024, force=np.array([-0.004]))
    found = solver.solve(problem)
    assert found.converged
    assert obeys_coulomb(problem, found, 1e-7)


def test_the_bound_of_friction_without_limit_stays():
    assert ShearBound(math.inf, 2.0).scaled(0.5) == ShearBound(math.inf, 1.0)
    assert ShearBound(0.4).scaled(0.5) == ShearBound(0.2)


def test_impossible_friction_is_refused(on_a_surface):
    solver, problem, _ = on_a_surface
    with pytest.raises(ValueError, match="slides away"):
        solver.solve(replace(problem, force=np.array([0.01, 0.0074])))  # 0.0124 > 0.6 * 0.02
    with pytest.raises(ValueError, match=r"coefficient of friction: got -0\.1; must be >= 0"):
        ShearBound(-0.1)


@pytest.mark.parametrize("where", ["heights", "offset", "before", "depth", "path"])
def test_what_is_not_a_number_is_refused_and_as_a_guess_decides_nothing(where):
    grid, response, solver = setting((16, 16), poisson=0.3)
    problem = FrictionProblem(
        response, parabola(grid, 0.25), ShearBound(0.4), depth=0.02, path=np.array([1e-3, 0.0])
    )
    given = {"heights": problem.heights, "path": problem.path, "depth": 0.02, "offset": np.zeros((3, 256))}
    spoilt = np.array(given.get(where, np.zeros((2, 256))))
    spoilt.flat[-1] = np.nan  # a corner, which stays apart
    with pytest.raises(ValueError, match="not finite"):
        solver.solve(replace(problem, **{where: float(spoilt) if where == "depth" else spoilt}))
    found = solver.solve(problem, np.full((3, 256), np.nan))
    np.testing.assert_array_equal(found.traction, solver.solve(problem).traction)


def test_a_solve_that_does_not_end_says_so(on_a_surface):
    solver, problem, _ = on_a_surface
    found = solver.solve(problem, limit=1)
    assert not found.converged
    assert found.residual > 1e-7
    assert "residual" in found.reason


def attracted(points, poisson, law):
    """A parabola under a light load and a third of the largest tangential force, in the first step."""
    grid, response, _ = setting(points, poisson=poisson)
    force = np.array([0.1 * 0.004, 0.05 * 0.004])[: len(points)]
    problem = FrictionProblem(
        response, parabola(grid, 0.25), ShearBound(0.4), load=0.004, force=force, interface=law.interaction()
    )
    return FrictionSolver(grid, Transforms(points), attracts=True), problem


@pytest.mark.parametrize("shape", ["parabola", "rough"])
def test_beside_attraction_shear_is_the_difference_of_two_pressures_of_the_wall(shape):
    """With the attraction tau kept, p - Q/mu solves the contact of a punch of the height h - C tau."""
    # t = mu (p - p*) then has the displacement D where p* > 0, as without attraction
    # (docs/theory/friction.md).
    solver, whole = attracted((512,), 0.5, Exponential(work=1e-4, range=2e-3))
    grid = Grid((512,), (1.0,))
    if shape == "rough":
        h = rough(grid, np.random.default_rng(5), 0.8) * 0.003
        whole = replace(whole, heights=h - h.min(), load=0.01)
    pressed = solver.solve(replace(whole, force=None), tolerance=1e-9)
    wall = pressed.pressure
    found = solver.solve(
        replace(whole, force=np.array([0.5 * 0.4 * wall.mean()])),
        pressed.tractions,
        gap=pressed.gap,
        tolerance=1e-9,
    )
    attraction = whole.interface.traction(found.gap)
    pulled = -np.fft.irfft(whole.response.normal * np.fft.rfft(attraction), n=512)
    less = 0.5 * wall.mean()
    smaller = replace(
        whole,
        law=ShearBound(0.0),
        load=less,
        force=None,
        offset=np.array([pulled, 0 * pulled]),
        interface=HARD_WALL,
    )
    inner = FrictionSolver(grid, Transforms((512,))).solve(smaller, tolerance=1e-9).pressure
    assert found.converged
    assert wall.mean() > 1.2 * whole.load
    assert 0.1 < (inner > 0).sum() / (wall > 0).sum() < 0.9
    np.testing.assert_allclose(
        found.traction[0], 0.4 * (found.pressure - inner), rtol=0, atol=1e-6 * 0.4 * wall.max()
    )


@pytest.mark.parametrize(
    ("points", "poisson", "law"),
    [
        ((512,), 0.0, Exponential(work=2e-4, range=2e-3)),
        ((512,), 0.3, Dugdale(work=1e-4, stress=0.05)),
        ((48, 48), 0.3, LennardJones(work=1e-3, separation=4e-3)),
        ((48, 48), 0.2, Electrostatic(voltage=1.0, insulation=0.02, permittivity=1e-5)),
    ],
)
def test_friction_beside_attraction_obeys_all_conditions(points, poisson, law):
    """Displacements by another transform; gap, attraction and Coulomb's conditions at each point."""
    solver, problem = attracted(points, poisson, law)
    found = solver.solve(problem)
    assert found.converged
    axes = tuple(range(len(points)))
    waves = [np.fft.rfftn(each.reshape(points), axes=axes) for each in found.loads]
    q, response = Grid(points, (1.0,) * len(points)).wavevectors, problem.response
    size = np.sqrt(sum(each**2 for each in q)) + 0.0
    n = [np.divide(each, size, out=np.zeros(size.shape), where=size > 0) for each in np.broadcast_arrays(*q)]
    for axis, direction in enumerate(n):  # no odd part of the shortest wave
        direction[(slice(None),) * axis + (points[axis] // 2,)] = 0.0
    along = sum(-1j * each * wave for each, wave in zip(n, waves[1:], strict=True))
    W = np.fft.irfftn(response.normal * waves[0] + response.coupling * along, s=points, axes=axes).ravel()
    np.testing.assert_allclose(found.displacement[0], W, rtol=0, atol=1e-9 * np.abs(W).max())
    gap = problem.heights + W - found.depth
    strongest = max(found.pressure.max(), problem.interface.strength)
    assert found.pressure * gap == pytest.approx(0, abs=1e-6 * strongest * np.abs(W).max())
    np.testing.assert_allclose(
        found.attraction, problem.interface.traction(np.maximum(gap, 0)), rtol=0, atol=1e-6 * strongest
    )
    assert found.stress.mean() == pytest.approx(problem.load, rel=1e-9)
    assert obeys_coulomb(problem, found, 1e-6)


def test_a_punch_that_attracts_without_contact_is_solved_to_the_tolerance():
    solver, problem = attracted((256,), 0.3, Exponential(work=1e-4, range=2e-3))
    apart = replace(problem, load=None, depth=-0.004, force=None, path=np.zeros(1))
    found = solver.solve(apart)
    assert found.converged
    assert not found.contact.any()
    assert found.attraction.any()
    assert found.residual < 1e-7


def test_limits_of_an_attraction_beside_friction():
    """Without work of adhesion the contact is that of the hard wall; without friction the adhesive one."""
    # Under no load friction is mu times the attraction, and with a shear strength its stress times the area.
    solver, problem = attracted((256,), 0.3, Exponential(work=1e-13, range=2e-3))
    weak, plain = solver.solve(problem), solver.solve(replace(problem, interface=HARD_WALL))
    np.testing.assert_allclose(weak.tractions, plain.tractions, rtol=0, atol=1e-6 * plain.pressure.max())
    solver, problem = attracted((256,), 0.3, Exponential(work=2e-4, range=2e-3))
    sliding = replace(problem, load=0.0, force=None, path=np.array([0.1]))
    slid = solver.solve(sliding)
    assert slid.converged
    assert slid.stress.mean() == pytest.approx(0, abs=1e-12)
    assert abs(slid.traction.mean()) == pytest.approx(0.4 * float(np.mean(slid.attraction)), rel=1e-6)
    strong = solver.solve(replace(sliding, law=ShearBound(strength=0.01)))
    assert strong.contact.any()
    np.testing.assert_allclose(strong.traction[0], 0.01 * strong.contact, rtol=1e-12)
    pulled = solver.solve(replace(problem, load=-1.0, force=np.array([0.0])))
    assert not pulled.converged
    assert "of newton" in pulled.reason


def test_a_force_that_no_path_carries_is_met_by_the_largest_tractions_in_its_direction():
    """Without a root the search went on to its limit, with the path at 1e40."""
    random = np.random.default_rng(4)
    y, radii, total = random.normal(size=(2, 9)), random.uniform(0.1, 1.0, 9), np.array([30.0, -40.0])
    path = path_in_plane(y, radii, total, np.zeros(2))
    assert np.isfinite(path).all()
    assert np.abs(path).max() < 1e10
    carried = in_disks(y + path[:, None], radii).sum(axis=1)
    np.testing.assert_allclose(carried, radii.sum() * total / 50.0, rtol=1e-6)
    half = 0.5 * radii.sum() * total / 50.0
    np.testing.assert_allclose(
        in_disks(y + path_in_plane(y, radii, half, np.zeros(2))[:, None], radii).sum(axis=1), half, rtol=1e-12
    )
