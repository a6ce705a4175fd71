"""What the attempts at a step took, up to the accepted one."""

from __future__ import annotations

from gfmdlayer.contact.problem import Solution
from gfmdlayer.resumable import State


class Effort:
    """Counts what is spent until a step is accepted."""

    def __init__(self) -> None:
        self._transforms = self._iterations = self._number = 0

    def add(self, solution: Solution) -> None:
        """Count an attempt."""
        self._transforms += solution.transforms
        self._iterations += solution.iterations
        self._number += 1

    def taken(self) -> dict[str, int]:
        """Columns of the accepted step's row; counting begins anew."""
        columns = {
            "transforms": self._transforms,
            "iterations": self._iterations,
            "rejected": self._number - 1,
        }
        self._transforms = self._iterations = self._number = 0
        return columns

    def state(self) -> State:
        """Return the counts."""
        return {"transforms": self._transforms, "iterations": self._iterations, "number": self._number}

    def restore(self, state: State) -> None:
        """Go on from there."""
        self._transforms, self._iterations = int(state["transforms"]), int(state["iterations"])
        self._number = int(state["number"])
