"""One iteration of FIRE over its bare FFT pairs."""

from __future__ import annotations

import numpy as np
from benchmarks.common import STEP, Effort, Table, bare_pairs, default_case, ratio

from gfmdlayer.case.case import Case
from gfmdlayer.contact.fire import Fire
from gfmdlayer.contact.problem import Problem

EFFORT = Effort(points=(1024, 4096, 16384), repetitions=21)
QUICK = Effort(points=(1024, 4096, 16384), repetitions=7)

_POINTS_MOVED = 1 << 23  # in one measured run of some 40 ms; then the set-up is negligible
_TARGETS = {1024: "≤ 1.35", 16384: "≤ 1.25"}


def measure(effort: Effort) -> list[Table]:
    """Iterate on the problem of one step, in turns with the same number of bare pairs."""
    rows = [
        {
            "inertia": "mass-weighted" if mass_weighted else "uniform",
            "n": points,
            "iteration / bare pairs": _overhead(points, mass_weighted, effort.repetitions),
            "target": _TARGETS.get(points),
        }
        for mass_weighted in (True, False)
        for points in effort.points
    ]
    note = f"Median of {effort.repetitions} repetitions, iterations and bare pairs in turns."
    return [Table("iteration", "FIRE: whole iteration / its bare FFT pairs", rows, note)]


def _overhead(points: int, mass_weighted: bool, repetitions: int) -> float:
    config = default_case(grid__points=points)
    case = Case(config)
    problem = Problem(*case.contact.history.terms(STEP), case.punch - 0.01)
    iterations = max(1, _POINTS_MOVED // points)
    solver = Fire(case.transforms, mass_weighted=mass_weighted)
    start = np.zeros(points)

    def solve() -> int:
        return solver.solve(problem, start, -1.0, iterations).transforms

    pairs = solve()
    return ratio(solve, bare_pairs(case.transforms, pairs), repetitions)
