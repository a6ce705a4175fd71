"""Adaptive steps: their error, their number, and the times that they land on."""

import math
from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate
from gfmdlayer.config import Config
from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.history.adaptive_steps import AdaptiveSteps
from gfmdlayer.history.time_points import stops

ADAPTIVE = {"grid.points": 1024, "time.step": "adaptive", "solver.tolerance": 1e-7}


def prony(*branches):
    return {"layer.material": {"model": "prony", "branches": [{"G": G, "tau": tau} for G, tau in branches]}}


BODIES = {
    "Ginf 2": {"layer.material.Ginf": 2.0}, "default": {}, "Ginf 100": {"layer.material.Ginf": 100.0},
    "bulk 10": {"halfspace.shear_modulus": 10.0}, "rigid base": {"halfspace.shear_modulus": math.inf},
    "three branches": prony((3.0, 0.1), (3.0, 1.0), (3.0, 10.0)),
    "eight branches": prony(*((2.0, 10.0**k) for k in np.linspace(-2, 3, 8))),
}  # fmt: skip


@pytest.fixture(scope="module")
def reference(run):
    """Mean pressure of a body up to 8 tau by fixed steps, whose error is below 2e-6 of the largest."""

    @cache
    def of(body):
        fine = run(BODIES[body] | {"grid.points": 1024, "time.step": 0.005, "solver.tolerance": 1e-7})
        time, pressure = fine["time"], fine["mean_pressure"]
        ramp = CubicSpline(time[time <= 1], pressure[time <= 1])
        hold = CubicSpline(time[time >= 1], pressure[time >= 1])
        return lambda t: np.where(t <= 1, ramp(np.minimum(t, 1)), hold(np.maximum(t, 1)))

    return of


# The others are between these: contrasts of 2 and 100, a rigid base, eight branches over five decades.
SOON = {"Ginf 2", "Ginf 100", "rigid base", "eight branches"}


@pytest.mark.parametrize(
    "body", [each if each in SOON else pytest.param(each, marks=pytest.mark.slow) for each in BODIES]
)
@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5])
def test_the_error_is_of_the_size_of_the_tolerance(run, reference, body, tolerance):
    recording = run(ADAPTIVE | BODIES[body] | {"time.tolerance": tolerance})
    known = recording["time"] > 0.01  # where the steps of the reference resolve the first touch
    time, pressure = recording["time"][known], recording["mean_pressure"][known]
    error = np.abs(pressure - reference(body)(time)).max() / pressure.max()
    assert error < 2 * tolerance
    if tolerance < 1e-3:  # at a wide one the growth of so few steps, not their error, decides their length
        assert error > tolerance / 3
    assert np.abs(recording["energy_residual"]).max() < 5 * tolerance * recording["work"].max()


def test_a_ramp_and_a_thousand_relaxation_times_of_hold_take_few_steps(run, reference):
    recording = run(ADAPTIVE | {"time.end": 1000.0, "time.tolerance": 1e-4})
    close = run(ADAPTIVE | {"time.end": 1000.0, "time.tolerance": 1e-6, "output.times": (10.0, 30.0, 100.0)})
    there = run(ADAPTIVE | {"time.end": 1000.0, "time.tolerance": 1e-4, "output.times": (10.0, 30.0, 100.0)})
    largest = recording["mean_pressure"].max()
    time = recording["time"]
    known = (time > 0.01) & (time <= 8)
    early = np.abs(recording["mean_pressure"] - reference("default")(time))[known].max()
    times = [10.0, 30.0, 100.0, 1000.0]
    late = np.abs(there.at("mean_pressure", times) - close.at("mean_pressure", times)).max()
    assert max(early, late) <= 1e-4 * largest
    assert time.size - 1 <= 60


def test_a_jump_is_followed_from_a_millionth_of_the_relaxation_time_on(run, tmp_path):
    (tmp_path / "jump.txt").write_text("time depth\n0 0.01\n1000 0.01\n")
    jump = ADAPTIVE | {
        "time.end": 1000.0,
        "trajectory": {"kind": "table", "file": str(tmp_path / "jump.txt")},
    }
    times = (1e-3, 1e-2, 0.1, 1.0, 3.0, 10.0, 30.0, 100.0)
    recording = run(jump | {"time.tolerance": 1e-4})
    assert 0 < recording["time"][1] <= 1e-6
    assert recording["time"].size - 1 <= 80
    early = tuple(recording["time"][1:6])
    first = run(jump | {"time.tolerance": 1e-6, "output.times": early}).at("mean_pressure", early)
    assert np.abs(recording["mean_pressure"][1:6] - first).max() <= 1e-4 * recording["mean_pressure"].max()
    coarse = run(jump | {"time.tolerance": 1e-4, "output.times": times}).at("mean_pressure", times)
    close = run(jump | {"time.tolerance": 1e-6, "output.times": times}).at("mean_pressure", times)
    assert np.abs(coarse - close).max() <= 1e-4 * recording["mean_pressure"].max()


