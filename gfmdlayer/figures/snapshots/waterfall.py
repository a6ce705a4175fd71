"""Pressure profiles through time as a waterfall: one profile for each snapshot, later ones higher up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gfmdlayer.figures.labels import value_labels
from gfmdlayer.figures.plot_style import PAPER, Style, colours, new_figure, spread, styled
from gfmdlayer.figures.quantities import finish, quantity
from gfmdlayer.figures.snapshots.fields import Extremes, part_of, section, snapshot_times

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import Dataset

    from gfmdlayer.figures.quantities import Quantity

OVERLAP = 2.5  # height of the largest profile relative to the distance between profiles
MOST_TICKS = 12
MOST_PROFILES = 60


def waterfall_figure(
    case: Dataset, title: str = "", style: Style = PAPER, notes: Sequence[str] = ()
) -> Figure:
    """Draw the contact pressure at the times of the snapshots; a surface in two dimensions is cut along x.

    Parameters
    ----------
    case : Dataset
        A case with snapshots, as the reader opens it.
    title : str
        Title of the case.
    style : Style
        Fonts and lines, and the size of a column.
    notes : sequence of str
        What the figure says of other cases.
    """
    cut, more = part_of(section(case), MOST_PROFILES)
    clock, seconds = snapshot_times(cut)
    times, count = value_labels(seconds), len(seconds)
    along, up = (quantity(cut[name], case.attrs) for name in ("x", "pressure"))
    x = cut["x"].to_numpy() / along.scale
    pressure = cut["pressure"].transpose("snapshot", "x").to_numpy() / up.scale
    left, right = Extremes.of([cut]).view["x"]
    scale = OVERLAP / (pressure.max() or 1.0)
    with styled(style):
        figure = new_figure(1, 35.0 + min(6.0 * count, 85.0), style)
        axes = figure.subplots()
        for i, colour in enumerate(colours(count)):
            line = i + scale * pressure[i]
            order = 2 + 0.5 * (1 - i / count)  # earlier profiles in front
            axes.fill_between(x, i, line, facecolor="white", edgecolor="none", zorder=order)
            axes.plot(x, line, color=colour, zorder=order)
        ticks = spread(count, MOST_TICKS)
        axes.set_yticks(ticks, [times[i] for i in ticks])
        axes.minorticks_off()
        axes.tick_params(right=False, top=False)
        axes.spines[["right", "top"]].set_visible(False)
        axes.set(xlabel=along.label, xlim=(left / along.scale, right / along.scale))
        axes.set(ylabel=clock.label, ylim=(-0.3, count - 0.8 + OVERLAP))
        axes.set_title(title, loc="left")
        _draw_scale(axes, up, pressure.max(), scale, count - 1)
        finish(figure, [*notes, *more])
    return figure


def _draw_scale(axes: Axes, up: Quantity, peak: float, scale: float, base: float) -> None:
    """Draw a scale bar as high as a round pressure beside the uppermost profile, at the height `base`."""
    if peak <= 0:
        return
    unit = 10.0 ** math.floor(math.log10(peak))
    value = max(step * unit for step in (1, 2, 5) if step * unit <= peak)
    position = axes.get_yaxis_transform()  # x as a fraction of the panel
    axes.plot((0.97, 0.97), (base, base + scale * value), color="black", transform=position)
    axes.text(
        0.95, base + scale * value / 2, up.equals(f"{value:g}"), ha="right", va="center", transform=position
    )
