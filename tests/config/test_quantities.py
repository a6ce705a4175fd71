"""Numbers with units, and words for times: converted into the units of the configuration, or refused."""

import itertools
import random
from fractions import Fraction
from pathlib import Path

import h5py
import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.cli import main
from gfmdlayer.config import digest
from gfmdlayer.config.reader import from_python
from gfmdlayer.config.sweeps import combinations
from gfmdlayer.results.stored import document
from gfmdlayer.validation import quantities
from tests.config.reading import problems, read

# Sizes in SI by definition, written down here once more.
LENGTHS = {"m": "1", "mm": "1e-3", "um": "1e-6", "µm": "1e-6", "nm": "1e-9", "cm": "1e-2", "in": "0.0254"}
STRESSES = {
    "Pa": "1",
    "kPa": "1e3",
    "MPa": "1e6",
    "GPa": "1e9",
    "N/mm^2": "1e6",
    "N/mm²": "1e6",
    "bar": "1e5",
}
TIMES = {"s": "1", "ms": "1e-3", "µs": "1e-6", "min": "60", "h": "3600", "d": "86400", "hours": "3600"}
SPEEDS = {"m/s": "1", "mm/s": "1e-3", "um / s": "1e-6", "mm s^-1": "1e-3"}
WORKS = {"J/m^2": "1", "mJ/m^2": "1e-3", "N/m": "1", "mN/m": "1e-3", "Pa m": "1"}
FORCES_OF_A_LINE = {"N/m": "1", "kN/m": "1e3", "N/mm": "1e3"}
KEYS = {
    "layer.thickness": (LENGTHS, "length"),
    "punch.radius": (LENGTHS, "length"),
    "trajectory.depth": (LENGTHS, "length"),
    "layer.material.tau": (TIMES, "time"),
    "time.end": (TIMES, "time"),
    "halfspace.shear_modulus": (STRESSES, "pressure"),
    "trajectory.velocity": (SPEEDS, "length/time"),
    "interface.work": (WORKS, "pressure length"),
    "trajectory.force": (FORCES_OF_A_LINE, "force / length"),
}
POWERS = {  # of length, stress and time
    "length": (1, 0, 0), "time": (0, 0, 1), "pressure": (0, 1, 0), "length/time": (1, 0, -1),
    "pressure length": (1, 1, 0), "force / length": (1, 1, 0),
}  # fmt: skip
SI = {"length": "mm", "stress": "MPa", "time": "s"}


def with_key(key, value, units):
    """Return a configuration with one key; all others go with any of its values."""
    data = {"name": "a", "units": units, "time": {"step": "adaptive"}, "grid": {"points": 64}}
    if key == "interface.work":
        return data | {"interface": {"law": "exponential", "work": value, "range": 1.0}}
    if key == "trajectory.force":
        return data | {"trajectory": {"control": "force", "force": value}}
    if key == "time.end":
        return data | {"time": {"step": "adaptive", "end": value}}
    *above, last = key.split(".")
    for part in reversed([*above[1:], last]):
        value = {part: value}
    return data | {above[0]: value}


def value_of(config, key):
    for part in key.split("."):
        config = getattr(config, part)
    return config


def drawn(number):
    """Return random quantities: key, units of the configuration, text, and the number it is or None."""
    dice = random.Random(number)
    key, (units, dimension) = dice.choice(list(KEYS.items()))
    own = {
        "length": dice.choice(["m", "mm", "um", "in"]),
        "stress": dice.choice(["Pa", "MPa", "N/mm^2", "bar"]),
        "time": dice.choice(["s", "ms", "min", "h"]),
    }
    digits = dice.choice(["1", "0.5", "2.5e1", "30", ".75", "7e-1", "+3.", "12.25"])
    space = dice.choice(["", " ", "  "])
    if dice.random() < 0.3:  # a unit of another dimension
        others = [each for each, powers in POWERS.items() if powers != POWERS[dimension]]
        wrong = dice.choice([each for each, (_, other) in KEYS.items() if other in others])
        symbol = dice.choice(list(KEYS[wrong][0]))
        return key, own, f"{digits}{space}{symbol}", symbol, None
    symbol = dice.choice(list(units))
    sizes = (
        Fraction(table[own[name]])
        for table, name in ((LENGTHS, "length"), (STRESSES, "stress"), (TIMES, "time"))
    )
    value = Fraction(digits.rstrip(".")) * Fraction(units[symbol])
    for size, power in zip(sizes, POWERS[dimension], strict=True):
        value /= size**power
    return key, own, f"{digits}{space}{symbol}", symbol, float(value)


