"""Configurations that are accepted, and the messages for all others."""

from __future__ import annotations

import math
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from gfmdlayer.body.materials import Prony, Zener
from gfmdlayer.config import Config, ConfigError, digest, load, text
from gfmdlayer.execution.sweep import input_errors

CONFIGS = Path(__file__).parents[2] / "configs"


def write(folder: Path, content: str) -> Path:
    path = folder / "case.yaml"
    path.write_text(content, encoding="utf-8")
    return path


def problems(path: Path, *overrides: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load(path, overrides)
    return [problem.replace(f"{path.parent}/", "") for problem in caught.value.problems]


# --- what is refused: the text after "name: x", then place and key, then words of the message ---

WLF = "shift: {law: wlf, C1: 17.44, C2: 51, reference: 20}"
REFUSED = {
    "unknown key": (
        "gird: {}",
        "2:1: gird: unknown key",
        "allowed: name, units, grid,",
        "did you mean 'grid'?",
    ),
    "misspelt key": ("layer: {thicknes: 1}", "2:9: layer.thicknes: unknown key", "did you mean 'thickness'?"),
    "misspelt letter case": ("layer: {material: {ginf: 20}}", "2:20: layer.material.ginf:", "mean 'Ginf'?"),
    "dotted key": ("layer.thickness: 1", "2:1: layer.thickness:", "did you mean layer: {thickness: ...}?"),
    "key in the wrong section": ("thickness: 1", "2:1: thickness:", "did you mean 'layer.thickness'?"),
    "duplicate key": (
        "time: {end: 1, end: 2}",
        "2:16: time.end: duplicate key",
        "line 2; must be given once",
    ),
    "duplicate section": ("time: {end: 1}\ntime: {}", "3:1: time: duplicate key", "line 2"),
    "section that is a number": ("grid: 3", "2:7: grid: got 3", "must be a mapping"),
    "section that is empty": ("grid:", "2:6: grid: got nothing (null)", "must be a mapping"),
    "section that is a list": ("punch: [1]", "2:8: punch: got [1]", "must be a mapping"),
    "velocity not a number": (
        "trajectory: {velocity: fast}",
        "2:24: trajectory.velocity:",
        "a number, finite",
    ),
    "infinite velocity": ("trajectory: {velocity: .inf}", "2:24: trajectory.velocity: got .inf", "finite"),
    "velocity twice": (
        "trajectory: {velocity: 1, velocity_file: case.yaml}",
        "trajectory.velocity_file: given, but velocity is a number",
        "velocity be left out",
    ),
    "backward Euler with a moving punch": (
        "trajectory: {velocity: 1}\ntime: {integrator: backward_euler}",
        "3:20: time.integrator: got backward_euler with a moving punch",
        "must be exponential",
    ),
    "steady without motion": (
        "time: {steady: 0.1}",
        "2:16: time.steady: given, but the punch does not move",
        "trajectory.velocity be a number",
    ),
    "steady at rest": (
        "trajectory: {velocity: 0}\ntime: {steady: 0.1}",
        "3:16: time.steady: given, but the punch does not move",
        "must be left out",
    ),
    "steady zero": ("time: {steady: 0}", "2:16: time.steady: got 0", "a number > 0"),
    "too few points": ("grid: {points: 7}", "2:16: grid.points: got 7", "whole number >= 8"),
    "points with a fraction": ("grid: {points: 1024.5}", "2:16: grid.points: got 1024.5", "whole number"),
    "one bad count of two": ("grid: {points: [64, 2]}", "2:21: grid.points[1]: got 2", ">= 8"),
    "three directions": ("grid: {points: [8, 8, 8]}", "2:16: grid.points: got 3 values", "one, or two"),
    "no directions": ("grid: {points: []}", "2:16: grid.points: got 0 values", "one, or two"),
    "period zero": ("grid: {period: 0}", "2:16: grid.period: got 0", "number > 0"),
    "infinite period": ("grid: {period: .inf}", "2:16: grid.period: got .inf", "finite"),
    "two periods for one direction": (
        "grid: {period: [1, 2]}",
        "2:16: grid.period: got 2 lengths",
        "must be one",
    ),
    "negative thickness": ("layer: {thickness: -1}", "2:20: layer.thickness: got -1", ">= 0 or .inf"),
    "thickness not a number": ("layer: {thickness: .nan}", "2:20: layer.thickness: got .nan", ">= 0 or .inf"),
    "infinity as a word": ("layer: {thickness: inf}", "2:20: layer.thickness:", "infinity is written .inf"),
    "number in quotes": ("layer: {thickness: '0.1'}", "2:20: layer.thickness:", "mean 0.1, without quotes?"),
    "true for a number": ("layer: {thickness: true}", "2:20: layer.thickness: got true", "no numbers"),
    "no for a number": (
        "layer: {thickness: no}",
        "2:20: layer.thickness: got the text 'no'",
        "must be a number",
    ),
    "null for a number": ("layer: {thickness: }", "layer.thickness: got nothing (null)", "must be a number"),
    "list for a number": ("layer: {thickness: [1]}", "2:20: layer.thickness: got [1]", "must be a number"),
    "poisson too large": ("layer: {poisson: 0.51}", "2:18: layer.poisson: got 0.51", "> -1 and <= 0.5"),
    "poisson at its bound": (
        "halfspace: {poisson: -1}",
        "2:22: halfspace.poisson: got -1",
        "> -1 and <= 0.5",
    ),
    "negative bulk modulus": (
        "halfspace: {shear_modulus: -1}",
        "2:28: halfspace.shear_modulus: got -1",
        ">= 0 or .inf",
    ),
    "Ginf below G0": (
        "layer: {material: {G0: 20}}",
        "layer.material.Ginf: got 10.0, below G0",
        "must be a number >= G0",
    ),
    "infinite Ginf": ("layer: {material: {Ginf: .inf}}", "2:26: layer.material.Ginf: got .inf", "finite"),
    "tau zero": ("layer: {material: {tau: 0}}", "2:25: layer.material.tau: got 0", "> 0"),
    "unknown material": (
        "layer: {material: {model: zenner}}",
        "2:27: layer.material.model:",
        "mean 'zener'?",
    ),
    "unknown law": (
        "layer: {material: {model: fractional}}",
        "2:27: layer.material.model: got the text 'fractional'",
        "fractional_zener",
    ),
    "exponent above one": (
        "layer: {material: {model: fractional_zener, exponent: 1.5}}",
        "2:55: layer.material.exponent: got 1.5",
        "from 0.01 to 1",
    ),
    "exponent of zero": (
        "layer: {material: {model: power_law, exponent: 0}}",
        "2:48: layer.material.exponent: got 0",
        "from 0.01 to 0.99",
    ),
    "asymmetry without a spectrum": (
        "layer: {material: {model: havriliak_negami, alpha: 0.8, gamma: 1.5}}",
        "2:64: layer.material.gamma: got 1.5",
        "at most 1/alpha",
    ),
    "temperature below the range of WLF": (
        f"layer: {{material: {{{WLF}}}}}\ntemperature: {{value: -31}}",
        "3:22: temperature.value: got -31",
        "above -31 degrees Celsius",
    ),
    "temperature at which times leave all range": (
        f"layer: {{material: {{{WLF}}}}}\ntemperature: {{value: -30.5}}",
        "3:22: temperature.value: got -30.5",
        "at most 100",
    ),
    "temperature without a shift": (
        "temperature: {value: 20}",
        "2:14: temperature: given, but no material",
        "have one",
    ),
    "shift without a temperature": (
        f"layer: {{material: {{{WLF}}}}}",
        "2:27: layer.material.shift: given, but there is no temperature",
        "must be left out",
    ),
    "temperature of no kind": (
        f"layer: {{material: {{{WLF}}}}}\ntemperature: {{}}",
        "3:14: temperature: holds neither",
        "{value: ...}",
    ),
    "one of two relaxing materials without a shift": (
        f"layers: [{{thickness: 0.1, material: {{{WLF}}}}}, {{thickness: 0.2, material: {{tau: 2}}}}]\n"
        "temperature: {value: 20}",
        "layers[1].material.shift: missing",
        "must have a shift",
    ),
    "different shifts under a moving punch": (
        f"layers: [{{thickness: 0.1, material: {{{WLF}}}}},\n"
        "  {thickness: 0.2, material: {shift: {law: arrhenius, activation_energy: 8e4, reference: 20}}}]\n"
        "temperature: {value: 20}\ntrajectory: {velocity: 0.1}",
        "3:38: layers[1].material.shift: differs from that of other materials",
        "must be the same where the punch moves",
    ),
    "unknown law of shift": (
        "layer: {material: {shift: {law: vft, reference: 20}}}",
        "2:33: layer.material.shift.law: got the text 'vft'",
        "wlf or arrhenius",
    ),
    "branch without tau": (
        "layer: {material: {model: prony, branches: [{G: 1}]}}",
        "2:45: layer.material.branches[0].tau: missing",
        "number > 0",
    ),
    "branch misspelt": (
        "layer: {material: {model: prony, branches: [{G: 1, tau: 1, tua: 2}]}}",
        "2:60: layer.material.branches[0].tua: unknown key",
        "did you mean 'tau'?",
    ),
    "zener with branches": (
        "layer: {material: {branches: []}}",
        "layer.material.branches: unknown",
        "allowed: model",
    ),
    "no layer on a rigid halfspace": (
        "layer: {thickness: 0}\nhalfspace: {shear_modulus: .inf}",
        "2:20: layer.thickness: got 0 on a rigid halfspace",
        "nothing is left to deform; must be > 0",
    ),
    "no layer on nothing": (
        "layer: {thickness: 0}\nhalfspace: {shear_modulus: 0}",
        "2:20: layer.thickness: got 0 on a halfspace without stiffness",
        "must be > 0",
    ),
    "unknown punch": ("punch: {shape: wegde}", "2:16: punch.shape: got the text 'wegde'", "mean 'wedge'?"),
    "punch without its key": ("punch: {shape: wedge}", "2:1: punch.slope: missing", "must be a number > 0"),
    "another punch's key": (
        "punch: {shape: wedge, slope: 1, radius: 1}",
        "2:33: punch.radius: unknown",
        "slope",
    ),
    "radius zero": ("punch: {radius: 0}", "2:17: punch.radius: got 0", "> 0"),
    "cylinder too small": (
        "punch: {shape: cylinder, radius: 0.4}",
        "2:34: punch.radius: got 0.4",
        ">= half the period",
    ),
    "flat punch too wide": (
        "punch: {shape: flat, width: 0.8, edge_radius: 0.1}",
        "2:29: punch.width: got 0.8",
        "must be below the period",
    ),
    "wavelength that does not fit": (
        "punch: {shape: sinusoid, amplitude: 0.1, wavelength: 0.3}",
        "2:54: punch.wavelength: got 0.3",
        "the period divided by a whole number",
    ),
    "wavelength beyond the period": (
        "punch: {shape: sinusoid, amplitude: 0.1, wavelength: 1.5}",
        "2:54: punch.wavelength: got 1.5",
        "the period divided by a whole number",
    ),
    "two radii on a line": (
        "punch: {radius: [1, 2]}",
        "2:17: punch.radius: got [1.0, 2.0]",
        "must be one number, or grid.points two numbers",
    ),
    "three radii": (
        "grid: {points: [64, 64]}\npunch: {radius: [1, 2, 3]}",
        "3:17: punch.radius: got 3 values",
        "one number, or two, one for each direction",
    ),
    "a radius of two that is negative": (
        "grid: {points: [64, 64]}\npunch: {radius: [1, -2]}",
        "3:21: punch.radius[1]: got -2",
        "a number > 0 or .inf",
    ),
    "flat all over": (
        "grid: {points: [64, 64]}\npunch: {radius: [.inf, .inf]}",
        "3:17: punch.radius: got [.inf, .inf], which is flat all over",
        "must not be",
    ),
    "pyramid on a line": (
        "punch: {shape: pyramid, angle: 80, faces: 4}",  # keys that a pyramid has
        "2:16: punch.shape: got the text 'pyramid'",
        "another shape, or grid.points two numbers",
    ),
    "cylinder along the line": (
        "punch: {shape: cylinder, radius: 1, along: x}",
        "2:44: punch.along: got 'x'",
        "must be y, or grid.points two numbers",
    ),
    "sphere too small in y": (
        "grid: {points: [64, 64], period: [1, 3]}\npunch: {shape: sphere, radius: 1}",
        "3:32: punch.radius: got 1.0",
        "half the period in y, 3.0",
    ),
    "sphere too small for its part of the cell": (
        "punch: {shape: array, counts: 4, element: {shape: sphere, radius: 0.1}}",
        "2:67: punch.element.radius: got 0.1",
        "half the period over 4 in x, 0.25",
    ),
    "misspelt key of an element": (
        "grid: {points: [64, 64]}\npunch: {shape: array, counts: 4, element: {shape: pyramid, angel: 60}}",
        "3:60: punch.element.angel: unknown key",
        "did you mean 'angle'?",
    ),
    "unknown element": (
        "punch: {shape: array, counts: 4, element: {shape: spher}}",
        "2:51: punch.element.shape: got the text 'spher'",
        "did you mean 'sphere'?",
    ),
    "counts of a surface on a line": (
        "punch: {shape: array, counts: [4, 2], element: {radius: 1}}",
        "2:31: punch.counts: got 2 numbers",
        "must be one number",
    ),
    "rough without a size": (
        "punch: {shape: self_affine, hurst: 0.8, short_cutoff: 0.1, seed: 1}",
        "punch.rms_slope: missing",
        "one of rms_slope and rms_height",
    ),
    "rough of two sizes": (
        "punch: {shape: self_affine, hurst: 0.8, short_cutoff: 0.1, seed: 1, rms_slope: 1, rms_height: 1}",
        "2:95: punch.rms_height: given beside rms_slope",
        "one of rms_slope and rms_height",
    ),
    "rougher than the grid": (
        "grid: {points: 9}\npunch: {shape: self_affine, hurst: 1, short_cutoff: 0.2, seed: 1, rms_slope: 1}",
        "3:53: punch.short_cutoff: got 0.2",
        "must be > 0.2222222222222222, two spacings of the grid",
    ),
    "roll-off below the short cut-off": (
        "punch: {shape: self_affine, hurst: 0.8, short_cutoff: 0.1, roll_off: 0.05, seed: 1, rms_slope: 1}",
        "2:70: punch.roll_off: got 0.05, below short_cutoff = 0.1",
        "longer wave",
    ),
    "roll-off beyond the period": (
        "punch: {shape: self_affine, hurst: 0.8, short_cutoff: 0.1, roll_off: 1.5, seed: 1, rms_slope: 1}",
        "2:70: punch.roll_off: got 1.5",
        "must be <= the period, 1.0",
    ),
    "taper beyond the cell": (
        "punch: {shape: topography, file: case.yaml, taper: 1.5}",
        "2:52: punch.taper: got 1.5",
        "a number from 0 to 1",
    ),
    "unknown fill": (
        "punch: {shape: topography, file: case.yaml, fill: zero}",
        "2:51: punch.fill: got the text 'zero'",
        "none or membrane",
    ),
    "profile not there": (
        "punch: {shape: profile, file: a.npy}",
        "2:31: punch.file: a.npy does not exist",
        "readable",
    ),
    "profile that is a folder": (
        "punch: {shape: profile, file: .}",
        "2:31: punch.file:",
        "is not a regular file",
    ),
    "profile that is a number": (
        "punch: {shape: profile, file: 3}",
        "2:31: punch.file: got 3",
        "name of a file",
    ),
    "load without a load": ("trajectory: {control: load}", "trajectory.load: missing", "number >= 0"),
    "load with a depth": (
        "trajectory: {control: load, load: 1, depth: 1}",
        "2:45: trajectory.depth: given, but control is load",
        "must be left out",
    ),
    "depth with a load": (
        "trajectory: {load: 1}",
        "2:20: trajectory.load: given, but control is depth",
        "left out",
    ),
    "negative depth": ("trajectory: {depth: -1}", "2:21: trajectory.depth: got -1", ">= 0"),
    "negative load": ("trajectory: {control: load, load: -1}", "2:35: trajectory.load: got -1", ">= 0"),
    "null depth": ("trajectory: {depth: null}", "2:21: trajectory.depth: got nothing (null)", "left out"),
    "ramp of no length": ("trajectory: {ramp_time: 0}", "2:25: trajectory.ramp_time: got 0", "> 0"),
    "table without a file": ("trajectory: {kind: table}", "trajectory.file: missing", "name of a file"),
    "file without a table": (
        "trajectory: {file: case.yaml}",
        "2:20: trajectory.file: given, but kind",
        "left out",
    ),
    "table with a ramp": (
        "trajectory: {kind: table, file: case.yaml, ramp_time: 1}",
        "2:55: trajectory.ramp_time: given, but the table",
        "left out",
    ),
    "table with a depth": (
        "trajectory: {kind: table, file: case.yaml, depth: 1}",
        "2:51: trajectory.depth: given, but the table",
        "left out",
    ),
    "unknown control": (
        "trajectory: {control: forc}",
        "2:23: trajectory.control:",
        "must be one of depth, load, force",
        "did you mean 'force'?",
    ),
    "force missing": ("trajectory: {control: force}", "2:1: trajectory.force: missing", "over the cell"),
    "force beside load": (
        "trajectory: {control: force, force: 1, load: 1}",
        "2:46: trajectory.load: given, but control is force",
        "control be load",
    ),
    "end zero": ("time: {end: 0}", "2:13: time.end: got 0", "> 0"),
    "infinite end": ("time: {end: .inf}", "2:13: time.end: got .inf", "finite"),
    "negative step": ("time: {step: -0.1}", "2:14: time.step: got -0.1", "> 0, finite, or the word adaptive"),
    "step misspelt": ("time: {step: adaptve}", "2:14: time.step:", "did you mean 'adaptive'?"),
    "step beyond the end": ("time: {end: 1, step: 2}", "2:22: time.step: got 2.0, beyond", "<= time.end"),
    "adaptive backward Euler": (
        "time: {step: adaptive, integrator: backward_euler}",
        "2:36: time.integrator: got backward_euler",
        "must be exponential",
    ),
    "unknown integrator": (
        "time: {integrator: euler}",
        "2:20: time.integrator:",
        "backward_euler or exponential",
    ),
    "tolerance of one": ("solver: {tolerance: 1}", "2:21: solver.tolerance: got 1", ">= 1e-13 and < 1"),
    "no iterations": (
        "solver: {max_iterations: 0}",
        "2:26: solver.max_iterations: got 0",
        "whole number >= 1",
    ),
    "inertia without fire": (
        "solver: {method: active_set, inertia: uniform}",
        "2:39: solver.inertia: given, but method is active_set",
        "left out",
    ),
    "snapshot past the end": (
        "output: {snapshots: [1, 9]}",
        "2:25: output.snapshots[1]: got 9.0, past",
        "time.end = 8.0",
    ),
    "negative snapshot": ("output: {snapshots: [-1]}", "2:22: output.snapshots[0]: got -1", ">= 0"),
    "snapshots out of order": (
        "output: {snapshots: [2, 1]}",
        "2:25: output.snapshots[1]: got 1.0 after 2.0",
        "increase",
    ),
    "snapshot twice": (
        "output: {snapshots: [2, 2]}",
        "2:25: output.snapshots[1]: got 2.0 after 2.0",
        "increase",
    ),
    "snapshots not a list": ("output: {snapshots: 2}", "2:21: output.snapshots: got 2", "must be a list"),
    "times with fixed steps": ("output: {times: 0.1}", "2:17: output.times: given", "time.step be adaptive"),
    "spacing past the end": (
        "time: {step: adaptive, integrator: exponential}\noutput: {times: 9}",
        "3:17: output.times: got a spacing of 9.0",
        "<= time.end",
    ),
    "times out of order": (
        "time: {step: adaptive, integrator: exponential}\noutput: {times: [1, 0.5]}",
        "3:21: output.times[1]: got 0.5 after 1.0",
        "increase",
    ),
    "histogram without its end": (
        "output: {histograms: {gap: {bins: 9}}}",
        "2:23: output.histograms.gap.max: missing",
        "a number > 0",
    ),
    "beginning of a linear histogram": (
        "output: {histograms: {gap: {max: 1, min: 0.1}}}",
        "2:42: output.histograms.gap.min: given, but scale is linear",
        "be log",
    ),
    "logarithmic histogram without its beginning": (
        "output: {histograms: {gap: {max: 1, scale: log}}}",
        "2:23: output.histograms.gap.min: missing",
        "> 0 and < max",
    ),
    "histogram that ends before it begins": (
        "output: {histograms: {pressure: {max: 1, scale: log, min: 2}}}",
        "2:59: output.histograms.pressure.min: got 2.0",
        "< max = 1.0",
    ),
    "too many bins": (
        "output: {histograms: {pressure: {max: 1, bins: 1001}}}",
        "2:48: output.histograms.pressure.bins: got 1001",
        "from 1 to 1000",
    ),
    "patches by number": ("output: {patches: 1}", "2:19: output.patches: got 1", "true or false"),
    "tab behind a colon": ("layer:\n  thickness:\t1", "3:13: not YAML: a tab", "must be spaces"),
    "colon without a space": (
        "layer:\n  thickness:0.05",
        "3:3: layer: got the text 'thickness:0.05'",
        "did you mean 'thickness: 0.05', with a space after the colon?",
    ),
    "colon without a space before other keys": (
        "layer:\n  thickness:0.05\n  poisson: 0.4",
        "3:3: not YAML: no value",
        "did you mean 'thickness: 0.05', with a space after the colon?",
    ),
    "colon without a space behind other keys": (
        "layer:\n  poisson: 0.4\n  thickness:0.05",
        "4:3: not YAML: no value",
        "did you mean 'thickness: 0.05', with a space after the colon?",
    ),
    "colon without a space in braces": (
        "layer: {thickness:0.05}",
        "2:9: layer.thickness:0.05: unknown key",
        "did you mean 'thickness: 0.05', with a space after the colon?",
    ),
    "decimal comma": (
        "time: {step: 0.5}\ngrid:\n  period: 2,5",
        "4:11: grid.period: got",
        "mean 2.5, with a point?",
    ),
    "decimal comma in braces": (
        "layer: {thickness: 0,05}",
        "2:22: layer.05: unknown key",
        "a decimal comma?",
    ),
    "number with a unit": (
        "layer: {thickness: 200 um}",
        "2:20: layer.thickness: got the text '200 um'",
        "did you mean 200, without um? Lengths share one unit",
    ),
    "number with a Greek unit": (
        "time: {step: 5\u03bcs}",
        "2:14: time.step:",
        "did you mean 5, without \u03bcs?",
    ),
    "Young's modulus": (
        "layer: {poisson: 0.25, material: {E0: 5.0e+6}}",
        "2:35: layer.material.E0: unknown key",
        "G = E/(2 (1 + nu)); did you mean G0: 2e+06, for poisson 0.25?",
    ),
    "Young's modulus of a branch": (
        "layer: {material: {model: prony, branches: [{E: 3, tau: 1, G: 1}]}}",
        "2:46: layer.material.branches[0].E: unknown key",
        "did you mean G: 1, for poisson 0.5?",
    ),
    "Young's modulus of the halfspace": (
        "halfspace: {E: 4, poisson: 0.0}",
        "2:13: halfspace.E: unknown key",
        "did you mean shear_modulus: 2, for poisson 0?",
    ),
    "nested sweep": (
        "sweep: {layer: {thickness: [1, 2]}}",
        "2:9: sweep.layer: got a mapping",
        "did you mean layer.thickness?",
    ),
    "nested sweep of two keys": (
        "sweep: {layer: {material: {tau: [1]}, thicknes: [1, 2]}}",
        "2:9: sweep.layer: got a mapping",
        "did you mean layer.thickness and layer.material.tau?",
    ),
    "nested keys of a section that can be swept": (
        "sweep: {punch: {radius: [1, 2]}}",
        "2:9: sweep.punch: got a mapping",
        "did you mean punch.radius?",
    ),
    "nested zip": (
        "sweep: {zip: {layer: {thickness: [1, 2]}}}",
        "2:15: sweep.zip.layer: got a mapping",
        "did you mean layer.thickness?",
    ),
    "empty sweep": ("sweep: {}", "2:8: sweep: got an empty mapping", "dotted key"),
    "sweep of nothing": ("sweep:", "2:7: sweep: got nothing", "mapping"),
    "swept key misspelt": (
        "sweep: {layer.thicknes: [1]}",
        "2:9: sweep.layer.thicknes: unknown",
        "'layer.thickness'?",
    ),
    "swept section": ("sweep: {layer: [1]}", "2:9: sweep.layer: unknown key", "allowed: layer.thickness"),
    "swept range": (
        "sweep: {layer.thickness: {from: 0.1, to: 0.2}}",
        "2:9: sweep.layer.thickness: got a range; must be a list",
        "or be under one of latin_hypercube, sobol",
    ),
    "swept range of no key": ("sweep: {thicknes: {from: 1, to: 2}}", "2:9: sweep.thicknes: unknown key", "'"),
    "swept mapping of no key": (
        "sweep: {layer.poisson: {a: [1], b: [2]}}",
        "2:9: sweep.layer.poisson: got a mapping",
        "must be a list",
    ),
    "law without its mapping": (
        "interface: dugdale",
        "2:12: interface: got the text 'dugdale'",
        "must be a mapping of keys to values, such as {law: dugdale, work: ..., stress: ...}",
    ),
    "shape without its mapping": (
        "punch: {shape: array, counts: 3, element: sphere}",
        "2:43: punch.element: got the text 'sphere'",
        "such as {shape: sphere, radius: ...}",
    ),
    "sampled number": (
        "sweep: {sobol: {samples: 2, punch.radius: 3}}",
        "2:43: sweep.sobol.punch.radius: got 3",
        "a mapping",
    ),
    "swept name": ("sweep: {name: [a]}", "2:9: sweep.name: cannot be swept", "dotted key"),
    "swept sweep": ("sweep: {sweep.a: [1]}", "2:9: sweep.sweep.a: cannot be swept", "dotted key"),
    "swept over no values": (
        "sweep: {layer.thickness: []}",
        "2:26: sweep.layer.thickness: got an empty list",
        "one value",
    ),
    "swept over no list": (
        "sweep: {layer.thickness: 1}",
        "2:26: sweep.layer.thickness: got 1",
        "must be a list",
    ),
    "swept over nothing": (
        "sweep: {layer.thickness: null}",
        "2:26: sweep.layer.thickness: got nothing (null)",
        "must be a list",
    ),
    "no sweep": ("sweep: null", "2:8: sweep: got nothing (null)", "must be a mapping"),
    "nothing zipped": ("sweep: {zip: null}", "2:14: sweep.zip: got nothing (null)", "or be left out"),
    "swept value not possible": (
        "sweep: {layer.thickness: [1, -1]}",
        "2:30: sweep.layer.thickness[1]: got -1",
        ">= 0 or .inf",
    ),
    "swept value twice": (
        "sweep: {layer.thickness: [1, 2, 1.0]}",
        "2:33: sweep.layer.thickness[2]: got 1.0",
        "second",
    ),
    "swept list of one bad count": (
        "sweep: {grid.points: [16, [8, 2]]}",
        "2:27: sweep.grid.points[1]: got 2",
        ">= 8",
    ),
    "swept list where a number is due": (
        "sweep: {layer.thickness: [[1, 2]]}",
        "2:27: sweep.layer.thickness[0]: got [1, 2]",
        ">= 0 or .inf",
    ),
    "swept nothing": (
        "sweep: {layer.thickness: [1, null]}",
        "2:30: sweep.layer.thickness[1]: got nothing",
        "must have a value",
    ),
    "swept section and a key in it": (
        "sweep: {punch.radius: [1, 2], punch: [{shape: wedge, slope: 1}]}",
        "2:31: sweep.punch: swept beside punch.radius",
        "given once",
    ),
    "swept section of a kind without a key": (
        "sweep: {punch: [{radius: 1}, {shape: wedge, slope: 1, radius: 1}]}",
        "2:30: sweep.punch[1]: with a mapping, punch.radius: unknown key",
        "allowed: shape, slope",
    ),
    "misspelt zip": ("sweep: {ziip: {}}", "2:9: sweep.ziip: unknown key", "did you mean 'zip'?"),
    "zip of nothing": ("sweep: {zip: {}}", "2:14: sweep.zip: got no keys", "each with a list of values"),
    "zip that is null": ("sweep: {zip: }", "2:13: sweep.zip: got nothing (null)", "must have a value"),
    "zip that is a list": ("sweep: {zip: [1]}", "2:14: sweep.zip: got [1]", "a mapping"),
    "zip of unequal lengths": (
        "sweep: {zip: {layer.thickness: [1, 2, 3], punch.radius: [1, 2]}}",
        "2:57: sweep.zip.punch.radius: got 2 values beside 3 of layer.thickness",
        "must be as many",
    ),
    "zipped number": ("sweep: {zip: {punch.radius: 1}}", "2:29: sweep.zip.punch.radius: got 1;", "a list"),
    "zipped combination twice": (
        "sweep: {zip: {layer.thickness: [1, 2, 1], punch.radius: [1, 1, 1.0]}}",
        "2:39: sweep.zip.layer.thickness[2]: the combination at [0] a second time",
        "different",
    ),
    "zipped value not possible": (
        "sweep: {zip: {layer.thickness: [1, -1]}}",
        "2:36: sweep.zip.layer.thickness[1]: got -1",
        ">= 0 or .inf",
    ),
    "zipped values in contradiction": (
        "sweep: {zip: {layer.thickness: [1, 0], halfspace.shear_modulus: [1, .inf]}}",
        "2:36: sweep.zip.layer.thickness[1]: got 0 on a rigid halfspace",
        "must be > 0",
    ),
    "zipped and swept": (
        "sweep: {zip: {punch.radius: [1, 2]}, punch.radius: [1, 2]}",
        "2:38: sweep.punch.radius: swept beside punch.radius",
        "given once",
    ),
    "zipped key misspelt": (
        "sweep: {zip: {punch.radus: [1, 2]}}",
        "2:15: sweep.zip.punch.radus: unknown",
        "'punch.radius'?",
    ),
    "two lists": (
        "sweep: {zip: {punch.radius: [1]}, sobol: {samples: 2, layer.thickness: {from: 1, to: 2}}}",
        "2:35: sweep.sobol: given beside zip",
        "one of zip, latin_hypercube, sobol",
    ),
    "samples without ranges": (
        "sweep: {sobol: {samples: 4}}",
        "2:16: sweep.sobol: got no keys",
        "each with {from: ..., to: ...}",
    ),
    "range without an end": (
        "sweep: {sobol: {samples: 4, punch.radius: {from: 1}}}",
        "2:29: sweep.sobol.punch.radius.to: missing",
        "must be a number",
    ),
    "range with a key misspelt": (
        "sweep: {sobol: {samples: 4, punch.radius: {from: 1, to: 2, scal: log}}}",
        "2:60: sweep.sobol.punch.radius.scal: unknown key; allowed: from, to, scale",
        "did you mean 'scale'?",
    ),
    "range that is a list": (
        "sweep: {sobol: {samples: 4, punch.radius: [1, 2]}}",
        "2:43: sweep.sobol.punch.radius: got [1, 2]",
        "a mapping",
    ),
    "range that ends before it begins": (
        "sweep: {latin_hypercube: {samples: 4, punch.radius: {from: 2, to: 1}}}",
        "2:67: sweep.latin_hypercube.punch.radius.to: got 1.0",
        "> from = 2.0",
    ),
    "logarithm of zero": (
        "sweep: {sobol: {samples: 4, layer.thickness: {from: 0, to: 1, scale: log}}}",
        "2:70: sweep.sobol.layer.thickness.scale: got log from 0.0",
        "from a number > 0",
    ),
    "no number of samples": (
        "sweep: {sobol: {punch.radius: {from: 1, to: 2}}}",
        "2:9: sweep.sobol.samples: missing",
        "whole number >= 1",
    ),
    "number of samples that Sobol's sequence is not balanced for": (
        "sweep: {sobol: {samples: 100, punch.radius: {from: 1, to: 2}}}",
        "2:26: sweep.sobol.samples: got 100",
        "power of two, such as 64 or 128",
    ),
    "negative seed": (
        "sweep: {sobol: {samples: 4, seed: -1, punch.radius: {from: 1, to: 2}}}",
        "2:35: sweep.sobol.seed: got -1",
        ">= 0",
    ),
    "sampled value not possible": (
        "sweep: {latin_hypercube: {samples: 9, layer.poisson: {from: 0, to: 0.9}}}",
        "2:54: sweep.latin_hypercube.layer.poisson: got 0.",
        "<= 0.5",
    ),
    "samples of a whole number": (
        "sweep: {sobol: {samples: 4, grid.points: {from: 8, to: 99}}}",
        "2:42: sweep.sobol.grid.points: got",
        "whole number",
    ),
    "swept values in contradiction": (
        "sweep: {layer.thickness: [1, 0], halfspace.shear_modulus: [1, .inf]}",
        "2:30: sweep.layer.thickness[1]: got 0 on a rigid halfspace",
        "must be > 0",
    ),
    "swept value against a fixed one": (
        "output: {snapshots: [4]}\nsweep: {time.end: [8, 2]}",
        "3:23: sweep.time.end[1]: with 2, output.snapshots[0]: got 4.0, past the end",
        "<= time.end = 2.0",
    ),
    "anchor": (
        "sweep: {layer.thickness: &no [1]}",
        "2:26: sweep.layer.thickness: anchors and aliases are not used",
        "written out",
    ),
    "alias": ("grid: *a", "not YAML:", "undefined alias"),
    "tag": ("grid: {points: !!python/tuple [8, 8]}", "grid.points: the tag", "must be written without it"),
    "list as a key": ("? [a]\n: 1", "2:3: a key that is a list", "must be a word"),
    "tab": ("grid:\n\tpoints: 8", "3:1: not YAML: a tab", "must be spaces"),
    "unclosed": ("grid: {points: 8", "not YAML:", "expected ',' or '}'"),
    "control character": ("grid: \x01", "2:7: not YAML: the character", "not allowed"),
    "two documents": ("---\nname: y", "not YAML:", "but found another document"),
    "huge number": (
        "grid: {period: " + "9" * 400 + "}",
        "2:16: grid.period: got a number of many digits",
        "finite",
    ),
    "number beyond reading": (
        "grid: {points: " + "9" * 5000 + "}",
        "2:16: grid.points: '9999",
        "as a number",
    ),
}


@pytest.mark.parametrize(
    "content",
    [
        "punch: {shape: wegde, slope: 1, radius: 2}",
        "layer: {material: {model: pronny, G0: 1, branches: []}}",
        "punch: {shape: array, counts: 4, element: {shape: spher, slope: 3}}",
    ],
)
def test_a_misspelt_kind_is_one_error_without_the_keys_of_another(tmp_path: Path, content: str) -> None:
    (found,) = problems(write(tmp_path, f"name: x\n{content}\n"))
    assert "did you mean" in found


@pytest.mark.parametrize(
    ("sweep", "meant"),
    [("thicknes: [1]", "'layer.thickness'"), ("zip: {laier.poisson: [1]}", "'layer.poisson'")],
)
def test_an_unknown_key_of_a_sweep_is_refused_with_the_nearest_not_with_all(
    tmp_path: Path, sweep: str, meant: str
) -> None:
    (found,) = problems(write(tmp_path, f"name: x\nsweep: {{{sweep}}}\n"))
    assert found.endswith(f"others (all: gfmdlayer schema); did you mean {meant}?")
    assert len(found) < 250


def test_a_dotted_key_is_suggested_once(tmp_path: Path) -> None:
    (found,) = problems(write(tmp_path, "name: x\nsweep: {layer.poisson: {a: [1], b: [2]}}\n"))
    assert found.count("layer.poisson") == 1


def test_tabs_within_braces_and_texts_are_spaces(tmp_path: Path) -> None:
    config = load(write(tmp_path, "name: x\nlayer: {\n\tthickness: 0.5}\n"))
    assert config.layer.thickness == 0.5


@pytest.mark.parametrize(
    ("content", "begins", "holds"), [(v[0], v[1], v[2:]) for v in REFUSED.values()], ids=REFUSED
)
def test_refused_with_place_key_and_what_is_allowed(
    tmp_path: Path, content: str, begins: str, holds: tuple[str, ...]
) -> None:
    found = problems(write(tmp_path, "name: x\n" + content))
    assert len(found) == 1, found
    assert found[0].startswith("case.yaml:")
    assert begins in found[0]
    for words in holds:
        assert words in found[0]


@pytest.mark.parametrize(
    "name",
    ["3", "a/b", "''", "..", ".hidden", "-x", "null", "[a]", "'a b'", "é", "x" * 129, "true", '"a\\n"'],
)
def test_a_name_that_names_no_folder_is_refused(tmp_path: Path, name: str) -> None:
    (problem,) = problems(write(tmp_path, f"name: {name}"))
    assert problem.startswith("case.yaml:1:7: name: got ")
    assert "letters, digits and . _ -" in problem


def test_a_missing_name_is_asked_for(tmp_path: Path) -> None:
    (problem,) = problems(write(tmp_path, "grid: {points: 64}"))
    assert problem.startswith("case.yaml:1:1: name: missing; must be text of at most 128 letters")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "1:1: is empty; must be a mapping"),
        (b"# only a comment\n", "1:1: is empty; must be a mapping"),
        (b"- 1\n- 2\n", "1:1: holds no keys; must be a mapping"),
        (b"figure2\n", "1:1: holds no keys; must be a mapping"),
        (b"name: x\n# caf\xe9\n", "2:6: the byte 0xe9 is not UTF-8; must be a text file in UTF-8"),
        (b"[" * 5000, "1:1001: nested too deeply"),
    ],
)
def test_a_file_that_holds_no_configuration_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "case.yaml"
    path.write_bytes(content)
    (problem,) = problems(path)
    assert problem.startswith(f"case.yaml:{message}")


