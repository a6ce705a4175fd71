"""Estimated against true errors: 40 cases with known limits, and random variations of each.

    python scripts/trials/convergence.py FILE [--variations N] [--seed S] [--only NAME ...] [--reach EVERY]

Each case is estimated by `gfmdlayer.converge`. The truth is the same case on 16 times the points of a line,
or 6 times those along each axis of a surface, with a quarter of the step (backward Euler: a 64th) or a
hundredth of the tolerance of the steps, and a residual of 1e-9: with an error of a fifteenth or less of that
of the case. FILE has a line of JSON for each case: a run that is stopped goes on. With --reach the suggested
configuration of every so-many-th case is computed too, and held to the truth.
"""

from __future__ import annotations

import argparse
import copy
import json
import math
import sys
import time
import warnings
import zlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import gfmdlayer
from gfmdlayer.convergence.converge import AskedErrors, Run, base_case, better, converge
from gfmdlayer.convergence.variants import COUNTED

Keys = dict[str, Any]
FINER = {1: 16, 2: 6}  # points of the truth
LEAST = 1e-7  # relative error that counts
ASKED = 3e-3

_RIGID = {"shear_modulus": math.inf}
_ZENER = {"model": "zener", "G0": 1.0, "Ginf": 5.0, "tau": 1.0}
_SOFT = {"thickness": 1.0, "material": {"model": "elastic", "G": 1.0}}
_DEEP = {"layer": _SOFT, "halfspace": {"shear_modulus": 1.0, "poisson": 0.5}}


def _ramp(control: str, value: float, time: float = 1.0) -> Keys:
    drive = {control: value, "ramp_time": time}
    return drive if control == "depth" else {"control": control} | drive


def _loop(depth: float, **more: Any) -> Keys:
    speeds = {"approach_speed": depth, "retract_speed": depth}
    return {"kind": "approach_retract", "start": 0.0, "final": 0.0, "depth": depth} | speeds | more


def _case(
    points: Any, punch: Keys, trajectory: Keys, step: Any = 0.25, end: float = 1.0, **sections: Any
) -> Keys:
    time = {"end": end, "step": step} if step != "adaptive" else {"end": end, "step": step, "tolerance": 1e-3}
    grid = {"points": points} | sections.pop("grid", {})
    held = {"name": "trial", "grid": grid, "punch": punch, "trajectory": trajectory, "time": time}
    return held | {"time": time | sections.pop("time", {})} | sections


def _parabola(radius: float) -> Keys:
    return {"shape": "parabola", "radius": radius}


def _zener(thickness: float, poisson: float = 0.5, shear: float = math.inf) -> Keys:
    layer = {"thickness": thickness, "poisson": poisson, "material": _ZENER}
    return {"layer": layer, "halfspace": {"shear_modulus": shear, "poisson": 0.5}}


