"""What a rough contact is described by: mean gap, patches of contact, distributions of pressure and gap.

A point is in contact where its pressure, and not its gap, is the larger of the two in the scales of the
residual, as for the contact area. The distribution of the pressure is over the points in contact, that of the
gap over the others, both as parts of the whole surface: the first sums to the contact area, the second to
what the contact leaves of 1.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.contact.residual import residual_scales
from gfmdlayer.kernels import kernel


class Statistics:
    """Observables of a solved contact problem that go beyond means.

    Parameters
    ----------
    shape : tuple of int
        Shape of the grid.
    edges : mapping
        `pressure`, `gap` or both -> edges of the bins of their histograms, increasing from 0 to inf.
    patches : bool
        Whether to count the patches of contact.
    """

    def __init__(
        self, shape: tuple[int, ...], edges: Mapping[str, FloatArray], *, patches: bool = False
    ) -> None:
        self._shape = shape
        self._edges = dict(edges)
        self._patches = patches

    def of(self, problem: Problem, solution: Solution) -> dict[str, float | FloatArray]:
        """Return mean_gap and, where asked for, patches, pressure_histogram and gap_histogram."""
        found: dict[str, float | FloatArray] = {"mean_gap": solution.mean_gap}
        if not (self._patches or self._edges):
            return found
        touching = in_contact(problem, solution)
        if self._patches:
            found["patches"] = count_patches(touching.reshape(self._shape))
        if "pressure" in self._edges:
            found["pressure_histogram"] = histogram(solution.pressure, touching, self._edges["pressure"])
        if "gap" in self._edges:
            found["gap_histogram"] = histogram(solution.gap, ~touching, self._edges["gap"])
        return found


def in_contact(problem: Problem, solution: Solution) -> BoolArray:
    """Tell of each point whether it is in contact."""
    pressure_scale, depth = residual_scales(solution.pressure, solution.displacement, problem.residual_floor)
    return np.asarray(solution.pressure * (1.0 / pressure_scale) > solution.gap * (1.0 / depth))


def histogram(values: FloatArray, chosen: BoolArray, edges: FloatArray) -> FloatArray:
    """Return the part of all points that is chosen and has a value within each bin, lower edge included.

    Parameters
    ----------
    values : ndarray
        One value a point; one below the first edge, by rounding, counts in the first bin.
    chosen : ndarray of bool
        Which points count.
    edges : ndarray
        Increasing, the last inf.
    """
    return _counts(values, chosen, edges) / values.size


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
    # Patches that meet across an edge of the cell are one: components of the graph of such meetings.
    ends = [(labels.take(0, axis).ravel(), labels.take(-1, axis).ravel()) for axis in range(labels.ndim)]
    first, last = (np.concatenate(side) for side in zip(*ends, strict=True))
    meet = (first > 0) & (last > 0)
    pairs = (np.ones(np.count_nonzero(meet)), (first[meet] - 1, last[meet] - 1))
    graph = coo_array(pairs, shape=(count, count))
    return int(connected_components(graph, directed=False)[0]) if count else 0
