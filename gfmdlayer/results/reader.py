"""Read result files: one case, or a whole folder, as labelled xarray datasets.

A folder of results holds config.yaml, cases/NNNN.h5 (one file per case) and sweep.h5 (all cases, labelled).
Where cases are not complete yet, there may be no sweep.h5: the complete ones are gathered from their files.

A run needs `is_complete`, `attributes` and `replay`; so xarray, which takes half a second, is imported where
data are opened.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from h5py import h5ds

from gfmdlayer.body.bodies import code_refused
from gfmdlayer.config import Config, ConfigError, digest, load
from gfmdlayer.config.reader import Inspection
from gfmdlayer.config.sweeps import combinations
from gfmdlayer.files.hdf5 import is_hdf5
from gfmdlayer.files.locks import open_for_writing, read_json
from gfmdlayer.files.whole import is_intact
from gfmdlayer.results.gathering import WAITING, CaseRecord, Swept, labelled
from gfmdlayer.results.names import FIELDS, SNAPSHOT_FIELDS, SWEEP_FILE, ResultsError
from gfmdlayer.results.netcdf import opened
from gfmdlayer.results.stored import case_numbers, document, must_agree, unit_of
from gfmdlayer.validation.sections import files_named

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.results.recording import Recording


_ROWS_READ = 4096  # at a time
VERIFIED = 1 << 28  # bytes of a file that is verified when it is opened: a quarter of a second


def case_path(directory: str | Path, index: int) -> Path:
    """Return the path of a case's file in a folder of results."""
    return Path(directory) / "cases" / f"{index:04d}.h5"


def is_complete(path: str | Path, digest: str | None = None) -> bool:
    """Whether a file holds a complete case, of this `digest` if one is given.

    A complete file is marked so, its columns and snapshots have as many rows as its attributes say, and its
    bytes are those that were written. An OSError says that the system cannot read a file, which may be sound.
    """
    return not flaw(Path(path), digest=digest)


def flaw(path: Path, most: float = math.inf, digest: str | None = None) -> str:
    """Return why a file is no complete case; empty for one that is. See `is_complete`.

    Of files of more bytes than `most`, only the rows are verified.
    """
    if (place := _no_file(path)) or (place := "" if is_hdf5(path) else "not a result file (no HDF5)"):
        return place
    intact = is_intact(path, most)
    if intact is False and not open_for_writing(path):  # HDF5 marks a file while it is
        return DAMAGED
    try:
        with opened(path) as h5:
            if h5.attrs.get("complete") != 1 or digest not in (None, h5.attrs.get("digest")):
                return INCOMPLETE
            count, snapshots = h5.attrs["rows"], h5.attrs["snapshots"]  # fits of curves have none
            columns, fields = _growing(h5)
            growing = [(column, count, math.inf) for column in columns.values()]
            growing += [(field, snapshots, most) for field in fields.values()]
            for dataset, length, largest in growing:
                small = dataset.size * dataset.dtype.itemsize <= largest
                if _length(dataset, read=small and not intact) != length:
                    return INCOMPLETE
    except ResultsError as error:  # not all of it is in the file
        return str(error).removeprefix(f"{path}: ")
    except OSError as error:
        if intact:  # the bytes are sound: the system fails
            raise ResultsError(f"{path}: cannot be read ({error})") from error
        return INCOMPLETE
    except MemoryError:
        raise
    except Exception:  # a damaged file can fail anywhere in HDF5, with any exception
        return INCOMPLETE
    return ""


DAMAGED = "is damaged: it holds other bytes than were written; run the configuration again"
INCOMPLETE = "not a complete result file"
ESTIMATES = "convergence.h5"
ONLY_ESTIMATES = "holds the estimates of `gfmdlayer converge`, which `gfmdlayer plot` draws, and no results"


def _no_file(path: Path) -> str:
    if path.is_file():
        return ""
    if not path.exists():
        return "no such file"
    return "is a folder, not a result file" if path.is_dir() else "is no regular file"


