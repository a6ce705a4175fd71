"""What the physics tests share: a recorder, runs on a small grid, and the elastic closed form."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import spence

from gfmdlayer.config import Config
from gfmdlayer.simulation import simulate

Floats = NDArray[np.float64]


@dataclass
class Recording:
    """A recorder that keeps everything; `recording["contact_area"]` is a column of its rows."""

    rows: list[dict[str, float]] = field(default_factory=list)
    snapshots: list[tuple[float, Floats, Floats]] = field(default_factory=list)

    def row(self, **values: float) -> None:
        self.rows.append(values)

    def snapshot(self, time: float, displacement: Floats, pressure: Floats) -> None:
        self.snapshots.append((time, displacement, pressure))

    def __getitem__(self, name: str) -> Floats:
        return np.array([row[name] for row in self.rows])

    def at(self, name: str, times: Iterable[float]) -> Floats:
        """Values of a column at times that are rows."""
        rows = [int(np.argmin(np.abs(self["time"] - time))) for time in times]
        np.testing.assert_allclose(self["time"][rows], list(times), rtol=1e-9)
        return self[name][rows]


@pytest.fixture(scope="session")
def run() -> Callable[..., Recording]:
    """Run the paper's default case with these dotted values in it, on fewer points and with longer steps."""

    def run(values: dict[str, object]) -> Recording:
        coarse = {"grid.points": 2048, "time.integrator": "exponential", "time.step": 0.05}
        recording = Recording()
        simulate(Config(name="test").with_values(coarse | values), recording)
        return recording

    return run


@pytest.fixture(scope="session")
def parabola_on_halfspace() -> Callable[[ArrayLike], tuple[Floats, Floats]]:
    """Contact fraction and pbar/2G of a periodic parabola, R = L/4, on an incompressible halfspace.

    From the depth; pbar = -(E* L/(2 pi R)) ln cos phi and depth = (L^2/(4 pi^2 R)) (pi^2/6 - Li2(cos^2 phi))
    with phi = pi atilde/2 and E* = 4 G.
    """

    def answer(depths: ArrayLike) -> tuple[Floats, Floats]:
        def excess(phi: float, depth: float) -> float:
            return float((np.pi**2 / 6 - spence(np.sin(phi) ** 2)) / np.pi**2 - depth)

        phi = np.array([brentq(excess, 0, 1.57, args=(d,), xtol=1e-15) for d in np.atleast_1d(depths)])
        return 2 * phi / np.pi, -4 / np.pi * np.log(np.cos(phi))

    return answer
