"""Bodies: linear viscoelastic solids by the stiffness K(q, s) of their surface.

A normal traction sigma(q), positive where it compresses, and the displacement u(q) of the surface, positive
upward, obey sigma = -K(q, s) u at the wavevector q and the Laplace variable s. The history needs K as a sum
of relaxing modes, a `Spectrum`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, cast

from gfmdlayer.body.layer import LayeredHalfspace
from gfmdlayer.body.materials import Elastic, Law, Material
from gfmdlayer.body.relaxation import Spectrum, TractionSpectrum, relaxation_spectrum
from gfmdlayer.body.stack import Layer, LayerStack
from gfmdlayer.body.wavevectors import Wavevectors
from gfmdlayer.validation.problems import ConfigError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gfmdlayer.body.network import InternalVariables


class Body(Protocol):
    """A solid with a plane surface, homogeneous along it."""

    @property
    def mean_stiffness(self) -> float:
        """K(q = 0, s = 0) of the relaxed body; 0 where the mean displacement is prescribed."""
        ...

    def stiffness(self, waves: Wavevectors | ArrayLike, s: ArrayLike) -> NDArray[Any]:
        """Return K(q, s), stress per displacement.

        Parameters
        ----------
        waves : Wavevectors or array_like
            Wavevectors q, or magnitudes of waves along x. K(-q) = K(q).
        s : array_like
            Laplace variable, real or complex; broadcast against q.
        """
        ...

    def spectrum(self, waves: Wavevectors | ArrayLike) -> Spectrum:
        """Return the relaxing modes at the wavevectors, of any shape."""
        ...


_MEMBERS = {
    "mean_stiffness": "mean_stiffness: K(q = 0), 0 where the mean displacement is prescribed",
    "stiffness": "stiffness(waves, s): K(q, s)",
    "spectrum": "spectrum(waves): the relaxing modes, needed where time matters",
}


def check_body(body: object, *needed: str) -> None:
    """Raise a TypeError that names the members of a `Body` which an object lacks."""
    lacking = [f"no {_MEMBERS[name]}" for name in needed if not hasattr(body, name)]
    if lacking:
        example = "must be a body, such as halfspace(...) or bonded_layer(...)"
        raise TypeError(f"body: {type(body).__name__} has {'; '.join(lacking)}; {example}")


def internal_variables(body: Body, waves: Wavevectors) -> InternalVariables:
    """Return the internal variables of layers with reduced times of their own, as of `LayerStack`."""
    offered = getattr(body, "internal_variables", None)
    if offered is None:
        raise TypeError(
            f"layers with different shifts: a {type(body).__name__} has one reduced time; "
            "must be a body with the method internal_variables, like LayerStack"
        )
    return cast("InternalVariables", offered(waves))


@dataclass(frozen=True)
class ViscoelasticLayer:
    """A viscoelastic layer bonded to an elastic halfspace; `bonded_layer` and `halfspace` make one.

    Parameters
    ----------
    layer : LayeredHalfspace
        Thickness, Poisson's ratios and halfspace.
    material : Material
        Shear response of the layer.

    Examples
    --------
    >>> body = gfmdlayer.ViscoelasticLayer(gfmdlayer.LayeredHalfspace(0.1, 0.5, 1.0), gfmdlayer.Zener())
    >>> body.spectrum([1.0, 10.0]).times.shape  # modes, wavenumbers
    (3, 2)
    """

    layer: LayeredHalfspace
    material: Material

    @property
    def mean_stiffness(self) -> float:
        """K(q = 0, s = 0), which differs from 0 for a compressible layer on a rigid base."""
        return self.layer.mean_stiffness * self.material.relaxed

    @property
    def rigid_below(self) -> float:
        """Depth of a rigid base; inf where there is none."""
        return self.layer.thickness if math.isinf(self.layer.bulk_modulus) else math.inf

    def stiffness(self, waves: Wavevectors | ArrayLike, s: ArrayLike) -> NDArray[Any]:
        """Return K(q, s) of the layer with the modulus G(s), see `Body`."""
        return self.layer.stiffness(waves, self.material.laplace(s))

    def spectrum(self, waves: Wavevectors | ArrayLike) -> Spectrum:
        """Return the relaxing modes: `relaxed`, `glassy`, `times` and `weights`."""
        return relaxation_spectrum(self.layer, self.material, waves)

    def traction_spectrum(self, waves: Wavevectors | ArrayLike) -> TractionSpectrum:
        """Return the relaxing modes under tractions in all directions, see `LayerStack.traction_spectrum`."""
        return self.stack.traction_spectrum(waves)

    @property
    def stack(self) -> LayerStack:
        """The layer and its base as a stack."""
        of = self.layer
        layers = [Layer(of.thickness, of.poisson, self.material)]
        if 0 < of.bulk_modulus < math.inf and math.isfinite(of.thickness):
            layers.append(Layer(math.inf, of.bulk_poisson, Elastic(of.bulk_modulus)))
        rigid = math.isinf(of.bulk_modulus) and math.isfinite(of.thickness)
        return LayerStack(tuple(layers), rigid=rigid)


def bonded_layer(
    thickness: float,
    material: Material | float,
    *,
    poisson: float = 0.5,
    base: float = math.inf,
    base_poisson: float = 0.5,
) -> ViscoelasticLayer:
    """Return a layer bonded to a base, as a body for `solve` and for plots of its stiffness.

    Parameters
    ----------
    thickness : float
        d, from 0 (the bare base) to inf (a halfspace of the material).
    material : Material or float
        Law of the layer, or its shear modulus where it is elastic.
    poisson : float
        Poisson's ratio of the layer.
    base : float
        Shear modulus of the base: inf is rigid, 0 leaves the layer free.
    base_poisson : float
        Poisson's ratio of the base.

    Returns
    -------
    ViscoelasticLayer

    Raises
    ------
    ConfigError
        If a parameter is outside of its bounds.

    Examples
    --------
    The stiffness K(q, s), stress over displacement, of a layer under slow and under fast loads:

    >>> body = gfmdlayer.bonded_layer(0.1, gfmdlayer.Zener(G0=1.0, Ginf=10.0, tau=2.0), base=1.0)
    >>> q = np.array([1.0, 10.0, 100.0])
    >>> body.stiffness(q, 0.0) / q  # on a halfspace it is 2 G q
    array([2., 2., 2.])
    >>> bool(np.allclose(body.stiffness(q, 1e12), body.spectrum(q).glassy))
    True

    Its relaxing modes, three for a branch of the material, at each wavenumber:

    >>> body.spectrum(q).times.shape, body.spectrum(q).weights.shape
    ((3, 3), (3, 3))
    """
    if isinstance(material, Law) and not isinstance(material, Material):
        message = f"got {type(material).__name__}, a law with a continuous spectrum; must be a Prony series"
        raise ConfigError([f"material: {message}, such as material.prony(shortest, longest).material"])
    law = material if isinstance(material, Material) else Elastic(material)
    return ViscoelasticLayer(LayeredHalfspace(thickness, poisson, base, base_poisson), law)


def halfspace(material: Material | float, *, poisson: float = 0.5) -> ViscoelasticLayer:
    """Return a halfspace as a body.

    Parameters
    ----------
    material : Material or float
        Law of the halfspace, or its shear modulus where it is elastic.
    poisson : float
        Poisson's ratio.

    Returns
    -------
    ViscoelasticLayer

    Examples
    --------
    >>> q = np.array([1.0, 2.0])
    >>> gfmdlayer.halfspace(3.0, poisson=0.25).stiffness(q, 0.0)  # q G/(1 - nu)
    array([4., 8.])
    """
    return bonded_layer(math.inf, material, poisson=poisson, base=0.0)


def layered_body(
    layers: Sequence[Layer], base: Material | float, base_poisson: float, *, accuracy: float = 0.0
) -> Body:
    """Return layers, from the surface down, on a base; a single one by its closed forms."""
    # `base` is the law of the halfspace below, or its shear modulus: inf is rigid, 0 leaves the lower face
    # free. A stack merges its modes up to a relative error `accuracy` of K(q, s).
    law: Material | None = None
    if isinstance(base, Material):
        law, modulus = (None if base.elastic else base), base.relaxed
    else:
        modulus = base
    if len(layers) == 1 and law is None:
        (single,) = layers
        known = LayeredHalfspace(single.thickness, single.poisson, modulus, base_poisson)
        return ViscoelasticLayer(known, single.material)
    if math.isinf(layers[-1].thickness) or modulus == 0:
        return LayerStack(tuple(layers), accuracy=accuracy)
    if math.isinf(modulus):
        return LayerStack(tuple(layers), rigid=True, accuracy=accuracy)
    below = Layer(math.inf, base_poisson, law or Elastic(modulus))
    return LayerStack((*layers, below), accuracy=accuracy)
