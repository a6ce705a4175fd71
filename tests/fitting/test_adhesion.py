"""Fits of curves on elastic bodies with adhesion, and the choice between its limits."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import Cone, ConfigError, ForceCurve, Parabola, design_indentation, fit_indentation
from gfmdlayer.cli import main
from gfmdlayer.fitting.elastic import Touch, jumps_between, measured_contact
from gfmdlayer.fitting.force_curve import Correction, straight_derivatives
from gfmdlayer.fitting.indentation import _with_losses
from gfmdlayer.fitting.indentation_report import as_data
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.fitting.prediction import Prediction
from gfmdlayer.fitting.problem import IndentationModel
from gfmdlayer.fitting.result import FitOptions, IndentationFit, preference
from gfmdlayer.fitting.starts import curve_parameters, make_problem
from gfmdlayer.fitting.stepped import with_spring
from gfmdlayer.indentation.equilibrium import EdgeAdhesion
from gfmdlayer.indentation.indent import as_revolution
from gfmdlayer.indentation.solve import Edge, History, find_space, on_halved_steps

TIME = np.linspace(0.0, 2.0, 301)
G, THICKNESS, WORK, ATTRACTION, STIFFNESS = 1.0, 1.0, 0.03, 0.3, 3.0
MODEL: dict[str, Any] = {
    "layer": {"thickness": THICKNESS, "poisson": 0.5, "material": {"model": "elastic", "G": 2.0}},
    "halfspace": {"shear_modulus": math.inf},
    "punch": {"shape": "parabola", "radius": 5.0},
}
FREE = ["layer.material.G", "contact_point"]
BODY = gfmdlayer.bonded_layer(
    thickness=THICKNESS, material=gfmdlayer.Elastic(G), poisson=0.5, halfspace=math.inf
)  # fmt: skip
PUNCH = Parabola(radius=5.0)


@cache
def held(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Return depths and forces in contact, from the deepest to the last, by the equation over time."""
    depths = np.concatenate(([0.1], np.linspace(0.2, -0.08, 300)))
    work = WORK if kind == "jkr" else 0.0
    depths = depths if work else np.maximum(depths, 0.0)
    found = gfmdlayer.indent(BODY, PUNCH, np.arange(301.0), depth=depths, work=work)
    depth, force = found.depth.to_numpy(), found.force.to_numpy()
    rows = (found.contact_radius.to_numpy() > 0) & (np.arange(depth.size) >= int(np.argmax(depth)))
    attraction = ATTRACTION if kind == "dmt" else 0.0
    return depth[rows], force[rows] - attraction


def afm(kind: str, seed: int = 0, level: float = 0.01) -> ForceCurve:
    """Return a curve of a cantilever that jumps into contact and off, with noise."""
    depth, force = held(kind)
    base = depth + force / STIFFNESS
    stable = np.append(np.diff(base) < 0, True)  # up to where the cantilever jumps off
    last = int(np.argmin(stable)) if not stable.all() else base.size - 1
    drive = np.interp(TIME, [0, 1, 2], [-0.2, 0.6, -0.4])
    touching = (drive >= 0) | ((TIME > 1) & (drive >= base[last]))
    found = np.where(touching, np.interp(drive, base[last::-1], force[last::-1]), 0.0)
    found = found + level * found.max() * np.random.default_rng(seed).standard_normal(TIME.size)
    facts = {"prescribed": "base", "stiffness": STIFFNESS}
    return ForceCurve("afm", TIME, drive - found / STIFFNESS, found, **facts)


def assert_near(fit: IndentationFit, **truths: float) -> None:
    """Assert that parameters are within four standard errors of the truth."""
    for key, truth in truths.items():
        assert fit[key].value == pytest.approx(truth, abs=4 * fit[key].standard_error)


def test_the_work_of_adhesion_is_found_beside_modulus_and_contact_point() -> None:
    curve = afm("jkr")
    assert curve.force.min() < -0.5  # it does pull
    fit = fit_indentation(curve, MODEL, FREE, adhesion="jkr")
    assert_near(fit, G=G, work=WORK, contact_point=0.0)
    assert all(each.standard_error < 0.03 for each in fit.parameters)
    assert fit.curves[0].noise == pytest.approx(0.01 * curve.force.max(), rel=0.2)
    assert fit.adhesion == {"model": "jkr", "work": fit["work"].value}


