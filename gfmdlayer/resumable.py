"""State that a run carries from one time step to the next: how it is saved and restored.

Restoring the state of an object made in the same way reproduces the run bit for bit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from functools import reduce
from typing import Any, ClassVar, Protocol

State = Mapping[str, Any]  # arrays, numbers and text by name; all of them come back as arrays


class Resumable(Protocol):
    """Has a state that can be saved and restored."""

    def state(self) -> State:
        """Return the state, which later steps may change: to be written or copied at once."""
        ...

    def restore(self, state: State) -> None:
        """Continue from the state of an object made in the same way."""
        ...


class Saving:
    """Saves and restores the attributes in `KEPT`: "work" is `_work` or `work`, "modes.x" is in a part."""

    KEPT: ClassVar[tuple[str, ...]] = ()

    def state(self) -> State:
        """Return the attributes that are not None."""
        kept = {name: getattr(*self._place(name)) for name in self.KEPT}
        return {name.replace(".", "_"): value for name, value in kept.items() if value is not None}

    def restore(self, state: State) -> None:
        """Continue from the state of an object made in the same way; arrays change in place.

        Parameters
        ----------
        state : mapping of str to array
            What `state` returned.
        """
        import numpy as np

        for name in self.KEPT:
            owner, attribute = self._place(name)
            held, key = getattr(owner, attribute), name.replace(".", "_")
            if held is None and key not in state:
                continue
            if key not in state:
                raise ValueError(f"it has no {key} of {type(self).__name__}")
            value = np.asarray(state[key])
            if isinstance(held, np.ndarray):
                if value.shape != held.shape:
                    raise ValueError(
                        f"{key} of {type(self).__name__} has the shape {value.shape}; must have {held.shape}"
                    )
                held[...] = value
            elif isinstance(held, deque):
                held.clear()
                held.extend(value)
            elif isinstance(held, (list, tuple)):
                setattr(owner, attribute, type(held)(value.tolist()))
            else:  # numbers as they were: a sum may begin as a whole 0
                setattr(owner, attribute, value if value.ndim else value.item())

    def _place(self, name: str) -> tuple[Any, str]:
        """Return an object and its attribute."""
        first, *rest = name.split(".")
        way = [f"_{first}" if hasattr(self, f"_{first}") else first, *rest]
        return reduce(getattr, way[:-1], self), way[-1]


class Stateless(Saving):
    """Carries nothing from one step to the next."""


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
