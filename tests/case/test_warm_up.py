"""Warming up compiles everything that a case may come to: later, all ranks would compile at once."""

import math
import subprocess
import sys

import pytest

from gfmdlayer.case.case import smallest_equivalent_case
from gfmdlayer.case.model import simulate
from gfmdlayer.config import Config
from gfmdlayer.indentation import model as isolated
from gfmdlayer.study.cost import kind
from tests.recordings import Kept

PROGRAM = """
import sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from gfmdlayer.case.case import Case
from gfmdlayer.config import Config
from gfmdlayer.case.model import ConvergenceError, NoRecorder

def kernels():
    modules = [module for name, module in sys.modules.items() if name.startswith("gfmdlayer")]
    return {id(kernel): kernel for module in modules for kernel in vars(module).values()
            if isinstance(kernel, Dispatcher)}.values()

def name(kernel):
    return kernel.py_func.__module__ + "." + kernel.py_func.__qualname__

def compiled():
    # An inner kernel is compiled as a part of those that call it.
    return {name(kernel): len(kernel.overloads) for kernel in kernels()
            if not kernel.targetoptions.get("no_cpython_wrapper")}

RARE = tuple("gfmdlayer.contact." + name for name in (
    "bounded.", "active_set.loop.set_guess",
    "pressure_form.satisfies_kkt",
))
HANDED_OVER = (
    "gfmdlayer.contact.active_set.loop.", "gfmdlayer.contact.pressure_form.",
    "gfmdlayer.contact.residual.",
)
SHORT = {"grid.points": 512, "time": {"end": 0.2, "step": 0.05}, "trajectory.depth": 0.003}
ADAPTIVE = {"time": {"end": 0.05, "step": "adaptive"}}
CASES = [
    SHORT,
    SHORT | ADAPTIVE | {"output.histograms.gap": {"max": 0.1}},
    SHORT | {"trajectory.velocity": 0.2},
    SHORT | {"solver.method": "conjugate_gradient"},
    SHORT | {"solver.method": "nested_gradient"},
    SHORT | {"solver.method": "fire"},
]
def model(config, stepwise):
    case = Case(config)
    case.stepwise = stepwise
    return case

for values in CASES:
    config = Config(name="warm").with_values(values)
    for stepwise in (False, True):
        model(config, stepwise).warm_up()
        before = compiled()
        model(config, stepwise).run(NoRecorder())
        assert compiled() == before, (values, stepwise)
    # Too few iterations for a tolerance at the edge of rounding: every fallback is tried, by Python's loop.
    failing = config.with_values({"solver.tolerance": 1e-13, "solver.max_iterations": 8})
    try:
        model(failing, True).run(NoRecorder())
    except ConvergenceError:
        pass
    else:
        assert config.contact_solver.method in {"active_set", "nested_gradient"}
    late = {name for name, count in compiled().items() if count != before.get(name, 0)}
    # The last resort of the active set is compiled when it is needed, by one process.
    if config.contact_solver.method in {"active_set", "nested_gradient"}:
        late = {name for name in late if not name.startswith(RARE)}
    if config.contact_solver.method == "nested_gradient":  # as is the active set at a hand-over
        late = {name for name in late if not name.startswith(HANDED_OVER)}
    assert not late, (values, late)
# What stands inside other kernels has no cache: called from Python, each process would compile it anew.
assert not [name(kernel) for kernel in kernels() if kernel.targetoptions.get("inline") and kernel.overloads]
"""


def test_nothing_is_left_to_compile(tmp_path):
    subprocess.run([sys.executable, "-c", PROGRAM, str(tmp_path)], check=True)


@pytest.mark.parametrize(
    "values",
    [
        {"time": {"end": 1.0, "step": "adaptive", "tolerance": 1e-13}},
        {"time": {"end": 1e6, "step": 1e-6}},
        {"layer.thickness": 50e-6, "trajectory": {"control": "load", "load": 0.01}},
    ],
    ids=str,
)
def test_few_steps_are_enough_whatever_the_case(values):
    recording = Kept()
    simulate(smallest_equivalent_case(Config(name="warm").with_values(values)), recording)
    assert 3 <= len(recording.rows) < 200


