"""State that a run carries from one time step to the next: how it is saved and restored.

Restoring the state of an object made in the same way reproduces the run bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

State = Mapping[str, Any]  # arrays, numbers and text by name; all of them come back as arrays


class Resumable(Protocol):
    """Has a state that can be saved and restored."""

    def state(self) -> State:
        """Return the state, which later steps may change: to be written or copied at once."""
        ...

    def restore(self, state: State) -> None:
        """Continue from the state of an object made in the same way."""
        ...


class Stateless:
    """Carries nothing from one step to the next."""

    def state(self) -> State:
        """Return nothing."""
        return {}

    def restore(self, state: State) -> None:
        """Do nothing."""


class CompositeState:
    """Several states as one; each name gets the name of its part before it, with a dot between."""

    def __init__(self, **parts: Resumable) -> None:
        self._parts = parts

    def __getitem__(self, name: str) -> Any:
        """Return a part."""
        return self._parts[name]

    def state(self) -> State:
        """Return the states of all parts, as arrays."""
        import numpy as np

        return {
            f"{name}.{key}": np.asarray(value)
            for name, part in self._parts.items()
            for key, value in part.state().items()
        }

    def restore(self, state: State) -> None:
        """Restore each part from its own names."""
        for name, part in self._parts.items():
            own = f"{name}."
            part.restore({key.removeprefix(own): state[key] for key in state if key.startswith(own)})
