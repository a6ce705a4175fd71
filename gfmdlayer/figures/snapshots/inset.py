"""Punch and surface at chosen times, as an inset of the curves over time."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gfmdlayer.figures.quantities import quantity
from gfmdlayer.figures.snapshots.fields import Extremes, at_times, section, snapshot_titles
from gfmdlayer.figures.snapshots.plots import heights
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from xarray import DataArray, Dataset

# Fractions of the panel: the inset, the ticks and labels at its left and below, a line of text above it.
WIDTH, HEIGHT, MARGIN = 0.4, 0.3, 0.03
LEFT, BELOW, LINE = 0.13, 0.13, 0.075


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
        tau, unit = (quantity(each, self.profile.attrs).scale for each in (curves["time"], curves))
        for time, colour in zip(self.profile["snapshot"].to_numpy(), self._colours(), strict=True):
            value = float(curves.sel(time=time, method="nearest"))
            axes.plot(
                time / tau, value / unit, "o", color=colour, markeredgecolor="white", zorder=3, clip_on=False
            )

    def draw(self, panel: Axes) -> None:
        """Draw the inset where it covers the least of the panel's curves."""
        titles = snapshot_titles(self.profile)
        left, bottom = _emptiest_corner(panel, LEFT + WIDTH, BELOW + HEIGHT + LINE * len(titles))
        axes = panel.inset_axes((left + LEFT, bottom + BELOW, WIDTH, HEIGHT))
        along, up = (quantity(self.profile[name], self.profile.attrs) for name in ("x", "displacement"))
        x = self.profile["x"].to_numpy() / along.scale
        for i, colour in enumerate(self._colours()):
            one = self.profile.isel(snapshot=i)
            surface, gap = (one[name].to_numpy() / up.scale for name in ("displacement", "gap"))
            axes.plot(x, surface, color=colour)
            axes.plot(x, surface + gap, color=colour, linestyle=(0, (3, 1.5)), alpha=0.7)
            above = 1.02 + (len(titles) - 1 - i) * LINE / HEIGHT
            look: dict[str, Any] = {"color": colour, "ha": "center", "va": "bottom", "fontsize": "x-small"}
            axes.text(0.5, above, titles[i], transform=axes.transAxes, **look)
        ends = np.divide(Extremes.of([self.profile]).view["x"], along.scale)
        axes.set(xlim=ends, ylim=np.divide(heights(self.profile["displacement"]), up.scale))
        axes.set_xlabel(along.label, fontsize="x-small", labelpad=0)
        axes.set_ylabel(up.label, fontsize="x-small", labelpad=0)
        axes.tick_params(which="both", labelsize="x-small")
        axes.locator_params(nbins=3)

    def _colours(self) -> list[tuple[float, ...]]:
        from matplotlib import colormaps

        count = self.profile.sizes["snapshot"]
        return [tuple(colour) for colour in colormaps["inferno"](np.linspace(0.25, 0.8, count))]


def _emptiest_corner(panel: Axes, width: float, height: float) -> tuple[float, float]:
    """Return the lower left corner of a box, in fractions of the panel, that covers the fewest points."""
    to_panel = panel.transData + panel.transAxes.inverted()
    points = [to_panel.transform(np.column_stack(line.get_data())) for line in panel.lines]
    x, y = np.concatenate(points).T

    def covered(corner: tuple[float, float]) -> int:
        left, bottom = corner
        in_width = np.abs(x - left - width / 2) < 0.5 * width + MARGIN
        return int(np.count_nonzero(in_width & (np.abs(y - bottom - height / 2) < 0.5 * height + MARGIN)))

    across, up = (np.linspace(MARGIN, 1 - MARGIN - size, 7).tolist() for size in (width, height))
    return min(product(reversed(across), up), key=covered)
