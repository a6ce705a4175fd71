"""Indentation over time against what theory says of it.

Where the stiffness is G(s) f(q) (a layer alone, d = inf, or one on a rigid base) and the contact does not
shrink, the contact is the elastic one of the same depth, and with F(depth) the elastic mean pressure at unit
modulus

    pbar(t) = int G(t - s) dF(depth(s)).
"""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

ALONE = {"layer.thickness": math.inf}
RIGID = {"halfspace.shear_modulus": math.inf}
ELASTIC = {"layer.material": {"model": "zener", "G0": 1.0, "Ginf": 1.0}}

STEPS = [0.1, 0.05, 0.025]
TIMES = [0.2, 0.5, 1.0, 2.0, 3.0]


def over_the_ramp(time, kernel, F):
    """Integrate kernel(t - s) dF(depth(s)) over the ramp, by the midpoint rule."""
    s = np.linspace(0, min(time, 1.0), 8001)
    return float(kernel(time - (s[1:] + s[:-1]) / 2) @ np.diff(F(s)))


def relaxing(lag):
    """G(t) of the default material."""
    return 1 + 9 * np.exp(-lag)


def order(errors, steps=STEPS):
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


@pytest.fixture(scope="module")
def elastic_pressure(run):
    """Mean pressure over the ramp at G = 1, on the grid of the tests, for each of the bodies."""
    found = {}
    for name, body in (("alone", ALONE), ("rigid", RIGID)):
        elastic = run(body | ELASTIC | {"time.end": 1.0, "time.step": 0.01, "solver.tolerance": 1e-9})
        found[name] = CubicSpline(elastic["time"], elastic["mean_pressure"])
    return found


@pytest.mark.parametrize(("name", "body"), [("alone", ALONE), ("rigid", RIGID)])
def test_backward_euler_is_of_first_order_with_the_constant_of_theory(name, body, run, elastic_pressure):
    F = elastic_pressure[name]
    exact = np.array([over_the_ramp(t, relaxing, F) for t in TIMES])
    # A backward difference is d/dt - (dt/2) d2/dt2: G(s) becomes G - (dt/2) s^2 G'(s), and what is added,
    # -(dt/2) (Ginf - G0) (s/(1 + s))^2, is this kernel over dF.
    slope = np.array([over_the_ramp(t, lambda lag: -4.5 * (1 - lag) * np.exp(-lag), F) for t in TIMES])
    errors = []
    for step in STEPS:
        values = {"time.integrator": "backward_euler", "time.end": 3.0, "time.step": step}
        found = run(body | values | {"solver.tolerance": 1e-8})
        error = found.at("mean_pressure", TIMES) - exact
        errors.append(float(np.abs(error / exact).max()))
        # What is left is of second order, s^3 G'/6 + s^4 G''/8 and on: less than the glassy pressure.
        glassy = 10 * F(np.minimum(TIMES, 1.0))
        assert (np.abs(error - step * slope) < step**2 * glassy).all()
    assert order(errors) == pytest.approx(1, abs=0.1)


def test_the_papers_own_case_is_good_to_a_thousandth(run):
    paper = run({"time.integrator": "backward_euler", "time.end": 3.0, "time.step": 0.005})
    fine = run({"time.end": 3.0, "time.step": 0.01})  # off by some 4e-6
    times = np.linspace(0.1, 3.0, 30)
    np.testing.assert_allclose(
        paper.at("mean_pressure", times), fine.at("mean_pressure", times), rtol=1e-3 - 1e-5
    )


@pytest.mark.parametrize("body", [ALONE, RIGID], ids=["alone", "rigid"])
@pytest.mark.parametrize("integrator", ["backward_euler", "exponential"])
def test_the_contact_is_the_elastic_one_of_the_same_depth(body, integrator, run):
    values = body | {"time.end": 2.0, "time.integrator": integrator, "solver.tolerance": 1e-8}
    np.testing.assert_array_equal(run(values)["contact_area"], run(values | ELASTIC)["contact_area"])


def test_the_default_case_against_another_code(run):
    # ptilde(tau) of the paper's own steps by another solver, seven digits; on a grid four times finer, which
    # changes the fifth.
    values = {"grid.points": 4096, "time.integrator": "backward_euler", "time.step": 0.005, "time.end": 1.0}
    assert run(ALONE | values)["mean_pressure"][-1] == pytest.approx(0.0889770, rel=2e-5)
    assert run(RIGID | values)["mean_pressure"][-1] == pytest.approx(1.085422, rel=2e-5)


