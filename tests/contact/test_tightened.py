"""Contact solved more precisely than asked for, as far as that goes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
import pytest

from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.contact.tightened import tightened
from gfmdlayer.resumable import CompositeState

PROBLEM = cast(Problem, None)
START = np.zeros(4)


@dataclass
class Reaching(CompositeState):
    """Reaches a residual in two iterations, and records from where."""

    within: float
    reached: float
    starts: list[np.ndarray] = field(default_factory=list)
    starts_from = "displacement"

    def __post_init__(self) -> None:
        super().__init__()

    def solve(self, _: Problem, start: np.ndarray) -> Solution:
        self.starts.append(start.copy())
        start += 1.0  # as solvers may
        u = np.full(4, self.within)
        none = np.zeros(4)
        state = Solution(u, none, none, none + 0j, 0.0, 0.0, 0.5, self.reached, 3, 2, converged=True)
        return replace(state, converged=self.reached <= self.within)


@pytest.mark.parametrize(
    ("reached", "begins", "converges", "pairs"),
    [
        (1e-12, [], True, 3),  # the finer tolerance
        (1e-8, [1e-10], True, 6),  # the given one: from the state of the first solve
        (1e-5, [0.0], False, 6),  # none: from the first guess again
    ],
)
def test_what_the_finer_tolerance_leaves_is_solved_to_the_given_one(
    reached: float, begins: list[float], converges: bool, pairs: int
) -> None:
    made: list[Reaching] = []

    def make(within: float, iterations: int) -> Any:
        assert iterations <= 5000
        made.append(Reaching(within, reached))
        return made[-1]

    solver = tightened(make, 1e-6, 5000, 1e-10)
    given, tight = sorted(made, key=lambda each: -each.within)
    found = solver.solve(PROBLEM, START.copy())
    assert (found.converged, found.residual, found.transforms) == (converges, reached, pairs)
    assert [start.tolist() for start in tight.starts] == [START.tolist()]
    assert [start.tolist() for start in given.starts] == [[value] * 4 for value in begins]


def test_a_tolerance_that_is_fine_enough_needs_one_solver() -> None:
    made: list[tuple[float, int]] = []
    tightened(lambda *given: cast(Any, made.append(given)), 1e-6, 5000, 1e-6)
    assert made == [(1e-6, 5000)]
