"""Eq. (24): its coefficients as printed, and its integrator against the modes of the exact spectrum."""

import math

import numpy as np
import pytest

from gfmdlayer.body.closed_form import LayeredHalfspace, relaxation_spectrum
from gfmdlayer.body.materials import Zener
from gfmdlayer.history.modes import SCHEMES, Modes
from gfmdlayer.verification.crosschecks import (
    Coefficients,
    ThirdOrder,
    constitutive_coefficients,
    stress_difference,
)

EPS = np.finfo(float).eps
ZENER = Zener(1.0, 10.0, 1.0)
BODIES = [
    LayeredHalfspace(d, 0.5, bulk)
    for d in (0.0, 1e-3, 0.05, 1.0, math.inf)
    for bulk in (0.0, 0.1, 1.0, 10.0, math.inf)
    if d > 0 or 0 < bulk < math.inf
]


def printed(q, d, bulk, material):
    """Both sides of Eq. (24) from Eqs. (17), (18) and (21), letter by letter."""
    G0, Ginf = material.G0, material.Ginf
    a0, a1, a2, a3 = G0 / bulk - 1, Ginf / bulk - 1, G0 / bulk + 1, Ginf / bulk + 1
    r, x = np.exp(-2 * q * d), q * d
    b = (-2 * (1 + 2 * x**2), 4 * x)
    c = np.zeros((5, 2, q.size))
    for k in (0, 1):
        c[1, k] = a2**2 + a0 * a2 * b[k] * r + (-1) ** k * a0**2 * r**2
        c[2, k] = 2 * a2 * a3 + (a1 * a2 + a0 * a3) * b[k] * r + (-1) ** k * 2 * a0 * a1 * r**2
        c[3, k] = a3**2 + a1 * a3 * b[k] * r + (-1) ** k * a1**2 * r**2
    return Coefficients(
        stress=np.array([c[k + 1, 1] + c[k, 1] for k in range(4)]),
        displacement=np.array([2 * q * (c[k + 1, 0] * G0 + c[k, 0] * Ginf) for k in range(4)]),
    )


@pytest.mark.parametrize("contrast", [1.5, 10.0, 100.0])
@pytest.mark.parametrize("bulk", [0.1, 1.0, 10.0, 256.0])
def test_coefficients_are_the_printed_ones(bulk, contrast):
    # From q d = 1/2 on the printed differences lose a factor of about ten to cancellation, no more.
    q, d, material = np.linspace(1, 40, 79), 0.5, Zener(1.0, contrast, 1.0)
    ours = constitutive_coefficients(LayeredHalfspace(d, 0.5, bulk), material, q)
    paper = printed(q, d, bulk, material)
    for side, paper_side in zip(ours, paper, strict=True):
        np.testing.assert_allclose(side / ours.stress[0], paper_side / paper.stress[0], rtol=400 * EPS)


def test_a_rigid_base_leaves_eq_28():
    q, d, material = np.linspace(1, 400, 57), 0.05, Zener(1.0, 7.0, 1.0)
    stress, displacement = constitutive_coefficients(LayeredHalfspace(d, 0.5, math.inf), material, q)
    # Eq. (26): (1 + s)^3; Eq. (27): (G0 + s Ginf)(1 + s)^2; q d from 0.05: the factors of Eq. (28) cancel
    # like (q d)^-3 as printed.
    r, x = np.exp(-2 * q * d), q * d
    ratio = 2 * q * (1 + 2 * (1 + 2 * x**2) * r + r**2) / (1 - 4 * x * r - r**2)
    rounding = 20 * EPS * (1 + x.min() ** -3)
    np.testing.assert_allclose(
        stress / stress[0], np.tile([[1.0], [3.0], [3.0], [1.0]], q.size), rtol=20 * EPS
    )
    expected = np.array([1.0, 9.0, 15.0, 7.0])[:, np.newaxis] * ratio
    np.testing.assert_allclose(displacement / stress[0], expected, rtol=rounding)


def test_an_infinitely_thick_layer_leaves_eq_29():
    q = np.array([1.0, 10.0, 1e4])
    for bulk in (0.0, 0.3, 5.0, math.inf):
        stress, displacement = constitutive_coefficients(LayeredHalfspace(math.inf, 0.5, bulk), ZENER, q)
        s = np.array([0.0, 0.3, 1.0, 50.0])
        powers = s[:, np.newaxis] ** np.arange(4)
        expected = 2 * q * (1 + 10 * s[:, np.newaxis]) / (1 + s[:, np.newaxis])
        np.testing.assert_allclose((powers @ displacement) / (powers @ stress), expected, rtol=20 * EPS)


@pytest.mark.parametrize("step", [0.1, 0.005])
@pytest.mark.parametrize("body", BODIES, ids=lambda b: f"d={b.thickness}, G_bulk={b.bulk_modulus}")
def test_both_forms_of_backward_euler_are_one(body, step):
    q = 2 * np.pi * np.array([0.0, 1, 2, 3, 5, 10, 30, 100, 300, 1000])
    kappa, _ = ThirdOrder(body, ZENER, q, step).terms(step)
    modes = Modes(relaxation_spectrum(body, ZENER, q), SCHEMES["backward_euler"])
    np.testing.assert_allclose(kappa, modes.terms(step)[0], rtol=20 * EPS)
    assert stress_difference(body, q, step, steps=400) <= 1


def test_the_mean_is_free_to_move():
    kappa, b = ThirdOrder(BODIES[0], ZENER, np.array([0.0, 1.0]), 0.1).terms(0.1)
    assert kappa[0] == b[0] == 0


def test_steps_of_another_length_are_refused():
    with pytest.raises(ValueError, match="equal steps"):
        ThirdOrder(BODIES[0], ZENER, np.array([1.0]), 0.1).terms(0.2)


@pytest.mark.parametrize("body", [LayeredHalfspace(0.1, 0.3, 1.0), LayeredHalfspace(0.1, 0.5, 1.0, 0.3)])
def test_compressible_bodies_are_refused(body):
    with pytest.raises(ValueError, match="incompressible"):
        ThirdOrder(body, ZENER, np.array([1.0]), 0.1)
