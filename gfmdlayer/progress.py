"""How far a run is: written by whoever computes, read by whoever wants to know.

The process that runs a case keeps cases/NNNN.running up to date, at most once a second.  The bar on a
terminal, the lines in a log and `gfmdlayer status` read these files, so that they work for processes on any
host.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol, Self, TextIO

from gfmdlayer.folder import Folder, read_json, write_whole
from gfmdlayer.interrupts import Stopped, stop_requested
from gfmdlayer.schedule import Outcome

WRITE_INTERVAL = 1.0  # seconds between two status files of a case
READ_INTERVAL = 0.5  # seconds between two looks at all of them
LOG_INTERVAL = 5.0  # seconds between two lines in a log, more in a long run
SILENCE = 120.0  # seconds without an update after which a case on another host is taken for dead


class StatusFile:
    """Tells how far a case is, and stops it when asked to; a context manager around the simulation.

    Parameters
    ----------
    folder : Folder
        The results folder.
    index : int
        The case.
    end : float
        The simulated time at which the case will be complete.
    """

    def __init__(self, folder: Folder, index: int, end: float) -> None:
        self._path = folder.case(index, "running")
        self._stop = folder.stop
        self._written = -WRITE_INTERVAL
        self._fixed = {"host": socket.gethostname(), "pid": os.getpid(), "started": time.time(), "end": end}

    def __enter__(self) -> Self:
        self.advance(0.0)
        return self

    def __exit__(self, *details: object) -> None:
        with suppress(OSError):
            self._path.unlink(missing_ok=True)

    def advance(self, simulated_time: float) -> None:
        """Note that the simulation has got to a time.

        Raises
        ------
        Stopped
            Where the run was asked to stop, by a signal to this process or by the folder's stop file.
        """
        now = time.monotonic()
        due = now - self._written >= WRITE_INTERVAL
        if stop_requested() or (due and self._stop.exists()):
            raise Stopped
        if due:
            self._written = now
            content = self._fixed | {"simulated_time": float(simulated_time), "updated": time.time()}
            with suppress(OSError):  # progress is not worth a simulation
                write_whole(self._path, json.dumps(content), to_disk=False)


@dataclass(frozen=True)
class Running:
    """A case that some process is at."""

    index: int
    host: str
    pid: int
    simulated_time: float
    end: float
    started: float
    updated: float

    @property
    def fraction(self) -> float:
        """The part of the simulated time that is done."""
        return min(self.simulated_time / self.end, 1.0) if self.end > 0 else 0.0

    @property
    def alive(self) -> bool:
        """Whether the process still exists; judged by its last update where it is on another host."""
        if self.host != socket.gethostname():
            return time.time() - self.updated < SILENCE
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return False
        except PermissionError:
            return True
        return True


def running(folder: Folder) -> list[Running]:
    """Return the cases that some process is at, in their order."""
    found = []
    for path in sorted(folder.cases.glob("*.running")):
        content: dict[str, Any] = read_json(path) or {}
        with suppress(TypeError, ValueError):
            case = Running(index=int(path.stem), **content)
            if case.alive:
                found.append(case)
    return found


class Report(Protocol):
    """Where progress is told."""

    def note(self, line: str) -> None:
        """Tell one event."""

    def advance(self, done: float, total: int, running: int, seconds_left: float | None) -> None:
        """Tell how many cases are done (parts of running ones included) of how many, and the time left."""

    def close(self) -> None:
        """Nothing more will be told."""


class Log:
    """Plain lines with the time, for a file."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._begun = self._last = time.monotonic()

    def note(self, line: str) -> None:
        """Write one line."""
        with suppress(OSError):  # nobody reads the log any more; the run goes on
            self._stream.write(f"{time.strftime('%Y-%m-%d %H:%M:%S')}  {line}\n")
            self._stream.flush()

    def advance(self, done: float, total: int, running: int, seconds_left: float | None) -> None:
        """Write a line, unless there was one just before."""
        now = time.monotonic()
        if now - self._last >= max(LOG_INTERVAL, (now - self._begun) / 50):
            self._last = now
            left = "" if seconds_left is None else f", {duration(seconds_left)} left"
            self.note(f"{done / total:.0%}, {running} running{left}")

    def close(self) -> None:
        """Do nothing: every line is written already."""


class Bar:
    """A bar with the time left, for a terminal."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

        columns = (BarColumn(), TaskProgressColumn(), TextColumn("{task.fields[state]}"))
        self._progress = Progress(*columns, console=Console(stderr=True))
        self._task = self._progress.add_task("", state="")
        self._progress.start()

    def note(self, line: str) -> None:
        """Write one line above the bar."""
        self._progress.console.print(line, markup=False, highlight=False)

    def advance(self, done: float, total: int, running: int, seconds_left: float | None) -> None:
        """Move the bar."""
        left = "" if seconds_left is None else f", {duration(seconds_left)} left"
        state = f"{int(done)} of {total} complete, {running} running{left}"
        self._progress.update(self._task, completed=done, total=total, state=state)

    def close(self) -> None:
        """Leave the bar as it is."""
        self._progress.stop()


class Reporter:
    """Watches a run and tells a report; a context manager around it, with a thread of its own.

    Parameters
    ----------
    folder : Folder
        The results folder.
    total, complete : int
        Number of cases, and of those complete before the run.
    report : callable, optional
        Makes the report to tell; nothing is told without.
    """

    def __init__(
        self, folder: Folder, total: int, complete: int, report: Callable[[], Report] | None
    ) -> None:
        self._folder, self._total = folder, total
        self._report = report() if report else None
        self._before = self._ended = complete
        self._begun = time.monotonic()
        self._over = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        if self._report is not None:
            self._thread.start()
        return self

    def __exit__(self, *details: object) -> None:
        if self._report is not None:
            self._over.set()
            self._thread.join()
            self._advance()
            self._report.close()

    def note(self, line: str) -> None:
        """Tell one event."""
        if self._report is not None:
            with self._lock:
                self._report.note(line)

    def ended(self, outcome: Outcome) -> None:
        """Tell what became of a case."""
        if outcome.state == "stopped":
            return
        with self._lock:
            self._ended += 1
            place = f"{self._ended} of {self._total}"
        if outcome.state == "complete":
            self.note(f"case {outcome.index:04d} complete in {duration(outcome.seconds)} ({place})")
        else:
            self.note(f"case {outcome.index:04d} FAILED ({place}): {outcome.reason}")

    def _watch(self) -> None:
        stopping = False
        while not self._over.wait(READ_INTERVAL):
            self._advance()
            if stop_requested() and not stopping:
                stopping = True
                self.note("stopping after the current time step")

    def _advance(self) -> None:
        at_work = running(self._folder)
        done = min(self._ended + sum(case.fraction for case in at_work), self._total)
        rate = (done - self._before) / (time.monotonic() - self._begun)
        left = (self._total - done) / rate if rate > 0 else None
        if self._report is not None:
            with self._lock:
                self._report.advance(done, self._total, len(at_work), left)


def report_to(stream: TextIO = sys.stderr) -> Report:
    """Return a bar where the stream is a terminal, else a log."""
    return Bar() if stream.isatty() else Log(stream)


def duration(seconds: float) -> str:
    """Write a duration for people: 0.4 s, 12 s, 3 min 20 s, 5 h 10 min, 3 d 4 h."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    for unit, name, part, part_name in ((86400, "d", 3600, "h"), (3600, "h", 60, "min"), (60, "min", 1, "s")):
        if whole >= unit:
            return f"{whole // unit} {name} {whole % unit // part} {part_name}"
    return f"{whole} s"
