"""Metadata of the cases of a sweep: which are complete, and the times and attributes that they share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from h5py import h5a, h5f
from numpy.typing import NDArray

from gfmdlayer.observables import Column, known_columns
from gfmdlayer.observables.contact_means import ContactMeans
from gfmdlayer.results.reader import attribute, column, opened

INCOMPLETE = "no complete result file"

# Relative to the last time: times that two cases reach by different steps differ by rounding.
SAME_TIME = 1e-9

OF_ONE_CASE = {
    *("config", "digest", "hostname", "started", "finished", "wall_seconds", "rows", "snapshots", "complete"),
}


@dataclass(frozen=True)
class CaseRecord:
    """One case of a sweep.

    Attributes
    ----------
    index : int
        Number of the case.
    path : Path
        Its file.
    values : mapping
        The swept values by dotted key.
    failed : str, optional
        Why the case failed.
    """

    index: int
    path: Path
    values: Mapping[str, object]
    failed: str | None = None


class CommonTimes:
    """Times at which all cases have a row; those that ended in a steady state have all later times too.

    Attributes
    ----------
    times : ndarray, shape (rows,)
        The times that all cases so far share.
    """

    def __init__(self) -> None:
        self.times: NDArray[np.float64] = np.empty(0)
        self._is_first = self._all_steady = True

    def add(self, times: NDArray[np.float64], *, steady: bool) -> None:
        """Add the times of a case, and whether it ended in a steady state."""
        if self._is_first:
            self.times = times
        elif not np.array_equal(times, self.times):
            common = self.times[rows_at(times, self.times, steady=steady) >= 0]
            later = times > self.times.max(initial=0.0) if self._all_steady else slice(0)
            self.times = np.append(common, times[later])
        self._is_first = False
        self._all_steady &= steady


class CaseMetadata:
    """Metadata that the files of all cases have in common.

    Attributes
    ----------
    failed : dict
        Number -> reason of the cases without results.
    common_times : ndarray, shape (rows,)
        Times at which all complete cases have a row, see `CommonTimes`.
    columns : list of Column
        Columns of the sweep file: those of every case, and those that any complete case has.
    shared : dict
        Attributes that have the same value in all complete cases.
    """

    def __init__(self, records: Sequence[CaseRecord]) -> None:
        self.failed = {record.index: record.failed for record in records if record.failed is not None}
        self._common = CommonTimes()
        self._held: set[str] = set()
        self.shared: dict[str, object] = {}
        self._is_first = True
        for record in records:
            if record.index not in self.failed and not self._add(record.path):
                self.failed[record.index] = INCOMPLETE

    def _add(self, path: Path) -> bool:
        """Read the file of a case; False if it is not complete."""
        try:
            with opened(path) as file:
                times = column(file, "time")
                if attribute(file, "complete") != 1 or attribute(file, "rows") != len(times):
                    return False
                shared = self._shared_with(file)
                steady = bool(attribute(file, "settled"))
                held = {each.name for each in sweep_columns() if each.name.encode() in file}
        except Exception:  # a damaged file can fail anywhere in HDF5, with any exception
            return False
        self._common.add(times, steady=steady)
        self._is_first = False
        self._held |= held
        self.shared = shared
        return True

    @property
    def common_times(self) -> NDArray[np.float64]:
        """Times at which all complete cases have a row."""
        return self._common.times

    @property
    def columns(self) -> list[Column]:
        """Columns of the sweep file."""
        held = self._held.union(each.name for each in ContactMeans.COLUMNS)
        return [each for each in sweep_columns() if each.name in held]

    def _shared_with(self, file: h5f.FileID) -> dict[str, object]:
        if self._is_first:
            names = (h5a.open(file, index=i).name.decode() for i in range(h5a.get_num_attrs(file)))
            return {name: attribute(file, name) for name in names if name not in OF_ONE_CASE}
        return {name: value for name, value in self.shared.items() if attribute(file, name) == value}


def sweep_columns() -> list[Column]:
    """Return the columns that sweep files may have."""
    return [each for each in known_columns().values() if each.in_sweep]


def rows_at(times: NDArray[np.float64], wanted: NDArray[np.float64], *, steady: bool) -> NDArray[np.int64]:
    """Find the rows of a case at given times.

    Parameters
    ----------
    times : ndarray, shape (rows,)
        Increasing times of the rows.
    wanted : ndarray, shape (n,)
        Increasing times to look for.
    steady : bool
        Whether the case ended in a steady state, in which its last row stands for all later times.

    Returns
    -------
    ndarray, shape (n,)
        Indices of the rows, -1 where there is none.
    """
    if times.size == 0 or wanted.size == 0:
        return np.full(wanted.shape, -1)
    tolerance = SAME_TIME * max(abs(times[-1]), abs(wanted[-1]))
    after = np.searchsorted(times, wanted - tolerance).clip(max=times.size - 1)
    found = (np.abs(times[after] - wanted) <= tolerance) | (steady & (wanted > times[-1]))
    return np.where(found, after, -1)
