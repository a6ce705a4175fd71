"""A step that does not converge: the state before it is kept, and the next run goes on from there."""

from dataclasses import replace

import numpy as np
import pytest

from gfmdlayer.case import march
from gfmdlayer.case.march import March
from gfmdlayer.config import Config
from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.study.case_run import run_case
from gfmdlayer.study.cases import SweepCase
from gfmdlayer.study.folder import Folder

SMALL = {"grid.points": 64, "time.end": 1.6, "output.snapshots": [0.4, 0.8, 1.6]}
STEPS = {"fixed": {"time.step": 0.1}, "adaptive": {"time.step": "adaptive", "time.tolerance": 1e-3}}
DEEPEST = 0.005  # half of the ramp's depth


RAMP = 1.0


@pytest.fixture
def step_by_step(monkeypatch):
    """Python's loop takes all steps."""
    monkeypatch.setattr(March, "suits", classmethod(lambda *_: False))


def folder_at(path):
    folder = Folder(path)
    folder.cases.mkdir(parents=True)
    return folder


@pytest.mark.usefixtures("step_by_step")
@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("every", [0.0, np.inf], ids=["every step", "no checkpoint"])
def test_the_next_run_goes_on_from_the_last_accepted_step_with_the_same_bits(
    tmp_path, monkeypatch, bits, steps, every
):
    case = SweepCase(0, Config(name="fails").with_values(SMALL | STEPS[steps]), {})
    whole, folder = folder_at(tmp_path / "whole"), folder_at(tmp_path / "out")
    solve = ActiveSet.solve
    depths = []

    def counted(solver, problem, *given):
        depths.append(-float(problem.obstacle.min()))
        return solve(solver, problem, *given)

    def limited(solver, problem, *given):
        found = counted(solver, problem, *given)  # which changes the memory of the solver
        return replace(found, converged=found.converged and depths[-1] < DEEPEST)

    monkeypatch.setattr(ActiveSet, "solve", counted)
    assert run_case(case, whole).state == "complete"
    total, before = len(depths), int(np.argmax(np.array(depths) >= DEEPEST))
    assert 1 < before < total
    with monkeypatch.context() as once:
        once.setattr(ActiveSet, "solve", limited)
        outcome = run_case(case, folder, checkpoint_every=every)
    assert outcome.state == "failed"
    assert "; state kept at t = " in outcome.reason
    assert folder.case(0, "checkpoint").exists()
    depths.clear()
    assert run_case(case, folder).state == "complete"
    assert len(depths) == total - before
    assert bits(folder.case(0)) == bits(whole.case(0))


@pytest.mark.parametrize("steps", STEPS)
def test_a_step_that_the_compiled_loop_leaves_may_fail_too(tmp_path, monkeypatch, bits, steps):
    case = SweepCase(0, Config(name="fails").with_values(SMALL | STEPS[steps]), {})
    whole, folder = folder_at(tmp_path / "whole"), folder_at(tmp_path / "out")
    assert run_case(case, whole).state == "complete"
    compiled, solve = march.march, ActiveSet.solve

    def shallow(*arguments):
        *others, now, rows, _, moving, sliding = arguments
        deep = now["time"][0] >= 0.4 * RAMP
        # Some steps, and another one that is left.
        reason = march.RARE if deep else compiled(*others, now, rows, 3, moving, sliding)
        return march.RARE if reason == march.GO_ON else reason

    def limited(solver, problem, *given):
        found = solve(solver, problem, *given)
        return replace(found, converged=found.converged and -problem.obstacle.min() < DEEPEST)

    with monkeypatch.context() as once:
        once.setattr(march, "march", shallow)
        once.setattr(ActiveSet, "solve", limited)
        outcome = run_case(case, folder)
    assert outcome.state == "failed"
    assert "; state kept at t = " in outcome.reason
    assert run_case(case, folder).state == "complete"
    assert bits(folder.case(0)) == bits(whole.case(0))


@pytest.mark.usefixtures("step_by_step")
def test_a_first_step_that_fails_leaves_no_state(tmp_path, monkeypatch):
    solve = ActiveSet.solve
    monkeypatch.setattr(ActiveSet, "solve", lambda *given: replace(solve(*given), converged=False))
    folder = folder_at(tmp_path / "out")
    outcome = run_case(SweepCase(0, Config(name="fails").with_values(SMALL | STEPS["fixed"]), {}), folder)
    assert outcome.state == "failed"
    assert "state kept" not in outcome.reason
    assert sorted(path.name for path in folder.cases.iterdir()) == ["0000.failed"]
