"""One semismooth Newton method for pressure and shear traction together.

A step splits the points near the contact: apart (p = t = 0), stick (no slip), slip (|t| = b(p) along the
direction n of t - s). The linear system on the free unknowns, p in contact, t where it sticks and its part
across n where it slips, is solved by flexible GMRES in single precision, preconditioned by the stiffness
without the coupling of p and t. Its vectors have only the free unknowns. Full steps are taken; where they do
not come closer, steps from the best state are damped (proximal, C + theta).

Where the contact of a line is short intervals, the preconditioner is the inverse of the compliance in each
of them, and among their loads. It needs no transforms.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.friction.line import LineIntervals, LineSystem, invert, solve_on_line
from gfmdlayer.friction.problem import FrictionProblem, FrictionState, admissible, assess, in_disks, norms
from gfmdlayer.friction.response import Operator

# Part of its right side that a linear system may leave: least on a line and on a surface, and most.
_LEAST_INEXACT, _INEXACT = (0.03, 0.06), 0.3
INNER, _ROLLING = 20, 60  # iterations of GMRES, at most; in steady rolling
_FAILURES = 3  # full steps that may fail before damping
_AWAY = 10  # steps away from the best state
_DAMPING = 0.05, 4.0, 30.0  # first, factor, largest

_LONGEST, _MOST = 128, 1500  # points of an interval, and intervals, whose compliance is inverted

# Error of a response in single precision, over the largest change of traction: 2^-24 and some additions.
_SINGLE = 5e-7


class Sets:
    """Which points are in contact, stick and slip, and the unknowns that are free on them."""

    def __init__(self, problem: FrictionProblem, at: FrictionState, damping: float) -> None:
        rho, ranks = 1 / (1 + damping), problem.ranks
        touching = at.p > rho * at.gap
        if not ranks.maximum(int(touching.any())):
            pressed = ranks.maximum(int((at.p > 0).any()))
            touching = at.p > 0 if pressed else at.gap <= ranks.minimum(float(at.gap.min(initial=math.inf)))
        chosen = np.flatnonzero(touching)
        self.chosen, self.points = chosen, at.near[chosen]
        self.p, self.t, gap = at.p[chosen], at.t[:, chosen], at.gap[chosen]
        self.size, self.axes = chosen.size, len(at.t)
        self.law, self._p_s, self.ranks = problem.law.at(self.points), at.p_s, ranks
        self.bound = self._bounds(np.where(self.p > 0, self.p, np.maximum(-gap, 0.0)))
        y = self.t - rho * at.slip[:, chosen]
        length = norms(y)
        sticks = length <= self.bound
        if problem.force is not None and not self._any(sticks) and self._is_parallel(y, length):
            part = (length + 1e-300) / np.maximum(self.bound, 1e-100)
            sticks = part <= 1.05 * ranks.minimum(float(part.min(initial=math.inf)))
        self.stick, self.slip = np.flatnonzero(sticks), np.flatnonzero(~sticks)
        # Points in contact, and those of them that stick, of all processes.
        self.count, self.sticking = ranks.total(np.array([self.size, self.stick.size])).tolist()
        length, bound = length[self.slip], self.bound[self.slip]
        self.n = y[:, self.slip] / np.where(length > 0, length, 1.0)
        # lambda of each point that slips
        self.delay = np.minimum((length / np.where(bound > 0, bound, 1e-300) - 1) / rho, 1e6)
        self.slope = self.law.slope(self.p * self._p_s)[self.slip]
        self.across = np.stack((-self.n[1], self.n[0])) if self.axes == 2 else np.zeros((0, 0))

    def _bounds(self, p: FloatArray) -> FloatArray:
        """Bounds under a pressure in units of p_s, of points in contact, linear where p < 0."""
        return self.law.bound(p * self._p_s, np.ones(p.shape, dtype=bool)) / self._p_s

    def _is_parallel(self, y: FloatArray, length: FloatArray) -> bool:
        """Whether all slip has one direction; else no point needs to stick."""
        if self.axes == 1:
            return True
        along = self.bound * y / np.maximum(length, 1e-300)
        *sums, most = self.ranks.total(np.append(along.sum(axis=1), self.bound.sum())).tolist()
        return bool(math.hypot(*sums) > 0.95 * most)

    def _any(self, chosen: BoolArray) -> bool:
        """Whether some point is, of all processes."""
        return bool(self.ranks.maximum(int(chosen.any())))

    @property
    def base(self) -> FloatArray:
        """Tractions that satisfy the conditions of the sets, from those of the state."""
        tractions = np.vstack((self.p[np.newaxis], self.t))
        slipping = self._bounds(self.p)[self.slip] * self.n
        if self.axes == 2:
            slipping += self.across * (self.across * self.t[:, self.slip]).sum(axis=0)
        tractions[1:, self.slip] = slipping
        return tractions

    @property
    def free(self) -> int:
        """Number of free unknowns."""
        return self.size + self.axes * self.stick.size + (self.slip.size if self.axes == 2 else 0)

    def expanded(self, v: NDArray[Any]) -> NDArray[Any]:
        """Fields at the points in contact of free unknowns."""
        fields = np.zeros((1 + self.axes, self.size), dtype=v.dtype)
        fields[0] = v[: self.size]
        end = self.size + self.axes * self.stick.size
        fields[1:, self.stick] = v[self.size : end].reshape(self.axes, -1)
        if self.axes == 2:
            fields[1:, self.slip] = self.across * v[end:]
        return fields

    def moved(self, fields: NDArray[Any]) -> NDArray[Any]:
        """Add to fields of free unknowns the shear that follows the pressure where the points slip."""
        if self.slip.size:
            fields[1:, self.slip] += self.slope * fields[0, self.slip] * self.n
        return fields

    def compressed(self, fields: NDArray[Any]) -> NDArray[Any]:
        """Equations that apply, of fields of displacements: the transpose of `expanded`."""
        parts = [fields[0], fields[1:, self.stick].ravel()]
        if self.axes == 2:
            parts.append((self.across * fields[1:, self.slip]).sum(axis=0))
        return np.concatenate(parts)

    def to_single(self) -> None:
        """Keep the directions in single precision from here on, for the linear system."""
        self.n, self.slope = self.n.astype(np.float32), self.slope.astype(np.float32)
        self.across = self.across.astype(np.float32)


@dataclass
class Ones:
    """Response of the stiffness to ones on the free unknowns, from one step to the next."""

    fields: dict[int, NDArray[Any]]  # multiplier: fields at all points
    touching: BoolArray
    sticking: BoolArray


class BlockInverse:
    """Inverse of the compliance B of an interval, by its points; `kernel` is that of the surface of a line.

    Of the loads w = B^-1 1, which move all points alike, the part w/sum w has the load one. The rest,
    B^-1 - w w^T/sum w, has no load, so that an interval hardly moves the others by it.
    """

    def __init__(self, kernel: FloatArray) -> None:
        self.kernel = kernel
        self._made: dict[int, tuple[FloatArray, FloatArray, float]] = {}

    def of(self, points: int) -> tuple[FloatArray, FloatArray, float]:
        """Return the inverse without a load, flat, the shape of a load, and the displacement under it."""
        if points not in self._made:
            apart = np.abs(np.subtract.outer(np.arange(points), np.arange(points)))
            inverse = np.linalg.inv(self.kernel[apart])
            w = inverse.sum(axis=1)
            rest = (inverse - np.outer(w, w) / w.sum()).astype(np.float32).ravel()
            self._made[points] = rest, w / w.sum(), 1 / float(w.sum())
        return self._made[points]


class Intervals:
    """Inverse of the compliance of intervals of points on a line: within each, and among their loads."""

    def __init__(self, blocks: BlockInverse, points: NDArray[Any]) -> None:
        kernel, n = blocks.kernel, blocks.kernel.size
        first, length = intervals(points)
        lengths = np.unique(length).tolist() if first.size > 1 else length.tolist()
        inverses: list[NDArray[Any]] = [np.zeros(0, np.float32)]
        shapes, own = np.empty(points.size), np.empty(first.size)
        place, end = np.zeros(first.size, dtype=np.int64), 0
        for some in lengths:
            chosen = length == some
            rows = first[chosen, np.newaxis] + np.arange(some)
            inverse, shapes[rows], own[chosen] = blocks.of(some)
            inverses.append(inverse)
            place[chosen], end = end, end + inverse.size
        if first.size > 1:
            twice = 2 * points[first] + length - 1  # of the middles
            apart = np.abs(np.subtract.outer(twice, twice)) % (2 * n)
            among = 0.5 * (kernel[apart // 2 % n] + kernel[(apart + 1) // 2 % n])
            np.fill_diagonal(among, own)
            among = np.linalg.inv(among)
        else:
            among = 1 / own[:, np.newaxis]
        self.arrays = LineIntervals(first, length, place, np.concatenate(inverses), shapes, among)

    def __call__(self, v: NDArray[Any]) -> NDArray[Any]:
        """Return the tractions that give displacements."""
        tractions = np.empty(v.size, dtype=np.float32)
        invert(self.arrays, np.asarray(v, dtype=np.float32), tractions)
        return tractions


def intervals(points: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return where each interval of sorted points begins, and its points."""
    begins = np.ones(points.size, dtype=bool)
    begins[1:] = points[1:] - points[:-1] > 1
    first = np.flatnonzero(begins)
    length = np.full(first.size, points.size)
    length[:-1] = first[1:]
    return first, length - first


