"""`gfmdlayer verify`: what it checks holds, and what does not hold is told."""

from __future__ import annotations

import math
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gfmdlayer.cli import main
from gfmdlayer.verification import runner, verify
from gfmdlayer.verification.rows import Check, Curve, Finding, Row, carry_out
from gfmdlayer.verification.table import CHECKS

SCRIPT = Path(__file__).parents[2] / "scripts" / "reproduce_paper.py"
OTHER_CODES = {"tamaas", "ContactMechanics"}


def good(_quick: bool) -> Iterator[Row | Curve]:
    """Something that holds.

    It follows from nothing.
    """
    yield Row("one", 1.0, 1.5, 0.5, "a book")
    yield Curve("step", "a line", (0.1, 0.2, 0.4), (0.01, 0.04, 0.16), 2)


def outside(_quick: bool) -> Iterator[Row]:
    """Something that does not."""
    yield Row("one", 1.0, 1.5, 0.49, "a | book")


def unknown(_quick: bool) -> Iterator[Row]:
    """Not a number."""
    yield Row("one", 1.0, math.nan, math.inf, "a book")


def broken(_quick: bool) -> Iterator[Row]:
    """It does not get that far."""
    yield Row("one", 1.0, 1.0, 0.0, "a book")
    raise ArithmeticError("no answer")


def silent(_quick: bool) -> Iterator[Row]:
    """Nothing to say."""
    yield from ()


def test_every_row_of_the_table_is_inside_its_bound(tmp_path: Path) -> None:
    found: list[tuple[Check, Finding]] = []
    assert verify(tmp_path, quick=True, told=lambda *each: found.append(each))
    assert [check for check, _ in found] == list(CHECKS)
    assert all(finding.rows or finding.missing in OTHER_CODES for _, finding in found)
    assert sum(len(finding.rows) for _, finding in found) > 60
    report = (tmp_path / "verification.md").read_text()
    for picture in ("points", "step", "tolerance"):
        assert f"({picture}.png)" in report
        assert (tmp_path / f"{picture}.png").read_bytes().startswith(b"\x89PNG")
    for check, _ in found:
        assert check.title in report


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: str(check.find.__name__))
def test_every_check_says_what_it_is_and_how_its_bounds_follow(check: Check) -> None:
    assert check.title
    assert len(check.derivation) > 40


@pytest.mark.parametrize("find", [outside, unknown, broken, silent])
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_row_outside_its_bound_gives_exit_status_1(
    find: Any, jobs: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    checks = (Check("Some", good), Check("Some", find))
    monkeypatch.setattr(verify, "__kwdefaults__", {**verify.__kwdefaults__, "checks": checks})
    monkeypatch.setattr(runner, "ProcessPoolExecutor", _Alone)
    assert main(["verify", "--out", str(tmp_path / "v"), "--jobs", str(jobs)]) == 1
    shown, report = capsys.readouterr().out, (tmp_path / "v" / "verification.md").read_text()
    assert "inside" in shown
    if find in (outside, unknown):
        assert "OUTSIDE" in shown
        assert "1 of 2 rows inside" in shown
    else:
        assert "could not be carried out" in shown
        assert "1 check failed" in shown
    assert "OUTSIDE" in report


class _Alone:
    """An executor without processes: what the tests define has no name elsewhere."""

    def __init__(self, *_: Any) -> None: ...

    def __enter__(self) -> _Alone:
        return self

    def __exit__(self, *_: object) -> None: ...

    def map(self, task: Any, checks: Any) -> Any:
        return map(task, checks)


def test_rows_at_their_bounds_are_inside() -> None:
    finding = carry_out(Check("Some", good), quick=True)
    assert finding.holds
    assert finding.rows[0].state == "inside"
    (curve,) = finding.curves
    assert curve.fitted == pytest.approx(2.0, rel=1e-12)
    assert curve.row(0.1, "itself").state == "inside"


def test_a_code_that_is_not_installed_is_told_and_does_no_harm(tmp_path: Path) -> None:
    checks = (Check("Some", good), Check("Others", outside, peer="a_module_that_is_not_there"))
    assert verify(tmp_path, checks=checks)
    assert "not installed: a_module_that_is_not_there" in (tmp_path / "verification.md").read_text()


def test_processes_find_what_one_finds() -> None:
    checks = [check for check in CHECKS if check.find.__name__ in {"printed_equation", "relaxing_modes"}]
    alone: list[Finding] = []
    together: list[Finding] = []
    assert verify(quick=True, checks=checks, told=lambda _, finding: alone.append(finding))
    assert verify(quick=True, checks=checks, jobs=2, told=lambda _, finding: together.append(finding))
    assert [each.rows for each in alone] == [each.rows for each in together]


def test_a_folder_that_cannot_be_is_refused_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["verify", "--out", str(tmp_path / "file" / "v")]) == 2
    assert "cannot be written" in capsys.readouterr().err
    assert main(["verify", "--jobs", "0"]) == 2


def test_a_figure_of_the_paper_is_reproduced_by_both_methods(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reproduce = runpy.run_path(str(SCRIPT))["main"]
    # 0: each case differs by no more than the paper's own step explains.
    assert reproduce(["--quick", "--figures", "3", "--points", "256", "--out", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert "cases inside their bound: 5 of 5" in shown
    assert (tmp_path / "figure3.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "figure3.pdf").read_bytes().startswith(b"%PDF")