@pytest.mark.parametrize("first", range(0, 200, 20))
def test_random_quantities_are_the_exact_number_or_refused(first):
    """The number is the nearest to the exact one, so that it is that of a user who converts by hand."""
    for number in range(first, first + 20):
        key, units, text, symbol, expected = drawn(number)
        if expected is not None:
            config = gfmdlayer.Config(**with_key(key, text, units))
            assert value_of(config, key) == expected, (text, units)
            assert digest(config) == digest(gfmdlayer.Config(**with_key(key, expected, units)))
            continue
        with pytest.raises(gfmdlayer.ConfigError) as error:
            gfmdlayer.Config(**with_key(key, text, units))
        (message,) = error.value.problems
        assert message.startswith(
            f"{key}: got the text {text!r}; {symbol!r} is no unit of {KEYS[key][1]}; must be"
        )


@pytest.mark.parametrize(
    ("key", "text", "expected"),
    [
        ("temperature.value", "300 K", 26.85),
        ("temperature.value", "25 °C", 25.0),
        ("temperature.value", "77 degF", 25.0),
        ("layer.material.shift.C2", "51.6 K", 51.6),
        ("layer.material.shift.reference", "293.15 K", 20.0),
        ("interface.voltage", "2 kV", 2000.0),
        ("interface.insulation", "10 um", 0.01),
        ("interface.insulation.0.thickness", "10 um", 0.01),
        ("output.stiffness.frequencies.0", "120 rpm", 2.0),
        ("output.stiffness.frequencies.0", "5 kHz", 5000.0),
        ("output.stiffness.frequencies.0", f"{2 * 3.141592653589793!r} rad/s", 1.0),
        ("output.stiffness.frequencies.0", "3 rev/s", 3.0),
        ("trajectory.creepage.spin", "0.5 rad/m", 5e-4),
        ("trajectory.creepage.spin", "0.5 1/m", 5e-4),
        ("output.conductance.body.resistivity", "1.7e-8 Ω·m", 1.7e-5),
        ("output.histograms.pressure.max", "2 bar", 0.2),
        ("output.histograms.gap.max", "2 um", 2e-3),
        ("grid.period.1", "1 cm", 10.0),
        ("punch.radius.0", "1 m", 1000.0),
    ],
)  # fmt: skip
def test_other_dimensions_and_places_in_lists(key, text, expected):
    shift = {"law": "wlf", "C1": 17.4, "C2": 51.6, "reference": 20.0}
    data = {
        "name": "a", "units": SI, "grid": {"points": [16, 16], "period": [20.0, 20.0]},
        "punch": {"radius": [50.0, 50.0]}, "time": {"step": "adaptive"},
        "layer": {"thickness": 1.0, "material": {"shift": shift}}, "temperature": {"value": 20.0},
        "output": {"histograms": {"pressure": {"max": 1.0}, "gap": {"max": 1.0}},
                   "conductance": {"body": {"resistivity": 1.0}}},
    }  # fmt: skip
    if "voltage" in key or "insulation" in key:
        insulation = [{"thickness": 1.0, "permittivity": 1.0}] if key.endswith("thickness") else 1.0
        data["interface"] = {"law": "electrostatic", "voltage": 100.0, "insulation": insulation}
    if "spin" in key:
        data["interface"] = {"law": "coulomb", "coefficient": 0.5}
        data["trajectory"] = {"velocity": 1.0, "creepage": {"spin": 0.0}}
    if "frequencies" in key:
        data["output"] = {"stiffness": {"frequencies": [0.0]}}
    found = from_python(data, {key: text})
    if "insulation.0" in key:
        assert found.interface.insulation[0].thickness == expected
    else:
        value = found
        for part in key.split("."):
            value = value[int(part)] if part.isdigit() else getattr(value, part)
        # pi is rounded: the only conversion that is not exact.
        assert value == pytest.approx(expected, rel=1e-15 if "rad/s" in text else 0.0)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ("layer: {thickness: 5 furlong}", "'furlong' is no known unit; must be a number >= 0 or .inf, in mm"),
        ("halfspace: {shear_modulus: 5 mpa}", "'mpa' is no known unit, and may be mPa or MPa"),
        ('punch: {radius: "1,5 mm"}', "a comma may be a decimal mark or part thousands"),
        ('punch: {radius: "1,000 mm"}', "a comma may be a decimal mark or part thousands"),
        ("punch: {radius: -2 mm}", "got the text '-2 mm', which is -2; must be a number > 0"),
        ("punch: {radius: 1e300 km}", "the size must be from 1e-30 to 1e+30"),
        ("punch: {radius: 1e999 km}", "outside of the range of numbers"),
        ("punch: {radius: 1 mm 2 mm}", "'mm 2 mm' is no known unit"),
        ("trajectory: {control: force, force: 5 N}",
         "'N' is no unit of force / length; must be a number >= 0, finite, in N/mm"),
        ("trajectory: {control: load, load: 1, kind: approach_retract, approach_speed: 1 mm/s}",
         "'mm/s' is no unit of pressure/time; must be a number > 0, finite, in MPa/s"),
        ("layer: {material: {shift: {law: wlf, C1: 17, reference: 20, C2: 51 degC}}}",
         "'degC' may be a temperature or a difference; write a difference in K"),
        ("grid: {points: [16, 16]}\noutput: {stiffness: {frequencies: [2 1/s]}}",
         "'1/s' may be cycles or radians over time: write Hz, rpm or rad/s"),
        ("output: {stiffness: {frequencies: [1 Hz, 2 m]}}",
         "frequencies[1]: got the text '2 m'; 'm' is no unit"),
        ("trajectory: {tangential: {period: 2 Hz}}", "'Hz' is no unit of time"),
        ("sweep: {punch.radius: [1 m, 2 s]}",
         "sweep.punch.radius[1]: got the text '2 s'; 's' is no unit of length"),
        ("sweep: {punch.radius: {from: 1 s, to: 2 m, points: 3}}",
         "sweep.punch.radius.from: got the text '1 s'; 's' is no unit of length"),
        ("sweep: {sobol: {samples: 2, punch.radius: {from: 1 m, to: 2 mm}}}",
         "got 2.0 (2 mm); must be a number > from"),
        ("sweep: {punch.radius: [1 m, 100 cm]}", "twice; give each value once"),
    ],
)  # fmt: skip
def test_a_quantity_is_refused_with_key_unit_and_dimension(tmp_path, section, message):
    content = f"name: a\nunits: {{length: mm, stress: MPa, time: s}}\n{section}\n"
    found = problems(tmp_path, content)
    assert any(message in each for each in found), found


