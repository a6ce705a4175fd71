"""The compiled time loop has the bits of the loop in Python: random cases, whole and in parts."""

from pathlib import Path

import numpy as np
import pytest

from gfmdlayer.case import march
from gfmdlayer.case.case import Case
from gfmdlayer.config import Config
from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.observables import OBSERVABLES, Observable
from gfmdlayer.results.recording import Recording
from gfmdlayer.time_functions import RampHold
from tests.recordings import InParts, bits_of

LOOPS = {"compiled": False, "in Python": True}  # `stepwise` of a case
LINES = (64, 100, 256, 1000, 1024)
SURFACES = ([16, 16], [32, 16], [24, 40])
FEW, MANY = 12, 80  # of which 200 have been compared
LONGEST = 40  # attempts between two stops

# What few cases have.
FILM = {"layer": {"thickness": 0.1, "poisson": 0.3}, "halfspace.shear_modulus": np.inf}
CYCLE = {"trajectory": {"control": "load", "kind": "approach_retract", "load": 0.05, "retract_speed": 0.05}}
WLF = {"law": "wlf", "C1": 17.44, "C2": 51.6, "reference": 20.0}
RARE = {
    "hardness": CYCLE | {"interface": {"law": "hard_wall", "hardness": 0.3}},
    "adhesion": FILM | {"interface": {"law": "exponential", "work": 0.01, "range": 5e-3}},
    "friction": CYCLE | {"interface": {"law": "coulomb", "coefficient": 0.3}},
    "temperature": {
        "layer.material": {"model": "zener", "G0": 1.0, "Ginf": 9.0, "tau": 1.0, "shift": WLF},
        "temperature": {"value": 30.0},
    },
    "velocity that changes": {"trajectory.velocity_file": "velocity.txt"},
    "rolling with friction": {
        "trajectory": {"control": "load", "load": 0.05, "velocity": 0.1},
        "interface": {"law": "coulomb", "coefficient": 0.3},
    },
    "two bodies": {"counterbody": {"layer": {"thickness": 0.1}, "halfspace": {"shear_modulus": 5.0}}},
    "another solver": {"solver.method": "conjugate_gradient"},
    "rough surface": {
        "grid": {"points": [32, 32]},
        "punch": {"shape": "self_affine", "hurst": 0.8, "short_cutoff": 0.2, "seed": 1, "rms_slope": 0.1},
    },
    "below the surface": {"output": {"snapshots": [1.0], "inside": {"depths": [0.01, 0.1]}}},
    "distributions": {"output": {"patches": True, "histograms": {"gap": {"max": 0.1, "bins": 3}}}},
}


