"""Figures 2 to 4 on two MPI ranks and on one, all cases in one schedule.

The times contain whole cases with their files, from the first submission to the last outcome, after
compilation and planning. One and two ranks take turns. This needs a machine without other load.
"""

from __future__ import annotations

import json
import sys
import time
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.common import Cell, Effort, Table, over_ranks

from gfmdlayer.config import load
from gfmdlayer.study.case_run import run_case, warm_up
from gfmdlayer.study.cases import SweepCase, cases
from gfmdlayer.study.folder import Folder
from gfmdlayer.study.schedule import Schedule
from gfmdlayer.study.workers import WorkerPool, assemble

EFFORT = Effort(points=(1 << 14,), repetitions=1)
QUICK = Effort(points=(1 << 10,), repetitions=3)
FIGURES = ("figure2", "figure3", "figure4")
CONFIGS = Path(__file__).parents[2] / "configs"


def figures(quick: bool) -> list[SweepCase]:
    """Return the cases of the three figures with consecutive numbers."""
    names = [f"{figure}{'-quick' if quick else ''}.yaml" for figure in FIGURES]
    every = [case for name in names for case in cases(load(CONFIGS / name))]
    return [SweepCase(index, case.config, case.values) for index, case in enumerate(every)]


def measure(effort: Effort) -> list[Table]:
    """Time the figures on one rank and on two; with fewer points, their quick variants."""
    quick = max(effort.points) < max(EFFORT.points)
    found = [{n: _timed(n, quick) for n in (1, 2)} for _ in range(effort.repetitions)]
    one, two = (min(times[n]["seconds"] for times in found) for n in (1, 2))
    costs = found[0][1]["costs"]
    row: dict[str, Cell] = {
        "configs": "figure2 to figure4" + (", quick" if quick else ""),
        "cases": len(costs),
        "1 rank [s]": one,
        "2 ranks [s]": two,
        "efficiency": one / (2 * two),
        "bound": sum(costs) / 2 / max(sum(costs) / 2, max(costs)),
        "target": "≥ 0.95",
    }
    return [Table("ranks", "Two MPI ranks and one", [row], "The shortest time of the repetitions counts.")]


def _timed(number: int, quick: bool) -> dict[str, list[float]]:
    answer = over_ranks(number, __file__, "quick" if quick else "full")
    if answer is None:
        raise RuntimeError("two ranks need an mpirun: pip install 'gfmdlayer[mpi]'")
    return dict(json.loads(answer))


def _run(pool: WorkerPool, every: list[SweepCase]) -> dict[str, object]:
    with TemporaryDirectory() as name:
        folder = Folder(Path(name))
        folder.cases.mkdir()
        warm_up(every)
        task = partial(run_case, folder=folder)
        begun = time.perf_counter()
        schedule = Schedule(pool, task, folder, lambda _: None)
        outcomes = list(schedule.run(sorted(every, key=lambda case: -case.cost.work)))
        seconds = time.perf_counter() - begun
    if any(outcome.state != "complete" for outcome in outcomes):
        raise RuntimeError("a case of the figures failed")
    return {"seconds": seconds, "costs": [outcome.seconds for outcome in outcomes]}


def main() -> None:
    """Run on the ranks of this job; print JSON."""
    with assemble() as pool:
        if pool is not None:
            print(json.dumps(_run(pool, figures(sys.argv[1] == "quick"))))


if __name__ == "__main__":
    main()
