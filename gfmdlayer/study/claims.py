"""Claims: the process that computes a case, and the processes that use the folder.

`cases/NNNN.running` is the claim of a process on a case. It is made whole under its name, which fails where
another process has made it before (a hard link, which network file systems too make once). The process
writes its progress into it at most once a second, and a thread renews it during long steps. A claim is dead
if its process does not exist any more, or, on another host, after `SILENCE` without a sign: that is measured
between the dates of two files, which the file server sets, so that clocks of hosts may differ. A dead claim
is replaced by rename. Its former process may only have been suspended: it looks at the claim before it
writes, and gives the case up where the claim is not its own. So a case that was claimed is computed once as
long as its process gives a sign, and in the worst case twice, to the same bits.

A process that gives a claim back keeps its file, renamed, for the next claim until the run ends. A file made
and removed for each case takes a file system longer than all else that a short case writes.

`cases/.lock` is locked by all runs that share the folder, and locked against all others while the folder's
configuration or all of its results are replaced, or files of dead runs are removed.
"""

from __future__ import annotations

import json
import math
import os
import secrets
import socket
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from functools import cache
from pathlib import Path
from typing import IO, Annotated, Any, Self

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as pydantic_dataclass

from gfmdlayer.files.locks import (
    born,
    is_gone,
    no_link,
    read_json,
    read_small,
    regular_and_no_link,
    try_lock,
    write_new,
)
from gfmdlayer.files.whole import unfinished_path, write_text
from gfmdlayer.study.folder import Folder, FolderError
from gfmdlayer.study.interrupts import Listener, Stopped, stop_requested

WRITE_INTERVAL = 1.0  # seconds between two states of a case
RENEWAL = 20.0  # seconds between two signs of a claim during a long step
SILENCE = 120.0  # seconds without a sign after which a claim of another host is dead
PATIENCE = 10.0  # seconds for which a run waits for another one that prepares the folder
SETTLED = 0.05  # seconds after which two processes that replace the same dead claim see whose it is
STEPS_TRUSTED = 0.9  # part of the expected steps, beyond which only the simulated time tells the progress
_MOST = 2**63  # of numbers in a claim
_POLL = 0.1  # seconds between two looks at the lock


class Taken(Exception):  # noqa: N818 - no error: the case is computed elsewhere
    """Another process has claimed the case, before or since."""


