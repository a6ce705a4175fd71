"""The rows and snapshots of a case before they become its file: on the disk, or in memory.

An HDF5 file does not survive a killed process; a file of .npy arrays that only grows does. So a run records
into a journal, and its HDF5 file is written from the journal at the end. The journal is a sequence of blocks:

    (columns), the columns of some rows
    (0, places of the fields in `schema.SNAPSHOT_FIELDS`, from 1), the time of a snapshot, its fields

A block never changes. A checkpoint holds the position behind the last one; a resumed case goes on there, over
whatever follows.
"""

from __future__ import annotations

import io
import os
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.lib import format as npy
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import Attribute, FloatArray
from gfmdlayer.files.locks import regular_and_no_link
from gfmdlayer.observables import Column
from gfmdlayer.results.provenance import now, provenance
from gfmdlayer.results.schema import BELOW, FIELDS, VARIABLES, ResultsError

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.body.solid import LayerDepth
    from gfmdlayer.grid.grid import Grid

HELD = 1 << 24  # bytes in memory at most, before they are written
_BLOCK = 1 << 20  # points of a field that the first rank gets from the others at a time


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
        /,
        *others: FloatArray | None,
    ) -> None:
        """Record the surface at a time, by arrays or None in the order of `schema.SNAPSHOT_FIELDS`."""
        ...

    def note(self, **attributes: Attribute) -> None:
        """Record attributes of the run that are known at its end."""
        ...


class Position(NamedTuple):
    """A place in a journal: the columns of its rows, the bytes before the place and their CRC-32."""

    columns: Sequence[str] = ()
    size: int = 0
    checksum: int = 0


