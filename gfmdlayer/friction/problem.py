"""The frictional contact of one step: its data, its residual, and its solution.

Unknown are the pressure p and the shear traction t on the surface of the body at each point, and two rigid
displacements: the depth d of the punch and its tangential path D in the step, where the load or the
tangential force is given. With the displacements W (into the body) and u, the response to the tractions and
the offset by the past,

    gap  g = h + W - d:          g >= 0,  p >= 0,  p g = 0
    slip s = u - u_before - D:   |t| <= b(p),  s = -lambda t,  lambda >= 0,  lambda (b(p) - |t|) = 0

In steady rolling u_before is u a way ahead, and the response is that of the state.

The bound b(p) is the law of friction: mu p, a shear strength tau_0 on the contact, or the smaller one.

Where the interface attracts, p is the pressure of the wall, and the body carries p - tau(g) with the traction
tau across the gap. Contact without a load, or under a pull, so has friction; the gap carries no shear.

The residual, of which there is this one definition, measures pressures in the largest pressure p_s, lengths
in the largest displacement W_s under the tractions, and shear in t_s, the largest bound or p_s:

    |min(p/p_s, g/W_s)|,   |t - P(t - s p_s/W_s)|/t_s,   |mean t - Q|/mean min(b, p),

where P is the nearest point in the disk of radius b(max(p, 0)); it is the largest value over the points.
Where a point slips only the direction of s appears: its size follows from the tractions,
s = u - u_before - D, within some residuals times W_s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.friction.response import AnyResponse
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.grid.sums import pairwise_sum
from gfmdlayer.interface.friction import ShearBound
from gfmdlayer.interface.law import HARD_WALL, Interaction
from gfmdlayer.kernels import kernel


@dataclass(frozen=True)
class FrictionProblem:
    """The frictional contact of a step; of load and depth, and of force and path, one is given."""

    response: AnyResponse  # to tractions of this step
    heights: FloatArray  # h of the punch above its lowest point; length
    law: ShearBound
    load: float | None = None  # mean pressure, less that of the attraction
    depth: float = 0.0  # of the punch below its first touch, where no load is given
    force: FloatArray | None = None  # mean shear traction on the body, a component an axis
    path: FloatArray | None = None  # tangential displacement of the punch in the step; by default none
    offset: FloatArray | None = None  # W, u_x[, u_y] without tractions, by the past; by default none
    before: FloatArray | None = None  # u_x[, u_y] at the end of the step before; by default none
    interface: Interaction = HARD_WALL  # across the gap, beside the wall
    way: float | None = None  # along x, after which the state repeats itself; by default it is a step
    ranks: Ranks = ALONE  # the processes of whose grid these are the points
    hardness: float = math.inf  # largest pressure of the wall; infinite where the surfaces do not yield

    @property
    def yields(self) -> bool:
        """Whether pressures of the wall end at a hardness."""
        return self.hardness < math.inf

    @cached_property
    def points(self) -> int:
        """Number of points, of all processes."""
        return self.ranks.total(self.heights.size)

    @cached_property
    def lowest(self) -> float:
        """The least gap without tractions at zero depth."""
        return self.ranks.minimum(float(self.gap_at_rest.min()))

    @cached_property
    def is_frictionless(self) -> bool:
        """Whether the bound is zero everywhere."""
        return bool(self.ranks.minimum(int(self.law.is_frictionless)))

    @cached_property
    def slip_at_rest(self) -> FloatArray:
        """Slip without tractions and without a path, of shape (axes, points)."""
        axes = self.response.normal.ndim
        slip = np.zeros((axes, self.heights.size))
        if self.offset is not None:
            slip += self.offset[1:]
        return slip if self.before is None else slip - self.before

    @cached_property
    def gap_at_rest(self) -> FloatArray:
        """Gap without tractions at zero depth."""
        return self.heights if self.offset is None else self.heights + self.offset[0]

    @property
    def is_finite(self) -> bool:
        """Whether all that is given is a number."""
        values = self.gap_at_rest, self.slip_at_rest, self.load, self.depth, self.force, self.path
        finite = all(np.isfinite(value).all() for value in values if value is not None)
        return bool(self.ranks.minimum(int(finite)))

    def why_not_solvable(self) -> str:
        """Return why no state satisfies the conditions: the punch slides away; else nothing."""
        # The pressure of a wall beside an attraction is not known beforehand.
        if self.force is None:
            return ""
        size = float(np.linalg.norm(self.force))
        smooth = self.is_frictionless
        if not smooth and self.interface.attracts:
            return ""
        if not smooth and self.load is not None and np.ndim(self.law.coefficient) == 0:
            most = min(float(self.law.coefficient) * self.load, self.law.strength)
            if size < most:
                return ""
            reason = f"the tangential force per area, {size:.6g}, is not below the largest one, {most:.6g}"
            return f"{reason}: the punch slides away"
        if smooth and size > 0:
            return "a tangential force without friction: the punch slides away"
        return ""


@dataclass(frozen=True)
class FrictionSolution:
    """State of a step; fields have the shape (components, points) or (points,)."""

    pressure: FloatArray  # p >= 0 of the wall
    traction: FloatArray  # t_x[, t_y] on the body, |t| <= b(p)
    displacement: FloatArray  # W into the body, u_x[, u_y], with the offset of the past
    gap: FloatArray  # h + W - d
    slip: FloatArray  # u - u_before - D at all points; relative motion of the surfaces where they touch
    depth: float
    path: FloatArray
    stick: BoolArray  # points in contact that do not slip, by `FrictionState.sticks`
    residual: float
    pairs: float  # each component counts; those in single precision count half
    iterations: int  # Newton steps
    converged: bool
    reason: str = ""  # why not
    attraction: FloatArray | None = None  # tau across the gap, where the interface attracts
    released_energy: float = 0.0  # as of `contact.problem.Solution`
    margin: float = math.nan
    flow: FloatArray | None = None  # height lost in the step, where the pressure is at the hardness

    @property
    def stress(self) -> FloatArray:
        """Compressive stress of the surface, p - tau."""
        return self.pressure if self.attraction is None else self.pressure - self.attraction

    @property
    def loads(self) -> FloatArray:
        """Tractions on the body, (p - tau, t_x[, t_y])."""
        return np.vstack((self.stress[np.newaxis], self.traction))

    @property
    def tractions(self) -> FloatArray:
        """Pressure and shear, (p, t_x[, t_y]): the start of the next step."""
        return np.vstack((self.pressure[np.newaxis], self.traction))

    @property
    def contact(self) -> BoolArray:
        """Points in contact."""
        return np.asarray(self.pressure > 0)

    @property
    def closed_gap(self) -> FloatArray:
        """Gap without rounding: zero in contact, and nowhere less."""
        return np.where(self.contact, 0.0, np.maximum(self.gap, 0.0))


def apart(problem: FrictionProblem, depth: float) -> FrictionSolution:
    """Return the state of a punch that does not touch."""
    axes, points = problem.response.normal.ndim, problem.heights.size
    offset = np.zeros((1 + axes, points)) if problem.offset is None else problem.offset
    path = np.zeros(axes) if problem.path is None else problem.path
    return FrictionSolution(
        pressure=np.zeros(points),
        traction=np.zeros((axes, points)),
        displacement=offset,
        gap=problem.gap_at_rest - depth,
        slip=problem.slip_at_rest - path[:, np.newaxis],
        depth=depth,
        path=path,
        stick=np.zeros(points, dtype=bool),
        residual=0.0,
        pairs=0.0,
        iterations=0,
        converged=True,
    )


def norms(vectors: FloatArray) -> FloatArray:
    """Lengths of vectors, of shape (components, points)."""
    return np.asarray(np.abs(vectors[0]) if len(vectors) == 1 else np.sqrt((vectors**2).sum(axis=0)))


def in_disks(vectors: FloatArray, radii: FloatArray) -> FloatArray:
    """Return the nearest vectors within the radii."""
    if len(vectors) == 1:
        return np.asarray(np.clip(vectors, -radii, radii))
    length = norms(vectors)
    outside = length > radii
    return np.asarray(vectors * np.where(outside, radii / np.where(outside, length, 1.0), 1.0))


def admissible(problem: FrictionProblem, x: FloatArray, at: FrictionState | None = None) -> FloatArray:
    """Return the tractions with p >= 0 of the given mean and |t| <= b(p); |t| = b(p) where a state slips."""
    p = np.maximum(x[0], 0.0)
    if problem.load is not None:
        mean = problem.ranks.mean(p)
        p = p * (problem.load / mean) if mean > 0 else np.full(p.shape, problem.load)
    t, bound = x[1:], problem.law.bound(p)
    if at is not None:
        t, slips = t.copy(), at.near[~at.sticks(problem)]
        t[:, slips] *= bound[slips] / np.maximum(norms(t[:, slips]), 1e-300)
    return np.vstack((p[np.newaxis], in_disks(t, bound)))


# Depth and path as multipliers: the values for which the projected tractions carry the given forces.


def balanced_depth(y: FloatArray, total: float, ranks: Ranks = ALONE) -> float:
    """Return d of sum max(y + d, 0) = total: convex and rising, so Newton's method falls to it from above."""
    d, over = total - ranks.maximum(float(y.max())), np.empty(y.size)
    for _ in range(200):
        carried, points = ranks.total(np.array(_above(y, d, over))).tolist()
        if points == 0:  # the total is rounding beside the values
            break
        change = (total - carried) / points
        d += change
        if not abs(change) > 1e-14 * (abs(d) + 1.0):
            break
    return d


