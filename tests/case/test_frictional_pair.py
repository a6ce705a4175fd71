"""Friction between two deformable bodies: exchange, equal bodies, a rigid partner, energies, other roads."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

import gfmdlayer
from gfmdlayer import Pair, Parabola, halfspace, solve
from gfmdlayer.case.notes import notes
from gfmdlayer.config import Config

Section = dict[str, Any]

pytestmark = pytest.mark.filterwarnings("ignore:COARSE", "ignore:UNBALANCED")

WEAK = {
    "layer": {
        "thickness": 0.1,
        "poisson": 0.4,
        "material": {"model": "zener", "G0": 1.0, "Ginf": 4.0, "tau": 1.0},
    }
}
HARD = {
    "layer": {
        "thickness": 0.05,
        "poisson": 0.2,
        "material": {"model": "zener", "G0": 2.0, "Ginf": 3.0, "tau": 0.3},
    }
}
BASE = {"halfspace": {"shear_modulus": 20.0, "poisson": 0.3}}

PUSH = {
    "tangential": {"control": "displacement", "kind": "oscillation", "displacement": 0.002, "period": 0.5}
}
ROLL = {"velocity": 0.1, "creepage": 0.02}
PULL = {"velocity": 0.1, "tangential": {"control": "force", "kind": "ramp", "force": 0.002, "ramp_time": 0.3}}
SLIDE = {"velocity": 0.1}
ROUGH = {"shape": "self_affine", "hurst": 0.8, "rms_height": 1e-3, "seed": 1, "short_cutoff": 0.1}


def run(body: Section, counterbody: Section | None, motion: Section, **changes: Any) -> Any:
    """Run a parabola under a load between two bodies."""
    config: Section = {
        "name": "pair",
        "grid": {"points": 96, "period": 1.0},
        "punch": {"shape": "parabola", "radius": 0.5},
        "interface": {"law": "coulomb", "coefficient": 0.3},
        "trajectory": {"control": "load", "kind": "ramp_hold", "load": 0.05, "ramp_time": 0.2, **motion},
        "time": {"end": 0.6, "step": 0.02},
        "solver": {"tolerance": 1e-9},
        "output": {"snapshots": [0.6]},
        **body,
    }
    if counterbody is not None:
        config["counterbody"] = counterbody
    return gfmdlayer.run(config | changes)


def reversed_motion(motion: Section) -> Section:
    """Return a motion along the surface the other way."""
    found = {**motion}
    if "creepage" in motion:
        found["creepage"] = -motion["creepage"]
    if "tangential" in motion:
        drive = {**motion["tangential"]}
        key = drive["control"]
        drive[key] = -drive[key]
        found["tangential"] = drive
    return found


@pytest.mark.parametrize("motion", [PUSH, ROLL, PULL])
def test_bodies_may_be_exchanged(motion: Section) -> None:
    """The pressure stays, the shear traction turns round with the motion: in all bits if a path is given."""
    one = run(WEAK | BASE, HARD | BASE, motion)
    two = run(HARD | BASE, WEAK | BASE, reversed_motion(motion))
    noise = 1e-8 * float(one["pressure"].max()) if motion is PULL else 0.0  # of the solver, of tolerance 1e-9
    for name, sign in (("pressure", 1), ("shear_x", -1)):
        np.testing.assert_allclose(one[name], sign * two[name], rtol=0, atol=noise)
    for name in ("contact_area", "stick_area", "depth", "slip_heat"):
        np.testing.assert_allclose(one[name], two[name], rtol=1e-5 if noise else 0, atol=noise)
    for name in ("stored", "dissipated"):
        np.testing.assert_allclose(one[f"{name}_body"], two[f"{name}_counterbody"], rtol=1e-5, atol=noise)
        np.testing.assert_allclose(two[f"{name}_body"], one[f"{name}_counterbody"], rtol=1e-5, atol=noise)
    np.testing.assert_allclose(one["displacement_body"], two["displacement_counterbody"], rtol=0, atol=noise)


def test_bodies_may_be_exchanged_on_surfaces() -> None:
    """With creepage along and across, and spin: in all bits."""

    def rolling(sign: float) -> Section:
        return {"velocity": 0.3, "creepage": {"x": 0.01 * sign, "y": 0.006 * sign, "spin": 0.05 * sign}}

    changes: Section = {
        "grid": {"points": [32, 24], "period": [1.0, 0.8]},
        "time": {"end": 0.4, "step": 0.05},
    }
    changes["output"] = {"snapshots": [0.4]}
    one = run(WEAK | BASE, HARD | BASE, rolling(1.0), **changes)
    two = run(HARD | BASE, WEAK | BASE, rolling(-1.0), **changes)
    assert float(abs(one["shear_y"]).max()) > 0
    for name, sign in (("pressure", 1), ("shear_x", -1), ("shear_y", -1), ("spin_moment", -1)):
        np.testing.assert_array_equal(one[name], sign * two[name])


@pytest.mark.parametrize("motion", [PUSH, ROLL, SLIDE])
def test_a_second_body_costs_few_transforms(motion: Section) -> None:
    """Beside one body in a contact of the same width, by which the solver chooses its windows."""
    changes: Section = {
        "grid": {"points": 512, "period": 1.0},
        "solver": {},
        "time": {"end": 0.3, "step": 0.02},
        "output": {},
    }
    alone = run(WEAK | BASE, None, {**motion, "load": 0.12}, **changes)
    two = run(WEAK | BASE, HARD | BASE, motion, **changes)
    assert float(two["contact_area"][-1]) == pytest.approx(float(alone["contact_area"][-1]), rel=0.03)
    assert float(two["transforms"].sum()) <= 1.4 * float(alone["transforms"].sum())


@pytest.mark.parametrize("motion", [PUSH, ROLL, SLIDE])
def test_a_rigid_counterbody_changes_no_bit(motion: Section) -> None:
    rigid = {"halfspace": {"shear_modulus": math.inf}}
    one, alone = run(WEAK | BASE, rigid, motion), run(WEAK | BASE, None, motion)
    for name in ("pressure", "shear_x", "depth", "slip_heat", "stored", "tangential_force"):
        np.testing.assert_array_equal(one[name], alone[name])


@pytest.mark.parametrize("motion", [PUSH, ROLL, SLIDE])
def test_a_very_stiff_counterbody_is_rigid(motion: Section) -> None:
    """Its compliance is 2e-8 of the base's, 0.7e-9 over 0.7/20 for the longest wave, and less for others."""
    stiff = {"halfspace": {"shear_modulus": 1e9, "poisson": 0.3}}
    one, alone = run(WEAK | BASE, stiff, motion), run(WEAK | BASE, None, motion)
    scale = float(alone["pressure"].max())
    for name in ("pressure", "shear_x"):
        np.testing.assert_allclose(one[name], alone[name], rtol=0, atol=2e-8 * scale)


