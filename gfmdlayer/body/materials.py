"""The shear response of a material, G(t), G(omega) and G(s).

The materials here are a spring of the relaxed modulus beside Maxwell branches (a spring G_k in series with
a dashpot G_k tau_k), so that

    G(t) = G0 + sum_k G_k exp(-t/tau_k)                   Eq. (5) for one branch
    G(s) = G0 + sum_k G_k s tau_k/(1 + s tau_k)           Eq. (4) for one branch, with s = i omega

after Petrenko et al., Materials Physics and Mechanics 52 (2024) 60-68. G(s) is s times the Laplace transform
of G(t), Eq. (2): the modulus that takes an elastic solution to the viscoelastic one. Moduli and times may be
in any units; the results have the same. Laws with a continuous spectrum are replaced by such a series.

A law is a section of the configuration and a Python object at once; `gfmdlayer.body.materials` lists them.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import ConfigDict, Field

from gfmdlayer.body.shifts import SHIFTS, Celsius, Shift
from gfmdlayer.validation.fields import File, NotNegative, Optional, Positive, Word, given
from gfmdlayer.validation.problems import ConfigError, Location, Mistake, dotted
from gfmdlayer.validation.quantities import Written
from gfmdlayer.validation.reading import Reading, unread
from gfmdlayer.validation.sections import Kind, OneOf, Section, alone, plain, sections_in

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gfmdlayer.arrays import ComplexArray, FloatArray


# Shear moduli over moduli of other kinds, at a constant Poisson's ratio.
IN_SHEAR: Mapping[str, Callable[[float], float]] = {
    "shear": lambda _: 1.0,
    "young": lambda poisson: 1 / (2 * (1 + poisson)),
    # At 0.5, where a bulk modulus is refused, any modulus will do.
    "bulk": lambda poisson: 3 * (1 - 2 * poisson) / (2 * (1 + poisson)) or 1.0,
}
_MODULI = ("G", "young", "bulk", "G0", "Ginf")
_AGREE = 1e-6  # relative: moduli of two kinds that agree


def shear_modulus(given: Mapping[str, float], poisson: float) -> float:
    """Return the shear modulus of the first of some moduli, by their keys such as young or young_modulus."""
    (key, value), *_ = given.items()
    return value if value in {0, math.inf} else value * IN_SHEAR[kind_of_modulus(key)](poisson)


def kind_of_modulus(key: str) -> str:
    """Return the kind of modulus that a key such as G, young or young_modulus has."""
    return next((kind for kind in IN_SHEAR if key.startswith(kind)), "shear")


def contradicting(given: Mapping[str, float], poisson: float) -> Iterator[Mistake]:
    """Yield why moduli by their keys do not go together, or not with Poisson's ratio."""
    (first, value), *others = given.items() or [("", 0.0)]
    for key in given:
        if kind_of_modulus(key) == "bulk" and poisson == 0.5:
            yield Mistake((key,), incompressible(key), ("poisson",))
            return
    for key, other in others:
        G, own = shear_modulus({first: value}, poisson), shear_modulus({key: other}, poisson)
        if own != G and not abs(own - G) <= _AGREE * abs(G):
            implied = 0.0 if not G else G / IN_SHEAR[kind_of_modulus(key)](poisson)
            made = f"but {first} = {value!r} and poisson = {poisson!r} make it {implied:.6g}"
            yield Mistake((key,), f"got {other!r}, {made}; remove one of the two", (first, "poisson"))


def incompressible(key: str) -> str:
    """Return why a bulk modulus at Poisson's ratio 0.5 is refused."""
    return f"{key} says nothing of shear where poisson is 0.5; give poisson below 0.5, or another modulus"