@kernel(borrows=True)
def _above(y: FloatArray, d: float, over: FloatArray) -> tuple[float, float]:
    """Sum of max(y + d, 0), and the number of points where it is not zero, with a work array."""
    count = 0
    for i in range(y.size):
        if y[i] + d > 0.0:
            over[count] = y[i] + d
            count += 1
    return pairwise_sum(over[:count]), float(count)


# The path D has sum P(y + D) = total, with P the projection on disks of given radii. The difference of both
# sides is the gradient of a convex function of D.


def path_on_line(y: FloatArray, radii: FloatArray, total: float, D: float) -> FloatArray:
    """Return the path of one axis by Newton's method within an interval that holds the root."""
    if np.isinf(radii).any():
        return np.array([(total - y.sum()) / y.size])
    low, high = float((-y - radii).min()), float((radii - y).max())
    for _ in range(200):
        moved = y + D
        excess = float(np.clip(moved, -radii, radii).sum()) - total
        low, high = (D, high) if excess < 0 else (low, D)
        free = np.count_nonzero(np.abs(moved) < radii)
        new = D - excess / free if free else math.inf
        new = new if low < new < high else 0.5 * (low + high)
        if abs(new - D) <= 1e-14 * (abs(new) + 1):
            break
        D = new
    return np.array([D])


