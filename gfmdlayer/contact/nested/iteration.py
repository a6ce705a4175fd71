"""The iteration on one grid: projected conjugate gradients at one pair of transforms an iteration.

The pressure p >= 0 minimises p.A p/2 + gap0.p, whose gradient is the gap, under a given sum or, at a given
depth, under none. C holds the points that press or overlap, and r = level - gap there, the level being the
mean of the gap weighted by the pressure, or the gap that is aimed at. An iteration

    z = M r on C                                  M: a stencil that approximates kappa
    d = z + beta d on C                           beta of Polak and Ribiere, at least 0
    D = Proj(p + alpha d) - p                     Proj: nearest pressure >= 0 on C of the given sum
    p += theta D,  gap += theta A D               theta: lowest energy on the way

needs a transform for A D alone: the projection comes before it, and all pressures between p and p + D are
admissible. alpha is the length that the last step should have had. At a given depth the whole pressure is
scaled too, to the lowest energy, which the stencil, blind to the mean of the pressure, would leave to many
iterations.

A step that ends pressures is taken as a whole if the lowest energy is near its end: else points would
only come close to leaving. A preconditioned step that was clipped need not descend: it is then tried without
the points that it lets go, and at last along r.

Pressures may end at a hardness H too, the cap. C then holds the points with 0 < p < H, those with p = 0 that
overlap and those with p = H whose gap is open; Proj finds pressures from 0 to H. The level is the mean over
0 < p < H, after the step, and the whole pressure is not scaled: points at the cap stay there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.nested import passes
from gfmdlayer.contact.nested.passes import Move, ParallelPasses
from gfmdlayer.contact.problem import Problem
from gfmdlayer.contact.residual import ResidualFloor, scales
from gfmdlayer.contact.stencil import REACH, stencil
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms

_SHORTEST, _LONGEST = 0.05, 2.0  # of the lengths that are tried
_LET_GO = 0.8  # beyond this part of a step that ends pressures it is taken as a whole
_LOAD = 1e-2  # relative error of the load that a projection may leave; the next one corrects it
_PROJECTIONS = 60  # rounds of Newton's method at most
_ROUNDING, _SUMMED = 1e-14, 800.0  # of a load; of a sum of pressures, in units of their rounding
_PATIENCE, _PROGRESS = 40, 0.7  # iterations in which the residual has to fall below this part


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

    `gap0` is not needed where the load is given; the gap is then known up to a rigid shift.
    """

    h: FloatArray  # surface of the punch
    gap0: FloatArray  # gap without pressure
    p: FloatArray
    gap: FloatArray
    load: float | None  # sum of the pressure, where it is given
    cap: float | None = None  # largest pressure, where there is one
    aim: float = 0.0  # gap that is aimed at in contact, as part of the scale of depth, where it is not
    scales: tuple[float, float] = (1.0, 1.0)  # of pressure and depth in the residual
    level: float = 0.0  # gap in contact, weighted by the pressure, or the gap that is aimed at


