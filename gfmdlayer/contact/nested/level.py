"""One grid: its problem in pressures, its state, and the operators of the iteration on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.nested import passes
from gfmdlayer.contact.nested.passes import Sweep
from gfmdlayer.contact.nested.stencil import REACH, stencil
from gfmdlayer.contact.problem import Problem
from gfmdlayer.contact.residual import ResidualFloor, scales
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms


class Extent(NamedTuple):
    """How far the fields of a state reach."""

    mean: float  # of u
    pressure: float  # the largest
    depth: float  # the largest -u
    overlap: float  # the largest -gap
    gap: float  # the largest


@dataclass
class Fields:
    """A problem and its state, one value a point.

    Attributes
    ----------
    h, gap0 : ndarray
        Surface of the punch, and gap without pressure, which is not needed where the load is given.
    p, gap : ndarray
        Pressure, and the gap that belongs to it, up to a rigid shift where the load is given.
    load : float or None
        Sum of the pressure, where it is given.
    aim : float
        Gap that is aimed at in contact, as part of the scale of depth, where the load is not given.
    scales : tuple of float
        Of pressure and depth in the residual.
    level : float
        Gap in contact, weighted by the pressure, or that which is aimed at.
    """

    h: FloatArray
    gap0: FloatArray
    p: FloatArray
    gap: FloatArray
    load: float | None
    aim: float = 0.0
    scales: tuple[float, float] = (1.0, 1.0)
    level: float = 0.0


class Level:
    """Operators and work arrays of one grid.

    Parameters
    ----------
    grid : Grid
        The points.
    transforms : Transforms
        In single precision.
    stiffness : ndarray, one value a mode
        kappa.
    floor : ResidualFloor
        Bounds of the residual's scales.
    """

    def __init__(
        self, grid: Grid, transforms: Transforms, stiffness: FloatArray, floor: ResidualFloor
    ) -> None:
        self.grid, self.transforms, self.floor = grid, transforms, floor
        self.sweep = Sweep(grid, transforms.threads)
        self._modes = Sweep(grid, transforms.threads, grid.spectral_shape)
        self.r, self.z, self.d, self.step, self.change = (transforms.empty_field() for _ in range(5))
        self._spectrum = transforms.empty_spectrum()
        self._compliance = np.empty(stiffness.size, dtype=np.float32)
        self.set_stiffness(stiffness)
        self.pairs = 0  # spent, in single precision

    def set_stiffness(self, stiffness: FloatArray) -> None:
        """Make compliance and preconditioner from kappa."""
        stiff = stiffness > 0
        self._compliance[:] = np.where(stiff, 1.0 / (self.grid.size * np.where(stiff, stiffness, 1.0)), 0.0)
        self.stiffest = self.grid.sums.maximum(float(stiffness.max()))
        self._weights = stencil(self.grid, stiffness)

    def respond(self) -> None:
        """Write the change of the gap under the step, A step: one pair of transforms."""
        self.transforms.transform(self.step, self._spectrum)
        self._modes.only(passes.comply, self._compliance, self._spectrum)
        self.transforms.transform_back(self._spectrum, self.change)
        self.pairs += 1

    def displace(self, problem: Problem, spectrum: ComplexArray, work: ComplexArray) -> None:
        """Write the transform of the displacement in the place of that of the pressure, and in ``work``."""
        numbers = (each.view(np.float64) for each in (problem.intercept, spectrum, work))
        self._modes.only(passes.displace, problem.stiffness, *numbers)

    def precondition(self) -> Sequence[float]:
        """Write z = M r in the place of the last r; see `passes.precondition` for the sums."""
        r = self.r.reshape(-1, self.grid.shape[-1])
        beside = self.grid.halo(r, REACH, REACH)
        return self.sweep(passes.precondition, self._weights, r, *beside, self.z, self.d)[0]

    def set_scales(self, at: Fields, per_point: float = 0.0) -> Extent:
        """Set the level of a state and the scales of its residual.

        Parameters
        ----------
        at : Fields
            The state.
        per_point : float
            Where not zero, u stands in the place of the gap, but for this factor.
        """
        arrays = at.h, at.p, at.gap
        (load, weighted, total), extrema = self.sweep(passes.extent, per_point, *arrays)
        extent = Extent(total / self.grid.size, *extrema)
        if at.load is not None:
            at.level = weighted / load if load > 0 else 0.0
        at.scales = self.scales(extent, at.level)
        at.level = at.aim * at.scales[1] if at.load is None else at.level
        return extent

    def scales(self, extent: Extent, level: float) -> tuple[float, float]:
        """Scales of pressure and depth, where the gap counts from a level."""
        depth = max(extent.mean + level, 0.0) + extent.depth - level
        return scales.py_func(extent.pressure, depth, self.floor)

    def set_load(self, at: Fields) -> bool:
        """Scale the pressure to the given load; return whether there is any pressure."""
        total = self.grid.sums.total(float(at.p.sum()))
        if not 0.0 < total < np.inf:
            return False
        if at.load is not None and total != at.load:
            self.sweep.only(passes.times, at.load / total, at.p)
        return True

    def add_response(self, at: Fields) -> None:
        """Write the gap of the pressure, from the gap without it, in single precision."""
        np.copyto(self.step, at.p, casting="same_kind")
        self.respond()
        self.sweep.only(passes.add_response, at.gap0, self.change, at.gap)
