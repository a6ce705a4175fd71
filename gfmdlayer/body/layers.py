"""Layers on a halfspace: one object from the configuration to the modes of a run.

A single layer on an elastic base has closed forms (`closed_form`); others are stacks (`stack`), which take
some 50 times as long. Configurations are read without numpy, so that methods import the formulas.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from itertools import accumulate
from numbers import Real
from operator import is_
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import PrivateAttr

from gfmdlayer.body.layer import Halfspace, Layer, StackedLayer
from gfmdlayer.body.materials import Elastic, Law, Material
from gfmdlayer.body.solid import LayerDepth, Relaxation, Solid
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import ConfigError, Mistake, shown
from gfmdlayer.validation.sections import alone

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gfmdlayer.body.closed_form import LayeredHalfspace
    from gfmdlayer.body.network import InternalVariables, Network
    from gfmdlayer.body.relaxation import Spectrum, TractionSpectrum
    from gfmdlayer.body.wavevectors import Wavevectors


class Layers(Solid):
    """A stack of viscoelastic layers bonded to one another.

    In a configuration the keys layer, layers and halfspace beside `body` are its parts.

    Parameters
    ----------
    layers : sequence of Layer
        From the surface down; the last is infinitely thick where the stack lies on a halfspace.
    rigid : bool
        Whether the last layer of finite thickness is bonded to a rigid base; else its lower face is free.
    accuracy : float
        Relative error of K(q, s) up to which modes of the spectrum are merged; 0 keeps all. The closed forms
        of a single layer need no merging.
    halfspace : Halfspace, optional
        The halfspace below the layers by its keys, in place of `rigid`.

    Raises
    ------
    ValueError
        If there is no layer of a thickness, or an infinite one above another.

    Examples
    --------
    >>> film = gfmdlayer.Layer(0.01, 0.4, gfmdlayer.Prony(5.0))
    >>> base = gfmdlayer.Layer(np.inf, 0.5, gfmdlayer.Zener(G0=1.0, Ginf=10.0, tau=1.0))
    >>> body = gfmdlayer.LayerStack((film, base))
    >>> found = gfmdlayer.solve(body, gfmdlayer.Parabola(radius=0.25), depth=0.005, points=256)
    >>> bool(found.force > gfmdlayer.solve(gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=0.25),
    ...                                    depth=0.005, points=256).force)
    True
    """

    isolated: ClassVar[bool] = True

    kind: Literal["layers"] = "layers"
    """layers on a halfspace: the keys layer, layers and halfspace beside body"""

    # Not fields: the configuration has their keys beside `body`.
    _above: tuple[Layer, ...] = ()
    _base: Halfspace = PrivateAttr(default_factory=Halfspace)
    _accuracy: float = 0.0

    @entry(base="halfspace")
    @alone
    def __init__(
        self,
        layers: Sequence[Layer] = (),
        rigid: bool = False,
        accuracy: float = 0.0,
        *,
        halfspace: Halfspace | None = None,
    ) -> None:
        self._take({})
        if not (isinstance(layers, Sequence) and all(isinstance(each, Layer) for each in layers)):
            allowed = "must be a list of Layer(thickness, poisson, material), from the surface down"
            raise ConfigError([f"layers: got {shown(layers)}; {allowed}"])
        self._above, self._accuracy = tuple(layer.in_shear for layer in layers), accuracy
        if halfspace is None:  # else the configuration has been checked
            _check(self._above, rigid=rigid)
            halfspace = Halfspace(shear_modulus=math.inf if rigid else 0.0)
        self._base = halfspace.in_shear

    @classmethod
    @lru_cache(maxsize=16)  # sections never change, and a case asks for its body some twenty times
    def of(cls, layers: tuple[Layer, ...], base: Halfspace) -> Layers:
        """Return the body of the sections of a configuration, made once."""
        return cls(layers, halfspace=base)

    def with_series(self, materials: Sequence[Material], accuracy: float) -> Layers:
        """Return the layers with a series for each of `laws`; a stack merges its modes to the accuracy."""
        own = tuple(map(Layer.with_law, self._above, materials))  # the last is the halfspace's, if it has one
        base = self._base if self._base.material is None else self._base.with_law(materials[-1])
        merges_alike = accuracy == self._accuracy or self.closed_form is not None
        if merges_alike and base is self._base and all(map(is_, own, self._above)):
            return self
        return Layers(own, accuracy=accuracy, halfspace=base)

    # The parts.

    @property
    def above(self) -> tuple[Layer, ...]:
        """The layers from the surface down, without the halfspace `base`."""
        return self._above

    @property
    def base(self) -> Halfspace:
        """The halfspace below."""
        return self._base

    @property
    def accuracy(self) -> float:
        """Relative error of K(q, s) up to which modes are merged."""
        return self._accuracy if self.closed_form is None else 0.0

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        """The layers from the surface down; a halfspace that deforms is the last, of infinite thickness."""
        base, law = self._base, self._base.material
        if self._above and math.isinf(self._above[-1].thickness):
            return self._above
        if law is None:
            if not base.shear_modulus or math.isinf(base.shear_modulus):
                return self._above
            law = Elastic(base.shear_modulus)
        return (*self._above, Layer(math.inf, base.poisson, law))

    @cached_property
    def present(self) -> tuple[Layer, ...]:
        """Those of `layers` that have a thickness."""
        return tuple(layer for layer in self.layers if layer.thickness)

    @property
    def rigid(self) -> bool:
        """Whether the last layer is bonded to a rigid base."""
        return self._base.shear_modulus == math.inf and math.isfinite(self._above[-1].thickness)

    @cached_property
    def closed_form(self) -> LayeredHalfspace | None:
        """The closed form of a single layer on an elastic base; None for a stack."""
        from gfmdlayer.body.closed_form import LayeredHalfspace

        base, law = self._base, self._base.material
        relaxes = not (law is None or (isinstance(law, Material) and law.elastic))
        if len(self._above) != 1 or relaxes:
            return None
        (only,), modulus = self._above, base.shear_modulus if law is None else law.relaxed
        assert modulus is not None
        return LayeredHalfspace(only.thickness, only.poisson, modulus, base.poisson)

    @cached_property
    def _identity(self) -> tuple[object, ...]:
        """Equal for bodies of equal response, however their keys were given."""
        every = tuple((layer.thickness, layer.poisson, layer.material) for layer in self.layers)
        return every, self.rigid, self.accuracy, self.closed_form is None

    def __eq__(self, other: object) -> bool:
        """Whether two bodies have an equal response."""
        return self is other or (isinstance(other, Layers) and self._identity == other._identity)

    def __hash__(self) -> int:
        return hash(self._identity)

    def __repr_args__(self) -> Iterator[tuple[str, object]]:
        """Show the layers."""
        yield from (("layers", self.layers), ("rigid", self.rigid), ("accuracy", self.accuracy))

    def keys(self) -> dict[str, Any]:
        """Return the keys of a configuration with these layers, which stand beside `body`."""
        every = [layer.model_dump(exclude_none=True) for layer in self._above]
        above = {"layer": every[0]} if len(every) == 1 else {"layers": every}
        return above | {"halfspace": self._base.model_dump(exclude_none=True)}

    def model_dump(self, **options: Any) -> dict[str, Any]:
        """Return the keys below `body`; ConfigError for layers made in Python, whose keys stand beside it.

        Parameters
        ----------
        **options
            Those of `pydantic.BaseModel.model_dump`.
        """
        if self._above:
            name = type(self).__name__
            message = "must be the keys layer, or layers, and halfspace here"
            raise ConfigError([f"body: got {name}; {message}"])
        return super().model_dump(**options)

    # The response, see `Body`.

    @property
    def mean_stiffness(self) -> float:
        """K(q = 0, s = 0): not 0 for layers on a rigid base of which one is compressible."""
        # Of a law that relaxes to zero, by its unit.
        if self.closed_form is not None:
            return self.closed_form.mean_stiffness * self._above[0].material.unit
        from gfmdlayer.body.stack import confined_compliance

        whole = sum(confined_compliance(self, layer) / layer.material.unit for layer in self.present)
        return 1 / whole if whole else 0.0

    def stiffness(self, waves: Wavevectors | ArrayLike, s: ArrayLike) -> NDArray[Any]:
        """Return K(q, s), stress per displacement."""
        from gfmdlayer.body import stack

        if self.closed_form is not None:
            return self.closed_form.stiffness(waves, self._above[0].material.laplace(s))
        return stack.stiffness(self, waves, s)

    def spectrum(self, waves: Wavevectors | ArrayLike) -> Spectrum:
        """Return the relaxing modes: `relaxed`, `glassy`, `times` and `weights`."""
        from gfmdlayer.body import stack
        from gfmdlayer.body.closed_form import relaxation_spectrum

        if self.closed_form is not None:
            return relaxation_spectrum(self.closed_form, self._above[0].series, waves)
        return stack.spectrum(self, waves)

    def traction_spectrum(self, waves: Wavevectors | ArrayLike) -> TractionSpectrum:
        """Return the relaxing modes under tractions in all directions, see `stack.traction_spectrum`.

        Parameters
        ----------
        waves : Wavevectors or array_like
            Wavevectors of any shape, or their magnitudes (1/length), which mean waves along x.
        """
        from gfmdlayer.body import stack

        return stack.traction_spectrum(self, waves)

    def network(self, q: ArrayLike) -> Network:
        """Return the network of springs and dashpots at the wavenumbers q, shape (nq,).

        Parameters
        ----------
        q : array_like, shape (nq,)
            Wavenumbers: 1/length.
        """
        from gfmdlayer.body import stack

        return stack.network_of(self, q)

    def internal_variables(self, waves: Wavevectors | ArrayLike) -> InternalVariables:
        """Return the internal variables of layers with reduced times of their own.

        Parameters
        ----------
        waves : Wavevectors or array_like
            Wavevectors of any shape, or their magnitudes (1/length), which mean waves along x.
        """
        from gfmdlayer.body import stack

        return stack.internal_variables(self, waves)

    # Properties for configurations, see `Solid`.

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """The laws of the layers from the surface down, and of the halfspace where it has one."""
        base = self._base.material
        return (*(layer.material for layer in self._above), *(() if base is None else (base,)))

    def roughly(self, longest: float) -> tuple[Relaxation, ...]:
        """Return the relaxation of each material of which there is any: no layer without thickness."""
        felt = [layer.material for layer in self._above if layer.thickness]
        if self._base.material is not None and math.inf not in self.thicknesses:
            felt.append(self._base.material)
        return tuple(law.roughly(longest) for law in felt) or ((self._base.shear_modulus or self.unit, ()),)

    @property
    def moduli(self) -> tuple[float, ...]:
        """Finite moduli of the layers and the halfspace."""
        base = self._base.shear_modulus
        return (*super().moduli, *((base,) if base and math.isfinite(base) else ()))

    @property
    def thicknesses(self) -> tuple[float, ...]:
        """Thicknesses of the layers from the surface down."""
        return tuple(layer.thickness for layer in self._above)

    @property
    def rigid_below(self) -> float:
        """Depth of a rigid base; inf where there is none."""
        return sum(self.thicknesses) if self._base.shear_modulus == math.inf else math.inf

    @property
    def contact_modulus(self) -> float | None:
        """E* = 2 G/(1 - nu) of the uppermost material; where it relaxes to zero, by the unit of its law."""
        return next((2 * layer.material.unit / (1 - layer.poisson) for layer in self.present), None)

    @property
    def merges(self) -> bool:
        """Whether the body is a stack, whose modes are merged."""
        several = len(self._above) > 1 or any(isinstance(layer, StackedLayer) for layer in self._above)
        return several or self._base.material is not None

    @property
    def flows(self) -> bool:
        """Whether nothing below holds a load: a liquid halfspace, or a free stack of liquids."""
        lowest = self.present[-1:] if self.layers and math.isinf(self.layers[-1].thickness) else ()
        if self._base.shear_modulus == 0 and not lowest:
            lowest = self.present
        return bool(lowest) and not any(layer.material.relaxed for layer in lowest)

    def problems_isolated(self) -> Iterator[Mistake]:
        """Refuse layers without a base."""
        if self._base.shear_modulus == 0 and math.isfinite(sum(self.thicknesses)):
            message = "got 0: a layer without a base does not support an isolated load; must be > 0"
            others = ("layer.thickness", "layers")
            yield Mistake(("halfspace", "shear_modulus"), message, others, because="physics")


def _check(layers: Sequence[Layer], *, rigid: bool) -> None:
    """Raise ConfigError for layers that are no body."""
    if not any(layer.thickness for layer in layers):
        raise ConfigError(["layers: must hold at least one with a thickness > 0"])
    for i, layer in enumerate(layers[:-1]):
        if math.isinf(layer.thickness):
            raise ConfigError([f"layers[{i}].thickness = inf: only the last layer can be a halfspace"])
    if rigid and math.isinf(layers[-1].thickness):
        raise ConfigError(["rigid: the last layer is a halfspace, which has no base"])


def thicknesses(body: Layers) -> list[float]:
    """Return the thicknesses of the layers that a body has, from the surface down; inf: a halfspace."""
    return [layer.thickness for layer in body.present]


def interfaces(body: Layers) -> list[LayerDepth]:
    """Return the interfaces between layers, and the bond to a rigid base, from the side above each."""
    layers = thicknesses(body)
    bonded = layers if body.base.shear_modulus == math.inf else layers[:-1]
    return [LayerDepth(depth, i) for i, depth in enumerate(accumulate(bonded)) if math.isfinite(depth)]


# Bodies made in Python.

LayerStack = Layers


class ViscoelasticLayer(Layers):
    """A viscoelastic layer bonded to an elastic halfspace; `bonded_layer` and `halfspace` make one.

    Parameters
    ----------
    layer : LayeredHalfspace
        Thickness, Poisson's ratios and halfspace.
    material : Law
        Shear response of the layer.

    Examples
    --------
    >>> body = gfmdlayer.ViscoelasticLayer(gfmdlayer.LayeredHalfspace(0.1, 0.5, 1.0), gfmdlayer.Zener())
    >>> body.spectrum([1.0, 10.0]).times.shape  # modes, wavenumbers
    (3, 2)
    """

    @entry()
    @alone
    def __init__(self, layer: LayeredHalfspace, material: Law) -> None:
        base = Halfspace(shear_modulus=layer.bulk_modulus, poisson=layer.bulk_poisson)
        super().__init__((Layer(layer.thickness, layer.poisson, material),), halfspace=base)

    @property
    def layer(self) -> LayeredHalfspace:
        """Thickness, Poisson's ratios and halfspace."""
        assert self.closed_form is not None
        return self.closed_form

    @property
    def material(self) -> Law:
        """Shear response of the layer."""
        return self._above[0].material


