"""Compiled loops over the time steps of an isolated axisymmetric indentation.

The unknown is chi(x, t) = int_x^a p r dr/(r^2 - x^2)^(1/2), with the force F = 4 int_0^a chi dx, and
X(q, t) = int_0^a chi cos(qx) dx. With D and C of `compliance`, * the convolution J(t) * d chi, and H the Abel
transform of the profile,

    D*chi(x) + (2/pi) int_0^inf cos(qx) C(q)*X(q) dq = depth(t) - H(x),   x < a(t);      chi = 0,   x > a(t)

holds in loading and unloading alike. chi(a) = 0 at the edge of a smooth profile, and chi(a) = -(pi a
w/J0)^(1/2) with a work of adhesion w (JKR). With u = D*chi, the points in contact have relaxing variables
of G = 1/D that follow u, and the others retarded ones of D, which fade; both are exact for u that is linear
over a step. (Retarded variables in contact, which follow a linear chi, ring like the rule of Crank and
Nicolson.) C holds the modes of -D; in a step it takes u for them. Its other variables zeta_m(q) follow X. A
point that the edge sweeps is in contact for its part of the step. The past is kept on a fixed grid in x,
and at the radii where the edge was at the end of each step. For the past bends at the edge: the variables
of short times follow within a width T da/dt, which a slow contact makes narrower than any grid. The point
at the edge has an inside and an outside; interpolation in x does not cross it, nor radii where the edge
turned. The equation of a step is solved at Gauss nodes in [0, a].

Sizes: nt times, nb retardation times of D, nq nodes in q, nm modes of C.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray, IntArray
from gfmdlayer.indentation.compliance import Compliance
from gfmdlayer.kernels import kernel
from gfmdlayer.punch.revolution import Revolution, abel_transform

# Outcomes of a run.
COMPLETE, LEFT_GRID, NOT_CONVERGED = 0, 1, 2

_MARKS = 3  # radii that are remembered, where the slope of chi may jump; most knots of a profile among them
_FEW = 16  # nodes of a part that resolve the cosines over the whole reach
_APART = 0.02  # part of a by which they differ
_GENTLE = 0.05  # h/T below which Simpson's rule has the energy lost in a step to 1e-9
_SMALL = 1e-4  # h/T below which differences of closed forms lose digits
_MOST_ITERATIONS = 80
_SAME_RADIUS = 1e-11  # width of the bracket of a radius, relative to it, at which it is found
_INSTANT = 1e-9  # part of a step at whose ends a change of contact is not inside
_CLOSING = 12  # points that close in on the edge at a breakpoint, where it may turn
_SUBSTEPS = 100  # of one step: contact found and lost
_PLACES = 4 * _SUBSTEPS  # of points for the steps in which the loss of contact is located
_FRONT = 1e-9  # slope of the coordinate of the moving edge where H is flat
_BESIDE = 1e-12  # relative distance from the edge of trials on its two sides
_LEAST_STRIDE = 1e-4  # of a search for the edge, over the largest radius
_VANISHED = 1e-6  # radius, over the largest, below which a receding contact is lost
_GOLDEN, _GOLDEN_STEPS = 0.6180339887498949, 20
_FALLS = 2  # trials of falling excess after which contact is lost, where the loss is located
_SNAP = 1e-9  # part of a step in which a contact with adhesion begins
_TWIN = 1e-8  # distance of a second point at an edge that rested, over the spacing
_ONE_POINT = 1e-9  # distance of a point to the next, over the spacing, below which they are one


class Branches(NamedTuple):
    """The compliance D as the modulus G = 1/D = glassy - sum_r moduli_r/(1 + s times_r)."""

    glassy: float
    moduli: FloatArray  # (nb,)
    times: FloatArray  # (nb,)
    of_retarded: FloatArray  # (nb, nb), relaxing variables from retarded ones
    to_retarded: FloatArray  # (nb, nb), and back


class MarchNodes(NamedTuple):
    """Nodes in x, which depend on the largest contact radius only."""

    reach: float  # the largest contact radius
    spacing: float  # of the fixed grid x_i = i spacing, i = 0 to n + 1; the last but two is the reach
    cosines: FloatArray  # (2 n + 3, nq), cos(q x_i)
    gauss: FloatArray  # Gauss nodes on [0, 1], for all of [0, a]
    gauss_weights: FloatArray
    part: FloatArray  # the same, for each part of [0, a] between its marks
    part_weights: FloatArray


class EdgeLaw(NamedTuple):
    """Energy release rate D chi(a)^2/(pi a) at a moving edge, with D = J0 against sudden loads.

    A resting edge has one between `healing` and `work`. Without adhesion all are 0.
    """

    work: float  # of a slowly receding edge; of an edge of speed v it is work (1 + (v/speed)^exponent)
    healing: float  # of an advancing edge
    speed: float
    exponent: float


class MarchDrive(NamedTuple):
    """Prescribed depth or force at the ends of the steps, shape (nt,); linear over each step.

    Where the control changes, the first step begins at the depth or force that the last one has found.
    """

    time: FloatArray
    value: FloatArray
    by_force: BoolArray  # (nt,), of the step that ends at a time
    breakpoints: BoolArray  # whether the rate jumps at a time
    snapshots: BoolArray  # whether fields are kept at a time
    law: EdgeLaw
    located: float  # part of a step within which the loss of a contact with adhesion is located; 1: it is not
    tolerance: float  # of the contact radius: residual at the edge over the depth


class Points(NamedTuple):
    """Points in x that keep the past: the fixed grid, n + 2 points, and np - n - 2 places for past edges."""

    x: FloatArray  # (np,)
    obstacle: FloatArray  # (np,), H
    order: IntArray  # (np,), the numbers of the points by their x
    filled: IntArray  # (1,), number of points so far
    bent: BoolArray  # (np,), whether the past bends at a point: interpolation does not cross it
    edge: IntArray  # (1,), number of the point at the edge of the contact; -1 without one
    near: IntArray  # (4,), the places that an interpolation takes


class MarchSurface(NamedTuple):
    """Stress and past at the points."""

    chi: FloatArray  # (np,), continued beyond a
    sunk: FloatArray  # (np,), D*chi
    memory: FloatArray  # (nb, np), in the contact relaxing variables, outside of it retarded ones


class MarchState(NamedTuple):
    """State of a run between two steps."""

    points: Points
    surface: MarchSurface
    X: FloatArray  # (nq,), cosine transform of chi
    zeta: FloatArray  # (nm, nq), internal variables of C
    marks: FloatArray  # radii where the slope of chi may jump: knots of the profile, and _MARKS of the edge


class Weights(NamedTuple):
    """Of variables that follow a quantity y, which is linear over a time h.

    A variable becomes fade old + before y(0) + after y(h). It loses int (y - variable)^2/T dt, with
    the factors dd, dc and cc of d^2, d c and c^2 for d = y(0) - old and c = y(h) - y(0).
    """

    fade: FloatArray
    before: FloatArray
    after: FloatArray
    dd: FloatArray
    dc: FloatArray
    cc: FloatArray


class MarchStep(NamedTuple):
    """A step of one length."""

    near: Weights  # (nb,), of relaxing variables and the displacement
    part: Weights  # (nb,), of a part of the step
    free: FloatArray  # (nb,), part of retarded variables that a free surface keeps
    far: Weights  # (nm, nq), of C and X
    effective: FloatArray  # (nq,), C of the step
    table: FloatArray  # (2 n + 3,), kernel of the step: (1/pi) int effective cos(q z) dq
    local_table: FloatArray  # (2 n + 3,), kernel of what C lacks of D: (1/pi) int share cos(q z) dq


class MarchArrays(NamedTuple):
    """Arrays of one solution."""

    x: FloatArray  # nodes
    root: FloatArray  # roots of their weights
    local: FloatArray  # D at the nodes
    matrix: FloatArray
    unit: FloatArray  # right-hand side, then solution, of a unit depth; at last the weights times chi
    rest: FloatArray  # right-hand side, then solution, of all else
    edges: FloatArray  # ends of the parts
    past: FloatArray  # (np,), part of D*chi at the end of the step that the past leaves
    far_past: FloatArray  # (n + 2,), and the part of the integral of C
    transform: FloatArray  # (nq,)
    spectrum: FloatArray  # (nq,)
    far: FloatArray  # (n + 2,)
    variables: FloatArray  # (nb,)
    free: FloatArray  # (nb,)


class MarchRun(NamedTuple):
    """The parts of a run."""

    body: Compliance
    branches: Branches
    profile: Revolution
    nodes: MarchNodes
    drive: MarchDrive
    state: MarchState
    step: MarchStep
    work: MarchArrays
    stop: float  # largest radius: the rim of the indenter, or the reach of the nodes
    covered: FloatArray  # (1,), the largest contact radius so far
    share: FloatArray  # (nq,), part of D that C lacks: 1, or 0 in the node of a spring
    trials: IntArray  # (1,), number of trial edges


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
    release: float  # energy release rate at the edge, where it moves
    rests: bool  # whether the edge rests, between healing and receding


class Marched(NamedTuple):
    """Columns of a run, one value a time, and fields at its snapshots."""

    force: FloatArray
    depth: FloatArray
    radius: FloatArray
    stored: FloatArray
    dissipated: FloatArray
    parted: FloatArray  # energy that the edge has taken, where it recedes, less that of healing
    lost: FloatArray  # the time in the step at which a contact with adhesion is lost, else NaN
    last_force: FloatArray  # the force before it
    rise: FloatArray  # largest increase of chi between grid points in x: 0 where p >= 0 and gap >= 0 for sure
    chi: FloatArray  # (snapshots, n + 2)
    local: FloatArray  # (snapshots, n + 2), D*chi
    spectrum: FloatArray  # (snapshots, nq), C*X
    solutions: int
    status: int
    stopped: int  # the step at which it ended


@kernel(inner=True, borrows=True)
def _linear_weights(h: float, T: float) -> tuple[float, float, float]:
    """Weights of the old value, chi(0) and chi(h), for chi linear over the step."""
    z = h / T
    if z < _SMALL:
        return 1 - z + z * z / 2, z / 2 - z * z / 3, z / 2 - z * z / 6
    m = -math.expm1(-z)
    f = m / z
    return 1 - m, f - 1 + m, 1 - f


@kernel(inner=True, borrows=True)
def _loss_weights(z: float, fade: float, after: float) -> tuple[float, float, float]:
    """Return the factors of loss in `Weights` for z = h/T, with fade and after of `_linear_weights`."""
    if z < _GENTLE:
        # Simpson's rule, from chi - eta = fade y + mean c at the middle and the end.
        end, half = 1 - after, math.sqrt(fade)
        mean = end / (1 + half)
        yy = 1 + 4 * fade + fade**2
        return z / 6 * yy, z / 3 * (4 * half * mean + fade * end), z / 6 * (4 * mean**2 + end**2)
    once = 1 - fade
    twice = once * (1 - once / 2)
    return twice, 2 * (once - twice) / z, (z - 2 * once + twice) / (z * z)


class EdgeMotion(NamedTuple):
    """A moving edge: the coordinate H + slope x, in which it moves evenly through a step, at either end."""

    slope: float
    small: float
    large: float


@kernel(inner=True, borrows=True)
def _sweep(profile: Revolution, small: float, large: float) -> EdgeMotion:
    """Return how the edge moves between two radii; a flat end comes into contact at once."""
    slope = _FRONT if small > 0 else 0.0
    H_small = abel_transform(profile, small) + slope * small
    return EdgeMotion(slope, H_small, abel_transform(profile, large) + slope * large)


@kernel(inner=True, borrows=True)
def _swept(sweep: EdgeMotion, x: float, H: float) -> float:
    """Part of the step for which a growing contact has covered x, or a shrinking one will."""
    if sweep.large == sweep.small:
        return 1.0
    part = (sweep.large - H - sweep.slope * x) / (sweep.large - sweep.small)
    return float(min(max(part, 0.0), 1.0))


@kernel(inner=True, borrows=True)
def _lagrange(y: float) -> tuple[float, float, float, float]:
    """Weights of the values at -1, 0, 1 and 2 for the value at y."""
    left, right = (y + 1) * y / 2, (y - 1) * (y - 2) / 2
    return -y * right / 3, (y + 1) * right, -left * (y - 2), left * (y - 1) / 3


@kernel(inner=True, borrows=True)
def _cubic(f: FloatArray, s: float) -> float:
    """Value at s grid spacings, by four points, of an even function."""
    i = int(s)
    a, b, c, d = _lagrange(s - i)
    value: float = a * f[abs(i - 1)] + b * f[i] + c * f[i + 1] + d * f[i + 2]
    return value


@kernel(inner=True, borrows=True)
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


@kernel(inner=True, borrows=True)
def _position(points: Points, place: int) -> float:
    """Return x at a place in the order; places below 0 are the mirror images of points."""
    x = points.x[points.order[abs(place)]]
    return float(x if place >= 0 else -x)


@kernel(inner=True, borrows=True)
def _further(points: Points, place: int, way: int, apart: float) -> int:
    """Return the next place that is so far apart; the same place where the past bends before it."""
    at = place
    while abs(at) < points.filled[0] - 1 and not points.bent[points.order[abs(at)]]:
        at += way
        if abs(_position(points, at) - _position(points, place)) >= apart:
            return at
    return place


@kernel(inner=True, borrows=True)
def _at(x: float, f: FloatArray, points: Points) -> float:
    """Value at x of an even function, by up to four points between which it does not bend.

    They are not closer to each other than half of the cell around x.
    """
    low = _place(points, x)
    high, n, near = low + 1, 2, points.near
    near[0], near[1] = low, high
    apart = (_position(points, high) - _position(points, low)) / 2
    for _ in range(3):
        new = high if n == 4 else _further(points, high, 1, apart)
        if new != high:
            high = near[n] = new
            n += 1
        new = low if n == 4 else _further(points, low, -1, apart)
        if new != low:
            low = near[n] = new
            n += 1
    edge, value = points.edge[0], 0.0
    for i in range(n):
        y, weight = _position(points, near[i]), 1.0
        for j in range(n):
            if j != i:
                z = _position(points, near[j])
                weight *= (x - z) / (y - z)
        number = points.order[abs(near[i])]
        if number == edge and x < y:
            number = -1  # its values of the inside
        value += weight * f[number]
    return value


@kernel(inner=True, borrows=True)
def _add_point(x: float, run: MarchRun) -> int:
    """Make x a point, with the past between its neighbours, unless there is one; return its number."""
    points, surface, work = run.state.points, run.state.surface, run.work
    low, new = _place(points, x), points.filled[0]
    for place in (low, low + 1):
        if abs(_position(points, place) - x) <= _ONE_POINT * points.x[1]:
            return int(points.order[place])
    if new >= points.x.size - 1:  # no place is left; the steps have more than they need
        return int(points.order[low])
    surface.chi[new], surface.sunk[new] = _at(x, surface.chi, points), _at(x, surface.sunk, points)
    work.past[new] = _at(x, work.past, points)
    for k in range(run.body.local_times.size):
        surface.memory[k, new] = _at(x, surface.memory[k], points)
    points.x[new], points.obstacle[new] = x, abel_transform(run.profile, x)
    for i in range(new, low + 1, -1):
        points.order[i] = points.order[i - 1]
    points.order[low + 1] = new
    points.filled[0] = new + 1
    return int(new)


@kernel(reorder=True, inner=True, borrows=True)
def _transform(n: int, nodes: MarchNodes, work: MarchArrays) -> None:
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


@kernel(reorder=True, inner=True, borrows=True)
def _multiply(matrix: FloatArray, vector: FloatArray, out: FloatArray) -> None:
    """Out = matrix vector, for as many rows as out has."""
    for i in range(out.size):
        s = 0.0
        for j in range(vector.size):
            s += matrix[i, j] * vector[j]
        out[i] = s


@kernel(reorder=True, inner=True, borrows=True)
def _solve_linear(M: FloatArray, b: FloatArray, c: FloatArray, n: int) -> bool:
    """Solve M x = b and M x = c in place by Gauss's elimination; return False if a pivot is not positive."""
    for j in range(n):
        if M[j, j] <= 0:
            return False
        for i in range(j + 1, n):
            factor = M[i, j] / M[j, j]
            for k in range(j + 1, n):
                M[i, k] -= factor * M[j, k]
            b[i] -= factor * b[j]
            c[i] -= factor * c[j]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= M[i, k] * b[k]
            c[i] -= M[i, k] * c[k]
        b[i] /= M[i, i]
        c[i] /= M[i, i]
    return True


