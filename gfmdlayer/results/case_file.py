"""The variables of a case, alike in its file and in memory: rows in time, snapshots, where they come from.

    time(time), the columns of the observables                    x(x)[, y(y)]
    snapshot(snapshot), displacement, pressure, gap; traction with attraction, imprint with a hardness,
    shear_x, slip_velocity_x with friction; displacement_body, displacement_counterbody where both deform
                                                                                       (snapshot, x[, y])
    z(z), layer(z); displacement_x, stress_xx and others                  (snapshot, z, x[, y])
    spring_strain, spring_force, from which these follow at any depth     (snapshot, spring, x[, y])

The variables are views of a recording, so that a long run is not in memory twice. The file ends with a seal,
the checksum of all of it; in a large one, or one with snapshots, chunks carry checksums too, so that damaged
data are refused when they are read. A small file without snapshots is made of a `Template`.
A case in two dimensions has a description for ParaView beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import h5py
import numpy as np
from h5py import h5d
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import Attribute, FloatArray
from gfmdlayer.files.locks import write_new
from gfmdlayer.files.whole import sealed, unfinished
from gfmdlayer.made_once import made_once
from gfmdlayer.observables import Column, known_columns
from gfmdlayer.results.names import BELOW, FIELDS, VARIABLES, described_key, dimension_names, labels
from gfmdlayer.results.netcdf import (
    PACKED,
    NewFile,
    add_variable,
    naming,
    new_file,
    write_at,
)
from gfmdlayer.results.provenance import now, provenance
from gfmdlayer.results.template import MARKED, Template

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.body.solid import LayerDepth
    from gfmdlayer.results.recording import Recording

SMALL = 1 << 20  # bytes of a case, of which a file is made in memory; HDF5 writes more
CHUNK_ROWS = 128
BLOCK = 2**20  # points of a snapshot in a chunk
CHECKED = PACKED | {"fletcher32": True}
# The length to which rows and snapshots may grow. It has an end: h5netcdf looks for the size of an endless
# dimension at all variables whenever it opens one, by which xarray took four times as long.
LONGEST = 2**48


def _size(dataset: xarray.Dataset) -> int:
    """Return the bytes of the coordinates of a dataset."""
    return sum(coordinate.nbytes for coordinate in dataset.coords.values())


class Form(NamedTuple):
    """All of a variable but its values and the length of its first dimension."""

    dimensions: tuple[str, ...]
    described: tuple[tuple[str, str], ...]  # attributes
    dtype: str = "f8"  # as numpy names it; empty for text
    inner: tuple[int, ...] = ()  # lengths of the dimensions behind the first
    beside: tuple[str, ...] = ()  # coordinates that are not dimensions


class Variable(NamedTuple):
    """A variable: its form, and its values in parts along its first dimension.

    A part is None for a snapshot without the field: it is NaN, and takes no space in the file.
    """

    form: Form
    parts: Sequence[NDArray[Any] | None]

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the dimensions."""
        length = sum(1 if part is None else len(part) for part in self.parts) if self.form.dimensions else 0
        return (length, *self.form.inner) if self.form.dimensions else ()

    def placed(self) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield the parts that are known, each after the place where it begins."""
        start = 0
        for part in self.parts:
            if part is not None:
                yield start, part
            start += 1 if part is None else len(part)

    @property
    def values(self) -> NDArray[Any]:
        """All values, in one array."""
        first, *others = self.parts or [None]
        if first is not None and not others:
            return first.astype(self.form.dtype or first.dtype, copy=False)
        values = np.empty(self.shape, self.form.dtype)
        if any(part is None for part in self.parts):
            values[...] = np.nan
        for start, part in self.placed():
            values[start : start + len(part)] = part
        return values


class CaseContents(NamedTuple):
    """The variables and the attributes of a case, as they are in its file."""

    variables: Mapping[str, Variable]
    attributes: Mapping[str, Attribute]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables."""
        return tuple(self.variables)

    @property
    def noted(self) -> Iterable[str]:
        """Names of the attributes."""
        return self.attributes

    def attribute(self, name: str) -> object:
        """Return an attribute, None if there is none of this name."""
        return self.attributes.get(name)

    def values(self, name: str) -> NDArray[Any]:
        """Return the values of a variable."""
        return self.variables[name].values

    def about(self, name: str) -> tuple[tuple[str, ...], Mapping[str, str]]:
        """Return dimensions and attributes of a variable."""
        form = self.variables[name].form
        return form.dimensions, dict(form.described)

    def dataset(self) -> xarray.Dataset:
        """Return the case as `open_case` gives it."""
        held: dict[str, Labelled] = {
            name: (variable.form.dimensions, variable.values, variable.form.described)
            for name, variable in self.variables.items()
        }
        beside = {name for variable in self.variables.values() for name in variable.form.beside}
        coords = [name for name, (axes, *_) in held.items() if name in beside or axes in ((name,), ())]
        return labelled(held, coords, self.attributes)


