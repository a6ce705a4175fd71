"""Histograms over the points in contact, their connected patches, and their area between the points."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba as nb
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.kernels import in_python, kernel

_CUSP = 3.0  # a cusp bends so many times more than the smooth part; on a parabola of n points it is n times


def is_upside_down(obstacle: FloatArray, grid: Grid) -> bool:
    """Whether a punch touches first in a cusp at the edge of the cell, and is smooth where it is deepest.

    A convex punch with the wrong sign is upside down. `obstacle` is its surface upward, one value a point; a
    punch over several ranks is not examined.
    """
    if not grid.is_whole:
        return False
    heights = obstacle.reshape(grid.shape)
    touches, deepest = (np.unravel_index(at, heights.shape) for at in (heights.argmin(), heights.argmax()))

    def bend(at: tuple[Any, ...]) -> float:
        """Sum of the second differences along the axes."""
        lines: list[FloatArray] = [heights[(*at[:k], slice(None), *at[k + 1 :])] for k in range(len(at))]
        return sum(
            abs(float(h[i - 1] - 2 * h[i] + h[(i + 1) % h.size])) for i, h in zip(at, lines, strict=True)
        )

    at_the_edge = any(i in (0, n - 1) for i, n in zip(touches, heights.shape, strict=True))
    return at_the_edge and bend(touches) > _CUSP * bend(deepest)


def histogram(values: FloatArray, chosen: BoolArray, edges: ArrayLike, ranks: Ranks = ALONE) -> FloatArray:
    """Return the part of all points that are chosen and have a value in each bin, lower edge included.

    The edges increase to inf. A value below the first edge, by rounding, is in the first bin.
    """
    counts = _counts(values, chosen, np.asarray(edges, dtype=float))
    return np.asarray(ranks.total(counts) / ranks.total(values.size))


@kernel
def _counts(values: FloatArray, chosen: BoolArray, edges: FloatArray) -> NDArray[np.int64]:
    counts = np.zeros(edges.size - 1, np.int64)
    for i in range(values.size):
        if chosen[i]:
            counts[max(np.searchsorted(edges, values[i], side="right") - 1, 0)] += 1
    return counts


@kernel(borrows=True)
def attracted(touching: BoolArray, traction: FloatArray, least: float) -> int:
    """Count the points out of contact with a traction of at least so much."""
    points = 0
    for i in range(touching.size):
        points += 1 if traction[i] >= least and not touching[i] else 0
    return points


def count_patches(touching: BoolArray, grid: Grid) -> int:
    """Count the connected patches of a periodic surface; neighbours lie along the axes."""
    from scipy import ndimage
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ranks = grid.ranks
    labels, own = ndimage.label(touching)
    before, count = ranks.counted(own)
    labels = np.where(labels > 0, labels.astype(np.int64) + before, 0)
    # Patches that meet across an edge of the cell, or of a rank's rows, are one: connected in a graph.
    _, below = grid.halo(labels, 0, 1)
    ends = [(labels[-1:].ravel(), below.ravel())]
    ends += [(labels[:, 0], labels[:, -1])] if labels.ndim == 2 else []
    pairs = np.concatenate([np.stack(pair, axis=1) for pair in ends])
    pairs = ranks.gathered(np.unique(pairs[(pairs > 0).all(axis=1)], axis=0)) - 1
    patches = 0
    if ranks.first and count:
        graph = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(count, count))
        patches = int(connected_components(graph, directed=False)[0])
    return ranks.maximum(patches)


# The area of contact below the resolution of the grid, from where pressure and gap vanish.
#
# Next to the edge of contact of a smooth punch the pressure is proportional to d^(1/2) a distance d inside,
# and the gap to d^(3/2) outside (Johnson, Contact Mechanics, 1985, ch. 4), so that s = p^2 and q = gap^(2/3)
# are straight lines through the edge. Along a line of the grid, let s0 and s1 belong to the last points in
# contact, s0 to the outer one, and q0 and q1 to the first points out of it. In units of the spacing the edge
# lies beyond the last point in contact
#
# * by c = s0/(s0 + mu q0), mu = (s1 - s0)/(q1 - q0), where s and -mu q are one line, and
# * by 1 - u, u = q0/(q1 - q0), where the line of q alone vanishes.
#
# Neither modulus nor history enter. Two corrections:
#
# * s and q are curved: by factors 1 + beta d and 1 - (beta/5) d, beta = (pi/l)(2 tan(v/2) - cot v),
#   v = pi w/l, beside a contact of width w that repeats after l, for a sinusoid (Westergaard, J. Appl. Mech.
#   6, 1939, A49). Here w and l - w are the lengths of contact and gap along the line; far from other contacts
#   beta = -1/w.
# * The discrete fields next to an edge depend on its place between two points, in the same way for every
#   contact. The edge itself is at
#
#       t = -T0 + c^(1/2) + T1 (c - c^(3/2))^(1/2)    or    t = 1 - T0 - u^(3/2) (U0 + U1 u + U2 u^2)
#
#   between -T0 and 1 - T0: a point may still carry pressure beyond the edge. The constants were measured on
#   the periodic parabola with 300 points in contact, where both are within 0.002 of the closed form.
#
# A viscoelastic body remembers an edge that moved by less than some points. Then the pressure behind an edge
# that advances is no square root at the scale of the grid, nor the gap behind an edge that recedes; either
# places the edge too far out. The smaller t is taken.
#
# An edge where pressure and gap do not vanish in this way, like the edge of a flat punch, lies half-way
# between the points. On a surface in two directions the edge is the polygon through these places on the lines
# of the grid.
#
# The error is less than that of the number of points in contact, which is up to a cell for each edge: 10 to
# 80 times on a sphere whose contact is 10 to 90 points wide, and 2 to 16 times on rough surfaces with 4 to 32
# points for the shortest wave, see `area_error`.

T0, T1 = 0.1896, 0.0885
U0, U1, U2 = 0.9021, -0.3620, 0.2695
_OFF, _OFF_LINE = 0.35, 0.02  # spacings, see `_extent`
_OFF_INSIDE, _OFF_BENT, _OFF_OUTSIDE = 0.25, 3.0, 1.0  # spacings for each unit of curvature, see `_edge`
_UNEVEN = 0.6  # part of the doubts that is left on a surface: spheres on layers of 0.6 to 13 spacings, cones
WIDEST = 1.25  # u beyond which the gap does not vanish as beside a smooth punch; at t = -T0 it is 1.13

FARTHEST = 512  # points along which contact and gap are measured
_BLOCK = 64  # points or cells that are passed over together where all are in contact, or none


class ContactExtent(NamedTuple):
    """Size of a contact."""

    points: int  # in contact
    area: float  # as a part of the surface, the edge located between the points
    error: float  # estimate of that of the area


def contact_extent(touching: BoolArray, pressure: FloatArray, gap: FloatArray, grid: Grid) -> ContactExtent:
    """Measure a contact from fields, one value a point; the wall's pressure."""
    ranks = grid.ranks
    if len(grid.shape) == 1:
        return ContactExtent(*line_extent(touching, pressure, gap))
    far, near = (min(grid.points[0], FARTHEST) + 1, 3) if ranks.count > 1 else (0, 0)
    marks, *fields = (
        _with_halo(field, rows, grid) for field, rows in ((touching, far), (pressure, near), (gap, near))
    )
    shape = grid.shape[0], grid.shape[1]
    parts = _area(marks, fields[0], fields[1], (far, near), shape, grid.points[0])
    number, area, crossings, doubt = ranks.total(np.array(parts)).tolist()
    return ContactExtent(*in_python(_extent)(int(number), area, (crossings, doubt), grid.size, 2))


