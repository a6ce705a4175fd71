"""The keys of the body: body, or layer, layers and halfspace; the same below `counterbody`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import Field

from gfmdlayer.body.bodies import BODIES, BODY, keys_in_memory
from gfmdlayer.body.layer import Halfspace, Layer, StackedLayer, StackedLayers
from gfmdlayer.body.layers import Layers
from gfmdlayer.body.materials import Elastic
from gfmdlayer.body.pair import Pair
from gfmdlayer.body.solid import Solid
from gfmdlayer.validation.fields import Finite, given
from gfmdlayer.validation.problems import ConfigError, Location, Mistake
from gfmdlayer.validation.sections import Section

_LAYERED = ("layer", "layers", "halfspace")


def layered(data: Mapping[str, Any]) -> bool:
    """Whether the body of a configuration is made of layers, which is the default."""
    return isinstance(data.get("body"), Layers | None)


def in_keys(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data of a configuration with the keys of bodies that were made in Python."""
    made = dict(data)
    if isinstance(pair := made.get("body"), Pair):
        if made.get("counterbody") is not None:
            raise ConfigError(["counterbody: given beside a Pair, which has its own; remove one of the two"])
        made |= {"body": pair.first, "counterbody": pair.second}
    for key in ("body", "counterbody"):
        body = made.get(key)
        if body is None or isinstance(body, Mapping | Counterbody):
            continue
        if isinstance(body, Layers) and body.above:
            if key == "body" and (beside := [name for name in _LAYERED if made.get(name) is not None]):
                raise ConfigError([f"body: given beside {', '.join(beside)}; remove one of the two"])
            del made[key]
            made |= body.keys() if key == "body" else {key: body.keys()}
        elif isinstance(body, Solid):
            known = body.kind in BODIES or hasattr(body, "file")
            keys = body.model_dump(exclude_unset=True) if known else keys_in_memory(body)
            made[key] = keys if key == "body" else {"body": keys}
        else:
            allowed = "must be a body such as halfspace(...), or its keys, such as {file: mine.py, ...}"
            taken = "; a class of your own derives from Solid"
            raise ConfigError([f"{key}: got {type(body).__name__}; {allowed}{taken}"])
    return made


def problems_of_the_body(
    body: Solid | None,
    layers: tuple[StackedLayer, ...] | None,
    layer: Layer | None,
    halfspace: Halfspace | None,
) -> Iterator[Mistake]:
    """Yield contradictions between the keys of the body, and between layers and halfspace."""
    if not layered({"body": body}):
        assert body is not None
        for key, value in (("layers", layers), ("layer", layer), ("halfspace", halfspace)):
            if value is not None:
                other = f"{{kind: {body.kind}}}; remove it or set body: {{kind: layers}}"
                message = f"not available with body: {other}"
                yield Mistake((key,), message, ("body",), at_key=True, because="physics")
        return
    assert halfspace is not None
    if layers is not None and layer is not None:
        message = "given beside layer; remove one of the two"
        yield Mistake(("layers",), message, ("layer",), at_key=True, because="physics")
        return
    every = layers or (() if layer is None else (layer,))
    if not every:
        yield Mistake(("layers",), "got an empty list; must have at least one {thickness: ...}")
        return
    for i, above in enumerate(every[:-1]):
        if math.isinf(above.thickness):
            message = "got .inf above another layer; must be finite: only the last can be a halfspace"
            yield Mistake(("layers", i, "thickness"), message, ("layers",))
    modulus = halfspace.in_shear.shear_modulus
    if modulus in {0, math.inf} and not any(each.thickness for each in every):
        nothing = "halfspace without stiffness: the body carries no load"
        base = "rigid halfspace: the body cannot deform" if modulus else nothing
        allowed = "must be > 0, or halfspace.shear_modulus a number > 0 and finite"
        at: Location = ("layer", "thickness") if layers is None else ("layers", 0, "thickness")
        yield Mistake(at, f"got 0 on a {base}; {allowed}", ("halfspace.shear_modulus", "layers"))


