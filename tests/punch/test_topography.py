"""Measured surfaces: files that are read or refused, and the steps to a periodic surface."""

import sys
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import xarray as xr

from gfmdlayer.case.notes import notes
from gfmdlayer.config import Config
from gfmdlayer.files.tables import TableError
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.measured import Topography
from gfmdlayer.punch.shape import Cell
from gfmdlayer.punch.topography import membrane, without_trend

GRID = Grid((12, 16), (3.0, 4.0))
LINE = Grid((16,), (4.0,))
X, Y = np.meshgrid(*(np.arange(n) / n for n in GRID.points), indexing="ij")
WAVES = 0.1 * np.cos(2 * np.pi * X) + 0.2 * np.sin(2 * np.pi * (2 * X - Y))


def saved(tmp_path, heights, name="h.npy"):
    np.save(tmp_path / name, heights)
    return tmp_path / name


def labelled(heights, spacing=0.25, **names):
    x, y = (spacing * np.arange(n) for n in heights.shape)
    found = xr.Dataset({"height": (("x", "y"), heights)}, coords={"x": x, "y": y})
    return found.rename(names) if names else found


# --- files that are read ---


def test_the_summits_of_a_measured_surface_touch_first(tmp_path):
    heights = Topography(file=saved(tmp_path, WAVES)).heights(GRID)
    np.testing.assert_allclose(heights, WAVES.max() - WAVES, atol=1e-15)
    assert heights.flat[np.argmax(WAVES)] == 0


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_arrays_text_hdf5_and_netcdf_hold_the_same(unit, tmp_path):
    expected = WAVES.max() - WAVES
    files = [saved(tmp_path, WAVES / unit), tmp_path / "h.txt", tmp_path / "h.h5"]
    np.savetxt(files[1], WAVES.T / unit, header="rows are y")
    with h5py.File(files[2], "w") as file:
        file["heights"] = WAVES / unit
        file["note"] = 3.0
    set_ = labelled(WAVES / unit, 0.25 / unit)
    for engine, name in (("h5netcdf", "h4.nc"), ("scipy", "h3.nc")):
        set_.to_netcdf(tmp_path / name, engine=engine)
        files.append(tmp_path / name)
    set_.transpose("y", "x").to_netcdf(tmp_path / "turned.nc", engine="h5netcdf")
    for file in [*files, tmp_path / "turned.nc"]:
        found = Topography(file=file, unit=unit).heights(GRID)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15, err_msg=file.name)


def linked(h5, other):
    h5["height"] = h5py.ExternalLink(other.name, "/height")


def linked_group(h5, other):
    h5["scan"] = h5py.ExternalLink(other.name, "/")


def stored(h5, other):
    h5.create_dataset("height", WAVES.shape, "f8", external=[(str(other), 0, WAVES.nbytes)])


def virtual(h5, other):
    layout = h5py.VirtualLayout(WAVES.shape, "f8")
    layout[...] = h5py.VirtualSource(other.name, "height", WAVES.shape)
    h5.create_virtual_dataset("height", layout)


@pytest.mark.parametrize("way", [linked, linked_group, stored, virtual])
def test_heights_in_other_files_are_refused(way, tmp_path):
    """The digest of a case knows the contents of the files that its configuration names, and of no others."""
    file = tmp_path / "h.h5"
    with h5py.File(tmp_path / "other.h5", "w") as h5:
        h5["height"] = WAVES
    with h5py.File(file, "w") as h5:
        way(h5, tmp_path / "other.h5")
    named = {"dataset": "scan/height"} if way is linked_group else {}
    with pytest.raises(
        TableError, match=r"(link to another file, other\.h5|in another file); must be in the file itself"
    ):
        Topography(file=file, **named).heights(GRID)


def test_one_of_several_datasets_is_chosen_by_name(tmp_path):
    file = tmp_path / "h.h5"
    with h5py.File(file, "w") as h5:
        h5["phase"] = 7 * WAVES
        h5["height"] = 3 * WAVES
        h5["scan 1/height"] = WAVES
    with pytest.raises(TableError, match="2 datasets of numbers on 2 axes: height, phase; dataset must name"):
        Topography(file=file).heights(GRID)
    with pytest.raises(TableError, match="no dataset 'depth' there; known: height, phase"):
        Topography(file=file, dataset="depth").heights(GRID)
    with pytest.raises(TableError, match="h5: has no group 'scan 2'"):
        Topography(file=file, dataset="scan 2/height").heights(GRID)
    found = Topography(file=file, dataset="scan 1/height").heights(GRID)
    np.testing.assert_allclose(found, WAVES.max() - WAVES, atol=1e-15)


