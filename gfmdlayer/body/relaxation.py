"""The layered body's surface stiffness as a sum of relaxing modes.

If the layer's material is a Prony series, the stiffness K(q, G(s)) of `layer` is exactly

    K(q, s) = K_inf(q) - sum_j w_j(q)/(1 + s theta_j(q)),    w_j >= 0,  theta_j > 0

with three modes for each Maxwell branch: springs w_j in series with dashpots w_j theta_j, all parallel to a
spring K_0 = K_inf - sum_j w_j. For an incompressible body with a Zener layer this is Eq. (23) of Petrenko et
al., Materials Physics and Mechanics 52 (2024) 60-68, in partial fractions. It is derived in two steps.

As a function of the layer's modulus, K is a quotient of a cubic and a quadratic whose roots are real and
interlace, so it is a linear function minus two simple fractions:

    K(q, G) = a G + b - R_1/(P_1 + G) - R_2/(P_2 + G),       R_i >= 0,  P_i > 0

a is the stiffness of the layer alone at unit modulus; on a rigid base, or without one, K = a G. And
1/(P_i + G(s)) is the compliance of the layer's material parallel to a spring P_i. A Prony solid of relaxed
modulus A has the compliance

    1/G(s) = 1/Ginf + sum_k J_k/(1 + s theta_k),             sum_k G_k tau_k/(theta_k - tau_k) = A

with one retardation time theta_k between each relaxation time and the next longer one, and one beyond the
longest. The same holds for the modes of a stiffness, with w_k in place of G_k and K_0 in place of A.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.body.layer import LayeredHalfspace
from gfmdlayer.body.materials import Material
from gfmdlayer.kernels import kernel

# Largest sum of the weights left out at a wavenumber, relative to the relaxed stiffness there.
NEGLIGIBLE = 1e-15

# Beyond this x = q d the surface does not feel the base: R_i and b are some x^2 exp(-2x) = 1e-40 of the rest.
_DEEP = 50.0

# Where exp(-2x) < 1/4, N(-P) at the two poles, which vanishes with exp(-2x), is computed from N - D.
_THIN = math.log(2.0)

# Times that rounding may have made different are one where they differ by no more than this part.
SAME_BRANCH = 1e-13

# The iteration needed at most 16 steps in all tests; it ends when rounding no longer changes a root.
_MOST_ITERATIONS = 100
_ROUNDING = 4 * np.finfo(float).eps


@dataclass(frozen=True)
class Spectrum:
    """Relaxing modes of the surface at wavenumbers q, which may have any shape.

    Parameters
    ----------
    relaxed : ndarray of the shape of q
        K_0(q) = K(q, s = 0), the relaxed stiffness.
    weights : ndarray, shape (modes, ...), one value a wavenumber
        w_j(q) >= 0; zero where a mode is left out.
    times : ndarray, shape (modes, ...), likewise
        theta_j(q) > 0.
    error : float
        Bound on the relative error of K(q, s) at all s of Re s >= 0, where modes were merged.

    Examples
    --------
    >>> found = gfmdlayer.Spectrum.of_material([1.0, 2.0], gfmdlayer.Zener(G0=1.0, Ginf=10.0, tau=2.0))
    >>> found.glassy, found.stiffness(1 / 2.0)
    (array([10., 20.]), array([ 5.5, 11. ]))
    """

    relaxed: FloatArray
    weights: FloatArray
    times: FloatArray
    error: float = 0.0

    @classmethod
    def of_material(cls, stiffness: ArrayLike, material: Material) -> Spectrum:
        """Return the modes of a stiffness that is proportional to one modulus.

        Parameters
        ----------
        stiffness : array_like
            K(q)/G.
        material : Material
            Law G(s), a spring beside Maxwell branches.
        """
        unit = np.asarray(stiffness, dtype=float)
        moduli, times = distinct_branches(material)
        each = np.repeat(times[:, np.newaxis], unit.size, axis=1).reshape(-1, *unit.shape)
        return cls(unit * material.relaxed, np.multiply.outer(moduli, unit), each)

    @property
    def glassy(self) -> FloatArray:
        """K_inf(q) = K_0 + sum_j w_j, the stiffness against sudden displacements."""
        return np.asarray(self.relaxed + self.weights.sum(axis=0))

    def stiffness(self, s: ArrayLike) -> NDArray[Any]:
        """K(q, s) at the Laplace variable s, real or complex, broadcast against q.

        Summed from K_0 upwards, which loses no digits for Re s >= 0, however large K_inf/K_0 is.
        """
        cycles = np.asarray(s) * self.times
        return np.asarray(self.relaxed + (self.weights * (cycles / (1 + cycles))).sum(axis=0))

    def modes_at(self, i: int) -> tuple[list[float], list[float]]:
        """Return weights and times of the modes at one wave."""
        some = self.weights[:, i] > 0
        return self.weights[some, i].tolist(), self.times[some, i].tolist()


@dataclass(frozen=True)
class VectorSpectrum:
    """Relaxing modes of n = 1, 2 or 3 components: K(s) = K_inf - sum_j v_j v_j^H/(1 + s theta_j).

    The components are displacements of the surface, and the tractions that do work on them: normal alone,
    normal and along the wave, or all three. K is Hermitian at real s; a component that is i times a real one
    makes it real. Each mode has one scalar state, driven by v^H u. A scalar mode of weight w is v = w^(1/2).
    """

    relaxed: NDArray[Any]  # K_0(q), Hermitian, not negative, shape (*q.shape, n, n)
    vectors: NDArray[Any]  # v_j(q), zero where a mode is left out, shape (modes, *q.shape, n)
    times: FloatArray  # theta_j(q) > 0, shape (modes, *q.shape)

    @classmethod
    def of(cls, spectrum: Spectrum) -> VectorSpectrum:
        """Return the modes of one component as vectors."""
        relaxed, vectors = spectrum.relaxed[..., np.newaxis, np.newaxis], np.sqrt(spectrum.weights)
        return cls(relaxed, vectors[..., np.newaxis], spectrum.times)

    @property
    def entries(self) -> Spectrum:
        """The modes of each entry of K, shape (*q.shape, n, n); those beside the diagonal have any sign."""
        products = self.vectors[..., :, np.newaxis] * self.vectors[..., np.newaxis, :].conj()
        return Spectrum(self.relaxed, products, self.times[..., np.newaxis, np.newaxis])

    @property
    def glassy(self) -> NDArray[Any]:
        """K_inf(q), shape (*q.shape, n, n)."""
        return self.entries.glassy

    def stiffness(self, s: ArrayLike) -> NDArray[Any]:
        """K(q, s), shape (*q.shape, n, n), at the Laplace variable s, a number or of the shape of q."""
        return self.entries.stiffness(np.asarray(s)[..., np.newaxis, np.newaxis])


@dataclass(frozen=True)
class TractionSpectrum:
    """Relaxing modes of a surface under tractions in all directions, at wavevectors.

    Along the unit vector n of a wave the surface moves by i U n, across it by V, and down by W. The tractions
    on the body are i T n, S and the pressure p. (W, U) and (p, T) couple; V and S do not couple with them.
    """

    in_plane: VectorSpectrum  # K over (W, U), real
    across: Spectrum  # K_t over V


def relaxation_spectrum(layer: LayeredHalfspace, material: Material, q: ArrayLike) -> Spectrum:
    """Relaxing modes of a viscoelastic layer on an elastic halfspace.

    Parameters
    ----------
    layer : LayeredHalfspace
        Thickness, Poisson's ratios and halfspace; Poisson's ratios do not relax.
    material : Material
        Shear response of the layer.
    q : array_like
        Wavenumbers, not negative, of any shape.

    Returns
    -------
    Spectrum
        At most three modes for each branch of the material, none for an elastic body. Modes whose weights at
        a wavenumber sum to no more than `NEGLIGIBLE` of the relaxed stiffness have weight zero there, and
        those without weight anywhere are left out.

    Examples
    --------
    >>> layer = gfmdlayer.LayeredHalfspace(thickness=0.1, poisson=0.5, bulk_modulus=np.inf)
    >>> gfmdlayer.relaxation_spectrum(layer, gfmdlayer.Zener(G0=1.0, Ginf=10.0, tau=2.0), 1.0).times
    array([2.])
    """
    q = np.asarray(q, dtype=float)
    relaxed = layer.stiffness(q, material.relaxed)
    moduli, times = distinct_branches(material)
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


def _partial_fractions(layer: LayeredHalfspace, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """K(q, G) = proportional G + const - sum_i strengths_i/(poles_i + G): shapes (nq,), (2, nq), (2, nq)."""
    # Returns factor, poles and strengths, for q of shape (nq,) and a thickness above zero. With g = G/G_bulk
    # and the quadratics N and D of `layer`, K = q G_bulk/(1 - nu) g N/D. The discriminant of D is a sum of
    # squares, and N - D = -r [(1 + 2x)^2 A + B - 2 r C] with
    #
    #     A = (g - 1)(1 + c g),    B = (c g - e)(g + e),    C = (g - 1)(c g - e).
    #
    # So the roots of D, their distance and N at the roots are found without cancellation.
    poles, strengths = np.ones((2, q.size)), np.zeros((2, q.size))
    if layer.bulk_modulus in (0, math.inf):
        return layer.stiffness(q, 1.0), poles, strengths

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
    return replace(layer, bulk_modulus=0.0).stiffness(q, 1.0), poles, strengths


def distinct_branches(material: Material) -> tuple[FloatArray, FloatArray]:
    """Moduli and ascending, distinct relaxation times of the branches that are not negligible."""
    times, position = np.unique(material.branch_times, return_inverse=True)
    moduli = np.bincount(position, weights=material.branch_moduli, minlength=times.size)
    relevant = moduli * moduli.size > NEGLIGIBLE * material.relaxed
    return np.asarray(moduli[relevant]), np.asarray(times[relevant])


def retardation_spectrum(
    moduli: FloatArray, times: FloatArray, relaxed: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compliances J_k > 0 and times theta_k > tau_k, (n, m), of Prony solids of relaxed moduli A, (m,)."""
    # All have the same moduli G_k > 0 and ascending, distinct times tau_k. The sum of the compliances J_k is
    # 1/A - 1/(A + sum_k G_k).
    if moduli.size == 1:
        thetas = times * (1 + moduli / relaxed)
        return (moduli / relaxed * times / thetas / relaxed)[np.newaxis], thetas[np.newaxis]
    every = np.ones(relaxed.size)
    found = retardation(np.outer(moduli, every), np.outer(times, every), relaxed, 0.0)
    return found.compliances, found.times


