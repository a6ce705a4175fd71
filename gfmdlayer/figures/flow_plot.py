"""Fluid in the gap of a contact at the snapshot times: its pressure, and its streams through the channels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.figures.labels import Quantity, explained, finish, name_axes, quantity
from gfmdlayer.figures.plot_style import PAPER, Style, new_figure, styled
from gfmdlayer.figures.snapshot_plots import (
    MAP_POINTS,
    MOST_MAPS,
    draw_bar,
    part_of,
    snapshot_titles,
)
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage
    from xarray import Dataset

    from gfmdlayer.arrays import FloatArray

DECADES = 4  # of the flow that are drawn
STREAM_POINTS = 128  # along each axis, of the field that the streamlines follow


def flow_figure(flow: Dataset, title: str = "", style: Style = PAPER, notes: Sequence[str] = ()) -> Figure:
    """Draw the fluid's pressure and flow of `gfmdlayer.leakage(..., fields=True)`, a column a snapshot."""
    if "fluid_pressure" not in flow:
        raise ResultsError(
            "there are no fields of the fluid; a line has none, a surface has with fields=True"
        )
    whole = flow if "snapshot" in flow.dims else flow.expand_dims(snapshot=[0.0])
    case, more = part_of(whole, MOST_MAPS)
    count = case.sizes["snapshot"]
    with styled(style):
        ratio = float(np.ptp(case["y"].to_numpy()) / np.ptp(case["x"].to_numpy()))
        height = 138.0 / max(count, 2) * min(ratio, 1.5)
        figure = new_figure(2, 18.0 + 2 * height, style)
        panels = figure.subplots(2, count, sharex=True, sharey=True, squeeze=False)
        size = np.hypot(case["flow_x"], case["flow_y"])
        for i, time in enumerate(snapshot_titles(case) if "snapshot" in flow.dims else [""]):
            one = case.isel(snapshot=i)
            pressure = _draw(panels[0, i], one, one["fluid_pressure"].to_numpy(), (-0.5, 0.5), "RdBu_r")
            with np.errstate(divide="ignore"):
                speed = np.log10(size[i].to_numpy() / (float(size[i].max()) or 1.0))
            streams = _draw(panels[1, i], one, speed, (-DECADES, 0.0), "cividis")
            _draw_streams(panels[1, i], one)
            panels[0, i].set_title(time, loc="right")
            name_axes(panels[1, i], x=quantity(case["x"], case.attrs))
        draw_bar(panels[0, -1], pressure, Quantity("pressure / drop"))
        draw_bar(panels[1, -1], streams, Quantity("log$_{10}$ flow / largest of the map"))
        for axes in panels[:, 0]:
            name_axes(axes, y=quantity(case["y"], case.attrs))
        panels[0, 0].set_title(f"{title}\n" if title else "", loc="left")
        said = [*notes, "black: contact, and fluid at rest", *more]
        finish(figure, [*explained(case, ["fluid_pressure"], [title]), *said])
    return figure


def _draw(axes: Axes, one: Dataset, values: FloatArray, ends: tuple[float, float], colours: str) -> AxesImage:
    """Draw a field over the whole cell; contact and still fluid (NaN, -inf) are black."""
    x, y = (one[name].to_numpy() / quantity(one[name], one.attrs).scale for name in "xy")
    thinned = tuple(slice(None, None, -(-n // MAP_POINTS)) for n in values.shape)
    half = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
    axes.set_facecolor("black")
    return axes.imshow(
        values[thinned].T,
        origin="lower",
        extent=(x[0] - half[0], x[-1] + half[0], y[0] - half[1], y[-1] + half[1]),
        interpolation="nearest",
        vmin=ends[0],
        vmax=ends[1],
        cmap=colours,
    )


def _draw_streams(axes: Axes, one: Dataset) -> None:
    """Draw streamlines, wider where more flows, if anything flows."""
    x, y = (one[name].to_numpy() / quantity(one[name], one.attrs).scale for name in "xy")
    thin = tuple(-(-n // STREAM_POINTS) for n in (x.size, y.size))
    u, v = (one[name].to_numpy()[:: thin[0], :: thin[1]].T for name in ("flow_x", "flow_y"))
    size = np.hypot(u, v)
    if not size.any():
        return
    still = size < 10.0**-DECADES * size.max()
    u, v = (np.ma.masked_array(each / size.max(), still) for each in (u, v))
    width = 0.25 + 1.2 * np.sqrt(size / size.max())
    axes.streamplot(
        x[:: thin[0]], y[:: thin[1]], u, v,
        color="white", linewidth=width, density=1.6, arrowsize=0.6, broken_streamlines=True,
    )  # fmt: skip
    axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