def test_a_line_is_read_with_its_coordinate(tmp_path):
    file, heights = tmp_path / "h.txt", np.cos(2 * np.pi * np.arange(16) / 16)
    np.savetxt(file, np.column_stack((7 + 0.25 * np.arange(16), heights)))
    np.testing.assert_allclose(Topography(file=file).heights(LINE), 1 - heights, atol=1e-15)


class Reader:
    """A reader as SurfaceTopography has them, with two channels."""

    def __init__(self, heights, **found):
        self.found = {
            "heights": lambda: heights,
            "physical_sizes": (3.0, 4.0),
            "unit": None,
            "is_uniform": True,
        }
        self.found |= found
        names, sizes = ("height", "phase"), found.get("sized", (3.0, 4.0))
        self.channels = [SimpleNamespace(name=name, physical_sizes=sizes, dim=2) for name in names]
        self.default_channel = self.channels[0]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def format(self):
        return self.found.get("format", "opd")

    def topography(self, channel_index, **_):
        assert channel_index == 0
        return SimpleNamespace(**self.found)


def known(monkeypatch, reader):
    """Let SurfaceTopography open any file with a reader."""
    exceptions = SimpleNamespace(CannotDetectFileFormat=KeyError)
    module = SimpleNamespace(open_topography=lambda _: reader, Exceptions=exceptions)
    monkeypatch.setitem(sys.modules, "SurfaceTopography", module)
    monkeypatch.setitem(sys.modules, "SurfaceTopography.Exceptions", exceptions)


@pytest.fixture
def scan(tmp_path):
    (tmp_path / "scan.dat").write_bytes(b"\x01\x00")
    return tmp_path / "scan.dat"


def test_instruments_formats_come_through_surface_topography(scan, monkeypatch):
    """Whatever the ending of the name; asked where the content is of no kind of the package."""
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    with pytest.raises(TableError, match=r"install the extra `topography`"):
        Topography(file=scan).heights(GRID)
    heights = np.ma.masked_array(WAVES, np.zeros(WAVES.shape, bool))
    heights.mask[3, 4] = True
    known(monkeypatch, Reader(heights))
    with pytest.raises(TableError, match=r"1 of 192 points have no height, the first at index \[3, 4\]"):
        Topography(file=scan).heights(GRID)
    found = Topography(file=scan, fill="membrane").heights(GRID)
    measured = np.arange(192).reshape(12, 16) != 3 * 16 + 4
    np.testing.assert_allclose(found[measured], (WAVES.max() - WAVES)[measured], atol=1e-15)


def test_what_surface_topography_says_is_converted_and_checked(scan, monkeypatch):
    cell = Cell(GRID.points, GRID.period)
    known(monkeypatch, Reader(1e3 * WAVES, unit="nm", physical_sizes=(3e3, 4e3), sized=(3e3, 4e3)))
    punch = Topography(file=scan).with_length("um")
    np.testing.assert_allclose(punch.heights(GRID), WAVES.max() - WAVES, atol=1e-15)
    assert punch.account(cell) == (
        "scan.dat: 12 x 16 points; heights [nm], x and y [nm] -> um; size 3 x 4 um; opd, read by "
        "SurfaceTopography; channel 'height' of height, phase (dataset chooses)"
    )
    with pytest.raises(TableError, match=r"no dataset 'trace', or several; known: height, phase"):
        Topography(file=scan, dataset="trace").heights(GRID)
    for wrong, said in (
        ({"physical_sizes": (-3.0, 4.0)}, r"a size of -3 x 4; must be > 0"),
        ({"unit": "V"}, r"channel 'height' is in 'V'; must be a length"),
        ({"format": "xyz"}, r"takes it for xyz, which it does not read with certainty"),
    ):
        known(monkeypatch, Reader(WAVES, **wrong))
        with pytest.raises(TableError, match=said):
            Topography(file=scan).heights(GRID)
    known(monkeypatch, Reader(WAVES, sized=None, unit="um"))
    with pytest.raises(TableError, match=r"says heights in um, but the configuration has no units"):
        Topography(file=scan).heights(GRID)
    np.testing.assert_allclose(
        Topography(file=scan, unit=1.0, size=[3, 4]).heights(GRID), WAVES.max() - WAVES
    )


# --- files that are refused ---


