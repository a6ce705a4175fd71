"""The compiled time loop: many steps of an ordinary case without Python between them.

It takes the steps of the loop of `case.Case.run`, with the same bits, for a punch with a hard wall under a
prescribed depth, load or force, over one body at rest, with the active-set solver and the columns that every
such case has. At a step that is not ordinary it comes back, with the state before it; Python then takes this
step. `March` moves the state of the parts of the case into the arrays of the loop and back.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from gfmdlayer.case.model import Recorder
from gfmdlayer.case.normal import NormalContact
from gfmdlayer.case.tmp_history import *
from gfmdlayer.contact.loading import Loading
from gfmdlayer.history.modes import Modes
from gfmdlayer.case.tmp_history import CONTROL, STEP
from gfmdlayer.contact.active_set.solver import ActiveSet, SolverArrays, StepResult, solve_step
from gfmdlayer.contact.active_set.windows import WholeSurface
from gfmdlayer.contact.prediction import RING, PressurePrediction, Ring, predict, remember
from gfmdlayer.contact.pressure_form import SurfaceState
from gfmdlayer.contact.residual import ResidualFloor, mark_contact, scales_of
from gfmdlayer.contact.problem import DEPTH_FLOOR
from gfmdlayer.kernels import filled, kernel
from gfmdlayer.observables.contact_statistics import line_extent
from gfmdlayer.step import Fields
from gfmdlayer.time_functions import RampHold, Table

if TYPE_CHECKING:
    from gfmdlayer.case.case import Case
    from gfmdlayer.case.model import Progress
DONE, GO_ON, FULL, RARE, SNAPSHOT = range(5)

COLUMNS = (
    "time", "contact_area", "mean_pressure", "depth", "residual", "mean_stress", "force",
    "contact_area_interpolated", "contact_area_error", "transforms", "iterations", "rejected",
    "work", "stored", "dissipated", "energy_residual", "mean_gap",
)  # fmt: skip


class Constants(NamedTuple):
    """Numbers that stay the same for a run."""

    by_depth: bool
    ramp: bool  # whether the drive is a ramp and a hold, else it is a table
    adaptive: bool
    limit: int  # of the solver's iterations
    tolerance: float  # of the solver
    least_depth: float  # of `ResidualFloor`
    height: float  # range of the punch's heights
    lowest: float  # height of the lowest point of the grid
    unit: float  # of mean_pressure
    cell: float  # area of the cell, of a line its length


class Surface(NamedTuple):
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


NOW = np.dtype(
    [
        ("time", np.float64),  # of the last attempt
        ("rows", np.int64),
        ("transforms", np.int64),  # since the last row
        ("iterations", np.int64),
        ("attempts", np.int64),
        ("most", np.int64),  # points in contact
        ("shift", np.float64),  # height at which the solver has found the surface under a load
        ("stored", np.float64),
        ("dissipated", np.float64),
        ("work", np.float64),
        ("energies", np.float64),
        ("points", np.int64),  # of the curve of mean pressure over depth that are known, at most two
        ("curve", np.float64, (2, 3)),  # time, depth and mean pressure
    ]
)


@kernel(borrows=True)
def march(
    solver: SolverArrays,
    surface: Surface,
    history: HistoryArrays,
    ring: Ring,
    constants: Constants,
    control: ControlArrays,
    record: npt.NDArray[Any],
    rows: FloatArray,
    most: int,
) -> int:
    """Take at most so many attempts at steps; return why it comes back."""
    now = record[0]
    for _ in range(most):
        if is_over(control):
            return DONE
        if now.rows == len(rows):
            return FULL
        instant = next_instant(control)
        now.time = instant.time
        if instant.fresh:
            history.control[0].has_velocity = False
        terms(history, instant.step, surface.b)  # 5, 6
        prescribed = _value_at(constants.ramp, surface.drive_times, surface.drive_values, instant.time)
        place = (ring.now[0].last + 1) % 3
        predict(ring, instant.time, surface.guess)
        result = _solved(solver, surface, history, ring, constants, prescribed, place)  # 7
        if not result.solved:
            return RARE
        now.transforms += result.pairs
        now.iterations += result.iterations
        now.attempts += 1
        _, _, pressure, _ = result.assessment
        depth, response = prescribed, pressure
        if not constants.by_depth:
            depth = response = _depth_under_load(surface, history, constants, record, prescribed)
        if constants.adaptive and not accepts(
            control, history, surface.spectrum, surface.b, instant, depth, response
        ):
            continue  # a shorter one follows
        advance(history, surface.spectrum, constants.adaptive)  # 8, 9
        remember(ring, place, instant.time, instant.breakpoint)
        now.stored, now.dissipated = history.control[0].stored, history.control[0].dissipated
        _measure(
            surface, history, ring, constants, record, rows[now.rows], result, instant.time, depth, place
        )
        now.rows += 1
        if instant.snapshot:
            return SNAPSHOT
    return GO_ON


@kernel(inner=True, borrows=True)
def _value_at(ramp: bool, times: FloatArray, values: FloatArray, time: float) -> float:
    """Value of a `RampHold`, or of a `Table` as `numpy.interp` has it."""
    if ramp:
        return values[0] * min(time / times[0], 1.0)
    last = times.size - 1
    if time <= times[0]:
        return values[0]
    if time >= times[last]:
        return values[last]
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if times[middle] <= time:
            low = middle
        else:
            high = middle
    if time == times[low]:
        return values[low]
    slope = (values[low + 1] - values[low]) / (times[low + 1] - times[low])
    return slope * (time - times[low]) + values[low]


@kernel(inner=True, borrows=True)
def _solved(
    solver: SolverArrays,
    surface: Surface,
    history: HistoryArrays,
    ring: Ring,
    constants: Constants,
    prescribed: float,
    place: int,
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
            surface.problem_stiffness[k] = history.stiffness[k]
        surface.problem_b[0] = surface.problem_stiffness[0] = 0.0
    stiffness = surface.problem_stiffness
    floor = ResidualFloor(_smallest(stiffness), constants.least_depth, 0.0, np.inf)
    whole = WholeSurface(
        solver.plans, solver.compliance, h, surface.problem_b, solver.work.spectrum, solver.work.z
    )
    state = SurfaceState(surface.u, ring.p[place], ring.gap[place], surface.spectrum)
    return solve_step(
        solver, stiffness, whole, floor, not constants.by_depth, load, constants.height, surface.guess,
        constants.tolerance, constants.limit, state,
    )  # fmt: skip


@kernel(inner=True, borrows=True)
def _smallest(stiffness: FloatArray) -> float:
    """kappa_1: the smallest stiffness of a mode that is not the mean."""
    smallest = stiffness[1]
    for k in range(1, stiffness.size):
        smallest = min(smallest, stiffness[k])
    return smallest


@kernel(inner=True, borrows=True)
def _depth_under_load(
    surface: Surface, history: HistoryArrays, constants: Constants, record: npt.NDArray[Any], load: float
) -> float:
    """Give the surface the mean that a load gives it; return the depth (`Loading.surface`)."""
    size, height = surface.u.size, 0.0
    if history.stiffness[0] > 0.0:
        height = (surface.b[0].real / size - load) / history.stiffness[0]
    shift = pairwise_sum(surface.u) / size - height
    surface.spectrum[0] = height * size
    record[0].shift = shift
    return shift + constants.lowest


@kernel(inner=True, borrows=True)
def _measure(
    surface: Surface,
    history: HistoryArrays,
    ring: Ring,
    constants: Constants,
    record: npt.NDArray[Any],
    row: FloatArray,
    result: StepResult,
    time: float,
    depth: float,
    place: int,
) -> None:
    """Write the columns of an accepted step."""
    now = record[0]
    residual, area, pressure, mean_gap = result.assessment
    p, gap = ring.p[place], ring.gap[place]
    floor = ResidualFloor(_smallest(surface.problem_stiffness), constants.least_depth, 0.0, np.inf)
    pressure_scale, depth_scale = scales_of(p, surface.u, floor)
    mark_contact(p, gap, 1.0 / pressure_scale, 1.0 / depth_scale, surface.touching)
    points, between, error = line_extent(surface.touching, p, gap)
    now.most = max(now.most, points)
    energies, curve = now.stored + now.dissipated, now.curve
    if now.points == 0:
        now.work += energies - now.energies
    else:
        now.work += _work(curve, now.points, depth, pressure)
    now.energies, now.points = energies, min(now.points + 1, 2)
    for i in range(3):
        curve[0, i] = curve[1, i]
    curve[1, 0], curve[1, 1], curve[1, 2] = time, depth, pressure
    row[0], row[1], row[2], row[3], row[4] = time, area, pressure / constants.unit, depth, residual
    row[5], row[6], row[7], row[8] = pressure, pressure * constants.cell, between, error
    row[9], row[10], row[11] = now.transforms, now.iterations, now.attempts - 1
    row[12], row[13], row[14] = now.work, now.stored, now.dissipated
    row[15], row[16] = now.work - now.stored - now.dissipated, mean_gap
    now.transforms = now.iterations = now.attempts = 0


@kernel(inner=True, borrows=True)
def _work(curve: FloatArray, points: int, depth: float, pressure: float) -> float:
    """Area under the curve of mean pressure over depth to its next point (`energy_balance._area`)."""
    x, y, x0, y0 = curve[0, 1], curve[0, 2], curve[1, 1], curve[1, 2]
    width, slope = depth - x0, 0.0
    if points > 1 and (x0 - x) * width > 0.0:
        slope = ((pressure - y0) / width - (y0 - y) / (x0 - x)) / (depth - x)
    return width * (y0 + pressure) / 2.0 - slope * math.pow(width, 3.0) / 6.0


_BLOCK = 128  # numbers that numpy sums one after the other, in eight lanes
_LEVELS = 64


@kernel(inner=True, borrows=True)
def pairwise_sum(x: FloatArray) -> float:
    """Sum of an array as `numpy.sum` has it, to the bit: by halves down to blocks."""
    # Of each level the second half, and the sum of the first once it is known.
    firsts, counts, sums = filled(_LEVELS, 0.0), filled(_LEVELS, 0.0), filled(_LEVELS, 0.0)
    level, first, count = 0, 0, x.size
    while True:
        while count > _BLOCK:
            half = count // 2
            half -= half % 8
            firsts[level], counts[level] = first + half, count - half
            level, count = level + 1, half
        total = _sum_of_block(x, first, count)
        while level > 0 and counts[level - 1] == 0.0:
            level -= 1
            total = sums[level] + total
        if level == 0:
            return total
        first, count = int(firsts[level - 1]), int(counts[level - 1])
        sums[level - 1], counts[level - 1] = total, 0.0


@kernel(inner=True, borrows=True)
def _sum_of_block(x: FloatArray, first: int, count: int) -> float:
    total, whole = 0.0, count - count % 8
    if whole:
        a, b, c, d, e, f, g, h = (
            x[first], x[first + 1], x[first + 2], x[first + 3],
            x[first + 4], x[first + 5], x[first + 6], x[first + 7],
        )  # fmt: skip
        for i in range(first + 8, first + whole, 8):
            a, b, c, d = a + x[i], b + x[i + 1], c + x[i + 2], d + x[i + 3]
            e, f, g, h = e + x[i + 4], f + x[i + 5], g + x[i + 6], h + x[i + 7]
        total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for i in range(first + whole, first + count):
        total += x[i]
    return total


FEWEST_ROWS = 256
POINTS = 1 << 18  # points times attempts between two looks at signals
ATTEMPTS = 256  # between two looks at signals, at most


class BlockRecorder(Recorder, Protocol):
    """A recorder that takes many rows at once."""

    def extend(self, columns: Mapping[str, FloatArray]) -> None:
        """Record rows by their columns."""


class March:
    """The compiled loop of a case: its arrays, and the way of the state into them and back.

    Parameters
    ----------
    case : Case
        A case that `suits`.
    """

    def __init__(self, case: Case) -> None:
        contact, loading, config = case.contact, case.parts.loading, case.config
        self._case, self._contact, self._steps = case, contact, case.steps
        self._observables, self._transforms = case.observables, case.transforms
        size, modes = case.punch.size, contact.history.u.size
        spectrum, field = case.transforms.empty_spectrum, case.transforms.empty_field
        drive, by_depth, b = loading.trajectory, loading.by_depth, spectrum()
        ramp = isinstance(drive, RampHold)
        times, values = ((drive.ramp_time,), (drive.target,)) if ramp else (drive.times, drive.values)
        self._surface = Surface(
            obstacle=loading.punch if by_depth else loading.obstacle,
            h=field() if by_depth else loading.obstacle,
            b=b,
            problem_b=b if by_depth else spectrum(),
            problem_stiffness=np.empty(modes),
            u=field(),
            spectrum=spectrum(),
            guess=field(),
            touching=np.empty(size, np.bool_),
            drive_times=np.array(times, dtype=np.float64),
            drive_values=np.array(values, dtype=np.float64),
        )
        self._ring = Ring(np.empty((3, size)), np.empty((3, size)), np.zeros(1, RING))
        self._constants = Constants(
            by_depth=by_depth,
            ramp=ramp,
            adaptive=contact.control is not None,
            limit=config.solver.max_iterations,
            tolerance=contact.finer_tolerance,
            least_depth=DEPTH_FLOOR * loading.height,
            height=loading.height,
            lowest=loading.lowest,
            unit=2 * config.solid.unit,
            cell=math.prod(case.grid.period),
        )
        self._now, self._rows = np.zeros(1, NOW), np.empty((FEWEST_ROWS, len(COLUMNS)))
        m = contact.history
        self._m = m
        twice, loc, cnt = 2 * modes, m._local.position.size, m._times.size
        self._history = HistoryArrays(
            m._branches,
            m._local,
            m._springs,
            m._times,
            m.relaxed,
            np.zeros((7, cnt)),
            StepTerms(np.zeros(twice), np.zeros(cnt - loc), np.zeros(loc)),
            self._surface.problem_stiffness if by_depth else np.empty(modes),
            m.u,
            np.zeros(twice),
            np.zeros(twice),
            np.zeros(twice),
            np.zeros(twice),
            np.zeros(twice),
            np.zeros(loc),
            case.grid.sums.weights,
            case.grid.sums._weights_twice,
            np.zeros(1, CONTROL),
        )
        land = case.drives.landings
        self._control = ControlArrays(
            np.array([i.time for i in land]),
            np.array([i.breakpoint + 2 * i.snapshot for i in land]),
            config.time.tolerance,
            m.shortest_time,
            np.zeros(1, STEP),
        )
        self._attempts = max(1, min(ATTEMPTS, POINTS // size))

    @classmethod
    def suits(cls, case: Case) -> bool:
        """Whether a case is ordinary."""
        contact = case.contact
        if type(contact) is not NormalContact or tuple(c.name for c in case.columns) != COLUMNS:
            return False
        loading, kinds = contact.loading, (ActiveSet, Modes, PressurePrediction, Loading)
        parts = contact.solver, contact.history, contact.guess, loading
        drives, config = case.drives, case.config
        return (
            [type(part) for part in parts] == [*kinds]
            and isinstance(loading.trajectory, RampHold | Table)
            and case.grid.ranks.count == 1
            and len(case.grid.points) == 1
            and not loading.interface.attracts
            and not contact.imprint.yields
            and contact.reach is None
            and drives.reduced_time is None
            and case.interior is None
            and contact.finer_tolerance == config.solver.tolerance
            and contact.control is not None
        )

    def run(self, recorder: BlockRecorder, progress: Progress) -> bool:
        """Take the steps up to one that is not ordinary; return whether the run is over."""
        self._take()
        arrays = (
            self._contact.solver.arrays, self._surface, self._history, self._ring, self._constants,
            self._control, self._now,
        )  # fmt: skip
        while True:
            reason = march(*arrays, self._rows, self._attempts)
            self._record(recorder)
            if reason != FULL:
                self._give_back()
            if reason == SNAPSHOT:
                recorder.snapshot(float(self._now["time"][0]), self._snapshot())
            if reason in (DONE, RARE):
                return reason == DONE
            if progress is not None and reason != FULL:
                progress(float(self._now["time"][0]))

    def _record(self, recorder: BlockRecorder) -> None:
        """Record the rows of a stretch."""
        count = int(self._now["rows"][0])
        if count:
            recorder.extend(dict(zip(COLUMNS, self._rows[:count].T, strict=True)))
            self._rows, self._now["rows"] = np.empty_like(self._rows), 0

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
        now, parts = self._now[0], self._observables
        self._contact.guess.into(self._ring)
        effort, energy = parts["effort"].state(), parts["energy"].state()
        for name in ("transforms", "iterations", "attempts"):
            now[name] = effort[name]
        now["work"], now["energies"] = energy["work"], energy["energies"]
        curve = energy["normal"]
        now["points"] = len(curve)
        for place, row in enumerate(curve):
            now["curve"][place + 2 - len(curve)] = row[:3]
        now["most"] = parts["resolution"].state()["most"]
        self._take_history()

    def _give_back(self) -> None:
        """Give the state back to the parts."""
        now, parts = self._now[0], self._observables
        self._contact.guess.out_of(self._ring)
        parts["effort"].restore({name: now[name] for name in ("transforms", "iterations", "attempts")})
        parts["resolution"].restore({"most": now["most"]})
        count = int(now["points"])
        curve = now["curve"][2 - count :]
        parts["energy"].restore(
            {
                "work": now["work"],
                "lost": np.float64(0.0),
                "energies": now["energies"],
                "torn": np.False_,
                "normal": np.column_stack((curve, np.full(count, np.nan))),
                "tangential": np.zeros((count, 1, 2)),
            }
        )
        self._give_back_history()

    def _take_history(self):
        H, c, m = self._history, self._contact.control, self._m
        now = H.control[0]
        now["step"] = np.nan
        now["stored"], now["dissipated"] = m.stored, m.dissipated
        now["has_velocity"] = c._velocity is not None
        now["has_motion"] = c._contact_motion is not None
        if c._velocity is not None:
            H.velocity[:] = c._velocity.view(float)
        if c._contact_motion is not None:
            H.motion[:] = c._contact_motion.view(float)
        now["last_step"] = c._last_step
        s, p = self._control.now[0], self._steps._position
        s["time"], s["next_step"], s["largest_response"], s["largest_depth"], s["depth"] = (
            p.time,
            p.next_step,
            p.largest_response,
            p.largest_depth,
            p.depth,
        )
        s["next_stop"], s["after_breakpoint"], s["since"] = (
            p.next_stop,
            p.after_breakpoint,
            p.steps_since_breakpoint,
        )

    def _give_back_history(self):
        H, c, m = self._history, self._contact.control, self._m
        now = H.control[0]
        m.step = np.nan
        m.stored, m.dissipated = float(now["stored"]), float(now["dissipated"])
        c._velocity = H.velocity.view(complex).copy() if now["has_velocity"] else None
        c._contact_motion = H.motion.view(complex).copy() if now["has_motion"] else None
        c._last_step = float(now["last_step"])
        s, p = self._control.now[0], self._steps._position
        p.time, p.next_step, p.largest_response, p.largest_depth, p.depth = (
            float(s[n]) for n in ("time", "next_step", "largest_response", "largest_depth", "depth")
        )
        p.next_stop, p.after_breakpoint, p.steps_since_breakpoint = (
            int(s["next_stop"]),
            bool(s["after_breakpoint"]),
            int(s["since"]),
        )
