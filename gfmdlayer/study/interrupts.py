"""Signals that ask a run to stop, between two time steps or before the first; ends of other processes.

A handler sets a flag and nothing more. The simulation's progress callback checks the flag once a step and
raises `Stopped`, so that no step and no file is cut in half. While cases are read and kernels compiled there
is neither, and the handler raises.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

# Of a terminal that is closed, of a user, and of batch systems before the end of a job's time.
STOP_SIGNALS = (
    signal.SIGHUP, signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2, signal.SIGXCPU
)  # fmt: skip
AGAIN = 1.0  # seconds
WATCH_INTERVAL = 1.0  # seconds between two checks that the launcher's process is alive


class Stopped(Exception):  # noqa: N818 - requested, not an error
    """Raised between two time steps after the run was asked to stop."""


class _Flag:
    """The flag of this process, which has one set of signal handlers."""

    raised = False


def request_stop(signum: int = 0, frame: FrameType | None = None) -> None:  # noqa: ARG001
    """Ask this process to stop after the current time step (also the signal handler)."""
    _Flag.raised = True


def stop_requested() -> bool:
    """Whether this process was asked to stop."""
    return _Flag.raised


def heard() -> list[signal.Signals]:
    """Return the signals that stop this process: all, or without SIGHUP where `nohup` has it ignored."""
    ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return [each for each in STOP_SIGNALS if not (ignored and each == signal.SIGHUP)]


def listen() -> None:
    """Make the stop signals requests to stop, for the rest of this process's life."""
    for signum in heard():
        signal.signal(signum, request_stop)


@contextmanager
def listening() -> Iterator[None]:
    """Listen within the block, in the main thread; signals have their former effect after it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {signum: signal.getsignal(signum) for signum in heard()}
    listen()
    try:
        yield
    finally:
        for signum, handler in before.items():
            signal.signal(signum, signal.SIG_DFL if handler is None else handler)
        _Flag.raised = False


@contextmanager
def at_once() -> Iterator[None]:
    """Raise KeyboardInterrupt within the block at a request to stop, or at its begin after an earlier one.

    Python drops an exception that strikes a destructor or a callback: it comes again after `AGAIN` seconds.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(signum: int, frame: FrameType | None) -> None:
        request_stop(signum, frame)
        sys.unraisablehook = _of_others
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
        raise KeyboardInterrupt

    signals = (*heard(), signal.SIGALRM)
    before = {signum: signal.signal(signum, interrupt) for signum in signals}
    try:
        _raise_where_asked()
        yield
    except Exception:
        _raise_where_asked()  # libraries wrap the interrupt in errors of their own
        raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for signum, handler in before.items():
            signal.signal(signum, signal.SIG_DFL if handler is None else handler)


def _raise_where_asked() -> None:
    if stop_requested():
        raise KeyboardInterrupt from None


def _of_others(unraisable: Any) -> None:
    """Report an exception in a destructor, unless it is of an object of LLVM."""
    if not str(getattr(unraisable.object, "__module__", "")).startswith("llvmlite"):
        sys.__unraisablehook__(unraisable)


@contextmanager
def signals_blocked() -> Iterator[None]:
    """Block the stop signals while children start: an early signal waits until the child listens."""
    previous = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous)


def listen_and_unblock() -> None:
    """Listen in a child that was started with its stop signals blocked."""
    listen()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)


class Listener:
    """Stands in for the claim on a case, on ranks but its first."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *details: object) -> None:
        """Do nothing."""

    def advance(self, _time: float) -> None:
        """Look for a request to stop."""
        if stop_requested():
            raise Stopped

    def confirm(self) -> None:
        """Do nothing."""


def end_after(wait: Callable[[], None]) -> None:
    """End this process when a call returns: no process of a killed run may go on writing into its folder."""

    def watch() -> None:
        wait()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def end_with(launcher: int) -> None:
    """End this process when the launcher's process on this host dies."""

    def wait() -> None:
        while os.getppid() == launcher:
            time.sleep(WATCH_INTERVAL)

    end_after(wait)
