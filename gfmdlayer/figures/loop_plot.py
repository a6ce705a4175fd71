"""Force against depth over a whole run, with the area of the loop and the work of separation written in.

The cases come from their own files: a sweep file holds the times that all cases share, which runs of
different speeds do not. The area is the integral of the mean pressure over the depth, the work that the punch
has done at the end; the part below zero in retraction is the work of separation.
"""

from __future__ import annotations

from contextlib import closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.figures.curve_family import family
from gfmdlayer.figures.labels import value_labels
from gfmdlayer.figures.plot_style import PAPER, Style, legend_entries, new_figure, styled
from gfmdlayer.figures.quantities import finish, quantity
from gfmdlayer.figures.selection import column_name, notes
from gfmdlayer.results.reader import case_path, is_complete, open_case
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import Dataset

ROW_MM = 4.5  # of the legend
_LETTERS = 80  # in a row of it, the commands of mathtext included
_NOTHING = 2e-3  # part of the largest value that cannot be seen
_MARGIN = 0.05
_SEPARATION = "work_of_separation"


def loop_figure(path: Path, dataset: Dataset, style: Style = PAPER, y: str = "force") -> Figure:
    """Draw a column against depth for each case, with areas in the legend or, of one case, in the panel.

    Parameters
    ----------
    path : Path
        The folder of results, or the file of a case.
    dataset : Dataset
        What the reader opens there, or a selection of its cases.
    style : Style
        Fonts and lines, and the size of a column.
    y : str
        The column: force, mean_stress or mean_pressure.

    Raises
    ------
    ResultsError
        If no case is complete, or there is no such column.
    """
    with styled(style):
        drawn, legend = family(dataset), []
        titles = [title for title, *_ in drawn.legend] if len(drawn.legend) == len(drawn.curves) else []
        figure = new_figure(1, 66.0 + ROW_MM * len(titles), style)
        axes = figure.subplots()
        for i, curve in enumerate(drawn.curves):
            opened = _opened(path, drawn.sweep, curve.place)
            if opened is None:
                continue
            with opened as case:
                areas = _draw(axes, case, y, curve.colour, curve.dashes, alone=len(drawn.curves) == 1)
            if titles:
                legend.append((", ".join([titles[i], *areas[1:]]), curve.colour, curve.dashes))
            elif len(drawn.curves) == 1:
                axes.text(0.03, 0.96, "\n".join(areas), transform=axes.transAxes, va="top")
        if not axes.lines:
            raise ResultsError(f"{path}: no case is complete")
        _zoom(axes)
        axes.axhline(0.0, color="0.6", linewidth=0.5, zorder=0)
        if entries := legend_entries(legend or drawn.legend):
            longest = max(len(str(entry.get_label())) for entry in entries)
            across = 1 if legend else max(1, _LETTERS // longest)
            figure.legend(handles=entries, loc="outside lower center", ncols=across)
        if drawn.bar is not None:
            drawn.bar.draw(figure, axes)
        finish(figure, [*notes(drawn.sweep), *drawn.notes])
    return figure


def _opened(path: Path, sweep: Dataset, place: dict[str, int]) -> AbstractContextManager[Dataset] | None:
    """Open the case of a curve; None where it is not complete."""
    if "case" not in sweep.coords:
        return nullcontext(sweep)
    file = case_path(path, int(sweep["case"].isel(place)))
    return closing(open_case(file)) if is_complete(file) else None


def _zoom(axes: Axes) -> None:
    """Leave out the depths at which the punch is away, where no curve is off zero."""
    curves = [line.get_data() for line in axes.lines]
    least = _NOTHING * max(float(np.abs(y).max(initial=0.0)) for _, y in curves)
    acts = np.concatenate([np.asarray(x)[np.abs(y) > least] for x, y in curves])
    if acts.size and (room := _MARGIN * np.ptp(acts)) > 0:
        axes.set_xlim(acts.min() - room, acts.max() + room)


def _draw(axes: Axes, case: Dataset, y: str, colour: str, dashes: object, *, alone: bool) -> list[str]:
    """Draw one case; return its areas in words, that of the loop first."""
    y = column_name(case, y)
    along, up = quantity(case["depth"], case.attrs), quantity(case[y], case.attrs)
    depth, values = case["depth"].to_numpy(), case[y].to_numpy()
    axes.plot(depth / along.scale, values / up.scale, color=colour, linestyle=dashes)
    if alone:
        back = np.append(False, np.diff(depth) < 0)
        pulls = np.where(back, np.minimum(values, 0.0), np.nan)
        axes.fill_between(depth / along.scale, pulls / up.scale, 0.0, color=colour, alpha=0.15, linewidth=0)
    axes.set(xlabel=along.label, ylabel=up.label)
    found = {"loop_area": float(np.trapezoid(case["mean_stress"].to_numpy(), depth))}
    if _SEPARATION in case.attrs:
        found[_SEPARATION] = float(case.attrs[_SEPARATION])
    written = []
    for name, value in found.items():
        area = quantity(case["work"].isel(time=0).rename(name), case.attrs)
        written.append(area.equals(value_labels([float(f"{value / area.scale:.3g}")])[0]))
    return written
