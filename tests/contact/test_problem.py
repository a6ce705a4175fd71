"""What is said of a step that has no solution."""

from __future__ import annotations

import dataclasses

import numpy as np

from gfmdlayer.config import Config
from gfmdlayer.contact.problem import make_solution, why_not_converged
from gfmdlayer.periodic import Case


def test_a_state_within_the_tolerance_is_refused_for_its_true_reason() -> None:
    case = Case(Config(name="x", grid={"points": 64}, trajectory={"depth": 0.01}))
    flat = np.zeros(case.grid.wavenumbers.shape)
    problem = case.loading.problem(flat + 1.0, flat + 0j, 1.0)
    u = problem.obstacle.copy()

    def said(u: np.ndarray, within: float) -> str:
        none = np.zeros(u.size)
        state = make_solution(problem, u, none, flat + 0j, spent=(3, 2), within=within)
        assert not state.converged
        return why_not_converged(problem, state, "active_set", 1e-6)

    assert said(u - 1.0, within=-1.0).startswith("the mean was not kept after 2 iterations of active_set")
    overlapping = u + 1e-9
    assert said(overlapping, within=-1.0).startswith("the surface overlaps the punch by 1.00e-09 after 2")
    far = u + 1e-3
    assert said(far, within=1e-6).startswith("residual ")
    assert said(far, within=1e-6).endswith("after 2 iterations of active_set; the tolerance is 1.00e-06")
    attracting = Config(
        name="x", grid={"points": 64}, interface={"law": "exponential", "work": 1e-3, "range": 0.1}
    )
    law = Case(attracting).loading.problem(flat + 1.0, flat + 0j, 1.0).interface
    assert law.attracts
    state = make_solution(problem, u, np.zeros(u.size), flat + 0j, spent=(3, 2), within=-1.0)
    adhesive = dataclasses.replace(problem, interface=law)
    assert why_not_converged(adhesive, state, "newton", 1e-6).startswith("no minimum of the energy after 2")
