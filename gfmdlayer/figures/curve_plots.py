r"""Curves of a run, a panel for each column, against time, another column or a swept key.

By default these are the panels of the paper, contact area $\tilde a$ and mean pressure $\tilde p$ against
$t/\tau$; of a punch under a prescribed load the depth in place of the mean pressure, of a punch that moves
along the surface also the friction. There is a curve for each case; `curve_family` chooses their looks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gfmdlayer.figures.curve_family import Family, Scale, family
from gfmdlayer.figures.plot_style import PAPER, Columns, Style, legend_entries, new_figure, spread, styled
from gfmdlayer.figures.quantities import finish, quantity
from gfmdlayer.figures.selection import (
    Time,
    at_time,
    case_dimensions,
    column_name,
    default_columns,
    notes,
    swept,
)
from gfmdlayer.figures.snapshots.plots import Inset
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import Dataset

LABELLED = 40  # most entries of a legend
BESIDE, LETTERS = 12, 40  # most entries of a legend beside the panels, and letters of each; more are below
SHORT = 20  # letters of mathtext of a short entry, of which three fit below a column
ROW_MM = 4.5


def curves_figure(
    dataset: Dataset,
    columns: Columns = 2,
    *,
    style: Style = PAPER,
    log_time: bool = False,
    inset: Inset | None = None,
    x: str = "time",
    y: Sequence[str] = (),
    time: Time | None = None,
) -> Figure:
    """Draw columns of results, in a panel each, against time, another column, or a swept key.

    Parameters
    ----------
    dataset : Dataset
        A sweep or a case, as the reader opens it.
    columns : 1 or 2
        Width of the figure in columns of a journal; in one column the panels are stacked.
    style : Style
        Fonts and lines, and the size of a column.
    log_time : bool
        Whether the time axis is logarithmic; it then begins at the first row after t = 0.
    inset : Inset, optional
        Punch and surface at chosen times, drawn into the first panel and marked on the curve of their case.
    x : str
        Time, a column, or a swept key.
    y : sequence of str
        Columns; by default contact area and mean pressure, or depth under a prescribed load, and friction.
    time : float or str, optional
        Against a swept key: the time, in the units of the config, or "max" or "min", the extremes over time;
        by default "end".

    Raises
    ------
    ResultsError
        If there is no such column, or an option has no effect.
    """
    along = next((str(key.name) for key in swept(dataset) if x in (key.name, key.attrs["key"])), "")
    names = [column_name(dataset, name, of_cases=bool(along)) for name in y] or default_columns(dataset)
    x = along or column_name(dataset, x)
    for given, needed, name in ((log_time or inset, "time", "log_time or inset"), (time, along, "time")):
        if given and x != needed:
            meant = "time" if needed == "time" else "a swept key"
            raise ResultsError(f"{name} has no effect on curves against {x}; must be with {meant} along x")
    with styled(style):
        drawn = family(dataset, along if along in case_dimensions(dataset) else "")
        across = len(names) if len(names) <= 3 else 2 + (len(names) % 2)
        shape = (-(-len(names) // across), across) if columns == 2 else (len(names), 1)
        figure = new_figure(
            columns, (66.0 if columns == 2 else 62.5) * shape[0] * (1.25 if len(names) == 1 else 1.0), style
        )
        panels = figure.subplots(*shape, sharex=columns == 1, squeeze=False)
        for axes in panels.flat[len(names) :]:
            axes.remove()
        for i, (axes, name) in enumerate(zip(panels.flat, names, strict=False)):
            if along:
                when = _draw_against_key(axes, drawn, x, name, time)
            else:
                when = _draw_against_column(axes, drawn, x, name, log_time=log_time)
            if len(names) > 1:
                axes.set_title(f"({'abcdefghijklmnopqrstuvwxyz'[i % 26]})", loc="left")
            axes.set_xlabel(
                quantity(dataset[x], dataset.attrs).label if columns == 2 or i == len(names) - 1 else ""
            )
            if inset is not None:
                inset.mark(axes, drawn.sweep[name])
        more = _draw_legend(figure, panels, drawn, columns, style)
        if inset is not None:
            inset.draw(panels[0, 0])
        finish(figure, [*when, *notes(drawn.sweep, names), *drawn.notes, *more])
    return figure


def _draw_against_column(axes: Axes, drawn: Family, x: str, y: str, *, log_time: bool) -> list[str]:
    """Draw a column of each case against time or another column."""
    sweep = drawn.sweep
    along, up = (quantity(sweep[name], sweep.attrs) for name in (x, y))
    shown = sweep["time"].to_numpy() > 0 if log_time else np.ones(sweep.sizes["time"], dtype=bool)
    for curve in drawn.curves:
        place = {name: i for name, i in curve.place.items() if name in sweep[x].dims}
        across = sweep[x].isel(place).to_numpy()[shown] / along.scale
        values = sweep[y].isel(curve.place).to_numpy()[shown] / up.scale
        axes.plot(across, values, color=curve.colour, linestyle=curve.dashes)
    if log_time:
        axes.set_xscale("log")
    if x == "time" and np.count_nonzero(shown) > 1:
        axes.set_xlim(across[0], across[-1])
    if axes.dataLim.y0 >= 0:
        axes.set_ylim(bottom=0)
    axes.set_ylabel(up.label)
    return []


def _draw_against_key(axes: Axes, drawn: Family, x: str, y: str, time: Time | None) -> list[str]:
    """Draw a column at a time against a swept key, a failed case being a gap in the line; say the time."""
    key, up = drawn.sweep[x], quantity(drawn.sweep[y], drawn.sweep.attrs)
    scale = Scale.of(key.to_numpy().tolist())
    order = np.argsort(scale.positions, kind="stable")
    row, when = at_time(drawn.sweep, y, time)
    if key.dims == ("case",):
        axes.scatter(scale.positions, row / up.scale, s=12, color=[curve.colour for curve in drawn.curves])
    else:
        for curve in drawn.curves:
            values = row.isel(curve.place).to_numpy()[order] / up.scale
            look: dict[str, Any] = {"color": curve.colour, "linestyle": curve.dashes, "marker": "o"}
            axes.plot(scale.positions[order], values, markersize=3, **look)
    scale.apply(axes, "x")
    if axes.dataLim.y0 >= 0:
        axes.set_ylim(bottom=0)
    axes.set_ylabel(up.label)
    return [when] if when else []


def _draw_legend(figure: Figure, panels: Any, drawn: Family, columns: Columns, style: Style) -> list[str]:
    """Draw legend and colour bar; return a note on entries for which there is no room."""
    if drawn.bar is not None:
        drawn.bar.draw(figure, panels)
    kept = spread(len(drawn.legend), LABELLED)
    entries = legend_entries([drawn.legend[i] for i in kept])
    letters = max((len(str(entry.get_label())) for entry in entries), default=0)
    if entries and columns == 2 and len(entries) <= BESIDE and letters <= LETTERS:
        figure.legend(handles=entries, loc="outside right center")
    elif entries:
        across = max(1, (3 if columns == 1 else 6) * SHORT // max(letters, SHORT))
        rows = -(-len(entries) // across)
        width, height = figure.get_size_inches()
        figure.set_size_inches(width, height + max(rows - 2, 0) * ROW_MM * style.scale / 25.4)
        figure.legend(handles=entries, loc="outside lower center", ncols=across)
    return [f"{len(kept)} of {len(drawn.legend)} curves labelled"] * (len(kept) < len(drawn.legend))
