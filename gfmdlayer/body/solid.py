"""A body as a configuration names it: a section with keys, and a `gfmdlayer.body.body.Body` at once.

Configurations are read without numpy, which is imported inside of methods.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from itertools import accumulate
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, cast

from pydantic import Field

from gfmdlayer.body.laws import LAWS
from gfmdlayer.body.materials import Elastic, Law, Material
from gfmdlayer.validation.problems import Mistake
from gfmdlayer.validation.sections import Kind, OneOf, replaced, sections_in

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.body.body import Body
    from gfmdlayer.body.relaxation import Spectrum
    from gfmdlayer.body.wavevectors import Wavevectors
    from gfmdlayer.validation.units import Units

# Width of an isolated contact, at most, over the period of its cell (`body.isolated`); with friction that
# along each axis (`friction.isolated`).
WIDEST, HALF = 0.42, 0.5

Relaxation = tuple[float, tuple[tuple[float, float], ...]]  # relaxed modulus, and (G_k, tau_k) of branches


class Boundary(NamedTuple):
    """The axes along which a cell has no periodic images, and the origin of the depth."""

    isolated: tuple[bool, ...]  # of each axis, at least one
    datum: float | None = None  # of one axis: distance from a load at which the surface counts as at rest

    @property
    def axes(self) -> tuple[int, ...]:
        """The isolated axes."""
        return tuple(axis for axis, alone in enumerate(self.isolated) if alone)

    def widened(self, period: tuple[float, ...], factor: float) -> tuple[tuple[float, ...], Boundary]:
        """Return the periods and the boundary of a cell that is wider by a factor where it is isolated."""
        every = zip(period, self.isolated, strict=True)
        longer = tuple(length * factor if alone else length for length, alone in every)
        return longer, self._replace(datum=None if self.datum is None else self.datum * factor)


class Solid(Kind):
    """Base class of bodies: its fields are the keys under `body`.

    A field may be a material law, ``material: Annotated[Law, OneOf(LAWS)]``: in a run it is a `Material`, the
    series of Maxwell branches that responds like the law over the times of the run.

    Attributes
    ----------
    isolated : bool
        Whether K(q) grows like q for short waves, as on a halfspace: an isolated, axisymmetric indenter needs
        this, and a stiffness that does not depend on the direction.

    Notes
    -----
    With friction the body needs K(q) as a matrix over the directions: a method ``traction_spectrum(waves)``
    that returns a `TractionSpectrum`.

    Examples
    --------
    A bed of independent springs of stiffness k, pressure over displacement:

    >>> class Bed(gfmdlayer.Solid):
    ...     k: float
    ...     @property
    ...     def mean_stiffness(self):
    ...         return self.k
    ...     def stiffness(self, waves, s):
    ...         return self.k + 0 * np.asarray(waves) * np.asarray(s)
    ...     def spectrum(self, waves):
    ...         return gfmdlayer.Spectrum.of_material(self.k + 0 * np.asarray(waves), gfmdlayer.Elastic(1.0))
    >>> config = gfmdlayer.Config(name="bed", grid={"points": 64})
    >>> case = gfmdlayer.Case(config, body=Bed(k=5.0))
    >>> case.body.stiffness(case.grid.waves, 0.0)[:2]
    array([5., 5.])
    """

    isolated: ClassVar[bool] = False

    kind: str = "file"
    """word that chooses the body"""

    def in_units(self, units: Units | None) -> Solid:  # noqa: ARG002
        """Return the body whose file, if it has one, is converted into the units of the configuration.

        Parameters
        ----------
        units : Units or None
            Units of the configuration; None where it has none.
        """
        return self

    def account(self) -> str:
        """Say in one line how its file was read, if it has one."""
        return ""

    @property
    def mean_stiffness(self) -> float:
        """K(q = 0, s = 0) of the relaxed body; 0, the default, where the mean displacement is prescribed."""
        return 0.0

    @abstractmethod
    def stiffness(self, waves: Wavevectors | ArrayLike, s: ArrayLike) -> NDArray[Any]:
        """Return K(q, s), stress per displacement, see `gfmdlayer.body.body.Body`.

        Parameters
        ----------
        waves : Wavevectors or array_like
            Wavevectors of any shape, or their magnitudes (1/length), which mean waves along x.
        s : array_like
            Laplace variable (1/time), real or complex with Re s >= 0; broadcast against the waves.

        Returns
        -------
        ndarray
            Stress per displacement, in the broadcast shape.
        """

    @abstractmethod
    def spectrum(self, waves: Wavevectors | ArrayLike) -> Spectrum:
        """Return the relaxing modes at the wavevectors, of any shape.

        Parameters
        ----------
        waves : Wavevectors or array_like
            Wavevectors of any shape, or their magnitudes (1/length), which mean waves along x.

        Returns
        -------
        Spectrum
            Relaxed stiffness, weights and times at these waves.
        """

    @property
    def laws(self) -> tuple[Law, ...]:
        """The material laws of the body, in the order of its keys."""
        return tuple(section for _, section in sections_in(self) if isinstance(section, Law))

    def with_series(self, materials: Sequence[Material], accuracy: float) -> Body:  # noqa: ARG002
        """Return the body of a run, with a series in place of each of `laws`.

        Parameters
        ----------
        materials : sequence of Material
            A series for each of `laws`, in their order.
        accuracy : float
            Relative error of K(q, s) up to which relaxing modes may be merged.
        """
        series = iter(materials)
        body: Any = replaced(self, lambda value: next(series) if isinstance(value, Law) else value)
        return cast("Body", body)

    @property
    def unit(self) -> float:
        """Modulus by which dimensionless pressures are divided: of the first law, else 1."""
        return next((law.unit for law in self.laws), 1.0)

    @property
    def characteristic_time(self) -> float | None:
        """The relaxation time of the first law, where it has a single one."""
        return next((law.characteristic_time for law in self.laws), None)

    def roughly(self, longest: float) -> tuple[Relaxation, ...]:
        """Return the relaxation of each material up to a time, for the cost of a run.

        Without a law it is the relaxation of the stiffness at one wave.

        Parameters
        ----------
        longest : float
            Duration of the run: time.
        """
        if self.laws:
            return tuple(law.roughly(longest) for law in self.laws)
        spectrum = self.spectrum([1.0])
        return ((float(spectrum.relaxed[0]), tuple(zip(*spectrum.modes_at(0), strict=True))),)

    @property
    def moduli(self) -> tuple[float, ...]:
        """Finite moduli in the body, one for each material."""
        return tuple(law.unit for law in self.laws)

    @property
    def thicknesses(self) -> tuple[float, ...]:
        """Thicknesses of layers from the surface down; inf: a halfspace."""
        return ()

    @property
    def rigid_below(self) -> float:
        """Depth of a rigid base; inf where there is none."""
        return math.inf

    @property
    def contact_modulus(self) -> float | None:
        """Relaxed E* = 2 G/(1 - nu) at the surface; None where there is no such modulus."""
        return None

    @property
    def flows(self) -> bool:
        """Whether the body gives way to a load without end: a liquid that lies on nothing solid."""
        return any(not law.relaxed for law in self.laws)

    @property
    def merges(self) -> bool:
        """Whether relaxing modes may be merged: results then have a bound on the error, `spectrum_error`."""
        return True

    def problems_on_grid(self, points: Sequence[int], period: Sequence[float]) -> Iterator[Mistake]:  # noqa: ARG002
        """Yield why a periodic grid does not suit the body, at its own keys.

        Parameters
        ----------
        points : tuple of int
            Points along each axis.
        period : tuple of float
            Period along each axis: length.
        """
        yield from ()

    def problems_isolated(self) -> Iterator[Mistake]:
        """Yield why the body does not carry an isolated indenter, in keys of the configuration."""
        if not self.isolated:
            message = (
                "given with grid.geometry: axisymmetric, for which its compliance is missing; must be layers"
            )
            yield Mistake(("body",), message, because="open")


class OneModulus(Solid):
    """A body whose moduli all relax alike, K(q, s) = K(q) G(s)/G(0); only the form of the law counts."""

    material: Annotated[Law, OneOf(LAWS)] = Field(default_factory=lambda: Elastic(1.0))
    """law by which all moduli relax alike, relative to its G0; default: elastic"""

    @abstractmethod
    def relaxed_stiffness(self, waves: Wavevectors) -> FloatArray:
        """Return K(q, 0), positive but at q = 0.

        Parameters
        ----------
        waves : Wavevectors or array_like
            Wavevectors of any shape, or their magnitudes (1/length), which mean waves along x.

        Returns
        -------
        ndarray
            Stress per displacement, real, in the shape of the waves.
        """

    def stiffness(self, waves: Wavevectors | ArrayLike, s: ArrayLike) -> NDArray[Any]:
        """Return K(q, s)."""
        import numpy as np

        from gfmdlayer.body.wavevectors import Wavevectors

        relaxed = self.relaxed_stiffness(Wavevectors.of(waves))
        return np.asarray(relaxed * (self.material.laplace(s) / self.material.unit))

    def spectrum(self, waves: Wavevectors | ArrayLike) -> Spectrum:
        """Return a mode for each branch of the law."""
        from gfmdlayer.body.relaxation import Spectrum
        from gfmdlayer.body.wavevectors import Wavevectors

        assert isinstance(self.material, Material)  # as in every run
        relaxed = self.relaxed_stiffness(Wavevectors.of(waves))
        return Spectrum.of_material(relaxed / self.material.unit, self.material)


def fault(body: Body, waves: Wavevectors) -> str:
    """Return why a body does not keep the promises of `Body` at waves of shape (nq,), q = 0 first, if so."""
    import numpy as np

    from gfmdlayer.body.wavevectors import Wavevectors

    spectrum, mean = body.spectrum(waves), body.mean_stiffness
    parts = {"relaxed": spectrum.relaxed, "weights": spectrum.weights, "times": spectrum.times}
    for name, values in parts.items():
        shape = waves.shape if name == "relaxed" else (len(spectrum.weights), *waves.shape)
        if np.shape(values) != shape:
            return f"spectrum(waves).{name} has the shape {np.shape(values)}; must be {shape}"
        if not np.isfinite(values).all():
            return f"spectrum(waves).{name} is not finite at all wavevectors; must be"
    if not 0 <= mean < np.inf:
        return f"mean_stiffness is {mean!r}; must be >= 0 and finite"
    if (spectrum.weights < 0).any() or (spectrum.times <= 0).any():
        return "spectrum(waves) has a weight < 0 or a time <= 0; must be weights >= 0 and times > 0"
    if (spectrum.relaxed[1:] <= 0).any():
        q = waves.magnitude[1:][spectrum.relaxed[1:] <= 0][0]
        return f"spectrum(waves).relaxed is not positive at |q| = {q:.6g}; must be"
    if not _close(spectrum.relaxed[:1], mean):
        still = f"{spectrum.relaxed[0]:.6g} at q = 0"
        return f"spectrum(waves).relaxed is {still}; must be mean_stiffness, {mean:.6g}"
    back = Wavevectors.of_components(-waves.qx, -waves.qy)
    for s in (0.0, *(1 / np.unique(spectrum.times)[:: max(1, spectrum.times.size // 8)])):
        K = body.stiffness(waves, s)
        if np.shape(K) != waves.shape:
            return f"stiffness(waves, s) has the shape {np.shape(K)}; must be {waves.shape}"
        if not _close(K, spectrum.stiffness(s)):
            wrong = "is not the sum of the modes of spectrum(waves)"
            return f"stiffness(waves, s) {wrong} at s = {s:.6g}; must be"
        if not _close(K, body.stiffness(back, s)):
            return "stiffness(waves, s) differs between q and -q; must be equal"
    return ""


def fault_under_shear(body: Any, waves: Wavevectors) -> str:
    """Return why `traction_spectrum` is no stiffness, or not that of the body under pressure alone, if so."""
    import numpy as np

    found = body.traction_spectrum(waves)
    plane, across = found.in_plane, found.across
    shapes = {
        "in_plane.relaxed": (plane.relaxed, (*waves.shape, 2, 2)),
        "in_plane.vectors": (plane.vectors, (len(plane.times), *waves.shape, 2)),
        "in_plane.times": (plane.times, (len(plane.times), *waves.shape)),
        "across.relaxed": (across.relaxed, waves.shape),
        "across.weights": (across.weights, (len(across.times), *waves.shape)),
        "across.times": (across.times, (len(across.times), *waves.shape)),
    }
    for name, (values, shape) in shapes.items():
        if np.shape(values) != shape:
            return f"traction_spectrum(waves).{name} has the shape {np.shape(values)}; must be {shape}"
        if not np.isfinite(values).all():
            return f"traction_spectrum(waves).{name} is not finite at all wavevectors; must be"
    if (across.weights < 0).any() or (plane.times <= 0).any() or (across.times <= 0).any():
        return "traction_spectrum(waves) has a weight < 0 or a time <= 0; must be weights >= 0 and times > 0"
    least = np.minimum(np.linalg.eigvalsh(plane.relaxed)[1:, 0], across.relaxed[1:])
    if (least <= 0).any():
        q = waves.magnitude[1:][least <= 0][0]
        return f"traction_spectrum(waves) is not positive at |q| = {q:.6g}; must be"
    for s in (0.0, *(1 / np.unique(plane.times)[:: max(1, plane.times.size // 8)])):
        K = plane.stiffness(s)[1:]
        if not _close(K[:, 0, 0] - K[:, 0, 1] * K[:, 1, 0] / K[:, 1, 1], body.stiffness(waves, s)[1:]):
            wrong = "without shear traction is not stiffness(waves, s)"
            return f"traction_spectrum(waves) {wrong} at s = {s:.6g}; must be"
    return ""


def _close(one: Any, other: Any) -> bool:
    """Whether two stiffnesses agree, relative to each value, or to the largest where a value is zero."""
    import numpy as np

    size = np.abs(other)
    return bool((np.abs(one - other) <= 1e-6 * size + 1e-12 * np.max(size)).all())


# Depths below the surface of layers, and the layers that they are in.

DEPTH_PAIRS = 7.0  # work of the fields at a depth, in FFT pairs; measured at 512 x 512 points
_SAME = 1e-12  # relative: a depth this close to an interface is on it


class LayerDepth(NamedTuple):
    """A depth, and the number of its layer from the surface; a depth at an interface has two places.

    In a counterbody the depth is negative, and its layers have the numbers -1, -2, ... from its surface.
    """

    depth: float
    layer: int

    @property
    def mirrored(self) -> LayerDepth:
        """The place at this depth in the other body."""
        return LayerDepth(0.0 - self.depth, -1 - self.layer)  # no -0.0


def places(thicknesses: Sequence[float], depths: Sequence[float]) -> list[LayerDepth]:
    """Return the places at increasing depths in layers of these thicknesses, at most their sum."""
    faces, last = list(accumulate(thicknesses)), len(thicknesses) - 1
    at_depths = []
    for depth in depths:
        at = next((i for i, face in enumerate(faces) if abs(face - depth) <= _SAME * depth), None)
        if at is None:
            at_depths.append(LayerDepth(depth, next(i for i, face in enumerate(faces) if depth < face)))
        else:
            at_depths += [LayerDepth(faces[at], number) for number in (at, at + 1) if number <= last]
    return at_depths


def beyond(thicknesses: Sequence[float], depths: Sequence[float]) -> tuple[int, float] | None:
    """Return the number of the first depth below all layers, and their thickness; None without one."""
    whole = sum(thicknesses)
    return next(((i, whole) for i, depth in enumerate(depths) if depth > whole * (1 + _SAME)), None)


def between_faces(thicknesses: Sequence[float], number: int, reach: float) -> list[float]:
    """Return so many depths in each layer, from face to face; in a halfspace down to its top plus `reach`."""
    # The reach counts only without layers above the halfspace; else it is their thickness.
    depths, top = [0.0], 0.0
    for thickness in thicknesses:
        size = thickness if math.isfinite(thickness) else top or reach
        depths += [top + size * i / (number - 1) for i in range(1, number)]
        top += size
    return depths