def test_a_file_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    assert "cannot be read (No such file or directory)" in problems(tmp_path / "nowhere.yaml")[0]
    assert "cannot be read (Is a directory); must be the name of a YAML file" in problems(tmp_path)[0]


def test_everything_wrong_is_reported_at_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    content = """\
name: a/b
layer: {thicknes: 1, material: {G0: 5, Ginf: 2}}
time: {end: 4, step: true}
output: {snapshots: [1, 9]}
sweep: {halfspace.poisson: [0.9, 0.5, x], layer.ticknes: [1]}
"""
    found = problems(write(tmp_path, content))
    keys = [problem.split(" ")[0] + problem.split(" ")[1] for problem in found]
    assert keys == [
        "case.yaml:1:7:name:",
        "case.yaml:2:9:layer.thicknes:",
        "case.yaml:2:46:layer.material.Ginf:",
        "case.yaml:3:22:time.step:",
        "case.yaml:4:25:output.snapshots[1]:",
        "case.yaml:5:29:sweep.halfspace.poisson[0]:",
        "case.yaml:5:39:sweep.halfspace.poisson[2]:",
        "case.yaml:5:43:sweep.layer.ticknes:",
    ]


def test_nothing_is_blamed_for_a_value_that_is_refused_itself(tmp_path: Path) -> None:
    content = "name: x\ntime: {end: ten}\noutput: {snapshots: [9]}"
    (problem,) = problems(write(tmp_path, content))
    assert problem.startswith("case.yaml:2:13: time.end:")