class Drawn:
    """Case number `number` of the random ones; a table of it is written to the folder."""

    def __init__(self, number, folder):
        self.file, self.rng = folder / "table.txt", np.random.default_rng([49, number])
        points = self.choose(*(SURFACES if self.rng.random() < 0.15 else LINES))
        tree = {"name": "drawn", "grid": {"points": points, "period": self.choose(1.0, 2.5)}}
        tree |= self.body() | {"punch": self.punch(tree["grid"]["period"])}
        self.parts = {"punch": self.rough(points)} if self.rng.random() < 0.1 else {}
        tree["time"] = self.time_axis(self.choose(0.5, 2.0, 8.0), "power_law" in str(tree))
        tree["output"] = self.output(tree["time"])
        case = Case(Config.model_validate(tree | {"trajectory": {"depth": 0.0}}), **self.parts)
        tree["trajectory"] = self.trajectory(case, tree["time"]["end"])
        if "backward_euler" not in tree["time"].values() and self.rng.random() < 0.4:
            self.move(tree)
        self.config = Config.model_validate(tree)

    def case(self):
        """Make the case, for one run."""
        return Case(self.config, **self.parts)

    def choose(self, *values):
        return values[self.rng.integers(len(values))]

    def decades(self, lowest, highest):
        return float(10 ** self.rng.uniform(lowest, highest))

    def body(self):
        base = {"shear_modulus": self.choose(np.inf, 0.5, 2.0, 10.0), "poisson": self.choose(0.5, 0.3)}
        if self.rng.random() < 0.2:
            return {"layers": [self.layer(), self.layer()], "halfspace": base}
        return {"layer": self.layer(), "halfspace": base}

    def layer(self):
        G0, tau = self.decades(-0.5, 0.5), self.decades(-1, 0.5)
        between = {"G0": G0, "Ginf": G0 * self.decades(0.2, 1.5), "tau": tau}
        zener = {"model": "zener", **between}
        count = self.rng.integers(1, 5)
        branches = [{"G": self.decades(-1, 1), "tau": self.decades(-2, 1)} for _ in range(count)]
        exponent = self.rng.uniform(0.2, 0.8)
        material = self.choose(
            zener,
            zener,
            {"model": "prony", "G0": G0, "branches": branches},
            {"model": "elastic", "G": G0},
            {"model": "fractional_zener", **between, "exponent": exponent},
            {"model": "power_law", "G": G0, "tau": tau, "exponent": exponent, "G0": self.choose(0.0, G0)},
        )
        thickness, poisson = self.decades(-1.7, -0.3), self.choose(0.5, 0.5, 0.49, 0.3)
        return {"thickness": thickness, "poisson": poisson, "material": material}

    def punch(self, period):
        slope = self.decades(-1, 0)
        parabola = {"shape": "parabola", "radius": period / (4 * slope)}
        wave = {"amplitude": 0.1 * slope * period, "wavelength": period / self.choose(1, 2)}
        rough = {"hurst": 0.8, "short_cutoff": period / 6, "seed": 1, "rms_slope": slope / 5}
        return self.choose(
            parabola,
            parabola,
            {"shape": "cylinder", "radius": period * self.rng.uniform(0.5, 2)},
            {"shape": "wedge", "slope": slope},
            {"shape": "flat", "width": 0.3 * period, "edge_radius": 0.2 * period},
            {"shape": "sinusoid", **wave},
            {"shape": "array", "counts": 2, "element": {"shape": "wedge", "slope": slope}},
            {"shape": "self_affine", **rough},
        )

    def rough(self, points):
        """Return heights as an array, which no shape describes."""
        walk = np.cumsum(self.rng.normal(size=points), axis=-1)
        walk -= np.linspace(0, 1, walk.shape[-1]) * walk[..., -1:]
        return (0.05 / np.ptp(walk) * (walk - walk.min())).ravel()

    def time_axis(self, end, steep):
        if self.rng.random() < 0.6:  # a law without a shortest time may take very many steps
            return {
                "end": end,
                "step": "adaptive",
                "tolerance": self.choose(1e-3, 1e-4, 1e-4 if steep else 1e-5),
            }
        integrator = self.choose("exponential", "exponential", "backward_euler")
        return {"end": end, "step": end / self.choose(20, 40), "integrator": integrator}

    def output(self, time):
        adaptive, end = time["step"] == "adaptive", time["end"]
        step = end / 20 if adaptive else time["step"]
        some = [step * count for count in sorted(set(self.rng.integers(1, 20, 3).tolist()))]
        rows = self.choose({}, {}, {"times": end / 10}, {"times": [end / 3, end / 2]}) if adaptive else {}
        return {"snapshots": self.choose([], [], some, some, "every")} | rows

    def trajectory(self, case, end):
        """Ramp and hold, cycles, or a table with corners; from shallow to full contact."""
        control = self.choose("depth", "depth", "load", "force")
        most = float(case.punch.mean()) * self.choose(3e-3, 0.03, 0.3, 0.9) * self.rng.uniform(0.5, 1.0)
        if control != "depth":
            kappa, _ = case.contact.history.terms(0.0)
            most *= float(kappa[kappa > 0].min()) * self.choose(0.3, 1.0, 3.0)
        if control == "force":
            most *= float(np.prod(case.grid.period))
        kind = self.choose("ramp_hold", "approach_retract", "table")
        drive = {"control": control, "kind": kind}
        if kind == "ramp_hold":
            return drive | {control: most, "ramp_time": end * self.choose(0.2, 0.5, 1.5)}
        if kind == "table":
            return drive | {"file": self.table(most, end)}
        begins_late = control == "depth" and self.rng.random() < 0.3
        drive |= {control: most, "start": -most if begins_late else 0.0, "final": self.choose(0.0, most / 4)}
        drive |= {"approach_speed": self.choose(3, 6) * most / end, "dwell": self.choose(0.0, end / 8)}
        return drive | {"cycles": self.choose(1, 2)}

    def move(self, tree):
        """Let the punch move; some runs end in a steady state."""
        velocity = self.choose(1, -1) * self.decades(-1.5, 1.5) * tree["grid"]["period"] / tree["time"]["end"]
        tree["trajectory"]["velocity"] = velocity
        if tree["time"]["step"] == "adaptive" and self.rng.random() < 0.5:
            tree["time"]["steady"] = self.choose(1e-3, 0.1)

    def table(self, most, end):
        times = np.linspace(0, end, int(self.rng.integers(3, 6)))
        if self.rng.random() < 0.4:  # jumps
            times = np.sort(np.append(times, times[1:-1] + 1e-3 * end))
        values = most * self.rng.choice([0.0, 1e-3, 0.3, 0.7, 1.0], times.size)
        values[0] *= self.choose(0.0, 1.0)
        np.savetxt(self.file, np.column_stack((times, values)))
        return str(self.file)


def run(case, loop, recorder, progress=None, resume=None):
    """Run a case; return its warnings."""
    case.stepwise = LOOPS[loop]
    return case.run(recorder, progress, resume)


def differences(one, other):
    """Name the columns that differ with the first such row, or the parts of the bits."""
    named = []
    for name in sorted(one.widths.keys() | other.widths.keys()):
        a, b = (each[name] if name in each.widths else np.empty(0) for each in (one, other))
        if a.tobytes() != b.tobytes():
            rows = min(len(a), len(b))
            named.append((name, len(a), len(b), int(np.argmax(a[:rows] != b[:rows])) if rows else 0))
    parts = zip(("columns", "times", "fields", "noted"), bits_of(one), bits_of(other), strict=True)
    return named or [part for part, a, b in parts if a != b]


