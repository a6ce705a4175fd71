"""Random configurations for all trials, far beyond the range of measurements.

Films of a millionth of the period and layers of a million periods, moduli over sixteen decades, compressible
and auxetic bodies, thirty branches over twenty decades of time, loads that jump, vanish and return, sliding,
odd and prime numbers of points. The pair (S, i) determines case i of seed S.
"""

from __future__ import annotations

import copy
import json
import re
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from ruamel.yaml import YAML

import gfmdlayer
from gfmdlayer.case.case import Case
from gfmdlayer.contact.solvers import SOLVERS

DEFAULT = "active_set"
LINES = (8, 9, 16, 31, 64, 97, 128, 135, 255, 256)
SURFACES = ([8, 8], [9, 13], [16, 16], [31, 16], [32, 32])

Draw = np.random.Generator
Values = dict[str, Any]


class Drawn(NamedTuple):
    """A configuration and the table of its trajectory, if it has one."""

    config: Values
    history: tuple[list[float], list[float]] | None


def draw(seed: int, index: int, methods: tuple[str, ...] = (DEFAULT,), shapes: tuple[Any, ...] = ()) -> Drawn:
    """Draw a case with one of the solvers, on one of the grids (default: `LINES` and `SURFACES`)."""
    rng = np.random.default_rng((seed, index))
    points: Any = choose(rng, *(shapes or (LINES if rng.random() < 0.8 else SURFACES)))
    period = choose(rng, 1.0, decades(rng, -9, 9))
    config = {"name": f"extreme-{seed}-{index}", "grid": {"points": points, "period": period}}
    config |= body(rng, period)
    spacing = period / (min(points) if isinstance(points, list) else points)
    config["punch"] = punch(rng, period, spacing)
    most, end, softest = scales(config, rng)
    height = most
    control = choose(rng, "depth", "load", "force")
    if control != "depth":
        most *= softest
    if control == "force":
        most *= period ** (2 if isinstance(points, list) else 1)
    config["trajectory"] = {"control": control}
    history = trajectory(rng, config["trajectory"], control, most, end)
    steps = int(rng.integers(1, 8))
    config["time"] = {
        "end": end,
        "step": end / steps,
        "integrator": choose(rng, "exponential", "backward_euler"),
    }
    if rng.random() < 0.1:
        config["time"] |= {"step": "adaptive", "integrator": "exponential", "tolerance": decades(rng, -3, -1)}
    if rng.random() < 0.1:
        config["time"]["integrator"] = "exponential"  # which alone follows a moving punch
        config["trajectory"]["velocity"] = choose(rng, -1, 1) * period / end * decades(rng, -2, 1)
    config["solver"] = {
        "method": str(rng.choice(methods)),
        "tolerance": choose(rng, 1e-6, decades(rng, -8, -3)),
    }
    if SOLVERS[config["solver"]["method"]].adhesive and "velocity" not in config["trajectory"]:
        config |= adhesion(rng, height, softest)
    return Drawn(config, history)


def choose(rng: Draw, *values: Any) -> Any:
    """Return one of the values."""
    return values[rng.integers(len(values))]


def decades(rng: Draw, lowest: float, highest: float) -> float:
    """Return a number with a uniform logarithm."""
    return float(f"{10 ** rng.uniform(lowest, highest):.4g}")


def body(rng: Draw, period: float) -> Values:
    """Layers on a halfspace."""
    G0 = choose(rng, 1.0, decades(rng, -9, 9))
    bulk = choose(rng, np.inf, 0.0, 1.0, decades(rng, -8, 8), decades(rng, -8, 8), decades(rng, -3, 3))
    if rng.random() < 0.1:
        layers = [layer(rng, G0, period) for _ in range(rng.integers(2, 4))]
        return {"layers": layers, "halfspace": {"shear_modulus": bulk * G0, "poisson": poisson(rng)}}
    one = layer(rng, G0, period)
    if rng.random() < 0.1:
        one["thickness"] = choose(rng, 0.0, np.inf)
        bulk = 1.0 if bulk in {0.0, np.inf} else bulk
    return {"layer": one, "halfspace": {"shear_modulus": bulk * G0, "poisson": poisson(rng)}}


def poisson(rng: Draw) -> float:
    """Return Poisson's ratio, often 0.5 or close to it."""
    return float(
        choose(rng, 0.5, 0.5, choose(rng, 0.4999999, 0.49, 0.0, -0.9), round(rng.uniform(-0.9, 0.5), 3))
    )