@kernel(inner=True, borrows=True)
def _set_weights(h: float, branches: Branches, weights: Weights) -> float:
    """Set the weights of a surface in contact for a time h; return D = displacement/chi, from rest."""
    modulus = branches.glassy
    for r in range(branches.times.size):
        T = branches.times[r]
        fade, before, after = _linear_weights(h, T)
        weights.fade[r], weights.before[r], weights.after[r] = fade, before, after
        weights.dd[r], weights.dc[r], weights.cc[r] = _loss_weights(h / T, fade, after)
        modulus -= branches.moduli[r] * after
    return 1 / modulus


@kernel(inner=True, borrows=True)
def _jump(x: float, release: float, run: MarchRun) -> float:
    """Sudden change of the displacement, where the edge of an energy release rate passes x."""
    return math.sqrt(math.pi * x * release * run.body.local)


@kernel(inner=True, borrows=True)
def _covered(x: float, h: float, part: float, run: MarchRun) -> tuple[float, float]:
    """D of a point that the contact covers in the last part of a step, and the part of the past in D*chi."""
    body, branches, state, weights, past = run.body, run.branches, run.state, run.step.part, 0.0
    D = _set_weights(part * h, branches, weights)
    jump = _jump(x, run.drive.law.healing, run)
    for r in range(branches.times.size):
        past -= branches.moduli[r] * weights.before[r] * jump
    if run.covered[0] <= x:
        return D, past * D
    for k in range(body.local_times.size):
        rest = math.exp(-(1 - part) * h / body.local_times[k])
        retarded = rest * _at(x, state.surface.memory[k], state.points)
        for r in range(branches.times.size):
            kept = weights.fade[r] * branches.of_retarded[r, k] + weights.before[r] * body.local_modes[k]
            past += branches.moduli[r] * kept * retarded
    return D, past * D


