"""Stresses below the surface under pressure and shear: closed forms, elasticity in 3-D, histories."""

import math

import numpy as np
import pytest
import xarray as xr

import gfmdlayer
from gfmdlayer import ConfigError, Elastic, Layer, LayerStack


def tractions(points, period=1.0, seed=0, least=0.0):
    """Random pressure and shear on a grid; without mean and short waves if a length `least` is given."""
    draw, dims = np.random.default_rng(seed), "xy"[: len(points)]
    x = [np.arange(n) * period / n for n in points]
    fields = [draw.standard_normal(points) for _ in range(1 + len(points))]
    if least:
        q = np.hypot(*np.meshgrid(*(np.fft.fftfreq(n, period / n) for n in points), indexing="ij"))
        smooth = np.exp(-((q * least) ** 2)) * (q > 0)
        fields = [np.fft.ifft2(np.fft.fft2(f) * smooth).real for f in fields]
    data = {"pressure": (tuple(dims), fields[0]), "displacement": (tuple(dims), 0 * fields[0])}
    data |= {f"shear_{axis}": (tuple(dims), f) for axis, f in zip(dims, fields[1:], strict=True)}
    return xr.Dataset(data, dict(zip(dims, x, strict=True)))


def stack(*layers):
    """Elastic layers by thickness, Poisson's ratio and modulus."""
    return LayerStack(tuple(Layer(d, nu, Elastic(G)) for d, nu, G in layers))


def test_sliding_hertz_line_has_the_stresses_of_smith_and_liu():
    """In closed form (Smith and Liu 1953, McEwen 1949): a = p0 = 1, mu = 0.3, the traction towards +x.

    Images at the period 256 change it by (pi/256)^2, the edges of samples a/64 apart by 64^-1.5 of the
    distance from the edge.
    """
    x, nu, mu = (np.arange(16384) - 8192) / 64, 0.3, 0.3
    p = np.sqrt(np.maximum(1 - x**2, 0.0))
    p *= math.pi / 2 / (p.sum() / 64)
    data = xr.Dataset(
        {"pressure": ("x", p), "displacement": ("x", 0 * p), "shear_x": ("x", mu * p)}, {"x": x}
    )
    found = gfmdlayer.inside(data, [0.3, 0.78, 1.0], body=gfmdlayer.halfspace(1.0, poisson=nu))
    support = (1 - nu / (1 - nu)) * p.mean()  # the mean of a contact without lateral support has s_xx = -p
    table = {
        (0.5, 0.3): (-0.851647, -0.275706, -0.612802),
        (-0.5, 0.3): (-0.767509, 0.004755, -0.290368),
        (0.9, 0.78): (-0.478002, -0.305771, -0.315635),
        (1.5, 1.0): (-0.196750, -0.221632, -0.286812),
    }
    for (x, z), known in table.items():
        at = found.sel(z=z).interp(x=x)
        values = at.stress_zz, at.stress_xz, at.stress_xx - support
        np.testing.assert_allclose([float(each) for each in values], known, rtol=0, atol=1e-3)


def test_the_largest_shear_comes_to_the_surface_above_a_coefficient_of_about_a_third():
    """Under a sliding Hertz line (Johnson, Contact Mechanics, 7.1): below it for 0.25, at it for 0.35.

    At the rear edge the shear at the surface is mu p0; below it the largest one is 0.30 p0 and more.
    """
    x = (np.arange(4096) - 2048) / 64
    p, z = np.sqrt(np.maximum(1 - x**2, 0.0)), np.linspace(0.0, 1.0, 51)
    deepest = {}
    for mu in (0.0, 0.25, 0.35, 0.5):
        shear = {"pressure": ("x", p), "displacement": ("x", 0 * p), "shear_x": ("x", mu * p)}
        found = gfmdlayer.inside(xr.Dataset(shear, {"x": x}), z, body=gfmdlayer.halfspace(1.0, poisson=0.3))
        deepest[mu] = float(found.largest_shear.max("x").idxmax("z"))
    assert deepest[0.0] == pytest.approx(0.78, abs=0.02)
    assert 0.2 < deepest[0.25] < 0.78
    assert deepest[0.35] == deepest[0.5] == 0.0


