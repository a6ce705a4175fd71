"""The shear response of the layer's material, G(t), G(omega) and G(s).

Every material here is a spring of the relaxed modulus beside Maxwell branches (a spring G_k in series with
a dashpot G_k tau_k), so that

    G(t) = G0 + sum_k G_k exp(-t/tau_k)                   Eq. (5) for one branch
    G(s) = G0 + sum_k G_k s tau_k/(1 + s tau_k)           Eq. (4) for one branch, with s = i omega

after Petrenko et al., Materials Physics and Mechanics 52 (2024) 60-68. G(s) is s times the Laplace transform
of G(t), Eq. (2): the modulus that takes an elastic solution to the viscoelastic one. Moduli and times may be
in any units; those of the results follow.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


class Material(ABC):
    """Shear response of an isotropic solid whose stress relaxes through Maxwell branches."""

    @property
    @abstractmethod
    def relaxed(self) -> float:
        """Modulus at long times and low frequencies, G0 > 0."""

    @property
    @abstractmethod
    def branch_moduli(self) -> NDArray[np.float64]:
        """Moduli G_k >= 0 of the Maxwell branches, shape (branches,)."""

    @property
    @abstractmethod
    def branch_times(self) -> NDArray[np.float64]:
        """Relaxation times tau_k > 0 of the Maxwell branches at constant strain, shape (branches,)."""

    @property
    def glassy(self) -> float:
        """Modulus at short times and high frequencies, Ginf = G0 + sum_k G_k."""
        return self.relaxed + math.fsum(self.branch_moduli)

    @property
    def elastic(self) -> bool:
        """Whether nothing relaxes."""
        return not self.branch_moduli.any()

    def relaxation_modulus(self, t: ArrayLike) -> NDArray[np.float64]:
        """Stress after a unit step of strain, over two: G(t) of Eq. (5), for t >= 0, in the shape of t."""
        elapsed = np.asarray(t, dtype=float)[..., np.newaxis]
        relaxing = self.branch_moduli * np.exp(-elapsed / self.branch_times)
        return np.asarray(self.relaxed + relaxing.sum(axis=-1))

    def complex_modulus(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Storage plus i times loss modulus, G(omega) of Eq. (4), in the shape of the angular frequency."""
        return self.laplace(1j * np.asarray(omega, dtype=float))

    def laplace(self, s: ArrayLike) -> NDArray[Any]:
        """Modulus G(s) at the Laplace variable s, real or complex, in the shape of s."""
        cycles = np.asarray(s)[..., np.newaxis] * self.branch_times
        return np.asarray(self.relaxed + (self.branch_moduli * (cycles / (1 + cycles))).sum(axis=-1))


@dataclass(frozen=True)
class Zener(Material):
    """Standard linear solid: one branch of modulus Ginf - G0, Eqs. (4) to (6).

    Parameters
    ----------
    G0, Ginf
        Relaxed and glassy modulus, 0 < G0 <= Ginf; equal moduli make the material elastic.
    tau
        Relaxation time at constant strain, positive.

    Raises
    ------
    ValueError
        If a parameter is not finite or outside of these bounds.
    """

    G0: float
    Ginf: float
    tau: float

    def __post_init__(self) -> None:
        _require_positive("G0", self.G0)
        _require_positive("tau", self.tau)
        if not self.G0 <= self.Ginf < math.inf:
            raise ValueError(f"Ginf = {self.Ginf!r}: must be finite and at least G0 = {self.G0!r}")

    @property
    def relaxed(self) -> float:
        """Modulus G0."""
        return self.G0

    @property
    def glassy(self) -> float:
        """Modulus Ginf."""
        return self.Ginf

    @property
    def branch_moduli(self) -> NDArray[np.float64]:
        """Ginf - G0, or nothing where the two are equal."""
        return np.array([self.Ginf - self.G0] if self.Ginf > self.G0 else [], dtype=float)

    @property
    def branch_times(self) -> NDArray[np.float64]:
        """The relaxation time tau, or nothing where G0 and Ginf are equal."""
        return np.array([self.tau] if self.Ginf > self.G0 else [], dtype=float)


@dataclass(frozen=True)
class Prony(Material):
    """Generalised Maxwell solid: a Prony series of relaxing branches.

    Parameters
    ----------
    G0
        Relaxed modulus, positive.
    branches
        Pairs (G_k, tau_k): modulus, not negative, and relaxation time, positive. Without any, the material is
        elastic.

    Raises
    ------
    ValueError
        If a parameter is not finite or outside of these bounds.
    """

    G0: float
    branches: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        _require_positive("G0", self.G0)
        for index, (modulus, time) in enumerate(self.branches):
            _require_positive(f"tau of branch {index}", time)
            if not 0 <= modulus < math.inf:
                raise ValueError(f"G of branch {index} = {modulus!r}: must be finite and not negative")

    @property
    def relaxed(self) -> float:
        """Modulus G0."""
        return self.G0

    @property
    def branch_moduli(self) -> NDArray[np.float64]:
        """Moduli of the branches, in the order given."""
        return np.array([modulus for modulus, _ in self.branches], dtype=float)

    @property
    def branch_times(self) -> NDArray[np.float64]:
        """Relaxation times of the branches, in the order given."""
        return np.array([time for _, time in self.branches], dtype=float)


def _require_positive(name: str, value: float) -> None:
    if not 0 < value < math.inf:
        raise ValueError(f"{name} = {value!r}: must be finite and positive")
