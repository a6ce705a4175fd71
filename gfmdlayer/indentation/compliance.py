"""The compliance of a body in creep form, for a contact that is isolated.

A contact that is small against every length of the body meets the compliance of a halfspace of the surface's
material, D(s) = (1 - nu)/G(s) per wavelength. The rest is

    C(q, s) = q/K(q, s) - D(s),       which decays like (q d)^2 exp(-2 q d) over a layer of thickness d

D and C are sums of retarded modes, which follow from the relaxing modes of any body (`body.relaxation`).

C is integrated over q by Gauss's rule in panels that double in width.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.body.relaxation import SAME_BRANCH, retardation

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


class Compliance(NamedTuple):
    """D = J0 + sum_k J_k/(1 + s T_k), and C likewise at the nodes in q."""

    local: float  # J0 [1/pressure]
    local_modes: FloatArray  # (nb,), J_k
    local_times: FloatArray  # (nb,), T_k
    q: FloatArray  # (nq,), nodes of the integral over q; none for a halfspace
    weights: FloatArray  # (nq,), weights of the nodes
    instant: FloatArray  # (nq,), C against sudden pressures
    modes: FloatArray  # (nm, nq), retarded parts of C, of either sign; the last nb of them are those of -D
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
    modes, times, *_ = retardation(spectrum.weights, spectrum.times, spectrum.relaxed, SAME_BRANCH)
    modes *= every
    kept, far = modes[:, :-1].any(axis=1), modes[:, -1] > 0
    J, T = modes[far, -1], times[far, -1]
    modes = np.concatenate((modes[kept, :-1], np.tile(-J[:, np.newaxis], q.size)))
    times = np.concatenate((times[kept, :-1], np.tile(T[:, np.newaxis], q.size)))
    local = float(instant[-1])
    return Compliance(local, J, T, q, weights, instant[:-1] - local, modes, times)