def cases() -> dict[str, Keys]:
    """Return the cases by name."""
    held, rough = (
        _loop(0.01),
        {"shape": "self_affine", "hurst": 0.8, "short_cutoff": 0.2, "rms_slope": 0.1, "seed": 3},
    )
    fractional = {"model": "fractional_zener", "G0": 1.0, "Ginf": 5.0, "tau": 1.0, "exponent": 0.5}
    prony = {"model": "prony", "G0": 1.0, "branches": [{"G": 2.0, "tau": 0.3}, {"G": 1.0, "tau": 3.0}]}
    stack = [
        {"thickness": 0.03, "poisson": 0.4, "material": {"model": "elastic", "G": 4.0}},
        {"thickness": 0.1, "poisson": 0.45, "material": _ZENER},
    ]
    attracting = {"law": "exponential", "work": 2e-4, "range": 0.01}
    rubbing = {"law": "coulomb", "coefficient": 0.4}
    sphere = _parabola(0.8)
    return {
        "hertz line": _case(72, _parabola(0.4), _ramp("load", 0.1), **_DEEP),
        "hertz line, light": _case(120, _parabola(0.4), _ramp("load", 0.02), **_DEEP),
        "westergaard": _case(
            64, {"shape": "sinusoid", "amplitude": 0.02, "wavelength": 1.0}, _ramp("load", 0.04), **_DEEP
        ),
        "wedge": _case(90, {"shape": "wedge", "slope": 0.1}, _ramp("load", 0.03), **_DEEP),
        "cylinder": _case(80, {"shape": "cylinder", "radius": 0.6}, _ramp("depth", 0.004), **_zener(0.1)),
        "array": _case(
            144, {"shape": "array", "counts": 3, "element": _parabola(0.3)}, _ramp("load", 0.05), **_DEEP
        ),
        "zener hold": _case(96, _parabola(1.0), _ramp("depth", 0.01), 0.1, 3.0, **_zener(0.1)),
        "zener euler": _case(
            96,
            _parabola(1.0),
            _ramp("depth", 0.01),
            0.1,
            2.0,
            time={"integrator": "backward_euler"},
            **_zener(0.1),
        ),
        "zener adaptive": _case(96, _parabola(1.0), _ramp("depth", 0.01), "adaptive", 3.0, **_zener(0.1)),
        "zener load": _case(96, _parabola(1.0), _ramp("load", 0.05), 0.1, 3.0, **_zener(0.1, shear=10.0)),
        "creep adaptive": _case(
            80, _parabola(0.7), _ramp("load", 0.03, 0.2), "adaptive", 3.0, **_zener(0.2, shear=4.0)
        ),
        "loop": _case(96, _parabola(1.0), held, 0.1, 2.0, **_zener(0.1, 0.4)),
        "loop adaptive": _case(108, _parabola(1.0), held, "adaptive", 2.0, **_zener(0.1, 0.4)),
        "two cycles": _case(96, _parabola(1.0), _loop(0.01, cycles=2), 0.1, 4.0, **_zener(0.15, 0.45)),
        "fractional": _case(
            80,
            _parabola(1.0),
            _ramp("depth", 0.01),
            0.1,
            2.0,
            layer={"thickness": 0.1, "material": fractional},
        ),
        "prony": _case(
            96, _parabola(1.0), _ramp("depth", 0.01), 0.1, 3.0, layer={"thickness": 0.1, "material": prony}
        ),
        "stack": _case(
            128,
            _parabola(0.8),
            _ramp("depth", 0.006),
            0.1,
            2.0,
            layers=stack,
            halfspace={"shear_modulus": 10.0},
        ),
        "thin": _case(
            96,
            _parabola(1.0),
            _ramp("depth", 0.002),
            layer={"thickness": 0.02, "poisson": 0.4},
            halfspace=_RIGID,
        ),
        "thinner": _case(
            120,
            _parabola(1.0),
            _ramp("depth", 0.002),
            layer={"thickness": 0.01, "poisson": 0.3},
            halfspace=_RIGID,
        ),
        "thin, nu 1/2": _case(
            128, _parabola(1.0), _ramp("depth", 0.002), layer={"thickness": 0.02}, halfspace=_RIGID
        ),
        "stiff coat": _case(
            128,
            _parabola(0.6),
            _ramp("load", 0.05),
            layer={"thickness": 0.02, "material": {"model": "elastic", "G": 20.0}},
            halfspace={"shear_modulus": 1.0},
        ),
        "rolling": _case(
            128, _parabola(1.0), _ramp("depth", 0.01) | {"velocity": 0.2}, 0.05, 2.0, **_zener(0.1)
        ),
        "rolling load": _case(
            128, _parabola(0.7), _ramp("load", 0.04) | {"velocity": 0.4}, 0.05, 2.0, **_zener(0.2, shear=10.0)
        ),
        "rolling adaptive": _case(
            96,
            _parabola(0.7),
            _ramp("load", 0.04) | {"velocity": 0.1},
            "adaptive",
            2.0,
            **_zener(0.2, shear=10.0),
        ),
        "adhesive line": _case(
            120, _parabola(0.8), _loop(0.008), 0.05, 2.0, interface=attracting, **_zener(0.2, 0.45, 5.0)
        ),
        "adhesive adaptive": _case(
            96, _parabola(0.8), _loop(0.008), "adaptive", 2.0, interface=attracting, **_zener(0.2, 0.45, 5.0)
        ),
        "hard": _case(
            96, _parabola(0.5), _ramp("load", 0.05), interface={"law": "hard_wall", "hardness": 0.5}, **_DEEP
        ),
        "friction": _case(
            64,
            _parabola(0.8),
            _ramp("load", 0.03, 0.5)
            | {"tangential": {"kind": "ramp", "displacement": 0.004, "start": 0.5, "ramp_time": 0.5}},
            0.05,
            1.0,
            interface=rubbing,
            **_zener(0.2, 0.4, 5.0),
        ),
        "rough line": _case(128, rough, _ramp("load", 0.02), **_DEEP),
        "rough zener": _case(
            160, rough | {"seed": 5}, _ramp("load", 0.02), 0.1, 1.0, **_zener(0.2, 0.45, 5.0)
        ),
        "hertz sphere": _case([24, 24], sphere, _ramp("force", 0.05), **_DEEP),
        "sphere by depth": _case([20, 20], sphere, _ramp("depth", 0.01), **_zener(0.2)),
        "sphere on a thin layer": _case(
            [32, 32],
            _parabola(1.0),
            _ramp("depth", 0.006),
            layer={"thickness": 0.04, "poisson": 0.4},
            halfspace=_RIGID,
        ),
        "cone": _case([24, 24], {"shape": "cone", "slope": 0.15}, _ramp("force", 0.03), **_DEEP),
        "pyramid": _case(
            [24, 24], {"shape": "pyramid", "angle": 80.0, "faces": 4}, _ramp("force", 0.03), **_DEEP
        ),
        "sphere, loop": _case([20, 20], sphere, _loop(0.01), 0.1, 2.0, **_zener(0.1, 0.45)),
        "isolated sphere": _case(
            [24, 24], sphere, _ramp("force", 0.03), grid={"boundary": "isolated"}, **_DEEP
        ),
        "isolated zener": _case(
            [20, 20], sphere, _ramp("depth", 0.01), 0.1, 1.0, grid={"boundary": "isolated"}, **_zener(0.2)
        ),
        "rough": _case([36, 36], rough | {"short_cutoff": 0.25}, _ramp("load", 0.02), **_DEEP),
        "rough layer": _case(
            [32, 32], rough | {"short_cutoff": 0.3, "seed": 8}, _ramp("load", 0.02), **_zener(0.2, 0.45, 5.0)
        ),
    }


