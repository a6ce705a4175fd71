"""Layers with different shifts: against shifted times, reduced time, and direct integration."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gfmdlayer import Config
from gfmdlayer.body.layer import Layer
from gfmdlayer.body.layers import LayerStack, halfspace
from gfmdlayer.body.materials import Prony
from gfmdlayer.body.shifts import WLF, Arrhenius
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.modes import SCHEMES, Modes
from gfmdlayer.history.reduced_time import ReducedTime
from gfmdlayer.history.stack_modes import EXPONENTIAL, StackModes
from gfmdlayer.time_functions import Constant, Table
from tests.recordings import Kept

SHIFTS = (
    WLF(C1=17.44, C2=51.6, reference=20.0),
    Arrhenius(activation_energy=8e4, reference=20.0),
    Arrhenius(activation_energy=2e5, reference=25.0),
)
LAYERS = (
    Layer(0.05, 0.4, Prony(5.0, [(20.0, 0.1), (5.0, 1.0)])),
    Layer(0.2, 0.5, Prony(1.0, [(3.0, 0.02), (4.0, 0.5)])),
    Layer(math.inf, 0.3, Prony(20.0, [(30.0, 2.0)])),
)
STACK = LayerStack(LAYERS)
RIGID = LayerStack((LAYERS[0], Layer(0.2, 0.3, LAYERS[1].material)), rigid=True)
Q = np.array([0.0, 0.3, 4.0, 4.0, 20.0, 1e3])
SUMS = Sums(np.ones(Q.size))


def shifted(stack, factors):
    """Multiply the times of each layer by its factor."""
    return LayerStack(
        tuple(
            Layer(
                each.thickness,
                each.poisson,
                Prony(each.material.relaxed, [(G, a * t) for G, t in each.material.maxwell_branches]),
            )
            for each, a in zip(stack.layers, factors, strict=False)
        ),
        rigid=stack.rigid,
    )


def stack_modes(stack, times, scheme, q=Q):
    internal = stack.internal_variables(q)
    return StackModes(internal, SCHEMES[scheme], Sums(np.ones(q.size)), reduced_times=times)


def reduced_times(temperature, stack=STACK):
    return [ReducedTime(shift, temperature) for shift in SHIFTS[: len(stack.layers)]]


def assert_same_history(found, expected, steps, stack=STACK):
    """Advance both with the same random displacements, over the steps of each."""
    rng = np.random.default_rng(1)
    scale = stack.stiffness(Q, 1e9).real + 1.0
    for step, other in steps:
        u = rng.random(Q.size) + 1j * rng.random(Q.size)
        for one, two in zip(found.terms(step), expected.terms(other), strict=True):
            np.testing.assert_allclose(one / scale, two / scale, rtol=0, atol=1e-10)
        found.advance(u)
        expected.advance(u.copy())
        assert found.stored == pytest.approx(expected.stored, rel=1e-10)
        assert found.dissipated == pytest.approx(expected.dissipated, rel=1e-10)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("stack", [STACK, RIGID], ids=["halfspace", "rigid"])
def test_constant_temperature_gives_the_stack_of_shifted_times(stack, scheme):
    found = stack_modes(stack, reduced_times(Constant(26.0), stack), scheme)
    factors = tuple(shift.factor(26.0) for shift in SHIFTS)
    expected = Modes(shifted(stack, factors).spectrum(Q), SCHEMES[scheme], SUMS)
    assert_same_history(found, expected, [(dt, dt) for dt in (0.0, 0.1, 0.1, 3.0, 1e-4, 100.0)], stack)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_equal_shifts_give_the_modes_in_reduced_time(scheme):
    reduced = ReducedTime(SHIFTS[0], Table(np.array([0.0, 1.0, 2.0]), np.array([15.0, 30.0, 22.0])))
    found = stack_modes(STACK, [reduced] * 3, scheme)
    times = np.array([0.0, 0.0, 0.2, 0.7, 1.0, 1.4, 3.0])
    steps = [(b - a, reduced.step(a, b - a)) for a, b in itertools.pairwise(times)]
    assert_same_history(found, Modes(STACK.spectrum(Q), SCHEMES[scheme], SUMS), steps)


def test_the_poles_give_the_exponential_step_of_a_mode_for_any_length():
    """The bound is the largest error over all x, 3e-12; that heat is not negative is checked at each x."""
    rule, x = EXPONENTIAL, np.append(0.0, np.logspace(-9, 9, 4001))
    gain = (rule.residues / (x[:, np.newaxis] + rule.poles)).real.sum(axis=1)
    exact = np.append(1.0, -np.expm1(-x[1:]) / x[1:])
    assert np.abs(gain - exact).max() < 3e-12
    assert np.abs(1 - x * gain - np.exp(-x)).max() < 3e-12
    for power, expected in enumerate((1.0, 1.0, 0.5)):
        assert (rule.residues / rule.poles**power).real.sum() == pytest.approx(expected, abs=1e-14)
    remaining = (1 - gain[1:]) / x[1:]
    assert (remaining * (2 - x * gain)[1:] > gain[1:] ** 2 * (1 - 1e-9))[x[1:] > 1e-3].all()


def test_a_jump_of_temperature_within_a_step_costs_no_energy_and_gives_off_heat():
    """20 degrees within a thousandth of the step, over times of six decades; displacements at random."""
    law = Prony(1.0, [(1.0, 10.0**k) for k in range(-3, 3)])
    stack = LayerStack(tuple(Layer(d, 0.4, law) for d in (0.02, 0.1, math.inf)))
    jump = Table(np.array([0.0, 0.5, 0.501, 3.0]), np.array([15.0, 15.0, 35.0, 35.0]))
    q, rng = np.array([0.5, 5.0, 50.0]), np.random.default_rng(3)
    found = StackModes(
        stack.internal_variables(q),
        SCHEMES["exponential"],
        Sums(np.ones(q.size)),
        reduced_times=reduced_times(jump),
    )
    for step in (0.0, 0.2, 1.0, 1.0, 0.5):
        u, heat = rng.random(q.size) + 1j * rng.random(q.size), found.dissipated
        kappa, _ = found.terms(step)
        assert (kappa > stack.stiffness(q, 0.0).real).all()
        found.advance(u)
        assert found.dissipated >= heat
    work = found.stored + found.dissipated
    for _ in range(40):  # at rest the body relaxes, and no work is done
        kappa, b = found.terms(1e3)
        found.advance(u)
    assert found.stored + found.dissipated == pytest.approx(work, rel=1e-12)
    np.testing.assert_allclose(kappa * u - b, stack.stiffness(q, 0.0).real * u, rtol=1e-9)
    assert found.stored == pytest.approx((stack.stiffness(q, 0.0).real * np.abs(u) ** 2).sum() / 2, rel=1e-9)


HEATING = Table(np.array([0.0, 1.0, 2.0]), np.array([15.0, 30.0, 22.0]))


def displacement(t):
    return math.sin(2 * t) + t


def direct(q, end):
    """Stress, stored energy and heat at the end by integration of the equations of the internal variables."""
    network = STACK.network(np.array([q]))
    g, B, free = network.force[0], network.coupling[0], float(network.free[0])
    top = LAYERS[0].material
    moduli, times = top.branch_moduli, top.branch_times
    system, m = np.eye(network.times.size) + B.T @ B, network.times.size

    def rates(t, y):
        a = np.array([shift.factor(HEATING(t)) for shift in SHIFTS])
        u, du = displacement(t), 2 * math.cos(2 * t) + 1
        theta = network.times * a[network.layer]
        xi_rate = (B.T @ g * u - system @ y[:m]) / theta
        stretch, own = y[m:-1], times * a[0]
        heat = theta @ xi_rate**2 + free * (moduli / own) @ stretch**2
        return np.concatenate((xi_rate, du - stretch / own, [heat]))

    y, u = np.zeros(m + times.size + 1), displacement(end)
    for part in ((0.0, 1.0), (1.0, end)):  # up to the breakpoint of the temperature, and from there
        y = solve_ivp(rates, part, y, method="LSODA", rtol=1e-9, atol=1e-11).y[:, -1]
    elongation, stretch = g * u - B @ y[:m], y[m:-1]
    stress = free * (top.relaxed * u + moduli @ stretch) + g @ elongation
    springs = free * (top.relaxed * u**2 + moduli @ stretch**2)
    return stress, (springs + elongation @ elongation + y[:m] @ y[:m]) / 2, float(y[-1])


def by_steps(q, end, dt):
    modes = stack_modes(STACK, reduced_times(HEATING), "exponential", np.array([q]))
    for k in range(round(end / dt)):
        kappa, b = modes.terms(dt)
        modes.advance(np.array([displacement((k + 1) * dt) + 0j]))
    return float((kappa * modes.u - b).real[0]), modes.stored, modes.dissipated


def test_stress_and_energies_converge_to_direct_integration_with_second_order():
    """Errors at dt/2 are a quarter: between 1/3 and 1/5 where the next order is a tenth of the second."""
    exact = np.array(direct(10.0, 1.5))
    coarse, fine, finest = (np.array(by_steps(10.0, 1.5, dt)) / exact - 1 for dt in (0.05, 0.025, 0.0125))
    assert (np.abs(finest) < 1e-3).all()
    for one, other in ((coarse, fine), (fine, finest)):
        assert (np.abs(other) < np.abs(one) / 3).all()
        assert (np.abs(other) > np.abs(one) / 5).all()


BODY = {
    "layers": [
        {
            "thickness": each.thickness,
            "poisson": each.poisson,
            "material": {
                "model": "prony",
                "G0": each.material.relaxed,
                "branches": [{"G": G, "tau": tau} for G, tau in each.material.maxwell_branches],
                "shift": shift.model_dump(),
            },
        }
        for each, shift in zip(LAYERS[:2], SHIFTS, strict=False)
    ],
    "halfspace": {"poisson": 0.3, "shear_modulus": 20.0},
}


FLAT = {"punch": {"shape": "flat", "width": 0.25, "edge_radius": 1e-6}}


@pytest.fixture
def heated(tmp_path):
    """A rise of the temperature by 12 degrees, while the punch is pressed in and after it."""
    (tmp_path / "rise.txt").write_text("0 18\n0.5 18\n1.5 30\n4 30\n")
    return {
        "grid.points": 64, "trajectory": {"depth": 0.01, "ramp_time": 1.0},
        "temperature": {"file": str(tmp_path / "rise.txt")}, "solver.tolerance": 1e-10, **BODY,
    }  # fmt: skip


def run(values, time):
    """Run a case with all modes of its stack."""
    found, config = Kept(), Config(name="a").with_values(values | {"time": {"end": 2.5} | time})
    body = Case(config).body
    assert isinstance(body, LayerStack)
    simulate(Case(config, body=LayerStack(body.layers, rigid=body.rigid)), found)
    return found


def test_runs_under_a_ramp_of_temperature_are_of_second_order_and_balance(heated):
    """Under a flat punch, whose contact does not change; the bounds are those of the order, 1/4, as above."""
    times, steps = np.arange(1, 26) * 0.1, (0.1, 0.05, 0.025)
    flat = heated | FLAT
    fine = run(flat, {"step": 0.1 / 16}).at("mean_pressure", times)
    runs = [run(flat, {"step": step}) for step in steps]
    errors = [np.abs(each.at("mean_pressure", times) - fine).max() / fine.max() for each in runs]
    residuals = [np.abs(each["energy_residual"]).max() / each["work"].max() for each in runs]
    for each in (errors, residuals):
        assert each[2] < 1e-3
        assert each[1] < each[0] / 3
        assert each[2] < each[1] / 3


def test_adaptive_steps_meet_the_tolerance_in_a_ramp_of_temperature(heated):
    times = np.arange(1, 26) * 0.1
    landing = heated | {"output": {"times": times.tolist()}}
    exact = run(landing, {"step": "adaptive", "tolerance": 1e-5}).at("mean_pressure", times)
    for tolerance in (1e-3, 1e-4):
        found = run(landing, {"step": "adaptive", "tolerance": tolerance})
        assert np.abs(found.at("mean_pressure", times) - exact).max() < tolerance * exact.max()


def test_a_body_of_one_reduced_time_is_refused_where_shifts_differ(heated):
    config = Config(name="a").with_values(heated | {"time.end": 2.5})
    with pytest.raises(TypeError, match="a ViscoelasticLayer of 1 materials; must have the 2 of the"):
        Case(config, body=halfspace(1.0)).contact.history  # noqa: B018


def test_two_equal_bodies_with_layers_of_different_shifts_deform_like_one_of_half_the_moduli(heated):
    def halved(layer):
        law = layer["material"]
        branches = [{**each, "G": each["G"] / 2} for each in law["branches"]]
        return {**layer, "material": {**law, "G0": law["G0"] / 2, "branches": branches}}

    one = {
        "layers": [halved(each) for each in BODY["layers"]],
        "halfspace": {"poisson": 0.3, "shear_modulus": 10.0},
    }
    for time in ({"step": 0.25}, {"step": "adaptive", "tolerance": 1e-3}):
        pair, single, config = Kept(), Kept(), Config(name="a")
        simulate(config.with_values(heated | {"counterbody": BODY, "time": {"end": 2.5} | time}), pair)
        simulate(config.with_values(heated | one | {"time": {"end": 2.5} | time}), single)
        np.testing.assert_allclose(pair["time"], single["time"], rtol=1e-9)
        for column in ("stored", "dissipated"):
            np.testing.assert_allclose(pair[column], single[column], rtol=1e-5, atol=1e-12)


def test_a_counterbody_that_does_not_relax_needs_no_shift(heated):
    """The balance of energy closes in second order."""
    left = []
    for step in (0.125, 0.0625):
        found = Kept()
        beside = {"counterbody": {"halfspace": {"shear_modulus": 3.0}}, "time": {"end": 2.5, "step": step}}
        simulate(Config(name="a").with_values(heated | FLAT | beside), found)
        left.append(np.abs(found["energy_residual"]).max() / found["work"].max())
    assert left[0] < 0.01
    assert left[1] < left[0] / 3


def test_an_elastic_skin_needs_no_shift(heated):
    """Two relaxing layers of different shifts below it, at constant temperature, against shifted times."""
    factors = [shift.factor(26.0) for shift in SHIFTS]
    skin = {"thickness": 0.01, "material": {"model": "elastic", "G": 5.0}}
    below = [(0.1, {"model": "zener", "tau": 1.0}), (0.2, {"model": "zener", "tau": 0.5, "Ginf": 4.0})]
    shifts, times = (
        [skin, *({"thickness": d, "material": law | change(i)} for i, (d, law) in enumerate(below))]
        for change in (
            lambda i: {"shift": SHIFTS[i].model_dump()},
            lambda i: {"tau": below[i][1]["tau"] * factors[i]},
        )
    )
    without = {key: value for key, value in heated.items() if key != "temperature"}
    for time in ({"step": 0.25}, {"step": 0.25, "integrator": "backward_euler"}):
        warm = run(heated | {"temperature": {"value": 26.0}, "layers": shifts}, time)
        expected = run(without | {"layers": times}, time)
        for column in ("mean_pressure", "stored", "dissipated"):
            np.testing.assert_allclose(warm[column], expected[column], rtol=1e-7, atol=1e-12)
        assert warm["shift_factor"][0] == factors[0]
