"""Instabilities: when and where the surface jumps, the energy that it loses, and what is left of a load.

Most of it on a flat punch over a compressible layer on a rigid base: its surface moves as a whole, against
K = 2 G (1 - nu)/((1 - 2 nu) d) per area, so that jumps are those of one spring.
"""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import gfmdlayer
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate
from gfmdlayer.config import Config
from gfmdlayer.observables.adhesion import PathPoint, work_over_fold
from gfmdlayer.study.folder import Folder
from gfmdlayer.study.status import overview
from tests.recordings import Kept

K = 2 * 0.7 / (0.4 * 0.1)
WORK = RANGE = 5e-3
FILM = {
    "grid.points": 8,
    "layer": {"thickness": 0.1, "poisson": 0.3, "material": {"model": "elastic", "G": 1.0}},
    "halfspace.shear_modulus": math.inf,
    "interface": {"law": "exponential", "work": WORK, "range": RANGE},
}
CYCLE = {"kind": "approach_retract", "start": -0.05, "depth": 0.005, "approach_speed": 0.01}
ADAPTIVE = {"time.step": "adaptive", "time.tolerance": 1e-4}


def film(*values):
    config, recording = Config(name="film"), Kept()
    for each in (FILM, ADAPTIVE, *values):
        config = config.with_values(each)
    simulate(Case(config, punch=np.zeros(8)), recording)
    return recording


def traction(gap):
    return WORK / RANGE * math.exp(-gap / RANGE)


def energy(displacement, height):
    return K * displacement**2 / 2 - RANGE * traction(height - displacement)


# The branch out of contact ends where -tau' = K, that in contact where the wall is free: tau(0) = K h.
GAP_OF_JUMP = -RANGE * math.log(K * RANGE**2 / WORK)
HEIGHT_IN = GAP_OF_JUMP + traction(GAP_OF_JUMP) / K
HEIGHT_OUT = traction(0.0) / K
LIFT_AFTER = HEIGHT_OUT - brentq(
    lambda gap: K * (HEIGHT_OUT - gap) - traction(gap), GAP_OF_JUMP, HEIGHT_OUT, xtol=1e-16
)
LOST_IN = energy(HEIGHT_IN - GAP_OF_JUMP, HEIGHT_IN) - energy(HEIGHT_IN, HEIGHT_IN)
LOST_OUT = energy(HEIGHT_OUT, HEIGHT_OUT) - energy(LIFT_AFTER, HEIGHT_OUT)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_an_elastic_film_jumps_in_and_out_and_loses_the_area_of_its_loop(tolerance):
    # A wave of ten thicknesses is softer than K by 2 %: in a cell as long as that the surface is uneven a
    # little before it jumps, which short steps find.
    recording = film({"trajectory": CYCLE, "time.tolerance": tolerance, "grid.period": 0.1})
    found = recording.noted
    assert found["instabilities"] == 2
    # The depth goes on by at most tolerance * range over the step with the jump, divided by the part of the
    # largest pressure that jumps; the energy is late by the jump of the pressure times that.
    jumped_in = 1 - traction(GAP_OF_JUMP) / (K * HEIGHT_IN)
    jumped_out = 1 - K * LIFT_AFTER / (K * HEIGHT_OUT)
    late = -found["instability_depth"] - (HEIGHT_IN, HEIGHT_OUT)
    assert -1.1 * tolerance * RANGE / jumped_in < late[0] <= 0
    assert 0 <= late[1] < 1.1 * tolerance * RANGE / jumped_out
    off = np.abs(found["instability_energy"] - (LOST_IN, LOST_OUT))
    assert (off < 1.1 * tolerance * RANGE * K * np.array([HEIGHT_IN, HEIGHT_OUT])).all()
    assert recording["lost"][-1] == found["instability_energy"].sum()
    np.testing.assert_allclose(
        recording.at("lost", found["instability_time"])[0],
        recording["lost"][-1] - found["instability_energy"][1],
    )
    # Around the loop nothing else is left of the work: a trapezium over a step of the gap by this part of the
    # range integrates exp(-g/range) to its square over 12.
    separation = min(0.3 * (tolerance / 1e-4) ** (1 / 3), 0.5)
    assert np.abs(recording["energy_residual"]).max() < separation**2 / 12 * WORK
    assert recording["work"][-1] == pytest.approx(LOST_IN + LOST_OUT, abs=separation**2 / 12 * WORK)


