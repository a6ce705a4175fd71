"""Maps over two swept keys: a colour for each pair of values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.figures.plot_style import (
    PAPER,
    Style,
    new_figure,
    styled,
    symbol,
    time_axis,
    value_labels,
)
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset

MOST_TICKS = 10
MOST_NUMBERS = 8  # along each axis, if the numbers are to be read in their cells


def map_figure(sweep: Dataset, time: float | None = None, style: Style = PAPER) -> Figure:
    """Draw contact area and mean pressure over two swept keys, at one time.

    Parameters
    ----------
    sweep
        A sweep over two keys, as the reader opens it.
    time
        In the units of the config; the row nearest to it is taken, the last one by default.
    style
        Letters and lines, and the size of a column.

    Raises
    ------
    ResultsError
        If not exactly two keys are swept.
    """
    keys = [str(name) for name in sweep["contact_area"].dims if name != "time"]
    if len(keys) != 2:
        raise ResultsError(
            f"a map needs a sweep over 2 keys, this is one over {len(keys)} ({', '.join(keys) or 'none'})"
        )
    last = sweep["time"][-1] if time is None else time
    row = sweep[["contact_area", "mean_pressure"]].sel(time=last, method="nearest")
    label, tau = time_axis(sweep)
    with styled(style):
        figure = new_figure(2, 72.0, style)
        panels = figure.subplots(1, 2, sharey=True)
        symbols = {"contact_area": r"$\tilde{a}$", "mean_pressure": r"$\tilde{p}$"}
        for axes, letter, (name, symbol) in zip(panels, "ab", symbols.items(), strict=True):
            draw_quantity(axes, row[name], symbol)
            axes.set_title(f"({letter})  {label} = {float(row['time']) / tau:.4g}", loc="left")
        panels[1].set_ylabel("")
    return figure


def draw_quantity(axes: Axes, quantity: DataArray, label: str) -> None:
    """Draw a quantity over two swept keys, the first along x; a case without a value is left hatched.

    Parameters
    ----------
    axes
        Where to draw; the colour bar is put beside it.
    quantity
        Along the two keys, whose coordinates are those of a sweep.
    label
        Of the colour bar.
    """
    across, up = (quantity[name] for name in quantity.dims)
    values = quantity.to_numpy().T
    axes.patch.set(facecolor="white", hatch="////", edgecolor="0.8")
    mesh = axes.imshow(values, origin="lower", aspect="auto", interpolation="nearest", cmap="viridis")
    axes.figure.colorbar(mesh, ax=axes, label=label)
    axes.tick_params(which="both", top=False, right=False, direction="out")
    axes.minorticks_off()
    for axis, coordinate in ((axes.xaxis, across), (axes.yaxis, up)):
        places = np.linspace(0, coordinate.size - 1, min(coordinate.size, MOST_TICKS)).round().astype(int)
        labels = value_labels(coordinate.to_numpy().tolist())
        axis.set_ticks(places, [labels[place] for place in places])
        axis.set_label_text(symbol(coordinate))
    if max(values.shape) <= MOST_NUMBERS:
        _write_numbers(axes, values)


def _write_numbers(axes: Axes, values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
    """Write the values into their cells, dark on light and light on dark."""
    finite = values[np.isfinite(values)]
    middle = (finite.min() + finite.max()) / 2 if finite.size else 0.0
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            colour = "black" if value > middle else "white"
            text = f"{value:#.3g}".rstrip(".")
            axes.text(column, row, text, ha="center", va="center", color=colour, fontsize="small")
