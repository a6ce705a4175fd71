"""The punch: closed forms of its shapes, and heights from files."""

import numpy as np
import pytest
from pydantic import ValidationError

from gfmdlayer.config import Config
from gfmdlayer.files.tables import TableError
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.measured import Profile
from gfmdlayer.punch.revolution import heights
from gfmdlayer.punch.shape import Analytic
from gfmdlayer.punch.shapes import ELEMENTS, SHAPES, Array
from gfmdlayer.punch.simple_shapes import (
    Cone,
    Cylinder,
    Flat,
    FlatPunch,
    Parabola,
    Pyramid,
    RadialProfile,
    Sinusoid,
    Sphere,
    Wedge,
)

LINE = Grid((16,), (1.0,))
ISOLATED = {FlatPunch, RadialProfile}
SQUARE = Grid((16, 16), (1.0, 1.0))
ROUND = {
    "parabola": (Parabola(radius=0.25), lambda r: r**2 / 0.5),
    "sphere": (Sphere(radius=0.5), lambda r: 0.5 - np.sqrt(0.25 - np.minimum(r, 0.5) ** 2)),
    "cone": (Cone(slope=0.3), lambda r: 0.3 * r),
    "flat": (Flat(width=0.4, edge_radius=0.1), lambda r: np.where(r < 0.2, 0.0, (r - 0.2) ** 2 / 0.2)),
}


@pytest.mark.parametrize("name", ROUND)
def test_round_shapes_follow_their_closed_form_about_their_apex_in_the_middle(name):
    (shape, closed_form), x = ROUND[name], np.arange(16) / 16 - 0.5
    heights = shape.heights(SQUARE)
    for found, r in ((shape.heights(LINE), np.abs(x)), (heights, np.hypot(x[:, np.newaxis], x))):
        np.testing.assert_allclose(found, closed_form(r), rtol=1e-12, atol=1e-15)
    assert heights[8, 8] == heights.min() == 0
    inner = heights[1:, 1:]  # the first row and column are the seam of the period
    np.testing.assert_array_equal(inner, inner.T)
    np.testing.assert_array_equal(inner, inner[::-1])


def test_a_large_cylinder_keeps_its_digits():
    # R - (R^2 - x^2)^(1/2) = x^2/2R (1 + x^2/4R^2 + ...), which the difference itself would lose at R = 1e8.
    x = LINE.coordinates[0]
    np.testing.assert_allclose(Cylinder(radius=1e8).heights(LINE), x**2 / 2e8, rtol=1e-14)


