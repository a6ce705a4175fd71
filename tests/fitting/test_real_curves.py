"""Curves as instruments and people bring them: open models, units, missing times, masks, tilted baselines."""

import math
import sys
from pathlib import Path

import h5py
import numpy as np
import pandas
import pytest
import xarray
from scipy.optimize import least_squares

import gfmdlayer
from gfmdlayer import ForceCurve, cli, fit_indentation
from gfmdlayer.fitting.curve_files import entries, read_curve
from gfmdlayer.fitting.estimates import detect
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.fitting.result import ESTIMATORS

R, E = 5e-6, 7000.0
ELASTIC = {"model": "elastic", "G": 1000.0}
SPHERE = {"shape": "parabola", "radius": R}
ON_HALFSPACE = {"layer": {"thickness": math.inf, "poisson": 0.5, "material": ELASTIC}, "punch": SPHERE}
FREE = ["layer.material.G"]


KPA_UM = {"units": {"length": "um", "stress": "kPa", "time": "s"}}
IN_UM = KPA_UM | {
    "layer": {"thickness": math.inf, "poisson": 0.5, "material": ELASTIC | {"G": 1.0}},
    "punch": {"shape": "parabola", "radius": 1e6 * R},
}


def hertz(depth, modulus=E, poisson=0.5):
    """4/3 E/(1 - nu^2) R^(1/2) depth^(3/2)."""
    return 4 / 3 * modulus / (1 - poisson**2) * R**0.5 * np.maximum(depth, 0.0) ** 1.5


DEPTH = np.linspace(-1e-6, 0.3e-6, 400)
TIME = np.linspace(0.0, 1.0, 400)


def test_a_layer_lies_on_a_rigid_base_unless_the_model_says_otherwise_and_the_fit_says_so():
    thickness, time = 2e-6, np.linspace(0.0, 1.0, 100)
    body = gfmdlayer.bonded_layer(thickness, gfmdlayer.Prony(1000.0))  # rigid too
    depth = np.linspace(0.0, 0.3e-6, 100)
    found = gfmdlayer.indent(body, gfmdlayer.Parabola(radius=R), time, depth=depth, tolerance=1e-5)
    curve = ForceCurve("a", time, depth, np.interp(time, found.time, found.force), prescribed="depth")
    layer = {"thickness": thickness, "poisson": 0.5, "material": ELASTIC | {"G": 600.0}}
    fit = fit_indentation(curve, {"layer": layer, "punch": SPHERE}, FREE)
    assert fit["G"].value == pytest.approx(1000.0, rel=5e-3)  # 100 rows between the times of `indent`
    said = "the model leaves open, and the fit assumes: halfspace.shear_modulus = .inf (a rigid base)"
    assert said in fit.warnings
    given = fit_indentation(
        curve, {"layer": layer, "punch": SPHERE, "halfspace": {"shear_modulus": math.inf}}, FREE
    )
    assert given["G"].value == fit["G"].value
    assert not any("leaves open" in each for each in given.warnings)


def test_every_default_that_decides_a_number_is_said():
    curve = ForceCurve("a", TIME, DEPTH, hertz(DEPTH))
    layer = {"thickness": math.inf, "material": {"model": "zener", "G0": 1000.0, "Ginf": 1000.0}}
    fit = fit_indentation(curve, {"layer": layer, "punch": {"radius": R}}, ["layer.material.G0"])
    (said,) = (each for each in fit.warnings if "leaves open" in each)
    assert said.endswith("layer.poisson = 0.5, layer.material.tau = 1, punch.shape = parabola")


@pytest.fixture(scope="module")
def crooked():
    """A fit of a curve whose force grows faster than a sphere's, in um and nN."""
    force = 1e9 * hertz(DEPTH) * (1 + np.maximum(DEPTH, 0) / 1e-6)
    measured = force + 0.002 * force.max() * np.random.default_rng(1).standard_normal(DEPTH.size)
    return fit_indentation(ForceCurve("gel", TIME, 1e6 * DEPTH, measured), IN_UM, FREE, contact="detect")