def test_a_product_beyond_a_million_cases_is_refused(tmp_path: Path) -> None:
    values = [0.1 + i / 1000 for i in range(101)]
    keys = ("layer.thickness", "halfspace.shear_modulus", "time.end")
    content = "name: x\nsweep: {" + ", ".join(f"{key}: {values}" for key in keys) + "}"
    (problem,) = problems(write(tmp_path, content))
    assert problem.startswith("case.yaml:2:8: sweep: got a product of 1030301 cases; must be at most 1000000")


# --- what is read ---


def test_defaults_are_the_papers_values() -> None:
    config = Config(name="paper")
    assert config.grid.points == (2**14,)
    assert config.grid.period == (1.0,)
    assert (config.layer.thickness, config.layer.poisson) == (0.05, 0.5)
    assert config.layer.material == Zener(G0=1.0, Ginf=10.0, tau=1.0)
    assert (config.halfspace.shear_modulus, config.halfspace.poisson) == (1.0, 0.5)
    assert config.punch.shape == "parabola"
    assert config.punch.radius == 0.25
    given = config.trajectory
    assert (given.control, given.kind, given.depth, given.ramp_time) == ("depth", "ramp_hold", 0.01, 1.0)
    assert (given.load, given.file) == (None, None)
    assert (config.time.end, config.time.step, config.time.integrator) == (8.0, 0.005, "exponential")
    assert config.time.tolerance is None
    assert config.with_values({"time.step": "adaptive"}).time.tolerance == 1e-4
    assert (config.solver.method, config.solver.tolerance) == ("auto", 1e-6)
    assert (config.solver.inertia, config.solver.max_iterations) == (None, 20000)
    assert config.output.snapshots == ()
    assert config.output.times is None
    assert config.output.patches is False
    assert (config.output.histograms.pressure, config.output.histograms.gap) == (None, None)
    assert config.sweep == {}


