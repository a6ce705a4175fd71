"""The cases of a sweep as one labelled structure, from their files or from datasets in memory.

    contact_area and the other columns of the cases (swept key, ..., time[, bin])      case (swept key, ...)
    pull_off_force and other numbers of a whole case (swept key, ...)

So it is where the cases have their rows at the same times; a case that ends before the others is NaN after
its end. Cases with steps of their own keep all of their rows, and time depends on the case:

    contact_area and the other columns (swept key, ..., row[, bin])      time (swept key, ..., row)

A case with fewer rows than the longest is NaN, in time too, in the rows that it does not have. With
`output.times` these cases too lie along `time`: the times of the configuration, and others that all share.

The times of the snapshots are a coordinate likewise: `snapshot` (snapshot) of cases with the same ones, or
with the first of them, else `snapshot` (swept key, ..., snapshot_row).

A column whose name a swept key has taken is called NAME_over_time: depth_over_time in a sweep of
trajectory.depth. A case without a column that others have is NaN there, and a line of the notes names it.
A case that ended in a steady state keeps its last row at all later times of a common axis; one whose punch
was pulled off is NaN there.

A sweep over the product of its keys has one dimension for each key, named by the last part of the key
(thickness, shear_modulus, Ginf), or by the whole key where another key has the last part too or a dataset
has another meaning of it (`names.dimension_names`): `sel({"solver.method": "fire"})`. Any other list of cases
(zip, samples) has one dimension, `case`, with the swept values along it. Labels are numbers if all values of
the key are numbers, else text.

The names and units of columns are those in the files: results of an earlier version, or of an observable that
is no longer declared, are gathered like any other.
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import h5py
import numpy as np
from h5py import h5a, h5d, h5f, h5g
from numpy.typing import NDArray

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.config.sweeps import is_listed, sampling, swept_keys
from gfmdlayer.files.locks import regular
from gfmdlayer.files.whole import is_intact, is_sealed
from gfmdlayer.observables import known_numbers
from gfmdlayer.observables.contact import TIME, ContactMeans
from gfmdlayer.results.case_file import CaseContents
from gfmdlayer.results.names import (
    FIELDS,
    OVER_TIME,
    ROW,
    SAME_TIME,
    SNAPSHOT_FIELDS,
    SNAPSHOT_ROW,
    SWEEP_FILE,
    VARIABLES,
    ResultsError,
    described_key,
    dimension_names,
    labels,
    numbered,
)
from gfmdlayer.results.netcdf import PACKED, add_variable, attribute, column, new_file, opened, write_at
from gfmdlayer.results.template import Template, template_of

if TYPE_CHECKING:
    import xarray


INCOMPLETE = "no complete result file"
WAITING = "not complete yet"  # in place of the reason of a failure
OF_ONE_CASE = {
    "config", "digest", "coordinates", "hostname", "started", "finished", "wall_seconds", "rows", "snapshots",
    "complete", "warnings", *known_numbers(), "instabilities", "instability_time", "instability_depth",
    "instability_energy", "instability_error", "ended",
}  # fmt: skip

# Bytes of a file that is read at once; and of one that is verified as a whole.
SMALL, MEDIUM = 1 << 18, 1 << 22
# Bytes of columns in memory between the two looks at a case; the files of others are read twice.
KEPT = 1 << 26
_NAMED = 5  # cases in a line of the notes


@dataclass(frozen=True)
class CaseRecord:
    """One case of a sweep: its file or its data, its values by dotted key, and the reason if it failed."""

    index: int
    source: Path | CaseContents | None
    values: Mapping[str, object]
    failed: str | None = None


class GatheredColumn(NamedTuple):
    """A column of the cases: its attributes and, of a distribution, the ends of its bins."""

    described: Mapping[str, str]
    bins: str = ""  # name of the dimension of the bins; empty for a number
    edges: Mapping[str, tuple[Mapping[str, str], FloatArray]] = MappingProxyType({})


class Labelled(NamedTuple):
    """A variable of the structure: its dimensions, attributes and values."""

    dimensions: tuple[str, ...]
    described: Mapping[str, str]
    values: NDArray[Any]


Asked = float | Sequence[float] | None  # `output.times`: a spacing, a list, or not given


class Swept(NamedTuple):
    """How the cases of a sweep are labelled."""

    keys: Sequence[str]  # in the order of the dimensions
    listed: bool = False  # along the one dimension `case`, even where the cases happen to be a product
    unit: Callable[[str], str] = str  # label of a unit
    asked: Asked = None
    sampling: Mapping[str, str | int | float] = MappingProxyType({})  # method, number and seed of samples

    @classmethod
    def of(cls, sweep: Mapping[str, Any], unit: Callable[[str], str], times: Asked) -> Swept:
        """Return the labels of a sweep of the configuration, whose `output.times` are given."""
        keys = swept_keys(sweep)
        asked = None if "output.times" in keys else times
        return cls(keys, is_listed(sweep), unit, asked, sampling(sweep))


class _CaseFile:
    """A case in its file; values are read at their first use."""

    def __init__(self, file: h5f.FileID) -> None:
        self._file = file

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables."""
        return tuple(name.decode() for name in h5g.open(self._file, b"/"))

    @property
    def noted(self) -> Iterable[str]:
        """Names of the attributes."""
        return [h5a.open(self._file, index=i).name.decode() for i in range(h5a.get_num_attrs(self._file))]

    def attribute(self, name: str) -> object:
        """Return an attribute, None if there is none of this name."""
        return attribute(self._file, name)

    def values(self, name: str) -> FloatArray:
        """Return the values of a variable."""
        return column(self._file, name)

    def about(self, name: str) -> tuple[tuple[str, ...], Mapping[str, str]]:
        """Return dimensions and attributes of a variable, none of one without dimensions."""
        dataset = h5py.File(self._file)[name]
        if not isinstance(dataset, h5py.Dataset):
            return (), {}
        axes = tuple(axis[0].name.lstrip("/") for axis in dataset.dims if len(axis))
        dimensions = (name,) if dataset.is_scale else axes
        return dimensions, {
            key: str(dataset.attrs[key]) for key in ("long_name", "units") if key in dataset.attrs
        }