def test_rows_fall_on_every_output_time_snapshot_and_breakpoint(run):
    asked = {"time.end": 3.0, "output.times": 0.3, "output.snapshots": [0.0, 0.7, 3.0]}
    recording = run(ADAPTIVE | {"grid.points": 256, "trajectory.ramp_time": 0.95} | asked)
    for time in [0.0, *(0.3 * np.arange(1, 11)), 0.7, 0.95, 3.0]:
        assert np.abs(recording["time"] - time).min() < 1e-9
    assert [time for time, _, _ in recording.snapshots] == [0.0, 0.7, 3.0]
    assert (np.diff(recording["time"]) > 1e-6).all()  # 0.3 * 10 and 3.0 are one


def test_the_displacement_is_within_the_tolerance_too(run):
    shown = {"time.end": 4.0, "output.snapshots": [0.5, 2.0, 4.0], "layer.material.Ginf": 100.0}
    close = run({"grid.points": 1024, "time.step": 0.005, "solver.tolerance": 1e-7} | shown)
    for tolerance in (1e-3, 1e-4):
        recording = run(ADAPTIVE | shown | {"time.tolerance": tolerance})
        for (_, u, _), (_, exact, _) in zip(recording.snapshots, close.snapshots, strict=True):
            assert math.sqrt(np.mean((u - exact) ** 2)) < 1.5 * tolerance * 0.01


def test_the_effort_of_a_rejected_step_is_in_the_next_row(monkeypatch, recorder):
    solutions = []
    seen = []
    solve = ActiveSet.solve
    monkeypatch.setattr(ActiveSet, "solve", lambda *given: solutions.append(solve(*given)) or solutions[-1])
    # An abrupt load on a body that creeps: too long a step is tried.
    creeping = ADAPTIVE | {"layer.material.Ginf": 100.0, "time.end": 20.0, "grid.points": 512}
    case, recording = Case(Config(name="creeping").with_values(creeping)), recorder()
    case.stepwise = True
    simulate(case, recording, seen.append)
    assert recording["rejected"].sum() > 0
    assert len(solutions) == len(recording.rows) + recording["rejected"].sum()
    assert recording["transforms"].sum() == sum(solution.transforms for solution in solutions)
    assert recording["iterations"].sum() == sum(solution.iterations for solution in solutions)
    assert len(seen) == len(solutions)


def attempt(instant, depth=0.0):
    """A step to a time point, at a depth, without attraction."""
    return SimpleNamespace(
        instant=instant, prescribed=depth, response=1.0, depth=depth, deforms=False, change=None
    )


def accepted_steps(size, end, snapshots=(), breakpoints=()):
    """Accepted time points and number of attempts, with an error of a size times the cube of the step."""
    attempts, accepted = 0, []
    steps = AdaptiveSteps(1e-4, stops(end, snapshots, breakpoints), 1.0)
    for instant in steps:
        attempts += 1
        if steps.accepts(attempt(instant), lambda step, **_moving: (size * step.instant.step**3, 0.0)):
            steps.advance()
            accepted.append(instant)
    return accepted, attempts


def test_steps_converge_to_just_below_the_tolerance():
    accepted, attempts = accepted_steps(size=1.0, end=100.0)
    longest = (1e-4) ** (1 / 3)
    assert 0.9 * longest < np.median([instant.step for instant in accepted]) < longest
    assert attempts - len(accepted) <= 2


def test_steps_grow_at_most_fourfold_and_later_twofold_and_do_not_grow_over_cuts():
    accepted, _ = accepted_steps(size=1e-12, end=1e4, breakpoints=[3.0, 5000.0, 1e4], snapshots=[0.5, 77.7])
    growth = [after.step / before.step for before, after in pairwise(accepted[1:])]
    assert max(growth[:3]) <= 4 * (1 + 1e-9)
    assert {0.5, 77.7} <= {instant.time for instant in accepted if instant.snapshot}
    assert [instant.time for instant in accepted if instant.breakpoint] == [3.0, 5000.0]  # the end is not
    # The motion before a breakpoint does not predict the one behind it.
    assert [before.time for before, after in pairwise(accepted) if after.fresh] == [3.0, 5000.0]
    assert len(accepted) < 50


def test_a_punch_at_rest_between_grid_points_is_not_in_contact(run):
    # Its depth at rest is not zero. After a first step as short as after a jump the load would be so small
    # that the heights of the punch are equal to rounding relative to it.
    recording = run({
        "grid.points": 14, "layer": {"thickness": 1.0, "poisson": 0.5}, "halfspace.shear_modulus": math.inf,
        "punch": {"shape": "array", "counts": 2, "element": {"shape": "parabola", "radius": 0.1}},
        "time": {"end": 1000.0, "integrator": "exponential", "step": "adaptive", "tolerance": 0.1},
        "trajectory": {"control": "load", "load": 0.01, "ramp_time": 500.0}, "solver.method": "active_set",
    })  # fmt: skip
    assert recording["time"][1] > 1e-3
    np.testing.assert_allclose(recording["mean_pressure"][-1], 0.005, rtol=1e-12)


