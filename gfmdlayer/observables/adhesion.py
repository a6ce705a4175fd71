"""An interface that attracts: its energy, its zones, the pull-off, and its instabilities.

An instability ends a branch of equilibria. The work of the punch over its step follows from two branches. The
prescribed quantity x, depth or mean pressure, changes evenly. The other quantity y follows a branch up to
its end at x_f, jumps, and follows another branch. Near the end the margin of the branch, m (`Solution`),
falls like the root of the distance, m^2 ~ x_f - x, and y changes linearly with m. So the last two rows of the
branch, -1 and 0, give place and response at its end,

    x_f = x_0 + (x_0 - x_-1) m_0^2/(m_-1^2 - m_0^2),        y_f = y_0 + (y_0 - y_-1) m_0/(m_-1 - m_0)

and the work int y dx is (x_f - x_0) (2 y_0 + y_f)/3 on the first branch, where y is a parabola on its side,
and (x_1 - x_f) y_1 on the second. If the step ends before x_f, only the first branch counts, up to the margin
r m_0 at the end of the step, and y_f - y_0 in the mean is less by the factor (1 - r)(1 + 2 r)/(1 + r). The
errors of x_f, of the work and of the lost energy are of order 3/2 in the step. Where the margin gives no end,
as for a flat punch that detaches at once, or on rough surfaces, of which several spots may jump in one step,
the solver takes the work by the trapezoidal rule. If the branch ends at the beginning or at the end of the
step, this differs by half the area |(x_1 - x_0) (y_1 - y_0)| (`across`): the bound that is listed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

from gfmdlayer.observables.observable import Column, Observable, Observed, declared

if TYPE_CHECKING:
    from gfmdlayer.arrays import Attribute
    from gfmdlayer.config import Config
    from gfmdlayer.step import Step

PART = 0.1  # of the largest traction; points with more are attracted


class AdhesionColumns(Observable):
    """Energy of the interface, attracted area and largest tension; pull-off and work of separation.

    The pull-off is the largest pull on the punch in the steps in which the depth falls or rests, without the
    pull of a surface that snaps into contact during the approach. The work of separation is the area between
    the curve of mean pressure against depth and zero, where the punch pulls while it retracts:

        - integral of min(pbar, 0) d(-depth)        over the steps in which the depth falls

    It is per area of the cell, like all energies, and adds up over several retractions.
    """

    COLUMNS = declared(f"""
        interface_energy | energy of the interface per area, zero far away | pressure length |
          mean over the whole cell
        attractive_area | part of the surface out of contact with at least {PART:g} of the largest traction |
          1 | over the cell
        largest_tension | largest tension of the surface | pressure | over the points
        """)
    NUMBERS = declared(r"""
        pull_off_force | pull-off force, the largest pull in retraction | force |
          over the steps in which the depth falls or rests | F_\mathrm{pull}
        pull_off_stress | pull-off force over the area of the cell | pressure |
          over the steps in which the depth falls or rests | \bar{p}_\mathrm{pull}
        work_of_separation | work of separation per area of the cell | pressure length |
          over the steps in which the depth falls | W_\mathrm{sep}
        """)
    KEPT = "force", "stress", "work", "last"

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns of a case whose interface attracts."""
        return cls.COLUMNS if config.interfaces else None

    def __init__(self, case: Observed) -> None:
        self._sums, self._size = case.grid.sums, case.grid.size
        self._force = self._stress = self._work = 0.0
        self._last: tuple[float, ...] = ()  # depth and mean pressure

    @property
    def attributes(self) -> Mapping[str, float]:  # type: ignore[override]
        """The numbers of the run so far."""
        values = self._force, self._stress, self._work
        return {column.name: value for column, value in zip(self.NUMBERS, values, strict=True)}

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return the columns, and remember the pull."""
        from gfmdlayer.observables.contact_statistics import attracted

        law, fields, sums, points = step.interface, step.fields, self._sums, 0
        self._pull(step.depth, step.mean_pressure, float(step.row["force"]))
        if law.attracts:
            points = attracted(fields["touching"], fields["traction"], PART * law.strength)
        return {
            "interface_energy": sums.mean(law.energy(fields["distance"])),
            "attractive_area": sums.total(points) / self._size,
            "largest_tension": max(-sums.minimum(float(fields["pressure"].min())), 0.0),
        }

    def _pull(self, depth: float, pressure: float, force: float) -> None:
        if self._last and depth <= self._last[0]:
            self._force, self._stress = max(self._force, -force), max(self._stress, -pressure)
            before, now = max(-self._last[1], 0.0), max(-pressure, 0.0)
            part = 1.0  # of the step, in which the punch pulls
            if min(self._last[1], pressure) < 0 < max(self._last[1], pressure):
                part = max(before, now) / abs(pressure - self._last[1])
            self._work += 0.5 * (before + now) * (self._last[0] - depth) * part
        self._last = depth, pressure


Point = tuple[float, float]

# Number of instabilities that are listed with a case, those with the largest losses; `lost` has all of them.
MOST_LISTED = 1000


class PathPoint(NamedTuple):
    """An accepted step on the way of the punch; the first five fields are a row of `history.path_work`."""

    time: float
    depth: float
    pressure: float
    prescribed: float
    swept: float  # since the step before
    margin: float

    @property
    def point(self) -> Point:
        """Point of the curve whose area is the work."""
        return self.depth, self.pressure


def work_over_fold(*rows: PathPoint, depth_given: bool) -> tuple[float, float] | None:
    """Work per area over a step with an instability, and the part of the step before it; None if not known.

    The rows are the last one or two of the branch that ends, and the row after the step. `depth_given` says
    whether the depth is prescribed, or the mean pressure.
    """
    if len(rows) < 3:
        return None
    last, before, after = rows
    if not (last.margin > before.margin > 0 and after.time > before.time):  # or NaN
        return None
    fallen = last.margin**2 - before.margin**2
    part = before.margin**2 / fallen * (before.time - last.time) / (after.time - before.time)
    rest = math.sqrt(max(1 - 1 / part, 0.0))  # of the margin at the end of the step
    further = (1 - rest) * before.margin / (last.margin - before.margin)
    further *= (1 + 2 * rest) / (1 + rest)  # where the parabola is cut
    part = min(part, 1.0)
    (_, y), (x0, y0), (x1, y1) = (
        row.point if depth_given else row.point[::-1] for row in (last, before, after)
    )
    area = (x1 - x0) * (part * (y0 + further * (y0 - y) / 3) + (1 - part) * y1)
    return (area if depth_given else x1 * y1 - x0 * y0 - area), part


def across(start: Point, end: Point) -> float:
    """Half of the area of the rectangle between two points."""
    return abs((end[0] - start[0]) * (end[1] - start[1])) / 2


class Instabilities(Observable):
    """Lists the instabilities of a case in its attributes."""

    KEPT = "lost", "count", "found", "last"

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return no columns, in a case whose interface attracts."""
        return () if config.interfaces else None

    def __init__(self, _case: Observed) -> None:
        self._lost, self._count = 0.0, 0
        self._found: list[tuple[float, float, float, float]] = []  # times, depths, energies, bounds of errors
        self._last: Point = 0.0, 0.0  # depth and mean pressure

    @property
    def attributes(self) -> Mapping[str, Attribute]:  # type: ignore[override]
        """The instabilities in the order of time: times, depths, energies, bounds of error; their number."""
        import numpy as np

        if not self._found:
            return {"instabilities": 0}
        names = "time", "depth", "energy", "error"
        listed = dict(zip(names, np.array(self._found).reshape(-1, 4).T, strict=True))
        return {"instabilities": self._count} | {
            f"instability_{name}": values for name, values in listed.items()
        }

    def measure(self, step: Step) -> Mapping[str, float]:
        """Remember the energy that was lost in a step."""
        lost, now = float(step.row["lost"]), (step.depth, step.mean_pressure)
        if lost > self._lost:
            self._found.append((step.time, now[0], lost - self._lost, across(self._last, now)))
            self._lost, self._count = lost, self._count + 1
            if len(self._found) > MOST_LISTED:
                self._found.remove(min(self._found, key=lambda instability: instability[2]))
        self._last = now
        return {}
