"""Seconds of cases, from the footprint that their model estimates and from finished cases.

Before any case has finished, the seconds are those of one measured FFT pair (`footprint.pair_seconds`) times
the pairs. Then the median of actual over expected seconds of the finished cases of the same kind
corrects them.
"""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from statistics import median

from gfmdlayer.case.footprint import pair_seconds
from gfmdlayer.case.model import Footprint, model_of
from gfmdlayer.config import Config
from gfmdlayer.drives import Drives
from gfmdlayer.files.cache import user_cache

# Seconds of a pair with the solver's passes around it, over those of the bare pair, and of its calls; on a
# surface that attracts, and under tractions in all directions, the passes are longer. All measured.
AROUND, AROUND_LONGER, CALLS = 2, 10, 3e-6
CASE_SECONDS = 0.01  # of a case beside its steps
SAMPLE = 500  # finished cases that are read, at most


def estimate(config: Config, drives: Drives | None = None) -> Footprint:
    """Estimate the cost of a case, whose drives may have been made before."""
    return model_of(config, drives=drives).footprint


def total(costs: Iterable[Footprint], part: float = 1.0) -> Footprint:
    """Add up cases, which may be a part of all; the memory is the largest of all, as they run in turn."""
    every = list(costs)
    names = ("steps", "pairs", "work", "storage", "seconds")
    sums = {name: sum(getattr(cost, name) for cost in every) / part for name in names}
    return Footprint(**sums | {"steps": round(sums["steps"])}, memory=max(cost.memory for cost in every))


@lru_cache(maxsize=64)
def _pair_seconds(shape: tuple[int, ...]) -> float:
    return pair_seconds(shape, user_cache())


def expected_seconds(
    config: Config, pair: Callable[[tuple[int, ...]], float] = _pair_seconds, cost: Footprint | None = None
) -> float:
    """Estimate the seconds of a case on one core from those of an FFT pair, by default on this machine."""
    cost = cost or estimate(config)
    longer = config.friction or (config.interfaces and len(config.grid.points) == 2)
    around = AROUND_LONGER if longer else AROUND
    transforms = cost.pairs * (around * pair(config.grid.points) + CALLS) if cost.pairs else 0.0
    return CASE_SECONDS + cost.seconds + transforms


class CostModel:
    """Expected seconds of a case, from finished cases; `expected` is right up to a factor for each kind."""

    def __init__(
        self,
        finished: Iterable[tuple[Config, float]] = (),
        expected: Callable[[Config], float] = expected_seconds,
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
        from gfmdlayer.results.names import ResultsError
        from gfmdlayer.results.reader import attributes

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
        return self._expected(config) * self.factor(config)

    def knows(self, config: Config) -> bool:
        """Whether the seconds are right within a factor of two: not with friction before a finished case."""
        return not config.friction or kind(config) in self._rates

    def factor(self, config: Config) -> float:
        """Return the seconds of finished cases of the same kind over those that were expected."""
        return self._rates.get(kind(config), self._typical)


def kind(config: Config) -> Hashable:
    """Return the settings that decide which kernels and plans a case uses, and so its seconds per work."""
    solver, time, trajectory, kept = config.solver, config.time, config.trajectory, config.output.histograms
    numerics = config.contact_solver.method, solver.inertia, time.integrator, time.step == "adaptive"
    grid = config.grid.geometry, config.grid.points
    others = kept.pressure is not None or kept.gap is not None, bool(config.interfaces)
    return *grid, *numerics, trajectory.control, trajectory.moves, *others
