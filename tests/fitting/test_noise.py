"""Fits of curves with long approaches, fast relaxation and correlated noise, and what their residuals say.

Forces are those of a paraboloid on a Zener halfspace, by an integral over the history of depth^(3/2) that is
exact on fine steps and shares nothing with the solver (Lee & Radok, J. Appl. Mech. 27 (1960) 438).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.signal import lfilter

from gfmdlayer import ForceCurve, fit_indentation
from gfmdlayer.arrays import FloatArray
from gfmdlayer.fitting.estimates import best_of
from gfmdlayer.fitting.intervals import mixture

RADIUS = 5.0
KEYS = ("layer.material.G0", "layer.material.Ginf", "layer.material.tau")
AR = 0.8  # correlation of neighbours


def relaxed_force(times: FloatArray, depth: FloatArray, G0: float, Ginf: float, tau: float) -> FloatArray:
    """Return the force at fine times, of depth^(3/2) that is linear between them."""
    shape, branch = np.maximum(depth, 0.0) ** 1.5, np.zeros(times.size)
    for i, step in enumerate(np.diff(times) / tau):
        branch[i + 1] = branch[i] * math.exp(-step) - (shape[i + 1] - shape[i]) * math.expm1(-step) / step
    factor = 8 / 3 * RADIUS**0.5 / (1 - 0.5)
    return factor * (G0 * shape + (Ginf - G0) * branch)


def ramp_hold(
    rows: int, ramp: float, end: float, G0: float, Ginf: float, tau: float, before: float = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return time, depth and force of a ramp to a depth of .1 and a hold, after an approach."""
    corners = [0.0, ramp, end], [-0.1 * before, 0.1, 0.1]
    start = ramp * before / (1 + before)
    times = np.linspace(0.0, end, rows)
    later = ramp + np.geomspace(1e-6 * end, end - ramp, 4000)
    fine = np.union1d(np.union1d(times, np.linspace(start, ramp, 8001)), later[later < end])
    force = relaxed_force(fine, np.interp(fine, *corners), G0, Ginf, tau)
    return times, np.interp(times, *corners), np.interp(times, fine, force)


def material(G0: float, Ginf: float, tau: float) -> dict[str, Any]:
    law = {"model": "zener", "G0": G0, "Ginf": Ginf, "tau": tau}
    layer = {"thickness": math.inf, "poisson": 0.5, "material": law}
    return {"layer": layer, "punch": {"shape": "parabola", "radius": RADIUS}}


@pytest.mark.parametrize(
    ("tau", "ramp", "end"),
    [
        (0.05, 0.5, 10.0),
        (0.02, 0.02, 10.0),
        (0.1, 0.1, 10.0),
        (0.5, 0.5, 10.0),
        (5.0, 0.5, 10.0),
        (0.02, 2.0, 10.0),
    ],
)
def test_a_relaxation_far_shorter_than_the_record_is_found(tau: float, ramp: float, end: float) -> None:
    """Within the interval, of which one in twenty may fail: here within twice its half width."""
    time, depth, force = ramp_hold(2001, ramp, end, 1.0, 4.0, tau)
    force = force + 3e-3 * force.max() * np.random.default_rng(2).standard_normal(time.size)
    fit = fit_indentation(
        ForceCurve("ramp", time, depth, force, prescribed="depth"), material(1, 4, tau), KEYS
    )
    for key, true in zip(KEYS, (1.0, 4.0, tau), strict=True):
        low, high = fit[key].interval
        assert abs(math.log(fit[key].value / true)) < math.log(high / low)  # twice the half width


@pytest.mark.parametrize("approach", [1.0, 10.0, pytest.param(50.0, marks=pytest.mark.slow)])
def test_a_long_approach_does_not_change_the_modulus(approach: float) -> None:
    """An exact curve of Hertz: lengths in um, E = 7000, .3 um of indentation."""
    depth = np.linspace(-approach, 0.3, 2000)
    force = 4 / 3 * 7000 / 0.75 * RADIUS**0.5 * np.maximum(depth, 0.0) ** 1.5
    curve = ForceCurve("hertz", np.linspace(0.0, 1.0, 2000), depth, force, prescribed="depth")
    fit = fit_indentation(curve, material(1000.0, 2000.0, 0.1), KEYS[:2], contact="detect")
    assert 3 * fit["Ginf"].value == pytest.approx(7000, rel=1e-3)
    assert 3 * fit["G0"].value == pytest.approx(7000, rel=0.03)  # contact lasts .003 of the curve, 6e-4 tau
    assert fit["contact_point"].value == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("approach", [10.0, pytest.param(50.0, marks=pytest.mark.slow)])
