"""The response to tractions without periodic images: kernels, creep form, and its history."""

import math
from functools import cache

import numpy as np
import pytest
from scipy.special import jv

import gfmdlayer
from gfmdlayer import Zener, bonded_layer, halfspace
from gfmdlayer.body.solid import Boundary
from gfmdlayer.friction.isolated import IsolatedResponse, compliances, without_images
from gfmdlayer.friction.response import Operator, Response, SharedTransforms, Spent
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.history.traction_creep import TractionCreep
from gfmdlayer.history.traction_modes import TractionModes

ZENER = Zener(G0=1.0, Ginf=10.0, tau=1.0)
BODIES = {
    "halfspace": halfspace(1.0, poisson=0.3),
    "stiff film": bonded_layer(0.05, 50.0, poisson=0.3, halfspace=1.0, halfspace_poisson=0.3),
    "soft film": bonded_layer(0.1, 0.1, poisson=0.45, halfspace=1.0, halfspace_poisson=0.3),
    "rigid base": bonded_layer(0.1, 1.0, poisson=0.3),
    "relaxing halfspace": halfspace(ZENER, poisson=0.3),
    "relaxing film": bonded_layer(0.1, ZENER, poisson=0.45, halfspace=5.0),
    "relaxing stiff film": bonded_layer(0.1, ZENER, poisson=0.45, halfspace=0.2),
}
N, WIDTH = 64, 2.5 / 64  # points of a period of 1; of a Gaussian load, which the grid resolves to 1e-13


def rule(edges, order=12):
    """Gauss's rule between edges."""
    x, w = np.polynomial.legendre.leggauss(order)
    low, half = np.asarray(edges[:-1])[:, None], np.diff(edges)[:, None] / 2
    return (low + half * (x + 1)).ravel(), (half * w).ravel()