def varied(config: Keys, rng: np.random.Generator) -> Keys:
    """Return a case with other sizes, points and steps."""
    config = copy.deepcopy(config)

    def times(section: Keys, key: str, low: float, high: float) -> None:
        if isinstance(section.get(key), float) and math.isfinite(section[key]):
            section[key] = float(f"{section[key] * rng.uniform(low, high):.4g}")

    punch = config["punch"].get("element", config["punch"])
    times(punch, "radius", 1.0 if punch["shape"] == "cylinder" else 0.7, 1.4)  # which is as wide as the cell
    for key in ("depth", "load", "force"):
        times(config["trajectory"], key, 0.6, 1.2)
    if config["trajectory"].get("kind") == "approach_retract":
        depth = config["trajectory"]["depth"]
        cycles = config["trajectory"].get("cycles", 1)
        config["trajectory"] |= {"approach_speed": depth, "retract_speed": depth}
        config["time"]["end"] = 2.0 * cycles
    for layer in [config.get("layer", {}), *config.get("layers", [])]:
        times(layer, "thickness", 0.7, 1.2)
    points = config["grid"]["points"]
    factor = rng.uniform(0.75, 1.35)
    fine = [2 * round(n * factor / 2) for n in (points if isinstance(points, list) else [points])]
    config["grid"]["points"] = fine if isinstance(points, list) else fine[0]
    if isinstance(config["time"]["step"], float):
        pieces = round(config["time"]["end"] / config["time"]["step"] * rng.uniform(0.7, 1.4))
        config["time"]["step"] = config["time"]["end"] / max(pieces, 4)
    if "seed" in punch:
        punch["seed"] = int(rng.integers(1, 1000))
    return config