@pytest.mark.parametrize("motion", [PUSH, ROLL, PULL])
@pytest.mark.parametrize("step", [{"step": 0.02}, {"step": "adaptive", "tolerance": 1e-3}])
def test_equal_rollers_are_one_incompressible_body(motion: Section, step: Section) -> None:
    """On a line, with (1 - nu)/G of each, one body of nu = 1/2 has the same compliances.

    Their coupling cancels. G' = G/(4 (1 - nu)) relaxes in the same way.
    """
    law = {"model": "zener", "G0": 1.0, "Ginf": 4.0, "tau": 0.4}
    half = {"halfspace": {"poisson": 0.3, "material": law}}
    same = {"halfspace": {"poisson": 0.5, "material": law | {"G0": 1 / 2.8, "Ginf": 4 / 2.8}}}
    nothing = {"layer": {"thickness": 0.0}}
    time = {"time": {"end": 0.6, **step}}
    two = run(nothing | half, half, motion, **time)
    one = run(nothing | same, None, motion, **time)
    assert two.sizes["time"] == one.sizes["time"] or "tolerance" in step
    area = {"rtol": 1e-5, "atol": 1e-9}
    if "tolerance" in step:  # the error of a step is measured on both surfaces
        at = np.linspace(0.05, 0.6, 12)
        one, two = one.interp(time=at), two.interp(time=at)
        area = {"rtol": 3e-3, "atol": 1e-5}
    for name in ("depth", "tangential_force", "dissipated", "slip_heat"):
        np.testing.assert_allclose(two[name], one[name], **area)


@pytest.mark.parametrize("motion", [PUSH, ROLL, SLIDE, PULL])
def test_the_energies_close_in_the_order_of_the_steps(motion: Section) -> None:
    """With a quarter of the step at most .7 of what is missing: edges and slip are of the first order."""
    missing = []
    for step in (0.02, 0.01, 0.005):
        found = run(WEAK | BASE, HARD | BASE, motion, time={"end": 0.6, "step": step})
        missing.append(abs(float(found["energy_residual"][-1])) / float(abs(found["work"]).max()))
    assert missing[-1] < 5e-3
    assert missing[-1] < max(0.7 * missing[0], 5e-4)


