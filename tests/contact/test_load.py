"""Prescribed load: depth and contact against closed forms and against prescribed depth."""

import math

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.verification.theory import RADIUS, parabola_depth

LOAD = 0.05
ALONE = {
    "layer.thickness": math.inf, "trajectory": {"control": "load", "load": LOAD}, "time.end": 3.0,
    "grid.points": 1024, "solver.tolerance": 1e-9,
}  # fmt: skip


def creep(elapsed):
    """Integral from 0 of the default material's J = 1/G0 - (1/G0 - 1/Ginf) exp(-t G0/(Ginf tau))."""
    return elapsed - 0.9 * 10 * -math.expm1(-elapsed / 10)


def equivalent_load(time):
    """Integral of J(t - s) dpbar: the load on the relaxed body that does what the ramp has done by then."""
    return LOAD * (creep(time) - creep(max(time - 1, 0)))


def closed_form(load):
    """Depth of an incompressible elastic halfspace of unit modulus, L = 1."""
    return float(parabola_depth(math.acos(math.exp(-math.pi * RADIUS / 2 * load)) / math.pi))


def test_load_control_is_of_second_order(run):
    # On the same grid, so that time alone makes a difference.
    load = {"control": "load", "load": equivalent_load(3.0)}
    elastic = run(ALONE | {"layer.material.Ginf": 1.0, "trajectory": load, "time.step": 1.0})
    steps = [0.2, 0.1, 0.05]
    errors = [run(ALONE | {"time.step": step})["depth"][-1] / elastic["depth"][-1] - 1 for step in steps]
    assert np.polyfit(np.log(steps), np.log(np.abs(errors)), 1)[0] == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize(("tolerance", "steps"), [(1e-3, 70), (1e-4, 150)])
def test_adaptive_steps_keep_the_depth_within_the_tolerance(run, tolerance, steps):
    recording = run(ALONE | {"time.step": "adaptive", "time.tolerance": tolerance, "time.end": 100.0})
    exact = [closed_form(equivalent_load(time)) for time in recording["time"]]
    # 4e-5 is the grid's.
    assert np.abs(recording["depth"] - exact).max() < (tolerance + 4e-5) * recording["depth"].max()
    assert recording["time"].size <= steps


@pytest.mark.parametrize("base", [1.0, math.inf], ids=["halfspace", "rigid base"])
def test_the_load_that_a_depth_needs_gives_that_depth(run, tmp_path, base):
    body = {
        "layer.poisson": 0.3, "halfspace.shear_modulus": base, "grid.points": 512, "solver.tolerance": 1e-9,
        "time.end": 2.0, "output.snapshots": [2.0],
    }  # fmt: skip
    pressed = run(body)
    rows = zip(pressed["time"].tolist(), (2 * pressed["mean_pressure"]).tolist(), strict=True)
    (tmp_path / "load.txt").write_text("time load\n" + "\n".join(f"{t!r} {p!r}" for t, p in rows))
    trajectory = {"control": "load", "kind": "table", "file": str(tmp_path / "load.txt")}
    loaded = run(body | {"trajectory": trajectory})
    np.testing.assert_allclose(loaded["depth"], pressed["depth"], atol=1e-6 * 0.01)
    for name in ("stored", "dissipated"):
        np.testing.assert_allclose(loaded[name], pressed[name], atol=1e-5 * pressed["work"].max())
    # Each row of the table is a corner, across which no parabola is laid: the relaxation in a step is missed
    # by the trapezoid, in the second order of step over tau, 0.05.
    np.testing.assert_allclose(loaded["work"], pressed["work"], atol=5e-4 * pressed["work"].max())
    (_, u, _), (_, exact, _) = loaded.snapshots[0], pressed.snapshots[0]
    np.testing.assert_allclose(u, exact, atol=1e-6 * 0.01)
    assert (abs(exact.mean()) > 1e-4) == math.isinf(base)


