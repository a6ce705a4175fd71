"""The residual of the contact problem: one definition, which every solver stops on.

    residual = max |min(p_c/P, g/D)|        over the points

with the pressure p_c of the wall, the gap g, and scales P and D of pressure and depth. It is zero exactly at
the solution of p_c >= 0, g >= 0, p_c g = 0. Where p_c is at the hardness g is not below zero: the height that
the surfaces lose is no part of the gap.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.grid.ranks import Ranks
from gfmdlayer.kernels import LANES, filled, in_python, kernel, maximum, minimum

# Pressures count against at least this part of what the lowest mode carries at the depth of the surface.
# Without it a surface out of contact would compare rounding errors with rounding errors: those reach
# 1e-16 n/2 of that pressure, 1e-10 at n = 2^20, which a tolerance of 1e-6 still tells from contact.
_PRESSURE_FLOOR = 1e-3


class ResidualFloor(NamedTuple):
    """Bounds of the residual's scales.

    The pressure scale is at least the lowest mode's (stiffness kappa_1) and `pressure`, the largest
    traction of the interface; the depth scale is at least `depth` and at most `range`, the interface's.
    """

    stiffness: float
    depth: float
    pressure: float = 0.0
    range: float = np.inf


class Assessment(NamedTuple):
    """A state's residual, fraction of points in contact, and means of pressure and gap."""

    residual: float
    contact_area: float
    mean_pressure: float
    mean_gap: float


@nb.njit(inline="always")
def violation(pressure: float, gap: float, per_pressure: float, per_gap: float) -> float:
    """Violation of p >= 0, gap >= 0, p gap = 0 at one point: |min(p/P, gap/D)|, from 1/P and 1/D."""
    pressure *= per_pressure
    gap *= per_gap
    return abs(pressure if pressure < gap else gap)


@nb.njit(inline="always")
def scales(largest_pressure: float, deepest: float, floor: ResidualFloor) -> tuple[float, float]:
    """Scales (P, D) of the residual, from the largest pressure and the deepest point of the surface."""
    # Each number of arguments of `max` takes its time to compile.
    depth = max(max(deepest, floor.depth), 1e-300)
    pressure = max(max(largest_pressure, floor.pressure), _PRESSURE_FLOOR * floor.stiffness * depth)
    return max(pressure, 1e-300), min(depth, floor.range)  # not zero, where the depth is not a number


@kernel(reorder=True, inner=True, borrows=True)
def _extrema(pressure: FloatArray, u: FloatArray) -> tuple[float, float, float]:
    """Largest pressure and lowest displacement of a state without NaN, and the sum of the displacement."""
    largest, lowest, total = filled(LANES, 0.0), filled(LANES, np.inf), 0.0
    for first in range(0, u.size, LANES):
        ps, us = pressure[first : first + LANES], u[first : first + LANES]
        for i in range(us.size):
            largest[i] = ps[i] if ps[i] > largest[i] else largest[i]
            lowest[i] = us[i] if us[i] < lowest[i] else lowest[i]
            total += us[i]
    return maximum(largest), minimum(lowest), total


def scales_over(
    ranks: Ranks, pressure: FloatArray, u: FloatArray, floor: ResidualFloor
) -> tuple[float, float]:
    """Scales (P, D) of the residual of a state of which each rank holds its part."""
    if ranks.count == 1:
        both: tuple[float, float] = residual_scales(pressure, u, floor)
        return both
    largest, lowest, total = _extrema_part(pressure, u)
    total, size = ranks.total(np.array([total, u.size])).tolist()
    largest, depth = ranks.maximum(np.array([largest, -lowest])).tolist()
    pressure_scale, depth_scale = in_python(scales)(largest, max(total / size, 0.0) + depth, floor)
    return float(pressure_scale), float(depth_scale)