FIGURES: dict[str, tuple[dict[str, list[float]], float, float]] = {
    "indentation": ({}, 10.0, 1.0),
    "figure2": ({"layer.thickness": [0, 1 / 32, 1 / 16, 1 / 8, 1 / 4, math.inf]}, 10.0, 10.0),
    "figure3": ({"halfspace.shear_modulus": [4, 16, 64, 256, math.inf]}, 10.0, 4.0),
    "figure4": ({"layer.material.Ginf": [2, 3, 5, 9, 17]}, 2.0, 1.0),
}


@pytest.mark.parametrize("quick", [False, True])
@pytest.mark.parametrize("name", FIGURES)
def test_shipped_configurations_hold_the_papers_cases(name: str, quick: bool) -> None:
    sweep, Ginf, bulk = FIGURES[name]
    config = load(CONFIGS / f"{name}{'-quick' if quick else ''}.yaml")
    expected = Config(name=config.name).with_values(
        {
            "layer.material.Ginf": Ginf,
            "halfspace.shear_modulus": bulk,
            "grid.points": 1024 if quick else 2**14,
            "time.step": 0.05 if quick else 0.005,
            "time.integrator": "backward_euler",
            "solver.method": "fire",
            "output.snapshots": [] if name == "indentation" else [0.5, 1.0, 2.0, 8.0],
        }
    )
    assert config.name == name + ("-quick" if quick else "")
    assert config.sweep == sweep
    assert config.with_values({}) == expected


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_configuration_loads_and_has_a_quick_one_beside_it(path: Path) -> None:
    assert load(path).name == path.stem
    assert path.with_stem(path.stem.removesuffix("-quick") + "-quick").exists()


