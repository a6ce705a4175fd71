"""Notes on configurations that are possible and perhaps not meant."""

import warnings

import pytest

import gfmdlayer
from gfmdlayer.case.notes import DIMENSIONS, notes
from gfmdlayer.config import Config, load
from gfmdlayer.config.json_schema import json_schema
from gfmdlayer.validation.fields import dimension

SI = {
    "grid": {"period": 1e-2},
    "layer": {"thickness": 2e-4, "material": {"G0": 1e6, "Ginf": 1e7, "tau": 0.1}},
    "punch": {"shape": "sphere", "radius": 3e-2},
    "trajectory": {"control": "load", "load": 1e4, "ramp_time": 1.0},
}
UNITS = {"length": "m", "stress": "Pa", "time": "s"}


def of(values):
    return notes([Config(name="x").with_values(values)])


def test_a_forgotten_base_is_noted_with_and_without_units():
    stiff = {"halfspace.shear_modulus": 8e10}
    beside = "left at defaults beside layer.material.G0: halfspace.shear_modulus = 1; give all moduli"
    assert [note[: len(beside)] for note in of(SI)] == [beside]
    assert of(SI | stiff) == []
    assert of(SI | {"units": UNITS}) == [
        "left at defaults, in the units given: halfspace.shear_modulus = 1 Pa, time.end = 8 s"
    ]
    assert of(SI | stiff | {"units": UNITS, "time": {"end": 4.0, "step": 0.01}}) == []


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"layer.thickness": 0.002, "trajectory.depth": 1e-3, "layer.material.Ginf": 256.0},
        {"layer.thickness": float("inf"), "layer.material": {"G0": 1e6, "Ginf": 1e7}},  # no base to forget
        {"layer.thickness": 0, "halfspace.shear_modulus": 1e6},  # and no layer
        {"layer.material": {"model": "prony", "G0": 1.0, "branches": [{"G": 1.0, "tau": 1e9}]}},
    ],
    ids=["defaults", "dimensionless", "layer alone", "halfspace alone", "long times"],
)
def test_nothing_is_noted_on_cases_in_one_unit(values):
    assert of(values) == []


def test_lengths_in_another_unit_are_noted():
    (note,) = of({"grid.period": 1e4, "trajectory.depth": 30.0})
    assert note.startswith(
        "left at defaults beside grid.period: layer.thickness = 0.05, punch.radius = 0.25;"
    )


def test_a_ramp_or_a_table_that_does_not_fill_the_run_is_noted(tmp_path):
    assert of({"trajectory.ramp_time": 10.0}) == [
        "trajectory.ramp_time = 10 is beyond time.end = 8: the ramp is not completed"
    ]
    (tmp_path / "depth.txt").write_text("time depth\n0 0\n5 0.01\n")
    (tmp_path / "velocity.txt").write_text("time velocity\n0 0\n6 0.01\n")
    path = tmp_path / "x.yaml"
    path.write_text(
        "name: x\ntrajectory: {kind: table, file: depth.txt, velocity_file: velocity.txt}\n"
        "sweep: {layer.thickness: [0.1, 0.2], time.end: [5, 8]}\n"
    )
    config = load(path)
    cases = [config.with_values({"time.end": end}) for end in (5.0, 5.5, 8.0, 8.0)]
    assert notes(cases) == [
        f"{tmp_path}/depth.txt: ends at time 5, before time.end = 5.5; the last depth stays",
        f"{tmp_path}/depth.txt: ends at time 5, before time.end = 8; the last depth stays",
        f"{tmp_path}/velocity.txt: ends at time 6, before time.end = 8; the last velocity stays",
    ]


def test_an_interface_that_the_grid_does_not_resolve_is_noted_with_points_that_would_do():
    # l = (pi/4) E* range^2/work with E* = 4: 3.14e-4, so 3 points need a spacing of 1.05e-4, 9549 points.
    law = {"law": "exponential", "work": 1e-2, "range": 1e-3}
    (note,) = of({"interface": law, "grid.points": 1024})
    assert note.startswith("interface: its cohesive zone, (pi/4) E* range^2/work = 0.000314")
    assert "is 0.32 points wide; at least 3 are needed: use grid.points: 16384" in note
    assert of({"interface": law, "grid.points": 9551}) == []
    assert of({"interface": {"law": "hard_wall"}, "grid.points": 64}) == []
    # A surface, and a halfspace alone, ten times as stiff; the traction of Dugdale ends at once.
    stiff = {"layer.thickness": 0, "halfspace.shear_modulus": 10.0, "grid.points": [1024, 2048]}
    dugdale = {"law": "dugdale", "work": 1e-2, "stress": 10.0}
    (note,) = of({"interface": [law, dugdale], **stiff})
    assert note.startswith("interface[1]: its")
    assert note.endswith("is 3.2 points wide; at least 8 are needed: use grid.points: [4096, 4096]")


