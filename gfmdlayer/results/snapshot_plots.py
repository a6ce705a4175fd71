"""Pictures of the surface at the snapshot times: displacement and contact pressure, zoomed to the contact."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.results.plot_style import (
    case_titles,
    colours,
    journal_style,
    line_style,
    new_figure,
    save,
    time_axis,
    value_labels,
)
from gfmdlayer.results.reader import case_path, is_complete, open_case
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset

MOST_CASES = 6
MOST_MAPS = 4


def plot_snapshots(
    directory: str | Path, results: Dataset, picture: Path, case: int | None = None
) -> Path | None:
    """Draw the snapshots of some cases, if they have any.

    Parameters
    ----------
    directory
        The folder of results.
    results
        What the reader opens there.
    picture
        The file to write.
    case
        The number of the case; by default all cases if they are at most MOST_CASES, else the first.

    Returns
    -------
    Path | None
        The picture, or None where there are no snapshots.

    Raises
    ------
    ResultsError
        If the case asked for is not there.
    """
    if "snapshot" in results.dims:
        chosen = {"": results} if results.sizes["snapshot"] else {}
    else:
        chosen = _open_cases(directory, results, case)
    if not chosen:
        return None
    try:
        save(snapshots_figure(chosen), picture)
    finally:
        for opened in chosen.values():
            opened.close()
    return picture


def snapshots_figure(cases: Mapping[str, Dataset]) -> Figure:
    """Draw the snapshots of cases, one row of panels a case.

    For surfaces in one dimension the panels are displacement and pressure, with a curve for each snapshot;
    for surfaces in two, maps of the pressure at up to MOST_MAPS of the times.

    Parameters
    ----------
    cases
        Title -> the case as the reader opens it; all have snapshots, and grids of one dimensionality.
    """
    with journal_style():
        first = next(iter(cases.values()))
        return _maps(cases) if "y" in first["pressure"].dims else _profiles(cases)


def _open_cases(directory: str | Path, results: Dataset, case: int | None) -> dict[str, Dataset]:
    numbers = results["case"].to_numpy()
    places = [place for place in np.ndindex(numbers.shape) if case is None or numbers[place] == case]
    present = [place for place in places if is_complete(case_path(directory, int(numbers[place])))]
    if case is not None and not present:
        raise ResultsError(f"{directory}: no complete case {case:04d}")
    kept = present if len(present) <= MOST_CASES else present[:1]
    titles = case_titles(results)
    opened = {titles[place]: open_case(case_path(directory, int(numbers[place]))) for place in kept}
    return {title: dataset for title, dataset in opened.items() if dataset.sizes["snapshot"]}


def _profiles(cases: Mapping[str, Dataset]) -> Figure:
    from matplotlib.lines import Line2D

    figure = new_figure(2, 22.0 + 38.0 * len(cases))
    panels = figure.subplots(len(cases), 2, sharex=True, sharey="col", squeeze=False)
    left, right = _extent(cases, "x")
    time_label, times = _times(max(cases.values(), key=lambda dataset: dataset.sizes["snapshot"]))
    for row, (title, dataset) in zip(panels, cases.items(), strict=True):
        for axes, name, label in zip(row, ("displacement", "pressure"), ("$u$", "$p$"), strict=True):
            _draw_profiles(axes, dataset[name], left, right)
            axes.set_ylabel(label)
        row[0].set_title(title, loc="left")
    for axes in panels[-1]:
        axes.set_xlabel("$x$")
        axes.set_xlim(left, right)
    panels[0, 1].set_ylim(bottom=0)
    lines = [
        Line2D([], [], color=colour, linestyle=line_style(place), label=f"{time_label} = {label}")
        for place, (colour, label) in enumerate(zip(colours(len(times)), times, strict=True))
    ]
    figure.legend(handles=lines, loc="outside upper center", ncols=min(len(lines), 5))
    return figure


def _draw_profiles(axes: Axes, field: DataArray, left: float, right: float) -> None:
    x = field["x"].to_numpy()
    shown = (x >= left) & (x <= right)
    for place, colour in enumerate(colours(field.sizes["snapshot"])):
        values = field.isel(snapshot=place).to_numpy()
        axes.plot(x[shown], values[shown], color=colour, linestyle=line_style(place))


def _maps(cases: Mapping[str, Dataset]) -> Figure:
    most = max(dataset.sizes["snapshot"] for dataset in cases.values())
    columns = min(most, MOST_MAPS)
    figure = new_figure(2, 14.0 + 150.0 / max(columns, 2) * len(cases))
    panels = figure.subplots(len(cases), columns, sharex=True, sharey=True, squeeze=False)
    (left, right), (low, high) = _extent(cases, "x"), _extent(cases, "y")
    peak = max(float(dataset["pressure"].max()) for dataset in cases.values())
    for row, (title, dataset) in zip(panels, cases.items(), strict=True):
        time_label, times = _times(dataset)
        kept = np.linspace(0, len(times) - 1, min(columns, len(times))).round().astype(int)
        for axes, place in zip(row, kept, strict=False):
            field = dataset["pressure"].isel(snapshot=place).transpose("y", "x")
            mesh = axes.pcolormesh(
                field["x"], field["y"], field, vmin=0.0, vmax=peak or 1.0, shading="nearest", rasterized=True
            )
            axes.set(aspect="equal", xlim=(left, right), ylim=(low, high))
            axes.set_title(f"{time_label} = {times[place]}", loc="right")
        row[0].set_title(title, loc="left")
        row[0].set_ylabel("$y$")
    for axes in panels[-1]:
        axes.set_xlabel("$x$")
    figure.colorbar(mesh, ax=panels, label="$p$", shrink=0.8)
    return figure


def _times(dataset: Dataset) -> tuple[str, list[str]]:
    label, tau = time_axis(dataset)
    return label, value_labels((dataset["snapshot"].to_numpy() / tau).tolist())


def _extent(cases: Mapping[str, Dataset], name: str) -> tuple[float, float]:
    """Return the stretch of an axis to show: the contact and half as much again on either side."""
    touched: list[NDArray[np.float64]] = []
    for dataset in cases.values():
        pressed = (dataset["pressure"] > 0).any([dim for dim in dataset["pressure"].dims if dim != name])
        touched.append(dataset[name].to_numpy()[pressed.to_numpy()])
    coordinate = next(iter(cases.values()))[name].to_numpy()
    start, stop = float(coordinate[0]), float(coordinate[-1])
    contact = np.concatenate(touched)
    if contact.size == 0:
        return start, stop
    margin = 0.5 * float(np.ptp(contact)) + 4.0 * float(coordinate[1] - coordinate[0])
    return max(start, float(contact.min()) - margin), min(stop, float(contact.max()) + margin)