class Retardation(NamedTuple):
    """The compliances 1/K = 1/K_inf + sum_k J_k/(1 + s theta_k) of m stiffnesses, each (n, m)."""

    compliances: FloatArray  # J_k >= 0; 0 where there is no mode
    times: FloatArray  # theta_k > 0: origin + distance, exactly even where the times are close
    origins: FloatArray  # the nearer of the relaxation times around theta_k
    distances: FloatArray


def retardation(weights: FloatArray, times: FloatArray, relaxed: FloatArray, same: float) -> Retardation:
    """Return the compliances of stiffnesses with the modes w_j >= 0, theta_j, (n, m), and K_0 > 0, (m,)."""
    # Times that differ by no more than the part `same` are one. To compile a sort would take a second.
    # Raises ArithmeticError if the iteration does not converge.
    found: Retardation = _retardation(weights, times, np.argsort(times, axis=0), relaxed, same)
    return found


@kernel
def _retardation(
    weights: FloatArray, times: FloatArray, order: IntArray, relaxed: FloatArray, same: float
) -> Retardation:
    shape = weights.shape
    compliances, origins, distances = np.zeros(shape), np.ones(shape), np.zeros(shape)
    poles, strengths = np.empty(shape[0]), np.empty(shape[0])
    for m in range(shape[1]):
        n = 0
        for j in order[:, m]:
            strength = weights[j, m] * times[j, m]
            if not strength > 0:
                continue
            if n > 0 and times[j, m] - poles[n - 1] <= same * times[j, m]:
                strengths[n - 1] += strength
                continue
            poles[n], strengths[n] = times[j, m], strength
            n += 1
        for j in range(n):
            distance, origin = _root(poles[:n], strengths[:n], relaxed[m], j)
            slope = 0.0
            for k in range(n):
                slope += strengths[k] / ((poles[origin] - poles[k]) + distance) ** 2
            origins[j, m], distances[j, m] = poles[origin], distance
            compliances[j, m] = 1 / ((poles[origin] + distance) * slope)
    return Retardation(compliances, origins + distances, origins, distances)


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
        settled = moved <= _ROUNDING * distance or abs(residual) <= _ROUNDING * (relaxed + near + far)
        if settled and distance > 0:
            return sign * distance, origin
    raise ArithmeticError("no convergence to the retardation times of a body")
