"""One isolated indentation: its columns, profiles and warnings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.indentation.profiles import Profiles, profiles
from gfmdlayer.indentation.solve import (
    Indentation,
    follow,
    in_growing_space,
    on_halved_steps,
    on_steps,
    work_done,
)
from gfmdlayer.indentation.space import History, Space, find_space
from gfmdlayer.punch.revolution import Revolution

if TYPE_CHECKING:
    pass

DEFAULT_TOLERANCE = 1e-4

# Profiles reach to this many times the largest radius of the nodes.
_EXTENT = 2.0

# Negative pressure or gap, relative to the largest pressure or the depth, that is more than rounding.
_NEGATIVE = 1e-6
_CHECKED = 400  # radii at which it is looked for


@dataclass(frozen=True)
class IsolatedIndentation:
    """A rigid indenter of revolution that is pressed into a body.

    Parameters
    ----------
    body : Body
        The body.
    profile : Revolution
        The indenter.
    history : History
        What is prescribed.
    tolerance : float
        Error of force, depth and contact radius, relative to the largest of each.
    step : float, optional
        Largest length of equal steps; without it the steps are chosen for the tolerance.
    adhesion : float
        Work of adhesion, of an elastic body.
    snapshots, stops : sequence of float
        Times to land on; profiles are kept at the snapshots.
    points : int
        Radial points of the profiles.
    extent : float, optional
        Radius up to which they reach; by default twice the largest contact radius, about.
    """

    body: Body
    profile: Revolution
    history: History
    tolerance: float = DEFAULT_TOLERANCE
    step: float | None = None
    adhesion: float = 0.0
    snapshots: Sequence[float] = ()
    stops: Sequence[float] = ()
    points: int = 256
    extent: float | None = None

    @cached_property
    def _space(self) -> Space:
        return find_space(self.body, self.profile, self.history, self.tolerance, self.adhesion)

    @cached_property
    def radii(self) -> FloatArray:
        """Distances from the axis of the profiles, shape (points,)."""
        extent = _EXTENT * self._space.nodes.reach if self.extent is None else self.extent
        return np.linspace(0.0, extent, self.points)

    @cached_property
    def solved(self) -> Indentation:
        """Force, depth, contact radius and energies over time.

        Raises
        ------
        ArithmeticError
            If a contact radius is not found, or the tolerance is not reached.
        """
        if self.step is not None:
            return self._on_equal_steps(self.step)
        found = follow(
            self.body,
            self.profile,
            self.history,
            tolerance=self.tolerance,
            adhesion=self.adhesion,
            stops=self.stops,
            snapshots=self.snapshots,
            space=self._space,
        )
        if not found.error <= self.tolerance:
            raise ArithmeticError(f"estimated error {found.error:.2e}; the tolerance is {self.tolerance:.2e}")
        return found

    def _on_equal_steps(self, step: float) -> Indentation:
        """Take equal steps of at most this length between breakpoints and snapshots, and their halves."""
        knots = np.unique(np.array([*self.history.time, *self.snapshots, *self.stops]))
        parts = [
            np.linspace(begin, end, max(1, math.ceil((end - begin) / step - 1e-6)) + 1)[:-1]
            for begin, end in pairwise(knots.tolist())
        ]
        time = np.append(np.concatenate(parts), knots[-1])
        kept = np.unique(np.array(self.snapshots, dtype=float))
        return in_growing_space(
            lambda space: on_halved_steps(self.body, space, self.profile, self.history, time, kept),
            self._space,
            self.profile,
            self.tolerance,
        )

    def columns(self) -> dict[str, FloatArray]:
        """Return the columns, each of shape (nt,)."""
        found = self.solved
        work = work_done(found.force, found.depth, float(found.stored[0] + found.dissipated[0]))
        interface = -self.adhesion * math.pi * found.radius**2
        return {
            "time": found.time,
            "force": found.force,
            "depth": found.depth,
            "contact_radius": found.radius,
            "work": work,
            "stored": found.stored,
            "dissipated": found.dissipated,
            "energy_residual": work - found.stored - found.dissipated - interface,
        }

    def profiles(self) -> Profiles:
        """Return the profiles at the snapshots."""
        times = np.unique(np.array(self.snapshots, dtype=float))
        return profiles(self.solved, self.profile, times, self.radii)

    @cached_property
    def warnings(self) -> list[str]:
        """Lines on pressures or gaps below zero, where the contact is not one disc.

        A transform of the pressure that falls from the axis to the edge, and one of the gap that is not
        negative, are enough; where they are not so, the profiles are looked at.
        """
        found = self.solved
        assert found.space is not None
        suspicious = found.rise.max() * found.radius.max() > _NEGATIVE * np.abs(found.force).max()
        if self.adhesion or not suspicious:
            return []
        time = found.time[[int(found.rise.argmax())]]
        again = on_steps(self.body, found.space, self.profile, self.history, found.time, snapshots=time)
        near = profiles(again, self.profile, time, np.linspace(0.0, 2 * found.radius.max(), _CHECKED))
        scales = {"pressure": float(near.pressure.max()), "gap": float(np.abs(found.depth).max())}
        return [
            f"{name} below zero at t = {time[0]:.6g}, by {-least / scale:.1e} of the largest: the contact is "
            "not one disc there"
            for name, scale in scales.items()
            if (least := float(getattr(near, name).min())) < -_NEGATIVE * scale
        ]
