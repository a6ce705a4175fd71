"""A punch that moves along the surface: against closed forms, an independent solution, and symmetry."""

import importlib.util
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gfmdlayer.body.closed_form import LayeredHalfspace
from gfmdlayer.body.materials import Prony, Zener
from gfmdlayer.config import Config
from gfmdlayer.observables.numerics import SteadyState

SOLVER = {"method": "active_set", "tolerance": 1e-10}
SCRIPT = Path(__file__).parents[2] / "scripts" / "steady_sliding.py"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("steady_sliding", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def order(errors, steps):
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


# --- full contact of a sinusoid: mean of p du/dx = (a^2/2) q Im K(q, i q v) ---

AMPLITUDE = 1e-3
Q = 2 * np.pi
BODIES = {
    "default layer": (LayeredHalfspace(0.05, 0.5, 1.0), Zener(1.0, 10.0, 1.0)),
    "halfspace": (LayeredHalfspace(math.inf, 0.5, 1.0), Zener(1.0, 10.0, 1.0)),
    "stiff base, compressible, two branches": (
        LayeredHalfspace(0.1, 0.4, 20.0, 0.3),
        Prony(1.0, ((4.0, 0.03), (5.0, 1.0))),
    ),
    "thin on a rigid base": (LayeredHalfspace(0.05, 0.3, math.inf), Zener(1.0, 3.0, 0.5)),
}


def closed_form(body, material, velocity):
    return float(AMPLITUDE**2 / 2 * Q * body.stiffness(Q, material.laplace(1j * Q * velocity)).imag)


def full_contact(name, velocity):
    """Pressed flat and moved until the slowest mode, below 11 tau, has decayed to exp(-27) = 2e-12."""
    body, material = BODIES[name]
    branches = [
        {"G": G, "tau": tau} for G, tau in zip(material.branch_moduli, material.branch_times, strict=True)
    ]
    return {
        "grid.points": 16, "layer.thickness": body.thickness, "layer.poisson": body.poisson,
        "layer.material": {"model": "prony", "G0": material.relaxed, "branches": branches},
        "halfspace": {"shear_modulus": body.bulk_modulus, "poisson": body.bulk_poisson},
        "punch": {"shape": "sinusoid", "amplitude": AMPLITUDE, "wavelength": 1.0},
        "trajectory": {"control": "load", "load": 1.0, "velocity": velocity},
        "time": {"end": 300.0, "step": 5.0}, "solver": SOLVER,
    }  # fmt: skip


@pytest.mark.parametrize("name", BODIES)
def test_friction_in_full_contact_is_the_closed_form_over_six_decades_of_speed(run, name):
    for velocity in 10.0 ** np.arange(-3, 4):
        recording = run(full_contact(name, velocity))
        expected = closed_form(*BODIES[name], velocity)
        assert recording["contact_area"][-1] == 1
        assert recording["tangential_force"][-1] == pytest.approx(expected, rel=1e-6)
        assert recording["friction"][-1] == pytest.approx(expected / 1.0, rel=1e-6)
        power = np.diff(recording["dissipated"])[-1] / np.diff(recording["time"])[-1]
        assert power == pytest.approx(velocity * expected, rel=1e-6)  # what is asked is 1e-3


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("default layer", {"grid.points": [12, 9], "grid.period": 1.0}),  # a wave along x and one along y
        ("default layer", {"grid.points": [9, 12], "grid.period": 1.0}),
        ("thin on a rigid base", {"trajectory": {"depth": 0.01, "velocity": 0.3}}),
    ],
)
def test_a_wave_across_the_motion_and_a_given_depth_change_no_friction(run, name, more):
    recording = run(full_contact(name, 0.3) | more)
    assert recording["contact_area"][-1] == 1
    assert recording["tangential_force"][-1] == pytest.approx(closed_form(*BODIES[name], 0.3), rel=1e-6)


