"""The interface laws that a configuration may name. The first is meant where `law` is left out."""

from __future__ import annotations

from collections.abc import Mapping

from gfmdlayer.interface.interface import Interface
from gfmdlayer.validation.sections import load_table

LAWS: Mapping[str, type[Interface]] = load_table(
    "gfmdlayer.interface.adhesion:Exponential",
    "gfmdlayer.interface.adhesion:HardWall",
    "gfmdlayer.interface.adhesion:Dugdale",
    "gfmdlayer.interface.adhesion:LennardJones",
    "gfmdlayer.interface.electrostatic:Electrostatic",
    "gfmdlayer.interface.friction:Coulomb",
    "gfmdlayer.interface.friction:ShearStrength",
)
