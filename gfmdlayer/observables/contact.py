"""Columns of the contact: time, depth, area, pressure, force, statistics of a rough contact, temperature."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gfmdlayer.observables.observable import Bins, Column, Observable, Observed, Value, declared

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.config.sections import Histogram
    from gfmdlayer.step import Step


TIME, AREA, PRESSURE, DEPTH, RESIDUAL = declared(r"""
    time | time | time | from the beginning of the run | t
    contact_area | relative contact area atilde, contact points / all points | 1 | over the cell | \tilde{a}
    mean_pressure | mean pressure over the cell ptilde = pbar / (2 G0) | 1 |
      mean over the whole cell; G0 of the uppermost layer | \tilde{p}
    depth | indentation depth of the punch | length |
      from the height at which the punch touches the surface at rest | \delta
    residual | residual of the contact problem when the step was accepted | 1 |
      relative to the largest pressure and the depth
    """)


class ContactMeans(Observable):
    """Time, contact area, mean pressure in units of twice the relaxed modulus, depth, and residual."""

    COLUMNS = TIME, AREA, PRESSURE, DEPTH, RESIDUAL

    def __init__(self, case: Observed) -> None:
        self._unit = 2 * case.config.solid.unit

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return the columns of the solution."""
        return {
            "time": step.time,
            "contact_area": step.contact_area,
            "mean_pressure": step.mean_pressure / self._unit,
            "depth": step.depth,
            "residual": step.residual,
        }


class Force(Observable):
    """Mean pressure over the cell, and the force over the cell: of a line contact, per length of the line."""

    COLUMNS = declared(r"""
        mean_stress | mean pressure over the cell pbar | pressure | mean over the whole cell | \bar{p}
        force | force on the punch over the cell | force |
          mean_stress times the area of the cell; of a line, its period | F
        """)

    def __init__(self, case: Observed) -> None:
        self._cell = math.prod(case.grid.period)

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return pbar, and pbar times the area of the cell or its length."""
        mean = step.mean_pressure
        return {"mean_stress": mean, "force": mean * self._cell}


FEWEST = 30  # a run is coarse if its largest contact has fewer points
UPSIDE_DOWN = (
    "is the punch upside down? It touches first in a cusp at the edge of the cell. Of arrays and topography "
    "files the largest height touches first, of profile files the lowest, unless touches_first: highest"
)


class Resolution(Observable):
    """Contact area by edges between the points; attribute `most_contact_points`, the most in any step."""

    COLUMNS = declared(r"""
        contact_area_interpolated | relative contact area, the edge located between the points | 1 |
          over the cell; the edge from pressure and gap beside it | \tilde{a}
        contact_area_error | estimated error of contact_area_interpolated | 1 |
          over the cell; from the number of points across the contact
        """)
    KEPT = ("most",)

    def __init__(self, case: Observed) -> None:
        self._grid, self._punch, self._most = case.grid, case.punch, 0
        self._config = case.config

    @property
    def attributes(self) -> Mapping[str, int]:  # type: ignore[override]
        """The most points in contact so far."""
        return {"most_contact_points": self._most}

    @property
    def warning(self) -> str:  # type: ignore[override]
        """A line where these are few."""
        if not 0 < self._most < FEWEST:
            return ""
        from gfmdlayer.observables.contact_statistics import is_upside_down

        touching = f"{self._most} point{'s' * (self._most != 1)}"
        from gfmdlayer.grid.grid import finer

        enough = finer(self._grid.points, (FEWEST / self._most) ** (1 / len(self._grid.points)))
        advice = f"take more grid.points: {enough}"
        if is_upside_down(self._punch, self._grid):
            advice = UPSIDE_DOWN
        elif not self._config.refines:
            advice = "these are its atoms; a larger punch or depth has more"
        return f"COARSE: at most {touching} in contact; {advice}"

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return the area, and remember the number of points."""
        from gfmdlayer.observables.contact_statistics import contact_extent

        touching, pressure, gap = (step.fields[name] for name in ("touching", "wall_pressure", "distance"))
        extent = contact_extent(touching, pressure, gap, self._grid)
        self._most = max(self._most, extent.points)
        return {"contact_area_interpolated": extent.area, "contact_area_error": extent.error}


