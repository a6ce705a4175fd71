"""What resists a moving punch: tangential force, friction, and how far the contact is ahead.

Without friction at the interface the pressure p is normal to the surface, and where it is not even about a
slope it pulls along x by p du/dx. This mean of it over the surface is what the punch is pushed against; times
its velocity it is the power that the body turns into heat. A punch that rolls without friction meets the same
resistance as one that slides: the pressure is that of the same normal contact.
"""

from __future__ import annotations

import cmath
import math
from typing import Protocol

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.loading import Surface
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.punch.trajectory import Constant, Table, distance


class Travel(Protocol):
    """What there is to tell of the way of a punch along the surface."""

    @property
    def kinks(self) -> tuple[float, ...]:
        """Times at which the slope of its velocity jumps."""
        ...

    def columns(self, time: float, pressure: FloatArray, surface: Surface) -> dict[str, float]:
        """Observables of an accepted step."""
        ...


class Standing:
    """A punch that stays where it is."""

    kinks = ()

    def columns(self, _time: float, _pressure: FloatArray, _surface: Surface) -> dict[str, float]:
        """Tell nothing."""
        return {}


class Sliding:
    """A punch that moves along x; fields are on coordinates that move with it.

    Parameters
    ----------
    velocity : Constant or Table
        Of the punch over time.
    grid : Grid
        x is the distance from the middle of the punch.
    transforms : Transforms
        Of the grid.
    """

    def __init__(self, velocity: Constant | Table, grid: Grid, transforms: Transforms) -> None:
        one, other = grid.wavenumbers_x
        # A wave and its opposite, which the grid does not tell apart, have no slope at its points.
        self._slope = np.ravel(grid.parseval_weights * (one + other) / 2)
        self._period, self._transforms, self._velocity = grid.period[0], transforms, velocity
        x = np.meshgrid(*grid.coordinates, indexing="ij", sparse=True)[0]
        phase = np.exp(2j * np.pi / self._period * x)
        self._phase = np.ravel(np.broadcast_to(phase, grid.shape))

    @property
    def kinks(self) -> tuple[float, ...]:
        """Times at which the slope of its velocity jumps."""
        return self._velocity.kinks

    def columns(self, time: float, pressure: FloatArray, surface: Surface) -> dict[str, float]:
        """Position, mean tangential stress, its ratio to the mean pressure, and the centre of pressure.

        The centre is that on the circle which the period is. What has no meaning without contact is NaN.
        """
        p, u, mean = self._transforms.forward(pressure), surface.spectrum, float(pressure.mean())
        force = float(np.sum(self._slope * (p.imag * u.real - p.real * u.imag)))
        angle = cmath.phase(complex(np.sum(self._phase * pressure)))
        return {
            "position": distance(self._velocity, time),
            "tangential_force": force,
            "friction": force / mean if mean > 0 else math.nan,
            "contact_centre": angle * self._period / (2 * math.pi) if mean > 0 else math.nan,
        }


def make_travel(velocity: Constant | Table | None, grid: Grid, transforms: Transforms) -> Travel:
    """Return the way of a punch with this velocity, or without any."""
    return Standing() if velocity is None else Sliding(velocity, grid, transforms)
