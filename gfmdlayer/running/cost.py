"""What a case will take, told before it is run: steps, FFT pairs, memory, disk.

The unit of work is the FFT pair, one forward and one backward transform of the grid, since nearly all of
the time goes there.  How many pairs a step needs depends on the solver and, for some, on the grid.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from gfmdlayer.config import Config

ADAPTIVE_STEPS = 100  # typical for a ramp and a hold at the default tolerance
# FFT pairs a step at a residual of 1e-6, at n = 4096 and as a power of n; measured on the default case.
PAIRS = {
    ("fire", "mass_weighted"): (93, 0.03),
    ("fire", "uniform"): (238, 0.3),
    ("conjugate_gradient", None): (34, 0.2),
    ("active_set", None): (6, 0.1),
}
SLIDING = 4  # contact problems of a step under a moving punch; measured, as the sliding parabola's
REAL = 8  # bytes
# Real fields alive at once: history, solver, kernels, plans, snapshot being written; measured at 1024 x 1024.
FIELDS = {"active_set": 68, "conjugate_gradient": 40, "fire": 36}
COLUMNS = 13  # of a row
PROGRAM = 200e6  # bytes of a process with its libraries


@dataclass(frozen=True)
class Cost:
    """Estimated cost of one case.

    Attributes
    ----------
    steps : int
        Time steps.
    pairs : float
        FFT pairs.
    memory, storage : float
        Bytes in memory (with the program) and in the result file.
    """

    steps: int
    pairs: float
    memory: float
    storage: float


def estimate(config: Config) -> Cost:
    """Estimate what a case costs."""
    size = math.prod(config.grid.points)
    step = config.time.step
    steps = ADAPTIVE_STEPS if isinstance(step, str) else math.ceil(config.time.end / step - 1e-9)
    solver = config.solver
    inertia = solver.inertia if solver.method == "fire" else None
    kept = config.output.histograms
    columns = COLUMNS + sum(given.bins for given in (kept.pressure, kept.gap) if given is not None)
    at_4096, power = PAIRS[solver.method, inertia]
    moves = config.trajectory.velocity is not None or config.trajectory.velocity_file is not None
    return Cost(
        steps=steps,
        pairs=steps * at_4096 * (size / 4096) ** power * (SLIDING if moves else 1),
        memory=PROGRAM + FIELDS[solver.method] * REAL * size,
        storage=REAL * (columns * (steps + 1) + 3 * size * len(config.output.snapshots)),
    )


def total(costs: Iterable[Cost]) -> Cost:
    """Add up cases; the memory is that of the largest, as they run one after the other."""
    every = list(costs)
    return Cost(
        steps=sum(cost.steps for cost in every),
        pairs=sum(cost.pairs for cost in every),
        memory=max(cost.memory for cost in every),
        storage=sum(cost.storage for cost in every),
    )
