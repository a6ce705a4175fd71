"""Projected conjugate gradients with nested grids, for large rough surfaces.

The iteration stands in `iteration`, with its state. Around it are

Nested grids
    Without a good guess the problem is solved on a grid of some 64 points along its shorter axis first, and
    its pressure is the guess for the next finer grid (`nest`). A few corrections are left for the given grid.
Precision
    The iteration is in single precision where that resolves the gaps. Its last state is evaluated in double
    precision. Where its residual is too large, the iteration goes on from there with pressure and gap in
    double precision, to which corrections in single are added, whose errors shrink with them.
Hardness
    Gaps are the unknowns. Where the body has no local stiffness, as a thin incompressible layer on a rigid
    base, or where the residual falls no more, the points at the hardness are taken out of the contact, under
    their known pressure, and the set of these points is corrected until it stays.
Hand-over
    Where the residual falls no more, as for a film a thousand times stiffer than its base in the imprint that
    a punch has left, the active set takes the problem from the last pressure.

All sums, rows beside those of this process and transforms go through the grid, which ranks may share.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Literal

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.active_set.loop import iterate
from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.contact.nested.iteration import (
    Complements,
    FieldExtent,
    GridLevel,
    NestedFields,
    Search,
    depart,
    form_of,
    narrow,
    open_up,
    press_closed,
    project,
    settle,
    settle_gap,
)
from gfmdlayer.contact.pressure_form import CLAMPED, CLOSE, HEIGHT_ROUNDING, trivial_solution
from gfmdlayer.contact.problem import Problem, Solution, make_solution
from gfmdlayer.contact.residual import assess_over, scales_over
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.kernels import compiling, kernel
from gfmdlayer.resumable import State

# Nested grids: the problem on a coarser grid has truncated Fourier series of the gap and of the stiffness.
# Pressures are interpolated. Near the edge of the contact the pressure falls like xi^(1/2) and the gap opens
# like xi^(3/2) with the distance xi (see `prediction`), so s = p^2 inside and s = -mu gap^(2/3) outside is
# smooth there and interpolated linearly. Where all points around are in contact, cubic polynomials
# interpolate the pressure itself.

_BEFORE, _AFTER = 3, 4  # rows of the coarse grid that rows of the fine one may need beside their own
# Of residual and iterations on a coarser grid; of gaps a residual is in pressures.
_COARSE_TOLERANCE, _COARSE_GAPS, _COARSE_LIMIT = 1e-3, 1e-2, 60


def prolong(coarse: GridLevel, at: NestedFields, fine: GridLevel, h: FloatArray, target: FloatArray) -> None:
    """Write the unknowns of a finer grid under the punch h, from the state of the coarse one."""
    shape = (-1, coarse.grid.shape[-1])
    p, gap = at.p.reshape(shape), np.maximum(at.gap - at.level, 0.0).reshape(shape)
    (inside, pressed, outside, apart), _ = coarse.parallel(_at_edges, p, *coarse.grid.halo(p, 1, 1), gap)
    squares, openings = inside / max(pressed, 1.0), apart / max(outside, 1.0)
    mu = squares / openings if openings > 0 else 0.0
    fields = [np.empty((_BEFORE + len(p) + _AFTER, p.shape[1])) for _ in range(3)]
    values, smooth, deep = inner = [field[_BEFORE:-_AFTER] for field in fields]
    coarse.parallel.only(_smooth, p, *coarse.grid.halo(p, 1, 1), gap, mu, smooth, deep)
    values[:] = (at.h - at.gap).reshape(shape) if coarse.form.gaps else p
    if at.cap is not None:  # up to the hardness the pressure behaves as down to zero
        rest, flow = at.cap - p, np.maximum(-at.gap, 0.0).reshape(shape)
        beside = coarse.grid.halo(rest, 1, 1)
        (inside, pressed, outside, apart), _ = coarse.parallel(_at_edges, rest, *beside, flow)
        mu = inside / max(pressed, 1.0) * outside / apart if apart > 0 else 0.0
        coarse.parallel.only(_smooth, rest, *beside, flow, mu, deep, np.empty_like(flow))
    for field, part in zip(fields, inner, strict=True):
        field[:_BEFORE], field[-_AFTER:] = coarse.grid.halo(part, _BEFORE, _AFTER)
    place = fine.grid.first_row, _BEFORE - coarse.grid.first_row
    rows = (1, 1) if len(fine.grid.points) == 1 else (fine.grid.points[0], coarse.grid.points[0])
    where = fine.grid.shape[-1], place, rows
    if coarse.form.gaps:
        yields = None if at.cap is None else fields[2]
        fine.parallel.only(_interpolate_gaps, *where, *fields[:2], yields, h, target)
    else:
        fine.parallel.only(_interpolate, *where, *fields, target)


@kernel(reorder=True)
def _at_edges(
    first: int, end: int, p: FloatArray, before: FloatArray, after: FloatArray, gap: FloatArray
) -> tuple[tuple[float, float, float, float], tuple[float]]:
    """Return sums over the two sides of the edge: p^2 and points inside, points and gap^(2/3) outside."""
    rows, n = p.shape
    squares, pressed, outside, apart = 0.0, 0.0, 0.0, 0.0
    for i in range(first // n, end // n):
        up = p[i - 1] if i > 0 else before[0]
        down = p[i + 1] if i < rows - 1 else after[0]
        for j in range(n):
            left, right = p[i, j - 1], p[i, j + 1 if j < n - 1 else 0]
            if p[i, j] > 0.0:
                if min(min(up[j], down[j]), min(left, right)) <= 0.0:
                    squares += p[i, j] ** 2
                    pressed += 1.0
            elif max(max(up[j], down[j]), max(left, right)) > 0.0:
                apart += np.cbrt(gap[i, j] ** 2)
                outside += 1.0
    return (squares, pressed, outside, apart), (0.0,)


@kernel
def _smooth(
    first: int, end: int, p: FloatArray, before: FloatArray, after: FloatArray, gap: FloatArray, mu: float,
    smooth: FloatArray, deep: FloatArray,
) -> None:  # fmt: skip
    """Write the field that is smooth across the edge, and 1 where all neighbours are in contact too."""
    # Far from the contact any negative value does.
    rows, n = p.shape
    for i in range(first // n, end // n):
        up = p[i - 1] if i > 0 else before[0]
        down = p[i + 1] if i < rows - 1 else after[0]
        here = p[i]
        for j in range(n):
            east = j + 1 if j < n - 1 else 0
            west = j - 1 if j > 0 else n - 1
            deep[i, j] = 0.0
            if here[j] > 0.0:
                smooth[i, j] = here[j] ** 2
                if up[j] > 0.0 and down[j] > 0.0 and here[east] > 0.0 and here[west] > 0.0:
                    deep[i, j] = 1.0
                continue
            around = here[east] + here[west] + up[west] + up[j] + up[east] + down[west] + down[j] + down[east]
            smooth[i, j] = -mu * np.cbrt(gap[i, j] ** 2) if around > 0.0 else -1.0


@kernel(inner=True)
def _weights(part: float) -> Any:
    """Lagrange's weights of the cubic polynomial through -1, 0, 1, 2 at a point between 0 and 1."""
    return (
        -part * (part - 1.0) * (part - 2.0) / 6.0,
        (part + 1.0) * (part - 1.0) * (part - 2.0) / 2.0,
        -(part + 1.0) * part * (part - 2.0) / 2.0,
        (part + 1.0) * part * (part - 1.0) / 6.0,
    )


