"""Pools of workers that compute cases: this process, N processes, or the ranks of an MPI job.

Each is a `concurrent.futures.Executor` to the schedule. This process computes too, alone or as the first of
them: a thread serves the others, and the kernels release the GIL.

Processes are spawned, never forked: a fork would copy the state of FFTW's planner, of HDF5 and of Numba's
threads at an arbitrary moment. MPI is imported only where a launcher's variables are found.
"""

from __future__ import annotations

import os
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, MutableMapping
from concurrent.futures import Executor, Future, InvalidStateError, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from multiprocessing import active_children, get_context, parent_process
from typing import Any, NoReturn

from gfmdlayer.errors import GfmdlayerError
from gfmdlayer.grid.library import cores
from gfmdlayer.study import interrupts, preflight

MOST = 1 << 14  # processes, and threads of one
IN_VAIN = 3  # renewals without a case that ends: a script may lack its guard
RENEWALS = 100  # of a pool of processes whose workers were killed, at most
SWITCH_INTERVAL = 0.0005  # seconds; with Python's 0.005 ranks wait a tenth of the time where cases are tiny


class LauncherError(GfmdlayerError):
    """The processes were started in a way that cannot work; the message names the remedy."""


@dataclass(frozen=True)
class WorkerPool:
    """A pool of workers."""

    executor: Executor  # computes submitted cases
    size: int  # number of cases that run at a time, one of them in the submitting thread
    kind: str  # kind of the workers, for the log
    starts_late: bool = False  # whether workers are started with the first submitted case, in seconds
    starting: Callable[[], AbstractContextManager[None]] = nullcontext  # context in which cases are submitted
    warnings: tuple[str, ...] = ()  # warnings on the way in which the workers were started
    check: Callable[[], None] = lambda: None  # raises the error that has ended the pool, if any

    @property
    def alone(self) -> bool:
        """Whether the submitting thread is the only one that computes."""
        return self.size == 1


class _NoWorkers(Executor):
    """An executor without workers: submitted cases stay pending until the submitting thread takes them."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ARG002
        return Future()


def threads_each(
    environment: MutableMapping[str, str], asked: int | None = None, jobs: int = 2
) -> int | None:
    """Set the threads of libraries before their import; return those for the transforms of a process.

    None, by the size of a case, is for a process that has the machine for itself.
    """
    if asked is not None:
        if not 1 <= asked <= MOST:
            raise LauncherError(f"--threads {asked}: must be from 1 to {MOST}")
        environment["OMP_NUM_THREADS"] = str(asked)
    alone = jobs == 1 and preflight.launched_size(environment) in (None, 1) and len(cores()) > 1
    by_size = alone and "OMP_NUM_THREADS" not in environment
    for variable in preflight.THREAD_VARIABLES:
        environment.setdefault(variable, "1")
    count = environment["OMP_NUM_THREADS"].partition(",")[0]
    return None if by_size else max(int(count), 1) if count.isdecimal() else 1


def assemble(
    jobs: int = 1, prepare: Callable[[], None] | None = None
) -> AbstractContextManager[WorkerPool | None]:
    """Assemble the pool: MPI's ranks under a launcher, else `jobs` processes, else this process.

    Other ranks than the first call `prepare`, and get None after the run.
    """
    if not 1 <= jobs <= MOST:
        raise LauncherError(f"--jobs {jobs}: must be from 1 to {MOST}")
    size = preflight.launched_size(os.environ)
    comm = None if size in (None, 1) else world(size or 0)
    if comm is not None and comm.Get_size() > 1:
        if jobs > 1:
            raise LauncherError("--jobs N and mpirun exclude each other: leave --jobs out")
        return ranks(comm, prepare)
    return processes(jobs) if jobs > 1 else alone()


@contextmanager
def alone() -> Iterator[WorkerPool]:
    """Give the pool of this process alone."""
    yield WorkerPool(_NoWorkers(), 1, "process", warnings=_warnings([_host_and_cores()]))


def _host_and_cores() -> tuple[str, preflight.Cores]:
    return socket.gethostname(), cores()


def _warnings(members: list[tuple[str, preflight.Cores]]) -> tuple[str, ...]:
    return tuple(preflight.crowding(members, preflight.threads(os.environ)))


class _Processes(Executor):
    """Worker processes; a new pool replaces one that broke because a worker died, unless none ends a case."""

    def __init__(self, number: int) -> None:
        self._number, self._renewals, self._vain = number, RENEWALS, 0
        self._others, self._held = frozenset(active_children()), set[Future[Any]]()
        self._pool = self._new_pool()
        self._failure: BaseException | None = None

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        try:
            future = self._pool.submit(fn, *args, **kwargs)
        except BrokenProcessPool:
            if self._renewals == 0 or self._vain == IN_VAIN:
                raise
            self._vain += 1
            self._renewals -= 1
            self._give_up_lost()
            self._pool = self._new_pool()
            future = self._pool.submit(fn, *args, **kwargs)
        self._held.add(future)
        future.add_done_callback(self._note)
        return future

    def _give_up_lost(self) -> None:
        """End the cases that a broken pool took at the moment in which it broke: it forgets them."""
        with suppress(RuntimeError):  # of a thread that did not start
            self._pool.shutdown()
        for future in [*self._held]:
            if not future.done():
                future.set_exception(BrokenProcessPool("a worker ended before the case"))

    def _note(self, future: Future[Any]) -> None:
        self._held.discard(future)
        if not (future.cancelled() or future.exception()):
            self._vain = 0

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers at once: no case is at work, and some may still be starting."""
        self._kill()
        with suppress(RuntimeError) if self._failure else nullcontext():  # of a thread that did not start
            self._pool.shutdown(wait, cancel_futures=cancel_futures)

    def fail(self, error: BaseException | None) -> None:
        """End the workers; those of a pool that lacks its threads would wait for ever."""
        if isinstance(error, InvalidStateError):
            # A worker died while a cancelled future was held, with which Python before 3.12.1 cannot deal.
            self._kill()
            for future in list(self._held):
                with suppress(InvalidStateError):
                    future.set_exception(BrokenProcessPool("a worker died"))
            return
        self._failure = self._failure or error
        self._kill()

    def check(self) -> None:
        """Raise the error that has ended a thread of the pool, which answers no more."""
        if self._failure:
            raise self._failure

    def _kill(self) -> None:
        for process in frozenset(active_children()) - self._others:
            process.kill()

    def _new_pool(self) -> ProcessPoolExecutor:
        with interrupts.signals_blocked():  # also in the process that keeps the pool's semaphores
            return ProcessPoolExecutor(self._number, get_context("spawn"), initializer=_begin_worker)


