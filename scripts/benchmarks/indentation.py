"""An isolated sphere on a Zener layer: time of the isolated and of the periodic run.

The history is ramp, hold and retraction. Times are CPU times after a first run. The periodic run has equal
steps on a cell of 12 thicknesses; its images shift the force. Finer grids and larger cells take longer.
"""

from __future__ import annotations

import math
from statistics import median
from tempfile import NamedTemporaryFile

import numpy as np
from benchmarks.common import Cell, Effort, Table, cpu_seconds

from gfmdlayer.body.closed_form import LayeredHalfspace
from gfmdlayer.body.layers import ViscoelasticLayer
from gfmdlayer.body.materials import Zener
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate, warm_up
from gfmdlayer.config import Config
from gfmdlayer.indentation.solve import History, follow
from gfmdlayer.punch.revolution import sphere
from gfmdlayer.results.recording import Recording

EFFORT = Effort(points=(128,), steps=50, repetitions=15)
QUICK = Effort(points=(64,), steps=10, repetitions=5)

_TIMES, _DEPTHS = (0.0, 1.0, 4.0, 5.0), (0.0, 0.2, 0.2, 0.0)
_CELL = 12.0


def measure(effort: Effort) -> list[Table]:
    """Measure both; the error of the isolated run is its estimate."""
    body = ViscoelasticLayer(LayeredHalfspace(1.0, 0.5, math.inf), Zener(1.0, 10.0, 1.0))
    history = History(np.array(_TIMES), np.array(_DEPTHS))
    found = follow(body, sphere(5.0), history)
    times = [cpu_seconds(lambda: follow(body, sphere(5.0), history)) for _ in range(effort.repetitions)]
    rows: list[dict[str, Cell]] = [
        {
            "contact": "isolated",
            "steps": found.time.size - 1,
            "CPU, ms": 1e3 * median(times),
            "largest force": float(found.force.max()),
            "error": found.error,
        }
    ]
    with NamedTemporaryFile("w", suffix=".txt") as file:
        file.write("\n".join(f"{t} {d}" for t, d in zip(_TIMES, _DEPTHS, strict=True)))
        file.flush()
        rows += [_periodic(points, effort.steps, file.name) for points in effort.points]
    return [Table("indentation", "Sphere on a Zener layer over a rigid base, error 1e-4", rows)]


def _periodic(points: int, steps: int, file: str) -> dict[str, Cell]:
    config = Config.model_validate(
        {
            "name": "periodic",
            "grid": {"points": [points, points], "period": _CELL},
            "layer": {"thickness": 1.0, "material": {"G0": 1.0, "Ginf": 10.0, "tau": 1.0}},
            "halfspace": {"shear_modulus": math.inf},
            "punch": {"shape": "parabola", "radius": 5.0},
            "trajectory": {"kind": "table", "file": file},
            "time": {"end": _TIMES[-1], "step": _TIMES[-1] / steps},
        }
    )
    warm_up(config)
    recording = Recording()
    seconds = cpu_seconds(lambda: simulate(Case(config), recording))
    return {
        "contact": f"periodic, {points}²",
        "steps": recording["time"].size - 1,
        "CPU, ms": 1e3 * seconds,
        "largest force": float(recording["force"].max()),
        "error": None,
    }