@kernel(inner=True, borrows=True)
def _set_step(h: float, run: MarchRun) -> float:
    """Set the weights of a step of length h; return the compliance D of the step."""
    body, step, work = run.body, run.step, run.work
    D = _set_weights(h, run.branches, step.near)
    for k in range(body.local_times.size):
        step.free[k] = math.exp(-h / body.local_times[k])
    for j in range(body.q.size):  # array expressions would take seconds to compile
        step.effective[j] = body.instant[j] + run.share[j] * (body.local - D)
    coupled = body.times.shape[0] - body.local_times.size
    for m in range(body.times.shape[0]):
        last, linear, loss = -1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for j in range(body.q.size):
            if body.times[m, j] != last:  # many are equal: the times of the surface's material
                last = body.times[m, j]
                linear = _linear_weights(h, last)
                loss = _loss_weights(h / last, linear[0], linear[2])
            step.far.fade[m, j], step.far.before[m, j], step.far.after[m, j] = linear
            step.far.dd[m, j], step.far.dc[m, j], step.far.cc[m, j] = loss
            if m < coupled:
                step.effective[j] += body.modes[m, j] * linear[2]
    for j in range(body.q.size):
        work.transform[j] = body.weights[j] * step.effective[j] / math.pi
    if body.q.size:
        _multiply(run.nodes.cosines, work.transform, step.table)
    return D


@kernel(inner=True, borrows=True)
def _inside(x: float, a: float, stop: float) -> bool:
    """Whether a contact of radius a covers x; at and beyond a rim chi is continued."""
    return a > 0 and (x < a or a >= stop)


@kernel(inner=True, borrows=True)
def _place_nodes(a: float, nodes: MarchNodes, state: MarchState, work: MarchArrays) -> int:
    """Put Gauss nodes into [0, a], in parts that end where the contact has turned; return their number."""
    parts = 1
    work.edges[0] = 0.0
    for _ in range(state.marks.size):
        end = (1 - _APART) * a
        for m in state.marks:
            if work.edges[parts - 1] + _APART * a < m < end:
                end = m
        if end < (1 - _APART) * a:
            work.edges[parts] = end
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


@kernel(inner=True, borrows=True)
def _transform_of(f: FloatArray, a: float, run: MarchRun) -> None:
    """Cosine transform of an even function at the points, which may jump at the edge a of the contact."""
    nodes, work, covered = run.nodes, run.work, run.covered[0]
    n = _place_nodes(a, nodes, run.state, work) if a > 0 and run.body.local_times.size else 0
    if covered > a and run.body.local_times.size:
        # The nodes of a part resolve the cosines over half of the reach.
        parts = 2 if covered - a > 0.5 * nodes.reach and nodes.part.size > _FEW else 1
        width = (covered - a) / parts
        for k in range(parts):
            for i in range(nodes.part.size):
                work.x[n] = a + width * (k + nodes.part[i])
                work.root[n] = math.sqrt(width * nodes.part_weights[i])
                n += 1
    for i in range(n):
        work.unit[i] = work.root[i] ** 2 * _at(work.x[i], f, run.state.points)
    _transform(n, nodes, work)


