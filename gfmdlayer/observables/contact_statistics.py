"""Statistics of a rough contact: mean gap, patches of contact, distributions of pressure and gap.

The distribution of the pressure is over the points in contact and sums to the contact area, that of the gap
over the other points and sums to the rest of 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.contact.residual import scales_over
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.kernels import kernel
from gfmdlayer.observables.observable import AcceptedStep, Bins, Column, Observable, Parts, Value

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.config.output import Histogram


MEAN_GAP = Column(
    "mean_gap", "mean gap between surface and punch", "length", origin="over the whole cell; 0 in contact"
)
PATCHES = Column("patches", "number of connected patches of contact", dtype="i8", origin="in the cell")


class ContactStatistics(Observable):
    """Mean gap and, where the configuration asks for them, patches and histograms of pressure and gap."""

    COLUMNS = (MEAN_GAP,)

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...]:
        """Return the mean gap, and what `output` asks for."""
        asked, found = config.output, [MEAN_GAP]
        if asked.patches:
            found.append(PATCHES)
        if asked.histograms.pressure is not None:
            bins = Bins("pressure_bin", "pressure", "pressure", _bin_edges(asked.histograms.pressure))
            name = "part of the surface in contact with a pressure in the bin; the sum is the contact area"
            found.append(Column("pressure_histogram", name, along=bins, origin="over the cell"))
        if asked.histograms.gap is not None:
            bins = Bins("gap_bin", "the gap", "length", _bin_edges(asked.histograms.gap))
            name = "part of the surface out of contact with a gap in the bin; the sum is 1 - contact area"
            found.append(Column("gap_histogram", name, along=bins, origin="over the cell"))
        return tuple(found)

    def __init__(self, case: Parts) -> None:
        import numpy as np

        asked = {column.name: column.along for column in self.columns(case.config)}
        self._grid, self._counts_patches = case.grid, PATCHES.name in asked
        self._edges = {name: np.array(bins.edges) for name, bins in asked.items() if bins is not None}

    def measure(self, step: AcceptedStep) -> Mapping[str, Value]:
        """Return the mean gap, and patches and histograms that are asked for."""
        solution = step.solution
        found: dict[str, Value] = {"mean_gap": solution.mean_gap}
        if not (self._counts_patches or self._edges):
            return found
        from gfmdlayer.observables.contact_statistics import count_patches, histogram, in_contact

        touching = in_contact(step.problem, solution)
        if self._counts_patches:
            found["patches"] = count_patches(touching.reshape(self._grid.shape), self._grid)
        for name, edges in self._edges.items():
            of_pressure = name == "pressure_histogram"
            values, chosen = (solution.pressure, touching) if of_pressure else (solution.gap, ~touching)
            found[name] = histogram(values, chosen, edges, self._grid.ranks)
        return found


def _bin_edges(asked: Histogram) -> tuple[float, ...]:
    """Edges of the bins of a histogram, from 0 to inf.

    Between these are the edges that were asked for, so that values beyond `max` and, on a log scale, below
    `min` have a bin of their own.
    """
    import numpy as np

    if asked.scale == "linear":
        inner = np.linspace(0.0, asked.max, asked.bins + 1)[1:]
    else:
        assert asked.min is not None
        inner = np.geomspace(asked.min, asked.max, asked.bins + 1)
    return (0.0, *inner.tolist(), np.inf)


# Time, contact area, mean pressure, force and depth of the punch, and the residual of the problem.

TIME = Column("time", "time", "time", origin="from the beginning of the run")
AREA = Column("contact_area", "relative contact area atilde, contact points / all points",
              symbol=r"\tilde{a}", origin="over the cell")  # fmt: skip
PRESSURE = Column("mean_pressure", "mean contact pressure ptilde = pbar / (2 G0)", symbol=r"\tilde{p}",
                  origin="mean over the whole cell; G0 of the uppermost layer")  # fmt: skip
DEPTH = Column("depth", "indentation depth of the punch", "length",
               origin="from the height at which the punch touches the surface at rest")  # fmt: skip
RESIDUAL = Column("residual", "residual of the contact problem when the step was accepted",
                  origin="relative to the largest pressure and the depth")  # fmt: skip


class ContactMeans(Observable):
    """Time, contact area, mean pressure in units of twice the relaxed modulus, depth, and residual."""

    COLUMNS = (
        TIME,
        AREA,
        PRESSURE,
        DEPTH,
        RESIDUAL,
    )

    def __init__(self, case: Parts) -> None:
        self._unit = 2 * case.config.solid.unit

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Return the columns of the solution."""
        return {
            "time": step.time,
            "contact_area": step.solution.contact_area,
            "mean_pressure": step.solution.mean_pressure / self._unit,
            "depth": step.surface.depth,
            "residual": step.solution.residual,
        }


class Force(Observable):
    """Mean pressure over the cell, and the force over the cell: of a line contact, per length of the line."""

    COLUMNS = (
        Column("mean_stress", "mean contact pressure pbar", "pressure", origin="mean over the whole cell"),
        Column(
            "force",
            "force on the punch over the cell",
            "force",
            origin="mean_stress times the area of the cell; of a line, its period",
        ),
    )

    def __init__(self, case: Parts) -> None:
        self._cell = math.prod(case.grid.period)

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Return pbar, and pbar times the area of the cell or its length."""
        mean = step.solution.mean_pressure
        return {"mean_stress": mean, "force": mean * self._cell}


# Points in contact, histograms over them, and their connected patches.
#
# A point is in contact where its pressure, and not its gap, is the larger of the two in the scales of the
# residual, as for the contact area.


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

    Parameters
    ----------
    values : ndarray
        One value a point; one below the first edge, by rounding, counts in the first bin.
    chosen : ndarray of bool
        Points that count.
    edges : array_like
        Increasing, the last inf.
    ranks : Ranks
        The processes that hold the points.

    Returns
    -------
    ndarray
        One number a bin.
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
    """Count the connected patches of a periodic surface; points are neighbours along the axes.

    Parameters
    ----------
    touching : ndarray of bool
        Of the grid's shape, in one dimension or two.
    grid : Grid
        The grid.
    """
    from scipy import ndimage
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ranks = grid.ranks
    labels, own = ndimage.label(touching)
    before, count = ranks.counted(own)
    labels = np.where(labels > 0, labels.astype(np.int64) + before, 0)
    # Patches that meet across an edge of the cell, or of a rank's rows, are one: components of the graph of
    # these meetings.
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
