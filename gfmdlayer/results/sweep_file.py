"""The labelled sweep, see `gfmdlayer.results.gathering`, as a file and as a dataset in memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from gfmdlayer.results.gathering import CaseRecord, Gathered
from gfmdlayer.results.netcdf import add_variable, new_file, write_at
from gfmdlayer.results.reader import sweep_path
from gfmdlayer.results.schema import FIELDS

if TYPE_CHECKING:
    import xarray

CHUNK = 1 << 16  # values: half a megabyte, which fits the chunk cache of HDF5


def collect(
    directory: str | Path,
    records: Sequence[CaseRecord],
    keys: Sequence[str],
    attributes: Mapping[str, str | int | float] | None = None,
    listed: bool = False,
    unit: Callable[[str], str] = str,
) -> Path:
    """Write DIR/sweep.h5 from the files of the cases; return its path.

    A case that failed or whose file is not complete is NaN, and is named in the attribute `failed`. The
    attributes given are added to those of `Gathered`, whose other arguments are given too.
    """
    path = sweep_path(directory)
    sweep = Gathered(records, keys, listed, unit)
    with new_file(path) as file:
        h5 = file.begin()
        coordinates = sweep.coordinates
        for name, (dimensions, described, values) in coordinates.items():
            text = {"dtype": h5py.string_dtype()} if values.dtype.kind == "U" else {}
            data = values.astype(object) if text else values
            add_variable(h5, name, dimensions, described, data=data, **text)

        def add(name: str, along: tuple[str, ...], described: Mapping[str, str], **how: Any) -> h5py.Dataset:
            variable = add_variable(h5, name, along, described, **how)
            beside = [x for x, (axes, *_) in coordinates.items() if {*axes} <= {*along} and x not in along]
            variable.attrs["coordinates"] = " ".join(sorted(beside))
            return variable

        for name, (dimensions, described, values) in sweep.numbers.items():
            add(name, dimensions, described, data=values)
        columns = {
            name: add(name, dimensions, described, **_options(shape))
            for name, (dimensions, described, shape) in sweep.columns.items()
        }
        for place, curves in sweep.curves():
            for name, values in curves.items():
                if values.size:
                    start = (*place, *(0 for _ in values.shape))
                    write_at(columns[name].id, start, values.reshape(*(1 for _ in place), *values.shape))
            file.check()
        h5.attrs.update(sweep.attributes(attributes or {}))
    return path


def _options(shape: tuple[int, ...]) -> dict[str, Any]:
    """Options of a column: NaN until it is written, in chunks of whole curves of neighbouring cases."""
    options: dict[str, Any] = {"shape": shape, "dtype": "f8", "fillvalue": np.nan}
    if math.prod(shape):
        chunks: list[int] = []
        for length in reversed(shape):
            chunks.insert(0, max(1, min(length, CHUNK // math.prod(chunks))))
        options |= {"chunks": tuple(chunks), "compression": "gzip", "compression_opts": 1, "shuffle": True}
    return options


def labelled(
    records: Sequence[CaseRecord],
    keys: Sequence[str],
    attributes: Mapping[str, str | int | float],
    listed: bool = False,
    unit: Callable[[str], str] = str,
) -> xarray.Dataset:
    """Return cases in memory as `open_results` gives those of a folder, with fields if their grids agree."""
    import xarray

    sweep = Gathered(records, keys, listed, unit)
    columns = {name: np.full(shape, np.nan) for name, (*_, shape) in sweep.columns.items()}
    for place, curves in sweep.curves():
        for name, values in curves.items():
            columns[name][place] = values
    coords: dict[str, Any] = {
        name: (dims, values, described) for name, (dims, described, values) in sweep.coordinates.items()
    }
    held: dict[str, Any] = {
        name: (dims, columns[name], described) for name, (dims, described, _) in sweep.columns.items()
    }
    held |= {name: (dims, values, described) for name, (dims, described, values) in sweep.numbers.items()}
    cases = [record.source for record in records if isinstance(record.source, xarray.Dataset)]
    first = cases[0]
    if first.sizes["snapshot"] and all(_surface(case) == _surface(first) for case in cases):
        for name in (each for each in FIELDS if all(each in case for case in cases)):
            fields = np.full((*sweep.shape, *first[name].shape), np.nan)
            for place, record in zip(sweep.places, records, strict=True):
                if isinstance(record.source, xarray.Dataset):
                    fields[place] = record.source[name].to_numpy()
            held[name] = ((*sweep.dimensions, *first[name].dims), fields, first[name].attrs)
        coords |= {str(name): first[name].variable for name in first[FIELDS[0]].dims}
    return xarray.Dataset(held, coords, sweep.attributes(attributes))


def _surface(case: xarray.Dataset) -> list[Any]:
    """Return the coordinates of the snapshots, for a comparison."""
    return [case[name].to_numpy().tolist() for name in ("snapshot", "x", "y") if name in case.coords]
