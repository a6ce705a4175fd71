"""The rows, snapshots and attributes of a case, until its file or its dataset is made of them.

Rows lie in blocks that never move, each as long as all before it; a checkpoint contains them. Snapshots may
be large. Those of a case that is computed into a folder lie in a file that only grows: those above `held`
bytes, and all at each checkpoint, which knows where they are in the file. So no checkpoint writes a snapshot
again, and a resumed case goes on over whatever lies behind those of its checkpoint.
"""

from __future__ import annotations

import io
import math
import os
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import Attribute, FloatArray
from gfmdlayer.files.locks import regular_and_no_link
from gfmdlayer.results import provenance
from gfmdlayer.results.names import BELOW, FIELDS, SAME_TIME, VARIABLES, ResultsError
from gfmdlayer.results.netcdf import naming

if TYPE_CHECKING:
    from gfmdlayer.grid.grid import Grid

HELD = 1 << 24  # bytes of snapshots in memory at most, before they are written
FEWEST, MOST = 256, 1 << 16  # rows of a block
_BROUGHT = 1 << 20  # points of a field that the first rank gets from the others at a time
_KEPT = "recording."  # begins the names of its arrays in a checkpoint
_ALIGNED = 64  # bytes; each field in the file begins at a multiple


class Recording:
    """A recorder that keeps everything: in memory, and snapshots in a file where there is a `path`.

    The file replaces an earlier one when it is first written. Of several ranks only the first one keeps rows
    and snapshots.

    Attributes
    ----------
    widths : dict
        Numbers of each column in a row, in the order of the columns.
    times : list of float
        Times of the snapshots.
    noted : dict
        Attributes of the run.
    started : str
        When the case began.
    spent : float
        Seconds of earlier runs of the case.
    """

    def __init__(self, path: Path | None = None, grid: Grid | None = None, held: int = HELD) -> None:
        self._path, self._held = path, held
        self._shared = grid if grid is not None and grid.ranks.count > 1 else None
        self._keeps = grid is None or grid.ranks.first
        self.widths: dict[str, int] = {}
        self._names: tuple[str, ...] = ()
        self._bounds: dict[str, tuple[int, int]] = {}
        self._blocks: list[FloatArray] = []
        self._filled = self._before = 0  # rows of the last block, and of those before it
        self._last_time = -math.inf
        self._numbers: bool | None = None  # whether no column is a distribution, known from the first row on
        self.times: list[float] = []
        self._kinds: dict[str, tuple[np.dtype[Any], tuple[int, ...]]] = {}  # types and shapes of the fields
        # Fields are arrays, or places in the file; None in a snapshot that has none of this name.
        self._fields: dict[str, list[NDArray[Any] | int | None]] = {}
        self._size = 0  # bytes of those in memory
        self._file: io.FileIO | None = None
        # Snapshots in the file; its bytes that are fields, and their CRC-32.
        self._written, self._good, self._checksum = 0, 0, 0
        self.noted: dict[str, Attribute] = {}
        self.started, self.spent, self._begun = provenance.now(), 0.0, time.monotonic()

    # The recorder.

    def row(self, **values: float | FloatArray) -> None:
        """Record an accepted step: its `time`, later than in the row before, and the other columns.

        All rows have the columns of the first, numbers and distributions.
        """
        if not self._keeps:
            return
        if tuple(values) != self._names:
            values = self._in_order(values)
        instant = values["time"]
        self._must_follow(float(instant))
        if not self._blocks or self._filled == len(self._blocks[-1]):
            rows = min(max(self.count, FEWEST), MOST)
            self._add(np.empty((rows, sum(self.widths.values()))), 0)
        row = self._blocks[-1][self._filled]
        if self._numbers is None:
            self._numbers = not any(map(np.ndim, values.values()))
        if self._numbers:
            row[:] = list(values.values())
        else:
            for value, (start, end) in zip(values.values(), self._bounds.values(), strict=True):
                row[start:end] = value
        self._filled += 1
        self._last_time = float(instant)

    def snapshot(self, time: float, fields: Mapping[str, NDArray[Any]]) -> None:
        """Record the surface at a time by its fields.

        Those of the surface itself are in every snapshot or in none; those below it, whose first axis are
        depths or springs, may be in some.
        """
        self._must_fit(fields)
        held: Mapping[str, NDArray[Any] | int] = fields
        if self._shared is not None:
            held = self._brought(self._shared, fields)
            self._written += 1
        for name in fields:
            self._fields.setdefault(name, [None] * len(self.times))
        for name, every in self._fields.items():
            every.append(held.get(name))
        self.times.append(time)
        self._size += sum(field.nbytes for field in held.values() if isinstance(field, np.ndarray))
        if self._path is not None and self._size > self._held:
            with naming(self._path):
                self._write()

    def note(self, **attributes: Attribute) -> None:
        """Record attributes of the run; they come at its end, after the last checkpoint."""
        if self._keeps:
            self.noted |= attributes

    # Contents.

    @property
    def count(self) -> int:
        """Number of rows."""
        return self._before + self._filled

    @property
    def elapsed(self) -> float:
        """Seconds spent on the case, those of earlier runs included."""
        return self.spent + time.monotonic() - self._begun

    def parts(self, name: str) -> list[FloatArray]:
        """Return a column as views of the blocks of rows."""
        if name not in self.widths:
            return []
        start, end = self._bounds[name]
        place = start if end == start + 1 else slice(start, end)
        return [block[:, place] for block in self._trimmed]

    def __getitem__(self, name: str) -> FloatArray:
        """Return a column of the rows."""
        return np.concatenate(self.parts(name))

    def last(self, name: str) -> float:
        """Return the last value of a column."""
        return float(self.parts(name)[-1][-1])

    def at(self, name: str, times: Iterable[float]) -> FloatArray:
        """Return the values of a column at times that are rows."""
        known, rows = self["time"], []
        for wanted in times:
            rows.append(int(np.argmin(np.abs(known - wanted))))
            if abs(known[rows[-1]] - wanted) > SAME_TIME * known[-1]:
                raise ValueError(f"no row at t = {wanted:g}")
        return self[name][rows]

    @property
    def fields(self) -> dict[str, list[Any]]:
        """The fields of the snapshots by name, None where a snapshot has none; views of the file, if any.

        ResultsError if the file is damaged.
        """
        raw = np.empty(0, np.uint8)
        if self._file is not None and self._good:
            if not self._is_intact(self._file):
                raise ResultsError(f"{self._path}: is damaged")
            raw = np.asarray(np.memmap(self._file, np.uint8, "r"))
        fields: dict[str, list[Any]] = {}
        for name, every in self._fields.items():
            dtype, shape = self._kinds[name]
            size = math.prod(shape) * dtype.itemsize
            fields[name] = [
                raw[place : place + size].view(dtype).reshape(shape) if isinstance(place, int) else place
                for place in every
            ]
        return fields

    # Its way through a checkpoint, and from the file of an earlier case.

    def kept(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Bring the snapshots to the disk; return plain data and arrays for a checkpoint.

        Fields that cannot be written stay in memory.
        """
        if not self._keeps:
            return {}, {}
        self._write()
        if self._file is not None:
            os.fsync(self._file.fileno())
        kinds = {name: (dtype.str, shape) for name, (dtype, shape) in self._kinds.items()}
        about = {"widths": self.widths, "fields": kinds, "size": self._good, "checksum": self._checksum}
        places = {
            name: [-1 if place is None else place for place in every] for name, every in self._fields.items()
        }
        arrays: dict[str, NDArray[Any]] = {f"{_KEPT}rows.{i}": block for i, block in enumerate(self._trimmed)}
        arrays |= {f"{_KEPT}places.{name}": np.array(every, dtype=np.int64) for name, every in places.items()}
        return about, arrays | {f"{_KEPT}times": np.array(self.times)}

    def go_on(self, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Go on from the data and arrays of a checkpoint; a ValueError if the file is damaged before it."""
        self._set_columns(about["widths"])
        for block in (arrays[name] for name in arrays if name.startswith(f"{_KEPT}rows.")):  # in their order
            self._add(block, len(block))
        self._last_time = float(self["time"][-1]) if self.count else -math.inf
        self.times = arrays[f"{_KEPT}times"].tolist()
        self._written = len(self.times)
        for name, (kind, shape) in about["fields"].items():
            self._kinds[name] = np.dtype(kind), tuple(shape)
            self._fields[name] = [
                None if place < 0 else place for place in arrays[f"{_KEPT}places.{name}"].tolist()
            ]
        self._good, self._checksum = about["size"], about["checksum"]
        if self._good:
            assert self._path is not None
            try:
                self._file = _opened(self._path, "r+b")
            except OSError as error:
                raise ValueError(
                    f"{self._path.name}, which belongs to it, cannot be read ({error})"
                ) from None
            if not self._is_intact(self._file):
                raise ValueError(f"{self._path.name}, which belongs to it, is damaged")

    def extend_rows(self, widths: Mapping[str, int], rows: FloatArray) -> None:
        """Record many rows at once, one after the other in an array whose columns have these widths.

        The array becomes a part of the recording: it must not change after that.
        """
        if not (self._keeps and len(rows)):
            return
        if not self._names:
            self._set_columns(widths)
        self._must_have(widths)
        if tuple(widths) != self._names:
            places = _places(widths)
            rows = np.hstack([rows[:, slice(*places[name])] for name in self._names])
        times = rows[:, self._bounds["time"][0]]
        self._must_follow(times[0])
        self._add(rows, len(rows))
        self._last_time = float(times[-1])

    def close(self) -> None:
        """Close the file without removing it."""
        if self._file is not None:
            with suppress(OSError):
                self._file.close()

    # Rows.

    def _in_order(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values of a row in the order of the columns, which are those of the first row."""
        if "time" not in values:
            raise ValueError("a row needs its time")
        if not self._names:
            self._set_columns({name: np.size(value) for name, value in values.items()})
        self._must_have(values)
        return {name: values[name] for name in self._names}

    def _must_have(self, columns: Mapping[str, Any]) -> None:
        if columns.keys() != self.widths.keys():
            raise ValueError(f"row has columns {sorted(columns)}, the first had {sorted(self.widths)}")

    def _must_follow(self, instant: Any) -> None:
        if not instant > self._last_time:
            raise ValueError(f"row at time {instant} follows one at {self._last_time}")

    def _set_columns(self, widths: Mapping[str, int]) -> None:
        self.widths, self._names, self._bounds = dict(widths), tuple(widths), _places(widths)

    def _add(self, block: FloatArray, filled: int) -> None:
        self._blocks = self._trimmed
        self._before += self._filled
        self._blocks.append(block)
        self._filled = filled

    @property
    def _trimmed(self) -> list[FloatArray]:
        """The blocks of rows, the last one without its empty rows."""
        return [*self._blocks[:-1], *(block[: self._filled] for block in self._blocks[-1:])]

    # Snapshots.

    def _must_fit(self, fields: Mapping[str, NDArray[Any]]) -> None:
        """Refuse fields of other names or shapes than those of the snapshots before."""
        if unknown := fields.keys() - VARIABLES.keys():
            raise ValueError(
                f"results/names.py declares no field {min(unknown)!r}; known: {', '.join(FIELDS)}"
            )
        surface = fields.keys() - BELOW
        if self.times and (changed := surface ^ (self._kinds.keys() - BELOW)):
            raise ValueError(f"some snapshots have a {min(changed)} and others have none")
        for name, field in fields.items():
            like = name if name in BELOW else min(surface & self._kinds.keys(), default=name)
            shape = field.shape
            if self._shared is not None:
                axes = len(self._shared.points)
                shape = (*shape[: field.ndim - axes], *self._shared.points)
            _, known = self._kinds.setdefault(name, (field.dtype, shape))
            _, known = self._kinds[like]
            if shape != known:
                raise ValueError(f"{name} of shape {shape}; must be {known}")

    def _write(self) -> None:
        """Write the fields in memory behind those in the file; on failure they stay in memory."""
        for place in range(self._written, len(self.times)):
            for every in self._fields.values():
                if isinstance(field := every[place], np.ndarray):
                    every[place] = self._append([field])
            self._written += 1
        self._size = 0

    def _brought(self, grid: Grid, fields: Mapping[str, NDArray[Any]]) -> dict[str, int]:
        """Write fields of which each rank holds a part; return their places, on the first rank."""
        rows = max(1, _BROUGHT // grid.points[1])

        def blocks(field: NDArray[Any]) -> Iterator[NDArray[Any]]:
            for part in field.reshape(-1, *grid.shape):
                yield from (block for _, block in grid.blocks(part, rows))

        every = {name: blocks(field) for name, field in fields.items()}
        assert self._path is not None
        try:
            with naming(self._path):
                return {name: self._append(parts) for name, parts in every.items()} if self._keeps else {}
        finally:
            for parts in every.values():  # also after a failure the other ranks must get rid of theirs
                for _ in parts:
                    pass

    def _append(self, parts: Iterable[NDArray[Any]]) -> int:
        """Write a field behind those in the file; return its place. After an error it is no part of it."""
        assert self._path is not None
        if self._file is None:
            self._path.unlink(missing_ok=True)  # a dying process may still be writing to it
            self._file = _opened(self._path, "x+b")
        file, place = self._file, self._good
        size, checksum = place, self._checksum
        file.seek(place)

        def written(data: memoryview) -> None:
            nonlocal size, checksum
            size, checksum = size + len(data), zlib.crc32(data, checksum)
            while data:
                data = data[file.write(data) :]

        for part in parts:
            written(np.ascontiguousarray(part).reshape(-1).view(np.uint8).data)
        written(memoryview(bytes(-size % _ALIGNED)))
        self._good, self._checksum = size, checksum
        return place

    def _is_intact(self, file: io.FileIO) -> bool:
        file.seek(0)
        left, checksum = self._good, 0
        while left and (part := file.read(min(left, 1 << 20))):
            left, checksum = left - len(part), zlib.crc32(part, checksum)
        return not left and checksum == self._checksum


def _places(widths: Mapping[str, int]) -> dict[str, tuple[int, int]]:
    """Return where each column begins and ends in a row."""
    return dict(zip(widths, pairwise(accumulate(widths.values(), initial=0)), strict=True))


def _opened(path: Path, mode: str) -> io.FileIO:
    file: io.FileIO = open(path, mode, buffering=0, opener=regular_and_no_link)  # type: ignore[assignment] # noqa: SIM115
    return file
