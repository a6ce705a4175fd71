"""`gfmdlayer.inside`: displacements and stresses below the surface at the snapshots, as labelled data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.body.body import Body, ViscoelasticLayer
from gfmdlayer.body.inside import Inside
from gfmdlayer.body.materials import Elastic, Law, Material
from gfmdlayer.body.stack import Layer, LayerStack
from gfmdlayer.config import ConfigError, load
from gfmdlayer.config.layers import Layers
from gfmdlayer.results.provenance import provenance
from gfmdlayer.validation.problems import shown
from gfmdlayer.validation.units import Units

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.arrays import FloatArray

_SAME = 1e-12  # relative: a depth this close to an interface is on it
_NAMES = {
    "x": "displacement along x",
    "y": "displacement along y",
    "z": "displacement along z, positive downward",
    "xx": "normal stress along x, positive in tension",
    "yy": "normal stress along y, positive in tension",
    "zz": "normal stress along z, positive in tension: the peel stress of an interface",
    "xy": "shear stress xy",
    "xz": "shear stress xz",
    "yz": "shear stress yz",
}


def inside(
    data: xarray.Dataset, depths: Sequence[float] | FloatArray, *, body: Body | None = None
) -> xarray.Dataset:
    """Return displacements and stresses below the surface.

    Parameters
    ----------
    data : xarray.Dataset
        Displacement and pressure of the surface, along x or x and y, on a periodic grid: one case with
        snapshots, as `gfmdlayer.run` and `open_case` return it, or what `gfmdlayer.solve` returns.
    depths : sequence of float, shape (n,)
        Depths z >= 0 below the surface of the undeformed body [length], increasing.
    body : Body, optional
        A `LayerStack`, or a body of `halfspace` or `bonded_layer`; default: that of the configuration of the
        case.

    Returns
    -------
    xarray.Dataset
        displacement_x, displacement_z [length], and stress_xx, stress_yy, stress_zz, stress_xz [pressure],
        positive in tension, with z downward; on a surface also displacement_y, stress_xy, stress_yz. Further
        von_mises, largest_shear (half the difference of the largest and the least principal stress), and
        shear_on_plane (magnitude of the shear stress on the plane z = const: with stress_zz, the peel stress,
        the load of an interface). A depth at an interface is there twice: first the side above it, then the
        side below; the coordinate `layer` counts the layers from the surface, 0 first.

    Raises
    ------
    ConfigError
        If an argument cannot be used, or if the snapshots do not determine the stresses: for layers of
        different laws of which one relaxes, two deformable bodies, friction, attraction, and isolated
        contacts.

    Notes
    -----
    The fields (docs/theory/inside.md) are exact for the sampled displacement and pressure. The mean
    strain along the surface is zero.
    The mean of displacement_z is that of the surface at all depths, but on a rigid base, where the layers are
    compressed one after the other. At depths below one grid spacing the fields ring.

    Examples
    --------
    The largest shear under a cylinder on a halfspace is 0.30 of the largest pressure:

    >>> body = gfmdlayer.halfspace(1.0)
    >>> found = gfmdlayer.solve(body, gfmdlayer.Parabola(radius=1.0), mean_pressure=0.001, points=2048)
    >>> below = gfmdlayer.inside(found, np.linspace(0.005, 0.03, 26), body=body)
    >>> float((below.largest_shear.max() / found.pressure.max()).round(2))
    0.3
    """
    grid = _checked(data)
    stack = _stack(body, data)
    places = _places(stack, depths)
    leads = [str(name) for name in data["pressure"].dims if name not in grid]
    axes = tuple(range(-len(grid), 0))
    sizes = [data.sizes[name] for name in grid]
    steps = [float(data[name][1] - data[name][0]) for name in grid]
    u, p = (
        np.fft.rfftn(data[name].transpose(*leads, *grid).to_numpy(), axes=axes)
        for name in ("displacement", "pressure")
    )
    waves = [2 * np.pi * np.fft.fftfreq(n, h) for n, h in zip(sizes, steps, strict=True)]
    waves[-1] = 2 * np.pi * np.fft.rfftfreq(sizes[-1], steps[-1])
    qs = np.meshgrid(*waves, indexing="ij")
    size = np.sqrt(sum(each**2 for each in qs))
    different, where = np.unique(size, return_inverse=True)
    where = where.reshape(size.shape)
    # Odd fields have no wave at the largest wavenumber of an even axis: its two waves are one there.
    odd = [
        np.where(np.abs(each) < np.pi / h * (1 - 1e-9), 1.0, 0.0) for each, h in zip(qs, steps, strict=True)
    ]
    n = [np.where(size > 0, each / np.where(size > 0, size, 1.0), 0.0) for each in qs]
    along = [each * keep for each, keep in zip(n, odd, strict=True)]
    field = Inside(stack, different[1:])
    names = ["x", "z", "xx", "yy", "zz", "xz"] if len(grid) == 1 else list(_NAMES)
    shape = (*data["pressure"].transpose(*leads, *grid).shape[: len(leads)], len(places), *sizes)
    found = {name: np.zeros(shape) for name in names}
    at_mean = (0,) * len(grid)

    def back(values: FloatArray) -> FloatArray:
        from scipy.fft import irfftn

        return np.asarray(irfftn(values, s=sizes, axes=axes))

    for row, (depth, number) in enumerate(places):
        wave = field.at(depth, number)
        nu = stack.present[number].poisson
        lateral = -nu / (1 - nu)
        means = [_mean(stack, depth), 0.0], [-1.0, 0.0, lateral, lateral]
        W, U = (np.append(m, v)[where] for m, v in zip(means[0], wave.displacement, strict=True))
        szz, S, snn, stt = (np.append(m, v)[where] for m, v in zip(means[1], wave.stress, strict=True))
        down = -u  # the surface's displacement is positive upward
        spectra = {"z": W * down, "x": 1j * along[0] * U * down, "zz": szz * p, "xz": 1j * along[0] * S * p}
        if len(grid) == 1:
            spectra |= {"xx": snn * p, "yy": stt * p}
        else:
            one, two = n[0] ** 2, n[1] ** 2
            one[at_mean], two[at_mean] = 1.0, 0.0
            spectra |= {
                "xx": (one * snn + two * stt) * p,
                "yy": (two * snn + one * stt) * p,
                "xy": along[0] * along[1] * (snn - stt) * p,
                "y": 1j * along[1] * U * down,
                "yz": 1j * along[1] * S * p,
            }
        for name, values in spectra.items():
            found[name][(slice(None),) * len(leads) + (row,)] = back(values)
    return _labelled(data, found, places, leads, grid)


def _checked(data: xarray.Dataset) -> list[str]:
    """Return the axes of the grid; ConfigError for data that cannot be used."""
    if not {"displacement", "pressure"} <= {*data} or "x" not in data["pressure"].dims:
        raise ConfigError(
            ["data: has no displacement and pressure along x; set output.snapshots and run it again"]
        )
    if data.sizes.get("snapshot", 1) == 0:
        raise ConfigError(["data: has no snapshot; set output.snapshots and run the configuration again"])
    is_isolated = (
        "reach" in data.attrs or "area" in data or ("config" in data.attrs and "L" not in data.attrs)
    )
    if is_isolated:  # beyond its reach the displacement is not known
        raise ConfigError(["data: is an isolated contact; must have a periodic grid"])
    for name in ("displacement", "pressure"):
        if not np.isfinite(data[name]).all():
            raise ConfigError([f"data: {name} has values that are not finite; must be known at all points"])
    for name, reason in (("traction", "attraction"), ("shear_x", "friction")):
        if name in data:
            raise ConfigError([f"data: is a contact with {reason}; must be one of pressure alone"])
    return [name for name in ("x", "y") if name in data["pressure"].dims]


def _stack(body: object, data: xarray.Dataset) -> LayerStack:
    """Return layers whose moduli count only relative to each other; ConfigError where none determine it."""
    if body is None:
        if "config" not in data.attrs:
            raise ConfigError(["body: missing; data has no configuration that names it"])
        config = load(Path("case"), content=str(data.attrs["config"]))
        solid = config.solid
        if config.interfaces:
            raise ConfigError(["interface: attracts; inside needs a contact of pressure alone"])
        if not isinstance(solid, Layers):
            raise ConfigError(
                [f"body: got {type(solid).__name__}; inside needs layers without a counterbody"]
            )
        base = solid.base
        parts: list[tuple[float, float, Law]] = [
            (each.thickness, each.poisson, each.material) for each in solid.layers
        ]
        rigid, below = base.shear_modulus == math.inf, base.material
        if below is None and base.shear_modulus and not rigid:
            below = Elastic(base.shear_modulus)
        if below is not None:
            parts.append((math.inf, base.poisson, below))
    elif isinstance(body, LayerStack):
        rigid = body.rigid
        parts = [(each.thickness, each.poisson, each.material) for each in body.layers]
    elif isinstance(body, ViscoelasticLayer):
        of = body.layer
        rigid = math.isinf(of.bulk_modulus)
        parts = [(of.thickness, of.poisson, body.material)]
        if 0 < of.bulk_modulus < math.inf:
            parts.append((math.inf, of.bulk_poisson, Elastic(of.bulk_modulus)))
    else:
        raise ConfigError([f"body: got {type(body).__name__}; inside needs a LayerStack or one layer"])
    parts = [part for part in parts if part[0] > 0]
    deep = [i for i, part in enumerate(parts) if math.isinf(part[0])]
    parts = parts[: deep[0] + 1] if deep else parts
    laws = [law for *_, law in parts]
    if all(law == laws[0] for law in laws):
        laws = [Elastic(1.0)] * len(laws)
    elif not all(isinstance(law, Material) and law.elastic for law in laws):
        raise ConfigError(
            [
                "body: its layers relax by different laws, and displacement and pressure of the surface do "
                "not determine the stresses below; inside needs elastic layers, or the same law in all"
            ]
        )
    layers = tuple(Layer(d, nu, law) for (d, nu, _), law in zip(parts, laws, strict=True))  # type: ignore[arg-type]
    return LayerStack(layers, rigid=rigid and not deep)


def _places(stack: LayerStack, depths: Sequence[float] | FloatArray) -> list[tuple[float, int]]:
    """Return depth and number of the layer of each row; a depth at an interface has two."""
    try:
        given = np.atleast_1d(np.asarray(depths, dtype=float))
    except (TypeError, ValueError):
        given = np.array([math.nan])
    if given.ndim != 1 or not given.size or not np.isfinite(given).all() or (given < 0).any():
        raise ConfigError([f"depths: got {shown(depths)}; must be numbers >= 0, finite"])
    if (np.diff(given) <= 0).any():
        raise ConfigError([f"depths: got {shown(depths)}; must increase"])
    faces = np.cumsum([layer.thickness for layer in stack.present])
    if given[-1] > faces[-1] * (1 + _SAME):
        raise ConfigError([f"depths: got {given[-1]:g}; must be at most {faces[-1]:g}, the body's thickness"])
    places = []
    for depth in given.tolist():
        near = np.flatnonzero(np.abs(faces - depth) <= _SAME * depth)
        if near.size:
            at, last = int(near[0]), len(faces) - 1
            places += [(float(faces[at]), number) for number in (at, at + 1) if number <= last]
        else:
            places.append((depth, int(np.searchsorted(faces, depth))))
    return places


def _mean(stack: LayerStack, depth: float) -> float:
    """Return the mean displacement at a depth over that of the surface."""
    top, above, whole = 0.0, 0.0, 0.0
    if not stack.rigid:
        return 1.0
    for layer in stack.present:
        nu = layer.poisson
        softness = (1 - 2 * nu) / (2 * (1 - nu)) / layer.material.relaxed
        above += softness * min(max(depth - top, 0.0), layer.thickness)
        whole += softness * layer.thickness
        top += layer.thickness
    return 1 - above / whole if whole else 0.0


def _labelled(
    data: xarray.Dataset,
    found: dict[str, FloatArray],
    places: list[tuple[float, int]],
    leads: list[str],
    grid: list[str],
) -> xarray.Dataset:
    """Return the fields and what follows from them, with names, units and coordinates."""
    import xarray

    named = str(data.attrs.get("units", ""))
    label = Units(**dict(part.split(": ") for part in named.split(", "))).label if named else str
    dims = [*leads, "depth", *grid]
    held = {}
    for name, values in found.items():
        kind, unit = ("displacement", "length") if len(name) == 1 else ("stress", "pressure")
        held[f"{kind}_{name}"] = (dims, values, {"long_name": _NAMES[name], "units": label(unit)})
    xx, yy, zz, xz = (found[name] for name in ("xx", "yy", "zz", "xz"))
    xy, yz = found.get("xy", np.zeros(1)), found.get("yz", np.zeros(1))
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    second = ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) / 6 + xy**2 + xz**2 + yz**2
    third = a * b * c + 2 * xy * xz * yz - a * yz**2 - b * xz**2 - c * xy**2
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.nan_to_num(np.clip(1.5 * np.sqrt(3.0) * third / second**1.5, -1, 1))
    derived = {
        "von_mises": ("von Mises stress", np.sqrt(3 * second)),
        # Principal stresses: mean + 2 sqrt(J2/3) cos(angle + 2 pi k/3).
        "largest_shear": ("largest shear stress", np.sqrt(second) * np.sin((np.arccos(cosine) + np.pi) / 3)),
        "shear_on_plane": ("shear stress on planes of constant depth", np.hypot(xz, yz)),
    }
    for name, (words, values) in derived.items():
        held[name] = (dims, values, {"long_name": words, "units": label("pressure")})
    z = {"long_name": "depth below the surface", "units": label("length")}
    coords = {name: each for name, each in data.coords.items() if {*map(str, each.dims)} <= {*leads, *grid}}
    coords |= {
        "depth": ("depth", np.array([depth for depth, _ in places]), z),
        "layer": ("depth", np.array([number for _, number in places]), {"long_name": "number of the layer"}),
    }
    scales = {name: data.attrs[name] for name in ("name", "L", "G0", "tau", "units") if name in data.attrs}
    return xarray.Dataset(held, coords, {**provenance(), **scales})
