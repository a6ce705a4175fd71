"""Files of measured surfaces: each is read as its author meant it, or refused in words."""

import numpy as np
import pytest
import xarray as xr

import gfmdlayer
from gfmdlayer.files.tables import TableError
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.measured import Profile, Topography
from gfmdlayer.punch.scan import on_grid
from gfmdlayer.punch.scan_files import read_scan
from gfmdlayer.punch.shape import Cell
from tests.punch.scan_dialects import make

GRID = Grid((5, 4), (10.0, 8.0))
HEIGHTS = np.random.default_rng(5).integers(-99, 99, GRID.points) / 8  # exact in few digits
LINE = Grid((16,), (1.0,))


def depths(heights):
    return heights.max() - heights


def rows(heights=HEIGHTS, separator=" "):
    """Return a matrix as programs write it: its rows are y."""
    return [separator.join(f"{h:.4f}" for h in row) for row in heights.T]


def points(heights=HEIGHTS, spacing=2.0):
    return [f"{spacing * i} {spacing * j} {h:.4f}" for (i, j), h in np.ndenumerate(heights)]


def with_headings(headings, lines):
    return [headings, *(line.replace(" ", ";") for line in lines)]


def written(tmp_path, lines, name="h.txt", encoding="utf-8"):
    (tmp_path / name).write_bytes("\n".join([*lines, ""]).encode(encoding))
    return tmp_path / name


def read(file, grid=GRID, length=None, **keys):
    return Topography(file=file, **keys).with_length(length).heights(grid)


def account(file, grid=GRID, length=None, **keys):
    return Topography(file=file, **keys).with_length(length).account(Cell(grid.points, grid.period))


# --- random dialects ---


def test_two_hundred_dialects_are_read_to_the_last_digit_or_refused(tmp_path):
    """Only marks that may be decimal ones or those of thousands are refused; an open question always is."""
    refused, asked = [], 0
    for seed in range(200):
        dialect = make(seed, tmp_path)
        for keys in dict.fromkeys((dialect.keys, dialect.open)):
            try:
                scan = read_scan(dialect.file, len(dialect.grid.points), keys, dialect.grid)
                found = on_grid(scan, keys, dialect.grid, dialect.length).heights
            except TableError as error:
                if keys == dialect.keys:
                    refused.append(f"{seed}: {error}")
                else:
                    asked += 1
                continue
            assert keys == dialect.keys, f"{seed}: read without {dialect.keys}"
            # The products with the unit round differently.
            np.testing.assert_allclose(found, dialect.heights, rtol=1e-14, atol=0, err_msg=f"{seed}")
    assert asked > 20
    assert not [line for line in refused if "a decimal mark or a mark of thousands" not in line]
    assert len(refused) < 5


# --- orientation ---


@pytest.mark.parametrize("name", ["h.txt", "h.asc", "h.dat", "h.csv", "h.xyz", "h"])
def test_rows_are_y_whatever_the_ending(name, tmp_path):
    file = written(tmp_path, rows(), name)
    np.testing.assert_array_equal(read(file), depths(HEIGHTS))
    assert account(file) == (
        f"{name}: 5 x 4 points; rows are y, columns x; no unit in the file; no size in the file: it "
        "fills the cell, 10 x 8"
    )
    with pytest.raises(TableError, match=r"holds 4 x 5 heights; must be 5 x 4, .* or transpose: true"):
        read(written(tmp_path, rows(HEIGHTS.T), name))
    turned = written(tmp_path, rows(HEIGHTS.T), name)
    np.testing.assert_array_equal(read(turned, transpose=True), depths(HEIGHTS))
    assert "x and y exchanged (transpose)" in account(turned, transpose=True)


def test_x_and_y_are_exchanged_in_arrays_too(tmp_path):
    np.save(tmp_path / "h.npy", HEIGHTS.T)
    np.testing.assert_array_equal(read(tmp_path / "h.npy", transpose=True), depths(HEIGHTS))
    assert Topography(file=tmp_path / "h.npy", transpose=True).whole_only == "transpose: true"


