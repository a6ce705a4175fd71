"""Runs of the command line, their processes, and signals to the processes."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

from trials.outcomes import Patience

MPIRUN = Path(sys.executable).parent / "mpirun"  # that of the environment's own MPI library
COMMAND = (sys.executable, "-m", "gfmdlayer")
WAYS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "forked": ((), ()),  # one process that starts with loaded libraries
    "serial": (COMMAND, ()),
    "processes": (COMMAND, ("--jobs", "2")),
    "ranks": ((str(MPIRUN), "-n", "2", *COMMAND), ()),
    "grids": ((str(MPIRUN), "-n", "2", *COMMAND), ("--ranks-per-case", "2")),
}
PR_CAPBSET_DROP, RIGHTS_OF_ROOT = 24, (1, 2)  # of Linux: to write, read and enter where permission is missing


@dataclass
class Limits:
    """Environment variables of a run, the largest file that it may write, whether permissions bind root."""

    environment: dict[str, str] = field(default_factory=dict)
    file_size: int | None = None
    bound: bool = False

    def apply(self) -> None:
        """Apply the limits to this process."""
        signal.signal(signal.SIGINT, signal.default_int_handler)  # which shells ignore in the background
        if self.file_size is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (self.file_size, self.file_size))
        if self.bound:
            for right in RIGHTS_OF_ROOT:
                ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, right, 0, 0, 0)


class Launch:
    """A started run of the command line; the file `log` has its output."""

    def __init__(self, way: str, arguments: tuple[str, ...], folder: Path, limits: Limits) -> None:
        self.log, (launcher, options) = folder / "log", WAYS[way]
        environment = os.environ | limits.environment
        with self.log.open("wb") as log:
            if launcher:
                command = (*launcher, *arguments, *options)
                self._process = subprocess.Popen(
                    command, cwd=folder, stdout=log, stderr=log, env=environment, preexec_fn=limits.apply
                )
                self.pid = self._process.pid
            else:
                self.pid = os.fork() or _be(arguments, folder, log.fileno(), environment, limits)
        self._forked, self.status = not launcher, None if launcher else self._look()

    def _look(self) -> int | None:
        found, status = os.waitpid(self.pid, os.WNOHANG)
        return None if found == 0 else os.waitstatus_to_exitcode(status)

    def poll(self) -> int | None:
        """Return the exit status, None while it runs."""
        if self.status is None:
            self.status = self._look() if self._forked else self._process.poll()
        return self.status

    def wait(self, seconds: float) -> float:
        """Wait for its end, at most this long; return the time."""
        patience = Patience(seconds)
        while self.poll() is None and patience:
            pass
        return patience.spent

    def family(self) -> list[int]:
        """Return its processes."""
        return [self.pid, *descendants(self.pid)] if self.poll() is None else []

    def crashed(self) -> bool:
        """Whether its output has a traceback; Python's own of an interrupt before `main` does not count."""
        told = self.text()
        interrupted = "init_import_site" in told or ("KeyboardInterrupt" in told and "in main" not in told)
        return "Traceback" in told and not interrupted

    def text(self) -> str:
        """Return its output."""
        return self.log.read_text(encoding="utf-8", errors="replace")


def _be(
    arguments: tuple[str, ...], folder: Path, log: int, environment: Mapping[str, str], limits: Limits
) -> int:
    """Turn a forked process into a run of the command line."""
    status = 70
    try:
        os.setsid()
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(environment)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGPROF):
            signal.signal(number, signal.SIG_DFL if number != signal.SIGINT else signal.default_int_handler)
        sys.modules["__main__"] = ModuleType("__main__")
        sys.stdout, sys.stderr = (open(n, "w", encoding="utf-8", closefd=False) for n in (1, 2))  # noqa: SIM115
        limits.apply()
        from gfmdlayer import cli

        try:
            status = cli.main(arguments)
        except SystemExit as error:
            status = error.code if isinstance(error.code, int) else 1
    except BaseException:
        import traceback

        traceback.print_exc()
        status = 1
    finally:
        with suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status)


def descendants(pid: int) -> list[int]:
    """Return the children of a process, and theirs."""
    parents: dict[int, list[int]] = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            state, parent = (entry / "stat").read_text().rpartition(")")[2].split()[:2]
            if state != "Z":
                parents.setdefault(int(parent), []).append(int(entry.name))
    found = [pid]
    for process in found:  # which grows in the loop
        found += parents.get(process, [])
    return found[1:]


def command(pid: int) -> str:
    """Return the command line of a process; empty after its end."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8", errors="replace")
    return ""


def waited(pid: int) -> float:
    """Return the seconds that a process waited for a processor."""
    with suppress(OSError, IndexError):
        return float(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9
    return 0.0


def alive(pid: int) -> bool:
    """Whether a process still runs; a zombie does not."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False
