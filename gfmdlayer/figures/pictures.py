"""`gfmdlayer.plot`: a picture of whatever this package returns."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, get_args

import xarray

from gfmdlayer.config import Config, ConfigError
from gfmdlayer.figures import selection
from gfmdlayer.figures.body_plot import body_figure, config_of
from gfmdlayer.figures.field_plots import flow_figure
from gfmdlayer.figures.labels import Labels, labelled
from gfmdlayer.figures.plot_style import STYLES, save
from gfmdlayer.figures.plots import Kind, figure_of
from gfmdlayer.figures.selection import Time, Wanted
from gfmdlayer.figures.snapshots import at_times
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import open_case, open_results
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import nearest, shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Prescribed quantities of `solve`, each with its symbol: they are drawn as the times of snapshots are.
_LOADS = {"depth": "delta", "mean_pressure": "p_mean", "force": "F"}
_OF_RESULTS = ("curves", "loop", "snapshots", "stick", "inside", "waterfall", "map")


@entry()
def plot(
    data: Any,
    kind: Kind | None = None,
    *,
    out: str | os.PathLike[str] | None = None,
    select: Mapping[str, Wanted] = MappingProxyType({}),
    x: str = "",
    y: str | Sequence[str] = (),
    z: str | Sequence[str] = (),
    time: Time | None = None,
    times: Sequence[float] = (),
    log: Sequence[Literal["x", "y", "z"]] | None = None,
    log_time: bool = False,
    style: Literal["paper", "screen"] = "paper",
    labels: Labels | None = None,
) -> Figure:
    """Draw results, a contact, a fit or a body.

    Parameters
    ----------
    data : xarray.Dataset, path, Body, Config, or a result of a fit or of `converge`
        Data of `run`, `solve`, `indent`, `leakage`, `open_case` or `open_results`, or those of a contact
        merged with those of `inside`; a results folder or the file of a case; a body or a configuration, of
        which the body is drawn.
    kind : str, optional
        Of results: curves (default), loop, snapshots, stick, inside, waterfall or map, as of
        `gfmdlayer plot`. Other data have one kind of picture.
    out : path, optional
        Also writes the picture to this file, .png, .pdf or .svg.
    select : mapping
        Swept key -> value of the cases, of which the nearest is taken, or a range.
    x, y, z : str, or sequence of str
        Of results: the abscissa, columns, and columns of a map or a field inside.
    time : float or {"end", "max", "min"}, optional
        Of a map, or of curves against a swept key; by default the end.
    times : sequence of float
        Times of the only snapshots that are drawn.
    log : sequence of {"x", "y", "z"}, optional
        Logarithmic axes of the curves, or of a map, whose colours are z.
    log_time : bool
        The same as `log` of "x", over time.
    style : {"paper", "screen"}
        For the columns of a journal, or for a talk.
    labels : {"words", "symbols"}, optional
        Axes and bars in words with the symbol behind (default), or by the symbol alone.

    Returns
    -------
    matplotlib.figure.Figure
        A notebook shows it.

    Raises
    ------
    ConfigError
        If an argument cannot be used, or there is no picture of such data.
    ResultsError
        If there are no results, or none of this kind, or the picture cannot be written.

    Examples
    --------
    >>> punch = gfmdlayer.Parabola(radius=0.25)
    >>> found = gfmdlayer.solve(gfmdlayer.halfspace(1.0), punch, depth=[0.005, 0.01])
    >>> figure = gfmdlayer.plot(found, out="contact.png")
    >>> [axes.get_xlabel() for axes in figure.axes]
    ['$x$', '$x$']
    """
    if style not in STYLES:
        raise ConfigError([f"style: got {shown(style)}; must be one of {', '.join(STYLES)}"])
    if labels is not None:
        if labels not in get_args(Labels):
            raise ConfigError([f"labels: got {shown(labels)}; must be one of {', '.join(get_args(Labels))}"])
        with labelled(labels):
            return plot(
                data, kind, out=out, select=select, x=x, y=y, z=z, time=time, times=times, log=log,
                log_time=log_time, style=style,
            )  # fmt: skip
    if kind is not None and kind not in _OF_RESULTS:
        allowed = f"must be one of {', '.join(_OF_RESULTS)}{nearest(str(kind), _OF_RESULTS)}"
        raise ConfigError([f"kind: got {shown(kind)}; {allowed}"])
    look, columns, fields = STYLES[style], _names(y), _names(z)
    if isinstance(data, Config | Mapping) and not isinstance(data, xarray.Dataset):
        figure = body_figure(data if isinstance(data, Config) else Config(**{"name": "body", **data}), look)
    elif isinstance(data, str | os.PathLike):
        path = Path(data)
        if path.suffix in {".yaml", ".yml"}:
            figure = body_figure(config_of(path, None)[0], look)
        else:
            with open_case(path) if path.is_file() else open_results(path) as opened:
                return plot(
                    opened.load(), kind, out=out, select=select, x=x, y=y, z=z, time=time, times=times,
                    log=log, log_time=log_time, style=style,
                )  # fmt: skip
    elif isinstance(data, xarray.Dataset):
        data, kind = _as_results(data, kind)
        if kind == "flow":
            figure = flow_figure(data, style=look)
        else:
            kind = kind or ("map" if "fitted" in data.attrs else "curves")
            chosen = selection.select(data, select)
            cases = {} if kind in ("curves", "loop", "map") else _cases(chosen, times, kind)
            figure = figure_of(
                chosen, cases, kind, x=x, y=columns, z=fields, time=time, log=log, log_time=log_time,
                look=look, said=selection.notes(chosen), every=bool(times),
            )  # fmt: skip
    elif hasattr(data, "spectrum"):
        figure = body_figure(Config(name="body", body=data), look)
    elif hasattr(data, "plot"):
        drawn: Figure = data.plot(out)
        return drawn
    else:
        allowed = (
            "must be data of run, solve or indent, a fit, a body, a results folder or the file of a case"
        )
        raise ConfigError([f"data: got {shown(data)}; {allowed}"])
    if out is not None:
        save(figure, Path(out), look)
    return figure


def _names(given: str | Sequence[str]) -> tuple[str, ...]:
    """Return names, of which one may be given alone."""
    return (given,) if isinstance(given, str) and given else tuple(given)


def _cases(data: xarray.Dataset, times: Sequence[float], kind: str) -> dict[str, xarray.Dataset]:
    """Return the cases with snapshots of data in memory; ResultsError where there are none."""
    if "case" in data.coords:
        raise ResultsError("snapshots of a sweep are drawn from its results folder; run it with out=")
    if not data.sizes.get("snapshot"):
        raise ResultsError(f"{kind}: there is no snapshot; set output.snapshots and run it again")
    return {"": at_times(data, sorted(set(times))) if times else data}


def _as_results(data: xarray.Dataset, kind: Any) -> tuple[xarray.Dataset, Any]:
    """Return data as those of a case, and the kind of picture where only one is possible."""
    if "fluid_pressure" in data:
        return data, "flow"
    if "time" in data.dims or "fitted" in data.attrs or "case" in data.coords:
        return data, kind
    if "stress_zz" in data and "pressure" not in data:
        remedy = "must have both: contact.merge(below) of `contact` and what `inside` gave for it, `below`"
        raise ConfigError([f"data: got stresses without the contact above them; {remedy}"])
    if "stress_zz" in data and "z" in data["stress_zz"].dims:
        whole = data if "snapshot" in data.dims else data.expand_dims(snapshot=[0.0])
        return whole, kind or "inside"
    if "pressure" not in data or "x" not in data["pressure"].dims:
        known = ", ".join(map(str, data))
        raise ConfigError(
            [f"data: got a dataset of {known}; must be one of run, solve, indent, leakage or inside"]
        )
    name = next((name for name in _LOADS if name in data.dims), "depth")
    if name not in data.dims:
        data = data.drop_vars(name).expand_dims({name: data[name].expand_dims(name)})
    about = {**data[name].attrs, "symbol": _LOADS[name]}
    data = data.rename({name: "snapshot"})
    return data.assign_coords(snapshot=("snapshot", data["snapshot"].to_numpy(), about)), kind or "snapshots"