class Level:
    """Operators and work arrays of one grid; transforms are in single precision."""

    def __init__(
        self, grid: Grid, transforms: Transforms, stiffness: FloatArray, floor: ResidualFloor
    ) -> None:
        self.grid, self.transforms, self.floor = grid, transforms, floor
        self.parallel = ParallelPasses(grid, transforms.threads)
        self._modes = ParallelPasses(grid, transforms.threads, grid.spectral_shape)
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
        """Replace the transform of the pressure by the displacement's; write it in `work` too."""
        numbers = (each.view(np.float64) for each in (problem.intercept, spectrum, work))
        self._modes.only(passes.displace, problem.stiffness, *numbers)

    def precondition(self) -> Sequence[float]:
        """Write z = M r in the place of the last r; see `passes.precondition` for the sums."""
        r = self.r.reshape(-1, self.grid.shape[-1])
        beside = self.grid.halo(r, REACH, REACH)
        return self.parallel(passes.precondition, self._weights, r, *beside, self.z, self.d)[0]

    def set_scales(self, at: Fields, per_point: float = 0.0) -> Extent:
        """Set the level of a state and the scales of its residual."""
        # Where `per_point` is not zero, u times its inverse stands in the place of the gap.
        arrays = at.h, at.p, at.gap
        (load, weighted, total), extrema = self.parallel(passes.extent, per_point, at.cap, *arrays)
        extent = Extent(total / self.grid.size, *extrema)
        if at.load is not None:
            at.level = weighted / load if load > 0 else 0.0 if at.cap is None else self.middle(at, at.cap)
        at.scales = self.scales(extent, at.level)
        at.level = at.aim * at.scales[1] if at.load is None else at.level
        return extent

    def middle(self, at: Fields, cap: float) -> float:
        """Gap between those at the cap and those without pressure, where all points are either."""
        capped = at.p >= cap
        highest = self.grid.sums.maximum(float(at.gap.max(initial=-np.inf, where=capped)))
        lowest = self.grid.sums.minimum(float(at.gap.min(initial=np.inf, where=~capped)))
        finite = [each for each in (highest, lowest) if np.isfinite(each)]
        return sum(finite) / max(len(finite), 1)

    def scales(self, extent: Extent, level: float) -> tuple[float, float]:
        """Scales of pressure and depth, where the gap counts from a level."""
        depth = max(extent.mean + level, 0.0) + extent.depth - level
        return scales.py_func(extent.pressure, depth, self.floor)

    def set_load(self, at: Fields) -> bool:
        """Scale the pressure to the given load; return whether there is any pressure, and can be as much."""
        if at.cap is not None:
            return self._set_capped(at, at.cap)
        total = self.grid.sums.total(float(at.p.sum()))
        if not 0.0 < total < np.inf:
            return False
        if at.load is not None and total != at.load:
            at.p *= at.load / total
        return True

    def _set_capped(self, at: Fields, cap: float) -> bool:
        """Cut the pressure off at the cap; scale the rest, or else all, to the given load; see `set_load`."""
        np.minimum(at.p, cap, out=at.p)
        for _ in range(_PROJECTIONS):
            below = at.p < cap
            parts = float(at.p[below].sum()), cap * float(np.count_nonzero(~below))
            inner, capped = self.grid.sums.total(np.array(parts)).tolist()
            if at.load is None or not 0.0 < inner + capped < np.inf:
                return bool(0.0 < inner + capped < np.inf)
            if abs(inner + capped - at.load) <= _ROUNDING * at.load:
                return True
            if inner > 0.0 and capped < at.load:
                factor = (at.load - capped) / inner
            elif inner + capped > at.load:
                factor, below = at.load / (inner + capped), np.ones_like(below)
            else:
                return False
            at.p[below] = np.minimum(factor * at.p[below], cap)
        return True

    def add_response(self, at: Fields) -> None:
        """Write the gap of the pressure, from the gap without it, in single precision."""
        np.copyto(self.step, at.p, casting="same_kind")
        self.respond()
        np.add(at.gap0, self.change, out=at.gap)


