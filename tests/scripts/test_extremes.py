"""Random extreme cases end converged, or named as not converged; some of the many that `extremes.py` draws.

The mechanics of what is computed, over cases less extreme, is in `tests/contact/test_fuzz_physics.py`.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from typing import Any

import pytest

from gfmdlayer.contact.solvers import SOLVERS

SCRIPT = Path(__file__).parents[2] / "scripts" / "extremes.py"


@pytest.fixture(scope="module")
def extremes() -> dict[str, Any]:
    return runpy.run_path(str(SCRIPT))


def test_the_default_solver_converges(extremes: dict[str, Any]) -> None:
    ends = {index: extremes["outcome"](extremes["draw"](2, index)) for index in range(60)}
    assert {index: end for index, end in ends.items() if end.kind not in extremes["GOOD"]} == {}
    assert sum(end.kind == "converged" for end in ends.values()) > 50


@pytest.mark.parametrize("method", SOLVERS)
def test_every_solver_converges_or_says_that_it_does_not(extremes: dict[str, Any], method: str) -> None:
    for index in range(6):
        end = extremes["outcome"](extremes["draw"](3, index, (method,)))
        assert end.kind in {*extremes["GOOD"], "not converged"}, (index, end)


def test_a_case_follows_from_its_seed(extremes: dict[str, Any]) -> None:
    draw = extremes["draw"]
    assert repr(draw(5, 7)) == repr(draw(5, 7))
    assert repr(draw(5, 7)) != repr(draw(5, 8))
    assert repr(draw(5, 7)) != repr(draw(6, 7))


def test_failures_are_listed_by_kind_with_their_numbers(
    extremes: dict[str, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    outcome, main = extremes["Outcome"], extremes["main"]
    bad = {12: outcome("not converged", "t = 1: residual 1"), 14: outcome("hangs")}
    monkeypatch.setitem(
        main.__globals__,
        "outcome",
        lambda drawn: bad.get(int(drawn.config["name"].split("-")[-1]), outcome("converged")),
    )
    monkeypatch.setattr(sys, "argv", ["extremes.py", "5", "--seed", "4", "--first", "11"])
    assert main() == 1
    said = capsys.readouterr().out
    assert "4 12: active_set not converged: t = 1: residual 1" in said
    assert "| active_set | not converged | 1 | 12 |" in said
    assert "| active_set | hangs | 1 | 14 |" in said
    assert "| active_set | converged | 3 |  |" in said
