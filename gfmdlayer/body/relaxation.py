"""A stiffness as a sum of relaxing modes.

    K(q, s) = K_inf(q) - sum_j w_j(q)/(1 + s theta_j(q)),    w_j >= 0,  theta_j > 0

Springs w_j in series with dashpots w_j theta_j, all parallel to a spring K_0 = K_inf - sum_j w_j.

A Prony solid of relaxed modulus A has the compliance

    1/G(s) = 1/Ginf + sum_k J_k/(1 + s theta_k),             sum_k G_k tau_k/(theta_k - tau_k) = A

with one retardation time theta_k between each relaxation time and the next longer one, and one beyond the
longest. The same holds for the modes of a stiffness, with w_k in place of G_k and K_0 in place of A.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import FloatArray, IntArray
from gfmdlayer.kernels import kernel

# Largest sum of the weights left out at a wavenumber, relative to the relaxed stiffness there.
NEGLIGIBLE = 1e-15

# Times that rounding may have made different are one where they differ by no more than this part.
SAME_BRANCH = 1e-13

# The iteration needed at most 16 steps in all tests; it ends when rounding no longer changes a root.
_MOST_ITERATIONS = 100
_ROUNDING = 4 * np.finfo(float).eps


class Branched(Protocol):
    """A material of a spring beside Maxwell branches, see `materials.Material`."""

    @property
    def relaxed(self) -> float:
        """Modulus of the spring."""
        ...

    @property
    def branch_moduli(self) -> FloatArray:
        """Moduli of the branches."""
        ...

    @property
    def branch_times(self) -> FloatArray:
        """Relaxation times of the branches."""
        ...


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
    def of_material(cls, stiffness: ArrayLike, material: Branched) -> Spectrum:
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
        rows = np.repeat(times[:, np.newaxis], unit.size, axis=1).reshape(-1, *unit.shape)
        return cls(unit * material.relaxed, np.multiply.outer(moduli, unit), rows)

    @property
    def glassy(self) -> FloatArray:
        """K_inf(q) = K_0 + sum_j w_j, the stiffness against sudden displacements."""
        return np.asarray(self.relaxed + self.weights.sum(axis=0))

    def stiffness(self, s: ArrayLike) -> NDArray[Any]:
        """K(q, s) at the Laplace variable s, real or complex, broadcast against q.

        Summed from K_0 upwards, which loses no digits for Re s >= 0, however large K_inf/K_0 is.

        Parameters
        ----------
        s : array_like
            Laplace variable, real or complex: 1/time.

        Returns
        -------
        ndarray
            Stress per displacement, in the broadcast shape.
        """
        cycles = np.asarray(s) * self.times
        return np.asarray(self.relaxed + (self.weights * (cycles / (1 + cycles))).sum(axis=0))

    def modes_at(self, i: int) -> tuple[list[float], list[float]]:
        """Return weights and times of the modes at one wave.

        Parameters
        ----------
        i : int
            Number of the wave.

        Returns
        -------
        weights, times : list of float
            Of the modes whose weight there is not zero: stress per displacement, time.
        """
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

    Parameters
    ----------
    in_plane : VectorSpectrum
        K over (W, U), real.
    across : Spectrum
        K over V.

    Examples
    --------
    A halfspace of Poisson's ratio nu, of which shear moves the surface up and down:

    >>> nu, q = 0.3, np.array([1.0, 2.0])
    >>> K = np.array([[2 - 2 * nu, 2 * nu - 1], [2 * nu - 1, 2 - 2 * nu]]) / (3 - 4 * nu)
    >>> own = gfmdlayer.TractionSpectrum.of_material(2 * np.multiply.outer(q, K), q, gfmdlayer.Elastic(1.0))
    >>> body = gfmdlayer.halfspace(1.0, poisson=nu).traction_spectrum(q)
    >>> bool(np.allclose(own.in_plane.relaxed, body.in_plane.relaxed))
    True
    """

    in_plane: VectorSpectrum
    across: Spectrum

    @classmethod
    def of_material(cls, in_plane: ArrayLike, across: ArrayLike, material: Branched) -> TractionSpectrum:
        """Return the modes of stiffnesses that are proportional to one modulus.

        Parameters
        ----------
        in_plane : array_like, of the shape of q, and (2, 2)
            K/G over (W, U), symmetric and not negative.
        across : array_like, of the shape of q
            K/G over V.
        material : Material
            Law G(s), a spring beside Maxwell branches.
        """
        unit, (moduli, times) = np.asarray(in_plane, dtype=float), distinct_branches(material)
        values, axes = np.linalg.eigh(unit)
        # A branch has a mode along each principal direction of K.
        along = np.moveaxis(axes * np.sqrt(np.maximum(values, 0.0))[..., np.newaxis, :], -1, 0)
        vectors = np.multiply.outer(np.sqrt(moduli), along).reshape(-1, *unit.shape[:-1])
        rows = np.multiply.outer(np.repeat(times, 2), np.ones(unit.shape[:-2]))
        plane = VectorSpectrum(unit * material.relaxed, vectors, rows)
        return cls(plane, Spectrum.of_material(across, material))


def distinct_branches(material: Branched) -> tuple[FloatArray, FloatArray]:
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
