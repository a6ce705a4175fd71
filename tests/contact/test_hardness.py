"""Contact pressures that end at a hardness, and the imprint that they leave."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import circulant
from scipy.optimize import lsq_linear, minimize

import gfmdlayer
from gfmdlayer.case.case import Case
from gfmdlayer.config import Config
from gfmdlayer.contact.loss_stiffness import LossStiffnessSolver
from gfmdlayer.contact.nested.solver import NestedGradient
from gfmdlayer.contact.newton.solver import Newton
from gfmdlayer.contact.problem import Problem
from gfmdlayer.contact.residual import residual_scales
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.interface.law import HARD_WALL
from tests.recordings import Kept

# A halfspace of E* = 2 G/(1 - nu) = 1, and a rough surface of slope 0.1: elastic pressures reach 0.1 E*.
HALFSPACE = {"layer": {"thickness": 0.0}, "halfspace": {"shear_modulus": 0.25, "poisson": 0.5}}
ROUGH = {
    "shape": "self_affine", "hurst": 0.8, "roll_off": 0.25, "short_cutoff": 0.05, "rms_slope": 0.1, "seed": 1,
}  # fmt: skip
RUBBER = {"thickness": math.inf, "material": {"model": "zener", "G0": 0.25, "Ginf": 2.5}}
SPHERE = {"shape": "parabola", "radius": 1.0}
TOLERANCE = 1e-9


def config(hardness, **sections):
    """The rough halfspace on 64 x 64 points, under a load of 0.004 in 1, unless said otherwise."""
    wall = {"law": "hard_wall"} if hardness is None else {"law": "hard_wall", "hardness": hardness}
    given = {
        "grid": {"points": [64, 64]}, **HALFSPACE, "punch": ROUGH, "interface": wall,
        "trajectory": {"control": "load", "load": 0.004}, "time": {"step": 0.25, "end": 1.0},
        "solver": {"tolerance": TOLERANCE, "method": "nested_gradient"},
    }  # fmt: skip
    return Config(name="hardness", **(given | sections))


def run(given, **parts):
    recording = Kept()
    Case(given, **parts).run(recording)
    return recording


CYCLES = {"control": "load", "kind": "approach_retract", "load": 0.004, "approach_speed": 0.004, "cycles": 2}


def test_pressure_gap_and_imprint_satisfy_the_conditions_of_plasticity():
    """Residuals by their definition: over tolerance times the largest pressure, or times the depth."""
    case = Case(config(0.02))
    (kappa, b), hardness = case.contact.history.terms(0.25), 0.02
    problem = case.contact.imprint.under(case.contact.loading.problem(kappa, b, 1.0))
    found = case.contact.solver.solve(problem, np.zeros(64 * 64), TOLERANCE, 1000)
    assert found.converged
    assert found.flow is not None
    p, u = found.pressure, found.displacement
    scale, depth = residual_scales(p, u, problem.residual_floor)
    overlap = u - problem.obstacle
    assert p.min() >= 0
    assert p.max() == hardness
    assert abs(p.mean() - 0.004) <= 1e-13 * 0.004  # rounding of a sum
    assert overlap[p < hardness].max() <= 1e-12 * depth  # rounding: the surface was lifted clear
    assert np.minimum(p / scale, -overlap / depth).max() <= TOLERANCE
    np.testing.assert_allclose(found.flow, np.where(p == hardness, np.maximum(overlap, 0), 0), atol=1e-15)
    # The pressure is the force of the displacement, within the residual.
    waves = case.transforms.forward(u)
    force = case.transforms.backward((problem.intercept - problem.stiffness * waves) / u.size) + p.mean()
    np.testing.assert_allclose(force, p, atol=TOLERANCE * scale)
    assert found.flow.max() > 0.01 * depth
    # Under the same load again there is nothing left to flow.
    case.contact.imprint.remember(found.flow)
    problem = case.contact.imprint.under(case.contact.loading.problem(kappa, b, 1.0))
    again = case.contact.solver.solve(problem, p, TOLERANCE, 1000)
    assert again.flow is not None
    assert again.flow.max() <= TOLERANCE * depth


def test_pressures_below_the_hardness_are_elastic():
    """The same solution within the tolerance of either, whose effect on the area is a point or two."""
    elastic, yielding = run(config(None)), run(config(10.0))
    assert (yielding["plastic_work"] == 0).all()
    assert (yielding["yielded_area"] == 0).all()
    np.testing.assert_allclose(yielding["depth"], elastic["depth"], rtol=1e-6)
    np.testing.assert_allclose(yielding["contact_area"], elastic["contact_area"], atol=2 / 64**2)


def test_a_dense_bounded_problem_has_the_same_pressures():
    """On a line with springs: min |B p - d|^2/2 over 0 <= p <= H with A = B'B, by SciPy's active sets."""
    # No value of A is below 1/max(kappa), so that pressures differ by max(kappa) D tolerance a point at most,
    # times the square root of the points that press (test_nested_gradient derives it).
    n, hardness = 64, 0.1
    x = np.arange(n) / n - 0.5
    kappa = 5.0 + np.arange(n // 2 + 1, dtype=float)
    h = 0.2 * x**2 + 0.004 * np.cos(40 * x) - 0.03
    root = circulant(np.fft.irfft(1 / np.sqrt(kappa), n))
    dense = lsq_linear(root, -np.linalg.solve(root.T, h), (0, hardness), method="bvls", tol=1e-15)
    problem = Problem(
        kappa, np.zeros(n // 2 + 1, dtype=complex), h, height=float(np.ptp(h)), hardness=hardness
    )
    found = NestedGradient(Transforms((n,))).solve(problem, np.zeros(n), TOLERANCE)
    assert found.converged
    assert 0 < np.count_nonzero(found.pressure == hardness) < np.count_nonzero(found.pressure > 0) < n
    depth = residual_scales(found.pressure, found.displacement, problem.residual_floor)[1]
    np.testing.assert_allclose(found.pressure, dense.x, atol=kappa.max() * depth * TOLERANCE * n**0.5)


@pytest.mark.parametrize("points", [(64, 64), (1024,)])
@pytest.mark.parametrize("contrast", [1.0, 20.0])
def test_rough_contact_yields_in_the_iterations_of_an_elastic_one(points, contrast):
    """At a given load or depth; the conditions of the minimum, which is unique, by the displacement alone."""
    # But for those that a second edge costs, of the part that yields: at most as many as conjugate gradients
    # of condition 4 (test_cycle) take from 1e-2, the residual on coarser grids, to 1e-6, 9.
    film = {"model": "zener", "G0": 0.25 * contrast, "Ginf": 0.25 * contrast + 1e-6}
    case = Case(config(None, grid={"points": points}, layer={"thickness": 0.02, "material": film}))
    kappa, start = np.array(case.contact.history.terms(1.0)[0]), np.zeros(case.punch.size)
    kappa[0], tolerance = 0.0, 1e-6
    solver = NestedGradient(case.transforms, case.grid)
    elastic = Problem(kappa, 0j * kappa, case.punch, 0.02, height=float(np.ptp(case.punch)))
    loaded = replace(elastic, hardness=0.3 * float(solver.solve(elastic, start, tolerance).pressure.max()))
    lowered = case.punch - solver.solve(loaded, start, tolerance).displacement.mean()
    for problem in (loaded, replace(loaded, obstacle=lowered, mean_pressure=None)):
        found = solver.solve(problem, start, tolerance)
        without = solver.solve(replace(problem, hardness=math.inf), start, tolerance)
        assert found.converged
        assert found.iterations <= without.iterations + 9
        assert found.flow is not None
        p, u, hardness = found.pressure, found.displacement, problem.hardness
        stress = -case.transforms.backward(kappa * case.transforms.forward(u)) / u.size
        stress += problem.mean_pressure or -stress[found.gap > 0].mean()
        gap, scale = problem.obstacle - u, tolerance * hardness
        assert (gap < 0).any()
        np.testing.assert_allclose(stress[gap > 0], 0.0, atol=scale)
        np.testing.assert_allclose(stress[gap < 0], hardness, atol=scale)
        assert stress.min() >= -scale
        assert stress.max() <= hardness + scale
        np.testing.assert_allclose(p, stress, atol=2 * scale)
        np.testing.assert_allclose(found.flow, np.maximum(-gap, 0.0), atol=1e-15)


def test_a_sphere_yields_at_the_load_of_hertz():
    """F = pi^3 R^2 H^3/(6 E*^2); images of a contact of 1/16 of the cell change it by less than a tenth."""
    first = math.pi**3 * 0.04**3 / 6
    for load, yields in ((0.9, False), (1.1, True)):
        trajectory = {"control": "load", "load": load * first}
        found = run(config(0.04, punch=SPHERE, trajectory=trajectory, grid={"points": [128, 128]}))
        assert (found["yielded_area"][-1] > 0) == yields


def test_soft_asperities_carry_the_hardness_over_their_area():
    """F = H A but for the elastic rim, whose part falls with H/E*: 0.6 of H/(slope E*) here, 1/20."""
    for hardness, elastic in ((0.005, 0.03), (5e-4, 0.003)):
        load = {"control": "load", "load": 0.5 * hardness}
        found = run(config(hardness, trajectory=load))
        ratio = found["mean_stress"][-1] / (hardness * found["contact_area"][-1])
        assert 1 - elastic <= ratio <= 1


def test_the_imprint_does_not_depend_on_the_steps_and_cycles_close_after_the_first():
    """While no point leaves the hardness; by the tolerance, times its effect on the depth of some ten."""
    flows = []
    for steps in (2, 8):
        found = run(config(0.02, trajectory=CYCLES, time={"step": 1 / steps}))
        depth, work = found["depth"], found["plastic_work"]
        up, down, again, last = (depth[i * steps : (i + 1) * steps + 1] for i in range(4))
        assert work[steps] > 0
        assert work[-1] - work[steps] <= 1e-7 * work[steps]
        np.testing.assert_allclose(again, down[::-1], rtol=1e-7, atol=1e-7 * depth.max())
        np.testing.assert_allclose(last, down, rtol=1e-7, atol=1e-7 * depth.max())
        assert depth[2 * steps] > 0.05 * depth.max()  # of the punch that just touches its imprint
        assert up[1] < down[-2]
        flows.append(work[steps])
    assert flows[0] == pytest.approx(flows[1], rel=1e-7)


@pytest.mark.parametrize(
    ("hardness", "path", "steps"),
    [
        (0.05, {"kind": "approach_retract", "load": 0.004, "dwell": 1.0}, (0.125, 0.03125)),
        (0.1, {"load": 0.01, "velocity": 0.1}, (0.2, 0.05)),
    ],
    ids=["in and out", "moving"],
)
def test_the_balance_of_energy_closes_at_any_step(hardness, path, steps):
    """Of a viscoelastic body whose asperities yield."""
    residuals, moves = [], "velocity" in path
    for step in steps:
        time = {"step": step} | ({"end": 2.0} if moves else {})
        found = run(config(hardness, layer=RUBBER, trajectory={"control": "load"} | path, time=time))
        work = found["work"][-1]
        assert found["plastic_work"][-1] > 0.1 * work
        assert not moves or found["friction"][-1] > 0
        residuals.append(abs(found["energy_residual"][-1]) / work)
    # Elastic and plastic work are exact. What is left is too small to fall with the steps (3.5e-4 at most).
    assert max(residuals) < 5e-4


@pytest.mark.parametrize("step", [0.25, "adaptive"])
def test_the_plastic_work_is_the_hardness_times_the_imprint(step):
    """To rounding, also where adaptive steps are rejected: their flow is not kept."""
    time = {"step": step, "end": 2.0} | ({"tolerance": 1e-3} if step == "adaptive" else {})
    found = run(config(0.05, layer=RUBBER, time=time, output={"snapshots": [1.0, 2.0]}))
    assert "traction" not in found.fields
    for at, imprint in zip(found.times, found.fields["imprint"], strict=True):
        assert imprint.min() >= 0
        work = found["plastic_work"][np.searchsorted(found["time"], at - 1e-12)]
        assert work == pytest.approx(0.05 * imprint.mean(), rel=1e-12)
        assert work > 0
    assert (np.diff(found["plastic_work"]) >= 0).all()


def test_the_balance_of_energy_holds_over_jumps_of_a_depth():
    """Where all points in contact yield, the depth jumps until the next ones touch."""
    # Over a jump the work is known to half the step of the load times the jump. The jumps add up to the depth
    # at most, and the work is half the load times the depth: a part `step` of it for a ramp of duration 1.
    step, grid = 1 / 80, {"points": [32, 32], "period": 1.2}
    load, time = {"control": "load", "load": 0.007}, {"step": step, "end": 1.0}
    found = run(config(0.12, grid=grid, layer=RUBBER, punch=SPHERE, trajectory=load, time=time))
    jumps = np.diff(found["depth"])
    assert jumps.max() > 5 * np.median(jumps)
    assert abs(found["energy_residual"][-1]) <= step * found["work"][-1]


def test_the_depth_of_a_new_touch_is_deeper_by_the_imprint():
    """The depth counts from the new punch: it touches where heights and imprint are least together."""
    given = config(0.02, trajectory=CYCLES | {"cycles": 1}, time={"step": 0.25})
    case, found = Case(given), Kept()
    case.run(found)
    touch = float((case.punch + case.contact.imprint.depth).min())
    assert touch > 0
    assert found["depth"][-1] == pytest.approx(touch, rel=1e-6)


def test_a_stiff_film_on_a_soft_base_yields():
    """Where projected gradients make no progress, the set of the points at the hardness is corrected."""
    film = {"thickness": 0.02, "material": {"model": "zener", "G0": 0.25, "Ginf": 250.0}}
    path = {"control": "load", "kind": "approach_retract", "load": 0.05}
    for radius in (1.0, 0.2):
        punch = SPHERE | {"radius": radius}
        given = config(
            0.3, grid={"points": 256}, layer=film, punch=punch, trajectory=path, time={"step": 0.1}
        )
        found = run(given)
        assert (found["residual"] <= TOLERANCE).all()
        assert found["plastic_work"][-1] > 0


def test_a_sphere_without_images_yields_at_the_load_of_hertz():
    """Within 3 %: the largest pressure goes with F^(1/3), and the fit of the body is within 1e-3."""
    hardness, body, punch = 0.08, gfmdlayer.halfspace(0.25), gfmdlayer.Parabola(radius=1.0)
    first, period = math.pi**3 * hardness**3 / 6, 3 * math.pi * hardness
    keys = {"points": (64, 64), "isolated": True, "interface": {"law": "hard_wall", "hardness": hardness}}
    for part, yields in ((0.97, False), (1.03, True)):
        found = gfmdlayer.solve(body, punch, force=part * first, period=period, **keys)
        assert (float(found.imprint.max()) > 0) == yields


def test_columns_of_a_contact_without_images_are_totals():
    alone = {"points": [32, 32], "period": 1.4, "boundary": "isolated"}
    path = {"control": "force", "force": 0.01}
    given = config(0.08, grid=alone, punch=SPHERE, trajectory=path, output={"snapshots": [1.0]})
    case, found, cell = Case(given), Kept(), 1.4**2
    case.run(found)
    assert found["plastic_work"][-1] == pytest.approx(0.08 * case.contact.imprint.depth.mean() * cell)
    at_hardness = found.fields["pressure"][-1] == 0.08
    assert found["yielded_area"][-1] == pytest.approx(at_hardness.mean() * cell)
    assert at_hardness.any()


@pytest.mark.parametrize("attracts", [False, True])
def test_a_moving_punch_satisfies_the_conditions_of_plasticity(attracts):
    """The pressure is that of the displacement, by the stiffness with its loss, within the tolerance."""
    n, load, hardness, tolerance = 128, 0.2, 0.5, 1e-8
    grid, transforms = Grid((n,), (1.0,)), Transforms((n,))
    x, q = grid.coordinates[0], grid.wavenumbers
    loss, h = 0.5 * q * np.minimum(q / 10, 1), 0.4 * x**2 + 0.003 * np.cos(44 * np.pi * x)
    loss[-1] = 0.0  # the shortest wave is its own opposite
    law = gfmdlayer.Exponential(work=2e-4, range=0.004).interaction() if attracts else HARD_WALL
    problem = Problem(q.copy(), 0j * q, h, load, loss, float(np.ptp(h)), law, hardness=hardness)
    inner = Newton(transforms) if attracts else NestedGradient(transforms)
    start = np.full(n, np.inf) if attracts else np.zeros(n)
    found = LossStiffnessSolver(inner, transforms, grid.parseval_weights).solve(problem, start, tolerance)
    assert found.converged
    assert found.flow is not None
    p, u = found.pressure, found.displacement
    wall = p + law.traction(found.gap)
    yields = wall >= hardness * (1 - 1e-15)
    assert wall.max() <= hardness * (1 + 1e-15)
    assert 0 < np.count_nonzero(yields) < np.count_nonzero(wall > tolerance) < n
    force = load - np.fft.irfft((problem.stiffness + 1j * loss) * np.fft.rfft(u), n)
    scale, depth = residual_scales(wall, u, problem.residual_floor)
    np.testing.assert_allclose(force, p, atol=tolerance * scale)
    np.testing.assert_allclose(found.flow, np.where(yields, np.maximum(u - h, 0), 0), atol=1e-15)
    assert (abs(np.minimum(wall / scale, found.gap / depth)) <= tolerance).all()
    assert found.flow.max() > 0.01 * depth


@pytest.mark.parametrize(
    "law",
    [gfmdlayer.Exponential(work=0.002, range=0.03), gfmdlayer.LennardJones(work=0.002, separation=0.05)],
    ids=["exponential", "lennard_jones"],
)
def test_with_attraction_it_is_the_minimum_over_gaps_and_flows(law):
    """Of elastic energy, interface and flow stress times flow: no lower one, by another method."""
    # The energy is convex, as no curvature of the law exceeds kappa, 5 at least. Rounding of the energies, of
    # 1e-15, and SciPy's tolerance of them leave 1e-13; their root is the error of a displacement.
    n, law = 64, law.interaction()
    x = np.arange(n) / n - 0.5
    kappa, h = 5.0 + 0.5 * np.arange(n // 2 + 1), 0.3 * x**2 + 0.005 * np.cos(38 * x) - 0.03
    assert -law.curvature(np.linspace(0, 0.2, 400)).min() < 5.0
    pull, hardness = float(law.traction(np.zeros(1))[0]), float(law.traction(np.zeros(1))[0]) + 0.1
    problem = Problem(kappa, 0j * kappa, h, height=float(np.ptp(h)), interface=law, hardness=hardness)
    found = Newton(Transforms((n,))).solve(problem, np.full(n, np.inf), 1e-10)
    assert found.converged
    assert found.flow is not None
    stiffness = circulant(np.fft.irfft(kappa, n))

    def energy(of):
        gap, flow = of[:n], of[n:]
        u = h + flow - gap
        stress = stiffness @ u
        total = u @ stress / 2 + law.energy(gap).sum() + (hardness - pull) * flow.sum()
        return float(total), np.concatenate((law.traction(gap) - stress, hardness - pull + stress))

    bounds, options = [(0, None)] * (2 * n), {"maxiter": 20_000, "ftol": 1e-16, "gtol": 1e-11, "maxcor": 50}
    start = np.maximum(np.concatenate((h, -h)), 0.0)
    other = minimize(energy, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    least = energy(np.concatenate((found.gap, found.flow)))[0]
    assert abs(least - other.fun) <= 1e-13 * abs(other.fun)
    np.testing.assert_allclose(found.displacement, h + other.x[n:] - other.x[:n], atol=1e-6 * np.ptp(h))
    assert 0 < np.count_nonzero(found.flow) < np.count_nonzero(found.gap == 0) < n
    wall = found.pressure + law.traction(found.gap)
    assert wall.max() == pytest.approx(hardness, rel=1e-15)
    assert wall[found.gap > 0] == pytest.approx(0.0, abs=1e-10 * hardness)


def test_flat_summits_stick_better_and_the_balance_of_energy_closes():
    """The wall carries the hardness, the flow stress works on the imprint, and the pull-off grows."""
    # The balance closes at least in proportion to the steps; in longer ones errors of both signs cancel.
    law, speed = {"law": "exponential", "work": 0.02, "range": 0.01}, 0.05
    path = {"kind": "approach_retract", "start": -0.05, "depth": 0.03, "final": -0.1}
    keys = {
        "grid": {"points": 256},
        "layer": RUBBER | {"material": {"model": "zener", "G0": 1.0, "Ginf": 10.0}},
        "punch": {"shape": "parabola", "radius": 0.25},
        "trajectory": path | {"approach_speed": speed, "retract_speed": speed},
        "solver": {"tolerance": 1e-6},
        "output": {"snapshots": [1.6]},
    }
    pulls, residuals = [], []
    for hardness, step in ((None, 0.05), (4.0, 0.05), (4.0, 0.0125)):
        wall = {"law": "hard_wall"} if hardness is None else {"law": "hard_wall", "hardness": hardness}
        case, found = Case(config(None, interface=[law, wall], time={"step": step}, **keys)), Kept()
        case.run(found)
        pulls.append(-found["mean_stress"].min())
        if hardness is not None:
            pressure, traction, imprint = (found.fields[n][-1] for n in ("pressure", "traction", "imprint"))
            assert (pressure + traction).max() == pytest.approx(hardness, rel=1e-12)
            assert imprint.max() > 0
            work = found["plastic_work"][-1]
            assert work == pytest.approx((hardness - 2.0) * case.contact.imprint.depth.mean(), rel=1e-12)
            residuals.append(np.abs(found["energy_residual"]).max() / found["work"][-1])
    assert pulls[1] > 1.1 * pulls[0]
    assert residuals[1] <= residuals[0] / 4
    assert residuals[1] < 5e-4


def test_solve_gives_the_imprint_and_refuses_a_load_beyond_the_hardness():
    contact, wall = (
        (gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=1.0)),
        {"law": "hard_wall", "hardness": 0.1},
    )
    found = gfmdlayer.solve(*contact, mean_pressure=0.05, interface=wall, points=256)
    assert float(found.pressure.max()) == 0.1
    assert ((found.imprint > 0) <= (found.pressure == 0.1)).all()
    sticky = [{"law": "exponential", "work": 2e-4, "range": 0.01}, wall]
    most = "0.08, the hardness 0.1 less the attraction in contact"
    for laws, load, said in ((wall, 0.2, "the hardness 0.1"), (sticky, 0.09, most)):
        with pytest.raises(gfmdlayer.ConfigError, match=f"mean pressure: got {load}; must be below {said}"):
            gfmdlayer.solve(*contact, mean_pressure=load, interface=laws, points=256)


@pytest.mark.parametrize("base", [1.0, math.inf])
def test_a_load_of_a_whole_number_of_points_at_the_hardness_is_borne(base):
    """The last point carries the hardness to rounding; taken as above it, the sets went round in circles."""
    body, hardness = gfmdlayer.bonded_layer(0.05, 1.0, poisson=0.4, halfspace=base), 0.05
    for load in np.array([7, 11, 13, 17, 21]) / 64 * hardness:
        wall = {"law": "hard_wall", "hardness": hardness}
        found = gfmdlayer.solve(
            body, gfmdlayer.Parabola(radius=1.0), points=64, mean_pressure=load, interface=wall
        )
        assert float(found.pressure.max()) == pytest.approx(hardness, rel=1e-12)
        assert float(found.mean_pressure) == pytest.approx(load, rel=1e-9)
