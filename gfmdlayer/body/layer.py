"""Surface response of an elastic layer bonded to an elastic halfspace: S(q) and K(q, G).

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
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import FloatArray
from gfmdlayer.validation.problems import ConfigError

# exp(-2x) is zero in double precision from x = 373 on: a layer as thick as this, or thicker, is a halfspace.
HALFSPACE_DEPTH = 400.0

# 2 (sinh y - y)/y^3 = sum_k 2 y^2k/(2k + 3)!, whose first term left out is 2e-18 of the sum at y = 2.
_SINH_TAIL = [2 / math.factorial(2 * k + 3) for k in range(11)]


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
        N, D = self._numerator_and_denominator(np.where(q > 0, q, 1.0), G)
        return np.where(q > 0, q * (G / (1 - self.poisson)) * (N / D), self.mean_stiffness * G)

    def layer_factor(self, q: ArrayLike, G: ArrayLike) -> NDArray[Any]:
        """S(q) of Eq. (11), q > 0: compliance relative to a halfspace of the layer's material."""
        N, D = self._numerator_and_denominator(np.asarray(q, dtype=float), np.asarray(G))
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
        """Coefficients of the quadratics N and D for wavenumbers q > 0, each of shape ``(3, *q.shape)``."""
        x = self.depths(q)
        # e - 1 and c - 1 are formed first: near nu = 1/2 they are exact, and e and c have lost their digits.
        e_1, c_1 = 2 * (1 - 2 * self.poisson), 2 * (1 - 2 * self.bulk_poisson)
        e, c = 1 + e_1, 1 + c_1
        r, rho, r4 = np.exp(-2 * x), -np.expm1(-2 * x), -np.expm1(-4 * x)
        N2 = c * sinh_minus(x) * (rho + 2 * x * np.exp(-x))
        N1 = rho * (1 + e * c + r * (c + e)) + 4 * x * x * r * c_1
        N0 = r * (1 + e) ** 2 + e * rho**2 + 4 * x * x * r
        D2 = c * (r4 + 4 * x * r)
        D1 = 1 + e * c - 4 * x * r * c_1 + r * r * (c + e)
        D0 = e_1 * r4 + sinh_minus(2 * x)
        return Quadratics(np.stack((N0, N1, N2)), np.stack((D0, D1, D2)))

    def depths(self, q: ArrayLike) -> FloatArray:
        """Thickness x = q d in units of 1/q, limited where thicker layers are equal in double precision."""
        q = np.asarray(q, dtype=float)
        if math.isinf(self.thickness):
            return np.full(q.shape, HALFSPACE_DEPTH)
        return np.minimum(q * self.thickness, HALFSPACE_DEPTH)

    def _numerator_and_denominator(self, q: FloatArray, G: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """N and D at the modulus G, up to a common factor."""
        if math.isinf(self.thickness):  # a halfspace of the layer's material
            one = np.ones(np.broadcast_shapes(q.shape, G.shape))
            return one, one
        N, D = self.quadratics(q)
        if self.bulk_modulus == 0:
            return N[2], D[2]
        if math.isinf(self.bulk_modulus):
            return N[0], D[0]
        g = G / self.bulk_modulus
        return N[0] + g * (N[1] + g * N[2]), D[0] + g * (D[1] + g * D[2])


def sinh_minus(y: FloatArray) -> FloatArray:
    """2 exp(-y) (sinh y - y) without cancellation or overflow."""
    thin = np.minimum(y, 2.0)
    series = np.exp(-thin) * thin**3 * np.polynomial.polynomial.polyval(thin * thin, _SINH_TAIL)
    return np.where(y < 2, series, -np.expm1(-2 * y) - 2 * y * np.exp(-y))
