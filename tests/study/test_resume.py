"""A run that is stopped and resumed gives the bits of one that never was."""

from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from gfmdlayer.case import march
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate
from gfmdlayer.config import Config
from gfmdlayer.results.recording import Recording
from tests.recordings import InParts, bits_of

SMALL = {"grid.points": 64, "time.end": 1.6, "trajectory.ramp_time": 0.8, "output.snapshots": [0.4, 0.8, 1.6]}
STEPS = {
    "paper": {"time.integrator": "backward_euler", "time.step": 0.1},
    "exponential": {"time.integrator": "exponential", "time.step": 0.1},
    "adaptive": {"time.step": "adaptive", "time.tolerance": 1e-3},
}
PRONY = {"model": "prony", "G0": 1.0, "branches": [{"G": 6.0, "tau": 0.1}, {"G": 3.0, "tau": 1.0}]}
BODIES = {
    "depth": {},
    "load": {"trajectory": {"control": "load", "load": 0.05, "ramp_time": 0.8}},
    "prony": {"layer.material": PRONY},
    "compressible": {"layer.poisson": 0.3, "halfspace.shear_modulus": float("inf")},
    "sliding": {"trajectory.velocity": 0.3},
    "steady": {"trajectory.velocity": 2.0, "time.steady": 1e-2, "time.end": 4.0},
    "surface": {"grid.points": [16, 8], "grid.period": [1.0, 0.5]},
}
PAIR = {"layer": {"thickness": 0.1, "material": PRONY}, "halfspace": {"shear_modulus": 5.0}}
BODIES |= {"pair": {"counterbody": PAIR}, "sliding pair": {"counterbody": PAIR, "trajectory.velocity": 0.3}}
METHODS = ("fire", "active_set", "conjugate_gradient")
RUNS = [
    (body, steps, method)
    for body, steps, method in product(BODIES, STEPS, METHODS)
    if "pair" not in body or method == "active_set"
    if steps != "paper" or "trajectory.velocity" not in BODIES[body]  # which does not follow a moving punch
]
# A film that jumps into contact, is pulled out of it, and comes again under a load.
ADHESIVE = {
    "layer": {"thickness": 0.1, "poisson": 0.3}, "halfspace.shear_modulus": float("inf"),
    "interface": {"law": "exponential", "work": 0.1, "range": 5e-3}, "time.end": 3.0, "output.snapshots": [],
}  # fmt: skip
BODIES |= {
    "adhesive": ADHESIVE
    | {"trajectory": {"kind": "approach_retract", "start": -0.05, "final": -0.12, "retract_speed": 0.1}},
    "pulled off": ADHESIVE
    | {
        "trajectory": {
            "control": "load",
            "kind": "approach_retract",
            "load": 0.1,
            "retract_speed": 2.0,
            "final": -1.0,
            "cycles": 2,
        }
    },
}
BODIES["yielding"] = {
    "interface": {"law": "hard_wall", "hardness": 0.3},
    "trajectory": {"control": "load", "kind": "approach_retract", "load": 0.1, "cycles": 2},
    "time.end": 4.0,
}
FRICTION = {
    "interface": {"law": "coulomb", "coefficient": 0.3},
    "trajectory": {
        "control": "load",
        "load": 0.05,
        "ramp_time": 0.8,
        "tangential": {"kind": "oscillation", "displacement": 2e-3, "start": 0.4, "period": 1.2},
    },
}
BODIES |= {
    "frictional": FRICTION,
    "rolling": FRICTION
    | {"trajectory": {"control": "load", "load": 0.05, "velocity": 0.05, "creepage": 0.01}},
}
OTHER = {"counterbody": PAIR, "layer.poisson": 0.4}
BODIES |= {
    "frictional pair": BODIES["frictional"] | OTHER,
    "rolling pair": BODIES["rolling"] | OTHER,
    "pair that slides with friction": BODIES["rolling"]
    | OTHER
    | {"trajectory": {"control": "load", "load": 0.05, "velocity": 0.05}},
}
RUNS += [(body, steps, "auto") for body in list(BODIES)[-3:] for steps in ("adaptive", "exponential")]
BODIES["in a window"] = FRICTION | {"grid.points": 256, "trajectory.load": 1e-3}
BODIES["without friction"] = FRICTION | {"interface": {"law": "coulomb", "coefficient": 0.0}}
RUNS += [(body, steps, "auto") for body in ("frictional", "rolling") for steps in ("adaptive", "exponential")]
BODIES["frictional adhesive"] = FRICTION | {
    "interface": [
        {"law": "coulomb", "coefficient": 0.3},
        {"law": "exponential", "work": 1e-3, "range": 0.02},
    ],
    "layer.poisson": 0.4,
}
RUNS += [("frictional adhesive", steps, "auto") for steps in ("adaptive", "exponential")]
BODIES["frictional yielding"] = FRICTION | {
    "interface": [{"law": "coulomb", "coefficient": 0.3}, {"law": "hard_wall", "hardness": 0.2}],
    "layer.poisson": 0.4,
}
RUNS += [("frictional yielding", steps, "auto") for steps in ("adaptive", "exponential")]
RUNS += [("in a window", "adaptive", "auto"), ("in a window", "exponential", "auto")]
RUNS += [("without friction", "exponential", "auto")]
RUNS += [("yielding", "adaptive", "nested_gradient"), ("yielding", "exponential", "nested_gradient")]
RUNS += [("adhesive", "adaptive", "newton"), ("adhesive", "exponential", "newton")]
RUNS += [("pulled off", "adaptive", "newton")]
WLF = {"law": "wlf", "C1": 17.44, "C2": 51.6, "reference": 20.0}
ARRHENIUS = {"law": "arrhenius", "activation_energy": 8e4, "reference": 20.0}
SOFT = {"model": "zener", "G0": 1.0, "Ginf": 4.0, "tau": 0.5, "shift": ARRHENIUS}
BODIES["heated"] = {
    "layers": [
        {"thickness": 0.05, "poisson": 0.4, "material": PRONY | {"shift": WLF}},
        {"thickness": 0.2, "material": SOFT},
    ],
    "halfspace": {"poisson": 0.3, "shear_modulus": 20.0},
    "temperature": {"file": "rise.txt"},
}
BODIES["isolated"] = {
    "grid.points": [32, 32],
    "grid.period": 0.5,
    "grid.boundary": "isolated",
    "layer.thickness": 0.1,
    "halfspace.shear_modulus": 5.0,
    "punch.radius": 1.0,
    # The displacement is known within the reach of the largest contact.
    "trajectory": {"control": "force", "kind": "approach_retract", "force": 0.01, "approach_speed": 0.0125}
    | {"retract_speed": 0.0125, "final": 0.001},
}
BODIES["isolated frictional"] = FRICTION | {
    "grid.points": [32, 32],
    "grid.period": 0.5,
    "grid.boundary": "isolated",
    "layer.thickness": 0.1,
    "layer.poisson": 0.4,
    "halfspace.shear_modulus": 5.0,
    "punch.radius": 1.0,
    "trajectory": {"control": "force", "force": 0.02, "ramp_time": 0.8}
    | {"tangential": {"kind": "oscillation", "displacement": 1e-3, "start": 0.4, "period": 1.2}},
}
BODIES["isolated line"] = FRICTION | {
    "grid.boundary": "isolated",
    "grid.datum": 2.0,
    "halfspace.shear_modulus": 5.0,
    "trajectory": {"control": "force", "force": 0.05, "ramp_time": 0.8}
    | {"tangential": {"kind": "oscillation", "displacement": 2e-3, "start": 0.4, "period": 1.2}},
}
RUNS += [
    (f"isolated {body}", steps, "auto")
    for body in ("frictional", "line")
    for steps in ("adaptive", "exponential")
]
RUNS += [("heated", "adaptive", "active_set"), ("heated", "exponential", "active_set")]
RUNS += [("isolated", "paper", "auto"), ("isolated", "exponential", "auto")]


