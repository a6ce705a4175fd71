"""Bodies: linear viscoelastic solids by the stiffness K(q, s) of their surface.

A normal traction sigma(q), positive where it compresses, and the displacement u(q) of the surface, positive
upward, obey sigma = -K(q, s) u at the wavenumber q and the Laplace variable s. The history needs K as a sum
of relaxing modes, a `Spectrum`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from gfmdlayer.body.relaxation import Spectrum, relaxation_spectrum

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gfmdlayer.body.layer import LayeredHalfspace
    from gfmdlayer.body.materials import Material


class Body(Protocol):
    """A solid with a plane surface, homogeneous and isotropic along the surface."""

    @property
    def mean_stiffness(self) -> float:
        """K(q = 0, s = 0) of the relaxed body; 0 where the mean displacement is prescribed."""
        ...

    def stiffness(self, q: ArrayLike, s: ArrayLike) -> NDArray[Any]:
        """Return K(q, s), stress per displacement.

        Parameters
        ----------
        q : array_like
            Wavenumbers, not negative.
        s : array_like
            Laplace variable, real or complex; broadcast against q.
        """
        ...

    def spectrum(self, q: ArrayLike) -> Spectrum:
        """Return the relaxing modes at the wavenumbers q, of any shape."""
        ...


@dataclass(frozen=True)
class ViscoelasticLayer:
    """A viscoelastic layer bonded to an elastic halfspace.

    Parameters
    ----------
    layer : LayeredHalfspace
        Thickness, Poisson's ratios and halfspace.
    material : Material
        Shear response of the layer.
    """

    layer: LayeredHalfspace
    material: Material

    @property
    def mean_stiffness(self) -> float:
        """K(q = 0, s = 0), which differs from 0 for a compressible layer on a rigid base."""
        return self.layer.mean_stiffness * self.material.relaxed

    def stiffness(self, q: ArrayLike, s: ArrayLike) -> NDArray[Any]:
        """Return K(q, s) of the layer with the modulus G(s)."""
        return self.layer.stiffness(q, self.material.laplace(s))

    def spectrum(self, q: ArrayLike) -> Spectrum:
        """Return the relaxing modes at the wavenumbers q."""
        return relaxation_spectrum(self.layer, self.material, q)
