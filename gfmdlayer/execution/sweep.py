"""The cases of a configuration, and their division into shards.

A sweep is a product of values and of lists of combinations (`gfmdlayer.config.sweeps`), the last key running
fastest; without one there is a single case. A shard is the part of a sweep that one of several runs over a
results folder computes, such as the jobs of an array. The division follows only from the configuration, not
from the cases that are complete: shards that start at different times never claim each other's cases.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from pathlib import Path
from typing import TYPE_CHECKING, overload

from gfmdlayer.body.temperature import shifts
from gfmdlayer.config import Config, ConfigError
from gfmdlayer.config.sweeps import as_label, axes
from gfmdlayer.execution import interrupts, preflight
from gfmdlayer.execution.cost import estimate
from gfmdlayer.model import PROGRAM
from gfmdlayer.validation.sections import Part, replaced

if TYPE_CHECKING:
    from gfmdlayer.grid.ranks import Ranks

EXAMINED = 2_000  # cases that are examined before a run, at most: about two seconds
CASE_BYTES = 6_500  # of a case that waits in a run, measured; it is made in a third of a millisecond
_ROWS = 200  # of adaptive steps in a sweep, where no output times are asked for


@dataclass(frozen=True)
class Earlier:
    """A complete case whose kept state a case with a later end goes on from."""

    index: int  # its number
    time: float  # the time of the state
    made_by: Mapping[str, str]  # its digest, versions and processor


@dataclass(frozen=True)
class SweepCase:
    """One simulation of a sweep."""

    index: int  # its number, and the number of its file
    config: Config  # its configuration, without a sweep
    values: dict[str, object]  # the swept keys, dotted, and their values in this case
    earlier: Earlier | None = None  # a complete case from whose state this one goes on
    # its stored configuration, where `config` names copies of the input files
    given: Config | None = None


class Cases(Sequence[SweepCase]):
    """The cases of a configuration, the last swept key fastest; each is made when it is asked for.

    Where steps are adaptive and no output times are asked for, the cases of a sweep land on a spacing of
    end/200, so that cases of one end have rows at equal times. A case whose values are not possible raises
    ConfigError.
    """

    def __init__(self, config: Config) -> None:
        self._config, self._axes = config, axes(config.sweep)

    def __len__(self) -> int:
        return math.prod(len(axis.rows) for axis in self._axes)

    @overload
    def __getitem__(self, place: int) -> SweepCase: ...
    @overload
    def __getitem__(self, place: slice) -> list[SweepCase]: ...
    def __getitem__(self, place: int | slice) -> SweepCase | list[SweepCase]:
        if isinstance(place, slice):
            return [self[i] for i in range(*place.indices(len(self)))]
        if not 0 <= place < len(self):
            raise IndexError(place)
        left, rows = place, []
        for axis in reversed(self._axes):
            left, i = divmod(left, len(axis.rows))
            rows.append(axis.rows[i])
        values = {key: value for row in reversed(rows) for key, value in row.items()}
        case = self._config.with_values(values)
        if self._config.sweep and case.time.step == "adaptive" and case.output.times is None:
            case = case.with_values({"output.times": case.time.end / _ROWS})
        return SweepCase(place, case, values)

    def examined(self) -> list[SweepCase]:
        """Return all cases, or of more than `EXAMINED` the first, the last and others drawn at random."""
        if len(self) <= EXAMINED:
            return self[:]
        drawn = random.Random(0).sample(range(1, len(self) - 1), EXAMINED - 2)
        return [self[place] for place in (0, *sorted(drawn), len(self) - 1)]


def cases(config: Config) -> list[SweepCase]:
    """Return the cases of a configuration; ConfigError if a combination of values is not possible."""
    return Cases(config)[:]


def own_cases(every: Cases, shard: Shard | None) -> list[SweepCase]:
    """Return the cases of a run or of its shard; ConfigError for impossible values, or too many cases."""
    number = len(every) if shard is None else -(-len(every) // shard.count)
    needed, instead = PROGRAM + CASE_BYTES * number, "fewer values, or more parts (--shard I/N)"
    if refused := preflight.memory_warnings(needed, instead=instead):
        raise ConfigError([f"sweep: {number} cases in one run: {refused[0]}"])
    with interrupts.at_once():
        return every[:] if shard is None else shard.share(every)


def input_errors(config: Config, ranks: Ranks | None = None) -> Iterable[tuple[str, str]]:
    """Check numbers and input files of the cases, some of very many, for `config.load`."""
    doubtful = [case.config for case in Cases(config).examined() if not case.config.plainly_possible]
    if not doubtful:
        return ()
    return _input_errors(doubtful, ranks)


def _input_errors(configs: Iterable[Config], ranks: Ranks | None) -> Iterator[tuple[str, str]]:
    """Check each combination of the decisive sections once."""
    from gfmdlayer.grid.ranks import ALONE
    from gfmdlayer.model import model_of

    seen = set()
    for config in configs:
        stiffness, relaxing = config.solid.mean_stiffness, shifts(config).values()
        decisive = (
            *(config.body, config.solid.rigid_below, config.grid, config.punch),
            *(config.trajectory, config.time.steady, stiffness, config.interface),
            *(config.temperature, config.temperature and config.time.end, *relaxing),
            *((config.layer, config.layers, config.halfspace, config.time) if config.grid.isolated else ()),
        )
        if decisive not in seen:
            seen.add(decisive)
            yield from model_of(config, ranks=ranks or ALONE).problems()


def with_files(section: Part, files: Mapping[Path, Path]) -> Part:
    """Return a section that names other files, in itself and in all sections below it."""
    return replaced(section, lambda value: files.get(value, value) if isinstance(value, Path) else value)


def label(values: dict[str, object]) -> str:
    """Write swept values for people: ``thickness = 0.1, Ginf = 10``."""
    short = [key.rpartition(".")[2] for key in values]
    names = [last if short.count(last) == 1 else key for key, last in zip(values, short, strict=True)]
    texts = [as_label(key, value) for key, value in values.items()]
    return ", ".join(f"{name} = {text}" for name, text in zip(names, texts, strict=True))


@dataclass(frozen=True)
class Shard:
    """Part `number` (from 1) of a sweep in `count` parts."""

    number: int
    count: int

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Read a shard in the form of the command line, ``3/16``; ValueError says the form."""
        number, slash, count = text.partition("/")
        digits = all(part.isascii() and part.isdigit() for part in (number, count))
        if not (slash and digits and 1 <= int(number) <= int(count)):
            raise ValueError(f"got {text!r}; must be I/N, two whole numbers with 1 <= I <= N")
        return cls(int(number), int(count))

    def share(self, cases: Sequence[SweepCase]) -> list[SweepCase]:
        """Return this shard's cases, in their order.

        The cases are dealt out from the longest to the shortest, each to the shard with the least estimated
        work so far; in whole numbers, so that every host adds up the same.
        """
        work = [max(1, round(estimate(case.config).work)) for case in cases]
        loads = [(0, number) for number in range(1, min(self.count, len(cases)) + 1)]
        heapify(loads)
        own = []
        for place in sorted(range(len(cases)), key=lambda place: (-work[place], place)):
            load, number = heappop(loads)
            heappush(loads, (load + work[place], number))
            if number == self.number:
                own.append(place)
        return [cases[place] for place in sorted(own)]
