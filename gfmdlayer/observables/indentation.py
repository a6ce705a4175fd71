"""Columns of an isolated, axisymmetric indentation; forces and energies are those of the whole contact."""

from __future__ import annotations

from gfmdlayer.observables.contact_means import TIME
from gfmdlayer.observables.observable import Column

_ENERGY = "force length"

INDENTATION = (
    TIME,
    Column("force", "force on the indenter", "force", symbol="F"),
    Column("depth", "depth of the indenter below the undeformed surface", "length", symbol=r"\delta"),
    Column("contact_radius", "radius of the contact", "length", symbol="a"),
    Column("work", "work done by the indenter", _ENERGY),
    Column("stored", "elastic energy stored", _ENERGY),
    Column("dissipated", "energy dissipated", _ENERGY),
    Column("energy_residual", "work - stored - dissipated", _ENERGY),
)
