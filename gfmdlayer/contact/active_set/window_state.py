"""What a window around the contact works on; see `windows`."""

from __future__ import annotations

from typing import NamedTuple

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.active_set.state import Bank, ContactSet, Work
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
    bank: Bank
    work: Work
    length: Pair  # of the transforms
    width: Pair  # of the window
    whole: Pair  # points of the surface


class Whole(NamedTuple):
    """The surface that the window is part of."""

    plans: Plans
    compliance: FloatArray  # as in `System`
    h: FloatArray
    b: ComplexArray  # as in `Problem`
    spectrum: ComplexArray  # work array
    z: FloatArray  # work array


class Found(NamedTuple):
    """The state of the whole surface that a window's pressure leads to, to be written to."""

    u: FloatArray
    p: FloatArray
    gap: FloatArray
    spectrum: ComplexArray  # of u, unnormalised


@kernel
def stretch(window: Window, origin: Pair, first: int, count: int, part: int) -> tuple[int, int, int]:
    """Where a stretch of a line of the window is on the surface, whose lines go on at their beginning.

    Returns, of its points before (part 0) or after the end of the surface's line, the first in the window,
    the first on the surface, and their number.
    """
    (rows, line), length = window.whole, window.length[1]
    start = (origin[0] + first // length) % rows * line
    column = origin[1] + first % length
    before = min(max(line - column, 0), count)
    if part == 0:
        return first, start + column, before
    return first + before, start + column + before - line, count - before