def test_the_rolling_cylinder_is_sound_and_moves_in_each_case() -> None:
    cases = load(CONFIGS / "cylinder-rolling.yaml")
    assert min(cases.sweep["trajectory.velocity"]) > 0
    assert cases.time.steady is not None


def test_the_velocity_leaves_the_digest_of_a_punch_that_stays_as_it_was() -> None:
    config = Config(name="x")
    assert "velocity" not in config.dump()
    assert digest(config.with_values({"trajectory.velocity": 0.0})) != digest(config)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (
            "0 1\n1 fast\n",
            r"trajectory\.velocity_file: .*v\.txt:2: cannot read '1 fast'; .*\(time, velocity\)",
        ),
        ("1 1\n2 1\n", r"trajectory\.velocity_file: .*v\.txt: the first time is 1; must be 0"),
        ("0 1\n1 0\n", r"trajectory\.velocity_file: .*v\.txt: ends at rest, .* time\.steady be left out"),
    ],
)
def test_a_table_of_velocities_that_cannot_be_used_is_refused(
    tmp_path: Path, rows: str, message: str
) -> None:
    (tmp_path / "v.txt").write_text(rows)
    text = "name: x\ntrajectory: {velocity_file: v.txt}\ntime: {steady: 1.0e-3}"
    with pytest.raises(ConfigError, match=message):
        load(write(tmp_path, text), (), input_errors)