class _CaseBytes:
    """A case in a file that a template of this process has made: no need of HDF5 to read it."""

    def __init__(self, path: Path, file: bytes, template: Template) -> None:
        self._path, self._bytes, self._template = path, file, template
        self.names, self.noted = template.names, template.noted

    def attribute(self, name: str) -> object:
        """Return an attribute, None if there is none of this name."""
        return self._template.value(self._bytes, name) if name in self.noted else None

    def values(self, name: str) -> FloatArray:
        """Return the values of a variable."""
        return np.array(self._template.values(self._bytes, name), dtype=np.float64)

    def about(self, name: str) -> tuple[tuple[str, ...], Mapping[str, str]]:
        """Return dimensions and attributes of a variable, none of one without dimensions."""
        with opened(self._path) as file:
            return _CaseFile(file.id).about(name)


CaseData: TypeAlias = (
    _CaseFile | _CaseBytes | CaseContents
)  # with equal names, variables have equal dimensions


@contextmanager
def _open(record: CaseRecord) -> Iterator[CaseData]:
    if isinstance(record.source, Path):
        contents = b""
        if small := record.source.stat().st_size <= SMALL:
            with open(record.source, "rb", opener=regular) as whole:
                contents = whole.read()
        if (is_sealed(contents) if small else is_intact(record.source, MEDIUM)) is False:
            raise ResultsError(f"{record.source}: is damaged")
        if template := template_of(contents):
            yield _CaseBytes(record.source, contents, template)
            return
        with opened(record.source) as file:
            yield _CaseFile(file.id)
    elif record.source is not None:
        yield record.source


