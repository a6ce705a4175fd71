"""Progress of running cases and of a whole sweep, from files in the results folder.

The process that computes a case writes cases/NNNN.running at most once a second. The progress display and
`gfmdlayer status` read these files, so that they work for processes on any host.
"""

from __future__ import annotations

import json
import math
import os
import re
import socket
import time
from collections import defaultdict
from collections.abc import Iterable, Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as pydantic_dataclass

from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.interrupts import Stopped, stop_requested
from gfmdlayer.files.locks import born, read_json
from gfmdlayer.files.whole import write_text

WRITE_INTERVAL = 1.0  # seconds between two status files of a case
SILENCE = 120.0  # seconds without an update after which a case on another host counts as dead
_MOST = 2**63  # of numbers in a status
STEPS_TRUSTED = 0.9  # part of the expected steps, beyond which only the simulated time tells the progress
RECORDS_READ = 1000  # of failures, and of early ends, that an overview reads


class StatusFile:
    """Status file of a case, and its requests to stop; a context manager around the simulation.

    `expected` is the number of steps. With `together` several ranks agree on a stop, after the first step.
    """

    def __init__(
        self,
        folder: Folder,
        index: int,
        end: float,
        label: str = "",
        expected: int = 0,
        together: bool = False,
    ) -> None:
        self._path = folder.case(index, "running")
        self._stop, self._together = folder.stop, together
        self._written = -WRITE_INTERVAL
        me = {"host": socket.gethostname(), "pid": os.getpid(), "born": born(), "started": time.time()}
        self._fixed: dict[str, object] = me | {"end": end, "label": label, "expected": expected}
        self._steps = -1  # the call on entering is not a step

    def __enter__(self) -> Self:
        with suppress(Stopped) if self._together else nullcontext():
            self.advance(0.0)
        return self

    def __exit__(self, *details: object) -> None:
        with suppress(OSError):
            self._path.unlink(missing_ok=True)

    def advance(self, simulated_time: float) -> None:
        """Record the simulated time reached; raise `Stopped` after a signal, or if there is a stop file."""
        self._steps += 1
        if self._steps == 1:  # a resumed case begins late, and the first step takes longest
            self._fixed |= {"since": time.time(), "since_time": float(simulated_time)}
        now = time.monotonic()
        due = now - self._written >= WRITE_INTERVAL
        with suppress(OSError):  # the folder may be unreadable for a while
            if stop_requested() or (due and self._stop.exists()):
                raise Stopped
        if due:
            self._written = now
            reached = {"simulated_time": float(simulated_time), "steps": self._steps, "updated": time.time()}
            content = self._fixed | reached
            with suppress(OSError):  # a simulation does not fail for its status
                write_text(self._path, json.dumps(content), durable=False)


_Number = Annotated[int, Field(ge=0, lt=_MOST)]
_Time = Annotated[float, Field(gt=-_MOST, lt=_MOST)]


@pydantic_dataclass(frozen=True, config=ConfigDict(strict=True, extra="forbid"))
class Running:
    """Status of a case that a process computes; ValueError where a file holds something else."""

    index: int
    host: str
    pid: _Number
    simulated_time: _Time
    end: _Time
    started: _Time
    updated: _Time
    label: str = ""
    steps: _Number = 0
    since: float = math.nan
    since_time: float = math.nan
    expected: _Number = 0
    born: str = ""

    @property
    def fraction(self) -> float:
        """The part of the simulated time that is done."""
        return min(self.simulated_time / self.end, 1.0) if self.end > 0 else 0.0

    @property
    def effort(self) -> float:
        """The part of the work that is done: of the simulated time, or of the expected steps, which grow."""
        of_steps = min(self.steps / self.expected, STEPS_TRUSTED) if self.expected > 0 else 0.0
        return max(self.fraction, of_steps)

    @property
    def seconds_left(self) -> float | None:
        """Seconds left at the present pace; None before the second step."""
        done, spent = self.effort - self.since_time / self.end, self.updated - self.since
        return (1.0 - self.effort) * spent / done if done > 0 and spent > 0 else None

    @property
    def alive(self) -> bool:
        """Whether the process exists; on another host, whether it has written its status lately."""
        if self.host != socket.gethostname():
            return abs(time.time() - self.updated) < SILENCE  # also where a clock was set back
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return False
        except PermissionError:
            pass
        return self.born in ("", born(self.pid))  # not another one, with the number of a dead one


def running(folder: Folder, begun: Iterable[int] | None = None) -> list[Running]:
    """Return the status of the running cases, in their order; `begun` are those with a status file."""
    found = []
    for index in sorted(folder.numbers()["running"] if begun is None else begun):
        content: dict[str, Any] = read_json(folder.case(index, "running")) or {}
        with suppress(TypeError, ValueError):
            case = Running(**content, index=index)
            if case.alive:
                found.append(case)
    return found


@dataclass(frozen=True)
class Record:
    """A case on record as failed or ended early: its number, why, and its swept values."""

    index: int
    reason: str
    values: Mapping[str, object]


@dataclass(frozen=True)
class Overview:
    """Numbers of cases of a sweep by their state."""

    total: int  # numbers of cases; running ones count only in `total`
    complete: int
    failed: int
    waiting: int
    running: list[Running]  # the running cases
    failures: list[Record]  # the first `RECORDS_READ` failed cases, and complete ones that ended early
    ended: list[Record]

    @property
    def over(self) -> bool:
        """Whether no case runs or waits."""
        return not self.running and not self.waiting


def overview(folder: Folder) -> Overview:
    """Count the cases of a results folder by state; opens no result file."""
    numbers, found = folder.case_numbers(), folder.numbers()
    total, own = len(numbers), numbers if isinstance(numbers, range) else set(numbers)
    at_work = running(folder, found["running"])
    busy = {case.index for case in at_work}
    complete = {number for number in found["h5"] - busy if number in own}
    failed = {number for number in found["failed"] - busy - complete if number in own}
    records = [_records(folder, failed, "failed"), _records(folder, found["ended"] & complete, "ended")]
    waiting = max(0, total - len(complete | failed | busy))
    return Overview(total, len(complete), len(failed), waiting, at_work, *records)


def _records(folder: Folder, numbers: set[int], kind: str) -> list[Record]:
    found = []
    for index in sorted(numbers)[:RECORDS_READ]:
        record = read_json(folder.case(index, kind)) or {}
        values = record.get("values")
        found.append(Record(index, str(record.get("reason")), values if isinstance(values, dict) else {}))
    return found


def group_by_reason(records: list[Record]) -> list[list[Record]]:
    """Group records whose reasons differ only in numbers, the largest group first."""
    groups: defaultdict[str, list[Record]] = defaultdict(list)
    for record in records:
        groups[re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "#", record.reason)].append(record)
    return sorted(groups.values(), key=len, reverse=True)


def duration(seconds: float) -> str:
    """Write a duration for people: 0.4 s, 12 s, 3 min 20 s, 5 h 10 min, 3 d 4 h."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    for unit, name, part, part_name in ((86400, "d", 3600, "h"), (3600, "h", 60, "min"), (60, "min", 1, "s")):
        if whole >= unit:
            return f"{whole // unit} {name} {whole % unit // part} {part_name}"
    return f"{whole} s"