@pytest.mark.parametrize(
    ("shape", "closed_form"),
    [
        (Cylinder(radius=0.5), lambda x, y: 0.5 - np.sqrt(0.25 - x**2) + 0 * y),
        (Cylinder(radius=0.75, along="x"), lambda x, y: 0.75 - np.sqrt(0.5625 - y**2) + 0 * x),
        (Wedge(slope=0.3), lambda x, y: 0.3 * np.abs(x) + 0 * y),
        (Wedge(slope=0.3, along="x"), lambda x, y: 0.3 * np.abs(y) + 0 * x),
        (Parabola(radius=(0.2, 0.5)), lambda x, y: x**2 / 0.4 + y**2),
        (Parabola(radius=(0.2, np.inf)), lambda x, y: x**2 / 0.4 + 0 * y),
        (Flat(width=(0.4, 0.6), edge_radius=0.1),
         lambda x, y: (np.maximum(np.abs(x) - 0.2, 0) ** 2 + np.maximum(np.abs(y) - 0.3, 0) ** 2) / 0.2),
        (Flat(width=(0.4, np.inf), edge_radius=0.1),
         lambda x, y: np.maximum(np.abs(x) - 0.2, 0) ** 2 / 0.2 + 0 * y),
        (Sinusoid(amplitude=(0.02, 0.0), wavelength=(0.5, np.inf)),
         lambda x, y: 0.02 * (1 - np.cos(4 * np.pi * x)) + 0 * y),
        (Sinusoid(amplitude=0.02, wavelength=0.5),
         lambda x, y: 0.02 * (2 - np.cos(4 * np.pi * x) - np.cos(4 * np.pi * y))),
        (Sinusoid(amplitude=(0.02, 0.01), wavelength=(0.5, 1.5)),
         lambda x, y: 0.02 * (1 - np.cos(4 * np.pi * x)) + 0.01 * (1 - np.cos(4 * np.pi / 3 * y))),
    ],
)  # fmt: skip
def test_shapes_of_two_directions_follow_their_closed_form(shape, closed_form):
    grid = Grid((16, 15), (1.0, 1.5))
    x, y = np.arange(16)[:, np.newaxis] / 16 - 0.5, np.arange(15) / 10 - 0.75
    np.testing.assert_allclose(shape.heights(grid), closed_form(x, y), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(("angle", "faces", "area"), [(65.27, 3, 24.5), (68.0, 4, 24.5)])
def test_a_pyramid_has_equal_faces_and_the_area_of_vickers(angle, faces, area):
    grid = Grid((400, 400), (8.0, 8.0))
    heights = Pyramid(angle=angle, faces=faces).heights(grid)
    x, y = np.meshgrid(*grid.coordinates, indexing="ij")
    r, turn = np.hypot(x, y), np.arctan2(y, x)
    # On the bisector of a face the slope is that of the face; a turn by a face changes nothing.
    face = (np.abs(y) < 1e-12) & (x > 0)
    np.testing.assert_allclose(heights[face], r[face] / np.tan(np.radians(angle)), rtol=1e-12)
    away = (turn + np.pi / faces) % (2 * np.pi / faces) - np.pi / faces
    exact = r * np.cos(away) / np.tan(np.radians(angle))
    np.testing.assert_allclose(heights, exact, rtol=1e-9, atol=1e-12)
    # Area of the cross-section at unit depth, 24.5 for either (Oliver and Pharr, J. Mater. Res. 7 (1992)).
    depth, half_a_cell = 0.5, 0.01
    inner = depth * np.tan(np.radians(angle))  # of its inscribed circle
    assert (heights < depth).mean() * 64 / depth**2 == pytest.approx(area, rel=2 * half_a_cell / inner)


@pytest.mark.parametrize("counts", [(1,), (2,), (3, 2)])
@pytest.mark.parametrize("name", ["parabola", "cone", "flat", "pyramid"])
def test_an_array_repeats_its_element(name, counts):
    keys = {"parabola": {"radius": 0.2}, "cone": {"slope": 0.4}, "flat": {"width": 0.1, "edge_radius": 0.05}}
    keys["pyramid"] = {"angle": 65.27, "faces": 3}
    nx, ny = counts if len(counts) == 2 else counts * 2
    element = ELEMENTS[name](**keys[name])
    one = element.heights(Grid((16, 18), (1.0, 1.5)))
    many = Array(element=element, counts=counts).heights(Grid((16 * nx, 18 * ny), (nx * 1.0, ny * 1.5)))
    np.testing.assert_allclose(many, np.tile(one, (nx, ny)), atol=1e-14)


def test_sinusoid_is_lowest_in_the_middle_and_repeats():
    x = np.arange(64) / 64 - 0.5
    heights = Sinusoid(amplitude=0.02, wavelength=0.25).heights(Grid((64,), (1.0,)))
    np.testing.assert_allclose(heights, 0.02 * (1 - np.cos(8 * np.pi * x)), atol=1e-16)
    assert heights[32] == 0
    np.testing.assert_allclose(heights, np.roll(heights, 16), atol=1e-16)


@pytest.mark.parametrize("grid", [LINE, SQUARE], ids=["line", "square"])
@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int64])
def test_an_array_file_gives_its_heights_above_the_lowest(grid, dtype, tmp_path):
    heights = np.random.default_rng(0).integers(-50, 50, grid.shape).astype(dtype)
    np.save(tmp_path / "h.npy", heights)
    np.testing.assert_array_equal(
        Profile(file=tmp_path / "h.npy").heights(grid), heights - float(heights.min())
    )


