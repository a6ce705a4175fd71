"""The compiled time loop: many steps of an ordinary case without Python between them.

It takes the steps of the loop of `case.Case.run`, with the same bits, for a punch with a hard wall under a
prescribed depth, load or force, over one body, at rest or along it at a constant velocity (`moving`), with
the active-set solver and the columns that every such case has. At a step that is not ordinary it comes back,
with the state before it; Python then takes this step. `March` moves the state of the parts of the case into
the arrays of the loop and back.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from itertools import islice
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeGuard, cast

import numba as nb
import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from gfmdlayer.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from gfmdlayer.case.model import BlockRecorder
from gfmdlayer.case.moving import MovingPunch, arrays_of, friction, settles, smallest_of, solve_with_loss
from gfmdlayer.case.normal import NormalContact
from gfmdlayer.contact.active_set.solver import (
    ROUNDS,
    ActiveSet,
    SolverArrays,
    StepResult,
    residual_scales_at,
    solve_step,
)
from gfmdlayer.contact.active_set.windows import WholeSurface
from gfmdlayer.contact.loading import Loading
from gfmdlayer.contact.loss_stiffness import LossStiffnessSolver
from gfmdlayer.contact.prediction import RING, PressurePrediction, Ring, predict, remember
from gfmdlayer.contact.pressure_form import SurfaceState
from gfmdlayer.contact.problem import DEPTH_FLOOR, FINER_LIMIT
from gfmdlayer.contact.residual import ResidualFloor, mark_contact
from gfmdlayer.grid.sums import pairwise_sum
from gfmdlayer.history.adaptive_steps import (
    BREAKPOINT,
    RETRACTED,
    SNAPSHOT,
    STEP_STATE,
    AdaptiveSteps,
    Point,
    StepControl,
    judge,
    next_point,
    relative_error,
    scales,
    weigh,
)
from gfmdlayer.history.errors import ERROR_STATE, ErrorArrays, advance, estimate, set_terms
from gfmdlayer.history.modes import ModeArrays, Modes
from gfmdlayer.history.path_work import SWEPT, swept, work_of_step
from gfmdlayer.history.sliding_modes import SlidingArrays, SlidingModes
from gfmdlayer.history.time_points import FixedSteps
from gfmdlayer.kernels import address_of, by_address, compiling, kernel, record_type
from gfmdlayer.observables import Observable, columns
from gfmdlayer.observables.contact import ContactMeans, ContactStatistics, Force, Resolution
from gfmdlayer.observables.contact_statistics import extent_of_line, extent_of_surface
from gfmdlayer.observables.energy_balance import EnergyBalance
from gfmdlayer.observables.friction import FrictionColumns
from gfmdlayer.observables.numerics import Effort, SteadyState
from gfmdlayer.step import Fields, Instant
from gfmdlayer.time_functions import Constant, RampHold, Table

if TYPE_CHECKING:
    from gfmdlayer.case.contact import Contact
    from gfmdlayer.case.model import Progress
    from gfmdlayer.config import Config
    from gfmdlayer.history.adaptive_steps import Steps
    from gfmdlayer.observables.numerics import SteadyState

# Why the loop comes back: no further point in time, so many attempts, no room for rows, a step that is not
# ordinary, a snapshot, a steady state.
DONE, GO_ON, RARE, PICTURE, SETTLED = range(5)

COLUMNS = (
    "time", "contact_area", "mean_pressure", "depth", "residual", "mean_stress", "force",
    "contact_area_interpolated", "contact_area_error", "transforms", "iterations", "rejected",
    "work", "stored", "dissipated", "energy_residual", "mean_gap",
)  # fmt: skip
_BEFORE = 12  # columns before those of a punch that moves
COLUMNS_MOVING = (
    *COLUMNS[:_BEFORE], "position", "tangential_force", "friction", "contact_centre", *COLUMNS[_BEFORE:],
)  # fmt: skip


class LoopConstants(NamedTuple):
    """Numbers that stay the same for a run."""

    by_depth: bool
    ramp: bool  # whether the drive is a ramp and a hold, else it is a table
    adaptive: bool
    every: bool  # whether each step is a snapshot
    limit: int  # of the solver's iterations
    tolerance: float  # of the solver
    least_depth: float  # of `ResidualFloor`
    height: float  # range of the punch's heights
    lowest: float  # height of the lowest point of the grid
    unit: float  # of mean_pressure
    cell: float  # area of the cell, of a line its length
    shape: tuple[int, int]  # rows and columns; a line has one row
    # Addresses of `contact_statistics.extent_of_line` or `extent_of_surface`, and of kernels of `errors`.
    extent: int
    terms: int
    estimate: int
    advance: int


class PressedSurface(NamedTuple):
    """The surface under the punch: one value a point, or a mode."""

    obstacle: FloatArray  # surface of the punch at depth zero
    h: FloatArray
    b: ComplexArray  # intercepts of the history
    problem_b: ComplexArray  # those of the contact problem, the same array where the depth is prescribed
    problem_stiffness: FloatArray  # likewise
    u: FloatArray
    spectrum: ComplexArray
    guess: FloatArray
    touching: BoolArray
    drive_times: FloatArray
    drive_values: FloatArray


class FixedPoints(NamedTuple):
    """The next points in time of fixed steps."""

    times: FloatArray
    steps: FloatArray
    marks: IntArray


NOW = record_type(
    [
        ("time", np.float64),  # of the last attempt
        ("point", np.int64),  # number of the next one of `FixedPoints`
        ("rows", np.int64),
        ("transforms", np.int64),  # since the last row
        ("iterations", np.int64),
        ("attempts", np.int64),
        ("most", np.int64),  # points in contact
        ("shift", np.float64),  # height at which the solver has found the surface under a load
        ("work", np.float64),
        ("energies", np.float64),
        ("residual", np.float64),  # of the energy balance
        ("largest", np.float64),  # work or energy
        ("open", np.float64),  # residual
        ("points", np.int64),  # that are known of the way of the punch, at most two
        ("way", np.float64, (2, 5)),  # rows of `path_work`
        ("here", np.float64, 5),  # the row of this step
        ("swept", np.float64),  # since the first row of the way
        ("swept_rows", np.int64),
        ("tangential", np.float64, (2, 3)),  # time, position and tangential stress
    ]
)


# The observables whose columns the loop writes.
_MEASURED = {ContactMeans, Force, Resolution, Effort, EnergyBalance, ContactStatistics}


def measures(observable: Observable) -> bool:
    """Whether an observable looks at steps; others have attributes only."""
    return type(observable).measure is not Observable.measure


# Parts of a step that are called at addresses: as parts of the loop they would be compiled twice.
_extent = by_address(extent_of_line, nb.int64, nb.float64, nb.float64)
_set_terms, _estimate, _advance = (by_address(called) for called in (set_terms, estimate, advance))


@kernel(borrows=True)
def march(
    solver: SolverArrays,
    surface: PressedSurface,
    modes: ModeArrays,
    errors: ErrorArrays,
    ring: Ring,
    constants: LoopConstants,
    control: StepControl,
    fixed: FixedPoints,
    record: npt.NDArray[Any],
    rows: FloatArray,
    most: int,
    moving: MovingPunch | None,
    sliding: SlidingArrays | None,  # those of `moving`
) -> int:
    """Take at most so many attempts at steps; return why it comes back."""
    now, adaptive = record[0], constants.adaptive
    for _ in range(most):
        if (control.now[0].next_stop == control.stops.size) if adaptive else now.point == fixed.times.size:
            return DONE
        point = next_point(control) if adaptive else _fixed_point(fixed, now.point)
        now.time = point.time
        if point.fresh:
            errors.now[0].has_velocity = False
        b, u = surface.b.view(np.float64), surface.spectrum.view(np.float64)
        _set_terms(constants.terms, (modes, sliding, errors, point.step, b))  # 5, 6
        prescribed = _value_at(constants.ramp, surface.drive_times, surface.drive_values, point.time)
        place = (ring.now[0].last + 1) % 3
        predict(ring, point.time, surface.guess)
        result = _solved(solver, surface, modes, ring, constants, prescribed, place, moving)  # 7
        if not result.solved:
            return RARE
        now.transforms += result.pairs
        now.iterations += result.iterations
        now.attempts += 1
        _, _, pressure, _ = result.assessment
        depth, response = prescribed, pressure
        if not constants.by_depth:
            depth = response = _depth_under_load(surface, modes, constants, record, prescribed)
        if adaptive and not _accepted(
            constants, control, modes, errors, (u, b), point, prescribed, response, depth, sliding
        ):
            continue  # a shorter one follows
        _advance(constants.advance, (modes, sliding, errors, u, adaptive))  # 8, 9
        _sweep(ring, place, now)
        remember(ring, place, point.time, (point.marks & BREAKPOINT) != 0)
        if adaptive:
            control.now[0] = control.behind[0]
        else:
            now.point += 1
        row = rows[now.rows]
        _measure(
            solver, surface, errors, ring, constants, record, row, result, prescribed, depth, place, moving
        )
        if adaptive:
            weigh(control, now.work, now.residual)
        now.rows += 1
        if moving is not None and settles(moving.steady, point.time, pressure, depth, row[_BEFORE + 2]):
            return SETTLED
        if constants.every or (point.marks & SNAPSHOT) != 0:
            return PICTURE
    return GO_ON


@kernel(inner=True, borrows=True)
def _fixed_point(fixed: FixedPoints, i: int) -> Point:
    return Point(fixed.times[i], fixed.steps[i], fixed.marks[i], False, False)


@kernel(inner=True, borrows=True)
def _accepted(
    constants: LoopConstants,
    control: StepControl,
    modes: ModeArrays,
    errors: ErrorArrays,
    fields: tuple[FloatArray, FloatArray],
    point: Point,
    prescribed: float,
    response: float,
    depth: float,
    sliding: SlidingArrays | None,
) -> bool:
    """`AdaptiveSteps.accepts`."""
    (u, b), error, deforms = fields, 0.0, False
    if point.step != 0.0:
        moves = depth != control.now[0].depth
        deep = depth >= RETRACTED * scales(control, response, depth)[1]
        estimated = modes, sliding, errors, u, b, moves, deep
        relative, displacement = _estimate(constants.estimate, estimated)
        error = relative_error(control, response, depth, relative, displacement)
    else:
        for i in range(u.size):
            deforms = deforms or u[i] != 0.0
    return judge(control, point, prescribed, response, depth, deforms, error, (False, 0.0, 0.0))


@kernel(inner=True, borrows=True)
def _value_at(ramp: bool, times: FloatArray, values: FloatArray, time: float) -> float:
    """Value of a `RampHold`, or of a `Table` as `numpy.interp` has it."""
    if ramp:
        return float(values[0] * min(time / times[0], 1.0))
    last = times.size - 1
    if time <= times[0]:
        return float(values[0])
    if time >= times[last]:
        return float(values[last])
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if times[middle] <= time:
            low = middle
        else:
            high = middle
    if time == times[low]:
        return float(values[low])
    slope = (values[low + 1] - values[low]) / (times[low + 1] - times[low])
    return float(slope * (time - times[low]) + values[low])


@kernel(inner=True, borrows=True)
def _solved(
    solver: SolverArrays,
    surface: PressedSurface,
    modes: ModeArrays,
    ring: Ring,
    constants: LoopConstants,
    prescribed: float,
    place: int,
    moving: MovingPunch | None,
) -> StepResult:
    """Solve the contact problem of a step; its pressure and gap go to a place of the ring."""
    h, obstacle, load = surface.h, surface.obstacle, prescribed
    if constants.by_depth:
        load = 0.0
        for i in range(h.size):
            h[i] = obstacle[i] - prescribed
    else:
        for k in range(surface.b.size):
            surface.problem_b[k] = surface.b[k]
            surface.problem_stiffness[k] = modes.stiffness[k]
        surface.problem_b[0] = surface.problem_stiffness[0] = 0.0
    stiffness = surface.problem_stiffness
    floor = ResidualFloor(smallest_of(stiffness), constants.least_depth, 0.0, np.inf)
    whole = WholeSurface(
        solver.plans, solver.compliance, h, surface.problem_b, solver.work.spectrum, solver.work.z
    )
    state = SurfaceState(surface.u, ring.p[place], ring.gap[place], surface.spectrum)
    if moving is not None:
        return solve_with_loss(
            solver, moving, stiffness, surface.problem_b, h, floor, not constants.by_depth, load,
            constants.height, surface.guess, constants.tolerance, constants.limit, state,
        )  # fmt: skip
    return solve_step(
        solver, stiffness, whole, floor, not constants.by_depth, load, constants.height, surface.guess,
        constants.tolerance, constants.limit, state,
    )  # fmt: skip


@kernel(inner=True, borrows=True)
def _depth_under_load(
    surface: PressedSurface,
    modes: ModeArrays,
    constants: LoopConstants,
    record: npt.NDArray[Any],
    load: float,
) -> float:
    """Give the surface the mean that a load gives it; return the depth (`Loading.surface`)."""
    size, height = surface.u.size, 0.0
    if modes.stiffness[0] > 0.0:
        height = (surface.b[0].real / size - load) / modes.stiffness[0]
    shift = pairwise_sum(surface.u) / size - height
    surface.spectrum[0] = height * size
    record[0].shift = shift
    return float(shift + constants.lowest)


@kernel(inner=True, borrows=True)
def _sweep(ring: Ring, place: int, now: Any) -> None:
    """Set what the pressure sweeps from each of the last rows to that at a place of the ring."""
    count, last, size = ring.now[0].count, ring.now[0].last, ring.p.shape[1]
    now.swept_rows = count
    for i in range(count):  # the last one last
        at = (last + 3 - (count - 1 - i)) % 3
        now.here[SWEPT] = swept(ring.p[at], ring.gap[at], ring.p[place], ring.gap[place]) / size
        if i == 0:
            now.swept = now.here[SWEPT]


@kernel(inner=True, borrows=True)
def _measure(
    solver: SolverArrays,
    surface: PressedSurface,
    errors: ErrorArrays,
    ring: Ring,
    constants: LoopConstants,
    record: npt.NDArray[Any],
    row: FloatArray,
    result: StepResult,
    prescribed: float,
    depth: float,
    place: int,
    moving: MovingPunch | None,
) -> None:
    """Write the columns of an accepted step."""
    now = record[0]
    residual, area, pressure, mean_gap = result.assessment
    p, gap = ring.p[place], ring.gap[place]
    floor = ResidualFloor(smallest_of(surface.problem_stiffness), constants.least_depth, 0.0, np.inf)
    pressure_scale, depth_scale = residual_scales_at(solver.calls.scales, (p, surface.u, floor))
    mark_contact(p, gap, 1.0 / pressure_scale, 1.0 / depth_scale, surface.touching)
    points, between, error = _extent(constants.extent, (surface.touching, p, gap, constants.shape))
    now.most = max(now.most, points)
    stored, dissipated, way, here = errors.now[0].stored, errors.now[0].dissipated, now.way, now.here
    energies, at = stored + dissipated, _BEFORE
    if moving is not None:
        row[at], row[at + 1], row[at + 2], row[at + 3] = friction(
            moving, solver.plans, p, surface.spectrum, now.time
        )
        at += 4
    here[0], here[1], here[2], here[3] = now.time, depth, pressure, prescribed
    if now.points == 0:
        now.work += energies - now.energies
    else:
        work = work_of_step(way, min(now.points, now.swept_rows), here, now.swept)
        if moving is not None:
            work += _work(now.tangential, now.points, row[_BEFORE], row[_BEFORE + 1])
        now.work += work
    now.residual = now.work - stored - dissipated
    now.largest = max(now.largest, abs(now.work), energies)
    now.open = max(now.open, abs(now.residual))
    now.energies, now.points = energies, min(now.points + 1, 2)
    for i in range(here.size):
        way[0, i], way[1, i] = way[1, i], here[i]
    if moving is not None:
        curve = now.tangential
        for i in range(3):
            curve[0, i] = curve[1, i]
        curve[1, 0], curve[1, 1], curve[1, 2] = now.time, row[_BEFORE], row[_BEFORE + 1]
    row[0], row[1], row[2], row[3], row[4] = now.time, area, pressure / constants.unit, depth, residual
    row[5], row[6], row[7], row[8] = pressure, pressure * constants.cell, between, error
    row[9], row[10], row[11] = now.transforms, now.iterations, now.attempts - 1
    row[at], row[at + 1], row[at + 2] = now.work, stored, dissipated
    row[at + 3], row[at + 4] = now.residual, mean_gap
    now.transforms = now.iterations = now.attempts = 0


@kernel(inner=True, borrows=True)
def _work(curve: FloatArray, points: int, position: float, stress: float) -> float:
    """Area under the curve of tangential stress over position to its next point (`energy_balance._area`)."""
    x, y, x0, y0 = curve[0, 1], curve[0, 2], curve[1, 1], curve[1, 2]
    width, slope = position - x0, 0.0
    if points > 1 and (x0 - x) * width > 0.0:
        slope = ((stress - y0) / width - (y0 - y) / (x0 - x)) / (position - x)
    return float(width * (y0 + stress) / 2.0 - slope * math.pow(width, 3.0) / 6.0)


MOST_POINTS = 1 << 16  # beyond, copies of the fields cost more than Python's part of a step
POINTS = 1 << 18  # points times attempts between two looks at signals
ATTEMPTS = 256  # between two looks at signals, at most


def takes(config: Config) -> bool:
    """Whether the loop takes cases of this size, if they are ordinary."""
    return math.prod(config.grid.points) <= MOST_POINTS


class March:
    """The compiled loop of a case: its arrays, and the way of the state into them and back.

    Parameters
    ----------
    contact : NormalContact
        The contact of a case that `suits`.
    steps : Steps
        Its time points.
    observables : dict
        Its observables.
    """

    _left_before: ClassVar[bool] = False  # whether this process has taken a step that is not ordinary

    def __init__(self, contact: NormalContact, steps: Steps, observables: Mapping[str, Observable]) -> None:
        loading, config, grid = contact.loading, contact.config, contact.grid
        self._contact, self._steps, self._observables = contact, steps, observables
        # Of the kinds that `suits` has found.
        self._modes, self._instants = cast("Modes", contact.history), iter(steps)
        solver = contact.solver.inner if isinstance(contact.solver, LossStiffnessSolver) else contact.solver
        self._solver, self._guess = cast("ActiveSet", solver), cast("PressurePrediction", contact.guess)
        drive = cast("RampHold | Table", loading.trajectory)
        self._left: list[Instant] = []  # fixed steps that are not taken yet
        transforms, sums, size = contact.transforms, grid.sums, grid.size
        spectrum, field, count = transforms.empty_spectrum, transforms.empty_field, self._modes.u.size
        by_depth, b = loading.by_depth, spectrum()
        times: ArrayLike
        values: ArrayLike
        if isinstance(drive, RampHold):
            times, values = (drive.ramp_time,), (drive.target,)
        else:
            times, values = drive.times, drive.values
        self._surface = PressedSurface(
            obstacle=loading.punch.copy(),  # arrays of a sweep are read-only, for which kernels differ
            h=field() if by_depth else loading.obstacle.copy(),
            b=b,
            problem_b=b if by_depth else spectrum(),
            problem_stiffness=np.empty(count),
            u=field(),
            spectrum=spectrum(),
            guess=field(),
            touching=np.empty(size, np.bool_),
            drive_times=np.array(times, dtype=np.float64),
            drive_values=np.array(values, dtype=np.float64),
        )
        rows, line = (1, *grid.points)[-2:]
        measured = extent_of_line if rows == 1 else extent_of_surface
        self._ring = Ring(np.empty((3, size)), np.empty((3, size)), np.zeros(1, RING))
        adaptive = isinstance(steps, AdaptiveSteps)
        weights, state = (sums.weights, sums.weights_twice), np.zeros(1, ERROR_STATE)
        work = np.empty((5, 2 * count if adaptive else 0))
        self._errors = ErrorArrays(*weights, *work, state)  # type: ignore[call-arg]
        self._control = steps.control if isinstance(steps, AdaptiveSteps) else _NO_CONTROL
        self._fixed = _NO_POINTS
        self._moving: MovingPunch | None = None
        if isinstance(self._modes, SlidingModes):
            self._moving = arrays_of(contact, self._modes, observables)
        self._sliding = None if self._moving is None else self._moving.sliding
        history = self._modes.arrays, self._sliding, self._errors
        finer, most = contact.finer_tolerance, config.solver.max_iterations
        self._constants = LoopConstants(
            by_depth=by_depth,
            ramp=isinstance(drive, RampHold),
            adaptive=adaptive,
            every=config.output.snapshots == "every",
            limit=min(FINER_LIMIT, most) if finer < config.solver.tolerance else most,
            tolerance=finer,
            least_depth=DEPTH_FLOOR * loading.height,
            height=loading.height,
            lowest=loading.lowest,
            unit=2 * config.solid.unit,
            cell=math.prod(grid.period),
            shape=(rows, line),
            extent=address_of(measured, *_EXTENT),
            terms=address_of(set_terms, *history, 0.0, _NONE),
            estimate=address_of(estimate, *history, _NONE, _NONE, False, False),
            advance=address_of(advance, *history, _NONE, False),
        )
        self._attempts = max(1, min(ATTEMPTS, POINTS // size))
        self._columns = COLUMNS if self._moving is None else COLUMNS_MOVING
        self._now, self._rows = np.zeros(1, NOW), np.empty((self._attempts, len(self._columns)))

    @classmethod
    def suits(cls, contact: Contact, observables: Mapping[str, Observable]) -> TypeGuard[NormalContact]:
        """Whether the case of a contact is ordinary."""
        config, loading, grid = contact.config, contact.loading, contact.grid
        names = tuple(column.name for column in columns(config))
        if type(contact) is not NormalContact or names not in (COLUMNS, COLUMNS_MOVING):
            return False
        solver, rests = contact.solver, names == COLUMNS
        if not rests:
            if not (
                isinstance(solver, LossStiffnessSolver) and isinstance(contact.drives.velocity, Constant)
            ):
                return False
            solver = solver.inner
        parts = solver, contact.history, contact.guess, loading
        measured = _MEASURED if rests else {*_MEASURED, FrictionColumns, SteadyState}
        return (
            [*map(type, parts)] == [ActiveSet, Modes if rests else SlidingModes, PressurePrediction, Loading]
            and type(loading.trajectory) in (RampHold, Table)
            and cast("ActiveSet", solver).rounds == ROUNDS
            and {type(each) for each in observables.values() if measures(each)} <= measured
            and grid.ranks.count == 1
            and takes(config)
            and not loading.interface.attracts
            and not loading.by_gap
            and not contact.imprint.yields
            and contact.reach is None
            and contact.drives.reduced_time is None
            and contact.parts.interior is None
        )

    def left_over(self, recorder: BlockRecorder, progress: Progress) -> Iterator[Instant]:
        """Take the steps; yield the instants of those that are not ordinary."""
        while not self._run(recorder, progress):
            with ExitStack() as stack:
                if not March._left_before:  # Python's kernels are rarely needed, and not compiled beforehand
                    stack.enter_context(compiling())
                yield self._left.pop(0) if self._left else next(self._instants)
            March._left_before = True

    def _run(self, recorder: BlockRecorder, progress: Progress) -> bool:
        """Take the steps up to one that is not ordinary; return whether the run is over."""
        self._take()
        while True:
            if not self._constants.adaptive:
                self._left += islice(self._instants, self._attempts - len(self._left))
                if not self._left:
                    return True
                self._fixed = _points(self._left)
            modes, surface = self._modes.arrays, self._surface
            if self._constants.by_depth:
                surface = surface._replace(problem_stiffness=modes.stiffness)
            reason = march(
                self._solver.arrays, surface, modes,
                self._errors, self._ring, self._constants, self._control, self._fixed, self._now, self._rows,
                self._attempts, self._moving, self._sliding,
            )  # fmt: skip
            reached = self._record(recorder)
            self._give_back()
            if reason in (PICTURE, SETTLED):
                recorder.snapshot(float(self._now["time"][0]), self._snapshot())
            if progress is not None and (reached is not None or reason == GO_ON):
                progress(float(self._now["time"][0]) if reached is None else reached)
            if reason in (RARE, SETTLED) or (reason == DONE and self._constants.adaptive):
                return bool(reason != RARE)

    def _record(self, recorder: BlockRecorder) -> float | None:
        """Record the rows of a stretch; return the time of the last one."""
        count, taken = int(self._now["rows"][0]), int(self._now["point"][0])
        reached = float(self._rows[count - 1, 0]) if count else None
        if count:
            recorder.extend_rows(dict.fromkeys(self._columns, 1), self._rows[:count])
            self._rows, self._now["rows"] = np.empty_like(self._rows), 0
        if isinstance(self._steps, FixedSteps):
            self._steps.advance(taken)
            del self._left[:taken]
            self._now["point"] = 0
        return reached

    def _snapshot(self) -> Mapping[str, FloatArray]:
        """Return the fields of the last step."""
        surface, place = self._surface, self._ring.now["last"][0]
        shift = float(self._now["shift"][0])
        return self._contact.recorded(
            Fields(
                displacement=surface.u - shift if shift else surface.u.copy(),
                pressure=self._ring.p[place].copy(),
                gap=np.where(surface.touching, 0.0, self._ring.gap[place]),
            )
        )

    def _take(self) -> None:
        """Take over the state of the parts."""
        now, of_errors, parts = self._now[0], self._errors.now[0], self._observables
        self._guess.into(self._ring)
        if self._contact.control is not None:
            self._contact.control.into(self._errors)
        of_errors["step"] = np.nan
        of_errors["stored"], of_errors["dissipated"] = self._modes.stored, self._modes.dissipated
        effort, energy = parts["effort"].state(), parts["energy"].state()
        for name in ("transforms", "iterations", "attempts"):
            now[name] = effort[name]
        for name in ("work", "energies", "largest", "open"):
            now[name] = energy[name]
        way = energy["normal"]
        now["points"] = len(way)
        for place, row in enumerate(way, 2 - len(way)):
            now["way"][place] = row[:5]
        now["most"] = parts["resolution"].state()["most"]
        if self._moving is not None:
            for place, points in enumerate(energy["tangential"], 2 - len(way)):
                now["tangential"][place] = 0.0, *points[0]
            cast("SlidingModes", self._modes).into(self._moving.sliding)
            if "steady_state" in parts:
                cast("SteadyState", parts["steady_state"]).into(self._moving.steady)

    def _give_back(self) -> None:
        """Give the state back to the parts."""
        now, of_errors, parts = self._now[0], self._errors.now[0], self._observables
        self._guess.out_of(self._ring)
        if self._contact.control is not None:
            self._contact.control.out_of(self._errors)
        self._modes.step = np.nan  # its arrays are those of another step
        self._modes.stored, self._modes.dissipated = (
            float(of_errors["stored"]),
            float(of_errors["dissipated"]),
        )
        parts["effort"].restore({name: now[name] for name in ("transforms", "iterations", "attempts")})
        parts["resolution"].restore({"most": now["most"]})
        count = int(now["points"])
        way = now["way"][2 - count :]
        parts["energy"].restore(
            {
                "work": now["work"],
                "lost": np.float64(0.0),
                "energies": now["energies"],
                "attraction": np.float64(0.0),
                "strength": np.float64(0.0),
                "largest": now["largest"],
                "open": now["open"],
                "torn": np.False_,
                "normal": np.column_stack((way, np.full(count, np.nan))),
                "tangential": now["tangential"][2 - count :, None, 1:].copy(),
            }
        )
        if self._moving is not None:
            cast("SlidingModes", self._modes).out_of(self._moving.sliding)
            if "steady_state" in parts:
                cast("SteadyState", parts["steady_state"]).out_of(self._moving.steady)


def _points(instants: list[Instant]) -> FixedPoints:
    """Return instants as arrays."""
    return FixedPoints(
        np.array([instant.time for instant in instants]),
        np.array([instant.step for instant in instants]),
        np.array(
            [BREAKPOINT * instant.breakpoint + SNAPSHOT * instant.snapshot for instant in instants], np.int64
        ),
    )


_NONE = np.zeros(0)  # arguments, for their types
_EXTENT = np.zeros(0, np.bool_), _NONE, _NONE, (1, 1)
_NO_POINTS = _points([])
_NO_CONTROL = StepControl(
    _NO_POINTS.times, _NO_POINTS.marks, 0.0, 0.0, 0.0, 0.0, False, 0.0, 0.0, 0.0,
    *np.zeros((2, 1), STEP_STATE),
)  # fmt: skip