@pytest.mark.parametrize("corner", ["0", "", "y/x"])
def test_x_in_the_first_row_and_y_in_the_first_column_are_no_heights(corner, tmp_path):
    x, y = (f"{2.0 * i}" for i in range(5)), (2.0 * j for j in range(4))
    lines = [";".join([corner, *x]), *(f"{j};{row}" for j, row in zip(y, rows(separator=";"), strict=True))]
    np.testing.assert_array_equal(read(written(tmp_path, lines)), depths(HEIGHTS))
    if corner != "y/x":
        plane = np.add.outer(np.arange(5.0), np.arange(4.0))
        np.testing.assert_array_equal(read(written(tmp_path, rows(plane))), depths(plane))


# --- points ---


@pytest.mark.parametrize("order", ["as written", "backwards", "random"])
def test_points_on_a_grid_may_have_any_order(order, tmp_path):
    lines = points()
    if order == "backwards":
        lines.reverse()
    elif order == "random":
        np.random.default_rng(1).shuffle(lines)
    np.testing.assert_array_equal(read(written(tmp_path, lines)), depths(HEIGHTS))


def test_columns_go_by_their_headings_in_their_units(tmp_path):
    lines = ["z [nm];quality;Y [um];x [mm]"]
    for (i, j), h in np.ndenumerate(HEIGHTS):
        lines.append(f"{1000 * h:.1f};7;{2.0 * j};{0.002 * i:.3f}")
    file = written(tmp_path, lines, encoding="utf-16")
    np.testing.assert_allclose(read(file, length="um"), depths(HEIGHTS), rtol=1e-14)
    assert account(file, length="um").endswith(
        "columns x, y, height; heights [nm], x and y [mm] -> um; size 10 x 8 um; separator ';', "
        "decimal mark '.'; UTF-16"
    )


def test_a_header_has_the_units_of_columns_without_headings(tmp_path):
    header = ["# Channel: Z", "# Lateral units: mm", "# Value units: nm"]
    lines = [f"{2e-3 * i:.3f}\t{2e-3 * j:.3f}\t{1e3 * h}" for (i, j), h in np.ndenumerate(HEIGHTS)]
    np.testing.assert_allclose(
        read(written(tmp_path, header + lines), length="um"), depths(HEIGHTS), rtol=1e-14
    )


def test_rounded_positions_are_on_their_grid(tmp_path):
    lines = [f"{i / 3:.2f},{j / 3:.2f},{h}" for (i, j), h in np.ndenumerate(HEIGHTS)]
    grid = Grid(GRID.points, (5 / 3, 4 / 3))
    np.testing.assert_array_equal(read(written(tmp_path, lines), grid, size=grid.period), depths(HEIGHTS))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda lines: lines[:-1], r"19 points x, y, z with 5 values of x and 4 of y.* is missing"),
        (lambda lines: [*lines, lines[3]], r"value 1 of x with value 4 of y is there 2 times"),
        (
            lambda lines: [line.replace("6.0 ", "7.0 ", 1) for line in lines],
            r"x is not equally spaced|y is not",
        ),
        (lambda lines: ["x y z", *lines[:-1], "nan 1 2"], r"x is no number in row 20"),
        (lambda lines: ["x y depth", *lines], r"no heading is height among"),
        (lambda lines: ["a b c", *lines], r"the headings are 'a', 'b', 'c'; must be x, y and height"),
        (lambda lines: ["x z z", *lines], r"two columns are height"),
        (
            lambda lines: with_headings("x [um];y [um];z", lines),
            r"says lengths in um, but no unit of heights; give punch\.unit",
        ),
        (
            lambda lines: with_headings("x [um];y;z [um]", lines),
            r"says the unit of one direction only; give punch\.size",
        ),
        (
            lambda lines: with_headings("x;y;z [nm]", lines),
            r"says heights in nm, but x and y have no unit; give punch\.size",
        ),
        (
            lambda lines: with_headings("x [V];y [um];z [nm]", lines),
            r"heading 'x \[V\]' is in 'V', which is no unit of",
        ),
    ],
)
def test_points_that_are_not_certain_are_refused(change, said, tmp_path):
    with pytest.raises(TableError, match=rf"h\.txt: .*{said}"):
        read(written(tmp_path, change(points())), length="um")


# --- units and sizes ---