@kernel(borrows=True)
def extent_of_line(
    touching: BoolArray, pressure: FloatArray, gap: FloatArray, _shape: tuple[int, int]
) -> tuple[int, float, float]:
    """`contact_extent` of a line for compiled loops."""
    return line_extent(touching, pressure, gap)


@kernel
def extent_of_surface(
    touching: BoolArray, pressure: FloatArray, gap: FloatArray, shape: tuple[int, int]
) -> tuple[int, float, float]:
    """`contact_extent` of a surface in two directions for compiled loops."""
    number, area, crossings, doubt = _area(touching, pressure, gap, (0, 0), shape, shape[0])
    return _extent(int(number), area, (crossings, doubt), touching.size, 2)


def _with_halo(field: NDArray[Any], rows: int, grid: Grid) -> NDArray[Any]:
    """Return a field, flat, with some rows of the neighbours before and after those of this rank."""
    if not rows:
        return field.ravel()
    field = field.reshape(grid.shape)
    before, after = grid.halo(field, rows, rows)
    return np.concatenate((before.ravel(), field.ravel(), after.ravel()))


@kernel(inner=True, borrows=True)
def _edge(
    pressure: FloatArray,
    gap: FloatArray,
    line: tuple[int, int, int, int],
    step: int,
    inside: int,
    outside: int,
) -> tuple[float, float]:
    """Place of the edge between a point in contact and the next along a line, and a doubt of it, in spacings.

    The place is counted from the point. The doubt is that of the laws: over three points on either side of
    the edge, s and q are no lines where the pressure falls over less than some spacings, as on a layer as
    thin as that or beside the tip of a wedge. Their second differences over the first ones measure it. The
    factors bound the error of lines on layers of 0.3 to 30 spacings, under wedges and parabolas that
    touch 3 to 80 points, against 4096 points.

    A line is (index of its first point, stride, number of points, place of the point on it), and periodic;
    step is 1 or -1. `inside` and `outside` are the points on either side of the edge that are in contact, and
    out of it, as many as are measured.
    """
    first, stride, n, at = line
    s0 = max(pressure[first + at * stride], 0.0) ** 2
    s1 = max(pressure[first + (at - step) % n * stride], 0.0) ** 2 if inside > 1 else 0.0
    q0 = max(gap[first + (at + step) % n * stride], 0.0) ** (2.0 / 3.0)
    q1 = max(gap[first + (at + 2 * step) % n * stride], 0.0) ** (2.0 / 3.0) if outside > 1 else 0.0
    beta = -1.0 / inside
    if outside < FARTHEST:
        angle = math.pi * inside / (inside + outside)
        beta = math.pi / (inside + outside) * (2.0 * math.tan(angle / 2.0) - 1.0 / math.tan(angle))
    s2 = max(pressure[first + (at - 2 * step) % n * stride], 0.0) ** 2 if inside > 2 else 0.0
    q2 = max(gap[first + (at + 3 * step) % n * stride], 0.0) ** (2.0 / 3.0) if outside > 2 else 0.0
    of_s = _curvature(s0 / (1.0 + 0.5 * beta), s1 / (1.0 + 1.5 * beta), s2 / (1.0 + 2.5 * beta))
    of_q = _curvature(q0 / (1.0 - 0.1 * beta), q1 / (1.0 - 0.3 * beta), q2 / (1.0 - 0.5 * beta))
    of_s, of_q = abs(of_s), max(_OFF_OUTSIDE * of_q, -_OFF_BENT * of_q)
    doubt = max(_OFF_INSIDE * of_s * min(of_s, 1.0), of_q)
    c, by_both = 0.5, 1.0
    for _ in range(4):
        a0, a1 = s0 / (1.0 + beta * min(c, 0.9)), s1 / (1.0 + beta * (1.0 + min(c, 0.9)))
        b0, b1 = q0 / (1.0 - beta / 5.0 * (1.0 - c)), q1 / (1.0 - beta / 5.0 * (2.0 - c))
        if not (a1 > a0 and b1 > b0):
            break
        c = a0 * (b1 - b0) / (a0 * (b1 - b0) + (a1 - a0) * b0)
    else:
        by_both = -T0 + math.sqrt(c) + T1 * math.sqrt(c * (1.0 - math.sqrt(c)))
    u, by_gap = 0.5, 1.0
    for _ in range(4):
        b0, b1 = q0 / (1.0 - beta / 5.0 * u), q1 / (1.0 - beta / 5.0 * (1.0 + u))
        if not b0 < WIDEST * (b1 - b0):
            break
        u = b0 / (b1 - b0)
    else:
        by_gap = 1.0 - T0 - u**1.5 * (U0 + U1 * u + U2 * u**2)
    t = min(by_both, by_gap)
    return (t, min(doubt, 0.5)) if t < 1.0 else (0.5, 0.5)


