"""Observables of an interface that attracts: its energy, its zones, and how the punch is pulled off."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts

if TYPE_CHECKING:
    from gfmdlayer.config import Config

PART = 0.1  # of the largest traction; points with more are attracted
_RETRACTION = "over the steps in which the depth falls or rests"


class Adhesion(Observable):
    """Energy of the interface, attracted area and largest tension; pull-off and work of separation.

    The pull-off is the largest pull on the punch in the steps in which the depth falls or rests, without the
    pull of a surface that snaps into contact during the approach. The work of separation is the area between
    the curve of mean pressure against depth and zero, where the punch pulls while it retracts:

        - integral of min(pbar, 0) d(-depth)        over the steps in which the depth falls

    It is per area of the cell, like all energies, and adds up over several retractions.
    """

    COLUMNS = (
        Column(
            "interface_energy",
            "energy of the interface per area, zero far away",
            "pressure length",
            origin="mean over the whole cell",
        ),
        Column(
            "attractive_area",
            f"part of the surface out of contact with at least {PART:g} of the largest traction",
            origin="over the cell",
        ),
        Column("largest_tension", "largest tension of the surface", "pressure", origin="over the points"),
    )
    NUMBERS = (
        Column(
            "pull_off_force", "pull-off force, the largest pull in retraction", "force", origin=_RETRACTION
        ),
        Column("pull_off_stress", "pull-off force over the area of the cell", "pressure", origin=_RETRACTION),
        Column(
            "work_of_separation",
            "work of separation per area of the cell",
            "pressure length",
            origin="over the steps in which the depth falls",
        ),
    )
    KEPT = "force", "stress", "work", "last"

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns of a case whose interface attracts."""
        return cls.COLUMNS if config.interfaces else None

    def __init__(self, case: Parts) -> None:
        self._sums = case.grid.sums
        self._force = self._stress = self._work = 0.0
        self._last: tuple[float, ...] = ()  # depth and mean pressure

    @property
    def attributes(self) -> Mapping[str, float]:  # type: ignore[override]
        """The numbers of the run so far."""
        values = self._force, self._stress, self._work
        return {column.name: value for column, value in zip(self.NUMBERS, values, strict=True)}

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Return the columns, and remember the pull."""
        from gfmdlayer.observables.contact_statistics import in_contact

        solution, law = step.solution, step.problem.interface
        traction = law.traction(solution.gap)
        apart = ~in_contact(step.problem, solution)
        self._pull(step.surface.depth, solution.mean_pressure, float(step.row["force"]))
        attracted = apart & (traction >= PART * law.strength) if law.attracts else apart & False
        return {
            "interface_energy": self._sums.mean(law.energy(solution.gap)),
            "attractive_area": self._sums.mean(attracted.astype(float)),
            "largest_tension": max(-self._sums.minimum(float(solution.pressure.min())), 0.0),
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
