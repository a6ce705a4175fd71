"""Metadata of the files of all cases: complete or not, times of the rows, columns, shared attributes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.observables import Column, known_columns
from gfmdlayer.observables.contact_means import ContactMeans
from gfmdlayer.results import scan

LOST = "no complete result file"

# Rows of two cases are at the same time if they differ by less than this part of the whole; steps that are
# counted up in different ways differ by rounding.
SAME_TIME = 1e-9


_OF_ONE_CASE = {
    *("config", "digest", "hostname", "started", "finished", "wall_seconds", "rows", "snapshots", "complete"),
}


@dataclass(frozen=True)
class CaseRecord:
    """One case of a sweep: its number, file, swept values, and why it failed if it did."""

    index: int
    path: Path
    values: Mapping[str, object]
    failed: str | None = None


class Survey:
    """A first look at every case: which are complete, at which times, and what they have in common.

    Attributes
    ----------
    failed
        Reasons by number; those found later are added.
    common
        The times that all complete cases share, and `same_steps` whether these are all they have. A case that
        ended when it was steady has every later time too.
    columns
        Columns of the sweep file: those of every case, and those that any complete case has.
    shared
        The attributes that they share.
    """

    def __init__(self, records: Sequence[CaseRecord]) -> None:
        self.failed = {record.index: record.failed for record in records if record.failed is not None}
        self.common: NDArray[np.float64] = np.empty(0)
        self.same_steps = True
        self._held: set[str] = set()
        self.shared: dict[str, object] = {}
        self._complete, self._go_on = 0, True
        for record in records:
            if record.index not in self.failed and not self._take(record.path):
                self.failed[record.index] = LOST

    def _take(self, path: Path) -> bool:
        """Look at a file; False where there is no complete case."""
        try:
            with scan.opened(path) as file:
                times = scan.column(file, "time")
                if scan.attribute(file, "complete") != 1 or scan.attribute(file, "rows") != len(times):
                    return False
                shared = self._shared_with(file)
                settled = bool(scan.attribute(file, "settled"))
                held = {column.name for column in sweep_columns() if scan.holds(file, column.name)}
        except Exception:  # a damaged file can fail anywhere in HDF5, with any exception
            return False
        if not self._complete:
            self.common = times
        elif not np.array_equal(times, self.common):
            self.same_steps = False
            later = times[times > self.common.max(initial=0.0)] if self._go_on else times[:0]
            self.common = np.append(self.common[rows_at(times, self.common, goes_on=settled) >= 0], later)
        self._go_on &= settled
        self._held |= held
        self.shared = shared
        self._complete += 1
        return True

    def _shared_with(self, file: Any) -> dict[str, object]:
        if not self._complete:
            names = [name for name in scan.attribute_names(file) if name not in _OF_ONE_CASE]
            return {name: scan.attribute(file, name) for name in names}
        return {name: value for name, value in self.shared.items() if scan.attribute(file, name) == value}

    @property
    def columns(self) -> list[Column]:
        """Return the columns of the sweep file."""
        held = self._held.union(column.name for column in ContactMeans.COLUMNS)
        return [column for column in sweep_columns() if column.name in held]

    def report(self) -> str:
        """Name the failed cases, a line each."""
        return "\n".join(f"{index:04d}: {reason}" for index, reason in sorted(self.failed.items()))


def sweep_columns() -> list[Column]:
    """Return the columns that sweep files may have."""
    return [column for column in known_columns().values() if column.in_sweep]


def rows_at(times: NDArray[np.float64], wanted: NDArray[np.float64], *, goes_on: bool) -> NDArray[np.int64]:
    """Find the rows that are at the wanted times; -1 where there is none, and no last row that goes on."""
    if times.size == 0 or wanted.size == 0:
        return np.full(wanted.shape, -1)
    tolerance = SAME_TIME * max(abs(times[-1]), abs(wanted[-1]))
    after = np.searchsorted(times, wanted - tolerance).clip(max=times.size - 1)
    found = (np.abs(times[after] - wanted) <= tolerance) | (goes_on & (wanted > times[-1]))
    return np.where(found, after, -1)
