"""Cost of a case, estimated before it is run: steps, FFT pairs, memory, disk, seconds.

The unit of work is the FFT pair, one forward and one backward transform of the grid, since nearly all of
the time goes there. The solver declares the pairs of a step and the fields in memory (`contact.solvers`).
Seconds follow from those of a pair on this machine (`grid.transforms`) and the time of a step beside its
pairs, times the median of actual over expected seconds of the finished cases of the same kind.
"""

from __future__ import annotations

import math
import random
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from statistics import median

from gfmdlayer.config import Config
from gfmdlayer.config.stops import stops
from gfmdlayer.contact.solvers import SOLVERS
from gfmdlayer.history.time_points import number_of_steps
from gfmdlayer.observables import columns

# Adaptive steps at a tolerance of 1e-4: the first ones, those of each stretch between kinks, those in which a
# branch relaxes, those for each doubling of a stretch beyond LONG relaxation times, in which the punch moves
# or the surface creeps; and the power of the tolerance. Measured on ramps and tables of 5 to 400 rows,
# tolerances from 1e-3 to 1e-5, relaxation times from 1e-3 to 100 ramps.
FIRST_STEPS, STRETCH_STEPS, RELAXING_STEPS, DOUBLING_STEPS, LONG = 4, 2, 5, 6, 3
ADAPTIVE_POWER = -1 / 3
ADAPTIVE = 2  # pairs of an adaptive step, with attempts that are rejected, over those of a short fixed one
AT_TURN = 2  # further steps that a fixed step after a kink stands for in pairs; measured on random tables
SURFACE = 1.3  # pairs of a step on a surface over those on a line
SLIDING = 4  # contact problems of a step under a moving punch; measured on the sliding parabola
# Adaptive steps under a moving punch over those under a resting one, up to FAST periods in a relaxation time.
SLIDING_STEPS, FAST = 2, 10
# Adaptive steps for each range of an interface that the punch moves, from NEAR ranges above the surface on,
# and for each stretch under a load. Measured on adhesive cylinders and films.
SEPARATING_STEPS, NEAR, HOLDING_STEPS = 6, 3, 15
# Steady sliding sets in after so many passages of the period, or times in which a free surface relaxes.
SETTLING = 3
# Thickness over the period below which contact is harder to find, the pairs growing with its root; the limit.
THIN, THINNEST = 0.05, 1 / 9
# Seconds of a step beside its pairs, and in pairs: for all, and for each branch; of a pair with the work of
# the solver around it; factors where steps are adaptive, and under a moving punch. Measured at 2^8 to 2^18
# points. Seconds of a case beside its steps.
STEP_SECONDS, STEP_PAIRS, BRANCH_PAIRS, AROUND, ADAPTIVE_STEP, SLIDING_STEP = 3e-4, 2, 3.5, 1.5, 2.2, 6
CASE_SECONDS = 0.03
# Steps of an isolated contact at least, their work in points times pairs, and their seconds.
FEWEST_INDENTING, INDENTING, INDENTING_SECONDS = 150, 500, 2e-4
REAL = 8  # bytes
BRANCH_FIELDS = 5  # real fields of a branch of the material; measured as those of the solvers
ROWS = 512  # in a block of the file
HEADER = 10e3  # bytes of the file beside its arrays: attributes, names
PROGRAM = 230e6  # bytes of a process with its libraries and compiled kernels
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
    steps, turns = _steps(config)
    if config.grid.axisymmetric:
        return _of_indentation(config, steps)
    solver = SOLVERS[config.contact_solver.method]
    pairs = (steps + AT_TURN * turns) * solver.pairs_per_step(size, config.solver.model_dump())
    pairs *= SLIDING if config.trajectory.moves else 1
    pairs *= ADAPTIVE if config.time.step == "adaptive" else 1
    pairs *= SURFACE if len(config.grid.points) == 2 else 1
    pairs *= solver.rough if config.punch.rough else 1
    uppermost = next(iter(config.solid.thicknesses), math.inf)
    if 0 < (thin := uppermost / max(config.grid.period) / THIN) < 1:
        pairs *= max(thin, THINNEST) ** -0.5
    branches = len(config.solid.roughly(config.time.end)[0][1])
    width = sum(column.size for column in columns(config))
    rows, output = math.ceil((steps + 1) / ROWS) * ROWS, config.output
    snapshots = steps + 1 if output.snapshots == "every" else len(output.snapshots)
    return Cost(
        steps=steps,
        pairs=pairs,
        work=size * pairs,
        memory=PROGRAM + (solver.fields + BRANCH_FIELDS * branches) * REAL * size,
        storage=HEADER
        + REAL * (width * rows + sum(config.grid.points) + (3 + bool(config.interfaces)) * size * snapshots),
    )


