"""Faults of disk, files and processes: reported, recorded, and mended by the same command."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from gfmdlayer.config import Config
from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.execution import case_run
from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.interrupts import Stopped
from gfmdlayer.execution.status import StatusFile, running
from gfmdlayer.execution.sweep import SweepCase
from gfmdlayer.results.reader import attributes, is_complete

SOAK = Path(__file__).parents[2] / "scripts" / "soak.py"
FAULTY = """\
name: faulty
grid: {points: 2048}
time: {end: 0.4, step: 0.01}
output: {snapshots: [0.1, 0.2, 0.3, 0.4]}
solver: {method: active_set}
sweep: {layer.thickness: [0.05, 0.1]}
"""
RUN = ("run", "faulty.yaml", "--out", "out", "--checkpoint-every", "0")
# The command line in a process in which something happens first.
AFTER = "import os, resource, sys\n{}\nfrom gfmdlayer.cli import main\nsys.exit(main(sys.argv[1:]))"
SMALL_DISK = "resource.setrlimit(resource.RLIMIT_FSIZE, ({0}, {0}))"
# Permission is lost at the 20th step; root has it everywhere until it is somebody else.
LOSS = """
from pathlib import Path
from gfmdlayer.execution.status import StatusFile
from gfmdlayer.execution.case_run import prepare
prepare()
advance, calls = StatusFile.advance, iter(range(10**6))
def losing(self, time):
    advance(self, time)
    if next(calls) == 20:
        Path("out/cases").chmod(0o555)
        if os.geteuid() == 0:
            os.seteuid(65534)
StatusFile.advance = losing
"""
KILL = """
import signal
from gfmdlayer.execution.status import StatusFile
advance, calls = StatusFile.advance, iter(range(10**6))
def killed(self, time):
    if next(calls) == 60:
        os.kill(os.getpid(), signal.SIGKILL)
    advance(self, time)
