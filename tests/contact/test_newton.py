"""Interfaces that attract: the solvers find a minimum, and the one to which the state before leads."""

from itertools import pairwise

import numpy as np
import pytest

from gfmdlayer.contact.fire import Fire
from gfmdlayer.contact.newton.solver import Newton
from gfmdlayer.contact.problem import Problem, project
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.interface.adhesion import Dugdale, Electrostatic, Exponential, LennardJones
from gfmdlayer.interface.law import HARD_WALL, total
from gfmdlayer.punch.self_affine import SelfAffine

LINE = (32,)
SURFACE = (6, 6)
TRANSFORMS = {shape: Transforms(shape) for shape in (LINE, SURFACE)}


def problem(kappa, h, law, load=None, b=None):
    """Contact problem on a line, or with the transform of an intercept."""
    intercept = np.zeros(kappa.size, complex) if b is None else b
    return Problem(kappa, intercept.astype(complex), h, load, interface=law)


def at_rest(size):
    """Gap before the first step."""
    return np.full(size, np.inf)


def dense(kappa, shape):
    """K as a matrix over the points."""
    spectral = (*shape[:-1], shape[-1] // 2 + 1)
    unit = np.eye(int(np.prod(shape))).reshape(-1, *shape)
    axes = tuple(range(1, unit.ndim))
    rows = np.fft.irfftn(kappa.reshape(spectral) * np.fft.rfftn(unit, axes=axes), s=shape, axes=axes)
    return rows.reshape(len(unit), -1)


def history(of, shape):
    """Intercept at the points."""
    spectrum = of.intercept.reshape(TRANSFORMS[shape].spectral_shape)
    return np.fft.irfftn(spectrum, s=shape, axes=tuple(range(len(shape)))).ravel()


def random_law(rng):
    """Any law, from much stronger than the body to much weaker."""
    stress, length = 10 ** rng.uniform(-3, 1), 10 ** rng.uniform(-3, -0.5)
    work = stress * length
    match rng.integers(5):
        case 0:
            return Exponential(work=work, range=length).interaction()
        case 1:
            return Dugdale(work=work, stress=stress, smoothing=rng.uniform(0.05, 1)).interaction()
        case 2:
            return LennardJones(work=work, separation=length).interaction()
        case 3:
            return Electrostatic(voltage=stress**0.5, insulation=length, permittivity=2e-3).interaction()
    parts = Exponential(work=work, range=length), LennardJones(work=0.1 * work, separation=0.3 * length)
    return total([part.interaction() for part in parts])


def random_problems(seed):
    """Three steps of one body and one punch, under depths or loads that differ by any amount."""
    rng = np.random.default_rng(seed)
    shape = SURFACE if rng.random() < 0.3 else LINE
    grid = Grid(shape, (1.0,) * len(shape))
    q, n = np.ravel(grid.wavenumbers), int(np.prod(shape))
    E, x = 10 ** rng.uniform(-1, 1), q * 10 ** rng.uniform(-2, 1)
    with np.errstate(all="ignore"):
        kappa = [
            E * q,  # halfspace
            E * np.where(x > 0, q / np.tanh(x), q[1] / x[1]),  # compressible layer on a rigid base
            E * q * (1e-3 + np.tanh(x) ** 2),  # stiff layer on a soft base
            E * np.where(x > 0, q * (1 + 1 / x**2), 0),  # thin incompressible layer
        ][rng.integers(4)]
    squares = np.ravel(sum(axis**2 for axis in np.meshgrid(*grid.coordinates, indexing="ij")))
    heights = [
        10 ** rng.uniform(-1, 1) * squares,
        10 ** rng.uniform(-3, -1) * rng.normal(size=n),
        0.01 * np.cumsum(rng.normal(size=n)),
    ][rng.integers(3)]
    h, law, loaded = heights - heights.min(), random_law(rng), rng.random() < 0.3
    history = rng.normal(size=n) * law.strength * rng.choice([0.0, 0.1])
    b = np.fft.rfftn(history.reshape(shape)).ravel()
    if loaded or kappa[0] == 0:
        kappa, b = kappa.copy(), b.copy()
        kappa[0] = b[0] = 0.0
    for _ in range(3):
        if loaded:
            yield problem(kappa, h, law, rng.uniform(0, 1) * law.strength, b), shape
        else:
            yield problem(kappa, h - rng.uniform(-1, 0.9) * h.mean(), law, None, b), shape


def least_eigenvalue(K, of, found):
    """Least curvature of the energy along the free points, over the largest of the interface."""
    curvature = of.interface.curvature(found.gap)
    pressed = (found.gap <= 0) & (of.wall_pressure(found.pressure, found.gap) > 0)
    hessian = (K + np.diag(curvature))[np.ix_(~pressed, ~pressed)]
    free = len(hessian)
    if of.mean_is_fixed and free:  # displacements of zero sum
        basis = np.linalg.qr(np.c_[np.ones(free), np.eye(free)[:, 1:]])[0][:, 1:]
        hessian = basis.T @ hessian @ basis
    scale = np.abs(of.interface.curvature(np.linspace(0, 4 * of.interface.range, 400))).max()
    return float(np.linalg.eigvalsh(hessian)[0] / scale) if len(hessian) else 0.0


@pytest.mark.parametrize("seeds", [range(90), pytest.param(range(90, 334), marks=pytest.mark.slow)])
def test_a_minimum_is_found_in_each_of_a_thousand_random_problems(seeds):
    tolerance, count = 1e-6, 0
    for seed in seeds:
        start, K = None, None
        for each, shape in random_problems(seed):
            start = at_rest(each.obstacle.size) if start is None else start
            K = dense(each.stiffness, shape) if K is None else K
            found = Newton(TRANSFORMS[shape]).solve(each, start, tolerance)
            start = found.gap
            # The residual, from K as a matrix; its scales are the strength at least and the range at most.
            assert found.converged, seed
            force = history(each, shape) - K @ found.displacement
            pressure = force + (found.pressure - force).mean()
            wall, law = each.wall_pressure(pressure, found.gap), each.interface
            np.testing.assert_allclose(pressure, found.pressure, atol=1e-9 * law.strength)
            scale = max(law.strength, wall.max())
            assert np.abs(np.minimum(wall / scale, found.gap / law.range)).max() <= 2 * tolerance, seed
            # Near the end of a branch a residual t leaves u uncertain by sqrt(2 t) of the range.
            assert least_eigenvalue(K, each, found) >= -np.sqrt(2 * tolerance), seed
            count += 1
    assert count == 3 * len(seeds)


def energy(of, K, b, u):
    """Energy, sum over the points, at a given depth."""
    return float(0.5 * u @ K @ u - b @ u + of.interface.energy(of.obstacle - u).sum())


def test_the_energy_never_rises_along_a_relaxation_at_a_fixed_punch():
    for seed in range(60):
        each, shape = next(random_problems(seed))
        if each.mean_pressure is not None:
            continue
        K, rest, newton = dense(each.stiffness, shape), at_rest(each.obstacle.size), TRANSFORMS[shape]
        whole = Newton(newton).solve(each, rest)
        states = [Newton(newton).solve(each, rest, limit=k) for k in range(1, whole.iterations + 1)]
        b = history(each, shape)
        found = [energy(each, K, b, state.displacement) for state in (*states, whole)]
        # To rounding of its parts, which the loop itself cannot see: 1e-13 of each, in K 1e-15 n.
        assert (np.diff(found) <= 1e-11 * (np.abs(found[1:]) + np.abs(found[:-1]))).all(), seed


N = 256
X = Grid((N,), (1.0,)).coordinates[0]
HALFSPACE = 2.0 * Grid((N,), (1.0,)).wavenumbers  # E* = 4
ADHESIVE = Exponential(work=1e-3, range=4e-3).interaction()


def follow(solver, h, law, values, *, loaded=False, noise=0.0, tolerance=1e-6):
    """Follow a line contact on a halfspace over given depths or loads; shake each start by some noise."""
    rng, start, found = np.random.default_rng(0), at_rest(N), []
    for value in values:
        each = problem(HALFSPACE, h if loaded else h - value, law, value if loaded else None)
        found.append(solver.solve(each, start, tolerance))
        assert found[-1].converged
        shaken = found[-1].gap + noise * law.range * rng.normal(size=N)
        start = np.where(found[-1].gap > 0, np.maximum(shaken, 1e-12), 0.0)
    return found


def legs(count, *turns):
    """Depths on the way from each turn to the next, in so many steps."""
    ways = (np.linspace(a, b, count + 1)[1:] for a, b in pairwise(turns))
    return [turns[0], *np.concatenate(list(ways))]


def rough(seed):
    """A rough line, zero at its lowest point."""
    rng = np.random.default_rng(seed)
    waves = (0.01 * k**-1.2 * np.cos(2 * np.pi * (k * X + rng.random())) for k in range(1, 20))
    h = np.sum(list(waves), axis=0)
    return np.asarray(h - np.min(h))


TWO_BUMPS = np.minimum(3 * (X - 0.25) ** 2, 3 * (X + 0.25) ** 2 + 5e-4)


@pytest.mark.parametrize(
    ("h", "law", "turns", "loaded"),
    [
        (2 * X**2, ADHESIVE, (-0.015, 0.004, -0.003), False),
        (2 * X**2, ADHESIVE, (-0.015, 0.004, -0.009), False),
        (TWO_BUMPS, ADHESIVE, (-0.01, 0.002, -0.004), False),
        (rough(0), Exponential(work=3e-4, range=2e-3).interaction(), (-0.004, 0.01, 0.0), False),
        (rough(1), Exponential(work=3e-4, range=2e-3).interaction(), (0.0, 0.01, -0.003), True),
        (rough(2), LennardJones(work=3e-4, separation=1.5e-3).interaction(), (-0.004, 0.008, 0.0), False),
    ],
    ids=["snapped in", "pulled off", "two bumps", "rough", "rough under load", "rough, Lennard-Jones"],
)
def test_landings_depend_neither_on_the_time_step_nor_on_the_start(h, law, turns, loaded):
    tolerance, solver = 1e-7, Newton(Transforms((N,)))
    given = {"loaded": loaded, "tolerance": tolerance}
    reference = follow(solver, h, law, legs(40, *turns), **given)
    assert sum(found.released_energy > 0 for found in reference[1:]) > 0 or loaded
    others = [follow(solver, h, law, legs(count, *turns), **given)[-1] for count in (4, 10, 20)]
    # A start that differs by less than the tolerance lets know is another solution of the step before.
    others.append(follow(solver, h, law, legs(20, *turns), **given, noise=0.1 * tolerance)[-1])
    for other in others:
        # The same minimum, each within the residual; its least curvature is above a hundredth of the largest.
        np.testing.assert_allclose(other.gap, reference[-1].gap, rtol=0, atol=100 * tolerance * law.range)


def test_jumps_of_a_rough_surface_and_their_energies_are_those_of_ten_substeps():
    # Of a retraction in eight steps. Until the deviation from the tangent was looked at, Newton's steps ran
    # past a jump that releases 5.8 works of adhesion of a point. The trapezoidal rule for the work misplaces
    # a jump by half a step at most; changes of the force without a jump are less than that here.
    side, law = 64, Exponential(work=2e-3, range=5e-3).interaction()
    grid, point = Grid((side, side), (1.0, 1.0)), 2e-3 / side**2
    shape = SelfAffine(hurst=0.8, roll_off=0.25, short_cutoff=0.125, rms_slope=0.1, seed=1)
    h, kappa = np.ravel(shape.heights(grid)), 2 * np.ravel(grid.wavenumbers)
    whole, tenth = (Newton(Transforms(grid.points), grid) for _ in range(2))
    depth = 0.7 * np.mean(h)
    last = whole.solve(problem(kappa, h - depth, law), at_rest(h.size))
    reported, true, bounds = [], [], []
    for after in np.linspace(depth, 0.0, 9)[1:]:
        found, gap, released = whole.solve(problem(kappa, h - after, law), last.gap), last.gap, 0.0
        for between in np.linspace(depth, after, 11)[1:]:
            each = tenth.solve(problem(kappa, h - between, law), gap)
            gap, released = each.gap, released + each.released_energy
        np.testing.assert_allclose(found.gap, gap, rtol=0, atol=1e-3 * law.range)
        reported.append(found.released_energy / point)
        true.append(released / point)
        bounds.append(abs((after - depth) * (found.mean_pressure - last.mean_pressure)) / (2 * point))
        last, depth = found, after
    jumps = np.array(true) > 0.3
    assert jumps.sum() > 4
    assert (np.array(reported)[jumps] > 0).all()
    assert (np.abs(np.subtract(reported, true)) < bounds).all()
    # In the sum the errors cancel: before, energies counted from states past the ends of the branches.
    assert sum(reported) == pytest.approx(sum(true), rel=0.2)


def explicit_descent(of, K):
    """Gap at the end of eta du/dt = p_c with u <= h and mean(u) = 0, from rest, by short explicit steps."""
    h, law = of.obstacle, of.interface
    dt = 0.2 / (np.linalg.norm(K, 2) + np.abs(law.curvature(np.zeros(1)))[0])
    u = np.zeros(h.size)
    project(u, h, mean_is_fixed=True)
    for _ in range(100_000):
        force = law.traction(h - u) - K @ u
        free = u < h
        for _ in range(3):
            free = (u < h) | (force < force[free].mean())
        v = np.minimum(u + dt * np.where(free, force - force[free].mean(), 0.0), h)
        project(v, h, mean_is_fixed=True)
        if np.abs(v - u).max() < 1e-9 * law.range:  # of 2e-3 of the way that is left, or more
            break
        u = v
    return np.asarray(h - u)


def test_an_instability_ends_where_the_overdamped_descent_of_the_energy_does():
    n, several = 32, 0
    grid, transforms = Grid((n,), (1.0,)), Transforms((n,))
    kappa, x = 2 * grid.wavenumbers, grid.coordinates[0]
    K, law = dense(kappa, (n,)), Exponential(work=4e-3, range=2e-3).interaction()
    # On these lines a change of the heights by 1e-6 leaves the minimum; on a few others, as 1, 13, 19 and 20,
    # it can lead elsewhere, and so can the rounding of the linear systems in single precision.
    for seed in (0, 2, 3, 5, 7):
        rng = np.random.default_rng(seed)
        h = np.sum([0.01 / k * np.cos(2 * np.pi * (k * x + rng.random())) for k in range(1, 12)], axis=0)
        depth = rng.uniform(-0.003, 0.005)
        each = problem(kappa, h - np.min(h) - depth, law)
        found = Newton(transforms).solve(each, at_rest(n), 1e-8)
        # One minimum, or gaps that differ by a good part of the range; see above for the tolerance.
        expected = explicit_descent(each, K)
        np.testing.assert_allclose(found.gap, expected, rtol=0, atol=1e-4 * law.range, err_msg=f"{seed}")
        retreating = at_rest(n)  # to this depth, from where the punch has been pressed in
        for before in np.linspace(0.01, depth, 20):
            retreating = Newton(transforms).solve(problem(kappa, h - np.min(h) - before, law), retreating).gap
        several += np.abs(retreating - found.gap).max() > law.range
    assert several > 2  # the descent had a choice


def test_newton_and_fire_agree_where_the_minimum_is_unique():
    # |w''| is less than kappa_1 everywhere: the energy is convex, also at a step of a relaxing body.
    law = Exponential(work=2e-4, range=5e-3).interaction()
    assert np.abs(law.curvature(np.zeros(1)))[0] < HALFSPACE[1]
    history = np.fft.rfft(0.02 * np.cos(2 * np.pi * X))
    for kappa, b, load in (
        (HALFSPACE, None, None),
        (HALFSPACE, history, None),
        (HALFSPACE + 3.0, history, None),
        (HALFSPACE, None, -0.002),
        (HALFSPACE, history, 0.01),
    ):
        each = problem(kappa, 2 * X**2 - 0.002, law, load, b)
        transforms = Transforms((N,))
        newton, fire = (
            solver.solve(each, at_rest(N), 1e-9)
            for solver in (Newton(transforms), Fire(transforms, starts_from="gap"))
        )
        assert newton.converged
        assert fire.converged
        # Both within 1e-9 of the strength; the lowest mode less the curvature is a third of kappa_1.
        np.testing.assert_allclose(newton.gap, fire.gap, atol=10 * 1e-9 * law.strength / HALFSPACE[1])
        np.testing.assert_allclose(newton.pressure, fire.pressure, atol=100 * 1e-9 * law.strength)
        assert newton.released_energy == 0
        assert newton.mean_pressure == pytest.approx(fire.mean_pressure, abs=1e-8 * law.strength)


def film():
    """Stiffness of a film, a law, and the gap at which -w'' is the stiffness of its lowest mode."""
    q = Grid((N,), (1.0,)).wavenumbers
    kappa = 4.0 * np.where(q > 0, q * (0.2 + (10 / np.maximum(q, 1)) ** 2), 0)
    law = Exponential(work=1.0, range=0.05).interaction()
    return kappa, law, law.range * np.log(law.strength / law.range / kappa[1:].min())


@pytest.mark.parametrize("after_full_contact", [False, True])
def test_an_even_film_becomes_uneven_though_its_balance_stays(after_full_contact):
    """An even gap g is in balance; where |w''(g)| exceeds the least stiffness it is no minimum."""
    (kappa, law, gap), newton = film(), Newton(Transforms((N,)))
    if after_full_contact:  # in which there is no deformation to follow
        full = newton.solve(problem(kappa, np.zeros(N), law, law.strength), at_rest(N), 1e-9)
        assert full.contact_area == 1
    even, uneven = (
        newton.solve(problem(kappa, np.full(N, part * gap), law), at_rest(N), 1e-9) for part in (1.01, 0.99)
    )
    assert np.ptp(even.gap) == 0
    assert 0 < even.margin < 0.1
    assert even.released_energy == 0
    assert np.ptp(uneven.gap) > 0.1 * law.range
    assert uneven.margin > 0
    assert uneven.released_energy > 0


@pytest.mark.parametrize("uneven", [0.0, 1e-10, 1e-8, 1e-6])
@pytest.mark.parametrize("past", [1e-4, 1e-3, 1e-2])
def test_a_film_that_is_even_beyond_its_stability_keeps_its_mean_as_the_punch_moves(uneven, past):
    # Even gaps are in balance at any mean, so that balance does not tell whether the surface has moved.
    kappa, law, gap = film()
    lowest = np.cos(2 * np.pi * int(np.argmin(kappa[1:]) + 1) * np.arange(N) / N)
    before, after = (1 - past) * gap, (1 - 2 * past) * gap
    newton = Newton(Transforms((N,)))
    found = newton.solve(problem(kappa, np.full(N, after), law), before + uneven * law.range * lowest, 1e-6)
    assert found.converged
    assert abs(found.displacement.mean()) < 1e-12 * law.range


@pytest.mark.parametrize(("G", "L"), [(1e11, 1e-9), (1e12, 1e-10), (1e-12, 1e9)])
def test_units_do_not_count(G, L):
    law = Exponential(work=1e-3 * G * L, range=4e-3 * L).interaction()
    solvers, starts = (Newton(Transforms((N,))), Newton(Transforms((N,)))), [at_rest(N), at_rest(N)]
    for depth in legs(8, -0.015, 0.004, -0.009):
        plain = solvers[0].solve(problem(HALFSPACE, 2 * X**2 - depth, ADHESIVE), starts[0])
        other = solvers[1].solve(problem(HALFSPACE * G / L, (2 * X**2 - depth) * L, law), starts[1])
        starts = [plain.gap, other.gap]
        assert other.converged
        np.testing.assert_allclose(other.gap / L, plain.gap, rtol=0, atol=100 * 1e-6 * ADHESIVE.range)


def test_no_solution_is_claimed_where_nothing_holds_the_load():
    solver = Newton(Transforms((N,)))
    held = follow(solver, 2 * X**2, ADHESIVE, [0.0, -0.01], loaded=True)[-1]
    lost = solver.solve(problem(HALFSPACE, 2 * X**2, ADHESIVE, -0.02), held.gap)
    assert not lost.converged
    assert ADHESIVE.traction(lost.gap).max() < 0.02
    each = problem(HALFSPACE, 2 * X**2, ADHESIVE)
    short = Newton(Transforms((N,))).solve(each, at_rest(N), limit=2)
    assert not short.converged
    assert short.residual > 1e-6


def test_a_hard_wall_is_a_law_like_others():
    each = problem(HALFSPACE, 2 * X**2 - 0.01, HARD_WALL)
    found = Newton(Transforms((N,))).solve(each, at_rest(N), 1e-9)
    exact = Fire(Transforms((N,))).solve(each, np.zeros(N), 1e-9)
    assert found.converged
    np.testing.assert_allclose(found.pressure, exact.pressure, atol=1e-7 * exact.pressure.max())
    assert found.residual == pytest.approx(
        np.abs(np.minimum(found.pressure / found.pressure.max(), found.gap / -found.displacement.min())).max()
    )


@pytest.mark.parametrize(
    "law", [ADHESIVE, Dugdale(work=1e-3, stress=0.3).interaction()], ids=["exponential", "dugdale"]
)
def test_the_same_punch_lands_alike_on_a_line_and_on_a_surface(law):
    n, grid = 64, Grid((64, 8), (1.0, 1.0))
    line, surface = Newton(Transforms((n,))), Newton(Transforms((n, 8)))
    h = 2 * grid.coordinates[0] ** 2
    start, starts = at_rest(n), at_rest(8 * n)
    for depth in legs(10, -0.012, 0.004, -0.006):
        one = line.solve(problem(2 * Grid((n,), (1.0,)).wavenumbers, h - depth, law), start, 1e-8)
        kappa = 2 * np.ravel(grid.wavenumbers)
        two = surface.solve(problem(kappa, np.repeat(h, 8) - depth, law), starts, 1e-8)
        start, starts = one.gap, two.gap
        np.testing.assert_allclose(two.gap.reshape(n, 8), np.tile(one.gap[:, None], 8), atol=1e-5 * law.range)
