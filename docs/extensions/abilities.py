"""Abilities by abilities: which pairs run, and why others do not, from the refusals of the configuration.

An ability has one or more fragments of a configuration; a pair runs if two of them make a configuration that
is accepted. Otherwise each refusal says by `Mistake.because` whether physics or the package is the reason.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import combinations, product
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from gfmdlayer.config import Config
from gfmdlayer.config.model import explain
from gfmdlayer.study.groups import problems_together, with_shared_solver
from gfmdlayer.validation.problems import Mistake

Fragment = Mapping[str, Any]

_ZENER: Fragment = {"model": "zener", "G0": 1.0, "Ginf": 4.0, "tau": 1.0}
_WLF: Fragment = {"law": "wlf", "C1": 8.86, "C2": 101.6, "reference": 20.0}
_ARRHENIUS: Fragment = {"law": "arrhenius", "activation_energy": 8.0e4, "reference": 20.0}
_SHIFTED = {**_ZENER, "shift": _WLF}
_COULOMB: Fragment = {"law": "coulomb", "coefficient": 0.4}
_MOTION: Fragment = {"trajectory": {"velocity": 1.0}}  # a spacing of the grid in a step
_BASE: Fragment = {
    "name": "pair",
    "grid": {"points": 16},
    "time": {"end": 0.25, "step": 0.0625},
    "trajectory": {"ramp_time": 0.25},
}
_TABLES = {
    "depth.txt": "0 0\n0.125 0.012\n0.25 0.01\n",
    "gap.txt": "0 0.18\n0.25 0.15\n",
    "velocity.txt": "0 0.5\n0.25 1\n",
    "temperature.txt": "0 20\n0.25 30\n",
    "stiffness.txt": "1e-12 2e-12\n1 2\n1e6 2e6\n",
    "body.py": """\
import gfmdlayer
import numpy as np


class Twice(gfmdlayer.Solid):
    @property
    def mean_stiffness(self):
        return 0.0

    def stiffness(self, waves, s):
        return 2 * np.asarray(waves) + 0 * np.asarray(s)

    def spectrum(self, waves):
        return gfmdlayer.Spectrum.of_material(2 * np.asarray(waves), gfmdlayer.Elastic(1.0))

    def traction_spectrum(self, waves):
        q = np.asarray(waves)
        return gfmdlayer.TractionSpectrum.of_material(
            2 * np.multiply.outer(q, np.eye(2)), q, gfmdlayer.Elastic(1.0)
        )