def holed():
    heights = WAVES.copy()
    heights[5, 7:9] = np.nan
    return heights


def infinite():
    heights = WAVES.copy()
    heights[2, 3] = -np.inf
    return heights


@pytest.mark.parametrize(
    ("heights", "said"),
    [
        (
            holed(),
            r"2 of 192 points have no height, the first at index \[5, 7\]; must be none, or fill: membrane",
        ),
        (infinite(), r"the height at index \[2, 3\] is infinite"),
        (WAVES[:1], "holds a single row of 16 heights; must be at least two along each axis"),
        (WAVES[:, :1], "holds a single row of 12 heights"),
        (WAVES[0], "holds 16 heights; must have two axes, as the grid"),
        (WAVES[:-1], "holds 11 x 16 heights; must be 12 x 16, as the grid, or resample: fourier"),
        (WAVES.astype(complex), "must hold one array of real numbers"),
    ],
)
def test_an_array_that_cannot_be_used_is_refused(heights, said, tmp_path):
    with pytest.raises(TableError, match=r"h\.npy: " + said):
        Topography(file=saved(tmp_path, heights)).heights(GRID)


def test_a_surface_without_any_height_cannot_be_filled(tmp_path):
    with pytest.raises(TableError, match="192 of 192 points have no height"):
        Topography(file=saved(tmp_path, np.full(GRID.shape, np.nan)), fill="membrane").heights(GRID)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["1 2 3", "4 5 6", "7 8"], r":3: '7 8' holds 2 columns; must be 3, as above"),
        (["1 2 3", "4 high 6"], r":2: 'high' in '4 high 6' is not a number"),
        (["# nothing"], ":1: holds no rows of numbers"),
        (["1 2 3"], ":1: holds 1 row of numbers; must be at least 2"),
    ],
)
def test_text_that_cannot_be_used_is_refused_by_its_line(rows, said, tmp_path):
    (tmp_path / "h.txt").write_text("\n".join(rows))
    with pytest.raises(TableError, match=r"h\.txt" + said):
        Topography(file=tmp_path / "h.txt").heights(GRID)


@pytest.mark.parametrize("spacing", [0.26, 0.125])
def test_a_file_of_another_period_is_refused(spacing, tmp_path):
    labelled(WAVES, spacing).to_netcdf(tmp_path / "h.nc", engine="h5netcdf")
    long = f"{12 * spacing:g} x {16 * spacing:g}"
    with pytest.raises(
        TableError, match=rf"is {long} long, but grid.period is 3 x 4; .* or give punch\.size"
    ):
        Topography(file=tmp_path / "h.nc").heights(GRID)
    with pytest.raises(TableError, match=r"long \(with unit = 3\.0\)"):
        Topography(file=tmp_path / "h.nc", unit=3.0).heights(GRID)
    # The same file in other units of length fits, and its heights are lengths, too.
    unit = 0.25 / spacing
    np.testing.assert_allclose(
        Topography(file=tmp_path / "h.nc", unit=unit).heights(GRID), unit * (WAVES.max() - WAVES), atol=1e-15
    )


def test_unequal_spacing_is_refused(tmp_path):
    uneven = labelled(WAVES).assign_coords(y=0.25 * np.arange(16) ** 1.1)
    uneven.to_netcdf(tmp_path / "h.nc", engine="h5netcdf")
    with pytest.raises(TableError, match=r"h\.nc: y is not equally spaced"):
        Topography(file=tmp_path / "h.nc").heights(GRID)


@pytest.mark.parametrize("name", ["h.npy", "h.txt", "h.h5", "h.nc"])
def test_a_file_that_is_something_else_is_refused(name, tmp_path):
    (tmp_path / name).write_bytes(b"\x89HD\xffnothing of the kind")
    with pytest.raises(TableError, match=name.replace(".", r"\.")):
        Topography(file=tmp_path / name).heights(GRID)


# --- steps to a periodic surface ---


def test_a_membrane_is_linear_between_the_ends_of_a_line_and_exact_for_a_plane():
    line = np.array([0.0, np.nan, np.nan, 6.0, 1.0, np.nan])
    np.testing.assert_allclose(membrane(line, np.isnan(line)), [0, 2, 4, 6, 1, 1], atol=1e-13)
    plane = 0.3 * np.arange(20)[:, np.newaxis] - 0.7 * np.arange(15)
    holes = np.zeros(plane.shape, bool)
    holes[4:9, 5:12] = holes[15, 3] = True
    found = membrane(np.where(holes, np.nan, plane), holes)
    np.testing.assert_allclose(found, plane, atol=1e-12)


