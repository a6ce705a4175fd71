"""Depth and load control: the contact problem of a step, and the depth that belongs to its solution.

A solver finds a surface of zero mean, or under a given mean pressure p any surface w below the punch. The
mean of w is the depth plus u_0, the displacement at q = 0, which is zero unless a compressible layer lies on
a rigid base. There kappa_0 u_0 = b_0/n - p, and

    u = w - mean(w) + u_0,        depth = mean(w) - u_0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.interface.law import HARD_WALL, InterfaceLaw
from gfmdlayer.punch.trajectory import Trajectory

Values = TypeVar("Values", FloatArray, ComplexArray)


@dataclass(frozen=True)
class Surface:
    """Displacement of the surface and depth of the punch.

    Attributes
    ----------
    displacement : ndarray, one value a point
        u; length.
    spectrum : ndarray of complex
        Its unnormalised transform.
    depth : float
        Of the punch, below the height at which it touches the surface at rest; length.
    response : float
        The quantity that is not prescribed: the mean pressure, or the depth.
    """

    displacement: FloatArray
    spectrum: ComplexArray
    depth: float
    response: float


class Loading(Protocol):
    """The quantity that is prescribed over time, and the punch."""

    @property
    def trajectory(self) -> Trajectory:
        """The prescribed quantity as a function of time."""
        ...

    def problem(
        self, kappa: FloatArray, b: ComplexArray, time: float, loss_stiffness: FloatArray | None = None
    ) -> Problem:
        """Return the contact problem of a step.

        Parameters
        ----------
        kappa, b : ndarray
            Slopes and intercepts of the stress.
        time : float
            At the end of the step.
        loss_stiffness : ndarray, optional
            Imaginary part of the slopes, under a moving punch.
        """
        ...

    def surface(self, solution: Solution, kappa: FloatArray, b: ComplexArray, time: float, /) -> Surface:
        """Surface and depth that belong to a solution."""
        ...


@dataclass(frozen=True)
class _Prescribed:
    """A punch, by its height above its lowest point, and its trajectory."""

    punch: FloatArray
    trajectory: Trajectory
    interface: InterfaceLaw = HARD_WALL

    @cached_property
    def height(self) -> float:
        """Range of the punch's heights."""
        return float(self.punch.max() - self.punch.min())


@dataclass(frozen=True)
class DepthControl(_Prescribed):
    """The depth of the punch is prescribed."""

    def problem(
        self, kappa: FloatArray, b: ComplexArray, time: float, loss_stiffness: FloatArray | None = None
    ) -> Problem:
        """Contact problem of a step."""
        obstacle = self.punch - self.trajectory(time)
        return Problem(kappa, b, obstacle, None, loss_stiffness, self.height, self.interface.at(time))

    def surface(self, solution: Solution, _kappa: FloatArray, _b: ComplexArray, time: float, /) -> Surface:
        """Surface as the solver found it."""
        depth = self.trajectory(time)
        return Surface(solution.displacement, solution.spectrum, depth, solution.mean_pressure)


@dataclass(frozen=True)
class LoadControl(_Prescribed):
    """The mean pressure is prescribed."""

    def problem(
        self, kappa: FloatArray, b: ComplexArray, time: float, loss_stiffness: FloatArray | None = None
    ) -> Problem:
        """Contact problem of a step, without the mean."""
        kappa, b = _without_mean(kappa), _without_mean(b)
        load = self.trajectory(time)
        return Problem(kappa, b, self.punch, load, loss_stiffness, self.height, self.interface.at(time))

    def surface(self, solution: Solution, kappa: FloatArray, b: ComplexArray, time: float, /) -> Surface:
        """Surface with the mean that the load gives it."""
        size, mean = self.punch.size, 0.0
        if kappa[0] > 0:
            mean = (float(b[0].real) / size - self.trajectory(time)) / float(kappa[0])
        depth = float(np.mean(solution.displacement)) - mean
        spectrum = _without_mean(solution.spectrum)
        spectrum[0] = mean * size
        return Surface(solution.displacement - depth, spectrum, depth, depth)


def _without_mean(values: Values) -> Values:
    rest = values.copy()
    rest[0] = 0.0
    return rest


# The trajectory of a force is that of the mean pressure, force over cell.
CONTROLS: dict[str, Callable[[FloatArray, Trajectory, InterfaceLaw], Loading]] = {
    "depth": DepthControl,
    "load": LoadControl,
    "force": LoadControl,
}
