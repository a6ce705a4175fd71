"""Elastic contacts: closed forms on a halfspace, published factors of layers, JKR."""

import math

import numpy as np
import pytest

from gfmdlayer import Elastic, FlatPunch, Layer, LayeredHalfspace, LayerStack, Prony, indent
from gfmdlayer.body.layers import ViscoelasticLayer
from gfmdlayer.indentation.solve import Edge, History, follow
from gfmdlayer.punch import revolution

NU = 0.3
INF = math.inf


def layer(thickness, poisson, base, base_poisson=0.5):
    """Return an elastic layer of unit modulus."""
    return ViscoelasticLayer(LayeredHalfspace(thickness, poisson, base, base_poisson), Prony(1.0))


HALFSPACE = layer(INF, NU, 1.0)


def press(body, indenter, value, *, by_force=False):
    """Press to a depth or with a force."""
    return follow(body, indenter, History(np.array([0.0, 1.0]), np.array([0.0, value]), by_force))


def closed_form(name, a):
    """Return indenter, depth and force of a contact of radius a on the halfspace (Sneddon 1965)."""
    stiff = 2 / (1 - NU)
    match name:
        case "paraboloid":
            return revolution.paraboloid(2.0), a**2 / 2, 4 * stiff * a**3 / (3 * 2)
        case "cone":
            depth = math.pi / 2 * 0.3 * a
            return revolution.cone(0.3), depth, stiff * a * depth
        case "sphere":
            log = math.log((2 + a) / (2 - a))
            return revolution.sphere(2.0), a / 2 * log, stiff * ((a * a + 4) / 2 * log - 2 * a)
    return revolution.flat(a), 0.1, 2 * stiff * a * 0.1


@pytest.mark.parametrize("name", ["paraboloid", "cone", "sphere", "flat"])
@pytest.mark.parametrize("a", [1e-6, 0.4, 1.2])
def test_depth_and_force_on_a_halfspace_are_those_of_sneddon(name, a):
    indenter, depth, force = closed_form(name, a)
    by_depth = press(HALFSPACE, indenter, depth)
    assert by_depth.force[-1] == pytest.approx(force, rel=1e-10)
    assert by_depth.radius[-1] == pytest.approx(a, rel=1e-9)
    assert press(HALFSPACE, indenter, force, by_force=True).depth[-1] == pytest.approx(depth, rel=1e-10)


@pytest.mark.parametrize(
    ("poisson", "factors"),
    [
        (0.5, (1.2806, 1.6837, 2.2129, 2.8602, 3.6187, 6.0030, 9.1495, 18.1574)),
        (0.4, (1.2323, 1.5422, 1.9178, 2.3402, 2.7938, 4.0100, 5.2985, 7.9916)),
        (0.3, (1.2066, 1.4726, 1.7848, 2.1260, 2.4835, 3.4090, 4.3532, 6.2613)),
    ],
)
def test_flat_punch_on_a_bonded_layer(poisson, factors):
    for a, factor in zip((0.2, 0.4, 0.6, 0.8, 1.0, 1.5, 2.0, 3.0), factors, strict=True):
        force = press(layer(1.0, poisson, INF), revolution.flat(a), 0.1).force[-1]
        assert force * (1 - poisson) / (4 * a * 0.1) == pytest.approx(factor, abs=5.1e-5)


def test_layer_of_the_base_s_material_is_a_halfspace():
    bare = ViscoelasticLayer(LayeredHalfspace(0.0, 0.2, 1.0, 0.4), Prony(7.0))
    alone, bonded, base = (
        press(body, revolution.cone(0.5), 0.3).force[-1]
        for body in (layer(INF, 0.4, 1.0, 0.4), layer(0.7, 0.4, 1.0, 0.4), bare)
    )
    assert bonded == pytest.approx(alone, rel=1e-8)
    assert base == pytest.approx(alone, rel=1e-12)


def test_table_of_a_sphere_converges_to_it_with_the_square_of_its_spacing():
    exact = press(layer(1.0, 0.45, INF), revolution.sphere(2.0), 0.2).force[-1]
    errors = []
    for rows in (41, 81):
        r = np.linspace(0.0, 1.5, rows)
        table = revolution.of_table(r, 2 - np.sqrt(4 - r**2))
        errors.append(press(layer(1.0, 0.45, INF), table, 0.2).force[-1] / exact - 1)
    assert abs(errors[1]) < 5e-5
    assert 3.5 < errors[0] / errors[1] < 4.6