class Claim:
    """The claim of this process on a case, with its progress; a context manager around the simulation.

    `expected` is the number of steps. With `together` several ranks agree on a stop, after the first step.
    A file system that refuses the claim (it is full, say) does not stop the case.
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
        self._folder, self._path = folder, folder.case(index, "running")
        self._spare = folder.spare(index, os.getpid()) if folder.run else None
        self._stop, self._together = folder.stop, together
        self._written = self._looked = -math.inf  # when the claim was written, and when it was still this one
        self._token, self._known = secrets.token_hex(8), b""
        case = {"started": time.time(), "end": end, "label": label, "expected": expected}
        self._fixed: dict[str, object] = _process(os.getpid()) | case
        self._steps = -1  # the call on entering is not a step

    def __enter__(self) -> Self:
        """Take the claim; `Taken` where another process has it."""
        with suppress(OSError):
            self._take()
        _claims.add(self)
        _keeper()
        try:
            with suppress(Stopped) if self._together else nullcontext():
                self.advance(0.0)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *details: object) -> None:
        _claims.discard(self)
        with suppress(OSError):
            if time.monotonic() - self._looked < WRITE_INTERVAL or self._is_own():
                self._give_back()

    def advance(self, simulated_time: float) -> None:
        """Record the time reached; `Stopped` after a signal or with a stop file, `Taken` for a lost claim."""
        self._steps += 1
        if self._steps == 1:  # a resumed case begins late, and the first step takes longest
            self._fixed |= {"since": time.time(), "since_time": float(simulated_time)}
        now = time.monotonic()
        due = now - self._written >= WRITE_INTERVAL
        if due:
            self.confirm()
            if is_gone(self._stop.parent):
                raise Stopped  # somebody has removed the folder
        with suppress(OSError):  # the folder may be unreadable for a while
            if stop_requested() or ((due or not self._steps) and self._stop.exists()):
                raise Stopped
        if due:
            self._written = now
            with suppress(OSError):  # a simulation does not fail for its status
                write_text(self._path, self._content(simulated_time), durable=False)

    def confirm(self) -> None:
        """Raise `Taken` where another process has taken the claim over, after a long silence of this one."""
        if not self._is_own():
            raise Taken(f"{self._path.name} was taken over by another process")

    def renew(self) -> None:
        """Give a sign of life."""
        with suppress(OSError):
            if self._is_own():
                os.utime(self._path, follow_symlinks=False)

    def _content(self, simulated_time: float = 0.0) -> str:
        reached = {"simulated_time": float(simulated_time), "steps": max(self._steps, 0)}
        return json.dumps(self._fixed | reached | {"updated": time.time(), "token": self._token})

    def _is_own(self) -> bool:
        """Whether the claim is that of this process, or nobody's."""
        with suppress(OSError):
            if read_small(self._path) == self._known:
                self._looked = time.monotonic()
                return True
        claim = read_json(self._path)
        own = claim is None or claim.get("token") == self._token
        self._looked = time.monotonic() if own else -math.inf
        return own

    def _give_back(self) -> None:
        if self._spare is None:
            self._path.unlink(missing_ok=True)
        else:
            self._path.replace(self._spare)
            _spares[self._folder] = self._spare

    def _prepared(self) -> Path:
        """Write the claim into the file of an earlier one of this process, or into a new one."""
        self._known, spare = self._content().encode(), _spares.pop(self._folder, None)
        if spare is not None:
            with suppress(OSError), open(spare, "r+b", buffering=0, opener=regular_and_no_link) as file:
                # Of another link it is also another file of this user. Emptied first, it would be written to
                # the disk at once.
                if (
                    os.fstat(file.fileno()).st_nlink == 1
                    and file.write(self._known) == len(self._known) == file.truncate()
                ):
                    return spare
        part = unfinished_path(self._path)
        write_new(part, self._known)
        return part

    def _take(self) -> None:
        part = self._prepared()
        try:
            os.link(part, self._path)
        except OSError:  # there is one, or the file system has no hard links
            if _sign_of_life(self._path, part.stat().st_mtime):
                raise Taken(f"{self._path.name} exists") from None
            part.replace(self._path)
            time.sleep(SETTLED)
            self.confirm()
        finally:
            part.unlink(missing_ok=True)
        self._written = self._looked = time.monotonic()


@cache
def _process(pid: int) -> dict[str, object]:
    return {"host": socket.gethostname(), "pid": pid, "born": born()}


_claims: set[Claim] = set()  # of this process
_spares: dict[Folder, Path] = {}  # its file for the next claim in a folder


@cache
def _keeper() -> None:
    """Start the thread that renews the claims; the kernels release the interpreter."""

    def renew() -> None:
        while True:
            time.sleep(RENEWAL)
            for claim in list(_claims):
                claim.renew()

    with suppress(RuntimeError):  # no thread can be started: the steps renew the claims
        threading.Thread(target=renew, daemon=True).start()


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
    token: str = ""

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

    def alive(self, silence: float) -> bool:
        """Whether the process exists; on another host, whether it gave a sign within the last seconds."""
        if self.host != socket.gethostname():
            return abs(silence) < SILENCE  # also where a clock was set back
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return False
        except PermissionError:
            pass
        return self.born in ("", born(self.pid))  # not another one, with the number of a dead one


