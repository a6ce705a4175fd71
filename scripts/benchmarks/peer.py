"""A viscoelastic halfspace beside Tamaas: a step at equal residual, a run to 8 tau at equal error.

Equal residual means this project's residual, computed from Tamaas's displacements: Tamaas's own tolerance is
chosen for it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from benchmarks.common import STEP, bare_pairs, default_case, run, seconds
from benchmarks.tables import Cell, Effort, Table
from benchmarks.work import reference

from gfmdlayer.arrays import FloatArray
from gfmdlayer.case import make_integrator
from gfmdlayer.config import Config
from gfmdlayer.contact.problem import Problem, assess
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.inputs import make_grid, make_punch
from gfmdlayer.simulation import simulate, warm_up
from gfmdlayer.verification.runs import Recording

if TYPE_CHECKING:
    from benchmarks.tamaas_halfspace import Step

EFFORT = Effort(points=(1 << 14,), steps=240, repetitions=5)
QUICK = Effort(points=(1 << 10,), steps=40, repetitions=3)

_RESIDUAL = 1e-6
_TOLERANCES = np.geomspace(1e-2, 1e-5, 19)  # of our adaptive steps, loosest first
_OWN_TOLERANCES = [3e-7, 1e-7, 3e-8, 1e-8, 3e-9, 1e-9, 3e-10, 1e-10]  # of Tamaas, on its own error
_TRIAL_STEP, _TRIAL_STEPS = 0.1, 8
_END = 8.0
_G0 = 1.0  # of the default case
_BARE = 500  # pairs in one measurement

_Row = tuple[str, Cell, Cell, Cell, Cell]  # quantity, ours, theirs, theirs / ours, target


def measure(effort: Effort) -> list[Table]:
    """Run both on each grid; no table without Tamaas."""
    if find_spec("tamaas") is None:
        print("Tamaas is not installed; the extra bench installs it", file=sys.stderr)
        return []
    return [_compare(points, effort) for points in effort.points]


def _compare(points: int, effort: Effort) -> Table:
    from benchmarks.tamaas_halfspace import VERSION, TamaasHalfspace

    config = _halfspace(points, effort.steps * STEP)
    wisdom = warm_up(config)
    pairs = bare_pairs(Transforms(config.grid.points, wisdom), _BARE)
    tolerance = _equal_tolerance(config)
    peer = TamaasHalfspace(config, STEP, tolerance)
    theirs: list[Step] = []
    own_times, bare_times = [], []
    for part in np.array_split(np.arange(effort.steps), effort.repetitions):
        theirs += [peer.advance() for _ in part]
        own_times.append(seconds(lambda: simulate(config, Recording(), wisdom=wisdom)))
        bare_times.append(seconds(pairs) / _BARE)
    bare = float(np.median(bare_times))
    whole = _whole_runs(config, theirs, effort.repetitions)
    name = f"Tamaas {VERSION}"
    found = [
        *_steps(config, theirs, float(np.median(own_times)) / effort.steps, bare),
        ("error of ptilde to 8 tau", whole.own_error, whole.peer_error, None, ""),
        (
            "time to 8 tau [bare FFT pairs], Tamaas's extrapolated",
            whole.own / bare,
            whole.peer / bare,
            whole.peer / whole.own,
            "≥ 5000",
        ),
    ]
    rows: list[dict[str, Cell]] = [
        {"": quantity, "gfmdlayer": own, name: other, "ratio": ratio, "target": target}
        for quantity, own, other, ratio, target in found
    ]
    title = f"A viscoelastic halfspace by {name}, n = {points}, {effort.steps} steps of {STEP} tau"
    note = (
        f"Both by backward Euler; Tamaas's own tolerance, {tolerance:g}, is the loosest at which the median "
        f"residual of trial steps of {_TRIAL_STEP} tau is within {_RESIDUAL:g}.  To 8 tau: gfmdlayer with "
        f"adaptive steps, tolerance {whole.tolerance:.2g}; Tamaas extrapolated from {effort.steps} steps to "
        f"{whole.steps}, the ramp and the hold each with its own time per step."
    )
    return Table(f"peer-{points}", title, rows, note)


def _steps(config: Config, theirs: list[Step], step: float, bare: float) -> list[_Row]:
    """Compare the steps of both at equal residual; `step` is our time of one."""
    ours = run(config)
    peer_step = sum(each.seconds for each in theirs) / len(theirs)
    residuals, peer_residuals = ours["residual"][1:], _residuals(config, STEP, theirs)
    last = min(len(theirs), round(1 / STEP))
    pressure, peer_pressure = float(ours["mean_pressure"][last]), theirs[last - 1].load / (2 * _G0)
    return [
        ("time of a step [bare FFT pairs]", step / bare, peer_step / bare, peer_step / step, "≥ 150"),
        ("time of a step [ms]", 1e3 * step, 1e3 * peer_step, None, ""),
        ("FFT pairs a step", float(ours["transforms"][1:].mean()), None, None, ""),
        (
            "iterations a step",
            float(ours["iterations"][1:].mean()),
            _mean([s.iterations for s in theirs]),
            None,
            "",
        ),
        ("loads tried a step", 1, _mean([s.solves for s in theirs]), None, ""),
        ("residual, median", float(np.median(residuals)), float(np.median(peer_residuals)), None, ""),
        ("residual, largest", float(residuals.max()), float(peer_residuals.max()), None, ""),
        (f"ptilde at t = {last * STEP:g} tau", f"{pressure:.9f}", f"{peer_pressure:.9f}", None, ""),
        ("its relative difference", None, abs(peer_pressure / pressure - 1), None, "≤ 1e-6"),
    ]


def _equal_tolerance(config: Config) -> float:
    """Return the loosest of Tamaas's tolerances whose residual, in the median of some long steps, is ours."""
    from benchmarks.tamaas_halfspace import TamaasHalfspace

    trial = config.with_values({"time.step": _TRIAL_STEP, "time.end": _TRIAL_STEP * _TRIAL_STEPS})
    for tolerance in _OWN_TOLERANCES:
        peer = TamaasHalfspace(trial, _TRIAL_STEP, tolerance)
        steps = [peer.advance() for _ in range(_TRIAL_STEPS)]
        if np.median(_residuals(trial, _TRIAL_STEP, steps)) <= _RESIDUAL:
            return tolerance
    raise RuntimeError(f"Tamaas does not reach a residual of {_RESIDUAL:g} at n = {config.grid.points[0]}")