def test_two_directions_share_one_period_or_have_two(tmp_path: Path) -> None:
    both = load(write(tmp_path, "name: x\ngrid: {points: [64, 32], period: 2}"))
    assert both.grid.period == (2.0, 2.0)
    assert load(write(tmp_path, "name: x\ngrid: {points: [64, 32]}")).grid.period == (1.0, 1.0)
    assert load(write(tmp_path, "name: x\ngrid: {points: [64, 32], period: [2, 1]}")).grid.period == (
        2.0,
        1.0,
    )


def test_yaml_is_read_as_version_1_2(tmp_path: Path) -> None:
    config = load(
        write(tmp_path, "name: 2024-01-02\nlayer: {thickness: 1e-3}\nhalfspace: {shear_modulus: 1_0}")
    )
    assert config.name == "2024-01-02"
    assert config.layer.thickness == 1e-3


def test_files_are_relative_to_the_configurations_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "heights.txt").write_text("0 0\n")
    path = write(tmp_path / "in", "name: x\npunch: {shape: profile, file: heights.txt}")
    monkeypatch.chdir(tmp_path)
    config = load("in/case.yaml")
    assert config.punch.shape == "profile"
    assert config.punch.file == path.parent / "heights.txt"


def test_a_sweep_is_sound_when_its_cases_are(tmp_path: Path) -> None:
    # None of these is possible with the configuration's own value of the other keys.
    content = """\
name: x
trajectory: {control: load}
sweep:
  trajectory.load: [0.1, 0.2]
  layer.material.G0: [15, 20]
  layer.material.Ginf: [30, 40]
"""
    config = load(write(tmp_path, content))
    case = config.with_values({"trajectory.load": 0.2, "layer.material.G0": 20, "layer.material.Ginf": 30})
    assert case.trajectory.load == 0.2
    assert case.sweep == {}


