"""A sweep of line contacts, and whole runs on lines and surfaces, over their bare FFT pairs.

A case of the sweep has a line of 1024 points, adaptive steps and 200 rows. With `--against PATH` another
checkout of the package runs the same tasks in turns with this one.

As a script, `sweep.py CASES JOBS` is one rank, or the process, that runs the sweep; it prints its seconds.
"""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from benchmarks.common import Cell, Effort, Table, cpu_of_a_pair, cpu_seconds, mpirun, over_ranks
from benchmarks.tasks import Checkout, Times, line, surface, sweep

from gfmdlayer.case.case import Case
from gfmdlayer.case.model import warm_up
from gfmdlayer.config import Config
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.results.recording import Recording
from gfmdlayer.study.case_run import Checkpoints
from gfmdlayer.study.cases import Cases
from gfmdlayer.study.run import RunOptions, run_study
from gfmdlayer.study.workers import WorkerPool, assemble

EFFORT = Effort(points=(1 << 10, 1 << 12, 1 << 14), repetitions=5, cases=300)
QUICK = Effort(points=(1 << 8,), repetitions=2, cases=6)
LOOPS = {"compiled": False, "in Python": True}  # `stepwise` of a case
WAYS = {"one process": (1, 1), "jobs=2": (1, 2), "two ranks": (2, 1)}  # ranks, jobs
AXIS = 4  # points of an axis of a surface over the root of those of a line
_FEW = 3  # cases before a measurement, and those whose Python calls are counted


def measure(effort: Effort) -> Iterator[Table]:
    """Measure the sweep in one process and in several, then whole runs, then against the other checkout."""
    yield _loops(effort)
    yield _processes(effort)
    yield _whole_runs(effort)
    if effort.against is not None:
        yield _against(effort, effort.against)


# A case of the sweep, in one process.


class Spent(NamedTuple):
    """CPU seconds and bytes of a sweep."""

    study: float  # with its files
    making: float  # of its cases in memory, until their first step
    steps: float
    size: float


def _loops(effort: Effort) -> Table:
    """Run the sweep with both time loops in turns, and measure a bare pair beside them."""
    configs = [case.config for case in Cases(Config.model_validate(sweep(effort.cases)))]
    rows, attempts, pairs = np.mean([_counts(config) for config in configs], axis=0).tolist()
    for loop in LOOPS:
        _spent(loop, configs[:_FEW])  # imports and compiles
    transforms = Transforms(configs[0].grid.points)
    pair, least = math.inf, dict.fromkeys(LOOPS, Spent(*[math.inf] * 4))
    for _ in range(effort.repetitions):
        pair = min(pair, cpu_of_a_pair(transforms))
        for loop in LOOPS:
            least[loop] = Spent(*np.minimum(least[loop], _spent(loop, configs)))
    table: list[dict[str, Cell]] = [
        {
            "time loop": loop,
            "rows": rows,
            "attempts": attempts,
            "FFT pairs": pairs,
            "Python calls": _python_calls(loop, configs[:_FEW]),
            "a case [ms]": 1e3 * spent.study / effort.cases,
            "over its bare pairs": spent.study / (pair * pairs * effort.cases),
            "over the loop in Python": spent.study / least["in Python"].study,
            "an attempt [us]": 1e6 * spent.steps / (attempts * effort.cases),
            "before its steps [ms]": 1e3 * spent.making / effort.cases,
            "file and study [ms]": 1e3 * (spent.study - spent.making - spent.steps) / effort.cases,
            "bytes": round(spent.size / effort.cases),
        }
        for loop, spent in least.items()
    ]
    title = f"A case in a sweep of {effort.cases}, n = 1024, adaptive steps, one process"
    note = (
        "Means over the cases; CPU times, the least of the repetitions. Python calls are those of a run in "
        "memory, calls of C functions included."
    )
    return Table("sweep-loops", title, table, note)