""",
}
TOGETHER = "ranks that share a case"


@cache
def _folder() -> Path:
    """Write the files of the fragments once."""
    folder = Path(tempfile.mkdtemp(prefix="abilities"))
    for name, contents in _TABLES.items():
        (folder / name).write_text(contents, encoding="utf-8")
    return folder


@cache
def abilities() -> Mapping[str, tuple[Fragment, ...]]:
    """Return the fragments of each ability; the first is the one by which a refusal is shown."""
    file = {name: str(_folder() / name) for name in _TABLES}
    layers = [{"thickness": 0.05, "material": _ZENER}, {"thickness": 0.1, "material": _ZENER}]
    shifted = [
        {"thickness": 0.05, "material": _SHIFTED},
        {"thickness": 0.1, "material": {**_ZENER, "shift": _ARRHENIUS}},
    ]
    adhesion = {"law": "exponential", "work": 1e-5, "range": 0.01}
    voltage = {"law": "electrostatic", "voltage": 0.5, "insulation": 1e-4, "permittivity": 1e-10}
    friction: Fragment = {"interface": [_COULOMB]}

    def at_temperature(temperature: Fragment) -> tuple[Fragment, ...]:
        """Return a temperature for a layer, layers, a body with one material, and different shifts."""
        bodies: tuple[Fragment, ...] = (
            {"layer": {"material": _SHIFTED}}, {"layers": [{"material": _SHIFTED}] * 2},
            {"body": {"material": _SHIFTED}}, {"layers": shifted},
        )  # fmt: skip
        return tuple({**body, "temperature": temperature} for body in bodies)

    return {
        "surface": ({"grid": {"points": [16, 16]}},),
        "axisymmetric": (
            {"grid": {"geometry": "axisymmetric"}},
            {"grid": {"geometry": "axisymmetric"}, "time": {"step": "adaptive"}},
        ),
        "isolated contact": (
            {"grid": {"boundary": "isolated", "datum": 2.0}}, {"grid": {"boundary": "isolated"}},
        ),
        "one isolated axis": (
            {"grid": {"points": [16, 16], "boundary": ["isolated", "periodic"], "datum": 2.0}},
            {"grid": {"points": [16, 16], "boundary": ["isolated", "periodic"]}},
        ),
        "several layers": ({"layers": layers},),
        "free layer": ({"halfspace": {"shear_modulus": 0}},),
        "anisotropic body": ({"body": {"kind": "anisotropic", "C11": 5.0, "C12": 2.0, "C44": 2.5}},),
        "lattice": (
            {"body": {"kind": "lattice", "crystal": "simple_cubic", "nearest": 0.0625,
                      "next_nearest": 0.03, "spacing": 0.0625}},
        ),
        "table of stiffnesses": ({"body": {"kind": "table", "table": file["stiffness.txt"]}},),
        "body of Python": ({"body": {"kind": "file", "file": file["body.py"]}},),
        "counterbody": ({"counterbody": {"halfspace": {"shear_modulus": 3.0}}},),
        "rough punch": (
            {"punch": {"shape": "self_affine", "hurst": 0.8, "short_cutoff": 0.25, "rms_height": 0.01,
                       "seed": 1}},
        ),
        "adhesion": ({"interface": [adhesion]}, {"interface": [{"law": "short_range", "work": 1e-3}]}),
        "voltage": ({"interface": [voltage]},),
        "hardness": ({"interface": [{"law": "hard_wall", "hardness": 0.5}]},),
        "friction": (friction,),
        "tangential drive": (
            {**friction, "trajectory": {"tangential": {"displacement": 0.01}}},
            {**friction, "trajectory": {"tangential": {"control": "force", "force": 1e-4}}},
        ),
        "velocity": (_MOTION,),
        "velocity over time": ({"trajectory": {"velocity_file": file["velocity.txt"]}},),
        "creepage": ({**friction, "trajectory": {"velocity": 1.0, "creepage": 0.1}},),
        "end at a steady state": ({**_MOTION, "time": {"steady": 1e-3}},),
        "steady state at once": ({**friction, **_MOTION, "time": {"steady": "at_once"}},),
        "load": (
            {"trajectory": {"control": "load", "load": 1e-3}}, {"trajectory": {"control": "load"}},
        ),
        "force": (
            {"trajectory": {"control": "force", "force": 1e-3}}, {"trajectory": {"control": "force"}},
        ),
        "mean gap": (
            {"trajectory": {"control": "gap", "gap": 0.15}},
            {"trajectory": {"control": "gap", "kind": "table", "ramp_time": None, "file": file["gap.txt"]}},
        ),
        "retraction": (
            {"trajectory": {"kind": "approach_retract", "ramp_time": None, "approach_speed": 0.08}},
        ),
        "measured depth": (
            {"trajectory": {"kind": "table", "ramp_time": None, "file": file["depth.txt"]}},
            {"trajectory": {"control": "gap", "kind": "table", "ramp_time": None, "file": file["gap.txt"]}},
        ),
        "adaptive steps": ({"time": {"step": "adaptive", "tolerance": 1e-2}},),
        "backward Euler": ({"time": {"integrator": "backward_euler"}},),
        "temperature": at_temperature({"value": 25.0}),
        "temperature over time": at_temperature({"file": file["temperature.txt"]}),
        "different shifts": ({"layers": shifted, "temperature": {"value": 25.0}},),
        "different shifts over time": (
            {"layers": shifted, "temperature": {"file": file["temperature.txt"]}},
        ),
        "fields inside": (
            {"output": {"snapshots": [0.25], "inside": {"depths": [0.01, 0.05], "every": 2}}},
        ),
        "snapshots": ({"output": {"snapshots": [0.25]}},),
        "patches and histograms": (
            {"output": {"patches": True, "histograms": {"pressure": {"max": 1.0}, "gap": {"max": 1.0}}}},
            {"output": {"patches": True}},
        ),
        "leakage": ({"output": {"leakage": {}}},),
        "conductance": ({"output": {"conductance": {"body": {"resistivity": 1.0}}}},),
        "dynamic stiffness": ({"output": {"stiffness": {"frequencies": [0.0, 1.0]}}},),
        TOGETHER: ({"grid": {"points": [16, 16]}},),
    }  # fmt: skip


class Pair(NamedTuple):
    """Two abilities, and why they do not go together."""

    one: str
    other: str
    config: Fragment  # of which the configuration is made, accepted where there is no refusal
    refusals: tuple[Mistake, ...]

    @property
    def verdict(self) -> str:
        """`runs`, `physics`, `open`, or nothing for a refusal without a reason."""
        if not self.refusals:
            return "runs"
        found = {refusal.because for refusal in self.refusals}
        return next((each for each in ("physics", "open") if each in found), "")


@cache
def pairs() -> tuple[Pair, ...]:
    """Return all pairs of abilities; two values of one key are a choice, and no pair."""
    return tuple(_pairs())


def alone() -> Iterator[tuple[str, tuple[Mistake, ...]]]:
    """Yield each ability, and why none of its fragments is accepted alone."""
    for name, fragments in abilities().items():
        tried = [_refusals(_merged(_BASE, each, over=True), together=name == TOGETHER) for each in fragments]
        yield name, min(tried, key=len)


def _pairs() -> Iterator[Pair]:
    for (one, first), (other, second) in combinations(abilities().items(), 2):
        tried = []
        for a, b in product(first, second):
            if (merged := _merged(a, b)) is None:
                continue
            merged = _merged(_BASE, merged, over=True)
            refusals = _refusals(merged, together=TOGETHER in (one, other))
            tried.append(Pair(one, other, merged, refusals))
            if not refusals:
                break
        if tried:
            yield min(tried, key=lambda pair: (not pair.verdict, len(pair.refusals)))


def _refusals(merged: Fragment, *, together: bool) -> tuple[Mistake, ...]:
    """Return why a configuration is refused."""
    try:
        config = Config.model_validate(merged)
    except ValidationError as error:
        return tuple(explain(error))
    return tuple(problems_together(with_shared_solver(config), 2)) if together else ()


def _merged(one: Any, other: Any, *, over: bool = False) -> Any:
    """Return the keys of both; None where they differ in a value, unless that of the other counts."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        merged = dict(one)
        for key, value in other.items():
            if key == "interface" and key in one:
                merged[key] = [*one[key], *(law for law in value if law not in one[key])]
                continue
            merged[key] = value if key not in one else _merged(one[key], value, over=over)
            if merged[key] is None and value is not None:
                return None
        return {key: value for key, value in merged.items() if value is not None or not over}
    if isinstance(one, list) and isinstance(other, list) and all(isinstance(v, dict) for v in (*one, *other)):
        listed = [_merged(a, b, over=over) for a, b in zip(one, other, strict=True)]
        return None if None in listed else listed
    return other if over or one == other else None


