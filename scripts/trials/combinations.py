"""Random combinations of three to six abilities each, as users combine them, and all that may follow.

A combination is refused by lines that name file, key and remedy, or its cases complete or fail in words. All
kinds of pictures are drawn of a complete one; it is reported, opened, interpolated at random times against a
run with half the tolerance, and its energies balance, or a warning says by how much not and a remedy that
holds. The pair (S, i) determines it.
"""

from __future__ import annotations

import contextlib
import io
import math
import re
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray
from trials.configurations import Draw, Values, choose, decades, dump
from trials.outcomes import Hangs, Outcome, Wrong, limited

import gfmdlayer
from gfmdlayer import cli
from gfmdlayer.cli.results import KINDS
from gfmdlayer.files.hdf5 import open_hdf5

LONGEST = 90.0  # seconds of processor time for each command
FEWEST, MOST = 3, 6  # abilities of a combination
INPUT = "combination.yaml"


class Combination(NamedTuple):
    """A configuration, the tables that it names, and its abilities."""

    config: Values
    tables: dict[str, str]
    abilities: tuple[str, ...]

    def write(self, folder: Path) -> Path:
        """Write the files into a folder; return that of the configuration."""
        for name, text in self.tables.items():
            (folder / name).write_text(text, encoding="utf-8")
        path = folder / INPUT
        path.write_text(dump(self.config), encoding="utf-8")
        return path


# Drawing. Numbers are multiples of the period L, the modulus G of the layer and its time T.


class Draft:
    """A configuration in the making, with its scales."""

    def __init__(self, rng: Draw) -> None:
        self.rng, self.tables = rng, dict[str, str]()
        self.surface = bool(rng.random() < 0.4)
        self.L, self.G, self.T = 1.0, 1.0, 1.0
        self.duration = 2.0  # times T
        self.config: Values = {}

    def base(self) -> None:
        """Set the sections that every combination has: a punch pressed into a layer and held."""
        rng, n = self.rng, choose(self.rng, 12, 16, [16, 20]) if self.surface else None
        points = [n, n] if isinstance(n, int) else n or choose(rng, 48, 64, 96)
        self.config |= {
            "name": "combination",
            "grid": {"points": points, "period": self.L},
            "layer": {
                "thickness": self.part(0.05, 0.1, 0.3) * self.L,
                "poisson": self.part(0.5, 0.45, 0.3),
                "material": {"model": "zener", "G0": self.G, "Ginf": 5 * self.G, "tau": self.T},
            },
            "halfspace": {
                "shear_modulus": self.part(0.5, 10.0, math.inf) * self.G,
                "poisson": self.part(0.5, 0.3),
            },
            "punch": {"shape": "parabola", "radius": self.part(0.5, 1.0) * self.L},
            "trajectory": {"depth": self.part(0.01, 0.02) * self.L, "ramp_time": 0.5 * self.T},
            "time": {"end": 2.0 * self.T, "step": self.part(0.1, 0.25) * self.T},
        }

    def part(self, *values: float) -> float:
        """Return one of some numbers."""
        return float(choose(self.rng, *values))

    def table(self, name: str, *rows: tuple[float, float]) -> str:
        """Keep a table of two columns; return its name."""
        self.tables[name] = "".join(f"{x!r} {y!r}\n" for x, y in rows)
        return name

    def attract(self, law: Values) -> None:
        """Add a law to the interface."""
        before = self.config.get("interface", [])
        self.config["interface"] = [*before, law]

    @property
    def rubs(self) -> bool:
        """Whether there is a law of friction."""
        return any(law["law"] in ("coulomb", "shear_strength") for law in self.config.get("interface", []))

    @property
    def end(self) -> float:
        """End of the run, which a path of approach and retraction has of itself."""
        return self.duration * self.T

    @property
    def softest(self) -> float:
        """Pressure that presses the surface by about the hundredth of a period."""
        return 0.02 * self.G


def _units(d: Draft) -> None:
    length, stress, time = choose(d.rng, ("m", "Pa", "s"), ("mm", "MPa", "s"), ("um", "kPa", "ms"))
    d.config["units"] = {"length": length, "stress": stress, "time": time}
    scale = {"m": decades(d.rng, -6, -2), "mm": decades(d.rng, -1, 1), "um": decades(d.rng, 0, 2)}[length]
    modulus = {"Pa": decades(d.rng, 3, 7), "MPa": decades(d.rng, -1, 2), "kPa": decades(d.rng, 0, 3)}[stress]
    d.L, d.G, d.T = scale, modulus, decades(d.rng, -3, 1)