def trials(variations: int, seed: int = 0) -> Iterator[tuple[str, Keys]]:
    """Yield the cases, then their variations in turn, each with its name."""
    for number in range(variations + 1):
        for name, config in cases().items():
            rng = np.random.default_rng([seed, number, zlib.crc32(name.encode())])
            yield f"{name} {number}", varied(config, rng) if number else copy.deepcopy(config)


def truth_of(config: gfmdlayer.Config) -> gfmdlayer.Config:
    """Return a case with errors of about a hundredth of those of another one."""
    grid, clock = config.grid, config.time
    factor = FINER[len(grid.points)]
    keys: Keys = {"grid.points": [factor * n for n in grid.points], "solver.tolerance": 1e-9}
    if isinstance(clock.step, float):
        more = 4 if clock.integrator == "exponential" else 64
        keys["time.step"] = clock.step / (more if len(grid.points) == 1 else 4)
    else:
        keys["time.tolerance"] = (clock.tolerance or 1e-4) / 100
    return config.with_values(keys)


def _run(config: gfmdlayer.Config) -> Run:
    data = gfmdlayer.run(config, progress=False)
    held = {str(n): np.asarray(v, float) for n, v in data.data_vars.items() if v.dims == ("time",)}
    return Run(data["time"].to_numpy(), held, dict(data.attrs))


def judged(name: str, given: Keys, *, reach: bool = False) -> Keys:
    """Estimate a case, compute its truth, and return both errors of each number, relative to its scale."""
    begun = time.process_time()
    config = gfmdlayer.Config.model_validate(given)
    found = converge(config, to=ASKED, progress=False)
    spent = time.process_time() - begun
    asked = AskedErrors()
    base, times = base_case(config, asked)
    if config.time.step == "adaptive":
        base = base.with_values({"output.times": times})
    own, truth = _run(base), _run(truth_of(base))
    data, numbers = found.data, []
    common = np.atleast_1d(data.attrs["times"])
    for i, (column, moment) in enumerate(zip(data["column"].values, data["moment"].values, strict=True)):
        error, scale = float(data["error"][i]), float(data["scale"][i])
        if not math.isfinite(error) or str(data["verdict"].values[i]) == "prescribed":
            continue
        off = true_error(own, truth, str(column), str(moment), common) / scale
        if off > LEAST:
            noted = bool(str(data["note"].values[i])) or any("too small" in n for n in found.notes)
            numbers.append(
                (str(column), str(moment), off, error / scale, noted, _richer(data, i, truth, scale))
            )
    line: Keys = {"name": name, "numbers": numbers, "seconds": time.process_time() - begun, "spent": spent}
    line |= {"work": float(data.attrs["work"]), "axes": len(config.grid.points), "notes": list(found.notes)}
    line["failed"] = list(found.failed)
    if reach and found.suggested:
        line["reached"] = _reached(base, found, truth, common)
        line["limited"] = any("ask again" in note for note in found.notes)
    return line


def true_error(own: Run, truth: Run, column: str, moment: str, common: np.ndarray) -> float:
    """Return the error of a number."""
    if column not in truth.columns:
        return math.nan
    if moment == "end":
        return abs(float(own.columns[column][-1] - truth.columns[column][-1]))
    if moment == "peak":
        return abs(own.peak(column) - truth.peak(column))
    off = np.abs(own.at(column, common) - truth.at(column, common))
    return float(np.nanmax(off)) if np.isfinite(off).any() else math.nan


