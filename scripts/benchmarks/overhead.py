"""What a case costs beside its solves: everything from the launch to the sweep file, over ranks."""

from __future__ import annotations

import json
import resource
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.tables import Cell, Effort, Table

EFFORT = Effort(points=(16,), steps=3, repetitions=1, cases=1000)
QUICK = Effort(points=(16,), steps=3, repetitions=1, cases=50)
RANKS = (1, 2)
TARGET = "≤ 10 ms"

_CONFIG = """\
name: overhead
grid: {{points: {points}}}
time: {{end: {end}, step: 0.01}}
trajectory: {{ramp_time: {end}}}
solver: {{method: active_set}}
sweep: {{latin_hypercube: {{samples: {cases}, layer.thickness: {{from: 0.02, to: 1, scale: log}}}}}}
"""


def measure(effort: Effort) -> list[Table]:
    """Run a sweep of tiny cases by `gfmdlayer run`, alone and under mpirun where there is one."""
    mpirun = shutil.which("mpirun", path=str(Path(sys.executable).parent)) or shutil.which("mpirun")
    ranks = RANKS if mpirun else RANKS[:1]
    rows = [_row(mpirun, size, points, effort) for points in effort.points for size in ranks]
    title = f"Overhead of a case of {effort.steps} steps in a sweep of {effort.cases}"
    note = (
        "Wall time x ranks less the time in the solves, over the cases: start-up, configuration, setting up, "
        "scheduling, files and their way to the disk, the sweep file. Start-up is what comes before the "
        "first case, once for the run. Processor time shows what the load of machine and disk adds. "
        "The best repetition."
    )
    return [Table("overhead", title, rows, note)]


@dataclass(frozen=True)
class Spent:
    """What a run took, in milliseconds a case, and the cases of its fullest rank."""

    overhead: float
    processor: float
    start_up: float
    solves: float
    fullest: int


def _row(mpirun: str | None, ranks: int, points: int, effort: Effort) -> dict[str, Cell]:
    every = [_run(mpirun, ranks, points, effort) for _ in range(effort.repetitions)]
    best = min(every, key=lambda spent: spent.overhead)
    return {
        "ranks": ranks,
        "n": points,
        "cases": effort.cases,
        "of the fullest rank": best.fullest,
        "overhead / case [ms]": best.overhead,
        "processor / case [ms]": best.processor,
        "start-up / case [ms]": best.start_up,
        "solves / case [ms]": best.solves,
        "target": TARGET if ranks > 1 and effort.cases >= 10_000 else None,
    }


def _run(mpirun: str | None, ranks: int, points: int, effort: Effort) -> Spent:
    with TemporaryDirectory() as name:
        folder = Path(name)
        content = _CONFIG.format(points=points, end=0.01 * effort.steps, cases=effort.cases)
        (folder / "sweep.yaml").write_text(content, encoding="utf-8")
        launcher = [mpirun, "-n", str(ranks)] if mpirun and ranks > 1 else []
        rank = [sys.executable, str(Path(__file__).with_name("overhead_rank.py"))]
        command = [*launcher, *rank, "clock", "sweep.yaml", "out"]
        launched, begun, used = time.time(), time.perf_counter(), _processor_seconds()
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        wall, used = time.perf_counter() - begun, _processor_seconds() - used
        if done.returncode != 0:
            raise RuntimeError(f"the run on {ranks} ranks failed: {done.stderr}")
        clocks = [json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("clock-*.json")]
    shares = [clock["cases"] for clock in clocks]
    if sum(shares) != effort.cases or len(shares) != ranks:
        raise RuntimeError(f"{ranks} ranks ran {shares} of {effort.cases} cases")
    solving = sum(clock["solving"] for clock in clocks)
    first = min(clock["begun"] for clock in clocks if clock["begun"])
    a_case = 1e3 / effort.cases
    return Spent(
        overhead=(wall * ranks - solving) * a_case,
        processor=(used - solving) * a_case,
        start_up=(first - launched) * ranks * a_case,
        solves=solving * a_case,
        fullest=max(shares),
    )


def _processor_seconds() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