def _of_indentation(config: Config, steps: int) -> Cost:
    """Estimate an isolated contact, which has no FFT pairs; its work is that of the integral equations."""
    steps = max(steps, FEWEST_INDENTING) if config.time.step == "adaptive" else steps
    width, kept = len(columns(config)), len(config.output.snapshots)
    storage = HEADER + REAL * (width * max(steps, ROWS) + config.grid.points[0] * (1 + 3 * kept))
    return Cost(steps=steps, pairs=0.0, work=INDENTING * steps, memory=PROGRAM, storage=storage)


def total(costs: Iterable[Cost], part: float = 1.0) -> Cost:
    """Add up cases, which may be a part of all; the memory is that of the largest, as they run in turn."""
    every = list(costs)
    return Cost(
        steps=round(sum(cost.steps for cost in every) / part),
        pairs=sum(cost.pairs for cost in every) / part,
        work=sum(cost.work for cost in every) / part,
        memory=max(cost.memory for cost in every),
        storage=sum(cost.storage for cost in every) / part,
    )


def expected_seconds(config: Config, pair: Callable[[tuple[int, ...]], float]) -> float:
    """Estimate the seconds of a case on one core, from those of an FFT pair of the grid."""
    cost = estimate(config)
    if config.grid.axisymmetric:
        return CASE_SECONDS + INDENTING_SECONDS * cost.steps
    seconds = pair(config.grid.points)
    branches = len(config.solid.roughly(config.time.end)[0][1])
    step = STEP_SECONDS + (STEP_PAIRS + BRANCH_PAIRS * branches) * seconds
    step *= ADAPTIVE_STEP if config.time.step == "adaptive" else 1
    step *= SLIDING_STEP if config.trajectory.moves else 1
    return CASE_SECONDS + cost.steps * step + AROUND * cost.pairs * seconds


def on_this_machine(config: Config) -> float:
    """Estimate the seconds of a case on one core of this machine."""
    return expected_seconds(config, _pair_seconds)


@lru_cache(maxsize=64)
def _pair_seconds(shape: tuple[int, ...]) -> float:
    from gfmdlayer.files.cache import user_cache
    from gfmdlayer.grid.transforms import pair_seconds

    return pair_seconds(shape, user_cache())


class CostModel:
    """Seconds of a case, from those of finished cases.

    Parameters
    ----------
    finished : iterable of (Config, float)
        Finished cases and their seconds.
    expected : callable
        Estimate of the seconds of a case, up to a factor for each kind.
    """

    def __init__(
        self,
        finished: Iterable[tuple[Config, float]] = (),
        expected: Callable[[Config], float] = on_this_machine,
    ) -> None:
        self._expected = expected
        rates: defaultdict[Hashable, list[float]] = defaultdict(list)
        for config, seconds in finished:
            if seconds > 0:
                rates[kind(config)].append(seconds / expected(config))
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
        return self._expected(config) * self._rates.get(kind(config), self._typical)


def kind(config: Config) -> Hashable:
    """Return the settings that decide which kernels and plans a case uses, and so its seconds per work."""
    solver, time, trajectory, kept = config.solver, config.time, config.trajectory, config.output.histograms
    numerics = config.contact_solver.method, solver.inertia, time.integrator, time.step == "adaptive"
    grid = config.grid.geometry, config.grid.points
    others = kept.pressure is not None or kept.gap is not None, bool(config.interfaces)
    return *grid, *numerics, trajectory.control, trajectory.moves, *others