@kernel(inner=True, borrows=True)
def _kept_in_contact(i: int, weights: Weights, moduli: FloatArray, surface: MarchSurface) -> float:
    """Part of chi, with the sign changed, that the past of a point leaves at the end of a time in contact."""
    s = 0.0
    for r in range(moduli.size):
        s += moduli[r] * (weights.fade[r] * surface.memory[r, i] + weights.before[r] * surface.sunk[i])
    return s


@kernel(inner=True, borrows=True)
def _find_past(a_old: float, D: float, run: MarchRun) -> None:
    """Find the part of the past at the end of the step: of D where the contact stays or stays away; of C."""
    body, state, step, work, moduli = run.body, run.state, run.step, run.work, run.branches.moduli
    for i in range(state.points.filled[0]):
        s = 0.0
        if _inside(state.points.x[i], a_old, run.stop):
            s = D * _kept_in_contact(i, step.near, moduli, state.surface)
        else:
            for k in range(body.local_times.size):
                s += body.local_modes[k] * step.free[k] * state.surface.memory[k, i]
        work.past[i] = s
    work.past[-1] = D * _kept_in_contact(-1, step.near, moduli, state.surface)
    _transform_of(work.past, a_old, run)
    for j in range(body.q.size):
        s = -run.share[j] * work.transform[j]
        for m in range(body.times.shape[0] - body.local_times.size):
            kept = step.far.fade[m, j] * state.zeta[m, j] + step.far.before[m, j] * state.X[j]
            s += body.modes[m, j] * kept
        work.transform[j] = s * body.weights[j] * (2 / math.pi)
    if body.q.size:
        _multiply(run.nodes.cosines, work.transform, work.far_past)


@kernel(inner=True, borrows=True)
def _apex_locally(h: float, run: MarchRun, released: bool) -> float:
    """Part of D in `_apex`."""
    if released:
        D = _set_weights(h, run.branches, run.step.part)
        return D * _kept_in_contact(0, run.step.part, run.branches.moduli, run.state.surface)
    body, s = run.body, 0.0
    for k in range(body.local_times.size):
        s += body.local_modes[k] * math.exp(-h / body.local_times[k]) * run.state.surface.memory[k, 0]
    return s


@kernel(inner=True, borrows=True)
def _apex(h: float, run: MarchRun, released: bool) -> float:
    """Displacement of the surface at x = 0 after a time h without contact, or in which chi falls to 0."""
    body, state, s = run.body, run.state, _apex_locally(h, run, released)
    far = 0.0
    for j in range(body.q.size):
        for m in range(body.times.shape[0]):
            fade, before, _ = _linear_weights(h, body.times[m, j])
            value = fade * state.zeta[m, j] + (before * state.X[j] if released else 0.0)
            far += body.modes[m, j] * value * body.weights[j]
    return s + far * (2 / math.pi)


@kernel(inner=True, borrows=True)
def _event(h: float, start: float, end: float, by_force: bool, run: MarchRun, released: bool) -> float:
    """Return the part of a step after which contact begins, or with `released` ends.

    The depth grows linearly from `start` to `end`. Contact begins where it reaches the displacement of the
    free surface, and ends where it falls below the displacement of a surface from which chi has vanished.
    """
    low, high = 0.0, 1.0
    sign = -1.0 if released else 1.0
    if by_force:
        return min(max(start / (start - end), 0.0), 1.0) if start != end else 0.0
    gap_low = sign * (start - _apex(0.0, run, False)) if not released else -1.0
    gap_high = sign * (end - _apex(h, run, released))
    for _ in range(_MOST_ITERATIONS):
        part = 0.5 * (low + high)
        if gap_low < 0 < gap_high and high - low < 0.2:
            part = low + (high - low) * gap_low / (gap_low - gap_high)
            part = min(max(part, low + 0.02 * (high - low)), high - 0.02 * (high - low))
        gap = sign * (start + part * (end - start) - _apex(part * h, run, released))
        if gap < 0:
            low, gap_low = part, gap
        else:
            high, gap_high = part, gap
        if high - low < 1e-12:
            break
    return high


@kernel(inner=True, borrows=True)
def _kernel(table: FloatArray, x: float, y: float, spacing: float) -> float:
    """Kernel of a table between x and y, and between x and -y."""
    return _cubic(table, abs(x - y) / spacing) + _cubic(table, (x + y) / spacing)


@kernel(inner=True, borrows=True)
def _fill(n: int, D: float, run: MarchRun) -> None:
    """Fill the matrix with C and D of the step, and with the other D of nodes that the edge sweeps."""
    work, step, spacing = run.work, run.step, run.nodes.spacing
    x, root, matrix = work.x, work.root, work.matrix
    for i in range(n):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = root[i] * root[j] * _kernel(step.table, x[i], x[j], spacing)
    for j in range(n):
        matrix[j, j] += work.local[j]
        for i in range(n if work.local[j] != D else 0):
            lacking = root[i] * root[j] * _kernel(step.local_table, x[i], x[j], spacing)
            matrix[i, j] += (D - work.local[j]) * lacking


@kernel(inner=True, borrows=True)
def _solve(a: float, a_old: float, h: float, D: float, run: MarchRun) -> Trial:
    """Solve the step for a trial radius."""
    body, profile, nodes, state, step, work = run.body, run.profile, run.nodes, run.state, run.step, run.work
    n = _place_nodes(a, nodes, state, work)
    root, coupled = work.root, body.q.size > 0
    sweep = _sweep(profile, a_old, a)
    for i in range(n):
        x = work.x[i]
        H = abel_transform(profile, x)
        work.local[i], past = D, _cubic(work.far_past, x / nodes.spacing)
        if x < a_old:
            past += _at(x, work.past, state.points) if body.local_times.size else 0.0
        elif body.local_times.size:
            work.local[i], before = _covered(x, h, _swept(sweep, x, H), run)
            past += before
        work.unit[i] = root[i]
        work.rest[i] = -(H + past) * root[i]
        if not coupled:
            work.unit[i] /= work.local[i]
            work.rest[i] /= work.local[i]
    if coupled:
        _fill(n, D, run)
        if not _solve_linear(work.matrix, work.unit, work.rest, n):
            return Trial(0.0, 0.0, 0.0, 0.0, -1)
    past = _cubic(work.far_past, a / nodes.spacing)
    past += _at(a, work.past, state.points) if body.local_times.size else 0.0
    edge, rest, unit, other = 1.0, -abel_transform(profile, a) - past, 0.0, 0.0
    for i in range(n):
        if coupled:
            k0 = _kernel(step.table, a, work.x[i], nodes.spacing)
            if work.local[i] != D:
                k0 += (D - work.local[i]) * _kernel(step.local_table, a, work.x[i], nodes.spacing)
            edge -= root[i] * k0 * work.unit[i]
            rest -= root[i] * k0 * work.rest[i]
        unit += 4 * root[i] * work.unit[i]
        other += 4 * root[i] * work.rest[i]
    return Trial(edge, rest, unit, other, n)


