"""Each ingredient of the solvers, the first guesses and the adaptive steps taken out, one at a time.

An ingredient is taken out by a part of the `Case`, by another value of a constant, or, inside kernels, by
kernels that are compiled anew with other functions or constants. The time loop in Python calls these; the
compiled one, which takes the same steps, would not. FFT pairs do not depend on the processor. Times are CPU
times, compared with those of the full method in the same run.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FunctionType, ModuleType
from typing import Any, NamedTuple
from unittest.mock import patch

import numba as nb
import numpy as np
from benchmarks.common import Cell, Effort, Table
from numba.core.dispatcher import Dispatcher

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import ConvergenceError, simulate, warm_up
from gfmdlayer.config import Config, load
from gfmdlayer.contact import fire
from gfmdlayer.contact.active_set import loop, solver
from gfmdlayer.contact.nested import iteration
from gfmdlayer.contact.nested import solver as nested_solver
from gfmdlayer.contact.nested.solver import nest
from gfmdlayer.contact.prediction import DisplacementPrediction, PressurePrediction
from gfmdlayer.contact.stencil import stencil
from gfmdlayer.grid.grid import Grid
from gfmdlayer.history import adaptive_steps, errors
from gfmdlayer.history.errors import ErrorControl
from gfmdlayer.history.modes import SCHEMES, Modes
from gfmdlayer.results.recording import Recording

EFFORT = Effort(points=(1 << 14,), steps=1600, repetitions=2)
QUICK = Effort(points=(1 << 10,), steps=20, repetitions=1)

_CONFIGS = Path(__file__).parents[2] / "configs"
_STEP, _LONG_STEP = 0.005, 0.02  # in tau
_TOLERANCE = 1e-4  # of adaptive steps
_THICKNESSES = (0.0, 0.03125, 0.0625, 0.125, 0.25, math.inf)
_RADII = (0.1, 0.2, 0.5, 1.0, 2.0)
_LANDINGS = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0]  # times at which errors are compared
_WITHDRAWN = [(0, 0), (1, 0.01), (2, 0.01), (3, 0), (3.5, 0), (4.5, 0.012), (5.5, 0.004), (8, 0.004)]

Workloads = Mapping[str, Sequence[Config]]
Patches = list[tuple[object, str, object]]


def measure(effort: Effort) -> Iterator[Table]:
    """Take the ingredients out of the active set, nested gradients, FIRE, and the adaptive steps."""
    points, repetitions = max(effort.points), effort.repetitions
    active_set = {**_workloads(points, effort.steps), **_hard(points // 4)}
    with TemporaryDirectory() as folder:
        file = Path(folder) / "withdrawn.txt"
        file.write_text("\n".join(f"{time} {depth}" for time, depth in _WITHDRAWN), encoding="utf-8")
        withdrawn = {"trajectory": {"control": "depth", "kind": "table", "file": str(file)}}
        yield from _compare("ablation", "Active set", active_set, ACTIVE_SET, repetitions)
        yield from _compare(
            "ablation-nested", "Nested gradients", _rough_surfaces(points), NESTED, repetitions
        )
        yield from _compare("ablation-fire", "FIRE", _fire(points), FIRE, repetitions)
        yield from _compare(
            "ablation-adaptive", "Adaptive steps", _adaptive(points, withdrawn), ADAPTIVE, repetitions,
            reference=True,
        )  # fmt: skip


class _Outcome(NamedTuple):
    pairs: int
    seconds: float
    pressures: list[FloatArray]  # mean pressures at the snapshots, case by case


@dataclass(frozen=True)
class _Ablation:
    """An ingredient that is taken out by parts of the case, and by patches that are made once."""

    name: str
    parts: Callable[[Case], dict[str, Any]] = lambda _: {}
    patches: Callable[[], Patches] = list


def _compare(
    name: str,
    title: str,
    workloads: Workloads,
    ablations: Sequence[_Ablation],
    repetitions: int,
    *,
    reference: bool = False,
) -> list[Table]:
    """Run all ablations of each workload in turns; return tables of pairs, of times and of errors."""
    rows = (_Ablation("full method"), *ablations)
    patches = {ablation.name: ablation.patches() for ablation in rows}
    for ablation in rows:
        with _patched(patches[ablation.name]):
            warm_up(next(iter(workloads.values()))[0])
    found: dict[tuple[str, str], _Outcome | None] = {}
    exact: dict[str, _Outcome | None] = {}
    for workload, configs in workloads.items():
        warm_up(configs[0])
        for _ in range(repetitions):
            for ablation in rows:
                with _patched(patches[ablation.name]):
                    outcome = _run(configs, ablation.parts)
                found[ablation.name, workload] = _faster(outcome, found.get((ablation.name, workload)))
        if reference:
            fine = {"time.tolerance": 0.01 * _TOLERANCE, "solver.tolerance": 1e-8}
            exact[workload] = _run([config.with_values(fine) for config in configs])
    full = {workload: found["full method", workload] for workload in workloads}

    def cells(value: Callable[[_Outcome, str], Cell]) -> list[dict[str, Cell]]:
        return [
            {"taken out": ablation.name}
            | {
                workload: "fails" if outcome is None else value(outcome, workload)
                for workload in workloads
                for outcome in [found[ablation.name, workload]]
            }
            for ablation in rows
        ]

    def ratio(field: str) -> Callable[[_Outcome, str], Cell]:
        def value(outcome: _Outcome, workload: str) -> Cell:
            whole = full[workload]
            return None if whole is None else getattr(outcome, field) / getattr(whole, field)

        return value

    counts: dict[str, Cell] = {"taken out": "nothing: FFT pairs"}
    counts |= {workload: None if whole is None else whole.pairs for workload, whole in full.items()}
    pairs, times = cells(ratio("pairs"))[1:], cells(ratio("seconds"))[1:]
    tables = [
        Table(f"{name}-pairs", f"{title}: FFT pairs, over those of the full method", [counts, *pairs]),
        Table(f"{name}-time", f"{title}: CPU time, over that of the full method", times),
    ]
    if reference:
        errors = cells(lambda outcome, workload: _error(outcome, exact[workload]))
        tables.append(Table(f"{name}-error", f"{title}: error of the mean pressure", errors))
    return tables


def _run(
    configs: Sequence[Config], parts: Callable[[Case], dict[str, Any]] = lambda _: {}
) -> _Outcome | None:
    """Run the cases one after the other; None where one does not converge."""
    pairs, pressures, begun = 0, [], time.process_time()
    for config in configs:
        case = Case(config)
        recording = Recording()
        taken = Case(config, transforms=case.transforms, **parts(case))
        taken.stepwise = True
        try:
            simulate(taken, recording)
        except ConvergenceError:
            return None
        pairs += int(recording["transforms"].sum())
        landed = np.isin(recording["time"], config.output.snapshots)
        pressures.append(recording["mean_pressure"][landed])
    return _Outcome(pairs, time.process_time() - begun, pressures)


def _faster(outcome: _Outcome | None, earlier: _Outcome | None) -> _Outcome | None:
    if outcome is None or earlier is None:
        return outcome
    return min(outcome, earlier, key=lambda each: each.seconds)


def _error(outcome: _Outcome, exact: _Outcome | None) -> float | None:
    """Largest error at a snapshot, relative to the largest mean pressure of the case."""
    if exact is None:
        return None
    pairs = zip(outcome.pressures, exact.pressures, strict=True)
    return max(float(np.abs(found - known).max() / known.max()) for found, known in pairs)


def _patched(patches: Patches) -> ExitStack:
    stack = ExitStack()
    for target, name, value in patches:
        stack.enter_context(patch.object(target, name, value))
    return stack


def _workloads(points: int, steps: int) -> dict[str, list[Config]]:
    side = max(points // 32, 32)
    square = {"grid.points": [side, side], "output.snapshots": []}
    end, active_set = max(steps // 40, 2), {"method": "active_set", "tolerance": 1e-6}
    rough, sphere = load(_CONFIGS / "rough-layer.yaml"), load(_CONFIGS / "coated-sphere.yaml")
    cutoff = max(0.015625, 4 / side)
    return {
        "figure2 fixed": [_line(points, steps, thickness=d) for d in (0.0625, math.inf)],
        "figure2 adaptive": [_adapted(_line(points, thickness=d)) for d in _THICKNESSES],
        f"rough {side}²": [
            rough.with_values(
                {
                    **square,
                    "solver": active_set,
                    "punch.short_cutoff": cutoff,
                    "time.end": end * float(rough.time.step),
                }
            )
        ],
        f"coated sphere {side}²": [sphere.with_values({**square, "time.step": 0.04, "time.end": 0.04 * end})],
        "sweep of 256": [_line(256, steps, radius=r) for r in _RADII],
    }


def _rough_surfaces(points: int) -> dict[str, list[Config]]:
    """A first solve and time steps on a rough surface."""
    side = max(points // 32, 64)
    method = {"method": "nested_gradient", "tolerance": 1e-6}
    values = {"grid.points": [side, side], "output.snapshots": [], "solver": method}
    layer = load(_CONFIGS / "rough-layer.yaml").with_values(
        {**values, "punch.short_cutoff": max(0.015625, 4 / side)}
    )
    sudden = {"time.end": 0.5, "time.step": 0.5}
    return {
        f"halfspace {side}², at once": [layer.with_values({**sudden, "layer.thickness": math.inf})],
        f"layer {side}², at once": [layer.with_values(sudden)],
        f"layer {side}², 10 steps": [layer.with_values({"time.end": 10 * float(layer.time.step)})],
    }


def _hard(points: int) -> dict[str, list[Config]]:
    long = {"time.step": _LONG_STEP, "time.end": 100 * _LONG_STEP}
    soft = {"layer.thickness": 0.01, "halfspace.shear_modulus": 0.001}
    flat = {"shape": "flat", "width": 0.3, "edge_radius": 0.02}
    roughness = {"hurst": 0.8, "roll_off": 0.25, "short_cutoff": max(0.005, 8 / points), "rms_slope": 0.1}
    load_ramp = {"control": "load", "load": 0.05, "ramp_time": 0.5}
    line = _line(points).with_values(long)
    film = {**soft, "punch.radius": 1.0, "trajectory.depth": 0.025}
    rough = {"shape": "self_affine", "seed": 1, **roughness}
    return {
        "stiff film, soft base": [line.with_values(film)],
        "flat punch": [line.with_values({"layer.thickness": 0.0625, "punch": flat})],
        "rough line": [line.with_values({"layer.thickness": 0.1, "punch": rough, "trajectory": load_ramp})],
    }


def _fire(points: int) -> dict[str, list[Config]]:
    method = {"solver": {"method": "fire", "tolerance": 1e-6}, "time.step": _LONG_STEP}
    few = {**method, "time.end": 5 * _LONG_STEP, "output.snapshots": []}
    line = {f"n = {n}": [_line(n).with_values(few)] for n in (points // 16, points // 4, points)}
    rough = load(_CONFIGS / "rough-layer-quick.yaml")
    return {**line, "rough 128²": [rough.with_values({**few, "time.end": 5 * _LONG_STEP})]}


def _adaptive(points: int, withdrawn: Mapping[str, object]) -> dict[str, list[Config]]:
    snapshots = {"output.snapshots": _LANDINGS}
    pressed = _adapted(_line(points // 4, thickness=0.0625)).with_values(snapshots)
    return {
        "figure2": [_adapted(_line(points, thickness=d)).with_values(snapshots) for d in _THICKNESSES],
        "256 points": [_adapted(_line(256, radius=r)).with_values(snapshots) for r in _RADII],
        "withdrawn": [pressed.with_values(withdrawn)],
    }


def _line(points: int, steps: int = 1600, thickness: float = 0.0625, radius: float = 0.25) -> Config:
    values = {"grid.points": points, "layer.thickness": thickness, "punch.radius": radius}
    time_ = {"step": _STEP, "end": _STEP * steps, "integrator": "exponential"}
    active_set = {"method": "active_set", "tolerance": 1e-6}
    return load(_CONFIGS / "figure2.yaml").with_values(
        {**values, "time": time_, "solver": active_set, "output.snapshots": []}
    )


def _adapted(config: Config) -> Config:
    return config.with_values({"time": {"step": "adaptive", "end": 8.0, "tolerance": _TOLERANCE}})


class _LastPressure(PressurePrediction):
    """The last pressure: no extrapolation."""

    def __init__(self, size: int) -> None:
        super().__init__(size)
        self._times, self._fields, self._gaps = (type(self._times)(maxlen=1) for _ in range(3))


class _LinearHistory(Modes):
    """The history is advanced as if the displacement were linear over the step."""

    def advance(self, spectrum: ComplexArray, curvature: ComplexArray | None = None) -> None:  # noqa: ARG002
        super().advance(spectrum)


@nb.njit(nogil=True)
def _residual_itself(plans, system, at, contact, work, shift):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Take the place of the preconditioner."""
    work.z[:] = 0.0
    for k in range(contact.counts[0].runs):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            work.z[i] = shift - at.gap[i]


