"""The file of one case: rows in time, snapshots of the surface, and where they come from.

    time(time), the columns of the observables                    x(x)[, y(y)]
    snapshot(snapshot), displacement, pressure, gap; traction with attraction, imprint with a hardness,
    shear_x, slip_velocity_x with friction; displacement_body, displacement_counterbody where both deform
                                                                                       (snapshot, x[, y])
    z(z), layer(z); displacement_x, stress_xx and others                  (snapshot, z, x[, y])
    spring_strain, spring_force, from which these follow at any depth     (snapshot, spring, x[, y])

Rows are appended ROWS_HELD at a time and snapshots are written at once, so that a run of any length needs the
same memory. Chunks carry checksums: damaged data are refused when they are read. The file ends with a seal,
the checksum of all of it. A case in two dimensions has a description for ParaView beside it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import TYPE_CHECKING, Any, Self

import h5py
import numpy as np
from h5py import h5d
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import Attribute, FloatArray
from gfmdlayer.files.locks import write_new
from gfmdlayer.files.whole import unfinished
from gfmdlayer.observables import Column, known_columns
from gfmdlayer.results.gathering import dimension_names, labels
from gfmdlayer.results.netcdf import (
    PACKED,
    NewFile,
    add_variable,
    append,
    contents,
    naming,
    new_file,
    set_attributes,
)
from gfmdlayer.results.provenance import now, provenance
from gfmdlayer.results.schema import BELOW, FIELDS, SNAPSHOT_FIELDS, VARIABLES, described_key

if TYPE_CHECKING:
    from gfmdlayer.body.solid import LayerDepth

# The template of a case file: all variables without their values.
#
# Laying out a small file takes longer than filling it, so that cases of equal layout share the template.
#
# Snapshots are shuffled by byte and compressed by gzip at level 1. Measured on a rough contact of 2^22
# points, the pressure, mostly zeros, shrinks to 10 % in 34 ns a point, the gap to 74 % and the displacement
# to 82 % in 142 ns, of which the disk takes 13; level 4 gains 1 % more.

CHUNK_ROWS = 128  # a chunk is written whole, and most of what a case of few steps takes on the disk
BLOCK = 2**20  # points of a snapshot in a chunk
CHECKED = PACKED | {"fletcher32": True}
SNAPSHOTS = ("snapshot", "displacement", "pressure")

Lengths = tuple[tuple[str, int], ...]
Fields = tuple[tuple[str, Column], ...]


@lru_cache(maxsize=8)
def case_template(columns: tuple[Column, ...], axes: Lengths, fields: Fields) -> bytes:
    """Return a file with all variables but the gap, with the bins of histograms and the provenance.

    `axes` are the coordinates of the grid with their lengths.
    """
    known = dict(fields)

    def lay_out(h5: h5py.File) -> None:
        h5.attrs.update(provenance())
        for column in columns:
            if column.name == "time":
                _add_column(h5, column)
        for name, length in axes:
            add_variable(h5, name, (name,), known[name].described, shape=(length,), dtype="f8")
        for bins in dict.fromkeys(column.along for column in columns if column.along is not None):
            for name, edges, described in bins.ends:
                add_variable(h5, name, (bins.name,), described, data=edges, dtype="f8")
        add_variable(h5, "snapshot", ("snapshot",), known["snapshot"].described, dtype="f8", **_growing())
        for field in ("displacement", "pressure"):
            add_field(h5, field, tuple(name for name, _ in axes), known[field])
        for column in columns:
            if column.name != "time":
                _add_column(h5, column)

    return contents(lay_out)


def _add_column(h5: h5py.File, column: Column) -> None:
    if column.along is None:
        add_variable(h5, column.name, ("time",), column.described, dtype=column.dtype, **_growing())
        return
    dimensions, options = ("time", column.along.name), _growing(column.size) | CHECKED
    dataset = add_variable(h5, column.name, dimensions, column.described, dtype=column.dtype, **options)
    if beside := [name for name, *_ in column.along.ends if name != column.along.name]:
        dataset.attrs["coordinates"] = " ".join(beside)


def _growing(*places: int) -> dict[str, Any]:
    """Options of a variable whose first axis grows."""
    shapes = {"shape": (0, *places), "maxshape": (None, *places), "chunks": (CHUNK_ROWS, *places)}
    return {**shapes, "fletcher32": True}


def add_field(h5: h5py.File, name: str, axes: tuple[str, ...], known: Column, **options: Any) -> h5py.Dataset:
    """Add a variable of the snapshots, in blocks of at most BLOCK points."""
    shape = tuple(len(h5[axis]) for axis in axes)
    rows = -(-shape[0] // -(-math.prod(shape) // BLOCK))
    grows = {"shape": (0, *shape), "maxshape": (None, *shape), "chunks": (1, rows, *shape[1:])}
    options = {"dtype": known.dtype, **grows, **CHECKED, **options}
    return add_variable(h5, name, ("snapshot", *axes), known.described, **options)


ROWS_HELD = 512


class CaseWriter:
    """Write one case; a context manager, after which the file is complete, or removed after an exception.

    `coordinates` are in the order of the arrays' axes; `attributes` replace those of the provenance;
    `elapsed` are seconds of earlier runs; `places` are those of the fields below the surface.
    ResultsError, which names the file, if it cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        coordinates: Mapping[str, ArrayLike],
        attributes: Mapping[str, Attribute] | None = None,
        columns: Iterable[Column] | None = None,
        elapsed: float = 0.0,
        unit: Callable[[str], str] = str,
        swept: Mapping[str, object] = MappingProxyType({}),
        places: Sequence[LayerDepth] = (),
    ) -> None:
        self.path, self._places = Path(path), places
        self._coordinates = {name: np.asarray(values) for name, values in coordinates.items()}
        self._shape = tuple(len(values) for values in self._coordinates.values())
        self._attributes, self._swept, self._unit = dict(attributes or {}), swept, unit
        declared = known_columns().values() if columns is None else columns
        self._declared = {column.name: column.in_units(unit) for column in declared}
        self._fields = tuple((name, each.in_units(unit)) for name, each in VARIABLES.items())
        self.noted: dict[str, Attribute] = {}  # at the end of the run
        self._elapsed = elapsed
        self._columns: tuple[str, ...] | None = None
        self._growing: dict[str, h5d.DatasetID] = {}
        self._held: list[tuple[float | FloatArray, ...]] = []
        self._rows = 0
        self._last_time = -math.inf

    def __enter__(self) -> Self:
        self._begun = time.monotonic()
        self._started = now()
        with ExitStack() as stack:
            self._file: NewFile = stack.enter_context(new_file(self.path))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._stack.__exit__(kind, error, trace)
            return
        with self._stack:
            if self._columns is None:
                self._begin(("time",))
            self._append_rows()
            ended: dict[str, Attribute] = {"finished": now(), "wall_seconds": self.elapsed}
            counts = {"rows": self._rows, "snapshots": self._growing["snapshot"].shape[0]}
            added = {name: value for name, value in ended.items() if name not in self._attributes}
            set_attributes(self._h5, {**added, **self.noted, **counts, "complete": 1})
            if len(self._shape) == 2 and counts["snapshots"]:
                describe(self._h5, self.path)

    @property
    def elapsed(self) -> float:
        """Seconds spent on the case so far."""
        return self._elapsed + time.monotonic() - self._begun

    def row(self, **values: float | FloatArray) -> None:
        """Record one accepted step: its `time`, later than in the row before, and the other columns.

        All rows have the columns of the first.
        """
        if self._columns is None:
            self._begin(tuple(values))
        elif values.keys() != set(self._columns):
            first = f"the first had {sorted(self._columns)}"
            raise ValueError(f"{self.path}: row has columns {sorted(values)}, {first}")
        time_now = float(values["time"])
        if not time_now > self._last_time:
            raise ValueError(f"{self.path}: row at time {time_now} follows one at {self._last_time}")
        self._last_time = time_now
        self._held.append(tuple(values[name] for name in self._columns or ()))
        if len(self._held) == ROWS_HELD:
            self._append_rows()

    def snapshot(
        self,
        time: float,
        displacement: FloatArray,
        pressure: FloatArray,
        *others: FloatArray | None,
    ) -> None:
        """Record the surface at a time, by arrays in the order of `schema.SNAPSHOT_FIELDS`.

        Those of the shape of the grid are given in every snapshot or in none; those below the surface have
        depths or springs as their first axis.
        """
        if self._columns is None:
            self._begin(("time",))
        given = dict(zip(SNAPSHOT_FIELDS, (displacement, pressure, *others), strict=False))
        fields = {name: np.asarray(field) for name, field in given.items() if field is not None}
        count = self._growing["snapshot"].shape[0]
        for name, field in fields.items():
            if name not in self._growing and (name in BELOW or not count):
                self._add_field(name, field, count)
        for name in SNAPSHOT_FIELDS:
            if name not in BELOW and (name in fields) != (name in self._growing):
                raise ValueError(f"{self.path}: some snapshots have a {name} and others have none")
        for name, field in fields.items():
            shape = (*self._growing[name].shape[1:2], *self._shape) if name in BELOW else self._shape
            if field.shape != shape:
                raise ValueError(f"{self.path}: {name} of shape {field.shape}; must be {shape}")
        append(self._growing["snapshot"], [time])
        for name, field in fields.items():
            append(self._growing[name], field[np.newaxis])
        for name in BELOW.keys() & self._growing.keys() - fields.keys():  # unwritten chunks take no space
            self._growing[name].set_extent((count + 1, *self._growing[name].shape[1:]))
        self._file.check()

    def _add_field(self, name: str, field: NDArray[Any], count: int) -> None:
        """Add a field of the snapshots, of which some before it may have no fields below the surface."""
        known, axes, options = dict(self._fields), tuple(self._coordinates), {}
        if (first := BELOW.get(name)) is not None:
            axes, options = (first, *axes), {"fillvalue": np.nan}
            if first not in self._h5:
                values = [place.depth for place in self._places] if first == "z" else range(len(field))
                described = known[first].described
                add_variable(self._h5, first, (first,), described, data=values, dtype=known[first].dtype)
            if first == "z" and "layer" not in self._h5:
                layers = [place.layer for place in self._places]
                add_variable(self._h5, "layer", ("z",), known["layer"].described, data=layers, dtype="i8")
        added = add_field(self._h5, name, axes, known[name], **options)
        if first == "z":
            added.attrs["coordinates"] = "layer"
        self._growing[name] = added.id
        if count and first is not None:
            added.id.set_extent((count, *added.shape[1:]))

    def note(self, **attributes: Attribute) -> None:
        """Add attributes of the file that are known at the end of the run."""
        self.noted.update(attributes)

    def _begin(self, columns: tuple[str, ...]) -> None:
        """Begin the file with the columns of the first row."""
        if "time" not in columns:
            raise ValueError(f"{self.path}: a row needs its time")
        if unknown := set(columns) - self._declared.keys():
            known = ", ".join(sorted(self._declared))
            raise KeyError(f"{self.path}: no variable {min(unknown)!r} is declared; known: {known}")
        axes = tuple((name, len(values)) for name, values in self._coordinates.items())
        declared = tuple(self._declared[name] for name in columns)
        self._h5 = self._file.begin(case_template(declared, axes, self._fields))
        for name, values in self._coordinates.items():
            self._h5[name][...] = values
        growing = dict.fromkeys((*columns, *SNAPSHOTS))
        self._growing = {name: h5d.open(self._h5.id, name.encode()) for name in growing}
        set_attributes(self._h5, {"started": self._started, **self._attributes})
        self._columns = columns
        # The values of the swept keys are coordinates; a name that a column has is the whole key.
        names = dimension_names([*self._swept], self._declared)
        for name, (key, value) in zip(names, self._swept.items(), strict=True):
            (held,) = labels(key, [value])
            described = {"long_name": key, **described_key(key, self._unit)}
            del described["key"]
            add_variable(self._h5, name, (), described, data=held)
        if names:
            set_attributes(self._h5, {"coordinates": " ".join(names)})

    def _append_rows(self) -> None:
        if not self._held:
            return
        for name, values in zip(self._columns or (), zip(*self._held, strict=True), strict=True):
            append(self._growing[name], values)
        self._rows += len(self._held)
        self._held.clear()
        self._file.check()