def _law(d: Draft) -> None:
    both = {"G0": d.G, "Ginf": 8 * d.G, "tau": d.T}
    branches = [{"G": d.G, "tau": d.T * 10.0**k} for k in range(-2, 2)]
    d.config["layer"]["material"] = choose(
        d.rng,
        {"model": "elastic", "G": 2 * d.G},
        {"model": "elastic", "young": 3 * d.G},
        {"model": "prony", "G0": d.G, "branches": branches},
        {"model": "fractional_zener", "exponent": 0.5, **both},
        {"model": "havriliak_negami", "alpha": 0.6, "gamma": 0.8, **both},
        {"model": "kohlrausch", "exponent": 0.5, **both},
        {"model": "power_law", "G": d.G, "tau": d.T, "exponent": 0.3, "G0": 0.2 * d.G},
        {"model": "zener", "G0": 0, "Ginf": d.G, "tau": d.T},
        {"model": "zener", "G0": d.G, "Ginf": 100 * d.G, "tau": d.T},
    )


def _layers(d: Draft) -> None:
    top = d.config.pop("layer")
    second = {"thickness": d.part(0.1, 0.4) * d.L, "poisson": 0.4}
    second["material"] = choose(
        d.rng,
        {"model": "elastic", "G": d.part(0.3, 5.0) * d.G},
        {"model": "zener", "G0": 0.5 * d.G, "Ginf": 3 * d.G, "tau": 0.2 * d.T},
    )
    d.config["layers"] = [top, second]


def _base(d: Draft) -> None:
    match choose(d.rng, "free", "bare", "relaxing", "deep"):
        case "free":
            d.config["halfspace"]["shear_modulus"] = 0.0
        case "bare":
            d.config["layer"]["thickness"] = 0
            d.config["halfspace"]["shear_modulus"] = d.G
        case "relaxing":
            law = {"model": "zener", "G0": 2 * d.G, "Ginf": 9 * d.G, "tau": 3 * d.T}
            d.config["halfspace"] = {"poisson": 0.4, "material": law}
        case _:
            d.config["layer"]["thickness"] = math.inf


def _temperature(d: Draft) -> None:
    shift = choose(
        d.rng,
        {"law": "wlf", "C1": 8.86, "C2": 101.6, "reference": 20.0},
        {"law": "arrhenius", "activation_energy": 8.0e4, "reference": 20.0},
    )
    for layer in d.config.get("layers") or [d.config.get("layer", {})]:
        if "material" in layer:
            layer["material"]["shift"] = dict(shift)
    rows = (0.0, 20.0), (d.T, 30.0), (2 * d.T, 10.0)
    d.config["temperature"] = choose(d.rng, {"value": 25.0}, {"file": d.table("temperature.txt", *rows)})


def _punch(d: Draft) -> None:
    points = d.config["grid"]["points"]
    coarse = d.L / (min(points) if isinstance(points, list) else points)
    rough = {"hurst": 0.8, "short_cutoff": 4 * coarse, "rms_height": 0.01 * d.L, "seed": 1}
    shapes: list[Values] = [
        {"shape": "sphere", "radius": d.L},
        {"shape": "cylinder", "radius": d.L},
        {"shape": "flat", "width": 0.3 * d.L, "edge_radius": 0.2 * d.L},
        {"shape": "sinusoid", "amplitude": 0.01 * d.L, "wavelength": d.L},
        {"shape": "cone", "slope": 0.1},
        {"shape": "wedge", "slope": 0.1},
        {"shape": "blunted_cone", "slope": 0.2, "tip_radius": 0.2 * d.L},
        {"shape": "pyramid", "angle": 80.0} if d.surface else {"shape": "wedge", "slope": 0.05},
        {"shape": "self_affine", **rough},
        {"shape": "array", "counts": 2, "element": {"shape": "parabola", "radius": d.L}},
    ]
    d.config["punch"] = choose(d.rng, *shapes)


def _adhesion(d: Draft) -> None:
    """An attraction of a range that the grid resolves in some cases."""
    reach = d.part(0.003, 0.01) * d.L
    work = d.part(0.01, 0.1, 0.5) * d.G * reach
    d.attract(
        choose(
            d.rng,
            {"law": "exponential", "work": work, "range": reach},
            {"law": "exponential", "work": work, "range": reach},
            {"law": "dugdale", "work": work, "stress": work / reach},
            {"law": "lennard_jones", "work": work, "separation": reach},
        )
    )


def _voltage(d: Draft) -> None:
    reach = 0.01 * d.L  # a voltage of 1 pulls with a twentieth of the modulus
    vacuum = 0.1 * d.G * reach**2
    rows = (0.0, 0.0), (0.5 * d.T, 0.5), (2 * d.T, 1.0)
    law = {"law": "electrostatic", "insulation": reach, "permittivity": vacuum}
    law["voltage"] = choose(d.rng, 0.5, 1.0, d.table("volt.txt", *rows))
    d.attract(law)


def _hardness(d: Draft) -> None:
    d.attract({"law": "hard_wall", "hardness": d.part(0.1, 0.5, 2.0) * d.G})