def assess_over(
    ranks: Ranks, pressure: FloatArray, u: FloatArray, h: FloatArray, floor: ResidualFloor
) -> tuple[float, float, float, float]:
    """Assess a state of which each rank holds its part, see `assess`."""
    if ranks.count == 1:
        assessment: tuple[float, float, float, float] = assess(pressure, u, h, floor)
        return assessment
    pressure_scale, depth = scales_over(ranks, pressure, u, floor)
    worst, *sums = _assess_part(pressure, u, h, 1.0 / pressure_scale, 1.0 / depth)
    touching, total, gaps, size = ranks.total(np.array([*sums, u.size])).tolist()
    worst = ranks.maximum(float(worst))
    finite = np.isfinite(total) and np.isfinite(gaps)
    return worst if finite else np.nan, touching / size, total / size, gaps / size


@kernel(borrows=True)
def _extrema_part(pressure: FloatArray, u: FloatArray) -> tuple[float, float, float]:
    """`_extrema` of the part of a rank."""
    return _extrema(pressure, u)


@kernel(borrows=True)
def residual_scales(pressure: FloatArray, u: FloatArray, floor: ResidualFloor) -> tuple[float, float]:
    """Scales (P, D) of the residual of a state: pressure and displacement, one value a point."""
    return scales_of(pressure, u, floor)


@kernel(borrows=True)
def mark_contact(
    pressure: FloatArray, gap: FloatArray, per_pressure: float, per_gap: float, touching: BoolArray
) -> None:
    """Mark the points in contact: pressure larger than gap, each in its scale, from 1/P and 1/D."""
    for i in range(touching.size):
        touching[i] = pressure[i] * per_pressure > gap[i] * per_gap


@kernel(inner=True, borrows=True)
def scales_of(pressure: FloatArray, u: FloatArray, floor: ResidualFloor) -> tuple[float, float]:
    """`residual_scales` for kernels."""
    # Depths count from zero, or from the mean of u where that is higher: under a given load the punch may be
    # at any height.
    largest, lowest, total = _extrema(pressure, u)
    return scales(largest, max(total / u.size, 0.0) - lowest, floor)


@nb.njit(inline="always")
def _violations(
    pressure: FloatArray, u: FloatArray, h: FloatArray, per_pressure: float, per_gap: float
) -> tuple[float, float, float, float]:
    """Largest violation, number of points in contact, and sums of pressure and gap."""
    worst, touching, total, gaps = filled(LANES, 0.0), 0.0, 0.0, 0.0
    for first in range(0, u.size, LANES):
        ps, us, hs = pressure[first : first + LANES], u[first : first + LANES], h[first : first + LANES]
        for i in range(us.size):
            gap = hs[i] - us[i]
            off = violation(ps[i], gap, per_pressure, per_gap)
            worst[i] = off if off > worst[i] else worst[i]
            touching += 1.0 if ps[i] * per_pressure > gap * per_gap else 0.0
            total += ps[i]
            gaps += gap
    return maximum(worst), touching, total, gaps


@kernel(reorder=True, borrows=True)
def assess(
    pressure: FloatArray, u: FloatArray, h: FloatArray, floor: ResidualFloor
) -> tuple[float, float, float, float]:
    """Residual, contact area, mean pressure and mean gap of a state, one value a point each."""
    # The residual is NaN if anything is; a point is in contact where the pressure, and not the gap, is the
    # larger of the two in the residual's scales.
    pressure_scale, depth = scales_of(pressure, u, floor)
    worst, touching, total, gaps = _violations(pressure, u, h, 1.0 / pressure_scale, 1.0 / depth)
    # The maxima are blind to NaN; the sums are not.
    finite = np.isfinite(total) and np.isfinite(gaps)
    return worst if finite else np.nan, touching / u.size, total / u.size, gaps / u.size


@kernel(reorder=True, borrows=True)
def _assess_part(
    pressure: FloatArray, u: FloatArray, h: FloatArray, per_pressure: float, per_gap: float
) -> tuple[float, float, float, float]:
    """`_violations` of the part of a rank."""
    return _violations(pressure, u, h, per_pressure, per_gap)
