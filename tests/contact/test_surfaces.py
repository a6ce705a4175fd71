"""Surfaces in two directions: closed forms, lines as a special case, axes that are alike, roughness."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from gfmdlayer.body.closed_form import LayeredHalfspace, relaxation_spectrum
from gfmdlayer.body.materials import Zener
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.self_affine import SelfAffine

E = 4.0  # E* = 2 G/(1 - nu) of the halfspace below, G = 1 and nu = 1/2
# Sums over the points X of the square lattice without the origin, |X|^-1 less its integral, and |X|^-3.
LATTICE_1, LATTICE_3 = -3.90026492, 9.03362168
METHODS = ["fire", "active_set", "conjugate_gradient"]
methods = pytest.mark.parametrize("method", METHODS)


def settled(run, points, punch, load, method="active_set"):
    """A halfspace, E* = 4, under a load that is brought on in a single step."""
    values = {"grid.points": points, "layer.thickness": 0.0, "punch": punch, "output.snapshots": [1.0]}
    values |= {"trajectory": {"control": "load", "load": load}, "time": {"end": 1.0, "step": 1.0}}
    return run(values | {"solver": {"method": method, "tolerance": 1e-9}})


# --- closed forms ---


def hertz(load):
    """Radius, depth and largest pressure under a sphere of R = 1 in a cell of 1 x 1."""
    # The neighbours' displacement around the middle, F/(pi E*) (LATTICE_1 + LATTICE_3 r^2/4 + ...), acts like
    # a shift and a curvature of the sphere; its mean over Hertz's pressure has <r^2> = 2 a^2/5. The next term
    # is of the order (a/L)^5.
    curvature = LATTICE_3 * load / (4 * np.pi * E)
    R = 1 / (1 + 2 * curvature)
    a = (3 * load * R / (4 * E)) ** (1 / 3)
    depth = a**2 / R + LATTICE_1 * load / (np.pi * E) + curvature * 2 * a**2 / 5
    return a, depth, 1.5 * load / (np.pi * a**2)


@methods
def test_a_sphere_flattens_as_hertz_says(method, run):
    n, load = 128, 4 * E * 0.1**3 / 3
    a, depth, peak = hertz(load)
    found = settled(run, [n, n], {"radius": 1.0}, load, method)
    (_, _, pressure), m = found.snapshots[-1], a * n  # points in the radius
    # The edge is known to half a cell. The errors of depth and peak are m^-2 times a function of its place.
    assert found["contact_area"][-1] == pytest.approx(np.pi * a**2, rel=1 / m)
    assert found["depth"][-1] == pytest.approx(depth, rel=0.06 / m**2)
    assert pressure.max() == pytest.approx(peak, rel=0.15 / m**2)
    r = np.hypot(*np.meshgrid(*Grid((n, n), (1.0, 1.0)).coordinates, indexing="ij"))
    exact = peak * np.sqrt(np.maximum(1 - (r / a) ** 2, 0))
    assert np.abs(pressure - exact)[r < 0.8 * a].max() < peak / m**2
    assert (pressure[r > a + 1.5 / n] < 1e-8 * peak).all()


def test_depth_and_peak_of_a_sphere_are_of_second_order_in_the_grid(run):
    # As in a line contact the error is a function of where between the points the edge lies, times m^-2;
    # measured over m = 2 to 26 it is between -0.054 and 0.036, and -0.08 and 0.125.
    off = []
    for n, radius in ((32, 0.1), (48, 0.1), (64, 0.1), (96, 0.1), (96, 0.05)):
        load = 4 * E * radius**3 / 3
        a, depth, peak = hertz(load)
        found = settled(run, [n, n], {"radius": 1.0}, load)
        errors = found["depth"][-1] / depth - 1, found.snapshots[-1][2].max() / peak - 1
        off.append(np.array(errors) * (a * n) ** 2)
    assert (np.abs(off) < (0.06, 0.15)).all()
    assert np.ptp(off, axis=0)[0] > 0.02  # the place of the edge counts


def test_johnsons_isotropic_wave_at_light_loads_has_spheres(run):
    # Johnson, Greenwood and Higginson, Int. J. Mech. Sci. 27 (1985) 383: A = pi (3 pbar/(8 pi p*))^(2/3) for
    # small pbar/p*. The next terms: h = A (q^2 r^2/2 - q^4 r^4/32) around a summit, and its neighbours.
    n, amplitude, q = 256, 0.01, 2 * np.pi
    for part in (0.002, 0.008, 0.02):
        load = part * 2 * np.pi * E * amplitude
        a = (3 * load / (4 * E * amplitude * q**2)) ** (1 / 3)
        assert np.pi * a**2 == pytest.approx(np.pi * (3 * part / (8 * np.pi)) ** (2 / 3))
        a = brentq(_light(load, amplitude, q), a / 2, 2 * a)
        punch = {"shape": "sinusoid", "amplitude": amplitude, "wavelength": 1.0}
        found = settled(run, [n, n], punch, load).rows[-1]
        assert found["contact_area"] == pytest.approx(np.pi * a**2, rel=1 / (a * n))


def _light(load, amplitude, q):
    """Load that a radius lacks: F = (8/3) E* alpha a^3 + (64/15) E* beta a^5 under alpha r^2 + beta r^4."""
    alpha, beta = amplitude * q**2 / 2 + LATTICE_3 * load / (4 * np.pi * E), -amplitude * q**4 / 32
    return lambda a: load - E * (8 / 3 * alpha * a**3 + 64 / 15 * beta * a**5)


@pytest.mark.parametrize("short", [0.1, 0.05, 0.01])
def test_johnsons_isotropic_wave_near_full_contact_has_penny_cracks(short, run):
    # Where pbar falls short of p* by a part s, open pockets of radius b, b^2 = 6 s/q^2 (their stress
    # intensity is zero): 1 - A = (3/2 pi) s. A pocket yields by 8 b^3/(3 E*) per pressure, so that the mean
    # gap is (16/15) (6/q^2)^(3/2) p* s^(5/2)/E*. The next term is smaller by the order of s.
    n, amplitude, q = 128, 0.01, 2 * np.pi
    limit = 2 * np.pi * E * amplitude
    punch = {"shape": "sinusoid", "amplitude": amplitude, "wavelength": 1.0}
    found = settled(run, [n, n], punch, limit * (1 - short)).rows[-1]
    b = math.sqrt(6 * short) / q
    gap = 16 / 15 * (6 / q**2) ** 1.5 * limit * short**2.5 / E
    # By the grid: as under a sphere, whose depth is off by 0.06 parts of (spacing/radius)^2.
    assert 2 * amplitude - found["depth"] == pytest.approx(gap, rel=0.5 * short + 0.1 / (b * n) ** 2)
    assert 1 - found["contact_area"] == pytest.approx(1.5 / np.pi * short, rel=0.5 * short + 1 / (b * n))


@methods
def test_johnsons_isotropic_wave_closes_beyond_its_limit(method, run):
    limit = 2 * np.pi * E * 0.01
    punch = {"shape": "sinusoid", "amplitude": 0.01, "wavelength": 1.0}
    found = settled(run, [48, 45], punch, 1.001 * limit, method).rows[-1]
    assert found["contact_area"] == 1
    assert found["depth"] == pytest.approx(0.02, rel=1e-8)
    assert settled(run, [48, 45], punch, 0.98 * limit, method).rows[-1]["contact_area"] < 1


def test_waves_in_both_directions_relax_each_at_its_own_pace(run):
    amplitude, lengths, thickness, times = (0.01, 0.02), (1.0, 0.6), 0.1, [0.25, 1.0, 4.0]
    waves = {"shape": "sinusoid", "amplitude": list(amplitude), "wavelength": list(lengths)}
    load = {"control": "load", "load": 50.0, "ramp_time": 1e-9}
    values = {"grid": {"points": [16, 13], "period": list(lengths)}, "layer.thickness": thickness}
    values |= {"punch": waves, "trajectory": load, "time": {"end": 4.0, "step": 0.25}}
    found = run(values | {"output.snapshots": times})
    assert found["contact_area"][-1] == 1
    q = 2 * np.pi / np.array(lengths)
    spectrum = relaxation_spectrum(LayeredHalfspace(thickness, 0.5, 1.0, 0.5), Zener(1.0, 10.0, 1.0), q)
    axes = np.meshgrid(*Grid((16, 13), lengths).coordinates, indexing="ij")
    cosines = [np.cos(each * x) for each, x in zip(q, axes, strict=True)]
    for time, displacement, pressure in found.snapshots:
        # In full contact from the beginning: u = h, and K(q, t) what is left of the glassy stiffness.
        left = spectrum.relaxed + (spectrum.weights * np.exp(-time / spectrum.times)).sum(axis=0)
        exact = sum(a * K * wave for a, K, wave in zip(amplitude, left, cosines, strict=True))
        flat = -sum(a * wave for a, wave in zip(amplitude, cosines, strict=True))
        np.testing.assert_allclose(pressure - pressure.mean(), exact, atol=1e-7)
        np.testing.assert_allclose(displacement, flat, atol=1e-12)


# --- lines and axes ---

CONTROLS = {"depth": {"trajectory.depth": 0.01}, "load": {"trajectory": {"control": "load", "load": 0.05}}}
STEPS = {
    "backward Euler": {"time": {"end": 1.5, "step": 0.25, "integrator": "backward_euler"}},
    "exponential": {"time": {"end": 1.5, "step": 0.25}},
    "adaptive": {"time": {"end": 1.5, "step": "adaptive", "tolerance": 0.01}},
}
OBSERVED = ["time", "contact_area", "mean_pressure", "depth", "work", "stored", "dissipated"]


@methods
@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize(
    ("steps", "n", "other", "length"),
    [
        ("backward Euler", 32, 8, 0.3),
        ("backward Euler", 33, 9, 2.0),
        ("exponential", 32, 9, 1.0),
        ("exponential", 33, 8, 0.7),
        # The first steps are so small here that an odd grid, without a point at the edge, sees rounding.
        ("adaptive", 32, 8, 2.0),
        ("adaptive", 32, 9, 0.3),
    ],
)
def test_a_surface_that_is_constant_along_an_axis_is_a_line(n, other, length, steps, control, method, run):
    settings = CONTROLS[control] | STEPS[steps] | {"layer.thickness": 0.1, "output.snapshots": [1.5]}
    settings |= {"solver": {"method": method, "tolerance": 1e-12}, "punch": {"shape": "wedge", "slope": 0.2}}
    line = run(settings | {"grid.points": n})
    (_, displacement, pressure) = line.snapshots[-1]
    for axis, along in enumerate("yx"):
        points, period = [other, other], [length, length]
        points[axis], period[axis] = n, 1.0
        found = run(settings | {"grid": {"points": points, "period": period}, "punch.along": along})
        for name in OBSERVED:
            scale = np.abs(line[name]).max()
            np.testing.assert_allclose(found[name], line[name], rtol=1e-10, atol=1e-10 * scale, err_msg=name)
        u, p = (np.moveaxis(field, axis, -1) for field in found.snapshots[-1][1:])
        np.testing.assert_allclose(u, np.broadcast_to(displacement, u.shape), atol=1e-10 * 0.01)
        np.testing.assert_allclose(p, np.broadcast_to(pressure, p.shape), atol=1e-10 * pressure.max())


@methods
@pytest.mark.parametrize("points", [(24, 36), (25, 36), (24, 35), (25, 35)])
def test_the_two_axes_are_alike(points, method, run, tmp_path):
    heights = SelfAffine(hurst=0.8, short_cutoff=0.2, rms_height=0.01, seed=1).heights(
        Grid(points, (1.0, 1.5))
    )
    values = {"trajectory.depth": 0.02, "time": {"end": 1.5, "step": 0.25}, "output.snapshots": [1.5]}
    values |= {"solver": {"method": method, "tolerance": 1e-11}}
    values |= {"punch": {"shape": "profile", "file": str(tmp_path / "h.npy")}}
    found = []
    for turned in (False, True):
        np.save(tmp_path / "h.npy", heights.T if turned else heights)
        order = slice(None, None, -1 if turned else 1)
        found.append(run(values | {"grid": {"points": list(points)[order], "period": [1.0, 1.5][order]}}))
    one, other = found
    for name in ("contact_area", "mean_pressure", "stored", "dissipated"):
        np.testing.assert_allclose(other[name], one[name], rtol=1e-8)
    assert 0.05 < one["contact_area"][-1] < 0.95
    for a, b in zip(one.snapshots[-1][1:], other.snapshots[-1][1:], strict=True):
        np.testing.assert_allclose(b.T, a, atol=1e-8 * np.abs(a).max())


# --- rough surfaces ---


def test_the_area_of_contact_grows_linearly_with_the_load_on_a_rough_surface(run):
    # pbar = A E* g'/kappa_R with kappa_R about 2 (Bush, Gibson and Thomas: (2 pi)^(1/2); Persson:
    # (8/pi)^(1/2) = 1.6; simulations: 2.0 to 2.3).
    slope, parts, seeds = 0.1, np.array([0.01, 0.02, 0.04, 0.06]), (1, 2, 3)
    rough = {"shape": "self_affine", "hurst": 0.8, "roll_off": 0.25, "short_cutoff": 1 / 16}
    rough["rms_slope"] = slope
    areas = [
        settled(run, [256, 256], rough | {"seed": seed}, part * E * slope)["contact_area"][-1]
        for seed in seeds
        for part in parts
    ]
    kappa = np.reshape(areas, (len(seeds), -1)) / parts
    assert kappa.min() > 1.8
    assert kappa.max() < 2.5
    # A dozen contacts at the smallest load: the mean over the surfaces counts.
    assert np.ptp(kappa.mean(axis=0)) < 0.1 * kappa.mean()
