"""The contact problem in a window around the contact, by transforms of twice the window's width.

Far from the contact there is no pressure, and the only condition is that nothing overlaps. The effect of
pressures in a window on the gaps in it is a convolution that involves differences of its points only: exact
by transforms of twice the width of the window, with the kernel of the whole surface at these differences
(circulant embedding: Golub and Van Loan, Matrix Computations, 2013, ch. 4.8). Where the contact takes a tenth
of the surface, an iteration costs a quarter of one on the whole surface, and stays in the inner caches. The
whole surface takes three transforms, which show whether anything overlaps elsewhere: then a larger window is
next, and where there is none the whole surface.

The preconditioner need not be exact: it is the stiffness of a surface as long as the transforms, which is
every second, fourth ... of the stiffnesses of the modes.
"""

from __future__ import annotations

from math import prod
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.contact.active_set.loop import (
    REACH,
    ContactSet,
    LoopArrays,
    iterate,
    list_runs,
    make_contact,
    make_work,
)
from gfmdlayer.contact.pressure_form import AIM, CLAMPED, CLOSE, Iterate, SurfaceState, System
from gfmdlayer.contact.residual import ResidualFloor, scales, violation
from gfmdlayer.grid.grid import parts
from gfmdlayer.grid.transforms import Plans, Transforms, backward, forward
from gfmdlayer.kernels import LANES, by_address, filled, kernel, minimum, record_type
from gfmdlayer.made_once import kept_with


@kernel(inner=True, borrows=True)
def extend_to_surface(
    window: Window, origin: Pair, surface: WholeSurface, state: SurfaceState
) -> tuple[float, tuple[float, float, float, float]]:
    """Write the state of the whole surface; two transforms."""
    # Returns the overlap that was cut off, as part of the depth, and the result of `assess`.
    largest, total = _scatter(window, origin, state.p)
    forward(surface.plans, state.p, surface.spectrum)
    _deform(surface, state.spectrum)
    backward(surface.plans, surface.spectrum, surface.z)
    overlap, lowest, gaps = _clamp(surface, window.work.now[0].rigid_shift, state)
    size, load, runs = state.u.size, window.system.load_given, window.contact.runs
    if load:
        state.spectrum[0] = _sum(surface.h) - gaps
    mean = state.spectrum[0].real / size
    pressure_scale, depth = scales(largest, max(mean, 0.0) - lowest, window.system.floor)
    per_pressure, per_gap, worst, touching = 1.0 / pressure_scale, 1.0 / depth, 0.0, 0.0
    for k in range(window.contact.counts[0].runs):
        for part in range(2):
            _, there, count = stretch(window, origin, runs[k, 0], runs[k, 1] - runs[k, 0], part)
            for i in range(there, there + count):
                worst = max(worst, violation(state.p[i], state.gap[i], per_pressure, per_gap))
                touching += 1.0 if state.p[i] * per_pressure > state.gap[i] * per_gap else 0.0
    finite = np.isfinite(total) and np.isfinite(gaps)
    return overlap / depth, (worst if finite else np.nan, touching / size, total / size, gaps / size)


@kernel(inner=True, borrows=True)
def _scatter(window: Window, origin: Pair, p: FloatArray) -> tuple[float, float]:
    """Write the pressure, where it is not zero; return its maximum and its sum."""
    largest, total = 0.0, 0.0
    for k in range(window.contact.counts[0].runs):
        first, end = window.contact.runs[k, 0], window.contact.runs[k, 1]
        for part in range(2):
            here, there, count = stretch(window, origin, first, end - first, part)
            for i in range(count):
                pressure = window.at.p[here + i]
                p[there + i] = pressure
                total += pressure
                largest = max(largest, pressure)
    return largest, total


@kernel(reorder=True, inner=True, borrows=True)
def _deform(surface: WholeSurface, spectrum: ComplexArray) -> None:
    """Write the transform of the displacement, per point and unnormalised, from the pressure's."""
    size = surface.z.size
    for k in range(spectrum.size):
        u = surface.compliance[k] * (surface.b[k] - surface.spectrum[k])
        surface.spectrum[k] = u
        spectrum[k] = size * u