def test_heights_and_abel_transforms_belong_together():
    """H(x) = x int_0^{pi/2} h'(x sin t) dt, by the midpoint rule, to its square at the kinks of h'."""
    blunted = revolution.of_pieces([0.0, 0.4], [0.0, 0.2], [0.5, 0.0])
    table = revolution.of_table([0.0, 0.3, 0.7, 1.0, 2.0], [0.0, 0.01, 0.2, 0.5, 2.0])
    angle = np.pi / 2 * (np.arange(4000) + 0.5) / 4000
    for profile in (blunted, table, revolution.sphere(3.0), revolution.cone(0.2)):
        for x in (0.1, 0.5, 1.7):
            r = x * np.sin(angle)
            slope = (revolution.heights(profile, r + 1e-6) - revolution.heights(profile, r - 1e-6)) / 2e-6
            assert revolution.abel_transform(profile, x) == pytest.approx(
                x * np.pi / 2 * slope.mean(), rel=1e-5
            )


def test_jkr_sphere_on_a_halfspace():
    """Depth = a^2/R - (2 pi a w/E*)^(1/2) and F = 4 E* a^3/(3 R) - (8 pi w E* a^3)^(1/2) on either path."""
    R, w, E = 1.0, 1e-3, 2 / (1 - NU)
    history = History(np.array([0.0, 1.0, 3.0]), np.array([-0.01, 0.02, -0.05]))
    run = follow(HALFSPACE, revolution.paraboloid(R), history, adhesion=Edge(w))
    a = run.radius[run.radius > 0]
    np.testing.assert_allclose(
        run.depth[run.radius > 0], a**2 / R - np.sqrt(2 * np.pi * a * w / E), atol=1e-9
    )
    force = 4 / 3 * E * a**3 / R - np.sqrt(8 * np.pi * w * E * a**3)
    np.testing.assert_allclose(run.force[run.radius > 0], force, atol=1e-9)
    # Contact begins with a jump at depth 0, and lasts until the depth of pull-off at a fixed depth.
    pull_off = -0.75 * (np.pi**2 * w**2 * R / E**2) ** (1 / 3)
    touching = run.depth[run.radius > 0]
    steps = np.abs(np.diff(run.depth)).max()
    assert 0 <= touching[0] <= steps
    assert pull_off <= touching[-1] <= pull_off + steps
    assert run.force.min() == pytest.approx(-1.5 * np.pi * w * R, rel=5e-3)


def test_adhesive_contact_under_a_tensile_force():
    R, w, E = 1.0, 1e-3, 2 / (1 - NU)
    history = History(
        np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.02, -0.99 * 1.5 * np.pi * w * R]), by_force=True
    )
    run = follow(HALFSPACE, revolution.paraboloid(R), history, adhesion=Edge(w))
    P = run.force[-1]
    apparent = P + 3 * np.pi * w * R + np.sqrt(6 * np.pi * w * R * P + (3 * np.pi * w * R) ** 2)
    assert run.radius[-1] == pytest.approx((3 * R * apparent / (4 * E)) ** (1 / 3), rel=1e-6)


@pytest.mark.parametrize(
    ("r", "h", "said"),
    [
        ([0, 1, 2], [0, 1, 1.5], "must be convex"),
        ([0, 1, 2], [0, -1, 1], "must be convex"),
        ([0.1, 1, 2], [0, 1, 3], "ascend from 0"),
        ([0, 2, 1], [0, 1, 3], "ascend from 0"),
        ([0, 1], [0, 1], ">= 3"),
    ],
)
def test_tables_that_are_no_convex_profile_are_refused(r, h, said):
    with pytest.raises(ValueError, match=said):
        revolution.of_table(r, h)


def test_a_body_without_a_base_is_refused():
    with pytest.raises(ValueError, match="no base"):
        press(layer(1.0, 0.5, 0.0), revolution.cone(1.0), 0.1)


# --- a layer bonded to another elastic material ---


@pytest.mark.parametrize(
    ("modulus", "radius", "stiffening"),
    [(10, 0.5, 1.7281), (10, 1, 2.7278), (10, 2, 4.4881), (2, 0.5, 1.2450), (2, 1, 1.4163), (2, 2, 1.5311)],
)
def test_a_flat_punch_on_a_layer_is_stiffer_by_the_tabulated_factor(modulus, radius, stiffening):
    # Force over 4 G a depth/(1 - nu), that on a halfspace of the layer's material; thickness 1, nu = 1/2 on
    # nu = 0.3. The table is rounded to 5e-5; 1e-5 is left for the quadrature.
    body = LayerStack((Layer(1.0, 0.5, Elastic(1.0)), Layer(np.inf, 0.3, Elastic(float(modulus)))))
    depth = 0.01
    found = indent(body, FlatPunch(radius=radius), np.array([0.0, 1.0]), depth=np.array([0.0, depth]))
    assert float(found["force"][-1]) / (4 * radius * depth / 0.5) == pytest.approx(stiffening, abs=6e-5)
    # The stiffness of one layer in closed form; here 1e-6 is left.
    bonded = press(layer(1.0, 0.5, float(modulus), 0.3), revolution.flat(radius), depth).force[-1]
    assert bonded / (4 * radius * depth / 0.5) == pytest.approx(stiffening, abs=5.1e-5)
