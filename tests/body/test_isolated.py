"""The periodic body that answers like the isolated one within reach."""

import math

import numpy as np
import pytest
from scipy.special import erfc, j0

import gfmdlayer
from gfmdlayer import Anisotropic, Elastic, LayerStack, Prony, Wavevectors, Zener, bonded_layer, halfspace
from gfmdlayer.body.isolated import TOLERANCE, isolated
from gfmdlayer.body.layer import Halfspace
from gfmdlayer.body.solid import Boundary

CELL = (1.0, 1.0)


def random_material(rng):
    stiff, tau, kind = 10 ** rng.uniform(-1.5, 1.5), 10 ** rng.uniform(-2, 2), rng.integers(3)
    if kind == 0:
        return Elastic(stiff)
    soft = stiff * 10 ** rng.uniform(-1.5, 0)
    if kind == 1:
        return Zener(G0=soft, Ginf=stiff, tau=tau)
    count = rng.integers(2, 6)
    moduli, times = stiff * rng.dirichlet(np.ones(count)), tau * 10 ** rng.uniform(-2, 2, count)
    return Prony(soft, list(zip(moduli.tolist(), times.tolist(), strict=True)))


def random_body(rng):
    """1 to 4 layers of 0.01 to 3 periods, moduli from 0.03 to 30, on a base of any kind."""
    layers = [
        gfmdlayer.Layer(
            float(10 ** rng.uniform(-2, math.log10(3))),
            float(rng.choice([0.5, rng.uniform(-0.2, 0.5)])),
            random_material(rng),
        )
        for _ in range(rng.integers(1, 5))
    ]
    bases = [math.inf, float(10 ** rng.uniform(-1.5, 1.5)), random_material(rng)]
    key = ("shear_modulus", "shear_modulus", "material")
    kind = rng.integers(3)
    base = Halfspace(**{key[kind]: bases[kind]}, poisson=float(rng.choice([0.5, 0.3])))
    return LayerStack(layers, accuracy=1e-6, halfspace=base)


def error_within_reach(found, rng):
    """Largest error of the response to a point load, by sums over all waves and another low pass."""
    n = np.arange(-20, 21)
    nx, ny = (np.ravel(each) for each in np.meshgrid(n, n))
    waves = Wavevectors.of_components(*(2 * np.pi * each for each in (nx, ny)))

    def low_pass(q):
        return 0.5 * erfc(5 * (q / 60 - 1))

    edges = np.unique([0.0, *np.geomspace(1e-9, 120, 60), *np.arange(0, 120, 4.0)])
    x, w = np.polynomial.legendre.leggauss(16)
    half = np.diff(edges)[:, np.newaxis] / 2
    q, w = (half * (x + 1) + edges[:-1, np.newaxis]).ravel(), (half * w).ravel()
    w = w * low_pass(q) * q / (2 * np.pi)
    r, angle = found.reach * np.sqrt(rng.uniform(0, 1, 20)), rng.uniform(0, 2 * np.pi, 20)
    r[:2] = 0, found.reach
    cosines = np.cos(
        2 * np.pi * np.outer(r, 1.0) * (np.outer(np.cos(angle), nx) + np.outer(np.sin(angle), ny))
    )
    times, worst = found.low.times[found.low.weights > 0], 0.0
    between = np.log([times.min() / 30, times.max() * 100]) if times.size else np.zeros(2)
    for s in (0.0, *(1 / np.exp(rng.uniform(*between, 12))), 1e9 / times.min(initial=1.0)):
        C = 1 / found.body.stiffness(q, s)
        response = j0(np.outer(r, q)) @ (w * C)
        # The part of the body's own waves that the low pass takes ends before the nearest image.
        passed = low_pass(waves.magnitude)
        own = 1 / found.body.stiffness(np.maximum(waves.magnitude, 1e-9), s)
        cut = np.where(waves.magnitude > 0, (1 - passed) * own, 0.0)
        worst = max(worst, np.abs(cosines @ (1 / found.stiffness(waves, s) - cut) - response).max() / (w @ C))
    return worst


