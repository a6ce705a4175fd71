"""The counterbody of a configuration: the punch has its shape, and it deforms too."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, PrivateAttr

from gfmdlayer.body.materials import Elastic, Law, Material
from gfmdlayer.body.solid import Relaxation, Solid
from gfmdlayer.config.bodies import BODY
from gfmdlayer.config.layers import (
    Compound,
    Halfspace,
    Layer,
    Layers,
    StackedLayer,
    layered,
    problems_of_the_body,
)
from gfmdlayer.validation.fields import Finite, given
from gfmdlayer.validation.problems import Problem
from gfmdlayer.validation.sections import Section

if TYPE_CHECKING:
    from gfmdlayer.body.body import Body


class Counterbody(Section):
    """A second deformable body behind the shape of the punch; by default an elastic halfspace."""

    body: Annotated[Solid | None, BODY, given] = None
    """the counterbody; layers, by the three keys below, or {file: mine.py, ...}"""
    layers: Annotated[tuple[StackedLayer, ...] | None, given] = Field(
        default=None, json_schema_extra={"minItems": 1}
    )
    """layers of the counterbody, from its surface inwards"""
    layer: Annotated[Layer | None, given] = None
    """the only layer of the counterbody; without it and layers, the halfspace is the counterbody"""
    halfspace: Annotated[Halfspace | None, given] = Field(
        default_factory=lambda data: Halfspace() if layered(data) else None
    )
    """the halfspace behind the layers; shear_modulus .inf without layers: a rigid counterbody"""
    velocity_ratio: Annotated[Finite | None, given] = None
    """velocity of the contact along it, over trajectory.velocity; 0: slides (default), 1: rolls"""

    def problems(self) -> Iterator[Problem]:
        """Yield contradictions between the keys; a halfspace needs no layer, and may be rigid."""
        bare = self.layers is None and self.layer is None
        if bare and self.halfspace is not None and layered({"body": self.body}):
            if self.halfspace.shear_modulus == 0:
                message = "got 0 without a layer: the counterbody carries no load; must be > 0"
                yield Problem(("halfspace", "shear_modulus"), message, ("layer", "layers"))
        else:
            yield from problems_of_the_body(self.body, self.layers, self.layer, self.halfspace)

    @property
    def solid(self) -> Solid | None:
        """The counterbody; None where it is rigid."""
        if not layered({"body": self.body}):
            return self.body
        assert self.halfspace is not None
        base, every = self.halfspace, self.layers or (() if self.layer is None else (self.layer,))
        if every:
            return Layers.of(every, base)
        if base.shear_modulus in (0, math.inf):  # 0 is refused by `problems`
            return None
        material = base.material or Elastic(base.shear_modulus)
        return Layers.of((Layer(thickness=math.inf, poisson=base.poisson, material=material),), Halfspace())


class TwoBodies(Compound):
    """A body and its counterbody: as one body under a rigid punch, see `gfmdlayer.body.pair`."""

    kind: Literal["pair"] = "pair"
    """a body and a counterbody"""

    _bodies: tuple[Solid, Solid] = PrivateAttr()

    @classmethod
    def of(cls, body: Solid, counterbody: Solid) -> TwoBodies:
        """Return the two bodies as one."""
        made = cls()
        made._bodies = body, counterbody
        return made

    @property
    def laws(self) -> tuple[Law, ...]:
        """The laws of the body, and of the counterbody."""
        return tuple(law for each in self._bodies for law in each.laws)

    def with_series(self, materials: Sequence[Material], accuracy: float) -> Body:
        """Return the pair with a series for each law; each body merges its own modes."""
        from gfmdlayer.body.pair import Pair

        first, second = self._bodies
        own = len(first.laws)
        return Pair(
            first.with_series(materials[:own], accuracy), second.with_series(materials[own:], accuracy)
        )

    @property
    def mean_stiffness(self) -> float:
        """K(q = 0): both in series; a body that holds its mean displacement adds no compliance."""
        found = [each.mean_stiffness for each in self._bodies if each.mean_stiffness]
        return 1 / sum(1 / each for each in found) if found else 0.0

    @property
    def unit(self) -> float:
        """Modulus by which dimensionless pressures are divided, of the body."""
        return self._bodies[0].unit

    @property
    def characteristic_time(self) -> float | None:
        """The relaxation time of the body's first law, else of the counterbody's."""
        found = (each.characteristic_time for each in self._bodies)
        return next((time for time in found if time is not None), None)

    def roughly(self, longest: float) -> tuple[Relaxation, ...]:
        """Return the relaxation of the materials of both bodies; first, for the cost, both together."""
        every = tuple(each for body in self._bodies for each in body.roughly(longest))
        together = sum(relaxed for relaxed, _ in every), tuple(one for _, all_ in every for one in all_)
        return (together, *every)

    @property
    def moduli(self) -> tuple[float, ...]:
        """Finite moduli in both bodies."""
        return tuple(modulus for each in self._bodies for modulus in each.moduli)

    @property
    def thicknesses(self) -> tuple[float, ...]:
        """Thicknesses of the layers of the body, from the surface down."""
        return self._bodies[0].thicknesses

    @property
    def rigid_below(self) -> float:
        """Thickness between two rigid bases; inf where one of the bodies has none."""
        return sum(each.rigid_below for each in self._bodies)

    @property
    def contact_modulus(self) -> float | None:
        """E* of the pair, 1/E* = 1/E*_1 + 1/E*_2; None where a body has none."""
        found = [each.contact_modulus for each in self._bodies]
        if None in found:
            return None
        return 1 / sum(1 / modulus for modulus in found if modulus)

    @property
    def merges(self) -> bool:
        """Whether a body merges its relaxing modes."""
        return any(each.merges for each in self._bodies)

    def problems_isolated(self) -> Iterator[Problem]:
        """Refuse an isolated, axisymmetric indenter."""
        message = "not available with grid.geometry: axisymmetric; remove it or change the geometry"
        yield Problem(("counterbody",), message)


def relaxes(solid: Solid) -> bool:
    """Whether a body has a material that relaxes; one without laws may."""
    return not solid.laws or any(not (isinstance(law, Material) and law.elastic) for law in solid.laws)


def problems_of_the_counterbody(config: Any) -> Iterator[Problem]:
    """Refuse a velocity ratio at rest, and the shape of a counterbody that moves with its material."""
    if config.counterbody is None or not config.counterbody.velocity_ratio:
        return
    at, ratio = ("counterbody", "velocity_ratio"), config.counterbody.velocity_ratio
    if not config.trajectory.moves:
        message = "only for a punch that moves; remove it or set trajectory.velocity"
        yield Problem(at, message, ("trajectory.velocity", "trajectory.velocity_file"))
    if config.punch.rough:
        message = f"got {ratio!r} with a rough punch, whose heights would pass the contact; must be 0"
        yield Problem(at, message, ("punch.shape",))
