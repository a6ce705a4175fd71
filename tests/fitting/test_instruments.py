"""Fits of instruments that prescribe depth, force, or the base of a cantilever."""

import math
from dataclasses import replace

import h5py
import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import ConfigError, ForceCurve, fit_indentation
from gfmdlayer.files.tables import TableError
from gfmdlayer.fitting.curve_files import entries, read_curve
from gfmdlayer.fitting.force_curve import Correction, StraightDrive
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.fitting.prediction import Prediction
from gfmdlayer.fitting.problem import IndentationModel
from gfmdlayer.fitting.result import FitOptions
from gfmdlayer.fitting.stepped import with_spring
from gfmdlayer.indentation.indent import as_revolution
from gfmdlayer.indentation.model import IsolatedContact
from gfmdlayer.indentation.solve import History, find_space, on_halved_steps

TIME = np.linspace(0.0, 5.0, 201)
ZENER = ("layer.material.G0", "layer.material.Ginf", "layer.material.tau")
TRUTH = (1.0, 4.0, 0.7)
MODEL = {
    "layer": {"thickness": 1.0, "poisson": 0.5,
     "material": {"model": "zener", "G0": 1.0, "Ginf": 4.0, "tau": 0.7}},
    "halfspace": {"shear_modulus": math.inf}, "punch": {"shape": "parabola", "radius": 5.0},
}  # fmt: skip
START = MODEL | {
    "layer": MODEL["layer"] | {"material": {"model": "zener", "G0": 2.0, "Ginf": 5.0, "tau": 1.5}}
}
RAMP = np.interp(TIME, [0, 0.5, 1.5, 4, 5], [-0.1, 0.0, 0.2, 0.2, 0.0])


def noise(seed, level):
    return level * np.random.default_rng(seed).standard_normal(TIME.size)


def contact(**history):
    """Return force and depth of the model under a history, at the rows."""
    config = IndentationModel(MODEL).config
    body = IsolatedContact(config).body
    found = gfmdlayer.indent(body, as_revolution(config.punch), TIME, tolerance=3e-4, **history)
    return np.interp(TIME, found.time, found.force), np.interp(TIME, found.time, found.depth)


def test_a_precise_ramp_that_turns_between_rows_gives_the_moduli() -> None:
    # With 32 steps the force is within 2e-3 of that of `indent`. Corners at rows make tau 3 % larger.
    times, most = np.linspace(0.0, 6.0, 401), [-0.1, 0.1, 0.1, -0.4]  # turns at the rows 133.3 and 266.7
    config, depth = IndentationModel(MODEL).config, np.interp(times, [0, 2, 4, 6], most)
    body, indenter = IsolatedContact(config).body, as_revolution(config.punch)
    found = gfmdlayer.indent(body, indenter, [0, 2, 4, 6], depth=most, tolerance=1e-5)
    force = np.interp(times, found.time, found.force)
    fit = fit_indentation(ForceCurve("ramp", times, depth, force, prescribed="depth"), START, list(ZENER))
    np.testing.assert_allclose([each.value for each in fit.parameters], TRUTH, rtol=2e-3)


def on_base(stiffness):
    """Return a curve without noise of a cantilever whose base follows the ramp."""
    curve = ForceCurve("afm", TIME, RAMP, np.maximum(RAMP, 0), prescribed="base", stiffness=stiffness)
    curve = replace(curve, depth=RAMP - curve.force / stiffness)
    prediction, config = Prediction(curve), IndentationModel(MODEL).config
    prediction.adapt(config, Correction(stiffness=stiffness))
    force, _ = prediction.response(config, Correction(stiffness=stiffness))
    return replace(curve, force=force, depth=RAMP - force / stiffness)


