"""Stresses below the surface of runs and solutions: Hertz, histories, files, and bad input."""

import numpy as np
import pytest
import xarray as xr

import gfmdlayer
from gfmdlayer import ConfigError, Elastic, Layer, LayerStack, Zener


def test_hertz_line_has_its_largest_shear_below_the_surface():
    x = (np.arange(16384) - 8192) / 64
    p = np.sqrt(np.maximum(1 - x**2, 0.0))
    data = xr.Dataset({"pressure": ("x", p), "displacement": ("x", 0 * p)}, {"x": x})
    body = gfmdlayer.halfspace(Zener(G0=1.0, Ginf=10.0, tau=1.0))
    found = gfmdlayer.inside(data, [0.786151], body=body)
    # Images at the period 256 and the kinks of the samples change it by (pi/256)^2 and 64^-1.5.
    assert abs(float(found.largest_shear.sel(x=0.0).item()) - 0.300283) < 2e-3
    assert abs(float(found.von_mises.sel(x=0.0).item()) - 0.520106) < 4e-3


def test_hertz_sphere_by_huber_off_the_axis():
    n, period, nu = 384, 24.0, 0.3
    x = (np.arange(n) - n // 2) * period / n
    p = np.sqrt(np.maximum(1 - x[:, None] ** 2 - x**2, 0.0))
    data = xr.Dataset({"pressure": (("x", "y"), p), "displacement": (("x", "y"), 0 * p)}, {"x": x, "y": x})
    found = gfmdlayer.inside(data, [0.48], body=gfmdlayer.halfspace(1.0, poisson=nu)).sel(x=0.5, y=0.5)
    # The mean of a contact without lateral support, p (1 + 2 nu)/2 in place of p nu/(1 - nu).
    support = (nu / (1 - nu) - (1 + 2 * nu) / 2) * p.mean()
    known = {
        "xx": -0.140323, "yy": -0.140323, "xy": -0.023489, "zz": -0.505510, "xz": -0.140457, "yz": -0.140457,
    }  # fmt: skip
    for name, value in known.items():
        stress = found[f"stress_{name}"].item() + support * (name in ("xx", "yy"))
        assert abs(stress - value) < 2e-3, name  # spacing^1.5 at the rim over the distance to it


def test_von_mises_and_largest_shear_are_those_of_the_principal_stresses():
    draw = np.random.default_rng(1)
    x = np.arange(16) / 16
    p = draw.uniform(0, 1, (16, 16))
    surface = xr.Dataset({"pressure": (("x", "y"), p), "displacement": (("x", "y"), p)}, {"x": x, "y": x})
    line = surface.isel(y=0, drop=True)
    for data in (surface, line):
        found = gfmdlayer.inside(data, [0.1], body=gfmdlayer.halfspace(1.0, poisson=0.2)).isel(z=0)
        nothing = 0 * found.stress_xx
        names = ("xx", "xy", "xz", "xy", "yy", "yz", "xz", "yz", "zz")
        tensor = np.stack([found.get(f"stress_{each}", nothing).values for each in names], axis=-1)
        one, two, three = np.moveaxis(np.linalg.eigvalsh(tensor.reshape(*nothing.shape, 3, 3)), -1, 0)
        np.testing.assert_allclose(found.largest_shear, (three - one) / 2, rtol=1e-7)
        known = np.sqrt(((one - two) ** 2 + (two - three) ** 2 + (three - one) ** 2) / 2)
        np.testing.assert_allclose(found.von_mises, known, rtol=1e-12)


def test_snapshots_have_both_sides_of_an_interface_and_the_surface():
    soft = {"G0": 1.0, "Ginf": 1.0, "tau": 1.0, "model": "zener"}
    data = gfmdlayer.run(
        {"layer": {"thickness": 0.1, "material": soft}, "halfspace": {"shear_modulus": 9.0, "poisson": 0.3},
         "grid": {"points": 128}, "time": {"end": 1.0, "step": 0.1}, "output": {"snapshots": [0.5, 1.0]}}
    )  # fmt: skip
    found = gfmdlayer.inside(data, [0.0, 0.1])
    assert found.layer.values.tolist() == [0, 0, 1]
    np.testing.assert_allclose(found.stress_zz.isel(z=0), -data.pressure, atol=1e-13)
    np.testing.assert_allclose(found.displacement_z.isel(z=0), -data.displacement, atol=1e-15)
    up, low = found.isel(z=1), found.isel(z=2)
    np.testing.assert_allclose(up.stress_zz, low.stress_zz, atol=1e-13)
    assert float(abs(up.stress_xx - low.stress_xx).max()) > 1e-3


def zener(G0, Ginf, tau, C1=0.0):
    """A law, with a shift where C1 is given."""
    shift = {"shift": {"law": "wlf", "C1": C1, "C2": 50.0, "reference": 20.0}}
    return {"model": "zener", "G0": G0, "Ginf": Ginf, "tau": tau} | (shift if C1 else {})


DEPTHS = [0.0, 0.01, 0.02, 0.1, 0.3]
BRANCHES = {"model": "prony", "G0": 0.2, "branches": [{"G": 4.0, "tau": 0.1}, {"G": 5.0, "tau": 10.0}]}
RUN = {
    "grid": {"points": 128},
    "time": {"end": 1.0, "step": 0.1},
    "trajectory": {"depth": 0.01, "ramp_time": 0.5},
    "output": {"snapshots": [0.5, 1.0], "inside": {"depths": DEPTHS}},
}


def laws(*C1):
    """Three different laws in a stack, with shifts where they are given."""
    first, second, base = [*C1, 0.0, 0.0, 0.0][:3]
    middle = BRANCHES | {"shift": zener(1, 2, 1, second)["shift"]} if second else BRANCHES
    upper = {"thickness": 0.02, "poisson": 0.45, "material": zener(1, 10, 1, first)}
    return {
        "layers": [upper, {"thickness": 0.08, "material": middle}],
        "halfspace": {"poisson": 0.3, "material": zener(3, 6, 2, base)},
    }


def test_the_history_of_different_laws_gives_the_pressure_at_the_surface_and_equal_tractions():
    """The pressure is computed by the contact solver, not from the forces inside.

    Fixed steps are exact for u linear over a step, so that both agree to rounding.
    """
    data = gfmdlayer.run(RUN, **laws())
    found = gfmdlayer.inside(data, DEPTHS)
    assert found.layer.values.tolist() == [0, 0, 0, 1, 1, 2, 2]
    largest = float(data.pressure.max())
    assert float(abs(found.stress_zz.isel(z=0) + data.pressure).max()) < 1e-12 * largest
    assert float(abs(found.stress_xz.isel(z=0)).max()) < 1e-12 * largest
    for at in (2, 4):
        up, low = found.isel(z=at), found.isel(z=at + 1)
        for name in ("displacement_x", "displacement_z", "stress_zz", "stress_xz"):
            assert float(abs(up[name] - low[name]).max()) < 1e-12 * float(abs(found[name]).max()), name
        assert float(abs(up.stress_xx - low.stress_xx).max()) > 0.01 * largest
    for name in set(data) & set(found):  # written in single precision
        assert float(abs(data[name] - found[name]).max()) < 1e-7 * float(abs(found[name]).max()), name


@pytest.mark.parametrize(
    ("keys", "bound"),
    [
        # Layers with reduced times of their own, at the reference temperature: poles of an error of 3e-12.
        ({**laws(17.0, 10.0, 5.0), "temperature": {"value": 20.0}}, 1e-8),
        # An attraction of next to no work: the pressure is the whole stress of the surface.
        ({**laws(), "interface": {"law": "exponential", "work": 1e-9, "range": 0.001}}, 1e-3),
        # A punch that hardly moves: 1e-9 periods; iterations of the loss stiffness to 1e-6.
        ({**laws(), "trajectory.velocity": 1e-9}, 1e-5),
    ],
)
def test_all_histories_give_the_same_fields(keys, bound):
    known, found = (gfmdlayer.inside(gfmdlayer.run(RUN, **each), DEPTHS) for each in (laws(), keys))
    for name in known:
        assert float(abs(known[name] - found[name]).max()) < bound * float(abs(known[name]).max()), name


def test_fields_under_a_relaxed_contact_are_those_of_the_relaxed_moduli():
    data = gfmdlayer.run(RUN | {"time": {"end": 2000.0, "step": "adaptive"}}, **laws(),
                         **{"output.snapshots": [2000.0]})  # fmt: skip
    found = gfmdlayer.inside(data, DEPTHS)
    soft = gfmdlayer.LayerStack(tuple(Layer(*each) for each in (
        (0.02, 0.45, Elastic(1.0)), (0.08, 0.5, Elastic(0.2)), (np.inf, 0.3, Elastic(3.0)))))  # fmt: skip
    known = gfmdlayer.inside(data.drop_vars(["spring_force", "spring_strain"]), DEPTHS, body=soft)
    for name in known:  # to the tolerance of the steps, and of the solver
        assert float(abs(known[name] - found[name]).max()) < 1e-4 * float(abs(known[name]).max()), name


def test_a_compressible_stack_on_a_rigid_base_sinks_layer_by_layer():
    keys = laws() | {"halfspace": {"shear_modulus": np.inf}, "layers.1.poisson": 0.3}
    keys |= {"output.inside.depths": [0.05]}
    data = gfmdlayer.run(RUN, **keys)
    found = gfmdlayer.inside(data, [0.0, 0.02, 0.06, 0.1]).isel(snapshot=0)
    assert float(abs(found.displacement_z.isel(z=-1)).max()) < 1e-15
    assert float(abs(found.displacement_x.isel(z=-1)).max()) < 1e-15
    mean = found.displacement_z.mean("x").values
    np.testing.assert_allclose(mean[3] - mean[2], mean[4] - mean[3], rtol=1e-9)  # uniform within a layer
    assert mean[0] > mean[1] > 0.999 * mean[2] > mean[3]


def test_a_file_holds_the_fields_of_the_chosen_snapshots(tmp_path):
    keys = {"output.inside": {"points": 3, "times": [1.0]}, **laws()}
    memory = gfmdlayer.run(RUN, **keys)
    gfmdlayer.run(RUN, out=tmp_path / "run", **keys)
    with gfmdlayer.open_case(tmp_path / "run" / "cases" / "0000.h5") as case:
        assert case.z.values.tolist() == memory.z.values.tolist()
        assert case.layer.values.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2]
        assert bool(case.stress_xz.isel(snapshot=0).isnull().all())
        for name in ("displacement_x", "stress_zz", "von_mises", "spring_force"):
            np.testing.assert_array_equal(case[name], memory[name])
        found = gfmdlayer.inside(case, [0.05])
        assert bool(np.isfinite(found.von_mises.isel(snapshot=1)).all())