@entry(base="halfspace", base_poisson="halfspace_poisson")
def bonded_layer(
    thickness: float,
    material: Law | Mapping[str, Any] | float | None = None,
    *,
    G: float | None = None,
    young: float | None = None,
    poisson: float = 0.5,
    halfspace: float = math.inf,
    halfspace_poisson: float = 0.5,
) -> ViscoelasticLayer:
    """Return a layer bonded to a halfspace, as a body for `solve`, `indent`, `run` and plots.

    Parameters
    ----------
    thickness : float
        d, from 0 (the bare halfspace) to inf (a halfspace of the material).
    material : Law, mapping or float
        Law of the layer, its keys, or its shear modulus where it is elastic.
    G, young : float
        In place of `material`: shear modulus, or Young's modulus, of an elastic layer.
    poisson : float
        Poisson's ratio of the layer.
    halfspace : float
        Shear modulus of the halfspace below: inf is a rigid base, 0 leaves the layer free.
    halfspace_poisson : float
        Poisson's ratio of the halfspace below.

    Returns
    -------
    ViscoelasticLayer
        A body for all functions that take one.

    Raises
    ------
    ConfigError
        If a parameter is outside of its bounds.

    Examples
    --------
    The stiffness K(q, s), stress over displacement, of a layer under slow and under fast loads:

    >>> body = gfmdlayer.bonded_layer(0.1, gfmdlayer.Zener(G0=1.0, Ginf=10.0, tau=2.0), halfspace=1.0)
    >>> q = np.array([1.0, 10.0, 100.0])
    >>> body.stiffness(q, 0.0) / q  # on a halfspace it is 2 G q
    array([2., 2., 2.])
    >>> bool(np.allclose(body.stiffness(q, 1e12), body.spectrum(q).glassy))
    True

    Its relaxing modes, three for a branch of the material, at each wavenumber:

    >>> body.spectrum(q).times.shape, body.spectrum(q).weights.shape
    ((3, 3), (3, 3))
    """
    from gfmdlayer.body.closed_form import LayeredHalfspace

    law = _law_given(material, {"G": G, "young": young})
    return ViscoelasticLayer(LayeredHalfspace(thickness, poisson, halfspace, halfspace_poisson), law)


