"""What the attempts at a step took, up to the accepted one."""

from __future__ import annotations

from gfmdlayer.contact.problem import Solution


class Attempts:
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