class AtWork(Listener):
    """Stands in for the claim on a case in memory: its progress, for a display of this process."""

    def __init__(self, index: int, end: float, label: str, expected: int = 0) -> None:
        self.index, self._end, self._label, self._started = index, end, label, time.time()
        self._expected = expected
        self._steps, self._time, self._since = 0, 0.0, (math.nan, math.nan)

    def advance(self, simulated_time: float) -> None:
        """Record the time reached; `Stopped` after a signal."""
        super().advance(simulated_time)
        self._steps, self._time = self._steps + 1, float(simulated_time)
        if self._steps == 1:
            self._since = time.time(), self._time

    @property
    def running(self) -> Running:
        """The status of the case."""
        status: dict[str, Any] = {
            "host": socket.gethostname(), "pid": os.getpid(), "label": self._label, "started": self._started,
            "since": self._since[0], "since_time": self._since[1], "updated": time.time(),
            "expected": self._expected,
        }  # fmt: skip
        return Running(self.index, **status, simulated_time=self._time, end=self._end, steps=self._steps)


def read_claim(path: Path) -> Running | None:
    """Read the claim on a case; None where there is none or it holds something else."""
    content: dict[str, Any] = read_json(path) or {}
    with suppress(TypeError, ValueError):
        return Running(**content, index=int(path.stem))
    return None


def _sign_of_life(path: Path, now: float) -> bool:
    """Whether the process of a claim computes; `now` by the clock that dates the files of the folder."""
    try:
        silence = now - path.lstat().st_mtime
    except FileNotFoundError:
        return False
    claim = read_claim(path)
    return abs(silence) < SILENCE if claim is None else claim.alive(silence)


def running(folder: Folder, begun: Iterable[int] | None = None) -> list[Running]:
    """Return the claims of living processes, in the order of cases; `begun` are those with a claim."""
    claims = []
    for index in sorted(folder.numbers()["running"] if begun is None else begun):
        path = folder.case(index, "running")
        with suppress(OSError):
            claim = read_claim(path)
            if claim is not None and claim.alive(time.time() - path.lstat().st_mtime):
                claims.append(claim)
    return claims


class Lock:
    """The lock of a folder, shared with other runs from `share` on."""

    def __init__(self, folder: Folder, file: IO[str]) -> None:
        self._folder, self._file = folder, file
        self._granted = try_lock(file)  # None on a file system without locks
        if self._granted is False:
            self.share()

    def is_alone(self, patience: float = 0.0) -> bool:
        """Whether no other run uses the folder; processes of a killed one may end within `patience`."""
        if self._granted is False:
            return False
        end = time.monotonic() + patience
        while running(self._folder):
            if time.monotonic() >= end or stop_requested():
                return False
            time.sleep(_POLL)
        return True

    def share(self) -> None:
        """Let other runs in; FolderError where another command keeps all others out."""
        end = time.monotonic() + PATIENCE
        while try_lock(self._file, shared=True) is False:
            if time.monotonic() >= end or stop_requested():
                raise in_use(self._folder, "another run is writing here")
            time.sleep(_POLL)


@contextmanager
def locked(folder: Folder) -> Iterator[Lock]:
    """Lock the folder for the block."""
    with open(folder.cases / ".lock", "a+", opener=no_link) as file:
        yield Lock(folder, file)


@contextmanager
def leftovers(folder: Folder) -> Iterator[list[Path]]:
    """Find the files that killed runs left; no run begins in the folder until the block ends."""
    folder.must_hold_results()
    if at_work := running(folder):  # also where a file system has no locks
        raise in_use(folder, f"another run is writing here, on {at_work[0].host}")
    with locked(folder) if folder.cases.is_dir() else nullcontext() as lock:
        if lock is not None and not lock.is_alone():
            raise in_use(folder, "another run is writing here")
        yield sorted({*folder.leftovers(), *folder.unfinished()})


def in_use(folder: Folder, reason: str) -> FolderError:
    """Return the error where others use the folder."""
    return FolderError(f"{folder.path}: {reason}; wait for it to end")