@kernel(reorder=True, inner=True, borrows=True)
def _clamp(surface: WholeSurface, rigid_shift: float, state: SurfaceState) -> tuple[float, float, float]:
    """Write displacement and gap without overlap; return the overlap, the lowest u, and the sum of gaps."""
    overlap, lowest, gaps = filled(LANES, 0.0), filled(LANES, np.inf), 0.0
    for first in range(0, surface.z.size, LANES):
        z, h = surface.z[first : first + LANES], surface.h[first : first + LANES]
        us, apart = state.u[first : first + LANES], state.gap[first : first + LANES]
        # In several loops: for one loop over all of these arrays the compiler assumes that they may overlap,
        # and does not vectorise it.
        for i in range(z.size):
            apart[i] = h[i] - (z[i] + rigid_shift)
        for i in range(z.size):
            us[i] = min(h[i], z[i] + rigid_shift)
        for i in range(z.size):
            overlap[i] = apart[i] if apart[i] < overlap[i] else overlap[i]
            lowest[i] = us[i] if us[i] < lowest[i] else lowest[i]
            apart[i] = 0.0 if apart[i] < 0.0 else apart[i]
            gaps += apart[i]
    return -minimum(overlap), minimum(lowest), gaps


@kernel(reorder=True, inner=True, borrows=True)
def _sum(x: FloatArray) -> float:
    total = 0.0
    for i in range(x.size):
        total += x[i]
    return total


Pair = tuple[int, int]
Stretch = tuple[int, int]  # first point, which may be late on the periodic axis, and number of points


class Window(NamedTuple):
    """A window and the problem in it.

    Axes are two, the first of one point where the surface is a line. The window is the first points of its
    transforms, along each axis.
    """

    plans: Plans
    system: System
    at: Iterate
    contact: ContactSet
    work: LoopArrays
    length: Pair  # of the transforms
    width: Pair  # of the window
    surface: Pair  # points of the surface


class WholeSurface(NamedTuple):
    """The surface that the window is part of, and its work arrays."""

    plans: Plans
    compliance: FloatArray  # as in `System`
    h: FloatArray
    b: ComplexArray  # as in `Problem`
    spectrum: ComplexArray  # work array
    z: FloatArray  # work array