def test_creep_gives_the_thickness_of_a_layer_that_a_fit_of_relaxation_loses():
    # A force held on 2 um of gel under a bead; 3 nm of noise, four parameters, a start 1.5 to 2 off.
    time = np.linspace(0.0, 10.0, 401)
    force = np.interp(time, [0, 0.5, 10], [0, 5e-9, 5e-9])
    body = gfmdlayer.bonded_layer(
        thickness=2e-6, material=gfmdlayer.Zener(1500.0, 6000.0, 0.8), halfspace=np.inf
    )
    found = gfmdlayer.indent(body, gfmdlayer.Sphere(radius=5e-6), time, force=force)
    depth = np.interp(time, found.time, found.depth) + 3e-9 * np.random.default_rng(0).standard_normal(401)
    model = {
        "layer": {"thickness": 3e-6,
         "material": {"model": "zener", "G0": 1000.0, "Ginf": 3000.0, "tau": 1.0}},
        "halfspace": {"shear_modulus": math.inf}, "punch": {"shape": "sphere", "radius": 5e-6},
    }  # fmt: skip
    fit = fit_indentation(ForceCurve("creep", time, depth, force), model, [*ZENER, "layer.thickness"])
    assert {each.prescribed for each in fit.curves[0].curve.segments} == {"force"}
    for each, truth in zip(fit.parameters, (1500.0, 6000.0, 0.8, 2e-6), strict=True):
        assert each.interval[0] < truth < each.interval[1]
    assert fit["thickness"].interval[1] < 2 * fit["thickness"].interval[0]
    assert fit.curves[0].depth_noise == pytest.approx(3e-9, rel=0.15)  # four standard errors of 401 rows


def test_a_spring_in_series_leaves_the_contact_under_its_own_depth():
    # The base follows a ramp; the depth that follows, prescribed on the same body, gives the same force. Both
    # have the error of 200 steps, some 1e-4; where contact is lost inside a step, its square root.
    body, profile = (
        IsolatedContact(IndentationModel(MODEL).config).body,
        as_revolution(IndentationModel(MODEL).config.punch),
    )
    times = TIME[TIME <= 4.4]
    space = find_space(body, profile, History(TIME, RAMP))
    sprung = with_spring(space, space.compliance(body), 5.0)
    found = on_halved_steps(sprung[1], sprung[0], profile, History(TIME, RAMP), times)
    depth = found.depth - found.force / 5.0
    again = on_halved_steps(body, space, profile, History(found.time, depth), times)
    assert np.abs(again.force - found.force).max() < 5e-4 * found.force.max()
    assert found.force.max() > 0.3 * 5.0 * RAMP.max()  # the spring takes a good part of the motion


def test_the_base_of_a_cantilever_gives_moduli_and_an_uncertain_stiffness_widens_them():
    curve = on_base(stiffness=5.0)
    measured = curve.force + noise(1, 0.01 * curve.force.max())
    given = replace(curve, force=measured, depth=RAMP - measured / 5.0)
    sure = fit_indentation(given, START, ZENER)
    for key, truth in zip(ZENER, TRUTH, strict=True):
        assert sure[key].value == pytest.approx(truth, abs=4 * sure[key].standard_error)
    # A stiffness 8 % too large scales the force; the base stays. The stated error of 10 % covers it.
    wrong = replace(
        given, force=1.08 * measured, depth=given.depth, stiffness=1.08 * 5.0, stiffness_error=0.1
    )
    unsure = fit_indentation(wrong, START, ZENER)
    assert unsure["stiffness"].interval[0] < 5.0 < unsure["stiffness"].interval[1]
    for key, truth in zip(ZENER, TRUTH, strict=True):
        assert unsure[key].interval[0] < truth < unsure[key].interval[1]
    assert unsure["G0"].error > 1.5 * sure["G0"].error


