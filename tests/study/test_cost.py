"""Estimated cost of a case against the measured one, and seconds learnt from finished cases."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gfmdlayer.case.footprint import pair_seconds
from gfmdlayer.case.model import simulate
from gfmdlayer.config import Config, load
from gfmdlayer.contact.solvers import SOLVERS
from gfmdlayer.study.cases import Cases, cases
from gfmdlayer.study.cost import CostModel, estimate, expected_seconds
from tests.recordings import case_file

SWEEP = {
    "solver.method": ["fire", "conjugate_gradient", "active_set"],
    "layer.thickness": [0.02, 0.1, 0.3, math.inf],
}


def case_with(values):
    return Config(name="x").with_values(values)


def sweep():
    return [case.config for case in cases(Config(name="x", sweep=SWEEP))]


def work(config):
    return estimate(config).work


def seconds(config):
    """Seconds that differ from the estimated work by a factor of the solver."""
    return estimate(config).work * {"fire": 3e-8, "conjugate_gradient": 1e-8}.get(config.solver.method, 2e-7)


def test_seconds_per_work_are_learnt_for_each_kind_of_case():
    every = sweep()
    model = CostModel(((config, seconds(config)) for config in every[::3]), work)
    for config in every:
        assert model.seconds(config) == pytest.approx(seconds(config), rel=1e-12)


def test_seconds_with_friction_are_known_from_finished_cases_only():
    with_friction = case_with({"interface": {"law": "coulomb", "coefficient": 0.3}})
    without = case_with({})
    assert CostModel().knows(without)
    assert not CostModel([(without, 1.0)]).knows(with_friction)
    assert CostModel([(with_friction, 1.0)]).knows(with_friction)


def test_one_disturbed_case_does_not_change_the_others():
    every = sweep()
    disturbed = ((config, seconds(config) * (50 if config is every[5] else 1)) for config in every)
    model = CostModel(disturbed, work)
    for config in every:
        assert model.seconds(config) == pytest.approx(seconds(config), rel=1e-12)


def test_a_kind_without_finished_cases_counts_as_a_typical_one():
    every = sweep()
    model = CostModel(((config, seconds(config)) for config in every if config.solver.method != "fire"), work)
    for config in every[:4]:
        assert 1e-8 <= model.seconds(config) / estimate(config).work <= 2e-7


def test_without_finished_cases_the_work_counts():
    sizes = [(256, 1.0), (1024, 8.0), (256, 8.0), (1024, 1.0)]
    every = [case_with({"grid.points": points, "time.end": end, "time.step": 0.005}) for points, end in sizes]
    found = [CostModel(expected=work).seconds(config) for config in every]
    assert sorted(found, reverse=True) == [found[place] for place in (1, 2, 3, 0)]


def test_a_solver_declares_its_cost():
    """FIRE with the same inertia for all modes needs more pairs, and more of them on finer grids."""
    fire = SOLVERS["fire"]
    weighted, uniform = ({"method": "fire", "inertia": name} for name in ("mass_weighted", "uniform"))
    assert fire.pairs_per_step(4096, weighted) == fire.pairs
    assert fire.pairs_per_step(4096, uniform) > fire.pairs
    assert fire.pairs_per_step(8192, uniform) > fire.pairs_per_step(4096, uniform)
    assert estimate(case_with({"solver": uniform})).pairs > estimate(case_with({"solver": weighted})).pairs


def test_seconds_are_read_from_complete_files_and_a_lost_file_is_passed_over(tmp_path):
    every, paths = [sweep()[0]] * 3, [tmp_path / f"{index}.h5" for index in range(3)]
    for path in paths[:2]:
        with case_file(path, {"x": np.arange(4.0)}, {"wall_seconds": 7.5}) as writer:
            writer.row(time=0.0)
    model = CostModel.of_files(dict(zip(paths, every, strict=True)))
    assert model.seconds(every[0]) == pytest.approx(7.5)


@pytest.mark.parametrize("rows", [0, 20, 100])
def test_adaptive_steps_are_counted_with_the_times_that_they_land_on(rows, run):
    values = {
        "grid.points": 256, "time.step": "adaptive", "time.end": 8.0, "solver": {"method": "active_set"},
    }  # fmt: skip
    if rows:
        values["output.times"] = 8.0 / rows
    taken = len(run(values).rows)
    # How many steps the free ones are depends on the case; that of the estimate is the default one.
    assert estimate(case_with(values)).steps == pytest.approx(taken, rel=0.25)


PRONY = {"model": "prony", "G0": 1.0, "branches": [{"G": 2.0, "tau": 10.0**k} for k in range(-3, 3)]}
LOAD = {"control": "load", "load": 0.05, "ramp_time": 1.0}
PULL = {"kind": "approach_retract", "start": -0.02, "final": -0.03}
ADAPTIVE = {
    "adhesive": {"interface": {"law": "exponential", "work": 2e-3, "range": 4e-3}, "trajectory": PULL},
    "pull": {"interface": {"law": "exponential", "work": 2e-3, "range": 4e-3},
             "trajectory": {"control": "load", "load": 0.05, "kind": "approach_retract", "final": -0.01}},
    "coarse": {"time.tolerance": 1e-3},
    "fine": {"time.tolerance": 1e-5},
    "slow ramp": {"layer.material.tau": 0.01},
    "fast ramp": {"layer.material.tau": 100.0},
    "long hold": {"time.end": 100.0},
    "weak": {"layer.material.Ginf": 1.2},
    "decades": {"layer.material": PRONY, "time.end": 100.0},
    "load": {"trajectory": LOAD},
    "rows": {"output.times": 0.1},
    "hard base": {"layer.thickness": 0.01, "halfspace.shear_modulus": math.inf},
    "surface": {"grid.points": [32, 32]},
    "sliding": {"trajectory.velocity": 0.3, "time.end": 2.0},
    "fast sliding": {"trajectory.velocity": 30.0},
    "steady": {"trajectory": {"control": "load", "load": 0.02, "velocity": 1.0}, "time.steady": 1e-4,
               "time.end": 500.0, "output.times": 5.0},
}  # fmt: skip
# Rows of depth and the time between them: tables in which kinks decide, and in which relaxation does.
TABLES = {"few": (5, 2.0), "many": (200, 0.02), "cycles": (30, 5.0)}


QUICK = sorted((Path(__file__).parents[2] / "configs").glob("*-quick.yaml"))
# All others are within a factor of two too; they take seconds.
SHORT = ("adhesive-pad", "afm-sphere", "electroadhesion", "figure2", "heated-layer", "sampling", "tread")


@pytest.mark.parametrize(
    "path",
    [pytest.param(each, marks=() if each.stem[:-6] in SHORT else pytest.mark.slow) for each in QUICK],
    ids=lambda path: path.stem,
)
def test_rows_of_the_quick_configurations_are_within_a_factor_of_two(path, recorder):
    """One case of each; nine in ten of all cases are, the first ones too."""
    case = next(iter(Cases(load(path))))
    run = recorder()
    simulate(case.config, run)
    assert 0.5 <= case.cost.steps / (len(run.rows) - 1) <= 2


@pytest.mark.parametrize(
    ("values", "rows"),
    [
        ({}, 64),
        ({"time.tolerance": 1e-2}, 64),  # for straight lines between the rows
        ({"time.tolerance": 1e-5}, 144),
        ({"output.times": 0.05}, 400),
    ],
)
def test_rows_of_isolated_indenters_are_within_a_factor_of_two(values, rows, recorder):
    """They go with the root of the tolerance, in quarters of a mesh that lands on the output times."""
    path = next(each for each in QUICK if each.stem == "afm-sphere-quick")
    config = load(path, {"sweep": None, **values})
    run = recorder()
    simulate(config, run)
    assert len(run.rows) - 1 == pytest.approx(rows, rel=0.3)
    assert 0.5 <= estimate(config).steps / (len(run.rows) - 1) <= 2


def within_three(estimated, counted):
    return counted / 3 < estimated < 3 * counted


@pytest.mark.parametrize("kind", ADAPTIVE)
def test_adaptive_steps_and_their_pairs_are_estimated_within_a_factor_of_three(kind, recorder):
    config = case_with({"grid.points": 256, "time.step": "adaptive"} | ADAPTIVE[kind])
    run = recorder()
    simulate(config, run)
    assert within_three(estimate(config).steps, len(run.rows) - 1)
    assert within_three(estimate(config).pairs, run["transforms"].sum())


@pytest.mark.parametrize("step", ["adaptive", 0.1])
@pytest.mark.parametrize("kind", TABLES)
def test_kinks_of_a_table_are_counted(kind, step, recorder, tmp_path):
    rows, spacing = TABLES[kind]
    depths = np.random.default_rng(5).uniform(0.001, 0.01, rows)
    np.savetxt(tmp_path / "depth.txt", np.c_[np.arange(rows) * spacing, np.r_[0.0, depths[1:]]])
    trajectory = {"kind": "table", "file": str(tmp_path / "depth.txt")}
    values = {"grid.points": 256, "time.step": step, "time.end": (rows - 1) * spacing}
    config = case_with(values | {"trajectory": trajectory})
    run = recorder()
    simulate(config, run)
    if step == "adaptive":
        assert within_three(estimate(config).steps, len(run.rows) - 1)
    else:
        assert estimate(config).steps == len(run.rows) - 1
    assert within_three(estimate(config).pairs, run["transforms"].sum())


def test_seconds_are_known_before_anything_has_run(tmp_path):
    """A pair is measured once and kept."""
    assert 0 < pair_seconds((256,), tmp_path) < 1
    (kept,) = tmp_path.iterdir()
    assert pair_seconds((256,), tmp_path) == float(kept.read_text())
    kept.write_text("0.125")
    assert pair_seconds((256,), tmp_path) == 0.125


def test_expected_seconds_grow_with_those_of_a_pair():
    config = case_with({"grid.points": 256})
    seconds = [expected_seconds(config, lambda _, pair=pair: pair) for pair in (0.0, 1e-3, 2e-3)]
    assert seconds[2] - seconds[1] == pytest.approx(seconds[1] - seconds[0])
    assert seconds[1] - seconds[0] > 1e-3 * estimate(config).pairs


def test_the_size_of_a_file_is_estimated(tmp_path):
    config = case_with({"grid.points": 1024, "time.end": 0.5, "time.step": 0.01, "output.snapshots": [0.5]})
    path = tmp_path / "case.h5"
    with case_file(path, {"x": np.arange(1024.0)}, {"config": config.dump()}) as writer:
        simulate(config, writer)
    assert estimate(config).storage == pytest.approx(path.stat().st_size, rel=0.25)


BRANCHES = [{"G": 1.0, "tau": 0.01 * 1.7**number} for number in range(16)]
# The system's account of a child's peak begins with what its parent held; that of its memory map does not.
PEAK = """
import json, re, sys
from pathlib import Path
from gfmdlayer.config import Config, load
from gfmdlayer.case.model import simulate
class Nothing:
    def row(self, **_): ...
    def snapshot(self, *_): ...
    def note(self, **_): ...