def test_friction_peaks_where_a_wave_passes_in_a_relaxation_time_and_vanishes_far_from_there(run):
    # On a Zener halfspace Im K = 2 q (Ginf - G0) w/(1 + w^2), w = q v tau: symmetric in log v about w = 1.
    speeds = np.array([1e-6, 1 / 1.1, 1.0, 1.1, 1e6]) / Q
    slow, below, peak, above, fast = (
        run(full_contact("halfspace", v))["tangential_force"][-1] for v in speeds
    )
    assert peak > below == pytest.approx(above, rel=1e-6)
    assert peak == pytest.approx(AMPLITUDE**2 / 2 * Q * 2 * Q * 9 / 2, rel=1e-6)
    # 2 w and 2/w of the peak, with w^2 = 1e-12 beside it; the modes round at the scale of Ginf, 1e-16/1e-6.
    assert slow / peak == pytest.approx(2e-6, rel=1e-5)
    assert fast / peak == pytest.approx(2e-6, rel=1e-5)


# --- partial contact ---


@pytest.mark.parametrize("velocity", [0.003, pytest.param(0.01, marks=pytest.mark.slow), 0.1, 1.0])
@pytest.mark.parametrize("control", ["depth", "load"])
def test_a_parabola_meets_the_direct_solution_of_the_steady_state(script, velocity, control):
    depth = 0.01
    if control == "load":  # prescribe what another speed found, and compare at the depth that it leads to
        load = script.direct(128, velocity, depth)["mean"]
        found = script.stepped(128, velocity, "load", load)
        assert found.last("depth") == pytest.approx(depth, rel=1e-6)
    else:
        found = script.stepped(128, velocity, "depth", depth)
    answer = script.direct(128, velocity, depth)
    # The run stops when nothing changes by more than 1e-8 over the slowest relaxation time.
    assert found.noted["settled"] == 1
    pressure = found.fields["pressure"][-1]
    assert np.abs(pressure - answer["pressure"]).max() < 1e-6 * answer["pressure"].max()
    np.testing.assert_array_equal(pressure > 0, answer["pressure"] > 0)
    assert found.last("tangential_force") == pytest.approx(answer["force"], rel=1e-6)
    assert found.last("friction") == pytest.approx(answer["force"] / answer["mean"], rel=1e-6)
    assert found.last("contact_centre") > 0  # the leading side carries more


PARABOLA = {
    "grid.points": 256,
    "layer.thickness": 0.1,
    "time": {"end": 3.0, "step": 0.05},
    "solver": {"method": "active_set", "tolerance": 1e-9},
}


def moving(velocity, control="depth"):
    amount = {"depth": 0.01, "load": 0.05}[control]
    return PARABOLA | {"trajectory": {"control": control, control: amount, "velocity": velocity}}


@pytest.mark.parametrize("time", [{"step": 0.05}, {"step": "adaptive"}])
@pytest.mark.parametrize("control", ["depth", "load"])
def test_a_velocity_of_zero_is_a_punch_that_stays(run, control, time):
    case = moving(0.0, control) | {"time": {"end": 3.0} | time}
    slides = run(case)
    trajectory = {key: value for key, value in case["trajectory"].items() if key != "velocity"}
    stays = run(case | {"trajectory": trajectory})
    assert "friction" not in stays.rows[0]
    # The solver's tolerance of the largest pressure, below 0.6, along slopes below 0.2.
    assert np.abs(slides["tangential_force"]).max() < 1e-9 * 0.6 * 0.2
    assert slides["position"].max() == 0
    for column in ("mean_pressure", "depth", "stored", "dissipated", "contact_area"):
        scale = np.abs(stays[column]).max()
        np.testing.assert_allclose(slides[column], stays[column], rtol=0, atol=1e-7 * scale)


