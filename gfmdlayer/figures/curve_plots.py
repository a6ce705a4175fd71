r"""The paper's figure of a run: contact area and mean pressure against time, one curve for each swept value.

Panel (a) shows $\tilde a$ and panel (b) $\tilde p$ against $t/\tau$, tau being an attribute of the results;
where the cases do not share one, time stays in the config's units. The friction of a punch that moves along
the surface is in panel (c). The values of one swept key differ in colour and line style, those of two keys in
colour (the first key) and line style (the second).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gfmdlayer.figures.inset import Inset
from gfmdlayer.figures.labels import case_titles, symbol, time_axis, value_titles
from gfmdlayer.figures.plot_style import (
    LINE_STYLES,
    PAPER,
    Columns,
    Dashes,
    Style,
    colours,
    legend_entries,
    line_style,
    new_figure,
    styled,
)
from gfmdlayer.observables import known_columns
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from xarray import DataArray, Dataset

LEGEND_ENTRIES = 12
PANELS = {name: f"${column.symbol}$" for name, column in known_columns().items() if column.symbol}


class _Curve(NamedTuple):
    place: dict[str, int]  # indices along the swept keys
    colour: str
    dashes: Dashes


def curves_figure(
    dataset: Dataset,
    columns: Columns = 2,
    *,
    style: Style = PAPER,
    log_time: bool = False,
    inset: Inset | None = None,
) -> Figure:
    """Draw contact area, mean pressure and any friction against time, in a panel each.

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

    Raises
    ------
    ResultsError
        If more than two keys are swept.
    """
    with styled(style):
        curves, entries = _curves(dataset)
        names = [name for name in PANELS if name in dataset]
        count = len(names)
        figure = new_figure(columns, 66.0 if columns == 2 else 62.5 * count, style)
        panels = figure.subplots(1, count) if columns == 2 else figure.subplots(count, 1, sharex=True)
        for axes, letter, name in zip(panels, "abc", names, strict=False):
            _draw_curves(axes, dataset[name], time_axis(dataset)[1], curves, log_time=log_time)
            axes.set_title(f"({letter})", loc="left")
            if inset is not None:
                inset.mark(axes, dataset[name])
        for axes in panels if columns == 2 else panels[-1:]:
            axes.set_xlabel(time_axis(dataset)[0])
        if entries and columns == 2:
            figure.legend(handles=entries, loc="outside right center")
        elif entries:
            figure.legend(handles=entries, loc="outside lower center", ncols=3)
        if inset is not None:
            inset.draw(panels[0])
    return figure


def _draw_curves(axes: Axes, column: DataArray, unit: float, curves: list[_Curve], *, log_time: bool) -> None:
    time = column["time"].to_numpy() / unit
    shown = time > 0 if log_time else np.ones(time.shape, dtype=bool)
    for curve in curves:
        values = column.isel(curve.place).to_numpy()
        axes.plot(time[shown], values[shown], color=curve.colour, linestyle=curve.dashes)
    if log_time:
        axes.set_xscale("log")
    if np.count_nonzero(shown) > 1:
        axes.set_xlim(time[shown][0], time[-1])
    if axes.dataLim.y0 >= 0:
        axes.set_ylim(bottom=0)
    axes.set_ylabel(symbol(column))


def _curves(dataset: Dataset) -> tuple[list[_Curve], list[Line2D]]:
    """Choose colour and line style of each curve, and make the entries of the legend."""
    names = [str(name) for name in dataset["contact_area"].dims if name != "time"]
    if not names:
        return [_Curve({}, colours(1)[0], line_style(0))], []
    if len(names) > 2:
        raise ResultsError(
            f"cannot draw a sweep over {len(names)} keys ({', '.join(names)}): at most 2, select some"
        )
    first = colours(dataset.sizes[names[0]])
    if len(names) == 1:
        curves = [_Curve({names[0]: i}, colour, line_style(i)) for i, colour in enumerate(first)]
        titles, dashes = list(case_titles(dataset).values()), [curve.dashes for curve in curves]
        return curves, legend_entries(titles, first, dashes, LEGEND_ENTRIES)
    count = dataset.sizes[names[1]]
    if count > len(LINE_STYLES):
        raise ResultsError(
            f"cannot draw {count} values of {names[1]} as line styles: at most {len(LINE_STYLES)}"
        )
    curves = [
        _Curve({names[0]: i, names[1]: j}, colour, line_style(j))
        for i, colour in enumerate(first)
        for j in range(count)
    ]
    coloured, dashed = (value_titles(dataset[name]) for name in names)
    return curves, [
        *legend_entries(coloured, first, ["solid"] * len(first), LEGEND_ENTRIES),
        *legend_entries(dashed, ["black"] * count, LINE_STYLES[:count], count),
    ]
