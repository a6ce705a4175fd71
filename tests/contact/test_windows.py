"""Windows around the contact: their operator against the whole surface's, and solves with and without."""

from dataclasses import replace
from math import prod
from pathlib import Path

import numpy as np
import pytest

from gfmdlayer.body.closed_form import LayeredHalfspace
from gfmdlayer.case.model import model_of
from gfmdlayer.config import load
from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.contact.active_set.windows import periodic_extent
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.grid import Grid, parts
from gfmdlayer.grid.transforms import Transforms

TOLERANCE = 1e-10
SHAPES = [(1024,), (1000,), (243 * 4,), (260, 390)]
SHAPES += [pytest.param(shape, marks=pytest.mark.slow) for shape in ((512, 256), (390, 780))]
CONDITIONS = ["fixed mean", "free mean", "load"]
each_shape = pytest.mark.parametrize("shape", SHAPES)
each_condition = pytest.mark.parametrize("condition", CONDITIONS)


def problem_of(shape, condition, centre=0.0, seed=0):
    """A parabola pressed at some centre, in parts of the period, into a layer with a history."""
    grid = Grid(shape, (1.0,) * len(shape))
    yields = condition == "free mean"
    layer = LayeredHalfspace(0.05, 0.4, np.inf) if yields else LayeredHalfspace(0.05, 0.5, 1.0)
    kappa = np.ravel(layer.stiffness(grid.wavenumbers, 1.0))
    if not yields:
        kappa[0] = 0.0
    apart = [(x - centre + 0.5) % 1.0 - 0.5 for x in grid.coordinates]
    height = sum(np.square(x) for x in np.meshgrid(*apart, indexing="ij"))
    random = np.random.default_rng(seed)
    # What remains of an earlier contact: smooth, and small beside the depth.
    b = (
        np.ravel(np.fft.rfftn(1e-3 * random.standard_normal(shape)))
        * kappa
        * np.exp(-np.ravel(grid.wavenumbers) / 10)
    )
    b[0] = 0.0
    if condition == "load":
        return Problem(kappa, b, 2 * np.ravel(height), 2e-3)
    return Problem(kappa, b, 2 * np.ravel(height) - 0.005)


@pytest.fixture
def attempts(monkeypatch):
    """What windows give."""
    given = []
    in_windows = ActiveSet._in_windows

    def recorded(self, *arguments):
        given.append(in_windows(self, *arguments))
        return given[-1]

    monkeypatch.setattr(ActiveSet, "_in_windows", recorded)
    return given


def without_windows(problem, shape, tolerance=TOLERANCE):
    return ActiveSet(Transforms(shape), windows=False).solve(problem, np.zeros(prod(shape)), tolerance)


def assert_same(found, expected, problem, tolerance=TOLERANCE):
    """Both have gaps in the contact within the tolerance: pressures differ by what such gaps are worth."""
    depth = (problem.obstacle - problem.obstacle.min() - found.gap).max()
    bound = 2 * tolerance * depth * np.abs(problem.stiffness).max()
    assert found.converged
    assert np.abs(found.pressure - expected.pressure).max() <= bound
    assert found.mean_pressure == pytest.approx(expected.mean_pressure, rel=20 * tolerance)
    assert found.mean_gap == pytest.approx(expected.mean_gap, rel=20 * tolerance)
    assert found.contact_area == pytest.approx(expected.contact_area, abs=2 / problem.obstacle.size)


@each_shape
@each_condition
@pytest.mark.parametrize("centre", [0.0, 0.31, -0.5, 0.4999])
def test_a_contact_anywhere_is_that_of_a_solve_without(shape, condition, centre, attempts):
    problem = problem_of(shape, condition, centre)
    expected = without_windows(problem, shape)
    attempts.clear()
    # A guess that is shifted by a point, too large, and has what no guess should have.
    start = 1.5 * np.roll(expected.pressure, 1)
    start[np.argmin(start)] = np.nan
    found = ActiveSet(Transforms(shape)).solve(problem, start, TOLERANCE)
    assert [attempt.within for attempt in attempts] == [True]
    assert_same(found, expected, problem)


@each_shape
def test_without_a_guess_the_overlap_shows_where_the_window_belongs(shape, attempts):
    problem = problem_of(shape, "fixed mean", 0.25)
    found = ActiveSet(Transforms(shape)).solve(problem, np.zeros(prod(shape)), TOLERANCE)
    assert [attempt.within for attempt in attempts] == [True]
    assert_same(found, without_windows(problem, shape), problem)


@each_condition
def test_a_contact_that_outgrows_its_window_gets_a_larger_one(condition, attempts):
    shape, start = (4096,), np.zeros(4096)
    problem = problem_of(shape, condition)
    start[2048] = 1.0
    found = ActiveSet(Transforms(shape)).solve(problem, start, TOLERANCE)
    # The shortest window has 32 points.
    assert found.contact_area > 40 / 4096
    assert attempts[0].within
    assert_same(found, without_windows(problem, shape), problem)


@each_condition
def test_a_contact_beyond_the_window_is_found(condition):
    """Of two bumps the guess knows one; the other is as large, or a single point."""
    shape = (2048,)
    for other in (-0.2, -0.195):
        problem = problem_of(shape, condition, 0.2)
        bump = problem_of(shape, condition, other).obstacle + 2 * 0.005 * (other == -0.195)
        both = Problem(
            problem.stiffness, problem.intercept, np.minimum(problem.obstacle, bump), problem.mean_pressure
        )
        expected = without_windows(both, shape)
        start = np.where(Grid(shape, (1.0,)).coordinates[0] > 0, expected.pressure, 0.0)
        found = ActiveSet(Transforms(shape)).solve(both, start, TOLERANCE)
        assert_same(found, expected, both)


