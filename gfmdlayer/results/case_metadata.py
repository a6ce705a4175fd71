"""Metadata of the cases of a sweep: which are complete, their columns, common times and shared attributes.

Columns are those that the files hold, with the names and units that they have there: results of an earlier
version, or of an observable that is no longer declared, are collected like any other.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import h5py
import numpy as np
from h5py import h5a, h5f, h5g
from numpy.typing import NDArray

from gfmdlayer.observables import known_numbers
from gfmdlayer.observables.contact import TIME, ContactMeans
from gfmdlayer.results.reader import attribute, column, opened
from gfmdlayer.results.schema import FIELDS

INCOMPLETE = "no complete result file"

# Relative to the last time: times that two cases reach by different steps differ by rounding.
SAME_TIME = 1e-9

_NAMED = 5  # cases in a line of the notes
OF_ONE_CASE = {
    *("config", "digest", "hostname", "started", "finished", "wall_seconds", "rows", "snapshots", "complete"),
    *known_numbers(),
    *("instabilities", "instability_time", "instability_depth", "instability_energy", "ended"),
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
    """Times at which all cases have a row; those that ended early, for a reason, have all later times too.

    Attributes
    ----------
    times : ndarray, shape (rows,)
        The times that all cases so far share.
    """

    def __init__(self) -> None:
        self.times: NDArray[np.float64] = np.empty(0)
        self._is_first = self._all_early = True

    def add(self, times: NDArray[np.float64], *, early: bool) -> None:
        """Add the times of a case, and whether it ended early: in a steady state, or pulled off."""
        if self._is_first:
            self.times = times
        elif not np.array_equal(times, self.times):
            common = self.times[rows_at(times, self.times, steady=early) >= 0]
            later = times > self.times.max(initial=0.0) if self._all_early else slice(0)
            self.times = np.append(common, times[later])
        self._is_first = False
        self._all_early &= early


class SweepColumn(NamedTuple):
    """A column of the sweep: its attributes, and its bins if it is a distribution.

    Attributes
    ----------
    described : mapping
        long_name and units.
    bins : str
        Name of the dimension of the bins; empty for a number.
    edges : mapping
        Coordinate -> its attributes and values: the lower and upper ends of the bins.
    """

    described: Mapping[str, str]
    bins: str = ""
    edges: Mapping[str, tuple[Mapping[str, str], NDArray[np.float64]]] = MappingProxyType({})


class CaseMetadata:
    """Metadata that the files of all cases have in common.

    Attributes
    ----------
    failed : dict
        Number -> reason of the cases without results.
    common_times : ndarray, shape (rows,)
        Times at which all complete cases have a row, see `CommonTimes`.
    columns : dict
        Columns of the sweep file by name: those of every case, and those that any complete case has.
    lacking : dict
        Name -> numbers of the complete cases that have no such column, or one over other bins.
    numbers : dict
        Name -> number of a case -> value of an attribute that is a column of the sweep.
    shared : dict
        Attributes that have the same value in all complete cases.
    """

    def __init__(self, records: Sequence[CaseRecord]) -> None:
        self.failed = {record.index: record.failed for record in records if record.failed is not None}
        self.columns: dict[str, SweepColumn] = {}
        self.numbers: dict[str, dict[int, float]] = {}
        self.shared: dict[str, object] = {}
        self._is_first, self._common = True, CommonTimes()
        self._of_first: frozenset[str] = frozenset()
        self._layouts: dict[tuple[bytes, ...], dict[str, SweepColumn]] = {}
        self._held: dict[int, frozenset[str]] = {}
        for record in records:
            if record.index not in self.failed and not self._add(record):
                self.failed[record.index] = INCOMPLETE
        self.common_times = self._common.times
        always = {each.name: SweepColumn(each.described) for each in ContactMeans.COLUMNS}
        self.columns = self.columns or always  # without a complete case, those of the paper
        self.columns.pop(TIME.name, None)
        self.lacking = {
            name: lacking
            for name in self.columns
            if (lacking := frozenset(index for index, held in self._held.items() if name not in held))
        }

    def _add(self, record: CaseRecord) -> bool:
        """Read the file of a case; False if it is not complete."""
        try:
            with opened(record.path) as file:
                times = column(file, "time")
                if attribute(file, "complete") != 1 or attribute(file, "rows") != len(times):
                    return False
                shared = self._shared_with(file)
                early = bool(attribute(file, "settled") or attribute(file, "ended"))
                held = self._columns_of(file)
                own = {name: attribute(file, name) for name in known_numbers()}
        except Exception:  # a damaged file can fail anywhere in HDF5, with any exception
            return False
        self._common.add(times, early=early)
        if self._is_first:
            self._of_first = frozenset(shared)
        self._is_first = False
        self._held[record.index] = held
        for name, value in own.items():
            if value is not None:
                self.numbers.setdefault(name, {})[record.index] = float(str(value))
        self.shared = shared
        return True

    @property
    def notes(self) -> list[str]:
        """Lines on the columns that some cases lack, and on cases of other versions of the code."""
        lines = notes_on(self.lacking, len(self._held))
        if (self._of_first - self.shared.keys()) & {"gfmdlayer_version", "git_commit"}:
            lines.append(
                "the cases are of different versions of gfmdlayer (gfmdlayer_version and git_commit of their "
                "files); --restart computes all of them anew"
            )
        return lines

    def _columns_of(self, file: h5f.FileID) -> frozenset[str]:
        """Take note of the columns of a case; return the names of those that fit the ones known so far."""
        names = tuple(h5g.open(file, b"/"))
        if names not in self._layouts:
            self._layouts[names] = dict(_columns_in(h5py.File(file)))
        held = self._layouts[names]
        for name, found in held.items():
            self.columns.setdefault(name, found)
        return frozenset(name for name, found in held.items() if self._fits(name, found, file))

    def _fits(self, name: str, found: SweepColumn, file: h5f.FileID) -> bool:
        """Whether a column is along the bins of the cases before."""
        known = self.columns[name]
        if not (found.bins or known.bins):
            return True
        return found.bins == known.bins and all(
            np.array_equal(column(file, end), edges) for end, (_, edges) in known.edges.items()
        )

    def _shared_with(self, file: h5f.FileID) -> dict[str, object]:
        if self._is_first:
            names = (h5a.open(file, index=i).name.decode() for i in range(h5a.get_num_attrs(file)))
            return {name: attribute(file, name) for name in names if name not in OF_ONE_CASE}
        return {name: value for name, value in self.shared.items() if equal(attribute(file, name), value)}


def equal(one: Any, other: Any) -> bool:
    """Whether two attributes are the same, texts, numbers or arrays."""
    return bool(np.array_equal(one, other))


def notes_on(lacking: Mapping[str, frozenset[int]], complete: int) -> list[str]:
    """Return lines on columns that some of the complete cases lack.

    Parameters
    ----------
    lacking : mapping
        Name of a column -> numbers of the cases that lack it.
    complete : int
        Number of complete cases.

    Returns
    -------
    list of str
    """
    alike: dict[frozenset[int], list[str]] = {}
    for name, cases in lacking.items():
        alike.setdefault(cases, []).append(name)
    return [
        f"{', '.join(sorted(names))}: NaN in {_numbered(cases)}"
        for cases, names in alike.items()
        if len(cases) < complete
    ]


def _columns_in(h5: h5py.File) -> Iterator[tuple[str, SweepColumn]]:
    """Yield the columns of a case: the variables that grow with time."""
    for name, dataset in h5.items():
        if not isinstance(dataset, h5py.Dataset) or dataset.maxshape[:1] != (None,):
            continue
        if name in {TIME.name, "snapshot", *FIELDS}:
            continue
        if dataset.ndim == 1:
            yield name, SweepColumn(_described(dataset))
        else:
            bins = dataset.dims[1][0].name.lstrip("/")
            edges = {end: (_described(h5[end]), h5[end][()]) for end in (bins, f"{bins}_end")}
            yield name, SweepColumn(_described(dataset), bins, edges)


def _described(dataset: h5py.Dataset) -> dict[str, str]:
    return {key: str(dataset.attrs[key]) for key in ("long_name", "units") if key in dataset.attrs}


def _numbered(cases: Collection[int]) -> str:
    """Name some cases, or the first of many."""
    first = ", ".join(f"{index:04d}" for index in sorted(cases)[:_NAMED])
    more = len(cases) - _NAMED
    return f"case{'s' * (len(cases) > 1)} {first}" + (f" and {more} more" if more > 0 else "")


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


def at_rows(values: NDArray[np.float64], rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the values of a column at rows, NaN where there is none (-1): behind the end of a case."""
    found = values[rows]
    if (rows < 0).any():
        found = found.astype(np.float64)
        found[rows < 0] = np.nan
    return found
