"""What is drawn of the surface: cases with snapshots, their times, cuts, and where the contact is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.figures.plot_style import case_titles, time_axis, value_labels
from gfmdlayer.results.reader import case_path, is_complete, open_case
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

NOTICEABLE = (
    1e-4  # of the largest pressure; a solver leaves less than its tolerance where there is no contact
)


@contextmanager
def cases_with_snapshots(
    path: Path, results: Dataset, case: int | None, most: int
) -> Iterator[dict[str, Dataset]]:
    """Open the cases to draw for the block: title -> case.

    Parameters
    ----------
    path
        The folder of results, or the file of a case.
    results
        What the reader opens there.
    case
        The number of the case; by default all that have snapshots if they are at most `most`, else the first.

    Raises
    ------
    ResultsError
        If the case asked for is not there.
    """
    if "case" in results.coords:
        opened = _opened(path, results, case, most)
    elif case:
        raise ResultsError(f"{path}: no case {case:04d}, it holds a single one")
    else:
        opened = {"": results}
    try:
        yield {title: dataset for title, dataset in opened.items() if dataset.sizes["snapshot"]}
    finally:
        for dataset in opened.values():
            if dataset is not results:
                dataset.close()


def _opened(path: Path, results: Dataset, case: int | None, most: int) -> dict[str, Dataset]:
    numbers = results["case"].to_numpy()
    places = [place for place in np.ndindex(numbers.shape) if case is None or numbers[place] == case]
    present = [place for place in places if is_complete(case_path(path, int(numbers[place])))]
    if case is not None and not present:
        raise ResultsError(f"{path}: no complete case {case:04d}")
    titles, opened = case_titles(results), {}
    for place in present if len(present) <= most else present[:1]:
        opened[titles[place]] = one = open_case(case_path(path, int(numbers[place])))
        one.coords["case"] = int(numbers[place])
    return opened


def at_times(case: Dataset, times: Sequence[float]) -> Dataset:
    """Take the snapshots at these times, in the units of the config.

    Raises
    ------
    ResultsError
        If one of them is not the time of a snapshot.
    """
    present = case["snapshot"].to_numpy()
    for time in times:
        if not np.isclose(present, time, rtol=1e-9, atol=0).any():
            there = ", ".join(f"{known:g}" for known in present)
            raise ResultsError(f"there is no snapshot at time {time:g}; there are {there or 'none'}")
    return case.sel(snapshot=list(times), method="nearest")


def with_gap(case: Dataset) -> Dataset:
    """Return a case if its snapshots have the gap.

    Raises
    ------
    ResultsError
        If they do not.
    """
    if "gap" not in case:
        raise ResultsError("the snapshots have no gap, an earlier version wrote them: run the config again")
    return case


def section(case: Dataset) -> Dataset:
    """Cut a case along x, through its highest pressure at the last snapshot; a line is left as it is."""
    if "y" not in case.dims:
        return case
    pressure = case["pressure"].isel(snapshot=-1)
    return case.isel(y=int(pressure.max("x").argmax("y")))


def spread(count: int, most: int) -> list[int]:
    """Return places from the first to the last of so many, evenly, at most `most` of them."""
    return [round(place) for place in np.linspace(0, count - 1, min(most, count)).tolist()]


def snapshot_times(dataset: Dataset) -> tuple[str, list[str]]:
    """Return the symbol of time and the times of the snapshots, written out."""
    label, tau = time_axis(dataset)
    return label, value_labels((dataset["snapshot"].to_numpy() / tau).tolist())


def limits(field: DataArray) -> tuple[float, float]:
    """Return the least and the largest value over all snapshots; one of them is in memory at a time."""
    found = [(float(one.min()), float(one.max())) for one in each_snapshot(field)]
    return min(low for low, _ in found), max(high for _, high in found)


def each_snapshot(field: DataArray) -> Iterator[DataArray]:
    """Yield the snapshots of a field, read one after the other."""
    for place in range(field.sizes["snapshot"]):
        yield field.isel(snapshot=place).load()


def extent(cases: Iterable[Dataset], name: str) -> tuple[float, float]:
    """Return the stretch of an axis to show: the contact and half as much again on either side."""
    every = list(cases)
    coordinate = every[0][name].to_numpy()
    start, stop = float(coordinate[0]), float(coordinate[-1])
    reach = [ends for dataset in every for ends in _touched(dataset["pressure"], name)]
    if not reach:
        return start, stop
    left, right = min(reach), max(reach)
    margin = 0.5 * (right - left) + 4.0 * float(coordinate[1] - coordinate[0])
    return max(start, left - margin), min(stop, right + margin)


def _touched(pressure: DataArray, name: str) -> Iterator[float]:
    """Yield the first and the last coordinate with a noticeable pressure, in each snapshot."""
    for one in each_snapshot(pressure):
        noticeable = one > NOTICEABLE * max(float(one.max()), 0.0)
        pressed = noticeable.any([dim for dim in one.dims if dim != name]).to_numpy()
        touched = one[name].to_numpy()[pressed]
        if touched.size:
            yield from (float(touched[0]), float(touched[-1]))