def _columns(case: CaseData) -> Iterator[tuple[str, GatheredColumn]]:
    """Yield the columns of a case by name, without its times."""
    names = set(case.names)
    for name in case.names:
        dimensions, described = case.about(name)
        if dimensions[:1] != (TIME.name,) or name == TIME.name:
            continue
        bins = dimensions[1] if len(dimensions) > 1 else ""
        ends = [end for end in (bins, f"{bins}_end") if end in names]
        edges = {end: (case.about(end)[1], case.values(end)) for end in ends}
        yield name, GatheredColumn(described, bins, edges)


class _Curves(NamedTuple):
    """The columns of a case."""

    times: FloatArray
    columns: Mapping[str, FloatArray]
    settled: bool

    @classmethod
    def of(cls, case: CaseData, names: Iterable[str]) -> _Curves:
        """Read them."""
        columns = {name: case.values(name) for name in sorted(names)}
        return cls(case.values(TIME.name), columns, bool(case.attribute("settled")))


class _Times:
    """The times of the cases; those of the longest case, and those that all share, are in memory."""

    def __init__(self) -> None:
        self.longest: FloatArray = np.empty(0)
        self._shared: FloatArray | None = None
        self._end, self._nested = 0.0, True

    def add(self, times: FloatArray) -> None:
        """Add the times of a case."""
        if np.array_equal(times, self.longest):
            return
        short, self.longest = sorted((times, self.longest), key=len)
        self._nested &= np.array_equal(rows_at(self.longest, short), np.arange(short.size))
        self._shared = times if self._shared is None else self._shared[rows_at(times, self._shared) >= 0]
        self._end = max(self._end, *times[-1:])

    def common(self, asked: Asked) -> FloatArray | None:
        """Return times for all cases: those of the longest, or those asked for; None without such times."""
        if self._nested or self._shared is None:
            return self.longest
        if asked is None:
            return None
        if isinstance(asked, float):
            asked = [asked * i for i in range(1, math.floor(self._end / asked + SAME_TIME) + 1)]
        own = np.array(asked)
        return np.sort(np.append(own, self._shared[rows_at(own, self._shared) < 0]))


def _same(one: object, other: object) -> bool:
    """Whether two attributes are equal: texts, numbers or arrays."""
    return one == other if isinstance(one, str) else np.array_equal(one, other)  # type: ignore[arg-type]


