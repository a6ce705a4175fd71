"""A sweep's cases are run once, their results kept apart, and nothing of anybody else's is touched."""

import io
import json
import os
import socket
import time
from pathlib import Path

import pytest

from gfmdlayer.case.case import Case
from gfmdlayer.case.model import ConvergenceError
from gfmdlayer.config import load
from gfmdlayer.results.provenance import duration
from gfmdlayer.results.reader import open_results
from gfmdlayer.study import claims
from gfmdlayer.study import progress as reports
from gfmdlayer.study.folder import Folder, FolderError
from gfmdlayer.study.interrupts import Stopped
from gfmdlayer.study.run import RunOptions, run_study
from gfmdlayer.study.workers import assemble
from tests.studies import OTHERS, TINY

SWEEP = "sweep: {layer.thickness: [0.02, 0.1], halfspace.shear_modulus: [1, 2, .inf]}\n"


def configure(text=TINY + SWEEP, *overrides):
    Path("tiny.yaml").write_text(text)
    return load(Path("tiny.yaml"), overrides)


def run(config, directory="out", **options):
    with assemble() as pool:
        assert pool is not None
        return run_study(config, directory, pool, RunOptions(**options))


def forbid_simulating(monkeypatch):
    fail_where(lambda _: True, monkeypatch, AssertionError("this case was complete"))


def fail_where(condition, monkeypatch, error=None):
    """Let the cases of some configurations fail."""
    run_case = Case.run

    def failing(model, *arguments):
        if condition(model.config):
            raise error or ConvergenceError("the residual stays at 1")
        return run_case(model, *arguments)

    monkeypatch.setattr(Case, "run", failing)


def test_a_run_leaves_config_cases_and_sweep():
    config = configure()
    summary = run(config)
    assert summary.count("complete") == 6
    assert load(Path("out/config.yaml")) == config
    assert sorted(path.name for path in Path("out/cases").glob("[0-9]*")) == [
        f"{index:04d}.h5" for index in range(6)
    ]
    with open_results("out") as results:
        assert results["mean_pressure"].sizes == {"thickness": 2, "shear_modulus": 3, "time": 4}
        assert not results["mean_pressure"].isnull().any()


def test_complete_cases_are_not_run_again_and_the_name_may_change(monkeypatch):
    run(configure())
    before = {path: path.read_bytes() for path in Path("out/cases").glob("*.h5")}
    forbid_simulating(monkeypatch)
    for name in ("tiny", "other"):
        assert run(configure(TINY + SWEEP, f"name={name}")).count("complete") == 6
    assert before == {path: path.read_bytes() for path in before}


def test_another_configuration_is_refused_with_the_keys_that_differ():
    run(configure(TINY))
    assert Path("out/sweep.h5").exists()  # also of a single case
    before = Path("out/config.yaml").read_bytes()
    with pytest.raises(FolderError) as caught:
        run(configure(TINY, "layer.thickness=0.2", "punch.radius=0.5"))
    message = str(caught.value)
    assert "layer.thickness: 0.05 -> 0.2; punch.radius: 0.25 -> 0.5" in message
    assert "--out" in message
    assert "--restart" in message
    assert Path("out/config.yaml").read_bytes() == before


def test_restart_removes_earlier_results_and_nothing_else():
    run(configure())
    others = [Path(place, name) for place in ("out", "out/cases") for name in OTHERS]
    for path in others:
        path.write_text("mine")
    run(configure(TINY), restart=True)
    assert [path.read_text() for path in others] == ["mine"] * len(others)
    cases = {path.name for path in Path("out/cases").glob("*.h5")}
    assert cases.difference(OTHERS) == {"0000.h5"}


@pytest.mark.parametrize("restart", [False, True])
@pytest.mark.parametrize("name", ["thesis.tex", "config.yaml", "sweep.h5"])
def test_a_folder_of_something_else_is_refused(name, restart):
    Path("mine").mkdir()
    Path("mine", name).write_text("name: mine\n")
    with pytest.raises(FolderError, match="not a results folder"):
        run(configure(), "mine", restart=restart)
    assert [path.read_text() for path in Path("mine").iterdir()] == ["name: mine\n"]


def test_a_damaged_configuration_of_results_is_named():
    run(configure(TINY))
    path = Path("out/config.yaml")
    path.write_bytes(path.read_bytes().replace(b"# Cases", b"# Cases\xba", 1))
    with pytest.raises(FolderError, match=r"config\.yaml.*UTF-8"):
        run(configure(TINY))
    assert list(Folder(Path("out")).case_numbers()) == [0]


def test_a_configuration_of_results_that_lost_cases_is_named():
    swept = TINY + "sweep: {layer.thickness: [0.02, 0.1]}\n"
    run(configure(swept))
    path = Path("out/config.yaml")
    text = path.read_text()
    path.write_text(text[: text.index("sweep:")])
    with pytest.raises(FolderError, match=r"config\.yaml: names 2 cases, and its sweep has 1; .*--restart"):
        run(configure(swept))


