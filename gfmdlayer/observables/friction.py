"""Friction of a moving punch: its position, the tangential force on it, and the centre of pressure.

Without friction at the interface the pressure p is normal to the surface, and where p is not even about a
slope of the surface it pulls along x by p du/dx. The mean of p du/dx over the surface is the tangential
stress against the motion; times the velocity it is the power that the body turns into heat. A punch that
rolls without friction meets the same resistance as one that slides: the normal contact is the same.

With P and U the transforms of p and u, the mean is sum_q w q Im(P conj(U)), w the weights of Parseval's sum.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts

if TYPE_CHECKING:
    from gfmdlayer.config import Config


class Friction(Observable):
    """Position, mean tangential stress, its ratio to the mean pressure, and the centre of pressure.

    The fields are on coordinates that move with the punch. The centre is found on the circle of one period.
    Friction and centre are NaN without contact.
    """

    COLUMNS = (
        Column("position", "position of the punch along x", "length", origin="from its place at t = 0"),
        Column(
            "tangential_force",
            "mean tangential stress against the motion along x",
            "pressure",
            origin="mean over the whole cell of pressure times slope of the surface",
        ),
        Column("friction", "tangential force / normal force", symbol=r"\mu", origin="of the whole cell"),
        Column(
            "contact_centre",
            "centre of pressure along x, from the middle of the punch",
            "length",
            origin="from the middle of the punch",
        ),
    )

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns where the punch moves along the surface."""
        return cls.COLUMNS if config.trajectory.moves else None

    def __init__(self, case: Parts) -> None:
        import numpy as np

        from gfmdlayer.time_functions import distance

        grid = case.grid
        assert case.velocity is not None
        self._position = partial(distance, case.velocity)
        self._transforms, self._period, self._sums = case.transforms, grid.period[0], grid.sums
        one, other = grid.wavenumbers_x
        # The grid does not distinguish the shortest wave from its opposite; their mean has no slope there.
        self._slope = np.ravel(grid.parseval_weights * (one + other) / 2)
        x = np.meshgrid(*grid.coordinates, indexing="ij", sparse=True)[0]
        phase = np.exp(2j * np.pi / self._period * x)
        self._phase = np.ravel(np.broadcast_to(phase, grid.shape))

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Return position, tangential stress, friction and centre of pressure."""
        pressure, mean = step.solution.pressure, self._sums.mean(step.solution.pressure)
        p, u = self._transforms.forward(pressure), step.surface.spectrum
        force = self._sums.total(float((self._slope * (p.imag * u.real - p.real * u.imag)).sum()))
        angle = cmath.phase(self._sums.total((self._phase * pressure).sum(keepdims=True))[0])
        return {
            "position": self._position(step.time),
            "tangential_force": force,
            "friction": force / mean if mean > 0 else math.nan,
            "contact_centre": angle * self._period / (2 * math.pi) if mean > 0 else math.nan,
        }
