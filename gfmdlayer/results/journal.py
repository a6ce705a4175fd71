"""What a case has recorded so far, beside its unfinished file, of which a killed process leaves nothing.

A journal passes rows and snapshots on to a recorder and appends them to a file of its own, a part at a time,
each a series of numpy arrays. Nothing that has been appended is touched again, so that a position in the file
stays good whatever happens to what follows it.
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

HELD = 1 << 24  # bytes gathered in memory before they are appended

Field = NDArray[np.float64]


class Recorder(Protocol):
    """Takes what a simulation finds."""

    def row(self, **values: float | Field) -> None:
        """Take the observables of an accepted step: numbers, and histograms."""
        ...

    def snapshot(self, time: float, displacement: Field, pressure: Field, gap: Field, /) -> None:
        """Take the surface at an asked time."""
        ...

    def note(self, **attributes: float) -> None:
        """Take what became known of the run as a whole."""
        ...


@dataclass(frozen=True)
class Position:
    """How far a journal is good: its file, the columns of its rows, the number and checksum of its arrays."""

    file: str
    columns: tuple[str, ...] = ()
    arrays: int = 0
    checksum: int = 0

    @classmethod
    def of(cls, plain: dict[str, Any]) -> Self:
        """Make it from what `plain` returned."""
        return cls(**{**plain, "columns": tuple(plain["columns"])})

    def plain(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


class Journal:
    """A recorder that keeps what it passes on.

    Parameters
    ----------
    path : Path
        Its file, made when there is something to append; one that is there is replaced.
    recorder : Recorder
        Takes everything as well.
    """

    def __init__(self, path: Path, recorder: Recorder) -> None:
        self._path, self._recorder = path, recorder
        self._file: BinaryIO | None = None
        self._good = Position(path.name)
        self._end = 0
        self._forget()
        self._lost: OSError | None = None

    def row(self, **values: float | Field) -> None:
        """Take the observables of an accepted step: numbers, and histograms."""
        self._recorder.row(**values)
        self._columns = tuple(values)
        self._rows.append(tuple(values.values()))
        self._hold(sum(map(np.size, values.values())) * 8)

    def snapshot(self, time: float, displacement: Field, pressure: Field, gap: Field, /) -> None:
        """Take the surface at an asked time."""
        self._recorder.snapshot(time, displacement, pressure, gap)
        self._times.append(time)
        self._fields += displacement, pressure, gap
        self._hold(3 * gap.nbytes)

    def note(self, **attributes: float) -> None:
        """Pass on what became known of the run as a whole, which it only is at the end."""
        self._recorder.note(**attributes)

    def replay(self, position: Position) -> None:
        """Record what another journal in the same folder holds up to a position.

        Raises
        ------
        ValueError
            Where it does not hold that any more, before anything is recorded.
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
        """Bring everything to the disk and return the position that it has.

        Raises
        ------
        OSError
            Where the disk refuses.
        """
        if self._lost is not None:
            raise self._lost
        self._append()
        if self._file is not None:
            os.fsync(self._file.fileno())
        return self._good

    def close(self) -> None:
        """Close the file; it stays."""
        if self._file is not None:
            with suppress(OSError):
                self._file.close()

    def _hold(self, size: int) -> None:
        self._size += size
        if self._size > HELD:
            try:
                self._append()
            except OSError as error:  # the case goes on, but what is dropped here cannot be made up for
                self._lost = error
        if self._lost is not None:
            self._forget()

    def _forget(self) -> None:
        self._rows: list[tuple[float | Field, ...]] = []
        self._times: list[float] = []
        self._fields: list[Field] = []
        self._size = 0

    def _append(self) -> None:
        if self._size == 0:
            return
        if self._file is None:
            self._path.unlink(missing_ok=True)  # which a dying process may still be writing
            self._file = self._path.open("xb")
        self._file.seek(self._end)  # over what a failed attempt may have left
        columns = [np.array(values) for values in zip(*self._rows, strict=True)]
        arrays = [np.array([len(columns)]), *columns, np.array(self._times), *self._fields]
        checksum = self._good.checksum
        for array in arrays:
            np.save(self._file, array, allow_pickle=False)
            checksum = zlib.crc32(np.ascontiguousarray(array).data, checksum)
        self._file.flush()
        self._end = self._file.tell()
        self._good = Position(self._path.name, self._columns, self._good.arrays + len(arrays), checksum)
        self._forget()


def _arrays(path: Path, count: int) -> Iterator[NDArray[Any]]:
    if count == 0:  # then there is no file
        return
    with path.open("rb") as file:
        for _ in range(count):
            yield np.load(file, allow_pickle=False)