class Law(Kind):
    """Shear response of an isotropic solid whose stress relaxes."""

    BY_NAME: ClassVar[frozenset[str]] = frozenset({"model", "moduli", "shift"})  # parameters without position

    model: str
    """word that chooses the law"""
    moduli: Annotated[Annotated[str, Word(*IN_SHEAR)] | None, given] = None
    """kind of its moduli: shear (default), young or bulk, by poisson beside it"""
    shift: Annotated[Shift | None, OneOf(SHIFTS), given] = None
    """shift with the temperature: a mapping with law wlf or arrhenius"""

    _units: tuple[str, str] | None = None  # of moduli and times, in a file that names them

    @alone
    def __init__(self, *values: Any, **keys: Any) -> None:
        """Make a material from its parameters, in the order of the fields or by name; `shift` by name.

        Raises
        ------
        ConfigError
            A parameter is outside of its bounds, or parameters contradict each other.
        """
        self._take(plain(self._named(values, keys)))
        if problems := list(self.problems()):  # in a configuration a sweep may replace the values
            raise ConfigError(map(str, problems))

    @classmethod
    def _in_order(cls) -> tuple[str, ...]:
        """Return the keys whose values need no name, in their order: moduli and times."""
        return tuple(name for name in cls.model_fields if name not in cls.BY_NAME)

    @property
    def in_configurations(self) -> Law:
        """The law as a configuration writes it."""
        return self

    @property
    def units(self) -> tuple[str, str] | None:
        """Units of moduli and times of a law from a file; None once they are those of the configuration."""
        return self._units

    def measured_in(self, stress: str, time: str) -> Self:
        """Return the law, whose moduli and times have these units.

        Parameters
        ----------
        stress, time : str
            Units of moduli and of times, such as MPa and ms.
        """
        law = self.model_copy()
        law._units = stress, time
        return law

    def in_units(self, stress: str, time: str) -> Self:
        """Return a law from a file with moduli and times in these units.

        Parameters
        ----------
        stress, time : str
            Units of moduli and of times, such as MPa and ms.
        """
        from gfmdlayer.files.units import unit_of

        own, other = (
            [unit.size for unit in map(unit_of, pair) if unit]
            for pair in (self._units or (stress, time), (stress, time))
        )
        law = self.scaled(*(float(mine / theirs) for mine, theirs in zip(own, other, strict=True)))
        law._units = None
        return law

    def in_shear(self, poisson: float) -> Law:
        """Return the law with shear moduli, which follow from those of another kind by Poisson's ratio.

        Parameters
        ----------
        poisson : float
            Poisson's ratio of the material, > -1 and <= 0.5.
        """
        if self.moduli is None:
            return self
        law = self.scaled(IN_SHEAR[self.moduli](poisson))
        return law.model_copy(update={"moduli": None})

    def moduli_at(self, poisson: float) -> Iterator[Mistake]:
        """Yield why the shear moduli do not follow from the given ones at a Poisson's ratio.

        Parameters
        ----------
        poisson : float
            Poisson's ratio of the material, > -1 and <= 0.5.
        """
        if self.moduli == "bulk" and poisson == 0.5:
            yield Mistake(("moduli",), incompressible("a bulk modulus"), ("poisson",))

    def scaled(self, modulus: float, time: float = 1.0) -> Self:
        """Return the law with moduli and times multiplied by factors.

        Parameters
        ----------
        modulus : float
            Factor of the moduli.
        time : float
            Factor of the times, 1 by default.
        """
        return self._with(lambda value: value * modulus, lambda value: value * time)

    def written_in(self, stress: str, time: str) -> Self:
        """Return the law whose moduli and times keep their units: configurations in others convert them.

        Parameters
        ----------
        stress, time : str
            Units of moduli and of times, such as MPa and ms.
        """
        return self._with(
            lambda value: Written(value, f"{value!r} {stress}"),
            lambda value: Written(value, f"{value!r} {time}"),
        )

    def _with(self, modulus: Callable[[float], float], time: Callable[[float], float]) -> Self:
        """Return the law with functions of its moduli and times."""
        changes = dict.fromkeys(_MODULI, modulus) | {"tau": time}
        values = {key: vars(self)[key] for key in changes if vars(self).get(key) is not None}
        update: dict[str, Any] = {key: changes[key](value) for key, value in values.items()}
        if branches := getattr(self, "branches", ()):
            update["branches"] = tuple(Branch(G=modulus(G), tau=time(tau)) for G, tau in branches)
        return self.model_copy(update=update)

    @property
    @abstractmethod
    def relaxed(self) -> float:
        """Modulus at long times and low frequencies, G0 >= 0; 0 of a liquid."""

    @property
    def unit(self) -> float:
        """Modulus by which dimensionless pressures are divided: the relaxed one, of a liquid the glassy."""
        return self.relaxed or self.glassy

    @property
    @abstractmethod
    def glassy(self) -> float:
        """Modulus at short times and high frequencies, Ginf; may be infinite."""

    @property
    def characteristic_time(self) -> float | None:
        """The relaxation time of a law that has a single one, else None."""
        return None

    @abstractmethod
    def relaxation_modulus(self, t: ArrayLike) -> FloatArray:
        """Stress after a unit step of strain, over two: G(t), for t >= 0, in the shape of t.

        Parameters
        ----------
        t : array_like
            Times t >= 0 since the step: time.

        Returns
        -------
        ndarray
            G(t) in the shape of t: pressure.
        """

    @abstractmethod
    def creep_compliance(self, t: ArrayLike) -> FloatArray:
        """Strain after a unit step of stress, times two: J(t), for t > 0, in the shape of t.

        Parameters
        ----------
        t : array_like
            Times t > 0 since the step: time.

        Returns
        -------
        ndarray
            J(t) in the shape of t: 1/pressure.
        """

    @abstractmethod
    def laplace(self, s: ArrayLike) -> NDArray[Any]:
        """Modulus G(s) at the Laplace variable s, real or complex with Re s >= 0, in the shape of s.

        Parameters
        ----------
        s : array_like
            Laplace variable, Re s >= 0: 1/time.

        Returns
        -------
        ndarray
            G(s) in the shape of s, real or complex as s is: pressure.
        """

    @abstractmethod
    def prony(self, shortest: float, longest: float, tolerance: float | None = None) -> PronySeries:
        """Return Maxwell branches that respond like this law over a range of times and of 1/omega.

        `tolerance` is the largest relative error of G(t) and of G(omega) there; by default that of the law.

        Parameters
        ----------
        shortest, longest : float
            Range of times over which the series responds like the law: time.
        tolerance : float, optional
            Largest relative error; by default that of the law.
        """

    @abstractmethod
    def roughly(self, longest: float) -> tuple[float, tuple[tuple[float, float], ...]]:
        """Return a relaxed modulus and branches (G_k, tau_k) that estimate the cost of a run up to a time.

        Parameters
        ----------
        longest : float
            Duration of the run: time.
        """

    def complex_modulus(self, omega: ArrayLike) -> ComplexArray:
        """Storage plus i times loss modulus, G(omega) of Eq. (4), in the shape of the angular frequency.

        Parameters
        ----------
        omega : array_like
            Angular frequency: 1/time.

        Returns
        -------
        ndarray
            Complex modulus in the shape of `omega`: pressure.
        """
        import numpy as np

        return self.laplace(1j * np.asarray(omega, dtype=float))