GWYDDION = ["# Kanal: Z", "# Breite: 10,0 µm", "# Höhe: 8000 nm"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1", "utf-8-sig"])
def test_headers_say_width_height_and_units(encoding, tmp_path):
    lines = [line.replace(".", ",") for line in rows(1e3 * HEIGHTS, "\t")]
    file = written(tmp_path, [*GWYDDION, "# Einheiten: nm", *lines], encoding=encoding)
    np.testing.assert_allclose(read(file, length="um"), depths(HEIGHTS), rtol=1e-14)
    assert "heights [nm], x and y [µm] -> um; size 10 x 8 um; separator tab, decimal mark ','" in account(
        file, length="um"
    )


@pytest.mark.parametrize(
    ("header", "heights"),
    [
        (["h=4 w=5", "pixel size=2.0e-006 m", "data unit=rad", "height conversion factor (-> m)=1e-6"],
         HEIGHTS),
        (["# x-pixels = 5", "# y-pixels = 4", "# x-length = 10000", "# y-length = 8000", "# x-unit = nm",
          "# z-unit = um"], HEIGHTS),
        (["Scan size: 10 x 8 um", "z unit: um"], HEIGHTS),
        (["Width [mm];0.01", "Height (um);8", "", "Z unit;nm"], 1e3 * HEIGHTS),
        (["NX = 5", "NY = 4", "Scale X = 2", "Scale Y = 2", "Unit X = um", "Unit Data = um"], HEIGHTS),
    ],
)  # fmt: skip
def test_headers_of_other_programs_are_understood(header, heights, tmp_path):
    file = written(tmp_path, [*header, *rows(heights, ";")])
    np.testing.assert_allclose(read(file, length="um"), depths(HEIGHTS), rtol=1e-14)
    assert "size 10 x 8 um" in account(file, length="um")


def test_an_esri_grid_has_its_spacing_and_its_holes(tmp_path):
    heights = HEIGHTS.copy()
    heights[2, 1] = -9999
    header = ["ncols 5", "nrows 4", "xllcorner 0.0", "yllcorner 0.0", "cellsize 2.0", "NODATA_value -9999"]
    file = written(tmp_path, [*header, *rows(heights)])
    with pytest.raises(TableError, match=r"1 of 20 points have no height, the first at index \[2, 1\]"):
        read(file)
    assert account(file, fill="membrane").endswith("size 10 x 8; 1 hole")


@pytest.mark.parametrize(
    ("header", "said"),
    [
        (GWYDDION, r"says lengths in µm, but no unit of heights; give punch\.unit"),
        (["# Breite: 10 µm", "# Einheiten: nm"], r"a length in one direction only, .*; give punch\.size"),
        (["# Width: 1,234 um", "# Height: 8 um", "# Value units: nm"],
         r"'# Width: 1,234 um': 1,234 has a decimal mark"),
        (["# Width: 10 parsec"], r"'# Width: 10 parsec' may say .*; give punch\.unit and punch\.size"),
        (["# Value units: V"], r"'# Value units: V' may say a length or a unit, .*; give punch\.unit"),
        (["Bit2nm: 0.25"], r"'Bit2nm: 0\.25' may say a length or a unit.*; give punch\.unit and punch\.size"),
        (["w = 6", "h = 4"], r"holds 5 columns of heights; its header says 6"),
        (["0 1 2 3 4"], r"the first row of the matrix counts its columns"),
    ],
)  # fmt: skip
def test_headers_that_leave_something_open_are_refused(header, said, tmp_path):
    with pytest.raises(TableError, match=rf"h\.txt: .*{said}"):
        read(written(tmp_path, [*header, *rows()]), length="um")


def test_keys_settle_what_a_file_leaves_open(tmp_path):
    file = written(tmp_path, ["Bit2nm: 0.25", *rows(1e3 * HEIGHTS)])
    np.testing.assert_allclose(read(file, length="um", unit="nm", size=[10, 8]), depths(HEIGHTS), rtol=1e-14)
    np.testing.assert_allclose(read(file, unit=1e-3, size=[10, 8]), depths(HEIGHTS), rtol=1e-14)
    with pytest.raises(TableError, match=r"punch\.unit is nm, but the configuration has no units; add units"):
        read(file, unit="nm", size=[10, 8])


def test_a_size_that_is_not_the_cell_is_refused_with_the_keys_that_settle_it(tmp_path):
    file = written(tmp_path, [*GWYDDION, "# Einheiten: um", *rows()])
    grid = Grid(GRID.points, (5.0, 4.0))
    with pytest.raises(
        TableError, match=r"is 10 x 8 um long, but grid\.period is 5 x 4 um; .*punch\.size .*punch\.unit"
    ):
        read(file, grid, length="um")
    np.testing.assert_array_equal(read(file, grid, length="um", size=[5, 4]), depths(HEIGHTS))
    assert "size 5 x 4 um (punch.size; the file says 10 x 8 um)" in account(
        file, grid, length="um", size=[5, 4]
    )
    with pytest.raises(TableError, match=r"punch\.size is 5 x 5 um long, but grid\.period is 5 x 4 um"):
        read(file, grid, length="um", size=5)
    with pytest.raises(TableError, match="transpose: true exchanges x and y"):
        read(file, Grid((4, 5), (8.0, 10.0)), length="um")


def test_a_file_with_units_needs_a_configuration_with_units_or_a_cell_of_its_size(tmp_path):
    file = written(tmp_path, [*GWYDDION, "# Einheiten: nm", *rows(1e3 * HEIGHTS)])
    np.testing.assert_allclose(read(file), depths(HEIGHTS), rtol=1e-14)  # 10 x 8 are micrometres
    assert "heights [nm], x and y [µm]; the cell is in µm, for it has this size; size 10 x 8" in account(file)
    small = Grid(GRID.points, (10e-6, 8e-6))
    with pytest.raises(
        TableError, match=r"in nm, but the configuration has no units; add units: .*punch\.unit"
    ):
        read(file, small)
    np.testing.assert_allclose(read(file, small, unit=1e-9), depths(1e-6 * HEIGHTS), rtol=1e-14)
    assert "heights [um, punch.unit; the file says nm]" in account(file, length="um", unit="um")


# --- holes ---


@pytest.mark.parametrize("word", ["Bad", "--", "***", "nan", "#NV"])
def test_words_are_holes(word, tmp_path):
    lines = rows()
    lines[1] = lines[1].replace(lines[1].split()[2], word)
    file = written(tmp_path, lines)
    with pytest.raises(
        TableError, match=r"1 of 20 points have no height, the first at index \[2, 1\].*fill: membrane"
    ):
        read(file)
    found = read(file, fill="membrane")
    assert np.isclose(found[2, 1] - found[0, 0], HEIGHTS[0, 0] - HEIGHTS[[1, 3, 2, 2], [1, 1, 0, 2]].mean())
    assert account(file, fill="membrane").endswith("1 hole")


@pytest.mark.parametrize("number", [-9999, -32768, 99999])
@pytest.mark.parametrize("name", ["h.txt", "h.npy", "h.nc"])
def test_a_number_that_stands_for_a_hole_is_no_height(number, name, tmp_path):
    heights = HEIGHTS.copy()
    heights[2, 1] = number
    file = tmp_path / name
    if name == "h.npy":
        np.save(file, heights)
    elif name == "h.nc":
        xr.Dataset({"h": (("x", "y"), heights)}).to_netcdf(file, engine="h5netcdf")
    else:
        written(tmp_path, rows(heights))
    with pytest.raises(
        TableError, match=rf"1 of 20 heights are {number}, .*give punch\.hole: {number}, or hole: none"
    ):
        read(file)
    with pytest.raises(TableError, match="1 of 20 points have no height"):
        read(file, hole=number)
    np.testing.assert_array_equal(read(file, hole="none"), depths(heights))
    assert f"1 hole, marked by {number}" in account(file, hole=number, fill="membrane")


def test_heights_near_such_a_number_are_heights(tmp_path):
    np.testing.assert_array_equal(read(written(tmp_path, rows(HEIGHTS - 9999))), depths(HEIGHTS))
    heights = np.linspace(-9999, 9999, 20).reshape(5, 4).round(1)
    np.testing.assert_array_equal(read(written(tmp_path, rows(heights))), depths(heights))


# --- lines ---


def profile(x):
    """A line of straight pieces between sixteenths."""
    return np.interp(x % 1.0, np.arange(17) / 16, [*np.sin(np.arange(16)), 0.0])


def test_a_line_with_unequal_distances_is_interpolated(tmp_path):
    """Between straight pieces nothing is lost."""
    x = np.sort(np.append(np.arange(17) / 16, np.random.default_rng(2).random(30)))
    file = written(
        tmp_path, [f"{float(a)!r} {float(h)!r}" for a, h in zip(x, profile(x), strict=True)], "h.asc"
    )
    np.testing.assert_allclose(read(file, LINE), depths(profile(np.arange(16) / 16)), atol=1e-15)
    widest = np.diff(x).max()
    assert account(file, LINE) == (
        "h.asc: 47 points; columns x, height by order; no unit in the file; x from 0 to 1, not equally "
        f"spaced, neighbours at most {widest:.3g} apart; interpolated linearly onto 16 points"
    )
    with pytest.raises(TableError, match=r"x is not spaced|holds 47 heights; must be 16, as the grid"):
        Profile(file=file).heights(LINE)


@pytest.mark.parametrize(
    ("x", "said"),
    [
        (
            np.delete(np.arange(33.0), range(5, 14)) ** 1.01,
            r"neighbours are up to .* apart, .*at most 4 spacings.*fill",
        ),
        (1.1 * np.arange(33.0) ** 1.01, r"is .* long, but grid\.period is .*; must not be longer"),
        (
            0.8 * np.arange(33.0) ** 1.01,
            r"x goes over .*, but grid\.period is .*; the rest must not be longer",
        ),
        (
            np.append(np.arange(32.0) ** 1.01, 4.0**1.01),
            "x is not equally spaced, increasing: it is 4\\.05584 twice",
        ),
    ],
)
def test_a_line_that_does_not_cover_the_period_is_refused(x, said, tmp_path):
    grid = Grid((32,), (32.0**1.01,))
    file = written(tmp_path, [f"{float(a)!r} {float(h)!r}" for a, h in zip(x, np.sin(x), strict=True)])
    with pytest.raises(TableError, match=said):
        read(file, grid)
    if "fill" in said:
        assert read(file, grid, fill="membrane").shape == (32,)


def test_columns_of_a_line_go_by_their_headings(tmp_path):
    x, heights = np.arange(16) / 16, np.sin(np.arange(16))
    lines = [
        "Z (nm);valid;X (mm)",
        *(f"{1e3 * h!r};1;{1e-3 * a!r}" for a, h in zip(x.tolist(), heights.tolist(), strict=True)),
    ]
    file = written(tmp_path, lines)
    np.testing.assert_allclose(read(file, LINE, length="um"), depths(heights), rtol=1e-13, atol=1e-15)
    file = written(tmp_path, [line.replace(";1;", ";0;") if i == 4 else line for i, line in enumerate(lines)])
    with pytest.raises(TableError, match=r"1 of 16 points have no height, the first at index \[3\]"):
        read(file, LINE, length="um")


# --- HDF5 and netCDF ---


def dataset(heights=HEIGHTS, unit="nm", across="um", key="units", down=()):
    x, y = (2.0 * np.arange(n) for n in heights.shape)
    data = xr.Dataset({"height": (("x", "y"), heights, {key: unit} if unit else {})}, {"x": x, "y": y})
    for name in "xy":
        data[name].attrs |= {key: across} if across else {}
    return data.isel(dict.fromkeys(down, slice(None, None, -1)))


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
@pytest.mark.parametrize("key", ["units", "unit"])
@pytest.mark.parametrize("down", [(), ("y",), ("x", "y")])
def test_netcdf_has_a_unit_for_each_quantity_and_any_order(engine, key, down, tmp_path):
    dataset(1e3 * HEIGHTS, key=key, down=down).to_netcdf(tmp_path / "h.nc", engine=engine)
    np.testing.assert_allclose(read(tmp_path / "h.nc", length="um"), depths(HEIGHTS), rtol=1e-14)
    assert account(tmp_path / "h.nc", length="um") == (
        "h.nc: 5 x 4 points; dimensions x and y; heights [nm], x and y [um] -> um; size 10 x 8 um"
    )


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (dataset(unit=""), r"says lengths in um, but no unit of heights"),
        (dataset(across=""), r"says heights in nm, but x and y have no unit"),
        (dataset(unit="V"), r"height is in 'V', which is no known unit of length"),
        (dataset(across="pixel"), r"x is in 'pixel', which is no known unit of length"),
    ],
)
def test_netcdf_with_open_units_is_refused(data, said, tmp_path):
    data.to_netcdf(tmp_path / "h.nc", engine="h5netcdf")
    with pytest.raises(TableError, match=said):
        read(tmp_path / "h.nc", length="um")


