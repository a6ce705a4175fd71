"""The laws of the layer's material that a configuration may name. The first is the default."""

from __future__ import annotations

from collections.abc import Mapping

from gfmdlayer.body.materials import Material
from gfmdlayer.validation.sections import load_table

LAWS: Mapping[str, type[Material]] = load_table(
    "gfmdlayer.body.materials:Zener",
    "gfmdlayer.body.materials:Prony",
)
