"""Points in contact, histograms over them, and their connected patches.

A point is in contact if its pressure is larger than its gap, each in the scale of the residual.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.contact.residual import scales_over
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.kernels import kernel


def in_contact(problem: Problem, solution: Solution) -> BoolArray:
    """Return whether each point is in contact."""
    wall = problem.wall_pressure(solution.pressure, solution.gap)
    floor = problem.residual_floor
    pressure_scale, depth = scales_over(problem.ranks, wall, solution.displacement, floor)
    return _touching(wall, solution.gap, 1.0 / pressure_scale, 1.0 / depth)


@kernel
def _touching(pressure: FloatArray, gap: FloatArray, per_pressure: float, per_gap: float) -> BoolArray:
    found = np.empty(gap.size, np.bool_)
    for i in range(gap.size):
        found[i] = pressure[i] * per_pressure > gap[i] * per_gap
    return found


def closed_gap(problem: Problem, solution: Solution) -> FloatArray:
    """Return the gap, exactly zero where there is contact."""
    return np.where(in_contact(problem, solution), 0.0, solution.gap)


def histogram(
    values: FloatArray, chosen: BoolArray, edges: npt.ArrayLike, ranks: Ranks = ALONE
) -> FloatArray:
    """Return the part of all points that are chosen and have a value in each bin, lower edge included.

    The edges increase to inf. A value below the first edge, by rounding, is in the first bin.
    """
    counts = _counts(values, chosen, np.asarray(edges, dtype=float))
    return np.asarray(ranks.total(counts) / ranks.total(values.size))


@kernel
def _counts(values: FloatArray, chosen: BoolArray, edges: FloatArray) -> npt.NDArray[np.int64]:
    counts = np.zeros(edges.size - 1, np.int64)
    for i in range(values.size):
        if chosen[i]:
            counts[max(np.searchsorted(edges, values[i], side="right") - 1, 0)] += 1
    return counts


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
    pairs = np.concatenate([np.stack(each, axis=1) for each in ends])
    pairs = ranks.gathered(np.unique(pairs[(pairs > 0).all(axis=1)], axis=0)) - 1
    patches = 0
    if ranks.first and count:
        graph = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(count, count))
        patches = int(connected_components(graph, directed=False)[0])
    return ranks.maximum(patches)