def test_a_fit_prints_a_table_of_free_and_held_numbers_with_marked_intervals(crooked):
    lines = str(crooked).splitlines()
    assert lines[1].split() == "parameter value error 95 % interval unit".split()  # noqa: SIM905
    (free,) = (line.split() for line in lines if line.startswith("layer.material.G "))
    assert free[0::2][:1] == ["layer.material.G"]
    assert free[-3:] == ["*", "kPa", "free"]
    assert float(free[1]) == pytest.approx(crooked["G"].value, rel=1e-5)
    (held,) = (line.split() for line in lines if line.startswith("punch.radius"))
    assert held == ["punch.radius", "5", "um", "held"]
    assert any(line.startswith("* the model does not follow the curve; the largest shape") for line in lines)
    assert all(f"warning: {warning}" in lines for warning in crooked.warnings)
    page = crooked._repr_html_()
    assert page.count("<tr>") == 1 + 3 + 3  # headings; G, contact point, offset; thickness, nu, radius
    assert "does not follow" in page
    straight = fit_indentation(ForceCurve("gel", TIME, 1e6 * DEPTH, 1e9 * hertz(DEPTH)), IN_UM, FREE)
    assert straight.follows
    assert "*" not in str(straight)


def test_the_largest_shape_takes_most_of_the_residual_and_is_drawn(crooked, tmp_path):
    (curve,) = crooked.curves
    assert crooked.shape
    left = -curve.residual - curve.missing  # of noise of .002 of the largest force
    noise = 0.002 * curve.curve.force.max()
    assert np.std(left) < 1.2 * noise < 0.6 * np.std(curve.residual)
    figure = crooked.plot(tmp_path / "fit.png")
    texts = [
        text.get_text() for axes in figure.axes if (own := axes.get_legend()) for text in own.get_texts()
    ]
    assert crooked.shape in texts
    assert (tmp_path / "fit.png").stat().st_size > 0


def test_a_fit_is_a_dataset_that_can_be_stored(crooked, tmp_path):
    crooked.to_dataset().to_netcdf(tmp_path / "fit.nc", engine="h5netcdf")
    with xarray.open_dataset(tmp_path / "fit.nc", engine="h5netcdf") as data:
        G = data.sel(parameter="layer.material.G")
        assert [float(G.value), float(G.error)] == [crooked["G"].value, crooked["G"].error]
        assert (str(G.unit.values), data.force.attrs["units"]) == ("kPa", "nN")
        gel = data.sel(curve="gel")
        assert np.array_equal(gel.fitted_force - gel.force, gel.residual)


def test_lmfits_names_lead_to_the_numbers(crooked):
    G, radius = crooked.params["G"], crooked.params["punch.radius"]
    assert (G.value, G.stderr, G.vary, G.min, G.max) == (
        crooked["G"].value, crooked["G"].error, True, *crooked["G"].bounds,
    )  # fmt: skip
    assert (radius.value, radius.stderr, radius.vary) == (5.0, None, False)
    assert (crooked.ndata, crooked.nvarys, crooked.nfree) == (TIME.size, 3, TIME.size - 3)
    assert crooked.chisqr == pytest.approx(np.sum(crooked.curves[0].residual ** 2))
    assert crooked.redchi == pytest.approx(crooked.curves[0].noise ** 2)  # no noise is given
    assert crooked.best_values["contact_point"] == crooked["contact_point"].value
    with pytest.raises(KeyError, match=r"tau: must be one of layer.material.G"):
        crooked.params["tau"]


