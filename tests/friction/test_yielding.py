"""Surfaces that yield and rub: pressures end at a hardness beside friction, and an imprint stays."""

from dataclasses import replace

import numpy as np
import pytest

from gfmdlayer import (
    Case,
    Config,
    ConfigError,
    Parabola,
    SelfAffine,
    halfspace,
    solve,
)
from gfmdlayer.friction.problem import in_disks
from gfmdlayer.friction.solver import FrictionSolver
from gfmdlayer.grid.transforms import Transforms
from tests.friction.cases import random_problem
from tests.friction.reference import compliance
from tests.recordings import Kept

TOLERANCE = 1e-8
ROUGH = SelfAffine(hurst=0.8, roll_off=0.25, short_cutoff=0.05, rms_slope=0.1, seed=1)


def wall(hardness, *others):
    return [{"law": "hard_wall", "hardness": hardness}, *others]


@pytest.mark.parametrize("seed", range(24))
def test_conditions_of_contact_friction_and_plasticity_by_the_dense_compliance(seed):
    """Random bodies, surfaces, pasts, coefficients up to 1 and drives; p <= H where H is half of the largest.

    Each condition within ten tolerances, of the largest pressure or of the displacement: displacements by
    the dense matrix have rounding and what single precision leaves.
    """
    axes = 1 + seed % 2
    grid, given = random_problem(seed, axes)
    given = replace(
        given, law=given.law.scaled(0.5), force=None if given.force is None else 0.5 * given.force
    )
    transforms = Transforms(grid.points)
    elastic = FrictionSolver(grid, transforms).solve(given, tolerance=TOLERANCE)
    hardness = 0.5 * float(elastic.pressure.max())
    if given.load is not None:
        hardness = max(hardness, 1.5 * given.load)
    problem = replace(given, hardness=hardness)
    found = FrictionSolver(grid, transforms, yields=True).solve(problem, tolerance=TOLERANCE)
    assert found.converged, found.reason
    p, t, flow = found.pressure, found.traction, found.flow
    C = compliance(grid, problem.response)
    loads = np.zeros((3, grid.size))
    loads[: 1 + axes] = np.vstack((p, t))
    moved = np.einsum("ijkl,jl->ik", C, loads)[: 1 + axes]
    W_s, p_s = max(np.abs(moved[0]).max(), 1e-300), p.max()
    gap = problem.gap_at_rest + flow + moved[0] - found.depth
    assert p.min() >= 0
    assert p_s == hardness
    assert flow.min() >= 0
    assert flow.max() > 1e-3 * W_s
    assert (p[flow > 0] == hardness).all()
    assert np.abs(np.minimum(p / p_s, gap / W_s)).max() < 10 * TOLERANCE
    slip = problem.slip_at_rest + moved[1:] - found.path[:, None]
    bound = problem.law.bound(p)
    off = t - in_disks(t - slip * p_s / W_s, bound)
    assert np.abs(off).max() < 10 * TOLERANCE * min(bound.max(), p_s)
    if problem.load is not None:
        assert p.mean() == pytest.approx(problem.load, rel=10 * TOLERANCE)
    if problem.force is not None:
        np.testing.assert_allclose(t.mean(axis=1), problem.force, atol=10 * TOLERANCE * bound.mean())


@pytest.mark.parametrize(("punch", "points"), [(Parabola(radius=1.0), 256), (ROUGH, (64, 64))])
def test_partial_slip_is_the_elastic_unloading_of_the_imprint(punch, points):
    """T = mu (p(P) - p*), with p* of the load P - Q/mu after it, on a body without coupling.

    After J. Jaeger and M. Ciavarella: p - p* moves the points that stick by one displacement, and both
    contacts have one imprint, since unloading is elastic. On a surface, where t_x moves points along y too,
    pressure and imprint alone are those without friction.
    """
    mu, P, Q = 0.4, 0.03 if points == 256 else 0.004, 0.005 if points == 256 else 0.0008
    hardness = 0.1 if points == 256 else 0.05
    given = {"points": points, "interface": wall(hardness), "tolerance": TOLERANCE}
    body = halfspace(0.25, poisson=0.5)
    sheared = solve(body, punch, **given, friction=mu, mean_pressure=P, tangential_force=Q)
    cycle = solve(body, punch, **given, mean_pressure=[P, P - Q / mu])
    p, rest = cycle.pressure.to_numpy()
    assert (p == hardness).mean() > 0.02
    assert np.abs(cycle.imprint[1] - cycle.imprint[0]).max() == 0
    np.testing.assert_allclose(sheared.pressure, p, atol=1e-5 * hardness)
    np.testing.assert_allclose(sheared.imprint, cycle.imprint[0], atol=1e-6 * float(cycle.depth[0]))
    if points == 256:
        np.testing.assert_allclose(sheared.shear_x, mu * (p - rest), atol=1e-5 * mu * hardness)