@pytest.mark.parametrize("kind", ["none", "jkr", "dmt"])
def test_the_data_choose_their_limit_of_adhesion(kind: str) -> None:
    fit = fit_indentation(afm(kind, seed=1), MODEL, FREE, adhesion="choose")
    if kind == "none":  # a further parameter that the data leave at nothing costs ln(rows) in BIC
        assert fit.alternatives["none"] < min(fit.alternatives["jkr"], fit.alternatives["dmt"])
        assert fit.adhesion is None
    else:
        assert fit.adhesion is not None
        assert fit.adhesion["model"] == kind
        assert f"prefer {kind.upper()}" in fit.choice
    if kind == "dmt":
        assert_near(fit, force=ATTRACTION)


HALFSPACE: dict[str, Any] = {"layer": MODEL["layer"] | {"thickness": math.inf}, "punch": MODEL["punch"]}
FLAT = HALFSPACE | {"punch": {"shape": "flat_punch", "radius": 0.5}}
SPACING = 0.5 / 150  # of the depths of two rows


def lost_at(work: float) -> float:
    """Return the depth at which a flat punch is pulled off."""
    return -math.sqrt(2 * math.pi * 0.5 * work / 4.0)


def kendall(**facts: float) -> ForceCurve:
    """Return a curve of a flat punch: the force is proportional to the depth as long as it sticks."""
    depth = np.interp(TIME, [0, 1, 2], [-0.1, 0.2, -0.3])
    touching = (depth >= 0) | ((TIME > 1) & (depth >= lost_at(WORK)))
    force = np.where(touching, 4.0 * depth, 0.0) + 1e-3 * np.random.default_rng(2).standard_normal(TIME.size)
    return ForceCurve("flat", TIME, depth, force, prescribed="depth", **facts)


def test_only_the_pull_off_tells_the_work_under_a_flat_punch() -> None:
    # The place of the jump, between two rows, gives the work: its relative error is twice that of the depth,
    # spacing/12^(1/2).
    fit = fit_indentation(kendall(), FLAT, ["layer.material.G"], adhesion="jkr")
    assert fit["work"].error / fit["work"].value == pytest.approx(
        2 * SPACING / 12**0.5 / abs(lost_at(WORK)), rel=0.1
    )
    assert_near(fit, work=WORK)


def test_a_jump_far_from_its_place_counts_in_the_information_criterion() -> None:
    # The forces under a flat punch do not tell the work: two given works differ by the squares of the
    # distance of their pull-off from the measured one, over spacing/12^(1/2).
    curve, works = kendall(noise=1e-3), (WORK, 1.2 * WORK)
    place = float(curve.depth[(TIME > 1) & (curve.depth >= lost_at(WORK))][-1]) - SPACING / 2
    near, far = (
        fit_indentation(curve, FLAT | {"adhesion": {"model": "jkr", "work": work}}, ["layer.material.G"]).bic
        for work in works
    )
    squares = [(12**0.5 * (lost_at(work) - place) / SPACING) ** 2 for work in works]
    assert squares[1] > 20
    assert far - near == pytest.approx(squares[1] - squares[0], rel=0.05)  # the drive has an error, too


def johnson(seed: int, force_noise: float, depth_noise: float = 0.0, work: float = 0.0068) -> ForceCurve:
    """Return a curve of JKR's closed form on a halfspace; noises are parts of the ranges."""
    E, a = 4.0 * G, np.linspace(1e-3, 2.0, 4000)
    depths = a**2 / 5.0 - np.sqrt(2 * math.pi * a * work / E)
    forces = 4 * E * a**3 / 15.0 - np.sqrt(8 * math.pi * work * E * a**3)
    held = slice(int(np.argmin(depths)), None)
    depth = np.interp(TIME, [0, 1, 2], [-0.08, 0.2, -0.05])
    touching = (depth >= 0) | ((TIME > 1) & (depth >= depths[held].min()))
    force = np.where(touching, np.interp(depth, depths[held], forces[held]), 0.0)
    noise = np.random.default_rng(seed).standard_normal((2, TIME.size))
    force = force + force_noise * force.max() * noise[0]
    return ForceCurve("jkr", TIME, depth + depth_noise * noise[1], force, prescribed="depth")


