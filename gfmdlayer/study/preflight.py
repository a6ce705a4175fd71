"""Checks of the machine before a run: cores, MPI, disk and memory; words on its errors."""

from __future__ import annotations

import errno
import os
import resource
import shutil
from collections import Counter
from collections.abc import Iterable, Mapping
from concurrent.futures import BrokenExecutor
from pathlib import Path

from gfmdlayer.files.locks import printable
from gfmdlayer.results.provenance import UNKNOWN, version_of

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
# Set by launchers to the number of processes: MPICH and Slurm's pmi2, Open MPI, srun.
SIZE_VARIABLES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS")
# Set by launchers that may not set a number.
RANK_VARIABLES = ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK")
MPI_PACKAGES = ("mpich", "openmpi", "impi-rt")

ESTIMATED = 1.5  # largest ratio of the estimated memory of a case to the memory that it takes

Cores = frozenset[int]


def threads(environment: Mapping[str, str]) -> int:
    """Return the largest number of threads that a numerical library uses in a process."""
    numbers = [environment.get(variable, "").partition(",")[0] for variable in THREAD_VARIABLES]
    return max((int(value) for value in numbers if value.isdecimal()), default=1)


def crowding(members: Iterable[tuple[str, Cores]], threads: int) -> list[str]:
    """Name the most crowded host on which more threads compute than there are cores."""
    processes: Counter[str] = Counter()
    usable: dict[str, Cores] = {}
    for host, allowed in members:
        processes[host] += 1
        usable[host] = usable.get(host, frozenset()) | allowed
    crowded = [host for host in processes if processes[host] * threads > len(usable[host])]
    if not crowded:
        return []
    worst = max(crowded, key=lambda host: processes[host] * threads / len(usable[host]))
    others = f" (and {len(crowded) - 1} more hosts)" if crowded[1:] else ""
    own = "one thread" if threads == 1 else f"{threads} threads"
    return [
        f"{processes[worst]} processes with {own} each on {len(usable[worst])} cores of {worst}{others}: "
        "they wait for each other; start fewer, set OMP_NUM_THREADS=1, or give them more cores"
    ]


def launched_size(environment: Mapping[str, str]) -> int | None:
    """Return the number of processes of an MPI launcher: 0 if it sets no number, None without a launcher."""
    for variable in SIZE_VARIABLES:
        value = environment.get(variable, "")
        if value.isdecimal():
            return int(value)
    return 0 if any(variable in environment for variable in RANK_VARIABLES) else None


def several_mpi_libraries() -> list[str]:
    """Warn of two MPI libraries in one Python environment: mpirun and the ranks may use different ones."""
    installed = [f"{name} {version}" for name in MPI_PACKAGES if (version := version_of(name)) != UNKNOWN]
    if len(installed) < 2:
        return []
    return [
        f"two MPI libraries in one environment ({', '.join(installed)}): mpirun may belong to one and the "
        "ranks may load the other; uninstall one of them"
    ]


def disk_warnings(directory: Path, needed: float) -> list[str]:
    """Warn of a disk that is too small for the bytes needed; its folder may not exist yet."""
    existing = next(path for path in (directory.absolute(), *directory.absolute().parents) if path.exists())
    free = shutil.disk_usage(existing).free
    if needed <= free:
        return []
    return [f"{directory}: about {in_bytes(needed)} will be written, but only {in_bytes(free)} are free"]


def memory_warnings(per_process: float, number: int = 1) -> list[str]:
    """Warn of processes that need more bytes than they may have; `per_process` is an estimate."""
    for limit, whose, together in memory_limits():
        if (needed := per_process * (number if together else 1)) > limit:
            processes = f" by {number} processes" * (together and number > 1)
            return [
                f"about {in_bytes(needed)} of memory are needed{processes}, but {whose} {in_bytes(limit)}: "
                f"take fewer grid.points{' or --jobs' * bool(processes)}"
            ]
    return []


def memory_refusal(per_process: float, number: int = 1) -> list[str]:
    """Return why processes cannot have the memory that they need, also if the estimate is too high."""
    return memory_warnings(per_process, number) if memory_warnings(per_process / ESTIMATED, number) else []


def memory_limits() -> list[tuple[float, str, bool]]:
    """Return the limits of memory: bytes, words on them, and whether all processes together are meant."""
    present = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    limits = [(float(present), "this machine has", True)]
    slurm = (("SLURM_MEM_PER_NODE", "1"), ("SLURM_MEM_PER_CPU", os.environ.get("SLURM_CPUS_ON_NODE", "")))
    for variable, times in slurm:
        megabytes = os.environ.get(variable, "")
        if megabytes.isdecimal() and times.isdecimal() and int(megabytes) > 0:
            limits.append((float(megabytes) * int(times) * 2**20, f"Slurm ({variable}) allows", True))
    for kind, option in ((resource.RLIMIT_AS, "v"), (resource.RLIMIT_DATA, "d")):
        limit, _ = resource.getrlimit(kind)
        if limit != resource.RLIM_INFINITY:
            limits.append((float(limit), f"ulimit -{option} allows a process", False))
    return limits


def in_bytes(number: float) -> str:
    """Write a number of bytes for people."""
    for unit, size in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if number >= size:
            return f"{number / size:.3g} {unit}"
    return f"{number:.0f} B"


def machine_problem(error: BaseException) -> str:
    """Return the message of an error of the machine: of memory, files, processes; else nothing."""
    cause = f"{type(error).__name__}: {error}"
    words = f"{error} {error.__context__}"  # where a library cannot be mapped, others say it is not found
    unmapped = isinstance(error, ImportError | OSError) and "failed to map" in words
    if unmapped or isinstance(error, MemoryError):
        return f"memory does not suffice ({cause})"
    if isinstance(error, OSError) and error.errno == errno.EMFILE and not error.filename:
        return f"too many files are open at a time; `ulimit -n` must allow more ({cause})"
    unstarted = isinstance(error, BlockingIOError) and not error.filename
    if unstarted or isinstance(error, BrokenExecutor) or "can't start new thread" in str(error):
        return f"processes or threads cannot be started; `ulimit -u` must allow more ({cause})"
    if isinstance(error, OSError):
        named = f"{printable(str(error.filename))}: " if error.filename else ""
        return f"{named}{printable(error.strerror or cause)}"
    return ""
