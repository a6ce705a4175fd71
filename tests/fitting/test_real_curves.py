"""Curves as instruments and people bring them: open models, units, missing times, masks, tilted baselines."""

import math

import numpy as np
import pandas
import pytest
import xarray

import gfmdlayer
from gfmdlayer import ForceCurve, fit_indentation
from gfmdlayer.fitting.measurement import FitError

R, E = 5e-6, 7000.0
ELASTIC = {"model": "elastic", "G": 1000.0}
SPHERE = {"shape": "parabola", "radius": R}
ON_HALFSPACE = {"layer": {"thickness": math.inf, "poisson": 0.5, "material": ELASTIC}, "punch": SPHERE}
FREE = ["layer.material.G"]


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
