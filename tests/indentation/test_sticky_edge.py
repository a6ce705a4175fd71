"""JKR's edge on viscoelastic bodies: closed forms, an ODE, the elastic limits, the energy balance."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import gfmdlayer
from gfmdlayer import LayeredHalfspace, Prony
from gfmdlayer.body.layers import ViscoelasticLayer
from gfmdlayer.indentation.equilibrium import BY_DEPTH, EdgeAdhesion, equilibria, find_nodes
from gfmdlayer.indentation.solve import Edge, History, find_space, follow, on_steps, work_done
from gfmdlayer.punch.revolution import abel_transform, cone, paraboloid

WORK, SLOW, FAST, TAU = 0.01, 1.0, 5.0, 1.0
LAW = Prony(SLOW, [(FAST - SLOW, TAU)])
HALFSPACE = ViscoelasticLayer(LayeredHalfspace(math.inf, 0.5, 1.0, 0.5), LAW)
LAYER = ViscoelasticLayer(LayeredHalfspace(0.5, 0.45, math.inf, 0.5), LAW)
D = 0.5  # (1 - nu)/G against slow loads
PRESS_AND_RETRACT = History(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.05, -0.4]))


@pytest.mark.parametrize("indenter", [paraboloid(1.0), cone(0.3)], ids=["sphere", "cone"])
def test_growing_contact_has_the_jump_of_the_displacement_and_relaxes_behind_it(indenter):
    """Depth = H(a) - (pi a w_h D)^(1/2), chi(x) = G(t - t_x) u(t_x) + int G(t - s) du(s), touch at t_x."""
    healing = WORK * (SLOW / FAST) ** 2
    grow = History(np.array([0.0, 1.0]), np.array([0.0, 0.05]))
    edge = Edge(WORK)
    space = find_space(HALFSPACE, indenter, grow, adhesion=edge)
    found = on_steps(HALFSPACE, space, indenter, grow, np.linspace(0.0, 1.0, 101), edge)
    H = np.array([abel_transform(indenter, a) for a in found.radius.tolist()])
    exact = H - np.sqrt(np.pi * found.radius * healing * D)
    np.testing.assert_allclose(found.depth[1:], exact[1:], atol=1e-11)
    a = found.radius[-1]
    x, w = np.polynomial.legendre.leggauss(400)
    x, w = a * (x + 1) / 2, a * w / 2
    own = np.array([abel_transform(indenter, each) for each in x.tolist()])
    touch = np.maximum((own - np.sqrt(np.pi * x * healing * D)) / 0.05, 0.0)
    since = 1.0 - touch
    chi = (SLOW + (FAST - SLOW) * np.exp(-since / TAU)) * (0.05 * touch - own)
    chi += 0.05 * (SLOW * since + (FAST - SLOW) * TAU * (1 - np.exp(-since / TAU)))
    # Second order: the contact sweeps points within a step.
    assert found.force[-1] == pytest.approx(4 * (w * chi).sum() / 0.5, rel=1e-4)


@pytest.mark.parametrize("exponent", [0.5, 1.0])
def test_elastic_edge_recedes_as_the_ordinary_differential_equation(exponent):
    """da/dt = -v ((G/w) - 1)^(1/n), with JKR's energy release rate G(a, depth) of a halfspace."""
    body, R, speed = ViscoelasticLayer(LayeredHalfspace(math.inf, 0.5, 1.0, 0.5), Prony(1.0)), 1.0, 0.02
    found = follow(body, paraboloid(R), PRESS_AND_RETRACT, adhesion=Edge(WORK, speed, exponent))

    def rate(t, a):
        depth = 0.05 - 0.45 * (t - 1.0)
        release = (a[0] ** 2 / R - depth) ** 2 / (math.pi * a[0] * D)
        return [-speed * max(release / WORK - 1, 0.0) ** (1 / exponent)]

    begin = float(found.radius[found.time == 1.0][0])
    times = np.linspace(1.0, 1.2, 21)
    exact = solve_ivp(rate, (1.0, 1.2), [begin], t_eval=times, rtol=1e-9, atol=1e-12).y[0]
    assert exact[-1] < 0.99 * begin
    within = 2e-4 * begin  # the tolerance, and linear interpolation between the steps
    np.testing.assert_allclose(np.interp(times, found.time, found.radius), exact, atol=within)