# Description of a case in two dimensions for ParaView: NNNN.xdmf beside NNNN.h5.
#
# XDMF is XML that says where in the HDF5 file the points and the fields of each time are; no field is copied.
# Its structured grids have x as their fastest axis, the fields of the case y. Therefore each point is listed,
# in the group `paraview` of the HDF5 file, where the points compress well.

POINTS, INSIDE = "paraview/points", "paraview/points_inside"
POINTS_WRITTEN = 2**18  # points written at a time

_FLOAT = 'Format="HDF" NumberType="Float" Precision="{}"'


def describe(h5: h5py.File, path: Path) -> Path:
    """Describe the snapshots of a case, `path` its final name, for ParaView; add the points to its file."""
    # The fields below the surface are a second grid, of the snapshots that have them; z points down.
    times = list(enumerate(h5["snapshot"][()].tolist()))
    above = {name: h5[name].shape for name in FIELDS if name in h5}
    below = {name: h5[name].shape for name, first in BELOW.items() if name in h5 and first == "z"}
    _add_points(h5, POINTS, np.zeros(1))
    grids = [_grid("surface", path.name, POINTS, times, above)]
    if below:
        some = next(iter(below))
        _add_points(h5, INSIDE, h5["z"][()])
        known = [(i, time) for i, time in times if not np.isnan(h5[some][(i, *[0] * (len(below[some]) - 1))])]
        grids.append(_grid("inside", path.name, INSIDE, known, below))
    written = path.with_suffix(".xdmf")
    with naming(written), unfinished(written) as part:
        write_new(part, _HEAD.format("".join(grids)).encode())
    return written