# Dimensions, values and attributes of a variable.
Labelled: TypeAlias = tuple[tuple[str, ...], NDArray[Any], tuple[tuple[str, str], ...]]


def labelled(
    variables: Mapping[str, Labelled], coords: Collection[str], attributes: Mapping[str, Attribute]
) -> xarray.Dataset:
    """Return variables as a dataset, in which some are coordinates."""
    # Xarray aligns and merges the variables of each new dataset, which takes longer than a small contact. Of
    # the same form and coordinates as one before, a dataset is a copy with other values.
    form = tuple(
        (name, axes, about, values.shape, values.dtype.str)
        for name, (axes, values, about) in variables.items()
    )
    known = tuple((name, variables[name][1].tobytes()) for name in coords)
    data = {name: values for name, (_, values, _) in variables.items() if name not in coords}
    dataset = _without_values(form, known).copy(data=data)
    dataset.attrs.update(attributes)
    return dataset


@made_once(_size)
def _without_values(
    form: tuple[tuple[str, tuple[str, ...], tuple[tuple[str, str], ...], tuple[int, ...], str], ...],
    coords: tuple[tuple[str, bytes], ...],
) -> xarray.Dataset:
    """Return a dataset of a form whose coordinates alone have values."""
    import xarray

    values = dict(coords)
    held: dict[str, Any] = {}
    for name, axes, about, shape, dtype in form:
        nothing = np.broadcast_to(np.zeros((), dtype), shape)
        own = np.frombuffer(values[name], dtype).reshape(shape) if name in values else nothing
        held[name] = axes, own, dict(about)
    return xarray.Dataset(held).set_coords(list(values))