@kernel(inner=True, borrows=True)
def stretch(window: Window, origin: Pair, first: int, count: int, part: int) -> tuple[int, int, int]:
    """Locate a stretch of a line of the window on the surface, which is periodic."""
    # `origin` is line and point of the surface where the window begins. Part 0 are the points before the end
    # of the surface's line, part 1 those after it. Returns the first point of that part in the window, the
    # first on the surface, and their number.
    (rows, line), length = window.surface, window.length[1]
    start = (origin[0] + first // length) % rows * line
    column = origin[1] + first % length
    before = min(max(line - column, 0), count)
    if part == 0:
        return first, start + column, before
    return first + before, start + column + before - line, count - before


_iterate = by_address(iterate)

_APART = 1e150  # gap of the points that the window's transforms have beyond the window
_WELL_WITHIN = 0.95  # part of the tolerance within which a state is handed on
_MARGIN, _MARGIN_OF_TOLERANCE = 1e-12, 0.01  # least gap that is left, as part of depth and tolerance


@kernel(inner=True, borrows=True)
def solve(
    iterate_at: int,
    window: Window,
    origin: Pair,
    surface: WholeSurface,
    guess: FloatArray,
    load: float,
    tolerance: float,
    rounds: int,
    limit: int,
    state: SurfaceState,
) -> tuple[bool, int, int, int, float, tuple[float, float, float, float]]:
    """Solve in a window that begins at a line and a point of the surface; `load`: given mean pressure."""
    # Returns whether contact and pressure were found, transforms of the whole surface and of the window,
    # iterations, overlap of the whole surface that was cut off (as part of the depth), and the result of
    # `assess`. Where the first is true the state is written; its pressure is zero before.
    _free_surface(surface)
    at, contact, work, system = window.at, window.contact, window.work, window.system
    carried = _gather(window, origin, surface, guess)
    solved = 0.0 < carried < np.inf
    if system.load_given:
        share = load * surface.h.size / carried
        for i in range(at.p.size):
            at.p[i] *= share
    now = work.now[0]
    now.exact, now.depth_scale, now.mean, now.rigid_shift = False, 0.0, 0.0, 0.0
    now.free_mean = surface.compliance[0] * surface.b[0].real
    list_runs(contact)
    shift, within, transforms, iterations, clear = 0.0, CLOSE * tolerance, 0, 0, False
    for attempt in range(2):
        if not solved or clear:
            break
        solved, more, done = _iterate(
            iterate_at,
            (window.plans, system, at, contact, work, shift, within, rounds, limit, attempt == 0),
        )
        transforms, iterations = transforms + more, iterations + done
        solved = solved and (attempt > 0 or contact.counts[0].points > 0)
        clear = solved and _raise_clear(window, tolerance)
        # Else aim at a gap in the contact that is larger than the differences of the gaps.
        within = AIM * tolerance
        shift = within * now.depth_scale
    if not clear:
        return False, 1, transforms, iterations, 0.0, (np.nan, 0.0, 0.0, 0.0)
    overlap, assessment = extend_to_surface(window, origin, surface, state)
    return True, 3, transforms, iterations, overlap, assessment


@kernel(inner=True, borrows=True)
def _respond(plans: Plans, compliance: FloatArray, spectrum: ComplexArray, kernel: FloatArray) -> None:
    """Write the displacement of all points by a pressure at the first, with the sign of a gap."""
    for k in range(spectrum.size):
        spectrum[k] = compliance[k]
    backward(plans, spectrum, kernel)


@kernel(inner=True, borrows=True)
def _restrict(window: Window, kernel: FloatArray, stiffness: FloatArray) -> None:
    """Write compliance and stiffness of the window's transforms, from kernel and stiffness of the surface."""
    (rows, line), (window_rows, length) = window.surface, window.length
    z, system, spectrum = window.work.z, window.system, window.work.spectrum
    half, part = (length + 1) // 2, line // length
    for row in range(window_rows):
        # The second half of each axis stands for the differences below zero.
        first = (row if row < (window_rows + 1) // 2 else row + rows - window_rows) * line
        for i in range(length):
            z[row * length + i] = kernel[first + (i if i < half else i + line - length)]
    forward(window.plans, z, spectrum)
    for k in range(spectrum.size):
        system.compliance[k] = spectrum[k].real / z.size
    modes, of_surface, share = length // 2 + 1, line // 2 + 1, part * (rows // window_rows)
    for row in range(window_rows):
        first = row * (rows // window_rows) * of_surface
        for k in range(modes):
            system.stiffness[row * modes + k] = share * stiffness[first + k * part]


@kernel(reorder=True, inner=True, borrows=True)
def _free_surface(surface: WholeSurface) -> None:
    """Write the surface without pressure."""
    for k in range(surface.b.size):
        surface.spectrum[k] = surface.compliance[k] * surface.b[k]
    backward(surface.plans, surface.spectrum, surface.z)


@kernel(reorder=True, inner=True, borrows=True)
def _gather(window: Window, origin: Pair, surface: WholeSurface, guess: FloatArray) -> float:
    """Copy problem and guess into the window; return the sum of the guess."""
    gap0, h, p, member = window.system.gap0, window.system.h, window.at.p, window.contact.member
    gap0[:], h[:], p[:], member[:] = _APART, 2.0 * _APART, 0.0, 0.0
    carried = 0.0
    for row in range(window.width[0]):
        for part in range(2):
            here, there, count = stretch(window, origin, row * window.length[1], window.width[1], part)
            for i in range(count):
                height, pressure = surface.h[there + i], guess[there + i]
                gap0[here + i], h[here + i] = height - surface.z[there + i], height
                if pressure > 0.0:
                    p[here + i], member[here + i] = pressure, 1.0
            # In a loop that writes nothing: the order of a sum in one that does depends on where arrays lie.
            for i in range(count):
                carried += guess[there + i] if guess[there + i] > 0.0 else 0.0
    return carried


@kernel(reorder=True, inner=True, borrows=True)
def _raise_clear(window: Window, tolerance: float) -> bool:
    """Raise the pressure until nothing in the window overlaps, by a little more than rounding."""
    # Under a given load the punch is shifted instead. Return whether the contact stays within the tolerance;
    # else nothing is changed.
    at, gap0, contact, now = window.at, window.system.gap0, window.contact, window.work.now[0]
    depth, lift, lowest, widest = now.depth_scale, 0.0, 0.0, 0.0
    margin = min(_MARGIN, _MARGIN_OF_TOLERANCE * tolerance) * depth
    for k in range(contact.counts[0].near):
        for i in range(contact.near[k, 0], contact.near[k, 1]):
            effect, gap = at.gap[i] - gap0[i], at.gap[i]
            lowest = min(lowest, gap)
            if effect > 0.0 and gap < margin:
                lift = max(lift, (margin - gap) / effect)
            elif gap < 0.0:
                lift = np.inf
    if window.system.load_given:
        now.rigid_shift += lowest - margin
        return True
    for k in range(contact.counts[0].runs):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            widest = max(widest, at.gap[i] + lift * (at.gap[i] - gap0[i]))
    if not widest <= _WELL_WITHIN * tolerance * depth:
        return False
    for k in range(contact.counts[0].runs):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            at.p[i] *= 1.0 + lift
    return True


_WINDOW_MARGIN = 16  # points at least on either side of the contact that belong to the window

KNOWN = record_type(
    [
        ("kernel", np.bool_),  # whether the kernel is that of the present compliance
        ("windows", np.int64),  # bits of the windows that have the present stiffness
    ]
)


class WindowsOfSurface(NamedTuple):
    """The windows of a surface: what each has of its own, and the arrays that they share."""

    parts: IntArray  # the windows have 1/part of the points of each axis; ascending
    plans: IntArray  # addresses of the plans of each, (windows, 4)
    begin: IntArray  # place of the first mode of each
    compliance: FloatArray  # of all windows, one after the other
    stiffness: FloatArray
    largest: Window  # its arrays serve the others too
    kernel: FloatArray  # displacement of all points by a pressure at the first
    trial: FloatArray  # work array, a guess
    occupied: FloatArray  # work array, of rows and columns
    known: npt.NDArray[Any]  # one record of `KNOWN`
    iterate: int  # address of `loop.iterate`


class WindowResult(NamedTuple):
    """Result of the windows that were tried."""

    transforms: float  # of the whole surface, or of as many points
    iterations: int
    within: bool  # whether the state is a solution for the whole surface
    guess_known: bool  # whether a guess for the whole surface is in `WindowsOfSurface.trial`
    assessment: tuple[float, float, float, float]  # of `assess`


@kernel(borrows=True)
def solve_in_windows(
    windows: WindowsOfSurface,
    surface: WholeSurface,
    stiffness: FloatArray,
    floor: ResidualFloor,
    load_given: bool,
    load: float,
    start: FloatArray,
    tolerance: float,
    rounds: int,
    limit: int,
    state: SurfaceState,
) -> WindowResult:
    """Solve in the shortest window around a guess of the pressure; in larger ones if it is too small."""
    # Without contact in the guess, the overlap of the surface without pressure takes its place. The result
    # is empty where nothing overlaps, or no window is short enough. `stiffness` is per point; the state is
    # written where the result is within.
    known, guess, trial, lines = windows.known[0], start, windows.trial, windows.largest.surface
    transforms, iterations, below, of_state = 0.0, 0, 0, False
    assessment = (np.nan, 0.0, 0.0, 0.0)
    extent = periodic_extent(guess, lines, windows.occupied)
    if extent[1][1] == 0 and not load_given:
        _free_surface(surface)
        for i in range(trial.size):
            trial[i] = max(surface.z[i] - surface.h[i], 0.0)
        guess, transforms = trial, 1.0
        extent = periodic_extent(guess, lines, windows.occupied)
    while iterations < limit:
        which = _shortest_window(windows, extent, below)
        if which < 0:
            break
        below = windows.parts[which]
        window = _window_of(windows, which, floor, load_given, surface.compliance[0])
        if not known.windows >> which & 1:
            if not known.kernel:
                make_kernel(windows, surface.plans, surface.compliance, surface.spectrum)
                transforms += 1.0
            _restrict(window, windows.kernel, stiffness)
            known.windows |= 1 << which
        state.p[:] = 0.0
        of_state, whole, inside, more, overlap, assessment = solve(
            windows.iterate, window, _origin(extent, window), surface, guess, load, tolerance, rounds,
            limit - iterations, state,
        )  # fmt: skip
        transforms += whole + inside / (below * below if lines[0] > 1 else below)
        iterations += more
        if not of_state:
            break
        if overlap <= CLAMPED and assessment[0] <= tolerance:
            return WindowResult(transforms, iterations, True, False, assessment)
        # The pressure, with a tiny one where it overlapped.
        for i in range(trial.size):
            trial[i] = _TINY if state.p[i] == 0.0 and state.gap[i] == 0.0 else state.p[i]
        guess = trial
        extent = periodic_extent(guess, lines, windows.occupied)
    return WindowResult(transforms, iterations, False, of_state, assessment)


_TINY = 2.2250738585072014e-308


@kernel(inner=True, borrows=True)
def _shortest_window(windows: WindowsOfSurface, extent: tuple[Stretch, Stretch], below: int) -> int:
    """Return the shortest window with room for a contact, of a part below ``below`` unless that is 0."""
    (_, rows), (_, points) = extent
    if points == 0:
        return -1
    high, wide = (
        2 * (rows + 2 * max(_WINDOW_MARGIN, rows // 8)),
        2 * (points + 2 * max(_WINDOW_MARGIN, points // 8)),
    )
    lines, line = windows.largest.surface
    for which in range(windows.parts.size - 1, -1, -1):
        part = windows.parts[which]
        if wide * part <= line and (lines == 1 or high * part <= lines) and (below == 0 or part < below):
            return which
    return -1


@kernel(inner=True, borrows=True)
def _window_of(
    windows: WindowsOfSurface, which: int, floor: ResidualFloor, load_given: bool, mean_compliance: float
) -> Window:
    """Return a window, whose arrays are the beginning of those of the largest."""
    whole, part, plans = windows.largest, windows.parts[which], windows.plans
    (lines, line), at, contact, work = whole.surface, whole.at, whole.contact, whole.work
    rows, points = lines // part if lines > 1 else 1, line // part
    size, modes, first = rows * points, rows * (points // 2 + 1), windows.begin[which]
    runs = size // 2 + 1
    return Window(
        Plans(plans[which, 0], plans[which, 1], plans[which, 2], plans[which, 3]),
        System(
            windows.compliance[first : first + modes],
            windows.stiffness[first : first + modes],
            whole.system.gap0[:size],
            whole.system.h[:size],
            floor,
            load_given,
            mean_compliance,
        ),
        Iterate(at.p[:size], at.gap[:size], at.spectrum[:modes]),
        ContactSet(
            contact.member[:size],
            contact.runs[:runs],
            contact.near[:runs],
            contact.counts,
            (max(REACH, points // 64), points),
            contact.close[: size if rows > 1 else 0],
        ),
        LoopArrays(
            work.z[:size],
            work.spectrum[:modes],
            work.direction[:size],
            work.change[:size],
            work.pressure[:size],
            work.pressure_change[:size],
            work.now,
        ),
        (rows, points),
        ((rows + 1) // 2, points // 2),
        whole.surface,
    )


@kernel(inner=True, borrows=True)
def _origin(extent: tuple[Stretch, Stretch], window: Window) -> Pair:
    """Line and point where a window begins that has a contact in its middle."""
    (first_row, rows), (first, points) = extent
    return (
        (first_row + rows // 2 - window.width[0] // 2) % window.surface[0],
        (first + points // 2 - window.width[1] // 2) % window.surface[1],
    )


@kernel(borrows=True)
def periodic_extent(pressure: FloatArray, shape: Pair, occupied: FloatArray) -> tuple[Stretch, Stretch]:
    """Shortest periodic intervals of rows and of columns that hold all points with pressure > 0."""
    # `pressure` has the shape (rows * columns,), and `shape` is (rows, columns); a line has one row. Without
    # pressure the intervals are (0, 0). `occupied` is a work array of rows + columns numbers.
    rows, columns = shape
    if rows == 1:
        points = _shortest_interval(pressure)
        return (0, 1 if points[1] else 0), points
    of_rows, of_columns = occupied[:rows], occupied[rows : rows + columns]
    of_columns[:] = 0.0
    for row in range(rows):
        line, some = pressure[row * columns : (row + 1) * columns], 0.0
        for i in range(columns):
            some += 1.0 if line[i] > 0.0 else 0.0
        of_rows[row] = some
        if some > 0.0:
            for i in range(columns):
                of_columns[i] += 1.0 if line[i] > 0.0 else 0.0
    return _shortest_interval(of_rows), _shortest_interval(of_columns)


@kernel(inner=True, borrows=True)
def _shortest_interval(values: FloatArray) -> Stretch:
    """First place and length of the shortest periodic interval with all values above zero."""
    first, last, widest, begin = -1, -1, 0, 0
    for i in range(values.size):
        if values[i] > 0.0:
            if last < 0:
                first = i
            elif i - last > widest:
                widest, begin = i - last, i
            last = i
    if last < 0:
        return 0, 0
    if first - last + values.size >= widest:  # across the ends
        widest, begin = first - last + values.size, first
    return begin, values.size - widest + 1


@kernel(borrows=True)
def make_kernel(
    windows: WindowsOfSurface, plans: Plans, compliance: FloatArray, spectrum: ComplexArray
) -> None:
    """Make the kernel: the displacement of all points by a pressure at one. A transform."""
    _respond(plans, compliance, spectrum, windows.kernel)
    windows.known[0].kernel = True


def make_windows(
    transforms: Transforms, iterate_at: int, *, used: bool = True
) -> tuple[WindowsOfSurface, list[Transforms]]:
    """Return the windows of a surface, none unless they are `used`, and the transforms to keep with them."""
    shape = transforms.shape
    every, plans, begin, modes, kept = _sizes(transforms) if used else _NO_SIZES
    reserve = transforms.reserved(2, 0)
    windows = WindowsOfSurface(
        parts=every,
        plans=plans,
        begin=begin,
        compliance=np.zeros(modes),
        stiffness=np.zeros(modes),
        largest=_make_window(kept[0] if kept else transforms.of_shape((1,) * len(shape)), _two(shape)),
        kernel=reserve.empty_field(),
        trial=reserve.empty_field(),
        occupied=np.zeros(sum(shape)),
        known=np.zeros(1, dtype=KNOWN),
        iterate=iterate_at,
    )
    return windows, kept


# Divisors, plans and first modes of the windows of a surface, all their modes, and their transforms.
_Sizes: TypeAlias = tuple[IntArray, IntArray, IntArray, int, list[Transforms]]

_NO_SIZES: _Sizes = np.zeros(0, np.int64), np.zeros((0, 4), np.int64), np.zeros(0, np.int64), 0, []


@kept_with
def _sizes(transforms: Transforms) -> _Sizes:
    every = parts(transforms.shape)
    if not every:
        return _NO_SIZES
    kept = [transforms.for_window(part) for part in every]
    modes = [prod(held.spectral_shape) for held in kept]
    plans = np.array([held.plans for held in kept], dtype=np.int64).reshape(-1, 4)
    return np.array(every, dtype=np.int64), plans, np.cumsum([0, *modes])[:-1], sum(modes), kept


def _make_window(transforms: Transforms, surface: Pair) -> Window:
    """A window for some transforms, without a problem."""
    reserve = transforms.reserved(9, 2)
    gap0, h, p, gap = (reserve.empty_field() for _ in range(4))
    none, floor, length = np.zeros(0), ResidualFloor(1.0, 0.0), _two(transforms.shape)
    return Window(
        plans=transforms.plans,
        system=System(none, none, gap0, h, floor, False, 0.0),
        at=Iterate(p, gap, reserve.empty_spectrum()),
        contact=make_contact(transforms.shape),
        work=make_work(reserve),
        length=length,
        width=((length[0] + 1) // 2, length[1] // 2),
        surface=surface,
    )


def _two(shape: tuple[int, ...]) -> Pair:
    return (1, *shape)[-2], shape[-1]
