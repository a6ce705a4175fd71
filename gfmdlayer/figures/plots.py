"""Pictures of a folder of results, or of the file of one case."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from gfmdlayer.figures.curve_plots import curves_figure
from gfmdlayer.figures.inset import Inset
from gfmdlayer.figures.map_plots import map_figure
from gfmdlayer.figures.movie import default_suffix, write_movie
from gfmdlayer.figures.plot_style import STYLES, Style, check_suffix, save
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
    path = Path(path)
    with open_case(path) if path.is_file() else open_results(path) as dataset:
        results = _Results(path, dataset, case, STYLES[style])
        if kind == "movie":
            return [results.movie(None if out is None else Path(out))]
        picture = results.beside(kind or "curves", ".png") if out is None else Path(out)
        check_suffix(picture)
        draw: dict[str, Callable[[], Figure]] = {
            "curves": lambda: results.curves(log_time, inset),
            "snapshots": results.snapshots,
            "waterfall": results.waterfall,
            "map": lambda: map_figure(dataset, time, results.style),
        }
        pictures = {picture: draw[kind or "curves"]}
        if kind is None and results.have_snapshots():
            pictures[picture.with_stem(f"{picture.stem}-snapshots")] = draw["snapshots"]
        for written, figure in pictures.items():
            save(figure(), written, results.style)
        return list(pictures)


class _Results(NamedTuple):
    """Results to draw: their path, the opened dataset, the number of the case asked for, and the style."""

    path: Path
    dataset: Dataset
    case: int | None
    style: Style

    def beside(self, kind: Kind, suffix: str) -> Path:
        """Return the path of a picture with the results, named after them."""
        ending = suffix if kind in ("curves", "movie") else f"-{kind}{suffix}"
        if self.path.is_file():
            return self.path.with_name(self.path.stem + ending)
        return self.path / f"{self.dataset.attrs.get('name') or self.path.resolve().name}{ending}"

    def curves(self, log_time: bool, times: Sequence[float]) -> Figure:
        inset = None
        if times:
            with self._cases(1) as cases:
                inset = Inset.of(next(iter(cases.values())), times)
        return curves_figure(self.dataset, style=self.style, log_time=log_time, inset=inset)

    def have_snapshots(self) -> bool:
        with cases_with_snapshots(self.path, self.dataset, self.case, MOST_CASES) as cases:
            return bool(cases)

    def snapshots(self) -> Figure:
        with self._cases(MOST_CASES) as cases:
            return snapshots_figure(cases, self.style)

    def waterfall(self) -> Figure:
        with self._cases(1) as cases:
            ((title, case),) = cases.items()
            return waterfall_figure(case, title, self.style)

    def movie(self, out: Path | None) -> Path:
        written = out or self.beside("movie", default_suffix())
        with self._cases(1) as cases:
            ((title, case),) = cases.items()
            write_movie(case, written, title, self.style)
        return written

    @contextmanager
    def _cases(self, most: int) -> Iterator[dict[str, Dataset]]:
        with cases_with_snapshots(self.path, self.dataset, self.case, most) as cases:
            if not cases:
                raise ResultsError(
                    f"{self.path}: no snapshots; set output.snapshots and run the config again"
                )
            yield cases
