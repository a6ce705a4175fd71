"""Equilibria of elastic contacts: closed forms, the equation over time, and energy."""

import math

import numpy as np
import pytest

from gfmdlayer import LayeredHalfspace, Prony
from gfmdlayer.body.layers import ViscoelasticLayer
from gfmdlayer.indentation.equilibrium import (
    BY_DEPTH,
    BY_FORCE,
    EdgeAdhesion,
    by_base,
    equilibria,
    find_nodes,
    halfspace,
)
from gfmdlayer.indentation.solve import Edge, History, find_space, on_steps
from gfmdlayer.punch import revolution

R, WORK, NU = 2.0, 1e-3, 0.3
E = 2 / (1 - NU)


def layer(thickness, poisson, base):
    return ViscoelasticLayer(LayeredHalfspace(thickness, poisson, base, 0.5), Prony(1.0))


def contacts(body, punch, reach):
    nodes = find_nodes(body, reach)
    return equilibria(*nodes.compliance(body), nodes, punch)


def test_pull_off_of_a_paraboloid_from_a_halfspace_has_its_closed_forms():
    # Johnson, Kendall & Roberts, Proc. R. Soc. A 324 (1971) 301: -3/2 pi w R, whatever the modulus; at a
    # prescribed depth -5/6 pi w R and -(3/4) (pi^2 w^2 R/E^2)^(1/3). A minimum is found to rounding.
    made = halfspace((1 - NU) / 1.0, revolution.paraboloid(R), 0.5)
    by_force, by_depth = (made.branch(each, EdgeAdhesion(WORK)) for each in (BY_FORCE, BY_DEPTH))
    assert by_force.end == pytest.approx(-1.5 * math.pi * WORK * R, rel=1e-12)
    assert by_depth.end == pytest.approx(-0.75 * (math.pi**2 * WORK**2 * R / E**2) ** (1 / 3), rel=1e-12)
    # The force has a vertical tangent there: an error e of the radius of pull-off gives a part of e.
    assert by_depth(np.array([by_depth.end]))[1] == pytest.approx(-5 / 6 * math.pi * WORK * R, rel=1e-6)


def test_pull_off_of_a_flat_punch_from_a_halfspace_is_kendall_s():
    made = halfspace((1 - NU) / 1.0, revolution.flat(0.3), 1.0)  # J. Phys. D 4 (1971) 1186
    for control in (BY_FORCE, BY_DEPTH, by_base(0.7)):
        branch = made.branch(control, EdgeAdhesion(WORK))
        depth, force, a = branch(np.array([branch.end, 0.1]))
        assert force[0] == pytest.approx(-math.sqrt(8 * math.pi * E * WORK * 0.3**3), rel=1e-12)
        assert force == pytest.approx(2 * E * 0.3 * depth, rel=1e-12)
        assert (a == 0.3).all()


@pytest.mark.parametrize(("base", "poisson"), [(math.inf, 0.5), (0.1, 0.3)])
@pytest.mark.parametrize("punch", [revolution.sphere(5.0), revolution.cone(0.2), revolution.flat(1.0)])
def test_contacts_are_those_of_the_equation_over_time(punch, base, poisson):
    body = layer(1.0, poisson, base)
    made = contacts(body, punch, 2.5)
    end = made.branch(BY_DEPTH, EdgeAdhesion(WORK)).end
    depths = np.concatenate((np.linspace(0.05, 0.1, 3), np.linspace(0.1, 0.99 * end, 9)[1:]))
    for work in (0.0, WORK):
        course = depths if work else np.linspace(0.0, 0.1, 9)
        history = History(np.arange(course.size, dtype=float), course)
        space = find_space(body, punch, history, 1e-8, Edge(work))
        found = on_steps(body, space, punch, history, history.time, Edge(work))
        _, force, radius = made.branch(BY_DEPTH, EdgeAdhesion(work))(course)
        # below 1e-6: the polynomials
        assert force[1:] == pytest.approx(found.force[1:], abs=1e-6 * found.force.max())
        assert radius[1:] == pytest.approx(found.radius[1:], rel=1e-5)


def test_force_and_depth_belong_together_under_a_profile_with_a_kink():
    # Without adhesion dF = k d(depth) along the contacts; k' = 4 pi a/lift^2 is Griffith's balance.
    blunted = revolution.of_pieces([0.0, 0.3], [0.0, 0.2], [0.5, 0.0])
    made = contacts(layer(1.0, 0.3, 0.1), blunted, 1.5)
    a, h = np.array([0.1, 0.29, 0.31, 0.6, 1.2]), 1e-5
    at, low, high = (made.at(each) for each in (a, a - h, a + h))
    # h^2 of the differences, and the polynomials
    assert (high.force - low.force) / (high.depth - low.depth) == pytest.approx(at.stiffness, rel=1e-6)
    assert at.stiffness_slope == pytest.approx(4 * math.pi * a / at.lift**2, rel=1e-5)


def test_a_cantilever_holds_the_contact_between_prescribed_depth_and_force():
    made = contacts(layer(1.0, 0.45, math.inf), revolution.paraboloid(5.0), 1.5)
    ends = {}
    for k in (1e-6, 5.0, 1e9):
        branch = made.branch(by_base(k), EdgeAdhesion(WORK))
        base = np.linspace(branch.end, 0.05, 40)
        depth, force, radius = branch(base)
        assert depth + force / k == pytest.approx(base, abs=1e-12 + 1e-9 / k)
        assert (np.diff(radius) > 0).all()
        ends[k] = force[0]
    by_force, by_depth = (made.branch(each, EdgeAdhesion(WORK)) for each in (BY_FORCE, BY_DEPTH))
    assert ends[1e-6] == pytest.approx(by_force.end, rel=1e-5)
    assert ends[1e9] == pytest.approx(float(by_depth(np.array([by_depth.end]))[1][0]), rel=1e-5)
    assert ends[1e-6] < ends[5.0] < ends[1e9] < 0


def test_dmt_s_attraction_only_shifts_the_force():
    made = contacts(layer(1.0, 0.5, math.inf), revolution.paraboloid(5.0), 1.5)
    bare, pulled = (made.branch(BY_DEPTH, each) for each in (EdgeAdhesion(), EdgeAdhesion(force=0.02)))
    depths = np.linspace(0.0, 0.1, 7)
    assert pulled(depths)[1] == pytest.approx(bare(depths)[1] - 0.02, abs=1e-12)
    assert pulled.end == pytest.approx(0.0, abs=1e-12)
