"""Work of the indenter along a curve of force and depth."""

from __future__ import annotations

import numpy as np

from gfmdlayer.arrays import FloatArray


def work_done(force: FloatArray, depth: FloatArray, start: float) -> FloatArray:
    """Integral of the force over the depth.

    Parameters
    ----------
    force, depth : ndarray, shape (nt,)
        Along the curve.
    start : float
        Work done at the first point.

    Returns
    -------
    ndarray, shape (nt,)
        Between two points by the mean of the parabolas through their neighbours on either side, where the
        depth goes on in the same direction; by the trapezoidal rule elsewhere.
    """
    if force.size < 2:
        return np.full(force.size, start)
    width = np.diff(depth)
    slope = np.divide(np.diff(force), width, out=np.zeros_like(width), where=width != 0)
    areas = width * (force[1:] + force[:-1]) / 2
    if width.size > 1:
        smooth = width[1:] * width[:-1] > 0
        span = np.where(smooth, depth[2:] - depth[:-2], 1.0)
        bend = np.where(smooth, np.diff(slope) / span, 0.0)  # divided difference at the inner points
        number = np.zeros(width.size)
        total = np.zeros(width.size)
        for part in (slice(None, -1), slice(1, None)):
            total[part] += bend
            number[part] += smooth
        areas -= np.divide(total, number, out=np.zeros_like(total), where=number > 0) * width**3 / 6
    return start + np.concatenate(([0.0], np.cumsum(areas)))