_NO_INTERVALS = Intervals(BlockInverse(np.zeros(1)), np.zeros(0, np.int64)).arrays


class LinearSystem:
    """The equations of one Newton step, scaled by p_s and W_s."""

    def __init__(
        self,
        problem: FrictionProblem,
        sets: Sets,
        at: FrictionState,
        damping: float,
        C: Operator,
        K: Operator,
        kept: Ones | None,
        blocks: tuple[BlockInverse, BlockInverse] | None = None,
    ) -> None:
        # Of linear algebra even the last bits must be those of all processes, which decide by them: `shared`.
        self.sets, self.size, self.shared = sets, C.size, problem.ranks.shared
        self._inverses: list[Intervals] = []
        if blocks is not None:
            groups = sets.points, sets.points[sets.stick]
            self._inverses = [Intervals(block, points) for block, points in zip(blocks, groups, strict=True)]
        self._C, self._K = C.among(sets.points), K.among(sets.points)
        self._of_line, self._damping = (C, K), damping
        self.unit = at.W_s / at.p_s
        axes, size = sets.axes, sets.size
        self.which = [0] if problem.load is not None else []
        self.which += list(range(1, 1 + axes)) if problem.force is not None else []
        goal = [problem.load] if problem.load is not None else []
        goal += list(problem.force) if problem.force is not None else []
        self.goal = np.array(goal, dtype=float) * (problem.points / at.p_s)
        delay, shift = np.zeros((1 + axes, size)), np.full(1 + axes, damping)
        delay[1:, sets.slip] = sets.delay
        point = np.array([C.point[0], *[C.point[1]] * axes])[:, np.newaxis]
        self.share = (1 / np.sqrt(1 + (delay + shift[:, np.newaxis]) * self.unit / point)).astype(np.float32)
        self.shift = np.full(sets.free, damping, dtype=np.float32)
        if axes == 2:
            self.shift[size + 2 * sets.stick.size :] += sets.delay.astype(np.float32)
        self.kept = self._ones(None if self._inverses else kept)
        self.ones = [sets.compressed(self.kept.fields[i][:, sets.points]) for i in self.which]
        self.sums_of_ones = np.array([self._sums(one) for one in self.ones]).T

    def _ones(self, kept: Ones | None) -> Ones:
        """Return K 1 on the sets; the last one where these have hardly changed."""
        sets, size = self.sets, self.size
        touching, sticking = np.zeros(size, dtype=bool), np.zeros(size, dtype=bool)
        touching[sets.points] = True
        sticking[sets.points[sets.stick]] = True
        if kept is not None and kept.touching.size == size:
            others = kept.touching ^ touching, kept.sticking ^ sticking
            moved = sets.ranks.total(np.array([np.count_nonzero(each) for each in others]))
            changed = moved[0] > 0.2 * sets.count or moved[1] > 0.2 * sets.sticking
            if not changed and all(i in kept.fields for i in self.which):
                return kept
        fields: dict[int, NDArray[Any]] = {}
        for i in self.which:
            ones = np.zeros((1 + sets.axes, sets.size), dtype=np.float32)
            ones[i] = 1.0
            response = np.zeros((1 + sets.axes, size), dtype=np.float32)
            response[:, sets.points] = sets.expanded(self.softened(sets.compressed(ones)))
            fields[i] = response
        return Ones(fields, touching, sticking)

    def _sums(self, v: NDArray[Any]) -> FloatArray:
        """Sums of the tractions of free unknowns, those that are given."""
        fields = self.sets.moved(self.sets.expanded(v))
        return self.sets.ranks.total(np.array([fields[i].sum(dtype=np.float64) for i in self.which]))

    def products(self, vectors: NDArray[Any], v: NDArray[Any]) -> NDArray[Any]:
        """Return the inner products of a vector with others; multipliers are the same on all processes."""
        if not self.sets.ranks.first:
            v = v.copy()
            v[self.sets.free :] = 0.0
        return self.sets.ranks.total(np.asarray(vectors @ v))

    def softened(self, v: NDArray[Any]) -> NDArray[Any]:
        """Return the preconditioner without multipliers: S K S on the free unknowns."""
        sets = self.sets
        if self._inverses:
            parts = zip(self._inverses, np.split(v, [sets.size]), strict=True)
            return np.concatenate([inverse(part) for inverse, part in parts]) * np.float32(self.unit)
        fields = self._K(self.share * sets.expanded(v))
        return np.asarray(sets.compressed(self.share * fields) * np.float32(self.unit))

    def precondition(self, v: NDArray[Any]) -> NDArray[Any]:
        """Return tractions, and multipliers from the sums of forces, for the right side v."""
        free, count = self.sets.free, len(self.which)
        z: NDArray[Any] = self.softened(v[:free])
        if not count:
            return z
        root = math.sqrt(self.sets.count)
        lack = v[free:].astype(float) * root - self._sums(z)
        c = self.shared(np.linalg.lstsq(self.sums_of_ones, lack, rcond=None)[0])
        for part, one in zip(c, self.ones, strict=True):
            z = z + np.float32(part) * one
        return np.concatenate((z, c.astype(np.float32)))

    def apply(self, z: NDArray[Any]) -> NDArray[Any]:
        """Return the left side: displacements less the multipliers, and the sums of forces."""
        sets, free = self.sets, self.sets.free
        v = z[:free]
        left: NDArray[Any] = sets.compressed(self._C(sets.moved(sets.expanded(v))))
        left = left * np.float32(1 / self.unit) + self.shift * v
        if not self.which:
            return left
        ones = np.zeros((1 + sets.axes, sets.size), dtype=np.float32)
        for i, c in zip(self.which, z[free:], strict=True):
            ones[i] = c
        sums = self._sums(v) / math.sqrt(sets.count)
        return np.concatenate((left - sets.compressed(ones), sums.astype(np.float32)))

    def solve_on_line(self, b: FloatArray, inexact: float) -> FloatArray:
        """Return the solution on a line, by `line.solve_on_line` in place of `gmres`."""
        sets, solution = self.sets, np.empty(b.size)
        C, K = self._of_line
        by_intervals = [each.arrays for each in self._inverses] or [_NO_INTERVALS] * 2
        system = LineSystem(
            stick=sets.stick,
            slip=sets.slip,
            follows=(sets.slope * sets.n[0]).astype(np.float32),
            share=self.share,
            unit=self.unit,
            damping=self._damping,
            load_given=0 in self.which,
            force_given=1 in self.which,
            C=C.on_line(sets.points),
            K=K.on_line(sets.points),
            touching=by_intervals[0],
            sticking=by_intervals[1],
            ones=np.array(self.ones, dtype=np.float32).reshape(-1, sets.free),
            multipliers=_inverse(self.sums_of_ones),
        )
        iterations = solve_on_line(system, b, inexact, INNER, solution)
        C.spend_on_line(sets.points, iterations)
        if not self._inverses:
            K.spend_on_line(sets.points, iterations)
        return solution

    def right_side(self, gap: FloatArray, slip: FloatArray, base: FloatArray) -> NDArray[Any]:
        """Return the right side left by the tractions `base`, from their gap and slip in contact."""
        sets = self.sets
        right = -sets.compressed(np.vstack((gap[np.newaxis], slip)))
        if sets.axes == 2:
            tail = sets.size + 2 * sets.stick.size
            right[tail:] -= sets.delay * (sets.across * base[1:, sets.slip]).sum(axis=0)
        if not self.which:
            return right
        sums = sets.ranks.total(np.array([base[i].sum() for i in self.which]))
        return np.concatenate((right, (self.goal - sums) / math.sqrt(sets.count)))


