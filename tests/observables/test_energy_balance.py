"""Energy balance: work = stored + dissipated, and the signs and limits of each."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid

from gfmdlayer.case.case import Case
from gfmdlayer.config import Config
from gfmdlayer.history.adaptive_steps import AdaptiveSteps
from gfmdlayer.history.modes import SCHEMES, exponential
from gfmdlayer.interface.law import HARD_WALL
from gfmdlayer.observables.energy_balance import UNBALANCED, EnergyBalance
from gfmdlayer.step import Energy, Fields, Instant, Step
from tests.recordings import Kept

SHORT = {"time.end": 2.0, "solver.tolerance": 1e-8}
COMPRESSIBLE = {"layer.poisson": 0.3, "halfspace.shear_modulus": float("inf"), "grid.points": 512}
CYCLE = "time depth\n0 0\n1 0.01\n2 0.002\n3 0.01\n"


def order(errors, steps):
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def imbalance(recording):
    return float(np.abs(recording["energy_residual"]).max() / recording["work"].max())


@pytest.mark.parametrize(
    ("integrator", "expected", "largest"),
    # The bound on backward Euler: it loses w |du|^2/2 a step, which is a fraction dt/tau/2 of the heat.
    [("exponential", 2.0, 1e-4), ("backward_euler", 1.0, 5e-3)],
)
def test_the_balance_closes_with_the_order_of_the_integrator(run, integrator, expected, largest):
    steps = [0.02, 0.01, 0.005]
    errors = [imbalance(run(SHORT | {"time.integrator": integrator, "time.step": step})) for step in steps]
    assert order(errors, steps) == pytest.approx(expected, abs=0.25)  # contact grows by whole grid points
    assert errors[-1] <= largest


@pytest.mark.parametrize(
    "time", [{"step": 0.05}, {"step": 0.05, "integrator": "backward_euler"}, {"step": "adaptive"}]
)
@pytest.mark.parametrize("body", [{}, COMPRESSIBLE], ids=["default", "compressible"])
def test_heat_only_grows_and_no_spring_stores_less_than_nothing(run, tmp_path, time, body):
    (tmp_path / "cycle.txt").write_text(CYCLE)
    trajectory = {"kind": "table", "file": str(tmp_path / "cycle.txt")}
    times = {f"time.{key}": value for key, value in time.items()}
    found = run({"grid.points": 512, "time.end": 4.0, "trajectory": trajectory} | body | times)
    assert (np.diff(found["dissipated"]) >= 0).all()
    assert (found["stored"] >= 0).all()
    residual = found["work"] - found["stored"] - found["dissipated"]
    np.testing.assert_array_equal(found["energy_residual"], residual)
    assert imbalance(found) < 0.02  # backward Euler's, at this step


@pytest.mark.parametrize("Ginf", [1.0, 10.0])
def test_a_cycle_costs_work_unless_the_body_is_elastic(run, tmp_path, Ginf):
    (tmp_path / "cycle.txt").write_text("time depth\n0 0\n1 0.01\n1.4 0.006\n")
    recording = run({
        "grid.points": 1024, "time.end": 1.4, "time.step": 0.01, "solver.tolerance": 1e-8,
        "layer.material.Ginf": Ginf, "trajectory": {"kind": "table", "file": str(tmp_path / "cycle.txt")},
    })  # fmt: skip
    there, back = recording.at("work", [0.6, 1.4])  # at the same depth
    if Ginf == 1.0:
        # What is left is the quadrature of the work, of second order at least: (dt/ramp)^2 = 1e-4 at most.
        assert abs(back - there) < 1e-4 * there
        assert recording["dissipated"].max() == 0
    else:
        assert back - there > 0.1 * there


@pytest.mark.parametrize("points", [(256,), (255,), (24, 16), (21, 15)])
def test_the_stored_energy_is_that_of_the_pressure_on_the_surface(run, points, tmp_path):
    (tmp_path / "jump.txt").write_text("time depth\n0 0.004\n1 0.004\n")
    recording = run({
        "grid.points": points, "grid.period": 1.0, "time.end": 0.05,
        "trajectory": {"kind": "table", "file": str(tmp_path / "jump.txt")}, "output.snapshots": [0.0],
    })  # fmt: skip
    _, u, p = recording.snapshots[0]
    assert recording["stored"][0] == pytest.approx(-np.mean(u * p) / 2, rel=1e-9)
    assert recording["work"][0] == recording["stored"][0] > 0
    assert recording["dissipated"][0] == 0


@pytest.mark.parametrize("x", [1e-3, 0.05, 0.099, 0.101, 1.0, 8.0, 60.0])
@pytest.mark.parametrize("c", [0.0, 0.3])
def test_a_mode_moves_and_heats_as_its_equation_says(x, c):
    before, change = 0.7, -0.4

    def rate(s, state):  # in units of theta: u'' = 2 c/x^2
        return [change / x + c * (2 * s / x**2 - 1 / x) - state[0], state[0] ** 2]

    exact = solve_ivp(rate, (0, x), [before, 0.0], rtol=1e-11, atol=1e-14, method="LSODA").y[:, -1]
    f = exponential(np.array([x]))
    straight = f.decay * before + f.gain * change
    heat = f.loss * (before + f.lead * change) ** 2 + f.remainder * change**2
    heat += f.curvature_loss * c**2 - f.curvature_gain * c * (before + straight)
    np.testing.assert_allclose([(straight + f.curvature_gain * c).item(), heat.item()], exact, rtol=1e-8)


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=list(SCHEMES))
def test_the_factors_of_heat_cannot_be_negative(scheme):
    x = np.concatenate(([0.0], np.logspace(-12, 12, 400)))
    factors = scheme(x)
    assert (factors.loss >= 0).all()
    assert (factors.remainder >= 0).all()
    assert all(np.isfinite(factor).all() for factor in factors)


def test_the_work_is_the_area_under_the_curve_of_pressure_and_depth():
    balance, energy = EnergyBalance(Case(Config(name="x"))), Energy(stored=2.0, dissipated=0.5)

    def work_at(time, depth):  # under a flat punch, which has no gap
        known = {"instant": Instant(time, 0.0), "mean_pressure": depth**2, "depth": depth, "margin": 1.0}
        rest = dict.fromkeys(("response", "mean_gap", "contact_area", "residual"), 0.0)
        step = Step(
            **known,
            **rest,
            prescribed=depth,
            pairs=0,
            iterations=0,
            interface=HARD_WALL,
            fields=Fields(),
            solution=None,
            energy=energy,
            swept=(0.0, 0.0),
        )
        return balance.measure(step)["work"]

    assert work_at(0.0, 0.1) == 2.5  # stored and dissipated, on any path to this depth
    depths = [0.3, 0.45, 0.8, 0.8]
    work = [work_at(depth - 0.1, depth) for depth in depths[:3]]
    work.append(work_at(1.0, depths[3]))
    # Parabolas in time, from the third point on.
    assert work[1] - work[0] == pytest.approx((0.45**3 - 0.3**3) / 3, rel=1e-12)
    assert work[2] - work[1] == pytest.approx((0.8**3 - 0.45**3) / 3, rel=1e-12)
    assert work[3] == work[2]


# Cases of everyday kind in m, Pa and s: half of the ramp is shorter than thirty tolerances times tau.
SI = {
    "units": {"length": "m", "stress": "Pa", "time": "s"},
    "grid": {"points": [32, 32], "period": [1e-2, 1e-2]},
    "halfspace.shear_modulus": float("inf"),
    "punch": {"shape": "sphere", "radius": 1e-2},
    "time": {"end": 1.0, "step": "adaptive"},
}


def in_si(tau, **trajectory):
    zener = {"model": "zener", "G0": 1e6, "Ginf": 1e7, "tau": tau}
    layer = {"thickness": 2e-3, "poisson": 0.49, "material": zener}
    return SI | {"layer": layer, "trajectory": trajectory}


EVERYDAY = {
    "fast ramp": in_si(10.0, depth=2e-4, ramp_time=0.01),
    "slow ramp": in_si(0.1, depth=2e-4, ramp_time=0.1),
    "force": in_si(10.0, control="force", force=50.0, ramp_time=0.5),
    "elastic": {
        "grid.points": [32, 32],
        "layer": {"thickness": 0.1, "poisson": 0.45, "material": {"model": "elastic", "G": 2.0}},
        "trajectory": {"control": "load", "load": 0.02, "ramp_time": 0.5},
        "punch": {"shape": "parabola", "radius": 1.0},
        "time": {"end": 2.0, "step": "adaptive"},
    },
}


@pytest.mark.parametrize("case", EVERYDAY)
def test_adaptive_steps_close_the_balance_and_draw_the_ramp(run, case):
    of_case = EVERYDAY[case]
    control = of_case["trajectory"].get("control", "depth")
    asked = "mean_pressure" if control == "depth" else "depth"
    coarse, fine = (run(of_case | {"time.tolerance": tolerance}) for tolerance in (1e-3, 1e-4))
    largest = fine["work"].max()
    assert abs(coarse["work"][-1] - fine["work"][-1]) < 3e-3 * largest
    for recording, tolerance in ((coarse, 1e-3), (fine, 1e-4)):
        assert np.abs(recording["energy_residual"]).max() < 3 * tolerance * largest
    times = np.linspace(0, of_case["trajectory"]["ramp_time"], 301)
    drawn, exact = (np.interp(times, each["time"], each[asked]) for each in (coarse, fine))
    # A hundredth between the rows. In the first step of a thin layer d ~ F^(1/2), which deviates from its
    # chord by 1/4 of it in place of 4/27.
    assert np.abs(drawn - exact).max() < 1.8e-2 * exact.max()


ATTRACTED = {
    "grid.points": 48,
    "layer": {"thickness": 0.3, "poisson": 0.3},
    "halfspace.shear_modulus": math.inf,
    "punch": {"shape": "parabola", "radius": 0.5},
    "interface": {"law": "exponential", "work": 1e-4, "range": 0.01},
}
LIFTED = {
    "kind": "approach_retract", "control": "load", "load": 0.01, "final": 0.0, "cycles": 2,
    "approach_speed": 0.02, "retract_speed": 0.02,
}  # fmt: skip


def test_adaptive_steps_close_the_balance_beside_attraction(run):
    # The curve of load over depth has a corner at each point of this grid; pressures over displacements none.
    found = run(ATTRACTED | {"trajectory": LIFTED, "time": {"step": "adaptive", "tolerance": 1e-4}})
    assert np.abs(found["energy_residual"]).max() < 1e-4 * np.abs(found["work"]).max()


ELASTIC = {"layer": {"thickness": 0.3, "poisson": 0.3, "material": {"model": "elastic"}}, "grid.points": 128}


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
@pytest.mark.parametrize("base", [0.0, 1.0, math.inf])
def test_the_balance_bounds_the_steps_of_a_layer_that_an_attraction_bends(base, tolerance):
    """A free layer's mean stress is small beside its stresses: by these alone 3 % of the work was missing.

    The warning begins at three tolerances, and ten of the solver's; a fourth is for errors of one sign.
    """
    branches = [{"G": 10 * t**-0.5, "tau": t} for t in 10.0 ** np.arange(-3, 3)]
    config = Config(
        name="plate",
        grid={"points": 128},
        layer={
            "thickness": 0.05, "poisson": 0.45,
            "material": {"model": "prony", "G0": 1.0, "branches": branches},
        },
        halfspace={"shear_modulus": base},
        punch={"shape": "parabola", "radius": 0.5},
        interface={"law": "exponential", "work": 1e-4, "range": 2e-3},
        trajectory={"kind": "approach_retract", "depth": 0.01, "approach_speed": 0.02},
        time={"step": "adaptive", "tolerance": tolerance, "end": 2.0},
    )  # fmt: skip
    recording = Kept()
    case = Case(config)
    case.run(recording)
    energies = np.maximum(np.abs(recording["work"]), recording["stored"] + recording["dissipated"])
    assert np.abs(recording["energy_residual"]).max() < 4 * (tolerance + 1e-5) * energies.max()
    assert recording["work"].size < 200


@pytest.mark.parametrize("source", ["the punch", "a voltage"])
def test_attraction_and_voltage_do_their_work_in_steps_of_any_length(run, tmp_path, source):
    """The work is that under the curve of pressure over depth, or of charge over voltage, of short steps."""
    (tmp_path / "volts.txt").write_text("0 0\n1 1\n")
    (tmp_path / "rest.txt").write_text("0 -0.002\n1 -0.002\n")
    law = {
        "law": "electrostatic",
        "insulation": 0.02,
        "permittivity": 2e-4,
        "voltage": f"{tmp_path}/volts.txt",
    }
    ramp = {"kind": "approach_retract", "start": -0.01, "depth": 0.01, "approach_speed": 0.02, "final": -0.01}
    if source == "the punch":
        changed = {"trajectory": ramp}
    else:
        changed = {"interface": law, "trajectory": {"kind": "table", "file": f"{tmp_path}/rest.txt"}}
    steps = 0.2, 0.02, 0.01
    long, short, shortest = (
        run(ATTRACTED | ELASTIC | changed | {"time": {"end": 1.0, "step": step}}) for step in steps
    )
    assert np.abs(long["lost"]).max() == 0

    def area(found):
        if source == "the punch":
            return trapezoid(found["mean_stress"], found["depth"])
        volts = found["time"]  # the energy of the interface is -C V^2/2: a charge C V comes from the source
        return trapezoid(2 * found["interface_energy"] / np.maximum(volts, 1e-9), volts)

    known = area(shortest)
    # A third of the change of the area with the step is the error of the trapezoids; the solver leaves 1e-6.
    off = abs(known - area(short)) + 1e-5 * abs(known)
    assert long["work"][-1] - long["work"][0] == pytest.approx(known, abs=off)
    assert abs(area(long) - known) > 5 * off
    assert np.abs(long["energy_residual"]).max() < 1e-5 * np.abs(long["work"]).max()


def test_an_elastic_body_does_the_work_that_it_stores(run):
    found = run(EVERYDAY["elastic"] | {"time.tolerance": 1e-4})
    half = run(EVERYDAY["elastic"] | {"time.end": 0.25, "time.step": 0.25})["depth"][-1]
    # The path of the contact does not matter; the solver leaves its tolerance.
    assert np.abs(found["energy_residual"]).max() < 1e-5 * found["stored"][-1]
    assert found["stored"][-1] == pytest.approx(1.28511e-4, rel=1e-5)
    drawn, largest = np.interp(0.25, found["time"], found["depth"]), found["depth"].max()
    assert drawn == pytest.approx(half, abs=1e-2 * largest)
    assert half - largest / 2 > 0.1 * largest  # where a straight line would be


@pytest.mark.parametrize("integrator", ["exponential", "backward_euler"])
def test_an_open_balance_is_a_warning_with_the_step_that_closes_it(integrator):
    def warnings_with(step):
        config = Config(
            name="open", grid={"points": 256}, layer={"thickness": math.inf},
            time={"end": 3.0, "integrator": integrator, "step": step},
        )  # fmt: skip
        return [line for line in Case(config).run(Kept()) if line.startswith(UNBALANCED)]

    (warning,) = warnings_with(0.5)
    step = float(warning.rpartition("time.step ")[2])
    assert 0.01 < step < 0.5  # 0.04 would just do: half of it for safety, and the next whole part of 0.5
    assert warnings_with(step) == []


def test_steps_that_miss_an_oscillation_are_told_one_that_draws_it():
    """At two steps in a period another motion is seen, whose error says nothing about shorter steps."""

    def warnings_with(step):
        swing = {"kind": "oscillation", "displacement": 4e-3, "start": 0.5, "period": 0.5}
        config = Config(
            name="swing", grid={"points": 64}, layer={"thickness": 0.3, "poisson": 0.45},
            halfspace={"shear_modulus": 0.5, "poisson": 0.3}, punch={"shape": "parabola", "radius": 1.0},
            interface=[{"law": "coulomb", "coefficient": 0.4}, {"law": "shear_strength", "stress": 0.3}],
            trajectory={"depth": 0.01, "ramp_time": 0.5, "tangential": swing},
            time={"end": 2.0, "step": step, "integrator": "backward_euler"},
        )  # fmt: skip
        return [line for line in Case(config).run(Kept()) if line.startswith(UNBALANCED)]

    (warning,) = warnings_with(0.25)
    step = float(warning.rpartition("time.step ")[2])
    assert step <= 0.5 / 40
    assert warnings_with(step) == []


# Relaxation times far below the steps, in which a single point of the grid is pressed: u(t) is straight.
FAST_RELAXATION = {
    "grid.points": [24, 24],
    "layer": {
        "thickness": 0.05, "poisson": 0.5,
        "material": {"model": "fractional_zener", "G0": 1.0, "Ginf": 82.0, "tau": 1.0, "exponent": 0.68},
    },
    "halfspace.shear_modulus": math.inf,
    "punch.radius": 0.25,
    "trajectory": {"depth": 3.6e-3, "ramp_time": 0.063},
    "time": {"end": 1.0, "step": "adaptive", "tolerance": 1e-5},
}  # fmt: skip


def test_the_tolerance_that_closes_the_balance_is_named(monkeypatch):
    # Steps that look at the balance are shorter; here they do not.
    config, looked, blind = Config(name="x").with_values(FAST_RELAXATION), Kept(), Kept()
    Case(config).run(looked)
    monkeypatch.setattr(AdaptiveSteps, "weigh", lambda *_: None)
    case = Case(config)
    case.stepwise = True
    (warning,) = (line for line in case.run(blind) if line.startswith(UNBALANCED))
    assert imbalance(looked) < imbalance(blind) / 2
    assert warning.startswith(f"{UNBALANCED}: the energies miss ")
    assert 0 < float(warning.rpartition("time.tolerance ")[2]) < 1e-5


@pytest.mark.parametrize("points", [64, 256, 1024])
def test_the_balance_follows_the_tolerance_on_any_grid(run, points):
    # At each grid point that comes into contact the curve of pressure over depth has a corner: with 256 and
    # 1024 points it left 9e-5 and 1.7e-5 open.
    rigid = {"grid.points": points, "halfspace.shear_modulus": math.inf, "time.end": 2.0}
    for tolerance in (1e-3, 1e-4, 1e-5):
        found = run(rigid | {"time.step": "adaptive", "time.tolerance": tolerance})
        assert imbalance(found) < 3 * tolerance
