"""A punch of waves."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from gfmdlayer.punch.shape import Analytic, Axes, Extent, along_axis
from gfmdlayer.validation.fields import Amplitudes, Lengths
from gfmdlayer.validation.problems import Problem

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray


class Sinusoid(Analytic):
    """Height amplitude (1 - cos(2 pi x/wavelength)), summed over the directions.

    A whole number of waves fills the period.

    Examples
    --------
    >>> punch = gfmdlayer.Sinusoid(amplitude=0.01, wavelength=0.5)
    >>> gfmdlayer.run({"time": {"end": 1.0, "step": 0.5}, "grid": {"points": 64}}, punch=punch).sizes["time"]
    3
    """

    shape: Literal["sinusoid"] = "sinusoid"
    """height amplitude (1 - cos(2 pi x/wavelength))"""
    amplitude: Amplitudes
    """amplitude: length, or one for each direction"""
    wavelength: Lengths
    """wavelength: length, or one for each direction; a whole number fill the period"""

    def height(self, axes: Axes) -> FloatArray:
        """Amplitude times (1 - cos(2 pi x/wavelength)), summed over the axes."""
        import numpy as np

        waves = (
            (x, along_axis(self.amplitude, i), along_axis(self.wavelength, i)) for i, x in enumerate(axes)
        )
        return np.asarray(sum(a * (1 - np.cos(2 * np.pi * x / length)) for x, a, length in waves))

    def misfit(self, extent: Extent) -> Problem | None:
        """Refuse waves that do not join up with themselves."""
        wavelength = along_axis(self.wavelength, extent.axis)
        waves = extent.length / wavelength
        fits = waves >= 1 - 1e-9 and abs(waves - round(waves)) <= 1e-9 * waves
        if fits or math.isinf(wavelength) or along_axis(self.amplitude, extent.axis) == 0:
            return None
        message = (
            f"got {wavelength!r}, which does not divide {extent.words}; must be the period divided by a "
            "whole number"
        )
        return Problem(("wavelength",), message, ("amplitude",))
