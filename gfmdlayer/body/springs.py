"""A layer of a stack as springs between its two faces: closed forms without cancellation or overflow.

A layer of unit shear modulus moves its faces by W down and i U along the surface, W and U times exp(iqx).
Motions that are even about its middle plane (w = (W_b - W_t)/2, u = (U_b + U_t)/2 at the lower face) and odd
ones (w = (W_b + W_t)/2, u = (U_b - U_t)/2) do not couple. With x = q d, y = x/2, S = sinh y, C = cosh y,
m = 1 - nu, e_1 = 1 - 2 nu and k = 3 - 4 nu the tractions of the two are, in units of q,

    2/(k S C - y) [[2 m C^2, e_1 S C - y], [e_1 S C - y, 2 m S^2]] (w, u)        even
    2/(k S C + y) [[2 m S^2, e_1 S C + y], [e_1 S C + y, 2 m C^2]] (w, u)        odd

of determinants 4 (S C + y)/(k S C - y) and 4 (S C - y)/(k S C + y). Completed squares of the energy are four
springs, each of a positive stiffness and of a strain that is linear in the displacements of the faces:

    w + t u   of 8 m C^2/(k S C - y),   u   of 2 (S C + y)/(m C^2),     t = (e_1 S C - y)/(2 m C^2)    even
    u + t w   of 8 m C^2/(k S C + y),   w   of 2 (S C - y)/(m C^2),     t = (e_1 S C + y)/(2 m C^2)    odd

The differences of nearly equal numbers in a thin or incompressible layer are S C - y = only (sinh x - x)/2.

The surface carries no shear traction. So the uppermost layer is a spring of its own stiffness as a free
layer on the normal displacement u of the surface, parallel to everything, and two springs between u and
its lower face, which are those of an even motion of a layer twice as thick: about the displacement (alpha u,
gamma u) that the lower face of the free layer has,

    alpha = (sinh x + x cosh x)/(sinh x cosh x + x),   gamma = -x sinh x/(sinh x cosh x + x).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.closed_form import HALFSPACE_DEPTH, sinh_minus


class Springs(NamedTuple):
    """Springs of unit modulus: strains (nq, springs, displacements), stiffness/q (nq, springs)."""

    strains: FloatArray
    stiffness: FloatArray


def layer_springs(x: FloatArray, poisson: float) -> Springs:
    """Four springs between the faces of a layer, x = q d > 0, over the displacements (W_t, U_t, W_b, U_b)."""
    x = np.minimum(x, HALFSPACE_DEPTH)
    m, e_1 = 1 - poisson, 1 - 2 * poisson
    k, decay = 1 + 2 * e_1, np.exp(-x)
    # S C, y, C^2 and S C - y, all times 4 exp(-x).
    SC, y, C2, SC_y = -np.expm1(-2 * x), 2 * x * decay, (1 + decay) ** 2, sinh_minus(x)
    even, odd = (e_1 * SC - y) / (4 * m * C2), (e_1 * SC + y) / (4 * m * C2)
    half, none = np.full(x.shape, 0.5), np.zeros(x.shape)
    strains = ((-half, even, half, even), (none, half, none, half), (odd, -half, odd, half))
    stiffness = (
        8 * m * C2 / (2 * e_1 * SC + SC_y),
        2 * (SC + y) / (m * C2),
        8 * m * C2 / (k * SC + y),
        2 * SC_y / (m * C2),
    )
    return _stacked((*strains, (half, none, half, none)), stiffness)


def surface_springs(x: FloatArray, poisson: float) -> tuple[Springs, FloatArray]:
    """Two springs of the uppermost layer over (u, W_b, U_b), and its stiffness as a free layer."""
    x = np.minimum(x, HALFSPACE_DEPTH)
    m, e_1 = 1 - poisson, 1 - 2 * poisson
    decay, r, rho = np.exp(-x), np.exp(-2 * x), -np.expm1(-2 * x)
    # sinh x cosh x, x and cosh^2 x, all times 4 exp(-2x).
    sc, thickness, c2, sc_x = -np.expm1(-4 * x), 4 * x * r, (1 + r) ** 2, sinh_minus(2 * x)
    alpha = 2 * decay * (rho + x * (1 + r)) / (sc + thickness)
    gamma = -2 * x * decay * rho / (sc + thickness)
    t = (e_1 * sc - thickness) / (2 * m * c2)
    one, none = np.ones(x.shape), np.zeros(x.shape)
    strains = ((-alpha - t * gamma, one, t), (-gamma, none, one))
    stiffness = (4 * m * c2 / (2 * e_1 * sc + sc_x), (sc + thickness) / (m * c2))
    free = sinh_minus(x) * (rho + 2 * x * decay) / (m * (sc + thickness))
    return _stacked(strains, stiffness), free


def shear_springs(x: FloatArray) -> Springs:
    """Three springs of a layer in shear across the wave, over the displacements (V_t, V_b) of its faces."""
    # Its tractions are coth(x) V_t - V_b/sinh(x) and so on, in units of q.
    x = np.minimum(x, HALFSPACE_DEPTH)
    between = 2 * np.exp(-x) / -np.expm1(-2 * x)
    each, one, none = np.tanh(x / 2), np.ones(x.shape), np.zeros(x.shape)
    return _stacked(((one, -one), (one, none), (none, one)), (between, each, each))


def halfspace_springs(count: int, poisson: float) -> Springs:
    """Two springs of a halfspace at `count` wavenumbers, over (W, U) of its surface."""
    m, e_1 = 1 - poisson, 1 - 2 * poisson
    one, none = np.ones(count), np.zeros(count)
    strains = ((one, -one * (e_1 / (2 * m))), (none, one))
    return _stacked(strains, (one * (4 * m / (1 + 2 * e_1)), one / m))


def minors(x: FloatArray, poisson: float) -> FloatArray:
    """Matrix, (..., 5, 5), that carries the minors of the impedance through a layer of unit shear modulus."""
    # The impedance Z below an interface, tractions (on W and U) by displacements in units of q, is kept by
    # its homogeneous coordinates (1, Z_WW, Z_WU, Z_UU, det Z), on which a layer acts linearly: no matrix is
    # inverted, and only the products with Z_WU are subtracted, which det Z bounds. They are minors of the
    # layer's matrix of stiffness, times (k S C - y)(k S C + y) exp(-2x), and found as those in Dunkin, Bull.
    # Seismol. Soc. Am. 55 (1965) 335-358, are for waves.
    x = np.minimum(x, HALFSPACE_DEPTH)
    m, e_1 = 1 - poisson, 1 - 2 * poisson
    k, r, rho = 1 + 2 * e_1, np.exp(-2 * x), -np.expm1(-2 * x)
    # (sinh x)^2/4, sinh x cosh x/2, x/2, (x/2)^2 and (cosh x)^2, all times 4 exp(-2x).
    s2, sc, y, y2, c2 = rho**2 / 4, -np.expm1(-4 * x) / 2, 2 * x * r, x * x * r, (1 + r) ** 2
    s2_y2, sc_y = sinh_minus(x) * (rho + 2 * x * np.exp(-x)) / 4, sinh_minus(2 * x) / 2
    whole = 4 * (k * s2 + 4 * m * m * r + y2)
    below, above = 2 * m * (2 * e_1 * sc + sc_y), 2 * m * (k * sc + y)
    mixed, cross = 4 * m * (e_1 * sc - y), 4 * m * (e_1 * sc + y)
    first, second = 2 * (k * e_1 * s2 - y2), 8 * (e_1 * s2 + y2)
    rows = (
        (whole, below, -2 * first, above, (k * k - 1) * s2 + s2_y2),
        (8 * m * sc_y, 4 * m * m * c2, -2 * cross, 16 * m * m * s2, above),
        (-second, -mixed, 4 * (2 * e_1 * e_1 * s2 + 4 * m * m * r - 2 * y2), -cross, -first),
        (8 * m * (sc + y), 16 * m * m * s2, -2 * mixed, 4 * m * m * c2, below),
        (16 * s2_y2, 8 * m * (sc + y), -2 * second, 8 * m * sc_y, whole),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def halfspace_minors(poisson: float) -> FloatArray:
    """Minors of the impedance of a halfspace of unit shear modulus, shape (5,); see `minors`."""
    m, e_1 = 1 - poisson, 1 - 2 * poisson
    return np.array([1 + 2 * e_1, 4 * m, -2 * e_1, 4 * m, 4.0])


def _stacked(strains: tuple[tuple[FloatArray, ...], ...], stiffness: tuple[FloatArray, ...]) -> Springs:
    rows = np.stack([np.stack(row, axis=-1) for row in strains], axis=-2)
    return Springs(rows, np.stack(stiffness, axis=-1))
