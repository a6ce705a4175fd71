"""Columns of an isolated contact on a grid: totals, where a periodic one has means over the cell."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from gfmdlayer.observables.observable import Column

_WHOLE, _ENERGY, _SINCE = "of the whole contact", "force length", "from the beginning of the run"
_ON_A_LINE = {"length^2": "length", _ENERGY: "force / length length"}  # per length of the line

# By the columns, and attributes, of a periodic contact; None: has no meaning without a cell.
TOTALS: dict[str, Column | None] = {
    "contact_area": Column(
        "area",
        "contact area, contact points times the area of a point",
        "length^2",
        symbol="A",
        origin="of the whole contact; of a line, its width",
    ),
    "mean_pressure": None,
    "mean_stress": None,
    "mean_gap": None,
    "contact_area_interpolated": Column(
        "area_interpolated",
        "contact area, the edge located between the points",
        "length^2",
        origin="of the whole contact; the edge from pressure and gap beside it",
    ),
    "contact_area_error": Column(
        "area_error",
        "estimated error of area_interpolated",
        "length^2",
        origin="from the number of points across the contact",
    ),
    "work": Column("work", "work done by the punch, and by a changing voltage", _ENERGY, origin=_SINCE),
    "stored": Column("stored", "elastic energy stored", _ENERGY, origin="from the body at rest"),
    "dissipated": Column("dissipated", "energy dissipated", _ENERGY, origin=_SINCE),
    "energy_residual": Column(
        "energy_residual",
        "work - stored - dissipated - energy of the interface - plastic work - lost in instabilities",
        _ENERGY,
        origin=_SINCE,
    ),
    "plastic_work": Column(
        "plastic_work",
        "plastic work, the hardness (less the attraction in contact) times the volume of the imprint",
        _ENERGY,
        origin=_SINCE,
    ),
    "yielded_area": Column("yielded_area", "area whose pressure is the hardness", "length^2", origin=_WHOLE),
    "lost": Column("lost", "energy lost in instabilities", _ENERGY, origin=_SINCE),
    "instability_energy": Column(
        "instability_energy", "energy lost in each instability", _ENERGY, origin=_WHOLE
    ),
    "interface_energy": Column(
        "interface_energy", "energy of the interface, zero far away", _ENERGY, origin=_WHOLE
    ),
    "attractive_area": Column(
        "attracted_area",
        "area out of contact with at least a tenth of the largest traction",
        "length^2",
        origin=_WHOLE,
    ),
    "pull_off_stress": None,
    "work_of_separation": Column(
        "total_work_of_separation",
        "work of separation",
        _ENERGY,
        origin="over the steps in which the depth falls",
    ),
}


def of_one_contact(columns: Iterable[Column], *, line: bool) -> Iterator[Column]:
    """Yield the columns of an isolated contact for those of a periodic one."""
    for column in columns:
        if (total := TOTALS.get(column.name, column)) is not None:
            yield replace(total, units=_ON_A_LINE.get(total.units, total.units)) if line else total


def totals(values: Mapping[str, Any], cell: float) -> dict[str, Any]:
    """Return the columns of an isolated contact for those of a cell of an area, or length."""
    found = {}
    for name, value in values.items():
        total = TOTALS.get(name)
        if name not in TOTALS:
            found[name] = value
        elif total is not None:
            found[total.name] = value * cell
    return found