def _add_points(h5: h5py.File, name: str, z: FloatArray) -> None:
    """Add the coordinates of the points at these depths, some rows of the grid at a time."""
    x, y = h5["x"][()], h5["y"][()]
    rows = min(x.size, -(-POINTS_WRITTEN // y.size))  # equal rows of one chunk compress well
    shape, chunks = (z.size, x.size, y.size, 3), (1, rows, y.size, 3)
    points = h5.create_dataset(name, shape, "f4", chunks=chunks, **PACKED)
    for k, depth in enumerate(z):
        for start in range(0, x.size, rows):
            some = x[start : start + rows]
            block = np.full((some.size, y.size, 3), depth, "f4")
            block[..., 0] = some[:, None]
            block[..., 1] = y
            points[k, start : start + rows] = block


def _grid(
    grid: str, file: str, points: str, times: list[tuple[int, float]], fields: dict[str, tuple[int, ...]]
) -> str:
    """Return the description of fields, of the shape (times, [z,] x, y), in the HDF5 file."""
    count, *inner = next(iter(fields.values()))
    nz, nx, ny = inner if len(inner) == 3 else [1, *inner]
    along, whole = " ".join(map(str, inner)), len(inner) + 1
    precision = "8" if len(inner) == 2 else "4"
    grids = []
    for i, instant in times:
        part = f"{i}{' 0' * len(inner)}  {'1 ' * whole} 1 {along}"
        attributes = [
            f"""
        <Attribute Name="{name}" AttributeType="Scalar" Center="Node">
          <DataItem ItemType="HyperSlab" Type="HyperSlab" Dimensions="1 {along}">
            <DataItem Dimensions="3 {whole}" Format="XML">{part}</DataItem>
            <DataItem {_FLOAT.format(precision)} Dimensions="{count} {along}">{file}:/{name}</DataItem>
          </DataItem>
        </Attribute>"""
            for name in fields
        ]
        grids.append(f"""
      <Grid Name="snapshot {i}" GridType="Uniform">
        <Time Value="{instant!r}"/>
        <Topology TopologyType="3DSMesh" Dimensions="{nz} {nx} {ny}"/>
        <Geometry GeometryType="XYZ">
          <DataItem {_FLOAT.format(4)} Dimensions="{nz} {nx} {ny} 3">{file}:/{points}</DataItem>
        </Geometry>{"".join(attributes)}
      </Grid>""")
    return f"""
    <Grid Name="{grid}" GridType="Collection" CollectionType="Temporal">{"".join(grids)}
    </Grid>"""


_HEAD = """<?xml version="1.0" encoding="utf-8"?>
<Xdmf Version="3.0">
  <Domain>{}
  </Domain>
</Xdmf>
"""
