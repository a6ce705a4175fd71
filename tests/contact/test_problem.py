"""The contact problem: projection onto its constraints, a finer tolerance, and reasons for a failure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gfmdlayer.case.case import Case
from gfmdlayer.config import Config
from gfmdlayer.contact.problem import (
    Problem,
    Solution,
    make_solution,
    project,
    solve_finer,
    why_not_converged,
)
from gfmdlayer.resumable import Stateless

EPS = np.finfo(float).eps

compiles = settings(deadline=None)  # the first call compiles
values = st.floats(-1, 1, allow_subnormal=False)


@st.composite
def surfaces(draw):
    """A displacement and an obstacle with some room below it, of any scale."""
    n = draw(st.integers(1, 60))
    scale = 10.0 ** draw(st.integers(-6, 6))
    u, h = draw(arrays(np.float64, n, elements=values)), draw(arrays(np.float64, n, elements=values))
    h = h - h.mean() + draw(st.floats(0.01, 1))
    touching = draw(arrays(np.bool_, n))
    return scale * np.where(touching, h, u), scale * h


def mean_of(u):
    return math.fsum(u) / u.size


@given(surfaces())
@compiles
def test_the_projection_keeps_to_the_punch_the_mean_and_one_shift(surface):
    start, h = surface
    u = start.copy()
    project(u, h, mean_is_fixed=True)
    assert (u <= h).all()
    # Each value is rounded once after the shift that makes their compensated sum zero; so is the shift.
    assert abs(mean_of(u)) <= 4 * EPS * np.abs(np.append(u, h)).max()
    again = u.copy()  # projecting twice changes nothing but rounding
    project(again, h, mean_is_fixed=True)
    assert np.abs(again - u).max() <= 8 * EPS * max(np.abs(u).max(), np.abs(h).max()) * u.size
    start = np.minimum(start, h)
    if (start < h).any():  # otherwise all of them move
        np.testing.assert_array_equal(u[start == h], h[start == h])
    shifts = (u - start)[u < h]
    if shifts.size:  # free points share one shift, and the others would overlap with it
        rounding = 4 * EPS * max(np.abs(start).max(), np.abs(u).max())
        assert np.ptp(shifts) <= rounding
        stopped = (u == h) & (start < h)
        assert ((h - start)[stopped] <= shifts.max() + rounding).all()
    # A free mean is left alone, and a punch that displaces more than the cell holds is refused.
    u = surface[0].copy()
    project(u, h, mean_is_fixed=False)
    np.testing.assert_array_equal(u, start)
    with pytest.raises(ValueError, match="the punch is too deep"):
        project(u, h - 2 * np.abs(h).max(), mean_is_fixed=True)


def test_a_punch_that_fills_the_cell_exactly_is_followed():
    h = np.array([0.5, -0.25, 0.25, -0.5])
    u = np.zeros(4)
    project(u, h, mean_is_fixed=True)
    np.testing.assert_array_equal(u, h)


def test_the_mean_stays_at_rounding_with_many_points_of_very_different_height():
    rng = np.random.default_rng(1)
    h = np.exp(rng.uniform(-12, 0, 2**18))
    u = rng.standard_normal(h.size)
    project(u, h, mean_is_fixed=True)
    assert abs(mean_of(u)) <= 4 * EPS * np.abs(u).max()


# --- a finer tolerance ---

PROBLEM, START = cast(Problem, None), np.zeros(4)


@dataclass
class Reaching(Stateless):
    """Reaches a residual in two iterations, and records each tolerance, limit and start."""

    reached: float
    calls: list[tuple[float, int, float]] = field(default_factory=list)
    starts_from = "displacement"

    def solve(self, _, start, tolerance, limit):
        self.calls.append((tolerance, limit, float(start[0])))
        start += 1.0  # as solvers may
        u, none = np.full(4, tolerance), np.zeros(4)
        state = Solution(u, none, none, none, none + 0j, 0.0, 0.0, 0.5, self.reached, 3, 2, converged=True)
        return replace(state, converged=self.reached <= tolerance)

    def compile(self): ...


@pytest.mark.parametrize(
    ("reached", "again", "converges", "pairs"),
    [
        (1e-12, [], True, 3),
        (1e-8, [(1e-6, 5000, 1e-10)], True, 6),  # from the state of the first solve
        (1e-5, [(1e-6, 5000, 0.0)], False, 6),  # from the first guess
    ],
    ids=["finer", "given", "neither"],
)
def test_a_solve_that_misses_the_finer_tolerance_is_repeated_to_the_given_one(
    reached, again, converges, pairs
):
    solver = Reaching(reached)
    found = solve_finer(solver, PROBLEM, START.copy(), 1e-10, 1e-6, 5000)
    assert (found.converged, found.residual, found.transforms) == (converges, reached, pairs)
    assert solver.calls == [(1e-10, 1000, 0.0), *again]


def test_one_solve_suffices_where_no_finer_tolerance_is_needed():
    solver = Reaching(1e-5)
    assert not solve_finer(solver, PROBLEM, START.copy(), 1e-6, 1e-6, 5000).converged
    assert solver.calls == [(1e-6, 5000, 0.0)]


# --- failures ---


def test_a_failed_step_names_its_reason():
    case = Case(Config(name="x", grid={"points": 64}, trajectory={"depth": 0.01}))
    flat = np.zeros(case.grid.wavenumbers.shape)
    problem = case.contact.loading.problem(flat + 1.0, flat + 0j, 1.0)
    u = problem.obstacle.copy()

    def reason(u, within):
        none = np.zeros(u.size)
        state = make_solution(problem, u, none, flat + 0j, spent=(3, 2), within=within)
        assert not state.converged
        return why_not_converged(problem, state, "active_set", 1e-6)

    assert reason(u - 1.0, within=-1.0).startswith("the mean was not kept after 2 iterations of active_set")
    overlapping = u + 1e-9
    assert reason(overlapping, within=-1.0).startswith("the surface overlaps the punch by 1.00e-09 after 2")
    far = u + 1e-3
    assert reason(far, within=1e-6).startswith("residual ")
    assert reason(far, within=1e-6).endswith("after 2 iterations of active_set; the tolerance is 1.00e-06")
    attracting = Config(
        name="x", grid={"points": 64}, interface={"law": "exponential", "work": 1e-3, "range": 0.1}
    )
    law = Case(attracting).contact.loading.problem(flat + 1.0, flat + 0j, 1.0).interface
    assert law.attracts
    state = make_solution(problem, u, np.zeros(u.size), flat + 0j, spent=(3, 2), within=-1.0)
    adhesive = replace(problem, interface=law)
    assert why_not_converged(adhesive, state, "newton", 1e-6).startswith("no minimum of the energy after 2")