_FAR = 1e8  # in sizes of the tractions, beside which these are directions


def path_in_plane(
    y: FloatArray, radii: FloatArray, total: FloatArray, D: FloatArray, ranks: Ranks = ALONE
) -> FloatArray:
    """Return the path of two axes by Newton's method down the convex function."""
    # With z = y + D it is the sum of |z|^2/2 in the disks, continued linearly outside, less total D.
    sizes, force = norms(y), math.hypot(*total.tolist())
    carried, most = ranks.total(np.array([np.minimum(radii, sizes).sum(), radii.sum()])).tolist()
    if force >= most > 0:  # no path carries it; far along it the tractions do what they can
        return total * (_FAR / force * float(ranks.maximum((sizes + radii).max(initial=0.0))))
    largest = carried + force

    def looked_at(D: FloatArray) -> tuple[FloatArray, float]:
        z = y + D[:, np.newaxis]
        size = norms(z)
        inside = np.minimum(size, radii)
        sums = ranks.total(np.append(in_disks(z, radii).sum(axis=1), (inside * (size - 0.5 * inside)).sum()))
        return sums[:2] - total, float(sums[2] - total @ D)

    off, value = looked_at(D)
    for _ in range(100):
        z = y + D[:, np.newaxis]
        length = np.maximum(norms(z), 1e-300)
        outside = length > radii
        share = np.where(outside, radii / np.where(outside, length, 1.0), 1.0)
        n = z / length
        turned = (n * np.where(outside, share, 0.0)) @ n.T
        *parts, held = ranks.total(np.append(turned, share.sum())).tolist()
        slope = np.eye(2) * held - np.reshape(parts, (2, 2))
        change = -np.linalg.solve(slope + 1e-9 * np.eye(2) * (held + 1e-30), off)
        most = [np.minimum(radii, length).max(initial=0.0), length.max(initial=0.0)]
        farthest = 2 * float(ranks.maximum(np.array(most)).sum())
        change *= min(1.0, farthest / max(float(np.linalg.norm(change)), 1e-300))
        # Of linear algebra even the last bits must be those of all processes, which decide by them.
        change, descent, size, length_D = ranks.shared(
            (change, float(off @ change), float(np.linalg.norm(off)), float(np.linalg.norm(D)))
        )
        part = 1.0
        while part > 1e-6:
            new, lower = looked_at(D + part * change)
            left = math.hypot(*new.tolist())
            close = left < 1e-6 * largest  # where the values differ by rounding
            if (close and left <= size) or lower <= value + 1e-4 * part * descent:
                break
            part /= 2
        else:
            break
        D, off, value = D + part * change, new, lower
        if part * math.hypot(*change) <= 1e-14 * (length_D + 1) or left < 1e-14 * largest:
            break
    return D


