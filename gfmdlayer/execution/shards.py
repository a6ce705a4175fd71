"""Shards: one sweep split among several runs over one results folder, such as the jobs of an array.

Who gets which case follows from the configuration alone, never from what is complete: shards that start at
different times, or again, never claim one another's cases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush

from gfmdlayer.execution.cost import estimate
from gfmdlayer.execution.sweep import Case


@dataclass(frozen=True)
class Shard:
    """Part `number` (from 1) of a sweep in `count` parts."""

    number: int
    count: int

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Read a shard as it is written on the command line, ``3/16``.

        Raises
        ------
        ValueError
            For anything else; the message says what is allowed.
        """
        number, slash, count = text.partition("/")
        digits = all(part.isascii() and part.isdigit() for part in (number, count))
        if not (slash and digits and 1 <= int(number) <= int(count)):
            raise ValueError(f"got {text!r}; must be I/N, two whole numbers with 1 <= I <= N")
        return cls(int(number), int(count))

    def share(self, cases: Sequence[Case]) -> list[Case]:
        """Return this shard's cases, in their order.

        The cases are dealt out from the longest to the shortest, each to the shard that has least to do so
        far, by their estimated work; in whole numbers, so that every host adds up the same.
        """
        work = [max(1, round(estimate(case.config).work)) for case in cases]
        loads = [(0, number) for number in range(1, self.count + 1)]
        heapify(loads)
        mine = []
        for place in sorted(range(len(cases)), key=lambda place: (-work[place], place)):
            load, number = heappop(loads)
            heappush(loads, (load + work[place], number))
            if number == self.number:
                mine.append(place)
        return [cases[place] for place in sorted(mine)]
