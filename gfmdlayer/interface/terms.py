"""The terms of an interface law, as compiled code takes them; `forms` evaluates them."""

from __future__ import annotations

from typing import NamedTuple

from gfmdlayer.arrays import FloatArray, IntArray

EXPONENTIAL, LENNARD_JONES, INVERSE_SQUARE, COHESIVE_ZONE = range(4)


class Terms(NamedTuple):
    """The terms of a law.

    Attributes
    ----------
    form : ndarray of int, one value a term
        `EXPONENTIAL`, `LENNARD_JONES`, `INVERSE_SQUARE` or `COHESIVE_ZONE`.
    stress, length, width : ndarray, one value a term
        Of the form; the width of a cohesive zone's ramp, else without meaning.
    """

    form: IntArray
    stress: FloatArray
    length: FloatArray
    width: FloatArray