# --- overrides ---


def test_overrides_replace_and_add(tmp_path: Path) -> None:
    path = write(tmp_path, "name: x\ngrid: {points: 64}\nsweep: {layer.thickness: [1, 2]}")
    config = load(
        path,
        [
            "grid.points=[32, 16]",
            "layer.material.tau=2",
            "sweep.layer.thickness=[0, .inf]",
            "punch={radius: 3}",
        ],
    )
    assert config.grid.points == (32, 16)
    assert config.layer.material.model == "zener"
    assert config.layer.material.tau == 2.0
    assert config.sweep == {"layer.thickness": [0, math.inf]}
    assert config.punch.shape == "parabola"
    assert config.punch.radius == 3.0
    assert load(path, ["grid.points=32", "grid.points=16"]).grid.points == (16,)


@pytest.mark.parametrize(
    ("override", "begins"),
    [
        ("grid.points", "--set: got 'grid.points'; must be dotted.key=value"),
        ("=3", "--set: got '=3'; must be dotted.key=value"),
        ("grid..points=3", "--set: got 'grid..points=3'; must be dotted.key=value"),
        ("grid.points=", "--set: grid.points: got nothing (null); must be a whole number"),
        ("grid.points=4", "--set: grid.points: got 4; must be a whole number >= 8"),
        (
            "grid.point=4",
            "--set: grid.point: unknown key; allowed: geometry, points, period, extent; "
            "did you mean 'points'?",
        ),
        ("grid.points.x=4", "--set: grid.points.x: grid.points is not a mapping"),
        ("grid.points=[4", "--set: grid.points: not YAML:"),
        ("time.end=1", "case.yaml:3:22: output.snapshots[0]: got 2.0, past the end"),
        ("sweep.layer.thickness=[1, -1]", "--set: sweep.layer.thickness[1]: got -1; must be a number >= 0"),
        ("sweep.layer.thicknes=[1]", "--set: sweep.layer.thicknes: unknown key"),
        ("sweep=", "--set: sweep: got nothing (null)"),
        ("name=a/b", "--set: name: got the text 'a/b'"),
    ],
)
def test_problems_of_overrides_name_the_option(tmp_path: Path, override: str, begins: str) -> None:
    path = write(tmp_path, "name: x\ngrid: {points: 64}\noutput: {snapshots: [2]}")
    (problem,) = problems(path, override)
    assert problem.startswith(begins)


# --- round trip, cases, digest ---

_positive = st.floats(1e-6, 1e6)
_solids = st.one_of(
    st.fixed_dictionaries({"model": st.just("zener"), "G0": st.floats(0.1, 1), "Ginf": st.floats(1, 1e4)}),
    st.fixed_dictionaries(
        {
            "model": st.just("prony"),
            "branches": st.lists(
                st.fixed_dictionaries({"G": _positive, "tau": _positive}), min_size=1, max_size=4
            ),
        }
    ),
)
_histograms = st.one_of(
    st.fixed_dictionaries({"max": _positive}, optional={"bins": st.integers(1, 1000)}),
    st.fixed_dictionaries({"max": st.floats(1, 2), "scale": st.just("log"), "min": st.floats(0.1, 0.9)}),
)
_configs = st.fixed_dictionaries(
    {
        "name": st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,20}", fullmatch=True),
        "grid": st.fixed_dictionaries(
            {"points": st.one_of(st.integers(8, 9999), st.lists(st.integers(8, 99), min_size=1, max_size=2))},
            optional={"period": _positive},
        ),
        "layer": st.fixed_dictionaries(
            {
                "thickness": st.one_of(_positive, st.just(math.inf)),
                "material": _solids,
                "poisson": st.integers(-900, 500).map(lambda thousandths: thousandths / 1000),
            }
        ),
        "time": st.fixed_dictionaries({"end": st.floats(10, 20), "step": st.floats(1e-6, 1)}),
        "solver": st.fixed_dictionaries(
            {"method": st.sampled_from(["fire", "active_set", "conjugate_gradient"])}
        ),
        "output": st.fixed_dictionaries(
            {"snapshots": st.lists(st.one_of(st.just(0.0), st.floats(1e-30, 10)), unique=True).map(sorted)},
            optional={"patches": st.booleans(), "histograms": st.fixed_dictionaries({"gap": _histograms})},
        ),
    },
    optional={
        "punch": st.fixed_dictionaries({"shape": st.just("wedge"), "slope": _positive}),
        "trajectory": st.fixed_dictionaries({"control": st.just("load"), "load": _positive}),
        "sweep": st.fixed_dictionaries(
            {
                "halfspace.shear_modulus": st.lists(
                    st.one_of(st.floats(0.1, 1e30), st.just(math.inf)), min_size=1, max_size=4, unique=True
                )
            },
            optional={"solver.method": st.just(["active_set", "fire"]), "grid.points": st.just([64, 128])},
        ),
    },
)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=_configs)
def test_a_dump_loads_as_an_equal_configuration(tmp_path: Path, data: dict[str, Any]) -> None:
    config = Config.model_validate(data)
    again = load(write(tmp_path, config.dump()))
    assert again == config
    assert again.dump() == config.dump()
    assert pickle.loads(pickle.dumps(config)) == config


@pytest.mark.parametrize(
    "punch",
    [
        "{radius: [1.0, .inf]}",
        "{shape: sinusoid, amplitude: [0.1, 0], wavelength: 0.5}",
        "{shape: array, counts: [2, 3], element: {shape: flat, width: [0.1, 0.2], edge_radius: 0.01}}",
        "{shape: self_affine, hurst: 0.8, short_cutoff: 0.1, roll_off: 0.3, rms_slope: 0.1, seed: 7}",
        "{shape: topography, file: case.yaml, fill: membrane, detrend: plane, taper: 0.2}",
    ],
)
def test_a_punch_is_dumped_as_it_was_given(tmp_path: Path, punch: str) -> None:
    config = load(write(tmp_path, "name: x\ngrid: {points: [32, 48]}\npunch: " + punch))
    assert load(write(tmp_path, config.dump())) == config
    assert digest(config.with_values({"solver.tolerance": 1e-5})) != digest(config)


def test_dump_writes_out_every_default_readably() -> None:
    text = Config(name="x", sweep={"layer.thickness": [0, math.inf]}).dump()
    assert "material:\n    model: zener\n    G0: 1.0\n" in text
    assert "  points: 16384\n" in text
    assert "  layer.thickness: [0, .inf]\n" in text
    assert "method: auto\n" in text


