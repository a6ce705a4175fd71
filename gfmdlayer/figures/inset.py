"""Punch and surface at chosen times, as an inset of the curves over time."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.figures.plot_style import time_axis
from gfmdlayer.figures.snapshot_selection import at_times, extent, section, with_gap

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from xarray import DataArray, Dataset

WIDTH, HEIGHT, MARGIN = 0.42, 0.36, 0.04  # in parts of the panel


@dataclass(frozen=True)
class Inset:
    """The profile of punch and surface of a case at some times.

    Attributes
    ----------
    profile
        Displacement, pressure and gap along (snapshot, x); the coordinate `case`, if any, tells which case of
        a sweep this is.
    """

    profile: Dataset

    @classmethod
    def of(cls, case: Dataset, times: Sequence[float]) -> Inset:
        """Cut a case at times of its snapshots.

        Raises
        ------
        ResultsError
            If there is no snapshot at one of them, or no gap.
        """
        return cls(section(at_times(with_gap(case), times)).load())

    def mark(self, axes: Axes, curves: DataArray) -> None:
        """Put a dot for each time on the curve of the case."""
        if "case" in curves.coords:
            place = np.argwhere(curves["case"].to_numpy() == int(self.profile["case"]))[0]
            curves = curves.isel(dict(zip(curves["case"].dims, place.tolist(), strict=True)))
        tau = time_axis(self.profile)[1]
        for time, colour in zip(self.profile["snapshot"].to_numpy(), self._colours(), strict=True):
            value = float(curves.sel(time=time, method="nearest"))
            axes.plot(time / tau, value, "o", color=colour, markeredgecolor="white", zorder=3, clip_on=False)

    def draw(self, panel: Axes) -> None:
        """Draw into the emptiest place of a panel."""
        left, bottom = _emptiest(panel)
        axes = panel.inset_axes((left, bottom, WIDTH, HEIGHT))
        x = self.profile["x"].to_numpy()
        for place, colour in enumerate(self._colours()):
            one = self.profile.isel(snapshot=place)
            surface = one["displacement"].to_numpy()
            axes.plot(x, surface, color=colour)
            axes.plot(x, surface + one["gap"].to_numpy(), color=colour, linestyle=(0, (3, 1.5)), alpha=0.7)
        low, high = float(self.profile["displacement"].min()), float(self.profile["displacement"].max())
        axes.set(
            xlim=extent([self.profile], "x"),
            ylim=(low - 0.15 * (high - low), high + 0.6 * (high - low)),
            xticks=[],
            yticks=[],
        )

    def _colours(self) -> list[tuple[float, ...]]:
        from matplotlib import colormaps

        return [
            tuple(c) for c in colormaps["inferno"](np.linspace(0.25, 0.8, self.profile.sizes["snapshot"]))
        ]


def _emptiest(panel: Axes) -> tuple[float, float]:
    """Return the corner of the inset, in parts of the panel, that covers the fewest points of curves."""
    to_panel = panel.transData + panel.transAxes.inverted()
    points = [to_panel.transform(np.column_stack(line.get_data())) for line in panel.lines]
    x, y = np.concatenate(points).T

    def covered(corner: tuple[float, float]) -> int:
        inside = (np.abs(x - corner[0] - WIDTH / 2) < 0.5 * WIDTH + MARGIN) & (
            np.abs(y - corner[1] - HEIGHT / 2) < 0.5 * HEIGHT + MARGIN
        )
        return int(np.count_nonzero(inside))

    across, up = (np.linspace(MARGIN, 1 - MARGIN - size, 7).tolist() for size in (WIDTH, HEIGHT))
    return min(product(reversed(across), up), key=covered)
