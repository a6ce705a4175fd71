"""HDF5 files with netCDF4 dimension scales that have their final name only when they are complete.

A file is written under an unfinished name and published when it is flushed and closed (`files.whole`).
Whatever is found under a final name was therefore complete when it got the name.

HDF5 cannot recover from a write that fails, as on a full disk: the file can then not be closed, and the
process ends in a segmentation fault. So HDF5 writes here through a stream that keeps the first failure,
accepts further writes without performing them, and leaves it to the caller to raise the failure. The stream
takes no lock: its name is unique.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5f, h5s, h5t
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import Attribute, FloatArray
from gfmdlayer.files.hdf5 import open_hdf5, other_file
from gfmdlayer.files.whole import publish, seal, unfinished_path
from gfmdlayer.results.names import ResultsError

PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


class _Stream(io.FileIO):
    """A new file that keeps its first failed write in `failure` and ignores the later ones."""

    failure: OSError | None = None

    def write(self, data: Any) -> int:
        rest = memoryview(data).cast("B")
        try:
            while rest and self.failure is None:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.failure = error
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size) if self.failure is None else size or 0
        except OSError as error:
            self.failure = error
            return size or 0


class NewFile:
    """A file being written; `h5` is its root, once begun."""

    h5: h5py.File

    def __init__(self, path: Path) -> None:
        self.path, self.unfinished = path, unfinished_path(path)
        with naming(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = _Stream(self.unfinished, "x+")

    def begin(self, template: bytes | bytearray = b"") -> h5py.File:
        """Begin the HDF5 file, with the contents of a template if given; return its root."""
        self._stream.write(template)
        self._stream.seek(0)
        self.check()
        self.h5 = h5py.File(self._stream, "r+" if template else "w")
        self.check()
        return self.h5

    def check(self) -> None:
        """Raise ResultsError if any write has failed."""
        if self._stream.failure is not None:
            with naming(self.path):
                raise self._stream.failure

    def complete(self) -> None:
        """Close and seal the file, bring it to the disk and give it its final name."""
        self.h5.close()
        seal(self._stream)
        self.check()
        with naming(self.path):
            self._stream.close()
            publish(self.unfinished, self.path)

    def discard(self) -> None:
        """Close and remove the unfinished file; the final name is left as it was."""
        with suppress(Exception):
            self.h5.close()
        with suppress(OSError):
            self._stream.close()
        with suppress(OSError):
            self.unfinished.unlink(missing_ok=True)


@contextmanager
def new_file(path: Path) -> Iterator[NewFile]:
    """Write a file that appears under `path` if the block ends well, and not at all if it raises."""
    file = NewFile(path)
    try:
        yield file
        file.complete()
    except BaseException:
        file.discard()
        raise


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Turn an OSError of the block into a ResultsError that names the file."""
    try:
        yield
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written: {error.strerror or error}") from error


def add_variable(
    h5: h5py.File, name: str, dimensions: Sequence[str], described: Mapping[str, str], **options: Any
) -> h5py.Dataset:
    """Create a variable on existing dimensions; `options` are those of h5py's create_dataset.

    A variable whose only dimension has its name is the coordinate of this dimension.
    """
    dataset = h5.create_dataset(name, **options)
    if tuple(dimensions) == (name,):
        dataset.make_scale(name)
    else:
        for axis, dimension in zip(dataset.dims, dimensions, strict=True):
            axis.attach_scale(h5[dimension])
    dataset.attrs.update(described)
    return dataset


def append(dataset: h5d.DatasetID, values: ArrayLike) -> None:
    """Append values to a variable along its first axis."""
    held, *rest = dataset.shape
    added = np.ascontiguousarray(values, dtype=dataset.dtype)
    dataset.set_extent((held + len(added), *rest))
    write_at(dataset, (held, *(0 for _ in rest)), added)


def write_at(dataset: h5d.DatasetID, start: tuple[int, ...], values: NDArray[Any]) -> None:
    """Write values into a variable from the indices `start` on, in a third of the time of h5py's indexing."""
    space = dataset.get_space()
    space.select_hyperslab(start, values.shape)
    dataset.write(h5s.create_simple(values.shape), space, values)


def set_attributes(h5: h5py.File, attributes: Mapping[str, Attribute]) -> None:
    """Set or replace attributes of a file, in a third of the time that h5py's own attrs take."""
    for name, value in attributes.items():
        if isinstance(value, np.ndarray):
            h5.attrs[name] = value
            continue
        key, python = name.encode(), next(each for each in _KINDS if isinstance(value, each))
        kind, stored = _KINDS[python]
        if h5a.exists(h5.id, key):
            h5a.delete(h5.id, key)
        h5a.create(h5.id, key, stored, _SCALAR).write(np.array(value, dtype=kind))


_KINDS = {
    python: (kind, h5t.py_create(kind, logical=True))
    for python, kind in ((str, h5py.string_dtype()), (int, np.dtype("i8")), (float, np.dtype("f8")))
}
_SCALAR = h5s.create(h5s.SCALAR)


def opened(path: str | Path) -> h5py.File:
    """Open a result file for reading; ResultsError where a part of it is in another file."""
    with ExitStack() as held:
        h5 = held.enter_context(open_hdf5(path))
        if not (member := other_file(h5, deep=True)):
            held.pop_all()
            return h5
    raise ResultsError(f"{path}: {member}; must be as it was written")


# A sweep may have 10 000 cases, of which the sweep file needs a few attributes and columns each. These
# functions read them through h5py's low-level interface, in 60 % of the time of the other.


def column(file: h5f.FileID, name: str) -> FloatArray:
    """Read a column, checksums included; KeyError if the file has none of this name."""
    dataset = h5d.open(file, name.encode())
    values = np.empty(dataset.shape)
    dataset.read(h5s.ALL, h5s.ALL, values)
    return values


def attribute(file: h5f.FileID, name: str) -> object:
    """Read an attribute of the file, text or a number; None if the file has none of this name."""
    if not h5a.exists(file, name.encode()):
        return None
    stored = h5a.open(file, name.encode())
    value = np.empty(stored.shape, dtype=stored.dtype)
    stored.read(value)
    item = value[()]
    return item.decode() if isinstance(item, bytes) else item