class Search:
    """Conjugate directions from a state, in single or in double precision, whose gap belongs to its pressure.

    `residual` is the sum of the largest open gap or tension and the largest overlap, or twice the larger of
    them where no load is given.
    """

    def __init__(self, level: Level, at: Fields) -> None:
        self._on, self.at = level, at
        for field in (level.d, level.z, level.r, level.step, level.change):
            field.fill(0.0)
        self._alpha, self._shift = 1.0, 0.0
        self._product = 0.0  # z.r of the last iteration; 0 where directions begin anew
        self._move(0.0, 1.0)

    def run(self, tolerance: float, limit: int) -> int:
        """Bring the residual within a tolerance, or to where it falls no more; return the iterations."""
        best, since, iteration = np.inf, 0, 0
        while self.residual > tolerance and iteration < limit and iteration - since <= _PATIENCE:
            if self.residual < _PROGRESS * best:
                best, since = self.residual, iteration
            self._advance()
            iteration += 1
        return iteration

    def _advance(self) -> None:
        """Take one iteration."""
        self._direct()
        self._project()
        if not self._slope > 0:
            on, ends = self._on, self.at.p + np.float64(self._alpha) * self._on.d <= 0.0
            on.r[ends & (on.r < 0.0)] = 0.0  # points whose pressure it would end and whose gap is open leave
            self._alpha, self._product = min(self._alpha, 1.0), 0.0
            self._direct()
            self._project()
        along_r = not self._slope > 0
        if along_r:
            self._move(0.0, 1.0)
            np.copyto(self._on.d, self._on.r)
            self._alpha, self._shift = 0.5 * self._on.stiffest, 0.0
            self._write_step()
            self._project()
        self._on.respond()
        optimum, length, scale = self._lengths()
        self._move(length, scale)
        self._alpha = _SHORTEST if along_r else min(max(optimum * self._alpha, _SHORTEST), _LONGEST)
        self._product = 0.0 if along_r else self._product

    def _direct(self) -> None:
        """Write the next direction."""
        on, at = self._on, self.at
        count, total, pull, along, across, last, memory, mean = on.precondition()
        # Under a given load z has no mean, and r none that counts.
        excess, common = (total / count, pull / count) if at.load is not None and count else (0.0, 0.0)
        product, change = along - excess * pull, across - excess * last
        beta = max((product - change) / self._product, 0.0) if self._product > 0 else 0.0
        if product + beta * (memory - common * mean) <= 0:
            beta = 0.0
        self._product = product
        self._shift = (self._load - at.load) / count if at.load is not None and count else 0.0
        step = self._alpha, self._shift
        fields = at.p, on.r, on.z, on.d, on.step
        self._note(on.parallel(passes.direct, excess, beta, *step, at.cap, *fields)[0])

    def _project(self) -> None:
        """Write the step of the given load."""
        at, begin, low, high = self.at, self._shift, -np.inf, np.inf
        for _ in range(_PROJECTIONS):
            if at.load is None or abs(self._above) <= _LOAD * self._shifted:
                break
            if at.cap is None:
                self._shift += self._above / self._count if self._count else min(self._above, 0.0)
            else:  # the sum is no convex function of the shift: between two that enclose it
                low, high = (self._shift, high) if self._above > 0 else (low, self._shift)
                self._shift = self._between(low, high, at.cap + 2.0 * abs(self._shift - begin))
            self._write_step()

    def _between(self, low: float, high: float, reach: float) -> float:
        """Shift for the given load, by Newton's method within bounds; `reach` away where one is not known."""
        newton = self._shift + self._above / self._count if self._count else np.nan
        if low < newton < high:
            return newton
        if np.isinf(high - low):
            return low + reach if np.isinf(high) else high - reach
        return (low + high) / 2

    def _write_step(self) -> None:
        on, p = self._on, self.at.p
        step = self._alpha, self._shift, self.at.cap
        self._note(on.parallel(passes.project, *step, p, on.r, on.d, on.step)[0])

    def _note(self, found: Sequence[float]) -> None:
        """Note the load beyond the given one, the number of pressures, and how the energy falls."""
        total, self._count, self._slope, self._ended = found
        self._above = total - (self.at.load or 0.0)

    @property
    def _shifted(self) -> float:
        """Load that a shift may change: with a cap that of the pressures below it, at most, or rounding."""
        load, cap = self.at.load or 0.0, self.at.cap
        if cap is None:
            return load
        return max(min(load, cap * self._count), _SUMMED * float(np.finfo(self.at.p.dtype).eps) * load)

    def _lengths(self) -> tuple[float, float, float]:
        """Return the length of the step of the lowest energy, the one to take, and the scale after it."""
        on, at, slope = self._on, self.at, self._slope
        (curvature, across), (fall,) = on.parallel(passes.respond, at.cap, at.p, on.step, on.change)
        optimum = slope / curvature if curvature > 0 else 1.0
        # The energy of a p + b D is a parabola of a and b.
        stiff, free, push = self._weighted - self._free, self._free - at.level * self._load, slope + across
        if at.load is None and at.cap is None:
            whole, part = -across * push - curvature * free, across * free + stiff * push
            if stiff * curvature > across**2 and whole > 0:
                optimum = part / whole
        length = optimum
        if optimum > 1.0:
            length = min(optimum, 1.0 / fall) if fall > 0 else optimum
        elif optimum > _LET_GO and self._ended > 0:
            length = 1.0
        if at.cap is not None:
            return optimum, length, 1.0
        if at.load is None:
            energy, push = stiff + length * (2.0 * across + length * curvature), length * push - free
            return optimum, length, push / energy if push > 0 and energy > 0 else 1.0
        # The step sets p.gap, and so the level.
        at.level = (self._weighted + length * (across - slope + length * curvature)) / self._load
        return optimum, length, 1.0

    def _move(self, length: float, scale: float) -> None:
        """Take a step and assess the state."""
        on, at = self._on, self.at
        fields = at.p, at.gap, at.gap0, on.step, on.change, on.z
        while True:
            move = Move(length, scale, at.load is not None, at.level, 1.0 / at.scales[0], 1.0 / at.scales[1])
            found, (opened, below) = on.parallel(passes.advance, move, at.cap, *fields)
            self._load, self._weighted, self._free, inner = found
            if at.cap is None or at.load is None or length == 0.0:
                break
            length = 0.0  # the level is known after the step
            at.level = self._weighted / inner if inner > 0.0 else on.middle(at, at.cap)
        on.r, on.z = on.z, on.r
        at.level = at.level if at.load is None else 0.0
        # A gap may be shifted under a given load; elsewhere the aim is the middle of the allowed range.
        worst = opened + below if at.load is not None else 2.0 * max(opened, below)
        self.residual = worst if np.isfinite(self._load + self._weighted) else np.nan