def _inverse(sums: FloatArray) -> FloatArray:
    """Return the inverse of a matrix of sums, zero for a sum over no points."""
    if len(sums) == 1:
        total = float(sums[0, 0])
        return np.array([[1 / total if total else 0.0]])
    return np.asarray(np.linalg.pinv(sums)) if len(sums) else np.zeros((0, 0))


def gmres(
    apply: Callable[[NDArray[Any]], NDArray[Any]],
    precondition: Callable[[NDArray[Any]], NDArray[Any]],
    products: Callable[[NDArray[Any], NDArray[Any]], NDArray[Any]],
    shared: Callable[[Any], Any],
    b: NDArray[Any],
    inexact: float,
    most: int,
) -> tuple[NDArray[Any], int]:
    """Solve by flexible, right-preconditioned GMRES in single precision; return the solution, iterations."""
    size = math.sqrt(products(b, b))
    if not (size > 0 and math.isfinite(size)):
        return np.zeros(b.size), 0
    V, Z = np.empty((most + 1, b.size), dtype=np.float32), np.empty((most, b.size), dtype=np.float32)
    H = np.zeros((most + 1, most))
    V[0] = b / size
    aim = np.zeros(most + 1)
    aim[0] = 1.0
    y: NDArray[Any] = np.zeros(0)
    k = 0
    for k in range(most):
        Z[k] = precondition(V[k])
        w = apply(Z[k])
        for _ in range(2 if k else 1):  # twice is enough for orthogonality to rounding
            h = products(V[: k + 1], w)
            H[: k + 1, k] += h
            w = w - h @ V[: k + 1]
        H[k + 1, k] = math.sqrt(products(w, w))
        if not np.isfinite(H[: k + 2, k]).all():
            return np.full(b.size, np.nan), k + 1
        y = shared(np.linalg.lstsq(H[: k + 2, : k + 1], aim[: k + 2], rcond=None)[0])
        left = shared(float(np.linalg.norm(H[: k + 2, : k + 1] @ y - aim[: k + 2])))
        if left <= inexact or not H[k + 1, k] > 1e-6 * np.abs(H[: k + 1, k]).max():
            break
        V[k + 1] = w / np.float32(H[k + 1, k])
    return size * (y @ Z[: y.size].astype(np.float64)), k + 1