class Yielding(Observable):
    """Work of the pressures that have reached the hardness, and the area at the hardness."""

    COLUMNS = declared("""
        plastic_work | plastic work per area, the hardness (less the attraction in contact) times the mean
          imprint | pressure length | from the beginning of the run
        yielded_area | part of the surface whose pressure is the hardness | 1 | over the cell
        """)
    KEPT = ("work",)

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns of a case whose surfaces yield."""
        return None if config.hardness is None else cls.COLUMNS

    def __init__(self, case: Observed) -> None:
        self._sums, self._work = case.grid.sums, 0.0

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return both; the work adds up over the steps."""
        self._work += step.plastic_work
        at_hardness = step.fields["at_hardness"].astype(float)
        return {"plastic_work": self._work, "yielded_area": self._sums.mean(at_hardness)}


MEAN_GAP, PATCHES = declared(r"""
    mean_gap | mean gap between surface and punch | length | over the whole cell; 0 in contact | \bar{g}
    patches | number of connected patches of contact | 1 | in the cell | | i8
    """)


class ContactStatistics(Observable):
    """Mean gap and, on request, number of patches and histograms of pressure and gap.

    The histogram of the pressure is over the points in contact and sums to the contact area; the histogram of
    the gap is over the other points and sums to the rest of 1.
    """

    COLUMNS = (MEAN_GAP,)

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...]:
        """Return the mean gap and the columns that `output` asks for."""
        asked, columns = config.output, [MEAN_GAP]
        if asked.patches:
            columns.append(PATCHES)
        if asked.histograms.pressure is not None:
            bins = Bins("pressure_bin", "pressure", "pressure", _bin_edges(asked.histograms.pressure))
            name = "part of the surface in contact with a pressure in the bin; the sum is the contact area"
            columns.append(Column("pressure_histogram", name, along=bins, origin="over the cell"))
        if asked.histograms.gap is not None:
            bins = Bins("gap_bin", "the gap", "length", _bin_edges(asked.histograms.gap))
            name = "part of the surface out of contact with a gap in the bin; the sum is 1 - contact area"
            columns.append(Column("gap_histogram", name, along=bins, origin="over the cell"))
        return tuple(columns)

    def __init__(self, case: Observed) -> None:
        import numpy as np

        asked = {column.name: column.along for column in self.columns(case.config)}
        self._grid, self._counts_patches = case.grid, PATCHES.name in asked
        self._edges = {name: np.array(bins.edges) for name, bins in asked.items() if bins is not None}

    def measure(self, step: Step) -> Mapping[str, Value]:
        """Return mean gap, patches and histograms."""
        row: dict[str, Value] = {"mean_gap": step.mean_gap}
        if not (self._counts_patches or self._edges):
            return row
        from gfmdlayer.observables.contact_statistics import count_patches, histogram

        touching = step.fields["touching"]
        if self._counts_patches:
            row["patches"] = count_patches(touching.reshape(self._grid.shape), self._grid)
        for name, edges in self._edges.items():
            of_pressure = name == "pressure_histogram"
            values = step.fields["pressure" if of_pressure else "distance"]
            chosen = touching if of_pressure else ~touching
            row[name] = histogram(values, chosen, edges, self._grid.ranks)
        return row


def _bin_edges(asked: Histogram) -> tuple[float, ...]:
    """Edges of the bins of a histogram, with 0 and inf.

    Values beyond `max` and, on a log scale, below `min` have a bin of their own.
    """
    import numpy as np

    if asked.scale == "linear":
        inner = np.linspace(0.0, asked.max, asked.bins + 1)[1:]
    else:
        assert asked.min is not None
        inner = np.geomspace(asked.min, asked.max, asked.bins + 1)
    return (0.0, *inner.tolist(), np.inf)


class TemperatureColumns(Observable):
    """Temperature of the body, and the factor of relaxation times of the uppermost material with a shift."""

    COLUMNS = declared("""
        temperature | temperature of the body | degrees Celsius | as given | T
        shift_factor | aT, factor of relaxation times, of the uppermost material with a shift | 1 |
          from the relaxation times at the reference temperature
        """)

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns of a case with a temperature."""
        return None if config.temperature is None else cls.COLUMNS

    def __init__(self, case: Observed) -> None:
        self._reduced_time = next(filter(None, case.drives.reduced_times))

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return both at the end of the step."""
        temperature = self._reduced_time.temperature(step.time)
        return {"temperature": temperature, "shift_factor": self._reduced_time.shift.factor(temperature)}


