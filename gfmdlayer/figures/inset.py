"""Punch and surface at chosen times, as an inset of the curves over time."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gfmdlayer.figures.labels import time_axis
from gfmdlayer.figures.snapshot_plots import heights
from gfmdlayer.figures.snapshot_selection import at_times, extent, section
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from xarray import DataArray, Dataset

WIDTH, HEIGHT, MARGIN = 0.42, 0.36, 0.04  # fractions of the panel


class Inset(NamedTuple):
    """The profile of punch and surface of a case at some times.

    Attributes
    ----------
    profile : Dataset
        Displacement, pressure and gap along (snapshot, x); its coordinate `case`, if any, is the number of
        the case in a sweep.
    """

    profile: Dataset

    @classmethod
    def of(cls, case: Dataset, times: Sequence[float]) -> Inset:
        """Cut a case at times of its snapshots.

        Raises
        ------
        ResultsError
            If there is no snapshot at one of the times, or the snapshots have no gap.
        """
        if "gap" not in case:
            raise ResultsError(
                "the snapshots have no gap, an earlier version wrote them: run the config again"
            )
        return cls(section(at_times(case, times)).load())

    def mark(self, axes: Axes, curves: DataArray) -> None:
        """Draw a dot for each time on the curve of the case."""
        if "case" in curves.coords:
            index = np.argwhere(curves["case"].to_numpy() == int(self.profile["case"]))[0]
            curves = curves.isel(dict(zip(curves["case"].dims, index.tolist(), strict=True)))
        tau = time_axis(self.profile)[1]
        for time, colour in zip(self.profile["snapshot"].to_numpy(), self._colours(), strict=True):
            value = float(curves.sel(time=time, method="nearest"))
            axes.plot(time / tau, value, "o", color=colour, markeredgecolor="white", zorder=3, clip_on=False)

    def draw(self, panel: Axes) -> None:
        """Draw the inset where it covers the least of the panel's curves."""
        left, bottom = _emptiest_corner(panel)
        axes = panel.inset_axes((left, bottom, WIDTH, HEIGHT))
        x = self.profile["x"].to_numpy()
        for i, colour in enumerate(self._colours()):
            one = self.profile.isel(snapshot=i)
            surface = one["displacement"].to_numpy()
            axes.plot(x, surface, color=colour)
            axes.plot(x, surface + one["gap"].to_numpy(), color=colour, linestyle=(0, (3, 1.5)), alpha=0.7)
        ylim = heights(self.profile["displacement"])
        axes.set(xlim=extent([self.profile], "x"), ylim=ylim, xticks=[], yticks=[])

    def _colours(self) -> list[tuple[float, ...]]:
        from matplotlib import colormaps

        count = self.profile.sizes["snapshot"]
        return [tuple(colour) for colour in colormaps["inferno"](np.linspace(0.25, 0.8, count))]


def _emptiest_corner(panel: Axes) -> tuple[float, float]:
    """Return the lower left corner of the inset, in fractions of the panel, that covers the fewest points."""
    to_panel = panel.transData + panel.transAxes.inverted()
    points = [to_panel.transform(np.column_stack(line.get_data())) for line in panel.lines]
    x, y = np.concatenate(points).T

    def covered(corner: tuple[float, float]) -> int:
        left, bottom = corner
        in_width = np.abs(x - left - WIDTH / 2) < 0.5 * WIDTH + MARGIN
        return int(np.count_nonzero(in_width & (np.abs(y - bottom - HEIGHT / 2) < 0.5 * HEIGHT + MARGIN)))

    across, up = (np.linspace(MARGIN, 1 - MARGIN - size, 7).tolist() for size in (WIDTH, HEIGHT))
    return min(product(reversed(across), up), key=covered)
