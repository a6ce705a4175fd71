"""`gfmdlayer.inside`: displacements and stresses below the surface at the snapshots, as labelled data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gfmdlayer.body.body import Body
from gfmdlayer.body.inside import alike
from gfmdlayer.body.layers import Layers, thicknesses
from gfmdlayer.body.materials import Elastic
from gfmdlayer.body.pair import downwards, stacks
from gfmdlayer.body.solid import LayerDepth, beyond, places
from gfmdlayer.config import ConfigError
from gfmdlayer.config.reader import body_of
from gfmdlayer.grid.grid import Grid
from gfmdlayer.history.inside import INVARIANTS, Interior, NormalInterior, PairInterior, invariants, named
from gfmdlayer.history.traction_inside import TractionInterior
from gfmdlayer.interactive.one_contact import check_data, config_of, derived, numbers_in
from gfmdlayer.results.names import VARIABLES
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import shown

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.arrays import ComplexArray, FloatArray


@entry()
def inside(
    data: xarray.Dataset,
    depths: Sequence[float] | FloatArray,
    *,
    body: Body | Mapping[str, Any] | None = None,
    trust: bool = False,
) -> xarray.Dataset:
    """Return displacements and stresses below the surface.

    Parameters
    ----------
    data : xarray.Dataset
        Displacement and pressure of the surface, with friction also its shear traction, along x or x and y,
        on a periodic grid: one case with snapshots, as `gfmdlayer.run` and `open_case` return it, or a
        result of `gfmdlayer.solve`.
    depths : sequence of float, shape (n,)
        Depths z >= 0 below the surface of the undeformed body [length], increasing; of two bodies those below
        zero are in the counterbody, which is above.
    body : Body or mapping, optional
        A `LayerStack`, a body of `halfspace` or `bonded_layer`, or a `Pair` of them; default: the body of
        the case's configuration.
    trust : bool
        Run the Python code that the configuration names as its body; without it such a body is refused.

    Returns
    -------
    xarray.Dataset
        displacement_x, displacement_z [length], and stress_xx, stress_yy, stress_zz, stress_xz [pressure],
        positive in tension, with z downward; on a surface also displacement_y, stress_xy, stress_yz. Further
        von_mises, largest_shear (half the difference of the largest and the least principal stress), and
        shear_on_plane (magnitude of the shear stress on the plane z = const: with stress_zz, the peel stress,
        the load of an interface). A depth at an interface is there twice: first the side above it, then the
        side below. The dimension is z; its coordinate `layer` counts the layers from the surface, 0 first;
        those of a counterbody are -1, -2, ... from its surface.

    Raises
    ------
    ConfigError
        If an argument cannot be used, or if the snapshots do not determine the stresses: isolated contacts,
        and layers of different laws of which one relaxes, in snapshots without `output.inside`.

    Notes
    -----
    The fields (docs/theory/inside.md) are exact for the sampled displacement and pressure. The mean strain
    along the surface is zero. The mean of displacement_z is the same at all depths, except on a rigid base,
    where the layers are compressed one after the other. At depths below one grid spacing the fields ring.

    Examples
    --------
    The largest shear under a cylinder on a halfspace is 0.30 of the largest pressure:

    >>> body = gfmdlayer.halfspace(1.0)
    >>> found = gfmdlayer.solve(body, gfmdlayer.Parabola(radius=1.0), mean_pressure=0.001, points=2048)
    >>> below = gfmdlayer.inside(found, np.linspace(0.005, 0.03, 26), body=body)
    >>> float((below.largest_shear.max() / found.pressure.max()).round(2))
    0.3
    """
    check_data(data)
    axes = _checked(data)
    has_springs = "spring_force" in data and body is None
    shear = [f"shear_{axis}" for axis in axes if f"shear_{axis}" in data]
    solid = None if body is None else body_of(body)
    bodies, elastic = _layers(solid, data, known=has_springs, trust=trust)
    rows = _places(bodies, depths)
    leads = [str(name) for name in data["pressure"].dims if name not in axes]
    steps = [float(data[name][1] - data[name][0]) for name in axes]
    sizes = tuple(data.sizes[name] for name in axes)
    grid = Grid(sizes, tuple(n * h for n, h in zip(sizes, steps, strict=True)))
    own: list[Interior] = [
        (TractionInterior if shear else NormalInterior)(each, grid, rows) for each in bodies
    ]
    interior = own[0] if len(own) == 1 else PairInterior(own)

    def waves(name: str) -> ComplexArray:
        """Return the transforms of a field, (*leads, nq)."""
        values = data[name].transpose(*leads, *axes).to_numpy()
        lead = values.shape[: values.ndim - len(axes)]
        return np.fft.rfftn(values, axes=tuple(range(-len(axes), 0))).reshape(*lead, -1)

    def vectors(normal: ComplexArray, *along: str) -> ComplexArray:
        """Return transforms of vectors, (*leads, 1 + axes, nq)."""
        return np.stack([normal, *map(waves, along)], axis=-2)

    shape = tuple(data.sizes[name] for name in leads)
    names = (*interior.names, *INVARIANTS)
    fields_below = {named(name): np.empty((*shape, len(rows), *sizes)) for name in names}
    recorded = [
        data[f"spring_{part}"].transpose(*leads, "spring", *axes).to_numpy()
        for part in ("strain", "force")
        if has_springs
    ]
    p = waves("pressure")
    u: ComplexArray | None = waves("displacement")
    if shear:
        p, along = vectors(p, *shear), [f"displacement_{axis}" for axis in axes]
        if elastic:
            u = None
        elif len(bodies) == 1 and all(name in data and "z" not in data[name].dims for name in along):
            u = vectors(-waves("displacement"), *along)  # of `solve`
        else:
            each = [len(bodies)] * (len(bodies) > 1)
            u = np.full((*p.shape[:-2], *each, *p.shape[-2:]), np.nan, dtype=complex)
    elif len(bodies) > 1:
        u = np.stack([waves(f"displacement_{name}") for name in ("body", "counterbody")], axis=-2)
    for at in np.ndindex(shape):
        if recorded:
            springs = interior.recalled(*(of[at] for of in recorded))
        else:
            springs = interior.of_surface(None if u is None else u[at], p[at])
        for row, place in enumerate(rows):
            fields = interior.at(springs, place)
            for name, field in (fields | invariants(fields)).items():
                fields_below[named(name)][(*at, row)] = field
    meanings = {name: (variable.long_name, variable.units) for name, variable in VARIABLES.items()}
    meanings |= {name: (words, "pressure") for name, words in INVARIANTS.items()}
    coords = {
        "z": ("z", np.array([place.depth for place in rows])),
        "layer": ("z", np.array([place.layer for place in rows])),
    }
    values = {name: ([*leads, "z", *axes], field) for name, field in fields_below.items()}
    return derived(data, values, meanings, {*leads, *axes}, coords)


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
    for name in ("displacement", "pressure", *(f"shear_{axis}" for axis in "xy" if f"shear_{axis}" in data)):
        if not np.isfinite(data[name]).all():
            raise ConfigError([f"data: {name} has values that are not finite; must be known at all points"])
    return [name for name in ("x", "y") if name in data["pressure"].dims]


def _layers(
    body: object, data: xarray.Dataset, *, known: bool, trust: bool
) -> tuple[tuple[Layers, ...], bool]:
    """Return elastic layers of such moduli of each body, and whether those of the data are elastic.

    ConfigError if they do not do.

    `known`: the data have the springs of the layers, which determine the stresses whatever the laws. Without
    them the laws must relax alike. The moduli count only relative to each other but under shear traction.
    """
    if body is None:
        if (config := config_of(data, trust=trust)) is None:
            raise ConfigError(["body: missing; data has no configuration that names it; give body"])
        body = config.solid
    if not (bodies := stacks(body)):
        raise ConfigError([f"body: got {type(body).__name__}; inside needs layers, in a Pair in both bodies"])
    if len(bodies) > 1 and "displacement_counterbody" not in data:
        raise ConfigError(["data: has no displacement of each body; set output.snapshots and run it again"])
    laws = [[layer.material for layer in each.present] for each in bodies]
    if not (known or all(map(alike, laws))):
        raise ConfigError(
            [
                "body: its layers relax by different laws, and displacement and pressure of the surface do "
                "not determine the stresses below; set output.inside in the configuration and run it again"
            ]
        )
    elastic = (
        Layers([layer.with_law(Elastic(layer.material.unit)) for layer in each.present], each.rigid)
        for each in bodies
    )
    return tuple(elastic), alike([*(law for own in laws for law in own), Elastic(1.0)])


def _places(bodies: Sequence[Layers], depths: Sequence[float] | FloatArray) -> list[LayerDepth]:
    """Return depth and number of the layer of each row; a depth at an interface has two."""
    z = numbers_in(depths)
    least = " >= 0" * (len(bodies) == 1)
    if z.ndim != 1 or not z.size or not np.isfinite(z).all() or (least and (z < 0).any()):
        raise ConfigError([f"depths: got {shown(depths)}; must be numbers{least}, finite"])
    if (np.diff(z) <= 0).any():
        raise ConfigError([f"depths: got {shown(depths)}; must increase"])
    own = z[z >= 0], -z[z <= 0][::-1] + 0.0  # inwards
    for body, name, inwards in zip(bodies, ("body", "counterbody"), own, strict=False):
        if (row_and_thickness := beyond(thicknesses(body), inwards.tolist())) is not None:
            i, whole = row_and_thickness
            message = f"got {inwards[i]:g}; must be at most {whole:g}, the {name}'s thickness"
            raise ConfigError([f"depths: {message}"])
    return downwards(
        *(places(thicknesses(body), each.tolist()) for body, each in zip(bodies, own, strict=False))
    )
