"""The cases of a configuration, and their division into shards.

A sweep is a product of values and of lists of combinations (`gfmdlayer.config.sweeps`), the last key running
fastest; without one there is a single case. A shard is the part of a sweep that one of several runs over a
results folder computes, such as the jobs of an array. The division follows only from the configuration, not
from the cases that are complete: shards that start at different times never claim each other's cases.

A sweep may have a million cases. What a run must know of all of them before the first, it knows from their
places; it looks at `EXAMINED` of them, and makes each of the others when its turn comes.
"""

from __future__ import annotations

import math
import random
from abc import abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from heapq import heapify, heappop, heappush
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, overload

from gfmdlayer.body.materials import shifts
from gfmdlayer.config import Config
from gfmdlayer.config.sweeps import as_label, axes
from gfmdlayer.execution.cost import estimate
from gfmdlayer.validation.sections import Part, replaced

if TYPE_CHECKING:
    from gfmdlayer.grid.ranks import Ranks

EXAMINED = 2_000  # cases that are made before a run, at most: in about a second
WEIGHED = 20_000  # cases whose work is estimated for the division into shards, at most: in some ten seconds
_GOLDEN = 0x9E3779B97F4A7C15  # 2^64 over the golden ratio
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


Item = TypeVar("Item", covariant=True)


class InTurn(Sequence[Item]):
    """A sequence of which each item is made, by `_at`, when it is asked for; a slice is a list."""

    @overload
    def __getitem__(self, place: int) -> Item: ...
    @overload
    def __getitem__(self, place: slice) -> list[Item]: ...
    def __getitem__(self, place: int | slice) -> Item | list[Item]:
        if isinstance(place, slice):
            return [self._at(i) for i in range(*place.indices(len(self)))]
        if not 0 <= place < len(self):
            raise IndexError(place)
        return self._at(place)

    @abstractmethod
    def _at(self, place: int) -> Item:
        """Make an item."""


class Cases(InTurn[SweepCase]):
    """The cases of a configuration, the last swept key fastest; each is made when it is asked for.

    Adaptive steps of a sweep land on a spacing of end/200, so that cases of one end have rows at equal times.
    """

    def __init__(self, config: Config) -> None:
        self._config, self._axes = config, axes(config.sweep)

    def __len__(self) -> int:
        return math.prod(len(axis.rows) for axis in self._axes)

    def _at(self, place: int) -> SweepCase:
        values = self.values(place)
        case = self._config.with_values(values)
        if self._config.sweep and case.time.step == "adaptive" and case.output.times is None:
            case = case.with_values({"output.times": case.time.end / _ROWS})
        return SweepCase(place, case, values)

    def values(self, place: int) -> dict[str, object]:
        """Return the swept keys and their values in a case, which is not made."""
        left, rows = place, []
        for axis in reversed(self._axes):
            left, i = divmod(left, len(axis.rows))
            rows.append(axis.rows[i])
        return {key: value for row in reversed(rows) for key, value in row.items()}

    def examined(self) -> list[SweepCase]:
        """Return all cases, or of more than `EXAMINED` the first, the last and others drawn at random."""
        return [self[place] for place in examined(range(len(self)))]


def examined(places: Sequence[int], most: int | None = None) -> Sequence[int]:
    """Return all places, or of more than `most` (`EXAMINED`) the first, the last and some drawn at random."""
    most = EXAMINED if most is None else most
    if len(places) <= most:
        return places
    drawn = random.Random(0).sample(range(1, len(places) - 1), most - 2)
    return [places[i] for i in (0, *sorted(drawn), len(places) - 1)]


def cases(config: Config) -> list[SweepCase]:
    """Return the cases of a configuration; ConfigError if a combination of values is not possible."""
    return Cases(config)[:]


Change = Callable[[SweepCase], SweepCase]


