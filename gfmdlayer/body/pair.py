"""A body and its counterbody in contact without friction, as one body under a rigid punch (`in_series`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal, cast

from pydantic import PrivateAttr

from gfmdlayer.body.body import check_body
from gfmdlayer.body.layers import Layers
from gfmdlayer.body.materials import Law, Material
from gfmdlayer.body.solid import LayerDepth, Relaxation, Solid
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import Mistake
from gfmdlayer.validation.sections import alone

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.body.body import Body
    from gfmdlayer.body.relaxation import Spectrum
    from gfmdlayer.body.wavevectors import Wavevectors


class Pair(Solid):
    """Two deformable bodies in contact without friction, as one body under a rigid punch.

    Parameters
    ----------
    first, second : Body
        The body, and the counterbody, whose shape is the punch's. A body that holds its mean displacement,
        K(0) = 0, adds no compliance at q = 0.

    Examples
    --------
    Two equal halfspaces deform like one of half the modulus:

    >>> half = gfmdlayer.halfspace(gfmdlayer.Zener(G0=1.0, Ginf=10.0, tau=2.0))
    >>> pair = gfmdlayer.Pair(half, half)
    >>> pair.stiffness([1.0], 0.0) / half.stiffness([1.0], 0.0)
    array([0.5])
    >>> found = pair.spectrum([1.0])
    >>> found.weights, found.times
    (array([[9.]]), array([[2.]]))
    """

    kind: Literal["pair"] = "pair"
    """a body and a counterbody"""

    _bodies: tuple[Body, Body] = PrivateAttr()

    @entry()
    @alone
    def __init__(self, first: Body, second: Body) -> None:
        self._take({})
        for key, body in (("first", first), ("second", second)):
            check_body(body, "mean_stiffness", "spectrum", key=key)
        self._bodies = first, second

    def __repr_args__(self) -> Iterator[tuple[str, object]]:
        """Show the bodies."""
        yield from (("first", self.first), ("second", self.second))

    @property
    def first(self) -> Body:
        """The body."""
        return self._bodies[0]

    @property
    def second(self) -> Body:
        """The counterbody."""
        return self._bodies[1]

    @property
    def mean_stiffness(self) -> float:
        """K(q = 0, s = 0), in series where both bodies have one."""
        from gfmdlayer.body.in_series import stiffness_in_series

        return float(stiffness_in_series(self.first.mean_stiffness, self.second.mean_stiffness))

    def stiffness(self, waves: Wavevectors | ArrayLike, s: ArrayLike) -> NDArray[Any]:
        """Return K(q, s) of the pair, see `Body`."""
        from gfmdlayer.body.in_series import stiffness_in_series

        return stiffness_in_series(self.first.stiffness(waves, s), self.second.stiffness(waves, s))

    def spectrum(self, waves: Wavevectors | ArrayLike) -> Spectrum:
        """Return the relaxing modes of the pair."""
        from gfmdlayer.body.in_series import in_series

        return in_series(self.first.spectrum(waves), self.second.spectrum(waves))

    def part_of_second(self, waves: Wavevectors | ArrayLike, *, glassy: bool = False) -> FloatArray:
        """Return the part of the second body in the displacement of an elastic contact, relaxed or glassy.

        Parameters
        ----------
        waves : Wavevectors or array_like
            Wavevectors of any shape, or their magnitudes (1/length), which mean waves along x.
        glassy : bool
            Whether of sudden contact; by default of a relaxed one.

        Returns
        -------
        ndarray
            From 0 to 1, in the shape of the waves.
        """
        import numpy as np

        spectra = (body.spectrum(waves) for body in self._bodies)
        one, two = (own.glassy if glassy else own.relaxed for own in spectra)
        both = (one > 0) & (two > 0)  # a body with K = 0 holds its displacement
        return np.where(both, one / np.where(both, one + two, 1.0), (one == 0) & (two > 0))

    # Properties for configurations, see `Solid`: there both bodies are solids.

    @property
    def _solids(self) -> tuple[Solid, Solid]:
        return cast("tuple[Solid, Solid]", self._bodies)

    @property
    def laws(self) -> tuple[Law, ...]:
        """The laws of the body, and of the counterbody."""
        return tuple(law for body in self._solids for law in body.laws)

    def with_series(self, materials: Sequence[Material], accuracy: float) -> Pair:
        """Return the pair with a series for each law; each body merges its own modes."""
        first, second = self._solids
        own = len(first.laws)
        above = second.with_series(materials[own:], accuracy)
        return Pair(first.with_series(materials[:own], accuracy), above)

    @property
    def unit(self) -> float:
        """Modulus by which dimensionless pressures are divided, of the body."""
        return self._solids[0].unit

    @property
    def characteristic_time(self) -> float | None:
        """The relaxation time of the body's first law, else of the counterbody's."""
        times = (body.characteristic_time for body in self._solids)
        return next((time for time in times if time is not None), None)

    def roughly(self, longest: float) -> tuple[Relaxation, ...]:
        """Return the relaxation of the materials of both bodies; first, for the cost, both together."""
        every = tuple(material for body in self._solids for material in body.roughly(longest))
        together = sum(relaxed for relaxed, _ in every), tuple(one for _, all_ in every for one in all_)
        return (together, *every)

    @property
    def moduli(self) -> tuple[float, ...]:
        """Finite moduli in both bodies."""
        return tuple(modulus for body in self._solids for modulus in body.moduli)

    @property
    def thicknesses(self) -> tuple[float, ...]:
        """Thicknesses of the layers of the body, from the surface down."""
        return self._solids[0].thicknesses

    @property
    def rigid_below(self) -> float:
        """Thickness between two rigid bases; inf where one of the bodies has none."""
        return sum(body.rigid_below for body in self._solids)

    @property
    def contact_modulus(self) -> float | None:
        """E* of the pair, 1/E* = 1/E*_1 + 1/E*_2; None where a body has none."""
        moduli = [body.contact_modulus for body in self._solids]
        if None in moduli:
            return None
        return 1 / sum(1 / modulus for modulus in moduli if modulus)

    @property
    def flows(self) -> bool:
        """Whether a body gives way to a load without end."""
        return any(body.flows for body in self._solids)

    @property
    def merges(self) -> bool:
        """Whether a body merges its relaxing modes."""
        return any(body.merges for body in self._solids)

    def problems_isolated(self) -> Iterator[Mistake]:
        """Yield why one of the bodies does not carry an isolated load."""
        first, second = self._solids
        yield from first.problems_isolated()
        yield from (problem.within(("counterbody",)) for problem in second.problems_isolated())


def stacks(body: object) -> tuple[Layers, ...]:
    """Return a body of layers, or body and counterbody; nothing where one is not made of layers."""
    both = (body.first, body.second) if isinstance(body, Pair) else (body,)
    found = tuple(each for each in both if isinstance(each, Layers))
    return found if len(found) == len(both) else ()


def downwards(first: Sequence[LayerDepth], second: Sequence[LayerDepth] = ()) -> list[LayerDepth]:
    """Return places in a body, and in its counterbody above it, from the deepest of the counterbody down."""
    return [*(place.mirrored for place in reversed(second)), *first]
