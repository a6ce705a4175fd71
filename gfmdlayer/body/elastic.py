"""An elastic solid."""

from __future__ import annotations

from typing import Literal

from gfmdlayer.body.materials import Material
from gfmdlayer.validation.fields import Positive


class Elastic(Material):
    """An elastic solid of modulus G.

    Examples
    --------
    >>> gfmdlayer.Elastic(3.0).relaxation_modulus([0.0, 1.0])
    array([3., 3.])
    """

    model: Literal["elastic"] = "elastic"
    """G(t) = G at all times"""
    G: Positive = 1.0
    """shear modulus"""

    __init__ = Material.__init__

    @property
    def relaxed(self) -> float:
        """Modulus G."""
        return self.G

    @property
    def maxwell_branches(self) -> tuple[tuple[float, float], ...]:
        """No branch."""
        return ()
