"""What the compiled time loop does for a punch that moves along the surface at a constant velocity."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.case.normal import NormalContact
from gfmdlayer.contact.active_set.solver import SolverArrays, StepResult, assess_at, set_stiffness, solve_step
from gfmdlayer.contact.active_set.windows import WholeSurface
from gfmdlayer.contact.loss_stiffness import (
    SHARE,
    LossArrays,
    LossStiffnessSolver,
    add_loss,
    set_first,
    set_intercept,
    set_symmetric,
)
from gfmdlayer.contact.pressure_form import SurfaceState
from gfmdlayer.contact.residual import ResidualFloor
from gfmdlayer.grid.sums import pairwise_sum
from gfmdlayer.grid.transforms import Plans, forward
from gfmdlayer.history.sliding_modes import SlidingArrays, SlidingModes
from gfmdlayer.kernels import kernel, record_type

if TYPE_CHECKING:
    from gfmdlayer.observables import Observable
    from gfmdlayer.observables.friction import FrictionColumns

_PROBLEMS = 2  # without loss, for one step; a third one is made by mixing surfaces

STEADY = record_type(
    [
        ("asked", np.bool_),  # whether the run ends in a steady state
        ("tolerance", np.float64),
        ("window", np.float64),
        ("since", np.float64),
        ("begun", np.float64),
        ("least", np.float64, 3),
        ("most", np.float64, 3),
        ("rounding", np.float64),
        ("settled", np.float64),  # the time of it, or NaN
    ]
)


class MovingPunch(NamedTuple):
    """Arrays of the history, of the solver, and of friction."""

    sliding: SlidingArrays
    loss: LossArrays
    symmetric: FloatArray  # stiffness of the problem without loss
    pressed: FloatArray  # pressure with the loss
    field: FloatArray
    spectrum: ComplexArray
    slope: FloatArray  # q times Parseval's weights
    phase: FloatArray  # angle of each point on the circle of a period, as a complex number
    of_modes: FloatArray  # work array, one value a mode
    of_points: FloatArray  # work array, a complex number a point
    period: float
    velocity: float
    steady: npt.NDArray[Any]  # one record of `STEADY`


def arrays_of(
    contact: NormalContact, modes: SlidingModes, observables: Mapping[str, Observable]
) -> MovingPunch:
    """Return the arrays of a contact under a moving punch."""
    transforms, columns = contact.transforms, cast("FrictionColumns", observables["friction"])
    slope, phase = columns.waves
    return MovingPunch(
        sliding=modes.arrays_of_loop(),
        loss=cast("LossStiffnessSolver", contact.solver).arrays,
        symmetric=np.empty(modes.u.size),
        pressed=np.empty(contact.grid.size),
        field=transforms.empty_field(),
        spectrum=transforms.empty_spectrum(),
        slope=slope,
        phase=phase.copy().view(np.float64),  # a broadcast array is read-only, for which kernels differ
        of_modes=np.empty(modes.u.size),
        of_points=np.empty(2 * contact.grid.size),
        period=contact.grid.period[0],
        velocity=float(contact.drives.velocity.value),  # type: ignore[union-attr]
        steady=np.zeros(1, STEADY),
    )


@kernel(inner=True, borrows=True)
def smallest_of(stiffness: FloatArray) -> float:
    """kappa_1: the smallest stiffness of a mode that is not the mean."""
    smallest = stiffness[1]
    for k in range(1, stiffness.size):
        smallest = min(smallest, stiffness[k])
    return float(smallest)


@kernel(inner=True, borrows=True)
def solve_with_loss(
    solver: SolverArrays,
    moving: MovingPunch,
    stiffness: FloatArray,
    b: ComplexArray,
    h: FloatArray,
    floor: ResidualFloor,
    load_given: bool,
    load: float,
    height: float,
    start: FloatArray,
    tolerance: float,
    limit: int,
    state: SurfaceState,
) -> StepResult:
    """`LossStiffnessSolver.solve`; leaves problems that take long, and the solver is then as before."""
    loss, symmetric, pressed = moving.loss, moving.symmetric, moving.pressed
    set_symmetric(stiffness, moving.sliding.loss_stiffness, symmetric, loss.difference)
    set_stiffness(solver, symmetric, load_given)
    known, windows = solver.known[0], solver.windows.known[0]
    half_pair, kernel_before, windows_before = known.half_pair, windows.kernel, windows.windows
    set_first(solver.plans, stiffness, moving.sliding.loss_stiffness, b, start, loss)
    floor_without = ResidualFloor(smallest_of(symmetric), floor.depth, 0.0, np.inf)
    pairs, iterations, last = 1, 0, loss.first
    assessment = (np.nan, 0.0, 0.0, 0.0)
    for _ in range(_PROBLEMS):
        set_intercept(b, loss.difference, last, loss.intercept)
        whole = WholeSurface(
            solver.plans, solver.compliance, h, loss.intercept, solver.work.spectrum, solver.work.z
        )
        result = solve_step(
            solver, symmetric, whole, floor_without, load_given, load, height, start, SHARE * tolerance,
            limit, state,
        )  # fmt: skip
        if not result.solved:
            break
        add_loss(solver.plans, loss, state.spectrum, last, state.p, float(h.size), pressed)
        pairs, iterations = pairs + result.pairs + 1, iterations + result.iterations
        assessment = assess_at(solver.calls.assess, (pressed, state.u, h, floor))
        if assessment[0] <= tolerance:
            for i in range(pressed.size):
                state.p[i] = max(pressed[i], 0.0) if state.p[i] > 0.0 else 0.0
                state.gap[i] = h[i] - state.u[i]
            return StepResult(True, pairs, iterations, assessment)
        for k in range(last.size):
            last[k] = state.spectrum[k]
        for i in range(start.size):
            start[i] = state.p[i]
    known.half_pair, windows.kernel, windows.windows = half_pair, kernel_before, windows_before
    return StepResult(False, 0, 0, assessment)


@kernel(inner=True, borrows=True)
def friction(
    moving: MovingPunch, plans: Plans, p: FloatArray, u: ComplexArray, time: float
) -> tuple[float, float, float, float]:
    """`FrictionColumns.measure`."""
    of_modes, of_points, mean = moving.of_modes, moving.of_points, pairwise_sum(p) / p.size
    for i in range(p.size):
        moving.field[i] = p[i]
        of_points[2 * i], of_points[2 * i + 1] = moving.phase[2 * i] * p[i], moving.phase[2 * i + 1] * p[i]
    forward(plans, moving.field, moving.spectrum)
    for k in range(u.size):
        wave = moving.spectrum[k]
        of_modes[k] = moving.slope[k] * (wave.imag * u[k].real - wave.real * u[k].imag)
    force, position = pairwise_sum(of_modes) + 0.0, moving.velocity * time
    angle = math.atan2(pairwise_sum(of_points, 1, 2), pairwise_sum(of_points, 0, 2))
    if mean > 0.0:
        return position, force, force / mean, angle * moving.period / (2 * math.pi)
    return position, force, math.nan, math.nan


@kernel(inner=True, borrows=True)
def settles(steady: npt.NDArray[Any], time: float, pressure: float, depth: float, of_friction: float) -> bool:
    """`SteadyState.measure`; whether the run has settled."""
    now, values, settled = steady[0], (pressure, depth, of_friction), False
    if not now.asked or time < now.since or math.isnan(of_friction):
        return False
    begins = now.begun == np.inf
    if not begins:
        is_steady = True
        for i in range(3):
            now.least[i], now.most[i] = min(now.least[i], values[i]), max(now.most[i], values[i])
            least, most = now.least[i], now.most[i]
            is_steady = (
                is_steady and most - least <= now.tolerance * max(abs(least), abs(most)) + now.rounding
            )
        begins = time - now.begun >= now.window * (1 - 1e-9)
        settled = begins and is_steady
    if begins:
        now.begun = time
        for i in range(3):
            now.least[i] = now.most[i] = values[i]
    if settled:
        now.settled = time
    return settled