def _residuals(config: Config, step: float, steps: list[Step]) -> FloatArray:
    """Our residual of each step, the pressure from our integrator for its displacement and load."""
    grid = make_grid(config)
    transforms, integrator, punch = (
        Transforms(grid.shape),
        make_integrator(config, grid),
        make_punch(config, grid),
    )
    found = []
    for each in steps:
        kappa, b = integrator.terms(step)
        spectrum = transforms.forward(each.displacement)
        pressure = transforms.backward(b - kappa * spectrum) / grid.size + each.load
        problem = Problem(kappa, b, punch - each.depth)
        found.append(assess(pressure, each.displacement, problem.obstacle, problem.least)[0])
        integrator.advance(spectrum)
    return np.array(found)


class _Durations(NamedTuple):
    """Seconds and errors of the runs to 8 tau, tolerance of the adaptive steps, number of Tamaas's."""

    own: float
    peer: float
    own_error: float
    peer_error: float
    tolerance: float
    steps: int


def _whole_runs(config: Config, theirs: list[Step], repetitions: int) -> _Durations:
    """Compare with adaptive steps at the loosest tolerance that is as accurate as Tamaas's steps."""
    fixed = config.with_values({"time.end": _END})
    exact = reference(fixed)
    # The same scheme with the same steps has the same error, and runs faster here.
    peer_error = exact.error(run(fixed))
    for tolerance in _TOLERANCES.tolist():
        adaptive = {"end": _END, "integrator": "exponential", "step": "adaptive", "tolerance": tolerance}
        ours = fixed.with_values({"time": adaptive})
        error = exact.error(run(ours))
        if error <= peer_error:
            break
    wisdom = warm_up(ours)
    own = float(
        np.median([seconds(lambda: simulate(ours, Recording(), wisdom=wisdom)) for _ in range(repetitions)])
    )
    count = round(_END / STEP)
    ramp = [each.seconds for each in theirs if each.time <= 1 + STEP / 2]
    hold = [each.seconds for each in theirs[len(ramp) :]] or ramp
    in_ramp = round(1 / STEP)
    return _Durations(
        own, in_ramp * _mean(ramp) + (count - in_ramp) * _mean(hold), error, peer_error, tolerance, count
    )


def _halfspace(points: int, end: float) -> Config:
    time = {"end": end, "step": STEP, "integrator": "backward_euler"}
    return default_case(
        grid__points=points, layer__thickness=math.inf, time=time, solver={"method": "active_set"}
    )


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
