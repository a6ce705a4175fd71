"""Selection of the surfaces to draw: cases with snapshots, their times, cuts, the extent of the contact."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gfmdlayer.figures.labels import value_labels
from gfmdlayer.figures.plot_style import spread
from gfmdlayer.figures.quantities import quantity
from gfmdlayer.figures.selection import case_titles
from gfmdlayer.results.reader import case_path, is_complete, open_case
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from xarray import DataArray, Dataset

    from gfmdlayer.figures.quantities import Quantity

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
        What the reader opens there, or a selection of its cases.
    number : int, optional
        Number of the case; by default all complete cases, or `most` of them from the first to the last.
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
        raise ResultsError(f"{path}: case {number} is not complete{' among those selected' * (not wanted)}")
    opened: dict[str, Dataset] = {}
    for title, index in [complete[i] for i in spread(len(complete), most)]:
        own = f"{title}, case {index:04d}" if title in opened else title
        opened[own] = open_case(case_path(path, index)).assign_coords(case=index)
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


def snapshot_times(case: Dataset) -> tuple[Quantity, list[float]]:
    """Return how time is drawn, and the times of the snapshots, divided by its scale."""
    time = quantity(case["snapshot"], case.attrs)
    return time, [float(f"{each / time.scale:.12g}") for each in case["snapshot"].to_numpy()]


def snapshot_titles(case: Dataset) -> list[str]:
    """Return the times of the snapshots, each with the symbol and the unit of time."""
    time, times = snapshot_times(case)
    return [time.equals(each) for each in value_labels(times)]


def part_of(case: Dataset, most: int) -> tuple[Dataset, list[str]]:
    """Return at most so many of the snapshots, from the first to the last, and a note on those left out."""
    count = case.sizes["snapshot"]
    if count <= most:
        return case, []
    return case.isel(snapshot=spread(count, most)), [f"{most} of {count} snapshots"]


class Extremes(NamedTuple):
    """What all snapshots of some cases have in common, found by reading one at a time.

    Attributes
    ----------
    peak : float
        The highest pressure; 1 where there is none.
    view : mapping
        The part of each axis to show: the contact and half its extent on either side.
    """

    peak: float
    view: Window

    @classmethod
    def of(cls, cases: Iterable[Dataset]) -> Extremes:
        """Read the pressure of every snapshot of the cases, all on one grid."""
        every = list(cases)
        names = [name for name in "xy" if name in every[0]["pressure"].dims]
        ends: dict[str, list[float]] = {name: [] for name in names}
        peak = 0.0
        for one in (one for case in every for one in each_snapshot(case["pressure"])):
            highest = float(one.max())
            peak = max(peak, highest)
            noticeable = one > NOTICEABLE * max(highest, 0.0)
            for name in names:
                pressed = noticeable.any([dim for dim in one.dims if dim != name]).to_numpy()
                ends[name] += one[name].to_numpy()[pressed][[0, -1]].tolist() if pressed.any() else []
        return cls(peak or 1.0, {name: _shown(every[0][name].to_numpy(), ends[name]) for name in names})


def _shown(coordinate: NDArray[np.float64], ends: list[float]) -> tuple[float, float]:
    start, stop = float(coordinate[0]), float(coordinate[-1])
    if not ends:
        return start, stop
    margin = 0.5 * (max(ends) - min(ends)) + 4.0 * float(coordinate[1] - coordinate[0])
    return max(start, min(ends) - margin), min(stop, max(ends) + margin)


def limits(field: DataArray) -> tuple[float, float]:
    """Return the least and the largest value over all snapshots, of which one at a time is in memory."""
    found = [(float(one.min()), float(one.max())) for one in each_snapshot(field)]
    return min(low for low, _ in found), max(high for _, high in found)


def each_snapshot(field: DataArray) -> Iterator[DataArray]:
    """Yield the field of each snapshot, read when it comes."""
    for i in range(field.sizes["snapshot"]):
        yield field.isel(snapshot=i).load()