class Material(Law):
    """A law of springs and dashpots: a spring beside Maxwell branches.

    A class of your own has a field `model`, its parameters, `relaxed` and `maxwell_branches`; runs take it as
    the Prony series that it is.

    Examples
    --------
    The modes of a Rouse chain:

    >>> from typing import Literal
    >>> class Rouse(gfmdlayer.Material):
    ...     model: Literal["rouse"] = "rouse"
    ...     G: float
    ...     tau: float
    ...     relaxed = property(lambda self: 1e-3 * self.G)
    ...     maxwell_branches = property(lambda self: tuple((self.G, self.tau / k**2) for k in range(1, 6)))
    >>> Rouse(G=1.0, tau=2.0).glassy
    5.001
    """

    __init__ = Law.__init__

    @property
    @abstractmethod
    def maxwell_branches(self) -> tuple[tuple[float, float], ...]:
        """Pairs (G_k, tau_k) of the Maxwell branches: modulus G_k >= 0 and relaxation time tau_k > 0."""

    @property
    def in_configurations(self) -> Law:
        """A law of the session's own class as its Prony series, which is the same law."""
        if type(self).__module__.startswith("gfmdlayer."):
            return self
        return Prony(self.relaxed, self.maxwell_branches, **({"shift": self.shift} if self.shift else {}))

    @property
    def branch_moduli(self) -> FloatArray:
        """Moduli G_k >= 0 of the Maxwell branches, shape (branches,)."""
        import numpy as np

        return np.array([modulus for modulus, _ in self.maxwell_branches], dtype=float)

    @property
    def branch_times(self) -> FloatArray:
        """Relaxation times tau_k > 0 of the Maxwell branches at constant strain, shape (branches,)."""
        import numpy as np

        return np.array([time for _, time in self.maxwell_branches], dtype=float)

    @property
    def glassy(self) -> float:
        """Modulus at short times and high frequencies, Ginf = G0 + sum_k G_k."""
        return self.relaxed + math.fsum(modulus for modulus, _ in self.maxwell_branches)

    @property
    def elastic(self) -> bool:
        """Whether nothing relaxes."""
        return not any(modulus for modulus, _ in self.maxwell_branches)

    def relaxation_modulus(self, t: ArrayLike) -> FloatArray:
        """Stress after a unit step of strain, over two: G(t) of Eq. (5), for t >= 0, in the shape of t."""
        import numpy as np

        elapsed = np.asarray(t, dtype=float)[..., np.newaxis]
        relaxing = self.branch_moduli * np.exp(-elapsed / self.branch_times)
        return np.asarray(self.relaxed + relaxing.sum(axis=-1))

    def creep_compliance(self, t: ArrayLike) -> FloatArray:
        """J(t) = 1/Ginf + sum of J_k (1 - exp(-t/theta_k)), by the retardation times theta_k."""
        import numpy as np

        from gfmdlayer.body.relaxation import distinct_branches, retardation_spectrum

        elapsed = np.asarray(t, dtype=float)
        moduli, times = distinct_branches(self)
        if not moduli.size:
            return np.full(elapsed.shape, 1 / self.glassy)
        # A liquid beside a spring that it does not feel: its longest retardation time is far beyond t.
        spring = self.relaxed or _UNFELT * float(moduli @ times) / max(
            float(elapsed.max(initial=0.0)), float(times[-1])
        )
        compliances, thetas = retardation_spectrum(moduli, times, np.array([spring]))
        retarded = compliances[:, 0] * -np.expm1(-elapsed[..., np.newaxis] / thetas[:, 0])
        return np.asarray(1 / self.glassy + retarded.sum(axis=-1))

    def laplace(self, s: ArrayLike) -> NDArray[Any]:
        """Modulus G(s) at the Laplace variable s, real or complex, in the shape of s."""
        import numpy as np

        cycles = np.asarray(s)[..., np.newaxis] * self.branch_times
        return np.asarray(self.relaxed + (self.branch_moduli * (cycles / (1 + cycles))).sum(axis=-1))

    def roughly(self, longest: float) -> tuple[float, tuple[tuple[float, float], ...]]:
        """Return the modulus and the branches of the series."""
        return self.relaxed or self._slowest(longest), self.maxwell_branches

    def prony(self, shortest: float, longest: float, tolerance: float | None = None) -> PronySeries:  # noqa: ARG002
        """Return the material itself, which is a series; a liquid with a spring that no run feels."""
        if self.relaxed:
            return PronySeries(self, shortest, longest)
        spring = LEAST_SPRING * self._slowest(longest)
        return PronySeries(
            Prony(spring, self.maxwell_branches), shortest, longest, LEAST_SPRING, LEAST_SPRING
        )

    def _slowest(self, longest: float) -> float:
        """Modulus of a liquid against the slowest loads up to a time: viscosity over time, if long."""
        return abs(complex(self.complex_modulus(1 / longest)))


