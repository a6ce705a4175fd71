"""The section of the configuration that lists the output of a run."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from gfmdlayer.validation.fields import (
    MustBe,
    NotNegative,
    Optional,
    Positive,
    Switch,
    Word,
    given,
    number_or_list,
    strict,
)
from gfmdlayer.validation.problems import Problem
from gfmdlayer.validation.sections import Section

Spacing = Annotated[float, strict, Field(gt=0), MustBe("a number > 0, finite, or a list of times")]
Rows = Annotated[
    Annotated[Spacing, Tag("number")] | Annotated[tuple[NotNegative, ...], Tag("list")],
    number_or_list,
]
Bins = Annotated[int, Field(strict=True, ge=1, le=1000), MustBe("a whole number from 1 to 1000")]
Snapshots = Annotated[
    Annotated[tuple[NotNegative, ...], Tag("list")]
    | Annotated[Literal["every"], MustBe("a list of times, or the word every", ("every",)), Tag("word")],
    Discriminator(lambda value: "list" if isinstance(value, (list, tuple)) else "word"),
]
MOST_ROWS = 1_000_000  # of a case


class Histogram(Section):
    """Bins of a distribution: `bins` equal ones from 0 to `max`, or on a log scale from `min` to `max`.

    What lies below and beyond has a bin of its own at either end.
    """

    max: Positive
    """end of the last bin: pressure or length"""
    bins: Bins = 50
    """number of bins"""
    scale: Annotated[str, Word("linear", "log")] = "linear"
    """linear: bins from 0; log: from min"""
    min: Optional = None
    """beginning of the first bin, for the log scale: pressure or length"""

    def problems(self) -> Iterator[Problem]:
        """Refuse a beginning that does not go with the scale or the end."""
        wrong = ""
        if self.scale == "linear" and self.min is not None:
            wrong = "given, but scale is linear, which begins at 0; must be left out, or scale be log"
        elif self.scale == "log" and self.min is None:
            wrong = "missing; scale: log must be given a number > 0 and < max"
        elif self.min is not None and self.min >= self.max:
            wrong = f"got {self.min!r}; must be a number > 0 and < max = {self.max!r}"
        if wrong:
            yield Problem(("min",), wrong, ("scale", "max"))


class Histograms(Section):
    """Distributions over the surface that are kept in each row; None is not kept."""

    pressure: Annotated[Histogram | None, given] = None
    """of the contact pressure: {max: ..., bins: ...}"""
    gap: Annotated[Histogram | None, given] = None
    """of the gap out of contact: {max: ..., bins: ..., scale: ..., min: ...}"""


class Output(Section):
    """What is kept besides the curves: `snapshots` of the surface; `times` of the rows for adaptive steps.

    Snapshots of every accepted step make a film of all that happened, and take as much room on the disk.
    Without `times` the steps are free but for the snapshots, the kinks of the trajectory and the end. In each
    row `patches` counts the connected patches of contact, and `histograms` hold the distributions of contact
    pressure and gap.
    """

    snapshots: Snapshots = ()
    """times at which the surface is kept; or every, after each step: time"""
    times: Annotated[Rows | None, given] = None
    """rows of the curves, for adaptive steps; a spacing, or a list: time"""
    patches: Switch = False
    """whether to count the connected patches of contact"""
    histograms: Histograms = Field(default_factory=Histograms)
    """distributions that are kept in each row"""
    keep_state: Switch = False
    """whether a run to a later time.end may go on from this one"""

    @property
    def snapshot_times(self) -> tuple[float, ...]:
        """The times of the snapshots that a run must land on."""
        return () if self.snapshots == "every" else self.snapshots

    def problems(self) -> Iterator[Problem]:
        """Refuse times that do not increase."""
        for key, times in (("snapshots", self.snapshots), ("times", self.times)):
            for i, (before, time) in enumerate(pairwise(times if isinstance(times, tuple) else ()), start=1):
                if time <= before:
                    yield Problem(
                        (key, i), f"got {time!r} after {before!r}; must be larger, times increase", (key,)
                    )

    def problems_until(self, end: float) -> Iterator[Problem]:
        """Refuse times past the end of the run, and too many rows."""
        for key, times in (("snapshots", self.snapshots), ("times", self.times)):
            for i, time in enumerate(times if isinstance(times, tuple) else ()):
                if time > end:
                    yield Problem(
                        (key, i), f"got {time!r}, past the end; must be a number <= time.end = {end!r}"
                    )
        if isinstance(self.times, float) and not 0 < self.times <= end:
            message = f"got a spacing of {self.times!r}; must be a number > 0 and <= time.end = {end!r}"
            yield Problem(("times",), message)
        elif isinstance(self.times, float) and end / self.times > MOST_ROWS:
            message = f"got {self.times!r}, {end / self.times:.3g} rows; must be >= {end / MOST_ROWS!r}"
            yield Problem(("times",), message)
