"""Pictures of a folder of results, or of the file of one case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

from gfmdlayer.figures import selection
from gfmdlayer.figures.body_plot import body_figure, config_of
from gfmdlayer.figures.convergence_plot import convergence_figure
from gfmdlayer.figures.curve_plots import curves_figure, loop_figure
from gfmdlayer.figures.field_plots import inside_figure, stick_figure
from gfmdlayer.figures.labels import Labels, labelled
from gfmdlayer.figures.map_plots import fit_map_figure, map_figure
from gfmdlayer.figures.movies import default_suffix, write_movie
from gfmdlayer.figures.plot_style import PAPER, STYLES, Style, check_suffix, save
from gfmdlayer.figures.selection import Time, Wanted, notes
from gfmdlayer.figures.snapshots import (
    MOST_CASES,
    Inset,
    at_times,
    cases_with_snapshots,
    of_one_kind,
    snapshots_figure,
    waterfall_figure,
)
from gfmdlayer.files.whole import output_file
from gfmdlayer.results.convergence import open_convergence
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import only_estimates, open_case, open_results

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

MOST_PAGES = 20  # of snapshots

Kind = Literal[
    "curves", "loop", "snapshots", "stick", "inside", "waterfall", "map", "movie", "body", "convergence"
]  # fmt: skip


def plot_results(
    path: str | Path,
    out: str | Path | None = None,
    *,
    kind: Kind | None = None,
    select: Mapping[str, Wanted] = MappingProxyType({}),
    case: int | None = None,
    x: str = "",
    y: Sequence[str] = (),
    z: Sequence[str] = (),
    time: Time | None = None,
    times: Sequence[float] = (),
    inset: Sequence[float] = (),
    log: Sequence[Literal["x", "y", "z"]] | None = None,
    log_time: bool = False,
    fps: int | None = None,
    style: Literal["paper", "screen"] = "paper",
    labels: Labels = "words",
    trust: bool = False,
) -> list[Path]:
    """Draw results and write the pictures, as `gfmdlayer plot` does.

    Parameters
    ----------
    path : path
        A results folder, or the file of one case; of the body also a configuration.
    out : path, optional
        A .png, .pdf or .svg (a movie: .mp4, which needs ffmpeg, or .gif). By default it is named after the
        results and lies with them.
    kind : str, optional
        curves: columns against time; loop: force against depth; snapshots: the surface at the snapshot times,
        of more than six cases on further pages, NAME-snapshots-2 and so on;
        stick: where the surfaces stick and slip; inside: stresses below the surface; waterfall: pressure
        profiles through time; map: columns over two swept keys; movie: displacement and pressure; body: the
        layers and their moduli; convergence: the errors that `gfmdlayer.converge` estimated. By default the
        curves and, as NAME-snapshots, the snapshots if there are any; with x or y only the curves; of a
        folder with nothing but such estimates, these.
    select : mapping
        Swept key -> value of the cases, of which the nearest is taken, or a range.
    case : int, optional
        The case whose snapshots are drawn; by default all of a few cases, some of many, or the first.
    x : str
        Of curves: time, a column, or a swept key; of a map: a swept key.
    y, z : sequence of str
        y, of curves: columns, each with a panel; of a loop: a column; of a map: a swept key. z: columns of a
        map; of inside a field.
    time : float or {"end", "max", "min"}, optional
        Of a map, or of curves against a swept key; by default the end.
    times, inset : sequence of float
        Times in the units of the configuration: of the only snapshots that are drawn, and of those in the
        inset of the curves.
    log : sequence of {"x", "y", "z"}, optional
        Logarithmic axes of the curves, or of a map, whose colours are z.
    log_time : bool
        The same as `log` of "x", over time.
    fps : int, optional
        Frames of a movie in a second.
    style : {"paper", "screen"}
        For the columns of a journal, or for a talk.
    labels : {"words", "symbols"}
        Axes and bars in words with the symbol behind, or by the symbol alone.
    trust : bool
        Of the body of results: run the Python code that they name; without it such a body is refused.

    Returns
    -------
    list of Path
        The pictures.

    Raises
    ------
    ResultsError
        If there are no results, or none of this kind, or the picture cannot be written.
    """
    path, look = Path(path), STYLES[style]
    if kind is None and only_estimates(path) and not (x or z or select or times or inset or case is not None):
        kind = "convergence"
    kind = kind or ("curves" if x or y else None)
    with ExitStack() as stack:
        stack.enter_context(labelled(labels))
        if kind == "body":
            picture = path.with_name(f"{path.stem}-body.png") if path.is_file() else path / "body.png"
            picture = output_file(out, picture)
            check_suffix(picture)
            config, title = config_of(path, case, trust=trust)
            save(body_figure(config, look, title), picture, look)
            return [picture]
        if kind == "convergence":
            picture = output_file(out, (path.parent if path.is_file() else path) / "convergence.png")
            check_suffix(picture)
            save(convergence_figure(open_convergence(path).data, look, y), picture, look)
            return [picture]
        opened = stack.enter_context(open_case(path) if path.is_file() else open_results(path))
        if "fitted" in opened.attrs:
            if kind not in (None, "map"):
                raise ResultsError(f"{path}: is a map of fits; use --kind map")
            kind = "map"
        selection.must_be_complete(path, opened)
        dataset = selection.select(opened, select)
        cases: dict[str, Dataset] = {}
        if inset or kind not in ("curves", "loop", "map"):
            most = MOST_CASES if kind is None else MOST_CASES * MOST_PAGES if kind == "snapshots" else 1
            cases = stack.enter_context(cases_with_snapshots(path, dataset, case, most))
            if not cases and (inset or kind is not None):
                raise ResultsError(f"{path}: no snapshots; set output.snapshots and run the config again")
            if times:
                cases = {title: at_times(each, sorted(set(times))) for title, each in cases.items()}
        cases, others = of_one_kind(cases)
        among = dataset["case"].size if "case" in dataset.coords else 1
        rest = others or "; --kind snapshots draws more" * (kind is None and len(cases) == MOST_CASES)
        said = [*notes(dataset), *[f"{len(cases)} of {among} cases{rest}"] * (len(cases) < among)]
        title, first = next(iter(cases.items()), ("", dataset))
        ending = "" if kind in (None, "movie") else f"-{kind}"
        if kind in (None, "curves"):
            ending = "".join(f"-{name}" for name in [*y, *(["over", x] if x else [])])
        ending += default_suffix() if kind == "movie" else ".png"
        name = dataset.attrs.get("name") or path.resolve().name
        beside = path.with_name(path.stem + ending) if path.is_file() else path / f"{name}{ending}"
        picture = output_file(out, beside)
        if kind == "movie":
            write_movie(first, picture, title, look, fps)
            return [picture]
        check_suffix(picture)
        draw = partial(
            figure_of, dataset, path=path, x=x, y=y, z=z, time=time, inset=inset, log=log,
            log_time=log_time, look=look, every=bool(times),
        )  # fmt: skip
        titles = list(cases)
        parts = [titles[i : i + MOST_CASES] for i in range(0, len(titles), MOST_CASES)] or [[]]
        pages = [{each: cases[each] for each in part} for part in parts]
        pictures: dict[Path, tuple[Kind, int]] = {picture: (kind or "curves", 0)}
        if kind is None and cases:
            pictures[picture.with_stem(f"{picture.stem}-snapshots")] = "snapshots", 0
        for further in range(1, len(pages)):
            pictures[picture.with_stem(f"{picture.stem}-{further + 1}")] = "snapshots", further
        for file, (each, at) in pictures.items():
            of_all = [f"page {at + 1} of {len(pages)}"] * (each == "snapshots" and len(pages) > 1)
            save(draw(pages[at], each, said=[*of_all, *said]), file, look)
        return list(pictures)


def figure_of(
    dataset: Dataset,
    cases: Mapping[str, Dataset],
    kind: Kind,
    *,
    path: Path | None = None,
    x: str = "",
    y: Sequence[str] = (),
    z: Sequence[str] = (),
    time: Time | None = None,
    inset: Sequence[float] = (),
    log: Sequence[Literal["x", "y", "z"]] | None = None,
    log_time: bool = False,
    look: Style = PAPER,
    said: Sequence[str] = (),
    every: bool = False,
) -> Figure:
    """Draw one kind of picture of results, and of their cases with snapshots; see `plot_results`."""
    title, first = next(iter(cases.items()), ("", dataset))
    about = (title, look, said)
    if kind == "curves":
        along = "time" if inset or log_time else selection.default_abscissa(dataset)
        return curves_figure(
            dataset, style=look, log=_of_curves(log), log_time=log_time, x=x or along, y=y, time=time,
            inset=Inset.of(first, inset) if inset else None,
        )  # fmt: skip
    if kind == "loop":
        return loop_figure(path, dataset, look, _one(y, "a loop") or "force")
    if kind == "map":
        if "fitted" in dataset.attrs:
            return fit_map_figure(dataset, look, z)
        return map_figure(dataset, time, look, x=x, y=_one(y, "a map"), z=z, log=log)
    if kind == "snapshots":
        return snapshots_figure(cases, look, said, every=every)
    if kind == "inside":
        return inside_figure(first, _one(z, "a section"), *about, every=every)
    draw = {"stick": stick_figure, "waterfall": waterfall_figure}[kind]
    return draw(first, *about, every=every)


def _of_curves(log: Sequence[Literal["x", "y", "z"]] | None) -> list[Literal["x", "y"]] | None:
    """Return the logarithmic axes of curves, which have no z."""
    if log and "z" in log:
        raise ResultsError("log z: only of a map")
    return None if log is None else [axis for axis in log if axis != "z"]


def _one(names: Sequence[str], figure: str) -> str:
    """Return the only name of some, or nothing."""
    if len(names) > 1:
        raise ResultsError(f"{figure} has one quantity along y, not {len(names)}")
    return "".join(names)
