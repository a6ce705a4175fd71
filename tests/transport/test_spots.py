"""Conductance and stiffness of given spots: discs, strips, films, Hertz, dense solutions."""

import math

import numpy as np
import pytest
from scipy.special import erfc

import gfmdlayer
from gfmdlayer.grid.grid import Grid
from gfmdlayer.transport.spots import Spots, attracted, impedance, in_series, inverse

MADELUNG, THIRD = 3.90026492, 9.0336217  # lattice sums of a square cell, of 1/r and 1/r^3
INSIDE = 0.13  # spacings from the outline of a disc's points to its edge


def grid(n):
    return Grid((n, n), (1.0, 1.0))


def spots(n, Z=None, tolerance=1e-14):
    """Return the problem on a square cell; without Z that of a conductivity of 1."""
    return Spots(impedance(grid(n).wavenumbers, [], 1.0) if Z is None else Z, n**-2.0, tolerance)


def disc(n, radius, *centres):
    x = (np.arange(n) + 0.5) / n
    centres = centres or ((0.5, 0.5),)
    return np.any([(x[:, None] - X) ** 2 + (x - Y) ** 2 < radius**2 for X, Y in centres], axis=0)


def radius_of(contact, discs=1):
    n = len(contact)
    return float(np.sqrt(contact.mean() / discs / np.pi)) - INSIDE / n


def one_disc(a):
    """Resistance of a disc in a square cell of length 1, for a conductivity of 1."""
    return 1 / (4 * a) - MADELUNG / (2 * np.pi) + THIRD * a**2 / (6 * np.pi)


def lattice(s, split=3.0):
    """Sum of 1/r over a square lattice seen at (s, 0), with a neutral background, by Ewald's method."""
    X, Y = np.meshgrid(np.arange(-6, 7), np.arange(-6, 7), indexing="ij")
    r, G = np.hypot(X + s, Y), 2 * np.pi * np.hypot(X, Y)
    G[6, 6] = np.inf
    waves = erfc(G / 2 / split) / G * np.cos(2 * np.pi * X * s)
    return float((erfc(split * r) / r).sum() + 2 * np.pi * waves.sum() - 2 * np.sqrt(np.pi) / split)


@pytest.mark.parametrize(("a", "n"), [(0.05, 128), (0.1, 256)])
def test_a_disc_has_the_resistance_of_holm_with_its_images(a, n):
    contact = disc(n, a)
    # 0.05 %: the scatter of the edge's place over discs of 6 to 100 spacings.
    assert 1 / spots(n).total(contact) == pytest.approx(one_disc(radius_of(contact)), rel=6e-4)


def test_a_strip_has_its_closed_form():
    """R = ln(1/sin(pi b/L))/pi per length; the edges are 0.19 spacings inside, to 0.01 at most."""
    n, b = 1024, 0.1
    x = (np.arange(n) + 0.5) / n
    line = Grid((n,), (1.0,))
    contact = np.abs(x - 0.5) < b
    S = Spots(impedance(line.wavenumbers, [], 1.0), 1 / n, 1e-14).total(contact)
    edge = contact.mean() / 2 - np.arcsin(np.exp(-np.pi / S)) / np.pi
    assert edge * n == pytest.approx(0.19, abs=0.01)


def test_two_discs_share_the_current():
    n, a, s = 512, 0.02, 0.1
    contact = disc(n, a, (0.5 - s / 2, 0.5), (0.5 + s / 2, 0.5))
    exact = (one_disc(radius_of(contact, 2)) + (lattice(s) + a**2 / (3 * s**3)) / (2 * np.pi)) / 2
    # Next terms of order (a/s)^5 and the edge of discs of 10 spacings.
    assert 1 / spots(n).total(contact) == pytest.approx(exact, rel=2e-3)


