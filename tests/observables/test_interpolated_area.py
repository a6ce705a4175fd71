"""The contact area between the points of the grid, against closed forms, symmetries and irregular edges."""

import math

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate
from gfmdlayer.config import Config
from gfmdlayer.contact.bounded import ConjugateGradient
from gfmdlayer.contact.problem import Problem, in_contact
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.observables import contact_statistics
from gfmdlayer.observables.contact_statistics import T0
from gfmdlayer.verification.theory import E_STAR, RADIUS, parabola_depth, parabola_pressure
from tests.recordings import Kept


def interpolated_area(touching, pressure, gap):
    grid = Grid(touching.shape, (1.0,) * touching.ndim)
    fields = (field.ravel() for field in (touching, pressure, gap))
    return contact_statistics.contact_extent(*fields, grid).area


def pressed(punch, load):
    """A halfspace of period 1 under a punch and a mean pressure."""
    grid = Grid(punch.shape, (1.0,) * punch.ndim)
    stiffness = E_STAR / 2 * grid.wavenumbers.ravel()
    height = float(np.ptp(punch))
    problem = Problem(stiffness, np.zeros(stiffness.size, complex), punch.ravel(), load, None, height)
    solver = ConjugateGradient(Transforms(punch.shape))
    solution = solver.solve(problem, np.full(punch.size, load), 1e-9)
    assert solution.converged
    return problem, solution


def area(punch, load):
    """Contact area in points."""
    problem, solution = pressed(punch, load)
    fields = (in_contact(problem, solution), solution.pressure, solution.gap)
    return punch.size * interpolated_area(*(field.reshape(punch.shape) for field in fields))


def from_middle(n, shift):
    """Distances from a place between two points, on a periodic line."""
    return (np.arange(n) / n - shift / n + 0.5) % 1.0 - 0.5


def parabola(n, shift):
    return from_middle(n, shift) ** 2 / (2 * RADIUS)


def load_of(width):
    """Mean pressure under a periodic parabola, from the part of the line in contact."""
    return float(parabola_pressure(width / 2))


@pytest.mark.parametrize(("n", "width"), [(256, 20.0), (255, 33.3), (512, 60.7), (512, 171.9)])
def test_a_line_contact_is_as_wide_as_the_closed_form(n, width):
    # A twentieth of a cell is asked for. The estimates of both edges are good to 0.002 each and 0.007 at the
    # widest; places of the edges between two points are all passed.
    errors = [area(parabola(n, shift), load_of(width / n)) - width for shift in np.linspace(0, 1, 9)]
    assert np.max(np.abs(errors)) < 0.02


@pytest.mark.parametrize("radius", [10.0, 17.3])
def test_a_sphere_makes_a_circle_of_the_radius_of_hertz(radius):
    n = 128
    x, y = from_middle(n, 0.3)[:, None], from_middle(n, 0.85)
    hertz = 4 * E_STAR * (radius / n) ** 3 / 3  # the force on a sphere of radius 1
    found = math.sqrt(area((x**2 + y**2) / 2, hertz) / math.pi)
    # Neighbours at a distance of 128 cells lift the surface by a parabola of relative curvature (a/L)^3; the
    # sum over them is below 5 (a/L)^3, and a^3 goes with the radius of curvature.
    assert found == pytest.approx(radius, abs=0.015 + 5 / 3 * radius * (radius / n) ** 3)


def test_the_error_of_the_area_is_of_first_order_in_the_spacing_or_better():
    errors = []
    for n in (64, 256):
        width = 20 * n / 64
        shifts = np.linspace(0, 1, 5)
        errors.append(max(abs(area(parabola(n, s), load_of(width / n)) - width) / n for s in shifts))
    assert errors[1] < errors[0] / 4
    assert errors[0] < 0.05 / 64