def test_solve_takes_a_pair() -> None:
    keys: Section = {"force": 0.03, "period": (4.0, 4.0), "points": (32, 32), "friction": 0.5}
    soft, stiff = halfspace(400.0, poisson=0.4), halfspace(600.0, poisson=0.2)
    for more in ({}, {"isolated": True}):
        one = solve(Pair(soft, stiff), Parabola(radius=120.0), tangential_force=0.008, **keys, **more)
        two = solve(Pair(stiff, soft), Parabola(radius=120.0), tangential_force=-0.008, **keys, **more)
        np.testing.assert_allclose(one.pressure, two.pressure, atol=1e-7 * float(one.pressure.max()))
        np.testing.assert_allclose(one.shear_x, -two.shear_x, atol=1e-7 * float(one.pressure.max()))
        np.testing.assert_allclose(
            one.displacement_body + one.displacement_counterbody,
            one.displacement,
            atol=1e-12 * float(one.depth),
            equal_nan=True,
        )


def test_cattaneo_and_mindlin_between_two_bodies() -> None:
    """Equal elastic spheres without images: a, depth and shift by the moduli of both (Johnson, Sec. 7.2)."""
    G, nu, R, F, mu, T = 1.0, 0.3, 1.0, 0.01, 0.5, 0.003
    both = Pair(halfspace(G, poisson=nu), halfspace(G, poisson=nu))
    modulus = G / (1 - nu)  # E* of two equal bodies
    a = (3 * F * R / (4 * modulus)) ** (1 / 3)
    found = solve(
        both, Parabola(radius=R), force=F, tangential_force=T, friction=mu, isolated=True,
        period=(4 * a, 4 * a), points=(64, 64),
    )  # fmt: skip
    assert float(found.depth) == pytest.approx(a**2 / R, rel=2e-3)
    shift = 3 * mu * F * (2 - nu) / (8 * G * a) * (1 - (1 - T / (mu * F)) ** (2 / 3))
    assert float(found.tangential_displacement_x) == pytest.approx(shift, rel=1e-2)
    stuck = math.sqrt(float(found.stick_area) / math.pi)
    assert stuck / a == pytest.approx((1 - T / (mu * F)) ** (1 / 3), abs=4 / 64)  # a spacing


def test_an_isolated_pair_is_that_of_a_periodic_cell_on_rigid_bases() -> None:
    """Histories in two forms: relaxing modes of two bodies, and creep of both together."""
    rigid = {"halfspace": {"shear_modulus": math.inf}}
    grid, drive = {"points": 128, "period": 1.0}, {"control": "depth", "depth": 0.005, "ramp_time": 0.2}
    drive |= {"kind": "ramp_hold", **PUSH}
    periodic = run(WEAK | rigid, HARD | rigid, PUSH, grid=grid, trajectory=drive)
    alone = grid | {"boundary": "isolated"}
    isolated = run(WEAK | rigid, HARD | rigid, PUSH, grid=alone, trajectory=drive)
    for name, total in (
        ("depth", "depth"),
        ("tangential_force", "tangential_force"),
        ("slip_heat", "slip_heat"),
    ):
        np.testing.assert_allclose(isolated[total], periodic[name], rtol=5e-3, atol=1e-6)


def test_the_steady_state_of_two_rollers_at_once_is_that_of_marching() -> None:
    half = {"halfspace": {"poisson": 0.3, "material": {"model": "zener", "G0": 1.0, "Ginf": 4.0, "tau": 0.4}}}
    other = {"halfspace": {"shear_modulus": 3.0, "poisson": 0.2}}
    nothing = {"layer": {"thickness": 0.0}}
    steps = {"end": 12.0, "step": 0.104166666666666667}  # a spacing
    marched = run(nothing | half, other, ROLL, time=steps, output={"snapshots": [12.0]})
    at_once = run(nothing | half, other, ROLL, time=steps | {"steady": "at_once"}, output={})
    for name in ("depth", "tangential_force", "contact_area"):
        assert float(at_once[name][-1]) == pytest.approx(float(marched[name][-1]), rel=2e-3)


def test_equal_elastic_rollers_are_carters() -> None:
    """Q/(mu P) = 1 - (1 - xi R/(mu a))^2 of F. W. Carter (1926) for any Poisson's ratio, without images."""
    half, radius, mu, a = {"shear_modulus": 1.0, "poisson": 0.3}, 1.0, 0.3, 0.1
    force = math.pi / 0.7 * a**2 / (4 * radius)  # E* = G/(1 - nu) of both
    step = 0.42 / 128 / 0.1
    found = run(
        {"layer": {"thickness": 0.0}, "halfspace": half},
        {"halfspace": half},
        {},
        grid={"points": 128, "period": 0.42, "boundary": "isolated", "datum": 1.0},
        punch={"shape": "parabola", "radius": radius},
        trajectory={
            "control": "force",
            "force": force,
            "ramp_time": step,
            "velocity": 0.1,
            "creepage": 0.015,
        },
        time={"end": 1.0, "step": step, "steady": "at_once"},
        output={},
    )
    # Carter's 0.75 within 1 %, as one body with as many points
    assert float(found["tangential_force"][-1]) / (mu * force) == pytest.approx(0.75, rel=0.01)