def test_without_units_only_what_needs_none_is_taken(tmp_path):
    (found,) = problems(tmp_path, "name: a\nlayer: {thickness: 0.5 mm}\n")
    assert "the configuration has no units; give units: {length: mm, stress: MPa, time: s}" in found
    pyramid = {"shape": "pyramid", "angle": "0.125 rev", "faces": 4}
    assert gfmdlayer.Config(name="a", grid={"points": [16, 16]}, punch=pyramid).punch.angle == 45.0
    with pytest.raises(gfmdlayer.ConfigError, match="a section by itself has no units"):
        gfmdlayer.Layer(thickness="0.5 mm")


def test_refused_units_are_the_only_problem(tmp_path):
    content = (
        "name: a\nunits: {length: mm, stress: MPa}\nlayer: {thickness: 5 um}\ntrajectory: {depth: 1 um}\n"
    )
    (found,) = problems(tmp_path, content)
    assert "units.time: missing" in found


def test_all_ways_into_a_configuration_are_one(tmp_path):
    units = "units: {length: mm, stress: MPa, time: s}\n"
    by_hand = read(tmp_path, f"name: a\n{units}layer: {{thickness: 0.2}}\n")
    in_text = read(tmp_path, f"name: a\n{units}layer: {{thickness: 200 um}}\n")
    option = read(tmp_path, f"name: a\n{units}", "layer.thickness=200 um")
    python = gfmdlayer.Config(name="a", units=SI, layer={"thickness": "200 um"})
    swept = read(tmp_path, f"name: a\n{units}sweep: {{layer.thickness: [200 um, 1 mm]}}\n")
    case = swept.with_values(combinations(swept.sweep)[0])
    assert len({digest(each) for each in (by_hand, in_text, option, python, case)}) == 1
    assert combinations(swept.sweep) == [{"layer.thickness": 0.2}, {"layer.thickness": 1.0}]
    spaced = {"from": "100 um", "to": "1 cm", "points": 3, "spacing": "log"}
    ranged = gfmdlayer.Config(name="a", units=SI, sweep={"layer.thickness": spaced})
    assert ranged.sweep["layer.thickness"] == [0.1, 1, 10]


