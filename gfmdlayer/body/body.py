"""Bodies: linear viscoelastic solids by the stiffness K(q, s) of their surface.

A normal traction sigma(q), positive where it compresses, and the displacement u(q) of the surface, positive
upward, obey sigma = -K(q, s) u at the wavevector q and the Laplace variable s. The history needs K as a sum
of relaxing modes, a `Spectrum`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, cast

from gfmdlayer.validation.problems import ConfigError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gfmdlayer.body.network import InternalVariables
    from gfmdlayer.body.relaxation import Spectrum
    from gfmdlayer.body.wavevectors import Wavevectors


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


def check_body(body: object, *needed: str, key: str = "body") -> None:
    """Raise a ConfigError that names the members of a `Body` which an object lacks."""
    lacking = [f"no {_MEMBERS[name]}" for name in needed if not hasattr(body, name)]
    if lacking:
        example = "must be a body, such as halfspace(...) or bonded_layer(...)"
        raise ConfigError([f"{key}: {type(body).__name__} has {'; '.join(lacking)}; {example}"])


def internal_variables(body: Body, waves: Wavevectors, laws: int) -> InternalVariables:
    """Return the internal variables of layers with reduced times of their own, one for each of the laws."""
    offered = getattr(body, "internal_variables", None)
    if offered is None:
        raise TypeError(
            f"layers with different shifts: a {type(body).__name__} has one reduced time; "
            "must be a body with the method internal_variables, like LayerStack"
        )
    if (own := len(getattr(body, "laws", range(laws)))) < laws:
        raise TypeError(
            f"layers with different shifts: a {type(body).__name__} of {own} materials; "
            f"must have the {laws} of the configuration"
        )
    return cast("InternalVariables", offered(waves))
