"""The interface laws that a configuration may name. The first is meant where `law` is left out."""

from __future__ import annotations

from collections.abc import Mapping

from gfmdlayer.interface.interface import Interface
from gfmdlayer.validation.sections import load_table

LAWS: Mapping[str, type[Interface]] = load_table(
    "gfmdlayer.interface.adhesion:Exponential",
    "gfmdlayer.interface.interface:HardWall",
    "gfmdlayer.interface.adhesion:Dugdale",
    "gfmdlayer.interface.adhesion:LennardJones",
    "gfmdlayer.interface.adhesion:Electrostatic",
    "gfmdlayer.interface.adhesion:ShortRange",
    "gfmdlayer.interface.interface:Coulomb",
    "gfmdlayer.interface.interface:ShearStrength",
)
