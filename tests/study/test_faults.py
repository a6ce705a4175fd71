"""Faults times moments: whatever strikes a run, the same command ends it with the bits of an undisturbed one.

A fault strikes a forked process at an access to a file, which Python's audit events name. Afterwards nothing
unreadable has a final name, and files of others are untouched.
"""

import errno
import fcntl
import math
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from fnmatch import fnmatch
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gfmdlayer.case import march
from gfmdlayer.case.case import Case
from gfmdlayer.cli import main
from gfmdlayer.config import Config, load
from gfmdlayer.results.reader import attributes, is_complete
from gfmdlayer.study import case_run
from gfmdlayer.study.case_run import run_case
from gfmdlayer.study.cases import SweepCase
from gfmdlayer.study.claims import Claim, running
from gfmdlayer.study.folder import Folder
from tests.studies import OTHERS

SOAK = Path(__file__).parents[2] / "scripts" / "soak.py"
STUDY = """\
name: faulty
grid: {points: 64}
time: {end: 0.4, step: 0.05}
output: {snapshots: [0.1, 0.4]}
sweep: {layer.thickness: [0.05, 0.1]}
"""
RUN = ("run", "faulty.yaml", "--out", "out", "--checkpoint-every", "0")

# Event, file and the number of the access: 1 for the first one.
MOMENTS = {
    "the folder is claimed": ("open", "config.yaml.*.part", 1),
    "a case begins": ("open", "0000.running.*.part", 1),
    "the snapshots are begun": ("open", "0000.snapshots", 1),
    "a checkpoint is written": ("open", "0000.checkpoint.*.part", 3),
    "a checkpoint gets its name": ("os.rename", "0000.checkpoint", 4),
    "a case is written": ("open", "0000.h5.*.part", 1), "a case gets its name": ("os.rename", "0000.h5", 1),
    "a checkpoint is removed": ("os.remove", "0000.checkpoint", 1),
    "snapshots are removed": ("os.remove", "0000.snapshots", 1),
    "the next case is under way": ("os.rename", "0001.checkpoint", 5),
    "the sweep is written": ("open", "sweep.h5.*.part", 1),
    "the sweep gets its name": ("os.rename", "sweep.h5", 1),
}  # fmt: skip


def lose_permission():
    for folder in (Path("out/cases"), Path("out")):
        folder.chmod(0o555)
    if os.geteuid() == 0:  # who has it everywhere
        os.seteuid(65534)


def fail_once():
    raise OSError(errno.EIO, os.strerror(errno.EIO))


FAULTS = {
    "killed": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "asked to stop": lambda: signal.raise_signal(signal.SIGTERM),
    "full disk": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY)),
    "permission lost": lose_permission,
    "disk error": fail_once,
    "folder removed": lambda: shutil.rmtree("out/cases", ignore_errors=True),
    "case lost": lambda: Path("out/cases/0001.h5").unlink(missing_ok=True),
    "case cut": lambda: os.truncate("out/cases/0001.h5", 1000),
}

Run = Callable[..., tuple[Any, str]]