_PAGE = """\
# What runs together

Each pair of abilities of a configuration runs, or is refused before any work, for one of two reasons:

- physics: the two contradict one another, or one of them has no meaning beside the other;
- open: physics allows the pair, and the package does not have it yet. The reason says what is missing.

The table follows from the refusals themselves. Empty places are two values of one key.
"""
_MARKS = {"runs": "●", "physics": "–", "open": "○"}


def _mark(pair: Pair) -> str:
    """Return the mark of a pair, which a browser explains under the pointer."""
    return f'<abbr title="{pair.one}, {pair.other}">{_MARKS[pair.verdict]}</abbr>'


def page() -> Iterator[str]:
    """Yield the page: the table, then the open pairs, then what physics refuses."""
    names, found = list(abilities()), {(pair.one, pair.other): pair for pair in pairs()}
    count = Counter(pair.verdict for pair in found.values())
    yield _PAGE
    yield (
        f"Of {len(found)} pairs {count['runs']} run (●), {count['physics']} contradict physics (–), and "
        f"{count['open']} are open (○).\n"
    )
    numbers = range(1, len(names))
    heads = (f'<abbr title="{name}">{number}</abbr>' for number, name in zip(numbers, names, strict=False))
    yield f"| | {' | '.join(heads)} |"
    yield f"|---|{':-:|' * len(numbers)}"
    for i, name in enumerate(names):
        row = (found.get((other, name)) for other in names[:i])
        marks = [_mark(pair) if pair else "" for pair in row]
        cells = marks + [""] * (len(numbers) - len(marks))
        yield f"| {i + 1} {name} | {' | '.join(cells)} |"
    yield ""
    for verdict, title in (("open", "Open"), ("physics", "Physics")):
        yield f"## {title}\n"
        yield "| pair | reason |"
        yield "|---|---|"
        for pair in found.values():
            if pair.verdict == verdict:
                reason = next(each for each in pair.refusals if each.because == verdict)
                said = str(reason).replace("|", "\\|").replace(f"{_folder()}/", "")
                yield f"| {pair.one}, {pair.other} | {said} |"
        yield ""
