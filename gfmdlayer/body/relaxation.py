"""The layered body's surface stiffness as a sum of relaxing modes.

Where the layer's material is a Prony series, the stiffness K(q, G(s)) of `layer` is exactly

    K(q, s) = K_inf(q) - sum_j w_j(q)/(1 + s theta_j(q)),    w_j >= 0,  theta_j > 0

with three modes for each Maxwell branch: springs w_j in series with dashpots w_j theta_j, all beside a spring
K_0 = K_inf - sum_j w_j. For an incompressible body with a Zener layer this is Eq. (23) of Petrenko et al.,
Materials Physics and Mechanics 52 (2024) 60-68, in partial fractions. Two steps lead to it.

As a function of the layer's modulus, K is a quotient of a cubic and a quadratic whose roots are real and
interlace, so it is a linear function less two that saturate:

    K(q, G) = a G + b - R_1/(P_1 + G) - R_2/(P_2 + G),       R_i >= 0,  P_i > 0

a is the stiffness of the layer alone at unit modulus; on a rigid base, or on none, K = a G is all there is.
And 1/(P_i + G(s)) is the compliance of the layer's material with a spring P_i beside it. In a Prony solid of
relaxed modulus A that compliance is

    1/G(s) = 1/Ginf + sum_k J_k/(1 + s theta_k),             sum_k G_k tau_k/(theta_k - tau_k) = A

with one retardation time theta_k between each relaxation time and the next longer one, and one beyond the
longest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gfmdlayer.body.layer import LayeredHalfspace
    from gfmdlayer.body.materials import Material

    Floats = NDArray[np.float64]

# Modes left out at a wavenumber weigh no more than this together, relative to the relaxed stiffness there.
NEGLIGIBLE = 1e-15

# Beyond this x = q d the surface does not feel the base: R_i and b are some x^2 exp(-2x) = 1e-40 of the rest.
_DEEP = 50.0

# From exp(-2x) = 1/4 downwards N(-P) of the two poles, which vanishes with exp(-2x), is found from N - D.
_THIN = math.log(2.0)

# Secular equations are solved for about this many (pole, branch, branch) terms at once: what fits the cache.
_CHUNK = 2**17

# The iteration took no more than 16 rounds wherever it was tried, and ends where rounding holds a root fast.
_MOST_ITERATIONS = 100
_ROUNDING = 4 * np.finfo(float).eps


@dataclass(frozen=True)
class Spectrum:
    """Relaxing modes of the surface at wavenumbers q, which may have any shape.

    Parameters
    ----------
    relaxed
        K_0(q) = K(q, s = 0), the stiffness when all has relaxed, in the shape of q.
    weights
        w_j(q) >= 0, shape (modes, *q.shape); zero where a mode is left out.
    times
        theta_j(q) > 0, shape (modes, *q.shape).
    """

    relaxed: Floats
    weights: Floats
    times: Floats

    @property
    def glassy(self) -> Floats:
        """K_inf(q) = K_0 + sum_j w_j, the stiffness against sudden displacements, in the shape of q."""
        return np.asarray(self.relaxed + self.weights.sum(axis=0))

    def stiffness(self, s: ArrayLike) -> NDArray[Any]:
        """K(q, s) at the Laplace variable s, real or complex, broadcast against q.

        Summed from K_0 upwards, which loses no digits where Re s >= 0 however far K_inf is from K_0.
        """
        cycles = np.asarray(s) * self.times
        return np.asarray(self.relaxed + (self.weights * (cycles / (1 + cycles))).sum(axis=0))


def relaxation_spectrum(layer: LayeredHalfspace, material: Material, q: ArrayLike) -> Spectrum:
    """Relaxing modes of a viscoelastic layer on an elastic halfspace.

    Parameters
    ----------
    layer
        Thickness, Poisson's ratios and halfspace; Poisson's ratios do not relax.
    material
        Shear response of the layer.
    q
        Wavenumbers, not negative, of any shape.

    Returns
    -------
    At most three modes for each branch of the material. Modes whose weights at a wavenumber sum to no more
    than `NEGLIGIBLE` of the relaxed stiffness have weight zero there, and those without weight anywhere are
    left out. An elastic body has none.
    """
    q = np.asarray(q, dtype=float)
    relaxed = layer.stiffness(q, material.relaxed)
    moduli, times = _distinct_branches(material)
    if layer.thickness == 0 or moduli.size == 0:
        return Spectrum(relaxed, np.empty((0, *q.shape)), np.empty((0, *q.shape)))

    proportional, poles, strengths = _partial_fractions(layer, q.ravel())
    negligible = NEGLIGIBLE / (3 * moduli.size) * relaxed.ravel()
    weights = np.zeros((3, moduli.size, q.size))
    thetas = np.broadcast_to(times[:, np.newaxis], weights.shape).copy()
    weights[0] = moduli[:, np.newaxis] * proportional
    for i in range(2):
        A, Ainf = poles[i] + material.relaxed, poles[i] + material.glassy
        heavy = strengths[i] * (material.glassy - material.relaxed) > negligible * A * Ainf
        compliances, thetas[1 + i][:, heavy] = retardation_spectrum(moduli, times, A[heavy])
        weights[1 + i][:, heavy] = strengths[i][heavy] * compliances
    weights[weights <= negligible] = 0.0
    kept = weights.any(axis=-1)
    return Spectrum(relaxed, weights[kept].reshape(-1, *q.shape), thetas[kept].reshape(-1, *q.shape))


class _PartialFractions(NamedTuple):
    """K(q, G) = proportional G + const - sum_i strengths_i/(poles_i + G): shapes (nq,), (2, nq), (2, nq)."""

    proportional: Floats
    poles: Floats
    strengths: Floats


def _partial_fractions(layer: LayeredHalfspace, q: Floats) -> _PartialFractions:
    """K(q, G) as a function of the layer's modulus, for q of shape (nq,) and a layer of some thickness.

    With g = G/G_bulk and the quadratics N and D of `layer`, K = q G_bulk/(1 - nu) g N/D. The discriminant of
    D is a sum of squares, and N - D = -r [(1 + 2x)^2 A + B - 2 r C] with A = (g - 1)(1 + c g),
    B = (c g - e)(g + e), C = (g - 1)(c g - e); so neither the roots of D, their distance nor N there is a
    small difference.
    """
    poles, strengths = np.ones((2, q.size)), np.zeros((2, q.size))
    if layer.bulk_modulus in (0, math.inf):
        return _PartialFractions(layer.stiffness(q, 1.0), poles, strengths)

    near = np.flatnonzero((q > 0) & (layer.depths(q) < _DEEP))
    x = layer.depths(q[near])
    r = np.exp(-2 * x)
    e_1, c_1 = 2 * (1 - 2 * layer.poisson), 2 * (1 - 2 * layer.bulk_poisson)
    e, c, ec_1 = 1 + e_1, 1 + c_1, e_1 + c_1 + e_1 * c_1
    (N0, N1, N2), (D0, D1, D2) = layer.quadratics(q[near])

    gap = np.hypot(4 * x * r * (1 + c) + r * r * (e_1 - c_1) - ec_1, 2 * math.sqrt(c) * (1 + e) * r)
    p = np.stack((2 * D0 / (D1 + gap), (D1 + gap) / (2 * D2)))
    # 1 + c g at the two roots g = -p, themselves the roots of a quadratic with a negative product.
    middle = ec_1 - 4 * x * r * (1 + c) + r * r * (2 + c + e)
    far = (np.abs(middle) + gap) / (2 * D2 / c)
    close = r * r * (1 + c) * (1 + e) / (D2 / c) / far
    delta = np.where(middle > 0, (close, -far), (far, -close))
    A, B, C = -(p + 1) * delta, (delta - 1 - e) * (delta + ec_1) / c, -(p + 1) * (delta - 1 - e)
    N = np.where(x < _THIN, N0 - p * (N1 - p * N2), -r * ((1 + 2 * x) ** 2 * A + B - 2 * r * C))

    poles[:, near] = p * layer.bulk_modulus
    scale = q[near] * layer.bulk_modulus**2 / (1 - layer.poisson)
    strengths[:, near] = scale * p * N / (gap * np.array([[1.0], [-1.0]]))
    return _PartialFractions(replace(layer, bulk_modulus=0.0).stiffness(q, 1.0), poles, strengths)


def _distinct_branches(material: Material) -> tuple[Floats, Floats]:
    """Moduli and ascending, distinct relaxation times of the branches that matter."""
    times, position = np.unique(material.branch_times, return_inverse=True)
    moduli = np.bincount(position, weights=material.branch_moduli, minlength=times.size)
    matter = moduli * moduli.size > NEGLIGIBLE * material.relaxed
    return np.asarray(moduli[matter]), np.asarray(times[matter])


def retardation_spectrum(moduli: Floats, times: Floats, relaxed: Floats) -> tuple[Floats, Floats]:
    """Compliances J_k and retardation times theta_k of Prony solids that differ in their relaxed modulus.

    Parameters
    ----------
    moduli, times
        G_k > 0 and ascending, distinct tau_k of the branches, shape (n,).
    relaxed
        Relaxed moduli A > 0, shape (m,).

    Returns
    -------
    J_k > 0 and theta_k > tau_k, each of shape (n, m), with sum_k J_k = 1/A - 1/(A + sum_k G_k).
    """
    compliances, thetas = np.empty((2, moduli.size, relaxed.size))
    width = max(1, _CHUNK // moduli.size**2)
    for start in range(0, relaxed.size, width):
        part = slice(start, start + width)
        compliances[:, part], thetas[:, part] = _solve_secular(moduli, times, relaxed[part])
    return compliances, thetas


def _solve_secular(moduli: Floats, times: Floats, relaxed: Floats) -> tuple[Floats, Floats]:
    """`retardation_spectrum` by the iteration of Bunch, Nielsen and Sorensen, Numer. Math. 31 (1978) 31-48.

    A root is held as its distance from the nearer of the two poles tau_k around it, so that it is accurate
    however close the times are.
    """
    strengths = moduli * times
    # A pole without strength, out of reach beyond the longest time, spares the last root from being special.
    # The way there is kept by itself: beside the time it may vanish, in a body that is all but rigid.
    reach = 4 * strengths.sum() / relaxed.min()
    ends = np.append(times, times[-1] + reach)
    gap = np.append(np.diff(times), reach)[:, np.newaxis]
    below = np.tril(np.ones((times.size, 1)) * strengths)
    sides = np.stack((below, strengths - below), axis=-1)

    distance = np.repeat(gap / 2, relaxed.size, axis=1)
    pulls, _ = _pulls((times[:, np.newaxis] - times)[:, np.newaxis], distance, sides)
    upward = pulls.sum(axis=-1) < relaxed
    sign = np.where(upward, 1, -1)
    origin = ends[np.arange(times.size)[:, np.newaxis] + ~upward]
    offsets = origin[..., np.newaxis] - times
    for _ in range(_MOST_ITERATIONS):
        pulls, slopes = _pulls(offsets, sign * distance, sides)
        near, far = np.moveaxis(np.where(upward[..., np.newaxis], pulls, -pulls[..., ::-1]), -1, 0)
        near_slope, far_slope = np.moveaxis(
            np.where(upward[..., np.newaxis], slopes, slopes[..., ::-1]), -1, 0
        )
        residual = sign * relaxed - near - far
        last, distance = distance, _next_distance(distance, gap, residual, near_slope, far_slope)
        settled = np.abs(distance - last) <= _ROUNDING * distance
        if (settled | (np.abs(residual) <= _ROUNDING * (relaxed + near - far))).all():
            break
    else:
        raise ArithmeticError("the retardation times of the layer's material were not found")
    theta = origin + sign * distance
    _, slopes = _pulls(offsets, sign * distance, sides)
    return 1 / (theta * slopes.sum(axis=-1)), theta


def _pulls(offsets: Floats, y: Floats, sides: Floats) -> tuple[Floats, Floats]:
    """sum_k G_k tau_k/(theta - tau_k) over the poles below and those above a root, and its falling slope.

    `offsets` holds origin - tau_k, shape (n, m, n), and y theta - origin, shape (n, m); `sides` the strengths
    on either side, shape (n, n, 2). Both results have shape (n, m, 2).
    """
    inverse = 1 / (offsets + y[..., np.newaxis])
    return inverse @ sides, (inverse * inverse) @ sides


def _next_distance(
    distance: Floats, gap: Floats, residual: Floats, near_slope: Floats, far_slope: Floats
) -> Floats:
    """Distance m from the nearer pole where s/m - u/(gap - m) = C.

    The pull of either side is taken for that of its nearest pole and a constant: s and u give it its present
    slope and C its present value, `residual` being what the two pulls lack.
    """
    s, u = near_slope * distance**2, far_slope * (gap - distance) ** 2
    C = (residual + s / distance - u / (gap - distance)) * gap
    b, root = C + s + u, np.hypot(C - s + u, 2 * np.sqrt(s * u))
    return np.asarray(2 * s * gap / np.where(b > 0, b + root, 4 * np.abs(C) * s / (root + np.abs(b))))