def replay(path: Path, until: float, recording: Recording) -> None:
    """Record the rows, then the snapshots of a complete case up to the time `until`."""
    with opened(path) as h5:
        columns, fields = _growing(h5)
        rows = int(np.searchsorted(h5["time"][:], until, side="right"))
        for start in range(0, rows, _ROWS_READ):
            part = slice(start, min(start + _ROWS_READ, rows))
            every = [dataset[part].reshape(part.stop - start, -1) for dataset in columns.values()]
            widths = {name: values.shape[1] for name, values in zip(columns, every, strict=True)}
            recording.extend_rows(widths, np.hstack(every, dtype=np.float64))
        times = fields.pop("snapshot")[:].tolist()
        for i, time in enumerate(t for t in times if t <= until):
            held = {name: field[i] for name, field in fields.items()}
            # NaN in the snapshots without fields below the surface
            known = {
                name: field for name, field in held.items() if name in FIELDS or not np.isnan(field.flat[0])
            }
            recording.snapshot(time, known)


def _growing(h5: h5py.File) -> tuple[dict[str, h5py.Dataset], dict[str, h5py.Dataset]]:
    """Return the columns of rows, and time and fields of the snapshots, by name."""
    variables = {n: d for n, d in h5.items() if isinstance(d, h5py.Dataset) and d.shape}
    scales = {name for name, variable in variables.items() if h5ds.is_scale(variable.id)}

    def along(dimension: str) -> dict[str, h5py.Dataset]:
        if dimension not in scales:
            return {}
        beside = {n: d for n, d in variables.items() if n not in scales}
        first = variables[dimension].id
        return {dimension: variables[dimension]} | {
            name: variable for name, variable in beside.items() if h5ds.is_attached(variable.id, first, 0)
        }

    return along("time"), along("snapshot")


def _length(dataset: h5py.Dataset, *, read: bool) -> int:
    """Return the number of rows, read in parts, which verifies checksums, since fields are large."""
    if not read:
        return len(dataset)
    rows = dataset.chunks[0] if dataset.ndim > 1 else _ROWS_READ
    return sum(len(dataset[start : start + rows]) for start in range(0, len(dataset), rows))


def attributes(path: str | Path) -> dict[str, object]:
    """Return the attributes of a result file; ResultsError if it is missing or is not HDF5."""
    path = Path(path)
    try:
        with opened(path) as h5:
            return dict(h5.attrs)
    except ResultsError:
        raise
    except OSError as error:
        raise ResultsError(f"{path}: {_reason(path)}") from error


def stored_config(
    path: str | Path,
    overrides: Iterable[str] | Mapping[str, object] = (),
    inspect: Inspection | None = None,
    *,
    trust: bool = False,
) -> Config:
    """Return the configuration of a case, see `load`; ConfigError where a file that it names has changed.

    Code that the configuration names is run only with `trust`.
    """
    try:
        if is_intact(Path(path)) is False:
            raise ConfigError([f"{path}: is damaged: it holds other bytes than were written"])
        known = attributes(path)
    except ResultsError as error:
        raise ConfigError([str(error)]) from None
    except OSError as error:
        raise ConfigError([f"{path}: {error.strerror}"]) from None
    if "config" not in known:
        raise ConfigError([f"{path}: holds no configuration; must be YAML, or the file of a case"])
    return config_in(known, path, overrides, inspect, trust=trust)


def config_in(
    known: Mapping[Any, object],
    path: str | Path,
    overrides: Iterable[str] | Mapping[str, object] = (),
    inspect: Inspection | None = None,
    *,
    trust: bool = False,
) -> Config:
    """Return the configuration in the attributes of a case, see `stored_config`."""
    with code_refused(not trust):
        config = load(path, overrides, inspect, str(known["config"]))
    files = [str(file) for file in files_named(config).values()]
    if files and not overrides and digest(config) != known.get("digest"):
        raise ConfigError([f"{path}: {' or '.join(files)} has changed since this case was computed from it"])
    return config


def open_case(path: str | Path) -> xarray.Dataset:
    """Open the file of one case; values are read when they are used.

    Parameters
    ----------
    path : path
        HDF5 file of a case, such as results/NAME/cases/0000.h5.

    Returns
    -------
    xarray.Dataset
        Columns along `time`; displacement, pressure and gap along (snapshot, x[, y]).

    Raises
    ------
    ResultsError
        If the file is missing or is not a complete case.

    Examples
    --------
    >>> config = {"time": {"end": 1.0, "step": 0.5}, "grid": {"points": 64}}
    >>> _ = gfmdlayer.run(config, out="one")
    >>> gfmdlayer.open_case("one/cases/0000.h5").time.values
    array([0. , 0.5, 1. ])
    """
    path = Path(path)
    if reason := flaw(path, VERIFIED):
        raise ResultsError(f"{path}: {_reason(path, reason)}")
    return open_labelled(path)