def fitted(seed, count):
    """Fits of random bodies; where one is refused, of the body in the period that is said to do."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(count):
        body = random_body(rng)
        try:
            found.append(isolated(body, CELL))
        except ValueError as refusal:
            _, _, period = str(refusal).partition("; a period of ")
            period, _, _ = period.partition(" would do")
            isolated(body, (float(period), float(period)))
    return found


def check(found):
    rng = np.random.default_rng(3)
    for each in found:
        assert each.error <= TOLERANCE
        assert (each.low.relaxed > 0).all()
        assert (each.low.weights >= 0).all()
        assert (each.low.times > 0).all()
        assert error_within_reach(each, rng) < 1.1 * TOLERANCE  # between the nodes of the fit


@pytest.mark.parametrize(
    ("seed", "count"), [(4, 4), *(pytest.param(*each, marks=pytest.mark.slow) for each in ((4, 8), (1, 6)))]
)
def test_random_bodies_answer_without_images_within_reach(seed, count):
    """Up to a second each; docs/theory/isolated.md has the figures of 300."""
    check(fitted(seed, count))


def error_along_an_axis(found, rng):
    """Likewise of one isolated axis: integrals along it for each wavenumber along the other, two directly."""
    (axis,), datum = found.boundary.axes, found.boundary.datum
    length, across = found.period[axis], found.period[1 - axis]
    n, last = np.arange(-25, 26), 130 / length

    def low_pass(q):
        return 0.5 * erfc(5 * (q / (last / 2) - 1))

    edges = [0.0, *np.geomspace(1e-9, last, 60), *np.arange(0, last, 4 / length)]
    if datum is not None:
        edges += [*np.arange(0, 200 / datum, 1 / datum)]
    edges, (x, w) = np.unique(edges), np.polynomial.legendre.leggauss(16)
    half = np.diff(edges)[:, np.newaxis] / 2
    q, w = (half * (x + 1) + edges[:-1, np.newaxis]).ravel(), (half * w).ravel() / np.pi
    x = length * found.reach * np.r_[0, rng.uniform(0, 1, 15), 1]
    y = across * rng.uniform(0, 1, 17)
    y[0] = 0.0
    times = found.low.times[found.low.weights > 0]
    between = np.log([times.min() / 30, times.max() * 100]) if times.size else np.zeros(2)
    worst = 0.0
    for s in (0.0, *(1 / np.exp(rng.uniform(*between, 6))), 1e9 / times.min(initial=1.0)):
        off, size = np.zeros(17), 0.0
        for m in range(1 + int(last * across / (2 * np.pi))):
            qm, share = 2 * np.pi * m / across, (2 if m else 1) / across
            C = 1 / found.body.stiffness(np.hypot(q, qm), s)
            response = np.cos(np.outer(x, q)) @ (w * C * low_pass(np.hypot(q, qm)))
            if datum is not None and not m:  # a smooth cut that the datum does not see
                response = response - (w * C * low_pass(q * datum / length)) @ np.cos(datum * q)
            components = 2 * np.pi * n / length, np.full(n.size, qm)
            waves = Wavevectors.of_components(*components[:: 1 - 2 * axis])
            own = 1 / found.body.stiffness(np.maximum(waves.magnitude, 1e-9), s)
            cut = np.where(waves.magnitude > 0, (1 - low_pass(waves.magnitude)) * own, 0.0)
            cell = (
                np.cos(2 * np.pi / length * np.outer(x, n)) @ (1 / found.stiffness(waves, s) - cut) / length
            )
            off += share * np.cos(qm * y) * (cell - response)
            size += share * np.abs(response).max()
        worst = max(worst, np.abs(off).max() / size)
    return worst


FILM = bonded_layer(0.1, Zener(G0=1.0, Ginf=10.0, tau=1.0), poisson=0.45, halfspace=5.0)


@pytest.mark.parametrize(
    ("body", "datum", "period"),
    [
        (halfspace(1.0), 3.0, (2.0, 1.0)),
        (FILM, 2.5, (1.0, 0.3)),
        (bonded_layer(0.05, Zener(10.0, 50.0, 1.0), poisson=0.3, halfspace=1.0), 3.0, (2.0, 1.0)),
        (bonded_layer(0.2, Zener(1.0, 10.0, 1.0), poisson=0.45), None, (1.0, 1.0)),
    ],
    ids=["halfspace", "film in a long cell", "stiff film", "rigid base"],
)
def test_along_one_axis_a_body_answers_without_images(body, datum, period):
    found = isolated(body, period, Boundary((False, True), datum))
    turned = isolated(body, period[::-1], Boundary((True, False), datum))
    assert found.error <= TOLERANCE
    assert turned.error == found.error
    assert (turned.low.relaxed > 0).all()
    assert error_along_an_axis(turned, np.random.default_rng(3)) < 1.1 * TOLERANCE  # between the nodes


def test_a_line_is_a_surface_with_one_isolated_axis_under_loads_that_are_uniform_along_the_other():
    line = isolated(FILM, (1.0,), Boundary((True,), 3.0))
    surface = isolated(FILM, (1.0, 0.4), Boundary((True, False), 3.0))
    q = 2 * np.pi * np.arange(30.0)
    for s in (0.0, 0.3, 1e9):
        assert surface.stiffness(q, s) == pytest.approx(line.stiffness(q, s), rel=2e-3)  # two fits


def test_spectrum_is_the_stiffness_of_its_modes_and_the_body_s_own_beyond():
    body = bonded_layer(0.1, Zener(G0=1.0, Ginf=10.0, tau=1.0), poisson=0.45, halfspace=5.0)
    found = isolated(body, (2.0, 1.0))
    grid = gfmdlayer.Case(gfmdlayer.Config(name="a", grid={"points": [64, 32], "period": [2.0, 1.0]})).grid
    for s in (0.0, 0.3, 1e9):
        K, own = found.stiffness(grid.waves, s), body.stiffness(grid.wavenumbers, s)
        changed = np.abs(K / np.where(own > 0, own, 1.0) - 1) > 1e-9
        number = np.hypot(grid.waves.qx * 2.0, grid.waves.qy) / (2 * np.pi)
        assert changed[number < 1.5].all()
        assert not changed[number > 6.5].any()
    assert found.mean_stiffness == pytest.approx(found.stiffness([0.0], 0.0)[0], rel=1e-12)


class Orthotropic:
    """A halfspace that is twice as stiff along y."""

    mean_stiffness = 0.0

    def stiffness(self, waves, s):
        waves = Wavevectors.of(waves)
        return np.hypot(waves.qx, 2 * waves.qy) + 0 * np.asarray(s)

    def spectrum(self, waves):
        return gfmdlayer.Spectrum.of_material(self.stiffness(waves, 0.0), Elastic(1.0))


@pytest.mark.parametrize(
    ("body", "period", "words"),
    [
        (bonded_layer(0.1, 1.0, halfspace=0.0), CELL, "must be a body on a base"),
        (LayerStack((gfmdlayer.Layer(0.1, 0.3, Elastic(1.0)),) * 2), CELL, "must be a body on a base"),
        (halfspace(1.0), (1.0,), "must have a datum"),
        (Orthotropic(), CELL, "depends on the direction"),
    ],
    ids=["free plate", "free stack", "line on a halfspace", "orthotropic"],
)
def test_bodies_without_an_isolated_contact_are_refused(body, period, words):
    with pytest.raises(ValueError, match=words):
        isolated(body, period)


def test_one_axis_of_a_body_that_depends_on_the_direction_is_the_limit_of_a_long_period():
    """A crystal whose images along y, at half of five periods, end like exp(-2 pi m y) but for the mean."""
    crystal = Anisotropic(C11=5.0, C12=2.0, C44=2.5)
    alone = isolated(crystal, (1.0, 2.0), Boundary((False, True), 2.0))
    assert alone.error <= TOLERANCE

    def response(body, length, x, y):
        """Of a load that is a point along y, by waves of both grids up to the same end."""
        numbers = np.arange(-100 * int(length), 100 * int(length) + 1)
        qx, qy = np.meshgrid(2 * np.pi * np.array([1, 2]), 2 * np.pi * numbers / length, indexing="ij")
        K = body.stiffness(Wavevectors.of_components(qx.ravel(), qy.ravel()), 0.0)
        return float((np.cos(qx * x) * np.cos(qy * y) / K.reshape(qx.shape)).sum() / length)

    size = response(crystal, 20.0, 0.0, 0.0)
    for x, y in ((0.1, 0.1), (0.3, 0.4), (0.5, 0.8)):
        expected = response(crystal, 20.0, x, y)
        assert response(alone, 2.0, x, y) == pytest.approx(expected, abs=TOLERANCE * size)


def test_a_crystal_that_is_no_mirror_image_of_itself_has_no_isolated_axis():
    turned = Anisotropic(C11=5.0, C12=2.0, C44=2.5, angle=20.0)
    with pytest.raises(ValueError, match="no mirror image of itself"):
        isolated(turned, CELL, Boundary((True, False), 2.0))
