"""Where cases run: in this process, in N processes, or on the ranks of an MPI job.

All three are one `concurrent.futures.Executor` to the sweep.  Where this process has hands free, it joins in:
alone it takes the cases in their order, beside MPI workers it takes pending ones off the tail, so that rank 0
computes as well (`mpi4py.futures` serves the other ranks from a thread; the kernels release the GIL).

Processes are spawned, never forked: a fork would copy the state of FFTW's planner, of HDF5 and of Numba's
threads in whatever condition it is.  MPI is imported only where a launcher's variables are found.
"""

from __future__ import annotations

import os
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from typing import Any, NoReturn

from gfmdlayer.execution import guards, interrupts

# By which launchers tell a process how many of it they started: MPICH and Slurm's pmi2, Open MPI, srun.
SIZE_VARIABLES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS")
# Variables that show a launcher without saying a size.
RANK_VARIABLES = ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK")
RENEWALS = 100  # of a pool of processes; what kills its workers again and again will not stop
SWITCH_INTERVAL = 0.0005  # seconds; with Python's 0.005 others wait a tenth of the time where cases are tiny


class LauncherError(Exception):
    """The way in which the processes were started cannot work; the message says what to do."""


@dataclass(frozen=True)
class WorkerPool:
    """Those who run the cases.

    Attributes
    ----------
    executor : concurrent.futures.Executor
        Takes the cases.
    size : int
        How many cases run at a time.
    kind : str
        What the members are, for the log.
    joins : bool
        Whether the submitting thread takes pending cases itself.
    starting : callable
        Context in which cases are submitted.
    warnings : tuple of str
        What the user should know about the way in which they were started.
    """

    executor: Executor
    size: int
    kind: str
    joins: bool
    starting: Callable[[], AbstractContextManager[None]] = nullcontext
    warnings: tuple[str, ...] = ()

    @property
    def alone(self) -> bool:
        """Whether the submitting thread is the only one that computes."""
        return self.size == 1 and self.joins


