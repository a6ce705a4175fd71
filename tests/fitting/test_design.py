"""Expected intervals of proposed experiments, advice on a second curve, exports, and models for nanite."""

import json
import math

import h5py
import numpy as np
import pytest

import gfmdlayer.nanite
from gfmdlayer import ConfigError, ForceCurve, design_indentation, fit_indentation
from gfmdlayer.fitting.curve_files import entries, read_curve
from gfmdlayer.fitting.indentation_report import add_fit, comparison, write_report

MODEL = {
    "layer": {"thickness": 1.0, "material": {"model": "zener", "G0": 1.0, "Ginf": 4.0, "tau": 1.0}},
    "halfspace": {"shear_modulus": math.inf},
    "punch": {"shape": "sphere", "radius": 5.0},
}
ZENER = ["layer.material.G0", "layer.material.Ginf", "layer.material.tau"]
CREEP = {"time": [0, 1, 10], "force": [0, 1, 1], "depth_noise": 1e-3, "rows": 200}


def measured(plan, seed):
    """Return a curve of a plan with its noise."""
    (fit,) = design_indentation(plan, MODEL, ZENER).curves
    rng = np.random.default_rng(seed)
    depth = fit.curve.depth + plan.get("depth_noise", 0.0) * rng.standard_normal(fit.curve.time.size)
    force = fit.curve.force + plan.get("noise", 0.0) * rng.standard_normal(fit.curve.time.size)
    words = {"prescribed": fit.curve.segments[0].prescribed}
    return ForceCurve("second", fit.curve.time, depth, force, **words)


def test_the_expected_errors_are_the_scatter_of_fits():
    # Deviations of 4 fits over the expected errors: 12 correlated values, a mean square of 0.2 to 3.
    expected, squares = design_indentation(CREEP, MODEL, ZENER), []
    for seed in range(4):
        found = fit_indentation(measured(CREEP, seed), MODEL, ZENER)
        squares += [
            (math.log(found[key].value / expected[key].value) / expected[key].error * expected[key].value)
            ** 2
            for key in ZENER
        ]
        # The noise of a fit is estimated, and need not be white: up to 1.6 times as wide (test_noise).
        assert 0.75 < found["G0"].error / expected["G0"].error < 1.6
    assert 0.2 < np.mean(squares) < 3


def test_two_planned_curves_tell_more_than_each():
    free = [*ZENER, "layer.thickness"]
    sharp = CREEP | {"name": "sharp", "punch": {"shape": "sphere", "radius": 1.0}}
    alone = [design_indentation(each, MODEL, free)["thickness"].error for each in (CREEP, sharp)]
    assert design_indentation([CREEP, sharp], MODEL, free)["thickness"].error < min(alone) / 2**0.5


def test_a_shallow_curve_names_the_second_curve_that_gives_the_thickness():
    shallow = {"time": [0, 1, 5], "depth": [0, 0.002, 0.002], "noise": 2e-4, "rows": 200}
    fit = fit_indentation(measured(shallow, 0), MODEL, [*ZENER, "layer.thickness"])
    (advice,) = [each for each in fit.warnings if "second curve" in each]
    assert advice.startswith("layer.thickness: a second curve with a radius of 25 would give it")


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ({"time": [0, 1], "force": [0, 1]}, "depth_noise is missing"),
        ({"time": [0, 1], "depth": [0, 1]}, "plan 0: noise is missing"),
        ({"time": [0, 1], "base": [0, 1], "noise": 1.0}, "give the stiffness of the cantilever"),
        ({"time": [0, 1], "noise": 1.0}, "must have time and one of"),
        ({"time": [1, 0], "depth": [0, 1], "noise": 1.0}, "two or more finite corners"),
        ({"time": [0, math.nan], "depth": [0, 1], "noise": 1.0}, "two or more finite corners"),
        ({"time": [0, 1], "dept": [0, 1], "noise": 1.0}, "did you mean 'depth'"),
    ],
)
def test_impossible_plans_are_named(plan, message):
    with pytest.raises(ConfigError, match=message):
        design_indentation(plan, MODEL, ZENER)


def test_a_planned_curve_follows_its_model_and_a_base_may_be_as_stiff_as_the_unit():
    # A spring k under the base x and Hertz's force: k (x - d) = 16/3 G (R d^3)^(1/2), here for nu = 1/2.
    free, hertz = ["layer.material.G0"], 16 / 3 * 5**0.5
    model = MODEL | {"layer": {"thickness": math.inf, "material": {"model": "zener", "G0": 1.0, "Ginf": 1.0}}}
    model = {key: model[key] for key in ("layer", "punch")} | {"punch": {"shape": "parabola", "radius": 5.0}}
    for stiffness in (0.5, 1.0):
        plan = {"time": [0, 1], "base": [0, 0.1], "noise": 1e-3, "stiffness": stiffness}
        fit = design_indentation(plan, model, free)
        d = fit.curves[0].curve.depth[-1]
        assert stiffness * (0.1 - d) == pytest.approx(hertz * d**1.5, rel=1e-3)
        assert not any("residuals" in each for each in fit.warnings)  # there is no noise in a plan


