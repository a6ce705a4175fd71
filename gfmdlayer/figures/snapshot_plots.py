"""Pictures of the surface at the snapshot times, zoomed to the contact.

A line contact is drawn as profiles of displacement and pressure, a surface in two dimensions as maps of
pressure and gap with a cut through both.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from gfmdlayer.figures.labels import symbol
from gfmdlayer.figures.plot_style import (
    PAPER,
    Style,
    colours,
    legend_entries,
    line_style,
    new_figure,
    spread,
    styled,
)
from gfmdlayer.figures.snapshot_selection import Window, extent, limits, section, snapshot_titles, window

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage
    from xarray import DataArray, Dataset

MOST_CASES = 6
MOST_MAPS = 4
PRESSURE_COLOURS, GAP_COLOURS, CONTACT = "magma_r", "cividis_r", "black"
PUNCH: dict[str, Any] = {"color": "0.4", "linestyle": (0, (4, 2))}


def snapshots_figure(cases: Mapping[str, Dataset], style: Style = PAPER) -> Figure:
    """Draw the snapshots of cases.

    Line contacts have a row of two panels for each case, displacement and pressure, with a curve for each
    snapshot. A single case in two dimensions is drawn as maps of pressure and gap at up to MOST_MAPS of the
    times, with punch, surface and pressure along a cut; several cases as a row of pressure maps each.

    Parameters
    ----------
    cases : mapping
        Title -> case as the reader opens it; all have snapshots, and grids of one dimensionality.
    style : Style
        Fonts and lines, and the size of a column.
    """
    with styled(style):
        first = next(iter(cases.values()))
        if "y" not in first["pressure"].dims:
            return _profiles(cases, style)
        if len(cases) == 1 and "gap" in first:
            return _surface(next(iter(cases)), first, style)
        return _maps(cases, style)


def _profiles(cases: Mapping[str, Dataset], style: Style) -> Figure:
    figure = new_figure(2, 22.0 + 38.0 * len(cases), style)
    panels = figure.subplots(len(cases), 2, sharex=True, sharey="col", squeeze=False)
    left, right = extent(cases.values(), "x")
    for row, (title, case) in zip(panels, cases.items(), strict=True):
        for axes, name in zip(row, ("displacement", "pressure"), strict=True):
            _draw_profiles(axes, case[name], left, right)
        row[0].set_title(title, loc="left")
    for axes in panels[-1]:
        axes.set_xlabel(symbol(case["x"]))
        axes.set_xlim(left, right)
    panels[0, 1].set_ylim(bottom=0)
    titles = snapshot_titles(max(cases.values(), key=lambda case: case.sizes["snapshot"]))
    kept = legend_entries(titles, colours(len(titles)), [line_style(i) for i in range(len(titles))], 10)
    figure.legend(handles=kept, loc="outside upper center", ncols=-(-len(kept) // -(-len(kept) // 5)))
    return figure


def _draw_profiles(axes: Axes, field: DataArray, left: float, right: float) -> None:
    x = field["x"].to_numpy()
    shown = (x >= left) & (x <= right)
    for i, colour in enumerate(colours(field.sizes["snapshot"])):
        axes.plot(x[shown], field.isel(snapshot=i).to_numpy()[shown], color=colour, linestyle=line_style(i))
    axes.set_ylabel(symbol(field))


def _maps(cases: Mapping[str, Dataset], style: Style) -> Figure:
    columns = min(max(case.sizes["snapshot"] for case in cases.values()), MOST_MAPS)
    figure = new_figure(2, 14.0 + 150.0 / max(columns, 2) * len(cases), style)
    panels = figure.subplots(len(cases), columns, sharex=True, sharey=True, squeeze=False)
    view = window(cases.values())
    peak = max(limits(case["pressure"])[1] for case in cases.values())
    look = {"vmin": 0.0, "vmax": peak or 1.0, "cmap": PRESSURE_COLOURS}
    for row, (title, case) in zip(panels, cases.items(), strict=True):
        titles, pressure = snapshot_titles(case), case["pressure"]
        kept = spread(len(titles), columns)
        for axes, i in zip(row, kept, strict=False):
            mesh = draw_map(axes, pressure.isel(snapshot=i), view, **look)
            axes.set_title(titles[i], loc="right")
        for axes in row[len(kept) :]:
            axes.set_axis_off()
        row[0].set_title(title, loc="left")
        row[0].set_ylabel(symbol(case["y"]))
    for axes in panels[-1]:
        axes.set_xlabel(symbol(case["x"]))
    figure.colorbar(mesh, ax=panels, label=symbol(pressure), shrink=0.8)
    return figure


def _surface(title: str, case: Dataset, style: Style) -> Figure:
    """Draw maps of pressure and gap of one case, with a cut below."""
    case = case.isel(snapshot=spread(case.sizes["snapshot"], MOST_MAPS)).load()
    count, cut, view = case.sizes["snapshot"], section(case), window([case])
    (left, right), (low, high) = view["x"], view["y"]
    width = 145.0 / max(count, 2)
    height = width * min((high - low) / (right - left), 1.5)
    figure = new_figure(2, 26.0 + 2 * height + 60.0, style)
    panels = figure.subplots(
        4, count, sharex=True, sharey="row", squeeze=False, height_ratios=(height, height, 30.0, 30.0)
    )
    gap_in_view = case["gap"].sel({name: slice(*view[name]) for name in "xy"})
    looks: dict[str, dict[str, Any]] = {
        "pressure": {"vmax": float(case["pressure"].max()) or 1.0, "cmap": PRESSURE_COLOURS},
        "gap": {"vmax": float(gap_in_view.max()) or 1.0, "cmap": GAP_COLOURS},
    }
    fields = {"pressure": case["pressure"], "gap": _open_gap(case)}
    for i, (column, time) in enumerate(zip(panels.T, snapshot_titles(case), strict=True)):
        for axes, (name, field), line in zip(column, fields.items(), ("0.4", "white"), strict=False):
            mesh = draw_map(axes, field.isel(snapshot=i), view, vmin=0.0, **looks[name])
            axes.axhline(float(cut["y"]), color=line, linewidth=0.6, linestyle=(0, (4, 3)))
            if i == count - 1:
                figure.colorbar(mesh, ax=panels[list(fields).index(name)], label=symbol(field), aspect=12)
        _draw_cut(column[2], cut.isel(snapshot=i))
        column[3].plot(cut["x"], cut["pressure"].isel(snapshot=i), color=colours(1)[0])
        column[0].set_title(time, loc="right")
        column[3].set_xlabel(symbol(case["x"]))
    y, u, p = (symbol(case[name]) for name in ("y", "displacement", "pressure"))
    for axes, label in zip(panels[:, 0], (y, y, f"{u}, punch", p), strict=True):
        axes.set_ylabel(label)
    panels[0, 0].set_title(title, loc="left")
    panels[2, 0].set_ylim(*heights(cut["displacement"]))
    panels[3, 0].set_ylim(bottom=0)
    return figure


def draw_map(axes: Axes, field: DataArray, view: Window, **look: Any) -> AxesImage:
    """Draw one field over the surface.

    Parameters
    ----------
    axes : Axes
        The panel.
    field : DataArray
        The field along x and y; NaN is drawn in the colour of the contact.
    view : Window
        The part of x and y that is shown.
    **look
        Options of matplotlib's imshow.
    """
    x, y = (field[name].to_numpy() for name in "xy")
    dx, dy = (float(axis[1] - axis[0]) / 2 for axis in (x, y))
    axes.set_facecolor(CONTACT)
    mesh = axes.imshow(
        field.transpose("y", "x").to_numpy(),
        origin="lower",
        extent=(x[0] - dx, x[-1] + dx, y[0] - dy, y[-1] + dy),
        interpolation="nearest",
        **look,
    )
    axes.set(aspect="equal", xlim=view["x"], ylim=view["y"])
    return mesh


def _draw_cut(axes: Axes, cut: Dataset) -> None:
    """Draw the surface and, dashed, the punch along a cut."""
    axes.plot(cut["x"], cut["displacement"], color=colours(1)[0])
    axes.plot(cut["x"], cut["displacement"] + cut["gap"], **PUNCH)


def heights(surface: Any) -> tuple[float, float]:
    """Return the range of heights to show: the surface, and 0.6 of its range above it, for the punch."""
    low, high = float(np.min(surface)), float(np.max(surface))
    size = (high - low) or 1e-12
    return low - 0.15 * size, high + 0.6 * size


def _open_gap(case: Dataset) -> DataArray:
    """Return the gap, or NaN in contact: where the pressure, relative to its maximum, is the larger."""
    gap, pressure = case["gap"], case["pressure"]
    space = [name for name in gap.dims if name != "snapshot"]
    return gap.where(pressure * gap.max(space) <= gap * pressure.max(space))