@pytest.mark.parametrize("control", ["depth", "load"])
def test_the_other_way_is_the_mirror_image(run, control):
    snapshots = {"output.snapshots": [3.0]}
    forth, back = run(moving(0.2, control) | snapshots), run(moving(-0.2, control) | snapshots)
    for column, sign in (("tangential_force", -1), ("contact_centre", -1), ("mean_pressure", 1), ("work", 1)):
        scale = np.nanmax(np.abs(forth[column]))
        np.testing.assert_allclose(back[column], sign * forth[column], rtol=0, atol=1e-7 * scale)
    _, _, p = forth.snapshots[-1]
    _, _, mirrored = back.snapshots[-1]
    np.testing.assert_allclose(mirrored[1:], p[:0:-1], rtol=0, atol=1e-7 * p.max())


VARIED = "time velocity\n0 0\n1 0.3\n2 0.3\n3 -0.2\n"


@pytest.mark.parametrize("control", ["depth", "load"])
def test_changing_velocities_are_followed_to_second_order(run, tmp_path, control):
    (tmp_path / "velocity.txt").write_text(VARIED)
    case = moving(0.0, control)
    case["trajectory"] = {key: value for key, value in case["trajectory"].items() if key != "velocity"} | {
        "velocity_file": str(tmp_path / "velocity.txt")
    }
    at, steps = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0], [0.1, 0.05, 0.025]
    reference = run(case | {"time": {"end": 3.0, "step": 0.00625}})  # off by 1/16 of the finest below
    largest = np.abs(reference["tangential_force"]).max()
    runs = [run(case | {"time": {"end": 3.0, "step": step}}) for step in steps]
    exact = reference.at("tangential_force", at)
    errors = [float(np.abs(r.at("tangential_force", at) - exact).max()) / largest for r in runs]
    # At least: the history is of third order, and contact grows by whole grid points.
    assert order(errors, steps) > 1.7
    assert errors[-1] < 1e-3
    imbalances = [np.abs(r["energy_residual"]).max() / r["work"].max() for r in runs]
    assert order(imbalances, steps) > 1.7
    np.testing.assert_allclose(
        reference.at("position", at), [0.0375, 0.15, 0.3, 0.45, 0.5375, 0.5], atol=1e-12
    )
    # Adaptive steps hold their tolerance in pressure and depth, and friction, a small part of the pressure,
    # to ten times as much.
    adaptive = run(case | {"time": {"end": 3.0, "step": "adaptive", "tolerance": 1e-4}, "output.times": at})
    assert np.abs(adaptive.at("tangential_force", at) - exact).max() < 1e-3 * largest
    found = {"depth": "mean_pressure", "load": "depth"}[control]
    difference = adaptive.at(found, at) - reference.at(found, at)
    assert np.abs(difference).max() < 1e-4 * np.abs(reference[found]).max()


def test_an_elastic_body_resists_no_motion(run):
    recording = run(moving(0.5) | {"layer.material": {"Ginf": 1.0}, "output.snapshots": [3.0]})
    assert np.abs(recording["tangential_force"]).max() < 1e-12
    assert recording["dissipated"].max() == 0
    assert recording["position"][-1] == pytest.approx(1.5, rel=1e-12)


@pytest.mark.parametrize("method", ["fire", "conjugate_gradient"])
def test_every_solver_follows_the_punch(run, method):
    # Ginf/G0 = 1000 at the speed of most friction: pressure runs far ahead of displacement, tan delta = 16.
    case = moving(0.01) | {"layer": {"thickness": math.inf, "material": {"Ginf": 1000.0}}}
    case |= {"time": {"end": 100.0, "step": 10.0}, "trajectory": {"depth": 0.005, "velocity": 0.005}}
    ways = [run(case | {"solver": {"method": m, "tolerance": 1e-8}}) for m in ("active_set", method)]
    for column in ("tangential_force", "mean_pressure"):
        one, other = (way[column] for way in ways)
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-6 * np.abs(one).max())


