"""The snapshots of all cases of a sweep as arrays along the swept keys, read from the cases' files when used.

    displacement, pressure, gap (swept key, ..., snapshot, x[, y])

Nothing is copied and no file stays open: indexing such an array opens the files of the chosen cases and reads
the chosen part of each. A case that failed has no file and is NaN, and so is a case without this field or
snapshot. (Virtual datasets of HDF5 in the sweep
file read as fast, but a file with another grid would be read without an error, and wrongly.)
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from gfmdlayer.arrays import FloatArray
from gfmdlayer.results.gathering import rows_at
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.netcdf import opened


class FieldOfCases(BackendArray):
    """One field of all cases, along the swept keys and then the field's own axes."""

    def __init__(
        self, files: NDArray[np.object_], name: str, inner: tuple[int, ...], snapshots: FloatArray
    ) -> None:
        # Times of the snapshots, of all cases or, along the swept keys too, of each.
        self._files, self._name, self._snapshots = files, name, snapshots
        self._inner = (snapshots.shape[-1], *inner)
        self.shape = (*files.shape, *self._inner)
        self.dtype = np.dtype(np.float64)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        support = indexing.IndexingSupport.BASIC
        return indexing.explicit_indexing_adapter(key, self.shape, support, self._read)

    def _read(self, key: tuple[int | slice, ...]) -> FloatArray:
        outer, part = key[: self._files.ndim], key[self._files.ndim :]
        files = np.asarray(self._files[outer], dtype=object)
        times = self._snapshots[outer] if self._snapshots.ndim > 1 else self._snapshots
        inner = np.empty(self._inner, dtype=[])[part].shape  # an empty dtype takes no memory
        values = np.full((*files.shape, *inner), np.nan)
        for place, file in np.ndenumerate(files):
            if not file.is_file():
                continue
            wrong = ""
            try:
                with opened(file) as h5:
                    if self._name not in h5:
                        continue
                    field, own = h5[self._name], h5["snapshot"][...]
                    wanted = times[place] if self._snapshots.ndim > 1 else times
                    rows = rows_at(own, wanted, steady=bool(h5.attrs.get("settled", 0)))
                    if field.shape[1:] != self._inner[1:]:
                        wrong = (
                            f"{self._name} of shape {field.shape[1:]}, where others have {self._inner[1:]}"
                        )
                    elif not {*range(own.size)} <= {*rows.tolist()}:
                        wrong = "snapshots at other times than in the sweep"
                    else:
                        for at, row in np.ndenumerate(rows[part[0]]):
                            if row >= 0:
                                values[(*place, *at)] = field[(row, *part[1:])]
            except ResultsError:
                raise
            except Exception as error:  # a damaged file can fail anywhere in HDF5, with any exception
                raise ResultsError(f"{file}: {self._name} cannot be read: is damaged ({error})") from error
            if wrong:
                raise ResultsError(f"{file}: {wrong}; open the cases one by one with open_case")
        return values