@pytest.mark.parametrize("in_files", [False, True])
def test_a_sweep_has_fields_below_the_surface_where_all_cases_have_their_depths(tmp_path, in_files):
    keys = {"grid.points": 64, "output.inside": {"points": 3}, "time.end": 0.5, "output.snapshots": [0.5]}
    plain = {"layer": {"material": zener(1, 5, 1)}, "halfspace": {"shear_modulus": 2.0}}
    for key, values, below in (("layer.thickness", [0.03, 0.05], False), ("layer.poisson", [0.3, 0.5], True)):
        out = {"out": tmp_path / key} if in_files else {}
        data = gfmdlayer.run(RUN, **keys, **plain, **out, sweep={key: values})
        assert data.gap.dims[0] == key.partition(".")[2]
        assert ("stress_zz" in data) == ("z" in data.coords) == below
        if below:
            one = gfmdlayer.run(RUN, **keys, **plain, **{key: values[1]})
            np.testing.assert_array_equal(data.stress_zz.isel(poisson=1), one.stress_zz)


@pytest.mark.parametrize(
    ("body", "depths", "said"),
    [
        (LayerStack((Layer(0.1, 0.5, Zener()), Layer(0.1, 0.5, Elastic(1.0)))), [0.1], "set output.inside"),
        (LayerStack((Layer(0.1, 0.5, Elastic(1.0)),), rigid=True), [0.05, 0.2], "at most 0.1"),
        (gfmdlayer.halfspace(1.0), [-0.1], "numbers >= 0"),
        (gfmdlayer.halfspace(1.0), [0.2, 0.1], "must increase"),
        (gfmdlayer.halfspace(1.0), ["a"], "numbers >= 0"),
        (None, [0.1], "body: missing"),
    ],
)
def test_what_cannot_be_used_is_refused(body, depths, said):
    x = np.arange(8) / 8
    data = xr.Dataset({"pressure": ("x", x), "displacement": ("x", x)}, {"x": x})
    with pytest.raises(ConfigError, match=said):
        gfmdlayer.inside(data, depths, body=body)