def test_a_cantilever_that_bends_gives_the_modulus_after_a_long_approach(approach: float) -> None:
    base, spring, factor = np.linspace(-approach, 0.6, 3000), 1e4, 4 / 3 * 7000 / 0.75 * RADIUS**0.5
    depth = np.array(
        [
            x if x <= 0 else brentq(lambda d, x=x: d + factor * d**1.5 / spring - x, 0, x, xtol=1e-15)
            for x in base
        ]
    )
    force = factor * np.maximum(depth, 0.0) ** 1.5
    curve = ForceCurve("bends", np.linspace(0.0, 1.0, 3000), depth, force, prescribed="depth")
    fit = fit_indentation(curve, material(1000.0, 2000.0, 0.1), KEYS[:2], contact="detect")
    for key in KEYS[:2]:
        assert 3 * fit[key].value == pytest.approx(7000, rel=0.01)


def correlated(rows: int, seed: int) -> FloatArray:
    """Return autoregressive noise of the first order, of standard deviation 1."""
    white = np.random.default_rng(seed).standard_normal(rows)
    return np.asarray(lfilter([1], [1, -AR], np.append(white[:1], white[1:] * (1 - AR**2) ** 0.5)))


def test_intervals_under_correlated_noise_contain_the_truth() -> None:
    """95 % of 16 x 5 are 76; fewer than 70 have a probability of 4e-3 under independent errors.

    Intervals of white noise contain 40.
    """
    time, depth, force = ramp_hold(400, 0.5, 1.0, 1.0, 2.0, 0.1, before=0.7)
    true = dict(zip(KEYS, (1.0, 2.0, 0.1), strict=True))
    inside, white = 0, 0
    for seed in range(16):
        noisy = force + 0.01 * force.max() * correlated(time.size, seed)
        curve = ForceCurve("gel", time, depth, noisy, prescribed="depth")
        fit = fit_indentation(curve, material(1.2, 2.2, 0.1), KEYS, contact="detect")
        for each in fit.parameters:
            value = true.get(each.key, 0.0)
            low, high = each.interval
            inside += low <= value <= high
            middle, half = (low + high) / 2, fit.independent**0.5 * (high - low) / 2
            white += abs(value - middle) <= half
        assert "correlated as before contact" in " ".join(fit.misfit)
    assert inside >= 70
    assert white < 60


def test_white_noise_has_the_intervals_of_least_squares() -> None:
    """Wider by less than half: the price of 43 spectra."""
    rng, rows = np.random.default_rng(0), 500
    J = np.stack((np.ones(rows), np.linspace(0, 1, rows), np.linspace(0, 1, rows) ** 2), axis=1)
    wider = []
    for _ in range(20):
        noise = rng.standard_normal(rows)
        residual = noise - J @ np.linalg.lstsq(J, noise, rcond=None)[0]
        half = mixture(residual, J, [rows], level=0.95).half
        covariance = np.linalg.inv(J.T @ J) * (residual @ residual) / (rows - 3)
        wider.append(half / (1.965 * np.sqrt(np.diag(covariance))))
    assert 0.9 < np.median(wider) < 1.5


