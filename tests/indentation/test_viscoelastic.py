"""Viscoelastic contacts: Ting's solution, the hereditary integral, orders, energy, contact lost and found."""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.optimize import brentq

import gfmdlayer
from gfmdlayer import LayeredHalfspace, Prony, Zener, bonded_layer
from gfmdlayer.body.layers import ViscoelasticLayer
from gfmdlayer.indentation.indent import IsolatedIndentation
from gfmdlayer.indentation.model import IsolatedContact
from gfmdlayer.indentation.solve import (
    History,
    find_space,
    follow,
    make_space,
    on_halved_steps,
    on_steps,
    work_done,
    work_of,
)
from gfmdlayer.punch import revolution
from gfmdlayer.punch.revolution import sphere

ZENER = Zener(1.0, 10.0, 1.0)
# G(t) ~ t^-0.3 from 1e-3 to 1e3, one branch a decade.
POWER_LAW = Prony(0.01, [(0.5 * 10 ** (-0.3 * k), 10.0 ** (k - 3)) for k in range(7)])
NU = 0.3


def layer(material, thickness, poisson, base):
    """Return a layer on a base of Poisson's ratio 0.3."""
    return ViscoelasticLayer(LayeredHalfspace(thickness, poisson, base, 0.3), material)


BODIES = {
    "halfspace": layer(ZENER, math.inf, NU, 1.0),
    "rigid base": layer(ZENER, 1.0, 0.5, math.inf),
    "soft base": layer(ZENER, 1.0, 0.45, 0.3),
}
LOST_AND_FOUND = History(np.array([0, 1, 1.2, 2.2, 3.2]), np.array([0, 0.1, -0.02, 0.15, 0.0]))
RAMP_HOLD_RETRACT = History(np.array([0.0, 1.0, 4.0, 5.0]), np.array([0.0, 0.2, 0.2, -0.02]))


def ting(material, coefficient, power, t):
    """Force of a triangle of depth to t = 1 and back to t = 2, by Ting (J. Appl. Mech. 33 (1966) 845).

    F = C int_0^{t1} G(t - s) d(depth^p), where the contact is as large at t1 as at t:
    int_{t1}^t G(t - s) d(depth) = 0. G is summed at Gauss nodes in panels that shrink towards t1.
    """
    G, tau = material.branch_moduli, material.branch_times

    def integral(u):
        return material.relaxed * u - float(G @ (tau * np.expm1(-u / tau)))

    x, w = np.polynomial.legendre.leggauss(12)
    ends = 1 - np.append(np.geomspace(1.0, 1e-7, 36), 0.0)
    half = np.diff(ends)[:, np.newaxis] / 2
    nodes, weights = (half * (x + 1) + ends[:-1, np.newaxis]).ravel(), (half * w).ravel()
    forces = []
    for time in t.tolist():
        t1 = time
        if time > 1:
            returned = 2 * integral(time - 1)
            if integral(time) <= returned:
                forces.append(0.0)
                continue
            t1 = brentq(lambda s, time=time, back=returned: integral(time - s) - back, 0, 1, xtol=1e-14)
        s = t1 * nodes
        modulus = material.relaxed + (G * np.exp(-(time - s)[:, np.newaxis] / tau)).sum(axis=1)
        forces.append(coefficient * power * t1 * float(weights @ (modulus * s ** (power - 1))))
    return np.array(forces)


@pytest.mark.parametrize("material", [ZENER, POWER_LAW], ids=["Zener", "power law"])
@pytest.mark.parametrize("shape", ["paraboloid", "cone"])
def test_loading_and_unloading_of_a_halfspace_is_ting_s(shape, material):
    indenter = revolution.paraboloid(2.0) if shape == "paraboloid" else revolution.cone(0.3)
    elastic = 8 / 3 * 2**0.5 * 0.1**1.5 if shape == "paraboloid" else 4 / (math.pi * 0.3) * 0.1**2
    history = History(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.1, 0.0]))
    run = follow(layer(material, math.inf, NU, 1.0), indenter, history)
    expected = ting(material, elastic / (1 - NU), 1.5 if shape == "paraboloid" else 2.0, run.time[1:])
    assert run.error <= 1e-4
    np.testing.assert_allclose(run.force[1:], expected, rtol=0, atol=1e-4 * expected.max())


