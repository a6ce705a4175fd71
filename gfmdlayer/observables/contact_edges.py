"""The area of contact below the resolution of the grid, from where pressure and gap vanish.

Next to the edge of contact of a smooth punch the pressure is proportional to d^(1/2) a distance d inside, and
the gap to d^(3/2) outside (Johnson, Contact Mechanics, 1985, ch. 4), so that s = p^2 and q = gap^(2/3) are
straight lines through the edge. Along a line of the grid, let s0 and s1 belong to the last points in contact,
s0 to the outer one, and q0 and q1 to the first points out of it. In units of the spacing the edge lies beyond
the last point in contact

* by c = s0/(s0 + mu q0), mu = (s1 - s0)/(q1 - q0), where s and -mu q are one line, and
* by 1 - u, u = q0/(q1 - q0), where the line of q alone vanishes.

Neither modulus nor history enter. Two corrections:

* s and q are curved: by factors 1 + beta d and 1 - (beta/5) d, beta = (pi/l)(2 tan(v/2) - cot v), v = pi w/l,
  beside a contact of width w that repeats after l, for a sinusoid (Westergaard, J. Appl. Mech. 6, 1939, A49).
  Here w and l - w are the lengths of contact and gap along the line; far from other contacts beta = -1/w.
* The discrete fields next to an edge depend on its place between two points, in the same way for every
  contact. The edge itself is at

      t = -T0 + c^(1/2) + T1 (c - c^(3/2))^(1/2)    or    t = 1 - T0 - u^(3/2) (U0 + U1 u + U2 u^2)

  between -T0 and 1 - T0: a point may still carry pressure beyond the edge. The constants were measured on
  the periodic parabola with 300 points in contact, where both are within 0.002 of the closed form.

Where a viscoelastic body remembers an edge that moved by less than some points, the pressure behind one that
advances is no square root at the scale of the grid, and neither is the gap behind one that recedes; each then
says that the contact is wider than it is. The lesser t is taken.

An edge where pressure and gap do not vanish in this way, as that of a flat punch, lies half-way between the
points. On a surface in two directions the edge is the polygon through these places on the lines of the grid.

The error is of first order in the spacing, as that of the number of points in contact, which is up to a cell
for each edge, and some hundred times smaller.
"""

from __future__ import annotations

import math

import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.kernels import kernel

T0, T1 = 0.1896, 0.0885
U0, U1, U2 = 0.9021, -0.3620, 0.2695
WIDEST = 1.25  # u beyond which the gap does not vanish as beside a smooth punch; at t = -T0 it is 1.13
FARTHEST = 512  # points along which contact and gap are measured


def interpolated_area(touching: BoolArray, pressure: FloatArray, gap: FloatArray) -> float:
    """Return the part of the surface in contact, by edges between the points.

    Parameters
    ----------
    touching : ndarray of bool, of the grid's shape
        Whether each point is in contact.
    pressure, gap : ndarray, of the grid's shape
        Pressure of the wall, and gap.
    """
    if touching.all() or not touching.any():
        return float(touching.all())
    fields = touching.ravel(), pressure.ravel(), gap.ravel()
    points = _length(*fields) if touching.ndim == 1 else _area(*fields, *touching.shape)
    return max(float(points), 0.0) / touching.size


@kernel(inner=True)
def _edge(
    touching: BoolArray, pressure: FloatArray, gap: FloatArray, line: tuple[int, int, int], at: int, step: int
) -> float:
    """Place of the edge between a point in contact and the next along a line, in spacings from the point.

    The line is (index of its first point, stride, number of points), and periodic; `at` counts along it, and
    step is 1 or -1.
    """
    first, stride, n = line
    inside, outside = 1, 1
    while inside < min(n, FARTHEST) and touching[first + (at - inside * step) % n * stride]:
        inside += 1
    while outside < min(n, FARTHEST) and not touching[first + (at + (outside + 1) * step) % n * stride]:
        outside += 1
    s0 = max(pressure[first + at * stride], 0.0) ** 2
    s1 = max(pressure[first + (at - step) % n * stride], 0.0) ** 2 if inside > 1 else 0.0
    q0 = max(gap[first + (at + step) % n * stride], 0.0) ** (2.0 / 3.0)
    q1 = max(gap[first + (at + 2 * step) % n * stride], 0.0) ** (2.0 / 3.0) if outside > 1 else 0.0
    beta = -1.0 / inside
    if outside < FARTHEST:
        angle = math.pi * inside / (inside + outside)
        beta = math.pi / (inside + outside) * (2.0 * math.tan(angle / 2.0) - 1.0 / math.tan(angle))
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
    return t if t < 1.0 else 0.5


@kernel
def _length(touching: BoolArray, pressure: FloatArray, gap: FloatArray) -> float:
    """Length of the contact of a line, in spacings: one for each point, and the edges beyond their halves."""
    n, length = touching.size, 0.0
    for i in range(n):
        if touching[i]:
            length += 1.0
            for step in (-1, 1):
                if not touching[(i + step) % n]:
                    length += _edge(touching, pressure, gap, (0, 1, n), i, step) - 0.5
    return length


@kernel
def _area(touching: BoolArray, pressure: FloatArray, gap: FloatArray, rows: int, columns: int) -> float:
    """Area of the contact of a surface, in cells of the grid, each with a point at its corners."""
    area, t, corners = 0.0, np.empty(4), np.empty(4, np.bool_)
    for i in range(rows):
        below = i + 1 if i + 1 < rows else 0
        for j in range(columns):
            right = j + 1 if j + 1 < columns else 0
            first, other = touching[i * columns + j], touching[below * columns + right]
            second, third = touching[i * columns + right], touching[below * columns + j]
            if first == second == third == other:
                area += first
                continue
            # Corners in turn around the cell; side k lies between the corners k and k + 1.
            corners[0], corners[1], corners[2], corners[3] = first, second, other, third
            for k in range(4):
                if corners[k] == corners[(k + 1) % 4]:
                    continue
                along_row, forward = k % 2 == 0, corners[k] == (k < 2)
                if along_row:
                    line, at = ((i if k == 0 else below) * columns, 1, columns), j if forward else right
                else:
                    line, at = (right if k == 1 else j, columns, rows), i if forward else below
                t[k] = _edge(touching, pressure, gap, line, at, 1 if forward else -1)
            area += _polygon(corners, t, corners.sum())
    return area


@kernel(inner=True)
def _polygon(corners: BoolArray, t: FloatArray, count: int) -> float:
    """Part of a cell inside the contact, from the places of the edge along its sides."""
    area = 1.0 if count == 3 else 0.0
    for k in range(4):
        before = (k + 3) % 4
        differs = corners[k] != corners[(k + 1) % 4] and corners[k] != corners[before]
        if differs and corners[k]:
            area += t[k] * t[before] / 2.0  # a corner in contact, alone or opposite another
        elif differs and count == 3:
            area -= (1.0 - t[k]) * (1.0 - t[before]) / 2.0
        elif count == 2 and corners[k] != corners[(k + 1) % 4]:
            area += 0.0 if differs else t[k] / 2.0
    return area