def _friction(d: Draft) -> None:
    coulomb = {"law": "coulomb", "coefficient": d.part(0.0, 0.4, 1.0)}
    strength = {"law": "shear_strength", "stress": d.part(0.05, 0.3) * d.G}
    for law in choose(d.rng, (coulomb,), (coulomb,), (strength,), (coulomb, strength)):
        d.attract(law)


def _tangential(d: Draft) -> None:
    if not d.rubs:
        _friction(d)
    drive = choose(
        d.rng,
        {"displacement": d.part(0.002, 0.01) * d.L, "start": 0.5 * d.T, "ramp_time": 0.5 * d.T},
        {"kind": "oscillation", "displacement": 0.004 * d.L, "period": 0.5 * d.T, "start": 0.5 * d.T},
        {"control": "force", "force": 0.0005 * d.G * d.L ** (1 + d.surface), "start": 0.5 * d.T},
    )
    if d.surface:
        drive["direction"] = d.part(0.0, 30.0)
    d.config["trajectory"]["tangential"] = drive


def _motion(d: Draft) -> None:
    d.config["trajectory"]["velocity"] = d.part(-0.3, 0.05, 0.3, 1.0) * d.L / d.T
    if d.rng.random() < 0.3:
        d.config["time"]["steady"] = 1.0e-2
    if d.rubs and d.rng.random() < 0.5:
        d.config["trajectory"]["creepage"] = d.part(0.01, 0.5)


def _counterbody(d: Draft) -> None:
    law = {"model": "zener", "G0": 2 * d.G, "Ginf": 6 * d.G, "tau": 0.5 * d.T}
    d.config["counterbody"] = choose(
        d.rng,
        {"halfspace": {"shear_modulus": 3 * d.G, "poisson": 0.3}},
        {
            "layer": {"thickness": 0.2 * d.L, "poisson": 0.45, "material": law},
            "halfspace": {"shear_modulus": 5 * d.G},
        },
    )


def _body(d: Draft) -> None:
    """A body in place of layers."""
    for key in ("layer", "layers", "halfspace"):
        d.config.pop(key, None)
    points = d.config["grid"]["points"]
    spacing = d.L / (points[0] if isinstance(points, list) else points)
    law = {"model": "zener", "G0": 1.0, "Ginf": 4.0, "tau": d.T}
    rows = [(q / d.L, 2 * d.G * q / d.L) for q in (1.0, 30.0, 1e3)]
    body = choose(
        d.rng,
        {"kind": "anisotropic", "C11": 5 * d.G, "C12": 2 * d.G, "C44": 2.5 * d.G},
        {"kind": "lattice", "crystal": "simple_cubic", "nearest": d.G * spacing,
         "next_nearest": 0.5 * d.G * spacing, "spacing": spacing},
        {"kind": "table", "table": d.table("stiffness.txt", *rows)},
    )  # fmt: skip
    if d.rng.random() < 0.5:
        body["material"] = law
    d.config["body"] = body


def _isolated(d: Draft) -> None:
    d.config["grid"]["boundary"] = "isolated"
    halfspace = d.config.get("halfspace", {}).get("shear_modulus") != math.inf
    if not d.surface and halfspace:
        d.config["grid"]["datum"] = 5 * d.L


def _revolution(d: Draft) -> None:
    d.surface = False
    d.config["grid"] = {"geometry": "axisymmetric", "points": 48, "extent": 1.0 * d.L}
    d.config["time"]["step"] = "adaptive"


def _driven(d: Draft) -> None:
    """A load or a force in place of the depth, for all keys of the trajectory."""
    trajectory = d.config["trajectory"]
    control = choose(d.rng, "load", "force")
    scale = d.softest / (0.02 * d.L)  # of a depth
    if control == "force":
        scale *= d.L ** (1 + d.surface)
    for key in ("depth", "start", "final", "approach_speed", "retract_speed"):
        if key in trajectory:
            value = trajectory.pop(key) * scale
            trajectory[control if key == "depth" else key] = value
    trajectory["control"] = control


def _retraction(d: Draft) -> None:
    trajectory = d.config["trajectory"]
    depth = trajectory["depth"]
    trajectory.pop("ramp_time", None)
    pulls = any("work" in law or "voltage" in law for law in d.config.get("interface", []))
    lowest = d.part(0.0, -0.5, -2.0) * depth if pulls else 0.0
    trajectory |= {"kind": "approach_retract", "start": min(0.0, lowest), "final": lowest}
    trajectory |= {"approach_speed": depth / (0.5 * d.T), "retract_speed": depth / (0.5 * d.T)}
    dwell, cycles = d.part(0.0, 0.5), int(d.part(1, 1, 2))
    trajectory |= {"dwell": dwell * d.T, "cycles": cycles}
    away = 0.5 * (depth - lowest) / depth  # each way
    d.duration = (2 * away + dwell) * cycles
    del d.config["time"]["end"]