def _steps(config: Config) -> tuple[int, int]:
    """Count the steps, fixed ones exactly, adaptive ones by the relaxation between kinks.

    Also those fixed ones that follow a kink: adaptive ones are short there.
    """
    given = config.trajectory
    kinks = tuple(time for time, _ in given.corners[1:]) or _kinks(given.file, given.control)
    if given.velocity_file is not None:
        kinks += _kinks(given.velocity_file, "velocity")
    if config.temperature is not None:
        kinks += _kinks(config.temperature.file, "temperature")
    separating: float = 0
    if config.interfaces:
        from gfmdlayer.inputs import make_interface, make_trajectory

        interface, drive = make_interface(config), make_trajectory(config)
        kinks, separating = kinks + interface.kinks, HOLDING_STEPS * len(drive.kinks)
        if given.control == "depth":
            nearest = [max(drive(time) / interface.range, -NEAR) for time in (0.0, *drive.kinks)]
            separating = SEPARATING_STEPS * sum(abs(after - before) for before, after in pairwise(nearest))
    planned = stops(config, kinks)
    settled = max(kinks) + _settling(config)
    last = next((stop for stop in planned if stop.time >= settled), planned[-1])
    planned = [*planned[: planned.index(last)], replace(last, time=min(settled, last.time))]
    if config.time.step != "adaptive":
        return number_of_steps(planned), sum(stop.kink for stop in planned)
    relaxed, branches = config.solid.roughly(config.time.end)[0]
    times, spent = _relaxation(relaxed, branches)
    finer = ((config.time.tolerance or 1e-4) / 1e-4) ** ADAPTIVE_POWER
    slowest = max((tau for _, tau in branches), default=0.0)
    crossed = abs(given.velocity or 0.0) * slowest / max(config.grid.period)
    steps, begin, landings = FIRST_STEPS + finer * separating, 0.0, 0
    finer *= SLIDING_STEPS if given.moves and crossed < FAST else 1
    for stop in planned[1:]:
        if stop.kink or stop is planned[-1]:
            free = finer * spent[min(bisect_left(times, stop.time - begin), len(times) - 1)]
            steps += math.hypot(STRETCH_STEPS + free, landings)
            begin, landings = stop.time, 0
        else:
            landings += 1
    return round(steps), 0


def _settling(config: Config) -> float:
    """Time after the last kink in which a moving punch comes to the steady state that ends its run."""
    velocity = config.trajectory.velocity
    if config.time.steady is None or not velocity:
        return math.inf
    relaxed, branches = config.solid.roughly(config.time.end)[0]
    glassy = relaxed + sum(modulus for modulus, _ in branches)
    slowest = max((tau for _, tau in branches), default=0.0)
    creep = slowest * glassy / relaxed if relaxed > 0 else math.inf
    return SETTLING * max(max(config.grid.period) / abs(velocity), creep)


def _kinks(file: Path | None, quantity: str) -> tuple[float, ...]:
    return () if file is None else _kinks_of(file, quantity, file.stat().st_mtime_ns)


@lru_cache(maxsize=8)
def _kinks_of(file: Path, quantity: str, _changed: int) -> tuple[float, ...]:
    from gfmdlayer.time_functions import Table

    return Table.read(file, quantity).kinks


@lru_cache(maxsize=8)
def _relaxation(relaxed: float, branches: tuple[tuple[float, float], ...]) -> tuple[list[float], list[float]]:
    """Return times after a kink, and the steps up to them at a tolerance of 1e-4.

    The error of a step is proportional to its third power and to the third derivative of the relaxing
    modulus: over a time t there are int_0^t (sum_k G_k exp(-s/tau_k)/tau_k^3)^(1/3) ds steps, up to a factor.
    """
    times, spent = [0.0], [0.0]
    if not any(modulus for modulus, _ in branches):
        return times, spent
    glassy = relaxed + sum(modulus for modulus, _ in branches)
    shortest, longest = (limit(tau for _, tau in branches) for limit in (min, max))
    time, rate = 0.01 * shortest, sum(modulus / tau**3 for modulus, tau in branches) ** (1 / 3)
    while times[-1] < 1000 * longest:
        after = sum(modulus / tau**3 * math.exp(-time / tau) for modulus, tau in branches) ** (1 / 3)
        relaxing = (time - times[-1]) * (rate + after) / 2 / glassy ** (1 / 3)
        moving = math.log2(time / max(times[-1], LONG * longest)) if time > LONG * longest else 0.0
        spent.append(spent[-1] + RELAXING_STEPS * relaxing + DOUBLING_STEPS * moving)
        times.append(time)
        time, rate = time * 1.1, after
    return times, spent
