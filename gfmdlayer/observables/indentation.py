"""Columns of an isolated, axisymmetric indentation; forces and energies are those of the whole contact."""

from __future__ import annotations

from gfmdlayer.observables.contact import TIME
from gfmdlayer.observables.observable import Column

_ENERGY, _SINCE = "force length", "from the beginning of the run"

INDENTATION = (
    TIME,
    Column("force", "force on the indenter", "force", symbol="F", origin="of the whole contact"),
    Column(
        "depth",
        "depth of the indenter below the undeformed surface",
        "length",
        symbol=r"\delta",
        origin="from the undeformed surface",
    ),
    Column("contact_radius", "radius of the contact", "length", symbol="a", origin="from the axis"),
    Column("work", "work done by the indenter", _ENERGY, origin=_SINCE),
    Column("stored", "elastic energy stored", _ENERGY, origin="from the body at rest"),
    Column("dissipated", "energy dissipated", _ENERGY, origin=_SINCE),
    Column("energy_residual", "work - stored - dissipated", _ENERGY, origin=_SINCE),
)