@kernel(inner=True, borrows=True)
def _find_radius(
    h: float, target: float, by_force: bool, guess: float, a_old: float, D: float, slope: float, run: MarchRun
) -> Radius:
    """Find the contact without adhesion at the end of a step whose depth or force is `target`.

    The error of a secant step is of the order of the product of the last two. Force, depth and chi are
    stationary in the radius: at the last trial but one they have its squared error.
    """
    drive, stop = run.drive, run.stop
    low, high, a = 0.0, stop, guess
    last_a, last_r, last_error = -1.0, 0.0, 1.0
    for trial in range(1, _MOST_ITERATIONS):
        edge, rest, unit, other, n = _solve(a, a_old, h, D, run)
        if n < 0:
            return Radius(0.0, 0.0, 0.0, 0.0, 0, trial, NOT_CONVERGED, 0.0, False)
        depth = (target - other) / unit if by_force else target
        r = depth * edge + rest
        force = depth * unit + other
        scale = max(abs(depth), abs(rest))
        error = abs(r) / scale if r else 0.0
        if a >= stop and r >= 0:
            left = stop < run.profile.rim and error > drive.tolerance
            return Radius(stop, force, depth, 0.0, n, trial, LEFT_GRID if left else COMPLETE, 0.0, False)
        if error <= drive.tolerance or high - low < _SAME_RADIUS * high:
            return Radius(a, force, depth, slope, n, trial, COMPLETE, 0.0, False)
        if last_a >= 0 and a != last_a:
            slope = (r - last_r) / (a - last_a)
        if r > 0:
            low = a
        else:
            high = a
        if last_a < 0 and slope >= 0:
            slope = -2 * scale / a
        new = a - r / slope if slope < 0 else stop if r > 0 else 0.0
        if error * max(error, last_error) < drive.tolerance and low < new < high:
            return Radius(new, force, depth, slope, n, trial, COMPLETE, 0.0, False)
        last_a, last_r, last_error = a, r, error
        if new >= stop and high == stop:
            new = stop
        elif not low < new < high or trial % 6 == 0:
            new = 0.5 * (low + high)
        a = new
    return Radius(0.0, 0.0, 0.0, 0.0, 0, _MOST_ITERATIONS, NOT_CONVERGED, 0.0, False)


class EdgeBefore(NamedTuple):
    """The edge at the begin of a step, and its mean speed in the time `since` an earlier moment, or 0."""

    a: float
    rate: float
    since: float


class EdgeTask(NamedTuple):
    """A step whose edge is wanted."""

    h: float
    target: float  # prescribed depth or force
    by_force: bool
    before: EdgeBefore
    D: float


class Balance(NamedTuple):
    """Balance of the energy at a trial edge: the contact grows where the excess is positive."""

    a: float
    excess: float  # of the displacement at the edge
    scale: float
    force: float
    depth: float
    release: float
    nodes: int  # -1 where the matrix is not positive definite


@kernel(inner=True, borrows=True)
def _balance(a: float, task: EdgeTask, run: MarchRun) -> Balance:
    """Compare the jump of the displacement, or chi behind the edge, with the law of the edge.

    An advancing edge meets a surface without chi: the displacement jumps by J0 chi. Behind a receding edge
    chi has followed the past of the contact. Its speed at the end of the step is that of a parabola.
    """
    law, local, before, h = run.drive.law, run.body.local, task.before, task.h
    edge, rest, unit, other, n = _solve(a, before.a, h, task.D, run)
    run.trials[0] += 1
    depth = (task.target - other) / unit if task.by_force and n > 0 else task.target
    release, compliance = law.healing, local
    if a < before.a or before.a >= run.stop:
        share = h / (h + before.since) if before.since > 0 else 0.0
        speed = (1 + share) * (before.a - a) / h + share * before.rate
        release, compliance = law.work, task.D
        if speed > 0 and law.speed < math.inf:
            release *= 1 + (speed / law.speed) ** law.exponent
    jump = compliance * math.sqrt(math.pi * a * release / local)
    scale = max(abs(depth), abs(rest), jump)
    return Balance(a, depth * edge + rest + jump, scale, depth * unit + other, depth, release, n)


@kernel(inner=True, borrows=True)
def _contact(at: Balance, status: int, rests: bool) -> Radius:
    """Return the contact of a trial."""
    status = status if at.nodes >= 0 else NOT_CONVERGED
    return Radius(at.a, at.force, at.depth, 0.0, at.nodes, 0, status, at.release, rests)


