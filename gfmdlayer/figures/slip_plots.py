"""Where the surfaces stick and slip: maps over x and time of a line, over x and y of a surface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gfmdlayer.figures.labels import explained, finish, name_axes, quantity
from gfmdlayer.figures.plot_style import PAPER, Style, colours, legend_above, line_style, new_figure, styled
from gfmdlayer.figures.snapshot_plots import (
    MAP_POINTS,
    MOST_MAPS,
    Extremes,
    draw_bar,
    draw_map,
    each_snapshot,
    part_of,
    snapshot_times,
    snapshot_titles,
)
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset

APART, STICK, SLIP = 0, 1, 2
# Okabe & Ito's blue and orange, which the colour-blind tell apart, on white.
STATES = {APART: "white", STICK: "#0072b2", SLIP: "#e69f00"}
_CURVES = 6  # of shear traction below the map of a line


def stick_figure(
    case: Dataset, title: str = "", style: Style = PAPER, notes: Sequence[str] = (), *, every: bool = False
) -> Figure:
    """Draw stick and slip at the snapshots, and the shear traction.

    Parameters
    ----------
    case : xarray.Dataset
        A case with friction at the interface and snapshots.
    title : str
        Above the figure.
    style : Style
        Sizes and fonts.
    notes : sequence of str
        Lines below the figure.
    every : bool
        Whether all of very many maps of a surface are drawn; otherwise a note says how many are.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ResultsError
        If the case has no friction at the interface.
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
        finish(figure, [*explained(case, ["shear_x"], [title]), *notes, *left_out])
    return figure


def states(case: Dataset) -> DataArray:
    """Return APART, STICK or SLIP at each point of the snapshots of a case."""
    slips = (case[name] for name in ("slip_velocity_x", "slip_velocity_y") if name in case)
    moving = sum(abs(each.fillna(0.0)) for each in slips) > 0
    found: DataArray = (case["pressure"] > 0) * STICK + moving * (SLIP - STICK)
    return found.where(case["pressure"] > 0, APART)


def _entries() -> list[Any]:
    from matplotlib.patches import Patch

    names = ((STICK, "stick"), (SLIP, "slip"))
    return [Patch(facecolor=STATES[state], label=label) for state, label in names]


def _coloured() -> dict[str, Any]:
    from matplotlib.colors import ListedColormap

    return {"cmap": ListedColormap(list(STATES.values())), "vmin": APART, "vmax": SLIP}


def _line(case: Dataset, style: Style) -> Figure:
    """Draw a map over x and the order of the snapshots, and some profiles of shear traction below."""
    seen = Extremes.of([case])
    left, right = seen.view["x"]
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
        **_coloured(),
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
    legend_above(figure, [*_entries(), *below.get_legend_handles_labels()[0]])
    return figure


def _surface(case: Dataset, seen: Extremes, style: Style) -> Figure:
    """Draw maps of stick and slip, and of the shear traction along x, at the snapshots."""
    count = case.sizes["snapshot"]
    (left, right), (low, high) = seen.view["x"], seen.view["y"]
    height = 150.0 / max(count, 2) * min((high - low) / (right - left), 1.5)
    figure = new_figure(2, 26.0 + 2 * (height + 4.0), style)
    panels = figure.subplots(2, count, sharex=True, sharey=True, squeeze=False)
    largest = float(abs(case["shear_x"]).max()) or 1.0
    x, y = (quantity(case[name], case.attrs) for name in "xy")
    found = states(case)
    for i, (time, field) in enumerate(
        zip(snapshot_titles(case), each_snapshot(case["shear_x"]), strict=True)
    ):
        one = found.isel(snapshot=i)
        mesh = draw_map(panels[0, i], case, one.rename("state"), seen.view, (APART, SLIP))
        mesh.set_cmap(_coloured()["cmap"])
        panels[0, i].set_title(time, loc="right")
        mesh = draw_map(panels[1, i], case, field, seen.view, (-largest, largest))
        mesh.set_cmap("RdBu_r")
        name_axes(panels[1, i], x)
    for row in panels:
        name_axes(row[0], y=y)
    draw_bar(panels[1, -1], mesh, quantity(case["shear_x"], case.attrs))
    legend_above(figure, _entries())
    return figure
