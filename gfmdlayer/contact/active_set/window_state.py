"""What a window around the contact works on; see `windows`."""

from __future__ import annotations

from typing import NamedTuple

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.active_set.state import ContactSet, Work
from gfmdlayer.contact.pressure_form import Iterate, System
from gfmdlayer.grid.transforms import Plans
from gfmdlayer.kernels import kernel

Pair = tuple[int, int]


class Window(NamedTuple):
    """A window and the problem in it.

    Axes are two, the first of one point where the surface is a line. The window is the first points of its
    transforms, along each axis.
    """

    plans: Plans
    system: System
    at: Iterate
    contact: ContactSet
    work: Work
    length: Pair  # of the transforms
    width: Pair  # of the window
    surface: Pair  # points of the surface


class Surface(NamedTuple):
    """The surface that the window is part of, and its work arrays."""

    plans: Plans
    compliance: FloatArray  # as in `System`
    h: FloatArray
    b: ComplexArray  # as in `Problem`
    spectrum: ComplexArray  # work array
    z: FloatArray  # work array


@kernel(inner=True)
def stretch(window: Window, origin: Pair, first: int, count: int, part: int) -> tuple[int, int, int]:
    """Locate a stretch of a line of the window on the surface, which is periodic.

    Parameters
    ----------
    window : Window
        The window.
    origin : tuple of int
        Line and point of the surface where the window begins.
    first, count : int
        First point of the stretch in the window, and its number of points.
    part : int
        0 for the points before the end of the surface's line, 1 for those after it.

    Returns
    -------
    First point of that part in the window, first on the surface, and their number.
    """
    (rows, line), length = window.surface, window.length[1]
    start = (origin[0] + first // length) % rows * line
    column = origin[1] + first % length
    before = min(max(line - column, 0), count)
    if part == 0:
        return first, start + column, before
    return first + before, start + column + before - line, count - before