def test_bodies_slide_until_the_state_is_steady() -> None:
    """The counterbody, whose material rests in the contact, creeps to the state that is found at once."""
    steps = {"end": 100.0, "step": 0.1}
    marched = run(WEAK | BASE, HARD | BASE, SLIDE, time=steps | {"steady": 1e-3}, output={})
    at_once = run(WEAK | BASE, HARD | BASE, SLIDE, time=steps | {"steady": "at_once"}, output={})
    assert float(marched["time"][-1]) < 50
    for name in ("depth", "tangential_force"):
        assert float(marched[name][-1]) == pytest.approx(float(at_once[name][-1]), rel=1e-3)


def test_a_small_creepage_is_a_ratio_of_velocities_near_one() -> None:
    """Carried at (1 - xi) V in place of V, the memory of the counterbody changes in the order of xi."""
    half = {"layer": {"thickness": 0.0}, "halfspace": {"shear_modulus": 1.0}}
    ratio = {"halfspace": {"shear_modulus": 2.0, "poisson": 0.2}, "velocity_ratio": 0.98}
    rolling = run(half, {"halfspace": ratio["halfspace"]}, ROLL)
    other = run(half, ratio, SLIDE)
    for name in ("tangential_force", "depth"):
        assert float(other[name][-1]) == pytest.approx(float(rolling[name][-1]), rel=0.02)


def test_stretches_of_equal_rollers_cancel() -> None:
    """A cell keeps both from stretching: (1 - 2 nu) p/(2 G) = 0.005 of the body, and half of the other."""
    half = {"layer": {"thickness": 0.0}, "halfspace": {"shear_modulus": 2.0, "poisson": 0.3}}
    stiff = {"halfspace": {"shear_modulus": 4.0, "poisson": 0.3}}

    def stretch(counterbody: Section | None, motion: Section) -> str:
        drive = {"control": "load", "load": 0.05, "ramp_time": 0.2, **motion}
        config: Section = {"name": "pair", "interface": {"law": "coulomb", "coefficient": 0.3}, **half}
        config |= {"trajectory": drive} | ({} if counterbody is None else {"counterbody": counterbody})
        return "".join(re.findall(r"stretch the surface by (\S+),", " ".join(notes([Config(**config)]))))

    assert stretch(None, ROLL) == "0.005"
    assert stretch(stiff, ROLL) == "0.0025"
    assert not stretch(stiff, SLIDE)
    assert not stretch({"halfspace": half["halfspace"]}, ROLL)


def test_keys_of_the_counterbody_may_be_swept() -> None:
    moduli = [5.0, 50.0, math.inf]
    sweep = {"counterbody.halfspace.shear_modulus": moduli}
    found = run(WEAK | BASE, {"halfspace": {"shear_modulus": 5.0, "poisson": 0.3}}, ROLL, sweep=sweep)
    for modulus in moduli:
        own = {"halfspace": {"shear_modulus": modulus, "poisson": 0.3}}
        one = run(WEAK | BASE, own, ROLL)
        np.testing.assert_array_equal(found["shear_x"].sel(shear_modulus=modulus), one["shear_x"])


@pytest.mark.parametrize(
    ("changes", "place", "message"),
    [
        (
            {"counterbody": {**BASE, "velocity_ratio": 0.5}, "trajectory": ROLL},
            "velocity_ratio",
            "must be 1, or alone: 0.5 without them is a creepage of 0.5",
        ),
        (
            {"counterbody": BASE, "trajectory": SLIDE, "grid": {"boundary": "isolated"}},
            "velocity_ratio",
            "give trajectory.creepage",
        ),
        (
            {"counterbody": BASE, "trajectory": ROLL, "punch": ROUGH},
            "counterbody",
            "use a smooth punch.shape",
        ),
        (
            {"counterbody": {"body": {"kind": "lattice", "nearest": 1.0, "spacing": 0.1}}},
            "counterbody.body",
            "must be layers",
        ),
    ],
)
def test_what_has_no_answer_is_refused(changes: Section, place: str, message: str) -> None:
    drive = {"control": "load", "load": 0.05, "kind": "ramp_hold", "ramp_time": 0.2}
    config = {"name": "pair", "interface": {"law": "coulomb", "coefficient": 0.3}, **changes}
    config["trajectory"] = drive | changes.get("trajectory", {})
    with pytest.raises(ValidationError) as caught:
        Config.model_validate(config)
    assert re.search(f"{re.escape(place)}.*{re.escape(message)}", str(caught.value))