@pytest.mark.parametrize("separator", [" ", "\t", ", ", ";"])
def test_a_text_file_gives_its_heights_bit_by_bit(separator, tmp_path):
    x, heights = LINE.coordinates[0], np.random.default_rng(0).random(16)
    heights[5] = 0.0
    rows = [f"{float(a)!r}{separator}{float(b)!r}" for a, b in zip(x, heights, strict=True)]
    file = tmp_path / "h.txt"
    file.write_text("# measured\nx" + separator + "height\n\n" + "\n".join(rows) + "\n")
    np.testing.assert_array_equal(Profile(file=file).heights(LINE), heights)


def test_the_origin_of_a_text_profile_is_free(tmp_path):
    file = tmp_path / "h.txt"
    x, heights = LINE.coordinates[0], Parabola().heights(LINE)
    np.savetxt(file, np.column_stack((x + 7.5, heights - 3)))
    np.testing.assert_allclose(Profile(file=file).heights(LINE), heights, atol=1e-14)


def text_rows(count=16, spacing=1 / 16):
    return [f"{i * spacing:.10f} {0.1 * i:.3f}" for i in range(count)]


def replaced(row, at=3):
    rows = text_rows()
    return [*rows[:at], row, *rows[at + 1 :]]


def stretched(at):
    return [*text_rows()[:at], *(f"{(i + 0.5) / 16} 1.0" for i in range(at, 16))]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (text_rows(15), r"h\.txt: holds 15 heights; must be 16"),
        (text_rows(17), r"h\.txt: holds 17 heights; must be 16"),
        (text_rows(spacing=1 / 15), r"h\.txt: x is not spaced by period/points = 0\.0625"),
        (stretched(9), r"h\.txt: x is not spaced .* row 10"),
        (replaced("0.1875 nan"), r"h\.txt:4: height is 'nan' in '0\.1875 nan'; must be a number"),
        (replaced("0.1875 -inf"), r"h\.txt:4: '0\.1875 -inf' is not a row of numbers"),
        (replaced("0.1875 high"), r"h\.txt:4: '0\.1875 high' is not a row of numbers"),
        (replaced("0.1875"), r"h\.txt:4: '0\.1875' is not a row of numbers"),
        (replaced("0.1875 1 2"), r"h\.txt:4: .* holds 3 columns; must be 2, as above"),
        (
            replaced("0.1875 -9999"),
            r"h\.txt: 1 of 16 heights are -9999, far from all others.* give punch\.hole",
        ),
        ([], r"h\.txt:1: holds no rows of numbers"),
    ],
)
def test_a_text_file_that_cannot_be_used_is_refused_by_its_line(rows, message, tmp_path):
    (tmp_path / "h.txt").write_text("\n".join(rows))
    with pytest.raises(TableError, match=message):
        Profile(file=tmp_path / "h.txt").heights(LINE)


def test_a_text_file_does_not_describe_a_surface_in_two_dimensions(tmp_path):
    (tmp_path / "h.txt").write_text("\n".join(text_rows()))
    with pytest.raises(TableError, match=r"h\.txt: .*needs an array \(\.npy\)"):
        Profile(file=tmp_path / "h.txt").heights(SQUARE)


NO_ARRAY = r"h\.npy: is not a NumPy array file"


@pytest.mark.parametrize(
    ("heights", "message"),
    [
        (np.zeros(15), r"h\.npy: holds 15 heights; must be 16, as the grid"),
        (np.zeros((16, 16)), r"h\.npy: holds 16 x 16 heights; must have one axis, as the grid"),
        (np.append(np.zeros(15), np.nan), r"h\.npy: the height at index \[15\] is not a finite number"),
        (np.full(16, "high"), r"h\.npy: must hold one array of real numbers"),
        (np.zeros(16, complex), r"h\.npy: must hold one array of real numbers"),
        (np.array([None] * 16), NO_ARRAY),
        (b"", NO_ARRAY),
        (b"\x93NUMPY", NO_ARRAY),
        (b"0 1\n1 2\n", NO_ARRAY),
    ],
)
def test_an_array_file_that_cannot_be_used_is_refused(heights, message, tmp_path):
    if isinstance(heights, bytes):
        (tmp_path / "h.npy").write_bytes(heights)
    else:
        np.save(tmp_path / "h.npy", heights, allow_pickle=True)
    with pytest.raises(TableError, match=message):
        Profile(file=tmp_path / "h.npy").heights(LINE)