@dataclass(frozen=True)
class PronySeries:
    """A series of Maxwell branches in place of a law."""

    material: Material  # the series
    shortest: float  # range of times, and of the reciprocals of angular frequencies, in which the bounds hold
    longest: float
    # Bound on |error of G(t)|/G(t); of a liquid, over the sum of G(t) and its slowest modulus.
    error_in_time: float = 0.0
    error_in_frequency: float = 0.0  # bound on |error of G(omega)|/|G(omega)|

    def slowed(self, factor: float) -> PronySeries:
        """Return the series with all times multiplied by a factor."""
        if factor == 1:
            return self
        branches = tuple((G, factor * tau) for G, tau in self.material.maxwell_branches)
        times = {"shortest": factor * self.shortest, "longest": factor * self.longest}
        return replace(self, material=Prony(self.material.relaxed, branches), **times)


# Laws of a spring beside Maxwell branches: elastic, Zener, Prony.

_UNFELT = 1e-13  # relative to the viscosity of a liquid over the time
LEAST_SPRING = 1e-10  # of a liquid, relative to its modulus against the slowest loads of a run


class Elastic(Material):
    """An elastic solid of modulus G.

    Examples
    --------
    >>> gfmdlayer.Elastic(3.0).relaxation_modulus([0.0, 1.0])
    array([3., 3.])
    """

    BY_NAME: ClassVar[frozenset[str]] = Law.BY_NAME | {"young", "bulk"}

    model: Literal["elastic"] = "elastic"
    """G(t) = G at all times"""
    young: Optional = None
    """Young's modulus, in place of G, by poisson beside it: pressure"""
    bulk: Optional = None
    """bulk modulus, in place of G, by poisson beside it: pressure"""
    G: Optional = Field(
        default_factory=lambda data: 1.0 if data.get("young") is None and data.get("bulk") is None else None
    )
    """shear modulus: pressure"""

    __init__ = Material.__init__

    @property
    def _given(self) -> dict[str, float]:
        moduli = {"G": self.G, "young": self.young, "bulk": self.bulk}
        return {key: value for key, value in moduli.items() if value is not None}

    def problems(self) -> Iterator[Mistake]:
        """Refuse a kind of the moduli beside keys that have their own."""
        if self.moduli is not None and {*self._given} != {"G"}:
            yield Mistake(("moduli",), "given beside young or bulk; remove it", ("young", "bulk"))

    def in_shear(self, poisson: float) -> Law:
        """Return the solid with G alone."""
        if self.G is not None:
            return super().in_shear(poisson)
        update = {"G": shear_modulus(self._given, poisson), "young": None, "bulk": None}
        return self.model_copy(update=update)

    def moduli_at(self, poisson: float) -> Iterator[Mistake]:
        """Yield moduli that contradict each other."""
        yield from super().moduli_at(poisson)
        yield from contradicting(self._given, poisson)

    @property
    def relaxed(self) -> float:
        """Modulus G; the modulus that is given, of a solid on its own."""
        return next(iter(self._given.values()))

    @property
    def maxwell_branches(self) -> tuple[tuple[float, float], ...]:
        """No branch."""
        return ()