# --- SurfaceTopography ---

SDF = """aISO-1.0
ManufacID = NONE
CreateDate = 010120200000
ModDate = 010120200000
NumPoints = 5
NumProfiles = 4
Xscale = 2.0E-6
Yscale = 2.0E-6
Zscale = 1.0E-6
Zresolution = 1.0E-9
Compression = 0
DataType = 7
CheckType = 0
*
"""


def test_formats_in_text_with_scales_need_surface_topography(tmp_path, monkeypatch):
    file = written(tmp_path, [SDF + "\n".join(rows()), "*"], "h.txt")
    with monkeypatch.context() as absent:
        absent.setitem(__import__("sys").modules, "SurfaceTopography", None)
        with pytest.raises(TableError, match=r"install the extra `topography`"):
            read(file, length="um")
    pytest.importorskip("SurfaceTopography")
    np.testing.assert_allclose(read(file, length="um"), depths(HEIGHTS), rtol=1e-12)
    assert "sdf, read by SurfaceTopography" in account(file, length="um")


def test_a_mask_in_netcdf_is_left_to_surface_topography(tmp_path):
    topography = pytest.importorskip("SurfaceTopography")
    heights = np.ma.masked_array(HEIGHTS, HEIGHTS[2, 1] == HEIGHTS)
    surface = topography.Topography(heights, (10.0, 8.0), unit="um")
    surface.to_netcdf(str(tmp_path / "h.nc"))
    with pytest.raises(TableError, match="1 of 20 points have no height"):
        read(tmp_path / "h.nc", length="um")
    topography.Topography(HEIGHTS, (10.0, 8.0), unit="um").to_netcdf(str(tmp_path / "g.nc"))
    np.testing.assert_allclose(read(tmp_path / "g.nc", length="um"), depths(HEIGHTS), rtol=1e-14)


