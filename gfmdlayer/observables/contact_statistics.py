"""Statistics of a rough contact: mean gap, patches of contact, distributions of pressure and gap.

The distribution of the pressure is over the points in contact and sums to the contact area, that of the gap
over the other points and sums to the rest of 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

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
        from gfmdlayer.observables.distributions import count_patches, histogram, in_contact

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
