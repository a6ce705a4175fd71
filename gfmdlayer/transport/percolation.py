"""Open paths through a periodic gap: which clusters wind around the cell, and the narrowest place of a path.

Open points join along the axes, never diagonally, as in the five-point scheme of `leakage`. A cluster carries
a flow along an axis if one of its loops leaves the cell that way and comes back on the other side. Touching
both sides is not enough. Each point of a cluster knows in which cell it lies, relative to its root: where two
points of one cluster meet in different cells, a loop winds around.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.kernels import kernel

Indices = NDArray[np.int64]


class Clusters(NamedTuple):
    """Connected open points; `label` (nx, ny), -1 where closed, and `winds` (2, nx, ny), along x and y."""

    label: Indices
    winds: BoolArray


class Throat(NamedTuple):
    """The narrowest place of the widest path along an axis.

    `gap` is the critical gap u_c, the largest for which the points with a gap >= u_c still lead through;
    `place` the indices of the point where it is, `width` [length] and `points` those of the open channel
    there, 0 without a path.
    """

    gap: float
    place: tuple[int, int]
    width: float
    points: float


CLOSED = Throat(0.0, (0, 0), 0.0, 0.0)


def clusters(is_open: BoolArray) -> Clusters:
    """Connect the open points of a periodic surface (nx, ny)."""
    labels, winds, _ = _join(np.flatnonzero(is_open), is_open.shape[0], is_open.shape[1], False)
    return Clusters(labels.reshape(is_open.shape), winds.reshape(2, *is_open.shape))


def throats(gap: FloatArray, spacing: tuple[float, float]) -> tuple[Throat, Throat]:
    """Return the throats along x and y of a gap (nx, ny), 0 in contact."""
    # Points join in the order of their gaps, the widest first, until a cluster winds.
    flat = np.ravel(gap)
    candidates = np.flatnonzero(flat > 0)
    order = candidates[np.argsort(-flat[candidates], kind="stable")]
    *_, last = _join(order, gap.shape[0], gap.shape[1], True)
    return _throat(gap, order, last[0], spacing), _throat(gap, order, last[1], spacing)


def _throat(gap: FloatArray, order: Indices, last: int, spacing: tuple[float, float]) -> Throat:
    """Measure the channel at the point by which the path closed: the shortest open run in four directions."""
    if last < 0:
        return CLOSED
    x, y = divmod(int(order[last]), gap.shape[1])
    width = math.inf
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        along = np.arange(math.lcm(*gap.shape) if dx and dy else gap.shape[0 if dx else 1])
        closed = np.flatnonzero(gap[(x + dx * along) % gap.shape[0], (y + dy * along) % gap.shape[1]] <= 0)
        run = int(closed[0] + along.size - closed[-1] - 1) if closed.size else along.size
        width = min(width, run * math.hypot(dx * spacing[0], dy * spacing[1]))
    return Throat(float(gap[x, y]), (x, y), width, width / max(spacing))


@kernel
def _join(
    order: Indices, rows: int, columns: int, first_only: bool
) -> tuple[Indices, BoolArray, tuple[int, int]]:
    """Open points one after the other, and join each with its open neighbours."""
    # Returns the root of each point (-1: closed), whether its cluster winds along x and y, and the places in
    # `order` at which a cluster first winds along x and along y (-1: never). `first_only` stops there.
    size = rows * columns
    root = np.full(size, -1, np.int64)
    cell = np.zeros((size, 2), np.int32)  # of a point, from the cell of its parent
    winds = np.zeros((2, size), np.bool_)
    first_x, first_y = -1, -1
    for k in range(order.size):
        at = order[k]
        root[at] = at
        x, y = at // columns, at % columns
        for side in range(4):
            nx, ny, cx, cy = x, y, 0, 0
            if side == 0:
                nx, cx = (x + 1, 0) if x + 1 < rows else (0, 1)
            elif side == 1:
                nx, cx = (x - 1, 0) if x > 0 else (rows - 1, -1)
            elif side == 2:
                ny, cy = (y + 1, 0) if y + 1 < columns else (0, 1)
            else:
                ny, cy = (y - 1, 0) if y > 0 else (columns - 1, -1)
            other = nx * columns + ny
            if root[other] < 0:
                continue
            a, ax, ay = _root(root, cell, at)
            b, bx, by = _root(root, cell, other)
            cx, cy = ax + cx - bx, ay + cy - by  # cell of root b, from that of root a
            if a == b:
                winds[0, b] |= cx != 0
                winds[1, b] |= cy != 0
            else:
                root[a], cell[a, 0], cell[a, 1] = b, -cx, -cy
                winds[0, b] |= winds[0, a]
                winds[1, b] |= winds[1, a]
            if first_x < 0 and winds[0, b]:
                first_x = k
            if first_y < 0 and winds[1, b]:
                first_y = k
        if first_only and first_x >= 0 and first_y >= 0:
            break
    if not first_only:
        for k in range(order.size):
            at = order[k]
            at_root = _root(root, cell, at)[0]
            winds[0, at], winds[1, at] = winds[0, at_root], winds[1, at_root]
        for k in range(order.size):
            root[order[k]] = _root(root, cell, order[k])[0]
    return root, winds, (first_x, first_y)


@kernel(inner=True)
def _root(root: Indices, cell: NDArray[np.int32], at: int) -> tuple[int, int, int]:
    """Return the root of a point and the cell of the point from that of the root; halve the path to it."""
    x, y = 0, 0
    while root[at] != at:
        above = root[at]
        if root[above] != above:
            cell[at, 0] += cell[above, 0]
            cell[at, 1] += cell[above, 1]
            root[at] = root[above]
        x += cell[at, 0]
        y += cell[at, 1]
        at = root[at]
    return at, x, y