@nb.njit(inline="always")
def _curvature(first: float, second: float, third: float) -> float:
    """Second difference of three numbers over the first one; 1 where they do not rise."""
    return (third - 2.0 * second + first) / (second - first) if third > second > first else 1.0


@kernel(inner=True, borrows=True)
def _run(marks: BoolArray, place: int, step: int) -> int:
    """Points of a line from one on that are all in contact or all out of it, as many as are measured."""
    n, state, length, slowly = marks.size, marks[place], 0, 0
    farthest = min(n, FARTHEST)
    while length < farthest and marks[place] == state:
        many, low = 1, place if step > 0 else place - _BLOCK
        if slowly == 0:
            many = _BLOCK if low >= 0 and low + _BLOCK < n and _alike(marks[low : low + _BLOCK + 1]) else 1
            slowly = 0 if many > 1 else _BLOCK
        slowly -= slowly > 0
        length += many
        place += many * step
        place = place - n if place == n else (n - 1 if place < 0 else place)
    return min(length, farthest)


@kernel(inner=True)
def _runs_across(marks: BoolArray, begin: int, columns: int, farthest: int) -> NDArray[np.int32]:
    """Points above and below the places where the contact changes between a row and the next; (places, 2).

    The places are in the order of the rows, from one on. Columns are periodic; `farthest` points count.
    """
    rows, count, skipped = marks.size // columns, 0, 0
    runs = np.empty((marks.size, 2), np.int32)  # pages that are not written cost nothing
    # In each column, the first place and the last: the row above it, and which it is.
    above, which = np.empty((2, columns), np.int64), np.empty((2, columns), np.int64)
    above[:] = -1
    for i in range(rows):
        skipped = count if i == begin else skipped
        below = i + 1 if i + 1 < rows else 0
        upper, lower = marks[i * columns :][:columns], marks[below * columns :][:columns]
        for start in range(0, columns, _BLOCK):
            end = min(start + _BLOCK, columns)
            if not _differ(upper[start:end], lower[start:end]):
                continue
            for j in range(start, end):
                if upper[j] == lower[j]:
                    continue
                if above[0, j] < 0:
                    above[0, j], which[0, j] = i, count
                else:
                    runs[which[1, j], 1] = runs[count, 0] = min(i - above[1, j], farthest)
                above[1, j], which[1, j] = i, count
                count += 1
    for j in range(columns):
        if above[0, j] >= 0:
            around = min(above[0, j] + rows - above[1, j], farthest)
            runs[which[0, j], 0] = runs[which[1, j], 1] = around
    return runs[skipped:]


