"""One isolated indentation: its columns, profiles and warnings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.indentation.compliance import gauss_rule
from gfmdlayer.indentation.march import Marched
from gfmdlayer.indentation.solve import (
    NO_ADHESION,
    Edge,
    History,
    Indentation,
    Space,
    find_space,
    follow,
    in_growing_space,
    jumps,
    on_quartered_steps,
    on_steps,
    work_done,
)
from gfmdlayer.punch.revolution import Revolution, abel_transform, heights

# Radial profiles of pressure, displacement and gap from the fields of a run.
#
#     p(r) = (2/pi) [chi(a)/(a^2 - r^2)^(1/2) - int_r^a chi'(x) dx/(x^2 - r^2)^(1/2)],       r < a
#     gap(r) = (2/pi) int_a^r [v(x) - depth + H(x)] dx/(r^2 - x^2)^(1/2),                     r > a
#
# with v = D*chi + (2/pi) int cos(qx) C*X dq, the Abel transform of the displacement of the surface. A
# contact with a sharp rim, or with adhesion, has an infinite pressure at its edge.

_NODES = 48  # of Gauss's rule in each integral
_CENTRE = 1e-6  # part of the reach in place of r = 0, where the pressure under a cone is infinite
_EDGE = 1e-9  # chi(a), relative to its maximum, from which it is not zero


class Profiles(NamedTuple):
    """Radial profiles at the snapshots: fields of shape (times, points)."""

    time: FloatArray  # (times,)
    r: FloatArray  # (points,), distances from the axis
    pressure: FloatArray  # positive where it compresses
    displacement: FloatArray  # positive upward
    gap: FloatArray  # infinite beyond the end of an indenter


def profiles(found: Indentation, profile: Revolution, times: FloatArray, r: FloatArray) -> Profiles:
    """Return the profiles of an indentation at ascending times, at which it kept its fields."""
    assert found.fields is not None
    assert found.space is not None
    pressure, displacement, gap = np.zeros((3, times.size, r.size))
    for k, at in enumerate(np.searchsorted(found.time, times)):
        surface = _Surface(found.fields, int(at), k, found.space, profile)
        pressure[k] = surface.pressure(r)
        displacement[k], gap[k] = surface.displacement_and_gap(r)
    return Profiles(times, r, pressure, displacement, gap)


class _Surface:
    """The surface at one time, with the radius and the depth of the fields; the columns are extrapolated."""

    def __init__(self, fields: Marched, at: int, snapshot: int, space: Space, profile: Revolution) -> None:
        nodes = space.nodes
        self._space, self._profile = space, profile
        self._a, self._depth = float(fields.radius[at]), float(fields.depth[at])
        self._x = nodes.spacing * np.arange(fields.chi.shape[1])
        self._chi = CubicSpline(self._x, fields.chi[snapshot])
        self._local = fields.local[snapshot]
        self._coupled = fields.spectrum[snapshot] * space.weights * (2 / math.pi)

    def pressure(self, r: FloatArray) -> FloatArray:
        """Pressure at these distances; zero outside the contact."""
        p = np.zeros(r.size)
        a = self._a
        inside = r < a
        if not inside.any():
            return p
        near = np.maximum(r[inside], _CENTRE * self._space.nodes.reach)
        # x = r cosh t makes the integrand smooth.
        t, w = _gauss(np.zeros(near.size), np.arccosh(np.maximum(a / near, 1.0)))
        p[inside] = -(self._chi(near[:, np.newaxis] * np.cosh(t), 1) * w).sum(axis=1)
        edge = float(self._chi(a))
        if abs(edge) > _EDGE * float(np.abs(self._chi(self._x[self._x < a])).max()):
            p[inside] += edge / np.sqrt((a - near) * (a + near))
        return p * (2 / math.pi)

    def displacement_and_gap(self, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Upward displacement and gap at these distances; the gap is infinite beyond the indenter's end."""
        h, a = heights(self._profile, r), self._a
        r = np.maximum(r, _CENTRE * self._space.nodes.reach)
        gap, outside = np.zeros(r.size), r > a
        under = outside & np.isfinite(h)
        t, w = _gauss(np.arcsin(a / r[under]), np.full(int(under.sum()), math.pi / 2))
        x = r[under][:, np.newaxis] * np.sin(t)
        gap[under] = ((self._sunk(x) - self._depth + self._H(x)) * w).sum(axis=1) * (2 / math.pi)
        displacement = np.where(np.isfinite(h), h, 0.0) - self._depth - gap
        beyond = outside & ~under
        if beyond.any():
            t, w = _gauss(np.arcsin(a / r[beyond]), np.full(int(beyond.sum()), math.pi / 2))
            sunk = (self._sunk(r[beyond][:, np.newaxis] * np.sin(t)) * w).sum(axis=1)
            t, w = _gauss(np.zeros(int(beyond.sum())), np.arcsin(a / r[beyond]))
            sunk += ((self._depth - self._H(r[beyond][:, np.newaxis] * np.sin(t))) * w).sum(axis=1)
            displacement[beyond], gap[beyond] = -sunk * (2 / math.pi), math.inf
        return displacement, gap

    def _H(self, x: FloatArray) -> FloatArray:
        """Abel transform of the profile."""
        found = [abel_transform(self._profile, each) for each in x.ravel().tolist()]
        return np.array(found).reshape(x.shape)

    def _sunk(self, x: FloatArray) -> FloatArray:
        """Abel transform of the downward displacement outside the contact."""
        local = np.interp(x, self._x, self._local, right=0.0)
        if not self._coupled.size:
            return np.asarray(local)
        return np.asarray(local + np.cos(x[..., np.newaxis] * self._space.q) @ self._coupled)


