"""Zener and Prony solids: G(t), G(omega) and G(s) of Eqs. (2), (4) and (5)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from gfmdlayer.body.materials import Material, Prony, Zener
from gfmdlayer.config import Config

# A handful of operations of half an ulp each.
ROUNDING = 1e-15

SOFT = Zener(G0=1.0, Ginf=10.0, tau=2.0)
BROAD = Prony(G0=0.5, branches=((4.0, 1e-3), (2.0, 1.0), (1.0, 50.0)))


def test_zener_solid_has_the_modulus_of_equation_4() -> None:
    omega = np.logspace(-4, 4, 33)
    printed = (1.0 + 1j * omega * 2.0 * 10.0) / (1 + 1j * omega * 2.0)
    np.testing.assert_allclose(SOFT.complex_modulus(omega), printed, rtol=2 * ROUNDING)


def test_zener_solid_relaxes_as_equation_5() -> None:
    t = np.linspace(0, 20, 41).reshape(1, 41)
    np.testing.assert_allclose(SOFT.relaxation_modulus(t), 1 + 9 * np.exp(-t / 2), rtol=ROUNDING)


@pytest.mark.parametrize("material", [SOFT, BROAD])
@pytest.mark.parametrize("omega", [0.01, 0.7, 30.0])
def test_complex_modulus_is_the_transform_of_the_relaxation_modulus(material: Material, omega: float) -> None:
    # Eq. (2): G0 transforms to itself; the transient, of which exp(-40) is left where the range ends, goes
    # through a rule for oscillating integrands whose 25 parts are each good to 1e-11.
    def transient(t: float) -> float:
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
def test_response_runs_from_glassy_to_relaxed(material: Material) -> None:
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
def test_any_series_stores_and_loses_energy_but_makes_none(
    branches: list[tuple[float, float]], omega: float
) -> None:
    material = Prony(1.0, tuple(branches))
    modulus = complex(material.complex_modulus(omega))
    assert 1 <= modulus.real <= material.glassy * (1 + 10 * ROUNDING)
    assert modulus.imag >= 0
    assert material.laplace(omega) <= material.laplace(2 * omega) * (1 + 10 * ROUNDING)


def test_prony_series_of_one_branch_is_a_zener_solid() -> None:
    one = Prony(1.0, ((9.0, 2.0),))
    s = np.array([0.1, 1j, 3 + 4j])
    np.testing.assert_array_equal(one.laplace(s), SOFT.laplace(s))
    assert one.glassy == SOFT.glassy


@pytest.mark.parametrize("material", [Zener(2.0, 2.0, 1.0), Prony(2.0), Prony(2.0, ((0.0, 1.0),))])
def test_material_without_relaxing_branches_is_elastic(material: Material) -> None:
    assert material.elastic
    assert material.glassy == material.relaxed == 2.0
    np.testing.assert_array_equal(material.relaxation_modulus([0.0, 1.0]), 2.0)
    np.testing.assert_array_equal(material.complex_modulus([0.0, 1.0]), 2.0)


def test_relaxing_material_is_not_elastic() -> None:
    assert not SOFT.elastic
    assert not BROAD.elastic


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Zener(0.0, 1.0, 1.0), "G0: got 0.0; must be a number > 0"),
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
def test_impossible_materials_are_refused(make: Callable[[], Material], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_parameters_are_taken_in_order_or_by_name_but_once() -> None:
    assert Zener(2.0, tau=3.0, Ginf=5.0) == Zener(2.0, 5.0, 3.0)
    assert Prony(branches=[{"G": 2.0, "tau": 3.0}]) == Prony(1.0, ((2.0, 3.0),))
    assert [tau for _, tau in BROAD.branches] == [1e-3, 1.0, 50.0]
    with pytest.raises(TypeError, match="takes each of G0, Ginf, tau once"):
        Zener(1.0, 2.0, 3.0, 4.0)
    with pytest.raises(TypeError, match="takes each of G0, Ginf, tau once"):
        Zener(1.0, G0=2.0)


def test_the_material_of_a_configuration_is_the_one_of_the_theory() -> None:
    keys = {"model": "prony", "G0": 0.5, "branches": [{"G": G, "tau": tau} for G, tau in BROAD.branches]}
    config = Config.model_validate({"name": "x", "layer": {"material": keys}})
    assert config.layer.material == BROAD
    assert Config(name="x").layer.material == Zener(1.0, 10.0, 1.0)
