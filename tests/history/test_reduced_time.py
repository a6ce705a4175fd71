"""Temperature: reduced time against its closed form, runs at a temperature against shifted ones, a jump."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import exp1

from gfmdlayer import Config, ConfigError, load
from gfmdlayer.body.materials import Zener
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.body.shifts import WLF, Arrhenius
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.modes import SCHEMES, Modes
from gfmdlayer.history.reduced_time import MotionInReducedTime, ReducedTime
from gfmdlayer.history.sliding_modes import SlidingModes
from gfmdlayer.time_functions import Constant, Table
from tests.recordings import Kept

ROUNDING = 1e-14
LAWS = [WLF(C1=17.44, C2=51.6, reference=20.0), Arrhenius(activation_energy=8e4, reference=20.0)]


def identity(shift):
    return shift.law


def table(*rows):
    times, values = np.array(rows).T
    return Table(times, values)


@pytest.mark.parametrize("shift", LAWS, ids=identity)
@pytest.mark.parametrize(("first", "last"), [(10.0, 25.0), (40.0, -20.0), (-10.0, 90.0)])
def test_step_of_reduced_time_is_the_exponential_integral(shift, first, last):
    # 1/aT = exp(k/y0 - k/y) with y = T - pole linear in t; the primitive is y exp(-k/y) - k E1(k/y). Its
    # difference loses no more than two digits at these ranges of temperature.
    k, y0 = shift.slope, shift.reference - shift.pole

    def primitive(temperature):
        y = temperature - shift.pole
        return y * math.exp(k / y0 - k / y) - k * math.exp(k / y0) * float(exp1(k / y))

    expected = 3.0 * (primitive(last) - primitive(first)) / (last - first)
    found = ReducedTime(shift, table((0.0, first), (3.0, last))).step(0.0, 3.0)
    assert found == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("shift", LAWS, ids=identity)
def test_steps_add_up_across_the_rows_of_a_table_and_its_ends(shift):
    reduced = ReducedTime(shift, table((0.0, 10.0), (1.0, 30.0), (2.5, 25.0)))
    edges = [-0.5, 0.0, 0.3, 1.7, 2.5, 4.0]
    parts = [reduced.step(a, b - a) for a, b in itertools.pairwise(edges)]
    assert reduced.step(-0.5, 4.5) == pytest.approx(math.fsum(parts), rel=ROUNDING)
    assert parts[0] == pytest.approx(0.5 / shift.factor(10.0), rel=ROUNDING)
    assert parts[-1] == pytest.approx(1.5 / shift.factor(25.0), rel=ROUNDING)


@pytest.mark.parametrize("shift", LAWS, ids=identity)
def test_the_time_of_a_reduced_time_is_its_inverse(shift):
    reduced = ReducedTime(shift, table((0.0, 10.0), (1.0, 90.0), (2.5, 25.0)))
    for time in (0.0, 1e-9, 0.3, 1.0, 1.7, 2.5, 40.0):
        # By rounding of the reduced time, of which most has passed in the warm middle.
        within = 4 * ROUNDING * reduced.step(0.0, time) * reduced.factor(time)
        assert reduced.time(reduced.step(0.0, time)) == pytest.approx(time, rel=4 * ROUNDING, abs=within)


def test_a_mode_under_a_moving_punch_follows_a_changing_temperature_with_second_order():
    # dY/dt + (1/(aT theta) - i q v) Y = dU/dt - i q v U in time, with U = 0.2 + t and 4 degrees more.
    # Over a step of the finest ones ln aT changes by .08: errors of a second order of at most its square.
    theta, q, end, velocity = 0.4, 9.0, 1.0, table((0.0, 0.5), (1.0, 0.8))
    reduced = ReducedTime(LAWS[0], table((0.0, 18.0), (1.0, 22.0)))

    def rate(t, y):
        drift = 1j * q * velocity(t)
        return 1.0 - drift * (0.2 + t) - (1 / (theta * reduced.factor(t)) - drift) * y

    exact = solve_ivp(rate, (0.0, end), [0.2 + 0j], rtol=1e-11, atol=1e-13, method="DOP853").y[0, -1]
    errors = []
    for count in (10, 20, 40):
        modes = SlidingModes(
            Spectrum(np.array([0.3]), np.array([[1.7]]), np.array([[theta]])),
            Sums(np.ones(1)),
            wavenumbers_x=np.full((2, 1), q),
            velocity=MotionInReducedTime(velocity, reduced),
        )
        for step in range(count + 1):
            time = end * step / count
            modes.terms(reduced.step(time - end / count, end / count) if step else 0.0)
            modes.advance(np.array([complex(0.2 + time)]))
        errors.append(abs(modes.stretches[0, 0] - exact) / abs(exact))
    assert errors[2] < 0.08**2
    assert errors[1] < errors[0] / 3.5
    assert errors[2] < errors[1] / 3.5


@pytest.mark.parametrize("shift", LAWS, ids=identity)
def test_times_do_not_change_at_the_reference_and_are_longer_below_it(shift):
    assert shift.factor(shift.reference) == 1.0
    assert shift.factor(shift.reference - 5) > 1 > shift.factor(shift.reference + 5)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_modes_in_reduced_time_equal_modes_of_shifted_times(scheme):
    # Stresses, energies and heat of all modes, over steps of different lengths: to rounding.
    rng = np.random.default_rng(1)
    weights, times = rng.random((3, 5)) + 0.1, rng.random((3, 5)) + 0.1
    shift = LAWS[0]
    reduced = ReducedTime(shift, Constant(14.0))
    at_reference = Modes(Spectrum(np.ones(5), weights, times), SCHEMES[scheme])
    shifted = Modes(Spectrum(np.ones(5), weights, shift.factor(14.0) * times), SCHEMES[scheme])
    for step in (0.1, 3.0, 100.0):
        u = rng.random(5) + 1j * rng.random(5)
        for found, expected in zip(
            at_reference.terms(reduced.step(0.0, step)), shifted.terms(step), strict=True
        ):
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)
        at_reference.advance(u)
        shifted.advance(u.copy())
        assert at_reference.stored == pytest.approx(shifted.stored, rel=1e-12)
        assert at_reference.dissipated == pytest.approx(shifted.dissipated, rel=1e-12)


SHIFT = {"law": "wlf", "C1": 17.44, "C2": 51.6, "reference": 20.0}


def recorded(**values):
    keys = {key.replace("__", "."): value for key, value in values.items()}
    recording = Kept()
    simulate(
        Case(Config(name="a", grid={"points": 128}).with_values({"solver.tolerance": 1e-10} | keys)),
        recording,
    )
    return recording


@pytest.mark.parametrize(
    ("time", "velocity"),
    [
        ({"step": 0.25}, None),
        ({"step": 0.25, "integrator": "backward_euler"}, None),
        ({"step": "adaptive", "tolerance": 1e-3}, None),
        ({"step": "adaptive", "tolerance": 1e-3, "end": 2.0}, 0.1),
    ],
)
def test_a_run_at_a_temperature_equals_a_run_at_shifted_times(time, velocity):
    shift, values = WLF(**SHIFT), {"time": time} | ({"trajectory__velocity": velocity} if velocity else {})
    warm = recorded(layer__material=Zener(shift=SHIFT), temperature={"value": 22.0}, **values)
    shifted = recorded(layer__material=Zener(tau=shift.factor(22.0)), **values)
    columns = ("time", "mean_pressure", "stored", "dissipated")
    for column in ("friction",) if velocity else columns:
        np.testing.assert_allclose(warm[column], shifted[column], rtol=1e-7, atol=1e-12)
    assert warm["temperature"][0] == 22.0
    assert warm["shift_factor"][-1] == shift.factor(22.0)


STACK = (0.02, 0.3), (0.1, 2.0)  # thicknesses and times
OTHER = {"law": "arrhenius", "activation_energy": 8e4, "reference": 20.0}
COULOMB = {"law": "coulomb", "coefficient": 0.3}
GRID = {"grid.points": 64, "solver.tolerance": 1e-9}


@pytest.mark.parametrize(
    ("column", "beside"),
    [
        ("mean_pressure", {"time.step": 0.25}),
        ("friction", {"trajectory.velocity": 0.1}),
        ("mean_pressure", {"interface": COULOMB, "trajectory.tangential": {"displacement": 0.002}}),
        ("force", {"grid.boundary": "isolated", "halfspace.shear_modulus": math.inf}),
        ("mean_pressure", {"counterbody": {"halfspace": {"shear_modulus": 3.0}}}),
        ("storage_stiffness", {"output.stiffness": {"frequencies": [0.1]}}),
        ("force", {"grid": {"geometry": "axisymmetric"}, "punch.radius": 0.1}),
    ],
)
def test_shifts_that_differ_at_a_constant_temperature_are_other_times(column, beside):
    base = {"time": {"end": 1.0, "step": 0.125}} | ({} if "grid" in beside else GRID) | beside

    def run(*laws, **more):
        zener = ({"model": "zener", "tau": tau} | law for (_, tau), law in zip(STACK, laws, strict=True))
        layers = [{"thickness": d, "material": law} for (d, _), law in zip(STACK, zener, strict=True)]
        found = Kept()
        simulate(Config(name="a").with_values({**base, "layers": layers, **more}), found)
        return found

    warm = run({"shift": SHIFT}, {"shift": OTHER}, temperature={"value": 22.0})
    factors = WLF(**SHIFT).factor(22.0), LAWS[1].factor(22.0)
    shifted = run(*({"tau": tau * factor} for (_, tau), factor in zip(STACK, factors, strict=True)))
    np.testing.assert_allclose(warm[column], shifted[column], rtol=1e-7, atol=1e-12)


def test_the_balance_of_energy_closes_over_a_jump_of_temperature(tmp_path):
    """`gfmdlayer verify` compares the pressure under this flat punch with Boltzmann's integral."""
    (tmp_path / "jump.txt").write_text("0 18\n1 18\n1.001 30\n3 30\n")
    found = recorded(
        layer={"thickness": math.inf, "material": Zener(shift=SHIFT)},
        punch={"shape": "flat", "width": 0.25, "edge_radius": 1e-6},
        trajectory={"depth": 0.01, "ramp_time": 0.5},
        temperature={"file": tmp_path / "jump.txt"},
        time={"step": "adaptive", "tolerance": 1e-5, "end": 3.0},
    )
    assert np.abs(found["energy_residual"]).max() < 1e-3 * found["work"][-1]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("0 20\n4 25\n", "ends at time 4; must reach time.end = 8"),
        ("0 20\n1 -40\n9 20\n", "degrees.txt:2: got -40, where the wlf law has no value"),
        ("1 20\n9 20\n", "the first time is 1; must be 0"),
    ],
)
def test_table_that_does_not_cover_the_run_or_leaves_the_law_is_refused(tmp_path, rows, words):
    from gfmdlayer.study.cases import input_errors

    (tmp_path / "degrees.txt").write_text(rows)
    law = "C1: 17.44, C2: 51.6, reference: 20"
    (tmp_path / "case.yaml").write_text(
        f"name: a\nlayer: {{material: {{shift: {{law: wlf, {law}}}}}}}\ntemperature: {{file: degrees.txt}}\n"
    )
    with pytest.raises(ConfigError, match=r"case.yaml:3:21: temperature.file: ") as refused:
        load(tmp_path / "case.yaml", inspect=input_errors)
    assert words in str(refused.value)
