"""Signals that ask a run to stop: noticed at once, acted upon between two time steps.

A handler sets a flag and nothing more.  The simulation's progress callback looks at the flag once a step and
raises `Stopped`, so that no step is cut in half and no file is left half written.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)


class Stopped(Exception):  # noqa: N818 - an outcome that was asked for, not an error
    """Raised between two time steps after the run was asked to stop."""


class _Flag:
    """A process has one set of signal handlers, hence one flag."""

    raised = False


def request_stop(signum: int = 0, frame: FrameType | None = None) -> None:  # noqa: ARG001
    """Ask this process to stop after the current time step (also the signal handler)."""
    _Flag.raised = True


def stop_requested() -> bool:
    """Whether this process was asked to stop."""
    return _Flag.raised


def listen() -> None:
    """Turn SIGINT, SIGTERM and SIGUSR1 into a request to stop, for the rest of this process's life."""
    for signum in STOP_SIGNALS:
        signal.signal(signum, request_stop)


@contextmanager
def held_back() -> Iterator[None]:
    """Hold the stop signals back while child processes are started.

    Children inherit the mask; a signal that arrives before a child listens waits for it instead of ending it.
    """
    previous = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous)


def listen_and_release() -> None:
    """Listen in a child that was started with its stop signals held back."""
    listen()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)
