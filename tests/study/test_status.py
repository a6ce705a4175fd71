"""The state of a sweep from the names of many files and the contents of few; files of dead runs."""

import builtins
import contextlib
import fcntl
import io
import json
import os
import pty
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gfmdlayer.cli import main
from gfmdlayer.config import Config, load
from gfmdlayer.study import claims
from gfmdlayer.study.cases import Cases
from gfmdlayer.study.claims import Claim, leftovers, running
from gfmdlayer.study.folder import Folder, FolderError
from gfmdlayer.study.growth import opened
from gfmdlayer.study.status import RECORDS_READ, overview

Make = Callable[..., Folder]


@pytest.fixture
def make(tmp_path):
    """Make the results folder of a sweep of so many cases, with files of these numbers and kinds in it."""

    def make(total, **files):
        folder = Folder(tmp_path / "out")
        config = Config(name="many", sweep={"layer.thickness": [0.1 + i / 1e5 for i in range(total)]})
        with opened(folder, Cases(config)):
            pass
        for kind, indices in files.items():
            for index in indices:
                folder.case(index, kind).touch()
        return folder

    return make


@pytest.fixture(autouse=True)
def short_patience(monkeypatch):
    """What is refused after ten seconds is so after one."""
    monkeypatch.setattr(claims, "PATIENCE", 1.0)


def fail(folder, index, reason):
    record = {"reason": reason, "values": {"layer.thickness": 0.1}}
    folder.case(index, "failed").write_text(json.dumps(record))


def run_here(folder, index, **more):
    me = {"host": socket.gethostname(), "pid": os.getpid()}
    times = {"simulated_time": 2.0, "end": 8.0, "started": time.time() - 50, "updated": time.time()}
    folder.case(index, "running").write_text(json.dumps(me | times | more))


def told(capsys, *arguments):
    assert main([*arguments]) == 0
    return capsys.readouterr().out.splitlines()


def test_few_files_are_opened_for_a_thousand_cases(make, monkeypatch):
    folder = make(1_000, h5=range(900), failed=range(900, 905))
    run_here(folder, 910)
    opened = []

    def counting(file, *rest, **options):
        if not str(file).startswith("/proc"):
            opened.append(str(file))
        return io.open(file, *rest, **options)  # noqa: UP020 - the one that is not replaced

    monkeypatch.setattr(builtins, "open", counting)
    monkeypatch.setattr(Path, "open", lambda self, *rest, **options: counting(self, *rest, **options))
    seen = overview(folder)
    assert (seen.total, seen.complete, seen.failed, seen.waiting) == (1_000, 900, 5, 94)
    # The mark of the folder, number of cases, one case at work, five failures, warnings; of the results none.
    assert 7 <= len(opened) <= 9
    assert not [name for name in opened if name.endswith(".h5")]


def test_the_configuration_of_a_long_sweep_is_not_read_for_its_number_of_cases(make):
    folder = make(300)
    text = folder.config.read_text()
    head = "".join(text.splitlines(keepends=True)[:2])
    assert "# Cases: 300\n" in head
    folder.config.write_text(head + "cut off")
    assert overview(folder).total == 300
    folder.config.write_text(text.replace("# Cases: 300\n", ""))  # a folder of an earlier version
    assert overview(folder).total == 300


def test_status_imports_nothing_heavy(make):
    folder = make(3, h5=range(2))
    script = (
        "import sys; from gfmdlayer.cli import main; main(['status', sys.argv[1]]); "
        "print([name for name in ('numpy', 'scipy', 'h5py', 'numba', 'rich') if name in sys.modules])"
    )
    command = [sys.executable, "-c", script, str(folder.path)]
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert shown == ["3 cases: 2 complete, 0 running, 0 failed, 1 waiting", "[]"]


def test_cases_at_work_are_told_with_host_step_and_time_left(make, capsys):
    folder = make(3)
    # From time 0.5 to 2 in 30 seconds: 6 more will take 120.
    since = {"since": time.time() - 30, "since_time": 0.5, "steps": 40, "label": "thickness = 0.1"}
    run_here(folder, 1, **since)
    (_, line) = told(capsys, "status", str(folder.path))
    assert line.startswith(f"  0001 running on {socket.gethostname()} (process {os.getpid()}): step 40, ")
    assert line.endswith("time 2 of 8, 2 min 0 s left  thickness = 0.1")


