"""Fields at the interface at the snapshot times: stick and slip with the shear traction, fluid in the gap."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from gfmdlayer.figures.labels import Quantity, explained, finish, name_axes, quantity
from gfmdlayer.figures.plot_style import PAPER, Style, colours, legend_above, line_style, new_figure, styled
from gfmdlayer.figures.snapshot_plots import (
    MAP_POINTS,
    MOST_MAPS,
    Extremes,
    draw_bar,
    draw_map,
    each_snapshot,
    ends_of_grid,
    height_of_map,
    part_of,
    snapshot_times,
    snapshot_titles,
)
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset

APART, STICK, SLIP = 0, 1, 2
# Okabe & Ito's blue and orange, which the colour-blind tell apart, on white.
STATES = {APART: "white", STICK: "#0072b2", SLIP: "#e69f00"}
_COLOURS = ListedColormap(list(STATES.values()))
_CURVES = 6  # of shear traction below the map of a line


def stick_figure(
    case: Dataset, title: str = "", style: Style = PAPER, notes: Sequence[str] = (), *, every: bool = False
) -> Figure:
    """Draw stick, slip and the shear traction at the snapshots: of a line over x and time, else as maps.

    `every` draws all of very many maps of a surface; otherwise a note says how many are drawn.
    """
    if "slip_velocity_x" not in case:
        raise ResultsError("the snapshots have no slip; they are of a case without friction at the interface")
    is_line = "y" not in case["pressure"].dims
    left_out: list[str] = []
    with styled(style):
        if is_line:
            figure = _line(case, style)
        else:
            part, left_out = part_of(case, case.sizes["snapshot"] if every else MOST_MAPS)
            figure = _surface(part, Extremes.of([case]), style)
        figure.axes[0].set_title(f"{title}\n" if title and not is_line else title, loc="left")
        patches = [Patch(facecolor=STATES[STICK], label="stick"), Patch(facecolor=STATES[SLIP], label="slip")]
        curves = figure.axes[1].get_legend_handles_labels()[0] if is_line else []
        legend_above(figure, [*patches, *curves])
        finish(figure, [*explained(case, ["shear_x"], [title]), *notes, *left_out])
    return figure


def states(case: Dataset) -> DataArray:
    """Return APART, STICK or SLIP at each point of the snapshots of a case."""
    slips = (case[name] for name in ("slip_velocity_x", "slip_velocity_y") if name in case)
    moving = sum(abs(each.fillna(0.0)) for each in slips) > 0
    found: DataArray = (case["pressure"] > 0) * STICK + moving * (SLIP - STICK)
    return found.where(case["pressure"] > 0, APART)


def _line(case: Dataset, style: Style) -> Figure:
    """Draw a map over x and the order of the snapshots, and some profiles of shear traction below."""
    left, right = Extremes.of([case]).view["x"]
    clock, times = snapshot_times(case)
    clock = clock.fit(times) if clock.unit else clock
    x, t = (quantity(case[name], case.attrs) for name in ("x", "shear_x"))
    figure = new_figure(1, 110.0, style)
    above, below = figure.subplots(2, 1, sharex=True)
    part = case.sel(x=slice(left, right))
    along = part["x"].to_numpy() / x.scale
    shown = states(part).transpose("snapshot", "x").to_numpy()
    above.imshow(
        shown[:, :: -(-shown.shape[1] // MAP_POINTS)],
        origin="lower",
        aspect="auto",
        interpolation="nearest",
        extent=(float(along[0]), float(along[-1]), -0.5, len(times) - 0.5),
        cmap=_COLOURS,
        vmin=APART,
        vmax=SLIP,
    )
    ticks = np.unique(np.linspace(0, len(times) - 1, min(len(times), _CURVES)).astype(int)).tolist()
    above.set_yticks(ticks, clock.numbers([times[i] for i in ticks]))
    above.minorticks_off()
    above.set_ylabel(clock.label)
    for k, (i, shade) in enumerate(zip(ticks, colours(len(ticks)), strict=True)):
        values = part["shear_x"].isel(snapshot=i).to_numpy() / t.scale
        below.plot(along, values, color=shade, linestyle=line_style(k), label=clock.equals([times[i]])[0])
    below.set_xlim(left / x.scale, right / x.scale)
    name_axes(below, x, t)
    return figure


def _surface(case: Dataset, seen: Extremes, style: Style) -> Figure:
    """Draw maps of stick and slip, and of the shear traction along x, at the snapshots."""
    count = case.sizes["snapshot"]
    figure = new_figure(2, 26.0 + 2 * (height_of_map(count, seen.view) + 4.0), style)
    panels = figure.subplots(2, count, sharex=True, sharey=True, squeeze=False)
    largest = float(abs(case["shear_x"]).max()) or 1.0
    x, y = (quantity(case[name], case.attrs) for name in "xy")
    found = states(case).rename("state")
    fields = zip(snapshot_titles(case), each_snapshot(case["shear_x"]), strict=True)
    for i, (time, field) in enumerate(fields):
        draw_map(panels[0, i], case, found.isel(snapshot=i), seen.view, (APART, SLIP), _COLOURS)
        panels[0, i].set_title(time, loc="right")
        mesh = draw_map(panels[1, i], case, field, seen.view, (-largest, largest), "RdBu_r")
        name_axes(panels[1, i], x)
    for row in panels:
        name_axes(row[0], y=y)
    draw_bar(panels[1, -1], mesh, quantity(case["shear_x"], case.attrs))
    return figure


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
    count, cell = case.sizes["snapshot"], {name: ends_of_grid(case[name]) for name in "xy"}
    with styled(style):
        ratio = float(np.ptp(case["y"].to_numpy()) / np.ptp(case["x"].to_numpy()))
        figure = new_figure(2, 18.0 + 2 * 138.0 / max(count, 2) * min(ratio, 1.5), style)
        panels = figure.subplots(2, count, sharex=True, sharey=True, squeeze=False)
        for i, time in enumerate(snapshot_titles(case) if "snapshot" in flow.dims else [""]):
            one = case.isel(snapshot=i)
            pressure = draw_map(panels[0, i], one, one["fluid_pressure"], cell, (-0.5, 0.5), "RdBu_r")
            speed = np.hypot(one["flow_x"].to_numpy(), one["flow_y"].to_numpy())
            with np.errstate(divide="ignore"):
                logarithm = one["fluid_pressure"].copy(data=np.log10(speed / (speed.max() or 1.0)))
            streams = draw_map(panels[1, i], one, logarithm, cell, (-DECADES, 0.0), "cividis")
            _draw_streams(panels[1, i], one)
            for axes in panels[:, i]:
                axes.set_facecolor("black")
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
