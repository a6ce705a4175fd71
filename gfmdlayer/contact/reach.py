"""Whether a contact without periodic images is within reach, and where its displacement is known.

All that was ever pressed counts, as the surface remembers it. It is kept as its support function: the largest
distance from the middle of the cell in each of some directions, with lengths over the periods. The sum of two
opposite ones is a width, and the largest width the distance of the two points that are furthest apart. A
contact does not go on behind the edge of the cell, which is no neighbour of the opposite one. Along a
periodic axis it does, and has no width.
"""

from __future__ import annotations

import math

import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.body.isolated import IsolatedBody, period_for, would_do
from gfmdlayer.body.solid import HALF, Boundary
from gfmdlayer.grid.grid import Grid
from gfmdlayer.resumable import Saving

# Pressures and tractions below this part of the largest do not count: their response may be wrong by as much
# as that of the others (`body.isolated.TOLERANCE`).
_NEGLIGIBLE = 1e-3

EDGE = "EDGE: the contact reaches the edge of the window, where the punch ends; take a larger grid.period"

_DIRECTIONS = 64  # of a surface: a width is short by at most 0.12 %


class Reach(Saving):
    """The part of the surface that was pressed, on the grid of a body with a reach.

    Without a body the response is exact in a box of half of the cell: a width is then along an axis.
    """

    KEPT = ("support",)

    def __init__(self, grid: Grid, boundary: Boundary, body: IsolatedBody | None = None) -> None:
        self._grid, self._boundary, self._body = grid, boundary, body
        self._most = HALF if body is None else body.reach
        along = np.eye(len(grid.period))[:, list(boundary.axes)]
        self._directions = np.hstack((along, -along))
        if len(boundary.axes) == 2 and body is not None:
            angles = 2 * math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
            self._directions = np.stack((np.cos(angles), np.sin(angles)))
        self._support = np.full(self._directions.shape[1], -math.inf)

    def width(self, pressure: FloatArray, noise: float = 0.0) -> float:
        """Return the largest distance of points that are or were pressed, in periods."""
        support = self._with(pressure, noise)
        half = support.size // 2
        return float((support[:half] + support[half:]).max())

    def refusal(self, pressure: FloatArray, noise: float = 0.0) -> str:
        """Return why pressures, one value a point, are not those of an isolated contact, if so.

        Up to `noise` they are zero to the tolerance of the solver, as all are after a pull-off.
        """
        width = self.width(pressure, noise)
        if width <= self._most:
            return ""
        found = f"pressed points are {width:.3g} periods apart, in which there are periodic images"
        return f"{found}; must be at most {self._most:g}{self._instead(width)}"

    def _instead(self, width: float) -> str:
        """Return words on the period for a contact of a width."""
        if self._body is not None:
            return period_for(self._body, width)
        return would_do(self._boundary.widened(self._grid.period, width / HALF)[0], self._boundary)

    def remember(self, pressure: FloatArray, noise: float = 0.0) -> None:
        """Add the pressures of an accepted step."""
        self._support = self._with(pressure, noise)

    def at_the_edge(self, points: tuple[int, ...]) -> bool:
        """Whether pressed points lie at the edge of so many points in the middle of the grid."""
        for axis in self._boundary.axes:
            directions, n, most = self._directions[axis], points[axis], self._grid.points[axis]
            ends = (n - 2) / (2 * most), n / (2 * most)  # the first point is half of the points away
            along = self._support[directions.argmax()], self._support[directions.argmin()]
            if any(far > end - 0.5 / most for far, end in zip(along, ends, strict=True)):
                return True
        return False

    def masked(self, field: FloatArray) -> FloatArray:
        """Return a field, one value a point, NaN where the displacement is not known."""
        if self._support[0] == -math.inf:
            return field
        axes = np.meshgrid(*self._places, indexing="ij", sparse=True)
        furthest = np.full(self._grid.shape, -math.inf)
        for support, direction in zip(self._support, self._directions.T, strict=True):
            along = sum(cosine * x for cosine, x in zip(direction, axes, strict=True))
            np.maximum(furthest, support - along, out=furthest)
        return np.where(np.ravel(furthest) <= self._most, field, math.nan)

    def _with(self, pressure: FloatArray, noise: float) -> FloatArray:
        """Return the support function with these pressures."""
        ranks, size = self._grid.ranks, np.abs(pressure)
        largest = ranks.maximum(float(size.max(initial=0.0)))
        if largest <= noise:
            return self._support
        pressed = (size > max(_NEGLIGIBLE * largest, noise)).reshape(self._grid.shape)
        points = self._outermost(pressed, self._places)
        support = (points @ self._directions).max(axis=0, initial=-math.inf)
        return np.asarray(np.maximum(self._support, ranks.maximum(support)))

    @property
    def _places(self) -> list[FloatArray]:
        """Coordinates of the points of this process along each axis, in periods, from -1/2 to 1/2."""
        return [x / length for x, length in zip(self._grid.coordinates, self._grid.period, strict=True)]

    @staticmethod
    def _outermost(pressed: BoolArray, axes: list[FloatArray]) -> FloatArray:
        """Return the first and the last pressed point of each row, shape (points, axes)."""
        if pressed.ndim == 1:
            return axes[0][pressed][:, np.newaxis]
        x, y = axes
        order = np.argsort(y)
        ordered, y = pressed[:, order], y[order]
        held = ordered.any(axis=1)
        first, last = ordered.argmax(axis=1), y.size - 1 - ordered[:, ::-1].argmax(axis=1)
        ends = np.concatenate((y[first[held]], y[last[held]]))
        return np.stack((np.tile(x[held], 2), ends), axis=1)
