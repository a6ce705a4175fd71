r"""Curves of a run, a panel for each column, against time, another column or a swept key.

By default these are the panels of the paper, contact area $\tilde a$ (the interpolated one) and mean pressure
$\tilde p$ against $t/\tau$; of a punch under a prescribed load the depth in place of the mean pressure, of a
punch that moves along the surface also the friction. There is a curve for each case; `curve_family`
chooses their looks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gfmdlayer.figures.curve_family import Family, Scale, family
from gfmdlayer.figures.labels import PAPER_SYMBOLS, explained, finish, name_axes, quantity
from gfmdlayer.figures.plot_style import (
    PAPER,
    Columns,
    Style,
    legend_above,
    legend_entries,
    new_figure,
    spread,
    styled,
)
from gfmdlayer.figures.selection import (
    Time,
    at_time,
    case_dimensions,
    column_name,
    default_columns,
    each_place,
    notes,
    rows,
    swept,
    varying,
    with_values,
)
from gfmdlayer.figures.snapshots import Inset
from gfmdlayer.observables import SPARSE
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import case_path, is_complete, open_case

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset


LABELLED = 40  # most entries of a legend
BESIDE, LETTERS = 12, 40  # most entries of a legend beside the panels, and letters of each; more are above
ROW_MM = 4.5  # of a legend
OVER_FRAME = 2.6  # order of drawing: a fall at the last time is not hidden by the frame
REDUCED = "reduced_velocity"
MOST_DURATIONS = 30.0  # longest over shortest case, on a linear axis of time
MOST_HALVES = 15.0  # end over the time of the middle row, likewise; as in report/curves.js


def curves_figure(
    dataset: Dataset,
    columns: Columns = 2,
    *,
    style: Style = PAPER,
    log: Sequence[Literal["x", "y"]] | None = None,
    log_time: bool = False,
    inset: Inset | None = None,
    x: str = "time",
    y: Sequence[str] = (),
    time: Time | None = None,
) -> Figure:
    """Draw columns of results, a panel for each, against time, another column, or a swept key.

    Parameters
    ----------
    dataset : xarray.Dataset
        A case, or a sweep, as `gfmdlayer.run`, `open_case` and `open_results` return them.
    columns : {1, 2}
        Width in columns of a journal; in one column the panels are stacked.
    style : Style
        Sizes and fonts.
    log : sequence of {"x", "y"}, optional
        Logarithmic axes, on which positive values have a place. By default the axes are linear, except that
        of time where the durations of the cases differ more than thirtyfold, or half of the rows of each lie
        in its first fifteenth.
    log_time : bool
        The same as `log` of "x", over time.
    inset : Inset, optional
        Punch and surface at chosen times, in the first panel.
    x : str
        Time, a column, or a swept key; reduced_velocity, a swept velocity times the shift factor of the
        temperature, over which the friction of a rubber is one curve.
    y : sequence of str
        Columns; by default interpolated contact area and mean pressure, or depth under a prescribed load,
        friction and temperature, without those that do not vary.
    time : float or {"end", "max", "min"}, optional
        Against a swept key: a time in the units of the configuration, or the extremes over time; by default
        the end.

    Returns
    -------
    matplotlib.figure.Figure
        The picture, which `savefig` writes.

    Raises
    ------
    ResultsError
        If there is no such column, or an option needs another `x`.
    """
    reduced = x == REDUCED
    x = _swept_velocity(dataset) if reduced else x
    along = next((str(key.name) for key in swept(dataset) if x in (key.name, key.attrs["key"])), "")
    dataset, y = each_place(dataset, y)
    asked = [column_name(dataset, name, of_cases=bool(along)) for name in y]
    names, empty = with_values(dataset, asked, default_columns(dataset))
    if not asked:
        names, constant = varying(dataset, names)
        empty += constant
    x = along or column_name(dataset, x)
    for given, needed, name in ((log_time or inset, "time", "log_time or inset"), (time, along, "time")):
        if given and x != needed:
            meant = "time" if needed == "time" else "a swept key"
            raise ResultsError(f"{name} needs {meant} on the x axis, not {x}")
    with styled(style):
        drawn = family(dataset, along if along in case_dimensions(dataset) else "")
        across = len(names) if len(names) <= 3 else 2 + (len(names) % 2)
        shape = (-(-len(names) // across), across) if columns == 2 else (len(names), 1)
        figure = new_figure(
            columns, (66.0 if columns == 2 else 62.5) * shape[0] * (1.25 if len(names) == 1 else 1.0), style
        )
        panels = figure.subplots(*shape, sharex=columns == 1, squeeze=False)
        if log is None:
            log = ["x"] * (x == "time" and inset is None and _spans_decades(drawn.sweep))
        for axes in panels.flat[len(names) :]:
            axes.remove()
        said_of_panels: list[str] = []
        for i, (axes, name) in enumerate(zip(panels.flat, names, strict=False)):
            if along:
                said_of_panels += _draw_against_key(axes, drawn, x, name, time, log, reduced=reduced)
            else:
                said_of_panels += _draw_against_column(axes, drawn, x, name, [*log, *["x"] * log_time])
            if len(names) > 1:
                axes.set_title(f"({'abcdefghijklmnopqrstuvwxyz'[i % 26]})", loc="left")
            if columns == 1 and i < len(names) - 1:
                axes.set_xlabel("")
            if inset is not None:
                inset.mark(axes, drawn.sweep[name])
        more = _draw_legend(figure, drawn, columns, style)
        within = inset.draw(panels[0, 0]) if inset is not None else []
        places = [f"{name}: {place}" for name in names if (place := drawn.sweep[name].attrs.get("place"))]
        said = [*places, *notes(drawn.sweep, names), *drawn.notes, *more, *empty]
        symbols = explained(drawn.sweep, [*names, x], [*drawn.written, *said])
        finish(figure, [*dict.fromkeys([*said_of_panels, *symbols, *within]), *said])
    return figure


def _spans_decades(sweep: Dataset) -> bool:
    """Whether curves, or most of each, would be upright lines at the beginning of a linear axis of time."""
    times, along = sweep["time"].load(), rows(sweep)
    ends = times.max(along)
    differ = bool(ends.max() > MOST_DURATIONS * ends.where(ends > 0).min())
    return differ or bool((times.median(along) * MOST_HALVES < ends).all())


def _draw_against_column(axes: Axes, drawn: Family, x: str, y: str, log: Sequence[str]) -> list[str]:
    """Draw a column of each case against time or another column."""
    sweep = drawn.sweep
    along, up = (quantity(sweep[name], sweep.attrs) for name in (x, y))
    ends: list[float] = []
    for curve in drawn.curves:
        # Where each case has its own times, they are NaN behind its last row.
        clock, across, values = (
            sweep[name].isel(curve.place, missing_dims="ignore").to_numpy() for name in ("time", x, y)
        )
        shown = np.isfinite(clock) & ((across > 0) if "x" in log else True)
        if {y, y.rpartition("_")[0]} & SPARSE:  # interface_peel_0 as interface_peel
            shown &= np.isfinite(values)
        across = across[shown] / along.scale
        look: dict[str, Any] = {"color": curve.colour, "linestyle": curve.dashes, "zorder": OVER_FRAME}
        if across.size == 1:
            look["marker"] = "o"
        axes.plot(across, values[shown] / up.scale, **look)
        ends += [*across[:1], *across[-1:]]
    if x == "time" and len({*ends}) > 1:
        axes.set_xlim(min(ends), max(ends))
    left_out = _scale_axes(axes, {"x": x, "y": y}, log)
    name_axes(axes, along, up)
    return left_out


def _scale_axes(axes: Axes, names: Mapping[str, str], log: Sequence[str]) -> list[str]:
    """Set the scales of the axes; say which values a logarithmic one has no place for."""
    said = []
    if "y" not in log and axes.dataLim.y0 >= 0:
        axes.set_ylim(0, 1.05 * axes.dataLim.y1 or 1.0)  # of a constant, matplotlib leaves no room
    for axis in set(log):
        values = np.concatenate([np.asarray(getattr(line, f"get_{axis}data")()) for line in axes.lines])
        if not (values > 0).any():
            raise ResultsError(f"log {axis}: {names[axis]} has no positive value; draw it without")
        # Else a curve falls upright from its last positive point, as if it ended there.
        getattr(axes, f"set_{axis}scale")("log", nonpositive="mask")
        if (values <= 0).any():
            said.append(f"values of {names[axis].replace('_', ' ')} that are not positive are left out")
    return said


def _draw_against_key(
    axes: Axes,
    drawn: Family,
    x: str,
    y: str,
    time: Time | None,
    log: Sequence[str],
    *,
    reduced: bool = False,
) -> list[str]:
    """Draw a column at a time against a swept key, a failed case being a gap in the line; say the time.

    A velocity may be `reduced` by the shift factor of each case.
    """
    key, up = drawn.sweep[x], quantity(drawn.sweep[y], drawn.sweep.attrs)
    if reduced:
        return _draw_reduced(axes, drawn, key, y, time)
    scale = Scale.of(key.to_numpy().tolist(), quantity(key), log="x" in log or None, measured=True)
    order = np.argsort(scale.positions, kind="stable")
    row, when = at_time(drawn.sweep, y, time)
    if key.dims == ("case",):
        if len({*scale.positions.tolist()}) == key.size and _is_one_curve(drawn.sweep, order):
            axes.plot(scale.positions[order], row.to_numpy()[order] / up.scale, color="0.7", zorder=1)
        axes.scatter(scale.positions, row / up.scale, s=12, color=[curve.colour for curve in drawn.curves])
    else:
        for curve in drawn.curves:
            values = row.isel(curve.place).to_numpy()[order] / up.scale
            look: dict[str, Any] = {"color": curve.colour, "linestyle": curve.dashes, "marker": "o"}
            axes.plot(scale.positions[order], values, markersize=3, **look)
    scale.apply(axes, "x")
    left_out = _scale_axes(axes, {"y": y}, [each for each in log if each == "y"])
    name_axes(axes, y=up)
    return [when, *left_out] if when else left_out


def _swept_velocity(dataset: Dataset) -> str:
    """Return the name of the swept velocity, by which that of a master curve is reduced."""
    name = next((str(key.name) for key in swept(dataset) if key.attrs["key"] == "trajectory.velocity"), "")
    if not name or "shift_factor" not in dataset:
        needed = "a sweep over trajectory.velocity, and a temperature with one shift of the material"
        raise ResultsError(f"{REDUCED}: these results have no such velocity; must have {needed}")
    return name


def _draw_reduced(axes: Axes, drawn: Family, key: DataArray, y: str, time: Time | None) -> list[str]:
    """Draw a column over the velocity times the shift factor of each case, on a logarithmic axis."""
    row, when = at_time(drawn.sweep, y, time)
    abscissa = key * at_time(drawn.sweep, "shift_factor", time)[0]
    up, over = quantity(drawn.sweep[y], drawn.sweep.attrs), quantity(key)
    for curve in drawn.curves:
        at, values = (each.isel(curve.place).to_numpy().ravel() for each in (abscissa, row))
        order = np.argsort(at)
        look: dict[str, Any] = {"color": curve.colour, "linestyle": curve.dashes, "marker": "o"}
        axes.plot(at[order], values[order] / up.scale, markersize=3, **look)
    axes.set(xscale="log")
    left_out = _scale_axes(axes, {"y": y}, [])
    name_axes(axes, over._replace(symbol=rf"{over.symbol}$\,a_T$", words="reduced velocity"), up)
    return ["$a_T$: shift factor", *([when] if when else []), *left_out]


def _is_one_curve(sweep: Dataset, order: Any) -> bool:
    """Whether all swept numbers rise or fall along the cases in this order, as zipped keys do."""
    keys = [key.to_numpy()[order] for key in swept(sweep) if key.dims == ("case",) and key.dtype.kind in "if"]
    return all((np.diff(key) >= 0).all() or (np.diff(key) <= 0).all() for key in keys)


def _draw_legend(figure: Figure, drawn: Family, columns: Columns, style: Style) -> list[str]:
    """Draw legend and colour bar; return a note on entries for which there is no room."""
    if drawn.bar is not None:
        drawn.bar.draw(figure, figure.axes)  # without the panels that were removed
    kept = spread(len(drawn.legend), LABELLED)
    entries = legend_entries([drawn.legend[i] for i in kept])
    letters = max((len(str(entry.get_label())) for entry in entries), default=0)
    if entries and columns == 2 and len(entries) <= BESIDE and letters <= LETTERS:
        figure.legend(handles=entries, loc="outside right center")
    elif entries:
        rows = legend_above(figure, entries)
        width, height = figure.get_size_inches()
        figure.set_size_inches(width, height + max(rows - 2, 0) * ROW_MM * style.scale / 25.4)
    return [f"{len(kept)} of {len(drawn.legend)} curves labelled"] * (len(kept) < len(drawn.legend))


_NOTHING = 2e-3  # part of the largest value that cannot be seen
_MARGIN = 0.05
_TANGENTIAL = ("tangential_force", "interface_friction", "friction")
_SEPARATIONS = ("work_of_separation", "total_work_of_separation")  # per area, and of an isolated contact
_AREAS = {
    "loop_area": r"work per area of the cell, by the mean pressure $\bar{p}$",
    "loop_work": "work of the punch",
    "tangential_work": r"work per area of the cell, by the mean tangential stress $\bar{t}$",
    "tangential_loop_work": "work of the tangential force",
    "work_of_separation": "work of separation per area",
    "total_work_of_separation": "work of separation",
}


def loop_figure(path: Path | None, dataset: Dataset, style: Style = PAPER, y: str = "force") -> Figure:
    """Draw a column against depth for each case, with areas in the legend or, of one case, above the panel.

    Tangential forces and friction are drawn over the displacement along the surface. The cases come from
    their own files: a sweep file may hold only the times of `output.times`. The area is the work of the punch
    at the end; the part below zero in retraction is the work of separation.
    """
    with styled(style):
        drawn, legend, is_sweep = family(dataset), [], "case" in dataset.coords
        shown: dict[str, str] = {}
        # Over two keys, colours and line styles have entries of their own: no entry belongs to one curve.
        own = [look for _, *look in drawn.legend] == [[curve.colour, curve.dashes] for curve in drawn.curves]
        titles = [title for title, *_ in drawn.legend] if own else []
        figure = new_figure(1, 66.0 + ROW_MM * len(titles), style)
        axes = figure.subplots()
        for i, curve in enumerate(drawn.curves):
            if is_sweep:
                if path is None:
                    raise ResultsError("a loop of a sweep is drawn from its results folder; run it with out=")
                file = case_path(path, int(drawn.sweep["case"].isel(curve.place)))
                if not is_complete(file):
                    continue
            with closing(open_case(file)) if is_sweep else nullcontext(drawn.sweep) as case:
                areas = _draw(axes, case, y, curve.colour, curve.dashes, alone=len(drawn.curves) == 1)
            if titles:  # a sweep keeps the work that it compares
                areas = {name: text for name, text in areas.items() if name not in ("loop_area", "loop_work")}
                legend.append((", ".join([titles[i], *areas.values()]), curve.colour, curve.dashes))
            elif len(drawn.curves) == 1:
                axes.set_title("\n".join(areas.values()), loc="left")
            else:
                areas = {}
            shown |= areas
        if not axes.lines:
            raise ResultsError(f"{path}: no case is complete")
        _zoom(axes)
        axes.axhline(0.0, color="0.6", linewidth=0.5, zorder=0)
        if entries := legend_entries(legend or drawn.legend):
            legend_above(figure, entries)
        if drawn.bar is not None:
            drawn.bar.draw(figure, axes)
        way = "tangential_displacement" if y in _TANGENTIAL else "depth"
        said = [*notes(drawn.sweep), *drawn.notes]
        works = [f"${PAPER_SYMBOLS[name]}$: {_AREAS[name]}" for name in shown]
        symbols = explained(drawn.sweep, [y, way], [*drawn.written, *said])
        finish(figure, [*symbols, *works, *said])
    return figure


def _zoom(axes: Axes) -> None:
    """Leave out the depths at which the punch is away, where no curve is off zero."""
    curves = [line.get_data() for line in axes.lines]
    least = _NOTHING * max(float(np.abs(y).max(initial=0.0)) for _, y in curves)
    off = [np.convolve(np.abs(y) > least, [1, 1, 1])[1:-1] > 0 for _, y in curves]  # and the points beside
    acts = np.concatenate([np.asarray(x)[each] for (x, _), each in zip(curves, off, strict=True)])
    if acts.size and (room := _MARGIN * np.ptp(acts)) > 0:
        axes.set_xlim(acts.min() - room, acts.max() + room)


def _draw(axes: Axes, case: Dataset, y: str, colour: str, dashes: object, *, alone: bool) -> dict[str, str]:
    """Draw one case; return its areas in words, by their names."""
    from scipy.integrate import trapezoid

    y = column_name(case, y)
    sheared = y in _TANGENTIAL
    if sheared and "tangential_displacement" not in case:
        raise ResultsError(f"{y}: has a loop only with friction at the interface")
    way = "tangential_displacement" if sheared else "depth"
    along, up = quantity(case[way], case.attrs), quantity(case[y], case.attrs)
    depth, values = case[way].to_numpy(), case[y].to_numpy()
    axes.plot(depth / along.scale, values / up.scale, color=colour, linestyle=dashes)
    if alone and not sheared:
        back = np.diff(depth) < 0
        back = np.append(False, back) | np.append(back, False)  # from the turning point on
        pulls = np.where(back, np.minimum(values, 0.0), np.nan)
        axes.fill_between(depth / along.scale, pulls / up.scale, 0.0, color=colour, alpha=0.15, linewidth=0)
    name_axes(axes, along, up)
    pressed = case["mean_stress" if "mean_stress" in case else "force"]  # the latter of an isolated contact
    if sheared:
        name = "tangential_work" if "mean_stress" in case else "tangential_loop_work"
        found = {name: float(trapezoid(case["tangential_force"].to_numpy(), depth))}
    else:
        area = float(trapezoid(pressed.to_numpy(), depth))
        found = {"loop_area" if "mean_stress" in case else "loop_work": area}
        found |= {name: float(case.attrs[name]) for name in _SEPARATIONS if name in case.attrs}
    written = {}
    for name, value in found.items():
        drawn = quantity(case["work"].isel(time=0).rename(name), case.attrs)
        written[name] = drawn.equals([float(f"{value / drawn.scale:.3g}")])[0]
    return written