def test_films_have_the_limits_of_thick_and_thin_ones():
    q = grid(64).wavenumbers
    bare = impedance(q, [], 1.0)
    np.testing.assert_allclose(impedance(q, [(0.3, 1.0)], 1.0), bare, rtol=1e-14)  # of the same material
    np.testing.assert_allclose(impedance(q, [(0.1, 2.0), (0.2, 2.0)], 5.0), impedance(q, [(0.3, 2.0)], 5.0))
    np.testing.assert_allclose(impedance(q, [(100.0, 0.5)], 7.0)[q > 0], 2 * bare[q > 0], rtol=1e-14)
    thin = impedance(q, [(1e-9, 2.0)], math.inf)
    np.testing.assert_allclose(thin, 0.5e-9, rtol=1e-12)
    assert thin[0, 0] == in_series([(1e-9, 2.0)])
    with np.errstate(divide="ignore"):
        exact = 1 / np.tanh(q * 0.1) / (2 * q)
    np.testing.assert_allclose(impedance(q, [(0.1, 2.0)], 0.0)[q > 0], exact[q > 0], rtol=1e-13)
    # A film on a substrate, with the reflection (k1 - k2)/(k1 + k2).
    r, e = (3.0 - 0.5) / 3.5, np.exp(-2 * q[q > 0] * 0.02)
    exact = (1 + r * e) / (1 - r * e) / (3.0 * q[q > 0])
    np.testing.assert_allclose(impedance(q, [(0.02, 3.0)], 0.5)[q > 0], exact, rtol=1e-13)


def test_a_disc_under_films_has_the_recorded_resistance():
    """4 a R: thick films tend to 1 - (2 ln 2/pi) a/d; d/a = 1 on a perfect conductor and on a substrate."""
    n, a = 512, 0.03
    contact, q = disc(n, a), grid(512).wavenumbers
    at = radius_of(contact)

    def R(films, base):
        return 1 / float(spots(n, impedance(q, films, base)).total(contact))

    # Recorded at 1024 points. 0.13 spacings belong to a bare disc; of 15, under a film, they are open to 1 %.
    assert 4 * at * R([(a, 1.0)], math.inf) == pytest.approx(0.6268, rel=1e-2)
    assert 4 * at * R([(0.1, 1.0)], math.inf) == pytest.approx(
        1 - 2 * math.log(2) / np.pi * a / 0.1, rel=1e-2
    )
    bare = R([], 1.0)
    assert R([(a, 0.1)], 1.0) / bare == pytest.approx(7.189, rel=1e-2)
    assert R([(a, 10.0)], 1.0) / bare == pytest.approx(0.1620, rel=1e-2)


def test_a_dense_solution_of_the_same_equations_agrees():
    """The operator on all unit densities, solved by elimination: an elastic base, omega tau = 2."""
    n = 32
    body = gfmdlayer.bonded_layer(0.1, gfmdlayer.Zener(), halfspace=3.0)
    Z = inverse(body.stiffness(grid(n).waves, 2j))
    contact = disc(n, 0.2)
    units = np.eye(n * n)[contact.ravel()].reshape(-1, n, n)

    def columns(part):
        return np.fft.irfft2(part * np.fft.rfft2(units), (n, n))[:, contact]

    dense = columns(Z.real) + 1j * columns(Z.imag)
    S = np.linalg.solve(dense, np.ones(len(dense))).sum() / n**2
    assert spots(n, Z, 1e-24).total(contact) == pytest.approx(S, rel=1e-10)


def test_the_dynamic_stiffness_has_the_recorded_values():
    """Of one material it is proportional to G*; on an elastic base it is not."""
    material, contact = gfmdlayer.Zener(), disc(128, 0.15)
    bodies = {
        1.87459: gfmdlayer.halfspace(material),
        7.11369: gfmdlayer.bonded_layer(0.1, material),
        3.50757: gfmdlayer.bonded_layer(0.1, material, halfspace=3.0),
    }
    ratio = complex(material.laplace(1j) / material.laplace(0.0))
    for relaxed, body in bodies.items():
        S0, S = (
            spots(128, inverse(body.stiffness(grid(128).waves, s)), 1e-20).total(contact) for s in (0.0, 1j)
        )
        assert pytest.approx(relaxed, rel=1e-5) == S0
        if relaxed != 3.50757:
            assert pytest.approx(ratio, rel=1e-9) == S / S0
        else:
            assert pytest.approx(7.30075 + 1.60881j, rel=1e-5) == S


