"""How sure the numbers of a case are: errors of its columns by source, and of one of them over the work.

Beside the case, at a work of 1, lies its estimated error; each run with another size of a source lies at its
own work and its difference from the case. A dashed line has the expected order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gfmdlayer.figures.plot_style import PAPER, Style, colours, line_style, new_figure, styled
from gfmdlayer.results.convergence import COUNTED_NOTE
from gfmdlayer.results.names import ResultsError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import Dataset

LEAST = 1e-12  # relative error that is drawn
MOST_COLUMNS = 16


def convergence_figure(data: Dataset, style: Style = PAPER, columns: Sequence[str] = ()) -> Figure:
    """Draw the errors of columns by source and, of the first of them, over the work of the runs.

    Parameters
    ----------
    data : xarray.Dataset
        The estimates, `ErrorReport.data`.
    style : Style
        Sizes and fonts.
    columns : sequence of str
        Columns; by default all, the least sure first.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ResultsError
        If there is no estimate of a column.
    """
    relative = (data["error"] / data["scale"]).to_numpy()
    names = data["column"].to_numpy()
    known = {str(name): relative[names == name] for name in dict.fromkeys(names.tolist())}
    known = {name: errors for name, errors in known.items() if np.nanmax(errors, initial=0.0) > LEAST}
    if wrong := [name for name in columns if name not in known]:
        raise ResultsError(f"no estimate of an error of {wrong[0]!r}; there are {', '.join(known) or 'none'}")
    if not known:
        raise ResultsError("no estimate of an error to draw")
    ordered = list(columns) or sorted(known, key=lambda name: -float(np.nanmax(known[name])))
    places = [int(np.nanargmax(np.where(names == name, relative, np.nan))) for name in ordered][:MOST_COLUMNS]
    sources = [str(name) for name in data["source"].to_numpy()]
    looks = dict(zip(sources, colours(len(sources)), strict=True))
    with styled(style):
        figure = new_figure(2, 62.0 + 2.0 * max(len(places) - 8, 0), style)
        left, right = figure.subplots(1, 2)
        _by_source(left, data, places, looks)
        sure = [i for i in places if data["note"].to_numpy()[i] != COUNTED_NOTE]
        _over_work(right, data, _first(data, places if columns else sure or places), looks)
        for axes, letter in ((left, "a"), (right, "b")):
            axes.set_title(f"({letter})", loc="left")
    return figure


def _first(data: Dataset, places: Sequence[int]) -> int:
    """Return the least sure estimate that is at the end or the peak, which runs have in common."""
    moments = data["moment"].to_numpy()
    name = data["column"].to_numpy()[places[0]]
    alike = np.flatnonzero((data["column"].to_numpy() == name) & np.isin(moments, ("end", "peak")))
    errors = data["error"].to_numpy()[alike]
    return int(alike[np.nanargmax(errors)]) if np.isfinite(errors).any() else places[0]


def _by_source(axes: Axes, data: Dataset, places: Sequence[int], looks: dict[str, Any]) -> None:
    """Draw the errors of columns, and their parts."""
    rows = np.arange(len(places))[::-1]
    scales = data["scale"].to_numpy()[list(places)]
    axes.barh(rows, data["error"].to_numpy()[list(places)] / scales, color="0.88", label="in all")
    for source, colour in looks.items():
        parts = data["errors"].sel(source=source).to_numpy()[list(places)] / scales
        shown = parts > LEAST
        axes.plot(parts[shown], rows[shown], "o", color=colour, label=source)
    axes.set_xscale("log")
    axes.set_yticks(rows, [str(data["column"].to_numpy()[i]).replace("_", " ") for i in places])
    axes.tick_params(axis="y", which="minor", left=False, right=False)
    axes.set_xlabel("error / largest value")


def _over_work(axes: Axes, data: Dataset, place: int, looks: dict[str, Any]) -> None:
    """Draw the differences of the runs from the case, and its error, over the work."""
    one = data.isel(estimate=place)
    scale, case = float(one["scale"]), str(one["case"].to_numpy())
    run_sources, costs = data["run_source"].to_numpy(), data["cost"].to_numpy()
    own = (data["run_case"].to_numpy() == case) & np.isfinite(one["values"].to_numpy())
    sizes, values = data["size"].to_numpy(), one["values"].to_numpy()
    base = own & (run_sources == "points") & (sizes == 1)
    whole = float(costs[base][0]) if base.any() else float(np.nanmax(costs[own]))
    for i, (source, colour) in enumerate(looks.items()):
        chosen = own & (run_sources == source)
        reference = chosen & (sizes == 1)
        if not reference.any():
            continue
        error, order = float(one["errors"].sel(source=source)), float(one["orders"].sel(source=source))
        others = chosen & (sizes != 1)
        off = np.abs(values[others] - values[reference][0]) / scale
        works = costs[others] / whole
        sorted_by = np.argsort(works)
        seen = off[sorted_by] > LEAST
        look = {"color": colour, "linestyle": line_style(i), "label": source}
        axes.plot(works[sorted_by][seen], off[sorted_by][seen], marker="o", **look)
        if error / scale > LEAST:
            at = float(costs[reference][0]) / whole
            axes.plot(at, error / scale, marker="D", color=colour, markerfacecolor="white")
            if source == "points" and (coarse := sizes[others]).size:
                x = np.geomspace(1.0, coarse.max(), 20)
                work = np.interp(np.log(x), np.log([1.0, coarse.max()]), np.log([at, works[coarse.argmax()]]))
                axes.plot(np.exp(work), error / scale * x**order, ":", color=colour)
    axes.set(xscale="log", yscale="log", xlabel="work / work of the case")
    low, high = np.log2(axes.get_xlim())
    axes.set_xticks(
        2.0 ** np.arange(np.ceil(low), high), [f"{2.0**k:g}" for k in np.arange(np.ceil(low), high)]
    )
    axes.tick_params(axis="x", which="minor", labelbottom=False, bottom=False, top=False)
    axes.tick_params(axis="y", which="minor", labelleft=False)
    name = str(one["column"].to_numpy()).replace("_", " ")
    axes.set_ylabel("error / largest value")
    axes.set_title(f"{name}, {one['moment'].to_numpy()}")
    axes.legend(loc="best")