# Times from 1e-7 to 1e-3 s, m and Pa: with these numbers a contact of a fixed size need not have a solution.
SI = {
    "units": {"length": "m", "stress": "Pa", "time": "s"},
    "grid.period": 1e-4,
    "layer": {
        "thickness": 1e-6,
        "poisson": 0.5,
        "material": {
            "model": "prony",
            "G0": 1e6,
            "branches": [{"G": 3e6, "tau": 1e-7}, {"G": 1e6, "tau": 1e-3}],
        },
    },
    "halfspace.shear_modulus": math.inf,
    "punch.radius": 1e-4,
    "trajectory": {"depth": 1e-8, "ramp_time": 1e-6},
    "time": {"end": 1e-5, "step": 1e-7},
    "solver.tolerance": 1e-8,
}
FRICTION = {"interface": {"law": "coulomb", "coefficient": 0.3}}
PULL = {"interface": {"law": "exponential", "work": 0.05, "range": 1e-8}}


@pytest.mark.parametrize(
    "laws",
    [
        {},
        FRICTION,
        PULL,
        {"interface": [FRICTION["interface"], PULL["interface"]]},
        {"interface": {"law": "hard_wall", "hardness": 1e4}},
        {"time": {"end": 1e-5, "step": "adaptive"}},
        {"time.integrator": "backward_euler"},
        {"halfspace": {"material": {"G0": 1e7, "Ginf": 1e9, "tau": 1e-5}}},
        {"counterbody": {"halfspace": {"shear_modulus": 1e8}}},
        {"trajectory.velocity": 1e-3},
    ],
    ids=str,
)
def test_no_number_of_a_user_enters_the_case_that_compiles(laws):
    config = Config(name="si").with_values(SI | laws)
    scaled = Config(name="si").with_values(
        SI | laws | {"punch.radius": 3e-4, "layer.thickness": 2e-5, "layer.material": {"tau": 1e-7}}
    )
    small = smallest_equivalent_case(config)
    assert small == smallest_equivalent_case(scaled)
    assert kind(small.with_values({"grid.points": config.grid.points})) == kind(config)
    recording = Kept()
    simulate(small, recording)
    assert 3 <= len(recording.rows) < 200


@pytest.mark.parametrize(
    ("values", "alike"),
    [
        ({"layer.thickness": 0.1, "solver.tolerance": 1e-7, "output.snapshots": [1.0]}, True),
        ({"grid.points": 128}, False),
        ({"solver.method": "fire"}, False),
        ({"solver": {"method": "fire", "inertia": "uniform"}}, False),
        ({"time.step": "adaptive"}, False),
        ({"trajectory.velocity": 0.1}, False),
        ({"trajectory": {"control": "load", "load": 0.1}}, False),
        ({"output.histograms.gap": {"max": 0.1}}, False),
    ],
    ids=str,
)
def test_cases_of_one_kind_are_warmed_up_and_costed_together(values, alike):
    config = Config(name="kinds", time={"step": 0.005})
    assert (kind(config) == kind(config.with_values(values))) is alike


@pytest.mark.parametrize("control", ["depth", "force"])
@pytest.mark.parametrize("scale", [1.0, 1e-6])
def test_no_number_of_an_isolated_contact_enters_the_one_that_compiles(control, scale):
    """It is small beside its layer: a contact thousands of times as wide takes gigabytes."""
    film = Config(name="film").with_values(
        {
            "grid.geometry": "axisymmetric",
            "grid.points": 64,
            "layer": {"thickness": 5 * scale, "material": {"G0": 1e3, "Ginf": 5e3, "tau": 0.1}},
            "halfspace.poisson": 0.4,
            "punch": {"shape": "sphere", "radius": 5e3},
            "trajectory": {"control": control, control: 1e-6 if control == "depth" else 1e-9},
            "time": {"end": 1e-3, "step": "adaptive", "tolerance": 1e-9},
        }
    )
    small = isolated.smallest_equivalent_case(film)
    other = {"layer.thickness": 2e-3, "layer.material.tau": 1e5, "punch.radius": 1.0, "time.end": 1e6}
    assert small == isolated.smallest_equivalent_case(film.with_values(other))
    recording = Kept()
    simulate(small, recording)
    assert 3 <= len(recording.rows) < 20
    widest = max(row["contact_radius"] for row in recording.rows)
    assert 0 < widest < small.solid.thicknesses[0]
    assert small.trajectory.control == control