def _measured(d: Draft) -> None:
    trajectory = d.config["trajectory"]
    depth = trajectory.pop("depth")
    trajectory.pop("ramp_time", None)
    times = (0.0, 0.3 * d.T, 0.7 * d.T, 1.2 * d.T, 2 * d.T)
    parts = (0.0, 0.8, 1.0, d.part(0.0, 0.4), 0.9)
    rows = zip(times, (part * depth for part in parts), strict=True)
    trajectory |= {"kind": "table", "file": d.table("history.txt", *rows)}


def _adaptive(d: Draft) -> None:
    d.config["time"] |= {"step": "adaptive", "tolerance": d.part(1e-2, 1e-3, 1e-3, 1e-4)}
    if d.rng.random() < 0.4:
        spacing = d.end / 8
        d.config["output"] = d.config.get("output", {}) | {
            "times": choose(d.rng, spacing, [0.5 * d.end, 0.8 * d.end])
        }


def _paper(d: Draft) -> None:
    d.config["time"]["integrator"] = "backward_euler"


def _snapshots(d: Draft) -> None:
    """The name is one of abilities; fields below the surface are another."""
    end = d.end
    times = choose(d.rng, [end], [0.5 * end, end], [0.0, 0.25 * end, end], "every")
    d.config["output"] = d.config.get("output", {}) | {"snapshots": times}


def _inside(d: Draft) -> None:
    _snapshots(d)
    below = choose(d.rng, {"points": 3}, {"depths": [0.01 * d.L, 0.04 * d.L]})
    if d.rng.random() < 0.5:
        below["every"] = 2
    d.config["output"]["inside"] = below


def _columns(d: Draft) -> None:
    """Columns that one asks for."""
    gap = {"max": 0.1 * d.L, "bins": 8}
    pressure = {"min": 1e-3 * d.G, "max": d.G, "bins": 6, "scale": "log"}
    more: Values = {
        "patches": True,
        "histograms": {"gap": gap, "pressure": pressure},
        "leakage": {"every": 3},
        "conductance": {"body": {"resistivity": 1.0}, "every": 2},
        "stiffness": {"frequencies": [0.0, 1.0 / d.T, math.inf], "every": 2},
        "keep_state": True,
    }
    if d.surface:
        more["observables"] = ["critical_gap_x", "spot_radius", "flow_bruggeman"]
    keys = d.rng.choice(list(more), 2, replace=False)
    d.config["output"] = d.config.get("output", {}) | {str(key): more[str(key)] for key in keys}


def _laws(d: Draft) -> None:
    """Write a single law without a list; for all."""
    laws = d.config.get("interface", [])
    if len(laws) == 1:
        d.config["interface"] = laws[0]


def _solver(d: Draft) -> None:
    method = choose(d.rng, "auto", "active_set", "conjugate_gradient", "newton", "fire", "nested_gradient")
    d.config["solver"] = {"method": method, "tolerance": d.part(1e-4, 1e-6, 1e-9)}


def _sweep(d: Draft) -> None:
    """Two or three cases over one key or two: a number, a section, a list, or a grid."""
    config, found = d.config, {}
    numbers = [
        (at, value) for at, value in _numbers(config)
        # `time` is halved by the trial.
        if at.partition(".")[0] not in ("units", "grid", "output", "time") and value not in (0.0, math.inf)
    ]  # fmt: skip
    for _ in range(int(choose(d.rng, 1, 1, 2))):
        at, value = numbers[d.rng.integers(len(numbers))]
        found[at] = [value, value * d.part(0.8, 1.25)]
        if isinstance(value, int):
            found[at] = [value, value + 1]
    law = {"law": "exponential", "work": 1e-3 * d.G * d.L, "range": 0.01 * d.L}
    odd: Values = {
        "interface": [{"law": "hard_wall"}, law],
        "grid.points": [config["grid"]["points"], choose(d.rng, 32, 48, [12, 12])],
        "output.snapshots": [[0.5 * d.end], [0.5 * d.end, d.end]],
        "solver.tolerance": [1e-5, 1e-7],
        "punch": [config["punch"], {"shape": "parabola", "radius": 2 * d.L}],
    }
    if d.rng.random() < 0.4:
        key = str(d.rng.choice(list(odd)))
        found = {at: value for at, value in found.items() if not at.startswith(key)} | {key: odd[key]}
    if len(found) > 1 and d.rng.random() < 0.3:
        found = {"zip": found}
    config["sweep"] = found