class Gathered:
    """The cases of a sweep, labelled by the swept keys; `KEPT` bytes of their columns are in memory.

    `failed` has the reason for each case without results, `places` the indices of each case along
    `dimensions`; `along` is the dimension of the rows, time or row.
    """

    def __init__(self, records: Sequence[CaseRecord], swept: Swept) -> None:
        self._records, self._swept, self._unit = records, swept, swept.unit
        self.failed = {each.index: each.failed for each in records if each.failed is not None}
        self._columns: dict[str, GatheredColumn] = {}
        self._numbers: dict[str, dict[int, float]] = {}
        self._shared: dict[str, Any] = {}
        self._of_first: frozenset[str] | None = None
        self._layouts: dict[tuple[str, ...], dict[str, GatheredColumn]] = {}
        self._warned: dict[str, tuple[str, list[int]]] = {}  # by the words without numbers
        self._held: dict[int, frozenset[str]] = {}
        self._plain: dict[tuple[str, ...], frozenset[str]] = {}
        self._alike: dict[frozenset[str], frozenset[str]] = {}  # one set for all cases with equal columns
        times, self._snapshots = _Times(), _Times()
        self._snapshot_times: dict[int, FloatArray] = {}
        self._kept: dict[int, _Curves] = {}
        self._room, self._known = KEPT, known_numbers()
        for record in records:
            if record.index not in self.failed and not self._add(record, times):
                self.failed[record.index] = INCOMPLETE
        common = times.common(swept.asked)
        self.along = ROW if common is None else TIME.name
        # Of rows, their numbers.
        self._times: NDArray[Any] = np.arange(times.longest.size) if common is None else common
        # Without a complete case, the columns of the paper.
        self._columns = self._columns or {
            each.name: GatheredColumn(each.described)
            for each in ContactMeans.COLUMNS
            if each.name != TIME.name
        }
        names = {name for gathered in self._columns.values() for name in (gathered.bins, *gathered.edges)}
        values = [record.values for record in records]
        self._layout = lay_out(values, swept.keys, swept.listed, names)
        self.dimensions, self.places = tuple(self._layout.lengths), self._layout.places
        self.shape = tuple(self._layout.lengths.values())

    def _add(self, record: CaseRecord, every: _Times) -> bool:
        """Read times, columns and attributes of a case; False if it is not complete."""
        try:
            with _open(record) as case:
                times = case.values("time")
                if case.attribute("complete") != 1 or case.attribute("rows") != len(times):
                    return False
                names = case.noted if self._of_first is None else self._shared
                attributes: dict[str, Any] = {n: case.attribute(n) for n in names if n not in OF_ONE_CASE}
                held = self._columns_of(case)
                snapshots = case.values("snapshot") if case.attribute("snapshots") else np.empty(0)
                self._warn(record.index, str(case.attribute("warnings") or ""))
                own = {name: case.attribute(name) for name in self._known}
                if isinstance(case, _CaseBytes) and self._room > 0:
                    kept = _Curves.of(case, held)
                    self._room -= sum(values.nbytes for values in kept.columns.values())
                    self._kept[record.index] = kept
        except Exception:  # a damaged file can fail anywhere in HDF5, with any exception
            return False
        every.add(times)
        self._snapshots.add(snapshots)
        self._snapshot_times[record.index] = snapshots
        self._held[record.index] = self._alike.setdefault(held, held)
        for name, value in own.items():
            if value is not None:
                self._numbers.setdefault(name, {})[record.index] = float(str(value))
        if self._of_first is None:
            self._of_first, self._shared = frozenset(attributes), attributes
        else:
            self._shared = {n: value for n, value in self._shared.items() if _same(attributes[n], value)}
        return True

    def _columns_of(self, case: CaseData) -> frozenset[str]:
        """Take note of the columns of a case; return the names of those over the bins of earlier cases."""
        names = case.names
        if names not in self._layouts:
            self._layouts[names] = dict(_columns(case))
        held = self._layouts[names]
        if names in self._plain:
            return self._plain[names]
        for name, gathered in held.items():
            self._columns.setdefault(name, gathered)
        fitting = []
        for name, gathered in held.items():
            known = self._columns[name]
            ends = ((case.values(end), edges) for end, (_, edges) in known.edges.items())
            if gathered.bins == known.bins and all(np.array_equal(*each) for each in ends):
                fitting.append(name)
        found = frozenset(fitting)
        if not any(gathered.edges or self._columns[name].edges for name, gathered in held.items()):
            self._plain[names] = found  # no values decide
        return found

    @property
    def coordinates(self) -> dict[str, Labelled]:
        """Time or row, labels, numbers of the cases and ends of bins; each after its dimension."""
        layout = self._layout
        time = TIME.in_units(self._unit).described
        along = time if self.along == TIME.name else {"long_name": "row of the case", "units": "1"}
        numbers = np.empty(self.shape, dtype=VARIABLES["case"].dtype)
        for record, place in zip(self._records, self.places, strict=True):
            numbers[place] = record.index
        case = {"case": Labelled(self.dimensions, VARIABLES["case"].described, numbers)}
        labels = {
            name: Labelled((dimension,), described_key(key, self._unit), values)
            for name, (key, dimension, values) in layout.labels.items()
        }
        both = case | labels if "case" in layout.lengths else labels | case
        bins = {
            end: Labelled((gathered.bins,), described, edges)
            for gathered in self._columns.values()
            for end, (described, edges) in gathered.edges.items()
        }
        return {
            self.along: Labelled((self.along,), along, self._times),
            **both,
            **bins,
            **self._snapshots_of_cases,
        }

    @property
    def _snapshots_of_cases(self) -> dict[str, Labelled]:
        """Times of the snapshots, common ones or those of each case; nothing without snapshots."""
        described = VARIABLES["snapshot"].in_units(self._unit).described
        if not (most := self._snapshots.longest.size):
            return {}
        if (common := self._snapshots.common(None)) is not None:
            return {"snapshot": Labelled(("snapshot",), described, common)}
        times = np.full((*self.shape, most), np.nan)
        for record, place in zip(self._records, self.places, strict=True):
            own = self._snapshot_times.get(record.index, np.empty(0))
            times[place][: own.size] = own
        number = {"long_name": "number of the snapshot in the case", "units": "1"}
        rows = Labelled((SNAPSHOT_ROW,), number, np.arange(most))
        return {SNAPSHOT_ROW: rows, "snapshot": Labelled((*self.dimensions, SNAPSHOT_ROW), described, times)}

    @property
    def numbers(self) -> dict[str, Labelled]:
        """Numbers of whole cases, NaN where a case has none."""
        numbers = {}
        for name, values in self._numbers.items():
            held = np.full(self.shape, np.nan)
            for record, place in zip(self._records, self.places, strict=True):
                held[place] = values.get(record.index, np.nan)
            described = self._known[name].in_units(self._unit).described
            numbers[name] = Labelled(self.dimensions, described, held)
        return numbers

    @property
    def columns(self) -> dict[str, tuple[tuple[str, ...], Mapping[str, str], tuple[int, ...]]]:
        """Name -> dimensions, attributes and shape of each column, and of time where cases differ in it."""
        columns = {}
        of_cases = (
            {TIME.name: GatheredColumn(TIME.in_units(self._unit).described)} if self.along == ROW else {}
        )
        for name, gathered in (of_cases | self._columns).items():
            dimensions, shape = (*self.dimensions, self.along), (*self.shape, self._times.size)
            if gathered.bins:
                dimensions, shape = (
                    (*dimensions, gathered.bins),
                    (*shape, gathered.edges[gathered.bins][1].size),
                )
            columns[self._name(name)] = (dimensions, gathered.described, shape)
        return columns

    def _name(self, column: str) -> str:
        return f"{column}{OVER_TIME}" if column in self._layout.labels else column

    def curves(self) -> Iterator[tuple[tuple[int, ...], dict[str, FloatArray]]]:
        """Yield the place of each complete case, and its columns at the common times or in all rows."""
        for record, place in zip(self._records, self.places, strict=True):
            if record.index in self.failed:
                continue
            try:
                columns = self._read(record)
            except Exception:  # as above
                self.failed[record.index] = INCOMPLETE
            else:
                yield place, columns

    def _read(self, record: CaseRecord) -> dict[str, FloatArray]:
        case = self._kept.pop(record.index, None)
        if case is None:
            with _open(record) as opened_case:
                case = _Curves.of(opened_case, self._held[record.index])
        times, columns = case.times, {self._name(name): values for name, values in case.columns.items()}
        if self.along == ROW:
            if len(times) > self._times.size:
                raise ValueError(f"{record.source}: has been changed")
            return {self._name(TIME.name): times, **columns}
        if not np.array_equal(times, self._times):
            rows = rows_at(times, self._times, steady=case.settled)
            columns = {name: values[rows] for name, values in columns.items()}
            if (rows < 0).any():  # behind the end of the case
                columns = {name: values.astype(np.float64) for name, values in columns.items()}
                for values in columns.values():
                    values[rows < 0] = np.nan
        return columns

    @property
    def notes(self) -> list[str]:
        """Lines on columns that some cases lack, and on cases of other versions of the code."""
        alike: dict[frozenset[int], list[str]] = {}
        for name in self._columns:
            if lacking := frozenset(index for index, held in self._held.items() if name not in held):
                alike.setdefault(lacking, []).append(name)
        lines = [
            f"{', '.join(sorted(names))}: NaN in {numbered(sorted(cases), _NAMED)}"
            for cases, names in alike.items()
            if len(cases) < len(self._held)
        ]
        if ((self._of_first or frozenset()) - self._shared.keys()) & {"gfmdlayer_version", "git_commit"}:
            lines.append(
                "different versions of gfmdlayer wrote the cases (gfmdlayer_version and git_commit of their "
                "files); --restart computes all of them again"
            )
        return lines

    def _warn(self, index: int, said: str) -> None:
        for line in dict.fromkeys(said.splitlines()):
            kind = re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "#", line)
            self._warned.setdefault(kind, (line, []))[1].append(index)

    @property
    def warnings(self) -> list[str]:
        """Warnings of the cases; of those that differ only in numbers the first, with the cases."""
        whole = len(self._held)
        return [
            line if len(cases) == whole else f"{numbered(cases, _NAMED)}: {line}"
            for line, cases in self._warned.values()
        ]

    @property
    def attributes(self) -> dict[str, object]:
        """Attributes that all cases share, swept keys, failed and waiting cases, notes."""
        lost = sorted(self.failed.items())
        waiting = " ".join(f"{index:04d}" for index, reason in lost if reason == WAITING)
        report = "\n".join(f"{index:04d}: {reason}" for index, reason in lost if reason != WAITING)
        own = {"swept": " ".join(self._swept.keys), "complete": int(not waiting), "failed": report}
        own |= {"incomplete": waiting, "notes": "\n".join(self.notes)}
        own |= {"warnings": "\n".join(self.warnings)} if self.warnings else {}
        return {**self._shared, **self._swept.sampling, **own}


