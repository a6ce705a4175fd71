"""Time of a case without its steps: start-up, scheduling, files; on one rank and on two.

As a script, `overhead.py CONFIG DIR` is one rank of `gfmdlayer run` with a clock around the compiled loop. It
writes clock-PID.json: seconds in `march`, the number of cases, and the start of the first case.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.common import Cell, Effort, Table, mpirun, over_ranks

EFFORT = Effort(points=(16,), steps=3, repetitions=1, cases=1000)
QUICK = Effort(points=(16,), steps=3, repetitions=1, cases=50)
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
    """Run a sweep of tiny cases with `gfmdlayer run`, on one rank and, with an mpirun, on two."""
    ranks = (1, 2) if mpirun() else (1,)
    rows = [_row(size, points, effort) for points in effort.points for size in ranks]
    title = f"Overhead of a case of {effort.steps} steps in a sweep of {effort.cases}"
    note = (
        "Wall time x ranks minus the time in the steps, per case: start-up, configuration, set-up, "
        "scheduling, files and disk, the sweep file. Start-up is the time before the first case, once "
        "per run. The processor time shows the load of machine and disk. The best repetition counts."
    )
    return [Table("overhead", title, rows, note)]


def _row(ranks: int, points: int, effort: Effort) -> dict[str, Cell]:
    best = min(
        (_run(ranks, points, effort) for _ in range(effort.repetitions)),
        key=lambda row: float(row["overhead / case [ms]"] or 0),
    )
    target = TARGET if ranks > 1 and effort.cases >= 10_000 else None
    return {"ranks": ranks, "n": points, "cases": effort.cases, **best, "target": target}


def _run(ranks: int, points: int, effort: Effort) -> dict[str, Cell]:
    """Run the sweep once; times are in milliseconds per case."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        content = _CONFIG.format(points=points, end=0.01 * effort.steps, cases=effort.cases)
        (folder / "sweep.yaml").write_text(content, encoding="utf-8")
        launched, begun, used = time.time(), time.perf_counter(), _processor_seconds()
        over_ranks(ranks, __file__, "sweep.yaml", "out", folder=folder)
        wall, used = time.perf_counter() - begun, _processor_seconds() - used
        clocks = [json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("clock-*.json")]
    shares = [clock["cases"] for clock in clocks]
    if sum(shares) != effort.cases or len(shares) != ranks:
        raise RuntimeError(f"{ranks} ranks ran {shares} of {effort.cases} cases")
    stepping = sum(clock["stepping"] for clock in clocks)
    first = min(clock["begun"] for clock in clocks if clock["begun"])
    a_case = 1e3 / effort.cases
    return {
        "of the fullest rank": max(shares),
        "overhead / case [ms]": (wall * ranks - stepping) * a_case,
        "processor / case [ms]": (used - stepping) * a_case,
        "start-up / case [ms]": (first - launched) * ranks * a_case,
        "steps / case [ms]": stepping * a_case,
    }


def _processor_seconds() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


@dataclass
class Clock:
    """Seconds in steps, number of cases, and start of the first case, of one rank."""

    stepping: float = 0.0
    cases: int = 0
    begun: float = 0.0

    def around_cases(self, write: Callable[..., Any]) -> Callable[..., Any]:
        """Count the cases by their files; steps before the first one only compiled."""

        def counted(*case: Any, **options: Any) -> Any:
            if not self.cases:
                self.begun, self.stepping = time.time(), 0.0
            self.cases += 1
            return write(*case, **options)

        return counted

    def around_steps(self, march: Callable[..., Any]) -> Callable[..., Any]:
        """Add up the time of the compiled loop."""

        def timed(*arrays: Any) -> Any:
            begun = time.perf_counter()
            reason = march(*arrays)
            self.stepping += time.perf_counter() - begun
            return reason

        return timed


def main(config: str, directory: str) -> int:
    """Run the command line on this rank and write its clock."""
    from gfmdlayer.case import march
    from gfmdlayer.cli import main
    from gfmdlayer.study import case_run

    clock = Clock()
    case_run.write_case = clock.around_cases(case_run.write_case)
    march.march = clock.around_steps(march.march)
    status = main(["run", config, "--out", directory])
    Path(f"clock-{os.getpid()}.json").write_text(json.dumps(asdict(clock)), encoding="utf-8")
    return status


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
