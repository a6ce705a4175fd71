"""FIRE against dense linear algebra; more in `test_active_set`."""

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
@pytest.mark.parametrize("condition", ["fixed mean", "free mean", "load"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("seed", range(6))
def test_rough_contact_of_a_body_with_a_history(dense_contact, seed, shape, condition, mass_weighted) -> None:  # type: ignore[no-untyped-def]
    problem = dense_contact(shape).problem(seed, condition)
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
@pytest.mark.parametrize("condition", ["fixed mean", "free mean", "load"])
def test_a_solution_follows_from_its_displacement(dense_contact, condition, mass_weighted) -> None:  # type: ignore[no-untyped-def]
    shape = (64,)
    problem = dense_contact(shape).problem(1, condition)
    for limit in (1, 2, 7, 40, 20_000):  # converged or not
        found = solve(shape, problem, mass_weighted=mass_weighted, limit=limit)
        u, gap = found.displacement, problem.obstacle - found.displacement
        assert found.converged == (found.residual <= TOLERANCE)
        assert found.iterations <= limit
        assert found.transforms >= found.iterations
        assert (gap >= 0).all()
        rounding = 1e-14 * np.abs(problem.stiffness * dense_contact(shape).transform(u)).max()
        np.testing.assert_allclose(found.spectrum, dense_contact(shape).transform(u), atol=rounding)
        multiplier = found.pressure - dense_contact(shape).force(problem, u)
        assert np.ptp(multiplier) <= rounding
        np.testing.assert_allclose(found.mean_pressure, found.pressure.mean(), rtol=1e-13)
        if condition == "fixed mean":
            assert abs(u.mean()) <= 1e-15 * np.abs(u).max()
        elif condition == "load":
            assert problem.mean_pressure is not None
            np.testing.assert_allclose(multiplier, problem.mean_pressure, atol=rounding)
        else:
            np.testing.assert_allclose(multiplier, 0, atol=rounding)
        violations = np.minimum(found.pressure / found.pressure.max(), gap / -u.min())
        np.testing.assert_allclose(found.residual, np.abs(violations).max(), rtol=1e-9)
    assert found.converged


@both_inertias
@pytest.mark.parametrize("where", ["stiffness", "intercept", "obstacle", "start"])
def test_what_is_not_a_number_is_never_an_answer(dense_contact, where, mass_weighted) -> None:  # type: ignore[no-untyped-def]
    problem, start = dense_contact((32,)).problem(3, "fixed mean"), np.zeros(32)
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
def test_a_punch_out_of_reach_leaves_the_surface_flat(mass_weighted: bool) -> None:
    grid = Grid((128,), (1.0,))
    h = 0.1 + grid.coordinates[0] ** 2
    problem = Problem(2 * grid.wavenumbers, np.zeros(65, complex), h)
    found = solve((128,), problem, mass_weighted=mass_weighted)
    assert found.converged
    assert found.contact_area == 0
    np.testing.assert_allclose(found.displacement, 0, atol=1e-15)
    np.testing.assert_allclose(found.pressure, 0, atol=1e-12)