@pytest.mark.parametrize("method", ["fire", "active_set", "conjugate_gradient"])
@pytest.mark.parametrize("thickness", [0.05, math.inf])
def test_every_solver_carries_a_load_that_comes_and_goes(run, tmp_path, method, thickness):
    (tmp_path / "load.txt").write_text("0 0\n1 0.1\n2 0\n3 0.1\n")
    trajectory = {"control": "load", "kind": "table", "file": str(tmp_path / "load.txt")}
    values = {"layer.thickness": thickness, "grid.points": 256, "trajectory": trajectory}
    found = run(values | {"time.end": 3.0, "time.step": 0.05, "solver.method": method})
    load = np.interp(found["time"], [0, 1, 2, 3], [0, 0.1, 0, 0.1])
    # FIRE holds lambda, the others the mean: the load but for the residual times p_max, some ten times it.
    np.testing.assert_allclose(found["mean_pressure"], load / 2, atol=1e-5 * 0.05)
    assert found["residual"].max() <= 1e-6
    assert found["contact_area"][found["time"] == 2.0] == 0  # it rests on the surface, and presses nothing
    assert found["depth"][-1] > found["depth"][np.argmin(abs(found["time"] - 1))]  # the body has crept


def test_a_first_touch_between_the_points_of_the_grid_is_not_lost_to_rounding(run):
    """No point is at the tip: of the depth, all but 1e-13 is the way to the next one."""
    tiny = {"grid.points": 31, "trajectory": {"control": "load", "load": 1e-14}, "time.step": 0.5}
    recording = run(tiny | {"time.end": 1.0, "punch": {"shape": "wedge", "slope": 1.0}})
    assert (recording["residual"] <= 1e-6).all()
    assert recording["depth"] == pytest.approx(0.5 / 31, rel=1e-12)


@pytest.mark.parametrize("method", ["active_set", "nested_gradient", "conjugate_gradient", "fire"])
@pytest.mark.parametrize("height", [0.0, 1e-17])
def test_a_load_on_a_flat_punch_is_carried_by_all_points_alike(method, height):
    # Gaps of this height are less than the rounding of the displacements that the load makes.
    heights = height * np.random.default_rng(1).random((33, 17))
    found = gfmdlayer.run(
        {"name": "flat", "grid": {"points": [33, 17]}, "layer": {"thickness": 0.1}, "time": {"step": 0.5}},
        punch=heights,
        trajectory={"control": "load", "load": 1.0},
        solver={"method": method, "tolerance": 1e-8},
        progress=False,
    )
    assert found["contact_area"].values[1:] == pytest.approx(1.0)
    assert found["mean_pressure"].values[-1] == pytest.approx(0.5)


ADHESION = {"law": "exponential", "work": 2e-4, "range": 0.02}


@pytest.mark.parametrize(
    "beside",
    [
        {},
        {"halfspace": {"shear_modulus": math.inf}},
        {"halfspace": {"shear_modulus": math.inf}, "interface": ADHESION},
        {"halfspace": {"shear_modulus": math.inf}, "trajectory.velocity": 0.3},
        {"interface": {"law": "coulomb", "coefficient": 0.3}},
    ],
    ids=["mean at rest", "compressible", "adhesion", "moving", "friction"],
)
def test_a_mean_gap_has_the_surface_of_the_load_that_is_found(tmp_path, beside):
    """The mean of a parabola on these points is (L^2 + 2 h^2)/24 R, with the spacing h."""
    base = {"time": {"end": 0.5, "step": 0.125}, "output.snapshots": [0.25, 0.5], "solver.tolerance": 1e-11}
    base |= {"grid.points": 64, "layer": {"thickness": 0.1, "poisson": 0.3}} | beside
    config = gfmdlayer.Config(name="a")
    by_gap = {"trajectory.control": "gap", "trajectory.gap": 0.15, "trajectory.ramp_time": 0.25}
    found = gfmdlayer.run(config.with_values(base | by_gap))
    touch = (1 + 2 / 64**2) / (24 * 0.25)
    np.testing.assert_allclose(found.mean_gap, [touch, (touch + 0.15) / 2, 0.15, 0.15, 0.15], rtol=1e-12)
    table = tmp_path / "load.txt"
    np.savetxt(table, np.column_stack([found.time, 2 * found.mean_pressure]))  # of a G0 of 1
    by_load = {"trajectory.control": "load", "trajectory.kind": "table", "trajectory.file": str(table)}
    again = gfmdlayer.run(config.with_values(base | by_load))
    for field in ("gap", "pressure", "displacement"):
        np.testing.assert_allclose(again[field], found[field], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(again.depth, found.depth, rtol=1e-7, atol=1e-10)
