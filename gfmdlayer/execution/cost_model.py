"""Seconds that a case will take: its estimated work, times what the finished cases of the sweep tell.

The logarithm of seconds per work is a sum of effects, one for the kind of case (grid, solver, integrator) and
one for each swept value, fitted by a sweep of medians (Tukey, Exploratory Data Analysis, 1977, ch. 11): no
finished case that was disturbed carries the others away, and values need no order.
"""

from __future__ import annotations

import math
import random
from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from statistics import median

from gfmdlayer.execution.cost import estimate
from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.sweep import Case

SAMPLE = 500  # finished cases that are looked at, at most
POLISHES = 10  # enough for the effects to settle where cases are missing


class CostModel:
    """Tells the seconds of a case.

    Parameters
    ----------
    finished : iterable of (Case, float)
        Finished cases and their seconds; without any, seconds are in units of the work.
    """

    def __init__(self, finished: Iterable[tuple[Case, float]] = ()) -> None:
        known = [(case, seconds) for case, seconds in finished if seconds > 0]
        left = [math.log(seconds / estimate(case.config).work) for case, seconds in known]
        self._scale = median(left) if left else 0.0
        self.fitted = bool(known)
        left = [rest - self._scale for rest in left]
        columns = list(zip(*(_levels(case) for case, _ in known), strict=False))
        self._effects: list[defaultdict[Hashable, float]] = [defaultdict(float) for _ in columns]
        for effect, levels in [*zip(self._effects, columns, strict=True)] * POLISHES:
            found = _medians(levels, left)
            left = [rest - found[level] for level, rest in zip(levels, left, strict=True)]
            for level, value in found.items():
                effect[level] += value

    def seconds(self, case: Case) -> float:
        """Return the seconds that a case is expected to take."""
        effects = zip(self._effects, _levels(case), strict=False)
        found = self._scale + sum(effect.get(level, 0.0) for effect, level in effects)
        return estimate(case.config).work * math.exp(found)

    def longest_first(self, cases: Iterable[Case]) -> list[Case]:
        """Return cases in the order in which they should begin."""
        return sorted(cases, key=lambda case: (-self.seconds(case), case.index))


def finished(folder: Folder, cases: Sequence[Case]) -> list[tuple[Case, float]]:
    """Return complete cases with the seconds that they took: all, or a random sample of many."""
    from gfmdlayer.results.reader import attributes
    from gfmdlayer.results.schema import ResultsError

    found = []
    for case in cases if len(cases) <= SAMPLE else random.Random(0).sample(cases, SAMPLE):
        try:
            seconds = attributes(folder.case(case.index)).get("wall_seconds", 0.0)
        except ResultsError:
            continue  # gone or damaged meanwhile: one fewer to learn from
        found.append((case, float(str(seconds))))
    return found


def _levels(case: Case) -> list[Hashable]:
    return [case.kind, *(repr(value) for value in case.values.values())]


def _medians(levels: Sequence[Hashable], values: Sequence[float]) -> dict[Hashable, float]:
    groups: defaultdict[Hashable, list[float]] = defaultdict(list)
    for level, value in zip(levels, values, strict=True):
        groups[level].append(value)
    return {level: median(group) for level, group in groups.items()}
