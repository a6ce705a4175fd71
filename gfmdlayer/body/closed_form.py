"""One layer bonded to an elastic halfspace, in closed form: K(q, G), and its relaxing modes.

A normal traction sigma(q), positive where it compresses, on a layer of shear modulus G, Poisson's ratio nu
and thickness d over a halfspace G_bulk, nu_bulk moves the surface by u(q) = M(q) sigma(q), upward positive:

    M(q) = -(1 - nu) S(q)/(G q)                           Eqs. (8) to (12)

of Petrenko et al., Materials Physics and Mechanics 52 (2024) 60-68. Here it is the stiffness
K(q) = -1/M(q) >= 0, sigma = -K u, for a real or complex modulus G, as G(omega) of a viscoelastic layer is.
q is the magnitude of the wavevector, in one dimension or two.

Without its inner fractions, Eq. (11) is a quotient of quadratics in the moduli, with coefficients that depend
only on x = q d and the Poisson ratios. With r = exp(-2x), rho = 1 - r, e = 3 - 4 nu, c = 3 - 4 nu_bulk:

    1/S = N/D,    N = N2 G^2 + N1 G G_bulk + N0 G_bulk^2,    D = D2 G^2 + D1 G G_bulk + D0 G_bulk^2

    N2 = c (rho^2 - 4 x^2 r)                              D2 = c (1 - r^2 + 4 x r)
    N1 = rho (1 + e c + r (c + e)) + 4 x^2 r (c - 1)      D1 = 1 + e c - 4 x r (c - 1) + r^2 (c + e)
    N0 = r (1 + e)^2 + e rho^2 + 4 x^2 r                  D0 = (e - 1)(1 - r^2) + (1 - r^2 - 4 x r)

Eq. (13) is D0/N0 (rigid base) and Eq. (14) is D2/N2 (free layer). No coefficient is negative; the two
that are differences of nearly equal numbers for a thin layer are found from sinh y - y:
rho^2 - 4 x^2 r = 4 r (sinh x - x)(sinh x + x) and 1 - r^2 - 4 x r = 2 r (sinh 2x - 2x).

If the layer's material is a Prony series, K(q, G(s)) is exactly a sum of relaxing modes (`relaxation`), three
for each Maxwell branch. For an incompressible body with a Zener layer this is Eq. (23) of the paper, in
partial fractions. It is derived in two steps. As a function of the layer's modulus, K is a quotient of a
cubic and a quadratic whose roots are real and interlace, so it is a linear function minus two simple
fractions:

    K(q, G) = a G + b - R_1/(P_1 + G) - R_2/(P_2 + G),       R_i >= 0,  P_i > 0

a is the stiffness of the layer alone at unit modulus; on a rigid base, or without one, K = a G. And
1/(P_i + G(s)) is the compliance of the layer's material parallel to a spring P_i.

A stack of layers has the same modes (`stack`), in some 50 times the time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.materials import Material
from gfmdlayer.body.relaxation import NEGLIGIBLE, Spectrum, distinct_branches, retardation_spectrum
from gfmdlayer.kernels import kernel
from gfmdlayer.validation.problems import ConfigError

# exp(-2x) is zero in double precision from x = 373 on: a layer as thick as this, or thicker, is a halfspace.
HALFSPACE_DEPTH = 400.0

# Beyond this x = q d the surface does not feel the base: R_i and b are some x^2 exp(-2x) = 1e-40 of the rest.
_DEEP = 50.0

# Where exp(-2x) < 1/4, N(-P) at the two poles, which vanishes with exp(-2x), is computed from N - D.
_THIN = math.log(2.0)

# 2 (sinh y - y)/y^3 = sum_k 2 y^2k/(2k + 3)!, whose first term left out is 2e-18 of the sum at y = 2.
_SERIES, _SINH_TAIL = 2.0, tuple(2 / math.factorial(2 * k + 3) for k in range(11))


class Quadratics(NamedTuple):
    """Coefficients of N and D, lowest power of G first: shapes (3, ...)."""

    N: FloatArray
    D: FloatArray


@dataclass(frozen=True)
class LayeredHalfspace:
    """A layer bonded to a halfspace: everything about the body but the modulus of the layer.

    Parameters
    ----------
    thickness : float
        d of the layer, from 0 (the bare halfspace) to inf (the layer's material alone).
    poisson : float
        nu of the layer, in (-1, 0.5].
    bulk_modulus : float
        Shear modulus G_bulk of the halfspace, from 0 (a free layer) to inf (a rigid base).
    bulk_poisson : float
        nu_bulk of the halfspace, in (-1, 0.5]; without effect where G_bulk is 0 or inf.

    Raises
    ------
    ConfigError
        If a parameter is outside of these bounds, or a bare halfspace is rigid or has no stiffness.

    Examples
    --------
    >>> layer = gfmdlayer.LayeredHalfspace(thickness=0.1, poisson=0.5, bulk_modulus=np.inf)
    >>> layer.stiffness(np.array([1.0, 100.0]), G=1.0).round(1)
    array([3054.,  200.])
    """

    thickness: float
    poisson: float
    bulk_modulus: float
    bulk_poisson: float = 0.5

    def __post_init__(self) -> None:
        if not self.thickness >= 0:
            raise ConfigError([f"thickness: got {self.thickness!r}; must be 0, positive or inf"])
        if not self.bulk_modulus >= 0:
            raise ConfigError([f"bulk_modulus: got {self.bulk_modulus!r}; must be 0, positive or inf"])
        for name, ratio in (("poisson", self.poisson), ("bulk_poisson", self.bulk_poisson)):
            if not -1 < ratio <= 0.5:
                raise ConfigError([f"{name}: got {ratio!r}; must be above -1 and at most 0.5"])
        if self.thickness == 0 and self.bulk_modulus in (0, math.inf):
            raise ConfigError(
                [f"thickness: got 0 with bulk_modulus {self.bulk_modulus!r}; needs a halfspace that deforms"]
            )

    def stiffness(self, q: ArrayLike, G: ArrayLike) -> NDArray[Any]:
        """Surface stiffness K(q) = -1/M(q), Eqs. (9) to (12).

        Parameters
        ----------
        q : array_like
            Wavenumbers, not negative.
        G : array_like
            Modulus of the layer, real and positive, or complex with Re G >= 0 and not 0; broadcast against q.

        Returns
        -------
        ndarray
            Stress per displacement, in the broadcast shape, real or complex as G is. At q = 0 it is
            `mean_stiffness` times G: zero, except in a compressible layer on a rigid base.
        """
        q, G = np.asarray(q, dtype=float), np.asarray(G)
        return self._stiffness(q, G, self._coefficients(np.where(q > 0, q, 1.0)))

    def layer_factor(self, q: ArrayLike, G: ArrayLike) -> NDArray[Any]:
        """S(q) of Eq. (11), q > 0: compliance relative to a halfspace of the layer's material.

        Parameters
        ----------
        q : array_like
            Wavenumbers q > 0: 1/length.
        G : array_like
            Modulus of the layer, real or complex; broadcast against q.

        Returns
        -------
        ndarray
            S(q) in the broadcast shape, dimensionless.
        """
        q, G = np.asarray(q, dtype=float), np.asarray(G)
        N, D = self._numerator_and_denominator(q, G, self._coefficients(q))
        return np.asarray(D / N)

    @property
    def mean_stiffness(self) -> float:
        """K(q = 0)/G: 2 (1 - nu)/((1 - 2 nu) d) for a compressible layer on a rigid base, else 0.

        A layer that cannot widen has the P-wave modulus 2 G (1 - nu)/(1 - 2 nu) against a uniform pressure. A
        halfspace has no stiffness against it, and an incompressible layer keeps its mean height: in both
        cases the mean displacement is prescribed, not computed.
        """
        if self.bulk_modulus < math.inf or self.poisson == 0.5:
            return 0.0
        return 2 * (1 - self.poisson) / ((1 - 2 * self.poisson) * self.thickness)

    def quadratics(self, q: ArrayLike) -> Quadratics:
        """Coefficients of the quadratics N and D for wavenumbers q > 0, each of shape ``(3, *q.shape)``.

        Parameters
        ----------
        q : array_like
            Wavenumbers q > 0: 1/length.
        """
        x = self.depths(q)
        N, D = np.empty((3, *x.shape)), np.empty((3, *x.shape))
        e = 1 + 2 * (1 - 2 * self.poisson)
        of_body, rows = (self.poisson, self.bulk_poisson, (1 + e) ** 2), (C.reshape(3, -1) for C in (N, D))
        _quadratics(_exponentials(np.ravel(x)), of_body, *rows)
        return Quadratics(N, D)

    def depths(self, q: ArrayLike) -> FloatArray:
        """Thickness x = q d in units of 1/q, limited where thicker layers are equal in double precision.

        Parameters
        ----------
        q : array_like
            Wavenumbers, not negative: 1/length.

        Returns
        -------
        ndarray
            q d in the shape of q, dimensionless, at most `HALFSPACE_DEPTH`.
        """
        q = np.asarray(q, dtype=float)
        if math.isinf(self.thickness):
            return np.full(q.shape, HALFSPACE_DEPTH)
        return np.minimum(q * self.thickness, HALFSPACE_DEPTH)

    def _coefficients(self, q: FloatArray) -> Quadratics | None:
        """`quadratics` where they count: None for a halfspace of the layer's material."""
        return None if math.isinf(self.thickness) else self.quadratics(q)

    def _stiffness(self, q: FloatArray, G: NDArray[Any], of: Quadratics | None) -> NDArray[Any]:
        """`stiffness` from the coefficients."""
        N, D = self._numerator_and_denominator(q, G, of)
        return np.where(q > 0, q * (G / (1 - self.poisson)) * (N / D), self.mean_stiffness * G)

    def _numerator_and_denominator(
        self, q: FloatArray, G: NDArray[Any], of: Quadratics | None
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """N and D at the modulus G, up to a common factor."""
        if of is None:
            one = np.ones(np.broadcast_shapes(q.shape, G.shape))
            return one, one
        N, D = of
        if self.bulk_modulus == 0:
            return N[2], D[2]
        if math.isinf(self.bulk_modulus):
            return N[0], D[0]
        g = G / self.bulk_modulus
        return N[0] + g * (N[1] + g * N[2]), D[0] + g * (D[1] + g * D[2])


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
    moduli, times = distinct_branches(material)
    of = layer._coefficients(np.where(q > 0, q, 1.0))
    relaxed = layer._stiffness(q, np.asarray(material.relaxed), of)
    if layer.thickness == 0 or moduli.size == 0:
        return Spectrum(relaxed, np.empty((0, *q.shape)), np.empty((0, *q.shape)))
    alone = layer if layer.bulk_modulus in {0, math.inf} else replace(layer, bulk_modulus=0.0)
    proportional = alone._stiffness(q, np.asarray(1.0), of)
    # The rows of modes, three for each branch.
    negligible = NEGLIGIBLE / (3 * moduli.size) * relaxed.ravel()
    weights = np.zeros((3, moduli.size, q.size))
    thetas = np.empty(weights.shape)
    thetas[:] = times[:, np.newaxis]
    np.multiply(moduli[:, np.newaxis], proportional.ravel(), out=weights[0])
    if alone is not layer and of is not None:
        poles, strengths = _partial_fractions(layer, q.ravel(), of)
        for i in range(2):
            A, Ainf = poles[i] + material.relaxed, poles[i] + material.glassy
            heavy = strengths[i] * (material.glassy - material.relaxed) > negligible * A * Ainf
            compliances, thetas[1 + i][:, heavy] = retardation_spectrum(moduli, times, A[heavy])
            weights[1 + i][:, heavy] = strengths[i][heavy] * compliances
    weights[weights <= negligible] = 0.0
    kept = weights.any(axis=-1)
    return Spectrum(relaxed, weights[kept].reshape(-1, *q.shape), thetas[kept].reshape(-1, *q.shape))


def _partial_fractions(
    layer: LayeredHalfspace, q: FloatArray, of: Quadratics
) -> tuple[FloatArray, FloatArray]:
    """Poles and strengths in K(q, G) = a G + b - sum_i strengths_i/(poles_i + G): (2, nq)."""
    poles, strengths = np.ones((2, q.size)), np.zeros((2, q.size))
    x, N, D = layer.depths(q), *(C.reshape(3, -1) for C in of)
    moduli = layer.bulk_modulus, layer.bulk_modulus**2
    _fractions(q, x, np.exp(-2 * x), layer.poisson, layer.bulk_poisson, moduli, N, D, poles, strengths)
    return poles, strengths


@kernel
def _fractions(
    q: FloatArray,
    depths: FloatArray,
    decay: FloatArray,
    poisson: float,
    bulk_poisson: float,
    bulk_moduli: tuple[float, float],
    N: FloatArray,
    D: FloatArray,
    poles: FloatArray,
    strengths: FloatArray,
) -> None:
    """Write poles and strengths at the waves that feel the base, from N, D, exp(-2x), G_bulk, G_bulk^2."""
    # With g = G/G_bulk and the quadratics N and D, K = q G_bulk/(1 - nu) g N/D. The discriminant of D is a
    # sum of squares, and N - D = -r [(1 + 2x)^2 A + B - 2 r C] with
    #
    #     A = (g - 1)(1 + c g),    B = (c g - e)(g + e),    C = (g - 1)(c g - e).
    #
    # So the roots of D, their distance and N at the roots are found without cancellation.
    e_1, c_1 = 2 * (1 - 2 * poisson), 2 * (1 - 2 * bulk_poisson)
    e, c, ec_1 = 1 + e_1, 1 + c_1, e_1 + c_1 + e_1 * c_1
    for k in range(q.size):
        x, r = depths[k], decay[k]
        if not (q[k] > 0 and x < _DEEP):
            continue
        gap = math.hypot(4 * x * r * (1 + c) + r * r * (e_1 - c_1) - ec_1, 2 * math.sqrt(c) * (1 + e) * r)
        # 1 + c g at the two roots g = -p, themselves the roots of a quadratic with a negative product.
        middle = ec_1 - 4 * x * r * (1 + c) + r * r * (2 + c + e)
        far = (abs(middle) + gap) / (2 * D[2, k] / c)
        close = r * r * (1 + c) * (1 + e) / (D[2, k] / c) / far
        scale = q[k] * bulk_moduli[1] / (1 - poisson)
        for i in range(2):
            if i == 0:
                p, delta = 2 * D[0, k] / (D[1, k] + gap), close if middle > 0 else far
            else:
                p, delta = (D[1, k] + gap) / (2 * D[2, k]), -far if middle > 0 else -close
            if x < _THIN:
                found = N[0, k] - p * (N[1, k] - p * N[2, k])
            else:
                A, B = -(p + 1) * delta, (delta - 1 - e) * (delta + ec_1) / c
                C = -(p + 1) * (delta - 1 - e)
                deep = 1 + 2 * x
                found = -r * (deep * deep * A + B - 2 * r * C)
            poles[i, k] = p * bulk_moduli[0]
            strengths[i, k] = scale * p * found / (gap if i == 0 else -gap)


class _Exponentials(NamedTuple):
    """Functions of x = q d, one value a wave."""

    x: FloatArray
    once: FloatArray  # exp(-x)
    twice: FloatArray  # exp(-2x)
    rho: FloatArray  # 1 - exp(-2x)
    rho_twice: FloatArray  # 1 - exp(-4x)
    cube: FloatArray  # x^3, where x < 2
    cube_twice: FloatArray  # 8 x^3, where 2x < 2


def _exponentials(x: FloatArray) -> _Exponentials:
    """Return the exponentials by NumPy, whose vector units take several waves at once."""
    y = 2 * x
    cubes = np.minimum(x, _SERIES) ** 3, np.minimum(y, _SERIES) ** 3
    return _Exponentials(x, np.exp(-x), np.exp(-y), -np.expm1(-y), -np.expm1(-4 * x), *cubes)


@kernel
def _quadratics(of: _Exponentials, of_body: tuple[float, float, float], N: FloatArray, D: FloatArray) -> None:
    """Write the coefficients of N and D for nu, nu_bulk and (1 + e)^2."""
    # e - 1 and c - 1 are formed first: near nu = 1/2 they are exact, and e and c have lost their digits.
    poisson, bulk_poisson, square = of_body
    e_1, c_1 = 2 * (1 - 2 * poisson), 2 * (1 - 2 * bulk_poisson)
    e, c = 1 + e_1, 1 + c_1
    for k in range(of.x.size):
        x, r, rho, r4 = of.x[k], of.twice[k], of.rho[k], of.rho_twice[k]
        thin = _sinh_minus(x, of.once[k], rho, of.cube[k])
        N[2, k] = c * thin * (rho + 2 * x * of.once[k])
        N[1, k] = rho * (1 + e * c + r * (c + e)) + 4 * x * x * r * c_1
        N[0, k] = r * square + e * (rho * rho) + 4 * x * x * r
        D[2, k] = c * (r4 + 4 * x * r)
        D[1, k] = 1 + e * c - 4 * x * r * c_1 + r * r * (c + e)
        D[0, k] = e_1 * r4 + _sinh_minus(2 * x, r, r4, of.cube_twice[k])


@kernel(inner=True)
def _sinh_minus(y: float, decay: float, rho: float, cube: float) -> float:
    """`sinh_minus` from exp(-y), 1 - exp(-2y) and, where y < 2, y^3."""
    if y >= _SERIES:
        return rho - 2 * y * decay
    square, total = y * y, _SINH_TAIL[-1]
    for k in range(len(_SINH_TAIL) - 2, -1, -1):
        total = _SINH_TAIL[k] + total * square
    return decay * cube * total


def sinh_minus(y: FloatArray) -> FloatArray:
    """2 exp(-y) (sinh y - y) without cancellation or overflow."""
    thin = np.minimum(y, _SERIES)
    series = np.exp(-thin) * thin**3 * np.polynomial.polynomial.polyval(thin * thin, _SINH_TAIL)
    return np.where(y < _SERIES, series, -np.expm1(-2 * y) - 2 * y * np.exp(-y))