@pytest.mark.parametrize("seed", [2, 7])
def test_a_touch_that_the_first_guess_mistakes_does_not_draw_the_fit(seed: int) -> None:
    # The largest pull of noisy rows overestimates the work; with it, rows after the touch look free.
    fit = fit_indentation(johnson(seed, 0.05), HALFSPACE, [*FREE, "force_offset"], adhesion="jkr")
    assert_near(fit, G=G, work=0.0068, contact_point=0.0, force_offset=0.0)


def test_a_noisy_depth_bounds_the_error_of_the_contact_point() -> None:
    # The measured depth leaves the straight piece of the approach uncertain where the indenter touches. Rows
    # and jumps of precise forces move with it, so no number of them gives the contact point better.
    curve = johnson(0, 1e-3, 0.01)
    fit = fit_indentation(curve, HALFSPACE, FREE, adhesion="jkr")
    (drive,) = Prediction(curve).drives
    touch = np.array([0.08 / 0.28])
    along = straight_derivatives(touch, drive.time, drive.value)[0][: drive.covariance.shape[0]]
    error = drive.error * math.sqrt(along @ drive.covariance @ along)
    assert 0.7 * error < fit["contact_point"].error < 1.3 * error


def test_adhesion_that_vanishes_has_the_criterion_of_none() -> None:
    curve = johnson(1, 0.05, work=1e-12)
    none = fit_indentation(curve, HALFSPACE, FREE)
    faint = fit_indentation(curve, HALFSPACE | {"adhesion": {"model": "jkr", "work": 1e-12}}, FREE)
    assert faint.bic == pytest.approx(none.bic, abs=1e-3)


def test_each_row_between_a_jump_and_its_place_costs_the_square_of_the_jump_over_the_noise() -> None:
    value = np.linspace(1.0, -1.0, 41)
    ramp = ForceCurve("ramp", -value, value, value + 2, prescribed="depth")
    touch, everywhere = Touch(41), np.ones(41, dtype=bool)
    pieces: Any = SimpleNamespace(at=lambda time: (-time, time > 9))
    touch.jumps = jumps_between(value > 0, ~everywhere, everywhere, value, (3.0, 3.0))
    ends: Any = [SimpleNamespace(end=lambda _, at=at: at) for at in (-0.5, -0.55)]
    far, farther = (touch.places(ramp, contacts, pieces)[0] ** 2 for contacts in ends)
    assert farther - far == pytest.approx(3.0**2)


@pytest.mark.parametrize("kind", ["jkr", "dmt"])
def test_adhesion_is_found_in_any_units(kind: str) -> None:
    curve, key = afm(kind), {"jkr": "work", "dmt": "force"}[kind]
    length, stress = 1e-6, 1e-3
    force = stress * length**2
    depth = curve.depth * length
    facts = {"prescribed": "base", "stiffness": STIFFNESS * stress * length}
    scaled = ForceCurve("scaled", TIME, depth, curve.force * force, **facts)
    model = {
        "layer": MODEL["layer"]
        | {"thickness": THICKNESS * length, "material": {"model": "elastic", "G": 2e-3}},
        "halfspace": MODEL["halfspace"],
        "punch": {"shape": "parabola", "radius": 5.0 * length},
    }
    size, truth = {"jkr": (stress * length, WORK), "dmt": (force, ATTRACTION)}[kind]
    free: dict[str, Any] = dict.fromkeys(FREE) | {f"adhesion.{key}": [truth * size / 9, truth * size * 11]}
    for keys in (FREE, free):
        fit = fit_indentation(scaled, model, keys, adhesion=kind)
        assert fit[key].value / size == pytest.approx(truth, abs=4 * fit[key].standard_error / size)
        assert fit[key].error < 0.1 * fit[key].value


