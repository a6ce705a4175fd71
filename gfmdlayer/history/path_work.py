"""The work of a step along the curve of mean pressure y over depth x, to the order of the adaptive steps.

From the first contact on, curves follow a power of the depth closely: y ~ x^1.5 under Hertz's paraboloid, x
under a line, x^2 under a cone. So the curve of a step is the power law through its ends, whose area is

    (x_1 y_1 - x_0 y_0)/(n + 1),        n = log(y_1/y_0)/log(x_1/x_0)

and the deviation e of the point before from this law bends it: the parabola with the value e there and zero
at both ends has the area -(x_1 - x_0)^3 e/(6 (x_0 - x) (x_1 - x)). Power laws are integrated exactly in steps
of any length, other smooth curves with an error of fourth order. Where no power law leads through the ends,
a straight line takes its place, and the rule is that of the parabola through three points.
"""

from __future__ import annotations

import math

from gfmdlayer.arrays import FloatArray
from gfmdlayer.kernels import kernel

_LARGEST_EXPONENT = 8.0  # above, the curve does not begin at depth zero: the punch leaves its dent
_SHORTEST = 1e-5  # step relative to the depth, below which the exponent loses digits and a line is as good
_WIDEST = 2.5  # step over the one before, above which the point before is too close to tell the bend


@kernel(borrows=True)
def work_along(curve: FloatArray, points: int, depth: float, pressure: float) -> float:
    """Work from the last point of a curve, of which one or two are known, to a depth and its pressure."""
    # Rows of the curve: time, depth, pressure, ...; the later one last.
    x, y, x0, y0 = curve[0, 1], curve[0, 2], curve[1, 1], curve[1, 2]
    width = depth - x0
    if width == 0.0:
        return 0.0
    area, exponent, by_power = width * (y0 + pressure) / 2.0, 0.0, False
    if min(x0, depth) > 0.0 and min(y0, pressure) > 0.0 and abs(width) > _SHORTEST * x0:
        exponent = math.log(pressure / y0) / math.log(depth / x0)
        by_power = 0.0 <= exponent <= _LARGEST_EXPONENT
    if by_power:
        area = (depth * pressure - x0 * y0) / (exponent + 1.0)
    last = x0 - x
    if points > 1 and last * width > 0.0 and abs(width) <= _WIDEST * abs(last):
        before = y0 - (pressure - y0) / width * last
        if by_power and x > 0.0:
            before = y0 * math.pow(x / x0, exponent)
        area -= math.pow(width, 3.0) * (y - before) / (6.0 * last * (depth - x))
    return float(area)
