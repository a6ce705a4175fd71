"""Selection of the surfaces to draw: cases with snapshots, their times, cuts, the extent of the contact."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.figures.labels import case_titles, time_axis, value_labels
from gfmdlayer.results.reader import case_path, is_complete, open_case
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

Window = Mapping[str, tuple[float, float]]  # the part of each axis that is shown

# Of the largest pressure: a solver may leave less than its tolerance where there is no contact.
NOTICEABLE = 1e-4


@contextmanager
def cases_with_snapshots(
    path: Path, results: Dataset, number: int | None, most: int
) -> Iterator[dict[str, Dataset]]:
    """Open the cases to draw, as title -> case, for a `with` block.

    Parameters
    ----------
    path : Path
        The folder of results, or the file of a case.
    results : Dataset
        What the reader opens there.
    number : int, optional
        Number of the case; by default all complete cases if they are at most `most`, else the first.
    most : int
        Number of cases that the figure has room for.

    Raises
    ------
    ResultsError
        If there is no complete case of this number.
    """
    if "case" in results.coords:
        opened = _open_cases(path, results, number, most)
    elif number:
        raise ResultsError(f"{path}: there is no case {number}; must be 0, the only one")
    else:
        opened = {"": results}
    try:
        yield {title: case for title, case in opened.items() if case.sizes["snapshot"]}
    finally:
        for case in opened.values():
            if case is not results:
                case.close()


def _open_cases(path: Path, sweep: Dataset, number: int | None, most: int) -> dict[str, Dataset]:
    numbers = sweep["case"].to_numpy().ravel().tolist()
    if number is not None and number not in numbers:
        raise ResultsError(f"{path}: there is no case {number}; must be from 0 to {max(numbers)}")
    titled = zip(case_titles(sweep).values(), numbers, strict=True)
    wanted = [(title, index) for title, index in titled if number is None or index == number]
    complete = [(title, index) for title, index in wanted if is_complete(case_path(path, index))]
    if number is not None and not complete:
        raise ResultsError(f"{path}: case {number} is not complete")
    opened = {}
    for title, index in complete if len(complete) <= most else complete[:1]:
        opened[title] = open_case(case_path(path, index))
        opened[title].coords["case"] = index
    return opened


def at_times(case: Dataset, times: Sequence[float]) -> Dataset:
    """Select the snapshots at some times, in the units of the config.

    Raises
    ------
    ResultsError
        If there is no snapshot at one of the times.
    """
    present = case["snapshot"].to_numpy()
    for time in times:
        if not np.isclose(present, time, rtol=1e-9, atol=0).any():
            known = ", ".join(f"{each:g}" for each in present)
            raise ResultsError(f"there is no snapshot at time {time:g}; there are {known or 'none'}")
    return case.sel(snapshot=list(times), method="nearest")


def section(case: Dataset) -> Dataset:
    """Cut a surface along x, through its highest pressure at the last snapshot; a line stays as it is."""
    if "y" not in case.dims:
        return case
    pressure = case["pressure"].isel(snapshot=-1)
    return case.isel(y=int(pressure.max("x").argmax("y")))


def snapshot_times(case: Dataset) -> tuple[str, list[str]]:
    """Return the symbol of time and the times of the snapshots as text."""
    label, unit = time_axis(case)
    return label, value_labels((case["snapshot"].to_numpy() / unit).tolist())


def snapshot_titles(case: Dataset) -> list[str]:
    """Return the times of the snapshots, each with the symbol of time."""
    label, times = snapshot_times(case)
    return [f"{label} = {time}" for time in times]


def limits(field: DataArray) -> tuple[float, float]:
    """Return the least and the largest value over all snapshots, of which one at a time is in memory."""
    found = [(float(one.min()), float(one.max())) for one in _each_snapshot(field)]
    return min(low for low, _ in found), max(high for _, high in found)


def window(cases: Iterable[Dataset]) -> Window:
    """Return the part of the surface to show: the contact and half its extent on either side."""
    every = list(cases)
    return {name: extent(every, name) for name in "xy"}


def extent(cases: Iterable[Dataset], name: str) -> tuple[float, float]:
    """Return the part of an axis to show: the contact and half its extent on either side."""
    every = list(cases)
    coordinate = every[0][name].to_numpy()
    start, stop = float(coordinate[0]), float(coordinate[-1])
    ends = [end for case in every for end in _contact_ends(case["pressure"], name)]
    if not ends:
        return start, stop
    left, right = min(ends), max(ends)
    margin = 0.5 * (right - left) + 4.0 * float(coordinate[1] - coordinate[0])
    return max(start, left - margin), min(stop, right + margin)


def _contact_ends(pressure: DataArray, name: str) -> Iterator[float]:
    """Yield the first and the last coordinate with a noticeable pressure, for each snapshot."""
    for one in _each_snapshot(pressure):
        noticeable = one > NOTICEABLE * max(float(one.max()), 0.0)
        pressed = noticeable.any([dim for dim in one.dims if dim != name]).to_numpy()
        in_contact = one[name].to_numpy()[pressed]
        if in_contact.size:
            yield from (float(in_contact[0]), float(in_contact[-1]))


def _each_snapshot(field: DataArray) -> Iterator[DataArray]:
    for i in range(field.sizes["snapshot"]):
        yield field.isel(snapshot=i).load()