def test_depth_creeps_under_a_sudden_force():
    """On a halfspace a^3 = (3 (1 - nu) R/8) F J(t) while the contact grows."""
    force = 1.0
    run = follow(
        BODIES["halfspace"],
        revolution.paraboloid(2.0),
        History(np.array([0.0, 20.0]), np.full(2, force), True),
    )
    J = 1 / ZENER.G0 - (1 / ZENER.G0 - 1 / ZENER.Ginf) * np.exp(-run.time * ZENER.G0 / ZENER.Ginf)
    a = (3 * (1 - NU) * 2.0 / 8 * force * J) ** (1 / 3)
    np.testing.assert_allclose(run.radius, a, rtol=0, atol=1e-4 * a.max())
    np.testing.assert_allclose(run.depth, a**2 / 2, rtol=2e-4)


@pytest.mark.parametrize("name", BODIES)
def test_order_in_time_is_two_and_more_after_extrapolation(name):
    body, indenter = BODIES[name], revolution.sphere(5.0)
    history = History(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.2, 0.195]))
    space = find_space(body, indenter, history, 1e-6)
    forces = {
        n: on_steps(body, space, indenter, history, np.linspace(0, 2, n + 1)).force[-1]
        for n in (16, 32, 64, 128)
    }
    exact = on_halved_steps(body, space, indenter, history, np.linspace(0, 2, 513)).force[-1]
    errors = [abs(force / exact - 1) for force in forces.values()]
    # On a halfspace the hereditary integral of a depth that is linear over the steps is exact.
    if name == "halfspace":
        assert max(errors) < 1e-11
        return
    # Halving the steps divides the error by 4, less what the higher orders bring at the coarsest.
    assert all(coarse / fine > 3.3 for coarse, fine in pairwise(errors))
    halved = on_halved_steps(body, space, indenter, history, np.linspace(0, 2, 65)).force[-1]
    assert abs(halved / exact - 1) < errors[-1] / 4


@pytest.mark.parametrize("name", BODIES)
def test_energy_balance_closes(name):
    columns = IsolatedIndentation(BODIES[name], revolution.sphere(5.0), RAMP_HOLD_RETRACT).columns()
    assert columns["dissipated"][-1] > 0.5 * columns["work"][-1] > 0
    assert (np.diff(columns["dissipated"]) > -1e-6 * columns["work"].max()).all()
    # Work, stored and dissipated energy each have the error of the force.
    assert np.abs(columns["energy_residual"]).max() < 1e-4 * columns["work"].max()


@pytest.mark.parametrize(
    "name", ["halfspace", pytest.param("rigid base", marks=pytest.mark.slow), "soft base"]
)
def test_contact_is_lost_and_found_again_to_the_tolerance(name):
    run = follow(BODIES[name], revolution.sphere(2.0), LOST_AND_FOUND)
    apart = run.radius == 0
    assert np.count_nonzero(np.diff(apart.astype(int))) == 4  # begins, is lost, is found again, is lost
    assert (run.radius >= 0).all()
    assert (run.force[apart] == 0).all()
    assert (run.force >= 0).all()
    finer = follow(
        BODIES[name], revolution.sphere(2.0), LOST_AND_FOUND, tolerance=3e-6, stops=run.time.tolist()
    )
    at = np.isin(finer.time, run.time)
    np.testing.assert_allclose(run.force, finer.force[at], rtol=0, atol=1e-4 * run.force.max())


@pytest.mark.parametrize("name", BODIES)
def test_many_times_to_land_on_do_not_multiply_the_steps(name):
    """Between two of them the run takes a single step, in quarters, if the tolerance needs no more."""
    stops = np.linspace(0.0, float(RAMP_HOLD_RETRACT.time[-1]), 401)
    run = follow(BODIES[name], revolution.sphere(5.0), RAMP_HOLD_RETRACT, stops=stops.tolist())
    assert np.isin(stops, run.time).all()
    assert run.time.size < 1.2 * 4 * stops.size
    assert run.error < 1e-4


def test_flat_punch_leaves_a_halfspace_at_once_at_the_time_when_its_force_vanishes():
    """F = (4 a/(1 - nu)) int G(t - s) d(depth) as long as it is positive."""
    history = History(np.array([0.0, 0.13, 1.13, 2.0]), np.array([-0.013, 0.0, 0.1, -0.05]))
    run = follow(BODIES["halfspace"], revolution.flat(0.5), history)

    def integral(u):
        u = np.maximum(u, 0.0)
        return u - 9 * np.expm1(-u)

    rates = 0.1, 0.1 + 0.15 / 0.87
    force = 2 / 0.7 * (rates[0] * integral(run.time - 0.13) - rates[1] * integral(run.time - 1.13))
    touching = run.radius > 0
    assert ((run.radius == 0) | (run.radius > 0.499999)).all()
    np.testing.assert_allclose(run.force[touching], force[touching], atol=1e-4 * force.max())
    after = (run.time > 1.13) & ~touching
    assert force[after].max() < 1e-4 * force.max()