# --- contacts ---

HERTZ = """name: hertz
units: {length: um, stress: MPa, time: s}
grid: {points: [64, 64], period: [10, 10]}
layer: {thickness: .inf, poisson: 0.5, material: {model: elastic, G: 1.0}}
trajectory: {control: force, force: 0.5, ramp_time: 1.0}
time: {end: 1.0, step: 1.0}
"""


def test_heights_in_nanometres_over_micrometres_make_the_contact_of_hertz(tmp_path):
    radius = 10.0
    x = np.arange(64) * 10 / 64
    heights = -((x[:, np.newaxis] - 5) ** 2 + (x - 5) ** 2) / (2 * radius)
    data = xr.Dataset({"h": (("x", "y"), 1e3 * heights, {"units": "nm"})}, {"x": x, "y": x})
    for name in "xy":
        data[name].attrs["units"] = "um"
    data.to_netcdf(tmp_path / "sphere.nc", engine="h5netcdf")
    (tmp_path / "case.yaml").write_text(HERTZ + "punch: {shape: topography, file: sphere.nc}\n")
    (tmp_path / "same.yaml").write_text(HERTZ + f"punch: {{shape: parabola, radius: {radius}}}\n")
    area, same = (
        100 * float(gfmdlayer.run(tmp_path / name).contact_area[-1]) for name in ("case.yaml", "same.yaml")
    )
    assert area == same
    # pi a^2 with a^3 = 3 F R/(4 E*), E* = 2 G/(1 - nu) = 4. Of the 2 pi a 64/10 = 39 points along the edge
    # about 39^(1/2) are miscounted, (10/64)^2 each.
    assert area == pytest.approx(np.pi * (3 * 0.5 * radius / 16) ** (2 / 3), abs=39**0.5 * (10 / 64) ** 2)