def _gauss(begin: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights between begin and end, each of shape (points, nodes)."""
    x, w = gauss_rule(_NODES)
    half = (end - begin)[:, np.newaxis] / 2
    return begin[:, np.newaxis] + half * (x + 1), half * w


DEFAULT_TOLERANCE = 1e-4

# Profiles reach to this many times the largest radius of the nodes.
_EXTENT = 2.0

# Negative pressure or gap, relative to the largest pressure or the depth, that is more than rounding.
_NEGATIVE = 1e-6
_CHECKED = 400  # radii at which it is looked for


@dataclass(frozen=True)
class IsolatedIndentation:
    """A rigid indenter of revolution that is pressed into a body."""

    body: Body
    profile: Revolution
    history: History  # prescribed depth or force
    tolerance: float = DEFAULT_TOLERANCE  # error of force, depth and radius, relative to their largest
    step: float | None = None  # largest length of equal steps; None: steps are chosen for the tolerance
    adhesion: Edge = NO_ADHESION
    snapshots: Sequence[float] = ()  # times to land on, at which profiles are kept
    stops: Sequence[float] = ()  # further times to land on
    points: int = 256  # radial points of the profiles
    extent: float | None = None  # radius up to which they reach; None: about twice the largest contact radius

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
        """Force, depth, radius and energies over time; ArithmeticError if the tolerance is not reached."""
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
            raise ArithmeticError(
                f"estimated error {found.error:.2e}; the tolerance is {self.tolerance:.2e}{self._jump(found)}"
            )
        return found

    def _jump(self, found: Indentation) -> str:
        """Say which jump of a contact with adhesion takes longer than the tolerance allows."""
        duration = float(found.time[-1] - found.time[0])
        steps = np.diff(found.time)
        coarse = jumps(found, self.tolerance * duration)
        if not (self.adhesion.work and coarse.size):
            return ""
        at = coarse[steps[coarse].argmax()]
        return (
            f". Contact jumps at t = {found.time[at]:.6g}, and the time is known to {steps[at]:.1e} only; "
            f"try a tolerance of {2 * steps[at] / duration:.1e}"
        )

    def _on_equal_steps(self, step: float) -> Indentation:
        """Take equal steps of at most this length between breakpoints and snapshots, and their halves."""
        knots = np.unique(np.array([*self.history.time, *self.snapshots, *self.stops]))
        parts = [
            np.linspace(begin, end, max(1, math.ceil((end - begin) / (2 * step) - 1e-6)) + 1)[:-1]
            for begin, end in pairwise(knots.tolist())
        ]
        time = np.append(np.concatenate(parts), knots[-1])
        kept = np.unique(np.array(self.snapshots, dtype=float))
        return in_growing_space(
            lambda space: on_quartered_steps(self.body, space, self.profile, self.history, time, kept)[0],
            self._space,
            self.profile,
            self.tolerance,
        )

    def columns(self) -> dict[str, FloatArray]:
        """Return the columns, each of shape (nt,)."""
        found = self.solved
        work = work_done(found.force, found.depth, float(found.stored[0] + found.dissipated[0]))
        if self.adhesion.work:
            work -= self._work_torn_off(work)
        return {
            "time": found.time,
            "force": found.force,
            "depth": found.depth,
            "contact_radius": found.radius,
            "work": work,
            "stored": found.stored,
            "dissipated": found.dissipated,
            "energy_residual": work - found.stored - found.dissipated - found.parted,
        }

    def _work_torn_off(self, work: FloatArray) -> FloatArray:
        """Work on the way from the contact to the surface, whose depth a torn off indenter has."""
        history, found = self.history, self.solved
        torn = history.by_force_at(found.time[1:]) & (found.radius[:-1] > 0) & (found.radius[1:] == 0)
        return np.concatenate(([0.0], np.cumsum(np.diff(work) * torn)))

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
        if self.adhesion.work or not suspicious:
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