def test_a_membrane_stays_between_the_heights_around_it():
    rng = np.random.default_rng(0)
    heights, holes = rng.random((40, 30)), rng.random((40, 30)) < 0.3
    found = membrane(np.where(holes, np.nan, heights), holes)
    np.testing.assert_array_equal(found[~holes], heights[~holes])
    assert 0 < found.min() <= found.max() < 1


@pytest.mark.parametrize("shape", [(17,), (16,), (12, 17)])
@pytest.mark.parametrize("curved", [False, True])
def test_the_trend_is_that_of_least_squares(shape, curved):
    heights = np.random.default_rng(1).random(shape)
    axes = [np.broadcast_to(x, shape).ravel() for x in np.indices(shape, dtype=float)]
    columns = [np.ones(heights.size), *axes]
    if curved:
        columns += [a * b for i, a in enumerate(axes) for b in axes[: i + 1]]
    matrix = np.column_stack(columns)
    fit, *_ = np.linalg.lstsq(matrix, heights.ravel(), rcond=None)
    rest = without_trend(heights, Grid(shape, tuple(map(float, shape))), curved=curved)
    np.testing.assert_allclose(rest.ravel(), heights.ravel() - matrix @ fit, atol=1e-12)


def test_a_tilted_surface_is_detrended_with_a_note(tmp_path):
    tilted = WAVES + 3 * X + 0.5 * Y
    raw = Topography(file=saved(tmp_path, tilted))
    before = raw.notes(Cell(GRID.points, GRID.period))
    assert any("does not join up with itself along x: the step across the seam is" in word for word in before)
    flat = Topography(file=saved(tmp_path, tilted), detrend="plane")
    heights, after = flat.heights(GRID), flat.notes(Cell(GRID.points, GRID.period))
    assert len(after) == 1
    assert "the plane of least squares was subtracted; rms height from" in after[0]
    # The waves have a slope of their own in the sense of least squares.
    expected = without_trend(WAVES, GRID, curved=False)
    np.testing.assert_allclose(heights, expected.max() - expected, atol=1e-12)


def test_a_taper_joins_the_edges_and_leaves_the_middle(tmp_path):
    grid = Grid((64, 48), (1.0, 1.0))
    rough = np.cumsum(np.random.default_rng(2).normal(size=grid.shape), axis=0)
    file = saved(tmp_path, rough)
    punch = Topography(file=file, taper=0.4)
    heights, said = punch.heights(grid), punch.notes(Cell(grid.points, grid.period))
    deviation = heights.max() - heights - (heights.max() - heights)[0, 0]
    np.testing.assert_allclose(deviation[0], 0, atol=1e-12)
    np.testing.assert_allclose(deviation[:, 0], 0, atol=1e-12)
    inner = slice(13, 51), slice(10, 38)
    np.testing.assert_allclose(deviation[inner], (rough - rough.mean())[inner], atol=1e-12)
    assert [word for word in said if "fade out over 0.4 of the cell" in word]
    assert not [word for word in said if "does not join up" in word]


@pytest.mark.parametrize("points", [(24, 32), (36, 20), (13, 17)])
def test_resampling_keeps_waves_that_both_grids_resolve(points, tmp_path):
    grid = Grid(points, GRID.period)
    x, y = np.meshgrid(*(np.arange(n) / n for n in points), indexing="ij")
    waves = 0.1 * np.cos(2 * np.pi * x) + 0.2 * np.sin(2 * np.pi * (2 * x - y))
    punch = Topography(file=saved(tmp_path, WAVES), resample="fourier")
    heights, said = punch.heights(grid), punch.notes(Cell(grid.points, grid.period))
    np.testing.assert_allclose(heights, waves.max() - waves, atol=1e-14)
    assert f"resampled from 12 x 16 to {points[0]} x {points[1]} points by the Fourier series" in said[0]


def test_changes_are_noted_for_each_surface_once(tmp_path):
    file = saved(tmp_path, holed())
    punch = {"shape": "topography", "file": str(file), "fill": "membrane"}
    config = Config(name="x").with_values({"grid.points": [12, 16], "punch": punch})
    cases = [config.with_values({"layer.thickness": d}) for d in (0.1, 0.2)]
    (said,) = notes(cases)
    assert (
        said == f"{file}: 2 of 192 points have no height; a membrane between their neighbours fills them in"
    )
    assert notes([Config(name="x")]) == []