def test_a_jump_into_contact_that_noise_hides_does_not_stop_the_search() -> None:
    # a cantilever of a tenth of the stiffness: the tip dives in, and its pull at the first touch is small
    depth, force = held("jkr")
    stiffness = 0.1 * STIFFNESS
    base = depth + force / stiffness
    last = int(np.argmin(base))
    drive = np.interp(TIME, [0, 1, 2], [-0.6, 0.98 * base.max(), -4.0])
    touching = (drive >= 0) | ((TIME > 1) & (drive >= base[last]))
    found = np.where(touching, np.interp(drive, base[last::-1], force[last::-1]), 0.0)
    found += 0.04 * found.max() * np.random.default_rng(0).standard_normal(TIME.size)
    facts = {"prescribed": "base", "stiffness": stiffness}
    curve = ForceCurve("soft", TIME, drive - found / stiffness, found, **facts)
    fit = fit_indentation(curve, MODEL, FREE[:1], contact="detect", adhesion="jkr")
    assert_near(fit, work=WORK, contact_point=0.0)


def test_a_retraction_is_seen_beside_a_hold_of_large_forces() -> None:
    # forces 1000 times larger than lengths: a range over both would hide the retraction
    curve, scale = afm("jkr"), 1e3
    top = int(np.argmax(curve.position_of_drive))
    rows = np.concatenate((np.arange(top + 1), np.full(20, top), np.arange(top + 1, TIME.size)))
    prescribed = np.array(["base"] * (top + 1) + ["force"] * 20 + ["base"] * (TIME.size - top - 1))
    names = np.where(
        prescribed == "force", "hold", np.where(np.arange(rows.size) <= top, "approach", "retract")
    )
    time = np.arange(rows.size) * (TIME[1] - TIME[0])
    facts = {"prescribed": prescribed.tolist(), "segment": names.tolist(), "stiffness": scale * STIFFNESS}
    data = {"time": time, "depth": curve.depth[rows], "force": scale * curve.force[rows], **facts}
    model = MODEL | {"layer": MODEL["layer"] | {"material": {"model": "elastic", "G": scale}}}
    fit = fit_indentation(data, model, FREE, adhesion="jkr", stiffness=scale * STIFFNESS)
    assert fit["work"].value == pytest.approx(scale * WORK, rel=0.05)


def test_a_curve_may_begin_at_its_largest_depth() -> None:
    curve = afm("jkr")
    rows = slice(int(np.argmax(curve.position_of_drive)), None)
    facts = {"prescribed": "base", "stiffness": STIFFNESS}
    part = ForceCurve("retract", TIME[rows], curve.depth[rows], curve.force[rows], **facts)
    fit = fit_indentation(part, MODEL, FREE, adhesion="jkr")
    assert_near(fit, G=G, work=WORK)


def test_forces_of_the_wrong_sign_leave_every_parameter_open() -> None:
    curve = afm("none")
    facts = {"prescribed": "base", "stiffness": STIFFNESS}
    wrong = ForceCurve("wrong", TIME, curve.depth, -curve.force, **facts)
    fit = fit_indentation(wrong, MODEL, FREE, adhesion="none")
    assert all(each.is_open for each in fit.parameters)
    json.dumps(as_data(fit), allow_nan=False)


def test_the_radius_of_an_indenter_is_found_on_an_elastic_body() -> None:
    depth = np.linspace(0.0, 0.1, 50)
    force = 16 / 3 * 7.0 * 5.0**0.5 * depth**1.5  # Hertz, nu = 1/2
    model = {
        "layer": {"thickness": math.inf, "material": {"model": "elastic", "G": 7.0}},
        "punch": {"shape": "parabola", "radius": 3.0},
    }
    curve = ForceCurve("hertz", depth, depth, force, prescribed="depth")
    assert fit_indentation(curve, model, ["punch.radius"])["radius"].value == pytest.approx(5.0, rel=1e-6)