class Counterbody(Section):
    """A second deformable body behind the shape of the punch; by default an elastic halfspace."""

    body: Annotated[Solid | None, BODY, given] = None
    """the counterbody; layers, by the keys below, or {file: mine.py, ...}"""
    layers: Annotated[StackedLayers | None, given] = None
    """layers of the counterbody, from its surface inwards"""
    layer: Annotated[Layer | None, given] = None
    """the only layer; without it and layers, the halfspace is the counterbody"""
    halfspace: Annotated[Halfspace | None, given] = Field(
        default_factory=lambda data: Halfspace() if layered(data) else None
    )
    """the halfspace behind them; .inf without layers: a rigid counterbody"""
    velocity_ratio: Annotated[Finite | None, given] = None
    """its velocity over trajectory.velocity: 0 slides, 1 rolls (with creepage)"""

    def problems(self) -> Iterator[Mistake]:
        """Yield contradictions between the keys; a halfspace needs no layer, and may be rigid."""
        bare = self.layers is None and self.layer is None
        if bare and self.halfspace is not None and layered({"body": self.body}):
            if self.halfspace.in_shear.shear_modulus == 0:
                message = "got 0 without a layer: the counterbody carries no load; must be > 0"
                yield Mistake(("halfspace", "shear_modulus"), message, ("layer", "layers"))
        else:
            yield from problems_of_the_body(self.body, self.layers, self.layer, self.halfspace)

    @property
    def solid(self) -> Solid | None:
        """The counterbody; None where it is rigid."""
        if not layered({"body": self.body}):
            return self.body
        assert self.halfspace is not None
        base, every = self.halfspace.in_shear, self.layers or (() if self.layer is None else (self.layer,))
        if every:
            return Layers.of(every, base)
        if base.shear_modulus in (0, math.inf):  # 0 is refused by `problems`
            return None
        material = base.material or Elastic(base.shear_modulus)
        return Layers.of((Layer(thickness=math.inf, poisson=base.poisson, material=material),), Halfspace())


def problems_of_the_counterbody(config: Any) -> Iterator[Mistake]:
    """Refuse a velocity ratio at rest, and the shape of a counterbody that moves with its material."""
    if config.counterbody is None:
        return
    motion, given = config.trajectory, config.counterbody.velocity_ratio
    at: Location = ("counterbody", "velocity_ratio")
    ratio = config.velocity_ratio
    velocity = ("trajectory.velocity", "trajectory.velocity_file")
    if given and not motion.moves:
        message = "only for a punch that moves; remove it or set trajectory.velocity"
        yield Mistake(at, message, velocity)
    if config.friction and motion.rolls and given not in (None, 1.0):
        message = (
            f"got {given!r} beside a creepage or a tangential force, with which both bodies roll; must be 1, "
            f"or alone: {given!r} without them is a creepage of {1 - given:.6g}"
        )
        yield Mistake(at, message, ("trajectory.creepage", "trajectory.tangential"))
    if config.friction and config.grid.isolated and motion.moves and ratio != 1:
        message = (
            f"got {ratio!r} in an isolated contact with friction, which carries both bodies alike; must be "
            "1, for bodies that roll: give trajectory.creepage"
        )
        yield Mistake(at, message, ("grid.boundary", "trajectory.creepage"))
    if ratio and motion.moves and config.punch.rough:
        message = f"got {ratio!r} with a rough punch, whose heights would pass the contact; must be 0"
        if given is None:
            at, reason = ("counterbody",), "it rolls, and the heights of a rough punch would pass the contact"
            message = f"{reason}; use a smooth punch.shape, or remove the creepage or the tangential force"
        yield Mistake(at, message, ("punch.shape", "trajectory.creepage", "trajectory.tangential"))
