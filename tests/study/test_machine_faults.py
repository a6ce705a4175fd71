"""Faults of the machine end a command with one line and a status, not with a traceback."""

import errno
import multiprocessing.queues
import multiprocessing.synchronize
import os
import subprocess
import sys
from concurrent.futures import process
from pathlib import Path

import h5py
import numpy as np
import pytest

from gfmdlayer.cli import main
from gfmdlayer.files.tables import TableError
from gfmdlayer.files.whole import cannot_be_written
from gfmdlayer.fitting.curve_files import entries
from gfmdlayer.punch.scan_files import read_scan
from gfmdlayer.study import schedule
from gfmdlayer.study.preflight import machine_problem

TINY = """\
name: tiny
grid: {points: 32}
time: {end: 0.3, step: 0.1}
output: {snapshots: [0.3]}
sweep: {layer.thickness: [0.1, 0.2]}
"""


@pytest.fixture(autouse=True)
def configuration():
    Path("tiny.yaml").write_text(TINY)


def one_line(text):
    assert len(text.splitlines()) == 1, text
    return text


@pytest.mark.parametrize("number", ["0", "99999999999999999999"])
@pytest.mark.parametrize("option", ["--jobs", "--threads"])
def test_impossible_numbers_of_processes_are_refused(option, number, capsys):
    assert main(["run", "tiny.yaml", option, number]) == 2
    assert one_line(capsys.readouterr().err) == f"gfmdlayer: {option} {number}: must be from 1 to 16384\n"


@pytest.mark.parametrize("threads", ["0", "-2", "abc", "1.5", ""])
def test_threads_that_numba_does_not_take_are_refused(threads, monkeypatch, capsys):
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    assert main(["check", "tiny.yaml"]) == 2
    assert one_line(capsys.readouterr().err) == (
        f"gfmdlayer: NUMBA_NUM_THREADS={threads}: must be 1 or more, or unset\n"
    )


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (MemoryError("no room"), "memory does not suffice (MemoryError: no room)"),
        (ImportError("libhdf5.so: failed to map segment from shared object"),
         "memory does not suffice (ImportError: libhdf5.so: failed to map segment from shared object)"),
        (OSError(errno.EMFILE, os.strerror(errno.EMFILE), "a.yaml"), "a.yaml: Too many open files"),
        (OSError("libllvmlite.so"), "OSError: libllvmlite.so"),
        (RuntimeError("can't start new thread"), "processes or threads cannot be started; `ulimit -u` m"),
        (BlockingIOError(errno.EAGAIN, "again"), "processes or threads cannot be started; `ulimit -u` m"),
        (OSError(errno.EMFILE, "many"), "too many files are open at a time; `ulimit -n` must allow more"),
    ],
    ids=repr,
)  # fmt: skip
def test_what_the_machine_lacks_is_said_in_a_line(error, message, monkeypatch, capsys):
    def fail(*_):
        raise error

    monkeypatch.setattr("gfmdlayer.cli.run.read_cases", fail)
    assert main(["check", "tiny.yaml"]) == 1
    assert one_line(capsys.readouterr().err).startswith(f"gfmdlayer: {message}")


def test_a_library_that_is_not_found_because_it_cannot_be_mapped_lacks_memory():
    error = OSError("could not find libllvmlite.so")
    error.__context__ = OSError("libllvmlite.so: failed to map segment from shared object")
    assert machine_problem(error).startswith("memory does not suffice")


def test_what_this_user_may_not_read_is_refused(monkeypatch, capsys):
    def fail(*_, **__):
        raise PermissionError(errno.EACCES, "Permission denied", "hidden/a.yaml")

    monkeypatch.setattr("gfmdlayer.study.folder.read_config", fail)
    assert main(["run", "tiny.yaml"]) == main(["check", "tiny.yaml"]) == 2
    assert capsys.readouterr().err.count("Permission denied: 'hidden/a.yaml'; you need permission") == 2


@pytest.mark.parametrize("name", ["config.yaml", "cases/0001.h5"])
def test_results_that_this_user_may_not_read_are_neither_foreign_nor_damaged(name, monkeypatch, capsys):
    assert main(["run", "tiny.yaml"]) == 0
    hidden, access, really = Path("results/tiny") / name, os.access, open

    def opened(path, *arguments, **named):
        if Path(path) == hidden:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return really(path, *arguments, **named)

    monkeypatch.setattr("builtins.open", opened)
    monkeypatch.setattr("gfmdlayer.study.run.is_complete", lambda path: path != hidden)
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != hidden and access(path, mode))
    assert main(["run", "tiny.yaml"]) == 2
    assert f"{hidden}: cannot be read; this user must be allowed to" in capsys.readouterr().err
    assert hidden.exists()
    assert not list(hidden.parent.glob("*.aside"))