def test_the_frozen_stiffness_of_hertz_is_the_slope_of_force_over_depth():
    n, body, punch = 128, gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=8.0)
    found = [
        gfmdlayer.solve(body, punch, force=0.0032 * (1 + e), points=(n, n), tolerance=1e-12)
        for e in (-1e-6, 0.0, 1e-6)
    ]
    contact = found[1].contact.to_numpy()
    assert all((each.contact.to_numpy() == contact).all() for each in found)  # no point joins
    S = spots(n, inverse(body.stiffness(grid(n).waves, 0.0)), 1e-24).total(contact)
    slope = (found[2].force - found[0].force) / (found[2].depth - found[0].depth)
    # The tolerance of the contact over the relative step of the force.
    assert float(slope) == pytest.approx(S, rel=1e-5)
    a = math.sqrt(float(found[1].contact_area_interpolated) / np.pi)
    assert pytest.approx(2 * 4 * a / (4 * a * one_disc(a)), rel=5e-3) == S  # 2 E* a with images


def test_a_step_starts_from_the_density_before():
    contact = disc(128, 0.2)
    problem = spots(128, tolerance=1e-8)
    cold = problem.total(contact)
    started = problem.iterations
    assert problem.total(contact) == pytest.approx(cold, rel=1e-8)
    assert problem.iterations == 0 < started
    smaller = disc(128, 0.19)
    assert problem.total(smaller) == pytest.approx(spots(128).total(smaller), rel=1e-7)
    assert problem.total(np.zeros((128, 128), dtype=bool)) == 0.0


@pytest.mark.parametrize("mean", [0.0, 3.0])
@pytest.mark.parametrize("loss", [0.0, 0.5])
def test_without_curvature_an_attraction_leaves_the_stiffness_of_the_spots(mean, loss):
    K = np.where(grid(32).wavenumbers == 0, mean, 2 * grid(32).wavenumbers) * (1 + 1j * loss if loss else 1)
    touching = disc(32, 0.2)
    expected = Spots(inverse(K), 32**-2.0, 1e-14).total(touching)
    found = attracted(K, np.zeros((32, 32)), touching, 32**-2.0, 1e-14)
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("mean", [0.0, 3.0])
def test_a_curvature_changes_the_stiffness_as_a_dense_solution_has_it(mean):
    n, c = 8, -0.5
    K = np.where(grid(n).wavenumbers == 0, mean, 2 * grid(n).wavenumbers)
    touching, unit = disc(n, 0.2).ravel(), np.eye(n * n).reshape(n * n, n, n)
    dense = np.fft.irfftn(K * np.fft.rfftn(unit, axes=(1, 2)), (n, n), axes=(1, 2)).reshape(n * n, n * n)
    # Unknown: 1 + v out of contact, and the constant where the mean is zero.
    free = np.flatnonzero(~touching)
    matrix, right = (
        dense[np.ix_(free, free)] + c * np.eye(free.size),
        c - dense[np.ix_(free, np.flatnonzero(touching))].sum(1),
    )
    if mean:
        sunk = np.linalg.solve(matrix, right)
        pressure = 0.0
    else:
        one = np.ones((free.size, 1))
        bordered = np.block([[matrix, one], [one.T, np.zeros((1, 1))]])
        *sunk, pressure = np.linalg.solve(bordered, np.append(right, -touching.sum()))
    w = np.ones(n * n)
    w[free] = sunk
    expected = (dense @ w + pressure).sum() / n**2
    found = attracted(K, np.full((n, n), c), touching.reshape(n, n), n**-2.0, 1e-14)
    assert found == pytest.approx(expected, rel=1e-9)