def test_rows_in_contact_are_those_whose_residuals_are_smaller_in_contact() -> None:
    value = np.array([-2.0, -1, 0.5, 2, 3, 2, 1, -1, -2, -3, -1, 1, 2, 1, -1, -2])
    worse = np.where([0, 0, 0, 1, 1, 1, 1, 1, 1, 0, 0, 1, 1, 1, 1, 0], -1.0, 1.0)
    found = measured_contact(value, np.zeros(value.size, dtype=bool), worse)
    assert found.astype(int).tolist() == [0, 0, 0, 1, 1, 1, 1, 1, 1, 0, 0, 1, 1, 1, 1, 0]
    held_on = measured_contact(value, np.zeros(value.size, dtype=bool), np.full(value.size, -1.0))
    assert held_on.all()


def test_a_fit_reads_its_own_model_with_adhesion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    curve, rows = afm("jkr"), tmp_path / "afm.csv"
    columns = np.column_stack((curve.time, curve.position_of_drive, curve.force))
    np.savetxt(rows, columns, delimiter=",", header="time,base,force", comments="")
    model = tmp_path / "model.yml"
    model.write_text(json.dumps(MODEL | {"free": FREE}).replace("Infinity", ".inf"))
    common = [str(rows), "--stiffness", "3", "--prescribed", "base"]
    first = ["--model", str(model), "--adhesion", "choose", "--out", str(tmp_path / "first")]
    assert main(["fit-indentation", *common, *first]) == 0
    assert "the data prefer JKR to" in capsys.readouterr().out
    data = json.loads((tmp_path / "first.json").read_text())
    assert data["adhesion"]["model"] == "jkr"
    assert set(data["alternatives"]) == {"none", "jkr", "dmt"}
    again = ["--model", str(tmp_path / "first.yaml"), "--free", "adhesion.work", "--out", str(tmp_path / "b")]
    assert main(["fit-indentation", *common, *again]) == 0
    second = json.loads((tmp_path / "b.json").read_text())
    # the other parameters are fixed within their errors, contact_point at 0
    assert second["adhesion"]["work"] == pytest.approx(data["adhesion"]["work"], rel=0.05)


def test_a_planned_pull_off_is_worth_more_than_an_approach_for_the_work() -> None:
    model = MODEL | {"adhesion": {"model": "jkr", "work": WORK}}
    free = ["layer.material.G", "adhesion.work", "contact_point"]
    plan = {"time": [0, 1, 2], "base": [-0.2, 0.6, -0.4], "stiffness": STIFFNESS, "noise": 0.02}
    whole = design_indentation(plan, model, free)
    part = design_indentation(plan | {"base": [-0.2, 0.6, 0.1]}, model, free)
    assert whole["work"].error < 0.6 * part["work"].error


def test_a_plan_with_adhesion_expects_the_errors_of_the_fit() -> None:
    curve = afm("jkr")
    noise = 0.01 * float(curve.force.max())
    fit = fit_indentation(replace(curve, noise=noise), MODEL, FREE, adhesion="jkr")
    model = MODEL | {"adhesion": {"model": "jkr", "work": WORK}}
    model["layer"] = MODEL["layer"] | {"material": {"model": "elastic", "G": G}}
    plan = {"time": [0, 1, 2], "base": [-0.2, 0.6, -0.4], "stiffness": STIFFNESS, "noise": noise, "rows": 301}
    expected = design_indentation(plan, model, [*FREE, "adhesion.work"])
    # The derivatives are those at other values, off by the errors; the noise of the fit need not be white,
    # which makes its intervals up to 1.6 times as wide (test_noise).
    for each in fit.parameters:
        assert 0.9 < each.error / expected[each.key].error < 1.6