def test_a_dent_that_heals_under_a_flat_punch_takes_few_steps(run, tmp_path):
    # At depth zero the punch does no work on the surface that recovers: the displacement is not proportional
    # to the derivative with respect to the depth.
    (tmp_path / "back.txt").write_text("time depth\n0 0\n1 0.01\n2 0\n400 0\n")
    times = (3.0, 5.0, 10.0, 20.0, 40.0, 100.0, 400.0)
    values = ADAPTIVE | {
        "time.end": 400.0,
        "punch": {"shape": "flat", "width": 0.3, "edge_radius": 0.2},
        "trajectory": {"kind": "table", "file": str(tmp_path / "back.txt")},
        "output.times": times,
    }
    coarse = run(values | {"time.tolerance": 1e-3})
    assert coarse["time"].size <= 40
    close = run(values | {"time.tolerance": 1e-5})
    difference = np.abs(coarse.at("mean_pressure", times) - close.at("mean_pressure", times)).max()
    assert difference <= 1e-3 * coarse["mean_pressure"].max()
    assert abs(coarse["mean_pressure"][-1]) < 1e-8


def test_a_retracted_punch_is_not_deep():
    seen = []

    def error(_step, *, deep, **_moving):
        seen.append(deep)
        return 0.0, 0.0

    steps = AdaptiveSteps(1e-4, stops(5.0, [], []), 1.0)
    depths = (-1.0, 0.005, 0.004, 4e-5, -1.0)
    for instant, depth in zip(steps, depths, strict=False):
        assert steps.accepts(attempt(instant, depth), error)
        steps.advance()
    assert seen == [True, True, False, False]


def test_a_step_that_fails_after_it_was_accepted_leaves_the_time_as_before():
    steps = AdaptiveSteps(1e-4, stops(5.0, [], []), 1.0)
    instants = iter(steps)
    assert steps.accepts(attempt(next(instants)), None)
    steps.advance()
    tried = attempt(next(instants))
    before = steps.state()
    assert steps.accepts(tried, lambda _step, **_moving: (0.0, 0.0))
    assert steps.state() == before
    steps.advance()
    assert steps.state()["time"] > before["time"]


def test_under_a_stiff_glass_contact_is_solved_as_steps_need(run):
    """What a solver leaves open, times the glassy over the relaxed modulus, is kept below their tolerance."""
    branches = [(3.4e8, 0.22), (4.4, 4.7e4), (12.6, 65.0)]
    stiff = {
        "grid.points": [8, 8], "layer": {"thickness": 0.005, "poisson": 0.5},
        "layer.material": {"model": "prony", "branches": [{"G": G, "tau": tau} for G, tau in branches]},
        "halfspace.shear_modulus": 0.0, "punch": {"shape": "flat", "width": 0.3, "edge_radius": 0.2},
        "trajectory": {"control": "force", "force": 800.0, "ramp_time": 6.5e4},
        "time": {"end": 2300.0, "step": "adaptive", "tolerance": 0.05}, "solver.method": "active_set",
    }  # fmt: skip
    contrast = 1 + sum(G for G, _ in branches)
    as_needed = run(stiff | {"solver.tolerance": 0.05 / contrast})
    assert np.array_equal(run(stiff)["time"], as_needed["time"])


FALLS = [{"G": tau**-0.9, "tau": tau} for tau in np.geomspace(1e-5, 1.0, 11).tolist()]


@pytest.mark.parametrize(
    ("material", "tolerance", "drive"),
    [
        ({"model": "power_law", "exponent": 0.5}, 1e-5, {"depth": 0.01}),
        ({"model": "power_law", "exponent": 0.8}, 1e-4, {"depth": 0.01}),
        ({"model": "power_law", "exponent": 0.7}, 1e-4, {"control": "load", "load": 0.01}),
        ({"model": "prony", "G0": 1.0, "branches": FALLS}, 1e-4, {"control": "load", "load": 0.01}),
    ],
    ids=["depth", "steep", "load", "prony"],
)
def test_steps_do_not_crawl_in_the_noise_of_the_solver(run, material, tolerance, drive):
    """Steps feel stiffnesses of all times: a step that is shortened for the noise would find more of it."""
    end = 2.0 if "load" in drive else 0.2
    powers = {
        "grid.points": 128,
        "layer": {"thickness": 0.1, "material": material},
        "trajectory": drive | {"ramp_time": 0.1},
        "time": {"end": end, "step": "adaptive", "tolerance": tolerance},
    }
    usual, exact = (run(powers | {"solver.tolerance": of_solver}) for of_solver in (1e-6, 1e-11))
    assert len(usual["time"]) < 1.5 * len(exact["time"])  # noise of the size of the tolerance rejects a few
    # At the end of the ramp, and of the hold; both have the error of the tolerance, twice at most (above).
    column = "depth" if "load" in drive else "mean_pressure"
    largest = exact[column].max()
    for time in (0.1, end):
        here, there = (each[column][each["time"] == time][0] for each in (usual, exact))
        assert here == pytest.approx(there, abs=4 * tolerance * largest)
