"""The description for ParaView: every array that it names is in the file, point by point where it belongs."""

from xml.etree import ElementTree as ET

import h5py
import numpy as np

from gfmdlayer.body.solid import LayerDepth
from gfmdlayer.results import case_file as files
from gfmdlayer.results.reader import is_complete, open_case
from tests.recordings import case_file, named

X, Y = np.arange(12) / 12 - 0.5, 0.5 * (np.arange(10) / 10 - 0.5)
TIMES = (0.5, 2.0)
FIELDS = np.random.default_rng(1).random((3, len(TIMES), X.size, Y.size))
NAMES = ("displacement", "pressure", "gap")


def write_case(folder):
    with case_file(folder / "0000.h5", {"x": X, "y": Y}) as case:
        for time, *fields in zip(TIMES, *FIELDS, strict=True):
            case.snapshot(time, named(*fields))
    return folder / "0000.xdmf"


def values(item, folder):
    """Read an array as XDMF says, in the order in which it runs over the points."""
    shape = tuple(map(int, item.attrib["Dimensions"].split()))
    if item.attrib.get("ItemType") == "HyperSlab":
        window, source = item.findall("DataItem")
        start, stride, count = np.array((window.text or "").split(), dtype=int).reshape(3, -1)
        assert tuple(count) == shape
        places = tuple(slice(a, a + s * c, s) for a, s, c in zip(start, stride, count, strict=True))
        return values(source, folder)[places].ravel()
    file, _, dataset = (item.text or "").partition(":")
    with h5py.File(folder / file) as h5:
        assert h5[dataset].shape == shape
        assert h5[dataset].dtype.itemsize == int(item.attrib["Precision"])
        return np.asarray(h5[dataset][()])


def test_fields_lie_on_their_points_at_their_times(tmp_path):
    grids = ET.parse(write_case(tmp_path)).findall("Domain/Grid[@CollectionType='Temporal']/Grid")
    assert [float(time.attrib["Value"]) for grid in grids for time in grid.findall("Time")] == list(TIMES)
    for place, grid in enumerate(grids):
        topology, points = grid.find("Topology"), grid.find("Geometry/DataItem")
        assert topology is not None
        assert points is not None
        assert np.prod([int(n) for n in topology.attrib["Dimensions"].split()]) == X.size * Y.size
        x, y, z = values(points, tmp_path).reshape(-1, 3).T
        i, j = (np.abs(at[:, None] - axis).argmin(axis=1) for at, axis in ((x, X), (y, Y)))
        np.testing.assert_allclose(x, X[i], atol=1e-7)  # single precision
        np.testing.assert_allclose(y, Y[j], atol=1e-7)
        assert not z.any()
        found = {a.attrib["Name"]: values(a[0], tmp_path) for a in grid.findall("Attribute")}
        assert tuple(found) == NAMES
        for name, field in zip(NAMES, FIELDS, strict=True):
            np.testing.assert_array_equal(found[name], field[place][i, j])


def test_fields_below_the_surface_lie_on_points_at_their_depths_at_their_times(tmp_path):
    places = [LayerDepth(0.0, 0), LayerDepth(0.1, 0), LayerDepth(0.1, 1)]
    below = np.random.default_rng(2).random((len(places), X.size, Y.size)).astype("f4")
    with case_file(tmp_path / "0000.h5", {"x": X, "y": Y}, places=places) as case:
        surface = dict(zip(NAMES, FIELDS[:, 0], strict=True))
        case.snapshot(0.5, surface)  # without fields below the surface
        case.snapshot(2.0, surface | {"stress_zz": below})
    document = ET.parse(tmp_path / "0000.xdmf")
    (grid,) = document.findall("Domain/Grid[@Name='inside']/Grid")
    assert [float(time.attrib["Value"]) for time in grid.findall("Time")] == [2.0]
    points = values(grid.findall("Geometry/DataItem")[0], tmp_path)
    assert points.shape == (3, X.size, Y.size, 3)
    np.testing.assert_allclose(points[:, 0, 0, 2], [0.0, 0.1, 0.1], atol=1e-7)
    np.testing.assert_allclose(points[1, :, 3, 0], X, atol=1e-7)
    (attribute,) = grid.findall("Attribute")
    np.testing.assert_array_equal(values(attribute[0], tmp_path), below.ravel())
    assert is_complete(tmp_path / "0000.h5")


def test_points_are_written_in_blocks(tmp_path, monkeypatch):
    whole = values_of_points(write_case(tmp_path))
    monkeypatch.setattr(files, "POINTS_WRITTEN", 35)  # 4 rows of 12
    np.testing.assert_array_equal(values_of_points(write_case(tmp_path)), whole)


def values_of_points(described):
    with h5py.File(described.with_suffix(".h5")) as h5:
        return np.asarray(h5[files.POINTS][()])


def test_described_case_stays_a_complete_case_for_xarray(tmp_path):
    path = write_case(tmp_path).with_suffix(".h5")
    assert is_complete(path)
    with open_case(path) as case:
        assert set(case.data_vars) == {"displacement", "pressure", "gap"}


def test_lines_and_cases_without_snapshots_are_not_described(tmp_path):
    with case_file(tmp_path / "0000.h5", {"x": X}) as case:
        case.snapshot(1.0, named(X, X, X))
    with case_file(tmp_path / "0001.h5", {"x": X, "y": Y}):
        pass
    assert list(tmp_path.glob("*.xdmf")) == []