def test_the_noise_of_a_fit_is_of_one_quantity_and_each_curve_has_its_group(tmp_path):
    plans = [CREEP | {"name": "noise"}, {"time": [0, 1], "depth": [0, 0.01], "noise": 0.5, "name": "a/b"}]
    fit = design_indentation(plans, MODEL, ZENER[:1])
    assert comparison({"model": fit})[1].split()[2] == "0.5"
    with h5py.File(tmp_path / "fit.h5", "w") as file:
        add_fit(file, fit)
        assert file["noise"][()] == 0.5
        assert {file[name].attrs["name"] for name in ("noise_", "a_b")} == {"noise", "a/b"}


def test_exports_have_every_input_and_can_be_fitted_again(tmp_path):
    path = tmp_path / "creep.csv"
    curve = measured(CREEP, 1)
    rows = np.column_stack((curve.time, curve.depth, curve.force)).tolist()
    path.write_text("time,depth,force\n" + "\n".join(",".join(map(repr, row)) for row in rows))
    fit = fit_indentation(path, MODEL, ZENER, prescribed="force")
    write_report(fit, tmp_path / "fit")
    numbers = json.loads((tmp_path / "fit.json").read_text())
    digest = read_curve(entries([path])[0]).origin["sha256"]
    assert numbers["curves"][0]["sha256"] == digest
    assert numbers["start"].keys() == set(ZENER)
    assert numbers["provenance"]["gfmdlayer_version"]
    with h5py.File(tmp_path / "fit.h5") as h5:
        assert h5["creep"].attrs["sha256"] == digest
        assert [key.decode() for key in h5["parameter"]] == ZENER
        assert h5["estimate"][:] == pytest.approx([each.value for each in fit.parameters])
        assert "zener" in h5.attrs["model"]
    for name in ("fit.csv", "fit.h5"):
        again = read_curve(entries([tmp_path / name])[0])
        assert again.segments == fit.curves[0].curve.segments
        assert (again.depth == curve.depth).all()


@pytest.mark.parametrize(("shape", "hertz"), [
    ("paraboloid", lambda E, R, d: 4 / 3 * E / (1 - 0.25) * R**0.5 * d**1.5),
    ("cone", lambda E, alpha, d: 2 * math.tan(math.radians(alpha)) / math.pi * E / (1 - 0.25) * d**2),
])  # fmt: skip
def test_nanite_models_of_thick_layers_are_hertzian_and_of_thin_ones_stiffer(shape, hertz):
    # A base at t changes the force by some R d/t^2 < 1e-8 of itself; interpolation over the depth 1e-5.
    force = gfmdlayer.nanite.model(shape).model_func
    size, delta = (10e-6, 25.0)[shape == "cone"], np.linspace(2e-6, -0.5e-6, 200)
    about = {"contact_point": 0.0, "baseline": 1e-10, ("alpha" if shape == "cone" else "R"): size}
    expected = hertz(3e3, size, np.maximum(-delta, 0.0)) + 1e-10
    assert force(delta, 3e3, 1.0, **about) == pytest.approx(expected, rel=3e-5)
    thin = force(delta, 3e3, 1e-6, **about)
    assert thin[-1] > 1.1 * expected[-1]
    # twice as thick and deep under a body twice as large: four times the force
    twice = {**about, "baseline": 0.0} | ({} if shape == "cone" else {"R": 2 * size})
    one = force(delta, 3e3, 1e-6, **{**about, "baseline": 0.0})
    assert force(2 * delta, 3e3, 2e-6, **twice) == pytest.approx(4 * one, rel=1e-4)
    gap = force(np.append(delta, np.nan), 3e3, 1e-6, **about)
    assert np.array_equal(gap, np.append(thin, np.nan), equal_nan=True)


def test_nanite_fits_its_hertz_modulus_with_a_thick_layer():
    nanite = pytest.importorskip("nanite")
    assert gfmdlayer.nanite.register() == ["layer_sphere", "layer_paraboloid", "layer_cone"]
    tip = np.linspace(1e-6, -0.4e-6, 400)
    models = nanite.model.models_available
    truth = models["hertz_para"].model(models["hertz_para"].get_parameter_defaults(), tip)
    given = models["layer_paraboloid"].get_parameter_defaults()
    given["t"].value = 1.0
    assert models["layer_paraboloid"].model(given, tip) == pytest.approx(truth, rel=3e-5)
    assert models["layer_paraboloid"].residual(given, tip, truth, weight_cp=False) == pytest.approx(
        0, abs=1e-14
    )