def layer(rng: Draw, G0: float, period: float) -> Values:
    """Return a layer; its modulus and time vary by a random factor."""
    G0 *= choose(rng, 1.0, decades(rng, -2, 2))
    tau = choose(rng, 1.0, decades(rng, -6, 6))
    match choose(rng, "elastic", "zener", "zener", "prony", "prony"):
        case "elastic":
            material: Values = {"model": "elastic", "G": G0}
        case "zener":
            material = {"model": "zener", "G0": G0, "Ginf": G0 * decades(rng, 0.001, 8), "tau": tau}
        case _:
            count = choose(rng, 1, 3, 30)
            times = tau * 10.0 ** rng.uniform(-10, 10, count)
            moduli = G0 * 10.0 ** rng.uniform(-4, 8, count)
            branches = [{"G": G, "tau": t} for G, t in zip(moduli.tolist(), times.tolist(), strict=True)]
            material = {"model": "prony", "G0": G0, "branches": branches}
    thickness = period * choose(rng, 0.05, decades(rng, -6, 6), decades(rng, -3, 0))
    return {"thickness": thickness, "poisson": poisson(rng), "material": material}


def punch(rng: Draw, period: float, spacing: float) -> Values:
    """A punch in a cell."""
    slope = choose(rng, decades(rng, -4, 1), 1.0)
    parabola = {"shape": "parabola", "radius": period / slope}
    return dict(
        choose(
            rng,
            parabola,
            {"shape": "wedge", "slope": slope},
            {"shape": "cone", "slope": slope},
            {"shape": "flat", "width": 0.3 * period, "edge_radius": 0.2 * period},
            {"shape": "sinusoid", "amplitude": slope * period, "wavelength": period / 2},
            {"shape": "array", "counts": 2, "element": parabola},
            {
                "shape": "self_affine",
                "hurst": rng.uniform(0.1, 1.0),
                "short_cutoff": rng.uniform(2.1 * spacing, max(2.1 * spacing, period)),
                "seed": int(rng.integers(100)),
                "rms_slope": slope,
            },
        )
    )


def scales(config: Values, rng: Draw) -> tuple[float, float, float]:
    """Largest depth and duration of a history, and stiffness of the lowest mode at its beginning."""
    bare = gfmdlayer.Config.model_validate({**config, "trajectory": {"depth": 0.0}})
    case = Case(bare)
    times = [tau for law in bare.laws for _, tau in law.maxwell_branches] or [1.0]
    end = choose(rng, *times) * decades(rng, -3, 3)
    kappa, _ = case.contact.history.terms(0.0)
    height = float(case.punch.mean())
    if kappa[0] > 0:  # may be pressed deeper than the cell holds
        height *= choose(rng, 1.0, 10.0)
    return 0.95 * height, end, float(kappa[1:].min())


def trajectory(
    rng: Draw, section: Values, control: str, most: float, end: float
) -> tuple[list[float], list[float]] | None:
    """Fill the section of the trajectory, or return the table of one."""

    def part() -> float:
        return float(choose(rng, rng.uniform(1e-3, 1), rng.uniform(1e-3, 1), 0.0, 1.0, decades(rng, -4, 0)))

    match choose(rng, "ramp_hold", "approach_retract", "table", "table"):
        case "ramp_hold":
            section |= {control: most * part(), "ramp_time": end * choose(rng, 1e-3, 0.5, 1.0, 10.0)}
        case "approach_retract":
            peak = most * (part() or 0.5)
            section |= {"kind": "approach_retract", control: peak, "approach_speed": 3 * peak / end}
            section |= {"dwell": end / 4, "retract_speed": 4 * peak / end, "cycles": int(rng.integers(1, 3))}
        case _:
            times = np.linspace(0, end, int(rng.integers(2, 7)))
            if rng.random() < 0.5:  # jumps: to another value within a part of the step
                times = np.sort(np.append(times, times[:-1] + 1e-6 * end))
            return times.tolist(), [most * part() for _ in times]
    return None


def adhesion(rng: Draw, height: float, softest: float) -> Values:
    """An interface that attracts, in half of the cases."""
    reach = height * decades(rng, -4, 0)
    law = {"law": "exponential", "range": reach, "work": softest * reach**2 * decades(rng, -4, 2)}
    return {"interface": law} if rng.random() < 0.5 else {}


def dump(tree: Values) -> str:
    """Return plain data as YAML, a line for each section."""
    return "".join(f"{_flow(key)}: {_flow(value)}\n" for key, value in tree.items())


def _flow(value: Any) -> str:
    """Return plain data as JSON, which YAML understands but for numbers that are not finite."""
    text = json.dumps(value, default=str, ensure_ascii=False)
    return re.sub(r"\bNaN\b", ".nan", re.sub(r"\bInfinity\b", ".inf", text))


def parse(text: str) -> Any:
    """Return the plain data of a YAML text."""
    return copy.deepcopy(_parsed(text))


@lru_cache(100)
def _parsed(text: str) -> Any:
    return YAML(typ="safe").load(text)
