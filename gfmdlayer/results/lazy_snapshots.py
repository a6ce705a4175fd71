"""The snapshots of all cases of a sweep as arrays along the swept keys, read from the cases' files when used.

    displacement, pressure, gap (swept key, ..., snapshot, x[, y])

Nothing is copied and no file stays open: indexing such an array opens the files of the chosen cases and reads
the chosen part of each. A case that failed has no file and is NaN. (Virtual datasets of HDF5 in the sweep
file read as fast, but a file with another grid would be read without an error, and wrongly.)
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import xarray
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from gfmdlayer.results.schema import FIELDS, ResultsError

SAME_TIME = 1e-9  # relative: times that are reached by different steps differ by rounding

if TYPE_CHECKING:
    from xarray import Dataset


def with_snapshots(sweep: Dataset, example: Dataset, files: NDArray[np.object_]) -> Dataset:
    """Add the snapshots of all cases to a sweep.

    Parameters
    ----------
    sweep : Dataset
        The sweep, whose coordinate `case` has the dimensions of the swept keys.
    example : Dataset
        One of its cases; all have its grid and times.
    files : ndarray of Path, shape of `case`
        The files of the cases.
    """
    axes = {name: example[name].load() for name in ("snapshot", "x", "y") if name in example.coords}
    times = axes["snapshot"].to_numpy()
    added = {}
    for name in FIELDS:
        if name in example:
            field = example[name].variable
            lazy = indexing.LazilyIndexedArray(_FieldOfCases(files, name, field.shape, times))
            added[name] = xarray.Variable((*sweep["case"].dims, *field.dims), lazy, field.attrs)
    return sweep.assign_coords(axes).assign(added)


class _FieldOfCases(BackendArray):
    """One field of all cases, along the swept keys and then the field's own axes."""

    def __init__(
        self, files: NDArray[np.object_], name: str, shape: tuple[int, ...], times: NDArray[np.float64]
    ) -> None:
        self._files, self._name, self._inner, self._times = files, name, shape, times
        self.shape = (*files.shape, *shape)
        self.dtype = np.dtype(np.float64)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        support = indexing.IndexingSupport.BASIC
        return indexing.explicit_indexing_adapter(key, self.shape, support, self._read)

    def _read(self, key: tuple[int | slice, ...]) -> NDArray[np.float64]:
        outer, part = key[: self._files.ndim], key[self._files.ndim :]
        files = np.asarray(self._files[outer], dtype=object)
        inner = np.empty(self._inner, dtype=[])[part].shape  # an empty dtype takes no memory
        found = np.full((*files.shape, *inner), np.nan)
        for place, file in np.ndenumerate(files):
            if file.is_file():
                found[place] = self._read_case(file, part)
        return found

    def _read_case(self, file: Path, part: tuple[int | slice, ...]) -> NDArray[np.float64]:
        with h5py.File(file, locking=False) as h5:
            field = h5[self._name]
            if field.shape != self._inner:
                raise ResultsError(
                    f"{file}: {self._name} of shape {field.shape}, where the first case has {self._inner}; "
                    "open the cases one by one with open_case"
                )
            if not np.allclose(h5["snapshot"][...], self._times, rtol=SAME_TIME, atol=0):
                raise ResultsError(
                    f"{file}: snapshots at other times than in the first case; open the cases one by one "
                    "with open_case"
                )
            return np.asarray(field[part])