def test_an_attraction_that_bends_a_free_layer_is_noted():
    """A wedge jumps to one side of a plate, K = E h^3 q^4/(12 (1 - nu^2)), much softer than a halfspace."""
    free = {
        "grid.points": 128,
        "layer": {"thickness": 0.05, "poisson": 0.45},
        "halfspace.shear_modulus": 0.0,
        "interface": {"law": "dugdale", "work": 4e-3, "stress": 0.1},
    }
    (note,) = of(free)
    # With E/(1 - nu^2) = 2 G/(1 - nu) = E*, K over E* q/2 is (q h)^3/6 = 0.00517, less terms in (q h)^2.
    assert "bends the layer like a plate: in waves of the period the body has 0.0051 of the stiffness" in note
    assert "halfspace.shear_modulus" in note
    assert of(free | {"layer": {"thickness": 0.3, "poisson": 0.45}}) == []
    assert of(free | {"halfspace.shear_modulus": 1.0}) == []
    assert of(free | {"interface": {"law": "hard_wall"}}) == []


def test_an_indentation_in_a_single_step_of_first_order_is_noted():
    coarse = {"time": {"end": 8.0, "step": 2.0, "integrator": "backward_euler"}}
    assert of(coarse | {"trajectory.ramp_time": 4.0}) == []
    assert not any("backward Euler" in note for note in of({"time": {"end": 8.0, "step": 2.0}}))
    (note,) = of(coarse)
    assert note.startswith("time.step = 2: the indentation, up to trajectory.ramp_time = 1, is one step")


def test_an_indentation_that_equal_steps_pass_over_is_noted(tmp_path):
    """Backward Euler sees the depth at whole steps alone; the other integrator lands on each row."""
    path = tmp_path / "depth.txt"
    path.write_text("0 0\n0.05 0\n0.1 0.01\n0.15 0\n1 0\n")
    table = {"trajectory": {"kind": "table", "file": str(path)}}
    time = {"end": 1.0, "step": 0.25, "integrator": "backward_euler"}
    (note,) = of(table | {"time": time})
    assert note.startswith(
        "time.step = 0.25: the steps of backward Euler miss the depth 0.01 at t = 0.1 and use 0 there"
    )
    assert of(table | {"time": time | {"step": 0.05}}) == []
    assert of(table | {"time": time | {"integrator": "exponential"}}) == []
    cycle = {"trajectory": {"kind": "approach_retract", "depth": 0.01, "approach_speed": 0.02}}
    assert of(cycle | {"time": {"step": 0.5, "integrator": "backward_euler"}}) == []


def test_a_solver_too_coarse_for_adaptive_steps_is_noted():
    """Its errors in the displacement, pressed on by the glassy modulus, decide the steps."""
    material = {"model": "zener", "G0": 1.0, "Ginf": 2000.0, "tau": 1.0}
    time = {"end": 1.0, "step": "adaptive", "tolerance": 0.01}
    case = {"layer.material": material, "time": time, "solver.tolerance": 1e-4}
    assert of(case) == []  # without attraction the solver takes a finer one of itself
    sticky = case | {"interface": {"law": "exponential", "work": 1e-3, "range": 0.1}}
    (note,) = (note for note in of(sticky) if note.startswith("solver.tolerance"))
    assert note.startswith("solver.tolerance = 0.0001 times the ratio of the glassy")
    assert note.endswith("use solver.tolerance: 5e-06")
    assert [note for note in of(sticky | {"solver.tolerance": 5e-6}) if "solver" in note] == []
    assert of({"layer.material": material, "solver.tolerance": 1e-4, "time.step": 0.005}) == []


def test_times_in_another_unit_are_noted():
    """All given times are below a hundredth of the paper's; long relaxation times are common."""
    fast = {"layer.material.tau": 1e-4, "trajectory.ramp_time": 2e-3}
    assert of(fast | {"time.step": 1e-5}) == [
        "left at defaults beside layer.material.tau: time.end = 8; give all times in one unit"
    ]
    assert of({"layer.material.tau": 1e-4}) == [
        "left at defaults beside layer.material.tau: trajectory.ramp_time = 1, time.end = 8; "
        "give all times in one unit"
    ]
    assert of(fast | {"time": {"end": 0.1, "step": 1e-5}}) == []


