"""Description of a case in two dimensions for ParaView: NNNN.xdmf beside NNNN.h5.

XDMF is XML that says where in the HDF5 file the points and the fields of each time are; no field is copied.
Its structured grids have x as their fastest axis, the fields of the case y. Therefore each point is listed,
in the group `paraview` of the HDF5 file, where the points compress well.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from gfmdlayer.files.locks import write_new
from gfmdlayer.files.whole import unfinished
from gfmdlayer.results.netcdf import naming
from gfmdlayer.results.schema import FIELDS

POINTS = "paraview/points"
BLOCK = 2**18  # points written at a time

_DOUBLE, _SINGLE = (f'Format="HDF" NumberType="Float" Precision="{size}"' for size in (8, 4))


def describe(h5: h5py.File, path: Path) -> Path:
    """Describe the snapshots of a case, `path` its final name, for ParaView; add the points to the case."""
    _add_points(h5)
    fields = {name: h5[name].shape for name in FIELDS if name in h5}
    times = h5["snapshot"][()].tolist()
    written = path.with_suffix(".xdmf")
    with naming(written), unfinished(written) as part:
        write_new(part, _xdmf(path.name, times, fields).encode())
    return written


def _add_points(h5: h5py.File) -> None:
    """Add the coordinates (x, y, 0) of the points, some rows of the grid at a time."""
    x, y = h5["x"][()], h5["y"][()]
    rows = min(x.size, -(-BLOCK // y.size))  # equal rows of one chunk compress well
    packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
    points = h5.create_dataset(POINTS, (x.size, y.size, 3), "f4", chunks=(rows, y.size, 3), **packed)
    for start in range(0, x.size, rows):
        some = x[start : start + rows]
        block = np.zeros((some.size, y.size, 3), "f4")
        block[..., 0] = some[:, None]
        block[..., 1] = y
        points[start : start + rows] = block


def _xdmf(file: str, times: list[float], fields: dict[str, tuple[int, ...]]) -> str:
    """Return the description of the fields, whose shapes are (times, x, y), in the HDF5 file."""
    count, nx, ny = next(iter(fields.values()))
    grids = []
    for i, time in enumerate(times):
        attributes = [
            f"""
        <Attribute Name="{name}" AttributeType="Scalar" Center="Node">
          <DataItem ItemType="HyperSlab" Type="HyperSlab" Dimensions="1 {nx} {ny}">
            <DataItem Dimensions="3 3" Format="XML">{i} 0 0  1 1 1  1 {nx} {ny}</DataItem>
            <DataItem {_DOUBLE} Dimensions="{count} {nx} {ny}">{file}:/{name}</DataItem>
          </DataItem>
        </Attribute>"""
            for name in fields
        ]
        grids.append(f"""
      <Grid Name="snapshot {i}" GridType="Uniform">
        <Time Value="{time!r}"/>
        <Topology TopologyType="3DSMesh" Dimensions="1 {nx} {ny}"/>
        <Geometry GeometryType="XYZ">
          <DataItem {_SINGLE} Dimensions="{nx} {ny} 3">{file}:/{POINTS}</DataItem>
        </Geometry>{"".join(attributes)}
      </Grid>""")
    return f"""<?xml version="1.0" encoding="utf-8"?>
<Xdmf Version="3.0">
  <Domain>
    <Grid Name="surface" GridType="Collection" CollectionType="Temporal">{"".join(grids)}
    </Grid>
  </Domain>
</Xdmf>
"""
