"""An interface law as a section of the configuration and as a Python object at once.

Configurations are read without numpy, which is imported inside of methods.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar

from gfmdlayer.validation.sections import Kind
from gfmdlayer.validation.units import Units

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.interface.law import Interaction


class Interface(Kind):
    """A law of the interaction of surface and punch across the gap."""

    attracts: ClassVar[bool] = True
    points_in_zone: ClassVar[int] = 3  # of a cohesive zone, with which edges of the contact are resolved

    law: str
    """word that chooses the law"""

    @abstractmethod
    def interaction(self, units: Units | None = None) -> Interaction:
        """Return the law as solvers take it; ConfigError without its units, TableError by its file."""

    def energy(self, gap: ArrayLike) -> FloatArray:
        """Energy w(g) per area, in the shape of the gap g >= 0; zero far away."""
        return self.interaction().energy(_numbers(gap))

    def traction(self, gap: ArrayLike) -> FloatArray:
        """Traction tau = dw/dg, positive where it attracts, in the shape of the gap."""
        return self.interaction().traction(_numbers(gap))

    def curvature(self, gap: ArrayLike) -> FloatArray:
        """Curvature d^2w/dg^2, in the shape of the gap."""
        return self.interaction().curvature(_numbers(gap))


def _numbers(gap: ArrayLike) -> Any:
    import numpy as np

    return np.asarray(gap, dtype=np.float64)
