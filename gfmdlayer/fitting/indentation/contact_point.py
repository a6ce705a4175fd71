"""The contact point of a measured curve, from the force alone.

Up to the largest depth the force is an offset before the contact and an offset plus c (d - d_0)^m after it:
m = 3/2 for a sphere, 2 for a cone, 1 for a flat end. For each row as the contact point, offset and c are a
linear problem; the sum of squares over the rows has its minimum at the contact point, and grows by the
variance of the noise at one standard error from it. Only the rows up to `PART` of the largest force count:
further in, a thin layer stiffens, and a material relaxes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.fitting.indentation.curve import CurveError, ForceCurve

PART = 0.25  # of the largest force
BASELINE = 5  # rows before the contact, at least
CANDIDATES = 200


class ContactPoint(NamedTuple):
    """A measured depth at which the indenter touches, its standard error, and the force before."""

    depth: float
    error: float
    offset: float


def detect(curve: ForceCurve, exponent: float = 1.5) -> ContactPoint:
    """Find the contact point of a curve.

    Parameters
    ----------
    curve : ForceCurve
        With at least `BASELINE` rows before the contact.
    exponent : float
        m of the force.

    Raises
    ------
    CurveError
        No rows lie before the contact.
    """
    end = int(np.argmax(curve.force)) + 1
    offset = float(np.median(curve.force[: max(BASELINE, end // 20)]))
    reached = np.flatnonzero(curve.force[:end] - offset > PART * (curve.force[end - 1] - offset))
    end = int(reached[0]) + 1 if reached.size else end
    depth, force = curve.depth[:end], curve.force[:end]
    last = end - BASELINE
    if last <= BASELINE:
        raise CurveError(
            f"curve {curve.name}: {end} rows up to {PART:.0%} of the largest force; a contact point needs "
            f"{BASELINE} rows before the contact and as many after it"
        )
    points = np.unique(np.linspace(depth[0], depth[last], CANDIDATES))
    found = [_squares(point, depth, force, exponent) for point in points]
    squares = np.array([each[0] for each in found])
    best = int(np.argmin(squares))
    if np.count_nonzero(depth < points[best]) < BASELINE:
        raise CurveError(
            f"curve {curve.name}: presses from its first rows on; a contact point needs {BASELINE} rows "
            "before the contact"
        )
    allowed = squares[best] * (1 + 1 / (end - 3))
    inside = points[squares <= allowed]
    error = max(float(np.ptp(inside)) / 2, float(points[1] - points[0]))
    return ContactPoint(float(points[best]), error, found[best][1])


def _squares(point: float, depth: FloatArray, force: FloatArray, exponent: float) -> tuple[float, float]:
    """Return the sum of squares for a contact point, and the offset."""
    shape = np.maximum(depth - point, 0.0) ** exponent
    columns = np.stack([np.ones_like(shape), shape / max(float(shape.max()), 1e-300)], axis=1)
    solution = np.linalg.lstsq(columns, force, rcond=None)[0]
    return float(np.sum((force - columns @ solution) ** 2)), float(solution[0])