@pytest.fixture(autouse=True)
def one_attempt_at_a_time(monkeypatch):
    """The compiled loop comes back after each attempt."""
    monkeypatch.setattr(march, "ATTEMPTS", 1)


@pytest.mark.parametrize(("body", "steps", "method"), RUNS)
def test_a_run_in_parts_has_the_bits_of_one_without_a_stop(body, steps, method):
    Path("rise.txt").write_text("0 18\n0.4 18\n1.2 30\n2 30\n")
    config = Config(name="parts").with_values(SMALL | {"solver.method": method} | STEPS[steps] | BODIES[body])
    whole = Recording()
    simulate(config, whole)
    rng = np.random.default_rng([ord(letter) for letter in body + steps + method])
    parts = InParts(partial(simulate, config), iter(lambda: int(rng.integers(1, 7)), None))
    assert parts.parts > 1
    assert bits_of(parts.recording) == bits_of(whole)


@pytest.mark.parametrize(("steps", "method"), [("adaptive", "fire"), *((s, "active_set") for s in STEPS)])
def test_a_run_that_is_stopped_at_every_attempt_does_the_same_work(steps, method):
    # Between a rejected attempt and the next one there is more to remember than between accepted steps.
    config = Config(name="parts").with_values(
        SMALL | STEPS[steps] | {"solver.method": method, "layer.material.tau": 0.05}
    )
    whole = Recording()
    simulate(config, whole)
    assert bool(whole["rejected"].any()) == (steps == "adaptive")
    assert bits_of(InParts(partial(simulate, config), iter(lambda: 1, None)).recording) == bits_of(whole)


def test_a_state_of_another_body_or_grid_is_refused_in_words():
    case = Case(Config(name="parts").with_values(SMALL))
    state = case.kept.state()
    with pytest.raises(ValueError, match="has no local_stretch of Modes"):
        case.kept.restore({key: value for key, value in state.items() if "local_stretch" not in key})
    with pytest.raises(ValueError, match=r"u of Modes has the shape \(1,\); must have \(33,\)"):
        case.kept.restore(state | {"history.u": np.zeros(1)})