@pytest.mark.parametrize("name", BODIES)
def test_prescribing_the_force_that_was_found_gives_the_depth_back(name):
    indenter = revolution.cone(0.4)
    history = History(np.array([0.0, 1.0, 3.0]), np.array([0.0, 0.15, 0.15]))
    forward = follow(BODIES[name], indenter, history, tolerance=1e-5)
    back = follow(BODIES[name], indenter, History(forward.time, forward.force, by_force=True), tolerance=1e-5)
    # Force over time is linear between rows here, as it was not before: an error of its own, 1e-4 and less.
    found = np.interp(forward.time, back.time, back.depth)
    np.testing.assert_allclose(found, forward.depth, rtol=0, atol=2e-4 * 0.15)


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("kind", ["sphere", "cone", "blunted", "flat"])
def test_pressure_and_gap_are_not_negative(name, kind):
    """Within 1e-6 of the largest pressure and of the depth, at all stages of a history."""
    indenter = made(kind)
    times = (0.5, 1.0, 1.1, 1.7, 2.4, 3.0)
    run = IsolatedIndentation(BODIES[name], indenter, LOST_AND_FOUND, snapshots=times, points=101)
    kept = run.profiles()
    assert kept.pressure.min() >= -1e-6 * kept.pressure.max()
    assert kept.gap.min() >= -1e-6 * 0.15
    assert not run.warnings
    # The surface is under the indenter, and the pressure zero outside of the contact.
    h = revolution.heights(indenter, kept.r)
    at = np.searchsorted(run.solved.time, kept.time)
    for k, i in enumerate(at.tolist()):
        outside = kept.r > 1.01 * run.solved.radius[i]
        assert (kept.pressure[k, outside] == 0).all()
        seen = np.isfinite(h)
        np.testing.assert_allclose(
            (kept.displacement[k] + kept.gap[k])[seen], h[seen] - run.solved.fields.depth[i], atol=1e-12
        )


@cache
def made(kind):
    """Return an indenter."""
    if kind == "sphere":
        return revolution.sphere(2.0)
    if kind == "flat":
        return revolution.flat(0.4)
    if kind == "cone":
        return revolution.cone(0.4)
    return revolution.of_pieces([0.0, 0.2], [0.0, 0.4], [2.0, 0.0])


def test_pressure_integrates_to_the_force():
    """By the trapezoidal rule, to (dr/a)^(3/2) where the pressure falls like a root."""
    run = IsolatedIndentation(
        BODIES["soft base"], revolution.sphere(5.0), RAMP_HOLD_RETRACT, snapshots=(1.0,), points=4001,
        extent=1.0,
    )  # fmt: skip
    kept = run.profiles()
    force = trapezoid(2 * np.pi * kept.r * kept.pressure[0], kept.r)
    assert force == pytest.approx(run.solved.force[run.solved.time == 1.0][0], rel=1e-3)


def test_work_is_exact_for_a_parabola():
    depth = np.array([0.0, 0.1, 0.25, 0.6, 1.0])
    np.testing.assert_allclose(work_done(depth**2, depth, 0.5), 0.5 + depth**3 / 3, atol=1e-15)


def test_nodes_may_be_reused_for_other_moduli():
    sphere, soft = revolution.sphere(5.0), BODIES["soft base"]
    space = make_space(find_space(soft, sphere, RAMP_HOLD_RETRACT).features, 1.0)
    other = layer(Zener(1.3, 7.0, 0.6), 1.0, 0.45, 0.3)
    own = follow(other, sphere, RAMP_HOLD_RETRACT)
    reused = follow(other, sphere, RAMP_HOLD_RETRACT, space=space, stops=own.time.tolist())
    at = np.isin(reused.time, own.time)
    np.testing.assert_allclose(reused.force[at], own.force, atol=1e-4 * own.force.max())


def _creeping(tolerance, stops=None):
    """A steel ball on 1 mm of rubber bonded to steel: 2 N within 0.1 s, held for 10 s."""
    body = gfmdlayer.bonded_layer(1e-3, Zener(1e6, 10e6, 0.1))
    held = History(np.array([0.0, 0.1, 10.1]), np.array([0.0, 2.0, 2.0]), True)
    return follow(body, revolution.sphere(5e-3), held, tolerance=tolerance, stops=stops or ())