def test_a_plan_is_refused_where_the_fit_would_be() -> None:
    model = MODEL | {"adhesion": {"model": "jkr", "work": WORK}}
    plan = {"time": [0, 1], "depth": [-0.2, 0.2], "noise": 0.02}
    with pytest.raises(FitError, match="adhesion is asked of a curve without a retraction"):
        design_indentation(plan, model, ["layer.material.G", "adhesion.work"])


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        ({"adhesion": {"model": "jkr", "work": -1.0}}, {}, r"adhesion.work: got -1.0; must be a number > 0"),
        ({"adhesion": {"model": "jrk", "work": 1.0}}, {}, "must be jkr or dmt; did you mean 'jkr'"),
        ({}, {"free": ["adhesion.wrk"], "adhesion": "jkr"},
         r"free: adhesion.wrk: unknown key.* 'adhesion.work'"),
        ({}, {"free": ["adhesion.force"], "adhesion": "jkr"}, "free: adhesion.force: unknown key"),
        ({}, {"free": ["adhesion.work"]}, "free: adhesion.work: the model has no adhesion; give its section"),
        ({}, {"adhesion": ["jkr"]}, "must be one of none, jkr, dmt, choose"),
        ({}, {"adhesion": "maugis"}, "got 'maugis'; must be one of none, jkr, dmt, choose"),
        ({}, {"adhesion": "jkr", "segments": ["approach"]},
         "adhesion is asked of a curve without a retraction"),
        ({"viscoelastic": True}, {"adhesion": "dmt"}, "got 'dmt' under a body that relaxes; must be 'jkr'"),
    ],
)  # fmt: skip
def test_impossible_adhesion_is_named(change: dict[str, Any], options: dict[str, Any], message: str) -> None:
    model, free = MODEL | change, FREE
    if model.pop("viscoelastic", False):
        zener = {"model": "zener", "G0": 1.0, "Ginf": 2.0, "tau": 1.0}
        model, free = model | {"layer": model["layer"] | {"material": zener}}, ["layer.material.G0"]
    free = options.pop("free", free)
    with pytest.raises((ConfigError, FitError), match=message):
        fit_indentation(replace(afm("jkr")), model, free, **options)


GEL = gfmdlayer.halfspace(gfmdlayer.Zener(1.0, 3.0, 0.5))


def relaxing(punch: dict[str, Any], work: float, glassy: float = 3.0) -> dict[str, Any]:
    return {
        "layer": {"thickness": math.inf,
         "material": {"model": "zener", "G0": 1.0, "Ginf": glassy, "tau": 0.5}},
        "punch": punch, "adhesion": {"model": "jkr", "work": work},
    }  # fmt: skip


def assert_inside(fit: IndentationFit, **truths: float) -> None:
    """Assert that intervals, longer by a half at both ends, contain the truth and are not too long."""
    for name, truth in truths.items():
        low, high = fit[name].interval
        assert low - 0.5 * (high - low) < truth < high + 0.5 * (high - low) < 2 * truth


def test_a_shrinking_contact_on_a_cantilever_has_its_loss_and_its_work_found() -> None:
    """The last force is below the noise, the largest pull far above it: rows see that shortly before."""
    model, cone = relaxing({"shape": "cone", "slope": 0.3}, 0.02), as_revolution(Cone(slope=0.3))
    time = np.linspace(0, 3.5, 301)
    body, stiffness = GEL, 4.0
    moved = History(np.array([0.0, 1.0, 2.0, 3.5]), np.array([0.0, 0.22, 0.22, -0.42]), by_force=False)
    space = find_space(body, cone, moved, adhesion=Edge(0.02))
    held, made = with_spring(space, space.compliance(body), stiffness)
    knots = np.union1d(np.linspace(0, 3.5, 601), moved.time)
    pressed = on_halved_steps(made, held, cone, moved, knots, adhesion=Edge(0.02))
    force = np.interp(time, pressed.time, pressed.force)
    lost = float(pressed.time[np.flatnonzero(pressed.force)[-1] + 1])
    force += 0.01 * np.ptp(force) * np.random.default_rng(1).standard_normal(time.size)
    base = np.interp(time, moved.time, moved.value)
    curve = ForceCurve("gel", time, base - force / stiffness, force, prescribed="base", stiffness=stiffness)
    made_of = IndentationModel(model)
    seen = Prediction(curve, adhesive=True)
    seen.adapt(made_of.config, at := Correction(stiffness=stiffness, adhesion=EdgeAdhesion(work=0.02)))
    seen.label(made_of.config, at)
    (jump,) = seen.touch.jumps
    assert abs(time[jump.row] - lost) < 3 * (time[1] - time[0])
    fit = fit_indentation(curve, model, ["layer.material.G0", "adhesion.work"])
    assert_inside(fit, G0=1.0, work=0.02)


