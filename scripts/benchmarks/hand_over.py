"""Measure how long MPI's rank 0 takes to hand a case over; under `mpirun -n 2`, prints JSON.

The cases are real, with their configuration and FFTW's wisdom, but nothing is computed on the other rank.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks.common import default_case

from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.schedule import Outcome
from gfmdlayer.execution.sweep import Case
from gfmdlayer.execution.workers import WorkerPool, assemble
from gfmdlayer.simulation import simulate, warm_up
from gfmdlayer.verification.runs import Recording

CASES, REPETITIONS = 300, 3


def nothing(case: Case, **_: object) -> Outcome:
    """Stand in for the run of a case."""
    return Outcome(case.index, "complete")


def main() -> None:
    """Measure seconds a case: of rank 0's processor, from hand-over to result, and while rank 0 computes."""
    with assemble() as pool:
        if pool is not None:
            config = default_case(grid__points=4096)
            wisdom = warm_up(config)
            task = partial(nothing, folder=Folder(Path()), wisdom={config.grid.points: wisdom})
            every = [Case(index, config, {"layer.thickness": 0.05}) for index in range(CASES)]
            idle = [_exchange(pool, task, every) for _ in range(REPETITIONS)]
            over = threading.Event()
            worker = threading.Thread(target=_compute, args=(over, config, wisdom))
            worker.start()
            busy = [_exchange(pool, task, every)["round_trip"] for _ in range(REPETITIONS)]
            over.set()
            worker.join()
            best = {key: min(found[key] for found in idle) for key in idle[0]}
            print(json.dumps({**best, "round_trip_computing": min(busy)}))


def _exchange(pool: WorkerPool, task: Callable[[Case], Outcome], every: list[Case]) -> dict[str, float]:
    clock, processor = time.perf_counter(), time.process_time()
    futures = [pool.executor.submit(task, case) for case in every]
    submitted = time.perf_counter()
    for future in futures:
        future.result()
    return {
        "submission": (submitted - clock) / CASES,
        "service": (time.process_time() - processor) / CASES,
        "round_trip": (time.perf_counter() - clock) / CASES,
    }


def _compute(over: threading.Event, config: object, wisdom: str) -> None:
    def stop(_: float) -> None:
        if over.is_set():
            raise InterruptedError

    try:
        while True:
            simulate(config, Recording(), stop, wisdom)  # type: ignore[arg-type]
    except InterruptedError:
        return


if __name__ == "__main__":
    main()