def test_depth_and_radius_creep_under_a_held_force_to_the_tolerance_in_few_steps():
    """The edge moves less in a step than the grid in x is fine: the radius must not see the grid."""
    run = _creeping(1e-4)
    finer = _creeping(1e-4 / 30, run.time.tolist())
    at = np.isin(finer.time, run.time)
    # 100 steps are enough for the columns below, and leave 6e-4 of the work open: 24 more close the balance,
    # and another 24 are for straight lines between the rows.
    assert run.time.size - 1 <= 150
    missed = work_of(run) - run.stored - run.dissipated
    assert np.abs(missed).max() <= 3e-4 * work_of(run).max()
    assert finer.error <= 1e-4 / 30
    for name in ("force", "depth", "radius"):
        found, exact = getattr(run, name), getattr(finer, name)
        np.testing.assert_allclose(found, exact[at], rtol=0, atol=1e-4 * exact.max(), err_msg=name)
    # No kink: after the ramp the radius grows ever slower, between steps that are not halves of each other.
    growth = np.diff(run.radius[run.time >= 0.1][::4]) / np.diff(run.time[run.time >= 0.1][::4])
    assert (growth > 0).all()
    assert (np.diff(growth[: growth.size // 2]) < 0).all()


def test_steps_of_any_length_have_ting_s_force_without_extrapolation():
    """In the contact of a halfspace the displacement is linear over a step: the relaxing form is exact."""
    body, t = layer(ZENER, math.inf, NU, 1.0), np.array([0, 3e-4, 0.2, 0.6, 1, 1.0002, 1.1, 1.35, 1.5])
    history = History(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.1, 0.0]))
    indenter = revolution.cone(0.3)
    run = on_steps(body, find_space(body, indenter, history), indenter, history, t)
    expected = ting(ZENER, 4 / (math.pi * 0.3) * 0.1**2 / (1 - NU), 2.0, t[1:])
    np.testing.assert_allclose(run.force[1:], expected, rtol=0, atol=1e-9 * expected.max())


@pytest.mark.parametrize("name", ["held twice", "half taken back"])
def test_a_force_that_is_held_or_taken_back_gives_depth_and_radius_to_the_tolerance(name):
    """Against a thirtieth of the tolerance. The edge turns, rests, and passes radii again."""
    body, indenter, time, force = {
        "held twice": (
            layer(Zener(1.0, 18.0, 0.3), 1.0, 0.3, 0.5), revolution.sphere(3.0),
            [1, 3, 3.3, 5], [1, 1, 3, 3],
        ),
        "half taken back": (
            layer(Prony(1.0, [(1.2, 0.03), (1.2, 2.0)]), 1.0, 0.5, 0.11), revolution.paraboloid(5.0),
            [0.1, 0.9, 1.0, 2.5, 3.3], [1, 0.4, 0.8, 0.3, 0.6],
        ),
    }[name]  # fmt: skip
    history = History(np.array([0.0, *time]), 0.1 * np.array([0.0, *force]), True)
    run = follow(body, indenter, history)
    finer = follow(body, indenter, history, tolerance=1e-4 / 30, stops=run.time.tolist())
    assert run.error <= 1e-4
    assert finer.error <= 1e-4 / 30
    at = np.isin(finer.time, run.time)
    for column in ("depth", "radius"):
        found, exact = getattr(run, column), getattr(finer, column)
        np.testing.assert_allclose(found, exact[at], rtol=0, atol=1e-4 * exact.max(), err_msg=column)


def test_depth_creeps_evenly_while_the_contact_passes_the_end_of_a_blunted_cone():
    """The nodes change where the edge leaves behind the radius of the last turn. The depth must not jump.

    The rate of creep changes by a part h/tau = 1e-2 in a step; a jump J changes it by J/h.
    """
    body, indenter = layer(Zener(1.0, 2.0, 1.0), 1.0, 0.45, math.inf), made("blunted")
    history = History(np.array([0.0, 0.4, 1.4]), np.array([0.0, 0.25, 0.25]), True)
    time = np.concatenate((np.linspace(0, 0.4, 41), np.linspace(0.4, 1.4, 101)[1:]))
    run = on_steps(body, find_space(body, indenter, history), indenter, history, time)
    rate = np.diff(run.depth[42:]) / np.diff(time[42:])
    assert 0.2 < run.radius[42] < 0.98 * run.radius[-1]
    assert np.abs(np.diff(rate)).max() < 0.02 * rate.max()


# --- histories whose control changes between depth and force ---


def test_force_in_place_of_depth_in_the_middle_of_a_history_gives_the_same_contact():
    # The forces of a run under depth are prescribed between 0.5 and 2.5. Both are extrapolated in the step,
    # to some 1e-5 of the largest values with these 60 steps.
    body, profile = bonded_layer(thickness=2.0, material=Zener(1.5, 6.0, 0.8), halfspace=np.inf), sphere(5.0)
    history = History(np.array([0.0, 1.0, 5.0]), np.array([0.0, 0.4, 0.2]))
    times = np.unique(np.concatenate((np.linspace(0, 1, 20), np.linspace(1, 5, 40))))
    space = find_space(body, profile, history)
    found = on_halved_steps(body, space, profile, history, times)
    by_force = (found.time > 0.5) & (found.time < 2.5)
    mixed = History(found.time, np.where(by_force, found.force, found.depth), by_force)
    again = on_halved_steps(body, space, profile, mixed, times)
    assert np.abs(again.depth - found.depth).max() < 1e-4 * found.depth.max()
    assert np.abs(again.force - found.force).max() < 1e-4 * found.force.max()


@pytest.mark.parametrize("control", ["depth", "force"])
def test_steps_land_once_on_times_that_rounding_made_different(control):
    # 3 * 0.1 is not 0.3, and 3 * 0.1 beyond the end of a run is its end.
    history = History(np.array([0.0, 0.1, 0.3]), np.array([0.0, 0.05, 0.02]), control == "force")
    stops = [0.1 * i for i in (1, 2, 3)] + [0.2, np.nextafter(0.1, 1)]
    snapshots = [0.2, np.nextafter(0.2, 1), np.nextafter(0.3, 0)]
    run = IsolatedIndentation(
        BODIES["soft base"], sphere(1.0), history, 1e-2, snapshots=snapshots, stops=stops, points=11
    )
    time, kept = run.solved.time, run.profiles()
    assert (np.diff(time) > 0).all()
    assert np.isin([0.1, 0.2, 0.3], time).all()
    assert time[-1] == 0.3
    assert kept.time.tolist() == [0.2, 0.3]
    assert np.isfinite(kept.pressure).all()


@pytest.mark.parametrize("before", [1e-4, 1e-8, 1e-12])
def test_a_time_to_land_on_close_to_the_end_does_not_change_the_depth(before):
    # The contact shrinks to a point as the load vanishes, while the body recovers.
    history = History(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.1, 0.0]), True)
    body, tolerance = bonded_layer(1.0, Zener(1.0, 10.0, 0.3)), 1e-3
    alone, landing = (
        follow(body, sphere(1.0), history, tolerance=tolerance, stops=stops) for stops in ([], [2 - before])
    )
    depth = np.interp(landing.time, alone.time, alone.depth)
    # Each run is within the tolerance.
    assert np.abs(landing.depth - depth).max() < 2 * tolerance * alone.depth.max()


