"""Identification of layers from force curves: closed forms, intervals, warnings, and bad input."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from gfmdlayer import ConfigError, ForceCurve, cli, fit_indentation
from gfmdlayer.files.tables import Answers, TableError
from gfmdlayer.fitting.curve_files import entries, read_curve, units_of
from gfmdlayer.fitting.estimates import detect
from gfmdlayer.fitting.force_curve import StraightDrive
from gfmdlayer.fitting.indentation_report import comparison, write_report
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.fitting.prediction import Prediction
from gfmdlayer.fitting.problem import IndentationModel, LeastSquares, free_parameters
from gfmdlayer.fitting.result import FitOptions

RADIUS = 5.0
ZENER = ("layer.material.G0", "layer.material.Ginf", "layer.material.tau")
TIME = np.linspace(0.0, 4.0, 201)
MILLIMETRES = {"punch": {"shape": "parabola", "radius": 1e6 * RADIUS}}
RAMP_HOLD = np.interp(TIME, [0, 1, 4], [0, 0.2, 0.2])


def body(thickness=math.inf, base=math.inf, **material):
    values = {"G0": 1.0, "Ginf": 4.0, "tau": 0.7} | material
    return {
        "layer": {"thickness": thickness, "poisson": 0.5, "material": {"model": "zener", **values}},
        "halfspace": {"shear_modulus": base},
        "punch": {"shape": "parabola", "radius": RADIUS},
    }


def on_halfspace(time, ramp=0.2, **material):
    """F = (8/3) R^(1/2)/(1 - nu) int G(t - s) d(delta^(3/2)), as long as the contact does not shrink."""
    values = {"G0": 1.0, "Ginf": 4.0, "tau": 0.7} | material
    s = np.linspace(0, 1, 20001)  # of the ramp, of one second
    grown = np.diff((ramp * s) ** 1.5)
    middle = (s[1:] + s[:-1]) / 2
    relaxed, excess = values["G0"], values["Ginf"] - values["G0"]
    force = [
        np.sum(
            (relaxed + excess * np.exp(-np.maximum(t - middle, 0) / values["tau"]))[middle < t]
            * grown[middle < t]
        )
        for t in time
    ]
    return 8 / 3 * RADIUS**0.5 / 0.5 * np.array(force)


def curve(force, depth=RAMP_HOLD, name="a", **more):
    return ForceCurve(name, TIME, depth, force, **more)


def noisy(seed, level=0.01):
    clean = on_halfspace(TIME)
    return clean + level * clean.max() * np.random.default_rng(seed).standard_normal(clean.size)


def test_hertz_gives_the_shear_modulus():
    # F = (8/3) G R^(1/2) delta^(3/2)/(1 - nu) to the precision of the solver's interpolation in time, 1e-3.
    ramp = np.linspace(0, 0.2, TIME.size)
    fit = fit_indentation(
        curve(8 / 3 * 7.0 * RADIUS**0.5 * ramp**1.5 / 0.5, ramp), body(Ginf=1.0), ["layer.material.G0"]
    )
    assert fit["G0"].value == pytest.approx(7.0, rel=1e-3)


def test_the_hereditary_integral_gives_moduli_and_time():
    # On a halfspace with a growing contact, from starts a factor of 3 off.
    fit = fit_indentation(curve(on_halfspace(TIME)), body(G0=3.0, Ginf=5.0, tau=2.0), ZENER)
    found = [fit[key].value for key in ZENER]
    assert found == pytest.approx([1.0, 4.0, 0.7], rel=2e-3)


def test_the_intervals_hold_the_truth_as_often_as_they_say():
    # 12 draws of three parameters: fewer than 29 of 36 within 95 % has a probability below 1e-3.
    truth = np.array([1.0, 4.0, 0.7])
    held = 0
    for seed in range(12):
        fit = fit_indentation(curve(noisy(seed)), body(), ZENER)
        ends = np.array([fit[key].interval for key in ZENER])
        held += int(np.sum((ends[:, 0] < truth) & (truth < ends[:, 1])))
    assert held >= 29


def test_profile_and_linear_intervals_agree_where_the_problem_is_nearly_linear():
    fit = fit_indentation(curve(noisy(1)), body(), ZENER, profile=True)
    for each in fit.parameters:
        assert each.profile is not None
        width = each.interval[1] - each.interval[0]
        # both ends are found to 2 % of the half width; the curvature of the model is of order of the error
        assert each.profile == pytest.approx(each.interval, abs=0.1 * width)


def test_the_last_modulus_follows_from_eulers_theorem():
    model = IndentationModel(body(thickness=1.0))
    parameters = free_parameters(model, ZENER, ["a"], {})
    problem = LeastSquares(model, parameters, [Prediction(curve(noisy(0)))])
    u = problem.start
    exact = problem.jacobian(u)[:, 1]
    step = 1e-3  # central differences, of error step^2
    moved = np.array([0.0, step, 0.0])
    by_differences = (problem.residuals(u + moved) - problem.residuals(u - moved)) / (2 * step)
    # the exact column is the force less the other columns, which are forward differences of step 5e-3
    assert np.abs(exact - by_differences).max() < 5e-3 * np.abs(exact).max()


def test_a_fit_warns_that_the_data_do_not_determine_a_time_shorter_than_the_ramp():
    force = on_halfspace(TIME, tau=1e-4)
    force += 0.05 * force.max() * np.random.default_rng(3).standard_normal(force.size)
    fit = fit_indentation(
        curve(force), body(tau=1e-3), {ZENER[0]: None, ZENER[1]: [1.5, 100.0], ZENER[2]: [1e-5, 1e-2]}
    )
    assert any("determine" in warning or "limit" in warning for warning in fit.warnings)


def test_a_thickness_and_a_modulus_that_a_small_contact_cannot_tell_apart():
    ramp = np.linspace(0, 0.002, TIME.size)
    force = 8 / 3 * RADIUS**0.5 * ramp**1.5 / 0.5
    force += 0.02 * force.max() * np.random.default_rng(0).standard_normal(force.size)
    fit = fit_indentation(
        curve(force, ramp),
        body(thickness=3.0, Ginf=1.0),
        {"layer.material.G0": None, "layer.thickness": [0.3, 30.0]},
    )
    assert any(warning.startswith("layer.thickness") for warning in fit.warnings)


def test_curves_share_a_material_and_have_contact_points_of_their_own():
    shifts = {"a": 0.01, "b": -0.02}
    curves = [
        ForceCurve(name, TIME, RAMP_HOLD + shift, on_halfspace(TIME) * (1 + 1e-4 * np.sin(40 * TIME)))
        for name, shift in shifts.items()
    ]
    fit = fit_indentation(curves, body(), [*ZENER, "contact_point"])
    for name, shift in shifts.items():
        # 1e-3 of the force is 1e-3/1.5 of the depth
        assert fit[f"contact_point[{name}]"].value == pytest.approx(shift, abs=1e-3 * 0.2)
    assert [fit[key].value for key in ZENER] == pytest.approx([1.0, 4.0, 0.7], rel=1e-2)


def test_a_drift_is_found_beside_the_moduli():
    drifting = curve(on_halfspace(TIME), RAMP_HOLD + 0.004 * TIME)
    fit = fit_indentation(drifting, body(), [*ZENER, "drift"])
    assert fit["drift"].value == pytest.approx(0.004, abs=1e-4)


def test_outliers_pull_a_robust_fit_less():
    force = noisy(5)
    force[::15] += 0.5 * force.max()
    plain = fit_indentation(curve(force), body(), ZENER)
    robust = fit_indentation(curve(force), body(), ZENER, loss="cauchy")
    assert abs(robust["Ginf"].value / 4 - 1) < 0.02 < abs(plain["Ginf"].value / 4 - 1)


def test_information_criteria_prefer_the_law_that_made_the_curve():
    data = curve(noisy(2))
    fits = {
        "zener": fit_indentation(data, body(), ZENER),
        "elastic": fit_indentation(data, body(Ginf=1.0), ["layer.material.G0"]),
    }
    assert comparison(fits)[1].startswith("zener")
    assert fits["zener"].aic < fits["elastic"].aic


def test_the_contact_point_of_a_noisy_curve_is_within_its_error():
    depth = np.linspace(-0.1, 0.2, 600)
    rng = np.random.default_rng(4)
    force = 8 / 3 * RADIUS**0.5 * np.maximum(depth, 0.0) ** 1.5 / 0.5
    force += 0.3 + 0.005 * force.max() * rng.standard_normal(force.size)
    found = detect(ForceCurve("a", np.linspace(0, 1, 600), depth + 0.5, force))
    assert found.depth == pytest.approx(0.5, abs=4 * found.error)
    assert 0 < found.error < 0.01
    assert found.offset == pytest.approx(0.3, abs=0.01)


def test_detection_carries_its_uncertainty_into_the_moduli():
    time = np.concatenate((np.linspace(-0.5, 0, 50, endpoint=False), TIME))
    depth = np.concatenate((np.linspace(-0.1, 0, 50, endpoint=False), RAMP_HOLD))
    clean = np.concatenate((np.zeros(50), on_halfspace(TIME)))
    force = clean + 0.01 * clean.max() * np.random.default_rng(6).standard_normal(clean.size)
    known = fit_indentation(ForceCurve("a", time, depth, force), body(), ZENER)
    found = fit_indentation(ForceCurve("a", time, depth + 0.3, force + 0.2), body(), ZENER, contact="detect")
    assert found["contact_point"].value == pytest.approx(0.3, abs=4 * found["contact_point"].error)
    assert found["Ginf"].error > 1.2 * known["Ginf"].error


def test_a_noisy_depth_is_reduced_to_its_straight_pieces():
    depth = RAMP_HOLD + 1e-3 * np.random.default_rng(0).standard_normal(TIME.size)
    drive = StraightDrive.of(TIME, depth, np.full(TIME.size, 3e-4 * np.ptp(depth)))
    assert drive.time.size <= 6
    assert drive.error == pytest.approx(1e-3, rel=0.2)
    assert np.abs(np.interp(TIME, drive.time, drive.value) - RAMP_HOLD).max() < 2e-3


def test_a_bend_within_the_noise_of_single_rows_stays_in_the_pieces():
    time, noise = np.linspace(0.0, 1.0, 2000), 0.01
    bend = time + 3 * noise * time**2  # 3/4 of the noise from the straight line
    rows = bend + noise * np.random.default_rng(5).standard_normal(time.size)
    drive = StraightDrive.of(time, rows, np.full(time.size, 3e-4))
    away = np.interp(time, drive.time, drive.value) - bend
    # Halving a piece takes 15/16 of the squares of its bend: less than 20 variances, else it is halved.
    # Beside these are the errors of the corners, values and times, about two variances each.
    pieces = drive.time.size - 1
    assert np.sum(away**2) < (20 * 16 / 15 * pieces + 2 * 2 * (pieces + 1)) * noise**2
    assert pieces < 8


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force": np.where(TIME[7] == TIME, np.nan, TIME)}, "force is not a finite number in row 8"),
        ({"time": TIME[::-1]}, "time does not increase"),
        ({"time": TIME[:-1]}, "200 of time, 201 of depth"),
        ({"time": [], "depth": [], "force": []}, "has 0 rows; a fit needs at least 8"),
        ({"depth": 0 * TIME}, "depth never changes"),
        ({"force": 0 * TIME}, "the force never changes"),
        ({"noise": -1.0}, "noise = -1.0; it must be > 0"),
        ({"depth": [[1.0]]}, "depth has 2 dimensions"),
        ({"depth": ["one"]}, "depth cannot be read as numbers"),
    ],
)
def test_columns_that_cannot_be_used_are_named(change, message):
    given = {"time": TIME, "depth": RAMP_HOLD, "force": on_halfspace(TIME)} | change
    with pytest.raises(FitError, match=message):
        ForceCurve("a", **given)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda c: replace(c, depth=30 * c.depth), "more than the thickness 1 of the layer"),
        (lambda c: replace(c, force=1e9 * c.force), "instead of .* Do force, depth, punch and moduli"),
        (
            lambda c: ForceCurve("a", TIME[:8] + 1, RAMP_HOLD[40:48], c.force[40:48]),
            "8 rows are too few for 5 free",
        ),
    ],
)
def test_curves_impossible_for_the_model_are_rejected(make, message):
    free = [*ZENER, "contact_point", "drift"]
    with pytest.raises(FitError, match=message):
        fit_indentation(make(curve(on_halfspace(TIME))), body(thickness=1.0), free)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda c: replace(c, force=1e3 * c.force), "Do force, depth, punch and moduli have the same units"),
        (lambda c: replace(c, depth=1.0 * c.depth, time=1.0 * c.time, force=c.force[::-1].copy()),
         "residuals"),
        (lambda c: ForceCurve("a", *(np.delete(x, slice(20, 45)) for x in (c.time, c.depth, c.force))),
         "gap of 0.52 after row 20"),
    ],
)  # fmt: skip
def test_a_fit_warns_about_odd_curves(make, message):
    fit = fit_indentation(
        make(curve(on_halfspace(TIME))), body(), {ZENER[0]: [1e-3, 1e9], ZENER[1]: [1e-3, 1e9]}
    )
    assert any(message in warning for warning in fit.warnings), fit.warnings


@pytest.mark.parametrize(
    ("free", "message"),
    [
        (["layer.material.GO"], "did you mean 'G0'|did you mean 'layer.material.G0'"),
        (["layer.thickness"], "the start is .inf; it must be > 0 and finite"),
        ({"layer.material.G0": [2.0, 3.0]}, "the start 1 is not between 2 and 3"),
        ({"layer.material.G0": [3.0, 2.0]}, "bounds are 3 and 2; give 0 < low < high"),
        ([], "free: name at least one parameter"),
        ([3], "free: got 3; must be a dotted key"),
        ([["layer.material.G0"]], "must be a dotted key"),
        ({"layer.material.G0": [1, 2, 3]}, r"free: layer.material.G0: got \[1, 2, 3\]; give two finite"),
        ({"layer.material.G0": "1:2"}, "give two finite numbers"),
        ({"layer.material.G0": [1, math.inf]}, "give two finite numbers"),
    ],
)
def test_parameters_that_cannot_be_free_are_refused(free, message):
    with pytest.raises(ConfigError, match=message):
        fit_indentation(curve(on_halfspace(TIME)), body(), free)


def test_models_of_foreign_keys_are_refused():
    with pytest.raises(ConfigError, match="trajectory: unknown key"):
        fit_indentation(curve(on_halfspace(TIME)), body() | {"trajectory": {}}, ZENER)
    with pytest.raises(ConfigError, match=r"fre: unknown key.*did you mean 'free'"):
        fit_indentation(curve(on_halfspace(TIME)), body() | {"fre": ZENER})


def test_a_radius_in_other_units_than_the_thickness_is_refused():
    with pytest.raises(FitError, match=r"1.*thicknesses of the layer.*all lengths in the same unit"):
        fit_indentation(curve(on_halfspace(TIME)), body(thickness=1.0) | MILLIMETRES, ZENER)


def test_curves_of_the_same_name_are_refused():
    data = curve(on_halfspace(TIME))
    with pytest.raises(FitError, match=f"curve {data.name}: this name is given twice"):
        fit_indentation([data, data], body(), [*ZENER, "contact_point"])


def test_text_files_tell_their_units(tmp_path):
    path = tmp_path / "gel.csv"
    rows = "\n".join(f"{5 * i},{i},{1000 * i * i}" for i in range(20))
    path.write_text(f"Force (pN),time [ms],Indentation / nm\n{rows}\n")
    found = read_curve(entries([path])[0])
    assert found.time[1] == pytest.approx(1e-3)
    assert found.force[1] == pytest.approx(5e-12)
    assert found.depth[1] == pytest.approx(1e-6)


def test_curves_are_read_into_the_units_of_the_model(tmp_path):
    path = tmp_path / "gel.csv"
    rows = "\n".join(f"{i},{i},{i}" for i in range(20))
    path.write_text(f"time (ms),depth (nm),force (nN)\n{rows}\n")
    units = {"length": "um", "stress": "kPa", "time": "s"}  # kPa um^2 = nN
    model = IndentationModel(body() | {"units": units})
    found = read_curve(entries([path])[0], into=units_of(model.config.units))
    assert [found.time[1], found.depth[1], found.force[1]] == pytest.approx([1e-3, 1e-3, 1.0])


@pytest.mark.parametrize(
    ("head", "units", "message"),
    [
        ("time (s),depth (nm),force", {}, "time has a unit, but force has none; give both, or neither"),
        ("time (s),depth (nN),force (nN)", {}, "'nN', which is no unit of depth"),
        ("time,width,force", {}, "no column is named depth"),
        ("time,depth,depth", {}, "two columns are named depth"),
        ("time,depth,force", {"time": "s", "depth": "nm", "force": "kg"}, "is in 'kg', which is no unit of"),
    ],
)
def test_units_and_headings_that_are_unknown_are_refused(tmp_path, head, units, message):
    path = tmp_path / "gel.csv"
    path.write_text(head + "\n" + "\n".join(f"{i},{i},{i}" for i in range(20)))
    with pytest.raises(TableError, match=message):
        read_curve(entries([path])[0], Answers(units=tuple(units.items())))


def test_hdf5_holds_one_curve_or_many_or_groups(tmp_path):
    with h5py.File(tmp_path / "rows.h5", "w") as h5:
        h5["time"], h5["depth"], h5["force"] = TIME, np.stack([RAMP_HOLD] * 3), np.stack([TIME] * 3)
        h5["force"][2, 150:] = np.nan
        h5["depth"][2, 150:] = np.nan
        h5["x"], h5["y"] = [0.0, 1.0, 2.0], [5.0, 5.0, 5.0]
    with h5py.File(tmp_path / "groups.h5", "w") as h5:
        for name in ("left", "right"):
            group = h5.create_group(name)
            group["time"], group["depth"], group["force"] = TIME, RAMP_HOLD, TIME
            group["depth"].attrs["units"], group["time"].attrs["units"] = "um", "s"
            group["force"].attrs["units"] = "uN"
    rows = entries([tmp_path / "rows.h5"])
    assert [each.name for each in rows] == ["rows-0", "rows-1", "rows-2"]
    assert rows[1].position == (1.0, 5.0)
    assert read_curve(rows[2]).time.size == 150
    groups = entries([tmp_path / "groups.h5"])
    assert [each.name for each in groups] == ["left", "right"]
    left = read_curve(groups[0])
    assert left.depth.max() == pytest.approx(0.2e-6)
    said = "time [s] -> time [s], depth [um] -> depth [m], force [uN] -> force [N]"
    assert left.origin["account"] == f"groups.h5, curve left: {left.time.size} rows, {said}"


@pytest.mark.parametrize("name", ["curve", "curve.asc", "curve.CSV", "curve.force"])
def test_the_contents_of_a_file_say_what_it_is(name, tmp_path):
    path = tmp_path / name
    path.write_text(
        "\n".join(["time [ms];depth [nm];force [nN]", *(f"{k},5;{k},25;{k},75" for k in range(9))]),
        encoding="utf-16",
    )
    curve = read_curve(*entries([path]))
    assert (curve.time[1], curve.depth[1], curve.force[1]) == (1.5e-3, 1.25e-9, 1.75e-9)
    with h5py.File(path, "w") as h5:
        h5["time"], h5["depth"], h5["force"] = TIME, RAMP_HOLD, TIME
    assert read_curve(*entries([path])).depth.tolist() == RAMP_HOLD.tolist()


def test_curves_of_the_same_name_in_two_files_keep_their_places(tmp_path):
    for folder in ("left", "right"):
        (tmp_path / folder).mkdir()
        with h5py.File(tmp_path / folder / "map.h5", "w") as h5:
            h5["time"], h5["depth"], h5["force"] = TIME, np.stack([RAMP_HOLD] * 2), np.stack([TIME] * 2)
            h5["x"], h5["y"] = [0.0, 1.0], [5.0, 5.0]
    found = entries([tmp_path / "left", tmp_path / "right"])
    assert len({each.name for each in found}) == 4
    assert [each.position for each in found] == [(0.0, 5.0), (1.0, 5.0)] * 2


class AfmCurve(dict):
    """A curve as afmformats has it: columns by name, and metadata."""

    columns = property(lambda self: list(self))
    metadata: dict[str, float] = {"spring constant": 0.05, "position x": 1.0, "position y": 2.0, "enum": 3}  # noqa: RUF012


def test_afm_formats_give_the_depth_of_the_tip(tmp_path, monkeypatch):
    path = tmp_path / "map.jpk-force"
    path.write_bytes(b"PK\3\4")
    force = TIME * 1e-9
    curves = [AfmCurve(time=TIME, force=force) | {"height (measured)": -1e-6 * TIME}]
    made = [AfmCurve(each) for each in curves]
    monkeypatch.setitem(sys.modules, "afmformats", SimpleNamespace(load_data=lambda _: made))
    (entry,) = entries([path])
    assert (entry.name, entry.position) == ("map-3", (1.0, 2.0))
    # the base sinks by the height, the cantilever bends back by F/k
    curve = read_curve(entry, into=("s", "um", "N"))
    assert curve.depth == pytest.approx(TIME - force * 1e6 / 0.05)
    said = "time [s] -> time [s], depth [m] -> depth [um], force [N] -> force [N]"
    assert curve.origin["account"] == f"map-3 by afmformats: {TIME.size} rows, {said}"
    made[0].pop("height (measured)")
    with pytest.raises(TableError, match="no tip position"):
        read_curve(entry)


class MissingMetaDataError(BaseException):
    """As afmformats has it: of no class that `except Exception` takes."""

    def __init__(self, meta_keys):
        super().__init__(f"Missing meta data: {meta_keys}")
        self.meta_keys = meta_keys


@pytest.fixture
def uncalibrated(tmp_path, monkeypatch):
    """A file of a .csv format of afmformats, whose curve has no calibration and no time."""
    path = tmp_path / "curve.csv"
    path.write_text("File Format: 3\n")

    def load_data(_path, meta_override=None):
        if not meta_override:
            raise MissingMetaDataError(["sensitivity", "spring constant"])
        volts = np.maximum(RAMP_HOLD, 0) * 1e3
        force = volts * meta_override["sensitivity"] * meta_override["spring constant"]
        curve = AfmCurve(force=force) | {"height (measured)": -1e-6 * RAMP_HOLD}
        made = AfmCurve(curve)
        made.metadata = dict(meta_override)
        return [made]

    def get_recipe(path):
        if path.read_text() != "File Format: 3\n":
            raise MissingMetaDataError([])

    errors = SimpleNamespace(MissingMetaDataError=MissingMetaDataError)
    formats = SimpleNamespace(get_recipe=get_recipe)
    module = SimpleNamespace(load_data=load_data, errors=errors, formats=formats)
    monkeypatch.setitem(sys.modules, "afmformats", module)
    monkeypatch.setitem(sys.modules, "afmformats.formats", formats)
    return path


def test_a_format_of_afms_comes_first_and_options_fill_what_it_lacks(uncalibrated):
    (entry,) = entries([uncalibrated])
    with pytest.raises(TableError, match=r"the sensitivity \(--sensitivity\) and the spring constant"):
        read_curve(entry)
    into = ("ms", "um", "nN")
    options = FitOptions(stiffness=50.0, sensitivity=0.02)  # nN/um, um/V
    with pytest.raises(TableError, match="has no time, but the model relaxes"):
        read_curve(entry, into=into, options=options)
    found = read_curve(entry, into=into, options=options, timeless=True)
    force = np.maximum(RAMP_HOLD, 0) * 1e3 * 0.02 * 50.0
    assert found.force == pytest.approx(force)
    assert found.depth == pytest.approx(RAMP_HOLD - force / 50.0)
    assert found.time[:2].tolist() == [0, 1]
    timed = read_curve(entry, into=into, options=replace(options, sampling=10.0))
    assert timed.time[1] == pytest.approx(0.1)
    uncalibrated.write_text("time,depth,force\n" + "\n".join(f"{i},{i},{i}" for i in range(20)))
    assert read_curve(entries([uncalibrated])[0]).time.size == 20  # of no AFM: a table


def test_errors_that_are_no_exceptions_are_words(uncalibrated, monkeypatch):
    def fails(_path, **_options):
        raise MissingMetaDataError(["imaging mode"])

    monkeypatch.setattr(sys.modules["afmformats"], "load_data", fails)
    with pytest.raises(TableError, match=r"curve.csv: cannot be read by afmformats \(MissingMetaDataError: "):
        entries([uncalibrated])


def test_a_baseline_below_zero_needs_a_free_offset():
    force = on_halfspace(TIME)
    data = ForceCurve("low", TIME, RAMP_HOLD, force - 1.5 * force.max())
    with pytest.raises(FitError, match=r"no force is positive.* Is the baseline below zero"):
        fit_indentation(data, body(), ZENER)
    fit = fit_indentation(data, body(), [*ZENER, "force_offset"])
    # The tolerance of the marches.
    assert fit["force_offset"].value == pytest.approx(-1.5 * force.max(), rel=1e-3)


@pytest.mark.slow
def test_a_gel_in_decimal_commas_has_the_moduli_of_the_points():
    model = {
        "units": {"length": "m", "stress": "Pa", "time": "s"},
        "layer": {"thickness": 2e-6, "material": {"model": "zener", "G0": 1e3, "Ginf": 3e3, "tau": 1.0}},
        "halfspace": {"shear_modulus": math.inf},
        "punch": {"shape": "sphere", "radius": 5e-6},
    }
    fit = fit_indentation(Path(__file__).with_name("gel_commas.csv"), model, ZENER, contact="detect")
    # With decimal points the fit gives 416 and 1489, with standard errors of 1 %.
    assert [fit["G0"].value, fit["Ginf"].value] == pytest.approx([416, 1489], rel=2e-3)


def test_an_elastic_fit_needs_no_time(tmp_path):
    path = tmp_path / "curve.csv"
    depth = np.linspace(0.0, 0.1, 50)
    force = 8 / 3 * 7.0 * 5.0**0.5 * depth**1.5 / (1 - 0.5)  # Hertz
    path.write_text(
        "depth;force\n" + "\n".join(f"{d:.9g};{f:.9g}" for d, f in zip(depth, force, strict=True))
    )
    layer = {"thickness": math.inf, "material": {"model": "elastic", "young": 3.0}}
    model = {"layer": layer, "punch": {"shape": "parabola", "radius": 5.0}}
    fit = fit_indentation(path, model, ["layer.material.young"])
    assert fit["young"].value == pytest.approx(21.0, rel=1e-6)  # 3 G; nine digits
    assert "rows count as times" in fit.curves[0].curve.origin["account"]
    relaxes = model | {"layer": layer | {"material": {"model": "zener"}}}
    with pytest.raises(TableError, match="has no time, but the model relaxes"):
        fit_indentation(path, relaxes, ["layer.material.G0"])


def test_decimal_commas_semicolons_and_units_give_the_numbers_of_points(tmp_path):
    columns = TIME, RAMP_HOLD, np.maximum(on_halfspace(TIME), 0)
    points, commas = tmp_path / "points.csv", tmp_path / "commas.csv"
    rows = [[f"{value:.6f}" for value in row] for row in zip(*columns, strict=True)]
    points.write_text("time,depth,force\n" + "\n".join(map(",".join, rows)))
    german = [[f"{1e3 * float(t):.3f}", d, f] for t, d, f in rows]
    text = "Zeit (ms);Eindringtiefe (um);Kraft (nN)\n" + "\n".join(map(";".join, german)).replace(".", ",")
    commas.write_text(text, encoding="utf-16")
    one, two = (read_curve(entries([path])[0], into=("s", "um", "nN")) for path in (points, commas))
    for key in ("time", "depth", "force"):
        np.testing.assert_allclose(getattr(two, key), getattr(one, key), rtol=1e-14)
    assert "decimal mark ','" in two.origin["account"]


def test_newtons_for_nanonewtons_are_refused_with_a_free_offset_too():
    time = np.concatenate((np.linspace(-0.5, 0, 50, endpoint=False), TIME))
    depth = np.concatenate((np.linspace(-0.1, 0, 50, endpoint=False), RAMP_HOLD))
    force = np.concatenate((np.zeros(50), on_halfspace(TIME))) + 0.5
    with pytest.raises(FitError, match="Do force, depth, punch and moduli have the same units"):
        fit_indentation(ForceCurve("a", time, depth, 1e9 * force), body(), ZENER, contact="detect")


def test_a_report_is_a_configuration_and_the_same_numbers(tmp_path):
    from gfmdlayer import load

    fit = fit_indentation(curve(noisy(1)), body(), ZENER)
    lines = write_report(fit, tmp_path / "gel")
    config = load(tmp_path / "gel.yaml")
    assert pytest.approx(fit["G0"].value, rel=1e-12) == config.layer.material.G0
    (tmp_path / "use.yaml").write_text("name: use\nlayer: {material: {file: gel.yaml}}\n")
    assert load(tmp_path / "use.yaml").layer.material == config.layer.material
    assert {"gel.yaml", "gel.json", "gel.png"} <= {path.name for path in tmp_path.iterdir()}
    assert any("layer.material.tau" in line for line in lines)


def test_the_command_fits_a_file_and_refuses_what_it_cannot(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("gel.csv").write_text(
        "time,depth,force\n"
        + "\n".join(f"{t!r},{d!r},{f!r}" for t, d, f in np.stack([TIME, RAMP_HOLD, noisy(0)], 1).tolist())
    )
    Path("model.yaml").write_text(
        "layer: {thickness: .inf, material: {model: zener, G0: 2, Ginf: 5, tau: 1}}\n"
        "punch: {shape: parabola, radius: 5}\nfree: [layer.material.G0, layer.material.Ginf]\n"
    )
    arguments = ["fit-indentation", "gel.csv", "--model", "model.yaml", "--out", "fit"]
    assert cli.main([*arguments, "--free", *ZENER[:2], f"{ZENER[2]}=0.01:10"]) == 0
    assert "layer.material.tau" in capsys.readouterr().out
    assert cli.main(arguments) == 2
    assert "fit.yaml: exists" in capsys.readouterr().err
    assert cli.main([*arguments, "--force", "--free", "layer.material.G0=a"]) == 2
    assert "KEY=LOW:HIGH" in capsys.readouterr().err
    Path("wrong.yaml").write_text("layer: {thickness: .inf}\npunch: {shape: parabola, radius: -5}\n")
    assert cli.main([*arguments, "--force", "--model", "wrong.yaml"]) == 2
    assert "wrong.yaml:2:34: punch.radius: got -5" in capsys.readouterr().err
    assert cli.main([*arguments, "--force", "--jobs", "2"]) == 2
    assert "--restart and --jobs: only of curves that are fitted one by one" in capsys.readouterr().err