@pytest.mark.parametrize("kind", [float, int])
def test_masked_numbers_are_missing_and_not_the_values_below_the_mask(kind):
    masked = np.ma.masked_array((100 * np.ones((8, 8))).astype(kind), np.arange(64).reshape(8, 8) == 20)
    with pytest.raises(gfmdlayer.ConfigError, match=r"height at index \[2, 4\] is not a finite number"):
        gfmdlayer.solve(gfmdlayer.halfspace(1.0), masked, depth=0.01)
    time = np.arange(20.0)
    column = np.ma.masked_array((10 * time).astype(kind), time == 5)
    with pytest.raises(FitError, match="depth is not a finite number in row 6"):
        ForceCurve("a", time, column, time)
    body = gfmdlayer.halfspace(1.0)
    with pytest.raises(ValueError, match="time, depth: must be finite"):
        gfmdlayer.indent(body, gfmdlayer.Parabola(radius=1.0), time, depth=column)
    with pytest.raises(ValueError, match="radii and heights must be finite"):
        gfmdlayer.indent(body, (time, column), time, depth=time)
    with pytest.raises(gfmdlayer.ConfigError, match="history"):
        gfmdlayer.run({"name": "a", "grid": {"points": 64}}, history=(time, column))


def in_nm(kind):
    """Return the curve in s, nm and nN."""
    held = {"time": TIME, "depth": 1e9 * DEPTH, "force": 1e9 * hertz(DEPTH)}
    if kind == "curve":
        return ForceCurve("a", **held)
    if kind == "frame":
        return pandas.DataFrame(held)
    return xarray.Dataset({key: ("row", values) for key, values in held.items()}) if kind == "set" else held


@pytest.mark.parametrize("kind", ["curve", "mapping", "frame", "set"])
@pytest.mark.parametrize("model", [ON_HALFSPACE, IN_UM])
def test_units_are_those_of_columns_of_any_form(kind, model):
    fit = fit_indentation(in_nm(kind), model, FREE, units=("s", "nm", "nN"))
    assert fit["G"].value == pytest.approx(E / 3 * (1 if model is ON_HALFSPACE else 1e-3), rel=1e-4)


def test_columns_of_a_dataset_have_their_own_units_and_headings():
    columns = {"Indentation [nm]": 1e9 * DEPTH, "force": 1e9 * hertz(DEPTH), "t (ms)": 1e3 * TIME}
    held = xarray.Dataset({key: ("row", values) for key, values in columns.items()})
    held["force"].attrs["units"] = "nN"
    fit = fit_indentation(held, IN_UM, FREE)
    assert fit["G"].value == pytest.approx(1e-3 * E / 3, rel=1e-4)
    assert fit.curves[0].curve.time[-1] == pytest.approx(1.0)
    with pytest.raises(ValueError, match="'force' is in 'nN', but 'pN' is given for it"):
        fit_indentation(held, IN_UM, FREE, units={"force": "pN"})
    with pytest.raises(ValueError, match="force and depth with a unit, but time without"):
        fit_indentation(held.rename({"t (ms)": "time"}), IN_UM, FREE)


@pytest.mark.parametrize(
    ("own", "given", "message"),
    [
        (
            {"prescribed": "depth"},
            {"prescribed": "force"},
            "got prescribed = 'force', but the curve says depth",
        ),
        ({"stiffness": 0.1}, {"stiffness": 0.2}, "got stiffness = 0.2, but the curve says 0.1"),
    ],
)
def test_what_an_option_says_against_a_curve_is_refused(own, given, message):
    columns = {"time": TIME, "depth": DEPTH, "force": hertz(DEPTH)}
    with pytest.raises(FitError, match=message):
        fit_indentation(ForceCurve("a", **columns, **own), ON_HALFSPACE, FREE, **given)
    if "prescribed" in own:
        held = columns | {"prescribed": [own["prescribed"]] * TIME.size}
        with pytest.raises(FitError, match=message):
            fit_indentation(held, ON_HALFSPACE, FREE, **given)


