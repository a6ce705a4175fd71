"""The results of one case in memory: the dataset that opening its file would give."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.arrays import Attribute, FloatArray
from gfmdlayer.observables import Column
from gfmdlayer.results.provenance import now, provenance
from gfmdlayer.results.schema import FIELDS, VARIABLES, Variable

if TYPE_CHECKING:
    import xarray


class Recording:
    """A recorder in memory."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []
        self.fields: list[tuple[Any, ...]] = []  # time, then some of FIELDS
        self.noted: dict[str, Attribute] = {}
        self._started, self._begun = now(), time.monotonic()

    def row(self, **values: float | FloatArray) -> None:
        """Keep the observables of a step."""
        self.rows.append(values)

    def snapshot(
        self,
        time: float,
        displacement: FloatArray,
        pressure: FloatArray,
        gap: FloatArray,
        traction: FloatArray | None = None,
        /,
    ) -> None:
        """Keep time, displacement, pressure and gap, and the traction if there is attraction."""
        fields = displacement, pressure, gap, *([] if traction is None else [traction])
        self.fields.append((time, *fields))

    def note(self, **attributes: Attribute) -> None:
        """Keep attributes of the run."""
        self.noted.update(attributes)

    def dataset(
        self,
        coordinates: Mapping[str, ArrayLike],
        columns: Sequence[Column],
        attributes: Mapping[str, str | float],
        unit: Callable[[str], str] = str,
    ) -> xarray.Dataset:
        """Return what has been recorded.

        Parameters
        ----------
        coordinates : mapping
            The grid's coordinates, {"x": x} or {"x": x, "y": y}.
        columns : sequence of Column
            Columns that the rows may have.
        attributes : mapping
            Attributes of the case, in addition to the provenance.
        unit : callable
            Label of a unit, from its words.

        Returns
        -------
        xarray.Dataset
            As `open_case` gives it.
        """
        import xarray

        columns = [column.in_units(unit) for column in columns]
        known = {name: each.in_units(unit) for name, each in VARIABLES.items()}
        held: dict[str, Any] = {
            name: ((name,), np.asarray(x, dtype=np.float64), known[name].described)
            for name, x in coordinates.items()
        }
        held |= self._columns(columns)
        held |= self._snapshots({name: len(held[name][1]) for name in coordinates}, known)
        ended = {"started": self._started, "finished": now(), "wall_seconds": time.monotonic() - self._begun}
        counts = {"rows": len(self.rows), "snapshots": len(self.fields), "complete": 1}
        described = {**provenance(), **ended, **attributes, **self.noted, **counts}
        indices = {name for name, (dims, *_) in held.items() if dims == (name,)}
        ends = {f"{each.along.name}_end" for each in columns if each.along is not None}
        coords = {name: held.pop(name) for name in indices | (ends & held.keys())}
        return xarray.Dataset(held, coords, described)

    def _columns(self, columns: Sequence[Column]) -> dict[str, Any]:
        declared = {column.name: column for column in columns}
        names = self.rows[0] if self.rows else ("time",)
        found: dict[str, Any] = {}
        for each in (declared[name] for name in names):
            values = np.array([row[each.name] for row in self.rows], dtype=each.dtype)
            found[each.name] = (
                ("time", each.along.name) if each.along else ("time",),
                values,
                each.described,
            )
            if each.along is not None:
                bins = each.along
                for name, end, edges in (
                    (bins.name, "lower", bins.edges[:-1]),
                    (f"{bins.name}_end", "upper", bins.edges[1:]),
                ):
                    meaning = {"long_name": f"{end} end of the bin of {bins.quantity}", "units": bins.units}
                    found[name] = ((bins.name,), np.array(edges), meaning)
        return found

    def _snapshots(self, lengths: Mapping[str, int], known: Mapping[str, Variable]) -> dict[str, Any]:
        times = np.array([time for time, *_ in self.fields], dtype=np.float64)
        found: dict[str, Any] = {"snapshot": (("snapshot",), times, known["snapshot"].described)}
        for place, name in enumerate(FIELDS, start=1):
            if place < len(self.fields[0]) if self.fields else place <= 2:  # as in a file
                values = np.reshape([fields[place] for fields in self.fields], (-1, *lengths.values()))
                found[name] = (("snapshot", *lengths), values, known[name].described)
        return found
