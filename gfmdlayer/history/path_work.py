"""The work of a step, from pressure and displacement of the surface at its rows.

Where the surface touches the gap g is zero, elsewhere the pressure p. So the work of the punch over its depth
d is that of the pressure at each point over v = d + g, the displacement of the surface but for the shape of
the punch,

    int <p> dd = int <p dv>,        as  <p dg> = 0        (<> is the mean over the points)

With the sum S_ij = <(p_i + p_j) (v_j - v_i)> of two rows, the trapezoidal rule of each point has S_01/2. This
is the work of an elastic body over a step of any length, whatever touches at its ends: p is then linear in v
and symmetric, <p_i v_j> = <p_j v_i> (Betti). The curve of <p> over d has a corner at each grid point that
comes into contact; these sums have none. What is left is the relaxation in the step, which is smooth. The
parabola in time through the row before adds, for a step of length s after one of length r,

    s^2/(6 r (r + s)) (S_-10 + S_01 - S_-11)

and the error is of fourth order in the step. While the drive rests, depth or mean pressure is constant, and
the work is <p_0 + p_1> (d_1 - d_0)/2.

Where the surface yields, v = d + g - W with the height W that it has lost, and the plastic work comes on top.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from gfmdlayer.arrays import FloatArray
from gfmdlayer.kernels import kernel
from gfmdlayer.resumable import Saving

if TYPE_CHECKING:
    from gfmdlayer.grid.grid import Grid

TIME, DEPTH, PRESSURE, PRESCRIBED, SWEPT = range(5)  # of a row; swept since the row before, see `swept`


@kernel(borrows=True)
def work_of_step(rows: FloatArray, known: int, now: FloatArray, since_first: float) -> float:
    """Work of a step to a row, from the last two rows, of which one or two are known."""
    # `since_first` is what the pressure has swept since the first of them.
    start, width = rows[1], now[DEPTH] - rows[1, DEPTH]
    work = width * (start[PRESSURE] + now[PRESSURE]) / 2.0
    if now[PRESCRIBED] == start[PRESCRIBED]:
        return float(work)
    work += now[SWEPT] / 2.0
    if known > 1:
        before = rows[0]
        s, r = now[TIME] - start[TIME], start[TIME] - before[TIME]
        triangle = (now[PRESSURE] - start[PRESSURE]) * (before[DEPTH] - start[DEPTH])
        triangle -= (before[PRESSURE] - start[PRESSURE]) * width
        triangle += start[SWEPT] + now[SWEPT] - since_first
        work += triangle * s * s / (6.0 * r * (r + s))
    return float(work)


@kernel(reorder=True, borrows=True)
def swept(p: FloatArray, gap: FloatArray, new_p: FloatArray, new_gap: FloatArray) -> float:
    """Sum of (p_i + p_j) (g_j - g_i) over the points, from one row to another."""
    total = 0.0
    for i in range(p.size):
        total += (p[i] + new_p[i]) * (new_gap[i] - gap[i])
    return total


def swept_since(
    rows: Iterable[tuple[FloatArray, FloatArray]], p: FloatArray, gap: FloatArray, grid: Grid
) -> tuple[float, ...]:
    """Return the mean of `swept` since each of some rows, which have pressure and gap."""
    return tuple(grid.sums.total(swept(*row, p, gap)) / grid.size for row in rows)


class LastRows(Saving):
    """Pressure and gap of the last two rows, since the last breakpoint of the drives."""

    KEPT = "pressures", "gaps"

    def __init__(self) -> None:
        self._pressures: deque[FloatArray] = deque(maxlen=2)
        self._gaps: deque[FloatArray] = deque(maxlen=2)

    def __iter__(self) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield pressure and gap of each row, the last one last."""
        return zip(self._pressures, self._gaps, strict=True)

    def remember(self, p: FloatArray, gap: FloatArray, *, at_breakpoint: bool) -> None:
        """Add a row."""
        if at_breakpoint:
            self._pressures.clear()
            self._gaps.clear()
        self._pressures.append(p)
        self._gaps.append(gap)