def _richer(data: Any, i: int, truth: Run, scale: float) -> float | None:
    """Return the error of Richardson's value; None where there is none."""
    value, column, moment = (
        float(data["richardson"][i]),
        str(data["column"].values[i]),
        str(data["moment"].values[i]),
    )
    if not math.isfinite(value):
        return None
    exact = float(truth.columns[column][-1]) if moment == "end" else truth.peak(column)
    return abs(value - exact) / scale


def _reached(base: gfmdlayer.Config, found: Any, truth: Run, common: np.ndarray) -> float:
    """Return the largest true error of the suggested configuration, of columns that are not counted."""
    own = _run(better(base, found))
    names = dict.fromkeys(str(name) for name in found.data["column"].values)
    scales = {name: truth.peak(name) for name in names if name in truth.columns and name not in COUNTED}
    every = [
        true_error(own, truth, name, moment, common) / scale
        for name, scale in scales.items() for moment in ("end", "peak", "worst") if scale > 0
    ]  # fmt: skip
    return float(np.nanmax(every))


def summary(lines: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the shares of numbers within the estimate, and what it costs."""
    held = [line for line in lines if "numbers" in line]
    numbers = [number for line in held for number in line["numbers"]]
    if not numbers:
        return ["no numbers"]
    true, claimed = (np.array([number[k] for number in numbers]) for k in (2, 3))
    noted = np.array([number[4] for number in numbers])
    ratio = true / np.maximum(claimed, 1e-300)
    said = [
        f"{len(held)} cases, {len(numbers)} numbers",
        f"within the claim {np.mean(ratio <= 1):.1%}, within three times {np.mean(ratio <= 3):.2%}",
        f"largest true error over the claim {ratio.max():.2g}, "
        f"without a note {ratio[~noted].max(initial=0.0):.2g}",
        f"claim over the true error, median {np.median(1 / ratio):.2g}",
    ]
    for axes, kind in ((1, "line"), (2, "surface")):
        if works := [line["work"] for line in held if line["axes"] == axes]:
            said.append(f"work beside the case, {kind}: median {np.median(works):.2g}, most {max(works):.2g}")
    richer = np.array([(number[5], number[2]) for number in numbers if number[5] is not None])
    if len(richer):
        better_ones = np.mean(richer[:, 0] < richer[:, 1])
        said.append(f"Richardson's value given {len(richer) / len(numbers):.1%}, better in {better_ones:.0%}")
    if reached := [line for line in held if "reached" in line]:
        for words, among in (
            (f"asked for {ASKED:g}: reached in", reached),
            ("without those told to ask again:", [line for line in reached if not line.get("limited")]),
        ):
            within = [line["reached"] <= ASKED for line in among]
            said.append(f"{words} {np.mean(within) if within else math.nan:.1%} of {len(among)}")
    return said


def main(arguments: list[str]) -> None:
    """Judge cases into a file, and print the summary."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("--variations", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--reach", type=int, default=0, metavar="EVERY")
    options = parser.parse_args(arguments)
    known = options.file.read_text().splitlines() if options.file.exists() else []
    done = {json.loads(line)["name"]: json.loads(line) for line in known}
    warnings.simplefilter("ignore")
    for i, (name, given) in enumerate(trials(options.variations, options.seed)):
        if name in done or (options.only and name.rpartition(" ")[0] not in options.only):
            continue
        try:
            line = judged(name, given, reach=bool(options.reach) and i % options.reach == 0)
        except Exception as error:  # the others go on; the file says why
            line = {"name": name, "error": f"{type(error).__name__}: {error}"}
        done[name] = line
        with options.file.open("a") as file:
            file.write(json.dumps(line) + "\n")
    print("\n".join(summary(done.values())))
    print("\n".join(f"{name}: {line['error']}" for name, line in done.items() if "error" in line))


if __name__ == "__main__":
    main(sys.argv[1:])