@pytest.mark.parametrize("step", [0.02, 0.01])
def test_fixed_steps_find_the_loss_without_looking_for_the_jump(step):
    recording = film({"trajectory": CYCLE | {"depth": 0.0}, "time": {"step": step}})
    found = recording.noted
    assert found["instabilities"] == 2
    late = np.abs(found["instability_depth"] + (HEIGHT_IN, HEIGHT_OUT))
    moved = 0.01 * step
    assert (late <= moved * (1 + 1e-9)).all()
    # The pressure jumps somewhere in the step: half of it, over the step, would be an error of first order.
    jumps = K * HEIGHT_IN - traction(GAP_OF_JUMP), K * (HEIGHT_OUT - LIFT_AFTER)
    first_order = 0.5 * moved * np.array(jumps)
    assert (np.abs(found["instability_energy"] - (LOST_IN, LOST_OUT)) < 0.1 * first_order).all()
    # The pressure also follows the branches meanwhile, by the root of the step at their ends.
    np.testing.assert_allclose(found["instability_error"], first_order, rtol=0.2)
    assert recording["work"][-1] == pytest.approx(LOST_IN + LOST_OUT, abs=0.1 * first_order.sum())
    assert np.abs(recording["energy_residual"]).max() < 0.01 * first_order.sum()


@pytest.mark.parametrize("depth_given", [True, False])
def test_work_over_the_end_of_a_branch_is_exact_for_its_leading_terms(*, depth_given):
    def row(time):
        """With the root of the time to the end at 1: y = 3 + 4 root, m = 5 root, then y = 7; x = -2 t."""
        root = math.sqrt(1 - time) if time < 1 else math.nan
        point = -2 * time, 3 + 4 * root if time < 1 else 7.0
        return PathPoint(time, *(point if depth_given else point[::-1]), 0.0, 0.0, 5 * root)

    begin, end = row(0.7), row(1.2)
    found = work_over_fold(row(0.4), begin, end, depth_given=depth_given)
    area = -2 * (3 * 0.3 + 4 * 0.3**1.5 / 1.5 + 7 * 0.2)
    if not depth_given:  # by parts
        area = end.depth * end.pressure - begin.depth * begin.pressure - area
    assert found == pytest.approx((area, 0.6), rel=1e-12)
    # A jump before the end of its branch: int over the parabola up to there, and no other branch.
    early = row(0.9)
    found = work_over_fold(row(0.4), begin, early, depth_given=depth_given)
    area = -2 * (3 * 0.2 + 4 * (0.3**1.5 - 0.1**1.5) / 1.5)
    if not depth_given:
        area = early.depth * early.pressure - begin.depth * begin.pressure - area
    assert found == pytest.approx((area, 1.0), rel=1e-12)
    assert work_over_fold(begin, end, depth_given=depth_given) is None
    assert work_over_fold(begin, begin, end, depth_given=depth_given) is None