def test_what_was_written_is_stored_and_means_the_same_in_other_units(tmp_path):
    content = (
        "name: a\nunits: {length: mm, stress: MPa, time: s}\nlayer: {thickness: 200 um}\n"
        "time: {end: 1 min, step: adaptive}\noutput: {snapshots: [peak, end]}\n"
        "sweep: {latin_hypercube: {samples: 2, punch.radius: {from: 1 cm, to: 1 m}}}\n"
    )
    config = read(tmp_path, content)
    stored = config.dump()
    for text in ('thickness: "200 um"', 'end: "1 min"', "snapshots: [peak, end]", 'from: "1 cm"'):
        assert text in stored
    again = read(tmp_path, stored)
    assert again.dump() == stored
    assert digest(again) == digest(config)
    metres = read(tmp_path, content, "units.length=m")
    assert metres.layer.thickness == 2e-4
    assert metres.sweep["latin_hypercube"]["punch.radius"]["from"] == 0.01


def test_a_force_is_converted_anew_where_the_cell_becomes_a_surface():
    line = gfmdlayer.Config(
        name="a", units=SI, grid={"points": 64}, trajectory={"control": "force", "force": "40 N/m"}
    )
    assert line.trajectory.force == 0.04
    with pytest.raises(gfmdlayer.ConfigError, match="'N/m' is no unit of force"):
        line.with_values({"grid.points": [16, 16]})


def test_a_material_file_has_its_own_units(tmp_path):
    (tmp_path / "rubber.yaml").write_text(
        "units: {length: m, stress: Pa, time: ms}\n"
        "layer: {material: {model: zener, G0: 1 MPa, Ginf: 5.0e+6, tau: 0.1 s}}\n"
    )
    config = read(
        tmp_path,
        "name: a\nunits: {length: mm, stress: MPa, time: min}\nlayer: {material: {file: rubber.yaml}}\n",
    )
    material = config.layer.material
    assert (material.G0, material.Ginf, material.tau) == pytest.approx((1.0, 5.0, 0.1 / 60), rel=1e-15)


def test_a_material_fitted_in_one_unit_is_used_in_another(tmp_path, monkeypatch):
    """G' and G'' of one Maxwell branch, given in kPa and rad/ms, in a configuration in MPa and minutes."""
    monkeypatch.chdir(tmp_path)
    rows = ["omega [rad/ms],G' [kPa],G'' [kPa]"]
    for omega in np.logspace(-3.0, 3.0, 40):
        cycles = 0.1 * omega  # tau = 0.1 ms
        storage, loss = (4e3 * cycles**power / (1 + cycles**2) for power in (2, 1))
        rows.append(f"{omega:.17g},{1e3 + storage:.17g},{loss:.17g}")
    Path("dma.csv").write_text("\n".join(rows))
    material = gfmdlayer.fit_material("dma.csv").material
    units = {"length": "mm", "stress": "MPa", "time": "min"}
    layer = gfmdlayer.Layer(thickness=1.0, material=material)
    for given in ({"material": material}, layer):
        law = gfmdlayer.Config(name="a", units=units, layer=given).layer.material
        ((modulus, time),) = law.maxwell_branches
        assert (law.relaxed, modulus, time) == pytest.approx((1.0, 4.0, 1e-4 / 60), rel=1e-6)
    with pytest.raises(gfmdlayer.ConfigError, match="the configuration has no units"):
        gfmdlayer.Config(name="a", layer=layer)