def rows_at(times: FloatArray, wanted: FloatArray, *, steady: bool = False) -> IntArray:
    """Find the rows of a case at given times, -1 where there is none; both increase.

    After a steady state, the last row stands for all later times.
    """
    if times.size == 0 or wanted.size == 0:
        return np.full(wanted.shape, -1)
    tolerance = SAME_TIME * min(times[-1], wanted[-1])
    after = np.searchsorted(times, wanted - tolerance).clip(max=times.size - 1)
    matched = (np.abs(times[after] - wanted) <= tolerance) | (steady & (wanted > times[-1]))
    return np.where(matched, after, -1)


class Labels(NamedTuple):
    """Labels along a dimension: the swept key that they are values of, numbers or texts."""

    key: str
    dimension: str
    values: NDArray[np.generic]


class SweepLayout(NamedTuple):
    """Lengths of the dimensions, labels by coordinate, and the place of each case along the dimensions."""

    lengths: dict[str, int]
    labels: dict[str, Labels]
    places: list[tuple[int, ...]]


def lay_out(
    values: Sequence[Mapping[str, object]], keys: Sequence[str], listed: bool, names: Iterable[str] = ()
) -> SweepLayout:
    """Return the dimensions of a sweep and the places of its cases, from the swept values of each.

    `names` are those of further dimensions of the results.
    """
    columns = [labels(key, [each[key] for each in values]) for key in keys]
    named = list(zip(dimension_names(keys, names), keys, columns, strict=True))
    axes = [{label: i for i, label in enumerate(dict.fromkeys(column))} for column in columns]
    cells = list(zip(*columns, strict=True)) if keys else [()]
    is_product = len(set(cells)) == len(values) == math.prod(map(len, axes))
    if listed or not is_product:
        along = {name: Labels(key, "case", np.array(column)) for name, key, column in named}
        return SweepLayout({"case": len(values)}, along, [(i,) for i in range(len(values))])
    lengths = {name: len(axis) for (name, *_), axis in zip(named, axes, strict=True)}
    along = {
        name: Labels(key, name, np.array(list(axis)))
        for (name, key, _), axis in zip(named, axes, strict=True)
    }
    places = [tuple(axis[label] for axis, label in zip(axes, cell, strict=True)) for cell in cells]
    return SweepLayout(lengths, along, places)


