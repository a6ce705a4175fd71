"""The waves at which a body answers: a field of the surface is a sum of exp(i (qx x + qy y))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Wavevectors:
    """Wavevectors, and their magnitudes, in three arrays of one shape.

    NumPy takes this object for the array of its magnitudes. So a body whose stiffness does not depend on the
    direction starts with ``q = np.asarray(waves, dtype=float)``, and one whose stiffness does with
    ``waves = Wavevectors.of(waves)``; both then also take plain magnitudes.

    Parameters
    ----------
    qx, qy : ndarray
        Components: 1/length.
    magnitude : ndarray
        q = (qx^2 + qy^2)^(1/2).

    Examples
    --------
    >>> waves = gfmdlayer.Wavevectors.of_components([3.0, 0.0], [4.0, 2.0])
    >>> waves.magnitude, gfmdlayer.Wavevectors.of([1.0, 2.0]).qx
    (array([5., 2.]), array([1., 2.]))
    """

    qx: FloatArray
    qy: FloatArray
    magnitude: FloatArray

    @classmethod
    def of(cls, waves: Wavevectors | ArrayLike) -> Wavevectors:
        """Return the waves; plain magnitudes mean waves along x.

        Parameters
        ----------
        waves : Wavevectors or array_like
            Waves, or magnitudes q >= 0 of any shape: 1/length.
        """
        if isinstance(waves, Wavevectors):
            return waves
        q = np.asarray(waves, dtype=float)
        return cls(q, np.zeros(q.shape), q)

    @classmethod
    def of_components(cls, qx: ArrayLike, qy: ArrayLike = 0.0) -> Wavevectors:
        """Return the waves of components that broadcast together.

        Parameters
        ----------
        qx, qy : array_like
            Components along x and y: 1/length; qy is 0 by default.
        """
        x, y = np.asarray(qx, dtype=float), np.asarray(qy, dtype=float)
        magnitude = np.sqrt(np.square(x) + np.square(y))
        return cls(np.broadcast_to(x, magnitude.shape), np.broadcast_to(y, magnitude.shape), magnitude)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of each of the three arrays."""
        return self.magnitude.shape

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the magnitudes; of waves that cases share, a copy that may be changed."""
        copied = copy or (copy is None and not self.magnitude.flags.writeable)
        return (np.array if copied else np.asarray)(self.magnitude, dtype=dtype)