def test_a_body_of_ones_own_takes_units_by_its_words(tmp_path):
    (tmp_path / "bed.py").write_text(
        "from gfmdlayer import Solid\nfrom gfmdlayer.validation.fields import Positive\n\n"
        'class Bed(Solid):\n    tau: Positive = 1.0\n    """relaxation time: time"""\n\n'
        "    def stiffness(self, waves, s): ...\n    def spectrum(self, waves): ...\n"
    )
    config = read(
        tmp_path,
        "name: a\nunits: {length: mm, stress: MPa, time: s}\nbody: {file: bed.py, tau: 5 min}\n"
        "sweep: {body.tau: [1 min, 2 min]}\n",
    )
    assert config.body.tau == 300.0
    assert combinations(config.sweep) == [{"body.tau": 60.0}, {"body.tau": 120.0}]


def test_numbers_alone_ask_for_no_units(monkeypatch):
    """A configuration of numbers takes the time that it took before units were converted."""
    for name in ("number", "parts"):
        monkeypatch.setattr(quantities, name, None)
    config = gfmdlayer.Config(name="a", units=SI, layer={"thickness": 0.1}, sweep={"punch.radius": [1, 2]})
    assert config.with_values({"punch.radius": 2}).punch.radius == 2.0


def test_check_prints_what_was_written_and_what_is_taken(tmp_path, capsys):
    path = tmp_path / "a.yaml"
    path.write_text(
        "name: a\nunits: {length: mm, stress: MPa, time: s}\ngrid: {points: 64}\nlayer: {thickness: 200 um}\n"
        "time: {end: 2, step: adaptive}\ntrajectory: {depth: 0.001}\noutput: {snapshots: [peak, end]}\n"
        "sweep: {punch.radius: [1 cm, 2 cm]}\n"
    )
    assert main(["check", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    taken = [line.removeprefix("taken").strip() for line in lines if line.startswith("taken")]
    assert taken == [
        "layer.thickness = 200 um: 0.2 mm",
        "output.snapshots = peak, end: 1, 2 s",
        "sweep.punch.radius = 1 cm, 2 cm: 10, 20 mm",
    ]


def test_swept_quantities_are_numbers_along_which_results_lie(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("a.yaml").write_text(
        "name: a\nunits: {length: mm, stress: MPa, time: s}\ngrid: {points: 32, period: 20 mm}\n"
        "punch: {radius: 5 cm}\ntrajectory: {depth: 20 um}\ntime: {step: 0.5 s, end: 1 s}\n"
        "sweep: {layer.thickness: [100 um, 0.2 mm]}\n"
    )
    assert main(["run", "a.yaml"]) == 0
    with h5py.File("results/a/sweep.h5") as sweep:
        assert sweep["thickness"][:].tolist() == [0.1, 0.2]
    assert document(Path("results/a/config.yaml"))["sweep"] == {"layer.thickness": [0.1, 0.2]}


# --- times of the output ---

RUN = {"name": "a", "grid": {"points": 64}, "time": {"step": "adaptive", "end": 10.0}}


@pytest.mark.parametrize(
    ("trajectory", "peak"),
    [
        ({"ramp_time": 2.5}, 2.5),
        ({"kind": "approach_retract", "depth": 0.02, "approach_speed": 0.01, "dwell": 1.0, "cycles": 2}, 2.0),
        ({"control": "load", "load": 0.1, "ramp_time": 4.0}, 4.0),
    ],
)
def test_words_for_times_are_those_of_the_run(trajectory, peak):
    words = gfmdlayer.Config(**RUN, trajectory=trajectory, output={"snapshots": ["start", "peak", "end"]})
    times = gfmdlayer.Config(**RUN, trajectory=trajectory, output={"snapshots": [0.0, peak, 10.0]})
    assert words.output.snapshot_times == (0.0, peak, 10.0)
    assert digest(words) == digest(times)
    alone = gfmdlayer.Config(**RUN, trajectory=trajectory, output={"snapshots": "peak", "times": "end"})
    assert (alone.output.snapshot_times, alone.output.row_times) == ((peak,), (10.0,))


def test_times_by_a_formula_are_those_of_the_list():
    spaced = {"from": 0.01, "to": "end", "points": 4, "spacing": "log"}
    formula = gfmdlayer.Config(**RUN, output={"times": spaced, "snapshots": {**spaced, "spacing": "linear"}})
    assert formula.output.row_times == (0.01, 0.1, 1.0, 10.0)
    assert formula.output.snapshot_times == pytest.approx((0.01, 3.34, 6.67, 10.0), rel=1e-12)
    output = {"times": [0.01, 0.1, 1, 10], "snapshots": list(formula.output.snapshot_times)}
    assert digest(formula) == digest(gfmdlayer.Config(**RUN, output=output))


def test_times_follow_the_case_of_a_sweep():
    ends = gfmdlayer.Config(
        **RUN,
        output={"snapshots": ["peak"], "times": {"from": "start", "to": "end", "points": 3}},
        sweep={"time.end": [4.0, 8.0], "trajectory.ramp_time": [1.0, 2.0]},
    )
    cases = [ends.with_values(values) for values in combinations(ends.sweep)]
    assert [case.output.row_times for case in cases] == [(0.0, end / 2, end) for end in (4, 4, 8, 8)]
    assert [case.output.snapshot_times for case in cases] == [(1.0,), (2.0,)] * 2


def test_times_by_a_formula_may_be_swept():
    spaced = {"from": 1, "to": "end", "points": 3}
    sweep = {"output.times": [[1.0, 2.0], {**spaced, "points": 2}], "output.snapshots": ["end", ["peak"]]}
    config = gfmdlayer.Config(**RUN, output={"times": spaced}, sweep=sweep)
    cases = [config.with_values(values).output for values in combinations(config.sweep)]
    assert [case.row_times for case in cases] == [(1.0, 2.0)] * 2 + [(1.0, 10.0)] * 2
    assert [case.snapshot_times for case in cases] == [(10.0,), (1.0,)] * 2


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("{snapshots: [end, peak]}", "snapshots[1]: got 1.0 after 8.0; times must increase"),
        ("{snapshots: ends}",
         "one of start, peak, end, {from, to, points, spacing}, or the word every; did you mean 'end'"),
        ("{snapshots: {from: 1, to: 9, points: 3}}",
         "snapshots.to: got 9.0, past the end; must be a number <= time.end"),
        ("{times: {from: start, to: end, points: 3, spacing: log}}", "got log with from = 0.0 (start)"),
        ("{times: {from: start, to: end}}", "output.times.points: missing"),
        ("{times: {from: end, to: peak, points: 2}}", "got 1.0 (peak); must be a number > from = 8.0 (end)"),
        ("{inside: {points: 3, times: [peak]}, snapshots: end}",
         "times[0]: got 1.0; must be one of output.snapshots"),
    ],
)  # fmt: skip
def test_times_that_cannot_be_are_refused(tmp_path, output, message):
    found = problems(tmp_path, f"name: a\ntime: {{step: adaptive}}\noutput: {output}\n")
    assert any(message in each for each in found), found


def test_the_peak_of_a_table_is_asked_for(tmp_path):
    (tmp_path / "path.txt").write_text("0 0\n1 0.01\n")
    content = "name: a\ntrajectory: {kind: table, file: path.txt}\noutput: {snapshots: [peak]}\n"
    (found,) = problems(tmp_path, content)
    assert "output.snapshots[0]: got 'peak', which is in the table of trajectory.file" in found
    assert "give the time" in found


def test_a_refused_trajectory_is_the_only_problem(tmp_path):
    (found,) = problems(tmp_path, "name: a\ntrajectory: {ramp_time: -1}\noutput: {snapshots: [peak]}\n")
    assert "trajectory.ramp_time: got -1" in found


def test_a_run_has_its_rows_and_snapshots_there():
    data = {**RUN, "time": {"step": "adaptive", "end": 2.0}, "layer": {"thickness": 0.1}}
    spaced = {"from": 0.05, "to": "end", "points": 5, "spacing": "log"}
    found = gfmdlayer.run({**data, "output": {"times": spaced, "snapshots": ["start", "peak", "end"]}})
    assert found["snapshot"].values.tolist() == pytest.approx([0.0, 1.0, 2.0])
    times = found["time"].values
    for time in itertools.accumulate([0.05] + [40**0.25] * 4, lambda a, b: a * b):
        assert abs(times - time).min() < 1e-9