@pytest.mark.parametrize("points", [(48,), (47,), (24, 32), (23, 31)])
def test_a_halfspace_in_parts_is_whole_and_its_surface_carries_the_tractions(points):
    data, nu = tractions(points), 0.3
    parts = stack((0.3, nu, 1.0), (0.01, nu, 1.0), (0.5, nu, 1.0), (math.inf, nu, 1.0))
    depths = [0.0, 0.02, 0.1, 0.305, 0.5, 0.9]
    one, other = (
        gfmdlayer.inside(data, depths, body=body) for body in (parts, gfmdlayer.halfspace(1.0, poisson=nu))
    )
    for name in one:
        assert float(abs(one[name] - other[name]).max()) < 1e-12 * float(abs(other[name]).max()), name
    carried = {"stress_zz": "pressure", "stress_xz": "shear_x", "stress_yz": "shear_y"}
    for name, traction in carried.items():
        if traction in data:
            assert float(abs(one[name].isel(z=0) + data[traction]).max()) < 1e-12, name


def test_the_fields_of_a_surface_are_in_equilibrium_and_follow_hookes_law():
    """Along x and y the derivatives are exact; differences over 2e-4 in depth have an error of 1e-6."""
    n, h = 32, 1e-4
    data = tractions((n, n), seed=3, least=0.25)
    body = stack((0.1, 0.3, 3.0), (math.inf, 0.2, 1.0))
    q = 2j * np.pi * np.fft.fftfreq(n, 1 / n)

    def along(field, axis):
        return np.fft.ifft(np.fft.fft(field, axis=axis) * np.expand_dims(q, 1 - axis), axis=axis).real

    for z, G, nu in ((0.05, 3.0, 0.3), (0.2, 1.0, 0.2)):
        up, now, down = (gfmdlayer.inside(data, [z + d * h], body=body).isel(z=0) for d in (-1, 0, 1))
        s = {name[-2:]: now[name].values for name in now if name.startswith("stress")}
        s |= {"yx": s["xy"], "zx": s["xz"], "zy": s["yz"]}

        def slope(name, axis, up=up, now=now, down=down):
            if axis == "z":
                return (down[name].values - up[name].values) / (2 * h)
            return along(now[name].values, "xy".index(axis))

        size = np.abs(slope("stress_zz", "z")).max()
        for a in "xyz":
            names = [f"stress_{''.join(sorted(a + b))}" for b in "xyz"]
            total = sum(slope(name, b) for name, b in zip(names, "xyz", strict=True))
            assert np.abs(total).max() < 1e-5 * size, a
        strain = {
            a + b: (slope(f"displacement_{a}", b) + slope(f"displacement_{b}", a)) / 2
            for a in "xyz"
            for b in "xyz"
        }
        volume = sum(strain[a + a] for a in "xyz")
        for a in "xyz":
            for b in "xyz":
                hooke = 2 * G * (strain[a + b] + (a == b) * nu / (1 - 2 * nu) * volume)
                assert np.abs(s[a + b] - hooke).max() < 1e-5 * np.abs(s["zz"]).max(), a + b


def test_the_displacement_of_the_surface_is_that_of_solve():
    body = stack((0.05, 0.3, 3.0), (math.inf, 0.2, 1.0))
    given = {"depth": 0.02, "friction": 0.4, "tangential_force": 0.002}
    found = gfmdlayer.solve(body, gfmdlayer.Parabola(radius=0.3), points=(32, 32), **given)
    below = gfmdlayer.inside(found, [0.0], body=body).isel(z=0)
    size = float(abs(found.displacement).max())
    # The solver keeps displacements in its own digits, partly of single precision.
    assert float(abs(below.displacement_z + found.displacement).max()) < 1e-7 * size
    for axis in "xy":
        assert float(abs(below[f"displacement_{axis}"] - found[f"displacement_{axis}"]).max()) < 1e-7 * size