@nb.njit(nogil=True)
def _no_scaling(system, at, contact, work, shift):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Take the place of the scaling of the pressure, to which directions are then not conjugate."""
    work.now[0].energy = 0.0
    return False


@nb.njit(nogil=True)
def _checked_iterate(  # type: ignore[no-untyped-def]
    plans,
    system,
    at,
    contact,
    work,
    shift,
    tolerance,
    rounds,
    limit,
    checked,  # noqa: ARG001
):
    """Evaluate the result in the window too."""
    return loop.iterate(plans, system, at, contact, work, shift, tolerance, rounds, limit, False)


def _compiled_anew(**replaced: object) -> Patches:
    """The active set's loop, on the surface and in windows, with other functions or constants."""
    return [(solver, "iterate", with_globals(loop.iterate, replaced))]


def _with_constants(module: ModuleType, **constants: object) -> Patches:
    """Constants of a module, and its kernels that use them, directly or not, compiled anew."""
    kernels = {name: value for name, value in vars(module).items() if isinstance(value, Dispatcher)}

    def uses(name: str, above: tuple[str, ...] = ()) -> set[str]:
        # A name may also be that of an attribute, so that names can seem to lead in a circle.
        own = set(kernels[name].py_func.__code__.co_names) if name in kernels else {name}
        callees = own & kernels.keys() - {name, *above}
        return own & constants.keys() | {called for called in callees if uses(called, (name, *above))}

    def anew(name: str) -> Any:
        replaced = {used: constants[used] if used in constants else anew(used) for used in uses(name)}
        return with_globals(kernels[name], replaced)

    return [*((module, name, value) for name, value in constants.items()),
            *((module, name, anew(name)) for name in kernels if uses(name))]  # fmt: skip