RUN = {
    "grid": {"points": 128},
    "layer": {"thickness": 0.3, "poisson": 0.4, "material": {"model": "zener", "G0": 0.25, "Ginf": 1.0}},
    "halfspace": {"shear_modulus": 0.25, "poisson": 0.3},
    "punch": {"shape": "cylinder", "radius": 1.0},
    "time": {"step": 0.05, "end": 2.0},
    "trajectory": {
        "control": "depth", "kind": "approach_retract", "depth": 0.03, "approach_speed": 0.03,
        "tangential": {"control": "displacement", "kind": "oscillation", "displacement": 0.01, "period": 1.0},
    },
}  # fmt: skip
COULOMB = {"law": "coulomb", "coefficient": 0.4}


def run(**sections):
    recording = Kept()
    Case(Config(name="yielding", **(RUN | sections))).run(recording)
    return recording


@pytest.mark.parametrize("attraction", [[], [{"law": "exponential", "work": 1e-4, "range": 0.01}]])
def test_the_balance_of_energy_closes_as_the_square_of_the_step(attraction):
    """Work = stored + dissipated + slip + plastic; adaptive steps and fixed ones find the same."""
    laws = wall(0.08, COULOMB, *attraction)
    coarse, fine = (run(interface=laws, time={"step": step, "end": 2.0}) for step in (0.04, 0.01))
    adaptive = run(interface=laws, time={"step": "adaptive", "tolerance": 1e-4, "end": 2.0})
    work = max(fine["work"])
    assert fine["plastic_work"][-1] > 0.2 * work
    assert fine["slip_heat"][-1] > 0.05 * work
    open_coarse, open_fine = (np.abs(each["energy_residual"]).max() for each in (coarse, fine))
    assert open_fine < 0.15 * open_coarse
    assert open_fine < 2e-3 * work
    assert adaptive["plastic_work"][-1] == pytest.approx(fine["plastic_work"][-1], rel=5e-3)


def test_a_coefficient_of_zero_and_a_hardness_beyond_reach_change_nothing():
    normal = {name: value for name, value in RUN["trajectory"].items() if name != "tangential"}
    plain = run(interface=wall(0.08), trajectory=normal)
    smooth = run(interface=wall(0.08, COULOMB | {"coefficient": 0.0}))
    for column in ("mean_pressure", "contact_area", "plastic_work", "yielded_area", "work"):
        assert np.abs(smooth[column] - plain[column]).max() < 1e-4 * np.abs(plain[column]).max()
    elastic, hard = run(interface=COULOMB), run(interface=wall(10.0, COULOMB))
    assert not hard["plastic_work"].any()
    for column in ("mean_pressure", "tangential_force", "stick_area", "slip_heat", "work"):
        assert np.abs(hard[column] - elastic[column]).max() < 1e-4 * np.abs(elastic[column]).max()


def test_attraction_hardness_and_friction_by_solve():
    """The wall's pressure ends at H; without shear it is the contact without friction."""
    law = {"law": "exponential", "work": 1e-4, "range": 0.004}
    given = {"points": (48, 48), "interface": wall(0.08, law), "depth": 0.02, "tolerance": 1e-7}
    body = halfspace(0.25, poisson=0.3)
    plain = solve(body, Parabola(radius=1.0), **given)
    still = solve(body, Parabola(radius=1.0), **given, friction=0.0)
    moved = solve(body, Parabola(radius=1.0), **given, friction=0.4, tangential_displacement=0.004)
    for name in ("pressure", "imprint", "displacement"):
        scale = float(np.abs(plain[name]).max())
        np.testing.assert_allclose(still[name], plain[name], atol=1e-4 * scale)
    wall_pressure = moved.pressure + 1e-4 / 0.004 * np.exp(-moved.gap / 0.004)
    assert float(wall_pressure.max()) == pytest.approx(0.08, rel=1e-6)
    assert float(moved.imprint.max()) > 0


def test_an_imprint_of_the_step_before_stays():
    body, given = halfspace(0.25, poisson=0.3), {"points": 128, "friction": 0.3, "interface": wall(0.06)}
    deep = solve(body, Parabola(radius=1.0), **given, mean_pressure=0.03)
    back = solve(body, Parabola(radius=1.0), **given, mean_pressure=0.02, previous=deep)
    assert float(deep.imprint.max()) > 0
    np.testing.assert_array_equal(back.imprint, deep.imprint)
    assert float(back.pressure.max()) < 0.06
    both = solve(body, Parabola(radius=1.0), **given, mean_pressure=[0.03, 0.02])
    np.testing.assert_array_equal(both.imprint[1], deep.imprint)
    with pytest.raises(ConfigError, match=r"mean pressure: got 0\.06; must be below the hardness 0\.06"):
        solve(body, Parabola(radius=1.0), **given, mean_pressure=0.06)