# Runs on layers that relax.


def zener(G0, Ginf, tau):
    return {"model": "zener", "G0": G0, "Ginf": Ginf, "tau": tau}


PRONY = {"model": "prony", "G0": 0.2, "branches": [{"G": 4.0, "tau": 0.1}, {"G": 5.0, "tau": 10.0}]}
DEPTHS = [0.0, 0.01, 0.05, 0.1, 0.15]
PUSH = {"tangential": {"displacement": 0.004, "ramp_time": 1.0}}
MOTIONS = {"push": PUSH, "slide": {"velocity": 0.05}, "roll": {"velocity": 0.05, "creepage": 0.05}}
BASE = {
    "time": {"end": 1.0, "step": 0.1},
    "interface": {"law": "coulomb", "coefficient": 0.4},
    "output": {"snapshots": [0.5, 1.0], "inside": {"depths": DEPTHS}},
}


def layers(first, second, base, nu=(0.45, 0.5, 0.3)):
    """Two layers on a halfspace, or without a law for it on a rigid base."""
    found = [
        {"thickness": 0.05, "poisson": nu[0], "material": first},
        {"thickness": 0.1, "poisson": nu[1], "material": second},
    ]
    below = {"poisson": nu[2], "material": base} if base else {"shear_modulus": math.inf}
    return {"layers": found, "halfspace": below}


def press(motion, **more):
    return {"trajectory": {"depth": 0.01, "ramp_time": 0.5, **motion}, **more}


@pytest.mark.parametrize("points", [256, 255, [32, 24]])
def test_the_history_of_different_laws_carries_the_tractions_of_the_solver(points):
    """The tractions are computed by the solver, not from the forces inside; fixed steps agree to rounding."""
    every = layers(zener(1, 10, 1), PRONY, zener(3, 6, 2))
    data = gfmdlayer.run(BASE | every | press(PUSH), grid={"points": points})
    found = gfmdlayer.inside(data, DEPTHS)
    assert found.layer.values.tolist() == [0, 0, 0, 1, 1, 1, 2]
    largest = float(data.pressure.max())
    for name, traction in (("zz", "pressure"), ("xz", "shear_x"), ("yz", "shear_y")):
        if traction in data:
            carried = found[f"stress_{name}"].isel(z=0) + data[traction]
            assert float(abs(carried).max()) < 1e-12 * largest, name
    size = float(abs(data.displacement).max())
    assert float(abs(found.displacement_z.isel(z=0) + data.displacement).max()) < 1e-8 * size
    for at in (2, 5):
        up, low = found.isel(z=at), found.isel(z=at + 1)
        for name in ("displacement_x", "displacement_z", "stress_zz", "stress_xz"):
            # A wave of q d > 24 is that of a halfspace in the uppermost layer: x exp(-x) = 1e-9 of it.
            assert float(abs(up[name] - low[name]).max()) < 1e-10 * float(abs(found[name]).max()), name
    for name in set(data) & set(found):  # written in single precision
        assert float(abs(data[name] - found[name]).max()) < 1e-7 * float(abs(found[name]).max()), name


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("points", [256, [32, 24]])
@pytest.mark.parametrize("rigid", [False, True])
def test_moduli_that_relax_in_proportion_have_the_stresses_of_elastic_layers(motion, points, rigid):
    """Their common factor G(t) cancels; a run keeps a history of each law, since none of them is equal."""
    G, nu = (1.0, 0.3, 2.0), (0.45, 0.3, 0.3)
    laws = [zener(each, 10 * each, 1.0) for each in G]
    every = layers(*laws[:2], None if rigid else laws[2], nu)
    data = gfmdlayer.run(BASE | every | press(MOTIONS[motion]), grid={"points": points})
    found = gfmdlayer.inside(data, DEPTHS)
    given = [Layer(d, n, Elastic(g)) for d, n, g in zip((0.05, 0.1, math.inf), nu, G, strict=True)]
    body = LayerStack(given[:2], rigid=True) if rigid else LayerStack(given)
    known = gfmdlayer.inside(data, DEPTHS, body=body)
    for name in known:
        if not name.startswith("displacement"):
            assert float(abs(known[name] - found[name]).max()) < 1e-10 * float(abs(known[name]).max()), name
    if rigid:
        for axis in "xz":
            assert float(abs(found[f"displacement_{axis}"].isel(z=-1)).max()) < 1e-15