config = Config(name="x").with_values(json.loads(sys.argv[1]))
simulate(config, Nothing())
print(1024 * int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]))
"""


def peak_of(values):
    command = [sys.executable, "-c", PEAK, json.dumps(values)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@pytest.mark.parametrize(
    "values",
    [
        {"grid.points": 2**17, "layer.material": {"model": "prony", "G0": 1.0, "branches": BRANCHES},
         "solver": {"method": "conjugate_gradient", "tolerance": 1e-2}},
        {"grid.points": [256, 256], "solver": {"method": "active_set"}},
    ],
)  # fmt: skip
def test_memory_counts_branches_directions_and_the_solver(values, recorder):
    values = values | {"time.end": 0.02, "time.step": 0.02, "trajectory.ramp_time": 0.02}

    small = 256 if isinstance(values["grid.points"], int) else [16, 16]
    simulate(case_with(values | {"grid.points": small}), recorder())  # compiling needs more
    peak = peak_of(values)
    # Rounded up where the parts do not peak at the same time; what is left out is below a quarter.
    assert 0.75 * peak <= estimate(case_with(values)).memory <= 1.5 * peak


@pytest.mark.slow  # four steps on a million points
def test_memory_of_a_large_rough_surface_is_within_a_fifth():
    """After four steps the three last ones, from which the next is predicted, are all held."""
    rough = {"shape": "self_affine", "hurst": 0.8, "rms_slope": 0.1, "short_cutoff": 0.03, "seed": 1}
    load = {"control": "load", "load": 0.05, "ramp_time": 0.5}
    values = {"punch": rough, "trajectory": load, "layer.thickness": 0.2, "solver.tolerance": 1e-4}
    values |= {"time.step": 0.02, "time.end": 0.08}
    peak_of(values | {"grid.points": [128, 128]})  # compiling needs more
    values |= {"grid.points": [1024, 1024]}
    assert estimate(case_with(values)).memory == pytest.approx(peak_of(values), rel=0.2)
