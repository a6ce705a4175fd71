"""Laws with a continuous spectrum against other methods, and the series that replace them."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from gfmdlayer.body.continuous import ContinuousLaw, FractionalZener, HavriliakNegami, Kohlrausch, PowerLaw
from gfmdlayer.body.materials import Law, Zener

# The contour integral reaches this part of Ginf, here ten times G0.
CONTOUR = 1e-12
TIMES = np.array([1e-6, 1e-3, 0.1, 1.0, 10.0, 1e4])
OMEGA = np.array([1e-5, 1e-2, 0.5, 3.0, 1e4])
LAWS = [
    FractionalZener(1.0, 10.0, 2.0, 0.5),
    PowerLaw(1.0, 2.0, 0.3),
    Kohlrausch(1.0, 10.0, 2.0, 0.5),
    HavriliakNegami(1.0, 10.0, 2.0, 0.7, 0.5),
]


def identity(law: Law) -> str:
    return law.model


@pytest.mark.parametrize("exponent", [0.2, 0.8])
@pytest.mark.parametrize("t", [1e-3, 1.0, 50.0])
def test_fractional_zener_solid_is_the_integral_over_its_spectrum(exponent: float, t: float) -> None:
    # The spectrum of Cole and Cole over ln tau; Gorenflo & Mainardi (1997), Eq. (A.19).
    def integrand(v: float) -> float:
        a = exponent
        spectrum = math.sin(a * math.pi) / (2 * math.pi * (math.cosh(a * v) + math.cos(a * math.pi)))
        return spectrum * math.exp(-t * math.exp(-v))

    edges = [-60 / exponent, -10.0, 0.0, 10.0, 60 / exponent]
    parts = [quad(integrand, a, b, epsabs=1e-13, limit=200)[0] for a, b in itertools.pairwise(edges)]
    law = FractionalZener(1.0, 10.0, 1.0, exponent)
    assert float(law.relaxation_modulus(t)) == pytest.approx(1 + 9 * sum(parts), rel=1e-10)


@pytest.mark.parametrize("law", LAWS, ids=identity)
@pytest.mark.parametrize("s", [0.01, 0.3, 20.0])
def test_both_moduli_belong_to_each_other(law: ContinuousLaw, s: float) -> None:
    # Eq. (2) on the real axis, with t = exp(x)/s; the integrand is smooth and the quadrature good to 1e-10.
    def integrand(x: float) -> float:
        return math.exp(x - math.exp(x)) * float(law.relaxation_modulus(math.exp(x) / s))

    edges = [-60.0, -20.0, -5.0, 0.0, 4.0]
    found = sum(quad(integrand, a, b, epsrel=1e-11)[0] for a, b in itertools.pairwise(edges))
    assert float(law.laplace(s)) == pytest.approx(found, rel=1e-9)


@pytest.mark.parametrize("law", LAWS, ids=identity)
def test_complex_modulus_continues_the_one_on_the_real_axis(law: ContinuousLaw) -> None:
    # Cauchy-Riemann: dG/d(ln s) along a ray is -i dG/d(arg s); central differences of 1e-4.
    h = 1e-4
    s = 0.7 * np.exp(0.9j)
    along = (law.laplace(s * math.exp(h)) - law.laplace(s * math.exp(-h))) / (2 * h)
    across = (law.laplace(s * np.exp(1j * h)) - law.laplace(s * np.exp(-1j * h))) / (2 * h)
    assert along == pytest.approx(-1j * across, rel=1e-7)


@pytest.mark.parametrize(
    "law",
    [
        FractionalZener(1.0, 10.0, 2.0, 1.0),
        Kohlrausch(1.0, 10.0, 2.0, 1.0),
        HavriliakNegami(1.0, 10.0, 2.0, 1.0),
    ],
)
def test_laws_of_exponent_one_are_zener_solids(law: ContinuousLaw) -> None:
    zener = Zener(1.0, 10.0, 2.0)
    np.testing.assert_allclose(law.relaxation_modulus(TIMES), zener.relaxation_modulus(TIMES), rtol=CONTOUR)
    np.testing.assert_allclose(law.complex_modulus(OMEGA), zener.complex_modulus(OMEGA), rtol=CONTOUR)


def test_havriliak_negami_without_asymmetry_is_the_fractional_zener_solid() -> None:
    skewed, straight = HavriliakNegami(1.0, 10.0, 2.0, 0.6, 1.0), FractionalZener(1.0, 10.0, 2.0, 0.6)
    np.testing.assert_array_equal(skewed.complex_modulus(OMEGA), straight.complex_modulus(OMEGA))


@pytest.mark.parametrize("law", LAWS, ids=identity)
def test_limits_of_a_law(law: ContinuousLaw) -> None:
    assert law.relaxation_modulus(math.inf) == law.relaxed
    assert law.laplace(0.0) == law.relaxed
    assert law.relaxation_modulus(0.0) == law.glassy


@pytest.mark.parametrize("law", LAWS, ids=identity)
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_series_keeps_to_its_bounds_everywhere_in_the_range(law: ContinuousLaw, tolerance: float) -> None:
    series = law.prony(1e-2, 30.0, tolerance)
    assert max(series.error_in_time, series.error_in_frequency) <= tolerance
    t = np.geomspace(1e-2, 30.0, 2000)
    in_time = np.abs(series.material.relaxation_modulus(t) / law.relaxation_modulus(t) - 1).max()
    in_frequency = np.abs(series.material.complex_modulus(1 / t) / law.complex_modulus(1 / t) - 1).max()
    assert in_time <= series.error_in_time
    assert in_frequency <= series.error_in_frequency
    # The bounds are no more than the errors and what may lie between samples, 2 % of the tolerance.
    assert series.error_in_frequency <= in_frequency + 0.03 * tolerance
    assert series.material.relaxed > 0
    assert all(modulus > 0 for modulus, _ in series.material.maxwell_branches)
    if math.isfinite(law.glassy):
        assert series.material.glassy == pytest.approx(law.glassy, rel=tolerance)


@pytest.mark.slow
def test_fractional_zener_solid_over_twelve_decades_takes_22_branches() -> None:
    law = FractionalZener(0.1, 1.0, 1.0, 0.5)
    series = law.prony(1e-6, 1e6, 1e-4)
    assert max(series.error_in_time, series.error_in_frequency) <= 1e-4
    # Trapezoidal quadrature of the spectrum needs some 2.3 a decade.
    assert len(series.material.maxwell_branches) <= 22


@settings(deadline=None, max_examples=15)
@given(
    st.sampled_from([FractionalZener, Kohlrausch, HavriliakNegami]),
    st.floats(0.15, 1.0),
    st.floats(-3, 3).map(lambda k: 10.0**k),
    st.floats(1.0, 1e3),
)
def test_any_law_has_a_series_that_keeps_to_its_tolerance(
    kind: type[ContinuousLaw], exponent: float, tau: float, contrast: float
) -> None:
    law = kind(1.0, contrast, tau, exponent)
    series = law.prony(1e-2, 1e1, 1e-3)
    assert max(series.error_in_time, series.error_in_frequency) <= 1e-3


def test_law_that_is_a_series_is_its_own() -> None:
    zener = Zener(1.0, 10.0, 2.0)
    series = zener.prony(1e-3, 1.0)
    assert series.material is zener
    assert series.error_in_time == series.error_in_frequency == 0


def test_range_must_not_be_empty() -> None:
    with pytest.raises(ValueError, match="must be positive and increase"):
        LAWS[0].prony(1.0, 0.5)