def test_an_unequal_line_makes_the_contact_of_its_shape(tmp_path):
    x = (np.arange(128) / 127) ** 2
    lines = [f"{a:.8f} {h:.8f}" for a, h in zip(x, -2 * (x - 0.5) ** 2, strict=True)]
    written(tmp_path, lines, "scan.asc")
    case = """name: scan
grid: {points: 128, period: 1.0}
layer: {thickness: .inf, material: {model: elastic, G: 1.0}}
trajectory: {control: load, load: 0.02, ramp_time: 1.0}
time: {end: 1.0, step: 1.0}
"""
    (tmp_path / "case.yaml").write_text(case + "punch: {shape: topography, file: scan.asc}\n")
    (tmp_path / "same.yaml").write_text(case + "punch: {shape: parabola, radius: 0.25}\n")
    found, same = (gfmdlayer.run(tmp_path / name).isel(time=-1) for name in ("case.yaml", "same.yaml"))
    assert float(found.contact_area) == pytest.approx(float(same.contact_area), abs=1 / 128)  # a point
    # Straight pieces are above a parabola by at most (distance of neighbours)^2/(8 R) = 1.2e-4.
    assert float(found.depth) == pytest.approx(float(same.depth), abs=1.3e-4)


def test_a_unit_that_is_no_length_is_settled_by_the_key(tmp_path):
    file = written(tmp_path, [*GWYDDION, "# Value units: V", *rows(1e3 * HEIGHTS)])
    with pytest.raises(TableError, match=r"'# Value units: V' may say .*; give punch\.unit$"):
        read(file, length="um")
    np.testing.assert_allclose(read(file, length="um", unit="nm"), depths(HEIGHTS), rtol=1e-14)