@pytest.mark.parametrize("at", ["the thread of the pool", "a thread of its queue", "/dev/shm"])
def test_processes_that_cannot_be_started_end_a_run_in_a_line(at, monkeypatch, capfd):
    def fail(*_, **__):
        if at == "/dev/shm":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        raise RuntimeError("can't start new thread")

    owner, method = {
        "the thread of the pool": (process._ExecutorManagerThread, "start"),
        "a thread of its queue": (multiprocessing.queues.Queue, "_start_thread"),
        "/dev/shm": (multiprocessing.synchronize.SemLock, "__init__"),
    }[at]
    monkeypatch.setattr(owner, method, fail)
    monkeypatch.setattr(schedule, "HEAD_START", 0.0)
    some = "sweep={punch.radius: [0.2, 0.3, 0.4, 0.5, 0.6, 0.7]}"
    assert main(["run", "tiny.yaml", "--jobs", "2", "--set", some]) == (2 if at == "/dev/shm" else 1)
    err = capfd.readouterr().err
    assert "Traceback" not in err
    assert ("--jobs 2: cannot be prepared" if at == "/dev/shm" else "`ulimit -u` must allow more") in err
    for worker in multiprocessing.active_children():  # they are killed, and would wait for ever otherwise
        worker.join()


def test_linear_algebra_has_one_thread_in_every_verb():
    told = "import os, sys; from gfmdlayer.cli import main; main(['check', 'tiny.yaml'])"
    shown = "print(os.environ['OPENBLAS_NUM_THREADS'], file=sys.stderr)"
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run(
        [sys.executable, "-c", f"{told}; {shown}"], env=environment, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert done.stderr.endswith("1\n")


def test_an_error_of_the_program_keeps_its_traceback(monkeypatch):
    def fail(*_):
        raise ZeroDivisionError

    monkeypatch.setattr("gfmdlayer.cli.run.read_cases", fail)
    with pytest.raises(ZeroDivisionError):
        main(["check", "tiny.yaml"])


def flipped(content, rng):
    changed = bytearray(content)
    for place in rng.integers(0, len(content), rng.choice([1, 30])):
        changed[place] ^= 1 << rng.integers(8)
    return bytes(changed)


DAMAGES = {
    "flipped": flipped,
    "cut": lambda content, rng: content[: rng.integers(len(content))],
    "junk": lambda _, rng: rng.bytes(1000),
}


def test_damaged_results_are_named_by_every_verb(capsys):
    assert main(["run", "tiny.yaml", "--out", "out"]) == 0
    rng = np.random.default_rng(0)
    for name in ("sweep.h5", "cases/0000.h5"):
        path = Path("out") / name
        whole = path.read_bytes()
        for damage in DAMAGES.values():
            path.write_bytes(damage(whole, rng))
            capsys.readouterr()
            for verb in ("check", "run", "plot"):
                assert main([verb, str(path)]) == 2
                assert str(path) in one_line(capsys.readouterr().err)
            assert main(["status", "out"]) == 0
        path.write_bytes(whole)


def test_links_that_never_end_are_refused_and_groups_that_hold_themselves_are_not_followed():
    with h5py.File("curves.h5", "w") as h5:
        for name in ("time", "depth", "force"):
            h5[f"curve/{name}"] = np.arange(20.0)
        h5["curve/itself"] = h5["curve"]
    assert [entry.name for entry in entries([Path("curves.h5")])] == ["curve"]
    with h5py.File("curves.h5", "a") as h5:
        h5["loop"] = h5py.SoftLink("/loop")
    with pytest.raises(TableError, match=r"curves\.h5: cannot be read as HDF5"):
        entries([Path("curves.h5")])


def test_a_number_beyond_double_precision_is_not_taken_for_infinity(capsys):
    Path("tiny.yaml").write_text("name: tiny\nlayer: {thickness: 1e400}\n")
    assert main(["check", "tiny.yaml"]) == 2
    message = "tiny.yaml:2:20: layer.thickness: 1e400 is too large; infinity is written .inf"
    assert one_line(capsys.readouterr().err) == f"gfmdlayer: {message}\n"
    Path("tiny.yaml").write_text("name: tiny\nlayer: {thickness: .inf}\n")
    assert main(["check", "tiny.yaml"]) == 0


def test_a_header_that_promises_more_than_the_file_holds_is_named(monkeypatch):
    def load(*_, **__):
        raise MemoryError("Unable to allocate 728. TiB")

    monkeypatch.setattr(np, "load", load)
    Path("heights.npy").write_bytes(b"")
    with pytest.raises(TableError, match=r"heights\.npy: its header names more numbers than memory holds"):
        read_scan(Path("heights.npy"), 1)


@pytest.mark.parametrize(("name", "told"), [("a", ": a"), (None, "")])
def test_a_file_that_the_system_does_not_name_is_not_called_none(name, told):
    error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), name)
    assert cannot_be_written(error) == f"cannot be written (No space left on device{told})"