def test_an_option_says_what_a_curve_leaves_open():
    bare = ForceCurve("a", TIME, DEPTH, hertz(DEPTH))
    fit = fit_indentation(bare, ON_HALFSPACE, FREE, prescribed="base", stiffness=0.1)
    assert {each.prescribed for each in fit.curves[0].curve.segments} == {"base"}
    assert fit.curves[0].curve.stiffness == 0.1


def test_an_elastic_fit_of_columns_in_memory_or_without_headings_needs_no_time(tmp_path):
    base = DEPTH + hertz(DEPTH) / 0.1
    held = {"base": base, "force": hertz(DEPTH)}
    fit = fit_indentation(held, ON_HALFSPACE, FREE, stiffness=0.1, prescribed="depth")
    assert fit["G"].value == pytest.approx(E / 3, rel=1e-4)
    path = tmp_path / "a.csv"
    path.write_text(
        "\n".join(f"{d!r},{f!r}" for d, f in zip(DEPTH.tolist(), hertz(DEPTH).tolist(), strict=True))
    )
    assert fit_indentation(path, ON_HALFSPACE, FREE)["G"].value == pytest.approx(E / 3, rel=1e-4)


def test_errors_are_in_the_units_of_the_values_as_tables_show_them():
    measured = hertz(DEPTH) + 1e-11 * np.random.default_rng(0).standard_normal(DEPTH.size)
    fit = fit_indentation(ForceCurve("a", TIME, DEPTH, measured), ON_HALFSPACE, [*FREE, "contact_point"])
    for each in fit.parameters:
        assert each.error == each.standard_error
        # of an interval that is narrow beside its value: 1.96 errors on each side
        assert np.ptp(each.interval) == pytest.approx(2 * 1.97 * each.error, rel=0.02)


def test_a_flat_curve_of_a_map_is_left_out_and_named(tmp_path):
    force = np.stack([hertz(DEPTH), np.zeros(DEPTH.size), hertz(DEPTH, 2 * E), hertz(DEPTH)])
    noise = 1e-12 * np.random.default_rng(1).standard_normal(force.shape)
    path = tmp_path / "map.h5"
    with h5py.File(path, "w") as file:
        file["time"], file["depth"] = TIME, np.tile(DEPTH, (4, 1))
        file["force"] = force + noise * (force.max(axis=1) > 0)[:, np.newaxis]
    fit = fit_indentation(path, ON_HALFSPACE, FREE, contact="detect")
    assert [each.curve.name for each in fit.curves] == ["map-0", "map-2", "map-3"]
    assert "left out: curve map-1: the force never changes" in fit.warnings
    with h5py.File(path, "r+") as file:  # a baseline of noise: no contact is found
        file["force"][1] = 1e-12 * np.random.default_rng(2).standard_normal(DEPTH.size)
        file["force"][1, 0] = 1e-11
    fit = fit_indentation(path, ON_HALFSPACE, FREE, contact="detect")
    assert len(fit.curves) == 3
    assert any(each.startswith("left out: curve map-1: ") for each in fit.warnings)


@pytest.mark.parametrize("tilt", [-0.05, 0.05, 0.5])
def test_a_tilted_baseline_is_no_contact_and_the_tilt_is_found(tilt):
    rng, force = np.random.default_rng(3), hertz(DEPTH)
    slope = tilt * force.max() / np.ptp(DEPTH)
    measured = force + slope * (DEPTH - DEPTH[0]) + 0.005 * force.max() * rng.standard_normal(DEPTH.size)
    curve = ForceCurve("a", TIME, DEPTH, measured, prescribed="depth")
    fit = fit_indentation(curve, ON_HALFSPACE, [*FREE, "tilt"], contact="detect")
    for key, truth in (("G", E / 3), ("tilt", slope), ("contact_point", 0.0)):
        assert abs(fit[key].value - truth) < 3 * fit[key].error  # one in 370 of each


