"""What ParaView needs to open a case in two dimensions: NNNN.xdmf beside NNNN.h5.

XDMF is XML that says where in the HDF5 file the points and the fields of each time are; no field is copied.
Its structured grids run fastest along ParaView's x, our fields along y. So the points are given one by one,
in the group `paraview` of the HDF5 file, where they compress to little.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import h5py
import numpy as np

from gfmdlayer.files.whole import unfinished
from gfmdlayer.results.netcdf import naming

FIELDS = ("displacement", "pressure", "gap")
POINTS = "paraview/points"
BLOCK = 2**18  # points written at a time


def describe(h5: h5py.File, path: Path) -> Path:
    """Describe the snapshots of a case for ParaView; the points are added to the case.

    Parameters
    ----------
    h5
        The case, open for writing, on a grid of two dimensions.
    path
        Its final name; the description is written beside it, with the suffix .xdmf.

    Raises
    ------
    ResultsError
        If the disk refuses.
    """
    _add_points(h5)
    fields = {name: h5[name].shape for name in FIELDS if name in h5}
    times = h5["snapshot"][()].tolist()
    written = path.with_suffix(".xdmf")
    with naming(written), unfinished(written) as part:
        ET.ElementTree(_xdmf(path.name, times, fields)).write(part, "utf-8", xml_declaration=True)
    return written


def _add_points(h5: h5py.File) -> None:
    """Add the coordinates (x, y, 0) of the points, some rows of the grid at a time."""
    x, y = h5["x"][()], h5["y"][()]
    rows = min(x.size, -(-BLOCK // y.size))  # that repeat each other compress to little
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
    series = ET.SubElement(
        ET.SubElement(root, "Domain"),
        "Grid",
        Name="surface",
        GridType="Collection",
        CollectionType="Temporal",
    )
    _, *points = next(iter(fields.values()))
    for place, time in enumerate(times):
        grid = ET.SubElement(series, "Grid", Name=f"snapshot {place}", GridType="Uniform")
        ET.SubElement(grid, "Time", Value=repr(time))
        ET.SubElement(grid, "Topology", TopologyType="3DSMesh", Dimensions=_numbers(1, *points))
        geometry = ET.SubElement(grid, "Geometry", GeometryType="XYZ")
        _stored(geometry, f"{file}:/{POINTS}", (*points, 3), 4)
        for name, shape in fields.items():
            attribute = ET.SubElement(grid, "Attribute", Name=name, AttributeType="Scalar", Center="Node")
            one = ET.SubElement(
                attribute, "DataItem", ItemType="HyperSlab", Dimensions=_numbers(1, *points), Type="HyperSlab"
            )
            window = ET.SubElement(one, "DataItem", Dimensions="3 3", Format="XML")
            window.text = _numbers(place, 0, 0, 1, 1, 1, 1, *points)  # start, stride, count
            _stored(one, f"{file}:/{name}", shape, 8)
    ET.indent(root)
    return root


def _stored(parent: ET.Element, where: str, shape: tuple[int, ...], precision: int) -> None:
    """Refer to a dataset of the HDF5 file."""
    item = ET.SubElement(
        parent,
        "DataItem",
        Format="HDF",
        NumberType="Float",
        Precision=str(precision),
        Dimensions=_numbers(*shape),
    )
    item.text = where


def _numbers(*numbers: int) -> str:
    return " ".join(map(str, numbers))
