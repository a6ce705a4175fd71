"""A cell that is wider than the window that a user sees."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import FloatArray
from gfmdlayer.grid.grid import Grid


@dataclass(frozen=True)
class WiderCell:
    """The points that a user sees in the middle of a larger grid of the same spacing."""

    points: tuple[int, ...]
    period: tuple[float, ...]
    whole: Grid
    width: float  # of the contact as it was estimated, in periods of the window; NaN where it is not known
    above: float  # height of the punch outside, over its lowest point

    def extended(self, heights: FloatArray) -> FloatArray:
        """Return heights of the punch on the larger grid, one value a point."""
        everywhere = np.full(self.whole.points, self.above)
        everywhere[self._inside] = heights.reshape(self.points)
        return everywhere.ravel()

    def seen(self, field: NDArray[Any]) -> NDArray[Any]:
        """Return the part of a field on the larger grid that the user sees."""
        return np.ascontiguousarray(field[self._inside])

    @property
    def factor(self) -> float:
        """Length of the larger cell over that of the window, where it is longer."""
        return max(long / length for long, length in zip(self.whole.period, self.period, strict=True))

    @property
    def account(self) -> str:
        """Say what the larger cell costs."""
        points, periods = " x ".join(map(str, self.whole.points)), self.factor
        wide = "" if math.isnan(self.width) else f", for a contact some {self.width:.2g} periods wide"
        times = self.whole.size / math.prod(self.points)
        return f"a cell of {periods:.3g} periods inside{wide}: {points} points, {times:.3g} times as many"

    @property
    def _inside(self) -> tuple[slice, ...]:
        first = [(most - n) // 2 for most, n in zip(self.whole.points, self.points, strict=True)]
        return tuple(slice(at, at + n) for at, n in zip(first, self.points, strict=True))