def test_the_status_file_tells_steps_and_pace(make):
    folder = make(1)
    with Claim(folder, 0, end=8.0, label="thickness = 0.1") as status:
        (begun,) = running(folder)
        assert (begun.steps, begun.seconds_left) == (0, None)
        for simulated_time in (6.0, 6.5, 7.0):  # taken up at 6: what went before says nothing of the pace
            status._written = -float("inf")
            time.sleep(0.02)
            status.advance(simulated_time)
        (case,) = running(folder)
    assert (case.steps, case.label, case.simulated_time) == (3, "thickness = 0.1", 7.0)
    assert case.since_time == 6.0
    # As long for the last 1 as for the 1 before, which took two pauses.
    assert case.seconds_left == pytest.approx(case.updated - case.since, rel=1e-9)
    assert case.seconds_left >= 0.04


def test_few_failures_are_told_one_by_one_and_many_by_their_reasons(make, capsys):
    folder = make(100)
    fail(folder, 7, "MemoryError: no")
    lines = told(capsys, "status", str(folder.path))
    assert lines[1:] == ["  0007 failed: MemoryError: no  thickness = 0.1"]
    for index in range(10, 60):
        fail(folder, index, f"ConvergenceError: t = 0.{index}: residual {index}.5e-03 after 9 iterations")
    lines = told(capsys, "status", str(folder.path))
    assert lines == [
        "100 cases: 0 complete, 0 running, 51 failed, 49 waiting",
        "  50 failed like 0010: ConvergenceError: t = 0.10: residual 10.5e-03 after 9 iterations",
        "  1 failed like 0007: MemoryError: no",
    ]


def test_complete_cases_say_why_they_ended_early(make, capsys):
    folder = make(3, h5=range(1), failed=range(1, 2))
    for index in range(3):  # the records of cases that are computed again do not count
        record = {"reason": "PULLED OFF at t = 3", "values": {"layer.thickness": 0.1}}
        folder.case(index, "ended").write_text(json.dumps(record))
    lines = told(capsys, "status", str(folder.path))
    assert lines[0] == "3 cases: 1 complete, 0 running, 1 failed, 1 waiting"
    assert lines[2:] == ["  0000 complete: PULLED OFF at t = 3  thickness = 0.1"]


def test_of_very_many_failures_some_are_read(make):
    folder = make(RECORDS_READ + 500, failed=range(RECORDS_READ + 500))
    seen = overview(folder)
    assert (seen.failed, len(seen.failures)) == (RECORDS_READ + 500, RECORDS_READ)


def test_a_watch_ends_when_nothing_is_left_to_wait_for(make, monkeypatch):
    monkeypatch.setattr("gfmdlayer.cli.folders.WATCH_INTERVAL", 0.01)
    folder = make(3, h5=range(1))
    shown = io.StringIO()
    monkeypatch.setattr(sys, "stdout", shown)

    looks = iter((lambda: None, lambda: None, lambda: folder.case(1).touch(), lambda: folder.case(2).touch()))
    monkeypatch.setattr("gfmdlayer.cli.folders.time.sleep", lambda _: next(looks)())
    assert main(["status", str(folder.path), "--watch"]) == 0
    # A file gets a line for every change, and none where nothing has changed.
    assert [
        line.partition("cases: ")[2].partition(" complete")[0] for line in shown.getvalue().splitlines()
    ] == ["1", "2", "3"]


def test_a_watch_on_a_terminal_is_left_by_ctrl_c(make):
    folder = make(3, h5=range(1))
    command = [sys.executable, "-m", "gfmdlayer", "status", str(folder.path), "--watch"]
    keyboard, screen = pty.openpty()
    environment = os.environ | {"TERM": "xterm-256color", "COLUMNS": "120"}
    with open(keyboard, "rb", buffering=0) as terminal:  # noqa: PTH123 - a descriptor
        process = subprocess.Popen(command, stdout=screen, stderr=subprocess.PIPE, env=environment)
        shown = b""
        while b"2 waiting" not in shown:
            shown += terminal.read(65536)
        process.send_signal(2)
        _, errors = process.communicate(timeout=120)
        os.close(screen)
    assert (process.returncode, errors) == (0, b"")


def test_an_interrupt_that_is_dropped_on_the_way_still_ends_a_watch(make, monkeypatch):
    """Python reports an exception that strikes a destructor, and goes on."""
    folder, shown = make(3, h5=range(1)), io.StringIO()
    monkeypatch.setattr(sys, "stdout", shown)

    def struck(_):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("gfmdlayer.cli.folders.time.sleep", struck)
    before = signal.getsignal(signal.SIGINT)
    assert main(["status", str(folder.path), "--watch"]) == 0
    assert "1 complete" in shown.getvalue()
    assert signal.getsignal(signal.SIGINT) is before


