"""Description of a case in two dimensions for ParaView: NNNN.xdmf beside NNNN.h5.

XDMF is XML that says where in the HDF5 file the points and the fields of each time are; no field is copied.
Its structured grids have x as their fastest axis, the fields of the case y. Therefore each point is listed,
in the group `paraview` of the HDF5 file, where the points compress well.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import h5py
import numpy as np

from gfmdlayer.results.netcdf import UNFINISHED, naming

FIELDS = ("displacement", "pressure", "gap")
POINTS = "paraview/points"
BLOCK = 2**18  # points written at a time


def describe(h5: h5py.File, path: Path) -> Path:
    """Describe the snapshots of a case for ParaView; the points are added to the case.

    Parameters
    ----------
    h5 : h5py.File
        The case, open for writing, on a grid of two dimensions.
    path : Path
        Its final name; the description is written beside it, with the suffix .xdmf.

    Returns
    -------
    Path
        The description.

    Raises
    ------
    ResultsError
        If the description cannot be written.
    """
    _add_points(h5)
    fields = {name: h5[name].shape for name in FIELDS if name in h5}
    times = h5["snapshot"][()].tolist()
    written = path.with_suffix(".xdmf")
    unfinished = written.with_name(written.name + UNFINISHED)
    with naming(written):
        ET.ElementTree(_xdmf(path.name, times, fields)).write(unfinished, "utf-8", xml_declaration=True)
        unfinished.replace(written)
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


def _xdmf(file: str, times: list[float], fields: dict[str, tuple[int, ...]]) -> ET.Element:
    root = ET.Element("Xdmf", Version="3.0")
    collection = {"Name": "surface", "GridType": "Collection", "CollectionType": "Temporal"}
    series = ET.SubElement(ET.SubElement(root, "Domain"), "Grid", collection)
    _, *points = next(iter(fields.values()))
    for i, time in enumerate(times):
        grid = ET.SubElement(series, "Grid", Name=f"snapshot {i}", GridType="Uniform")
        ET.SubElement(grid, "Time", Value=repr(time))
        ET.SubElement(grid, "Topology", TopologyType="3DSMesh", Dimensions=_numbers(1, *points))
        geometry = ET.SubElement(grid, "Geometry", GeometryType="XYZ")
        _stored(geometry, f"{file}:/{POINTS}", (*points, 3), 4)
        for name, shape in fields.items():
            attribute = ET.SubElement(grid, "Attribute", Name=name, AttributeType="Scalar", Center="Node")
            slab = {"ItemType": "HyperSlab", "Type": "HyperSlab", "Dimensions": _numbers(1, *points)}
            item = ET.SubElement(attribute, "DataItem", slab)
            start_stride_count = ET.SubElement(item, "DataItem", Dimensions="3 3", Format="XML")
            start_stride_count.text = _numbers(i, 0, 0, 1, 1, 1, 1, *points)
            _stored(item, f"{file}:/{name}", shape, 8)
    ET.indent(root)
    return root


def _stored(parent: ET.Element, where: str, shape: tuple[int, ...], precision: int) -> None:
    """Refer to a dataset of the HDF5 file, whose numbers have `precision` bytes."""
    form = {"Format": "HDF", "NumberType": "Float", "Precision": str(precision)}
    ET.SubElement(parent, "DataItem", form, Dimensions=_numbers(*shape)).text = where


def _numbers(*numbers: int) -> str:
    return " ".join(map(str, numbers))
