"""Transforms and iterations of all attempts at a step, and how many attempts were rejected."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts
from gfmdlayer.resumable import State

if TYPE_CHECKING:
    from gfmdlayer.contact.problem import Solution

_PAIRS = (
    "pairs of Fourier transforms (forward and backward) spent on the step; "
    "of a window, the part of the surface that it is"
)
_STEP = "of this step alone, with the attempts that were rejected"


class Effort(Observable):
    """Counts transforms, iterations and attempts until a step is accepted."""

    COLUMNS = (
        Column("transforms", _PAIRS, dtype="i8", origin=_STEP),
        Column("iterations", "iterations of the contact solver in the step", dtype="i8", origin=_STEP),
        Column("rejected", "attempts at the step that were rejected", dtype="i8", origin=_STEP),
    )

    def __init__(self, _case: Parts) -> None:
        self._transforms = self._iterations = self._attempts = 0

    def attempt(self, solution: Solution) -> None:
        """Count an attempt."""
        self._transforms += solution.transforms
        self._iterations += solution.iterations
        self._attempts += 1

    def measure(self, _step: AcceptedStep) -> Mapping[str, float]:
        """Return the counts and begin at zero for the next step."""
        counts = {
            "transforms": self._transforms,
            "iterations": self._iterations,
            "rejected": self._attempts - 1,
        }
        self._transforms = self._iterations = self._attempts = 0
        return counts

    def state(self) -> State:
        """Return the counts."""
        return {
            "transforms": self._transforms,
            "iterations": self._iterations,
            "attempts": self._attempts,
        }

    def restore(self, state: State) -> None:
        """Continue from the counts of another run."""
        self._transforms, self._iterations = int(state["transforms"]), int(state["iterations"])
        self._attempts = int(state["attempts"])
