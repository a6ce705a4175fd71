"""The section that says what is kept of a run."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, Tag, model_validator

from gfmdlayer.config.input_errors import InconsistentError, MustBe, Problem, one_of
from gfmdlayer.config.sections import NotNegative, Positive, Section, Spacing, given, number_or_list

Rows = Annotated[
    Annotated[Spacing, Tag("number")] | Annotated[tuple[NotNegative, ...], Tag("list")],
    number_or_list,
]
Bins = Annotated[int, Field(strict=True, ge=1, le=1000), MustBe("a whole number from 1 to 1000")]
Switch = Annotated[bool, Field(strict=True), MustBe("true or false")]


class Histogram(Section):
    """Bins of a distribution: `bins` equal ones from 0 to `max`, or on a log scale from `min` to `max`.

    What lies below and beyond has a bin of its own at either end.
    """

    max: Positive
    """end of the last bin"""
    bins: Bins = 50
    """number of bins"""
    scale: Annotated[Literal["linear", "log"], one_of("linear", "log")] = "linear"
    """linear: bins from 0; log: from min"""
    min: Annotated[Positive | None, given] = None
    """beginning of the first bin; for scale: log"""

    @model_validator(mode="after")
    def _bins_between(self) -> Self:
        wrong = None
        if self.scale == "linear" and self.min is not None:
            wrong = "given, but scale is linear, which begins at 0; must be left out, or scale be log"
        elif self.scale == "log" and self.min is None:
            wrong = "missing; scale: log must be given a number > 0 and < max"
        elif self.min is not None and self.min >= self.max:
            wrong = f"got {self.min!r}; must be a number > 0 and < max = {self.max!r}"
        if wrong:
            raise InconsistentError([Problem(("min",), wrong)])
        return self


class Histograms(Section):
    """Distributions over the surface that are kept in each row; None is not kept."""

    pressure: Annotated[Histogram | None, given] = None
    """of the contact pressure: {max: ..., bins: ...}"""
    gap: Annotated[Histogram | None, given] = None
    """of the gap out of contact: {max: ..., bins: ..., scale: ..., min: ...}"""


class Output(Section):
    """What is kept besides the curves: `snapshots` of the surface; `times` of the rows for adaptive steps.

    Without `times` the steps are free but for the snapshots, the kinks of the trajectory and the end. In each
    row `patches` counts the connected patches of contact, and `histograms` hold the distributions of contact
    pressure and gap.
    """

    snapshots: tuple[NotNegative, ...] = ()
    """times at which displacement, pressure and gap are kept"""
    times: Annotated[Rows | None, given] = None
    """rows of the curves, for adaptive steps: a spacing, or a list of times"""
    patches: Switch = False
    """whether to count the connected patches of contact"""
    histograms: Histograms = Field(default_factory=Histograms)
    """distributions that are kept in each row"""
