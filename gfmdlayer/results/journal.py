"""The journal of a case: its rows and snapshots so far, in a file that survives a killed process.

The unfinished HDF5 file does not. So a journal passes rows and snapshots on to the writer of that file and
appends them to a file of its own, in blocks of numpy arrays:

    numbers of columns and of fields, each column of some rows, times of some snapshots, their fields

Blocks are not changed once appended: up to a position, the file stays good whatever follows it. A resumed
case goes on at the position of its checkpoint.
"""

from __future__ import annotations

import io
import os
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import Attribute, FloatArray
from gfmdlayer.files.locks import no_link
from gfmdlayer.observables import Column
from gfmdlayer.results.provenance import now, provenance
from gfmdlayer.results.schema import FIELDS, VARIABLES, Variable

if TYPE_CHECKING:
    import xarray


HELD = 1 << 24  # bytes held in memory at most, before they are appended


class Recorder(Protocol):
    """Records the results of a simulation."""

    def row(self, **values: float | FloatArray) -> None:
        """Record the columns of an accepted step: numbers, and histograms."""
        ...

    def snapshot(
        self,
        time: float,
        displacement: FloatArray,
        pressure: FloatArray,
        gap: FloatArray,
        traction: FloatArray | None = None,
        /,
    ) -> None:
        """Record the surface at a time, by arrays of the grid's shape; the traction with attraction alone."""
        ...

    def note(self, **attributes: Attribute) -> None:
        """Record attributes of the run that are known at its end."""
        ...


class Position(NamedTuple):
    """Position up to which a journal is good.

    Attributes
    ----------
    columns : sequence of str
        Columns of the rows.
    size : int
        Bytes up to the position.
    checksum : int
        CRC-32 of these bytes.
    """

    columns: Sequence[str] = ()
    size: int = 0
    checksum: int = 0


