"""Rigid indenters of revolution: the Abel transform H(x) of a convex profile h(r).

    H(x) = d/dx int_0^x h(r) r dr/(x^2 - r^2)^(1/2) = x int_0^x h'(r) dr/(x^2 - r^2)^(1/2)

(Sneddon, Int. J. Engng Sci. 3 (1965) 47-57). On an elastic halfspace a frictionless contact of radius a has
the depth H(a). The slope h' is linear between knots, where H has a closed form: a flat end, a paraboloid, a
cone, and these one after the other. A sphere has H = x artanh(x/R).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.arrays import FloatArray, unmasked
from gfmdlayer.files.tables import TableError, read_table
from gfmdlayer.kernels import kernel
from gfmdlayer.validation.reading import Reading, answers

# A contact that comes this near to the equator of a sphere has slopes far beyond the theory's small ones.
_EQUATOR = 0.999

# Part of the largest slope by which slopes of a table may fall: rounding of the heights, not a concave part.
_ROUNDING = 1e-6


class Revolution(NamedTuple):
    """A convex profile of revolution that touches at r = 0; arrays of shape (pieces,)."""

    rim: float  # radius at which the indenter ends; inf where it does not
    sphere: float  # radius of a sphere; 0 for the profiles that follow from the slopes
    knots: FloatArray  # radii at which the pieces begin; the first is 0
    constant: FloatArray  # slope h'(r) = constant + linear r of each piece
    linear: FloatArray


@runtime_checkable
class OfRevolution(Protocol):
    """A shape of the punch that may be a convex body of revolution."""

    def revolution(self) -> Revolution:
        """Return its profile."""
        ...


def of_pieces(knots: ArrayLike, constant: ArrayLike, linear: ArrayLike, rim: float = math.inf) -> Revolution:
    """Return the profile of slope h'(r) = constant + linear r in pieces from each knot on, up to the rim."""
    arrays = (np.array(values, dtype=float) for values in (knots, constant, linear))
    return Revolution(float(rim), 0.0, *arrays)


def paraboloid(radius: float) -> Revolution:
    """Return h = r^2/(2 radius)."""
    return of_pieces([0.0], [0.0], [1 / radius])


def sphere(radius: float) -> Revolution:
    """Return a sphere, which ends at its equator."""
    return Revolution(_EQUATOR * radius, float(radius), np.zeros(1), np.zeros(1), np.zeros(1))


def cone(slope: float) -> Revolution:
    """Return h = slope r."""
    return of_pieces([0.0], [slope], [0.0])


def flat(radius: float) -> Revolution:
    """Return the flat end of a cylinder."""
    return of_pieces([0.0], [0.0], [0.0], rim=radius)


def of_table(r: ArrayLike, h: ArrayLike) -> Revolution:
    """Return the convex profile through a table of radii from 0 and heights, up to its last radius."""
    # The slope is linear between the middles of the rows, where it is the slope of the table: a paraboloid
    # and a cone are exact, other profiles are so to second order in the spacing. ValueError if the radii do
    # not ascend, or the profile is not convex.
    r, h = (np.asarray(unmasked(each), dtype=float) for each in (r, h))
    if r.ndim != 1 or r.shape != h.shape or r.size < 3:
        raise ValueError(f"got radii of shape {r.shape} and heights of shape {h.shape}; must be equal, >= 3")
    if not (np.isfinite(r).all() and np.isfinite(h).all()):
        raise ValueError("the radii and heights must be finite numbers")
    if r[0] != 0 or (steps := np.diff(r)).min() <= 0:
        raise ValueError("the radii must ascend from 0, where the indenter touches first")
    slopes = np.diff(h) / steps
    concave = np.flatnonzero(np.diff(np.append(0.0, slopes)) < -_ROUNDING * abs(slopes).max())
    if concave.size:
        at = concave[0]
        found = f"falls to {slopes[at]:.6g} behind r = {r[at]:.6g}"
        raise ValueError(f"the slope {found}; the profile must be convex, its slope >= 0 and never falling")
    middles, slopes = (r[1:] + r[:-1]) / 2, np.maximum.accumulate(np.maximum(slopes, 0.0))
    growth = np.diff(slopes) / np.diff(middles)
    first = max(slopes[0] - growth[0] * middles[0], 0.0)
    knots = np.concatenate(([0.0], middles[:-1]))
    linear = np.concatenate(([(slopes[0] - first) / middles[0]], growth))
    starts = np.concatenate(([first], slopes[:-1]))
    return of_pieces(knots, starts - linear * knots, linear, rim=float(r[-1]))