@pytest.mark.parametrize("duration", [1e-9, 1e9])
def test_sudden_and_slow_retractions_are_those_of_the_elastic_limits(duration):
    """Sudden: JKR of the glassy body with the work J0/D; slow: JKR of the relaxed body."""
    times = np.array([0.0, 0.1, 1.0, 1.0 + duration])
    history = History(times, np.array([0.05, 0.05, 0.05, -0.1]))
    indenter, edge = paraboloid(1.0), Edge(WORK)
    sudden = duration < 1
    if sudden:  # nothing has relaxed
        history = History(np.array([0.0, duration]), history.value[[0, 3]])
    law = Prony(FAST if sudden else SLOW)
    body = ViscoelasticLayer(LAYER.layer, law)
    nodes = find_nodes(body, 0.5)
    contacts = equilibria(*nodes.compliance(body), nodes, indenter)
    work = WORK * (SLOW / FAST if sudden else 1.0)
    stable = contacts.branch(BY_DEPTH, EdgeAdhesion(work))
    steps = np.linspace(history.time[-2], history.time[-1], 60)
    space = find_space(LAYER, indenter, history, adhesion=edge)
    found = on_steps(LAYER, space, indenter, history, np.unique(np.concatenate((history.time, steps))), edge)
    # Where a slow edge recedes; sudden contacts never rest.
    rows = (found.radius > 0) & (found.depth < (0.05 if sudden else 0.0)) & (found.radius < found.radius[0])
    _, force, radius = stable(found.depth[rows])
    assert rows.sum() > 5
    np.testing.assert_allclose(found.radius[rows], radius, rtol=1e-5)
    np.testing.assert_allclose(found.force[rows], force, atol=1e-5 * np.abs(found.force).max())


def test_work_of_the_punch_is_stored_dissipated_and_taken_by_the_edge():
    """Between the jumps; of second order in the step, of first order where the past jumps at an edge."""
    edge, indenter, residuals = Edge(WORK, 0.3, 0.6, WORK / 100), paraboloid(1.0), []
    space = find_space(LAYER, indenter, PRESS_AND_RETRACT, adhesion=edge)
    for steps in (100, 400):
        time = np.linspace(0.0, 1.1, 11 * steps // 10 + 1)
        run = on_steps(LAYER, space, indenter, PRESS_AND_RETRACT, time, edge)
        work = work_done(run.force, run.depth, 0.0)
        lost = work - run.stored - run.dissipated - run.parted
        assert run.radius[-1] > 0
        assert run.parted[-1] > 0.1 * work[-1]
        residuals.append(np.ptp(lost[2:]) / work.max())
    assert residuals[0] < 1e-2
    assert residuals[1] < 0.35 * residuals[0]


def test_indent_reports_the_pull_off_and_the_work_of_the_edge():
    given = {"depth": [0, 0.05, -0.4], "work": WORK, "edge_speed": 0.3}
    slow, fast = (
        gfmdlayer.indent(HALFSPACE, gfmdlayer.Parabola(radius=1.0), [0.0, 1.0, 1.0 + each], **given)
        for each in (10.0, 1.0)
    )
    assert fast.attrs["pull_off_force"] > 1.1 * slow.attrs["pull_off_force"] > 0
    assert fast.edge_work.attrs == {"long_name": "energy taken by the edge of the contact", "units": "energy"}
    assert float(fast.edge_work[-1]) > 0
    assert float(fast.contact_radius[-1]) == 0


def test_a_resting_edge_pulls_although_nothing_has_healed():
    """Depth control: the balance of energy closes, so the force, which is negative, is not cut off."""
    given = {"work": 0.3, "edge_speed": 0.05, "healing_work": 0.0}
    found = gfmdlayer.indent(
        HALFSPACE, gfmdlayer.Parabola(radius=1.0), [0.0, 1.0, 2.0], depth=[0.0, 0.05, 0.02], **given
    )
    assert float(found.contact_radius[-1]) == pytest.approx(float(found.contact_radius.max()), rel=1e-3)
    assert float(found.force[-1]) < -0.1 * float(found.force.max())
    # The rule of the work is of second order in some 100 steps.
    assert float(np.abs(found.energy_residual).max()) < 1e-2 * float(found.work.max())


@pytest.mark.parametrize("body", [gfmdlayer.halfspace(1.0), HALFSPACE], ids=["elastic", "relaxing"])
def test_a_force_that_tears_the_indenter_off_loses_energy_and_gains_none(body):
    """The depth after the loss is that of the surface: the way to it is no work."""
    given = {"force": [0.0, 0.1, -0.2], "work": WORK}
    found = gfmdlayer.indent(body, gfmdlayer.Parabola(radius=1.0), [0.0, 1.0, 2.0], **given)
    residual, radius = found.energy_residual.values, found.contact_radius.values
    loss = int(np.flatnonzero((radius[:-1] > 0) & (radius[1:] == 0))[0])
    released = found.stored.values[loss] - found.stored.values[loss + 1]
    taken = found.edge_work.values[loss + 1] - found.edge_work.values[loss]
    dissipated = found.dissipated.values[loss + 1] - found.dissipated.values[loss]
    assert residual[loss + 1] - residual[loss] == pytest.approx(released - taken - dissipated, rel=1e-9)
    assert found.work.values[loss + 1] == found.work.values[loss]


def test_an_elastic_flat_punch_pulls_off_at_kendalls_force_within_the_tolerance():
    """F = (8 pi a^3 w E*)^(1/2), E* = 4: the force ends there on a straight line over the depth."""
    body, punch = gfmdlayer.halfspace(1.0), ([0.0, 0.25, 0.5], [0.0, 0.0, 0.0])
    found = gfmdlayer.indent(body, punch, [0.0, 1.0, 2.0], depth=[0.0, 0.05, -0.4], work=WORK)
    kendall = math.sqrt(8 * math.pi * 0.5**3 * WORK * 4.0)
    shift = 1e-4 * 2.0 * 0.45  # of the depth: tolerance, duration, speed; the stiffness is 2 a E* = 4
    assert 0 <= kendall - found.attrs["pull_off_force"] < 4.0 * shift


def test_an_elastic_sphere_pulls_off_at_the_force_of_jkr_within_the_tolerance():
    """(3/2) pi w R, where the force has its minimum over the depth."""
    body, ball = gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=1.0)
    given = {"depth": [0.0, 0.1, -0.4], "work": WORK, "healing_work": WORK / 10}
    found = gfmdlayer.indent(body, ball, [0.0, 1.0, 2.0], **given)
    within = 1e-4 * float(np.abs(found.force).max())
    assert found.attrs["pull_off_force"] == pytest.approx(1.5 * math.pi * WORK, abs=within)


