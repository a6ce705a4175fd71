"""How far a case is: written by whoever computes it, read by whoever wants to know.

The process that runs a case keeps cases/NNNN.running up to date, at most once a second.  The bar on a
terminal, the lines in a log and `gfmdlayer status` read these files, so that they work for processes on any
host.
"""

from __future__ import annotations

import json
import math
import os
import socket
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Self

from gfmdlayer.execution.folder import Folder, read_json, write_whole
from gfmdlayer.execution.interrupts import Stopped, stop_requested
from gfmdlayer.execution.listing import numbers

WRITE_INTERVAL = 1.0  # seconds between two status files of a case
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
    label : str
        The case's swept values, for people.
    """

    def __init__(self, folder: Folder, index: int, end: float, label: str = "") -> None:
        self._path = folder.case(index, "running")
        self._stop = folder.stop
        self._written = -WRITE_INTERVAL
        me = {"host": socket.gethostname(), "pid": os.getpid(), "started": time.time()}
        self._fixed: dict[str, object] = me | {"end": end, "label": label}
        self._steps = -1  # entering tells the time too

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
        self._steps += 1
        if self._steps == 1:  # a case that is taken up begins late, and the first step takes longest
            self._fixed |= {"since": time.time(), "since_time": float(simulated_time)}
        now = time.monotonic()
        due = now - self._written >= WRITE_INTERVAL
        if stop_requested() or (due and self._stop_is_there()):
            raise Stopped
        if due:
            self._written = now
            reached = {"simulated_time": float(simulated_time), "steps": self._steps, "updated": time.time()}
            content = self._fixed | reached
            with suppress(OSError):  # progress is not worth a simulation
                write_whole(self._path, json.dumps(content), to_disk=False)

    def _stop_is_there(self) -> bool:
        with suppress(OSError):  # a folder that cannot be read for a while asks for nothing
            return self._stop.exists()
        return False


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
    label: str = ""
    steps: int = 0
    since: float = math.nan
    since_time: float = math.nan

    @property
    def fraction(self) -> float:
        """The part of the simulated time that is done."""
        return min(self.simulated_time / self.end, 1.0) if self.end > 0 else 0.0

    @property
    def seconds_left(self) -> float | None:
        """How long the case will take at its present pace; None where it has none yet."""
        covered, spent = self.simulated_time - self.since_time, self.updated - self.since
        return (self.end - self.simulated_time) * spent / covered if covered > 0 and spent > 0 else None

    @property
    def alive(self) -> bool:
        """Whether the process still exists; make_solution by its last update where it is on another host."""
        if self.host != socket.gethostname():
            return abs(time.time() - self.updated) < SILENCE  # a clock that was set back is no sign of life
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return False
        except PermissionError:
            return True
        return True


def running(folder: Folder, begun: Iterable[int] | None = None) -> list[Running]:
    """Return the cases that some process is at, in their order; `begun` are those with a status file."""
    found = []
    for index in sorted(numbers(folder)["running"] if begun is None else begun):
        content: dict[str, Any] = read_json(folder.case(index, "running")) or {}
        with suppress(TypeError, ValueError):
            case = Running(index=index, **content)
            if case.alive:
                found.append(case)
    return found