@pytest.mark.parametrize("name", ["h.npy", "h.txt"])
def test_a_file_that_is_gone_is_named(name, tmp_path):
    (tmp_path / name).touch()
    punch = Profile(file=tmp_path / name)
    (tmp_path / name).unlink()
    with pytest.raises(TableError, match=name.replace(".", r"\.")):
        punch.heights(LINE)


@pytest.mark.parametrize("name", [name for name, shape in SHAPES.items() if shape not in ISOLATED])
def test_every_shape_is_chosen_by_its_word_and_touches_at_height_zero(name, tmp_path):
    np.save(tmp_path / "h.npy", np.random.default_rng(0).random((16, 16)))
    file = {"file": str(tmp_path / "h.npy")}
    keys = {
        "sphere": {"radius": 1}, "cylinder": {"radius": 1}, "cone": {"slope": 1}, "wedge": {"slope": 1},
        "flat": {"width": 0.1, "edge_radius": 0.1}, "sinusoid": {"amplitude": 0.1, "wavelength": 0.5},
        "blunted_cone": {"slope": 1, "tip_radius": 0.1},
        "array": {"counts": 2, "element": {"radius": 1}}, "profile": file, "topography": file,
        "self_affine": {"hurst": 0.8, "short_cutoff": 0.2, "seed": 1, "rms_slope": 0.1},
    }  # fmt: skip
    punch = {"shape": name} | keys.get(name, {})
    config = Config.model_validate({"name": "x", "grid": {"points": [16, 16]}, "punch": punch})
    assert isinstance(config.punch, SHAPES[name])
    heights = config.punch.heights(SQUARE)
    assert heights.shape == (16, 16)
    assert heights.min() == 0 < heights.max()


def of_revolution(tmp_path):
    """Return keys of each shape that may be a body of revolution."""
    (tmp_path / "tip.txt").write_text("radius height\n0 0\n0.5 0.1\n1 0.4\n2 1.6\n")
    return {
        "parabola": {"radius": 0.5}, "sphere": {"radius": 3.0}, "cone": {"slope": 0.3},
        "flat": {"width": 0.4, "edge_radius": 0.5}, "blunted_cone": {"slope": 0.3, "tip_radius": 1.0},
        "flat_punch": {"radius": 0.7}, "radial_profile": {"file": str(tmp_path / "tip.txt")},
    }  # fmt: skip


def test_profiles_of_revolution_have_the_heights_of_their_shapes(tmp_path):
    r = np.linspace(0.0, 0.6, 13)
    for name, keys in of_revolution(tmp_path).items():
        grid = {"geometry": "axisymmetric"}
        punch = Config.model_validate({"name": "x", "grid": grid, "punch": {"shape": name, **keys}}).punch
        profile = heights(punch.revolution(), r)
        expected = punch.height([r]) if isinstance(punch, Analytic) else 0 * r
        if name != "radial_profile":
            np.testing.assert_allclose(profile, expected, atol=1e-15)
    assert of_revolution(tmp_path).keys() == {
        word for word, each in SHAPES.items() if hasattr(each, "revolution")
    }


@pytest.mark.parametrize("name", ["flat_punch", "radial_profile"])
def test_an_indenter_with_a_rim_is_refused_in_a_periodic_cell(name, tmp_path):
    with pytest.raises(ValidationError, match="has a rim; must be another shape"):
        Config.model_validate({"name": "x", "punch": {"shape": name, **of_revolution(tmp_path)[name]}})
