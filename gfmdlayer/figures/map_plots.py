"""Maps of columns over two swept keys: a colour for each pair of values, or a dot for each case of a list.

Also of the parameters fitted to the curves of a force map, with their standard errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib.colors import LogNorm, Normalize

from gfmdlayer.figures.curve_family import Scale
from gfmdlayer.figures.labels import (
    Quantity,
    Ticks,
    explained,
    finish,
    name_axes,
    quantity,
    symbol,
)
from gfmdlayer.figures.plot_style import PAPER, Style, new_figure, styled
from gfmdlayer.figures.selection import (
    Time,
    at_time,
    case_dimensions,
    chosen,
    column_name,
    default_columns,
    find_key,
    notes,
    swept,
    with_values,
)
from gfmdlayer.results.names import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import QuadMesh
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset

    from gfmdlayer.arrays import FloatArray

MOST_NUMBERS, MOST_LETTERS = 8, 42  # numbers along an axis, and letters across, that the cells can hold
WIDE = 100.0  # ratio of values beyond which colours may be logarithmic


def map_figure(
    sweep: Dataset,
    time: Time | None = None,
    style: Style = PAPER,
    *,
    x: str = "",
    y: str = "",
    z: Sequence[str] = (),
    log: Sequence[Literal["x", "y", "z"]] | None = None,
) -> Figure:
    """Draw columns over two swept keys, at one time or at their extremes over time.

    Parameters
    ----------
    sweep : xarray.Dataset
        A sweep, as `gfmdlayer.run` and `open_results` return it.
    time : float or {"end", "max", "min"}, optional
        A time in the units of the configuration, of which the nearest row is drawn, or the extremes over all
        rows; by default the last row.
    style : Style
        Sizes and fonts.
    x, y : str
        Swept keys, by default the first two; further keys stay at their middle values.
    z : sequence of str
        Columns, by default the first two of the curves.
    log : sequence of {"x", "y", "z"}, optional
        Logarithmic axes, and colours (z), all others linear; by default each as its values are spread.

    Returns
    -------
    matplotlib.figure.Figure
        The picture, which `savefig` writes.

    Raises
    ------
    ResultsError
        If there are no two swept keys, or no such column.
    """
    x, y = _axes(sweep, x, y)
    held = [name for name in case_dimensions(sweep) if name not in (x, y, "case")]
    for name in held:
        sweep = chosen(sweep, sweep[name], [sweep.sizes[name] // 2])
    asked = [column_name(sweep, name, of_cases=True) for name in z]
    columns, empty = with_values(sweep, asked, default_columns(sweep)[:2])
    said = [*notes(sweep, columns), *empty]
    if sweep[x].dims == ("case",) and (others := [key for key in swept(sweep) if key.name not in (x, y)]):
        said.append(f"also varied: {', '.join(map(symbol, others))}")
    with styled(style):
        across = min(len(columns), 2)
        rows = -(-len(columns) // across)
        figure = new_figure(2 if across == 2 else 1, 72.0 * rows, style)
        panels = figure.subplots(rows, across, sharey="row", squeeze=False)
        for i, name in enumerate(columns):
            axes, up = panels.flat[i], quantity(sweep[name], sweep.attrs)
            values, when = at_time(sweep, name, time)
            if values.dims == ("case",):
                _draw_dots(axes, values / up.scale, x, y, up, log)
            else:
                draw_quantity(axes, (values / up.scale).transpose(x, y), up, log)
            axes.set_title(f"({chr(ord('a') + i % 26)})  {when}".rstrip(), loc="left")
            if i % across:
                axes.set_ylabel("")
        for axes in panels.flat[len(columns) :]:
            axes.remove()
        finish(figure, [*said, *explained(sweep, [*columns, x, y, *["time"] * bool(when)], said)])
    return figure


def _axes(sweep: Dataset, x: str, y: str) -> tuple[str, str]:
    """Return the swept keys along the axes: those asked for, else the first that are left."""
    keys = [str(key.name) for key in swept(sweep) if key.ndim]
    if len(keys) < 2:
        names = ", ".join(keys) or "none"
        raise ResultsError(f"a map needs a sweep over 2 keys, this is one over {len(keys)} ({names})")
    asked = [str(find_key(sweep, name).name) if name else "" for name in (x, y)]
    free = iter([key for key in keys if key not in asked])
    x, y = (name or next(free) for name in asked)
    if x == y:
        raise ResultsError(f"{x} is on both axes of the map; choose two swept keys")
    if missing := {x, y} - set(keys):
        raise ResultsError(f"{missing.pop()} has only one value; an axis of a map needs several")
    return x, y


Log = Sequence[Literal["x", "y", "z"]] | None


def _draw_dots(axes: Axes, values: DataArray, x: str, y: str, drawn: Quantity, log: Log) -> None:
    """Draw a dot for each case of a list; one that failed is an open circle."""
    across, up = (
        Scale.of(
            values[name].to_numpy().tolist(), quantity(values[name]), log=_asked(log, axis), measured=True
        )
        for name, axis in ((x, "x"), (y, "y"))
    )
    lost = np.isnan(values.to_numpy())
    dots = axes.scatter(
        across.positions[~lost],
        up.positions[~lost],
        c=values.to_numpy()[~lost],
        cmap="viridis",
        norm=_norm(values.to_numpy(), drawn, _asked(log, "z")),
        s=18,
    )
    axes.scatter(across.positions[lost], up.positions[lost], s=18, facecolors="none", edgecolors="0.6")
    _draw_bar(axes, dots, drawn)
    across.apply(axes, "x")
    up.apply(axes, "y")


def _asked(log: Log, axis: str) -> bool | None:
    """Whether an axis must be logarithmic, must not, or may be either."""
    return None if log is None else axis in log


def _draw_bar(axes: Axes, drawn_in: ScalarMappable, drawn: Quantity) -> int:
    """Draw the colour bar of a quantity beside a panel; return the power of ten of its numbers."""
    axis = axes.figure.colorbar(drawn_in, ax=axes).ax.yaxis
    name_axes(axis.axes, y=drawn)
    is_fitted = isinstance(axis.get_major_formatter(), Ticks)
    return drawn.fit(axis.get_view_interval()).power if is_fitted else 0


def fit_map_figure(fits: Dataset, style: Style = PAPER, z: Sequence[str] = ()) -> Figure:
    """Draw fitted parameters, all or those in `z`, with their errors: over the sample, or over its curves."""
    fitted = str(fits.attrs["fitted"]).split()
    if unknown := [name for name in z if name not in fitted]:
        raise ResultsError(f"{unknown[0]} was not fitted; must be one of {', '.join(fitted)}")
    names = list(z) or fitted
    on_grid = fits[names[0]].ndim == 2
    with styled(style):
        figure = new_figure(2, (55.0 if on_grid else 38.0) * len(names), style)
        panels = figure.subplots(len(names), 2 if on_grid else 1, squeeze=False)
        for i, (row, name) in enumerate(zip(panels, names, strict=True)):
            if on_grid:
                draw_quantity(row[0], fits[name].transpose("x", "y"), _fitted(fits[name]))
                error = _fitted(fits[name])._replace(symbol=f"error of {name}")
                draw_quantity(row[1], fits[f"{name}_error"].transpose("x", "y"), error)
                row[1].set_ylabel("")
            else:
                _draw_intervals(row[0], fits, name)
            for k, axes in enumerate(row):
                axes.set_title(f"({chr(ord('a') + (len(row) * i + k) % 26)})", loc="left")
        if failed := str(fits.attrs["failed"]).splitlines():
            finish(figure, [f"{len(failed)} of {fits[names[0]].size} curves failed"])
    return figure


def _draw_intervals(axes: Axes, fits: Dataset, name: str) -> None:
    """Draw a parameter and its 95 % interval over the number of the curve."""
    value = fits[name].to_numpy()
    ends = np.stack([value - fits[f"{name}_low"].to_numpy(), fits[f"{name}_high"].to_numpy() - value])
    axes.errorbar(fits["curve"].to_numpy(), value, np.maximum(ends, 0.0), fmt=".", ms=3, lw=0.6, color="0.2")
    name_axes(axes, Quantity("curve"), _fitted(fits[name]))


def _fitted(parameter: DataArray) -> Quantity:
    """Return how a fitted parameter is drawn: by its key."""
    return quantity(parameter)._replace(symbol=str(parameter.name))


def draw_quantity(axes: Axes, values: DataArray, drawn: Quantity, log: Log = None) -> None:
    """Draw values along two swept keys, the first along x, and a colour bar beside the panel.

    Numbers stand where they are on a linear or a logarithmic axis; the cell of each reaches half the way to
    its neighbours. Cases without a value are hatched.
    """
    scales = []
    for name, axis in zip(values.dims, ("x", "y"), strict=True):
        known = values[name].to_numpy().tolist()
        along = quantity(values[name])
        along = along.fit(known) if along.unit and values[name].dtype.kind in "if" else along
        values = values.isel({name: sorted(range(len(known)), key=known.__getitem__)})
        scales.append(Scale.of(sorted(known), along, log=_asked(log, axis), measured=len(known) > 1))
    cells, edges = values.to_numpy().T, [_edges(scale) for scale in scales]
    axes.patch.set(facecolor="white", hatch="////", edgecolor="0.8")
    mesh = axes.pcolormesh(
        *edges, np.ma.masked_invalid(cells), cmap="viridis", norm=_norm(cells, drawn, _asked(log, "z"))
    )
    power = _draw_bar(axes, mesh, drawn)
    for scale, name, ends in zip(scales, ("x", "y"), edges, strict=True):
        scale.apply(axes, name)  # type: ignore[arg-type]
        axes.set(**{f"{name}lim": (ends[0], ends[-1])})
        if scale.kind == "order":
            axes.minorticks_off()
    axes.tick_params(which="both", top=False, right=False, direction="out")
    _write_numbers(axes, mesh, cells, power, scales, edges)


def _edges(scale: Scale) -> FloatArray:
    """Return the ends of the cells around values on an axis."""
    places = np.log(scale.positions) if scale.kind == "log" else scale.positions
    if places.size == 1:
        return np.asarray(places[0] + np.array([-0.5, 0.5]))
    middles = (places[1:] + places[:-1]) / 2
    ends = np.concatenate((2 * places[:1] - middles[:1], middles, 2 * places[-1:] - middles[-1:]))
    return np.asarray(np.exp(ends) if scale.kind == "log" else ends)


def _norm(values: FloatArray, drawn: Quantity, log: bool | None) -> Normalize:
    """Return a logarithmic scale of colours for values that are spread over decades, else a linear one."""
    finite: list[float] = values[np.isfinite(values)].tolist()
    if log and not any(value > 0 for value in finite):
        raise ResultsError(f"log z: {drawn.symbol} has no positive value; draw it without")
    if log:  # cells that are not positive are masked
        return LogNorm(min(value for value in finite if value > 0), max(finite))
    spread = finite and min(finite) > 0 and max(finite) > WIDE * min(finite)
    if log is None and spread and Scale.of(finite).kind == "log":
        return LogNorm(min(finite), max(finite))
    return Normalize(min(finite, default=0.0), max(finite, default=1.0))


def _write_numbers(
    axes: Axes,
    mesh: QuadMesh,
    cells: FloatArray,
    power: int,
    scales: Sequence[Scale],
    edges: Sequence[FloatArray],
) -> None:
    """Write the values into their cells where all have room, in the power of ten of the colour bar."""
    finite = {at: value for at, value in np.ndenumerate(cells) if np.isfinite(value)}
    texts = {at: f"{value / 10.0**power:#.3g}".rstrip(".") for at, value in finite.items()}
    longest = max(map(len, texts.values()), default=0)
    ends = [np.log(each) if scale.kind == "log" else each for scale, each in zip(scales, edges, strict=True)]
    across, up = (float(np.ptp(each) / np.diff(each).min()) for each in ends)  # of the narrowest cells
    if max(across, up) > MOST_NUMBERS + 0.5 or longest * across > MOST_LETTERS:
        return
    for (row, column), text in texts.items():
        colour = "black" if np.asarray(mesh.norm(cells[row, column])) > 0.5 else "white"
        place = scales[0].positions[column], scales[1].positions[row]
        axes.text(*place, text, ha="center", va="center", color=colour, fontsize="small")
