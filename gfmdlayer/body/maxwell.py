"""Laws of a spring beside Maxwell branches: elastic, Zener, Prony."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal

from gfmdlayer.body.materials import Material
from gfmdlayer.validation.fields import NotNegative, Positive
from gfmdlayer.validation.problems import Problem
from gfmdlayer.validation.sections import Section, alone


class Elastic(Material):
    """An elastic solid of modulus G.

    Examples
    --------
    >>> gfmdlayer.Elastic(3.0).relaxation_modulus([0.0, 1.0])
    array([3., 3.])
    """

    model: Literal["elastic"] = "elastic"
    """G(t) = G at all times"""
    G: Positive = 1.0
    """shear modulus: pressure"""

    __init__ = Material.__init__

    @property
    def relaxed(self) -> float:
        """Modulus G."""
        return self.G

    @property
    def maxwell_branches(self) -> tuple[tuple[float, float], ...]:
        """No branch."""
        return ()


class Zener(Material):
    """Standard linear solid, Eq. (5): G(t) = G0 + (Ginf - G0) exp(-t/tau).

    One branch of modulus Ginf - G0, Eqs. (4) to (6). Equal moduli make the material elastic.

    Examples
    --------
    >>> material = gfmdlayer.Zener(G0=1.0, Ginf=10.0, tau=2.0)
    >>> material.relaxation_modulus([0.0, 2.0])
    array([10.        ,  4.31091497])
    >>> gfmdlayer.Config(name="a", layer={"material": material}).layer.material.tau
    2.0
    """

    model: Literal["zener"] = "zener"
    """G(t) = G0 + (Ginf - G0) exp(-t/tau)"""
    G0: Positive = 1.0
    """relaxed shear modulus, for slow loads: pressure"""
    Ginf: Positive = 10.0
    """instantaneous shear modulus, for fast loads: pressure"""
    tau: Positive = 1.0
    """relaxation time at constant strain: time"""

    __init__ = Material.__init__

    def problems(self) -> Iterator[Problem]:
        """Refuse a modulus that grows with time."""
        if self.Ginf < self.G0:
            allowed = "must be a number >= G0 (relaxation softens)"
            yield Problem(("Ginf",), f"got {self.Ginf!r}, below G0 = {self.G0!r}; {allowed}", ("G0",))

    @property
    def relaxed(self) -> float:
        """Modulus G0."""
        return self.G0

    @property
    def glassy(self) -> float:
        """Modulus Ginf."""
        return self.Ginf

    @property
    def maxwell_branches(self) -> tuple[tuple[float, float], ...]:
        """The branch (Ginf - G0, tau), or nothing where the two moduli are equal."""
        return ((self.Ginf - self.G0, self.tau),) if self.Ginf > self.G0 else ()

    @property
    def characteristic_time(self) -> float:
        """Relaxation time tau."""
        return self.tau


class Branch(Section):
    """One term G exp(-t/tau) of a Prony series."""

    G: NotNegative
    """shear modulus of the branch: pressure"""
    tau: Positive
    """relaxation time of the branch: time"""

    def __iter__(self) -> Iterator[float]:  # type: ignore[override]
        """Unpack as a pair: G, tau = branch."""
        return iter((self.G, self.tau))


class Prony(Material):
    """Prony series G(t) = G0 + sum of G exp(-t/tau) over the branches; G0 is the relaxed modulus.

    Made alone, it takes its branches as pairs (G, tau). Without any the material is elastic.

    Examples
    --------
    >>> gfmdlayer.Prony(1.0, [(2.0, 0.1), (3.0, 10.0)]).glassy
    6.0
    """

    model: Literal["prony"] = "prony"
    """G(t) = G0 + sum of G exp(-t/tau) over the branches"""
    G0: Positive = 1.0
    """relaxed shear modulus: pressure"""
    branches: tuple[Branch, ...] = ()
    """a list of {G: ..., tau: ...}, G >= 0 and tau > 0; elastic without any"""

    @alone
    def __init__(self, G0: float = 1.0, branches: Iterable[Any] = (), **keys: Any) -> None:
        made = [
            each if isinstance(each, Mapping) else dict(zip(("G", "tau"), each, strict=True))
            for each in branches
        ]
        super().__init__(G0, tuple(made), **keys)

    @property
    def relaxed(self) -> float:
        """Modulus G0."""
        return self.G0

    @property
    def maxwell_branches(self) -> tuple[tuple[float, float], ...]:
        """Moduli and relaxation times of the branches, in the order given."""
        return tuple((G, tau) for G, tau in self.branches)
