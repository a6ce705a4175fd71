"""Pictures of a folder of results, or of the file of one case."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypedDict, Unpack

from gfmdlayer.figures.body_plot import body_figure, config_of
from gfmdlayer.figures.curve_plots import curves_figure, loop_figure
from gfmdlayer.figures.inside_plot import inside_figure
from gfmdlayer.figures.interface_plots import stick_figure
from gfmdlayer.figures.map_plots import fit_map_figure, map_figure
from gfmdlayer.figures.movie import default_suffix, write_movie
from gfmdlayer.figures.plot_style import STYLES, check_suffix, save
from gfmdlayer.figures.selection import Time, Wanted, notes, select
from gfmdlayer.figures.snapshot_plots import (
    MOST_CASES,
    Inset,
    at_times,
    cases_with_snapshots,
    snapshots_figure,
    waterfall_figure,
)
from gfmdlayer.results.reader import open_case, open_results
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

Kind = Literal["curves", "loop", "snapshots", "stick", "inside", "waterfall", "map", "movie", "body"]


class Options(TypedDict, total=False):
    """What is drawn, and how. Times are in the units of the config."""

    # curves: columns against time. loop: force against depth. snapshots: the surface at the snapshot times.
    # stick: where the surfaces stick and slip. waterfall: pressure profiles through time. map: columns over
    # two swept keys. movie: displacement and pressure. body: the layers and their moduli, also of a
    # configuration that has not been run. By default the curves and, as NAME-snapshots, the snapshots if
    # there are any; with x or y only the curves.
    kind: Kind | None
    select: Mapping[str, Wanted]  # swept key -> value of the cases, of which the nearest is taken, or a range
    x: str  # of curves: time, a column, or a swept key; of a map: a swept key
    # Of curves: columns, each with a panel; by default contact area and mean pressure, or depth under a
    # prescribed load, and any friction. Of a loop: a column, by default the force. Of a map: a swept key.
    y: Sequence[str]
    z: Sequence[str]  # columns of a map; of inside a field, by default von_mises
    time: Time | None  # of a map, or of curves against a swept key; end (the default), max or min over time
    case: int | None  # whose snapshots are drawn; by default all of a few, some, or the first
    inset: Sequence[float]  # times of snapshots at which the curves' inset shows punch and surface
    times: Sequence[float]  # of snapshots, waterfall and movie: all of these, and no others
    log: Sequence[Literal["x", "y"]] | None  # logarithmic axes of the curves
    log_time: bool  # as log x, over time
    fps: int | None  # frames of a movie in a second
    style: Literal["paper", "screen"]  # for the columns of a journal, or for a talk


def plot_results(path: str | Path, out: str | Path | None = None, **options: Unpack[Options]) -> list[Path]:
    """Draw results and write the pictures, as `gfmdlayer plot` does.

    Parameters
    ----------
    path : path
        A results folder, or the file of one case.
    out : path, optional
        A .png, .pdf or .svg (a movie: .mp4, which needs ffmpeg, or .gif). By default it is named after the
        results and lies with them.
    **options
        Those of the command: `kind`, `select`, `x`, `y`, `z`, `time` and others, see `Options`.

    Returns
    -------
    list of Path
        The pictures.

    Raises
    ------
    ResultsError
        If there are no results, or none of this kind, or the picture cannot be written.
    """
    if unknown := options.keys() - Options.__annotations__.keys():
        raise TypeError(f"plot_results has no options {', '.join(sorted(unknown))}")
    path, look = Path(path), STYLES[options.get("style", "paper")]
    kind: Kind | None = options.get("kind") or ("curves" if options.get("x") or options.get("y") else None)
    if kind == "body":
        picture = path.with_name(f"{path.stem}-body.png") if path.is_file() else path / "body.png"
        picture = picture if out is None else Path(out)
        check_suffix(picture)
        save(body_figure(config_of(path, options.get("case")), look), picture, look)
        return [picture]
    with ExitStack() as stack:
        opened = stack.enter_context(open_case(path) if path.is_file() else open_results(path))
        if "fitted" in opened.attrs:
            if kind not in (None, "map"):
                raise ResultsError(f"{path}: is a map of fits; use --kind map")
            kind = "map"
        dataset = select(opened, options.get("select", {}))
        cases, said = _cases(stack, path, dataset, kind, options)
        title, first = next(iter(cases.items()), ("", dataset))
        asked = bool(options.get("times"))
        if kind == "movie":
            picture = _beside(path, dataset, kind, default_suffix(), options) if out is None else Path(out)
            write_movie(first, picture, title, look, options.get("fps"))
            return [picture]
        picture = _beside(path, dataset, kind or "curves", ".png", options) if out is None else Path(out)
        check_suffix(picture)
        draw: dict[Kind, Callable[[], Figure]] = {
            "curves": lambda: _curves(dataset, first, options),
            "loop": lambda: loop_figure(path, dataset, look, _one(options.get("y", ()), "a loop") or "force"),
            "snapshots": lambda: snapshots_figure(cases, look, said, every=asked),
            "stick": lambda: stick_figure(first, title, look, said, every=asked),
            "inside": lambda: inside_figure(
                first, _one(options.get("z", ()), "a section"), title, look, said, every=asked
            ),
            "waterfall": lambda: waterfall_figure(first, title, look, said, every=asked),
            "map": lambda: _map(dataset, options),
        }
        pictures = {picture: draw[kind or "curves"]}
        if kind is None and cases:
            pictures[picture.with_stem(f"{picture.stem}-snapshots")] = draw["snapshots"]
        for picture, figure in pictures.items():
            save(figure(), picture, look)
        return list(pictures)


def _cases(
    stack: ExitStack, path: Path, dataset: Dataset, kind: Kind | None, options: Options
) -> tuple[dict[str, Dataset], list[str]]:
    """Open the cases whose snapshots are drawn; say how many of the sweep they are."""
    inset = options.get("inset", ())
    if not inset and kind in ("curves", "loop", "map"):
        return {}, []
    most = MOST_CASES if kind in (None, "snapshots") else 1
    cases = stack.enter_context(cases_with_snapshots(path, dataset, options.get("case"), most))
    if not cases and (inset or kind is not None):
        raise ResultsError(f"{path}: no snapshots; set output.snapshots and run the config again")
    among = dataset["case"].size if "case" in dataset.coords else 1
    if times := options.get("times", ()):
        cases = {title: at_times(case, sorted(set(times))) for title, case in cases.items()}
    part = [f"{len(cases)} of {among} cases"] * (len(cases) < among)
    return cases, [*notes(dataset), *part]


def _curves(dataset: Dataset, first: Dataset, options: Options) -> Figure:
    inset = options.get("inset", ())
    return curves_figure(
        dataset,
        style=STYLES[options.get("style", "paper")],
        log=options.get("log"),
        log_time=options.get("log_time", False),
        inset=Inset.of(first, inset) if inset else None,
        x=options.get("x") or "time",
        y=options.get("y", ()),
        time=options.get("time"),
    )


def _map(dataset: Dataset, options: Options) -> Figure:
    y = _one(options.get("y", ()), "a map")
    look = STYLES[options.get("style", "paper")]
    if "fitted" in dataset.attrs:
        return fit_map_figure(dataset, look, options.get("z", ()))
    return map_figure(dataset, options.get("time"), look, x=options.get("x", ""), y=y, z=options.get("z", ()))


def _one(names: Sequence[str], figure: str) -> str:
    """Return the only name of some, or nothing."""
    if len(names) > 1:
        raise ResultsError(f"{figure} has one quantity along y, not {len(names)}")
    return "".join(names)


def _beside(path: Path, dataset: Dataset, kind: Kind, suffix: str, options: Options) -> Path:
    """Return the path of a picture beside the results, named after them and its contents."""
    columns = [*options.get("y", ()), *(["over", options["x"]] if options.get("x") else [])]
    ending = suffix if kind == "movie" else f"-{kind}{suffix}"
    if kind == "curves":
        ending = "".join(f"-{name}" for name in columns) + suffix
    if path.is_file():
        return path.with_name(path.stem + ending)
    return path / f"{dataset.attrs.get('name') or path.resolve().name}{ending}"