def test_the_area_does_not_depend_on_place_or_direction():
    rng, n = np.random.default_rng(5), 48
    waves = rng.normal(size=(n, n))
    q = np.hypot(np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)) * n
    punch = np.fft.irfft2(np.fft.rfft2(waves) * np.exp(-((q / 4) ** 2)), s=(n, n))
    punch = 0.02 * (punch - punch.min()) / np.ptp(punch)
    problem, solution = pressed(punch, 0.02)
    fields = [each.reshape(n, n) for each in (in_contact(problem, solution), solution.pressure, solution.gap)]
    whole = interpolated_area(*fields)
    # A side of the grid that the edge crosses counts as a half; the edge is anywhere on it, or T0 before.
    crossed = sum(np.count_nonzero(fields[0] != np.roll(fields[0], 1, axis)) for axis in (0, 1))
    assert abs(whole - solution.contact_area) < (0.5 + T0) * crossed / n**2
    for moved in (
        [np.roll(each, (7, -19), (0, 1)) for each in fields],
        [np.ascontiguousarray(each.T) for each in fields],
        [np.ascontiguousarray(each[::-1]) for each in fields],
    ):
        assert interpolated_area(*moved) == pytest.approx(whole, rel=1e-12)


@pytest.mark.parametrize("shape", [(1000,), (70, 150)])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_wide_contacts_and_gaps_count_at_every_place(shape, seed):
    """Stretches without an edge are passed over; wherever they begin, points, area and error are the same."""
    grid, rng = Grid(shape, (1.0,) * len(shape)), np.random.default_rng(seed)
    edges = np.sort(rng.permutation(shape[-1])[:6])
    heights = np.where(np.searchsorted(edges, np.arange(shape[-1])) % 2, -1.0, 1.0) + np.zeros(shape)
    if len(shape) == 2:
        heights[:50] *= -1
    heights *= 1 + rng.random(shape)

    def extent(values):
        fields = values > 0, np.sqrt(np.maximum(values, 0)), np.maximum(-values, 0) ** 1.5
        return contact_statistics.contact_extent(*(field.ravel() for field in fields), grid)

    first = extent(heights)
    crossings = sum(
        np.count_nonzero((heights > 0) != (np.roll(heights, 1, k) > 0)) for k in range(len(shape))
    )
    assert first.points == np.count_nonzero(heights > 0)
    assert abs(first.area * heights.size - first.points) < 0.7 * crossings
    for shift in (1, 37, 64, 65, 101):
        moved = extent(np.roll(heights, shift, axis=-1))
        assert moved.points == first.points
        assert moved[1:] == pytest.approx(first[1:], rel=1e-12)


@pytest.mark.parametrize("shape", [(9,), (8, 9)])
def test_full_contact_and_none_are_exact(shape):
    none, ones = np.zeros(shape, bool), np.ones(shape)
    assert interpolated_area(none, 0 * ones, ones) == 0.0
    assert interpolated_area(~none, ones, 0 * ones) == 1.0


@pytest.mark.parametrize("width", [1.0, 2.0, 3.0])
def test_contacts_of_one_to_three_points_have_a_width(width):
    # Where the count is wrong by up to a cell; the fields are no longer those of a wide contact.
    errors = [area(parabola(128, shift), load_of(width / 128)) - width for shift in (0, 0.25, 0.5, 0.75)]
    assert np.max(np.abs(errors)) < 0.1


def test_the_edge_of_a_flat_punch_lies_between_the_points():
    x = from_middle(64, 0.5)
    found = area(np.where(np.abs(x) < 10 / 64, 0.0, 0.1), 0.05)
    assert found == 20.0


def test_a_curve_rises_without_stairs_and_agrees_with_a_finer_grid():
    # The edge creeps by less than a point in many steps while the layer relaxes.
    values = {"time": {"end": 3.0, "step": 0.05}, "layer.thickness": 0.1}
    curves = []
    for n in (256, 2048):
        recording = Kept()
        config = Config(name="creep").with_values(values | {"grid.points": n})
        simulate(config, recording)
        curves.append(np.asarray(recording["contact_area_interpolated"])[8:])
    coarse, fine = curves
    assert np.all(np.diff(coarse) > 0)
    # A tenth of a cell: layers of some 25 points let the gap bend beside the contact.
    np.testing.assert_allclose(coarse, fine, atol=0.1 / 256)


def test_the_depth_gives_the_same_width_while_a_halfspace_relaxes():
    # Contact that does not shrink is as wide as an elastic one at the same depth, whatever the history.
    recording = Kept()
    n = 512
    values = {"grid.points": n, "layer.thickness": math.inf, "time": {"end": 3.0, "step": 0.1}}
    simulate(Config(name="halfspace").with_values(values), recording)
    found = parabola_depth(np.asarray(recording["contact_area_interpolated"]) / 2)
    depth = np.asarray(recording["depth"])
    wide = depth > 0.002  # 20 points
    # d(depth)/d(width) = (2 / pi) tan(half) -ln cos^2... is below 0.5 here: a twentieth of a cell.
    np.testing.assert_allclose(found[wide], depth[wide], atol=0.5 * 0.05 / n)


