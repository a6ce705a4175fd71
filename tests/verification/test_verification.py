"""`gfmdlayer verify`: every row lies inside its bound, and a row outside or a failed check is reported."""

import math
import runpy
from pathlib import Path

import pytest

from gfmdlayer.cli import main
from gfmdlayer.verification import CHECKS, verify
from gfmdlayer.verification.rows import Check, Convergence, Row, carry_out

SCRIPT = Path(__file__).parents[2] / "scripts" / "reproduce_paper.py"
OTHER_CODES = {"tamaas", "ContactMechanics"}


def good(_quick):
    """Something that holds.

    It follows from nothing.
    """
    yield Row("one", 1.0, 1.5, 0.5, "a book")
    yield Convergence("step", "a line", (0.1, 0.2, 0.4), (0.01, 0.04, 0.16), 2)


def outside(_quick):
    """Something that does not."""
    yield Row("one", 1.0, 1.5, 0.49, "a | book")


def unknown(_quick):
    """Not a number."""
    yield Row("one", 1.0, math.nan, math.inf, "a book")


def broken(_quick):
    """It does not get that far."""
    yield Row("one", 1.0, 1.0, 0.0, "a book")
    raise ArithmeticError("no answer")


def silent(_quick):
    """Nothing to say."""
    yield from ()


# Those that take more than a second each, and those whose claims the tests of their rooms make, too.
LONG = {"flat_punch", "thin_films", "over_time", "rate_dependence", "peeled_thin_layer"}
LONG |= {"series_of_laws", "leakage", "time_steps", "runs", "yielding"}


@pytest.mark.parametrize(
    ("long", "least"), [(False, 43), pytest.param(True, 50, marks=pytest.mark.slow)], ids=["short", "long"]
)
def test_every_row_of_the_table_is_inside_its_bound(long, least, tmp_path, monkeypatch, capsys):
    checks = tuple(check for check in CHECKS if (check.find.__name__ in LONG) == long)
    monkeypatch.setattr("gfmdlayer.verification.CHECKS", checks)
    monkeypatch.chdir(tmp_path)
    assert main(["verify", "--quick"]) == 0
    shown = capsys.readouterr().out
    assert "OUTSIDE" not in shown
    folder = tmp_path / "results/verification"
    report = (folder / "verification.md").read_text()
    assert report.count("| inside |") == shown.count("  inside\n") >= least
    for picture in () if long else ("points", "step", "tolerance"):
        assert f"({picture}.png)" in report
        assert (folder / f"{picture}.png").read_bytes().startswith(b"\x89PNG")
    parts = report.partition("## Derivation")[0].split("| **")[1:]  # of the checks, in order
    for check, part in zip(checks, parts, strict=True):
        assert part.startswith(check.title)
        assert "| inside |" in part or (check.peer in OTHER_CODES and "not installed" in part)
        assert check.title in shown


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: str(check.find.__name__))
def test_every_check_has_a_title_and_derives_its_bounds(check):
    assert check.title
    assert len(check.derivation) > 40


@pytest.mark.parametrize("find", [outside, unknown, broken, silent])
def test_a_row_outside_its_bound_gives_exit_status_1(find, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("gfmdlayer.verification.CHECKS", (Check("Some", good), Check("Some", find)))
    assert main(["verify", "--out", str(tmp_path / "v")]) == 1
    shown, report = capsys.readouterr().out, (tmp_path / "v" / "verification.md").read_text()
    assert "inside" in shown
    if find in (outside, unknown):
        assert "OUTSIDE" in shown
        assert "1 of 2 rows inside" in shown
    else:
        assert "  failed: " in shown
        assert "1 check failed" in shown
    assert "OUTSIDE" in report


def test_rows_at_their_bounds_are_inside():
    outcome = carry_out(Check("Some", good), quick=True)
    assert outcome.holds
    assert outcome.rows[0].inside
    (curve,) = outcome.curves
    assert curve.fitted == pytest.approx(2.0, rel=1e-12)
    assert curve.row(0.1, "itself").inside


def test_a_code_that_is_not_installed_is_named_and_does_no_harm(tmp_path):
    some = (Check("Some", good), Check("Others", outside, peer="a_module_that_is_not_there"))
    assert verify(tmp_path, checks=some)
    assert "not installed: a_module_that_is_not_there" in (tmp_path / "verification.md").read_text()


def test_two_processes_find_the_same_as_one():
    two = [check for check in CHECKS if check.find.__name__ in {"printed_equation", "relaxing_modes"}]
    found = {1: [], 2: []}
    for jobs, outcomes in found.items():
        assert verify(quick=True, checks=two, jobs=jobs, report=lambda _, each: outcomes.append(each))  # noqa: B023
    assert [each.rows for each in found[1]] == [each.rows for each in found[2]]


def test_a_folder_that_cannot_be_made_is_refused_before_the_work(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["verify", "--out", str(tmp_path / "file" / "v")]) == 2
    assert "cannot be written" in capsys.readouterr().err
    assert main(["verify", "--jobs", "0"]) == 2


@pytest.mark.slow  # that both methods agree is a row of the verification, too
def test_a_figure_of_the_paper_is_reproduced_by_both_methods(tmp_path, capsys):
    reproduce = runpy.run_path(str(SCRIPT))["main"]
    # 0: each case differs by no more than the paper's own step explains.
    assert reproduce(["--quick", "--figures", "3", "--points", "256", "--out", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert "cases inside their bound: 5 of 5" in shown
    assert (tmp_path / "figure3.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "figure3.pdf").read_bytes().startswith(b"%PDF")
