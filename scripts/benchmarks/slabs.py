"""One surface on one thread, two threads and two MPI ranks: time, memory per rank, share of transforms.

    PYTHONPATH=scripts python scripts/benchmarks/slabs.py 8192
    PYTHONPATH=scripts mpirun -n 2 python scripts/benchmarks/slabs.py 8192

solve one surface of 8192 x 8192 points on one process and on two ranks. A second number sets the threads.
The body is an elastic halfspace, the punch is rough, and the contact is some 8 %. The memory of a process
contains its part of shared pages. This needs a machine without other load.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.common import Cell, Effort, Table, over_ranks

from gfmdlayer.case.case import Case
from gfmdlayer.config import Config
from gfmdlayer.grid.ranks import ALONE, MpiRanks, Ranks
from gfmdlayer.study.preflight import launched_size
from gfmdlayer.study.workers import world

EFFORT = Effort(points=(2048, 4096), repetitions=3)
QUICK = Effort(points=(512,), repetitions=1)
# kappa load/(modulus slope), kappa some 2, is the contact area of a rough halfspace (Persson 2001).
SLOPE, AREA = 0.1, 0.08

_WAYS = {"1 thread": (1, 1), "2 threads": (1, 2), "2 ranks": (2, 1)}  # ranks, threads of each
_TARGETS = {"1 thread": None, "2 threads": "≥ 1.6", "2 ranks": "≥ 1.4, ≤ 0.55"}


def configuration(points: int) -> Config:
    """Return the case: one step from rest to the load."""
    load = AREA / 2 * SLOPE * 4  # E* = 4 G of an incompressible halfspace
    return Config(
        name="rough",
        grid={"points": [points, points]},
        layer={"thickness": math.inf, "material": {"model": "elastic", "G": 1.0}},
        punch={
            "shape": "self_affine",
            "hurst": 0.8,
            "rms_slope": SLOPE,
            "short_cutoff": 16 / points,
            "roll_off": 0.25,
            "seed": 1,
        },
        trajectory={"control": "load", "load": load, "ramp_time": 1.0},
        time={"end": 1.0, "step": 1.0},
        solver={"method": "nested_gradient", "tolerance": 1e-6},
    )


def measure(effort: Effort) -> list[Table]:
    """Solve on one thread, two threads and two ranks in turns; the shortest time of each counts."""
    rows: list[dict[str, Cell]] = []
    for points in effort.points:
        found: dict[str, list[dict[str, float]]] = {way: [] for way in _WAYS}
        for _ in range(effort.repetitions):
            for way, (ranks, threads) in _WAYS.items():
                if (answer := over_ranks(ranks, __file__, str(points), str(threads))) is not None:
                    found[way].append(json.loads(answer))
        least = {
            way: {key: min(each[key] for each in runs) for key in runs[0]}
            for way, runs in found.items()
            if runs
        }
        one = least["1 thread"]
        rows += [
            {
                "points": f"{points}²",
                "": way,
                "contact [%]": 100 * each["area"],
                "iterations": int(each["iterations"]),
                "time [s]": each["seconds"],
                "times faster": one["seconds"] / each["seconds"],
                "FFT pair, times faster": one["pair"] / each["pair"],
                "memory of a rank": each["memory"] / one["memory"],
                "target": _TARGETS[way],
            }
            for way, each in least.items()
        ]
    note = "Two ranks need an mpirun: pip install 'gfmdlayer[mpi]'."
    return [Table("slabs", "One surface on two threads and on two MPI ranks", rows, note)]


def solved(points: int, ranks: Ranks, threads: int = 1) -> dict[str, Any]:
    """Solve the case on this process and its ranks; a first solve compiles and plans."""
    case = Case(configuration(points), threads=threads, ranks=ranks)
    kappa, b = case.contact.history.terms(0.0)
    problem = case.contact.loading.problem(kappa, b, 1.0)
    case.contact.solve(problem, 0.0)
    ranks.total(0.0)
    begun = time.perf_counter()
    solution = case.contact.solve(problem, 0.0)
    seconds = time.perf_counter() - begun
    field, spectrum = case.transforms.empty_field(), case.transforms.empty_spectrum()
    field[:], number = 0.0, max(3, (1 << 24) // points**2)
    ranks.total(0.0)
    begun = time.perf_counter()
    for _ in range(number):
        case.transforms.transform(field, spectrum)
        case.transforms.transform_back(spectrum, field)
    pair = (time.perf_counter() - begun) / number
    return {
        "seconds": ranks.maximum(seconds),
        "pair": ranks.maximum(pair),
        "memory": ranks.maximum(_memory()),
        "area": solution.contact_area,
        "iterations": solution.iterations,
        "pairs": solution.transforms,
        "residual": solution.residual,
    }


def _memory() -> float:
    """Return the bytes of the process without its libraries; shared pages count in proportion."""
    lines = Path("/proc/self/smaps_rollup").read_text(encoding="ascii").splitlines()
    held = next(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return 1024.0 * held


def main() -> None:
    """Solve on the ranks of this job; print JSON."""
    size = launched_size(os.environ) or 1
    ranks = MpiRanks(world(size)) if size > 1 else ALONE
    found = solved(int(sys.argv[1]), ranks, *map(int, sys.argv[2:]))
    if ranks.first:
        print(json.dumps(found))


if __name__ == "__main__":
    main()