class TwoModuli(Law):
    """A law that relaxes from the modulus Ginf to G0, in times around tau."""

    G0: NotNegative = 1.0
    """relaxed shear modulus, for slow loads; 0: a liquid: pressure"""
    Ginf: Positive = 10.0
    """instantaneous shear modulus, for fast loads: pressure"""
    tau: Positive = 1.0
    """relaxation time: time"""

    __init__ = Law.__init__

    def problems(self) -> Iterator[Mistake]:
        """Refuse a modulus that grows with time."""
        if self.Ginf < self.G0:
            allowed = "must be a number >= G0 (relaxation softens)"
            yield Mistake(("Ginf",), f"got {self.Ginf!r}, below G0 = {self.G0!r}; {allowed}", ("G0",))

    @property
    def relaxed(self) -> float:
        """Modulus G0."""
        return self.G0

    @property
    def glassy(self) -> float:
        """Modulus Ginf."""
        return self.Ginf

    @property
    def characteristic_time(self) -> float:
        """Relaxation time tau."""
        return self.tau


class Zener(TwoModuli, Material):
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
    tau: Positive = 1.0
    """relaxation time at constant strain: time"""

    __init__ = Law.__init__

    @property
    def maxwell_branches(self) -> tuple[tuple[float, float], ...]:
        """The branch (Ginf - G0, tau), or nothing where the two moduli are equal."""
        return ((self.Ginf - self.G0, self.tau),) if self.Ginf > self.G0 else ()


class Branch(Section):
    """One term G exp(-t/tau) of a Prony series."""

    G: NotNegative
    """shear modulus of the branch: pressure"""
    tau: Positive
    """relaxation time of the branch: time"""

    def __iter__(self) -> Iterator[float]:  # type: ignore[override]
        """Unpack as a pair: G, tau = branch."""
        return iter((self.G, self.tau))


