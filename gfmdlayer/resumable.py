"""What carries a memory from one time step to the next, and how it is handed over.

Whoever is restored to a state of its like goes on as that one did, to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

State = Mapping[str, Any]  # arrays, numbers and text by name; all of them are arrays when they come back


class Resumable(Protocol):
    """Has a memory that can be taken out and put back."""

    def state(self) -> State:
        """Return the memory, which later steps may change: to be written or copied at once."""
        ...

    def restore(self, state: State) -> None:
        """Take over the memory of another one that was made in the same way."""
        ...


class Stateless:
    """Begins each step anew."""

    def state(self) -> State:
        """Return nothing."""
        return {}

    def restore(self, state: State) -> None:
        """Do nothing."""


class CompositeState:
    """Several of them as one; their names come before those of their memory, with a dot between."""

    def __init__(self, **parts: Resumable) -> None:
        self._parts = parts

    def state(self) -> State:
        """Return the memory of all."""
        return {
            f"{name}.{key}": np.asarray(value)
            for name, part in self._parts.items()
            for key, value in part.state().items()
        }

    def restore(self, state: State) -> None:
        """Give each its own."""
        for name, part in self._parts.items():
            own = f"{name}."
            part.restore({key.removeprefix(own): state[key] for key in state if key.startswith(own)})