def table(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    return str(path)


def test_a_film_under_a_rising_voltage_is_pulled_in_when_theory_says(tmp_path):
    gap, insulation, rate, tolerance = 0.05, 0.01, 2.0, 1e-4
    electrostatic = {"law": "electrostatic", "insulation": insulation, "permittivity": 1e-3}
    at_rest = {"kind": "table", "file": table(tmp_path, "depth.txt", f"0 {-gap}\n9 {-gap}\n")}
    # V^2 = 8 K (g0 + h0)^3/(27 eps0)
    time = math.sqrt(8 * K * (gap + insulation) ** 3 / 27e-3) / rate
    voltage = table(tmp_path, "voltage.txt", f"0 0\n{2 * time} {2 * time * rate}\n")
    recording = film(
        {"interface": electrostatic | {"voltage": voltage}, "trajectory": at_rest, "time.end": 1.5 * time}
    )
    found = recording.noted
    assert found["instabilities"] == 1
    # The square of the voltage goes on by at most the tolerance over the part of the pressure that jumps: of
    # eps0 V^2/2 over the square of h0 after it, and of 2/3 (g0 + h0) before.
    jumped = 1 - (insulation / (2 / 3 * (gap + insulation))) ** 2
    assert 0 <= found["instability_time"][0] / time - 1 < 1.1 * tolerance / jumped / 2
    touches = recording["contact_area"] > 0
    assert not touches[recording["time"] < time].any()
    assert touches[recording["time"] > 1.001 * time].all()
    # The voltage does all the work: the punch is at rest. Its part in the balance is the trapezium of V dV.
    separation = 0.3
    assert recording["lost"][-1] > 0
    assert np.abs(recording["energy_residual"]).max() < separation**2 / 12 * recording["lost"][-1]


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
def test_a_relaxing_film_is_pulled_in_late(tolerance, tmp_path):
    """Between the glassy and the relaxed threshold the film creeps to its fold and jumps there."""
    # K u + w y = tau(h - u) with dy/dt + y/tau_r = du/dt, w = (Ginf/G0 - 1) K: the film is stable as long as
    # its glassy stiffness exceeds -tau', and moves by du/dt = (tau - K u)/(K + w + tau')/tau_r.
    contrast = 1.5
    glassy, fold = contrast * K, -RANGE * math.log(contrast * K * RANGE**2 / WORK)
    height = (fold + traction(fold) / glassy + HEIGHT_IN) / 2  # between the two thresholds
    start = brentq(lambda u: glassy * u - traction(height - u), 0.0, height - fold, xtol=1e-16)

    def slowness(u):
        slope = -traction(height - u) / RANGE
        return (glassy + slope) / (traction(height - u) - K * u)

    expected = quad(slowness, start, height - fold, epsabs=0, epsrel=1e-10)[0]
    at_rest = {"kind": "table", "file": table(tmp_path, "depth.txt", f"0 {-height}\n99 {-height}\n")}
    zener = {"model": "zener", "G0": 1.0, "Ginf": contrast, "tau": 1.0}
    recording = film({
        "layer.material": zener, "trajectory": at_rest, "time.end": 3 * expected, "time.tolerance": tolerance,
    })  # fmt: skip
    found = recording.noted
    assert found["instabilities"] == 1
    assert found["instability_time"][0] == pytest.approx(expected, rel=20 * tolerance)


SOFT = {
    "grid": {"points": 64},
    "layer": {"thickness": math.inf, "poisson": 0.5, "material": {"model": "elastic", "G": 1.0}},
    "halfspace": {"shear_modulus": 1.0},
    "interface": {"law": "exponential", "work": 1e-3, "range": 0.02},
    "time": {"step": "adaptive", "tolerance": 1e-3},
}
PULL = {"control": "load", "kind": "approach_retract", "load": 0.02, "retract_speed": 0.02, "final": -0.04}


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_load_that_nothing_holds_ends_its_case_which_is_a_result(tmp_path):
    held = gfmdlayer.run(SOFT, trajectory=CYCLE | {"final": -0.05})
    strongest = float(held["mean_pressure"].min())
    pulled = gfmdlayer.run(SOFT | {"trajectory": PULL})
    last = float(pulled["mean_pressure"][-1])
    # The load goes on by the tolerance of the largest load; the rows in depth control miss the least pressure
    # by half of its curvature, P/range^2 at most, times the square of half a step, 0.5 ranges.
    assert last == pytest.approx(strongest, abs=1e-3 * 0.01 + 0.25**2 / 2 * abs(strongest))
    assert pulled.attrs["ended"].startswith(f"PULLED OFF at t = {pulled.attrs['pull_off_time']:.6g}")
    last_time = float(pulled["time"][-1])
    assert last_time <= pulled.attrs["pull_off_time"] < last_time + 1e-2
    # A sweep has the rows of each case up to its own end.
    swept = {"trajectory": PULL, "sweep": {"interface.work": [1e-3, 1.0]}}
    found = gfmdlayer.run(SOFT | swept, out=tmp_path / "out")
    assert found.attrs["failed"] == ""
    ends = found["time"].max("row")
    assert ends[0] == pytest.approx(last_time, abs=1e-2)  # up to the last step
    assert ends[1] == 3.0 + 1.0
    np.testing.assert_array_equal(np.isnan(found["mean_pressure"]), np.isnan(found["time"]))
    (ended,) = overview(Folder(tmp_path / "out")).ended
    case = gfmdlayer.open_case(tmp_path / "out" / "cases" / "0000.h5")
    assert (ended.index, ended.reason, ended.values) == (0, case.attrs["ended"], {"interface.work": 1e-3})


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_punch_that_is_pulled_off_rests_until_its_load_presses_again():
    relaxing = {"material": {"model": "zener", "G0": 1.0, "Ginf": 2.0, "tau": 1.0}}
    layer = {"layer": SOFT["layer"] | relaxing}
    found = gfmdlayer.run(SOFT | layer | {"trajectory": PULL | {"cycles": 2}})
    # Pulled off at some load < 0 of the first retraction; from 6 on, after 0.04/0.02 of approach, it presses.
    time, pressure = found["time"].to_numpy(), found["mean_pressure"].to_numpy()
    away = (time > 3.0) & (time < 5.99)
    assert away.sum() > 3
    assert np.abs(pressure[away]).max() < 1e-12
    assert (found["contact_area"].to_numpy()[away] == 0).all()
    assert (np.diff(found["stored"].to_numpy()[away]) < 0).all()  # the surface recovers
    pressing = time > 6.1
    load = np.interp(time[pressing], [6, 7, 10], [0, 0.02, -0.04])
    np.testing.assert_allclose(2 * pressure[pressing], load, atol=1e-12)
    assert found.attrs["pull_off_time"] > 7.0  # the second one ends the case
    # The balance holds over both, as over the steps between: to the trapezium of steps of half a range.
    assert np.abs(found["energy_residual"]).max() < 0.5**2 / 12 * float(np.abs(found["work"]).max())
