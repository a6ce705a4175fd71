"""What a prescribed depth or load makes of the contact problem of a step, and of its solution.

A solver finds a surface of zero mean, or under a given mean pressure p any surface w below the punch, whose
mean is the depth but for how far the body yields as a whole: by u_0, the displacement at q = 0, which is zero
unless a compressible layer lies on a rigid base. There kappa_0 u_0 = b_0/n - p, and

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
from gfmdlayer.punch.trajectory import Trajectory

Values = TypeVar("Values", FloatArray, ComplexArray)


@dataclass(frozen=True)
class Surface:
    """Where the surface and the punch are.

    Attributes
    ----------
    displacement : ndarray
        u, one value a point.
    spectrum : ndarray of complex
        Its unnormalised transform.
    depth : float
        Of the punch, below the height at which it touches the surface at rest.
    found : float
        What was not prescribed: the mean pressure, or the depth.
    """

    displacement: FloatArray
    spectrum: ComplexArray
    depth: float
    found: float


class Loading(Protocol):
    """What is prescribed over time."""

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
        """Surface and depth that a solution stands for."""
        ...


@dataclass(frozen=True)
class _Prescribed:
    """A punch, by its height above its lowest point, and what is prescribed of it."""

    punch: FloatArray
    trajectory: Trajectory

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
        return Problem(kappa, b, obstacle, loss_stiffness=loss_stiffness, height=self.height)

    def surface(self, solution: Solution, _kappa: FloatArray, _b: ComplexArray, time: float, /) -> Surface:
        """Surface as it was found."""
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
        return Problem(kappa, b, self.punch, self.trajectory(time), loss_stiffness, self.height)

    def surface(self, solution: Solution, kappa: FloatArray, b: ComplexArray, time: float, /) -> Surface:
        """Surface with the mean that the load gives it."""
        size, yielding = self.punch.size, 0.0
        if kappa[0] > 0:
            yielding = (float(b[0].real) / size - self.trajectory(time)) / float(kappa[0])
        depth = float(np.mean(solution.displacement)) - yielding
        spectrum = _without_mean(solution.spectrum)
        spectrum[0] = yielding * size
        return Surface(solution.displacement - depth, spectrum, depth, depth)


def _without_mean(values: Values) -> Values:
    rest = values.copy()
    rest[0] = 0.0
    return rest


CONTROLS: dict[str, Callable[[FloatArray, Trajectory], Loading]] = {
    "depth": DepthControl,
    "load": LoadControl,
}
