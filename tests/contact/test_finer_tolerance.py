"""Contact solved to a finer tolerance where that is within reach."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
import pytest

from gfmdlayer.contact.problem import Problem, Solution, solve_finer
from gfmdlayer.resumable import Stateless

PROBLEM, START = cast(Problem, None), np.zeros(4)


@dataclass
class Reaching(Stateless):
    """Reaches a residual in two iterations, and records each tolerance, limit and start."""

    reached: float
    calls: list[tuple[float, int, float]] = field(default_factory=list)
    starts_from = "displacement"

    def solve(self, _: Problem, start: np.ndarray, tolerance: float, limit: int) -> Solution:
        self.calls.append((tolerance, limit, float(start[0])))
        start += 1.0  # as solvers may
        u, none = np.full(4, tolerance), np.zeros(4)
        state = Solution(u, none, none, none + 0j, 0.0, 0.0, 0.5, self.reached, 3, 2, converged=True)
        return replace(state, converged=self.reached <= tolerance)

    def compile(self) -> None: ...


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
    reached: float, again: list[tuple[float, int, float]], converges: bool, pairs: int
) -> None:
    solver = Reaching(reached)
    found = solve_finer(solver, PROBLEM, START.copy(), 1e-10, 1e-6, 5000)
    assert (found.converged, found.residual, found.transforms) == (converges, reached, pairs)
    assert solver.calls == [(1e-10, 1000, 0.0), *again]


def test_one_solve_suffices_where_no_finer_tolerance_is_needed() -> None:
    solver = Reaching(1e-5)
    assert not solve_finer(solver, PROBLEM, START.copy(), 1e-6, 1e-6, 5000).converged
    assert solver.calls == [(1e-6, 5000, 0.0)]