def open_results(directory: str | Path) -> xarray.Dataset:
    """Open a folder of results: the labelled sweep, or the case itself where there is only one.

    Parameters
    ----------
    directory : path
        Folder of results, such as results/NAME.

    Returns
    -------
    xarray.Dataset
        For a sweep, every column of the cases along the swept keys and time, with the coordinate `case`, the
        number of each case's file. Cases that are not complete yet are NaN; the attribute `incomplete` has
        their numbers, and `failed` the failed ones with their reasons. Where the cases share a grid, also
        displacement, pressure and gap along the swept keys, snapshot, x and y; of these, only the parts that
        are used are read, then and there, from the files of the cases.

    Raises
    ------
    ResultsError
        If the folder is missing, or holds no results or no complete case.

    Examples
    --------
    >>> config = {"time": {"end": 1.0, "step": 0.5}, "grid": {"points": 64}}
    >>> _ = gfmdlayer.run(config, out="two", sweep={"layer.thickness": [0.1, 0.2]})
    >>> gfmdlayer.open_results("two").sel(thickness=0.2).contact_area.dims
    ('time',)
    """
    directory = Path(directory)
    if not directory.is_dir():
        raise ResultsError(f"{directory}: no such folder")
    sweep, config = directory / SWEEP_FILE, directory / "config.yaml"
    files = sorted((directory / "cases").glob("*.h5"))
    if not sweep.exists() and not (directory / "cases").is_dir():
        if only_estimates(directory):
            raise ResultsError(f"{directory}: {ONLY_ESTIMATES}")
        raise ResultsError(f"{directory}: not a folder of results, it has neither {SWEEP_FILE} nor cases/")
    numbers = set(case_numbers(config)) if config.exists() else set()
    if sweep.exists():
        collected = open_labelled(sweep)
        held = {*collected["case"].to_numpy().flat} if "case" in collected.coords else numbers
        is_of_all = not numbers or held == numbers  # else the sweep has grown since
        if is_of_all and collected.attrs.get("swept"):
            return _with_snapshots(collected, directory)
        with collected:  # of the only case, beside which earlier ones may lie, or of a smaller sweep
            files = [case_path(directory, int(collected["case"]))] if is_of_all else files
    complete = [path for path in files if not flaw(path, VERIFIED)]
    if complete and (gathered := _gathered(directory, config)) is not None:
        return _with_snapshots(gathered, directory)
    if len(complete) == 1:
        return open_labelled(complete[0])
    if not complete:
        raise ResultsError(f"{directory}: no complete case{_first_failure(directory)}")
    several = f"{len(complete)} complete cases but no {SWEEP_FILE}; run the config again"
    raise ResultsError(f"{directory}: {several}")


def only_estimates(path: Path) -> bool:
    """Whether a file, or all that a folder has of this package, is estimates of errors."""
    if not path.is_dir():
        return path.name == ESTIMATES and path.is_file()
    return (path / ESTIMATES).is_file() and not any((path / name).exists() for name in (SWEEP_FILE, "cases"))


def _first_failure(directory: Path) -> str:
    """Return the reason of the first failed case, if there is one."""
    failed = sorted((directory / "cases").glob("*.failed"))
    reason = (read_json(failed[0]) or {}).get("reason") if failed else None
    return f"; {failed[0].stem} failed: {reason}" if reason else ""


def _gathered(directory: Path, config: Path) -> xarray.Dataset | None:
    """Gather a sweep of which cases are not complete yet; None where no sweep is stored."""
    data = document(config) if config.exists() else {}
    if not (sweep := data.get("sweep")):
        return None
    records, numbers, swept = [], case_numbers(config), combinations(sweep)
    must_agree(config, numbers, len(swept))
    for number, values in zip(numbers, swept, strict=True):
        path = case_path(directory, number)
        failure = read_json(path.with_suffix(".failed")) or {}
        missing = None if path.exists() else str(failure.get("reason", WAITING))
        records.append(CaseRecord(number, path, values, missing))
    if all(record.failed for record in records):
        raise ResultsError(f"{directory}: no complete case{_first_failure(directory)}")
    times = (data.get("output") or {}).get("times")
    return labelled(records, Swept.of(sweep, unit_of(data), times))


