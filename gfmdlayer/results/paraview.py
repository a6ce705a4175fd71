"""Description of a case in two dimensions for ParaView: NNNN.xdmf beside NNNN.h5.

XDMF is XML that says where in the HDF5 file the points and the fields of each time are; no field is copied.
Its structured grids have x as their fastest axis, the fields of the case y. Therefore each point is listed,
in the group `paraview` of the HDF5 file, where the points compress well.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.files.locks import write_new
from gfmdlayer.files.whole import unfinished
from gfmdlayer.results.netcdf import PACKED, naming
from gfmdlayer.results.schema import BELOW, FIELDS

POINTS, INSIDE = "paraview/points", "paraview/points_inside"
BLOCK = 2**18  # points written at a time

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
    rows = min(x.size, -(-BLOCK // y.size))  # equal rows of one chunk compress well
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
    for i, time in times:
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
        <Time Value="{time!r}"/>
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