def test_isolated_contacts_and_unknown_displacements_are_refused():
    body = gfmdlayer.halfspace(1.0)
    given = {"punch": gfmdlayer.Parabola(radius=1.0), "points": (32, 32)}
    isolated = gfmdlayer.solve(body, **given, force=0.005, isolated=True)
    with pytest.raises(ConfigError, match="is an isolated contact; must have a periodic grid"):
        gfmdlayer.inside(isolated, [0.1], body=body)
    periodic = gfmdlayer.solve(body, **given, force=0.005)
    unknown = periodic.assign(displacement=periodic.displacement.where(periodic.x > 0))
    with pytest.raises(ConfigError, match="displacement has values that are not finite"):
        gfmdlayer.inside(unknown, [0.1], body=body)


def body_of(*layers, modulus):
    return {"layers": list(layers), "halfspace": {"shear_modulus": modulus, "poisson": 0.35}}


@pytest.mark.parametrize("points", [128, [16, 16]])
def test_the_fields_of_two_bodies_are_those_of_each_body_alone_under_the_same_pressure(points):
    """Elastic layers on halfspaces: each body alone, as a body of its own under the pressure of the pair."""
    film = {"thickness": 0.02, "poisson": 0.4, "material": {"model": "elastic", "G": 4.0}}
    lower = {"thickness": 0.1, "poisson": 0.45, "material": {"model": "elastic", "G": 1.0}}
    one, two = body_of(film, lower, modulus=5.0), body_of(lower, modulus=2.0)
    data = gfmdlayer.run(
        {**one, "counterbody": two, "grid": {"points": points}, "time": {"end": 1.0, "step": 0.5},
         "output": {"snapshots": [1.0], "inside": {"depths": [0.01, 0.1, 0.2], "every": 1}}}
    )  # fmt: skip
    assert data.z.values.tolist() == [-0.2, -0.1, -0.1, -0.01, 0.01, 0.1, 0.2]
    assert data.layer.values.tolist() == [-2, -2, -1, -1, 0, 1, 2]
    found = gfmdlayer.inside(data, [-0.2, -0.01, 0.01, 0.2])
    for keys, name, sign in ((one, "body", 1), (two, "counterbody", -1)):
        own = data.assign(displacement=data[f"displacement_{name}"]).isel(z=[])
        alone = gfmdlayer.inside(own, [0.01, 0.2], body=gfmdlayer.Config(name="a", **keys).solid)
        for field in ("displacement_x", "displacement_z", "stress_xx", "stress_zz", "stress_xz", "von_mises"):
            odd = sign if field in ("displacement_z", "stress_xz") else 1
            expected, scale = odd * alone[field], 1e-12 * float(abs(alone[field]).max())
            for z in (0.01, 0.2):
                there = found[field].sel(z=sign * z)
                np.testing.assert_allclose(there, expected.sel(z=z), rtol=0, atol=scale)
                np.testing.assert_allclose(data[field].sel(z=sign * z), there, rtol=0, atol=1e6 * scale)
    assert data.interface.values.tolist() == [-1, 0, 1]


