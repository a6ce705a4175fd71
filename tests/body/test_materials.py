"""Zener and Prony solids: G(t), G(omega) and G(s) of Eqs. (2), (4) and (5)."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from gfmdlayer.body.continuous import FractionalZener, HavriliakNegami, Kohlrausch, PowerLaw
from gfmdlayer.body.materials import Prony, Zener
from gfmdlayer.config import Config, ConfigError

# A handful of operations of half an ulp each.
ROUNDING = 1e-15

SOFT = Zener(G0=1.0, Ginf=10.0, tau=2.0)
BROAD = Prony(G0=0.5, branches=((4.0, 1e-3), (2.0, 1.0), (1.0, 50.0)))


def test_zener_solid_has_the_modulus_of_equation_4_and_relaxes_as_equation_5():
    omega, t = np.logspace(-4, 4, 33), np.linspace(0, 20, 41).reshape(1, 41)
    printed = (1.0 + 1j * omega * 2.0 * 10.0) / (1 + 1j * omega * 2.0)
    np.testing.assert_allclose(SOFT.complex_modulus(omega), printed, rtol=2 * ROUNDING)
    np.testing.assert_allclose(SOFT.relaxation_modulus(t), 1 + 9 * np.exp(-t / 2), rtol=ROUNDING)


@pytest.mark.parametrize("material", [SOFT, BROAD])
@pytest.mark.parametrize("omega", [0.01, 0.7, 30.0])
def test_complex_modulus_is_the_transform_of_the_relaxation_modulus(material, omega):
    # Eq. (2): G0 transforms to itself; the transient, of which exp(-40) is left where the range ends, goes
    # through a rule for oscillating integrands whose 25 parts are each good to 1e-11.
    def transient(t):
        return float(material.relaxation_modulus(t)) - material.relaxed

    edges = [0.0, *np.logspace(-4, math.log10(40 * material.branch_times.max()), 25)]
    cosine, sine = (
        sum(
            quad(transient, a, b, weight=weight, wvar=omega, epsrel=1e-11)[0]
            for a, b in itertools.pairwise(edges)
        )
        for weight in ("cos", "sin")
    )
    expected = material.relaxed + 1j * omega * (cosine - 1j * sine)
    assert material.complex_modulus(omega) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("material", [SOFT, BROAD])
def test_response_runs_from_glassy_to_relaxed(material):
    assert material.relaxation_modulus(0.0) == pytest.approx(material.glassy, rel=ROUNDING)
    assert material.relaxation_modulus(math.inf) == material.relaxed
    assert material.laplace(0.0) == material.relaxed
    assert material.laplace(1e300) == pytest.approx(material.glassy, rel=ROUNDING)
    assert material.glassy == pytest.approx(material.relaxed + material.branch_moduli.sum(), rel=ROUNDING)


@settings(deadline=None)
@given(
    st.lists(
        st.tuples(st.just(0.0) | st.floats(1e-30, 1e6), st.floats(-6, 6).map(lambda k: 10**k)), max_size=8
    ),
    st.floats(-8, 8).map(lambda k: 10**k),
)
def test_any_series_stores_and_loses_energy_but_makes_none(branches, omega):
    material = Prony(1.0, tuple(branches))
    modulus = complex(material.complex_modulus(omega))
    assert 1 <= modulus.real <= material.glassy * (1 + 10 * ROUNDING)
    assert modulus.imag >= 0
    assert material.laplace(omega) <= material.laplace(2 * omega) * (1 + 10 * ROUNDING)


def test_prony_series_of_one_branch_is_a_zener_solid():
    one = Prony(1.0, ((9.0, 2.0),))
    s = np.array([0.1, 1j, 3 + 4j])
    np.testing.assert_array_equal(one.laplace(s), SOFT.laplace(s))
    assert one.glassy == SOFT.glassy


@pytest.mark.parametrize("material", [Zener(2.0, 2.0, 1.0), Prony(2.0), Prony(2.0, ((0.0, 1.0),))])
def test_only_a_material_without_relaxing_branches_is_elastic(material):
    assert [each.elastic for each in (material, SOFT, BROAD)] == [True, False, False]
    assert material.glassy == material.relaxed == 2.0
    np.testing.assert_array_equal(material.relaxation_modulus([0.0, 1.0]), 2.0)
    np.testing.assert_array_equal(material.complex_modulus([0.0, 1.0]), 2.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Zener(-1.0, 1.0, 1.0), "G0: got -1.0; must be a number >= 0"),
        (lambda: Zener(2.0, 1.0, 1.0), "Ginf: got 1.0, below G0 = 2.0; must be a number >= G0"),
        (lambda: Zener(1.0, math.inf, 1.0), "Ginf: got .inf; must be a number > 0, finite"),
        (lambda: Zener(1.0, math.nan, 1.0), "Ginf: got .nan"),
        (lambda: Zener(1.0, 2.0, -1.0), "tau: got -1.0"),
        (lambda: Zener(1.0, 2.0, math.inf), "tau: got .inf"),
        (lambda: Prony(-1.0), "G0: got -1.0"),
        (lambda: Prony(1.0, ((1.0, 1.0), (-2.0, 1.0))), r"branches\[1\].G: got -2.0; must be a number >= 0"),
        (lambda: Prony(1.0, ((1.0, 0.0),)), r"branches\[0\].tau: got 0.0"),
        (lambda: Prony(1.0, ((math.nan, 1.0),)), r"branches\[0\].G: got .nan"),
    ],
)
def test_impossible_materials_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_parameters_are_taken_in_order_or_by_name_but_once():
    assert Zener(2.0, tau=3.0, Ginf=5.0) == Zener(2.0, 5.0, 3.0)
    assert Prony(branches=[{"G": 2.0, "tau": 3.0}]) == Prony(1.0, ((2.0, 3.0),))
    assert [tau for _, tau in BROAD.branches] == [1e-3, 1.0, 50.0]
    with pytest.raises(ConfigError, match="got 4 values without a name; takes G0, Ginf, tau in this order"):
        Zener(1.0, 2.0, 3.0, 4.0)
    with pytest.raises(ConfigError, match="Zener takes each of G0, Ginf, tau once"):
        Zener(1.0, G0=2.0)


def test_the_material_of_a_configuration_is_the_one_of_the_theory():
    keys = {"model": "prony", "G0": 0.5, "branches": [{"G": G, "tau": tau} for G, tau in BROAD.branches]}
    config = Config.model_validate({"name": "x", "layer": {"material": keys}})
    assert config.layer.material == BROAD
    assert Config(name="x").layer.material == Zener(1.0, 10.0, 1.0)


# --- laws with a continuous spectrum against other methods, and the series that replace them ---

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


def identity(law):
    return law.model


@pytest.mark.parametrize("exponent", [0.2, 0.8])
@pytest.mark.parametrize("t", [1e-3, 1.0, 50.0])
def test_fractional_zener_solid_is_the_integral_over_its_spectrum(exponent, t):
    # The spectrum of Cole and Cole over ln tau; Gorenflo & Mainardi (1997), Eq. (A.19).
    def integrand(v):
        a = exponent
        spectrum = math.sin(a * math.pi) / (2 * math.pi * (math.cosh(a * v) + math.cos(a * math.pi)))
        return spectrum * math.exp(-t * math.exp(-v))

    edges = [-60 / exponent, -10.0, 0.0, 10.0, 60 / exponent]
    parts = [quad(integrand, a, b, epsabs=1e-13, limit=200)[0] for a, b in itertools.pairwise(edges)]
    law = FractionalZener(1.0, 10.0, 1.0, exponent)
    assert float(law.relaxation_modulus(t)) == pytest.approx(1 + 9 * sum(parts), rel=1e-10)


@pytest.mark.parametrize("law", LAWS, ids=identity)
@pytest.mark.parametrize("s", [0.01, 0.3, 20.0])
def test_both_moduli_belong_to_each_other(law, s):
    # Eq. (2) on the real axis, with t = exp(x)/s; the integrand is smooth and the quadrature good to 1e-10.
    def integrand(x):
        return math.exp(x - math.exp(x)) * float(law.relaxation_modulus(math.exp(x) / s))

    edges = [-60.0, -20.0, -5.0, 0.0, 4.0]
    found = sum(quad(integrand, a, b, epsrel=1e-11)[0] for a, b in itertools.pairwise(edges))
    assert float(law.laplace(s)) == pytest.approx(found, rel=1e-9)


@pytest.mark.parametrize("law", LAWS, ids=identity)
def test_complex_modulus_continues_the_one_on_the_real_axis(law):
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
def test_laws_of_exponent_one_are_zener_solids(law):
    zener = Zener(1.0, 10.0, 2.0)
    np.testing.assert_allclose(law.relaxation_modulus(TIMES), zener.relaxation_modulus(TIMES), rtol=CONTOUR)
    np.testing.assert_allclose(law.complex_modulus(OMEGA), zener.complex_modulus(OMEGA), rtol=CONTOUR)


def test_havriliak_negami_without_asymmetry_is_the_fractional_zener_solid():
    skewed, straight = HavriliakNegami(1.0, 10.0, 2.0, 0.6, 1.0), FractionalZener(1.0, 10.0, 2.0, 0.6)
    np.testing.assert_array_equal(skewed.complex_modulus(OMEGA), straight.complex_modulus(OMEGA))


@pytest.mark.parametrize("law", LAWS, ids=identity)
def test_limits_of_a_law(law):
    assert law.relaxation_modulus(math.inf) == law.relaxed
    assert law.laplace(0.0) == law.relaxed
    assert law.relaxation_modulus(0.0) == law.glassy


@pytest.mark.parametrize("law", LAWS, ids=identity)
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_series_keeps_to_its_bounds_everywhere_in_the_range(law, tolerance):
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
def test_fractional_zener_solid_over_twelve_decades_takes_22_branches():
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
def test_any_law_has_a_series_that_keeps_to_its_tolerance(kind, exponent, tau, contrast):
    law = kind(1.0, contrast, tau, exponent)
    series = law.prony(1e-2, 1e1, 1e-3)
    assert max(series.error_in_time, series.error_in_frequency) <= 1e-3


def test_law_that_is_a_series_is_its_own():
    zener = Zener(1.0, 10.0, 2.0)
    series = zener.prony(1e-3, 1.0)
    assert series.material is zener
    assert series.error_in_time == series.error_in_frequency == 0


def test_range_must_not_be_empty():
    with pytest.raises(ValueError, match="must be positive and increase"):
        LAWS[0].prony(1.0, 0.5)