@pytest.mark.parametrize(("end", "modulus"), [(1e-7, "Ginf"), (1e7, "G0")])
def test_fields_at_once_and_at_long_times_are_those_of_elastic_layers(end, modulus):
    """Nothing relaxes in 1e-7 of the times but 1e-6 of the moduli, and after 1e7 of them 1e-7 are left."""
    laws = zener(1, 10, 1), zener(0.2, 2, 0.3), zener(3, 6, 2)
    time = {"time": {"end": end, "step": end / 10}, "output": BASE["output"] | {"snapshots": [end]}}
    motion = press({"ramp_time": end / 4, "tangential": {"displacement": 0.004, "ramp_time": end / 2}})
    data = gfmdlayer.run(BASE | layers(*laws) | motion | time, grid={"points": 256})
    found = gfmdlayer.inside(data, DEPTHS)
    nu, thick = (0.45, 0.5, 0.3), (0.05, 0.1, math.inf)
    body = LayerStack(
        tuple(Layer(d, n, Elastic(law[modulus])) for d, n, law in zip(thick, nu, laws, strict=True))
    )
    known = gfmdlayer.inside(data.drop_vars(["spring_force", "spring_strain"]), DEPTHS, body=body)
    for name in known:
        assert float(abs(known[name] - found[name]).max()) < 3e-5 * float(abs(known[name]).max()), name


def test_other_depths_of_a_run_without_fields_inside_are_known_where_the_layers_relax_alike():
    law = zener(1, 10, 1)
    run = BASE | layers(law, law, law) | press(PUSH)
    known = gfmdlayer.inside(gfmdlayer.run(run, grid={"points": 128}), DEPTHS)
    plain = gfmdlayer.run(run, grid={"points": 128}, **{"output.inside": None})
    found = gfmdlayer.inside(plain, DEPTHS)
    for name in known:
        if name.startswith("displacement"):
            assert bool(found[name].isnull().all())
            assert bool(known[name].notnull().all())
        else:
            assert float(abs(known[name] - found[name]).max()) < 1e-11 * float(abs(known[name]).max()), name
    different = gfmdlayer.run(run | layers(law, PRONY, law), grid={"points": 128}, **{"output.inside": None})
    with pytest.raises(ConfigError, match=r"set output\.inside"):
        gfmdlayer.inside(different, DEPTHS)


def test_elastic_layers_need_no_fields_inside_and_unknown_tractions_are_refused(tmp_path):
    elastic = layers(*({"model": "elastic", "G": G} for G in (1.0, 0.3, 2.0)))
    data = gfmdlayer.run(BASE | elastic | press(PUSH), grid={"points": 128}, out=tmp_path / "run").load()
    assert "spring_force" not in data
    found = gfmdlayer.inside(data, DEPTHS)
    for name in set(data) & set(found):
        assert float(abs(data[name] - found[name]).max()) < 1e-6 * float(abs(found[name]).max()), name
    with pytest.raises(ConfigError, match="shear_x has values that are not finite"):
        gfmdlayer.inside(data.assign(shear_x=data.shear_x.where(data.x > 0)), DEPTHS)
