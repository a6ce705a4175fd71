"""Compiled loops over the time steps of an isolated axisymmetric indentation.

The unknown is chi(x, t) = int_x^a p r dr/(r^2 - x^2)^(1/2), with the force F = 4 int_0^a chi dx, and
X(q, t) = int_0^a chi cos(qx) dx. With D and C of `compliance`, * the convolution J(t) * d chi, and H the Abel
transform of the profile,

    D*chi(x) + (2/pi) int_0^inf cos(qx) C(q)*X(q) dq = depth(t) - H(x),   x < a(t);      chi = 0,   x > a(t)

holds in loading and unloading alike. chi(a) = 0 at the edge of a smooth profile, and
chi(a) = -(pi a w/J0)^(1/2) with a work of adhesion w (JKR). Internal variables eta_k(x) and zeta_m(q) follow
chi and X with the retardation times, exactly for chi and X that are linear over a step; a point that the edge
sweeps is loaded for its part of the step. The past is kept on a fixed grid in x, and at the radii where the
edge was at the end of each step. For the past bends at the edge: inside, the variables of short times follow
chi within a width T da/dt, which a slow contact makes narrower than any grid. Interpolation in x does not
cross the edge, nor radii where it turned. The equation of a step is solved at Gauss nodes in [0, a].

Sizes: nt times, nb retardation times of D, nq nodes in q, nm modes of C.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray, IntArray
from gfmdlayer.indentation.compliance import Compliance
from gfmdlayer.kernels import kernel
from gfmdlayer.punch.revolution import Revolution, abel_transform

# Outcomes of a run.
COMPLETE, LEFT_GRID, NOT_CONVERGED = 0, 1, 2

_MARKS = 3  # radii that are remembered, where the slope of chi may jump
_APART = 0.02  # part of a by which they differ
_GENTLE = 0.05  # h/T below which Simpson's rule has the energy lost in a step to 1e-9
_SMALL = 1e-4  # h/T below which differences of closed forms lose digits
_MOST_ITERATIONS = 80
_SAME_RADIUS = 1e-11  # width of the bracket of a radius, relative to it, at which it is found
_INSTANT = 1e-9  # part of a step at whose ends a change of contact is not inside
_CLOSING = 12  # points that close in on the edge at a breakpoint, where it may turn
_SUBSTEPS = 12  # of one step: contact found and lost
_FRONT = 1e-9  # slope of the coordinate of the moving edge where H is flat
_ONE_POINT = 1e-4  # distance of a point to the next, over the spacing, below which they are one


class Nodes(NamedTuple):
    """Nodes in x, which depend on the largest contact radius only."""

    reach: float  # the largest contact radius
    spacing: float  # of the fixed grid x_i = i spacing, i = 0 to n + 1; the last but two is the reach
    cosines: FloatArray  # (2 n + 3, nq), cos(q x_i)
    gauss: FloatArray  # Gauss nodes on [0, 1], for all of [0, a]
    gauss_weights: FloatArray
    part: FloatArray  # the same, for each part of [0, a] between its marks
    part_weights: FloatArray


class Drive(NamedTuple):
    """Prescribed depth or force at the ends of the steps, shape (nt,); linear over each step.

    Where the control changes, the first step begins at the depth or force that the last one has found.
    """

    time: FloatArray
    value: FloatArray
    by_force: BoolArray  # (nt,), of the step that ends at a time
    breakpoints: BoolArray  # whether the rate jumps at a time
    snapshots: BoolArray  # whether fields are kept at a time
    adhesion: float  # work of adhesion
    tolerance: float  # of the contact radius: residual at the edge over the depth


class Points(NamedTuple):
    """Points in x that keep the past: the fixed grid, n + 2 points, and np - n - 2 places for past edges."""

    x: FloatArray  # (np,)
    obstacle: FloatArray  # (np,), H
    order: IntArray  # (np,), the numbers of the points by their x
    filled: IntArray  # (1,), number of points so far
    bent: BoolArray  # (np,), whether the past bends at a point: interpolation does not cross it
    near: IntArray  # (4,), the places that an interpolation takes


class State(NamedTuple):
    """State of a run between two steps."""

    points: Points
    chi: FloatArray  # (np,), at the points, continued beyond a
    eta: FloatArray  # (nb, np), internal variables of D
    X: FloatArray  # (nq,), cosine transform of chi
    zeta: FloatArray  # (nm, nq), internal variables of C
    marks: FloatArray  # radii where the slope of chi may jump


class Loss(NamedTuple):
    """Factors of y^2, y c and c^2 in int (chi - eta)^2/T dt, for chi that changes linearly by c over a step.

    y is chi - eta at the beginning of the step.
    """

    yy: FloatArray
    yc: FloatArray
    cc: FloatArray


class Step(NamedTuple):
    """Weights of a step of one length: a variable becomes fade old + before chi(0) + after chi(h)."""

    fade: FloatArray  # (nb,)
    before: FloatArray
    after: FloatArray
    loss: Loss
    fade_q: FloatArray  # (nm, nq)
    before_q: FloatArray
    after_q: FloatArray
    loss_q: Loss
    effective: FloatArray  # (nq,), C of the step
    table: FloatArray  # (2 n + 3,), kernel of the step: (1/pi) int effective cos(q z) dq


class Work(NamedTuple):
    """Arrays of one solution."""

    x: FloatArray  # nodes
    root: FloatArray  # roots of their weights
    matrix: FloatArray
    unit: FloatArray  # right-hand side, then solution, of a unit depth; at last the weights times chi
    rest: FloatArray  # right-hand side, then solution, of all else
    edges: FloatArray  # ends of the parts
    past: FloatArray  # (np,), part of D*chi at the end of the step that the past leaves, without chi(0)
    far_past: FloatArray  # (n + 2,), and the part of the integral of C
    transform: FloatArray  # (nq,)
    far: FloatArray  # (n + 2,)


class Run(NamedTuple):
    """The parts of a run."""

    body: Compliance
    profile: Revolution
    nodes: Nodes
    drive: Drive
    state: State
    step: Step
    work: Work
    stop: float  # largest radius: the rim of the indenter, or the reach of the nodes


class Weights(NamedTuple):
    """Weights of chi(h) and chi(0) in D*chi at the end of a step."""

    after: float
    before: float


class Trial(NamedTuple):
    """Solution for a trial radius: residual at the edge = depth edge + rest, force = depth unit + other."""

    edge: float
    rest: float
    unit: float
    other: float
    nodes: int  # -1 where the matrix is not positive definite


class Radius(NamedTuple):
    """Contact at the end of a step, of radius 0 where there is none."""

    a: float
    force: float
    depth: float
    slope: float  # of the residual over the radius; 0 where it is not known
    nodes: int
    solutions: int
    status: int


class Marched(NamedTuple):
    """Columns of a run, one value a time, and fields at its snapshots."""

    force: FloatArray
    depth: FloatArray
    radius: FloatArray
    stored: FloatArray
    dissipated: FloatArray
    rise: FloatArray  # largest increase of chi between grid points in x: 0 where p >= 0 and gap >= 0 for sure
    chi: FloatArray  # (snapshots, n + 2)
    local: FloatArray  # (snapshots, n + 2), D*chi
    spectrum: FloatArray  # (snapshots, nq), C*X
    solutions: int
    status: int
    stopped: int  # the step at which it ended


@kernel(inner=True)
def _linear_weights(h: float, T: float) -> tuple[float, float, float]:
    """Weights of the old value, chi(0) and chi(h), for chi linear over the step."""
    z = h / T
    if z < _SMALL:
        return 1 - z + z * z / 2, z / 2 - z * z / 3, z / 2 - z * z / 6
    m = -math.expm1(-z)
    f = m / z
    return 1 - m, f - 1 + m, 1 - f


@kernel(inner=True)
def _loss_weights(z: float, fade: float, after: float) -> tuple[float, float, float]:
    """Return the factors of `Loss` for z = h/T, with fade and after of `_linear_weights`."""
    if z < _GENTLE:
        # Simpson's rule, from chi - eta = fade y + mean c at the middle and the end.
        end, half = 1 - after, math.sqrt(fade)
        mean = end / (1 + half)
        yy = 1 + 4 * fade + fade**2
        return z / 6 * yy, z / 3 * (4 * half * mean + fade * end), z / 6 * (4 * mean**2 + end**2)
    once = 1 - fade
    twice = once * (1 - once / 2)
    return twice, 2 * (once - twice) / z, (z - 2 * once + twice) / (z * z)


@kernel(inner=True)
def _loss(h: float, T: float, old: float, before: float, after: float) -> float:
    """Int (chi - eta)^2/T dt over a step in which chi is linear and eta begins as `old`."""
    fade, _, late = _linear_weights(h, T)
    yy, yc, cc = _loss_weights(h / T, fade, late)
    y, c = before - old, after - before
    return yy * y * y + yc * y * c + cc * c * c


class EdgeMotion(NamedTuple):
    """A moving edge: the coordinate H + slope x, in which it moves evenly through a step, at either end."""

    slope: float
    small: float
    large: float


@kernel(inner=True)
def _sweep(profile: Revolution, small: float, large: float) -> EdgeMotion:
    """Return how the edge moves between two radii; a flat end comes into contact at once."""
    slope = _FRONT if small > 0 else 0.0
    H_small = abel_transform(profile, small) + slope * small
    return EdgeMotion(slope, H_small, abel_transform(profile, large) + slope * large)


@kernel(inner=True)
def _swept(sweep: EdgeMotion, x: float, H: float) -> float:
    """Part of the step for which a growing contact has covered x, or a shrinking one will."""
    if sweep.large == sweep.small:
        return 1.0
    part = (sweep.large - H - sweep.slope * x) / (sweep.large - sweep.small)
    return float(min(max(part, 0.0), 1.0))


@kernel(inner=True)
def _lagrange(y: float) -> tuple[float, float, float, float]:
    """Weights of the values at -1, 0, 1 and 2 for the value at y."""
    left, right = (y + 1) * y / 2, (y - 1) * (y - 2) / 2
    return -y * right / 3, (y + 1) * right, -left * (y - 2), left * (y - 1) / 3


@kernel(inner=True)
def _cubic(f: FloatArray, s: float) -> float:
    """Value at s grid spacings, by four points, of an even function."""
    i = int(s)
    a, b, c, d = _lagrange(s - i)
    value: float = a * f[abs(i - 1)] + b * f[i] + c * f[i + 1] + d * f[i + 2]
    return value


@kernel(inner=True)
def _place(points: Points, x: float) -> int:
    """Return the place in order of the last point at or below x, of those that have a next one."""
    low, high = 0, points.filled[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if points.x[points.order[middle]] <= x:
            low = middle
        else:
            high = middle
    return low


@kernel(inner=True)
def _position(points: Points, place: int) -> float:
    """Return x at a place in the order; places below 0 are the mirror images of points."""
    x = points.x[points.order[abs(place)]]
    return float(x if place >= 0 else -x)


@kernel(inner=True)
def _further(points: Points, place: int, way: int, apart: float) -> int:
    """Return the next place that is so far apart; the same place where the past bends before it."""
    at = place
    while abs(at) < points.filled[0] - 1 and not points.bent[points.order[abs(at)]]:
        at += way
        if abs(_position(points, at) - _position(points, place)) >= apart:
            return at
    return place


@kernel(inner=True)
def _at(x: float, f: FloatArray, edge: float, points: Points) -> float:
    """Value at x of an even function that bends at the edge, by up to four points on the side of x.

    They are not closer to each other than half of the cell around x. Where the edge is no point, the value
    is extrapolated to it from its side.
    """
    low = _place(points, x)
    high, other = low + 1, _ONE_POINT * points.x[1]
    apart = (_position(points, high) - _position(points, low)) / 2
    if x < edge < _position(points, high) - other and not points.bent[points.order[low]]:
        high = low
    elif _position(points, low) + other < edge <= x and not points.bent[points.order[high]]:
        low = high
    inside, outside = high == low and x < edge, high == low and x >= edge
    near, n = points.near, 0
    for place in range(low, high + 1):
        near[n] = place
        n += 1
    for _ in range(3):
        new = high if inside or n == 4 else _further(points, high, 1, apart)
        if new != high:
            high = near[n] = new
            n += 1
        new = low if outside or n == 4 else _further(points, low, -1, apart)
        if new != low:
            low = near[n] = new
            n += 1
    value = 0.0
    for i in range(n):
        y, weight = _position(points, near[i]), 1.0
        for j in range(n):
            if j != i:
                z = _position(points, near[j])
                weight *= (x - z) / (y - z)
        value += weight * f[points.order[abs(near[i])]]
    return value


@kernel(inner=True)
def _add_point(x: float, profile: Revolution, points: Points) -> int:
    """Make x a point of a surface at rest, unless there is one; return its number."""
    low, new = _place(points, x), points.filled[0]
    for place in (low, low + 1):
        if abs(_position(points, place) - x) <= _ONE_POINT * points.x[1]:
            return int(points.order[place])
    points.x[new], points.obstacle[new] = x, abel_transform(profile, x)
    for i in range(new, low + 1, -1):
        points.order[i] = points.order[i - 1]
    points.order[low + 1] = new
    points.filled[0] = new + 1
    return int(new)


@kernel(reorder=True, inner=True)
def _transform(n: int, nodes: Nodes, work: Work) -> None:
    """Cosine transform of chi at n nodes, with cosines by four points of the fixed grid."""
    out = work.transform
    for j in range(out.size):
        out[j] = 0.0
    for k in range(n):
        s, value = work.x[k] / nodes.spacing, work.unit[k]
        i = int(s)
        a, b, c, d = _lagrange(s - i)
        w, x, y, z = nodes.cosines[abs(i - 1)], nodes.cosines[i], nodes.cosines[i + 1], nodes.cosines[i + 2]
        for j in range(out.size):
            out[j] += value * (a * w[j] + b * x[j] + c * y[j] + d * z[j])


@kernel(reorder=True, inner=True)
def _multiply(matrix: FloatArray, vector: FloatArray, out: FloatArray) -> None:
    """Out = matrix vector, for as many rows as out has."""
    for i in range(out.size):
        s = 0.0
        for j in range(vector.size):
            s += matrix[i, j] * vector[j]
        out[i] = s


@kernel(reorder=True, inner=True)
def _cholesky(M: FloatArray, n: int) -> bool:
    """Put the Cholesky factor of M into its lower triangle; return False if M is not positive definite."""
    for j in range(n):
        s = M[j, j]
        for k in range(j):
            s -= M[j, k] * M[j, k]
        if s <= 0:
            return False
        s = math.sqrt(s)
        M[j, j] = s
        for i in range(j + 1, n):
            v = M[i, j]
            for k in range(j):
                v -= M[i, k] * M[j, k]
            M[i, j] = v / s
    return True


@kernel(reorder=True, inner=True)
def _back_substitute(L: FloatArray, b: FloatArray, n: int) -> None:
    """Solve L L^T x = b in place."""
    for i in range(n):
        v = b[i]
        for k in range(i):
            v -= L[i, k] * b[k]
        b[i] = v / L[i, i]
    for i in range(n - 1, -1, -1):
        v = b[i] / L[i, i]
        b[i] = v
        for k in range(i):
            b[k] -= L[i, k] * v


@kernel(inner=True)
def _set_step(h: float, run: Run) -> Weights:
    """Set the weights of a step of length h; return the weights in D."""
    body, step, work = run.body, run.step, run.work
    after, before = body.local, 0.0
    for k in range(body.local_times.size):
        T = body.local_times[k]
        step.fade[k], step.before[k], step.after[k] = _linear_weights(h, T)
        loss = _loss_weights(h / T, step.fade[k], step.after[k])
        step.loss.yy[k], step.loss.yc[k], step.loss.cc[k] = loss
        after += body.local_modes[k] * step.after[k]
        before += body.local_modes[k] * step.before[k]
    for j in range(body.q.size):  # array expressions would take seconds to compile
        step.effective[j] = body.instant[j]
    for m in range(body.times.shape[0]):
        last, linear, loss = -1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for j in range(body.q.size):
            if body.times[m, j] != last:  # many are equal: the times of the surface's material
                last = body.times[m, j]
                linear = _linear_weights(h, last)
                loss = _loss_weights(h / last, linear[0], linear[2])
            step.fade_q[m, j], step.before_q[m, j], step.after_q[m, j] = linear
            step.loss_q.yy[m, j], step.loss_q.yc[m, j], step.loss_q.cc[m, j] = loss
            step.effective[j] += body.modes[m, j] * linear[2]
    for j in range(body.q.size):
        work.transform[j] = body.weights[j] * step.effective[j] / math.pi
    if body.q.size:
        _multiply(run.nodes.cosines, work.transform, step.table)
    return Weights(after, before)


@kernel(inner=True)
def _find_past(run: Run) -> None:
    """Find the part of the past at the end of the step: of D without chi(0), and of C."""
    body, state, step, work = run.body, run.state, run.step, run.work
    for i in range(state.points.filled[0]):
        s = 0.0
        for k in range(body.local_times.size):
            s += body.local_modes[k] * step.fade[k] * state.eta[k, i]
        work.past[i] = s
    for j in range(body.q.size):
        s = 0.0
        for m in range(body.times.shape[0]):
            s += body.modes[m, j] * (step.fade_q[m, j] * state.zeta[m, j] + step.before_q[m, j] * state.X[j])
        work.transform[j] = s * body.weights[j] * (2 / math.pi)
    if body.q.size:
        _multiply(run.nodes.cosines, work.transform, work.far_past)


@kernel(inner=True)
def _apex(h: float, body: Compliance, state: State, released: bool) -> float:
    """Displacement of the surface at x = 0 after a time h without contact, or in which chi falls to 0."""
    s = 0.0
    for k in range(body.local_times.size):
        fade, before, _ = _linear_weights(h, body.local_times[k])
        s += body.local_modes[k] * (fade * state.eta[k, 0] + (before * state.chi[0] if released else 0.0))
    far = 0.0
    for j in range(body.q.size):
        for m in range(body.times.shape[0]):
            fade, before, _ = _linear_weights(h, body.times[m, j])
            value = fade * state.zeta[m, j] + (before * state.X[j] if released else 0.0)
            far += body.modes[m, j] * value * body.weights[j]
    return s + far * (2 / math.pi)


@kernel(inner=True)
def _event(
    h: float, start: float, end: float, by_force: bool, body: Compliance, state: State, released: bool
) -> float:
    """Return the part of a step after which contact begins, or with `released` ends.

    The depth grows linearly from `start` to `end`. Contact begins where it reaches the displacement of the
    free surface, and ends where it falls below the displacement of a surface from which chi has vanished.
    """
    low, high = 0.0, 1.0
    sign = -1.0 if released else 1.0
    if by_force:
        return min(max(start / (start - end), 0.0), 1.0) if start != end else 0.0
    gap_low = sign * (start - _apex(0.0, body, state, False)) if not released else -1.0
    gap_high = sign * (end - _apex(h, body, state, released))
    for _ in range(_MOST_ITERATIONS):
        part = 0.5 * (low + high)
        if gap_low < 0 < gap_high and high - low < 0.2:
            part = low + (high - low) * gap_low / (gap_low - gap_high)
            part = min(max(part, low + 0.02 * (high - low)), high - 0.02 * (high - low))
        gap = sign * (start + part * (end - start) - _apex(part * h, body, state, released))
        if gap < 0:
            low, gap_low = part, gap
        else:
            high, gap_high = part, gap
        if high - low < 1e-12:
            break
    return high


@kernel(inner=True)
def _place_nodes(a: float, nodes: Nodes, state: State, work: Work) -> int:
    """Put Gauss nodes into [0, a], in parts that end where the contact has turned; return their number."""
    parts = 1
    work.edges[0] = 0.0
    for m in np.sort(state.marks):
        if work.edges[parts - 1] + _APART * a < m < (1 - _APART) * a:
            work.edges[parts] = m
            parts += 1
    work.edges[parts] = a
    if parts == 1:
        for i in range(nodes.gauss.size):
            work.x[i] = a * nodes.gauss[i]
            work.root[i] = math.sqrt(a * nodes.gauss_weights[i])
        return nodes.gauss.size
    n = 0
    for k in range(parts):
        width = work.edges[k + 1] - work.edges[k]
        for i in range(nodes.part.size):
            work.x[n] = work.edges[k] + width * nodes.part[i]
            work.root[n] = math.sqrt(width * nodes.part_weights[i])
            n += 1
    return n


@kernel(inner=True)
def _past_at(x: float, edge: float, run: Run) -> float:
    """Part of the past at x, without chi(0)."""
    near = _at(x, run.work.past, edge, run.state.points) if run.body.local_times.size else 0.0
    return near + _cubic(run.work.far_past, x / run.nodes.spacing)


@kernel(inner=True)
def _solve(a: float, a_old: float, h: float, weights: Weights, run: Run) -> Trial:
    """Solve the step for a trial radius."""
    body, profile, nodes, state, step, work = run.body, run.profile, run.nodes, run.state, run.step, run.work
    n = _place_nodes(a, nodes, state, work)
    root, coupled = work.root, body.q.size > 0
    sweep = _sweep(profile, a_old, a)
    for i in range(n):
        x = work.x[i]
        H = abel_transform(profile, x)
        diagonal, past = weights.after, _past_at(x, a_old, run)
        if x < a_old:
            past += weights.before * _at(x, state.chi, a_old, state.points)
        elif a > a_old and body.local_times.size:
            part = _swept(sweep, x, H)
            diagonal = body.local
            for k in range(body.local_times.size):
                diagonal += body.local_modes[k] * _linear_weights(part * h, body.local_times[k])[2]
        work.unit[i] = root[i]
        work.rest[i] = -(H + past) * root[i]
        if coupled:
            for j in range(i + 1):
                y = work.x[j]
                near, far = _cubic(step.table, (x - y) / nodes.spacing), (x + y) / nodes.spacing
                work.matrix[i, j] = root[i] * root[j] * (near + _cubic(step.table, far))
            work.matrix[i, i] += diagonal
        else:
            work.unit[i] /= diagonal
            work.rest[i] /= diagonal
    if coupled:
        if not _cholesky(work.matrix, n):
            return Trial(0.0, 0.0, 0.0, 0.0, -1)
        _back_substitute(work.matrix, work.unit, n)
        _back_substitute(work.matrix, work.rest, n)
    past = _past_at(a, a_old, run)
    if a < a_old:
        past += weights.before * _at(a, state.chi, a_old, state.points)
    edge, rest, unit, other = 1.0, -abel_transform(profile, a) - past, 0.0, 0.0
    for i in range(n):
        if coupled:
            y = work.x[i]
            near = _cubic(step.table, (a - y) / nodes.spacing)
            k0 = root[i] * (near + _cubic(step.table, (a + y) / nodes.spacing))
            edge -= k0 * work.unit[i]
            rest -= k0 * work.rest[i]
        unit += 4 * root[i] * work.unit[i]
        other += 4 * root[i] * work.rest[i]
    return Trial(edge, rest, unit, other, n)


@kernel(inner=True)
def _find_radius(
    h: float,
    target: float,
    by_force: bool,
    guess: float,
    a_old: float,
    weights: Weights,
    slope: float,
    run: Run,
) -> Radius:
    """Find the contact at the end of a step whose prescribed depth or force is `target`.

    The error of a secant step is of the order of the product of the last two. Force, depth and chi are
    stationary in the radius without adhesion: at the last trial but one they have its squared error.
    """
    drive, stop = run.drive, run.stop
    low, high, a = 0.0, stop, guess
    last_a, last_r, last_error = -1.0, 0.0, 1.0
    falling = False  # with adhesion: towards the stable radius from above, along a concave residual
    for trial in range(1, _MOST_ITERATIONS):
        edge, rest, unit, other, n = _solve(a, a_old, h, weights, run)
        if n < 0:
            return Radius(0.0, 0.0, 0.0, 0.0, 0, trial, NOT_CONVERGED)
        depth = (target - other) / unit if by_force else target
        r = depth * edge + rest + math.sqrt(math.pi * a * drive.adhesion * run.body.local)
        force = depth * unit + other
        scale = max(abs(depth), abs(rest))
        error = abs(r) / scale if r else 0.0
        if a >= stop and r >= 0:
            left = stop < run.profile.rim and error > drive.tolerance
            return Radius(stop, force, depth, 0.0, n, trial, LEFT_GRID if left else COMPLETE)
        if error <= drive.tolerance or high - low < _SAME_RADIUS * high:
            return Radius(a, force, depth, slope, n, trial, COMPLETE)
        if last_a >= 0 and a != last_a:
            slope = (r - last_r) / (a - last_a)
        if r > 0:
            low, falling = a, False
        else:
            high = a
            if drive.adhesion > 0 and low == 0:
                if falling and slope >= 0:
                    return Radius(0.0, 0.0, target, 0.0, 0, trial, COMPLETE)
                new = a * (1 - 1e-4) if not falling else a - r / slope
                falling = True
                if new <= 0:
                    return Radius(0.0, 0.0, target, 0.0, 0, trial, COMPLETE)
                last_a, last_r, a = a, r, new
                continue
        if last_a < 0 and slope >= 0:
            slope = -2 * scale / a
        new = a - r / slope if slope < 0 else stop if r > 0 else 0.0
        if error * max(error, last_error) < drive.tolerance and drive.adhesion == 0 and low < new < high:
            return Radius(new, force, depth, slope, n, trial, COMPLETE)
        last_a, last_r, last_error = a, r, error
        if new >= stop and high == stop:
            new = stop
        elif not low < new < high or trial % 6 == 0:
            new = 0.5 * (low + high)
        a = new
    return Radius(0.0, 0.0, 0.0, 0.0, 0, _MOST_ITERATIONS, NOT_CONVERGED)


@kernel(inner=True)
def _close(h: float, found: Radius, a_old: float, weights: Weights, run: Run) -> float:
    """Advance the state over a step that is solved; return the energy dissipated in it."""
    body, nodes, state, step, work, stop = run.body, run.nodes, run.state, run.step, run.work, run.stop
    a, depth, nb, nm = found.a, found.depth, body.local_times.size, body.times.shape[0]
    touches = a > 0
    n = found.nodes if touches else 0
    for i in range(n):
        work.unit[i] = work.root[i] * (depth * work.unit[i] + work.rest[i])
    lost = 0.0
    _transform(n, nodes, work)
    for j in range(body.q.size):
        s, part = work.transform[j], 0.0
        for m in range(nm):
            y, c = state.X[j] - state.zeta[m, j], s - state.X[j]
            yy, yc, cc = step.loss_q.yy[m, j], step.loss_q.yc[m, j], step.loss_q.cc[m, j]
            part += body.modes[m, j] * (yy * y * y + yc * y * c + cc * c * c)
            state.zeta[m, j] = (
                step.fade_q[m, j] * state.zeta[m, j]
                + step.before_q[m, j] * state.X[j]
                + step.after_q[m, j] * s
            )
        lost += part * body.weights[j] * (2 / math.pi)
        state.X[j] = s
        work.transform[j] = s * step.effective[j] * body.weights[j] * (2 / math.pi)
    if body.q.size:
        _multiply(nodes.cosines, work.transform, work.far)
    sweep = _sweep(run.profile, min(a, a_old), max(a, a_old))
    fixed = work.far.size
    for i in range(state.points.filled[0]):
        x, H = state.points.x[i], state.points.obstacle[i]
        inside = touches and (x < a or a >= stop)  # at and beyond a rim chi is continued
        was_inside = a_old > 0 and (x < a_old or a_old >= stop)
        before = state.chi[i] if was_inside else 0.0
        far = work.far_past[i] + work.far[i] if i < fixed else _cubic(work.far_past, x / nodes.spacing)
        if i >= fixed:
            far += _cubic(work.far, x / nodes.spacing)
        value = depth - H - work.past[i] - far
        diagonal, part = weights.after, 1.0
        growing = inside and not was_inside
        if touches and a > a_old and not was_inside:
            part = _swept(sweep, x, H)
            diagonal = body.local
            for k in range(nb):
                diagonal += body.local_modes[k] * _linear_weights(part * h, body.local_times[k])[2]
        else:
            value -= weights.before * before
        leaving = was_inside and not inside
        if leaving:
            part = _swept(sweep, x, H)
        value /= diagonal
        after = value if inside else 0.0
        weight = nodes.spacing * (0.5 if i in (0, fixed - 3) else 1.0)
        if i > fixed - 3:
            weight = 0.0
        for k in range(nb):
            T, J, old = body.local_times[k], body.local_modes[k], state.eta[k, i]
            if growing:
                rest = math.exp(-(1 - part) * h / T)
                lost += (
                    weight
                    * J
                    * (old * old / 2 * (1 - rest * rest) + _loss(part * h, T, old * rest, 0.0, after))
                )
                e, _, late = _linear_weights(part * h, T)
                state.eta[k, i] = e * rest * old + late * after
            elif leaving:
                e, early, _ = _linear_weights(part * h, T)
                middle, rest = e * old + early * before, math.exp(-(1 - part) * h / T)
                lost += (
                    weight
                    * J
                    * (_loss(part * h, T, old, before, 0.0) + middle * middle / 2 * (1 - rest * rest))
                )
                state.eta[k, i] = rest * middle
            else:
                y, c = before - old, after - before
                quadratic = step.loss.yy[k] * y * y + step.loss.yc[k] * y * c + step.loss.cc[k] * c * c
                lost += weight * J * quadratic
                state.eta[k, i] = step.fade[k] * old + step.before[k] * before + step.after[k] * after
        state.chi[i] = value
    return 4 * lost


@kernel(inner=True)
def _stored(found: Radius, run: Run) -> float:
    """Elastic energy of the body."""
    body, nodes, state, work = run.body, run.nodes, run.state, run.work
    s = 0.0
    for i in range(found.nodes if found.a > 0 else 0):
        s += body.local * (work.unit[i] / work.root[i]) ** 2
    for k in range(body.local_times.size):
        for i in range(work.far.size - 2):
            weight = 0.5 if i in (0, work.far.size - 3) else 1.0
            s += weight * nodes.spacing * body.local_modes[k] * state.eta[k, i] ** 2
    for j in range(body.q.size):
        part = body.instant[j] * state.X[j] ** 2
        for m in range(body.times.shape[0]):
            part += body.modes[m, j] * state.zeta[m, j] ** 2
        s += part * body.weights[j] * (2 / math.pi)
    return 2 * s


@kernel(inner=True)
def _remember(marks: FloatArray, a: float) -> None:
    """Put the radius a in place of a close one, or else of the oldest; the last is the latest."""
    oldest = 0
    for i in range(marks.size):
        if abs(marks[i] - a) < _APART * a:
            oldest = i
    for i in range(oldest, marks.size - 1):
        marks[i] = marks[i + 1]
    marks[-1] = a


@kernel(inner=True)
def _rise(a: float, run: Run) -> float:
    """Largest increase of chi inside the contact, and largest chi outside: with neither p, gap >= 0."""
    largest, chi, spacing = 0.0, run.state.chi, run.nodes.spacing
    for i in range(run.work.far.size - 2):
        x = i * spacing
        if x + spacing <= a:
            largest = max(largest, chi[i + 1] - chi[i])
        elif x > a and a < run.stop:
            largest = max(largest, chi[i])
    return largest


@kernel(inner=True)
def _begin(body: Compliance, profile: Revolution, nodes: Nodes, drive: Drive) -> Run:
    """Return a run of a body at rest."""
    size, nq = nodes.cosines.shape[0] // 2 + 1, body.q.size
    nb, nm = body.local_times.size, body.times.shape[0]
    places = size
    if nb:
        places += drive.time.size + _CLOSING
        for each in drive.breakpoints:
            places += _CLOSING * each
    points = Points(
        np.zeros(places), np.zeros(places), np.arange(places), np.array([size]), np.zeros(places, np.bool_),
        np.zeros(4, np.int64),
    )  # fmt: skip
    for i in range(size):
        points.x[i] = i * nodes.spacing
        points.obstacle[i] = abel_transform(profile, points.x[i])
    points.bent[0] = True  # under a cone
    state = State(
        points, np.zeros(places), np.zeros((nb, places)),
        np.zeros(nq), np.zeros((nm, nq)), np.full(_MARKS, np.inf),
    )  # fmt: skip
    loss = Loss(np.zeros(nb), np.zeros(nb), np.zeros(nb))
    loss_q = Loss(np.zeros((nm, nq)), np.zeros((nm, nq)), np.zeros((nm, nq)))
    step = Step(
        np.zeros(nb), np.zeros(nb), np.zeros(nb), loss,
        np.zeros((nm, nq)), np.zeros((nm, nq)), np.zeros((nm, nq)), loss_q,
        np.zeros(nq), np.zeros(2 * size - 1),
    )  # fmt: skip
    most = max(nodes.gauss.size, (_MARKS + 1) * nodes.part.size)
    work = Work(
        np.zeros(most), np.zeros(most), np.zeros((most, most)), np.zeros(most), np.zeros(most),
        np.zeros(_MARKS + 2), np.zeros(places), np.zeros(size), np.zeros(nq), np.zeros(size),
    )  # fmt: skip
    return Run(body, profile, nodes, drive, state, step, work, min(profile.rim, nodes.reach))


@kernel(inner=True)
def _keep_fields(a: float, run: Run, chi: FloatArray, local: FloatArray, spectrum: FloatArray) -> None:
    """Write the fields of a snapshot: chi, D*chi and C*X."""
    body, state = run.body, run.state
    for i in range(chi.size):
        x = i * run.nodes.spacing
        inside = a > 0 and (x < a or a >= run.stop)
        chi[i] = state.chi[i]
        local[i] = body.local * (state.chi[i] if inside else 0.0)
        for k in range(body.local_times.size):
            local[i] += body.local_modes[k] * state.eta[k, i]
    for j in range(spectrum.size):
        s = body.instant[j] * state.X[j]
        for m in range(body.times.shape[0]):
            s += body.modes[m, j] * state.zeta[m, j]
        spectrum[j] = s


@kernel
def march(body: Compliance, profile: Revolution, nodes: Nodes, drive: Drive) -> Marched:  # noqa: C901
    """Follow an indentation of a body at rest over given times, on nodes in x for its largest contact."""
    nt, run = drive.time.size, _begin(body, profile, nodes, drive)
    state, work, stop = run.state, run.work, run.stop
    size, kept = work.far.size, 0
    for each in drive.snapshots:
        kept += each
    out = Marched(
        np.zeros(nt), np.zeros(nt), np.zeros(nt), np.zeros(nt), np.zeros(nt), np.zeros(nt),
        np.zeros((kept, size)), np.zeros((kept, size)), np.zeros((kept, body.q.size)), 0, COMPLETE, nt,
    )  # fmt: skip
    a_old, h_old, rate, lost, taken, snapshot = 0.0, -1.0, 0.0, 0.0, 0, 0
    bend, slope, since, status = 0.0, 0.0, 0.0, COMPLETE
    weights, stopped = Weights(0.0, 0.0), nt
    # The point of the edge, -1 without one; whether the past stays bent there; the largest radius so far.
    edge, bent, stays, largest = -1, state.points.bent, False, 0.0
    found = Radius(0.0, 0.0, 0.0, 0.0, 0, 0, COMPLETE)
    for at in range(nt):
        duration = drive.time[at] - drive.time[at - 1] if at else 1e-30 * (drive.time[-1] - drive.time[0])
        duration = max(duration, 1e-290)
        begin, by_force = drive.value[at - 1] if at else 0.0, drive.by_force[at]
        if at and by_force != drive.by_force[at - 1]:
            begin = found.force if by_force else found.depth
        begins = at == 0 or drive.breakpoints[at]
        done, piece, met = 0.0, 1.0, False  # part of the step behind; of the rest ahead; contact begins there
        for _ in range(_SUBSTEPS):
            h = duration * (1 - done) * piece
            now = begin + done * (drive.value[at] - begin)
            target = now + piece * (drive.value[at] - now)
            if h != h_old:
                weights, h_old = _set_step(h, run), h
            _find_past(run)
            free = work.past[0] + work.far_past[0] + (weights.before * state.chi[0] if a_old > 0 else 0.0)
            touches = target > 0 if by_force else target > free
            starts = touches and a_old == 0 and not met and at > 0
            ends = not touches and a_old > 0 and drive.adhesion == 0
            if piece < 1:
                touches = False
            elif starts or ends:
                part = _event(h, now, target, by_force, body, state, ends)
                if _INSTANT < part < 1 - _INSTANT:
                    piece, met = part, starts
                    continue
                touches = starts and part <= _INSTANT
            apart = Radius(0.0, 0.0, free if by_force else target, 0.0, 0, 0, COMPLETE)
            found = apart
            if touches or (drive.adhesion > 0 and a_old > 0):
                guess = 0.3 * stop if drive.adhesion == 0 else stop
                if a_old > 0:
                    guess = a_old + h * (rate + bend * (h + since)) if drive.adhesion == 0 else a_old
                    guess = min(stop, max(0.2 * a_old, guess))
                found = _find_radius(h, target, by_force, guess, a_old, weights, slope, run)
                taken += found.solutions
                slope, status = found.slope, found.status
                if status != COMPLETE:
                    break
                if found.a == 0:
                    found = apart
            change = (found.a - a_old) / h
            turned = rate * change < 0 and at > 1 and a_old > 0
            if turned:
                _remember(state.marks, a_old)
            new, fresh = -1, largest < found.a < stop
            if fresh and body.local_times.size:
                for k in range(1, _CLOSING + 1 if begins else 0):
                    _add_point(found.a - (found.a - largest) * 0.5**k, profile, state.points)
                new = _add_point(found.a, profile, state.points)
            largest = max(largest, found.a)
            lost += _close(h, found, a_old, weights, run)
            if edge >= 0:
                bent[edge] = stays or turned or not fresh
            if new >= 0:
                stays = bent[new] or begins
                bent[new] = True
            edge = new
            bend = (change - rate) / (h + since) if since > 0 else 0.0
            rate, a_old = change, found.a
            since = h if 0 < a_old < stop and not drive.breakpoints[at] else 0.0
            if piece == 1:
                break
            done, piece = done + (1 - done) * piece, 1.0
        if status != COMPLETE:
            stopped = at
            break
        if begins and a_old > 0:
            _remember(state.marks, a_old)
        out.force[at], out.depth[at], out.radius[at] = found.force, found.depth, a_old
        out.stored[at], out.dissipated[at] = _stored(found, run), lost
        out.rise[at] = _rise(a_old, run) if a_old > 0 else 0.0
        if drive.snapshots[at]:
            _keep_fields(a_old, run, out.chi[snapshot], out.local[snapshot], out.spectrum[snapshot])
            snapshot += 1
    return Marched(
        out.force, out.depth, out.radius, out.stored, out.dissipated, out.rise,
        out.chi, out.local, out.spectrum, taken, status, stopped,
    )  # fmt: skip
