"""`new`, `schema` and `completion`: help in writing configurations and commands.

A new configuration follows from the model of the configuration; editors show the same meanings.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

from gfmdlayer.cli.terminal import COMPLETE, refuse, verb

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from gfmdlayer.validation.sections import Section

_COLUMN = 36  # of the comments
_HEAD = """\
# {summary}
#
# Every key except name has a default. A key behind a # has no default, or no meaning in this case. {units}
"""
_OF_PAPER = """Lengths
# are in units of the period, moduli in units of G0, times in units of tau; or use any units, but the same
# everywhere."""
_OF_UNITS = """Numbers
# are in the units below."""
_SWEEP = """\
# sweep:
#   layer.thickness: [0.02, 0.05, .inf]
"""
_QUICK = "{output.snapshots: [1.0, 8.0]}"
_SURFACE = """
grid.points: [128, 128]
trajectory.control: load
time.end: 2.0
output.snapshots: [1.0, 2.0]
"""
_MM = "units: {length: mm, stress: MPa, time: s}"
# For each kind a sentence, and the dotted keys that differ from the defaults.
TEMPLATES = {
    "indentation": ("A parabola is pressed into a viscoelastic layer, and its depth stays constant.", _QUICK),
    "sweep": (
        "A parabola is pressed into layers of several thicknesses.",
        _QUICK,
        "sweep: {layer.thickness: [0.02, 0.05, 0.1, 0.2]}",
    ),
    "prony": (
        "A parabola is pressed into a layer that relaxes over two decades of time.",
        _QUICK,
        """
layer.material: {model: prony, branches: [{G: 6.0, tau: 0.1}, {G: 3.0, tau: 10.0}]}
time.end: 100.0
output.snapshots: [1.0, 10.0, 100.0]
""",
    ),
    "stack": (
        "A parabola is pressed into a stiff skin on a soft layer on a rigid base, each viscoelastic.",
        _QUICK,
        """
layers:
  - {thickness: 0.01, poisson: 0.45, material: {G0: 5.0, Ginf: 20.0, tau: 1.0}}
  - {thickness: 0.1, poisson: 0.49, material: {G0: 1.0, Ginf: 4.0, tau: 0.3}}
halfspace.shear_modulus: .inf
sweep: {layers.0.thickness: [0.005, 0.01, 0.02]}
""",
    ),
    "sliding": (
        "A cylinder rolls or slides along a layer at several speeds, until its friction is steady.",
        _QUICK,
        """
punch: {shape: cylinder, radius: 0.6}
trajectory.control: load
trajectory.load: 0.01
trajectory.velocity: 0.1
time.end: 400.0
time.steady: 1e-3
output.snapshots: []
sweep: {trajectory.velocity: [0.03, 0.3, 3.0]}
""",
    ),
    "adhesion": (
        "A parabola is pressed onto an adhesive layer, rests, and is pulled off at several speeds.",
        _QUICK,
        """
layer.thickness: 0.2
halfspace.shear_modulus: .inf
interface: {law: exponential, work: 2.0e-4, range: 1.0e-3}
trajectory: {kind: approach_retract, start: -0.004, depth: 0.002, approach_speed: 0.001, dwell: 10.0,
  retract_speed: 0.001, final: -0.015}
time.end: 190.0
output.snapshots: []
sweep: {trajectory.retract_speed: [1.0e-4, 1.0e-3, 1.0e-2]}
""",
    ),
    "sphere": (
        "A sphere is pressed into a coated solid by a force; a surface in two directions.",
        _SURFACE,
        """
halfspace: {shear_modulus: 10.0, poisson: 0.3}
punch: {shape: sphere, radius: 1.0}
trajectory.load: 0.02
""",
    ),
    "rough": (
        "A self-affine rough surface is pressed into a layer on a rigid base.",
        _SURFACE,
        """
layer.thickness: 0.2
halfspace.shear_modulus: .inf
punch: {shape: self_affine, hurst: 0.8, short_cutoff: 0.0625, seed: 1, roll_off: 0.25, rms_slope: 0.1}
trajectory.load: 0.05
output.patches: true
""",
    ),
    "rollers": (
        "A rubber-coated roller rolls on another at several speeds: friction by the loss of both coatings.",
        _MM,
        """
grid: {points: 1024, period: 40.0}
layer: {thickness: 5.0, poisson: 0.49, material: {G0: 1.0, Ginf: 4.0, tau: 1.0e-3}}
halfspace.shear_modulus: .inf
counterbody:
  layer: {thickness: 3.0, poisson: 0.49, material: {G0: 2.0, Ginf: 6.0, tau: 1.0e-3}}
  halfspace: {shear_modulus: .inf}
  velocity_ratio: 1.0
punch: {shape: cylinder, radius: 25.0}
trajectory: {control: load, load: 0.05, ramp_time: 0.01, velocity: 1000.0}
time: {end: 20.0, steady: 1.0e-3}
sweep: {trajectory.velocity: {from: 100.0, to: 10000.0, points: 5, spacing: log}}
""",
    ),
    "seal": (
        "A rough metal surface is pressed on a rubber seal: leakage while the rubber relaxes.",
        _MM,
        """
grid: {points: [128, 128], period: 0.2}
layer: {thickness: .inf, poisson: 0.49, material: {G0: 1.5, Ginf: 15.0, tau: 0.1}}
punch: {shape: self_affine, hurst: 0.8, roll_off: 0.05, short_cutoff: 0.008, rms_slope: 0.1, seed: 1}
trajectory: {control: load, load: 0.06, ramp_time: 0.01}
time: {end: 100.0, tolerance: 3.0e-3}
output: {snapshots: [0.1, 100.0], leakage: {every: 1}}
""",
    ),
    "master-curve": (
        "A roller on rubber at speeds and temperatures: friction falls on one curve by the shift factors.",
        _MM,
        """
grid: {points: 512, period: 40.0}
layer:
  thickness: 5.0
  poisson: 0.49
  material: {model: fractional_zener, G0: 1.0, Ginf: 100.0, tau: 1.0e-6, exponent: 0.6,
    shift: {law: wlf, C1: 4.57, C2: 113.6, reference: 25.0}}
halfspace.shear_modulus: .inf
temperature.value: 25.0
punch: {shape: cylinder, radius: 25.0}
trajectory: {control: load, load: 0.05, ramp_time: 0.01, velocity: 1000.0}
time: {end: 20.0, tolerance: 1.0e-3, steady: 1.0e-3}
sweep:
  temperature.value: [0.0, 25.0, 60.0]
  trajectory.velocity: {from: 100.0, to: 10000.0, points: 3, spacing: log}
""",
    ),
    "electroadhesion": (
        "A wavy electrode is drawn onto a rubber film at several voltages.",
        """
units: {length: um, stress: kPa, time: s}
grid: {points: 1024, period: 250.0}
layer: {thickness: 100.0, poisson: 0.45, material: {G0: 20.0, Ginf: 200.0, tau: 0.5}}
halfspace.shear_modulus: .inf
punch: {shape: sinusoid, amplitude: 1.0, wavelength: 250.0}
interface: {law: electrostatic, voltage: 40.0, insulation: [{thickness: 10.0, permittivity: 3.0}]}
trajectory: {control: load, load: 0.1, ramp_time: 0.1}
time: {end: 5.0, tolerance: 1.0e-3}
output.snapshots: [5.0]
sweep: {interface.voltage: [20.0, 40.0, 60.0]}
""",
    ),
    "measured-rubber": (
        "A ball on a rubber sheet whose moduli were measured: first gfmdlayer fit-material dma.csv.",
        _MM,
        """
grid: {geometry: axisymmetric}
layer: {thickness: 2.0, poisson: 0.49,
  material: {model: prony, G0: 1.0, branches: [{G: 1.5, tau: 0.01}, {G: 1.0, tau: 0.1}, {G: 0.5, tau: 1.0}]}}
halfspace.shear_modulus: .inf
punch: {shape: sphere, radius: 5.0}
trajectory: {control: force, force: 2.0, ramp_time: 0.1}
time.end: 10.0
""",
    ),
}


