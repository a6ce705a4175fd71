"""Names for the arrays that the package works on, and for the attributes of its results; arrays of users."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

Attribute = str | float | FloatArray


def unmasked(values: npt.ArrayLike) -> npt.NDArray[Any]:
    """Return numbers as an array, in which masked ones are NaN: NumPy would take what is below the mask."""
    if not np.ma.isMaskedArray(values) or np.ma.asarray(values).dtype.kind not in "fiub":
        return np.asarray(values)
    return np.asarray(np.ma.filled(np.ma.asarray(values, dtype=np.float64), np.nan))
