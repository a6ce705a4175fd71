"""Pictures of a folder of results, or of the file of one case."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from gfmdlayer.figures.curve_plots import curves_figure
from gfmdlayer.figures.inset import Inset
from gfmdlayer.figures.map_plots import map_figure
from gfmdlayer.figures.movie import default_suffix, write_movie
from gfmdlayer.figures.plot_style import STYLES, check_suffix, save
from gfmdlayer.figures.snapshot_plots import MOST_CASES, snapshots_figure
from gfmdlayer.figures.snapshot_selection import cases_with_snapshots
from gfmdlayer.figures.waterfall import waterfall_figure
from gfmdlayer.results.reader import open_case, open_results
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

Kind = Literal["curves", "snapshots", "waterfall", "map", "movie"]


def plot_results(
    path: str | Path,
    out: str | Path | None = None,
    *,
    kind: Kind | None = None,
    case: int | None = None,
    style: Literal["paper", "screen"] = "paper",
    log_time: bool = False,
    inset: Sequence[float] = (),
    time: float | None = None,
) -> list[Path]:
    """Draw results.

    Parameters
    ----------
    path : str or Path
        The folder of results, or the file of one case.
    out : str or Path, optional
        The picture, .png, .pdf or .svg (a movie: .mp4, which needs ffmpeg, or .gif). By default it is named
        after the results and lies with them.
    kind : str, optional
        curves: contact area, mean pressure and any friction against time. snapshots: the surface at the
        snapshot times. waterfall: pressure profiles through time. map: contact area and mean pressure over
        two swept keys. movie: displacement and pressure. By default the curves and, as NAME-snapshots, the
        snapshots if there are any.
    case : int, optional
        Number of the case whose snapshots are drawn; by default all of a few, or the first.
    style : str
        paper, for the columns of a journal, or screen, for a talk.
    log_time : bool
        Whether the curves' time axis is logarithmic.
    inset : sequence of float
        Times of snapshots, in the units of the config, at which the curves' inset shows punch and surface.
    time : float, optional
        Time of the map, in the units of the config; by default the last row.

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
    with ExitStack() as stack:
        dataset = stack.enter_context(open_case(path) if path.is_file() else open_results(path))
        cases: dict[str, Dataset] = {}
        if inset or kind not in ("curves", "map"):
            most = MOST_CASES if kind in (None, "snapshots") else 1
            cases = stack.enter_context(cases_with_snapshots(path, dataset, case, most))
            if not cases and (inset or kind is not None):
                raise ResultsError(f"{path}: no snapshots; set output.snapshots and run the config again")
        title, first = next(iter(cases.items()), ("", dataset))
        if kind == "movie":
            picture = _beside(path, dataset, kind, default_suffix()) if out is None else Path(out)
            write_movie(first, picture, title, look)
            return [picture]
        picture = _beside(path, dataset, kind or "curves", ".png") if out is None else Path(out)
        check_suffix(picture)
        marked = Inset.of(first, inset) if inset else None
        draw: dict[Kind, Callable[[], Figure]] = {
            "curves": lambda: curves_figure(dataset, style=look, log_time=log_time, inset=marked),
            "snapshots": lambda: snapshots_figure(cases, look),
            "waterfall": lambda: waterfall_figure(first, title, look),
            "map": lambda: map_figure(dataset, time, look),
        }
        pictures = {picture: draw[kind or "curves"]}
        if kind is None and cases:
            pictures[picture.with_stem(f"{picture.stem}-snapshots")] = draw["snapshots"]
        for picture, figure in pictures.items():
            save(figure(), picture, look)
        return list(pictures)


def _beside(path: Path, dataset: Dataset, kind: Kind, suffix: str) -> Path:
    """Return the path of a picture that lies with the results and is named after them."""
    ending = suffix if kind in ("curves", "movie") else f"-{kind}{suffix}"
    if path.is_file():
        return path.with_name(path.stem + ending)
    return path / f"{dataset.attrs.get('name') or path.resolve().name}{ending}"