def read_profile(file: Path, length: str | None, reading: Reading | None) -> tuple[Revolution, str]:
    """Return the profile of a file with the columns radius and height, in a unit, and how it was read.

    TableError unless it is convex. The order of the rows has no meaning.
    """
    table = read_table(file, ("radius", "height"), answers(reading))
    r, h = table.take("radius", length), table.take("height", length)
    order = table.ascending(r, "radius")
    try:
        return of_table(r[order], h[order] - h[order[0]]), table.account
    except ValueError as error:
        raise TableError(f"{file}: {error}") from None


@kernel
def abel_transform(profile: Revolution, x: float) -> float:
    """Return H(x), a length."""
    if profile.sphere > 0:
        return x * math.atanh(min(x / profile.sphere, 1 - 1e-12))
    knots, total = profile.knots, 0.0
    for i in range(knots.size):
        if knots[i] >= x and i > 0:
            break
        end = min(knots[i + 1], x) if i + 1 < knots.size else x
        if profile.constant[i] != 0 and x > 0:
            total += profile.constant[i] * (math.asin(end / x) - math.asin(knots[i] / x))
        if profile.linear[i] != 0:
            start_root = math.sqrt((x - knots[i]) * (x + knots[i]))
            total += profile.linear[i] * (start_root - math.sqrt((x - end) * (x + end)))
    return x * total


@kernel
def abel_transforms(profile: Revolution, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return H, its slope, and its integral from 0, at x > 0, each of the shape (n,) of x."""
    values, slopes, integrals = np.zeros(x.size), np.zeros(x.size), np.zeros(x.size)
    R, knots = profile.sphere, profile.knots
    for j in range(x.size):
        at = x[j]
        if R > 0:
            log = math.atanh(min(at / R, 1 - 1e-12))
            values[j], slopes[j] = at * log, log + at * R / ((R - at) * (R + at))
            integrals[j] = (R * at - (R - at) * (R + at) * log) / 2
            continue
        for i in range(2 * knots.size):  # each piece begins at its knot and ends at the next one
            piece, sign = i // 2, 1 - 2 * (i % 2)
            end = piece + i % 2
            knot = knots[end] if end < knots.size else math.inf
            c, line = -sign * profile.constant[piece], sign * profile.linear[piece]
            if knot < at:
                root, angle = math.sqrt((at - knot) * (at + knot)), math.asin(knot / at)
                values[j] += at * (c * angle + line * root)
                slopes[j] += c * (angle - knot / root) + line * (root + at * at / root)
                integrals[j] += c * (at * at * angle + knot * root) / 2 + line * root**3 / 3
            elif i % 2:  # the piece that x is in
                values[j] += c * at * math.pi / 2
                slopes[j] += c * math.pi / 2
                integrals[j] += c * at * at * math.pi / 4
            if knot >= at:
                break
    return values, slopes, integrals


def heights(profile: Revolution, r: ArrayLike) -> FloatArray:
    """Return h(r), r >= 0; infinite beyond the rim."""
    r = np.asarray(r, dtype=float)
    if profile.sphere:
        inside = np.minimum(r, profile.sphere)
        h = inside**2 / (profile.sphere + np.sqrt(profile.sphere**2 - inside**2))
    else:
        ends = np.append(profile.knots[1:], np.inf)
        upper = np.minimum(r[..., np.newaxis], ends)
        piece = profile.constant * (upper - profile.knots)
        piece = piece + profile.linear / 2 * (upper**2 - profile.knots**2)
        h = np.where(r[..., np.newaxis] > profile.knots, piece, 0.0).sum(axis=-1)
    return np.where(r > profile.rim, np.inf, h)