# --- clean ---

LEFT = (
    *(f"cases/{name}.node-12-0badcafe.part" for name in ("0000.h5", "0001.failed", "0002.running", "probe")),
    *("cases/0002.running", "cases/stop-node-12-0badcafe", "cases/0000.checkpoint", "cases/0000.snapshots"),
    *("cases/stop", "cases/stop-1-of-4", "cases/.lock-1-of-4", "cases/.turn"),  # of the version before
    *("config.yaml.node-12-0badcafe.part", "sweep.h5.node-12-0badcafe.part"),
)
KEPT = (
    *("config.yaml", "sweep.h5", "cases/0000.h5", "cases/0001.failed", "cases/0001.checkpoint"),
    "cases/0000.ended",
    *("cases/0001.journal1", "cases/stop-me", "cases/0003.h5.aside", "cases/.lock"),
    *("notes.part", "figure.png", "cases/notes.part", "cases/0000.txt", "cases/stop.txt", "cases/3.running"),
)


@pytest.fixture
def littered(make):
    folder = make(4)
    for name in {*LEFT, *KEPT} - {"config.yaml"}:
        (folder.path / name).touch()
    return folder


def names(folder):
    return {str(path.relative_to(folder.path)) for path in folder.path.rglob("*") if path.is_file()}


def test_clean_removes_what_dead_runs_left_and_nothing_else(littered, capsys):
    lines = told(capsys, "clean", str(littered.path), "--yes")
    assert names(littered) == set(KEPT)
    assert {line.strip() for line in lines[1:-1]} == set(LEFT)
    assert lines[-1] == f"removed {len(LEFT)} files"
    assert told(capsys, "clean", str(littered.path), "--yes") == ["no unfinished files of killed runs"]


def test_clean_asks_nobody_who_is_not_there(littered):
    command = [sys.executable, "-m", "gfmdlayer", "clean", str(littered.path)]
    process = subprocess.run(command, input="y\n", capture_output=True, text=True, check=False)
    assert process.returncode == 2
    assert "--yes" in process.stderr
    assert names(littered) == {*LEFT, *KEPT}


@pytest.mark.parametrize(("answer", "kept"), [("y", KEPT), ("n", (*LEFT, *KEPT)), ("", (*LEFT, *KEPT))])
def test_clean_removes_only_after_a_yes(littered, monkeypatch, answer, kept):
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(builtins, "input", lambda _: answer)
    assert main(["clean", str(littered.path)]) == 0
    assert names(littered) == set(kept)


@pytest.mark.parametrize("kind", [fcntl.LOCK_EX, fcntl.LOCK_SH])
def test_clean_touches_nothing_while_a_run_holds_the_folder(littered, capsys, kind):
    with (littered.cases / ".lock").open() as held:
        fcntl.flock(held, kind)
        assert main(["clean", str(littered.path), "--yes"]) == 2
    assert "another run is writing here" in capsys.readouterr().err
    assert names(littered) == {*LEFT, *KEPT}


def test_clean_touches_nothing_while_a_case_elsewhere_tells_of_itself(littered):
    """Where a file system has no locks, the status files of other hosts have to do."""
    run_here(littered, 2, host="elsewhere")
    with pytest.raises(FolderError, match="writing here, on elsewhere"), leftovers(littered):
        pass
    os.utime(littered.case(2, "running"), (time.time() - 1000,) * 2)
    with leftovers(littered) as found:
        assert littered.case(2, "running") in found


def test_no_run_begins_while_the_question_is_open(littered):
    with (
        leftovers(littered),
        pytest.raises(FolderError, match="another run"),
        opened(littered, Cases(load(littered.config))),
    ):
        pass


def test_clean_refuses_other_folders(tmp_path, capsys):
    (tmp_path / "stop").touch()
    assert main(["clean", str(tmp_path), "--yes"]) == 2
    assert "not a results folder" in capsys.readouterr().err
    assert (tmp_path / "stop").exists()


def test_warnings_of_complete_cases_are_seen_before_the_sweep_is_collected(make):
    """Of those that are the same once, whatever was computed again."""
    folder = make(5, h5=[3, 4])
    for _ in range(2):
        folder.add_warnings(3, ["COARSE: few points", "COARSE: few points", "UNBALANCED: much"])
    folder.add_warnings(4, [])
    assert overview(folder).warnings == ["case 0003: COARSE: few points", "case 0003: UNBALANCED: much"]
