"""One surface on two MPI ranks against one: time, memory of a rank, and where the time of a transform goes.

    PYTHONPATH=scripts python scripts/benchmarks/slabs.py 8192
    PYTHONPATH=scripts mpirun -n 2 python scripts/benchmarks/slabs.py 8192

solve one surface of 8192 x 8192 points on one process, and on two ranks: a rough, elastic halfspace, pressed
to a contact of some 8 %. One and two ranks take turns, and memory is that of the process with its part of
shared pages. Needs a machine without other load.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.mpi import over_ranks
from benchmarks.tables import Cell, Effort, Table

from gfmdlayer.case import Case
from gfmdlayer.config import Config
from gfmdlayer.execution.workers import launched_size, world
from gfmdlayer.grid.ranks import ALONE, MpiRanks, Ranks

EFFORT = Effort(points=(2048, 4096), repetitions=3)
QUICK = Effort(points=(512,), repetitions=1)
# kappa load/(modulus slope), kappa some 2, is the contact area of a rough halfspace (Persson 2001).
SLOPE, AREA = 0.1, 0.08


def configuration(points: int) -> Config:
    """Return the case: one step, from nothing to the load."""
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
    """Solve on one rank and on two, in turns; the least time of each counts."""
    rows: list[dict[str, Cell]] = []
    for points in effort.points:
        found: dict[int, list[dict[str, float]]] = {1: [], 2: []}
        for _ in range(effort.repetitions):
            for number in (1, 2):
                answer = over_ranks(number, __file__, str(points))
                if answer is None:
                    raise RuntimeError("two ranks need an mpirun: pip install 'gfmdlayer[mpich]'")
                found[number].append(json.loads(answer))
        one, two = ({key: min(each[key] for each in found[n]) for key in found[n][0]} for n in (1, 2))
        rows.append(
            {
                "points": f"{points}²",
                "contact [%]": 100 * one["area"],
                "iterations": int(one["iterations"]),
                "1 rank [s]": one["seconds"],
                "2 ranks [s]": two["seconds"],
                "ratio": one["seconds"] / two["seconds"],
                "FFT pair, ratio": one["pair"] / two["pair"],
                "memory of a rank": two["memory"] / one["memory"],
                "target": "≥ 1.4, ≤ 0.55",
            }
        )
    return [Table("slabs", "One surface on two MPI ranks against one", rows)]


def solved(points: int, ranks: Ranks) -> dict[str, Any]:
    """Solve the case on this process and its ranks; compiled and planned by a first solve."""
    case = Case(configuration(points), ranks=ranks)
    kappa, b = case.integrator.terms(0.0)
    problem = case.loading.problem(kappa, b, 1.0)
    case.solver.solve(problem, case.guess.at(0.0))
    ranks.total(0.0)
    begun = time.perf_counter()
    solution = case.solver.solve(problem, case.guess.at(0.0))
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
    """Return the bytes of the process beyond its libraries, shared pages in proportion."""
    lines = Path("/proc/self/smaps_rollup").read_text(encoding="ascii").splitlines()
    held = next(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return 1024.0 * held


def main() -> None:
    """Solve on the ranks of this job; print JSON."""
    size = launched_size(os.environ) or 1
    ranks = MpiRanks(world(size)) if size > 1 else ALONE
    found = solved(int(sys.argv[1]), ranks)
    if ranks.first:
        print(json.dumps(found))


if __name__ == "__main__":
    main()