@entry()
def halfspace(
    material: Law | Mapping[str, Any] | float | None = None,
    *,
    G: float | None = None,
    young: float | None = None,
    poisson: float = 0.5,
) -> ViscoelasticLayer:
    """Return a halfspace as a body.

    Parameters
    ----------
    material : Law, mapping or float
        Law of the halfspace, its keys, or its shear modulus where it is elastic.
    G, young : float
        In place of `material`: shear modulus, or Young's modulus, of an elastic halfspace.
    poisson : float
        Poisson's ratio.

    Returns
    -------
    ViscoelasticLayer
        A body for all functions that take one.

    Raises
    ------
    ConfigError
        If a parameter is outside of its bounds.

    Examples
    --------
    >>> q = np.array([1.0, 2.0])
    >>> gfmdlayer.halfspace(3.0, poisson=0.25).stiffness(q, 0.0)  # q G/(1 - nu)
    array([4., 8.])
    >>> gfmdlayer.halfspace(young=7.5, poisson=0.25).stiffness(q, 0.0)  # G = E/(2 (1 + nu))
    array([4., 8.])
    """
    return bonded_layer(math.inf, material, G=G, young=young, poisson=poisson, halfspace=0.0)


def _law_given(material: object, moduli: Mapping[str, float | None]) -> Law:
    """Return the law of a body; ConfigError for none, for two, and for what is no law."""
    given = {key: value for key, value in moduli.items() if value is not None}
    if len(given) + (material is not None) != 1:
        names = [*(["material"] if material is not None else []), *given]
        got = f"got {' and '.join(names)}" if names else "missing"
        raise ConfigError([f"material: {got}; must be one of material, G and young"])
    if isinstance(material, Real) and not isinstance(material, bool):
        given = {"G": float(material)}
    law: Law = Elastic(**given) if given else Layer(1.0, 0.0, material).material
    return law