class Journal:
    """A recorder that keeps rows and snapshots in memory, and in a file above `held` bytes.

    The file replaces an earlier one when it is first written. Of several ranks only the first one writes.
    """

    def __init__(self, path: Path, grid: Grid | None = None, held: int = HELD) -> None:
        self._path, self._held = path, held
        self._shared = grid if grid is not None and grid.ranks.count > 1 else None
        self._writes = grid is None or grid.ranks.first
        self._file: io.FileIO | None = None
        self._good = Position()
        self._columns: Sequence[str] = ()
        self._clear()
        self.noted: dict[str, Attribute] = {}

    def row(self, **values: float | FloatArray) -> None:
        """Record the columns of an accepted step: numbers, and histograms."""
        if self._writes:
            self._columns = self._columns or list(values)
            self._rows.append(tuple(values[name] for name in self._columns))
            self._count(sum(map(np.size, values.values())) * 8)

    def snapshot(self, time: float, /, *fields: FloatArray | None) -> None:
        """Record the surface at one of the times of `output.snapshots`."""
        if self._shared is not None:
            self._gather(self._shared, time, fields)
        else:
            self._snapshots.append((time, fields))
            self._count(sum(field.nbytes for field in fields if field is not None))

    def note(self, **attributes: Attribute) -> None:
        """Record attributes of the run; they come at its end, after the last checkpoint."""
        if self._writes:
            self.noted |= attributes

    def go_on(self, position: Position) -> None:
        """Go on behind a position of the file; a ValueError if the file is damaged before it."""
        if position.size == 0:  # an empty journal has no file
            return
        try:
            self._file = _opened(self._path, "r+b")
        except OSError as error:
            raise ValueError(f"{self._path.name}, which belongs to it, cannot be read ({error})") from None
        self._good, self._columns = position, position.columns
        if not self._is_intact(self._file):
            raise ValueError(f"{self._path.name}, which belongs to it, is damaged")

    def replay(self, recorder: Recorder) -> None:
        """Pass everything on to a recorder, a block at a time; ResultsError if the file is damaged."""
        if self._file is not None:
            if not self._is_intact(self._file):
                raise ResultsError(f"{self._path}: is damaged")
            self._file.seek(0)
            while (file := self._file).tell() < self._good.size:
                columns, *places = npy.read_array(file).tolist()
                values = [npy.read_array(file) for _ in range(columns)]
                for row in zip(*values, strict=True):
                    recorder.row(**dict(zip(self._columns, row, strict=True)))
                if places:
                    instant, held = float(npy.read_array(file)), {place: _mapped(file) for place in places}
                    given: list[Any] = [held.get(place + 1) for place in range(places[-1])]
                    recorder.snapshot(instant, *given)
        for row in self._rows:
            recorder.row(**dict(zip(self._columns, row, strict=True)))
        for instant, fields in self._snapshots:
            recorder.snapshot(instant, *fields)
        recorder.note(**self.noted)

    def kept(self) -> Position:
        """Bring everything to the disk; return the position behind it. What fails stays in memory."""
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
        if self._size > self._held:
            try:
                self._append()
            except OSError as error:
                raise self._unwritten(error) from error

    def _clear(self) -> None:
        self._rows: list[tuple[float | FloatArray, ...]] = []
        self._snapshots: list[tuple[float, tuple[Any, ...]]] = []  # time and fields, None where not given
        self._size = 0

    def _append(self) -> None:
        """Write the rows and snapshots in memory."""
        arrays = []
        if self._rows:
            columns = [np.array(values) for values in zip(*self._rows, strict=True)]
            arrays += [np.array([len(columns)]), *columns]
        for instant, fields in self._snapshots:
            given = [field for field in fields if field is not None]
            arrays += [_places(fields), np.array(instant), *given]
        if arrays:
            self._write(part for array in arrays for part in (_head(array.dtype, array.shape), array))
            self._clear()

    def _gather(self, grid: Grid, time: float, fields: tuple[FloatArray | None, ...]) -> None:
        """Write a snapshot of which each rank holds a part."""
        rows = max(1, _BLOCK // grid.points[1])

        def parts() -> Iterator[Any]:
            for array in (_places(fields), np.array(time)):
                yield from (_head(array.dtype, array.shape), array)
            for field in (each for each in fields if each is not None):
                first = field.shape[: field.ndim - len(grid.points)]  # depths or springs
                yield _head(field.dtype, (*first, *grid.points))
                for part in field.reshape(-1, *grid.shape):
                    yield from (block for _, block in grid.blocks(part, rows))

        every = parts()
        try:
            if self._writes:
                self._append()
                self._write(every)
        except OSError as error:
            raise self._unwritten(error) from error
        finally:
            for _ in every:  # also after a failure the other ranks must get rid of theirs
                pass

    def _write(self, parts: Iterator[Any]) -> None:
        """Write bytes and arrays behind the good part; after an error they are no part of it."""
        if self._file is None:
            self._path.unlink(missing_ok=True)  # a dying process may still be writing to it
            self._file = _opened(self._path, "x+b")
        size, checksum = self._good.size, self._good.checksum
        self._file.seek(size)
        for part in parts:
            left = np.ascontiguousarray(part).reshape(-1).view(np.uint8).data
            size, checksum = size + len(left), zlib.crc32(left, checksum)
            while left:
                left = left[self._file.write(left) :]
        self._good = Position(self._columns, size, checksum)

    def _unwritten(self, error: OSError) -> ResultsError:
        return ResultsError(f"{self._path}: cannot be written: {error.strerror or error}")

    def _is_intact(self, file: io.FileIO) -> bool:
        file.seek(0)
        left, checksum = self._good.size, 0
        while left and (part := file.read(min(left, 1 << 20))):
            left, checksum = left - len(part), zlib.crc32(part, checksum)
        return not left and checksum == self._good.checksum


def _places(fields: Sequence[FloatArray | None]) -> NDArray[np.int64]:
    """Return what comes before a snapshot: no columns, and the places of the fields that are given."""
    return np.array([0, *(place for place, field in enumerate(fields, start=1) if field is not None)])


def _opened(path: Path, mode: str) -> io.FileIO:
    file: io.FileIO = open(path, mode, buffering=0, opener=regular_and_no_link)  # type: ignore[assignment] # noqa: SIM115
    return file


def _head(dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return the head of a .npy file; it ends at a multiple of 64 bytes."""
    head = io.BytesIO()
    described = {"descr": npy.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    npy.write_array_header_1_0(head, described)
    return np.frombuffer(head.getvalue(), np.uint8)


def _mapped(file: io.FileIO) -> FloatArray:
    """Return the array at the place in a file, of which HDF5 reads a part at a time."""
    npy.read_magic(file)
    shape, _, dtype = npy.read_array_header_1_0(file)
    field = np.memmap(file, dtype, "r", file.tell(), shape)
    file.seek(field.offset + field.nbytes)
    return field


# The results of one case in memory: the dataset that opening its file would give.


class Recording:
    """A recorder in memory."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []
        self.fields: list[tuple[Any, ...]] = []  # time, and those of SNAPSHOT_FIELDS, None if not given
        self.noted: dict[str, Attribute] = {}
        self._started, self._begun = now(), time.monotonic()

    def row(self, **values: float | FloatArray) -> None:
        """Keep the observables of a step."""
        self.rows.append(values)

    def snapshot(self, time: float, /, *fields: FloatArray | None) -> None:
        """Keep time, displacement, pressure and gap, and traction or imprint where there is one."""
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
        places: Sequence[LayerDepth] = (),
    ) -> xarray.Dataset:
        """Return the results as `open_case` gives them; `places` are those below the surface."""
        import xarray

        columns = [column.in_units(unit) for column in columns]
        known = {name: each.in_units(unit) for name, each in VARIABLES.items()}
        held: dict[str, Any] = {
            name: ((name,), np.asarray(x, dtype=np.float64), known[name].described)
            for name, x in coordinates.items()
        }
        held |= self._columns(columns)
        lengths = {name: len(held[name][1]) for name in coordinates}
        held |= self._snapshots(lengths, known) | self._below(lengths, known, places)
        ended = {"started": self._started, "finished": now(), "wall_seconds": time.monotonic() - self._begun}
        counts = {"rows": len(self.rows), "snapshots": len(self.fields), "complete": 1}
        described = {**provenance(), **ended, **attributes, **self.noted, **counts}
        indices = {name for name, (dims, *_) in held.items() if dims == (name,)}
        ends = {name for each in columns if each.along is not None for name, *_ in each.along.ends}
        coords = {name: held.pop(name) for name in indices | (ends & held.keys()) | ({"layer"} & held.keys())}
        return xarray.Dataset(held, coords, described)

    def _columns(self, columns: Sequence[Column]) -> dict[str, Any]:
        declared = {column.name: column for column in columns}
        names = self.rows[0] if self.rows else ("time",)
        found: dict[str, Any] = {}
        for each in (declared[name] for name in names):
            values = np.array([row[each.name] for row in self.rows], dtype=each.dtype)
            dimensions = ("time", each.along.name) if each.along else ("time",)
            found[each.name] = (dimensions, values, each.described)
            if each.along is not None:
                for name, edges, meaning in each.along.ends:
                    found[name] = ((each.along.name,), np.array(edges), meaning)
        return found

    def _snapshots(self, lengths: Mapping[str, int], known: Mapping[str, Column]) -> dict[str, Any]:
        times = np.array([time for time, *_ in self.fields], dtype=np.float64)
        found: dict[str, Any] = {"snapshot": (("snapshot",), times, known["snapshot"].described)}
        first = self.fields[0] if self.fields else (0.0, 0.0, 0.0)  # as in a file
        for place, name in enumerate(FIELDS[: len(first) - 1], start=1):
            if first[place] is not None:
                values = np.reshape([fields[place] for fields in self.fields], (-1, *lengths.values()))
                found[name] = (("snapshot", *lengths), values, known[name].described)
        return found

    def _below(
        self, lengths: Mapping[str, int], known: Mapping[str, Column], places: Sequence[LayerDepth]
    ) -> dict[str, Any]:
        """Return the fields below the surface, NaN in the snapshots that have none."""
        found: dict[str, Any] = {}
        for at, (name, first) in enumerate(BELOW.items(), start=1 + len(FIELDS)):
            given = [fields[at] if at < len(fields) else None for fields in self.fields]
            example = next((each for each in given if each is not None), None)
            if example is None:
                continue
            values = np.full((len(given), *np.shape(example)), np.nan, dtype=known[name].dtype)
            for i, each in enumerate(given):
                if each is not None:
                    values[i] = each
            found[name] = ((("snapshot", first, *lengths)), values, known[name].described)
            rows = [place.depth for place in places] if first == "z" else range(len(example))
            found[first] = ((first,), np.array(rows), known[first].described)
        if "z" in found:
            layers = np.array([place.layer for place in places])
            found["layer"] = (("z",), layers, known["layer"].described)
        return found