class _NoWorkers(Executor):
    """An executor without workers: what is submitted stays pending until the submitting thread takes it."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ARG002
        return Future()


def launched_size(environment: Mapping[str, str]) -> int | None:
    """Return the number of processes that an MPI launcher started.

    Parameters
    ----------
    environment : mapping of str to str
        Environment variables, such as `os.environ`.

    Returns
    -------
    int or None
        The size; 0 where there is a launcher that does not tell it; None where there is no launcher.
    """
    for variable in SIZE_VARIABLES:
        value = environment.get(variable, "")
        if value.isdecimal():
            return int(value)
    return 0 if any(variable in environment for variable in RANK_VARIABLES) else None


def threads_each(environment: MutableMapping[str, str], asked: int | None = None) -> int:
    """Ask the numerical libraries for one thread a process, unless the user asked for something else.

    Must come before they are imported.

    Parameters
    ----------
    environment : mapping of str to str
        Environment variables, such as `os.environ`.
    asked : int, optional
        Threads for the transforms of a process; by default what OMP_NUM_THREADS says, which FFTW's obey.

    Returns
    -------
    int
        Threads for the transforms of a process.

    Raises
    ------
    LauncherError
        Where fewer than one is asked for.
    """
    if asked is not None:
        if asked < 1:
            raise LauncherError(f"--threads {asked}: must be 1 or more")
        environment["OMP_NUM_THREADS"] = str(asked)
    for variable in guards.THREAD_VARIABLES:
        environment.setdefault(variable, "1")
    found = environment["OMP_NUM_THREADS"].partition(",")[0]
    return max(int(found), 1) if found.isdecimal() else 1


@contextmanager
def assemble(jobs: int = 1, prepare: Callable[[], None] | None = None) -> Iterator[WorkerPool | None]:
    """Assemble the pool: MPI's ranks under a launcher, else `jobs` processes, else this process alone.

    Parameters
    ----------
    jobs : int
        Number of processes, where there is no MPI.
    prepare : callable, optional
        What MPI's other ranks do while rank 0 makes ready, such as imports.

    Yields
    ------
    WorkerPool or None
        None on MPI's other ranks, after they have served to the end.

    Raises
    ------
    LauncherError
        Where `jobs` is below 1 or asked for under MPI, or launcher and MPI library do not know each other.
    """
    if jobs < 1:
        raise LauncherError(f"--jobs {jobs}: must be 1 or more")
    size = launched_size(os.environ)
    comm = None if size in (None, 1) else _world(size or 0)
    if comm is not None and comm.Get_size() > 1:
        if jobs > 1:
            raise LauncherError("--jobs N and mpirun exclude each other: leave --jobs out")
        with _ranks(comm, prepare) as pool:
            yield pool
    elif jobs > 1:
        with _processes(jobs) as pool:
            yield pool
    else:
        yield WorkerPool(_NoWorkers(), 1, "process", joins=True, warnings=_warnings([_here()]))


def _here() -> tuple[str, guards.Cores]:
    return socket.gethostname(), guards.cores()


def _warnings(members: list[tuple[str, guards.Cores]]) -> tuple[str, ...]:
    return tuple(guards.crowding(members, guards.threads(os.environ)))


class _Processes(Executor):
    """Worker processes, and others in their place when one of them has died and broken the pool."""

    def __init__(self, jobs: int) -> None:
        self._jobs, self._renewals = jobs, RENEWALS
        self._pool = self._new_pool()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        try:
            return self._pool.submit(fn, *args, **kwargs)
        except BrokenProcessPool:
            if self._renewals == 0:
                raise
            self._renewals -= 1
            self._pool = self._new_pool()
            return self._pool.submit(fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._pool.shutdown(wait, cancel_futures=cancel_futures)

    def _new_pool(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self._jobs, get_context("spawn"), initializer=_begin_worker)


@contextmanager
def _processes(jobs: int) -> Iterator[WorkerPool]:
    warnings = _warnings([_here()] * jobs)
    with _Processes(jobs) as executor:
        yield WorkerPool(executor, jobs, "processes", False, interrupts.held_back, warnings)


def _begin_worker() -> None:
    interrupts.listen_and_release()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)  # a killed run must not leave workers behind that write into its folder


def _world(size: int) -> Any:
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:
        raise LauncherError(
            f"started by an MPI launcher, but MPI does not load ({error}): install the MPI library that the "
            "launcher belongs to, or `pip install 'gfmdlayer[mpich]'` and use the mpirun that comes with it"
        ) from None
    comm = MPI.COMM_WORLD
    if size > 1 and comm.Get_size() == 1:
        library = MPI.Get_library_version().splitlines()[0].strip("\0 ")
        raise LauncherError(
            f"the launcher started {size} processes, but each is alone to its MPI library ({library}): "
            "use that library's mpirun, or srun with the --mpi type that it knows (see srun --mpi=list)"
            + "".join(f"; {warning}" for warning in guards.several_mpi_libraries())
        )
    return comm


@contextmanager
def _ranks(comm: Any, prepare: Callable[[], None] | None) -> Iterator[WorkerPool | None]:
    from mpi4py.futures import MPICommExecutor

    def abort(*details: Any) -> NoReturn:
        traceback.print_exception(*details)
        sys.stderr.flush()
        comm.Abort(1)  # the other ranks would wait for this one for ever
        raise AssertionError("unreachable")

    sys.excepthook = abort
    threading.excepthook = lambda args: abort(args.exc_type, args.exc_value, args.exc_traceback)
    members = comm.gather(_here())
    if comm.Get_rank() != 0 and prepare is not None:
        prepare()
    executor: Any
    with MPICommExecutor(comm, root=0) as executor:
        if executor is not None:
            # The thread that serves the others has to wait for this one to let go of the interpreter.
            sys.setswitchinterval(SWITCH_INTERVAL)
            try:
                warnings = (*_warnings(members), *guards.several_mpi_libraries())
                yield WorkerPool(executor, comm.Get_size(), "MPI ranks", joins=True, warnings=warnings)
            except Exception:
                abort(*sys.exc_info())  # rather than wait until the others have done what they are at
    if comm.Get_rank() != 0:
        yield None