def test_a_surface_that_is_constant_along_y_is_a_line(run, tmp_path):
    heights = np.abs((np.arange(32) / 32 - 0.5) ** 2 * 2)
    np.save(tmp_path / "line.npy", heights)
    np.save(tmp_path / "plane.npy", np.repeat(heights[:, np.newaxis], 8, axis=1))
    case = moving(0.3) | {
        "time": {"end": 2.0, "step": 0.1},
        "solver": {"method": "active_set", "tolerance": 1e-12},
    }
    line = run(case | {"grid.points": 32, "punch": {"shape": "profile", "file": str(tmp_path / "line.npy")}})
    plane = run(
        case | {"grid.points": [32, 8], "punch": {"shape": "profile", "file": str(tmp_path / "plane.npy")}}
    )
    for column in ("tangential_force", "mean_pressure", "dissipated", "contact_centre"):
        scale = np.nanmax(np.abs(line[column]))
        np.testing.assert_allclose(plane[column], line[column], rtol=0, atol=1e-10 * scale)


# --- a run to the steady state ---


def test_a_run_ends_when_it_is_steady_and_tells_when(run):
    case = moving(0.3) | {"time": {"end": 500.0, "step": 0.1, "steady": 1e-3}}
    recording = run(case)
    end = recording.noted["steady_time"]
    assert recording.noted["settled"] == 1
    assert recording["time"][-1] == end < 500
    assert recording.snapshots[-1][0] == end
    # Over the window the slowest mode decays by 1/e at least: what is left is below 0.6 of that change.
    longer = run(case | {"time": {"end": 2 * end, "step": 0.1}})
    for column in ("friction", "mean_pressure"):
        assert recording[column][-1] == pytest.approx(longer[column][-1], rel=1e-3)


def test_a_run_that_does_not_get_there_tells(run):
    recording = run(moving(0.3) | {"time": {"end": 3.0, "step": 0.1, "steady": 1e-6}})
    assert recording.noted["settled"] == 0
    assert "steady_time" not in recording.noted
    assert recording["time"][-1] == pytest.approx(3.0)


def test_an_elastic_body_is_steady_after_one_passage(run):
    case = moving(0.5) | {"layer.material": {"Ginf": 1.0}}
    recording = run(case | {"time": {"end": 50.0, "step": 0.1, "steady": 1e-6}})
    assert recording.noted["steady_time"] == pytest.approx(1.0 + 1 / 0.5, abs=0.11)


# --- nothing changes over a whole window of time ---

CONFIG = Config(name="steady").with_values({"trajectory.velocity": 1.0, "time.steady": 1e-3})


def steady_time(friction, since=0.0):
    """Return the time at which a window of length 2 is steady, with steps of 0.25."""
    slow = SimpleNamespace(slowest=lambda _tolerance: 2.0)
    imposed = SimpleNamespace(breakpoints=(since,), reduced_time=None)
    case = SimpleNamespace(config=CONFIG, history=slow, drives=imposed)
    observable = SteadyState(case)
    for time in (0.25 * i for i in range(1000)):
        row = {"friction": friction(time)}
        step = SimpleNamespace(time=time, mean_pressure=1.0, depth=0.01, row=row)
        assert observable.measure(step) == {}
        if observable.finished:
            assert observable.attributes == {"settled": 1, "steady_time": time}
            assert observable.warning == ""
            return time
    assert observable.attributes == {"settled": 0}
    assert "NOT STEADY" in observable.warning
    return math.inf


@pytest.mark.parametrize(
    ("friction", "since", "expected"),
    [
        (lambda _: 0.1, 0.0, 2.0),
        (lambda _: 0.1, 3.1, 5.25),
        (lambda t: 0.1 * (1 + math.exp(-t)), 0.0, 10.0),  # exp(-8) = 3e-4 is left as the window begins
        (lambda t: 0.1 * (1 + 0.01 * math.sin(t)), 0.0, math.inf),
        (lambda t: math.nan if t < 7 else 0.1, 0.0, 9.0),
    ],
    ids=["constant", "after a breakpoint", "decaying", "oscillating", "without contact at first"],
)
def test_it_is_reached_after_a_window_without_change(friction, since, expected):
    assert steady_time(friction, since) == expected
