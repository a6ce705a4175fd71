"""A results folder where others may write: no link is followed, no forged file ends or steers a command."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gfmdlayer.cli import main
from gfmdlayer.config import Config
from gfmdlayer.files.locks import born, no_link, printable
from gfmdlayer.files.whole import write_text
from gfmdlayer.results.reader import is_complete
from gfmdlayer.results.recording import Recording
from gfmdlayer.study.claims import Running, running
from gfmdlayer.study.folder import Folder, FolderError
from gfmdlayer.study.schedule import Outcome, Schedule
from gfmdlayer.study.workers import alone

SMALL = Config(name="small").with_values({"grid.points": 32, "time.end": 0.3, "time.step": 0.1})
ESCAPE = "\x1b]0;forged\x07\x1b[2J"


@pytest.fixture(autouse=True)
def file_of_others():
    Path("precious").write_text("precious")


def test_locks_are_not_taken_through_links(run_here):
    Path("out/cases").mkdir(parents=True)
    Path("out/cases/.lock").symlink_to(Path("precious").absolute())
    with pytest.raises((FolderError, OSError), match="is a symbolic link"):
        run_here(SMALL)
    assert Path("precious").read_text() == "precious"


def test_nothing_is_written_through_a_link(monkeypatch, run_here):
    """Not even where the random part of an unfinished name is guessed."""
    monkeypatch.setattr("gfmdlayer.files.whole.secrets.token_hex", lambda _: "0badcafe")
    guessed = f"{socket.gethostname()}-{os.getpid()}-0badcafe.part"
    Path("out/cases").mkdir(parents=True)
    for name in ("config.yaml", "cases/probe", "cases/0000.running", "cases/0000.xdmf", "sweep.h5"):
        Path(f"out/{name}.{guessed}").symlink_to(Path("precious").absolute())
    with pytest.raises(FolderError, match="File exists"):
        run_here(SMALL)
    with pytest.raises(FileExistsError):
        write_text(Path("out/config.yaml"), "text")
    assert Path("precious").read_text() == "precious"


def test_a_request_to_stop_and_snapshots_follow_no_link(monkeypatch):
    folder = Folder(Path("out"))
    folder.cases.mkdir(parents=True)
    folder.stop.symlink_to(Path("made").absolute())
    monkeypatch.setattr("gfmdlayer.study.schedule.stop_requested", lambda: True)
    monkeypatch.setattr("gfmdlayer.study.schedule.request_stop", lambda: None)
    snapshots = folder.case(0, "snapshots")
    snapshots.symlink_to(Path("precious").absolute())
    with alone() as pool:
        schedule = Schedule(pool, lambda case: Outcome(case.index, "stopped"), folder, lambda _: None)
        assert list(schedule.run([Outcome(0, "waiting")])) == [Outcome(0, "stopped")]
    assert not Path("made").exists()
    with pytest.raises(ValueError, match="is a symbolic link"):
        Recording(snapshots).go_on(
            {"widths": {}, "fields": {}, "size": 64, "checksum": 0}, {"recording.times": np.zeros(0)}
        )
    with pytest.raises(OSError, match="is a symbolic link"), open(snapshots, "w", opener=no_link):
        pass
    assert Path("precious").read_text() == "precious"


RECORDS = {
    "escapes": {"host": ESCAPE, "label": ESCAPE, "reason": ESCAPE, "values": {ESCAPE: ESCAPE}},
    "types": {"pid": "x", "end": [1], "label": 3, "reason": {"a": 1}, "values": [1]},
    "large": {"pid": 10**30, "simulated_time": 1e300, "steps": 10**30, "values": {"a": 10**400}},
    "not finite": {"simulated_time": float("nan"), "since": float("inf"), "end": float("-inf")},
    "no mapping": [1, 2],
}


@pytest.mark.parametrize("forged", [*RECORDS, "deep", "pipe", "no text", "many cases", "far cases"])
def test_forged_records_neither_end_nor_steer_a_command(forged, run_here, capsys):
    run_here(
        Config.model_validate(SMALL.model_dump(exclude_unset=True) | {"sweep": {"punch.radius": [1, 2]}})
    )
    me = {"host": socket.gethostname(), "pid": os.getpid(), "updated": time.time(), "started": time.time()}
    whole = me | {"simulated_time": 1.0, "end": 2.0, "label": "", "steps": 1, "since": 0.0, "since_time": 0.0}
    for number, kind in ((0, "running"), (1, "failed")):
        path = Path(f"out/cases/000{number}.{kind}")
        Path(f"out/cases/000{number}.h5").unlink()
        if forged in RECORDS:
            record = RECORDS[forged]
            keys = whole if kind == "running" else {"reason": "", "values": {}}
            path.write_text(
                json.dumps(
                    keys | {key: record[key] for key in record if key in keys}
                    if isinstance(record, dict)
                    else record
                )
            )
        elif forged == "pipe":
            os.mkfifo(path)
        elif forged == "deep":
            path.write_text("[" * 100_000)
        elif forged == "no text":
            path.write_bytes(b"\xff\xfe")
    head = {"many cases": f"# Cases: {10**30}", "far cases": "# Cases: 2\n# Files: 0-99999999999"}
    if forged in head:
        mark, _, rest = Path("out/config.yaml").read_text().split("\n", 2)
        Path("out/config.yaml").write_text(f"{mark}\n{head[forged]}\n{rest}")
    assert main(["status", "out"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("2 cases: 0 complete")
    assert all(line.isprintable() for line in shown.splitlines())
    assert "\\x1b]0;forged" in shown or forged != "escapes"


@pytest.mark.parametrize("name", ["cases/0000.h5", "cases/0000.checkpoint", "config.yaml", "sweep.h5"])
def test_a_pipe_in_place_of_a_file_is_not_waited_for(name, run_here):
    run_here(SMALL)
    if name == "cases/0000.checkpoint":
        Path("out/cases/0000.h5").unlink()
    Path(f"out/{name}").unlink(missing_ok=True)
    os.mkfifo(f"out/{name}")
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("waits"))
    signal.alarm(20)
    try:
        for command in (["report"], ["plot", "--kind", "body"], ["status"]):
            assert main([command[0], "out", *command[1:]]) in (0, 2)
        if name == "config.yaml":
            with pytest.raises(FolderError):
                run_here(SMALL)
        else:
            run_here(SMALL)
            assert is_complete("out/cases/0000.h5")
    finally:
        signal.alarm(0)


def test_a_pipe_in_place_of_the_copy_of_an_input_is_replaced():
    folder = Folder(Path("out"))
    folder.path.mkdir()
    kept = folder.keep_input(Path("precious").absolute(), changed=False)
    kept.unlink()
    os.mkfifo(kept)
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("waits"))
    signal.alarm(20)
    try:
        assert folder.keep_input(Path("precious").absolute(), changed=False).read_text() == "precious"
    finally:
        signal.alarm(0)


def test_a_process_with_the_number_of_a_dead_one_is_not_taken_for_it(run_here):
    run_here(SMALL)
    folder = Folder(Path("out"))
    record = {"host": socket.gethostname(), "pid": os.getpid(), "simulated_time": 1.0, "end": 2.0}
    record |= {"started": 0.0, "updated": time.time(), "born": "another boot 1234"}
    folder.case(0, "running").write_text(json.dumps(record))
    assert running(folder) == []
    assert main(["clean", "out", "--yes"]) == 0
    assert not folder.case(0, "running").exists()


def test_a_process_that_has_ended_and_is_still_listed_does_not_run():
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    record = {"host": socket.gethostname(), "pid": process.pid, "simulated_time": 1.0, "end": 2.0}
    status = Running(0, **record | {"started": 0.0, "updated": 0.0, "born": born(process.pid)})
    assert status.alive(0.0)
    process.kill()
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)  # leaves it in the list
    assert not status.alive(0.0)
    process.communicate()


def test_text_is_shown_without_what_steers_a_terminal():
    assert printable("Größe 3 µm\nλ = 2") == "Größe 3 µm\nλ = 2"
    assert printable("a\x1b[2J\r\u202eb") == "a\\x1b[2J\\r\\u202eb"
