"""The section `output.inside`: displacements and stresses below the surface."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import accumulate
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from gfmdlayer.body.solid import Place, between_faces, beyond, places
from gfmdlayer.config.layers import Layers
from gfmdlayer.validation.fields import Count, MustBe, NotNegative, given
from gfmdlayer.validation.problems import Problem, not_increasing
from gfmdlayer.validation.sections import Section

if TYPE_CHECKING:
    from gfmdlayer.body.solid import Solid

MOST_DEPTHS = 10_000
DEPTH_PAIRS = 7.0  # work of the fields at a depth, in FFT pairs; measured at 512 x 512 points
_WITHOUT_LAYERS = 0.25  # of the shortest period: depth in a halfspace without layers

Depths = Annotated[
    tuple[NotNegative, ...],
    Field(min_length=1, max_length=MOST_DEPTHS),
    MustBe(f"a list of 1 to {MOST_DEPTHS} numbers >= 0"),
]
PerLayer = Annotated[int, Field(strict=True, ge=2, le=1000), MustBe("a whole number from 2 to 1000")]


class Inside(Section):
    """Displacements and stresses below the surface at the snapshots.

    With `every` also columns of the rows: the largest stresses at these depths, and at the interfaces.
    """

    depths: Annotated[Depths | None, given] = None
    """depths below the surface, increasing; an interface has both sides: length"""
    points: Annotated[PerLayer | None, given] = None
    """in place of depths: depths in each layer, from face to face"""
    times: Annotated[tuple[NotNegative, ...] | None, given] = None
    """the snapshots with fields below the surface; default: all: time"""
    every: Annotated[Count | None, given] = None
    """columns of the largest stresses, in every n-th row; default: none"""

    def problems(self) -> Iterator[Problem]:
        """Require one of depths and points, and numbers that increase."""
        if (self.depths is None) == (self.points is None):
            given = self.depths is not None
            wrong = "given beside points; remove one" if given else "missing; give depths or points"
            yield Problem(("depths",), wrong, ("points",))
        for key, values in (("depths", self.depths), ("times", self.times)):
            yield from not_increasing((key,), values or (), key, key)

    def places(self, solid: Solid, period: Sequence[float]) -> list[Place]:
        """Return the places in a body of layers; a depth at an interface has two."""
        layers = thicknesses(solid)
        depths = self.depths
        if depths is None:
            assert self.points is not None
            depths = tuple(between_faces(layers, self.points, _WITHOUT_LAYERS * min(period)))
        return places(layers, depths)

    def wants(self, time: float) -> bool:
        """Whether the snapshot at a time has fields below the surface."""
        return self.times is None or any(math.isclose(time, each, rel_tol=1e-9) for each in self.times)


def thicknesses(solid: Solid) -> list[float]:
    """Return the thicknesses of the layers that a body has, from the surface down; inf: a halfspace."""
    assert isinstance(solid, Layers)
    found: list[float] = []
    for each in solid.thicknesses:
        if each > 0:
            found.append(each)
        if math.isinf(each):
            return found
    return [*found, math.inf] if solid.base.shear_modulus not in (0, math.inf) else found


def interfaces(solid: Solid) -> list[float]:
    """Return the depths of the interfaces between layers, and of the bond to a rigid base."""
    layers = thicknesses(solid)
    assert isinstance(solid, Layers)
    bonded = layers if solid.base.shear_modulus == math.inf else layers[:-1]
    return [depth for depth in accumulate(bonded) if math.isfinite(depth)]


def problems_of_the_inside(config: Any) -> Iterator[Problem]:
    """Refuse fields below the surface where they are not known, depths below the body, and other times."""
    given: Inside | None = config.output.inside
    if given is None:
        return
    at = ("output", "inside")
    if not isinstance(config.solid, Layers):
        other = "two deformable bodies" if config.counterbody is not None else f"kind: {config.body.kind}"
        yield Problem(
            at, f"not available with {other}; must be layers under a rigid punch", ("body", "counterbody")
        )
        return
    if config.grid.isolated:
        message = "not available with boundary: isolated, which gives the surface within its reach; remove it"
        yield Problem(at, message, ("grid.boundary",))
    if config.friction:
        message = "not available with friction, whose shear traction acts on the surface; remove it"
        yield Problem(at, message, ("interface",))
    layers = thicknesses(config.solid)
    if given.depths is not None and (found := beyond(layers, given.depths)) is not None:
        i, whole = found
        message = f"got {given.depths[i]!r}; must be at most {whole:g}, the thickness of the body"
        yield Problem((*at, "depths", i), message, ("layer.thickness", "layers", "halfspace"))
    snapshots = config.output.snapshots
    if not snapshots and given.every is None:
        message = "there is no snapshot with fields; set output.snapshots, or every for columns"
        yield Problem(at, message, ("output.snapshots",))
    for i, time in enumerate(given.times or ()):
        known = config.output.snapshot_times
        if not any(math.isclose(time, each, rel_tol=1e-9) for each in known):
            message = f"got {time!r}; must be one of output.snapshots"
            yield Problem((*at, "times", i), message, ("output.snapshots",))
