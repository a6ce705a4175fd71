"""What is prescribed in an indentation."""

from __future__ import annotations

from typing import NamedTuple

from gfmdlayer.arrays import FloatArray


class History(NamedTuple):
    """What is prescribed over time, linear between the times; before the first the body is at rest.

    Attributes
    ----------
    time, value : ndarray, shape (nt,)
        Ascending times, and depths or forces.
    by_force : bool
        Whether the force is prescribed.
    """

    time: FloatArray
    value: FloatArray
    by_force: bool = False