def test_the_energy_that_a_wide_contact_leaves_in_a_thin_layer_does_not_jump_when_it_is_lost():
    """All of the contact is transformed at once then, over 250 radians: 50 nodes missed 5 % of the work."""
    layers = [
        {"thickness": 0.1, "poisson": 0.45, "material": {"G0": 1.0, "Ginf": 5.0, "tau": 1.0}},
        {"thickness": 0.4, "poisson": 0.4, "material": {"model": "elastic", "G": 0.3}},
    ]
    config = gfmdlayer.Config(
        name="wide", grid={"geometry": "axisymmetric"}, layers=layers,
        halfspace={"shear_modulus": 10.0, "poisson": 0.3}, punch={"radius": 1.0},
    )  # fmt: skip
    body = IsolatedContact(config).body
    for history in (
        History(np.array([0.0, 0.5, 1.0, 1.5]), np.array([0.0, 28.5, 28.5, 0.0]), True),
        History(np.array([0.0, 0.5, 1.0, 1.5]), np.array([0.0, 1.7, 1.7, -0.3])),
    ):
        run = follow(body, revolution.paraboloid(1.0), history, tolerance=1e-3)
        first = int(np.flatnonzero(run.radius > 0)[-1]) + 1
        assert run.radius.max() > 15 * 0.1
        assert 0 < run.stored[first] < run.stored[first - 1]
        missed = work_of(run) - run.stored - run.dissipated
        assert np.abs(missed).max() < 3e-3 * run.stored.max()