class FrictionNewton:
    """The method for problems with one response on one grid."""

    def __init__(self, C: Operator, K: Operator) -> None:
        self._C, self._K = self.operators = C, K
        self._ones: Ones | None = None
        self._blocks: tuple[BlockInverse, BlockInverse] | None = None
        self._inverts = False  # whether the solve uses them

    def solve(
        self, problem: FrictionProblem, x: FloatArray, tolerance: float, limit: int
    ) -> tuple[FrictionState, int]:
        """Return the state that was reached from a guess of the tractions, and the steps."""
        self._ones, self._inverts = None, False
        path = _Globalisation(self, problem)
        at = self.state(problem, admissible(problem, x))
        path.best = at
        for step in range(limit + 1):
            if at.residual < tolerance:
                at = self._exact(problem, at, tolerance)
            if at.residual < tolerance or step == limit:
                break
            at = path.next(at, tolerance)
        if not at.residual < tolerance and path.best.residual < at.residual:
            at = path.best
        return at, step

    def state(self, problem: FrictionProblem, x: FloatArray) -> FrictionState:
        """Return the state of tractions, with their displacements in double precision."""
        return assess(problem, x, self.displacements(x))

    def displacements(self, x: FloatArray, *, single: bool = False) -> FloatArray:
        """Return W, u_x[, u_y] under tractions."""
        return self._C(x, single=single)

    def _exact(self, problem: FrictionProblem, at: FrictionState, tolerance: float) -> FrictionState:
        """Return the state with the inequalities satisfied exactly and displacements in double precision."""
        x = admissible(problem, at.x, at)
        if at.drift > 0.01 * tolerance:
            return self.state(problem, x)
        if self._largest(x - at.x) > 1e-13 * at.p_s:
            return assess(problem, x, *self.moved(at, x))
        return replace(at, x=x)

    def step(
        self, problem: FrictionProblem, at: FrictionState, damping: float, tolerance: float
    ) -> tuple[FloatArray, FloatArray | None]:
        """Return the tractions after one linear system, and its path."""
        sets = Sets(problem, at, damping)
        base = sets.base
        C, points = self._C, sets.points
        change = at.x * (-1 / at.p_s)
        change[:, points] += base
        W = at.Cx[:, at.near] / at.W_s
        if self._largest(change) > 0.01 * min(tolerance, 1.0):
            W += C.among(at.near)(change[:, at.near]) * (at.p_s / at.W_s)
        W = W[:, sets.chosen]
        gap = (problem.gap_at_rest[points] - at.depth) / at.W_s + W[0]
        slip = (problem.slip_at_rest[:, points] - at.path[:, np.newaxis]) / at.W_s + W[1:]
        sets.to_single()
        blocks = self._blocks_for(sets, damping)
        system = LinearSystem(problem, sets, at, damping, C, self._K, self._ones, blocks)
        self._ones = system.kept
        b = system.right_side(gap, slip, base)
        size = math.sqrt(system.products(b, b) / sets.count)
        least = _LEAST_INEXACT[len(at.t) - 1]
        inexact = min(_INEXACT, max(0.3 * tolerance / max(size, 1e-300), least))
        if sets.axes == 1 and not C.rolls:
            solution = system.solve_on_line(b, inexact)
        else:
            most = _ROLLING if C.rolls else INNER
            parts = system.apply, system.precondition, system.products, system.shared
            solution, _ = gmres(*parts, b, inexact, most)
        moved = base + sets.moved(sets.expanded(solution[: sets.free]))
        if sets.axes == 2:  # a direction of slip that has turned far: back to the circle
            p = moved[0, sets.slip]
            limit = sets.law.at(sets.slip).bound(np.maximum(p, 0) * at.p_s) / at.p_s
            moved[1:, sets.slip] = in_disks(moved[1:, sets.slip], limit)
        x = np.zeros_like(at.x)
        x[:, points] = moved * at.p_s
        path = at.path + solution[-sets.axes :] * at.W_s if problem.force is not None else None
        return x, path

    def _largest(self, field: FloatArray) -> float:
        """Return the largest magnitude of the values of all processes; NaN where one is none."""
        return self._C.ranks.maximum(float(np.abs(field).max(initial=0.0)))

    def _blocks_for(self, sets: Sets, damping: float) -> tuple[BlockInverse, BlockInverse] | None:
        """Return the inverses of the compliance of intervals, where these are short."""
        if sets.axes == 2 or damping > 0 or self._C.rolls:
            return None
        first, length = intervals(sets.points)
        longest = min(_LONGEST, self._C.size // 2)
        if length.max(initial=0) > longest or first.size > _MOST:
            return None
        if not self._inverts:  # the two kernels count in each solve, which may be the first of a resumed run
            self._C.work.spend(1.0)
            self._inverts = True
        if self._blocks is None:
            self._blocks = BlockInverse(self._C.kernel(0)), BlockInverse(self._C.kernel(2))
        return self._blocks

    def moved(self, at: FrictionState, x: FloatArray) -> tuple[FloatArray, float]:
        """Return the displacements under new tractions, and their drift."""
        change = x - at.x
        drift = at.drift + _SINGLE * self._largest(change) / at.p_s
        if drift < 0.003 * at.residual:
            return at.Cx + self.displacements(change, single=True), drift
        return self.displacements(x), 0.0


class _Globalisation:
    """Full steps of one solve, and damped ones from the best state where they fail."""

    def __init__(self, newton: FrictionNewton, problem: FrictionProblem) -> None:
        self._newton, self._problem = newton, problem
        self.best: FrictionState
        self._damping, self._failures, self._away = 0.0, 0, 0
        self._balance_only = False
        self._first = True

    def next(self, at: FrictionState, tolerance: float) -> FrictionState:
        """Return the state after a step."""
        # A guess that was interpolated has no points on the wrong side of its edges: no state that
        # follows is as good, until the edges are right on the finer grid.
        enough = math.inf if self._first else (0.9 if self._damping == 0 else 0.95) * self.best.merit
        self._first = False
        new = self._tried(at, tolerance, enough)
        if new is not None and (new.merit < enough or new.residual < tolerance):
            self.best, self._failures, self._away = new, 0, 0
            self._damping = self._damping / 4 if self._damping > _DAMPING[0] else 0.0
            return new
        self._away += 1
        if new is None:
            self._failures += 10
        elif not new.merit < 0.7 * at.merit or self._away > _AWAY:
            self._failures += 1
        if new is not None and self._failures <= (_FAILURES if self._damping == 0 else 0):
            return new
        self._failures = self._away = 0
        first, factor, largest = _DAMPING
        if self._damping < largest:
            self._balance_only = not self._balance_only if self._damping > 0.01 else True
            self._damping = max(factor * self._damping, first)
        else:
            self.best = new if new is not None else self.best
            self._damping = 1.0
        best = self.best
        self.best = assess(self._problem, best.x, best.Cx, best.drift, balance_only=self._balance_only)
        return self.best

    def _tried(self, at: FrictionState, tolerance: float, enough: float) -> FrictionState | None:
        """Return the state after a step, or a part of it that is better; None where it is not finite."""
        problem, newton = self._problem, self._newton
        with np.errstate(over="ignore", invalid="ignore"):
            x, path = newton.step(problem, at, self._damping, tolerance)
            most = problem.ranks.maximum(np.array([np.abs(x - at.x).max(), x[0].max()]))
            if not most[0] <= 1e6 * at.p_s or (problem.load is not None and not most[1] > 0):
                return None
            Cx, drift = newton.moved(at, x)
            new = self._part(at, x, Cx, drift, path, 1.0)
            for part in (0.5, 0.25) if self._damping > 0 else ():
                if new.merit < enough:
                    break
                new = min(new, self._part(at, x, Cx, drift, path, part), key=lambda state: state.merit)
            if new.drift > 0.1 * new.residual:
                exact, path = newton.displacements(new.x), None if path is None else new.path
                new = assess(problem, new.x, exact, 0.0, path, balance_only=self._balance_only)
        return new if math.isfinite(new.merit) and math.isfinite(new.residual) else None

    def _part(
        self,
        at: FrictionState,
        x: FloatArray,
        Cx: FloatArray,
        drift: float,
        path: FloatArray | None,
        part: float,
    ) -> FrictionState:
        """Return the state after a part of a step."""
        if part < 1:
            x, Cx = at.x + part * (x - at.x), at.Cx + part * (Cx - at.Cx)
            path = None if path is None else at.path + part * (path - at.path)
        return assess(self._problem, x, Cx, drift, path, balance_only=self._balance_only)