StatusFile.advance = killed
"""

Bits = dict[str, bytes]


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("faulty.yaml").write_text(FAULTY)


def gfmdlayer(after: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", AFTER.format(after), *RUN]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def names(folder: str = "out/cases") -> set[str]:
    return {path.name for path in Path(folder).iterdir()}


@pytest.fixture(scope="module")
def whole() -> dict[str, Bits]:
    """The bits of both cases of a run without a fault, once they have been computed."""
    return {}


@pytest.fixture
def is_mended(
    run_here: Callable[..., Any], bits: Callable[[str], Bits], whole: dict[str, Bits]
) -> Callable[[], str]:
    """Run the rest; return the log. The results are those of a run without a fault."""

    def rerun() -> str:
        summary, log = run_here("faulty.yaml", checkpoint_every=0.0)
        assert summary.count("complete") == 2
        if not whole:
            run_here("faulty.yaml", "whole")
            whole.update({name: bits(f"whole/cases/{name}") for name in ("0000.h5", "0001.h5")})
        assert {name: bits(f"out/cases/{name}") for name in whole} == whole
        return str(log)

    return rerun


def test_a_disk_too_full_for_checkpoints_costs_none_of_the_results() -> None:
    # Without snapshots a case takes 0.13 MB, its state at 8192 points more than 0.5 MB.
    without = FAULTY.replace("snapshots: [0.1, 0.2, 0.3, 0.4]", "snapshots: []")
    Path("faulty.yaml").write_text(without.replace("2048", "8192"))
    process = gfmdlayer(SMALL_DISK.format(300_000))
    assert process.returncode == 0, process.stderr
    assert process.stderr.count("case 0000 continues, but its checkpoint cannot be written") == 1
    assert "Traceback" not in process.stderr
    assert "Exception ignored" not in process.stderr
    assert names() == {".lock", "0000.h5", "0001.h5"}


def test_a_full_disk_is_refused_before_any_work(is_mended: Callable[[], str]) -> None:
    process = gfmdlayer(SMALL_DISK.format(30_000))
    assert process.returncode == 2
    assert "out: cannot be written (File too large" in process.stderr
    assert "Traceback" not in process.stderr
    assert not list(Path("out").rglob("*.part"))
    is_mended()


def test_a_disk_too_full_for_results_fails_the_cases_until_there_is_space(
    is_mended: Callable[[], str],
) -> None:
    process = gfmdlayer(SMALL_DISK.format(120_000))
    assert process.returncode == 1
    assert "cannot be written: File too large" in process.stderr
    assert "Traceback" not in process.stderr
    assert not list(Path("out/cases").glob("*.h5"))
    assert not list(Path("out").rglob("*.part"))
    is_mended()


def test_a_permission_lost_during_the_run_fails_the_cases_until_it_is_back(
    is_mended: Callable[[], str],
) -> None:
    process = gfmdlayer(LOSS)
    assert process.returncode == 1, process.stderr
    assert "cannot be written: Permission denied" in process.stderr
    assert "case 0000 continues, but its checkpoint cannot be written: Permission denied" in process.stderr
    assert "case 0000 FAILED" in process.stderr
    assert "Traceback" not in process.stderr
    assert not list(Path("out").rglob("*.h5"))
    Path("out").chmod(0o755)
    Path("out/cases").chmod(0o755)
    assert "case 0000 goes on from time" in is_mended()
    assert names() == {".lock", "0000.h5", "0001.h5"}


def test_a_truncated_checkpoint_is_set_aside_and_the_case_begins_anew(
    run_here: Callable[..., Any], is_mended: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop_in_the_middle(_: StatusFile, time: float) -> None:
        if time > 0.1:
            raise Stopped

    with monkeypatch.context() as once:
        once.setattr("gfmdlayer.execution.interrupts._Flag.raised", False)  # and again after the block
        once.setattr(StatusFile, "advance", stop_in_the_middle)
        summary, _ = run_here("faulty.yaml", checkpoint_every=0.0)
        assert summary.count("stopped") == 2
    checkpoint = Path("out/cases/0000.checkpoint")
    checkpoint.write_bytes(checkpoint.read_bytes()[:-1000])
    log = is_mended()
    assert "case 0000 begins anew, its checkpoint is set aside: it is damaged" in log
    assert names() >= {"0000.h5", "0001.h5", "0000.checkpoint.aside"}


def test_a_damaged_case_is_set_aside_and_computed_again(
    run_here: Callable[..., Any], is_mended: Callable[[], str]
) -> None:
    run_here("faulty.yaml")
    damaged = Path("out/cases/0001.h5")
    content = damaged.read_bytes()[: damaged.stat().st_size // 2]
    damaged.write_bytes(content)
    before = Path("out/cases/0000.h5").read_bytes()
    assert "case 0001 is damaged: set aside as 0001.h5.aside, computed again" in is_mended()
    assert Path("out/cases/0001.h5.aside").read_bytes() == content
    assert Path("out/cases/0000.h5").read_bytes() == before


def test_a_case_that_raises_is_recorded_and_goes_on_from_its_checkpoint_when_tried_again(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    bits: Callable[[Path], Bits],
) -> None:
    config = Config(name="raises").with_values({"grid.points": 32, "time.end": 0.4, "time.step": 0.1})
    case, folder, whole = SweepCase(3, config, {}), Folder(tmp_path / "out"), Folder(tmp_path / "whole")
    for each in (folder, whole):
        each.cases.mkdir(parents=True)
    case_run.run_case(case, whole)
    solve, calls = ActiveSet.solve, count()

    def exhausted(*given: object) -> object:
        if next(calls) == 3:
            raise MemoryError("no room")
        return solve(*given)  # type: ignore[arg-type]

    with monkeypatch.context() as once:
        once.setattr(ActiveSet, "solve", exhausted)
        outcome = case_run.run_case(case, folder, checkpoint_every=0)
    assert (outcome.state, outcome.reason) == ("failed", "MemoryError: no room")
    assert names() == {"0003.failed", "0003.checkpoint", "0003.journal"}
    assert case_run.run_case(case, folder).state == "complete"
    assert "case 0003 goes on from time" in capsys.readouterr().err
    assert names() == {"0003.h5"}
    assert bits(folder.case(3)) == bits(whole.case(3))


def test_a_clock_that_is_set_back_changes_no_result(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, bits: Callable[[Path], Bits]
) -> None:
    config = Config(name="clock").with_values({"grid.points": 32, "time.end": 0.4, "time.step": 0.01})
    folder, whole = Folder(tmp_path / "out"), Folder(tmp_path / "whole")
    for each in (folder, whole):
        each.cases.mkdir(parents=True)
    case_run.run_case(SweepCase(0, config, {}), whole)
    now, steps = time.time(), count()
    monkeypatch.setattr(time, "time", lambda: now - 3600 * next(steps))
    fractions = []
    advance = StatusFile.advance

    def watched(self: StatusFile, simulated_time: float) -> None:
        advance(self, simulated_time)
        fractions.extend(case.fraction for case in running(folder))

    monkeypatch.setattr(StatusFile, "advance", watched)
    assert case_run.run_case(SweepCase(0, config, {}), folder, checkpoint_every=0).state == "complete"
    assert bits(folder.case(0)) == bits(whole.case(0))
    assert float(str(attributes(folder.case(0))["wall_seconds"])) > 0
    assert fractions  # it was seen to be at work all the time


def test_a_killed_run_leaves_complete_cases_alone_and_the_next_one_resumes(
    is_mended: Callable[[], str],
) -> None:
    gfmdlayer(KILL)
    assert {path.name: is_complete(path) for path in Path("out/cases").glob("*.h5")} == {"0000.h5": True}
    assert {"0001.running", "0001.checkpoint", "0001.journal"} <= names()
    assert "case 0001 goes on from time" in is_mended()
    assert names() == {".lock", "0000.h5", "0001.h5"}


@pytest.mark.slow
def test_a_few_kills_at_random_lose_nothing() -> None:
    given = [sys.executable, str(SOAK), "--only", "kills", "--ways", "forked", "--trials", "2"]
    process = subprocess.run(given, capture_output=True, text=True, timeout=600, check=False)
    assert process.returncode == 0, process.stdout + process.stderr
    assert "| kills | equal | 2 |" in process.stdout
    assert "| compared bit by bit |" in process.stdout
