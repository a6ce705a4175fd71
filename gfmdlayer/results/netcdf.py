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
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.files.whole import unfinished
from gfmdlayer.results.schema import VARIABLES, naming


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
    """A file being written.

    Attributes
    ----------
    h5 : h5py.File
        Its root, once begun.
    """

    h5: h5py.File

    def __init__(self, part: Path) -> None:
        self._stream = _Stream(part, "x+")

    def begin(self, template: bytes = b"") -> h5py.File:
        """Begin the HDF5 file, with the contents of a template if given; return its root."""
        self._stream.write(template)
        self._stream.seek(0)
        self.check()
        self.h5 = h5py.File(self._stream, "r+" if template else "w")
        self.check()
        return self.h5

    def check(self) -> None:
        """Raise OSError if any write has failed."""
        if self._stream.failure is not None:
            raise self._stream.failure

    def close(self) -> None:
        """Close the HDF5 file and the stream."""
        with self._stream:
            self.h5.close()
            self.check()

    def discard(self) -> None:
        """Close what can be closed."""
        with suppress(Exception):
            self.close()


@contextmanager
def new_file(path: Path) -> Iterator[NewFile]:
    """Write a file that appears under `path` if the block ends well, and not at all if it raises."""
    with naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with unfinished(path) as part:
            file = NewFile(part)
            try:
                yield file
                file.close()
            except BaseException:
                file.discard()
                raise


def contents(fill: Callable[[h5py.File], None]) -> bytes:
    """Return the bytes of an HDF5 file that a function fills: a template takes a hundredth of the time."""
    memory = io.BytesIO()
    with h5py.File(memory, "w") as h5:
        fill(h5)
    return memory.getvalue()


def add_variable(
    h5: h5py.File,
    name: str,
    dimensions: Sequence[str],
    described: Mapping[str, str] | None = None,
    **options: Any,
) -> h5py.Dataset:
    """Create a variable on existing dimensions.

    Parameters
    ----------
    h5 : h5py.File
        The file.
    name : str
        Name of the variable. One whose only dimension has the same name is the coordinate of this dimension.
    dimensions : sequence of str
        Names of its dimensions.
    described : mapping, optional
        Attributes of the variable; by default long_name and units of the table of variables.
    **options
        Options of h5py's create_dataset.
    """
    if described is None:
        entry = VARIABLES[name]
        described = {"long_name": entry.long_name, "units": entry.units}
        options.setdefault("dtype", entry.dtype)
    dataset = h5.create_dataset(name, **options)
    if tuple(dimensions) == (name,):
        dataset.make_scale(name)
    else:
        for axis, dimension in zip(dataset.dims, dimensions, strict=True):
            axis.attach_scale(h5[dimension])
    dataset.attrs.update(described)
    return dataset


def append(dataset: h5py.Dataset, values: ArrayLike) -> None:
    """Append values to a variable along its first axis."""
    held, added = len(dataset), np.asarray(values)
    dataset.resize(held + len(added), axis=0)
    dataset[held:] = added