def test_a_jump_that_no_step_resolves_is_named_with_a_tolerance_that_is_reached():
    """Times around 1e10 are 2e-6 apart in double precision, further than 1e-7 of the duration."""
    body, ball, time = gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=1.0), [1e10, 1e10 + 1, 1e10 + 3]
    given = {"depth": [0.0, 0.05, -0.2], "work": WORK}
    with pytest.raises(ArithmeticError, match="Contact jumps at t = 1e") as said:
        gfmdlayer.indent(body, ball, time, tolerance=1e-7, **given)
    tried = float(str(said.value).rpartition(" ")[2])
    assert gfmdlayer.indent(body, ball, time, tolerance=tried, **given).attrs["error"] <= tried


def test_the_contact_of_a_flat_punch_is_never_wider_than_its_end():
    """The extrapolation to steps of no length was 2 % wider at this tolerance."""
    body, punch = gfmdlayer.halfspace(Prony(1.0, [(9.0, 1.0)])), ([0.0, 0.15, 0.3], [0.0, 0.0, 0.0])
    given = {"work": 1e-3, "edge_speed": 0.5, "tolerance": 1e-2}
    found = gfmdlayer.indent(
        body, punch, [0.0, 1.0, 1.5, 2.5, 3.5], depth=[0, 0.05, 0.05, -0.3, 0.04], **given
    )
    assert float(found.contact_radius.max()) <= 0.3


def test_whole_numbers_are_the_same_edge():
    """Another type of a number would compile the kernels again, which takes half a minute."""
    body = find_space(LAYER, paraboloid(1.0), PRESS_AND_RETRACT).compliance(LAYER)
    assert all(type(each) is float for each in Edge(1, 1, 1, 0).law(body))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"work": -1.0}, "work: got -1.0; must be finite and >= 0"),
        ({"work": 1.0, "edge_speed": 0.0}, "edge_speed: got 0.0; must be > 0"),
        (
            {"work": 1.0, "edge_exponent": math.inf},
            "edge_exponent: got inf; must be finite and > 0",
        ),
        ({"tolerance": 0.0}, "tolerance: got 0.0; must be finite and >= 1e-09"),
        ({"work": 1.0, "healing_work": 0.05}, "healing_work: got 0.05; must be <= 0.04"),
    ],
)
def test_impossible_edges_are_refused(given, said):
    with pytest.raises(ValueError, match=said):
        gfmdlayer.indent(
            HALFSPACE, {"shape": "parabola", "radius": 1.0}, [0.0, 1.0], depth=[0.0, 0.1], **given
        )