def case_contents(
    recording: Recording,
    coordinates: Mapping[str, ArrayLike],
    attributes: Mapping[str, Attribute] = MappingProxyType({}),
    columns: Iterable[Column] | None = None,
    unit: Callable[[str], str] = str,
    swept: Mapping[str, object] = MappingProxyType({}),
    places: Sequence[LayerDepth] = (),
) -> CaseContents:
    """Return the contents of a case.

    Parameters
    ----------
    recording : Recording
        Its rows and snapshots.
    coordinates : mapping
        Coordinates of the snapshots by name, in the order of the axes.
    attributes : mapping
        Attributes; they replace those of the recording.
    columns : iterable of Column, optional
        Columns that rows may have, by default those of all observables.
    unit : callable
        Returns the label of a unit from its words.
    swept : mapping
        Values of the swept keys.
    places : sequence of LayerDepth
        Places of the fields below the surface.
    """
    declared = {column.name: column for column in (known_columns().values() if columns is None else columns)}
    if unknown := recording.widths.keys() - declared.keys():
        known = ", ".join(sorted(declared))
        raise KeyError(f"no variable {min(unknown)!r} is declared; known: {known}")
    variables: dict[str, Variable] = {}
    unit = cache(unit)

    def add(column: Column, axes: tuple[str, ...], *parts: NDArray[Any] | None, **form: Any) -> None:
        variables[column.name] = Variable(_form(column, unit(column.units), axes, **form), parts)

    # Dimensions come before the variables along them: time, points, bins, snapshots.
    others = [declared[name] for name in recording.widths if name != "time"]
    add(declared["time"], ("time",), *recording.parts("time"))
    for name, values in coordinates.items():
        add(VARIABLES[name], (name,), np.asarray(values, dtype=np.float64))
    for bins in dict.fromkeys(column.along for column in others if column.along is not None):
        for name, edges, described in replace(bins, units=unit(bins.units)).ends:
            variables[name] = Variable(Form((bins.name,), tuple(described.items())), [np.array(edges)])
    add(VARIABLES["snapshot"], ("snapshot",), np.array(recording.times))
    _add_fields(add, recording, {name: variables[name].shape[0] for name in coordinates}, places)
    for column in others:
        if column.along is None:
            add(column, ("time",), *recording.parts(column.name))
        else:
            beside = tuple(name for name, *_ in column.along.ends if name != column.along.name)
            parts = (part.reshape(-1, column.size) for part in recording.parts(column.name))
            add(column, ("time", column.along.name), *parts, inner=(column.size,), beside=beside)
    # The values of the swept keys are coordinates; none has the name of a column or of a dimension.
    names = dimension_names([*swept], {*declared, *variables})
    for name, (key, value) in zip(names, swept.items(), strict=True):
        about = {"long_name": key, **described_key(key, unit)}
        del about["key"]
        label = np.array(labels(key, [value])[0])
        dtype = "" if label.dtype.kind == "U" else label.dtype.str
        variables[name] = Variable(Form((), tuple(about.items()), dtype), [label])
    ended: dict[str, Attribute] = {
        "started": recording.started,
        "finished": now(),
        "wall_seconds": recording.elapsed,
    }
    counts = {"rows": recording.count, "snapshots": len(recording.times), "complete": 1}
    noted = {**provenance(), **ended, **attributes, **recording.noted, **counts}
    # The notes on the configuration, then the doubts that arose in the run.
    said = [str(held["warnings"]) for held in (attributes, recording.noted) if held.get("warnings")]
    if said:
        noted["warnings"] = "\n".join(said)
    return CaseContents(variables, noted)


@lru_cache(maxsize=256)
def _form(
    column: Column,
    unit: str,
    axes: tuple[str, ...],
    inner: tuple[int, ...] = (),
    beside: tuple[str, ...] = (),
) -> Form:
    """Return the form of a column in its unit."""
    described = replace(column, units=unit).described
    return Form(axes, tuple(described.items()), column.dtype, inner, beside)


def _add_fields(
    add: Callable[..., None], recording: Recording, lengths: Mapping[str, int], places: Sequence[LayerDepth]
) -> None:
    """Add the fields of the snapshots, after the depths, layers and springs of those below the surface."""
    axes, shape = tuple(lengths), tuple(lengths.values())
    fields = recording.fields or {"displacement": [], "pressure": []}
    known = {
        name: next((np.shape(field) for field in every if field is not None), shape)
        for name, every in fields.items()
    }
    for name, held in known.items():
        if held[-len(shape) :] != shape:
            raise ValueError(f"{name} of shape {held}; must be {shape}")
    below = {BELOW[name]: known[name][0] for name in fields if name in BELOW}
    if "z" in below:
        add(VARIABLES["z"], ("z",), np.array([place.depth for place in places]))
        add(VARIABLES["layer"], ("z",), np.array([place.layer for place in places]))
    if "spring" in below:
        add(VARIABLES["spring"], ("spring",), np.arange(below["spring"]))
    for name, every in fields.items():
        further = (BELOW[name],) if name in BELOW else ()
        parts = (field if field is None else field[np.newaxis] for field in every)
        beside = ("layer",) if further == ("z",) else ()
        add(VARIABLES[name], ("snapshot", *further, *axes), *parts, inner=known[name], beside=beside)