def test_a_case_has_its_values_and_no_sweep() -> None:
    config = Config(name="x", sweep={"solver.method": ["fire", "active_set"]})
    case = config.with_values(
        {
            "solver.method": "active_set",
            "layer.material": {"model": "prony", "branches": [{"G": 1, "tau": 2}]},
        }
    )
    assert case.solver.inertia is None  # a default follows the method of the case
    assert isinstance(case.layer.material, Prony)
    assert case.sweep == {}
    with pytest.raises(ConfigError, match=r"^layer\.poisson: got 2; must be a number > -1 and <= 0\.5$"):
        config.with_values({"layer.poisson": 2})
    with pytest.raises(ConfigError, match=r"^layer\.x: unknown key"):
        config.with_values({"layer.x": 2})


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("grid.points", 64),
        ("grid.period", 2),
        ("layer.thickness", math.inf),
        ("layer.material.tau", 2),
        ("halfspace.poisson", 0.3),
        ("punch.radius", 0.3),
        ("trajectory.depth", 0.02),
        ("time.step", 0.01),
        ("solver.tolerance", 1e-5),
        ("trajectory.velocity", 0.5),
        ("output.snapshots", [1.0]),
        ("output.histograms.gap.max", 0.1),
    ],
)
def test_digest_changes_with_what_determines_results(key: str, value: object) -> None:
    config = Config(name="x")
    assert digest(config.with_values({key: value})) != digest(config)


def test_digest_does_not_depend_on_name_sweep_or_how_values_are_written() -> None:
    config = Config(name="x")
    assert digest(Config(name="y", sweep={"layer.thickness": [1]})) == digest(config)
    assert digest(config.with_values({"grid.period": [1], "layer.thickness": 0.05})) == digest(config)


def test_digest_follows_the_contents_of_files_not_their_place(tmp_path: Path) -> None:
    a, b = tmp_path / "a.txt", tmp_path / "b.txt"
    a.write_text("0 1\n")
    b.write_text("0 1\n")
    configs = [
        Config.model_validate({"name": "x", "punch": {"shape": "profile", "file": str(f)}}) for f in (a, b)
    ]
    assert digest(configs[0]) == digest(configs[1])
    b.write_text("0 2\n")
    assert digest(configs[0]) != digest(configs[1])


def test_a_configuration_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="frozen"):
        Config(name="x").layer.thickness = 1.0


def test_no_numerics_is_imported() -> None:
    heavy = "{'numpy', 'numba', 'scipy', 'h5py', 'pyfftw', 'mpi4py', 'matplotlib', 'xarray', 'rich'}"
    code = f"import sys, gfmdlayer.config; print(sorted({heavy} & sys.modules.keys()))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


# --- any text at all ---


def accepted_or_refused(path: Path, *overrides: str) -> bool:
    """Anything else that `load` raises goes through."""
    try:
        return isinstance(load(path, overrides), Config)
    except ConfigError as error:
        return all(problem.startswith((f"{path}:", "--set:")) for problem in error.problems) and bool(
            error.problems
        )


_scraps = st.lists(
    st.one_of(
        st.sampled_from("[]{}:,-?!&*#|>%@`'\" \n\t\x85\u2028"),
        st.sampled_from(
            ["name:", "sweep: ", "layer: ", "thickness: ", "punch: ", "shape: ", "output: {times: "]
        ),
        st.sampled_from(
            [
                ".inf",
                ".nan",
                "1e400",
                "0x",
                "0o9",
                "!!int",
                "<<",
                "&a",
                "*a",
                "2001-99-99",
                "null",
                "true",
                '"\\UFFFFFFFF"',
            ]
        ),
        st.sampled_from(
            ["layer.thickness", "grid: ", "points: ", "%YAML 1.1\n---\n", "material: ", "model: "]
        ),
    )
).map("".join)


@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.one_of(st.text(), _scraps), prefix=st.sampled_from(["", "name: x\n"]))
@example(content="punch: {shape: profile, file: 'a\\0b'}", prefix="name: x\n")
@example(content='punch: {shape: profile, file: "a\\0b"}', prefix="name: x\n")
@example(content="punch: {shape: profile, file: " + "a" * 5000 + "}", prefix="name: x\n")
@example(content="{{a}}: 1", prefix="")
def test_any_text_is_a_configuration_or_a_named_error(tmp_path: Path, content: str, prefix: str) -> None:
    path = tmp_path / "case.yaml"
    path.write_bytes((prefix + content).encode("utf-8", errors="surrogatepass"))
    assert accepted_or_refused(path)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    override=st.one_of(
        st.text(), _scraps.map("sweep.layer.thickness={}".format), _scraps.map("punch={}".format)
    )
)
def test_any_override_is_taken_or_a_named_error(tmp_path: Path, override: str) -> None:
    assert accepted_or_refused(write(tmp_path, "name: x"), override)


ROUGH = {"shape": "self_affine", "hurst": 0.8, "short_cutoff": 0.1, "rms_slope": 0.1, "seed": 1}


@pytest.mark.parametrize(
    ("values", "method"),
    [
        ({}, "active_set"),
        ({"grid.points": [64, 64]}, "active_set"),
        ({"punch": ROUGH}, "active_set"),
        ({"punch": ROUGH, "grid.points": [64, 64]}, "nested_gradient"),
        ({"interface": {"law": "exponential", "work": 1e-3, "range": 1e-2}}, "newton"),
    ],
)
def test_results_carry_the_solver_that_auto_takes(values: dict[str, object], method: str) -> None:
    """So results of the active set, the default before, keep their digest."""
    config = Config(name="x").with_values(values)
    assert config.contact_solver.method == method
    assert digest(config) == digest(config.with_values({"solver.method": method}))


LONG = ", ".join(f"{1 + 0.01 * i:.6g}" for i in range(600))  # more than are left to the parser of YAML


@pytest.mark.parametrize(
    "content",
    [
        f"a: [{LONG}]\nb: 1\n",
        f"a: {{c: [{LONG}], d: [1, {LONG}, -2e-3, +5, 1., 007]}}\n",
        f"a: [[{LONG}], [{LONG},\n {LONG}], 3]  # and so on\n",
        "a:\n" + "".join(f"  - {i}\n" for i in range(600)) + "b: 1\n",
        "a:\n- " + LONG.replace(", ", "\n- ") + "\nb: [x]\n",
        "a: x\n" + "".join(f"  - {i}\n" for i in range(600)),  # one long text
        "a:\n  - 1\n" + "".join(f"    - {i}\n" for i in range(600)) + "  - 2\n",
        f"a: '[{LONG}]'\n",
        f"a: |\n  x: [{LONG}]\n",
        f"a: 1  # [{LONG}]\n",
        f"a: [{LONG},]\nb: [{LONG}, , 1]\n",
        f"a: [{LONG}] 3\n",
        f"a: [{LONG}, 1e999]\nb: !!seq [{LONG}]\nc: &x [{LONG}]\n",
        f"[{LONG}]: 1\n",
        f"? [{LONG}]\n: 1\n",
        f"a: [{LONG}]\na: [{LONG}]\nb: \ue000\n",
    ],
)
def test_long_lists_of_numbers_are_read_as_short_ones_are(
    content: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = text.read(content, "x.yaml")
    monkeypatch.setattr(text, "shortened", lambda content: (content, {}))
    whole = text.read(content, "x.yaml")
    assert repr(found.data) == repr(whole.data)
    assert found.problems == whole.problems
    assert found.keys == whole.keys
    assert {at: found.place(at) for at in whole.values} == whole.values


def test_a_number_in_a_long_list_is_refused_at_its_place(tmp_path: Path) -> None:
    path = write(tmp_path, f"name: long\nsweep:\n  punch.radius: [{LONG},\n    -2, 0.5]\n")
    assert problems(path) == [
        "case.yaml:4:5: sweep.punch.radius[600]: got -2; must be a number > 0, or two of them, "
        "one for each direction"
    ]


def test_a_shape_that_is_refused_leaves_its_keys_alone(tmp_path: Path) -> None:
    """They are not judged by the default shape."""
    found = problems(write(tmp_path, "name: x\ngrid: {points: 64}\npunch: {shape: pyramid, angle: 80}\n"))
    assert len(found) == 1
    isolated = "name: x\ngrid: {geometry: axisymmetric}\npunch: {shape: pyramid, angle: 80}\n"
    assert len(problems(write(tmp_path, isolated))) == 1
