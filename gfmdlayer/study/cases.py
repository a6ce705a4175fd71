"""The cases of a configuration, and the order in which a run takes them.

A sweep is a product of values and of lists of combinations (`gfmdlayer.config.sweeps`), the last key running
fastest; without one there is a single case. A sweep may have a million cases: each is made from its place
at its first use. A run takes them in blocks, so that the first begins at once; the memory that all of them
need is estimated before that from a sample.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from gfmdlayer.body.materials import shifts
from gfmdlayer.config import Config
from gfmdlayer.config.sweeps import as_label, axes
from gfmdlayer.drives import Drives
from gfmdlayer.results.names import dimension_names
from gfmdlayer.study.cost import estimate
from gfmdlayer.validation.sections import Part, replaced

if TYPE_CHECKING:
    from gfmdlayer.case.model import Footprint
    from gfmdlayer.config.reader import Inspection
    from gfmdlayer.grid.ranks import Ranks

BLOCK = 2_000  # cases that are made at a time, and of a sample: in about a second
_ROWS = 200  # of adaptive steps in a sweep, where no output times are asked for

Item = TypeVar("Item")


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

    @cached_property
    def drives(self) -> Drives:
        """Its imposed quantities over time."""
        return Drives(self.config)

    @cached_property
    def cost(self) -> Footprint:
        """Estimated time and memory of the case."""
        return estimate(self.config, self.drives)

    def __getstate__(self) -> dict[str, Any]:
        """Leave the drives behind on the way to another process."""
        state = vars(self).copy()  # at once: another thread may compute its cost
        state.pop("drives", None)
        return state


class Cases:
    """The cases of a configuration, the last swept key fastest; each is made when it is asked for.

    Adaptive steps of a sweep land on a spacing of end/200, so that cases of one end have rows at equal times.
    """

    def __init__(self, config: Config) -> None:
        self.config, self._axes = config, axes(config.sweep)
        self._kept: dict[int, SweepCase] = {}  # of the sample

    def __len__(self) -> int:
        return math.prod(len(axis.rows) for axis in self._axes)

    @property
    def are_many(self) -> bool:
        """Whether they are more than are made at a time."""
        return len(self) > BLOCK

    def __iter__(self) -> Iterator[SweepCase]:
        return map(self.__getitem__, range(len(self)))

    def __getitem__(self, place: int) -> SweepCase:
        """Make a case; ConfigError if its combination of values is not possible."""
        place = range(len(self))[place]
        if (case := self._kept.get(place)) is None:
            values = self.values(place)
            config = self.config.with_values(values)
            if values and config.time.step == "adaptive" and config.output.times is None:
                output = config.output.model_copy(update={"times": config.time.end / _ROWS})
                config = config.model_copy(update={"output": output})
            case = SweepCase(place, config, values)
        return case

    def values(self, place: int) -> dict[str, object]:
        """Return the swept keys and their values in a case, which is not made."""
        left, rows = place, []
        for axis in reversed(self._axes):
            left, i = divmod(left, len(axis.rows))
            rows.append(axis.rows[i])
        return {key: value for row in reversed(rows) for key, value in row.items()}

    def sample(self) -> Iterable[SweepCase]:
        """Return all cases, or of more than `BLOCK` the first, the last and others drawn at random."""
        if not self._kept:
            self._kept = {place: self[place] for place in drawn(range(len(self)))}
        return self._kept.values()


def drawn(items: Sequence[Item]) -> Sequence[Item]:
    """Return all items, or of more than `BLOCK` the first, the last and some drawn at random."""
    if len(items) <= BLOCK:
        return items
    chosen = random.Random(0).sample(range(1, len(items) - 1), BLOCK - 2)
    return [items[i] for i in (0, *sorted(chosen), len(items) - 1)]


def cases(config: Config) -> list[SweepCase]:
    """Return the cases of a configuration; ConfigError if a combination of values is not possible."""
    return list(Cases(config))


@dataclass(frozen=True)
class Shard:
    """Where one of `count` runs over a sweep starts; `number` counts from 1.

    Each run takes all cases that no other run has taken. Runs that start at different places seldom meet.
    """

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

    def blocks(self, total: int) -> Iterator[range]:
        """Yield the places of all cases in blocks, from the block where this run starts and around."""
        number = -(-total // BLOCK)
        first = (self.number - 1) * number // self.count
        for block in (*range(first, number), *range(first)):
            yield range(block * BLOCK, min((block + 1) * BLOCK, total))

    def order(self, items: Sequence[Item]) -> list[Item]:
        """Return the items of a block: first every N-th from the I-th on, then those of the runs after."""
        count = min(self.count, len(items))
        starts = ((self.number - 1 + later) % count for later in range(count))
        return [item for start in starts for item in items[start::count]]


WHOLE = Shard(1, 1)


def input_errors(config: Config, ranks: Ranks | None = None) -> Iterable[tuple[str, str]]:
    """Check numbers and input files of the cases, some of very many, for `config.load`."""
    return errors_of(Cases(config), ranks)


def checked(read: Callable[[Inspection], Config]) -> Cases:
    """Return the cases of a configuration that `read` reads with a check of them; they are made once."""
    made: list[Cases] = []

    def inspect(config: Config) -> Iterable[tuple[str, str]]:
        made.append(Cases(config))
        return errors_of(made[-1])

    config = read(inspect)
    return made[-1] if made and made[-1].config is config else Cases(config)


def errors_of(cases: Cases, ranks: Ranks | None = None) -> Iterable[tuple[str, str]]:
    """Check numbers and input files of the sample of cases."""
    doubtful = [case.config for case in cases.sample() if not case.config.plainly_possible]
    return _input_errors(doubtful, ranks) if doubtful else ()


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
    texts = [as_label(key, value) for key, value in values.items()]
    return ", ".join(f"{name} = {text}" for name, text in zip(dimension_names([*values]), texts, strict=True))