def _only_the_point(grid: Grid, stiffness: FloatArray) -> Any:
    """Take the place of the stencil: a constant."""
    weights = stencil(grid, stiffness)
    weights[1:] = 0.0
    return weights


def _without_coarser_grids(*arguments: Any) -> float:
    """Take the place of the nested start: from where the punch lies lowest."""
    with patch.object(Grid, "nested", property(lambda grid: [grid])):
        return nest(*arguments)


def with_globals(compiled: Any, replaced: Mapping[str, object]) -> Any:
    """Compile a kernel anew with other functions or constants."""
    function = compiled.py_func
    if unknown := replaced.keys() - function.__globals__.keys():
        raise NameError(f"{function.__name__} uses no {', '.join(sorted(unknown))}")
    changed = FunctionType(function.__code__, {**function.__globals__, **replaced}, function.__name__)
    return nb.jit(**compiled.targetoptions)(changed)


def _solver(case: Case, kind: Any, **options: bool) -> dict[str, Any]:
    return {"solver": kind(case.transforms, **options)}


ACTIVE_SET = (
    _Ablation("windows", parts=lambda case: _solver(case, solver.ActiveSet, windows=False)),
    _Ablation(
        "a result of one stretch taken directly", patches=lambda: [(solver, "iterate", _checked_iterate)]
    ),
    _Ablation("preconditioner", patches=lambda: _compiled_anew(_precondition=_residual_itself)),
    _Ablation("conjugacy to the pressure", patches=lambda: _compiled_anew(_scale_pressure=_no_scaling)),
    _Ablation("points leave before convergence", patches=lambda: _compiled_anew(_WELL_UNDER=0.0)),
    _Ablation("only once they hardly move", patches=lambda: _compiled_anew(_SETTLED=1e300)),
    _Ablation("extrapolation: last state", parts=lambda case: {"guess": _LastPressure(case.grid.size)}),
    _Ablation(
        "p², gap^(2/3): pressure itself", parts=lambda case: {"guess": DisplacementPrediction(case.grid.size)}
    ),
)
NESTED = (
    _Ablation("preconditioner: a constant", patches=lambda: [(iteration, "stencil", _only_the_point)]),
    _Ablation("coarser grids", patches=lambda: [(nested_solver, "nest", _without_coarser_grids)]),
    _Ablation("steps taken as a whole", patches=lambda: [(iteration, "_LET_GO", 1e9)]),
    _Ablation("shortest length tried: 0.3", patches=lambda: [(iteration, "_SHORTEST", 0.3)]),
)
FIRE = (
    _Ablation("inertia by mode: uniform", parts=lambda case: _solver(case, fire.Fire, mass_weighted=False)),
    _Ablation("mixing", patches=lambda: [(fire, "MASS_WEIGHTED", fire.MASS_WEIGHTED._replace(mixing=0.0))]),
)
ADAPTIVE = (
    _Ablation(
        "curvature of the history",
        parts=lambda case: {
            "history": _LinearHistory(
                case.body.spectrum(case.grid.wavenumbers), SCHEMES["exponential"], case.grid.sums
            )
        },
    ),
    _Ablation(
        "first step from rest: as after a jump",
        patches=lambda: _with_constants(adaptive_steps, _FROM_REST=adaptive_steps._AFTER_JUMP / _TOLERANCE),
    ),
    _Ablation(
        "short step after a breakpoint",
        patches=lambda: _with_constants(adaptive_steps, _AFTER_BREAKPOINT=1.0),
    ),
    _Ablation(
        "velocity discarded at breakpoints",
        patches=lambda: [(ErrorControl, "discard_velocity", lambda _: None)],
    ),
    _Ablation(
        "part of the unknown curvature: all", patches=lambda: _with_constants(errors, _UNKNOWN_CURVATURE=1.0)
    ),
    _Ablation(
        "limits of growth",
        patches=lambda: _with_constants(adaptive_steps, _GROWTH=1e9, _FIRST_GROWTH=1e9),
    ),
)
