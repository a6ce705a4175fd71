"""What users run, by the public names of gfmdlayer alone, so that every version of it can run them.

`Checkout` starts this file as a process for a checkout of the package; it waits for the name of a task on its
standard input, and answers with the times of a call. The processes of two checkouts take turns.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

LEAST = 0.1  # seconds of calls in one measurement, at least

CASE: dict[str, Any] = {
    "name": "line",
    "grid": {"points": 1024},
    "layer": {"thickness": 0.1, "material": {"model": "zener", "G0": 1.0, "Ginf": 10.0, "tau": 1.0}},
    "halfspace": {"shear_modulus": 1.0},
    "punch": {"shape": "parabola", "radius": 0.25},
    "trajectory": {"control": "depth", "depth": 0.01, "ramp_time": 1.0},
    "time": {"end": 8.0, "step": "adaptive", "tolerance": 1e-4},
    "output": {"times": 0.04},  # as in a sweep
}
SHORT = CASE | {"grid": {"points": 256}, "time": {"end": 1.4, "step": 0.05}, "output": {}}
RANGES = {
    "layer.thickness": {"from": 0.02, "to": 0.4, "scale": "log"},
    "layer.material.Ginf": {"from": 3.0, "to": 30.0, "scale": "log"},
    "halfspace.shear_modulus": {"from": 0.5, "to": 2.0, "scale": "log"},
}
ROUGH = {"shape": "self_affine", "hurst": 0.8, "short_cutoff": 0.05, "seed": 1, "rms_slope": 0.1}
SPHERE = {"punch": {"shape": "parabola", "radius": 0.5}}
ROUGH_LOAD = {"punch": ROUGH, "trajectory": {"control": "load", "load": 0.01, "ramp_time": 1.0}}


def sweep(cases: int) -> dict[str, Any]:
    """Return the sweep over d/L, Ginf/G0 and G_bulk/G0."""
    return CASE | {"name": "sweep", "sweep": {"latin_hypercube": {"samples": cases, **RANGES}}}


def line(points: int) -> dict[str, Any]:
    """Return the case on a line."""
    return CASE | {"grid": {"points": points}}


def surface(points: int, *, rough: bool) -> dict[str, Any]:
    """Return it on a surface under a smooth or a rough punch, over fewer times."""
    of_punch = ROUGH_LOAD if rough else SPHERE
    return CASE | {"grid": {"points": [points, points]}} | of_punch | {"time": CASE["time"] | {"end": 2.0}}


class Times(NamedTuple):
    """Seconds of a call."""

    clock: float
    cpu: float  # of the process


class Checkout:
    """A process that runs tasks with the package at a place."""

    def __init__(self, place: Path) -> None:
        environment = os.environ | {"PYTHONPATH": str(place)}
        self.command = [sys.executable, "-m", "gfmdlayer"]
        self.environment = environment
        self._process = subprocess.Popen(
            [sys.executable, __file__],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def times(self, task: str, *size: int) -> Times:
        """Run a task; RuntimeError if it fails, which has told why on standard error."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps([task, *size]) + "\n")
        self._process.stdin.flush()
        if not (answer := self._process.stdout.readline()):
            raise RuntimeError(f"{task} failed with the package in {self.environment['PYTHONPATH']}")
        return Times(*json.loads(answer))

    def times_of_command(self) -> Times:
        """Run the command line once, for a case of some steps, in a process of its own."""
        with TemporaryDirectory() as name:
            (Path(name) / "short.yaml").write_text(json.dumps(SHORT), encoding="utf-8")
            command = [*self.command, "run", "short.yaml", "--out", "out"]
            begun, used = time.perf_counter(), _cpu_of_children()
            subprocess.run(command, env=self.environment, cwd=name, capture_output=True, check=True)
            return Times(time.perf_counter() - begun, _cpu_of_children() - used)

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


def _cpu_of_children() -> float:
    found = os.times()
    return found.children_user + found.children_system


def tasks() -> dict[str, Callable[..., Callable[[], object]]]:
    """Return the tasks by name: functions of their size that prepare a call."""
    import gfmdlayer

    def sweep_with_files(cases: int) -> Callable[[], object]:
        def call() -> None:
            with TemporaryDirectory() as name:
                gfmdlayer.run(sweep(cases), out=f"{name}/out", progress=False).close()

        return call

    def run(config: dict[str, Any]) -> Callable[[], object]:
        return lambda: gfmdlayer.run(config, progress=False)

    def solve(*points: int) -> Callable[[], object]:
        body, punch = gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=0.25)
        return lambda: gfmdlayer.solve(body, punch, depth=0.01, points=points)

    one_step = SHORT | {"time": {"end": 0.05, "step": 0.05}}
    return {
        "sweep": sweep_with_files,
        "run, 29 rows": lambda: run(SHORT),
        "run, 1 step": lambda: run(one_step),
        "solve": solve,
        "line": lambda points: run(line(points)),
        "smooth surface": lambda points: run(surface(points, rough=False)),
        "rough surface": lambda points: run(surface(points, rough=True)),
    }


def _timed(call: Callable[[], object]) -> Times:
    """Return the times of a call, of as many as take long enough together."""
    count, begun, used = 0, time.perf_counter(), time.process_time()
    while time.perf_counter() - begun < LEAST:
        call()
        count += 1
    return Times((time.perf_counter() - begun) / count, (time.process_time() - used) / count)


def main() -> None:
    """Answer each line of standard input."""
    warnings.simplefilter("ignore")  # of coarse grids
    known = tasks()
    for request in sys.stdin:
        name, *size = json.loads(request)
        print(json.dumps(_timed(known[name](*size))), flush=True)


if __name__ == "__main__":
    main()
