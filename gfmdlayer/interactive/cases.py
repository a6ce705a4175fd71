"""Running cases in memory: one after the other in this process, or in several."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, as_completed
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from gfmdlayer.config import digest
from gfmdlayer.execution import case_run, interrupts, workers
from gfmdlayer.execution.schedule import Outcome
from gfmdlayer.execution.sweep import SweepCase, label
from gfmdlayer.files.cache import user_cache
from gfmdlayer.grid.wisdom import planned
from gfmdlayer.interactive.progress import Watch
from gfmdlayer.model import ConvergenceError, model_of
from gfmdlayer.results.journal import Recording

if TYPE_CHECKING:
    import xarray

GUARD = 'a script with jobs must call run under `if __name__ == "__main__":`'


class Result(NamedTuple):
    """Data of a case, or the error that it ended with, and the warnings of its observables."""

    data: xarray.Dataset | None
    error: Exception | None = None
    said: Sequence[str] = ()

    @property
    def reason(self) -> str:
        """Why it failed."""
        return f"{type(self.error).__name__}: {self.error}" if self.error else ""


def compute(
    case: SweepCase, wisdom: str | None, threads: int, advance: Callable[[float], None] | None = None
) -> tuple[xarray.Dataset, Sequence[str]]:
    """Run a case in memory; return its data and the warnings of its observables."""
    config = case.config
    model, recording = model_of(config, wisdom, threads), Recording()
    described = case_run.attributes(model) | {"digest": digest(config)}
    coordinates = model.coordinates
    try:
        said = model.run(recording, advance)
    except ConvergenceError as error:
        error.data = recording.dataset(coordinates, model.columns, described, config.unit)
        raise
    return recording.dataset(coordinates, model.columns, described, config.unit), said


def _attempt(
    case: SweepCase, wisdom: str | None, threads: int, advance: Callable[[float], None] | None = None
) -> Result:
    """Run a case of a sweep; an error becomes its result."""
    try:
        data, said = compute(case, wisdom, threads, advance)
    except interrupts.Stopped:
        raise
    except Exception as error:
        return Result(None, error)
    return Result(data, said=said)


def here(every: Sequence[SweepCase], threads: int, watch: Watch) -> Iterator[tuple[SweepCase, Result]]:
    """Run the cases one after the other."""
    for case in every:
        wisdom = planned(case.config.grid.points, user_cache(), threads)
        advance = watch.case(case.index, case.config.time.end, label(case.values))
        result = _attempt(case, wisdom, threads, advance)
        watch.ended(_outcome(case.index, result))
        yield case, result


def in_processes(
    every: Sequence[SweepCase], jobs: int, threads: int, watch: Watch
) -> Iterator[tuple[int, Result]]:
    """Run the cases in several processes."""
    wisdom, said = case_run.warm_up(every, threads)
    for line in said:
        warnings.warn(line, stacklevel=5)
    with pool_of(jobs) as pool:
        futures: dict[Future[Result], int] = {}
        try:
            with pool.starting():
                for case in every:
                    plan = wisdom.get(case.config.grid.points)
                    futures[pool.executor.submit(_attempt_in_process, case, plan, threads)] = case.index
            for future in as_completed(futures):
                result = _received(future)
                watch.ended(_outcome(futures[future], result))
                yield futures[future], result
        finally:
            for future in futures:
                future.cancel()


@contextmanager
def pool_of(jobs: int) -> Iterator[workers.WorkerPool]:
    """Start processes, and wait for the first: none starts where the script calls `run` when imported."""
    if jobs == 1:
        with workers.alone() as pool:
            yield pool
        return
    with workers.processes(jobs) as pool:
        with pool.starting():
            first = pool.executor.submit(int)
        try:
            first.result()
        except BrokenExecutor as error:
            raise RuntimeError(f"no process starts ({error}): {GUARD}") from None
        yield pool


def _attempt_in_process(case: SweepCase, wisdom: str | None, threads: int) -> Result:
    """Run a case of a sweep, unless this process is asked to stop."""
    result = _attempt(case, wisdom, threads, _stop_where_asked)
    if result.error is None or isinstance(result.error, ConvergenceError):
        return result
    return Result(None, RuntimeError(result.reason))  # errors of any class may not be sent


def _stop_where_asked(_time: float) -> None:
    if interrupts.stop_requested():
        raise interrupts.Stopped


def _received(future: Future[Result]) -> Result:
    try:
        return future.result()
    except BrokenExecutor as error:
        return Result(None, RuntimeError(f"its process ended: {error}"))


def _outcome(index: int, result: Result) -> Outcome:
    return Outcome(index, "failed" if result.error else "complete", result.reason)