# Columns of isolated contacts; forces and energies are those of the whole contact.

INDENTATION = (
    TIME,
    *declared(r"""
    force | force on the indenter | force | of the whole contact | F
    depth | depth of the indenter below the undeformed surface | length | from the undeformed surface | \delta
    contact_radius | radius of the contact | length | from the axis | a
    work | work done by the indenter | force length | from the beginning of the run
    stored | elastic energy stored | force length | from the body at rest
    dissipated | energy dissipated | force length | from the beginning of the run
    energy_residual | work - stored - dissipated | force length | from the beginning of the run
    """),
)

_ON_A_LINE = {"length^2": "length", "force length": "force / length length"}  # per length of the line
_TOTALS = declared(r"""
    area | contact area, contact points times the area of a point | length^2 |
      of the whole contact; of a line, its width | A
    area_interpolated | contact area, the edge located between the points | length^2 |
      of the whole contact; the edge from pressure and gap beside it | A
    area_error | estimated error of area_interpolated | length^2 |
      from the number of points across the contact
    work | work done by the punch, and by a changing voltage | force length | from the beginning of the run
    stored | elastic energy stored | force length | from the body at rest
    dissipated | energy dissipated | force length | from the beginning of the run
    energy_residual | work - stored - dissipated - energy of the interface - plastic work - heat of slip
      - lost in instabilities | force length | from the beginning of the run
    tangential_force | tangential force of the punch | force | of the whole contact, along the drive | T
    transverse_force | tangential force across the drive | force | of the whole contact, to the left of it
    drag_force | tangential force on the moving punch | force | of the whole contact, see its mean |
      T_\mathrm{drag}
    spin_moment | moment of the shear traction on the body | force length | of the whole contact, to the left,
      about the middle of the punch | M_z
    stick_area | area that sticks to the punch | length^2 | of the whole contact; of a line, its width |
      A_\mathrm{stick}
    slip_heat | heat of slip | force length | from the beginning of the run
    plastic_work | plastic work, the hardness (less the attraction in contact) times the volume of the
      imprint | force length | from the beginning of the run
    yielded_area | area whose pressure is the hardness | length^2 | of the whole contact
    lost | energy lost in instabilities | force length | from the beginning of the run
    instability_energy | energy lost in each instability | force length | of the whole contact
    interface_energy | energy of the interface, zero far away | force length | of the whole contact
    attracted_area | area out of contact with at least a tenth of the largest traction | length^2 |
      of the whole contact
    total_work_of_separation | work of separation | force length |
      over the steps in which the depth falls | W_\mathrm{sep}
    """)
_OTHER_NAMES = {
    "area": "contact_area", "area_interpolated": "contact_area_interpolated",
    "area_error": "contact_area_error", "attracted_area": "attractive_area",
    "total_work_of_separation": "work_of_separation",
}  # fmt: skip
_OF_A_CELL = ("mean_pressure", "mean_stress", "mean_gap", "pull_off_stress")

# By the columns, and attributes, of a periodic contact; None: has no meaning without a cell.
TOTALS: dict[str, Column | None] = dict.fromkeys(_OF_A_CELL) | {
    _OTHER_NAMES.get(column.name, column.name): column for column in _TOTALS
}


def of_one_contact(columns: Iterable[Column], *, line: bool = False, whole: bool = True) -> Iterator[Column]:
    """Yield the columns of an isolated contact for those of a periodic one; it is `whole`, or has periods."""
    for column in columns:
        if (total := TOTALS.get(column.name, column)) is not None:
            if not whole:
                total = replace(total, origin=total.origin.replace("the whole contact", "one period"))
            yield replace(total, units=_ON_A_LINE.get(total.units, total.units)) if line else total


def totals(values: Mapping[str, Any], cell: float) -> dict[str, Any]:
    """Return the columns of an isolated contact for those of a cell of an area, or length."""
    columns = {}
    for name, value in values.items():
        total = TOTALS.get(name)
        if name not in TOTALS:
            columns[name] = value
        elif total is not None:
            columns[total.name] = value * cell
    return columns
