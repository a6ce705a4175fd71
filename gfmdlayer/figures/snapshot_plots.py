"""Pictures of the surface at the snapshot times, zoomed to the contact.

A line is drawn as profiles of displacement and pressure; a surface in two dimensions as maps of pressure and
gap with a cut through both.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gfmdlayer.figures.plot_style import PAPER, Style, colours, line_style, new_figure, styled
from gfmdlayer.figures.snapshot_selection import extent, limits, section, snapshot_times, spread

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage
    from xarray import DataArray, Dataset

Window = Mapping[str, tuple[float, float]]

MOST_CASES = 6
MOST_MAPS = 4
PRESSURE_COLOURS, GAP_COLOURS, CONTACT = "magma_r", "cividis_r", "black"


def snapshots_figure(cases: Mapping[str, Dataset], style: Style = PAPER) -> Figure:
    """Draw the snapshots of cases.

    For surfaces in one dimension there is a row of panels a case, displacement and pressure, with a curve for
    each snapshot. A single case in two dimensions is drawn as maps of pressure and gap at up to MOST_MAPS of
    the times, with punch, surface and pressure along a cut; several, by a row of pressure maps each.

    Parameters
    ----------
    cases
        Title -> the case as the reader opens it; all have snapshots, and grids of one dimensionality.
    style
        Letters and lines, and the size of a column.
    """
    with styled(style):
        first = next(iter(cases.values()))
        if "y" not in first["pressure"].dims:
            return _profiles(cases, style)
        if len(cases) == 1 and "gap" in first:
            return _surface(next(iter(cases)), first, style)
        return _maps(cases, style)


def _profiles(cases: Mapping[str, Dataset], style: Style) -> Figure:
    from matplotlib.lines import Line2D

    figure = new_figure(2, 22.0 + 38.0 * len(cases), style)
    panels = figure.subplots(len(cases), 2, sharex=True, sharey="col", squeeze=False)
    left, right = extent(cases.values(), "x")
    time_label, times = snapshot_times(max(cases.values(), key=lambda dataset: dataset.sizes["snapshot"]))
    for row, (title, dataset) in zip(panels, cases.items(), strict=True):
        for axes, name, label in zip(row, ("displacement", "pressure"), ("$u$", "$p$"), strict=True):
            _draw_profiles(axes, dataset[name], left, right)
            axes.set_ylabel(label)
        row[0].set_title(title, loc="left")
    for axes in panels[-1]:
        axes.set_xlabel("$x$")
        axes.set_xlim(left, right)
    panels[0, 1].set_ylim(bottom=0)
    lines = [
        Line2D([], [], color=colour, linestyle=line_style(place), label=f"{time_label} = {label}")
        for place, (colour, label) in enumerate(zip(colours(len(times)), times, strict=True))
    ]
    kept = [lines[place] for place in spread(len(lines), 10)]
    figure.legend(handles=kept, loc="outside upper center", ncols=-(-len(kept) // -(-len(kept) // 5)))
    return figure


def _draw_profiles(axes: Axes, field: DataArray, left: float, right: float) -> None:
    x = field["x"].to_numpy()
    shown = (x >= left) & (x <= right)
    for place, colour in enumerate(colours(field.sizes["snapshot"])):
        values = field.isel(snapshot=place).to_numpy()
        axes.plot(x[shown], values[shown], color=colour, linestyle=line_style(place))


def _maps(cases: Mapping[str, Dataset], style: Style) -> Figure:
    most = max(dataset.sizes["snapshot"] for dataset in cases.values())
    columns = min(most, MOST_MAPS)
    figure = new_figure(2, 14.0 + 150.0 / max(columns, 2) * len(cases), style)
    panels = figure.subplots(len(cases), columns, sharex=True, sharey=True, squeeze=False)
    window = {name: extent(cases.values(), name) for name in "xy"}
    peak = max(limits(dataset["pressure"])[1] for dataset in cases.values())
    for row, (title, dataset) in zip(panels, cases.items(), strict=True):
        time_label, times = snapshot_times(dataset)
        kept = spread(len(times), columns)
        for axes, place in zip(row, kept, strict=False):
            mesh = draw_map(
                axes,
                dataset["pressure"].isel(snapshot=place),
                window,
                vmin=0.0,
                vmax=peak or 1.0,
                cmap=PRESSURE_COLOURS,
            )
            axes.set_title(f"{time_label} = {times[place]}", loc="right")
        for axes in row[len(kept) :]:
            axes.set_axis_off()
        row[0].set_title(title, loc="left")
        row[0].set_ylabel("$y$")
    for axes in panels[-1]:
        axes.set_xlabel("$x$")
    figure.colorbar(mesh, ax=panels, label="$p$", shrink=0.8)
    return figure


def _surface(title: str, case: Dataset, style: Style) -> Figure:
    """Draw maps of pressure and gap of one case, with a cut below."""
    time_label, times = snapshot_times(case)
    kept = spread(len(times), MOST_MAPS)
    case = case.isel(snapshot=kept).load()
    cut, window = section(case), {name: extent([case], name) for name in "xy"}
    (left, right), (low, high) = window["x"], window["y"]
    width = 145.0 / max(len(kept), 2)
    height = width * min((high - low) / (right - left), 1.5)
    figure = new_figure(2, 26.0 + 2 * height + 60.0, style)
    grid = figure.subplots(
        4, len(kept), sharex=True, sharey="row", squeeze=False, height_ratios=(height, height, 30.0, 30.0)
    )
    ranges: dict[str, dict[str, Any]] = {
        "pressure": {"vmin": 0.0, "vmax": float(case["pressure"].max()) or 1.0, "cmap": PRESSURE_COLOURS},
        "gap": {"vmin": 0.0, "vmax": _shown_gap(case, window), "cmap": GAP_COLOURS},
    }
    for place, column in enumerate(grid.T):
        one, along = case.isel(snapshot=place), cut.isel(snapshot=place)
        for axes, (name, look) in zip(column, ranges.items(), strict=False):
            field, line = (one[name], "0.4") if name == "pressure" else (open_gap(one), "white")
            mesh = draw_map(axes, field, window, **look)
            axes.axhline(float(cut["y"]), color=line, linewidth=0.6, linestyle=(0, (4, 3)))
            if place == len(kept) - 1:
                label = "$p$" if name == "pressure" else "gap"
                figure.colorbar(mesh, ax=grid[0 if name == "pressure" else 1], label=label, aspect=12)
        draw_cut(column[2], along)
        column[3].plot(along["x"], along["pressure"], color=colours(1)[0])
        column[0].set_title(f"{time_label} = {times[kept[place]]}", loc="right")
        column[3].set_xlabel("$x$")
    for axes, label in zip(grid[:, 0], ("$y$", "$y$", "$u$, punch", "$p$"), strict=True):
        axes.set_ylabel(label)
    grid[0, 0].set_title(title, loc="left")
    surface = cut["displacement"].to_numpy()
    grid[2, 0].set_ylim(*heights(surface))
    grid[3, 0].set_ylim(bottom=0)
    return figure


def draw_map(axes: Axes, field: DataArray, window: Window, **look: Any) -> AxesImage:
    """Draw one field over the surface, within a window of x and y."""
    x, y = (field[name].to_numpy() for name in "xy")
    dx, dy = (float(axis[1] - axis[0]) / 2 for axis in (x, y))
    axes.set_facecolor(CONTACT)  # seen where the gap is closed
    mesh = axes.imshow(
        field.transpose("y", "x").to_numpy(),
        origin="lower",
        extent=(x[0] - dx, x[-1] + dx, y[0] - dy, y[-1] + dy),
        interpolation="nearest",
        **look,
    )
    axes.set(aspect="equal", xlim=window["x"], ylim=window["y"])
    return mesh


def draw_cut(axes: Axes, cut: Dataset) -> None:
    """Draw the surface and, dashed, the punch along a cut."""
    surface = cut["displacement"].to_numpy()
    axes.plot(cut["x"], surface, color=colours(1)[0])
    axes.plot(cut["x"], surface + cut["gap"].to_numpy(), color="0.4", linestyle=(0, (4, 2)))


def heights(surface: Any) -> tuple[float, float]:
    """Return the heights to show: the surface and as much again above it, for the punch."""
    low, high = float(surface.min()), float(surface.max())
    room = (high - low) or 1e-12
    return low - 0.15 * room, high + 0.6 * room


def open_gap(case: Dataset) -> DataArray:
    """Return the gap where the surface is not in contact, and NaN, which is drawn as nothing, where it is."""
    gap, pressure = case["gap"], case["pressure"]
    return gap.where(pressure * float(gap.max()) <= gap * float(pressure.max()))


def _shown_gap(case: Dataset, window: Window) -> float:
    within = {name: slice(*window[name]) for name in "xy"}
    return float(case["gap"].sel(within).max()) or 1.0
