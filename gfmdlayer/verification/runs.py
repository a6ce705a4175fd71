"""Runs of the paper's default case with some values changed, in memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.case import Case, Parts
from gfmdlayer.config import Config
from gfmdlayer.punch.trajectory import Trajectory
from gfmdlayer.simulation import simulate, warm_up

HALFSPACE: dict[str, object] = {"layer.thickness": 0.0}  # of G_bulk = 1: elastic, E* = 4
ALONE: dict[str, object] = {"layer.thickness": float("inf")}
RIGID: dict[str, object] = {"halfspace.shear_modulus": float("inf")}
ELASTIC: dict[str, object] = {"layer.material.Ginf": 1.0}
ONE_STEP: dict[str, object] = {"time.end": 1.0, "time.step": 1.0}


class Recording:
    """A recorder in memory; `recording["contact_area"]` is a column of its rows."""

    def __init__(self) -> None:
        self._rows: list[dict[str, Any]] = []
        self.snapshots: list[tuple[float, FloatArray, FloatArray]] = []

    def row(self, **values: float | FloatArray) -> None:
        """Keep the observables of a step."""
        self._rows.append(values)

    def snapshot(
        self, time: float, displacement: FloatArray, pressure: FloatArray, _gap: FloatArray, /
    ) -> None:
        """Keep time, displacement and pressure."""
        self.snapshots.append((time, displacement, pressure))

    def note(self, **attributes: float) -> None:
        """Ignore the attributes of the run."""

    def __getitem__(self, name: str) -> FloatArray:
        """Return a column of the rows."""
        return np.array([row[name] for row in self._rows])

    def last(self, name: str) -> float:
        """Return the last value of a column."""
        return float(self._rows[-1][name])

    def at(self, name: str, times: Iterable[float]) -> FloatArray:
        """Return the values of a column at times that are rows.

        Raises
        ------
        ValueError
            A time is not that of a row.
        """
        rows, known = [], self["time"]
        for time in times:
            rows.append(int(np.argmin(np.abs(known - time))))
            if abs(known[rows[-1]] - time) > 1e-9 * known[-1]:
                raise ValueError(f"no row at t = {time:g}")
        return self[name][rows]


def run(*values: Mapping[str, object], trajectory: Trajectory | None = None) -> Recording:
    """Run the paper's default case with these dotted values in it, later ones before earlier ones.

    A trajectory takes the place of that of the configuration.
    """
    config = Config(name="verification").with_values({key: each[key] for each in values for key in each})
    recording = Recording()
    parts: Parts = {} if trajectory is None else {"trajectory": trajectory}
    simulate(Case(config, warm_up(config), **parts), recording)
    return recording


def difference(found: Recording, reference: Recording, column: str = "mean_pressure") -> float:
    """Largest difference of a column, relative to the largest value of the reference."""
    exact = reference[column]
    return float(np.abs(found[column] - exact).max() / exact.max())