def far_apart(shape):
    """Differences of points in a box of half of the cell, without the point itself."""
    rng = np.random.default_rng(0)
    found = rng.integers(-N // 2 + 14, N // 2 - 13, (150, shape))  # the Gaussian is 1e-7 14 points away
    return found[(found != 0).any(axis=1)].T


def gaussian(axes):
    x = np.meshgrid(*[np.fft.fftfreq(N)] * axes, indexing="ij", sparse=True)
    norm = (2 * np.pi * WIDTH**2) ** (axes / 2)
    return np.exp(-sum(each**2 for each in x) / (2 * WIDTH**2)) / norm


def responses(response, axes):
    """W, u_x[, u_y] at the points under a Gaussian pressure, and under a Gaussian shear traction along x."""
    grid = Grid((N,) * axes, (1.0,) * axes)
    operator = Operator(grid, response, SharedTransforms(Transforms(grid.points), Spent(), 1.0))
    load = gaussian(axes).ravel()
    found = []
    for kind in (0, 1):
        x = np.zeros((1 + axes, load.size))
        x[kind] = load
        found.append(operator(x).reshape(-1, *grid.points))
    return found


K, K_WEIGHTS = rule(np.unique(np.r_[0, np.geomspace(1e-6, 8 / WIDTH, 60), np.arange(0, 8 / WIDTH, 5)]))


@cache
def bessel(m):
    """J_m(r k) at all differences within half of the cell."""
    return jv(m, np.outer(np.hypot(*far_apart(2)) / N, K))


@pytest.mark.parametrize("s", [0.0, 0.3, 1e9])
@pytest.mark.parametrize("body", BODIES)
def test_kernels_are_hankel_integrals_at_all_differences_within_half_of_the_cell(body, s):
    """The low pass leaves out 1e-7 (erfc), times the largest coefficient of the creep form: some ones."""
    WW, WU, UU, VV = compliances(BODIES[body], K, np.array([s]))[:, 0]
    i, j = far_apart(2)
    x, y = i / N, j / N
    r = np.hypot(x, y)
    passed = np.exp(-((K * WIDTH) ** 2) / 2) * K_WEIGHTS * K / (2 * np.pi)

    def g(m, c):
        return bessel(m) @ (passed * c)

    A, B = (UU + VV) / 2, (UU - VV) / 2
    exact = {
        (0, 0): g(0, WW), (0, 1): -g(1, WU) * x / r, (0, 2): -g(1, WU) * y / r, (1, 0): g(1, WU) * x / r,
        (1, 1): g(0, A) - g(2, B) * (2 * x**2 / r**2 - 1), (1, 2): -g(2, B) * 2 * x * y / r**2,
    }  # fmt: skip
    kernels = without_images(BODIES[body], Grid((N, N), (1.0, 1.0)))
    found = responses(kernels.with_weights(1 / (1 + s * kernels.times)), 2)
    for (load, kind), value in exact.items():
        assert np.abs(found[load][kind][i, j] - value).max() < 1e-6 * np.abs(exact[load, load]).max()


@pytest.mark.parametrize("body", ["halfspace", "relaxing film", "rigid base"])
def test_kernels_of_a_line_are_integrals_from_the_datum(body):
    datum = None if body == "rigid base" else 3.0
    edges = [0, *np.geomspace(1e-9, 8 / WIDTH, 90), *np.arange(0, 8 / WIDTH, 1)]
    k, weights = rule(np.unique(edges))
    WW, WU, UU, _ = compliances(BODIES[body], k, np.array([0.0]))[:, 0]
    (i,) = far_apart(1)
    x, passed = i / N, np.exp(-((k * WIDTH) ** 2) / 2) * weights / np.pi
    counted = np.cos(np.outer(x, k)) - (0 if datum is None else np.cos(k * datum))
    exact = {
        (0, 0): counted @ (passed * WW), (0, 1): -np.sin(np.outer(x, k)) @ (passed * WU),
        (1, 0): np.sin(np.outer(x, k)) @ (passed * WU), (1, 1): counted @ (passed * UU),
    }  # fmt: skip
    kernels = without_images(BODIES[body], Grid((N,), (1.0,)), Boundary((True,), datum))
    found = responses(kernels.with_weights(np.ones(kernels.times.size)), 1)
    for (load, kind), value in exact.items():
        off, size = found[load][kind][i] - value, np.abs(exact[load, load]).max()
        assert np.ptp(off) < 1e-6 * size
        assert np.abs(off).max() < (1e-6 if datum is None else (WIDTH / datum) ** 2) * size


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("body", ["halfspace", "relaxing film", "stiff film"])
def test_kernels_of_one_isolated_axis_are_integrals_along_it_and_sums_along_the_other(body, axis):
    """All components, at differences of any length along the periodic axis."""
    datum, across = 3.0, 0.75
    k, weights = rule(np.unique([0, *np.geomspace(1e-9, 8 / WIDTH, 90), *np.arange(0, 8 / WIDTH, 5)]))
    numbers = np.arange(math.ceil(8 / WIDTH * across / (2 * np.pi)))
    period, points = (1.0, across) if axis == 0 else (across, 1.0), (N, 48) if axis == 0 else (48, N)
    rng = np.random.default_rng(1)
    i, j = rng.integers(-N // 2 + 14, N // 2 - 13, 60), rng.integers(0, 48, 60)
    i[(np.abs(i) < 14) & (np.minimum(j, 48 - j) < 14)] = 14
    x, y = i / N, j * across / 48
    exact = np.zeros((3, 3, 60))
    for m in numbers:
        qm = 2 * np.pi * m / across
        q = np.hypot(k, qm)
        WW, WU, UU, VV = compliances(BODIES[body], q, np.array([0.3]))[:, 0]
        along, beside = k / q, qm / q
        passed = np.exp(-((q * WIDTH) ** 2) / 2) * weights / np.pi * ((2 if m else 1) / across)
        cos, sin = np.cos(np.outer(x, k)), np.sin(np.outer(x, k))
        counted = cos - (0 if m else np.cos(k * datum))
        c, s = np.cos(qm * y), np.sin(qm * y)
        exact[0, 0] += counted @ (passed * WW) * c
        exact[1, 1] += counted @ (passed * (UU * along**2 + VV * beside**2)) * c
        exact[2, 2] += counted @ (passed * (VV * along**2 + UU * beside**2)) * c
        exact[0, 1] -= sin @ (passed * WU * along) * c
        exact[0, 2] -= cos @ (passed * WU * beside) * s
        exact[1, 2] -= sin @ (passed * (UU - VV) * along * beside) * s
    grid = Grid(points, period)
    kernels = without_images(BODIES[body], grid, Boundary((axis == 0, axis == 1), datum))
    response = kernels.with_weights(1 / (1 + 0.3 * kernels.times))
    operator = Operator(grid, response, SharedTransforms(Transforms(points), Spent(), 1.0))
    every = zip(points, period, strict=True)
    distances = np.meshgrid(*(length * np.fft.fftfreq(n) for n, length in every), indexing="ij", sparse=True)
    load = np.exp(-sum(each**2 for each in distances) / (2 * WIDTH**2)) / (2 * np.pi * WIDTH**2)
    order = [0, 1, 2] if axis == 0 else [0, 2, 1]
    for kind in range(3):
        fields = np.zeros((3, grid.size))
        fields[order[kind]] = load.ravel()
        found = operator(fields).reshape(-1, *points)
        if axis == 1:
            found = found.transpose(0, 2, 1)[order]
        size = np.abs(exact[kind, kind]).max()
        for other in range(3):
            expected = exact[min(kind, other), max(kind, other)] * (-1 if kind and not other else 1)
            # A Gaussian at the datum is no point: (w/datum)^2.
            assert np.abs(found[other][i, j] - expected).max() < (1e-6 + (WIDTH / datum) ** 2) * size


def test_a_rectangular_cell_has_the_kernel_of_a_halfspace():
    """W under a Gaussian of width w is (1 - nu)/(2 pi G r) (1 + w^2/(2 r^2) + 9 w^4/(8 r^4) + ...)."""
    grid, w = Grid((192, 96), (2.0, 0.5)), 0.026
    response = without_images(halfspace(1.0, poisson=0.3), grid).with_weights(np.zeros(0))
    operator = Operator(grid, response, SharedTransforms(Transforms(grid.points), Spent(), 1.0))
    x = np.meshgrid(np.fft.fftfreq(192, 0.5), np.fft.fftfreq(96, 2.0), indexing="ij", sparse=True)
    load = np.zeros((3, grid.size))
    load[0] = np.exp(-sum(each**2 for each in x) / (2 * w**2)).ravel() / (2 * np.pi * w**2)
    W = operator(load)[0].reshape(grid.points)
    for i, j in ((80, 20), (60, 3), (-50, -15)):
        r = math.hypot(i / 96, j / 192)
        series = 1 + 0.5 * (w / r) ** 2 + 9 / 8 * (w / r) ** 4
        assert W[i, j] == pytest.approx(0.7 / (2 * math.pi * r) * series, rel=1e-6)


def test_a_halfspace_of_one_material_has_its_own_retardation_times():
    law = gfmdlayer.Prony(1.0, [(3.0, 1.0), (5.0, 100.0)])
    kernels = without_images(halfspace(law, poisson=0.3), Grid((32, 32), (1.0, 1.0)))
    assert kernels.times.size == 2
    assert kernels.error < 1e-12


@pytest.mark.parametrize("body", ["relaxing film", "relaxing stiff film"])
def test_more_times_are_taken_until_the_error_of_the_form_is_small(body):
    kernels = without_images(BODIES[body], Grid((32, 32), (1.0, 1.0)))
    assert 4 < kernels.times.size < 20
    assert 0 < kernels.error <= 1e-6


def in_creep_form(body, grid):
    """The response of a periodic surface in creep form."""
    form = without_images(body, grid, Boundary((True,), 3.0) if len(grid.points) == 1 else None)
    per_wave = [Response(*part).factors(grid) for part in zip(*form.plain, strict=True)]
    shape = (form.times.size + 1, *grid.spectral_shape)
    parts = tuple(np.stack(part).reshape(shape) * grid.size for part in zip(*per_wave, strict=True))
    return IsolatedResponse(form.times, parts, form.plain, form.error)


@pytest.mark.parametrize("points", [(32,), (16, 16)], ids=["line", "surface"])
@pytest.mark.parametrize("curved", [False, True])
def test_the_memory_of_tractions_is_that_of_relaxing_modes(points, curved):
    """Displacements of a periodic film under tractions without a mean, and the energies.

    The forms agree to 1e-6; steps are exact for tractions linear in time here, for displacements there, so
    that both are off by dt^2/12 of the second derivatives: 2e-4 of them for steps of .05, less with the
    curvature.
    """
    body, grid = BODIES["relaxing film"], Grid(points, (1.0,) * len(points))
    transforms = Transforms(points)
    creep = TractionCreep(grid, in_creep_form(body, grid))
    modes = TractionModes(grid, body.traction_spectrum(grid.waves))
    rng = np.random.default_rng(3)
    loads = rng.standard_normal((2, 1 + len(points), grid.size))
    loads -= loads.mean(axis=-1, keepdims=True)
    dt, energies, past = 0.05, [], []
    for step in range(41):
        t = step * dt
        x = loads[0] * math.sin(t) + loads[1] * (1 - math.cos(2 * t))
        waves = np.array([transforms.forward(field) for field in x])
        past.append(waves)
        for history in (creep, modes):
            history.terms(dt if step else 0.0)
            bend = None
            if curved and step > 2:
                bend = (past[-1] - 2 * past[-2] + past[-3]) / 2
            if history is creep:
                history.advance(waves.ravel(), None if bend is None else bend.ravel())
            else:
                history.advance(history.under(waves))
        found, expected = creep.displacement, modes.displacement
        energies.append((creep.stored, modes.stored, creep.dissipated, modes.dissipated))
        assert np.abs(found - expected).max() < 1e-3 * np.abs(expected).max() + 1e-12
    energies = np.array(energies)
    assert np.abs(energies[:, 0] - energies[:, 1]).max() < 1e-3 * energies[:, 1].max()
    assert np.abs(energies[:, 2] - energies[:, 3]).max() < 2e-3 * energies[:, 3].max()


def test_energies_of_the_creep_form_are_the_work_of_the_tractions():
    """Elements of any sign: work = stored + heat to the second order of the trapezoids, 1e-4 at this step."""
    body, grid = BODIES["relaxing stiff film"], Grid((16, 16), (1.0, 1.0))
    creep, transforms = TractionCreep(grid, without_images(body, grid)), Transforms(grid.points)
    inside = np.zeros(grid.points)
    inside[5:11, 5:11] = np.random.default_rng(0).uniform(size=(6, 6))
    x = np.array([inside, 0.3 * inside, -0.2 * inside]).reshape(3, -1)
    work, before = 0.0, (np.zeros((3, 256)), np.zeros((3, 256)))
    for step in range(201):
        t = 0.01 * step
        load = x * (t if t < 1 else 2 - t)
        waves = np.array([transforms.forward(field) for field in load])
        creep.terms(0.01 if step else 0.0)
        creep.advance(waves.ravel())
        u = np.array([transforms.backward(field) for field in creep.displacement]) / grid.size
        work += float(((load + before[0]) * (u - before[1])).sum(axis=0).mean()) / 2
        before = load, u
        if step == 100:
            assert creep.stored > 0
            assert creep.stored + creep.dissipated == pytest.approx(work, rel=1e-4)
    assert creep.dissipated > 0
    assert creep.stored + creep.dissipated == pytest.approx(work, rel=1e-3)


def test_bodies_without_an_isolated_state_are_refused():
    grid = Grid((32,), (1.0,))
    with pytest.raises(ValueError, match="nothing carries the load"):
        without_images(bonded_layer(0.1, 1.0, halfspace=0.0), grid)
    with pytest.raises(ValueError, match="must have a datum"):
        without_images(halfspace(1.0), grid)


def test_the_mean_has_the_compliance_of_the_cell():
    """C_WW(0): W under a uniform pressure of the difference box, here the mean of (1 - nu)/(2 pi G r)."""
    n = 64
    kernels = without_images(halfspace(1.0, poisson=0.5), Grid((n, n), (1.0, 1.0)))
    found = float(kernels.with_weights(np.zeros(0)).normal[0, 0])
    # Over a square of side 1 the integral of 1/r is 4 ln(1 + 2^(1/2)); the edge of the box is cut by points.
    assert found == pytest.approx(4 * math.log(1 + math.sqrt(2)) / (4 * math.pi), rel=2 / n)