def test_contact_under_a_force_begins_with_a_jump_of_the_depth() -> None:
    model, time = relaxing({"shape": "cone", "slope": 0.3}, 0.02), np.linspace(0.0, 2.0, 81)
    force = np.interp(time, [0, 1, 2], [0, 0.2, 0.2])
    pressed = gfmdlayer.indent(GEL, Cone(slope=0.3), time, force=force, work=0.02)
    depth = np.interp(time, pressed.time, pressed.depth)
    seen = Prediction(ForceCurve("gel", time, depth, force, prescribed="force"), adhesive=True)
    made, at = IndentationModel(model).config, Correction(adhesion=EdgeAdhesion(work=0.02))
    seen.adapt(made, at)
    found = seen.response(made, at)[1]
    assert depth[1] > 0.1 * depth.max()
    assert np.abs(found - depth)[1:].max() < 0.01 * depth.max()


def peeled(punch: Any, end: float, rows: int, work: float, level: float = 0.0, **facts: float) -> ForceCurve:
    """Return a curve of a punch that is pressed into a relaxing halfspace for a second, and pulled off."""
    time = np.linspace(0.0, end, rows)
    depth = np.interp(time, [0, 1, end], [0, 0.15, -0.35])
    pressed = gfmdlayer.indent(GEL, punch, time, depth=depth, work=work)
    force = np.interp(time, pressed.time, pressed.force)
    force += level * np.ptp(force) * np.random.default_rng(1).standard_normal(rows)
    return ForceCurve("gel", time, depth, force, prescribed="depth", **facts)


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_a_work_far_off_gives_way_to_one_that_follows_a_flat_punch(factor: float) -> None:
    """In contact nothing depends on the work of a flat punch."""
    curve = peeled(gfmdlayer.FlatPunch(radius=0.5), 2.5, 101, 0.01, noise=1e-3)
    made = IndentationModel(relaxing({"shape": "flat_punch", "radius": 0.5}, 0.01))
    parameters = curve_parameters([curve], made, ["adhesion.work"], FitOptions())
    problem = make_problem([curve], made, parameters, FitOptions())
    problem.adapt(u := problem.coordinates({"adhesion.work": 0.01 * factor}))
    assert 0.3 < problem.values(_with_losses(problem, u))["adhesion.work"] / 0.01 < 3


@pytest.mark.parametrize(("level", "rough"), [(1e-3, False), (0.1, True)])
def test_a_fit_says_where_its_linear_intervals_are_rough(level: float, rough: bool) -> None:
    model, curve = relaxing(MODEL["punch"], 0.02), peeled(PUNCH, 3.0, 61, 0.02, level)
    free = [*(f"layer.material.{key}" for key in ("G0", "Ginf", "tau")), "adhesion.work"]
    assert ("intervals are rough" in " ".join(fit_indentation(curve, model, free).warnings)) == rough


@pytest.mark.parametrize("adhesion", ["jkr", "choose"])
def test_work_and_modulus_of_a_relaxing_halfspace_are_found(adhesion: str) -> None:
    zener = {"model": "zener", "G0": 1.5, "Ginf": 3.0, "tau": 0.5}
    model = {"layer": {"thickness": math.inf, "material": zener}, "punch": MODEL["punch"]}
    curve = peeled(PUNCH, 3.0, 121, 0.02, 0.01)
    assert_inside(fit_indentation(curve, model, ["layer.material.G0"], adhesion=adhesion), G0=1.0, work=0.02)


def test_words_of_a_choice_follow_the_differences() -> None:
    assert "cannot tell JKR and DMT apart" in preference({"none": 90.0, "jkr": 10.0, "dmt": 11.0})
    assert preference({"none": 14.0, "jkr": 10.0, "dmt": 30.0}).startswith("the data weakly prefer JKR")
    assert preference({"jkr": 1.0}) == ""
