"""Effort of each step, and errors of the series and modes in place of the body."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from gfmdlayer.body.materials import Material
from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.contact.problem import Solution

_PAIRS = (
    "pairs of Fourier transforms (forward and backward) spent on the step; "
    "a pair over a window counts as its part of the surface"
)
_STEP = "in this step, rejected attempts included"


class Effort(Observable):
    """Counts transforms, iterations and attempts until a step is accepted."""

    COLUMNS = (
        Column("transforms", _PAIRS, dtype="i8", origin=_STEP),
        Column("iterations", "iterations of the contact solver in the step", dtype="i8", origin=_STEP),
        Column("rejected", "attempts at the step that were rejected", dtype="i8", origin=_STEP),
    )
    KEPT = "transforms", "iterations", "attempts"

    def __init__(self, _case: Parts) -> None:
        self._transforms = self._iterations = self._attempts = 0

    def attempt(self, solution: Solution) -> None:
        """Count an attempt."""
        self._transforms += solution.transforms
        self._iterations += solution.iterations
        self._attempts += 1

    def measure(self, _step: AcceptedStep) -> Mapping[str, float]:
        """Return the counts and begin at zero for the next step."""
        made = self._transforms, self._iterations, self._attempts - 1
        counts = {column.name: count for column, count in zip(self.COLUMNS, made, strict=True)}
        self._transforms = self._iterations = self._attempts = 0
        return counts


class SpectrumError(Observable):
    """Attribute `spectrum_error` of a case with a stack, whose modes are merged.

    It is a bound on the relative error of the stiffness K(q, s) at all q and s >= 0.
    """

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return no columns, where modes may be merged."""
        return () if config.solid.merges and not config.friction else None

    def __init__(self, case: Parts) -> None:
        self.attributes = {"spectrum_error": case.integrator.spectrum_error}


class SeriesError(Observable):
    """Attributes of a case with continuous laws, which Prony series replace.

    They are the number of all branches, `law_branches`; bounds on the relative errors of G(t) and G(omega),
    `law_error_in_time` and `law_error_in_frequency`; and the range in which these hold: times, and reciprocal
    angular frequencies, from `law_shortest_time` to `law_longest_time`.
    """

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return no columns, where a law is not a series itself."""
        return None if all(isinstance(law, Material) for law in config.laws) else ()

    def __init__(self, case: Parts) -> None:
        found = case.series
        self.attributes = {
            "law_branches": sum(len(series.material.maxwell_branches) for series in found),
            "law_error_in_time": max(series.error_in_time for series in found),
            "law_error_in_frequency": max(series.error_in_frequency for series in found),
            "law_shortest_time": max(series.shortest for series in found),
            "law_longest_time": min(series.longest for series in found),
        }
