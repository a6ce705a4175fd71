"""Interface laws in compiled code: sums of terms, each of one form, which any kernel evaluates in its loops.

A law is a record `Terms` of arrays with one value a term; a kernel takes it as an argument and calls

    energy, traction, curvature = interact(gap, terms)

at a point. Unused ones of the three cost nothing, and the hard wall has no terms. With the stress s and
the length l of a term, and the gap g,

    exponential      w = -s l exp(-g/l)                      tau = s exp(-g/l)
    Lennard-Jones    w = -s l (x^2/2 - x^8/8)                tau = s (x^3 - x^9),      x = l/(l + g)
    inverse square   w = -s l x                              tau = s x^2,              x = l/(l + g)
    cohesive zone    w = -int tau dg from g to infinity      tau = s (1 - 3 y^2 + 2 y^3)

with y = (g - l)/width + 1/2 between 0 and 1. The curvature is dtau/dg. A further form is a number, a function
and a line in `term`.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.kernels import kernel

EXPONENTIAL, LENNARD_JONES, INVERSE_SQUARE, COHESIVE_ZONE = range(4)


class Terms(NamedTuple):
    """The terms of a law, one value a term."""

    form: IntArray  # `EXPONENTIAL`, `LENNARD_JONES`, `INVERSE_SQUARE` or `COHESIVE_ZONE`
    stress: FloatArray
    length: FloatArray
    width: FloatArray  # of a cohesive zone's ramp, else without meaning


# The exponential is zero from here on: 2e-28 of its value in contact.
_FARTHEST = 64.0
_QUARTER = float(np.exp(-0.25))


Values = tuple[float, float, float]


@nb.njit(inline="always")
def _decay(x: float) -> float:
    """Return exp(-x), x >= 0, within 5e-14 of its value, only by products and sums."""
    # The vector units take it, and it stays exact where sums may be reordered: exp(-x/128) is a power series
    # about x = 32, whose remainder is (1/4)^13/13! = 2e-18, and is squared seven times.
    y = 0.25 - min(x, _FARTHEST) / 128
    e = 1 + y * (1 / 12)
    e = 1 + y * (1 / 11) * e
    e = 1 + y * (1 / 10) * e
    e = 1 + y * (1 / 9) * e
    e = 1 + y * (1 / 8) * e
    e = 1 + y * (1 / 7) * e
    e = 1 + y * (1 / 6) * e
    e = 1 + y * (1 / 5) * e
    e = 1 + y * (1 / 4) * e
    e = 1 + y * (1 / 3) * e
    e = 1 + y * (1 / 2) * e
    e = _QUARTER * (1 + y * e)
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e if x < _FARTHEST else 0.0


@nb.njit(inline="always")
def _exponential(gap: float, stress: float, length: float) -> Values:
    traction = stress * _decay(gap / length)
    return -traction * length, traction, -traction / length


@nb.njit(inline="always")
def _lennard_jones(gap: float, stress: float, length: float) -> Values:
    x = length / (length + gap)
    x2, x3 = x * x, x * x * x
    x8, x9 = x2 * x3 * x3, x3 * x3 * x3
    energy = -stress * length * (x2 / 2 - x8 / 8)
    return energy, stress * (x3 - x9), stress / length * x * (9 * x9 - 3 * x3)


@nb.njit(inline="always")
def _inverse_square(gap: float, stress: float, length: float) -> Values:
    x = length / (length + gap)
    return -stress * length * x, stress * x * x, -2 * stress / length * x * x * x


@nb.njit(inline="always")
def _cohesive_zone(gap: float, stress: float, length: float, width: float) -> Values:
    y = min(max((gap - length) / width + 0.5, 0.0), 1.0)
    before = max(length - 0.5 * width - gap, 0.0)
    ramp = 0.5 - y + y**3 - 0.5 * y**4  # integral of the ramp from y to 1
    return (
        -stress * (before + width * ramp),
        stress * (1 - y * y * (3 - 2 * y)),
        -6 * stress / width * y * (1 - y),
    )


@nb.njit(inline="always")
def term(gap: float, form: int, stress: float, length: float, width: float) -> Values:
    """Energy, traction and curvature at a gap g >= 0, of one term."""
    if form == EXPONENTIAL:
        return _exponential(gap, stress, length)
    if form == LENNARD_JONES:
        return _lennard_jones(gap, stress, length)
    if form == INVERSE_SQUARE:
        return _inverse_square(gap, stress, length)
    return _cohesive_zone(gap, stress, length, width)


@nb.njit(inline="always")
def interact(gap: float, terms: Terms) -> Values:
    """Energy, traction and curvature at a gap g >= 0, of all terms together."""
    energy, traction, curvature = 0.0, 0.0, 0.0
    for k in range(terms.form.size):
        e, t, c = term(gap, terms.form[k], terms.stress[k], terms.length[k], terms.width[k])
        energy, traction, curvature = energy + e, traction + t, curvature + c
    return energy, traction, curvature


@kernel(reorder=True)
def add_energy(gap: FloatArray, terms: Terms, out: FloatArray) -> None:
    """Add the energy at each of many gaps; the loop over the points is inside, for the vector units."""
    for k in range(terms.form.size):
        form, stress, length, width = terms.form[k], terms.stress[k], terms.length[k], terms.width[k]
        for i in range(gap.size):
            out[i] += term(gap[i], form, stress, length, width)[0]


@kernel(reorder=True)
def add_traction(gap: FloatArray, terms: Terms, out: FloatArray) -> None:
    """Add the traction at each of many gaps."""
    for k in range(terms.form.size):
        form, stress, length, width = terms.form[k], terms.stress[k], terms.length[k], terms.width[k]
        for i in range(gap.size):
            out[i] += term(gap[i], form, stress, length, width)[1]


@kernel(reorder=True)
def add_curvature(gap: FloatArray, terms: Terms, out: FloatArray) -> None:
    """Add the curvature at each of many gaps."""
    for k in range(terms.form.size):
        form, stress, length, width = terms.form[k], terms.stress[k], terms.length[k], terms.width[k]
        for i in range(gap.size):
            out[i] += term(gap[i], form, stress, length, width)[2]