CHUNK = 1 << 16  # values: half a megabyte, which fits the chunk cache of HDF5


class _Packer:
    """Writes a column of all cases in whole chunks, which a thread packs while other cases are read."""

    def __init__(self, dataset: h5d.DatasetID, axes: int, pool: Executor) -> None:
        self._dataset, self._axes, self._pool = dataset, axes, pool
        shape = dataset.shape
        self._chunk: tuple[int, ...] = dataset.get_create_plist().get_chunk() if math.prod(shape) else shape
        self._whole = self._chunk[axes:] == shape[axes:]  # a chunk has whole curves
        self._at: tuple[int, ...] | None = None  # the chunk that is being filled, by its first place
        self._left: set[tuple[int, ...]] = set()
        self._buffer: FloatArray = np.empty(0)
        self._packed: list[tuple[tuple[int, ...], Future[bytes]]] = []

    def put(self, place: tuple[int, ...], curve: FloatArray) -> None:
        """Take the curve of a case."""
        if not curve.size:
            return
        first = tuple([i - i % length for i, length in zip(place, self._chunk, strict=False)])
        if first != self._at:
            if first in self._left or not self._whole:
                self.write()
                start = (*place, *(0 for _ in curve.shape))
                write_at(self._dataset, start, curve.reshape(*(1 for _ in place), *curve.shape))
                return
            self.leave()
            self._at, self._buffer = first, np.full(self._chunk, np.nan)
        self._buffer[tuple(map(int.__sub__, place, first))][: len(curve)] = curve

    def leave(self) -> None:
        """Have the chunk packed; write the one before it."""
        if self._at is None:
            return
        self.write()
        start = (*self._at, *(0 for _ in self._chunk[self._axes :]))
        try:
            packed = self._pool.submit(_packed, self._buffer)
        except RuntimeError:  # no thread can be started
            packed = Future()
            packed.set_result(_packed(self._buffer))
        self._packed.append((start, packed))
        self._left.add(self._at)
        self._at = None

    def write(self) -> None:
        """Write what has been packed."""
        for start, packed in self._packed:
            self._dataset.write_direct_chunk(start, packed.result())
        self._packed.clear()


