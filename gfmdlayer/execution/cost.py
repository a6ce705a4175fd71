"""What a case will take, told before it is run: steps, FFT pairs, memory, disk.

The unit of work is the FFT pair, one forward and one backward transform of the grid, since nearly all of
the time goes there.  How many pairs a step needs depends on the solver and, for some, on the grid.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from gfmdlayer.config import Config
from gfmdlayer.observables import columns

# Adaptive steps of a ramp and a hold at a tolerance of 1e-4, and the power of the tolerance; measured on the
# default case from 1e-3 to 1e-4, with 0 to 400 times to land on.
ADAPTIVE_STEPS, ADAPTIVE_POWER = 28, -1 / 3
# FFT pairs a step at a residual of 1e-6, at n = 4096 and as a power of n; measured on the default case.
PAIRS = {
    ("fire", "mass_weighted"): (93, 0.03),
    ("fire", "uniform"): (238, 0.3),
    ("conjugate_gradient", None): (34, 0.2),
    ("active_set", None): (2.7, 0.07),
}
ROUGH = 12  # times as many of `active_set` where no window holds the contact; measured at 256^2 to 2048^2
SLIDING = 4  # contact problems of a step under a moving punch; measured, as the sliding parabola's
REAL = 8  # bytes
# Real fields alive at once: kernels, plans, snapshot being written, and what the solver keeps; those of each
# branch of the material. Peak of the process, measured at 2^17 to 2^19 points in one and two directions.
FIELDS = {"fire": 35, "conjugate_gradient": 32, "active_set": 62}
BRANCH_FIELDS = 5
ROWS = 512  # in a block of the file
HEADER = 10e3  # bytes of the file beside its arrays: attributes, names
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
    work : float
        Points times FFT pairs, by which cases are weighed against each other.
    memory, storage : float
        Bytes in memory (with the program) and in the result file.
    """

    steps: int
    pairs: float
    work: float
    memory: float
    storage: float


def estimate(config: Config) -> Cost:
    """Estimate what a case costs."""
    size = math.prod(config.grid.points)
    steps = _steps(config)
    solver = config.solver
    inertia = solver.inertia if solver.method == "fire" else None
    width = sum(column.size for column in columns(config))
    at_4096, power = PAIRS[solver.method, inertia]
    pairs = steps * at_4096 * (size / 4096) ** power * (SLIDING if config.trajectory.moves else 1)
    if solver.method == "active_set" and config.punch.rough:
        pairs *= ROUGH
    branches = len(config.layer.material.maxwell_branches)
    fields = FIELDS[solver.method] + BRANCH_FIELDS * branches
    rows, snapshots = math.ceil((steps + 1) / ROWS) * ROWS, len(config.output.snapshots)
    return Cost(
        steps=steps,
        pairs=pairs,
        work=size * pairs,
        memory=PROGRAM + fields * REAL * size,
        storage=HEADER + REAL * (width * rows + sum(config.grid.points) + 3 * size * snapshots),
    )


def _steps(config: Config) -> int:
    """Count the steps; the adaptive ones where few or many times are asked for, and between the two."""
    time, output = config.time, config.output
    if not isinstance(time.step, str):
        return math.ceil(time.end / time.step - 1e-9)
    times = output.times or ()
    rows = math.floor(time.end / times + 1e-9) if isinstance(times, float) else len(times)
    free = ADAPTIVE_STEPS * ((time.tolerance or 1e-4) / 1e-4) ** ADAPTIVE_POWER
    return math.ceil(math.hypot(free, rows + len(output.snapshots)))


def total(costs: Iterable[Cost]) -> Cost:
    """Add up cases; the memory is that of the largest, as they run one after the other."""
    every = list(costs)
    return Cost(
        steps=sum(cost.steps for cost in every),
        pairs=sum(cost.pairs for cost in every),
        work=sum(cost.work for cost in every),
        memory=max(cost.memory for cost in every),
        storage=sum(cost.storage for cost in every),
    )
