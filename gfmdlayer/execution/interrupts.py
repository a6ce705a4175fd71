"""Signals that ask a run to stop, which it does between two time steps.

A handler sets a flag and nothing more. The simulation's progress callback checks the flag once a step and
raises `Stopped`, so that no step and no file is cut in half.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Self

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)


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


def listen() -> None:
    """Make SIGINT, SIGTERM and SIGUSR1 requests to stop, for the rest of this process's life."""
    for signum in STOP_SIGNALS:
        signal.signal(signum, request_stop)


@contextmanager
def listening() -> Iterator[None]:
    """Listen within the block, in the main thread; signals have their former effect after it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {signum: signal.getsignal(signum) for signum in STOP_SIGNALS}
    listen()
    try:
        yield
    finally:
        for signum, handler in before.items():
            signal.signal(signum, signal.SIG_DFL if handler is None else handler)
        _Flag.raised = False


@contextmanager
def signals_blocked() -> Iterator[None]:
    """Block the stop signals while child processes are started.

    Children inherit the mask, so that an early signal waits until the child listens instead of ending it.
    """
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
    """Stands in for the status file on a rank that is not the first of its case."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *details: object) -> None:
        """Do nothing."""

    def advance(self, _time: float) -> None:
        """Look for a request to stop.

        Raises
        ------
        Stopped
            Where a signal to this process asked the run to stop.
        """
        if stop_requested():
            raise Stopped
