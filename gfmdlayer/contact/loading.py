"""Depth, gap and load control: the contact problem of a step, the depth of its solution, and the imprint.

A solver finds a surface of zero mean, or under a given mean pressure p any surface w below the punch. The
mean of w is the depth plus u_0, the displacement at q = 0, which is zero unless a compressible layer lies on
a rigid base. There kappa_0 u_0 = b_0/n - p, and

    u = w - mean(w) + u_0,        depth = mean(w) - u_0.

A mean gap prescribes the mean of w: with w of zero mean the punch is at the depth mean(h) less the gap, and
u_0 follows from the pressure that is found.

A load that pulls more than the interface holds has no equilibrium, and the punch detaches (`is_pulled_off`).
Until the load presses again it lies out of reach. The surface is free of stress, and the depth of the punch
counts as the depth at which it would just touch.

Hardness: contact pressures end at H, and the surfaces lose height there.

Perfect plasticity in series with the body, along the normal, without hardening. The pressure of the wall
satisfies 0 <= p <= H, and the imprint W >= 0 is the height lost so far at each point. A step finds

    min over p of p.A p/2 + (gap0 + W).p        0 <= p <= H, of the given load where there is one

with gap0 the gap without pressure, and A the compliance. With g = gap0 + W + A p,

    p = 0: g >= 0,        0 < p < H: g = 0,        p = H: g <= 0, and then W grows by -g.

-g is the multiplier of p <= H. The dual problem is the least sum of elastic energy and H (W' - W) over
displacements u <= h + W' and W' >= W: an implicit step of flow, of which H times the growth of W is the work.
With attraction the pressure of the wall, p + tau(g), ends at H; the flow leaves no gap, and its work is that
of the stress H - tau(0).
So W does not depend on the number of steps as long as no point leaves the hardness.

W belongs to punch and body together: it adds to the height of the punch, and is no displacement of the body.
So it leaves no stress in the body's memory.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TypeVar

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.interface.law import HARD_WALL, Interaction
from gfmdlayer.resumable import Saving
from gfmdlayer.step import Ended
from gfmdlayer.time_functions import TimeFunction

Values = TypeVar("Values", FloatArray, ComplexArray)


@dataclass(frozen=True)
class Surface:
    """Displacement of the surface and depth of the punch."""

    found: FloatArray  # one value a point, displacement as the solver found it; length
    spectrum: ComplexArray  # its unnormalised transform
    depth: float  # of the punch, below the height at which it touches the surface at rest; length
    response: float  # the quantity that is not prescribed: the mean pressure, or the depth
    shift: float = 0.0  # height at which the solver found the displacement

    @property
    def displacement(self) -> FloatArray:
        """u, one value a point: a new array where the solver found it at another height."""
        return self.found - self.shift if self.shift else self.found


@dataclass
class DetachedInterval:
    """Times between which the punch is out of reach."""

    begin: float = math.inf
    end: float = math.inf

    def covers(self, time: float) -> bool:
        """Whether the punch is away at a time."""
        return self.begin <= time < self.end


@dataclass(frozen=True)
class Loading(Saving):
    """The punch, and the quantity that is prescribed over time."""

    KEPT = ("detached.begin", "detached.end")

    punch: FloatArray  # height above its lowest point, one value a point
    trajectory: TimeFunction
    interface: Interaction = HARD_WALL
    ranks: Ranks = ALONE

    by_depth: bool = True  # else the mean pressure is prescribed, and with it the force over the cell
    by_gap: bool = False  # whether the depth is that of a surface of zero mean, whatever its mean is

    def problem(
        self, kappa: FloatArray, b: ComplexArray, time: float, loss_stiffness: FloatArray | None = None
    ) -> Problem:
        """Return the contact problem at the end of a step; that of a load has no mean."""
        if self.by_depth:
            obstacle, load = self.punch - self.prescribed(time), None
        else:
            obstacle, load = self.obstacle, self.prescribed(time)
        if self.by_gap or not self.by_depth:
            kappa, b = self._without_mean(kappa), self._without_mean(b)
        law = self.law(time)
        return Problem(kappa, b, obstacle, load, loss_stiffness, self.height, law, self.ranks)

    def prescribed(self, time: float) -> float:
        """Depth, or mean pressure: none while the punch is out of reach."""
        return 0.0 if self.detached.covers(time) else self.trajectory(time)

    def law(self, time: float) -> Interaction:
        """Interaction across the gap: none while the punch is out of reach."""
        return HARD_WALL if self.detached.covers(time) else self.interface.at(time)

    @cached_property
    def obstacle(self) -> FloatArray:
        """Height above the lowest point of the grid, beside which first depths are not lost to rounding."""
        return self.punch - self.lowest  # a new array: kernels are compiled anew for read-only ones

    def surface(self, solution: Solution, kappa: FloatArray, b: ComplexArray, time: float) -> Surface:
        """Return the surface as the solver found it, or with the mean that the load gives it."""
        if self.by_depth and not self.by_gap:
            depth, response = self.trajectory(time), solution.mean_pressure
            return Surface(solution.displacement, solution.spectrum, depth, response)
        ranks, height = self.ranks, 0.0
        stiffness, history = float(ranks.mean_wave(kappa)), complex(ranks.mean_wave(b))
        if stiffness > 0:
            pressure = solution.mean_pressure if self.by_gap else self.prescribed(time)
            height = (history.real / self.size - pressure) / stiffness
        shift = ranks.mean(solution.displacement) - height
        depth = shift + (self.trajectory(time) if self.by_gap else self.lowest)
        spectrum = solution.spectrum.copy()
        ranks.set_mean_wave(spectrum, height * self.size)
        response = solution.mean_pressure if self.by_gap else depth
        return Surface(solution.displacement, spectrum, depth, response, shift)

    def _without_mean(self, values: Values) -> Values:
        rest = values.copy()
        self.ranks.set_mean_wave(rest, 0.0)
        return rest

    @cached_property
    def height(self) -> float:
        """Range of the punch's heights."""
        return self.ranks.maximum(float(self.punch.max())) - self.lowest

    @cached_property
    def lowest(self) -> float:
        """Height of the lowest point of the grid, which need not be the lowest point of the punch."""
        return self.ranks.minimum(float(self.punch.min()))

    @cached_property
    def detached(self) -> DetachedInterval:
        """Times between which a load has pulled the punch off."""
        return DetachedInterval()

    @contextmanager
    def detached_from(self, time: float, end: float) -> Iterator[None]:
        """Detach the punch at a time, in which a load pulls it off; touch again if the block fails.

        Ended where it does not come back before the end.
        """
        corners = [time, *(point for point in self.trajectory.breakpoints if time < point < end), end]
        for before, after in pairwise(corners):
            if self.trajectory(after) > 0:
                load = self.trajectory(before), self.trajectory(after)
                back = before + (after - before) * load[0] / (load[0] - load[1])
                self.detached.begin, self.detached.end = time, back
                try:
                    yield
                except Exception:
                    self.detached.begin = self.detached.end = math.inf
                    raise
                return
        raise self.pulled_off(time)

    def pulled_off(self, time: float) -> Ended:
        """Return the reason to end a run whose load has pulled the punch off for good."""
        reason = f"PULLED OFF at t = {time:.6g}: no contact carries the load of {self.trajectory(time):.6g}"
        return Ended(reason, pull_off_time=time)

    @cached_property
    def size(self) -> int:
        """Number of points of the grid."""
        return self.ranks.total(self.punch.size)