def _packed(values: FloatArray) -> bytes:
    """Pack a chunk as the filters of `PACKED` do."""
    by_byte = np.ascontiguousarray(values.reshape(-1).view(np.uint8).reshape(-1, values.itemsize).T)
    return zlib.compress(by_byte.data, PACKED["compression_opts"])


def collect(directory: str | Path, records: Sequence[CaseRecord], swept: Swept) -> Path:
    """Write DIR/sweep.h5 from the files of the cases; a case without results is NaN, named in `failed`."""
    path = Path(directory) / SWEEP_FILE
    sweep = Gathered(records, swept)
    with new_file(path) as file, ThreadPoolExecutor(1) as pool:
        h5 = file.begin()
        coordinates = sweep.coordinates
        for name, (dimensions, described, values) in coordinates.items():
            text = {"dtype": h5py.string_dtype()} if values.dtype.kind == "U" else {}
            data = values.astype(object) if text else values
            add_variable(h5, name, dimensions, described, data=data, **text)

        def add(name: str, along: tuple[str, ...], described: Mapping[str, str], **how: Any) -> h5py.Dataset:
            variable = add_variable(h5, name, along, described, **how)
            beside = {x for x, (axes, *_) in coordinates.items() if {*axes} <= {*along}}
            beside |= {TIME.name} if ROW in along else set()
            variable.attrs["coordinates"] = " ".join(sorted(beside - {name, *along}))
            return variable

        for name, (dimensions, described, values) in sweep.numbers.items():
            add(name, dimensions, described, data=values)
        columns = {}
        for name, (dimensions, described, shape) in sweep.columns.items():
            options: dict[str, Any] = {"shape": shape, "dtype": "f8", "fillvalue": np.nan}
            if math.prod(shape):  # in chunks of whole curves of neighbouring cases
                chunks: list[int] = []
                for length in reversed(shape):
                    chunks.insert(0, max(1, min(length, CHUNK // math.prod(chunks))))
                options |= {"chunks": tuple(chunks), **PACKED}
            variable = add(name, dimensions, described, **options)
            columns[name] = _Packer(variable.id, len(sweep.shape), pool)
        for place, curves in sweep.curves():
            for name, values in curves.items():
                columns[name].put(place, values)
            file.check()
        for packer in columns.values():
            packer.leave()
        for packer in columns.values():
            packer.write()
        file.check()
        if SNAPSHOT_ROW in coordinates:  # no variable of this file lies beside these times
            h5.attrs["coordinates"] = "snapshot"
        h5.attrs.update(sweep.attributes)
    return path


def labelled(records: Sequence[CaseRecord], swept: Swept) -> xarray.Dataset:
    """Return cases as `open_results` does a folder; with fields of those in memory, if their grids agree."""
    import xarray

    sweep = Gathered(records, swept)
    columns = {name: np.full(shape, np.nan) for name, (*_, shape) in sweep.columns.items()}
    for place, curves in sweep.curves():
        for name, values in curves.items():
            columns[name][place][: len(values)] = values
    coords: dict[str, Any] = {
        name: (dims, values, described) for name, (dims, described, values) in sweep.coordinates.items()
    }
    held: dict[str, Any] = {
        name: (dims, columns[name], described) for name, (dims, described, _) in sweep.columns.items()
    }
    held |= {name: (dims, values, described) for name, (dims, described, values) in sweep.numbers.items()}
    cases = [record.source for record in records if isinstance(record.source, CaseContents)]
    cases = [case for case in cases if case.attributes["snapshots"]]
    if cases and _agree(cases, "x", "y"):
        first, below = cases[0].variables, _agree(cases, "z", "layer", "spring")
        (*_, along), snapshots, _ = coords["snapshot"]
        for name in SNAPSHOT_FIELDS if below else FIELDS:
            if name not in first:
                continue
            fields = np.full((*sweep.shape, snapshots.shape[-1], *first[name].shape[1:]), np.nan)
            for place, record in zip(sweep.places, records, strict=True):
                if not isinstance(record.source, CaseContents) or name not in record.source.names:
                    continue
                own, settled = record.source.values("snapshot"), bool(record.source.attribute("settled"))
                wanted = snapshots[place] if along == SNAPSHOT_ROW else snapshots
                rows = rows_at(own, wanted, steady=settled)
                fields[place][rows >= 0] = record.source.values(name)[rows[rows >= 0]]
            axes, described = cases[0].about(name)
            held[name] = ((*sweep.dimensions, along, *axes[1:]), fields, described)
        for name in ("x", "y", *(("z", "layer", "spring") if below else ())):
            if name in first:
                dimensions, described = cases[0].about(name)
                coords[name] = (dimensions, first[name].values, described)
    return xarray.Dataset(held, coords, sweep.attributes).set_coords(TIME.name)


def _agree(cases: Sequence[CaseContents], *names: str) -> bool:
    """Whether the cases have the same coordinates of their snapshots."""
    coordinates = [[case.values(name).tolist() for name in names if name in case.variables] for case in cases]
    return all(of_case == coordinates[0] for of_case in coordinates)