@nb.njit(inline="always")
def _extent(
    number: int, area: float, edges: tuple[float, float], size: int, dimensions: int
) -> tuple[int, float, float]:
    """Return `ContactExtent` of a surface of so many points, from sums over its points, cells and edges.

    These are the number of crossings of the edge along lines of the grid, and the sum of their doubts. Each
    crossing is off by 0.35/w spacings, w being the mean width of the contact along such lines in points, and
    by 0.02 on a line; all of them are off by the sum of the doubts, if this is more. On a surface the doubts
    cancel in part, since the edge lies at another place between two points on each line.
    """
    part, (crossings, doubt) = max(area, 0.0) / size, edges
    if crossings == 0:
        return number, part, 0.0
    width = 2 * dimensions * part * size / crossings
    offset = max(_OFF / width if width > 0 else 0.5, _OFF_LINE if dimensions == 1 else 0.0)
    doubt *= _UNEVEN if dimensions == 2 else 1.0
    return number, part, max(crossings * min(offset, 0.5), doubt) / size


@kernel(borrows=True)
def line_extent(touching: BoolArray, pressure: FloatArray, gap: FloatArray) -> tuple[int, float, float]:
    """Measure the contact of a line as `ContactExtent`."""
    # Its length in spacings is one for each point, and the edges beyond their halves.
    n, number, length, crossings, doubts, i = touching.size, 0, 0.0, 0, 0.0, 0
    while i < n:
        alike = 0 < i < n - _BLOCK and _alike(touching[i - 1 : i + _BLOCK + 1])
        many = min(_BLOCK, n - i)
        if alike and touching[i]:
            number, length = number + many, _enlarged(length, many)
        elif not alike:
            for at in range(i, i + many):
                if touching[at]:
                    number, length = number + 1, length + 1.0
                    for step in (-1, 1):
                        beside = (at + step) % n
                        if not touching[beside]:
                            inside, outside = _run(touching, at, -step), _run(touching, beside, step)
                            t, doubt = _edge(pressure, gap, (0, 1, n, at), step, inside, outside)
                            length, doubts = length + (t - 0.5), doubts + doubt
                            crossings += 1
        i += many
    return _extent(number, length, (float(crossings), doubts), n, 1)


@kernel(inner=True, borrows=True)
def _alike(marks: BoolArray) -> bool:
    """Whether the points of a stretch are all in contact or all out of it."""
    return not _differ(marks[1:], marks)


@kernel(inner=True, borrows=True)
def _differ(marks: BoolArray, others: BoolArray) -> bool:
    """Whether some points are in contact in only one of two stretches."""
    found = False
    for k in range(marks.size):
        found |= marks[k] != others[k]
    return found


