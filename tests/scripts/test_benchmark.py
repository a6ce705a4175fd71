"""The benchmark: its tables are there, and what it counts is possible.  No time is asserted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "benchmark.py"
SOLVERS = {"active_set", "conjugate_gradient", "fire"}


def benchmark(folder: Path, arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(SCRIPT), *arguments.split()],
        cwd=folder,
        env={**os.environ, "XDG_CACHE_HOME": str(folder / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )


def tables(folder: Path, arguments: str) -> dict[str, list[dict[str, Any]]]:
    done = benchmark(folder, f"{arguments} --json found.json --markdown found.md")
    assert done.returncode == 0, done.stderr
    found = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    assert found["machine"].keys() >= {"cpu", "fftw", "numba_version", "git_commit"}
    text = (folder / "found.md").read_text(encoding="utf-8")
    assert text.count("### ") == len(found["tables"])
    assert text.strip() in done.stdout
    return {name: table["rows"] for name, table in found["tables"].items()}


def test_counts_of_each_solver_lie_between_the_floor_and_the_iteration_limit(tmp_path: Path) -> None:
    found = tables(tmp_path, "--only iteration pairs run --points 128 256 --steps 10 --repetitions 1")

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

    assert len(found["ingredients"]) == 6
    for row in found["run"]:
        assert row["pairs"] >= 0.5 * 10
        assert row["run / bare pairs"] > 0


def test_what_every_start_and_inertia_of_fire_costs_agrees_with_the_run_itself(tmp_path: Path) -> None:
    found = tables(tmp_path, "--only pairs --points 128 --steps 8")
    (fire,) = (row for row in found["pairs"] if row["solver"] == "fire")
    (same,) = (
        row
        for row in found["ingredients"]
        if (row["inertia"], row["start"]) == ("mass_weighted", "quadratic")
    )
    assert same["all"] == fire["all"]


def test_error_falls_with_work_by_the_order_of_the_integrator(tmp_path: Path) -> None:
    found = tables(tmp_path, "--only work --points 64 --steps 80 --plot work.png")
    assert (tmp_path / "work.png").stat().st_size > 0
    rows = found["work-64"]
    assert {row["solver"] for row in rows} == SOLVERS
    assert {row["integrator"] for row in rows} == {"backward_euler", "exponential", "adaptive"}
    for solver in SOLVERS:
        error = {
            (row["integrator"], row["step or tolerance"]): row["error"]
            for row in rows
            if row["solver"] == solver
        }
        # First order: a fifth of the step leaves a fifth of the error; the solver's 1e-6 is far below.
        assert error["backward_euler", 0.1] / error["backward_euler", 0.02] == pytest.approx(5, rel=0.2)
        assert error["exponential", 0.02] < 0.1 * error["backward_euler", 0.02]


def test_a_rough_surface_is_run_on_each_grid(tmp_path: Path) -> None:
    found = tables(tmp_path, "--only rough --points 32 64 --steps 3 --repetitions 1")
    assert [row["grid"] for row in found["rough-layer"]] == ["32 x 32", "64 x 64"]
    for row in found["rough-layer"]:
        assert row["FFT pairs a step"] >= 2
        assert row["run / bare pairs"] > 0


def test_overhead_is_told_of_every_case_on_one_rank_and_two(tmp_path: Path) -> None:
    rows = tables(tmp_path, "--only overhead --cases 12")["overhead"]
    assert [(row["ranks"], row["cases"]) for row in rows] == [(1, 12), (2, 12)]
    for row in rows:
        assert 12 / row["ranks"] <= row["of the fullest rank"] <= 12
        assert row["overhead / case [ms]"] > row["start-up / case [ms]"] > 0
        assert row["solves / case [ms]"] > 0


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("--only speed", "invalid choice: 'speed'"),
        ("--points 0", "0: must be 1 or more"),
        ("--plot work.doc", "work.doc: cannot be drawn"),
        ("--json nowhere/found.json", "there is no folder nowhere"),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_measured(
    tmp_path: Path, arguments: str, complaint: str
) -> None:
    done = benchmark(tmp_path, arguments)
    assert done.returncode == 2
    assert complaint in done.stderr
    assert "measuring" not in done.stderr
