"""The compliance of a body in creep form, for a contact that is isolated.

A contact that is small against every length of the body meets the compliance of a halfspace of the surface's
material, D(s) = (1 - nu)/G(s) per wavelength. The rest is

    C(q, s) = q/K(q, s) - D(s),       which decays like (q d)^2 exp(-2 q d) over a layer of thickness d

D and C are sums of retarded modes, which follow from the relaxing modes of any body. A stiffness
K = K_0 + sum_j w_j s theta_j/(1 + s theta_j) has the compliance 1/K = 1/K_inf + sum_j J_j/(1 + s T_j), with
one retardation time T_j between each relaxation time and the next longer one, and one beyond the longest:

    sum_k w_k theta_k/(T - theta_k) = K_0

C is integrated over q by Gauss's rule in panels that double in width.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.kernels import kernel

# Wavenumbers, times the size of the contact: of the surface's material; and those at which C is searched.
_SURFACE = 1e8
_DECADE = 16
_SEARCHED = np.geomspace(1e-6, 1e5, 11 * _DECADE + 1)
_SUDDEN = 1e60  # in place of an infinite Laplace variable

# C is left out below this part of its maximum; its integrals are then exact to some 1e-9.
_LEFT_OUT = 1e-9

# Change of C, relative to its maximum, from q = 0 to the end of the first panel, and Gauss nodes in each.
_FIRST_CHANGE = 0.25
_ORDER = 10

# Half the phase of cos(q x) over a panel at the largest x: ten nodes resolve it to 1e-10.
_PHASE = 5.0

# Times that differ by less than this part are one.
_SAME_TIME = 1e-13
_MOST_ITERATIONS = 100
_ROUNDING = 4 * np.finfo(float).eps


class Compliance(NamedTuple):
    """D = J0 + sum_k J_k/(1 + s T_k), and C likewise at the nodes in q."""

    local: float  # J0 [1/pressure]
    local_modes: FloatArray  # (nb,), J_k
    local_times: FloatArray  # (nb,), T_k
    q: FloatArray  # (nq,), nodes of the integral over q; none for a halfspace
    weights: FloatArray  # (nq,), weights of the nodes
    instant: FloatArray  # (nq,), C against sudden pressures
    modes: FloatArray  # (nm, nq), retarded parts of C, of either sign
    times: FloatArray  # (nm, nq), their times


class Features(NamedTuple):
    """The wavenumbers between which C varies."""

    surface: float  # beyond all others: the body responds like its surface's material
    first: float  # end of the first panel of an integral over q
    last: float  # C is left out beyond it; 0 for a halfspace


@cache
def gauss_rule(order: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights of Gauss's rule on [-1, 1]."""
    return np.polynomial.legendre.leggauss(order)


def elastic_limits(body: Body, q: FloatArray) -> FloatArray:
    """Return q/K against slow and against sudden loads, shape (2, nq)."""
    return np.stack((q / body.stiffness(q, 0.0), q / body.stiffness(q, _SUDDEN)))


def find_features(body: Body, radius: float) -> Features:
    """Search the compliance of a body for the wavenumbers between which it varies.

    The lengths of the body may be 1e-4 to 1e5 of the contact radius. Raises ValueError if layers are thinner,
    or if the body does not support an isolated load.
    """
    q = np.append(_SEARCHED, _SURFACE) / radius
    compliances = elastic_limits(body, q)
    C = np.abs((compliances / compliances[:, -1:] - 1)[:, :-1])
    if C.max() <= _LEFT_OUT:
        return Features(q[-1], 0.0, 0.0)
    if C[:, -1].max() > _LEFT_OUT:
        message = f"a contact of radius {radius:.6g} is more than 10,000 times the thickness of a layer"
        raise ValueError(f"{message} at the surface; must be less")
    if C[:, 0].max() > 2 * C[:, _DECADE].max() + 1:
        raise ValueError("the body has no base; must have one, which supports an isolated load")
    scale = C.max(axis=1, keepdims=True)
    last = np.flatnonzero((_LEFT_OUT * np.maximum(scale, 1.0) < C).any(axis=0))[-1]
    changed = (np.abs(C - C[:, :1]) > _FIRST_CHANGE * scale).any(axis=0)
    return Features(q[-1], q[np.flatnonzero(changed)[0]], q[last + 1])


def panels(features: Features, reach: float) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights in q for the integrals of C, and cosines up to x = 2 reach."""
    ends = [0.0]
    while ends[-1] < features.last:
        width = min(max(features.first, ends[-1]), _PHASE / reach)
        ends.append(min(features.last, ends[-1] + width))
    x, w = gauss_rule(_ORDER)
    edges = np.array(ends)
    half = np.diff(edges)[:, np.newaxis] / 2
    return (half * (x + 1) + edges[:-1, np.newaxis]).ravel(), (half * w).ravel()


def compliance(body: Body, features: Features, q: FloatArray, weights: FloatArray) -> Compliance:
    """Return the compliance of a body at the nodes of `panels`; the features may be of a similar body."""
    every = np.append(q, features.surface)
    spectrum = body.spectrum(every)
    instant = every / spectrum.glassy
    modes, times = retardation(spectrum.weights, spectrum.times, spectrum.relaxed)
    modes *= every
    kept, far = modes[:, :-1].any(axis=1), modes[:, -1] > 0
    J, T = modes[far, -1], times[far, -1]
    modes = np.concatenate((modes[kept, :-1], np.tile(-J[:, np.newaxis], q.size)))
    times = np.concatenate((times[kept, :-1], np.tile(T[:, np.newaxis], q.size)))
    local = float(instant[-1])
    return Compliance(local, J, T, q, weights, instant[:-1] - local, modes, times)


@kernel
def retardation(weights: FloatArray, times: FloatArray, relaxed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return J_j >= 0 and T_j > 0 of m stiffnesses, each (n, m), from w_j, theta_j (n, m) and K_0 > 0 (m,).

    J_j = 0 where there is no mode.
    """
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
    """Return the root behind pole j: its signed distance from the nearer pole, and the number of this pole.

    The sum over either side is replaced by its nearest pole and a constant (Bunch, Nielsen and Sorensen,
    Numer. Math. 31 (1978) 31-48); behind the last pole stands one of no strength.
    """
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
