"""When a moving punch has reached its steady state.

It has when friction, mean pressure and depth have each stayed within a tolerance, relative to their largest
value, over a whole window of time: that of the slowest thing on the way there (`SlidingModes.slowest`).
"""

from __future__ import annotations

import math

import numpy as np

from gfmdlayer.resumable import State

_ROUNDING = 1e-12  # of friction, where the body is elastic


class SteadyState:
    """Watches the accepted steps.

    Parameters
    ----------
    window : float
        Time over which nothing may change any more.
    tolerance : float
        Allowed change, relative to the largest value in the window.
    since : float
        Time from which on nothing that is prescribed changes.

    Attributes
    ----------
    verdict : dict
        settled (0 or 1), and the steady_time at which it was.
    """

    def __init__(self, window: float, tolerance: float, since: float) -> None:
        self._window, self._tolerance, self._since = window, tolerance, since
        self.verdict: dict[str, float] = {"settled": 0}
        self._begun = math.inf
        self._least = self._most = np.empty(0)

    def reached(
        self, time: float, pressure: float, depth: float, friction: float = math.nan, **_others: float
    ) -> bool:
        """Take the values of a row; tell whether the steady state is reached with it."""
        values = (pressure, depth, friction)
        if time < self._since or math.isnan(friction):
            return False
        if self._begun == math.inf:
            self._begin(time, values)
            return False
        self._least, self._most = np.minimum(self._least, values), np.maximum(self._most, values)
        if time - self._begun < self._window * (1 - 1e-9):
            return False
        largest = np.maximum(np.abs(self._least), np.abs(self._most))
        settled = bool((self._most - self._least <= self._tolerance * largest + _ROUNDING).all())
        self._begin(time, values)
        if settled:
            self.verdict = {"settled": 1, "steady_time": time}
        return settled

    def state(self) -> State:
        """Return the window that was begun; there is a verdict only after the last step."""
        return {"begun": self._begun, "least": self._least, "most": self._most}

    def restore(self, state: State) -> None:
        """Go on from there."""
        self._begun, self._least, self._most = float(state["begun"]), state["least"], state["most"]

    def _begin(self, time: float, values: tuple[float, ...]) -> None:
        self._begun, self._least = time, np.array(values)
        self._most = self._least.copy()