class OwnCases(InTurn[SweepCase]):
    """The cases of a run or shard. Up to `EXAMINED` are made at once, the others when they are asked for.

    `indices` are the numbers of their files in the order of the sweep; `many`: not all are kept.
    """

    def __init__(self, cases: Cases, shard: Shard | None = None) -> None:
        self._cases = cases
        self._places: Sequence[int] = range(len(cases)) if shard is None else shard.places(cases)
        self.indices = self._places
        self._changes: tuple[Change, ...] = ()
        self.many = len(self._places) > EXAMINED
        self._made = {at: cases[self._places[at]] for at in examined(range(len(self._places)))}

    def __len__(self) -> int:
        return len(self._places)

    def _at(self, place: int) -> SweepCase:
        if (case := self._made.get(place)) is None:
            case = self._cases[self._places[place]]
            for change in self._changes:
                case = change(case)
        return case

    def values(self, at: int) -> dict[str, object]:
        """Return the swept values of a case, which is not made."""
        return self._cases.values(self._places[at])

    @property
    def examined(self) -> list[SweepCase]:
        """The cases that are kept: all, or of more than `EXAMINED` so many drawn at random."""
        return list(self._made.values())

    @cached_property
    def numbers(self) -> Collection[int]:
        """The numbers of the cases' files, of which membership is found at once."""
        return frozenset(self.indices) if isinstance(self.indices, list) else self.indices

    def numbered(self, numbers: Sequence[int]) -> OwnCases:
        """Return the cases with the numbers that their files have, by their places in the sweep."""
        if isinstance(numbers, range):
            return self
        found = self.each(lambda case: replace(case, index=numbers[case.index]))
        found.indices = [numbers[place] for place in self._places]
        return found

    def each(self, change: Change) -> OwnCases:
        """Return the cases with a change of each."""
        found = copy(self)
        found._changes = (*self._changes, change)
        found._made = {at: change(case) for at, case in self._made.items()}
        return found


def input_errors(config: Config, ranks: Ranks | None = None) -> Iterable[tuple[str, str]]:
    """Check numbers and input files of the cases, some of very many, for `config.load`."""
    doubtful = [case.config for case in Cases(config).examined() if not case.config.plainly_possible]
    if not doubtful:
        return ()
    return _input_errors(doubtful, ranks)


def _input_errors(configs: Iterable[Config], ranks: Ranks | None) -> Iterator[tuple[str, str]]:
    """Check each combination of the decisive sections once."""
    from gfmdlayer.case.model import model_of
    from gfmdlayer.grid.ranks import ALONE

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

    def places(self, cases: Sequence[SweepCase]) -> Sequence[int]:
        """Return the places of this shard's cases, in their order."""
        if len(cases) > WEIGHED:
            return Dealt(self, len(cases))
        # The cases are dealt out from the longest to the shortest, each to the shard with the least estimated
        # work so far; in whole numbers, so that every host adds up the same.
        work = [max(1, round(estimate(case.config).work)) for case in cases]
        loads = [(0, number) for number in range(1, min(self.count, len(cases)) + 1)]
        heapify(loads)
        own = []
        for place in sorted(range(len(cases)), key=lambda place: (-work[place], place)):
            load, number = heappop(loads)
            heappush(loads, (load + work[place], number))
            if number == self.number:
                own.append(place)
        return sorted(own)


@dataclass(frozen=True)
class Dealt(InTurn[int]):
    """Places of a shard in a very long sweep, one in each block of as many cases as there are shards.

    Its place in a block goes on by the golden ratio, so that each shard meets every value equally often.
    """

    shard: Shard
    total: int  # number of cases

    def __len__(self) -> int:
        blocks, left = divmod(self.total, self.shard.count)
        return blocks + (self._within(blocks) < left)

    def _at(self, place: int) -> int:
        return place * self.shard.count + self._within(place)

    def __contains__(self, place: object) -> bool:
        if not isinstance(place, int) or not 0 <= place < self.total:
            return False
        block, within = divmod(place, self.shard.count)
        return within == self._within(block)

    def _within(self, block: int) -> int:
        turned = (block * _GOLDEN % 2**64) * self.shard.count >> 64
        return (self.shard.number - 1 + turned) % self.shard.count