@pytest.mark.parametrize("word", ["nan", "NaN", "Bad", "#NV"])
@pytest.mark.parametrize("separator", [" ", ",", ";", "\t"])
@pytest.mark.parametrize("missing", [(0,), (0, 1), (2,), (3,)])
def test_rows_without_any_height_are_rows(word, separator, missing, tmp_path):
    lines = rows(separator=separator)
    for j in missing:
        lines[j] = separator.join([word] * 5)
    scan = read_scan(written(tmp_path, lines), 2)
    expected = HEIGHTS.copy()
    expected[:, list(missing)] = np.nan
    np.testing.assert_array_equal(scan.heights, expected)


@pytest.mark.parametrize("line", ["--;--;--;--;--", "***;***;***;***;***", ";;;;"])
@pytest.mark.parametrize("at", [0, 2])
def test_rows_that_may_be_rules_or_blank_lines_are_refused(line, at, tmp_path):
    """A row that is left out would make another surface, which fits by `resample`."""
    lines = rows(separator=";")
    lines.insert(at, line)
    if at and line[0] != ";":  # holes between heights
        assert read_scan(written(tmp_path, lines), 2).shape == (5, 5)
        return
    with pytest.raises(TableError, match=rf"h\.txt:{at + 1}: a row without a number; write nan"):
        read_scan(written(tmp_path, lines), 2)


def test_numbers_of_any_size_may_stand_for_holes(tmp_path):
    """Surfer writes 1.70141e+38, beyond the sizes that heights may have."""
    heights = HEIGHTS.copy()
    heights[2, 1] = 1.70141183e38
    np.save(tmp_path / "h.npy", heights)
    with pytest.raises(TableError, match=r"give punch\.hole: 1\.70141183e\+38"):
        read(tmp_path / "h.npy")
    assert "1 hole," in account(tmp_path / "h.npy", hole=1.70141183e38, fill="membrane")


@pytest.mark.parametrize(
    ("more", "asked"),
    [
        ("# Z scale factor: 0.5 nm/LSB", "punch.unit"),
        ("# bit2nm: 0.1", "punch.unit"),
        ("# z-unit: um", "its header says nm and um for height"),
        ("# Width: 12 nm", "its header says 10.0 and 12.0 for x"),
    ],
)
def test_a_header_that_says_two_things_is_refused(tmp_path, more, asked):
    header = ["# Width: 10 nm", "# Height: 8 nm", "# Value units: nm", more]
    with pytest.raises(TableError, match=asked):
        read(written(tmp_path, [*header, *rows()]), length="nm")


def test_a_coordinate_of_one_direction_asks_for_the_size(tmp_path):
    data = xr.Dataset({"h": (("x", "y"), HEIGHTS)}, {"x": ("x", 2.0 * np.arange(5))})
    data.to_netcdf(tmp_path / "h.nc", engine="h5netcdf")
    with pytest.raises(
        TableError, match=r"a coordinate in one direction only.*give punch.unit and punch.size"
    ):
        read(tmp_path / "h.nc")


def test_names_of_dimensions_in_capitals_are_the_same(tmp_path):
    xr.Dataset({"h": (("Y", "X"), HEIGHTS.T)}).to_netcdf(tmp_path / "h.nc", engine="h5netcdf")
    np.testing.assert_array_equal(read(tmp_path / "h.nc"), depths(HEIGHTS))


def test_masked_heights_are_holes():
    masked = np.ma.masked_array(np.zeros(16), mask=np.arange(16) == 3)
    with pytest.raises(gfmdlayer.ConfigError, match="not a finite number"):
        gfmdlayer.run({"name": "a", "grid": {"points": 16}}, punch=masked)