def _is_pair(branch: object) -> bool:
    return not isinstance(branch, str | Mapping) and hasattr(branch, "__len__") and len(branch) == 2


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
    G0: NotNegative = 1.0
    """relaxed shear modulus; 0: a liquid: pressure"""
    branches: tuple[Branch, ...] = ()
    """a list of {G: ..., tau: ...}, G >= 0 and tau > 0; elastic without any"""

    @alone
    def __init__(self, G0: float = 1.0, branches: Iterable[Any] = (), **keys: Any) -> None:
        if not isinstance(branches, str | Mapping) and isinstance(branches, Iterable):
            branches = [
                dict(zip(("G", "tau"), each, strict=True)) if _is_pair(each) else each for each in branches
            ]
        super().__init__(G0, branches, **keys)

    def problems(self) -> Iterator[Mistake]:
        """Refuse a series without a modulus."""
        if not self.glassy:
            yield Mistake(("G0",), "got 0 without a branch; must be > 0, or with branches", ("branches",))

    @property
    def relaxed(self) -> float:
        """Modulus G0."""
        return self.G0

    @property
    def maxwell_branches(self) -> tuple[tuple[float, float], ...]:
        """Moduli and relaxation times of the branches, in the order given."""
        return tuple((G, tau) for G, tau in self.branches)


# The temperature of the body, and whether the laws of its materials have a shift for it.


class Temperature(Section):
    """Temperature of the whole body, which shifts the relaxation times of materials with a `shift`."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": ["value"]}, {"required": ["file"]}]})

    value: Annotated[Celsius | None, given] = None
    """temperature at all times: degrees Celsius"""
    file: Annotated[File | None, given] = None
    """two columns, time and temperature (degrees Celsius), in place of value"""
    reading: Annotated[Reading | None, given] = None
    """how the file is read, where it does not say so"""

    def problems(self) -> Iterator[Mistake]:
        """Refuse both and neither."""
        if self.value is None and self.file is None:
            yield Mistake((), "has neither value nor file; must be {value: ...} or {file: ...}")
        if self.value is not None and self.file is not None:
            message = "given beside value; remove one of the two"
            yield Mistake(("file",), message, ("value",), because="physics")
        yield from unread(self, "file")


def shifts(config: Section) -> dict[Location, Shift | None]:
    """Return the shifts of all materials of a configuration that relax, by the location of the material."""
    laws = ((at, law) for at, law in sections_in(config) if isinstance(law, Law))
    return {at: law.shift for at, law in laws if not (isinstance(law, Material) and law.elastic)}


def temperature_problems(
    config: Section, temperature: Temperature | None, one_reduced_time: Mapping[str, str]
) -> Iterator[Mistake]:
    """Yield why a temperature and the shifts of materials do not go together.

    `one_reduced_time` has the keys that need one reduced time of the whole body, and what they describe.
    """
    if temperature is None:
        for at, law in sections_in(config):
            if isinstance(law, Law) and law.shift is not None:
                message = "only with a temperature; remove it or set temperature"
                yield Mistake((*at, "shift"), message, ("temperature",))
        return
    by_place = shifts(config)
    others = tuple(dotted(at) for at in by_place)
    differs = next((at for at, shift in by_place.items() if shift != next(iter(by_place.values()))), None)
    if not any(by_place.values()):
        message = "no material that relaxes has a shift; remove it or give a shift"
        yield Mistake(("temperature",), message, others)
    elif not all(by_place.values()):
        at = next(at for at, shift in by_place.items() if shift is None)
        message = "missing; all materials that relax must have a shift, or none"
        yield Mistake((*at, "shift"), message, others)
    elif differs is not None and temperature.file is not None and one_reduced_time:
        message = (
            "differs from the shifts of other materials, while the temperature changes: "
            f"{' and '.join(one_reduced_time.values())} must have one reduced time in the whole body; give "
            "the same shift, or a constant temperature.value"
        )
        yield Mistake(
            (*differs, "shift"), message, (*others, "temperature", *one_reduced_time), because="open"
        )
    if temperature.value is not None:
        for at, shift in by_place.items():
            if shift is not None and (refused := shift.refused(temperature.value)):
                yield Mistake(("temperature", "value"), refused, (f"{dotted(at)}.shift",))