def test_tilt_drift_and_offset_of_the_baseline_are_found_beside_the_moduli():
    force, depth = contact(depth=RAMP)
    position = RAMP - RAMP[0]
    baseline = 0.2 + 0.05 * TIME + 0.4 * position
    measured = force + baseline + noise(2, 0.005 * force.max())
    free = [*ZENER, "force_offset", "force_drift", "tilt"]
    fit = fit_indentation(ForceCurve("a", TIME, depth, measured, prescribed="depth"), START, free)
    for key, truth in zip(free, (*TRUTH, 0.2, 0.05, 0.4), strict=True):
        # 1e-3 for the interpolation in time
        assert fit[key].value == pytest.approx(truth, abs=4 * fit[key].standard_error + 1e-3 * truth)


def test_noise_of_the_prescribed_quantity_widens_the_intervals_and_moves_no_corner_of_the_ramp():
    force, depth = contact(depth=RAMP)
    noisy = depth + noise(3, 0.02 * np.ptp(depth))
    drive = StraightDrive.of(TIME, noisy, np.full(TIME.size, 3e-4 * np.ptp(noisy)))
    # A kink of slopes 0.2 and 0 in rows of noise s, 25 ms apart: an error of the time of s/0.2 (dt/1 s)^0.5.
    assert drive.time[1:-1] == pytest.approx([1.5, 4.0], abs=4 * 0.006 / 0.2 * 0.025**0.5 * 2)
    measured = force + noise(4, 0.005 * force.max())
    clean = fit_indentation(ForceCurve("a", TIME, depth, measured, prescribed="depth"), START, ZENER)
    both = fit_indentation(ForceCurve("a", TIME, noisy, measured, prescribed="depth"), START, ZENER)
    for key, truth in zip(ZENER, TRUTH, strict=True):
        assert both[key].error > 1.5 * clean[key].error
        assert abs(both[key].value - truth) < 4 * both[key].standard_error


@pytest.mark.parametrize("prescribed", ["depth", "force", "base"])
def test_the_prescribed_quantity_is_guessed_from_the_straight_column(prescribed):
    if prescribed == "force":
        force, depth = contact(force=np.interp(TIME, [0, 1, 4, 5], [0, 3.0, 3.0, 0.5]))
        curve = ForceCurve("a", TIME, depth, force)
    else:
        curve = on_base(5.0)
        curve = replace(
            curve, prescribed=None, **({"stiffness": None, "depth": RAMP} if prescribed == "depth" else {})
        )
    spread = 0.01 * np.ptp(curve.measured)
    for seed in range(3):
        measured = curve.measured + noise(seed, spread)
        column = {"depth": measured} if prescribed == "force" else {"force": measured}
        found = replace(curve, **column)
        assert [each.name for each in found.segments] == ["approach", "hold", "retract"]
        assert {each.prescribed for each in found.segments} == {prescribed}
    assert found.guessed == "segments and prescribed quantities guessed"


@pytest.mark.parametrize("level", [0.0, 0.01])
def test_a_turn_is_no_hold(level):
    time = np.linspace(0.0, 2.0, 401)
    depth = np.interp(time, [0, 1, 2], [-0.3, 1.0, -0.3])
    force = np.maximum(depth, 0.0) ** 1.5
    force = force + level * np.random.default_rng(0).standard_normal(time.size)
    turn = ForceCurve("turn", time, depth, force)
    assert [each.name for each in turn.segments] == ["approach", "retract"]
    assert turn.segments[1].first == 201  # the row after the deepest