def write_case(path: str | Path, case: CaseContents, *, durable: bool = True) -> None:
    """Write the file of a case, and in two dimensions its description for ParaView.

    `durable` waits until it is on the disk. ResultsError, which names the file, if it cannot be written; an
    earlier file then stays.
    """
    path, attributes = Path(path), {**case.attributes}
    if swept := [name for name, variable in case.variables.items() if not variable.form.dimensions]:
        attributes["coordinates"] = " ".join(swept)
    growing = {name for name, variable in case.variables.items() if _grows(variable.form)}
    shapes = {name: variable.shape for name, variable in case.variables.items()}
    plain = not any(len(shapes[name]) > 1 and shapes[name][0] for name in growing)
    plain = plain and 8 * sum(map(math.prod, shapes.values())) <= SMALL
    forms = tuple(
        (name, variable.form if name in growing else variable.form._replace(inner=shapes[name]))
        for name, variable in case.variables.items()
    )
    template = _template(forms, tuple((name, _like(value)) for name, value in attributes.items()), plain)
    values = {
        name: variable.values for name, variable in case.variables.items() if plain or name not in growing
    }
    contents = template.filled(values, attributes)
    if plain:
        with naming(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            with unfinished(path, durable=durable) as part:
                write_new(part, sealed(contents))
        return
    with new_file(path) as file:
        h5 = file.begin(contents)
        for name in growing:
            _fill(file, name, case.variables[name])
        if "y" in case.variables and case.attributes["snapshots"]:
            describe(h5, path)


def _fill(file: NewFile, name: str, variable: Variable) -> None:
    """Write the values of a variable that grows."""
    dataset, shape = h5d.open(file.h5.id, name.encode()), variable.shape
    if shape[0]:
        dataset.set_extent(shape)
    for start, part in variable.placed():
        write_at(dataset, (start, *(0 for _ in shape[1:])), np.ascontiguousarray(part, dataset.dtype))
        file.check()


# The template of a case file: all variables and attributes, without their values.
#
# A file without snapshots and distributions is made by putting the values into the bytes of the template. In
# others HDF5 writes what lies along the rows or the snapshots, in chunks with checksums of their own.
#
# Snapshots are shuffled by byte and compressed by gzip at level 1. Measured on a rough contact of 2^22
# points, the pressure, mostly zeros, shrinks to 10 % in 34 ns a point, the gap to 74 % and the displacement
# to 82 % in 142 ns, of which the disk takes 13; level 4 gains 1 % more.


def _like(value: Attribute) -> str | float | tuple[str, tuple[int, ...]]:
    """Return what attributes of one type and shape have in common."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape
    return "" if isinstance(value, str) else 0 if isinstance(value, int) else 0.5


@lru_cache(maxsize=32)
def _template(
    forms: tuple[tuple[str, Form], ...],
    kinds: tuple[tuple[str, str | float | tuple[str, tuple[int, ...]]], ...],
    plain: bool,
) -> Template:
    """Return the template of files with variables of these forms."""
    placed = [name for name, form in forms if _grows(form) and plain and not form.inner]

    def lay_out(h5: h5py.File) -> None:
        for name, form in forms:
            if name in placed:
                options: dict[str, Any] = {"shape": MARKED + placed.index(name)}
            else:
                options = _growing(form) if _grows(form) else {"shape": form.inner}
            dtype = form.dtype or h5py.string_dtype()
            variable = add_variable(h5, name, form.dimensions, dict(form.described), dtype=dtype, **options)
            if form.beside:
                variable.attrs["coordinates"] = " ".join(form.beside)

    return Template(
        lay_out,
        placed,
        [name for name, form in forms if not _grows(form)],
        {name: np.zeros(kind[1], kind[0]) if isinstance(kind, tuple) else kind for name, kind in kinds},
    )


def _grows(form: Form) -> bool:
    """Whether a variable lies along the rows or the snapshots."""
    return form.dimensions[:1] in (("time",), ("snapshot",))


def _growing(form: Form) -> dict[str, Any]:
    """Options of a variable whose first dimension grows, fields of snapshots in blocks of BLOCK points."""
    inner, chunk = form.inner, (CHUNK_ROWS, *form.inner)
    options: dict[str, Any] = CHECKED if inner else {"fletcher32": True}
    if inner and form.dimensions[0] == "snapshot":
        chunk = (1, -(-inner[0] // -(-math.prod(inner) // BLOCK)), *inner[1:])
        if form.dimensions[1] in BELOW.values():
            options = options | {"fillvalue": np.nan}
    return {"shape": (0, *inner), "maxshape": (LONGEST, *inner), "chunks": chunk, **options}


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
