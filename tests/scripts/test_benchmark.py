"""The benchmark: its tables are there, and its counts are possible. No time is asserted."""

import json
import runpy
from pathlib import Path

import pytest

from gfmdlayer import bonded_layer, halfspace

SCRIPTS = Path(__file__).parents[2] / "scripts"
SOLVERS = {"active_set", "conjugate_gradient", "fire"}


@pytest.fixture
def benchmark(monkeypatch):
    """Run the benchmark in this process."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    main = runpy.run_path(str(SCRIPTS / "benchmark.py"))["main"]
    return lambda arguments: main(arguments.split())


@pytest.fixture
def tables(benchmark, tmp_path, capsys):
    """Run the benchmark and return the rows of each of its tables."""

    def tables(arguments):
        benchmark(f"{arguments} --json {tmp_path}/found.json --markdown {tmp_path}/found.md")
        found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
        assert found["machine"].keys() >= {"cpu", "fftw", "numba_version", "git_commit"}
        text = (tmp_path / "found.md").read_text(encoding="utf-8")
        assert text.count("### ") == len(found["tables"])
        assert text.strip() in capsys.readouterr().out
        return {name: table["rows"] for name, table in found["tables"].items()}

    return tables


def test_counts_of_each_solver_lie_between_the_floor_and_the_iteration_limit(tables):
    found = tables("--only iteration pairs whole_run --points 128 256 --steps 10 --repetitions 1")

    assert {(row["inertia"], row["n"]) for row in found["iteration"]} == {
        (inertia, n) for inertia in ("mass-weighted", "uniform") for n in (128, 256)
    }
    assert all(row["iteration / bare pairs"] > 0 for row in found["iteration"])

    assert {(row["solver"], row["n"]) for row in found["pairs"]} == {
        (s, n) for s in SOLVERS for n in (128, 256)
    }
    for row in found["pairs"]:
        # Half a pair for the surface without pressure is the least; a step fails after 20 000 iterations.
        assert 0.5 <= row["ramp"] <= row["most"] <= 40_000
        assert row["hold"] is None  # ten steps do not reach it
        assert row["all"] == row["ramp"]
        assert 0 <= row["largest residual"] <= 1e-6

    # FIRE with the first guess and inertia of a run takes the pairs of the run.
    assert len(found["ingredients"]) == 4
    (same,) = (
        row
        for row in found["ingredients"]
        if (row["inertia"], row["start"]) == ("mass_weighted", "straight line")
    )
    (fire,) = (row for row in found["pairs"] if (row["solver"], row["n"]) == ("fire", 256))
    assert same["all"] == fire["all"]

    for row in found["whole_run"]:
        assert row["pairs"] >= 0.5 * 10
        assert row["run / bare pairs"] > 0


def test_contacts_with_friction_are_counted_on_grids_of_their_own(tables):
    (row,) = tables("--only pairs --points 1024 --steps 1")["friction"]
    assert row["contact"] == "rolling cylinder"
    assert row["converged"] == "True"
    assert 0 < row["step"] <= row["most"] < row["first solve"]


def test_a_rough_surface_is_run_on_each_grid(tables, monkeypatch):
    some = [("halfspace", halfspace(1.0)), ("a film", bonded_layer(0.02, 5.0, halfspace=1.0))]
    monkeypatch.setattr("benchmarks.rough.bodies", lambda: iter(some))  # of 37
    found = tables("--only rough --points 32 64 --steps 3 --repetitions 1")
    assert [row["grid"] for row in found["rough-layer"]] == ["32 x 32", "64 x 64"]
    for row in found["rough-layer"]:
        assert row["FFT pairs a step"] >= 2
        assert row["run / bare pairs"] > 0
    for row in found["rough-cold-64"]:
        assert all(len(row[area].split("/")) == 3 for area in ("5%", "15%", "40%", "80%"))


@pytest.mark.slow  # loops are compiled anew
def test_ablation_compares_each_ingredient_with_the_full_method(tables):
    found = tables("--only ablation --points 512 --steps 4 --repetitions 1")
    for name in ("ablation", "ablation-nested", "ablation-fire", "ablation-adaptive"):
        full, *without = found[f"{name}-pairs"]
        assert [row["taken out"] for row in without] == [row["taken out"] for row in found[f"{name}-time"]]
        assert all(isinstance(full[workload], int) for workload in full.keys() - {"taken out"})
        assert all(without[0].keys() == row.keys() == full.keys() for row in without)
    by_name = {row["taken out"]: row for row in found["ablation-pairs"]}
    assert by_name["preconditioner"]["figure2 adaptive"] > 1
    for name in ("ablation", "ablation-adaptive"):  # each ingredient is really taken out
        full, *without = found[f"{name}-pairs"]
        errors = {row["taken out"]: row for row in found.get(f"{name}-error", ())}
        whole = errors.get("full method")
        for row in without:
            changed = [row[workload] != 1 for workload in full.keys() - {"taken out"}]
            assert any(changed) or errors[row["taken out"]] != whole | {"taken out": row["taken out"]}
    uniform = found["ablation-fire-pairs"][1]
    assert uniform["n = 512"] > 1
    exact, linear, *_ = found["ablation-adaptive-error"]
    # Without the curvature the history is of a lower order.
    assert 0 < exact["figure2"] < linear["figure2"]


@pytest.mark.slow  # benchmark.py --quick, of each change, runs this too
def test_overhead_counts_every_case_on_one_rank_and_two(tables):
    rows = tables("--only overhead --cases 12")["overhead"]
    assert [(row["ranks"], row["cases"]) for row in rows] == [(1, 12), (2, 12)]
    for row in rows:
        assert 12 / row["ranks"] <= row["of the fullest rank"] <= 12
        assert row["overhead / case [ms]"] > row["start-up / case [ms]"] > 0
        assert row["steps / case [ms]"] > 0


@pytest.mark.slow  # benchmark.py --quick, of each change, runs this too
def test_a_sweep_is_run_by_both_time_loops_and_in_two_processes(tables):
    found = tables("--only sweep --cases 2 --points 256 --repetitions 1")
    compiled, in_python = found["sweep-loops"]
    for row in (compiled, in_python):
        assert 200 <= row["rows"] <= row["attempts"] < row["FFT pairs"]
        assert row["a case [ms]"] > 0
    assert compiled["bytes"] == in_python["bytes"] > 200 * 17 * 8  # numbers of 8 bytes
    assert compiled["Python calls"] < in_python["Python calls"] / 4
    assert in_python["over the loop in Python"] == 1
    ways = [row[""] for row in found["sweep-processes"]]
    assert ways == ["one process", "jobs=2", "two ranks"][: len(ways)]
    assert [row["contact"] for row in found["sweep-runs"]] == ["line 256", "smooth 64 x 64", "rough 64 x 64"]
    assert all(row["run / bare pairs"] > 1 for row in found["sweep-runs"])
    assert "sweep-against" not in found


@pytest.mark.slow  # two processes begin, and all tasks run
def test_a_sweep_is_compared_with_another_checkout(tables):
    root = Path(__file__).parents[2]
    rows = tables(f"--only sweep --cases 2 --points 256 --repetitions 1 --against {root}")["sweep-against"]
    assert [row["task"] for row in rows][:5] == [
        "sweep 2",
        "run, 29 rows",
        "run, 1 step",
        "solve 256",
        "solve 64 x 64",
    ]
    assert all(row["ratio"] == pytest.approx(row["clock [ms]"] / row["before [ms]"]) for row in rows)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("--only speed", "invalid choice: 'speed'"),
        ("--points 0", "0: must be 1 or more"),
        ("--json nowhere/found.json", "no folder nowhere"),
        ("--against nowhere", "--against nowhere: no checkout of gfmdlayer"),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_measured(arguments, complaint, benchmark, capsys):
    with pytest.raises(SystemExit, match="2"):
        benchmark(arguments)
    errors = capsys.readouterr().err
    assert complaint in errors
    assert "measuring" not in errors


def test_help_lists_every_section(benchmark, capsys):
    with pytest.raises(SystemExit, match="0"):
        benchmark("--help")
    shown = capsys.readouterr().out
    for section in (SCRIPTS / "benchmarks").glob("*.py"):
        if "def measure(" in section.read_text(encoding="utf-8"):
            assert f"    {section.stem} " in shown


def test_tables_that_are_done_are_printed_and_written_when_a_later_one_fails(
    benchmark, monkeypatch, tmp_path, capsys
):
    monkeypatch.setattr("benchmarks.rough.NestedGradient", lambda *_: 1 / 0)  # which the second table takes
    with pytest.raises(ZeroDivisionError):
        benchmark(f"--only rough --points 32 --steps 1 --repetitions 1 --json {tmp_path}/found.json")
    assert "### " in capsys.readouterr().out
    assert json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))["tables"]