def test_a_punch_that_leaves_lets_the_surface_relax(run, tmp_path):
    # Without load every mode of a layer alone relaxes by its retardation time, tau Ginf/G0.
    (tmp_path / "path.csv").write_text("time,depth\n0,0\n1,0.01\n1.5,-0.01\n6,-0.01\n")
    times = [2.0, 4.0, 6.0]
    table = {"kind": "table", "file": str(tmp_path / "path.csv")}
    values = {"trajectory": table, "time.end": 6.0, "output.snapshots": times}
    for points in (1024, 16384):
        found = run(ALONE | values | {"grid.points": points})
        gone = found["time"] >= 1.5
        assert (found["contact_area"][gone] == 0).all()
        np.testing.assert_allclose(found["mean_pressure"][gone], 0, atol=1e-6 * found["mean_pressure"].max())
        dents = [-displacement.min() for _, displacement, _ in found.snapshots]
        assert dents[0] > 1e-4
        # Stray pressures of the tolerance leave as much of the depth.
        np.testing.assert_allclose(
            np.divide(dents, dents[0]), np.exp((2.0 - np.array(times)) / 10), rtol=1e-3
        )


def test_poissons_ratio_of_a_halfspace_scales_its_stiffness(run):
    # K = 2 q G/(2 (1 - nu)).
    values = ALONE | {"time.end": 2.0, "solver.tolerance": 1e-8}
    rubber, glass = run(values), run(values | {"layer.poisson": 0.3})
    np.testing.assert_array_equal(rubber["contact_area"], glass["contact_area"])
    expected = rubber["mean_pressure"] * 0.5 / 0.7
    np.testing.assert_allclose(glass["mean_pressure"], expected, rtol=1e-6, atol=1e-12)


SMALL = {"grid.points": 256, "time.end": 1.5, "time.step": 0.125, "output.snapshots": [1.5]}


def scaled(lengths=1.0, moduli=1.0, times=1.0):
    """The default case in other units."""
    return SMALL | {
        "grid.period": lengths,
        "layer.thickness": 0.05 * lengths,
        "punch.radius": 0.25 * lengths,
        "trajectory.depth": 0.01 * lengths,
        "layer.material": {"model": "zener", "G0": moduli, "Ginf": 10 * moduli, "tau": times},
        "halfspace.shear_modulus": moduli,
        "trajectory.ramp_time": times,
        "time.step": 0.125 * times,
        "time.end": 1.5 * times,
        "output.snapshots": [1.5 * times],
    }


@pytest.mark.parametrize("integrator", ["backward_euler", "exponential"])
@pytest.mark.parametrize("units", [{"lengths": 4.0}, {"moduli": 8.0}, {"times": 0.25}], ids=str)
def test_units_do_not_matter(units, integrator, run):
    # By powers of two, which round nothing: every bit is the same. (The active set guesses by cube roots.)
    settings = {"time.integrator": integrator, "solver.method": "fire"}
    one, other = run(scaled() | settings), run(scaled(**units) | settings)
    for column in ("contact_area", "mean_pressure", "transforms", "residual"):
        np.testing.assert_array_equal(other[column], one[column])
    np.testing.assert_array_equal(other["time"], one["time"] * units.get("times", 1.0))
    (_, u, p), (_, other_u, other_p) = one.snapshots[0], other.snapshots[0]
    np.testing.assert_array_equal(other_u, u * units.get("lengths", 1.0))
    np.testing.assert_array_equal(other_p, p * units.get("moduli", 1.0))


# Two solutions within 1e-10 of the exact one: a pressure left over is a displacement by the lowest mode and
# again a pressure by the stiffest, 128 times as stiff; and as much for the norm over the points.
CLOSE = 128 * 128 * 1e-10


def test_a_symmetric_punch_leaves_a_symmetric_surface(run):
    for _, u, p in run(SMALL | {"solver.tolerance": 1e-10}).snapshots:
        np.testing.assert_allclose(u[1:], u[:0:-1], atol=CLOSE * 0.01)
        np.testing.assert_allclose(p[1:], p[:0:-1], atol=CLOSE * p.max())


def test_where_the_punch_stands_does_not_matter(run, tmp_path):
    rng = np.random.default_rng(2)
    rough = np.cumsum(rng.normal(0, 1e-3, 256))
    rough -= np.linspace(0, rough[-1], 256)
    answers = []
    for shift in (0, 37):
        np.save(tmp_path / f"{shift}.npy", np.roll(rough, shift))
        punch = {"shape": "profile", "file": str(tmp_path / f"{shift}.npy")}
        found = run(SMALL | {"punch": punch, "trajectory.depth": 0.002, "solver.tolerance": 1e-10})
        answers.append([np.roll(values, -shift) for values in found.snapshots[0][1:]])
    (u, p), (moved_u, moved_p) = answers
    np.testing.assert_allclose(moved_u, u, atol=CLOSE * np.ptp(u))
    np.testing.assert_allclose(moved_p, p, atol=CLOSE * p.max())


def test_a_round_punch_leaves_a_round_dent(run):
    plane = {"grid.points": [64, 64], "grid.period": [1.0, 1.0], "solver.tolerance": 1e-9}
    _, u, p = run(SMALL | plane).snapshots[0]
    for mirrored in (u.T, np.roll(u[::-1], 1, axis=0), np.roll(u[:, ::-1], 1, axis=1)):
        np.testing.assert_allclose(mirrored, u, atol=64 * 64 * 1e-9 * 0.01)
    assert p[32, 32] > 0.9 * p.max() > 0