def _numbers(tree: Any, at: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted keys of all numbers."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{at}{key}", value
        else:
            yield from _numbers(value, f"{at}{key}.")


# In the order in which they act: each sees the keys of those before.
ABILITIES: Mapping[str, Callable[[Draft], None]] = {
    "units": _units,
    "law": _law,
    "layers": _layers,
    "base": _base,
    "body": _body,
    "temperature": _temperature,
    "isolated": _isolated,
    "punch": _punch,
    "adhesion": _adhesion,
    "voltage": _voltage,
    "hardness": _hardness,
    "friction": _friction,
    "counterbody": _counterbody,
    "retraction": _retraction,
    "load or force": _driven,
    "measured history": _measured,
    "tangential": _tangential,
    "motion": _motion,
    "revolution": _revolution,
    "adaptive": _adaptive,
    "backward Euler": _paper,
    "snapshots": _snapshots,
    "inside": _inside,
    "columns": _columns,
    "solver": _solver,
    "sweep": _sweep,
}
# Each takes away the keys of the other.
APART = (
    {"layers", "base"},
    {"layers", "body"},
    {"law", "body"},
    {"base", "body"},
    {"retraction", "measured history"},
    {"load or force", "measured history"},
)


# Refused together: drawn together in a fifth of the combinations.
_FRICTION = ("friction", "tangential")
_WITHOUT_FRICTION = ("body", "counterbody", "isolated", "solver")
CONTRARY = (
    {"adaptive", "backward Euler"},
    {"motion", "backward Euler"},
    {"isolated", "motion"},
    *({law, other} for law in _FRICTION for other in _WITHOUT_FRICTION),
    *({"inside", other} for other in ("isolated", "body", "revolution")),
    *(
        {"revolution", other}
        for other in (
            *_FRICTION, "adhesion", "voltage", "hardness", "motion", "isolated", "body", "backward Euler",
            "solver", "columns",
        )
    ),
)  # fmt: skip


def combination(seed: int, index: int) -> Combination:
    """Draw three to six abilities, and a configuration that has them."""
    rng = np.random.default_rng((seed, index, MOST))
    count, wanted = rng.integers(FEWEST, MOST + 1), set[str]()
    apart = APART if rng.random() < 0.2 else (*APART, *CONTRARY)
    for name in map(str, rng.permutation(list(ABILITIES))):
        if len(wanted) < count and not any(pair <= {*wanted, name} for pair in apart):
            wanted.add(name)
    draft = Draft(rng)
    if "units" in wanted:
        _units(draft)
    draft.base()
    for name, give in ABILITIES.items():
        if name == "sweep":
            _laws(draft)
        if name in wanted and give is not _units:
            give(draft)
    return Combination(draft.config, draft.tables, tuple(name for name in ABILITIES if name in wanted))


# What follows. Each finding is a `Wrong`: its kind, which is one of the mends, and its details.

_PLACE = re.compile(rf"gfmdlayer: {re.escape(INPUT)}(:\d+:\d+)?: ")
_REMEDY = re.compile(
    r"must|remove|give|set |use |take |needs|only (for|with)|not available|missing|must|choose|change"
)
_FAILURES = ("ConvergenceError",)  # errors whose words are for users

# Kinds of pictures that may be refused, by words: of a line, a single case, without snapshots or friction.
_ALWAYS = (None, "curves", "body")

# Parts of a column's largest value that a linear interpolation between rows may miss, and of the run by which
# a jump may come earlier or later. A picture 80 mm high shows half a percent as the width of its lines.
DRAWN, SHIFTED = 0.01, 0.01
# Sums of local errors, each within the tolerance: over a ramp and its end; half as many for half of it.
SUMMED = 3.0
FIXED = 0.01  # of the work, which the energies may miss with fixed steps; more is a warning
SOLVER = 10.0  # of its tolerances, in each of which a step ends, beside the one of the steps

COLUMNS = ("mean_pressure", "force", "depth", "work", "stored", "dissipated", "contact_area_interpolated")
ENERGIES = ("work", "stored", "dissipated")  # stress times displacement


def trial(seed: int, index: int, folder: Path, kinds: int | None = None) -> Outcome:
    """Run a combination and all that may follow: all kinds of pictures and the report, or some at random."""
    drawn = combination(seed, index)
    drawn.write(folder)
    events = Counter({f"ability: {name}": 1 for name in drawn.abilities})
    rng = np.random.default_rng((seed, index, 7))
    try:
        with contextlib.chdir(folder), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", RuntimeWarning)
            end, found = _followed(drawn, rng, kinds, events)
    except Exception as error:  # of this script, or of what it reads
        return Outcome("error of the trial", _where(error), events)
    texts = [": ".join(wrong.args) for wrong in found]
    if found:
        return Outcome(found[0].args[0], "\n".join([*texts, f"({', '.join(drawn.abilities)})"]), events)
    return Outcome(end, "", events)


class Said(NamedTuple):
    """Exit status of a command and its words."""

    status: int
    out: str
    err: str


def command(*words: str) -> Said:
    """Run a command in this process; errors and hangs are findings."""
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    err = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors="backslashreplace")
    shown = " ".join(words)
    try:
        with limited(LONGEST), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = cli.main(words)
    except Hangs:
        raise Wrong("hangs", f"{shown}: over {LONGEST:.0f} s") from None
    except (Exception, SystemExit) as error:
        raise Wrong(f"traceback of {words[0]}", f"{shown}: {_where(error)}") from None
    texts = []
    for stream in (out, err):
        stream.flush()
        texts.append(stream.buffer.getvalue().decode())  # type: ignore[attr-defined]
    if "Traceback" in "".join(texts):
        raise Wrong(f"traceback of {words[0]}", f"{shown}: {''.join(texts)[-2000:]}")
    return Said(status, *texts)