@pytest.mark.parametrize("method", ["fire", "conjugate_gradient", "active_set"])
def test_the_gap_is_zero_exactly_where_there_is_contact(method, run):
    values = {"grid.points": 64, "time": {"end": 1.0, "step": 0.25}, "solver.method": method}
    recording = run(values | {"output.snapshots": [1.0]})
    (gap,) = recording.gaps
    assert np.count_nonzero(gap == 0) == round(64 * recording["contact_area"][-1]) > 0
    assert gap.min() == 0


def test_an_open_gap_keeps_its_value():
    case = Case(Config(name="line", grid={"points": 64}, time={"step": 0.005}))
    step = next(step for step in map(case.contact.attempt, case.steps) if step.contact_area > 0)
    gap, distance, touching = (step.fields[name] for name in ("gap", "distance", "touching"))
    assert 0 < touching.sum() < touching.size
    np.testing.assert_array_equal(gap[~touching], distance[~touching])
    assert not gap[touching].any()


@pytest.mark.parametrize("force", [4e-4, 4e-3])
def test_the_estimated_error_bounds_the_error_on_a_sphere_and_is_not_far_from_it(force):
    """Hertz, on 8 to 40 points across; the finer grid is off by a sixteenth of the coarser one's estimate.

    Errors of the edge on the lines of the grid have either sign, and cancel in part: on 40 points they leave
    a twentieth of what the estimate allows for, and a fifth at the forces beside.
    """
    body, punch = gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=8.0)
    found = [gfmdlayer.solve(body, punch, force=force, points=(n, n)) for n in (64, 256)]
    coarse, fine = (float(each.contact_area_interpolated) for each in found)
    estimate = float(found[0].contact_area_error)
    assert abs(coarse - fine) < estimate < 20 * abs(coarse - fine)
    assert estimate < abs(float(found[0].contact_area) - fine)  # less than that of counting


def test_the_estimated_error_bounds_the_error_on_a_rough_surface():
    """Eight points for the shortest wave, against 32."""
    rough = gfmdlayer.SelfAffine(hurst=0.8, short_cutoff=1 / 8, seed=1, rms_slope=0.1)
    found = [
        gfmdlayer.solve(gfmdlayer.halfspace(1.0), rough, mean_pressure=0.04, points=(n, n)) for n in (64, 256)
    ]
    coarse, fine = (float(each.contact_area_interpolated) for each in found)
    assert 0.05 * float(found[0].contact_area_error) < abs(coarse - fine) < float(found[0].contact_area_error)


LINES = {
    "thin": ({"layer": {"thickness": 0.01, "poisson": 0.4}}, {"depth": 0.002}),
    "thinner than a spacing": ({"layer": {"thickness": 0.003, "poisson": 0.5}}, {"depth": 0.0006}),
    "wedge": (
        {
            "punch": {"shape": "wedge", "slope": 0.2},
            "layer": {"thickness": 1.0, "material": {"model": "elastic", "G": 1.0}},
            "halfspace": {"shear_modulus": 1.0},
        },
        {"control": "load", "load": 0.05},
    ),
}


@pytest.mark.parametrize("points", [54, 96, 256])
@pytest.mark.parametrize("name", LINES)
def test_the_estimated_error_bounds_the_error_on_thin_layers_and_corners(name, points):
    """Edges without the square-root law over some spacings, against 4096 points, of a sixteenth of the error.

    A layer of 0.01 on 256 points: 0.0655 with a limit of 0.0660; the law of smooth edges alone allows for a
    third of that.
    """
    sections, drive = LINES[name]
    base = {"punch": {"shape": "parabola", "radius": 1.0}, "time": {"end": 1.0, "step": 0.25}, **sections}
    base["trajectory"] = {"ramp_time": 1.0, **drive}
    coarse, fine = (
        gfmdlayer.run(base, progress=False, grid={"points": n}).isel(time=-1) for n in (points, 4096)
    )
    off = abs(float(coarse.contact_area_interpolated - fine.contact_area_interpolated))
    assert off < float(coarse.contact_area_error) < 20 * off
