"""Random small studies for the command line: sweeps of short cases with all features."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from trials.configurations import Draw, Values, choose, draw, dump

from gfmdlayer.contact.solvers import SOLVERS

# At least 32 points: for fewer, the bits of sums depend on the position of arrays in memory.
ALIKE = (64, 97, 128, 135, 255, 256, 4096, [8, 8], [9, 13], [16, 16], [31, 16], [32, 32])
GRIDS = ([16, 16], [31, 16], [32, 32], [40, 36])  # that ranks share
TOGETHER = "nested_gradient"


class Study(NamedTuple):
    """A configuration with a sweep, and its tables."""

    config: Values
    tables: dict[str, str]

    def write(self, folder: Path) -> Path:
        """Write the files into a folder; return that of the configuration."""
        for name, text in self.tables.items():
            (folder / name).write_text(text, encoding="utf-8")
        path = folder / "study.yaml"
        path.write_text(dump(self.config), encoding="utf-8")
        return path


def study(rng: Draw, together: bool = False) -> Study:
    """Draw a study; `together`: of surfaces that ranks share."""
    if not together and rng.random() < 0.1:
        return _isolated(rng)
    methods = (TOGETHER,) if together else tuple(SOLVERS)
    config, history = draw(int(rng.integers(2**31)), 0, methods, GRIDS if together else ALIKE)
    config["name"] = "study"
    if together:
        config["trajectory"].pop("velocity", None)
    if config["time"]["step"] != "adaptive":
        config["time"]["step"] = config["time"]["end"] / int(rng.integers(10, 80))
    tables = {}
    if history is not None:
        config["trajectory"] |= {"kind": "table", "file": "history.txt"}
        tables["history.txt"] = _table(*history)
    if rng.random() < 0.2:
        _heat(rng, config, tables)
    return Study(config | _kept(rng, config) | {"sweep": _sweep(rng, config)}, tables)


def _table(*columns: list[float]) -> str:
    return "".join(" ".join(map(repr, row)) + "\n" for row in zip(*columns, strict=True))


def _heat(rng: Draw, config: Values, tables: dict[str, str]) -> None:
    """Give all materials that relax a shift, and the body a temperature."""
    layers = config.get("layers") or [config["layer"]]
    relaxing = [each["material"] for each in layers if each["material"]["model"] != "elastic"]
    if not relaxing:
        return
    shift = choose(
        rng,
        {"law": "wlf", "C1": 8.86, "C2": 101.6, "reference": 20.0},
        {"law": "arrhenius", "activation_energy": 8.0e4, "reference": 20.0},
    )
    for material in relaxing:
        material["shift"] = dict(shift)
    if "velocity" in config["trajectory"] or rng.random() < 0.5:
        config["temperature"] = {"value": float(rng.integers(-20, 80))}
    else:
        config["temperature"] = {"file": "temperature.txt"}
        end = config["time"]["end"]
        tables["temperature.txt"] = _table([0.0, end / 2, end], rng.uniform(-20, 80, 3).round(1).tolist())


def _kept(rng: Draw, config: Values) -> Values:
    """Snapshots, patches and histograms."""
    end, surface = config["time"]["end"], isinstance(config["grid"]["points"], list)
    step = config["time"]["step"]
    middle = end if step == "adaptive" else step * round(0.5 * end / step)
    output: Values = {"snapshots": choose(rng, [], [end], [middle, end] if middle < end else [end])}
    if surface and rng.random() < 0.3:
        output["patches"] = True
    return {"output": output}


def _sweep(rng: Draw, config: Values) -> Values:
    """One to four cases."""
    tolerance = config["solver"]["tolerance"]
    found: Values = {}
    if rng.random() < 0.5:
        found["solver.tolerance"] = [tolerance, 0.5 * tolerance]
    if not found or rng.random() < 0.5:
        thickness = "layers.0.thickness" if "layers" in config else "layer.thickness"
        least = (config.get("layers") or [config["layer"]])[0]["thickness"]
        if 0 < least < np.inf:
            found[thickness] = [least, 1.3 * least]
    return found or {"solver.tolerance": [tolerance]}


def _isolated(rng: Draw) -> Study:
    """An axisymmetric indenter."""
    material = {"model": "zener", "G0": 1.0, "Ginf": float(rng.uniform(1.5, 30)), "tau": 1.0}
    drive: Values = choose(
        rng,
        {"control": "depth", "depth": 0.3, "ramp_time": 0.5},
        {"control": "force", "force": 0.5, "ramp_time": 0.5},
    )
    config: Values = {
        "name": "study",
        "grid": {"geometry": "axisymmetric", "points": 64, "extent": 8.0},
        "layer": {
            "thickness": choose(rng, 2.0, np.inf),
            "poisson": choose(rng, 0.5, 0.4),
            "material": material,
        },
        "halfspace": {"shear_modulus": choose(rng, np.inf, 3.0)},
        "punch": choose(rng, {"shape": "sphere", "radius": 5.0}, {"shape": "cone", "slope": 0.3}),
        "trajectory": drive,
        "time": {"end": 2.0, "step": "adaptive", "tolerance": 1e-3},
        "output": {"snapshots": [0.5, 2.0]},
        "sweep": {"layer.material.Ginf": [material["Ginf"], material["Ginf"] + 1.0]},
    }
    return Study(config, {})