@kernel(reorder=True)
def _interpolate(
    first: int, end: int, columns: int, place: tuple[int, int], whole: tuple[int, int], p: FloatArray,
    smooth: FloatArray, deep: FloatArray, target: FloatArray,
) -> None:  # fmt: skip
    """Interpolate rows of the fine grid from coarse fields, with rows beside those of this process."""
    # `place` is the row of the whole fine grid that is the first here, and the row of the coarse fields that
    # is the first of the grid; `whole` the rows of the whole grids, fine and coarse.
    n = p.shape[1]
    for i in range(first // columns, end // columns):
        y = (i + place[0]) * whole[1] / whole[0]
        row = int(y)
        y -= row
        row, wy = row + place[1], _weights(y)
        for j in range(columns):
            x = j * n / columns
            m = int(x)
            x -= m
            right = m + 1 if m + 1 < n else 0
            if max(max(p[row, m], p[row, right]), max(p[row + 1, m], p[row + 1, right])) <= 0.0:
                target[i * columns + j] = 0.0
                continue
            inner = deep[row, m] + deep[row, right] + deep[row + 1, m] + deep[row + 1, right]
            if inner == 4.0:
                wx, value = _weights(x), 0.0
                for a in range(4):
                    line = 0.0
                    for b in range(4):
                        line += wx[b] * p[row + a - 1, (m + b - 1) % n]
                    value += wy[a] * line
                target[i * columns + j] = max(value, 0.0)
            else:
                s = (1.0 - y) * ((1.0 - x) * smooth[row, m] + x * smooth[row, right])
                s += y * ((1.0 - x) * smooth[row + 1, m] + x * smooth[row + 1, right])
                target[i * columns + j] = np.sqrt(s) if s > 0.0 else 0.0


@kernel(reorder=True)
def _interpolate_gaps(
    first: int, end: int, columns: int, place: tuple[int, int], whole: tuple[int, int], u: FloatArray,
    smooth: FloatArray, yields: Any, h: FloatArray, target: FloatArray,
) -> None:  # fmt: skip
    """Interpolate displacements by cubic polynomials; write the gap of the fine grid, closed in contact."""
    # Where a field `yields` is negative, the gap is too.
    n = u.shape[1]
    line, edge = np.empty(n + 3), np.empty(n + 1)  # with the points beside the first and the last
    left, part, weights = np.empty(columns, np.int64), np.empty(columns), np.empty((4, columns))
    for j in range(columns):
        x = j * n / columns
        left[j], part[j] = int(x), x - int(x)
        weights[0, j], weights[1, j], weights[2, j], weights[3, j] = _weights(x - int(x))
    halves, inner = weights[:, 1], np.empty(columns)
    for i in range(first // columns, end // columns):
        y = (i + place[0]) * whole[1] / whole[0]
        row = int(y)
        y -= row
        row, wy = row + place[1], _weights(y)
        one, two, three, four = u[row - 1], u[row], u[row + 1], u[row + 2]
        near, far, middle = smooth[row], smooth[row + 1], line[1:]
        for m in range(n):
            middle[m] = wy[0] * one[m] + wy[1] * two[m] + wy[2] * three[m] + wy[3] * four[m]
            edge[m] = near[m] + y * (far[m] - near[m])
        line[0], line[n + 1], line[n + 2], edge[n] = line[n], line[1], line[2], edge[0]
        hs, gaps = h[i * columns : (i + 1) * columns], target[i * columns : (i + 1) * columns]
        if columns == 2 * n:
            second, third, fourth, beside = line[1:], line[2:], line[3:], edge[1:]
            for m in range(n):
                between = halves[0] * line[m] + halves[1] * second[m] + halves[2] * third[m]
                gaps[2 * m], gaps[2 * m + 1] = second[m], between + halves[3] * fourth[m]
                inner[2 * m], inner[2 * m + 1] = edge[m], 0.5 * (edge[m] + beside[m])
        else:
            for j in range(columns):
                m = left[j]
                gaps[j] = weights[0, j] * line[m] + weights[1, j] * line[m + 1]
                gaps[j] += weights[2, j] * line[m + 2] + weights[3, j] * line[m + 3]
                inner[j] = edge[m] + part[j] * (edge[m + 1] - edge[m])
        for j in range(columns):
            gap = hs[j] - gaps[j]
            gaps[j] = 0.0 if (inner[j] > 0.0) | (gap < 0.0) else gap
            if yields is not None:
                m = left[j]
                right = m + 1 if m + 1 < n else 0
                here = yields[row, m] + y * (yields[row + 1, m] - yields[row, m])
                beside = yields[row, right] + y * (yields[row + 1, right] - yields[row, right])
                gaps[j] = min(gap, 0.0) if here + part[j] * (beside - here) < 0.0 else gaps[j]


def nest(fine: GridLevel, transforms: Transforms, problem: Problem, at: NestedFields) -> float:
    """Write the unknowns of a first guess; return the pairs in single precision, as parts of fine ones."""
    surface = transforms.forward(problem.obstacle)
    free = np.zeros_like(surface)
    fine.displace(problem, free, np.empty_like(free))
    last, pairs = None, 0.0
    for grid in reversed(fine.grid.nested[1:]):
        coarse = transforms.of_shape(grid.points, single=True)
        stiffness = transforms.truncated(problem.stiffness, coarse)
        level = GridLevel(grid, coarse, problem, stiffness, fine.form, fine.fits)
        fields = (coarse.backward(transforms.truncated(waves, coarse)) for waves in (surface, free))
        h, displaced = (field.astype(np.float64) / fine.grid.size for field in fields)
        load = None if at.load is None else at.load * grid.size / fine.grid.size
        state = NestedFields(h, h - displaced, np.zeros_like(h), np.zeros_like(h), load, at.cap)
        if not _prolonged(last, level, state):
            _touch(level, state)
        if fine.form.gaps:
            _search_gaps(level, state)
        else:
            level.add_response(state)
            level.set_scales(state)
            search = Search(level, state.unknowns())
            search.run(_COARSE_TOLERANCE, _COARSE_LIMIT)
            state.level = search.at.level
        pairs += (level.pairs + 1) * grid.size / fine.grid.size
        last = level, state
    if not _prolonged(last, fine, at):
        if at.load is not None:  # its place holds the gap of a guess, if anything
            at.gap0[:] = problem.obstacle - transforms.backward(free) / fine.grid.size
        _touch(fine, at)
    return pairs


def _search_gaps(level: GridLevel, at: NestedFields) -> None:
    """Search from the gap of a guess on a coarser grid; write the pressure."""
    np.subtract(at.gap, at.gap0, out=level.step, casting="same_kind")
    level.respond()
    at.p[:] = level.change
    if at.load is not None:
        at.p += at.load / level.grid.size
    search = Search(level, level.gaps_of(at))
    search.run(_COARSE_GAPS, _COARSE_LIMIT)
    level.parallel.only(press_closed, search.at.level, np.inf if at.cap is None else at.cap, at.gap, at.p)
    at.level = 0.0


def _prolonged(last: tuple[GridLevel, NestedFields] | None, level: GridLevel, at: NestedFields) -> bool:
    """Write the unknowns of a coarser grid, of the given sum; return whether there are any."""
    if last is None:
        return False
    prolong(*last, level, at.h, at.gap if level.form.gaps else at.p)
    return level.set_sum(at) if level.form.gaps else level.set_load(at)


def _touch(level: GridLevel, at: NestedFields) -> None:
    """Write first unknowns: closed, or under pressure, where the punch lies lowest."""
    sums = level.grid.sums
    lowest, mean = sums.minimum(float(at.gap0.min())), sums.mean(at.gap0)
    # Where the load is given, half way up to the mean height.
    height = 0.0 if at.load is None else 0.5 * (lowest + mean)
    if level.form.gaps:
        np.fmax(at.gap0 - height, 0.0, out=at.gap)
        level.set_sum(at)
        return
    np.multiply(level.stiffest, np.fmax(height - at.gap0, 0.0), out=at.p)
    if not level.set_load(at) and at.load is not None:
        at.p[:] = at.load / level.grid.size  # the punch lies equally low everywhere


# Residual of a guess from which coarser grids are the better beginning. Of a gap the pressure has peaks at
# the edges of the contact, which few iterations smooth.
_POOR, _POOR_GAPS = 0.1, 2.0
_LIMIT = 400  # iterations between two evaluations in double precision
_PROGRESS = 0.5  # part of the last residual that an evaluation has to find
# Tolerance, and scale of depth as part of the largest gap, below which pressure and gap are in double
# precision while it iterates.
_SINGLE, _SHALLOW = 1e-7, 1e-2
_EXTRAPOLATED = 1e-12  # rounding, relative, of a guess from pressures at the hardness
_CORRECTIONS = 30  # of the set of points at the hardness
_AIM = 0.5 * CLOSE  # part of the tolerance that is aimed at as a gap where the punch cannot be shifted


class NestedGradient:
    """The solver for the steps of one run, on a grid or else on the grid of the transforms, of period 1."""

    starts_from: ClassVar[Literal["displacement", "pressure"]] = "pressure"

    def __init__(self, transforms: Transforms, grid: Grid | None = None) -> None:
        # `spent` counts the FFT pairs of the last step in double and in single precision, those of coarser
        # grids as parts.
        self._transforms = transforms
        self._grid = grid or Grid(transforms.shape, (1.0,) * len(transforms.shape))
        self._fine: GridLevel | None = None
        self._stiffness: FloatArray = np.empty(0)
        self._kind: tuple[object, ...] = ()  # whether no load is given, whether it yields, the form
        self._narrow: list[FloatArray] = []  # in single precision: pressure, gap, gap without pressure
        self._work = transforms.empty_spectrum()
        self._part = 0.0  # of a pair that is counted with the next step
        self._doubles = 0.0
        self.spent = 0.0, 0.0

    def solve(
        self, problem: Problem, start: FloatArray, tolerance: float = 1e-6, limit: int = 20_000
    ) -> Solution:
        """Solve from a first guess of the pressure, one value a point."""
        if trivial := trivial_solution(problem, self._transforms):
            return trivial
        self._doubles, coarse, self.spent = 0.0, 0.0, (0.0, 0.0)
        fine = self._level_of(problem)
        if problem.hardness < np.inf and not fine.form.gaps:
            return self._by_sets(problem, start, (0, 0), tolerance, limit)
        at = self._fields(fine, problem, start, tolerance)
        if at.load is None and self._grid.sums.minimum(float(at.gap0.min())) >= 0.0:
            return self._no_contact(fine, problem, at, tolerance)
        search = self._from_guess(fine, problem, at, tolerance)
        if search is None or not search.residual < (_POOR_GAPS if fine.form.gaps else _POOR):
            coarse = nest(fine, self._transforms, problem, at)
            self._doubles += 0.5
            search = self._from_nest(fine, problem, at, tolerance)
        iterations, last = 0, np.inf
        while True:
            left = min(_LIMIT, limit - iterations)
            iterations += search.run(CLOSE * tolerance, left)
            solution, unknowns = self._assessed(problem, fine, at, search.at, tolerance)
            if solution.converged or left <= 0 or not solution.residual < _PROGRESS * last:
                break
            if at.load is None and not fine.form.gaps:
                self._evaluate(problem, fine, at)  # the gap, with the overlap that the solution has not
            last, search = solution.residual, Search(fine, unknowns)
        self.spent = self._doubles, fine.pairs + coarse
        pairs, part = divmod(self._doubles + 0.5 * self.spent[1] + self._part, 1.0)
        self._part = part if solution.converged else self._part
        solution = replace(solution, transforms=int(pairs), iterations=iterations)
        if solution.converged or iterations >= limit:
            return solution
        if at.cap is not None:
            return self._by_sets(problem, solution.pressure, (int(pairs), iterations), tolerance, limit)
        return self._by_active_set(problem, solution, tolerance, limit) if self._grid.is_whole else solution

    def state(self) -> State:
        """Return the part of a pair that is not counted yet."""
        return {"part": self._part}

    def restore(self, state: State) -> None:
        """Continue from a state."""
        self._part = float(state["part"])

    def compile(self) -> None:
        """Compile the kernels that few steps come to."""
        single = np.zeros(1, np.float32)
        for p in (single, np.zeros(1)):
            project(0, 1, 1.0, 0.0, None, p, single, single, single)

    def _level_of(self, problem: Problem) -> GridLevel:
        """The operators of the grid, made anew only where they have changed."""
        yields = problem.hardness < np.inf
        form = form_of(self._grid, problem.stiffness, yields=yields)
        kind = problem.mean_pressure is None, yields, form
        same = kind == self._kind and np.array_equal(problem.stiffness, self._stiffness)
        if not self._grid.sums.minimum(int(same)):  # by all ranks, whoever's part has changed
            operator = problem, problem.stiffness, form
            if self._fine is None:
                single = self._transforms.of_shape(self._grid.points, single=True)
                self._fine = GridLevel(self._grid, single, *operator)
            else:
                self._fine.set_operator(*operator)
            self._stiffness, self._kind = problem.stiffness, kind
        assert self._fine is not None
        self._fine.floor, self._fine.pairs = problem.residual_floor, 0
        return self._fine

    def _fields(self, fine: GridLevel, problem: Problem, start: FloatArray, tolerance: float) -> NestedFields:
        """The problem with the first guess, not negative; NaN counts as zero."""
        p, gap = self._transforms.empty_field(), self._transforms.empty_field()
        np.fmax(start, 0.0, out=p)
        cap = problem.hardness if problem.hardness < np.inf else None
        if problem.mean_pressure is not None:
            return NestedFields(problem.obstacle, gap, p, gap, problem.mean_pressure * self._grid.size, cap)
        at = NestedFields(
            problem.obstacle, self._transforms.empty_field(), p, gap, None, cap, _AIM * tolerance
        )
        nothing = np.zeros_like(self._work)
        fine.displace(problem, nothing, self._work)
        self._transforms.transform_back(self._work, at.gap0)
        np.subtract(at.h, at.gap0 / self._grid.size, out=at.gap0)
        self._doubles += 0.5
        return at

    def _no_contact(self, fine: GridLevel, problem: Problem, at: NestedFields, tolerance: float) -> Solution:
        """Return the surface without pressure, which nothing presses: a search would leave its aim as one."""
        at.p[:] = 0.0
        spectrum, extent = self._evaluate(problem, fine, at)
        solution = self._solution(problem, fine, at, spectrum, extent, tolerance)
        self.spent = self._doubles, 0.0
        pairs, self._part = divmod(self._doubles + self._part, 1.0)
        return replace(solution, transforms=int(pairs))

    def _from_guess(
        self, fine: GridLevel, problem: Problem, at: NestedFields, tolerance: float
    ) -> Search | None:
        """Begin with the first guess, if it has any pressure."""
        if not fine.set_load(at):
            return None
        extent = self._evaluate(problem, fine, at)[1]
        if fine.form.gaps:
            return self._from_pressure(fine, problem, at, tolerance)
        return self._search(fine, at, extent, tolerance)

    def _from_nest(self, fine: GridLevel, problem: Problem, at: NestedFields, tolerance: float) -> Search:
        """Begin with the unknowns of coarser grids."""
        if not fine.form.gaps:
            return self._search(fine, at, self._evaluate(problem, fine, at)[1], tolerance)
        self._evaluate_gap(problem, fine, at)
        return Search(fine, fine.gaps_of(at))

    def _evaluate_gap(self, problem: Problem, fine: GridLevel, at: NestedFields) -> ComplexArray:
        """Write the pressure of the gap; return the transform of the displacement."""
        np.subtract(at.h, at.gap, out=at.p)
        spectrum: ComplexArray = self._transforms.empty_spectrum()
        self._transforms.transform(at.p, spectrum)
        fine.press(problem, spectrum, self._work)
        self._transforms.transform_back(self._work, at.p)
        self._doubles += 1
        if at.load is not None:
            at.p += at.load / self._grid.size
        return spectrum

    def _from_pressure(
        self, fine: GridLevel, problem: Problem, at: NestedFields, tolerance: float
    ) -> Search | None:
        """Begin with the gap of a pressure, made admissible, and the pressure of that; None without any."""
        level, least = 0.0 if at.load is None else at.level, tolerance * at.scales[1]
        most = np.inf if at.cap is None else (1.0 - _EXTRAPOLATED) * at.cap
        (total, admissible), _ = fine.parallel(open_up, level, most, least, at.p, at.gap)
        if problem.mean_is_fixed and not admissible > 0.0:
            return None
        factor = total / admissible if problem.mean_is_fixed else 1.0
        fine.parallel.only(depart, level, factor, most, least, at.p, at.gap, fine.step)
        fine.respond()
        at.p += fine.change
        if at.load is not None and at.cap is not None:  # which may have cut off some
            at.p += at.load / self._grid.size - self._grid.sums.mean(at.p)
        return Search(fine, fine.gaps_of(at))

    def _assessed(
        self, problem: Problem, fine: GridLevel, at: NestedFields, found: Complements, tolerance: float
    ) -> tuple[Solution, Complements]:
        """The solution that a search has found, in double precision, and the unknowns to go on with."""
        if fine.form.gaps:
            spectrum = self._evaluate_gap(problem, fine, at)
            unknowns = fine.gaps_of(at)
            return self._solution_of_gap(problem, fine, at, unknowns, spectrum, tolerance), unknowns
        if found.x is not at.p:
            np.copyto(at.p, found.x)
        spectrum, extent = self._evaluate(problem, fine, at)
        solution = self._solution(problem, fine, at, spectrum, extent, tolerance)
        return solution, at.unknowns()

    def _search(self, fine: GridLevel, at: NestedFields, extent: FieldExtent, tolerance: float) -> Search:
        """Begin with a state, in single precision where that resolves the gaps."""
        # A cycle for 1/kappa is for large ranges of kappa, whose rounding costs it iterations.
        if tolerance < _SINGLE or fine.form.cycle or not at.scales[1] > _SHALLOW * (extent.gap - at.level):
            return Search(fine, at.unknowns())
        load_given = at.load is not None
        fields = [at.p, at.gap] if load_given else [at.p, at.gap, at.gap0]
        while len(self._narrow) < len(fields):
            self._narrow.append(fine.transforms.empty_field())
        shift = at.level if load_given else 0.0  # gaps then count from the level
        for less, field, narrowed in zip((0.0, shift, 0.0), fields, self._narrow, strict=False):
            fine.parallel.only(narrow, less, field, narrowed)
        p, gap = self._narrow[:2]
        gap0 = None if load_given else self._narrow[2]
        return Search(fine, Complements(p, gap, at.load, at.scales, at.level - shift, gap0))

    def _evaluate(
        self, problem: Problem, fine: GridLevel, at: NestedFields
    ) -> tuple[ComplexArray, FieldExtent]:
        """Write the gap of the pressure, of the given load; return the transform of h - gap, and extents."""
        fine.set_load(at)
        spectrum: ComplexArray = self._transforms.empty_spectrum()
        self._transforms.transform(at.p, spectrum)
        fine.displace(problem, spectrum, self._work)
        self._transforms.transform_back(self._work, at.gap)
        self._doubles += 1
        return spectrum, fine.set_scales(at, 1.0 / self._grid.size)

    def _solution(
        self,
        problem: Problem,
        fine: GridLevel,
        at: NestedFields,
        spectrum: ComplexArray,
        extent: FieldExtent,
        tolerance: float,
    ) -> Solution:
        """Clear the surface of the punch, and assess it."""
        load_given = at.load is not None
        shift = -extent.overlap if load_given else 0.0
        at.scales = pressure, depth = fine.scales(extent, shift)
        at.level -= shift
        u = self._transforms.empty_field()
        (touching, load, gaps, total), (residual, overlap) = fine.parallel(
            settle, 1.0 / pressure, 1.0 / depth, shift, at.h, at.p, at.gap, u
        )
        if load_given and self._grid.first_row == 0:
            spectrum[0] = total
        clear = overlap <= max(CLAMPED * depth, HEIGHT_ROUNDING * fine.floor.depth)
        size = self._grid.size
        finite = np.isfinite(load) and np.isfinite(gaps)
        return make_solution(
            problem, u, at.p, spectrum, spent=(0, 0), within=tolerance if clear else -1.0, gap=at.gap,
            assessment=(residual if finite else np.nan, touching / size, load / size, gaps / size),
        )  # fmt: skip

    def _solution_of_gap(
        self,
        problem: Problem,
        fine: GridLevel,
        at: NestedFields,
        found: Complements,
        spectrum: ComplexArray,
        tolerance: float,
    ) -> Solution:
        """Take the pressure away where the gap is open, where it is an error, and assess the state."""
        u, p, size = self._transforms.empty_field(), self._transforms.empty_field(), self._grid.size
        depth, pressure = found.scales
        fields, most = (at.h, at.gap, at.p, u, p), np.inf if at.cap is None else at.cap
        sums, (residual,) = fine.parallel(settle_gap, 1.0 / pressure, 1.0 / depth, found.level, most, *fields)
        touching, load, gaps, total = sums
        if at.load is not None and load > 0:
            below = self._grid.sums.total(float(p[p < most].sum())) if at.cap is not None else load
            factor = (at.load - load + below) / below if below > 0.0 else at.load / load
            np.multiply(p, factor, out=p, where=p < most if below > 0.0 else True)
            load, residual = at.load, max(residual, abs(factor - 1.0))
        if self._grid.first_row == 0:
            spectrum[0] = total
        finite = np.isfinite(load) and np.isfinite(gaps)
        return make_solution(
            problem, u, p, spectrum, spent=(0, 0), within=tolerance, gap=np.maximum(at.gap, 0.0),
            flow=None if at.cap is None else np.maximum(-at.gap, 0.0),
            assessment=(residual if finite else np.nan, touching / size, load / size, gaps / size),
        )  # fmt: skip

    def _by_sets(
        self, problem: Problem, start: FloatArray, spent: tuple[int, int], tolerance: float, limit: int
    ) -> Solution:
        """Take the points at the hardness out of the contact, under their known pressure, until they stay."""
        h, ranks, hardness = problem.obstacle, problem.ranks, problem.hardness
        lowest, highest = ranks.minimum(float(h.min())), ranks.maximum(float(h.max()))
        away, load = h + 4.0 * (highest - lowest + abs(lowest)), problem.mean_pressure
        capped, used = start >= (1.0 - _EXTRAPOLATED) * hardness, self.spent
        for _ in range(_CORRECTIONS):
            held = np.where(capped, hardness, 0.0)
            borne = ranks.mean(held)
            if load is not None and not borne < load:  # as of the last step, or where too many points yield
                capped, held, borne = np.zeros_like(capped), np.zeros_like(held), 0.0
            rest = replace(
                problem,
                obstacle=np.where(capped, away, h),
                intercept=problem.intercept - self._transforms.forward(held),
                mean_pressure=None if load is None else load - borne,
                hardness=np.inf,
            )
            start = np.where(capped, 0.0, np.minimum(start, hardness))
            below = self.solve(rest, start, tolerance, max(limit - spent[1], 1))
            spent = spent[0] + below.transforms, spent[1] + below.iterations
            used = used[0] + self.spent[0], used[1] + self.spent[1]
            u, start = below.displacement, below.pressure + held
            flow = np.where(capped, np.maximum(u - h, 0.0), 0.0)
            depth = scales_over(ranks, start, u, problem.residual_floor)[1]
            # A load of just so many points at the hardness leaves the last one there by rounding.
            now = np.where(capped, h - u <= 0.5 * tolerance * depth, start > (1.0 + _EXTRAPOLATED) * hardness)
            stays = ranks.minimum(int(np.array_equal(now, capped)))
            if stays or not below.converged or spent[1] >= limit:
                break
            capped = now
        self.spent = used
        start, within = np.minimum(start, hardness), tolerance if stays and below.converged else -1.0
        over = assess_over(ranks, start, u, h + flow, problem.residual_floor)
        return make_solution(
            problem, u, start, below.spectrum, spent=spent, within=within, assessment=over,
            gap=np.maximum(h - u, 0.0), flow=flow,
        )  # fmt: skip

    def _by_active_set(self, problem: Problem, last: Solution, tolerance: float, limit: int) -> Solution:
        """Leave the problem to the active set, with the rest of the iterations."""
        solver = ActiveSet(self._transforms, windows=False)
        if not iterate.signatures:  # type: ignore[attr-defined]
            with compiling():  # rarely needed, and thus not compiled beforehand
                solver.compile()
        found = solver.solve(problem, last.pressure, tolerance, limit - last.iterations)
        self.spent = self.spent[0] + found.transforms, self.spent[1]
        pairs, iterations = found.transforms + last.transforms, found.iterations + last.iterations
        return replace(found, transforms=pairs, iterations=iterations)
