r"""The error of a number, from its values on other grids, steps or tolerances.

f(x) is the value at size x: a spacing, step or tolerance in those of the case. Most contacts show no clean
order: summits and edges lie elsewhere between the points of each grid. So the error is

    E = max over x of |f(x) - f(1)| / |x^q - 1|

with the expected order q = p, less where a lower one is seen, and at most 1 where the differences do not grow
with the size. An order is seen where f0 + C x^p fits the values of all grids within 0.3 |C|, or where three
values of equal ratios of the sizes are monotone. Only where it agrees with the expected one is Richardson's
f0 better than the value itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

LOWEST = 0.5  # order that is believed
SCATTER = 0.3  # of a fit, over its coefficient, up to which an order is seen
AGREES = 0.35  # relative difference of the orders up to which the seen one is the expected one
PRESCRIBED = 1e-12  # relative variation of a quantity that the configuration prescribes
_ORDERS = np.arange(0.3, 4.01, 0.05)


class ErrorOfValue(NamedTuple):
    """Estimated error of a value, in its units."""

    error: float
    seen: float = math.nan  # order
    limit: float = math.nan  # Richardson's value, where the order seen is the expected one
    # order: the expected one is seen; off: another one; scattered: none; same: no difference
    verdict: str = "same"


def estimate(values: Mapping[float, float], expected: float) -> ErrorOfValue:
    """ErrorOfValue the error of the value at size 1, from those at other sizes."""
    others = sorted(size for size in values if size != 1)
    off = {size: abs(values[size] - values[1.0]) for size in others}
    if not any(off.values()):
        return ErrorOfValue(0.0)
    seen, limit = _of_all(values) if len(values) >= 4 else _of_three(values, expected)
    order, verdict = expected, "scattered"
    if math.isfinite(seen):
        order = min(expected, max(LOWEST, seen))
        verdict = "order" if abs(seen - expected) <= AGREES * expected else "off"
    coarser = [size for size in others if size > 1]
    half = (len(coarser) + 1) // 2
    near, far = (max((off[size] for size in part), default=0.0) for part in (coarser[:half], coarser[half:]))
    if len(coarser) >= 3 and near > far:
        order, verdict = min(order, 1.0), "scattered"
    error = max(off[size] / abs(size**order - 1) for size in others)
    return ErrorOfValue(error, seen, limit if verdict == "order" else math.nan, verdict)


def _of_all(values: Mapping[float, float]) -> tuple[float, float]:
    """Return order and limit of least squares; NaN where the values scatter."""
    sizes = np.array(sorted(values))
    found = np.array([values[size] for size in sizes])
    best = (math.inf, math.nan, math.nan)
    for order in _ORDERS:
        terms = np.stack([np.ones_like(sizes), sizes**order], 1)
        limit, factor = np.linalg.lstsq(terms, found, rcond=None)[0]
        scatter = math.sqrt(np.sum((found - terms @ (limit, factor)) ** 2))
        best = min(best, (scatter, order, limit) if scatter < SCATTER * abs(factor) else (math.inf,) * 3)
    return (float(best[1]), float(best[2])) if math.isfinite(best[0]) else (math.nan, math.nan)


def _of_three(values: Mapping[float, float], expected: float) -> tuple[float, float]:
    """Return order and limit of three monotone values whose sizes have equal ratios, else NaN."""
    if len(values) < 3:
        return math.nan, math.nan
    x = sorted(values)
    a, b, c = (values[size] for size in x)
    ratio = x[1] / x[0]
    if not ((b - a) * (c - b) > 0 and abs(ratio - x[2] / x[1]) < 0.2 * ratio):
        return math.nan, math.nan
    seen = math.log((c - b) / (b - a)) / math.log(ratio)
    return seen, a + (a - b) / (ratio ** min(max(seen, LOWEST), expected) - 1)
