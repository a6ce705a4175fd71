"""Interface laws: the interaction of surface and punch across the gap g, beside the hard wall.

An interface law gives an energy w(g) per area; tau(g) = dw/dg is the traction that pulls surface and punch
together where it is positive. No law lets the surface pass through the punch: g >= 0 holds for each, and the
pressure of the wall, p_c >= 0 with p_c g = 0, is the compressive stress of the surface plus tau.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from gfmdlayer.arrays import FloatArray


class InterfaceLaw(Protocol):
    """Energy and traction of an interface, functions of the gap alone; arrays keep their shape."""

    @property
    def attracts(self) -> bool:
        """Whether there is a traction at all."""
        ...

    @property
    def range(self) -> float:
        """Gap over which the traction changes, a length; infinite for the hard wall."""
        ...

    def energy(self, gap: FloatArray) -> FloatArray:
        """Energy w(g) per area, which falls as the gap closes."""
        ...

    def traction(self, gap: FloatArray) -> FloatArray:
        """Traction dw/dg, positive where it attracts."""
        ...

    def curvature(self, gap: FloatArray) -> FloatArray:
        """Curvature d^2w/dg^2, a stiffness per area."""
        ...


class HardWall:
    """No interaction but that the surface cannot pass through the punch (the paper's contact)."""

    attracts = False
    range = float("inf")

    def energy(self, gap: FloatArray) -> FloatArray:
        """Zero."""
        return np.zeros_like(gap)

    def traction(self, gap: FloatArray) -> FloatArray:
        """Zero."""
        return np.zeros_like(gap)

    def curvature(self, gap: FloatArray) -> FloatArray:
        """Zero."""
        return np.zeros_like(gap)


HARD_WALL = HardWall()