@dataclass(frozen=True)
class FrictionState:
    """Tractions, their displacements and multipliers, and how far they are from a solution.

    Values at the points `near`, which carry tractions or overlap the punch, are in units of p_s and W_s.
    """

    x: FloatArray  # p, t_x[, t_y]
    Cx: FloatArray  # W, u_x[, u_y] under them
    drift: float  # bound on the error of Cx by single precision, over that by rounding in units of W_s
    p_s: float
    W_s: float
    depth: float
    path: FloatArray
    near: NDArray[Any]
    p: FloatArray
    gap: FloatArray
    t: FloatArray
    slip: FloatArray
    residual: float
    merit: float  # rms over the contact; the residual is the largest value

    def sticks(self, problem: FrictionProblem) -> BoolArray:
        """Whether the points `near` are in contact and stick: the sets of Newton's method without damping.

        |t| and b agree to the tolerance only, and do not tell; t - s is beyond the bound by the slip.
        """
        bound = problem.law.at(self.near).bound(np.maximum(self.p, 0.0) * self.p_s)
        return np.asarray((self.p > 0) & (norms(self.t - self.slip) * self.p_s <= bound))


def assess(
    problem: FrictionProblem,
    x: FloatArray,
    Cx: FloatArray,
    drift: float = 0.0,
    linear: FloatArray | None = None,
    *,
    balance_only: bool = False,
) -> FrictionState:
    """Return the state with the multipliers that leave the least merit."""
    # Tried are those of balance, the means of gap and slip over contact and stick, the path of a linear
    # system, and mixtures: each alone fails on some problems.
    p, ranks = x[0], problem.ranks
    p_s, W_s = _scales(problem, p, Cx[0])
    carried = problem.gap_at_rest + Cx[0]
    depths = [problem.depth]
    if problem.load is not None:
        y, total = p / p_s - carried / W_s, problem.load * problem.points / p_s
        depths = [balanced_depth(y, total, ranks) * W_s]
        of_contact = _mean(carried[p > 0], ranks)
        if not balance_only and of_contact is not None:
            depths.append(float(of_contact[0]))
    near = np.flatnonzero((carried < max(depths)) | (x != 0).any(axis=0))
    view = _View(problem, x, Cx, near, p_s, W_s)
    depth_choices = [view.normal(carried[near], depth) for depth in depths]
    paths: list[FloatArray] = [np.zeros(len(x) - 1) if problem.path is None else problem.path]
    if problem.force is not None and view.touches:
        paths = [view.balanced(problem.force)]
        if not balance_only:
            of_stuck = _mean(view.slip[:, view.stuck], ranks)
            if of_stuck is not None:
                paths.append(of_stuck * W_s)
            if linear is not None:
                paths.append(linear)
    depth, off, worst, gap = min(depth_choices, key=lambda each: each[1])
    path, across, most, slip = min((view.tangential(each) for each in paths), key=lambda each: each[1])
    off, worst = off + across, max(worst, most)
    if problem.force is not None:
        lack = view.lack(problem.force)
        off, worst = off + lack * lack, max(worst, lack)
    if not math.isfinite(off):
        worst = off = math.inf
    parts = view.p, gap, view.t, slip
    return FrictionState(x, Cx, drift, p_s, W_s, depth, path, near, *parts, worst, math.sqrt(off))


