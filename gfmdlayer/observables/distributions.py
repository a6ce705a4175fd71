"""Points in contact, histograms over them, and their connected patches.

A point is in contact where its pressure, and not its gap, is the larger of the two in the scales of the
residual, as for the contact area.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.contact.residual import residual_scales
from gfmdlayer.kernels import kernel


def in_contact(problem: Problem, solution: Solution) -> BoolArray:
    """Return whether each point is in contact."""
    wall = problem.wall_pressure(solution.pressure, solution.gap)
    pressure_scale, depth = residual_scales(wall, solution.displacement, problem.residual_floor)
    return np.asarray(wall * (1.0 / pressure_scale) > solution.gap * (1.0 / depth))


def closed_gap(problem: Problem, solution: Solution) -> FloatArray:
    """Return the gap, exactly zero where there is contact."""
    return np.where(in_contact(problem, solution), 0.0, solution.gap)


def histogram(values: FloatArray, chosen: BoolArray, edges: npt.ArrayLike) -> FloatArray:
    """Return the part of all points that are chosen and have a value in each bin, lower edge included.

    Parameters
    ----------
    values : ndarray
        One value a point; one below the first edge, by rounding, counts in the first bin.
    chosen : ndarray of bool
        Points that count.
    edges : array_like
        Increasing, the last inf.

    Returns
    -------
    ndarray
        One number a bin.
    """
    return _counts(values, chosen, np.asarray(edges, dtype=float)) / values.size


@kernel
def _counts(values: FloatArray, chosen: BoolArray, edges: FloatArray) -> npt.NDArray[np.int64]:
    counts = np.zeros(edges.size - 1, np.int64)
    for i in range(values.size):
        if chosen[i]:
            counts[max(np.searchsorted(edges, values[i], side="right") - 1, 0)] += 1
    return counts


def count_patches(touching: BoolArray) -> int:
    """Count the connected patches of a periodic surface; points are neighbours along the axes.

    Parameters
    ----------
    touching : ndarray of bool
        Of the grid's shape, in one dimension or two.
    """
    from scipy import ndimage
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    labels, count = ndimage.label(touching)
    # Patches that meet across an edge of the cell are one: components of the graph of these meetings.
    ends = [(labels.take(0, axis).ravel(), labels.take(-1, axis).ravel()) for axis in range(labels.ndim)]
    first, last = (np.concatenate(side) for side in zip(*ends, strict=True))
    meet = (first > 0) & (last > 0)
    pairs = (np.ones(np.count_nonzero(meet)), (first[meet] - 1, last[meet] - 1))
    graph = coo_array(pairs, shape=(count, count))
    return int(connected_components(graph, directed=False)[0]) if count else 0