def test_a_contact_as_wide_as_the_surface_has_no_window(attempts):
    shape = (1024,)
    problem = problem_of(shape, "load")
    found = ActiveSet(Transforms(shape)).solve(problem, np.ones(1024), TOLERANCE)
    assert [tuple(attempt)[:4] for attempt in attempts] == [(0, 0, False, False)]
    assert_same(found, without_windows(problem, shape), problem)


@pytest.mark.parametrize(("kept", "lost"), [(1, 0), (0, 1)])
def test_what_a_solver_remembers_has_no_part_in_a_window(kept, lost):
    """A window's solve depends on the problem and the guess alone, to the last bit."""
    shape = (1024,)
    transforms = Transforms(shape)
    problems = [problem_of(shape, "fixed mean", centre) for centre in (0.1, 0.3)]
    starts = [without_windows(problem, shape).pressure for problem in problems]
    used, new = ActiveSet(transforms), ActiveSet(transforms)
    used.solve(problems[lost], starts[lost])
    again = used.solve(problems[kept], starts[kept])
    first = new.solve(problems[kept], starts[kept])
    np.testing.assert_array_equal(again.pressure, first.pressure)
    np.testing.assert_array_equal(again.spectrum, first.spectrum)


def test_a_window_costs_a_part_of_the_surface(attempts):
    """Three transforms of the whole surface and one for the kernel; the others count by their points."""
    shape = (1 << 14,)
    problem = problem_of(shape, "fixed mean")
    expected = without_windows(problem, shape)
    solver = ActiveSet(Transforms(shape))
    first = solver.solve(problem, expected.pressure)
    again = solver.solve(problem, expected.pressure)
    (one, two) = (attempt.transforms for attempt in attempts[-2:])
    assert one == pytest.approx(two + 1)
    assert 3 < two < 4
    # Half transforms are carried on.
    assert first.transforms + again.transforms == int((one + two) / 2)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ((1024,), (2, 4, 8, 16)),
        ((1000,), (2, 4, 8)),
        ((127,), ()),
        ((509,), ()),
        ((256, 128), (2,)),
        ((130, 390), (2,)),
        ((195, 390), (3,)),
    ],
)
def test_windows_divide_all_axes(shape, expected):
    assert parts(shape) == expected


def test_one_contact_is_not_evaluated_in_the_window_at_the_end(attempts):
    """A multiple of the solution is scaled without a transform; what is found is checked on the surface."""
    shape = (1 << 14,)
    one = problem_of(shape, "fixed mean")
    two = replace(one, obstacle=np.minimum(one.obstacle, problem_of(shape, "fixed mean", 0.06).obstacle))
    for problem, in_window in ((one, 2), (two, 4)):
        expected = without_windows(problem, shape)
        solver = ActiveSet(Transforms(shape))
        for _ in range(2):  # the first makes the kernel
            found = solver.solve(problem, 1.001 * expected.pressure)
        _, (_, width) = periodic_extent(expected.pressure, (1, *shape), np.zeros(0))
        # Twice the contact with a margin on either side.
        part = max(part for part in parts(shape) if 2 * (width + 2 * max(16, width // 8)) * part <= shape[0])
        assert attempts[-1].transforms == pytest.approx(3 + in_window / part)
        assert_same(found, expected, problem, 1e-6)


@pytest.mark.parametrize(
    ("rows", "points", "expected"),
    [
        ([], [], ((0, 0), (0, 0))),
        ([0], [5], ((0, 1), (5, 1))),
        ([0, 0], [0, 15], ((0, 1), (15, 2))),
        ([0, 0, 0], [3, 4, 11], ((0, 1), (3, 9))),
        ([1, 6], [14, 2], ((6, 4), (14, 5))),
    ],
)
def test_spans_go_on_at_the_beginning(rows, points, expected):
    pressure = np.full((8, 16), -1.0)
    pressure[rows, points] = 1.0
    assert periodic_extent(pressure.ravel(), (8, 16), np.zeros(24)) == expected


@pytest.mark.parametrize("trajectory", [{"depth": 0.003}, {"control": "load", "load": 0.01}], ids=str)
def test_warming_up_comes_to_a_window(trajectory, attempts):
    """What it leaves is compiled by all ranks at once."""
    config = load(Path(__file__).parents[2] / "configs/indentation.yaml")
    model = model_of(config.with_values({"solver.method": "active_set", "trajectory": trajectory}))
    model.stepwise = True  # the compiled loop has the same windows
    model.warm_up()
    assert any(attempt.within for attempt in attempts)


@each_condition
def test_bits_do_not_depend_on_where_arrays_lie(condition):
    problem = problem_of((4096,), condition)
    transforms = Transforms((4096,))
    start = np.maximum(problem.obstacle.min() + 0.005 - problem.obstacle, 0.0)
    rng, kept, found = np.random.default_rng(0), [], set()
    for _ in range(40):
        kept += [np.empty(size, np.uint8) for size in rng.integers(1, 3000, 20)]
        moved = replace(problem, obstacle=problem.obstacle.copy(), intercept=problem.intercept.copy())
        solution = ActiveSet(transforms).solve(moved, start.copy(), TOLERANCE)
        kept += [solution.pressure.view(np.uint8), moved.obstacle.view(np.uint8)]
        found.add(hash(solution.pressure.tobytes()))
    assert len(found) == 1
