"""The layers and the halfspace of a configuration."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from gfmdlayer.body.materials import Law, Zener
from gfmdlayer.config.material_file import MATERIALS
from gfmdlayer.validation.fields import Extended, MustBe, given, strict
from gfmdlayer.validation.problems import Location, Problem
from gfmdlayer.validation.sections import Section

Poisson = Annotated[float, strict, Field(gt=-1, le=0.5), MustBe("a number > -1 and <= 0.5")]


class Layer(Section):
    """The viscoelastic layer; thickness 0 leaves the halfspace alone, .inf the material alone."""

    thickness: Extended = 0.05
    """thickness d; 0: the halfspace alone, .inf: the layer alone: length"""
    poisson: Poisson = 0.5
    """Poisson's ratio of the layer; 0.5 is incompressible"""
    material: Annotated[Law, MATERIALS] = Field(default_factory=Zener)
    """viscoelastic law: its model, or {file: ...} of fit-material"""


class StackedLayer(Layer):
    """One of several layers; thickness 0 leaves it out, and .inf makes the last one the halfspace."""

    thickness: Extended
    """thickness d; .inf: the halfspace, for the last one: length"""


class Halfspace(Section):
    """The halfspace below: elastic, rigid (shear modulus .inf), absent (0), or of a material."""

    material: Annotated[Annotated[Law, MATERIALS] | None, given] = None
    """viscoelastic law of the base, in place of shear_modulus"""
    shear_modulus: Annotated[Extended | None, given] = Field(
        default_factory=lambda data: 1.0 if data.get("material") is None else None
    )
    """shear modulus of the base; 0: a free layer, .inf: rigid: pressure"""
    poisson: Poisson = 0.5
    """Poisson's ratio of the base"""

    def problems(self) -> Iterator[Problem]:
        """Refuse a modulus beside a material."""
        if self.material is not None and self.shear_modulus is not None:
            message = "given beside material; must be left out, or material be left out"
            yield Problem(("shear_modulus",), message, ("material",))


def problems_of_layers(
    layers: tuple[StackedLayer, ...] | None, layer: Layer | None, halfspace: Halfspace
) -> Iterator[Problem]:
    """Yield contradictions between the layers and with the halfspace."""
    if layers is not None and layer is not None:
        yield Problem(("layers",), "given beside layer; must be one of the two", ("layer",), at_key=True)
        return
    every = layers or (() if layer is None else (layer,))
    if not every:
        yield Problem(("layers",), "got an empty list; must hold at least one {thickness: ...}")
        return
    for i, above in enumerate(every[:-1]):
        if math.isinf(above.thickness):
            message = "got .inf above another layer; must be finite: only the last can be a halfspace"
            yield Problem(("layers", i, "thickness"), message, ("layers",))
    modulus = halfspace.shear_modulus
    if modulus in {0, math.inf} and not any(each.thickness for each in every):
        nothing = "halfspace without stiffness: nothing carries a load"
        base = "rigid halfspace: nothing is left to deform" if modulus else nothing
        allowed = "must be > 0, or halfspace.shear_modulus a number > 0 and finite"
        at: Location = ("layer", "thickness") if layers is None else ("layers", 0, "thickness")
        yield Problem(at, f"got 0 on a {base}; {allowed}", ("halfspace.shear_modulus", "layers"))


def mean_stiffness(layers: tuple[Layer, ...], halfspace: Halfspace) -> float:
    """Return K(q = 0) by the units of the layers' laws; 0 where the mean height of the surface stays."""
    rigid = halfspace.shear_modulus == math.inf and math.isfinite(layers[-1].thickness)
    compliances = [
        layer.thickness * (1 - 2 * layer.poisson) / (2 * (1 - layer.poisson) * layer.material.unit)
        for layer in layers
        if layer.poisson < 0.5
    ]
    return 1 / sum(compliances) if rigid and any(compliances) else 0.0
