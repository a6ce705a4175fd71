"""Dense frictional contact at a given depth and path, to rounding, independent of the solver's method.

In turns: the pressure under the last shear, by its set of points in contact; and the shear under this
pressure, by the exact minimum of one point after the other in its disk, whose side tells stick from slip.
"""

import numpy as np
from numba import njit

from gfmdlayer.friction.problem import FrictionProblem
from gfmdlayer.friction.response import Operator, SharedTransforms, Spent
from gfmdlayer.grid.transforms import Transforms


@njit
def sweep(A, s, bound, t, stick):
    """Minimise t.A t/2 + g.t in disks, a point after the other; s = A t + g. Return the largest change."""
    worst = 0.0
    for i in range(bound.size):
        a, c, d = A[i, i, 0, 0], A[i, i, 0, 1], A[i, i, 1, 1]
        r, q = s[i, 0] - a * t[i, 0] - c * t[i, 1], s[i, 1] - c * t[i, 0] - d * t[i, 1]
        delay = 0.0  # of (A + delay) t = -(r, q) with |t| = bound
        for turn in range(60):
            e, f = a + delay, d + delay
            det = e * f - c * c
            x, y = -(f * r - c * q) / det, -(e * q - c * r) / det
            size = np.sqrt(x * x + y * y)
            if turn == 0:
                stick[i] = size <= bound[i]
            if stick[i]:
                break
            fall = (x * (f * x - c * y) + y * (e * y - c * x)) / det / (size * size)
            step = (size / bound[i] - 1) / fall
            delay += step
            if abs(step) < 1e-15 * e:
                x, y = x * bound[i] / size, y * bound[i] / size
                break
        x, y = x - t[i, 0], y - t[i, 1]
        if x != 0 or y != 0:
            worst = max(worst, abs(x), abs(y))
            t[i, 0], t[i, 1] = t[i, 0] + x, t[i, 1] + y
            for j in range(bound.size):
                s[j, 0] += A[j, i, 0, 0] * x + A[j, i, 0, 1] * y
                s[j, 1] += A[j, i, 1, 0] * x + A[j, i, 1, 1] * y
    return worst


def compliance(grid, response):
    """Displacements (W, u_x[, u_y]) of all points under a unit traction at each, (3, 3, points, points)."""
    operator = Operator(grid, response, SharedTransforms(Transforms(grid.points), Spent(), 1.0))
    axes, size = len(grid.points), grid.size
    place = np.indices(grid.points).reshape(axes, -1)
    apart = tuple((each[:, None] - each) % n for each, n in zip(place, grid.points, strict=True))
    C = np.zeros((3, 3, size, size))
    for j in range(1 + axes):
        one = np.zeros((1 + axes, size))
        one[j, 0] = 1.0
        for i, found in enumerate(operator(one)):
            C[i, j] = found.reshape(grid.points)[apart]
    if axes == 1:  # a second axis without forces
        C[2, 2] = np.eye(size) * C[1, 1, 0, 0]
    return C


def solve_densely(grid, problem: FrictionProblem, depth, path, tractions):
    """Return pressure, shear, stick of all points and the margin of each flag, from tractions nearby."""
    C, axes = compliance(grid, problem.response), len(grid.points)
    free = np.zeros((2, grid.size))
    free[:axes] = problem.slip_at_rest - np.asarray(path)[:, None]
    p, t = tractions[0].copy(), np.zeros((2, grid.size))
    t[:axes] = tractions[1:]
    for _ in range(400):
        last = np.vstack((p, t))
        lifted = problem.gap_at_rest - depth + C[0, 1] @ t[0] + C[0, 2] @ t[1]
        active = p > 0
        while True:
            on, p = np.flatnonzero(active), np.zeros(grid.size)
            p[on] = np.linalg.solve(C[0, 0][np.ix_(on, on)], -lifted[on])
            now = (p > 0) | (~active & (lifted + C[0, 0] @ p < 0))
            if (now == active).all():
                break
            active = now
        bound = problem.law.bound(p)[on]
        A = np.ascontiguousarray(C[1:, 1:][:, :, on][:, :, :, on].transpose(2, 3, 0, 1))
        x, stick = t[:, on].T.copy(), np.zeros(on.size, dtype=bool)
        s = (free + C[1:, 0] @ p)[:, on].T + np.einsum("ijab,jb->ia", A, x)
        for _ in range(20_000):
            if sweep(A, s, bound, x, stick) < 1e-15 * bound.max():
                break
        t = np.zeros_like(t)
        t[:, on] = x.T
        if np.abs(np.vstack((p, t)) - last).max() < 1e-13 * p.max():
            break
    sticks, margin = np.zeros(grid.size, dtype=bool), np.full(grid.size, np.inf)
    sticks[on] = stick
    y = x - s / A[0, 0, 0, 0]
    margin[on] = np.abs(np.hypot(*y.T) / bound - 1)
    return p, t[:axes], sticks, margin
