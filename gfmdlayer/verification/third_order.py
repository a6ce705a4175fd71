"""The paper's integrator: its third-order constitutive equation, Eq. (24), by backward Euler.

For an incompressible Zener layer on an incompressible halfspace the stress follows the displacement, mode by
mode, by

    sum_k (c_{k+1,1} + c_{k,1}) tau^k d^k sigma/dt^k = -2 q sum_k (c_{k+1,0} G0 + c_{k,0} Ginf) tau^k d^k
    u/dt^k,   k = 0 ... 3.

Every derivative, on both sides, is a backward difference. The stress of the next step is then sigma = -kappa
u + b with slopes -kappa and intercepts b that do not depend on u (lines 5 and 6 of the pseudocode).

The history is kept as the scaled differences Y_k = (tau/dt)^k nabla^k y of stress and displacement and not as
old values: third differences of those would be divided by (dt/tau)^3, which at dt = 0.005 tau costs seven
digits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.layer import LayeredHalfspace
from gfmdlayer.body.materials import Zener


class Coefficients(NamedTuple):
    """Coefficients of tau^k d^k/dt^k on the two sides of Eq. (24), k = 0 ... 3 along the first axis."""

    stress: FloatArray
    displacement: FloatArray


def constitutive_coefficients(layer: LayeredHalfspace, material: Zener, q: FloatArray) -> Coefficients:
    """Return the coefficients of both sides of Eq. (24), up to a factor common to both.

    The c_{j,k} of Eq. (21) are the coefficients of (1 + s)^2 N (k = 0) and (1 + s)^2 D (k = 1), the numerator
    and denominator of 1/S at the modulus G(s) = (G0 + s Ginf)/(1 + s), times G_bulk^2.  Expanded in the
    coefficients of N and D in G, none of which is negative, they keep their digits for thin layers and for a
    rigid or missing halfspace, where Eq. (21) as printed cancels or overflows.
    """
    G0, Ginf = material.G0, material.Ginf
    # N2 G^2 + N1 G G_bulk + N0 G_bulk^2, divided through by the larger modulus squared.
    scale = max(Ginf, layer.bulk_modulus)
    soft, hard, bulk = (
        (G0 / scale, Ginf / scale, layer.bulk_modulus / scale) if np.isfinite(scale) else (0.0, 0.0, 1.0)
    )
    numerator, denominator = layer.quadratics(q)
    c = [  # c[k] holds c_{1,k}, c_{2,k}, c_{3,k}
        np.stack(
            (
                square * soft**2 + linear * soft * bulk + constant * bulk**2,
                2 * square * soft * hard + linear * (soft + hard) * bulk + 2 * constant * bulk**2,
                square * hard**2 + linear * hard * bulk + constant * bulk**2,
            )
        )
        for constant, linear, square in (numerator, denominator)
    ]
    return Coefficients(stress=_times(c[1], 1.0, 1.0), displacement=2 * q * _times(c[0], G0, Ginf))


def _times(polynomial: FloatArray, constant: float, linear: float) -> FloatArray:
    """Multiply polynomials in s, coefficients along the first axis, by constant + linear s."""
    nothing = np.zeros_like(polynomial[:1])
    return constant * np.concatenate((polynomial, nothing)) + linear * np.concatenate((nothing, polynomial))


class ThirdOrder:
    """Backward Euler on Eq. (24), with a fixed time step."""

    def __init__(self, layer: LayeredHalfspace, material: Zener, q: FloatArray, step: float) -> None:
        if layer.poisson != 0.5 or (np.isfinite(layer.bulk_modulus) and layer.bulk_poisson != 0.5):
            raise ValueError("Eq. (24) holds for incompressible solids, nu = nu_bulk = 0.5")
        q = np.ravel(q)
        resisting = q > 0
        stress, displacement = (np.zeros((4, q.size)) for _ in range(2))
        stress[0] = 1.0  # at q = 0 the equation reads sigma = 0
        stress[:, resisting], displacement[:, resisting] = constitutive_coefficients(
            layer, material, q[resisting]
        )
        self._step, self._rate = step, material.tau / step
        powers = self._rate ** np.arange(4)[:, None]
        weight = (stress * powers).sum(axis=0)
        self.stiffness = (displacement * powers).sum(axis=0) / weight
        self._coefficients = np.stack([stress, displacement])[:, 1:] / weight  # of k = 1, 2, 3
        self._past = np.zeros((2, 3, q.size), dtype=np.complex128)  # Y_0, Y_1, Y_2 of sigma and of u
        self._b = np.zeros(q.size, dtype=np.complex128)

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b, sigma = -kappa u + b, at the end of the next step (lines 5 and 6).

        Y_k of the next step is rate^k y - (rate^k Y_0 + rate^(k-1) Y_1 + ... + rate Y_(k-1)) of the last one;
        b collects the sums in brackets.
        """
        if step != self._step:
            raise ValueError(f"step {step} after steps of {self._step}: third differences need equal steps")
        bracket = np.zeros_like(self._past[:, 0])
        self._b = np.zeros_like(self._b)
        for k in range(3):
            bracket = self._rate * (bracket + self._past[:, k])
            self._b += (self._coefficients[:, k] * bracket).sum(axis=0)
        return self.stiffness, self._b

    def advance(self, spectrum: ComplexArray) -> None:
        """Advance the history by the step of the last `terms` with its displacement (lines 8 and 9)."""
        value = np.stack([self._b - self.stiffness * spectrum, spectrum])
        first = self._rate * (value - self._past[:, 0])
        self._past = np.stack([value, first, self._rate * (first - self._past[:, 1])], axis=1)