def _where(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    ways = [f"{frame.filename.rpartition('/')[2]}:{frame.lineno}" for frame in frames[-6:]]
    return f"{type(error).__name__}: {error} ({' > '.join(ways)})"


def _followed(
    drawn: Combination, rng: Draw, kinds: int | None, events: Counter[str]
) -> tuple[str, list[Wrong]]:
    """Check, run, draw, report, open, interpolate and balance a combination; return the end of its run."""
    found: list[Wrong] = []

    def followed(step: Callable[..., Any], *given: Any) -> Any:
        try:
            return step(*given)
        except Wrong as wrong:
            found.append(wrong)
            return None

    run = ("run", INPUT, "--out", "results")
    for words in [("check", INPUT), run] if kinds is None else [run]:
        said = followed(command, *words)
        if said is None or said.status == 2:
            if said is not None:
                followed(_refused, said)
            return "refused", found
    states = followed(_states, said, events)
    if states is not None:
        followed(_drawn, drawn, rng, kinds, states, events)
        if states["complete"]:
            for step in (_opened, _interpolated, _balanced):
                followed(step, drawn, rng, events)
    return "failed in words" if states and states["failed"] else "converged", found


def _refused(said: Said) -> None:
    """Require a line for each mistake, with file, key and remedy."""
    for line in said.err.splitlines():
        if line.startswith("warning"):
            continue
        if not _PLACE.match(line) or not _REMEDY.search(line) or len(line) > 1000:
            raise Wrong("unclear refusal", line)


def _states(ran: Said, events: Counter[str]) -> Counter[str]:
    """Count complete and failed cases; failures have words for users."""
    status = command("status", "results")
    first = status.out.splitlines()[0]
    found = Counter({word: int(number) for number, word in re.findall(r"(\d+) (complete|failed)", first)})
    for reason in re.findall(r"^  \d+ failed: (.*)", status.out, re.MULTILINE):
        if not reason.startswith(_FAILURES):
            raise Wrong("failure without words", reason)
        events[f"failed: {re.sub(r'[-+.0-9e]*[0-9]', '#', reason)[:90]}"] += 1
    if ran.status != (1 if found["failed"] else 0):
        raise Wrong("status of run", f"{ran.status} with {dict(found)}: {ran.err[-500:]}")
    return found


def _drawn(
    drawn: Combination, rng: Draw, kinds: int | None, states: Counter[str], events: Counter[str]
) -> None:
    """Draw, report: pictures, or lines that say why there is none."""
    every: list[tuple[str, ...]] = [(), *(("--kind", kind) for kind in KINDS), ("--movie",)]
    if "sweep" in drawn.config:
        every.append(("--x", str(next(iter(_swept(drawn.config))))))
    if states["complete"]:
        with gfmdlayer.open_results("results") as data:
            rows = {"time", "row"}
            columns = [str(name) for name in data if rows & {*map(str, data[name].dims)}]
        every.append(("--y", *map(str, rng.choice(columns, 2))))
    every.append(("report",))
    if kinds is not None:
        every = [every[i] for i in rng.permutation(len(every))[:kinds]]
    wrong = [
        _picture(number, options, bool(states["complete"]), events) for number, options in enumerate(every)
    ]
    if any(wrong):
        raise Wrong("no picture", "; ".join(filter(None, wrong)))


def _picture(number: int, options: tuple[str, ...], complete: bool, events: Counter[str]) -> str:
    """Draw a picture, or write the report; return why there should have been one."""
    file = f"pictures/{number}.{'gif' if '--movie' in options else 'png'}"
    words = ("plot", "results", *options, "--out", file) if options != ("report",) else ("report", "results")
    try:
        said = command(*words)
    except Wrong as wrong:
        return ": ".join(wrong.args)
    kind = options[0] if options[:1] in (("--y",), ("--x",)) else " ".join(options) or "default"
    events[f"{'drawn' if said.status == 0 else 'no picture'}: {kind}"] += 1
    if said.status == 0:
        return ""
    if said.status == 2 and re.fullmatch(r"(warning: .*\n)*gfmdlayer: \S.*\n", said.err):
        events[f"words: {re.sub(r'[0-9]+', '#', said.err.strip())[:100]}"] += 1
        if not complete and options != ("report",):
            return ""
        if options not in ((), ("--kind", "curves"), ("--kind", "body"), ("report",)):
            return ""
    return f"{' '.join(words)}: status {said.status}: {said.err[-600:]}"


def _swept(config: Values) -> Values:
    sweep = config.get("sweep", {})
    return dict(sweep.get("zip", sweep))


def _opened(drawn: Combination, *_: object) -> None:
    """Load all data; numbers are finite, and fields agree with the columns of their rows."""
    try:
        with gfmdlayer.open_results("results") as data:
            data.load()
    except Exception as error:
        raise Wrong("open_results fails", _where(error)) from None
    for path in sorted(Path("results/cases").glob("*.h5")):
        try:
            with gfmdlayer.open_case(path) as data:
                data.load()
        except Exception as error:
            raise Wrong("open_case fails", _where(error)) from None
        _sound(data, isolated=drawn.config["grid"].get("boundary", "periodic") != "periodic")
        if drawn.config["grid"].keys() <= {"points", "period"}:
            period = np.broadcast_to(
                drawn.config["grid"]["period"], data["pressure"].ndim - 1 if "pressure" in data else 1
            )
            _consistent(data, float(np.prod(period)))


# Columns that are NaN by their meaning: without contact, in rows between two measurements, where an event
# does not happen. Each is named in its declaration.
_NAN = re.compile(
    r"friction|contact_centre|creepage|slip|restick|flow|hydraulic|critical_gap|spot_radius|resistance|storage|loss"
    r"|imbalance|percolat|leak|interface_|mises|largest|conduct|time_of|throat|stress|margin"
)


def _sound(data: xarray.Dataset, *, isolated: bool) -> None:
    """Require finite numbers but where NaN has a meaning; fields of an isolated contact end at its reach."""
    for name, values in data.data_vars.items():
        if str(name).endswith(("_bin_start", "_bin_end")):  # of all values beyond
            continue
        if isolated and "snapshot" in values.dims:
            continue
        if values.dtype.kind == "f" and not _NAN.search(str(name)) and not np.isfinite(values).all():
            raise Wrong("not finite", f"{name}: {np.asarray(values).ravel()[:8]}")


def _consistent(data: xarray.Dataset, area: float) -> None:
    """Compare the mean of the pressure in snapshots with the force of their rows."""
    if not data.sizes.get("snapshot") or "pressure" not in data:
        return
    mean = data["pressure"].mean([axis for axis in ("x", "y") if axis in data["pressure"].dims])
    rows = data["force"].sel(time=data["snapshot"].values, method="nearest").values / area
    scale = float(abs(data["pressure"]).max()) or 1.0
    if (lack := float(abs(mean.values - rows).max()) / scale) > 1e-5:
        raise Wrong("fields and columns differ", f"mean pressure by {lack:.2g} of the largest pressure")


def _again(out: Path, changed: Values) -> dict[Path, Path]:
    """Run with other keys; return complete cases of both runs."""
    if not out.exists():
        try:
            with limited(2 * LONGEST):
                gfmdlayer.run(INPUT, out=out, progress=False, **changed).close()
        except Hangs:
            raise Wrong("hangs", f"with {changed}") from None
        except gfmdlayer.ConvergenceError:
            pass
        except gfmdlayer.ConfigError as error:
            raise Wrong("shorter steps are refused", str(error)) from None
        except Exception as error:
            raise Wrong("traceback of gfmdlayer.run", f"{changed}: {_where(error)}") from None
    both = {path: out / "cases" / path.name for path in sorted(Path("results/cases").glob("*.h5"))}
    return {first: second for first, second in both.items() if second.exists()}


def _interpolated(drawn: Combination, rng: Draw, _: object) -> None:
    """Compare interpolations of rows of adaptive steps at random times with a run of half the tolerance."""
    section = drawn.config["time"]
    if section["step"] == "adaptive":
        tolerance = section.get("tolerance", 1e-4)
        for first, second in _again(Path("again"), {"time.tolerance": tolerance / 2}).items():
            _interpolate(first, second, rng, tolerance, yields="hardness" in drawn.abilities)


_COARSE = re.compile(r"COARSE: .*; take more grid\.points: \[?(\d+)")  # along each axis
_OPEN = re.compile(r"UNBALANCED: .*; use time\.(step|tolerance) ([-.0-9e]+)(, or more grid\.points)?")


def _balanced(drawn: Combination, _: Draw, events: Counter[str]) -> None:
    """Require balances that are closed, or a warning; with its remedy they are."""
    section, key, remedies, wider, enough = drawn.config["time"], "", [], False, 0
    tolerance = section.get("tolerance", 1e-4)
    limit = FIXED
    if section["step"] == "adaptive":
        limit = SUMMED * (tolerance + SOLVER * drawn.config.get("solver", {}).get("tolerance", 1e-6))
    open_cases = []
    for path in sorted(Path("results/cases").glob("*.h5")):
        lack = _balance(path)
        said = _said(path)
        found = _OPEN.search(said)
        if lack > limit and found is None:
            raise Wrong(
                "balance", f"{path.stem}: {lack:.3g} of the largest energy, above {limit:g}, not said"
            )
        if found is not None:
            key, value, points = found.groups()
            remedies.append(float(value))
            open_cases.append(path)
            wider = wider or bool(points)
            if coarse := _COARSE.search(said):
                enough = max(enough, int(coarse[1]))
    if not remedies:
        return
    events[f"open balance, said: time.{key}"] += 1
    changed: Values = {f"time.{key}": min(remedies)}
    if wider and not any(at.startswith("grid") for at in _swept(drawn.config)):
        points = drawn.config["grid"]["points"]
        finer = [max(4 * n, enough) for n in (points if isinstance(points, list) else [points])]
        changed["grid.points"] = finer if isinstance(points, list) else finer[0]
    try:
        closer = _again(Path("remedied"), changed)
    except Wrong as wrong:
        if wrong.args[0] != "hangs":
            raise
        events["open balance, remedy too long"] += 1
        return
    for path in open_cases:
        if path in closer and (left := _balance(closer[path])) > limit:
            raise Wrong("remedy", f"{path.stem}: {_balance(path):.3g} open, {left:.3g} with {changed}")


def _numbers_of(path: Path) -> dict[str, Any]:
    """Return the columns of a case, without the time that xarray takes to describe them."""
    with open_hdf5(path) as h5:
        shape = h5["time"].shape
        return {name: h5[name][()] for name in h5 if getattr(h5[name], "shape", None) == shape}


def _said(path: Path) -> str:
    """Return the warnings of a case."""
    with open_hdf5(path) as h5:
        return str(h5.attrs.get("warnings", ""))


def _balance(path: Path) -> float:
    """Return the largest lack of the energy balance over the largest energy."""
    columns = _numbers_of(path)
    energies = (columns["work"], columns["stored"] + columns["dissipated"])
    scale = max(float(abs(each).max()) for each in energies)
    return float(abs(columns["energy_residual"]).max()) / scale if scale else 0.0


def _interpolate(first: Path, second: Path, rng: Draw, tolerance: float, *, yields: bool) -> None:
    """Compare linear interpolations of rows at random times with a finer run, up to small shifts in time."""
    own, finer = _numbers_of(first), _numbers_of(second)
    t, s = own["time"], finer["time"]
    end = min(t[-1], s[-1])
    if end <= 0:
        return
    # Of a contact that says it has few points, a ring of them joins at once.
    coarse = _COARSE.search(_said(first)) is not None
    for name in COLUMNS:
        if name not in own or (coarse and name.startswith("contact_area")):
            continue
        values, others = own[name], finer[name]
        largest = float(np.abs(others).max())
        # Whole points come into contact; a line of 48, or a surface of 12 x 12. Each that yields carries the
        # hardness, so that forces and energies rise by whole points too.
        usual = DRAWN + SUMMED * (tolerance + tolerance / 2) + (yields or name.startswith("contact_area")) / 6
        for at in rng.uniform(0, end, 40):
            value = np.interp(at, t, values)
            most = (usual + (name in ENERGIES) * _chord(own, int(np.searchsorted(t, at)))) * largest
            near = np.array([at - SHIFTED * end, at + SHIFTED * end])
            around = [*np.interp(near, s, others), *others[(s > near[0]) & (s < near[1])]]
            miss = max(min(around) - value, value - max(around))
            if miss > most:
                known = f"{value:.5g} for {np.interp(at, s, others):.5g}, {miss / largest:.3g} of its largest"
                rows = f"{len(t)} and {len(s)} rows"
                raise Wrong(
                    "interpolation", f"{first.name}: {name} at t = {at:.4g} of {end:.4g}: {known}; {rows}"
                )


def _chord(columns: Mapping[str, Any], row: int) -> float:
    """Return the part by which a chord misses an energy, beyond that of a column, in the step to a row.

    A product of two factors, each a line within `DRAWN`, is a parabola: in its middle the chord misses it by
    a quarter of the product of their changes.
    """
    change = 0.0
    for values in (columns[name] for name in ("mean_pressure", "force", "depth") if name in columns):
        largest = float(np.abs(values).max())
        change = max(change, abs(float(values[row] - values[row - 1])) / largest if largest else 0.0)
    return DRAWN + change**2 / 4
