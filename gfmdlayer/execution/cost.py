"""Cost of a case, estimated before it is run: steps, FFT pairs, memory, disk, seconds.

The unit of work is the FFT pair, one forward and one backward transform of the grid, since nearly all of
the time goes there. The solver declares the pairs of a step and the fields in memory (`contact.solvers`).
Seconds are work times the median seconds per work of the finished cases of the same kind.
"""

from __future__ import annotations

import math
import random
from collections import defaultdict
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from gfmdlayer.config import Config
from gfmdlayer.contact.solvers import SOLVERS
from gfmdlayer.observables import columns

# Adaptive steps of a ramp and a hold at a tolerance of 1e-4, and the power of the tolerance; measured on the
# default case from 1e-3 to 1e-4, with 0 to 400 output times.
ADAPTIVE_STEPS, ADAPTIVE_POWER = 28, -1 / 3
SLIDING = 4  # contact problems of a step under a moving punch; measured on the sliding parabola
REAL = 8  # bytes
BRANCH_FIELDS = 5  # real fields of a branch of the material; measured as those of the solvers
ROWS = 512  # in a block of the file
HEADER = 10e3  # bytes of the file beside its arrays: attributes, names
PROGRAM = 200e6  # bytes of a process with its libraries
SAMPLE = 500  # finished cases that are read, at most


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
        Points times FFT pairs.
    memory, storage : float
        Bytes in memory (with the program) and in the result file.
    """

    steps: int
    pairs: float
    work: float
    memory: float
    storage: float


def estimate(config: Config) -> Cost:
    """Estimate the cost of a case."""
    size = math.prod(config.grid.points)
    steps = _steps(config)
    solver = SOLVERS[config.solver.method]
    pairs = steps * solver.pairs_per_step(size, config.solver.model_dump())
    pairs *= SLIDING if config.trajectory.moves else 1
    pairs *= solver.rough if config.punch.rough else 1
    branches = len(config.layer.material.maxwell_branches)
    width = sum(column.size for column in columns(config))
    rows, output = math.ceil((steps + 1) / ROWS) * ROWS, config.output
    snapshots = steps + 1 if output.snapshots == "every" else len(output.snapshots)
    return Cost(
        steps=steps,
        pairs=pairs,
        work=size * pairs,
        memory=PROGRAM + (solver.fields + BRANCH_FIELDS * branches) * REAL * size,
        storage=HEADER + REAL * (width * rows + sum(config.grid.points) + 3 * size * snapshots),
    )


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


class CostModel:
    """Seconds of a case, from those of finished cases.

    Parameters
    ----------
    finished : iterable of (Config, float)
        Finished cases and their seconds; without any, seconds are in units of the work.
    """

    def __init__(self, finished: Iterable[tuple[Config, float]] = ()) -> None:
        rates: defaultdict[Hashable, list[float]] = defaultdict(list)
        for config, seconds in finished:
            if seconds > 0:
                rates[kind(config)].append(seconds / estimate(config).work)
        self.fitted = bool(rates)
        self._rates = {kind: median(found) for kind, found in rates.items()}
        self._typical = median(self._rates.values()) if rates else 1.0  # for kinds without a finished case

    @classmethod
    def of_files(cls, complete: Mapping[Path, Config]) -> CostModel:
        """Fit to the files of complete cases: all of them, or a random sample of many."""
        from gfmdlayer.results.reader import attributes
        from gfmdlayer.results.schema import ResultsError

        paths = list(complete) if len(complete) <= SAMPLE else random.Random(0).sample([*complete], SAMPLE)
        finished = []
        for path in paths:
            try:
                seconds = attributes(path).get("wall_seconds", 0.0)
            except ResultsError:
                continue  # removed or damaged in the meantime
            finished.append((complete[path], float(str(seconds))))
        return cls(finished)

    def seconds(self, config: Config) -> float:
        """Return the expected seconds of a case."""
        return estimate(config).work * self._rates.get(kind(config), self._typical)


def kind(config: Config) -> Hashable:
    """Return the settings that decide which kernels and plans a case uses, and so its seconds per work."""
    solver, time, trajectory, kept = config.solver, config.time, config.trajectory, config.output.histograms
    numerics = solver.method, solver.inertia, time.integrator, time.step == "adaptive"
    histograms = kept.pressure is not None or kept.gap is not None
    return config.grid.points, *numerics, trajectory.control, trajectory.moves, histograms


def _steps(config: Config) -> int:
    """Count the steps; adaptive ones by the free steps and the times that they must land on."""
    time, output = config.time, config.output
    if not isinstance(time.step, str):
        return math.ceil(time.end / time.step - 1e-9)
    times = output.times or ()
    rows = math.floor(time.end / times + 1e-9) if isinstance(times, float) else len(times)
    free = ADAPTIVE_STEPS * ((time.tolerance or 1e-4) / 1e-4) ** ADAPTIVE_POWER
    return math.ceil(math.hypot(free, rows + len(output.snapshot_times)))