def _scales(problem: FrictionProblem, p: FloatArray, W: FloatArray) -> tuple[float, float]:
    """Units of pressure and of length: the largest ones of a state, or those of an overlap."""
    softest = problem.response.softest
    largest, deepest = problem.ranks.maximum(np.array([p.max(), W.max()])).tolist()
    if largest > 0:
        return largest, max(deepest, 1e-3 * largest * softest)
    overlap = float((problem.depth - problem.gap_at_rest - W).max())
    length = max(problem.ranks.maximum(overlap), 1e-300)
    return length / softest, length


def _mean(values: FloatArray, ranks: Ranks) -> FloatArray | None:
    """Return the mean of some points, the last axis; None of none."""
    *sums, count = ranks.total(np.append(values.sum(axis=-1), values.shape[-1])).tolist()
    return np.array(sums) / count if count else None


class _View:
    """A state at the points near the contact, in units of pressure and length."""

    def __init__(
        self,
        problem: FrictionProblem,
        x: FloatArray,
        Cx: FloatArray,
        near: NDArray[Any],
        p_s: float,
        W_s: float,
    ) -> None:
        self.p, self.t = x[0, near] / p_s, x[1:, near] / p_s
        self.on, self._ranks = self.p > 0, problem.ranks
        touching = self._ranks.total(int(np.count_nonzero(self.on)))
        self.touches, self.count = touching > 0, max(touching, 1)
        self._p_s, self._W_s = p_s, W_s
        self.slip = (problem.slip_at_rest[:, near] + Cx[1:, near]) / W_s
        law = problem.law.at(near)
        self.bound = law.bound(np.maximum(self.p, 0) * p_s) / p_s
        self.scale = min(self._ranks.maximum(float(self.bound.max(initial=0.0))), 1.0) or 1.0
        self._points = problem.points

    @property
    def stuck(self) -> BoolArray:
        """Points in contact with a traction below the bound."""
        return np.asarray(self.on & (norms(self.t) < 0.999 * self.bound))

    def normal(self, carried: FloatArray, depth: float) -> tuple[float, float, float, FloatArray]:
        """Return the depth with its sum of squares and its largest residual, and the gap."""
        gap = (carried - depth) / self._W_s
        return depth, *self._size(np.minimum(self.p, gap)), gap

    def tangential(self, path: FloatArray) -> tuple[FloatArray, float, float, FloatArray]:
        """Return the path with its sum of squares and its largest residual, and the slip."""
        slip = self.slip - path[:, np.newaxis] / self._W_s
        return path, *self._size(norms(self.t - in_disks(self.t - slip, self.bound)) / self.scale), slip

    def _size(self, off: FloatArray) -> tuple[float, float]:
        """Return the sum of squares over the points in contact, and the largest value."""
        squares, largest = self._ranks.total(float((off**2).sum())), float(np.abs(off).max(initial=0.0))
        return squares / self.count, self._ranks.maximum(largest)

    def balanced(self, force: FloatArray) -> FloatArray:
        """Return the path for which the projected tractions carry the force."""
        y, total = (self.t - self.slip)[:, self.on], force * (self._points / self._p_s)
        start = _mean(self.slip[:, self.on], self._ranks)
        radii = self.bound[self.on]
        assert start is not None
        if len(y) == 1:
            return path_on_line(y[0], radii, float(total[0]), float(start[0])) * self._W_s
        return path_in_plane(y, radii, total, start, self._ranks) * self._W_s

    def lack(self, force: FloatArray) -> float:
        """Return the part of the tangential force that the tractions do not carry."""
        total = force * (self._points / self._p_s)
        carried = np.minimum(self.bound, np.maximum(self.p, 0.0)).sum()
        *sums, largest = self._ranks.total(np.append(self.t.sum(axis=1), carried)).tolist()
        return math.dist(sums, total.tolist()) / max(float(largest), 1e-300)
