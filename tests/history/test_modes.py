"""Integrators on a single sinusoidal mode in full contact, whose stress is a sum of exponentials.

With K(q, s) = K_0 + sum_j w_j s theta_j/(1 + s theta_j) the stress -sigma of a displacement u = t is
K_0 t + sum_j w_j theta_j (1 - exp(-t/theta_j)), and that of any other follows by superposition.
"""

import math

import numpy as np
import pytest

from gfmdlayer.body.closed_form import LayeredHalfspace, relaxation_spectrum
from gfmdlayer.body.materials import Prony, Zener
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.errors import ErrorControl, NormalMeans
from gfmdlayer.history.modes import SCHEMES, Modes

EPS = np.finfo(float).eps
BODY = LayeredHalfspace(0.05, 0.5, 1.0)
ZENER = Zener(1.0, 10.0, 1.0)
PRONY = Prony(1.0, ((2.0, 0.01), (3.0, 1.0), (5.0, 300.0)))
Q = 2 * np.pi * np.array([1.0, 3.0, 10.0, 100.0])

materials = pytest.mark.parametrize("material", [ZENER, PRONY], ids=["Zener", "Prony"])


def ramp_hold(time):
    return min(time, 1.0)


def ramp_hold_stress(spectrum, time):
    """Stress -sigma of u = min(t, 1): the stretch of each mode after the ramp decays."""
    theta, ramp = spectrum.times, min(time, 1.0)
    stretch = theta * -np.expm1(-ramp / theta) * np.exp(-(time - ramp) / theta)
    return np.asarray(spectrum.relaxed * ramp + (spectrum.weights * stretch).sum(axis=0))


def stresses(integrator, times, u, modes=Q.size):
    """-sigma at the times, the first being 0, of the same displacement in every mode."""
    found, last = [], 0.0
    for time in times:
        kappa, b = integrator.terms(time - last)
        last, spectrum = time, np.full(modes, complex(u(time)))
        found.append(kappa * spectrum - b)
        integrator.advance(spectrum)
    np.testing.assert_allclose(np.imag(found), 0, atol=1e-300)
    return np.real(found)


@materials
def test_the_exponential_step_is_exact_while_the_displacement_is_linear_in_time(material):
    spectrum = relaxation_spectrum(BODY, material, Q)
    # Steps of very different length that land on the kink at t = 1.
    times = [0.0, 1e-9, 1e-6, 0.001, 0.25, 0.5, 0.75, 1.0, 1.0 + 1e-7, 1.01, 2.0, 30.0, 1e3, 1e6]
    found = stresses(Modes(spectrum, SCHEMES["exponential"]), times, ramp_hold)
    # Each step rounds the state of a mode a few times, at the scale of the glassy stress.
    off = 10 * len(times) * EPS * spectrum.glassy
    for time, stress in zip(times, found, strict=True):
        error = np.abs(stress - ramp_hold_stress(spectrum, time))
        assert (error <= off * ramp_hold(time)).all(), time


@materials
def test_a_sudden_displacement_relaxes_from_the_glassy_response_by_the_sum_of_exponentials(material):
    spectrum = relaxation_spectrum(BODY, material, Q)
    modes, u, time = Modes(spectrum, SCHEMES["exponential"]), np.ones(Q.size, dtype=complex), 0.0
    kappa, b = modes.terms(0.0)
    np.testing.assert_allclose(kappa, spectrum.glassy, rtol=4 * EPS)
    np.testing.assert_array_equal(b, 0)
    modes.advance(u)
    for step in [1e-3] * 5 + [0.1] * 5 + [10.0] * 5:
        kappa, b = modes.terms(step)
        time += step
        exact = spectrum.relaxed + (spectrum.weights * np.exp(-time / spectrum.times)).sum(axis=0)
        np.testing.assert_allclose((kappa - b).real, exact, rtol=100 * EPS)
        modes.advance(u)


def order(errors, steps):
    """Slope of a straight line through the errors in a plot with logarithmic axes."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def sine_stress(spectrum, time):
    """Stress of u = sin t from t = 0 on: the oscillation and a transient."""
    theta = spectrum.times
    forced = theta * (theta * math.sin(time) + math.cos(time) - np.exp(-time / theta)) / (1 + theta**2)
    return np.asarray(spectrum.relaxed * math.sin(time) + (spectrum.weights * forced).sum(axis=0))


@materials
@pytest.mark.parametrize(("name", "expected"), [("backward_euler", 1), ("exponential", 2), ("curved", 3)])
def test_orders_of_the_schemes(name, expected, material):
    spectrum = relaxation_spectrum(BODY, material, Q)
    exact = sine_stress(spectrum, 2.0)
    # dt/theta is small for the shortest relaxation time, 0.01 in the Prony series.
    counts = np.array([400, 800, 1600, 3200] if material is PRONY else [25, 50, 100, 200])
    errors = []
    for count in counts:
        times = [2.0 * i / count for i in range(count + 1)]
        modes = Modes(spectrum, SCHEMES["exponential" if name == "curved" else name])
        if name == "curved":
            modes = ErrorControl(modes, NormalMeans(modes, Sums(np.ones(Q.size))), curved=True)
        found = stresses(modes, times, math.sin)[-1]
        errors.append(np.abs(found / exact - 1).max())
    assert order(errors, 2 / counts) == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("name", SCHEMES)
def test_an_elastic_body_is_a_spring(name):
    for body, material in (
        (LayeredHalfspace(0.0, 0.5, 2.0), ZENER),
        (LayeredHalfspace(math.inf, 0.5, 2.0), Zener(2.0, 2.0, 1.0)),
    ):
        modes = Modes(relaxation_spectrum(body, material, Q), SCHEMES[name])
        for step in (0.0, 0.1, 1e3):
            kappa, b = modes.terms(step)
            np.testing.assert_allclose(kappa, 4 * Q, rtol=10 * EPS)
            np.testing.assert_array_equal(b, 0)
            modes.advance(np.full(Q.size, 1 + 2j))


@pytest.mark.parametrize("name", SCHEMES)
def test_a_compressible_layer_on_a_rigid_base_relaxes_in_the_mean_too(name):
    body = LayeredHalfspace(0.1, 0.3, math.inf)
    spectrum = relaxation_spectrum(body, ZENER, np.array([0.0, 1e-6]))
    found = stresses(Modes(spectrum, SCHEMES[name]), [0.0, *np.linspace(10, 60, 6)], lambda _: 1.0, modes=2)
    # P-wave modulus over thickness, relaxed: the remainder is nine times exp(-60) or (1 + 10)^-6.
    np.testing.assert_allclose(found[-1], 2 * 0.7 / (0.4 * 0.1), rtol=10 * 11.0**-6)


@pytest.mark.parametrize("name", SCHEMES)
def test_history_is_linear_in_the_displacement(name):
    spectrum = relaxation_spectrum(BODY, ZENER, Q)
    times = np.linspace(0, 2, 21).tolist()
    one, other, both = (
        stresses(Modes(spectrum, SCHEMES[name]), times, u)
        for u in (math.sin, lambda t: t * t, lambda t: 3 * math.sin(t) - 2 * t * t)
    )
    np.testing.assert_allclose(both, 3 * one - 2 * other, atol=200 * EPS * 11 * spectrum.glassy.max())
