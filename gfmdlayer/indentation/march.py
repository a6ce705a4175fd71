"""Compiled loops over the time steps of an isolated axisymmetric indentation.

The unknown is chi(x, t) = int_x^a p r dr/(r^2 - x^2)^(1/2), with the force F = 4 int_0^a chi dx, and
X(q, t) = int_0^a chi cos(qx) dx. With D and C of `compliance`, * the convolution J(t) * d chi, and H the Abel
transform of the profile,

    D*chi(x) + (2/pi) int_0^inf cos(qx) C(q)*X(q) dq = depth(t) - H(x),   x < a(t);      chi = 0,   x > a(t)

holds in loading and unloading alike. chi(a) = 0 at the edge of a smooth profile, and
chi(a) = -(pi a w/J0)^(1/2) with a work of adhesion w (JKR). Internal variables eta_k(x) and zeta_m(q) follow
chi and X with the retardation times, exactly for chi and X that are linear over a step; a point that the edge
sweeps is loaded for its part of the step. On a fixed grid in x the past is kept; the equation of a step is
solved at Gauss nodes in [0, a].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.indentation.compliance import Compliance
from gfmdlayer.kernels import kernel
from gfmdlayer.punch.revolution import Revolution, abel_transform

# Outcomes of a march.
COMPLETE, LEFT_GRID, NOT_CONVERGED = 0, 1, 2

_MARKS = 3  # radii at which chi may have kinks, remembered
_APART = 0.02  # part of a by which they differ
_GENTLE = 0.05  # h/T below which Simpson's rule has the energy lost in a step to 1e-9
_SMALL = 1e-4  # h/T below which differences of closed forms lose digits
_MOST_ITERATIONS = 80
_SAME_RADIUS = 1e-11  # width of the bracket of a radius, relative to it, at which it is found
_INSTANT = 1e-9  # part of a step at whose ends a change of contact is not inside
_SUBSTEPS = 12  # of one step: contact found and lost
_FRONT = 1e-9  # slope of the coordinate of the moving edge where H is flat


class Nodes(NamedTuple):
    """Nodes in x, which depend on the largest contact radius alone.

    Attributes
    ----------
    reach : float
        The largest contact radius.
    spacing : float
        Of the fixed grid x_i = i spacing, i = 0 to n + 1; the last but two is the largest radius.
    cosines : ndarray, shape (2 n + 3, nq)
        cos(q x_i).
    gauss, gauss_weights : ndarray
        Gauss nodes and weights on [0, 1], for all of [0, a].
    part, part_weights : ndarray
        The same, for each part of [0, a] between kinks.
    """

    reach: float
    spacing: float
    cosines: FloatArray
    gauss: FloatArray
    gauss_weights: FloatArray
    part: FloatArray
    part_weights: FloatArray


class Drive(NamedTuple):
    """What is prescribed, at the ends of the steps; linear over each.

    Attributes
    ----------
    time, value : ndarray, shape (nt,)
        Times, and depths or forces.
    by_force : bool
        Whether the force is prescribed.
    kinks, snapshots : ndarray of bool, shape (nt,)
        Whether its rate jumps at a time, and whether fields are kept there.
    adhesion : float
        Work of adhesion.
    tolerance : float
        Of the contact radius: residual at the edge over the depth.
    """

    time: FloatArray
    value: FloatArray
    by_force: bool
    kinks: BoolArray
    snapshots: BoolArray
    adhesion: float
    tolerance: float


class State(NamedTuple):
    """What a run carries from step to step.

    Attributes
    ----------
    chi : ndarray, shape (n + 2,)
        At the end of the last step on the fixed grid, continued beyond a.
    eta : ndarray, shape (nb, n + 2)
        Internal variables of D.
    X : ndarray, shape (nq,)
        Cosine transform of chi.
    zeta : ndarray, shape (nm, nq)
        Internal variables of C.
    marks : ndarray
        Radii where chi may have kinks.
    """

    chi: FloatArray
    eta: FloatArray
    X: FloatArray
    zeta: FloatArray
    marks: FloatArray


class Step(NamedTuple):
    """Weights of a step of one length: a variable becomes fade old + before chi(0) + after chi(h)."""

    fade: FloatArray  # (nb,)
    before: FloatArray
    after: FloatArray
    fade_q: FloatArray  # (nm, nq)
    before_q: FloatArray
    after_q: FloatArray
    loss: FloatArray  # (3, nb), of `_loss_weights`
    loss_q: FloatArray  # (3, nm, nq)
    effective: FloatArray  # (nq,), C of the step
    table: FloatArray  # (2 n + 3,), kernel of the step: (1/pi) int effective cos(q z) dq


class Work(NamedTuple):
    """Arrays of one solution."""

    x: FloatArray  # nodes
    root: FloatArray  # roots of their weights
    matrix: FloatArray
    rows: FloatArray  # two right-hand sides, then solutions: of unit depth, and of the rest
    edges: FloatArray  # ends of the parts
    past: FloatArray  # (n + 2,), what the past alone leaves of D*chi at the end of the step
    far_past: FloatArray  # (n + 2,), and of the integral of C
    transform: FloatArray  # (nq,)
    far: FloatArray  # (n + 2,)
    obstacle: FloatArray  # (n + 2,), H on the fixed grid


class Marched(NamedTuple):
    """Columns of a march, one value a time, and fields at its snapshots."""

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
def _loss_weights(h: float, T: float) -> tuple[float, float, float]:
    """Factors of y^2, y c and c^2 in int (chi - eta)^2/T dt, for chi that changes linearly by c over a step.

    y is chi - eta at its beginning.
    """
    z = h / T
    if z == 0:
        return 0.0, 0.0, 0.0
    if z < _GENTLE:
        # Simpson's rule, from chi - eta = fade y + mean c at the middle and the end.
        end = -math.expm1(-z) / z
        fade = math.sqrt(1 - end * z)
        mean = end / (1 + fade)
        yy = 1 + 4 * fade**2 + fade**4
        return z / 6 * yy, z / 3 * (4 * fade * mean + fade**2 * end), z / 6 * (4 * mean**2 + end**2)
    once = -math.expm1(-z)
    twice = once * (1 - once / 2)
    return twice, 2 * (once - twice) / z, (z - 2 * once + twice) / (z * z)


@kernel(inner=True)
def _loss(h: float, T: float, old: float, before: float, after: float) -> float:
    """Int (chi - eta)^2/T dt over a step in which chi is linear and eta begins as `old`."""
    yy, yc, cc = _loss_weights(h, T)
    y, c = before - old, after - before
    return yy * y * y + yc * y * c + cc * c * c


class Sweep(NamedTuple):
    """A moving edge: the coordinate H + slope x in which it moves evenly through a step, at either end."""

    slope: float
    small: float
    large: float


@kernel(inner=True)
def _sweep(profile: Revolution, small: float, large: float) -> Sweep:
    """Return how the edge moves between two radii; a flat end comes into contact at once."""
    slope = _FRONT if small > 0 else 0.0
    H_small = abel_transform(profile, small) + slope * small
    return Sweep(slope, H_small, abel_transform(profile, large) + slope * large)


@kernel(inner=True)
def _swept(sweep: Sweep, x: float, H: float) -> float:
    """Part of the step for which a growing contact has covered x, or a shrinking one will."""
    if sweep.large == sweep.small:
        return 1.0
    part = (sweep.large - H - sweep.slope * x) / (sweep.large - sweep.small)
    return float(min(max(part, 0.0), 1.0))


@kernel(inner=True)
def _lagrange(y: float) -> tuple[float, float, float, float]:
    """Weights of the values at -1, 0, 1 and 2 for that at y."""
    left, right = (y + 1) * y / 2, (y - 1) * (y - 2) / 2
    return -y * right / 3, (y + 1) * right, -left * (y - 2), left * (y - 1) / 3


@kernel(inner=True)
def _cubic(f: FloatArray, s: float) -> float:
    """Value at s grid spacings, by four points, of an even function."""
    i = int(s)
    a, b, c, d = _lagrange(s - i)
    value: float = a * f[abs(i - 1)] + b * f[i] + c * f[i + 1] + d * f[i + 2]
    return value


@kernel(reorder=True, inner=True)
def _add_cosines(cosines: FloatArray, s: float, value: float, out: FloatArray) -> None:
    """Add value cos(q x) at s grid spacings, by four points, to out(q)."""
    i = int(s)
    a, b, c, d = _lagrange(s - i)
    w, x, y, z = cosines[abs(i - 1)], cosines[i], cosines[i + 1], cosines[i + 2]
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
def _cholesky_solve(M: FloatArray, B: FloatArray, n: int) -> bool:
    """Solve M X = B for both rows of B in place; False if M is not positive definite."""
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
    for r in range(2):
        for i in range(n):
            v = B[r, i]
            for k in range(i):
                v -= M[i, k] * B[r, k]
            B[r, i] = v / M[i, i]
        for i in range(n - 1, -1, -1):
            v = B[r, i] / M[i, i]
            B[r, i] = v
            for k in range(i):
                B[r, k] -= M[i, k] * v
    return True


@kernel(inner=True)
def _set_step(h: float, body: Compliance, nodes: Nodes, step: Step, work: Work) -> tuple[float, float]:
    """Set the weights of a step of length h; return those of D for chi(h) and chi(0)."""
    after, before = body.local, 0.0
    for k in range(body.local_times.size):
        step.fade[k], step.before[k], step.after[k] = _linear_weights(h, body.local_times[k])
        step.loss[0, k], step.loss[1, k], step.loss[2, k] = _loss_weights(h, body.local_times[k])
        after += body.local_modes[k] * step.after[k]
        before += body.local_modes[k] * step.before[k]
    step.effective[:] = body.instant
    for m in range(body.times.shape[0]):
        last, linear, loss = -1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for j in range(body.q.size):
            if body.times[m, j] != last:  # many are equal: those of the surface's material
                last = body.times[m, j]
                linear, loss = _linear_weights(h, last), _loss_weights(h, last)
            step.fade_q[m, j], step.before_q[m, j], step.after_q[m, j] = linear
            step.loss_q[0, m, j], step.loss_q[1, m, j], step.loss_q[2, m, j] = loss
            step.effective[j] += body.modes[m, j] * linear[2]
    if body.q.size:
        work.transform[:] = body.weights * step.effective / math.pi
        _multiply(nodes.cosines, work.transform, step.table)
    return after, before


@kernel(inner=True)
def _find_past(body: Compliance, nodes: Nodes, state: State, step: Step, work: Work) -> None:
    """Find what the past leaves at the end of the step: of D without chi(0), and of C."""
    for i in range(work.past.size):
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
        _multiply(nodes.cosines, work.transform, work.far_past)


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

    The depth grows linearly from `start` to `end`; contact begins where it reaches the displacement of the
    free surface, and ends where it falls below that of a surface from which chi has vanished.
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
def _past_at(x: float, nodes: Nodes, work: Work) -> float:
    """What the past leaves at x, without chi(0)."""
    s = x / nodes.spacing
    return _cubic(work.past, s) + _cubic(work.far_past, s)


@kernel(inner=True)
def _solve(
    a: float,
    a_old: float,
    h: float,
    weights: tuple[float, float],
    body: Compliance,
    profile: Revolution,
    nodes: Nodes,
    state: State,
    step: Step,
    work: Work,
) -> tuple[float, float, float, float, int]:
    """Solve the step for a trial radius.

    Returns
    -------
    float, float, float, float, int
        Residual at the edge and force, each as factor of the depth and as the rest; number of nodes, or -1.
    """
    n = _place_nodes(a, nodes, state, work)
    after, before = weights
    rows, root, coupled = work.rows, work.root, body.q.size > 0
    sweep = _sweep(profile, a_old, a)
    for i in range(n):
        x = work.x[i]
        H = abel_transform(profile, x)
        diagonal, past = after, _past_at(x, nodes, work)
        if x < a_old:
            past += before * _cubic(state.chi, x / nodes.spacing)
        elif a > a_old and body.local_times.size:
            part = _swept(sweep, x, H)
            diagonal = body.local
            for k in range(body.local_times.size):
                diagonal += body.local_modes[k] * _linear_weights(part * h, body.local_times[k])[2]
        rows[0, i] = root[i]
        rows[1, i] = -(H + past) * root[i]
        if coupled:
            for j in range(i + 1):
                y = work.x[j]
                near, far = _cubic(step.table, (x - y) / nodes.spacing), (x + y) / nodes.spacing
                work.matrix[i, j] = root[i] * root[j] * (near + _cubic(step.table, far))
            work.matrix[i, i] += diagonal
        else:
            rows[0, i] /= diagonal
            rows[1, i] /= diagonal
    if coupled and not _cholesky_solve(work.matrix, rows, n):
        return 0.0, 0.0, 0.0, 0.0, -1
    past = _past_at(a, nodes, work)
    if a < a_old:
        past += before * _cubic(state.chi, a / nodes.spacing)
    edge, rest, unit, other = 1.0, -abel_transform(profile, a) - past, 0.0, 0.0
    for i in range(n):
        if coupled:
            y = work.x[i]
            near = _cubic(step.table, (a - y) / nodes.spacing)
            k0 = root[i] * (near + _cubic(step.table, (a + y) / nodes.spacing))
            edge -= k0 * rows[0, i]
            rest -= k0 * rows[1, i]
        unit += 4 * root[i] * rows[0, i]
        other += 4 * root[i] * rows[1, i]
    return edge, rest, unit, other, n


@kernel(inner=True)
def _find_radius(
    h: float,
    target: float,
    guess: float,
    a_old: float,
    weights: tuple[float, float],
    slope: float,
    drive: Drive,
    body: Compliance,
    profile: Revolution,
    nodes: Nodes,
    state: State,
    step: Step,
    work: Work,
) -> tuple[float, float, float, float, int, int, int]:
    """Find the contact radius at the end of a step.

    The error of a secant step is of the order of the product of the last two. Force, depth and chi are
    stationary in the radius without adhesion: at the last but one they have its squared error.

    Returns
    -------
    float, float, float, float, int, int, int
        Radius, 0 where there is no contact; force; depth; slope of the residual over the radius, 0 where
        it is not known, as also taken; the number of nodes; the solutions; the outcome.
    """
    stop = min(profile.rim, nodes.reach)
    low, high, a = 0.0, stop, guess
    last_a, last_r, last_error = -1.0, 0.0, 1.0
    falling = False  # with adhesion: towards the stable radius from above, along a concave residual
    for trial in range(1, _MOST_ITERATIONS):
        edge, rest, unit, other, n = _solve(a, a_old, h, weights, body, profile, nodes, state, step, work)
        if n < 0:
            return 0.0, 0.0, 0.0, 0.0, 0, trial, NOT_CONVERGED
        depth = (target - other) / unit if drive.by_force else target
        r = depth * edge + rest + math.sqrt(math.pi * a * drive.adhesion * body.local)
        force = depth * unit + other
        scale = max(abs(depth), abs(rest))
        error = abs(r) / scale if r else 0.0
        if a >= stop and r >= 0:
            left = stop < profile.rim and error > drive.tolerance
            return stop, force, depth, 0.0, n, trial, LEFT_GRID if left else COMPLETE
        if error <= drive.tolerance or high - low < _SAME_RADIUS * high:
            return a, force, depth, slope, n, trial, COMPLETE
        if last_a >= 0 and a != last_a:
            slope = (r - last_r) / (a - last_a)
        if r > 0:
            low, falling = a, False
        else:
            high = a
            if drive.adhesion > 0 and low == 0:
                if falling and slope >= 0:
                    return 0.0, 0.0, target, 0.0, 0, trial, COMPLETE
                new = a * (1 - 1e-4) if not falling else a - r / slope
                falling = True
                if new <= 0:
                    return 0.0, 0.0, target, 0.0, 0, trial, COMPLETE
                last_a, last_r, a = a, r, new
                continue
        if last_a < 0 and slope >= 0:
            slope = -2 * scale / a
        new = a - r / slope if slope < 0 else -1.0
        if error * max(error, last_error) < drive.tolerance and drive.adhesion == 0 and low < new < high:
            return new, force, depth, slope, n, trial, COMPLETE
        last_a, last_r, last_error = a, r, error
        if new >= stop and high == stop:
            new = stop
        elif not low < new < high or trial % 6 == 0:
            new = 0.5 * (low + high)
        a = new
    return 0.0, 0.0, 0.0, 0.0, 0, _MOST_ITERATIONS, NOT_CONVERGED


@kernel(inner=True)
def _close(
    h: float,
    a: float,
    a_old: float,
    depth: float,
    n: int,
    weights: tuple[float, float],
    body: Compliance,
    profile: Revolution,
    nodes: Nodes,
    state: State,
    step: Step,
    work: Work,
) -> float:
    """Carry the state on over a step that is solved; return the energy dissipated in it."""
    after_weight, before_weight = weights
    stop = min(profile.rim, nodes.reach)
    nb, nm, touches = body.local_times.size, body.times.shape[0], a > 0
    for i in range(n if touches else 0):
        work.rows[0, i] = work.root[i] * (depth * work.rows[0, i] + work.rows[1, i])  # weight times chi
    lost = 0.0
    work.transform[:] = 0.0
    for i in range(n if touches and body.q.size else 0):
        _add_cosines(nodes.cosines, work.x[i] / nodes.spacing, work.rows[0, i], work.transform)
    for j in range(body.q.size):
        s, part = work.transform[j], 0.0
        for m in range(nm):
            y, c = state.X[j] - state.zeta[m, j], s - state.X[j]
            yy, yc, cc = step.loss_q[0, m, j], step.loss_q[1, m, j], step.loss_q[2, m, j]
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
    sweep = _sweep(profile, min(a, a_old), max(a, a_old))
    for i in range(state.chi.size):
        x, H = i * nodes.spacing, work.obstacle[i]
        inside = touches and (x < a or a >= stop)  # at and beyond a rim chi is continued
        was_inside = a_old > 0 and (x < a_old or a_old >= stop)
        before = state.chi[i] if was_inside else 0.0
        value = depth - H - work.past[i] - work.far_past[i] - work.far[i]
        diagonal, part = after_weight, 1.0
        growing = inside and not was_inside
        if touches and a > a_old and not was_inside:
            part = _swept(sweep, x, H)
            diagonal = body.local
            for k in range(nb):
                diagonal += body.local_modes[k] * _linear_weights(part * h, body.local_times[k])[2]
        else:
            value -= before_weight * before
        leaving = was_inside and not inside
        if leaving:
            part = _swept(sweep, x, H)
        value /= diagonal
        after = value if inside else 0.0
        weight = nodes.spacing * (0.5 if i in (0, state.chi.size - 3) else 1.0)
        if i > state.chi.size - 3:
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
                quadratic = step.loss[0, k] * y * y + step.loss[1, k] * y * c + step.loss[2, k] * c * c
                lost += weight * J * quadratic
                state.eta[k, i] = step.fade[k] * old + step.before[k] * before + step.after[k] * after
        state.chi[i] = value
    return 4 * lost


@kernel(inner=True)
def _stored(a: float, n: int, body: Compliance, nodes: Nodes, state: State, work: Work) -> float:
    """Elastic energy of the body."""
    s = 0.0
    for i in range(n if a > 0 else 0):
        s += body.local * (work.rows[0, i] / work.root[i]) ** 2
    for k in range(body.local_times.size):
        for i in range(state.chi.size - 2):
            weight = 0.5 if i in (0, state.chi.size - 3) else 1.0
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
def _rise(a: float, profile: Revolution, nodes: Nodes, chi: FloatArray) -> float:
    """Largest increase of chi inside the contact, and largest chi outside: with neither p, gap >= 0."""
    largest = 0.0
    for i in range(chi.size - 2):
        x = i * nodes.spacing
        if x + nodes.spacing <= a:
            largest = max(largest, chi[i + 1] - chi[i])
        elif x > a and a < min(profile.rim, nodes.reach):
            largest = max(largest, chi[i])
    return largest


@kernel
def march(  # noqa: C901
    body: Compliance, profile: Revolution, nodes: Nodes, drive: Drive
) -> Marched:
    """Follow an indentation over given times.

    Parameters
    ----------
    body : Compliance
        The body.
    profile : Revolution
        The indenter.
    nodes : Nodes
        Nodes in x for the reach of the body.
    drive : Drive
        What is prescribed; the body is at rest before the first time.

    Returns
    -------
    Marched
        Columns, up to the step at which it ended.
    """
    nt, size, nq = drive.time.size, nodes.cosines.shape[0] // 2 + 1, body.q.size
    nb, nm = body.local_times.size, body.times.shape[0]
    columns = np.zeros((6, nt))
    kept = 0
    for each in drive.snapshots:
        kept += each
    fields_chi, fields_local = np.zeros((kept, size)), np.zeros((kept, size))
    fields_q = np.zeros((kept, nq))
    state = State(
        np.zeros(size), np.zeros((nb, size)), np.zeros(nq), np.zeros((nm, nq)), np.full(_MARKS, np.inf)
    )
    step = Step(
        np.zeros(nb), np.zeros(nb), np.zeros(nb), np.zeros((nm, nq)), np.zeros((nm, nq)), np.zeros((nm, nq)),
        np.zeros((3, nb)), np.zeros((3, nm, nq)), np.zeros(nq), np.zeros(2 * size - 1),
    )  # fmt: skip
    most = max(nodes.gauss.size, (_MARKS + 1) * nodes.part.size)
    work = Work(
        np.zeros(most), np.zeros(most), np.zeros((most, most)), np.zeros((2, most)), np.zeros(_MARKS + 2),
        np.zeros(size), np.zeros(size), np.zeros(nq), np.zeros(size), np.zeros(size),
    )  # fmt: skip
    for i in range(size):
        work.obstacle[i] = abel_transform(profile, i * nodes.spacing)
    stop = min(profile.rim, nodes.reach)
    a_old, depth, h_old, rate, lost, status, taken, snapshot = 0.0, 0.0, -1.0, 0.0, 0.0, COMPLETE, 0, 0
    bend, slope, since = 0.0, 0.0, 0.0
    weights, stopped = (0.0, 0.0), nt
    for at in range(nt):
        duration = drive.time[at] - drive.time[at - 1] if at else 1e-30 * (drive.time[-1] - drive.time[0])
        duration = max(duration, 1e-290)
        begin = drive.value[at - 1] if at else 0.0
        done, piece, met = 0.0, 1.0, False  # part of the step behind; of the rest ahead; contact begins there
        for _ in range(_SUBSTEPS):
            h = duration * (1 - done) * piece
            now = begin + done * (drive.value[at] - begin)
            target = now + piece * (drive.value[at] - now)
            if h != h_old:
                weights = _set_step(h, body, nodes, step, work)
                h_old = h
            _find_past(body, nodes, state, step, work)
            free = work.past[0] + work.far_past[0] + (weights[1] * state.chi[0] if a_old > 0 else 0.0)
            touches = target > 0 if drive.by_force else target > free
            starts = touches and a_old == 0 and not met and at > 0
            ends = not touches and a_old > 0 and drive.adhesion == 0
            if piece < 1:
                touches = False
            elif starts or ends:
                part = _event(h, now, target, drive.by_force, body, state, ends)
                if _INSTANT < part < 1 - _INSTANT:
                    piece, met = part, starts
                    continue
                touches = starts and part <= _INSTANT
            a, force, n = 0.0, 0.0, 0
            if touches or (drive.adhesion > 0 and a_old > 0):
                guess = 0.3 * stop if drive.adhesion == 0 else stop
                if a_old > 0:
                    guess = a_old + h * (rate + bend * (h + since)) if drive.adhesion == 0 else a_old
                    guess = min(stop, max(0.2 * a_old, guess))
                a, force, depth, slope, n, trials, status = _find_radius(
                    h, target, guess, a_old, weights, slope, drive, body, profile, nodes, state, step, work
                )
                taken += trials
                if status != COMPLETE:
                    break
            if a == 0:
                depth = free if drive.by_force else target
            lost += _close(h, a, a_old, depth, n, weights, body, profile, nodes, state, step, work)
            change = (a - a_old) / h
            if rate * change < 0 and at > 1 and a_old > 0:
                _remember(state.marks, a_old)
            bend = (change - rate) / (h + since) if since > 0 else 0.0
            rate, a_old, since = change, a, h if a > 0 and not drive.kinks[at] else 0.0
            if piece == 1:
                break
            done, piece = done + (1 - done) * piece, 1.0
        if status != COMPLETE:
            stopped = at
            break
        if drive.kinks[at] and a_old > 0:
            _remember(state.marks, a_old)
        columns[0, at], columns[1, at], columns[2, at] = force, depth, a_old
        columns[3, at], columns[4, at] = _stored(a_old, n, body, nodes, state, work), lost
        columns[5, at] = _rise(a_old, profile, nodes, state.chi) if a_old > 0 else 0.0
        if drive.snapshots[at]:
            for i in range(size):
                x = i * nodes.spacing
                inside = a_old > 0 and (x < a_old or a_old >= stop)
                chi = state.chi[i] if inside else 0.0
                fields_chi[snapshot, i] = state.chi[i]
                fields_local[snapshot, i] = body.local * chi
                for k in range(nb):
                    fields_local[snapshot, i] += body.local_modes[k] * state.eta[k, i]
            for j in range(nq):
                s = body.instant[j] * state.X[j]
                for m in range(nm):
                    s += body.modes[m, j] * state.zeta[m, j]
                fields_q[snapshot, j] = s
            snapshot += 1
    return Marched(
        columns[0], columns[1], columns[2], columns[3], columns[4], columns[5],
        fields_chi, fields_local, fields_q, taken, status, stopped,
    )  # fmt: skip