@contextmanager
def processes(jobs: int) -> Iterator[WorkerPool]:
    """Give the pool of this process and others on this host, `jobs` in all."""
    warnings = _warnings([_host_and_cores()] * jobs)
    try:
        executor = _Processes(jobs - 1)
    except OSError as error:  # names no file
        need = "room in /dev/shm, files (ulimit -n, -f) and processes (ulimit -u)"
        raise LauncherError(f"--jobs {jobs}: cannot be prepared ({error.strerror}); needs {need}") from None
    before, threading.excepthook = threading.excepthook, lambda args: executor.fail(args.exc_value)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    with executor:
        try:
            starting, check = interrupts.signals_blocked, executor.check
            yield WorkerPool(executor, jobs, "processes", True, starting, warnings, check)
        except Exception as error:
            executor.fail(error)
            raise
        finally:
            threading.excepthook = before
            sys.setswitchinterval(interval)


def _begin_worker() -> None:
    interrupts.listen_and_unblock()
    parent = parent_process()
    if parent is not None:
        try:
            interrupts.end_after(parent.join)
        except RuntimeError:  # no thread can be started, as the pool will notice
            os._exit(1)


def world(size: int) -> Any:
    """Return the communicator of all ranks; a launcher started `size` of them, 0 where it does not tell."""
    interrupts.end_with(os.getppid())  # before MPI starts, which does not notice that a launcher dies then
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:
        raise LauncherError(
            f"started by an MPI launcher, but MPI does not load ({error}): install mpi4py and the MPI "
            "library that the launcher belongs to, or `pip install 'gfmdlayer[mpi]'` and use the mpirun that "
            "comes with it"
        ) from None
    comm = MPI.COMM_WORLD
    if size > 1 and comm.Get_size() == 1:
        library = MPI.Get_library_version().splitlines()[0].strip("\0 ")
        raise LauncherError(
            f"the launcher started {size} processes, but the MPI library of each ({library}) sees only one: "
            "use that library's mpirun, or srun with the --mpi type that it knows (see srun --mpi=list)"
            + "".join(f"; {warning}" for warning in preflight.several_mpi_libraries())
        )
    return comm


@contextmanager
def guarded(comm: Any) -> Iterator[Callable[..., NoReturn]]:
    """End all ranks with any of them; give the function that ends them after an exception."""

    def abort(*details: Any) -> NoReturn:
        if problem := preflight.machine_problem(details[1]):
            sys.stderr.write(f"gfmdlayer: {problem}\n")
        else:
            traceback.print_exception(*details)
        sys.stderr.flush()
        comm.Abort(1)  # the other ranks would wait for this one for ever
        raise AssertionError("unreachable")

    sys.excepthook = abort
    threading.excepthook = lambda args: abort(args.exc_type, args.exc_value, args.exc_traceback)
    try:
        yield abort
    except (Exception, SystemExit, KeyboardInterrupt):  # Python would wait for the other ranks at its end
        abort(*sys.exc_info())


@contextmanager
def ranks(comm: Any, prepare: Callable[[], None] | None) -> Iterator[WorkerPool | None]:
    """Assemble the pool of the ranks of a communicator; see `assemble`."""
    from mpi4py.futures import MPICommExecutor

    with guarded(comm) as abort:
        members = comm.gather(_host_and_cores())
        if comm.Get_rank() != 0 and prepare is not None:
            prepare()
        executor: Any
        with MPICommExecutor(comm, root=0) as executor:
            if executor is not None:
                # The thread that serves the other ranks waits until this one releases the interpreter.
                sys.setswitchinterval(SWITCH_INTERVAL)
                try:
                    warnings = (*_warnings(members), *preflight.several_mpi_libraries())
                    yield WorkerPool(executor, comm.Get_size(), "MPI ranks", warnings=warnings)
                except (Exception, SystemExit, KeyboardInterrupt):
                    abort(*sys.exc_info())  # the other ranks would finish their cases first
        if comm.Get_rank() != 0:
            yield None
