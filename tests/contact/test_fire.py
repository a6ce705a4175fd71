"""FIRE against dense linear algebra; the solution is unique."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gfmdlayer.contact.fire import Fire
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms

Floats = NDArray[np.float64]

TOLERANCE = 1e-11
SHAPES = [(16,), (33,), (64,), (6, 8)]
both_inertias = pytest.mark.parametrize("mass_weighted", [True, False])


def transform(shape: tuple[int, ...], field: Floats) -> Floats:
    return np.asarray(np.fft.rfftn(field.reshape(shape)).ravel())


def random_problem(seed: int, shape: tuple[int, ...], condition: str) -> Problem:
    """A rough punch on a body with a history: an elastic halfspace whose stiffness is scattered by mode."""
    rng = np.random.default_rng(seed)
    grid = Grid(shape, (1.0,) * len(shape))
    q = grid.wavenumbers.ravel()
    size = grid.size
    kappa = q * np.exp(0.5 * np.sin(0.3 * q))  # a function of |q|, as isotropy asks
    if condition == "free mean":
        kappa[0] = 3.0
    h = rng.uniform(-1, 1, size)
    h += rng.uniform(0.05, 0.4) - h.mean()
    b = transform(shape, rng.normal(0, 1, size))
    pressure = rng.uniform(0.5, 2) + (b[0].real < 0) * -b[0].real / size if condition == "pressure" else None
    return Problem(kappa, b, h, pressure)


def solve(
    shape: tuple[int, ...],
    problem: Problem,
    *,
    mass_weighted: bool,
    tolerance: float = TOLERANCE,
    limit: int = 20_000,
) -> Solution:
    solver = Fire(Transforms(shape), mass_weighted=mass_weighted)
    return solver.solve(problem, np.zeros(problem.obstacle.size), tolerance, limit)


@both_inertias
@pytest.mark.parametrize("condition", ["fixed mean", "free mean", "pressure"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("seed", range(6))
def test_rough_contact_of_a_body_with_a_history(dense_contact, seed, shape, condition, mass_weighted) -> None:  # type: ignore[no-untyped-def]
    problem = random_problem(seed, shape, condition)
    u, pressure = dense_contact(shape).solution(problem)
    # Strict complementarity: the reference is far from another contact set.
    assert np.maximum((problem.obstacle - u) / -u.min(), pressure / pressure.max()).min() > 1e-5
    found = solve(shape, problem, mass_weighted=mass_weighted)
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


@both_inertias
@pytest.mark.parametrize("condition", ["fixed mean", "free mean", "pressure"])
def test_a_solution_follows_from_its_displacement(dense_contact, condition, mass_weighted) -> None:  # type: ignore[no-untyped-def]
    shape = (64,)
    problem = random_problem(1, shape, condition)
    for limit in (1, 2, 7, 40, 20_000):  # converged or not
        found = solve(shape, problem, mass_weighted=mass_weighted, limit=limit)
        u, gap = found.displacement, problem.obstacle - found.displacement
        assert found.converged == (found.residual <= TOLERANCE)
        assert found.iterations <= limit
        assert found.transforms >= found.iterations
        assert (gap >= 0).all()
        rounding = 1e-14 * np.abs(problem.stiffness * transform(shape, u)).max()
        np.testing.assert_allclose(found.spectrum, transform(shape, u), atol=rounding)
        multiplier = found.pressure - dense_contact(shape).force(problem, u)
        assert np.ptp(multiplier) <= rounding
        np.testing.assert_allclose(found.mean_pressure, found.pressure.mean(), rtol=1e-13)
        if condition == "fixed mean":
            assert abs(u.mean()) <= 1e-15 * np.abs(u).max()
        elif condition == "pressure":
            assert problem.mean_pressure is not None
            np.testing.assert_allclose(multiplier, problem.mean_pressure, atol=rounding)
        else:
            np.testing.assert_allclose(multiplier, 0, atol=rounding)
        violations = np.minimum(found.pressure / found.pressure.max(), gap / -u.min())
        np.testing.assert_allclose(found.residual, np.abs(violations).max(), rtol=1e-9)
    assert found.converged


@both_inertias
def test_too_few_iterations_are_admitted(mass_weighted: bool) -> None:
    found = solve((64,), random_problem(2, (64,), "fixed mean"), mass_weighted=mass_weighted, limit=3)
    assert not found.converged
    assert found.residual > TOLERANCE


@both_inertias
@pytest.mark.parametrize("where", ["stiffness", "intercept", "obstacle", "start"])
def test_what_is_not_a_number_is_never_an_answer(where: str, mass_weighted: bool) -> None:
    problem, start = random_problem(3, (32,), "fixed mean"), np.zeros(32)
    spoilt = {name: getattr(problem, name).copy() for name in ("stiffness", "intercept", "obstacle")}
    spoilt["start"] = start
    spoilt[where][3] = np.nan
    start = spoilt.pop("start")
    solver = Fire(Transforms((32,)), mass_weighted=mass_weighted)
    try:
        found = solver.solve(replace(problem, **spoilt), start, 1e-6, 50)
    except ValueError:
        return
    assert not found.converged


@both_inertias
@pytest.mark.parametrize("mean", ["fixed", "free"])
def test_a_punch_that_only_touches_presses_on_nothing(mean: str, mass_weighted: bool) -> None:
    grid = Grid((128,), (1.0,))
    kappa = 2 * grid.wavenumbers
    kappa[0] = 0.0 if mean == "fixed" else 1.0
    punch = grid.coordinates[0] ** 2
    found = solve((128,), Problem(kappa, np.zeros(65, complex), punch), mass_weighted=mass_weighted)
    assert found.converged
    np.testing.assert_allclose(found.displacement, 0, atol=1e-15)
    np.testing.assert_allclose(found.pressure, 0, atol=1e-12)
    assert found.contact_area <= 1 / 128  # the apex


@both_inertias
def test_a_punch_out_of_reach_leaves_the_surface_flat(mass_weighted: bool) -> None:
    grid = Grid((128,), (1.0,))
    h = 0.1 + grid.coordinates[0] ** 2
    problem = Problem(2 * grid.wavenumbers, np.zeros(65, complex), h)
    found = solve((128,), problem, mass_weighted=mass_weighted)
    assert found.converged
    assert found.contact_area == 0
    np.testing.assert_allclose(found.displacement, 0, atol=1e-15)
    np.testing.assert_allclose(found.pressure, 0, atol=1e-12)


@both_inertias
def test_a_surface_pressed_into_every_valley_follows_the_punch(mass_weighted: bool) -> None:
    # With the mean free and a pressure above the amplitude of the mode's stress, contact is full.
    grid = Grid((64,), (1.0,))
    kappa = 2 * grid.wavenumbers
    punch = 0.01 * (1 - np.cos(2 * np.pi * grid.coordinates[0]))
    stress = kappa[1] * 0.01
    problem = Problem(kappa, np.zeros(33, complex), punch, mean_pressure=1.5 * stress)
    found = solve((64,), problem, mass_weighted=mass_weighted)
    assert found.converged
    assert found.contact_area == 1
    # A stray gap of TOLERANCE depth weighs no more than the stiffest mode makes of it.
    rounding = 64 * TOLERANCE * kappa.max() * 0.02
    expected = stress * (1.5 + np.cos(2 * np.pi * grid.coordinates[0]))
    np.testing.assert_allclose(found.pressure, expected, atol=rounding)


@both_inertias
def test_a_cell_that_the_punch_fills_is_in_full_contact(mass_weighted: bool) -> None:
    grid = Grid((64,), (1.0,))
    h = -0.01 * np.cos(2 * np.pi * grid.coordinates[0])
    h += abs(h.mean())
    problem = Problem(2 * grid.wavenumbers, np.zeros(33, complex), h)
    found = solve((64,), problem, mass_weighted=mass_weighted)
    assert found.converged
    np.testing.assert_allclose(found.displacement, h, atol=1e-15)
    assert (found.pressure >= -1e-12).all()


@both_inertias
def test_one_solver_serves_step_after_step(mass_weighted: bool) -> None:
    shape = (64,)
    solver = Fire(Transforms(shape), mass_weighted=mass_weighted)
    first, second = (random_problem(seed, shape, "fixed mean") for seed in (4, 5))
    alone = solver.solve(first, np.zeros(64), TOLERANCE)
    kept = alone.displacement.copy(), alone.pressure.copy(), alone.spectrum.copy()
    solver.solve(second, alone.displacement, TOLERANCE)
    for before, after in zip(kept, (alone.displacement, alone.pressure, alone.spectrum), strict=True):
        np.testing.assert_array_equal(after, before)
    again = solver.solve(first, np.zeros(64), TOLERANCE)
    np.testing.assert_array_equal(again.displacement, alone.displacement)


@both_inertias
@pytest.mark.parametrize("axis", [0, 1])
def test_a_ridge_on_a_surface_in_two_dimensions_is_a_line_contact(axis: int, mass_weighted: bool) -> None:
    n, across = 128, 12
    points = (n, across) if axis == 0 else (across, n)
    line, plane = Grid((n,), (1.0,)), Grid(points, (1.0, 0.7) if axis == 0 else (0.7, 1.0))
    h = 2 * line.coordinates[0] ** 2 - 0.01
    thin = solve((n,), Problem(2 * line.wavenumbers, np.zeros(n // 2 + 1, complex), h), mass_weighted=True)
    ridge = np.broadcast_to(h[:, None] if axis == 0 else h, points).ravel()
    zero = np.zeros(plane.wavenumbers.size, complex)
    wide = solve(points, Problem(2 * plane.wavenumbers.ravel(), zero, ridge), mass_weighted=mass_weighted)
    pressure = np.moveaxis(wide.pressure.reshape(points), axis, 0)
    # Both are within TOLERANCE of the same answer, amplified by the stiffness' spread over the modes.
    off = 2 * np.sqrt(n * across) * n * TOLERANCE
    np.testing.assert_allclose(
        pressure, np.tile(thin.pressure, (across, 1)).T, atol=off * thin.pressure.max()
    )
    assert wide.contact_area == thin.contact_area
    np.testing.assert_allclose(wide.mean_pressure, thin.mean_pressure, rtol=off)