@kernel(inner=True, borrows=True)
def _enlarged(area: float, cells: int) -> float:
    """Return an area with some whole cells added, rounded as if one were added after the other."""
    # Below 2^50 only an addition that passes a power of two is rounded; cells <= area pass one at most.
    if cells <= area:
        return area + cells
    for _ in range(cells):
        area += 1.0
    return area


@kernel
def _area(
    touching: BoolArray,
    pressure: FloatArray,
    gap: FloatArray,
    before: tuple[int, int],
    shape: tuple[int, int],
    period: int,
) -> tuple[float, float, float, float]:
    """Points in contact, area of contact in cells, sides of cells that the edge crosses, and their doubts.

    A cell of the grid has a point at each of its corners. The rows are those of a shape; before and after
    them come further ones, so many in `touching` and in the other fields, or none where the rows are all of
    the period.
    """
    number, crossings, doubts = 0, 0, 0.0
    area, t, doubt, corners = 0.0, np.empty(4), np.empty(4), np.empty(4, np.bool_)
    (far, near), (rows, columns) = before, shape
    above = np.empty(
        (2, columns)
    )  # places of the edge along the sides below the last row of cells, and doubts
    runs, crossed = _runs_across(touching, far, columns, min(period, FARTHEST)), 0
    for i in range(rows):
        below = i + 1 if far or i + 1 < rows else 0
        here, there = (far + i) * columns, (far + below) * columns
        upper, lower = touching[here : here + columns], touching[there : there + columns]
        first_place, crossed = crossed, crossed + (upper[0] != lower[0])
        for start in range(0, columns, _BLOCK):
            many, first = min(_BLOCK, columns - start), upper[start]
            if (
                start + many < columns
                and first == lower[start]
                and _alike(upper[start : start + many + 1])
                and _alike(lower[start : start + many + 1])
            ):
                if first:
                    number, area = number + many, _enlarged(area, many)
                continue
            for j in range(start, start + many):
                right = j + 1 if j + 1 < columns else 0
                first, second, third, other = upper[j], upper[right], lower[j], lower[right]
                number += first
                if first == second == third == other:
                    area += first
                    continue
                crossings += (first != second) + (first != third)
                # Corners in turn around the cell; side k lies between the corners k and k + 1.
                corners[0], corners[1], corners[2], corners[3] = first, second, other, third
                t[0], t[3], doubt[0], doubt[3] = above[0, j], t[1], above[1, j], doubt[1]
                for k in range(4):
                    shared = (k == 0 and i > 0) or (k == 3 and j > 0)
                    if shared or corners[k] == corners[(k + 1) & 3]:
                        continue
                    forward = corners[k] == (k < 2)
                    step = 1 if forward else -1
                    if k % 2 == 0:
                        row, (at, after) = upper if k == 0 else lower, (j, right) if forward else (right, j)
                        line = (near + (i if k == 0 else below)) * columns, 1, columns, at
                        inside, outside = _run(row, at, -step), _run(row, after, step)
                    else:
                        column = right if k == 1 else j
                        line = column, columns, rows + 2 * near, near + (i if forward else below)
                        place, crossed = (first_place, crossed) if column == 0 else (crossed, crossed + 1)
                        inside, outside = runs[place, 1 - forward], runs[place, int(forward)]
                    t[k], doubt[k] = _edge(pressure, gap, line, step, inside, outside)
                above[0, j], above[1, j] = t[2], doubt[2]
                doubts += (doubt[0] if first != second else 0.0) + (doubt[3] if first != third else 0.0)
                area += _polygon(corners, t, int(first) + int(second) + int(third) + int(other))
    return float(number), area, float(crossings), doubts


@kernel(inner=True, borrows=True)
def _polygon(corners: BoolArray, t: FloatArray, count: int) -> float:
    """Part of a cell inside the contact, from the places of the edge along its sides."""
    area = 1.0 if count == 3 else 0.0
    for k in range(4):
        before = (k + 3) & 3
        differs = corners[k] != corners[(k + 1) & 3] and corners[k] != corners[before]
        if differs and corners[k]:
            area += t[k] * t[before] / 2.0  # a corner in contact, alone or opposite another
        elif differs and count == 3:
            area -= (1.0 - t[k]) * (1.0 - t[before]) / 2.0
        elif count == 2 and corners[k] != corners[(k + 1) & 3]:
            area += 0.0 if differs else t[k] / 2.0
    return area