def test_a_pause_at_constant_force_between_motions_of_the_base():
    # Creep in the pause of an AFM: the base, the force, and the base again are prescribed.
    curve = on_base(5.0)
    top = int(np.searchsorted(TIME, 1.5))
    pause = (np.arange(TIME.size) > top) & (TIME < 3.0)
    words = np.where(pause, "force", "base")
    force = np.where(pause, curve.force[top], curve.force)
    mixed = replace(curve, force=force, prescribed=list(words))
    prediction, config, at = Prediction(mixed), IndentationModel(MODEL).config, Correction(stiffness=5.0)
    prediction.adapt(config, at)
    found, depth = prediction.response(config, at)
    assert found[pause] == pytest.approx(curve.force[top], rel=1e-3)
    assert depth[pause][-1] > depth[top] * 1.02  # creep
    assert (np.diff(depth[pause]) > 0).all()
    # what the instrument would have measured, fitted
    base = np.where(pause, depth + found / 5.0, RAMP)
    measured = np.where(pause, found, found + noise(5, 0.005 * found.max())) + 0.3  # with an offset
    position = base - measured / 5.0 + np.where(pause, noise(6, 1e-3 * np.ptp(base)), 0.0)
    free = [*ZENER, "force_offset"]
    fit = fit_indentation(replace(mixed, force=measured, depth=position), START, free)
    for key, truth in zip(free, (*TRUTH, 0.3), strict=True):
        assert fit[key].value == pytest.approx(truth, abs=4 * fit[key].standard_error + 3e-3 * truth)


def test_only_the_rows_of_the_chosen_segments_count():
    force, depth = contact(depth=RAMP)
    words = np.where(TIME < 1.5, "approach", np.where(TIME < 4, "hold", "retract"))
    spoilt = np.where(words == "retract", 3 * force, force)
    curve = ForceCurve("a", TIME, depth, spoilt, segment=list(words), prescribed="depth")
    fit = fit_indentation(curve, START, ZENER, segments=["approach", "hold"])
    assert [fit[key].value for key in ZENER] == pytest.approx(TRUTH, rel=5e-3)
    assert int(fit.curves[0].used.sum()) == int((words != "retract").sum())
    with pytest.raises(
        FitError, match="no row is left in the segments pause; it has approach, hold, retract"
    ):
        fit_indentation(curve, START, ZENER, segments=["pause"])


def test_a_fit_does_not_depend_on_the_fits_before_it():
    force, depth = contact(depth=RAMP)
    first = ForceCurve("a", TIME, depth, force + noise(7, 0.02 * force.max()))
    second = ForceCurve("b", TIME, depth, 5 * force + noise(8, 0.1 * force.max()))
    alone = [fit_indentation(each, START, ZENER[:2]) for each in (first, second)]
    again = [fit_indentation(each, START, ZENER[:2]) for each in (second, first)][::-1]
    for one, other in zip(alone, again, strict=True):
        assert [each.value for each in one.parameters] == [each.value for each in other.parameters]


def test_columns_of_a_file_name_segments_prescribed_quantity_and_base(tmp_path):
    path = tmp_path / "afm.csv"
    rows = [
        f"{t!r},{'approach' if t < 2.5 else 'retract'},{b!r},base,{max(b, 0.0)!r}"
        for t, b in zip(TIME.tolist(), RAMP.tolist(), strict=True)
    ]
    path.write_text("time,segment,height,prescribed,force\n" + "\n".join(rows))
    (entry,) = entries([path])
    with pytest.raises(TableError, match="has the base but no depth"):
        read_curve(entry)
    curve = read_curve(entry, options=FitOptions(stiffness=5.0, stiffness_error=0.1))
    assert [(each.name, each.prescribed) for each in curve.segments] == [
        ("approach", "base"),
        ("retract", "base"),
    ]
    assert curve.position_of_drive == pytest.approx(RAMP)
    assert curve.stiffness_error == 0.1
    assert len(str(curve.origin["sha256"])) == 64


def test_a_stiffness_in_a_file_has_the_units_of_its_columns(tmp_path):
    path = tmp_path / "curve.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("a")
        group.attrs["stiffness"] = 2.0  # uN/nm
        for name, values, unit in (
            ("time", TIME, "s"),
            ("base", 1e3 + RAMP, "nm"),
            ("force", np.maximum(RAMP, 0.0), "uN"),
        ):
            group[name] = values
            group[name].attrs["units"] = unit
    curve = read_curve(entries([path])[0])  # in SI
    assert curve.stiffness == pytest.approx(2e3, rel=1e-12)
    assert curve.position_of_drive == pytest.approx(1e-9 * (1e3 + RAMP), rel=1e-12)