def open_labelled(path: Path) -> xarray.Dataset:
    """Open a file of labelled data, if its bytes are those that were written; see `open_case`."""
    import xarray
    from xarray.backends import CachingFileManager, H5NetCDFStore

    try:
        if is_intact(path, VERIFIED) is not False:
            data = xarray.open_dataset(H5NetCDFStore(CachingFileManager(_measured, str(path)), mode="r"))
            data.encoding["source"] = str(path)
            return data
    except ResultsError:
        raise
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        raise ResultsError(f"{path}: {_reason(path)}") from error
    raise ResultsError(f"{path}: {DAMAGED}")


def _measured(path: str) -> Any:
    """Open a file whose dimensions keep their sizes, which h5netcdf looks for anew at each variable.

    xarray takes a fifth less, and a quarter of the time where an earlier version wrote endless dimensions.
    """
    import h5netcdf
    from h5netcdf.dimensions import Dimension

    known = type("Known", (Dimension,), {"size": cached_property(Dimension.size.fget)})
    h5 = opened(path)
    try:
        file = h5netcdf.File(h5, "r", decode_vlen_strings=True)
    except BaseException:
        h5.close()
        raise
    for dimension in file.dimensions.values():
        dimension.__class__ = known
    of_names = file.close

    def close() -> None:  # h5netcdf leaves a file open that it has not opened
        of_names()
        h5.close()

    file.close = close
    return file


def _reason(path: Path, reason: str = INCOMPLETE) -> str:
    """Return why a file cannot be used as results, as far as another reason than the given is known."""
    if place := _no_file(path):
        return place
    if only_estimates(path):
        return ONLY_ESTIMATES
    if path.suffix in {".yaml", ".yml"}:
        return "is a configuration; must be results, such as the folder results/NAME after its run"
    with suppress(OSError):
        if is_intact(path, VERIFIED) is False:
            return DAMAGED
    return reason if is_hdf5(path) else "not a result file (no HDF5)"


def _with_snapshots(sweep: xarray.Dataset, directory: Path) -> xarray.Dataset:
    """Add the snapshots of all cases to a sweep whose cases share grid and times."""
    files = np.frompyfunc(lambda number: case_path(directory, number), 1, 1)(sweep["case"].to_numpy())
    if any(key.startswith("grid.") for key in sweep.attrs["swept"].split()):
        return sweep
    complete = (path for path in files.flat if not flaw(path, VERIFIED))
    if "snapshot" in sweep.coords:  # of some cases at least
        first = next((path for path in complete if attributes(path)["snapshots"]), None)
    elif (first := next(complete, None)) is not None and not attributes(first)["snapshots"]:
        return sweep
    if first is None:
        return sweep
    with open_labelled(first) as example:
        if "axes" in example.attrs:  # each case has its own
            return sweep
        import xarray
        from xarray.core import indexing

        from gfmdlayer.results.fields_of_cases import FieldOfCases

        keys = sweep.attrs["swept"].split()
        # Cases of other layers have fields below the surface at other depths.
        ends, heads = ("thickness", "shear_modulus"), ("layer", "layers", "halfspace", "body")
        alike = not any(key.endswith(ends) or key in heads or key.startswith("output") for key in keys)
        names = ("x", "y", *(("z", "layer", "spring") if alike else ()))
        axes = {name: example[name].variable.load() for name in names if name in example.variables}
        # A sweep file of an earlier version has no times of snapshots: all cases then have the same ones.
        added, snapshots = {}, (sweep if "snapshot" in sweep.coords else example)["snapshot"].load()
        for name in SNAPSHOT_FIELDS if alike else FIELDS:
            if name in example:
                field = example[name].variable
                of_cases = FieldOfCases(files, name, field.shape[1:], snapshots.to_numpy())
                lazy = indexing.LazilyIndexedArray(of_cases)
                dimensions = (*sweep["case"].dims, snapshots.dims[-1], *field.dims[1:])
                added[name] = xarray.Variable(dimensions, lazy, field.attrs)
    labelled_sweep = sweep.assign_coords(axes).assign(added)
    labelled_sweep.set_close(sweep.close)  # which a copy does not have
    return labelled_sweep
