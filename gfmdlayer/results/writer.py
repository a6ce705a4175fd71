"""The file of one case: rows in time, snapshots of the surface, and where they come from.

    time(time), one column for each name given with the rows      x(x)[, y(y)]
    snapshot(snapshot), displacement, pressure and gap (snapshot, x[, y])

Rows are gathered in memory and appended when ROWS_HELD of them wait or FLUSH_INTERVAL has passed, and a
snapshot is written as it comes, in blocks of at most BLOCK points, so that a run of any length needs the same
memory. Chunks carry checksums: what a disk has spoiled is refused when it is read.

Snapshots are shuffled by byte and compressed by gzip at level 1. Measured on a rough contact of 2^22 points,
the pressure, mostly zeros, shrinks to 10 % in 34 ns a point, the gap to 74 % and the displacement to 82 % in
142 ns, of which the disk alone takes 13; level 4 gains 1 % more.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.results.netcdf import NewFile, add_values, add_variable, new_file
from gfmdlayer.results.paraview import describe
from gfmdlayer.results.provenance import now, provenance
from gfmdlayer.results.schema import variable

ROWS_HELD = 512
FLUSH_INTERVAL = 60.0  # seconds
BLOCK = 2**20  # points of a snapshot in a chunk
PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "fletcher32": True}

Attribute = str | int | float


class CaseWriter:
    """Write one case; a context manager.

    Left without an exception, the file is complete under its name. Left with one, nothing is there and the
    unfinished file is removed.

    Parameters
    ----------
    path
        The final name.
    coordinates
        The grid's coordinates, {"x": x} or {"x": x, "y": y}, in the order of the arrays' axes.
    attributes
        Attributes of the file, such as `config`, `digest`, `name` and `tau`. They take precedence over the
        provenance that is added (versions, commit, host, started, finished, wall_seconds), so that a
        resumed case can tell its first start.
    edges
        The edges of the bins of histograms, {"pressure": edges, "gap": edges}, for rows that have them.
    flush_interval
        Seconds after which what has been recorded is handed to the operating system.
    elapsed
        Seconds that went into the case before, added to `wall_seconds`.

    Raises
    ------
    ResultsError
        Here and in every method, when the disk refuses; it names the file.
    """

    def __init__(
        self,
        path: str | Path,
        coordinates: Mapping[str, ArrayLike],
        attributes: Mapping[str, Attribute] | None = None,
        edges: Mapping[str, NDArray[np.float64]] | None = None,
        flush_interval: float = FLUSH_INTERVAL,
        elapsed: float = 0.0,
    ) -> None:
        self.path = Path(path)
        self._coordinates = {name: np.asarray(values) for name, values in coordinates.items()}
        self._shape = tuple(len(values) for values in self._coordinates.values())
        self._attributes = dict(attributes or {})
        self._edges = dict(edges or {})
        self.noted: dict[str, Attribute] = {}
        self._flush_interval, self._elapsed = flush_interval, elapsed
        self._columns: tuple[str, ...] | None = None
        self._growing: dict[str, h5py.Dataset] = {}
        self._held: list[tuple[float | NDArray[np.float64], ...]] = []
        self._rows = 0
        self._last_time = -math.inf

    def __enter__(self) -> Self:
        self._begun = self._flushed = time.monotonic()
        with ExitStack() as stack:
            self._file: NewFile = stack.enter_context(new_file(self.path))
            self._h5 = self._file.h5
            self._h5.attrs.update({**provenance(), "started": now(), **self._attributes})
            self._add_series("time", "time")
            for name, values in self._coordinates.items():
                add_values(self._h5, name, (name,), values)
            for name, values in self._edges.items():
                add_values(self._h5, f"{name}_bin", (f"{name}_bin",), values[:-1])
                add_values(self._h5, f"{name}_bin_end", (f"{name}_bin",), values[1:])
            self._add_series("snapshot", "snapshot")
            self._add_field("displacement")
            self._add_field("pressure")
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            self._stack.__exit__(kind, error, trace)
            return
        with self._stack:
            self._finish()

    @property
    def elapsed(self) -> float:
        """Seconds that went into the case so far."""
        return self._elapsed + time.monotonic() - self._begun

    def row(self, **values: float | NDArray[np.float64]) -> None:
        """Record one accepted step.

        Parameters
        ----------
        values
            `time`, later than the row before, and the columns: numbers, and arrays of histograms. The first
            row decides which there are.

        Raises
        ------
        KeyError
            For a name that the table of variables does not have.
        ValueError
            For columns other than the first row's, no time, or a time that does not grow.
        """
        if self._columns is None:
            self._begin_columns(tuple(values))
        elif values.keys() != set(self._columns):
            raise ValueError(
                f"{self.path}: row has columns {sorted(values)}, the first had {sorted(self._columns)}"
            )
        time_now = float(values["time"])
        if not time_now > self._last_time:
            raise ValueError(f"{self.path}: row at time {time_now} follows one at {self._last_time}")
        self._last_time = time_now
        self._held.append(tuple(values[name] for name in self._columns or ()))
        due = time.monotonic() - self._flushed > self._flush_interval
        if due or len(self._held) == ROWS_HELD:
            self._append_rows()
        if due:
            self._flush()

    def snapshot(
        self,
        time: float,
        displacement: NDArray[np.float64],
        pressure: NDArray[np.float64],
        gap: NDArray[np.float64] | None = None,
    ) -> None:
        """Record the surface at a time: displacement, contact pressure and gap, arrays of the grid's shape.

        The gap is left out from the first snapshot on, or never.

        Raises
        ------
        ValueError
            For arrays of another shape, or a gap that some snapshots lack.
        """
        fields = {"displacement": displacement, "pressure": pressure}
        if gap is not None:
            fields["gap"] = gap
            if not len(self._growing["snapshot"]):
                self._add_field("gap")
        if ("gap" in fields) != ("gap" in self._growing):
            raise ValueError(f"{self.path}: some snapshots have a gap and others have none")
        for name, field in fields.items():
            if np.shape(field) != self._shape:
                raise ValueError(f"{self.path}: {name} of shape {np.shape(field)} on a grid of {self._shape}")
        for name, values in {"snapshot": time, **fields}.items():
            dataset = self._growing[name]
            dataset.resize(len(dataset) + 1, axis=0)
            dataset[-1] = values
        self._file.check()

    def note(self, **attributes: Attribute) -> None:
        """Add attributes of the file that only the run can tell."""
        self.noted.update(attributes)

    def _begin_columns(self, names: tuple[str, ...]) -> None:
        if "time" not in names:
            raise ValueError(f"{self.path}: a row needs its time")
        for name in names:
            variable(name)
        for name in names:
            if name != "time":
                self._add_series(name, "time")
        self._columns = names

    def _add_series(self, name: str, dimension: str) -> None:
        along = variable(name).along
        places = () if along is None else (len(self._h5[along]),)
        self._growing[name] = add_variable(
            self._h5,
            name,
            (dimension,) if along is None else (dimension, along),
            shape=(0, *places),
            maxshape=(None, *places),
            chunks=(ROWS_HELD, *places),
            **({"fletcher32": True} if along is None else PACKED),
        )
        if along is not None:
            self._growing[name].attrs["coordinates"] = f"{along}_end"

    def _add_field(self, name: str) -> None:
        blocks = -(-math.prod(self._shape) // BLOCK)
        rows = -(-self._shape[0] // blocks)
        self._growing[name] = add_variable(
            self._h5,
            name,
            ("snapshot", *self._coordinates),
            shape=(0, *self._shape),
            maxshape=(None, *self._shape),
            chunks=(1, rows, *self._shape[1:]),
            **PACKED,
        )

    def _append_rows(self) -> None:
        if not self._held:
            return
        end = self._rows + len(self._held)
        for name, values in zip(self._columns or (), zip(*self._held, strict=True), strict=True):
            dataset = self._growing[name]
            dataset.resize(end, axis=0)
            dataset[self._rows :] = np.asarray(values, dtype=dataset.dtype)
        self._rows = end
        self._held.clear()
        self._file.check()

    def _flush(self) -> None:
        self._file.flush()
        self._flushed = time.monotonic()

    def _finish(self) -> None:
        self._append_rows()
        ended: dict[str, Attribute] = {"finished": now(), "wall_seconds": self.elapsed}
        counts = {"rows": self._rows, "snapshots": len(self._growing["snapshot"])}
        self._h5.attrs.update({**ended, **self._attributes, **self.noted, **counts, "complete": 1})
        if len(self._shape) == 2 and counts["snapshots"]:
            describe(self._h5, self.path)