@pytest.fixture(scope="module")
def whole(tmp_path_factory, bits):
    """The bits of a run without a fault."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "faulty.yaml").write_text(STUDY)
    assert main(["run", str(folder / "faulty.yaml"), "--out", str(folder / "out")]) == 0
    return bits(folder / "out")


@pytest.fixture(autouse=True)
def configuration():
    Path("faulty.yaml").write_text(STUDY)


def struck(fault, moment):
    """Run the study in a forked process, which the fault strikes; return the status and the log."""
    event, pattern, number = moment
    left = [number]

    def hook(name, arguments):
        if name != event or left[0] == 0 or not isinstance(arguments[0], str | bytes | os.PathLike):
            return
        path = os.fsdecode(arguments[1 if event == "os.rename" else 0])
        if fnmatch(Path(path).name, pattern):
            left[0] -= 1
            if left[0] == 0:
                fault()

    reading, writing = os.pipe()  # of a size that holds the log
    process = os.fork()
    if process == 0:
        try:
            sys.stdout = sys.stderr = os.fdopen(writing, "w", buffering=1)
            sys.addaudithook(hook)
            os._exit(main(list(RUN)))
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(99)
    os.close(writing)
    _, status = os.waitpid(process, 0)
    with os.fdopen(reading) as log:
        return os.waitstatus_to_exitcode(status), log.read()


AT = ("a checkpoint is written", "a case is written", "a case gets its name", "the sweep is written")
STRIKES = [("killed", moment) for moment in MOMENTS]
ANYWHERE = ("asked to stop", "full disk", "permission lost", "disk error", "folder removed")
STRIKES += [(fault, moment) for fault in ANYWHERE for moment in AT]
STRIKES += [("full disk", "the folder is claimed")]
STRIKES += [(fault, "the sweep is written") for fault in ("case lost", "case cut")]
WORDS = {
    ("full disk", "the folder is claimed"): ["out: cannot be written (File too large"],
    ("full disk", "a checkpoint is written"): ["its checkpoint cannot be written: File too large"],
    ("full disk", "a case is written"): ["0000.h5: cannot be written: File too large"],
    ("permission lost", "a checkpoint is written"): [
        "its checkpoint cannot be written: Permission denied",
        "0000.h5: cannot be written: Permission denied",
    ],
    ("folder removed", "a case is written"): ["cannot be written: No such file or directory"],
    ("asked to stop", "a checkpoint is written"): ["stopped"],
    ("case lost", "the sweep is written"): ["no complete result file"],
    ("case cut", "the sweep is written"): ["no complete result file"],
}


@pytest.mark.parametrize(("fault", "moment"), STRIKES)
def test_a_run_that_a_fault_strikes_is_ended_by_the_same_command(fault, moment, run_here, whole, bits):
    status, log = struck(FAULTS[fault], MOMENTS[moment])
    for folder in (Path("out"), Path("out/cases")):
        if folder.exists():
            folder.chmod(0o755)
    assert status in ((-signal.SIGKILL,) if fault == "killed" else (0, 1, 2, 75)), log
    assert "Traceback" not in log
    assert "Exception ignored" not in log
    assert all(words in log for words in WORDS.get((fault, moment), [])), log
    assert log.count("case 0000 continues, but its checkpoint") <= 1  # each reason once
    assert fault == "case cut" or all(is_complete(path) for path in Path("out/cases").glob("*.h5"))
    begun = Path("out/config.yaml").exists() and Path("out/cases").exists()
    others = [Path(place) / name for place in ("out", "out/cases") for name in OTHERS if begun]
    for path in others:
        path.write_text("mine")
    summary, again = run_here("faulty.yaml", checkpoint_every=0.0)
    assert summary.count("complete") == 2
    assert {path.read_text() for path in others} <= {"mine"}
    for path in others:
        path.unlink()
    assert bits("out").items() >= whole.items()
    aside = {"0001.h5.aside"} if fault == "case cut" else set()
    assert {path.name for path in Path("out/cases").iterdir()} - aside == {".lock", "0000.h5", "0001.h5"}
    if fault == "killed" and moment == "the next case is under way":
        assert "case 0001 goes on from time" in again


LONG = """\
name: faulty
grid: {points: 16384}
layer: {material: {model: zener, G0: 1.0, Ginf: 30.0, tau: 0.5}}
time: {end: 8.0, step: 0.004}
output: {snapshots: [1.0, 8.0]}
"""


def test_a_case_killed_at_random_moments_in_the_compiled_loop_keeps_its_bits(run_here, bits, monkeypatch):
    Path("faulty.yaml").write_text(LONG)
    case = Case(load("faulty.yaml"))
    assert march.March.suits(case.contact, case.observables)
    run_here("faulty.yaml", "whole")
    monkeypatch.setattr(case_run, "_PART", math.inf)  # a checkpoint whenever the loop comes back, each time
    monkeypatch.setattr(march, "ATTEMPTS", 16)  # after so many of 2000 steps
    checkpoint, rng = Path("out/cases/0000.checkpoint"), np.random.default_rng(49)

    def written():
        return checkpoint.stat().st_mtime_ns if checkpoint.exists() else 0

    for _ in range(4):
        before, process = written(), os.fork()
        if process == 0:
            with Path("log").open("a", buffering=1) as sys.stderr:
                os._exit(main([*RUN[:-1], "1e-9"]))
        while written() == before:
            assert os.waitpid(process, os.WNOHANG) == (0, 0), Path("log").read_text()
        time.sleep(rng.uniform(0, 0.03))
        os.kill(process, signal.SIGKILL)
        assert os.WIFSIGNALED(os.waitpid(process, 0)[1])  # it was at work
    assert Path("log").read_text().count("goes on from time") == 3
    summary, log = run_here("faulty.yaml")
    assert summary.count("complete") == 1
    assert "case 0000 goes on from time" in log
    assert bits("out") == bits("whole")


def cut(path):
    os.truncate(path, path.stat().st_size // 2)


def flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 1
    path.write_bytes(content)


def pipe(path):
    path.unlink()
    os.mkfifo(path)


def link(path):
    Path("precious").write_text("precious")
    path.unlink()
    path.symlink_to(Path("precious").absolute())


DAMAGES = {"cut": cut, "flipped": flip, "lost": Path.unlink, "a pipe": pipe, "a link": link}
LEFT = {  # by a process killed in the second case: why a file with a damage is set aside
    "0000.h5": "case 0000 is damaged: set aside as 0000.h5.aside, computed again",
    "0001.checkpoint": "case 0001 begins anew, its checkpoint is set aside: it ",
    "0001.snapshots": "begins anew, its checkpoint is set aside: 0001.snapshots, which belongs to it, ",
}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("name", LEFT)
def test_a_damaged_file_is_set_aside_and_its_case_computed_again(name, damage, run_here, whole, bits):
    struck(FAULTS["killed"], MOMENTS["the next case is under way"])
    path = Path("out/cases") / name
    DAMAGES[damage](path)
    content = path.read_bytes() if path.is_file() and not path.is_symlink() else None
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("waits for a pipe"))
    signal.alarm(60)
    try:
        summary, log = run_here("faulty.yaml", checkpoint_every=0.0)
    finally:
        signal.alarm(0)
    assert summary.count("complete") == 2
    aside = path.with_name(f"{name}.aside")
    if damage != "lost" or name == "0001.snapshots":
        assert LEFT[name] in log
    if content is not None:
        assert aside.read_bytes() == content
    if damage == "a link":
        assert Path("precious").read_text() == "precious"
    for each in Path("out/cases").glob("*.aside"):
        each.unlink()
    assert bits("out") == whole


def test_a_file_system_without_locks_changes_nothing(run_here, whole, bits, monkeypatch):
    def flock(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", flock)
    run_here("faulty.yaml")
    summary, log = run_here("faulty.yaml")
    assert summary.count("complete") == 2
    assert "damaged" not in log
    assert bits("out") == whole


def test_a_disk_too_full_for_checkpoints_costs_none_of_the_results(run_here):
    # Without snapshots a case takes 0.13 MB, its state at 8192 points more than 0.5 MB.
    Path("faulty.yaml").write_text(STUDY.replace("[0.1, 0.4]", "[]").replace("64", "8192"))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, before[1]))
    try:
        summary, log = run_here("faulty.yaml", checkpoint_every=0.0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert summary.count("complete") == 2
    assert log.count("case 0000 continues, but its checkpoint cannot be written") == 1
    assert {path.name for path in Path("out/cases").iterdir()} == {".lock", "0000.h5", "0001.h5"}


def test_a_clock_that_is_set_back_changes_no_result(monkeypatch, tmp_path, bits):
    case = SweepCase(0, Config(name="clock").with_values({"grid.points": 32, "time.end": 0.4}), {})
    folder, whole = Folder(tmp_path / "out"), Folder(tmp_path / "undisturbed")
    for each in (folder, whole):
        each.cases.mkdir(parents=True)
    run_case(case, whole)
    now, calls = time.time(), count()
    monkeypatch.setattr(time, "time", lambda: now - 3600 * next(calls))
    with Claim(folder, 1, 1.0) as status:
        status.advance(0.5)
        assert [each.index for each in running(folder)] == [1]
    assert run_case(case, folder, checkpoint_every=0).state == "complete"
    assert bits(folder.case(0)) == bits(whole.case(0))
    assert float(str(attributes(folder.case(0))["wall_seconds"])) > 0


@pytest.mark.slow
def test_a_few_kills_at_random_lose_nothing():
    given = [sys.executable, str(SOAK), "--only", "kills", "--ways", "forked", "--trials", "2"]
    process = subprocess.run(given, capture_output=True, text=True, timeout=600, check=False)
    assert process.returncode == 0, process.stdout + process.stderr
    assert "| kills | equal | 2 |" in process.stdout
    assert "| compared bit by bit |" in process.stdout
