"""Heights of a punch given in Python, as an array or a function of the coordinates.

They are counted outward from the punch, as those of a measured surface: the largest touches first, and a
round punch is -x^2/(2 R). Only their differences count.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.arrays import FloatArray
from gfmdlayer.files.tables import TableError
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.height_files import fitting
from gfmdlayer.validation.problems import ConfigError


def outward_heights(punch: ArrayLike | Callable[..., ArrayLike], grid: Grid) -> FloatArray:
    """Return the heights at the points of a grid, outward from the punch.

    Parameters
    ----------
    punch : array_like, or callable
        Heights, of the grid's shape; or a function of x, or of x and y, which takes and returns arrays of the
        grid's shape.
    grid : Grid
        The grid; x_j = j L/n - L/2.

    Returns
    -------
    ndarray
        Of the grid's shape.

    Raises
    ------
    ConfigError
        If they are not finite numbers of the grid's shape.
    """
    if callable(punch):
        heights = numbers(punch(*np.meshgrid(*grid.coordinates, indexing="ij")))
        heights = np.broadcast_to(heights, grid.shape) if heights.ndim == 0 else heights  # flat
    else:
        heights = numbers(punch)
    try:
        return fitting("punch", heights, grid.shape)
    except TableError as error:
        raise ConfigError([str(error)]) from None


def numbers(heights: ArrayLike) -> FloatArray:
    """Return heights as an array of numbers.

    Raises
    ------
    ConfigError
        If they are not real numbers.
    """
    try:
        found = np.asarray(heights)
    except ValueError as error:  # rows of different lengths
        raise ConfigError([f"punch: {error}; must be an array of real numbers"]) from None
    if found.dtype.kind not in "fiu":
        raise ConfigError([f"punch: got an array of type {found.dtype}; must be real numbers"])
    return found.astype(np.float64)
