"""A viscoelastic halfspace under a load by gfmdlayer and Tamaas: time of a step at equal residual.

Both use backward Euler with the same steps on the same grid. The residual is this project's; for Tamaas it is
computed from its displacements, and its own tolerance is chosen to reach it.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np
from benchmarks.common import STEP, Cell, Effort, Table, bare_pairs, default_case, run, seconds

from gfmdlayer.arrays import FloatArray
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate, warm_up
from gfmdlayer.config import Config
from gfmdlayer.contact.problem import Problem
from gfmdlayer.contact.residual import assess
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.results.recording import Recording
from gfmdlayer.verification.crosschecks import TamaasHalfspace

EFFORT = Effort(points=(1 << 14,), steps=240, repetitions=5)
QUICK = Effort(points=(1 << 10,), steps=40, repetitions=3)

_LOAD = 0.05  # mean pressure at the end of the ramp, in G0
_RESIDUAL = 1e-6
_PEER_TOLERANCES = [3e-7, 1e-7, 3e-8, 1e-8, 3e-9, 1e-9, 3e-10, 1e-10]  # on Tamaas's own error
_TRIAL_STEPS = 40
_BARE = 500  # pairs in one measurement


def measure(effort: Effort) -> Iterator[Table]:
    """Run both codes on each grid; without Tamaas there is no table."""
    if find_spec("tamaas") is None:
        print("Tamaas is not installed; install gfmdlayer[bench]", file=sys.stderr)
        return
    for points in effort.points:
        yield _compare(points, effort)


def _compare(points: int, effort: Effort) -> Table:
    config = _halfspace(points, effort.steps)
    warm_up(config)
    pairs = bare_pairs(Transforms(config.grid.points), _BARE)
    tolerance = _equal_tolerance(points)
    peer, peer_residual = TamaasHalfspace(Case(config).punch, STEP, tolerance), _Residual(config)
    own_times, peer_times, bare_times, residuals, depth = [], [], [], [], 0.0
    for part in np.array_split(np.arange(1, effort.steps + 1), effort.repetitions):
        for i in part:
            load = _LOAD * min(i * STEP, 1.0)
            begun = time.perf_counter()
            depth = peer.press(load)
            peer_times.append(time.perf_counter() - begun)
            residuals.append(peer_residual(peer.displacement, load, depth))
        own_times.append(seconds(lambda: simulate(config, Recording())) / effort.steps)
        bare_times.append(seconds(pairs) / _BARE)
    own, theirs, bare = float(np.median(own_times)), float(np.mean(peer_times)), float(np.median(bare_times))
    found = run(config)
    quantities: list[tuple[str, Cell, Cell, Cell]] = [
        ("time of a step [bare FFT pairs]", own / bare, theirs / bare, theirs / own),
        ("time of a step [ms]", 1e3 * own, 1e3 * theirs, None),
        ("FFT pairs a step", float(found["transforms"][1:].mean()), None, None),
        ("residual, median", float(np.median(found["residual"][1:])), float(np.median(residuals)), None),
        ("residual, largest", float(found["residual"].max()), max(residuals), None),
        ("depth at the end", f"{found.last('depth'):.9f}", f"{depth:.9f}", None),
        ("its relative difference", None, abs(depth / found.last("depth") - 1), None),
    ]
    name = f"Tamaas {peer.version}"
    rows: list[dict[str, Cell]] = [
        {"": quantity, "gfmdlayer": ours, name: other, "ratio": ratio}
        for quantity, ours, other, ratio in quantities
    ]
    title = f"A viscoelastic halfspace by {name}, n = {points}, {effort.steps} steps of {STEP} tau"
    note = (
        f"Tamaas's own tolerance, {tolerance:g}, is the loosest at which the median residual of the first "
        f"{_TRIAL_STEPS} steps is within {_RESIDUAL:g}."
    )
    return Table(f"peer-{points}", title, rows, note)


def _equal_tolerance(points: int) -> float:
    """Return Tamaas's loosest tolerance whose median residual over the first steps is within ours."""
    config = _halfspace(points, _TRIAL_STEPS)
    for tolerance in _PEER_TOLERANCES:
        peer, residual = TamaasHalfspace(Case(config).punch, STEP, tolerance), _Residual(config)
        loads = [_LOAD * min(i * STEP, 1.0) for i in range(1, _TRIAL_STEPS + 1)]
        found = [residual(peer.displacement, load, depth) for load in loads if (depth := peer.press(load))]
        if np.median(found) <= _RESIDUAL:
            return tolerance
    raise RuntimeError(f"Tamaas does not reach a residual of {_RESIDUAL:g} at n = {points}")


class _Residual:
    """Our residual of a step by Tamaas; our integrator gives the pressure of its displacement and load."""

    def __init__(self, config: Config) -> None:
        case = Case(config)
        self._transforms, self._integrator, self._punch = case.transforms, case.contact.history, case.punch

    def __call__(self, displacement: FloatArray, load: float, depth: float) -> float:
        """Assess the step and advance the history."""
        kappa, b = self._integrator.terms(STEP)
        spectrum = self._transforms.forward(displacement)
        pressure = self._transforms.backward(b - kappa * spectrum) / displacement.size + load
        problem = Problem(kappa, b, self._punch - depth)
        self._integrator.advance(spectrum)
        return float(assess(pressure, displacement, problem.obstacle, problem.residual_floor)[0])


def _halfspace(points: int, steps: int) -> Config:
    return default_case(
        grid__points=points,
        layer__thickness=math.inf,
        trajectory={"control": "load", "load": _LOAD},
        time={"end": steps * STEP, "step": STEP, "integrator": "backward_euler"},
        solver={"method": "active_set"},
    )
