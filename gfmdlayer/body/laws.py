"""The laws of a material that a configuration may name. The first is the default."""

from __future__ import annotations

from collections.abc import Mapping

from gfmdlayer.body.materials import Law
from gfmdlayer.validation.sections import load_table

LAWS: Mapping[str, type[Law]] = load_table(
    "gfmdlayer.body.materials:Zener",
    "gfmdlayer.body.materials:Prony",
    "gfmdlayer.body.materials:Elastic",
    "gfmdlayer.body.continuous:FractionalZener",
    "gfmdlayer.body.continuous:PowerLaw",
    "gfmdlayer.body.continuous:Kohlrausch",
    "gfmdlayer.body.continuous:HavriliakNegami",
)