def test_two_bodies_that_relax_by_different_laws_have_the_pressure_at_the_contact():
    """The pressure is computed by the contact solver; each body follows its own history, sliding or not."""
    for motion in ({}, {"trajectory.velocity": 0.05}):
        data = gfmdlayer.run(RUN, **laws(), counterbody=laws(), **motion)
        found = gfmdlayer.inside(data, [-0.1, 0.0, 0.1])
        assert found.layer.values.tolist() == [-3, -2, -1, 0, 1, 2]
        largest = float(data.pressure.max())
        for surface in (2, 3):
            at = found.isel(z=surface)
            assert float(abs(at.stress_zz + data.pressure).max()) < 1e-5 * largest
            assert float(abs(at.stress_xz).max()) < 1e-5 * largest


@pytest.mark.parametrize("points", [64, [12, 12]])
@pytest.mark.parametrize("law", ["elastic", "zener"])
def test_bonds_of_two_coated_rollers_are_those_of_each_under_its_own_tractions(points, law):
    """Rolling with a creepage: elastic bodies alone under (p, t) and (p, -t); others in equilibrium."""
    film = {"thickness": 0.02, "poisson": 0.4, "material": {"model": law}}
    lower = {"thickness": 0.1, "poisson": 0.45, "material": {"model": "elastic", "G": 1.0}}
    one, two = body_of(film, lower, modulus=5.0), body_of(lower, modulus=2.0)
    motion = {"velocity": 0.5, "creepage": 0.02, "depth": 0.01, "ramp_time": 0.5}
    data = gfmdlayer.run(
        {**one, "counterbody": two, "grid": {"points": points}, "time": {"end": 1.0, "step": 0.125},
         "interface": {"law": "coulomb", "coefficient": 0.3}, "trajectory": motion,
         "output": {"snapshots": [1.0], "inside": {"depths": [0.0, 0.01, 0.1, 0.2], "every": 4}}}
    )  # fmt: skip
    found = gfmdlayer.inside(data, [-0.2, -0.1, -0.01, 0.0, 0.01, 0.02, 0.2])
    largest = float(data.pressure.max())
    assert float(abs(data.shear_x).max()) > 0.1 * largest
    for layer in (0, -1):  # tractions on z = const are those of both sides
        at = found.isel(z=int(np.flatnonzero((found.z == 0) & (found.layer == layer))[0]))
        np.testing.assert_allclose(at.stress_zz, -data.pressure, rtol=0, atol=1e-6 * largest)
        np.testing.assert_allclose(at.stress_xz, -data.shear_x, rtol=0, atol=1e-6 * largest)
    for z in (-0.1, 0.02):  # both sides of a bond carry the same
        above, below = (found.isel(z=int(i)) for i in np.flatnonzero(found.z == z))
        for field in ("stress_zz", "stress_xz"):
            np.testing.assert_allclose(above[field], below[field], rtol=0, atol=1e-6 * largest)
    if law == "zener":
        return
    for keys, sign in ((one, 1), (two, -1)):
        own = data.isel(z=[]).assign(
            {each: sign * data[each] for each in ("shear_x", "shear_y") if each in data}
        )
        alone = gfmdlayer.inside(own, [0.01, 0.2], body=gfmdlayer.Config(name="a", **keys).solid)
        for field in ("displacement_x", "displacement_z", "stress_xx", "stress_zz", "stress_xz", "von_mises"):
            odd = sign if field in ("displacement_z", "stress_xz") else 1
            for z in (0.01, 0.2):
                scale = 1e-12 * float(abs(alone[field]).max())
                np.testing.assert_allclose(
                    found[field].sel(z=sign * z), odd * alone[field].sel(z=z), rtol=0, atol=scale
                )
