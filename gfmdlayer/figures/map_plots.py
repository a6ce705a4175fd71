"""Maps of contact area and mean pressure over two swept keys: a colour for each pair of values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.figures.labels import symbol, time_axis, value_labels
from gfmdlayer.figures.plot_style import PAPER, Style, new_figure, spread, styled
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset

MOST_TICKS = 10
MOST_NUMBERS = 8  # along each axis for which the cells can hold a readable number


def map_figure(sweep: Dataset, time: float | None = None, style: Style = PAPER) -> Figure:
    """Draw contact area and mean pressure over two swept keys, at one time.

    Parameters
    ----------
    sweep : Dataset
        A sweep over two keys, as the reader opens it.
    time : float, optional
        In the units of the config; the row nearest to it is drawn, by default the last one.
    style : Style
        Fonts and lines, and the size of a column.

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
        for axes, letter, quantity in zip(panels, "ab", row.data_vars.values(), strict=True):
            draw_quantity(axes, quantity, symbol(quantity))
            axes.set_title(f"({letter})  {label} = {float(row['time']) / tau:.4g}", loc="left")
        panels[1].set_ylabel("")
    return figure


def draw_quantity(axes: Axes, quantity: DataArray, label: str) -> None:
    """Draw a quantity over two swept keys, the first along x; cases without a value are hatched.

    Parameters
    ----------
    axes : Axes
        The panel; the colour bar is put beside it.
    quantity : DataArray
        Values along the two swept keys, with the coordinates of a sweep.
    label : str
        Label of the colour bar.
    """
    across, up = (quantity[name] for name in quantity.dims)
    values = quantity.to_numpy().T
    axes.patch.set(facecolor="white", hatch="////", edgecolor="0.8")
    mesh = axes.imshow(values, origin="lower", aspect="auto", interpolation="nearest", cmap="viridis")
    axes.figure.colorbar(mesh, ax=axes, label=label)
    axes.tick_params(which="both", top=False, right=False, direction="out")
    axes.minorticks_off()
    for axis, coordinate in ((axes.xaxis, across), (axes.yaxis, up)):
        ticks = spread(coordinate.size, MOST_TICKS)
        labels = value_labels(coordinate.to_numpy().tolist())
        axis.set_ticks(ticks, [labels[i] for i in ticks])
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