def test_a_prescribed_depth_is_the_depth_with_a_known_stiffness_too():
    found = [
        Prediction(ForceCurve("a", TIME, RAMP, np.maximum(RAMP, 0), prescribed="depth", stiffness=stiffness))
        for stiffness in (None, 0.5)
    ]
    assert np.array_equal(*(each.corrected(Correction()) for each in found))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"prescribed": "base"}, "the base is prescribed, but the stiffness of the cantilever is missing"),
        ({"prescribed": "height"}, "prescribed is 'height'; it must be one of depth, force, base"),
        ({"prescribed": ["depth"]}, "prescribed has 1 values for 201 rows"),
        ({"segment": ["retract"] * 100 + ["approach"] * 101}, "out of order: retract comes before approach"),
        ({"segment": ["approach"] * 100 + ["retract"] * 50 + ["approach"] * 51}, "moves away"),
        (
            {"stiffness": 1.0, "prescribed": ["base"] * 100 + ["depth"] * 101},
            "prescribes the depth and the base; give one of them",
        ),
        ({"stiffness": -1.0}, "stiffness = -1.0; it must be > 0"),
        ({"stiffness_error": 0.1}, "stiffness_error is given without a stiffness"),
    ],
)
def test_impossible_segments_and_springs_are_named(change, message):
    with pytest.raises(FitError, match=message):
        ForceCurve("a", TIME, RAMP, np.maximum(RAMP, 0.0) ** 1.5, **change)


def test_one_word_counts_for_all_rows_and_a_retraction_may_stand_alone():
    down = np.linspace(0.2, 0.05, TIME.size)
    force = 16 / 3 * 5.0**0.5 * down**1.5  # Hertz's, G = 1, nu = 1/2
    columns = {"time": TIME, "depth": down, "force": force}
    words = {"prescribed": "force", "segment": "retract"}
    model = {key: START[key] for key in ("punch",)} | {
        "layer": {"thickness": math.inf, "material": {"model": "zener", "G0": 2.0, "Ginf": 2.0}}
    }
    for given, kind in ((columns | words, "force"), (ForceCurve("a", *columns.values()), "depth")):
        fit = fit_indentation(given, model, ["layer.material.G0"])
        segments = fit.curves[0].curve.segments
        assert segments[-1].name == "retract"
        assert {each.prescribed for each in segments} == {kind}
        assert fit["G0"].value == pytest.approx(1.0, rel=1e-3)  # of the straight pieces


def test_the_rows_of_the_chosen_segments_must_be_enough():
    names = ["approach"] * 196 + ["hold"] * 5
    curve = ForceCurve("a", TIME, 0.02 * TIME, TIME**1.5, prescribed="depth", segment=names)
    with pytest.raises(FitError, match="5 rows are too few for 3 free parameters"):
        fit_indentation(curve, START, ZENER, segments=["hold"])


def test_a_free_stiffness_needs_a_prescribed_base():
    curve = ForceCurve("a", TIME, RAMP, np.maximum(RAMP, 0.0) ** 1.5, prescribed="depth")
    with pytest.raises(ConfigError, match="stiffness: got a curve without a prescribed base"):
        fit_indentation(curve, START, [*ZENER, "stiffness"])


def test_swapped_columns_of_force_and_depth_are_named():
    force, depth = contact(depth=RAMP)
    curve = ForceCurve("a", TIME, force, 0.2 * depth / depth.max(), prescribed="force")
    assert curve.looks_swapped()
    assert not ForceCurve("a", TIME, depth, force).looks_swapped()
    fit = fit_indentation(curve, START | {"layer": START["layer"] | {"thickness": 50.0}}, ZENER[:1])
    assert any("are force and depth swapped" in warning for warning in fit.warnings)