class Journal:
    """A recorder that writes a journal and passes everything on to another recorder.

    Parameters
    ----------
    path : Path
        File of the journal. Without `replay` it is created, in place of an earlier one, when the first
        block is appended.
    recorder : Recorder
        The other recorder.
    """

    def __init__(self, path: Path, recorder: Recorder) -> None:
        self._path, self._recorder = path, recorder
        self._file: BinaryIO | None = None
        self._columns: Sequence[str] = ()
        self._good = Position()
        self._clear()
        self._failure: OSError | None = None

    def row(self, **values: float | FloatArray) -> None:
        """Record the observables of an accepted step: numbers, and histograms."""
        self._recorder.row(**values)
        self._columns = self._columns or list(values)
        self._rows.append(tuple(values[name] for name in self._columns))
        self._count(sum(map(np.size, values.values())) * 8)

    def snapshot(
        self,
        time: float,
        displacement: FloatArray,
        pressure: FloatArray,
        gap: FloatArray,
        traction: FloatArray | None = None,
        /,
    ) -> None:
        """Record the surface at one of the times of `output.snapshots`."""
        fields = displacement, pressure, gap, *([] if traction is None else [traction])
        self._recorder.snapshot(time, *fields)
        self._times.append(time)
        self._fields += fields
        self._count(len(fields) * gap.nbytes)

    def note(self, **attributes: Attribute) -> None:
        """Pass on results of the run as a whole; they come at the end, after the last checkpoint."""
        self._recorder.note(**attributes)

    def accept(self, position: Position) -> None:
        """Go on behind a position in the file.

        Raises
        ------
        ValueError
            If the file is damaged before the position.
        """
        if position.size == 0:  # an empty journal has no file
            return
        try:
            file = open(self._path, "r+b", opener=no_link)  # noqa: SIM115 - it stays open
        except OSError as error:
            raise ValueError(f"{self._path.name}, which belongs to it, cannot be read ({error})") from None
        self._file = file
        left, checksum = position.size, 0
        while left and (part := file.read(min(left, 1 << 20))):
            left, checksum = left - len(part), zlib.crc32(part, checksum)
        if left or checksum != position.checksum:
            raise ValueError(f"{self._path.name}, which belongs to it, is damaged")
        self._good, self._columns = position, position.columns

    def replay(self, position: Position) -> None:
        """Pass on the contents of the file up to a position, behind which later records are appended.

        Raises
        ------
        ValueError
            If the file is damaged before the position; then nothing is passed on.
        """
        if self._file is None:
            self.accept(position)
        if self._file is None:
            return
        file = self._file
        file.seek(0)
        while file.tell() < position.size:
            columns, fields = np.load(file).tolist()
            values = [np.load(file) for _ in range(columns)]
            for row in zip(*values, strict=True):
                self._recorder.row(**dict(zip(position.columns, row, strict=True)))
            for instant in np.load(file).tolist():
                self._recorder.snapshot(instant, *(np.load(file) for _ in range(fields)))

    def kept(self) -> Position:
        """Bring all records to the disk and return the position behind them.

        Raises
        ------
        OSError
            If they cannot be written.
        """
        if self._failure is not None:
            raise self._failure
        self._append()
        if self._file is not None:
            os.fsync(self._file.fileno())
        return self._good

    def close(self) -> None:
        """Close the file without removing it."""
        if self._file is not None:
            with suppress(OSError):
                self._file.close()

    def _count(self, size: int) -> None:
        self._size += size
        if self._size > HELD:
            try:
                self._append()
            except OSError as error:  # the case goes on, but no later position is good without these
                self._failure = error
        if self._failure is not None:
            self._clear()

    def _clear(self) -> None:
        self._rows: list[tuple[float | FloatArray, ...]] = []
        self._times: list[float] = []
        self._fields: list[FloatArray] = []
        self._size = 0

    def _append(self) -> None:
        if self._size == 0:
            return
        if self._file is None:
            self._path.unlink(missing_ok=True)  # a dying process may still be writing to it
            self._file = self._path.open("xb")
        self._file.seek(self._good.size)  # overwrites what a failed attempt may have left
        columns = [np.array(values) for values in zip(*self._rows, strict=True)]
        size, checksum = self._good.size, self._good.checksum
        head = np.array([len(columns), len(self._fields) // max(len(self._times), 1)])
        for array in (head, *columns, np.array(self._times), *self._fields):
            for part in _npy(array):
                size, checksum = size + self._file.write(part), zlib.crc32(part, checksum)
        self._file.flush()
        self._good = Position(self._columns, size, checksum)
        self._clear()


def _npy(array: NDArray[Any]) -> tuple[Any, Any]:
    """Return the head and the contents of a .npy file of an array, without a copy of a field."""
    whole, head = np.ascontiguousarray(array), io.BytesIO()
    np.lib.format.write_array_header_1_0(head, np.lib.format.header_data_from_array_1_0(whole))
    return head.getbuffer(), whole.reshape(-1).view(np.uint8).data


# The results of one case in memory: the dataset that opening its file would give.


class Recording:
    """A recorder in memory."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []
        self.fields: list[tuple[Any, ...]] = []  # time, then some of FIELDS
        self.noted: dict[str, Attribute] = {}
        self._started, self._begun = now(), time.monotonic()

    def row(self, **values: float | FloatArray) -> None:
        """Keep the observables of a step."""
        self.rows.append(values)

    def snapshot(
        self,
        time: float,
        displacement: FloatArray,
        pressure: FloatArray,
        gap: FloatArray,
        traction: FloatArray | None = None,
        /,
    ) -> None:
        """Keep time, displacement, pressure and gap, and the traction if there is attraction."""
        fields = displacement, pressure, gap, *([] if traction is None else [traction])
        self.fields.append((time, *fields))

    def note(self, **attributes: Attribute) -> None:
        """Keep attributes of the run."""
        self.noted.update(attributes)

    def dataset(
        self,
        coordinates: Mapping[str, ArrayLike],
        columns: Sequence[Column],
        attributes: Mapping[str, str | float],
        unit: Callable[[str], str] = str,
    ) -> xarray.Dataset:
        """Return what has been recorded.

        Parameters
        ----------
        coordinates : mapping
            The grid's coordinates, {"x": x} or {"x": x, "y": y}.
        columns : sequence of Column
            Columns that the rows may have.
        attributes : mapping
            Attributes of the case, in addition to the provenance.
        unit : callable
            Label of a unit, from its words.

        Returns
        -------
        xarray.Dataset
            As `open_case` gives it.
        """
        import xarray

        columns = [column.in_units(unit) for column in columns]
        known = {name: each.in_units(unit) for name, each in VARIABLES.items()}
        held: dict[str, Any] = {
            name: ((name,), np.asarray(x, dtype=np.float64), known[name].described)
            for name, x in coordinates.items()
        }
        held |= self._columns(columns)
        held |= self._snapshots({name: len(held[name][1]) for name in coordinates}, known)
        ended = {"started": self._started, "finished": now(), "wall_seconds": time.monotonic() - self._begun}
        counts = {"rows": len(self.rows), "snapshots": len(self.fields), "complete": 1}
        described = {**provenance(), **ended, **attributes, **self.noted, **counts}
        indices = {name for name, (dims, *_) in held.items() if dims == (name,)}
        ends = {f"{each.along.name}_end" for each in columns if each.along is not None}
        coords = {name: held.pop(name) for name in indices | (ends & held.keys())}
        return xarray.Dataset(held, coords, described)

    def _columns(self, columns: Sequence[Column]) -> dict[str, Any]:
        declared = {column.name: column for column in columns}
        names = self.rows[0] if self.rows else ("time",)
        found: dict[str, Any] = {}
        for each in (declared[name] for name in names):
            values = np.array([row[each.name] for row in self.rows], dtype=each.dtype)
            found[each.name] = (
                ("time", each.along.name) if each.along else ("time",),
                values,
                each.described,
            )
            if each.along is not None:
                bins = each.along
                for name, end, edges in (
                    (bins.name, "lower", bins.edges[:-1]),
                    (f"{bins.name}_end", "upper", bins.edges[1:]),
                ):
                    meaning = {"long_name": f"{end} end of the bin of {bins.quantity}", "units": bins.units}
                    found[name] = ((bins.name,), np.array(edges), meaning)
        return found

    def _snapshots(self, lengths: Mapping[str, int], known: Mapping[str, Variable]) -> dict[str, Any]:
        times = np.array([time for time, *_ in self.fields], dtype=np.float64)
        found: dict[str, Any] = {"snapshot": (("snapshot",), times, known["snapshot"].described)}
        for place, name in enumerate(FIELDS, start=1):
            if place < len(self.fields[0]) if self.fields else place <= 2:  # as in a file
                values = np.reshape([fields[place] for fields in self.fields], (-1, *lengths.values()))
                found[name] = (("snapshot", *lengths), values, known[name].described)
        return found