def test_blocks_have_noise_of_their_own() -> None:
    """Rows in two blocks, one after the other and interleaved by their names, give equal intervals."""
    rows = 200
    J = np.stack((np.ones(2 * rows), np.tile(np.linspace(0, 1, rows), 2)), axis=1)
    noise = np.concatenate([correlated(rows, seed) for seed in (1, 2)])
    residual = noise - J @ np.linalg.lstsq(J, noise, rcond=None)[0]
    both = mixture(residual, J, [rows, rows], level=0.95)
    order = np.r_[rows : 2 * rows, :rows]
    np.testing.assert_allclose(
        mixture(residual[order], J, [rows, rows], level=0.95).half, both.half, rtol=1e-9
    )


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda x, _: x**1.5 * (1 + 0.3 * np.sqrt(x)), "thickness"),
        (lambda x, _: x**1.5 * np.maximum(x, 1e-9) ** 0.1, "exponent"),
        (lambda x, position: x**1.5 + 0.1 * position, "tilted"),
        (lambda x, _: x**1.5, ""),
    ],
)
def test_a_wrong_model_is_named(change: Any, named: str) -> None:
    depth = np.linspace(-0.5, 0.6, 800)
    force = change(np.maximum(depth, 0.0) / 0.6, depth + 0.5)
    force = force + 0.005 * np.random.default_rng(3).standard_normal(depth.size)
    curve = ForceCurve("punch", np.linspace(0, 1, 800), depth, force, prescribed="depth")
    model = material(1.0, 1.0, 1.0)
    model["layer"]["material"] = {"model": "elastic", "G": 0.1}
    found = " ".join(fit_indentation(curve, model, ["layer.material.G"], contact="detect").misfit)
    assert (named in found) if named else ("beyond noise" not in found)


def test_fits_are_compared_by_their_independent_rows() -> None:
    time, depth, force = ramp_hold(400, 0.5, 1.0, 1.0, 2.0, 0.1, before=0.7)
    noisy = force + 0.01 * force.max() * correlated(time.size, 5)
    curve = ForceCurve("gel", time, depth, noisy, prescribed="depth")
    fits = {
        str(count): fit_indentation(curve, material(1.2, 2.2, 0.1), KEYS[:count], contact="detect")
        for count in (2, 3)
    }
    best, criteria = best_of(fits)
    part = min(fits.values(), key=lambda fit: fit.deviance).independent
    assert part < 0.5
    assert criteria[best] == min(criteria.values())
    rows = fits["3"].rows * part
    growth = fits["2"].deviance - fits["3"].deviance
    assert criteria["3"] - criteria["2"] == pytest.approx(math.log(rows) - part * growth)


def test_what_a_shape_would_change_does_not_depend_on_the_units():
    """In SI, columns of the fit differ by factors of 1e9."""
    depth = np.linspace(-1e-6, 1e-6, 400)
    force = 5e3 * 0.7e-6**0.2 * np.maximum(depth, 0.0) ** 1.8  # between a paraboloid and a cone
    force += 2e-12 * np.random.default_rng(3).standard_normal(400)
    said = []
    for length, size in (("m", 1.0), ("um", 1e6), ("nm", 1e9)):
        model = {
            "units": {"length": length, "stress": "Pa", "time": "s"},
            "layer": {"thickness": math.inf, "material": {"model": "elastic", "G": 500.0}},
            "punch": {"shape": "parabola", "radius": 5e-6 * size},
        }
        curve = ForceCurve("cone", np.arange(400.0), depth * size, force * size**2)
        fit = fit_indentation(curve, model, ["layer.material.G"], contact="detect")
        said.append(fit.misfit)
    assert "another exponent of the indenter" in said[0][0]
    assert said[1] == said[0]
    assert said[2] == said[0]


def test_a_baseline_that_falls_by_more_than_the_contact_rises_changes_nothing():
    depth = np.linspace(-2.0, 1.0, 1500)
    hertz = relaxed_force(np.arange(1500.0), depth, 7.0, 7.0, 1.0)
    noise = 0.003 * hertz.max() * np.random.default_rng(1).standard_normal(depth.size)
    model = {
        "layer": {"thickness": math.inf, "material": {"model": "elastic", "G": 1.0}},
        "punch": {"shape": "parabola", "radius": RADIUS},
    }
    moduli = []
    for fall in (0.0, 0.39, 1.3, 10.0):
        force = hertz + noise - fall * hertz.max() * (depth + 2) / 3
        curve = ForceCurve("tilted", np.arange(1500.0), depth, force)
        fit = fit_indentation(curve, model, ["layer.material.G", "tilt"], contact="detect")
        moduli.append(fit["G"].value)
    assert abs(moduli[0] / 7 - 1) < 0.005
    assert np.ptp(moduli) < 1e-6 * moduli[0]
