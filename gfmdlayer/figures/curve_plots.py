r"""The paper's figure of a run: contact area and mean pressure against time, one curve for each swept value.

Panel (a) shows $\tilde a$ and panel (b) $\tilde p$ against $t/\tau$, tau being the attribute of the results;
where the cases do not share one, time stays in the config's units. A punch that moves along the surface has
its friction in panel (c). One swept key is told by colour and line
style together, two by colour (the first) and line style (the second).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.figures.inset import Inset
from gfmdlayer.figures.plot_style import (
    LINE_STYLES,
    PAPER,
    Columns,
    Dashes,
    Style,
    case_titles,
    colours,
    line_style,
    new_figure,
    styled,
    time_axis,
    value_titles,
)
from gfmdlayer.observables import known_columns
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import Dataset

LEGEND_ENTRIES = 12
PANELS = {name: f"${column.symbol}$" for name, column in known_columns().items() if column.symbol}


@dataclass(frozen=True)
class _Curve:
    place: dict[str, int]
    colour: str
    dashes: Dashes


_Entry = tuple[str, str, Dashes]  # title, colour, line style


def curves_figure(
    dataset: Dataset,
    columns: Columns = 2,
    *,
    style: Style = PAPER,
    log_time: bool = False,
    inset: Inset | None = None,
) -> Figure:
    """Draw contact area and mean pressure, and friction where there is any, against time, a panel each.

    In one column they are stacked.

    Parameters
    ----------
    dataset
        A sweep or a case, as the reader opens it.
    columns
        Width of the figure in columns of a journal.
    style
        Letters and lines, and the size of a column.
    log_time
        Whether the time axis is logarithmic; it then begins at the first row after t = 0.
    inset
        Punch and surface at chosen times, drawn into the first panel and marked on the curve of their case.

    Raises
    ------
    ResultsError
        If more than two keys are swept.
    """
    curves, entries = _curves(dataset)
    with styled(style):
        labels = {name: label for name, label in PANELS.items() if name in dataset}
        count = len(labels)
        figure = new_figure(columns, 66.0 if columns == 2 else 62.5 * count, style)
        panels = figure.subplots(1, count) if columns == 2 else figure.subplots(count, 1, sharex=True)
        for axes, letter, (name, label) in zip(panels, "abc", labels.items(), strict=False):
            _draw_panel(axes, dataset, name, curves, log_time=log_time)
            axes.set_ylabel(label)
            axes.set_title(f"({letter})", loc="left")
            if inset is not None:
                inset.mark(axes, dataset[name])
        for axes in panels if columns == 2 else panels[-1:]:
            axes.set_xlabel(time_axis(dataset)[0])
        if entries:
            _draw_legend(figure, entries, columns)
        if inset is not None:
            inset.draw(panels[0])
    return figure


def _draw_panel(axes: Axes, dataset: Dataset, name: str, curves: list[_Curve], *, log_time: bool) -> None:
    time = dataset["time"].to_numpy() / time_axis(dataset)[1]
    shown = time > 0 if log_time else np.ones(time.shape, dtype=bool)
    for curve in curves:
        values = dataset[name].isel(curve.place).to_numpy()
        axes.plot(time[shown], values[shown], color=curve.colour, linestyle=curve.dashes)
    if log_time:
        axes.set_xscale("log")
    if np.count_nonzero(shown) > 1:
        axes.set_xlim(time[shown][0], time[-1])
    if axes.dataLim.y0 >= 0:
        axes.set_ylim(bottom=0)


def _curves(dataset: Dataset) -> tuple[list[_Curve], list[_Entry]]:
    """Choose colour and line style of each curve, and the entries of the legend."""
    names = [str(name) for name in dataset["contact_area"].dims if name != "time"]
    if not names:
        return [_Curve({}, colours(1)[0], line_style(0))], []
    if len(names) > 2:
        raise ResultsError(
            f"cannot draw a sweep over {len(names)} keys ({', '.join(names)}): at most 2, select some"
        )
    first = colours(dataset.sizes[names[0]])
    if len(names) == 2:
        return _crossed_curves(dataset, names, first)
    curves = [_Curve({names[0]: i}, colour, line_style(i)) for i, colour in enumerate(first)]
    labels = case_titles(dataset).values()
    return curves, _thinned([(label, c.colour, c.dashes) for label, c in zip(labels, curves, strict=True)])


def _crossed_curves(
    dataset: Dataset, names: list[str], first: list[str]
) -> tuple[list[_Curve], list[_Entry]]:
    """Colour by the first key and line style by the second."""
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
    by_colour = zip(value_titles(dataset[names[0]]), first, strict=True)
    by_style = enumerate(value_titles(dataset[names[1]]))
    return curves, [
        *_thinned([(title, colour, "solid") for title, colour in by_colour]),
        *((title, "black", line_style(j)) for j, title in by_style),
    ]


def _thinned(entries: list[_Entry]) -> list[_Entry]:
    """Keep a legend readable: the first, the last, and some between."""
    if len(entries) <= LEGEND_ENTRIES:
        return entries
    kept = np.linspace(0, len(entries) - 1, LEGEND_ENTRIES).round().astype(int)
    return [entries[place] for place in kept]


def _draw_legend(figure: Figure, entries: list[_Entry], columns: Columns) -> None:
    """Put the legend beside the panels, or below them in one column."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, linestyle=dashes, label=title) for title, colour, dashes in entries
    ]
    if columns == 2:
        figure.legend(handles=handles, loc="outside right center")
    else:
        figure.legend(handles=handles, loc="outside lower center", ncols=3)