def _options_of_new(parser: argparse.ArgumentParser) -> None:
    meaning = "YAML file to write, or folder for KIND.yaml (default: here)"
    parser.add_argument("file", metavar="FILE", nargs="?", help=meaning)
    meaning = f"{', '.join(TEMPLATES)} (default: indentation)"
    parser.add_argument("--like", metavar="KIND", choices=TEMPLATES, default="indentation", help=meaning)
    parser.add_argument("--force", action="store_true", help="overwrite FILE")


@verb(_options_of_new, "gfmdlayer new first.yaml && gfmdlayer run first.yaml && gfmdlayer plot results/first")
def new(options: argparse.Namespace) -> int:
    """Write a configuration to start from, with the meaning of every key.

    The text follows from the model of the configuration; editors show the same meanings.
    """
    from gfmdlayer.config import ConfigError
    from gfmdlayer.files.whole import output_file, write_text

    path = output_file(options.file, Path(f"{options.like}.yaml"))
    try:
        content = commented(path.stem, options.like)
        write_text(path, content, replace=options.force)
    except ConfigError as error:
        return refuse(*(f"{path}: {problem}" for problem in error.problems))
    except FileExistsError:
        return refuse(f"{path}: exists; choose another name, or overwrite it with --force")
    except OSError as error:
        return refuse(f"{path}: cannot be written ({error.strerror})")
    print(f"{path}: explains each key; run it with  gfmdlayer run {path}")
    return COMPLETE