def must_agree(make, seed, monkeypatch):
    """Run a case on both loops, and in parts on one or the other, which stop after some attempts."""
    rng = np.random.default_rng(seed)
    whole, endings = {loop: Recording() for loop in LOOPS}, {}
    for loop, recording in whole.items():
        endings[loop] = run(make(), loop, recording)
    assert whole["compiled"].count > 1
    assert differences(*whole.values()) == []
    assert endings["compiled"] == endings["in Python"]

    def part(recorder, progress, resume):
        monkeypatch.setattr(march, "ATTEMPTS", int(rng.integers(1, LONGEST)))
        ended.append(run(make(), str(rng.choice([*LOOPS])), recorder, progress, resume))

    ended = []
    parts = InParts(part, iter(lambda: int(rng.choice([1, 2, LONGEST])), None))
    assert differences(parts.recording, whole["in Python"]) == []
    assert ended == [endings["in Python"]]


@pytest.mark.parametrize("number", range(FEW))
def test_a_random_case_has_the_same_bits_on_both_loops(number, tmp_path, monkeypatch):
    must_agree(Drawn(number, tmp_path).case, number, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(FEW, MANY))
def test_many_random_cases_have_the_same_bits_on_both_loops(number, tmp_path, monkeypatch):
    must_agree(Drawn(number, tmp_path).case, number, monkeypatch)


@pytest.mark.parametrize("name", RARE)
def test_a_rare_case_has_the_same_bits_on_both_loops(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("velocity.txt").write_text("0 0.1\n1 0.3\n2 0.2\n")
    coarse = {"grid.points": 64, "time": {"end": 2.0, "step": "adaptive", "tolerance": 1e-2}}
    config = Config(name="rare").with_values(coarse | RARE[name])
    assert not suits(Case(config))
    must_agree(lambda: Case(config), 0, monkeypatch)


class HalfRamp(RampHold):
    """A drive of the user's own."""

    def __call__(self, time):
        return 0.5 * super().__call__(time)


class Ender(Observable):
    """Ends a run, and has no column."""

    @classmethod
    def columns(cls, _config):
        return ()

    def measure(self, step):
        self.finished = step.time >= 0.5
        return {}


@pytest.mark.parametrize("what", ["drive", "solver", "observable"])
def test_parts_of_ones_own_are_left_to_python(what, monkeypatch):
    config = Config(name="own").with_values({"grid.points": 64, "time.step": 0.1})
    if what == "observable":
        monkeypatch.setitem(OBSERVABLES, "ender", Ender)

    def make():
        if what == "drive":
            return Case(config, trajectory=HalfRamp(0.01, 1.0))
        transforms = Case(config).transforms
        own = {"solver": ActiveSet(transforms, rounds=1)} if what == "solver" else {}
        return Case(config, transforms=transforms, **own)

    must_agree(make, 0, monkeypatch)


def test_a_recorder_with_rows_of_its_own_gets_each():
    class Rows(list):
        def row(self, **values):
            self.append(values)

        def snapshot(self, time, fields): ...

        def note(self, **attributes): ...

    class Counting(Recording):
        calls = 0

        def row(self, **values):
            self.calls += 1
            super().row(**values)

    config = Config(name="own").with_values({"grid.points": 64, "time.step": 0.1})
    rows, counting, times = Rows(), Counting(), []
    Case(config).run(rows)
    Case(config).run(counting)
    assert len(rows) == counting.calls == counting.count > 1
    Case(config.with_values({"time": {"end": 1.0, "step": "adaptive"}})).run(Recording(), times.append)
    assert times[-1] == 1.0


def suits(case):
    return march.March.suits(case.contact, case.observables)


def test_most_random_cases_take_the_compiled_loop(tmp_path):
    drawn = [Drawn(number, tmp_path) for number in range(FEW)]
    taken = [case for case in drawn if suits(case.case())]
    moving = [case.config.time.steady for case in taken if case.config.trajectory.moves]
    assert len(taken) > 0.8 * FEW
    assert len(moving) >= 3
    assert any(moving)


@pytest.mark.parametrize("velocity", [0.03, 3.0])
def test_rolling_settles_at_the_same_step_of_both_loops(velocity, monkeypatch):
    drive = {"control": "load", "load": 0.02, "velocity": velocity}
    time = {"end": 500.0, "step": "adaptive", "steady": 1e-2, "tolerance": 1e-3}
    punch = {"shape": "cylinder", "radius": 0.5}
    config = Config(name="rolling", grid={"points": 128}, punch=punch, trajectory=drive, time=time)
    recording = Recording()
    run(Case(config), "compiled", recording)
    assert bool(recording.noted["settled"])
    assert recording["time"][-1] < 500.0
    must_agree(lambda: Case(config), 1, monkeypatch)
