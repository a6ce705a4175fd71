"""Compliances in creep form, and the way between them and relaxing modes.

A stiffness K = K_0 + sum_j w_j s theta_j/(1 + s theta_j) has the compliance
1/K = 1/K_inf + sum_j J_j/(1 + s T_j), with one retardation time T_j between each relaxation time and the next
longer one, and one beyond the longest:

    sum_k w_k theta_k/(T - theta_k) = K_0

The way back from C = c_0 + sum_k c_k/(1 + s T_k), which is 1/K, has the rates 1/theta_j as the eigenvalues of
diag(1/T) + v v^T/c_0 with v_k = (c_k/T_k)^(1/2), and with its eigenvectors e_j

    K_inf = 1/c_0,      w_j = theta_j (e_j.v)^2/c_0^2
"""

from __future__ import annotations

import math

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.network import singular_values
from gfmdlayer.kernels import kernel

# Times that differ by less than this part are one.
_SAME_TIME = 1e-13
_MOST_ITERATIONS = 100
_ROUNDING = 4 * np.finfo(float).eps


def relaxation(instant: float, compliances: FloatArray, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return w_j > 0 and theta_j > 0 of a compliance c_0 > 0, c_k > 0, distinct T_k > 0, shape (n,)."""
    if not times.size:
        return times, times
    v = np.sqrt(compliances / times)
    system = np.vstack((np.diag(times**-0.5), v / math.sqrt(instant)))
    roots, vectors = singular_values(system)
    return ((v @ vectors) / (instant * roots)) ** 2, roots**-2


@kernel
def retardation(weights: FloatArray, times: FloatArray, relaxed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return J_j >= 0, T_j > 0 of m stiffnesses, each (n, m), from w_j, theta_j (n, m) and K_0 > 0 (m,)."""
    # J_j = 0 where there is no mode.
    compliances, retarded = np.zeros(weights.shape), np.ones(weights.shape)
    poles, strengths = np.empty(weights.shape[0]), np.empty(weights.shape[0])
    for m in range(weights.shape[1]):
        n = 0
        for j in np.argsort(times[:, m]):
            strength = weights[j, m] * times[j, m]
            if strength <= 0:
                continue
            if n > 0 and times[j, m] - poles[n - 1] <= _SAME_TIME * times[j, m]:
                strengths[n - 1] += strength
                continue
            poles[n], strengths[n] = times[j, m], strength
            n += 1
        for j in range(n):
            distance, origin = _root(poles[:n], strengths[:n], relaxed[m], j)
            slope = 0.0
            for k in range(n):
                slope += strengths[k] / ((poles[origin] - poles[k]) + distance) ** 2
            retarded[j, m] = poles[origin] + distance
            compliances[j, m] = 1 / (retarded[j, m] * slope)
    return compliances, retarded


@kernel(inner=True)
def _root(poles: FloatArray, strengths: FloatArray, relaxed: float, j: int) -> tuple[float, int]:
    """Return the root behind pole j: its signed distance from the nearer pole, and the pole's number."""
    # The sum over either side is replaced by its nearest pole and a constant (Bunch, Nielsen and Sorensen,
    # Numer. Math. 31 (1978) 31-48); behind the last pole stands one of no strength.
    n = poles.size
    gap = poles[j + 1] - poles[j] if j + 1 < n else 4 * strengths.sum() / relaxed
    value = 0.0
    for k in range(n):
        value += strengths[k] / ((poles[j] - poles[k]) + gap / 2)
    upward = value < relaxed or j + 1 == n
    origin = j if upward else j + 1
    sign = 1.0 if upward else -1.0
    distance = gap / 2
    for _ in range(_MOST_ITERATIONS):
        near, far, near_slope, far_slope = 0.0, 0.0, 0.0, 0.0
        for k in range(n):
            inverse = 1 / ((poles[origin] - poles[k]) + sign * distance)
            term = sign * strengths[k] * inverse
            if (k <= j) == upward:
                near += term
                near_slope += strengths[k] * inverse * inverse
            else:
                far -= term
                far_slope += strengths[k] * inverse * inverse
        residual = sign * relaxed - near + far
        s, u = near_slope * distance**2, far_slope * (gap - distance) ** 2
        C = (residual + s / distance - u / (gap - distance)) * gap
        b, root = C + s + u, math.hypot(C - s + u, 2 * math.sqrt(s * u))
        new = 2 * s * gap / (b + root) if b > 0 else gap * (root - b) / (2 * abs(C))
        moved = abs(new - distance)
        distance = new
        if moved <= _ROUNDING * distance or abs(residual) <= _ROUNDING * (relaxed + near + far):
            break
    return sign * distance, origin
