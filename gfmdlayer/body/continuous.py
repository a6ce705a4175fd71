"""Laws with a continuous spectrum of relaxation times.

    G(t) = G0 + int H(tau) exp(-t/tau) dln tau,        H >= 0

A simulation replaces them by the Prony series of few branches that keeps to a tolerance (`exponential_sums`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import Field

from gfmdlayer.body.materials import Law, PronySeries, TwoModuli
from gfmdlayer.validation.fields import MustBe, NotNegative, Positive, strict
from gfmdlayer.validation.problems import Mistake

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gfmdlayer.arrays import FloatArray

Exponent = Annotated[float, strict, Field(ge=0.01, le=1), MustBe("a number from 0.01 to 1")]
Tolerance = Annotated[float, strict, Field(ge=1e-6, le=0.1), MustBe("a number from 1e-6 to 0.1")]

# Points of the contour integral, whose error falls by a factor of ten with each, down to rounding.
_POINTS = 32

# Of the rule in ln t for an integrand that is analytic for |arg t| < 45 degrees: error exp(-pi^2/(2 h)).
_SPACING = 0.15

# Branches of a series to 1e-4, over some decades: measured, for estimates of the cost.
_BRANCHES, _DECADES = 15, 4


class ContinuousLaw(Law):
    """A law with a continuous spectrum of relaxation times, replaced by a Prony series."""

    BY_NAME: ClassVar[frozenset[str]] = Law.BY_NAME | {"tolerance"}

    tolerance: Tolerance = 1e-4
    """largest relative error of the Prony series that replaces the law"""

    def creep_compliance(self, t: ArrayLike) -> FloatArray:
        """J(t) by a contour integral of 1/(s G(s))."""
        import numpy as np

        limits = 1 / self.glassy, 1 / self.relaxed if self.relaxed else math.inf
        return _inverse_laplace(lambda s: 1 / np.asarray(self.laplace(s)), t, limits)

    def roughly(self, longest: float) -> tuple[float, tuple[tuple[float, float], ...]]:
        """Return one branch for the relaxation in each part of some decades before the time."""
        times = [longest * 10 ** (-_DECADES * i / _BRANCHES) for i in range(_BRANCHES + 1)]
        moduli = self.relaxation_modulus(times).tolist()
        return moduli[0], tuple(
            (stiffer - softer, math.sqrt(early * late))
            for (softer, late), (stiffer, early) in pairwise(zip(moduli, times, strict=True))
        )

    def prony(self, shortest: float, longest: float, tolerance: float | None = None) -> PronySeries:
        """Return the Prony series that replaces the law, see `exponential_sums.prony_series`."""
        from gfmdlayer.body.exponential_sums import prony_series

        return prony_series(self, shortest, longest, self.tolerance if tolerance is None else tolerance)


class _RelaxingLaw(TwoModuli, ContinuousLaw):
    """A law between two moduli, G(s) = Ginf - (Ginf - G0) R(s tau)."""

    def relaxation_modulus(self, t: ArrayLike) -> FloatArray:
        """G(t) by a contour integral."""
        return _inverse_laplace(self.laplace, t, (self.glassy, self.relaxed))

    def _beside_a_spring(self, longest: float, tolerance: float) -> Self:
        """Return a liquid with a spring that is a part of the tolerance of its slowest modulus."""
        from gfmdlayer.body.exponential_sums import FLOOR

        if self.G0:
            return self
        slowest = abs(complex(self.complex_modulus(1 / longest)))
        return self.model_copy(update={"G0": FLOOR * tolerance * slowest})

    def roughly(self, longest: float) -> tuple[float, tuple[tuple[float, float], ...]]:
        """Return the branches of a solid, or of a liquid beside the spring of its slowest modulus."""
        return super(_RelaxingLaw, self._beside_a_spring(longest, 1.0)).roughly(longest)

    def prony(self, shortest: float, longest: float, tolerance: float | None = None) -> PronySeries:
        """Return the Prony series that replaces the law; its error of a liquid is that beside a spring."""
        tolerance = self.tolerance if tolerance is None else tolerance
        law = self._beside_a_spring(longest, tolerance)
        return super(_RelaxingLaw, law).prony(shortest, longest, tolerance)


class HavriliakNegami(_RelaxingLaw):
    """G(s) = Ginf - (Ginf - G0)/(1 + (s tau)^alpha)^gamma: a relaxation that is broad and skewed.

    After Havriliak & Negami, Polymer 8 (1967) 161-210. alpha = 1 is the law of Davidson and Cole, gamma = 1
    the fractional Zener solid. Its spectrum is not negative for alpha gamma <= 1.

    Examples
    --------
    >>> law = gfmdlayer.HavriliakNegami(G0=1.0, Ginf=1000.0, tau=1.0, alpha=0.7, gamma=0.5)
    >>> loss = law.complex_modulus([0.01, 1.0, 100.0])
    >>> (loss.imag / loss.real).round(2)  # tan delta
    array([1.66, 0.79, 0.12])
    """

    model: Literal["havriliak_negami"] = "havriliak_negami"
    """G(s) = Ginf - (Ginf - G0)/(1 + (s tau)^alpha)^gamma"""
    alpha: Exponent = 0.5
    """exponent of time, below 1 for a broad relaxation"""
    gamma: Positive = 1.0
    """asymmetry of the relaxation, at most 1/alpha"""

    __init__ = Law.__init__

    def problems(self) -> Iterator[Mistake]:
        """Refuse a modulus that grows with time, and an asymmetry without a positive spectrum."""
        yield from super().problems()
        if self.alpha * self.gamma > 1:
            message = f"got {self.gamma!r} with alpha = {self.alpha!r}; must be at most 1/alpha"
            yield Mistake(("gamma",), message, ("alpha",))

    def laplace(self, s: ArrayLike) -> NDArray[Any]:
        """Modulus G(s)."""
        return _havriliak_negami(self, s, self.alpha, self.gamma)


class FractionalZener(_RelaxingLaw):
    """G(s) = G0 + (Ginf - G0) (s tau)^a/(1 + (s tau)^a): a springpot in the place of the Zener dashpot.

    G(t) = G0 + (Ginf - G0) E_a(-(t/tau)^a), with the function of Mittag-Leffler; G(omega) is the law of
    Cole and Cole. See Mainardi, Fractional Calculus and Waves in Linear Viscoelasticity (2010), ch. 3.

    Examples
    --------
    A series of Maxwell branches that is as good as the law over three decades of time:

    >>> law = gfmdlayer.FractionalZener(G0=1.0, Ginf=10.0, tau=1.0, exponent=0.5)
    >>> series = law.prony(shortest=0.01, longest=10.0, tolerance=1e-3)
    >>> len(series.material.maxwell_branches), series.error_in_time < 1e-3
    (7, True)
    >>> body = gfmdlayer.bonded_layer(0.1, series.material, halfspace=1.0)
    """

    model: Literal["fractional_zener"] = "fractional_zener"
    """G(t) = G0 + (Ginf - G0) E(-(t/tau)^exponent), E of Mittag-Leffler"""
    exponent: Exponent = 0.5
    """exponent of time; 1 is a Zener solid"""

    __init__ = Law.__init__

    def laplace(self, s: ArrayLike) -> NDArray[Any]:
        """Modulus G(s)."""
        return _havriliak_negami(self, s, self.exponent, 1.0)


class Kohlrausch(_RelaxingLaw):
    """Stretched exponential G(t) = G0 + (Ginf - G0) exp(-(t/tau)^b).

    After Kohlrausch, Ann. Phys. 167 (1854) 179-214; Williams & Watts, Trans. Faraday Soc. 66 (1970) 80-85.

    Examples
    --------
    >>> gfmdlayer.Kohlrausch(G0=1.0, Ginf=10.0, tau=2.0, exponent=0.5).relaxation_modulus(2.0).round(6)
    np.float64(4.310915)
    """

    model: Literal["kohlrausch"] = "kohlrausch"
    """G(t) = G0 + (Ginf - G0) exp(-(t/tau)^exponent)"""
    exponent: Exponent = 0.5
    """exponent of time; 1 is a Zener solid"""

    __init__ = Law.__init__

    def relaxation_modulus(self, t: ArrayLike) -> FloatArray:
        """Stretched exponential of time."""
        import numpy as np

        decay = np.exp(-((np.asarray(t, dtype=float) / self.tau) ** self.exponent))
        return np.asarray(self.G0 + (self.Ginf - self.G0) * decay)

    def laplace(self, s: ArrayLike) -> NDArray[Any]:
        """G(s) by an integral over rotated times, in which both exponents are within 45 degrees of real."""
        import numpy as np

        s = np.asarray(s)
        z = np.where(s == 0, 1.0, s * self.tau).astype(complex)[..., np.newaxis]
        scale = 1 / (1 + np.abs(z))  # beyond it one of the exponentials falls
        x = np.arange(-40.0, 5.0 / self.exponent + 4.0, _SPACING)
        t = scale * np.exp(x - 0.5j * np.angle(z))
        relaxing = (z * t * np.exp(-z * t - t**self.exponent)).sum(axis=-1) * _SPACING
        G = self.G0 + (self.Ginf - self.G0) * np.where(s == 0, 0.0, relaxing)
        return np.asarray(G if np.iscomplexobj(s) else G.real)


class PowerLaw(ContinuousLaw):
    """G(t) = G0 + G (t/tau)^-a: a springpot, beside a spring if G0 is given.

    G(s) = G0 + G Gamma(1 - a) (s tau)^a. Without a spring nothing is left at long times, and without a limit
    the modulus grows at short ones: the Prony series that replaces it has the relaxed modulus of all branches
    slower than the run, of at least a tenth of the tolerance, and no branch much faster than its steps.

    Examples
    --------
    >>> gfmdlayer.PowerLaw(G=2.0, tau=1.0, exponent=0.5).relaxation_modulus([0.25, 1.0, 4.0])
    array([4., 2., 1.])
    """

    model: Literal["power_law"] = "power_law"
    """G(t) = G0 + G (t/tau)^-exponent"""
    G: Positive = 1.0
    """shear modulus of the springpot at the time tau: pressure"""
    tau: Positive = 1.0
    """time at which the modulus is G0 + G: time"""
    exponent: Annotated[float, strict, Field(ge=0.01, le=0.99), MustBe("a number from 0.01 to 0.99")] = 0.5
    """exponent of time; 0 would be a spring and 1 a dashpot"""
    G0: NotNegative = 0.0
    """relaxed shear modulus of a spring beside it: pressure"""

    __init__ = Law.__init__

    @property
    def relaxed(self) -> float:
        """Modulus G0, which may be zero."""
        return self.G0

    @property
    def unit(self) -> float:
        """Modulus G0, or G where it is zero."""
        return self.G0 or self.G

    @property
    def glassy(self) -> float:
        """Infinite."""
        return math.inf

    @property
    def characteristic_time(self) -> float:
        """Time tau, to which G belongs."""
        return self.tau

    def relaxation_modulus(self, t: ArrayLike) -> FloatArray:
        """Power of time; infinite at t = 0."""
        import numpy as np

        with np.errstate(divide="ignore"):
            return np.asarray(self.G0 + self.G * (np.asarray(t, dtype=float) / self.tau) ** -self.exponent)

    def laplace(self, s: ArrayLike) -> NDArray[Any]:
        """Power of s."""
        import numpy as np

        factor = self.G * math.gamma(1 - self.exponent)
        return np.asarray(self.G0 + factor * (np.asarray(s) * self.tau) ** self.exponent)


def _havriliak_negami(law: _RelaxingLaw, s: ArrayLike, alpha: float, gamma: float) -> NDArray[Any]:
    """Ginf - (Ginf - G0)/(1 + (s tau)^alpha)^gamma without loss of digits as s -> 0."""
    import numpy as np

    # Real and not negative s stay real.
    power = (np.asarray(s) * law.tau) ** alpha
    softened = np.expm1(-gamma * np.log1p(power))
    return np.asarray(law.G0 - (law.Ginf - law.G0) * softened)


def _inverse_laplace(
    G_of: Callable[[NDArray[Any]], NDArray[Any]], t: ArrayLike, limits: tuple[float, float]
) -> FloatArray:
    """G(t) from G(s), which is analytic but for the negative real axis, and its limits at t = 0 and inf."""
    # The integral of exp(s t) G(s)/s over a hyperbola around the axis by the trapezoidal rule, with the
    # parameters of Weideman & Trefethen, Math. Comput. 76 (2007) 1341-1356.
    import numpy as np

    t = np.asarray(t, dtype=float)
    elapsed = np.where((t > 0) & np.isfinite(t), t, 1.0)[..., np.newaxis]
    theta = (np.arange(_POINTS // 2) + 0.5) * (1.08179214 / (_POINTS / 2))
    angle = 1.17210423
    s = 4.49207528 * (_POINTS / 2) * (1 + np.sin(1j * theta - angle))
    slope = 4.49207528 * (_POINTS / 2) * np.cos(1j * theta - angle)
    terms = np.exp(s) * slope / s * G_of(s / elapsed)
    G = terms.real.sum(axis=-1) * (1.08179214 / (_POINTS / 2)) / math.pi
    return np.asarray(np.where(t == 0, limits[0], np.where(np.isinf(t), limits[1], G)))
