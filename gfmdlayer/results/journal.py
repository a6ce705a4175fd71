"""The journal of a case: its rows and snapshots so far, in a file that survives a killed process.

The unfinished HDF5 file does not. So a journal passes rows and snapshots on to the writer of that file and
appends them to a file of its own, in blocks of numpy arrays:

    number of columns, each column of some rows, times of some snapshots, their displacement, pressure, gap

Blocks are not changed once appended: up to a position, the file stays good whatever follows it.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO, Protocol, Self

import numpy as np
from numpy.typing import NDArray

HELD = 1 << 24  # bytes held in memory at most, before they are appended

Field = NDArray[np.float64]


class Recorder(Protocol):
    """Records the results of a simulation."""

    def row(self, **values: float | Field) -> None:
        """Record the observables of an accepted step: numbers, and histograms."""
        ...

    def snapshot(self, time: float, displacement: Field, pressure: Field, gap: Field, /) -> None:
        """Record the surface at one of the times of `output.snapshots`."""
        ...

    def note(self, **attributes: float) -> None:
        """Record results of the run as a whole."""
        ...


@dataclass(frozen=True)
class Position:
    """Position up to which a journal is good.

    Attributes
    ----------
    file : str
        Name of the journal's file.
    columns : tuple of str
        Columns of the rows.
    arrays : int
        Number of arrays up to the position.
    checksum : int
        CRC-32 of these arrays.
    """

    file: str
    columns: tuple[str, ...] = ()
    arrays: int = 0
    checksum: int = 0

    @classmethod
    def of(cls, plain: dict[str, Any]) -> Self:
        """Make a position from the plain data of `plain`."""
        return cls(**{**plain, "columns": tuple(plain["columns"])})

    def plain(self) -> dict[str, Any]:
        """Return the position as plain data, as JSON has it."""
        return asdict(self)


class Journal:
    """A recorder that writes a journal and passes everything on to another recorder.

    Parameters
    ----------
    path : Path
        File of the journal. It is created, in place of an earlier one, when the first block is appended.
    recorder : Recorder
        The other recorder.
    """

    def __init__(self, path: Path, recorder: Recorder) -> None:
        self._path, self._recorder = path, recorder
        self._file: BinaryIO | None = None
        self._good = Position(path.name)
        self._end = 0
        self._clear()
        self._failure: OSError | None = None

    def row(self, **values: float | Field) -> None:
        """Record the observables of an accepted step: numbers, and histograms."""
        self._recorder.row(**values)
        self._columns = tuple(values)
        self._rows.append(tuple(values.values()))
        self._count(sum(map(np.size, values.values())) * 8)

    def snapshot(self, time: float, displacement: Field, pressure: Field, gap: Field, /) -> None:
        """Record the surface at one of the times of `output.snapshots`."""
        self._recorder.snapshot(time, displacement, pressure, gap)
        self._times.append(time)
        self._fields += displacement, pressure, gap
        self._count(3 * gap.nbytes)

    def note(self, **attributes: float) -> None:
        """Pass on results of the run as a whole; they come at the end, after the last checkpoint."""
        self._recorder.note(**attributes)

    def replay(self, position: Position) -> None:
        """Record the contents of another journal in the same folder, up to a position.

        Raises
        ------
        ValueError
            If that journal is damaged before the position; then nothing is recorded.
        """
        source, checksum = self._path.with_name(position.file), 0
        try:
            for array in _arrays(source, position.arrays):
                checksum = zlib.crc32(np.ascontiguousarray(array).data, checksum)
        except (OSError, ValueError, EOFError) as error:
            raise ValueError(f"{source.name}, which belongs to it, cannot be read ({error})") from None
        if checksum != position.checksum:
            raise ValueError(f"{source.name}, which belongs to it, is damaged")
        arrays = _arrays(source, position.arrays)
        for (columns,) in arrays:
            values = [next(arrays) for _ in range(columns)]
            for row in zip(*values, strict=True):
                self.row(**dict(zip(position.columns, row, strict=True)))
            for time in next(arrays).tolist():
                self.snapshot(time, next(arrays), next(arrays), next(arrays))

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
        self._rows: list[tuple[float | Field, ...]] = []
        self._times: list[float] = []
        self._fields: list[Field] = []
        self._size = 0

    def _append(self) -> None:
        if self._size == 0:
            return
        if self._file is None:
            self._path.unlink(missing_ok=True)  # a dying process may still be writing to it
            self._file = self._path.open("xb")
        self._file.seek(self._end)  # overwrites what a failed attempt may have left
        columns = [np.array(values) for values in zip(*self._rows, strict=True)]
        arrays = [np.array([len(columns)]), *columns, np.array(self._times), *self._fields]
        checksum = self._good.checksum
        for array in arrays:
            np.save(self._file, array, allow_pickle=False)
            checksum = zlib.crc32(np.ascontiguousarray(array).data, checksum)
        self._file.flush()
        self._end = self._file.tell()
        self._good = Position(self._path.name, self._columns, self._good.arrays + len(arrays), checksum)
        self._clear()


def _arrays(path: Path, count: int) -> Iterator[NDArray[Any]]:
    if count == 0:  # an empty journal has no file
        return
    with path.open("rb") as file:
        for _ in range(count):
            yield np.load(file, allow_pickle=False)
