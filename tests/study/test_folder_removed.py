"""A folder that somebody removes during a run, or a configuration that is gone from it."""

import shutil
import threading
from pathlib import Path

import pytest

from gfmdlayer.cli import main
from gfmdlayer.study import interrupts
from gfmdlayer.study.case_run import CaseRun
from tests.waiting import until

SWEEP = (
    "name: small\ngrid: {points: 64}\ntime: {end: 0.2, step: 0.1}\ntrajectory: {ramp_time: 0.1}\n"
    "sweep: {layer.thickness: [0.05, 0.1, 0.15, 0.2]}\n"
)


@pytest.fixture
def config(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(interrupts._Flag, "raised", False)
    Path("small.yaml").write_text(SWEEP)


def removing(monkeypatch, target):
    """Have the second case remove a part of the results when it has begun."""
    compute = CaseRun._compute

    def removes(self, *arguments):
        if self.case.index == 1 and target.exists():
            shutil.rmtree(target) if target.is_dir() else target.unlink()
        return compute(self, *arguments)

    monkeypatch.setattr(CaseRun, "_compute", removes)


@pytest.mark.usefixtures("config")
def test_a_run_without_its_folder_ends_and_makes_no_other_one(monkeypatch, capsys):
    with monkeypatch.context() as patched:
        removing(patched, Path("results/small"))
        assert main(["run", "small.yaml"]) == 1
    error = capsys.readouterr().err
    assert error.splitlines()[-1] == (
        "gfmdlayer: results/small: was removed during the run; the same command starts over"
    )
    assert "checkpoint cannot be written" not in error
    assert not Path("results/small").exists()
    interrupts._Flag.raised = False  # as in another process
    assert main(["run", "small.yaml"]) == 0
    assert main(["status", "results/small"]) == 0
    assert "4 complete" in capsys.readouterr().out


@pytest.mark.usefixtures("config")
def test_a_configuration_that_is_gone_is_written_again(monkeypatch):
    with monkeypatch.context() as patched:
        removing(patched, Path("results/small/config.yaml"))
        assert main(["run", "small.yaml"]) == 0
    assert main(["run", "small.yaml"]) == 0


@pytest.mark.usefixtures("config")
def test_an_empty_configuration_is_called_empty(capsys):
    assert main(["run", "small.yaml"]) == 0
    capsys.readouterr()
    Path("results/small/config.yaml").write_text("")
    for command in (["run", "small.yaml"], ["status", "results/small"], ["report", "results/small"]):
        assert main(command) == 2, command
        error = capsys.readouterr().err
        assert "config.yaml is empty" in error
        assert "no config.yaml" not in error


@pytest.mark.usefixtures("config")
def test_a_long_case_notices_it_too(capsys):
    """The claim looks once a second."""
    Path("long.yaml").write_text(
        SWEEP.replace("end: 0.2, step: 0.1", "end: 2000, step: 0.01").partition("sweep")[0]
    )
    running = Path("results/small/cases/0000.running")

    def remove():
        until(lambda: running.exists() and '"steps": 0' not in running.read_text())
        shutil.rmtree("results/small")

    (thread := threading.Thread(target=remove)).start()
    assert main(["run", "long.yaml"]) == 1
    thread.join()
    assert "was removed during the run" in capsys.readouterr().err
    assert not Path("results").exists() or not list(Path("results").iterdir())