@kernel(inner=True, borrows=True)
def _highest(left: float, right: float, task: EdgeTask, run: MarchRun) -> Balance:
    """Search an interval for a positive excess by golden sections; return the last trial."""
    width = right - left
    x, y = right - _GOLDEN * width, left + _GOLDEN * width
    at_x = _balance(x, task, run)
    at_y = at_x if at_x.excess > 0 else _balance(y, task, run)
    for _ in range(_GOLDEN_STEPS if run.drive.located == 1 else _GOLDEN_STEPS // 2):
        if max(at_x.excess, at_y.excess) > 0 or min(at_x.nodes, at_y.nodes) < 0:
            break
        if at_x.excess > at_y.excess:
            right, at_y = at_y.a, at_x
            at_x = _balance(right - _GOLDEN * (right - left), task, run)
        else:
            left, at_x = at_x.a, at_y
            at_y = _balance(left + _GOLDEN * (right - left), task, run)
    return at_x if at_x.excess > at_y.excess or at_x.nodes < 0 else at_y


@kernel(inner=True, borrows=True)
def _balanced(near: Balance, far: Balance, task: EdgeTask, run: MarchRun) -> Radius:
    """Find the edge between two trials whose excess has different signs, by regula falsi (Illinois)."""
    base, y, a, z, last, side = near.a, near.excess, far.a, far.excess, far, 0
    for _ in range(_MOST_ITERATIONS):
        narrow = abs(a - base) < _SAME_RADIUS * max(a, base)
        if narrow or abs(last.excess) <= run.drive.tolerance * last.scale:
            return _contact(last, COMPLETE, False)
        at = (a * y - base * z) / (y - z)
        if not min(a, base) < at < max(a, base):
            at = 0.5 * (a + base)
        last = _balance(at, task, run)
        if last.nodes < 0:
            break
        if (last.excess > 0) == (z > 0):
            a, z = at, last.excess
            y *= 0.5 if side == 1 else 1.0
            side = 1
        else:
            base, y = at, last.excess
            z *= 0.5 if side == -1 else 1.0
            side = -1
    return _contact(last, NOT_CONVERGED, False)


@kernel(inner=True, borrows=True)
def _advance_or_recede(near: Balance, guess: float, task: EdgeTask, run: MarchRun) -> Radius:
    """Find the edge beyond the trial `near`, in the direction of the sign of its excess.

    Trials go away in steps that double. A receding edge stops at the first balance; contact is lost without.
    """
    stop, begin, base = run.stop, near, near
    way, searched = 1.0 if near.excess >= 0 else -1.0, False
    falls, most = 0, _MOST_ITERATIONS if run.drive.located == 1 else _FALLS
    stride = max(abs(guess - near.a), _LEAST_STRIDE * stop)
    lost = Radius(0.0, 0.0, task.target, 0.0, 0, 0, COMPLETE, run.drive.law.work, False)
    for _ in range(_MOST_ITERATIONS):
        a = min(base.a + way * stride, stop)
        gone = a < _VANISHED * stop
        if searched and (gone or falls > most):
            break
        far = base if gone else _balance(a, task, run)
        if far.nodes < 0 or (not gone and way * far.excess <= 0):
            return _balanced(base, far, task, run) if far.nodes >= 0 else _contact(far, COMPLETE, False)
        if a >= stop:
            return _contact(far, LEFT_GRID if stop < run.profile.rim else COMPLETE, False)
        if way < 0 and not searched and (gone or far.excess < base.excess):
            # The excess has passed its largest value: it may have been positive there.
            searched = True
            peak = _highest(max(a, _VANISHED * stop), begin.a, task, run)
            if peak.nodes < 0 or peak.excess > 0:
                below = base if peak.a < base.a else begin
                return (
                    _balanced(below, peak, task, run) if peak.nodes >= 0 else _contact(peak, COMPLETE, False)
                )
            if gone:
                break
        falls = falls + 1 if far.excess < base.excess else 0
        begin, base = base, far
        stride *= 2
    return lost


@kernel(inner=True, borrows=True)
def _find_edge(guess: float, task: EdgeTask, run: MarchRun) -> Radius:
    """Find the contact with adhesion at the end of a step: it advances, rests, recedes, or is lost."""
    a_old = task.before.a
    at = Balance(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
    if a_old > 0:
        if a_old < run.stop:
            at = _balance(a_old * (1 + _BESIDE), task, run)
        if at.excess <= 0:
            at = _balance(run.stop if a_old >= run.stop else a_old * (1 - _BESIDE), task, run)
            if at.excess >= 0 or at.nodes < 0:
                return Radius(
                    a_old, at.force, at.depth, 0.0, at.nodes, 0,
                    COMPLETE if at.nodes >= 0 else NOT_CONVERGED, at.release, True,
                )  # fmt: skip
    return _advance_or_recede(at, guess, task, run)


@kernel(inner=True, borrows=True)
def _change_form(i: int, to: FloatArray, memory: FloatArray, scratch: FloatArray) -> None:
    """Change the internal variables of a point from relaxing to retarded ones, or back."""
    for k in range(scratch.size):
        scratch[k] = 0.0
        for r in range(scratch.size):
            scratch[k] += to[k, r] * memory[r, i]
    for k in range(scratch.size):
        memory[k, i] = scratch[k]


@kernel(inner=True, borrows=True)
def _press(i: int, end: float, weights: Weights, branches: Branches, surface: MarchSurface) -> float:
    """Move a point in contact to a displacement; return the energy that is lost."""
    begin, chi, lost = surface.sunk[i], branches.glassy * end, 0.0
    for r in range(branches.times.size):
        m, G = surface.memory[r, i], branches.moduli[r]
        d, c = begin - m, end - begin
        lost += G * (weights.dd[r] * d * d + weights.dc[r] * d * c + weights.cc[r] * c * c)
        m = weights.fade[r] * m + weights.before[r] * begin + weights.after[r] * end
        surface.memory[r, i] = m
        chi -= G * m
    surface.sunk[i], surface.chi[i] = end, chi
    return lost


@kernel(inner=True, borrows=True)
def _rest(i: int, free: FloatArray, modes: FloatArray, surface: MarchSurface) -> float:
    """Leave a point free, so that its variables fade; return the energy that is lost."""
    lost, sunk = 0.0, 0.0
    for k in range(free.size):
        old = surface.memory[k, i]
        surface.memory[k, i] = free[k] * old
        lost += modes[k] * old * old / 2 * (1 - free[k] * free[k])
        sunk += modes[k] * free[k] * old
    surface.sunk[i] = sunk
    return lost


@kernel(inner=True, borrows=True)
def _pass(i: int, end: float, h: float, part: float, was_inside: bool, jump: float, run: MarchRun) -> float:
    """Advance a point that the edge passes, in contact for a part of the step; return the energy lost.

    Its displacement jumps when the edge passes; the internal variables do not.
    """
    branches, weights, surface, scratch = run.branches, run.step.part, run.state.surface, run.work.variables
    times, modes, free, lost = run.body.local_times, run.body.local_modes, run.work.free, 0.0
    D = _set_weights(part * h, branches, weights)
    for k in range(times.size):
        free[k] = math.exp(-(1 - part) * h / times[k])
    if was_inside:  # to the displacement at which chi is that of the edge
        kept = _kept_in_contact(i, weights, branches.moduli, surface)
        lost += _press(i, D * (kept - jump / run.body.local), weights, branches, surface)
        _change_form(i, branches.to_retarded, surface.memory, scratch)
        return lost + _rest(i, free, modes, surface)
    lost += _rest(i, free, modes, surface)
    _change_form(i, branches.of_retarded, surface.memory, scratch)
    surface.sunk[i] -= jump
    return lost + _press(i, end, weights, branches, surface)


@kernel(inner=True, borrows=True)
def _under(i: int, depth: float, run: MarchRun) -> float:
    """Displacement D*chi of a point under the indenter at the end of the step."""
    work, points = run.work, run.state.points
    if i < work.far.size:
        return float(depth - points.obstacle[i] - work.far_past[i] - work.far[i])
    s = points.x[i] / run.nodes.spacing
    return float(depth - points.obstacle[i] - _cubic(work.far_past, s) - _cubic(work.far, s))


@kernel(inner=True, borrows=True)
def _close(h: float, contact: Radius, a_old: float, D: float, run: MarchRun) -> float:
    """Advance the state over a step that is solved; return the energy dissipated in it."""
    body, nodes, state, step, work = run.body, run.nodes, run.state, run.step, run.work
    surface = state.surface
    a, depth, nm, far = contact.a, contact.depth, body.times.shape[0], run.step.far
    n = contact.nodes if a > 0 else 0
    for i in range(n):
        work.unit[i] = work.root[i] * (depth * work.unit[i] + work.rest[i])
    lost = 0.0
    _transform(n, nodes, work)
    for j in range(body.q.size):
        work.spectrum[j] = work.transform[j]
    for i in range(n):
        work.rest[i], work.unit[i] = work.unit[i], (work.local[i] - D) * work.unit[i]
    _transform(n, nodes, work)
    for i in range(n):
        work.unit[i] = work.rest[i]
    for j in range(body.q.size):
        s, part = work.spectrum[j], 0.0
        for m in range(nm):
            d, c = state.X[j] - state.zeta[m, j], s - state.X[j]
            quadratic = far.dd[m, j] * d * d + far.dc[m, j] * d * c + far.cc[m, j] * c * c
            part += body.modes[m, j] * quadratic
            state.zeta[m, j] = (
                far.fade[m, j] * state.zeta[m, j] + far.before[m, j] * state.X[j] + far.after[m, j] * s
            )
        lost += part * body.weights[j] * (2 / math.pi)
        state.X[j] = s
        both = step.effective[j] * s - run.share[j] * work.transform[j]
        work.transform[j] = both * body.weights[j] * (2 / math.pi)
    if body.q.size:
        _multiply(nodes.cosines, work.transform, work.far)
    sweep = _sweep(run.profile, min(a, a_old), max(a, a_old))
    fixed = work.far.size
    for i in range(state.points.filled[0]):
        x, H = state.points.x[i], state.points.obstacle[i]
        inside, was_inside = _inside(x, a, run.stop), _inside(x, a_old, run.stop)
        end = _under(i, depth, run)
        continued = (end - work.past[i]) / (D if was_inside else body.local)
        if inside != was_inside:
            jump = _jump(x, contact.release, run)
            change = _pass(i, end, h, _swept(sweep, x, H), was_inside, jump, run)
        elif inside:
            change = _press(i, end, step.near, run.branches, surface)
        else:
            change = _rest(i, step.free, body.local_modes, surface)
        if not inside:
            surface.chi[i] = continued
        if i < fixed - 2:
            lost += nodes.spacing * (0.5 if i in (0, fixed - 3) else 1.0) * change
    return 4 * lost


@kernel(inner=True, borrows=True)
def _stored(contact: Radius, run: MarchRun) -> float:
    """Elastic energy of the body."""
    body, branches, nodes, state, work = run.body, run.branches, run.nodes, run.state, run.work
    s, nb = 0.0, body.local_times.size
    for i in range(contact.nodes if contact.a > 0 else 0):
        s += body.local * (work.unit[i] / work.root[i]) ** 2
    for i in range(work.far.size - 2):
        weight = nodes.spacing * (0.5 if i in (0, work.far.size - 3) else 1.0)
        inside = _inside(state.points.x[i], contact.a, run.stop)
        for k in range(nb):
            retarded = 0.0 if inside else state.surface.memory[k, i]
            for r in range(nb if inside else 0):
                retarded += branches.to_retarded[k, r] * state.surface.memory[r, i]
            s += weight * body.local_modes[k] * retarded**2
    for j in range(body.q.size):
        part = body.instant[j] * state.X[j] ** 2
        for m in range(body.times.shape[0]):
            part += body.modes[m, j] * state.zeta[m, j] ** 2
        s += part * body.weights[j] * (2 / math.pi)
    return 2 * s


@kernel(inner=True, borrows=True)
def _remember(marks: FloatArray, a: float) -> None:
    """Put the radius a in place of a close one, or else of the oldest; the last is the latest."""
    first = oldest = marks.size - _MARKS
    for i in range(first, marks.size):
        if abs(marks[i] - a) < _APART * a:
            oldest = i
    for i in range(oldest, marks.size - 1):
        marks[i] = marks[i + 1]
    marks[-1] = a


@kernel(inner=True, borrows=True)
def _rise(a: float, run: MarchRun) -> float:
    """Largest increase of chi inside the contact, and largest chi outside: with neither p, gap >= 0."""
    largest, chi, spacing = 0.0, run.state.surface.chi, run.nodes.spacing
    for i in range(run.work.far.size - 2):
        x = i * spacing
        if x + spacing <= a:
            largest = max(largest, chi[i + 1] - chi[i])
        elif x > a and a < run.stop:
            largest = max(largest, chi[i])
    return largest


@kernel(inner=True)
def _empty_weights(shape: Any) -> Weights:
    """Return weights without values."""
    zeros = np.zeros(shape)
    return Weights(zeros, zeros.copy(), zeros.copy(), zeros.copy(), zeros.copy(), zeros.copy())


@kernel(inner=True)
def _begin(
    body: Compliance, branches: Branches, profile: Revolution, nodes: MarchNodes, drive: MarchDrive
) -> MarchRun:
    """Return a run of a body at rest."""
    size, nq = nodes.cosines.shape[0] // 2 + 1, body.q.size
    nb, nm = body.local_times.size, body.times.shape[0]
    knots = profile.knots.size - 1 if profile.knots.size <= _MARKS else 0  # those of a table bend little
    places = size
    if nb:
        each_step, more = (2, _PLACES) if drive.law.work > 0 else (1, 0)
        places += each_step * drive.time.size + more + _CLOSING + 1  # the last: the inside of the edge
        for is_breakpoint in drive.breakpoints:
            places += 2 * _CLOSING * is_breakpoint
    points = Points(
        np.zeros(places), np.zeros(places), np.arange(places), np.array([size]), np.zeros(places, np.bool_),
        np.array([-1]), np.zeros(4, np.int64),
    )  # fmt: skip
    for i in range(size):
        points.x[i] = i * nodes.spacing
        points.obstacle[i] = abel_transform(profile, points.x[i])
    points.bent[0] = True  # under a cone
    state = MarchState(
        points, MarchSurface(np.zeros(places), np.zeros(places), np.zeros((nb, places))),
        np.zeros(nq), np.zeros((nm, nq)), np.full(knots + _MARKS, np.inf),
    )  # fmt: skip
    step = MarchStep(
        _empty_weights((nb,)), _empty_weights((nb,)), np.zeros(nb), _empty_weights((nm, nq)),
        np.zeros(nq), np.zeros(2 * size - 1), np.zeros(2 * size - 1),
    )  # fmt: skip
    for i in range(knots):
        state.marks[i] = profile.knots[i + 1]
    most = max(nodes.gauss.size, (state.marks.size + 1) * nodes.part.size) + 2 * nodes.part.size
    work = MarchArrays(
        np.zeros(most), np.zeros(most), np.zeros(most),
        np.zeros((most, most)), np.zeros(most), np.zeros(most),
        np.zeros(state.marks.size + 2), np.zeros(places), np.zeros(size),
        np.zeros(nq), np.zeros(nq), np.zeros(size),
        np.zeros(nb), np.zeros(nb),
    )  # fmt: skip
    stop, share = min(profile.rim, nodes.reach), np.ones(nq)
    for j in range(nq if nb else 0):
        share[j] = -body.modes[nm - nb, j] / body.local_modes[0]
    if nq:
        _multiply(nodes.cosines, share * body.weights / math.pi, step.local_table)
    return MarchRun(
        body,
        branches,
        profile,
        nodes,
        drive,
        state,
        step,
        work,
        stop,
        np.zeros(1),
        share,
        np.zeros(1, np.int64),
    )


@kernel(inner=True, borrows=True)
def _keep_fields(a: float, run: MarchRun, chi: FloatArray, local: FloatArray, spectrum: FloatArray) -> None:
    """Write the fields of a snapshot: chi, D*chi and C*X."""
    body, state = run.body, run.state
    for i in range(chi.size):
        chi[i] = state.surface.chi[i]
        local[i] = state.surface.sunk[i]
    _transform_of(state.surface.sunk, a, run)
    for j in range(spectrum.size):
        s = (body.instant[j] + run.share[j] * body.local) * state.X[j]
        for m in range(body.times.shape[0] - body.local_times.size):
            s += body.modes[m, j] * state.zeta[m, j]
        elastic = body.local * state.X[j] if not body.local_times.size else 0.0
        spectrum[j] = s - run.share[j] * (run.work.transform[j] + elastic)


@kernel
def march(
    body: Compliance, branches: Branches, profile: Revolution, nodes: MarchNodes, drive: MarchDrive
) -> Marched:
    """Follow an indentation of a body at rest over given times, on nodes in x for its largest contact."""
    nt, run = drive.time.size, _begin(body, branches, profile, nodes, drive)
    size, kept = run.work.far.size, 0
    for is_kept in drive.snapshots:
        kept += is_kept
    out = Marched(
        np.zeros(nt), np.zeros(nt), np.zeros(nt), np.zeros(nt), np.zeros(nt), np.zeros(nt),
        np.full(nt, np.nan), np.zeros(nt), np.zeros(nt),
        np.zeros((kept, size)), np.zeros((kept, size)), np.zeros((kept, body.q.size)), 0, COMPLETE, nt,
    )  # fmt: skip
    taken, status, stopped = _follow(run, out)
    return Marched(
        out.force, out.depth, out.radius, out.stored, out.dissipated, out.parted, out.lost, out.last_force,
        out.rise,
        out.chi, out.local, out.spectrum, taken + run.trials[0], status, stopped,
    )  # fmt: skip


@kernel(inner=True, borrows=True)
def _follow(run: MarchRun, out: Marched) -> tuple[int, int, int]:  # noqa: C901
    """Write columns and fields of the steps; return the solutions, the status, and the step at the end."""
    body, nodes, drive, nt = run.body, run.nodes, run.drive, run.drive.time.size
    state, surface, work, stop = run.state, run.state.surface, run.work, run.stop
    a_old, h_old, rate, lost, taken, snapshot = 0.0, -1.0, 0.0, 0.0, 0, 0
    bend, slope, since, status = 0.0, 0.0, 0.0, COMPLETE
    adhesive, parted, release, before_force = drive.law.work > 0, 0.0, 0.0, 0.0
    D, stopped = 0.0, nt
    # The point of the edge, -1 without one; whether the past stays bent there.
    edge, bent, stays, rested = -1, state.points.bent, False, False
    contact = Radius(0.0, 0.0, 0.0, 0.0, 0, 0, COMPLETE, 0.0, False)
    for at in range(nt):
        duration = drive.time[at] - drive.time[at - 1] if at else 1e-30 * (drive.time[-1] - drive.time[0])
        duration = max(duration, 1e-290)
        begin, by_force = drive.value[at - 1] if at else 0.0, drive.by_force[at]
        if at and by_force != drive.by_force[at - 1]:
            begin = contact.force if by_force else contact.depth
        begins = at == 0 or drive.breakpoints[at]
        done, piece, met = 0.0, 1.0, False  # part of the step behind; of the rest ahead; contact begins there
        snaps, snapped = False, False  # contact with adhesion begins at once
        bound = 1.0  # part of the step in which contact with adhesion is lost
        for _ in range(_SUBSTEPS):
            h = duration * (1 - done) * piece
            now = begin + done * (drive.value[at] - begin)
            target = now + piece * (drive.value[at] - now)
            if h != h_old:
                D, h_old = _set_step(h, run), h
            _find_past(a_old, D, run)
            free = work.past[0] + work.far_past[0]
            touches = target > 0 if by_force else target > free
            starts = touches and a_old == 0 and not met and at > 0
            ends = not touches and a_old > 0 and not adhesive
            if piece < 1:
                touches = snaps or (adhesive and a_old > 0)
            elif starts or ends:
                part = _event(h, now, target, by_force, run, ends)
                if _INSTANT < part < 1 - _INSTANT:
                    piece, met = part, starts
                    continue
                touches = starts and part <= _INSTANT
            if adhesive and touches and a_old == 0 and at > 0 and not snapped:
                piece, met, snaps, snapped = _SNAP, True, True, True
                continue
            apart = Radius(0.0, 0.0, free if by_force else target, 0.0, 0, 0, COMPLETE, drive.law.work, False)
            contact = apart
            if touches or (adhesive and a_old > 0):
                guess = 0.3 * stop
                if a_old > 0:
                    guess = min(stop, max(0.2 * a_old, a_old + h * (rate + bend * (h + since))))
                if adhesive:
                    before = EdgeBefore(a_old, rate, since if rate < 0 else 0.0)
                    contact = _find_edge(guess, EdgeTask(h, target, by_force, before, D), run)
                else:
                    contact = _find_radius(h, target, by_force, guess, a_old, D, slope, run)
                taken += contact.solutions
                slope, status = contact.slope, contact.status
                if status != COMPLETE:
                    break
                if contact.a == 0:
                    contact, ahead = apart, (1 - done) * piece
                    if adhesive and a_old > 0:
                        room = surface.chi.size - state.points.filled[0] > drive.time.size - at + 4 * _CLOSING
                        if ahead > drive.located and room:
                            bound, piece = done + ahead, 0.5 * piece
                            continue
                        out.lost[at] = drive.time[at] - duration * (1 - done - ahead)
                        out.last_force[at] = before_force
                before_force = contact.force
            change = (contact.a - a_old) / h
            turned = (rate * change < 0 or (rested and not contact.rests)) and at > 1 and a_old > 0
            if turned:
                _remember(state.marks, a_old)
            new = -1
            if rested and edge >= 0 and not contact.rests:
                bent[_add_point(a_old - _TWIN * nodes.spacing, run)] = True
            if 0 < contact.a < stop and body.local_times.size:
                for k in range(1, _CLOSING + 1 if begins else 0):
                    _add_point(contact.a - (contact.a - a_old) * 0.5**k, run)
                for k in range(1, _CLOSING + 1 if at and drive.breakpoints[at - 1] else 0):
                    _add_point(a_old + (contact.a - a_old) * 0.5**k, run)
                new = _add_point(contact.a, run)
                a = state.points.x[new]  # the same within rounding: the edge is a point
                contact = Radius(
                    a, contact.force, contact.depth, contact.slope, contact.nodes, contact.solutions,
                    contact.status, contact.release, contact.rests,
                )  # fmt: skip
            run.covered[0] = max(run.covered[0], contact.a)
            lost += _close(h, contact, a_old, D, run)
            if edge >= 0:
                bent[edge] = stays or turned or new < 0
            state.points.edge[0] = new
            for k in range(body.local_times.size if contact.a == 0 and a_old > 0 else 0):
                _transform_of(state.surface.memory[k], 0.0, run)
                for j in range(work.transform.size):
                    state.zeta[k - body.local_times.size, j] = work.transform[j]
            if new >= 0:
                if contact.rests and new == edge:
                    _press(-1, _under(new, contact.depth, run), run.step.near, run.branches, surface)
                else:
                    for k in range(surface.memory.shape[0]):
                        surface.memory[k, -1] = surface.memory[k, new]
                    surface.sunk[-1] = surface.sunk[new] - _jump(contact.a, contact.release, run)
                    _change_form(-1, run.branches.of_retarded, surface.memory, work.variables)
                stays = (stays if contact.rests else bent[new]) or begins
                bent[new] = True
            edge, rested = new, contact.rests
            if not contact.rests:
                taken_up = (release if change < 0 and rate < 0 else contact.release) + contact.release
                parted += math.pi * (a_old**2 - contact.a**2) * taken_up / 2
                release = contact.release
            bend = (change - rate) / (h + since) if since > 0 else 0.0
            rate, a_old = change, contact.a
            since = h if 0 < a_old < stop and not drive.breakpoints[at] else 0.0
            if snaps:  # the speed of a jump tells nothing
                rate, since, snaps = 0.0, 0.0, False
            if piece == 1:
                break
            done, piece = done + (1 - done) * piece, 1.0
            if done < bound < 1:
                piece = max(0.5 * (bound - done), min(drive.located, bound - done)) / (1 - done)
        if status != COMPLETE:
            stopped = at
            break
        if begins and a_old > 0:
            _remember(state.marks, a_old)
        out.force[at], out.depth[at], out.radius[at] = contact.force, contact.depth, a_old
        out.stored[at], out.dissipated[at], out.parted[at] = _stored(contact, run), lost, parted
        out.rise[at] = _rise(a_old, run) if a_old > 0 else 0.0
        if drive.snapshots[at]:
            _keep_fields(a_old, run, out.chi[snapshot], out.local[snapshot], out.spectrum[snapshot])
            snapshot += 1
    return taken, status, stopped
