"""Requests to stop that come before the first step: while a configuration is read, kernels are compiled."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from functools import partial
from itertools import product
from multiprocessing import active_children
from pathlib import Path

import pytest

from gfmdlayer.cli import main
from gfmdlayer.config import Config
from gfmdlayer.study import interrupts
from gfmdlayer.study import run as running
from gfmdlayer.study.claims import Claim
from gfmdlayer.study.folder import Folder
from gfmdlayer.study.interrupts import AGAIN, STOP_SIGNALS, Stopped, at_once
from gfmdlayer.study.schedule import Outcome, Schedule
from gfmdlayer.study.workers import processes

PATIENCE = 60.0  # seconds in which a test that fails ends


@pytest.fixture(autouse=True)
def restored(monkeypatch):
    monkeypatch.setattr(interrupts._Flag, "raised", False)
    handlers = {signum: signal.getsignal(signum) for signum in (*STOP_SIGNALS, signal.SIGALRM)}
    interrupts.listen()
    yield
    for signum, handler in handlers.items():
        signal.signal(signum, handler)


def wait():
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        time.sleep(0.01)


def test_a_hangup_that_nohup_ignores_stays_ignored():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    interrupts.listen()
    assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    assert signal.getsignal(signal.SIGTERM) == interrupts.request_stop


class Struck:
    """Its destructor gets the signal, and Python drops the exception."""

    def __del__(self):
        signal.raise_signal(signal.SIGTERM)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(("signum", "dropped"), [*product(STOP_SIGNALS, [False]), (signal.SIGTERM, True)])
def test_a_signal_ends_the_block_at_once(signum, dropped):
    begun = time.monotonic()
    before = [signal.getsignal(each) for each in STOP_SIGNALS]
    strike = Struck if dropped else partial(signal.raise_signal, signum)

    def work():
        strike()
        wait()

    with pytest.raises(KeyboardInterrupt), at_once():
        work()
    assert time.monotonic() - begun < AGAIN + PATIENCE / 2
    assert interrupts.stop_requested()
    assert [signal.getsignal(each) for each in STOP_SIGNALS] == before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    with pytest.raises(KeyboardInterrupt), at_once():
        raise AssertionError("an earlier request ends the block before it begins")


@pytest.mark.parametrize("swallowed", [False, True])
def test_a_run_that_is_stopped_while_compiling_begins_no_case(swallowed, monkeypatch, run_here):
    def compile_long(*_, **__):
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt:
            if not swallowed:  # as a compiler may
                raise
        return ["the cases compile their kernels themselves"]

    monkeypatch.setattr(running, "warm_up", compile_long)
    config = Config(name="early", sweep={"layer.thickness": [0.1, 0.2]})
    summary, log = run_here(config)
    assert summary.count("stopped") == 2
    assert "kernels themselves" not in log
    assert sorted(path.name for path in Path("out/cases").iterdir()) == [".lock"]


def test_no_workers_are_started_after_a_request_to_stop():
    folder = Folder(Path("out"))
    folder.cases.mkdir(parents=True)
    interrupts.request_stop()
    before = active_children()
    with processes(2) as pool:
        schedule = Schedule(pool, lambda _: Outcome(0, "complete"), folder, lambda _: None)
        states = [outcome.state for outcome in schedule.run([Outcome(0, "waiting"), Outcome(1, "waiting")])]
        assert active_children() == before
    assert states == ["stopped", "stopped"]


def test_an_interrupt_that_a_library_wraps_in_an_error_is_one():
    def build():
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt as interrupt:
            raise ValueError("no schema") from interrupt

    with pytest.raises(KeyboardInterrupt), at_once():
        build()


@pytest.mark.parametrize(("module", "told"), [("llvmlite.binding.ffi", False), ("h5py", True)])
def test_an_interrupt_leaves_objects_of_llvm_half_closed_in_silence(module, told, monkeypatch, capsys):
    def close(_):
        raise AttributeError

    close.__module__ = module
    monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)
    with suppress(KeyboardInterrupt), at_once():
        signal.raise_signal(signal.SIGTERM)
    type("Half", (), {"__del__": close})()
    assert ("AttributeError" in capsys.readouterr().err) == told


@pytest.mark.parametrize("verb", ["run", "check"])
def test_an_interrupt_before_the_verb_listens_ends_it_in_a_line(verb, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("gfmdlayer.study.interrupts.listen", interrupted)
    monkeypatch.setattr("gfmdlayer.cli.run.read_cases", interrupted)
    assert main([verb, "a.yaml"]) == 75
    assert capsys.readouterr().err == "gfmdlayer: stopped\n"


def test_a_rank_that_is_interrupted_before_mpi_starts_dies_by_the_signal():
    """An exit would leave the other ranks waiting for it: the launcher ends them after a signal alone."""
    script = (
        "import signal\n"
        "from gfmdlayer import cli\n"
        "cli.command_line = lambda: signal.raise_signal(signal.SIGINT)\n"
        "raise SystemExit(cli.main())"
    )
    command = [sys.executable, "-c", script]
    ended = [
        subprocess.run(command, env=os.environ | rank, capture_output=True, text=True, timeout=PATIENCE)
        for rank in ({}, {"PMI_SIZE": "2", "PMI_RANK": "1"})
    ]
    assert [each.stderr for each in ended] == ["gfmdlayer: stopped\n"] * 2
    assert [each.returncode for each in ended] == [75, -signal.SIGINT]


def test_a_rank_that_is_asked_to_stop_begins_its_case_and_stops_with_the_others(tmp_path):
    """The other ranks, which no signal has reached, wait for it in what comes before the first step."""
    folder = Folder(tmp_path)
    folder.cases.mkdir()
    interrupts.request_stop()
    with pytest.raises(Stopped), Claim(folder, 0, 1.0):
        raise AssertionError("alone, a process stops before its case")
    with Claim(folder, 0, 1.0, together=True) as status, pytest.raises(Stopped):
        status.advance(0.1)


def test_a_signal_while_the_configuration_is_read_ends_the_command(monkeypatch, capsys):
    def read(*_):
        signal.raise_signal(signal.SIGTERM)
        wait()
        raise AssertionError("not reached")

    monkeypatch.setattr("gfmdlayer.cli.run.read_cases", read)
    assert main(["run", "a.yaml"]) == 75
    assert capsys.readouterr().out == "stopped before the first case\n"
    assert not Path("results").exists()