def _counts(config: Config) -> tuple[int, int, float]:
    """Return rows, attempts at steps, and FFT pairs of a case."""
    recording = Recording()
    Case(config).run(recording)
    rejected, pairs = (float(recording[name].sum()) for name in ("rejected", "transforms"))
    return recording.count, recording.count + int(rejected), pairs


def _case(loop: str, config: Config) -> Case:
    case = Case(config)
    case.stepwise = LOOPS[loop]
    return case


def _spent(loop: str, configs: list[Config]) -> Spent:
    with TemporaryDirectory() as name, patch.object(Checkpoints, "stepwise", LOOPS[loop]):
        out = Path(name) / "out"
        with assemble() as pool:
            assert pool is not None
            study = cpu_seconds(lambda: _run_sweep(len(configs), out, pool))
        size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    making, steps = np.sum([_in_memory(loop, config) for config in configs], axis=0)
    return Spent(study, making, steps, size)


def _in_memory(loop: str, config: Config) -> tuple[float, float]:
    """Return the CPU time of a case until its first step, and that of its steps."""
    begun = begun_steps = time.process_time()

    def ready(_: object) -> None:
        nonlocal begun_steps
        begun_steps = time.process_time()

    _case(loop, config).run(Recording(), resume=ready)
    return begun_steps - begun, time.process_time() - begun_steps


def _python_calls(loop: str, configs: list[Config]) -> int:
    """Count calls of functions, those in C included, in a case."""
    count = 0

    def trace(_frame: object, event: str, _of: object) -> None:
        nonlocal count
        count += event in {"call", "c_call"}

    for config in configs:
        sys.setprofile(trace)
        try:
            _case(loop, config).run(Recording())
        finally:
            sys.setprofile(None)
    return round(count / len(configs))


# The sweep in several processes.


def _run_sweep(cases: int, out: Path, pool: WorkerPool) -> None:
    summary = run_study(Config.model_validate(sweep(cases)), out, pool, RunOptions())
    if summary.count("complete") != cases:
        raise RuntimeError(f"{summary.failures or summary.states}")


def _processes(effort: Effort) -> Table:
    """Run the sweep in one process and in two, in turns."""
    ways = {way: sizes for way, sizes in WAYS.items() if sizes[0] == 1 or mpirun()}
    least = dict.fromkeys(ways, math.inf)
    for _ in range(effort.repetitions):
        for way, (ranks, jobs) in ways.items():
            answer = over_ranks(ranks, __file__, str(effort.cases), str(jobs))
            least[way] = min(least[way], float(answer or "nan"))
    table: list[dict[str, Cell]] = [
        {
            "": way,
            "cases": effort.cases,
            "time [s]": seconds,
            "a case [ms]": 1e3 * seconds / effort.cases,
            "times one process": least["one process"] / seconds,
        }
        for way, seconds in least.items()
    ]
    note = (
        "Clock, from the empty folder to the sweep file, after a sweep of few cases in the same processes; "
        "the least of the repetitions. With jobs=2 the second process starts after a second."
    )
    if "two ranks" not in ways:
        note += " Two ranks need an mpirun: pip install 'gfmdlayer[mpi]'."
    return Table("sweep-processes", f"A sweep of {effort.cases} cases in one process and in two", table, note)


def main(cases: str, jobs: str) -> None:
    """Run the sweep on the ranks of this job, or in so many processes; print its seconds."""
    with TemporaryDirectory() as name, assemble(int(jobs)) as pool:
        if pool is not None:
            _run_sweep(_FEW * pool.size, Path(name) / "few", pool)
            begun = time.perf_counter()
            _run_sweep(int(cases), Path(name) / "all", pool)
            print(time.perf_counter() - begun)


# Whole runs.