def test_a_contact_point_is_found_in_noise_of_a_tenth_of_the_largest_force():
    # Noise reaches a quarter of the largest force far above the surface. The error is 4 % of the indentation.
    errors = []
    for seed in range(8):
        noisy = 0.1 * hertz(DEPTH).max() * np.random.default_rng(seed).standard_normal(DEPTH.size)
        errors.append(detect(ForceCurve("a", TIME, DEPTH, hertz(DEPTH) + noisy, prescribed="depth")).depth)
    assert np.sqrt(np.mean(np.square(errors))) < 0.15 * DEPTH[-1]


def test_hdf5_of_afmformats_asks_for_afmformats(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["software"] = "afmformats"
        file["0/force"] = hertz(DEPTH)
    if "afmformats" not in sys.modules:
        with pytest.raises(
            ValueError, match=r"a.h5: is of afmformats; first run pip install 'gfmdlayer\[afm\]'"
        ):
            entries([tmp_path / "a.h5"])


@pytest.mark.parametrize("heading", ["prescribed", "control"])
def test_a_column_of_text_names_the_prescribed_quantity(tmp_path, heading):
    path = tmp_path / "a.csv"
    rows = zip(TIME.tolist(), DEPTH.tolist(), hertz(DEPTH).tolist(), strict=True)
    lines = (f"{t!r},{d!r},{f!r},{'depth' if t < 0.5 else 'force'}" for t, d, f in rows)
    path.write_text(f"time,depth,force,{heading}\n" + "\n".join(lines))
    found = read_curve(entries([path])[0]).prescribed
    assert found == ["depth"] * 200 + ["force"] * 200


# In 1 % of noise the estimators of nanite have errors of .03 to .08 of the indentation, on relaxing curves.
# These have .05 to .17 on elastic ones.
@pytest.mark.parametrize("method", ESTIMATORS)
def test_a_contact_point_by_hand_is_settled_and_recorded(method):
    measured = hertz(DEPTH) + 0.01 * hertz(DEPTH).max() * np.random.default_rng(5).standard_normal(DEPTH.size)
    shifted = ForceCurve("a", TIME, DEPTH + 2e-6, measured, prescribed="depth")
    fit = fit_indentation(shifted, ON_HALFSPACE, FREE, contact=method)
    done = fit.curves[0].curve.origin["prepared"]
    assert abs(done["contact_point"] - 2e-6) < 0.18 * DEPTH[-1]
    assert fit.curves[0].curve.depth == pytest.approx(shifted.depth - done["contact_point"])
    assert f"contact: {method}" in str(fit)
    free = fit_indentation(shifted, ON_HALFSPACE, [*FREE, "contact_point"], contact=method)
    assert abs(free["contact_point"].value - 2e-6) < 4 * free["contact_point"].error  # starts there


def test_a_baseline_by_hand_leaves_the_modulus_of_the_contact():
    slope = 0.3 * hertz(DEPTH).max() / np.ptp(DEPTH)
    curve = ForceCurve("a", TIME, DEPTH, hertz(DEPTH) + 2e-9 + slope * DEPTH, prescribed="depth")
    fit = fit_indentation(curve, ON_HALFSPACE, FREE, baseline="tilt", contact="detect")
    assert fit["G"].value == pytest.approx(E / 3, rel=2e-3)
    done = fit.curves[0].curve.origin["prepared"]
    assert done["coefficients"] == pytest.approx([2e-9, slope], rel=1e-3)
    level = ForceCurve("a", TIME, DEPTH, hertz(DEPTH) + 2e-9, prescribed="depth")
    fit = fit_indentation(level, ON_HALFSPACE, FREE, baseline="offset", contact="detect")
    assert fit["G"].value == pytest.approx(E / 3, rel=2e-3)


def test_weights_and_a_range_take_what_is_wrong_near_the_contact_out_of_the_fit():
    near = np.exp(-((DEPTH / 0.05e-6) ** 2)) * 0.1 * hertz(DEPTH).max()  # as of adhesion or a rough surface
    curve = ForceCurve("a", TIME, DEPTH, hertz(DEPTH) + near, prescribed="depth")

    def error(**options):
        fit = fit_indentation(curve, ON_HALFSPACE, FREE, **options)
        return abs(fit["G"].value * 3 / E - 1), fit

    plain, _ = error()
    weighted, by_weight = error(weight=0.2e-6)
    ranged, by_range = error(range=(0.15e-6, 1e-6))
    assert weighted < 0.6 * plain
    assert ranged < 1e-3 * plain + 1e-3
    assert by_range.ndata == np.count_nonzero(DEPTH >= 0.15e-6)
    assert by_weight.curves[0].curve.origin["prepared"] == {"weight": 0.2e-6}
    with pytest.raises(
        gfmdlayer.ConfigError, match=r"range: got .*; must be two depths, the lower one first"
    ):
        fit_indentation(curve, ON_HALFSPACE, FREE, range=(1.0, 0.0))


def test_the_command_takes_the_steps_by_hand(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rows = zip(TIME.tolist(), DEPTH.tolist(), (hertz(DEPTH) + 1e-10).tolist(), strict=True)
    Path("a.csv").write_text("time,depth,force\n" + "\n".join(f"{t!r},{d!r},{f!r}" for t, d, f in rows))
    Path("m.yaml").write_text(
        "layer: {thickness: .inf, material: {model: elastic, G: 1000}}\n"
        "punch: {radius: 5.0e-6}\nfree: [layer.material.G]\n"
    )
    hand = ["--baseline", "offset", "--contact", "constant_polynomial", "--range=-1e-6:1e-6"]
    status = cli.main(
        ["fit-indentation", "a.csv", "--model", "m.yaml", "--out", "o", *hand, "--weight", "1e-7"]
    )
    assert status == 0
    out = capsys.readouterr().out
    assert "contact: constant_polynomial" in out
    assert "the fit assumes: layer.poisson = 0.5, punch.shape = parabola" in out


@pytest.mark.parametrize("prescribed", ["depth", "base"])
def test_a_force_that_is_not_hertzs_has_the_modulus_of_least_squares_under_what_is_prescribed(prescribed):
    """With the base prescribed, rows where the contact is stiffer than the cantilever count less."""
    stiffness, radius = 2.0, 5.0
    depth = np.linspace(-0.5, 0.5, 400)
    force = 12.0 * np.maximum(depth, 0.0) ** 1.8 + 0.005 * np.random.default_rng(4).standard_normal(400)
    base = depth + force / stiffness

    def hertz(modulus, below):
        return 16 / 9 * modulus * radius**0.5 * np.maximum(below, 0.0) ** 1.5

    def residuals(p, known):
        if known == "depth":
            return hertz(p[0], depth - p[1]) + p[2] - force
        at = base - p[1] - p[2] / stiffness  # the force without contact bends the cantilever too
        tried = np.linspace(0.0, 1.0, 4001)
        return hertz(p[0], np.interp(at, tried + hertz(p[0], tried) / stiffness, tried)) + p[2] - force

    plain = {
        known: least_squares(residuals, [2.0, 0.0, 0.0], x_scale=[1, 0.1, 0.1], args=(known,)).x[0]
        for known in ("depth", "base")
    }
    model = {
        "layer": {"thickness": float("inf"), "poisson": 0.5, "material": {"model": "elastic", "G": 1.0}},
        "punch": {"shape": "parabola", "radius": radius},
    }
    curve = ForceCurve("a", np.arange(400.0), depth, force, stiffness=stiffness, prescribed=prescribed)
    fit = fit_indentation(curve, model, ["layer.material.G"], contact="detect")
    assert 3 * fit["G"].value == pytest.approx(plain[prescribed], rel=0.01)
    assert abs(plain["base"] / plain["depth"] - 1) > 3 * 0.01  # farther apart than the fits from either
