"""`gfmdlayer.inside`: tables of fields, the equations of elasticity, Hertz, and bad input."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import xarray as xr

import gfmdlayer
from gfmdlayer import ConfigError, Elastic, Layer, LayerStack, Zener
from gfmdlayer.body.inside import Inside


def stack(*moduli: float) -> LayerStack:
    """Three layers on a halfspace."""
    shapes = ((0.3, 0.45), (0.2, 0.5), (0.5, 0.3), (math.inf, 0.4))
    return LayerStack(tuple(Layer(*shape, Elastic(G)) for shape, G in zip(shapes, moduli, strict=True)))


@pytest.mark.parametrize(
    ("moduli", "depth", "known"),
    [  # of a solution in 40 digits, q = 5
        ((10, 2, 20, 10), 0.3, (
            0.6042193548, -0.5268193687, -34.9657466224, 1.8765533221, 67.1770016143, 14.4950647463)),
        ((1, 0.2, 5, 8), 0.1, (
            0.9325780042, -0.1682645284, -5.9623231464, 2.4353037701, -1.8189093309, -3.5015546148)),
    ],
)  # fmt: skip
def test_fields_are_those_of_a_solution_in_40_digits(
    moduli: tuple[float, ...], depth: float, known: tuple[float, ...]
) -> None:
    field = Inside(stack(*moduli), np.array([5.0]))
    found = field.at(depth, 0)
    values = np.ravel((*found.displacement, *(each * field.surface for each in found.stress)))
    np.testing.assert_allclose(values, known, rtol=0, atol=1e-10)  # the digits given


def test_equilibrium_hooke_and_continuity_at_random_stacks_and_depths() -> None:
    draw = np.random.default_rng(3)
    q = np.array([0.1, 1.0, 7.0, 40.0])
    for case in range(24):
        rigid, count = case % 3 == 0, int(draw.integers(1, 5))
        thick = [*(10 ** draw.uniform(-1.5, 0, count)).tolist()]
        if case % 3 == 1:
            thick[-1] = math.inf
        nus = [0.5 if draw.random() < 0.3 else float(draw.uniform(0, 0.5)) for _ in thick]
        G = (10 ** draw.uniform(-1, 1, count)).tolist()
        body = LayerStack(
            tuple(Layer(d, n, Elastic(g)) for d, n, g in zip(thick, nus, G, strict=True)), rigid
        )
        field, top = Inside(body, q), 0.0
        for i, (d, nu, g) in enumerate(zip(thick, nus, G, strict=True)):
            # The derivative by a complex step has no difference of close numbers.
            depth = top + draw.uniform(0, 1) * min(d, 1.0)
            found = field.at(depth + 1e-30j, i)  # type: ignore[arg-type]
            (W, U), (szz, S, snn, _) = found.displacement, (each * field.surface for each in found.stress)
            dW, dU, dszz, dS = (each.imag * 1e30 for each in (W, U, szz, S))
            W, U, szz, S, snn = (each.real for each in (W, U, szz, S, snn))
            # Even and odd motions of a layer cancel towards its lower face: rounding is relative to the
            # largest field in the layer, at its faces or here.
            faces = [field.at(face, i) for face in (top, top + min(d, 1.0))]
            stresses = [np.abs(each * field.surface) for face in faces for each in face.stress[:3]]
            moved = [g * q * np.abs(each) for face in faces for each in face.displacement]
            size = q * np.max([*np.abs([szz, S, snn, g * q * W, g * q * U]), *stresses, *moved], axis=0)
            dilatation = dW - q * U
            # Times 1 - 2 nu, so that it also holds for an incompressible layer, whose dilatation is zero.
            bulk = q * ((1 - 2 * nu) * (szz - 2 * g * dW) - 2 * nu * g * dilatation)
            for wrong in (
                dszz - q * S,
                dS + q * snn,
                q * (S - g * (dU + q * W)),
                q * (szz - snn - 2 * g * (dW + q * U)),
                bulk,
            ):
                assert (np.abs(wrong) <= 1e-12 * size).all()
            top += d
            if i + 1 < count:
                up, low = field.at(top, i), field.at(top, i + 1)
                # Relative to the surface's field, or to the largest component: a thin plate bends, and its
                # stress along the wave is some 1/(q d)^2 of the pressure.
                for above, below in ((up.displacement, low.displacement), (up.stress, low.stress)):
                    largest = 1 + np.max(np.abs([*above, *below]), axis=0)
                    for one, two in zip(above[:2], below[:2], strict=True):
                        assert (np.abs(one - two) < 1e-12 * largest).all()


def test_hertz_line_has_its_largest_shear_below_the_surface() -> None:
    x = (np.arange(16384) - 8192) / 64
    p = np.sqrt(np.maximum(1 - x**2, 0.0))
    data = xr.Dataset({"pressure": ("x", p), "displacement": ("x", 0 * p)}, {"x": x})
    body = gfmdlayer.halfspace(Zener(G0=1.0, Ginf=10.0, tau=1.0))
    found = gfmdlayer.inside(data, [0.786151], body=body)
    # Images at the period 256 and the kinks of the samples change it by (pi/256)^2 and 64^-1.5.
    assert abs(float(found.largest_shear.sel(x=0.0).item()) - 0.300283) < 2e-3
    assert abs(float(found.von_mises.sel(x=0.0).item()) - 0.520106) < 4e-3


def test_hertz_sphere_by_huber_off_the_axis() -> None:
    n, period, nu = 384, 24.0, 0.3
    x = (np.arange(n) - n // 2) * period / n
    p = np.sqrt(np.maximum(1 - x[:, None] ** 2 - x**2, 0.0))
    data = xr.Dataset({"pressure": (("x", "y"), p), "displacement": (("x", "y"), 0 * p)}, {"x": x, "y": x})
    found = gfmdlayer.inside(data, [0.48], body=gfmdlayer.halfspace(1.0, poisson=nu)).sel(x=0.5, y=0.5)
    # The mean of a contact without lateral support, p (1 + 2 nu)/2 in place of p nu/(1 - nu).
    support = (nu / (1 - nu) - (1 + 2 * nu) / 2) * p.mean()
    known = {
        "xx": -0.140323,
        "yy": -0.140323,
        "xy": -0.023489,
        "zz": -0.505510,
        "xz": -0.140457,
        "yz": -0.140457,
    }
    for name, value in known.items():
        stress = found[f"stress_{name}"].item() + support * (name in ("xx", "yy"))
        assert abs(stress - value) < 2e-3, name  # spacing^1.5 at the rim over the distance to it


def test_snapshots_have_both_sides_of_an_interface_and_the_surface() -> None:
    soft = {"G0": 1.0, "Ginf": 1.0, "tau": 1.0, "model": "zener"}
    data = gfmdlayer.run(
        {"layer": {"thickness": 0.1, "material": soft}, "halfspace": {"shear_modulus": 9.0, "poisson": 0.3},
         "grid": {"points": 128}, "time": {"end": 1.0, "step": 0.1}, "output": {"snapshots": [0.5, 1.0]}}
    )  # fmt: skip
    found = gfmdlayer.inside(data, [0.0, 0.1])
    assert found.layer.values.tolist() == [0, 0, 1]
    np.testing.assert_allclose(found.stress_zz.isel(depth=0), -data.pressure, atol=1e-13)
    np.testing.assert_allclose(found.displacement_z.isel(depth=0), -data.displacement, atol=1e-15)
    up, low = found.isel(depth=1), found.isel(depth=2)
    np.testing.assert_allclose(up.stress_zz, low.stress_zz, atol=1e-13)
    assert float(abs(up.stress_xx - low.stress_xx).max()) > 1e-3


@pytest.mark.parametrize(
    ("body", "depths", "said"),
    [
        (
            LayerStack((Layer(0.1, 0.5, Zener()), Layer(0.1, 0.5, Elastic(1.0)))),
            [0.1],
            "relax by different laws",
        ),
        (LayerStack((Layer(0.1, 0.5, Elastic(1.0)),), rigid=True), [0.05, 0.2], "at most 0.1"),
        (gfmdlayer.halfspace(1.0), [-0.1], "numbers >= 0"),
        (gfmdlayer.halfspace(1.0), [0.2, 0.1], "must increase"),
        (gfmdlayer.halfspace(1.0), ["a"], "numbers >= 0"),
        (None, [0.1], "body: missing"),
    ],
)
def test_what_cannot_be_used_is_refused(body: Any, depths: list[float], said: str) -> None:
    x = np.arange(8) / 8
    data = xr.Dataset({"pressure": ("x", x), "displacement": ("x", x)}, {"x": x})
    with pytest.raises(ConfigError, match=said):
        gfmdlayer.inside(data, depths, body=body)


def test_isolated_contacts_and_unknown_displacements_are_refused() -> None:
    body = gfmdlayer.halfspace(1.0)
    given: dict[str, Any] = {"punch": gfmdlayer.Parabola(radius=1.0), "points": (32, 32)}
    isolated = gfmdlayer.solve(body, **given, force=0.005, isolated=True)
    with pytest.raises(ConfigError, match="is an isolated contact; must have a periodic grid"):
        gfmdlayer.inside(isolated, [0.1], body=body)
    periodic = gfmdlayer.solve(body, **given, force=0.005)
    unknown = periodic.assign(displacement=periodic.displacement.where(periodic.x > 0))
    with pytest.raises(ConfigError, match="displacement has values that are not finite"):
        gfmdlayer.inside(unknown, [0.1], body=body)