def _whole_runs(effort: Effort) -> Table:
    """Run a case on lines and surfaces, and measure a bare pair beside it."""
    cases = {f"line {n}": line(n) for n in effort.points}
    for n in effort.points:
        axis = AXIS * math.isqrt(n)
        cases |= {f"smooth {axis} x {axis}": surface(axis, rough=False)}
        cases |= {f"rough {axis} x {axis}": surface(axis, rough=True)}
    rows = [_whole_run(name, Config.model_validate(tree), effort) for name, tree in cases.items()]
    note = (
        "CPU times in memory, of making the case too; the least of the repetitions. Lines and smooth "
        "surfaces have the punch x^2/(2 R) and windows; rough surfaces have a load, and every other pair in "
        "single precision, which counts half."
    )
    return Table("sweep-runs", "Whole runs / their bare FFT pairs, adaptive steps", rows, note)


def _whole_run(name: str, config: Config, effort: Effort) -> dict[str, Cell]:
    warm_up(config)
    _, attempts, pairs = _counts(config)
    transforms, pair, spent = Transforms(config.grid.points), math.inf, math.inf
    for _ in range(effort.repetitions):
        pair = min(pair, cpu_of_a_pair(transforms))
        spent = min(spent, cpu_seconds(lambda: Case(config).run(Recording())))
    return {
        "contact": name,
        "attempts": attempts,
        "pairs an attempt": pairs / attempts,
        "run / bare pairs": spent / (pair * pairs),
        "an attempt [bare pairs]": spent / (pair * attempts),
        "an attempt [us]": 1e6 * spent / attempts,
    }


# Two checkouts.


def _against(effort: Effort, place: Path) -> Table:
    """Run the tasks of users with both checkouts, in turns."""
    sizes: list[tuple[str, tuple[int, ...]]] = [
        ("sweep", (effort.cases,)),
        ("run, 29 rows", ()),
        ("run, 1 step", ()),
    ]
    sizes += [("solve", (256,)), ("solve", (64, 64)), *(("line", (n,)) for n in effort.points)]
    for name in ("smooth surface", "rough surface"):
        sizes += [(name, (AXIS * math.isqrt(n),)) for n in effort.points]
    root = Path(__file__).parents[2]
    rows: list[dict[str, Cell]] = []
    with closing(Checkout(root)) as here, closing(Checkout(place)) as there:
        for name, size in sizes:
            for each in (here, there):
                each.times(name, *(size if name != "sweep" else (_FEW,)))  # compiles
            turns = [[each.times(name, *size) for each in (here, there)] for _ in range(effort.repetitions)]
            per = effort.cases if name == "sweep" else 1
            rows.append(_compared(f"{name} {' x '.join(map(str, size))}".strip(), turns, per))
        turns = [[each.times_of_command() for each in (here, there)] for _ in range(effort.repetitions)]
        rows.append(_compared("the command, 29 rows", turns))
    commits = [_commit(each) for each in (root, place)]
    title = f"Commit {commits[0]} over {commits[1]}, in turns"
    note = (
        f"Times of {commits[0]}, and their ratios to those of {commits[1]}: of the least clock and CPU time, "
        "and of the medians of the clock. Of the sweep a case, with its files; all others in memory."
    )
    return Table("sweep-against", title, rows, note)


def _compared(name: str, turns: list[list[Times]], cases: int = 1) -> dict[str, Cell]:
    """Return a row of the times of both, a turn after the other, of so many cases."""
    clock, cpu = (
        np.array([[getattr(each, kind) for each in turn] for turn in turns]) for kind in Times._fields
    )
    here, there = clock.min(axis=0) / cases
    used, used_there = cpu.min(axis=0) / cases
    return {
        "task": name,
        "clock [ms]": 1e3 * here,
        "before [ms]": 1e3 * there,
        "ratio": here / there,
        "of medians": float(np.divide(*np.median(clock, axis=0))),
        "CPU [ms]": 1e3 * used,
        "CPU before [ms]": 1e3 * used_there,
        "CPU ratio": used / used_there,
    }


def _commit(place: Path) -> str:
    command = ["git", "-C", str(place), "rev-parse", "--short", "HEAD"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip() or str(place)


if __name__ == "__main__":
    main(*sys.argv[1:])