def commented(name: str, like: str) -> str:
    """Return a configuration as YAML with the meaning of every key."""
    from gfmdlayer.config.model import Config
    from gfmdlayer.validation import text

    summary, *parts = TEMPLATES[like]
    values = {"name": name}
    for part in parts:
        values |= text.read(part, "template").data
    config = Config(name="new").with_values(values)
    lines = (f"{entry:<{_COLUMN - 2}}  # {words}".rstrip(" #") for entry, words in _entries(config))
    units = _OF_PAPER if config.units is None else _OF_UNITS
    return (
        _HEAD.format(summary=summary, units=units)
        + "\n".join(lines)
        + "\n"
        + ("" if config.sweep else _SWEEP)
    )


def _entries(section: Section, indent: str = "") -> Iterator[tuple[str, str]]:
    """Yield the lines of a section, each with the meaning of its key."""
    from gfmdlayer.validation import text
    from gfmdlayer.validation.fields import meanings
    from gfmdlayer.validation.sections import Section

    values, words = section.model_dump(exclude_none=True), meanings(type(section))
    for key, known in type(section).model_fields.items():
        value = getattr(section, key)
        if isinstance(value, Section):
            inner = [*_kinds(known, indent + "  "), *_entries(value, indent + "  ")]
            live = any(not line.lstrip().startswith("#") for line, _ in inner)
            yield f"{indent}{'' if live else '# '}{key}:", words.get(known.alias or key, "")
            yield from inner
        elif key in values and value != {}:
            first, *rest = text.written({key: values[key]}).splitlines()
            yield indent + first, words.get(known.alias or key, "")
            yield from ((indent + line, "") for line in rest)
        elif value is None:
            yield f"{indent}# {key}:", words.get(known.alias or key, "")


def _kinds(field: FieldInfo, indent: str) -> Iterator[tuple[str, str]]:
    """Yield lines with the kinds of section that a key may have, if there are several."""
    from gfmdlayer.validation.sections import OneOf, held_by

    held = held_by(field)
    if isinstance(held, OneOf):
        lines = wrap(f"one of {', '.join(held.members)}", 100)
        yield from ((f"{indent}# {line}", "") for line in lines)


@verb("", "gfmdlayer schema > gfmdlayer.schema.json")
def schema(options: argparse.Namespace) -> int:  # noqa: ARG001
    """Print the JSON Schema of a configuration, for editors."""
    import json

    from gfmdlayer.config.json_schema import json_schema

    print(json.dumps(json_schema(), indent=2))
    return COMPLETE


PATHS = {"CONFIG", "DATA", "DIR", "FILE", "PATH"}  # metavars of files and folders


@verb("shell {bash,zsh,fish}  name of the shell", 'eval "$(gfmdlayer completion bash)"')
def completion(options: argparse.Namespace) -> int:
    """Print the script for a shell to complete verbs, options and file names."""
    import shtab

    from gfmdlayer.cli import command_line

    parser = command_line()
    for action in _actions(parser):
        if action.metavar in PATHS:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(parser, options.shell))
    return COMPLETE


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for parser in action.choices.values():
                yield from _actions(parser)