@pytest.mark.parametrize("place", ["file", "file/below", "/proc/gfmdlayer"])
def test_a_folder_that_cannot_be_written_is_refused_before_any_work(monkeypatch, place):
    forbid_simulating(monkeypatch)
    Path("file").write_text("mine")
    with pytest.raises(FolderError, match=r"is a file|cannot be written"):
        run(configure(), place)
    assert Path("file").read_text() == "mine"


def test_what_a_killed_run_left_is_removed():
    names = "0000.running", "0000.h5.host-1-0badcafe.part", "stop-host-1-0badcafe"
    remains = [Path("out/cases", name) for name in names]
    run(configure(TINY))
    for path in remains:
        path.write_text("{}")
    run(configure(TINY))
    assert not any(path.exists() for path in remains)


def test_a_run_killed_in_its_first_instant_is_no_obstacle():
    Path("out/cases").mkdir(parents=True)
    Path("out/config.yaml.host-1-0badcafe.part").write_text("na")
    assert run(configure(TINY)).count("complete") == 1


def test_a_failing_case_is_recorded_and_the_others_go_on(monkeypatch):
    fail_where(lambda config: config.halfspace.shear_modulus == 2, monkeypatch)
    summary = run(configure())
    assert [outcome.index for outcome in summary.failures] == [1, 4]
    assert summary.count("complete") == 4
    record = json.loads(Path("out/cases/0001.failed").read_text())
    assert record["reason"] == "ConvergenceError: the residual stays at 1"
    assert "Traceback" in record["traceback"]
    assert record["values"]["halfspace.shear_modulus"] == 2
    assert record["time"]
    with open_results("out") as results:
        assert results["mean_pressure"].isnull().any("time").values.tolist() == [[False, True, False]] * 2
        assert "0001: ConvergenceError: the residual stays at 1" in results.attrs["failed"]


def test_a_failed_case_is_tried_again_and_alone(monkeypatch):
    with monkeypatch.context() as once:
        fail_where(lambda config: config.halfspace.shear_modulus == 2, once)
        run(configure())
    fail_where(lambda config: config.halfspace.shear_modulus != 2, monkeypatch)
    assert run(configure()).count("complete") == 6
    assert not list(Path("out/cases").glob("*.failed"))
    with open_results("out") as results:
        assert results.attrs["failed"] == ""


def test_only_failed_runs_what_failed_and_leaves_what_waits(monkeypatch):
    with monkeypatch.context() as once:
        fail_where(lambda config: config.halfspace.shear_modulus == 2, once)
        run(configure())
    for waiting in (Path("out/cases/0003.h5"), Path("out/sweep.h5")):
        waiting.unlink()
    summary = run(configure(), only_failed=True)
    assert (summary.count("complete"), summary.count("waiting")) == (5, 1)
    assert sorted(path.name for path in Path("out/cases").glob("*.h5")) == [
        f"{index:04d}.h5" for index in (0, 1, 2, 4, 5)
    ]
    assert not Path("out/sweep.h5").exists()  # a case is still to come
    forbid_simulating(monkeypatch)
    assert run(configure(), only_failed=True).count("waiting") == 1


def test_a_stop_file_stops_a_case_between_steps(tmp_path):
    folder = Folder(tmp_path)
    folder.cases.mkdir()
    with claims.Claim(folder, 7, end=2.0) as file:
        folder.stop.touch()
        file._written -= claims.WRITE_INTERVAL
        with pytest.raises(Stopped):
            file.advance(1.0)
    assert not folder.case(7, "running").exists()


def test_status_files_tell_what_is_alive(tmp_path):
    folder = Folder(tmp_path)
    folder.cases.mkdir()
    here = {"host": socket.gethostname(), "pid": os.getpid()}
    times = {"simulated_time": 1.0, "end": 4.0, "started": time.time(), "updated": time.time()}
    for index, content in enumerate((
        here | times,
        here | times | {"pid": 2**22 + 1},  # above the kernel's largest process number
        {"host": "elsewhere", "pid": 1} | times,
        {"host": "elsewhere", "pid": 1} | times,
    )):  # fmt: skip
        folder.case(index, "running").write_text(json.dumps(content))
    long_ago = time.time() - 2 * claims.SILENCE
    os.utime(folder.case(3, "running"), (long_ago, long_ago))
    folder.case(4, "running").write_text("{")
    assert [(case.index, case.fraction) for case in claims.running(folder)] == [(0, 0.25), (2, 0.25)]


def test_a_log_has_few_lines_with_the_time():
    stream = io.StringIO()
    log = reports.Log(stream)
    progress = reports.Progress(total=4, complete=1, failed=1, seconds_left=61.0)
    for _ in range(1000):
        log.advance(progress)
    assert stream.getvalue() == ""
    log._last -= reports.LOG_INTERVAL
    log.advance(progress)
    stamp, _, text = stream.getvalue().partition("  ")
    assert time.strptime(stamp, "%Y-%m-%d %H:%M:%S")
    assert text == "50%: 1 of 4 complete, 1 failed, 1 min 1 s left\n"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.04, "0.0 s"), (9.96, "10 s"), (59.6, "1 min 0 s"), (3599, "59 min 59 s"), (90000, "1 d 1 h")],
)
def test_durations_are_written_for_people(seconds, text):
    assert duration(seconds) == text