def test_each_default_with_a_dimension_is_named_beside_units():
    """All keys of all sections whose default is a number with a dimension; angles are in degrees."""
    dimensional = {
        (name, key)
        for name, section in json_schema()["$defs"].items()
        for key, value in section.get("properties", {}).items()
        if dimension(value.get("description", "").partition("; must be ")[0])[1] not in ("", "degrees")
        if isinstance(value.get("default"), float) and value["default"]
    }
    assert {("Time", "end"), ("Parabola", "radius"), ("Layer", "thickness")} <= dimensional
    assert {key for _, key in dimensional} <= set(DIMENSIONS)
    speed = {"trajectory": {"kind": "approach_retract", "depth": 1e-6}, "units": UNITS}
    assert "trajectory.approach_speed = 1e-06 m/s" in of(speed)[0]


@pytest.mark.parametrize(("ramp", "step"), [(1e-3, 5e-3), (1e-3, 5e-4), (1e-2, 5e-3)])
def test_a_step_that_is_too_long_for_the_relaxation_is_noted_with_its_error(ramp, step):
    """Against the advised step, whose error is 0.002; one digit of an estimate that is within a third."""
    case = {
        "layer": {"material": {"G0": 1.0, "Ginf": 10.0, "tau": 1e-3}}, "halfspace": {"shear_modulus": 1e3},
        "grid": {"points": 256}, "trajectory": {"ramp_time": ramp},
    }  # fmt: skip
    (note,) = [note for note in of(case | {"time": {"end": 0.02, "step": step}}) if "long beside" in note]
    error = float(note.partition("may be ")[2].partition(" ")[0])
    enough = float(note.partition("use time.step: ")[2].partition(",")[0])

    def force(step):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return float(gfmdlayer.run(case | {"time": {"end": ramp, "step": min(step, ramp)}}).force[-1])

    assert 1 - force(step) / force(enough) == pytest.approx(error, rel=0.5, abs=0.002)
    assert not [note for note in of(case | {"time": {"end": 0.02, "step": enough}}) if "long beside" in note]


def test_steps_that_follow_the_relaxation_or_a_slow_ramp_are_not_noted():
    """On a ramp of 100 tau the viscous part of the force is a tenth, whatever the step is within it."""
    fast = {"layer.material.tau": 1e-3, "time": {"end": 1.0, "step": 5e-3}}
    assert of(fast | {"trajectory.ramp_time": 0.1}) == []
    assert of(fast | {"trajectory.ramp_time": 1e-3, "time.step": "adaptive"}) == []


def test_what_friction_does_not_hold_or_resolve_is_noted():
    law = {"interface": {"law": "coulomb", "coefficient": 0.4}, "grid.period": 2.0, "time.step": 0.01}
    load = {"control": "load", "load": 0.1}
    pull, less = (
        {"trajectory": load | {"tangential": {"control": "force", "force": force}}} for force in (0.08, 0.079)
    )
    assert of(law | pull) == [
        "trajectory.tangential.force = 0.08: friction holds at most 0.08; the punch slides away, and the run "
        "ends there"
    ]
    assert of(law | less) == []
    attraction = {"law": "exponential", "work": 1e-3, "range": 0.05}
    assert of(law | pull | {"interface": [law["interface"], attraction]}) == []  # it presses too
    rolling = {"trajectory": load | {"velocity": 1.0, "creepage": 0.01}}
    assert of(law | rolling | {"grid.points": 1000}) == [
        "time.step = 0.01: the material moves by 5 grid points in a step; with friction use time.step: "
        "0.002, or adaptive"
    ]


def test_the_period_of_an_oscillation_is_a_time():
    drive = {"kind": "oscillation", "displacement": 1e-5}
    law = {
        "interface": {"law": "coulomb", "coefficient": 0.4}, "units": UNITS, "halfspace.shear_modulus": 8e10,
    }  # fmt: skip
    trajectory = {"control": "load", "load": 1e4, "ramp_time": 1.0, "tangential": drive}
    time = {"end": 4.0, "step": 0.01}
    found = of(SI | law | {"halfspace.shear_modulus": 8e10, "trajectory": trajectory, "time": time})
    assert found == ["left at defaults, in the units given: trajectory.tangential.period = 1 s"]