def is_pulled_off(load: float | None, gap: FloatArray, interface: Interaction, ranks: Ranks = ALONE) -> bool:
    """Whether the given load pulls the punch away: it is out of range, where no traction is as large."""
    # Further away the traction is less still, so that there is no equilibrium left to find. The state is the
    # last one of the solver, which need not have converged.
    if load is None or load >= 0 or not interface.attracts:
        return False
    nearest, strongest = ranks.minimum(gap.min()), interface.traction(gap).max()
    return bool(nearest > interface.range and ranks.maximum(strongest) < -load)


class Imprint(Saving):
    """The height W that punch and surface have lost, one value a point; accepted steps change it."""

    KEPT = ("depth",)

    def __init__(self, size: int, hardness: float) -> None:
        # With an infinite hardness nothing yields, and it has no points.
        self.hardness, self.yields = hardness, hardness < math.inf
        self.depth = np.zeros(size if self.yields else 0)

    def under(self, problem: Problem) -> Problem:
        """Return the problem of a step with the height lost so far, and with pressures up to the hardness."""
        if not self.yields:
            return problem
        return replace(problem, obstacle=self.on(problem.obstacle), hardness=self.hardness)

    def on(self, heights: FloatArray) -> FloatArray:
        """Return heights of the punch with the height lost so far."""
        return heights + self.depth if self.yields else heights

    def without(self, gap: FloatArray) -> FloatArray:
        """Return a gap less the height lost so far: that of the elastic displacement."""
        return gap - self.depth if self.yields else gap

    def remember(self, flow: FloatArray | None) -> None:
        """Add the flow of an accepted step."""
        if flow is not None:
            self.depth = self.depth + flow
